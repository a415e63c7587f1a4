"""A run as tables and as a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foreswitch.control.controller import Controller
from foreswitch.control.decision import Status
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.presentation import plots
from foreswitch.presentation.report import Picture, Report, Section, Table, number

if TYPE_CHECKING:
    from foreswitch.simulation.baselines import Tuned
    from foreswitch.simulation.run import Run

__all__ = [
    "metric_table",
    "run_report",
    "search_figures",
    "search_table",
    "searches",
    "status_counts",
    "status_table",
    "tuning_table",
]


def metric_table(runs: dict[str, Run], unit: str = "") -> Table:
    """Figures of merit, one run a row; several outputs or inputs are listed in their order."""
    in_unit = f" [{unit}]" if unit else ""
    metrics = {name: {k: np.atleast_1d(v) for k, v in run.metrics().items()} for name, run in runs.items()}
    factor, second = (1e3, "ms") if max(np.abs(m["lag"]).max() for m in metrics.values()) < 1.0 else (1.0, "s")
    heads = [
        "",
        f"rms error{in_unit}",
        f"largest error{in_unit}",
        f"lag [{second}]",
        f"rms at that lag{in_unit}",
        "switches",
    ]
    rows = []
    for name, m in metrics.items():
        cells = [
            [number(value) for value in m["rms_error"]],
            [number(value) for value in m["max_error"]],
            [f"{round(factor * value, 2) + 0.0:.2f}" for value in m["lag"]],
            [number(value) for value in m["rms_error_at_lag"]],
            [str(value) for value in m["switches"]],
        ]
        rows.append([name, *(", ".join(cell) for cell in cells)])
    return Table(heads, rows)


def tuning_table(tuned: dict[str, Tuned], caption: str) -> Table:
    """What a search found for each baseline, and how many runs it took."""
    rows = [
        [name, ", ".join(f"{key} {number(value)}" for key, value in best.parameters.items()), str(best.evaluations)]
        for name, best in tuned.items()
    ]
    return Table(["", "best parameters found", "runs"], rows, caption)


def status_counts(run: Run) -> dict[str, int]:
    """How often each status came up, where it did."""
    counts = {status.name: int((run.status == status).sum()) for status in Status}
    return {name: count for name, count in counts.items() if count}


def status_table(run: Run) -> Table:
    """How often each status came up, and what to do about it."""
    rows = [[name, str(count), Status[name].remedy] for name, count in status_counts(run).items()]
    return Table(["status", "periods", "meaning"], rows)


def searches(run: Run) -> bool:
    """Whether the law of a run compares candidates."""
    return isinstance(run.controller, Controller)


def search_figures(run: Run) -> dict[str, float]:
    """Median and largest number of nodes per step, and the share of steps proven optimal [%]."""
    nodes = run.nodes[run.nodes > 0]  # none where there was no measurement yet
    if not nodes.size:
        return {"nodes_median": 0.0, "nodes_max": 0.0, "optimal_percent": 0.0}
    budget = getattr(_objective(run), "node_budget", None)
    proven = 1.0 if budget is None else float(np.mean(nodes < budget))
    return {
        "nodes_median": float(np.median(nodes)), "nodes_max": float(nodes.max()), "optimal_percent": 100.0 * proven,
    }  # fmt: skip


def search_table(runs: dict[str, Run]) -> Table:
    """How much each predictive law had to search."""
    rows = []
    for name, run in runs.items():
        found, objective, law = search_figures(run), _objective(run), run.controller
        moves = (objective.moves or objective.steps) if isinstance(objective, Horizon) else 1
        candidates = len(law.actuator.candidates) if isinstance(law, Controller) else 0
        rows.append([
            name, f"{candidates}^{moves}" if moves > 1 else str(candidates),
            f"{found['nodes_median']:.0f}", f"{found['nodes_max']:.0f}", f"{found['optimal_percent']:.4g}",
        ])  # fmt: skip
    return Table(["", "sequences", "nodes, median", "nodes, largest", "steps proven optimal [%]"], rows)


def _objective(run: Run) -> Endpoint | Horizon | None:
    return run.controller.objective if isinstance(run.controller, Controller) else None


def run_report(name: str, run: Run) -> Report:
    """One run: picture, figures, statuses and the controller's own summary."""
    searched = isinstance(_objective(run), Horizon)
    law = [] if run.controller is None else [Section("Controller", code=repr(run.controller))]
    sections = [
        Section(
            "Run",
            pictures=[Picture("run", run.plot(), "Output over its reference; commands as they are issued.")],
            tables=[metric_table({"this run": run})],
        ),
        *([Section("Search", tables=[search_table({"this run": run})])] if searched else []),
        Section("Status", tables=[status_table(run)]),
        *law,
        Section("Plant", code=repr(run.plant)),
    ]
    lead = f"Closed loop over {plots.duration_text(float(run.t[-1]))}, {run.u.shape[0]} decisions."
    return Report(name, lead, sections)
