"""What an estimator is for: tracking from the measured output alone, and under loads without offset."""

import numpy as np
import pytest

import foreswitch as fsw
from systems import OVEN, RISE, SENSOR, TWO_BY_TWO, VALVE, valve_controller


def rms_at_lag(run, lag):
    begun = run.t >= lag
    return float(np.sqrt(np.mean((run.y - RISE(run.t - lag, 1)[:, :, 0])[begun] ** 2)))


def test_from_the_pressure_alone_the_hot_gas_tracks_nearly_as_from_its_state(record_property):
    full = valve_controller()
    best = rms_at_lag(fsw.simulate(full, RISE, 0.6), full.lag)
    for estimator in (SENSOR, fsw.Kalman([0.0, 1e4], 4.0)):
        law = valve_controller(estimator=estimator)
        found = [rms_at_lag(fsw.simulate(law, RISE, 0.6, noise=2.0, seed=seed), law.lag) for seed in range(20)]
        record_property(f"rms at lag, {estimator}", f"{min(found):.2f} to {max(found):.2f}, full state {best:.2f}")
        assert max(found) < 1.25 * best
        assert max(found) > best, "noise costs something"


PULSE = 16.5  # kPa


def held(t):
    """Half of the demo's rise, then 500 kPa; with its slope."""
    given = RISE(t, 2)
    given[t > 0.25] = [500.0, 0.0]
    return given


def mean_offset(estimator, gain, leak=-0.1, seed=1):
    truth = fsw.Plant.integrator_lag(16500.0 * gain, 0.006, 0.005)
    run = fsw.simulate(valve_controller(estimator=estimator), held, 4.0, plant=truth, load=leak, noise=2.0, seed=seed)
    return float((run.y - run.r)[1000:].mean()), run


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
def test_a_leak_leaves_no_offset_where_it_is_estimated(gain, record_property):
    """A tenth of the full flow leaks, unmeasured, while 500 kPa are held; the model's gain is wrong besides."""
    without = fsw.Kalman(SENSOR.process_noise, SENSOR.measurement_noise)
    with_load, run = mean_offset(SENSOR, gain)
    without_load, _ = mean_offset(without, gain)
    record_property(f"mean offset, gain {gain}", f"{with_load:.3f} with, {without_load:.2f} without [kPa]")
    assert abs(with_load) < 0.1 * PULSE
    assert without_load < -PULSE
    assert run.load_hat[1000:].mean() == pytest.approx(-0.1, abs=0.03)
    state = fsw.simulate(valve_controller(), held, 4.0, plant=run.plant, load=-0.1)
    assert (state.y - state.r)[1000:].mean() < -0.4 * PULSE, "the measured state alone does not tell of a leak either"


def test_the_zero_tail_cannot_use_the_load():
    """What is known of a leak reaches the command through the tail as well."""
    law = valve_controller(tail="zero", estimator=SENSOR)
    run = fsw.simulate(law, held, 4.0, load=-0.1, noise=2.0, seed=1)
    assert abs((run.y - run.r)[1000:].mean()) > 0.1 * PULSE


def test_a_wrong_model_of_an_oven_leaves_no_offset():
    """Gain and time constant wrong, ambient colder: the load takes it all."""
    law = fsw.Controller(OVEN, [0, 1], 1.0, fsw.Endpoint(20.0, 1.0), estimator=fsw.Kalman(1e-4, 0.01, load=1e-6))
    truth = fsw.Plant.fopdt(K=80.0, T=120.0, L=20.0)
    run = fsw.simulate(law, 40.0, 8000.0, plant=truth, load=-0.05, noise=0.1, seed=1)
    assert (run.y - run.r)[4000:].mean() == pytest.approx(0.0, abs=0.05)


def test_loads_on_two_inputs_are_told_apart():
    law = fsw.Controller(
        TWO_BY_TWO, [[0.0, 0.5, 1.0]] * 2, 0.05, fsw.Endpoint(0.5, 3.0),
        estimator=fsw.Kalman(1e-8, 1e-6, load=1e-6),
    )  # fmt: skip
    run = fsw.simulate(law, [0.6, 0.7], 60.0, load=[-0.1, 0.15], noise=1e-3, seed=1)
    assert run.load_hat[-400:].mean(axis=0) == pytest.approx([-0.1, 0.15], abs=0.01)


def test_a_measured_disturbance_is_used_and_not_taken_for_a_load():
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    law = valve_controller(vented, estimator=SENSOR)
    run = fsw.simulate(law, held, 2.0, disturbance=2000.0, noise=2.0, seed=1)
    assert run.load_hat[500:].mean() == pytest.approx(0.0, abs=0.01)
    assert abs((run.y - run.r)[500:].mean()) < 0.1 * PULSE
