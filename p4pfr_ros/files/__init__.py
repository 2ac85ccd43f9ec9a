# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that users give and get: boards, calibrations, images, bags."""
