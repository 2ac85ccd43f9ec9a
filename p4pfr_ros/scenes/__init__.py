# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Synthetic views with known truth, for tests, benchmarks and the demo."""
