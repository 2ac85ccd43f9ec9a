# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The server: who may open the page, and what it answers."""

import asyncio
import json
import socket

import aiohttp
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.images import read_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.access import Access
from p4pfr_ros.live.server import LiveServer
from p4pfr_ros.live.session import LiveSession
import pytest
from rendered import CHESSBOARD

TOKEN = 'a-token-of-the-test'


@pytest.fixture
def session(tmp_path):
    return LiveSession(load_boards(CHESSBOARD), tmp_path / 'camera.yaml')


@pytest.fixture
def local(session):
    """Serve this machine."""
    server = LiveServer(session, '127.0.0.1', 0)
    server.start()
    yield server
    server.stop()


@pytest.fixture
def open_to_all(session):
    """Serve other machines."""
    server = LiveServer(session, '0.0.0.0', 0, TOKEN)
    server.start()
    yield server
    server.stop()


def ask(server, path='/', method='GET', cookies=None, redirects=False, **headers):
    """Return status, text and headers of an answer."""

    async def answer():
        jar = aiohttp.CookieJar(unsafe=True)
        async with (
            aiohttp.ClientSession(cookies=cookies, cookie_jar=jar) as client,
            client.request(
                method,
                f'http://127.0.0.1:{server.port}{path}',
                headers=headers,
                allow_redirects=redirects,
            ) as response,
        ):
            return response.status, await response.text(), response.headers

    return asyncio.run(answer())


def updates(server, message, **headers):
    """Open the web socket and return its first message, or the status of a refusal."""

    async def first():
        url = f'http://127.0.0.1:{server.port}/updates'
        async with aiohttp.ClientSession() as client:
            try:
                async with client.ws_connect(url, headers=headers) as page:
                    await page.send_str(message)
                    return await page.receive(timeout=100.0)
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    return asyncio.run(first())


ASKED = json.dumps({'sequence': -1, 'maps': -1})


def test_the_page_loads_nothing_from_elsewhere(local):
    status, page, headers = ask(local)
    assert status == 200
    assert 'http' not in page.replace('http://www.w3.org', '')
    policy = headers['Content-Security-Policy']
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    for name in ('live.css', 'live.js', 'icon.svg'):
        status, text, headers = ask(local, f'/{name}')
        assert status == 200
        assert 'http' not in text.replace('http://www.w3.org', '').replace('/^http/', '')
        assert headers['X-Content-Type-Options'] == 'nosniff'
    assert ask(local, '/../session.py')[0] == 404


@pytest.mark.parametrize('host', ['localhost', '127.0.0.1', '[::1]'])
def test_this_machine_has_these_names(local, host):
    assert ask(local, Host=f'{host}:{local.port}')[0] == 200


@pytest.mark.parametrize('host', ['evil.example.org', '127.0.0.1.example.org', '192.168.0.9'])
def test_a_name_that_only_leads_here_is_refused(local, host):
    """DNS rebinding: a web page elsewhere takes a name that leads to this machine."""
    status, text, _ = ask(local, Host=f'{host}:{local.port}')
    assert status == 403
    assert text == f'open http://localhost instead of {host}:{local.port}\n'


@pytest.mark.parametrize('path', ['/save', '/reset', '/pause'])
def test_other_web_pages_cannot_press_buttons(local, path):
    status, text, _ = ask(local, path, 'POST', Origin='http://example.org')
    assert (status, text) == (403, 'the request comes from another web page\n')
    assert ask(local, path, 'POST', Origin='null')[0] == 403
    assert ask(local, path)[0] == 405


def test_other_web_pages_cannot_watch(local):
    assert updates(local, ASKED, Origin='http://example.org') == 403
    own = updates(local, ASKED, Origin=f'http://127.0.0.1:{local.port}')
    assert own.type is aiohttp.WSMsgType.BINARY


@pytest.mark.parametrize('message', ['', '{}', '[]', '{"sequence": "x", "maps": 0}', 'x' * 2000])
def test_a_message_that_is_none_ends_the_connection(local, message):
    closed = (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
    assert updates(local, message).type in closed
    assert updates(local, ASKED).type is aiohttp.WSMsgType.BINARY


def test_others_need_the_token(open_to_all):
    assert ask(open_to_all)[0] == 403
    assert ask(open_to_all, '/?token=wrong')[0] == 403
    assert ask(open_to_all, '/save', 'POST')[0] == 403
    assert updates(open_to_all, ASKED) == 403
    bearer = {'Authorization': f'Bearer {TOKEN}'}
    assert ask(open_to_all, **bearer)[0] == 200
    assert updates(open_to_all, ASKED, **bearer).type is aiohttp.WSMsgType.BINARY


def test_the_token_moves_from_the_address_to_a_cookie(open_to_all):
    assert open_to_all.url == f'http://{socket.gethostname()}:{open_to_all.port}/?token={TOKEN}'
    status, _, headers = ask(open_to_all, f'/?token={TOKEN}')
    assert (status, headers['Location']) == (303, '/')
    assert 'HttpOnly' in headers['Set-Cookie']
    assert 'SameSite=Lax' in headers['Set-Cookie']
    name = headers['Set-Cookie'].partition('=')[0]
    assert ask(open_to_all, cookies={name: TOKEN})[0] == 200
    assert ask(open_to_all, cookies={name: 'wrong'})[0] == 403


def test_a_token_is_drawn_for_others_only():
    drawn = [Access('0.0.0.0').token for _ in range(2)]
    assert len(set(drawn)) == 2
    assert all(len(token) > 20 for token in drawn)
    assert [Access(host).token for host in ('localhost', '127.0.0.1', '::1')] == ['', '', '']


def test_the_buttons_answer(local, session, images):
    assert ask(local, '/save', 'POST')[:2] == (
        409,
        '{"message": "nothing to save: the camera has not been estimated yet"}',
    )
    assert ask(local, '/camera.yaml')[0] == 404
    for path in sorted(images.iterdir())[:3]:
        session.process(read_image(path), path.name)
    assert ask(local, '/save', 'POST')[0] == 200
    assert ask(local, '/camera.yaml')[1] == session.output.read_text()
    assert ask(local, '/pause?on=true', 'POST')[0] == 200
    assert session.snapshot.is_paused
    ask(local, '/pause?on=false', 'POST')
    assert not session.snapshot.is_paused
    ask(local, '/reset', 'POST')
    assert session.snapshot.progress.estimate is None


@pytest.mark.parametrize('host', ['127.0.0.1', '203.0.113.7', 'no-such-host.invalid'])
def test_an_address_that_is_not_free_is_one_line(session, local, host):
    with pytest.raises(ConfigError, match=rf'^cannot listen on {host}:{local.port}: '):
        LiveServer(session, host, local.port)
