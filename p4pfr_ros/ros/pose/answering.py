# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From what was seen in a picture to what is published of it, and to what is said of it."""

from __future__ import annotations

from collections.abc import Iterable
import time

from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from .calibration_keeper import CalibrationKeeper
from .camera_source import Answer, Intrinsics, View
from .inputs import Found
from .pictures import outside, Pictures
from .publishing import Publishing
from .reports import Reports
from .seen_board import SeenBoard
from ..parameters.intrinsics_options import SELF_CALIBRATE
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.rejections import Rejected


class Answering:
    """
    Answers the boards of a picture, one after the other.

    Parameters
    ----------
    keeper
        Looks after the calibration.
    publishing
        Takes the answers.
    reports
        Hears of everything.

    """

    def __init__(
        self, keeper: CalibrationKeeper, publishing: Publishing, reports: Reports
    ) -> None:
        self._keeper, self._publishing, self._reports = keeper, publishing, reports
        self._pictures = Pictures()
        self._intrinsics = Intrinsics(keeper.found, self._pictures.model)

    def on_camera_info(self, msg: CameraInfo) -> None:
        """Take what is said of the pictures."""
        rejected = self._pictures.hear(msg)
        if rejected is not None:
            self._reports.reject(rejected)

    def reset(self) -> None:
        """Start the calibration over, as if nothing had been seen or loaded."""
        self._keeper.reset()
        self._publishing.forget()
        self._reports.calibrated(self._keeper.found)

    def on_found(self, header: Header, found: Iterable[Found], options: PoseNodeOptions) -> None:
        """Answer all boards of one picture, those that can be."""
        received_s = time.monotonic()
        self._reports.received(received_s)
        answered = []
        for one in found:
            board = self._seen_board(header, one, options)
            if isinstance(board, Rejected):
                self._reports.reject(board)
            elif self._is_wanted(board, options):
                answer = self._answer(board, options, received_s)
                if answer is not None:
                    answered.append((board, answer))
        # All poses are on their way: now there is time to learn.
        for board, answer in answered:
            self._learn(board, answer, options)

    def _seen_board(
        self, header: Header, found: Found, options: PoseNodeOptions
    ) -> SeenBoard | Rejected:
        """Put together what is known of a board in a picture; some of it may not be."""
        if isinstance(found, Rejected):
            return found
        target, points = found
        frame = self._pictures.frame(options.image)
        if isinstance(frame, Rejected):
            return frame
        full_px = frame.full_from_sent(points.image_points)
        beyond = outside(full_px, frame)
        return beyond or SeenBoard(header, frame, target, points, full_px)

    def _is_wanted(self, board: SeenBoard, options: PoseNodeOptions) -> bool:
        """Return whether there is anything to learn, or anybody to hear the answer."""
        learns = options.intrinsics.mode == SELF_CALIBRATE
        return learns or self._publishing.is_heard(board.target, options)

    def _answer(
        self, board: SeenBoard, options: PoseNodeOptions, received_s: float
    ) -> Answer | None:
        self._reports.remark(self._pictures.remark_on(board.header))
        answer = self._intrinsics.answer(_view(board), options)
        if isinstance(answer, Rejected):
            self._reports.reject(answer)
            return None
        self._publishing.show(board, answer.estimate, options)
        self._reports.answered(board.stamp_ns, answer.estimate, received_s)
        return answer

    def _learn(self, board: SeenBoard, answer: Answer, options: PoseNodeOptions) -> None:
        news = answer.news()
        self._reports.remark(news.remark)
        self._reports.published(self._publishing.tell(board, news.camera, options))
        if options.intrinsics.mode == SELF_CALIBRATE:
            unsaved = self._keeper.look_after(
                board.header, board.frame, options, restarted=news.restarted
            )
            self._reports.remark(unsaved)
            self._reports.calibrated(self._keeper.found, restarted=news.restarted)
        else:
            self._reports.calibrated(None)


def _view(board: SeenBoard) -> View:
    points = board.points.board_points
    return View(board.image_points, points, board.frame.size, board.stamp_ns)
