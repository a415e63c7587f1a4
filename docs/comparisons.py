"""`foreswitch compare` on every example, each in a process of its own: run as ``comparisons.py EXAMPLE FOLDER``."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import ticker

from foreswitch.presentation import plots, report
from foreswitch.project import Project
from foreswitch.simulation.run import Run
from foreswitch.studies.comparison import (
    COLOURS,
    KINDS,
    NODE_BUDGET,
    Comparison,
    compare,
    horizon_settings,
    on_share,
    price_curve,
    switching_rate,
    total_rms,
)

ROOT = Path(__file__).resolve().parent.parent
#: The longest first.
EXAMPLES = ("attitude", "inverter", "oven", "chamber", "hot_gas")
#: Closed-loop runs for each baseline; `foreswitch compare` takes twice as many unless told otherwise.
BUDGET = 150
#: Short names of the laws, for numbers in the text.
SHORT = {
    "predictive": "law", "predictive, preview": "ahead", "predictive, no preview": "now", "one step, N = 1": "step",
    "horizon, N = 5": "five", "horizon, N = 20": "twenty", "endpoint": "endpoint", "relay": "relay", "PI + PWM": "pi",
    "Smith + PWM": "smith",
}  # fmt: skip

Values = dict[str, str]
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
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(ticker.LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter("{x:g}")
    axes.tick_params(which="minor", labelsize=7)
    axes.set_xlabel("switches per second", fontsize=9)
    axes.set_ylabel("rms error, " + ", ".join(comparison.runs["predictive"].plant.output_names), fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, metadata={"Date": None})


# What the horizon buys -----------------------------------------------------------------------------------------------

HORIZONS = (1, 2, 5, 10, 20)
#: Prices of a switch, in units of what one pulse changes in the cost.
PRICES = (0.0, *np.geomspace(0.01, 300.0, 37))
#: The tasks differ from the projects in this: all laws know the reference ahead; the currents start on it, so that the
#: error is the ripple's and not the start's.
TASKS: dict[str, dict[str, dict[str, Any]]] = {
    "hot_gas": {"controller": {"preview": "lag"}},
    "inverter": {"simulation": {"x0": [0.0, -20.0]}},
}
#: A horizon is enough where its error is at most this much above that of the best one.
ENOUGH = 1.1
SHADES = ("#8fd0f5", "#56B4E9", "#0072B2", "#00497a", "#00203a")
STYLES = {
    "endpoint": (COLOURS["predictive"], "s"), "relay": (COLOURS["relay"], "^"), "PI + PWM": (COLOURS["PI + PWM"], "D"),
    "Smith + PWM": (COLOURS["Smith + PWM"], "v"),
}  # fmt: skip


@dataclass(frozen=True)
class Point:
    """A run: switching rate, error, time on; what a search took, and the share of its steps proven optimal [%]."""

    rate: float
    error: float
    on: float
    nodes: int
    proven: float


def point(run: Run) -> Point:
    proven = 100.0 * float(np.mean(run.nodes < NODE_BUDGET))
    return Point(switching_rate(run), total_rms(run), on_share(run), int(run.nodes.max()), proven)


def trade(project: Project, comparison: Comparison) -> dict[str, list[Point]]:
    """Points of every law: the horizons and the endpoint over the price of a switch, the baselines as compared."""
    found = {}
    for steps in HORIZONS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a dwell beyond the horizon
            law = project.build_controller(**horizon_settings(project, steps))
        found[f"N = {steps}"] = price_curve(project, law, PRICES)
    found["endpoint"] = price_curve(project, project.controller, PRICES)
    found |= {law: comparison.curves[law] for law in KINDS}
    return {law: [point(run) for _, run in curve] for law, curve in found.items()}


def frontier(points: list[Point]) -> list[Point]:
    """The runs that no other run of the law beats in both, by rising rate."""
    kept: list[Point] = []
    for p in sorted(points, key=lambda p: (p.rate, p.error)):
        if not kept or p.error < kept[-1].error:
            kept.append(p)
    return kept


def at(points: list[Point], rate: float) -> float | None:
    """The error where the law's line in the picture crosses a switching rate; none left of its first point."""
    best = frontier(points)
    if rate < best[0].rate:
        return None
    logs = np.log([[p.rate, p.error] for p in best]).T
    return float(np.exp(np.interp(np.log(rate), *logs)))


def buys_picture(points: dict[str, list[Point]], rates: list[float], name: str, path: Path) -> None:
    """Every run a dot; lines join those that no other run of the law beats in both."""
    figure = plots.figure(size=(7.2, 3.8))
    axes = figure.axes[0]
    styles = {f"N = {N}": (shade, "o") for N, shade in zip(HORIZONS, SHADES, strict=True)} | STYLES
    for law in points:
        (colour, mark), best = styles[law], frontier(points[law])
        axes.plot([p.rate for p in points[law]], [p.error for p in points[law]], mark, color=colour, markersize=2.0,
                  alpha=0.35)  # fmt: skip
        dashes = "--" if law == "endpoint" else "-"  # it may lie on a horizon's
        axes.plot([p.rate for p in best], [p.error for p in best], dashes, color=colour, linewidth=1.2, marker=mark,
                  markersize=3.2, label=law)  # fmt: skip
    for rate, word in zip(rates, ("R", "R/2", "R/4"), strict=True):
        axes.axvline(rate, color="0.75", linewidth=0.8, linestyle=":", zorder=0)
        axes.text(
            rate, 1.0, word, fontsize=7, color="0.4", ha="center", va="bottom", transform=axes.get_xaxis_transform()
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    everything = [p for law in points for p in points[law]]
    slow = [found for law in points if law.startswith("N") if (found := at(points[law], rates[-1]))]
    ends = [frontier(points[law])[-1] for law in points]  # every law shows its smallest error
    axes.set_ylim(0.8 * min(p.error for p in everything), 1.5 * max([*slow, *(p.error for p in ends)]))
    axes.set_xlim(0.8 * min(rates[-1] / 1.5, *(p.rate for p in ends)), 1.2 * max(p.rate for p in everything))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(ticker.LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter("{x:g}")
    axes.tick_params(which="minor", labelsize=8, length=3.5, pad=3.5)
    axes.set_xlabel("switches per second", fontsize=9)
    axes.set_ylabel(f"rms error, {name}", fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, metadata={"Date": None})


def buys(name: str, project: Project, comparison: Comparison, folder: Path) -> dict[str, Any]:
    """Picture, table and figures: every horizon beside the endpoint law and the tuned baselines."""
    points = trade(project, comparison)
    own = switching_rate(comparison.runs["predictive"])
    digit = 10.0 ** (np.floor(np.log10(own)) - 1.0)
    rate = float(np.ceil(own / digit) * digit)  # two digits, rounded up
    rates = [rate, rate / 2.0, rate / 4.0]
    buys_picture(points, rates, ", ".join(project.plant.output_names), folder / f"{name}_horizon.svg")
    rows, errors = [], {}
    for law, dots in points.items():
        errors[law] = [at(dots, each) for each in rates]
        searched = law not in KINDS
        fast = [p for p in frontier(dots) if p.rate <= rate]
        rows.append([
            law, *(report.number(e) if e else "" for e in errors[law]), report.number(fast[-1].on) if fast else "",
            str(max(p.nodes for p in dots)) if searched else "",
            f"{min(p.proven for p in dots):.4g}" if searched else "",
        ])  # fmt: skip
    enough = []
    for i in range(len(rates)):
        reached = {N: errors[f"N = {N}"][i] for N in HORIZONS if errors[f"N = {N}"][i]}
        enough.append(min((N for N, e in reached.items() if e <= ENOUGH * min(reached.values())), default=0))
    return {"rows": rows, "errors": errors, "rate": rate, "enough": enough}


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


def collect(
    running: Running, folder: Path
) -> tuple[dict[str, dict[str, list[list[str]]]], dict[str, dict[str, Any]], Values]:
    """Tables by example, what the horizon buys, and numbers for the text: ``oven_relay_rms`` and the like."""
    tables, bought, values = {}, {}, {}
    for name, process in running.items():
        if process.wait():
            raise RuntimeError(f"the comparison of examples/{name} failed with exit code {process.returncode}")
        content = json.loads((folder / f"{name}.json").read_text())
        tables[name] = {key: content[key] for key in ("heads", "rows")}
        for law, figures in content["figures"].items():
            values |= {f"{name}_{SHORT[law]}_{what}": report.number(value) for what, value in figures.items()}
        bought[name] = content["horizon"]
        for law, errors in bought[name]["errors"].items():
            short = SHORT.get(law, law.replace("N = ", ""))
            values |= {
                f"{name}_{short}_{rate}": report.number(error)
                for rate, error in zip(("full", "half", "quarter"), errors, strict=True)
                if error
            }
            share = next(row[4] for row in bought[name]["rows"] if row[0] == law)
            values |= {f"{name}_{short}_share": share} if share else {}
        values[f"{name}_proven"] = bought[name]["rows"][len(HORIZONS) - 1][-1]
    return tables, bought, values


# Tables of the examples ----------------------------------------------------------------------------------------------

#: Rows of the tables in the examples' texts (a test holds those against the scripts): example, label, column.
PRINTED = {
    "thermostat_swing": ("oven", "thermostat", 1), "thermostat_rate": ("oven", "thermostat", 2),
    "oven_swing": ("oven", "rest tail, Td = 60 s", 1), "oven_rate": ("oven", "rest tail, Td = 60 s", 2),
    "oven_rms": ("oven", "rest tail, Td = 60 s", 6), "oven_pi": ("oven", "PI + PWM", 6),
    "weak_law": ("oven", "rest tail, weak heater", 3), "weak_pi": ("oven", "PI + PWM, weak heater", 3),
    "relay_hold": ("attitude", "relay, 40 ms", 2), "relay_gas": ("attitude", "relay, 40 ms", 3),
    "law_gas_40": ("attitude", "price 1, 40 ms", 3), "relay_gas_150": ("attitude", "relay", 3),
    "law_gas_150": ("attitude", "price 1", 3), "raw_law": ("attitude", "price 1, 40 ms, raw sensors", 3),
    "raw_relay": ("attitude", "relay, 40 ms, raw sensors", 3),
    "switches_largest": ("chamber", "two thresholds", 1), "chamber_largest": ("chamber", "fill and vent", 1),
    "switches_gas": ("chamber", "two thresholds", 5), "chamber_gas": ("chamber", "fill and vent", 5),
    "comparators": ("inverter", "comparators, 2.5 A", 0), "carrier": ("inverter", "carrier PWM", 0),
    "inverter_4": ("inverter", "predictive, price 4", 0), "clocked_relay": ("inverter", "relay, 0 A", 0),
}  # fmt: skip


def printed() -> Values:
    """Numbers that the examples' texts show."""
    values = {}
    for key, (example, label, column) in PRINTED.items():
        text = (ROOT / "examples" / example / "README.md").read_text(encoding="utf-8")
        row = re.search(rf"^{re.escape(label)}  +(.+)$", text, flags=re.MULTILINE)
        if row is None:
            raise ValueError(f"examples/{example}/README.md has no row {label!r}")
        values[key] = row[1].split()[column]
    return values


# Which law when ------------------------------------------------------------------------------------------------------


def decision_rows(v: Values) -> list[list[str]]:
    """Where each law is enough, with the figures that show it; v holds those of `collect` and `printed`."""
    number = {key: float(value) for key, value in v.items()}
    # what the rows say, lest the figures say something else one day
    assert number["hot_gas_pi_rms"] < number["hot_gas_law_rms"] > number["hot_gas_smith_rms"]
    assert number["hot_gas_ahead_rms"] < min(number[f"hot_gas_{law}_rms"] for law in ("pi", "smith", "relay"))
    assert number["oven_law_rms"] < min(number["oven_smith_rms"], number["oven_pi_rms"])
    assert max(number["attitude_relay_rms"], number["attitude_smith_rms"]) > number["attitude_law_rms"]
    assert 2.0 * number["attitude_law_on"] < min(number["attitude_relay_on"], number["attitude_smith_on"])
    assert number["chamber_law_rms"] < number["chamber_smith_rms"] < number["chamber_pi_rms"]
    assert number["chamber_law_on"] < number["chamber_smith_on"] < number["chamber_relay_on"]
    assert number["inverter_law_rms"] < 0.7 * min(number[f"inverter_{law}_rms"] for law in ("pi", "smith", "relay"))
    assert number["relay_gas"] < number["law_gas_40"]
    assert number["relay_gas_150"] > 5.0 * number["law_gas_150"]
    assert number["carrier"] < number["inverter_4"] < number["comparators"] < 1.2 * number["inverter_4"]
    assert number["raw_relay"] < 0.1 * number["raw_law"]
    assert abs(number["weak_pi"] - 105.0) < abs(number["weak_law"] - 105.0)
    relay, pi, law = "a **relay** is enough", "**PI + PWM** is enough", "**prediction** pays"
    rows = [
        (relay, "a swing of the error is allowed, and switchings are what costs",
         "oven: the thermostat swings by {thermostat_swing} °C and switches {thermostat_rate} times an hour; the "
         "predictive law {oven_swing} °C and {oven_rate} times"),
        (relay, "the dead time is short against the swing that is allowed",
         "attitude, 40 ms: {relay_gas} g/h of propellant against {law_gas_40} g/h"),
        (relay, "comparators switch at once, without clock and dead time",
         "inverter: {comparators} % distortion against {inverter_4} % at about as many switchings; on the clock, one "
         "period late, {clocked_relay} %"),
        (relay, "the state is noisy and nothing filters it; the relay's dead band does",
         "attitude, raw sensors: {raw_relay} g/h against {raw_law} g/h"),
        (pi, "the reference is not known ahead, the task is, and PI can be tuned on it",
         "hot gas: {hot_gas_pi_rms} kPa, behind a Smith predictor {hot_gas_smith_rms} kPa, against {hot_gas_law_rms} "
         "kPa without preview"),
        (pi, "the gain is uncertain and the mean must be right: it integrates, the predictive law does not",
         "oven, heater 10 % weak: {weak_pi} °C in the mean against {weak_law} °C, wanted 105"),
        (pi, "steady state is all that counts",
         "inverter: carrier PWM {carrier} % distortion against {inverter_4} % at as many switchings"),
        ("a **Smith predictor** + PWM is nearly enough", "one loop, preview, a good model, dwell shorter than the carrier",
         "oven: {oven_smith_rms} against {oven_law_rms} °C; chamber: {chamber_smith_rms} against {chamber_law_rms} kPa, "
         "valves open for {chamber_smith_on} against {chamber_law_on} % of the time"),
        (law, "the reference is known ahead",
         "hot gas: {hot_gas_ahead_rms} kPa, nothing tuned; [Baselines](baselines.md) has the others with the same preview"),
        (law, "each switching or each second of opening costs, and the dead time is long",
         "attitude, 150 ms: {law_gas_150} g/h against the relay's {relay_gas_150}; on for {attitude_law_on} % of the time, "
         "relay {attitude_relay_on} %, Smith predictor {attitude_smith_on} %, at an error that is no larger"),
        (law, "opposed actuators must not work against each other",
         "chamber: on for {chamber_law_on} % of the time, PI + PWM {chamber_pi_on} %, relays {chamber_relay_on} %; rms "
         "error {chamber_law_rms}, {chamber_pi_rms} and {chamber_relay_rms} kPa"),
        (law, "several inputs act on several outputs at once",
         "inverter: {inverter_law_rms} A against {inverter_relay_rms} A (relays), {inverter_pi_rms} A (PI + PWM) and "
         "{inverter_smith_rms} A (Smith predictor)"),
    ]  # fmt: skip
    return [[which, when, figures.format_map(v)] for which, when, figures in rows]


if __name__ == "__main__":
    one(sys.argv[1], Path(sys.argv[2]))
