"""Prediction across the dead time: everything a step needs, folded into rows at design time.

Notation as in the theory chapter: tau_j input delays, Theta = max tau + Td evaluation instant (from
t_k), Phi = e^(A Ts), S the sliding row. Every integral is formed as
``e^(A (Theta - b)) int_0^(b-a) e^(A v) dv B`` for an input held over [a, b], never as a difference of
two integrals from zero, which would cancel for unstable plants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
from scipy.linalg import expm

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch.model.plant import Plant

__all__ = [
    "EndpointRows",
    "PeriodModel",
    "Rest",
    "Sliding",
    "endpoint_rows",
    "period_model",
    "relative_degrees",
    "rest",
    "sliding",
    "transition",
]

# |C A^l B| below this share of |C| |A|^l |B| is cancellation, not a coefficient.
RANK_TOLERANCE = 1e-10


def transition(A: Array, B: Array, t: float) -> tuple[Array, Array]:
    """``e^(A t)`` and ``int_0^t e^(A v) dv B``, by one exponential of the block matrix."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    full = expm(block * t)
    return full[:n, :n], full[:n, n:]


def relative_degrees(plant: Plant) -> list[int]:
    """Smallest r with ``C_o A^(r-1) B != 0``, per output; 0 where no input reaches the output."""
    degrees = [0] * plant.outputs
    row, size = plant.C, np.abs(plant.C)
    for r in range(1, plant.states + 1):
        effect, scale = np.abs(row @ plant.B), size @ np.abs(plant.B)
        for o in range(plant.outputs):
            if degrees[o] == 0 and (effect[o] > RANK_TOLERANCE * scale[o]).any():
                degrees[o] = r
        row, size = row @ plant.A, size @ np.abs(plant.A)
    return degrees


@dataclass(frozen=True)
class Sliding:
    """``s = state x + disturbance w + offset - sum_l reference[:, l] yd^(l)``, theory [3]."""

    state: Array  # S (q, n)
    disturbance: Array  # S_w (q, p)
    reference: Array  # (q, order)
    offset: Array  # (q,)


def sliding(plant: Plant, lam: Array, degree: list[int]) -> Sliding:
    """The sliding variable of each output, ``(1 + (1/lam) d/dt)^(r-1) (y - yd)``, w held."""
    q, n = plant.outputs, plant.states
    S, S_w, R = np.zeros((q, n)), np.zeros((q, plant.disturbances)), np.zeros((q, max(degree)))
    for o in range(q):
        derivative = plant.C[o]  # C A^i
        for i in range(degree[o]):
            factor = comb(degree[o] - 1, i) * lam[o] ** -i
            S[o] += factor * derivative
            R[o, i] = factor
            if i + 1 < degree[o]:
                S_w[o] += comb(degree[o] - 1, i + 1) * lam[o] ** -(i + 1) * (derivative @ plant.E)
            derivative = derivative @ plant.A
    return Sliding(S, S_w, R, plant.y_offset)


@dataclass(frozen=True)
class Rest:
    """``u_rest = reference yd + disturbance w + offset``, theory [4a], not yet clipped."""

    reference: Array  # (m, q)
    disturbance: Array  # (m, p)
    offset: Array  # (m,)
    state: tuple[Array, Array, Array]  # x there: (n, q), (n, p) and (n,), in the same way
    exact: bool  # False: least squares only, the reference cannot be held everywhere


def rest(plant: Plant) -> Rest:
    """The input that holds y at yd under w: ``[A B; C 0] [x; v] = [-E w; yd - y_offset]``, ``u = v + u_offset``."""
    n, q = plant.states, plant.outputs
    M = np.block([[plant.A, plant.B], [plant.C, np.zeros((q, plant.inputs))]])
    right = np.zeros((n + q, q + plant.disturbances))
    right[n:, :q], right[:n, q:] = np.eye(q), -plant.E
    solution = np.linalg.lstsq(M, right, rcond=None)[0]
    exact = bool(np.allclose(M @ solution, right, rtol=1e-8, atol=1e-8 * max(1.0, float(np.abs(right).max()))))
    R, R_w, X, X_w = solution[n:, :q], solution[n:, q:], solution[:n, :q], solution[:n, q:]
    return Rest(R, R_w, plant.u_offset - R @ plant.y_offset, (X, X_w, -X @ plant.y_offset), exact)


@dataclass(frozen=True)
class EndpointRows:
    """The sliding variable at t_k + Theta, theory [4].

    ``s = state x + sum_j sum_i pending[j][i-1] u_j[k-i] + disturbance w + offset - s_d
    + sum_j (total_j tail_j + hold[j][L-1] (u_j - tail_j))`` for a candidate held L periods.
    """

    state: Array  # f (q, n)
    pending: Sequence[Array]  # per input (delay in periods, q), newest first
    hold: Sequence[Array]  # per input (holds, q)
    total: Array  # (q, m)
    disturbance: Array  # (q, p)
    offset: Array  # (q,)


def endpoint_rows(plant: Plant, s: Sliding, Ts: float, Td: float, longest_hold: list[int]) -> EndpointRows:
    """Rows for the evaluation instant ``max input_delay + Td``.

    Parameters
    ----------
    plant : Plant
    s : Sliding
    Ts, Td : float
        Switching period and settling horizon [s].
    longest_hold : list of int
        Per input, the longest time a candidate may have to be held, in periods.
    """
    A, B, S = plant.A, plant.B, s.state
    theta = float(plant.input_delay.max()) + Td

    def held(j: int, start: float, end: float) -> Array:
        """Effect on s of a unit of input j acting over [start, end]."""
        step = transition(A, B[:, j : j + 1], end - start)[1]
        row: Array = S @ expm(A * (theta - end)) @ step
        return row[:, 0]

    phi, gamma = transition(A, B, Ts)
    pending, hold = [], []
    for j, tau in enumerate(plant.input_delay):
        depth = check.periods(tau, Ts)
        rows = np.zeros((depth, plant.outputs))
        # the command issued i periods ago acts until tau - (i - 1) Ts; all but the oldest for a whole period
        ahead = S @ expm(A * (theta - tau))
        for i in range(depth - 1):
            rows[i] = ahead @ gamma[:, j]
            ahead = ahead @ phi
        if depth:
            rows[-1] = held(j, 0.0, min(tau - (depth - 1) * Ts, Ts))
        pending.append(rows)
        span = min(longest_hold[j], max(1, check.periods(theta - tau, Ts)))
        hold.append(np.array([held(j, tau, min(tau + L * Ts, theta)) for L in range(1, span + 1)]))

    effects = [held(j, float(tau), theta) for j, tau in enumerate(plant.input_delay)]
    # the operating point shifts the input at all times, dead time or not
    drift = transition(A, np.column_stack([plant.E, B @ plant.u_offset]), theta)[1]
    return EndpointRows(
        state=S @ expm(A * theta),
        pending=pending,
        hold=hold,
        total=np.array(effects).T,
        disturbance=S @ drift[:, :-1] + s.disturbance,
        offset=s.offset - S @ drift[:, -1],
    )


@dataclass(frozen=True)
class PeriodModel:
    """A plant over one switching period.

    ``x[k+1] = transition x + sum_j (old_j u_j[k - delay_j] + new_j u_j[k - delay_j + 1] + load_j load_j)
    + disturbance w + drift``: a fractional dead time splits the period between two commands.
    """

    transition: Array  # (n, n)
    old: Array  # (m, n)
    new: Array  # (m, n)
    load: Array  # (m, n)
    disturbance: Array  # (n, p)
    drift: Array  # (n,)
    delay: list[int]  # per input, periods rounded up


@lru_cache(maxsize=64)
def period_model(plant: Plant, Ts: float) -> PeriodModel:
    """The plant from one switching instant to the next, exactly. Kept: searches run one plant many times."""
    A, B, m = plant.A, plant.B, plant.inputs
    phi, gamma = transition(A, np.hstack([B, plant.E]), Ts)
    load, disturbance = gamma[:, :m].T, gamma[:, m:]
    old, new, delay = np.zeros((m, plant.states)), np.zeros((m, plant.states)), []
    for j, tau in enumerate(plant.input_delay):
        depth = check.periods(tau, Ts)
        first = min(tau - (depth - 1) * Ts, Ts)  # seconds under the older command
        column = B[:, j : j + 1]
        new[j] = transition(A, column, Ts - first)[1][:, 0]
        old[j] = (expm(A * (Ts - first)) @ transition(A, column, first)[1])[:, 0]
        delay.append(depth)
    return PeriodModel(phi, old, new, load, disturbance, -(plant.u_offset @ load), delay)
