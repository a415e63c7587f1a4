"""From a pulse test to a model, and what the width of a pulse buys."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import LAG, SLOPE, TS, Values, save
from foreswitch.presentation import plots

#: The rig is simulated, and richer than the models fitted to its record.
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
    return {"pulse_delay_error": 1e3 * second.parameters["delay"][1], "pulse_worth": SLOPE * PULSES.width}


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
    return {"settled_cost": cost[1] / cost[0], "quiet_little": at[0.025], "quiet_quarter": at[0.25]}
