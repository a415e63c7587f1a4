"""Pictures of a record and of what was fitted to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.identification.statistics import LAGS, Estimate
from foreswitch.presentation import plots
from foreswitch.presentation.plots import COLOURS, draw_command, draw_output, figure, time_scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["pulse_figure", "pulse_windows", "record_figure", "residual_figure"]

#: Samples that a line shows at most; a longer record is thinned out.
MOST = 20000
#: Single pulses drawn behind their average.
SINGLE = 60
#: Share of the time between pulses that is shown before one.
BEFORE = 0.1
MEASURED = "0.45"


def _segments(estimate: Estimate) -> list[tuple[slice, Any, Array]]:
    """Per segment fitted: where it lies in the record, which of its samples to draw, and their times after its start."""
    problem, result = estimate.problem, []
    for stretch, rows in zip(problem.stretches, problem.samples, strict=True):
        thin = np.arange(0, rows.size, -(-rows.size // MOST))
        t = problem.record.t
        result.append((stretch, thin, t[rows[thin]] - t[stretch.start]))
    return result


def record_figure(estimate: Estimate) -> Figure:
    """Each output with the simulated fit, and each input, segments side by side."""
    problem = estimate.problem
    record, parts = problem.record, _segments(estimate)
    q, m = len(problem.outputs), record.u.shape[1]
    fig = figure(q + m, len(parts), size=(max(7.2, 3.6 * len(parts)), 2.3 * q + 1.0 * m + 0.5),
                 heights=[2.3] * q + [1.0] * m)  # fmt: skip
    grid = np.array(fig.axes).reshape(q + m, len(parts))
    for column, (stretch, thin, t) in enumerate(parts):
        factor, label = time_scale(float(t[-1]))
        for o in range(q):
            y, residual = problem.y[o][column][thin], estimate.residuals(o)[column][thin]
            axes = grid[o, column]
            axes.plot(factor * t, y, ".", color=MEASURED, markersize=3.0, label="measured", rasterized=y.size > 3000)
            draw_output(axes, factor * t, y - residual, None, label=f"fit, {estimate.fit_percent(o):.1f} %")
        for j in range(m):
            rows = np.arange(stretch.start, stretch.stop, -(-(stretch.stop - stretch.start) // MOST))
            edges = np.r_[record.t[rows], record.t[stretch.stop - 1] + record.Ts] - record.t[stretch.start]
            draw_command(grid[q + j, column], factor * edges, record.u[rows, j], label="")
        grid[-1, column].set_xlabel(label, fontsize=9)
    for o, i in enumerate(problem.outputs):
        grid[o, 0].set_ylabel(record.output_names[i], fontsize=9)
        grid[o, 0].legend(fontsize=8, frameon=False)
    for j, name in enumerate(record.input_names):
        grid[q + j, 0].set_ylabel(name, fontsize=9)
    return fig


@dataclass(frozen=True)
class Pulses:
    """The pulses of the most frequent kind on one input: first samples, and seconds that they last and have."""

    at: Array
    width: float
    room: float


def equal_pulses(estimate: Estimate, j: int) -> Pulses | None:
    """None where no pulse repeats."""
    record, tolerance = estimate.problem.record, 0.1 * estimate.problem.record.Ts
    kinds: dict[tuple[int, float, float], list[tuple[int, float]]] = {}
    for stretch in estimate.problem.stretches:
        t, u = record.t[stretch], record.u[stretch, j]
        edges = np.flatnonzero(np.diff(u)) + 1
        ends = np.r_[t[edges], t[-1]]
        for i in range(edges.size - 1):
            low, high, after = u[edges[i] - 1], u[edges[i]], u[edges[i + 1]]
            if low == after:
                width = ends[i + 1] - ends[i]
                key = (round(width / tolerance), float(low), float(high))
                kinds.setdefault(key, []).append((stretch.start + int(edges[i]), float(ends[i + 2] - ends[i])))
    # of a square wave both halves are pulses; the shorter one, or the one upwards, is meant
    repeated = [(len(found), -key[0], key[2] > key[1], found, key) for key, found in kinds.items() if len(found) >= 2]
    if not repeated:
        return None
    *_, found, key = max(repeated, key=lambda item: item[:3])
    room = float(np.median([length for _, length in found]))
    return Pulses(np.array([at for at, length in found if length > 0.99 * room]), key[0] * tolerance, room)


def pulse_figure(estimate: Estimate) -> Figure | None:
    """The average response to equal pulses with its scatter, and the fit's (the paper's Fig. 3); None without pulses."""
    problem, record = estimate.problem, estimate.problem.record
    q, found = len(problem.outputs), []
    for j in range(record.u.shape[1]):
        if pulses := equal_pulses(estimate, j):
            grid = np.linspace(-BEFORE * pulses.room, (1.0 - 1e-9) * pulses.room, 240)
            windows = [pulse_windows(estimate, o, pulses, grid) for o in range(q)]
            if len(windows[0][0]) >= 2:  # others lie at the record's ends or over skipped stretches
                found.append((j, pulses, grid, windows))
    if not found:
        return None
    fig = figure(q, len(found), size=(max(7.2, 4.2 * len(found)), 3.2 * q + 0.3))
    axes_of = np.array(fig.axes).reshape(q, len(found))
    for column, (j, pulses, grid, windows) in enumerate(found):
        factor, label = time_scale(pulses.room)
        for o, (measured, fitted) in enumerate(windows):
            axes, t = axes_of[o, column], factor * grid
            for line in measured[:: -(-len(measured) // SINGLE)]:
                axes.plot(t, line, color=MEASURED, linewidth=0.4, alpha=0.25, zorder=1)
            mean, spread = measured.mean(axis=0), measured.std(axis=0, ddof=1)
            axes.fill_between(t, mean - spread, mean + spread, color="0.75", zorder=0, label="± one deviation")
            axes.plot(t, mean, color="0.15", linewidth=1.3, label=f"average of {len(measured)}", zorder=3)
            name = str(problem.structures[o])
            axes.plot(t, fitted.mean(axis=0), "--", color=COLOURS[1], linewidth=1.3, label=name, zorder=4)
            axes.axvspan(0.0, factor * pulses.width, color=COLOURS[0], alpha=0.15, linewidth=0, label="pulse")
            axes.set_ylabel(f"{record.output_names[problem.outputs[o]]}, change", fontsize=9)
            axes.legend(fontsize=8, frameon=False)
        since = f"time since a pulse of {record.input_names[j]}"
        axes_of[-1, column].set_xlabel(label.replace("time", since), fontsize=9)
    return fig


def pulse_windows(estimate: Estimate, o: int, pulses: Pulses, grid: Array) -> tuple[Array, Array]:
    """Measured and fitted output about each pulse, from the fitted value at its start; (pulses, grid) each."""
    problem, measured, fitted = estimate.problem, [], []
    for s, rows in enumerate(problem.samples):
        t, y = problem.record.t[rows], problem.y[o][s]
        fit = y - estimate.residuals(o)[s]
        for at in pulses.at[(pulses.at >= problem.stretches[s].start) & (pulses.at < problem.stretches[s].stop)]:
            instants = problem.record.t[at] + grid
            inside = slice(*np.searchsorted(t, [instants[0] - 1e-9, instants[-1] + 1e-9]))
            if (
                instants[0] < t[0]
                or instants[-1] > t[-1]
                or np.diff(t[inside]).max(initial=0.0) > 5.0 * problem.shortest
            ):
                continue  # at the record's ends, or over a skipped stretch
            start = np.interp(problem.record.t[at], t, fit)
            measured.append(np.interp(instants, t, y) - start)
            fitted.append(np.interp(instants, t, fit) - start)
    return np.array(measured), np.array(fitted)


def residual_figure(estimate: Estimate) -> Figure:
    """What the fit leaves, over time, and its autocorrelation with the band that white noise stays in."""
    problem = estimate.problem
    q = len(problem.outputs)
    fig = plots.figure(2 * q, size=(7.2, 3.6 * q), heights=[1.3, 1.0] * q, shared=False)
    for o in range(q):
        over_time, correlation = fig.axes[2 * o : 2 * o + 2]
        name = problem.record.output_names[problem.outputs[o]]
        factor, label = time_scale(sum(float(grid.t[-1]) for grid in problem.grids))
        begun = 0.0
        for column, (_, thin, t) in enumerate(_segments(estimate)):
            residual = estimate.residuals(o)[column][thin]
            over_time.plot(factor * (begun + t), residual, ".", color=COLOURS[column % 6], markersize=2.0,
                           rasterized=residual.size > 3000)  # fmt: skip
            begun += float(problem.grids[column].t[-1])
        over_time.set_ylabel(f"residual\n{name}", fontsize=9)
        over_time.set_xlabel(label, fontsize=9)
        _, r = estimate.whiteness(o)
        lags = np.arange(1, r.size)
        band = 2.0 / np.sqrt(estimate.samples)
        correlation.axhspan(-band, band, color="0.88", zorder=0, label="95 % of white noise")
        correlation.vlines(lags, 0.0, r[1:], color=COLOURS[0], linewidth=2.5)
        correlation.axhline(0.0, color="0.3", linewidth=0.6)
        top = max(3.0 * band, 1.1 * float(np.abs(r[1:]).max(initial=0.0)))
        correlation.set_ylim(-top if r[1:].min(initial=0.0) < -band else -1.5 * band, top)
        correlation.set_xlim(0.0, LAGS + 1)
        correlation.set_ylabel("auto-\ncorrelation", fontsize=9)
        correlation.set_xlabel("samples apart", fontsize=9)
        correlation.legend(fontsize=8, frameon=False)
    return fig
