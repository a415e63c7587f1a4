"""Pulse tests: proposed for a wanted accuracy, and rehearsed on a simulated rig before the real one is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import ss2tf

from foreswitch import _check
from foreswitch._check import Array
from foreswitch._text import tree
from foreswitch.estimate import Estimate
from foreswitch.fitting import Problem, Trial
from foreswitch.hardware import Hardware
from foreswitch.plant import Plant
from foreswitch.record import Record
from foreswitch.response import Grid
from foreswitch.structure import Structure

__all__ = ["PulseTest", "propose_test"]

#: Time constants (of all that decays) between the end of a pulse and the next.
SETTLED = 4.0
#: Widths tried, from one period to this many time constants.
WIDTHS, WIDEST = 12, 3.0
#: Pulses of the pilot test that each width is judged by, and the fewest and most proposed.
PILOT, FEWEST, MOST = 8, 4, 10000


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
        Standard error that each parameter will have, by name; empty if the test was not proposed for a model.
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
            _check.number(name, getattr(self, name), above=0.0)
        _check.number("lead", self.lead, least=0.0)
        if self.width < self.Ts * (1.0 - 1e-9) or self.spacing < self.width + self.Ts * (1.0 - 1e-9):
            raise ValueError(
                f"width is {self.width:g} s and spacing {self.spacing:g} s; a pulse lasts at least Ts = {self.Ts:g} s "
                "and ends at least Ts before the next"
            )
        if not 1 <= self.number <= MOST or self.number != int(self.number):
            raise ValueError(f"number is {self.number}; give 1 to {MOST} pulses")
        if self.low == self.high:
            raise ValueError(f"low and high are both {self.low:g}; give two levels")

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.lead + self.number * self.spacing

    @property
    def t(self) -> Array:
        """Sampling instants [s]."""
        return self.Ts * np.arange(_check.periods(self.duration, self.Ts) + 1)

    @property
    def u(self) -> Array:
        """Command at each instant, held to the next."""
        since = np.mod(self.t - self.lead + 1e-9 * self.Ts, self.spacing)
        inside = (self.t >= self.lead - 1e-9 * self.Ts) & (since < self.width - 1e-6 * self.Ts)
        inside &= self.t < self.duration - 1e-9 * self.Ts
        return np.where(inside, self.high, self.low)

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
            ``opening``, ``closing``, ``quantum``, ``low`` and ``high`` are used.
        x0 : array_like, shape (n,), optional
            Initial state; default zero.
        seed : int, optional
            Of the noise.

        Returns
        -------
        Record

        Raises
        ------
        ValueError
            If the plant has several inputs or a shape does not fit.
        """
        if plant.inputs != 1:
            raise ValueError(f"plant has {plant.inputs} inputs; rehearse each input with a plant of that one")
        rig, q = hardware or Hardware(), plant.outputs
        deviation = _check.per("noise", noise, q, "output", least=0.0)
        start = np.zeros(plant.states) if x0 is None else _check.array("x0", x0, (plant.states,))
        t, u = self.t, self.u
        x = _travelled(plant, t, u, rig, start)
        y = x @ plant.C.T + plant.y_offset + deviation * np.random.default_rng(seed).standard_normal((t.size, q))
        quantum = _check.per("quantum", rig.quantum, q, "output")
        y = np.where(quantum > 0, np.round(y / np.where(quantum > 0, quantum, 1.0)) * quantum, y)
        y = np.clip(y, -np.inf if rig.low is None else rig.low, np.inf if rig.high is None else rig.high)
        return Record(t, u, y, input_names=plant.input_names, output_names=plant.output_names)

    def __repr__(self) -> str:
        lines = [
            f"pulses     {self.number} of {self.width:g} s, every {self.spacing:g} s, levels {self.low:g} and {self.high:g}",
            f"record     {self.duration:g} s, a sample every {self.Ts:g} s",
        ]
        lines += [f"{name:<9}  known to {error:.2g} after it" for name, error in (self.predicted or {}).items()]
        return tree("PulseTest", lines)


def _travelled(plant: Plant, t: Array, u: Array, rig: Hardware, start: Array) -> Array:
    """States at the samples when each edge takes its travel time; the first command has acted all along."""
    opening, closing = (float(_check.per(name, getattr(rig, name), 1, "input")[0]) for name in ("opening", "closing"))
    edges = np.flatnonzero(np.diff(u)) + 1
    arrival = t[edges] + np.where(np.diff(u)[edges - 1] > 0, opening, closing)
    if (np.diff(arrival) <= 0).any():
        raise ValueError(
            f"opening is {opening:g} and closing {closing:g}; a pulse or a pause is too short for an edge to arrive "
            "before the next, give longer ones"
        )
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
    levels: Sequence[float] = (0.0, 1.0),
    travel: float | None = None,
    longest: float | None = None,
) -> PulseTest:
    """The shortest pulse test that measures the dead time to a wanted standard error.

    The errors of a trial test follow from the sensitivities of the output to every parameter, offset and initial state
    (Cramer and Rao); they fall with the square root of the number of pulses.

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
    levels : (float, float)
        Between and in the pulses.
    travel : float, optional
        Range that the output may sweep, over one pulse of a plant that returns, over all of one that integrates.
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
        what the best one reaches.

    Examples
    --------
    >>> rough = Plant.integrator_lag(15000.0, 0.008, 0.004)
    >>> propose_test(rough, 1e-3, noise=2.0, delay_error=2e-4, travel=1000.0)
    """
    if plant.inputs != 1 or plant.outputs != 1:
        raise ValueError(f"plant has {plant.inputs} inputs and {plant.outputs} outputs; give a plant with one of each")
    Ts = _check.number("Ts", Ts, above=0.0)
    noise = _check.number("noise", noise, above=0.0)
    wanted = _check.number("delay_error", delay_error, above=0.0)
    if len(levels) != 2:
        raise ValueError(f"levels is {list(levels)}; give the level between the pulses and the one in them")
    low, high = (_check.number("levels", level) for level in levels)
    times = [1.0 / abs(pole.real) for pole in plant.poles if pole.real < -1e-9 * np.abs(plant.poles).max(initial=1e-300)]
    slowest = max([Ts, *times])
    rest = float(plant.input_delay[0]) + SETTLED * slowest
    reached: list[tuple[float, PulseTest]] = []
    for width in np.unique(np.round(np.geomspace(Ts, max(Ts, WIDEST * slowest), WIDTHS) / Ts)) * Ts:
        spacing = Ts * np.ceil((width + rest) / Ts)
        pilot = PulseTest(Ts, float(width), float(spacing), PILOT, float(spacing), low, high)
        swept, error = _sweep(plant, pilot), _errors(plant, pilot, noise)["delay"]
        number = int(np.ceil(max(FEWEST, PILOT * (error / wanted) ** 2)))
        integrates = bool((np.abs(plant.poles) < 1e-9 * np.abs(plant.poles).max(initial=1e-300)).any())
        most = MOST
        if travel is not None:
            most = int(travel / swept * PILOT) if integrates else MOST if swept <= travel else 0
        if longest is not None:
            most = min(most, int(longest / spacing) - 1)
        if min(number, most) >= FEWEST:
            test = PulseTest(Ts, float(width), float(spacing), min(number, most), float(spacing), low, high)
            reached.append((error * np.sqrt(PILOT / test.number), test))
    if not reached:
        raise ValueError(
            f"travel is {travel} and longest {longest}; not even {FEWEST} pulses fit, allow more or sample faster"
        )
    able = [test for error, test in reached if error <= wanted * (1.0 + 1e-9)]
    if not able:
        error, test = min(reached, key=lambda item: item[0])
        raise ValueError(
            f"delay_error is {wanted:g}; within travel = {travel} and longest = {longest} the best test, {test.number} "
            f"pulses of {test.width:g} s, reaches {error:.2g} s: allow more, or reduce the noise"
        )
    best = min(able, key=lambda test: test.duration)
    while True:  # the square-root law leaves out what offset and initial state cost a short record
        predicted = _errors(plant, best, noise)
        if predicted["delay"] <= wanted or best.number >= MOST:
            break
        best = _longer(best)
    return PulseTest(best.Ts, best.width, best.spacing, best.number, best.lead, low, high, predicted)


def _longer(test: PulseTest) -> PulseTest:
    number = min(MOST, test.number + max(1, test.number // 10))
    return PulseTest(test.Ts, test.width, test.spacing, number, test.lead, test.low, test.high)


def _sweep(plant: Plant, test: PulseTest) -> float:
    """Range of the output over the test."""
    y = test.rehearse(plant.replace(u_offset=test.low, y_offset=0.0)).y
    return float(np.ptp(y))


def _errors(plant: Plant, test: PulseTest, noise: float) -> dict[str, float]:
    """Standard error of each parameter after the test, for the plant's own structure."""
    record = test.rehearse(plant.replace(u_offset=test.low), noise=noise)
    structure, theta = _structure(plant)
    problem = Problem(record, [structure], [False], [0], float("inf"))
    estimate = Estimate(Trial(problem, np.r_[theta, plant.input_delay]))
    # the residuals of this one record scatter; the noise is known
    factor = noise / np.sqrt(estimate.variance(0))
    return {name: float(error * factor) for name, error in estimate.errors.items()}


def _structure(plant: Plant) -> tuple[Structure, Array]:
    """The chain that a plant is, and its parameters."""
    num, _ = ss2tf(plant.A, plant.B, plant.C, np.zeros((1, 1)))
    size = np.abs(num[0]).max()
    poles = plant.poles
    unit = np.abs(poles).max(initial=1e-300)
    zero, pairs = np.abs(poles) < 1e-9 * unit, poles[poles.imag > 1e-9 * unit]
    real = poles[(np.abs(poles.imag) <= 1e-9 * unit) & ~zero].real
    if (np.abs(num[0, :-1]) > 1e-9 * size).any() or (real > 0).any() or (pairs.real >= 0).any() or zero.sum() > 2:
        raise ValueError(
            "plant has zeros or unstable poles; give a rough model of integrators, lags and oscillating pairs"
        )
    theta = np.concatenate(
        [np.sort(np.log(-1.0 / real))[::-1], *([np.log(abs(p)), np.log(-p.real / abs(p))] for p in pairs)]
    )
    return Structure(int(zero.sum()), real.size, pairs.size), theta
