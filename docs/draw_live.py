# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draw the pictures of the live page and of the report: a person who follows the page, simulated.

    python docs/draw_live.py

Needs Chromium with its driver, selenium and aiohttp.
"""

from __future__ import annotations

from pathlib import Path
import shutil
import tempfile
import time

import numpy as np
from p4pfr_ros import DivisionCamera, EstimateOptions, Pose
from p4pfr_ros.boards import Board
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.files.image_sources import NamedImage
from p4pfr_ros.files.images import ImageArray
from p4pfr_ros.live.server import LiveServer
from p4pfr_ros.live.session import LiveSession, SourceState
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.report.calibration_run import CalibrationRun
from p4pfr_ros.report.html_report import OtherCamera, write_html_report
from selenium import webdriver

DOCS = Path(__file__).parent
BOARD_FILE = DOCS.parent / 'config' / 'boards' / 'chessboard_9x6_25mm.yaml'
SIZE = (800, 600)
CAMERA = DivisionCamera(470.0, (410.0, 292.0), -0.3)
# The picture shows the way to the next view after so many views, at this share of the way; the
# report is of so many views, and compares with the camera in the picture.
VIEWS, SHARE, ALL_VIEWS = 3, 0.5, 9
FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.6]))


class Person:
    """Moves a board in front of the camera from one place to the next."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._renderer = Renderer(CAMERA, SIZE, background=_room(), falloff=0.3)
        self._pose: Pose | None = None
        self.images: list[ImageArray] = []

    def move(self, target: Pose, share: float = 1.0) -> ImageArray:
        """Move the board to a target, or by a share of the way; return the image there."""
        start = self._pose or target
        turn = Pose(target.rotation @ start.rotation.T, np.zeros(3)).rotation_vector
        rotation = Pose.from_rotation_vector(share * turn, np.zeros(3)).rotation
        place = start.translation + share * (target.translation - start.translation)
        self._pose = Pose(rotation @ start.rotation, place)
        return self.image(self._pose)

    def image(self, pose: Pose, blur_px: float = 0.7) -> ImageArray:
        """Return an image of the board."""
        seed = len(self.images)
        self.images.append(
            self._renderer.render(
                self._board, pose, blur_sigma_px=blur_px, noise_sigma=8.0, seed=seed
            )
        )
        return self.images[-1]


def _room() -> Array:
    """Return the grey levels of a wall with straight seams, as the camera sees it."""
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)
    rays = CAMERA.unproject(pixels)
    x, y = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    level = 120.0 - 22.0 * y + 10.0 * np.sin(1.7 * x)
    for at, step in ((x, 0.4), (y, 0.25)):
        seam = np.abs((at / step) % 1.0 - 0.5) > 0.47
        level = np.where(seam, level - 26.0, level)
    return np.clip(level, 20.0, 220.0)


def main() -> None:
    """Write docs/live.png, docs/live_phone.png and docs/report.png."""
    boards = load_boards(BOARD_FILE)
    [board] = boards.values()
    with tempfile.TemporaryDirectory() as folder:
        session = LiveSession(boards, Path(folder, 'camera.yaml'))
        session.set_source(SourceState.RUNNING, 'camera 0')
        server, person = LiveServer(session, '127.0.0.1', 0), Person(board)
        server.start()
        try:
            _follow(session, person, VIEWS - 1)
            session.process(person.image(FACING, blur_px=12.0), f'image {len(person.images)}')
            _follow(session, person, VIEWS)
            target = session.snapshot.progress.target
            assert target is not None
            _show(session, person, target.camera_from_board, SHARE)
            early = session.calibration()
            assert early is not None
            browser = _browser(folder)
            browser.get(server.url)
            _shoot(browser, DOCS / 'live.png', 1360, 940)
            _shoot(browser, DOCS / 'live_phone.png', 390, 844)
            _follow(session, person, ALL_VIEWS)
            other = OtherCamera('early.yaml', early)
            _write_report(Path(folder, 'report.html'), board, person.images, other)
            browser.get(Path(folder, 'report.html').as_uri())
            _shoot(browser, DOCS / 'report.png', 1240, 1500)
            browser.quit()
        finally:
            server.stop()


def _follow(session: LiveSession, person: Person, views: int) -> None:
    """Take views as a person does who follows the page."""
    while len(session.snapshot.progress.views) < views:
        target = session.snapshot.progress.target
        _show(session, person, target.camera_from_board if target else FACING)


def _show(session: LiveSession, person: Person, target: Pose, share: float = 1.0) -> None:
    session.process(person.move(target, share), f'image {len(person.images)}')


def _write_report(path: Path, board: Board, images: list[ImageArray], other: OtherCamera) -> None:
    run = CalibrationRun(board, EstimateOptions(), with_thumbnails=True)
    for i, image in enumerate(images):
        run.add(NamedImage(f'image{i + 1:02}.png', image))
    assert run.fused is not None
    calibration = Calibration.from_estimate(run.fused, SIZE, 'front')
    write_html_report(path, run, calibration, other)


def _browser(folder: str) -> webdriver.Chrome:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which('chromium') or ''
    for switch in ('headless', 'no-sandbox', 'disable-gpu', 'no-first-run', 'disable-sync'):
        options.add_argument(f'--{switch}')
    options.add_argument(f'--user-data-dir={folder}/chromium')
    service = webdriver.ChromeService(executable_path=shutil.which('chromedriver'))
    return webdriver.Chrome(options=options, service=service)


def _shoot(browser: webdriver.Chrome, path: Path, width: int, height: int) -> None:
    size = {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': width < 500}
    browser.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', size)
    light = {'features': [{'name': 'prefers-color-scheme', 'value': 'light'}]}
    browser.execute_cdp_cmd('Emulation.setEmulatedMedia', light)
    browser.execute_script('window.dispatchEvent(new Event("resize"))')
    time.sleep(2.0)
    browser.save_screenshot(str(path))


if __name__ == '__main__':
    main()
