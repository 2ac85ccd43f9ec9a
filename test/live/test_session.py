# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live session: from images to a camera, its file, and what the page is told."""

import itertools
import json
import struct

import cv2
import numpy as np
from p4pfr_ros import CalibrationOptions, CalibrationState, EstimateOptions
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.files.images import read_image
from p4pfr_ros.live.message import MessageWriter
from p4pfr_ros.live.session import LiveSession, SourceState
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K


@pytest.fixture
def session(tmp_path):
    return LiveSession(load_boards(CHESSBOARD), tmp_path / 'camera.yaml', 'front')


@pytest.fixture(scope='session')
def views(images):
    """Return the images by name, in order."""
    return {path.name: read_image(path) for path in sorted(images.iterdir())}


@pytest.fixture
def calibrated(session, views):
    for name, image in views.items():
        session.process(image, name)
    return session


def message_of(session, maps=-1):
    """Return the JSON of a message and its two images, decoded."""
    data = MessageWriter().write(session.snapshot, session.options, maps)
    lengths = struct.unpack('>3I', data[:12])
    ends = np.cumsum([12, *lengths])
    text, *images = (data[a:b] for a, b in itertools.pairwise(ends))
    assert ends[-1] == len(data)
    decoded = [
        cv2.imdecode(np.frombuffer(each, np.uint8), cv2.IMREAD_UNCHANGED) if each else None
        for each in images
    ]
    return json.loads(text), *decoded


def test_images_make_a_camera(calibrated, views):
    progress = calibrated.snapshot.progress
    assert progress.state is CalibrationState.CALIBRATED
    assert progress.missing == ()
    assert len(progress.changes) == progress.estimate.views == len(views) - 1
    assert abs(progress.estimate.camera.k - K) < 5.0 * progress.estimate.k_sigma
    assert calibrated.snapshot.number == len(views)
    [rejected] = calibrated.snapshot.rejected
    assert (rejected.reason, rejected.name) == ('no 9x6 chessboard found', 'view03a.png')


def test_the_camera_is_saved_in_the_format_of_all_tools(calibrated):
    assert not calibrated.is_saved
    is_saved, words = calibrated.save()
    assert is_saved
    assert words == f'saved to {calibrated.output}' == calibrated.snapshot.saved
    assert calibrated.is_saved
    saved = load_calibration(calibrated.output)
    assert saved.camera_name == 'front'
    assert saved.estimate == calibrated.snapshot.progress.estimate


def test_a_camera_that_is_not_calibrated_is_saved_with_a_warning(session, views):
    assert session.save() == (
        False,
        'nothing to save: the camera has not been estimated yet',
    )
    assert not session.output.exists()
    for image in list(views.values())[:2]:
        session.process(image, '')
    assert session.save() == (
        True,
        f'saved to {session.output}; the camera is not calibrated yet',
    )


def test_a_file_that_cannot_be_written_is_no_end(calibrated, tmp_path):
    calibrated.output = tmp_path / 'views' / 'x' / 'camera.yaml'
    (tmp_path / 'views').write_text('')
    is_saved, words = calibrated.save()
    assert not is_saved
    assert 'expected a writable path' in words
    assert not calibrated.is_saved


def test_a_paused_session_ignores_images(session, views):
    name, image = next(iter(views.items()))
    session.pause(is_paused=True)
    session.process(image, name)
    assert session.snapshot.number == 0
    session.pause(is_paused=False)
    session.process(image, name)
    assert session.snapshot.number == 1


def test_a_reset_begins_anew(calibrated, views):
    calibrated.save()
    version = calibrated.snapshot.progress.version
    calibrated.reset()
    progress = calibrated.snapshot.progress
    assert progress.estimate is None
    assert progress.views == ()
    assert progress.version > version
    assert calibrated.is_saved
    assert calibrated.output.exists()
    calibrated.process(next(iter(views.values())), '')
    assert len(calibrated.snapshot.progress.views) == 1


def test_other_options_begin_anew(calibrated):
    options, robust = CalibrationOptions(min_views=30), EstimateOptions()
    calibrated.set_options(CalibrationOptions(), robust)
    assert calibrated.snapshot.progress.estimate is not None
    calibrated.set_options(options, robust)
    assert calibrated.snapshot.progress.estimate is None


def test_an_image_of_another_size_is_rejected(session, views):
    image = next(iter(views.values()))
    session.process(image, 'large')
    session.process(image[::2, ::2].copy(), 'small')
    [rejected] = session.snapshot.rejected
    assert rejected.reason == 'expected 640x480 px like the first image, got 320x240; reset?'
    assert len(session.snapshot.progress.views) == 1


def test_the_same_reason_is_listed_once(session):
    empty = np.full((480, 640), 128, dtype=np.uint8)
    for i in range(4):
        session.process(empty, f'image {i}')
    session.reject('expected a complete image, got a truncated file', 'image 4')
    reasons = [(each.reason, each.count, each.name) for each in session.snapshot.rejected]
    assert reasons == [
        ('no 9x6 chessboard found', 4, 'image 3'),
        ('expected a complete image, got a truncated file', 1, 'image 4'),
    ]


def test_every_change_wakes_who_watches(session, views):
    heard = []
    session.add_listener(lambda: heard.append(session.snapshot.sequence))
    session.set_source(SourceState.RUNNING, 'camera 0')
    session.process(next(iter(views.values())), '')
    session.pause(is_paused=True)
    session.reset()
    assert heard == [1, 2, 3, 4]


def test_a_board_at_the_target_hears_to_hold_still(session, views):
    """The advice is about the first board, and there is none without it."""
    session.process(np.full((480, 640), 128, dtype=np.uint8), '')
    assert session.snapshot.advice is None
    session.process(next(iter(views.values())), '')
    assert session.snapshot.advice


def test_a_message_has_what_the_page_draws(calibrated, views):
    image = list(views.values())[-1]
    tree, raw, straight = message_of(calibrated)
    assert raw.shape[:2] == straight.shape[:2] == (480, 640)
    assert np.abs(raw.astype(float) - image).mean() < 3.0
    [board] = tree['boards']
    assert len(board['points']) == 2 * 54
    assert set(board['lines']) == {'outline', 'x', 'y', 'z'}
    assert board['reason'] == ''
    bars = {bar['key']: bar for bar in tree['bars']}
    assert set(bars) == {'views', 'focal', 'center', 'distortion'}
    assert all(bar['reached'] and bar['share'] == 1.0 for bar in bars.values())
    assert abs(float(bars['focal']['value'].split()[0]) - FOCAL_PX) < 2.0
    maps = tree['maps']
    assert len(maps['uncertainty']['px']) == 32 * 24
    assert sum(maps['coverage']['seen']) > 50
    assert maps['target']['lines']['outline']


def test_maps_are_sent_once(calibrated):
    version = message_of(calibrated)[0]['mapsVersion']
    assert 'maps' not in message_of(calibrated, version)[0]


def test_a_message_before_the_first_image_is_empty(session):
    tree, raw, straight = message_of(session)
    assert raw is straight is None
    assert tree['state'] == 'uncalibrated'
    assert tree['missing'] == ['show the board']
    assert tree['maps']['target'] is None


def test_large_images_are_sent_smaller(session, views):
    image = cv2.resize(next(iter(views.values())), (1920, 1440))
    session.process(image, 'large')
    tree, raw, _ = message_of(session)
    assert tree['size'] == [1920, 1440]
    assert raw.shape[:2] == (720, 960)
