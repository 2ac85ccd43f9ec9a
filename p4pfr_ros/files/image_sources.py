# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Where the commands take images from: image files, folders, videos, bags and standard input.

A source yields frames. A frame can be sent to another process, which reads or decodes it there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
import re

import cv2
from p4pfr_ros.files.bags import ImageBag, ImageMessage
from p4pfr_ros.files.images import (
    decode_image,
    Decoding,
    DEFAULT_DECODING,
    image_or_reason,
    ImageArray,
)
from p4pfr_ros.files.pixel_formats import Unreadable
from p4pfr_ros.files.videos import frame_count, read_stdin, read_video, VIDEO_SUFFIXES
from p4pfr_ros.files.yaml_fields import ConfigError

STDIN = '-'
_SUFFIXES = {'.bmp', '.jpeg', '.jpg', '.pbm', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp'}
_BAG_SUFFIXES = {'.db3', '.mcap'}
_NS_PER_S = 1_000_000_000
# Names of image files that are stamps: seconds, as in the data sets of TUM, or nanoseconds, as in
# those of ETH.
_SECONDS, _NANOSECONDS = re.compile(r'\d{1,10}\.\d{3,9}'), re.compile(r'\d{16,19}')


@dataclass(frozen=True, slots=True, eq=False)
class NamedImage:
    """
    An image, or the reason why it could not be read, and its name.

    stamp_ns: nanoseconds, if known. recording: the video or bag that it is a frame of; '' for a
    file.
    """

    name: str
    image: ImageArray | str
    stamp_ns: int | None = None
    recording: str = ''

    @property
    def file_stem(self) -> str:
        """Begin of the names of files about this image."""
        if not self.recording:
            return Path(self.name).stem
        recording, mark, number = self.name.rpartition('#')
        return (
            f'{Path(recording).stem.replace(STDIN, "stdin")}_{number:0>6}' if mark else self.name
        )


@dataclass(frozen=True, slots=True)
class ImageFile:
    """An image file, read when it is loaded."""

    path: Path

    def load(self, how: Decoding = DEFAULT_DECODING) -> NamedImage:
        """Read the image."""
        return NamedImage(str(self.path), image_or_reason(self.path, how), stamp_of(self.path))


@dataclass(frozen=True, slots=True, eq=False)
class StreamedImage:
    """A frame of a video or an image file in a stream: decoded, or its bytes."""

    recording: str
    number: int
    content: ImageArray | bytes
    stamp_ns: int | None = None

    def load(self, how: Decoding = DEFAULT_DECODING) -> NamedImage:
        """Decode the image if it is encoded."""
        content = self.content
        if isinstance(content, bytes):
            image = _image_or_reason(decode_image(content, how))
        else:
            image = cv2.cvtColor(content, cv2.COLOR_BGR2GRAY) if how.as_grey else content
        return NamedImage(f'{self.recording}#{self.number}', image, self.stamp_ns, self.recording)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedImage:
    """A message of a bag, an `ImageMessage`; its image is named by its stamp in seconds."""

    recording: str
    message: ImageMessage

    def load(self, how: Decoding = DEFAULT_DECODING) -> NamedImage:
        """Decode the message; colour stays, as decoding it to grey would save nothing."""
        decoded = self.message.decoded()
        image = _image_or_reason(decoded.image)
        stamp_ns = decoded.stamp_ns
        return NamedImage(seconds(stamp_ns), image, stamp_ns, self.recording)


Frame = ImageFile | StreamedImage | RecordedImage


@dataclass(frozen=True, slots=True, eq=False)
class ImageSource:
    """A sequence of frames, each read when it is needed, and their number if it is known."""

    frames: Iterable[Frame]
    count: int | None


@contextmanager
def open_source(
    paths: Sequence[Path], topic: str | None = None, every: int = 1, max_megapixels: float = 64.0
) -> Iterator[ImageSource]:
    """
    Open images, folders of images, videos, bags, or standard input ('-'), in the given order.

    Parameters
    ----------
    paths
        What to open. A bag is a folder with a metadata.yaml, or a .db3 or .mcap file.
    topic
        Image topic of the bags; None: each bag's only image topic.
    every
        Use every n-th image: of all image files, of each video, of each bag.
    max_megapixels
        Larger videos are rejected, as `Decoding` does images.

    Raises
    ------
    ConfigError
        A folder has no image, or a video or bag cannot be read; also while reading.

    """
    how = Decoding(max_megapixels=max_megapixels)
    with ExitStack() as stack:
        opened = [_opened(part, topic, every, how, stack) for part in _parts(paths)]
        counts = [part.count for part in opened]
        known = [count for count in counts if count is not None]
        total = sum(known) if len(known) == len(counts) else None
        yield ImageSource(chain.from_iterable(part.frames for part in opened), total)


def find_images(paths: Iterable[Path]) -> list[Path]:
    """
    Replace folders by the images in them, sorted by name; videos, bags and '-' stay.

    Raises
    ------
    ConfigError
        A folder contains no image.

    """
    images: list[Path] = []
    for path in paths:
        if not path.is_dir() or is_bag(path):
            images.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES)
        if not inside:
            raise ConfigError(f'{path}: expected a directory with images, got none')
        images += inside
    return images


def is_bag(path: Path) -> bool:
    """Return whether a path is, by its name or content, a bag."""
    return path.suffix in _BAG_SUFFIXES or (path / 'metadata.yaml').is_file()


def is_video(path: Path) -> bool:
    """Return whether a path is, by its name, a video."""
    return path.suffix.lower() in VIDEO_SUFFIXES


def stamp_of(path: Path) -> int | None:
    """Return the stamp that an image file is named by, nanoseconds; None for other names."""
    if _SECONDS.fullmatch(path.stem):
        seconds, _, fraction = path.stem.partition('.')
        return int(seconds + f'{fraction:0<9}')
    return int(path.stem) if _NANOSECONDS.fullmatch(path.stem) else None


def seconds(stamp_ns: int) -> str:
    """Format a stamp like ROS tools: seconds with nine decimals."""
    return f'{stamp_ns // _NS_PER_S}.{stamp_ns % _NS_PER_S:09d}'


def _parts(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Yield neighbouring image files together, and each stream alone."""
    files: list[Path] = []
    for path in find_images(paths):
        if str(path) != STDIN and not is_bag(path) and not is_video(path):
            files.append(path)
            continue
        if files:
            yield files
        yield [path]
        files = []
    if files:
        yield files


def _opened(
    part: list[Path], topic: str | None, every: int, how: Decoding, stack: ExitStack
) -> ImageSource:
    first = part[0]
    if str(first) == STDIN:
        return ImageSource(_from_stdin(how, every), None)
    if is_bag(first):
        bag = stack.enter_context(ImageBag(first, topic))
        name = f'{first} {bag.topic}'
        frames = (RecordedImage(name, message) for message in bag.messages(every))
        return ImageSource(frames, _share(bag.count, every))
    if is_video(first):
        return ImageSource(_from_video(first, how, every), _share(frame_count(first), every))
    files = part[::every]
    return ImageSource(map(ImageFile, files), len(files))


def _share(count: int | None, every: int) -> int | None:
    return None if count is None else -(-count // every)


def _from_video(path: Path, how: Decoding, every: int) -> Iterator[StreamedImage]:
    for frame in read_video(path, how, every):
        yield StreamedImage(str(path), frame.number, frame.image, frame.time_ns)


def _from_stdin(how: Decoding, every: int) -> Iterator[StreamedImage]:
    for index, item in enumerate(read_stdin(how, every)):
        if isinstance(item, bytes):
            yield StreamedImage(STDIN, index * every, item)
        else:
            yield StreamedImage(STDIN, item.number, item.image, item.time_ns)


def _image_or_reason(image: ImageArray | Unreadable) -> ImageArray | str:
    return image.reason if isinstance(image, Unreadable) else image
