# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sources of a live session: folders, images, videos and cameras."""

import shutil

import cv2
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.images import read_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.session import LiveSession, SourceState
from p4pfr_ros.live.sources import feed
import pytest
from rendered import CHESSBOARD


@pytest.fixture
def session(tmp_path):
    return LiveSession(load_boards(CHESSBOARD), tmp_path / 'camera.yaml')


def test_a_folder_is_read_to_its_end(session, images, tmp_path):
    folder = shutil.copytree(images, tmp_path / 'some')
    for path in sorted(folder.iterdir())[4:]:
        path.unlink()
    (folder / 'a_broken.png').write_bytes(b'\x89PNG\r\n\x1a\n')
    feed(session, str(folder), None)
    snapshot = session.snapshot
    assert (snapshot.source, snapshot.source_name) == (SourceState.ENDED, str(folder))
    assert snapshot.number == 5
    assert snapshot.rejected[0].name == str(folder / 'a_broken.png')
    assert len(snapshot.progress.views) == 4


def test_a_video_is_read_to_its_end(session, images, tmp_path):
    path = tmp_path / 'views.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 50.0, (640, 480))
    for each in sorted(images.glob('view0*.png'))[:3]:
        writer.write(cv2.cvtColor(read_image(each), cv2.COLOR_GRAY2BGR))
    writer.release()
    feed(session, str(path), None)
    assert session.snapshot.source is SourceState.ENDED
    assert session.snapshot.name == f'{path}#2'
    assert len(session.snapshot.progress.views) == 3


def test_a_single_image_is_a_source(session, images):
    feed(session, str(images / 'view00.png'), None)
    assert len(session.snapshot.progress.views) == 1


@pytest.mark.parametrize(
    ('source', 'reason'),
    [
        ('none.mp4', 'none.mp4: expected a video: no such file'),
        ('.', '.: expected a directory with images, got none'),
        ('63', 'camera 63: expected a camera that this user may open, got none'),
    ],
)
def test_a_source_that_is_none_is_one_line(session, source, reason, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as error:
        feed(session, source, None)
    assert str(error.value).startswith(reason)
    assert capfd.readouterr().err == ''
