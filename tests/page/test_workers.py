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

from foreswitch.page import server, socket, workers
from foreswitch.page.limits import LONGEST_JOB
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


# What is said -----------------------------------------------------------------------------------------------------------


class Failing:
    """A pool whose every job fails so."""

    def __init__(self, error):
        self.error = error

    async def run(self, choose):
        if self.error is Overrun:
            choose()  # it was begun
        raise self.error


def refusal(pool, kind, body=b"{}"):
    head, found = asyncio.run(socket.run_job(pool, lambda: ({"kind": kind, "id": 5}, body)))
    assert head["status"] == 422
    if kind in socket.KINDS:
        fields = unpack(found)[0]
        assert (fields["id"], fields["kind"]) == (5, kind)
        return fields["error"]
    return json.loads(found)["error"]


#: What a client can make smaller, by what it asks: no other kind is told of it.
SMALLER = {"look": "run", "costs": "run", "certify": "margins", "baseline": "budget", "project": "files",
           "columns": "upload", "identify": "upload", "export": "run"}  # fmt: skip


@pytest.mark.parametrize("kind", LONGEST_JOB)
def test_what_takes_too_long_is_told_how_to_be_shorter(kind):
    error = refusal(Failing(Overrun), kind)
    problem, _, remedy = error["message"].partition("; ")
    assert problem == f"this takes longer than {LONGEST_JOB[kind]:g} s, or more memory than there is"
    assert SMALLER[kind] in remedy
    assert ("run" in remedy) is (kind not in ("project", "columns", "identify")), "an upload has no run"
    assert error["field"] is None


def test_every_kind_of_job_has_its_limit_and_its_remedy():
    assert set(LONGEST_JOB) == set(socket.REMEDIES) == {*socket.KINDS, "project", "columns", "identify", "export"}


@pytest.mark.parametrize("kind", LONGEST_JOB)
def test_where_too_much_is_asked_at_once_only_waiting_helps(kind):
    assert refusal(Failing(Busy), kind)["message"] == "the page has too much to do at present; try again in a moment"


def test_a_slow_upload_is_told_to_be_smaller(monkeypatch):
    """By the processes themselves: 40 000 rows in no time at all."""
    monkeypatch.setitem(LONGEST_JOB, "columns", 0.001)
    rows = b"t,u,y\n" + b"".join(b"%d,0,1\n" % i for i in range(40_000))

    async def scenario(pool, seen):
        seen |= pids(pool)
        _, body = await socket.run_job(pool, lambda: ({"kind": "columns"}, rows))
        assert json.loads(body)["error"]["message"].endswith("; make the upload smaller")

    with_pool(scenario)


def test_an_upload_that_does_not_arrive_is_told_to_be_smaller(monkeypatch):
    monkeypatch.setattr(server, "SLOWEST_UPLOAD", 0.05)
    site = server.application({}, hosts={"127.0.0.1:80"}, port=80, token=None)
    headers = [(b"host", b"127.0.0.1:80"), (b"origin", b"http://127.0.0.1:80"), (b"content-length", b"100")]
    scope = {"type": "http", "http_version": "1.1", "method": "POST", "scheme": "http", "path": "/columns",
             "raw_path": b"/columns", "query_string": b"", "headers": headers, "server": ("127.0.0.1", 80)}  # fmt: skip
    sent = []

    async def run():
        async def receive():
            await asyncio.Event().wait()

        async def send(message):
            sent.append(message)

        await site(scope, receive, send)

    asyncio.run(run())
    assert sent[0]["status"] == 408
    error = json.loads(sent[1]["body"])["error"]
    assert error["message"] == "the upload took longer than 0.05 s; make it smaller, or try again"


def test_a_queue_that_does_not_move_is_busy(monkeypatch):
    """No process becomes free: nothing is wrong with the job, and nothing of it need be smaller."""
    monkeypatch.setattr(workers, "LOADING", 0.05)

    async def run():
        with pytest.raises(Busy):
            await Pool(1).run(lambda: LOOK)  # whose processes were never started

    asyncio.run(run())


# Bounds ---------------------------------------------------------------------------------------------------------------


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
