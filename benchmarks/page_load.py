"""The tuning page under load: one client after another, then twenty that drag a slider at once.

A drag moves Td sixty times a second for some seconds, on the hot-gas example over 1000 periods. Counted is the time from
each movement to the first picture that shows it or a later one, as whoever drags sees it.
"""

import asyncio
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median, quantiles
from typing import Any

from websockets.asyncio.client import connect

from foreswitch.page.presets import presets
from foreswitch.page.wire import unpack
from table import Row

CLIENTS, RATE, SECONDS = 20, 60.0, 4.0
ONE_BY_ONE = 200
#: What twenty clients may wait, and what a single one may.
MANY_WAIT, ONE_WAITS = 1000.0, 50.0  # ms
PROJECT = presets()[0]["project"]
PROJECT["simulation"]["duration"] = 1.0
PROJECT["reference"]["duration"] = 0.9


@contextmanager
def page() -> Iterator[str]:
    """Its address; the process is ended by its id."""
    command = [sys.executable, "-c", "from foreswitch.cli import main; main()", "page", "--no-open", "--port", "0"]
    server = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    )
    assert server.stdout is not None
    try:
        found = re.match(r"http://([^/]*)/", server.stdout.readline())
        assert found
        yield found[1]
    finally:
        server.terminate()
        server.wait()


def request(name: int, Td: float) -> str:
    return json.dumps(
        {"id": name, "kind": "look", "project": PROJECT | {"controller": PROJECT["controller"] | {"Td": Td}}}
    )


def settings(address: str) -> dict[str, Any]:
    return {"uri": f"ws://{address}/ws", "origin": f"http://{address}", "compression": None, "open_timeout": 60}


async def one(address: str) -> tuple[list[float], list[float]]:
    """Milliseconds from request to reply, and of these in the worker."""
    waits, work = [], []
    async with connect(**settings(address)) as talk:
        for i in range(ONE_BY_ONE):
            begun = time.perf_counter()
            await talk.send(request(i, 0.02 + 1e-5 * i))
            header, _ = unpack(await talk.recv())
            waits.append(1e3 * (time.perf_counter() - begun))
            work.append(header["elapsed_ms"])
    return waits[10:], work[10:]  # the first ones wait for the processes to load


async def drag(address: str, seed: int) -> tuple[list[float], int, int, int]:
    """Milliseconds that each movement waited; replies out of date, replies with errors, movements never drawn."""
    moved: dict[int, float] = {}
    waits: list[float] = []
    stale = errors = answered = 0
    count = round(RATE * SECONDS)
    async with connect(**settings(address)) as talk:

        async def move() -> None:
            begun = time.perf_counter()
            for i in range(count):
                await asyncio.sleep(max(0.0, begun + i / RATE - time.perf_counter()))
                moved[i] = time.perf_counter()
                await talk.send(request(i, 0.015 + 1e-5 * (i + seed)))

        moving = asyncio.create_task(move())
        while answered < count:
            header, arrays = unpack(await asyncio.wait_for(talk.recv(), 30.0))
            answered += 1
            if header.get("stale"):
                stale += 1
            elif not arrays:
                errors += 1
            else:
                now = time.perf_counter()
                shown = [i for i in moved if i <= header["id"]]
                waits += [1e3 * (now - moved.pop(i)) for i in shown]
        await moving
    return waits, stale, errors, len(moved)


async def many(address: str) -> list[tuple[list[float], int, int, int]]:
    return await asyncio.gather(*(drag(address, i) for i in range(CLIENTS)))


def rows() -> list[Row]:
    with page() as address:
        waits, work = asyncio.run(one(address))
        drags = asyncio.run(many(address))
    all_waits = [wait for each, *_ in drags for wait in each]
    p95 = quantiles(all_waits, n=20)[-1]
    stale = sum(each[1] for each in drags)
    total = round(CLIENTS * RATE * SECONDS)
    single = quantiles(waits, n=20)[-1]
    return [
        Row("page, a look of 1000 steps", f"{median(waits):.1f} ms", f"{median(work):.1f} ms",
            f"95 %: {single:.1f} ms; second figure: in the worker", f"95 % <= {ONE_WAITS:g} ms", single <= ONE_WAITS),
        Row(f"page, {CLIENTS} clients drag at once", f"{median(all_waits):.0f} ms", f"{p95:.0f} ms",
            f"{total - stale} of {total} movements drawn", f"95 % <= {MANY_WAIT:g} ms", p95 <= MANY_WAIT),
    ]  # fmt: skip
