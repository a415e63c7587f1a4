"""CSV files: in, each mistake naming file, row and column; and out, whole or not at all."""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.mistake import Mistake, inside, shown
from foreswitch._helpers.text import nearest

__all__ = ["read_columns", "split", "write_columns"]


def read_columns(
    path: str | Path, wanted: Sequence[str | int], *, asked_by: Sequence[str] | None = None, gaps: bool = False
) -> tuple[list[Array], list[str]]:
    """Columns of a text file with commas, semicolons, tabs or blanks between them, and their names.

    Parameters
    ----------
    path : path
    wanted : sequence of str or int
        Column names, or positions from 1. By positions alone a file without a header row can be read.
    asked_by : sequence of str, optional
        For each column, the caller's argument that names it. Default: the path alone is given.
    gaps : bool
        Whether a cell may be empty or NaN.

    Raises
    ------
    ValueError
        If the file cannot be read, a column is missing or a cell is not a finite number.
    """
    with inside(path):
        return _columns(path, wanted, asked_by or ["path"] * len(wanted), gaps)


def _columns(
    path: str | Path, wanted: Sequence[str | int], asked_by: Sequence[str], gaps: bool
) -> tuple[list[Array], list[str]]:
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = split(file.read())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problem = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise Mistake("path", path, "give a CSV file in UTF-8", problem=problem, subject="") from None
    header = [cell.strip() for cell in rows[0][1]] if rows else []
    named = not all(_is_number(cell) for cell in header)
    if not named and not all(isinstance(item, int) for item in wanted):
        remedy = "give a header row that names the columns"
        raise Mistake("path", path, remedy, problem="starts with numbers", subject="")
    body = rows[1:] if named else rows
    if not body:
        remedy = "give a header row and at least one row of numbers"
        raise Mistake("path", path, remedy, problem=f"has {len(rows)} row(s)", subject="")
    positions = []
    for argument, item in zip(asked_by, wanted, strict=True):
        if isinstance(item, int) and 1 <= item <= len(header):
            positions.append(item - 1)
        elif item in header:
            positions.append(header.index(str(item)))
        else:
            problem = f"has no column {shown(item)}"
            raise Mistake(argument, item, nearest(str(item), header), problem=problem, subject="")
    names = [header[i] if named else f"column {i + 1}" for i in positions]
    columns = [_numbers(body, i, name, gaps) for i, name in zip(positions, names, strict=True)]
    return columns, names


def split(text: str) -> list[tuple[int, list[str]]]:
    """Line numbers and cells of the rows that are not blank."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((mark for mark in ",;\t" if mark in first), None)
    if delimiter is None:
        return [(i, line.split()) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter)
    return [(reader.line_num, row) for row in reader if row]


def _numbers(rows: list[tuple[int, list[str]]], position: int, name: str, gaps: bool) -> Array:
    cells = [row[position].strip() if position < len(row) else "" for _, row in rows]
    try:
        column = np.array([cell or "nan" for cell in cells] if gaps else cells, dtype=np.float64)
        if gaps or np.isfinite(column).all():
            return column
    except ValueError:
        pass
    for (line, _), cell in zip(rows, cells, strict=True):
        fits = _is_number(cell) and (gaps or math.isfinite(float(cell)))
        if not fits and not (gaps and not cell):
            subject, problem = f"line {line}, column {name!r}", f"holds {shown(cell)}"
            raise Mistake("path", cell, "give a finite number in every cell", problem=problem, subject=subject)
    raise AssertionError("a cell that cannot be converted was not found")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def write_columns(path: str | Path, table: Mapping[str, Array]) -> None:
    """Columns under a header row, nine digits."""
    heads = (name.replace('"', '""') for name in table)
    lines = [",".join(f'"{head}"' if set(head) & set(',"\r\n') else head for head in heads)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in zip(*table.values(), strict=True)]
    write_whole(path, "\n".join(lines) + "\n")
