# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy and speed in numbers, beside what others published; nothing here is installed."""
