# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a picture's file to what is to be said of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from p4pfr_ros import estimate_pose, EstimateOptions
from p4pfr_ros.boards import Board
from p4pfr_ros.cli.answers import Answer, NoAnswer
from p4pfr_ros.detection import detect
from p4pfr_ros.files.images import image_or_reason, write_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.drawing import annotate

_SUFFIXES = {'.bmp', '.jpeg', '.jpg', '.pbm', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp'}


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of each picture; center_px and draw_folder are optional."""

    board: Board
    options: EstimateOptions
    center_px: tuple[float, float] | None
    draw_folder: Path | None


def find_pictures(paths: Iterable[Path]) -> list[Path]:
    """
    Replace directories by the pictures in them, in the order of their names.

    Raises
    ------
    ConfigError
        A directory has none.

    """
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES)
        if not inside:
            raise ConfigError(f'{path}: expected a directory with pictures, found none')
        found += inside
    return found


def check_names(pictures: Iterable[Path]) -> None:
    """
    See that each picture's drawing gets a name of its own.

    Raises
    ------
    ConfigError
        Two pictures have the same.

    """
    seen: dict[str, Path] = {}
    for path in pictures:
        if path.stem in seen:
            raise ConfigError(f'--draw: {seen[path.stem]} and {path} would be drawn to one file')
        seen[path.stem] = path


def answer_from(path: Path, question: Question) -> Answer | NoAnswer:
    """
    Read, detect and estimate; draw if asked to.

    Raises
    ------
    ConfigError
        The drawing cannot be written.

    """
    picture = image_or_reason(path)
    if isinstance(picture, str):
        return NoAnswer(path, picture)
    detection = detect(picture, question.board)
    if detection.reason:
        return NoAnswer(path, detection.reason)
    height, width = picture.shape[:2]
    estimate = estimate_pose(
        detection.image_points,
        detection.board_points,
        image_size=(width, height),
        center_px=question.center_px,
        options=question.options,
    )
    if estimate.model is None:
        return NoAnswer(path, estimate.status.value)
    if question.draw_folder:
        drawn = annotate(picture, detection, estimate.model, question.board)
        write_image(question.draw_folder / f'{path.stem}_pose.png', drawn)
    return Answer(path, (width, height), estimate.model, estimate)
