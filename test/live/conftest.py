# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A real browser, and the command ``p4pfr live`` as a process."""

import re
import shutil
import subprocess
import sys

import pytest
from rendered import CHESSBOARD, write_views

TIMEOUT_S = 60.0


@pytest.fixture(scope='session')
def images(tmp_path_factory):
    """Return a folder of rendered views of the chessboard, and one image without it."""
    from rendered import write_empty

    folder = tmp_path_factory.mktemp('views')
    write_views(folder, 12)
    write_empty(folder / 'view03a.png')
    return folder


class LiveProcess:
    """The command as a user starts it; a free port is taken."""

    def __init__(self, *arguments):
        command = [sys.executable, '-m', 'p4pfr_ros', 'live', *map(str, arguments)]
        self.process = subprocess.Popen(
            [*command, '--board', CHESSBOARD, '--port', '0'],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()
        address = re.search(r'http\S+', line)
        assert address, line + self.process.communicate()[1]
        self.url = address.group()

    def stop(self):
        """End it by SIGTERM; return exit status and stderr."""
        self.process.terminate()
        _, errors = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, errors


@pytest.fixture
def start_live():
    """Give a function that starts the command."""
    started = []

    def start(*arguments):
        started.append(LiveProcess(*arguments))
        return started[-1]

    yield start
    for live in started:
        if live.process.poll() is None:
            live.process.kill()
        live.process.communicate()


@pytest.fixture(scope='session')
def browser(tmp_path_factory):
    """Give a headless Chromium; skip the test where it is not installed."""
    webdriver = pytest.importorskip('selenium.webdriver', reason='needs selenium')
    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    driver = shutil.which('chromedriver')
    if not chromium or not driver:
        pytest.skip('needs Chromium and its driver: apt install chromium chromium-driver')
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    switches = (
        'headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking '
        'disable-component-update disable-sync window-size=1280,900'
    )
    for switch in switches.split():
        options.add_argument(f'--{switch}')
    options.add_argument(f'--user-data-dir={tmp_path_factory.mktemp("chromium")}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL', 'performance': 'ALL'})
    service = webdriver.ChromeService(executable_path=driver)
    browser = webdriver.Chrome(options=options, service=service)
    yield browser
    browser.quit()


class Page:
    """What a person sees and does in the browser."""

    def __init__(self, browser, url):
        self.browser = browser
        browser.get_log('browser')
        browser.get(url)

    def find(self, selector):
        """Return an element by its CSS selector."""
        return self.browser.find_element('css selector', selector)

    def text(self, selector):
        """Return the visible text of an element."""
        return self.find(selector).text

    def data(self, name):
        """Return a number that the page keeps about itself; 0 before it does."""
        return float(self.browser.execute_script(f'return document.body.dataset.{name} || 0'))

    def until(self, condition):
        """Wait until a condition holds, and return its value."""
        from selenium.webdriver.support.ui import WebDriverWait

        return WebDriverWait(self.browser, TIMEOUT_S, poll_frequency=0.1).until(
            lambda _: condition()
        )

    def click(self, selector):
        """Click as a person can: on what is visible and enabled."""
        self.until(lambda: self.find(selector).is_enabled())
        self.find(selector).click()

    def problems(self):
        """Return what the browser complains of."""
        return [
            entry['message']
            for entry in self.browser.get_log('browser')
            if entry['level'] in ('SEVERE', 'WARNING')
        ]


@pytest.fixture
def open_page(browser):
    """Give a function that opens a page."""
    return lambda url: Page(browser, url)
