"""Prediction: each folded row against the plant carried there piece by piece, and the lag against a simulated ramp."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import foreswitch as fsw
from foreswitch.model import prediction
from systems import MASS, OVEN, TWO_BY_TWO, VALVE, exact_state, quiet, valve_controller

OSCILLATOR = fsw.Plant([[0.0, 1.0], [-4.0, -0.2]], [[0.0], [4.0]], E=[[0.0], [1.0]], input_delay=0.45, u_offset=0.3)
UNSTABLE = fsw.Plant([[0.0, 1.0], [4.0, 0.0]], [[0.0], [50.0]], input_delay=0.021)
PLANTS = {  # with a switching period
    "valve": (VALVE, 1e-3),
    "mass": (MASS, 0.1),
    "oven": (OVEN, 1.0),
    "two by two": (TWO_BY_TWO, 0.1),
    "oscillator": (OSCILLATOR, 0.1),
    "unstable": (UNSTABLE, 0.005),
}


@pytest.mark.parametrize("name", PLANTS)
def test_one_period_of_the_model_is_exact(name):
    """Also where a fractional dead time splits the period between two commands."""
    plant, Ts = PLANTS[name]
    model = prediction.period_model(plant, Ts)
    rng = np.random.default_rng(1)
    history = rng.uniform(-1, 1, (max(model.delay) + 1, plant.inputs))
    now, load = rng.uniform(-1, 1, (1, plant.inputs)), rng.uniform(-1, 1, (1, plant.inputs))
    x, w = rng.standard_normal(plant.states), rng.standard_normal((1, plant.disturbances))
    commands = np.vstack([history, now])
    expected = exact_state(plant, x, Ts, (history, now), Ts, load=load, w=w)
    result = model.transition @ x + model.disturbance @ w[0] + model.drift + model.load.T @ load[0]
    for j, d in enumerate(model.delay):
        result = result + model.old[j] * commands[-1 - d, j]
        if d:
            result = result + model.new[j] * commands[-d, j]
    assert result == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("held", [1, 3])
@pytest.mark.parametrize("horizon", [1.0, 2.6, 9.0])
def test_rows_give_the_sliding_variable_at_the_evaluation_instant(name, held, horizon):
    """State, commands under way, a candidate held for some periods, then a tail: one sum of rows."""
    plant, Ts = PLANTS[name]
    degree = prediction.relative_degrees(plant)
    s = prediction.sliding(plant, np.full(plant.outputs, 0.7 / Ts), degree)
    rows = prediction.endpoint_rows(plant, s, Ts, horizon * Ts, [held] * plant.inputs)
    rng = np.random.default_rng(2)
    depth = max(len(r) for r in rows.pending)
    history = rng.uniform(-1, 1, (depth + 1, plant.inputs))
    candidate, tail = rng.uniform(-1, 1, (2, plant.inputs))
    x, w = rng.standard_normal(plant.states), rng.standard_normal(plant.disturbances)

    theta = plant.input_delay.max() + horizon * Ts
    periods = int(np.ceil(theta / Ts)) + 1
    future = np.vstack([np.tile(candidate, (held, 1)), np.tile(tail, (periods, 1))])
    end = exact_state(plant, x, Ts, (history, future), theta, w=np.tile(w, (held + periods, 1)))
    expected = s.state @ end + s.disturbance @ w + s.offset

    result = rows.state @ x + rows.disturbance @ w + rows.offset + rows.total @ tail
    for j, effects in enumerate(rows.pending):
        result = result + history[::-1][: len(effects), j] @ effects
        result = result + rows.hold[j][min(held, len(rows.hold[j])) - 1] * (candidate[j] - tail[j])
    assert result == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


@given(st.integers(1, 40), st.sampled_from([0.1, 0.7, 1e-3, 0.3]))
def test_a_dead_time_of_whole_periods_has_no_sliver(periods, Ts):
    """0.3 / 0.1 = 2.9999...: whole all the same, and a first command that acts for the whole period."""
    model = prediction.period_model(fsw.Plant.fopdt(1.0, 3.0 * Ts, L=round(periods * Ts, 10)), Ts)
    assert model.delay == [periods]
    assert model.new[0, 0] == pytest.approx(0.0, abs=1e-9 * model.old[0, 0])


def test_relative_degrees_count_the_derivatives_an_input_cannot_reach():
    chain = fsw.Plant(np.eye(4, k=1), np.eye(4)[:, -1:], np.eye(4))
    assert prediction.relative_degrees(chain) == [4, 3, 2, 1]
    assert prediction.relative_degrees(fsw.Plant(-np.eye(2), [[1.0], [0.0]], np.eye(2))) == [1, 0]
    assert prediction.relative_degrees(TWO_BY_TWO) == [1, 1]


@pytest.mark.parametrize("name", PLANTS)
def test_the_rest_input_holds_the_reference(name):
    plant, _ = PLANTS[name]
    tail = prediction.rest(plant)
    rng = np.random.default_rng(3)
    yd, w = rng.standard_normal(plant.outputs), rng.standard_normal(plant.disturbances)
    u = tail.reference @ yd + tail.disturbance @ w + tail.offset
    push = plant.B @ (u - plant.u_offset) + plant.E @ w
    x = np.linalg.lstsq(np.vstack([plant.A, plant.C]), np.concatenate([-push, yd - plant.y_offset]), rcond=None)[0]
    assert tail.exact
    assert plant.A @ x + push == pytest.approx(0.0, abs=1e-12 * np.abs(plant.A).max())
    assert plant.C @ x + plant.y_offset == pytest.approx(yd)


def test_a_reference_that_no_input_holds_is_known_to_be_one():
    assert not prediction.rest(fsw.Plant([[-1.0]], [[1.0]], [[1.0], [2.0]])).exact
    assert not prediction.rest(fsw.Plant([[0.0, 1.0], [-2.0, -1.0]], [[0.0], [1.0]], [[0.0, 1.0]])).exact


# The ideal loop -------------------------------------------------------------------------------------------------------


def settled_ramp(controller, slope, duration):
    """DC gain and lag per output of a simulated loop, from the second half of its response to ramps.

    One output at a time gets the ramp, the others zero.
    """
    q = controller.plant.outputs
    gain, lag = np.zeros((q, q)), np.zeros(q)
    for o in range(q):
        run = fsw.simulate(controller, fsw.Stack(*(fsw.Ramp(slope * (i == o)) for i in range(q))), duration)
        t, y = (values[len(run.t) // 2 :] for values in (run.t, run.y))
        gain[:, o] = np.polyfit(t, y, 1)[0] / slope
        lag[o] = np.mean(t - y[:, o] / (slope * np.atleast_2d(controller.dc_gain)[o, o]))
    return gain, lag


THIRD_ORDER = fsw.Plant.from_tf([2.0], [1.0, 3.0, 4.0, 0.0], input_delay=0.33)
WITH_A_ZERO = fsw.Plant.from_tf([1.0, 3.0], [1.0, 2.0, 0.0], input_delay=0.2)
FINE = np.linspace(-1.0, 1.0, 255)
LOOPS = {  # plant, levels, Ts, Td, lam, tail, slope, duration
    "valve": (VALVE, np.linspace(0.0, 1.0, 255), 1e-3, 0.020, 2500.0, "rest", 8000.0, 0.6),
    "valve, zero tail": (VALVE, np.linspace(0.0, 1.0, 255), 1e-3, 0.0305, 300.0, "zero", 8000.0, 0.6),
    "mass": (MASS, FINE, 0.1, 0.7, 5.0, "rest", 0.5, 60.0),
    "oven": (OVEN, FINE, 1.0, 30.5, 1.0, "rest", 0.05, 1600.0),
    "oven, zero tail": (OVEN, FINE, 1.0, 20.0, 1.0, "zero", 0.05, 1300.0),
    "third order": (THIRD_ORDER, FINE, 0.1, 1.5, 2.0, "rest", 0.2, 80.0),
    "with a zero": (WITH_A_ZERO, FINE, 0.1, 0.5, 2.0, "rest", 0.5, 60.0),
}


@pytest.mark.parametrize("name", LOOPS)
def test_lag_and_dc_gain_are_those_of_a_simulated_ramp(name):
    """255 levels stand in for the unquantised input."""
    plant, levels, Ts, Td, lam, tail, slope, duration = LOOPS[name]
    controller = fsw.Controller(plant, levels, Ts, fsw.Endpoint(Td, lam, tail=tail))
    gain, lag = settled_ramp(controller, slope, duration)
    assert controller.dc_gain == pytest.approx(gain[0, 0], rel=1e-3)
    assert controller.lag == pytest.approx(lag[0], rel=1e-3)


@pytest.mark.parametrize("tail", ["rest", "zero"])
@pytest.mark.parametrize("weight", [1.0, [4.0, 1.0]])
def test_lag_and_dc_gain_of_two_outputs_with_unequal_dead_times(tail, weight):
    controller = fsw.Controller(TWO_BY_TWO, [FINE, FINE], 0.1, fsw.Endpoint(0.45, 1.0, tail=tail, weight=weight))
    gain, lag = settled_ramp(controller, 0.05, 15.0)
    assert controller.dc_gain == pytest.approx(gain, abs=2e-3)
    assert controller.lag == pytest.approx(lag, rel=3e-3)


def test_lag_of_more_outputs_than_inputs_follows_the_weights():
    """Position and speed of a mass under one force: weight on the position alone is the position's own law."""
    both = fsw.Plant(MASS.A, MASS.B, np.eye(2), input_delay=0.3)
    one = fsw.Controller(MASS, FINE, 0.1, fsw.Endpoint(0.7, 5.0))
    two = fsw.Controller(both, FINE, 0.1, fsw.Endpoint(0.7, 5.0, weight=[1.0, 0.0]))
    assert two.lag[0] == pytest.approx(one.lag)
    assert np.isnan(two.lag[1])  # the speed's DC gain from its own reference is 0


def test_an_unstable_plant_has_the_lag_its_ideal_loop_has():
    """A delay-free recursion of the unquantised law, theory [5], in error coordinates."""
    controller = quiet(fsw.Controller, UNSTABLE, FINE, 0.005, fsw.Endpoint(0.05, 40.0))
    model, rows, s = controller.model, controller.law.rows, controller.law.sliding
    depth = max(model.delay)
    h = rows.hold[0][0, 0]
    rest = prediction.rest(UNSTABLE).reference[0, 0]
    x, issued, slope, t = np.zeros(2), [0.0] * (depth + 1), 0.3, 0.0
    for k in range(4000):
        t = 0.005 * k
        yd = np.array([slope * t, slope])
        tail = rest * yd[0]
        free = rows.state[0] @ x + np.dot(issued[: -1 - depth : -1], rows.pending[0][:, 0]) - s.reference[0] @ yd
        u = tail - (free + rows.total[0, 0] * tail) / h
        issued.append(u)
        x = model.transition @ x + model.old[0] * issued[-1 - depth] + model.new[0] * issued[-depth]
    assert controller.lag == pytest.approx(t + 0.005 - x[0] / slope, rel=1e-6)


def test_preview_by_the_lag_removes_the_ramp_error():
    controller = valve_controller(preview="lag")
    assert controller.reference_times == pytest.approx([controller.lag])
    fine = fsw.Controller(VALVE, np.linspace(0.0, 1.0, 255), 1e-3, fsw.Endpoint(0.020, 2500.0), preview="lag")
    run = fsw.simulate(fine, fsw.Ramp(8000.0), 0.6)
    assert run.y[300:] == pytest.approx(run.r[300:], abs=0.1)  # kPa; without preview 91


def test_outputs_of_different_lags_are_each_previewed_by_their_own():
    controller = fsw.Controller(TWO_BY_TWO, [FINE[::20], FINE[::20]], 0.1, fsw.Endpoint(0.45, 1.0), preview="lag")
    assert controller.reference_times.shape == (1, 2)
    told = []

    def reference(t):
        told.append(t[0])
        return np.zeros((t.size, 2))

    fsw.simulate(controller, reference, 1.0)
    assert told[1:] == pytest.approx(controller.lag.tolist())
