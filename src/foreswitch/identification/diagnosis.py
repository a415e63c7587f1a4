"""What the data cannot tell, or contradicts, in plain words."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, f as f_distribution

from foreswitch._helpers.check import Array
from foreswitch.identification.fitting import Problem, solve
from foreswitch.identification.record import Record
from foreswitch.identification.statistics import WHITE, Estimate, independent
from foreswitch.identification.structures import Structure
from foreswitch.model.prediction import transition

__all__ = ["LevelEffect", "diagnose", "indistinguishable", "level_effects"]

#: Standard errors from zero that a dead time must be.
CLEAR = 2.0
#: Rise of the sum of squares, in variances, below which another model explains the record as well.
AS_WELL = float(chi2.ppf(0.95, 1))
#: Probability below which a difference counts as one, and the least share worth a word.
CHANCE, NOTABLE = 1e-3, 0.05
#: A gain known no better than this was measured with too small a pulse.
VAGUE = 0.1
#: Share of a step's final value that counts as settled, and the probability of a straight line below which it bends.
SETTLED, BENT = 0.8, 0.01
#: Autocorrelation of the residuals that is worth a word.
COLOURED = 0.1


def diagnose(estimate: Estimate) -> list[str]:
    """Every warning, most important first."""
    checks = (
        _unstable,
        _never_returns,
        _small_pulse,
        _dead_time,
        _gain_changes,
        _levels,
        _bends,
        _coloured,
        _quantised,
        _moved,
    )
    return [sentence for check in checks for sentence in check(estimate)]


def _unit(seconds: float) -> str:
    for factor, name in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1.0:
            return f"{seconds * factor:.3g} {name}"
    return f"{seconds * 1e9:.3g} ns" if seconds > 0.0 else "0 s"


def _unstable(estimate: Estimate) -> list[str]:
    problem, result = estimate.problem, []
    for o, structure in enumerate(problem.structures):
        poles = np.roots(structure.denominator(estimate.trial.theta[problem.slices[o]], problem.scale))
        worst = poles[np.argmax(poles.real)]
        if worst.real * problem.longest > 0.1:
            result.append(
                f"The fit of {_output(estimate, o)} is unstable (a pole at {worst.real:.3g} 1/s): "
                "if the plant is not, the record is too short or too noisy for this structure."
            )
    return result


def _output(estimate: Estimate, o: int) -> str:
    return estimate.problem.record.output_names[estimate.problem.outputs[o]]


def _never_returns(estimate: Estimate) -> list[str]:
    record = estimate.problem.record
    return [
        f"Input {name} changes only once and never returns: gain, slow lags and drift cannot be told apart well; "
        "switch it back, more than once."
        for j, name in enumerate(record.input_names)
        if record.edges(j).size <= len(record.segments)
    ]


def _small_pulse(estimate: Estimate) -> list[str]:
    problem, result = estimate.problem, []
    chains = [o for o, structure in enumerate(problem.structures) if not structure.order]
    pairs = itertools.product(chains, range(problem.record.u.shape[1]))
    for name, (o, j) in zip((n for n in estimate.names if n[0] in "kK"), pairs, strict=True):
        value, error = estimate.values[name], estimate.errors[name]
        if error > VAGUE * abs(value):
            result.append(
                f"The gain from {problem.record.input_names[j]} to {_output(estimate, o)} is known to "
                f"{100 * error / max(abs(value), 1e-300):.0f} % only: the pulses are too small for the noise of "
                f"{np.sqrt(estimate.variance(o)):.3g}; give longer or more of them."
            )
    return result


def indistinguishable(estimate: Estimate) -> list[str]:
    """Per input, why its dead time is not told apart from zero or from a lag; empty where it is."""
    problem = estimate.problem
    names = estimate.names[-problem.record.u.shape[1] :]
    rival = _rise_without_dead_time(estimate)
    result = []
    for name in names:
        value, error = estimate.values[name], estimate.errors[name]
        if value < CLEAR * error:
            result.append(f"{_unit(value)} with a standard error of {_unit(error)} is not told apart from zero")
        elif rival < AS_WELL:
            result.append(f"{_unit(value)} is not told apart from one more lag, which explains the record as well")
        else:
            result.append("")
    return result


def _rise_without_dead_time(estimate: Estimate) -> float:
    """Rise of the sum of squares, in variances, with one more lag in place of all dead times."""
    problem, theta = estimate.problem, estimate.trial.theta
    if any(structure.order or structure.states >= 6 for structure in problem.structures):
        return np.inf
    longer = [Structure(s.integrators, s.lags + 1, s.pairs) for s in problem.structures]
    rival = Problem(problem.record, longer, problem.drift, problem.outputs, 1e-6 * problem.shortest, problem.keep)
    rival.sigma = np.array([np.sqrt(max(estimate.variance(o), 1e-300)) for o in range(len(problem.outputs))])
    lag = max(float(theta[problem.delays].mean()), 0.1 * problem.shortest)
    starts = []
    for share in (1.0, 0.5):
        parts = [
            structure.ordered(
                np.r_[theta[own][: structure.lags - 1], np.log(share * lag), theta[own][structure.lags - 1 :]]
            )
            for structure, own in zip(longer, problem.slices, strict=True)
        ]
        starts.append(np.concatenate([*parts, np.zeros(problem.record.u.shape[1])]))
    left = solve(rival, starts).residual()
    own = sum(float(r @ r) / rival.sigma[o] ** 2 for o in range(len(longer)) for r in estimate.residuals(o))
    return float(left @ left - own)


def _dead_time(estimate: Estimate) -> list[str]:
    names = estimate.problem.record.input_names
    return [
        f"The dead time of input {name}, {reason}: sample faster, or use sharper pulses."
        for name, reason in zip(names, indistinguishable(estimate), strict=True)
        if reason
    ]


def _coloured(estimate: Estimate) -> list[str]:
    result = []
    for o in range(len(estimate.problem.outputs)):
        probability, r = estimate.whiteness(o)
        if probability < WHITE and np.abs(r[1:]).max() > COLOURED:
            result.append(
                f"The residuals of {_output(estimate, o)} are not white (autocorrelation {r[1]:.2f} at one sample): "
                "the structure misses something, or a disturbance acted; standard errors allow for it."
            )
    return result


def _quantised(estimate: Estimate) -> list[str]:
    problem, result = estimate.problem, []
    for o in range(len(problem.outputs)):
        values = np.unique(np.concatenate(problem.y[o]))
        step, deviation = float(np.diff(values).min(initial=np.inf)), float(np.sqrt(estimate.variance(o)))
        if values.size < estimate.samples / 4 and step > 2.0 * deviation:
            result.append(
                f"{_output(estimate, o)} is read in steps of {step:.3g}, more than the noise of {deviation:.3g}: "
                "rounding errors are not independent and standard errors are too small."
            )
    return result


def _moved(estimate: Estimate) -> list[str]:
    result = []
    for o, structure in enumerate(estimate.problem.structures):
        offsets = np.array(estimate.offsets(o))
        if len(offsets) < 2 or structure.integrators:
            continue
        spread, error = float(np.ptp(offsets[:, 0])), float(offsets[:, 1].max())
        motion = max(float(np.ptp(y)) for y in estimate.problem.y[o])
        if spread > 4.0 * error and spread > NOTABLE * motion:
            result.append(
                f"The offset of {_output(estimate, o)} differs by {spread:.3g} between segments: "
                "the operating point moved; y_offset is their mean."
            )
    return result


# ---- Gains that differ: by time, by level ----


def _gain_changes(estimate: Estimate) -> list[str]:
    problem, result = estimate.problem, []
    record = problem.record
    for j, name in enumerate(record.input_names):
        blocks, change = _blocks(estimate, j), np.zeros(record.t.size)
        for stretch in problem.stretches:
            change[stretch] = record.u[stretch, j] - record.u[stretch.start, j]
        if len(blocks) < 2:
            continue
        for o in range(len(problem.structures)):
            shares, errors, chance = _separate(estimate, o, j, [np.where(block, change, 0.0) for block in blocks])
            low, high = int(np.argmin(shares)), int(np.argmax(shares))
            spread = float(shares[high] - shares[low])
            if chance < CHANCE and spread > max(NOTABLE, 3.0 * float(np.hypot(errors[low], errors[high]))):
                where = [f"{shares[i]:.2f} times the fitted one from {_start(record, blocks[i])} on"
                         for i in (low, high)]  # fmt: skip
                result.append(
                    f"The gain from {name} to {_output(estimate, o)} differs by {100 * spread:.0f} % within the record "
                    f"({', '.join(where)}): something changed, a supply, a fan, a leak; or the plant is not linear."
                )
    return result


def _start(record: Record, block: NDArray[np.bool_]) -> str:
    return f"{record.t[np.flatnonzero(block)[0]]:.3g} s"


def _blocks(estimate: Estimate, j: int) -> list[NDArray[np.bool_]]:
    """The segments, or up to four stretches of one with at least two changes of input ``j`` each."""
    problem = estimate.problem
    record, blocks = problem.record, []
    if len(problem.stretches) > 1:
        for stretch in problem.stretches:
            block = np.zeros(record.t.size, dtype=bool)
            block[stretch] = True
            if np.ptp(record.u[stretch, j]) > 0:
                blocks.append(block)
        return blocks
    edges = record.edges(j)
    count = min(4, edges.size // 2)
    if count < 2:
        return []
    # a block begins with every 2 k-th change, so that a pulse is never cut
    cuts = edges[[2 * (i * (edges.size // 2) // count) for i in range(count)]]
    cuts[0] = problem.stretches[0].start
    for start, end in zip(cuts, [*cuts[1:], problem.stretches[0].stop], strict=True):
        block = np.zeros(record.t.size, dtype=bool)
        block[start:end] = True
        blocks.append(block)
    return blocks


def _separate(estimate: Estimate, o: int, j: int, inputs: list[Array]) -> tuple[Array, Array, float]:
    """Gains of the parts of input ``j`` in units of the fitted one, poles and dead times held; errors; probability
    that they are all one gain.

    The parts start every segment from 0 and add up to the input's change since then.
    """
    problem, trial = estimate.problem, estimate.trial
    theta, delay = trial.theta[problem.slices[o]], float(trial.theta[problem.delays][j])
    A, b = problem.structures[o].system(theta, problem.scale)
    m = problem.record.u.shape[1]
    gains = np.split(trial.linear[o].gains, m)
    width = gains[j].size
    projected, target = [], []
    for part, grid, stretch, y in zip(trial.parts[o], problem.grids, problem.stretches, problem.y[o], strict=True):
        columns = []
        for values in inputs:
            u = np.ascontiguousarray(values[stretch])
            columns.append(grid.delayed(A, b, u, grid.states(A, b, u), delay)[0][:, -width:] @ gains[j])
        whole = [part.forced[:, i * width : (i + 1) * width] @ gains[i] for i in range(m)]
        F = np.column_stack([*columns, *(whole[i] for i in range(m) if i != j)])
        v = y - (whole[j] - sum(columns))  # less what an integrator makes of the first command
        projected.append(F - part.basis @ (part.basis.T @ F))
        target.append(v - part.basis @ (part.basis.T @ v))
    F, v = np.concatenate(projected), np.concatenate(target)
    shares, *_ = np.linalg.lstsq(F, v, rcond=None)
    residual = v - F @ shares
    degrees, extra = max(1, residual.size - estimate.unknowns(o) - len(inputs)), max(1, len(inputs) - 1)
    # coloured residuals carry less information than their number says
    inflation = residual.size / independent([residual])
    variance = max(float(residual @ residual) / degrees * inflation, 1e-300)
    common = sum(float(r @ r) for r in estimate.residuals(o))
    rise = max(0.0, common - float(residual @ residual))
    chance = float(f_distribution.sf(rise / extra / variance, extra, max(1.0, degrees / inflation)))
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(F.T @ F)), 0.0) * variance)
    return shares[: len(inputs)], errors[: len(inputs)], chance


@dataclass(frozen=True)
class LevelEffect:
    """What each level of a multi-level input really does, in units of the input.

    Attributes
    ----------
    input : int
        Index.
    levels, effects, errors : ndarray
        Commanded, effective (lowest and highest as commanded) and its standard error.
    chance : float
        Probability that the effects are proportional to the levels.
    """

    input: int
    levels: Array
    effects: Array
    errors: Array
    chance: float


def level_effects(estimate: Estimate, o: int, j: int) -> LevelEffect | None:
    """Separate effect of each level of input ``j`` on output ``o``.

    None with fewer than three levels, with an integrator, whose drift is one more level, or where a level is held only
    once, so that it cannot be told from drift or another input.
    """
    problem = estimate.problem
    levels, u = problem.record.levels(j), problem.record.u[:, j]
    if not 3 <= levels.size <= 12 or problem.structures[o].integrators:
        return None
    held = np.concatenate([u[s][np.r_[True, np.diff(u[s]) != 0.0]] for s in problem.stretches])
    if min(np.count_nonzero(held == level) for level in levels) < 2:
        return None
    inputs = [np.where(u == level, level - levels[0], 0.0) for level in levels[1:]]
    for stretch in problem.stretches:
        for values in inputs:
            values[stretch] -= values[stretch.start]
    shares, errors, chance = _separate(estimate, o, j, inputs)
    if not shares[-1] > 3.0 * errors[-1]:
        return None
    effects = np.r_[0.0, shares / shares[-1]] * (levels - levels[0]) + levels[0]
    return LevelEffect(j, levels, effects, np.r_[0.0, errors / shares[-1]] * (levels - levels[0]), chance)


def _levels(estimate: Estimate) -> list[str]:
    result = []
    record = estimate.problem.record
    for o in range(len(estimate.problem.outputs)):
        for j, name in enumerate(record.input_names):
            found = level_effects(estimate, o, j)
            if found is None or found.chance >= CHANCE:
                continue
            departure = np.abs(found.effects - found.levels)
            if (departure > np.maximum(NOTABLE * np.ptp(found.levels), 3.0 * found.errors)).any():
                table = ", ".join(f"{a:g} acts as {b:.3g}" for a, b in zip(found.levels, found.effects, strict=True))
                result.append(
                    f"The effect of {name} on {_output(estimate, o)} is not proportional to its level ({table}): "
                    "the actuator is not linear; identify with the effective levels in place of the commanded ones."
                )
    return result


def _share_reached(estimate: Estimate, o: int, time: float) -> float:
    """Share of its final value that the first input's step response has after that time; never more than 1."""
    plant = estimate.plant
    poles = np.linalg.eigvals(plant.A)
    steps = np.linspace(time, time + 5.0 / np.abs(poles.real).min(), 50)  # an overshoot is not settled either
    response = [float(plant.C[o] @ transition(plant.A, plant.B[:, :1], t)[1][:, 0]) for t in steps]
    final = float(-plant.C[o] @ np.linalg.solve(plant.A, plant.B[:, 0]))
    return 1.0 - max(abs(value / final - 1.0) for value in response) if final else 0.0


def _bends(estimate: Estimate) -> list[str]:
    """Whether the settled output bends with the level, where each level is held too seldom for `level_effects`."""
    problem, record = estimate.problem, estimate.problem.record
    if record.u.shape[1] > 1 or len(problem.stretches) > 1:
        return []
    result, edges = [], np.r_[problem.stretches[0].start, record.edges(0), problem.stretches[0].stop]
    for o, structure in enumerate(problem.structures):
        poles = np.roots(structure.denominator(estimate.trial.theta[problem.slices[o]], problem.scale))
        if structure.integrators or poles.real.max() >= 0.0 or level_effects(estimate, o, 0):
            continue
        settled = []
        for start, end in itertools.pairwise(edges):
            if _share_reached(estimate, o, float(record.t[end - 1] - record.t[start])) > SETTLED:
                last = slice(end - max(1, (end - start) // 10), end)
                settled.append((record.u[start, 0], record.t[end - 1], record.y[last, problem.outputs[o]].mean()))
        if len(settled) < 5 or len({level for level, *_ in settled}) < 4:
            continue
        u, t, y = np.array(sorted(settled)).T
        line = np.column_stack([np.ones(u.size), u])
        straight, drifting, curved = (
            float(np.linalg.lstsq(X, y, rcond=None)[1].sum())
            for X in (line, np.column_stack([line, t]), np.column_stack([line, (u - u.mean()) ** 2]))
        )
        chance = f_distribution.sf((straight - curved) / max(curved / (u.size - 3), 1e-300), 1, u.size - 3)
        slopes = np.polyval(np.polyder(np.polyfit(u, y, 2)), [u[0], u[-1]])
        if chance < BENT and curved < 0.5 * drifting and np.ptp(slopes) > np.abs(slopes).max() / 4.0:
            result.append(
                f"{_output(estimate, o)} settles on a curve: {slopes[0]:.3g} per unit of {record.input_names[0]} at "
                f"{u[0]:g} and {slopes[1]:.3g} at {u[-1]:g}: the actuator or the plant is not linear; identify on the "
                "levels that control will use, or give effective levels in place of the commanded ones."
            )
    return result
