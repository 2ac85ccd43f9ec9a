# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A node that passes on only poses that are certain enough to act on.

    python examples/reject_uncertain.py --ros-args \
        -r pose_in:=/pose_node/pose_with_covariance -r pose_out:=/dock/pose

Subscribes to pose_in (PoseWithCovarianceStamped), publishes pose_out (PoseStamped). A pose is
rejected if its position along any axis, or its orientation about any axis, is less certain than
the parameters ask for.
"""

import math

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class RejectUncertain(Node):
    """Compares the covariance of each pose with two limits."""

    def __init__(self) -> None:
        super().__init__('reject_uncertain')
        self.declare_parameter('max_position_sigma_m', 0.02)
        self.declare_parameter('max_angle_sigma_deg', 3.0)
        self.publisher = self.create_publisher(PoseStamped, 'pose_out', 10)
        self.create_subscription(PoseWithCovarianceStamped, 'pose_in', self.on_pose, 10)

    def on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Publish the pose, or log why not."""
        covariance = np.array(message.pose.covariance).reshape(6, 6)
        # The largest standard deviation in any direction, not only along x, y and z.
        position_m = _largest_sigma(covariance[:3, :3])
        angle_deg = math.degrees(_largest_sigma(covariance[3:, 3:]))
        # Written so that NaN is rejected, too.
        certain = (
            position_m <= self.get_parameter('max_position_sigma_m').value
            and angle_deg <= self.get_parameter('max_angle_sigma_deg').value
        )
        if certain:
            self.publisher.publish(PoseStamped(header=message.header, pose=message.pose.pose))
        else:
            self.get_logger().info(
                f'rejected: position ± {position_m:.3f} m, direction ± {angle_deg:.1f}°',
                throttle_duration_sec=1.0,
            )


def _largest_sigma(covariance: np.ndarray) -> float:
    if not np.isfinite(covariance).all():
        return math.inf
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance)[-1])))


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    try:
        rclpy.spin(RejectUncertain())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
