"""One structure fitted to a record by separable least squares.

The output is linear in the gains, offset, drift and initial state, and nonlinear in poles and dead times. So the
linear ones are solved for at each trial of the nonlinear ones (variable projection, Golub and Pereyra 1973, with
Kaufman's Jacobian), and offset and drift are removed as part of the fit, not before it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from foreswitch._helpers.check import Array
from foreswitch.identification.record import Record
from foreswitch.identification.response import Grid
from foreswitch.identification.structures import Structure

__all__ = ["Problem", "Trial", "search", "solve"]

#: Directions of the nuisance columns below this share of the largest are not told apart from the others.
RANK = 1e-9
#: Time constants tried, from a third of a sampling interval to the record's length.
TIMES = 12
#: Dead times tried for each of them.
DELAYS = 60
#: Starts followed, of a free order up to so many with dead times that differ by this share.
BEST, VALLEYS, APART = 3, 12, 0.25
#: A dead time below this share of a sampling interval is none: the solver stops short of its bound.
NOTHING = 1e-6
#: Starts whose inputs get dead times of their own.
REFINED = 6
#: Dead times tried again with the poles found, and how often.
AGAIN, ROUNDS = 100, 4
#: Step of the central difference in a nonlinear parameter, which is of order one.
STEP = 1e-5
#: Stages of the way down from the starts: tolerance, most evaluations, how many go on.
DESCENT = ((1e-2, 15, 6), (1e-4, 40, 1), (1e-10, 60, 1))


@dataclass(frozen=True)
class Part:
    """One output over one segment at trial parameters: its columns, one row per sample used."""

    forced: Array  # (W, gains): response to each input
    slope: Array  # (W, gains): its time derivative
    basis: Array  # (W, k): orthonormal, spans offset, drift and initial state
    back: Array  # (nuisance, k): coefficients of the nuisance columns from those of the basis
    nuisance: Array  # (W, nuisance)


class Undelayed(NamedTuple):
    """States without dead time."""

    A: Array
    b: Array
    states: list[list[Array]]  # per segment and input, (N, n)


class Problem:
    """A record, the structure of each output, and what is wanted of the fit.

    Parameters
    ----------
    record : Record
    structures : sequence of Structure
        One per output.
    drift : sequence of bool
        Whether each output drifts: linearly, or as the operating point of an integrator makes it.
    outputs : sequence of int
        Which outputs of the record.
    longest_delay : float
        Seconds.
    keep : ndarray of bool, optional
        Samples to use; default all that the record uses.
    """

    def __init__(
        self,
        record: Record,
        structures: Sequence[Structure],
        drift: Sequence[bool],
        outputs: Sequence[int],
        longest_delay: float,
        keep: NDArray[np.bool_] | None = None,
    ) -> None:
        self.record, self.structures, self.drift, self.outputs = record, list(structures), list(drift), list(outputs)
        self.longest_delay = longest_delay
        self.keep = keep = record.used if keep is None else record.used & keep
        self.grids: list[Grid] = []
        self.inputs: list[Array] = []  # (m, N) each
        self.samples: list[NDArray[np.intp]] = []
        self.stretches: list[slice] = []
        self.y: list[list[Array]] = [[] for _ in outputs]  # per output and segment
        for stretch in record.segments:
            wanted = np.flatnonzero(keep[stretch])
            if wanted.size == 0:
                continue
            self.stretches.append(stretch)
            self.grids.append(Grid(record.t[stretch], wanted))
            self.inputs.append(np.ascontiguousarray((record.u[stretch] - record.u[stretch.start]).T))
            self.samples.append(wanted + stretch.start)
            for own, o in zip(self.y, outputs, strict=True):
                own.append(record.y[wanted + stretch.start, o])
        self.scale = float(np.median([grid.t[-1] for grid in self.grids])) / 10.0
        self.shortest = min(grid.interval for grid in self.grids)
        self.longest = max(float(grid.t[-1]) for grid in self.grids)
        self.sigma = np.ones(len(self.outputs))
        edges = np.cumsum([0] + [len(structure.names) for structure in self.structures])
        self.slices = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
        self.delays = slice(int(edges[-1]), int(edges[-1]) + record.u.shape[1])

    def bounds(self) -> tuple[Array, Array]:
        """Bounds of all nonlinear parameters, the dead times last."""
        each = [
            structure.bounds(0.02 * self.shortest, 10.0 * self.longest, self.scale) for structure in self.structures
        ]
        m = self.record.u.shape[1]
        low = np.concatenate([low for low, _ in each] + [np.zeros(m)])
        high = np.concatenate([high for _, high in each] + [np.full(m, self.longest_delay)])
        return low, high

    def ordered(self, theta: Array) -> Array:
        """The same model with the parameters of each structure in their order."""
        each = [structure.ordered(theta[own]) for structure, own in zip(self.structures, self.slices, strict=True)]
        return np.concatenate([*each, theta[self.delays]])

    def undelayed(self, o: int, theta: Array) -> Undelayed:
        """States of output ``o`` at all samples, without dead time."""
        A, b = self.structures[o].system(theta, self.scale)
        inputs = range(self.record.u.shape[1])
        return Undelayed(A, b, [[grid.states(A, b, u[j]) for j in inputs]
                                for grid, u in zip(self.grids, self.inputs, strict=True)])  # fmt: skip

    def columns(self, o: int, undelayed: Undelayed, delays: Array) -> list[tuple[Array, Array]]:
        """Per segment, the forced response and its slope, (W, gains) each."""
        structure, (A, b, states) = self.structures[o], undelayed
        result = []
        for grid, u, x, stretch in zip(self.grids, self.inputs, states, self.stretches, strict=True):
            forced, slopes = [], []
            for j, delay in enumerate(delays):
                late, slope = grid.delayed(A, b, u[j], x[j], float(delay))
                if not structure.order:
                    late, slope = late[:, -1:], slope[:, -1:]
                if structure.integrators:  # the first command has acted all along
                    power = structure.integrators
                    late = late + (self.record.u[stretch.start, j] / power) * (grid.at**power)[:, None]
                forced.append(late)
                slopes.append(slope)
            result.append((np.hstack(forced), np.hstack(slopes)))
        return result

    def nuisance(self, o: int, theta: Array) -> list[Array]:
        """Per segment, the columns of the initial state, the offset (an integrator's initial state) and the drift."""
        structure = self.structures[o]
        A, _ = structure.system(theta, self.scale)
        n = structure.states
        result = []
        for grid in self.grids:
            # the last row of e^(A t) moves as a state under A'
            free = grid.states(A.T.copy(), np.zeros(n), np.zeros(grid.count), np.eye(n)[-1])[grid.wanted]
            columns = [free] if structure.integrators else [free, np.ones((grid.at.size, 1))]
            if self.drift[o]:
                power = max(1, structure.integrators)
                columns.append(((grid.at / grid.t[-1]) ** power)[:, None])
            result.append(np.hstack(columns))
        return result

    def parts(self, o: int, theta: Array, delays: Array) -> list[Part]:
        """All columns of one output at trial parameters."""
        result = []
        for (forced, slope), columns in zip(
            self.columns(o, self.undelayed(o, theta), delays), self.nuisance(o, theta), strict=True
        ):
            basis, back = _orthonormal(columns)
            result.append(Part(forced, slope, basis, back, columns))
        return result


def _orthonormal(columns: Array) -> tuple[Array, Array]:
    """An orthonormal basis of the columns' span, and the columns' coefficients of each basis vector."""
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    size[size == 0.0] = 1.0
    Q, R = np.linalg.qr(columns / size)
    U, s, Vt = np.linalg.svd(R)
    rank = int((s > RANK * s[0]).sum())
    return Q @ U[:, :rank], (Vt[:rank].T / s[:rank]) / size[:, None]


@dataclass(frozen=True)
class Linear:
    """The linear parameters of one output at trial parameters, and what they leave."""

    gains: Array  # (gains,)
    residuals: list[Array]  # per segment
    basis: Array  # (samples, gains): orthonormal, spans the forced columns without their nuisance part
    coefficients: list[Array]  # per segment, of the nuisance columns


def _solve_linear(parts: list[Part], y: list[Array]) -> Linear:
    projected = [p.forced - p.basis @ (p.basis.T @ p.forced) for p in parts]
    reduced = [v - p.basis @ (p.basis.T @ v) for p, v in zip(parts, y, strict=True)]
    basis, root = np.linalg.qr(np.concatenate(projected))
    size = np.abs(np.diag(root))
    if (size <= RANK * max(float(np.abs(parts[0].forced).max()), 1e-300)).any():
        gains = np.linalg.lstsq(root, basis.T @ np.concatenate(reduced), rcond=None)[0]
    else:
        gains = np.linalg.solve(root, basis.T @ np.concatenate(reduced))
    residuals: list[Array] = [r - f @ gains for r, f in zip(reduced, projected, strict=True)]
    coefficients = [p.back @ (p.basis.T @ (v - p.forced @ gains)) for p, v in zip(parts, y, strict=True)]
    return Linear(gains, residuals, basis, coefficients)


class Trial:
    """Everything known at one value of the nonlinear parameters."""

    def __init__(self, problem: Problem, theta: Array) -> None:
        self.problem, self.theta = problem, theta.copy()
        self.parts = [problem.parts(o, theta[s], theta[problem.delays]) for o, s in enumerate(problem.slices)]
        self.linear = [_solve_linear(parts, y) for parts, y in zip(self.parts, problem.y, strict=True)]

    def residual(self) -> Array:
        """In standard deviations, all outputs."""
        each = [np.concatenate(lin.residuals) / s for lin, s in zip(self.linear, self.problem.sigma, strict=True)]
        return np.concatenate(each)

    def square(self) -> float:
        """Sum of squares, in variances."""
        residual = self.residual()
        return float(residual @ residual)

    def derivatives(self, o: int) -> list[Array]:
        """Per segment, the derivative of output o by its nonlinear parameters and the dead times, gains held."""
        problem, linear = self.problem, self.linear[o]
        theta, delays = self.theta[problem.slices[o]], self.theta[problem.delays]

        def output(trial: Array) -> list[Array]:
            forced, nuisance = problem.columns(o, problem.undelayed(o, trial), delays), problem.nuisance(o, trial)
            return [
                f @ linear.gains + n @ c for (f, _), n, c in zip(forced, nuisance, linear.coefficients, strict=True)
            ]

        columns: list[list[Array]] = [[] for _ in problem.grids]
        for k in range(theta.size):
            step = np.zeros(theta.size)
            step[k] = STEP * max(1.0, abs(theta[k]))
            for s, (up, down) in enumerate(zip(output(theta + step), output(theta - step), strict=True)):
                columns[s].append((up - down) / (2.0 * step[k]))
        width = linear.gains.size // delays.size
        for j in range(delays.size):
            own = slice(j * width, (j + 1) * width)
            for s, part in enumerate(self.parts[o]):
                columns[s].append(-part.slope[:, own] @ linear.gains[own])
        return [np.column_stack(c) for c in columns]

    def jacobian(self) -> Array:
        """Derivatives of `residual` by all nonlinear parameters."""
        problem, rows = self.problem, []
        for o in range(len(problem.outputs)):
            projected, basis = self._without_nuisance(o, self.derivatives(o)), self.linear[o].basis
            block = np.zeros((projected.shape[0], self.theta.size))
            own = [*range(problem.slices[o].start, problem.slices[o].stop), *range(*problem.delays.indices(10**6))]
            block[:, own] = -(projected - basis @ (basis.T @ projected)) / problem.sigma[o]
            rows.append(block)
        return np.concatenate(rows)

    def _without_nuisance(self, o: int, columns: list[Array]) -> Array:
        each: list[Array] = [c - p.basis @ (p.basis.T @ c) for c, p in zip(columns, self.parts[o], strict=True)]
        return np.concatenate(each)


def solve(problem: Problem, starts: Sequence[Array]) -> Trial:
    """The best of the local solutions that the starts lead to; only the best few are followed all the way."""
    low, high = problem.bounds()

    found = [np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low)) for start in starts]
    for tolerance, evaluations, survivors in DESCENT:
        trials = _Trials(problem)
        descents = [
            least_squares(
                trials.residual, start, jac=trials.jacobian, bounds=(low, high), x_scale="jac",
                ftol=tolerance, xtol=10.0 * tolerance, gtol=tolerance, max_nfev=evaluations,
            )
            for start in found
        ]  # fmt: skip
        found = [descent.x for descent in sorted(descents, key=lambda descent: float(descent.cost))[:survivors]]
    best = problem.ordered(found[0])
    best[problem.delays][best[problem.delays] < NOTHING * problem.shortest] = 0.0
    return Trial(problem, best)


class _Trials:
    """The last trial is kept: the solver asks for residual and Jacobian at the same point."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.last: Trial | None = None

    def __call__(self, theta: Array) -> Trial:
        if self.last is None or not np.array_equal(self.last.theta, theta):
            self.last = Trial(self.problem, theta)
        return self.last

    def residual(self, theta: Array) -> Array:
        return self(theta).residual()

    def jacobian(self, theta: Array) -> Array:
        return self(theta).jacobian()


def search(problem: Problem) -> Trial:
    """The best fit of one output, from a scan of time constants and dead times.

    The zeros of a free order imitate a dead time so well that the sum of squares has a valley for each of several dead
    times. So its scan keeps clearly different dead times, and with the poles found all dead times are tried again.
    """
    found = solve(problem, _scan(problem))
    for _ in range(ROUNDS if problem.structures[0].order else 0):
        before, found = found, solve(problem, [found.theta, *_other_valleys(found)])
        if found.square() > 0.99 * before.square():
            break
    return found


def _other_valleys(found: Trial) -> list[Array]:
    """Starts with the same poles and one dead time in another valley."""
    problem, starts = found.problem, []
    cost = _profile(problem, found.theta[problem.slices[0]])
    grid = np.linspace(0.0, problem.longest_delay, AGAIN)
    for k in range(problem.delays.start, problem.delays.stop):
        trials = [np.r_[found.theta[:k], delay, found.theta[k + 1 :]] for delay in grid]
        starts += [trials[i] for i in _valleys(np.array([cost(trial[problem.delays]) for trial in trials]))[:BEST]]
    return starts


def _scan(problem: Problem) -> list[Array]:
    """Starts from a grid of time constants and dead times, first common to all inputs, then each input's own."""
    structure, m = problem.structures[0], problem.record.u.shape[1]
    found: list[tuple[float, Array, Array]] = []
    times = np.geomspace(problem.shortest / 3.0, problem.longest, TIMES) if structure.names else [problem.shortest]
    for time in times:
        grid = _delay_grid(problem, float(time))
        for theta in structure.starts(float(time), problem.scale):
            cost = _profile(problem, theta)
            costs = np.array([cost(np.full(m, delay)) for delay in grid])
            found += [(costs[i], np.r_[theta, np.full(m, grid[i])], grid) for i in _valleys(costs)]
    found.sort(key=lambda item: item[0])
    if m > 1:
        found[:REFINED] = sorted((_own_delays(problem, *item) for item in found[:REFINED]), key=lambda item: item[0])
    starts = [start for _, start, _ in found]
    result = starts[:BEST]
    for start in starts[BEST:] if structure.order else ():
        here = start[problem.delays]
        far = APART * np.maximum(here, problem.shortest)
        if len(result) < VALLEYS and all((np.abs(here - other[problem.delays]) > far).any() for other in result):
            result.append(start)
    return result


def _own_delays(problem: Problem, value: float, start: Array, grid: Array) -> tuple[float, Array, Array]:
    """One input after the other at its best dead time on the grid."""
    cost = _profile(problem, start[problem.slices[0]])
    for k in range(problem.delays.start, problem.delays.stop):
        for delay in grid:
            trial = np.r_[start[:k], delay, start[k + 1 :]]
            now = cost(trial[problem.delays])
            if now < value:
                value, start = now, trial
    return value, start, grid


def _profile(problem: Problem, theta: Array) -> Callable[[Array], float]:
    """The sum of squares by the dead times, all else at its best but the poles."""
    bases = [_orthonormal(columns)[0] for columns in problem.nuisance(0, theta)]
    reduced = [v - Q @ (Q.T @ v) for Q, v in zip(bases, problem.y[0], strict=True)]
    square, undelayed = sum(float(v @ v) for v in reduced), problem.undelayed(0, theta)

    def cost(delays: Array) -> float:
        gram: Array = np.zeros(())
        match: Array = np.zeros(())
        for (forced, _), Q, v in zip(problem.columns(0, undelayed, delays), bases, reduced, strict=True):
            hidden = Q.T @ forced
            gram, match = gram + forced.T @ forced - hidden.T @ hidden, match + forced.T @ v
        return square - float(match @ np.linalg.lstsq(gram, match, rcond=RANK)[0])

    return cost


def _valleys(costs: Array) -> NDArray[np.intp]:
    """Where costs on a grid are least, the deepest first."""
    walled = np.r_[np.inf, costs, np.inf]
    lowest = np.flatnonzero((costs < walled[:-2]) & (costs <= walled[2:]))
    return lowest[np.argsort(costs[lowest])]


def _delay_grid(problem: Problem, time: float) -> Array:
    """Dead times as dense as this time constant asks for, logarithmic where that would be too many."""
    step = max(0.5 * problem.shortest, 0.5 * time)
    count = int(problem.longest_delay / step) + 2
    if count <= DELAYS:
        return np.linspace(0.0, problem.longest_delay, count)
    return np.concatenate([[0.0], np.geomspace(step / 2.0, problem.longest_delay, DELAYS - 1)])
