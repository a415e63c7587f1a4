"""CSV files in, each complaint naming file, row and column."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from foreswitch._check import Array
from foreswitch._text import nearest

__all__ = ["read_columns"]


def read_columns(path: str | Path, names: Sequence[str | None]) -> list[Array]:
    """Columns of a CSV file with a header row.

    Parameters
    ----------
    path : path
    names : sequence of str or None
        Column names; None stands for the column at that position.

    Raises
    ------
    ValueError
        If the file cannot be read, a column is missing or a cell is not a finite number.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(
            f"{path} cannot be read ({getattr(error, 'strerror', None) or error}); give a CSV file in UTF-8"
        ) from None
    if len(rows) < 2:
        raise ValueError(f"{path} has {len(rows)} row(s); give a header row and at least one row of numbers")
    header = [cell.strip() for cell in rows[0][1]]
    if all(_is_number(cell) for cell in header):
        raise ValueError(f"{path} starts with numbers; give a header row that names the columns")
    positions = []
    for i, name in enumerate(names):
        if name is None and i < len(header):
            positions.append(i)
        elif name in header:
            positions.append(header.index(name))
        else:
            missing = f"column {name!r}" if name is not None else f"column {i + 1}"
            raise ValueError(f"{path} has no {missing}; {nearest(str(name), header)}")
    columns = np.empty((len(names), len(rows) - 1))
    for r, (line, row) in enumerate(rows[1:]):
        for c, position in enumerate(positions):
            cell = row[position].strip() if position < len(row) else ""
            if not _is_number(cell) or not math.isfinite(float(cell)):
                where = f"{path}, line {line}, column {header[position]!r}"
                raise ValueError(f"{where} holds {cell!r}; give a finite number in every cell")
            columns[c, r] = float(cell)
    return list(columns)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
