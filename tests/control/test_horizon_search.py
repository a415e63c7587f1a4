"""The long horizon's search: exhaustive enumeration, the terminal cost, other laws and any start give the same cost."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import foreswitch as fsw
from cases.horizon import SETTINGS, controller_of, hot_gas, random_plant, random_problem, random_step, set_search, told
from foreswitch import Status
from oracles import horizon as oracle
from systems import quiet

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
