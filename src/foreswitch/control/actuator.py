"""What an actuator can do: levels, combinations of them, and how long each lasts at least."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown

__all__ = [
    "LONGEST_HOLD",
    "Actuator",
    "Indices",
    "dwell_periods",
    "input_levels",
    "level_indices",
    "safe_indices",
]

Indices = np.ndarray[Any, np.dtype[np.uint8]]


def input_levels(levels: Any, inputs: int) -> list[Array]:
    """Per input, its ascending levels."""
    nested = isinstance(levels, (list, tuple)) and any(np.ndim(item) > 0 for item in levels)
    given = list(levels) if nested or getattr(levels, "ndim", 1) > 1 else [levels]
    if len(given) != inputs:
        remedy = f"the plant has {inputs}, give one list for each"
        raise Mistake("levels", levels, remedy, problem=f"lists {len(given)} input(s)")
    result = []
    for j, item in enumerate(given):
        subject = f"levels of input {j + 1}"
        values = check.array("levels", item, subject=subject)
        if values.ndim != 1 or not 2 <= values.size <= 255:
            problem = f"have shape {values.shape}"
            raise Mistake("levels", item, "give 2 to 255 levels in a row", problem=problem, subject=subject)
        if (np.diff(values) <= 0).any():
            problem = f"are {shown(values)}"
            raise Mistake("levels", item, "they must ascend", problem=problem, subject=subject)
        result.append(values)
    return result


def level_indices(name: str, command: ArrayLike, levels: list[Array]) -> list[int]:
    """A command as level indices."""
    values = np.atleast_1d(check.array(name, command))
    if values.shape != (len(levels),):
        raise Mistake(name, np.asarray(command).tolist(), f"give one level for each of {len(levels)} input(s)")
    result = []
    for j, value in enumerate(values):
        hit = np.flatnonzero(levels[j] == value)
        if hit.size == 0:
            remedy = f"the levels of input {j + 1} are {shown(levels[j])}"
            raise Mistake(name, command, remedy, problem=f"holds {value:g}")
        result.append(int(hit[0]))
    return result


def safe_indices(safe_level: ArrayLike | None, levels: list[Array]) -> list[int]:
    """The declared safe levels, else per input the level nearest 0 (the lower of two)."""
    if safe_level is None:
        return [int(np.argmin(np.abs(values))) for values in levels]
    return level_indices("safe_level", safe_level, levels)


#: Periods that the core counts in 32 bits, and in 16.
LONGEST_DWELL, LONGEST_HOLD = 2**32 - 1, 2**16 - 1


def dwell_periods(
    levels: list[Array], safe: list[int], min_on: ArrayLike, min_off: ArrayLike, Ts: float
) -> tuple[list[list[int]], list[list[float]]]:
    """Shortest run at each level of each input, in periods and in seconds: off is the safe level, on any other."""
    on = check.per("min_on", min_on, len(levels), "input", least=0.0)
    off = check.per("min_off", min_off, len(levels), "input", least=0.0)
    for name, longest in (("min_on", float(on.max())), ("min_off", float(off.max()))):
        if longest / Ts > LONGEST_DWELL:
            remedy = f"it must be at most 2^32 - 1 periods of Ts = {Ts:g} s"
            raise Mistake(name, longest, remedy, problem=f"is {longest:g} s")
    seconds = [[float(off[j] if i == safe[j] else on[j]) for i in range(v.size)] for j, v in enumerate(levels)]
    return [[max(1, check.periods(s, Ts)) for s in row] for row in seconds], seconds


def allowed_commands(forbidden: Sequence[ArrayLike], levels: list[Array], safe: list[int]) -> Indices:
    """Level indices of the candidates, shape (p, m), in lexicographic order."""
    if isinstance(forbidden, str) or not isinstance(forbidden, (Sequence, np.ndarray)):
        raise Mistake("forbidden", forbidden, "give a list of commands")
    no = {tuple(level_indices("forbidden", command, levels)) for command in forbidden}
    count = int(np.prod([values.size for values in levels], dtype=np.float64))
    if count > 65535:
        remedy = "at most 65535 fit one decision, use fewer levels"
        raise Mistake("levels", count, remedy, problem=f"form {count} combinations")
    every = itertools.product(*(range(values.size) for values in levels))
    allowed = [combination for combination in every if combination not in no]
    if len(allowed) < 2:
        remedy = "at least two are needed for a choice"
        raise Mistake("forbidden", forbidden, remedy, problem=f"leaves {len(allowed)} command(s)")
    if tuple(safe) in no:
        level = [float(v[i]) for v, i in zip(levels, safe, strict=True)]
        problem = f"contains the safe level {level}"
        raise Mistake("forbidden", forbidden, "declare an allowed safe_level", problem=problem)
    return np.array(allowed, dtype=np.uint8)


@dataclass(frozen=True)
class Actuator:
    """All inputs together, in the words of the core.

    Attributes
    ----------
    levels : list of ndarray
        Of each input, ascending.
    safe : list of int
        Level index of each input.
    dwell, dwell_seconds : list of lists
        Shortest run at each level of each input, in periods and in seconds.
    switch_cost : ndarray, shape (m,)
    candidates : ndarray of uint8, shape (p, m)
        Level indices of the allowed commands, in lexicographic order.
    """

    levels: list[Array]
    safe: list[int]
    dwell: list[list[int]]
    dwell_seconds: list[list[float]]
    switch_cost: Array
    candidates: Indices

    @classmethod
    def build(
        cls,
        levels: Any,
        inputs: int,
        Ts: float,
        *,
        min_on: ArrayLike,
        min_off: ArrayLike,
        switch_cost: ArrayLike,
        forbidden: Sequence[ArrayLike],
        safe_level: ArrayLike | None,
    ) -> Actuator:
        """From the arguments of `Controller`."""
        each = input_levels(levels, inputs)
        safe = safe_indices(safe_level, each)
        dwell, seconds = dwell_periods(each, safe, min_on, min_off, Ts)
        price = check.per("switch_cost", switch_cost, inputs, "input", least=0.0)
        return cls(each, safe, dwell, seconds, price, allowed_commands(forbidden, each, safe))

    @property
    def safe_levels(self) -> Array:
        """The level in which each input counts as off, shape (m,)."""
        return np.array([values[i] for values, i in zip(self.levels, self.safe, strict=True)])

    def values(self, indices: Any) -> Array:
        """Commands (K, m) from their level indices."""
        return np.column_stack([values[indices[:, j]] for j, values in enumerate(self.levels)])


def level_products(pending: Sequence[Array], levels: Sequence[Array]) -> Array:
    """Effect of each pending command, looked up by its level: per input (pending, levels, rows), one after the other."""
    each = [w[:, None, :] * v[None, :, None] for w, v in zip(pending, levels, strict=True)]
    result: Array = np.concatenate([np.ravel(item) for item in each])
    return result
