# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy and speed benchmarks, with published results of others. Not installed."""
