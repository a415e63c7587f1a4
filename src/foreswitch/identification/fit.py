"""The result of an identification."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter, ss2tf

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.json import plain_data
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import tree
from foreswitch._helpers.units import NO_UNIT, described, name_and_unit, rate_unit, unit_of_names
from foreswitch.identification import plots, report
from foreswitch.identification.diagnosis import diagnose, indistinguishable
from foreswitch.identification.fitting import Problem, Trial
from foreswitch.identification.record import Record
from foreswitch.identification.statistics import Estimate
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import transition

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from foreswitch.presentation.report import Report

__all__ = ["Fit", "FittedStructure", "prediction_errors"]

#: Input noise that a model is credited with at least, in shares of the input's range: no plant repeats itself better.
REPEATS = 0.02
#: Share of input noise in the innovations that is looked for, as powers of ten of its variance over the sensor's.
RATIOS = (-12.0, 6.0)


@dataclass(frozen=True)
class FittedStructure:
    """One structure of a comparison.

    Attributes
    ----------
    output : str
        Name of the output.
    structure : str
    drift : bool
    criterion : float
        Bayesian information criterion, relative to the best.
    held_back : float
        Root mean square error on the stretch that was not fitted [unit of y]; NaN if nothing was held back.
    fit_percent : float
    chosen : bool
    """

    output: str
    structure: str
    drift: bool
    criterion: float
    held_back: float
    fit_percent: float
    chosen: bool


def prediction_errors(trial: Trial, problem: Problem) -> list[list[Array]]:
    """Per output and segment, what the fitted model leaves of other samples.

    A segment of which some samples were fitted keeps its initial state, offset and drift; any other gets its own by
    least squares.
    """
    fitted = {stretch.start: i for i, stretch in enumerate(trial.problem.stretches)}
    result = []
    for o, own in enumerate(problem.slices):
        parts = problem.parts(o, trial.theta[own], trial.theta[problem.delays])
        errors: list[Array] = []
        for part, grid, y, stretch in zip(parts, problem.grids, problem.y[o], problem.stretches, strict=True):
            left = y - part.forced @ trial.linear[o].gains
            if stretch.start in fitted:
                s = fitted[stretch.start]
                coefficients = trial.linear[o].coefficients[s].copy()
                if problem.drift[o]:  # its column counts in lengths of the segment
                    ratio = float(grid.t[-1] / trial.problem.grids[s].t[-1])
                    coefficients[-1] *= ratio ** max(1, problem.structures[o].integrators)
                errors.append(left - part.nuisance @ coefficients)
            else:
                errors.append(left - part.basis @ (part.basis.T @ left))
        result.append(errors)
    return result


class Fit:
    """A plant identified from a record.

    Attributes
    ----------
    plant : Plant
        Ready for a controller.
    parameters : dict
        ``{name: (value, standard error)}``: gains, lags [s] or frequency [rad/s] and damping, coefficients of a free
        order, and ``delay`` [s]; with several inputs or outputs the names carry their numbers, ``K_12`` from input 2
        to output 1.
    fit_percent : float or ndarray, shape (q,)
        ``100 (1 - |residual| / |y - mean|)``.
    candidates : list of FittedStructure
        The structures compared, best criterion first.
    record : Record
    estimate : Estimate
        The numbers behind: covariance, residuals, offsets by segment.
    """

    def __init__(self, record: Record, estimate: Estimate, candidates: list[FittedStructure]) -> None:
        self.record, self.estimate, self.candidates = record, estimate, candidates
        self.plant: Plant = estimate.plant
        self.parameters = {
            name: (float(estimate.values[name]), float(estimate.errors[name])) for name in estimate.names
        }
        each = np.array([estimate.fit_percent(o) for o in range(self.plant.outputs)])
        self.fit_percent: float | Array = float(each[0]) if each.size == 1 else each

    @property
    def structure(self) -> str | list[str]:
        """Name of the structure of the output, or of each."""
        names = [str(structure) for structure in self.estimate.problem.structures]
        return names[0] if len(names) == 1 else names

    @cached_property
    def warnings(self) -> list[str]:
        """What the data could not tell, or contradicts, in plain words."""
        return diagnose(self.estimate)

    @cached_property
    def dead_time_known(self) -> list[bool]:
        """Per input, whether its dead time is told apart from zero and from a lag."""
        return [not reason for reason in indistinguishable(self.estimate)]

    # ---- Noise ----

    @property
    def measurement_noise(self) -> Array:
        """Variance of the white noise in each output, shape (q,): what `Kalman` asks for."""
        return np.array([sensor for sensor, _ in self._noises])

    def process_noise(self, Ts: float) -> Array:
        """Covariance that the state gathers in one switching period, as `Kalman` asks for.

        The plant is taken to answer each command with an error: white noise at its inputs, of the intensity that makes
        the residuals most likely, and at least 2 % of the input's range.

        Parameters
        ----------
        Ts : float
            Switching period [s].

        Returns
        -------
        ndarray, shape (n, n)
        """
        Ts = check.number("Ts", Ts, above=0.0)
        result = np.zeros((self.plant.states, self.plant.states))
        at = 0
        for structure, (_, density) in zip(self.estimate.problem.structures, self._noises, strict=True):
            own = slice(at, at + structure.states)
            _, gamma = transition(self.plant.A[own, own], self.plant.B[own], Ts)
            result[own, own] = density / Ts * gamma @ gamma.T
            at += structure.states
        return result

    @cached_property
    def _noises(self) -> list[tuple[float, float]]:
        """Per output: variance of the sensor's noise, and of the inputs' times the period they were held [u^2 s]."""
        problem, result, at = self.estimate.problem, [], 0
        spans = [float(np.ptp(problem.record.levels(j))) for j in range(self.plant.inputs)]
        for o, structure in enumerate(problem.structures):
            own = slice(at, at + structure.states)
            at += structure.states
            held = self.record.Ts
            sensor, density = _likely_noise(
                self.plant.A[own, own], self.plant.B[own], self.plant.C[o, own], held, self.estimate.residuals(o)
            )
            result.append((sensor, max(density, held * (REPEATS * min(spans)) ** 2)))
        return result

    # ---- Other records ----

    def simulate(self, record: Record) -> Array:
        """The output that the model gives under a record's commands, at its samples.

        A segment that begins where one of the fitted record began keeps that one's initial state, offset and drift, so
        that what follows the fitted part is predicted; any other segment gets its own by least squares.

        Parameters
        ----------
        record : Record
            Of the same inputs and outputs.

        Returns
        -------
        ndarray, shape (N, q)
            NaN where the record is skipped.

        Raises
        ------
        ValueError
            If the inputs or outputs differ in number.
        """
        old = self.estimate.problem
        if record.u.shape[1] != self.plant.inputs or record.y.shape[1] != self.plant.outputs:
            sizes = f"has {record.u.shape[1]} input(s) and {record.y.shape[1]} output(s)"
            remedy = f"the fit has {self.plant.inputs} and {self.plant.outputs}, and they must agree"
            raise Mistake("record", record, remedy, problem=sizes)
        problem = Problem(record, old.structures, old.drift, old.outputs, old.longest_delay)
        problem.scale = old.scale
        y = np.full(record.y.shape, np.nan)
        for o, errors in enumerate(prediction_errors(self.estimate.trial, problem)):
            for rows, measured, error in zip(problem.samples, problem.y[o], errors, strict=True):
                y[rows, o] = measured - error
        return y

    # ---- What it says of itself ----

    def unit(self, parameter: str) -> str:
        """The unit of one of `parameters`.

        Parameters
        ----------
        parameter : str

        Returns
        -------
        str
            Empty where it has none, or no short one.
        """
        base, _, mark = parameter.partition("_")
        kind = base.rstrip("0123456789")
        if kind in ("delay", "T", "c"):
            return "s"
        if kind == "omega":
            return "rad/s"
        if kind not in ("k", "K"):
            return ""
        o = int(mark[0]) - 1 if self.plant.outputs > 1 else 0
        j = int(mark[-1]) - 1 if self.plant.inputs > 1 else 0
        output, level = (name_and_unit(name)[1] for name in (self.record.output_names[o], self.record.input_names[j]))
        slope = rate_unit(output, self.estimate.problem.structures[o].integrators)
        return "" if slope == "1" else slope if level in NO_UNIT else f"{slope}/{level}"

    def summary(self) -> dict[str, Any]:
        """The fit as plain data: structure, parameters, operating point, noise, what was compared, warnings.

        Returns
        -------
        dict
            Numbers, lists, words and None, which stands for what is not finite; keys say their units, as in
            ``"y_offset [kPa]"``, and each parameter has its own beside it.
        """
        inputs, outputs = self.record.input_names, self.record.output_names
        candidates = []
        for each in self.candidates:
            unit = name_and_unit(each.output)[1]
            candidates.append(
                {described(key, unit) if key == "held_back" else key: value for key, value in asdict(each).items()}
            )
        squared = unit_of_names(outputs)
        found = {
            "structure": np.atleast_1d(self.structure),
            "parameters": {
                name: {"value": value, "standard_error": error, "unit": self.unit(name)}
                for name, (value, error) in self.parameters.items()
            },
            "fit_percent": np.ravel(self.fit_percent),
            described("u_offset", unit_of_names(inputs)): self.plant.u_offset,
            described("y_offset", unit_of_names(outputs)): self.plant.y_offset,
            described("measurement_noise", squared and f"{squared}, squared"): self.measurement_noise,
            "candidates": candidates,
            "inputs": inputs,
            "outputs": outputs,
            "warnings": self.warnings,
        }
        plain: dict[str, Any] = plain_data(found)
        return plain

    def report(self, name: str) -> Report:
        """What was found, how sure it is, and what the data could not tell, to be written as a page.

        Parameters
        ----------
        name : str
            Its heading.

        Returns
        -------
        Report
        """
        return report.fit_report(name, self)

    def plot(self) -> Figure:
        """The record with the simulated fit.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return plots.record_figure(self.estimate)

    def plot_pulses(self) -> Figure | None:
        """The average response to equal pulses, its scatter and the model.

        Returns
        -------
        matplotlib.figure.Figure or None
            None if no pulse of the record repeats.
        """
        return plots.pulse_figure(self.estimate)

    def plot_residuals(self) -> Figure:
        """What the fit leaves, and its autocorrelation.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return plots.residual_figure(self.estimate)

    def __repr__(self) -> str:
        names = [self.structure] if isinstance(self.structure, str) else self.structure
        percent = ", ".join(f"{v:.1f}" for v in np.ravel(self.fit_percent))
        lines = [f"structure  {', '.join(names)}; explains {percent} %"]
        lines += [f"{name:<9}  {value:.5g} +- {error:.2g}" for name, (value, error) in self.parameters.items()]
        lines += [f"warning    {sentence}" for sentence in self.warnings]
        return tree("Fit", lines)


def _likely_noise(A: Array, B: Array, C: Array, Ts: float, residuals: list[Array]) -> tuple[float, float]:
    """Variances of sensor and input noise, the latter times Ts, that make the residuals most likely.

    The residuals are taken as evenly spaced. Whatever their scale, only the ratio of the two is searched for: it sets
    the filter, whose innovations then tell the scale.
    """
    n = C.size
    phi, gamma = transition(A, B, Ts)
    Q = gamma @ gamma.T
    unit = float(C @ Q @ C) or float(np.trace(Q)) or 1.0
    count = sum(r.size for r in residuals)

    def predicted(gain: Array, residual: Array) -> Array:
        """One step ahead, by a filter that has settled."""
        num, den = ss2tf(phi - np.outer(gain, C), gain[:, None], C[None, :], np.zeros((1, 1)))
        result: Array = lfilter(num[0], den, residual)
        return result

    def innovations(power: float) -> tuple[float, float]:
        """Mean square innovation in units of its predicted variance, and that variance; sensor noise is 1."""
        ratio = 10.0**power / unit
        P = solve_discrete_are(phi.T, C[:, None], ratio * Q + 1e-12 * ratio * np.trace(Q) * np.eye(n), np.eye(1))
        variance = float(C @ P @ C) + 1.0
        gain = phi @ P @ C / variance
        total = sum(float(np.sum((r - predicted(gain, r)) ** 2)) for r in residuals)
        return total / count / variance, variance

    def surprise(power: float) -> float:
        try:
            scale, variance = innovations(power)
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.log(max(scale, 1e-300)) + np.log(variance))

    grid = np.linspace(*RATIOS, 19)
    values = [surprise(power) for power in grid]
    best = int(np.argmin(values))
    found = minimize_scalar(surprise, bounds=(grid[max(best - 1, 0)], grid[min(best + 1, 18)]), method="bounded")
    power = float(found.x) if found.fun < values[best] else float(grid[best])
    sensor = innovations(power)[0]
    return sensor, sensor * 10.0**power / unit * Ts
