# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibrate a camera from photographs of a board, and save it for ROS.

    python examples/calibrate_photographs.py *.jpg --board board.yaml --output camera.yaml

`p4pfr calibrate` does the same with more comfort; this is how to do it in a program of your own.
"""

import argparse

import cv2
from p4pfr_ros import CalibrationState, detect, load_boards, SelfCalibration
from p4pfr_ros.files.calibration import Calibration, save_calibration


def main() -> int:
    """Show one photograph after the other to the calibration."""
    parser = argparse.ArgumentParser(description=__doc__.strip().split('\n\n')[0])
    parser.add_argument('images', nargs='+')
    parser.add_argument('--board', default='config/boards/chessboard_9x6_25mm.yaml')
    parser.add_argument('--output', default='camera.yaml')
    options = parser.parse_args()

    boards = load_boards(options.board)
    calibration = None
    for path in options.images:
        image = cv2.imread(path)
        if image is None:
            print(f'{path}: not an image')
            continue
        if calibration is None:
            calibration = SelfCalibration(image_size=(image.shape[1], image.shape[0]))
        for name, board in boards.items():
            points = detect(image, board)
            if len(points.ids):
                calibration.update(points.image_points, points.board_points, path, board=name)
                print(f'{path}: {calibration.verdict.value}')
            else:
                print(f'{path}: {points.reason}')

    if calibration is None or calibration.fused is None:
        print('no camera: the photographs do not determine it')
        return 1
    if calibration.state is not CalibrationState.CALIBRATED:
        print('not calibrated yet:', '; '.join(calibration.missing))
        return 1
    fused = calibration.fused
    print(f'f {fused.camera.focal_px:.2f} ± {fused.focal_sigma_px:.2f} px')
    print(f'known within {fused.projection_sigma_px:.2f} px, rms {fused.rms_px:.2f} px')
    camera = Calibration.from_estimate(fused, calibration.image_size, 'camera')
    save_calibration(options.output, camera)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
