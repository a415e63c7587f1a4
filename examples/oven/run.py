"""A drying oven: why the tail matters, and when a relay is enough."""

import sys
from pathlib import Path

import numpy as np

from foreswitch import baselines
from foreswitch.presentation import plots
from foreswitch.project import Project

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here / "out"
project = Project.read(here / "project.toml")
oven, heater = project.plant, project.controller

# the programme under the predictive law with either tail ...
cases = [(tail, Td) for tail in ("zero", "rest") for Td in (20, 60, 120)]
laws = {f"{tail} tail, Td = {Td} s": project.build_controller(tail=tail, Td=Td) for tail, Td in cases}
runs = {name: project.simulate(law) for name, law in laws.items()}
ZERO, PREDICTIVE = list(runs)[:3], "rest tail, Td = 60 s"

# ... and under what people use today, same relay, same preview, parameters searched on this very programme
task = (oven, heater.levels, heater.Ts, project.reference, project.file.simulation.duration)
shared = {"min_on": 10.0, "min_off": 10.0, "preview": heater.lag}
thermostat = baselines.tune(baselines.Relay, *task, budget=300, shared=shared)
pi_pwm = baselines.tune(baselines.PIPWM, *task, budget=300, shared=shared)
runs |= {"thermostat": thermostat.run, "PI + PWM": pi_pwm.run}

# a relay that must wait longer between switchings
runs["rest tail, 40 s dwell"] = project.simulate(project.build_controller(min_on=40.0, min_off=40.0))

# a heater 10 % weaker than the model says
weak = oven.replace(B=0.9 * oven.B)
runs["rest tail, weak heater"] = project.simulate(plant=weak)
runs["PI + PWM, weak heater"] = project.simulate(pi_pwm.law, plant=weak)


def soak(run, begin, end):
    """Mean and swing [°C] and switchings per hour between two times [min]."""
    part = slice(begin * 60, end * 60)
    switchings = np.count_nonzero(np.diff(run.u[part, 0])) * 60 / (end - begin)
    return f"{run.y[part].mean():8.1f} {np.ptp(run.y[part]):6.1f} {switchings:6.0f}"


print(f"{'':<28}{'soak at 60 °C':>22}{'soak at 105 °C':>22}")
print(f"{'':<28}{'mean  swing    1/h':>22}{'mean  swing    1/h':>22}{'rms error':>12}")
for name, run in runs.items():
    print(f"{name:<28}{soak(run, 21, 32)}{soak(run, 49, 60)}{run.metrics()['rms_error']:12.2f}")

picture = plots.figure(4, size=(7.2, 7.6), heights=[2.4, 2.0, 0.5, 0.5])
tails, errors, *heaters = picture.axes
best, minutes = runs[PREDICTIVE], runs[PREDICTIVE].t / 60.0
plots.draw_output(tails, minutes, best.y[:, 0], best.r[:, 0], label="rest tail, any Td")
for name, colour in zip(ZERO, ("#f4b183", "#e2803a", "#a84300"), strict=True):
    plots.draw_output(tails, minutes, runs[name].y[:, 0], None, label=name, colour=colour)
tails.set_ylabel("oven [°C]", fontsize=9)
shown = {"thermostat": plots.COLOURS[4], "PI + PWM": plots.COLOURS[2], PREDICTIVE: plots.COLOURS[0]}
for name, colour in shown.items():
    run = runs[name]
    plots.draw_output(errors, minutes, (run.y - run.r)[:, 0], None, label=name, colour=colour)
errors.set_ylabel("error [°C]", fontsize=9)
for axes, name in zip(heaters, (PREDICTIVE, "thermostat"), strict=True):
    plots.draw_command(axes, minutes, runs[name].u[:, 0], label="", colour=shown[name])
    axes.set_title(f"heater: {name}", fontsize=8, loc="left")
    axes.set_yticks([0, 1])
for axes in (tails, errors):
    axes.legend(fontsize=8, frameon=False, ncols=2)
heaters[-1].set_xlabel("time [min]", fontsize=9)

folder.mkdir(parents=True, exist_ok=True)
for kind in ("png", "svg"):
    picture.savefig(folder / f"picture.{kind}", dpi=150)
