"""A certificate's reasons in words: what it rests on, or which condition failed and what to change."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.certificate import margins
from foreswitch.certificate.covering_radius import LARGEST
from foreswitch.certificate.error_dynamics import ErrorLoop
from foreswitch.certificate.ideal_response import Course
from foreswitch.certificate.measurement_errors import innovation_reach, passes_gate, starts_at
from foreswitch.certificate.model_errors import Errors
from foreswitch.certificate.quantiser import Argument, Quantiser
from foreswitch.control.controller import Controller
from foreswitch.control.objective import Endpoint
from foreswitch.model.prediction import transition

__all__ = [
    "at_rest",
    "between",
    "beyond",
    "gated",
    "grounds",
    "intervals",
    "misled",
    "numbers",
    "overloaded",
    "resolution",
    "unproven",
    "unstable",
]

#: An input within this share of the levels' span of a level is that level.
SAME = 1e-6


def numbers(values: Iterable[float], digits: int = 4) -> str:
    """Several numbers, as short as they are told apart."""
    return " ".join(f"{value:.{digits}g}" for value in np.ravel(np.asarray(values)))


def between(low: Array, high: Array) -> str:
    """A range of inputs."""
    return f"from {numbers(low)} to {numbers(high)}"


def intervals(found: Iterable[tuple[float, float]], unit: str = "") -> str:
    """Several ranges of one number."""
    return " or ".join(f"{a:.3g} to {b:.3g}" for a, b in found) + f" {unit}" * bool(unit)


# ---- Before any analysis ----


def unproven(controller: Controller) -> str:
    """Why nothing is proven for this kind of controller; empty where something is."""
    if not isinstance(controller.objective, Endpoint):
        return (
            "The objective is a Horizon, whose error is not proven to be bounded; certify an Endpoint, or judge this one "
            "by simulation and study"
        )
    longest = max(map(max, controller.actuator.dwell))
    if longest > 1:
        return (
            f"min_on or min_off keeps a level for {longest} periods, and a level that must be kept is not the nearest one, "
            "so that no bound is proven; set them to 0, or Ts to the dwell"
        )
    return ""


def resolution(controller: Controller) -> Array:
    """Half of what a pulse of one period over the widest gap moves each output: at most, or, unstable, by t_k + Theta."""
    plant, Ts = controller.plant, controller.Ts
    phi, gamma = transition(plant.A, plant.B, Ts)
    unit = gamma * [0.5 * np.diff(v).max() for v in controller.levels]
    stable = bool((plant.poles.real <= 1e-9 * np.abs(plant.poles).max()).all())
    slow = np.abs(plant.poles.real)
    slow = slow[slow > 1e-9 * np.abs(plant.poles).max()]
    reach = float(getattr(controller.objective, "Td", 0.0)) if not stable else 10.0 / float(slow.min(initial=1.0 / Ts))
    best = np.zeros(plant.outputs)
    for _ in range(min(max(1, round(reach / Ts)), 100_000)):
        best = np.maximum(best, np.abs(plant.C @ unit).max(axis=1))
        unit = phi @ unit
    return best


def gated(loop: ErrorLoop, errors: Errors) -> str:
    """Why the estimator may leave out a sound sample; empty where it does not."""
    if passes_gate(loop, errors):
        return ""
    return (
        f"The errors move the innovation by up to {numbers(innovation_reach(loop, errors))}, beyond the estimator's gate, "
        "and a filter that leaves out samples is not covered; widen gate, raise measurement_noise, or set gate = 0"
    )


def misled(loop: ErrorLoop, course: Course | None) -> str:
    """Why the estimator does not begin where the plant does; empty where it does."""
    if course is None or starts_at(loop, course.x0):
        return ""
    return (
        f"The estimator takes the first measurement for a state at rest, or begins where it was told, and x0 = "
        f"{numbers(course.x0)} is not there; begin at rest, or tell the state by reset(estimate=)"
    )


# ---- Conditions that fail ----


def unstable(loop: ErrorLoop, errors: Errors) -> str:
    """The ideal loop does not settle, or the estimator does not."""
    kalman = loop.controller.kalman
    if kalman is not None and loop.settles:
        return (
            f"The estimator has a pole at |z| = {abs(kalman.poles[0]):.6g}, so near the unit circle that its errors hardly "
            "decay; raise process_noise or load, or lower measurement_noise"
        )
    pole = abs(loop.poles[0])
    objective = loop.controller.objective
    where = "outside the unit circle" if pole >= 1.0 else "so near the unit circle that errors hardly decay"
    say = f"The ideal loop has a pole at |z| = {pole:.6g}, {where}, with Td = {objective.Td:g} s"  # type: ignore[union-attr]
    return f"{say}; {_remedy(loop, errors)}"


def _remedy(loop: ErrorLoop, errors: Errors) -> str:
    """Settings that would hold."""
    good = margins.intervals(loop.controller, "Td", errors, None)
    if good:
        return f"choose Td from {intervals(good, 's')}"
    good = margins.intervals(loop.controller, "lam", errors, None)
    if good:
        return f"no other Td helps, choose lam from {intervals(good, 'rad/s')}"
    return "no other Td or lam alone helps; give a shorter Ts, finer levels, or outputs that the inputs command better"


def overloaded(quantiser: Quantiser, errors: Errors) -> str:
    """There is no range at all."""
    loop = quantiser.loop
    if loop.rank > LARGEST:
        return (
            f"The inputs move {loop.rank} outputs independently, and the quantiser's error is proven for up to {LARGEST}; "
            "certify parts of the plant one by one"
        )
    nothing = errors.share(0.0)
    if quantiser.prove(nothing) is None:
        moved = loop.recursion.sums(loop.metric @ loop.gain, loop.gamma @ loop.inverse, norm=2).max()
        return (
            f"The quantiser overloads: its errors together move the unquantised input by up to {moved:.3g} times one of "
            f"them, and the levels leave no room for that; {_remedy(loop, nothing)}"
        )
    blamed = []
    for name, label, unit in (
        ("delay", "delay_error", " s"),
        ("gain", "gain_error", ""),
        ("load", "load", ""),
        ("noise", "noise", ""),
    ):
        own = getattr(errors, name)
        alone = replace(nothing, **{name: own})
        if own.any() and not margins.holds(quantiser, alone, None):
            most = margins.share(quantiser, alone)
            blamed.append(f"{label} of {numbers(own)}{unit} is more than the loop bears, at most {most:.3g} times that")
    if not blamed:
        most = margins.share(quantiser, errors)
        blamed = [f"noise, delay_error, gain_error and load together are too large, {most:.3g} times them would do"]
    return f"The quantiser may overload: {' and '.join(blamed)}; find the model more exactly, or give finer levels"


def beyond(quantiser: Quantiser, errors: Errors, course: Course, wanted: Array, allowed: Argument) -> str:
    """The reference asks for more than the levels have."""
    need, have = between(wanted.min(axis=0), wanted.max(axis=0)), between(allowed.low, allowed.high)
    say = f"The reference needs an ideal input {need}, and the bound holds {have}"
    speed = margins.fastest(quantiser, errors, course)
    if speed > 0:
        return f"{say}; run through it at most {speed:.3g} times as fast, or begin where the plant is"
    return f"{say}, however slowly it is run through; begin at the plant's state (x0), and stay where it can be held"


# ---- What a certificate rests on ----


def grounds(loop: ErrorLoop, argument: Argument, wanted: Array | None) -> list[str]:
    """Why the bound holds, and under which condition."""
    result = [f"Errors decay: the slowest pole of the ideal loop is at |z| = {abs(loop.poles[0]):.4g}"]
    if loop.plant.inputs > 1:
        radius = "the levels cover the range of the unquantised inputs to within their covering radius"
    elif argument.one_sided:
        radius = (
            "along a mode of the plant each error is undone by the next command, so that an ideal input at the end of "
            "the levels overloads nothing"
        )
    else:
        radius = "the unquantised input stays within half a gap of the levels"
    result.append(f"The quantiser's error is bounded: {radius}")
    if wanted is None:
        result.append(f"It holds for every reference whose ideal input stays {between(argument.low, argument.high)}")
    else:
        result.append(
            f"The reference's ideal input stays {between(wanted.min(axis=0), wanted.max(axis=0))}, within the range "
            f"{between(argument.low, argument.high)}"
        )
        if argument.excursion > 0:
            result[-1] += (
                f", which it leaves for a while at the price of {100.0 * argument.excursion:.2g} % of the bound"
            )
    if loop.controller.kalman is not None:
        result.append("The estimator begins at the plant's state: at rest, or told by reset(estimate=)")
    law = loop.controller.law
    if law.rest is not None and not law.rest.exact:
        result.append(
            "No input holds every reference, so the rest tail is a least-squares one; the ideal response shows how far off"
        )
    gain = np.atleast_2d(law.dc_gain)
    if np.isfinite(gain).all() and not np.allclose(gain, np.eye(len(gain)), atol=1e-6):
        result.append(
            f"The ideal response itself does not reach the reference: its DC gain is {numbers(np.diag(gain))}"
        )
    return result


def at_rest(controller: Controller, course: Course | None, bound: Array) -> str:
    """What happens where the reference stands still."""
    if not np.isfinite(bound).all() or not isinstance(controller.objective, Endpoint):
        return "Nothing is proven at rest."
    rest = controller.law.rest
    if rest is None:
        return (
            f"At rest the law assumes no input after the candidate; the output is within {numbers(bound, 3)} of ideal."
        )
    integrating = not rest.reference.any()
    if course is None and not integrating:
        return (
            f"At rest it keeps switching between the levels around the input that holds the reference, the output "
            f"within {numbers(bound, 3)}; where that input is a level, it may fall silent."
        )
    yd = np.zeros(controller.plant.outputs) if course is None else course.told[-1, :, 0]
    need = rest.reference @ yd + rest.offset
    if course is not None and controller.plant.disturbances:
        need = need + rest.disturbance[:, : controller.plant.disturbances] @ course.disturbance[-1]
    silent = all(
        np.abs(values - value).min() <= SAME * np.ptp(values)
        for value, values in zip(need, controller.levels, strict=True)
    )
    where = "At rest" if course is None else f"At rest at {numbers(yd)}"
    if silent:
        return (
            f"{where} the input that holds the output is the level {numbers(need)}: switching may cease, and the output "
            f"then stands up to {numbers(bound, 3)} off."
        )
    return (
        f"{where} the input that holds the output is {numbers(need)}, between levels: switching goes on for good, and the "
        f"output stays within {numbers(bound, 3)}."
    )
