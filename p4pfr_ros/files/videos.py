# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reads the frames of videos, and images or a video from standard input.

This module stands alone: it is all that is about streams whose images come one after another.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import io
from itertools import count, islice
import os
from pathlib import Path
import sys
from threading import Thread

import cv2
import numpy as np
from p4pfr_ros.files.image_headers import is_image
from p4pfr_ros.files.images import Decoding, first_image_end, ImageArray, size_error
from p4pfr_ros.files.yaml_fields import ConfigError

_CONTAINERS = 'avi m4v mjpeg mjpg mkv mov mp4 mpeg mpg ogv ts webm wmv'
VIDEO_SUFFIXES = frozenset('.' + name for name in _CONTAINERS.split())
# FFmpeg within OpenCV writes to stderr what is reported here in one line.
os.environ.setdefault('OPENCV_FFMPEG_LOGLEVEL', '-8')
_CHUNK = 1 << 20
_ENOUGH_FOR_A_HEADER = 4096
_MS_PER_S, _NS_PER_S = 1e3, 1e9


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A frame: its number from 0, its time in the video, and the image (h, w, 3) BGR."""

    number: int
    time_ns: int
    image: ImageArray


def frame_count(path: Path) -> int | None:
    """Return the number of frames in a video, if the file says so."""
    with _opened(str(path), str(path)) as capture:
        frames = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    return frames if 0 < frames < 1 << 31 else None


def read_video(path: Path, how: Decoding, every: int = 1) -> Iterator[VideoFrame]:
    """
    Yield every n-th frame of a video as it was recorded: its orientation is ignored.

    Raises
    ------
    ConfigError
        The file is missing or no video, its frames are too large, or it has none.

    """
    with _opened(str(path), str(path)) as capture:
        yield from _frames(capture, str(path), how, every)


def read_stdin(how: Decoding, every: int = 1) -> Iterator[VideoFrame | bytes]:
    """
    Yield every n-th image of standard input: image files (PNG, JPEG: any number), or a video.

    Images are encoded (bytes), the frames of a video are decoded.

    Raises
    ------
    ConfigError
        Standard input is empty, or neither an image nor a video that can be read in one pass.

    """
    # Without a buffer, whose lock a waiting thread would hold when the process ends.
    stream = io.FileIO(sys.stdin.fileno(), closefd=False)
    first = stream.read(_ENOUGH_FOR_A_HEADER)
    if not first:
        raise ConfigError('standard input: expected images or a video, got nothing')
    if is_image(first):
        yield from islice(_images(first, stream), 0, None, every)
        return
    reader, writer = os.pipe()
    Thread(target=_pump, args=(first, stream, writer), daemon=True).start()
    try:
        with _opened(f'pipe:{reader}', 'standard input') as capture:
            yield from _frames(capture, 'standard input', how, every)
    finally:
        os.close(reader)


def _images(data: bytes, stream: io.FileIO) -> Iterator[bytes]:
    """Yield the image files in a stream that begins with some data."""
    is_at_end = False
    while data:
        end = first_image_end(data)
        while end is None and not is_at_end:
            more = stream.read(_CHUNK)
            data, is_at_end = data + more, not more
            end = first_image_end(data)
        yield data[:end]
        data = data[end:] if end is not None else b''
        if not data and not is_at_end:
            data = stream.read(_CHUNK)


def _pump(first: bytes, stream: io.FileIO, writer: int) -> None:
    """Copy a stream to a pipe, until either ends."""
    try:
        with os.fdopen(writer, 'wb') as pipe:
            pipe.write(first)
            while data := stream.read(_CHUNK):
                pipe.write(data)
    except OSError:  # the reader needs no more
        pass


@contextmanager
def _opened(source: str, name: str) -> Iterator[cv2.VideoCapture]:
    if source == name and not os.access(source, os.R_OK):
        reason = 'not readable' if Path(source).exists() else 'no such file'
        raise ConfigError(f'{name}: expected a video: {reason}')
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG)
    cv2.utils.logging.setLogLevel(level)
    try:
        if not capture.isOpened():
            raise ConfigError(f'{name}: expected a video that OpenCV reads, got another format')
        # As the sensor delivered it: a rotation would move the principal point.
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0.0)
        yield capture
    finally:
        capture.release()


def _frames(
    capture: cv2.VideoCapture, name: str, how: Decoding, every: int
) -> Iterator[VideoFrame]:
    width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
    height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    too_large = size_error(width, height, how)
    if too_large is not None:
        raise ConfigError(f'{name}: {too_large.reason}')
    fps = capture.get(cv2.CAP_PROP_FPS)
    last_s = -1.0
    for number in count():
        if not capture.grab():
            break
        # Streams without a container have no times: then by the rate.
        time_s = capture.get(cv2.CAP_PROP_POS_MSEC) / _MS_PER_S
        if not time_s > last_s:
            time_s = last_s + 1.0 / fps if fps > 0.0 else last_s + 1.0
        last_s = time_s
        if number % every:
            continue
        is_read, image = capture.retrieve()
        if is_read:
            yield VideoFrame(number, round(time_s * _NS_PER_S), np.asarray(image, dtype=np.uint8))
    if number == 0:
        raise ConfigError(f'{name}: expected a video with frames, got none')
