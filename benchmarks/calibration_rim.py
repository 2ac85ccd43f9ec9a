# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Fisheye lenses that leave the corners of the image dark: the rim, and the exported CameraInfo.

    [P4PFR_DATA=FOLDER] python -m benchmarks.calibration_rim [--cameras N]

Of the points near the largest radius that was seen, a model with too few terms rejects many. And
a CameraInfo that is fitted to the dark corners, too, is worse where the lens was seen.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import math

import cv2
import numpy as np
from p4pfr_ros import CalibrationState, DivisionCamera, Verdict
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import Array, Mask, Pose
from p4pfr_ros.scenes.camera_views import board_grid
from p4pfr_ros.scenes.instances import draw_rotations, IMAGE_SIZE
from rich.console import Console
from rich.progress import track

from .calibration_orders import calibrate, Run
from .corner_sets import CornerSet, CornerView, read_corner_sets
from .tables import Measured, Row, table_of

# Radii of the image circle: cut at the top and bottom of the image, and whole. The corners, at
# 800 px, are dark.
_CIRCLES_PX = {'circle cut': 600.0, 'circle whole': 470.0}
_FIELDS_OF_VIEW_DEG = (140, 155, 170, 185)
_LENSES = [
    (name, circle_px, fov_deg)
    for name, circle_px in _CIRCLES_PX.items()
    for fov_deg in _FIELDS_OF_VIEW_DEG
]
_CENTER_SIGMA_PX = 2.0
_VIEWS, _NOISE_PX = 30, 0.2
_BOARD = board_grid(9, 6)
_TILT_DEG, _DISTANCE = (0.0, 60.0), (0.25, 0.9)
_MIN_SEEN = 30  # points of a view: boards that reach over the rim are seen in part

_RIM = 0.95  # of the largest radius seen
_GRID_PX = 8
# The undistorted image has as many pixels a side, and reaches to this angle.
_UNDISTORTED_SIDE, _UNDISTORTED_RAD = 801, math.radians(80.0)
_REAL = 'fisheye_a_left'
_WIDTH = 200

RIM_NOTE = (
    'Dark corners: the image circle has a radius of 600 px (cut by the upper and lower edge of '
    '1280x960) or 470 px (whole). Boards reach over its rim, and are seen in part. Inliers beyond '
    '95 % of the largest radius that was seen: of the keyframes of the last fit, and of the poses '
    'as they were returned. The exported model is that of CameraInfo; its residual is the '
    'distance from the calibrated camera, also by `initUndistortRectifyMap` of OpenCV. Monotonic: '
    'each pixel of the image has a ray in it.'
)


@dataclass(frozen=True, slots=True)
class _Fisheye:
    """An equidistant lens that sees nothing beyond half_rad from the axis."""

    half_rad: float
    circle_px: float
    center_px: tuple[float, float]

    @property
    def focal_px(self) -> float:
        return self.circle_px / self.half_rad

    def project(self, points: Array) -> Array:
        """Project points (N, 3) to pixels (N, 2); NaN where the lens or the image ends."""
        f = self.focal_px
        lens = CameraInfoModel('equidistant', (0.0,) * 4, (f, f), self.center_px, 0.0, IMAGE_SIZE)
        pixels = lens.project(points)
        seen = (pixels > 0.0) & (pixels < np.subtract(IMAGE_SIZE, 1))
        seen &= (np.linalg.norm(pixels - self.center_px, axis=1) < self.circle_px)[:, None]
        return np.where(seen.all(axis=1, keepdims=True), pixels, np.nan)


@dataclass(frozen=True, slots=True)
class _Measured:
    """
    What one calibration says about the rim and about its CameraInfo.

    focal_error: of the focal length, in its standard deviations; NaN for a real camera.
    rim_keyframes, rim_views: whether each point beyond 95 % of the seen radius is an inlier of
    its keyframe at the end, and of the estimate of its view, as update returned it. Residuals of
    the CameraInfo in px inside the seen radius, by OpenCV's undistortion there, and in the whole
    image.
    """

    state: CalibrationState
    outlier_views: int
    rms_px: float
    focal_error: float
    rim_keyframes: Mask
    rim_views: Mask
    model: CameraInfoModel
    inside_px: float
    opencv_px: float
    whole_px: float
    is_monotonic: bool


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the table."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.calibration_rim', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--cameras', type=int, default=5, help='lenses of each field of view; default: %(default)s'
    )
    given = parser.parse_args(arguments)
    console = Console()
    console.width = max(console.width, _WIDTH)  # do not truncate cells
    console.print(table_of(*rim_table(read_corner_sets(), given.cameras)))
    return 0


def rim_table(sets: Sequence[CornerSet], cameras: int) -> Measured:
    """Calibrate lenses of each field of view, and the real fisheye if its corners are there."""
    rows = []
    for name, circle_px, fov_deg in track(_LENSES, 'fisheye lenses', transient=True):
        lenses = [_draw_lens(fov_deg, circle_px, seed) for seed in range(cameras)]
        measured = [_measure(_synthetic(lens, i), lens.focal_px) for i, lens in enumerate(lenses)]
        rows.append(_row(f'{fov_deg}°, {name}', measured))
    rows += [_row(corners.name, [_measure(corners)]) for corners in sets if corners.name == _REAL]
    header = (
        'lens',
        'CALIBRATED',
        'OUTLIER,\nviews',
        'rms, px,\nlargest',
        'f - truth,\nmax σ',
        'inliers beyond 95 % of the radius,\nkeyframes / as returned',
        'exported model',
        'its residual where\nseen, px, largest',
        "by OpenCV's\nundistortion",
        'in the whole image',
        'monotonic\nthere',
    )
    title = (
        f'Equidistant lenses with dark corners, {cameras} each: {_VIEWS} views of a board of '
        f'{len(_BOARD)} points, {_NOISE_PX} px'
    )
    return title, header, rows


def _draw_lens(fov_deg: float, circle_px: float, seed: int) -> _Fisheye:
    rng = np.random.default_rng(seed)
    x, y = 0.5 * np.subtract(IMAGE_SIZE, 1) + rng.normal(0.0, _CENTER_SIGMA_PX, 2)
    return _Fisheye(math.radians(0.5 * fov_deg), circle_px, (float(x), float(y)))


def _synthetic(lens: _Fisheye, seed: int) -> CornerSet:
    rng = np.random.default_rng(seed)
    views = tuple(_draw_view(rng, lens) for _ in range(_VIEWS))
    return CornerSet('synthetic', IMAGE_SIZE, _BOARD, views)


def _draw_view(rng: np.random.Generator, lens: _Fisheye) -> CornerView:
    """Draw a view of the board's front, whose origin may be anywhere in the image circle."""
    board = np.pad(_BOARD, ((0, 0), (0, 1)))
    while True:
        # Uniform in the circle, whose rim counts.
        angle = lens.half_rad * math.sqrt(rng.uniform())
        azimuth = rng.uniform(0.0, 2.0 * math.pi)
        sideways = math.sin(angle)
        axis = np.array(
            [sideways * math.cos(azimuth), sideways * math.sin(azimuth), math.cos(angle)]
        )
        distance = math.exp(rng.uniform(*np.log(_DISTANCE)))
        pose = Pose(_facing(axis) @ draw_rotations(rng, 1, _TILT_DEG)[0], distance * axis)
        points = pose.transform(board)
        image = lens.project(points)
        ids = np.flatnonzero(np.isfinite(image[:, 0]))
        if len(ids) >= _MIN_SEEN and (points @ pose.rotation[:, 2] < 0.0).all():
            noisy = image[ids] + rng.normal(0.0, _NOISE_PX, (len(ids), 2))
            return CornerView(noisy, ids)


def _facing(axis: Array) -> Array:
    """Return a rotation (3, 3) that turns the optical axis to this direction."""
    x = np.cross((0.0, 1.0, 0.0), axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _measure(corners: CornerSet, focal_px: float = math.nan) -> _Measured | None:
    """Calibrate from the views; None without a camera. focal_px: the true focal length."""
    run = calibrate(corners)
    estimate = run.cameras[-1]
    if estimate is None:
        return None
    camera = estimate.camera
    model = camera.to_camera_info_model(corners.image_size, estimate.seen_radius_px)
    radius_px = _radii(np.concatenate([v.image_points for v in corners.views]), camera).max()
    pixels = _pixels(corners.image_size)
    errors = model.project(camera.unproject(pixels)) - pixels
    inside = _radii(pixels, camera) < radius_px
    return _Measured(
        run.states[-1],
        run.verdicts.count(Verdict.OUTLIER),
        estimate.rms_px,
        abs(camera.focal_px - focal_px) / estimate.focal_sigma_px,
        *_rim_inliers(run, corners, camera, radius_px),
        model,
        _largest_px(errors[inside]),
        _opencv_error_px(camera, model, radius_px),
        _largest_px(errors),
        bool(np.isfinite(model.unproject(pixels)).all()),
    )


def _rim_inliers(
    run: Run, corners: CornerSet, camera: DivisionCamera, radius_px: float
) -> tuple[Mask, Mask]:
    """Return the inliers of the points near the largest radius: of keyframes, of estimates."""
    keyframes = [
        view.inliers[_radii(view.image_points, camera) > _RIM * radius_px]
        for view in run.calibration.views
    ]
    estimates = []
    for view, estimate in zip(corners.views, run.estimates, strict=True):
        is_rim = _radii(view.image_points, camera) > _RIM * radius_px
        inliers = np.zeros_like(is_rim)
        if estimate is not None and estimate.model is not None:
            inliers = estimate.inliers
        estimates.append(inliers[is_rim])
    return np.concatenate(keyframes), np.concatenate(estimates)


def _opencv_error_px(camera: DivisionCamera, model: CameraInfoModel, radius_px: float) -> float:
    """
    Return the largest error of the map from an undistorted image, as image_proc computes it.

    Of pixels within the seen radius, in both images.
    """
    half = 0.5 * (_UNDISTORTED_SIDE - 1)
    f = half / math.tan(_UNDISTORTED_RAD)
    new_matrix = np.array([[f, 0.0, half], [0.0, f, half], [0.0, 0.0, 1.0]])
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    is_fisheye = model.distortion_model == 'equidistant'
    make_maps = (cv2.fisheye if is_fisheye else cv2).initUndistortRectifyMap
    maps = make_maps(
        matrix,
        np.array(model.coefficients),
        np.eye(3),
        new_matrix,
        (_UNDISTORTED_SIDE, _UNDISTORTED_SIDE),
        cv2.CV_32FC1,
    )
    reached = np.stack(maps, axis=-1).reshape(-1, 2)
    y, x = np.mgrid[:_UNDISTORTED_SIDE, :_UNDISTORTED_SIDE].reshape(2, -1)
    rays = np.stack([(x - half) / f, (y - half) / f, np.ones(len(x))], axis=1)
    pixels = camera.project(rays)
    compared = (_radii(pixels, camera) < radius_px) & _is_inside(pixels, model.image_size)
    return _largest_px(reached[compared] - pixels[compared])


def _pixels(image_size: tuple[int, int]) -> Array:
    """Return pixels (N, 2) of a grid over the whole image, the last ones included."""
    sides = (np.append(np.arange(0, side - 1, _GRID_PX), side - 1) for side in image_size)
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2).astype(np.float64)


def _is_inside(pixels: Array, image_size: tuple[int, int]) -> Mask:
    above, below = pixels > 0.0, pixels < np.subtract(image_size, 1)
    inside: Mask = np.asarray((above & below).all(axis=1))
    return inside


def _radii(pixels: Array, camera: DivisionCamera) -> Array:
    """Return the distances (N,) from the centre, px."""
    radii: Array = np.linalg.norm(pixels - camera.center_px, axis=1)
    return radii


def _largest_px(errors: Array) -> float:
    """Return the largest length of errors (N, 2); infinite if one is not defined."""
    lengths = np.linalg.norm(errors, axis=1)
    return float(np.where(np.isnan(lengths), np.inf, lengths).max())


def _row(name: str, measured: Sequence[_Measured | None]) -> Row:
    found = [each for each in measured if each is not None]
    if not found:
        return (name, f'0 of {len(measured)}', *9 * ('',))
    calibrated = sum(each.state is CalibrationState.CALIBRATED for each in found)
    models = {each.model.distortion_model for each in found}
    return (
        name,
        f'{calibrated} of {len(measured)}',
        str(sum(each.outlier_views for each in found)),
        f'{max(each.rms_px for each in found):.3f}',
        f'{max(each.focal_error for each in found):.2f}',
        f'{_share([e.rim_keyframes for e in found])} / {_share([e.rim_views for e in found])}',
        ', '.join(sorted(models)),
        f'{max(each.inside_px for each in found):.3f}',
        f'{max(each.opencv_px for each in found):.3f}',
        f'{max(each.whole_px for each in found):.3f}',
        f'{sum(each.is_monotonic for each in found)} of {len(found)}',
    )


def _share(inliers: Sequence[Mask]) -> str:
    together = np.concatenate(inliers)
    return f'{100.0 * together.mean():.1f} % of {together.size}' if together.size else '-'


if __name__ == '__main__':
    raise SystemExit(main())
