# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads and writes files: boards, calibrations, images, bags."""
