# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages -> observations: the points of one board in one image, in pixels of the raw image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import re
from typing import Any

from geometry_msgs.msg import PolygonStamped
import numpy as np
from p4pfr_ros import CameraInfoModel
from p4pfr_ros.boards import Board, MarkerBoard
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.printable import printable_path, shown
from p4pfr_ros.files.yaml_fields import ConfigError
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header

from ..conversions import (
    Correspondences,
    correspondences_from_cloud,
    correspondences_from_detections,
    correspondences_from_polygon,
    image_frame_from_msg,
    ImageFrame,
    model_assumption,
    model_from_msg,
)
from ..parameters.pose_options import DetectionsOptions, ImageOptions, PoseNodeOptions
from ..runtime.rejections import Notice, Rejected

_NO_SIZE = Rejected(
    'no_image_size',
    'unknown image size: publish camera_info (its K may be 0) or set the parameters '
    'image.width_px and image.height_px',
)
_NO_CAMERA_INFO = Rejected(
    'no_camera_info', 'intrinsics.mode camera_info: no camera_info received yet'
)

# A fitted point may lie this far outside the image; a corner of a tag this share of its side.
_MARGIN_PX = 2.0
_MOST_OUTSIDE = 0.5

_NODE = '~'
_NAMELESS = 'board'


@dataclass(frozen=True, slots=True)
class Target:
    """
    A board with its topics.

    prefix
        Prefix of its topics: ``~``, or ``~/NAME`` for one of several boards.
    board
        Its geometry; None without a board file.
    """

    prefix: str = _NODE
    board: Board | None = None

    @property
    def name(self) -> str:
        """The board's own name, under which a calibration has its shape; empty for none."""
        return '' if self.board is None else self.board.name

    def frame(self, board_frame: str) -> str:
        """Return the name of its frame, given the parameter ``board_frame``."""
        name = self.name or _NAMELESS
        if self.prefix == _NODE:
            return board_frame or name
        return f'{board_frame}/{name}' if board_frame else name


# The marker on the topic ``corners``, which is not in the board file.
MARKER = Target()


@dataclass(frozen=True, slots=True, eq=False)
class BoardObservation:
    """
    The points of one board in one image.

    Parameters
    ----------
    header
        Stamp and optical frame of the message.
    frame
        Size, window and binning of the image.
    target
        The board.
    points
        Its points, in pixels of the image as it was sent.
    image_points : (N, 2) array
        The same points in pixels of the full raw image.
    surface_points : (N, 3) array
        Where the points are on the real board, metres; None: its shape is not known.

    """

    header: Header
    frame: ImageFrame
    target: Target
    points: Correspondences
    image_points: Array
    surface_points: Array | None = None

    @property
    def stamp_ns(self) -> int:
        """The stamp in nanoseconds; it may be negative."""
        stamp = self.header.stamp
        return 1_000_000_000 * int(stamp.sec) + int(stamp.nanosec)

    def part(self, chosen: Mask) -> BoardObservation:
        """Return the observation of a part (N,) of the points."""
        points = replace(
            self.points,
            image_points=self.points.image_points[chosen],
            board_points=self.points.board_points[chosen],
            ids=self.points.ids[chosen],
        )
        return replace(self, points=points, image_points=self.image_points[chosen])


class Inputs:
    """
    Converts messages to observations, with the boards of a file and the latest camera_info.

    Parameters
    ----------
    board_file
        Path of the board file; empty: one board without a name.

    Raises
    ------
    ConfigError
        The file is invalid, or the name of one of several boards is not valid in a topic name.

    """

    def __init__(self, board_file: str) -> None:
        self.boards: Mapping[str, Board] = load_boards(board_file) if board_file else {}
        if len(self.boards) > 1:
            self._targets = [
                Target(f'{_NODE}/{_topic_name(board_file, name)}', board)
                for name, board in self.boards.items()
            ]
        else:
            self._targets = [Target(_NODE, board) for board in self.boards.values()] or [MARKER]
        self._camera_info: CameraInfo | None = None
        self._frame: ImageFrame | None = None
        self._model: CameraInfoModel | Rejected = _NO_CAMERA_INFO
        self._modelled: CameraInfo | None = None

    @property
    def prefixes(self) -> set[str]:
        """The topic prefixes of all targets, including MARKER."""
        return {MARKER.prefix, *(target.prefix for target in self._targets)}

    def from_corners(
        self, msg: PolygonStamped, options: PoseNodeOptions
    ) -> list[BoardObservation | Rejected]:
        """Convert the corners of the marker that the parameters describe."""
        marker = options.marker
        points = correspondences_from_polygon(
            msg, marker.size_m, marker.corner_order, marker.pixel_center_px
        )
        return tags_in_image(self._observation(msg.header, MARKER, points, options), 'corners')

    def from_cloud(
        self, msg: PointCloud2, options: PoseNodeOptions
    ) -> list[BoardObservation | Rejected]:
        """Convert the points of one board."""
        return [in_image(self._of_board(msg.header, correspondences_from_cloud(msg), options))]

    def from_detections(
        self, msg: Any, options: PoseNodeOptions
    ) -> list[BoardObservation | Rejected]:
        """Convert the tags of apriltag_ros: one observation for each detected board."""
        return self._from_tags('detections', msg, options.detections, options)

    def from_tag_detections(
        self, msg: Any, options: PoseNodeOptions
    ) -> list[BoardObservation | Rejected]:
        """Convert the tags of Isaac ROS: one observation for each detected board."""
        return self._from_tags('tag_detections', msg, options.tag_detections, options)

    def use_camera_info(self, msg: CameraInfo) -> Rejected | None:
        """Replace the latest camera_info, or return why it is invalid."""
        frame = image_frame_from_msg(msg)
        if isinstance(frame, Rejected):
            return frame
        self._camera_info, self._frame = msg, frame
        return None

    def camera_model(self) -> CameraInfoModel | Rejected:
        """Return the calibration in the latest camera_info."""
        # Only the mode camera_info needs it, so it is converted on demand, once a message.
        if self._camera_info is not self._modelled:
            self._model = model_from_msg(self._camera_info)
            self._modelled = self._camera_info
        return self._model

    def model_assumption(self) -> Notice | None:
        """Return a notice if the latest camera_info leaves the model of its lens open."""
        return None if self._camera_info is None else model_assumption(self._camera_info)

    def frame_mismatch(self, header: Header) -> Notice | None:
        """Return a notice if camera_info has another frame_id than the header."""
        frame_id = '' if self._camera_info is None else self._camera_info.header.frame_id
        if frame_id in ('', header.frame_id):
            return None
        return Notice(
            'frame_id',
            f'camera_info has the frame {shown(frame_id)}, the points have '
            f'{shown(header.frame_id)}: are they from the same camera?',
        )

    def tf_conflict(self, options: PoseNodeOptions) -> Notice | None:
        """Return a notice if the options give the camera frame several parents in /tf."""
        if not (options.publish_tf and options.invert_tf) or len(self._targets) < 2:
            return None
        return Notice(
            'tf_parents',
            f'invert_tf gives the camera frame {len(self._targets)} parents on /tf, one for each '
            'board of board_file, but /tf allows one: set invert_tf to false, or use a file with '
            'one board',
        )

    def target(self, index: int | None) -> Target | Rejected:
        """Return the board with this index in the file; None is valid for a single board."""
        if index is None:
            return self._targets[0] if len(self._targets) == 1 else _ambiguous(self.boards)
        if 0 <= index < len(self._targets):
            return self._targets[index]
        return Rejected(
            'unknown_board',
            f'board {index}: expected 0 to {len(self._targets) - 1}, the indices of the boards in '
            'board_file; the detector must use the same file',
        )

    def _from_tags(
        self,
        topic: str,
        msg: Any,
        conventions: DetectionsOptions,
        options: PoseNodeOptions,
    ) -> list[BoardObservation | Rejected]:
        boards = correspondences_from_detections(
            msg,
            self.boards,
            conventions.corner_order,
            conventions.pixel_center_px,
            topic=topic,
        )
        observations = (self._of_board(msg.header, points, options) for points in boards)
        return [part for each in observations for part in tags_in_image(each, topic)]

    def _of_board(
        self, header: Header, points: Correspondences | Rejected, options: PoseNodeOptions
    ) -> BoardObservation | Rejected:
        if isinstance(points, Rejected):
            return points
        return self._observation(header, self.target(points.board), points, options)

    def _observation(
        self,
        header: Header,
        target: Target | Rejected,
        points: Correspondences | Rejected,
        options: PoseNodeOptions,
    ) -> BoardObservation | Rejected:
        """Convert the points to the full raw image, unless one of the arguments is rejected."""
        if isinstance(points, Rejected):
            return points
        if isinstance(target, Rejected):
            return target
        frame = self.image_frame(options.image)
        if isinstance(frame, Rejected):
            return frame
        image_points = frame.full_from_sent(points.image_points)
        return BoardObservation(header, frame, target, points, image_points)

    def image_frame(self, options: ImageOptions) -> ImageFrame | Rejected:
        """Return the frame of the latest camera_info; before the first, that of the parameters."""
        if self._frame is not None:
            return self._frame
        given = options.width_px > 0 and options.height_px > 0
        return ImageFrame((options.width_px, options.height_px)) if given else _NO_SIZE


def in_image(observation: BoardObservation | Rejected) -> BoardObservation | Rejected:
    """Return the observation; a rejection if one of its points lies outside the raw image."""
    if isinstance(observation, Rejected):
        return observation
    outside_px = _outside_px(observation.image_points, observation.frame.size)
    farthest = int(outside_px.argmax())
    if outside_px[farthest] <= _MARGIN_PX:
        return observation
    return Rejected(
        'outside_image',
        f'the point {_where(observation, farthest)}: camera_info belongs to another camera or '
        'image size, or the detector does not leave out points that it does not see',
    )


def tags_in_image(
    observation: BoardObservation | Rejected, topic: str
) -> list[BoardObservation | Rejected]:
    """
    Return an observation of tags without those that lie too far outside, and their rejections.

    AprilTag's library fits lines to the sides of a tag, so it finds a tag that the rim of the
    image cuts, with its corners outside. Farther out than half a side they are wrong.
    """
    if isinstance(observation, Rejected):
        return [observation]
    tags_px = observation.image_points.reshape(-1, 4, 2)
    sides_px = np.linalg.norm(tags_px - np.roll(tags_px, 1, axis=1), axis=2).mean(axis=1)
    outside_px = _outside_px(tags_px, observation.frame.size)
    is_left_out = outside_px.max(axis=1) > _MOST_OUTSIDE * sides_px
    if not is_left_out.any():
        return [observation]
    parts: list[BoardObservation | Rejected] = [
        _left_out(observation, topic, tag, int(outside_px[tag].argmax()), sides_px[tag])
        for tag in np.flatnonzero(is_left_out).tolist()
    ]
    if is_left_out.all():
        return parts
    return [*parts, observation.part(np.repeat(~is_left_out, 4))]


def _left_out(
    observation: BoardObservation, topic: str, tag: int, corner: int, side_px: float
) -> Rejected:
    board, first = observation.target.board, 4 * tag
    name = 'the marker'
    if isinstance(board, MarkerBoard):
        name = f'tag {board.marker_ids[observation.points.ids[first] // 4]}'
    return Rejected(
        'outside_image',
        f'{topic}: {name} is left out, because its corner {_where(observation, first + corner)}, '
        f'more than half a side of the tag ({_MOST_OUTSIDE * side_px:.0f} px): its corners are '
        'not reliable, or camera_info belongs to another camera or image size',
    )


def _outside_px(points_px: Array, image_size: tuple[int, int]) -> Array:
    """Return the distances of points (..., 2) from the image; 0 inside."""
    x, y = points_px[..., 0], points_px[..., 1]
    width, height = image_size
    beyond_x = np.maximum(np.maximum(-0.5 - x, x - (width - 0.5)), 0.0)
    beyond_y = np.maximum(np.maximum(-0.5 - y, y - (height - 0.5)), 0.0)
    return np.hypot(beyond_x, beyond_y)


def _where(observation: BoardObservation, index: int) -> str:
    (x, y), (width, height) = observation.image_points[index], observation.frame.size
    outside_px = _outside_px(observation.image_points[index], observation.frame.size)
    return (
        f'({x:.0f}, {y:.0f}) px lies {outside_px:.0f} px outside the image of {width}x{height} px'
    )


def _ambiguous(boards: Mapping[str, Board]) -> Rejected:
    indices = ', '.join(f'{index} for {name}' for index, name in enumerate(boards))
    return Rejected(
        'unknown_board',
        f'correspondences: board_file has {len(boards)} boards, so a cloud needs the integer '
        f'field board: {indices}',
    )


def _topic_name(board_file: str, name: str) -> str:
    if re.fullmatch(r'[A-Za-z]\w*', name, re.ASCII) is None:
        raise ConfigError(
            f'{printable_path(board_file)}: boards.{name}: expected a letter, and then letters, '
            'digits and _, in the name of one of several boards: it is part of topic names'
        )
    return name
