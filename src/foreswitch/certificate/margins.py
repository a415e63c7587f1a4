"""How much of each error, which settings and which speed a certificate would still bear."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.certificate.error_dynamics import ErrorLoop
from foreswitch.certificate.ideal_response import Course
from foreswitch.certificate.measurement_errors import passes_gate
from foreswitch.certificate.model_errors import Errors
from foreswitch.certificate.peak_gain import Unsettled
from foreswitch.certificate.quantiser import Quantiser
from foreswitch.control.controller import Controller
from foreswitch.model.plant import Plant

__all__ = ["bound", "fastest", "holds", "intervals", "of_errors", "share", "steady"]

#: Doublings after which there is no limit, and halvings of the last step.
DOUBLINGS, HALVINGS = 30, 10
#: How much an error that is still tolerable may enlarge a bound.
WORSE = 2.0
#: Values of a setting that are tried, from its own divided by to its own times so much; halvings of each edge.
TRIED, AROUND, EDGE_HALVINGS = 61, 32.0, 12
#: A reference is run through at most so many times as fast, or as slowly.
FASTEST = 64.0
#: A pole below this share of the fastest one is an integrator.
AT_ORIGIN = 1e-9


def holds(quantiser: Quantiser, errors: Errors, wanted: Array | None) -> bool:
    """Whether there is a bound for these errors."""
    try:
        return passes_gate(quantiser.loop, errors) and quantiser.prove(errors, wanted) is not None
    except Unsettled:
        return False


def bound(quantiser: Quantiser, errors: Errors, wanted: Array | None) -> Array:
    """The bound of each output, (q,); infinite where there is none."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            argument = quantiser.prove(errors, wanted) if passes_gate(quantiser.loop, errors) else None
            if argument is not None:
                found = quantiser.loop.output_reach(argument.radius, errors)
                return np.where(np.isfinite(found), found, np.inf)
    except Unsettled:
        pass
    return np.full(quantiser.loop.plant.outputs, np.inf)


def _largest(accepts: Callable[[float], bool], first: float) -> float:
    """The largest number that is accepted, 0 being; infinity where none is too large."""
    least, most = 0.0, first
    for _ in range(DOUBLINGS):
        if not accepts(most):
            break
        least, most = most, 2.0 * most
    else:
        return float("inf")
    for _ in range(HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if accepts(middle) else (least, middle)
    return least


def share(quantiser: Quantiser, errors: Errors) -> float:
    """The largest share of some errors that is certified."""

    def accepts(value: float) -> bool:
        return holds(quantiser, errors.share(value), None)

    return _largest(accepts, 1e-3)


def of_errors(quantiser: Quantiser, errors: Errors, wanted: Array | None) -> dict[str, Array]:
    """Largest delay error, gain error, load and noise, each entry by itself, until a bound has grown by `WORSE`."""
    loop = quantiser.loop
    per_noise = np.abs(loop.choice @ loop.law.rows.state).max()
    firsts = {
        "delay": loop.Ts / 8.0,
        "gain": 0.01,
        "load": 0.01 * float(quantiser.span.min()),
        "noise": 1e-3 * float(quantiser.span.max() / max(per_noise, 1e-300)),
    }
    limit = WORSE * bound(quantiser, errors, wanted)
    result = {}
    for name, first in firsts.items():
        own = getattr(errors, name)
        found = np.zeros_like(own)
        for i in range(own.size):

            def accepts(value: float, i: int = i, name: str = name, own: Array = own) -> bool:
                changed = own.copy()
                changed[i] = value
                if name == "gain" and value >= 1.0:
                    return False
                return bool((bound(quantiser, replace(errors, **{name: changed}), wanted) <= limit).all())

            found[i] = _largest(accepts, first)
        result[f"{name}_error" if name in ("delay", "gain") else name] = found
    return result


def intervals(controller: Controller, name: str, errors: Errors, wanted: Array | None) -> list[tuple[float, float]]:
    """Where a setting of the objective, around its own value, leads to a certificate."""
    objective: Any = controller.objective
    own = getattr(objective, name)
    scale = float(np.max(own))

    def accepts(value: float) -> bool:
        changed = value if np.ndim(own) == 0 else np.asarray(own) * (value / scale)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                design = controller.replace(objective=replace(objective, **{name: changed}), preview=False)
            return holds(Quantiser(ErrorLoop(design)), errors, wanted)
        except ValueError:  # no such design
            return False

    least = max(scale / AROUND, controller.Ts) if name == "Td" else scale / AROUND
    values = np.unique(np.append(np.geomspace(least, scale * AROUND, TRIED), scale))
    good = [accepts(value) for value in values]
    edges = [float(values[0])] if good[0] else []
    for (a, was), (b, now) in pairwise(zip(values, good, strict=True)):
        if was != now:
            for _ in range(EDGE_HALVINGS):
                middle = float(np.sqrt(a * b))
                a, b = (middle, b) if accepts(middle) == was else (a, middle)
            edges.append(float(a if was else b))
    if good[-1]:
        edges.append(float(values[-1]))
    return list(zip(edges[::2], edges[1::2], strict=True))


def fastest(quantiser: Quantiser, errors: Errors, course: Course) -> float:
    """How many times as fast a reference may be run through: the first limit found from slow to fast."""

    def accepts(factor: float) -> bool:
        return quantiser.prove(errors, course.faster(factor).inputs(quantiser.loop)) is not None

    least = 1.0
    while not accepts(least):
        least /= 2.0
        if least < 1.0 / FASTEST:
            return 0.0
    most = 2.0 * least
    while accepts(most):
        least, most = most, 2.0 * most
        if most > FASTEST:
            return float("inf")
    for _ in range(HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if accepts(middle) else (least, middle)
    return least


def steady(plant: Plant, input_range: tuple[Array, Array]) -> dict[str, tuple[float, float]]:
    """Values, slopes or accelerations of y that keep the input within a range; of one input and one output.

    An output ``t^i / i!`` needs an input whose constant part is c_i: ``[A B; C 0] [a_i; c_i] = [a_(i-1); (i = 0)]``. With r
    poles at 0, c_r is the first that is not 0: it limits the r-th derivative for good, c_1 beside c_0 the slope in passing.
    """
    if plant.inputs != 1 or plant.outputs != 1 or not np.isfinite(input_range).all():
        return {}
    poles = np.abs(plant.poles)
    integrators = int((poles <= AT_ORIGIN * poles.max()).sum())
    low, high = (float(each[0] - plant.u_offset[0]) for each in input_range)
    M = np.block([[plant.A, plant.B], [plant.C, np.zeros((1, 1))]])
    state, found = np.zeros(plant.states), {}
    for i, name in enumerate(("value", "slope", "acceleration")):
        right = np.append(state, float(i == 0))
        solution = np.linalg.lstsq(M, right, rcond=None)[0]
        if not np.allclose(M @ solution, right, rtol=1e-8, atol=1e-8 * max(1.0, float(np.abs(right).max()))):
            break
        state, need = solution[:-1], float(solution[-1])
        if i < integrators or need == 0.0:
            continue
        beside = 0.5 * (low + high) if i > integrators else 0.0
        shift = float(plant.y_offset[0]) if i == 0 else 0.0
        a, b = sorted(((low - beside) / need + shift, (high - beside) / need + shift))
        found[name] = (a, b)
        if i > 0:
            break
    return found
