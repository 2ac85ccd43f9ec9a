# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Feeds a live session: a camera's newest image, or recorded images at the pace of a camera.

This module stands alone: a node has a topic instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
import threading
import time

import cv2
import numpy as np
from p4pfr_ros.files.image_sources import NamedImage, open_source
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.session import LiveSession, SourceState

# A camera that delivers no image for so long has failed.
_CAMERA_TIMEOUT_S = 5.0
_PAUSE_S = 0.05
# Longer gaps of a recording are not waited for.
_LONGEST_GAP_S = 2.0


def feed(
    session: LiveSession, source: str, rate_hz: float | None, topic: str | None = None
) -> None:
    """
    Process all images of a source; return at its end.

    Parameters
    ----------
    session
        Receives the images.
    source
        A camera by its index, or what `open_source` opens: a video, a bag, an image or a folder
        of images, or - for standard input.
    rate_hz
        Images per second of a recorded source. None: the rate of a video or bag; of images, as
        fast as they can be processed.
    topic
        Image topic of a bag; None: its only one.

    Raises
    ------
    ConfigError
        The source cannot be opened.

    """
    session.set_source(SourceState.WAITING, source)
    if source.isdecimal():
        with Camera(int(source)) as camera:
            session.set_source(SourceState.RUNNING, f'camera {source}')
            _process(session, camera.images(), None)
            name, failure = f'camera {source}', camera.failure
        session.set_source(SourceState.FAILED, name, failure)
        return
    with open_source([Path(source)], topic) as opened:
        session.set_source(SourceState.RUNNING, source)
        _process(session, (frame.load() for frame in opened.frames), rate_hz)
    session.set_source(SourceState.ENDED, source)


def _process(session: LiveSession, images: Iterable[NamedImage], rate_hz: float | None) -> None:
    """Process images at a rate, or that of their stamps; recordings wait while paused."""
    due_s, before = time.monotonic(), None
    for named in images:
        while session.snapshot.is_paused:
            time.sleep(_PAUSE_S)
        interval_s = 1.0 / rate_hz if rate_hz else _interval_s(before, named)
        # If processing is slower, the recording takes longer; it does not hurry afterwards.
        due_s = max(due_s + interval_s, time.monotonic())
        time.sleep(max(0.0, due_s - time.monotonic()))
        before = named
        if isinstance(named.image, str):
            session.reject(named.image, named.name)
        else:
            session.process(named.image, named.name)


def _interval_s(before: NamedImage | None, named: NamedImage) -> float:
    """Return the time between two images of a recording; 0 if there is none."""
    if before is None or before.stamp_ns is None or named.stamp_ns is None:
        return 0.0
    if not named.recording:  # files that are named by their stamps
        return 0.0
    return min(max(1e-9 * (named.stamp_ns - before.stamp_ns), 0.0), _LONGEST_GAP_S)


class Camera:
    """
    A camera of this machine; a thread reads it, so that its newest image is never old.

    Parameters
    ----------
    index
        Index of the camera, as OpenCV counts.

    Raises
    ------
    ConfigError
        There is no such camera.

    """

    def __init__(self, index: int) -> None:
        self.failure = ''
        with _quiet():
            self._capture = cv2.VideoCapture(index)
        if not self._capture.isOpened():
            raise ConfigError(
                f'camera {index}: expected a camera that this user may open, got none '
                f'(is /dev/video{index} there, and are you in its group?)'
            )
        self._newest: ImageArray | None = None
        self._condition = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Camera:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.join(_CAMERA_TIMEOUT_S)
        self._capture.release()

    def images(self) -> Iterator[NamedImage]:
        """Yield the newest image whenever there is one, until the camera fails."""
        number = 0
        while True:
            with self._condition:
                arrived = self._condition.wait_for(
                    lambda: self._newest is not None or self.failure, _CAMERA_TIMEOUT_S
                )
                if not arrived:
                    self.failure = f'no image for {_CAMERA_TIMEOUT_S:g} s'
                image, self._newest = self._newest, None
            if image is None:
                return
            number += 1
            yield NamedImage(f'image {number}', image)

    def _read(self) -> None:
        while not self._ends:
            is_read, image = self._capture.read()
            with self._condition:
                if is_read:
                    self._newest = np.asarray(image, dtype=np.uint8)
                else:
                    self.failure = 'the camera delivers no more images'
                self._condition.notify()
            if not is_read:
                return


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep OpenCV from logging what is reported in one line."""
    # OpenCV 4.6 has it elsewhere.
    logging = cv2.utils.logging if hasattr(cv2.utils, 'logging') else cv2
    level = logging.setLogLevel(0)
    try:
        yield
    finally:
        logging.setLogLevel(level)
