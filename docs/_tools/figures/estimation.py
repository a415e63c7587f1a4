"""The hot gas from its pressure alone, with and without an unknown load."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import DELAY, LAG, RISE, SLOPE, TS, Values, hot_gas_controller, save
from foreswitch.presentation import plots

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
    found = {f"estimated_{name}": value for name, value in values.items()}
    return found | {
        "leak_state_low": -means[0].max(), "leak_state_high": -means[0].min(), "leak_outputs": -means[1].mean(),
        "leak_load": np.abs(means[2]).max(),
        "slowest_periods": -1.0 / np.log(poles[0]), "other_periods": -1.0 / np.log(poles[1]),
    }  # fmt: skip


LOAD_LAW = hot_gas_controller(estimator=LOAD)
