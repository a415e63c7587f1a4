"""What people use today: exact limit cycles of relays, pulse widths, and the Smith predictor's own invariance."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.baselines import PIPWM, Relay, SmithPWM, tune
from foreswitch.project import Project
from places import EXAMPLES
from systems import OVEN, RISE, TWO_BY_TWO, VALVE, level_runs

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


@pytest.mark.parametrize("name", LAWS)
def test_bad_samples_at_the_very_start_leave_no_trace(name):
    """The Smith predictor's models would otherwise start from them, and never forget."""
    kind, gains = LAWS[name]
    law, spared = (kind(FIRST_ORDER, [0.0, 1.0], 0.1, **gains) for _ in range(2))
    assert [law.step([bad], 2.0)[0] for bad in (np.nan, np.inf, np.nan)] == [0.0] * 3
    commands = [law.step([y], 2.0)[0] for y in np.linspace(0.0, 3.0, 60)]
    assert commands == [spared.step([y], 2.0)[0] for y in np.linspace(0.0, 3.0, 60)]
    assert set(commands) == {0.0, 1.0}


@pytest.mark.parametrize("name", LAWS)
def test_without_a_sample_at_the_start_the_output_still_arrives(name):
    kind, gains = LAWS[name]
    law = kind(FIRST_ORDER, [0.0, 1.0], 0.1, **gains | ({} if kind is Relay else {"ki": 0.3}))
    run = fsw.simulate(law, 1.5, 60.0, hardware=fsw.Hardware(outages=[(0.0, 0.95)]))
    assert not run.u[:9].any()
    assert run.u[10] == 1.0
    assert run.y[300:].mean() == pytest.approx(1.5, abs=0.3)


def test_a_bad_disturbance_does_not_stay_in_the_smith_predictor():
    plant = FIRST_ORDER.replace(E=[[1.0]])
    law, spared = (SmithPWM(plant, [0.0, 1.0], 0.1, kp=0.5, carrier=0.7) for _ in range(2))
    for bad in (np.nan, np.inf, -np.inf):
        assert law.step([0.5], 1.5, disturbance=[bad]) == spared.step([0.5], 1.5, disturbance=[0.0])
    for y in np.linspace(0.5, 2.0, 40):
        assert law.step([y], 1.5, disturbance=[0.3]) == spared.step([y], 1.5, disturbance=[0.3])


def test_a_smith_predictor_names_the_unstable_pole_it_refuses():
    plant = fsw.Plant([[-50.0, 0.0], [0.0, 2.5]], [[1.0], [1.0]], [[1.0, 1.0]])
    with pytest.raises(ValueError, match=r"unstable pole 2\.5;"):
        SmithPWM(plant, [0.0, 1.0], 0.1, kp=1.0, carrier=0.1)


@pytest.mark.parametrize("name", LAWS)
def test_a_plant_of_negative_gain_is_driven_the_other_way(name):
    """Its mirror image: the same commands for the mirrored task."""
    kind, gains = LAWS[name]
    mirrored = FIRST_ORDER.replace(B=-FIRST_ORDER.B)
    expected = fsw.simulate(kind(FIRST_ORDER, [0.0, 1.0], 0.1, **gains), fsw.Sine(0.7, 0.05, offset=1.5), 60.0)
    run = fsw.simulate(kind(mirrored, [0.0, 1.0], 0.1, **gains), fsw.Sine(-0.7, 0.05, offset=-1.5), 60.0)
    assert np.array_equal(run.u, expected.u)
    assert np.array_equal(run.y, -expected.y)
    assert len(level_runs(run.u[:, 0])[0]) > 20


# Several inputs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("band", [0.0, 1.5])
def test_a_relay_for_each_leg_of_an_inverter_acts_on_the_error_of_its_own_phase(band):
    """Row by row the pseudo-inverse points where the leg pushes, 120 degrees apart: the usual current controller."""
    project = Project.read(EXAMPLES / "inverter/project.toml")
    law = Relay(project.plant, [[0, 1]] * 3, 5e-5, hysteresis=band, preview=1e-4)
    run = project.simulate(law)
    wanted = project.reference(run.t[:-1] + 1e-4, 1)[:, :, 0]
    error = wanted - run.y[:-1]
    level, clear = np.zeros(3), 0
    for k in range(len(run.u)):
        for leg in range(3):
            angle = 2.0 * np.pi / 3.0 * leg
            own = error[k, 0] * np.cos(angle) + error[k, 1] * np.sin(angle)
            if abs(abs(own) - band) < 1e-6:  # B in the file is rounded
                level[leg] = run.u[k, leg]
                continue
            clear += 1
            level[leg] = 1.0 if own > band else 0.0 if own < -band else level[leg]
        assert np.array_equal(run.u[k], level), k
    assert clear > 3590
    assert (np.count_nonzero(np.diff(run.u, axis=0), axis=0) > 60).all()


@pytest.mark.parametrize("kind", [Relay, PIPWM, SmithPWM])
def test_fill_and_vent_are_never_open_at_once(kind):
    """Dwell makes the combination tempting: a valve that must stay open while the other one is wanted."""
    project = Project.read(EXAMPLES / "chamber/project.toml")
    gains = {} if kind is Relay else {"kp": 0.02, "ki": 0.2, "bias": 0.0, "carrier": 0.01}
    free = kind(project.plant, [[0, 1], [0, 1]], 1e-3, min_on=0.008, **gains)
    kept = kind(project.plant, [[0, 1], [0, 1]], 1e-3, min_on=0.008, forbidden=[[1, 1]], **gains)
    tempted, run = project.simulate(free), project.simulate(kept)
    assert (tempted.u.sum(axis=1) == 2).any()
    assert run.u.sum(axis=1).max() == 1
    for j in range(2):
        lengths, values = level_runs(run.u[:, j])
        assert (lengths[1:-1][values[1:-1] == 1.0] >= 8).all()
        assert (values == 1.0).sum() > 10
    assert run.metrics()["rms_error"] < 60.0


@pytest.mark.parametrize("name", LAWS)
def test_dwell_holds_on_each_of_two_inputs(name):
    kind, gains = LAWS[name]
    levels = [[0.0, 1.0], [-0.5, 0.0, 2.0]]
    gains = gains if kind is Relay else {"kp": 0.6, "ki": 0.8, "carrier": 1.3}
    law = kind(TWO_BY_TWO, levels, 0.1, min_on=[0.5, 0.3], min_off=[0.2, 0.4], safe_level=[0.0, 0.0], **gains)
    wave = fsw.Stack(fsw.Sine(0.8, 0.11, offset=0.6), fsw.Sine(0.5, 0.07, offset=0.4, phase=1.0))
    run = fsw.simulate(law, wave, 150.0, noise=0.05, seed=1)
    for j, (on, off) in enumerate([(5, 2), (3, 4)]):
        lengths, values = level_runs(run.u[:, j])
        assert len(lengths) > 30
        assert (lengths[1:-1] >= np.where(values[1:-1] == 0.0, off, on)).all()


# Tuning ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Relay, PIPWM, SmithPWM])
def test_tuning_is_repeatable_and_beats_a_guess(kind):
    budget = {"budget": 60, "seed": 4}
    first, again = (tune(kind, VALVE, [0.0, 1.0], 1e-3, RISE, 0.6, **budget) for _ in range(2))
    assert first.parameters == again.parameters
    assert first.rms_error == pytest.approx(first.run.metrics()["rms_error"])
    assert 40 <= first.evaluations <= 80
    assert first.rms_error < 60.0  # kPa on a rise of 1000; leaving the valve shut gives 740


def test_every_kind_gets_the_same_number_of_runs():
    budget = 130
    task = (OVEN, [0.0, 1.0], 2.0, fsw.Steps([0.0, 400.0], [30.0, 60.0]), 800.0)
    counts = [tune(kind, *task, budget=budget).evaluations for kind in (Relay, PIPWM, SmithPWM)]
    assert counts == pytest.approx([budget] * 3, rel=0.1)


@pytest.mark.parametrize("kind", [Relay, PIPWM, SmithPWM])
@pytest.mark.parametrize("search_seed", [0, 1])
def test_tuning_is_never_worse_than_where_it_starts(kind, search_seed):
    """Here nothing beats u = yd / gain at once, which the default gain of one over one nearly is."""
    plant = fsw.Plant([[-0.2]], [[0.2]])
    gains = {} if kind is Relay else {"kp": 1.0, "carrier": 0.2}
    first = fsw.simulate(kind(plant, [0.0, 1.0], 0.1, **gains), 0.5, 30.0)
    best = tune(kind, plant, [0.0, 1.0], 0.1, 0.5, 30.0, budget=65, search_seed=search_seed)
    assert best.rms_error <= first.metrics()["rms_error"] * 1.1  # what was out of the search's box was brought into it


def test_tuning_is_judged_against_the_truth():
    truth = OVEN.replace(B=0.7 * OVEN.B, input_delay=30.0)
    task = (OVEN, [0.0, 1.0], 2.0, 50.0, 800.0)
    best = tune(PIPWM, *task, budget=65, truth=truth)
    again = fsw.simulate(best.law, 50.0, 800.0, plant=truth)
    assert best.law.plant is OVEN
    assert best.run.plant is truth
    assert np.array_equal(again.y, best.run.y)
    assert best.rms_error == pytest.approx(again.metrics()["rms_error"])
    assert best.rms_error != tune(PIPWM, *task, budget=65).rms_error
    assert {name: getattr(best.law, name) for name in best.parameters} == best.parameters


def test_a_known_reference_may_be_used_ahead():
    task = (VALVE, [0.0, 1.0], 1e-3, RISE, 0.6)
    told, late = (tune(Relay, *task, budget=100, preview=preview) for preview in (0.02, 0.0))
    assert 0.0 <= told.parameters["preview"] <= 0.02
    assert told.law.reference_times == pytest.approx([told.parameters["preview"]])
    assert "preview" not in late.parameters
    assert np.array_equal(fsw.simulate(told.law, RISE, 0.6).u, told.run.u)
