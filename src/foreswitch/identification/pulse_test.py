"""Pulse tests: proposed for a wanted accuracy, and rehearsed on a simulated rig before the real one is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import ss2tf

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.csv import write_columns
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import tree
from foreswitch.identification.fitting import Problem, Trial
from foreswitch.identification.record import Record
from foreswitch.identification.response import Grid
from foreswitch.identification.statistics import Estimate
from foreswitch.identification.structures import Structure
from foreswitch.model.hardware import Hardware, sensor_range
from foreswitch.model.plant import Plant

__all__ = ["PulseTest", "propose_test"]

#: Slowest time constants between the end of a pulse and the next. Four would let the plant settle, and a test of an oven
#: would take three times as long for the same dead time.
REST = 1.0
#: Widths tried, from one period to this many slowest time constants.
WIDTHS, WIDEST = 12, 3.0
#: Quiet time before the pulses of an integrating plant, in shares of theirs: under regular pulses gain and drift look
#: alike, and only there does the drift show alone.
QUIET = 0.25
#: Pulses of the pilot test that each width is judged by, and the fewest and most proposed.
PILOT, FEWEST, MOST = 8, 4, 10000
#: Samples per pulse above which a test is not computed.
DENSE = 20000
#: A pole this near to zero, in units of the fastest, integrates.
ZERO = 1e-6


@dataclass(frozen=True)
class PulseTest:
    """A train of equal pulses on one input.

    Attributes
    ----------
    Ts : float
        Sampling interval of the record and resolution of the pulses [s].
    width, spacing : float
        Length of a pulse and time from one to the next [s].
    number : int
        Pulses.
    lead : float
        Quiet time before the first [s].
    low, high : float
        Levels between and in the pulses.
    predicted : dict
        Standard error that each parameter will have, by name; None if the test was not proposed for a model.
    """

    Ts: float
    width: float
    spacing: float
    number: int
    lead: float = 0.0
    low: float = 0.0
    high: float = 1.0
    predicted: dict[str, float] | None = None

    def __post_init__(self) -> None:
        for name in ("Ts", "width", "spacing"):
            check.number(name, getattr(self, name), above=0.0)
        check.number("lead", self.lead, least=0.0)
        if self.width < self.Ts * (1.0 - 1e-9) or self.spacing < self.width + self.Ts * (1.0 - 1e-9):
            remedy = f"a pulse lasts at least Ts = {self.Ts:g} s and ends at least Ts before the next"
            raise Mistake("width", self.width, remedy, problem=f"is {self.width:g} s and spacing {self.spacing:g} s")
        if not 1 <= check.number("number", self.number) <= MOST or self.number != int(self.number):
            raise Mistake("number", self.number, f"give 1 to {MOST} pulses")
        if check.number("low", self.low) == check.number("high", self.high):
            raise Mistake("low", self.low, "give two levels", problem=f"and high are both {self.low:g}")

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.lead + self.number * self.spacing

    @property
    def t(self) -> Array:
        """Sampling instants [s]."""
        return self.Ts * np.arange(check.periods(self.duration, self.Ts) + 1)

    @property
    def u(self) -> Array:
        """Command at each instant, held to the next. Every pulse begins at the first instant that is not too early."""
        u = np.full(self.t.size, self.low)
        last = max(1, round(self.width / self.Ts))
        for i in range(self.number):
            start = check.periods(self.lead + i * self.spacing, self.Ts)
            u[start : start + last] = self.high
        return u

    def to_csv(self, path: str | Path) -> None:
        """Write the commands as CSV, time and command, for the rig's logger.

        Parameters
        ----------
        path : path
        """
        write_columns(path, {"t": self.t, "u": self.u})

    def rehearse(
        self,
        plant: Plant,
        *,
        noise: ArrayLike = 0.0,
        hardware: Hardware | None = None,
        x0: ArrayLike | None = None,
        seed: int | None = 0,
    ) -> Record:
        """The record this test would give on a simulated rig.

        Parameters
        ----------
        plant : Plant
            The rig; one input.
        noise : float or array_like, shape (q,)
            Standard deviation of the measured outputs.
        hardware : Hardware, optional
            Travel times of the actuator, quantum and range of the sensor.
        x0 : array_like, shape (n,), optional
            Initial state. Default: at rest under ``low``, or zero if the plant integrates.
        seed : int, optional
            Of the noise.

        Returns
        -------
        Record

        Raises
        ------
        ValueError
            If the plant has several inputs, a shape does not fit, the actuator is too slow for the pulses, or
            ``hardware`` holds something else.
        """
        if plant.inputs != 1:
            remedy = "rehearse each input with a plant of that one"
            raise Mistake("plant", plant, remedy, problem=f"has {plant.inputs} inputs")
        rig, q = hardware or Hardware(), plant.outputs
        for name in ("stuck", "process_noise", "drift", "missing", "late", "outages"):
            if np.any(getattr(rig, name)):
                remedy = "a rehearsal knows opening, closing, quantum, low and high only"
                raise Mistake("hardware", hardware, remedy, problem=f"has {name}")
        deviation = check.per("noise", noise, q, "output", least=0.0)
        start = _rest(plant, self.low) if x0 is None else check.array("x0", x0, (plant.states,))
        t, u = self.t, self.u
        x = _travelled(plant, t, u, rig, start)
        y = x @ plant.C.T + plant.y_offset + deviation * np.random.default_rng(seed).standard_normal((t.size, q))
        quantum = check.per("quantum", rig.quantum, q, "output")
        y = np.where(quantum > 0, np.floor(y / np.where(quantum > 0, quantum, 1.0) + 0.5) * quantum, y)
        y = np.clip(y, *sensor_range(rig, q))
        return Record(t, u, y, input_names=plant.input_names, output_names=plant.output_names)

    def errors(self, plant: Plant, noise: float) -> dict[str, float]:
        """The standard errors that a fit of the plant's own structure to this test's record will have.

        They follow from the sensitivities of the output to every parameter, offset and initial state (Cramer and Rao),
        and of an integrating plant to its operating point.

        Parameters
        ----------
        plant : Plant
            One input, one output; integrators, lags and oscillating pairs.
        noise : float
            Standard deviation of the measurement.

        Returns
        -------
        dict
            By the names of `Fit.parameters`.

        Raises
        ------
        ValueError
            If the plant is of another kind.
        """
        return {name: error for name, (_, error) in _expected(self, plant, noise).items()}

    def __repr__(self) -> str:
        lines = [
            f"pulses     {self.number} of {self.width:g} s, every {self.spacing:g} s, levels {self.low:g} and {self.high:g}",
            f"record     {self.duration:g} s, a sample every {self.Ts:g} s",
        ]
        lines += [f"{name:<9}  to be known to {error:.2g}" for name, error in (self.predicted or {}).items()]
        return tree("PulseTest", lines)


def _integrates(plant: Plant) -> bool:
    size = np.abs(plant.poles)
    return bool((size <= ZERO * size.max()).any())


def _rest(plant: Plant, level: float) -> Array:
    """The state after a long time under a level; zero if there is none."""
    if _integrates(plant):
        return np.zeros(plant.states)
    result: Array = -np.linalg.solve(plant.A, plant.B[:, 0] * (level - plant.u_offset[0]))
    return result


def _travelled(plant: Plant, t: Array, u: Array, rig: Hardware, start: Array) -> Array:
    """States at the samples when each edge takes its travel time; the first command has acted all along."""
    opening, closing = (float(check.per(name, getattr(rig, name), 1, "input")[0]) for name in ("opening", "closing"))
    edges = np.flatnonzero(np.diff(u)) + 1
    arrival = t[edges] + np.where(np.diff(u)[edges - 1] > 0, opening, closing)
    if (np.diff(arrival) <= 0).any():
        remedy = "a pulse or a pause is too short for an edge to arrive before the next, give longer ones"
        raise Mistake("opening", opening, remedy, problem=f"is {opening:g} and closing {closing:g}")
    instants = np.union1d(t, arrival)
    level = np.r_[u[0], u[edges]][np.searchsorted(arrival, instants, side="right")]
    grid = Grid(instants, np.searchsorted(instants, t))
    b = np.ascontiguousarray(plant.B[:, 0])
    driven = grid.states(plant.A, b, level - u[0])
    late, _ = grid.delayed(plant.A, b, level - u[0], driven, float(plant.input_delay[0]))
    steady = np.full(instants.size, u[0] - float(plant.u_offset[0]))
    result: Array = late + grid.states(plant.A, b, steady, start)[grid.wanted]
    return result


def propose_test(
    plant: Plant,
    Ts: float,
    *,
    noise: float,
    delay_error: float,
    relative_error: float = 0.05,
    levels: Sequence[float] = (0.0, 1.0),
    travel: float | None = None,
    longest: float | None = None,
) -> PulseTest:
    """The shortest pulse test that measures a plant to wanted standard errors, see `PulseTest.errors`.

    Parameters
    ----------
    plant : Plant
        A rough model; one input, one output.
    Ts : float
        Sampling interval, and resolution of the pulse's width [s].
    noise : float
        Standard deviation of the measurement.
    delay_error : float
        Wanted standard error of the dead time [s].
    relative_error : float
        Wanted standard error of every other parameter, as a share of it.
    levels : (float, float)
        Between and in the pulses.
    travel : float, optional
        Range that the output may sweep during the test.
    longest : float, optional
        Longest record allowed [s].

    Returns
    -------
    PulseTest
        Its ``predicted`` holds the standard errors to expect.

    Raises
    ------
    ValueError
        If an argument is out of range, or no test within ``travel`` and ``longest`` gets there; the sentence says
        what the best one measures.

    Examples
    --------
    >>> rough = Plant.integrator_lag(15000.0, 0.008, 0.004)
    >>> propose_test(rough, 1e-3, noise=2.0, delay_error=2e-4, travel=1000.0)
    PulseTest
    ├─ pulses     4 of 0.005 s, every 0.017 s, levels 0 and 1
    ├─ record     0.085 s, a sample every 0.001 s
    ├─ c          to be known to 0.00029
    ├─ k          to be known to 4.5e+02
    └─ delay      to be known to 0.00015
    """
    Ts = check.number("Ts", Ts, above=0.0)
    noise = check.number("noise", noise, above=0.0)
    wanted = check.number("delay_error", delay_error, above=0.0)
    share = check.number("relative_error", relative_error, above=0.0)
    for name, limit in (("travel", travel), ("longest", longest)):
        if limit is not None:
            check.number(name, limit, above=0.0)
    if np.shape(levels) != (2,):
        raise Mistake("levels", levels, "give the level between the pulses and the one in them")
    low, high = (check.number("levels", level) for level in levels)
    limits = f"travel {travel or 'unlimited'} and longest {longest or 'unlimited'}"
    search = _Search(plant, Ts, noise, wanted, share, (low, high), travel, longest)
    best: tuple[float, PulseTest] | None = None
    for start in search.starts():
        score, test = search.grown(start)
        if score <= 1.0:
            return test
        if best is None or score < best[0]:
            best = score, test
    if best is None:
        name, limit = ("longest", longest) if travel is None else ("travel", travel)
        problem = f"{FEWEST} pulses fit into {limits}"
        raise Mistake(name, limit, "allow more, or sample faster", problem=problem, subject="not even")
    reached = ", ".join(f"{name} to {error:.2g}" for name, error in (best[1].predicted or {}).items())
    pulses = f"{best[1].number} pulses of {best[1].width:g} s"
    remedy = f"the best test within {limits}, {pulses}, measures {reached}: allow more, or reduce the noise"
    raise Mistake("delay_error", wanted, remedy, problem=f"is {wanted:g} s and relative_error {share:g}")


@dataclass(frozen=True)
class _Search:
    """Trial tests of one plant and what they would tell."""

    plant: Plant
    Ts: float
    noise: float
    delay_error: float
    relative_error: float
    levels: tuple[float, float]
    travel: float | None
    longest: float | None

    def test(self, width: float, number: int) -> PulseTest:
        delay = float(self.plant.input_delay[0])
        spacing = self.Ts * float(np.ceil((width + delay + REST * self.slowest) / self.Ts - 1e-9))
        quiet = max(1, int(np.ceil(QUIET * number))) if _integrates(self.plant) else 1
        return PulseTest(self.Ts, width, spacing, number, quiet * spacing, *self.levels)

    @property
    def slowest(self) -> float:
        """Time constant of all that decays [s]."""
        rates = np.abs(self.plant.poles[np.abs(self.plant.poles) > ZERO * np.abs(self.plant.poles).max()].real)
        return float(max([self.Ts, *(1.0 / rates)]))

    def starts(self) -> list[PulseTest]:
        """A test of each width, its number of pulses by the square-root law; those that promise most first."""
        delay = float(self.plant.input_delay[0])
        samples = (self.slowest + delay) / self.Ts
        if samples > DENSE:
            problem = f"is {self.Ts:g} s, of which one pulse of this plant would take {samples:.0f}"
            remedy = "give a longer Ts, and the average of the samples in it, whose noise is smaller"
            raise Mistake("Ts", self.Ts, remedy, problem=problem)
        widest = WIDEST * max(self.slowest, delay, 10.0 * self.Ts)
        found = []
        for width in np.unique(np.round(np.geomspace(self.Ts, widest, WIDTHS) / self.Ts)) * self.Ts:
            pilot = self.test(float(width), PILOT)
            score, _ = self.judged(pilot)
            test = self.limited(pilot, int(np.ceil(min(max(FEWEST, PILOT * score**2), MOST))))
            if test is not None:
                found.append((max(score * np.sqrt(PILOT / test.number), 1.001), test.duration, test))
        return [test for *_, test in sorted(found, key=lambda item: item[:2])]

    def limited(self, like: PulseTest, number: int) -> PulseTest | None:
        """A test of so many pulses, or of as many as travel and longest allow; None if they are too few."""
        while number >= FEWEST:
            test = self.test(like.width, number)
            over = 1.0
            if self.longest is not None:
                over = test.duration / self.longest
            if self.travel is not None and over <= 1.0 + 1e-9:
                over = float(np.ptp(test.rehearse(self.plant).y)) / self.travel
            if over <= 1.0 + 1e-9:
                return test
            number = FEWEST if FEWEST < number < FEWEST * over else min(number - 1, int(number / over))
        return None

    def grown(self, test: PulseTest) -> tuple[float, PulseTest]:
        """With as many more pulses as the law left out: offset and initial state cost a short record more."""
        while True:
            score, predicted = self.judged(test)
            longer = self.limited(test, min(MOST, test.number + max(1, test.number // 10)))
            if score <= 1.0 or longer is None or longer.number <= test.number:
                return score, replace(test, predicted=predicted)
            test = longer

    def judged(self, test: PulseTest) -> tuple[float, dict[str, float]]:
        """The largest standard error in units of what is wanted, and all of them by name."""
        expected = _expected(test, self.plant, self.noise)
        wanted = {name: self.relative_error * abs(value) for name, (value, _) in expected.items()}
        wanted["delay"] = self.delay_error
        errors = {name: error for name, (_, error) in expected.items()}
        return max(errors[name] / wanted[name] for name in errors), errors


def _expected(test: PulseTest, plant: Plant, noise: float) -> dict[str, tuple[float, float]]:
    """Value and standard error of each parameter."""
    structure, theta = _structure(plant)
    noise = check.number("noise", noise, above=0.0)
    record = test.rehearse(plant, noise=noise)
    problem = Problem(record, [structure], [_integrates(plant)], [0], float("inf"))
    estimate = Estimate(Trial(problem, np.r_[theta, plant.input_delay]))
    # the residuals of this one record scatter; the noise is known
    factor = noise / np.sqrt(estimate.variance(0))
    return {name: (float(estimate.values[name]), float(error * factor)) for name, error in estimate.errors.items()}


def _structure(plant: Plant) -> tuple[Structure, Array]:
    """The chain that a plant is, and its parameters."""
    if plant.inputs != 1 or plant.outputs != 1:
        problem = f"has {plant.inputs} inputs and {plant.outputs} outputs"
        raise Mistake("plant", plant, "give a plant with one of each", problem=problem)
    num, _ = ss2tf(plant.A, plant.B, plant.C, np.zeros((1, 1)))
    size = np.abs(num[0]).max()
    poles = plant.poles
    unit = np.abs(poles).max(initial=1e-300)
    zero, pairs = np.abs(poles) < ZERO * unit, poles[poles.imag > ZERO * unit]
    real = poles[(np.abs(poles.imag) <= ZERO * unit) & ~zero].real
    if (np.abs(num[0, :-1]) > 1e-9 * size).any() or (real > 0).any() or (pairs.real >= 0).any() or zero.sum() > 2:
        remedy = "give a rough model of integrators, lags and oscillating pairs"
        raise Mistake("plant", plant, remedy, problem="has zeros or unstable poles")
    theta = np.concatenate(
        [np.sort(np.log(-1.0 / real))[::-1], *([np.log(abs(p)), np.log(-p.real / abs(p))] for p in pairs)]
    )
    return Structure(int(zero.sum()), real.size, pairs.size), theta
