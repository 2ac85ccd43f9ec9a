# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The numerics, ROS-free: NumPy and Numba alone; no OpenCV, no files.

Imports go downward only:

    many_views   views of one camera -> its calibration
    one_view     N points of one image -> pose, camera, covariance
    model        what one view and many share: lens, observation, priors, noise
    minimal      four points -> pose, focal length, distortion
    cameras      camera models, and the conversions between them
    geometry, linalg, options, jit
"""
