# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A conversation with a pose_node over DDS."""

from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped
import numpy as np
from p4pfr_ros.core.geometry import rotation_angle_rad
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
import scenes
from sensor_msgs.msg import CameraInfo, PointCloud2


def set_parameters(peer, values, node='pose_node', refused=False):
    """Change parameters of a node together; return why that was refused."""
    client = AsyncParameterClient(peer.node, node)
    peer.until(client.services_are_ready)
    changes = [Parameter(name, value=value) for name, value in values.items()]
    future = client.set_parameters_atomically(changes)
    peer.until(future.done)
    result = future.result().result
    assert result.successful != refused, result.reason
    return result.reason


class Talk:
    """A conversation with one pose_node, which answers each view by itself unless told to."""

    def __init__(self, peer, parameters=(), **options):
        self.peer = peer
        self.poses = peer.listen(PoseStamped, 'pose_node/pose')
        self.covariances = peer.listen(PoseWithCovarianceStamped, 'pose_node/pose_with_covariance')
        self.cameras = peer.listen(CameraInfo, 'pose_node/camera_info_division')
        self.corners = peer.publisher(PolygonStamped, 'corners')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.camera_info = peer.publisher(CameraInfo, 'camera_info')
        parameters = {'intrinsics.mode': 'per_frame'} | dict(parameters)
        self.node = peer.start('pose_node', parameters=parameters, **options)
        publishers = (self.corners, self.cloud, self.camera_info)
        peer.until(lambda: all(p.get_subscription_count() for p in publishers))

    def open(self, size=scenes.SIZE):
        """Talk until every answer is heard."""
        heard = (self.poses, self.covariances, self.cameras)
        for h in heard:
            h.clear()

        def say():
            if size is not None:
                self.camera_info.publish(scenes.camera_info(size))
            self.cloud.publish(scenes.board_cloud(1))

        self.peer.until(lambda: all(heard), meanwhile=say)
        self.ask(scenes.board_cloud(2))
        return self

    def ask(self, msg):
        """Publish a good message; return the answers with its stamp: pose, covariance, camera."""
        (self.corners if isinstance(msg, PolygonStamped) else self.cloud).publish(msg)
        heard = (self.poses, self.covariances, self.cameras)
        self.peer.until(lambda: all(h and h[-1].header.stamp == msg.header.stamp for h in heard))
        return [h[-1] for h in heard]

    def set(self, name, value):
        """Change a parameter of the node."""
        set_parameters(self.peer, {name: value})

    def lines(self):
        """Return what the node has printed."""
        return self.node.output.splitlines()


def assert_close(pose, expected, atol_m=1e-4, atol_rad=1e-3):
    """Two poses are the same, to a tenth of a millimetre and a milliradian."""
    np.testing.assert_allclose(pose.translation, expected.translation, atol=atol_m)
    assert rotation_angle_rad(pose.rotation, expected.rotation) < atol_rad
