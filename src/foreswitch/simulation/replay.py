"""What the controller knew, and foresaw, at one step of a run."""

from __future__ import annotations

from typing import Any

import numpy as np

from foreswitch._binding import CORES
from foreswitch._helpers.check import Array
from foreswitch.control.controller import Controller
from foreswitch.control.decision import Decision
from foreswitch.control.objective import Endpoint
from foreswitch.model import prediction
from foreswitch.simulation.loop import Loop
from foreswitch.simulation.run import Run

__all__ = ["Moment", "moment"]


class Moment:
    """One step of a run, before its command is issued.

    Parameters
    ----------
    loop : Loop
        The run's.
    run : Run
        From the same initial state and seed.
    seed : int
    k : int
        The step.

    Attributes
    ----------
    decision : Decision
        Of the controller as it was then, told and measuring what it was then.
    x, w : ndarray
        State and disturbances, loads included, that it rests on; NaN where there was no measurement yet.
    reference : ndarray, shape (evaluations, q, order)
        What it was told.
    """

    def __init__(self, loop: Loop, run: Run, seed: int, k: int) -> None:
        self.loop, self.run, self.k = loop, run, k
        self.controller: Controller = _memory(loop, run, seed, k)
        law = self.controller
        self.reference = loop.told[k].reshape(law.evaluations, law.plant.outputs, law.order)
        measured = _heard(loop, run, seed, k)
        disturbance = run.w[k] if law.plant.disturbances else None
        self.decision: Decision = law.decide(measured, self.reference, disturbance=disturbance)
        after = law.copy()
        after.step(measured, self.reference, disturbance=disturbance)
        self.x, loads = after.estimate
        self.w = np.concatenate([run.w[k][: law.plant.disturbances], loads])

    @property
    def landing_time(self) -> float:
        """When the candidates are compared [s]."""
        law, objective = self.controller, self.controller.objective
        reach = objective.Td if isinstance(objective, Endpoint) else objective.steps * law.Ts
        return float(self.run.t[self.k] + law.plant.input_delay.max() + reach)

    def landing(self) -> Array | None:
        """Outputs predicted for then, a row per candidate, NaN where a dwell forbids it; None for a horizon.

        The sum of docs/theory/theory.md [4] for the output itself in place of the sliding variable.
        """
        law = self.controller
        if not isinstance(law.objective, Endpoint) or not np.isfinite(self.x).all():
            return None
        plant, actuator, q = law.predicted, law.actuator, law.plant.outputs
        output = prediction.sliding(plant, np.ones(q), [1] * q)
        longest = [max(row) for row in actuator.dwell]
        rows = prediction.endpoint_rows(plant, output, law.Ts, law.objective.Td, longest)
        tail = np.zeros(law.plant.inputs)
        if law.objective.tail == "rest":
            rest = prediction.rest(plant)
            tail = rest.reference @ self.reference[0, :, 0] + rest.disturbance @ self.w + rest.offset
            tail = np.clip(tail, [v[0] for v in law.levels], [v[-1] for v in law.levels])
        issued = law.issued  # oldest first
        y = rows.state @ self.x + rows.disturbance @ self.w + rows.offset + rows.total @ tail
        for j, effects in enumerate(rows.pending):
            y = y + sum((row * issued[-1 - i, j] for i, row in enumerate(effects)), np.zeros(q))
        keep = self._left()
        result = np.empty((len(actuator.candidates), q))
        for c, command in enumerate(actuator.candidates):
            result[c] = y
            for j, level in enumerate(command):
                value = law.levels[j][level]
                hold = keep[j] if value == issued[-1, j] else actuator.dwell[j][level]
                result[c] += rows.hold[j][min(hold, len(rows.hold[j])) - 1] * (value - tail[j])
        result[~np.isfinite(self.decision.costs)] = np.nan
        return result

    def _left(self) -> list[int]:
        """Per input, the periods that its level must still be kept, at least 1."""
        u, left = np.vstack([self.loop.past, self.run.u[: self.k]]), []
        for j, values in enumerate(self.controller.levels):
            changes = np.flatnonzero(np.diff(u[:, j]))
            dwell = self.controller.actuator.dwell[j][int(np.searchsorted(values, u[-1, j]))]
            age = len(u) - 1 - changes[-1] if changes.size else dwell
            left.append(max(1, int(dwell - age)))
        return left


def moment(loop: Loop, x0: Any, seed: int, k: int) -> Moment:
    """Step k of a loop's run.

    Parameters
    ----------
    loop : Loop
    x0 : array_like or None
        Initial state.
    seed : int
    k : int

    Returns
    -------
    Moment
    """
    return Moment(loop, loop.run(x0, seed), seed, k)


def _memory(loop: Loop, run: Run, seed: int, k: int) -> Controller:
    """The controller after k steps of the run."""
    law: Controller = loop.controller.copy()
    steps, (_, n), (_, q), m = loop.steps, run.x.shape, run.y.shape, run.u.shape[1]
    u = np.vstack([loop.past, np.zeros((steps, m))])
    x, y = np.zeros((steps + 1, n)), np.zeros((steps + 1, q))
    x[0] = run.x[0]
    cost, nodes, status = np.zeros(steps), np.zeros(steps, dtype=np.uint32), np.zeros(steps, dtype=np.uint8)
    tables = {"reference": loop.told, "w": run.w, "load": loop.extra, "x": x, "y": y, "u": u, "cost": cost,
              "nodes": nodes, "status": status, "estimate": None}  # fmt: skip
    CORES[law.real].run(law.core, loop.body(), loop.sensor, seed, steps, len(loop.past), tables, 0, k)
    return law


def _heard(loop: Loop, run: Run, seed: int, k: int) -> Array:
    """What the controller was given at step k, NaN where the sample was lost: the sensor's doing, seed and step alone."""
    law: Any = loop.controller
    seen = run.x if law.estimator is None else run.y
    if loop.sensor is None:
        return np.array(seen[k])
    heard = np.empty(law.measured[0])
    loop.sensor.read(seed, k, np.ascontiguousarray(seen[: k + 1]), heard)
    return heard
