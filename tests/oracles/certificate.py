"""The closed loop around its ideal response, and an adversary that drives it as far from there as he can.

An independent transcription: state and commands under way are carried as they are, from one instant to the next, by
matrix exponentials of its own. Of the library only a controller's plain data and its estimator's gain are read.

A reference acts on the law only through one vector in each period, so the adversary chooses the ideal inputs themselves,
any within the certified range. He also chooses noise, load, true dead times and gains, and looks at y between instants.
"""

from itertools import product
from math import ceil, comb

import numpy as np
from scipy.linalg import expm

GRID = 12  # instants per period at which y is looked at, beside those at which a command begins to act
TINY = 1e-7  # share of a gap by which an aim lies on one side of it


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
        gated = 0.0
        for k in range(K):
            states[k] = x
            now, before = slice(k * m, (k + D + 1) * m), slice(k * m, (k + D) * m)
            error = 0.0 if noise is None else noise[k]
            if self.kalman is None:
                seen, told = x + error, 0.0
            else:
                y = self.C @ x + error
                if k == 0:
                    estimate[:, :n] = self.kalman.start_row @ y
                else:
                    missed = y - self.C @ estimate[:, :n]
                    if self.kalman.gate is not None:
                        gated = max(gated, float(np.einsum("tip,ij,tjp->tp", missed, self.kalman.gate, missed).max()))
                    estimate = estimate + self.kalman.gain @ missed
                seen, told = estimate[:, :n], 0.0
                if self.loads:
                    loads = estimate[:, n:]
                    told = self.push[:, self.loaded] @ loads
                    if self.tail == "rest":
                        shift = self.tail_of_load @ loads
                        if rest is not None:
                            low, high = (np.array([f(v) for v in self.levels])[:, None] for f in (np.min, np.max))
                            shift = np.clip(rest[k] + shift, low, high) - np.clip(rest[k], low, high)
                        told = told + (self.total - self.h) @ shift
            free = self.see @ seen + self.pending @ (U[:, before] - V[:, before]) + told  # of the deviation, (T, q, P)
            moved = -self.choice @ free  # the unquantised choice less the ideal input
            last = U[:, (k + D - 1) * m : (k + D) * m]
            if steer is not None:
                ideal[k] = steer(k, moved, ideal[k], last)
            wanted = ideal[k] + moved
            if linear is not None:
                u = wanted + linear[k]
            else:
                distance = self.h @ (self.commands.T[None, :, :, None] - wanted[:, :, None, :]).reshape(T, m, -1)
                cost = 0.5 * np.square(distance).sum(axis=1).reshape(T, len(self.commands), P)
                if self.price.any():
                    cost = cost + (
                        self.price[:, None, None] * (self.commands.T[None, :, :, None] != last[:, :, None])
                    ).sum(1)
                u = np.moveaxis(self.commands[cost.argmin(axis=1)], 2, 1)
            U[:, (k + D) * m : (k + D + 1) * m], V[:, (k + D) * m : (k + D + 1) * m] = u, ideal[k]
            x = self.phi @ x + self.true_step @ (U[:, now] - offset) - self.known_step @ (V[:, now] - offset)
            x = x + jolt @ extra[k]
            if self.kalman is not None:
                estimate = self.expect @ estimate
                estimate[:, :n] += self.known_step @ (U[:, now] - V[:, now])
        self.gated, self.states, self.U = gated, states, U
        window = lambda Z: np.moveaxis(  # noqa: E731
            np.lib.stride_tricks.sliding_window_view(Z, (D + 1) * m, axis=1)[:, ::m], -1, 2
        )
        view = self.C @ self.flow
        rows = lambda M: (self.C @ M).reshape(len(M), 1, -1, (D + 1) * m)  # noqa: E731
        y = view.reshape(-1, n) @ states.swapaxes(0, 1)
        y = y + rows(self.true) @ (window(U) - offset) - rows(self.known) @ (window(V) - offset)
        if load is not None:
            y = y + (self.C @ self.load).reshape(len(self.load), 1, -1, m) @ np.moveaxis(extra, 0, 1)
        return np.moveaxis(y.reshape(T, K, len(self.instants), self.q, P), 0, 1), ideal

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


# The adversary --------------------------------------------------------------------------------------------------------


class Aims:
    """Ideal inputs that make each quantiser's error push y the same way, at the last instant of every stretch.

    An aim is an unquantised input whose error is large: the middles between levels, and the best of many drawn.
    """

    def __init__(self, rival, low, high, rng, draws=3000, directions=40):
        self.rival, self.low, self.high = rival, low, high
        c, m = rival.commands, rival.m
        if m == 1:
            levels = np.sort(c[:, 0])
            scale = float(np.square(rival.h).sum())
            middles, gaps = 0.5 * (levels[1:] + levels[:-1]), np.diff(levels)
            hold = float(rival.price[0]) / scale / gaps  # a price on switching moves the middle
            at = np.concatenate([middles + sign * shift + side * TINY * gaps
                                 for shift in (0.0 * hold, hold) for sign in (-1, 1) for side in (-1, 1)])  # fmt: skip
            ends = np.array([levels[0] - 0.5 * gaps[0], levels[0], levels[-1], levels[-1] + 0.5 * gaps[-1]])
            self.places = np.concatenate([at, ends])[:, None]
        else:
            span = np.ptp(c, axis=0)
            places = c.min(axis=0) + span * rng.uniform(-0.4, 1.4, (draws, m)) @ rival.visible.T
            for _ in range(6):
                error = self._errors(places)
                ways = rng.normal(size=(directions, m))
                best = np.unique(np.argmax(ways @ (rival.h.T @ rival.h) @ error.T, axis=1))
                near = np.repeat(places[best], 20, axis=0)
                span = 0.5 * span
                moved = near + span * rng.uniform(-0.3, 0.3, near.shape) @ rival.visible.T
                places = np.concatenate([places[best], moved])
            size = np.linalg.norm(rival.h @ self._errors(places).T, axis=0)
            self.places = places[np.argsort(-size)[:directions]]

    def _errors(self, places):
        p, c = places @ self.rival.h.T, self.rival.commands @ self.rival.h.T
        return self.rival.commands[np.square(p[:, None] - c).sum(axis=2).argmin(axis=1)] - places

    def policy(self, ways, who):
        """A function for `run`: ways (K, T, m, P) to push, for the lanes `who` (P,)."""
        rival, places, who = self.rival, self.places, np.flatnonzero(who)
        commands = rival.commands
        apart = np.square((places[:, None] - commands) @ rival.h.T).sum(axis=2) / 2  # (places, commands)
        slack = 1e-12 * (self.high - self.low)
        low, high = (self.low - slack)[None, None, :, None], (self.high + slack)[None, None, :, None]

        def steer(k, moved, ideal, last):
            moved, last = moved[:, :, who], last[:, :, who]
            cost = apart[None, :, :, None]
            if rival.price.any():
                cost = cost + (rival.price[:, None, None] * (commands.T[None, :, :, None] != last[:, :, None]))\
                    .sum(axis=1)[:, None]  # fmt: skip
            won = np.broadcast_to(cost.argmin(axis=2), (moved.shape[0], len(places), moved.shape[2]))
            error = np.moveaxis(commands[won], 3, 2) - places[None, :, :, None]  # (T, places, m, P)
            needed = places[None, :, :, None] - moved[:, None]
            gain = (error * ways[k][:, None, :, who]).sum(axis=2)
            fits = ((needed >= low) & (needed <= high)).all(axis=2)
            gain = np.where(fits, gain, -np.inf)
            best = gain.argmax(axis=1)
            found = np.take_along_axis(needed, best[:, None, None, :], axis=1)[:, 0]
            possible = np.take_along_axis(fits, best[:, None], axis=1)
            ideal = ideal.copy()
            ideal[:, :, who] = np.where(possible, found, ideal[:, :, who])
            return ideal

        return steer


def waves(rng, K, lanes, low, high, gap):
    """Ideal inputs of every kind within a range, (K, m, lanes)."""
    m, k = len(low), np.arange(K)[:, None]
    result = np.zeros((K, m, lanes))
    for lane in range(lanes):
        kind, period = rng.integers(9), np.exp(rng.uniform(np.log(2.0), np.log(K), m))
        phase = rng.uniform(0.0, 1.0, m)
        turn = k / period + phase
        if kind == 0:
            share = np.broadcast_to(rng.choice([0.0, 1.0, 0.5, 1 / 3, 0.25, 2 / 3, 0.2, 1e-3, 0.999], m), (K, m))
        elif kind == 1:
            share = (turn % 1.0 < rng.choice([0.5, 0.1, 0.9], m)).astype(float)  # square waves
        elif kind == 2:
            share = 0.5 + 0.5 * np.sin(2 * np.pi * turn)
        elif kind == 3:
            share = 0.5 + 0.5 * np.sin(2 * np.pi * np.cumsum(np.linspace(0.5, 1e-3, K))[:, None] + 6 * phase)  # a sweep
        elif kind == 4:
            share = np.abs((turn % 1.0) * 2 - 1)  # slow ramps
        elif kind == 5:
            share = np.repeat(rng.integers(0, 2, (K, m)), rng.integers(1, 20), axis=0)[:K].astype(float)
        elif kind == 6:
            share = rng.uniform(0, 1, (K, m))
        elif kind == 7:
            share = np.repeat(rng.uniform(0, 1, (K, m)), rng.integers(1, 40), axis=0)[:K]
        else:  # about the middle between two levels
            centre = 0.5 + (rng.integers(-3, 4, m) + 0.5 * rng.integers(0, 2, m)) * gap / np.maximum(high - low, 1e-300)
            share = centre + 0.1 * np.sin(2 * np.pi * turn) * gap / np.maximum(high - low, 1e-300)
        result[:, :, lane] = low + (high - low) * np.clip(share, 0.0, 1.0)
    return result


def within(rival, ideal, low, high):
    """The nearest inputs that the ideal law can choose within a range, or None; (..., m, P)."""
    if np.allclose(rival.visible, np.eye(rival.m), atol=1e-9):
        return ideal
    low, high = low[:, None], high[:, None]
    for _ in range(60):
        ideal = np.clip(rival.visible @ ideal, low, high)
    ideal = rival.visible @ ideal
    slack = 1e-6 * (high - low)
    return ideal if ((ideal >= low - slack) & (ideal <= high + slack)).all() else None


def attack(controller, low, high, *, noise=0.0, delay_error=0.0, gain_error=0.0, load=0.0, seed=0, periods=None, lanes=64,
           rounds=3, truths=8, outputs=None, given=None):  # fmt: skip
    """Largest deviation of each output that was found, (q,); None if no ideal input fits the range.

    Within [low, high], (m,), with everything else at most so large.
    """
    rng = np.random.default_rng(seed)
    m = controller.plant.inputs
    late, more, loads = (np.broadcast_to(np.asarray(v, float), (m,)) for v in (delay_error, gain_error, load))
    corners = np.zeros((1, 2, m)) if given is None else np.asarray(given)
    if given is None and (late.any() or more.any()):
        corners = rng.choice([-1.0, 1.0], (truths, 2, m)) * np.array([late, more])
        corners[: min(4, truths)] = np.array([[s * late, t * more] for s, t in product((-1, 1), (-1, 1))])[:truths]
        corners[truths // 2 :] *= rng.uniform(0, 1, (truths - truths // 2, 2, m))  # the worst need not be an end
        corners[:, 0] = np.maximum(corners[:, 0], -controller.plant.input_delay)
    rival = Rival(controller, corners)
    T, q = len(corners), rival.q
    P = max(1, lanes // T)
    noise = np.broadcast_to(np.asarray(noise, float), (rival.measured,))
    gap = np.array([np.diff(v).max() for v in rival.levels])
    length = 16
    while True:  # until the response to one error is over
        H = rival.impulses(length)
        if (
            length >= 512
            or np.abs(H[0][-1]).max() > 1e3 * np.abs(H[0][:8]).max()
            or np.abs(H[0][-length // 4 :]).sum(axis=0).max() < 1e-3 * np.abs(H[0]).sum(axis=0).max()
        ):
            break
        length *= 2
    K = periods or int(np.clip(3 * length, 64, 400))
    aims = Aims(rival, low, high, rng)

    def pushes(sizes, response, choose):
        """Bounded sequences, (K, T, size, P): against the response in steered lanes, else of several kinds."""
        count = len(sizes)
        flip = np.sign(rng.uniform(-1, 1, (K, T, count, P)))
        slow = np.sign(np.sin(np.arange(K)[:, None, None, None] / np.exp(rng.uniform(0, 5, (T, count, P)))))
        value = np.where(rng.uniform(size=(T, count, P)) < 0.5, flip, slow)
        value = np.where(choose[None, :, None], np.sign(response), value)
        return value * sizes[:, None]

    total = np.abs(H[0]).sum(axis=0)  # (instants, q, m)
    worst, best = np.zeros(q), None
    for turn in range(rounds):
        start = np.broadcast_to(rival.commands[rng.integers(len(rival.commands), size=(T, P))], (rival.line, T, P, m))
        start = np.moveaxis(start, 3, 2).copy()
        fresh = waves(rng, K, T * P, low, high, gap).reshape(K, m, T, P).swapaxes(1, 2)
        if (fresh := within(rival, fresh, low, high)) is None:
            return None
        steered = rng.uniform(size=P) < (0.5 if P > 1 else turn % 2)
        # what each lane is after: an output, an instant, a sign, and stretches' ends
        goal = np.stack([rng.integers(q, size=(T, P)) if outputs is None else rng.choice(outputs, (T, P)),
                         np.zeros((T, P), int)])  # fmt: skip
        for t, p in np.ndindex(T, P):
            peak = total[:, goal[0, t, p]].sum(axis=1)
            goal[1, t, p] = rng.choice(len(peak)) if rng.uniform() < 0.3 else int(peak.argmax())
        sign = rng.choice([-1.0, 1.0], (T, P))
        back = (K - 1 - np.arange(K)) % min(K, len(H[0]))
        ways = [sign[None, :, None] * np.moveaxis(h[back][:, goal[1], goal[0]], 3, 2) for h in H]  # (K, T, size, P)
        ways = [w * np.where(np.abs(h).max() > 0, 1.0, 0.0) for w, h in zip(ways, H, strict=True)]
        choose = np.broadcast_to(steered, (T, P))
        v, w = pushes(noise, ways[1], choose), pushes(loads, ways[2], choose)
        steer = aims.policy(ways[0], steered) if steered.any() else None
        if best is not None:  # mutate the best of before
            heirs = np.flatnonzero(~steered)
            for t, p in product(range(T), heirs):
                i = rng.integers(len(best[0]))
                a, b = np.sort(rng.integers(0, K + 1, 2))
                part = slice(a, b)
                u, nv, nw, start[:, t, :, p] = (z[i].copy() for z in best[1])
                if rng.uniform() < 0.5:
                    u[part] = fresh[part, t, :, p]
                else:
                    u = np.roll(u, rng.integers(-3, 4), axis=0)
                if rng.uniform() < 0.5:
                    nv[part], nw[part] = v[part, t, :, p], w[part, t, :, p]
                fresh[:, t, :, p], v[:, t, :, p], w[:, t, :, p] = u, nv, nw
        if rival.kalman is not None and rival.loads:
            at = rng.choice([-0.2, 0.0, 0.3, 0.5, 0.9, 1.0, 1.2], (T, m, P))[None]
            rest = low[:, None] + (high - low)[:, None] * at + np.zeros((K, T, m, P))
        else:
            rest = None
        y, ideal = rival.run(fresh, v, w if loads.any() else None, start=start, steer=steer, rest=rest)
        inside = (ideal >= low[:, None] - 1e-6 * gap[:, None]) & (ideal <= high[:, None] + 1e-6 * gap[:, None])
        assert inside.all()
        size = np.abs(y).max(axis=(0, 2))  # (T, q, P)
        worst = np.maximum(worst, size.max(axis=(0, 2)))
        score = np.moveaxis(size / np.maximum(worst[:, None], 1e-300), 1, 2).max(axis=2).ravel()
        order = np.argsort(-score)[:8]
        best = (
            score[order],
            [np.moveaxis(z, 2, -1).reshape(len(z), T * P, -1).swapaxes(0, 1)[order] for z in (ideal, v, w, start)],
        )
    return worst
