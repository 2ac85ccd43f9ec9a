# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes rosbag2 recordings with rosbags."""

import cv2
import numpy as np
import pytest

# rosdep has no key for rosbags: without it, the tests that need bags are skipped.
rosbag2 = pytest.importorskip('rosbags.rosbag2')
typesys = pytest.importorskip('rosbags.typesys')

STORAGES = {'sqlite3': rosbag2.StoragePlugin.SQLITE3, 'mcap': rosbag2.StoragePlugin.MCAP}
# A bag file is named after its directory, with this suffix.
ENDINGS = {'sqlite3': '.db3', 'mcap': '.mcap'}
FIRST_STAMP_S = 1_700_000_000
_TYPES = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def image_message(image, second, encoding=None):
    """Make a sensor_msgs/Image of (h, w) grey or (h, w, 3) BGR."""
    height, width = image.shape[:2]
    step = image[0].nbytes
    return _message(
        'sensor_msgs/msg/Image',
        header=_header(second),
        height=height,
        width=width,
        encoding=encoding or ('mono8' if image.ndim == 2 else 'bgr8'),
        is_bigendian=0,
        step=step,
        data=np.ascontiguousarray(image).reshape(-1),
    )


def compressed_message(image, second):
    """Make a sensor_msgs/CompressedImage: PNG."""
    data = cv2.imencode('.png', image)[1].reshape(-1)
    kind = 'sensor_msgs/msg/CompressedImage'
    return _message(kind, header=_header(second), format='png', data=data)


def text_message(text):
    """Make a std_msgs/String, which is not an image."""
    return _message('std_msgs/msg/String', data=text)


def write_bag(path, storage, topics, *, compression=None, types=None):
    """Write messages by topic at 1 Hz; types override the true ones. Return the path as text."""
    kinds = {topic: messages[0].__msgtype__ for topic, messages in topics.items()}
    data = {
        topic: [bytes(_TYPES.serialize_cdr(msg, kinds[topic])) for msg in messages]
        for topic, messages in topics.items()
    }
    return write_raw_bag(path, storage, data, kinds | (types or {}), compression=compression)


def write_raw_bag(path, storage, topics, types, *, compression=None):
    """Write serialised messages by topic at 1 Hz. Return the path as text."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=STORAGES[storage])
    if compression:
        mode = rosbag2.CompressionMode[compression]
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, types[topic], typestore=_TYPES)
            for second, data in enumerate(messages):
                writer.write(connection, (FIRST_STAMP_S + second) * 10**9 + 5, data)
    return str(path)


def _header(second):
    """Make a header stamped second + 25 ms after the first stamp; None: stamped zero."""
    stamp = {'sec': 0, 'nanosec': 0}
    if second is not None:
        stamp = {'sec': FIRST_STAMP_S + second, 'nanosec': 25_000_000}
    time = _message('builtin_interfaces/msg/Time', **stamp)
    return _message('std_msgs/msg/Header', stamp=time, frame_id='camera')


def _message(kind, **fields):
    return _TYPES.types[kind](**fields)
