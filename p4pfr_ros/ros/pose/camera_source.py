# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From a view to its answer, by each of the modes: how the camera comes to be known.

No message and no node in here: views in, answers out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import functools

from p4pfr_ros import (
    CalibrationOptions,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    PoseEstimate,
)
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import Array

from .self_calibrating import Known, News, SelfCalibrating
from ..parameters.calibration_options import SelfCalibrationOptions
from ..parameters.intrinsics_options import CAMERA_INFO, FIXED, PER_FRAME, SELF_CALIBRATE
from ..parameters.pose_options import PoseNodeOptions
from ..parameters.robust_options import RobustOptions
from ..runtime.rejections import Rejected


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """
    One board in one picture.

    image_points (N, 2) px of the full raw picture, whose size is image_size; board_points (N, 2)
    metres; stamp_ns: when it was taken.
    """

    image_points: Array
    board_points: Array
    image_size: tuple[int, int]
    stamp_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """
    What is known of a view.

    estimate
        Its pose and camera, or why there are none.
    news
        Learns from the view, once, and returns what came of that. The pose need not wait for it.
    """

    estimate: PoseEstimate
    news: Callable[[], News] = News


class Intrinsics:
    """
    The four modes, and what they remember; another mode may be chosen for every view.

    Parameters
    ----------
    self_calibrating
        The camera that is being found.
    latest_model
        Gives the latest CameraInfo's model, or why there is none.

    """

    def __init__(
        self,
        self_calibrating: SelfCalibrating,
        latest_model: Callable[[], CameraInfoModel | Rejected],
    ) -> None:
        self._self_calibrating = self_calibrating
        self._latest_model = latest_model
        self._answers = {
            SELF_CALIBRATE: self._self_calibrated,
            PER_FRAME: self._per_frame,
            FIXED: self._fixed,
            CAMERA_INFO: self._by_camera_info,
        }

    def answer(self, view: View, options: PoseNodeOptions) -> Answer | Rejected:
        """Answer a view by the mode that the options name."""
        return self._answers[options.intrinsics.mode](view, options)

    def fixed_camera(
        self, options: PoseNodeOptions, image_size: tuple[int, int]
    ) -> Known | Rejected:
        """Return what the mode fixed looks through: given, loaded or found."""
        given = options.intrinsics
        if given.focal_px > 0.0:
            center_px = options.image.center_px(image_size)
            return DivisionCamera(given.focal_px, center_px, given.k, given.k2, given.k3)
        return self._self_calibrating.known_camera(image_size)

    def _self_calibrated(self, view: View, options: PoseNodeOptions) -> Answer:
        found = self._self_calibrating
        size_news = found.make_ready(
            view.image_size, _search(options.robust), _calibration(options.calibration)
        )
        estimate, learn = found.answer(view.image_points, view.board_points, view.stamp_ns)

        def news() -> News:
            learnt = learn()
            return News(
                learnt.camera,
                size_news.remark or learnt.remark,
                size_news.restarted or learnt.restarted,
            )

        return Answer(estimate, news)

    def _per_frame(self, view: View, options: PoseNodeOptions) -> Answer:
        estimate = estimate_pose(
            view.image_points,
            view.board_points,
            image_size=view.image_size,
            center_px=options.image.center_px(view.image_size),
            options=_search(options.robust),
        )
        seen = estimate.observable
        told = estimate.model is not None and seen.focal and seen.distortion
        camera = estimate.model.camera if estimate.model and told else None
        return Answer(estimate, lambda: News(camera))

    def _fixed(self, view: View, options: PoseNodeOptions) -> Answer | Rejected:
        camera = self.fixed_camera(options, view.image_size)
        if isinstance(camera, Rejected):
            return camera
        estimate = _pose_by(camera, view, _search(options.robust))
        return Answer(estimate, lambda: News(camera))

    def _by_camera_info(self, view: View, options: PoseNodeOptions) -> Answer | Rejected:
        model = self._latest_model()
        if isinstance(model, Rejected):
            return model
        return Answer(_pose_by(model, view, _search(options.robust)))


# Both stay the same from view to view, mostly.
@functools.lru_cache(maxsize=4)
def _search(options: RobustOptions) -> EstimateOptions:
    return options.ransac()


@functools.lru_cache(maxsize=4)
def _calibration(options: SelfCalibrationOptions) -> CalibrationOptions:
    return options.core()


def _pose_by(camera: Known, view: View, options: EstimateOptions) -> PoseEstimate:
    return estimate_pose(view.image_points, view.board_points, camera=camera, options=options)
