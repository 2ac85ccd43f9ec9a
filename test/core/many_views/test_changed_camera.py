# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A camera that changes, and one that was calibrated before."""

from calibration_views import calibrated, drawn, error, takes_long, verdicts, views_of
from errors import deviation
import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    DivisionCamera,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

pytestmark = takes_long


def test_one_wrong_view_does_not_count():
    camera = drawn(5)
    views = views_of(camera, 12, 5)
    calibration = calibrated(views)
    before = calibration.fused.camera
    other = DivisionCamera(1.4 * camera.focal_px, camera.center_px, camera.k)
    wrong = views_of(other, 1, 6, tilt_deg=(30.0, 50.0))[0]
    estimate = calibration.update(wrong.image_points, wrong.board_points)
    assert calibration.verdict is Verdict.OUTLIER
    assert calibration.fused.camera == before
    # It is answered for by itself: by a focal length of its own.
    assert estimate.model.camera.focal_px > 1.2 * before.focal_px


@pytest.mark.parametrize('zoom', [0.6, 1.1, 1.5])
def test_a_zoom_is_noticed_within_ten_views_and_recovered_from(zoom):
    for seed in range(8):
        camera = drawn(seed)
        calibration = calibrated(views_of(camera, 20, seed, noise_px=0.3))
        zoomed = DivisionCamera(zoom * camera.focal_px, camera.center_px, zoom**2 * camera.k)
        after = views_of(zoomed, 25, 100 + seed, noise_px=0.3)
        found = verdicts(calibration, after[:10])
        assert Verdict.RESTARTED in found
        verdicts(calibration, after[10:])
        assert calibration.fused.camera.focal_px == pytest.approx(zoomed.focal_px, rel=0.01)


def test_a_turn_of_the_focus_ring_shows_in_several_views_together():
    noticed = []
    for seed in range(8):
        camera = drawn(seed)
        calibration = calibrated(views_of(camera, 40, seed, noise_px=0.3))
        turned = DivisionCamera(1.03 * camera.focal_px, camera.center_px, 1.03**2 * camera.k)
        found = verdicts(calibration, views_of(turned, 20, 100 + seed, noise_px=0.3))
        noticed.append(Verdict.RESTARTED in found)
    assert np.mean(noticed) > 0.8


def test_no_alarm_without_a_change():
    for seed in range(10):
        found = verdicts(SelfCalibration(IMAGE_SIZE), views_of(drawn(seed), 60, seed))
        assert Verdict.RESTARTED not in found


def test_a_saved_calibration_goes_on():
    camera = drawn(7)
    views = views_of(camera, 30, 7)
    saved = calibrated(views[:20]).fused
    calibration = SelfCalibration(IMAGE_SIZE)
    calibration.load(saved)
    assert calibration.state is CalibrationState.CALIBRATED
    assert calibration.fused is saved
    estimate = calibration.update(views[20].image_points, views[20].board_points)
    assert estimate.model.camera.focal_px == pytest.approx(saved.camera.focal_px, rel=0.002)
    calibrated(views[21:], calibration)
    assert calibration.fused.focal_sigma_px < saved.focal_sigma_px
    off = error(calibration.fused.camera, camera)[0]
    assert abs(off) < 4.0 * calibration.fused.focal_sigma_px


def test_a_saved_calibration_of_another_zoom_is_given_up():
    camera, calibration = drawn(8), SelfCalibration(IMAGE_SIZE)
    calibration.load(calibrated(views_of(camera, 10, 8)).fused)
    zoomed = DivisionCamera(0.7 * camera.focal_px, camera.center_px, 0.49 * camera.k)
    found = verdicts(calibration, views_of(zoomed, 12, 9))
    assert Verdict.RESTARTED in found
    assert calibration.fused.camera.focal_px == pytest.approx(zoomed.focal_px, rel=0.02)


def test_reset_forgets():
    views = views_of(drawn(9), 6, 9)
    calibration = calibrated(views)
    first = calibrated(views).fused.camera
    calibration.reset()
    assert calibration.fused is None
    assert calibration.views == ()
    assert calibrated(views, calibration).fused.camera == first


def test_poses_of_the_changed_camera_say_how_unsure_they_are():
    squares = []
    for seed in range(40):
        camera = drawn(seed)
        calibration = calibrated(views_of(camera, 12, seed))
        zoomed = DivisionCamera(1.5 * camera.focal_px, camera.center_px, 2.25 * camera.k)
        view = views_of(zoomed, 1, 100 + seed, tilt_deg=(20.0, 60.0))[0]
        estimate = calibration.update(view.image_points, view.board_points)
        if calibration.verdict is Verdict.OUTLIER and not estimate.observable.undetermined:
            off = deviation(estimate.model, view)[:6]
            squares.append(off @ np.linalg.solve(estimate.covariance[:6, :6], off))
    assert len(squares) > 20
    assert 2.5 < np.median(squares) < 7.5  # of χ² with six degrees of freedom it is 5.35


def test_what_is_not_kept_is_remembered():
    camera = drawn(13)
    views = views_of(camera, 300, 13)
    few = SelfCalibration(IMAGE_SIZE, options=CalibrationOptions(max_views=10))
    calibrated(views[:40], few)
    early_px = few.fused.focal_sigma_px
    calibrated(views[40:], few)
    assert len(few.views) == 10
    # With √(300 / 40) = 2.7 times as sure in view; the first forty were chosen from, too.
    assert few.fused.focal_sigma_px < 0.6 * early_px
    off = error(few.fused.camera, camera)[:4]
    assert off @ np.linalg.solve(few.fused.covariance[:4, :4], off) < 20.0


def test_nonsense_between_the_views_changes_little_and_breaks_nothing():
    camera, calibration = drawn(14), SelfCalibration(IMAGE_SIZE)
    rng = np.random.default_rng(0)
    nonsense = [
        lambda image: rng.uniform((0, 0), IMAGE_SIZE, image.shape),  # anywhere
        lambda image: np.tile(image[:1], (len(image), 1)),  # all in one place
        lambda image: np.where(np.arange(len(image))[:, None] < 12, image[0], image),
        lambda image: 1e5 * image,
        lambda image: image[:, [0, 0]],  # on a line
        lambda image: image[::-1],  # in the wrong order
    ]
    for i, view in enumerate(views_of(camera, 48, 14)):
        calibration.update(view.image_points, view.board_points)
        calibration.update(nonsense[i % 6](view.image_points), view.board_points)
    off = error(calibration.fused.camera, camera)
    assert abs(off[0]) < 0.01 * camera.focal_px


def test_stray_views_between_those_of_a_board_that_stands_still_are_no_change():
    camera, rng = drawn(15), np.random.default_rng(1)
    calibration = calibrated(views_of(camera, 20, 15))
    still = views_of(camera, 1, 16, tilt_deg=(30.0, 50.0))[0]
    other = DivisionCamera(1.4 * camera.focal_px, camera.center_px, camera.k)
    found = []
    for wrong in views_of(other, 10, 17, tilt_deg=(30.0, 50.0)):
        for _ in range(3):
            again = still.image_points + rng.normal(0.0, 0.3, still.image_points.shape)
            calibration.update(again, still.board_points)
        calibration.update(wrong.image_points, wrong.board_points)
        found.append(calibration.verdict)
    assert set(found) == {Verdict.OUTLIER}
