# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A client of a pose_node over DDS."""

from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped
import numpy as np
from p4pfr_ros.core.geometry import rotation_angle_rad
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2


def set_parameters(peer, values, node='pose_node', rejected=False):
    """Set parameters of a node together; return the reason if they are to be rejected."""
    changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    service = f'{node}/set_parameters_atomically'
    result = peer.call(SetParametersAtomically, service, parameters=changes).result
    assert result.successful != rejected, result.reason
    return result.reason


class PoseNodeClient:
    """Publishes points to one pose_node, by default in the mode per_frame, and receives poses."""

    def __init__(self, peer, parameters=(), **options):
        self.peer = peer
        self.poses = peer.subscribe(PoseStamped, 'pose_node/pose')
        self.covariances = peer.subscribe(
            PoseWithCovarianceStamped, 'pose_node/pose_with_covariance'
        )
        self.cameras = peer.subscribe(CameraInfo, 'pose_node/camera_info_division')
        self.corners = peer.publisher(PolygonStamped, 'corners')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.camera_info = peer.publisher(CameraInfo, 'camera_info')
        parameters = {'intrinsics.mode': 'per_frame'} | dict(parameters)
        self.node = peer.start('pose_node', parameters=parameters, **options)
        publishers = (self.corners, self.cloud, self.camera_info)
        peer.until(lambda: all(p.get_subscription_count() for p in publishers))

    def wait_ready(self, size=scenes.SIZE):
        """Publish until messages of all topics arrive."""
        received = (self.poses, self.covariances, self.cameras)
        for messages in received:
            messages.clear()

        def publish():
            if size is not None:
                self.camera_info.publish(scenes.camera_info(size))
            self.cloud.publish(scenes.board_cloud(1))

        self.peer.until(lambda: all(received), meanwhile=publish)
        self.estimate(scenes.board_cloud(2))
        return self

    def estimate(self, msg):
        """Publish a valid message; return pose, pose with covariance and camera of its stamp."""
        (self.corners if isinstance(msg, PolygonStamped) else self.cloud).publish(msg)
        received = (self.poses, self.covariances, self.cameras)
        stamp = msg.header.stamp
        self.peer.until(lambda: all(m and m[-1].header.stamp == stamp for m in received))
        return [messages[-1] for messages in received]

    def set(self, name, value):
        """Set a parameter of the node."""
        set_parameters(self.peer, {name: value})

    def lines(self):
        """Return the lines that the node has printed."""
        return self.node.output.splitlines()


def assert_close(pose, expected, atol_m=1e-3, atol_rad=2e-3):
    """Two poses agree, by default within 1 mm and 2 mrad: priors on the camera move them."""
    np.testing.assert_allclose(pose.translation, expected.translation, atol=atol_m)
    assert rotation_angle_rad(pose.rotation, expected.rotation) < atol_rad
