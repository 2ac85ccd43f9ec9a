# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pose pipeline: estimate each observed board, publish, then update the calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import functools
import time
from typing import Any

from geometry_msgs.msg import PolygonStamped
from p4pfr_ros import PoseEstimate, SelfCalibration, Status
from p4pfr_ros.boards.symmetry import symmetry_note
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.kernels.warm_up import warm_up
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Header

from .calibration_keeper import CalibrationKeeper, CameraInfoSetter
from .camera_check import CameraCheck
from .camera_source import camera_to_publish, CameraSource, estimate_with, on_real_board
from .health import HealthReporter, PERIOD_S
from .inputs import BoardObservation, Inputs
from .outputs import Outputs
from .services import Services
from .turned_boards import TurnedBoards
from ..conversions import detection_array_type, isaac_detection_array_type
from ..parameters.declare import Parameters
from ..parameters.pose_options import CAMERA_INFO, FIXED, PoseNodeOptions, SELF_CALIBRATE
from ..runtime.endpoints import Endpoints
from ..runtime.following import FollowingSubscription
from ..runtime.kernel_start import KernelStart
from ..runtime.rejections import Notice, Rejected

# While the kernels are compiled, estimates are interpreted, which takes a hundred times as long.
# So much time is left for services and for the compiler.
_INTERPRETED_PERIOD_S = 1.0


class PosePipeline:
    """
    Estimates the pose of a marker or board, the focal length and the distortion, for any node.

    Published messages carry the header of the message with the points. The constructor creates
    publishers and services and loads the kernels; the pipeline subscribes between ``start``
    and ``stop``, which may be called repeatedly.

    Parameters
    ----------
    node
        The node of all endpoints.
    config
        The parameters of the node.

    Raises
    ------
    ConfigError
        A file or a name in the parameters is invalid, or the mode fixed has no camera.

    """

    def __init__(self, node: Node, config: Parameters[PoseNodeOptions]) -> None:
        self._node, self._config = node, config
        self._next_interpreted_s = 0.0
        self._lasting, self._subscribed = Endpoints(node), Endpoints(node)
        options, logger = config.options, node.get_logger()
        try:
            self._inputs = Inputs(options.board_file)
            for board in self._inputs.boards.values():
                if board.turns:
                    logger.warning(symmetry_note(board.name, board.turns))
            symmetric = any(board.turns for board in self._inputs.boards.values())
            self._turned_boards = TurnedBoards() if symmetric else None
            self._driver = CameraInfoSetter(logger, self._lasting, options.set_camera_info_service)
            self._keeper = CalibrationKeeper(logger, self._driver, options)
            config.guard(self._check_fixed_camera)
            self._cameras = CameraSource(self._keeper.calibrations, self._inputs)
            self._check = CameraCheck()
            self._outputs = Outputs(node, self._lasting, self._inputs.prefixes)
            self._reporter = HealthReporter(node, self._lasting, options.camera_name)
            Services(node, self._lasting, self._keeper, self._outputs, self._reporter)
            # So that no message waits for the compiler.
            self._kernels = KernelStart(node, warm_up)
        except Exception:
            self._destroy()
            raise

    def when_ready(self, log_ready: Callable[[], object]) -> None:
        """Call a function when the kernels are compiled or loaded, now or later."""
        self._kernels.when_ready(log_ready)

    def start(self) -> None:
        """Subscribe; to tags of other detectors if there are boards and their messages."""
        # A driver may latch camera_info, and publish it once.
        following = FollowingSubscription(
            self._node, CameraInfo, 'camera_info', self._on_camera_info, only_latched=True
        )
        self._subscribed.add(following.destroy)
        self._subscribed.subscribe(PolygonStamped, 'corners', self._on_corners)
        self._subscribed.subscribe(PointCloud2, 'correspondences', self._on_correspondences)
        for topic, kind, callback in (
            ('detections', detection_array_type(), self._on_detections),
            ('tag_detections', isaac_detection_array_type(), self._on_tag_detections),
        ):
            if kind is not None and self._inputs.boards:
                self._subscribed.subscribe(kind, topic, callback)
        self._subscribed.every(PERIOD_S, self._on_timer)

    def stop(self) -> None:
        """Unsubscribe; the calibration is kept."""
        self._subscribed.close()

    def close(self) -> None:
        """Stop, save the calibration if that is an option, and destroy all endpoints."""
        self.stop()
        self._keeper.save_at_end(self._config.options)
        self._destroy()

    def _destroy(self) -> None:
        self._subscribed.close()
        self._lasting.close()
        self._config.guard(None)

    def _on_camera_info(self, msg: CameraInfo) -> None:
        rejected = self._inputs.use_camera_info(msg)
        if rejected is not None:
            self._reporter.reject(rejected)
        else:
            self._publish_synced(msg.header, self._config.options)

    def _on_corners(self, msg: PolygonStamped) -> None:
        options = self._config.options
        self._process(msg.header, self._inputs.from_corners(msg, options), options)

    def _on_correspondences(self, msg: PointCloud2) -> None:
        options = self._config.options
        self._process(msg.header, self._inputs.from_cloud(msg, options), options)

    def _on_detections(self, msg: Any) -> None:
        options = self._config.options
        self._process(msg.header, self._inputs.from_detections(msg, options), options)

    def _on_tag_detections(self, msg: Any) -> None:
        options = self._config.options
        self._process(msg.header, self._inputs.from_tag_detections(msg, options), options)

    def _on_timer(self) -> None:
        self._reporter.pending = self._kernels.pending
        self._reporter.publish(enabled=self._config.options.enabled)
        self._driver.send_pending()

    def _process(
        self,
        header: Header,
        observations: Iterable[BoardObservation | Rejected],
        options: PoseNodeOptions,
    ) -> None:
        """Process all boards of one message, and report the health of the node."""
        if options.enabled:
            received_s = time.monotonic()
            self._reporter.received(received_s)
            pending = self._kernels.pending
            if pending and received_s < self._next_interpreted_s:
                self._reporter.reject(Rejected('compiling', pending))
                observations = ()
            for observation in observations:
                if isinstance(observation, Rejected):
                    self._reporter.reject(observation)
                elif self._is_needed(observation, options):
                    self._estimate(observation, options, received_s)
                    self._next_interpreted_s = time.monotonic() + _INTERPRETED_PERIOD_S
            self._warn(self._inputs.tf_conflict(options))
            self._publish_synced(header, options)
        self._reporter.publish(enabled=options.enabled)

    def _is_needed(self, observation: BoardObservation, options: PoseNodeOptions) -> bool:
        self_calibrates = options.intrinsics.mode == SELF_CALIBRATE
        return self_calibrates or self._outputs.is_awaited(observation.target, options)

    def _estimate(
        self, observation: BoardObservation, options: PoseNodeOptions, received_s: float
    ) -> None:
        """Estimate one board; a calibrated camera publishes the pose before it is updated."""
        self._warn(self._inputs.frame_mismatch(observation.header))
        if options.intrinsics.mode == CAMERA_INFO:
            self._warn(self._inputs.model_assumption())
        camera = self._cameras.camera_for(observation, options)
        if isinstance(camera, Rejected):
            self._reporter.reject(camera)
            return
        if self._kernels.pending and isinstance(camera, SelfCalibration):
            camera = camera.fused  # an interpreted update takes seconds
        if self._outputs.draws_points():
            observation = on_real_board(camera, observation)
        publish = functools.partial(self._publish, observation, options, received_s)
        estimate = estimate_with(camera, observation, options, self._check, on_pose=publish)
        in_use = camera_to_publish(camera, estimate, options.intrinsics.mode)
        self._reporter.camera_published(self._outputs.publish_camera(observation, in_use, options))
        if options.intrinsics.mode == SELF_CALIBRATE:
            self._warn(self._keeper.calibrations.finish_view())
            self._warn(self._keeper.follow(observation, options))
            self._reporter.calibrated(self._keeper.calibrations)
        else:
            self._reporter.calibrated(None)

    def _publish(
        self,
        observation: BoardObservation,
        options: PoseNodeOptions,
        received_s: float,
        estimate: PoseEstimate,
    ) -> None:
        published = observation, estimate
        if self._turned_boards is not None:
            published = self._turned_boards.resolve(observation, estimate)
        self._outputs.publish_pose(*published, options)
        reason = self._check.reason if estimate.status is Status.MISFIT else ''
        # A symmetric board is not ambiguous in this view alone: it was said at the start.
        self._reporter.estimated(observation.stamp_ns, estimate, received_s, reason)

    def _publish_synced(self, header: Header, options: PoseNodeOptions) -> None:
        """Publish the camera in use with the header of an image, if a node needs it."""
        frame = self._inputs.image_frame(options.image)
        if isinstance(frame, Rejected) or not self._outputs.awaits_synced():
            return
        camera = self._cameras.known(frame.size, options)
        self._outputs.publish_synced(header, frame, camera, options.intrinsics.mode)

    def _warn(self, notice: Notice | None) -> None:
        if notice is not None:
            self._reporter.warn(notice)

    def _check_fixed_camera(self, options: PoseNodeOptions) -> None:
        """Reject the mode fixed while there is no camera."""
        given, current = options.intrinsics, self._config.options
        # After a reset in mode fixed there is no camera; other parameters can still be changed.
        if options is not current and given == current.intrinsics:
            return
        has_camera = given.focal_px > 0.0 or self._keeper.calibrations.has_camera
        if given.mode == FIXED and not has_camera:
            raise ConfigError(
                'intrinsics.focal_px: expected > 0 in mode fixed, or an existing '
                'calibration_file, or a calibration estimated before, got 0'
            )
