"""Golden steps: a controller in closed loop with its own model, recorded for replay elsewhere."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreswitch._binding import REALS
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.controller import Controller

__all__ = ["Golden", "golden_steps"]

MOST, LEAST = 256, 32
#: Numbers told to the controller in all, about: more steps where each needs few.
NUMBERS = 4096
#: Each part has its own reference, from where the plant is; an unstable one starts anew.
PARTS = 4
#: Most periods for which a command behind a reference is held.
HELD = 8
#: Finite, so that any compiler can read it, and beyond what the core takes for a measurement.
UNUSABLE = {"float32": 3e38, "float64": 1e300}
#: States beyond it begin anew, so that squares stay finite: what is unstable may run away from any controller.
AWAY = {"float32": 1e10, "float64": 1e60}


@dataclass
class Golden:
    """What the controller was told and what it did, row by row, in its own arithmetic.

    Attributes
    ----------
    measured, reference, disturbance : ndarray
        (K, z), (K, evaluations * q * order), (K, p).
    command : ndarray, shape (K, m)
        Level indices.
    status : ndarray, shape (K,)
    cost : ndarray, shape (K,)
        Zero where none was computed.
    nodes : ndarray, shape (K,)
        Candidates or partial sequences evaluated.
    state, disturbances : ndarray, shape (n,) and (p + l,)
        What the core holds after the last step.
    """

    measured: Any
    reference: Any
    disturbance: Any
    command: Any
    status: Any
    cost: Any
    nodes: Any
    state: Any
    disturbances: Any

    def __len__(self) -> int:
        return len(self.status)


def golden_steps(controller: Controller) -> Golden:
    """Record a closed loop of a controller's design, from its start; the controller itself is left alone.

    The reference is what the model does under commands drawn at random, so that it is within reach of any plant. Measured
    values carry a little noise; some are unusable, as are a reference and a disturbance, so that every status occurs that
    the design knows.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the design, which has been made once
        law = controller.replace()
    plant, real, p = law.plant, REALS[law.real], law.plant.disturbances
    width = law.evaluations * plant.outputs * law.order
    length = int(np.clip(NUMBERS // (width + law.measured[0]), LEAST, MOST)) // PARTS
    steps, huge = PARTS * length, UNUSABLE[law.real]
    rows: list[tuple[Any, ...]] = []
    x, unstable = np.zeros(plant.states), abs(np.linalg.eigvals(law.model.transition)).max() > 1.0 + 1e-9
    for k in range(steps):
        part, at = divmod(k, length)
        if (at == 0 and unstable) or np.abs(x).max() > AWAY[law.real]:
            x = np.zeros(plant.states)
        if at == 0:
            wanted = _course(law, x, length, part)
        w = 0.01 * _noise(k, p)
        shown = x if law.estimator is None else plant.C @ x + plant.y_offset
        shown = (shown * (1.0 + 1e-3 * _noise(k, shown.size))).astype(real)
        reference, told = wanted[at].astype(real), w.astype(real)
        if _bad(k, steps, law.design.bad_limit):
            shown[:] = huge
        if k == steps // 3:
            reference.flat[0] = huge
        if p and k in (steps // 5, steps // 5 + 1):
            told[0] = huge
        given = shown.astype(float), reference.astype(float)
        options = {"disturbance": told.astype(float)} if p else {}
        decision = law.decide(*given, **options)
        law.step(*given, **options)
        rows.append(
            (shown, reference.ravel(), told, law.memory.line[-1], law.status, real(decision.cost), decision.nodes)
        )
        x = _advance(law, x, w)
    last = law.memory
    names = ("measured", "reference", "disturbance", "command", "status", "cost", "nodes")
    if not np.isfinite([row[5] for row in rows]).all():
        problem = f"is {law.real!r}, in which costs overflow"
        raise Mistake("real", law.real, "choose smaller weights", problem=problem)
    columns = {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
    assert last.x is not None, "most samples are usable"
    assert last.w is not None
    return Golden(**columns, state=last.x.astype(real), disturbances=last.w.astype(real))


def _bad(k: int, steps: int, limit: int) -> bool:
    """Unusable samples: the first, a few in a row, and if the design has a limit as many as it takes."""
    run = min(limit + 2, steps // 4) if limit else 3
    return k == 0 or 0 <= k - steps // 2 < run


def _noise(k: int, count: int) -> Any:
    """Numbers in [-1, 1), the same with every library."""
    seeds = (k * 64 + np.arange(count) + 1) * 2654435761 % 2**32
    return seeds / 2.0**31 - 1.0


def _advance(law: Controller, x: Any, w: Any) -> Any:
    """The model one period later; the newest command is in the line already."""
    model, history = law.model, law.issued
    result = model.transition @ x + model.disturbance[:, : w.size] @ w + model.drift
    for j, delay in enumerate(model.delay):
        result = result + model.old[j] * history[-1 - delay, j]
        if delay > 0:
            result = result + model.new[j] * history[-delay, j]
    return result


def _course(law: Controller, x: Any, length: int, part: int) -> Any:
    """References (length, evaluations, q, order) of one part: the outputs from x on under commands drawn at random."""
    plant, model = law.plant, law.model
    times = law.reference_times.reshape(law.evaluations, -1)  # (evaluations, 1 or q)
    ahead = np.broadcast_to(np.maximum(np.round(times / law.Ts), 0).astype(int), (law.evaluations, plant.outputs))
    commands = law.actuator.values(law.actuator.candidates)
    rows = [plant.C @ np.linalg.matrix_power(plant.A, i) for i in range(law.order)]
    course, left, draw = [], 0, 1000 * (part + 1)
    for _ in range(length + ahead.max()):
        if left == 0:
            held, chosen = _noise(draw, 2) * 0.5 + 0.5
            left, command = 1 + int(held * HELD), commands[int(chosen * len(commands))]
            draw += 1
        left -= 1
        course.append([row @ x for row in rows])
        x = np.zeros(plant.states) if np.abs(x).max() > AWAY[law.real] else x
        x = model.transition @ x + (model.old + model.new).T @ command + model.drift
    course.append([row @ x for row in rows])
    values = np.array(course).transpose(0, 2, 1)  # (time, q, order)
    values[..., 0] += plant.y_offset
    values = np.clip(values, -AWAY[law.real], AWAY[law.real])
    return np.array([values[k + ahead, np.arange(plant.outputs)] for k in range(length)])
