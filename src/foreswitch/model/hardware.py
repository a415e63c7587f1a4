"""What real actuators and sensors add to a simulated plant: travel times, faults, noise, quantisation, lost samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import transition

__all__ = ["Hardware", "Stuck"]

#: Instants closer than this share of a period are one.
SAME_INSTANT = 1e-9


@dataclass(frozen=True)
class Stuck:
    """An actuator that stays at one level, whatever it is told.

    Parameters
    ----------
    level : float
        Where it stays; need not be one of the levels.
    start, end : float
        From when to when [s].
    input : int
        Which one, from 0.
    """

    level: float
    start: float = 0.0
    end: float = float("inf")
    input: int = 0

    def __post_init__(self) -> None:
        check.number("level", self.level)
        check.number("start", self.start, least=0.0)
        if not self.end > self.start:
            raise Mistake("end", self.end, f"it must be later than start = {self.start:g}")
        if self.input < 0 or self.input != int(self.input):
            raise Mistake("input", self.input, "give 0 for the first, 1 for the second")


@dataclass(frozen=True)
class Hardware:
    """A truth that behaves like hardware.

    Parameters
    ----------
    opening, closing : float or array_like, shape (m,)
        Travel time of a rising and of a falling edge [s], after the dead time. An edge that would arrive no later than
        the one before it swallows that one.
    stuck : sequence of Stuck
        Faults of the actuators.
    quantum : float or array_like, shape (measured,)
        Step of the sensor [unit of what is measured]; 0: none.
    low, high : float or array_like, shape (measured,)
        Range of the sensor; beyond it, the end of the range is read.
    process_noise : float or array_like, shape (n,)
        Standard deviation that white noise gathers in each state in one second [unit of x / sqrt(s)].
    drift : Plant, optional
        The plant at the end of the run; its matrices and offsets are reached linearly, in 100 steps.
    missing : float
        Share of samples that are lost, 0 to 1.
    late : float
        Longest time a sample is under way [s], each one's own between 0 and this, rounded up to whole periods: a sample
        that misses its decision waits for the next. The controller is given the newest sample that came in during the
        last period, and NaN if there was none, as before the first has come.
    outages : sequence of (start, end)
        Times without any sample [s].
    """

    opening: ArrayLike = 0.0
    closing: ArrayLike = 0.0
    stuck: Sequence[Stuck] = ()
    quantum: ArrayLike = 0.0
    low: ArrayLike = -np.inf
    high: ArrayLike = np.inf
    process_noise: ArrayLike = 0.0
    drift: Plant | None = None
    missing: float = 0.0
    late: float = 0.0
    outages: Sequence[tuple[float, float]] = ()

    def __post_init__(self) -> None:
        for name in ("opening", "closing", "quantum", "process_noise"):
            if (check.array(name, getattr(self, name)) < 0).any():
                raise Mistake(name, getattr(self, name), "it must be at least 0")
        low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        if low.shape != high.shape and low.ndim > 0 and high.ndim > 0:
            raise Mistake("low", self.low, "they must agree", problem=f"has shape {low.shape} and high {high.shape}")
        if not (low < high).all():
            problem = f"is {shown(self.low)} and high {shown(self.high)}"
            raise Mistake("low", self.low, "low must be smaller", problem=problem)
        if not 0.0 <= check.number("missing", self.missing) <= 1.0:
            raise Mistake("missing", self.missing, "it must lie between 0 and 1")
        check.number("late", self.late, least=0.0)
        for window in self.outages:
            if np.shape(window) != (2,) or not window[0] < window[1]:
                problem = f"holds {shown(window)}"
                raise Mistake("outages", window, "give (start, end) pairs, start before end", problem=problem)
        if not isinstance(self.stuck, Sequence) or not all(isinstance(fault, Stuck) for fault in self.stuck):
            raise Mistake("stuck", self.stuck, "give Stuck objects in a list")
        if self.drift is not None and not isinstance(self.drift, Plant):
            problem = f"is a {type(self.drift).__name__}"
            raise Mistake("drift", self.drift, "give the Plant at the end of the run", problem=problem)

    @property
    def acts(self) -> bool:
        """Whether it changes anything but the sensor."""
        travel = np.any(np.asarray(self.opening)) or np.any(np.asarray(self.closing))
        return bool(travel or self.stuck or np.any(np.asarray(self.process_noise)) or self.drift is not None)


#: A period that no run reaches.
NEVER = 2**63


def period(t: float, Ts: float) -> int:
    """The first period that starts at t or later."""
    return min(check.periods(t, Ts), NEVER) if t / Ts < NEVER else NEVER


def stuck_periods(stuck: Sequence[Stuck], Ts: float, inputs: int) -> tuple[tuple[int, float, int, int], ...]:
    """Faults as (input, level, from, to), in periods.

    Raises
    ------
    ValueError
        If there is no such input.
    """
    for fault in stuck:
        if fault.input >= inputs:
            raise Mistake("stuck", fault.input, f"give 0 to {inputs - 1}", problem=f"names input {fault.input}")
    return tuple((int(f.input), float(f.level), period(f.start, Ts), period(f.end, Ts)) for f in stuck)


def sensor_range(what: Hardware, measured: int) -> tuple[Array, Array]:
    """Lowest and highest reading of each measured value.

    Raises
    ------
    ValueError
        If the shape does not fit.
    """
    limits = [np.asarray(value, dtype=np.float64) for value in (what.low, what.high)]
    for name, value in zip(("low", "high"), limits, strict=True):
        if value.shape not in ((), (measured,)):
            remedy = f"give one number or one per measured value ({measured})"
            raise Mistake(name, value, remedy, problem=f"has shape {value.shape}")
    low, high = (np.broadcast_to(value, (measured,)).copy() for value in limits)
    return low, high


@dataclass(frozen=True)
class Segments:
    """A period cut at every instant at which an input may change."""

    edges: Array  # (segments + 1,) s from the period's start
    rise: np.ndarray  # (m,) segments from a command to its effect
    fall: np.ndarray

    @property
    def count(self) -> int:
        """Segments per period."""
        return len(self.edges) - 1


def segments(delay: Array, opening: Array, closing: Array, Ts: float) -> Segments:
    """The cuts that dead times and travel times make."""
    m = len(delay)
    effect = np.concatenate([delay + opening, delay + closing]) / Ts
    whole = np.floor(effect + SAME_INSTANT)
    phase = np.maximum(effect - whole, 0.0)
    cuts = np.unique(np.append(phase, 0.0))
    cuts = cuts[np.append(True, np.diff(cuts) > SAME_INSTANT)]
    index = np.array([int(np.argmin(np.abs(cuts - p))) for p in phase])
    ticks = (whole * len(cuts) + index).astype(np.uint32)
    return Segments(np.append(cuts, 1.0) * Ts, ticks[:m], ticks[m:])


def segment_models(plant: Plant, edges: Array) -> tuple[Array, Array, Array, Array]:
    """Per segment: transition (n, n), input (m, n), disturbance (n, p), drift (n,)."""
    m, lengths = plant.inputs, np.diff(edges)
    steps = [transition(plant.A, np.hstack([plant.B, plant.E]), length) for length in lengths]
    phi = np.array([step[0] for step in steps])
    gamma = np.array([step[1][:, :m].T for step in steps])
    disturbance = np.array([step[1][:, m:] for step in steps])
    return phi, gamma, disturbance, np.array([-(plant.u_offset @ g) for g in gamma])


def between(start: Plant, end: Plant, share: float) -> Plant:
    """The plant a share of the way from start to end.

    Raises
    ------
    ValueError
        If the two are of different sizes.
    """
    names = ("A", "B", "C", "E", "u_offset", "y_offset")
    if not np.array_equal(start.input_delay, end.input_delay):
        problem = f"has input_delay {shown(end.input_delay)}"
        raise Mistake("drift", end, "a dead time cannot drift, keep it", problem=problem)
    for name in names:
        if getattr(start, name).shape != getattr(end, name).shape:
            problem = f"has {name} of shape {getattr(end, name).shape}"
            raise Mistake("drift", end, f"the plant's has {getattr(start, name).shape}", problem=problem)
    return start.replace(**{name: (1.0 - share) * getattr(start, name) + share * getattr(end, name) for name in names})
