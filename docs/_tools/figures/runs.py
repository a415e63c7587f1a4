"""Many runs: noise and gains drawn, dead time and gain over a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import DELAY, LAG, RISE, SLOPE, Values, hot_gas_controller, save
from foreswitch.demo.hot_gas import hot_gas_file
from foreswitch.presentation import plots
from foreswitch.project import Project


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
    for errors, colour, name in ((spread, plots.COLOURS[1], "gains spread"), (nominal, plots.COLOURS[0], "one gain")):
        left.hist(errors, bins=bins, color=colour, alpha=0.75, label=name)
    left.set_xlabel("rms error [kPa]", fontsize=9)
    left.set_ylabel("runs", fontsize=9)
    left.legend(fontsize=8, frameon=False)
    right.plot(gains, spread, ".", color=plots.COLOURS[1], markersize=3)
    right.plot(np.ones_like(nominal), nominal, ".", color=plots.COLOURS[0], markersize=3)
    right.set_xlabel("true gain / model's gain", fontsize=9)
    right.set_ylabel("rms error [kPa]", fontsize=9)
    right.set_ylim(0, None)
    save(figure, folder / "batch.svg")
    values: Values = {}
    for name, errors in (("batch", nominal), ("spread", spread)):
        values[f"{name}_low"], values[f"{name}_high"] = np.quantile(errors, [0.05, 0.95])
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
        "study_true": middle[8, 4], "study_late": middle[12, 4], "study_early": middle[4, 4],
        "study_band_late": upper[12], "study_band_early": upper[4],
    }  # fmt: skip
