# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What pose_node does, for any kind of node: corners of markers and boards in, poses out."""

from __future__ import annotations

from collections.abc import Iterable

from p4pfr_ros.files.yaml_fields import ConfigError
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from .answering import Answering
from .calibration_keeper import CalibrationKeeper
from .health import PERIOD_S
from .inputs import Found, Inputs
from .publishing import Publishing
from .reports import Reports
from .services import CameraInfoSetter, Services
from .targets import Targets
from ..parameters.declare import Parameters
from ..parameters.intrinsics_options import FIXED
from ..parameters.pose_options import PoseNodeOptions
from ..runtime.endpoints import Endpoints
from ..runtime.warm_up import warm_up


class PoseWork:
    """
    Estimates, for each view of a marker or board, its pose, the focal length and the distortion.

    Header, stamp and frame of an answer are those of the message that it answers. When it is
    made, it is ready; it listens from ``start`` to ``stop``, again and again if need be.

    Parameters
    ----------
    node
        Whose work it is.
    config
        The node's parameters.

    Raises
    ------
    ConfigError
        A file that a parameter names is wrong, or a camera that is needed is missing.

    """

    def __init__(self, node: Node, config: Parameters[PoseNodeOptions]) -> None:
        self._config = config
        options = config.options
        # What can be refused comes first, while there is nothing to take down.
        targets = self._targets = Targets(options.board_file)
        self._keeper = CalibrationKeeper(options, self._tell, lambda text: _say(node, text))
        config.guard(self._check)
        # What stays until the end, and what comes and goes.
        self._lasting, self._passing = Endpoints(node), Endpoints(node)
        try:
            self._reports = Reports(node, self._lasting, options.camera_name)
            self._setter = CameraInfoSetter(
                self._lasting, options.set_camera_info_service, lambda text: _say(node, text)
            )
            publishing = Publishing(node, self._lasting, targets)
            self._answering = Answering(self._keeper, publishing, self._reports)
            self._inputs = Inputs(targets, config, self._on_found)
            Services(node, self._lasting, self._keeper.save, self._answering.reset)
            # Nobody's first message shall wait for the compiler.
            warm_up()
        except Exception:
            # Nobody could take down what is only half there.
            self.close()
            raise

    def start(self) -> None:
        """Begin to listen."""
        self._passing.subscribe(CameraInfo, 'camera_info', self._answering.on_camera_info)
        self._inputs.subscribe(self._passing)
        self._passing.every(PERIOD_S, self._on_second)

    def stop(self) -> None:
        """Listen no more; what has been found is kept."""
        self._passing.close()

    def close(self) -> None:
        """Status, and take everything down."""
        self._passing.close()
        self._lasting.close()
        self._config.guard(None)

    def _on_found(self, header: Header, found: Iterable[Found]) -> None:
        options = self._config.options
        if options.enabled:
            self._answering.on_found(header, found, options)
            self._reports.remark(self._targets.remark_on_tf(options))
        self._reports.publish(enabled=options.enabled)

    def _on_second(self) -> None:
        self._reports.publish(enabled=self._config.options.enabled)
        self._setter.try_again()

    def _tell(self, camera_info: CameraInfo) -> None:
        self._setter.tell(camera_info)

    def _check(self, options: PoseNodeOptions) -> None:
        """Refuse the mode fixed while there is no camera."""
        given, now = options.intrinsics, self._config.options
        # A camera may have been forgotten since: what has nothing to do with it can be changed.
        if options is not now and given == now.intrinsics:
            return
        if given.mode == FIXED and given.focal_px == 0.0 and not self._keeper.found.knows_any:
            raise ConfigError(
                'intrinsics.focal_px: expected > 0 in the mode fixed, or a calibration_file that '
                'exists, or a calibration found before, got 0'
            )


def _say(node: Node, text: str) -> None:
    node.get_logger().info(text)
