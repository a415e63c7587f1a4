"""The paper's plant: a tank filled with hot gas through an on/off valve that answers late."""

import sys
from pathlib import Path

from foreswitch.presentation import plots
from foreswitch.project import Project

here = Path(__file__).parent
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here / "out"
project = Project.read(here / "project.toml")
tank, valve = project.plant, project.controller

laws = {
    "dead time left out": project.build_controller(plant=tank.replace(input_delay=0.0)),
    "dead time predicted": valve,
    "previewed by the lag": project.build_controller(preview="lag"),
    "previewed by 25 ms": project.build_controller(preview=True),
}
runs = {name: project.simulate(law, plant=tank) for name, law in laws.items()}

pulse = 16500.0 * valve.Ts  # kPa: what one period with the valve open adds
print(f"one pulse {pulse:g} kPa, lag by design {1e3 * valve.lag:.1f} ms")
print(f"{'':<24}{'rms error [kPa]':>16}{'overshoot [kPa]':>17}{'lag [ms]':>10}{'pulses':>8}")
for name, run in runs.items():
    m, over = run.metrics(), (run.y - run.r).max()
    print(f"{name:<24}{m['rms_error']:16.1f}{over:17.1f}{1e3 * m['lag']:z10.0f}{run.u.sum():8.0f}")

ignored, predicted, previewed, _ = runs.values()
t = 1e3 * predicted.t
shown = dict(zip(runs, (plots.COLOURS[1], plots.COLOURS[0], plots.COLOURS[2]), strict=False))
picture = plots.figure(5, size=(7.2, 7.6), heights=[2.4, 2.0, 0.5, 0.5, 0.5])
pressure, error, *valves = picture.axes
plots.draw_output(pressure, t, predicted.y[:, 0], predicted.r[:, 0], label="dead time predicted")
plots.draw_output(pressure, t, ignored.y[:, 0], None, label="dead time left out", colour=plots.COLOURS[1])
pressure.set_ylabel(tank.output_names[0], fontsize=9)
error.axhspan(-0.5 * pulse, 0.5 * pulse, color="0.92", zorder=0, label="half a pulse")
for axes, (name, colour) in zip(valves, shown.items(), strict=True):
    run = runs[name]
    plots.draw_output(error, t, (run.y - run.r)[:, 0], None, label=name, colour=colour)
    plots.draw_command(axes, t, run.u[:, 0], label="", colour=colour)
    axes.set_title(f"valve: {name}", fontsize=8, loc="left")
    axes.set_yticks([0, 1])
error.set_ylabel("error [kPa]", fontsize=9)
for axes in (pressure, error):
    axes.legend(fontsize=8, frameon=False)
valves[-1].set_xlabel("time [ms]", fontsize=9)

folder.mkdir(parents=True, exist_ok=True)
for kind in ("png", "svg"):
    picture.savefig(folder / f"picture.{kind}", dpi=150)
