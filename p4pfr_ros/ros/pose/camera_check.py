# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Holds the views against a given camera: a calibration of another binning, zoom or device.

A view that shows by itself that the camera does not fit has no pose. Others, such as those of a
single marker, add up: evidence minus what views of a right camera have now and then, never below
zero (CUSUM, Page 1954). Once it is large, no pose is published until several views prove the
camera, or another camera is given.

This module stands alone because it is one statistical test, without ROS.
"""

from __future__ import annotations

import numpy as np
from p4pfr_ros import DivisionCamera, PoseEstimate, Status
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.one_view.camera_fit import proves_camera
from p4pfr_ros.core.one_view.results import no_estimate

# Evidence is a chi-square of one degree of freedom. A view adds what exceeds the usual, up to a
# share of what is large, so that it takes two views at least; four if they have four points, of
# which one that is off looks like another camera. A view without evidence subtracts a little.
_USUAL = 4.0
_LARGE = 25.0
_SHARE, _SHARE_OF_FOUR = 0.5, 0.25
_DECAY = 0.5

# Number of views that prove a camera, since the last one with evidence against it.
_PROOFS = 3

# A view whose points have moved by less than this share of the image's diagonal repeats the last.
_MOVED = 0.02

# The principal point of a camera is in the central half of its image. That of an image of half the
# size is on the edge of that half, give or take a pixel.
_CENTRAL = 0.24


class CameraCheck:
    """
    Judges the given camera by its views.

    Attributes
    ----------
    reason
        Why poses are withheld; empty while they are not.

    """

    def __init__(self) -> None:
        self.reason = ''
        self._camera: DivisionCamera | CameraInfoModel | None = None
        self._image_size = (0, 0)
        self._evidence = 0.0
        self._against = self._proofs = 0
        self._boxes: dict[str, Array] = {}

    def judged(
        self,
        camera: DivisionCamera | CameraInfoModel,
        image_size: tuple[int, int],
        board: str,
        image_points: Array,
        estimate: PoseEstimate,
    ) -> PoseEstimate:
        """
        Return the estimate of a view, or one of status MISFIT while the camera does not fit.

        board: any name of the board; image_points (N, 2): of the full raw image, px.
        """
        if camera != self._camera or image_size != self._image_size:
            self._start(camera, image_size)
        if self._has_moved(board, image_points):
            self._count(estimate)
        poor = estimate.status is Status.NO_CONSENSUS
        if self.reason and (estimate.model is not None or poor):
            return no_estimate(Status.MISFIT, len(image_points), estimate.iterations)
        return estimate

    def _start(
        self, camera: DivisionCamera | CameraInfoModel, image_size: tuple[int, int]
    ) -> None:
        self._camera, self._image_size = camera, image_size
        self._evidence, self._against, self._proofs = 0.0, 0, 0
        self._boxes.clear()
        size, center = np.array(image_size), np.array(camera.center_px)
        is_central = np.abs(center - 0.5 * (size - 1.0)) < _CENTRAL * size
        (x, y), (width, height) = center, image_size
        self.reason = (
            ''
            if is_central.all()
            else f'principal point ({x:.0f}, {y:.0f}) of an image of {width}x{height} px: '
            f'{Status.MISFIT.value}'
        )

    def _has_moved(self, board: str, image_points: Array) -> bool:
        """Return whether the points have moved since the last view of the board that counted."""
        box = np.concatenate([image_points.min(axis=0), image_points.max(axis=0)])
        before = self._boxes.get(board)
        least_px = _MOVED * float(np.hypot(*self._image_size))
        if before is not None and np.abs(box - before).max() < least_px:
            return False
        self._boxes[board] = box
        return True

    def _count(self, estimate: PoseEstimate) -> None:
        fit = estimate.camera_fit
        if fit is not None and fit.evidence > _USUAL:
            share = _SHARE if len(estimate.inliers) > 4 else _SHARE_OF_FOUR
            self._evidence += min(fit.evidence - _USUAL, share * _LARGE)
            self._against += 1
            self._proofs = 0
        else:
            self._evidence = max(self._evidence - _DECAY, 0.0)
            self._proofs += proves_camera(estimate)
        if self._evidence == 0.0:
            self._against = 0
        if self._evidence >= _LARGE and not self.reason:
            self.reason = (
                f'{Status.MISFIT.value}: {self._against} views ask for another focal length or '
                'principal point. Is it of another binning, zoom or camera?'
            )
        if self._proofs >= _PROOFS:
            self.reason, self._evidence, self._against = '', 0.0, 0
