# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What pose_node publishes of its answers: poses for each board, and the camera."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from p4pfr_ros import PoseEstimate
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from .self_calibrating import Known
from ..conversions import (
    camera_info_division_msg,
    camera_info_from_model_msg,
    camera_info_msg,
    ImageFrame,
    pose_array_msg,
    pose_msg,
    pose_with_covariance_msg,
)
from ..runtime.endpoints import Endpoints, is_awaited, is_heard


class PoseOutputs:
    """
    The topics of one board.

    Parameters
    ----------
    endpoints
        Makes and takes down.
    prefix
        What the topics' names begin with: ``~``, or ``~/NAME``.

    """

    def __init__(self, endpoints: Endpoints, prefix: str) -> None:
        self._pose = endpoints.advertise(PoseStamped, f'{prefix}/pose')
        self._with_covariance = endpoints.advertise(
            PoseWithCovarianceStamped, f'{prefix}/pose_with_covariance'
        )
        self._alternatives = endpoints.advertise(PoseArray, f'{prefix}/alternatives')

    def is_heard(self) -> bool:
        """Return whether anybody listens, or may ask for the last answer later."""
        return any(map(is_awaited, (self._pose, self._with_covariance, self._alternatives)))

    def publish(self, header: Header, estimate: PoseEstimate) -> None:
        """Publish an estimate to who waits for it; one without a model leaves nothing to say."""
        if estimate.model is None:
            return
        pose, seen = estimate.model.camera_from_board, estimate.observable
        # The covariance can say that a number means nothing; the other messages cannot.
        if is_awaited(self._with_covariance):
            covariance = estimate.covariance[:6, :6]
            self._with_covariance.publish(pose_with_covariance_msg(header, pose, covariance))
        if seen.direction and seen.distance and is_awaited(self._pose):
            self._pose.publish(pose_msg(header, pose))
        if is_awaited(self._alternatives):
            others = [other.camera_from_board for other in estimate.alternatives]
            self._alternatives.publish(pose_array_msg(header, others))


class CameraOutputs:
    """
    The camera's topics: latched, so whoever comes late gets the camera in use, or K = 0.

    Parameters
    ----------
    endpoints
        Makes and takes down.

    """

    def __init__(self, endpoints: Endpoints) -> None:
        self._camera_info = endpoints.advertise(CameraInfo, '~/camera_info', latched=True)
        self._division = endpoints.advertise(CameraInfo, '~/camera_info_division', latched=True)
        self._told: tuple[Known, str, ImageFrame] | None = None

    def is_heard(self) -> bool:
        """Return whether anybody listens."""
        return is_heard(self._camera_info, self._division)

    def tell(
        self, header: Header, frame: ImageFrame, camera: Known, *, again: bool
    ) -> CameraInfoModel | None:
        """
        Publish a camera, again or if it was not told last; return its published model.

        A division camera is told as it is, and in a model that image_proc knows.
        """
        news = camera, header.frame_id, frame
        if news == self._told and not again:
            return None
        self._told = news
        if isinstance(camera, CameraInfoModel):
            model = camera
            self._division.publish(camera_info_msg(header, frame))
        else:
            model = camera.to_camera_info_model(frame.size)
            self._division.publish(camera_info_division_msg(header, frame, camera))
        self._camera_info.publish(camera_info_from_model_msg(header, frame, model))
        return model

    def take_back(self, stamp: Time) -> None:
        """Say that there is no such camera any more, if one was told."""
        if self._told is not None:
            _, frame_id, frame = self._told
            nothing = camera_info_msg(Header(stamp=stamp, frame_id=frame_id), frame)
            self._camera_info.publish(nothing)
            self._division.publish(nothing)
            self._told = None
