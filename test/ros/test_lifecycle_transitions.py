# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""lifecycle_pose_node in process: its transitions, their failures and their log lines."""

from lifecycle_msgs.msg import Transition
from p4pfr_ros.ros.lifecycle_pose_node import LifecyclePoseNode
from p4pfr_ros.ros.pose import pipeline
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
ERROR = TransitionCallbackReturn.ERROR
CORNERS = 'qos_overrides./managed/corners.subscription'


def endpoints_of(node):
    """Return the names of all endpoints of a node."""
    ends = [*node.publishers, *node.subscriptions]
    names = [end.topic_name for end in ends] + [s.srv_name for s in node.services]
    return sorted(names) + [client.srv_name for client in node.clients]


def state_of(node):
    """Return the label of the state of a node."""
    return node._state_machine.current_state[1]


@pytest.fixture
def make(dds, monkeypatch):
    """Make nodes with a recorded log."""
    made = []

    def make(**parameters):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = LifecyclePoseNode(namespace='/managed', parameter_overrides=overrides)
        logged = node.logged = []
        monkeypatch.setattr(
            type(node.get_logger()), 'log', lambda _, text, severity, **__: logged.append(text)
        )
        made.append(node)
        return node

    yield make
    for node in made:
        node.destroy_node()


@pytest.mark.parametrize('transition', [0, Transition.TRANSITION_ACTIVATE, 2, 4, 6, 7, 8, 99])
def test_a_transition_that_the_state_does_not_have_is_rejected(make, transition):
    """The service responds, one line is logged, the state stays."""
    node = make()
    request = {'transition': Transition(id=transition)}
    change = node._service_change_state
    response = change.callback(
        change.srv_type.Request(**request), change.srv_type.Response(success=True)
    )
    assert not response.success
    assert state_of(node) == 'unconfigured'
    assert node.logged == [
        'transition rejected: expected a transition of the state unconfigured: '
        f'1 (configure), 5 (shutdown), got {transition}'
    ]


@pytest.mark.parametrize('mistake', ['service', 'override'])
def test_a_failed_configure_leaves_no_endpoints(make, mistake):
    """Each attempt logs one line with the reason."""
    name, value, why = {
        'service': (
            'set_camera_info_service',
            'bad name!',
            "expected the name of a service, got 'bad name!'",
        ),
        'override': (
            'qos_overrides./managed/lifecycle_pose_node/pose.publisher.depth',
            -1,
            'expected an integer from 0 to 2147483647, got -1',
        ),
    }[mistake]
    node = make(**{name: value})
    before = endpoints_of(node)
    for attempt in (1, 2):
        assert node.trigger_configure() == FAILURE
        assert state_of(node) == 'unconfigured'
        assert endpoints_of(node) == before
        assert len(node.logged) == attempt
        assert f'not configured: lifecycle_pose_node: {name}: {why}' in node.logged[-1]
        assert '\n' not in node.logged[-1]


def test_a_failed_activate_leaves_the_node_inactive(make):
    """Each attempt logs one line with the reason; nothing is subscribed."""
    node = make(**{f'{CORNERS}.reliability': 'foo'})
    assert node.trigger_configure() == SUCCESS
    before, count = endpoints_of(node), len(node.logged)
    for _ in range(2):
        assert node.trigger_activate() == FAILURE
        assert state_of(node) == 'inactive'
        assert endpoints_of(node) == before
    for line in node.logged[count:]:
        assert line.startswith(f'not activated: lifecycle_pose_node: {CORNERS}.reliability: ')
        assert line.endswith("got 'foo'")
    assert len(node.logged) == count + 2


def test_an_unexpected_error_in_configure_is_logged(make, monkeypatch):
    """Rclpy does not log it; no endpoints are left, and the node can be configured later."""
    node = make()
    before = endpoints_of(node)

    def fail():
        raise ZeroDivisionError('a bug of ours')

    with monkeypatch.context() as broken:
        broken.setattr(pipeline, 'warm_up', fail)
        assert node.trigger_configure() == ERROR
    assert state_of(node) == 'unconfigured'
    assert endpoints_of(node) == before
    (line,) = node.logged
    assert line.startswith('not configured: Traceback')
    assert 'ZeroDivisionError: a bug of ours' in line
    assert node.trigger_configure() == SUCCESS


def test_an_unexpected_error_in_activate_is_logged(make, monkeypatch):
    """Rclpy continues with on_error, which destroys all endpoints."""
    node = make()
    before = endpoints_of(node)
    assert node.trigger_configure() == SUCCESS

    def fail(*_):
        raise ZeroDivisionError('a bug of ours')

    monkeypatch.setattr(pipeline, 'detection_array_type', fail)
    count = len(node.logged)
    assert node.trigger_activate() == ERROR
    assert state_of(node) == 'unconfigured'
    assert endpoints_of(node) == before
    assert [line.partition(':')[0] for line in node.logged[count:]] == ['not activated']


@pytest.mark.parametrize('state', ['unconfigured', 'inactive', 'active'])
def test_shutdown_destroys_all_endpoints(make, state):
    """From any state."""
    node = make()
    before = endpoints_of(node)
    if state != 'unconfigured':
        assert node.trigger_configure() == SUCCESS
        assert len(endpoints_of(node)) > len(before)
    if state == 'active':
        assert node.trigger_activate() == SUCCESS
    assert node.trigger_shutdown() == SUCCESS
    assert state_of(node) == 'finalized'
    assert endpoints_of(node) == before


def test_cleanup_removes_the_guard_of_parameters(make):
    """The mode fixed needs a camera only when the node is configured again."""
    node = make()
    fixed = [Parameter('intrinsics.mode', value='fixed')]
    assert node.trigger_configure() == SUCCESS
    assert not node.set_parameters_atomically(fixed).successful
    assert node.trigger_cleanup() == SUCCESS
    assert node.set_parameters_atomically(fixed).successful
    assert node.trigger_configure() == FAILURE
    assert 'not configured: lifecycle_pose_node: intrinsics.focal_px' in node.logged[-1]


def test_a_parameter_that_is_read_only_in_pose_node_says_when_it_can_be_changed(make):
    """In its description for people, and by an error of one line."""
    node = make()
    why = 'read-only once the node is configured, until cleanup'
    assert node.describe_parameter('board_file').additional_constraints == why
    name = Parameter('camera_name', value='front')
    assert node.set_parameters_atomically([name]).successful
    wrong = node.set_parameters_atomically([Parameter('camera_name', value='../front')])
    assert wrong.reason == "camera_name: expected letters, digits and _, got '../front'"
    assert node.trigger_configure() == SUCCESS
    # With another change, too: nothing is changed then.
    result = node.set_parameters_atomically([Parameter('enabled', value=False), name])
    assert (result.successful, result.reason) == (False, f'camera_name: {why}')
    assert node.get_parameter('enabled').value
    assert node.trigger_cleanup() == SUCCESS
    assert node.set_parameters_atomically([name]).successful


def test_an_unused_override_is_warned_of_once(make):
    """After the first activate, when all endpoints have been created."""
    unused = 'qos_overrides./managed/corner.subscription.depth'
    node = make(**{unused: 7, f'{CORNERS}.depth': 7})
    assert node.trigger_configure() == SUCCESS
    assert not node.logged
    for _ in range(2):
        assert node.trigger_activate() == SUCCESS
        assert node.logged == [
            f'unknown parameter {unused} is ignored (did you mean {CORNERS}.depth?)'
        ]
        assert node.trigger_deactivate() == SUCCESS
