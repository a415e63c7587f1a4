"""A chamber with one valve to fill and one to vent it: what the second valve brings, and its own dead time."""

import sys
from pathlib import Path

import numpy as np

from foreswitch import Plant
from foreswitch.model.prediction import period_model
from foreswitch.presentation import plots
from foreswitch.project import Project

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here / "out"
project = Project.read(here / "project.toml")
chamber, valves = project.plant, project.controller
start = np.array(project.file.simulation.x0)
REACH, REST = 4000.0, 300.0  # kPa/s of the fill valve, and the pressure that states count from


def told(truth=chamber, x0=start, **changes):
    """Pressure and openings under the project's controller with other settings or another model."""
    run = project.simulate(project.build_controller(**changes), plant=truth, x0=x0)
    return run.y[:, 0], run.u


def fill_only(fade):
    """The chamber without its vent valve; a leak, or a bleed left open, lets the pressure fade with so many seconds."""
    A, B, C = chamber.A[:2, :2].copy(), chamber.B[:2, :1], chamber.C[:, :2]
    A[0, 0] = -1.0 / fade
    one = Plant(A, B, C, input_delay=chamber.input_delay[0], u_offset=REST / fade / REACH, y_offset=REST)
    return told(one, start[:2], plant=one, levels=[0, 1], forbidden=[])


def thresholds(band):
    """No model: fill below the band, vent above it."""
    step, u = period_model(chamber, valves.Ts), np.zeros((t.size - 1, 2))
    x, y = start.copy(), np.full(t.size, start[0] + REST)
    for k in range(t.size - 1):
        u[k] = ahead[k] - y[k] > band, y[k] - ahead[k] > band
        x = step.transition @ x + step.drift
        for j, late in enumerate(step.delay):
            x += step.old[j] * u[max(k - late, 0), j] + step.new[j] * u[max(k - late + 1, 0), j]
        y[k + 1] = x[0] + REST
    return y, u


t = project.simulate().t
wanted, ahead = (project.reference(t + shift, 1)[:, 0, 0] for shift in (0.0, valves.lag))
one_dead_time = {tau: {"plant": chamber.replace(input_delay=1e-3 * tau)} for tau in (4, 5.65, 7.3)}
# the same chamber, its states counted from ambient: a plant with no operating point
plain = chamber.replace(u_offset=[0.0, 0.0], y_offset=0.0)
there = np.add(start, [REST, chamber.u_offset[0] * REACH, 0.0])

BLEED, BOTH, MIDDLE, RELAY = "fill only, bleed open", "fill and vent", "told 5.65 ms for both", "two thresholds"
runs = {
    "fill only, tight": fill_only(2.0),
    BLEED: fill_only(0.18),
    BOTH: told(),
    "switching for free": told(switch_cost=0.0),
    **{f"told {tau:g} ms for both": told(**model) for tau, model in one_dead_time.items()},
    "Td = 20 ms": told(Td=0.02),
    "Td = 20 ms, from ambient": told(plain, there, plant=plain, Td=0.02),
    "Td = 20 ms, zero tail": told(Td=0.02, tail="zero"),
    RELAY: min(map(thresholds, range(2, 40, 2)), key=lambda flown: np.mean((flown[0] - wanted) ** 2)),
}

print(f"{'':<28}{'rms error':>10}{'largest':>9}{'mean':>7}{'openings':>15}{'gas':>7}")
print(f"{'':<28}{'[kPa]':>10}{'[kPa]':>9}{'[kPa]':>7}{'fill':>9}{'vent':>6}{'[kPa]':>7}")
for name, (y, u) in runs.items():
    error, opened = y - wanted, [*(np.diff(u, axis=0, prepend=0) > 0).sum(axis=0), 0]
    figures = f"{np.sqrt(np.mean(error**2)):10.1f}{np.abs(error).max():9.1f}{error.mean():7.1f}"
    print(f"{name:<28}{figures}{opened[0]:9d}{opened[1]:6d}{REACH * valves.Ts * u[:, 0].sum():7.0f}")

picture = plots.figure(7, size=(7.2, 9.0), heights=[2.2, 1.6, 0.45, 0.45, 0.45, 0.45, 1.4])
pressure, errors, *stairs, gas = picture.axes
colours = {BOTH: plots.COLOURS[0], MIDDLE: plots.COLOURS[1], RELAY: plots.COLOURS[4], BLEED: plots.COLOURS[2]}
ms = 1e3 * t
plots.draw_output(pressure, ms, runs[BOTH][0], wanted, label=BOTH)
plots.draw_output(pressure, ms, runs["fill only, tight"][0], None, label="fill only, tight", colour=plots.COLOURS[3])
pressure.set_ylabel(chamber.output_names[0], fontsize=9)
for name in (RELAY, MIDDLE, BOTH):
    plots.draw_output(errors, ms, runs[name][0] - wanted, None, label=name, colour=colours[name])
errors.set_ylabel("error [kPa]", fontsize=9)
errors.set_ylim(-27.0, 18.0)
for axes, (name, j) in zip(stairs, [(BOTH, 0), (BOTH, 1), (MIDDLE, 0), (MIDDLE, 1)], strict=True):
    plots.draw_command(axes, ms, runs[name][1][:, j], label="", colour=colours[name])
    axes.set_title(f"{chamber.input_names[j]}: {name}", fontsize=8, loc="left")
    axes.set_yticks([0, 1])
for name, colour in colours.items():
    plots.draw_output(gas, ms[:-1], REACH * valves.Ts * np.cumsum(runs[name][1][:, 0]), None, label=name, colour=colour)
gas.set_ylabel("gas let in [kPa]", fontsize=9)
gas.set_xlabel("time [ms]", fontsize=9)
for axes, place in ((pressure, "upper right"), (errors, "lower center"), (gas, "upper left")):
    axes.legend(fontsize=8, frameon=False, loc=place, ncols=3 if axes is errors else 1)

folder.mkdir(parents=True, exist_ok=True)
for kind in ("png", "svg"):
    picture.savefig(folder / f"picture.{kind}", dpi=150)
