"""The server: its routes, its life, and the address it listens at."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import socket as sockets
import threading
import webbrowser
from collections.abc import AsyncIterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from foreswitch.page.guard import Guard, is_loopback
from foreswitch.page.limits import LIMITS
from foreswitch.page.presets import presets
from foreswitch.page.socket import Talk
from foreswitch.page.wire import clean
from foreswitch.page.workers import Pool

__all__ = ["PORT", "application", "run"]

#: Always the same, so that a browser finds again what it has kept for this address.
PORT = 8732
STATIC = Path(__file__).parent / "static"
#: Pages at once.
CLIENTS = 64


def application(project: dict[str, Any] | None, *, hosts: set[str], port: int, token: str | None) -> Guard:
    """The whole application behind its guard.

    Parameters
    ----------
    project : dict, optional
        Tables to begin with. Default: the first preset.
    hosts : set of str
        Names it may be addressed by, as in `Guard`.
    port : int
        Where it listens.
    token : str, optional
        As in `Guard`; with one, any bare address will do.

    Returns
    -------
    Guard
    """
    examples = presets()
    beginning = clean({
        "version": version("foreswitch"), "project": project or examples[0]["project"], "presets": examples,
        "schema": {}, "limits": LIMITS,
    })  # fmt: skip
    text = _json(beginning)
    pools: dict[str, Pool] = {}
    talks: set[Talk] = set()

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        cores = os.cpu_count() or 1
        pools.update(fast=Pool(min(cores, 4)), slow=Pool(min(cores, 2)))
        for pool in pools.values():
            pool.start()
        try:
            yield
        finally:
            await asyncio.gather(*(pool.stop() for pool in pools.values()))

    async def index(_: Request) -> Response:
        return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})

    async def start(_: Request) -> Response:
        return Response(text, media_type="application/json")

    async def talk(socket: WebSocket) -> None:
        if len(talks) >= CLIENTS:
            await socket.close(1013)
            return
        one = Talk(socket, pools)
        talks.add(one)
        try:
            await one.serve()
        finally:
            talks.discard(one)

    inner = Starlette(
        routes=[
            Route("/", index),
            Route("/start.json", start),
            WebSocketRoute("/ws", talk),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        lifespan=lifespan,
    )
    return Guard(inner, hosts=hosts, any_address=token is not None, port=port, token=token, sizes={})


def _json(value: Any) -> bytes:
    import json

    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()


def run(
    project: dict[str, Any] | None = None,
    *,
    host: str = "127.0.0.1",
    port: int = PORT,
    remote: bool = False,
    opened: bool = True,
) -> None:
    """Serve until Ctrl-C.

    Parameters
    ----------
    project : dict, optional
        Tables to begin with.
    host : str
        Address to listen at.
    port : int
        0: any that is free.
    remote : bool
        Whether an address that other machines can reach is meant.
    opened : bool
        Whether to open a browser.

    Raises
    ------
    ValueError
        If the address cannot be listened at, or can be reached from elsewhere without ``remote``.
    """
    local = is_loopback(host)
    if not local and not remote:
        raise ValueError(
            f"--host is {host!r}, which other machines can reach; add --remote if that is meant, or leave --host out"
        )
    listener = _listen(host, port)
    port = listener.getsockname()[1]
    token = None if local else secrets.token_urlsafe(32)
    named = f"[{host}]" if ":" in host else host
    hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]")} if local else {f"{named}:{port}".lower()}
    link = f"http://{named}:{port}/" + (f"?token={token}" if token else "")
    config = uvicorn.Config(
        application(project, hosts=hosts, port=port, token=token), log_level="warning", access_log=False,
        server_header=False, date_header=False, proxy_headers=False, lifespan="on", ws="websockets-sansio", http="h11",
        ws_max_size=LIMITS["message"], ws_per_message_deflate=False,  # nothing small unfolds into something large
        limit_concurrency=4 * CLIENTS, timeout_graceful_shutdown=2,
    )  # fmt: skip
    print(f"{link}  (Ctrl-C ends it)", flush=True)
    if opened:
        threading.Timer(0.5, webbrowser.open, [link]).start()
    with contextlib.suppress(KeyboardInterrupt), listener:
        uvicorn.Server(config).run(sockets=[listener])


def _listen(host: str, port: int) -> sockets.socket:
    """A socket there, or one sentence."""
    try:
        family, kind, protocol, _, address = sockets.getaddrinfo(host, port, type=sockets.SOCK_STREAM)[0]
        listener = sockets.socket(family, kind, protocol)
        listener.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(128)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ValueError(f"{host} port {port} cannot be used ({reason}); give another --port, or 0 for any") from None
    return listener
