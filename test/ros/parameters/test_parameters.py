# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters: declared once, described, checked with a reason, and in step with config/."""

from dataclasses import dataclass, field
from pathlib import Path

from p4pfr_ros import CalibrationOptions, EstimateOptions
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.parameters.declare import flattened, parameter, Parameters, replaced
from p4pfr_ros.ros.parameters.image_node_options import (
    CameraSimulatorOptions,
    DetectorNodeOptions,
    PoseNodeOptions,
)
import pytest
import rclpy
from rclpy.parameter import Parameter
import yaml

CONFIG = Path(__file__).resolve().parents[3] / 'config'
NODES = {
    'pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
}


@dataclass(frozen=True)
class _Group:
    low: float = parameter(1.0, 'Less than high.', low=0.0, high=10.0)
    high: float = parameter(2.0, 'More than low.', low=0.0, high=10.0)

    def __post_init__(self):
        if not self.low < self.high:
            raise ConfigError(f'group.low: expected less than {self.high:g}, got {self.low:g}')


@dataclass(frozen=True)
class _Options:
    count: int = parameter(3, 'How many.', low=1, high=9)
    colour: str = parameter('red', 'Which.', choices=('red', 'green'))
    shape: str = parameter('round', 'Never changes.', read_only=True)
    group: _Group = field(default_factory=_Group)


@pytest.fixture
def node(dds):
    """Make a node that nobody talks to."""
    node = rclpy.create_node('with_parameters', parameter_overrides=[])
    yield node
    node.destroy_node()


def _change(node, **values):
    parameters = [Parameter(name.replace('__', '.'), value=v) for name, v in values.items()]
    return node.set_parameters_atomically(parameters)


def test_a_change_takes_effect_as_a_whole(node):
    """Groups are dotted names, and two that go together change together."""
    parameters = Parameters(node, _Options())
    assert parameters.options == _Options()
    assert _change(node, count=5, group__low=4.0, group__high=6.0).successful
    assert parameters.options == _Options(count=5, group=_Group(4.0, 6.0))
    assert node.get_parameter('group.high').value == 6.0


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'count': 0}, 'count out of range'),
        ({'count': 10}, 'count out of range'),
        ({'count': 2.0}, 'type'),
        ({'group__low': float('nan')}, 'group.low out of range'),
        ({'group__low': -1e-9}, 'group.low out of range'),
        ({'colour': 'blue'}, "colour: expected one of red, green, got 'blue'"),
        ({'shape': 'square'}, 'read-only'),
        ({'group__low': 2.0}, 'group.low: expected less than 2, got 2'),
        ({'count': 4, 'colour': 'blue'}, 'colour'),
    ],
)
def test_a_wrong_change_is_refused_with_a_reason(node, values, reason):
    """What is refused changes nothing."""
    parameters = Parameters(node, _Options())
    result = _change(node, **values)
    assert not result.successful
    assert reason in result.reason
    assert parameters.options == _Options()


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('count', 10, 'count'),
        ('colour', 'blue', 'colour: expected one of red, green'),
        ('group.low', 1, 'write 1.0, not 1'),
        ('group.high', 11.0, 'out of range'),
        ('group.low', 5.0, 'group.low: expected less than 2, got 5'),
    ],
)
def test_a_wrong_start_is_one_line_for_the_user(dds, name, value, reason):
    """It names the node and the parameter, and says what was expected."""
    node = rclpy.create_node('badly_set', parameter_overrides=[Parameter(name, value=value)])
    try:
        with pytest.raises(ConfigError) as error:
            Parameters(node, _Options())
    finally:
        node.destroy_node()
    message = str(error.value)
    assert message.startswith(f'badly_set: {name}: ')
    assert reason in message
    assert ('write 1.0' in message) == ((name, value) == ('group.low', 1))
    assert '\n' not in message


def test_a_read_only_parameter_is_set_at_the_start(dds):
    """Then, and only then."""
    overrides = [Parameter('shape', value='square')]
    node = rclpy.create_node('well_set', parameter_overrides=overrides)
    assert Parameters(node, _Options()).options.shape == 'square'
    node.destroy_node()


@pytest.mark.parametrize('options', NODES.values(), ids=NODES)
def test_every_parameter_is_described_and_every_number_has_a_range(dds, options):
    """As `ros2 param describe` shows it; the default lies within the range."""
    node = rclpy.create_node('described')
    Parameters(node, options)
    for name, value, spec in flattened(options):
        descriptor = node.describe_parameter(name)
        assert descriptor.description.endswith('.')
        assert descriptor.read_only == spec.read_only
        ranges = [*descriptor.integer_range, *descriptor.floating_point_range]
        if isinstance(value, (str, bool)):
            assert not ranges
            assert not spec.choices or value in spec.choices
        else:
            assert ranges[0].from_value <= value <= ranges[0].to_value
    node.destroy_node()


@pytest.mark.parametrize('name', NODES)
def test_config_files_hold_every_parameter_with_its_default(name):
    """config/*.yaml and the code are in step, comments included."""
    text = (CONFIG / f'{name}.yaml').read_text()
    tree = yaml.safe_load(text)[f'/**/{name}']['ros__parameters']
    written = dict(_flat(tree, ''))
    assert written == {n: value for n, value, _ in flattened(NODES[name])}
    assert {n: type(v) for n, v in written.items()} == {
        n: type(value) for n, value, _ in flattened(NODES[name])
    }
    flowing = ' '.join(line.strip().removeprefix('# ') for line in text.splitlines())
    for n, _, spec in flattened(NODES[name]):
        assert spec.description in flowing, n


def _flat(tree, prefix):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value


def test_the_solver_gets_what_the_parameters_say():
    """``robust.*`` are the fields of EstimateOptions, by name and by default."""
    assert PoseNodeOptions().robust.ransac() == EstimateOptions()
    changed = replaced(PoseNodeOptions(), {'robust.threshold_px': 5.0, 'robust.seed': 9})
    assert changed.robust.ransac() == EstimateOptions(threshold_px=5.0, seed=9)
    known = {'robust.prior_focal_px': 500.0, 'robust.prior_focal_sigma_px': 5.0}
    prior = replaced(PoseNodeOptions(), known).robust.ransac()
    assert prior == EstimateOptions(prior_focal_px=500.0, prior_focal_sigma_px=5.0)
    with pytest.raises(ConfigError, match=r'^robust\.prior_focal_px'):
        replaced(PoseNodeOptions(), {'robust.prior_focal_px': 500.0})
    with pytest.raises(ConfigError, match=r'^robust\.max_fov_deg'):
        replaced(PoseNodeOptions(), {'robust.max_fov_deg': 2.0})


def test_the_calibration_gets_what_the_parameters_say():
    """``calibration.*`` are the fields of CalibrationOptions, by name and by default."""
    assert PoseNodeOptions().calibration.core() == CalibrationOptions()
    changed = replaced(PoseNodeOptions(), {'calibration.max_views': 60})
    assert changed.calibration.core() == CalibrationOptions(max_views=60)
    with pytest.raises(ConfigError, match=r'^calibration\.min_views'):
        replaced(PoseNodeOptions(), {'calibration.min_views': 41})


def test_a_guard_refuses_what_only_the_node_knows_to_be_wrong(node):
    """At once, and at every change, until it is taken away."""
    parameters = Parameters(node, _Options())

    def at_most_five(options):
        if options.count > 5:
            raise ConfigError(f'count: expected at most 5, got {options.count}')

    parameters.guard(at_most_five)
    refused = _change(node, count=6)
    assert (refused.successful, refused.reason) == (False, 'count: expected at most 5, got 6')
    assert parameters.options.count == 3
    parameters.guard(None)
    assert _change(node, count=6).successful
    with pytest.raises(ConfigError, match=r'^with_parameters: count: expected at most 5, got 6'):
        parameters.guard(at_most_five)
    assert _change(node, count=7).successful
