"""Studies: a project's closed loop over grids of parameters and random ones, as one table of figures of merit."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers.check import Array
from foreswitch._helpers.files import whole_file
from foreswitch._helpers.text import nearest, tree
from foreswitch.presentation.report import Picture, Report, Section, Table, number
from foreswitch.project.project import Project
from foreswitch.simulation.loop import simulate
from foreswitch.simulation.run import Run
from foreswitch.studies import plots
from foreswitch.studies.distributions import LogUniform
from foreswitch.studies.plan import KEYS, Plan, full, label, plain_key, unit
from foreswitch.studies.plots import Scale

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Study", "csv_rows"]

QUANTILES = (0.05, 0.5, 0.95)
#: Rows that are turned into text or Parquet at a time.
BLOCK = 65_536
#: Grid points that a report lists.
LISTED = 200


@dataclass(frozen=True, eq=False)
class Study:
    """Figures of merit of all runs of a study: P grid points, R repeats of each, one after the other.

    Attributes
    ----------
    plan : Plan
        What was varied: ``plan.axes``, ``plan.draws``, ``plan.repeats``, ``plan.seed``.
    project : Project
        That of the first run.
    figures : ndarray, shape (P R, 2 q + 2 m)
        Columns as in `metrics`.
    """

    plan: Plan
    project: Project
    figures: Array

    @cached_property
    def metrics(self) -> tuple[str, ...]:
        """Names of the figures of merit: rms and largest error, switches and on-time, numbered where there are several."""
        q, m = self.project.plant.outputs, self.project.plant.inputs
        counts = {"rms_error": q, "max_error": q, "switches": m, "on_time": m}
        return tuple(name if count == 1 else f"{name}_{i + 1}" for name, count in counts.items() for i in range(count))

    def __len__(self) -> int:
        return self.plan.rows

    def __repr__(self) -> str:
        plan = self.plan
        wide = 2 + max(map(len, ["runs", *plan.axes, *plan.draws]))
        lines = [f"{key:<{wide}}{', '.join(map(label, values))}" for key, values in plan.axes.items()]
        lines += [f"{key:<{wide}}{draw}, one per {draw.per}" for key, draw in plan.draws.items()]
        lines.append(f"{'runs':<{wide}}{plan.points} point(s), {plan.repeats} repeat(s), seed {plan.seed}")
        return tree("Study", lines)

    # Tables -----------------------------------------------------------------------------------------------------------

    def columns(self, first: int = 0, last: int | None = None) -> dict[str, np.ndarray[Any, Any]]:
        """Point, repeat, parameters, seed and figures of merit by name, one row per run.

        Parameters
        ----------
        first, last : int
            Rows from the first up to the last; default all.

        Returns
        -------
        dict of str to ndarray
        """
        rows = np.arange(self.plan.rows)[first:last]
        point, repeat = np.divmod(rows, self.plan.repeats)
        table: dict[str, np.ndarray[Any, Any]] = {"point": point, "repeat": repeat}
        for key in self.plan.axes:
            table[key] = _flat(self.plan.axis(key, point))
        for key in self.plan.draws:
            table[key] = _flat(np.broadcast_to(self.plan.drawn(key, point, repeat), rows.shape))
        table["seed"] = self.plan.seeds(point, repeat)
        for i, name in enumerate(self.metrics):
            values = self.figures[rows[0] : rows[-1] + 1, i] if rows.size else np.empty(0)
            table[name] = values.astype(np.int64) if name.startswith("switches") else values
        return table

    def _blocks(self) -> Iterator[dict[str, np.ndarray[Any, Any]]]:
        for first in range(0, self.plan.rows, BLOCK):
            yield self.columns(first, first + BLOCK)

    def summary(self, quantiles: Sequence[float] = QUANTILES) -> dict[str, np.ndarray[Any, Any]]:
        """Quantiles over the repeats, one row per grid point.

        Parameters
        ----------
        quantiles : sequence of float
            Shares between 0 and 1.

        Returns
        -------
        dict of str to ndarray, shape (P,)
            The parameters, then ``rms_error_q05``, ``rms_error_q50`` and so on.
        """
        points = np.arange(self.plan.points)
        table = {key: _flat(self.plan.axis(key, points)) for key in self.plan.axes}
        for key, draw in self.plan.draws.items():
            if draw.per == "point":
                table[key] = _flat(self.plan.drawn(key, points, 0))
        for name in self.metrics:
            found = self._quantiles(name, quantiles)
            table |= {f"{name}_q{_percent(q)}": found[i] for i, q in enumerate(quantiles)}
        return table

    def _quantiles(self, metric: str, quantiles: Sequence[float]) -> Array:
        """Shape (quantiles, points)."""
        given = np.asarray(quantiles, dtype=np.float64)
        if given.ndim != 1 or not given.size or not ((given >= 0.0) & (given <= 1.0)).all():
            raise ValueError(f"quantiles is {quantiles!r}; give shares between 0 and 1")
        values = self._metric(metric).reshape(self.plan.points, self.plan.repeats)
        with np.errstate(invalid="ignore"):  # a loop that runs away has no figures
            return np.asarray(np.quantile(values, given, axis=1))

    def _metric(self, name: str) -> Array:
        if name not in self.metrics:
            raise ValueError(f"metric is {name!r}; {nearest(name, self.metrics)}")
        return np.asarray(self.figures[:, self.metrics.index(name)])

    def to_frame(self) -> pd.DataFrame:
        """`columns` as a table; needs pandas.

        Returns
        -------
        pandas.DataFrame
        """
        import pandas as pd

        return pd.DataFrame(self.columns())

    def to_parquet(self, path: str | Path) -> None:
        """Write `columns` as Parquet, whole or not at all; needs pyarrow.

        Parameters
        ----------
        path : path
        """
        import pyarrow as pa
        from pyarrow import parquet

        schema = pa.table(self.columns(0, 1)).schema
        with whole_file(path) as file, parquet.ParquetWriter(file, schema) as writer:
            for block in self._blocks():
                writer.write_table(pa.table(block, schema=schema))

    def to_csv(self, path: str | Path) -> None:
        """Write `columns` as CSV, every digit, whole or not at all.

        Parameters
        ----------
        path : path
        """
        with whole_file(path) as file:
            for i, block in enumerate(self._blocks()):
                file.write(csv_rows(block, heads=i == 0))

    # One run ----------------------------------------------------------------------------------------------------------

    def run(self, row: int) -> Run:
        """One of the runs again, with all its traces; its figures are those in the table, bit for bit.

        Parameters
        ----------
        row : int

        Returns
        -------
        Run
        """
        if not 0 <= row < self.plan.rows:
            raise ValueError(f"row is {row}; give one from 0 to {self.plan.rows - 1}")
        point, repeat = divmod(int(row), self.plan.repeats)
        setup = self.plan.setup(point, repeat, self.project.folder)
        seed = int(self.plan.seeds(point, repeat)[0])
        return simulate(setup.project.controller, setup.project.reference, **setup.settings, seed=seed)

    # Pictures ---------------------------------------------------------------------------------------------------------

    def plot(
        self,
        metric: str | None = None,
        *,
        at: Mapping[str, Any] | None = None,
        quantiles: tuple[float, float] = (QUANTILES[0], QUANTILES[-1]),
    ) -> Figure:
        """A heat map of medians over two axes, panels for a third; median and band over one; a histogram without any.

        Parameters
        ----------
        metric : str, optional
            One of `metrics`; default the first.
        at : dict, optional
            Axes held at one of their values.
        quantiles : (float, float)
            Ends of the band.

        Returns
        -------
        matplotlib.figure.Figure
        """
        metric = metric or self.metrics[0]
        middle = self._quantiles(metric, (0.5, *quantiles)).reshape(3, *self.plan.shape)
        free = {}
        for i, (key, values) in reversed(list(enumerate(self.plan.axes.items()))):
            held = (at or {}).get(key, values[0] if len(values) == 1 else None)
            if held is None and key not in (at or {}):
                free[key] = values
            elif held in values:
                middle = np.take(middle, values.index(held), axis=i + 1)
            else:
                raise ValueError(f"at has {key} = {label(held)}; its values are {', '.join(map(label, values))}")
        free = dict(reversed(free.items()))
        unknown = sorted(set(at or {}) - set(self.plan.axes))
        if unknown:
            raise ValueError(f"at has {unknown[0]!r}, which is no axis; {nearest(unknown[0], self.plan.axes)}")
        name = self._label(metric)
        if len(free) > 3:
            raise ValueError(f"{len(free)} axes are free ({', '.join(free)}); hold all but three of them with at")
        if not free:
            return self._spread(metric, at)
        if len(free) == 1:
            [(key, values)] = free.items()
            central, low, high = middle
            return plots.bands(
                _scale(key, values), low, central, high, metric=name, shares=quantiles, repeats=self.plan.repeats
            )
        return self._maps(free, middle[0], f"{name}, median of {self.plan.repeats}" if self.plan.repeats > 1 else name)

    def _maps(self, free: dict[str, tuple[Any, ...]], field: Array, name: str) -> Figure:
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

    def _spread(self, metric: str, at: Mapping[str, Any] | None) -> Figure:
        """All runs of one point."""
        index = [values.index((at or {}).get(key, values[0])) for key, values in self.plan.axes.items()]
        point = int(np.ravel_multi_index(index, self.plan.shape)) if index else 0
        values = self._metric(metric)[point * self.plan.repeats : (point + 1) * self.plan.repeats]
        with np.errstate(invalid="ignore"):
            marks = [(float(np.quantile(values, share)), f"{100 * share:g} %") for share in QUANTILES]
        return plots.histogram(values, metric=self._label(metric), marks=marks)

    def _scatter(self, metric: str) -> Figure | None:
        """Some of all runs over each number that was drawn."""
        keys = [key for key in self.plan.draws if self.columns(0, 1)[key].dtype.kind in "if"]
        if not keys:
            return None
        rows = np.linspace(0, self.plan.rows - 1, min(self.plan.rows, plots.DOTS)).astype(np.int64)
        point, repeat = np.divmod(rows, self.plan.repeats)
        scales = [
            Scale(key + unit(key), np.broadcast_to(self.plan.drawn(key, point, repeat), rows.shape).tolist(),
                  isinstance(self.plan.draws[key], LogUniform))
            for key in keys[:9]
        ]  # fmt: skip
        return plots.scatter(scales, self._metric(metric)[rows], metric=self._label(metric))

    def _label(self, metric: str) -> str:
        """A metric with its unit."""
        plant = self.project.plant
        q, m = plant.outputs, plant.inputs
        names = [*plant.output_names] * 2 + [*plant.input_names] * 2
        i = self.metrics.index(metric)
        words = ["rms error", "largest error", "switches", "on-time [s]"][
            0 if i < q else 1 if i < 2 * q else 2 if i < 2 * q + m else 3
        ]
        return f"{words}, {names[i]}" if i < 2 * q or m > 1 else words

    def table(self, most: int | None = None, *, brief: bool = False) -> Table:
        """Medians, and between which values nine tenths of the runs lie, by grid point; for reports and terminals.

        Parameters
        ----------
        most : int, optional
            Rows, at most; default all.
        brief : bool
            Short heads, and the ends of the first figure of merit only.

        Returns
        -------
        Table
        """
        shown, several = min(self.plan.points, most or self.plan.points), self.plan.repeats > 1
        points = np.arange(shown)
        tails = [key.split(".")[-1] for key in self.plan.axes]
        short = brief and len(set(tails)) == len(tails)
        heads = [
            "",
            *(name + unit(key) for name, key in zip(tails if short else self.plan.axes, self.plan.axes, strict=True)),
        ]
        cells = [[str(point + 1) for point in points]]
        cells += [[label(value) for value in _flat(self.plan.axis(key, points))] for key in self.plan.axes]
        for i, name in enumerate(self.metrics):
            words = self._label(name)
            heads.append(words.split(",")[0].replace("largest error", "largest") if brief else words)
            low, middle, high = ([number(value) for value in row[:shown]] for row in self._quantiles(name, QUANTILES))
            if several and not brief:
                middle = [f"{m} ({a}, {b})" for a, m, b in zip(low, middle, high, strict=True)]
            cells.append(middle)
            if several and brief and i == 0:
                heads += ["5 %", "95 %"]
                cells += [low, high]
        ends = "" if brief else "; in brackets 5 % and 95 %"
        caption = f"Medians of {self.plan.repeats} runs{ends}." if several else ""
        if shown < self.plan.points:
            caption += f" The first {shown} of {self.plan.points} points."
        return Table(heads, list(zip(*cells, strict=True)), caption.strip())

    def report(self, name: str) -> Report:
        """What was varied, the table and pictures.

        Parameters
        ----------
        name : str
            The project's.

        Returns
        -------
        Report
        """
        rows = [[key, ", ".join(map(label, values)), _meaning(key)] for key, values in self.plan.axes.items()]
        rows += [[key, f"{draw}, one per {draw.per}", _meaning(key)] for key, draw in self.plan.draws.items()]
        varied = [Table(["", "values", "meaning"], rows)] if rows else []
        pictures = []
        live = [key for key, values in self.plan.axes.items() if len(values) > 1]
        held = {key: self.plan.axes[key][0] for key in live[3:]}
        where = "".join(f" At {key} = {label(value)}." for key, value in held.items())
        for metric in self.metrics:
            caption = f"{self._label(metric)}.{where}"
            pictures.append(Picture(metric, self.plot(metric, at=held), caption[0].upper() + caption[1:]))
        drawn = self._scatter(self.metrics[0])
        if drawn is not None:
            pictures.append(Picture("drawn", drawn, "Over the parameters drawn; every dot is a run."))
        sections = [
            Section("Varied", [] if varied else ["Nothing but the seed."], varied),
            Section("Results", pictures=pictures),
            Section("Grid points", tables=[self.table(LISTED)]),
            Section("First run", code=f"{self.project.controller!r}"),
        ]
        lead = (
            f"{self.plan.points} point(s), {self.plan.repeats} run(s) each, seed {self.plan.seed}; "
            f"{self.plan.rows} runs in all."
        )
        return Report(f"{name}: study", lead, sections)


def _meaning(key: str) -> str:
    return KEYS[plain_key(full(key))].sentence


def _scale(key: str, values: Sequence[Any]) -> Scale:
    return Scale(f"{key}{unit(key)}", values)


def _percent(share: float) -> str:
    """05 for 0.05, 50 for 0.5, 97.5 for 0.975."""
    text = f"{100.0 * share:.6g}"
    return text.rjust(2, "0") if "." not in text else text


def _flat(values: ArrayLike) -> np.ndarray[Any, Any]:
    """A column: numbers as they are, lists and mixtures as text."""
    array = np.asarray(values)
    return np.array([label(value) for value in array]) if array.dtype.kind in "OU" or array.ndim > 1 else array


def csv_rows(block: dict[str, np.ndarray[Any, Any]], *, heads: bool = True) -> bytes:
    """Columns as CSV, every digit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if heads:
        writer.writerow(block)
    writer.writerows(zip(*(values.tolist() for values in block.values()), strict=True))
    return text.getvalue().encode()
