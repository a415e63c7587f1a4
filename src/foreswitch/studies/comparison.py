"""Laws and baselines on one project: error against switching rate."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from foreswitch._helpers.json import plain_data
from foreswitch._helpers.units import described, unit_of_names
from foreswitch.control.controller import Controller
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.prediction import sliding, transition
from foreswitch.presentation import plots
from foreswitch.presentation.report import Picture, Report, Section, Table, number
from foreswitch.project.project import Project
from foreswitch.simulation import baselines
from foreswitch.simulation.loop import Law
from foreswitch.simulation.report import metric_table, search_table, tuning_table
from foreswitch.simulation.run import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Comparison", "compare"]

#: Costs of a switch, in units of what one pulse of one period changes in the predicted cost.
SWITCH_COSTS = (0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: The same for sums over a horizon, in which a pulse counts at every instant that it lasts.
HORIZON_COSTS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: Horizons beside the project's law, and their names.
HORIZONS = {1: "one step, N = 1", 5: "horizon, N = 5", 20: "horizon, N = 20"}
#: Nodes after which a step takes the best sequence so far, so that a comparison ends.
NODE_BUDGET = 20_000
#: The parameter that trades error for switching, as multiples of its tuned value.
SPREAD = (0.3, 1.0, 2.0, 4.0, 8.0)
BUDGET = 300
#: Also told apart by colour-blind readers; one family, one hue.
COLOURS = {
    "predictive": "#D55E00", "predictive, preview": "#E69F00", "predictive, no preview": "#E69F00",
    "one step, N = 1": "#56B4E9", "horizon, N = 5": "#0072B2", "horizon, N = 20": "#003050",
    "relay": "#009E73", "PI + PWM": "#CC79A7", "Smith + PWM": "#777777",
}  # fmt: skip

KINDS = {known.label: (known.law, known.knob) for known in baselines.BASELINES.values()}


@dataclass(frozen=True)
class Comparison:
    """Runs by law, and how they were found.

    Attributes
    ----------
    runs : dict of str to Run
        The laws as configured or tuned.
    curves : dict of str to list of (float, Run)
        Per law, the parameter that trades error for switching, and the run it gives.
    tuned : dict of str to Tuned
        The baselines.
    skipped : dict of str to str
        Laws that do not fit this project, and why.
    laws : dict of str to Controller
        The predictive laws.
    """

    runs: dict[str, Run]
    curves: dict[str, list[tuple[float, Run]]]
    tuned: dict[str, baselines.Tuned]
    skipped: dict[str, str]
    laws: dict[str, Controller]

    def table(self) -> Table:
        """Error, switching rate and on-time of every law.

        Returns
        -------
        Table
        """
        plain = metric_table(self.runs)
        rows = [
            [*row[:-1], number(switching_rate(run)), number(on_share(run))]
            for row, run in zip(plain.rows, self.runs.values(), strict=True)
        ]
        return Table([*plain.heads[:-1], "switches / s", "time on [%]"], rows)

    def searches(self) -> Table:
        """How much each predictive law had to search.

        Returns
        -------
        Table
        """
        return search_table({law: self.runs[law] for law in self.laws})

    def summary(self) -> dict[str, Any]:
        """Every law as plain data: its run, the curve that trades error for switching, the parameters that were found.

        Returns
        -------
        dict
            By law: numbers, lists, words and None, which stands for what is not finite; keys say their units. Of a law
            that does not fit, why it is left out.
        """
        error = described("rms_error", unit_of_names(next(iter(self.runs.values())).plant.output_names))
        found: dict[str, Any] = {}
        for law, run in self.runs.items():
            curve = [
                {"parameter": value, error: total_rms(each), "switching_rate [1/s]": switching_rate(each)}
                for value, each in self.curves[law]
            ]
            found[law] = run.summary() | {"curve": plain_data(curve)}
        for law, best in self.tuned.items():
            found[law] |= plain_data({"parameters": best.parameters, "evaluations": best.evaluations})
        return found | {law: {"left_out": why} for law, why in self.skipped.items()}

    def report(self, name: str) -> Report:
        """Table and pictures.

        Parameters
        ----------
        name : str
            The project's.

        Returns
        -------
        Report
        """
        caption = (
            "The baselines' parameters: differential evolution on logarithmic scales, the same budget of closed-loop "
            "runs each, smallest rms error on this very task. The predictive laws are not tuned."
        )
        notes = [f"{law} is left out: {why}." for law, why in self.skipped.items()]
        sections = [
            Section(
                "Error against switching rate",
                [
                    "Each curve trades error for switching: the predictive laws by their cost of a switch, the relay by "
                    "its hysteresis, the modulators by their carrier. A law is better where its curve lies lower and "
                    "further left. Where the project previews its reference, the baselines' search may use as much of "
                    "that preview as helps them.",
                    *notes,
                ],
                [
                    self.table(),
                    tuning_table(self.tuned, caption),
                    self.searches(),
                ],
                [Picture("compare", self.plot(), "rms error against switching rate; large markers: as in the table.")],
            ),
            Section(
                "Traces", pictures=[Picture("traces", self.traces(), "Error of each law over time, first output.")]
            ),
        ]
        return Report(f"{name}: laws compared", "The same plant, reference, noise and faults for all.", sections)

    def plot(self) -> Figure:
        """Error against switching rate.

        Returns
        -------
        matplotlib.figure.Figure
        """
        figure = plots.figure(1, size=(7.2, 4.2))
        axes = figure.axes[0]
        for law, curve in self.curves.items():
            colour = COLOURS[law]
            rates = [switching_rate(run) for _, run in curve]
            errors = [total_rms(run) for _, run in curve]
            order = np.argsort(rates)
            line: dict[str, Any] = {"color": colour, "linewidth": 0.9, "alpha": 0.8, "marker": "o", "markersize": 3.0}
            axes.plot(np.array(rates)[order], np.array(errors)[order], **line)
            here = self.runs[law]
            axes.plot(switching_rate(here), total_rms(here), "o", color=colour, markersize=8.0, label=law)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("switches per second", fontsize=9)
        axes.set_ylabel(f"rms error, {', '.join(next(iter(self.runs.values())).plant.output_names)}", fontsize=9)
        axes.legend(fontsize=8, frameon=False)
        return figure

    def traces(self) -> Figure:
        """Error of each law over time.

        Returns
        -------
        matplotlib.figure.Figure
        """
        figure = plots.figure(len(self.runs), size=(7.2, 1.1 + 1.1 * len(self.runs)))
        for axes, (law, run) in zip(figure.axes, self.runs.items(), strict=True):
            colour = COLOURS[law]
            factor, label = plots.time_scale(float(run.t[-1] - run.t[0]))
            plots.draw_output(axes, run.t * factor, (run.y - run.r)[:, 0], None, label="", colour=colour)
            axes.set_title(law, fontsize=8, loc="left")
            axes.set_ylabel("error", fontsize=8)
            axes.set_xlabel(label if axes is figure.axes[-1] else "", fontsize=9)
        return figure


def switching_rate(run: Run) -> float:
    """Changes of level per second, all inputs together; at least one per run, so that it has a logarithm."""
    return max(1.0, float(np.sum(run.metrics()["switches"]))) / float(run.t[-1] - run.t[0])


def on_share(run: Run) -> float:
    """Time away from the safe level in percent, mean over the inputs."""
    return 100.0 * float(np.mean(run.metrics()["on_time"])) / float(run.t[-1] - run.t[0])


def total_rms(run: Run) -> float:
    """rms error over all outputs together."""
    return float(np.sqrt(np.sum(np.square(run.metrics()["rms_error"]))))


def compare(
    project: Project, *, budget: int = BUDGET, seed: int = 0, progress: Callable[[str], None] = lambda _: None
) -> Comparison:
    """Run a project under its own controller, variants of it, and tuned baselines.

    Parameters
    ----------
    project : Project
    budget : int
        Closed-loop runs that each baseline's search may take, about.
    seed : int
        Of the search, and of all that is random where the project names no seed.
    progress : callable, optional
        Told what is being done.

    Returns
    -------
    Comparison
    """
    project = project.with_seed(seed)
    previewed = bool(project.file.controller.preview)
    ahead = "lag" if isinstance(project.controller.objective, Endpoint) else True
    variant = (
        {"predictive, no preview": {"preview": False}} if previewed else {"predictive, preview": {"preview": ahead}}
    )
    settings: dict[str, dict[str, Any]] = {"predictive": {}, **variant}
    settings |= {name: horizon_settings(project, steps) for steps, name in HORIZONS.items()}
    laws, runs, curves, tuned, skipped = {}, {}, {}, {}, {}
    for law, changes in settings.items():
        progress(law)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as in price_curve
            try:
                laws[law] = project.build_controller(**changes)
            except ValueError as error:
                skipped[law] = str(error)
                continue
        curves[law] = price_curve(project, laws[law])
        runs[law] = curves[law][0][1]
    for law, (kind, knob) in KINDS.items():
        progress(f"tuning: {law}")
        try:
            best = project.tune(kind, budget=budget, seed=seed)
        except ValueError as error:
            skipped[law] = str(error)
            continue
        tuned[law], runs[law] = best, best.run
        least = project.controller.Ts if knob == "carrier" else 0.0
        curves[law] = []
        for factor in SPREAD:
            value = max(factor * best.parameters[knob], least)
            baseline: Law = project.build_baseline(kind, **(best.parameters | {knob: value}))
            curves[law].append((value, project.simulate(baseline)))
    return Comparison(runs, curves, tuned, skipped, laws)


def horizon_settings(project: Project, steps: int) -> dict[str, Any]:
    """For `Project.build_controller`: so many periods of the project's sliding variable, weights, preview and price."""
    own = project.controller.objective
    objective = Horizon(
        steps, weight=own.weight, lam=own.lam, relative_degree=own.relative_degree, node_budget=NODE_BUDGET
    )
    price = np.asarray(project.file.actuator.switch_cost)
    if isinstance(own, Endpoint):
        price = 2.0 * price  # its cost halves the squares, a horizon's does not
    return {"objective": objective, "preview": bool(project.file.controller.preview), "switch_cost": price}


def price_curve(project: Project, law: Controller, costs: Sequence[float] | None = None) -> list[tuple[float, Run]]:
    """Runs of a law as it is, then with rising costs of a switch, in units of what one pulse changes in its cost."""
    scale = _worth(law)
    own = HORIZON_COSTS if isinstance(law.objective, Horizon) else SWITCH_COSTS
    runs = [(float(np.mean(law.actuator.switch_cost)), project.simulate(law))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a dwell beyond the horizon: one step is meant to be that short
        for cost in own if costs is None else costs:
            runs.append((cost * scale, project.simulate(law.replace(switch_cost=cost * scale))))
    return runs


def _worth(law: Controller) -> float:
    """What a pulse, one step of an input for one period, changes in the cost: the scale of switch costs."""
    plant, objective = law.plant, law.objective
    lam = np.ones(plant.outputs) * (1.0 if objective.lam is None else np.asarray(objective.lam))
    rows = sliding(plant, lam, law.relative_degree.tolist()).state
    if isinstance(objective, Endpoint):
        first = last = round(objective.Td / law.Ts)
        factor = 0.5
    else:
        (first, last), factor = objective.window or (1, objective.steps), 1.0
    found = []
    for j, values in enumerate(law.levels):
        phi, x = transition(plant.A, plant.B[:, j : j + 1] * np.diff(values).max(), law.Ts)
        cost = 0.0
        for i in range(1, last + 1):
            if i >= first:
                cost += float(np.sum(np.asarray(objective.weight) * (rows @ x)[:, 0] ** 2))
            x = phi @ x
        found.append(factor * cost)
    return max(found)
