"""What a dead time or a gain other than the model's does: the same command acts over another window, or more.

A command differs from the middle of its input's levels by at most half their span; the middle itself is constant and
knows no dead time. So a wrong dead time weighs with ``0.5 span (1 + gain error)``, a wrong gain with the largest distance
of a level from the input's offset. A load acts at once and may change at any time: a period is cut into slices, each with a
load of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from foreswitch._helpers.check import Array
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import transition

__all__ = ["Errors", "Windows"]

#: A wrong dead time is tried at so many values on each side at least, and with an oscillation so closely [rad].
TRIED, CLOSELY = 2, 0.25
#: Slices of a period at least, for a load.
FEWEST = 4
#: What it does between two of them, as a share of what it does at the worse.
BETWEEN = 1.01


@dataclass(frozen=True)
class Errors:
    """What the certificate has to bear.

    Attributes
    ----------
    noise : ndarray
        Largest error of each measured value.
    delay, gain, load : ndarray, shape (m,)
        Largest error of each dead time [s], of each input's gain as a share of it, and what is added to it unmeasured.
    """

    noise: Array
    delay: Array
    gain: Array
    load: Array

    def share(self, factor: float) -> Errors:
        """So much of each."""
        return Errors(factor * self.noise, factor * self.delay, factor * self.gain, factor * self.load)


class Windows:
    """When the commands of each input act, relative to t_k: command i of input j over [i Ts + tau_j, (i + 1) Ts + tau_j].

    Parameters
    ----------
    plant : Plant
    levels : list of ndarray
        Of each input.
    Ts : float
        Switching period [s].
    """

    def __init__(self, plant: Plant, levels: list[Array], Ts: float) -> None:
        self.plant, self.Ts, self.tau = plant, Ts, plant.input_delay
        self.longest = float(self.tau.max())
        #: Largest distance of each input from the middle of its levels, and from its offset.
        self.half_span = np.array([0.5 * (v[-1] - v[0]) for v in levels])
        self.far = np.array([np.abs(v - o).max() for v, o in zip(levels, plant.u_offset, strict=True)])
        self._fastest = float(np.abs(plant.poles).max())
        self._turning = float(np.abs(plant.poles.imag).max())
        self._carried = lru_cache(maxsize=4096)(lambda t: expm(plant.A * t))
        self._held = lru_cache(maxsize=4096)(lambda j, t: transition(plant.A, plant.B[:, j : j + 1], t)[1][:, 0])

    def delay_errors(self, j: int, errors: Errors) -> Array:
        """Errors of dead time j to be tried, the true dead time being at least 0."""
        e = float(errors.delay[j])
        if e == 0:
            return np.zeros(1)
        tried = max(TRIED, int(np.ceil(min(self._turning * e, np.pi) / CLOSELY)))
        return np.unique(np.maximum(np.linspace(-e, e, 2 * tried + 1), -self.tau[j]))

    def tells_apart(self, errors: Errors) -> bool:
        """Whether wrong dead times are less than half a turn of any oscillation: by a whole one they would seem right."""
        return bool((self._turning * errors.delay <= np.pi).all())

    def weights(self, j: int, errors: Errors) -> tuple[float, float]:
        """Sizes of a command of input j for a wrong dead time, and for a wrong gain."""
        return float(BETWEEN * self.half_span[j] * (1.0 + errors.gain[j])), float(self.surplus(errors)[j])

    def surplus(self, errors: Errors) -> Array:
        """Largest part of each acting command that the law does not know of, (m,)."""
        return self.far * errors.gain

    def loaded(self, j: int, errors: Errors) -> float:
        """Size of a load on input j, for its slices."""
        return float(BETWEEN * errors.load[j] * (1.0 + errors.gain[j]))

    def slices(self, j: int, end: float) -> Array:
        """What a unit of load on input j does in each slice from 0 to an instant, seen there, (count, n)."""
        size = self.Ts / max(FEWEST, int(np.ceil(self._fastest * self.Ts / CLOSELY)))
        edges = np.append(np.arange(0.0, end - 1e-9 * size, size), end)
        shape = (len(edges) - 1, self.plant.states)
        return np.array([self.effect(j, a, b, end) for a, b in pairwise(edges)]).reshape(shape)

    def effect(self, j: int, start: float, end: float, at: float) -> Array:
        """What a unit of input j over [start, end] leaves in x at an instant, (n,); at an earlier one: as carried back."""
        if end <= start:
            return np.zeros(self.plant.states)
        # rounded, or no two are the same
        result: Array = self._carried(round(at - end, 15)) @ self._held(j, round(end - start, 15))
        return result

    def part(self, j: int, i: int, error: float, low: float, high: float, at: float) -> Array:
        """What command i, its dead time wrong by so much, does between two instants, seen at a third."""
        start = i * self.Ts + self.tau[j] + error
        return self.effect(j, max(start, low), min(start + self.Ts, high), at)

    def under_way(self, j: int, error: float) -> tuple[Array, Array]:
        """How wrongly the rest of each command issued before t_k is predicted, and that rest, newest first.

        Both (count, n), per unit, at t_k + max tau.
        """
        tau, T = float(self.tau[j]), self.longest
        count = int(np.ceil((tau + max(error, 0.0)) / self.Ts - 1e-9))
        rest = np.array([self.part(j, -i, error, 0.0, np.inf, T) for i in range(1, count + 1)])
        known = np.array([self.part(j, -i, 0.0, 0.0, np.inf, T) for i in range(1, count + 1)])
        shape = (count, self.plant.states)
        return (rest - known).reshape(shape), rest.reshape(shape)

    def misjudged(self, rows: Array, errors: Errors) -> Array:
        """Bound of ``rows xi``, xi as predicted, by the commands under way, (r,)."""
        total = np.zeros(len(rows))
        for j in range(self.plant.inputs):
            if errors.load[j] > 0:
                total += self.loaded(j, errors) * np.abs(self.slices(j, self.longest) @ rows.T).sum(axis=0)
            late, more = self.weights(j, errors)
            if errors.delay[j] == 0.0 and more == 0.0:
                continue
            sizes = []
            for error in self.delay_errors(j, errors):
                wrong, rest = self.under_way(j, error)
                sizes.append(late * np.abs(wrong @ rows.T).sum(axis=0) + more * np.abs(rest @ rows.T).sum(axis=0))
            total += np.max(sizes, axis=0)
        return total

    def in_a_period(self, j: int, error: float) -> tuple[Array, Array]:
        """What commands i = 0, -1, ... do wrongly between t_k and t_k+1, and what they do, both (count, n)."""
        count = int(np.ceil((float(self.tau[j]) + max(error, 0.0)) / self.Ts - 1e-9)) + 1
        true = np.array([self.part(j, -i, error, 0.0, self.Ts, self.Ts) for i in range(count)])
        known = np.array([self.part(j, -i, 0.0, 0.0, self.Ts, self.Ts) for i in range(count)])
        return true - known, true
