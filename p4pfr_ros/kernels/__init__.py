# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compiles and loads all kernels before they are needed, in several processes."""
