"""The long horizon at the edges of arithmetic: single precision, bad and huge values, unstable plants, many candidates."""

import time

import numpy as np
import pytest

import foreswitch as fsw
from cases.horizon import controller_of, hot_gas, is_admissible, random_problem, random_step, told
from foreswitch import Status
from oracles import horizon as oracle
from systems import RISE


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
