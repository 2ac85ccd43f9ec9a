# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``python -m p4pfr_ros.ros.demo``."""

import sys

from . import main

sys.exit(main())
