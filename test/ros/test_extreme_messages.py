# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extreme numbers in parameters and messages: rejected and counted, or estimated; no exception."""

from builtin_interfaces.msg import Time
from extremes import passes, VALUES, with_number
from in_process import publish, set_parameter
import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg
from p4pfr_ros.ros.parameters.declare import flattened
from p4pfr_ros.ros.parameters.pose_options import MODES, PoseNodeOptions
from p4pfr_ros.ros.pose.outputs import Outputs, PoseOutputs
from p4pfr_ros.ros.pose_node import PoseNode
import pytest
from rclpy.parameter import Parameter
import scenes

pytestmark = pytest.mark.exhaustive

PIXELS, CORNERS = scenes.project(scenes.GRID), scenes.project(scenes.ARUCO)
MODELS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4, 'division': 1}
K = [520.0, 0.0, 319.5, 0.0, 521.0, 239.5, 0.0, 0.0, 1.0]
PARAMETERS = [
    (name, value, spec)
    for name, value, spec in flattened(PoseNodeOptions())
    if isinstance(value, float) and not spec.read_only
]
over_values = pytest.mark.parametrize('value', VALUES)
over_modes = pytest.mark.parametrize('mode', MODES)


@pytest.fixture
def node(dds, monkeypatch):
    """Return a node that publishes on every topic, with a camera for every mode."""
    overrides = {
        'marker.size_m': scenes.MARKER_M,
        'intrinsics.focal_px': 520.0,
        'robust.max_iterations': 100,
    }
    node = PoseNode(parameter_overrides=[Parameter(k, value=v) for k, v in overrides.items()])
    monkeypatch.setattr(Outputs, 'is_awaited', lambda *_: True)
    monkeypatch.setattr('p4pfr_ros.ros.pose.outputs.is_awaited', lambda *_: True)
    monkeypatch.setattr('p4pfr_ros.ros.pose.outputs.has_subscribers', lambda *_: True)
    yield node
    node.destroy_node()


def calibrated(model='plumb_bob', k=K, d=None):
    """Make a calibrated camera_info."""
    msg = scenes.camera_info()
    msg.k, msg.distortion_model = k, model
    msg.d = [0.01] * MODELS[model] if d is None else d
    return msg


def cloud(pixels, board, second=1):
    """Make a cloud."""
    return cloud_msg(scenes.header(second), pixels, board, np.arange(len(pixels)))


def process(node, *messages):
    """Publish messages, and after them a good cloud and good corners."""
    topics = {'PointCloud2': 'correspondences', 'PolygonStamped': 'corners'}
    for msg in (*messages, cloud(PIXELS, scenes.GRID), scenes.polygon(2, CORNERS)):
        passes(publish, node, topics.get(type(msg).__name__, 'camera_info'), msg)
    passes(node._pipeline._on_timer)


@over_modes
@over_values
def test_points(node, value, mode):
    assert set_parameter(node, 'intrinsics.mode', mode).successful
    process(node, calibrated())
    for place in ((3, 0), 3, (slice(None), 1), slice(None)):
        process(
            node,
            cloud(with_number(PIXELS, place, value), scenes.GRID),
            cloud(PIXELS, with_number(scenes.GRID, place, value)),
            cloud(PIXELS[[0, 5, 29, 24]], with_number(scenes.GRID[[0, 5, 29, 24]], 1, value)),
        )
    if abs(value) < 3e38:  # Point32 has no larger numbers
        process(node, scenes.polygon(1, with_number(CORNERS, (1, 0), value)))


@over_values
def test_camera_info(node, value):
    assert set_parameter(node, 'intrinsics.mode', 'camera_info').successful
    for model, count in MODELS.items():
        for i in range(9):
            process(node, calibrated(model, k=with_number(K, i, value)))
        for i in range(count):
            process(node, calibrated(model, d=with_number([0.01] * count, i, value).tolist()))
        process(node, calibrated(model, k=np.full(9, value)))


@pytest.mark.parametrize('value', [0, 1, 2, 641, 65535, 65536, 2**31, 2**32 - 1])
@over_modes
def test_image_frame(node, value, mode):
    assert set_parameter(node, 'intrinsics.mode', mode).successful
    for name in ('width', 'height', 'binning_x', 'binning_y'):
        msg = calibrated()
        setattr(msg, name, value)
        process(node, msg)
    for name in ('x_offset', 'y_offset', 'width', 'height'):
        msg = calibrated()
        setattr(msg.roi, name, value)
        process(node, msg)


@over_modes
@pytest.mark.parametrize('sec', [-(2**31), -1, 0, 2**31 - 1])
@pytest.mark.parametrize('nanosec', [0, 10**9, 2**32 - 1])
def test_stamps(node, sec, nanosec, mode):
    assert set_parameter(node, 'intrinsics.mode', mode).successful
    process(node, calibrated())
    msg = cloud(PIXELS, scenes.GRID)
    msg.header.stamp = Time(sec=sec, nanosec=nanosec)
    process(node, msg)


@pytest.mark.parametrize('name', [name for name, _, _ in PARAMETERS])
def test_parameters(node, name):
    """A value that is accepted works with the next message; the ends of the range too."""
    [(before, spec)] = [(value, spec) for n, value, spec in PARAMETERS if n == name]
    before = node.get_parameter(name).value
    modes = MODES if name.split('.')[0] in ('intrinsics', 'image') else ['self_calibrate', 'fixed']
    for mode in modes:
        assert set_parameter(node, 'intrinsics.mode', mode).successful
        process(node, calibrated())
        for value in (spec.low, spec.high, *VALUES):
            if set_parameter(node, name, float(value)).successful:
                process(node)
        assert set_parameter(node, name, before).successful


def test_every_topic_is_published(node, monkeypatch):
    """The fixture leads the estimates to the topics."""
    published = []
    monkeypatch.setattr(PoseOutputs, 'publish', lambda *given: published.append(given))
    process(node, calibrated())
    assert len(published) == 2
