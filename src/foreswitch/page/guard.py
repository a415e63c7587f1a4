"""Who may ask, and how much: every request passes here before anything looks at it."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

from foreswitch._helpers.json import json_text

__all__ = ["Guard", "is_loopback"]

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Refused(Exception):
    """A status and the sentence that goes with it."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


class Guard:
    """ASGI middleware: names and origins, the token, sizes, and the headers of every reply.

    Parameters
    ----------
    app : ASGI application
        Behind it.
    hosts : set of str
        Names under which the server may be addressed, port included. A name that somebody else has made point here
        is none of them, so a page of theirs cannot read ours (DNS rebinding).
    any_address : bool
        Whether a bare IP address with the right port will do too: nobody can make that point elsewhere.
    port : int
        The server's.
    token : str, optional
        Needed once in the link, then kept as a cookie.
    sizes : dict
        Path to the largest body, for all that may have one.
    """

    def __init__(
        self, app: Any, *, hosts: set[str], any_address: bool, port: int, token: str | None, sizes: dict[str, int]
    ) -> None:
        self.app, self.hosts, self.any_address, self.port = app, hosts, any_address, port
        self.token, self.sizes, self.cookie = token, sizes, f"foreswitch-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One connection."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        try:
            host = self._host(scope)
            self._origin(scope, host)
            entered = self._token(scope)
            guarded = _with_headers(send, host)
            if entered:
                await _page(guarded, self.cookie, entered)
                return
            body = self._body(scope, receive) if scope["type"] == "http" else None
        except Refused as refusal:
            await _refuse(scope, _with_headers(send, ""), refusal)
            return
        if body is None:
            await self.app(scope, receive, guarded)
        else:
            await body.answered(self.app, scope, guarded)

    def _host(self, scope: Scope) -> str:
        """The one name it was addressed by."""
        given = _values(scope, b"host")
        host = given[0].lower() if len(given) == 1 else ""
        if host in self.hosts or (self.any_address and _is_address(host, self.port)):
            return host
        raise Refused(403, "this address is not the page's own; open the link that the terminal shows")

    def _origin(self, scope: Scope, host: str) -> None:
        """Other sites may link here, no more."""
        own = f"http://{host}"
        origins = _values(scope, b"origin")
        reading = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if origins != [own] and (origins or not reading):
            raise Refused(403, "another site asked, or nobody said who; open the page itself")
        if _values(scope, b"sec-fetch-site") in (["cross-site"], ["same-site"]) and scope["path"] != "/":
            raise Refused(403, "another site asked; open the page itself")

    def _token(self, scope: Scope) -> str | None:
        """Whoever brings it in the link gets a cookie; whoever has the cookie may pass."""
        if self.token is None:
            return None
        if scope["type"] == "http" and scope["path"] == "/" and scope["method"] == "GET":
            for given in parse_qs(scope["query_string"].decode("latin-1")).get("token", [])[:1]:
                if _same(given, self.token):
                    return self.token
        cookies = [part.strip().partition("=") for line in _values(scope, b"cookie") for part in line.split(";")]
        if any(name == self.cookie and _same(value, self.token) for name, _, value in cookies):
            return None
        raise Refused(403, "the token is missing or wrong; open the link that the terminal shows")

    def _body(self, scope: Scope, receive: Receive) -> _Body:
        """What is sent along, if it does not say itself that it is too long."""
        limit = self.sizes.get(scope["path"], 0)
        for length in _values(scope, b"content-length"):
            if not length.isdecimal() or len(length) > 15 or int(length) > limit:
                raise _too_long(limit)
        return _Body(receive, limit)


def _too_long(limit: int) -> Refused:
    return Refused(413, f"the upload is longer than {limit} bytes; send less")


class _Body:
    """An upload, cut off where it is too long: as if the client had gone, whose place is then taken by a refusal."""

    def __init__(self, receive: Receive, limit: int) -> None:
        self.receive, self.limit, self.taken = receive, limit, 0

    async def _counted(self) -> MutableMapping[str, Any]:
        message = await self.receive() if self.taken <= self.limit else {}
        self.taken += len(message.get("body", b""))
        return message if self.taken <= self.limit else {"type": "http.disconnect"}

    async def answered(self, app: Any, scope: Scope, send: Send) -> None:
        """The application's reply, or the refusal."""
        started = False

        async def sending(message: MutableMapping[str, Any]) -> None:
            nonlocal started
            if started or self.taken <= self.limit:
                started = True
                await send(message)

        try:
            await app(scope, self._counted, sending)
        except Exception:
            if self.taken <= self.limit:
                raise
        if not started:
            await _refuse(scope, send, _too_long(self.limit))


def _values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _same(given: str, token: str) -> bool:
    """Compared in constant time."""
    return hmac.compare_digest(given.encode(), token.encode())


def _is_address(host: str, port: int) -> bool:
    address, colon, digits = host.rpartition(":")
    if not colon or digits != str(port):
        return False
    bracketed = address.startswith("[") and address.endswith("]")
    try:
        found = ipaddress.ip_address(address[1:-1] if bracketed else address)
    except ValueError:
        return False
    return (found.version == 6) == bracketed


def _headers(host: str) -> list[tuple[bytes, bytes]]:
    """Headers of every reply: nothing is loaded from elsewhere, nothing runs that stands in the markup itself."""
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
        f"connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return [
        (b"content-security-policy", policy.encode()),
        (b"x-content-type-options", b"nosniff"),
        (b"x-frame-options", b"DENY"),
        (b"referrer-policy", b"no-referrer"),
        (b"cross-origin-resource-policy", b"same-origin"),
        (b"cross-origin-opener-policy", b"same-origin"),
        (b"permissions-policy", b"camera=(), geolocation=(), microphone=()"),
    ]


def _with_headers(send: Send, host: str) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            given = list(message.get("headers", []))
            extra = _headers(host)
            if all(key.lower() != b"cache-control" for key, _ in given):
                extra.append((b"cache-control", b"no-store"))
            message = {**message, "headers": given + extra}
        await send(message)

    return sending


async def _refuse(scope: Scope, send: Send, refusal: Refused) -> None:
    """As the page expects errors; a WebSocket is not even opened, and no script may read why."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.close"})
        return
    body = json_text({"error": {"message": refusal.sentence, "field": None}}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if refusal.status == 413:
        headers.append((b"connection", b"close"))  # the rest of the body is not wanted
    await send({"type": "http.response.start", "status": refusal.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


async def _page(send: Send, cookie: str, token: str) -> None:
    """Leave the cookie and go on to the page by itself: a redirection from a link elsewhere would not bring it along."""
    body = b'<!doctype html><meta http-equiv="refresh" content="0;url=/"><title>foreswitch</title>'
    kept = f"{cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
    headers = [(b"content-type", b"text/html; charset=utf-8"), (b"set-cookie", kept.encode())]
    headers.append((b"content-length", str(len(body)).encode()))
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})
