"""An estimator's start and restart, and what a run keeps of it."""

import pickle
from math import nan

import numpy as np
import pytest

import foreswitch as fsw
from systems import OVEN, RISE, SENSOR, VALVE, valve_controller

# Start and restart ----------------------------------------------------------------------------------------------------


def test_the_first_sample_is_taken_for_rest_at_that_output():
    law = valve_controller(estimator=SENSOR)
    law.step(300.0, 300.0)
    x, load = law.estimate
    assert (x.tolist(), load.tolist()) == ([pytest.approx(300.0), pytest.approx(0.0, abs=1e-9)], [0.0])
    oven = OVEN.replace(y_offset=20.0)
    law = fsw.Controller(oven, [0, 1], 1.0, fsw.Endpoint(20.0, 1.0), estimator=fsw.Kalman(1e-4, 0.01))
    law.step(55.0, 60.0)
    assert law.estimate[0] == pytest.approx([35.0])


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_a_restart_from_what_was_known_goes_on_as_if_nothing_had_happened(real):
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    law = valve_controller(vented, estimator=SENSOR, real=real)
    for k in range(60):
        law.step(8.0 * k + np.sin(k), 8.0 * k, disturbance=[100.0])
    x, load = law.estimate
    other = valve_controller(vented, estimator=SENSOR, real=real)
    other.reset(pending=law.issued, estimate=x, load=load, disturbance=[100.0])
    for k in range(60, 100):
        y = 480.0 + 2.0 * np.sin(k)
        assert law.step(y, 480.0, disturbance=[90.0]) == other.step(y, 480.0, disturbance=[90.0])
        assert np.array_equal(law.estimate[0], other.estimate[0])
        assert np.array_equal(law.estimate[1], other.estimate[1])


def test_a_known_state_also_starts_a_controller_without_an_estimator():
    law = valve_controller()
    law.reset(estimate=[90.0, 0.0])
    law.step([nan, nan], 100.0)
    assert law.status is fsw.Status.COASTING
    assert law.estimate[0] == pytest.approx([90.0, 0.0])
    law.reset()
    law.step([nan, nan], 100.0)
    assert law.status is fsw.Status.HELD


def test_decide_changes_nothing_and_foretells_the_step():
    law = valve_controller(estimator=SENSOR)
    for y in (0.0, 3.0, nan, 900.0, 900.0, 900.0, 900.0, 10.0):
        before = law.core.save()
        decision = law.decide(y, 100.0)
        assert law.core.save() == before
        assert decision.u == law.step(y, 100.0)
        assert decision.status is law.status


def test_copies_pickles_and_replacements():
    law = valve_controller(estimator=SENSOR)
    for k in range(20):
        law.step(float(k), 100.0)
    for twin in (law.copy(), pickle.loads(pickle.dumps(law))):
        assert np.array_equal(twin.estimate[0], law.estimate[0])
        assert twin.step(30.0, 100.0) == law.copy().step(30.0, 100.0)
        assert repr(twin) == repr(law)
    assert "estimator  Kalman, 1 load(s), slowest pole 0.9728" in repr(law)
    assert law.replace(estimator=None).kalman is None
    assert law.replace(real="float32").kalman.gain == pytest.approx(law.kalman.gain)


# Runs -----------------------------------------------------------------------------------------------------------------


def test_a_run_keeps_what_was_estimated():
    law = valve_controller(estimator=SENSOR)
    run = fsw.simulate(law, RISE, 0.2, noise=2.0, seed=1)
    assert (run.x_hat.shape, run.load_hat.shape) == ((200, 2), (200, 1))
    assert np.abs(run.x_hat[:, 0] - run.y[:-1, 0]).max() < 5.0
    frame = run.to_frame()
    assert np.array_equal(frame["x2 estimated"][:-1], run.x_hat[:, 1])
    assert np.array_equal(frame["load1 estimated"][:-1], run.load_hat[:, 0])
    assert fsw.simulate(valve_controller(), RISE, 0.1).x_hat is None
    silent = fsw.simulate(law, RISE, 0.1, hardware=fsw.Hardware(outages=[(0.0, 0.01)]))
    assert np.isnan(silent.x_hat[:10]).all()
    assert np.isfinite(silent.x_hat[10:]).all()


def test_a_run_is_its_steps():
    """The law is shown y as it stands, without noise: the same decisions one by one."""
    law = valve_controller(VALVE.replace(y_offset=100.0), estimator=SENSOR)
    run = fsw.simulate(law, 300.0, 0.2)
    twin = law.copy()
    for k in range(200):
        assert twin.step(run.y[k], 300.0) == run.u[k]
        assert np.array_equal(twin.estimate[0], run.x_hat[k])


def test_signals_from_functions_give_the_same_run():
    """Period by period through Python, the record of estimates too."""
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    law = valve_controller(vented, estimator=SENSOR)
    settings = {"noise": 2.0, "seed": 1}
    once = fsw.simulate(law, RISE, 0.2, disturbance=300.0, load=-0.1, **settings)
    stepped = fsw.simulate(law, RISE, 0.2, disturbance=lambda t, x: 300.0, load=lambda t, x: -0.1, **settings)
    for name in ("x", "u", "x_hat", "load_hat"):
        assert np.array_equal(getattr(stepped, name), getattr(once, name))


def test_noise_and_hardware_are_the_outputs():
    law = valve_controller(estimator=SENSOR)
    rig = fsw.Hardware(quantum=5.0, low=0.0, high=2000.0, missing=0.1, opening=0.2e-3)
    run = fsw.simulate(law, RISE, 0.3, noise=2.0, hardware=rig, seed=1)
    assert set(run.status.tolist()) == {0, 1}
    assert np.abs(run.y - run.r).max() < 80.0
    for arguments in ({"noise": [2.0, 50.0]}, {"hardware": fsw.Hardware(quantum=[5.0, 1.0])}, {"sensor": [[1.0, 0.0]]}):
        with pytest.raises(ValueError, match=r"measured output|measured value|put it into C"):
            fsw.simulate(law, RISE, 0.1, **arguments)


def test_the_truth_may_be_of_another_order_or_kind():
    law = valve_controller(estimator=SENSOR)
    third = fsw.Plant.from_tf([16500.0], [0.006 * 0.001, 0.007, 1.0, 0.0], input_delay=0.005)
    run = fsw.simulate(law, RISE, 0.6, plant=third, noise=2.0, seed=1)
    assert (run.x.shape[1], run.x_hat.shape[1]) == (3, 2)
    assert run.metrics()["rms_error_at_lag"] < 6.0
    curved = fsw.NonlinearPlant(
        lambda t, x, u, w: [x[1], (16500.0 * u[0] * (1.2 - 2e-4 * x[0]) - x[1]) / 0.006], lambda x: x[:1],
        states=2, input_delay=0.005,
    )  # fmt: skip
    run = fsw.simulate(law, RISE, 0.3, plant=curved, noise=2.0, seed=1)
    assert run.metrics()["rms_error_at_lag"] < 8.0


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_a_batch_is_its_single_runs(real):
    law = valve_controller(estimator=SENSOR, real=real)
    for rig in (None, fsw.Hardware(quantum=1.0, missing=0.05, closing=0.3e-3)):
        settings = {"noise": 2.0, "hardware": rig, "load": -0.1}
        batch = fsw.simulate_batch(law, RISE, 0.3, seeds=5, **settings)
        for i in range(5):
            run = fsw.simulate(law, RISE, 0.3, seed=i, **settings)
            assert np.sqrt(np.mean((run.y - run.r) ** 2)) == pytest.approx(batch.rms_error[i, 0], rel=1e-14)
            assert np.abs(run.y - run.r).max() == batch.max_error[i, 0]


def test_single_precision_estimates_alike():
    laws = [valve_controller(estimator=SENSOR, real=real) for real in ("float64", "float32")]
    rng = np.random.default_rng(0)
    for k in range(600):
        reference = RISE(np.array([k * 1e-3]), 2)
        y = float(reference[0, 0, 0]) + 2.0 * rng.standard_normal()
        for law in laws:
            law.step(y, reference)
        laws[1].core.preload(
            np.frombuffer(laws[0].core.line(), np.uint8), np.frombuffer(laws[0].core.wait(), np.uint32), True
        )
        (x, load), (x32, load32) = (law.estimate for law in laws)
        assert np.abs(x32 - x).max(initial=0.0) < 1e-4 * 16500.0
        assert abs(x32[0] - x[0]) < 1e-5 * 1000.0 + 1e-3
        assert abs(load32[0] - load[0]) < 1e-5


def test_both_precisions_beside_each_other():
    found = fsw.compare_precision(valve_controller(estimator=SENSOR), RISE, 0.6, noise=2.0, seed=1)
    assert found.decisions == 600
    assert len(found.gaps) < 6
    assert (found.gaps < 1e-3).all()
