"""The figures that the theory chapter and the hot-gas example state."""

import numpy as np
import pytest

import foreswitch as fsw
from systems import MASS, OVEN, RISE, VALVE, valve_controller


def rise(controller, plant=None):
    """The paper's Fig. 5: half a sinusoid to 1000 kPa, then held; the run and its figures of merit."""
    run = fsw.simulate(controller, RISE, 0.6, plant=plant)
    return run, run.metrics()


def rms_at_lag(run, lag):
    """Over the times at which the shifted reference has begun."""
    begun = run.t >= lag
    return np.sqrt(np.mean((run.y - RISE(run.t - lag, 1)[:, :, 0])[begun] ** 2))


# Hot gas --------------------------------------------------------------------------------------------------------------


def test_hot_gas_trails_by_its_lag_within_the_resolution_of_a_pulse():
    run, figures = rise(valve_controller())
    assert rms_at_lag(run, 0.011) == pytest.approx(2.96, abs=0.005)
    assert figures["lag"] == pytest.approx(0.011, abs=0.0005)
    assert figures["rms_error"] == pytest.approx(23.1, abs=0.1)
    assert run.y.max() - 1000.0 == pytest.approx(6.5, abs=0.05)
    assert run.u.sum() == 61
    assert figures["on_time"] == pytest.approx(0.061)
    assert (run.y[-1, 0], 16.5 * 61) == pytest.approx((1006.5, 1006.5), abs=0.01)  # a pulse is worth 16.5 kPa


def test_hot_gas_without_dead_time_in_the_prediction():
    run, figures = rise(valve_controller(VALVE.replace(input_delay=0.0)), plant=VALVE)
    assert figures["rms_error"] == pytest.approx(42.2, abs=0.1)
    assert run.y.max() - 1000.0 == pytest.approx(89.0, abs=0.05)


@pytest.mark.parametrize(("preview", "rms"), [(False, 23.1), ("lag", 3.0), (True, 27.9), (0.025, 27.9)])
def test_hot_gas_with_the_reference_known_ahead(preview, rms):
    _, figures = rise(valve_controller(preview=preview))
    assert figures["rms_error"] == pytest.approx(rms, abs=0.05)


def test_hot_gas_leads_where_the_reference_is_sampled_at_the_evaluation_instant():
    _, figures = rise(valve_controller(preview=True))
    assert figures["lag"] == pytest.approx(0.01136 - 0.025, abs=0.0005)


def test_hot_gas_in_single_precision_gives_the_same_commands():
    double, single = (rise(valve_controller(real=real))[0] for real in ("float64", "float32"))
    assert np.array_equal(double.u, single.u)


VENTED = VALVE.replace(E=[[-1.0], [0.0]])  # kPa/s leave the tank; the second state is what flows in


@pytest.mark.parametrize(("tail", "offset"), [("zero", 27.0), ("rest", 0.0)])
def test_a_measured_vent_biases_the_zero_tail_only(tail, offset):
    run = fsw.simulate(valve_controller(VENTED, tail=tail), 1000.0, 3.0, x0=[1000.0, 0.0], disturbance=2000.0)
    assert run.y[1500:].mean() - 1000.0 == pytest.approx(offset, abs=0.6)


def test_the_bias_of_the_zero_tail_is_the_vent_over_the_time_it_forgets():
    """With 255 levels: w (Tu + Td - lag), since the rest tail would supply w for just that long."""
    plant, lag = VENTED, valve_controller().lag
    fine = fsw.Controller(plant, np.linspace(0.0, 1.0, 255), 1e-3, fsw.Endpoint(0.020, 2500.0, tail="zero"))
    run = fsw.simulate(fine, 1000.0, 3.0, x0=[1000.0, 0.0], disturbance=2000.0)
    assert run.y[1500:].mean() - 1000.0 == pytest.approx(2000.0 * (0.025 - lag), abs=0.1)


# Lag ------------------------------------------------------------------------------------------------------------------


def test_lag_of_the_hot_gas_loop_in_closed_form():
    tau, Ts, Td, c, lam = 0.005, 0.001, 0.020, 0.006, 2500.0
    expected = tau + Ts + (c - 1.0 / lam) * (1.0 - np.exp(-(Td - Ts) / c))
    assert expected == pytest.approx(0.01136, abs=5e-6)
    assert valve_controller().lag == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("Tu", "Td", "lam"), [(0.005, 0.04, 700.0), (0.0123, 0.0205, 90.0), (0.0, 0.001, 2500.0)])
def test_lag_of_an_integrator_with_a_lag_in_closed_form(Tu, Td, lam):
    plant, Ts, c = fsw.Plant.integrator_lag(16500.0, 0.006, Tu), 0.001, 0.006
    expected = Tu + Ts + (c - 1.0 / lam) * (1.0 - np.exp(-(Td - Ts) / c))
    assert valve_controller(plant, Td=Td, lam=lam).lag == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("lam", [0.1, 3.0, 80.0])
@pytest.mark.parametrize("Td", [0.1, 0.7, 1.25])
def test_lag_of_a_double_integrator_is_dead_time_plus_horizon(Td, lam):
    controller = fsw.Controller(MASS, [-1.0, 0.0, 1.0], 0.1, fsw.Endpoint(Td, lam))
    assert controller.lag == pytest.approx(0.3 + Td, rel=1e-9)
    assert controller.dc_gain == pytest.approx(1.0, rel=1e-9)


# Oven -----------------------------------------------------------------------------------------------------------------


def oven_controller(Td, tail):
    return fsw.Controller(OVEN, [0.0, 1.0], 1.0, fsw.Endpoint(Td, 1.0, tail=tail))


def settled(Td, tail):
    """Mean and ripple of the oven held at 40."""
    run = fsw.simulate(oven_controller(Td, tail), 40.0, 6000.0)
    return run.y[3000:].mean(), np.ptp(run.y[3000:])


@pytest.mark.parametrize(("Td", "mean"), [(5.0, 41.7), (20.0, 48.4), (50.0, 65.3), (100.0, 100.0)])
def test_the_zero_tail_holds_an_oven_too_hot(Td, mean):
    assert settled(Td, "zero")[0] == pytest.approx(mean, abs=0.05)


def test_the_rest_tail_holds_an_oven_on_target_whatever_the_horizon():
    ripple = settled(1.0, "rest")[1]
    for Td in (1.0, 5.0, 20.0, 50.0, 100.0, 200.0):
        mean, ripple_here = settled(Td, "rest")
        assert mean == pytest.approx(40.0, abs=0.005)
        assert ripple_here == pytest.approx(ripple, rel=1e-9)


def test_both_tails_are_one_law_where_the_rest_input_is_zero():
    """The paper's plant: an integrator at rest needs no input."""
    rest, zero = (rise(valve_controller(tail=tail))[0] for tail in ("rest", "zero"))
    assert np.array_equal(rest.u, zero.u)


@pytest.mark.parametrize("Td", [5.0, 50.0, 200.0])
def test_the_dc_gain_is_one_with_the_rest_tail(Td):
    assert oven_controller(Td, "rest").dc_gain == pytest.approx(1.0, rel=1e-9)
    assert oven_controller(Td, "zero").dc_gain > 1.02
