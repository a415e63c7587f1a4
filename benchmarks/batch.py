"""Many runs at once: beside the same runs one by one, and on two threads beside one."""

import hashlib
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from time import perf_counter, process_time

import numpy as np

from common import REFERENCE, TS, controller
from foreswitch import simulate, simulate_batch
from table import ATTEMPTS, Row, seconds

RUNS, STEPS = 1_000, 1_000
SINGLE = 50
NOISE = 20.0
PAIRS = 9
#: Of a gain of 2: what two threads must bring, or else this share of what a busy machine has to give.
GAIN, SHARE = 1.7, 0.92


def runs(count: int, threads: int) -> np.ndarray:
    return simulate_batch(controller(), REFERENCE, STEPS * TS, seeds=count, noise=NOISE, threads=threads).max_error


def hashes(threads: int) -> None:
    """Work that shares nothing and holds no lock: what it gains is what there is to gain."""
    block = bytes(2_000_000)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda _: hashlib.sha256(block).digest(), range(64)))


def pairs(
    clock: Callable[[], float], one: Callable[[], object], two: Callable[[], object]
) -> list[tuple[float, float]]:
    """Times of both, in turn; the first turn only warms up."""

    def timed(action: Callable[[], object]) -> float:
        start = clock()
        action()
        return clock() - start

    return [(timed(one), timed(two)) for _ in range(PAIRS + 1)][1:]


def gain(action: Callable[[int], object]) -> float:
    """One thread's time over that of two, by the clock on the wall."""
    return median(one / two for one, two in pairs(perf_counter, lambda: action(1), lambda: action(2)))


def two_threads() -> Row:
    assert np.array_equal(runs(RUNS, 1), runs(RUNS, 2))
    for _ in range(ATTEMPTS):
        possible, ours = gain(hashes), gain(lambda threads: runs(RUNS, threads))
        if passed := ours >= min(GAIN, SHARE * possible):
            break
    text, gate = f"{ours:.2f} times as fast as one", f">= {GAIN:g}, or {SHARE:g} of the other"
    return Row("batch on two threads, SHA-256", f"{ours:.2f}", f"{possible:.2f}", text, gate, passed)


def one_by_one() -> list[float]:
    law = controller()
    results = [simulate(law, REFERENCE, STEPS * TS, seed=seed, noise=NOISE) for seed in range(SINGLE)]
    return [float(np.abs(run.y - run.r).max()) for run in results]


def one_thread() -> Row:
    """By the processor's clock over all threads: a batch works in threads of its own."""
    assert runs(SINGLE, 1)[:, 0].tolist() == one_by_one()
    taken = pairs(process_time, lambda: runs(SINGLE, 1), one_by_one)
    ours, other = (median(times) / (SINGLE * STEPS) for times in zip(*taken, strict=True))
    worst = max(a / b for a, b in taken)
    text = f"{ours / other:.2f} ({worst:.2f}) times as long"
    return Row("batch on one thread, simulate", seconds(ours), seconds(other), text, "<= 1", ours <= other)


def rows() -> Iterator[Row]:
    yield one_thread()
    if (os.cpu_count() or 1) > 1:
        yield two_threads()
