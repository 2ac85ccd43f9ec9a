# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extreme numbers in files: rejected in one line, or every later step works with them."""

import copy
from pathlib import Path

from extremes import BOARD, IMAGE, passes, SIZE, survives, VALUES
import numpy as np
from p4pfr_ros import (
    BoardShape,
    CameraEstimate,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    SelfCalibration,
)
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.report.number_format import shape_text
import pytest
import yaml

pytestmark = pytest.mark.exhaustive

COVARIANCE = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-6, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2, 0.01, 0.001, 1e-4, 1.001, 1e-3, 1e-3)
SHAPE = BoardShape(
    np.zeros(2), np.array([0.1, 0.08]), [1e-3, 1e-3, 0.01, 1e-3, 0, 0, 0, 0], 1e-7 * np.eye(8)
)
ESTIMATE = CameraEstimate(
    CAMERA,
    COVARIANCE,
    0.2,
    9,
    scatter=1.5,
    projection_sigma_px=0.2,
    seen_radius_px=300.0,
    board_shapes={'board': SHAPE},
    coverage=np.ones((12, 16), dtype=bool),
)
CALIBRATION = Calibration.from_estimate(ESTIMATE, SIZE, 'front')
BOARD_FILES = sorted((Path(__file__).parents[2] / 'config/boards').glob('*.yaml'))
OPTIONS = [EstimateOptions(max_iterations=100), EstimateOptions.ideal(max_iterations=100)]
# As text, YAML reads some of them as numbers and others as words.
over_values = pytest.mark.parametrize('value', [*VALUES, 10**400, True, None, 'word', [], {}])


def places(tree, path=()):
    """Yield the path of each number and word in a tree."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        if isinstance(value, (dict, list)):
            yield from places(value, (*path, key))
        else:
            yield (*path, key)


def changed(tree, path, value):
    """Return a copy of a tree with another value at a path."""
    tree = copy.deepcopy(tree)
    inner = tree
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return tree


def is_like_another(place):
    """Return whether a place is an entry of a matrix like one that is tried."""
    if place[0] in ('rectification_matrix', 'projection_matrix'):
        return place[-1] != 0
    size = 8 if 'boards' in place else 10
    is_entry = place[-3:-1] == ('covariance', 'data')
    return is_entry and place[-1] > 1 and place[-1] not in range(0, size**2, 2 * (size + 1))


@pytest.mark.parametrize(
    'value', [0.0, -1.0, 5e-324, 1e-160, 1e-30, 1e7, 1e30, 1e77, 1e155, 1e308]
)
def test_a_calibration_file(tmp_path, value):
    """What is loaded can be used in every mode, published and saved."""
    path = tmp_path / 'camera.yaml'
    save_calibration(path, CALIBRATION)
    good = yaml.safe_load(path.read_text())
    for place in places(good):
        if is_like_another(place):
            continue
        path.write_text(yaml.safe_dump(changed(good, place, value)))
        loaded = survives(load_calibration, path)
        if loaded is None:
            continue
        camera, shape = loaded.estimate.camera, loaded.estimate.board_shape('board')
        for options in OPTIONS:
            passes(estimate_pose, IMAGE, BOARD, camera=loaded.model, options=options)
            given = {'camera': camera, 'board_shape': shape, 'options': options}
            passes(estimate_pose, IMAGE, BOARD, **given)
        seen_radius_px = loaded.estimate.seen_radius_px
        if (camera, seen_radius_px) != (CAMERA, ESTIMATE.seen_radius_px):
            passes(camera.to_camera_info_model, SIZE, seen_radius_px)
        passes(shape_text, shape)
        calibration = SelfCalibration(SIZE)
        passes(calibration.load, loaded.estimate)
        for _ in range(2):
            passes(calibration.update, IMAGE, BOARD, board='board')
        passes(save_calibration, path, loaded)


@pytest.mark.parametrize('value', [5e-324, 1e-300, 0.99e-3, 1.01e7, 1e308])
def test_a_focal_length_that_no_camera_has_is_rejected(tmp_path, value):
    path = tmp_path / 'camera.yaml'
    save_calibration(path, CALIBRATION)
    good = yaml.safe_load(path.read_text())
    for place in (
        ('camera_matrix', 'data', 0),
        ('camera_matrix', 'data', 4),
        ('division', 'focal_px'),
    ):
        path.write_text(yaml.safe_dump(changed(good, place, value)))
        with pytest.raises(
            Exception, match=r': expected a focal length from 0\.001 to 1e\+07 px, got '
        ):
            load_calibration(path)


@over_values
@pytest.mark.parametrize('file', BOARD_FILES, ids=lambda file: file.stem)
def test_a_board_file(tmp_path, file, value):
    """The points of a board that is loaded are finite, and have a pose."""
    path = tmp_path / 'boards.yaml'
    good = yaml.safe_load(file.read_text())
    for place in places(good):
        path.write_text(yaml.safe_dump(changed(good, place, value)))
        for board in (survives(load_boards, path) or {}).values():
            assert np.isfinite(board.points).all()
            assert np.isfinite(board.sheet_size_m).all()
            assert np.ptp(board.points, axis=0).min() >= 1e-6
            if len(board.points) < 1000:
                image = 100.0 + 100.0 * board.points / np.abs(board.points).max() * [1.0, -1.0]
                passes(estimate_pose, image, board.points, image_size=SIZE, options=OPTIONS[0])
