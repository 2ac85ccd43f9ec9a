# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a view does not tell is said, and a prior tells it."""

from errors import look
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose, Status
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

CAMERA = DivisionCamera(800.0, (639.5, 479.5), -0.1)
FACING = np.diag([1.0, -1.0, -1.0])
TILTED = FACING @ Pose.from_rotation_vector([0.6, 0.0, 0.0], np.zeros(3)).rotation
SQUARE = 0.1 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
GRID = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.4, 0.4, 7)), -1)
BOARDS = {
    'scattered': np.random.default_rng(12).uniform(-0.5, 0.5, (50, 2)),
    'grid': GRID.reshape(-1, 2),
    'square': 3.0 * SQUARE,
}
if COMPILED:  # all five thousand samples are drawn: a quarter of a minute, interpreted
    BOARDS['six points'] = np.random.default_rng(12).uniform(-0.5, 0.5, (6, 2))
AHEAD = Pose(FACING, [0.1, 0.05, 2.0])
FOCAL = {'prior_focal_px': 800.0, 'prior_focal_sigma_px': 10.0}
K = {'prior_k': -0.1, 'prior_k_sigma': 0.01}


def estimate(pose, board, noise_px=0.0, **options):
    return estimate_pose(
        look(CAMERA, pose, board, noise_px),
        board,
        image_size=IMAGE_SIZE,
        options=EstimateOptions(**options),
    )


def degrees(found, pose):
    turn = rotation_angle_rad(found.model.camera_from_board.rotation, pose.rotation)
    return np.degrees(turn)


@pytest.mark.parametrize('noise_px', [0.0, 0.3])
@pytest.mark.parametrize('board', BOARDS)
def test_straight_ahead_tells_the_direction_and_no_focal_length(board, noise_px):
    found = estimate(AHEAD, BOARDS[board], noise_px)
    assert {'distance', 'focal'} <= set(found.observable.undetermined)
    assert found.status in (Status.UNDETERMINED, Status.FOUR_POINTS)
    assert found.observable.direction
    assert degrees(found, AHEAD) < 3.0
    variance = np.diag(found.covariance)
    assert np.isinf(variance[[0, 1, 2, 6]]).all()
    assert np.isfinite(variance[3:6]).all()
    assert np.isnan(found.covariance[6, :6]).all()


@pytest.mark.parametrize('noise_px', [0.0, 0.3])
@pytest.mark.parametrize('board', BOARDS)
def test_a_known_focal_length_tells_the_distance(board, noise_px):
    found = estimate(AHEAD, BOARDS[board], noise_px, **FOCAL)
    assert found.observable.distance
    assert found.observable.focal
    assert found.model.camera.focal_px == pytest.approx(800.0, abs=5.0)
    assert found.model.camera_from_board.translation[2] == pytest.approx(2.0, rel=0.05)
    # Straight ahead the view adds nothing: the prior's own spread is left.
    deviation_px = np.sqrt(found.covariance[6, 6])
    assert 9.0 < deviation_px < 25.0


@pytest.mark.parametrize('board', BOARDS)
def test_with_both_known_all_is_told(board):
    found = estimate(AHEAD, BOARDS[board], 0.3, **FOCAL, **K)
    assert found.observable.undetermined == ()
    assert found.status in (Status.CONFIDENT, Status.SPENT, Status.FOUR_POINTS)
    assert np.isfinite(found.covariance).all()
    assert found.model.camera.k == pytest.approx(-0.1, abs=0.03)
    assert degrees(found, AHEAD) < 2.0


@pytest.mark.parametrize('pose', [Pose(TILTED, [0, 0, 0.6]), Pose(FACING, [0, 0, 1.0])])
def test_a_marker_in_the_middle_does_not_tell_the_distortion(pose):
    found = estimate(pose, SQUARE)
    assert 'distortion' in found.observable.undetermined
    assert np.isinf(found.covariance[7, 7])
    assert degrees(found, pose) < 3.0


def test_points_of_one_radius_leave_the_distortion_open():
    pose = Pose(TILTED, [0.0, 0.0, 1.0])
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring_px = CAMERA.center_px + 300.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    rays = CAMERA.unproject(ring_px) @ pose.rotation
    eye = pose.inverse().translation
    board = (eye - rays * eye[2] / rays[:, 2:])[:, :2]
    found = estimate(pose, board, 0.3)
    assert not found.observable.distortion
    assert found.observable.direction
    assert np.isinf(found.covariance[7, 7])
    assert degrees(found, pose) < 0.5
    known = estimate(pose, board, 0.3, **K)
    assert known.observable.undetermined == ()
    assert known.status is Status.CONFIDENT
    assert known.model.camera.focal_px == pytest.approx(800.0, rel=0.03)
    assert np.sqrt(known.covariance[7, 7]) == pytest.approx(0.01, rel=0.1)


def test_a_prior_and_a_good_view_agree_on_less_than_either():
    pose, board = Pose(TILTED, [0.1, 0.0, 0.9]), BOARDS['scattered']
    alone = estimate(pose, board, 0.5)
    both = estimate(pose, board, 0.5, prior_focal_px=800.0, prior_focal_sigma_px=2.0)
    spread_px = np.sqrt([e.covariance[6, 6] for e in (alone, both)])
    assert both.model is not None
    # Independent: their informations add up, but for the noise measured a little differently.
    assert spread_px[1] == pytest.approx((spread_px[0] ** -2 + 2.0**-2) ** -0.5, rel=0.05)


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'prior_focal_px': 800.0}, 'must be given together'),
        ({'prior_focal_sigma_px': 8.0}, 'must be given together'),
        ({'prior_focal_px': -1.0, 'prior_focal_sigma_px': 8.0}, 'prior_focal_px must be from'),
        ({'prior_k': -0.1}, 'prior_k must come with prior_k_sigma'),
        ({'prior_k_sigma': 0.0}, 'prior_k_sigma must be from 1e-09'),
        ({'prior_k': np.nan, 'prior_k_sigma': 0.1}, 'prior_k must be from -100 to 100, got nan'),
    ],
)
def test_half_a_prior_is_refused(options, complaint):
    with pytest.raises(ValueError, match=complaint):
        EstimateOptions(**options)


@pytest.mark.parametrize('noise_px', [0.05, 0.3])
def test_noise_does_not_make_a_focal_length_up(noise_px, sample):
    """Straight ahead, the estimate rests on a tilt that the noise has made up."""
    camera = DivisionCamera(520.0, (319.5, 239.5), -0.2)
    side_x, side_y = np.linspace(-0.1, 0.1, 6), np.linspace(-0.08, 0.08, 5)
    board = np.stack(np.meshgrid(side_x, side_y), axis=-1).reshape(-1, 2)
    for seed in range(sample(40, 3)):
        rng = np.random.default_rng(seed)
        pose = Pose(np.diag([1.0, -1.0, -1.0]), [*rng.uniform(-0.05, 0.05, 2), 0.5])
        image = camera.project(pose.transform(np.pad(board, ((0, 0), (0, 1)))))
        image += rng.normal(0.0, noise_px, image.shape)
        seen = estimate_pose(image, board, image_size=(640, 480)).observable
        assert not seen.focal
        assert not seen.distance
        assert seen.direction
