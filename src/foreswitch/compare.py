"""Laws and baselines on one project: error against switching rate."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreswitch import baselines, plot
from foreswitch.loop import Law
from foreswitch.project import Project
from foreswitch.report import Picture, Report, Section, Table, metric_table, number, tuning_table
from foreswitch.run import Run

__all__ = ["Comparison", "compare"]

#: Costs of a switch, in units of the predicted cost that one switch can save at most.
SWITCH_COSTS = (0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: The parameter that trades error for switching, as multiples of its tuned value.
SPREAD = (0.3, 1.0, 2.0, 4.0, 8.0)
BUDGET = 300

KINDS: dict[str, tuple[type[baselines.Baseline], str]] = {
    "relay": (baselines.Relay, "hysteresis"),
    "PI + PWM": (baselines.PIPWM, "carrier"),
    "Smith + PWM": (baselines.SmithPWM, "carrier"),
}


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
    """

    runs: dict[str, Run]
    curves: dict[str, list[tuple[float, Run]]]
    tuned: dict[str, baselines.Tuned]
    skipped: dict[str, str]

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
                [self.table(), tuning_table(self.tuned, caption)],
                [
                    Picture(
                        "compare", self.figure(), "rms error against switching rate; large markers: as in the table."
                    )
                ],
            ),
            Section(
                "Traces", pictures=[Picture("traces", self.traces(), "Error of each law over time, first output.")]
            ),
        ]
        return Report(f"{name}: laws compared", "The same plant, reference, noise and faults for all.", sections)

    def figure(self) -> Any:
        """Error against switching rate.

        Returns
        -------
        matplotlib.figure.Figure
        """
        figure = plot.figure(1, size=(7.2, 4.2))
        axes = figure.axes[0]
        for (law, curve), colour in zip(self.curves.items(), plot.COLOURS, strict=False):
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

    def traces(self) -> Any:
        """Error of each law over time.

        Returns
        -------
        matplotlib.figure.Figure
        """
        figure = plot.figure(len(self.runs), size=(7.2, 1.1 + 1.1 * len(self.runs)))
        for axes, (law, run), colour in zip(figure.axes, self.runs.items(), plot.COLOURS, strict=False):
            factor, label = plot.time_scale(float(run.t[-1] - run.t[0]))
            plot.draw_output(axes, run.t * factor, (run.y - run.r)[:, 0], None, label="", colour=colour)
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
    worth = _worth(project)
    previewed = bool(project.file.controller.preview)
    laws: dict[str, dict[str, Any]] = {
        "predictive": {},
        **(
            {"predictive, no preview": {"preview": False}} if previewed else {"predictive, preview": {"preview": "lag"}}
        ),
        "one step (Td = Ts)": {"Td": project.controller.Ts},
    }
    runs, curves, tuned, skipped = {}, {}, {}, {}
    for law, changes in laws.items():
        progress(law)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a dwell beyond Td: one step is meant to be that short
            runs[law] = project.simulate(project.build_controller(**changes))
            own = project.file.actuator.switch_cost
            costs = [own, *(cost * worth for cost in SWITCH_COSTS)]
            curves[law] = [
                (float(np.mean(cost)), project.simulate(project.build_controller(switch_cost=cost, **changes)))
                for cost in costs
            ]
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
    return Comparison(runs, curves, tuned, skipped)


def _worth(project: Project) -> float:
    """What one switch moves the predicted cost by when s is half a step of the actuator: the scale of switch costs."""
    controller = project.controller
    steps = [
        np.diff(values).max() * hold[0] for values, hold in zip(controller.levels, controller._law.rows.hold, strict=True)
    ]
    return float(0.5 * max((controller._law.weight * step**2).sum() for step in steps))
