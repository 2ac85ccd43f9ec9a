# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics that pose_node publishes for an estimate: poses, camera, markers and /tf."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from p4pfr_ros import CameraEstimate, CameraInfoModel, DivisionCamera, Pose, PoseEstimate
from p4pfr_ros.files.printable import shown
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from .camera_source import KnownCamera
from .inputs import BoardObservation, Target
from ..conversions import (
    camera_info_division_msg,
    camera_info_from_model_msg,
    camera_info_msg,
    ImageFrame,
    pose_array_msg,
    pose_msg,
    pose_with_covariance_msg,
    transform_msg,
)
from ..conversions.markers import markers_msg
from ..parameters.pose_options import PER_FRAME, PoseNodeOptions
from ..runtime.endpoints import Endpoints, has_subscribers, is_awaited

# A camera, and the radius (px) of the part of the image where it was seen; None: not known.
_Lens = tuple[DivisionCamera | CameraInfoModel, float | None]

# camera_info and the points of an image arrive at different times; this many images later, the
# stamp of an image is forgotten.
_STAMPS = 32


class Outputs:
    """
    All topics of estimates.

    Parameters
    ----------
    node
        The node, for /tf.
    endpoints
        Creates the publishers.
    prefixes
        The topic prefixes of the boards.

    """

    def __init__(self, node: Node, endpoints: Endpoints, prefixes: Iterable[str]) -> None:
        self._poses = {prefix: PoseOutputs(endpoints, prefix) for prefix in sorted(prefixes)}
        self._cameras = CameraOutputs(endpoints)
        self._synced = SyncedCameraInfo(endpoints)
        self._scene = SceneOutputs(node, endpoints)
        self._mode = ''

    def is_awaited(self, target: Target, options: PoseNodeOptions) -> bool:
        """Return whether any topic needs an estimate of this board."""
        return (
            self._poses[target.prefix].is_awaited()
            or self._needs_camera()
            or self._scene.is_awaited(options)
        )

    def draws_points(self) -> bool:
        """Return whether an output shows the points of the board in space."""
        return self._scene.draws_points()

    def _needs_camera(self) -> bool:
        return self._cameras.has_subscribers() or self._synced.is_awaited()

    def publish_pose(
        self, observation: BoardObservation, estimate: PoseEstimate, options: PoseNodeOptions
    ) -> None:
        """Publish an estimate: poses first, because a controller may wait for them."""
        self._poses[observation.target.prefix].publish(observation.header, estimate)
        self._scene.publish(observation, estimate, options)

    def publish_camera(
        self, observation: BoardObservation, camera: KnownCamera | None, options: PoseNodeOptions
    ) -> CameraInfoModel | None:
        """Publish the camera in use if it has changed; return the model that was published."""
        mode = options.intrinsics.mode
        # The model is fitted to each camera of the mode per_frame only for a subscriber.
        if camera is not None and (mode != PER_FRAME or self._needs_camera()):
            self._mode = mode
            header, frame = observation.header, observation.frame
            return self._cameras.publish(header, frame, camera, again=mode == PER_FRAME)
        # A view of the mode per_frame without a camera does not retract the one before it.
        if mode != PER_FRAME or self._mode != PER_FRAME:
            self._cameras.retract(observation.header.stamp)
        return None

    def retract_camera(self, stamp: Time) -> None:
        """Publish that there is no camera."""
        self._cameras.retract(stamp)

    def awaits_synced(self) -> bool:
        """Return whether ``~/camera_info_synced`` has a subscriber."""
        return self._synced.is_awaited()

    def publish_synced(
        self, header: Header, frame: ImageFrame, camera: KnownCamera | None, mode: str
    ) -> None:
        """
        Publish a camera with the header of an image, once for each stamp.

        In the mode per_frame, that is the camera of the last view.
        """
        if mode == PER_FRAME:
            camera = self._cameras.published_for(frame.size)
        if camera is not None:
            self._synced.publish(header, frame, self._cameras.model_of(camera, frame.size))


class PoseOutputs:
    """
    The pose topics of one board.

    Parameters
    ----------
    endpoints
        Creates the publishers.
    prefix
        Prefix of the topics: ``~``, or ``~/NAME``.

    """

    def __init__(self, endpoints: Endpoints, prefix: str) -> None:
        self._pose = endpoints.advertise(PoseStamped, f'{prefix}/pose')
        self._with_covariance = endpoints.advertise(
            PoseWithCovarianceStamped, f'{prefix}/pose_with_covariance'
        )
        self._alternatives = endpoints.advertise(PoseArray, f'{prefix}/alternatives')

    def is_awaited(self) -> bool:
        """Return whether a topic has a subscriber, or is latched for later ones."""
        return is_awaited(self._pose, self._with_covariance, self._alternatives)

    def publish(self, header: Header, estimate: PoseEstimate) -> None:
        """Publish an estimate on the awaited topics; without a model publish nothing."""
        if estimate.model is None:
            return
        pose, observable = estimate.model.camera_from_board, estimate.observable
        # Only the covariance can express that the view does not determine a number.
        if is_awaited(self._with_covariance):
            covariance = estimate.covariance[:6, :6]
            self._with_covariance.publish(pose_with_covariance_msg(header, pose, covariance))
        if observable.direction and observable.distance and is_awaited(self._pose):
            self._pose.publish(pose_msg(header, pose))
        if is_awaited(self._alternatives):
            others = [other.camera_from_board for other in estimate.alternatives]
            self._alternatives.publish(pose_array_msg(header, others))


class CameraOutputs:
    """
    The latched topics of the camera: late subscribers receive the camera in use, or K = 0.

    Parameters
    ----------
    endpoints
        Creates the publishers.

    """

    def __init__(self, endpoints: Endpoints) -> None:
        self._camera_info = endpoints.advertise(CameraInfo, '~/camera_info', latched=True)
        self._division = endpoints.advertise(CameraInfo, '~/camera_info_division', latched=True)
        self._published: tuple[_Lens, str, ImageFrame] | None = None
        self._modelled: tuple[_Lens, tuple[int, int], CameraInfoModel] | None = None

    def has_subscribers(self) -> bool:
        """Return whether a topic has a subscriber."""
        return has_subscribers(self._camera_info, self._division)

    def publish(
        self, header: Header, frame: ImageFrame, camera: KnownCamera, *, again: bool
    ) -> CameraInfoModel | None:
        """
        Publish a camera, in our model and in a model that image_proc supports.

        Returns the latter; None, and nothing is published, if the camera is the one published
        last and ``again`` is false.
        """
        lens = _lens_of(camera)
        published = lens, header.frame_id, frame
        if published == self._published and not again:
            return None
        self._published = published
        if isinstance(lens[0], CameraInfoModel):
            self._division.publish(camera_info_msg(header, frame))
        else:
            self._division.publish(camera_info_division_msg(header, frame, lens[0]))
        model = self.model_of(camera, frame.size)
        self._camera_info.publish(camera_info_from_model_msg(header, frame, model))
        return model

    def published_for(self, image_size: tuple[int, int]) -> KnownCamera | None:
        """Return the camera published last, if it is one for images of this size."""
        if self._published is None or self._published[2].size != image_size:
            return None
        return self._published[0][0]

    def model_of(self, camera: KnownCamera, image_size: tuple[int, int]) -> CameraInfoModel:
        """Return the model for image_proc, fitted where the lens was seen if that is known."""
        lens = _lens_of(camera)
        if isinstance(lens[0], CameraInfoModel):
            return lens[0]
        # The fit takes longer than a message may, and most messages have the camera of the last.
        if self._modelled is None or self._modelled[:2] != (lens, image_size):
            model = lens[0].to_camera_info_model(image_size, lens[1])
            self._modelled = lens, image_size, model
        return self._modelled[2]

    def retract(self, stamp: Time) -> None:
        """Publish an uncalibrated camera (K = 0) if a camera was published before."""
        if self._published is not None:
            _, frame_id, frame = self._published
            uncalibrated = camera_info_msg(Header(stamp=stamp, frame_id=frame_id), frame)
            self._camera_info.publish(uncalibrated)
            self._division.publish(uncalibrated)
            self._published = None


class SyncedCameraInfo:
    """
    The camera for nodes that need one for each image, with the stamp of the image.

    Parameters
    ----------
    endpoints
        Creates the publisher.

    """

    def __init__(self, endpoints: Endpoints) -> None:
        self._publisher = endpoints.advertise(CameraInfo, '~/camera_info_synced')
        self._stamps: deque[tuple[int, int]] = deque(maxlen=_STAMPS)

    def is_awaited(self) -> bool:
        """Return whether the topic has a subscriber."""
        return is_awaited(self._publisher)

    def publish(self, header: Header, frame: ImageFrame, model: CameraInfoModel) -> None:
        """Publish a camera, unless one with this stamp was published."""
        stamp = header.stamp.sec, header.stamp.nanosec
        if stamp not in self._stamps:
            self._stamps.append(stamp)
            self._publisher.publish(camera_info_from_model_msg(header, frame, model))


def _lens_of(camera: KnownCamera) -> _Lens:
    if isinstance(camera, CameraEstimate):
        return camera.camera, camera.seen_radius_px
    return camera, None


class SceneOutputs:
    """
    Board poses for visualisation and tf: ``~/markers`` and /tf.

    Parameters
    ----------
    node
        The node, for /tf.
    endpoints
        Creates the publishers.

    """

    def __init__(self, node: Node, endpoints: Endpoints) -> None:
        self._node, self._endpoints = node, endpoints
        self._markers = endpoints.advertise(MarkerArray, '~/markers')
        self._transforms: Transforms | None = None

    def is_awaited(self, options: PoseNodeOptions) -> bool:
        """Return whether markers have a subscriber; /tf is assumed to have one."""
        return options.publish_tf or self.draws_points()

    def draws_points(self) -> bool:
        """Return whether ``~/markers`` has a subscriber."""
        return has_subscribers(self._markers)

    def publish(
        self, observation: BoardObservation, estimate: PoseEstimate, options: PoseNodeOptions
    ) -> None:
        """Publish an estimate; without a model, delete the markers of the board."""
        if self.draws_points():
            self._markers.publish(_markers(observation, estimate, options))
        model, observable = estimate.model, estimate.observable
        if options.publish_tf and model and observable.direction and observable.distance:
            if self._transforms is None:
                self._transforms = Transforms(self._node, self._endpoints)
            board_frame = observation.target.frame(options.board_frame)
            self._transforms.publish(
                observation.header, board_frame, model.camera_from_board, options.invert_tf
            )


class Transforms:
    """
    Broadcasts poses of boards on /tf; if ``tf2_ros`` is missing, it logs that once instead.

    Parameters
    ----------
    node
        The node that broadcasts.
    endpoints
        Destroys the publisher.

    """

    def __init__(self, node: Node, endpoints: Endpoints) -> None:
        self._logger = node.get_logger()
        self._broadcaster = _broadcaster(node)
        if self._broadcaster is not None:
            # TransformBroadcaster itself cannot destroy its publisher.
            publisher = self._broadcaster.pub_tf
            endpoints.add(lambda: node.destroy_publisher(publisher))

    def publish(
        self, header: Header, child_frame: str, camera_from_board: Pose, inverse: bool = False
    ) -> None:
        """Broadcast a pose; ``inverse`` makes the board frame the parent of the header's frame."""
        if self._broadcaster is None:
            return
        if header.frame_id in ('', child_frame):
            # Every listener would log an error for every message.
            self._logger.warning(
                f'nothing is published on /tf: expected points with a frame_id other than '
                f'{shown(child_frame)}, got {shown(header.frame_id)}',
                once=True,
            )
        else:
            self._broadcaster.sendTransform(
                transform_msg(header, child_frame, camera_from_board, inverse)
            )


def _broadcaster(node: Node) -> Any:
    # tf2_ros is optional, and imported only if /tf is wanted.
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        node.get_logger().warning('tf2_ros is not installed: nothing is published on /tf')
        return None
    return TransformBroadcaster(node)


def _markers(
    observation: BoardObservation, estimate: PoseEstimate, options: PoseNodeOptions
) -> MarkerArray:
    target = observation.target
    return markers_msg(
        observation.header,
        target.frame(options.board_frame),
        estimate,
        observation.points,
        observation.image_points,
        observation.frame.size,
        sheet_size_m=None if target.board is None else target.board.sheet_size_m,
        full_scale_px=options.robust.threshold_px,
        surface_points=observation.surface_points,
    )
