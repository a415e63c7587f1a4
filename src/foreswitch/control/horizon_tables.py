"""Design of the exact long horizon: the constant tables that core/horizon.c searches with.

With z the state at t_k + theta_k, ``z[k+1] = F z[k] + G u[k] + drift``. One dead time for all inputs leaves the plant's
own n states. Inputs that act earlier than the slowest bring along the moves between their own instant and the
evaluation: z then holds those too, and the first ``lead`` steps weigh nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag, expm, solve_discrete_are

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import period_model, transition

__all__ = ["HorizonModel", "HorizonTables", "horizon_model", "horizon_tables", "riccati_terminal"]


@dataclass(frozen=True)
class HorizonModel:
    """The dead time removed: z at the first step, and its recursion.

    Attributes
    ----------
    F, G : ndarray, shape (N, N) and (N, m)
    drift, disturbance : ndarray, shape (N,) and (N, p)
        What the operating point, and a constant w, add per step.
    state, start_disturbance, start : ndarray, shape (N, n), (N, p) and (N,)
        z at the end of the first step from x(t_k), w and the operating point, moves left out.
    pending : list of ndarray, shape (delay in periods, N)
        What each command under way adds to that, per unit and input, newest first.
    lead : int
        Steps before the first evaluation.
    waiting : list of int
        Moves of each input that z holds.
    """

    F: Array
    G: Array
    drift: Array
    disturbance: Array
    state: Array
    start_disturbance: Array
    start: Array
    pending: Sequence[Array]
    lead: int
    waiting: list[int]


def horizon_model(plant: Plant, Ts: float) -> HorizonModel:
    """The recursion that the moves drive, and where it starts."""
    n, m, tau = plant.states, plant.inputs, plant.input_delay
    lead = check.periods(float(tau.max() - tau.min()), Ts)
    begin = float(tau.max()) - lead * Ts  # of the first step, after t_k; may lie up to a period before it
    own = np.maximum(tau - begin, 0.0)
    model = period_model(plant.replace(input_delay=own), Ts)
    size = n + sum(model.delay)
    F, G = np.zeros((size, size)), np.zeros((size, m))
    F[:n, :n] = model.transition
    places, at = [], n
    for j, delay in enumerate(model.delay):
        if delay == 0:
            G[:n, j] = model.old[j]
        else:
            # z holds the input's last moves, newest first; the oldest acts until the dead time's fraction is over
            F[:n, at + delay - 1] = model.old[j]
            if delay == 1:
                G[:n, j] += model.new[j]
            else:
                F[:n, at + delay - 2] += model.new[j]
            G[at, j] = 1.0
            F[np.arange(at + 1, at + delay), np.arange(at, at + delay - 1)] = 1.0
        places.append(at)
        at += delay

    end = begin + Ts  # of the first step
    pending = []
    for j in range(m):
        depth = check.periods(float(tau[j]), Ts)
        rows = np.zeros((depth, size))
        for i in range(1, depth + 1):  # issued i periods ago: acts over [tau - i Ts, tau - (i - 1) Ts] from t_k
            start, stop = max(tau[j] - i * Ts, 0.0), min(tau[j] - (i - 1) * Ts, end)
            if stop > start:
                effect = transition(plant.A, plant.B[:, j : j + 1], stop - start)[1][:, 0]
                rows[i - 1, :n] = expm(plant.A * (end - stop)) @ effect
            if i < model.delay[j]:  # still to act after the first step
                rows[i - 1, places[j] + i] = 1.0
        pending.append(rows)
    whole, steps = transition(plant.A, np.column_stack([plant.E, plant.B @ plant.u_offset]), end)

    def padded(rows: Array) -> Array:
        return np.concatenate([rows, np.zeros((size - n, *rows.shape[1:]))])

    return HorizonModel(
        F, G, padded(model.drift), padded(model.disturbance), padded(whole), padded(steps[:, :-1]), padded(-steps[:, -1]),
        pending, lead, model.delay,
    )  # fmt: skip


#: A pivot below this share of the Hessian's largest entry is zero: that move is not bounded by its own square. What is
#: left out costs up to its root, relatively, if the optimum lies far outside the levels.
ZERO_PIVOT = 1e-13
#: Weight of the pivots' product against the lift's own gain, in typical pivots.
CENTRING = 0.3
#: Comparing nodes pays from this many sequences on, as powers of ten: with few candidates a node costs less than to
#: compare it.
FEW, MANY_OF_FEW, MANY = 3, 12, 9
#: Nodes per move before prices are tried, and costs above the largest that rounding leaves at which they are at once.
PATIENCE, FAR = 50, 40
#: Keeps a decaying state out of the denormal numbers, which are slow.
FLOOR = 1e-25


@dataclass(frozen=True)
class HorizonTables:
    """The tables of core/horizon.h in double, by the names there, and its scalars."""

    arrays: dict[str, Array | None]
    exclusive: bool
    dominance: bool
    patience: int
    far: float


def horizon_tables(
    F: Array,
    G: Array,
    S: Array,
    root_weight: Array,
    moves: int,
    values: Array,
    level: np.ndarray[Any, np.dtype[np.uint8]],
    move_weight: Array,
    *,
    hold: bool,
    switch_cost: Array,
    terminal: Array,
) -> HorizonTables:
    """The recursions that do not depend on measurement or reference; derivations stand in core/horizon.h.

    Parameters
    ----------
    F, G, S : ndarray, shape (N, N), (N, m) and (q, N)
    root_weight : ndarray, shape (steps, q)
        Roots of the outputs' weights, zero outside the window.
    moves : int
    values, level : ndarray, shape (p, m)
        Candidates, as values and as level indices.
    move_weight, switch_cost : ndarray, shape (m,)
    hold : bool
        Whether the tail keeps the last move.
    terminal : ndarray, shape (rows, N)
        Root of the terminal cost.
    """
    n, m = G.shape
    lowest, highest = values.min(axis=0), values.max(axis=0)
    # a switch costs at least (move / width)^2 of its price, exactly that with two levels: that part tightens the bound
    width = highest - lowest
    share = np.divide(switch_cost, width**2, out=np.zeros(m), where=width > 0)
    weight = move_weight + share
    step = values[:, None] - values[None]
    change: Array = ((level[:, None] != level[None]) * switch_cost - share * step**2).sum(axis=2)
    change[np.abs(change) <= 1e-12 * switch_cost.sum()] = 0.0
    two = np.array([np.unique(values[:, j]).size == 2 for j in range(m)])
    H = _hessian(F, G, S, root_weight, moves, hold, weight, terminal)
    lift = _lift(H, np.tile(two, moves)).reshape(moves, m)

    # Riccati recursion in y = (x, previous move)
    A, B = block_diag(F, np.zeros((m, m))), np.vstack([G, np.eye(m)])
    after = A.copy()
    if hold:
        after[:n, n:], after[n:, n:] = G, np.eye(m)
    P = np.zeros((n + m, n + m))
    P[:n, :n] = terminal.T @ terminal
    for k in reversed(range(moves, len(root_weight))):
        P = after.T @ _weighed(P, S, root_weight[k]) @ after
    last_value = P
    gain, pull, place, far = _riccati(
        A, B, P, S, root_weight[:moves], values, weight, lift, ZERO_PIVOT * np.abs(H).max()
    )
    metric = _metric(gain, A)
    arrays = {
        "F": F, "G": G, "S": S, "root_weight": root_weight, "T": terminal, "move_weight": weight, "lift": lift,
        "lift_centre": lift * (lowest + highest) / 2.0, "last_value": last_value,
        "hull": np.column_stack([lowest, highest]), "value": values, "effect": values @ G.T + FLOOR,
        "gain": gain[:, :, :n], "gain_previous": gain[:, :, n:], "pull": pull, "place": place,
        "from_place": np.einsum("kij,cj->kci", gain[:, :, n:], values), "metric": metric[:, :, :n],
        "from_metric": np.einsum("kij,cj->kci", metric[:, :, n:], values),
        "switch_cost": change if change.any() else None,
    }  # fmt: skip
    dominance = moves * np.log10(len(values)) >= (MANY_OF_FEW if len(values) <= FEW else MANY)
    limit = FAR * m * far + moves * float(change.max(initial=0.0))
    return HorizonTables(arrays, bool(change.any()), bool(dominance), PATIENCE * moves, limit)


def _riccati(
    A: Array,
    B: Array,
    P: Array,
    S: Array,
    root_weight: Array,
    values: Array,
    weight: Array,
    lift: Array,
    zero: float,
) -> tuple[Array, Array, Array, float]:
    """Backwards over the moves: L K, L^-T, L u for each candidate, and the cost that rounding to a level leaves.

    Parameters
    ----------
    A, B : ndarray, shape (N + m, N + m) and (N + m, m)
        In y = (x, previous move).
    P : ndarray, shape (N + m, N + m)
        Cost after the last move.
    S, root_weight, values, weight, lift
        As in `horizon_tables`; the roots of the moves alone.
    zero : float
        Pivots up to this are none.
    """
    (moves, m), n = lift.shape, S.shape[1]
    gaps = np.array([np.diff(np.unique(values[:, j])).max(initial=0.0) for j in range(m)])
    gain, pull = np.zeros((moves, m, n + m)), np.zeros((moves, m, m))
    place, far = np.zeros((moves, len(values), m)), 0.0
    for k in reversed(range(moves)):
        P = _weighed(P, S, root_weight[k])
        pivot = B.T @ P @ B + np.diag(weight - lift[k])
        cross = B.T @ P @ A
        cross[:, n:] -= np.diag(weight)
        w, V = np.linalg.eigh(pivot)
        w, V = w[::-1], V[:, ::-1]
        sound = w > zero
        root = np.sqrt(np.where(sound, w, 1.0))
        L = np.where(sound, root, 0.0)[:, None] * V.T
        pull[k] = np.where(sound, 1.0 / root, 0.0)[:, None] * V.T
        gain[k] = -pull[k] @ cross
        place[k] = values @ L.T
        far += float(np.diag(pivot) @ gaps**2) / 4.0
        K = pull[k].T @ gain[k]
        closed, move = A + B @ K, K - np.hstack([np.zeros((m, n)), np.eye(m)])
        # Joseph's form: the plain one loses all digits on unstable plants
        P = closed.T @ P @ closed + move.T @ np.diag(weight) @ move - K.T @ np.diag(lift[k]) @ K
        P = (P + P.T) / 2.0
    return gain, pull, place, far


def _metric(gain: Array, A: Array) -> Array:
    """A root of what two nodes' distances in y may cost, for each depth."""
    moves, span = len(gain), len(A)
    metric, M = np.zeros((moves, span, span)), np.zeros((span, span))
    for k in reversed(range(moves)):
        M = gain[k].T @ gain[k] + A.T @ M @ A
        w, V = np.linalg.eigh(M)
        metric[k] = np.sqrt(np.maximum(w[::-1], 0.0))[:, None] * V[:, ::-1].T
    return metric


def _weighed(P: Array, S: Array, root_weight: Array) -> Array:
    """P with the cost of one evaluation added."""
    n, result = S.shape[1], P.copy()
    rows = root_weight[:, None] * S
    result[:n, :n] += rows.T @ rows
    return result


def _hessian(
    F: Array, G: Array, S: Array, root_weight: Array, moves: int, hold: bool, weight: Array, terminal: Array
) -> Array:
    """Hessian of J in all moves, stacked."""
    (n, m), steps = G.shape, len(root_weight)
    columns = np.zeros((moves, steps, n, m))  # effect of each move on each z
    for j in range(moves):
        x = np.zeros((n, m))
        for k in range(steps):
            acts = k == j or (hold and j == moves - 1 and k > j)
            x = F @ x + (G if acts else 0.0)
            columns[j, k] = x
    rows = np.einsum("ko,oi,jkia->koja", root_weight, S, columns).reshape(-1, moves * m)
    difference = np.kron(np.eye(moves) - np.eye(moves, k=-1), np.eye(m))
    end = np.einsum("ti,jia->tja", terminal, columns[:, -1]).reshape(-1, moves * m)
    H: Array = rows.T @ rows + end.T @ end + difference.T @ np.kron(np.eye(moves), np.diag(weight)) @ difference
    return H


def _lift(H: Array, two: np.ndarray[Any, np.dtype[np.bool_]]) -> Array:
    """Diagonal d >= 0 on the two-level moves that maximises ``sum d + mu log det(H - diag d)``, by damped Newton.

    The sum is what the lift may add to the bound; the determinant is the product of the pivots, which sets how fast
    nodes multiply.
    """
    i, d = np.flatnonzero(two), np.zeros(len(H))
    spectrum = np.linalg.eigvalsh(H)
    if not i.size or spectrum[0] <= 1e-9 * spectrum[-1]:
        return d
    mu = CENTRING * float(np.exp(np.log(spectrum).mean()))
    inside = 1e-4 * mu  # keeps d > 0
    d[i] = 1e-2 * spectrum[0]
    for _ in range(200):
        X = np.linalg.inv(H - np.diag(d))
        slope = 1.0 - mu * np.diag(X)[i] + inside / d[i]
        step = np.linalg.solve(mu * (X * X)[np.ix_(i, i)] + np.diag(inside / d[i] ** 2), slope)
        length = 1.0
        while True:
            trial = d.copy()
            trial[i] += length * step
            if (trial[i] > 0).all() and np.linalg.eigvalsh(H - np.diag(trial))[0] > 1e-9 * spectrum[-1]:
                break
            length *= 0.6
            if length < 1e-9:
                return d
        d = trial
        if slope @ step < 1e-8:
            break
    d[d < 1e-3 * d.max()] = 0.0
    return d


def riccati_terminal(F: Array, G: Array, S: Array, weight: Array, move_weight: Array) -> Array:
    """A root T of the cost beyond the horizon of the unconstrained law, (rows, N), in deviation from rest.

    The last evaluation is the horizon's own: what counts here starts one period after it. The moves' weight counts for
    the input's deviation too: without one the equation has no solution for plants whose outputs the input reaches at
    once.
    """
    P = solve_discrete_are(F, G, S.T @ (weight[:, None] * S), np.diag(move_weight))
    K = np.linalg.solve(np.diag(move_weight) + G.T @ P @ G, G.T @ P @ F)
    closed = F - G @ K
    beyond = closed.T @ P @ closed + K.T @ np.diag(move_weight) @ K
    if not np.allclose(beyond + S.T @ (weight[:, None] * S), P, rtol=1e-6, atol=1e-6 * np.abs(P).max()):
        raise np.linalg.LinAlgError("no digits are left")
    values, vectors = np.linalg.eigh(beyond)
    keep = values > 1e-12 * values.max(initial=1e-300)
    root: Array = np.sqrt(values[keep])[:, None] * vectors[:, keep].T
    return root
