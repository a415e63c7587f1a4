"""The long horizon in runs, in batches, behind an estimator, and as an object."""

import numpy as np
import pytest

import foreswitch as fsw
from cases.horizon import hot_gas
from systems import RISE


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
