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

from foreswitch._helpers.check import Array
from foreswitch._helpers.files import whole_file
from foreswitch._helpers.json import plain_data
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest, tree
from foreswitch._helpers.units import described, name_and_unit
from foreswitch.project.project import Project
from foreswitch.simulation.loop import simulate
from foreswitch.simulation.run import Run
from foreswitch.studies import pictures, report
from foreswitch.studies.pictures import QUANTILES
from foreswitch.studies.plan import Plan, key_unit, label

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from foreswitch.presentation.report import Report, Table

__all__ = ["Study", "csv_rows"]

#: Rows that are turned into text or Parquet at a time.
BLOCK = 65_536


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
        table |= {key: self.plan.column(key, point, repeat) for key in (*self.plan.axes, *self.plan.draws)}
        table["seed"] = self.plan.seeds(point, repeat)
        for i, name in enumerate(self.metrics):
            values = self.figures[rows[0] : rows[-1] + 1, i] if rows.size else np.empty(0)
            table[name] = values.astype(np.int64) if name.startswith("switches") else values
        return table

    def _blocks(self) -> Iterator[dict[str, np.ndarray[Any, Any]]]:
        for first in range(0, self.plan.rows, BLOCK):
            yield self.columns(first, first + BLOCK)

    def quantiles(self, quantiles: Sequence[float] = QUANTILES) -> dict[str, np.ndarray[Any, Any]]:
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
        table = {key: self.plan.column(key, points) for key in self.plan.axes}
        table |= {key: self.plan.column(key, points) for key, draw in self.plan.draws.items() if draw.per == "point"}
        for name in self.metrics:
            found = self.quantile(name, quantiles)
            table |= {f"{name}_q{_percent(q)}": found[i] for i, q in enumerate(quantiles)}
        return table

    def quantile(self, metric: str, quantiles: Sequence[float]) -> Array:
        """Quantiles of one figure of merit over the repeats.

        Parameters
        ----------
        metric : str
            One of `metrics`.
        quantiles : sequence of float
            Shares between 0 and 1.

        Returns
        -------
        ndarray, shape (quantiles, P)
        """
        given = np.asarray(quantiles, dtype=np.float64)
        if given.ndim != 1 or not given.size or not ((given >= 0.0) & (given <= 1.0)).all():
            raise Mistake("quantiles", quantiles, "give shares between 0 and 1")
        values = self.values(metric).reshape(self.plan.points, self.plan.repeats)
        with np.errstate(invalid="ignore"):  # a loop that runs away has no figures
            return np.asarray(np.quantile(values, given, axis=1))

    def values(self, metric: str) -> Array:
        """One figure of merit of all runs.

        Parameters
        ----------
        metric : str
            One of `metrics`.

        Returns
        -------
        ndarray, shape (P R,)
        """
        if metric not in self.metrics:
            raise Mistake("metric", metric, nearest(metric, self.metrics))
        return np.asarray(self.figures[:, self.metrics.index(metric)])

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
            raise Mistake("row", row, f"give one from 0 to {self.plan.rows - 1}")
        point, repeat = divmod(int(row), self.plan.repeats)
        setup = self.plan.setup(point, repeat, self.project.folder)
        seed = int(self.plan.seeds(point, repeat)[0])
        return simulate(setup.project.controller, setup.project.reference, **setup.settings, seed=seed)

    # What it says of itself -------------------------------------------------------------------------------------------

    def summary(self, quantiles: Sequence[float] = QUANTILES) -> dict[str, Any]:
        """The study as plain data: how many runs, and each grid point with its parameters and quantiles.

        Parameters
        ----------
        quantiles : sequence of float
            As in `quantiles`.

        Returns
        -------
        dict
            Numbers, lists, words and None, which stands for what is not finite; keys say their units, as in
            ``"rms_error_q50 [kPa]"``.
        """
        table = self.quantiles(quantiles)
        names = [described(name, self._units.get(name.rpartition("_q")[0]) or key_unit(name)) for name in table]
        columns = (values.tolist() for values in table.values())
        points = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        plan = self.plan
        found = {"runs": len(self), "repeats": plan.repeats, "seed": plan.seed, "points": points}
        plain: dict[str, Any] = plain_data(found)
        return plain

    @cached_property
    def _units(self) -> dict[str, str]:
        """By figure of merit, where it has one."""
        outputs = [name_and_unit(name)[1] for name in self.project.plant.output_names]
        inputs = self.project.plant.inputs
        return dict(zip(self.metrics, [*outputs, *outputs, *[""] * inputs, *["s"] * inputs], strict=True))

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
        return pictures.study_figure(self, metric or self.metrics[0], at or {}, quantiles)

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
        return report.study_table(self, most, brief=brief)

    def report(self, name: str) -> Report:
        """What was varied, the table and pictures, to be written as a page.

        Parameters
        ----------
        name : str
            The project's.

        Returns
        -------
        Report
        """
        return report.study_report(name, self)


def _percent(share: float) -> str:
    """05 for 0.05, 50 for 0.5, 97.5 for 0.975."""
    text = f"{100.0 * share:.6g}"
    return text.rjust(2, "0") if "." not in text else text


def csv_rows(block: dict[str, np.ndarray[Any, Any]], *, heads: bool = True) -> bytes:
    """Columns as CSV, every digit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if heads:
        writer.writerow(block)
    writer.writerows(zip(*(values.tolist() for values in block.values()), strict=True))
    return text.getvalue().encode()
