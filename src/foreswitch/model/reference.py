"""What the output shall follow: callables from times (K,) to values and derivatives (K, outputs, order)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.csv import read_columns
from foreswitch._helpers.mistake import Mistake, inside, shown
from foreswitch._helpers.text import nearest

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

__all__ = ["HalfSine", "Ramp", "Reference", "Samples", "Sine", "Stack", "Steps", "sample"]

#: Derivatives returned when none are asked for, the value included.
DEFAULT_ORDER = 4


class Reference(ABC):
    """A reference of one or more outputs; call it with times to get values and derivatives."""

    #: Number of outputs.
    outputs: int = 1

    @property
    def end(self) -> float:
        """Seconds after which nothing new comes: it holds, runs on or repeats."""
        return self._end()

    def _end(self) -> float:
        return 0.0

    def __call__(self, t: ArrayLike, order: int = DEFAULT_ORDER) -> Array:
        """Values and derivatives.

        Parameters
        ----------
        t : array_like, shape (K,)
            Times [s].
        order : int
            Derivatives wanted, the value included.

        Returns
        -------
        ndarray, shape (K, outputs, order)
        """
        return self._evaluate(np.atleast_1d(np.asarray(t, dtype=np.float64)), order)

    @abstractmethod
    def _evaluate(self, t: Array, order: int) -> Array: ...


def _sine(amplitude: float, omega: float, angle: Array, order: int) -> Array:
    """A sine's derivatives, (K, 1, order)."""
    i = np.arange(order)
    return (amplitude * omega**i * np.sin(angle[:, None] + 0.5 * pi * i))[:, None, :]


@dataclass(frozen=True)
class Sine(Reference):
    """``offset + amplitude sin(2 pi frequency t + phase)``.

    Parameters
    ----------
    amplitude : float
        Unit of y.
    frequency : float
        Hz, > 0.
    offset : float
        Unit of y.
    phase : float
        rad.
    """

    amplitude: float
    frequency: float
    offset: float = 0.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "offset", "phase"):
            check.number(name, getattr(self, name))
        check.number("frequency", self.frequency, above=0.0)

    def _end(self) -> float:
        return 1.0 / self.frequency

    def _evaluate(self, t: Array, order: int) -> Array:
        omega = 2.0 * pi * self.frequency
        values = _sine(self.amplitude, omega, omega * t + self.phase, order)
        values[:, 0, 0] += self.offset
        return values


@dataclass(frozen=True)
class HalfSine(Reference):
    """Half a period of a sinusoid, trough to crest, held before and after.

    Parameters
    ----------
    height : float
        Rise from trough to crest [unit of y]; negative falls.
    duration : float
        Of the half period [s], > 0.
    start : float
        When it begins [s].
    offset : float
        Value before it begins [unit of y].
    """

    height: float
    duration: float
    start: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("height", "start", "offset"):
            check.number(name, getattr(self, name))
        check.number("duration", self.duration, above=0.0)

    def _end(self) -> float:
        return self.start + self.duration

    def _evaluate(self, t: Array, order: int) -> Array:
        omega = pi / self.duration
        inside = np.clip(t - self.start, 0.0, self.duration)
        values = _sine(0.5 * self.height, omega, omega * inside - 0.5 * pi, order)
        values[(t < self.start) | (t > self.start + self.duration), :, 1:] = 0.0
        values[:, 0, 0] += self.offset + 0.5 * self.height
        return values


@dataclass(frozen=True)
class Ramp(Reference):
    """``offset`` until ``start``, then rising by ``slope`` per second.

    Parameters
    ----------
    slope : float
        Unit of y per second.
    start : float
        Seconds.
    offset : float
        Unit of y.
    """

    slope: float
    start: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slope", "start", "offset"):
            check.number(name, getattr(self, name))

    def _end(self) -> float:
        return max(self.start, 0.0)

    def _evaluate(self, t: Array, order: int) -> Array:
        values = np.zeros((t.size, 1, order))
        values[:, 0, 0] = self.offset + self.slope * np.maximum(t - self.start, 0.0)
        if order > 1:
            values[:, 0, 1] = np.where(t >= self.start, self.slope, 0.0)
        return values


class _Piecewise(Reference):
    """A piecewise polynomial, its end values held outside."""

    _pieces: PPoly
    _span: tuple[float, float]
    _ends: tuple[float, float]

    def _end(self) -> float:
        return self._span[1]

    def _evaluate(self, t: Array, order: int) -> Array:
        first, last = self._span
        values = np.zeros((t.size, 1, order))
        inside = (t >= first) & (t < last)
        for i in range(order):
            values[inside, 0, i] = self._pieces(t[inside], nu=i)
        values[t < first, 0, 0], values[t >= last, 0, 0] = self._ends
        return values


def _table(t: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    times, values = check.array("t", t), check.array("y", y)
    if times.ndim != 1 or times.size == 0 or values.shape != times.shape:
        problem = f"has shape {times.shape} and y {values.shape}"
        raise Mistake("t", t, "give two vectors of one length", problem=problem)
    later = np.flatnonzero(np.diff(times) <= 0)
    if later.size:
        i = int(later[0])
        problem = f"goes from {times[i]:g} to {times[i + 1]:g} at sample {i + 2}"
        raise Mistake("t", t, "times must ascend", problem=problem)
    return times, values


class Steps(_Piecewise):
    """Constant pieces: ``values[i]`` from ``times[i]`` on, the first also before.

    Parameters
    ----------
    times : array_like, shape (N,)
        s, ascending.
    values : array_like, shape (N,)
        Unit of y.
    """

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        self.times, self.values = _table(times, values)
        edges = np.append(self.times, self.times[-1] + 1.0)
        self._pieces = _polynomials(self.values[None, :], edges)
        self._span = (edges[0], edges[-1])
        self._ends = (self.values[0], self.values[-1])

    def __repr__(self) -> str:
        return f"Steps(times={self.times.tolist()}, values={self.values.tolist()})"


KINDS = ("pchip", "linear", "hold")


class Samples(_Piecewise):
    """A sampled reference, its end values held outside.

    Parameters
    ----------
    t : array_like, shape (N,)
        s, ascending.
    y : array_like, shape (N,)
        Unit of y.
    kind : {"pchip", "linear", "hold"}
        Between the samples: a smooth curve that never overshoots them (with a derivative to match),
        straight lines, or the last sample.
    """

    def __init__(self, t: ArrayLike, y: ArrayLike, *, kind: Literal["pchip", "linear", "hold"] = "pchip") -> None:
        self.t, self.y = _table(t, y)
        if kind not in KINDS:
            raise Mistake("kind", kind, nearest(str(kind), KINDS))
        self.kind = kind
        if self.t.size == 1:
            self._pieces = _polynomials(self.y[None, :], [self.t[0], self.t[0] + 1.0])
        elif kind == "pchip":
            self._pieces = _pchip(self.t, self.y)
        else:
            slope = np.diff(self.y) / np.diff(self.t) if kind == "linear" else np.zeros(self.t.size - 1)
            self._pieces = _polynomials(np.vstack([slope, self.y[:-1]]), self.t)
        self._span = (float(self.t[0]), float(self.t[-1]))
        self._ends = (float(self.y[0]), float(self.y[-1]))

    @classmethod
    def read_csv(
        cls, path: str | Path, *, time: str | None = None, value: str | None = None, **options: Any
    ) -> Samples:
        """From a CSV file with a header row.

        Parameters
        ----------
        path : path
        time, value : str, optional
            Column names. Default: the first and the second column.
        **options
            ``kind``, as in `Samples`.

        Returns
        -------
        Samples

        Raises
        ------
        ValueError
            If a column is missing, a cell is not a finite number or the times do not ascend.
        """
        wanted = [1 if time is None else time, 2 if value is None else value]
        columns, _ = read_columns(path, wanted, asked_by=["time", "value"])
        with inside(path):
            return cls(columns[0], columns[1], **options)

    @classmethod
    def read_csv_columns(cls, path: str | Path, outputs: int) -> tuple[Reference, float]:
        """One reference per output from a CSV file: time, then one column each.

        Parameters
        ----------
        path : path
        outputs : int
            Number of outputs.

        Returns
        -------
        tuple
            The reference, and the last time in the file [s].

        Raises
        ------
        ValueError
            As `read_csv`.
        """
        (times, *values), _ = read_columns(path, range(1, outputs + 2))
        with inside(path):
            parts = [cls(times, column) for column in values]
        return (parts[0] if outputs == 1 else Stack(*parts)), float(times[-1])

    def __repr__(self) -> str:
        return f"Samples({self.t.size} samples, {self.t[0]:g} to {self.t[-1]:g} s, kind={self.kind!r})"


def _polynomials(coefficients: ArrayLike, edges: ArrayLike) -> PPoly:
    """Piecewise polynomials, SciPy's: loaded for the references that need them."""
    from scipy.interpolate import PPoly

    return PPoly(coefficients, edges)


def _pchip(t: Array, y: Array) -> PPoly:
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(t, y)
    return _polynomials(curve.c, curve.x)


class Stack(Reference):
    """Several references side by side, one output after the other.

    Parameters
    ----------
    *references : callable
        `Reference` objects, or callables from t (K,) to (K, outputs, order).
    """

    def __init__(self, *references: Callable[..., ArrayLike]) -> None:
        if not references:
            raise Mistake("references", (), "give at least one reference", problem="is empty", subject="Stack")
        for item in references:
            if not callable(item):
                raise Mistake("references", item, "give references", problem=f"holds {shown(item)}", subject="Stack")
        self.references = references
        self.outputs = sum(getattr(item, "outputs", 1) for item in references)

    def _end(self) -> float:
        return max(float(getattr(item, "end", 0.0)) for item in self.references)

    def _evaluate(self, t: Array, order: int) -> Array:
        return np.concatenate([sample(item, t, None, order) for item in self.references], axis=1)

    def __repr__(self) -> str:
        return f"Stack({', '.join(map(repr, self.references))})"


def sample(reference: Callable[..., ArrayLike] | ArrayLike, t: Array, outputs: int | None, order: int) -> Array:
    """Any reference at times t, in canonical shape.

    Parameters
    ----------
    reference : callable or array_like
        A `Reference`, any callable from t (K,) to (K,), (K, outputs) or (K, outputs, order), or a constant.
    t : ndarray, shape (K,)
        Seconds.
    outputs : int or None
        Outputs wanted; None: as many as there are.
    order : int
        Derivatives wanted, the value included; those the callable does not give are zero.

    Returns
    -------
    ndarray, shape (K, outputs, order)

    Raises
    ------
    ValueError
        If the shape does not fit or a value is not finite.
    """
    if isinstance(reference, Reference):
        given = reference(t, order)
    elif callable(reference):
        given = np.asarray(reference(t), dtype=np.float64)
        if given.ndim in (1, 2):
            given = given[:, None, None] if given.ndim == 1 else given[:, :, None]
    else:
        constant = np.atleast_1d(check.array("reference", reference))
        if constant.ndim > 1 or constant.size not in (1, outputs or constant.size):
            remedy = f"give one number or one per output ({outputs})"
            raise Mistake("reference", reference, remedy, problem=f"has shape {constant.shape}")
        given = np.broadcast_to(constant[None, :, None], (t.size, outputs or constant.size, 1))
    if given.ndim != 3 or given.shape[0] != t.size or outputs not in (None, given.shape[1]) or given.shape[2] < 1:
        want = "outputs" if outputs is None else outputs
        problem = f"returned shape {given.shape} for {t.size} times"
        raise Mistake("reference", reference, f"give ({t.size}, {want}, order)", problem=problem)
    used = min(order, given.shape[2])
    result = np.zeros((t.size, given.shape[1], order))
    result[:, :, :used] = given[:, :, :used]
    bad = np.flatnonzero(~np.isfinite(result).all(axis=(1, 2)))
    if bad.size:
        problem = f"is not finite at t = {t[bad[0]]:g} s"
        raise Mistake("reference", reference, "give finite values", problem=problem)
    return result
