"""What people use today: exact limit cycles of relays, pulse widths, and the Smith predictor's own invariance."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.baselines import PIPWM, Relay, SmithPWM, tune
from systems import OVEN, RISE, VALVE, level_runs

GAIN, DEAD_TIME, LEVEL, LAG = 3.0, 0.4, 0.7, 1.1
INTEGRATOR = fsw.Plant([[0.0]], [[GAIN]], input_delay=DEAD_TIME)
FIRST_ORDER = fsw.Plant.fopdt(GAIN, LAG, DEAD_TIME)


def limit_cycle(plant, *, hysteresis=0.0, periods_per_dead_time=4000, cycles=12):
    """Amplitude and period that a relay with levels +-LEVEL settles to."""
    Ts = DEAD_TIME / periods_per_dead_time
    law = Relay(plant, [-LEVEL, LEVEL], Ts, hysteresis=hysteresis)
    run = fsw.simulate(law, 0.0, cycles * 5.0 * DEAD_TIME)
    y = run.y[len(run.y) // 2 :, 0]
    lengths, _ = level_runs(run.u[:, 0])
    whole = lengths[len(lengths) // 2 // 2 * 2 : -1]  # half periods, the last cut off by the end of the run
    return 0.5 * np.ptp(y), Ts * np.mean(whole[: len(whole) // 2 * 2]) * 2.0


# Exact limit cycles ---------------------------------------------------------------------------------------------------


def test_limit_cycle_of_an_integrator():
    amplitude, period = limit_cycle(INTEGRATOR)
    assert amplitude == pytest.approx(GAIN * LEVEL * DEAD_TIME, rel=1e-3)
    assert period == pytest.approx(4.0 * DEAD_TIME, rel=1e-3)


@pytest.mark.parametrize("epsilon", [0.1, 0.6])
def test_limit_cycle_of_an_integrator_with_hysteresis(epsilon):
    amplitude, period = limit_cycle(INTEGRATOR, hysteresis=epsilon)
    assert amplitude == pytest.approx(epsilon + GAIN * LEVEL * DEAD_TIME, rel=1e-3)
    assert period == pytest.approx(4.0 * (DEAD_TIME + epsilon / (GAIN * LEVEL)), rel=1e-3)


def test_limit_cycle_of_a_first_order_lag():
    amplitude, period = limit_cycle(FIRST_ORDER)
    assert amplitude == pytest.approx(GAIN * LEVEL * (1.0 - np.exp(-DEAD_TIME / LAG)), rel=1e-3)
    assert period == pytest.approx(2.0 * LAG * np.log(2.0 * np.exp(DEAD_TIME / LAG) - 1.0), rel=1e-3)


# Relay ----------------------------------------------------------------------------------------------------------------


def relay_commands(law, errors):
    """Commands for a sequence of errors yd - y, y held at 0."""
    return [law.step([0.0], error)[0] for error in errors]


def test_a_relay_switches_outside_its_hysteresis_only():
    law = Relay(INTEGRATOR, [-1.0, 1.0], 0.1, hysteresis=0.5)
    errors = [0.4, 0.5, 0.51, 0.0, -0.5, -0.51, 0.5, 0.6]
    assert relay_commands(law, errors) == [-1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0]


def test_a_relay_with_a_dead_band_rests_within_it():
    law = Relay(INTEGRATOR, [-1.0, 0.0, 1.0], 0.1, deadband=1.0, hysteresis=0.25)
    errors = [1.2, 1.3, 0.8, 0.7, -1.2, -1.3, -0.8, -0.7, 2.0, -2.0]
    assert relay_commands(law, errors) == [0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, 0.0, 1.0, -1.0]


def test_lead_acts_on_the_slope_of_the_error():
    law = Relay(VALVE, [0.0, 1.0], 1e-3, lead=0.01)
    assert law.step([0.0, 0.0], [0.0, 5.0]) == [1.0]  # reference rising
    assert law.step([0.0, 9.0], [0.0, 5.0]) == [0.0]  # output rising faster


# Pulse widths ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "low", "high", "pulse"), [(0.3, 0, 1, 3), (1.6, 1, 4, 2), (1.0, 1, 4, 0), (-9, 0, 1, 0), (9, 1, 4, 10)]
)
def test_pulses_between_the_two_levels_that_bracket_what_is_wanted(wanted, low, high, pulse):
    law = PIPWM(INTEGRATOR, [0.0, 1.0, 4.0], 0.1, kp=0.0, bias=wanted, carrier=1.0)
    commands = [law.step([0.0], 0.0)[0] for _ in range(30)]
    assert commands == ([high] * pulse + [low] * (10 - pulse)) * 3


@pytest.mark.parametrize(("wanted", "pulse"), [(0.1, 0), (0.3, 4), (0.7, 7), (0.75, 7), (0.9, 10)])
def test_pulses_and_pauses_too_short_for_the_dwell_are_rounded_to_none_or_the_shortest(wanted, pulse):
    law = PIPWM(INTEGRATOR, [0.0, 1.0], 0.1, kp=0.0, bias=wanted, carrier=1.0, min_on=0.4, min_off=0.3)
    assert [law.step([0.0], 0.0)[0] for _ in range(20)] == ([1.0] * pulse + [0.0] * (10 - pulse)) * 2


def test_integral_action_leaves_no_offset_where_it_looks():
    """At the start of each pulse; the mean lies above by the ripple that it does not see."""
    law = PIPWM(OVEN, [0.0, 1.0], 1.0, kp=0.01, ki=1e-4, carrier=10.0)
    run = fsw.simulate(law, 40.0, 8000.0)
    assert run.y[4000::10].mean() == pytest.approx(40.0, abs=0.02)


def test_the_integral_does_not_wind_up():
    """Out of reach for long, then within reach: the input leaves its limit as soon as the error turns."""
    law = PIPWM(OVEN.replace(input_delay=0.0), [0.0, 1.0], 1.0, kp=0.05, ki=1e-3, carrier=10.0)
    run = fsw.simulate(law, fsw.Steps([0.0, 3000.0], [200.0, 40.0]), 3500.0)
    assert run.u[500:3000].all()
    assert not run.u[3010:3080].any()


def test_feedforward_carries_the_slope_of_the_reference():
    law = PIPWM(INTEGRATOR, [0.0, 1.0], 0.1, kp=0.0, kf=1.0 / GAIN, carrier=1.0)
    assert np.sum([law.step([0.0], [0.0, 0.6 * GAIN]) for _ in range(10)]) == 6.0


def test_derivative_action_uses_the_measured_slope_where_it_is_a_state():
    law = PIPWM(VALVE, [0.0, 1.0], 1e-3, kp=0.0, kd=0.1, bias=0.5, carrier=0.01)
    assert np.sum([law.step([0.0, 2.0], 0.0) for _ in range(10)]) == 3.0
    none = PIPWM(INTEGRATOR, [0.0, 1.0], 0.1, kp=0.0, kd=0.1, bias=0.5, carrier=1.0)
    assert np.sum([none.step([2.0], 0.0) for _ in range(10)]) == 5.0


# Smith predictor ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dead_time", [0.0, 20.0, 20.5])
def test_behind_a_smith_predictor_the_dead_time_changes_no_command(dead_time):
    """The model being exact, the commands are those of the plain law on the plant without dead time."""
    gains = {"kp": 0.05, "ki": 5e-4, "carrier": 10.0}
    free = PIPWM(OVEN.replace(input_delay=0.0), [0.0, 1.0], 1.0, **gains)
    behind = SmithPWM(OVEN.replace(input_delay=dead_time), [0.0, 1.0], 1.0, **gains)
    expected = fsw.simulate(free, 40.0, 900.0).u
    assert np.array_equal(fsw.simulate(behind, 40.0, 900.0).u, expected)
    assert len(level_runs(expected[:, 0])[0]) > 50


def test_a_smith_predictor_uses_the_measured_disturbance():
    plant = VALVE.replace(E=[[-1.0], [0.0]])
    runs = []
    for delay in (0.0, 0.005):
        kind = SmithPWM if delay else PIPWM
        law = kind(plant.replace(input_delay=delay), [0.0, 1.0], 1e-3, kp=2e-3, kd=1e-5, carrier=0.01)
        runs.append(fsw.simulate(law, 1000.0, 0.5, disturbance=1500.0))
    assert np.array_equal(runs[0].u, runs[1].u)


# Shared ---------------------------------------------------------------------------------------------------------------

LAWS = {
    "relay": (Relay, {"hysteresis": 0.01}),
    "PI": (PIPWM, {"kp": 0.5, "carrier": 0.7}),
    "Smith": (SmithPWM, {"kp": 0.5, "carrier": 0.7}),
}


@pytest.mark.parametrize("name", LAWS)
def test_dwell_holds_for_baselines_too(name):
    kind, gains = LAWS[name]
    law = kind(FIRST_ORDER, [0.0, 1.0], 0.1, min_on=0.5, min_off=0.3, **gains)
    run = fsw.simulate(law, fsw.Sine(1.0, 0.2, offset=1.5), 200.0, noise=0.05, seed=1)
    lengths, values = level_runs(run.u[:, 0])
    inner = slice(1, -1)
    assert len(lengths) > 50
    assert (lengths[inner] >= np.where(values[inner] == 0.0, 3, 5)).all()


@pytest.mark.parametrize("name", LAWS)
def test_a_bad_measurement_keeps_the_command_and_leaves_no_trace(name):
    """Whole carrier periods of it, so that one begins with a bad sample."""
    kind, gains = LAWS[name]
    law, spared = (kind(FIRST_ORDER, [0.0, 1.0], 0.1, **gains) for _ in range(2))
    for _ in range(7):
        present = law.step([0.0], 2.0)
        assert spared.step([0.0], 2.0) == present == 1.0
    for bad in 7 * [np.nan, np.inf, -np.inf]:
        assert law.step([bad], -2.0) == present
    if name != "Smith":  # whose model goes on by itself
        for y in np.linspace(0.0, 4.0, 30):
            assert law.step([y], 2.0) == spared.step([y], 2.0)


@pytest.mark.parametrize("name", LAWS)
def test_reset_and_copy_start_afresh(name):
    kind, gains = LAWS[name]
    law = kind(FIRST_ORDER, [0.0, 1.0], 0.1, **gains)
    first = fsw.simulate(law, RISE, 3.0)
    commands = [law.step([0.1 * i], 1.0)[0] for i in range(20)]
    assert np.array_equal(fsw.simulate(law, RISE, 3.0).u, first.u)
    law.reset()
    assert [law.step([0.1 * i], 1.0)[0] for i in range(20)] == commands


def test_a_baseline_told_the_reference_ahead_samples_it_there():
    law = Relay(VALVE, [0.0, 1.0], 1e-3, preview=0.25)
    assert law.reference_times.tolist() == [0.25]
    run = fsw.simulate(law, fsw.Steps([0.0, 0.5], [0.0, 100.0]), 0.4)
    assert run.u[:250].sum() == 0
    assert run.u[251, 0] == 1


@pytest.mark.parametrize("kind", [Relay, PIPWM, SmithPWM])
def test_tuning_is_repeatable_and_beats_a_guess(kind):
    budget = {"budget": 60, "seed": 4}
    first, again = (tune(kind, VALVE, [0.0, 1.0], 1e-3, RISE, 0.6, **budget) for _ in range(2))
    assert first.parameters == again.parameters
    assert first.rms_error == pytest.approx(first.run.metrics()["rms_error"])
    assert 40 <= first.evaluations <= 80
    assert first.rms_error < 60.0  # kPa on a rise of 1000; leaving the valve shut gives 740
