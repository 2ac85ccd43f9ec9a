# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``LiveSession``: from an image to a better camera, and to what a person needs to see of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import enum
from pathlib import Path
import threading
import time
from typing import Any

from p4pfr_ros import (
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    EstimateOptions,
    Keyframe,
    PoseEstimate,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.boards import Board
from p4pfr_ros.detection import detect, Detection
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.guidance import directions, Guide, NextView

# The rate is measured over so many images; reasons of rejections and changes of the camera are
# listed for so many.
_RATE_IMAGES, _MOST_REJECTED, _MOST_CHANGES = 15, 30, 400
# Rejections for the same reason at most this far apart, images, are one entry of the list.
_SAME_REJECTION = 30


class SourceState(enum.Enum):
    """What the source of the images does; the value is a word to print."""

    WAITING = 'waiting'
    RUNNING = 'running'
    ENDED = 'ended'
    FAILED = 'failed'


@dataclass(frozen=True, slots=True, eq=False)
class BoardInImage:
    """A board's detection in an image, with its estimate and verdict if it was detected."""

    board: Board
    detection: Detection
    estimate: PoseEstimate | None = None
    verdict: Verdict | None = None


@dataclass(frozen=True, slots=True)
class RejectedView:
    """Why views were rejected: the reason, the number of them, and the last image's name."""

    reason: str
    board: str
    count: int
    name: str
    number: int


@dataclass(frozen=True, slots=True)
class CameraChange:
    """The camera after an image whose view was used: its number, and focal length ± σ, pixels."""

    number: int
    focal_px: float
    focal_sigma_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """
    The calibration after its last change.

    Parameters
    ----------
    version
        Counts the changes.
    image_size
        Width and height of the images, pixels; None before the first.
    state, estimate, missing, views
        The state, the camera if there is one, advice, and the keyframes.
    target
        The next view.
    changes
        The course of the camera, the latest change last.

    """

    version: int = 0
    image_size: tuple[int, int] | None = None
    state: CalibrationState = CalibrationState.UNCALIBRATED
    estimate: CameraEstimate | None = None
    missing: tuple[str, ...] = ('show the board',)
    views: tuple[Keyframe, ...] = ()
    target: NextView | None = None
    changes: tuple[CameraChange, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """
    All that is known at one moment; it does not change.

    Parameters
    ----------
    sequence
        Number of the snapshot: each change makes a new one.
    source, source_name, source_detail
        The state of the source, its name, and why it failed.
    is_paused
        Whether images are ignored.
    image, name, number
        The last image, its name, and its number from 1; None and 0 before the first.
    rate_hz
        Images per second; 0 if unknown.
    boards
        What was found of each board in the last image.
    progress
        The calibration.
    advice
        How to move the board to the target: empty if it is there, None if it is not visible.
    rejected
        The rejected views, the latest one last.
    saved
        Where the camera was saved last, as a sentence.

    """

    sequence: int = 0
    source: SourceState = SourceState.WAITING
    source_name: str = ''
    source_detail: str = ''
    is_paused: bool = False
    image: ImageArray | None = None
    name: str = ''
    number: int = 0
    rate_hz: float = 0.0
    boards: tuple[BoardInImage, ...] = ()
    progress: Progress = Progress()
    advice: tuple[str, ...] | None = None
    rejected: tuple[RejectedView, ...] = ()
    saved: str = ''


class LiveSession:
    """
    Calibrates a camera from images as they come, and keeps a `Snapshot` for those who watch.

    One thread calls `process`; any thread may call the other methods.

    Parameters
    ----------
    boards
        The boards to detect, by name; the first one is the one to hold.
    output
        Where to save the camera.
    camera_name
        camera_name in the output.
    options, robust
        See `SelfCalibration`.

    """

    def __init__(
        self,
        boards: Mapping[str, Board],
        output: Path,
        camera_name: str = 'camera',
        *,
        options: CalibrationOptions | None = None,
        robust: EstimateOptions | None = None,
    ) -> None:
        self._boards = tuple(boards.values())
        self.output, self.camera_name = output, camera_name
        self.options = options or CalibrationOptions()
        self._robust = robust or EstimateOptions()
        self._saved: Calibration | None = None
        self._lock = threading.RLock()
        self._listeners: list[Callable[[], None]] = []
        self._snapshot = Snapshot()
        self._calibration: SelfCalibration | None = None
        self._times_s: deque[float] = deque(maxlen=_RATE_IMAGES)
        self._restart()

    @property
    def snapshot(self) -> Snapshot:
        """The present state."""
        return self._snapshot

    @property
    def saved(self) -> Calibration | None:
        """The camera that was saved last, since the last reset."""
        return self._saved

    @property
    def is_saved(self) -> bool:
        """Whether the present camera is saved, or there is none."""
        estimate = self._snapshot.progress.estimate
        return estimate is None or (self._saved is not None and self._saved.estimate is estimate)

    def add_listener(self, listener: Callable[[], None]) -> None:
        """Call a function after each change, in the thread that made it."""
        self._listeners.append(listener)

    def set_source(self, state: SourceState, name: str, detail: str = '') -> None:
        """Set what the source of the images does."""
        self._publish(source=state, source_name=name, source_detail=detail)

    def pause(self, *, is_paused: bool) -> None:
        """Ignore images from now on, or no longer."""
        with self._lock:
            self._times_s.clear()
            self._publish(is_paused=is_paused, rate_hz=0.0)

    def set_options(self, options: CalibrationOptions, robust: EstimateOptions) -> None:
        """Set the options; the calibration restarts if they are others."""
        with self._lock:
            if (options, robust) != (self.options, self._robust):
                self.options, self._robust = options, robust
                self.reset()

    def reset(self) -> None:
        """Drop the camera and all views; a saved file stays."""
        with self._lock:
            self._restart()
            progress = Progress(version=self._snapshot.progress.version + 1)
            self._publish(progress=progress, advice=None, rejected=(), saved='')

    def calibration(self) -> Calibration | None:
        """Return the camera to be saved; None if there is none yet."""
        progress = self._snapshot.progress
        if progress.estimate is None or progress.image_size is None:
            return None
        return Calibration.from_estimate(progress.estimate, progress.image_size, self.camera_name)

    def save(self) -> tuple[bool, str]:
        """Write the camera; return whether it succeeded, and a sentence."""
        with self._lock:
            calibration = self.calibration()
            if calibration is None:
                return False, 'nothing to save: the camera has not been estimated yet'
            try:
                save_calibration(self.output, calibration)
            except ConfigError as error:
                return False, str(error)
            self._saved = calibration
            words = f'saved to {self.output}'
            if self._snapshot.progress.state is not CalibrationState.CALIBRATED:
                words += '; the camera is not calibrated yet'
            self._publish(saved=words)
            return True, words

    def process(self, image: ImageArray, name: str) -> None:
        """Detect the boards in an image, update the camera, and make the next snapshot."""
        with self._lock:
            if self._snapshot.is_paused:
                return
            number = self._snapshot.number + 1
            size = (image.shape[1], image.shape[0])
            problem = self._prepare(size)
            found = [] if problem else self._found(image, number)
            if problem:
                self._reject(problem, '', name, number)
            for each in found:
                self._judge(each, name, number)
            progress = self._progress(found)
            self._times_s.append(time.monotonic())
            self._publish(
                image=image,
                name=name,
                number=number,
                rate_hz=self._rate_hz,
                boards=tuple(found),
                progress=progress,
                advice=_advice(progress, found),
                rejected=tuple(self._rejected),
            )

    def reject(self, reason: str, name: str) -> None:
        """Count an image that could not be read."""
        with self._lock:
            number = self._snapshot.number + 1
            self._reject(reason, '', name, number)
            self._publish(number=number, rejected=tuple(self._rejected))

    def _restart(self) -> None:
        self._calibration = None
        self._guide: Guide | None = None
        self._before: list[Detection | None] = [None] * len(self._boards)
        self._rejected: deque[RejectedView] = deque(maxlen=_MOST_REJECTED)
        self._changes: deque[CameraChange] = deque(maxlen=_MOST_CHANGES)
        self._saved = None

    def _prepare(self, size: tuple[int, int]) -> str:
        """Begin a calibration with the first image; return why an image cannot be used."""
        if self._calibration is None:
            self._calibration = SelfCalibration(size, options=self.options, robust=self._robust)
            self._guide = Guide(self._boards[0], size, self.options)
        if self._calibration.image_size == size:
            return ''
        expected = '{}x{}'.format(*self._calibration.image_size)
        return f'expected {expected} px like the first image, got {size[0]}x{size[1]}; reset?'

    def _found(self, image: ImageArray, number: int) -> list[BoardInImage]:
        """Detect each board, near its place in the image before, and update the camera."""
        assert self._calibration is not None
        found = []
        for i, board in enumerate(self._boards):
            detection = detect(image, board, near=self._before[i])
            self._before[i] = None if detection.reason else detection
            if detection.reason:
                found.append(BoardInImage(board, detection))
                continue
            estimate = self._calibration.update(
                detection.image_points, detection.board_points, number, board=board.name
            )
            found.append(BoardInImage(board, detection, estimate, self._calibration.verdict))
        return found

    def _judge(self, found: BoardInImage, name: str, number: int) -> None:
        """Note a view that is rejected, or changes the camera."""
        assert self._calibration is not None
        board = found.board.name if len(self._boards) > 1 else ''
        if found.estimate is None:
            self._reject(found.detection.reason, board, name, number)
        elif found.verdict is Verdict.NO_POSE:
            self._reject(found.estimate.status.value, board, name, number)
        elif found.verdict is Verdict.OUTLIER:
            self._reject(Verdict.OUTLIER.value, board, name, number)
        elif found.verdict in (Verdict.USED, Verdict.RESTARTED):
            fused = self._calibration.fused
            if found.verdict is Verdict.RESTARTED:
                self._changes.clear()
                self._reject(Verdict.RESTARTED.value, board, name, number)
            if fused is not None:
                focal = fused.camera.focal_px
                self._changes.append(CameraChange(number, focal, fused.focal_sigma_px))

    def _reject(self, reason: str, board: str, name: str, number: int) -> None:
        """Add to the rejected views, or to the count of the same reason a moment ago."""
        for i, old in enumerate(self._rejected):
            is_same = (old.reason, old.board) == (reason, board)
            if is_same and number - old.number <= _SAME_REJECTION:
                del self._rejected[i]
                self._rejected.append(replace(old, count=old.count + 1, name=name, number=number))
                return
        self._rejected.append(RejectedView(reason, board, 1, name, number))

    def _progress(self, found: Sequence[BoardInImage]) -> Progress:
        """Return the calibration with the next view, which is chosen after each change."""
        calibration, guide, before = self._calibration, self._guide, self._snapshot.progress
        assert calibration is not None
        assert guide is not None
        is_used = any(each.verdict in (Verdict.USED, Verdict.RESTARTED) for each in found)
        if before.target is not None and not is_used and calibration.fused is before.estimate:
            return before
        held = [view for view in calibration.views if view.board == self._boards[0].name]
        return Progress(
            version=before.version + 1,
            image_size=calibration.image_size,
            state=calibration.state,
            estimate=calibration.fused,
            missing=calibration.missing,
            views=calibration.views,
            target=guide.next_view(calibration.fused, held),
            changes=tuple(self._changes),
        )

    @property
    def _rate_hz(self) -> float:
        times_s = self._times_s
        if len(times_s) < 2:
            return 0.0
        return (len(times_s) - 1) / max(times_s[-1] - times_s[0], 1e-6)

    def _publish(self, **changes: Any) -> None:
        """Make the next snapshot, and call the listeners."""
        with self._lock:
            sequence = self._snapshot.sequence + 1
            self._snapshot = replace(self._snapshot, sequence=sequence, **changes)
        for listener in self._listeners:
            listener()


def _advice(progress: Progress, found: Sequence[BoardInImage]) -> tuple[str, ...] | None:
    """Return how to move the first board to the target; None if it is not visible."""
    model = found[0].estimate.model if found and found[0].estimate else None
    if progress.target is None or progress.image_size is None or model is None:
        return None
    return directions(progress.target, model.camera_from_board, progress.image_size)
