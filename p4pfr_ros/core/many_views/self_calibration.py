# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``SelfCalibration``: the camera from all its views of flat boards, while they come in."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from .calibration_terms import CalibrationOptions, CalibrationState, KeptView, Verdict
from .calibration_view import calibration_view
from .camera_estimate import CameraEstimate
from .estimate import PoseEstimate, RansacOptions
from .fused_answer import fused_answer
from .kept_views import kept_views
from .learning import Learning
from .lone_answer import lone_answer
from .seen_by_fit import seen_by_fit
from .sighting import Sighting


class SelfCalibration:
    """
    Estimates one camera from its views, one at a time, and each view's pose by that camera.

    Focal length, centre and distortion are the camera's, a pose belongs to a view. A bounded set
    of views is kept for what they tell of the camera, and all are fitted together. A view that
    disagrees does not count; when views go on disagreeing, the camera has changed (zoom, focus),
    and is started over.

    Parameters
    ----------
    image_size
        (width, height) of the full raw picture, px.
    options
        How to calibrate.
    robust
        How to search each view; its priors and its noise hold for the camera.

    Raises
    ------
    ValueError
        The size is not positive.

    """

    def __init__(
        self,
        image_size: tuple[int, int],
        *,
        options: CalibrationOptions | None = None,
        robust: RansacOptions | None = None,
    ) -> None:
        width, height = image_size
        if not (width > 0 and height > 0):
            raise ValueError(f'image_size must be positive, got {image_size}')
        self.image_size = (int(width), int(height))
        self.options = options or CalibrationOptions()
        self.robust = robust or RansacOptions()
        self._learning = Learning(self.image_size, self.options, self.robust)

    def reset(self) -> None:
        """Forget all views, and the camera."""
        self._learning.start(None)

    def adopt(self, estimate: CameraEstimate) -> None:
        """Start over from a camera that is known: an earlier calibration, say."""
        self._learning.start(estimate)

    @property
    def state(self) -> CalibrationState:
        """How far the calibration is."""
        return self._learning.state

    @property
    def fused(self) -> CameraEstimate | None:
        """The camera and how sure it is; None while ``state`` is UNCALIBRATED."""
        return self._learning.fused

    @property
    def verdict(self) -> Verdict:
        """What became of the last view."""
        return self._learning.verdict

    @property
    def views(self) -> tuple[KeptView, ...]:
        """The views that the camera is estimated from, oldest first."""
        return kept_views(self._learning.fit)

    def update(
        self, image_points: ArrayLike, board_points: ArrayLike, stamp: Any = None
    ) -> PoseEstimate:
        """
        Take in one view, and estimate its pose.

        Parameters
        ----------
        image_points : (N, 2) array, N ≥ 4
            Pixels of the full raw picture; pixel centres are integers.
        board_points : (N, 2) array
            The same points on the board's plane Z = 0, metres.
        stamp
            Whatever tells the view from others; it is kept with it.

        Returns
        -------
        The estimate by the fused camera, whose errors its covariance holds. While there is no
        such camera, or where the view disagrees with it, the estimate by the view alone.

        Raises
        ------
        ValueError
            A wrong shape, or a number that is not finite.

        """
        sighting = self.look(image_points, board_points, stamp)
        self.learn(sighting)
        return self.answer(sighting)

    def look(
        self, image_points: ArrayLike, board_points: ArrayLike, stamp: Any = None
    ) -> Sighting:
        """Take a view as ``update`` does, but learn nothing from it yet."""
        view = calibration_view(image_points, board_points, self.image_size, stamp)
        return self._learning.sighting(view)

    def early_answer(self, sighting: Sighting) -> PoseEstimate | None:
        """
        Answer a view by the camera as it is, before it is learnt from, which takes longer.

        None where learning comes first: until the camera is CALIBRATED, or if the view disagrees.
        """
        if self.state is not CalibrationState.CALIBRATED or not sighting.agrees:
            return None
        assert sighting.by_fit is not None
        return fused_answer(sighting.by_fit, sighting.known, self.robust.threshold_px)

    def learn(self, sighting: Sighting) -> None:
        """Find what becomes of a view, the ``verdict``, and let the camera follow it."""
        self._learning.learn(sighting)

    def answer(self, sighting: Sighting) -> PoseEstimate:
        """Answer the view that was learnt from last: by the fused camera, where both agree."""
        learning = self._learning
        if learning.verdict is Verdict.OUTLIER:
            return lone_answer(sighting, learning.common)
        if learning.fused is None or learning.verdict is Verdict.UNUSED:
            return sighting.alone
        seen, fit = sighting.by_fit, learning.fit
        if seen is None or fit is not sighting.fit:
            is_last = bool(fit.views) and fit.views[-1] is sighting.view
            seen = seen_by_fit(sighting.view, fit.poses[-1] if is_last else sighting.row, fit)
        return fused_answer(seen, sighting.known_or_alone, self.robust.threshold_px)
