# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``LiveServer``: the web page of a live session, served by a thread of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
import json
from pathlib import Path
import socket
import threading
from typing import Any

from aiohttp import web, WSMsgType
from p4pfr_ros.files.calibration import calibration_text
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.live.access import Access, is_loopback
from p4pfr_ros.live.message import MessageWriter
from p4pfr_ros.live.session import LiveSession

_WEB = Path(__file__).parent / 'web'
_FILES = {'live.css': 'text/css', 'live.js': 'text/javascript', 'icon.svg': 'image/svg+xml'}
# Only what this server serves, and no other page may show it in a frame.
_HEADERS = {
    'Content-Security-Policy': (
        "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    ),
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store',
}
# A page that says nothing for so long is gone.
_HEARTBEAT_S = 20.0
_START_S = 10.0
# Pages send two numbers, in bytes.
_LONGEST_QUESTION = 1024
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class LiveServer:
    """
    Serves the page of a session.

    Parameters
    ----------
    session
        The session.
    host, port
        Address to listen on; port 0 takes a free one.
    token
        See `Access`.

    Raises
    ------
    ConfigError
        The address cannot be listened on.

    """

    def __init__(self, session: LiveSession, host: str, port: int, token: str = '') -> None:
        self._session, self._host = session, host
        self._access = Access(host, token)
        self._writer = MessageWriter()
        self._sockets: set[web.WebSocketResponse] = set()
        self._socket = _listening(host, port)
        self.port: int = self._socket.getsockname()[1]
        # Of the thread.
        self._loop: asyncio.AbstractEventLoop
        # Set, and replaced, at the next change.
        self._changed: asyncio.Event
        self._ends: asyncio.Event
        self._writing: asyncio.Lock
        self._started: Future[None] = Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run()), name='live server', daemon=True
        )

    @property
    def url(self) -> str:
        """The address to open, with the token if one is needed."""
        host = _reachable_name(self._host)
        token = f'?token={self._access.token}' if self._access.token else ''
        return f'http://{host}:{self.port}/{token}'

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()
        self._started.result(_START_S)

    def stop(self) -> None:
        """Close all connections, and end the thread, if it has started."""
        if not self._started.done():
            return
        self._loop.call_soon_threadsafe(self._ends.set)
        self._thread.join(_START_S)

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed, self._ends = asyncio.Event(), asyncio.Event()
        self._writing = asyncio.Lock()
        runner = web.AppRunner(self._application(), access_log=None, shutdown_timeout=2.0)
        await runner.setup()
        await web.SockSite(runner, self._socket).start()
        self._session.add_listener(self._on_change)
        self._started.set_result(None)
        await self._ends.wait()
        await runner.cleanup()

    def _application(self) -> web.Application:
        application = web.Application(middlewares=[self._checked])
        application.on_shutdown.append(self._close_sockets)
        application.router.add_get('/', self._page)
        for name in _FILES:
            application.router.add_get(f'/{name}', self._file)
        application.router.add_get('/updates', self._updates)
        application.router.add_get('/camera.yaml', self._download)
        for command in (self._save, self._reset, self._pause):
            application.router.add_post(f'/{command.__name__[1:]}', command)
        return application

    @web.middleware
    async def _checked(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests that `Access` does; add the headers of a safe page to the others."""
        response: web.StreamResponse | None = self._access.login(request)
        refusal = self._access.refusal(request)
        if response is None and refusal:
            response = web.Response(status=403, text=f'{refusal}\n')
        if response is None:
            response = await handler(request)
        if not response.prepared:
            response.headers.update(_HEADERS)
        return response

    async def _page(self, _: web.Request) -> web.FileResponse:
        return web.FileResponse(_WEB / 'index.html')

    async def _file(self, request: web.Request) -> web.FileResponse:
        name = request.path[1:]
        return web.FileResponse(_WEB / name, headers={'Content-Type': _FILES[name]})

    async def _updates(self, request: web.Request) -> web.WebSocketResponse:
        """Send the newest snapshot whenever the page asks for one that it does not have."""
        # JPEG images cannot be compressed further.
        page = web.WebSocketResponse(
            heartbeat=_HEARTBEAT_S, max_msg_size=_LONGEST_QUESTION, compress=False
        )
        await page.prepare(request)
        self._sockets.add(page)
        asked: asyncio.Queue[tuple[int, int]] = asyncio.Queue(maxsize=2)
        sender = asyncio.create_task(self._send(page, asked))
        try:
            async for message in page:
                numbers = _asked(message.data) if message.type is WSMsgType.TEXT else None
                if numbers is None or asked.full():
                    break
                asked.put_nowait(numbers)
        finally:
            self._sockets.discard(page)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
        await page.close()
        return page

    async def _send(
        self, page: web.WebSocketResponse, asked: asyncio.Queue[tuple[int, int]]
    ) -> None:
        with suppress(ConnectionError):  # the page was closed
            while True:
                await self._send_newer(page, *await asked.get())

    async def _send_newer(self, page: web.WebSocketResponse, sequence: int, maps: int) -> None:
        while self._session.snapshot.sequence == sequence:
            await self._changed.wait()
        snapshot, options = self._session.snapshot, self._session.options
        # One after another: all pages share the images of one snapshot.
        async with self._writing:
            data = await asyncio.to_thread(self._writer.write, snapshot, options, maps)
        await page.send_bytes(data)

    async def _download(self, _: web.Request) -> web.Response:
        calibration = self._session.calibration()
        if calibration is None:
            raise web.HTTPNotFound(text='the camera has not been estimated yet\n')
        name = f'{self._session.camera_name}.yaml'
        return web.Response(
            text=calibration_text(calibration),
            content_type='application/yaml',
            headers={'Content-Disposition': f'attachment; filename="{name}"'},
        )

    async def _save(self, _: web.Request) -> web.Response:
        is_saved, words = await asyncio.to_thread(self._session.save)
        return web.json_response({'message': words}, status=200 if is_saved else 409)

    async def _reset(self, _: web.Request) -> web.Response:
        await asyncio.to_thread(self._session.reset)
        return web.json_response({'message': 'the calibration restarts'})

    async def _pause(self, request: web.Request) -> web.Response:
        is_paused = request.query.get('on', 'true') == 'true'
        await asyncio.to_thread(self._session.pause, is_paused=is_paused)
        return web.json_response({'message': 'paused' if is_paused else 'resumed'})

    def _on_change(self) -> None:
        """Wake up the pages that wait; called in any thread."""
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._notify)

    def _notify(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _close_sockets(self, _: web.Application) -> None:
        for page in set(self._sockets):
            await page.close(code=1001, message=b'the server ends')


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, kind, proto, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind, proto)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
        except OSError:
            listening.close()
            raise
    except (OSError, OverflowError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigError(f'cannot listen on {host}:{port}: {reason}') from None
    return listening


def _reachable_name(host: str) -> str:
    """Return a name by which browsers reach the host."""
    if is_loopback(host):
        return 'localhost' if host != '::1' else '[::1]'
    if host in ('0.0.0.0', '::', ''):
        return socket.gethostname()
    return f'[{host}]' if ':' in host else host


def _asked(text: str) -> tuple[int, int] | None:
    """Return the numbers of the snapshot and the maps that a page has; None if it says neither."""
    try:
        asked: Any = json.loads(text)
        return int(asked['sequence']), int(asked['maps'])
    except (ValueError, TypeError, KeyError):
        return None
