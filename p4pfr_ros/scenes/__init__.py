# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Synthetic views with ground truth, for tests, benchmarks and the demo.

- ``instances``: batches of minimal problems (four points, no noise),
- ``single_view``: one view with noise and outliers, of a random camera,
- ``deviating_view``: one view of a camera or a board that deviates from the model,
- ``camera_views``: many views of one camera,
- ``board_path``: the smooth motion of a simulated board.
"""
