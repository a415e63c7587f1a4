"""The closed loop around its ideal response, as adversary.py drives it.

An independent transcription: state and commands under way are carried as they are, from one instant to the next, by
matrix exponentials of its own. Of the library only a controller's plain data and its estimator's gain are read.
"""

from itertools import product
from math import ceil, comb

import numpy as np
from scipy.linalg import expm

GRID = 12  # instants per period at which y is looked at, beside those at which a command begins to act


def held(A, b, duration):
    """What a unit of input leaves in x after so long."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A, b
    return expm(block * duration)[:n, n]


def over(A, b, start, end, at):
    """What a unit of input over [start, end] leaves in x at an instant not before it; of what lies after 0."""
    start, end = max(start, 0.0), min(end, at)
    return expm(A * (at - end)) @ held(A, b, end - start) if end > start else np.zeros(len(A))


def degree(A, B, row):
    r = 1
    while np.abs(row @ B).max() <= 1e-10 * np.abs(row).max() * np.abs(B).max() and r < len(A):
        row, r = row @ A, r + 1
    return r


class Rival:
    """One design; `truths` are rows of dead-time errors and gain errors, (T, 2, m)."""

    def __init__(self, controller, truths=None, *, grid=GRID):
        plant, given = controller.plant, controller._arguments
        self.controller = controller
        self.A, self.B, self.C, self.Ts = plant.A, plant.B, plant.C, controller.Ts
        self.n, self.m, self.q = plant.states, plant.inputs, plant.outputs
        self.tau, self.off = np.array(plant.input_delay), np.array(plant.u_offset)
        objective = controller.objective
        self.levels = [np.array(v) for v in controller.levels]
        banned = {tuple(np.atleast_1d(c)) for c in given["forbidden"]}
        self.commands = np.array([c for c in product(*self.levels) if c not in banned])
        self.price = np.broadcast_to(np.asarray(given["switch_cost"], float), (self.m,))
        self.truths = np.zeros((1, 2, self.m)) if truths is None else np.asarray(truths, float)
        self._law(objective)
        self._plant(grid)
        self.kalman = controller.kalman
        self.loads = 0 if self.kalman is None else self.kalman.loads
        self.measured = self.n if self.kalman is None else self.q
        if self.kalman is not None:
            self._estimator(given["estimator"])

    # ---- The law, theory [3] [4] ----

    def _law(self, objective):
        A, B, C, Ts = self.A, self.B, self.C, self.Ts
        lam = np.broadcast_to(np.asarray(objective.lam, float), (self.q,))
        weight = np.broadcast_to(np.asarray(objective.weight, float), (self.q,))
        given = objective.relative_degree
        S = np.zeros((self.q, self.n))
        for o in range(self.q):
            r = degree(A, B, C[o]) if given is None else int(np.broadcast_to(given, (self.q,))[o])
            for i in range(r):
                S[o] += comb(r - 1, i) * lam[o] ** -i * C[o] @ np.linalg.matrix_power(A, i)
        S = np.sqrt(weight)[:, None] * S
        self.theta = float(self.tau.max()) + objective.Td
        self.depth = [max(0, ceil(t / Ts - 1e-9)) for t in self.tau]
        self.see = S @ expm(A * self.theta)
        act = lambda j, i: S @ over(A, B[:, j], i * Ts + self.tau[j], (i + 1) * Ts + self.tau[j], self.theta)  # noqa: E731
        self.h = np.column_stack([act(j, 0) for j in range(self.m)])
        self.total = np.column_stack([S @ over(A, B[:, j], self.tau[j], self.theta, self.theta) for j in range(self.m)])
        self.push = S @ np.column_stack([over(A, B[:, j], 0.0, self.theta, self.theta) for j in range(self.m)])
        self.choice = np.linalg.pinv(self.h, rcond=1e-9)
        self.visible = self.choice @ self.h  # projector: the ideal input has no other part
        self._act = act
        self.tail = objective.tail

    # ---- The plant, from one period to the next and between instants ----

    def _plant(self, grid):
        A, B, Ts, m, n = self.A, self.B, self.Ts, self.m, self.n
        late = self.tau + np.maximum(self.truths[:, 0].max(axis=0), 0.0)
        self.line = D = max(1, *(ceil(t / Ts - 1e-9) for t in late))  # commands before this one that may act still
        edges = {Ts}
        for truth in (np.zeros((2, m)), *self.truths):
            edges |= {float(t) for t in (self.tau + truth[0]) % Ts if 1e-9 * Ts < t}
        self.instants = np.array(sorted(edges | {Ts * (i + 1) / grid for i in range(grid)}))
        self.phi = expm(A * Ts)
        self.flow = np.array([expm(A * s) for s in self.instants])
        at_end = int(np.argmax(self.instants))

        def windows(errors):
            """(instants, n, (D + 1) m): what commands -D .. 0 do from the period's beginning to each instant."""
            result = np.zeros((len(self.instants), n, D + 1, m))
            for i, j in product(range(D + 1), range(m)):
                start = (i - D) * Ts + self.tau[j] + errors[j]
                for s, at in enumerate(self.instants):
                    result[s, :, i, j] = over(A, B[:, j], start, start + Ts, at)
            return result

        known = windows(np.zeros(m))
        true = np.array([windows(t[0]) * (1.0 + t[1]) for t in self.truths])
        flat = lambda w: w.reshape(*w.shape[:-2], (D + 1) * m)  # noqa: E731
        self.true, self.known = flat(true), flat(known)[None]
        self.true_step, self.known_step = self.true[:, at_end], self.known[:, at_end]
        load = np.array([np.column_stack([over(A, B[:, j], 0.0, s, s) for j in range(m)]) for s in self.instants])
        self.load = load[None] * (1.0 + self.truths[:, None, None, 1])
        pending = np.zeros((self.q, D, m))
        for j in range(m):
            for i in range(1, self.depth[j] + 1):
                pending[:, D - i, j] = self._act(j, -i)
        self.pending = pending.reshape(self.q, D * m)

    # ---- The estimator ----

    def _estimator(self, given):
        variances = np.broadcast_to(np.asarray(0.0 if given.load is None else given.load, float), (self.m,))
        self.loaded = np.flatnonzero(variances > 0)
        entries = self.B[:, self.loaded]
        n, k = self.n, self.loads
        self.expect = np.eye(n + k)
        self.expect[:n, :n] = self.phi
        for i in range(k):
            self.expect[:n, n + i] = held(self.A, entries[:, i], self.Ts)
        M = np.block([[self.A, self.B], [self.C, np.zeros((self.q, self.m))]])
        right = np.zeros((n + self.q, k))
        right[:n] = -entries
        self.tail_of_load = (
            np.linalg.lstsq(M, right, rcond=None)[0][n:] if self.tail == "rest" else np.zeros((self.m, k))
        )

    # ---- The loop ----

    def run(self, ideal, noise=None, load=None, *, start=None, linear=None, steer=None, rest=None):
        """Deviation of y, (K, T, instants, q, P), and the ideal inputs, (K, T, m, P), as steering has changed them.

        ideal: (K, T, m, P), as issued before 0 it is `start` (line, T, m, P). linear: quantiser's error instead of a choice.
        steer: `Aims`. rest: input at rest, (K, T, m, P), for the clipping of the tail.
        """
        K, T, m, P = ideal.shape
        n, D = self.n, self.line
        start = np.zeros((D, T, m, P)) if start is None else start
        U, V = (np.zeros((T, (D + K) * m, P)) for _ in range(2))
        U[:, : D * m] = V[:, : D * m] = np.moveaxis(start, 0, 1).reshape(T, D * m, P)
        ideal = ideal.copy()
        offset = 0.0 if linear is not None else np.tile(self.off, D + 1)[:, None]
        x, states = np.zeros((T, n, P)), np.zeros((K, T, n, P))
        estimate = np.zeros((T, n + self.loads, P))
        extra = np.zeros((K, T, m, P)) if load is None else load
        jolt = self.load[:, int(np.argmax(self.instants))]
        self.gated = 0.0
        for k in range(K):
            states[k] = x
            now, before = slice(k * m, (k + D + 1) * m), slice(k * m, (k + D) * m)
            error = 0.0 if noise is None else noise[k]
            told = 0.0
            if self.kalman is None:
                seen = x + error
            else:
                estimate = self._corrected(estimate, self.C @ x + error, k == 0)
                seen = estimate[:, :n]
                if self.loads:
                    told = self._told(estimate[:, n:], None if rest is None else rest[k])
            free = self.see @ seen + self.pending @ (U[:, before] - V[:, before]) + told  # of the deviation, (T, q, P)
            moved = -self.choice @ free  # the unquantised choice less the ideal input
            last = U[:, (k + D - 1) * m : (k + D) * m]
            if steer is not None:
                ideal[k] = steer(k, moved, ideal[k], last)
            wanted = ideal[k] + moved
            u = self._chosen(wanted, last) if linear is None else wanted + linear[k]
            U[:, (k + D) * m : (k + D + 1) * m], V[:, (k + D) * m : (k + D + 1) * m] = u, ideal[k]
            x = self.phi @ x + self.true_step @ (U[:, now] - offset) - self.known_step @ (V[:, now] - offset)
            x = x + jolt @ extra[k]
            if self.kalman is not None:
                estimate = self.expect @ estimate
                estimate[:, :n] += self.known_step @ (U[:, now] - V[:, now])
        self.states, self.U = states, U
        return self._between(states, U, V, offset, load), ideal

    def _corrected(self, estimate, y, first):
        """The estimate once y is known, (T, n + loads, P); how far the gate would have been tried is kept."""
        if first:
            estimate[:, : self.n] = self.kalman.start_row @ y
            return estimate
        missed = y - self.C @ estimate[:, : self.n]
        if self.kalman.gate is not None:
            tried = np.einsum("tip,ij,tjp->tp", missed, self.kalman.gate, missed)
            self.gated = max(self.gated, float(tried.max()))
        return estimate + self.kalman.gain @ missed

    def _told(self, loads, rest):
        """What the law expects of estimated loads, (T, q, P)."""
        told = self.push[:, self.loaded] @ loads
        if self.tail != "rest":
            return told
        shift = self.tail_of_load @ loads
        if rest is not None:
            low, high = (np.array([f(v) for v in self.levels])[:, None] for f in (np.min, np.max))
            shift = np.clip(rest + shift, low, high) - np.clip(rest, low, high)
        return told + (self.total - self.h) @ shift

    def _chosen(self, wanted, last):
        """The command next to what is wanted, (T, m, P), switching from the last one at its price."""
        T, m, P = wanted.shape
        distance = self.h @ (self.commands.T[None, :, :, None] - wanted[:, :, None, :]).reshape(T, m, -1)
        cost = 0.5 * np.square(distance).sum(axis=1).reshape(T, len(self.commands), P)
        if self.price.any():
            cost = cost + (self.price[:, None, None] * (self.commands.T[None, :, :, None] != last[:, :, None])).sum(1)
        return np.moveaxis(self.commands[cost.argmin(axis=1)], 2, 1)

    def _between(self, states, U, V, offset, load):
        """Deviation of y at all instants, (K, T, instants, q, P)."""
        K, T, n, P = states.shape
        m, D = self.m, self.line
        window = lambda Z: np.moveaxis(  # noqa: E731
            np.lib.stride_tricks.sliding_window_view(Z, (D + 1) * m, axis=1)[:, ::m], -1, 2
        )
        view = self.C @ self.flow
        rows = lambda M: (self.C @ M).reshape(len(M), 1, -1, (D + 1) * m)  # noqa: E731
        y = view.reshape(-1, n) @ states.swapaxes(0, 1)
        y = y + rows(self.true) @ (window(U) - offset) - rows(self.known) @ (window(V) - offset)
        if load is not None:
            y = y + (self.C @ self.load).reshape(len(self.load), 1, -1, m) @ np.moveaxis(load, 0, 1)
        return np.moveaxis(y.reshape(T, K, len(self.instants), self.q, P), 0, 1)

    def impulses(self, length):
        """Response of y, (length, instants, q), to a unit of each input's error, of noise and of load, no model errors."""
        own = Rival.__new__(Rival)
        own.__dict__.update(self.__dict__)
        own.true, own.true_step, own.load = self.known, self.known_step, self.load[:1] / (1.0 + self.truths[0, 1])
        found = []
        for kind, count in (("linear", self.m), ("noise", self.measured), ("load", self.m)):
            lanes = max(1, count)
            pushes = {name: np.zeros((length, 1, size, lanes)) for name, size in
                      (("linear", self.m), ("noise", self.measured), ("load", self.m))}  # fmt: skip
            pushes[kind][1, 0, np.arange(count), np.arange(count)] = 1.0
            y = own.run(np.zeros((length, 1, self.m, lanes)), **pushes)[0]
            found.append(y[1:, 0])
        return found
