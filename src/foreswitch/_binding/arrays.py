"""Arrays in the form the core takes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers.check import Array

__all__ = ["level_products", "reals"]


def reals(real: type[np.floating[Any]], values: ArrayLike) -> np.ndarray[Any, Any]:
    """Flat, contiguous, of the core's arithmetic."""
    return np.ascontiguousarray(values, dtype=real).ravel()


def level_products(pending: Sequence[Array], levels: Sequence[Array]) -> Array:
    """Effect of each pending command, looked up by its level: per input (pending, levels, rows), one after the other."""
    each = [w[:, None, :] * v[None, :, None] for w, v in zip(pending, levels, strict=True)]
    result: Array = np.concatenate([np.ravel(item) for item in each])
    return result
