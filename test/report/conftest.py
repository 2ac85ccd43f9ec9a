# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A real browser for reports."""

from browser import browser, open_page  # noqa: F401  (fixtures)
