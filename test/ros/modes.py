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

"""The modes of the node without a node: views in, answers and news out."""

from typing import NamedTuple

from p4pfr_ros import DivisionCamera, PoseEstimate
from p4pfr_ros.ros.intrinsics import Intrinsics
from p4pfr_ros.ros.options import PoseNodeOptions
from p4pfr_ros.ros.parameters import replaced
from p4pfr_ros.ros.rejections import Rejected
from p4pfr_ros.ros.self_calibrating import SelfCalibrating

NO_CAMERA_INFO = Rejected('no_camera_info', 'none has come')
LEARNING = 60


def options(mode, **values):
    """Return pose_node's options in a mode."""
    named = {name.replace('__', '.'): value for name, value in values.items()}
    return replaced(PoseNodeOptions(), {'intrinsics.mode': mode} | named)


def fixed(camera):
    """Return the options of the mode fixed with a camera."""
    x, y = camera.center_px
    values = {'intrinsics__focal_px': camera.focal_px, 'intrinsics__k': camera.k}
    return options('fixed', image__center_x_px=x, image__center_y_px=y, **values)


SELF_CALIBRATE, FREEZE = options('self_calibrate'), options('fixed')


class Answered(NamedTuple):
    """A moment's answer, and what it has brought besides."""

    estimate: PoseEstimate
    camera: DivisionCamera | None
    remark: Rejected | None


class Modes:
    """The modes of one node, and the camera that it finds."""

    def __init__(self, loaded=None, model=NO_CAMERA_INFO):
        self.found = SelfCalibrating(loaded)
        self._intrinsics = Intrinsics(self.found, lambda: model)

    def look(self, moment, settings=SELF_CALIBRATE):
        """Answer one moment; nothing may have been learnt from it yet."""
        return self._intrinsics.answer(moment.view, settings)

    def answer(self, moment, settings=SELF_CALIBRATE):
        """Answer one moment, and learn from it."""
        answer = self.look(moment, settings)
        if isinstance(answer, Rejected):
            return answer
        news = answer.news()
        return Answered(answer.estimate, news.camera, news.remark)

    def learn(self, moments, settings=SELF_CALIBRATE):
        """Answer many; return the last answer."""
        return [self.answer(moment, settings) for moment in moments][-1]
