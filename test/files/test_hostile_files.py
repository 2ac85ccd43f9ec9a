# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that would block, or fill the memory: one short line, at once."""

import os
import resource
import subprocess
import sys

from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.printable import printable, printable_path, shown
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.files.yaml_reading import read_yaml
import pytest
from test_camera_formats import model

LAUGHS = 'a0: &a0 [lol, lol]\n' + ''.join(
    f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]\n' for n in range(1, 12)
)
MERGES = 'a0: &a0 {x: 1}\n' + ''.join(
    f'a{n}: &a{n}\n  <<: [{", ".join([f"*a{n - 1}"] * 9)}]\n' for n in range(1, 12)
)
HOSTILE = {
    'laughs': LAUGHS,
    'merges': MERGES,
    'recursion': 'a: &a [*a]',
    'flow nesting': '[' * 1_000_000,
    'block nesting': '- ' * 100_000,
    'key nesting': '? ' * 100_000,
    'mapping nesting': '{a: ' * 100_000,
    'values': '[' + '1,' * 2_000_000 + ']',
    'documents': '--- 1\n' * 300_000,
    'empty documents': '---\n' * 300_000,
    'digits': 'image_width: 1' + 5_000_000 * '0',
    'sexagesimal': 'image_width: 1' + 1_000_000 * ':1',
    'hexadecimal': 'image_width: 0x' + 1_000_000 * 'f',
    'directives': '%TAG !a! tag:a,2000:\n' * 400_000 + '--- 1',
    'date': 'image_width: 2026-13-45',
    'tagged date': 'image_width: !!timestamp x',
    'tagged integer': 'image_width: !!int ""',
    'tagged digits': 'image_width: !!int "' + 1_000_000 * '1:' + '1"',
    'tagged truth': 'image_width: !!bool x',
    'python': 'image_width: !!python/object/apply:os.system [ls]',
    'matrix': 'image_width: !!opencv-matrix 7',
    'key': '\x1b[2J\n' + 'k' * 1_000_000 + ': 1',
    'escape': 'image_width: "\\e[2J\\u202e\\n"',
    'long word': 'image_width: ' + 'w' * 5_000_000,
    'null': 'image_width: "\\0"',
    'not text': '\x00\x01',
    'too large': ' ' * 10_000_001,
}


@pytest.mark.parametrize('load', [load_calibration, load_boards])
@pytest.mark.parametrize('text', HOSTILE.values(), ids=HOSTILE)
def test_hostile_text_gives_one_short_line(tmp_path, text, load):
    """The time is limited by the suite's timeout, and the memory here."""
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    rejected(load, path)


def rejected(load, path):
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ConfigError) as caught:
        load(path)
    line = str(caught.value)
    assert line.isprintable()
    assert len(line) <= 200
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000
    return line


def test_only_regular_files_are_read(tmp_path):
    """Without waiting for the other end of a pipe."""
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to(tmp_path / 'link')
    assert 'a regular file, got a pipe' in rejected(load_calibration, tmp_path / 'pipe')
    assert 'a regular file, got a device' in rejected(load_calibration, '/dev/zero')
    assert 'a regular file, got a directory' in rejected(load_calibration, tmp_path)
    assert 'expected a readable file' in rejected(load_calibration, tmp_path / 'link')
    assert 'a null character' in rejected(load_calibration, 'a\0b')
    assert 'expected a readable file' in rejected(load_calibration, 'x' * 5000)
    assert rejected(load_calibration, tmp_path / 'a\x1b[2J\nb').endswith(
        'No such file or directory'
    )


def test_only_regular_files_are_written(tmp_path):
    calibration = Calibration(
        image_size=(640, 480), camera_name='x', model=model('plumb_bob', [0.0] * 5)
    )
    os.mkfifo(tmp_path / 'pipe')
    os.symlink('/dev/null', tmp_path / 'link')

    def save(path):
        save_calibration(path, calibration)

    for path in (tmp_path / 'pipe', tmp_path / 'link', tmp_path, '/dev/null', 'a\0b'):
        rejected(save, path)
    assert {entry.name for entry in tmp_path.iterdir()} == {'pipe', 'link'}


def test_anchors_and_merges_of_honest_files_are_read(tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_text('a: &a {x: 1, y: 2}\nb:\n  <<: *a\n  y: 3\nc: [*a, *a]\n')
    a = {'x': 1, 'y': 2}
    assert read_yaml(path) == {'a': a, 'b': {'x': 1, 'y': 3}, 'c': [a, a]}


def test_files_are_read_without_libyaml(tmp_path):
    """The parser in Python obeys the same limits."""
    (tmp_path / 'laughs.yaml').write_text(LAUGHS)
    (tmp_path / 'file.yaml').write_text('%YAML:1.0\n---\na: !!opencv-matrix\n   rows: 1\n')
    code = f"""
import sys
sys.modules['yaml.cyaml'] = None
from p4pfr_ros.files.yaml_reading import _SafeLoader, read_yaml
print(_SafeLoader.__module__, read_yaml({str(tmp_path / 'file.yaml')!r}))
read_yaml({str(tmp_path / 'laughs.yaml')!r})
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.stdout == "yaml.loader {'a': {'rows': 1}}\n"
    assert done.stderr.splitlines()[-1].endswith('expected YAML: more than 50000 values')


@pytest.mark.parametrize(
    ('text', 'limit', 'expected'),
    [
        ('a b', 9, 'a b'),
        ('a\nb\x1b[2J\x07', 99, r'a\nb\x1b[2J\x07'),
        ('\u202e\udcff', 99, r'\u202e\udcff'),
        ('abcdefgh', 5, 'ab...'),
        ('\n' * 10**7, 8, r'\n\n\...'),
    ],
)
def test_text_is_printed_in_one_line(text, limit, expected):
    assert printable(text, limit) == expected


def test_values_and_paths_are_cut():
    assert shown(None) == 'nothing'
    assert shown('\n' * 10**6).startswith(r"'\n\n")
    assert max(len(shown(v)) for v in ('x' * 10**6, [['x' * 99] * 99] * 99, 10**99)) <= 43
    assert printable_path('/a/' + 'b' * 500 + '/c.yaml').endswith('b/c.yaml')
    assert len(printable_path('/\n' * 500)) == 100
