"""A study as a table and as a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foreswitch.presentation.report import Picture, Report, Section, Table, number
from foreswitch.studies.pictures import QUANTILES, drawn_figure, metric_label, study_figure
from foreswitch.studies.plan import KEYS, full, label, plain_key, unit

if TYPE_CHECKING:
    from foreswitch.studies.result import Study

__all__ = ["study_report", "study_table"]

#: Grid points that a report lists.
LISTED = 200


def study_table(study: Study, most: int | None = None, *, brief: bool = False) -> Table:
    """Medians, and between which values nine tenths of the runs lie, by grid point."""
    plan = study.plan
    shown, several = min(plan.points, most or plan.points), plan.repeats > 1
    points = np.arange(shown)
    tails = [key.split(".")[-1] for key in plan.axes]
    short = brief and len(set(tails)) == len(tails)
    names = tails if short else list(plan.axes)
    heads = ["", *(name + unit(key) for name, key in zip(names, plan.axes, strict=True))]
    cells = [[str(point + 1) for point in points]]
    cells += [[label(value) for value in plan.column(key, points)] for key in plan.axes]
    for i, metric in enumerate(study.metrics):
        words = metric_label(study, metric)
        heads.append(words.split(",")[0].replace("largest error", "largest") if brief else words)
        low, middle, high = ([number(value) for value in row[:shown]] for row in study.quantile(metric, QUANTILES))
        if several and not brief:
            middle = [f"{m} ({a}, {b})" for a, m, b in zip(low, middle, high, strict=True)]
        cells.append(middle)
        if several and brief and i == 0:
            heads += ["5 %", "95 %"]
            cells += [low, high]
    ends = "" if brief else "; in brackets 5 % and 95 %"
    caption = f"Medians of {plan.repeats} runs{ends}." if several else ""
    if shown < plan.points:
        caption += f" The first {shown} of {plan.points} points."
    return Table(heads, list(zip(*cells, strict=True)), caption.strip())


def study_report(name: str, study: Study) -> Report:
    """What was varied, the table and pictures."""
    plan = study.plan
    varied = _varied(study)
    sections = [
        Section("Varied", [] if varied else ["Nothing but the seed."], varied),
        Section("Results", pictures=_pictures(study)),
        Section("Grid points", tables=[study_table(study, LISTED)]),
        Section("First run", code=f"{study.project.controller!r}"),
    ]
    lead = f"{plan.points} point(s), {plan.repeats} run(s) each, seed {plan.seed}; {plan.rows} runs in all."
    return Report(f"{name}: study", lead, sections)


def _varied(study: Study) -> list[Table]:
    plan = study.plan
    rows = [[key, ", ".join(map(label, values)), _meaning(key)] for key, values in plan.axes.items()]
    rows += [[key, f"{draw}, one per {draw.per}", _meaning(key)] for key, draw in plan.draws.items()]
    return [Table(["", "values", "meaning"], rows)] if rows else []


def _pictures(study: Study) -> list[Picture]:
    """Each figure of merit over up to three axes, and the first over what was drawn."""
    axes = study.plan.axes
    live = [key for key, values in axes.items() if len(values) > 1]
    held = {key: axes[key][0] for key in live[3:]}
    where = "".join(f" At {key} = {label(value)}." for key, value in held.items())
    pictures = []
    for metric in study.metrics:
        caption = f"{metric_label(study, metric)}.{where}"
        pictures.append(Picture(metric, study_figure(study, metric, held), caption[0].upper() + caption[1:]))
    drawn = drawn_figure(study, study.metrics[0])
    if drawn is not None:
        pictures.append(Picture("drawn", drawn, "Over the parameters drawn; every dot is a run."))
    return pictures


def _meaning(key: str) -> str:
    return KEYS[plain_key(full(key))].sentence
