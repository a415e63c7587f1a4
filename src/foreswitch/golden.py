"""Golden steps: a controller in closed loop with its own model, recorded for replay elsewhere."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreswitch.controller import Controller
from foreswitch.core import REALS

__all__ = ["Golden", "golden_steps"]

MOST, LEAST = 256, 32
#: Numbers told to the controller in all, about: more steps where each needs few.
NUMBERS = 4096
#: Each part starts from rest with the reference elsewhere: a plant that cannot return is tried more than once.
PARTS = 4
#: Finite, so that any compiler can read it, and beyond what the core takes for a measurement.
UNUSABLE = {"float32": 3e38, "float64": 1e300}


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

    Measured values carry a little noise; some are unusable, as are a reference and a disturbance, so that every status
    occurs that the design knows.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the design, which has been made once
        law = controller.replace()
    plant, real = law.plant, REALS[law.real]
    width = law.evaluations * plant.outputs * law.order
    steps = int(np.clip(NUMBERS // (width + law._measured[0]), LEAST, MOST))
    p, huge = plant.disturbances, UNUSABLE[law.real]
    low, high = _reach(law)
    swing = np.where(high > low, high - low, 1.0)
    rows: list[tuple[Any, ...]] = []
    x = np.zeros(plant.states)
    for k in range(steps):
        part, at = divmod(k, steps // PARTS)
        if at == 0:
            x = np.zeros(plant.states)
        w = np.array([0.1 * np.sin(0.3 * k + i) for i in range(p)])
        shown = x if law.estimator is None else plant.C @ x + plant.y_offset
        scale = 1e-3 * (np.abs(shown) + 1e-3)
        shown = (shown + scale * _noise(k, shown.size)).astype(real)
        reference = _wave(law, low, swing, (at + 7 * part) * law.Ts, steps // PARTS).astype(real)
        told_w = w.astype(real)
        if _bad(k, steps, law._bad_limit):
            shown = np.full_like(shown, huge)
        if k == steps // 3:
            reference.flat[0] = huge
        if p and k in (steps // 5, steps // 5 + 1):
            told_w[0] = huge
        given = shown.astype(float), reference.astype(float)
        options = {"disturbance": told_w.astype(float)} if p else {}
        decision = law.decide(*given, **options)
        u = law.step(*given, **options)
        command = np.frombuffer(law._core.line(), dtype=np.uint8)[-plant.inputs :]
        rows.append((shown, reference.ravel(), told_w, command, law.status, real(decision.cost), decision.nodes))
        x = _advance(law, x, w, u)
        x = np.clip(x, -1e6 * (1.0 + swing.max()), 1e6 * (1.0 + swing.max()))  # an unstable plant, left alone
    state, disturbances = np.empty(plant.states), np.empty(law._disturbances)
    law._core.estimate(state, disturbances)
    names = ("measured", "reference", "disturbance", "command", "status", "cost", "nodes")
    columns = {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
    return Golden(**columns, state=state.astype(real), disturbances=disturbances.astype(real))


def _bad(k: int, steps: int, limit: int) -> bool:
    """Unusable samples: the first, a few in a row, and if the design has a limit as many as it takes."""
    run = min(limit + 2, steps // 4) if limit else 3
    return k == 0 or 0 <= k - steps // 2 < run


def _advance(law: Controller, x: Any, w: Any, u: Any) -> Any:
    """The model one period later; the command `u` is already in the line."""
    model, history = law._model, law._history()
    result = model.transition @ x + model.disturbance[:, : w.size] @ w + model.drift
    for j, delay in enumerate(model.delay):
        result = result + model.old[j] * history[-1 - delay, j]
        if delay > 0:
            result = result + model.new[j] * history[-delay, j]
    return result


def _reach(law: Controller) -> tuple[Any, Any]:
    """Least and largest value of each output within a while of holding any one command, from rest."""
    plant, model = law.plant, law._model
    seen = [plant.y_offset]
    for command in law._actuator.values(law._actuator.candidates[:64]):
        x = np.zeros(plant.states)
        for _ in range(25):
            x = model.transition @ x + (model.old + model.new).T @ command + model.drift
            seen.append(plant.C @ x + plant.y_offset)
    values = np.array(seen)
    return values.min(axis=0), values.max(axis=0)


def _noise(k: int, count: int) -> Any:
    """Numbers in [-1, 1), the same with every library."""
    seeds = (k * 64 + np.arange(count) + 1) * 2654435761 % 2**32
    return seeds / 2.0**31 - 1.0


def _wave(law: Controller, low: Any, swing: Any, t: float, length: int) -> Any:
    """A wave through what the outputs can reach, with its derivatives: (evaluations, q, order)."""
    omega = 2.0 * np.pi / (length * law.Ts)
    times = t + np.arange(law.evaluations) * law.Ts
    i = np.arange(law.order)
    phase = omega * times[:, None, None] - 0.5 * np.pi * (1.0 + np.arange(law.plant.outputs))[:, None]
    waves = 0.5 * omega**i * np.sin(phase + 0.5 * np.pi * i)
    waves[..., 0] += 0.5
    result = swing[:, None] * waves
    result[..., 0] += low
    return result
