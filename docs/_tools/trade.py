"""What a longer horizon buys: every law over the price of a switch, error against switching rate."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import ticker
from matplotlib.figure import Figure

from foreswitch.presentation import plots, report
from foreswitch.project import Project
from foreswitch.simulation.run import Run
from foreswitch.studies.comparison import (
    COLOURS,
    KINDS,
    NODE_BUDGET,
    Comparison,
    horizon_settings,
    on_share,
    price_curve,
    switching_rate,
    total_rms,
)
from gallery import examples
from tables import markdown_table

HORIZONS = (1, 2, 5, 10, 20)
#: Prices of a switch, in units of what one pulse changes in the cost.
PRICES = (0.0, *np.geomspace(0.01, 300.0, 37))
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


def finish(figure: Figure, name: str, path: Path, **ticks: float) -> None:
    """Error against switching rate on logarithmic axes, the laws named beside them; how minor ticks look."""
    axes = figure.axes[0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(ticker.LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter("{x:g}")
    axes.tick_params(which="minor", **ticks)
    axes.set_xlabel("switches per second", fontsize=9)
    axes.set_ylabel(f"rms error, {name}", fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, metadata={"Date": None})


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
    everything = [p for law in points for p in points[law]]
    slow = [found for law in points if law.startswith("N") if (found := at(points[law], rates[-1]))]
    ends = [frontier(points[law])[-1] for law in points]  # every law shows its smallest error
    axes.set_ylim(0.8 * min(p.error for p in everything), 1.5 * max([*slow, *(p.error for p in ends)]))
    axes.set_xlim(0.8 * min(rates[-1] / 1.5, *(p.rate for p in ends)), 1.2 * max(p.rate for p in everything))
    finish(figure, name, path, labelsize=8, length=3.5, pad=3.5)


def buys(name: str, project: Project, comparison: Comparison, folder: Path) -> dict[str, Any]:
    """Picture, table and figures: every horizon beside the endpoint law and the tuned baselines."""
    points = trade(project, comparison)
    own = switching_rate(comparison.runs["predictive"])
    digit = 10.0 ** (np.floor(np.log10(own)) - 1.0)
    rate = float(np.ceil(own / digit) * digit)  # two digits, rounded up
    rates = [rate, rate / 2.0, rate / 4.0]
    buys_picture(points, rates, ", ".join(project.plant.output_names), folder / f"{name}_horizon.svg")
    rows: list[list[str]] = []
    errors: dict[str, list[float | None]] = {}
    shares: dict[str, list[float]] = {}
    proven: dict[str, float] = {}
    for law, dots in points.items():
        errors[law] = [at(dots, each) for each in rates]
        shares[law] = [p.on for p in frontier(dots) if p.rate <= rate][-1:]
        cells = [report.number(e) if e else "" for e in errors[law]]
        cells += [report.number(share) for share in shares[law]] or [""]
        if law not in KINDS:
            proven[law] = min(p.proven for p in dots)
            cells += [str(max(p.nodes for p in dots)), f"{proven[law]:.4g}"]
        rows.append([law, *cells, *[""] * (len(BUYS_HEADS) - len(cells) - 1)])
    enough = []
    for i in range(len(rates)):
        reached = {N: error for N in HORIZONS if (error := errors[f"N = {N}"][i])}
        enough.append(min((N for N, e in reached.items() if e <= ENOUGH * min(reached.values())), default=0))
    return {"rows": rows, "errors": errors, "shares": shares, "proven": proven, "rate": rate, "enough": enough}


BUYS_HEADS = [
    "law", "rms error at R", "at R/2", "at R/4", "time on at R [%]", "nodes, largest", "steps proven optimal, least [%]"
]  # fmt: skip


def buys_page(found: dict[str, dict[str, Any]]) -> str:
    """Each example's trade of error for switching over the horizon: picture and table."""
    parts = []
    for example in examples():
        name, content = example.name, found[example.name]["horizon"]
        title = name.replace("_", " ").capitalize()
        caption = (
            f"{title}: every run a dot; lines join the runs that no other run of the law beats in both. "
            f"R is {content['rate']:g} switches per second."
        )
        parts += [
            f"### {title}",
            f"```{{figure}} /_generated/compare/{name}_horizon.svg\n:alt: {caption}\n\n{caption}\n```",
            markdown_table(BUYS_HEADS, content["rows"]),
        ]
    return "\n\n".join(parts) + "\n"


ENOUGH_HEADS = ["example", "at R", "at R/2", "at R/4"]


def enough_rows(found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Each example: the shortest horizon that is nearly as good as the best."""
    return [
        [example.name.replace("_", " "), *(f"N = {N}" if N else "" for N in found[example.name]["horizon"]["enough"])]
        for example in examples()
    ]
