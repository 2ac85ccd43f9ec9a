# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What all nodes share: endpoints, parameter overrides, spinning, rejections, warm-up."""
