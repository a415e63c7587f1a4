"""A study in pictures: which of them fits depends on how many of its axes are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest
from foreswitch._helpers.units import described
from foreswitch.studies import plots
from foreswitch.studies.distributions import LogUniform
from foreswitch.studies.plan import label, unit
from foreswitch.studies.plots import Scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from foreswitch.studies.result import Study

__all__ = ["QUANTILES", "drawn_figure", "metric_label", "study_figure"]

#: Shares of the runs that tables, bands and histograms mark.
QUANTILES = (0.05, 0.5, 0.95)
#: Drawn parameters that one picture has room for.
PANELS = 9

Axes = dict[str, tuple[Any, ...]]


def metric_label(study: Study, metric: str) -> str:
    """A figure of merit in words, with its unit."""
    plant = study.project.plant
    i = study.metrics.index(metric)
    if i < 2 * plant.outputs:
        return f"{'rms' if i < plant.outputs else 'largest'} error, {plant.output_names[i % plant.outputs]}"
    j = i - 2 * plant.outputs
    words = "switches" if j < plant.inputs else described("on-time", "s")
    return f"{words}, {plant.input_names[j % plant.inputs]}" if plant.inputs > 1 else words


def study_figure(
    study: Study, metric: str, at: Mapping[str, Any], quantiles: tuple[float, float] = (QUANTILES[0], QUANTILES[-1])
) -> Figure:
    """A heat map of medians over two free axes, panels for a third; median and band over one; a histogram without any."""
    plan = study.plan
    free, (central, low, high) = _held(study, at, study.quantile(metric, (0.5, *quantiles)))
    name = metric_label(study, metric)
    if len(free) > 3:
        subject, problem = f"{len(free)} axes", f"are free ({', '.join(free)})"
        raise Mistake("at", at, "hold all but three of them with at", problem=problem, subject=subject)
    if not free:
        return _spread(study, metric, at)
    if len(free) == 1:
        [(key, values)] = free.items()
        return plots.bands(_scale(key, values), low, central, high, metric=name, shares=quantiles, repeats=plan.repeats)
    return _maps(free, central, f"{name}, median of {plan.repeats}" if plan.repeats > 1 else name)


def _held(study: Study, at: Mapping[str, Any], fields: Array) -> tuple[Axes, Array]:
    """The axes that are left free, and fields (., points) over them, the others held at a value."""
    axes = study.plan.axes
    fields = fields.reshape(-1, *study.plan.shape)
    free: Axes = {}
    for i, (key, values) in reversed(list(enumerate(axes.items()))):
        held = at.get(key, values[0] if len(values) == 1 else None)
        if held is None and key not in at:
            free[key] = values
        elif held in values:
            fields = np.take(fields, values.index(held), axis=i + 1)
        else:
            remedy = f"its values are {', '.join(map(label, values))}"
            raise Mistake("at", held, remedy, problem=f"has {key} = {label(held)}", key=key)
    unknown = sorted(set(at) - set(axes))
    if unknown:
        problem = f"has {unknown[0]!r}, which is not an axis"
        raise Mistake("at", unknown[0], nearest(unknown[0], axes), problem=problem)
    return dict(reversed(free.items())), fields


def _maps(free: Axes, field: Array, name: str) -> Figure:
    """Two axes, and the shortest of three as panels."""
    scales = [_scale(key, values) for key, values in free.items()]
    for i, scale in enumerate(scales):
        if scale.positions is not None:
            order = np.argsort(scale.positions)
            scales[i] = Scale(scale.name, [scale.values[j] for j in order])
            field = np.take(field, order, axis=i)
    titles = [""]
    if len(scales) == 3:
        short = min(range(3), key=lambda i: len(scales[i].values))
        panel = scales.pop(short)
        field = np.moveaxis(field, short, 0)
        titles = [f"{panel.name} = {label(value)}" for value in panel.values]
    else:
        field = field[None]
    y, x = scales
    return plots.heat_maps(x, y, titles, field, metric=name)


def _spread(study: Study, metric: str, at: Mapping[str, Any]) -> Figure:
    """All runs of one point."""
    plan = study.plan
    index = [values.index(at.get(key, values[0])) for key, values in plan.axes.items()]
    point = int(np.ravel_multi_index(index, plan.shape)) if index else 0
    values = study.values(metric)[point * plan.repeats : (point + 1) * plan.repeats]
    with np.errstate(invalid="ignore"):  # a loop that runs away has no figures
        marks = [(float(np.quantile(values, share)), f"{100 * share:g} %") for share in QUANTILES]
    return plots.histogram(values, metric=metric_label(study, metric), marks=marks)


def drawn_figure(study: Study, metric: str) -> Figure | None:
    """Some of all runs over each number that was drawn; None where none was."""
    plan = study.plan
    first = study.columns(0, 1)
    keys = [key for key in plan.draws if first[key].dtype.kind in "if"]
    if not keys:
        return None
    rows = np.linspace(0, plan.rows - 1, min(plan.rows, plots.DOTS)).astype(np.int64)
    point, repeat = np.divmod(rows, plan.repeats)
    scales = [
        Scale(key + unit(key), np.broadcast_to(plan.drawn(key, point, repeat), rows.shape).tolist(),
              isinstance(plan.draws[key], LogUniform))
        for key in keys[:PANELS]
    ]  # fmt: skip
    return plots.scatter(scales, study.values(metric)[rows], metric=metric_label(study, metric))


def _scale(key: str, values: Sequence[Any]) -> Scale:
    return Scale(f"{key}{unit(key)}", values)
