"""An adversary that drives a closed loop as far from its ideal response as he can.

A reference acts on the law only through one vector in each period, so the adversary chooses the ideal inputs themselves,
any within the certified range. He also chooses noise, load, true dead times and gains, and looks at y between instants.
"""

from itertools import product

import numpy as np

from oracles.certificate import Rival

TINY = 1e-7  # share of a gap by which an aim lies on one side of it


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


def truths_of(rng, controller, late, more, count):
    """Errors of dead times and gains, (count, 2, m), at the corners of what they may be and within; one without errors."""
    m = controller.plant.inputs
    if not late.any() and not more.any():
        return np.zeros((1, 2, m))
    corners = rng.choice([-1.0, 1.0], (count, 2, m)) * np.array([late, more])
    corners[: min(4, count)] = np.array([[s * late, t * more] for s, t in product((-1, 1), (-1, 1))])[:count]
    corners[count // 2 :] *= rng.uniform(0, 1, (count - count // 2, 2, m))  # the worst need not be an end
    corners[:, 0] = np.maximum(corners[:, 0], -controller.plant.input_delay)
    return corners


def response(rival):
    """`Rival.impulses`, as long as the response to one error lasts."""
    length = 16
    while True:
        H = rival.impulses(length)
        if (
            length >= 512
            or np.abs(H[0][-1]).max() > 1e3 * np.abs(H[0][:8]).max()
            or np.abs(H[0][-length // 4 :]).sum(axis=0).max() < 1e-3 * np.abs(H[0]).sum(axis=0).max()
        ):
            return H
        length *= 2


def pushes(rng, sizes, way, choose):
    """Bounded sequences, (K, T, size, P): along the way in steered lanes, else of several kinds."""
    (T, P), K, count = choose.shape, len(way), len(sizes)
    flip = np.sign(rng.uniform(-1, 1, (K, T, count, P)))
    slow = np.sign(np.sin(np.arange(K)[:, None, None, None] / np.exp(rng.uniform(0, 5, (T, count, P)))))
    value = np.where(rng.uniform(size=(T, count, P)) < 0.5, flip, slow)
    value = np.where(choose[None, :, None], np.sign(way), value)
    return value * sizes[:, None]


def ways_to_goals(rng, H, K, shape, q, outputs):
    """What each lane of a shape (T, P) is after, an output, an instant, a sign: its way for each error, (K, T, size, P)."""
    total = np.abs(H[0]).sum(axis=0)  # (instants, q, m)
    goal = np.stack([rng.integers(q, size=shape) if outputs is None else rng.choice(outputs, shape),
                     np.zeros(shape, int)])  # fmt: skip
    for t, p in np.ndindex(*shape):
        peak = total[:, goal[0, t, p]].sum(axis=1)
        goal[1, t, p] = rng.choice(len(peak)) if rng.uniform() < 0.3 else int(peak.argmax())
    sign = rng.choice([-1.0, 1.0], shape)
    back = (K - 1 - np.arange(K)) % min(K, len(H[0]))
    ways = [sign[None, :, None] * np.moveaxis(h[back][:, goal[1], goal[0]], 3, 2) for h in H]
    return [w * np.where(np.abs(h).max() > 0, 1.0, 0.0) for w, h in zip(ways, H, strict=True)]


def mutate(rng, best, lanes, fresh, v, w, start):
    """Put mutants of the best into lanes of the ideal inputs, noise, load and start."""
    K, T = fresh.shape[:2]
    for t, p in product(range(T), lanes):
        i = rng.integers(len(best[0]))
        a, b = np.sort(rng.integers(0, K + 1, 2))
        part = slice(a, b)
        u, nv, nw, start[:, t, :, p] = (z[i].copy() for z in best)
        if rng.uniform() < 0.5:
            u[part] = fresh[part, t, :, p]
        else:
            u = np.roll(u, rng.integers(-3, 4), axis=0)
        if rng.uniform() < 0.5:
            nv[part], nw[part] = v[part, t, :, p], w[part, t, :, p]
        fresh[:, t, :, p], v[:, t, :, p], w[:, t, :, p] = u, nv, nw


def attack(controller, low, high, *, noise=0.0, delay_error=0.0, gain_error=0.0, load=0.0, seed=0, periods=None, lanes=64,
           rounds=3, truths=8, outputs=None, given=None):  # fmt: skip
    """Largest deviation of each output that was found, (q,); None if no ideal input fits the range.

    Within [low, high], (m,), with everything else at most so large.
    """
    rng = np.random.default_rng(seed)
    m = controller.plant.inputs
    late, more, loads = (np.broadcast_to(np.asarray(v, float), (m,)) for v in (delay_error, gain_error, load))
    rival = Rival(controller, truths_of(rng, controller, late, more, truths) if given is None else np.asarray(given))
    T, q = len(rival.truths), rival.q
    P = max(1, lanes // T)
    noise = np.broadcast_to(np.asarray(noise, float), (rival.measured,))
    gap = np.array([np.diff(v).max() for v in rival.levels])
    H = response(rival)
    K = periods or int(np.clip(3 * (len(H[0]) + 1), 64, 400))  # the response leaves out the instant of the error
    aims = Aims(rival, low, high, rng)
    worst, best = np.zeros(q), None
    for turn in range(rounds):
        start = np.broadcast_to(rival.commands[rng.integers(len(rival.commands), size=(T, P))], (rival.line, T, P, m))
        start = np.moveaxis(start, 3, 2).copy()
        fresh = waves(rng, K, T * P, low, high, gap).reshape(K, m, T, P).swapaxes(1, 2)
        if (fresh := within(rival, fresh, low, high)) is None:
            return None
        steered = rng.uniform(size=P) < (0.5 if P > 1 else turn % 2)
        ways = ways_to_goals(rng, H, K, (T, P), q, outputs)
        choose = np.broadcast_to(steered, (T, P))
        v, w = pushes(rng, noise, ways[1], choose), pushes(rng, loads, ways[2], choose)
        steer = aims.policy(ways[0], steered) if steered.any() else None
        if best is not None:
            mutate(rng, best, np.flatnonzero(~steered), fresh, v, w, start)
        rest = None
        if rival.kalman is not None and rival.loads:
            at = rng.choice([-0.2, 0.0, 0.3, 0.5, 0.9, 1.0, 1.2], (T, m, P))[None]
            rest = low[:, None] + (high - low)[:, None] * at + np.zeros((K, T, m, P))
        y, ideal = rival.run(fresh, v, w if loads.any() else None, start=start, steer=steer, rest=rest)
        inside = (ideal >= low[:, None] - 1e-6 * gap[:, None]) & (ideal <= high[:, None] + 1e-6 * gap[:, None])
        assert inside.all()
        size = np.abs(y).max(axis=(0, 2))  # (T, q, P)
        worst = np.maximum(worst, size.max(axis=(0, 2)))
        score = np.moveaxis(size / np.maximum(worst[:, None], 1e-300), 1, 2).max(axis=2).ravel()
        order = np.argsort(-score)[:8]
        best = [np.moveaxis(z, 2, -1).reshape(len(z), T * P, -1).swapaxes(0, 1)[order] for z in (ideal, v, w, start)]
    return worst
