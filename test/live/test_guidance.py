# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The next view makes the camera better, is visible, and is described in the right words."""

import math

import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    DivisionCamera,
    Pose,
    SelfCalibration,
)
from p4pfr_ros.boards import Chessboard
from p4pfr_ros.live.guidance import directions, Guide, NextView, place_name
from p4pfr_ros.scenes.board_path import outline_of, placed, tilted_rotation
import pytest

SIZE = (640, 480)
BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
POINTS = np.pad(BOARD.points, ((0, 0), (0, 1)))
CAMERAS = {
    'normal': DivisionCamera(520.0, (331.0, 233.0), -0.2),
    'wide': DivisionCamera(330.0, (312.0, 246.0), -0.35),
    'long': DivisionCamera(1100.0, (322.0, 238.0), -0.05),
}


def seen(camera, pose, rng):
    """Return the pixels of the board with noise."""
    pixels = camera.project(pose.transform(POINTS))
    return pixels + rng.normal(0.0, 0.2, pixels.shape)


def follow(camera, views):
    """Calibrate with a person who does what the guide says; return the targets as well."""
    calibration, guide = SelfCalibration(SIZE), Guide(BOARD, SIZE, CalibrationOptions())
    rng, targets = np.random.default_rng(1), []
    for i in range(views):
        targets.append(guide.next_view(calibration.fused, calibration.views))
        pose = targets[-1].camera_from_board
        calibration.update(seen(camera, pose, rng), BOARD.points, i, board=BOARD.name)
    return calibration, targets


@pytest.mark.parametrize(('name', 'views'), [('normal', 6), ('wide', 6), ('long', 12)])
def test_a_person_who_follows_needs_few_views(name, views):
    camera = CAMERAS[name]
    calibration, _ = follow(camera, views)
    assert calibration.state is CalibrationState.CALIBRATED
    assert calibration.missing == ()
    error_px = abs(calibration.fused.camera.focal_px - camera.focal_px)
    assert error_px < 4.0 * calibration.fused.focal_sigma_px


def test_a_target_is_better_than_the_view_before():
    """The expected uncertainty falls, and is about the one that results."""
    _, targets = follow(CAMERAS['normal'], 10)
    expected = [target.uncertainty for target in targets]
    assert math.isnan(expected[0])
    known = np.array([each for each in expected if not math.isnan(each)])
    assert (np.diff(known) < 0.05 * known[:-1]).all()
    assert known[-1] < 0.3 * known[0]


@pytest.mark.parametrize('camera', CAMERAS.values(), ids=CAMERAS)
def test_targets_are_inside_the_image_and_differ(camera):
    _, targets = follow(camera, 8)
    outline = outline_of(BOARD)
    for target in targets:
        pixels = target.camera.project(target.camera_from_board.transform(outline))
        assert ((pixels > -0.5) & (pixels < np.subtract(SIZE, 0.5))).all()
    matrices = {target.camera_from_board.matrix.tobytes() for target in targets}
    assert len(matrices) == len(targets)


def test_a_target_stays_while_nothing_changes():
    calibration, _ = follow(CAMERAS['normal'], 4)
    guide = Guide(BOARD, SIZE, CalibrationOptions())
    first = guide.next_view(calibration.fused, calibration.views)
    again = guide.next_view(calibration.fused, calibration.views)
    assert first.camera_from_board == again.camera_from_board


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    'camera',
    [
        DivisionCamera(60.0, (320.0, 240.0), -0.4),
        DivisionCamera(30_000.0, (320.0, 240.0), 40.0),
        DivisionCamera(300.0, (320.0, 240.0), 5.0),
        DivisionCamera(300.0, (2000.0, -900.0), -0.3, 0.2, -0.1, 0.3),
        DivisionCamera(1e-2, (320.0, 240.0), -1e-9),
    ],
    ids=['tiny', 'long', 'folded', 'centre outside', 'absurd'],
)
@pytest.mark.parametrize('variance', [1e-12, 1.0, 1e20])
def test_an_early_estimate_may_be_absurd(camera, variance):
    """The first views may give any camera; there is a next view nevertheless."""
    estimate = CameraEstimate(camera, variance * np.eye(10), 0.5, 2)
    guide = Guide(BOARD, SIZE, CalibrationOptions())
    for _ in range(2):
        target = guide.next_view(estimate, ())
        assert np.isfinite(target.camera_from_board.matrix).all()
    directions(target, at(), SIZE)


CAMERA = CAMERAS['normal']


def at(tilt_deg=0.0, quarters=0, filled=0.5, middle=(0.5, 0.5), roll_deg=0.0):
    """Place the board in the image, by shares of its size."""
    rotation = tilted_rotation(
        math.radians(tilt_deg), 0.5 * math.pi * quarters, math.radians(roll_deg)
    )
    return placed(outline_of(BOARD), rotation, filled, np.multiply(middle, SIZE), CAMERA, SIZE)


def advice(here, there):
    return directions(NextView(BOARD, there, CAMERA, 1.0), here, SIZE)


@pytest.mark.parametrize(
    ('there', 'words'),
    [
        ({'middle': (0.3, 0.3)}, 'move the board to the upper left corner of the image'),
        ({'middle': (0.7, 0.5)}, 'move the board to the right side of the image'),
        ({'filled': 0.8}, 'move the board closer'),
        ({'filled': 0.3}, 'move the board farther away'),
        ({'roll_deg': 90.0}, 'turn the board by 90 degrees'),
    ],
)
def test_the_words_lead_to_the_target(there, words):
    assert advice(at(), at(**there))[0] == words


@pytest.mark.parametrize('quarters', range(4))
def test_the_side_to_tilt_is_the_one_that_is_farther_then(quarters):
    target = at(tilt_deg=35.0, quarters=quarters)
    [words] = [each for each in advice(at(), target) if each.startswith('tilt')]
    sides = {
        'left': (-0.1, 0.0),
        'right': (0.1, 0.0),
        'upper': (0.0, 0.1),
        'lower': (0.0, -0.1),
    }
    depths = {name: target.transform((*xy, 0.0))[2] for name, xy in sides.items()}
    assert words == f'tilt the {max(depths, key=depths.get)} side away from the camera'


def test_there_is_nothing_to_say_at_the_target():
    target = at(tilt_deg=35.0, quarters=1, middle=(0.4, 0.6))
    assert advice(target, target) == ()
    # Upside down the board looks nearly the same.
    turned = Pose(target.rotation @ np.diag([-1.0, -1.0, 1.0]), target.translation)
    assert advice(turned, target) == ()


def test_places_have_names():
    assert place_name(np.array([320.0, 240.0]), SIZE) == 'the middle of the image'
    assert place_name(np.array([-5.0, 240.0]), SIZE) == 'the left side of the image'
    assert place_name(np.array([320.0, 479.0]), SIZE) == 'the lower side of the image'
    assert place_name(np.array([600.0, 9.0]), SIZE) == 'the upper right corner of the image'
