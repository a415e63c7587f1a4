"""Linear plants with one dead time per input."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch._helpers.text import tree

__all__ = ["Plant"]


class Plant:
    """A linear plant whose inputs act after a dead time.

    ``x'(t) = A x + sum_j B_j (u_j(t - delay_j) - u_offset_j) + E w(t)``, ``y = C x + y_offset``.

    Parameters
    ----------
    A : array_like, shape (n, n)
        State matrix [1/s].
    B : array_like, shape (n, m)
        Input matrix; a vector of length n is one input.
    C : array_like, shape (q, n), optional
        Output matrix; a vector of length n is one output. Default: the first state.
    E : array_like, shape (n, p), optional
        Entry of a measured disturbance w. Default: none.
    input_delay : float or array_like, shape (m,)
        Dead time [s], any real number >= 0, one for all inputs or one each.
    u_offset, y_offset : float or array_like, shape (m,) and (q,)
        Operating point.
    input_names, output_names : sequence of str, optional
        May carry a unit, ``"pressure [kPa]"``; they reach plots and files.

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite or a dead time is negative.

    Examples
    --------
    >>> Plant.integrator_lag(16500.0, 0.006, 0.005)
    Plant
    ├─ states        2, poles 0, -166.667
    ├─ input u       dead time 0.005 s
    └─ output y
    """

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike | None = None,
        *,
        E: ArrayLike | None = None,
        input_delay: ArrayLike = 0.0,
        u_offset: ArrayLike = 0.0,
        y_offset: ArrayLike = 0.0,
        input_names: Sequence[str] | str | None = None,
        output_names: Sequence[str] | str | None = None,
    ) -> None:
        self.A = check.matrix("A", A)
        n = self.A.shape[0]
        if n == 0 or self.A.shape[1] != n:
            problem = f"has shape {self.A.shape}"
            raise Mistake("A", A, "a square matrix with at least one state is needed", problem=problem)
        self.B = check.matrix("B", B, rows=n)
        self.C = check.matrix("C", np.eye(1, n) if C is None else C, columns=n)
        self.E = check.matrix("E", np.zeros((n, 0)) if E is None else E, rows=n)
        if self.B.shape[1] == 0 or self.C.shape[0] == 0:
            problem = f"has shape {self.B.shape} and C {self.C.shape}"
            raise Mistake(
                "B" if self.B.shape[1] == 0 else "C", B, "give at least one input and one output", problem=problem
            )
        m, q = self.B.shape[1], self.C.shape[0]
        self.input_delay = check.per("input_delay", input_delay, m, "input", least=0.0)
        self.u_offset = check.per("u_offset", u_offset, m, "input")
        self.y_offset = check.per("y_offset", y_offset, q, "output")
        self.input_names = check.names("input_names", input_names, m, "u")
        self.output_names = check.names("output_names", output_names, q, "y")

    @property
    def states(self) -> int:
        """Number of states n."""
        return int(self.A.shape[0])

    @property
    def inputs(self) -> int:
        """Number of inputs m."""
        return int(self.B.shape[1])

    @property
    def outputs(self) -> int:
        """Number of outputs q."""
        return int(self.C.shape[0])

    @property
    def disturbances(self) -> int:
        """Number of measured disturbances p."""
        return int(self.E.shape[1])

    @property
    def poles(self) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Eigenvalues of A [rad/s], slowest first, shape (n,)."""
        poles = np.linalg.eigvals(self.A).astype(np.complex128)
        return poles[np.argsort(np.abs(poles), kind="stable")]

    def replace(self, **changes: Any) -> Plant:
        """A copy with some constructor arguments changed.

        Parameters
        ----------
        **changes
            Any argument of `Plant`.

        Returns
        -------
        Plant
        """
        keep: dict[str, Any] = {
            "A": self.A,
            "B": self.B,
            "C": self.C,
            "E": self.E,
            "input_delay": self.input_delay,
            "u_offset": self.u_offset,
            "y_offset": self.y_offset,
            "input_names": self.input_names,
            "output_names": self.output_names,
        }
        unknown = sorted(changes.keys() - keep.keys())
        if unknown:
            name = unknown[0]
            problem, remedy = f"has no argument {name!r}", f"known are {', '.join(keep)}"
            raise Mistake(name, changes[name], remedy, problem=problem, subject="Plant")
        return Plant(**(keep | changes))

    def with_errors(self, delay: ArrayLike = 0.0, gain: ArrayLike = 0.0) -> Plant:
        """What this model may be wrong about: a plant that answers later and more strongly.

        Parameters
        ----------
        delay : float or array_like, shape (m,)
            Added to ``input_delay`` [s]; negative: it answers earlier.
        gain : float or array_like, shape (m,)
            Share by which each input does more: ``B (1 + gain)``.

        Returns
        -------
        Plant

        Raises
        ------
        ValueError
            If an argument does not fit, or a dead time would be negative.

        Examples
        --------
        >>> Plant.integrator_lag(16500.0, 0.006, 0.005).with_errors(delay=0.001, gain=-0.1).input_delay
        array([0.006])
        """
        late = check.per("delay", delay, self.inputs, "input")
        input_delay = self.input_delay + late
        if (input_delay < 0.0).any():
            j = int(input_delay.argmin())
            problem = f"is {late[j]:g}, which leaves less than no dead time ({input_delay[j]:g} s)"
            raise Mistake("delay", late[j], f"give at least {-self.input_delay[j]:g}", problem=problem)
        return self.replace(B=self.B * (1.0 + check.per("gain", gain, self.inputs, "input")), input_delay=input_delay)

    @classmethod
    def from_tf(cls, num: ArrayLike, den: ArrayLike, *, input_delay: ArrayLike = 0.0, **names: Any) -> Plant:
        """From one transfer function, coefficients in descending powers of s.

        Without zeros the states are y, y', y'', ...; with zeros they are those of the controllable
        canonical form.

        Parameters
        ----------
        num, den : array_like
            Numerator and denominator; the degree of ``num`` must be the smaller one.
        input_delay : float
            Dead time [s].
        **names
            Further arguments of `Plant`, such as ``output_names``.

        Returns
        -------
        Plant

        Raises
        ------
        ValueError
            If the transfer function has direct feedthrough, or a polynomial is zero.
        """
        for name, polynomial in (("num", num), ("den", den)):
            if np.ndim(polynomial) > 1:
                problem = f"has shape {np.shape(polynomial)}"
                raise Mistake(name, polynomial, "give one polynomial, or use from_control", problem=problem)
        b = np.trim_zeros(np.atleast_1d(check.array("num", num)), "f")
        a = np.trim_zeros(np.atleast_1d(check.array("den", den)), "f")
        if a.size == 0 or b.size == 0:
            name, polynomial = ("den", den) if a.size == 0 else ("num", num)
            raise Mistake(name, polynomial, "give at least one non-zero coefficient", problem="is zero")
        n = a.size - 1
        if b.size > n:
            problem = f"has degree {b.size - 1} and den {n}, which is direct feedthrough"
            raise Mistake("num", num, "add the actuator's own lag", problem=problem)
        A = np.eye(n, k=1)
        A[-1] = -a[:0:-1] / a[0]
        ascending = b[::-1] / a[0]
        gain, C = (ascending[0], np.eye(1, n)) if b.size == 1 else (1.0, np.zeros((1, n)))
        if b.size > 1:
            C[0, : b.size] = ascending
        return cls(A, gain * np.eye(n)[:, -1:], C, input_delay=input_delay, **names)

    @classmethod
    def fopdt(cls, K: float, T: float, L: float, **names: Any) -> Plant:
        """First order plus dead time, ``K e^(-L s) / (T s + 1)``.

        Parameters
        ----------
        K : float
            Gain.
        T : float
            Time constant [s], > 0.
        L : float
            Dead time [s].
        **names
            Further arguments of `Plant`.

        Returns
        -------
        Plant
        """
        K, T = check.number("K", K), check.number("T", T, above=0.0)
        return cls([[-1.0 / T]], [[K / T]], input_delay=check.number("L", L, least=0.0), **names)

    @classmethod
    def integrator_lag(cls, k: float, c: float, L: float, **names: Any) -> Plant:
        """Integrator behind a lag and a dead time, ``k e^(-L s) / (s (c s + 1))``; states y, y'.

        Parameters
        ----------
        k : float
            Slope of y at full input [unit of y / s].
        c : float
            Lag [s], > 0.
        L : float
            Dead time [s].
        **names
            Further arguments of `Plant`.

        Returns
        -------
        Plant
        """
        k, c = check.number("k", k), check.number("c", c, above=0.0)
        L = check.number("L", L, least=0.0)
        return cls([[0.0, 1.0], [0.0, -1.0 / c]], [[0.0], [k / c]], input_delay=L, **names)

    @classmethod
    def from_control(cls, sys: Any, *, input_delay: ArrayLike = 0.0, **names: Any) -> Plant:
        """From a continuous python-control or scipy.signal system.

        Parameters
        ----------
        sys : control.StateSpace, control.TransferFunction or scipy.signal.lti
            Without direct feedthrough. A transfer function of one input and one output goes through
            `from_tf`, so that its states keep their meaning; a matrix of them is realised entry by entry.
        input_delay : float or array_like, shape (m,)
            Dead time [s]; neither library carries one.
        **names
            Further arguments of `Plant`.

        Returns
        -------
        Plant

        Raises
        ------
        ValueError
            If the system is discrete or has direct feedthrough, or the object is none of these.
        """
        dt = getattr(sys, "dt", None)
        if dt not in (None, 0):
            remedy = "give the continuous system, its period goes to Controller"
            raise Mistake("sys", sys, remedy, problem=f"is discrete (dt = {dt})")
        if hasattr(sys, "A") and hasattr(sys, "D"):
            if np.any(np.asarray(sys.D) != 0):
                problem = f"has direct feedthrough D = {shown(np.asarray(sys.D))}"
                raise Mistake("sys", sys, "D must be zero", problem=problem)
            for key, label in (("input_names", "input_labels"), ("output_names", "output_labels")):
                given = getattr(sys, label, None)
                if given and not all(re.fullmatch(r"[uy]\[\d+\]", name) for name in given):
                    names.setdefault(key, list(given))
            return cls(sys.A, sys.B, sys.C, input_delay=input_delay, **names)
        if hasattr(sys, "to_tf") and not hasattr(sys, "num"):  # scipy ZerosPolesGain
            sys = sys.to_tf()
        if hasattr(sys, "num") and hasattr(sys, "den"):
            num, den = sys.num, sys.den
            if isinstance(num, np.ndarray) and num.dtype != object:  # scipy: one input, one denominator
                num, den = [[row] for row in np.atleast_2d(num)], [[den]] * len(np.atleast_2d(num))
            if len(num) == 1 and len(num[0]) == 1:
                return cls.from_tf(num[0][0], den[0][0], input_delay=input_delay, **names)
            return cls._from_tf_matrix(num, den, input_delay, names)
        problem = f"is a {type(sys).__name__}"
        raise Mistake("sys", sys, "give a python-control or scipy.signal system", problem=problem)

    @classmethod
    def _from_tf_matrix(cls, num: Any, den: Any, input_delay: ArrayLike, names: dict[str, Any]) -> Plant:
        """Side by side: each non-zero entry with states of its own."""
        q, m = len(num), len(num[0])
        blocks, B, C = [], [], []
        for i in range(q):
            for j in range(m):
                if np.any(np.asarray(num[i][j]) != 0):
                    entry = cls.from_tf(num[i][j], den[i][j])
                    blocks.append(entry.A)
                    B.append(entry.B @ np.eye(1, m, j))
                    C.append(np.eye(q)[:, i : i + 1] @ entry.C)
        if not blocks:
            remedy = "give a transfer function with at least one non-zero entry"
            raise Mistake("sys", num, remedy, problem="is zero")
        return cls(block_diag(*blocks), np.vstack(B), np.hstack(C), input_delay=input_delay, **names)

    def to_control(self) -> Any:
        """The delay-free plant from u to y as ``control.StateSpace``; needs python-control.

        Returns
        -------
        control.StateSpace
            Dead time, operating point and E have no place there and are left out.
        """
        import control

        labels: dict[str, Any] = {"inputs": list(self.input_names), "outputs": list(self.output_names)}
        return control.ss(self.A, self.B, self.C, np.zeros((self.outputs, self.inputs)), **labels)

    def __repr__(self) -> str:
        poles = ", ".join(f"{p.real:.6g}" + (f"{p.imag:+.6g}j" if p.imag else "") for p in self.poles)
        lines = [f"states        {self.states}, poles {poles}"]
        for name, delay, offset in zip(self.input_names, self.input_delay, self.u_offset, strict=True):
            about = f", about {offset:g}" if offset else ""
            lines.append(f"input {name:<7} dead time {delay:g} s{about}")
        if self.disturbances:
            lines.append(f"disturbances  {self.disturbances}, measured")
        for name, offset in zip(self.output_names, self.y_offset, strict=True):
            lines.append(f"output {name}" + (f", about {offset:g}" if offset else ""))
        return tree("Plant", lines)
