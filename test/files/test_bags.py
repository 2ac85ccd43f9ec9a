# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures come out of recordings as they went in, and broken recordings are named."""

from dataclasses import replace
from pathlib import Path
import subprocess
import sys

import numpy as np
from p4pfr_ros.files.bags import ImageBag
from p4pfr_ros.files.boards import ConfigError
from p4pfr_ros.files.pixel_formats import Unreadable
import pytest
import recorded

COUNT = 6
RNG = np.random.default_rng(1)
PICTURES = RNG.integers(0, 256, (COUNT, 12, 16, 3), dtype=np.uint8)
GREY = PICTURES[..., 0]

over_storages = pytest.mark.parametrize('storage', recorded.STORAGES)


def topics():
    """Make a camera's topics, raw and compressed, among others."""
    return {
        '/image': [recorded.image(p, i) for i, p in enumerate(GREY)],
        '/image/compressed': [recorded.compressed(p, i) for i, p in enumerate(PICTURES)],
        '/chatter': [recorded.text('hello')] * COUNT,
    }


@pytest.fixture(scope='module', params=recorded.STORAGES)
def bag(request, tmp_path_factory):
    """Give the path of a recording in each storage."""
    path = tmp_path_factory.mktemp('bags') / request.param
    return recorded.write_bag(path, request.param, topics())


def read(path, topic=None, every=1):
    """Read everything: topic, count and pictures."""
    with ImageBag(path, topic) as bag:
        return bag.topic, bag.count, list(bag.images(every))


def error_of(path, topic=None):
    """Give the one line that a recording is refused with."""
    with pytest.raises(ConfigError) as error:
        read(path, topic)
    assert '\n' not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ('topic', 'expected'), [('/image', GREY), ('/image/compressed', PICTURES)]
)
def test_pictures_come_in_order_with_their_stamps(bag, topic, expected):
    chosen, count, images = read(bag, topic)
    assert (chosen, count) == (topic, COUNT)
    first_ns = recorded.FIRST_STAMP_S * 10**9 + 25_000_000
    assert [i.stamp_ns for i in images] == [first_ns + n * 10**9 for n in range(COUNT)]
    np.testing.assert_array_equal([image.picture for image in images], expected)


def test_every_third_is_every_third(bag):
    _, _, images = read(bag, '/image', every=3)
    np.testing.assert_array_equal([image.picture for image in images], GREY[::3])


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [('sqlite3', 'FILE'), ('sqlite3', 'MESSAGE'), ('mcap', 'MESSAGE'), ('mcap', 'STORAGE')],
)
def test_compressed_recordings_are_read(tmp_path, storage, compression):
    path = recorded.write_bag(tmp_path / 'bag', storage, topics(), compression=compression)
    _, _, images = read(path, '/image')
    np.testing.assert_array_equal([image.picture for image in images], GREY)


@over_storages
def test_the_file_alone_is_enough_and_its_only_topic_needs_no_name(tmp_path, storage):
    only = {'/cam/image_raw': topics()['/image'], '/chatter': topics()['/chatter']}
    path = Path(recorded.write_bag(tmp_path / 'bag', storage, only))
    (path / 'metadata.yaml').unlink()
    assert error_of(path) == f'{path}: expected a rosbag2: no metadata.yaml in there'
    topic, count, images = read(path / f'bag{recorded.ENDINGS[storage]}')
    assert (topic, count, len(images)) == ('/cam/image_raw', COUNT, COUNT)


def test_a_recording_that_lost_count_is_read_to_its_end(tmp_path):
    path = Path(recorded.write_bag(tmp_path / 'bag', 'sqlite3', {'/image': topics()['/image']}))
    said = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(
        said.replace(f'message_count: {COUNT}', 'message_count: 0')
    )
    _, count, images = read(path)
    assert count is None
    assert len(images) == COUNT


def test_a_picture_that_cannot_be_read_says_why_and_the_others_come(tmp_path):
    messages = topics()['/image']
    messages[1] = replace(messages[1], encoding='32FC1')
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': messages})
    _, _, images = read(path)
    wrong = [image for image in images if isinstance(image.picture, Unreadable)]
    assert [image.stamp_ns for image in wrong] == [recorded.FIRST_STAMP_S * 10**9 + 1_025_000_000]
    assert wrong[0].picture.reason.startswith("image: the encoding '32FC1' is unknown")
    assert len(images) == COUNT


def test_a_message_of_rubbish_is_no_picture(tmp_path):
    kind = 'sensor_msgs/msg/Image'
    rubbish = {'/image': [recorded.text('not what it says')]}
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', rubbish, types={'/image': kind})
    [image] = read(path)[2]
    assert image.picture == Unreadable('layout', f'image: expected a {kind}')
    assert image.stamp_ns == recorded.FIRST_STAMP_S * 10**9 + 5


def test_a_stamp_of_zero_gives_way_to_the_time_of_recording(tmp_path):
    zero = recorded.image(GREY[0], None)
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': [zero]})
    [image] = read(path)[2]
    assert image.stamp_ns == recorded.FIRST_STAMP_S * 10**9 + 5


def test_wrong_topics_are_told_the_right_ones(bag, tmp_path):
    there = 'topics with pictures: /image, /image/compressed'
    assert error_of(bag) == f'{bag}: expected --topic to choose one; {there}'
    assert error_of(bag, '/nothing') == f'{bag}: no topic /nothing; {there}'
    of_text = '/chatter is of type std_msgs/msg/String'
    assert error_of(bag, '/chatter') == f'{bag}: {of_text}; {there}'
    talk = recorded.write_bag(tmp_path / 'talk', 'mcap', {'/chatter': [recorded.text('hello')]})
    assert error_of(talk).endswith('choose one; topics with pictures: none')


@over_storages
@pytest.mark.parametrize('share', [0.0, 0.01, 0.5, 0.8])
def test_recordings_that_are_cut_short_are_named(tmp_path, storage, share):
    whole = Path(recorded.write_bag(tmp_path / 'bag', storage, topics()))
    ending = recorded.ENDINGS[storage]
    data = (whole / f'bag{ending}').read_bytes()
    cut = tmp_path / f'cut{ending}'
    cut.write_bytes(data[: int(share * len(data))])
    assert error_of(cut, '/image').startswith(f'{cut}: expected a whole rosbag2 (')


def test_what_is_no_recording_is_named(tmp_path):
    assert error_of(tmp_path / 'none').endswith('none: expected a rosbag2: no such file')
    other = tmp_path / 'notes.txt'
    other.write_text('hello')
    assert error_of(other).startswith(f'{other}: expected a whole rosbag2 (')


def test_without_the_library_it_says_what_to_install():
    code = (
        "import sys; sys.modules['rosbags'] = None\n"
        'from p4pfr_ros.files.bags import ImageBag\n'
        "ImageBag('bag')"
    )
    err = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True).stderr
    assert err.splitlines()[-1] == (
        'p4pfr_ros.files.boards.ConfigError: recordings are read by the library rosbags: '
        "pip install 'p4pfr_ros[bags]'"
    )
