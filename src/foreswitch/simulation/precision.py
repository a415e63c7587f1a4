"""Both cores side by side: what single precision changes, seen before it is flashed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers.check import Array
from foreswitch._helpers.text import tree
from foreswitch.control.controller import Controller
from foreswitch.simulation.loop import Loop
from foreswitch.simulation.run import Run

__all__ = ["Precision", "compare_precision"]


@dataclass(frozen=True)
class Precision:
    """Where a float32 core decides otherwise than a float64 core.

    Attributes
    ----------
    single, double : Run
        The closed loop under either core.
    commands_differing : int
        Periods in which the two closed loops command different levels; after the first, they are two different runs.
    first : int or None
        The first such period.
    decisions : int
        Decisions compared on the same measurements, references and past commands: those of the float64 run.
    decisions_differing : ndarray, shape (D,)
        Periods in which these decisions differ.
    gaps : ndarray, shape (D,)
        There: what the float32 core's choice costs more, as a share of what choices are about: the difference between
        the best and the worst command, in the median over the run. Small ones are near-ties.
    """

    single: Run
    double: Run
    commands_differing: int
    first: int | None
    decisions: int
    decisions_differing: np.ndarray[Any, np.dtype[np.int64]]
    gaps: Array

    def __repr__(self) -> str:
        lines = [f"commands   {self.commands_differing} of {self.decisions} differ in closed loop"]
        lines += [f"first      period {self.first}"] if self.first is not None else []
        lines.append(f"decisions  {len(self.gaps)} of {self.decisions} differ on the same data")
        lines += [f"gap        at most {self.gaps.max():.2g} of what choices are about"] if len(self.gaps) else []
        return tree("Precision", lines)


def compare_precision(
    controller: Controller,
    reference: Callable[..., ArrayLike] | ArrayLike,
    duration: float,
    *,
    x0: ArrayLike | None = None,
    seed: int = 0,
    **simulation: Any,
) -> Precision:
    """Run a controller in float64 and in float32, and compare decision by decision.

    Parameters
    ----------
    controller : Controller
        Its ``real`` does not matter.
    reference, duration, x0, seed, **simulation
        As in `simulate`.

    Returns
    -------
    Precision

    Raises
    ------
    ValueError
        As `simulate`.
    """
    laws = {real: controller.replace(real=real) for real in ("float32", "float64")}
    loops = {real: Loop(law, reference, duration, **simulation) for real, law in laws.items()}
    runs = {real: loop.run(x0, seed) for real, loop in loops.items()}
    double, single = runs["float64"], runs["float32"]
    unlike = np.flatnonzero((double.u != single.u).any(axis=1))

    # replay: both cores are shown the states or outputs of the float64 run, and remember the float64 core's commands
    loop, law, other = loops["float64"], laws["float64"], laws["float32"]
    seen = double.x[:-1] if controller.estimator is None else double.y[:-1]
    shown = seen if loop.matrix is None else seen @ loop.matrix.T
    told = loop.told.reshape(loop.steps, law.evaluations, law.plant.outputs, law.order)
    differing, gaps, spreads = [], [], np.zeros(loop.steps)
    for k in range(loop.steps):
        w = double.w[k] if law.plant.disturbances else None
        exact = law.decide(shown[k], told[k], disturbance=w)
        spreads[k] = np.ptp(exact.costs[np.isfinite(exact.costs)])
        other.take_over(law)
        u = other.step(shown[k], told[k], disturbance=w)
        if (u != exact.u).any():
            chosen = np.flatnonzero((exact.candidates == u).all(axis=1))[0]
            differing.append(k)
            gaps.append(exact.costs[chosen] - exact.cost)
        law.step(shown[k], told[k], disturbance=w)
    # a decision between two commands is about nothing but its gap: only the other decisions tell whether that is small
    free = spreads[spreads > 0]  # of those that dwell leaves open
    about = float(np.median(free)) if free.size else 1.0
    return Precision(
        single, double, len(unlike), int(unlike[0]) if len(unlike) else None, loop.steps,
        np.array(differing, dtype=np.int64), np.array(gaps, dtype=np.float64) / about,
    )  # fmt: skip
