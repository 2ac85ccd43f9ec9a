# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibrate with lensboy, eight coefficients and the board's warp, in an environment of its own.

    python -m venv lensboy && lensboy/bin/pip install lensboy
    lensboy/bin/python benchmarks/peers/fit_lensboy.py CORNERS.npz

CORNERS.npz: image_size (2,), board_points (M, 2), view (N,), ids (N,), the rows of board_points,
and image_points (N, 2). Prints JSON: matrix (3, 3), coefficients (14,) in OpenCV's order,
board_shape (M, 3), seconds of CPU. This script stands alone because it runs without p4pfr_ros.
"""

import json
import sys
import time

import lensboy
from lensboy._logging import disable_logs
import numpy as np

_COEFFICIENTS = (
    lensboy.OpenCVConfig.RADIAL_6 | lensboy.OpenCVConfig.TANGENTIAL  # as CALIB_RATIONAL_MODEL
)


def main() -> int:
    """Calibrate, and print the result."""
    disable_logs()
    data = np.load(sys.argv[1])
    width, height = data['image_size'].tolist()
    board_points = np.pad(data['board_points'], ((0, 0), (0, 1)))
    frames = [
        lensboy.Frame(data['ids'][of_view], data['image_points'][of_view])
        for of_view in (data['view'] == view for view in np.unique(data['view']))
    ]
    config = lensboy.OpenCVConfig(
        image_height=height, image_width=width, included_distortion_coefficients=_COEFFICIENTS
    )
    begin = time.process_time()
    result = lensboy.calibrate_camera(board_points, frames, camera_model_config=config)
    seconds = time.process_time() - begin
    camera, warp = result.camera_model, result.target_warp
    answer = {
        'matrix': camera.K().tolist(),
        'coefficients': camera.distortion_coeffs.tolist(),
        'board_shape': (board_points if warp is None else warp.warp_target(board_points)).tolist(),
        'seconds': seconds,
    }
    print(json.dumps(answer))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
