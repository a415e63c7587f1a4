"""The long horizon: whole steps of the core, beside general solvers and beside trying every sequence.

Each problem is a sequence of steps. Ours are done as in a loop, one after the other, sequences over and over, and of
each step the shortest time counts: repeating one would teach the processor its branches, and look twice as fast.
"""

import ctypes
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from common import CORE, HERE, build
from peers import ENCODINGS, SOLVERS, Solved, daqp, highs, installed, scip
from problems import Core, Problem, Replay, hot_gas, inverter, transients
from table import Row, seconds

SWEEPS = 15
TWO, THREE = (0.0, 1.0), (-1.0, 0.0, 1.0)
#: The longest horizon that is also enumerated, and how many times a decision is repeated there: it is too short to time.
ENUMERATED, LOOPS = 8, 100
#: How many times as long as the enumeration.
MOST = 2.0
#: Of SCIP, which takes a second and more; in seconds.
INSTANCES, LIMIT = 2, 3.0


def share(time: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Ratios of medians and of maxima."""
    return float(np.median(other) / np.median(time)), float(other.max() / time.max())


def no_dearer(one: Problem, ours: Replay, instances: range, other: Solved) -> None:
    """Costs by one formula, ours never above the other's."""
    for i, moves in zip(instances, other.moves, strict=True):
        cost = one.cost(i, ours.moves[i])
        assert cost <= one.cost(i, moves) * (1.0 + 1e-9), f"{one.name}, step {i}: another solver's moves cost less"
        assert abs(ours.cost[i] - cost) <= 1e-9 * max(cost, 1e-9), f"{one.name}, step {i}: the core tells another cost"


def beside(one: Problem, ours: Replay, every: int, least: tuple[float, float]) -> Row:
    """DAQP in its fastest encoding. least: of the ratio of medians, and of maxima; 0: not judged."""
    instances = range(0, len(one.x), every)
    times = {}
    for encoding in ENCODINGS[len(one.law.levels[0])]:
        other = daqp(one, encoding, instances, sweeps=3)
        no_dearer(one, ours, instances, other)
        times[encoding] = other.seconds
    best = min(times, key=lambda name: float(np.median(times[name])))
    # the longest step of the whole sequence, though the other was given only some of it
    median, largest = share(ours.seconds[::every], times[best])[0], times[best].max() / ours.seconds.max()
    gate = f">= {least[0]:g}" + (f" ({least[1]:g})" if least[1] else "") if least[0] else ""
    return Row(
        f"{one.name}, DAQP {best}", seconds(np.median(ours.seconds)), seconds(np.median(times[best])),
        f"{median:.3g} ({largest:.3g}) times as fast", gate, median >= least[0] and largest >= least[1],
    )  # fmt: skip


def beside_scip(one: Problem, ours: Replay) -> Row:
    instances = range(len(one.x) // (2 * INSTANCES), len(one.x), len(one.x) // INSTANCES)
    other = scip(one, instances, LIMIT)
    no_dearer(one, ours, instances, other)
    ratio = share(ours.seconds[instances.start :: instances.step], other.seconds)[0]
    text = f"{ratio:.2g} times as fast" + ("" if other.proven else ", it is cut off")
    return Row(f"  SCIP, {len(instances)} steps", "", f"{np.median(other.seconds):.1f} s", text)


def beside_highs(one: Problem, ours: Replay) -> Row:
    instances = range(0, len(one.x), 25)
    ratio = share(ours.seconds[::25], other := highs(one, instances, sweeps=3))[0]
    return Row("  HiGHS, no integers: one relaxation", "", seconds(np.median(other)), f"{ratio:.3g} times as fast")


class Enumeration:
    """enumerate.c with the designs of a Core, its sizes read from the design or known."""

    def __init__(self, core: Core, *options: str) -> None:
        target = core.folder / f"enumerate{len(options)}.so"
        arguments = ["-shared", "-DFSW_MAX_MOVES=64", *options, f"-I{core.folder}", f"-I{CORE}"]
        self.core = core
        self.library = ctypes.CDLL(
            str(build(target, *arguments, HERE / "enumerate.c", CORE / "foreswitch.c", CORE / "horizon.c"))
        )

    def __call__(self, one: Problem, ours: Replay) -> np.ndarray:
        """Seconds per decision; the costs must be the same."""
        steps, many = len(one.x), len(one.law.levels[0]) ** one.moves
        line = np.searchsorted(one.law.levels[0], one.pending[:, ::-1, 0]).astype(np.uint8)
        time, cost = np.full(steps, np.inf), np.zeros(steps)
        arrays = [ctypes.c_void_p(a.ctypes.data) for a in (one.x, one.reference, line, time, cost)]
        sizes = (
            ctypes.c_int(self.core.problems.index(one)),
            ctypes.c_long(steps),
            ctypes.c_long(max(1, LOOPS // many)),
        )
        for _ in range(3 if many < 1000 else 1):
            self.library.enumerate_all(*sizes, *arrays)
        assert np.allclose(cost, ours.cost, rtol=1e-9, atol=1e-12), f"{one.name}: the enumeration finds another cost"
        return time


def tiny(core: Core, problems: list[Problem], levels: str) -> Iterator[Row]:
    """Every sequence tried, at each length; decisions repeated on both sides."""
    ours = [core.replay(one, sweeps=3, loops=LOOPS) for one in problems]
    for name, options, judged in (("tried", (), True), ("tried, sizes known", ("-DSIZES_KNOWN",), False)):
        enumeration = Enumeration(core, *options)
        other = [enumeration(one, mine) for one, mine in zip(problems, ours, strict=True)]
        ratios = [1.0 / share(mine.seconds, time)[0] for mine, time in zip(ours, other, strict=True)]
        passed = not judged or max(ratios) <= MOST
        first, last = problems[0].moves, problems[-1].moves
        yield Row(
            f"hot gas {levels} N={first}..{last}, every sequence {name}",
            f"{np.median(ours[-1].seconds) * 1e9:.0f} ns",
            seconds(np.median(other[-1])),
            " ".join(f"{r:.2g}" for r in ratios) + " times as long",
            f"<= {MOST:g}" if judged else "",
            passed,
        )


def rows() -> Iterator[Row]:
    raced = (
        (hot_gas(10, TWO), 1, (0.0, 0.0)),
        (hot_gas(20, TWO), 1, (30.0, 10.0)),
        (hot_gas(30, TWO), 5, (60.0, 0.0)),
        (hot_gas(20, THREE), 25, (100.0, 0.0)),
        (inverter(10), 20, (100.0, 0.0)),
        (transients(20, TWO), 1, (0.0, 0.0)),
        (transients(30, TWO), 1, (0.0, 0.0)),
        (transients(20, THREE), 5, (0.0, 0.0)),
        (transients(30, THREE), 5, (0.0, 0.0)),
    )
    alone = hot_gas(30, THREE)
    short = {text: [hot_gas(N, levels) for N in range(1, ENUMERATED + 1)] for text, levels in
             (("{0,1}", TWO), ("{-1,0,1}", THREE))}  # fmt: skip
    absent = [solver for solver in SOLVERS if not installed(solver)]
    with TemporaryDirectory() as folder:
        core = Core([*(one for one, *_ in raced), alone, *short["{0,1}"], *short["{-1,0,1}"]], Path(folder))
        for one, every, least in raced:
            ours = core.replay(one, SWEEPS)
            if "DAQP" in absent:
                yield timed_alone(one, ours)
            else:
                yield beside(one, ours, every, least)
            if "SCIP" not in absent and one.name in ("hot gas {0,1} N=20", "hot gas {-1,0,1} N=20", "inverter N=10"):
                yield beside_scip(one, ours)
            if "HiGHS" not in absent and one.name == "hot gas {0,1} N=20":
                yield beside_highs(one, ours)
        yield timed_alone(alone, core.replay(alone, SWEEPS))
        for text, problems in short.items():
            yield from tiny(core, problems, text)
    if absent:
        yield Row(", ".join(absent), "skipped", result="not installed: pip install foreswitch[bench]")


def timed_alone(one: Problem, ours: Replay) -> Row:
    return Row(one.name, seconds(np.median(ours.seconds)), result=f"at most {seconds(ours.seconds.max())}")
