"""Pictures of a study: heat maps over two axes, bands over one, histograms and scatter over none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.presentation import plots
from foreswitch.studies.distributions import column
from foreswitch.studies.plan import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = ["Scale", "bands", "heat_maps", "histogram", "scatter"]

#: Cells that still have room for their number, and for a tick.
WRITTEN, TICKS = 12, 10
#: Share of a picture's width that a mark's words take.
TOUCH = 0.06
#: Values whose range is a smaller share of themselves are alike.
ALIKE = 0.05
#: Points that a scatter shows; more would only be ink.
DOTS = 3000


@dataclass(frozen=True)
class Scale:
    """An axis of a study: its label, its values, and whether a logarithmic scale suits them; None: as they are spaced."""

    name: str
    values: Sequence[Any]
    log: bool | None = None

    @property
    def positions(self) -> Array | None:
        """Where the values lie; None for words, lists and truths, which lie side by side."""
        values = column(self.values)
        return values.astype(np.float64) if values.dtype.kind in "if" else None

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spaced by a ratio rather than by a difference."""
        at = self.positions
        if self.log is not None:
            return self.log
        if at is None or len(at) < 3 or at.min() <= 0.0 or at.max() < 4.0 * at.min():
            return False
        at = np.sort(at)
        return bool(np.ptp(np.diff(np.log(at))) < np.ptp(np.diff(at)) / np.mean(np.diff(at)))


def bands(
    scale: Scale, low: Array, middle: Array, high: Array, *, metric: str, shares: tuple[float, float], repeats: int
) -> Figure:
    """The median over an axis, and between which values the runs lie."""
    figure = plots.figure(1, size=(7.2, 3.6))
    axes = figure.axes[0]
    at = scale.positions
    order = np.arange(len(middle)) if at is None else np.argsort(at)
    x = np.arange(len(middle), dtype=np.float64) if at is None else at[order]
    low, middle, high = low[order], middle[order], high[order]
    colour = plots.COLOURS[0]
    if at is None:
        errors = np.array([middle - low, high - middle]) if repeats > 1 else None
        axes.errorbar(x, middle, errors, fmt="o", color=colour, capsize=4, label=_named("median", shares, repeats))
        axes.set_xticks(x, [label(value) for value in scale.values], fontsize=8)
        axes.margins(x=0.15)
    else:
        if repeats > 1:
            between = f"{100 * shares[0]:g} to {100 * shares[1]:g} % of {repeats} runs"
            axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0, label=between)
        axes.plot(x, middle, "o-", color=colour, linewidth=1.3, markersize=3.5, label="median")
        if scale.logarithmic:
            axes.set_xscale("log")
    _limits(axes, low if repeats > 1 else middle, high if repeats > 1 else middle)
    axes.set_xlabel(scale.name, fontsize=9)
    axes.set_ylabel(metric, fontsize=9)
    if repeats > 1:  # above the picture, where nothing is drawn
        axes.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return figure


def _named(name: str, shares: tuple[float, float], repeats: int) -> str:
    return f"{name}, {100 * shares[0]:g} to {100 * shares[1]:g} % of {repeats} runs" if repeats > 1 else name


def _limits(axes: Axes, low: Array, high: Array) -> None:
    """Zero is in sight where it is near, compared with how much the values differ; what hardly differs looks so."""
    finite = np.concatenate([low, high])
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return
    if 0.0 <= finite.min() < 0.5 * finite.max():
        axes.set_ylim(0.0, None)
    elif np.ptp(finite) < ALIKE * np.abs(finite).max():
        middle, half = float(np.mean([finite.min(), finite.max()])), ALIKE * float(np.abs(finite).max())
        axes.set_ylim(middle - half, middle + half)


def heat_maps(x: Scale, y: Scale, panels: Sequence[str], values: Array, *, metric: str) -> Figure:
    """Values over two axes, one panel for each value of a third; ``values`` has shape (panels, y, x)."""
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    width, height = (6.4, 4.2) if len(panels) == 1 else (1.2 + 2.9 * columns, 0.6 + 2.5 * rows)
    figure = plots.figure(rows, columns, size=(width, height), shared=False)
    finite = values[np.isfinite(values)]
    norm = _norm(finite)
    image = None
    for axes, title, field in zip(figure.axes, panels, values, strict=False):
        axes.grid(visible=False)
        image = axes.pcolormesh(
            np.ma.masked_invalid(field), norm=norm, cmap="viridis", edgecolor="white", linewidth=0.4
        )
        _ticks(axes.xaxis, x)
        _ticks(axes.yaxis, y)
        axes.set_title(title, fontsize=8, loc="left")
        if max(field.shape) <= WRITTEN and len(panels) == 1:
            _write(axes, field, norm)
    for axes in figure.axes[len(panels) :]:
        axes.set_visible(False)
    drawn = list(figure.axes)
    for i, axes in enumerate(drawn[: len(panels)]):
        axes.set_xlabel(x.name if i + columns >= len(panels) else "", fontsize=9)
        axes.set_ylabel(y.name if i % columns == 0 else "", fontsize=9)
    if image is not None:
        bar = figure.colorbar(image, ax=drawn[: len(panels)], fraction=0.05, pad=0.02)
        bar.set_label(metric, fontsize=9)
        bar.ax.tick_params(labelsize=8)
        bar.outline.set_visible(False)
    return figure


def _norm(finite: Array) -> Normalize:
    from matplotlib.colors import LogNorm, Normalize

    if finite.size and finite.min() > 0.0 and finite.max() > 30.0 * finite.min():
        return LogNorm(finite.min(), finite.max())
    return Normalize(finite.min(), finite.max()) if finite.size else Normalize()


def _ticks(axis: Any, scale: Scale) -> None:
    """Cells are equally wide whatever the values, which are written below some of them."""
    step = -(-len(scale.values) // TICKS)
    shown = range(0, len(scale.values), step)
    axis.set_ticks([i + 0.5 for i in shown], labels=[label(scale.values[i]) for i in shown], fontsize=8)


def _write(axes: Axes, field: Array, norm: Normalize) -> None:
    for (i, j), value in np.ndenumerate(field):
        if np.isfinite(value):
            colour = "black" if float(norm(float(value))) > 0.6 else "white"
            axes.text(j + 0.5, i + 0.5, f"{value:#.3g}".rstrip("."), ha="center", va="center", fontsize=7, color=colour)


def histogram(values: Array, *, metric: str, marks: Sequence[tuple[float, str]]) -> Figure:
    """How a figure of merit is spread over all runs."""
    figure = plots.figure(1, size=(7.2, 3.2))
    axes = figure.axes[0]
    finite = values[np.isfinite(values)]
    whole = bool(finite.size) and bool((finite == np.round(finite)).all())
    if whole and np.ptp(finite) <= 60:
        bins: Any = np.arange(finite.min() - 0.5, finite.max() + 1.0)
    else:
        bins = min(60, max(8, round(np.sqrt(finite.size))))
    axes.hist(finite, bins=bins, color=plots.COLOURS[0], alpha=0.75)
    left, right = axes.get_xlim()
    written: list[tuple[float, list[str]]] = []  # marks that nearly touch share their words
    for at, name in marks:
        if not np.isfinite(at):
            continue
        axes.axvline(at, color="0.25", linewidth=1.0, linestyle=":")
        if written and at - written[-1][0] < TOUCH * (right - left):
            written[-1][1].append(name)
        else:
            written.append((at, [name]))
    for at, names in written:
        axes.annotate(", ".join(names), (at, 1.0), xycoords=("data", "axes fraction"), fontsize=8, color="0.25",
                      xytext=(2, 1), textcoords="offset points")  # fmt: skip
    axes.set_xlabel(metric, fontsize=9)
    axes.set_ylabel("runs", fontsize=9)
    return figure


def scatter(drawn: Sequence[Scale], values: Array, *, metric: str) -> Figure:
    """A figure of merit over each parameter that was drawn."""
    columns = min(len(drawn), 3)
    rows = -(-len(drawn) // columns)
    figure = plots.figure(rows, columns, size=(7.2, 0.6 + 2.6 * rows), shared=False)
    for axes, scale in zip(figure.axes, drawn, strict=False):
        axes.plot(scale.values, values, ".", color=plots.COLOURS[0], markersize=2.5, alpha=0.6)
        if scale.logarithmic:
            axes.set_xscale("log")
        axes.set_xlabel(scale.name, fontsize=9)
    for axes in figure.axes[len(drawn) :]:
        axes.set_visible(False)
    for i, axes in enumerate(figure.axes[: len(drawn)]):
        axes.set_ylabel(metric if i % columns == 0 else "", fontsize=9)
        _limits(axes, values, values)
    return figure
