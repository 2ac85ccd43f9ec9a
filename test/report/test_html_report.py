# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The HTML report, as ``p4pfr calibrate --report`` writes it and a browser shows it."""

import re

import cv2
import numpy as np
from p4pfr_ros.cli import main
from p4pfr_ros.files.images import write_image
import pytest
from rendered import CHESSBOARD, write_empty, write_views


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Calibrate two cameras, and compare them in a report of images with a hostile name."""
    folder = tmp_path_factory.mktemp('report')
    views = write_views(folder, 8)
    write_empty(folder / 'empty <b>&.png')
    (folder / 'broken.png').write_bytes(b'\x89PNG\r\n\x1a\n')
    camera, other, report = (
        folder / name for name in ('camera.yaml', 'other.yaml', 'report.html')
    )
    common = ['--board', CHESSBOARD, '--json']
    assert main(['calibrate', *map(str, views[:5]), '-o', str(other), '--force', *common]) == 0
    images = sorted(map(str, folder.glob('*.png')))
    arguments = [*images, '-o', str(camera), '--report', str(report), '--compare', str(other)]
    assert main(['calibrate', *arguments, '--name', 'front', *common]) == 0
    return folder


@pytest.fixture
def html(folder):
    return (folder / 'report.html').read_text()


def section(html, name):
    """Return a section's text without tags."""
    [found] = re.findall(rf'<section id="{name}".*?</section>', html, re.DOTALL)
    return ' '.join(re.sub(r'<[^>]*>', ' ', found).split())


def test_the_report_loads_nothing(html):
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', html)
    assert 'url(' not in html
    assert '@import' not in html
    assert '<script' not in html
    assert "default-src 'none'" in html


def test_names_of_files_are_text(html):
    assert 'empty &lt;b&gt;&amp;.png' in html
    assert '<b>' not in html


def test_the_summary_says_what_matters(html):
    words = section(html, 'summary')
    assert 'calibrated: all uncertainties are within tolerance' in words
    assert 'estimated from 8 views; 2 of 10 images were rejected' in words
    assert re.search(r'focal length is 4\d\d\.\d+ ± 0\.\d+ px: known to 0\.\d+ %', words)
    assert re.search(r'a projection is known to 0\.\d+ px at worst', words)


def test_the_camera_is_that_of_the_file(html, folder):
    text = (folder / 'camera.yaml').read_text()
    focal = float(re.search(r'focal_px: ([\d.]+)', text).group(1))
    words = section(html, 'camera')
    shown = float(re.search(r'focal length ([\d.]+) ±', words).group(1))
    assert shown == pytest.approx(focal, abs=0.01)
    assert 'distortion_model' in words


def test_every_view_has_a_row_with_its_image(html):
    [views] = re.findall(r'<section id="views".*?</section>', html, re.DOTALL)
    assert len(re.findall(r'<tr><td><img', views)) == 8
    assert views.count('class="verdict used"') == 8
    words = section(html, 'rejected-images')
    assert 'no 9x6 chessboard found' in words
    assert 'truncated' in words


def test_the_comparison_states_the_difference(html):
    words = section(html, 'comparison')
    assert 'other.yaml: where points were seen, the projections differ by' in words
    assert re.search(r'differ by 0\.\d+ px at most', words)


def test_a_browser_shows_it(folder, open_page):
    """Without an error or a request, on a phone as well, and readable in both schemes."""
    page = open_page((folder / 'report.html').as_uri())
    assert page.text('h1') == 'Calibration of “front”'
    images = page.browser.execute_script(
        """
        return [...document.images].map((image) => {
          image.loading = 'eager';
          return image.src.slice(0, 5);
        });
        """
    )
    assert set(images) == {'data:'}
    page.until(
        lambda: page.browser.execute_script(
            'return [...document.images].every((i) => i.complete && i.naturalWidth > 0)'
        )
    )
    for title in ('Projection uncertainty', 'Coverage', 'Residuals', 'Distortion', 'Focal length'):
        figure = f'//figure[h3="{title}"]//*[name()="svg"]'
        assert page.browser.find_element('xpath', figure).size['width'] > 200
    entries = page.browser.execute_script('return performance.getEntriesByType("resource")')
    assert [e['name'] for e in entries if not e['name'].startswith('data:')] == []
    assert page.low_contrast() == []
    assert page.width_on_a_phone() == 360
    assert page.problems() == []


def test_a_camera_of_another_size_cannot_be_compared(folder, tmp_path, capsys):
    small = cv2.resize(cv2.imread(str(folder / 'view00.png')), (320, 240))
    write_image(tmp_path / 'small.png', np.asarray(small))
    camera, report = tmp_path / 'camera.yaml', tmp_path / 'report.html'
    arguments = [tmp_path / 'small.png', '-o', camera, '--force', '--report', report]
    arguments += ['--compare', folder / 'camera.yaml', '--board', CHESSBOARD, '--json']
    assert main(['calibrate', *map(str, arguments)]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error == (f'p4pfr: {folder}/camera.yaml: expected a camera of 320x240 px, got 640x480')


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (['--compare', 'camera.yaml'], '--compare requires --report'),
        (['--report', 'report.png'], 'report.png: expected a file name ending in .html'),
        (
            ['--report', 'report.html', '--compare', 'none.yaml'],
            'none.yaml: expected a readable file',
        ),
    ],
)
def test_what_is_wrong_is_said_before_the_images_are_read(
    options, words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    arguments = ['calibrate', 'none.png', '--board', CHESSBOARD, '-o', 'c.yaml', '--json']
    try:
        status = main([*arguments, *options])
    except SystemExit as error:
        status = error.code
    assert status != 0
    output = capsys.readouterr()
    assert words in output.err
    assert output.out == ''
