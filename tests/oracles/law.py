"""The endpoint law of theory.md [3] [4] [4a] and section 7, written out slowly and plainly: the tests' own truth.

Nothing comes from the library and nothing is folded into rows: the state is carried to the evaluation instant
through one piece of constant input after another, the sliding variable is formed there, and the candidate with the
smallest cost wins.  Times are seconds after the present instant t_k unless said otherwise.
"""

from itertools import pairwise, product
from math import ceil, comb, floor, inf

import numpy as np
from scipy.linalg import expm


class Law:
    """One plant under the law, with its issued commands and running dwell times.

    Every per-input argument has m entries and every per-output argument q entries; there are no short forms.
    """

    def __init__(
        self,
        A,
        B,
        C,
        E,
        delay,
        u_offset,
        y_offset,
        levels,
        Ts,
        Td,
        lam,
        weight,
        r,
        tail,
        min_on,
        min_off,
        switch_cost,
        forbidden,
        safe,
    ):
        self.A, self.B, self.C, self.E = (np.array(M, float) for M in (A, B, C, E))
        self.n, self.m = self.B.shape
        self.q = len(self.C)
        self.delay, self.u_offset, self.y_offset = delay, np.array(u_offset, float), np.array(y_offset, float)
        self.levels, self.Ts, self.Td = levels, Ts, Td
        self.lam, self.weight, self.r, self.tail = lam, weight, r, tail
        self.min_on, self.min_off, self.switch_cost, self.safe = min_on, min_off, switch_cost, safe
        self.candidates = np.array([c for c in product(*levels) if c not in forbidden], float)
        self.horizon = max(delay) + Td  # the evaluation instant
        self.steps_known = {}  # expm of every duration met, only to save time
        self.reset(None, None)

    # What was issued -------------------------------------------------------------------------------------------------

    def reset(self, pending, elapsed):
        """Start from commands issued before (oldest first) and the seconds since each input last switched."""
        self.history = [tuple(row) for row in pending] if pending is not None else [tuple(self.safe)]
        self.remaining = [0] * self.m  # periods for which each input must still stay where it is
        if elapsed is not None:
            for j in range(self.m):
                minimum = self.minimum(j, self.history[-1][j])
                self.remaining[j] = max(0, ceil((minimum - elapsed[j]) / self.Ts - 1e-9))

    def issue(self, u):
        """The command u has been given at t_k: t_k becomes t_k + Ts."""
        for j in range(self.m):
            run = self.remaining[j] if u[j] == self.history[-1][j] else self.periods(j, u[j])
            self.remaining[j] = max(0, run - 1)
        self.history.append(tuple(u))

    # Dwell, section 7 ------------------------------------------------------------------------------------------------

    def minimum(self, j, level):
        """Seconds that a run of input j at this level lasts at least; an input is off at its safe level only."""
        return self.min_off[j] if level == self.safe[j] else self.min_on[j]

    def periods(self, j, level):
        """The same in whole periods."""
        return ceil(self.minimum(j, level) / self.Ts - 1e-9)

    def allowed(self, candidate):
        """True if no input that must stay is moved."""
        present = self.history[-1]
        return all(candidate[j] == present[j] or self.remaining[j] == 0 for j in range(self.m))

    def held(self, candidate):
        """Periods for which each input is predicted to stay at the candidate: what it must, and at least one."""
        present = self.history[-1]
        return [
            max(1, self.remaining[j] if candidate[j] == present[j] else self.periods(j, candidate[j]))
            for j in range(self.m)
        ]

    # Prediction, (1) and [4] -----------------------------------------------------------------------------------------

    def input_at(self, time, j, candidate, held, tail):
        """u_j(t_k + time - tau_j): an issued command, then the candidate, then the tail."""
        period = floor((time - self.delay[j]) / self.Ts)  # -1: the last issued command, 0: the candidate's first
        if period < 0:
            return self.history[max(period, -len(self.history))][j]  # before the record: its oldest command
        return candidate[j] if period < held[j] else tail[j]

    def state_after(self, duration, x, w, candidate, held, tail):
        """x(t_k + duration) by exact integration from one switching instant (of any input) to the next."""
        instants = {0.0, duration}
        for j in range(self.m):
            for period in range(-len(self.history), held[j] + 1):
                instant = self.delay[j] + period * self.Ts
                if 0.0 < instant < duration:
                    instants.add(instant)
        instants = sorted(instants)
        for start, end in pairwise(instants):
            middle = (start + end) / 2
            u = np.array([self.input_at(middle, j, candidate, held, tail) for j in range(self.m)])
            Phi, Gamma, Gamma_w = self.constant_input(end - start)
            x = Phi @ x + Gamma @ (u - self.u_offset) + Gamma_w @ w
        return x

    def constant_input(self, duration):
        """exp([A B E; 0 0 0] duration): the exact step of x' = A x + B (u - u_offset) + E w with u and w constant."""
        if duration not in self.steps_known:
            n, m = self.n, self.m
            block = np.zeros((n + m + self.E.shape[1],) * 2)
            block[:n] = np.hstack([self.A, self.B, self.E])
            top = expm(block * duration)[:n]
            self.steps_known[duration] = top[:, :n], top[:, n : n + m], top[:, n + m :]
        return self.steps_known[duration]

    def rest_unclipped(self, w, yd):
        """The input (not its deviation) that keeps y at yd under w, [4a], before clipping."""
        matrix = np.block([[self.A, self.B], [self.C, np.zeros((self.q, self.m))]])
        right = np.concatenate([-self.E @ w, yd - self.y_offset])
        solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
        return solution[self.n :] + self.u_offset

    def tail_input(self, w, yd):
        """The input assumed after the candidate: literally zero, or at rest within the hull of the levels."""
        if self.tail == "zero":
            return np.zeros(self.m)
        rest = self.rest_unclipped(w, yd)
        return np.array([min(max(rest[j], min(self.levels[j])), max(self.levels[j])) for j in range(self.m)])

    # Sliding variable [3], cost and choice ---------------------------------------------------------------------------

    def sliding(self, x, w, reference):
        """s = (1 + (1/lam) d/dt)^(r-1) (y - yd) per output, at a point with state x; reference is (q, order)."""
        s = np.zeros(self.q)
        for o in range(self.q):
            for i in range(self.r[o]):
                derivative = self.C[o] @ np.linalg.matrix_power(self.A, i) @ x
                if i == 0:
                    derivative += self.y_offset[o]
                else:  # y' = C A x + C E w, y'' = C A^2 x + C A E w, ...: w is held, u enters from order r on only
                    derivative += self.C[o] @ np.linalg.matrix_power(self.A, i - 1) @ self.E @ w
                s[o] += comb(self.r[o] - 1, i) * self.lam[o] ** -i * (derivative - reference[o, i])
        return s

    def endpoint(self, candidate, x, w, reference):
        """The sliding variables that a candidate leads to at the evaluation instant."""
        tail = self.tail_input(w, reference[:, 0])
        return self.sliding(self.state_after(self.horizon, x, w, candidate, self.held(candidate), tail), w, reference)

    def cost(self, candidate, x, w, reference):
        """V = 1/2 sum weight s^2 + the price of each input that changes; inf where dwell forbids the candidate."""
        if not self.allowed(candidate):
            return inf
        s = self.endpoint(candidate, x, w, reference)
        V = sum(self.weight[o] * s[o] ** 2 for o in range(self.q)) / 2
        return V + sum(self.switch_cost[j] for j in range(self.m) if candidate[j] != self.history[-1][j])

    def costs(self, x, w, reference):
        """The cost of every candidate, in their order."""
        return np.array([self.cost(candidate, x, w, reference) for candidate in self.candidates])

    def choice(self, costs):
        """Index of the winner: smallest cost, then the present command, then the lower index."""
        best = [i for i, cost in enumerate(costs) if cost == min(costs)]
        present = [i for i in best if tuple(self.candidates[i]) == self.history[-1]]
        return (present or best)[0]
