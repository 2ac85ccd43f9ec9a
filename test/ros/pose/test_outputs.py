# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latched topics of the camera: late subscribers receive the camera in use, or K = 0."""

import moving
from p4pfr_ros.ros.conversions import division_camera_from_msg, ImageFrame
from p4pfr_ros.ros.pose.outputs import CameraOutputs
from p4pfr_ros.ros.runtime.endpoints import Endpoints
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
import scenes
from sensor_msgs.msg import CameraInfo

pytestmark = pytest.mark.dds

FRAME, LARGER = ImageFrame(moving.SIZE), ImageFrame((1280, 960))
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def outputs(peer):
    """Give the topics of the camera."""
    endpoints = Endpoints(peer.node)
    yield CameraOutputs(endpoints)
    endpoints.close()


def latched_messages(peer):
    """Subscribe now; return the latched message of each topic."""
    received = {}
    subscriptions = [
        peer.node.create_subscription(
            CameraInfo, f'peer/{topic}', lambda msg, t=topic: received.update({t: msg}), LATCHED
        )
        for topic in ('camera_info', 'camera_info_division')
    ]
    peer.until(lambda: len(received) == 2)
    for subscription in subscriptions:
        peer.node.destroy_subscription(subscription)
    return received['camera_info'], received['camera_info_division']


def test_late_subscribers_receive_the_camera_in_use(peer, outputs):
    """Each camera is published once; after it is retracted, K = 0."""
    model = outputs.publish(scenes.header(1), FRAME, moving.CAMERA, again=False)
    assert outputs.publish(scenes.header(2), FRAME, moving.CAMERA, again=False) is None
    info, division = latched_messages(peer)
    assert (info.header.stamp.sec, division.header.stamp.sec) == (1, 1)
    assert (info.distortion_model, tuple(info.d)) == (model.distortion_model, model.coefficients)
    assert division_camera_from_msg(division) == moving.CAMERA
    assert outputs.publish(scenes.header(2), FRAME, moving.CAMERA, again=True) is not None
    assert latched_messages(peer)[0].header.stamp.sec == 2
    outputs.publish(scenes.header(3), FRAME, moving.ZOOMED, again=False)
    assert division_camera_from_msg(latched_messages(peer)[1]) == moving.ZOOMED
    outputs.retract(scenes.header(4).stamp)
    for msg in latched_messages(peer):
        assert (msg.header.stamp.sec, msg.header.frame_id) == (4, info.header.frame_id)
        assert (msg.width, msg.height, sum(msg.k)) == (640, 480, 0.0)
    outputs.retract(scenes.header(5).stamp)
    assert latched_messages(peer)[0].header.stamp.sec == 4
    assert outputs.publish(scenes.header(6), FRAME, moving.ZOOMED, again=False) is not None


def test_a_model_of_another_program_is_published_unchanged(peer, outputs):
    """There is no division camera then; a change of the image size is published."""
    model = moving.CAMERA.to_camera_info_model(moving.SIZE)
    assert outputs.publish(scenes.header(1), FRAME, model, again=False) is model
    info, division = latched_messages(peer)
    assert tuple(info.d) == model.coefficients
    assert sum(division.k) == 0.0
    assert outputs.publish(scenes.header(2), LARGER, moving.CAMERA, again=False) is not None
    assert outputs.publish(scenes.header(3), FRAME, moving.CAMERA, again=False) is not None
