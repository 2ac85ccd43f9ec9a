# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A snapshot as the web page receives it: one binary message of JSON and two JPEG images.

The message begins with the lengths of its three parts, each four bytes, big-endian: JSON; the
image; the straightened image, which is empty as long as there is no camera.

This module stands alone: it is the other side of web/live.js.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import json
import math
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros import CalibrationOptions, CameraEstimate, DivisionCamera, Verdict
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.live.guidance import place_name
from p4pfr_ros.live.session import BoardInImage, Progress, Snapshot
from p4pfr_ros.report.drawing import board_lines, remap, straightening_map
from p4pfr_ros.report.maps import map_shape, uncertainty_map_px
from p4pfr_ros.report.number_format import lens_terms, plus_minus, shape_text

# Images are sent with at most this width or height, and this JPEG quality.
_LARGEST_PX, _QUALITY = 960, 75
# The straightened image is exact at every so many pixels.
_STEP_PX = 8
# Cells of the map along the longer side.
_MAP_CELLS = 32
# A drawn line has a point for so many segments of it.
_EVERY = 6
_USED = (Verdict.USED, Verdict.RESTARTED)


class MessageWriter:
    """Writes messages; images and maps are prepared once for all who watch."""

    def __init__(self) -> None:
        self._images: tuple[int, bytes, bytes] = (-1, b'', b'')
        self._maps: tuple[int, dict[str, Any]] = (-1, {})
        # Of the straightened image.
        self._map: tuple[int, NDArray[np.float32]] = (-1, np.empty((0, 0, 2), np.float32))

    def write(self, snapshot: Snapshot, options: CalibrationOptions, maps_version: int) -> bytes:
        """
        Return the message.

        options: the tolerances. Maps are left out if the receiver has those of this version.
        """
        tree = state_tree(snapshot, options)
        version = snapshot.progress.version
        if version != maps_version:
            if self._maps[0] != version:
                self._maps = version, maps_tree(snapshot.progress)
            tree['maps'] = self._maps[1]
        text = json.dumps(tree, allow_nan=False, separators=(',', ':')).encode()
        image, straightened = self._encoded(snapshot)
        lengths = struct.pack('>3I', len(text), len(image), len(straightened))
        return b''.join((lengths, text, image, straightened))

    def _encoded(self, snapshot: Snapshot) -> tuple[bytes, bytes]:
        """Return both images as JPEG."""
        if self._images[0] != snapshot.sequence:
            self._images = snapshot.sequence, *self._encode(snapshot)
        return self._images[1:]

    def _encode(self, snapshot: Snapshot) -> tuple[bytes, bytes]:
        if snapshot.image is None:
            return b'', b''
        small, share = _reduced(snapshot.image)
        progress = snapshot.progress
        if progress.estimate is None:
            return _jpeg(small), b''
        if self._map[0] != progress.version:
            camera = _reduced_camera(progress.estimate.camera, share)
            size = (small.shape[1], small.shape[0])
            self._map = progress.version, straightening_map(camera, size, step_px=_STEP_PX)
        return _jpeg(small), _jpeg(remap(small, self._map[1]))


def _reduced(image: ImageArray) -> tuple[ImageArray, float]:
    """Return an image of at most the size to be sent, and its share of the original size."""
    share = min(1.0, _LARGEST_PX / max(image.shape[:2]))
    if share == 1.0:
        return image, share
    size = tuple(max(1, round(share * side)) for side in image.shape[1::-1])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)), share


def _reduced_camera(camera: DivisionCamera, share: float) -> DivisionCamera:
    """Return the camera of reduced images; pixel centres are integers in both."""
    x, y = (share * (center + 0.5) - 0.5 for center in camera.center_px)
    rest = (*camera.terms, camera.aspect, camera.p1, camera.p2)
    return DivisionCamera(share * camera.focal_px, (x, y), *rest)


def _jpeg(image: ImageArray) -> bytes:
    _, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()


def state_tree(snapshot: Snapshot, options: CalibrationOptions) -> dict[str, Any]:
    """Return what changes with each image."""
    progress = snapshot.progress
    return {
        'sequence': snapshot.sequence,
        'mapsVersion': progress.version,
        'source': {
            'state': snapshot.source.value,
            'name': snapshot.source_name,
            'detail': snapshot.source_detail,
        },
        'paused': snapshot.is_paused,
        'image': {'name': snapshot.name, 'number': snapshot.number},
        'size': _size_of(snapshot),
        'rateHz': round(snapshot.rate_hz, 1),
        'state': progress.state.name.lower(),
        'stateText': progress.state.value,
        'views': len(progress.views),
        'bars': list(_bars(progress, options)),
        'missing': list(progress.missing),
        'boards': [_board_tree(each) for each in snapshot.boards],
        'advice': None if snapshot.advice is None else list(snapshot.advice),
        'rejected': [
            {
                'reason': each.reason,
                'board': each.board,
                'count': each.count,
                'name': each.name,
                'number': each.number,
            }
            for each in reversed(snapshot.rejected)
        ],
        'saved': snapshot.saved,
    }


def maps_tree(progress: Progress) -> dict[str, Any]:
    """Return what changes with the camera: target, maps, its parameters and its course."""
    tree: dict[str, Any] = {'target': _target_tree(progress), 'camera': [], 'boards': []}
    points = [view.image_points[view.inliers] for view in progress.views]
    tree['points'] = _pixels(np.concatenate(points)) if points else []
    tree['course'] = [
        [change.number, round(change.focal_px, 3), round(change.focal_sigma_px, 4)]
        for change in progress.changes
    ]
    estimate, size = progress.estimate, progress.image_size
    if estimate is None or size is None:
        return tree
    tree['camera'] = [[name, words] for name, words in _camera_words(estimate)]
    tree['boards'] = [[name, shape_text(shape)] for name, shape in estimate.board_shapes.items()]
    sigmas = uncertainty_map_px(estimate, size, map_shape(size[1], size[0], _MAP_CELLS))
    tree['uncertainty'] = {
        'rows': sigmas.shape[0],
        'columns': sigmas.shape[1],
        'px': [None if not math.isfinite(s) else round(s, 3) for s in sigmas.ravel().tolist()],
    }
    if estimate.coverage is not None:
        rows, columns = estimate.coverage.shape
        seen = estimate.coverage.astype(int).ravel().tolist()
        tree['coverage'] = {'rows': rows, 'columns': columns, 'seen': seen}
    return tree


def _bars(progress: Progress, options: CalibrationOptions) -> Iterator[dict[str, Any]]:
    """Yield how well the camera is known, each quantity against its tolerance."""
    yield _bar('views', 'Views', str(len(progress.views)), len(progress.views) / options.min_views)
    bars = list(_BARS)
    estimate, size = progress.estimate, progress.image_size
    if estimate is None or size is None:
        for key, label in bars:
            yield _bar(key, label, '', 0.0)
        return
    camera = estimate.camera
    x, y = map(plus_minus, camera.center_px, estimate.center_sigma_px)
    sigmas_px = (
        estimate.focal_sigma_px,
        float(estimate.center_sigma_px.max()),
        estimate.projection_sigma_px,
    )
    tolerances_px = (
        options.focal_tolerance * camera.focal_px,
        options.center_tolerance * math.hypot(*size),
        options.projection_tolerance_px,
    )
    values = (
        f'{plus_minus(camera.focal_px, estimate.focal_sigma_px)} px',
        f'{x}, {y} px',
        f'k {plus_minus(camera.k, estimate.k_sigma)}',
    )
    for (key, label), value, sigma_px, tolerance_px in zip(
        bars, values, sigmas_px, tolerances_px, strict=True
    ):
        share = tolerance_px / sigma_px if sigma_px > 0.0 else math.inf
        yield _bar(key, label, value, 0.0 if math.isnan(share) else share) | {
            'sigma': f'{sigma_px:.2g} px',
            'tolerance': f'{tolerance_px:.2g} px',
        }


_BARS = (('focal', 'Focal length'), ('center', 'Centre'), ('distortion', 'Distortion'))


def _bar(key: str, label: str, value: str, share: float) -> dict[str, Any]:
    is_reached = share >= 1.0
    return {
        'key': key,
        'label': label,
        'value': value,
        'share': round(min(share, 1.0), 3),
        'reached': is_reached,
    }


def _camera_words(estimate: CameraEstimate) -> Iterator[tuple[str, str]]:
    """Yield the terms of the lens that are in use beside k, and how well the views fit."""
    for name, value, sigma in lens_terms(estimate):
        if name != 'k':
            yield name, plus_minus(value, sigma)
    yield 'reprojection error', f'{estimate.rms_px:.3f} px rms'


def _board_tree(found: BoardInImage) -> dict[str, Any]:
    """Return what was found of a board: points, lines of its outline and axes, and words."""
    tree: dict[str, Any] = {
        'name': found.board.name,
        'points': _pixels(found.detection.image_points),
        'reason': found.detection.reason,
        'verdict': '',
        'used': found.verdict in _USED,
        'lines': {},
    }
    if found.verdict is not None:
        tree['verdict'] = found.verdict.value
    model = found.estimate.model if found.estimate is not None else None
    if model is not None:
        lines = board_lines(found.board, model.camera_from_board, model.camera)
        tree['lines'] = _lines_tree(lines)
    return tree


def _target_tree(progress: Progress) -> dict[str, Any] | None:
    target, size = progress.target, progress.image_size
    if target is None or size is None:
        return None
    pose = target.camera_from_board
    where = place_name(target.camera.project(pose.translation), size)
    return {
        'lines': _lines_tree(board_lines(target.board, pose, target.camera)),
        'words': f'{where}, tilted by {pose.tilt_deg:.0f}°',
    }


def _lines_tree(lines: dict[str, list[Array]]) -> dict[str, list[list[float]]]:
    return {
        name: [_pixels(np.vstack([part[:-1:_EVERY], part[-1:]])) for part in parts]
        for name, parts in lines.items()
    }


def _pixels(points: Array) -> list[float]:
    """Return points (N, 2) as a flat list: x, y, x, y and so on."""
    flat: list[float] = np.round(points, 1).ravel().tolist()
    return flat


def _size_of(snapshot: Snapshot) -> Sequence[int] | None:
    """Return width and height of the image that the pixels are of."""
    return None if snapshot.image is None else list(snapshot.image.shape[1::-1])
