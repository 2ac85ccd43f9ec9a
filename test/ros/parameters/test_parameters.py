# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters: declaration, validation with a reason, and agreement with config/."""

from dataclasses import dataclass, field, fields
from pathlib import Path

from p4pfr_ros import CalibrationOptions, EstimateOptions
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.parameters.dashboard_options import DashboardNodeOptions
from p4pfr_ros.ros.parameters.declare import flattened, parameter, Parameters, replaced
from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions, DetectorNodeOptions
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
import pytest
import rclpy
from rclpy.parameter import Parameter
import yaml

CONFIG = Path(__file__).resolve().parents[3] / 'config'
NODES = {
    'pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
    'dashboard_node': DashboardNodeOptions(),
}
# The defaults of robust.* that differ from the core's.
NODE_DEFAULTS = {'min_inlier_ratio': 0.5, 'max_iterations': 5000}


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
    """Give a node without parameters."""
    node = rclpy.create_node('with_parameters', parameter_overrides=[])
    yield node
    node.destroy_node()


def _change(node, **values):
    parameters = [Parameter(name.replace('__', '.'), value=v) for name, v in values.items()]
    return node.set_parameters_atomically(parameters)


def test_a_change_of_several_parameters_is_atomic(node):
    """Parameters of groups have dotted names."""
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
def test_an_invalid_change_is_rejected_with_a_reason(node, values, reason):
    """Nothing is changed."""
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
def test_an_invalid_start_value_is_an_error_of_one_line(dds, name, value, reason):
    """It names node, parameter and expected values."""
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


def test_a_read_only_parameter_can_be_set_at_the_start(dds):
    """Not later."""
    overrides = [Parameter('shape', value='square')]
    node = rclpy.create_node('well_set', parameter_overrides=overrides)
    assert Parameters(node, _Options()).options.shape == 'square'
    node.destroy_node()


@pytest.mark.parametrize('options', NODES.values(), ids=NODES)
def test_every_parameter_is_described_and_every_number_has_a_range(dds, options):
    """As shown by `ros2 param describe`; the default is within the range."""
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
def test_config_files_list_every_parameter_with_its_default(name):
    """config/*.yaml agrees with the code, including the comments."""
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


def test_robust_parameters_are_the_options_of_estimate_pose():
    """``robust.*`` has its names, ranges, descriptions and most defaults; 0.0 stands for None."""
    assert PoseNodeOptions().robust == EstimateOptions(**NODE_DEFAULTS)
    changed = replaced(PoseNodeOptions(), {'robust.threshold_px': 5.0, 'robust.seed': 9})
    assert changed.robust == EstimateOptions(threshold_px=5.0, seed=9, **NODE_DEFAULTS)
    given = {'robust.prior_focal_px': 500.0, 'robust.prior_focal_sigma_px': 5.0}
    prior = replaced(PoseNodeOptions(), given)
    assert prior.robust == EstimateOptions(
        prior_focal_px=500.0, prior_focal_sigma_px=5.0, **NODE_DEFAULTS
    )
    assert replaced(prior, dict.fromkeys(given, 0.0)).robust == EstimateOptions(**NODE_DEFAULTS)
    with pytest.raises(ConfigError, match=r'^robust\.prior_focal_px'):
        replaced(PoseNodeOptions(), {'robust.prior_focal_px': 500.0})
    with pytest.raises(ConfigError, match=r'^robust\.'):
        replaced(PoseNodeOptions(), {'robust.max_fov_deg': 2.0})


def test_calibration_parameters_are_the_options_of_self_calibration():
    """``calibration.*`` has its names, defaults, ranges and descriptions."""
    assert PoseNodeOptions().calibration == CalibrationOptions()
    changed = replaced(PoseNodeOptions(), {'calibration.max_views': 60})
    assert changed.calibration == CalibrationOptions(max_views=60)
    with pytest.raises(ConfigError, match=r'^calibration\.min_views'):
        replaced(PoseNodeOptions(), {'calibration.min_views': 41})


@pytest.mark.parametrize('group', ['robust', 'calibration'])
def test_specs_of_core_options_come_from_the_core(group):
    """An option that is None by default has the ROS value 0.0, which is in its range."""
    options = getattr(PoseNodeOptions(), group)
    specs = {name: (value, spec) for name, value, spec in flattened(PoseNodeOptions())}
    for core in fields(options):
        value, spec = specs[f'{group}.{core.name}']
        option = core.metadata['option']
        if group == 'robust' and core.name in NODE_DEFAULTS:
            assert value == NODE_DEFAULTS[core.name] != core.default
            assert (spec.low, spec.high) == (option.low, option.high)
        elif core.default is None:
            assert (value, spec.low, spec.high) == (0.0, 0.0, option.high)
            assert spec.description == f'{option.description} 0: not given.'
        else:
            assert (value, spec.low, spec.high) == (core.default, option.low, option.high)
            assert spec.description == option.description


def test_a_change_to_an_option_that_is_not_given_is_validated(node):
    """Zero is valid, and a value between zero and the limit of the core is not."""
    parameters = Parameters(node, PoseNodeOptions())
    assert node.get_parameter('robust.sigma_px').value == 0.0
    result = _change(node, robust__sigma_px=1e-9)
    assert not result.successful
    assert result.reason.startswith('robust.sigma_px must be ')
    assert _change(node, robust__sigma_px=0.5).successful
    assert parameters.options.robust == EstimateOptions(sigma_px=0.5, **NODE_DEFAULTS)
    assert _change(node, robust__sigma_px=0.0).successful
    assert parameters.options.robust == EstimateOptions(**NODE_DEFAULTS)


def test_a_guard_rejects_changes_until_it_is_removed(node):
    """It checks the current values, too."""
    parameters = Parameters(node, _Options())

    def at_most_five(options):
        if options.count > 5:
            raise ConfigError(f'count: expected at most 5, got {options.count}')

    parameters.guard(at_most_five)
    rejected = _change(node, count=6)
    assert (rejected.successful, rejected.reason) == (False, 'count: expected at most 5, got 6')
    assert parameters.options.count == 3
    parameters.guard(None)
    assert _change(node, count=6).successful
    with pytest.raises(ConfigError, match=r'^with_parameters: count: expected at most 5, got 6'):
        parameters.guard(at_most_five)
    assert _change(node, count=7).successful
