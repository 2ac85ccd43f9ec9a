# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibrates a camera while people watch: a session, and the web page that shows it."""
