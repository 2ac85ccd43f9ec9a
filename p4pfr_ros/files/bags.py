# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures out of recordings, rosbag2 in sqlite3 or mcap, by the library rosbags: without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from itertools import islice
import os
from pathlib import Path
from typing import Any

from p4pfr_ros.files.boards import ConfigError
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.files.pixel_formats import (
    image_from_compressed_fields,
    image_from_fields,
    Unreadable,
)

_READERS: dict[str, Callable[[Any], ImageArray | Unreadable]] = {
    'sensor_msgs/msg/Image': image_from_fields,
    'sensor_msgs/msg/CompressedImage': image_from_compressed_fields,
}
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class BagImage:
    """A message's picture, or why it holds none, and its header's stamp."""

    stamp_ns: int
    picture: ImageArray | Unreadable


class ImageBag:
    """
    The pictures of one topic, in the order of their recording; to be used in a ``with``.

    Parameters
    ----------
    path
        The recording's directory, or a .db3 or .mcap file.
    topic
        Of type sensor_msgs/Image or CompressedImage. None: the only one there is.

    Raises
    ------
    ConfigError
        No such recording, or one that is broken; no such topic, or one without pictures; the
        library is not installed.

    """

    def __init__(self, path: str | os.PathLike[str], topic: str | None = None) -> None:
        self._path = Path(path)
        rosbag2, typesys = _rosbags()
        # The definitions of pictures are the same in every ROS 2, and not in every recording.
        self._types = typesys.get_typestore(typesys.Stores.LATEST)
        with ExitStack() as stack, _in_one_line(self._path):
            self._reader = stack.enter_context(rosbag2.Reader(self._path))
            self.topic = self._choose(topic)
            self._connections = [c for c in self._reader.connections if c.topic == self.topic]
            self._stack = stack.pop_all()

    def __enter__(self) -> ImageBag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def count(self) -> int | None:
        """Return how many messages there are, if the recording says so."""
        return sum(connection.msgcount for connection in self._connections) or None

    def images(self, every: int = 1) -> Iterator[BagImage]:
        """
        Give the pictures, or every n-th of them.

        Raises
        ------
        ConfigError
            The recording is broken here.

        """
        with _in_one_line(self._path):
            messages = islice(self._reader.messages(self._connections), 0, None, every)
            for connection, stamp_ns, data in messages:
                yield self._image_from(connection.msgtype, stamp_ns, data)

    def _choose(self, topic: str | None) -> str:
        types: dict[str, str] = {name: t.msgtype for name, t in self._reader.topics.items()}
        pictures = sorted(name for name, kind in types.items() if kind in _READERS)
        there = f'topics with pictures: {", ".join(pictures) or "none"}'
        if topic is None:
            if len(pictures) != 1:
                raise ConfigError(f'{self._path}: expected --topic to choose one; {there}')
            return pictures[0]
        if topic not in types:
            raise ConfigError(f'{self._path}: no topic {topic}; {there}')
        if topic not in pictures:
            raise ConfigError(f'{self._path}: {topic} is of type {types[topic]}; {there}')
        return topic

    def _image_from(self, kind: str, recorded_ns: int, data: bytes) -> BagImage:
        try:
            msg: Any = self._types.deserialize_cdr(data, kind)
        except Exception:  # whatever the bytes, and what rosbags makes of them, may be
            return BagImage(recorded_ns, Unreadable('layout', f'image: expected a {kind}'))
        stamp = msg.header.stamp
        stamp_ns = stamp.sec * _NS_PER_S + stamp.nanosec
        return BagImage(stamp_ns or recorded_ns, _READERS[kind](msg))


def _rosbags() -> tuple[Any, Any]:
    """Import the library, which takes a while and not everybody has."""
    try:
        from rosbags import rosbag2, typesys
    except ModuleNotFoundError as error:
        if not str(error.name).startswith('rosbags'):
            raise
        raise ConfigError(
            "recordings are read by the library rosbags: pip install 'p4pfr_ros[bags]'"
        ) from None
    return rosbag2, typesys


@contextmanager
def _in_one_line(path: Path) -> Iterator[None]:
    """Turn what rosbags and the storages below it raise for a broken recording into our error."""
    try:
        yield
    except ConfigError:
        raise
    except FileNotFoundError:
        missing = 'no such file' if not path.exists() else 'no metadata.yaml in there'
        raise ConfigError(f'{path}: expected a rosbag2: {missing}') from None
    except Exception as error:  # they do not say which
        what = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
        raise ConfigError(
            f'{path}: expected a whole rosbag2 ({what}): ros2 bag reindex may repair it'
        ) from None
