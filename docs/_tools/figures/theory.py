"""One decision; then what the page on theory says of dead time, tail, lag, preview and wear."""

from __future__ import annotations

from math import exp
from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import DELAY, LAG, LAM, RISE, SLOPE, TD, TS, Values, hot_gas, hot_gas_controller, save
from foreswitch.model.prediction import transition
from foreswitch.presentation import plots


def decision(folder: Path) -> Values:
    """One decision of the tracking run: what is under way, and where each candidate leads."""
    controller = hot_gas_controller(preview="lag")
    run = fsw.simulate(controller, RISE, 0.6)
    plant, k, pending = controller.plant, 197, controller.pending_steps
    fine = 1e-4
    phi, gamma = transition(plant.A, plant.B, fine)

    def ahead(candidate: float) -> tuple[np.ndarray, np.ndarray]:
        """Output from t_k to the evaluation instant, nothing (the rest of an integrating plant) after the candidate."""
        x, y = run.x[k], [run.y[k, 0]]
        count = round((DELAY + TD) / fine)
        for i in range(count):
            period = int(i * fine / TS + 1e-9) - pending
            u = run.u[k + period, 0] if period < 0 else candidate if period == 0 else 0.0
            x = phi @ x + gamma[:, 0] * u
            y.append(plant.C[0] @ x)
        return np.arange(count + 1) * fine * 1e3, np.array(y)

    figure = plots.figure(2, size=(7.2, 4.4), heights=[2.6, 0.9])
    above, below = figure.axes
    past = slice(k - 12, k + 1)
    now = run.t[k]
    target = RISE([now + controller.lag], controller.order)[0, 0]
    above.plot((run.t[past] - now) * 1e3, run.y[past, 0], color="0.25", linewidth=1.4, label="measured")
    misses = {}
    for level, colour in ((0.0, plots.COLOURS[0]), (1.0, plots.COLOURS[1])):
        t, y = ahead(level)
        above.plot(t, y, color=colour, linewidth=1.4, label=f"predicted, valve {level:g}")
        above.plot(t[-1], y[-1], "o", color=colour, markersize=4)
        misses[level] = abs(y[-1] - target[0])
    assert run.u[k, 0] == min(misses, key=misses.__getitem__), "the picture shows another choice than the law's"
    above.plot((DELAY + TD) * 1e3, target[0], "x", color="black", markersize=7, label="reference")
    above.axvspan(0, DELAY * 1e3, color="0.92", zorder=0)
    above.text(0.2, above.get_ylim()[0], "dead time", fontsize=8, va="bottom", color="0.35")
    above.set_ylabel("pressure [kPa]", fontsize=9)
    above.legend(fontsize=8, frameon=False, loc="upper left")
    edges = (run.t[k - 12 : k + 1] - now) * 1e3
    plots.draw_command(below, edges, run.u[k - 12 : k, 0], label="issued", colour="0.25")
    first = 12 - pending
    below.stairs(run.u[k - pending : k, 0], edges[first:], color=plots.COLOURS[2], linewidth=2.2, baseline=None,
                 label="issued, not yet acted on")  # fmt: skip
    below.annotate("?", (0.35, 0.35), fontsize=11)
    below.set_ylim(-0.15, 1.9)
    below.legend(fontsize=8, frameon=False, ncols=2, loc="upper right")
    below.set_ylabel("valve", fontsize=9)
    below.set_xlabel("time from now [ms]", fontsize=9)
    save(figure, folder / "decision.svg")
    return {}


def fractional(folder: Path) -> Values:
    """What rounding a dead time of 5.4 ms to whole periods costs."""
    rows = {}
    for delay in (0.005, 0.0054, 0.006):
        run = fsw.simulate(hot_gas_controller(delay, preview="lag"), RISE, 0.6, plant=hot_gas(0.0054))
        rows[f"{delay * 1e3:g}"] = run.metrics()["rms_error"]
    return {"round_down": rows["5"], "round_exact": rows["5.4"], "round_up": rows["6"]}


def tails(folder: Path) -> Values:
    """The mean an oven is held at, over Td, with either tail."""
    oven = fsw.Plant.fopdt(K=100.0, T=100.0, L=20.0)
    horizons = np.array([1, 2, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 140, 200], dtype=float)
    mean: dict[str, list[float]] = {"rest": [], "zero": []}
    ripple: list[float] = []
    for tail, found in mean.items():
        for Td in horizons:
            law = fsw.Controller(oven, [0, 1], 1.0, fsw.Endpoint(Td=Td, lam=1.0, tail=tail))
            settled = fsw.simulate(law, 40.0, 4000.0).y[2000:, 0]
            found.append(settled.mean())
            if tail == "rest":
                ripple.append(np.ptp(settled))
    figure = plots.figure(size=(7.2, 3.2))
    axes = figure.axes[0]
    axes.axhline(40.0, color=plots.REFERENCE, linewidth=3.0, alpha=0.7, label="set point")
    fine = np.linspace(1, 200, 400)
    axes.plot(fine, np.minimum(40.0 * np.exp((fine - 1.0) / 100.0), 100.0), color=plots.COLOURS[1], linewidth=0.8,
              label="set point times DC gain, at most full power")  # fmt: skip
    axes.plot(horizons, mean["zero"], "o", color=plots.COLOURS[1], markersize=4, label="zero tail, simulated")
    axes.plot(horizons, mean["rest"], "o", color=plots.COLOURS[0], markersize=4, label="rest tail, simulated")
    axes.set_xlabel("settling horizon Td [s]", fontsize=9)
    axes.set_ylabel("mean temperature [K above ambient]", fontsize=9)
    axes.set_ylim(30, 105)
    axes.legend(fontsize=8, frameon=False, loc="center right")
    save(figure, folder / "tails.svg")
    at = {Td: i for i, Td in enumerate(horizons)}
    values = {f"zero_{Td}": mean["zero"][at[Td]] for Td in (5, 20, 50, 100)}
    return values | {"rest_off": max(abs(value - 40.0) for value in mean["rest"]), "rest_ripple": max(ripple)}


def lag(folder: Path) -> Values:
    """The lag over Td: computed at design time, by the closed formula, measured on a ramp, and the paper's figure."""
    horizons = np.array([1, 2, 3, 5, 7, 10, 15, 20, 30, 40]) * 1e-3
    slope = 0.37 * SLOPE  # an arbitrary duty, so that no limit cycle locks to the period
    designed, formula, measured = [], [], []
    for Td in horizons:
        law = hot_gas_controller(Td=Td)
        run = fsw.simulate(law, fsw.Ramp(slope), 2.0)
        designed.append(law.lag)
        formula.append(DELAY + TS + (LAG - 1 / LAM) * (1 - exp(-(Td - TS) / LAG)))
        measured.append(float((run.r - run.y)[1000:].mean()) / slope)
    figure = plots.figure(size=(7.2, 3.2))
    axes = figure.axes[0]
    fine = np.linspace(1e-3, 40e-3, 200)
    axes.plot(fine * 1e3, (DELAY + fine) * 1e3, "--", color="0.5", linewidth=1.0, label="Tu + Td")
    exact = DELAY + TS + (LAG - 1 / LAM) * (1 - np.exp(-(fine - TS) / LAG))
    axes.plot(fine * 1e3, exact * 1e3, color=plots.COLOURS[0], linewidth=1.2, label="formula")
    axes.plot(
        horizons * 1e3, np.array(designed) * 1e3, "o", color=plots.COLOURS[0], markersize=4, label="controller.lag"
    )
    axes.plot(
        horizons * 1e3, np.array(measured) * 1e3, "+", color=plots.COLOURS[1], markersize=8, label="measured on a ramp"
    )
    axes.set_xlabel("settling horizon Td [ms]", fontsize=9)
    axes.set_ylabel("lag [ms]", fontsize=9)
    axes.set_ylim(0, 30)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    save(figure, folder / "lag.svg")
    at = int(np.flatnonzero(horizons == TD)[0])
    assert np.allclose(designed, formula, rtol=1e-9), "the closed formula no longer holds"
    found = {"lag_ms": designed[at], "lag_measured_ms": measured[at], "paper_lag_ms": DELAY + TD}
    return {name: 1e3 * value for name, value in found.items()}


def preview(folder: Path) -> Values:
    """The rms error over how far ahead the reference is sampled."""
    ahead = np.arange(0.0, 0.0301, 0.0005)
    rms = [fsw.simulate(hot_gas_controller(preview=t), RISE, 0.6).metrics()["rms_error"] for t in ahead]
    best = hot_gas_controller()
    marks = {"now": 0.0, "lag": best.lag, "instant": DELAY + TD}
    at = {
        name: fsw.simulate(hot_gas_controller(preview=t), RISE, 0.6).metrics()["rms_error"] for name, t in marks.items()
    }
    figure = plots.figure(size=(7.2, 3.0))
    axes = figure.axes[0]
    axes.plot(ahead * 1e3, rms, color=plots.COLOURS[0], linewidth=1.2)
    for name, text, place in (("now", "preview=False", (0.6, 1.5)), ("lag", 'preview="lag"', (0.5, -2.2)),
                              ("instant", "preview=True", (-6.6, 0.4))):  # fmt: skip
        x, y = marks[name] * 1e3, at[name]
        axes.plot(x, y, "o", color=plots.COLOURS[1], markersize=5)
        axes.annotate(text, (x + place[0], y + place[1]), fontsize=8)
    axes.set_xlabel("reference sampled ahead by [ms]", fontsize=9)
    axes.set_ylabel("rms error [kPa]", fontsize=9)
    axes.set_ylim(0, None)
    save(figure, folder / "preview.svg")
    return {f"preview_{name}": value for name, value in at.items()}


def wear(folder: Path) -> Values:
    """Error against switches: a cost per switch, and shortest on and off times."""
    laws = {
        "switch_cost": [hot_gas_controller(preview="lag", switch_cost=c) for c in np.geomspace(10.0, 1000.0, 15)],
        "min_on = min_off": [
            hot_gas_controller(preview="lag", min_on=n * TS, min_off=n * TS) for n in (1, 2, 3, 4, 5, 6)
        ],
    }
    figure = plots.figure(size=(7.2, 3.0))
    axes = figure.axes[0]
    for (name, group), colour, mark in zip(laws.items(), plots.COLOURS, "o^", strict=False):
        found = [fsw.simulate(law, RISE, 0.6).metrics() for law in group]
        axes.plot([m["switches"] for m in found], [m["rms_error"] for m in found], mark, color=colour, markersize=4,
                  label=name)  # fmt: skip
    axes.set_xlabel("switches in the run", fontsize=9)
    axes.set_ylabel("rms error [kPa]", fontsize=9)
    axes.set_ylim(0, None)
    axes.legend(fontsize=8, frameon=False)
    save(figure, folder / "wear.svg")
    return {}
