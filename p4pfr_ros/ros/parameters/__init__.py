# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the nodes: names, defaults, ranges and descriptions."""
