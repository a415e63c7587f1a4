"""The ideal response: the same plant and law with an input that takes any value."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.controller import Controller
from foreswitch.model.reference import sample
from foreswitch.simulation.loop import sampled

if TYPE_CHECKING:
    from foreswitch.certificate.error_dynamics import ErrorLoop

__all__ = ["Course", "ideal_run"]

#: Periods to settle, where no duration is given.
SETTLING = 2000


class Course:
    """A reference, how long it is followed, and from where; arguments as in `certify`."""

    def __init__(
        self,
        controller: Controller,
        reference: Callable[..., ArrayLike] | ArrayLike,
        duration: float | None = None,
        x0: ArrayLike | None = None,
        disturbance: ArrayLike | None = None,
    ) -> None:
        plant, Ts = controller.plant, controller.Ts
        if duration is None:
            duration = max(0.0, float(getattr(reference, "end", 0.0))) + SETTLING * Ts
        self.controller, self.reference = controller, reference
        self.duration = check.number("duration", duration, above=0.0)
        self.steps = check.periods(self.duration, Ts)
        self.t = np.arange(self.steps + 1) * Ts
        self.x0: Array = np.zeros(plant.states)
        if x0 is not None:
            self.x0 = check.array("x0", x0, (plant.states,), ndmin=1)
        self.disturbance = np.zeros((self.steps, plant.disturbances))
        if disturbance is not None:
            w = check.array("disturbance", disturbance)
            if w.ndim == 1 and plant.disturbances == 1 and w.size == self.steps:
                w = w[:, None]
            if (
                w.ndim > 2
                or w.shape[-1:] not in ((), (1,), (plant.disturbances,))
                or w.shape[:-1] not in ((), (self.steps,))
            ):
                remedy = (
                    f"give {plant.disturbances} value(s), or ({self.steps}, {plant.disturbances}), one row per period"
                )
                raise Mistake("disturbance", disturbance, remedy, problem=f"has shape {w.shape}")
            self.disturbance = np.broadcast_to(w, self.disturbance.shape)
        self.told = sampled(controller, reference, self.t[:-1]).reshape(self.steps, plant.outputs, -1)

    def faster(self, factor: float) -> Course:
        """The same reference, run through so many times as fast."""
        outputs, order = self.controller.plant.outputs, self.controller.order

        def run_through(t: Array) -> Array:
            return sample(self.reference, t * factor, outputs, order) * factor ** np.arange(order)

        w = self.disturbance[:1] if len(self.disturbance) else None
        return Course(self.controller, run_through, self.duration / factor, self.x0, None if w is None else w[0])

    def inputs(self, loop: ErrorLoop) -> Array:
        """The ideal input, (K, m)."""
        return ideal_run(loop, self)[1]


def ideal_run(loop: ErrorLoop, course: Course) -> tuple[Array, Array]:
    """Outputs (K+1, q) and inputs (K, m) of the ideal loop."""
    controller, plant, steps, told = course.controller, loop.plant, course.steps, course.told
    law, model, rows, rest = loop.law, controller.model, loop.law.rows, loop.law.rest
    w = np.zeros((steps, model.disturbance.shape[1]))  # loads, which stand behind it, are none
    w[:, : plant.disturbances] = course.disturbance
    # s without the state and the commands under way
    h = np.array([row[0] for row in rows.hold]).T
    outer = w @ rows.disturbance.T + rows.offset - np.einsum("kol,ol->ko", told, law.sliding.reference)
    if rest:
        tail = told[:, :, 0] @ rest.reference.T + w @ rest.disturbance.T + rest.offset
        hull = [v[0] for v in controller.levels], [v[-1] for v in controller.levels]
        outer = outer + np.clip(tail, *hull) @ (rows.total - h).T
    push = w @ model.disturbance.T + model.drift
    depth = max(model.delay)
    u = np.zeros((depth + steps, plant.inputs))
    u[:depth] = controller.issued[-depth:] if depth else u[:0]
    x = np.zeros((steps + 1, plant.states))
    x[0] = course.x0
    under_way = [(j, row) for j, row in enumerate(rows.pending) if len(row)]
    for k in range(steps):
        now = depth + k
        s = outer[k] + rows.state @ x[k]
        for j, row in under_way:
            s = s + u[now - len(row) : now, j][::-1] @ row
        u[now] = -loop.choice @ s
        x[k + 1] = model.transition @ x[k] + push[k]
        for j, lag in enumerate(model.delay):
            x[k + 1] += model.old[j] * u[now - lag, j]
            if lag:
                x[k + 1] += model.new[j] * u[now - lag + 1, j]
    return x @ plant.C.T + plant.y_offset, u[depth:]
