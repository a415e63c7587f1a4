"""Peak gains: how far bounded inputs can drive a stable linear recursion, with the remainder of each series bounded too."""

from __future__ import annotations

import numpy as np
from scipy.linalg import matrix_balance

from foreswitch._helpers.check import Array

__all__ = ["Recursion", "Unsettled"]

#: A power of the recursion's matrix below this in the row-sum norm ends the series.
NEGLIGIBLE = 1e-9
#: Steps after which a series counts as one that does not end: a pole within 1e-4 of the unit circle.
LONGEST = 2**18
#: Steps at once.
BLOCK = 256


class Unsettled(Exception):
    """The recursion does not decay within `LONGEST` steps."""


class Recursion:
    """``z[k+1] = M z[k] + b v[k]`` with bounded v.

    Parameters
    ----------
    M : ndarray, shape (n, n)

    Raises
    ------
    Unsettled
        If it is not stable, or hardly.
    """

    def __init__(self, M: Array) -> None:
        self.matrix = M
        balanced, scale = matrix_balance(M, permute=False, separate=False)
        self._M, self._scale = balanced, np.diag(scale).copy()
        power, steps = balanced, 1
        with np.errstate(over="ignore", invalid="ignore"):
            while not (size := float(np.abs(power).sum(axis=1).max(initial=0.0))) < NEGLIGIBLE:
                steps *= 2
                if steps > LONGEST or not np.isfinite(size):
                    raise Unsettled
                power = power @ power
        #: Steps that are summed, and the share that bounds the rest.
        self.steps, self._rest = steps, size / (1.0 - size)
        block = [np.eye(len(M))]
        while len(block) < min(BLOCK, steps):
            block.append(block[-1] @ balanced)
        self._powers = np.array(block)
        self._next = block[-1] @ balanced

    def terms(self, rows: Array, columns: Array, count: int) -> Array:
        """``rows M^j columns`` for the first j, shape (count, r, c)."""
        result, left, right = [], rows * self._scale, columns / self._scale[:, None]
        for _ in range(count):
            result.append(left @ right)
            left = left @ self._M
        return np.array(result).reshape(count, len(rows), columns.shape[1])

    def sums(self, rows: Array, columns: Array, norm: int = 1) -> Array:
        """Sums over all j >= 0 of the size of ``rows M^j columns``.

        Parameters
        ----------
        rows : ndarray, shape (r, n)
        columns : ndarray, shape (n, c)
        norm : {1, 2}
            1: of each entry, for inputs that are bounded one by one; 2: of each row, for a vector bounded in length.

        Returns
        -------
        ndarray, shape (r, c), or (r,) with norm 2
        """
        left, right = rows * self._scale, columns / self._scale[:, None]
        total = np.zeros((len(rows), columns.shape[1]) if norm == 1 else len(rows))
        reach = np.zeros(len(rows))  # sum of the rows' sizes, for what is left out
        for _ in range(0, self.steps, len(self._powers)):
            moved = left @ self._powers  # (block, r, n)
            terms = moved @ right
            total += np.abs(terms).sum(axis=0) if norm == 1 else np.sqrt(np.square(terms).sum(axis=2)).sum(axis=0)
            reach += np.abs(moved).sum(axis=(0, 2))
            left = left @ self._next
        most = np.abs(right).max(axis=0, initial=0.0)  # of each column
        rest = self._rest * reach
        return total + (rest[:, None] * most if norm == 1 else rest * float(np.sqrt(np.square(most).sum())))
