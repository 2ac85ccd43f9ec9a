# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers in, numbers out: NumPy and Numba only, no ROS, no OpenCV, no files."""
