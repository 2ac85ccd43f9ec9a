# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Time and accuracy of ``detect`` beside OpenCV's own detectors, with and without a board.

    python -m benchmarks.detection [--page docs/benchmark_detection.md] [--json FILE]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
import json
from pathlib import Path
import time
from typing import Any, NamedTuple

import cv2
import numpy as np
from p4pfr_ros.boards import AprilGrid, Board, Charuco, Chessboard, CircleGrid, MarkerGrid
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from rich.console import Console

from .detection_scenes import BOARDS, contents, Grey, hard_contents, SIZES, View, views
from .tables import Measured, page_of, Row, table_of

_REPEATS = 5
_LONG_S = 0.5  # an image that takes longer is measured once

Points = tuple[Any, Array]  # ids and pixels


class Timed(NamedTuple):
    """CPU milliseconds of one detector on each image."""

    ours_ms: Array
    peer_ms: Array

    @property
    def row(self) -> Row:
        """Return the medians and the median ratio."""
        ratio = np.median(self.ours_ms / self.peer_ms)
        return (
            f'{np.median(self.ours_ms):.2f}',
            f'{np.median(self.peer_ms):.2f}',
            f'{ratio:.2f}',
        )


def main(arguments: list[str] | None = None) -> int:
    """Measure and print both tables, and write the page."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection', description=__doc__.split('\n\n')[0].strip()
    )
    parser.add_argument('--page', type=Path, metavar='FILE', help='write a Markdown page')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the rows as JSON')
    parser.add_argument('--largest', type=int, default=len(SIZES), help='number of image sizes')
    parser.add_argument('--only', choices=['boards', 'contents'], help='measure one table only')
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    tables: list[Measured] = []
    if options.only != 'contents':
        tables.append(_with_board(SIZES[: options.largest]))
    if options.only != 'boards':
        tables += [_without_board(SIZES[: options.largest]), _markers_absent(SIZES[0])]
    console = Console(width=150)
    for title, header, rows in tables:
        console.print(table_of(title, header, rows))
    if options.json:
        options.json.write_text(json.dumps({title: rows for title, _, rows in tables}, indent=1))
    if options.page:
        command = 'python -m benchmarks.detection --page docs/benchmark_detection.md'
        options.page.write_text(page_of('Detection', command, tables, _NOTES))
    return 0


_NOTES = (
    'CPU milliseconds of one thread; ours and the peer take turns on each image, so that their '
    "ratio holds on a noisy machine. The peers are OpenCV's: `findChessboardCorners` with "
    '`cornerSubPix` (11x11), `detectMarkers` with CORNER_REFINE_SUBPIX, for grids '
    '`detectMarkers` alone, `CharucoDetector`, and `findCirclesGrid`. Errors are distances from '
    'the true corners of eight rendered views (blur 0.7 px, noise 2 grey levels).',
)


def _with_board(sizes: tuple[tuple[int, int], ...]) -> Measured:
    header = ('board', 'image', 'ms', 'OpenCV ms', 'ratio', 'found', 'OpenCV found', 'median px',
              '99 % px', 'OpenCV median px', 'OpenCV 99 % px')  # fmt: skip
    rows = []
    for name, board in BOARDS.items():
        for size in sizes:
            seen = views(board, size)
            peer = _peer(board)
            ours = partial(_ours, board)
            timed = _timed(ours, peer, [view.image for view in seen])
            ours_px, ours_found = _errors(ours, seen)
            peer_px, peer_found = _errors(peer, seen)
            errors = [f'{np.quantile(e, q):.4f}' for e in (ours_px, peer_px) for q in (0.5, 0.99)]
            size_name = f'{size[0]}x{size[1]}'
            rows.append((name, size_name, *timed.row, ours_found, peer_found, *errors))
    return 'Boards', header, rows


def _without_board(sizes: tuple[tuple[int, int], ...]) -> Measured:
    header = ('image', 'size', 'ms', 'OpenCV ms', 'ratio', 'slowest ms', 'found')
    rows = []
    board = BOARDS['chessboard 9x6']
    for size in sizes:
        images = contents(size) | (hard_contents(size) if size == sizes[0] else {})
        for name, each in images.items():
            if each:
                timed = _timed(partial(_ours, board), _find_chessboard_only, each)
                found = sum(not detect(image, board).reason for image in each)
                slowest = f'{timed.ours_ms.max():.1f}'
                rows.append((name, f'{size[0]}x{size[1]}', *timed.row, slowest, str(found)))
    return 'No chessboard', header, rows


def _markers_absent(size: tuple[int, int]) -> Measured:
    header = ('image', 'board', 'ms', 'OpenCV ms', 'ratio', 'slowest ms')
    rows = []
    for board_name in ('AprilTag', 'ChArUco 5x7'):
        board = BOARDS[board_name]
        for name, images in (contents(size) | hard_contents(size)).items():
            if images:
                timed = _timed(partial(_ours, board), _peer(board), images)
                rows.append((name, board_name, *timed.row, f'{timed.ours_ms.max():.1f}'))
    return f'No markers, {size[0]}x{size[1]}', header, rows


def _timed(
    ours: Callable[[Grey], object], peer: Callable[[Grey], object], images: list[Grey]
) -> Timed:
    ours(images[0])  # compile
    ms = np.array([[_interleaved_ms(ours, peer, image)] for image in images]).reshape(-1, 2)
    return Timed(ms[:, 0], ms[:, 1])


def _interleaved_ms(
    ours: Callable[[Grey], object], peer: Callable[[Grey], object], image: Grey
) -> tuple[float, float]:
    times_s: tuple[list[float], list[float]] = ([], [])
    for _ in range(_REPEATS):
        for work, measured in zip((ours, peer), times_s, strict=True):
            if not measured or measured[0] < _LONG_S:
                start = time.process_time()
                work(image)
                measured.append(time.process_time() - start)
    return 1e3 * float(np.median(times_s[0])), 1e3 * float(np.median(times_s[1]))


def _errors(find: Callable[[Grey], Points], seen: list[View]) -> tuple[Array, str]:
    """Return the errors (M,) px of the points found in all views, and 'found/all'."""
    errors, count = [], 0
    for image, truth in seen:
        ids, points = find(image)
        count += len(truth)
        # OpenCV begins at either end of a chessboard.
        both = [np.linalg.norm(points - truth[i], axis=1) for i in (ids, ids[::-1])]
        errors.append(min(both, key=lambda error: float(error.sum())))
    stacked = np.concatenate(errors)
    return (stacked if len(stacked) else np.array([np.nan])), f'{len(stacked)}/{count}'


def _ours(board: Board, image: Grey) -> Points:
    detection = detect(image, board)
    return detection.ids, detection.image_points


def _peer(board: Board) -> Callable[[Grey], Points]:
    """Return OpenCV's detector of a board: ids and pixels in the board's own numbering."""
    if isinstance(board, Chessboard):
        return lambda image: _find_chessboard(image, board)
    if isinstance(board, CircleGrid):
        return lambda image: _find_circles(image, board)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    if isinstance(board, Charuco):
        sides = board.square_m, board.marker_m
        opencv_board = cv2.aruco.CharucoBoard((board.columns, board.rows), *sides, dictionary)
        charuco = cv2.aruco.CharucoDetector(opencv_board)
        return lambda image: _find_charuco(charuco, image)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = board.border_bits
    if not isinstance(board, (MarkerGrid, AprilGrid)):
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    turn = -2 if 'APRILTAG' in board.dictionary else 0
    index = {marker_id: n for n, marker_id in enumerate(board.marker_ids)}
    return lambda image: _find_markers(detector, image, index, turn)


def _find_chessboard_only(image: Grey) -> object:
    return cv2.findChessboardCorners(image, (9, 6))


def _find_chessboard(image: Grey, board: Chessboard) -> Points:
    found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows))
    if not found:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)
    points = cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), criteria).reshape(-1, 2)
    return np.arange(len(points)), points


def _find_circles(image: Grey, board: CircleGrid) -> Points:
    layout = cv2.CALIB_CB_ASYMMETRIC_GRID if board.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for flags in (layout, layout | cv2.CALIB_CB_CLUSTERING):  # as camera_calibration does
        found, centres = cv2.findCirclesGrid(image, (board.columns, board.rows), flags=flags)
        if found:
            return np.arange(len(centres)), centres.reshape(-1, 2)
    return np.empty(0, dtype=np.int64), np.empty((0, 2))


def _find_charuco(charuco: Any, image: Grey) -> Points:
    corners, ids, _, _ = charuco.detectBoard(image)
    if ids is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    return ids.ravel(), np.asarray(corners).reshape(-1, 2)


def _find_markers(detector: Any, image: Grey, index: dict[int, int], turn: int) -> Points:
    corners, ids, _ = detector.detectMarkers(image)
    if ids is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    pairs = [
        (index[i], c) for i, c in zip(ids.ravel().tolist(), corners, strict=True) if i in index
    ]
    found = [np.roll(corner.reshape(4, 2), turn, axis=0) for _, corner in pairs]
    ids_found = np.array([4 * n + i for n, _ in pairs for i in range(4)], dtype=np.int64)
    return ids_found, np.array(found).reshape(-1, 2)


if __name__ == '__main__':
    raise SystemExit(main())
