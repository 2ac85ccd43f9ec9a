# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Images are read from bags unchanged; damaged bags are reported in one line."""

from dataclasses import replace
from pathlib import Path
import subprocess
import sys

import numpy as np
from p4pfr_ros.files.bags import ImageBag
from p4pfr_ros.files.dependencies import EXTRAS, install_command
from p4pfr_ros.files.pixel_formats import Unreadable
from p4pfr_ros.files.yaml_fields import ConfigError
import pytest
import recorded

COUNT = 6
RNG = np.random.default_rng(1)
IMAGES = RNG.integers(0, 256, (COUNT, 12, 16, 3), dtype=np.uint8)
GREY = IMAGES[..., 0]

over_storages = pytest.mark.parametrize('storage', recorded.STORAGES)


def topics():
    """Make the topics of a camera, raw and compressed, and one of text."""
    return {
        '/image': [recorded.image_message(p, i) for i, p in enumerate(GREY)],
        '/image/compressed': [recorded.compressed_message(p, i) for i, p in enumerate(IMAGES)],
        '/chatter': [recorded.text_message('hello')] * COUNT,
    }


@pytest.fixture(scope='module', params=recorded.STORAGES)
def bag(request, tmp_path_factory):
    """Return the path of a bag in each storage."""
    path = tmp_path_factory.mktemp('bags') / request.param
    return recorded.write_bag(path, request.param, topics())


def read(path, topic=None, every=1):
    """Read the topic, the count and all images."""
    with ImageBag(path, topic) as bag:
        return bag.topic, bag.count, list(bag.images(every))


def error_of(path, topic=None):
    """Return the one-line error for a bag."""
    with pytest.raises(ConfigError) as error:
        read(path, topic)
    assert '\n' not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(('topic', 'expected'), [('/image', GREY), ('/image/compressed', IMAGES)])
def test_images_are_in_order_with_their_stamps(bag, topic, expected):
    chosen, count, images = read(bag, topic)
    assert (chosen, count) == (topic, COUNT)
    first_ns = recorded.FIRST_STAMP_S * 10**9 + 25_000_000
    assert [i.stamp_ns for i in images] == [first_ns + n * 10**9 for n in range(COUNT)]
    np.testing.assert_array_equal([image.image for image in images], expected)


def test_every_third_image_is_read(bag):
    _, _, images = read(bag, '/image', every=3)
    np.testing.assert_array_equal([image.image for image in images], GREY[::3])


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [('sqlite3', 'FILE'), ('sqlite3', 'MESSAGE'), ('mcap', 'MESSAGE'), ('mcap', 'STORAGE')],
)
def test_compressed_bags_are_read(tmp_path, storage, compression):
    path = recorded.write_bag(tmp_path / 'bag', storage, topics(), compression=compression)
    _, _, images = read(path, '/image')
    np.testing.assert_array_equal([image.image for image in images], GREY)


@over_storages
def test_a_bag_file_is_read_without_its_directory_and_the_only_topic_is_the_default(
    tmp_path, storage
):
    only = {'/cam/image_raw': topics()['/image'], '/chatter': topics()['/chatter']}
    path = Path(recorded.write_bag(tmp_path / 'bag', storage, only))
    (path / 'metadata.yaml').unlink()
    assert error_of(path) == f'{path}: expected a rosbag2: it has no metadata.yaml'
    topic, count, images = read(path / f'bag{recorded.ENDINGS[storage]}')
    assert (topic, count, len(images)) == ('/cam/image_raw', COUNT, COUNT)


def test_a_bag_without_a_message_count_is_read_to_its_end(tmp_path):
    path = Path(recorded.write_bag(tmp_path / 'bag', 'sqlite3', {'/image': topics()['/image']}))
    metadata = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(
        metadata.replace(f'message_count: {COUNT}', 'message_count: 0')
    )
    _, count, images = read(path)
    assert count is None
    assert len(images) == COUNT


def test_an_unreadable_image_has_a_reason_and_does_not_affect_the_others(tmp_path):
    messages = topics()['/image']
    messages[1] = replace(messages[1], encoding='64FC1')
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': messages})
    _, _, images = read(path)
    unreadable = [image for image in images if isinstance(image.image, Unreadable)]
    assert [image.stamp_ns for image in unreadable] == [
        recorded.FIRST_STAMP_S * 10**9 + 1_025_000_000
    ]
    assert unreadable[0].image.reason.startswith("image: unknown encoding '64FC1'")
    assert len(images) == COUNT


def test_a_malformed_message_is_unreadable(tmp_path):
    kind = 'sensor_msgs/msg/Image'
    malformed = {'/image': [recorded.text_message('not an image')]}
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', malformed, types={'/image': kind})
    [image] = read(path)[2]
    assert image.image == Unreadable('layout', f'image: expected a {kind}')
    assert image.stamp_ns == recorded.FIRST_STAMP_S * 10**9 + 5


def test_a_zero_stamp_is_replaced_by_the_recording_time(tmp_path):
    zero = recorded.image_message(GREY[0], None)
    path = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': [zero]})
    [image] = read(path)[2]
    assert image.stamp_ns == recorded.FIRST_STAMP_S * 10**9 + 5


def test_wrong_topic_lists_the_image_topics(bag, tmp_path):
    available = 'image topics: /image, /image/compressed'
    assert error_of(bag) == f'{bag}: expected --topic to choose one; {available}'
    assert error_of(bag, '/nothing') == f'{bag}: no topic /nothing; {available}'
    of_text = '/chatter is of type std_msgs/msg/String'
    assert error_of(bag, '/chatter') == f'{bag}: {of_text}; {available}'
    talk = recorded.write_bag(
        tmp_path / 'talk', 'mcap', {'/chatter': [recorded.text_message('hello')]}
    )
    assert error_of(talk).endswith('choose one; image topics: none')


@over_storages
@pytest.mark.parametrize('share', [0.0, 0.01, 0.5, 0.8])
def test_truncated_bags_are_reported(tmp_path, storage, share):
    whole = Path(recorded.write_bag(tmp_path / 'bag', storage, topics()))
    ending = recorded.ENDINGS[storage]
    data = (whole / f'bag{ending}').read_bytes()
    cut = tmp_path / f'cut{ending}'
    cut.write_bytes(data[: int(share * len(data))])
    assert error_of(cut, '/image').startswith(f'{cut}: expected an intact rosbag2 (')


def test_other_files_are_reported(tmp_path):
    assert error_of(tmp_path / 'none').endswith('none: expected a rosbag2: no such file')
    other = tmp_path / 'notes.txt'
    other.write_text('hello')
    assert error_of(other).startswith(f'{other}: expected an intact rosbag2 (')


def test_without_rosbags_the_error_names_the_extra():
    code = (
        "import sys; sys.modules['rosbags'] = None\n"
        'from p4pfr_ros.files.bags import ImageBag\n'
        "ImageBag('bag')"
    )
    err = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True).stderr
    assert err.splitlines()[-1] == (
        'p4pfr_ros.files.yaml_fields.ConfigError: reading bags needs rosbags: '
        f'{install_command(EXTRAS["rosbags"])}'
    )
