"""Many runs of a study: the paper's 1 s trace with sensor noise, beside the same loop in NumPy, and how memory grows.

A share of a million runs by default; `--full` as the last argument takes all, about a minute on two cores.
"""

import os
import resource
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np

from common import REFERENCE, TS, controller
from foreswitch import simulate_batch, study
from foreswitch.project import Project
from table import Row, seconds

RUNS, SHARE, STEPS = 1_000_000, 20_000, 1_000
NOISE = (20.0, 20.0)
#: Runs that NumPy takes side by side, so many that the calls cost nothing and so few that the arrays stay in the cache.
WIDTH = 4096
SINGLE = 3
PAIRS = 3
#: Bytes that a run may add to the peak: its row, the columns on their way to a file, and room to breathe.
ROOM = 8 * 8 * 2


def project(noise: tuple[float, float]) -> Project:
    return Project({
        "plant": {"model": "integrator_lag", "k": 16500.0, "c": 0.006, "input_delay": 0.005},
        "actuator": {"levels": [0, 1], "Ts": TS},
        "controller": {"Td": 0.020, "lam": 2500.0},
        "reference": {"kind": "half_sine", "height": 1e5, "duration": 20.0},
        "simulation": {"duration": STEPS * TS} | ({"noise": list(noise)} if any(noise) else {}),
    })  # fmt: skip


class Numpy:
    """The same loop by hand: the law's tables and the plant's, commands under way in a ring, noise drawn at once."""

    def __init__(self) -> None:
        law = controller()
        rows, sliding, model = law.law.rows, law.law.sliding, law.model
        self.state, self.hold, self.pending = rows.state[0], rows.hold[0][0, 0], rows.pending[0][:, 0]
        self.A, self.old = model.transition, model.old[0]
        self.new = np.asarray(model.new)[0]
        assert not self.new.any()
        assert len(self.pending) == 5
        t = np.arange(STEPS + 1) * TS
        self.wanted = REFERENCE(t, 1)[:, 0, 0]
        self.told = REFERENCE(t, 2)[:, 0] @ sliding.reference[0]

    def side_by_side(self, runs: int, noise: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
        """Figures of runs of which each step is taken at once."""
        x, u = np.zeros((2, runs)), np.zeros(runs)
        ring, square, largest = np.zeros((5, runs)), np.zeros(runs), np.zeros(runs)
        switches, on, deviation = np.zeros(runs), np.zeros(runs), np.array(noise)[:, None]
        weights = [np.roll(self.pending[::-1], k) for k in range(5)]  # slot k % 5 holds the oldest
        for k in range(STEPS):
            error = x[0] - self.wanted[k]
            square += error * error
            np.maximum(largest, np.abs(error), out=largest)
            measured = x + deviation * rng.standard_normal((2, runs)) if any(noise) else x
            s = self.state @ measured + weights[k % 5] @ ring
            s -= self.told[k]
            before, u = u, (self.hold * (2.0 * s + self.hold) < 0.0).astype(float)
            if k:
                switches += u != before
            on += u
            x = self.A @ x + self.old[:, None] * ring[k % 5]
            ring[k % 5] = u
        error = x[0] - self.wanted[STEPS]
        square += error * error
        np.maximum(largest, np.abs(error), out=largest)
        return np.column_stack([np.sqrt(square / (STEPS + 1)), largest, switches, on * TS])

    def one(self, noise: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
        """Figures of one run, step by step."""
        x, u = np.zeros(2), 0.0
        known, issued = np.concatenate([self.state, self.pending]), np.zeros(STEPS + 5)
        trace, levels = np.zeros(STEPS + 1), np.array([0.0, 1.0])
        seen = np.zeros(7)
        given = np.array(noise) * rng.standard_normal((STEPS, 2))
        for k in range(STEPS):
            trace[k] = x[0]
            seen[:2] = x + given[k]
            seen[2:] = issued[k : k + 5][::-1]
            s = known @ seen - self.told[k] + self.hold * levels
            u = levels[(s * s).argmin()]
            x = self.A @ x + self.old * issued[k]
            issued[k + 5] = u
        trace[STEPS] = x[0]
        error, u_course = trace - self.wanted, issued[5:]
        return np.array([
            np.sqrt(np.mean(error**2)), np.abs(error).max(), np.count_nonzero(np.diff(u_course)), u_course.sum() * TS,
        ])  # fmt: skip


def batch(noise: tuple[float, float], runs: int) -> None:
    simulate_batch(controller(), REFERENCE, STEPS * TS, seeds=runs, noise=noise if any(noise) else None)


def agree(hand: Numpy) -> None:
    """All three loops are one and the same."""
    quiet = (0.0, 0.0)
    ours = study(project(quiet)).figures[0]
    for other in (hand.side_by_side(3, quiet, np.random.default_rng(0))[1], hand.one(quiet, np.random.default_rng(0))):
        assert np.allclose(ours, other, rtol=1e-9), f"{ours} and {other} differ"
    noisy = study(project(NOISE), repeats=WIDTH, seed=1).figures
    other = hand.side_by_side(WIDTH, NOISE, np.random.default_rng(1))
    spread = np.hypot(noisy.std(axis=0), other.std(axis=0)) / np.sqrt(WIDTH)
    assert (np.abs(noisy.mean(axis=0) - other.mean(axis=0)) < 5.0 * spread).all(), "noise acts differently"


def timed(action: Callable[[], object]) -> float:
    """Seconds of the processor over all threads."""
    start = process_time()
    action()
    return process_time() - start


def turn(hand: Numpy, noise: tuple[float, float], seed: int) -> list[float]:
    """Seconds per run of a study, a batch, NumPy side by side and NumPy one by one."""
    rng, count, given = np.random.default_rng(seed), 8 * WIDTH, project(noise)
    return [
        timed(lambda: study(given, repeats=count, seed=seed)) / count,
        timed(lambda: batch(noise, count)) / count,
        timed(lambda: hand.side_by_side(WIDTH, noise, rng)) / WIDTH,
        timed(lambda: [hand.one(noise, rng) for _ in range(SINGLE)]) / SINGLE,
    ]


def peers(hand: Numpy) -> Iterator[Row]:
    """Time for each step, in turn."""
    for name, noise in (("without noise", (0.0, 0.0)), ("with noise", NOISE)):
        times = [turn(hand, noise, seed) for seed in range(PAIRS)]
        ours, plain, wide, single = (median(column) / STEPS for column in zip(*times, strict=True))
        text = f"{ours / plain:.2f} times as long"
        yield Row(f"study {name}, simulate_batch", seconds(ours), seconds(plain), text, "<= 1.3", ours <= 1.3 * plain)
        for what, other, least in (("run by run", single, 20.0), ("all runs at once", wide, 0.0)):
            ratio = other / ours
            text = f"{ratio:.3g} times as fast" if ratio >= 1.0 else f"{1.0 / ratio:.3g} times as long"
            gate = f">= {least:g}" if least else ""
            yield Row(f"study {name}, NumPy {what}", seconds(ours), seconds(other), text, gate, ratio >= least)


def whole(runs: int) -> Iterator[Row]:
    """A study kept on disk, and the bytes by which the peak grew."""
    given = project(NOISE)
    with TemporaryDirectory() as folder:
        study(given, repeats=1000, seed=2, out=Path(folder) / "warm")  # libraries loaded, threads started
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start, begun = perf_counter(), process_time()
        study(given, repeats=runs, seed=3, out=Path(folder) / "study")
        taken, worked = perf_counter() - start, process_time() - begun
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    scaled = "" if runs == RUNS else f", {RUNS:,} would take {taken * RUNS / runs:.0f} s"
    cores = os.cpu_count() or 1
    yield Row(f"study of {runs:,} runs of {STEPS:,} steps with noise, {cores} cores", f"{taken:.1f} s", "",
              f"{worked:.1f} s of the processor{scaled}")  # fmt: skip
    limit = ROOM * RUNS  # a share of the runs has the same room for libraries that allocate in blocks
    yield Row("  peak memory beyond its start", f"{grown / 1e6:.0f} MB", "", f"{grown / runs:.0f} bytes a run",
              f"<= {limit / 1e6:.0f} MB", grown <= limit)  # fmt: skip


def rows(full: bool = False) -> Iterator[Row]:
    hand = Numpy()
    agree(hand)
    yield from whole(RUNS if full else SHARE)
    yield from peers(hand)


if __name__ == "__main__":
    from table import HEAD, line

    print(HEAD)
    for row in rows("--full" in sys.argv):
        print(line(row), flush=True)
