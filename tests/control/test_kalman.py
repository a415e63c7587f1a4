"""State estimation from outputs: the core's filter against kalman_oracle.py, its gain, faults, and what it is for."""

import pickle
from functools import cache
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import chi2

import control
import foreswitch as fsw
from oracles.kalman import Estimator, riccati_gain
from oracles.law import Law
from systems import MASS, OVEN, RISE, TWO_BY_TWO, VALVE, quiet, valve_controller

STEPS = 40
SENSOR = fsw.Kalman([0.0, 1e4], 4.0, load=1e-6)  # of the hot gas: 2 kPa of noise, a slope known to 100 kPa/s


# Random plants --------------------------------------------------------------------------------------------------------


def random_covariance(rng, size):
    """In one of the forms that are taken."""
    form = rng.integers(3)
    if form == 0:
        return float(rng.uniform(0.01, 1.0))
    if form == 1:
        return rng.uniform(0.01, 1.0, size)
    root = rng.standard_normal((size, size))
    return root @ root.T / size + 0.01 * np.eye(size)


def random_plant(rng):
    """1 to 5 states, stable, marginal or slowly growing; unequal fractional dead times; an operating point."""
    n = int(rng.integers(1, 6))
    m, q, p = int(rng.integers(1, 4)), int(rng.integers(1, min(n, 3) + 1)), int(rng.integers(0, 3))
    A = rng.standard_normal((n, n))
    A -= np.eye(n) * (np.linalg.eigvals(A).real.max() - rng.choice([-0.5, 0.0, 0.2]))
    plant = fsw.Plant(
        A, rng.standard_normal((n, m)), rng.standard_normal((q, n)), E=rng.standard_normal((n, p)),
        input_delay=rng.uniform(0.0, 0.5, m), u_offset=rng.uniform(-1, 1, m), y_offset=rng.uniform(-1, 1, q),
    )  # fmt: skip
    loads = np.zeros(m)
    loaded = rng.permutation(m)[: rng.integers(0, min(m, q) + 1)]
    loads[loaded] = rng.uniform(0.001, 0.1, len(loaded))
    return plant, loads


def transcribed(controller):
    """The plain law of a controller, with its loads behind its disturbances, and the plain filter on it."""
    plant, kalman, objective = controller.plant, controller.kalman, controller.objective
    m, q = plant.inputs, plant.outputs
    loaded = plant.B[:, np.broadcast_to(controller.estimator.load or 0.0, (m,)) > 0] if kalman.loads else plant.B[:, :0]
    law = Law(
        plant.A, plant.B, plant.C, np.hstack([plant.E, loaded]), plant.input_delay, plant.u_offset, plant.y_offset,
        [v.tolist() for v in controller.levels], controller.Ts, objective.Td, np.broadcast_to(objective.lam, (q,)),
        np.ones(q), controller.relative_degree.tolist(), "rest", [0.0] * m, [0.0] * m, [0.0] * m, [],
        [v[i] for v, i in zip(controller.levels, controller.actuator.safe, strict=True)],
    )  # fmt: skip
    beyond = chi2.isf(chi2.sf(controller.estimator.gate**2, 1), q) if controller.estimator.gate else 0.0
    limit = controller.design.bad_limit
    return law, Estimator(
        law, kalman.loads, kalman.gain, kalman.innovation, beyond, controller.estimator.gate_limit, limit
    )


@cache
def random_loop(seed):
    """A controller on a random plant, or None where its outputs do not tell the loads (too few, or a zero close by)."""
    rng = np.random.default_rng(seed)
    plant, loads = random_plant(rng)
    estimator = fsw.Kalman(
        random_covariance(rng, plant.states), random_covariance(rng, plant.outputs), load=tuple(loads),
        gate=float(rng.choice([0.0, 3.0, 6.0])), gate_limit=int(rng.integers(1, 5)),
    )  # fmt: skip
    return fsw.Controller(
        plant, [[-1.0, 0.0, 1.5]] * plant.inputs if plant.inputs > 1 else [-1.0, 0.0, 1.5], 0.1,
        fsw.Endpoint(0.4, 3.0), estimator=estimator, safe_level=[0.0] * plant.inputs, bad_limit=4,
    )  # fmt: skip


def spoiled(rng, y):
    """A sample, now and then with something else in it."""
    what = rng.random()
    y = y.copy()
    if what < 0.1:
        y[rng.integers(len(y))] = rng.choice([nan, inf, -inf, 1e295])
    elif what < 0.2:
        y[rng.integers(len(y))] += rng.choice([-1, 1]) * 10.0 ** rng.uniform(1, 6)
    return y


@pytest.mark.parametrize("seed", range(150))
def test_each_step_is_the_transcription(seed):
    """Estimate to 1e-12, status and costs, of a plant that is fed noise, spikes, jumps and nothing at all."""
    controller, rng = random_loop(seed), np.random.default_rng((1, seed))
    law, plain = transcribed(controller)
    plant, q, p = controller.plant, controller.plant.outputs, controller.plant.disturbances
    x, scale, seen = rng.standard_normal(plant.states), 1.0, set()
    jump = int(rng.integers(STEPS))
    for k in range(STEPS):
        y = spoiled(rng, plant.C @ x + plant.y_offset + 0.1 * rng.standard_normal(q)) + (100.0 if k >= jump else 0.0)
        w = rng.standard_normal(p)
        told = np.full(p, nan) if p and rng.random() < 0.1 else w
        reference = rng.standard_normal((1, q, controller.order))
        status = plain.observe(y, told)
        decision = controller.decide(y, reference, disturbance=told)
        u = controller.step(y, reference, disturbance=told)
        assert controller.status.name == decision.status.name == status, k
        seen.add(status)
        if plain.x is not None:
            estimate = np.concatenate(controller.estimate)
            scale = max(scale, np.abs(plain.x).max(), np.abs(plain.d).max(initial=0.0))
            assert np.abs(estimate - np.concatenate([plain.x, plain.d])).max() <= 1e-12 * scale, k
        if status in ("OK", "COASTING") and k % 8 == 0:
            costs = law.costs(plain.x, plain.disturbance, reference[0])
            assert decision.costs == pytest.approx(costs, rel=1e-8, abs=1e-8 * costs.max())
        plain.advance(u)
        x = law.state_after(law.Ts, x, np.concatenate([w, np.full(plain.loads, 0.3)]), u, [1] * law.m, u)
        law.issue(u)
    assert len(seen) > 1


def test_the_random_plants_are_of_all_kinds():
    controllers = [random_loop(seed) for seed in range(150)]
    for attribute, kinds in (("states", {1, 2, 3, 4, 5}), ("inputs", {1, 2, 3}), ("outputs", {1, 2, 3}),
                             ("disturbances", {0, 1, 2})):  # fmt: skip
        assert {getattr(each.plant, attribute) for each in controllers} == kinds
    assert {each.kalman.loads for each in controllers} >= {0, 1, 2}


# Gain -----------------------------------------------------------------------------------------------------------------


def augmented(controller):
    """Transition, output and covariances of state and loads, from the transcription's exact steps."""
    law, plain = transcribed(controller)
    n, loads = law.n, plain.loads
    Phi, _, Gamma_w = law.constant_input(law.Ts)
    A = np.block([[Phi, Gamma_w[:, Gamma_w.shape[1] - loads :]], [np.zeros((loads, n)), np.eye(loads)]])
    C = np.hstack([law.C, np.zeros((law.q, loads))])

    def matrix(value, size):
        value = np.asarray(value, float)
        return value if value.ndim == 2 else np.diag(np.broadcast_to(value, (size,)))

    estimator = controller.estimator
    variances = np.broadcast_to(0.0 if estimator.load is None else estimator.load, (law.m,))
    Q = np.zeros((n + loads, n + loads))
    Q[:n, :n], Q[n:, n:] = matrix(estimator.process_noise, n), np.diag(variances[variances > 0])
    return A, C, Q, matrix(estimator.measurement_noise, law.q)


def gained():
    laws = [random_loop(seed) for seed in range(40)]
    return [*laws, valve_controller(estimator=SENSOR), valve_controller(estimator=fsw.Kalman(0.0, 4.0, load=1e-9))]


def test_the_gain_is_that_of_python_control():
    """Its form predicts the next estimate, ours corrects the present one: A gain."""
    for controller in gained():
        A, C, Q, R = augmented(controller)
        predicting, P, _ = control.dlqe(A, np.eye(len(A)), C, Q, R, method="scipy")
        kalman = controller.kalman
        assert A @ kalman.gain == pytest.approx(np.asarray(predicting), rel=1e-6, abs=1e-7 * np.abs(predicting).max())
        assert kalman.innovation == pytest.approx(C @ P @ C.T + R, rel=1e-7)


def test_the_gain_is_that_of_a_recursion():
    for controller in gained():
        A, C, Q, R = augmented(controller)
        gain, innovation = riccati_gain(A, C, Q, R)
        kalman = controller.kalman
        assert kalman.gain == pytest.approx(gain, rel=1e-7, abs=1e-7 * np.abs(gain).max())
        assert kalman.innovation == pytest.approx(innovation, rel=1e-7)
        error = (np.eye(len(A)) - kalman.gain @ C) @ A  # of the estimate, from one correction to the next
        assert np.abs(kalman.poles) == pytest.approx(np.sort(np.abs(np.linalg.eigvals(error)))[::-1], abs=1e-6)
        assert (np.abs(kalman.poles) < 1.0).all()


@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(-3, 3))
def test_units_do_not_matter(state, output, variance):
    """Another unit of x or y: the same estimates in the new unit."""
    a, b, v = 10.0**state, 10.0**output, 10.0**variance
    plain = valve_controller(estimator=fsw.Kalman([0.0, 1e4 * v], 4.0 * v, load=1e-6 * v)).kalman
    T = np.diag([1.0, a])
    plant = fsw.Plant(T @ VALVE.A @ np.linalg.inv(T), T @ VALVE.B, b * VALVE.C @ np.linalg.inv(T), input_delay=0.005)
    estimator = fsw.Kalman([0.0, 1e4 * v * a**2], 4.0 * v * b**2, load=1e-6 * v)
    scaled = valve_controller(plant, estimator=estimator).kalman
    assert np.diag([1.0, 1.0 / a, 1.0]) @ scaled.gain * b == pytest.approx(plain.gain, rel=1e-6)
    assert scaled.innovation == pytest.approx(plain.innovation * b**2, rel=1e-6)


def test_the_error_has_the_covariance_that_the_gain_promises():
    """Over a long run of the assumed plant: process and sensor noise as declared."""
    Ts, steps = 1e-3, 60_000
    hardware = fsw.Hardware(process_noise=[0.0, 100.0 / np.sqrt(Ts)])
    law = valve_controller(estimator=fsw.Kalman([0.0, 1e4], 4.0, gate=0.0))
    run = fsw.simulate(law, 500.0, steps * Ts, noise=2.0, hardware=hardware, seed=3)
    A, C, Q, R = augmented(law)
    gain, keep = law.kalman.gain, np.eye(2) - law.kalman.gain @ C
    F, driven = keep @ A, keep @ Q @ keep.T + gain @ R @ gain.T
    P = np.linalg.solve(np.eye(4) - np.kron(F, F), driven.ravel()).reshape(2, 2)
    error = (run.x_hat - run.x[:-1])[1000:]
    assert error.T @ error / len(error) == pytest.approx(P, rel=0.05)
    assert P[:, :1] == pytest.approx(gain @ R)


# What it is for: only the pressure is measured -------------------------------------------------------------------------


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


# Samples that are not measurements ------------------------------------------------------------------------------------

BAD = [nan, inf, -inf, 1e300, -1e300]


@pytest.mark.parametrize("real", ["float64", "float32"])
@given(st.sampled_from(BAD), st.integers(1, 8), st.integers(1, 30))
@settings(max_examples=30)
def test_without_samples_the_filter_runs_open_loop(real, bad, length, before):
    law = valve_controller(estimator=SENSOR, real=real)
    assert np.isnan(law.estimate[0]).all()
    law.step(bad, 100.0)
    assert law.status is fsw.Status.HELD
    assert np.isnan(law.estimate[0]).all()
    for k in range(before):
        law.step(5.0 * k, 100.0)
    for _ in range(length):
        x, load = law.estimate
        issued = law.issued
        law.step(bad, 100.0)
        assert law.status is fsw.Status.COASTING
        Phi, Gamma = np.asarray(law.model.transition), law.model.old.T + law.model.new.T
        expected = Phi @ x + Gamma @ issued[0] + law.model.disturbance @ load
        assert law.estimate[0] == pytest.approx(expected, rel=1e-9 if real == "float64" else 1e-4, abs=1e-3)
        assert law.estimate[1] == pytest.approx(load)
    law.step(float(expected[0]), 100.0)
    assert law.status is fsw.Status.OK


def test_one_bad_output_among_two_spoils_the_sample():
    law = fsw.Controller(TWO_BY_TWO, [[0, 1]] * 2, 0.05, fsw.Endpoint(0.5, 3.0), estimator=fsw.Kalman(1e-4, 1e-4))
    law.step([0.1, 0.2], [0.0, 0.0])
    before = law.copy()
    law.step([0.3, nan], [0.0, 0.0])
    before.step([nan, nan], [0.0, 0.0])
    assert law.status is fsw.Status.COASTING
    assert np.array_equal(law.estimate[0], before.estimate[0])


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_the_smallest_numbers_become_zero(real):
    law = valve_controller(estimator=SENSOR, real=real)
    tiny = 1e-310 if real == "float64" else 1e-40
    law.step(tiny, 0.0)
    assert law.status is fsw.Status.OK
    for _ in range(20):
        law.step(tiny, 0.0)
    x, load = law.estimate
    assert not x.any()
    assert not load.any()


def test_a_spike_is_not_used_and_a_jump_is():
    law = valve_controller(estimator=fsw.Kalman([0.0, 1e4], 4.0, gate=6.0, gate_limit=3))
    edge = 6.0 * float(np.sqrt(law.kalman.innovation[0, 0]))
    for _ in range(5):
        law.step(0.0, 0.0)
    for offset, status in ((0.999, "OK"), (1.001, "COASTING"), (-1.001, "COASTING")):
        other = law.copy()
        other.step(offset * edge, 0.0)
        assert other.status.name == status, offset
    statuses = []
    for _ in range(60):
        law.step(800.0, 0.0)
        statuses.append(law.status.name)
    assert statuses[:10] == ["COASTING"] * 3 + ["OK"] * 7
    assert statuses[30:] == ["OK"] * 30, "in between the estimate overshoots and leaves the gate once more"
    assert law.estimate[0][0] == pytest.approx(800.0, abs=1.0)
    law.step(0.0, 0.0)
    assert law.status is fsw.Status.COASTING, "back inside, the gate counts anew"


def test_without_a_gate_every_number_is_used():
    law = valve_controller(estimator=fsw.Kalman([0.0, 1e4], 4.0, gate=0.0))
    for y in (0.0, 1e6, 1e-6, 1e12):
        law.step(y, 0.0)
        assert law.status is fsw.Status.OK


def test_the_gate_is_as_wide_in_probability_for_several_outputs():
    estimator = fsw.Kalman(1e-4, [1e-4, 4e-4], gate=3.0)
    kalman = fsw.Controller(TWO_BY_TWO, [[0, 1]] * 2, 0.05, fsw.Endpoint(0.5, 3.0), estimator=estimator).kalman
    rng = np.random.default_rng(0)
    e = rng.multivariate_normal([0.0, 0.0], kalman.innovation, 200_000)
    beyond = np.einsum("ki,ij,kj->k", e, kalman.gate, e) > 1.0
    assert beyond.mean() == pytest.approx(chi2.sf(9.0, 1), rel=0.1)


@pytest.mark.parametrize("real", ["float64", "float32"])
@given(st.lists(st.floats(width=64) | st.sampled_from(BAD), min_size=1, max_size=40))
def test_no_samples_break_it(real, samples):
    """Whatever is measured: an allowed command, finite estimates, and a sound filter afterwards."""
    law = valve_controller(estimator=SENSOR, real=real)
    for y in samples:
        assert law.step(y, 100.0)[0] in (0.0, 1.0)
        assert np.isfinite(law.estimate[0]).all() or np.isnan(law.estimate[0]).all()
    if max((abs(y) for y in samples if np.isfinite(y)), default=0.0) < 1e6:
        for _ in range(1500):
            law.step(50.0, 0.0)
        assert law.estimate[0][0] == pytest.approx(50.0, abs=0.5)


def test_an_estimate_beyond_all_numbers_starts_anew():
    unstable = fsw.Plant([[30.0]], [[1.0]])
    law = fsw.Controller(unstable, [-1, 1], 0.1, fsw.Endpoint(0.1, 1.0), estimator=fsw.Kalman(0.01, 0.01))
    law.step(1.0, 0.0)
    statuses = []
    for _ in range(300):
        law.step(nan, 0.0)
        statuses.append(law.status)
    assert statuses[0] is fsw.Status.COASTING
    assert statuses[-1] is fsw.Status.HELD
    law.step(2.0, 0.0)
    assert law.estimate[0][0] == pytest.approx(2.0)


def test_bad_samples_in_a_row_lead_to_the_safe_level():
    law = valve_controller(estimator=SENSOR, safe_level=0.0, bad_limit=4)
    law.step(0.0, 500.0)
    seen = []
    for _ in range(6):
        law.step(nan, 500.0)
        seen.append(law.status.name)
    assert seen == ["COASTING"] * 3 + ["SAFE"] * 3
    law.step(law.estimate[0][0], 500.0)
    assert law.status is fsw.Status.OK


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


# Mistakes -------------------------------------------------------------------------------------------------------------

BLIND = fsw.Plant([[-1.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[1.0, 0.0]], input_delay=0.1)
WASHOUT = fsw.Plant.from_tf([1.0, 0.0], [1.0, 3.0, 2.0])  # a zero at the origin: constant inputs leave no trace


@pytest.mark.parametrize(
    ("plant", "arguments", "message"),
    [
        (VALVE, ([1.0, 2.0, 3.0], 1.0), r"process_noise has shape \(3,\); give .* per state \(2\)"),
        (VALVE, (1.0, [1.0, 2.0]), r"measurement_noise has shape \(2,\)"),
        (VALVE, (-1.0, 1.0), "process_noise is -1.0; variances must be at least 0"),
        (VALVE, (1.0, -1.0), "measurement_noise is -1.0"),
        (VALVE, ([[1.0, 0.5], [0.4, 1.0]], 1.0), "process_noise .* must be symmetric"),
        (VALVE, ([[1.0, 2.0], [2.0, 1.0]], 1.0), "process_noise .* negative eigenvalues"),
        (VALVE, ([[1.0, 2.0]], 1.0), "process_noise has shape"),
        (VALVE, ([[1e-12, 1e-3], [1e-3, 1e4]], 1.0), "process_noise .* negative eigenvalues"),
        (VALVE, ([[0.0, 1.0], [1.0, 1.0]], 1.0), "process_noise .* negative eigenvalues"),
        (VALVE, (nan, 1.0), "process_noise holds NaN"),
        (VALVE, (1.0, 0.0), "measurement_noise is 0.0; it must be greater than 0"),
        (VALVE, (0.0, 1.0), "process_noise"),
        (VALVE, (1.0, 1.0, {"load": -1.0}), "load is -1.0"),
        (VALVE, (1.0, 1.0, {"load": [1.0, 1.0]}), r"load has shape \(2,\)"),
        (VALVE, (1.0, 1.0, {"gate": -1.0}), "gate is -1"),
        (VALVE, (1.0, 1.0, {"gate": 31.0}), "gate is 31"),
        (VALVE, (1.0, 1.0, {"gate_limit": 0}), "gate_limit is 0"),
        (VALVE, (1.0, 1.0, {"gate_limit": 256}), "gate_limit is 256"),
        (VALVE, (1.0, 1.0, {"gate_limit": 1.5}), "gate_limit is 1.5"),
        (BLIND, (1.0, 1.0), "plant does not show its mode at 0 rad/s"),
        (TWO_BY_TWO.replace(C=TWO_BY_TWO.C[:1], y_offset=0.0, output_names=["y"]), (1.0, 1.0, {"load": 1.0}),
         "load names 2 inputs and the plant has 1 output"),
        (WASHOUT, (1.0, 1.0, {"load": 1.0}), "load is 1.0, .*zero at the origin"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(plant, arguments, message):
    noises, options = arguments[:2], arguments[2] if len(arguments) > 2 else {}
    levels = [[0, 1]] * plant.inputs if plant.inputs > 1 else [0, 1]
    with pytest.raises(ValueError, match=message) as caught:
        fsw.Controller(plant, levels, 0.01, fsw.Endpoint(0.1, 10.0), estimator=fsw.Kalman(*noises, **options))
    assert str(caught.value).count("\n") == 0
    assert ";" in str(caught.value)


def test_what_is_no_estimator_is_refused():
    with pytest.raises(ValueError, match=r"estimator is 1\.0; give a Kalman"):
        valve_controller(estimator=1.0)
    law = valve_controller(estimator=SENSOR)
    with pytest.raises(ValueError, match=r"x has shape \(2,\); the measured output has shape \(1,\)"):
        law.step([0.0, 0.0], 0.0)
    for arguments, message in (
        ({"estimate": [0.0]}, "estimate has shape"),
        ({"load": 0.1}, "load is 0.1 without a state; give estimate too"),
        ({"estimate": [0.0, 0.0], "load": [0.1, 0.2]}, "load has shape"),
        ({"estimate": [0.0, 0.0], "disturbance": 1.0}, "disturbance has shape"),
        ({"estimate": [0.0, inf]}, "estimate holds NaN or infinity"),
    ):
        with pytest.raises(ValueError, match=message):
            law.reset(**arguments)


def test_many_loads_are_more_than_the_core_holds():
    n = 9
    plant = fsw.Plant(-np.eye(n), np.eye(n)[:, :8], np.eye(n), E=np.ones((n, 12)))
    with pytest.raises(ValueError, match="20 disturbances and loads; the core holds up to 16"):
        quiet(
            fsw.Controller, plant, [[0, 1]] * 8, 0.1, fsw.Endpoint(1.0, 1.0, relative_degree=1),
            estimator=fsw.Kalman(1.0, 1.0, load=1.0),
        )  # fmt: skip


def test_a_mode_that_decays_need_not_show():
    plant = fsw.Plant([[-1.0, 0.0], [1.0, -0.5]], [[1.0], [0.0]], [[1.0, 0.0]])
    law = fsw.Controller(plant, [0, 1], 0.1, fsw.Endpoint(0.2, 1.0), estimator=fsw.Kalman(1e-3, 1e-3))
    assert np.abs(law.kalman.poles).max() == pytest.approx(np.exp(-0.05))


def test_a_double_integrator_with_a_load_has_three_poles_of_its_own():
    law = fsw.Controller(
        MASS, [-1, 0, 1], 0.1, fsw.Endpoint(0.8, 2.0), estimator=fsw.Kalman([0, 1e-6], 1e-4, load=1e-4)
    )
    assert law.kalman.gain.shape == (3, 1)
    assert (np.abs(law.kalman.poles) < 0.99).all()


@given(st.integers(0, 10_000), st.sampled_from(["integrator", "half", "oscillation", "growth"]))
def test_a_hidden_mode_that_lasts_is_refused_in_any_coordinates(seed, mode):
    """And the same plant is taken once it shows."""
    rng = np.random.default_rng(seed)
    blocks = {
        "integrator": [[0.0]],
        "half": [[0.0, 1.0], [0.0, 0.0]],
        "oscillation": [[0.0, 3.0], [-3.0, 0.0]],
        "growth": [[0.5, 3.0], [-3.0, 0.5]],
    }
    block = blocks[mode]
    k, n = len(block), len(block) + 2
    A = np.zeros((n, n))
    A[:k, :k], A[k:, k:] = block, [[-1.0, 5.0], [-5.0, -1.0]]
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-2, 2, n)
    inverse = np.linalg.inv(T)
    for hidden in (True, False):
        C = np.ones((1, n))
        if hidden:  # of a double integrator the slope alone shows: where it is does not
            C[0, : 1 if mode == "half" else k] = 0.0
        plant = fsw.Plant(T @ A @ inverse, T @ np.ones((n, 1)), C @ inverse)
        estimator = fsw.Kalman(T @ T.T, 1.0)
        if hidden:
            with pytest.raises(ValueError, match=r"plant does not show its mode|no steady filter"):
                fsw.Controller(plant, [0, 1], 0.1, fsw.Endpoint(0.2, 1.0), estimator=estimator)
        else:
            law = fsw.Controller(plant, [0, 1], 0.1, fsw.Endpoint(0.2, 1.0), estimator=estimator)
            assert abs(law.kalman.poles[0]) < 0.999
