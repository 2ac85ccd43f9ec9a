# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""lifecycle_pose_node in process: what its transitions leave, refuse and say."""

from lifecycle_msgs.msg import Transition
from p4pfr_ros.ros.lifecycle_pose_node import LifecyclePoseNode
from p4pfr_ros.ros.pose import pipeline as pose_work
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

DONE, REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
ERROR = TransitionCallbackReturn.ERROR
CORNERS = 'qos_overrides./managed/corners.subscription'


def everything_of(node):
    """Return the names of all that others can see of a node."""
    ends = [*node.publishers, *node.subscriptions]
    names = [end.topic_name for end in ends] + [s.srv_name for s in node.services]
    return sorted(names) + [client.srv_name for client in node.clients]


def state_of(node):
    """Return the label of a node's state."""
    return node._state_machine.current_state[1]


@pytest.fixture
def make(dds, monkeypatch):
    """Make nodes whose log is kept, and take them down again."""
    made = []

    def make(**parameters):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = LifecyclePoseNode(namespace='/managed', parameter_overrides=overrides)
        said = node.said = []
        monkeypatch.setattr(
            type(node.get_logger()), 'log', lambda _, text, severity, **__: said.append(text)
        )
        made.append(node)
        return node

    yield make
    for node in made:
        node.destroy_node()


@pytest.mark.parametrize('transition', [0, Transition.TRANSITION_ACTIVATE, 2, 4, 6, 7, 8, 99])
def test_a_transition_that_the_state_does_not_have_is_refused(make, transition):
    """As the service refuses it: an answer, one line, the same state."""
    node = make()
    request = {'transition': Transition(id=transition)}
    change = node._service_change_state
    answer = change.callback(
        change.srv_type.Request(**request), change.srv_type.Response(success=True)
    )
    assert not answer.success
    assert state_of(node) == 'unconfigured'
    assert node.said == [
        'transition refused: expected one of the state unconfigured: '
        f'1 (configure), 5 (shutdown), got {transition}'
    ]


@pytest.mark.parametrize('mistake', ['service', 'override'])
def test_what_cannot_be_configured_leaves_nothing(make, mistake):
    """As often as it is tried, one line says why."""
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
    before = everything_of(node)
    for attempt in (1, 2):
        assert node.trigger_configure() == REFUSED
        assert state_of(node) == 'unconfigured'
        assert everything_of(node) == before
        assert len(node.said) == attempt
        assert f'not configured: lifecycle_pose_node: {name}: {why}' in node.said[-1]
        assert '\n' not in node.said[-1]


def test_what_cannot_be_activated_stays_inactive(make):
    """One line says why; nothing listens."""
    node = make(**{f'{CORNERS}.reliability': 'foo'})
    assert node.trigger_configure() == DONE
    before, said = everything_of(node), len(node.said)
    for _ in range(2):
        assert node.trigger_activate() == REFUSED
        assert state_of(node) == 'inactive'
        assert everything_of(node) == before
    for line in node.said[said:]:
        assert line.startswith(f'not activated: lifecycle_pose_node: {CORNERS}.reliability: ')
        assert line.endswith("got 'foo'")
    assert len(node.said) == said + 2


def test_an_unexpected_error_is_said_and_leaves_nothing(make, monkeypatch):
    """In configuring, where rclpy is silent; the node can be configured later."""
    node = make()
    before = everything_of(node)

    def fail():
        raise ZeroDivisionError('a bug of ours')

    with monkeypatch.context() as broken:
        broken.setattr(pose_work, 'warm_up', fail)
        assert node.trigger_configure() == ERROR
    assert state_of(node) == 'unconfigured'
    assert everything_of(node) == before
    (line,) = node.said
    assert line.startswith('not configured: Traceback')
    assert 'ZeroDivisionError: a bug of ours' in line
    assert node.trigger_configure() == DONE


def test_an_unexpected_error_in_activating_is_said(make, monkeypatch):
    """Then all is taken down, as rclpy has it."""
    node = make()
    before = everything_of(node)
    assert node.trigger_configure() == DONE

    def fail(*_):
        raise ZeroDivisionError('a bug of ours')

    monkeypatch.setattr(pose_work.Inputs, 'subscribe', fail)
    said = len(node.said)
    assert node.trigger_activate() == ERROR
    assert state_of(node) == 'unconfigured'
    assert everything_of(node) == before
    assert [line.partition(':')[0] for line in node.said[said:]] == ['not activated']


@pytest.mark.parametrize('state', ['unconfigured', 'inactive', 'active'])
def test_shutting_down_takes_everything_down(make, state):
    """From wherever the node is."""
    node = make()
    before = everything_of(node)
    if state != 'unconfigured':
        assert node.trigger_configure() == DONE
        assert len(everything_of(node)) > len(before)
    if state == 'active':
        assert node.trigger_activate() == DONE
    assert node.trigger_shutdown() == DONE
    assert state_of(node) == 'finalized'
    assert everything_of(node) == before


def test_a_node_that_is_taken_down_guards_its_parameters_no_more(make):
    """What its camera needs is asked when it is configured again."""
    node = make()
    fixed = [Parameter('intrinsics.mode', value='fixed')]
    assert node.trigger_configure() == DONE
    assert not node.set_parameters_atomically(fixed).successful
    assert node.trigger_cleanup() == DONE
    assert node.set_parameters_atomically(fixed).successful
    assert node.trigger_configure() == REFUSED
    assert 'not configured: lifecycle_pose_node: intrinsics.focal_px' in node.said[-1]


def test_an_override_of_no_endpoint_is_warned_of_once(make):
    """When the node has had all of its endpoints, which it has not until it listens."""
    unused = 'qos_overrides./managed/corner.subscription.depth'
    node = make(**{unused: 7, f'{CORNERS}.depth': 7})
    assert node.trigger_configure() == DONE
    assert not node.said
    for _ in range(2):
        assert node.trigger_activate() == DONE
        assert node.said == [
            f'unknown parameter {unused} is ignored (did you mean {CORNERS}.depth?)'
        ]
        assert node.trigger_deactivate() == DONE
