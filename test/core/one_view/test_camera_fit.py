# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration that does not fit the image: refused, while views of a right one are not."""

import math

import numpy as np
from p4pfr_ros import CameraInfoModel, DivisionCamera, estimate_pose, Pose, Status
from p4pfr_ros.core.one_view.camera_fit import proves_camera
import pytest

SIZE = (640, 480)
MIDDLE = (319.5, 239.5)
FOCAL_PX = 600.0
TRUE = DivisionCamera(FOCAL_PX, MIDDLE)
HEAD_ON = np.diag([1.0, -1.0, -1.0])
GRID = 0.025 * np.stack(np.meshgrid(np.arange(9) - 4.0, np.arange(6) - 2.5), -1).reshape(-1, 2)
MARKER = 0.075 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])

# Factors of the focal length and of the principal point.
WRONG = {
    'half size': (0.5, 0.5),
    'quarter size': (0.25, 0.25),
    'half the focal length': (0.5, 1.0),
    'a quarter of it': (0.25, 1.0),
    'twice': (2.0, 1.0),
    'four times': (4.0, 1.0),
}


def camera(focal, center):
    """Return a camera with a multiple of the true focal length and principal point."""
    return DivisionCamera(focal * FOCAL_PX, (center * MIDDLE[0], center * MIDDLE[1]))


def info(known):
    """Return the same camera as of a CameraInfo."""
    focal_px = (known.focal_px, known.focal_px)
    return CameraInfoModel('plumb_bob', (0.0,) * 5, focal_px, known.center_px, 0.0, SIZE)


def view(
    seed,
    board=GRID,
    tilt_deg=(25.0, 55.0),
    *,
    noise_px=0.2,
    bow_m=0.0,
    wide=0.0,
    shear=0.0,
):
    """Draw image points (N, 2) of a board inside the image, 0.3 to 0.9 m away, and its pose."""
    rng = np.random.default_rng(seed)
    while True:
        tilt, azimuth = math.radians(rng.uniform(*tilt_deg)), rng.uniform(0.0, 2.0 * np.pi)
        axis = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        tilted = Pose.from_rotation_vector(tilt * axis, np.zeros(3)).rotation
        rolled = Pose.from_rotation_vector([0.0, 0.0, rng.uniform(-0.7, 0.7)], np.zeros(3))
        z = math.exp(rng.uniform(math.log(0.3), math.log(0.9)))
        place = (rng.uniform((0.0, 0.0), SIZE) - MIDDLE) / FOCAL_PX
        pose = Pose(rolled.rotation @ tilted @ HEAD_ON, [*(z * place), z])
        height = bow_m * (1.0 - (board[:, :1] / np.abs(board).max()) ** 2)
        image = TRUE.project(pose.transform(np.hstack([board * [1.0 + wide, 1.0], height])))
        image[:, 0] += shear * (image[:, 1] - MIDDLE[1])
        if ((image > 5.0) & (image < np.subtract(SIZE, 6.0))).all():
            return image + rng.normal(0.0, noise_px, image.shape), pose


@pytest.mark.exhaustive
@pytest.mark.parametrize('known', [camera, lambda *factors: info(camera(*factors))])
@pytest.mark.parametrize('wrong', WRONG)
def test_a_wrong_calibration_is_refused_by_most_views_of_a_tilted_board(wrong, known, sample):
    given, misfits = known(*WRONG[wrong]), 0
    seeds = range(sample(40, 1))
    for seed in seeds:
        image, _ = view(seed)
        estimate = estimate_pose(image, GRID, camera=given, image_size=SIZE)
        if estimate.status is Status.MISFIT:
            misfits += 1
            assert estimate.model is None
            assert estimate.camera_fit.evidence > 40.0
    assert Status.MISFIT.value == 'the calibration does not fit this image'
    assert misfits >= sample(0.75 * len(seeds), 0)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    'deviation',
    [
        {},
        {'bow_m': 0.002},
        {'wide': 0.01},
        {'shear': 0.02},
        {'noise_px': 1.0},
        {'shear': 0.02, 'wide': 0.01, 'bow_m': 0.001},
    ],
    ids=str,
)
@pytest.mark.parametrize('board', [GRID, MARKER], ids=['grid', 'marker'])
@pytest.mark.parametrize('tilt_deg', [(0.0, 15.0), (15.0, 60.0)], ids=str)
def test_a_right_calibration_is_never_refused(deviation, board, tilt_deg, sample):
    """Not even with bent boards, prints that are too wide, or a rolling shutter."""
    for seed in range(sample(100, 1)):
        image, _ = view(seed, board, tilt_deg, **deviation)
        estimate = estimate_pose(image, board, camera=TRUE, image_size=SIZE)
        assert estimate.status is not Status.MISFIT, seed
        assert estimate.camera_fit.evidence < 40.0 or len(board) == 4


def test_outliers_do_not_make_a_right_calibration_a_misfit(sample):
    for seed in range(sample(40, 1)):
        image, pose = view(seed)
        rng = np.random.default_rng(seed)
        outliers = rng.permutation(len(image))[:22]
        image[outliers] = rng.uniform((0.0, 0.0), SIZE, (22, 2))
        estimate = estimate_pose(image, GRID, camera=TRUE, image_size=SIZE)
        assert estimate.status is Status.CONFIDENT
        moved = estimate.model.camera_from_board.translation - pose.translation
        assert np.linalg.norm(moved) < 0.02


def test_a_wrong_calibration_is_refused_despite_outliers(sample):
    misfits = 0
    for seed in range(sample(20, 1)):
        image, _ = view(seed, tilt_deg=(35.0, 55.0))
        rng = np.random.default_rng(seed)
        image[rng.permutation(len(image))[:12]] = rng.uniform((0.0, 0.0), SIZE, (12, 2))
        estimate = estimate_pose(image, GRID, camera=camera(0.5, 0.5), image_size=SIZE)
        misfits += estimate.status is Status.MISFIT
    assert misfits >= sample(15, 0)


@pytest.mark.parametrize('focal', [0.5, 2.0])
def test_a_fronto_parallel_board_does_not_tell_a_wrong_focal_length(focal):
    """Such a view fits any focal length: nothing is claimed either way."""
    image, _ = view(0, tilt_deg=(0.0, 1.0))
    estimate = estimate_pose(image, GRID, camera=camera(focal, 1.0), image_size=SIZE)
    assert estimate.model is not None
    assert estimate.camera_fit.evidence == 0.0
    assert not proves_camera(estimate)


def test_a_single_marker_is_evidence_but_no_misfit(sample):
    """Of four points one that is off looks the same."""
    evidence = []
    for seed in range(sample(40, 1)):
        image, _ = view(seed, MARKER, (30.0, 60.0))
        estimate = estimate_pose(image, MARKER, camera=camera(0.5, 0.5), image_size=SIZE)
        assert estimate.status is not Status.MISFIT
        evidence.append(estimate.camera_fit.evidence)
    assert np.mean(np.array(evidence) > 4.0) >= sample(0.5, 0.0)


def test_views_prove_a_right_camera_and_hardly_a_wrong_one(sample):
    seeds = range(sample(60, 1))
    right, wrong = (
        [
            proves_camera(estimate_pose(view(s)[0], GRID, camera=known, image_size=SIZE))
            for s in seeds
        ]
        for known in (TRUE, camera(0.5, 0.5))
    )
    assert np.mean(right) >= sample(0.5, 0.0)
    assert np.mean(wrong) <= 0.05


def test_the_camera_fit_belongs_to_known_cameras_alone():
    image, _ = view(0)
    assert estimate_pose(image, GRID, image_size=SIZE).camera_fit is None
    fit = estimate_pose(image, GRID, camera=TRUE).camera_fit
    assert fit.stretch_chi2 < 9.0
    assert fit.evidence == 0.0


@pytest.mark.parametrize('stretch', [0.02, 0.05])
def test_the_stretch_of_a_board_is_measured(stretch):
    """Chi-square of a stretch along x against y, whose usual standard deviation is 0.006."""
    image, _ = view(3, noise_px=0.01)
    wider = GRID / [1.0 + stretch, 1.0 - stretch]
    fit = estimate_pose(image, wider, camera=TRUE).camera_fit
    assert fit.stretch_sigma < 0.003
    assert fit.stretch_chi2 == pytest.approx((stretch / 0.006) ** 2, rel=0.25)
