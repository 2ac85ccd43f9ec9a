# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latched topics of the camera: who comes late hears of the one in use, or of none."""

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
    """Make the topics."""
    endpoints = Endpoints(peer.node)
    yield CameraOutputs(endpoints)
    endpoints.close()


def heard_late(peer):
    """Subscribe now; return the latest message of each topic, once it has come."""
    heard = {}
    made = [
        peer.node.create_subscription(
            CameraInfo, f'peer/{topic}', lambda msg, t=topic: heard.update({t: msg}), LATCHED
        )
        for topic in ('camera_info', 'camera_info_division')
    ]
    peer.until(lambda: len(heard) == 2)
    for subscription in made:
        peer.node.destroy_subscription(subscription)
    return heard['camera_info'], heard['camera_info_division']


def test_who_comes_late_hears_of_the_camera_in_use(peer, outputs):
    """Each is told once; one that was taken back is none any more: K = 0."""
    model = outputs.tell(scenes.header(1), FRAME, moving.CAMERA, again=False)
    assert outputs.tell(scenes.header(2), FRAME, moving.CAMERA, again=False) is None
    info, division = heard_late(peer)
    assert (info.header.stamp.sec, division.header.stamp.sec) == (1, 1)
    assert (info.distortion_model, tuple(info.d)) == (model.distortion_model, model.coefficients)
    assert division_camera_from_msg(division) == moving.CAMERA
    assert outputs.tell(scenes.header(2), FRAME, moving.CAMERA, again=True) is not None
    assert heard_late(peer)[0].header.stamp.sec == 2
    outputs.tell(scenes.header(3), FRAME, moving.ZOOMED, again=False)
    assert division_camera_from_msg(heard_late(peer)[1]) == moving.ZOOMED
    outputs.take_back(scenes.header(4).stamp)
    for msg in heard_late(peer):
        assert (msg.header.stamp.sec, msg.header.frame_id) == (4, info.header.frame_id)
        assert (msg.width, msg.height, sum(msg.k)) == (640, 480, 0.0)
    outputs.take_back(scenes.header(5).stamp)
    assert heard_late(peer)[0].header.stamp.sec == 4
    assert outputs.tell(scenes.header(6), FRAME, moving.ZOOMED, again=False) is not None


def test_a_model_of_another_program_is_told_as_it_is(peer, outputs):
    """There is no division camera then; and another size of the picture is news."""
    model = moving.CAMERA.to_camera_info_model(moving.SIZE)
    assert outputs.tell(scenes.header(1), FRAME, model, again=False) is model
    info, division = heard_late(peer)
    assert tuple(info.d) == model.coefficients
    assert sum(division.k) == 0.0
    assert outputs.tell(scenes.header(2), LARGER, moving.CAMERA, again=False) is not None
    assert outputs.tell(scenes.header(3), FRAME, moving.CAMERA, again=False) is not None
