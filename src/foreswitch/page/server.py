"""The server: its routes, its life, and the address it listens at."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import secrets
import socket as sockets
import threading
import webbrowser
from collections.abc import AsyncIterator, Coroutine
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from foreswitch._helpers.json import json_text
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch._helpers.text import nearest
from foreswitch.page.exports import FILES
from foreswitch.page.frames import Frames
from foreswitch.page.guard import Guard, is_loopback
from foreswitch.page.limits import LIMITS
from foreswitch.page.presets import presets
from foreswitch.page.schema import schema, uses
from foreswitch.page.socket import Talk, busy, run_job
from foreswitch.page.wire import told
from foreswitch.page.workers import Pool

__all__ = ["PORT", "application", "run"]

#: Always the same, so that a browser finds again what it has kept for this address.
PORT = 8732
STATIC = Path(__file__).parent / "static"
#: Of each file, whatever a machine takes its suffix for: a script of another type is not run.
MEDIA = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
#: Uploads at once, and the seconds that one may take to arrive.
UPLOADS = 16
SLOWEST_UPLOAD = 30.0

T = TypeVar("T")


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
    pools: dict[str, Pool] = {}

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

    inner = Starlette(routes=[*_pages(project), *_uploads(pools), _talks(pools)], lifespan=lifespan)
    inner.router.redirect_slashes = False  # a path is there or it is not
    sizes = {f"/export/{file}": LIMITS["message"] for file in FILES}
    sizes |= {"/project": LIMITS["record"], "/columns": LIMITS["record"], "/identify": LIMITS["record"]}
    return Guard(inner, hosts=hosts, any_address=token is not None, port=port, token=token, sizes=sizes)


def _pages(project: dict[str, Any] | None) -> list[Route]:
    """What a browser loads: the packaged files, known by name beforehand, and what the page begins with."""
    found = {path.relative_to(STATIC).as_posix(): path for path in STATIC.rglob("*") if path.is_file()}
    examples = presets()
    beginning = {
        "version": version("foreswitch"), "project": project or examples[0]["project"], "presets": examples,
        "schema": schema(), "uses": uses(), "limits": LIMITS,
    }  # fmt: skip
    text = json_text(beginning).encode()

    async def static(request: Request) -> Response:
        path = found.get(request.path_params.get("path", "index.html"))
        if path is None:
            problem = "is no such file here"
            return _refused(
                404, Mistake("path", request.url.path, "open the page itself", problem=problem, subject="there")
            )
        return Response(path.read_bytes(), media_type=MEDIA.get(path.suffix, "text/plain"))

    async def start(_: Request) -> Response:
        return Response(text, media_type="application/json")

    return [Route("/", static), Route("/start.json", start), Route("/static/{path:path}", static)]


def _uploads(pools: dict[str, Pool]) -> list[Route]:
    """What is sent once and answered once."""
    under_way = 0

    async def answer(request: Request, head: dict[str, Any]) -> Response:
        nonlocal under_way
        if under_way >= UPLOADS:
            return _refused(503, busy())
        under_way += 1
        try:
            body = await asyncio.wait_for(request.body(), SLOWEST_UPLOAD)
            found = await _unless_gone(request, run_job(pools["slow"], lambda: (head, body)))
        except ClientDisconnect:
            return Response()  # nobody is there to read it
        except TimeoutError:
            problem, remedy = f"took longer than {SLOWEST_UPLOAD:g} s", "make it smaller, or try again"
            return _refused(408, Mistake("upload", None, remedy, problem=problem, subject="the upload"))
        finally:
            under_way -= 1
        if found is None:
            return Response()
        told, content = found
        headers = {"content-disposition": f'attachment; filename="{told["name"]}"'} if "name" in told else {}
        return Response(content, told["status"], headers, told["type"])

    async def project(request: Request) -> Response:
        return await answer(request, {"kind": "project"})

    async def columns(request: Request) -> Response:
        return await answer(request, {"kind": "columns"})

    async def identify(request: Request) -> Response:
        query: dict[str, list[str]] = {}
        for key, value in request.query_params.multi_items():
            query.setdefault(key, []).append(value)
        return await answer(request, {"kind": "identify", "query": query})

    async def export(request: Request) -> Response:
        file = request.path_params["file"]
        if file not in FILES:
            problem = "is not something to export"
            return _refused(404, Mistake("file", file, nearest(file, FILES), problem=problem, subject=shown(file)))
        return await answer(request, {"kind": "export", "file": file})

    return [
        Route("/project", project, methods=["POST"]),
        Route("/columns", columns, methods=["POST"]),
        Route("/identify", identify, methods=["POST"]),
        Route("/export/{file}", export, methods=["POST"]),
    ]


def _talks(pools: dict[str, Pool]) -> WebSocketRoute:
    """The WebSocket."""
    talks: set[Talk] = set()

    async def talk(socket: WebSocket) -> None:
        if len(talks) >= LIMITS["clients"]:
            await socket.close(1013)
            return
        one = Talk(socket, pools)
        talks.add(one)
        try:
            await one.serve()
        finally:
            talks.discard(one)

    return WebSocketRoute("/ws", talk)


async def _unless_gone(request: Request, job: Coroutine[Any, Any, T]) -> T | None:
    """What a job gives; None, and the job ended, where the client has gone meanwhile."""

    async def gone() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    work, leaving = asyncio.create_task(job), asyncio.create_task(gone())
    try:
        await asyncio.wait({work, leaving}, return_when=asyncio.FIRST_COMPLETED)
        return await work if work.done() else None
    finally:
        for task in (work, leaving):
            task.cancel()
        await asyncio.gather(work, leaving, return_exceptions=True)


def _refused(status: int, mistake: Mistake) -> Response:
    return JSONResponse({"error": told(mistake)}, status)


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
        problem = f"is {host!r}, which other machines can reach"
        remedy = "add --remote if that is meant, or leave --host out"
        raise Mistake("host", host, remedy, problem=problem, subject="--host")
    listener = _listen(host, port)
    port = listener.getsockname()[1]
    token = None if local else secrets.token_urlsafe(32)
    named = f"[{host}]" if ":" in host else host
    names = {named.lower(), *(("127.0.0.1", "localhost", "[::1]") if local else ())}
    hosts = {f"{name}:{port}" for name in names} | (names if port == 80 else set())  # which browsers leave out
    link = f"http://{named}:{port}/" + (f"?token={token}" if token else "")
    config = uvicorn.Config(
        application(project, hosts=hosts, port=port, token=token), log_level="error", access_log=False,
        server_header=False, date_header=False, proxy_headers=False, lifespan="on", ws=Frames, http="h11",
        ws_max_size=LIMITS["message"], ws_per_message_deflate=False,  # nothing small unfolds into something large
        limit_concurrency=4 * LIMITS["clients"], timeout_graceful_shutdown=2,
    )  # fmt: skip
    logging.getLogger("uvicorn.error").addFilter(_ours)
    print(f"{link}  (Ctrl-C ends it)", flush=True)
    if opened:
        threading.Timer(0.5, webbrowser.open, [link]).start()
    with contextlib.suppress(KeyboardInterrupt), listener:
        uvicorn.Server(config).run(sockets=[listener])


def _ours(record: logging.LogRecord) -> bool:
    """Whether the terminal is to know: what a client sends wrong is no concern of whoever sits there."""
    return not record.getMessage().startswith("Invalid UTF-8")


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
        problem, remedy = f"cannot be used ({reason})", "give another --port, or 0 for any"
        raise Mistake("port", port, remedy, problem=problem, subject=f"{host} port {port}") from None
    return listener
