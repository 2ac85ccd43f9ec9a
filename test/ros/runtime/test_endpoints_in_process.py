# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""QoS overrides, service names, timers and subscribers of endpoints; in process."""

from pathlib import Path
import time

from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.camera_simulator import CameraSimulator
from p4pfr_ros.ros.detector_node import DetectorNode
from p4pfr_ros.ros.pose.calibration_keeper import CameraInfoSetter
from p4pfr_ros.ros.pose_node import PoseNode
from p4pfr_ros.ros.runtime.endpoints import Endpoints, is_awaited
from p4pfr_ros.ros.runtime.overrides import warn_of_unknown_overrides
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import Header

TIMEOUT_S = 100.0
BOARDS = Path(__file__).resolve().parents[3] / 'config/boards'
MAKERS = {
    'subscription': lambda endpoints: endpoints.subscribe(Header, 'topic', lambda _: None),
    'publisher': lambda endpoints: endpoints.advertise(Header, 'topic', latched=True),
}
over_kinds = pytest.mark.parametrize('kind', MAKERS)


@pytest.fixture
def make(dds, monkeypatch):
    """Make nodes with parameters and a recorded log."""
    nodes = []

    def make(parameters, **options):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        options = {'namespace': '/ours', 'parameter_overrides': overrides} | options
        node = rclpy.create_node('with_endpoints', **options)
        nodes.append(node)
        logged = node.logged = []
        monkeypatch.setattr(
            type(node.get_logger()), 'log', lambda _, text, severity, **__: logged.append(text)
        )
        return node

    yield make
    for node in nodes:
        node.destroy_node()


def _qos(node, kind):
    """Return the QoS of an endpoint of the topic in the graph."""
    infos = {
        'subscription': node.get_subscriptions_info_by_topic,
        'publisher': node.get_publishers_info_by_topic,
    }
    return next(
        info.qos_profile
        for info in infos[kind]('/ours/topic')
        if info.node_name == node.get_name()
    )


@over_kinds
def test_an_override_is_applied(make, kind):
    """Each policy of each kind of endpoint, also in capitals."""
    prefix = f'qos_overrides./ours/topic.{kind}'
    parameters = {
        f'{prefix}.reliability': 'BEST_EFFORT' if kind == 'publisher' else 'RELIABLE',
        f'{prefix}.durability': 'volatile' if kind == 'publisher' else 'transient_local',
        f'{prefix}.history': 'keep_all',
        f'{prefix}.depth': 2**31 - 1,
    }
    node = make(parameters)
    MAKERS[kind](Endpoints(node))
    qos = _qos(node, kind)
    if kind == 'publisher':
        assert qos.reliability == ReliabilityPolicy.BEST_EFFORT
        assert qos.durability == DurabilityPolicy.VOLATILE
    else:
        assert qos.reliability == ReliabilityPolicy.RELIABLE
        assert qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    given = node.get_parameters_by_prefix(prefix)
    assert {f'{prefix}.{name}': p.value for name, p in given.items()} == parameters
    assert not node.logged


@over_kinds
@pytest.mark.parametrize(
    ('policy', 'value', 'expected'),
    [
        ('reliability', 'foo', 'one of system_default, reliable, best_effort'),
        ('reliability', '', 'one of system_default, reliable, best_effort'),
        ('reliability', 'unknown', 'one of system_default, reliable, best_effort'),
        ('durability', 1, 'one of system_default, transient_local, volatile'),
        ('history', 'keep_some', 'one of system_default, keep_last, keep_all'),
        ('depth', -1, 'an integer from 0 to 2147483647'),
        ('depth', 2**31, 'an integer from 0 to 2147483647'),
        ('depth', 'ten', 'an integer from 0 to 2147483647'),
        ('depth', 1.0, 'an integer from 0 to 2147483647'),
        ('depth', True, 'an integer from 0 to 2147483647'),
    ],
)
def test_an_invalid_override_is_an_error_of_one_line(make, kind, policy, value, expected):
    """It names node, parameter, valid values and the given one."""
    name = f'qos_overrides./ours/topic.{kind}.{policy}'
    with pytest.raises(ConfigError) as error:
        MAKERS[kind](Endpoints(make({name: value})))
    message = str(error.value)
    assert message.startswith(f'with_endpoints: {name}: expected {expected}')
    assert message.endswith(f', got {value!r}')
    assert '\n' not in message


def test_an_override_has_the_topic_name_after_remapping(make):
    """As in ROS."""
    node = make(
        {'qos_overrides./elsewhere.publisher.depth': -1},
        cli_args=['--ros-args', '-r', 'topic:=/elsewhere'],
    )
    with pytest.raises(ConfigError, match='elsewhere'):
        MAKERS['publisher'](Endpoints(node))


def test_an_unused_override_is_warned_of(make):
    """With a suggestion; overrides that ROS itself uses are not."""
    used = 'qos_overrides./ours/topic.subscription.depth'
    misspelt = used.replace('topic', 'topics')
    clock = 'qos_overrides./clock.subscription.depth'
    node = make({misspelt: 3, used: 3, clock: 3, 'qos_overrides./x.publisher.lifespan': 1})
    MAKERS['subscription'](Endpoints(node))
    warn_of_unknown_overrides(node)
    assert node.logged == [
        f'unknown parameter {misspelt} is ignored (did you mean {used}?)',
        'unknown parameter qos_overrides./x.publisher.lifespan is ignored',
    ]


@pytest.mark.parametrize('node_type', [PoseNode, DetectorNode, CameraSimulator])
def test_the_qos_of_every_topic_can_be_overridden(dds, node_type):
    """History, depth, reliability and durability; ROS itself has /rosout and /parameter_events."""
    board = Parameter('board_file', value=str(BOARDS / 'marker_36h11_150mm.yaml'))
    node = node_type(parameter_overrides=[board])
    given = {name.rpartition('.')[0] for name in node.get_parameters_by_prefix('qos_overrides')}
    kinds = {'subscription': node.subscriptions, 'publisher': node.publishers}
    expected = {f'{end.topic_name}.{kind}' for kind, ends in kinds.items() for end in ends} - {
        '/rosout.publisher',
        '/parameter_events.publisher',
    }
    node.destroy_node()
    assert given == expected


@pytest.mark.parametrize('service', ['bad name!', 'a/', '1st', 'a//b', '{camera}/set'])
def test_an_invalid_service_name_is_an_error_of_one_line(make, service):
    """It names node, parameter, the given name and what is wrong with it."""
    node = make({})
    with pytest.raises(ConfigError) as error:
        CameraInfoSetter(node.get_logger(), Endpoints(node), service)
    message = str(error.value)
    start = 'with_endpoints: set_camera_info_service: expected the name of a service, got '
    assert message.startswith(f'{start}{service!r}: topic name ')
    assert '\n' not in message


def test_timers_run_while_simulated_time_stands_still(make):
    """There is no /clock."""
    node = make({'use_sim_time': True})
    times = []
    Endpoints(node).every(0.005, lambda: times.append(node.get_clock().now().nanoseconds))
    ends_s = time.monotonic() + TIMEOUT_S
    while len(times) < 2 and time.monotonic() < ends_s:
        rclpy.spin_once(node, timeout_sec=0.02)
    assert times[:2] == [0, 0]


def test_a_publisher_is_awaited_with_a_subscriber_or_if_latched(make):
    """The user may make it latched by an override."""
    node = make({'qos_overrides./ours/later.publisher.durability': 'transient_local'})
    endpoints = Endpoints(node)
    now, later = (endpoints.advertise(Header, topic) for topic in ('now', 'later'))
    assert (is_awaited(now), is_awaited(later)) == (False, True)
    endpoints.subscribe(Header, 'now', lambda _: None)
    ends_s = time.monotonic() + TIMEOUT_S
    while not is_awaited(now) and time.monotonic() < ends_s:
        time.sleep(0.01)
    assert is_awaited(now)
    endpoints.close()
