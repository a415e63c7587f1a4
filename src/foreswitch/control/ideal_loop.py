"""The ideal loop: the closed loop with an input that is not quantised, and what it would leave of a reference."""

from __future__ import annotations

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch.model.prediction import EndpointRows, PeriodModel, Rest, Sliding

__all__ = ["ideal_response"]

# A DC gain from yd to y, which would be 1, is 0 below this.
ZERO_GAIN = 1e-8


def ideal_response(
    model: PeriodModel, rows: EndpointRows, s: Sliding, tail: Rest | None, C: Array, weight: Array, Ts: float
) -> tuple[Array, Array]:
    """DC gain (q, q) and lag (q,) of the loop yd -> y with an unquantised input.

    A ramp ``yd = v t`` (with its derivative) leaves ``x[k] = a + b t_k``, ``u[k] = c + e t_k``. The slopes
    (b, e) and then the constants (a, c) solve two linear systems with one matrix; ``y = gain (t - lag)``.
    NaN where no such response exists.
    """
    n, m, q = C.shape[1], rows.total.shape[1], C.shape[0]
    root = np.sqrt(weight)[:, None]
    h = np.array([row[0] for row in rows.hold]).T  # (q, m)
    K = np.linalg.pinv(root * h) * root.T  # unquantised choice: u = -K (free part of s)
    W = np.array([row.sum(axis=0) for row in rows.pending]).T
    W_age = np.array([np.arange(1, len(row) + 1) @ row for row in rows.pending]).T
    direct = np.eye(q) - ((rows.total - h) @ tail.reference if tail else np.zeros((q, q)))
    lead = np.diag(s.reference[:, 1]) if s.reference.shape[1] > 1 else np.zeros((q, q))
    gamma = (model.old + model.new).T
    M = np.block([[model.transition - np.eye(n), gamma], [K @ rows.state, np.eye(m) + K @ W]])
    age = np.array(model.delay, dtype=np.float64)
    late = model.old.T * age + model.new.T * (age - 1.0)
    try:
        slope = np.linalg.solve(M, np.vstack([np.zeros((n, q)), K @ direct]))
        b, e = slope[:n], slope[n:]
        constant = np.linalg.solve(M, np.vstack([Ts * (b + late @ e), K @ (lead + Ts * W_age @ e)]))
    except np.linalg.LinAlgError:
        return np.full((q, q), np.nan), np.full(q, np.nan)
    gain = C @ b
    diagonal = np.diag(gain).copy()
    diagonal[np.abs(diagonal) < ZERO_GAIN] = np.nan
    return gain, -np.diag(C @ constant[:n]) / diagonal
