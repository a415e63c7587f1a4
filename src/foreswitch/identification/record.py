"""Records of an experiment: when, what was commanded, what was measured."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.csv import read_columns, write_columns
from foreswitch._helpers.mistake import Mistake, inside, shown
from foreswitch._helpers.text import tree

__all__ = ["Record"]

#: Fewer samples than this in a stretch leave nothing to judge a fit by.
FEWEST = 8


class Record:
    """What a rig recorded: instants, commands and measurements, in one or more separate stretches.

    Parameters
    ----------
    t : array_like, shape (N,)
        Instants [s], ascending within each segment, evenly spaced or not.
    u : array_like, shape (N,) or (N, m)
        Commands; each holds from its instant to the next one. The first of a segment must have held for as long as
        the dead time before: begin a record before the first switching.
    y : array_like, shape (N,) or (N, q)
        Measurements at the instants.
    segments : array_like, shape (N,), optional
        A label per sample; a new segment begins where it changes. Segments are separate experiments: each has its own
        initial state and offset. Default: one segment.
    skip : sequence of (float, float)
        Stretches ``from, to`` [s] to leave out. What was measured there is not used and may be NaN; the command there
        still acts, and where it is NaN itself the record is cut in two.
    input_names, output_names : sequence of str, optional
        May carry units; they reach the plant, plots and files.

    Raises
    ------
    ValueError
        If the record is empty or short, shapes contradict each other, instants repeat or run backwards, a number
        outside the skipped stretches is not finite, or a command or measurement never changes.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> Record(t, t >= 0.2, np.maximum(t - 0.25, 0.0))
    Record
    ├─ samples   100, every 0.01 s, 1 segment(s)
    ├─ input u   levels 0, 1; 1 change(s)
    └─ output y  0 to 0.74
    """

    def __init__(
        self,
        t: ArrayLike,
        u: ArrayLike,
        y: ArrayLike,
        *,
        segments: ArrayLike | None = None,
        skip: Sequence[tuple[float, float]] = (),
        input_names: Sequence[str] | str | None = None,
        output_names: Sequence[str] | str | None = None,
    ) -> None:
        self.t = check.array("t", t)
        if self.t.ndim != 1 or self.t.size == 0:
            remedy = f"give the instants in a row, and at least {FEWEST}"
            raise Mistake("t", t, remedy, problem=f"has shape {self.t.shape}")
        self.u, self.y = _columns("u", u, self.t.size), _columns("y", y, self.t.size)
        labels = np.zeros(self.t.size) if segments is None else np.asarray(segments)
        if labels.shape != self.t.shape:
            remedy = f"give one label for each of {self.t.size} samples"
            raise Mistake("segments", segments, remedy, problem=f"has shape {labels.shape}")
        self.skip = _stretches(skip)
        self.input_names = check.names("input_names", input_names, self.u.shape[1], "u")
        self.output_names = check.names("output_names", output_names, self.y.shape[1], "y")
        #: Whether each sample is used.
        self.used = np.ones(self.t.size, dtype=bool)
        for start, end in self.skip:
            self.used &= ~((self.t >= start) & (self.t <= end))
        cuts = np.flatnonzero(labels[1:] != labels[:-1]) + 1
        self._segments = self._cut(np.r_[0, cuts, self.t.size])
        self._check()

    @classmethod
    def read_csv(
        cls,
        path: str | Path,
        *,
        time: str | int | None = None,
        input: str | int | Sequence[str | int] | None = None,
        output: str | int | Sequence[str | int] | None = None,
        segment: str | int | None = None,
        skip: Sequence[tuple[float, float]] = (),
    ) -> Record:
        """From a CSV file; commas, semicolons, tabs or blanks between the columns.

        Parameters
        ----------
        path : path
        time, input, output : str or int, or a list of them
            Column names, or numbers from 1 (the only way for a file without a header row). Default: the first
            column, the second and the third.
        segment : str or int, optional
            Column whose change begins a new segment.
        skip : sequence of (float, float)
            As in `Record`. Cells there may be empty or NaN.

        Returns
        -------
        Record

        Raises
        ------
        ValueError
            As `Record`, or if the file cannot be read, a column is missing or a cell is not a number.
        """
        inputs, outputs = (
            [default] if given is None else list(given) if isinstance(given, (list, tuple)) else [given]
            for given, default in ((input, 2), (output, 3))
        )
        wanted = [1 if time is None else time, *inputs, *outputs] + ([] if segment is None else [segment])
        m, q = len(inputs), len(outputs)
        asked_by = ["time", *["input"] * m, *["output"] * q, "segment"][: len(wanted)]
        columns, names = read_columns(path, wanted, asked_by=asked_by, gaps=True)
        with inside(path):
            return cls(
                columns[0],
                np.column_stack(columns[1 : 1 + m]),
                np.column_stack(columns[1 + m : 1 + m + q]),
                segments=columns[-1] if segment is not None else None,
                skip=skip,
                input_names=names[1 : 1 + m],
                output_names=names[1 + m : 1 + m + q],
            )

    @classmethod
    def join(cls, records: Sequence[Record]) -> Record:
        """Several records as segments of one.

        Parameters
        ----------
        records : sequence of Record
            Of the same inputs and outputs.

        Returns
        -------
        Record

        Raises
        ------
        ValueError
            If there is none, or their inputs or outputs differ in number.
        """
        parts = list(records)
        if not parts or len({(r.u.shape[1], r.y.shape[1]) for r in parts}) != 1:
            remedy = "give some with the same inputs and outputs"
            raise Mistake("records", records, remedy, problem=f"holds {len(parts)} record(s)")
        labels, at = [], 0
        for part in parts:
            for stretch in part.segments:
                labels.append(np.full(stretch.stop - stretch.start, at))
                at += 1
        joined = object.__new__(cls)
        joined.__dict__.update(parts[0].__dict__)
        joined.skip = tuple(window for part in parts for window in part.skip)
        for name in ("t", "u", "y", "used"):
            setattr(joined, name, np.concatenate([getattr(part, name)[s] for part in parts for s in part.segments]))
        edges = np.r_[0, np.cumsum([label.size for label in labels])]
        joined._segments = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
        return joined

    def between(self, start: float, end: float) -> Record:
        """The part with ``start <= t < end``.

        Parameters
        ----------
        start, end : float
            Seconds.

        Returns
        -------
        Record

        Raises
        ------
        ValueError
            If too little is left, as in `Record`.
        """
        inside = (self.t >= start) & (self.t < end)
        labels = np.zeros(self.t.size)
        for i, stretch in enumerate(self._segments):
            labels[stretch] = i
        return Record(
            self.t[inside], self.u[inside], self.y[inside], segments=labels[inside], skip=self.skip,
            input_names=self.input_names, output_names=self.output_names,
        )  # fmt: skip

    def to_csv(self, path: str | Path) -> None:
        """Write as CSV: time, inputs, outputs, and the segment's number if there are several.

        Parameters
        ----------
        path : path
        """
        table = {"t": self.t}
        table |= {name: self.u[:, j] for j, name in enumerate(self.input_names)}
        table |= {name: self.y[:, o] for o, name in enumerate(self.output_names)}
        if len(self._segments) > 1:
            table["segment"] = np.zeros(self.t.size)
            for i, stretch in enumerate(self._segments):
                table["segment"][stretch] = i + 1
        write_columns(path, table)

    @property
    def segments(self) -> list[slice]:
        """Where each segment lies in the arrays."""
        return list(self._segments)

    @property
    def Ts(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.concatenate([np.diff(self.t[s]) for s in self._segments])))

    def levels(self, j: int) -> Array:
        """Distinct commands of input ``j``, ascending.

        Parameters
        ----------
        j : int
            Index from 0.

        Returns
        -------
        ndarray
        """
        return np.unique(np.concatenate([self.u[s, j] for s in self._segments]))

    def edges(self, j: int) -> Array:
        """Samples at which input ``j`` takes a new value, ascending.

        Parameters
        ----------
        j : int
            Index from 0.

        Returns
        -------
        ndarray of int
        """
        return np.concatenate([s.start + 1 + np.flatnonzero(np.diff(self.u[s, j])) for s in self._segments])

    def _cut(self, edges: Array) -> list[slice]:
        """Segments between the edges, cut again where a command is missing in a skipped stretch."""
        missing = ~np.isfinite(self.u).all(axis=1) & ~self.used
        result = []
        for start, end in itertools.pairwise(edges):
            known = np.flatnonzero(~missing[start:end]) + start
            for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
                if run.size >= 2:
                    result.append(slice(int(run[0]), int(run[-1]) + 1))
        return result

    def _check(self) -> None:
        if int(self.used.sum()) < FEWEST or not self._segments:
            left = "" if self.used.all() else " outside the skipped stretches"
            problem = f"has {int(self.used.sum())} samples{left}"
            raise Mistake("t", self.t, f"at least {FEWEST} are needed", problem=problem, subject="the record")
        for name, values, names in (("u", self.u, self.input_names), ("y", self.y, self.output_names)):
            bad = ~np.isfinite(values) & self.used[:, None]
            if bad.any():
                i, j = np.argwhere(bad)[0]
                problem = f"({names[j]}) is {values[i, j]} at t = {self.t[i]:g} s, one of {int(bad.sum())} gaps"
                raise Mistake(name, values, "name the stretch in skip to leave it out", problem=problem)
        for stretch in self._segments:
            steps = np.diff(self.t[stretch])
            if (steps <= 0).any():
                i = int(np.argmax(steps <= 0)) + stretch.start
                what = "twice" if steps[i - stretch.start] == 0 else f"after {self.t[i]:g} s"
                remedy = "instants must ascend, give segments where separate experiments follow each other"
                raise Mistake("t", self.t, remedy, problem=f"holds {self.t[i + 1]:g} s {what} (sample {i + 2})")
        for j, name in enumerate(self.input_names):
            if self.levels(j).size < 2:
                problem = f"is {self.levels(j)[0]:g} throughout"
                remedy = "give a record in which it changes"
                raise Mistake("u", self.u, remedy, problem=problem, subject=f"input {name}")
        for o, name in enumerate(self.output_names):
            values = self.y[self.used, o]
            if np.ptp(values) == 0:
                problem, remedy = f"is {values[0]:g} throughout", "give a record in which it responds"
                raise Mistake("y", self.y, remedy, problem=problem, subject=f"output {name}")

    def __iter__(self) -> Iterator[slice]:
        return iter(self._segments)

    def __len__(self) -> int:
        return int(self.used.sum())

    def __repr__(self) -> str:
        width = max(len(f"{kind} {n}") for kind, names in (("input", self.input_names), ("output", self.output_names))
                    for n in names)  # fmt: skip
        lines = [f"{'samples':<{width}}  {len(self)}, every {self.Ts:g} s, {len(self._segments)} segment(s)"]
        for j, name in enumerate(self.input_names):
            levels = self.levels(j)
            text = ", ".join(f"{v:g}" for v in levels) if levels.size <= 8 else f"{levels[0]:g} to {levels[-1]:g}"
            lines.append(f"{'input ' + name:<{width}}  levels {text}; {self.edges(j).size} change(s)")
        for o, name in enumerate(self.output_names):
            y = self.y[self.used, o]
            lines.append(f"{'output ' + name:<{width}}  {y.min():g} to {y.max():g}")
        return tree("Record", lines)


def _columns(name: str, value: Any, rows: int) -> Array:
    """A 2-D array of ``rows`` rows; NaN passes, and is judged later."""
    try:
        result = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        problem = "cannot be read as numbers"
        raise Mistake(name, value, "give one row of numbers per instant", problem=problem) from None
    if result.ndim == 1:
        result = result[:, None]
    if result.ndim != 2 or result.shape[0] != rows or result.shape[1] == 0:
        problem = f"has shape {np.shape(value)}"
        raise Mistake(name, value, f"give one row for each of {rows} instants", problem=problem)
    result.flags.writeable = False
    return result


def _stretches(skip: Any) -> tuple[tuple[float, float], ...]:
    result = []
    for item in skip:
        if np.shape(item) != (2,):
            raise Mistake("skip", item, "give pairs (from, to) in seconds", problem=f"holds {shown(item)}")
        start, end = (float(value) for value in item)
        if not start <= end:
            raise Mistake("skip", item, "it must end after it starts", problem=f"holds ({start:g}, {end:g})")
        result.append((start, end))
    return tuple(result)
