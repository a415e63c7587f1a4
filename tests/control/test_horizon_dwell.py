"""The long horizon under dwell: no command and no plan breaks it."""

from dataclasses import replace

import numpy as np
import pytest

import foreswitch as fsw
from cases.horizon import controller_of, is_admissible, with_budget
from foreswitch import Status
from oracles import horizon as oracle


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
