# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags with messages serialised by ROS are read without ROS."""

from array import array

import cv2
import numpy as np
from p4pfr_ros.files.bags import ImageBag
from p4pfr_ros.ros.conversions import image_msg
import pytest
from rclpy.serialization import serialize_message
import recorded
import scenes
from sensor_msgs.msg import CompressedImage

IMAGE = np.random.default_rng(2).integers(0, 256, (9, 13, 3), dtype=np.uint8)


def raw():
    return image_msg(scenes.header(7), IMAGE)


def compressed():
    data = array('B', cv2.imencode('.png', IMAGE)[1].tobytes())
    return CompressedImage(header=scenes.header(7), format='bgr8; png compressed', data=data)


@pytest.mark.parametrize('storage', recorded.STORAGES)
@pytest.mark.parametrize(('kind', 'make'), [('Image', raw), ('CompressedImage', compressed)])
def test_images_serialised_by_rclpy_are_read(tmp_path, storage, kind, make):
    msg = make()
    path = tmp_path / 'bag'
    messages = {'/image': [serialize_message(msg)]}
    recorded.write_raw_bag(path, storage, messages, {'/image': f'sensor_msgs/msg/{kind}'})
    with ImageBag(path) as bag:
        [image] = bag.images()
    np.testing.assert_array_equal(image.image, IMAGE)
    stamp = msg.header.stamp
    assert image.stamp_ns == stamp.sec * 10**9 + stamp.nanosec
