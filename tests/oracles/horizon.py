"""The horizon objective, theory.md [7], by enumeration: the tests' own truth for the exact search.

Nothing comes from the library. The plant is carried from one input instant to the next by matrix exponentials, once with
all moves zero and once for a unit of each move; every allowed sequence is then costed by superposition, which `direct`
does without. Times are seconds after the present instant t_k.
"""

from dataclasses import dataclass, field
from itertools import pairwise, product
from math import ceil, comb, floor

import numpy as np
from scipy.linalg import expm


@dataclass
class Problem:
    """Per-input lists have m entries, per-output lists q. `P` weighs the deviation from rest at the end."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    E: np.ndarray
    delay: list
    u_offset: np.ndarray
    y_offset: np.ndarray
    levels: list
    Ts: float
    steps: int
    moves: int
    window: tuple
    weight: np.ndarray
    move_weight: np.ndarray
    switch_cost: np.ndarray
    tail: str
    lam: list | None = None
    r: list | None = None
    P: np.ndarray | None = None  # on (x, waiting moves): those of input j that act only after the end
    waiting: list = field(default_factory=list)
    min_on: list = field(default_factory=list)
    min_off: list = field(default_factory=list)
    forbidden: list = field(default_factory=list)

    @property
    def order(self):
        return max(self.r) if self.lam is not None else 1

    @property
    def candidates(self):
        return [c for c in product(*self.levels) if c not in self.forbidden]

    def periods(self, j, level):
        """Shortest run of input j at a level: off is 0, or the level nearest to it."""
        off = min(self.levels[j], key=abs)
        minimum = (self.min_off if level == off else self.min_on)[j]
        return max(1, ceil(minimum / self.Ts - 1e-9))


def rest(p, w, yd):
    """x and u that hold y at yd under w, [4a], unclipped."""
    n, q, m = len(p.A), len(p.C), p.B.shape[1]
    matrix = np.block([[p.A, p.B], [p.C, np.zeros((q, m))]])
    solution = np.linalg.lstsq(matrix, np.concatenate([-p.E @ w, yd - p.y_offset]), rcond=None)[0]
    return solution[:n], solution[n:] + p.u_offset


def tail_input(p, w, yd):
    """What the inputs do after the moves, where that is not the last move."""
    if p.tail != "rest":
        return np.zeros(len(p.delay))
    return np.array([np.clip(u, min(v), max(v)) for u, v in zip(rest(p, w, yd)[1], p.levels, strict=True)])


def evaluated(p, x, inputs, drive):
    """States (steps, n, columns) at max delay + i Ts from x (n, columns).

    ``inputs(j, period)`` are the columns of input j that were commanded `period` periods after t_k; `drive` (n, columns)
    is constant.
    """
    theta, instants = max(p.delay), {0.0}
    marks = [theta + i * p.Ts for i in range(1, p.steps + 1)]
    for tau in p.delay:
        first = -floor(tau / p.Ts) - 1
        instants |= {t for k in range(first, p.steps + ceil(theta / p.Ts) + 2) if 0 < (t := tau + k * p.Ts) < marks[-1]}
    times = np.array(sorted(instants | set(marks)))
    times = times[np.concatenate([[True], np.diff(times) > 1e-9 * p.Ts])]  # the same instant, reached twice
    n, result, known = len(p.A), [], {}
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = p.A, np.eye(n)
    for a, b in pairwise(times):
        length = round((b - a) / p.Ts, 11)
        if length not in known:
            full = expm(block * (length * p.Ts))
            known[length] = full[:n, :n], full[:n, n:]
        Phi, Psi = known[length]
        push = drive + sum(
            np.outer(p.B[:, j], inputs(j, floor(((a + b) / 2 - tau) / p.Ts))) for j, tau in enumerate(p.delay)
        )
        x = Phi @ x + Psi @ push
        if min(abs(b - mark) for mark in marks) < 1e-9 * p.Ts:
            result.append(x)
    assert len(result) == p.steps
    return np.array(result)


def sliding(p, x, w, reference):
    """s (steps, q, columns) of states (steps, n, columns); w and reference belong to column 0."""
    s = np.zeros((p.steps, len(p.C), x.shape[2]))
    for o in range(len(p.C)):
        for i in range(1 if p.lam is None else p.r[o]):
            factor = 1.0 if p.lam is None else comb(p.r[o] - 1, i) * p.lam[o] ** -i
            row = p.C[o] @ np.linalg.matrix_power(p.A, i)
            s[:, o] += factor * np.einsum("n,inc->ic", row, x)
            known = p.y_offset[o] if i == 0 else p.C[o] @ np.linalg.matrix_power(p.A, i - 1) @ p.E @ w
            s[:, o, 0] += factor * (known - reference[:, o, i])
    return s


def response(p, past, x, w, reference):
    """s (steps, q, 1 + moves m) and the end (states, 1 + moves m): column 0 with no moves, then a unit of each."""
    m = len(p.delay)
    size, held = 1 + p.moves * m, tail_input(p, w, reference[-1, :, 0])

    def inputs(j, period):
        column = np.zeros(size)
        if period < 0:
            column[0] = past[max(period, -len(past))][j]
        elif period < p.moves or p.tail == "hold":
            column[1 + min(period, p.moves - 1) * m + j] = 1.0
        else:
            column[0] = held[j]
        return column

    start, drive = np.zeros((len(x), size)), np.zeros((len(x), size))
    start[:, 0], drive[:, 0] = x, p.E @ w - p.B @ p.u_offset
    states = evaluated(p, start, inputs, drive)
    waiting = [inputs(j, p.moves) for j, count in enumerate(p.waiting) for _ in range(count)]
    return sliding(p, states, w, reference), np.vstack([states[-1], *waiting])


def prices(p, sequences, present):
    """Cost of the moves themselves: (K, moves, m) -> (K,)."""
    before = np.concatenate([np.broadcast_to(present, (len(sequences), 1, len(p.delay))), sequences[:, :-1]], axis=1)
    return ((sequences - before) ** 2 @ p.move_weight + (sequences != before) @ p.switch_cost).sum(axis=1)


def errors(p, s, end, w, reference):
    """Cost of s (K, steps, q) and of the end (K, states)."""
    first, last = p.window
    cost = (s[:, first - 1 : last] ** 2 @ p.weight).sum(axis=1)
    if p.P is not None:
        x, u = rest(p, w, reference[-1, :, 0])
        away = end - np.concatenate([x, np.repeat(u, p.waiting) if len(p.waiting) else []])
        cost += np.einsum("ki,ij,kj->k", away, p.P, away)
    return cost


def costs_of(p, past, x, w, reference, sequences):
    """Cost of each sequence (K, moves, m), by superposition."""
    s, end = response(p, past, x, w, reference)
    moves = np.column_stack([np.ones(len(sequences)), sequences.reshape(len(sequences), -1)])
    s = (moves @ s.reshape(-1, s.shape[2]).T).reshape(len(moves), *s.shape[:2])
    return errors(p, s, moves @ end.T, w, reference) + prices(p, sequences, past[-1])


def direct(p, past, x, w, reference, sequence):
    """Cost of one sequence (moves, m) by one simulation of it."""
    held = sequence[-1] if p.tail == "hold" else tail_input(p, w, reference[-1, :, 0])

    def inputs(j, period):
        row = past[max(period, -len(past))] if period < 0 else sequence[period] if period < p.moves else held
        return np.array([row[j]])

    states = evaluated(p, np.array(x, float)[:, None], inputs, (p.E @ w - p.B @ p.u_offset)[:, None])
    s = sliding(p, states, w, reference)[None, :, :, 0]
    end = np.concatenate([states[-1, :, 0], np.repeat(held, p.waiting) if len(p.waiting) else []])[None]
    return (errors(p, s, end, w, reference) + prices(p, sequence[None], past[-1]))[0]


def admissible(p, present, wait):
    """Every sequence (K, moves, m) of candidates that respects dwell, `wait` periods of it still to run."""
    values = np.array(p.candidates)
    which = np.array(list(product(range(len(values)), repeat=p.moves)))
    sequences = values[which]
    kept = np.array([[p.periods(j, level) for j, level in enumerate(c)] for c in p.candidates])[which]
    ok, before, left = np.ones(len(which), bool), np.asarray(present), np.broadcast_to(wait, (len(which), len(wait)))
    for k in range(p.moves):
        changed = sequences[:, k] != before
        ok &= ~(changed & (left > 0)).any(axis=1)
        left = np.where(changed, kept[:, k] - 1, np.maximum(left - 1, 0))
        before = sequences[:, k]
    return sequences[ok]


def best(p, past, x, w, reference, wait):
    """Least cost, and the least one by first move (inf: none)."""
    sequences = admissible(p, past[-1], wait)
    costs = costs_of(p, past, x, w, reference, sequences)
    first = [costs[(sequences[:, 0] == c).all(axis=1)].min(initial=np.inf) for c in p.candidates]
    return costs.min(), np.array(first)
