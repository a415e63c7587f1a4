"""The long horizon: against enumeration, within a budget, under dwell, and at its edges."""

import pickle
import time
from dataclasses import replace

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch import Status
from foreswitch.control import horizon_tables
from oracles import horizon as oracle
from systems import RISE, VALVE, quiet

# Random problems ------------------------------------------------------------------------------------------------------

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


# Against enumeration --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("part", range(4))
def test_the_cost_is_that_of_exhaustive_enumeration(part, setting, monkeypatch, record_property):
    """1280 problems; so are the costs of the candidates, each with what may follow it."""
    set_search(monkeypatch, setting)
    worst = 0.0
    for seed in range(80):
        rng = np.random.default_rng([seed, part, list(SETTINGS).index(setting)])
        p = random_problem(rng)
        controller = controller_of(p)
        past, x, w, reference, wait = random_step(rng, p, controller)
        decision = controller.decide(x, reference, **told(p, w))
        least, first = oracle.best(p, past, x, w, reference, wait)
        assert decision.optimal, seed
        assert decision.gap == 0.0, seed
        assert decision.cost == pytest.approx(least, rel=1e-9, abs=1e-15), seed
        assert decision.costs == pytest.approx(first, rel=1e-9, abs=1e-9 * first[np.isfinite(first)].max()), seed
        found = oracle.direct(p, past, x, w, reference, decision.sequence)
        assert found == pytest.approx(least, rel=1e-9, abs=1e-15), seed
        assert decision.u.tolist() == decision.sequence[0].tolist(), seed
        worst = max(worst, abs(decision.cost / least - 1.0) if least > 1e-12 else 0.0)
    record_property(f"worst relative error, {setting} {part}", f"{worst:.1e}")


def test_paths_that_meet_are_not_alike_if_one_must_wait_longer(monkeypatch):
    """An integrator with equal steps: states meet again and again, after moves that leave unlike dwells and prices."""
    set_search(monkeypatch, "comparing")
    for seed in range(36):
        rng = np.random.default_rng([seed, 11])
        levels = [[-1.0, 0.0, 1.0], [0.0, 1.0], [0.0, 1.0, 2.0]][seed % 3]
        moves, Ts = {2: 11, 3: 7}[len(levels)], 0.1
        on, off = (Ts * rng.integers(1, 5, 2)).tolist()
        p = oracle.Problem(
            np.array([[rng.choice([0.0, -0.5])]]), np.eye(1), np.eye(1), np.zeros((1, 0)), [0.0], np.zeros(1), np.zeros(1),
            [levels], Ts, moves, moves, (1, moves), np.full(1, 100.0), np.zeros(1), rng.uniform(0, 0.4, 1) * (seed % 4 == 0),
            "hold", min_on=[on], min_off=[off],
        )  # fmt: skip
        controller = controller_of(p)
        past, _, w, _, wait = random_step(rng, p, controller)
        sequences = oracle.admissible(p, past[-1], wait)
        for _ in range(20):
            x = 0.3 * rng.standard_normal(1)
            reference = (
                x + np.cumsum(0.1 * rng.choice([-1, 0, 1], (moves, 1, 1)), axis=0) + 0.05 * rng.standard_normal()
            )
            least = oracle.costs_of(p, past, x, w, reference, sequences).min()
            assert controller.decide(x, reference).cost == pytest.approx(least, rel=1e-9, abs=1e-12), seed


def test_prices_hold_where_two_inputs_do_the_same(monkeypatch):
    """No move is bounded by its own square there, and what the prices take off must be all of its slope."""
    set_search(monkeypatch, "pricing")
    for seed in range(20, 100):
        rng = np.random.default_rng([seed, 21])
        n, moves = int(rng.integers(1, 4)), int(rng.integers(2, 5))
        A, B, C = random_plant(rng, n, 2, 1, ("any", "alike")[seed % 2])
        p = oracle.Problem(
            A, B, C, np.zeros((n, 0)), [0.0, 0.0 if seed % 3 else 0.13], np.zeros(2), np.zeros(1),
            [[-1.0, 0.0, 1.0] if seed % 2 else [0.0, 1.0], [0.0, 1.0]], 0.2, moves, moves,
            (1 if seed % 4 else moves, moves), np.ones(1), np.zeros(2), np.zeros(2), "hold", min_on=[0, 0], min_off=[0, 0],
        )  # fmt: skip
        controller = controller_of(p)
        past, _, w, _, wait = random_step(rng, p, controller)
        for _ in range(10):
            x = rng.standard_normal(n) * rng.choice([0.3, 1.0, 3.0, 10.0])
            reference = rng.standard_normal((moves, 1, 1)) * rng.choice([0.3, 3.0])
            least = oracle.best(p, past, x, w, reference, wait)[0]
            assert controller.decide(x, reference).cost == pytest.approx(least, rel=1e-9, abs=1e-12), seed


@pytest.mark.parametrize("levels", [[0.0, 1.0], [-1.0, 0.0, 1.0]])
def test_far_from_the_reference_the_search_stays_small(levels):
    """Up to 60 pulses off, of which 20 periods make up a third; without prices it takes millions."""
    controller = hot_gas(20, levels)
    pulses = np.concatenate([np.linspace(0.3, 3.0, 10), np.linspace(3.0, 60.0, 39)])
    nodes = [controller.decide([0.0, 0.0], sign * 16.5 * d).nodes for d in pulses for sign in (1, -1)]
    assert max(nodes) < 2000


def test_superposition_is_simulation():
    """The enumeration itself: costs of whole sequences, each simulated by itself."""
    for seed in range(40):
        rng = np.random.default_rng([seed, 77])
        p = random_problem(rng)
        past, x, w, reference, _ = random_step(rng, p, controller_of(p))
        sequences = np.array(p.candidates)[rng.integers(0, len(p.candidates), (4, p.moves))]
        costs = oracle.costs_of(p, past, x, w, reference, sequences)
        each = [oracle.direct(p, past, x, w, reference, sequence) for sequence in sequences]
        assert costs == pytest.approx(each, rel=1e-10), seed


def test_the_problems_are_of_every_kind():
    """What the seeds above happen to draw."""
    drawn = [
        random_problem(np.random.default_rng([seed, part, k]))
        for seed in range(80)
        for part in range(4)
        for k in range(4)
    ]
    assert {len(p.A) for p in drawn} == {1, 2, 3, 4, 5}
    assert {len(p.candidates) for p in drawn} >= {2, 3, 4, 5, 6, 7, 8}
    assert {p.tail for p in drawn} == {"hold", "zero", "rest"}
    for kind, least in {
        "moves < steps": sum(p.moves < p.steps for p in drawn),
        "a window": sum(p.window != (1, p.steps) for p in drawn),
        "a terminal cost": sum(p.P is not None for p in drawn),
        "sliding weights": sum(p.lam is not None and max(p.r) > 1 for p in drawn),
        "dwell": sum(max(p.min_on + p.min_off) > p.Ts for p in drawn),
        "dwell below a period": sum(0 < max(p.min_on + p.min_off) < p.Ts for p in drawn),
        "switch cost": sum(p.switch_cost.any() for p in drawn),
        "forbidden": sum(bool(p.forbidden) for p in drawn),
        "no dead time": sum(max(p.delay) == 0 for p in drawn),
        "unequal dead times": sum(len(set(p.delay)) > 1 for p in drawn),
        "a disturbance": sum(p.E.shape[1] > 0 for p in drawn),
        "an operating point": sum(p.u_offset.any() for p in drawn),
        "one move": sum(p.moves == 1 for p in drawn),
        "nine moves or more": sum(p.moves > 8 for p in drawn),
    }.items():
        assert least > 20, kind


def test_a_running_dwell_counts_though_it_is_no_longer_than_a_period():
    """It can only be told at the start: the next switch would be free."""
    plant = fsw.Plant([[0.0]], [[1.0]])
    controller = fsw.Controller(plant, [0.0, 1.0], 0.1, fsw.Horizon(3), min_on=0.05)
    controller.reset(pending=[1.0], elapsed=0.0)
    assert controller.decide([0.0], -9.0).costs[0] == np.inf
    assert [controller.step([0.0], r).tolist() for r in (-9.0, -9.0, 9.0, -9.0)] == [[1.0], [0.0], [1.0], [0.0]]


@pytest.mark.parametrize("unequal", [False, True])
def test_with_an_estimated_load_it_is_the_enumeration_of_what_was_estimated(unequal):
    loads = []
    for seed in range(12):
        rng = np.random.default_rng([seed, int(unequal)])
        p = random_problem(rng)
        while len(p.delay) != 1 + unequal or (unequal and len(set(p.delay)) == 1) or p.E.shape[1] == 0:
            p = random_problem(rng)
        m, q = len(p.delay), len(p.C)
        kalman = fsw.Kalman(1e-2, 1e-2, load=[1e-3] + [0.0] * (m - 1))
        try:
            controller = controller_of(p, estimator=kalman)
        except ValueError:
            continue  # the load does not show in the outputs
        past, _, _, reference, wait = random_step(rng, p, controller)
        p.E = np.hstack([p.E, p.B[:, :1]])
        for k in range(4):
            y, w = rng.standard_normal(q), rng.standard_normal(1)
            decision = controller.decide(y, reference, disturbance=w)
            u = controller.step(y, reference, disturbance=w)
            x, load = controller.estimate
            loads.append(load[0])
            least, _ = oracle.best(p, past, x, np.concatenate([w, load]), reference, wait)
            assert decision.cost == pytest.approx(least, rel=1e-9), (seed, k)
            wait = [p.periods(j, u[j]) - 1 if u[j] != past[-1][j] else max(0, wait[j] - 1) for j in range(m)]
            past = np.vstack([past, u])
    assert np.count_nonzero(loads) > 10


# The terminal cost ----------------------------------------------------------------------------------------------------


def terminal_of(p):
    """Riccati cost on (x, waiting moves), and how many moves of each input wait."""
    law = controller_of(p, terminal="riccati").law
    return law.terminal.T @ law.terminal, law.model.waiting


@pytest.mark.parametrize("kind", ["one dead time", "unequal dead times", "sliding weights"])
def test_the_riccati_cost_is_what_the_unconstrained_law_pays_from_there_on(kind):
    """Bellman: its value now is the least of the next evaluation, the move and its value then. The step is the oracle's."""
    done = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, 5])
        p = random_problem(rng)
        p.P, p.E, p.forbidden = None, np.zeros((len(p.A), 0)), []
        p.u_offset, p.y_offset = 0 * p.u_offset, 0 * p.y_offset
        p.move_weight = p.move_weight + 0.1
        m, n = len(p.delay), len(p.A)
        if (len(set(p.delay)) > 1) != (kind == "unequal dead times") or (p.lam is None) == (kind == "sliding weights"):
            continue
        try:
            V, p.waiting = terminal_of(p)
        except ValueError:
            continue
        # one period, from the end of a horizon: the inputs act as late as the slowest lets them
        begin = max(p.delay) - max(np.ceil((max(p.delay) - min(p.delay)) / p.Ts - 1e-9), 0) * p.Ts
        own = [max(tau - begin, 0.0) for tau in p.delay]
        assert p.waiting == [int(np.ceil(t / p.Ts - 1e-9)) for t in own]
        size = n + sum(p.waiting)
        states = np.eye(size + m)  # x, waiting moves (newest first), the new move
        held = np.split(states[n:size], np.cumsum(p.waiting)[:-1])

        def inputs(j, period, held=held, states=states, size=size):
            return states[size + j] if period >= 0 else held[j][-period - 1]

        one = replace(p, delay=own, steps=1)
        x = carried(one, states[:n], inputs, p.Ts)
        after = np.vstack([x, *(np.vstack([states[size + j], h])[: len(h)] for j, h in enumerate(held))])
        s = oracle.sliding(replace(p, steps=1), x[None], np.zeros(0), np.zeros((1, len(p.C), p.order)))[0]
        cost = s.T @ (p.weight[:, None] * s) + after.T @ V @ after
        cost[size:, size:] += np.diag(p.move_weight)
        least = cost[:size, :size] - cost[:size, size:] @ np.linalg.solve(cost[size:, size:], cost[size:, :size])
        assert least == pytest.approx(V, rel=1e-6, abs=1e-6 * np.abs(V).max()), seed
        done += 1
    assert done >= 10


def carried(p, x, inputs, end):
    """x(end) of columns x (n, k) from one input instant to the next."""
    instants = sorted(
        {0.0, end} | {t for tau in p.delay for k in (-2, -1, 0, 1) if 0 < (t := tau + k * p.Ts) < end - 1e-12}
    )
    for a, b in oracle.pairwise(instants):
        block = np.zeros((2 * len(p.A),) * 2)
        block[: len(p.A), : len(p.A)], block[: len(p.A), len(p.A) :] = p.A, np.eye(len(p.A))
        full = oracle.expm(block * (b - a))[: len(p.A)]
        push = sum(
            np.outer(p.B[:, j], inputs(j, int(np.floor(((a + b) / 2 - tau) / p.Ts)))) for j, tau in enumerate(p.delay)
        )
        x = full[:, : len(p.A)] @ x + full[:, len(p.A) :] @ push
    return x


def test_with_a_riccati_cost_it_is_the_enumeration():
    done = 0
    for seed in range(150):
        rng = np.random.default_rng([seed, 6])
        p = random_problem(rng)
        try:
            P, waiting = terminal_of(p)
        except ValueError:
            continue
        p.P, p.waiting = P, waiting
        controller = controller_of(p, terminal="riccati")
        past, x, w, reference, wait = random_step(rng, p, controller)
        decision = controller.decide(x, reference, **told(p, w))
        least, _ = oracle.best(p, past, x, w, reference, wait)
        assert decision.optimal, seed
        assert decision.cost == pytest.approx(least, rel=1e-8), seed
        done += 1
    assert done > 60


# Within a budget ------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("setting", SETTINGS)
def test_any_budget_gives_a_valid_command_and_a_true_bound(setting, monkeypatch):
    """All budgets up to what the proof takes; cold, and warm from another step."""
    set_search(monkeypatch, setting)
    tried = cut = 0
    for seed in range(24):
        rng = np.random.default_rng([seed, 9])
        p = random_problem(rng)
        controller = controller_of(p)
        past, x, w, reference, wait = random_step(rng, p, controller)
        if seed % 2:
            u = controller.step(x, reference, **told(p, w))
            wait = [p.periods(j, u[j]) - 1 if u[j] != past[-1][j] else max(0, wait[j] - 1) for j in range(len(u))]
            past, x = np.vstack([past, u]), x + 0.2 * rng.standard_normal(len(x))
        least, _ = oracle.best(p, past, x, w, reference, wait)
        full, before = controller.decide(x, reference, **told(p, w)).nodes, np.inf
        for budget in (*range(1, min(full, 250) + 1), full + 1):
            limited = with_budget(controller, budget)
            saved = limited.core.save()
            decision = limited.decide(x, reference, **told(p, w))
            tried += 1
            assert limited.core.save() == saved
            assert is_admissible(p, decision.sequence, past[-1], wait), (seed, budget)
            assert oracle.direct(p, past, x, w, reference, decision.sequence) == pytest.approx(decision.cost, rel=1e-9)
            assert least * (1 - 1e-9) <= decision.cost <= before * (1 + 1e-9), (seed, budget)
            assert decision.gap >= 0.0
            assert decision.cost - decision.gap <= least * (1 + 1e-9), (seed, budget)
            assert decision.optimal == (decision.gap == 0.0)
            assert not decision.optimal or decision.cost == pytest.approx(least, rel=1e-9)
            assert (decision.nodes <= budget + len(p.candidates) * p.moves + 2 * p.moves) or decision.optimal
            assert decision.optimal or decision.nodes >= budget
            assert (
                limited.step(x, reference, **told(p, w)).tolist()
                == decision.u.tolist()
                == decision.sequence[0].tolist()
            )
            cut += not decision.optimal
            before = decision.cost
        assert decision.optimal, seed
    assert tried > 500
    assert cut > 100


def test_the_argument_is_what_limits():
    free, short = (hot_gas(objective=fsw.Horizon(20, node_budget=budget)) for budget in (None, 60))
    loose, tight = (c.decide([0.0, 0.0], 140.0) for c in (free, short))
    assert (loose.optimal, tight.optimal) == (True, False)
    assert tight.nodes < 100 < loose.nodes
    assert 0.0 < tight.gap < tight.cost
    assert with_budget(free, 60).decide([0.0, 0.0], 140.0).nodes == tight.nodes


def test_the_least_budget_still_looks_at_the_measurement():
    """A plan alone would be followed to its end, whatever happens."""
    controller = hot_gas(objective=fsw.Horizon(20, node_budget=1))
    run = fsw.simulate(controller, RISE, 0.6)
    best = fsw.simulate(hot_gas(20), RISE, 0.6)
    assert np.sqrt(np.mean((run.y - run.r) ** 2)) < 1.3 * np.sqrt(np.mean((best.y - best.r) ** 2))


def test_a_held_command_is_no_plan():
    controller = fsw.Controller(
        fsw.Plant([[0.0]], [[1.0]]), [0.0, 1.0], 0.1, fsw.Horizon(4), safe_level=0.0, bad_limit=2
    )
    for x, r in (([np.nan], 1.0), ([0.0], 1e200)):  # nothing measured yet; every cost overflows
        decision = controller.decide(x, r)
        assert decision.status == Status.HELD
        assert (decision.optimal, decision.gap, decision.u.tolist()) == (False, np.inf, [0.0])
        assert np.isinf(decision.costs).all()
        assert decision.sequence.tolist() == [[0.0]]
    good = controller.decide([0.0], 1.0)
    assert (good.optimal, good.gap, good.sequence.shape) == (True, 0.0, (4, 1))


# Dwell ----------------------------------------------------------------------------------------------------------------


def dwelling(steps, node_budget=None, **options):
    """Two inputs, five of six combinations, all dwell times unequal."""
    A, B = [[-0.3, 0.2], [0.0, 0.1]], [[1.0, 0.4], [-0.2, 0.8]]
    return oracle.Problem(
        np.array(A), np.array(B), np.eye(2), np.zeros((2, 0)), [0.0, 0.0], np.zeros(2), np.zeros(2),
        [[0.0, 1.0], [-1.0, 0.0, 1.0]], 0.1, steps, steps, (1, steps), np.ones(2), np.zeros(2), np.full(2, 1e-3), "hold",
        min_on=[0.3, 0.15], min_off=[0.2, 0.4], forbidden=[(1.0, -1.0)], **options,
    )  # fmt: skip


@pytest.mark.parametrize("steps", [1, 2, 3, 5, 10])
@pytest.mark.parametrize("budget", [1, 17, 2**32 - 1])
def test_from_every_state_of_dwell_no_command_and_no_plan_breaks_it(steps, budget):
    """All that can be reached: (command in force, periods each input must still stay), whatever is measured or wanted."""
    p = dwelling(steps)
    controller = with_budget(controller_of(p), budget)
    rng, first = np.random.default_rng(steps), ((0.0, 0.0), (0, 0))
    seen, todo = {first}, [first]
    while todo:
        present, wait = todo.pop()
        elapsed = [p.Ts * (p.periods(j, present[j]) - wait[j]) for j in range(2)]
        for x, r in ((10 * rng.standard_normal(2), (a, b)) for a in (-99.0, 0.3, 99.0) for b in (-99.0, 0.3, 99.0)):
            controller.reset(pending=[present], elapsed=elapsed)
            decision = controller.decide(x, r)
            assert is_admissible(p, decision.sequence, present, wait), (present, wait, r)
            allowed = oracle.admissible(replace(p, moves=1), present, wait)[:, 0].tolist()
            assert [c.tolist() for c in decision.candidates[np.isfinite(decision.costs)]] == allowed
            u = tuple(controller.step(x, r).tolist())
            assert u == tuple(decision.u)
            after = tuple(p.periods(j, u[j]) - 1 if u[j] != present[j] else max(0, wait[j] - 1) for j in range(2))
            assert np.frombuffer(controller.core.wait(), dtype=np.uint32).tolist() == list(after)
            if (u, after) not in seen:
                seen.add((u, after))
                todo.append((u, after))
    assert len(seen) > 20
    assert {present for present, _ in seen} == set(p.candidates)


@pytest.mark.parametrize("budget", [1, 25, 2**32 - 1])
def test_in_a_closed_loop_no_run_is_too_short(budget):
    """Noise, jumps, samples missing, restarts that are told the past; the plan of one step feeds the next."""
    p = dwelling(6)
    controller, rng = with_budget(controller_of(p), budget), np.random.default_rng(budget)
    x, present, wait, switches = np.zeros(2), (0.0, 0.0), [0, 0], 0
    r = np.zeros(2)
    for k in range(600):
        if rng.random() < 0.1:
            r = 3 * rng.standard_normal(2)
        if rng.random() < 0.05:
            elapsed = [p.Ts * (p.periods(j, present[j]) - wait[j]) for j in range(2)]
            controller.reset(pending=[present], elapsed=elapsed)
        shown = x + 0.3 * rng.standard_normal(2) if rng.random() < 0.9 else [np.nan, 0.0]
        u = tuple(controller.step(shown, r).tolist())
        assert u in p.candidates
        assert not any(u[j] != present[j] and wait[j] > 0 for j in range(2)), k
        wait = [p.periods(j, u[j]) - 1 if u[j] != present[j] else max(0, wait[j] - 1) for j in range(2)]
        switches += u != present
        present, x = u, x + p.Ts * (p.A @ x + p.B @ u)
    assert switches > 60


def test_the_safe_level_overrides_dwell_and_its_own_runs_after():
    plant = fsw.Plant([[0.0]], [[1.0]])
    controller = fsw.Controller(
        plant, [0.0, 1.0], 0.1, fsw.Horizon(8), min_on=0.5, min_off=0.3, safe_level=0.0, bad_limit=2
    )
    assert controller.step([0.0], 9.0) == [1.0]
    assert [controller.step([np.nan], 9.0)[0] for _ in range(2)] == [1.0, 0.0]
    assert controller.status == Status.SAFE
    assert [controller.step([0.0], 9.0)[0] for _ in range(3)] == [0.0, 0.0, 1.0]


# Other laws -----------------------------------------------------------------------------------------------------------


def sliding_problem(rng):
    """A problem that both objectives can state: lam, no dwell, no disturbance of the tail."""
    p = random_problem(rng)
    while p.tail == "hold":
        p = random_problem(rng)
    p.min_on, p.min_off, p.move_weight = [0.0] * len(p.delay), [0.0] * len(p.delay), np.zeros(len(p.delay))
    p.lam, p.r = rng.uniform(0.5, 9.0, len(p.C)), rng.integers(1, len(p.A) + 1, len(p.C))
    return p


def endpoint_of(p, Td, **options):
    plant = fsw.Plant(p.A, p.B, p.C, E=p.E, input_delay=p.delay, u_offset=p.u_offset, y_offset=p.y_offset)
    objective = fsw.Endpoint(Td, p.lam, tail=p.tail, weight=p.weight, relative_degree=p.r)
    return quiet(fsw.Controller, plant, p.levels, p.Ts, objective, forbidden=p.forbidden, **options)


def compared(p, long, short, rng):
    """Steps of both on the same data; costs 2 : 1, commands equal but for ties."""
    start = np.array(p.candidates)[rng.integers(0, len(p.candidates), long.pending_steps + 1)]
    for c in (long, short):
        c.reset(pending=start)
    for _ in range(6):
        x, w = rng.standard_normal(len(p.A)) * rng.choice([0.1, 3.0]), rng.standard_normal(p.E.shape[1])
        reference = rng.standard_normal((p.steps, len(p.C), long.order))
        a, b = long.decide(x, reference, **told(p, w)), short.decide(x, reference[-1:], **told(p, w))
        assert a.costs == pytest.approx(2 * b.costs, rel=1e-9, abs=1e-9 * a.costs.max())
        if np.sort(b.costs)[1] > b.costs.min() * (1 + 1e-8):
            assert a.u.tolist() == b.u.tolist()
        u = short.step(x, reference[-1:], **told(p, w))
        if long.step(x, reference, **told(p, w)).tolist() != u.tolist():
            return  # a tie: from here on they see different pasts


def test_evaluated_once_at_the_end_it_is_the_endpoint_law():
    tried = 0
    for seed in range(120):
        rng = np.random.default_rng([seed, 1])
        p = sliding_problem(rng)
        p.moves, p.window = 1, (p.steps, p.steps)
        try:
            short = endpoint_of(p, p.steps * p.Ts, switch_cost=p.switch_cost / 2)
        except ValueError:
            continue  # an input without effect
        p.P = None
        compared(p, controller_of(p), short, rng)
        tried += 1
    assert tried > 60


def test_over_one_period_it_is_the_one_step_law():
    tried = 0
    for seed in range(80):
        rng = np.random.default_rng([seed, 2])
        p = sliding_problem(rng)
        p.steps, p.moves, p.window, p.P = 1, 1, (1, 1), None
        try:
            short = endpoint_of(p, p.Ts, switch_cost=p.switch_cost / 2)
        except ValueError:
            continue
        if len(set(p.delay)) == 1:
            p.tail = "hold"  # nothing comes after the move
        compared(p, controller_of(p), short, rng)
        tried += 1
    assert tried > 40


# Warm starts ----------------------------------------------------------------------------------------------------------


def cold(controller):
    """The same commands, dwell and measurements, but no plan to start from."""
    twin = controller.copy()
    twin.core.preload(
        np.frombuffer(controller.core.line(), dtype=np.uint8),
        np.frombuffer(controller.core.wait(), dtype=np.uint32),
        True,
    )
    return twin


def test_where_a_search_starts_from_does_not_change_its_cost():
    """At every step of loops with samples missing, references beyond all numbers and faults; and a copy does the same."""
    differed = 0
    for seed in range(25):
        rng = np.random.default_rng([seed, 3])
        p = random_problem(rng)
        safe = [min(v, key=abs) for v in p.levels]
        controller = controller_of(p, safe_level=safe, bad_limit=3)
        _, x, w, reference, _ = random_step(rng, p, controller)
        statuses = set()
        for k in range(25):
            shown = np.full(len(x), np.nan) if k in (0, 7, 8, 14, 15, 16, 17) else x
            wanted = reference * 0 + 1e200 if k == 20 else reference
            a = controller.decide(shown, wanted, **told(p, w))
            b = cold(controller).decide(shown, wanted, **told(p, w))
            assert a.status == b.status
            assert a.cost == pytest.approx(b.cost, rel=1e-9, abs=1e-12), (seed, k)
            differed += a.nodes != b.nodes
            twins = [controller.copy(), pickle.loads(pickle.dumps(controller))]
            u = controller.step(shown, wanted, **told(p, w))
            assert u.tolist() == a.u.tolist()
            for twin in twins:
                assert twin.step(shown, wanted, **told(p, w)).tolist() == u.tolist()
                assert twin.core.save() == controller.core.save()
            statuses.add(controller.status)
            x = x + 0.1 * rng.standard_normal(len(x))
        assert statuses == set(Status)
    assert differed > 100


# Numbers --------------------------------------------------------------------------------------------------------------


def hot_gas(steps=20, levels=(0.0, 1.0), objective=None, **options):
    return quiet(fsw.Controller, VALVE, list(levels), 1e-3, objective or fsw.Horizon(steps), **options)


def test_single_precision_finds_the_same_cost():
    """To 1e-4 of it; costs of both sequences by the oracle."""
    worst = 0.0
    for seed in range(200):
        rng = np.random.default_rng([seed, 4])
        p = random_problem(rng)
        controller = controller_of(p, real="float32")
        past, x, w, reference, wait = random_step(rng, p, controller)
        decision = controller.decide(x, reference, **told(p, w))
        least, _ = oracle.best(p, past, x, w, reference, wait)
        found = oracle.direct(p, past, x, w, reference, decision.sequence)
        size = max(np.abs(x).max(), np.abs(reference).max()) ** 2
        assert decision.optimal
        assert is_admissible(p, decision.sequence, past[-1], wait)
        assert found <= least * (1 + 1e-4) + 1e-10 * size, seed
        assert decision.cost == pytest.approx(found, rel=1e-4, abs=1e-6 * size), seed
        worst = max(worst, found / least - 1.0)
    assert worst < 1e-4


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_bad_values_never_make_a_bad_command(real):
    controller = hot_gas(real=real, safe_level=0.0, bad_limit=100)
    assert controller.step([np.nan, 0.0], 100.0) == [0.0]
    assert controller.status == Status.HELD
    assert controller.step([0.0, 0.0], 1000.0) == [1.0]
    rng = np.random.default_rng(0)
    odd = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 1e30, -1e25, 1e19, 1e-310, -1e-45, 5e-324, 0.0, -0.0, 1.0]
    statuses = set()
    for _ in range(3000):
        x, r = rng.choice(odd, 2), rng.choice([v for v in odd if np.isfinite(v)])
        decision = controller.decide(x, r)
        u = controller.step(x, r)
        assert u[0] in (0.0, 1.0)
        assert u.tolist() == decision.u.tolist()
        assert decision.status == controller.status
        assert not np.isnan(decision.costs).any()
        if decision.status in (Status.OK, Status.COASTING):
            assert decision.optimal
            assert np.isfinite(decision.cost)
        statuses.add(controller.status)
    assert statuses == {Status.OK, Status.COASTING, Status.HELD}
    assert controller.step([0.0, 0.0], 1000.0) == [1.0]
    assert controller.decide([0.0, 0.0], 1000.0).cost == pytest.approx(
        hot_gas().decide([0.0, 0.0], 1000.0).cost, rel=0.3
    )


@pytest.mark.parametrize(("real", "large"), [("float64", 1e200), ("float32", 1e20)])
def test_where_all_costs_overflow_the_command_is_kept(real, large):
    controller = hot_gas(5, real=real)
    assert controller.step([0.0, 0.0], 1000.0) == [1.0]
    for _ in range(3):
        assert controller.step([large, 0.0], -large) == [1.0]
        assert controller.status == Status.HELD
    assert controller.step([2000.0, 0.0], 0.0) == [0.0]
    assert controller.status == Status.OK


def test_large_costs_are_still_compared():
    """As large as the other objective's may be: kilopascals by the name of 1e-60."""
    large = fsw.Controller(fsw.Plant.integrator_lag(16500e60, 0.006, 0.005), [0.0, 1.0], 1e-3, fsw.Horizon(5))
    run = fsw.simulate(large, fsw.HalfSine(1000e60, 0.5), 0.2)
    assert (run.status == 0).all()
    assert np.array_equal(run.u, fsw.simulate(hot_gas(5), RISE, 0.2).u)


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_a_decayed_state_is_as_fast_as_any(real):
    """A mode that a period takes to 1e-22 and a reference of zero, for a million periods; the rest is denormal there."""
    plant = fsw.Plant([[-1.0, 0.0], [0.0, -50.0]], [[1.0], [50.0]], [[1.0, 0.3]])
    controller = fsw.Controller(plant, [0.0, 1.0], 1.0, fsw.Horizon(12, move_weight=0.1), real=real)
    run = fsw.simulate(controller, 0.0, 1e6, x0=[1.0, 1.0])
    assert not run.u.any()
    assert abs(run.x[-1]).max() < 1e-300

    def pace(x, wanted):
        best = np.inf
        for _ in range(15):
            start = time.perf_counter()
            for _ in range(50):
                nodes = controller.decide(x, wanted).nodes
            best = min(best, (time.perf_counter() - start) / (50 * nodes))
        return best

    assert pace([1e-300, 1e-200], 0.0) < 5 * pace([0.6, 0.2], 0.0)


def test_unstable_plants_and_the_longest_horizon():
    """64 periods of an unstable plant: held, and as good as the shorter horizon's loop."""
    plant = fsw.Plant([[0.0, 1.0], [4.0, 0.0]], [[0.0], [50.0]], input_delay=0.013)
    errors = []
    for steps in (8, 64):
        controller = fsw.Controller(
            plant, [-1.0, 0.0, 1.0], 0.01, fsw.Horizon(steps, move_weight=1e-5, terminal="riccati", node_budget=20000)
        )
        run = fsw.simulate(controller, 0.0, 3.0, x0=[0.05, 0.0])
        assert (run.status == 0).all()
        errors.append(np.abs(run.y[150:]).max())
    assert max(errors) < 0.02


def test_sixty_four_candidates():
    """Two inputs of eight levels over three moves, 262144 sequences, against enumeration of the last two."""
    rng = np.random.default_rng(8)
    levels = [np.linspace(-1.0, 1.0, 8).tolist()] * 2
    p = random_problem(rng)
    while len(p.delay) != 2:
        p = random_problem(rng)
    p.levels, p.forbidden, p.steps, p.moves, p.window = levels, [], 2, 2, (1, 2)
    p.min_on, p.min_off = [0.0, 0.0], [0.0, 0.0]
    controller = controller_of(p)
    assert len(controller.decide(np.zeros(len(p.A)), np.zeros((2, len(p.C), p.order))).candidates) == 64
    past, x, w, reference, wait = random_step(rng, p, controller)
    decision = controller.decide(x, reference, **told(p, w))
    assert decision.cost == pytest.approx(oracle.best(p, past, x, w, reference, wait)[0], rel=1e-9)


# Around it ------------------------------------------------------------------------------------------------------------


def same_run(a, b):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("x", "u", "cost", "nodes", "status"))


def test_a_simulation_is_the_loop_of_steps():
    controller = hot_gas(10, preview=True)
    run = fsw.simulate(controller, RISE, 0.1)
    law = controller.copy()
    for k in range(100):
        reference = RISE(run.t[k] + law.reference_times)[:, :, :1]
        assert law.step(run.x[k], reference).tolist() == run.u[k].tolist(), k
    assert same_run(run, fsw.simulate(controller, RISE, 0.1))
    assert (run.status == 0).all()
    assert (run.nodes > 0).all()


EVERYTHING = fsw.Hardware(
    opening=0.0033, closing=0.0012, stuck=[fsw.Stuck(1.0, 0.02, 0.03)], quantum=2.0, low=-1e4, high=1e4,
    process_noise=[3.0, 30.0], missing=0.1, late=0.0025, outages=[(0.01, 0.014)],
)  # fmt: skip
LOOPS = {
    "plain": ({}, {"noise": 3.0}),
    "dwell and hardware": ({"min_on": 0.003, "safe_level": 0.0, "bad_limit": 3}, {"hardware": EVERYTHING}),
    "estimator": ({"estimator": fsw.Kalman([0.0, 1e4], 4.0, load=1e-4)}, {"noise": 2.0, "load": -0.1}),
    "everything": (
        {"estimator": fsw.Kalman([0.0, 1e4], 4.0, load=1e-4), "min_off": 0.002},
        {"noise": 2.0, "hardware": EVERYTHING},
    ),
}


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", LOOPS)
def test_a_batch_is_its_single_runs_bit_for_bit(name, real):
    options, simulation = LOOPS[name]
    controller = hot_gas(12, real=real, **options)
    batch = fsw.simulate_batch(controller, RISE, 0.15, seeds=range(6), **simulation)
    again = fsw.simulate_batch(controller, RISE, 0.15, seeds=range(6), threads=1, **simulation)
    for i in range(6):
        run = fsw.simulate(controller, RISE, 0.15, seed=i, **simulation)
        error = run.y - run.r
        assert batch.max_error[i] == np.abs(error).max()
        assert batch.switches[i] == np.count_nonzero(np.diff(run.u[:, 0]))
        assert batch.rms_error[i] == again.rms_error[i] == np.sqrt(np.cumsum(error**2, axis=0)[-1] / len(error))
    assert len(set(batch.rms_error[:, 0])) == 6


def test_single_precision_changes_near_ties_only():
    found = fsw.compare_precision(hot_gas(10, preview=True), RISE, 0.6)
    assert found.decisions == 600
    assert (found.gaps < 1e-3).all()
    rms = [np.linalg.norm(run.y - run.r) for run in (found.single, found.double)]
    assert rms[0] == pytest.approx(rms[1], rel=0.05)


def test_with_an_estimator_a_leak_leaves_no_offset():
    controller = hot_gas(20, levels=(-1.0, 0.0, 1.0), estimator=fsw.Kalman([0.0, 1e4], 4.0, load=1e-4))
    run = fsw.simulate(controller, 500.0, 0.6, load=-0.1)
    assert abs((run.y - run.r)[400:].mean()) < 4.0


def test_replace_and_repr_know_the_horizon():
    controller = hot_gas(7, min_on=0.002)
    longer = controller.replace(objective=fsw.Horizon(9))
    assert (controller.evaluations, longer.evaluations) == (7, 9)
    assert "Horizon(9" in repr(longer)
    assert np.isnan(controller.lag)
    assert controller.order == 1
    assert hot_gas(objective=fsw.Horizon(3, lam=2500.0)).order == 2
    ahead = hot_gas(3, preview=True).reference_times
    assert ahead == pytest.approx([0.006, 0.007, 0.008])
    assert hot_gas(3, preview=0.002).reference_times == pytest.approx([0.002] * 3)


def test_whole_numbers_may_be_floats():
    given = fsw.Horizon(5.0, moves=np.float64(3), window=np.array([1.0, 4.0]), node_budget=1e4)
    assert given == fsw.Horizon(5, moves=3, window=(1, 4), node_budget=10000)
    assert hot_gas(objective=given).decide([0.0, 0.0], 100.0).sequence.shape == (3, 1)
