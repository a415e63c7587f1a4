"""Runs of a study: in this process, in others, or on a cluster; what is lost is done again."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib.metadata import version
from multiprocessing import get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.simulation.batch import simulate_batch
from foreswitch.simulation.run import figures
from foreswitch.studies.plan import ERRORS, Plan, full, simulated

__all__ = ["Piece", "WorkersLost", "checked_scheduler", "chunk_rows", "run_pieces", "run_rows"]

#: Rows from a first up to a last.
Piece = tuple[int, int]

#: Seconds that a chunk takes, about: what an interrupted study loses; and with several workers at least, next to which
#: 2 ms for handing out a task are nothing.
LONG, SHORT = 1.0, 0.2
#: Seconds of the first rows from which the length of a chunk is judged.
ENOUGH = 0.02
#: Chunks for each worker at least, so that all end at about the same time.
SHARE = 4
#: Chunks in all, at most.
MOST = 10_000
#: Times in a row that workers may die without finishing anything.
LIVES = 3
#: Plants that are laid out at once; each holds the reference in its loop.
PLANTS = 128
#: Where libraries of linear algebra read how many threads they may have.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Seconds to wait for a scheduler, and for its first worker.
PATIENCE = 10.0


class WorkersLost(RuntimeError):
    """The workers died, or their scheduler did; what they finished is kept."""


# One chunk ------------------------------------------------------------------------------------------------------------


def run_rows(plan: Plan, folder: Path, piece: Piece, threads: int | None = None) -> Array:
    """Figures of merit of some runs, one row each: rms and largest error per output, switches and on-time per input."""
    first, last = piece
    found = []
    while first < last:
        point, repeat = divmod(first, plan.repeats)
        count = min(last - first, plan.repeats - repeat)
        found.append(_repeats(plan, folder, point, np.arange(repeat, repeat + count), threads))
        first += count
    return np.vstack(found)


def _repeats(plan: Plan, folder: Path, point: int, repeats: np.ndarray[Any, Any], threads: int | None) -> Array:
    """Runs of one point."""
    setup = plan.setup(point, int(repeats[0]), folder)
    project, settings, seeds = setup.project, dict(setup.settings), plan.seeds(point, repeats)
    varying, found = plan.varying(), []
    starts, truths = {key for key in varying if _is_start(key)}, {key for key in varying if _is_truth(key)}
    # a callable disturbance knows the truth, so that each truth has its own
    if varying == starts or (varying == starts | truths and not callable(settings["disturbance"])):
        block = PLANTS if truths else repeats.size
        for rows in (slice(start, start + block) for start in range(0, repeats.size, block)):
            if starts:
                settings["x0"] = np.tile(np.array(setup.settings["x0"], dtype=np.float64), (len(repeats[rows]), 1))
                for key in starts:
                    settings["x0"][:, int(key.split(".")[-1])] = plan.drawn(key, point, repeats[rows])
            if truths:
                each = (plan.setup(point, int(repeat), folder, project) for repeat in repeats[rows])
                settings["plant"] = [one.settings["plant"] for one in each]
            batch = simulate_batch(
                project.controller, project.reference, seeds=seeds[rows].tolist(), threads=threads, **settings
            )
            found.append(np.hstack([batch.rms_error, batch.max_error, batch.switches, batch.on_time]))
        return np.vstack(found)
    like = project if all(map(simulated, varying)) else None
    for repeat, seed in zip(repeats, seeds, strict=True):
        setup = plan.setup(point, int(repeat), folder, like)
        run = setup.loop.run(setup.settings.get("x0"), int(seed))
        *rest, on = figures(run.y, run.r, run.u, run.safe_level)
        found.append(np.concatenate([*rest, on * setup.project.controller.Ts])[None])
    return np.vstack(found)


def _is_truth(key: str) -> bool:
    return key in ERRORS or full(key).startswith("simulation.plant.")


def _is_start(key: str) -> bool:
    return full(key).startswith("simulation.x0.")


@contextmanager
def unpacked(plan: Plan) -> Iterator[Path]:
    """A folder with the files that a plan carries."""
    with TemporaryDirectory(prefix="foreswitch-") as name:
        for file, data in plan.files.items():
            (Path(name) / file).write_bytes(data)
        yield Path(name)


# How long a chunk is --------------------------------------------------------------------------------------------------


def chunk_rows(plan: Plan, workers: int) -> int:
    """Rows per chunk, from the time that the first ones take."""
    count, seconds = 0, 0.0
    with unpacked(plan) as folder:

        def timed() -> float:
            begun = time.perf_counter()
            run_rows(plan, folder, (0, count), 1 if workers > 1 else None)
            return time.perf_counter() - begun

        while count < plan.rows and seconds < ENOUGH:
            count = min(max(1, 2 * count), plan.rows)
            seconds = timed()
            if seconds >= ENOUGH:  # a busy machine can spoil one measurement
                seconds = min(seconds, timed())
    each = seconds / count
    target = LONG if workers == 1 else min(LONG, max(SHORT, plan.rows * each / (SHARE * workers)))
    return min(plan.rows, max(1, round(target / each), -(-plan.rows // MOST)))


# Where they run -------------------------------------------------------------------------------------------------------


def checked_scheduler(scheduler: str | None) -> str | None:
    """None, ``processes`` or an address."""
    if scheduler in (None, "processes") or (isinstance(scheduler, str) and "://" in scheduler):
        return scheduler
    address = "the address of a Dask scheduler such as 'tcp://127.0.0.1:8786'"
    raise Mistake("scheduler", scheduler, f"give None for this process, 'processes', or {address}")


def run_pieces(
    plan: Plan, scheduler: str | None, split: Callable[[int], Sequence[Piece]]
) -> Iterator[tuple[Piece, Array]]:
    """Chunks as they finish.

    Parameters
    ----------
    plan : Plan
        With its files inside.
    scheduler : str, optional
    split : callable
        Chunks, for a number of workers.

    Raises
    ------
    WorkersLost
        If the workers die again and again.
    ValueError
        If the scheduler cannot be reached, or a run's parameters do not fit.
    """
    if scheduler is None:
        return _here(plan, split(1))
    if scheduler == "processes":
        count = os.cpu_count() or 1
        return _in_processes(plan, split(count), count)
    return _on_cluster(plan, split, scheduler)


def _here(plan: Plan, pieces: Sequence[Piece]) -> Iterator[tuple[Piece, Array]]:
    with unpacked(plan) as folder:
        for piece in pieces:
            yield piece, run_rows(plan, folder, piece)


# Processes -------------------------------------------------------------------------------------------------------------

_HELD: list[Any] = []  # of a worker process: the plan, its folder, and what removes that


def _receive(blob: bytes) -> None:
    """Take the plan once; end with the parent, and leave it to answer the keyboard."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    plan = pickle.loads(blob)
    folder = unpacked(plan)
    _HELD[:] = [plan, folder.__enter__(), folder]


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(piece: Piece) -> Array:
    return run_rows(_HELD[0], _HELD[1], piece, 1)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes started within leave linear algebra one thread each, unless the user wants otherwise.

    On matrices as small as these, threads of several processes only wait for each other: eight times as long.
    """
    ours = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _in_processes(plan: Plan, pieces: Sequence[Piece], count: int) -> Iterator[tuple[Piece, Array]]:
    waiting, deaths = deque(pieces), 0
    blob = pickle.dumps(plan)
    while waiting:
        pool = ProcessPoolExecutor(min(count, len(waiting)), get_context("spawn"), _receive, (blob,))
        running: dict[Future[Array], Piece] = {}
        try:
            while waiting or running:
                while waiting and len(running) < 2 * count:
                    with _single_threaded():  # a process starts when it is given its first chunk
                        running[pool.submit(_work, waiting[0])] = waiting[0]
                    waiting.popleft()
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    result = done.result()
                    deaths = 0
                    yield running.pop(done), result
        except BrokenProcessPool:
            deaths += 1
            waiting.extendleft(sorted(running.values(), reverse=True))
            if deaths == LIVES:
                raise WorkersLost(
                    f"worker processes died {LIVES} times in a row, last with runs {waiting[0][0] + 1} to {waiting[0][1]}; "
                    "look for what ends them, such as too little memory, then call again with the same out to continue"
                ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


# Dask ------------------------------------------------------------------------------------------------------------------


def _hold(blob: bytes, wanted: str) -> Plan:
    """The plan on a worker."""
    if version("foreswitch") != wanted:
        problem = f"has foreswitch {version('foreswitch')}, this process {wanted}"
        raise Mistake("scheduler", version("foreswitch"), "install the same", problem=problem, subject="a worker")
    plan: Plan = pickle.loads(blob)
    return plan


def _task(plan: Plan, piece: Piece) -> Array:
    with unpacked(plan) as folder:
        return run_rows(plan, folder, piece, 1)


def _on_cluster(plan: Plan, split: Callable[[int], Sequence[Piece]], address: str) -> Iterator[tuple[Piece, Array]]:
    try:
        from distributed import Client, as_completed
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError:
        problem = f"is {address!r}, which needs dask.distributed"
        raise Mistake("scheduler", address, "install foreswitch[dask]", problem=problem) from None
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        problem = f"{address!r} does not answer ({_first_line(error)})"
        remedy = "start one with 'dask scheduler', or give another address"
        raise Mistake("scheduler", address, remedy, problem=problem) from None
    with _quiet("distributed.client"), client:  # it logs tracebacks of what becomes one sentence here
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            remedy = f"start some with 'dask worker {address}'"
            raise Mistake("scheduler", address, remedy, problem=f"{address!r} has no workers") from None
        threads = sum(client.nthreads().values())
        waiting = deque(split(threads))
        name = f"foreswitch-{uuid4().hex}"
        # made by a task of its own, so that it is sent once and, where its worker is lost, made anew
        held = client.submit(_hold, pickle.dumps(plan), version("foreswitch"), key=f"{name}-plan")
        running: dict[Any, Piece] = {}
        stream = as_completed(loop=client.loop)

        def more() -> None:
            while waiting and len(running) < 2 * SHARE * threads:
                piece = waiting.popleft()
                future = client.submit(_task, held, piece, key=f"{name}-{piece[0]}")
                running[future.key] = piece
                stream.add(future)

        more()
        try:
            for future in stream:
                result = future.result()
                piece = running.pop(future.key)
                more()
                yield piece, result
        except KilledWorker:
            raise WorkersLost(
                f"workers of {address!r} died with one chunk again and again; look in their logs for the cause, such as "
                "too little memory, then call again with the same out to continue"
            ) from None
        except (CancelledError, CommClosedError):
            raise WorkersLost(
                f"scheduler {address!r} is gone; start it again, then call again with the same out to continue"
            ) from None


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """A logger says nothing within."""
    logger = logging.getLogger(name)
    was, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = was


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
