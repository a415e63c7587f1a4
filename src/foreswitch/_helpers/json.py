"""JSON that every reader takes: no NaN, no infinity, nothing but ASCII."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["json_text", "plain_data"]


def plain_data(value: Any) -> Any:
    """As JSON can hold it: arrays and tuples as lists, numbers of NumPy as Python's, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_data(item) for item in value]
    if isinstance(value, np.ndarray):
        numbers = value.dtype.kind in "biu" or (value.dtype.kind == "f" and bool(np.isfinite(value).all()))
        return value.tolist() if numbers else plain_data(value.tolist())
    if isinstance(value, np.generic):
        return plain_data(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_text(value: Any, *, indent: int | None = None, sort_keys: bool = False) -> str:
    """`plain_data` as JSON; with an indent a text for a file, its last line ended.

    Lone surrogates are escaped like all that is not ASCII, so that any encoding can carry it.
    """
    text = json.dumps(plain_data(value), allow_nan=False, indent=indent, sort_keys=sort_keys)
    return text if indent is None else text + "\n"
