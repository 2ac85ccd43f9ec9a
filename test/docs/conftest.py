# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A folder with the files that the pages and examples use, rendered."""

import dataclasses
import importlib
from pathlib import Path
import shutil

from blocks import ROOT
import cv2
from p4pfr_ros import cli, DivisionCamera
from p4pfr_ros.files.calibration import load_calibration, save_calibration
from p4pfr_ros.files.images import read_image, write_image
import pytest


@pytest.fixture(scope='session')
def draw_tour():
    """Give the script that draws the figures of the tour."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / 'docs')
        yield importlib.import_module('draw_tour')


@pytest.fixture(scope='session')
def prepared(draw_tour, tmp_path_factory):
    """
    Make the files once.

    webcam/ is that of the tour; left01.jpg to left08.jpg are seen by the camera of the README;
    images/ has the same; recording is a bag of them, and walk.mp4 a video; other.yaml is another
    camera.
    """
    folder = tmp_path_factory.mktemp('pages')
    boards = ROOT / 'config' / 'boards'
    shutil.copy(boards / 'chessboard_9x6_25mm.yaml', folder / 'board.yaml')
    shutil.copy(boards / 'bundle_36h11.yaml', folder / 'dock.yaml')
    shutil.copy(boards / 'marker_36h11_150mm.yaml', folder / 'tag.yaml')
    for name in ('webcam', 'images'):
        (folder / name).mkdir()
    draw_tour.write_views(folder / 'webcam')
    camera = DivisionCamera(focal_px=534.0, center_px=(342.0, 233.0), k=-0.30)
    draw_tour.write_views(folder / 'images', camera)
    for i, path in enumerate(sorted((folder / 'images').iterdir())[:8]):
        write_image(folder / f'left{i + 1:02}.jpg', read_image(path))
    _write_bag(folder)
    _write_video(folder)
    images, board = str(folder / 'images'), str(folder / 'board.yaml')
    assert not cli.main(['calibrate', images, '--board', board, '-o', str(folder / 'camera.yaml')])
    calibration = load_calibration(folder / 'camera.yaml')
    save_calibration(folder / 'other.yaml', dataclasses.replace(calibration, estimate=None))
    return folder


@pytest.fixture
def folder(prepared, tmp_path, monkeypatch):
    """Change to a copy of the files, beside links to the folders of the repository."""
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    for name in ('config', 'docs', 'examples', 'launch'):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '200')
    return tmp_path


def _write_bag(folder: Path) -> None:
    import recorded

    images = [read_image(path) for path in sorted((folder / 'images').iterdir())]
    messages = [recorded.image_message(image, i) for i, image in enumerate(images)]
    recorded.write_bag(folder / 'recording', 'mcap', {'/image': messages})


def _write_video(folder: Path) -> None:
    images = [cv2.imread(str(path)) for path in sorted((folder / 'images').iterdir())]
    size = images[0].shape[1::-1]
    video = cv2.VideoWriter(str(folder / 'walk.mp4'), cv2.VideoWriter.fourcc(*'mp4v'), 10.0, size)
    for image in images:
        for _ in range(5):
            video.write(image)
    video.release()
