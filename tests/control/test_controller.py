"""The controller: the dead time changes no command, bad measurements are survived, memory can be moved."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import foreswitch as fsw
from foreswitch import Status
from foreswitch.model import prediction
from systems import MASS, OVEN, RISE, TWO_BY_TWO, VALVE, exact_state, quiet, valve_controller

# The dead time is removed exactly -------------------------------------------------------------------------------------

Ts = 0.1
rate = st.floats(0.05, 5.0)
DENOMINATORS = st.one_of(
    st.tuples(rate).map(lambda p: np.poly([-p[0]])),
    st.tuples(rate, rate).map(lambda p: np.poly([-p[0], -p[1]])),
    st.tuples(rate, rate).map(lambda p: np.poly([-p[0] + 1j * p[1], -p[0] - 1j * p[1]]).real),
    st.tuples(rate).map(lambda p: np.poly([0.0, -p[0]])),
    st.just(np.array([1.0, 0.0, 0.0])),
    st.tuples(rate, rate).map(lambda p: np.poly([0.0, -p[0] + 1j * p[1], -p[0] - 1j * p[1]]).real),
)


def near_tie(controller, run, k):
    """Whether the two best candidates of step k of a run differ by round-off only."""
    probe = controller.copy()
    told = RISE_AND_FALL(run.t, probe.order)
    for i in range(k):
        probe.step(run.x[i], told[i])
    best, second = np.sort(probe.decide(run.x[k], told[k]).costs)[:2]
    return second - best < 1e-9 * max(second, 1e-12)


RISE_AND_FALL = fsw.Sine(amplitude=0.83, frequency=0.0937, offset=0.21, phase=0.31)


@given(
    den=DENOMINATORS,
    dead_time=st.one_of(st.integers(0, 12).map(lambda d: round(d * Ts, 10)), st.floats(0.0, 1.2)),
    Td=st.floats(0.1, 1.5),
    lam=st.floats(0.5, 20.0),
    levels=st.sampled_from([[0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 0.4, 2.0]]),
    tail=st.sampled_from(["rest", "zero"]),
)
def test_the_dead_time_shifts_the_response_and_changes_no_command(den, dead_time, Td, lam, levels, tail):
    """Exact model, causal reference, start at rest: x(t + dead time) is what it would be without dead time."""
    free = fsw.Plant.from_tf([float(np.abs(den).max())], den)
    delayed = free.replace(input_delay=dead_time)
    objective = fsw.Endpoint(Td, lam, tail=tail)
    at_once = fsw.Controller(free, levels, Ts, objective)
    expected = fsw.simulate(at_once, RISE_AND_FALL, 12.0)
    run = fsw.simulate(fsw.Controller(delayed, levels, Ts, objective), RISE_AND_FALL, 12.0)
    different = np.flatnonzero((run.u != expected.u).any(axis=1))
    assume(not different.size or not near_tie(at_once, expected, different[0]))
    assert not different.size
    assume(len(np.unique(expected.u)) > 1)  # some horizons suit no oscillator, and nothing is switched
    shift = round(dead_time / Ts)
    if abs(shift * Ts - dead_time) < 1e-12:
        scale = np.abs(expected.x).max(axis=0)
        assert run.x[shift:] / scale == pytest.approx(expected.x[: len(run.x) - shift] / scale, abs=1e-9)
        assert run.x[: shift + 1] / scale == pytest.approx(0.0, abs=1e-12)


def test_a_prediction_that_leaves_the_dead_time_out_is_not_invariant():
    """The counterpart: the test above could fail."""
    blind = fsw.simulate(valve_controller(VALVE.replace(input_delay=0.0)), RISE, 0.6, plant=VALVE)
    assert not np.array_equal(blind.u, fsw.simulate(valve_controller(), RISE, 0.6).u)


# Bad measurements -----------------------------------------------------------------------------------------------------

BAD = [[np.nan, 0.0], [0.0, np.inf], [-np.inf, np.nan], [1e300, 0.0]]


@pytest.mark.parametrize("plant", [VALVE, VALVE.replace(input_delay=0.0), VALVE.replace(input_delay=0.0053)])
@pytest.mark.parametrize("bad", BAD)
def test_the_prediction_stands_in_for_bad_measurements(plant, bad):
    """The model being exact, coasting through bad samples changes no command."""
    controller = valve_controller(plant)
    run = fsw.simulate(controller, RISE, 0.3)
    told = RISE(run.t, controller.order)
    for k in range(300):
        good = k < 80 or k % 7 == 0
        u = controller.step(run.x[k] if good else bad, told[k])
        assert controller.status == (Status.OK if good else Status.COASTING)
        assert u == run.u[k]


def test_the_last_good_disturbance_stands_in_for_a_bad_one():
    plant = VALVE.replace(E=[[-1.0], [0.0]])
    seeing, blind = valve_controller(plant), valve_controller(plant)
    for k in range(40):
        expected = seeing.step([20.0, 30.0], 60.0, disturbance=[700.0])
        u = blind.step([20.0, 30.0], 60.0, disturbance=[700.0 if k == 0 else np.nan])
        assert blind.status == (Status.COASTING if k else Status.OK)
        assert u == expected


def test_before_any_good_measurement_the_command_is_held():
    controller = valve_controller()
    controller.reset(pending=[0, 0, 0, 0, 1])
    for _ in range(30):
        assert controller.step([np.nan, 0.0], 0.0) == [1.0]
        assert controller.status == Status.HELD
    controller.step([0.0, 0.0], 0.0)
    assert controller.status == Status.OK
    controller.step([np.nan, 0.0], 0.0)
    assert controller.status == Status.COASTING
    controller.reset()
    controller.step([np.nan, 0.0], 0.0)
    assert controller.status == Status.HELD


@pytest.mark.parametrize("safe", [0.0, 1.0])
def test_after_bad_limit_samples_comes_the_safe_level(safe):
    controller = valve_controller(safe_level=safe, bad_limit=4)
    expected = [(Status.OK, 10.0)] + [(Status.COASTING, np.nan)] * 3 + [(Status.SAFE, np.nan)] * 3
    for status, value in [*expected, (Status.OK, 10.0), (Status.COASTING, np.nan)]:
        u = controller.step([value, 0.0], 1000.0 * (1.0 - safe))  # the wish: the other level
        assert controller.status == status
        assert u == [safe if status == Status.SAFE else 1.0 - safe]


def test_without_a_declared_safe_level_a_controller_coasts_on():
    controller = valve_controller(bad_limit=4)
    controller.step([0.0, 0.0], 1e6)
    for _ in range(50):
        assert controller.step([np.nan, 0.0], 1e6) == [1.0]
        assert controller.status == Status.COASTING


def test_a_bad_first_measurement_counts_towards_the_limit():
    controller = valve_controller(safe_level=0.0, bad_limit=3)
    statuses = []
    for _ in range(4):
        controller.step([np.nan, np.nan], 1000.0)
        statuses.append(controller.status)
    assert statuses == [Status.HELD, Status.HELD, Status.SAFE, Status.SAFE]


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_a_finite_reference_beyond_the_arithmetic_holds_the_command(real):
    controller = valve_controller(real=real)
    assert controller.step([0.0, 0.0], 1000.0) == [1.0]
    assert controller.decide([0.0, 0.0], 1e300).status == Status.HELD
    assert controller.step([0.0, 0.0], 1e300) == [1.0]
    assert controller.status == Status.HELD


def test_every_status_has_a_remedy():
    for status in Status:
        assert status.remedy.endswith(".")
        assert "\n" not in status.remedy


# Decisions ------------------------------------------------------------------------------------------------------------


def settings():
    """Controllers that between them use every option."""
    two = {"levels": [[0, 1, 2], [-1, 1]], "Ts": 0.1, "objective": fsw.Endpoint(0.5, 1.0)}
    options = {"min_on": [0.2, 0.3], "switch_cost": 0.01, "forbidden": [(2, 1)], "safe_level": [0, 1], "bad_limit": 3}
    yield valve_controller()
    yield valve_controller(real="float32")
    yield fsw.Controller(TWO_BY_TWO, **two, **options)
    yield fsw.Controller(MASS, [-1, 0, 1], 0.1, fsw.Endpoint(0.6, 3.0), preview="lag", min_off=0.2)


CONTROLLERS = list(settings())


def inputs(controller, seed, count=40):
    """Measured states (some bad) and references."""
    rng = np.random.default_rng(seed)
    n, q = controller.plant.states, controller.plant.outputs
    for _ in range(count):
        x = rng.standard_normal(n)
        if rng.random() < 0.2:
            x[rng.integers(n)] = np.nan
        yield x, rng.standard_normal((1, q, controller.order))


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_decide_tells_what_step_does_and_changes_no_byte(controller):
    controller = controller.copy()
    for x, reference in inputs(controller, 1):
        before = controller.core.save()
        decision = controller.decide(x, reference)
        assert controller.core.save() == before
        assert np.array_equal(controller.step(x, reference), decision.u)
        assert controller.status == decision.status
        assert np.array_equal(decision.sequence, decision.u[None])
        if decision.status in (Status.OK, Status.COASTING):
            allowed = np.isfinite(decision.costs)
            assert decision.optimal
            assert decision.gap == 0.0
            assert decision.nodes == len(decision.candidates)
            assert decision.cost == decision.costs[allowed].min()
            assert decision.u.tolist() in decision.candidates[allowed].tolist()
        else:
            assert not decision.optimal
            assert np.isinf(decision.costs).all()


@pytest.mark.parametrize(
    ("present", "reference", "command"), [(-1, 0.0, -1), (1, 0.0, 1), (2, 0.0, -1), (2, 0.75, 2), (-1, 0.75, 1)]
)
def test_equal_costs_keep_the_present_command_or_take_the_lower_index(present, reference, command):
    integrator = fsw.Plant([[0.0]], [[1.0]])  # numbers exact in binary
    controller = fsw.Controller(integrator, [-1, 1, 2], 0.5, fsw.Endpoint(0.5, 1.0))
    controller.reset(pending=[present])
    costs = controller.decide([0.0], reference).costs
    assert np.sum(costs == costs.min()) == 2
    assert controller.step([0.0], reference) == [command]


def moved(controller, how):
    return {
        "copy": lambda: controller.copy(),
        "copy module": lambda: copy.copy(controller),
        "deepcopy": lambda: copy.deepcopy(controller),
        "pickle": lambda: pickle.loads(pickle.dumps(controller)),
    }[how]()


@pytest.mark.parametrize("how", ["copy", "copy module", "deepcopy", "pickle"])
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_copy_continues_where_the_original_stood_and_apart_from_it(controller, how):
    original = controller.copy()
    for x, reference in inputs(original, 2, 13):
        original.step(x, reference)
    twin = moved(original, how)
    assert twin.core.save() == original.core.save()
    assert twin.status == original.status
    assert repr(twin) == repr(original)
    assert np.array_equal(twin.reference_times, original.reference_times)
    ahead = [twin.step(x, reference).tolist() for x, reference in inputs(original, 3)]  # the original stays behind
    assert [original.step(x, reference).tolist() for x, reference in inputs(original, 3)] == ahead


def test_simulate_leaves_the_controller_as_it_was():
    controller = valve_controller()
    controller.step([0.0, 0.0], 1e3)
    before = controller.core.save()
    fsw.simulate(controller, RISE, 0.1)
    assert controller.core.save() == before


def test_a_step_in_the_loop_is_a_step_by_hand():
    """simulate hands the core what a caller would: state, sampled reference, disturbance."""
    plant = VALVE.replace(E=[[-1.0], [0.0]], input_delay=0.0047)
    controller = valve_controller(plant, preview=0.004)
    w = 300.0 + 200.0 * np.sin(np.arange(200) / 9.0)
    run = fsw.simulate(controller, RISE, 0.2, disturbance=w)
    for k in range(200):
        told = RISE(run.t[k] + 0.004, controller.order)
        assert controller.step(run.x[k], told, disturbance=[w[k]]) == run.u[k]


# What the caller gives ------------------------------------------------------------------------------------------------


def test_short_forms_of_a_reference_mean_what_they_abbreviate():
    one, two = valve_controller(), fsw.Controller(TWO_BY_TWO, [[0, 1], [0, 1]], 0.1, fsw.Endpoint(0.5, 1.0))
    for short, full in [
        (3, [[[3, 0]]]),
        (3.0, [[[3, 0]]]),
        ([3.0], [[[3, 0]]]),
        ([3, 4], [[[3, 4]]]),
        (np.array([3.0, 4.0]), [[[3, 4]]]),
        ([[3, 4]], [[[3, 4]]]),
    ]:
        assert np.array_equal(one.decide([0, 0], short).costs, one.decide([0, 0], np.array(full, float)).costs)
        assert one.copy().step([0, 0], short) == one.copy().step([0, 0], full)
    for short, full in [(3.0, [[[3], [3]]]), ([3, 4], [[[3], [4]]]), ([[3], [4]], [[[3], [4]]])]:
        assert np.array_equal(two.decide([0, 0, 0], short).costs, two.decide([0, 0, 0], full).costs)
        assert np.array_equal(two.copy().step([0, 0, 0], short), two.copy().step([0, 0, 0], full))


def test_what_the_caller_must_supply_is_told():
    third = fsw.Plant.from_tf([1.0], [1.0, 1.0, 1.0, 0.0], input_delay=0.25)
    controller = fsw.Controller(third, [-1, 1], 0.1, fsw.Endpoint(0.7, 2.0), preview=True)
    assert (controller.order, controller.evaluations, controller.pending_steps) == (3, 1, 3)
    assert controller.reference_times == pytest.approx([0.95])
    assert controller.relative_degree.tolist() == [3]


def test_a_given_relative_degree_is_used():
    controller = fsw.Controller(VALVE, [0, 1], 1e-3, fsw.Endpoint(0.02, 2500.0, relative_degree=1))
    assert controller.order == 1


@pytest.mark.parametrize("levels", [[0, 1], (0, 1), np.array([0, 1]), [[0, 1]], np.array([[0.0, 1.0]])])
def test_levels_of_one_input_in_any_form(levels):
    controller = fsw.Controller(VALVE, levels, 1e-3, fsw.Endpoint(0.02, 2500.0))
    assert [values.tolist() for values in controller.levels] == [[0.0, 1.0]]


def test_forbidden_commands_are_never_given():
    options = {"forbidden": [(1, 1), (0, 1)]}
    controller = fsw.Controller(TWO_BY_TWO, [[0, 1], [0, 1]], 0.1, fsw.Endpoint(0.5, 1.0), **options)
    assert controller.decide([0, 0, 0], 0.0).candidates.tolist() == [[0, 0], [1, 0]]
    commands = [controller.step(x, reference).tolist() for x, reference in inputs(controller, 4)]
    assert {tuple(u) for u in commands} == {(0.0, 0.0), (1.0, 0.0)}


def test_commands_under_way_are_counted_in():
    """With a history, the choice at rest is that of a state the history would have led to without dead time."""
    history = [0, 1, 1, 0, 1]
    delayed, free = valve_controller(), valve_controller(VALVE.replace(input_delay=0.0))
    delayed.reset(pending=history)
    free.reset(pending=history[-1:])
    arrived = exact_state(VALVE.replace(input_delay=0.0), np.zeros(2), 1e-3, ([0], history), 0.005)
    for reference in (20.0, 30.0, 45.0, 60.0):
        costs = free.decide(arrived, reference).costs
        assert delayed.decide([0.0, 0.0], reference).costs == pytest.approx(costs, rel=1e-9)


@pytest.mark.parametrize(
    ("levels", "safe_level", "expected"),
    [([-1, 0, 1], None, 0), ([0.3, 2], None, 0.3), ([-1, 1], None, -1), ([-2, 1], None, 1), ([-1, 0, 1], 1, 1)],
)
def test_the_default_of_what_is_under_way_is_the_safe_level(levels, safe_level, expected):
    controller = fsw.Controller(OVEN, levels, 10.0, fsw.Endpoint(20.0, 1.0), safe_level=safe_level)
    assert controller.issued.tolist() == [[expected]] * 3


def test_a_longer_history_than_needed_is_cut_and_a_shorter_one_extended():
    controller = fsw.Controller(OVEN, [0, 1, 2], 10.0, fsw.Endpoint(20.0, 1.0))
    controller.reset(pending=[0, 0, 1, 2, 1])
    assert controller.issued.ravel().tolist() == [1, 2, 1]
    controller.reset(pending=[2, 1])
    assert controller.issued.ravel().tolist() == [2, 2, 1]


def test_a_switch_cost_lowers_the_number_of_switches():
    switches = [
        fsw.simulate(valve_controller(switch_cost=cost), RISE, 0.6).metrics()["switches"] for cost in (0.0, 60.0, 400.0)
    ]
    assert switches[0] > switches[1] > switches[2] > 0


def test_an_unreachable_reference_is_no_error():
    run = fsw.simulate(quiet(fsw.Controller, OVEN, [0.0, 1.0], 1.0, fsw.Endpoint(30.0, 1.0)), 500.0, 2000.0)
    assert run.u.all()
    assert run.y[-1, 0] == pytest.approx(100.0)


@pytest.mark.parametrize(("real", "far"), [("float64", 1e160), ("float32", 1e20)])
def test_costs_that_overflow_hold_the_command_and_say_so(real, far):
    plant = fsw.Plant.integrator_lag(16500.0, 0.006, 0.005)
    controller = fsw.Controller(plant, [0, 1], 1e-3, fsw.Endpoint(0.02, 2500.0), real=real)
    assert controller.step([0.0, 0.0], 100.0) == 1.0
    assert controller.decide([-far, 0.0], 0.0).status == fsw.Status.HELD
    assert controller.step([-far, 0.0], 0.0) == 1.0
    assert controller.status == fsw.Status.HELD
    controller.step([0.0, 0.0], 100.0)
    assert controller.status == fsw.Status.OK


# Periods in which step does not choose ------------------------------------------------------------------------------


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_who_is_told_each_command_stands_where_the_one_who_chose_it_does(controller):
    chooser, follower = controller.copy(), controller.copy()
    for x, reference in inputs(controller, 5):
        u = chooser.step(x, reference)
        follower.track(u, x)
    status = slice(1, None)  # of the latest step: the follower took none
    assert follower.core.save()[status] == chooser.core.save()[status]


def observer(real="float64"):
    """The pressure alone is measured."""
    kalman = fsw.Kalman([0.0, 1e2], 1.0, load=1e-9)
    return fsw.Controller(VALVE, [0, 1], 1e-3, fsw.Endpoint(0.020, 2500.0), estimator=kalman, min_on=0.003, real=real)


def by_hand(commands, x):
    """The valve's exact state after each of so many periods; five periods of dead time."""
    model = prediction.period_model(VALVE, 1e-3)
    line = [0.0] * 5 + list(commands)
    for k in range(len(commands)):
        x = model.transition @ x + model.old[0] * line[k]
        yield x


def test_the_estimate_stays_true_while_an_operator_commands():
    told, untold = observer(), observer()
    commands = [float((k // 7) % 2) for k in range(60)]
    x = np.zeros(2)
    for u, following in zip(commands, by_hand(commands, x), strict=True):
        told.track([u], x[:1])
        untold.step(x[:1], 0.0)
        x = following
    assert told.estimate[0][0] == pytest.approx(x[0], abs=20.0)
    for controller in (told, untold):
        controller.step(x[:1], x[0])
    assert told.estimate[0] == pytest.approx(x, rel=1e-6)
    assert untold.estimate[0] != pytest.approx(x, rel=1e-3)
    assert told.issued.ravel()[-6:-1].tolist() == commands[-5:]


def test_missed_periods_are_those_of_the_command_in_force():
    controller, other = observer(), observer()
    x, commands = np.zeros(2), [1.0] * 12
    truth = [x, *by_hand(commands, x)]
    for k in range(4):
        controller.track([1.0], truth[k][:1])
        other.track([1.0], truth[k][:1])
    controller.missed(7)
    for _ in range(7):
        other.track([1.0])
    assert controller.core.save() == other.core.save()
    controller.step(truth[11][:1], 0.0)
    assert controller.estimate[0] == pytest.approx(truth[11], rel=1e-9)
    assert controller.bad_samples == (0, 0)


def test_the_safe_level_overrides_a_dwell_at_once():
    controller = observer()
    assert controller.step([0.0], 1e3).tolist() == [1.0]
    assert controller.step([0.0], -1e6).tolist() == [1.0], "on for three periods at least"
    assert controller.safe([0.0]).tolist() == [0.0]
    assert controller.status == Status.SAFE
    assert controller.issued.ravel()[-3:].tolist() == [1.0, 1.0, 0.0]
    assert controller.safe().tolist() == [0.0], "also without a measurement"
    assert controller.step([0.0], 1e3).tolist() == [1.0], "no dwell at the safe level"


def test_bad_samples_are_counted_in_a_row_and_in_total():
    controller = observer()
    for y, expected in ((0.0, (0, 0)), (np.nan, (1, 1)), (np.inf, (2, 2)), (0.0, (0, 2)), (np.nan, (1, 3))):
        controller.step([y], 0.0)
        assert controller.bad_samples == expected
    controller.track([0.0], [np.nan])
    assert controller.bad_samples == (2, 4)
    controller.reset()
    assert controller.bad_samples == (0, 0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c: c.track([0.5]), "command holds 0.5"),
        (lambda c: c.track([0.0, 1.0]), "give one level for each of 1 input"),
        (lambda c: c.track([0.0], [1.0, 2.0]), "x has shape"),
        (lambda c: c.safe([1.0, 2.0]), "x has shape"),
        (lambda c: c.missed(-1), "periods is -1"),
        (lambda c: c.missed(70000), "reset after a longer silence"),
        (lambda c: c.missed(1.5), "periods is 1.5"),
    ],
)
def test_what_was_issued_must_be_a_level_and_periods_a_number(call, words):
    controller = observer()
    before = controller.core.save()
    with pytest.raises(ValueError, match=words):
        call(controller)
    assert controller.core.save() == before


def test_a_forbidden_candidate_costs_infinity_whatever_the_weight():
    """Half of a weight that vanishes in the arithmetic is zero."""
    objective = fsw.Endpoint(Td=0.020, lam=2500.0, weight=1e-50)
    law = fsw.Controller(VALVE, [0, 1], 1e-3, objective, min_on=0.01, real="float32")
    law.step([0.0, 0.0], 100.0)
    assert law.decide([0.0, 0.0], 0.0).costs.tolist() == [np.inf, 0.0]
