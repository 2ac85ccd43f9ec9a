# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Who may open the page: those on this machine, or those who know the token.

A browser also sends requests that other web pages make. Their origin gives them away, and, if a
name of theirs leads to this machine (DNS rebinding), the name in the header Host.

This module stands alone so that all checks of a request are read in one place.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets

from aiohttp import web

_COOKIE = 'p4pfr_token'
_LOCAL_NAMES = ('localhost', '127.0.0.1', '[::1]')


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches a host name or address."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Access:
    """
    Checks each request.

    Parameters
    ----------
    host
        The address that the server listens on.
    token
        What a browser from elsewhere has to know; empty: drawn at random. Loopback needs none,
        but has one if it is given.

    """

    def __init__(self, host: str, token: str = '') -> None:
        self._is_local = is_loopback(host)
        self.token = token if token or self._is_local else secrets.token_urlsafe(16)

    def login(self, request: web.Request) -> web.Response | None:
        """Answer a request whose address has the right token: keep it in a cookie."""
        given = request.query.get('token')
        if not self.token or given is None or not _equal(given, self.token):
            return None
        response = web.Response(status=303, headers={'Location': '/'})
        response.set_cookie(
            self._cookie(request), self.token, httponly=True, samesite='Lax', path='/'
        )
        return response

    def refusal(self, request: web.Request) -> str:
        """Return why a request is refused; empty if it is not."""
        if self._is_local and _name_of(request.host) not in _LOCAL_NAMES:
            return f'open http://localhost instead of {request.host}'
        origin = request.headers.get('Origin')
        if origin is not None and origin not in (
            f'http://{request.host}',
            f'https://{request.host}',
        ):
            return 'the request comes from another web page'
        if self.token and not _equal(self._given(request), self.token):
            return 'the token is missing or wrong: open the address that was printed at the start'
        return ''

    def _given(self, request: web.Request) -> str:
        """Return the token of a request: of its cookie, or a header that scripts send."""
        header = request.headers.get('Authorization', '')
        return header.removeprefix('Bearer ') or request.cookies.get(self._cookie(request), '')

    @staticmethod
    def _cookie(request: web.Request) -> str:
        """Return the name of the cookie; browsers do not keep those of ports apart."""
        _, _, port = request.host.removeprefix(_name_of(request.host)).partition(':')
        return f'{_COOKIE}_{port}' if port.isdecimal() else _COOKIE


def _name_of(host: str) -> str:
    """Return a header Host without the port."""
    return (
        host[: host.index(']') + 1]
        if host.startswith('[') and ']' in host
        else (host.partition(':')[0])
    )


def _equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
