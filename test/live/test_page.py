# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of ``p4pfr live`` as a person uses it, in a real browser."""

from p4pfr_ros.files.calibration import load_calibration
import pytest

# Images of a board that is held still for a while, many more than are shown in a test.
HELD, MANY = 3, 600


@pytest.fixture(scope='session')
def long_source(images, tmp_path_factory):
    """Return a folder of very many images."""
    folder, views = tmp_path_factory.mktemp('long'), sorted(images.iterdir())
    for i in range(MANY):
        (folder / f'{i:04}.png').symlink_to(views[i // HELD % len(views)])
    return folder


@pytest.fixture
def camera_file(tmp_path):
    return tmp_path / 'camera.yaml'


def is_drawn(page, canvas):
    """Return whether a canvas shows more than one colour."""
    script = """
        const canvas = document.getElementById(arguments[0]);
        const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        return new Set(new Uint32Array(data.buffer)).size > 1;
    """
    return page.browser.execute_script(script, canvas)


def test_the_page_follows_a_camera(start_live, open_page, long_source, camera_file):
    """It loads, is updated at 5 Hz or more, calibrates, and saves."""
    live = start_live(long_source, '--rate', 12, '-o', camera_file)
    page = open_page(live.url)
    page.until(lambda: page.data('rateHz') >= 5.0)
    page.until(lambda: page.text('#state') == 'calibrated')
    assert 'nothing' in page.text('#missing')
    for bar in ('focal', 'center', 'distortion'):
        assert '±' in page.text(f'#bar-{bar} .value')
        track = page.find(f'#bar-{bar} .track')
        assert track.get_attribute('role') == 'progressbar'
        assert track.get_attribute('aria-valuenow') == '100'
    for canvas in ('raw', 'pinhole', 'coverage', 'uncertainty'):
        page.until(lambda canvas=canvas: is_drawn(page, canvas))
    assert 'no 9x6 chessboard found' in page.text('#rejected')
    page.click('#save')
    page.until(lambda: 'saved to' in page.text('#toast'))
    estimate = load_calibration(camera_file).estimate
    assert abs(estimate.camera.focal_px - 420.0) < 5.0 * estimate.focal_sigma_px + 0.5
    assert page.problems() == []
    assert live.stop()[0] == 0


def test_pause_and_reset(start_live, open_page, long_source, camera_file):
    live = start_live(long_source, '--rate', 12, '-o', camera_file)
    page = open_page(live.url)
    page.until(lambda: page.text('#bar-views .value') not in ('', '0'))
    page.click('#pause')
    page.until(lambda: page.text('#pause') == 'Resume')
    assert page.find('#pause').get_attribute('aria-pressed') == 'true'
    before = page.text('#source')
    page.click('#reset')
    page.until(lambda: page.find('#confirm').is_displayed())
    page.click('#drop')
    page.until(lambda: page.text('#state') == 'uncalibrated')
    assert page.text('#bar-views .value') == '0'
    assert not page.find('#save').is_enabled()
    assert page.text('#source') == before
    page.click('#pause')
    page.until(lambda: page.text('#bar-views .value') != '0')
    assert page.problems() == []
    assert live.stop()[0] == 0


def test_the_page_survives_the_end_of_the_source_and_a_reload(
    start_live, open_page, images, camera_file
):
    live = start_live(images, '-o', camera_file)
    page = open_page(live.url)
    page.until(lambda: 'end of the images' in page.text('#source'))
    page.browser.refresh()
    page.until(lambda: 'end of the images' in page.text('#source'))
    page.until(lambda: page.text('#state') == 'calibrated')
    page.until(lambda: is_drawn(page, 'raw'))
    page.click('#save')
    page.until(camera_file.exists)
    page.until(lambda: 'saved to' in page.text('#toast'))
    status, errors = live.stop()
    assert (status, errors) == (0, '')
    page.until(lambda: page.find('#offline').is_displayed())


def test_a_phone_shows_everything_without_scrolling_sideways(
    start_live, open_page, images, camera_file
):
    live = start_live(images, '-o', camera_file)
    page = open_page(live.url)
    page.browser.execute_cdp_cmd(
        'Emulation.setDeviceMetricsOverride',
        {'width': 360, 'height': 740, 'deviceScaleFactor': 2, 'mobile': True},
    )
    try:
        page.until(lambda: page.text('#state') == 'calibrated')
        width = page.browser.execute_script('return document.documentElement.scrollWidth')
        assert width == 360
        for button in ('#pause', '#reset', '#save'):
            box = page.find(button).rect
            assert box['height'] >= 40
            assert 0 <= box['x'] < box['x'] + box['width'] <= 360
    finally:
        page.browser.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})


def test_all_text_has_contrast_in_both_schemes(start_live, open_page, images, camera_file):
    """At least 4.5 to 1 against its background, as WCAG 2 asks for at level AA."""
    live = start_live(images, '-o', camera_file)
    page = open_page(live.url)
    page.until(lambda: 'end of the images' in page.text('#source'))
    assert page.low_contrast() == []
