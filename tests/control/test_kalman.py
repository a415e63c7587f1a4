"""State estimation from outputs: the core's filter against oracles/kalman.py, and its gain against other computations."""

from functools import cache
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import chi2

import control
import foreswitch as fsw
from oracles.kalman import Estimator, riccati_gain
from oracles.law import Law
from systems import SENSOR, VALVE, valve_controller

STEPS = 40


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
