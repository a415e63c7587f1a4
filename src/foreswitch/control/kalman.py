"""State estimation from measured outputs: a steady-state Kalman filter, its gain found at design time.

The core predicts the estimate over one period with the commands that really act, then corrects it by the innovation:
``e = y - C x' - y_offset``, ``[x; load] = [x'; load] + gain e``. A load is a constant input that nobody measures, a
random walk that enters as B does, after the dead time.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigvals, solve_discrete_are
from scipy.special import gammaincc, gammainccinv

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch.model.plant import Plant

__all__ = ["Filter", "Kalman", "load_entries", "steady_filter"]

#: A mode is out of sight of the outputs where the smallest singular value of [s I - A; C], rows and columns of unit
#: size, lies below this.
OUT_OF_SIGHT = 1e-8
#: Correlations are symmetric and positive to within this.
ROUND_OFF = 1e-9
#: A mode that decays slower than this share of the fastest one counts as one that does not decay.
LASTING = 1e-9
#: Beyond so many standard deviations the probability underflows.
WIDEST_GATE = 30.0
#: An error that decays less than this in a period never does.
NEVER = 1e-10

#: Where there is no steady filter.
REMEDY = (
    "give every state that does not decay a variance that is neither 0 nor very small beside measurement_noise, or "
    "measure it"
)


@dataclass(frozen=True)
class Kalman:
    """Estimate the state from the outputs: ``Controller(..., estimator=Kalman(...))``.

    A steady-state Kalman filter, driven by the commands that act, after their dead time. `Controller.step` then takes
    the measured outputs in place of the state.

    Parameters
    ----------
    process_noise : float or array_like, shape (n,) or (n, n)
        Covariance that the state gathers in one switching period [unit of x, squared]: one variance for all states, one
        each, or the matrix.
    measurement_noise : float or array_like, shape (q,) or (q, q)
        Covariance of the measured outputs [unit of y, squared], in the same forms.
    load : float or array_like, shape (m,), optional
        Variance that an unknown constant input gathers in one period [unit of u, squared], for each input; 0: that
        input has none. It is estimated with the state and compensated, so that neither a leak nor a wrong gain leaves
        an offset. Default: no loads.
    gate : float
        Innovations beyond so many standard deviations are outliers; 0: none are. With several outputs: as improbable
        as that. The default acts on gross errors only: a sound sample is taken for one twice in 1e9.
    gate_limit : int
        Outliers in a row that are not used, 1 to 255. Then every sample is, until one lies inside the gate: what lasts
        longer than a spike is the plant. The default is less than the default ``bad_limit``, so that a plant that has
        really jumped does not force the safe level.

    Raises
    ------
    ValueError
        If a covariance is negative or not symmetric, or a number is out of range; by `Controller`, if a shape does not
        fit, or the outputs do not determine every state and load that lasts.

    Examples
    --------
    >>> from foreswitch import Controller, Endpoint
    >>> valve = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    >>> estimator = Kalman([0.0, 1e4], 4.0, load=1e-6)
    >>> controller = Controller(valve, [0, 1], 1e-3, Endpoint(Td=0.020, lam=2500.0), estimator=estimator)
    >>> controller.step(0.0, 100.0)
    array([1.])
    """

    process_noise: ArrayLike
    measurement_noise: ArrayLike
    _: KW_ONLY
    load: ArrayLike | None = None
    gate: float = 6.0
    gate_limit: int = 3

    def __post_init__(self) -> None:
        for name in ("process_noise", "measurement_noise"):
            value = check.array(name, getattr(self, name))
            if value.ndim < 2:
                if (value < 0).any():
                    raise Mistake(name, getattr(self, name), "variances must be at least 0")
                continue
            if value.ndim > 2 or value.shape[0] != value.shape[1]:
                problem = f"has shape {value.shape}"
                raise Mistake(name, value, "give one variance, one each, or a square matrix", problem=problem)
            deviation = np.sqrt(np.abs(np.diag(value)))
            unit = np.where(deviation > 0, deviation, 1.0)  # what is round-off must not depend on units
            correlation = value / np.outer(unit, unit)
            if not np.allclose(correlation, correlation.T, rtol=0, atol=ROUND_OFF):
                raise Mistake(name, value, "a covariance must be symmetric")
            if np.linalg.eigvalsh(correlation).min(initial=0.0) < -ROUND_OFF:
                raise Mistake(name, value, "a covariance must not have negative eigenvalues")
        if self.load is not None and (check.array("load", self.load) < 0).any():
            raise Mistake("load", self.load, "variances must be at least 0")
        if not 0.0 <= check.number("gate", self.gate) <= WIDEST_GATE:
            raise Mistake("gate", self.gate, f"give up to {WIDEST_GATE:g} standard deviations, or 0 for none")
        if not 1 <= check.number("gate_limit", self.gate_limit) <= 255 or self.gate_limit != int(self.gate_limit):
            raise Mistake("gate_limit", self.gate_limit, "give 1 to 255 samples")


@dataclass(frozen=True)
class Filter:
    """A designed filter: `Controller.kalman`.

    Attributes
    ----------
    gain : ndarray, shape (n + l, q)
        Innovation to estimate, the states and then the loads; of the form that corrects the present prediction.
    poles : ndarray, shape (n + l,)
        Of the estimate's error from period to period, slowest first.
    innovation : ndarray, shape (q, q)
        Covariance of the innovation.
    start_row, start_offset : ndarray, shape (n, q) and (n,)
        The state at rest at an output, which the first measurement is taken for.
    gate : ndarray, shape (q, q), or None
        An outlier has ``e' gate e > 1``.
    loads : int
        Number of loads l.
    """

    gain: Array
    poles: np.ndarray[Any, np.dtype[np.complex128]]
    innovation: Array
    start_row: Array
    start_offset: Array
    gate: Array | None
    loads: int


def load_entries(estimator: Kalman, plant: Plant) -> Array:
    """How the loads enter: the columns of B whose variance is not 0, shape (n, l)."""
    columns: Array = plant.B[:, _load_variances(estimator, plant) > 0]
    return columns


def steady_filter(estimator: Kalman, plant: Plant, transition: Array, load_steps: Array) -> Filter:
    """The filter for a plant and its model over one period.

    Parameters
    ----------
    estimator : Kalman
    plant : Plant
    transition : ndarray, shape (n, n)
        State to state, over one period.
    load_steps : ndarray, shape (n, l)
        Loads to state.

    Returns
    -------
    Filter

    Raises
    ------
    ValueError
        If a shape does not fit or no such filter exists.
    """
    n, q, loads = plant.states, plant.outputs, load_steps.shape[1]
    variances = _load_variances(estimator, plant)
    Q = np.zeros((n + loads, n + loads))
    Q[:n, :n] = _covariance("process_noise", estimator.process_noise, n, "state")
    Q[n:, n:] = np.diag(variances[variances > 0])
    R = _covariance("measurement_noise", estimator.measurement_noise, q, "output")
    if np.linalg.eigvalsh(R)[0] <= 1e-12 * np.abs(R).max():
        remedy = "it must be greater than 0 for each output: of a sensor without noise, give its step squared / 12"
        raise Mistake("measurement_noise", estimator.measurement_noise, remedy)
    _check_sight(estimator, plant)
    A = np.block([[transition, load_steps], [np.zeros((loads, n)), np.eye(loads)]])
    C = np.hstack([plant.C, np.zeros((q, loads))])
    gain, innovation = _gain(A, C, Q, R)
    poles = eigvals(A - gain @ C @ A)
    poles = poles[np.argsort(-np.abs(poles), kind="stable")]
    if not np.abs(poles[0]) < 1.0 - NEVER:
        raise Mistake("process_noise", estimator.process_noise, REMEDY, problem="leads to no steady filter")
    M = np.block([[plant.A, plant.B], [plant.C, np.zeros((q, plant.inputs))]])
    rest = np.linalg.pinv(M)[:n, n:]
    beyond = gammaincc(0.5, 0.5 * estimator.gate**2)  # of one output; of q as improbable
    threshold = 2.0 * float(gammainccinv(0.5 * q, beyond))
    gate = np.linalg.inv(innovation) / threshold if estimator.gate > 0 else None
    return Filter(gain, poles, innovation, rest, -rest @ plant.y_offset, gate, loads)


def _load_variances(estimator: Kalman, plant: Plant) -> Array:
    return check.per("load", 0.0 if estimator.load is None else estimator.load, plant.inputs, "input")


def _covariance(name: str, value: ArrayLike, size: int, what: str) -> Array:
    """One variance, one each or the matrix, as a matrix."""
    given = check.array(name, value)
    if given.shape not in ((), (size,), (size, size)):
        remedy = f"give one variance, one per {what} ({size}), or a {size} x {size} matrix"
        raise Mistake(name, value, remedy, problem=f"has shape {given.shape}")
    matrix: Array = given if given.ndim == 2 else np.diag(np.broadcast_to(given, (size,)))
    return 0.5 * (matrix + matrix.T)


def _check_sight(estimator: Kalman, plant: Plant) -> None:
    """Every mode that lasts must show in the outputs, and every load too."""
    poles = plant.poles
    for pole in poles[poles.real >= -LASTING * np.abs(poles).max()]:
        if _hidden(plant.A, plant.C, pole):
            at = f"{pole.real:.4g}" + (f"{pole.imag:+.4g}j" if pole.imag else "")
            problem = f"does not show its mode at {at} rad/s in the outputs, and it does not decay"
            raise Mistake("C", plant.C, "measure a state that it moves", problem=problem, subject="plant")
    B = load_entries(estimator, plant)
    n, loads = B.shape
    if loads > plant.outputs:
        problem = f"names {loads} inputs and the plant has {plant.outputs} output(s), which cannot tell them apart"
        raise Mistake("load", estimator.load, "give 0 for the others", problem=problem)
    A = np.block([[plant.A, B], [np.zeros((loads, n + loads))]])
    if loads and _hidden(A, np.hstack([plant.C, np.zeros((plant.outputs, loads))]), 0.0):
        why = "constant loads do not show in the outputs (the plant has a zero at the origin)"
        problem = f"is {shown(estimator.load)}, but {why}"
        raise Mistake("load", estimator.load, "give 0, or measure another output", problem=problem)


def _hidden(A: Array, C: Array, pole: complex) -> bool:
    """Whether some motion with this pole does not show in C x: rank of [pole I - A; C]."""
    M = np.vstack([pole * np.eye(len(A)) - A, C])
    for _ in range(3):  # units must not matter
        for axis in (1, 0):
            size = np.linalg.norm(M, axis=axis, keepdims=True)
            M = M / np.where(size > 0, size, 1.0)
    return bool(np.linalg.svd(M, compute_uv=False)[-1] < OUT_OF_SIGHT)


def _gain(A: Array, C: Array, Q: Array, R: Array) -> tuple[Array, Array]:
    """Gain of the present correction, and the innovation's covariance."""
    unit = _spread(A, C, Q, R)  # of each state: the solver is exact where all covariances are of one size
    root = np.linalg.cholesky(R)
    seen = np.linalg.solve(root, C * unit)
    try:
        P = solve_discrete_are((A / unit[:, None] * unit).T, seen.T, Q / np.outer(unit, unit), np.eye(len(R)))
    except (np.linalg.LinAlgError, ValueError):
        raise Mistake("process_noise", Q, REMEDY, problem="leads to no steady filter") from None
    S = seen @ P @ seen.T + np.eye(len(R))
    gain = unit[:, None] * np.linalg.solve(root.T, np.linalg.solve(S, seen @ P)).T
    return gain, root @ (0.5 * (S + S.T)) @ root.T


def _spread(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """About how uncertain each state is: the deviations after as many steps of the filter as a load needs to spread."""
    P = Q
    for _ in range(20 * len(A)):
        P = P - P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)
        P = A @ P @ A.T + Q
    deviation = np.sqrt(np.maximum(np.diag(P), 0.0))
    return np.where(deviation > 0, deviation, 1.0)
