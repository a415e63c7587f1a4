"""Random problems of the long horizon, and what its tests ask of the controllers of these problems."""

from dataclasses import replace

import numpy as np

import foreswitch as fsw
from foreswitch.control import horizon_tables
from oracles import horizon as oracle
from systems import VALVE, quiet

#: Sequences enumerated per problem, at most.
MANY = 3000


def random_plant(rng, n, m, q, kind):
    """A, B, C of one kind: any, chain of integrators, unstable, two inputs alike, an input without effect, stiff."""
    A = rng.standard_normal((n, n)) - rng.choice([0.0, 1.5]) * np.eye(n)
    B, C = rng.standard_normal((n, m)), rng.standard_normal((q, n))
    if kind == "chain":
        A, B = np.eye(n, k=1), np.vstack([np.zeros((n - 1, m)), rng.choice([1.0, -2.0, 0.5], m)[None]])
        C = np.vstack([np.eye(n)[0], C])[:q]
    elif kind == "alike" and m == 2:
        B[:, 1] = B[:, 0] * rng.choice([1.0, -1.0, 0.5])
    elif kind == "without effect":
        B[:, 0] = 0.0
    elif kind == "stiff":
        A = np.diag(-np.array([0.3, 3.0, 30.0, 300.0, 3000.0])[:n])
    else:  # stable, or unstable by little
        A = A - (np.linalg.eigvals(A).real.max() - rng.uniform(-1.0, 0.4)) * np.eye(n)
    return A, B, C


def random_problem(rng):
    """A problem of the oracle; what can vary does."""
    n, m, q = int(rng.integers(1, 6)), int(rng.integers(1, 3)), int(rng.integers(1, 3))
    kind = rng.choice(["any", "any", "chain", "alike", "without effect", "stiff"])
    A, B, C = random_plant(rng, n, m, q, kind)
    every = [-3.0, -1.0, -0.5, 0.0, 0.3, 1.0, 2.0, 5.0]
    levels = [np.sort(rng.choice(every, rng.integers(2, 4), replace=False)).tolist() for _ in range(m)]
    if m == 1 and rng.random() < 0.3:
        levels = [np.sort(rng.choice(every, rng.integers(4, 9), replace=False)).tolist()]
    if rng.random() < 0.3:
        levels = [[0.0, 1.0]] * m
    combinations = [c for c in oracle.product(*levels) if c != tuple(min(v, key=abs) for v in levels)]
    forbidden = []
    if len(combinations) > 2 and rng.random() < 0.4:
        forbidden = [
            combinations[i] for i in rng.permutation(len(combinations))[: rng.integers(1, len(combinations) - 1)]
        ]
    count = len(combinations) + 1 - len(forbidden)
    moves = int(rng.integers(1, min(10, int(np.log(MANY) / np.log(count))) + 1))
    steps = moves + int(rng.integers(0, 4)) * int(rng.random() < 0.5)
    first = int(rng.integers(1, steps + 1)) if rng.random() < 0.4 else 1
    last = int(rng.integers(first, steps + 1)) if rng.random() < 0.4 else steps
    Ts = float(rng.choice([0.05, 0.2, 0.5]))
    delay = np.full(m, Ts * rng.choice([0.0, 1.0, 3.0, rng.uniform(0, 4)]))
    if m == 2 and rng.random() < 0.6:
        delay = Ts * np.array([rng.choice([0.0, 2.0, rng.uniform(0, 4)]) for _ in range(m)])
    lam = r = None
    if kind == "chain" and n > 1 and rng.random() < 0.6:
        lam, r = rng.uniform(0.5, 8.0, q).tolist(), [int(rng.integers(1, n + 1)) for _ in range(q)]
    P = None
    if rng.random() < 0.25:
        root = rng.standard_normal((int(rng.integers(1, n + 1)), n))
        P = root.T @ root
    hold = (
        [Ts * rng.choice([0.0, 0.4, 1.0, 1.5, 2.0, 4.0], m) for _ in range(2)]
        if rng.random() < 0.4
        else [[0.0] * m] * 2
    )
    return oracle.Problem(
        A, B, C, rng.standard_normal((n, int(rng.integers(0, 2)))), delay.tolist(), rng.normal(0, 0.3, m) * rng.integers(2),
        rng.normal(0, 0.3, q) * rng.integers(2), levels, Ts, steps, moves, (first, last), rng.uniform(0.1, 3.0, q),
        rng.uniform(0, 0.5, m) * rng.choice([0.0, 0.1, 1.0]), rng.uniform(0, 0.5, m) * rng.choice([0.0, 0.0, 1.0]),
        str(rng.choice(["hold", "zero", "rest"])), lam, r, P, [], list(map(float, hold[0])), list(map(float, hold[1])),
        forbidden,
    )  # fmt: skip


def controller_of(p, *, terminal=None, node_budget=None, **options):
    """The library's controller of a problem of the oracle."""
    plant = fsw.Plant(p.A, p.B, p.C, E=p.E, input_delay=p.delay, u_offset=p.u_offset, y_offset=p.y_offset)
    objective = fsw.Horizon(
        p.steps, weight=p.weight, lam=p.lam, move_weight=p.move_weight, window=p.window, moves=p.moves, tail=p.tail,
        terminal=p.P if terminal is None else terminal, node_budget=node_budget, relative_degree=p.r,
    )  # fmt: skip
    limits = {"min_on": p.min_on, "min_off": p.min_off, "switch_cost": p.switch_cost, "forbidden": p.forbidden}
    return quiet(fsw.Controller, plant, p.levels, p.Ts, objective, **limits, **options)


def random_step(rng, p, controller):
    """Commands under way, waits of the inputs, x, reference and w; the controller is started accordingly."""
    candidates, m = np.array(p.candidates), len(p.delay)
    past = candidates[rng.integers(0, len(candidates), controller.pending_steps + 1)]
    elapsed = p.Ts * rng.choice([0.0, 0.5, 1.0, 2.0, 9.0], m)
    controller.reset(pending=past, elapsed=elapsed)
    off = [min(v, key=abs) for v in p.levels]
    minimum = [(p.min_off if past[-1][j] == off[j] else p.min_on)[j] for j in range(m)]
    wait = [max(0, int(np.ceil((minimum[j] - elapsed[j]) / p.Ts - 1e-9))) for j in range(m)]
    far = rng.choice([0.1, 1.0, 10.0, 1000.0])
    x = rng.standard_normal(len(p.A)) * far
    reference = np.cumsum(rng.standard_normal((p.steps, len(p.C), p.order)), axis=0) * rng.choice([0.1, 1.0, 10.0])
    return past, x, rng.standard_normal(p.E.shape[1]), reference, wait


def told(p, w):
    return {"disturbance": w} if len(w) else {}


#: How the search is set: as designed; every node compared with those before; prices at once.
SETTINGS = {
    "as designed": {},
    "comparing": {"MANY": 0, "MANY_OF_FEW": 0},
    "comparing and pricing": {"MANY": 0, "MANY_OF_FEW": 0, "PATIENCE": 0, "FAR": 0},
    "pricing": {"PATIENCE": 1, "FAR": 0},
}


def set_search(monkeypatch, name):
    for key, value in SETTINGS[name].items():
        monkeypatch.setattr(horizon_tables, key, value)


def with_budget(controller, budget):
    """The same controller in the same state with another node budget."""
    twin = controller.copy()
    twin.design = replace(twin.design, horizon=replace(twin.design.horizon, node_budget=budget))
    twin.core = twin._new_core()
    twin.core.restore(controller.core.save())
    return twin


def is_admissible(p, sequence, present, wait):
    """Whether each command is allowed and no input leaves a level too early."""
    left = list(wait)
    for command in sequence:
        if tuple(command) not in p.candidates:
            return False
        for j, level in enumerate(command):
            if level != present[j] and left[j] > 0:
                return False
            left[j] = p.periods(j, level) - 1 if level != present[j] else max(0, left[j] - 1)
        present = command
    return True


def hot_gas(steps=20, levels=(0.0, 1.0), objective=None, **options):
    return quiet(fsw.Controller, VALVE, list(levels), 1e-3, objective or fsw.Horizon(steps), **options)
