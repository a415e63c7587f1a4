"""A row of the table, and how two rivals are timed."""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from time import thread_time

#: A busy machine can spoil one measurement, but hardly three in a row.
ATTEMPTS = 3


@dataclass(frozen=True)
class Row:
    """One line: ours beside another, what it comes to, and whether its gate holds."""

    name: str
    ours: str
    other: str = ""
    result: str = ""
    gate: str = ""
    passed: bool = True


def line(row: Row) -> str:
    verdict = "" if row.passed else "  FAILED"
    return f"{row.name:<60}{row.ours:>10}{row.other:>11}   {row.result:<33} {row.gate}{verdict}".rstrip()


HEAD = line(Row("", "ours", "other", "median (worst)", "gate")) + "\n" + "-" * 124


def timed(action: Callable[[], object]) -> float:
    """Seconds of the processor: those that other processes took do not count."""
    start = thread_time()
    action()
    return thread_time() - start


@dataclass(frozen=True)
class Race:
    """Seconds per step of both, one pair for each turn."""

    ours: list[float]
    other: list[float]

    @property
    def ratio(self) -> float:
        return median(self.ours) / median(self.other)

    @property
    def worst(self) -> float:
        return max(a / b for a, b in zip(self.ours, self.other, strict=True))


def race(ours: Callable[[], object], other: Callable[[], object], steps: int, other_steps: int, repeats: int) -> Race:
    """Both in turn, so that a slow moment of the machine meets both; the first turn only warms up."""
    pairs = [(timed(ours) / steps, timed(other) / other_steps) for _ in range(repeats + 1)][1:]
    return Race([a for a, _ in pairs], [b for _, b in pairs])


def seconds(value: float) -> str:
    return f"{value * 1e9:.1f} ns" if value < 1e-6 else f"{value * 1e6:.2f} us"


def compare(
    name: str,
    ours: Callable[[], object],
    other: Callable[[], object],
    steps: int,
    *,
    other_steps: int = 0,
    most: float = 0.0,
    faster: float = 0.0,
    repeats: int = 25,
) -> Row:
    """Two loops of so many steps: ours takes at most ``most`` times as long as the other, or is ``faster`` times as fast.

    Medians are judged. Neither limit: only reported.
    """
    for _ in range(ATTEMPTS):
        result = race(ours, other, steps, other_steps or steps, repeats)
        passed = (not most or result.ratio <= most) and (not faster or 1.0 / result.ratio >= faster)
        if passed:
            break
    if most or result.ratio > 1.0:
        text, gate = f"{result.ratio:.2f} ({result.worst:.2f}) times as long", f"<= {most:g}" if most else ""
    else:
        text = f"{1 / result.ratio:.3g} ({1 / result.worst:.3g}) times as fast"
        gate = f">= {faster:g}" if faster else ""
    return Row(name, seconds(median(result.ours)), seconds(median(result.other)), text, gate, passed)
