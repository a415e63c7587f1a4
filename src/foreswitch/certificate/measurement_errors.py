"""How far errors of measurement and model move the unquantised choice, with the state measured or estimated."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.certificate.peak_gain import Recursion

if TYPE_CHECKING:
    from foreswitch.certificate.error_dynamics import ErrorLoop
    from foreswitch.certificate.model_errors import Errors

__all__ = ["choice_error", "innovation_reach", "passes_gate", "starts_at"]

#: A first estimate may be wrong by what moves the choice by this share of the levels' span.
SAME = 1e-9


def choice_error(loop: ErrorLoop, errors: Errors) -> Array:
    """Bound of the error of ``metric u``, (rank,), u being the unquantised choice, that comes from the measurement."""
    state: Array = -loop.metric @ loop.choice @ loop.law.rows.state
    if loop.controller.kalman is None:
        direct: Array = np.abs(state) @ errors.noise
        return direct
    result = np.zeros(loop.rank)
    for rows in _with_loads(loop, state):
        result = np.maximum(result, _estimation_error(loop, rows, errors))
    return result


def innovation_reach(loop: ErrorLoop, errors: Errors) -> Array:
    """Bound of the estimator's innovation, (q,), which its gate must let pass."""
    A, C, _ = _estimator(loop)
    total = _estimation_error(loop, C @ A, errors) + errors.noise
    for j in range(loop.plant.inputs):
        sizes = []
        late, more = loop.windows.weights(j, errors)
        for error in loop.windows.delay_errors(j, errors):
            wrong, true = (part @ loop.plant.C.T for part in loop.windows.in_a_period(j, error))
            sizes.append(late * np.abs(wrong).sum(axis=0) + more * np.abs(true).sum(axis=0))
        total = total + np.max(sizes, axis=0)
        if errors.load[j] > 0:
            pieces = loop.windows.slices(j, loop.Ts) @ loop.plant.C.T
            total = total + loop.windows.loaded(j, errors) * np.abs(pieces).sum(axis=0)
    return total


def passes_gate(loop: ErrorLoop, errors: Errors) -> bool:
    """Whether no innovation counts as an outlier; without an estimator there are none."""
    kalman = loop.controller.kalman
    if kalman is None or kalman.gate is None:
        return True
    reach = innovation_reach(loop, errors)
    return bool(reach @ np.abs(kalman.gate) @ reach <= 1.0)


def starts_at(loop: ErrorLoop, x0: Array) -> bool:
    """Whether the first estimate, noise aside, is the plant's state; without an estimator it is."""
    controller, plant = loop.controller, loop.plant
    kalman, model = controller.kalman, controller.model
    if kalman is None:
        return True
    wrong, w = np.zeros(plant.states + kalman.loads), np.zeros(model.disturbance.shape[1])
    wrong[: plant.states] = kalman.start_row @ (plant.C @ x0 + plant.y_offset) + kalman.start_offset - x0
    known = np.zeros(plant.states)
    if controller.core.estimate(known, w):  # of the period before
        issued = controller.issued
        wrong[: plant.states] = model.transition @ known + model.disturbance @ w + model.drift - x0
        for j, age in enumerate(model.delay):
            wrong[: plant.states] += model.old[j] * issued[-age - 1, j]
            if age:
                wrong[: plant.states] += model.new[j] * issued[-age, j]
        wrong[plant.states :] = w[plant.disturbances :]
    A, _, keep = _estimator(loop)
    recursion = Recursion(keep @ A)
    reach = max(
        float((recursion.sums(rows, wrong[:, None])[:, 0] / (np.abs(loop.metric) @ loop.windows.half_span)).max())
        for rows in _with_loads(loop, -loop.metric @ loop.choice @ loop.law.rows.state)
    )
    return reach <= SAME


def _with_loads(loop: ErrorLoop, state: Array) -> list[Array]:
    """Rows over state and loads. The tail follows the loads until it meets the end of the levels: all such cases."""
    law, kalman, p = loop.law, loop.controller.kalman, loop.plant.disturbances
    assert kalman is not None
    pull = -loop.metric @ loop.choice
    of_load = law.rows.disturbance[:, p:]
    if kalman.loads == 0 or law.rest is None:
        return [np.hstack([state, pull @ of_load])]
    h = np.array([row[0] for row in law.rows.hold]).T
    after = law.rows.total - h
    tail = law.rest.disturbance[:, p:]
    corners = product((0.0, 1.0), repeat=loop.plant.inputs)
    return [np.hstack([state, pull @ (of_load + (after * corner) @ tail)]) for corner in corners]


def _estimator(loop: ErrorLoop) -> tuple[Array, Array, Array]:
    """State and loads over one period, their output, and the share of an error that a correction leaves."""
    controller, plant = loop.controller, loop.plant
    kalman = controller.kalman
    assert kalman is not None
    n, loads = plant.states, kalman.loads
    A = np.eye(n + loads)
    A[:n, :n], A[:n, n:] = controller.model.transition, controller.model.disturbance[:, plant.disturbances :]
    C = np.hstack([plant.C, np.zeros((plant.outputs, loads))])
    return A, C, np.eye(n + loads) - kalman.gain @ C


def _estimation_error(loop: ErrorLoop, rows: Array, errors: Errors) -> Array:
    """Bound of ``rows (estimation error)``, which needs no control: it decays, driven by noise and model errors."""
    kalman, plant = loop.controller.kalman, loop.plant
    assert kalman is not None
    A, _, keep = _estimator(loop)
    recursion = Recursion(keep @ A)
    first = np.vstack([kalman.start_row, np.zeros((kalman.loads, plant.outputs))])
    total: Array = recursion.sums(rows, kalman.gain) @ errors.noise
    total = total + np.abs(recursion.terms(rows, first, recursion.steps)).max(axis=0) @ errors.noise
    for j in range(plant.inputs):
        late, more = loop.windows.weights(j, errors)
        sizes = []
        for error in loop.windows.delay_errors(j, errors):
            wrong, true = loop.windows.in_a_period(j, error)
            sizes.append(
                late * _driven(recursion, rows, wrong, keep, plant.states)
                + more * _driven(recursion, rows, true, keep, plant.states)
            )
        total = total + np.max(sizes, axis=0)
        if errors.load[j] > 0:
            pieces = keep[:, : plant.states] @ loop.windows.slices(j, loop.Ts).T
            total = total + loop.windows.loaded(j, errors) * recursion.sums(rows, pieces).sum(axis=1)
    return total


def _driven(recursion: Recursion, rows: Array, pushes: Array, keep: Array, states: int) -> Array:
    """Peak gain to each row of an input that pushes the state for several periods in a row, (r,)."""
    total, moved = np.zeros(len(rows)), np.zeros(len(keep))
    for push in pushes:
        total += np.abs(rows @ moved)  # of the sum so far; the last one is summed to the end
        moved = recursion.matrix @ moved + keep[:, :states] @ push
    result: Array = total + recursion.sums(rows, moved[:, None])[:, 0]
    return result
