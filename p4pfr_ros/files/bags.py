# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reads images from rosbag2 recordings (sqlite3 or mcap), without ROS.

The module stands alone because it needs the library rosbags, an optional dependency.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
import functools
from itertools import islice
import os
from pathlib import Path
from typing import Any

from p4pfr_ros.files.dependencies import EXTRAS, install_command
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.files.pixel_formats import (
    image_from_compressed_fields,
    image_from_fields,
    Unreadable,
)
from p4pfr_ros.files.yaml_fields import ConfigError

_READERS: dict[str, Callable[[Any], ImageArray | Unreadable]] = {
    'sensor_msgs/msg/Image': image_from_fields,
    'sensor_msgs/msg/CompressedImage': image_from_compressed_fields,
}
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class BagImage:
    """The image of a message, or why it cannot be decoded, and the stamp of the header."""

    stamp_ns: int
    image: ImageArray | Unreadable


@dataclass(frozen=True, slots=True, eq=False)
class ImageMessage:
    """A message as it was recorded: its type, the time of recording, and its serialised data."""

    kind: str
    recorded_ns: int
    data: bytes

    def decoded(self) -> BagImage:
        """Decode the image; this may happen in another process."""
        try:
            msg: Any = _types().deserialize_cdr(self.data, self.kind)
        except Exception:  # rosbags raises errors of many kinds for malformed data
            reason = f'image: expected a {self.kind}'
            return BagImage(self.recorded_ns, Unreadable('layout', reason))
        stamp = msg.header.stamp
        stamp_ns = stamp.sec * _NS_PER_S + stamp.nanosec
        return BagImage(stamp_ns or self.recorded_ns, _READERS[self.kind](msg))


class ImageBag:
    """
    The images of one topic, in recorded order. A context manager.

    Parameters
    ----------
    path
        The bag's directory, or a .db3 or .mcap file.
    topic
        A topic of type sensor_msgs/Image or CompressedImage. None: the bag's only image topic.

    Raises
    ------
    ConfigError
        The bag is missing or damaged, the topic is missing or has another type, or rosbags is
        not installed.

    """

    def __init__(self, path: str | os.PathLike[str], topic: str | None = None) -> None:
        self._path = Path(path)
        rosbag2, _ = _rosbags()
        with ExitStack() as stack, _damage_as_config_error(self._path):
            self._reader = stack.enter_context(rosbag2.Reader(self._path))
            self.topic = self._choose_topic(topic)
            self._connections = [c for c in self._reader.connections if c.topic == self.topic]
            self._stack = stack.pop_all()

    def __enter__(self) -> ImageBag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def count(self) -> int | None:
        """Number of messages on the topic; None if the bag does not record it."""
        return sum(connection.msgcount for connection in self._connections) or None

    def images(self, every: int = 1) -> Iterator[BagImage]:
        """
        Yield every n-th image.

        Raises
        ------
        ConfigError
            The bag is damaged at this position.

        """
        return (message.decoded() for message in self.messages(every))

    def messages(self, every: int = 1) -> Iterator[ImageMessage]:
        """
        Yield every n-th message of the topic.

        Raises
        ------
        ConfigError
            The bag is damaged at this position.

        """
        with _damage_as_config_error(self._path):
            messages = islice(self._reader.messages(self._connections), 0, None, every)
            for connection, stamp_ns, data in messages:
                yield ImageMessage(connection.msgtype, stamp_ns, bytes(data))

    def _choose_topic(self, topic: str | None) -> str:
        types: dict[str, str] = {name: t.msgtype for name, t in self._reader.topics.items()}
        image_topics = sorted(name for name, kind in types.items() if kind in _READERS)
        available = f'image topics: {", ".join(image_topics) or "none"}'
        if topic is None:
            if len(image_topics) != 1:
                raise ConfigError(f'{self._path}: expected --topic to choose one; {available}')
            return image_topics[0]
        if topic not in types:
            raise ConfigError(f'{self._path}: no topic {topic}; {available}')
        if topic not in image_topics:
            raise ConfigError(f'{self._path}: {topic} is of type {types[topic]}; {available}')
        return topic


@functools.cache
def _types() -> Any:
    """Image messages are the same in all ROS 2 distributions; bags may lack their definitions."""
    _, typesys = _rosbags()
    return typesys.get_typestore(typesys.Stores.LATEST)


def _rosbags() -> tuple[Any, Any]:
    """Import the library: slow, and an optional dependency."""
    try:
        from rosbags import rosbag2, typesys
    except ModuleNotFoundError as error:
        if not str(error.name).startswith('rosbags'):
            raise
        command = install_command(EXTRAS['rosbags'])
        raise ConfigError(f'reading bags needs rosbags: {command}') from None
    return rosbag2, typesys


@contextmanager
def _damage_as_config_error(path: Path) -> Iterator[None]:
    """Convert the errors of rosbags and its storages for a damaged bag to a ConfigError."""
    try:
        yield
    except ConfigError:
        raise
    except FileNotFoundError:
        missing = 'no such file' if not path.exists() else 'it has no metadata.yaml'
        raise ConfigError(f'{path}: expected a rosbag2: {missing}') from None
    except Exception as error:  # rosbags does not document which
        what = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
        raise ConfigError(
            f'{path}: expected an intact rosbag2 ({what}): ros2 bag reindex may repair it'
        ) from None
