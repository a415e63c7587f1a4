"""`foreswitch compare` on every example, each in a process of its own: run as ``comparisons.py EXAMPLE FOLDER``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from foreswitch.presentation import plots
from foreswitch.project import Project
from foreswitch.studies.comparison import COLOURS, NODE_BUDGET, Comparison, compare, on_share, switching_rate, total_rms
from gallery import examples
from tables import markdown_table
from trade import HORIZONS, PRICES, buys, finish

ROOT = Path(__file__).resolve().parents[2]
#: The longest first.
EXAMPLES = ("attitude", "inverter", "oven", "chamber", "hot_gas")
#: Closed-loop runs for each baseline; `foreswitch compare` takes twice as many unless told otherwise.
BUDGET = 150
#: The tasks differ from the projects in this: all laws know the reference ahead; the currents start on it, so that the
#: error is the ripple's and not the start's.
TASKS: dict[str, dict[str, dict[str, Any]]] = {
    "hot_gas": {"controller": {"preview": "lag"}},
    "inverter": {"simulation": {"x0": [0.0, -20.0]}},
}
#: Short names of the laws, for numbers in the text.
SHORT = {
    "predictive": "law", "predictive, preview": "ahead", "predictive, no preview": "now", "one step, N = 1": "step",
    "horizon, N = 5": "five", "horizon, N = 20": "twenty", "endpoint": "endpoint", "relay": "relay", "PI + PWM": "pi",
    "Smith + PWM": "smith",
}  # fmt: skip
#: What the text says of these figures, by name.
QUOTED = (
    "budget",     "attitude_step_on", "attitude_law_on", "inverter_1_full", "inverter_10_half", "inverter_1_half",
    "inverter_10_quarter", "inverter_1_quarter", "nodes", "prices", "inverter_proven", "oven_1_full", "oven_20_full",
    "oven_1_half", "oven_20_half", "oven_step_rms", "hot_gas_20_full", "hot_gas_1_full", "hot_gas_20_half",
    "hot_gas_endpoint_half", "hot_gas_1_half", "hot_gas_5_quarter", "hot_gas_endpoint_quarter", "hot_gas_20_quarter",
    "chamber_5_full", "chamber_endpoint_full", "chamber_1_full", "chamber_10_half", "chamber_endpoint_half",
    "chamber_1_half", "attitude_20_full", "attitude_20_share", "attitude_endpoint_full", "attitude_endpoint_share",
    "attitude_1_full", "attitude_1_share",
)  # fmt: skip
#: What `one` found, by example.
Found = dict[str, dict[str, Any]]
Running = dict[str, subprocess.Popen[bytes]]


def picture(comparison: Comparison, path: Path) -> None:
    """Error against switching rate; laws that are one share a line, and what is far worse than all tuned laws is cut."""
    names: dict[str, str] = {}
    points: dict[str, list[tuple[float, float]]] = {}
    for law, curve in comparison.curves.items():
        found = [(switching_rate(run), total_rms(run)) for _, run in curve]
        same = next((other for other in points if points[other] == found), None)
        if same is None:
            names[law], points[law] = law, found
        else:
            names[same] = "predictive" if same == "predictive" else names[same]
            names[same] += f" = {law}" if not law.startswith("predictive") else ""
    worst = max(total_rms(comparison.runs[law]) for law in names)
    figure = plots.figure(size=(7.2, 3.4))
    axes = figure.axes[0]
    for law, name in names.items():
        shown = sorted(point for point in points[law] if point[1] <= 5.0 * worst)
        line, here = np.array(shown), comparison.runs[law]
        axes.plot(*line.T, color=COLOURS[law], linewidth=0.9, alpha=0.8, marker="o", markersize=3.0)
        axes.plot(switching_rate(here), total_rms(here), "o", color=COLOURS[law], markersize=7.0, label=name)
    finish(figure, ", ".join(comparison.runs["predictive"].plant.output_names), path, labelsize=7)


def one(name: str, folder: Path) -> None:
    """Pictures, tables and figures of one example."""
    path = ROOT / "examples" / name / "project.toml"
    project = Project.read(path)
    comparison = compare(project, budget=BUDGET)
    picture(comparison, folder / f"{name}.svg")
    task, on_task = project, comparison
    if name in TASKS:
        settings = tomllib.loads(path.read_text(encoding="utf-8"))
        for table, changes in TASKS[name].items():
            settings[table] |= changes
        task = Project(settings, path.parent)
        on_task = compare(task, budget=BUDGET)
    table = comparison.table()
    figures = {
        law: {"rms": total_rms(run), "rate": switching_rate(run), "on": on_share(run)}
        for law, run in comparison.runs.items()
    }
    content = {
        "heads": table.heads, "rows": table.rows, "figures": figures, "skipped": comparison.skipped,
        "horizon": buys(name, task.with_seed(0), on_task, folder),
    }  # fmt: skip
    (folder / f"{name}.json").write_text(json.dumps(content))


def start(folder: Path) -> Running:
    """Begin all comparisons; `collect` waits for them."""
    folder.mkdir(parents=True)
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "error"}
    return {name: subprocess.Popen([sys.executable, __file__, name, str(folder)], env=environment) for name in EXAMPLES}


def collect(running: Running, folder: Path) -> Found:
    """What each of them found."""
    for name, process in running.items():
        if process.wait():
            raise RuntimeError(f"the comparison of examples/{name} failed with exit code {process.returncode}")
    return {name: json.loads((folder / f"{name}.json").read_text()) for name in running}


def values(found: Found) -> dict[str, float]:
    """Numbers for the text: ``oven_relay_rms``, ``oven_20_half`` and the like."""
    named: dict[str, float] = {"budget": BUDGET, "prices": len(PRICES), "nodes": NODE_BUDGET}
    for name, content in found.items():
        for law, figures in content["figures"].items():
            named |= {f"{name}_{SHORT[law]}_{what}": value for what, value in figures.items()}
        horizon = content["horizon"]
        for law, errors in horizon["errors"].items():
            short = SHORT.get(law, law.replace("N = ", ""))
            at = zip(("full", "half", "quarter"), errors, strict=True)
            named |= {f"{name}_{short}_{rate}": error for rate, error in at if error}
            named |= {f"{name}_{short}_share": share for share in horizon["shares"][law]}
        named[f"{name}_proven"] = horizon["proven"][f"N = {HORIZONS[-1]}"]
    return named


def comparison_page(found: Found) -> str:
    """Each example's comparison: picture and table."""
    parts = []
    for example in examples():
        name, table = example.name, found[example.name]
        title = name.replace("_", " ").capitalize()
        caption = f"{title}: rms error against switching rate; large markers: as in the table."
        parts += [
            f"### {title}",
            f"```{{figure}} /_generated/compare/{name}.svg\n:alt: {caption}\n\n{caption}\n```",
            markdown_table(table["heads"], table["rows"]),
        ]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    one(sys.argv[1], Path(sys.argv[2]))
