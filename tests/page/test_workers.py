"""The processes behind the page: a job that takes too long is ended, and nothing is left of it."""

import asyncio
import json
import os
import re
import sys
import time
from importlib.metadata import distribution, requires
from pathlib import Path

import pytest

from foreswitch.page import workers
from foreswitch.page.wire import unpack
from foreswitch.page.workers import Busy, Overrun, Pool
from page.projects import HOT, INVERTER
from page.serving import alive

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")

LOOK = {"kind": "look", "id": 1}, json.dumps({"project": HOT}).encode(), 100.0
#: Takes seconds.
LONG = {"kind": "certify", "id": 1}, json.dumps({"project": INVERTER}).encode(), 100.0


def pids(pool):
    return {worker.process.pid for worker in pool._all}


def with_pool(scenario, **options):
    """A scenario on a pool of one process; afterwards none is left."""

    async def run():
        pool = Pool(1, **options)
        pool.start()
        seen = set()
        try:
            _, body = await pool.run(lambda: LOOK)
            assert unpack(body)[1]["t"].size == 601
            await scenario(pool, seen)
        finally:
            seen |= pids(pool)
            await pool.stop()
        assert not [pid for pid in seen if alive(pid)]
        others = asyncio.all_tasks() - {asyncio.current_task()}
        assert not others

    asyncio.run(run())


def test_a_job_that_takes_too_long_is_ended_with_its_process():
    async def scenario(pool, seen):
        seen |= (first := pids(pool))
        begun = time.monotonic()
        with pytest.raises(Overrun):
            await pool.run(lambda: (*LONG[:2], 0.3))
        assert time.monotonic() - begun < 3.0
        assert not any(map(alive, first))
        _, body = await pool.run(lambda: LOOK)  # by the one that took its place
        assert unpack(body)[1]["t"].size == 601
        assert pids(pool).isdisjoint(first)

    with_pool(scenario)


def test_a_job_nobody_waits_for_is_ended_too():
    async def scenario(pool, seen):
        seen |= (first := pids(pool))
        job = asyncio.create_task(pool.run(lambda: LONG))
        await asyncio.sleep(0.2)
        job.cancel()
        with pytest.raises(asyncio.CancelledError):
            await job
        assert not any(map(alive, first))
        assert unpack((await pool.run(lambda: LOOK))[1])[1]["t"].size == 601

    with_pool(scenario)


def test_a_process_that_dies_is_replaced():
    async def scenario(pool, seen):
        [pid] = pids(pool)
        job = asyncio.create_task(pool.run(lambda: LONG))
        await asyncio.sleep(0.2)
        os.kill(pid, 9)
        with pytest.raises(Overrun):
            await job
        assert unpack((await pool.run(lambda: LOOK))[1])[1]["t"].size == 601

    with_pool(scenario)


def test_no_more_jobs_wait_than_agreed():
    async def scenario(pool, seen):
        jobs = [asyncio.create_task(pool.run(lambda: LOOK)) for _ in range(8)]
        found = await asyncio.gather(*jobs, return_exceptions=True)
        assert sum(isinstance(each, Busy) for each in found) == 8 - 3
        assert sum(isinstance(each, tuple) for each in found) == 3
        assert pool.waiting == 0

    with_pool(scenario, longest_queue=3)


def test_a_process_that_does_not_start_is_tried_again(monkeypatch):
    """As when the machine has no memory for a while."""
    tries = []
    start = workers._Worker.start

    async def failing(worker):
        tries.append(worker)
        if len(tries) == 2:
            raise OSError("no memory")
        await start(worker)

    monkeypatch.setattr(workers._Worker, "start", failing)

    async def scenario(pool, seen):
        seen |= pids(pool)
        with pytest.raises(Overrun):
            await pool.run(lambda: (*LONG[:2], 0.3))
        _, body = await pool.run(lambda: LOOK)
        assert unpack(body)[1]["t"].size == 601
        assert len(tries) == 3

    with_pool(scenario)


def test_memory_is_bounded():
    """An address space of 4 GiB: what asks for more is refused, and the process lives on."""

    async def scenario(pool, seen):
        [pid] = pids(pool)
        limits = Path(f"/proc/{pid}/limits").read_text()
        assert re.search(r"Max address space +4294967296 ", limits)

    with_pool(scenario)


# What the page adds ---------------------------------------------------------------------------------------------------


def closure(names):
    """All distributions that these need, themselves included, on this machine."""
    found, left = set(), list(names)
    while left:
        name = re.sub(r"[-_.]+", "-", left.pop()).lower()
        if name in found:
            continue
        found.add(name)
        for line in requires(name) or []:
            requirement, _, marker = line.partition(";")
            if "extra" in marker or "win32" in marker or "Windows" in marker or "platform_python" in marker:
                continue
            older = re.search(r"""python(?:_full)?_version *< *["']3\.(\d+)""", marker)
            if older and sys.version_info[1] >= int(older[1]):
                continue
            left.append(re.match(r"[\w.-]+", requirement.strip())[0])
    return found


def wanted(extra):
    """What the package itself names, without an extra or for one."""
    lines = [line for line in distribution("foreswitch").requires if ("extra ==" in line) == bool(extra)]
    return [
        re.match(r"[\w-]+", line)[0] for line in lines if not extra or re.search(f"extra == ['\"]{extra}['\"]", line)
    ]


def test_the_page_adds_at_most_ten_packages():
    assert set(wanted("page")) == {"starlette", "uvicorn", "websockets"}
    base = closure(wanted(None))
    assert {"numpy", "click", "typing-extensions"} <= base | {"click"}
    added = closure(wanted("page")) - base
    assert {"starlette", "anyio", "h11"} <= added
    assert len(added) <= 10, sorted(added)
