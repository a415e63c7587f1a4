"""The long horizon within a budget of nodes: a valid command, and a true bound of what was not looked at."""

import numpy as np
import pytest

import foreswitch as fsw
from cases.horizon import (
    SETTINGS,
    controller_of,
    hot_gas,
    is_admissible,
    random_problem,
    random_step,
    set_search,
    told,
    with_budget,
)
from foreswitch import Status
from oracles import horizon as oracle
from systems import RISE


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
