# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Makes ``python -m p4pfr_ros`` the command ``p4pfr``."""

from p4pfr_ros.cli import main

raise SystemExit(main())
