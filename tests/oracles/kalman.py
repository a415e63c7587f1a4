"""The steady-state Kalman filter written out slowly and plainly, on top of oracle.py: the tests' own truth.

The law it belongs to has the loaded columns of B behind those of E, so that its disturbance is [w; load].
"""

from math import isfinite

import numpy as np


def riccati_gain(A, C, Q, R):
    """Gain of the filter that corrects the present prediction, and the innovation's covariance, by doubling."""
    F, G, H, identity = A.T, C.T @ np.linalg.inv(R) @ C, np.array(Q, float), np.eye(len(A))
    for _ in range(60):
        solved = np.linalg.inv(identity + G @ H)
        step = F.T @ H @ solved @ F
        F, G, H = F @ solved @ F, G + F @ solved @ G @ F.T, H + step
        if np.abs(step).max() < 1e-15 * np.abs(H).max():
            break
    S = C @ H @ C.T + R
    return H @ C.T @ np.linalg.inv(S), S


def usable(value):
    return isfinite(value) and abs(value) <= 1e30


class Estimator:
    """What is used in place of the state, and which status that is."""

    def __init__(self, law, loads, gain, innovation, gate, gate_limit, bad_limit):
        self.law, self.loads, self.gain = law, loads, gain
        self.innovation, self.gate, self.gate_limit, self.bad_limit = innovation, gate, gate_limit, bad_limit
        self.x, self.d, self.w = None, np.zeros(loads), np.zeros(law.E.shape[1] - loads)
        self.expected, self.outliers, self.bad = None, 0, 0

    def started(self, y):
        """The state at rest at an output."""
        law = self.law
        M = np.block([[law.A, law.B], [law.C, np.zeros((law.q, law.m))]])
        right = np.concatenate([np.zeros(law.n), y - law.y_offset])
        return np.linalg.lstsq(M, right, rcond=None)[0][: law.n]

    def observe(self, y, w):
        """Status; leaves the estimate in x and d."""
        status, y = "COASTING", np.array(y, float)
        good = all(map(usable, y))
        if self.expected is None:
            status = "HELD"
            if good:
                self.x, status = self.started(y), "OK"
        else:
            self.x = self.expected
            if good and self.accepted(e := y - self.law.C @ self.expected - self.law.y_offset):
                n = self.law.n
                self.x, self.d, status = self.x + self.gain[:n] @ e, self.d + self.gain[n:] @ e, "OK"
        if all(map(usable, w)):
            self.w = np.array(w, float)
        elif status == "OK":
            status = "COASTING"
        self.bad = 0 if status == "OK" else self.bad + 1
        return "SAFE" if self.bad_limit and self.bad >= self.bad_limit else status

    def accepted(self, e):
        """Whether the sample is used."""
        if not self.gate or e @ np.linalg.solve(self.innovation, e) <= self.gate:
            self.outliers = 0
            return True
        self.outliers = min(self.outliers + 1, self.gate_limit + 1)
        return self.outliers > self.gate_limit

    @property
    def disturbance(self):
        return np.concatenate([self.w, self.d])

    def advance(self, u):
        """u is the command of this period, not yet issued; the law's history holds those under way."""
        if self.x is not None:
            law = self.law
            self.expected = law.state_after(law.Ts, self.x, self.disturbance, u, [1] * law.m, u)
