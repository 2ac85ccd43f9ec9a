# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The next view: where to hold the board so that the camera becomes known better.

Of a hundred poses the one is chosen after which the camera is expected to be known best: the "next
best view" of Peng and Sturm, Calibration Wizard, ICCV 2019, with our measures of uncertainty.

This module stands alone because it knows nothing of a session: a camera in, a pose and words out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import itertools
import math

import numpy as np
from p4pfr_ros import CalibrationOptions, CameraEstimate, DivisionCamera, Keyframe, Pose
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array, rotation_angle_rad
from p4pfr_ros.core.many_views.progress import projection_sigmas_px
from p4pfr_ros.core.model.lens import (
    camera_from_lens,
    CX,
    CY,
    FOCAL,
    lens_from_camera,
    LENS_SIZE,
)
from p4pfr_ros.core.model.observation import image_center_px
from p4pfr_ros.core.model.prior import typical_focal_px
from p4pfr_ros.core.model.uncertainty import sigma_at
from p4pfr_ros.scenes.board_path import outline_of, placed, tilted_rotation

# The poses to choose from: tilts with their directions in quarters of a turn, turns about the line
# of sight, and shares of the image that the board fills.
_TILT_RAD = math.radians(35.0)
_TILTS = ((0.0, 0), *((_TILT_RAD, quarters) for quarters in range(4)))
_ROLLS_RAD = (0.0, 0.5 * math.pi)
_FILLS = (0.45, 0.8)
# Margin around a target, as a share of the image.
_MARGIN = 0.04
# Points of the board along a side that stand for all, and of the grid over the image.
_POINTS, _GRID = 5, (8, 6)
# Noise of a coordinate is at least this, px.
_SMALLEST_SIGMA_PX = 0.1
# Steps of the numerical derivatives: of a turn (rad) or a shift (share of the distance), and of a
# parameter of the lens (standard deviations).
_MOVE, _LENS = 1e-5, 1e-2
# A view is like a pose if the corners of the board are this close, rms, share of the diagonal.
_UNLIKE = 0.05
# The poses are drawn anew when the focal length has changed by this share.
_SAME_FOCAL = 0.05
# Another target has to be better by this share, so that the target does not jump.
_BETTER = 0.8
# Within these, the board is at the target: middle (share of the diagonal), distance (ratio), tilt
# and roll.
_SAME_PLACE, _SAME_DISTANCE, _SAME_TILT_DEG, _SAME_ROLL_DEG = 0.08, 1.25, 14.0, 30.0
_MOST_WORDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class NextView:
    """
    A view to take next.

    board, camera_from_board
        The board, and where to hold it.
    camera
        The camera that sees it.
    uncertainty
        What is expected after the view, in tolerances; see `_uncertainty_after`. NaN as long as
        there is no camera.
    """

    board: Board
    camera_from_board: Pose
    camera: DivisionCamera
    uncertainty: float


class Guide:
    """
    Chooses where to hold a board next, after each change of the camera.

    Parameters
    ----------
    board
        The board to hold.
    image_size
        Width and height of the image, pixels.
    options
        The tolerances to reach.

    """

    def __init__(
        self, board: Board, image_size: tuple[int, int], options: CalibrationOptions
    ) -> None:
        self._board, self._image_size, self._options = board, image_size, options
        focal_px = typical_focal_px(0.5 * math.hypot(*image_size))
        # To draw targets while there is no other.
        self._typical = DivisionCamera(focal_px, image_center_px(image_size))
        self._last: NextView | None = None
        self._poses: list[Pose] = []
        self._posed_for = self._typical

    def next_view(self, estimate: CameraEstimate | None, views: Sequence[Keyframe]) -> NextView:
        """
        Return the view after which the camera is expected to be known best.

        estimate: the camera, if any; views: those that it is estimated from. Without a camera the
        board is to be tilted, to another side after each view. A target stays until there is a
        view like it, unless another one is clearly better.
        """
        poses = [] if estimate is None else self._poses_for(estimate.camera)
        if estimate is None or not poses:
            return self._tilted_view(len(views))
        poses = self._unseen(poses, estimate.camera, views)
        stays = self._last is not None and self._last.camera_from_board in poses
        information = _information(estimate, poses, _sample_points(self._board))
        after = np.array(
            [
                _uncertainty_after(estimate, each, self._image_size, self._options)
                for each in information
            ]
        )
        best = int(np.nanargmin(after)) if np.isfinite(after).any() else 0
        if self._last is not None and stays:
            last = poses.index(self._last.camera_from_board)
            best = last if after[last] * _BETTER < after[best] else best
        self._last = NextView(self._board, poses[best], estimate.camera, float(after[best]))
        return self._last

    def _tilted_view(self, turns: int) -> NextView:
        """Return a view of a board that is tilted to one of four sides, with a typical camera."""
        self._last, self._poses, self._posed_for = None, [], self._typical
        rotation = tilted_rotation(_TILT_RAD, 0.5 * math.pi * (turns % 4), 0.0)
        pose = self._placed(rotation, 0.65, np.array(image_center_px(self._image_size)))
        return NextView(self._board, pose, self._typical, math.nan)

    def _unseen(
        self, poses: list[Pose], camera: DivisionCamera, views: Sequence[Keyframe]
    ) -> list[Pose]:
        """Return the poses unlike all views; all of them if there is no other."""
        corners = outline_of(self._board)[[0, 8, 9, 17]]
        drawn, seen = (
            camera.project(np.array([pose.transform(corners) for pose in each]).reshape(-1, 4, 3))
            for each in (poses, [view.camera_from_board for view in views])
        )
        distances_px = np.sqrt(np.mean(np.sum((drawn[:, None] - seen) ** 2, axis=-1), axis=-1))
        nearest_px = np.nan_to_num(distances_px, nan=np.inf).min(axis=1, initial=np.inf)
        far = nearest_px > _UNLIKE * math.hypot(*self._image_size)
        return [pose for pose, is_far in zip(poses, far, strict=True) if is_far] or poses

    def _placed(self, rotation: Array, filled: float, middle_px: Array) -> Pose:
        outline = outline_of(self._board)
        return placed(outline, rotation, filled, middle_px, self._posed_for, self._image_size)

    def _poses_for(self, camera: DivisionCamera) -> list[Pose]:
        """Return the poses to choose from; those for nearly the same camera are good enough."""
        old = self._posed_for
        if not self._poses or abs(math.log(camera.focal_px / old.focal_px)) > _SAME_FOCAL:
            self._posed_for = camera
            self._poses = list(self._drawn_poses())
        return self._poses

    def _drawn_poses(self) -> Iterator[Pose]:
        """Yield poses all over the image, with the whole board in it."""
        outline, size_px = outline_of(self._board), np.array(self._image_size, dtype=np.float64)
        for filled in _FILLS:
            shares = (0.0, 0.5, 1.0) if filled < 0.6 else (0.0, 1.0)
            for share in itertools.product(shares, shares):
                free = (1.0 - filled - 2.0 * _MARGIN) * np.array(share)
                middle_px = (_MARGIN + 0.5 * filled + free) * size_px - 0.5
                for (tilt_rad, quarters), roll_rad in itertools.product(_TILTS, _ROLLS_RAD):
                    rotation = tilted_rotation(tilt_rad, 0.5 * math.pi * quarters, roll_rad)
                    try:
                        pose = self._placed(rotation, filled, middle_px)
                    except ValueError:  # the lens does not see the whole board there
                        continue
                    pixels = self._posed_for.project(pose.transform(outline))
                    # False for NaN.
                    if ((pixels > -0.5) & (pixels < size_px - 0.5)).all():
                        yield pose


def _sample_points(board: Board) -> Array:
    """Return points (N, 3) all over the points of a board."""
    low, high = board.points.min(axis=0), board.points.max(axis=0)
    axes = [np.linspace(low[i], high[i], _POINTS) for i in range(2)]
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.pad(xy, ((0, 0), (0, 1)))


def _information(estimate: CameraEstimate, poses: Sequence[Pose], points: Array) -> Array:
    """Return the information (P, 10, 10) of views about the lens, with their poses unknown."""
    camera = estimate.camera
    in_camera = np.array([pose.transform(points) for pose in poses])
    distances = np.array([pose.distance for pose in poses])[:, None, None]
    moves = [np.cross(axis, in_camera) for axis in np.eye(3)]
    moves += [np.broadcast_to(distances * axis, in_camera.shape) for axis in np.eye(3)]
    by_pose = np.stack([_by_move(camera, in_camera, move) for move in moves], axis=-1)
    by_lens = _by_lens(estimate, in_camera)
    # Of the changes of the pixels by the lens, a pose that is unknown explains a part.
    transposed = by_pose.transpose(0, 2, 1)
    with np.errstate(all='ignore'):  # extreme cameras
        products = np.nan_to_num(transposed @ by_pose, posinf=0.0, neginf=0.0)
        rest = by_lens - by_pose @ np.linalg.pinv(products) @ transposed @ by_lens
    sigma_px = max(estimate.rms_px / math.sqrt(2.0), _SMALLEST_SIGMA_PX)
    information: Array = rest.transpose(0, 2, 1) @ rest / (sigma_px**2 * estimate.scatter)
    return information


def _by_move(camera: DivisionCamera, in_camera: Array, move: Array) -> Array:
    """Return the derivative (P, 2 N) of the pixels of points (P, N, 3) that move."""
    there, back = (camera.project(in_camera + sign * _MOVE * move) for sign in (1.0, -1.0))
    change: Array = (there - back).reshape(len(in_camera), -1) / (2.0 * _MOVE)
    return change


def _by_lens(estimate: CameraEstimate, in_camera: Array) -> Array:
    """Return the derivatives (P, 2 N, 10) of the pixels of points (P, N, 3) by the lens."""
    camera, count = estimate.camera, len(in_camera)
    lens = lens_from_camera(camera, camera.center_px)
    columns = np.zeros((LENS_SIZE, count, 2 * in_camera.shape[1]))
    for i, sigma in enumerate(np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))):
        if not sigma > 0.0:
            continue
        ends = []
        for step in (_LENS * sigma, -_LENS * sigma):
            moved = lens.copy()
            moved[i] += step
            ends.append(camera_from_lens(moved, camera.center_px).project(in_camera))
        columns[i] = (ends[0] - ends[1]).reshape(count, -1) / (2.0 * _LENS * sigma)
    return columns.transpose(1, 2, 0)


def _uncertainty_after(
    estimate: CameraEstimate,
    information: Array,
    image_size: tuple[int, int],
    options: CalibrationOptions,
) -> float:
    """
    Return the expected uncertainty of the camera after a view, in tolerances.

    The root of the sum of squares of three shares: focal length, centre, and projections over the
    whole image, rms.
    """
    if not np.isfinite(information).all():
        return math.nan
    camera, covariance = estimate.camera, estimate.covariance
    try:
        after = covariance @ np.linalg.inv(np.eye(LENS_SIZE) + information @ covariance)
    except np.linalg.LinAlgError:  # extreme numbers
        return math.nan
    after = 0.5 * (after + after.T)
    axes = [
        (np.arange(n) + 0.5) * side / n - 0.5 for n, side in zip(_GRID, image_size, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    projection = projection_sigmas_px(camera, after, grid) / options.projection_tolerance_px
    focal = sigma_at(after, FOCAL) / (options.focal_tolerance * camera.focal_px)
    center_px = max(sigma_at(after, CX), sigma_at(after, CY))
    center = center_px / (options.center_tolerance * math.hypot(*image_size))
    return math.sqrt(float(np.mean(projection**2)) + focal**2 + center**2)


def directions(target: NextView, pose: Pose, image_size: tuple[int, int]) -> tuple[str, ...]:
    """
    Return how to move the board to the target, the largest difference first; empty if it is there.

    Sides are those of the image.
    """
    found = [
        *_to_place(target, pose, image_size),
        *_to_tilt(target.camera_from_board.rotation[:, 2], pose.rotation[:, 2]),
        *_to_distance(target.camera_from_board.distance / pose.distance),
        *_to_roll(target.camera_from_board, pose),
    ]
    found.sort(reverse=True)
    return tuple(words for excess, words in found if excess > 1.0)[:_MOST_WORDS]


def place_name(pixel: Array, image_size: tuple[int, int]) -> str:
    """Return the name of the part of the image that a pixel is in."""
    column, row = (min(max(int(3.0 * (pixel[i] + 0.5) / image_size[i]), 0), 2) for i in range(2))
    across, down = ('left', 'middle', 'right')[column], ('upper', 'middle', 'lower')[row]
    if row == column == 1:
        return 'the middle of the image'
    if row == 1:
        return f'the {across} side of the image'
    if column == 1:
        return f'the {down} side of the image'
    return f'the {down} {across} corner of the image'


def _to_place(
    target: NextView, pose: Pose, image_size: tuple[int, int]
) -> Iterator[tuple[float, str]]:
    there, here = (
        target.camera.project(each.translation) for each in (target.camera_from_board, pose)
    )
    off = float(np.linalg.norm(there - here)) / math.hypot(*image_size)
    yield off / _SAME_PLACE, f'move the board to {place_name(there, image_size)}'


def _to_tilt(target_z: Array, z: Array) -> Iterator[tuple[float, str]]:
    """Compare normals, out of the board towards the camera."""
    angle_deg = math.degrees(math.acos(min(max(float(target_z @ z), -1.0), 1.0)))
    # The board's side that its normal leans to is farther from the camera.
    x, y = target_z[:2] - z[:2]
    if math.hypot(*target_z[:2]) < math.sin(math.radians(_SAME_TILT_DEG)):
        words = 'hold the board parallel to the image'
    elif abs(x) > abs(y):
        words = f'tilt the {"right" if x > 0.0 else "left"} side away from the camera'
    else:
        words = f'tilt the {"lower" if y > 0.0 else "upper"} side away from the camera'
    yield angle_deg / _SAME_TILT_DEG, words


def _to_distance(ratio: float) -> Iterator[tuple[float, str]]:
    words = 'move the board closer' if ratio < 1.0 else 'move the board farther away'
    yield abs(math.log(ratio)) / math.log(_SAME_DISTANCE), words


def _to_roll(target: Pose, pose: Pose) -> Iterator[tuple[float, str]]:
    """Compare the turns about the line of sight; half a turn makes no difference."""
    angle = rotation_angle_rad(target.rotation, pose.rotation)
    if math.degrees(angle) > _SAME_ROLL_DEG:
        x_there, x_here = (each.rotation[:2, 0] for each in (target, pose))
        cosine = abs(float(x_there @ x_here)) / max(
            float(np.linalg.norm(x_there) * np.linalg.norm(x_here)), 1e-12
        )
        roll_deg = math.degrees(math.acos(min(cosine, 1.0)))
        yield roll_deg / _SAME_ROLL_DEG, f'turn the board by {round(roll_deg, -1):.0f} degrees'
