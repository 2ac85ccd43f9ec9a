# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The solver and the self-calibration: NumPy and Numba only; no ROS, no OpenCV, no files.

Imports go downward only:

    many_views   views of one camera -> its calibration
    one_view     N points of one image -> pose, camera, covariance
    model        shared by one view and many: observation, lens, priors, noise
    minimal      four points -> pose, focal length, distortion
    cameras      camera models, and the conversions between them
    geometry, linalg, options, jit, kernel_cache

Start reading at ``one_view.estimate_pose`` and ``many_views.self_calibration``. Inside the kernels

    a scaled board has its mean at the origin and a half-size of 1 (``model.observation``),
    a pose is an array (12,): rotation by rows, translation of the scaled board (``geometry``),
    a row is a pose with the camera (g, h) of one view (``minimal.solution``),
    a lens is the camera (10,) of many views (``model.lens``),
    the bend of a lens is k r², usually at the image's corner, r in focal lengths.
"""
