"""CSV files: in, each complaint naming file, row and column; and out, whole or not at all."""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.text import nearest

__all__ = ["read_columns", "split", "write_columns"]


def read_columns(path: str | Path, wanted: Sequence[str | int], *, gaps: bool = False) -> tuple[list[Array], list[str]]:
    """Columns of a text file with commas, semicolons, tabs or blanks between them, and their names.

    Parameters
    ----------
    path : path
    wanted : sequence of str or int
        Column names, or positions from 1. By positions alone a file without a header row can be read.
    gaps : bool
        Whether a cell may be empty or NaN.

    Raises
    ------
    ValueError
        If the file cannot be read, a column is missing or a cell is not a finite number.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = split(file.read())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(
            f"{path} cannot be read ({getattr(error, 'strerror', None) or error}); give a CSV file in UTF-8"
        ) from None
    header = [cell.strip() for cell in rows[0][1]] if rows else []
    named = not all(_is_number(cell) for cell in header)
    if not named and not all(isinstance(item, int) for item in wanted):
        raise ValueError(f"{path} starts with numbers; give a header row that names the columns")
    body = rows[1:] if named else rows
    if not body:
        raise ValueError(f"{path} has {len(rows)} row(s); give a header row and at least one row of numbers")
    positions = []
    for item in wanted:
        if isinstance(item, int) and 1 <= item <= len(header):
            positions.append(item - 1)
        elif item in header:
            positions.append(header.index(str(item)))
        else:
            missing = f"column {item}" if isinstance(item, int) else f"column {item!r}"
            raise ValueError(f"{path} has no {missing}; {nearest(str(item), header)}")
    names = [header[i] if named else f"column {i + 1}" for i in positions]
    columns = [_numbers(path, body, i, name, gaps) for i, name in zip(positions, names, strict=True)]
    return columns, names


def split(text: str) -> list[tuple[int, list[str]]]:
    """Line numbers and cells of the rows that are not blank."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((mark for mark in ",;\t" if mark in first), None)
    if delimiter is None:
        return [(i, line.split()) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter)
    return [(reader.line_num, row) for row in reader if row]


def _numbers(path: str | Path, rows: list[tuple[int, list[str]]], position: int, name: str, gaps: bool) -> Array:
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
            raise ValueError(f"{path}, line {line}, column {name!r} holds {cell!r}; give a finite number in every cell")
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
