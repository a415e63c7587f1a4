"""Pictures of arrays: every one through `figure`, so that all look alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from foreswitch._helpers.check import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "draw_command", "draw_output", "figure", "time_plot"]

#: Told apart also by colour-blind readers (Okabe and Ito 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
REFERENCE = "#9a9a9a"


def figure(
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float],
    heights: Sequence[float] | None = None,
    shared: bool = True,
) -> Figure:
    """A figure with a grid of axes, light grid lines and no box; time axes are shared by column unless told not to."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=size, layout="constrained")
    fig.subplots(rows, columns, squeeze=False, sharex="col" if shared else "none", height_ratios=heights)
    for axes in fig.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.tick_params(labelsize=8)
    return fig


def time_scale(duration: float) -> tuple[float, str]:
    """Factor and label that keep a time axis readable."""
    if duration < 1.0:
        return 1e3, "time [ms]"
    return (1.0, "time [s]") if duration < 1000.0 else (1.0 / 60.0, "time [min]")


def draw_output(axes: Axes, t: Array, y: Array, r: Array | None, *, label: str, colour: str = COLOURS[0]) -> None:
    """An output, its reference wide and grey behind it."""
    if r is not None:
        axes.plot(t, r, color=REFERENCE, linewidth=3.0, alpha=0.7, label="reference", zorder=1)
    axes.plot(t, y, color=colour, linewidth=1.1, label=label, zorder=2)


def draw_command(axes: Axes, t: Array, u: Array, *, label: str, colour: str = COLOURS[0]) -> None:
    """A command as stairs: each value holds for its period."""
    axes.stairs(u, t, color=colour, linewidth=0.9, label=label, baseline=None)


def time_plot(
    t: Array, y: Array, r: Array, u: Array, output_names: Sequence[str], input_names: Sequence[str], *, title: str = ""
) -> Figure:
    """Each output above its reference, each command as stairs below.

    Parameters
    ----------
    t : ndarray, shape (K+1,)
        Seconds.
    y, r : ndarray, shape (K+1, q)
    u : ndarray, shape (K, m)
    output_names, input_names : sequence of str
        Axis labels, with their units.
    title : str
    """
    q, m = y.shape[1], u.shape[1]
    fig = figure(q + m, size=(7.2, 2.2 * q + 1.0 * m + 0.6), heights=[2.4] * q + [1.0] * m)
    factor, label = time_scale(float(t[-1] - t[0]))
    for i, axes in enumerate(fig.axes[:q]):
        draw_output(axes, t * factor, y[:, i], r[:, i], label="output")
        axes.set_ylabel(output_names[i], fontsize=9)
        axes.legend(fontsize=8, frameon=False)
    for j, axes in enumerate(fig.axes[q:]):
        draw_command(axes, t * factor, u[:, j], label="command")
        axes.set_ylabel(input_names[j], fontsize=9)
    fig.axes[-1].set_xlabel(label, fontsize=9)
    if title:
        fig.suptitle(title, fontsize=10)
    return fig


def duration_text(seconds: float) -> str:
    """A duration in the unit its time axis would have."""
    factor, label = time_scale(seconds)
    return f"{seconds * factor:g} {label.split('[')[1].rstrip(']')}"
