"""What a solved fit says: parameters with standard errors, operating point, and the plant for a controller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import chi2

from foreswitch._helpers.check import Array
from foreswitch.identification.fitting import Problem, Trial
from foreswitch.model.plant import Plant

__all__ = ["Estimate", "autocorrelation", "independent"]

#: Lags of the whiteness test, and the probability below which residuals count as coloured.
LAGS, WHITE = 20, 1e-3


def autocorrelation(parts: list[Array], lags: int) -> Array:
    """Autocorrelation of residuals in separate stretches, lags 0 to ``lags``, shape (lags + 1,)."""
    total = sum(float(r @ r) for r in parts)
    return np.array([sum(float(r[k:] @ r[: r.size - k]) for r in parts if r.size > k) for k in range(lags + 1)]) / total


def independent(parts: list[Array]) -> float:
    """How many independent samples carry as much information as residuals as correlated as these."""
    count, r = sum(part.size for part in parts), float(np.clip(autocorrelation(parts, 1)[1], 0.0, 0.99))
    return max(count * (1.0 - r) / (1.0 + r), min(count, 10.0))


@dataclass(frozen=True)
class Estimate:
    """A fit of one structure per output to a record, with its statistics."""

    trial: Trial

    @property
    def problem(self) -> Problem:
        """What was fitted."""
        return self.trial.problem

    # ---- Residuals ----

    def residuals(self, o: int) -> list[Array]:
        """Residuals of output ``o``, one array per segment."""
        return self.trial.linear[o].residuals

    @cached_property
    def samples(self) -> int:
        """Number of samples of each output that were fitted."""
        return sum(int(grid.at.size) for grid in self.problem.grids)

    def unknowns(self, o: int) -> int:
        """Parameters of one output, nuisance ones included."""
        nonlinear = len(self.problem.structures[o].names) + int(self.problem.record.u.shape[1])
        linear = int(self.trial.linear[o].gains.size)
        return nonlinear + linear + sum(int(part.basis.shape[1]) for part in self.trial.parts[o])

    def variance(self, o: int) -> float:
        """Variance of the residuals of output ``o``."""
        square = sum(float(r @ r) for r in self.residuals(o))
        return square / max(1, self.samples - self.unknowns(o))

    def criterion(self, samples: float) -> float:
        """Bayesian information criterion of one output for that many independent samples; smaller is better."""
        square = sum(float(r @ r) for r in self.residuals(0))
        return float(samples * np.log(max(square, 1e-300) / self.samples) + self.unknowns(0) * np.log(samples))

    def independent(self, o: int) -> float:
        """Samples of output ``o``, counted as independent ones."""
        return independent(self.residuals(o))

    def whiteness(self, o: int) -> tuple[float, Array]:
        """Ljung-Box probability that the residuals of output ``o`` are white, and their autocorrelation."""
        lags = min(LAGS, self.samples // 4)
        r = autocorrelation(self.residuals(o), lags)
        N = self.samples
        statistic = N * (N + 2) * float(np.sum(r[1:] ** 2 / (N - np.arange(1, lags + 1))))
        return float(chi2.sf(statistic, lags)), r

    def fit_percent(self, o: int) -> float:
        """Share of the output's motion that the model explains, 100 (1 - |residual| / |y - mean|)."""
        y = [v - v.mean() for v in self.problem.y[o]]
        moved = sum(float(v @ v) for v in y)
        return float(100.0 * (1.0 - np.sqrt(sum(float(r @ r) for r in self.residuals(o)) / moved)))

    # ---- Parameters ----

    @cached_property
    def values(self) -> dict[str, float]:
        """Every parameter by name."""
        return dict(zip(self.names, self._values(self._vector), strict=True))

    @cached_property
    def names(self) -> list[str]:
        """Structure parameters and gains of each output, then dead times; numbered where there are several."""
        q, m = len(self.problem.outputs), self.problem.record.u.shape[1]
        result = []
        for o, structure in enumerate(self.problem.structures):
            result += [name + (f"_{o + 1}" if q > 1 else "") for name in structure.names]
            for j in range(m):
                mark = "_" * (q > 1 or m > 1) + f"{o + 1}" * (q > 1) + f"{j + 1}" * (m > 1)
                bases = [f"b{i + 1}" for i in range(structure.order)] if structure.order else [structure.gain]
                result += [base + mark for base in bases]
        return result + ["delay" + (f"_{j + 1}" if m > 1 else "") for j in range(m)]

    @cached_property
    def _vector(self) -> Array:
        return np.concatenate([self.trial.theta, *(linear.gains for linear in self.trial.linear)])

    def _gains(self, vector: Array) -> list[Array]:
        sizes = [linear.gains.size for linear in self.trial.linear]
        return np.split(vector[self.trial.theta.size :], np.cumsum(sizes)[:-1])

    def _values(self, vector: Array) -> Array:
        """Parameters in the order of `names` from the numbers that were fitted."""
        p, m, result = self.problem, self.problem.record.u.shape[1], []
        for structure, own, gains in zip(p.structures, p.slices, self._gains(vector), strict=True):
            theta = vector[own]
            result.append(structure.nonlinear(theta, p.scale))
            for each in np.split(gains, m):
                result.append(structure.numerator(theta, each, p.scale) if structure.order else each)
        return np.concatenate([*result, vector[p.delays]])

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the parameters in the order of `names`; robust to coloured residuals where they are coloured."""
        jacobian, h = [], 1e-6
        for k in range(self._vector.size):
            step = np.zeros(self._vector.size)
            step[k] = h * max(abs(self._vector[k]), 1e-3)
            up, down = self._values(self._vector + step), self._values(self._vector - step)
            jacobian.append((up - down) / (2.0 * step[k]))
        J = np.column_stack(jacobian)
        result: Array = J @ self._fitted_covariance @ J.T
        return result

    @cached_property
    def errors(self) -> dict[str, float]:
        """Standard error of every parameter by name."""
        return dict(zip(self.names, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), strict=True))

    @cached_property
    def _sensitivity(self) -> list[list[Array]]:
        """Per output and segment, the derivative by what was fitted, (W, unknowns), nuisance part not removed."""
        result: list[list[Array]] = []
        at = self.trial.theta.size
        for o, linear in enumerate(self.trial.linear):
            own = [*range(self.problem.slices[o].start, self.problem.slices[o].stop)]
            own += [*range(self.problem.delays.start, self.problem.delays.stop)]
            own += [*range(at, at + linear.gains.size)]
            at += linear.gains.size
            each: list[Array] = []
            for derivative, part in zip(self.trial.derivatives(o), self.trial.parts[o], strict=True):
                block = np.zeros((derivative.shape[0], self._vector.size))
                block[:, own] = np.hstack([derivative, part.forced])
                each.append(block)
            result.append(each)
        return result

    @cached_property
    def _fitted_covariance(self) -> Array:
        information = np.zeros((self._vector.size, self._vector.size))
        noise = np.zeros_like(information)
        for o, blocks in enumerate(self._sensitivity):
            variance = max(self.variance(o), 1e-300)
            white = self.whiteness(o)[0] >= WHITE
            for block, part, residual in zip(blocks, self.trial.parts[o], self.residuals(o), strict=True):
                G = block - part.basis @ (part.basis.T @ block)
                own = G.T @ G / variance
                information += own
                noise += own if white else _long_run(G * residual[:, None]) / variance**2
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse = np.linalg.pinv(information / np.outer(size, size), rcond=1e-14) / np.outer(size, size)
        result: Array = inverse @ noise @ inverse
        return result

    # ---- Operating point and plant ----

    def offsets(self, o: int) -> list[tuple[float, float]]:
        """Per segment, of output ``o`` at its end: offset of y (of an integrator, drift per second), standard error."""
        problem, structure = self.problem, self.problem.structures[o]
        white, variance, result = self.whiteness(o)[0] >= WHITE, self.variance(o), []
        for s, (grid, part, block) in enumerate(
            zip(problem.grids, self.trial.parts[o], self._sensitivity[o], strict=True)
        ):
            want, direct = np.zeros(part.nuisance.shape[1]), np.zeros(self._vector.size)
            if structure.integrators and problem.drift[o]:
                want[-1] = 1.0 / grid.t[-1] ** structure.integrators
            elif not structure.integrators:
                want[structure.states :] = 1.0
            value = float(want @ self.trial.linear[o].coefficients[s])
            if not structure.integrators:  # what the first command gives at rest is not offset
                first = problem.record.u[problem.stretches[s].start]
                value -= float(self._static_gain(o, self._vector) @ first)
                for k in range(direct.size if first.any() else 0):
                    step = np.zeros(direct.size)
                    step[k] = 1e-6 * max(abs(self._vector[k]), 1e-3)
                    change = self._static_gain(o, self._vector + step) - self._static_gain(o, self._vector - step)
                    direct[k] = -float(change @ first) / (2.0 * step[k])
            row = (want @ part.back) @ part.basis.T
            own = variance * float(row @ row)
            if not white:
                own = max(own, float(_long_run((row * self.residuals(o)[s])[:, None])[0, 0]))
            spread = direct - row @ block
            result.append((value, max(own + float(spread @ self._fitted_covariance @ spread), 0.0) ** 0.5))
        return result

    def _static_gain(self, o: int, vector: Array) -> Array:
        """Final value per unit of each input, (m,)."""
        p = self.problem
        structure, theta = p.structures[o], vector[p.slices[o]]
        gains = np.split(self._gains(vector)[o], p.record.u.shape[1])
        den = structure.denominator(theta, p.scale)
        return np.array([structure.numerator(theta, each, p.scale)[-1] / den[-1] for each in gains])

    @cached_property
    def plant(self) -> Plant:
        """The fitted plant; the states of each output are y, y', ... unless it has zeros."""
        p, record = self.problem, self.problem.record
        m, blocks, inputs, outputs, y_offset = record.u.shape[1], [], [], [], []
        slopes, gains = [], []  # of the integrating outputs, in standard deviations
        for o, structure in enumerate(p.structures):
            n, theta = structure.states, self.trial.theta[p.slices[o]]
            a = structure.denominator(theta, p.scale)[1:]
            numerators = [structure.numerator(theta, each, p.scale) for each in np.split(self.trial.linear[o].gains, m)]
            shift = np.eye(n, k=1)
            if structure.order:
                shift[:, 0] -= a
                blocks.append(shift)
                inputs.append(np.array(numerators).T)
            else:
                shift[-1] -= a[::-1]
                blocks.append(shift)
                inputs.append(np.outer(np.eye(n)[-1], [num[-1] for num in numerators]))
            outputs.append(np.eye(1, n))
            offset = float(np.mean([value for value, _ in self.offsets(o)]))
            if structure.integrators:
                y_offset.append(0.0)
                slopes.append(structure.integrators * offset / p.sigma[o])  # of two integrators: t^2 / 2
                gains.append(self.trial.linear[o].gains / p.sigma[o])
            else:
                y_offset.append(offset)
        u_offset = -np.linalg.lstsq(np.array(gains), np.array(slopes), rcond=None)[0] if gains else np.zeros(m)
        return Plant(
            block_diag(*blocks), np.vstack(inputs), block_diag(*outputs),
            input_delay=self.trial.theta[p.delays],
            u_offset=u_offset, y_offset=y_offset, input_names=record.input_names,
            output_names=[record.output_names[i] for i in p.outputs],
        )  # fmt: skip


def _long_run(scores: Array) -> Array:
    """Covariance of the sum of autocorrelated rows (Newey and West 1987)."""
    lags = min(scores.shape[0] - 1, int(4.0 * (scores.shape[0] / 100.0) ** (2.0 / 9.0)) + 8)
    result = scores.T @ scores
    for k in range(1, lags + 1):
        cross = scores[k:].T @ scores[:-k]
        result += (1.0 - k / (lags + 1.0)) * (cross + cross.T)
    return result
