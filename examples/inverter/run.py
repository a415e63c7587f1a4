"""A three-phase inverter: how much distortion a law leaves, and how often it switches for that."""

import sys
from pathlib import Path

import numpy as np

from foreswitch import baselines
from foreswitch.presentation import plots
from foreswitch.project import Project

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here / "out"
project = Project.read(here / "project.toml")
load, inverter = project.plant, project.controller
VOLTS, HENRY, OHM, EMF, AMPERE = 600.0, 5e-3, 0.1, 250.0, 20.0
TURN = 2.0 * np.pi * 50.0  # rad/s
CYCLES = 5  # of 20 ms, after one to settle
PHASES = np.exp(2j * np.pi / 3 * np.arange(3))  # where each leg pushes, alpha + j beta


def rotating(amplitude, t):
    """A sine in alpha and the same a quarter of a period later in beta."""
    return -1j * amplitude * np.exp(1j * TURN * t)


def figures(t, i, u):
    """Distortion of the current [%], switching frequency of a leg [Hz], amplitude [A], over whole cycles."""
    count = round(CYCLES * 0.02 / (t[1] - t[0]))
    t, i, u = t[-count - 1 :], i[-count - 1 :], u[-count - 1 :]
    sine = np.column_stack([np.sin(TURN * t), np.cos(TURN * t)])
    parts = np.column_stack([i.real, i.imag])
    fundamental = np.linalg.lstsq(sine[:-1], parts[:-1], rcond=None)[0]
    rest = parts - sine @ fundamental
    # straight from one switching instant to the next: the mean square of each piece
    power = np.sum(rest[1:] ** 2 + rest[1:] * rest[:-1] + rest[:-1] ** 2) / 3.0 / count
    amplitude = np.sqrt(0.5 * np.sum(fundamental**2))
    frequency = np.count_nonzero(np.diff(u, axis=0)) / 3 / 2 / (CYCLES * 0.02)
    return 100.0 * np.sqrt(power) / amplitude, frequency, amplitude


def predictive(truth=load, **changes):
    """The project's controller with other settings, or told something else about the load."""
    run = project.simulate(project.build_controller(**changes), plant=truth, duration=0.02 * (CYCLES + 1))
    return run.t, run.y @ [1.0, 1.0j], run.u


def faster(Ts, price):
    """A computer that needs less time, and switches as much more often."""
    quick = load.replace(input_delay=Ts)
    return predictive(quick, plant=quick, Ts=Ts, Td=Ts, switch_cost=price)


def relay(band, Ts, late):
    """No model: each leg up while its phase current is more than the band too small, down while it is too large."""
    truth = load.replace(input_delay=late * Ts)
    law = baselines.Relay(load, [[0, 1]] * 3, Ts, hysteresis=band, preview=late * inverter.lag[0])
    run = project.simulate(law, plant=truth, duration=0.02 * (CYCLES + 1))
    return run.t, run.y @ [1.0, 1.0j], run.u


def carrier(frequency):
    """What pulse-width modulation leaves at best: every leg switches once up and once down per carrier period."""
    half = 0.5 / frequency
    mid = (np.arange(round(0.02 / half)) + 0.5) * half
    voltage = rotating((OHM + 1j * TURN * HENRY) * AMPERE + EMF, mid)
    legs = (voltage[:, None] * PHASES.conj()).real / VOLTS
    legs += 0.5 - 0.5 * (legs.max(axis=1) + legs.min(axis=1))[:, None]
    # each leg is up for the last of the half period; the current's ripple is the integral of what is not the mean
    shares = (np.arange(400) + 0.5) / 400
    up = shares[None, :, None] > 1.0 - legs[:, None, :]
    ripple = np.cumsum(2.0 / 3.0 * VOLTS * up @ PHASES - voltage[:, None], axis=1) * half / 400 / HENRY
    return 100.0 * np.sqrt(np.mean(np.abs(ripple) ** 2)) / AMPERE, frequency, AMPERE


# every law over its own setting: a price on switching in A^2, a hysteresis in A
sweeps = {
    "predictive": {f"price {price:g}": predictive(switch_cost=price) for price in (0.01, 1, 2, 3, 4, 5, 6, 7)},
    "predictive, 25 us": {f"price {price:g}": faster(2.5e-5, price) for price in (0.5, 1, 1.5, 2, 2.5, 3, 4)},
    "relay": {f"{band:g} A": relay(band, 5e-5, 1) for band in (0, 0.5, 1, 2)},
    "comparators": {f"{band:g} A": relay(band, 5e-6, 0) for band in (1.5, 2, 2.5, 3, 3.5)},
}
runs = {f"{law}, {setting}": run for law, sweep in sweeps.items() for setting, run in sweep.items()}
rail = load.replace(u_offset=[0.0, 0.0, 0.0])
runs |= {
    "dead time left out": predictive(plant=load.replace(input_delay=0.0)),
    "Td = 200 us": predictive(Td=2e-4),
    "Td = 200 us, from the rail": predictive(Td=2e-4, plant=rail),
    "Td = 200 us, zero tail": predictive(Td=2e-4, tail="zero"),
}
found = {name: figures(*run) for name, run in runs.items()} | {"carrier PWM": carrier(2000.0)}

TRACES = "predictive, price 4", "relay, 0 A"
names = ("predictive, price 0.01", TRACES[0], "predictive, price 6", "predictive, 25 us, price 3", "carrier PWM",
         "comparators, 2.5 A", TRACES[1], *list(runs)[-4:])  # fmt: skip
print(f"{'':<28}{'distortion':>12}{'switching':>11}{'product':>10}{'amplitude':>11}")
print(f"{'':<28}{'[%]':>12}{'[kHz]':>11}{'[% kHz]':>10}{'[A]':>11}")
for name in names:
    distortion, frequency, amplitude = found[name]
    print(f"{name:<28}{distortion:12.1f}{1e-3 * frequency:11.2f}{1e-3 * distortion * frequency:10.1f}{amplitude:11.1f}")

picture = plots.figure(6, size=(7.2, 8.4), heights=[2.0, 0.45, 0.45, 0.45, 2.0, 0.45])
axes = iter(picture.axes)
cycle = slice(400, 801)
for name, shown, colours in zip(TRACES, ("abc", "a"), (plots.COLOURS[:2], plots.COLOURS[3:5]), strict=True):
    t, i, u = (values[cycle] for values in runs[name])
    current = next(axes)
    for part, label, colour in zip((np.real, np.imag), ("alpha", "beta"), colours, strict=True):
        wanted = part(rotating(AMPERE, t))
        plots.draw_output(current, 1e3 * t, part(i), wanted, label=f"{name}: {label}", colour=colour)
    once = dict(zip(*reversed(current.get_legend_handles_labels()), strict=True))  # the reference has two curves
    current.legend(once.values(), once.keys(), fontsize=8, frameon=False, loc="upper right", ncols=3)
    current.set_ylabel("current [A]", fontsize=9)
    current.set_ylim(-29.0, 34.0)
    for j, leg in enumerate(shown):
        below = next(axes)
        plots.draw_command(below, 1e3 * t, u[:-1, j], label="", colour=colours[0])
        below.set_title(f"leg {leg}: {name}", fontsize=8, loc="left")
        below.set_yticks([0, 1])
picture.axes[-1].set_xlabel("time [ms]", fontsize=9)

front = plots.figure(size=(7.2, 3.8))
(axes,) = front.axes
marks = {"predictive": "o", "predictive, 25 us": "o", "relay": "^", "comparators": "^"}
for (law, mark), colour in zip(marks.items(), plots.COLOURS[:1] * 2 + plots.COLOURS[3:4] * 2, strict=True):
    distortion, frequency, _ = np.array([found[f"{law}, {setting}"] for setting in sweeps[law]]).T
    fill = "none" if law in ("predictive, 25 us", "comparators") else "full"
    axes.plot(1e-3 * frequency, distortion, mark, color=colour, markersize=5, fillstyle=fill, label=law)
distortion, frequency, _ = found["dead time left out"]
axes.plot(1e-3 * frequency, distortion, "s", color=plots.COLOURS[1], markersize=5, label="dead time left out")
ideal = np.array([carrier(frequency) for frequency in (1300.0, 2000.0, 3000.0, 6500.0)])
axes.plot(1e-3 * ideal[:, 1], ideal[:, 0], color="0.6", zorder=0, label="carrier PWM, at best")
axes.set(xscale="log", yscale="log")
axes.set_xlabel("switching frequency of a leg [kHz]", fontsize=9)
axes.set_ylabel("distortion [%]", fontsize=9)
for axis, ticks in ((axes.xaxis, (1, 1.5, 2, 3, 4, 6)), (axes.yaxis, (3, 4, 6, 8, 10, 15, 20, 30))):
    axis.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    axis.set_ticks([], minor=True)
axes.legend(fontsize=8, frameon=False)

folder.mkdir(parents=True, exist_ok=True)
for kind in ("png", "svg"):
    picture.savefig(folder / f"picture.{kind}", dpi=150)
    front.savefig(folder / f"front.{kind}", dpi=150)
