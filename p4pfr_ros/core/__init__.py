# SPDX-License-Identifier: Apache-2.0
"""Numbers in, numbers out: NumPy and Numba only, no ROS, no OpenCV, no files."""
