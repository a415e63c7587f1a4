"""A dropped record: what its columns are, and the plant that it shows."""

from __future__ import annotations

import contextlib
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.csv import read_columns, split
from foreswitch._helpers.mistake import Mistake, shown, within
from foreswitch._helpers.units import without_units
from foreswitch.identification import plots
from foreswitch.identification.fit import Fit
from foreswitch.identification.record import Record
from foreswitch.identification.search import identify as find
from foreswitch.page.uploads import under_its_name
from foreswitch.studies.draft import draft_project

__all__ = ["columns", "identify"]

#: Instants of an averaged pulse.
GRID = 240
#: More levels than this make no switching input.
LEVELS = 16
#: What a query may set, and argument of the record -> which of them it comes from.
SETTINGS = {"time", "input", "output", "segment", "structure"}
FIELDS = {name: name for name in SETTINGS} | {"t": "time", "u": "input", "y": "output", "segments": "segment"}


@contextlib.contextmanager
def _file(content: bytes) -> Iterator[Path]:
    """The record as a file, where the library can read it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        path.write_bytes(content)
        with under_its_name("the record"):
            yield path


def columns(content: bytes) -> dict[str, Any]:
    """Names of the columns, and which of them seem to be time, input and output.

    Parameters
    ----------
    content : bytes
        A CSV file.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        If it is no table of numbers.
    """
    with _file(content) as path:
        (t, *_), _ = read_columns(path, [1], gaps=True)
        width = len(split(content.decode("utf-8-sig"))[0][1])
        if width < 3:
            raise Mistake("record", width, "give time, input and output", problem=f"has {width} column(s)", subject="")
        if width > 64:
            raise Mistake("record", width, "give up to 64", problem=f"has {width} columns", subject="")
        table, names = read_columns(path, range(1, width + 1), gaps=True)
    finite = [column[np.isfinite(column)] for column in table]
    rising = [i for i, c in enumerate(finite) if c.size == t.size and c.size > 1 and (np.diff(c) > 0).all()]
    time = rising[0] if rising else 0
    rest = [i for i in range(width) if i != time]
    few = [i for i in rest if 2 <= np.unique(finite[i]).size <= LEVELS]
    switched = few[0] if few else rest[0]
    moving = [i for i in rest if i != switched and finite[i].size and np.ptp(finite[i]) > 0]
    measured = next((i for i in moving if i not in few), (moving or [i for i in rest if i != switched])[0])
    guess = {"time": names[time], "input": names[switched], "output": names[measured]}
    return {"columns": names, "rows": int(t.size), "guess": guess}


def identify(content: bytes, query: dict[str, list[str]]) -> tuple[dict[str, Any], dict[str, Array]]:
    """A plant with its dead time, and how it follows the record.

    Parameters
    ----------
    content : bytes
        A CSV file.
    query : dict of str to list of str
        ``time``, ``input``, ``output``, ``segment``, ``structure``.

    Returns
    -------
    tuple
        Fields and arrays.

    Raises
    ------
    ValueError
        As `foreswitch.identify`.
    """
    unknown = sorted(query.keys() - SETTINGS)
    if unknown:
        name, remedy = unknown[0], f"known are {', '.join(sorted(SETTINGS))}"
        raise Mistake(name, query[name], remedy, problem="is not a setting", subject=shown(name), key=name)
    chosen: dict[str, Any] = {}
    for name in ("time", "segment"):
        if query.get(name):
            chosen[name] = _column(query[name][0])
    for name in ("input", "output"):
        if query.get(name):
            chosen[name] = [_column(each) for each in query[name]]
    with within(None, FIELDS):
        with _file(content) as path:
            record = Record.read_csv(path, **chosen)
        fit = find(record, (query.get("structure") or ["auto"])[0])
    draft = tomllib.loads(draft_project(fit, "a record"))
    fields: dict[str, Any] = {
        "fit": without_units(fit.summary()),
        "plant": draft["plant"],
        "project": draft,
        "inputs": list(record.input_names),
        "outputs": list(record.output_names),
        "segments": [float(record.t[part.start] - record.t[0]) for part in record.segments],
    }
    arrays = {"t": record.t - record.t[0], "u": record.u.T, "y": record.y.T, "model": _followed(fit).T}
    pulse, drawn = _average(fit)
    return fields | pulse, arrays | drawn


def _column(name: str) -> str | int:
    return int(name) if name.isdecimal() and len(name) < 5 else name


def _followed(fit: Fit) -> Array:
    """The model's output at the record's samples, NaN where they were not used."""
    problem = fit.estimate.problem
    y = np.full(fit.record.y.shape, np.nan)
    for o in range(fit.plant.outputs):
        for rows, measured, residual in zip(problem.samples, problem.y[o], fit.estimate.residuals(o), strict=True):
            y[rows, o] = measured - residual
    return y


def _average(fit: Fit) -> tuple[dict[str, Any], dict[str, Array]]:
    """The average response to equal pulses of the first input that has some, and the model's."""
    record = fit.record
    for j in range(record.u.shape[1]):
        if (pulses := plots.equal_pulses(fit.estimate, j)) is None:
            continue
        grid = np.linspace(-plots.BEFORE * pulses.room, (1.0 - 1e-9) * pulses.room, GRID)
        windows = [plots.pulse_windows(fit.estimate, o, pulses, grid) for o in range(record.y.shape[1])]
        if len(windows[0][0]) < 2:
            continue
        return (
            {"pulse": {"input": j, "width": pulses.width, "count": len(windows[0][0])}},
            {
                "pulse_t": grid,
                "pulse_mean": np.array([measured.mean(axis=0) for measured, _ in windows]),
                "pulse_spread": np.array([measured.std(axis=0, ddof=1) for measured, _ in windows]),
                "pulse_model": np.array([fitted.mean(axis=0) for _, fitted in windows]),
            },
        )
    return {}, {}
