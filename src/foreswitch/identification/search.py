"""From a record to a plant: structures compared, the best one reported with what the data could not tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.identification.fit import Fit, FittedStructure, prediction_errors
from foreswitch.identification.fitting import Problem, search, solve
from foreswitch.identification.record import Record
from foreswitch.identification.statistics import Estimate
from foreswitch.identification.structures import STRUCTURES, Structure

__all__ = ["identify"]

#: Samples that structures are compared on; the chosen one is fitted to all.
COARSE = 6000
#: A structure must predict the held-back stretch within this factor of the best; one stretch is a noisy judge.
HELD_BACK = 2.0
#: A drift must lower that error by this factor: it passes for a slow lag, and under regular pulses for a gain.
EARNED = 1.2
#: Changes that every input must make before a drift is tried on a plant that does not integrate: with fewer, drift, slow
#: lag and nonlinearity are one, and extrapolating them is a disaster.
TELLING = 10
#: Criteria this close are a tie, which the fewest unknowns win.
TIE = 10.0
#: Largest dead time looked for, in shares of the longest segment.
LONGEST_DELAY = 0.1


Progress = Callable[[float, str], None]


def identify(
    record: Record,
    structure: str | Sequence[str] = "auto",
    *,
    drift: bool | None = None,
    longest_delay: float | None = None,
    held_back: float = 0.3,
    progress: Progress | None = None,
) -> Fit:
    """A plant from a record of an experiment.

    Fits ``y = sum of gains x poles x dead times + offset + drift + initial state`` to the raw record by separable
    least squares; dead times are continuous.

    Parameters
    ----------
    record : Record
    structure : str, or one per output
        A chain such as ``"integrator+lag"``, ``"lag+pair"``, ``"lag+lag"``; any ``"order n"``; or ``"auto"``, which
        compares the usual ones by information criterion and by their error on held-back data.
    drift : bool, optional
        Whether the output drifts linearly (of an integrator: whether its input has an offset). Default: if the
        information criterion says so.
    longest_delay : float, optional
        Largest dead time to consider [s]. Default: a tenth of the longest segment.
    held_back : float
        Share of the record, its end, on which structures are compared after fitting the rest; 0: none.
    progress : callable, optional
        Told ``(share done, what)`` now and then.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        If an argument is out of range or the record is too short for the structure.

    Examples
    --------
    >>> t = np.arange(0.0, 2.0, 0.01)
    >>> u = (t % 0.5 >= 0.25).astype(float)
    >>> y = 3.0 * np.cumsum(np.r_[np.zeros(6), u[:-6]]) * 0.01 + 0.01 * np.sin(50.0 * t)
    >>> fit = identify(Record(t, u, y), "integrator")
    >>> round(fit.parameters["k"][0], 2), round(fit.parameters["delay"][0], 3)
    (3.0, 0.05)
    """
    if not isinstance(record, Record):
        problem = f"is a {type(record).__name__}"
        raise Mistake("record", record, "give a Record, see Record.read_csv", problem=problem)
    if not 0.0 <= check.number("held_back", held_back) <= 0.8:
        raise Mistake("held_back", held_back, "give a share from 0 to 0.8")
    longest = max(float(record.t[s][-1] - record.t[s][0]) for s in record.segments)
    reach = LONGEST_DELAY * longest if longest_delay is None else check.number("longest_delay", longest_delay, above=0)
    report = progress or (lambda share, what: None)
    q = record.y.shape[1]
    given = [structure] * q if isinstance(structure, str) else list(structure)
    if len(given) != q:
        remedy = f"give one, or one for each of {q} outputs"
        raise Mistake("structure", structure, remedy, problem=f"names {len(given)} structures")
    search = _Search(record, reach, drift, held_back, report)
    rows: list[list[FittedStructure]] = []
    best: list[Estimate] = []
    for o, name in enumerate(given):
        estimates, table = search.output(o, name, (o / q, (o + 0.8) / q))
        best.append(estimates)
        rows.append(table)
    report(0.8, "fitting all samples")
    final = search.final(best)
    report(0.95, "looking for contradictions")
    fit = Fit(record, final, [row for table in rows for row in table])
    report(1.0, "done")
    return fit


class _Search:
    """The comparison of structures, one output at a time, and the joint fit at the end."""

    def __init__(self, record: Record, reach: float, drift: bool | None, held_back: float, report: Progress) -> None:
        self.record, self.reach, self.held_back, self.report = record, reach, held_back, report
        self.drifts = (False, True) if drift is None else (bool(drift),)
        used = np.flatnonzero(record.used)
        share = min(1.0, COARSE / used.size)
        self.coarse = np.random.default_rng(0).random(record.t.size) < share  # one period could beat with the pulses
        changes = [record.edges(j) for j in range(record.u.shape[1])]
        self.telling = min(each.size for each in changes) >= TELLING
        cut = int(used[min(int((1.0 - held_back) * used.size), used.size - 1)])
        later = np.concatenate(changes)
        later = later[later > max(int(each[0]) for each in changes)]
        if later.size and len(record.segments) == 1:  # a stretch without a change judges the tail of a decay only
            cut = int(later[np.argmin(np.abs(later - cut))])
        self.train = np.arange(record.t.size) < cut

    def problem(self, structures: Sequence[Structure], drift: Sequence[bool], outputs: Sequence[int],
                keep: NDArray[np.bool_]) -> Problem:  # fmt: skip
        problem = Problem(self.record, structures, drift, outputs, self.reach, keep)
        unknowns = max(len(s.names) + s.states + 2 for s in structures) + 2 * self.record.u.shape[1]
        if sum(grid.at.size for grid in problem.grids) <= unknowns:
            few = f"too few for the {unknowns} unknowns of {', '.join(map(str, structures))}"
            raise Mistake(
                "structure", structures, "record longer or choose a smaller structure",
                problem=f"has {len(self.record)} samples, {few}", subject="the record",
            )  # fmt: skip
        return problem

    def output(self, o: int, name: str, span: tuple[float, float]) -> tuple[Estimate, list[FittedStructure]]:
        """The best structure for one output, fitted to the coarse samples, and the table."""
        structures = [Structure.parse(item) for item in (STRUCTURES if name == "auto" else (name,))]
        found: list[Estimate] = []
        for i, structure in enumerate(structures):
            hidden = len(structures) > 1 and not self.telling and not structure.integrators
            for drift in self.drifts[:1] if hidden else self.drifts:
                self.report(span[0] + (span[1] - span[0]) * i / len(structures), f"fitting {structure}")
                try:
                    found.append(self._fit(o, structure, drift))
                except ValueError:
                    if len(structures) == 1:
                        raise
        if not found:
            problem = f"has {len(self.record)} samples, too few for any structure"
            raise Mistake("record", self.record, "record longer", problem=problem, subject="the record")
        errors = [self._held_back_error(e) if len(found) > 1 else np.nan for e in found]
        # coloured residuals carry less information than their number says, for all alike
        samples = min(found, key=lambda e: e.variance(0)).independent(0)
        criteria = [e.criterion(samples) for e in found]
        limit = HELD_BACK * np.nanmin(errors) if np.isfinite(errors).any() else np.inf
        able = [i for i, error in enumerate(errors) if not error > limit]
        able = [i for i in able if not self._vain(found, errors, i)] or able
        close = min(criteria[i] for i in able) + TIE
        chosen = min((i for i in able if criteria[i] <= close), key=lambda i: (found[i].unknowns(0), criteria[i]))
        table = [
            FittedStructure(self.record.output_names[o], str(found[i].problem.structures[0]), found[i].problem.drift[0],
                      criteria[i] - min(criteria), errors[i], float(found[i].fit_percent(0)), bool(i == chosen))
            for i in np.argsort(criteria)
        ]  # fmt: skip
        return found[chosen], table

    @staticmethod
    def _vain(found: list[Estimate], errors: list[float], i: int) -> bool:
        """Whether a drift only hides what the structure misses: it predicts no better than none."""
        problem = found[i].problem
        return problem.drift[0] and any(
            other.problem.structures == problem.structures
            and not other.problem.drift[0]
            and error <= EARNED * errors[i]
            for other, error in zip(found, errors, strict=True)
        )

    def _fit(self, o: int, structure: Structure, drift: bool) -> Estimate:
        problem = self.problem([structure], [drift], [o], self.coarse)
        return Estimate(search(problem))

    def _held_back_error(self, estimate: Estimate) -> float:
        """Root mean square error on the end of the record of a fit to its beginning."""
        if self.held_back == 0.0:
            return np.nan
        old, train = estimate.problem, self.coarse & self.train
        try:
            problem = self.problem(old.structures, old.drift, old.outputs, train)
            if {s.start for s in problem.stretches} == set() or not all(
                np.ptp(np.concatenate([problem.record.u[s, j] for s in problem.stretches])) > 0
                for j in range(problem.record.u.shape[1])
            ):
                return np.nan
        except ValueError:
            return np.nan
        theta = problem_theta(old, problem, estimate.trial.theta)
        fitted = solve(problem, [theta])
        rest = Problem(self.record, old.structures, old.drift, old.outputs, self.reach, self.coarse & ~self.train)
        errors = prediction_errors(fitted, rest)[0]
        return float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) if errors else np.nan

    def final(self, parts: list[Estimate]) -> Estimate:
        """All outputs together on all samples: they share the dead times."""
        structures = [e.problem.structures[0] for e in parts]
        drift = [e.problem.drift[0] for e in parts]
        every = np.ones(self.record.t.size, dtype=bool)
        problem = self.problem(structures, drift, range(len(parts)), every)
        problem.sigma = np.array([np.sqrt(max(e.variance(0), 1e-300)) for e in parts])
        if len(parts) == 1 and bool(self.coarse[self.record.used].all()):
            return parts[0]
        weights = np.array([[1.0 / max(e.errors[n], 1e-12) ** 2 for n in e.names[-problem.record.u.shape[1] :]]
                            for e in parts])  # fmt: skip
        delays = np.array([e.trial.theta[e.problem.delays] for e in parts])
        thetas = [problem_theta(e.problem, problem, e.trial.theta)[: -delays.shape[1]] for e in parts]
        start = np.concatenate([*thetas, (weights * delays).sum(axis=0) / weights.sum(axis=0)])
        return Estimate(solve(problem, [start]))


def problem_theta(old: Problem, new: Problem, theta: Array) -> Array:
    """Parameters of one output in another problem's time scale, which only a free order has."""
    structure, result = old.structures[0], theta.copy()
    if structure.order:
        ratio = new.scale / old.scale
        powers = np.array([1.0, 2.0] * (structure.order // 2) + [1.0] * (structure.order % 2))
        result[: structure.order] *= ratio**powers
    return result
