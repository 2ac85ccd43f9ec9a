# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures, each with a name: from files, or from a recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from p4pfr_ros.cli.pictures import find_pictures
from p4pfr_ros.files.images import image_or_reason, ImageArray
from p4pfr_ros.files.pixel_formats import Unreadable
from p4pfr_ros.report.calibration_run import NamedPicture

_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PictureSource:
    """
    Pictures to go through once.

    Parameters
    ----------
    name
        Where they are from.
    pictures
        Each is read when its turn comes.
    count
        How many there are, where that is known.

    """

    name: str
    pictures: Iterable[NamedPicture]
    count: int | None


def from_files(paths: Sequence[Path], every: int = 1) -> PictureSource:
    """
    Read pictures, or directories of them: every n-th.

    Raises
    ------
    ConfigError
        A directory has none.

    """
    found = find_pictures(paths)[::every]
    pictures = (NamedPicture(str(path), image_or_reason(path)) for path in found)
    return PictureSource('pictures', pictures, len(found))


@contextmanager
def from_bag(path: Path, topic: str | None, every: int = 1) -> Iterator[PictureSource]:
    """
    Read the pictures of a recording's topic: every n-th, called by its stamp in seconds.

    Raises
    ------
    ConfigError
        See `ImageBag`; while pictures are taken, too.

    """
    from p4pfr_ros.files.bags import ImageBag

    with ImageBag(path, topic) as bag:
        count = -(-bag.count // every) if bag.count else None
        pictures = (
            NamedPicture(_seconds(image.stamp_ns), _picture_or_reason(image.image))
            for image in bag.images(every)
        )
        yield PictureSource(f'{path} {bag.topic}', pictures, count)


def _seconds(stamp_ns: int) -> str:
    """Write a stamp as ROS's tools do: seconds, and nine digits behind the point."""
    return f'{stamp_ns // _NS_PER_S}.{stamp_ns % _NS_PER_S:09d}'


def _picture_or_reason(picture: ImageArray | Unreadable) -> ImageArray | str:
    return picture.reason if isinstance(picture, Unreadable) else picture
