"""Argument checks shared by all modules: each failure is a `Mistake` in the argument of the given name."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foreswitch._helpers.mistake import Mistake

__all__ = ["Array", "array", "matrix", "names", "number", "per", "periods", "vector"]

Array = NDArray[np.floating[Any]]

#: A time counts as a whole number of periods within this many periods (0.3 / 0.1 = 2.9999...).
PERIOD_TOLERANCE = 1e-9


def number(name: str, value: Any, *, above: float | None = None, least: float | None = None) -> float:
    """A finite float, optionally > ``above`` or >= ``least``."""
    try:
        if isinstance(value, str) or np.ndim(value) > 0:
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise Mistake(name, value, "give one number") from None
    if not math.isfinite(result):
        raise Mistake(name, value, "give a finite number")
    if above is not None and result <= above:
        raise Mistake(name, value, f"it must be greater than {above:g}")
    if least is not None and result < least:
        raise Mistake(name, value, f"it must be at least {least:g}")
    return result


def array(
    name: str, value: ArrayLike, shape: tuple[int, ...] | None = None, *, ndmin: int = 0, subject: str | None = None
) -> Array:
    """A finite float64 array, of ``shape`` if given, own memory and read-only; ``subject`` is that of the mistake."""
    try:
        if value is None:
            raise TypeError
        result = np.array(value, dtype=np.float64, ndmin=ndmin)
    except (TypeError, ValueError, OverflowError):
        raise Mistake(name, value, "give numbers in a rectangular array", subject=subject) from None
    if shape is not None and result.shape != shape:
        problem = f"has shape {result.shape}"
        raise Mistake(name, value, f"shape {shape} is needed", problem=problem, subject=subject)
    if not np.isfinite(result).all():
        raise Mistake(name, value, "give finite numbers", problem="holds NaN or infinity", subject=subject)
    result.flags.writeable = False
    return result


def vector(name: str, value: ArrayLike, size: int, what: str) -> Array:
    """A measured vector: NaN and infinity pass, a wrong shape does not. A number counts as a vector of one."""
    try:
        if value is None:
            raise TypeError
        result = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Mistake(name, value, f"give {size} number(s)") from None
    if result.shape != (size,):  # ascontiguousarray has made a number a vector
        raise Mistake(name, value, f"the {what} has shape ({size},)", problem=f"has shape {np.shape(value)}")
    return result


def matrix(name: str, value: ArrayLike, rows: int | None = None, columns: int | None = None) -> Array:
    """A finite 2-D array. A vector counts as one column if ``rows`` fits it, else as one row."""
    result = np.array(array(name, value))
    if result.ndim == 0:
        result = result.reshape(1, 1)
    elif result.ndim == 1:
        result = result[:, None] if rows == result.size else result[None, :]
    fits = result.ndim == 2 and (rows is None or result.shape[0] == rows)
    if not fits or (columns is not None and result.shape[1] != columns):
        need = " x ".join("any" if size is None else str(size) for size in (rows, columns))
        raise Mistake(name, value, f"a matrix of {need} is needed", problem=f"has shape {result.shape}")
    result.flags.writeable = False
    return result


def per(name: str, value: ArrayLike, count: int, what: str, *, least: float | None = None) -> Array:
    """One value for all, or one per item."""
    values = array(name, value)
    if values.ndim > 1 or (values.ndim == 1 and values.size != count):
        remedy = f"give one number or one per {what} ({count})"
        raise Mistake(name, value, remedy, problem=f"has shape {values.shape}")
    if least is not None and (values < least).any():
        raise Mistake(name, value, f"it must be at least {least:g}")
    result = np.broadcast_to(values, (count,)).copy()
    result.flags.writeable = False
    return result


def names(name: str, value: Sequence[str] | str | None, count: int, prefix: str) -> tuple[str, ...]:
    """One name each, or ``prefix`` with a number."""
    if value is None:
        return (prefix,) if count == 1 else tuple(f"{prefix}{i + 1}" for i in range(count))
    given = (value,) if isinstance(value, str) else tuple(str(item) for item in value)
    if len(given) != count:
        raise Mistake(name, list(given), f"{count} name(s) are needed")
    if len(set(given)) != count:
        raise Mistake(name, list(given), "each name may stand only once")
    return given


def periods(seconds: float, Ts: float) -> int:
    """Whole periods that cover ``seconds``, with a tolerance of 1e-9 periods."""
    return max(0, math.ceil(seconds / Ts - PERIOD_TOLERANCE))
