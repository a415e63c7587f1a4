"""One axis of a spacecraft: what a price on switching buys, and what dead time does to a phase-plane relay."""

import sys
from pathlib import Path

import numpy as np

from foreswitch import baselines
from foreswitch.presentation import plots
from foreswitch.project import Project

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here / "out"
project = Project.read(here / "project.toml")
craft, thrusters = project.plant, project.controller

FLOW = 1e3 * 2 * 0.1 / (60.0 * 9.81)  # g/s: two thrusters of 0.1 N, specific impulse 60 s
HOLD = 6000  # slewing and settling end here, at 60 s
SHORT, LONG = 0.04, 0.15  # dead times [s]


def predictive(delay, noise=project.file.simulation.noise, **changes):
    """Slew and hold under the project's controller, which is told the dead time."""
    plant = craft.replace(input_delay=delay)
    return project.simulate(project.build_controller(plant=plant, **changes), plant=plant, noise=noise)


def relay(delay, deadband, lead, noise=project.file.simulation.noise):
    """Fire while angle and lead times rate together are beyond the dead band: two lines in the phase plane."""
    law = baselines.Relay(craft, [-1, 0, 1], thrusters.Ts, min_on=0.03, deadband=deadband, lead=lead)
    return project.simulate(law, plant=craft.replace(input_delay=delay), noise=noise)


def hold_error(run):
    """Rms while holding [mdeg]."""
    return 1e3 * np.sqrt(np.mean((run.y - run.r)[HOLD:] ** 2))


def hold_burn(run):
    """Propellant while holding [g/h]."""
    return 3600.0 * FLOW * np.abs(run.u[HOLD:]).mean()


def burnt(run):
    """Propellant up to each switching instant [g]."""
    return np.cumsum(np.abs(run.u[:, 0])) * FLOW * run.Ts


def effect(Td, lam):
    """What one period of firing adds to the predicted s [deg]."""
    return thrusters.Ts * craft.B[1, 0] * (Td - 0.5 * thrusters.Ts + 1.0 / lam)


# what a switching costs, in units of the squared effect of one period
unit = effect(0.2, 0.5) ** 2
runs = {f"price {share:g}": predictive(LONG, switch_cost=share * unit) for share in (0.0, 0.5, 1.0, 1.5, 2.0)}
FREE, PRICED, DEAR = "price 0", "price 1", "price 2"
runs["price 1, no preview"] = predictive(LONG, preview=False)
runs["price 1, 40 ms"] = predictive(SHORT)

# both laws over their own settings, with a short and with a long dead time
soft = [(0.2, lam) for lam in (0.2, 0.3, 0.5, 1.0, 2.0, 5.0)]
bands, leads = (0.004, 0.006, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06), (0.25, 0.35, 0.5, 0.6, 0.7, 0.85, 1.0, 1.5, 2.0)
lines = [(band, lead) for band in bands for lead in leads]
trade = {}
for delay in (SHORT, LONG):
    trade["predictive", delay] = [predictive(delay, Td=a, lam=b, switch_cost=effect(a, b) ** 2) for a, b in soft]
    trade["relay", delay] = [relay(delay, *line) for line in lines]

# of the relays that hold to 10 mdeg, the one that burns least
best = {}
for delay, name in ((LONG, "relay"), (SHORT, "relay, 40 ms")):
    flown = [(hold_burn(run), line, run) for line, run in zip(lines, trade["relay", delay], strict=True)
             if hold_error(run) < 10.0]  # fmt: skip
    _, best[delay], runs[name] = min(flown, key=lambda item: item[0])

# star tracker and gyro as they come, not filtered
runs["price 1, 40 ms, raw sensors"] = predictive(SHORT, noise=[1e-3, 2e-3])
runs["relay, 40 ms, raw sensors"] = relay(SHORT, *best[SHORT], noise=[1e-3, 2e-3])

print(f"{'':<28}{'slew: largest':>14}{'':>9}{'hold: rms':>12}")
print(f"{'':<28}{'error [mdeg]':>14}{'fuel [g]':>9}{'[mdeg]':>12}{'[g/h]':>8}{'switchings/min':>16}")
for name, run in runs.items():
    slew = 1e3 * np.abs(run.y - run.r)[:HOLD].max()
    rate = np.count_nonzero(np.diff(run.u[HOLD:, 0])) * 60.0 / (run.t[-1] - run.t[HOLD])
    print(f"{name:<28}{slew:14.0f}{burnt(run)[HOLD]:9.2f}{hold_error(run):12.1f}{hold_burn(run):8.0f}{rate:16.0f}")

colours = {FREE: plots.COLOURS[1], PRICED: plots.COLOURS[0], "relay": plots.COLOURS[4]}
seen = slice(0, 10001)
picture = plots.figure(6, size=(7.2, 8.0), heights=[2.2, 1.6, 0.45, 0.45, 0.45, 1.4])
angle, error, *valves, fuel = picture.axes
t = runs[PRICED].t[seen]
plots.draw_output(angle, t, runs[PRICED].y[seen, 0], runs[PRICED].r[seen, 0], label="predictive, price 1")
angle.set_ylabel("attitude [deg]", fontsize=9)
angle.legend(fontsize=8, frameon=False)
for axes, (name, colour) in zip(valves, colours.items(), strict=True):
    run = runs[name]
    plots.draw_output(error, t, 1e3 * (run.y - run.r)[seen, 0], None, label=name, colour=colour)
    plots.draw_command(axes, t, run.u[seen, 0][:-1], label="", colour=colour)
    plots.draw_output(fuel, t[:-1], burnt(run)[seen][:-1], None, label=name, colour=colour)
    axes.set_title(f"thrusters: {name if name == 'relay' else 'predictive, ' + name}", fontsize=8, loc="left")
    axes.set_yticks([-1, 0, 1])
error.set_ylabel("error [mdeg]", fontsize=9)
fuel.set_ylabel("propellant [g]", fontsize=9)
fuel.legend(fontsize=8, frameon=False)
fuel.set_xlabel("time [s]", fontsize=9)

hold = plots.figure(1, 2, size=(7.2, 3.6))
plane, front = hold.axes
for name in ("relay", FREE, PRICED):
    run = runs[name]
    path = 1e3 * (run.x - np.column_stack([run.r, 0.0 * run.r]))[HOLD : HOLD + 2000]
    plane.plot(*path.T, color=colours[name], linewidth=0.8, label=name)
plane.set_ylim(-55.0, 80.0)
plane.set_xlabel("angle from target [mdeg]", fontsize=9)
plane.set_ylabel("rate [mdeg/s]", fontsize=9)
plane.legend(fontsize=8, frameon=False)
trade["price 0 and 2", LONG] = [runs[FREE], runs[DEAR]]
styles = {"predictive": ("o", colours[PRICED]), "relay": ("^", colours["relay"]), "price 0 and 2": ("s", colours[FREE])}
for (law, delay), flown in trade.items():
    marker, colour = styles[law]
    front.loglog(
        [hold_burn(run) for run in flown], [hold_error(run) for run in flown], marker, color=colour, markersize=4,
        fillstyle="full" if delay == LONG else "none", label=f"{law}, {1e3 * delay:g} ms",
    )  # fmt: skip
for axis in (front.xaxis, front.yaxis):
    axis.set_major_formatter("{x:g}")
front.set_xlabel("propellant [g/h]", fontsize=9)
front.set_ylabel("rms error [mdeg]", fontsize=9)
front.legend(fontsize=7, frameon=False, loc="lower left")

folder.mkdir(parents=True, exist_ok=True)
for kind in ("png", "svg"):
    picture.savefig(folder / f"picture.{kind}", dpi=150)
    hold.savefig(folder / f"hold.{kind}", dpi=150)
