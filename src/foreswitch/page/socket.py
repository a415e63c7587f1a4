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
from foreswitch.page.limits import LONGEST_JOB
from foreswitch.page.wire import pack
from foreswitch.page.workers import Busy, Job, Overrun, Pool

__all__ = ["KINDS", "Talk", "run_job"]

#: Requests of one page that may wait for processes of one kind: each may hold as much as a message.
LANES = 32
#: Kind -> lane: nothing that takes seconds stands before what takes milliseconds.
KINDS = {"look": "fast", "costs": "fast", "certify": "slow", "baseline": "slow"}

REMEDIES = {
    "project": "give a shorter file",
    "columns": "give a shorter record",
    "identify": "give a shorter record, or name the structure",
    "baseline": "make the run or the budget smaller",
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
        sentence = "the page has too much to do at present; try again in a moment"
    except Overrun:
        sentence = (
            "this takes longer than {limit:g} s, or more memory than there is; make the run or the search shorter"
        )
    head, _ = chosen[0] if chosen else choose()
    remedy = REMEDIES.get(head["kind"], "make the run or the search shorter")
    complaint = {"message": sentence.format(limit=LONGEST_JOB[head["kind"]], remedy=remedy), "field": None}
    if head["kind"] in KINDS:
        return {"status": 422}, pack({"id": head["id"], "kind": head["kind"], "error": complaint})
    return {"status": 422, "type": "application/json"}, json_text({"error": complaint}).encode()


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
                raise ValueError("the message is binary; send JSON as text")
            name, kind, key = _address(json.loads(text))
        except (ValueError, RecursionError) as error:
            about = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
            complaint = {"message": f"the message cannot be read ({about}); send a request in JSON", "field": None}
            await self.socket.send_bytes(pack({"id": None, "kind": None, "error": complaint}))
            return
        lane = KINDS[kind]
        older = self.waiting[lane].get((kind, key))
        if older is None and len(self.waiting[lane]) >= LANES:
            complaint = {"message": "too many requests wait; ask again when some are answered", "field": None}
            await self.socket.send_bytes(pack({"id": name, "kind": kind, "error": complaint}))
            return
        self.waiting[lane][kind, key] = (name, text.encode())  # in the older one's place
        self.news[lane].set()
        if older is not None:
            await self.socket.send_bytes(pack({"id": older[0], "kind": kind, "stale": True}))

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
        raise ValueError("it is no object")
    name, kind, key = request.get("id"), request.get("kind"), request.get("lane", "")
    if isinstance(name, bool) or not isinstance(name, (int, str)) or len(str(name)) > 64:
        raise ValueError("its id is neither a whole number nor a short text")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"its kind is none of {', '.join(KINDS)}")
    if not isinstance(key, str) or len(key) > 64:
        raise ValueError("its lane is no short text")
    return name, kind, key
