# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate`` on bags: the same result as from the same images in files."""

import json
from pathlib import Path

from p4pfr_ros.cli import main
from p4pfr_ros.files.images import read_image
import pytest
import recorded
from rendered import CHESSBOARD, write_empty, write_views

COUNT = 5


@pytest.fixture(scope='module')
def image_paths(tmp_path_factory):
    """Return the paths of a few views, and of an image without a board."""
    folder = tmp_path_factory.mktemp('views')
    paths = write_views(folder, COUNT)
    write_empty(folder / 'empty.png')
    return [*paths, folder / 'empty.png']


def calibrate(*arguments):
    """Run the command; it writes an uncalibrated camera as well."""
    return main(['calibrate', '--board', CHESSBOARD, '--force', *map(str, arguments)])


def json_lines(capsys):
    """Parse stdout line by line."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


@pytest.fixture
def from_files(image_paths, tmp_path, capsys):
    """Return the camera calibrated from the images in files."""
    assert calibrate(*image_paths, '-o', tmp_path / 'files.yaml', '--json') == 0
    return json_lines(capsys)[-1]['calibration']


@pytest.mark.parametrize(
    ('storage', 'message', 'topic'),
    [
        ('sqlite3', recorded.image_message, '/camera/image_raw'),
        ('mcap', recorded.compressed_message, '/camera/image_raw/compressed'),
    ],
)
def test_bag_gives_the_same_camera(
    image_paths, from_files, tmp_path, capsys, storage, message, topic
):
    messages = [message(read_image(path), i) for i, path in enumerate(image_paths)]
    topics = {topic: messages, '/other': messages[:1]}
    bag = recorded.write_bag(tmp_path / 'bag', storage, topics)
    output = tmp_path / 'bag.yaml'
    assert calibrate('--bag', bag, '--topic', topic, '-o', output, '--json') == 0
    *views, last = json_lines(capsys)
    first_s = recorded.FIRST_STAMP_S
    assert [view['name'] for view in views] == [f'{first_s + i}.025000000' for i in range(6)]
    assert last['calibration'] == from_files
    assert output.read_text() == (tmp_path / 'files.yaml').read_text()


def test_rejected_images_of_a_bag_are_counted(image_paths, tmp_path, capsys):
    messages = [recorded.image_message(read_image(path), i) for i, path in enumerate(image_paths)]
    bag = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': [*messages, *messages[-1:] * 6]})
    assert calibrate('--bag', bag, '-o', tmp_path / 'camera.yaml') == 0
    out, err = capsys.readouterr()
    assert err.endswith(f'p4pfr: {bag} /image: 7 images: no 9x6 chessboard found\n')
    assert err.count('no 9x6') == 1
    assert out.count('.025000000') == COUNT


def test_every_third_image_of_a_bag_is_used(image_paths, tmp_path, capsys):
    messages = [recorded.image_message(read_image(path), i) for i, path in enumerate(image_paths)]
    bag = recorded.write_bag(tmp_path / 'bag', 'sqlite3', {'/image': messages})
    calibrate('--bag', bag, '-o', tmp_path / 'camera.yaml', '--json', '--every', 3)
    names = [line['name'] for line in json_lines(capsys)[:-1]]
    assert names == [f'{recorded.FIRST_STAMP_S + i}.025000000' for i in (0, 3)]


def test_missing_topic_lists_the_image_topics(image_paths, tmp_path, capsys):
    message = recorded.image_message(read_image(image_paths[0]), 0)
    bag = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/left': [message], '/right': [message]})
    output = tmp_path / 'camera.yaml'
    assert calibrate('--bag', bag, '--topic', '/image', '-o', output) == 1
    assert capsys.readouterr().err == (
        f'p4pfr: {bag}: no topic /image; image topics: /left, /right\n'
    )
    assert not output.exists()


def test_truncated_bag_is_reported_in_one_line(image_paths, tmp_path, capsys):
    message = recorded.image_message(read_image(image_paths[0]), 0)
    bag = Path(recorded.write_bag(tmp_path / 'bag', 'sqlite3', {'/image': [message] * 3}))
    whole = (bag / 'bag.db3').read_bytes()
    (bag / 'bag.db3').write_bytes(whole[: len(whole) // 2])
    assert calibrate('--bag', bag, '-o', tmp_path / 'camera.yaml') == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith(f'p4pfr: {bag}: expected an intact rosbag2 (')
    assert err.count('\n') == 1
