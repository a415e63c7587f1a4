"""Pictures and figures of the pages, computed while the site is built. Numbers go into the text as substitutions."""

from __future__ import annotations

from math import exp
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import foreswitch as fsw
from foreswitch.demo.hot_gas import hot_gas_file
from foreswitch.model.prediction import transition
from foreswitch.presentation import plots
from foreswitch.presentation.report import number
from foreswitch.project import Project

# The paper's plant and settings.
SLOPE, LAG, DELAY, TS, TD, LAM = 16500.0, 0.006, 0.005, 1e-3, 0.020, 2500.0
RISE = fsw.HalfSine(height=1000.0, duration=0.5)

Values = dict[str, str]


def hot_gas(delay: float = DELAY) -> fsw.Plant:
    return fsw.Plant.integrator_lag(SLOPE, LAG, delay, input_names="valve", output_names="pressure [kPa]")


def hot_gas_controller(delay: float = DELAY, Td: float = TD, **settings: object) -> fsw.Controller:
    return fsw.Controller(hot_gas(delay), [0, 1], TS, fsw.Endpoint(Td=Td, lam=LAM), **settings)


def save(figure: Figure, path: Path) -> None:
    figure.savefig(path, metadata={"Date": None})


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
    return {
        "round_down": f"{rows['5']:.2f}", "round_exact": f"{rows['5.4']:.2f}", "round_up": f"{rows['6']:.2f}",
    }  # fmt: skip


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
    values = {f"zero_{Td}": f"{mean['zero'][at[Td]]:.1f}" for Td in (5, 20, 50, 100)}
    off = max(abs(value - 40.0) for value in mean["rest"])
    return values | {"rest_off": f"{off:.2g}", "rest_ripple": f"{max(ripple):.2f}"}


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
    return {
        "lag_ms": f"{designed[at] * 1e3:.2f}", "lag_measured_ms": f"{measured[at] * 1e3:.2f}",
        "paper_lag_ms": f"{(DELAY + TD) * 1e3:.0f}",
    }  # fmt: skip


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
    return {f"preview_{name}": f"{value:.1f}" for name, value in at.items()}


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


def rivals(folder: Path) -> Values:
    """Baselines tuned again with the preview the predictive law has; a short horizon under noise and a late valve."""
    plant, ahead = hot_gas(), hot_gas_controller().lag
    other = fsw.HalfSine(500.0, 0.12, start=0.05)
    values = {}
    for name, kind in (("pi", fsw.baselines.PIPWM), ("smith", fsw.baselines.SmithPWM)):
        best = fsw.baselines.tune(kind, plant, [0, 1], TS, RISE, 0.6, budget=300, shared={"preview": ahead})
        values[f"{name}_ahead"] = f"{best.rms_error:.2f}"
        values[f"{name}_ahead_other"] = f"{fsw.simulate(best.law, other, 0.25).metrics()['rms_error']:.2f}"
    law = hot_gas_controller(preview="lag")
    values["ahead_other"] = f"{fsw.simulate(law, other, 0.25).metrics()['rms_error']:.2f}"
    for Td, name in ((TS, "short"), (TD, "long")):
        law = hot_gas_controller(Td=Td, preview="lag")
        noisy = fsw.simulate(law, RISE, 0.6, noise=[2.0, 50.0], seed=1)
        late = fsw.simulate(law, RISE, 0.6, plant=hot_gas(DELAY + 1e-3))
        values[f"{name}_noisy"] = f"{noisy.metrics()['rms_error']:.1f}"
        values[f"{name}_late"] = f"{late.metrics()['rms_error']:.1f}"
    return values


RIG = fsw.Hardware(opening=0.3e-3, closing=1.2e-3, quantum=[5.0, 0.0], outages=[(0.2, 0.23)])


def valve_edges(run: fsw.Run, opening: float, closing: float) -> list[tuple[float, float]]:
    """When the valve moves, and to where: the rule of the page once more, in Python."""
    edges: list[tuple[float, float]] = []
    told = 0.0
    for t, u in zip(run.t, run.u[:, 0], strict=False):
        if u != told:
            at = t + DELAY + (opening if u > told else closing)
            while edges and edges[-1][0] >= at - 1e-12:
                edges.pop()
            edges.append((at, float(u)))
            told = u
    return edges


def rig(folder: Path) -> Values:
    """The demo's rise on hardware; what travel times cost."""
    law = hot_gas_controller(preview="lag")
    run = fsw.simulate(law, RISE, 0.6, hardware=RIG, seed=1)
    edges = valve_edges(run, 0.3e-3, 1.2e-3)

    # the flow that these edges make must be the run's
    flow, now, level, rest = 0.0, 0.0, 0.0, list(edges)
    for t, want in zip(run.t, run.x[:, 1], strict=True):
        while now < t:
            until = min(t, rest[0][0]) if rest else t
            flow = SLOPE * level + (flow - SLOPE * level) * exp(-(until - now) / LAG)
            now = until
            if rest and rest[0][0] <= now:
                level = rest.pop(0)[1]
        assert abs(flow - want) < 1e-6 * SLOPE, "the page's rule is not the simulation's"

    figure = plots.figure(1, 2, size=(7.2, 3.2))
    left, right = figure.axes
    silent = [(start, end) for start, end in RIG.outages]
    seen = np.array([not any(s - 1e-9 <= t < e - 1e-9 for s, e in silent) for t in run.t])
    zoom = (run.t >= 0.15) & (run.t <= 0.28)
    plots.draw_output(left, run.t[zoom] * 1e3, run.y[zoom, 0], run.r[zoom, 0], label="pressure")
    reading = np.round(run.y[:, 0] / 5.0) * 5.0
    left.plot(run.t[zoom & seen] * 1e3, reading[zoom & seen], ".", color=plots.COLOURS[1], markersize=3, label="read")
    for start, end in silent:
        left.axvspan(start * 1e3, end * 1e3, color="0.92", zorder=0)
        left.text((start + end) * 500.0, left.get_ylim()[0] + 5.0, "outage", fontsize=8, ha="center", color="0.35")
    left.set_ylabel("pressure [kPa]", fontsize=9)
    left.set_xlabel("time [ms]", fontsize=9)
    left.legend(fontsize=8, frameon=False, loc="upper left")
    start, end = 0.155, 0.185
    part = (run.t[:-1] >= start - 1e-9) & (run.t[:-1] < end - 1e-9)
    moves = [(t, u) for t, u in edges if start <= t <= end]
    before = [u for t, u in edges if t < start]
    stairs = np.array([start, *(t for t, _ in moves), end]) * 1e3
    levels = np.array([before[-1] if before else 0.0, *(u for _, u in moves)])
    right.stairs(run.u[part, 0] + 1.4, np.append(run.t[:-1][part], end) * 1e3, color="0.25", linewidth=1.0,
                 baseline=None)  # fmt: skip
    right.stairs(levels, stairs, color=plots.COLOURS[2], linewidth=1.6, baseline=None)
    right.set_yticks([0.5, 1.9], ["in force", "commanded"])
    right.set_ylim(-0.15, 2.6)
    right.set_xlim(start * 1e3, end * 1e3)
    right.set_xlabel("time [ms]", fontsize=9)
    save(figure, folder / "hardware.svg")

    travel = fsw.Hardware(opening=0.3e-3, closing=1.2e-3)
    found = {
        "sound": fsw.simulate(law, RISE, 0.6),
        "travel": fsw.simulate(law, RISE, 0.6, hardware=travel),
        "travel_told": fsw.simulate(
            hot_gas_controller(DELAY + 0.75e-3, preview="lag"), RISE, 0.6, plant=hot_gas(), hardware=travel
        ),
    }
    late = fsw.Hardware(late=3e-3)
    found["late"] = fsw.simulate(law, RISE, 0.6, hardware=late, seed=1)
    told = hot_gas_controller(DELAY + 1.5e-3, preview="lag")
    found["late_told"] = fsw.simulate(told, RISE, 0.6, plant=hot_gas(), hardware=late, seed=1)
    return {name: f"{run.metrics()['rms_error']:.1f}" for name, run in found.items()}


#: Fault, what the rig has, whether a safe level is declared, what to do.
FAULTS: tuple[tuple[str, fsw.Hardware, bool, str], ...] = (
    ("none", fsw.Hardware(), True, ""),
    ("opening 0.3 ms, closing 1.2 ms", fsw.Hardware(opening=0.3e-3, closing=1.2e-3), True,
     "put the mean into the dead time"),
    ("stuck shut, 0.10 to 0.15 s", fsw.Hardware(stuck=[fsw.Stuck(0.0, 0.10, 0.15)]), True,
     "watch the error; the controller cannot know"),
    ("stuck open, 0.10 to 0.15 s", fsw.Hardware(stuck=[fsw.Stuck(1.0, 0.10, 0.15)]), True,
     "a second valve in series; the controller cannot know"),
    ("sensor in steps of 5 kPa and 100 kPa/s", fsw.Hardware(quantum=[5.0, 100.0]), True, "nothing"),
    ("sensor ends at 800 kPa", fsw.Hardware(high=[800.0, np.inf]), True, "keep the reference inside the range"),
    ("process noise 10 kPa, 2000 kPa/s per root second", fsw.Hardware(process_noise=[10.0, 2000.0]), True,
     "nothing"),
    ("gain drifts by -20 %", fsw.Hardware(drift=fsw.Plant.integrator_lag(0.8 * SLOPE, LAG, DELAY)), True, "nothing"),
    ("one sample in five missing", fsw.Hardware(missing=0.2), True, "check the sensor"),
    ("samples up to 3 ms late", fsw.Hardware(late=3e-3), True, "put the mean into the dead time"),
    ("outage of 30 ms, safe level declared", fsw.Hardware(outages=[(0.2, 0.23)]), True, "repair the sensor"),
    ("the same, none declared", fsw.Hardware(outages=[(0.2, 0.23)]), False, "repair the sensor"),
    ("no sample in the first 5 ms", fsw.Hardware(outages=[(0.0, 0.005)]), True, "give one measurement before starting"),
)  # fmt: skip


def fault_rows() -> list[list[str]]:
    """One fault at a time on the demo's rise: which statuses come up, what error is left."""
    rows = []
    for fault, hardware, declared, remedy in FAULTS:
        law = hot_gas_controller(preview="lag", **({"safe_level": 0} if declared else {}))
        run = fsw.simulate(law, RISE, 0.6, hardware=hardware, seed=1)
        counts = [(status.name, int((run.status == status).sum())) for status in fsw.Status]
        seen = ", ".join(f"{name} {count}" for name, count in counts if count)
        rows.append([fault, seen, number(run.metrics()["rms_error"]), remedy])
    return rows


def batch(folder: Path) -> Values:
    """The demo's rise 500 times, with one gain and with many."""
    law, noise = hot_gas_controller(preview="lag"), [2.0, 50.0]
    gains = np.random.default_rng(0).uniform(0.8, 1.2, 500)
    plants = [fsw.Plant.integrator_lag(SLOPE * gain, LAG, DELAY) for gain in gains]
    nominal = fsw.simulate_batch(law, RISE, 0.6, seeds=500, noise=noise).rms_error[:, 0]
    spread = fsw.simulate_batch(law, RISE, 0.6, seeds=500, noise=noise, plant=plants).rms_error[:, 0]
    figure = plots.figure(1, 2, size=(7.2, 3.0))
    left, right = figure.axes
    bins = np.linspace(0.0, np.ceil(spread.max()), 36)
    for values, colour, name in ((spread, plots.COLOURS[1], "gains spread"), (nominal, plots.COLOURS[0], "one gain")):
        left.hist(values, bins=bins, color=colour, alpha=0.75, label=name)
    left.set_xlabel("rms error [kPa]", fontsize=9)
    left.set_ylabel("runs", fontsize=9)
    left.legend(fontsize=8, frameon=False)
    right.plot(gains, spread, ".", color=plots.COLOURS[1], markersize=3)
    right.plot(np.ones_like(nominal), nominal, ".", color=plots.COLOURS[0], markersize=3)
    right.set_xlabel("true gain / model's gain", fontsize=9)
    right.set_ylabel("rms error [kPa]", fontsize=9)
    right.set_ylim(0, None)
    save(figure, folder / "batch.svg")
    values = {}
    for name, errors in (("batch", nominal), ("spread", spread)):
        low, high = np.quantile(errors, [0.05, 0.95])
        values |= {f"{name}_low": f"{low:.1f}", f"{name}_high": f"{high:.1f}"}
    return values


def study(folder: Path) -> Values:
    """The demo's rise where dead time and gain are not the model's: a grid of both, and one drawn over the other."""
    valve = Project.read(hot_gas_file())
    fixed = {
        "controller.preview": ["lag"],
        "simulation.noise": [[2.0, 50.0]],
        "delay_error": np.linspace(-4e-3, 4e-3, 17),
    }
    grid = fsw.study(valve, fixed | {"gain_error": np.linspace(-0.2, 0.2, 9)}, repeats=20, seed=1)
    save(grid.plot(), folder / "study_map.svg")
    bands = fsw.study(valve, fixed | {"gain_error": fsw.Normal(0.0, 0.05)}, repeats=100, seed=1)
    save(bands.plot(), folder / "study_band.svg")
    middle = grid.quantiles()["rms_error_q50"].reshape(17, 9)
    upper = bands.quantiles()["rms_error_q95"]
    return {
        "study_true": f"{middle[8, 4]:.1f}", "study_late": f"{middle[12, 4]:.1f}", "study_early": f"{middle[4, 4]:.1f}",
        "study_band_late": f"{upper[12]:.1f}", "study_band_early": f"{upper[4]:.1f}",
    }  # fmt: skip


#: The hot gas from its pressure alone: 2 kPa of noise, a flow known to 100 kPa/s, a leak that may change by 1e-3 of the
#: full flow in a period.
PRESSURE_NOISE = 2.0
OUTPUTS = fsw.Kalman([0.0, 1e4], PRESSURE_NOISE**2)
LOAD = fsw.Kalman([0.0, 1e4], PRESSURE_NOISE**2, load=1e-6)
MEASURED = {"state": None, "pressure": OUTPUTS, "pressure, with a load": LOAD}


def half_rise(t: np.ndarray) -> np.ndarray:
    """Up to 500 kPa as in the demo, then there; with its slope."""
    course = RISE(t, 2)
    course[t > 0.25] = [500.0, 0.0]
    return course


def leaking(estimator: fsw.Kalman | None, gain: float = 1.0, start: float = 0.0) -> fsw.Run:
    """500 kPa are held while a tenth of the full flow leaks, from a start on; the valve's gain may be another."""
    truth = fsw.Plant.integrator_lag(SLOPE * gain, LAG, DELAY)
    leak = np.where(np.arange(4000) * TS < start, 0.0, -0.1)
    return fsw.simulate(
        hot_gas_controller(estimator=estimator), half_rise, 4.0, plant=truth, load=leak, seed=1,
        noise=None if estimator is None else PRESSURE_NOISE,
    )  # fmt: skip


def leak_rows() -> list[list[str]]:
    """Mean offset under a leak, by what is measured and by the valve's true gain."""
    rows = []
    for name, estimator in MEASURED.items():
        runs = [leaking(estimator, gain) for gain in (0.8, 1.0, 1.2)]
        rows.append([name, *(f"{(run.y - run.r)[1000:].mean():.2f}" for run in runs)])
    return rows


def estimation(folder: Path) -> Values:
    """What it costs to measure the pressure alone, over the process noise; a leak that begins."""

    def rms(estimator: fsw.Kalman | None, noise: float | None) -> float:
        law = hot_gas_controller(preview="lag", estimator=estimator)
        runs = [fsw.simulate(law, RISE, 0.6, noise=noise, seed=seed) for seed in range(10)]
        return float(np.mean([run.metrics()["rms_error"] for run in runs]))

    deviations = np.geomspace(3.0, 3000.0, 25)
    errors = [rms(fsw.Kalman([0.0, slope**2], PRESSURE_NOISE**2), PRESSURE_NOISE) for slope in deviations]
    values = {"full": rms(None, None), "outputs": rms(OUTPUTS, PRESSURE_NOISE), "load": rms(LOAD, PRESSURE_NOISE)}
    figure = plots.figure(1, 2, size=(7.2, 3.0))
    left, right = figure.axes
    left.axhline(values["full"], color="0.5", linewidth=1.0, linestyle="--", label="state measured, no noise")
    left.semilogx(deviations, errors, color=plots.COLOURS[0], linewidth=1.2, label="pressure, 2 kPa of noise")
    left.plot(100.0, values["outputs"], "o", color=plots.COLOURS[1], markersize=5)
    left.set_xlabel("root of process_noise, slope [kPa/s]", fontsize=9)
    left.set_ylabel("rms error [kPa]", fontsize=9)
    left.set_ylim(0, None)
    left.legend(fontsize=8, frameon=False, loc="lower right")
    for (name, estimator), colour in zip(MEASURED.items(), plots.COLOURS, strict=False):
        run = leaking(estimator, start=1.0)
        window = np.ones(33) / 33  # the ripple of some pulses
        error = np.convolve((run.y - run.r)[:, 0], window, "same")
        part = (run.t > 0.9) & (run.t < 1.9)
        right.plot(run.t[part] - 1.0, error[part], color=colour, linewidth=1.0, label=name)
    right.set_xlabel("time since the leak began [s]", fontsize=9)
    right.set_ylabel("error, mean of 33 ms [kPa]", fontsize=9)
    right.legend(fontsize=8, frameon=False)
    save(figure, folder / "estimation.svg")
    poles = np.abs(LOAD_LAW.kalman.poles)
    means = np.array([[float(cell) for cell in row[1:]] for row in leak_rows()])
    found = {f"estimated_{name}": f"{value:.2f}" for name, value in values.items()}
    return found | {
        "leak_state_low": f"{-means[0].max():.0f}", "leak_state_high": f"{-means[0].min():.0f}",
        "leak_outputs": f"{-means[1].mean():.0f}",
        "leak_load": f"{np.abs(means[2]).max():.2f}",
        "slowest_pole": f"{poles[0]:.3f}", "slowest_periods": f"{-1.0 / np.log(poles[0]):.0f}",
        "other_periods": f"{-1.0 / np.log(poles[1]):.0f}",
    }  # fmt: skip


LOAD_LAW = hot_gas_controller(estimator=LOAD)


# From a pulse test to a model: the rig is simulated, and richer than the models fitted to its record.
PULSE_RIG = fsw.Plant.from_tf(
    [18333 * 186**2], [1, 2 * 0.75 * 186, 186**2, 0], input_delay=0.00137, input_names="valve",
    output_names="pressure [kPa]",
)  # fmt: skip
PULSE_VALVE = fsw.Hardware(opening=0.00035, closing=0.00025, quantum=0.5)
PULSES = fsw.PulseTest(Ts=1e-3, width=1e-3, spacing=0.06, number=40, lead=0.05)


def pulse_record() -> fsw.Record:
    return PULSES.rehearse(PULSE_RIG, noise=1.0, hardware=PULSE_VALVE, x0=[101.3, 0, 0], seed=1)


def pulses(folder: Path) -> Values:
    """The paper's pulse test: its average response, what two structures leave, and how structures compare."""
    record = pulse_record()
    second, best = fsw.identify(record, "integrator+lag"), fsw.identify(record)
    assert best.structure == "integrator+pair", "the text says which structure is chosen"
    (folder / "pulse_fit.txt").write_text(f"{second}\n")
    lines = [
        f"{c.structure + ', drift' * c.drift:<28}{c.criterion:8.1f}{c.held_back:8.3f} {'chosen' * c.chosen}".rstrip()
        for c in best.candidates[:6]
    ]
    (folder / "pulse_candidates.txt").write_text("\n".join(lines) + "\n")
    save(second.plot_pulses(), folder / "pulse_average.svg")
    figure = plots.figure(1, 2, size=(7.2, 2.8), shared=False)
    left, right = figure.axes
    begin = np.flatnonzero(np.diff(record.u[:, 0]) > 0) + 1
    after = np.arange(-5, 50)
    for i, fit in enumerate((second, best)):
        residual = (record.y - fit.simulate(record))[:, 0]
        r = np.correlate(residual, residual, "full")[residual.size - 1 :] / (residual @ residual)
        left.plot(after, residual[begin[:, None] + after].mean(axis=0), color=plots.COLOURS[i], linewidth=1.2)
        right.vlines(
            np.arange(1, 16) + 0.25 * (i - 0.5),
            0.0,
            r[1:16],
            color=plots.COLOURS[i],
            linewidth=2.5,
            label=fit.structure,
        )
    left.set_xlabel("time since the pulse [ms]", fontsize=9)
    left.set_ylabel("average residual [kPa]", fontsize=9)
    band = 2.0 / np.sqrt(len(record))
    right.axhspan(-band, band, color="0.88", zorder=0, label="95 % of white noise")
    right.axhline(0.0, color="0.3", linewidth=0.6)
    right.set_xlabel("samples apart", fontsize=9)
    right.set_ylabel("autocorrelation", fontsize=9)
    right.legend(fontsize=8, frameon=False)
    save(figure, folder / "pulse_residuals.svg")
    return {
        "pulse_delay_error": f"{1e3 * second.parameters['delay'][1]:.2f}",
        "pulse_worth": f"{SLOPE * PULSES.width:.1f}",
    }  # fmt: skip


OVEN = fsw.Plant.fopdt(K=100.0, T=100.0, L=20.7, output_names="temperature [K]")
OVEN_NOISE = 0.5


def experiment(folder: Path) -> Values:
    """Errors over the width of a pulse, predicted and found; the gain of an integrating plant over the quiet time."""

    def half_an_hour(width: float, rest: float = 100.0) -> fsw.PulseTest:
        spacing = width + 22.0 + rest
        return fsw.PulseTest(2.0, width, spacing, int(1800.0 / spacing) - 1, spacing)

    figure = plots.figure(1, 2, size=(7.2, 3.0), shared=False)
    left, right = figure.axes
    widths = np.unique(np.round(np.geomspace(1.0, 150.0, 25))) * 2.0
    predicted = [half_an_hour(width).errors(OVEN, OVEN_NOISE) for width in widths]
    units = {"delay": "dead time [s]", "T": "T [s]", "K": "K [K]"}
    ratios = []
    for (name, label), colour in zip(units.items(), plots.COLOURS, strict=False):
        left.loglog(widths, [errors[name] for errors in predicted], color=colour, linewidth=1.2, label=label)
    for width in (4.0, 16.0, 64.0, 200.0):
        test = half_an_hour(width)
        fits = [
            fsw.identify(test.rehearse(OVEN, noise=OVEN_NOISE, seed=seed), "lag", drift=False, held_back=0.0).parameters
            for seed in range(40)
        ]
        for name, colour in zip(units, plots.COLOURS, strict=False):
            deviation = np.std([fit[name][0] for fit in fits], ddof=1)
            left.plot(width, deviation, "o", color=colour, markersize=4)
            ratios.append(deviation / test.errors(OVEN, OVEN_NOISE)[name])
    assert 0.6 < min(ratios) < max(ratios) < 1.5, "the errors found are not those predicted"
    left.set_xlabel("width of a pulse [s]", fontsize=9)
    left.set_ylabel("standard error", fontsize=9)
    left.legend(fontsize=8, frameon=False)
    shares = np.arange(1, 41) / 40.0
    gas = fsw.Plant.integrator_lag(SLOPE, LAG, 0.0053)
    gains = [fsw.PulseTest(TS, TS, 0.035, 40, share * 40 * 0.035).errors(gas, 1.0)["k"] for share in shares]
    right.semilogy(shares, np.array(gains) / SLOPE * 100.0, color=plots.COLOURS[0], linewidth=1.2)
    right.set_xlabel("quiet time / time of the pulses", fontsize=9)
    right.set_ylabel("standard error of the gain [%]", fontsize=9)
    save(figure, folder / "experiment.svg")
    # time for the same error: it falls with the square root of the record's length
    one, four = (half_an_hour(50.0, rest) for rest in (100.0, 400.0))
    cost = [test.duration * test.errors(OVEN, OVEN_NOISE)["delay"] ** 2 for test in (one, four)]
    at = {round(share, 3): 100.0 * gain / SLOPE for share, gain in zip(shares, gains, strict=True)}
    return {
        "settled_cost": f"{cost[1] / cost[0]:.1f}",
        "quiet_little": f"{at[0.025]:.1f}", "quiet_quarter": f"{at[0.25]:.1f}",
    }  # fmt: skip


def certificate(folder: Path) -> Values:
    """The demo's rise inside its band."""
    law, rise = hot_gas_controller(preview=False), fsw.HalfSine(1000.0, 0.5)
    proof = fsw.certify(law, reference=rise, duration=0.6)
    run = fsw.simulate(law, rise, 0.6)
    save(proof.plot(run), folder / "certificate.svg")
    (inner, tight), (_, loose) = fsw.certify(law).arguments
    return {
        "proof_bound": f"{proof.error_bound[0]:.2f}", "proof_resolution": f"{proof.resolution[0]:.2f}",
        "proof_seen": f"{np.abs(run.y - proof.ideal(rise, 0.6)).max():.2f}", "proof_inner": f"{tight[0]:.2f}",
        "proof_outer": f"{loose[0]:.2f}", "proof_low": f"{inner[0][0]:.4f}", "proof_high": f"{inner[1][0]:.4f}",
    }  # fmt: skip


def draw(folder: Path) -> Values:
    """All pictures into the folder; the numbers for the text."""
    values: Values = {}
    parts = (
        decision,
        fractional,
        tails,
        lag,
        preview,
        wear,
        rivals,
        rig,
        batch,
        study,
        certificate,
        estimation,
        pulses,
        experiment,
    )
    for part in parts:
        values |= part(folder)
    return values
