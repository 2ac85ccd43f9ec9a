# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The world without deviations, where estimates are exact and errors are those of the noise."""

from functools import partial

import p4pfr_ros
from p4pfr_ros import EstimateOptions

IDEAL = EstimateOptions.ideal()

ideal_options = EstimateOptions.ideal
estimate_pose = partial(p4pfr_ros.estimate_pose, options=IDEAL)
SelfCalibration = partial(p4pfr_ros.SelfCalibration, robust=IDEAL)
