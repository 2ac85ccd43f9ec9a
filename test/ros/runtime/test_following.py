# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions that follow the QoS of their publishers, over DDS."""

from p4pfr_ros.ros.runtime.following import FollowingSubscription
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

pytestmark = pytest.mark.dds

RELIABLE = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


class Follower:
    """A following subscription of the peer's node, and a node that publishes."""

    def __init__(self, peer, **options):
        self.peer, self.received = peer, []
        self.sender = rclpy.create_node('sender', namespace=peer.namespace)
        self.subscription = FollowingSubscription(
            peer.node, String, 'words', self.received.append, depth=1, **options
        )

    @property
    def reliability(self):
        """The present policy."""
        return self.subscription.qos.reliability

    def publisher(self, qos):
        """Create a publisher."""
        return self.sender.create_publisher(String, 'words', qos)

    def until_received(self, publisher, word):
        """Publish until a message arrives."""
        self.peer.until(
            lambda: String(data=word) in self.received,
            meanwhile=lambda: publisher.publish(String(data=word)),
        )


@pytest.fixture
def follower(peer):
    """Yield a follower without options."""
    follower = Follower(peer)
    yield follower
    follower.sender.destroy_node()


def test_a_late_and_a_changed_publisher_are_followed(follower):
    """Reliable, best effort, and reliable again; messages of each arrive."""
    assert follower.reliability is ReliabilityPolicy.BEST_EFFORT
    for qos, word in ((RELIABLE, 'first'), (BEST_EFFORT, 'second'), (RELIABLE, 'third')):
        publisher = follower.publisher(qos)
        follower.peer.until(lambda qos=qos: follower.reliability is qos.reliability)
        follower.until_received(publisher, word)
        follower.sender.destroy_publisher(publisher)


def test_one_best_effort_publisher_among_others_is_received(follower):
    """As ros2 topic echo does."""
    reliable = follower.publisher(RELIABLE)
    follower.peer.until(lambda: follower.reliability is ReliabilityPolicy.RELIABLE)
    best_effort = follower.publisher(BEST_EFFORT)
    follower.until_received(best_effort, 'best effort')
    follower.until_received(reliable, 'reliable')
    assert follower.reliability is ReliabilityPolicy.BEST_EFFORT


def test_a_latched_message_is_received_by_a_late_subscription(peer):
    sender = rclpy.create_node('sender', namespace=peer.namespace)
    sender.create_publisher(String, 'words', LATCHED).publish(String(data='latched'))
    follower = Follower(peer)
    peer.until(lambda: String(data='latched') in follower.received)
    for node in (sender, follower.sender):
        node.destroy_node()


def test_a_forced_reliability_stays(peer):
    """Until the process ends, whatever is published; publishers that it keeps away are counted."""
    follower = Follower(peer, reliability='reliable')
    follower.publisher(BEST_EFFORT)
    follower.publisher(RELIABLE)
    peer.until(lambda: follower.subscription.publisher_count == 2)
    peer.spin_for(0.6)
    assert follower.reliability is ReliabilityPolicy.RELIABLE
    assert follower.subscription.incompatible_count == 1
    follower.sender.destroy_node()


def test_a_qos_override_takes_precedence(peer):
    override = f'qos_overrides.{peer.namespace}/words.subscription.reliability'
    node = rclpy.create_node(
        'overridden',
        namespace=peer.namespace,
        parameter_overrides=[Parameter(override, value='best_effort')],
    )
    subscription = FollowingSubscription(
        node, String, 'words', lambda _: None, depth=1, reliability='reliable'
    )
    peer.node.create_publisher(String, 'words', RELIABLE)
    for _ in range(10):
        rclpy.spin_once(node, timeout_sec=0.1)
    assert subscription.publisher_count == 1
    assert subscription.qos.reliability is ReliabilityPolicy.BEST_EFFORT
    node.destroy_node()
