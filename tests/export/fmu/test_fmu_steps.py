"""A controller as an FMU: the same to the bit as in Python, however it is stepped."""

import json

import numpy as np
import pytest

import foreswitch as fsw
from export.fmu.instances import CASES, NEEDS_COMPILER, told
from places import VECTORS
from systems import quiet, valve_controller
from vectors import make
from vectors.make import number

pytestmark = NEEDS_COMPILER

STEPS = 10000


# To the bit -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", CASES)
def test_ten_thousand_steps_are_those_of_python(exported, opened, name, real):
    law, fmu = quiet(CASES[name][0], real), opened(exported(name, real))
    searched = isinstance(law.objective, fsw.Horizon)
    commands, statuses = set(), set()
    for k, (x, reference, w, u, decision) in enumerate(told(name, law, STEPS)):
        fmu.set(x, reference, w)
        before = fmu.get("command") if k % 7 == 0 else u.tolist()
        fmu.advance(law.Ts)
        assert fmu.get("command") == before == u.tolist(), k
        assert fmu.get("status") == [law.status], k
        commands.add(tuple(u))
        statuses.add(law.status)
        if k % 5 == 0:
            assert fmu.get("cost") == [decision.cost], k
            assert [fmu.get("bad_samples")[0], fmu.get("bad_samples_total")[0]] == list(law.bad_samples), k
            if searched:
                assert fmu.get("nodes") + fmu.get("optimal") == [decision.nodes, decision.optimal], k
            state, load = law.estimate
            if not np.isnan(state).any():
                assert fmu.get("estimate.x") == state.tolist(), k
                assert fmu.get("estimate.load") == load.tolist(), k
    assert len(commands) >= min(3, len(decision.candidates))
    assert {fsw.Status.OK, fsw.Status.COASTING, fsw.Status.HELD} <= statuses
    assert (fsw.Status.SAFE in statuses) == (name != "paper")


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_golden_steps(tmp_path, opened, path, real):
    """Commands under way and a running dwell at the start among them."""
    vector = json.loads(path.read_text())
    case = {"problem": vector["problem"], "bad_limit": vector["problem"].pop("bad_limit"), **vector["start"]}
    law = make.controller(case, real)
    fsw.export_fmu(law, tmp_path / "golden.fmu")
    fmu = opened(tmp_path / "golden.fmu")
    for k, step in enumerate(vector["steps"]):
        fmu.set(number(step["x"]), number(step["reference"]), number(step["w"]))
        fmu.advance(law.Ts)
        assert fmu.get("command") == step["u"], k
        assert fsw.Status(fmu.get("status")[0]).name == step["status"], k
        if step["costs"] is not None:
            costs = np.array(number(step["costs"]))
            tolerance = 1e-9 if real == "float64" else 1e-3
            assert fmu.get("cost")[0] == pytest.approx(
                costs.min(), rel=0, abs=costs[np.isfinite(costs)].max() * tolerance
            )


def test_it_goes_on_where_the_controller_stands(tmp_path, opened):
    """Commands under way, dwell and estimate."""
    name = "two inputs"
    law = quiet(CASES[name][0], "float64")
    steps = told(name, law, 400)
    for _ in range(200):
        next(steps)
    fsw.export_fmu(law, tmp_path / "half.fmu")
    fmu = opened(tmp_path / "half.fmu")
    for x, reference, w, u, _ in steps:
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()


def test_a_search_that_gives_up_says_so(tmp_path, opened):
    plant = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.0043)
    law = fsw.Controller(plant, [-1, 0, 1], 1e-3, fsw.Horizon(12, move_weight=0.1, node_budget=30), preview=True)
    fsw.export_fmu(law, tmp_path / "hasty.fmu")
    fmu, gaps = opened(tmp_path / "hasty.fmu"), []
    for x, reference, w, u, decision in told("horizon", law, 500):
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()
        shown = fmu.get("optimal") + fmu.get("nodes")
        assert shown == [decision.optimal, decision.nodes]
        if np.isfinite(decision.gap):
            gaps.append(decision.gap)
            assert fmu.get("gap") == [decision.gap]
    assert {gap > 0.0 for gap in gaps} == {True, False}


# Time -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, -3.0, 86400.0, 1e7])
@pytest.mark.parametrize("parts", [1, 3, 7, 10])
def test_fractions_of_a_period(exported, opened, parts, start):
    """Inputs are sampled at the instants alone, and the clock does not wander."""
    law, fmu = valve_controller(), opened(exported("paper"), start=start)
    for k, (x, reference, w, u, _) in enumerate(told("paper", law, 1500)):
        fmu.set(x, reference, w)
        for i in range(parts):
            fmu.slave.doStep(currentCommunicationPoint=fmu.time, communicationStepSize=law.Ts / parts)
            fmu.time = start + (k + (i + 1) / parts) * law.Ts
            assert fmu.get("command") == u.tolist(), (k, i)
            if i + 1 < parts:
                fmu.set(-x, -reference, -w)
                assert fmu.get("command") == u.tolist(), (k, i)


def test_steps_of_any_length(exported, opened):
    """As many decisions as instants, also where none ends on one."""
    fmu = opened(exported("paper"))
    fmu.set([np.nan, 0.0], [0.0, 0.0])
    rng, done = np.random.default_rng(0), 0
    for _ in range(3000):
        fmu.advance(1e-3 * rng.choice([0.01, 0.37, 1.0, 1.61, 5.2]))
        done = int(np.ceil(fmu.time / 1e-3 - 1e-3))
        assert abs(fmu.get("bad_samples_total")[0] - done) <= (abs(fmu.time / 1e-3 - round(fmu.time / 1e-3)) < 2e-3)
    assert done > 3000


def test_a_step_over_several_periods_decides_in_each(exported, opened):
    law, fmu = valve_controller(), opened(exported("paper"))
    for n in (1, 2, 5, 1, 40):
        x, reference = [100.0 * n, -50.0], [[[120.0 * n, 30.0]]]
        fmu.set(x, reference)
        fmu.advance(n * 1e-3)
        for _ in range(n):
            u = law.step(x, reference)
        assert fmu.get("command") == u.tolist()
    assert fmu.get("estimate.x") == law.estimate[0].tolist()


def test_what_the_outputs_show_when(exported, opened):
    """At an instant the decision on the inputs just set, which may still change; between instants the latest."""
    fmu, low, high = opened(exported("paper")), ([900.0, 0.0], [0.0, 0.0]), ([0.0, 0.0], [900.0, 0.0])
    assert fmu.get("command") == [0.0]
    for inputs, command in ((high, [1.0]), (low, [0.0]), (high, [1.0])):
        fmu.set(*inputs)
        assert fmu.get("estimate.x") == inputs[0]
        assert fmu.get("command") == command
    fmu.advance(1e-3)
    assert fmu.get("command") == [1.0]
    fmu.set(*low)
    assert fmu.get("command") == [0.0]
    fmu.advance(0.5e-3)
    fmu.set(*high)
    assert fmu.get("command") == [0.0]
    fmu.advance(0.5e-3)
    assert fmu.get("command") == [0.0]
    fmu.advance(1e-3)
    assert fmu.get("command") == [1.0]


def test_only_the_last_inputs_before_a_step_count(exported, opened):
    """However often others were tried, and whether their outcome was looked at or not."""
    law, fmu = quiet(CASES["endpoint"][0], "float64"), opened(exported("endpoint"))
    tried = np.random.default_rng(1)
    for x, reference, w, u, _ in told("endpoint", law, 1000):
        for _ in range(tried.integers(3)):
            fmu.set(tried.choice([np.nan, 0.0, 1e4], size=x.shape), tried.normal(scale=1e4, size=reference.shape), w)
            if tried.integers(2):
                fmu.get("command")
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()
        assert fmu.get("bad_samples_total") == [law.bad_samples[1]]
