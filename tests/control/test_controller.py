"""The controller: what it decides, what its caller may give and tell, and memory that can be moved."""

import copy
import pickle

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch import Status
from foreswitch.model import prediction
from systems import MASS, OVEN, RISE, TWO_BY_TWO, VALVE, exact_state, quiet, valve_controller

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


# Periods in which step does not choose --------------------------------------------------------------------------------


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
