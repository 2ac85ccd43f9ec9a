# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The quantities that a view does not determine are marked, and priors determine them."""

from errors import project_board
from ideal import estimate_pose, ideal_options
import numpy as np
from p4pfr_ros import DivisionCamera, Pose, Status
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
if COMPILED:  # five thousand samples are drawn, which takes 15 s interpreted
    BOARDS['six points'] = np.random.default_rng(12).uniform(-0.5, 0.5, (6, 2))
FRONTO_PARALLEL = Pose(FACING, [0.1, 0.05, 2.0])
FOCAL_PRIOR = {'prior_focal_px': 800.0, 'prior_focal_sigma_px': 10.0}
K_PRIOR = {'prior_k': -0.1, 'prior_k_sigma': 0.01}


def estimate_view(pose, board, noise_px=0.0, **options):
    return estimate_pose(
        project_board(CAMERA, pose, board, noise_px),
        board,
        image_size=IMAGE_SIZE,
        options=ideal_options(**options),
    )


def rotation_error_deg(estimate, pose):
    error_rad = rotation_angle_rad(estimate.model.camera_from_board.rotation, pose.rotation)
    return np.degrees(error_rad)


@pytest.mark.parametrize('noise_px', [0.0, 0.3])
@pytest.mark.parametrize('board', BOARDS)
def test_a_fronto_parallel_view_determines_the_direction_but_no_focal_length(board, noise_px):
    estimate = estimate_view(FRONTO_PARALLEL, BOARDS[board], noise_px)
    assert {'distance', 'focal'} <= set(estimate.observable.undetermined)
    assert estimate.status in (Status.UNDETERMINED, Status.FOUR_POINTS)
    assert estimate.observable.direction
    assert rotation_error_deg(estimate, FRONTO_PARALLEL) < 3.0
    variance = np.diag(estimate.covariance)
    assert np.isinf(variance[[0, 1, 2, 6]]).all()
    assert np.isfinite(variance[3:6]).all()
    assert np.isnan(estimate.covariance[6, :6]).all()


@pytest.mark.parametrize('noise_px', [0.0, 0.3])
@pytest.mark.parametrize('board', BOARDS)
def test_a_prior_on_the_focal_length_determines_the_distance(board, noise_px):
    estimate = estimate_view(FRONTO_PARALLEL, BOARDS[board], noise_px, **FOCAL_PRIOR)
    assert estimate.observable.distance
    assert estimate.observable.focal
    assert estimate.model.camera.focal_px == pytest.approx(800.0, abs=5.0)
    assert estimate.model.camera_from_board.translation[2] == pytest.approx(2.0, rel=0.05)
    # A fronto-parallel view adds no information to that of the prior.
    sigma_px = np.sqrt(estimate.covariance[6, 6])
    assert 9.0 < sigma_px < 25.0


@pytest.mark.parametrize('board', BOARDS)
def test_priors_on_focal_length_and_k_determine_all_quantities(board):
    estimate = estimate_view(FRONTO_PARALLEL, BOARDS[board], 0.3, **FOCAL_PRIOR, **K_PRIOR)
    assert estimate.observable.undetermined == ()
    assert estimate.status in (Status.CONFIDENT, Status.SPENT, Status.FOUR_POINTS)
    assert np.isfinite(estimate.covariance).all()
    assert estimate.model.camera.k == pytest.approx(-0.1, abs=0.03)
    assert rotation_error_deg(estimate, FRONTO_PARALLEL) < 2.0


@pytest.mark.parametrize('pose', [Pose(TILTED, [0, 0, 0.6]), Pose(FACING, [0, 0, 1.0])])
def test_a_marker_in_the_middle_does_not_determine_the_distortion(pose):
    estimate = estimate_view(pose, SQUARE)
    assert 'distortion' in estimate.observable.undetermined
    assert np.isinf(estimate.covariance[7, 7])
    assert rotation_error_deg(estimate, pose) < 3.0


def test_points_at_one_radius_do_not_determine_the_distortion():
    pose = Pose(TILTED, [0.0, 0.0, 1.0])
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring_px = CAMERA.center_px + 300.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    rays = CAMERA.unproject(ring_px) @ pose.rotation
    camera_in_board = pose.inverse().translation
    board = (camera_in_board - rays * camera_in_board[2] / rays[:, 2:])[:, :2]
    estimate = estimate_view(pose, board, 0.3)
    assert not estimate.observable.distortion
    assert estimate.observable.direction
    assert np.isinf(estimate.covariance[7, 7])
    assert rotation_error_deg(estimate, pose) < 0.5
    with_prior = estimate_view(pose, board, 0.3, **K_PRIOR)
    assert with_prior.observable.undetermined == ()
    assert with_prior.status is Status.CONFIDENT
    assert with_prior.model.camera.focal_px == pytest.approx(800.0, rel=0.03)
    assert np.sqrt(with_prior.covariance[7, 7]) == pytest.approx(0.01, rel=0.1)


def test_the_information_of_a_prior_and_of_a_view_adds_up():
    pose, board = Pose(TILTED, [0.1, 0.0, 0.9]), BOARDS['scattered']
    alone = estimate_view(pose, board, 0.5)
    both = estimate_view(pose, board, 0.5, prior_focal_px=800.0, prior_focal_sigma_px=2.0)
    sigmas_px = np.sqrt([e.covariance[6, 6] for e in (alone, both)])
    assert both.model is not None
    # Not exactly: each estimate measures the noise anew.
    assert sigmas_px[1] == pytest.approx((sigmas_px[0] ** -2 + 2.0**-2) ** -0.5, rel=0.05)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'prior_focal_px': 800.0}, 'must be given together'),
        ({'prior_focal_sigma_px': 8.0}, 'must be given together'),
        ({'prior_focal_px': -1.0, 'prior_focal_sigma_px': 8.0}, 'prior_focal_px must be from'),
        ({'prior_k': -0.1}, 'prior_k must come with prior_k_sigma'),
        ({'prior_k_sigma': 0.0}, 'prior_k_sigma must be from 1e-09'),
        ({'prior_k': np.nan, 'prior_k_sigma': 0.1}, 'prior_k must be from -100 to 100, got nan'),
    ],
)
def test_an_incomplete_prior_is_rejected(options, message):
    with pytest.raises(ValueError, match=message):
        ideal_options(**options)


@pytest.mark.parametrize('noise_px', [0.05, 0.3])
def test_noise_does_not_make_the_focal_length_observable(noise_px, sample):
    """The estimate from a fronto-parallel view rests on a tilt that is noise."""
    camera = DivisionCamera(520.0, (319.5, 239.5), -0.2)
    side_x, side_y = np.linspace(-0.1, 0.1, 6), np.linspace(-0.08, 0.08, 5)
    board = np.stack(np.meshgrid(side_x, side_y), axis=-1).reshape(-1, 2)
    for seed in range(sample(40, 3)):
        rng = np.random.default_rng(seed)
        pose = Pose(np.diag([1.0, -1.0, -1.0]), [*rng.uniform(-0.05, 0.05, 2), 0.5])
        image = camera.project(pose.transform(np.pad(board, ((0, 0), (0, 1)))))
        image += rng.normal(0.0, noise_px, image.shape)
        observable = estimate_pose(image, board, image_size=(640, 480)).observable
        assert not observable.focal
        assert not observable.distance
        assert observable.direction
