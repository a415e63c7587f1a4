"""The response of a linear system at the samples of a record, exactly, for any dead time.

A dead time only shifts the response: ``x(t; L) = x(t - L; 0)``. So the states are computed once at the samples, where
the input changes, and then carried from the sample before ``t - L`` to ``t - L``. Nothing is rounded to samples.
"""

from __future__ import annotations

import numpy as np

from numpy.typing import NDArray

from foreswitch import _response
from foreswitch._check import Array

__all__ = ["Grid"]

#: A regular record is one whose instants are all within this share of an interval from even ones.
REGULAR = 1e-4
#: Longest rest of an interval, in units of the fastest motion, that a short series is trusted with (core/response.c).
SHORT = 0.05


class Tables:
    """Transitions over many intervals: one table each, or shared ones and the rest of the way."""

    def __init__(self, A: Array, b: Array, h: Array) -> None:
        n = b.size
        self.A, self.b, self.over = np.ascontiguousarray(A), b, np.empty(0)
        low, span = float(h.min(initial=np.inf)), float(np.ptp(h)) if h.size else 0.0
        rate = float(np.abs(A).sum(axis=1).max() + np.abs(b).max())
        cells = int(span * rate / (2.0 * SHORT)) + 1
        if span == 0.0:
            lengths, self.which = h[:1], np.zeros(h.size, dtype=np.uint32)
        elif cells >= h.size:
            lengths, self.which = h, np.arange(h.size, dtype=np.uint32)
        else:
            width = span / cells
            self.which = np.minimum((h - low) / width, cells - 1).astype(np.uint32)
            lengths = low + width * (np.arange(cells) + 0.5)
            self.over = h - lengths[self.which]
        self.phi, self.gamma = np.empty((lengths.size, n, n)), np.empty((lengths.size, n))
        _response.discretise(self.A, b, np.ascontiguousarray(lengths), self.phi, self.gamma)

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
        self._steps = np.full(t.size - 1, mean) if self.regular else np.diff(self.t)

    def states(self, A: Array, b: Array, u: Array, x0: Array | None = None) -> Array:
        """States (N, n) under ``u`` (N,), each value holding to the next sample, from ``x0`` or zero."""
        x = np.empty((self.count, b.size))
        x[0] = 0.0 if x0 is None else x0
        _response.respond(*Tables(A, b, self._steps).arrays, u[:-1], x)
        return x

    def delayed(self, A: Array, b: Array, u: Array, x: Array, delay: float) -> tuple[Array, Array]:
        """States and their slopes (W, n) at the wanted samples, ``delay`` seconds late; before the record, at rest.

        ``u`` must start from 0 and ``x`` be its response from 0.
        """
        if self.regular:
            back = int(np.ceil(delay / self.interval - 1e-9))
            before = self.wanted - back
            h = np.full(self.wanted.size, max(back * self.interval - delay, 0.0))
        else:
            instants = self.at - delay
            before = np.searchsorted(self.t, instants, side="right") - 1
            h = np.where(before < 0, 0.0, instants - self.t[before])
        late, slope = np.empty((h.size, b.size)), np.empty((h.size, b.size))
        _response.carry(*Tables(A, b, h).arrays, before, u, x, late, slope)
        return late, slope
