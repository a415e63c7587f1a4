"""Processes that do the arithmetic, so that the server never waits and a job that takes too long can be ended."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import signal
import struct
import sys
from collections.abc import Callable
from typing import Any

from foreswitch.page.wire import frame

__all__ = ["Busy", "Job", "Overrun", "Pool"]

#: What to do, with what, and the seconds that it may take once begun.
Job = tuple[dict[str, Any], bytes, float]

#: Seconds that a new process may take to load.
LOADING = 120.0


class Overrun(Exception):
    """A job took too long, or its process died."""


class Busy(Exception):
    """Too many jobs wait already, or no process has become free for one."""


class _Worker:
    """One process."""

    process: asyncio.subprocess.Process

    async def start(self) -> None:
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "foreswitch.page.worker",
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg"},
            start_new_session=True,  # the terminal's Ctrl-C is the server's; and it leads what it starts itself
        )  # fmt: skip
        await asyncio.wait_for(self._reply(), LOADING)

    async def ask(self, head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
        stdin = self.process.stdin
        assert stdin is not None
        stdin.write(frame(head, body))
        await stdin.drain()
        return await self._reply()

    async def _reply(self) -> tuple[dict[str, Any], bytes]:
        stdout = self.process.stdout
        assert stdout is not None
        first, second = struct.unpack("<II", await stdout.readexactly(8))
        head = json.loads(await stdout.readexactly(first))
        return head, await stdout.readexactly(second)

    async def stop(self) -> None:
        """End it, with all that it has started."""
        if self.process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                if hasattr(os, "killpg"):
                    os.killpg(self.process.pid, signal.SIGKILL)
                else:
                    self.process.kill()
        await self.process.wait()


class Pool:
    """So many processes; jobs are done in the order they come.

    Parameters
    ----------
    size : int
        Processes.
    longest_queue : int
        Jobs that may wait; more are refused.
    """

    def __init__(self, size: int, longest_queue: int = 128) -> None:
        self.size, self.longest_queue, self.waiting = size, longest_queue, 0
        self._idle: asyncio.Queue[_Worker] = asyncio.Queue()
        self._all: set[_Worker] = set()
        self._starting: set[asyncio.Task[None]] = set()

    def start(self) -> None:
        """Begin to load; jobs may come at once."""
        for _ in range(self.size):
            self._add()

    def _add(self) -> None:
        task = asyncio.create_task(self._start_one())
        self._starting.add(task)
        task.add_done_callback(self._starting.discard)

    async def _start_one(self) -> None:
        """Until it succeeds: what the machine lacks now it may have later."""
        for pause in itertools.chain((1.0, 2.0, 4.0, 8.0, 16.0), itertools.repeat(30.0)):
            worker = _Worker()
            try:
                await worker.start()
            except BaseException as error:
                if hasattr(worker, "process"):
                    await worker.stop()
                if not isinstance(error, Exception):
                    raise
                await asyncio.sleep(pause)
            else:
                self._all.add(worker)
                self._idle.put_nowait(worker)
                return

    async def run(self, choose: Callable[[], Job]) -> tuple[dict[str, Any], bytes]:
        """One job's reply.

        Parameters
        ----------
        choose : callable
            Called when a process is free: the job, by then perhaps another than when the waiting began.

        Returns
        -------
        tuple
            Header and body.

        Raises
        ------
        Busy
            If too many jobs wait already, or none of the processes becomes free.
        Overrun
            If it took longer, or its process died; that process is ended then.
        """
        if self.waiting >= self.longest_queue:
            raise Busy
        self.waiting += 1
        try:
            worker = await asyncio.wait_for(self._idle.get(), LOADING)
        except TimeoutError as error:
            raise Busy from error
        finally:
            self.waiting -= 1
        done = False
        try:
            head, body, limit = choose()
            reply = await asyncio.wait_for(worker.ask(head | {"limit": limit}, body), limit)
            done = True
        except (TimeoutError, asyncio.IncompleteReadError, ConnectionError) as error:
            raise Overrun from error
        finally:
            # after a cancellation too the process is in the middle of something
            if done:
                self._idle.put_nowait(worker)
            else:
                self._all.discard(worker)
                self._add()
                await worker.stop()
        return reply

    async def stop(self) -> None:
        """End all processes."""
        for task in list(self._starting):
            task.cancel()
        await asyncio.gather(*self._starting, return_exceptions=True)
        await asyncio.gather(*(worker.stop() for worker in self._all))
