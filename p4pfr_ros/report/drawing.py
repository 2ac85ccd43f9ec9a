# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draws detections and poses onto images, and undistorts images."""

from __future__ import annotations

from itertools import pairwise
import math

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.boards import Board
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.core.geometry import Array, Pose
from p4pfr_ros.core.minimal.solution import Solution
from p4pfr_ros.detection import Detection
from p4pfr_ros.detection.candidates import NO_CODE, RejectedCandidate
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.report.lettering import Box, INK, write_at, write_at_top, write_label

__all__ = [
    'annotate',
    'board_lines',
    'captioned',
    'remap',
    'straighten',
    'straightened_camera',
    'straightening_map',
]

AnyCamera = DivisionCamera | CameraInfoModel

# Blue, green, red.
_CORNER, _OUTLINE = (0, 215, 255), (255, 160, 0)
_AXES = ((60, 60, 255), (60, 200, 60), (255, 90, 60))  # x red, y green, z blue
# Of candidates with a reason, of its letters, and of candidates that are no marker.
_REJECTED, _LETTERS, _NO_MARKER = (200, 80, 255), (240, 190, 255), (180, 120, 190)
# Of captions: the grey level of their bar, and the height of a line.
_BAR, _CAPTION_PX = 32, 22.0
# Of the candidates without a code, which are many, these largest ones are drawn.
_MAX_WITHOUT_CODE = 40
# Smaller ones are outlined thinly, pixels.
_MIN_WIDE_PX = 28.0
# The same reason is written so many times, whatever the marker; without an id, once.
# Space for it is looked for at so many candidates.
_MAX_WRITTEN, _MAX_TRIED = 3, 30
# A candidate with all corners this close to detected points is detected, pixels.
_SAME_PX = 6.0
# Fractional bits of the coordinates that cv2 draws at: 1/16 px.
_SHIFT = 4
# Segments per straight edge, which lens distortion bends.
_SEGMENTS = 48
# Line widths are given for images of this height; larger images get wider lines.
_REFERENCE_HEIGHT_PX = 480.0


def annotate(
    image: ImageArray,
    detection: Detection,
    solution: Solution | None = None,
    board: Board | None = None,
) -> ImageArray:
    """
    Draw a detection, and optionally the board's pose, onto a copy of an image.

    Parameters
    ----------
    image
        (h, w) or (h, w, 3) uint8.
    detection
        Its points are circled; if it has none, its reason is written. Rejected candidates are
        outlined, some of each kind with their reasons; those that are merely no marker only
        without points, and thinly.
    solution
        If given together with ``board``, the board's outline and axes (x red, y green, z blue)
        are projected with it, lens distortion included.
    board
        The detected board.

    Returns
    -------
    The annotated image, (h, w, 3) BGR.

    """
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    scale = max(1.0, canvas.shape[0] / _REFERENCE_HEIGHT_PX)
    candidates = _shown_candidates(detection)
    _outline(canvas, candidates, scale)
    if solution is not None and board is not None:
        _draw_board(canvas, solution, board, scale)
    for point in detection.image_points:
        _circle(canvas, point, 3.5 * scale, scale)
    bars = [write_at_top(canvas, detection.reason, scale)] if detection.reason else []
    _label(canvas, candidates, scale, bars)
    return np.asarray(canvas)


def straighten(image: ImageArray, camera: AnyCamera, *, max_fov_deg: float = 120.0) -> ImageArray:
    """
    Undistort an image, as seen by the pinhole camera `straightened_camera`.

    The image size stays the same; pixels outside the original image are black. For many images
    of one camera, compute the `straightening_map` once.
    """
    height, width = image.shape[:2]
    return remap(image, straightening_map(camera, (width, height), max_fov_deg=max_fov_deg))


def straightening_map(
    camera: AnyCamera,
    image_size: tuple[int, int],
    *,
    max_fov_deg: float = 120.0,
    step_px: int = 1,
) -> NDArray[np.float32]:
    """
    Return for each pixel of the undistorted image where it is in the image: (h, w, 2).

    step_px: the places are computed at every so many pixels in x and y, and interpolated between
    them, which is fast, for images that only people look at.
    """
    width, height = image_size
    pinhole = straightened_camera(camera, image_size, max_fov_deg=max_fov_deg)
    # With a margin of one step, so that all pixels are between two of these.
    x, y = (step_px * (np.arange(-1, side // step_px + 2) + 0.5) - 0.5 for side in image_size)
    source_px = camera.project(pinhole.unproject(np.stack(np.meshgrid(x, y), axis=-1)))
    # (-9, -9), which is outside the image, for rays that no pixel sees.
    source_px = np.where(np.isfinite(source_px), np.clip(source_px, -9.0, 1e5), -9.0)
    size = (step_px * len(x), step_px * len(y))
    enlarged = cv2.resize(source_px.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(enlarged[step_px : step_px + height, step_px : step_px + width])


def remap(image: ImageArray, source_px: NDArray[np.float32]) -> ImageArray:
    """Return the image with its pixels taken from other places (h, w, 2), interpolated."""
    interpolation, border = cv2.INTER_LINEAR, cv2.BORDER_CONSTANT
    return np.asarray(cv2.remap(image, source_px, None, interpolation, borderMode=border))


def captioned(image: ImageArray, *lines: str) -> ImageArray:
    """Return an image, (h, w, 3), with lines of text below it."""
    scale = max(1.0, image.shape[0] / _REFERENCE_HEIGHT_PX)
    line_px = round(_CAPTION_PX * scale)
    bar = np.full((line_px * len(lines) + line_px // 3, image.shape[1], 3), _BAR, dtype=np.uint8)
    for i, line in enumerate(lines):
        at = (0.4 * line_px, line_px * (i + 0.8))
        write_at(bar, line, at, INK, 0.5 * scale)
    return np.concatenate([image, bar])


def straightened_camera(
    camera: AnyCamera, image_size: tuple[int, int], *, max_fov_deg: float = 120.0
) -> DivisionCamera:
    """
    Return the pinhole camera with the same image size that covers a camera's field of view.

    Parameters
    ----------
    camera
        The camera with distortion.
    image_size
        Width and height of the images of both cameras, pixels.
    max_fov_deg
        Limit on the diagonal field of view, 1 to 170 degrees. A pinhole image cannot reach 180
        degrees, and close to that consists mostly of its stretched margin.

    Raises
    ------
    ValueError
        max_fov_deg is out of range.

    """
    if not 1.0 <= max_fov_deg <= 170.0:
        raise ValueError(f'max_fov_deg must be within 1 to 170, got {max_fov_deg}')
    width, height = image_size
    half = 0.5 * np.array([width - 1.0, height - 1.0])
    widest = math.tan(math.radians(0.5 * max_fov_deg)) * half / np.linalg.norm(half)
    rays = camera.unproject(half + half * _square_outline())
    with np.errstate(divide='ignore', invalid='ignore'):
        slopes = np.where(rays[:, 2:] > 0.0, np.abs(rays[:, :2] / rays[:, 2:]), np.inf)
    reach = np.minimum(slopes.max(axis=0), widest)
    center = (float(half[0]), float(half[1]))
    return DivisionCamera(float(np.max(half / reach)), center)


def _square_outline() -> Array:
    """Return points (N, 2) around the square from -1 to 1."""
    t = np.linspace(-1.0, 1.0, 33)
    one = np.ones_like(t)
    return np.concatenate(
        [np.stack(p, axis=1) for p in ((t, one), (t, -one), (one, t), (-one, t))]
    )


def _shown_candidates(detection: Detection) -> list[RejectedCandidate]:
    """Return the rejected candidates to draw: none that is a detected part of another board."""
    found = detection.image_points
    others = [
        candidate
        for candidate in detection.rejected
        if not len(found) or _distance_px(candidate.outline, found).max() > _SAME_PX
    ]
    without_code = [candidate for candidate in others if candidate.reason == NO_CODE]
    without_code.sort(key=lambda candidate: -np.ptp(candidate.outline, axis=0).sum())
    named = [candidate for candidate in others if candidate.reason != NO_CODE]
    return named + ([] if len(found) else without_code[:_MAX_WITHOUT_CODE])


def _distance_px(points: Array, others: Array) -> Array:
    """Return the distance (N,) of each point (N, 2) to the nearest of others (M, 2)."""
    nearest: Array = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)
    return nearest


def _outline(canvas: ImageArray, candidates: list[RejectedCandidate], scale: float) -> None:
    """Outline the candidates, those with a reason above the others."""
    for candidate in reversed(candidates):
        is_named = candidate.reason != NO_CODE
        is_large = np.ptp(candidate.outline, axis=0).max() > _MIN_WIDE_PX * scale
        points = np.rint(candidate.outline * 2**_SHIFT).astype(np.int32)
        colour = _REJECTED if is_named else _NO_MARKER
        thickness = max(1, round(1.5 * scale)) if is_named and is_large else 1
        cv2.polylines(canvas, [points], True, colour, thickness, cv2.LINE_AA, _SHIFT)


def _label(
    canvas: ImageArray, candidates: list[RejectedCandidate], scale: float, bars: list[Box]
) -> None:
    """Write reasons at some candidates of each kind, beside bars with text."""
    kinds: dict[str, list[RejectedCandidate]] = {}
    for candidate in candidates:
        _, _, after_id = candidate.reason.partition(': ')
        if candidate.reason != NO_CODE:
            kinds.setdefault(after_id or candidate.reason, []).append(candidate)
    for kind, alike in kinds.items():
        written, at_most = 0, _MAX_WRITTEN if kind != alike[0].reason else 1
        # Above the first ones where there is space. Below the candidate, or in it, a label seems
        # to belong to another one.
        for place in range(3):
            for candidate in alike[:_MAX_TRIED] if not written else ():
                at = _label_at(candidate.outline, place, scale)
                if written < at_most:
                    written += write_label(canvas, candidate.reason, at, _LETTERS, scale, bars)


def _label_at(outline: Array, place: int, scale: float) -> tuple[float, float]:
    """Return the middle of the lower edge of a label above, below or in an outline."""
    (x0, y0), (x1, y1) = outline.min(axis=0).tolist(), outline.max(axis=0).tolist()
    gap_px, line_px = 3.0 * scale, _CAPTION_PX * scale
    return 0.5 * (x0 + x1), (y0 - gap_px, y1 + gap_px + line_px, 0.5 * (y0 + y1 + line_px))[place]


def board_lines(
    board: Board, camera_from_board: Pose, camera: DivisionCamera
) -> dict[str, list[Array]]:
    """
    Project the outline of a board's sheet and its axes, distorted by the lens.

    Returns
    -------
    By the names 'outline', 'x', 'y' and 'z' the visible parts of the lines, each (N, 2) pixels.

    """
    width_m, height_m = board.sheet_size_m
    x, y = 0.5 * width_m, 0.5 * height_m
    corners = np.array([(-x, y, 0.0), (x, y, 0.0), (x, -y, 0.0), (-x, -y, 0.0), (-x, y, 0.0)])
    edges = [_segments(*ends)[:-1] for ends in pairwise(corners)]
    lines = {'outline': np.concatenate([*edges, corners[-1:]])}
    length_m = 0.35 * min(board.sheet_size_m)
    for name, axis in zip('xyz', np.eye(3), strict=True):
        lines[name] = _segments(np.zeros(3), length_m * axis)
    return {
        name: _visible_parts(camera.project(camera_from_board.transform(points)))
        for name, points in lines.items()
    }


def _segments(start: Array, end: Array) -> Array:
    """Divide a straight line into segments: (N, 3)."""
    points: Array = np.linspace(start, end, _SEGMENTS + 1)
    return points


def _visible_parts(pixels: Array) -> list[Array]:
    """Cut a projected line (N, 2) where it is not visible."""
    # Far outside the image, the integer coordinates of cv2 would overflow.
    visible = np.isfinite(pixels).all(axis=1) & (np.abs(pixels) < 1e5).all(axis=1)
    gaps = np.flatnonzero(np.diff(np.flatnonzero(visible)) > 1) + 1
    return [part for part in np.split(pixels[visible], gaps) if len(part)]


def _draw_board(canvas: ImageArray, solution: Solution, board: Board, scale: float) -> None:
    lines = board_lines(board, solution.camera_from_board, solution.camera)
    _draw_line(canvas, lines['outline'], _OUTLINE, 1.5 * scale)
    for name, colour in zip('xyz', _AXES, strict=True):
        _draw_line(canvas, lines[name], colour, 3.0 * scale)


def _draw_line(
    canvas: ImageArray, parts: list[Array], colour: tuple[int, int, int], thickness_px: float
) -> None:
    for part in parts:
        points = np.rint(part * 2**_SHIFT).astype(np.int32)
        thickness = max(1, round(thickness_px))
        cv2.polylines(canvas, [points], False, colour, thickness, cv2.LINE_AA, _SHIFT)


def _circle(canvas: ImageArray, point: Array, radius_px: float, thickness_px: float) -> None:
    x, y, radius = (round(float(v) * 2**_SHIFT) for v in (*point, radius_px))
    thickness = max(1, round(thickness_px))
    cv2.circle(canvas, (x, y), radius, _CORNER, thickness, cv2.LINE_AA, _SHIFT)
