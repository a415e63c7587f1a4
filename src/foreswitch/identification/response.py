"""The response of a linear system at the samples of a record, exactly, for any dead time.

A dead time only shifts the response: ``x(t; L) = x(t - L; 0)``. So the states are computed once at the samples, where
the input changes, and then carried from the sample before ``t - L`` to ``t - L``. Nothing is rounded to samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foreswitch._binding import _response
from foreswitch._helpers.check import Array

__all__ = ["Grid"]

#: A regular record is one whose instants are all within this share of an interval from even ones.
REGULAR = 1e-6
#: Longest rest of an interval, in units of the fastest motion, that a short series is trusted with (core/host/response.c).
SHORT = 0.05


class Tables:
    """Transitions over many intervals: one table each, or shared ones and the rest of the way."""

    def __init__(self, A: Array, b: Array, h: Array) -> None:
        low, high = float(h.min()), float(h.max())
        rate = float(np.abs(A).sum(axis=1).max() + np.abs(b).max())
        cells = int((high - low) * rate / (2.0 * SHORT)) + 1
        if cells >= h.size and low < high:
            self._allocate(A, b, h.size)
            self.which, self.over = np.arange(h.size, dtype=np.uint32), np.empty(0)
            _response.discretise(self.A, b, np.ascontiguousarray(h), self.phi, self.gamma)
            return
        width = (high - low) / cells
        self._allocate(A, b, cells)
        _response.discretise_evenly(self.A, b, low + 0.5 * width, width, self.phi, self.gamma)
        self.which = np.minimum((h - low) / (width or 1.0), cells - 1).astype(np.uint32)
        self.over = h - (low + width * (self.which + 0.5)) if width else np.empty(0)

    @classmethod
    def even(cls, A: Array, b: Array, length: float, count: int) -> Tables:
        """One table for all intervals."""
        result = object.__new__(cls)
        result._allocate(A, b, 1)
        _response.discretise(result.A, b, np.array([length]), result.phi, result.gamma)
        result.which, result.over = np.zeros(count, dtype=np.uint32), np.empty(0)
        return result

    def _allocate(self, A: Array, b: Array, count: int) -> None:
        self.A, self.b = np.ascontiguousarray(A), b
        self.phi, self.gamma = np.empty((count, b.size, b.size)), np.empty((count, b.size))

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, NDArray[np.uint32], Array]:
        """As the binding takes them."""
        return self.A, self.b, self.phi, self.gamma, self.which, self.over


class Grid:
    """The sampling instants of one stretch of a record.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Seconds, ascending.
    wanted : ndarray of int
        The samples at which the response is asked for.
    """

    def __init__(self, t: Array, wanted: NDArray[np.intp]) -> None:
        mean = float(t[-1] - t[0]) / (t.size - 1)
        even = mean * np.arange(t.size)
        self.regular = bool(np.abs(t - t[0] - even).max() <= REGULAR * mean)
        self.t = even if self.regular else t - t[0]
        self.interval = mean if self.regular else float(np.median(np.diff(t)))
        self.count, self.wanted = t.size, wanted
        self.at = self.t[wanted]  # seconds since the first sample

    def _tables(self, A: Array, b: Array) -> Tables:
        """From each sample to the next."""
        if self.regular:
            return Tables.even(A, b, self.interval, self.count - 1)
        return Tables(A, b, np.diff(self.t))

    def states(self, A: Array, b: Array, u: Array, x0: Array | None = None) -> Array:
        """States (N, n) under ``u`` (N,), each value holding to the next sample, from ``x0`` or zero."""
        x = np.empty((self.count, b.size))
        x[0] = 0.0 if x0 is None else x0
        _response.respond(*self._tables(A, b).arrays, u[:-1], x)
        return x

    def delayed(self, A: Array, b: Array, u: Array, x: Array, delay: float) -> tuple[Array, Array]:
        """States and their slopes (W, n) at the wanted samples, ``delay`` seconds late; before the record, at rest.

        ``u`` must start from 0 and ``x`` be its response from 0.
        """
        if self.regular:
            back = int(np.ceil(delay / self.interval - 1e-9))
            before = self.wanted - back
            tables = Tables.even(A, b, max(back * self.interval - delay, 0.0), self.wanted.size)
        else:
            instants = self.at - delay
            before = np.searchsorted(self.t, instants, side="right") - 1
            tables = Tables(A, b, np.where(before < 0, 0.0, instants - self.t[before]))
        late, slope = np.empty((before.size, b.size)), np.empty((before.size, b.size))
        _response.carry(*tables.arrays, before, u, x, late, slope)
        return late, slope
