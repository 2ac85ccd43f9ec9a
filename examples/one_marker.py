# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Estimate the pose of one marker in one image, with a camera that nobody has calibrated.

    python examples/one_marker.py image.png [--size 0.15] [--id 0]
"""

import argparse

import cv2
import numpy as np
from p4pfr_ros import detect, estimate_pose
from p4pfr_ros.boards import Marker


def main() -> int:
    """Print what the image tells about the marker, and what it does not."""
    parser = argparse.ArgumentParser(description=__doc__.strip().split('\n\n')[0])
    parser.add_argument('image')
    parser.add_argument('--size', type=float, default=0.15, help='side of the black border, m')
    parser.add_argument('--id', type=int, default=0, help='id in the family 36h11')
    options = parser.parse_args()

    image = cv2.imread(options.image)
    if image is None:
        parser.error(f'{options.image}: not an image')
    marker = Marker(id=options.id, size_m=options.size, dictionary='DICT_APRILTAG_36h11')
    points = detect(image, marker)
    if not len(points.ids):
        print(points.reason)
        return 1

    height, width = image.shape[:2]
    estimate = estimate_pose(points.image_points, points.board_points, image_size=(width, height))
    if estimate.model is None:
        print(estimate.status.value)
        return 1
    pose = estimate.model.camera_from_board
    sigma_m = np.sqrt(np.diag(estimate.covariance)[:3])
    for axis, value, sigma in zip('xyz', pose.translation, sigma_m, strict=True):
        print(f'{axis} {value:8.3f} ± {sigma:.3f} m')
    print(f'tilt {pose.tilt_deg:5.1f}°')
    print(f'f {estimate.model.camera.focal_px:8.0f} ± {estimate.focal_sigma_px:.0f} px')
    if estimate.observable.undetermined:
        print('not determined by this view:', ', '.join(estimate.observable.undetermined))
    if estimate.alternatives:
        print(f'{len(estimate.alternatives)} other pose(s) fit the image as well')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
