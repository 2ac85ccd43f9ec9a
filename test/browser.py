# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures: a real browser without a screen, and its pages as a person sees them."""

import shutil

import pytest

TIMEOUT_S = 200.0
LOW_CONTRAST = """
const luminance = (colour) => colour.match(/[\\d.]+/g).slice(0, 3)
  .map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
  .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
const background = (element) => {
  for (let e = element; e; e = e.parentElement) {
    const colour = getComputedStyle(e).backgroundColor;
    if (!/, 0\\)$|transparent/.test(colour)) return colour;
  }
  return 'rgb(255, 255, 255)';
};
const low = [];
for (const element of document.querySelectorAll('body *')) {
  const owns = [...element.childNodes].some((n) => n.nodeType === 3 && n.data.trim());
  if (!owns || !element.checkVisibility({ opacityProperty: true })) continue;
  const [a, b] = [getComputedStyle(element).color, background(element)].map(luminance);
  const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  if (ratio < 4.5) low.push(`${element.textContent.trim()}: ${ratio.toFixed(2)}`);
}
return low;
"""
SWITCHES = (
    'headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking '
    'disable-component-update disable-sync window-size=1280,900'
)


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
    for switch in SWITCHES.split():
        options.add_argument(f'--{switch}')
    options.add_argument(f'--user-data-dir={tmp_path_factory.mktemp("chromium")}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
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

    def width_on_a_phone(self):
        """Return the width of the page on a screen of 360 pixels."""
        size = {'width': 360, 'height': 740, 'deviceScaleFactor': 2, 'mobile': True}
        self.browser.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', size)
        try:
            return self.browser.execute_script('return document.documentElement.scrollWidth')
        finally:
            self.browser.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})

    def low_contrast(self):
        """Return texts with less contrast than 4.5 to 1, as WCAG 2 asks for at level AA."""
        low = []
        for scheme in ('light', 'dark'):
            features = [{'name': 'prefers-color-scheme', 'value': scheme}]
            self.browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': features})
            low += [f'{scheme}: {words}' for words in self.browser.execute_script(LOW_CONTRAST)]
        self.browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})
        return low

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
