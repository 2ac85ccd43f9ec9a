# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Feeds a live session: a camera's newest image, or recorded images at the pace of a camera.

This module stands alone: a node has a topic instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import math
from pathlib import Path
import threading
import time

import cv2
import numpy as np
from p4pfr_ros.files.images import image_or_reason, ImageArray
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.session import LiveSession, SourceState

_IMAGES = {'.bmp', '.jpeg', '.jpg', '.pbm', '.pgm', '.png', '.ppm', '.tif', '.tiff', '.webp'}
# A camera that delivers no image for so long has failed.
_CAMERA_TIMEOUT_S = 5.0
_PAUSE_S = 0.05
# Of a video that does not say.
_VIDEO_HZ = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class LiveImage:
    """An image, or why it could not be read, and its name."""

    name: str
    image: ImageArray | str


def feed(session: LiveSession, source: str, rate_hz: float | None) -> None:
    """
    Process all images of a source; return at its end.

    Parameters
    ----------
    session
        Receives the images.
    source
        A camera by its index, or the path of a video, an image or a folder of images.
    rate_hz
        Images per second of a recorded source. None: the rate of a video; of images, as fast as
        they can be processed.

    Raises
    ------
    ConfigError
        The source cannot be opened.

    """
    session.set_source(SourceState.WAITING, source)
    if source.isdecimal():
        with Camera(int(source)) as camera:
            session.set_source(SourceState.RUNNING, f'camera {source}')
            _process(session, camera.images(), math.inf)
            name, failure = f'camera {source}', camera.failure
        session.set_source(SourceState.FAILED, name, failure)
        return
    path = Path(source)
    with _opened(path) as (images, own_rate_hz):
        session.set_source(SourceState.RUNNING, source)
        _process(session, images, rate_hz or own_rate_hz)
    session.set_source(SourceState.ENDED, source)


def _process(session: LiveSession, images: Iterable[LiveImage], rate_hz: float) -> None:
    """Process images at most at a rate; those of a recording wait while the session pauses."""
    due_s = time.monotonic()
    for named in images:
        while session.snapshot.is_paused:
            time.sleep(_PAUSE_S)
        due_s = max(due_s, time.monotonic() - 1.0 / rate_hz)
        time.sleep(max(0.0, due_s - time.monotonic()))
        due_s += 1.0 / rate_hz
        if isinstance(named.image, str):
            session.reject(named.image, named.name)
        else:
            session.process(named.image, named.name)


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

    def images(self) -> Iterator[LiveImage]:
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
            yield LiveImage(f'image {number}', image)

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
def _opened(path: Path) -> Iterator[tuple[Iterable[LiveImage], float]]:
    """Open a folder, an image or a video: its images, and their rate."""
    if path.is_dir():
        inside = sorted(each for each in path.iterdir() if each.suffix.lower() in _IMAGES)
        if not inside:
            raise ConfigError(f'{path}: expected a directory with images, got none')
        yield (LiveImage(each.name, image_or_reason(each)) for each in inside), math.inf
    elif path.suffix.lower() in _IMAGES:
        yield [LiveImage(path.name, image_or_reason(path))], math.inf
    else:
        with _quiet():
            capture = cv2.VideoCapture(str(path))
        try:
            if not capture.isOpened():
                raise ConfigError(f'{path}: expected a video, an image or a folder of images')
            # As the sensor delivered it: a rotation would move the principal point.
            capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0.0)
            yield _frames(capture), capture.get(cv2.CAP_PROP_FPS) or _VIDEO_HZ
        finally:
            capture.release()


def _frames(capture: cv2.VideoCapture) -> Iterator[LiveImage]:
    number = 0
    while True:
        is_read, image = capture.read()
        if not is_read:
            return
        number += 1
        yield LiveImage(f'frame {number}', np.asarray(image, dtype=np.uint8))


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
