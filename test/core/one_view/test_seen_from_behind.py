# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A printed board is opaque: a mirrored order of its points has no pose."""

from calibration_views import BOARD, calibrate, draw_views, seeded_camera
from errors import project_board
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose, Status, Verdict
from p4pfr_ros.core.one_view import estimate_pose as module
from p4pfr_ros.core.one_view.ransac import is_mirrored
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view
import pytest

CAMERA = DivisionCamera(800.0, (639.5, 479.5), -0.1)
HEAD_ON = Pose(np.diag([1.0, -1.0, -1.0]), [0.1, -0.05, 1.3])
TILTED = HEAD_ON @ Pose.from_rotation_vector([0.5, 0.3, 0.2], np.zeros(3))
TAG = 0.5 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
OFFSETS = np.array([[-0.3, 0.3], [0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
BUNDLE = (OFFSETS[:, None] + 0.4 * TAG).reshape(-1, 2)
CLOUD = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 2))
# Per board: its points, and the orders in which a detector that mirrors gives them.
REVERSED = np.array([3, 2, 1, 0])
BOARDS = {
    'tag': (TAG, REVERSED),
    'bundle': (BUNDLE, np.arange(16)),
    'grid': (BOARD, np.arange(24)),
    'cloud': (CLOUD, np.arange(40)),
}
KNOWN = {
    'free': {'image_size': IMAGE_SIZE},
    'division': {'camera': CAMERA},
    'plumb_bob': {'camera': CAMERA.to_camera_info_model(IMAGE_SIZE)},
}
OPTIONS = {'ideal': EstimateOptions.ideal(), 'default': EstimateOptions()}
over_boards = pytest.mark.parametrize('name', BOARDS)
over_cameras = pytest.mark.parametrize('known', KNOWN.values(), ids=KNOWN)
over_options = pytest.mark.parametrize('options', OPTIONS.values(), ids=OPTIONS)
over_votes = pytest.mark.parametrize('vote', [True, False], ids=['by points', 'by pose'])


def view_of(name, *, mirrored):
    """Return the image points (N, 2) and board points (N, 2) of a board."""
    board, order = BOARDS[name]
    image = project_board(CAMERA, TILTED, board, 0.3, seed=5)
    if not mirrored:
        return image, board
    # A tag's corners go round the other way; of other boards x is mirrored.
    return (image[order], board) if name == 'tag' else (image, board * [-1.0, 1.0])


@over_boards
@over_cameras
@over_options
@over_votes
def test_a_mirrored_order_is_seen_from_behind(name, known, options, vote, monkeypatch):
    """The points say so before the search; where they do not, the pose says so after it."""
    if not vote:
        monkeypatch.setattr(module, 'is_mirrored', lambda *_: False)
    estimate = estimate_pose(*view_of(name, mirrored=True), options=options, **known)
    assert (estimate.status, estimate.model) == (Status.SEEN_FROM_BEHIND, None)
    assert estimate.alternatives == ()
    assert (estimate.iterations == 0) == vote
    assert np.isnan(estimate.covariance).all()
    assert estimate.inliers.shape == (len(BOARDS[name][0]),)
    assert not estimate.inliers.any()


@over_boards
@over_cameras
@over_options
def test_the_right_order_has_a_pose_that_faces_the_camera(name, known, options):
    estimate = estimate_pose(*view_of(name, mirrored=False), options=options, **known)
    poses = [s.camera_from_board for s in (estimate.model, *estimate.alternatives)]
    assert not any(pose.shows_back for pose in poses)
    assert estimate.model.camera_from_board.tilt_deg < 90.0


@over_boards
@over_cameras
def test_a_two_sided_board_may_be_seen_from_behind(name, known):
    options = EstimateOptions(two_sided=True)
    estimate = estimate_pose(*view_of(name, mirrored=True), options=options, **known)
    assert estimate.model.camera_from_board.shows_back


@over_cameras
def test_a_mirrored_order_among_outliers_is_seen_from_behind(known):
    """Of 40 points 16 are wrong, so the triangles are not clear: the search decides."""
    image, board = view_of('cloud', mirrored=True)
    image = image.copy()
    image[:16] = np.random.default_rng(1).uniform((0, 0), IMAGE_SIZE, (16, 2))
    estimate = estimate_pose(image, board, **known)
    assert (estimate.status, estimate.model) == (Status.SEEN_FROM_BEHIND, None)
    assert estimate.iterations > 0


@over_cameras
def test_a_tag_whose_corners_are_shifted_has_a_turned_pose(known):
    """A square looks the same after a quarter turn, so this error cannot be detected."""
    image, board = view_of('tag', mirrored=False)
    estimate = estimate_pose(np.roll(image, 1, axis=0), board, **known)
    turn = Pose.from_rotation_vector([0.0, 0.0, np.pi / 2.0], np.zeros(3))
    expected = estimate_pose(image, board, **known).model.camera_from_board @ turn
    np.testing.assert_allclose(
        estimate.model.camera_from_board.rotation, expected.rotation, atol=1e-6
    )


@over_cameras
@pytest.mark.parametrize('order', [[1, 0, 2, 3], [0, 2, 1, 3]])
def test_a_tag_whose_sides_cross_has_no_pose(known, order):
    image, board = view_of('tag', mirrored=False)
    assert estimate_pose(image[order], board, **known).model is None


def test_views_of_the_front_are_never_taken_for_mirrored(sample):
    """At any tilt, with outliers. Of some more points the vote is clear if they are mirrored."""
    rng = np.random.default_rng(7)
    for _ in range(sample(400, 20)):
        n, share = int(rng.integers(4, 40)), float(rng.choice([0.0, 0.3, 0.6]))
        drawn = draw_view(rng, n, outlier_share=share, tilt_deg=(0.0, 85.0))
        image, board = drawn.image_points - CAMERA.center_px, drawn.board_points
        if n == 4 and share:
            continue  # without one right triangle any order is possible
        assert not is_mirrored(image, board, 4.0)
        if n > 7 and share == 0.0 and drawn.camera_from_board.tilt_deg < 60.0:
            assert is_mirrored(image, board * [1.0, -1.0], 4.0)


def test_alternatives_that_show_the_back_are_dropped():
    """Near the edge-on view noise may leave a pose on either side."""
    front = estimate_pose(*view_of('grid', mirrored=False), image_size=IMAGE_SIZE)
    options = EstimateOptions(two_sided=True)
    back = estimate_pose(
        *view_of('grid', mirrored=True), image_size=IMAGE_SIZE, options=options
    ).model
    both = module.replace(front, alternatives=(back, front.model))
    assert module._of_visible_side(both, EstimateOptions()).alternatives == (front.model,)
    assert module._of_visible_side(both, options).alternatives == (back, front.model)


@pytest.mark.parametrize('count', [2, 10], ids=['converging', 'calibrated'])
def test_mirrored_views_leave_a_calibration_as_it_is(count):
    views = draw_views(seeded_camera(0), count + 1)
    calibration = calibrate(views[:count])
    state, fused, keyframes = calibration.state, calibration.fused, calibration.views
    poses = []
    for view in 5 * draw_views(seeded_camera(0), 4, seed=1):
        board = view.board_points * [-1.0, 1.0]
        estimate = calibration.update(view.image_points, board, on_pose=poses.append)
        assert calibration.verdict is Verdict.NO_POSE
        assert (estimate.status, estimate.model) == (Status.SEEN_FROM_BEHIND, None)
        assert poses.pop() is estimate
        assert not poses
    assert calibration.state is state
    assert calibration.fused is fused
    assert calibration.views == keyframes
    calibrate(views[count:], calibration)
    assert calibration.verdict in (Verdict.USED, Verdict.REDUNDANT)
