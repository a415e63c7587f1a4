"""The WebSocket: what is out of date is dropped, the rest is answered in turn."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable
from functools import partial
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from foreswitch._helpers.json import json_text
from foreswitch._helpers.mistake import Mistake
from foreswitch.page.limits import LONGEST_JOB
from foreswitch.page.wire import pack, told
from foreswitch.page.workers import Busy, Job, Overrun, Pool

__all__ = ["KINDS", "Talk", "busy", "run_job"]

#: Requests of one page that may wait for processes of one kind: each may hold as much as a message.
LANES = 32
#: Kind -> lane: nothing that takes seconds stands before what takes milliseconds.
KINDS = {"look": "fast", "costs": "fast", "certify": "slow", "baseline": "slow"}

#: What makes a job of each kind smaller.
REMEDIES = {
    "look": "make the run shorter or the horizon smaller",
    "costs": "make the run shorter or the horizon smaller",
    "certify": "make the run shorter or leave the margins out",
    "baseline": "make the run shorter or the budget smaller",
    "project": "make the files smaller",
    "columns": "make the upload smaller",
    "identify": "make the upload smaller or name the structure",
    "export": "make the run shorter or the horizon smaller",
}


async def run_job(pool: Pool, choose: Callable[[], tuple[dict[str, Any], bytes]]) -> tuple[dict[str, Any], bytes]:
    """A job's reply, or the sentence that says why there is none; what is done is chosen when a process is free."""
    chosen: list[tuple[dict[str, Any], bytes]] = []

    def job() -> Job:
        chosen.append(choose())
        head, body = chosen[0]
        return head, body, LONGEST_JOB[head["kind"]]

    try:
        return await pool.run(job)
    except Busy:
        head, _ = choose()
        mistake = busy()
    except Overrun:
        head, _ = chosen[0]
        kind = head["kind"]
        problem = f"takes longer than {LONGEST_JOB[kind]:g} s, or more memory than there is"
        mistake = Mistake("request", kind, REMEDIES[kind], problem=problem, subject="this")
    if head["kind"] in KINDS:
        return {"status": 422}, pack({"id": head["id"], "kind": head["kind"], "error": told(mistake)})
    return {"status": 422, "type": "application/json"}, json_text({"error": told(mistake)}).encode()


def busy() -> Mistake:
    """What is said where nothing is wrong with a request but its moment."""
    return Mistake(
        "request", None, "try again in a moment", problem="has too much to do at present", subject="the page"
    )


class Talk:
    """One client.

    Parameters
    ----------
    socket : WebSocket
    pools : dict of str to Pool
        By lane.
    """

    def __init__(self, socket: WebSocket, pools: dict[str, Pool]) -> None:
        self.socket, self.pools = socket, pools
        #: Lane -> kind and key -> what waits, oldest first.
        self.waiting: dict[str, dict[tuple[str, str], tuple[Any, bytes]]] = {lane: {} for lane in pools}
        self.news = {lane: asyncio.Event() for lane in pools}

    async def serve(self) -> None:
        """Until the client goes."""
        await self.socket.accept()
        tasks = [asyncio.create_task(self._answer(lane)) for lane in self.pools]
        try:
            while True:
                await self._take(await self.socket.receive())
                await asyncio.sleep(0)  # whoever floods us does not keep the others waiting
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _take(self, message: Any) -> None:
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect
        text = message.get("text")
        try:
            if text is None:
                raise Mistake("message", None, "send JSON as text", problem="is binary", subject="the message")
            name, kind, key = _address(json.loads(text))
        except Mistake as mistake:
            await self._refuse(None, None, mistake)
            return
        except (ValueError, RecursionError) as error:
            about = "it is nested too deeply" if isinstance(error, RecursionError) else error
            problem, subject = f"cannot be read ({about})", "the message"
            await self._refuse(None, None, Mistake("message", None, "send JSON", problem=problem, subject=subject))
            return
        lane = KINDS[kind]
        older = self.waiting[lane].get((kind, key))
        if older is None and len(self.waiting[lane]) >= LANES:
            remedy = "ask again when some are answered"
            await self._refuse(name, kind, Mistake("request", key, remedy, problem="wait", subject="too many requests"))
            return
        self.waiting[lane][kind, key] = (name, text.encode())  # in the older one's place
        self.news[lane].set()
        if older is not None:
            await self.socket.send_bytes(pack({"id": older[0], "kind": kind, "stale": True}))

    async def _refuse(self, name: Any, kind: str | None, mistake: Mistake) -> None:
        await self.socket.send_bytes(pack({"id": name, "kind": kind, "error": told(mistake)}))

    async def _answer(self, lane: str) -> None:
        """One request after the other, so that no client takes more than its share."""
        waiting, pool = self.waiting[lane], self.pools[lane]
        while True:
            await self.news[lane].wait()
            if not waiting:
                self.news[lane].clear()
                continue
            job = run_job(pool, partial(_oldest, waiting))
            # what takes milliseconds is not broken off with its process because a page was left
            _, reply = await (asyncio.shield(job) if lane == "fast" else job)
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                await self.socket.send_bytes(reply)


def _oldest(waiting: dict[tuple[str, str], tuple[Any, bytes]]) -> tuple[dict[str, Any], bytes]:
    """Taken out: what has waited longest, in its newest form."""
    kind, key = next(iter(waiting))
    name, body = waiting.pop((kind, key))
    return {"kind": kind, "id": name}, body


def _address(request: Any) -> tuple[Any, str, str]:
    """Name, kind and key of a request."""
    if not isinstance(request, dict):
        remedy = "send an object with id, kind and project"
        raise Mistake("message", request, remedy, problem="is not an object", subject="the message")
    name, kind, key = request.get("id"), request.get("kind"), request.get("lane", "")
    if isinstance(name, bool) or not isinstance(name, (int, str)) or len(str(name)) > 64:
        raise Mistake("id", name, "give a whole number or a short text")
    if not isinstance(kind, str) or kind not in KINDS:
        raise Mistake("kind", kind, f"give one of {', '.join(KINDS)}")
    if not isinstance(key, str) or len(key) > 64:
        raise Mistake("lane", key, "give a short text")
    return name, kind, key
