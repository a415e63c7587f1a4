"""A rig with travel times, outages and a coarse sensor; one fault at a time."""

from __future__ import annotations

from math import exp
from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import DELAY, LAG, RISE, SLOPE, Values, hot_gas, hot_gas_controller, save
from foreswitch.presentation import plots
from foreswitch.presentation.report import number

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
    return {name: run.metrics()["rms_error"] for name, run in found.items()}


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
