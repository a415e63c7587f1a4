"""Estimators that do not fit their plant, and hidden modes, are refused."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

import foreswitch as fsw
from systems import MASS, SENSOR, TWO_BY_TWO, VALVE, quiet, valve_controller

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
