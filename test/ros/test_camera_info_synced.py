# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""pose_node over DDS: a camera_info for each image, and one that was latched before the start."""

from collections import Counter

from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2, RegionOfInterest

pytestmark = pytest.mark.dds

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
IMAGES = range(100, 120)


class Images:
    """A camera driver and a detector, and a subscriber to the camera_info of each image."""

    def __init__(self, peer, **parameters):
        self.peer = peer
        self.synced = peer.subscribe(CameraInfo, 'pose_node/camera_info_synced')
        self.poses = peer.subscribe(PoseStamped, 'pose_node/pose')
        self.camera_info = peer.publisher(CameraInfo, 'camera_info')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        peer.start('pose_node', parameters=parameters)
        publishers = (self.camera_info, self.cloud)
        peer.until(lambda: all(p.get_subscription_count() for p in publishers))
        peer.until(lambda: peer.node.count_publishers(f'{peer.namespace}/pose_node/pose'))

    def driver(self, second, size=scenes.SIZE):
        """Publish the camera_info of an image, as an uncalibrated camera does."""
        msg = scenes.camera_info(size)
        msg.header = scenes.header(second)
        self.camera_info.publish(msg)
        return msg

    def until_synced(self, second, meanwhile=None):
        """Spin until the camera_info of an image is received; return it."""
        self.peer.until(lambda: second in self.counts(), meanwhile=meanwhile)
        return next(msg for msg in self.synced if msg.header.stamp.sec == second)

    def counts(self):
        """Count the received messages by the second of their stamps."""
        return Counter(msg.header.stamp.sec for msg in self.synced)


def test_each_image_has_one_camera_info_with_its_stamp(peer):
    """As image_proc's exact synchroniser needs it, whichever message of an image comes first."""
    images = Images(peer)
    cameras = peer.subscribe(CameraInfo, 'pose_node/camera_info')
    # No camera is known before the first view.
    images.driver(1)
    peer.until(
        lambda: cameras and images.poses,
        meanwhile=lambda: (images.driver(2), images.cloud.publish(scenes.board_cloud(2))),
    )
    images.until_synced(3, meanwhile=lambda: images.driver(3))
    for second in IMAGES:
        messages = [lambda s=second: images.driver(s)]
        # Two boards in the same image.
        messages += [lambda s=second: images.cloud.publish(scenes.board_cloud(s))] * 2
        for publish in messages[:: 1 if second % 2 else -1]:
            publish()
        images.until_synced(second)
    peer.spin_for(0.3)
    assert {second: n for second, n in images.counts().items() if second in IMAGES} == (
        dict.fromkeys(IMAGES, 1)
    )
    assert 1 not in images.counts()
    last, latched = images.synced[-1], cameras[-1]
    assert last.header == scenes.header(IMAGES[-1])
    for name in ('width', 'height', 'distortion_model', 'd', 'k', 'r', 'p'):
        np.testing.assert_array_equal(getattr(last, name), getattr(latched, name), name)


def test_a_known_camera_needs_no_board(peer):
    """The window and binning of each image are those of its own camera_info."""
    images = Images(peer, **{'intrinsics.mode': 'fixed', 'intrinsics.focal_px': 520.0})
    images.until_synced(1, meanwhile=lambda: images.driver(1))
    msg = scenes.camera_info()
    msg.header, msg.binning_x, msg.binning_y = scenes.header(2), 2, 2
    msg.roi = RegionOfInterest(x_offset=64, y_offset=32, width=320, height=240)
    images.camera_info.publish(msg)
    synced = images.until_synced(2)
    assert (synced.binning_x, synced.roi.x_offset, synced.k[0]) == (2, 64, 520.0)
    # Points without a camera_info of their own.
    images.cloud.publish(scenes.board_cloud(3))
    assert images.until_synced(3).header == scenes.header(3)


def test_a_camera_of_another_image_size_is_not_published(peer):
    """Neither for the larger images, nor after them with the larger size."""
    images = Images(peer)
    peer.until(
        lambda: images.poses,
        meanwhile=lambda: (images.driver(1), images.cloud.publish(scenes.board_cloud(1))),
    )
    images.until_synced(2, meanwhile=lambda: images.driver(2))
    for second in range(3, 8):
        images.driver(second, (1280, 960))
    images.driver(8)
    assert images.until_synced(8).width == scenes.SIZE[0]
    assert not set(images.counts()) & set(range(3, 8))


def test_a_camera_info_latched_before_the_start_is_received(peer):
    """A driver that publishes it once; the poses need its image size."""
    driver = peer.node.create_publisher(CameraInfo, 'camera_info', LATCHED)
    driver.publish(scenes.camera_info())
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
    cloud = peer.publisher(PointCloud2, 'correspondences')
    node = peer.start('pose_node')
    peer.until(lambda: poses, meanwhile=lambda: cloud.publish(scenes.board_cloud(1)))
    assert 'camera_info: subscribed again: reliable, transient local' in node.output
