"""Dwell: no run at a level is ever shorter than it may be, whatever happens."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import foreswitch as fsw
from foreswitch import Status
from systems import MASS, RISE, level_runs, quiet, valve_controller

INTEGRATOR = fsw.Plant([[0.0]], [[1.0]])


def restless(levels=(0.0, 1.0), Ts=0.1, **options):
    """A controller that can be made to want either end of its levels: see `wish`."""
    return quiet(fsw.Controller, INTEGRATOR, list(levels), Ts, fsw.Endpoint(Ts, 1.0), **options)


def wish(controller, highest):
    """A step in which the highest level is best, or the lowest."""
    return controller.step([0.0], 1e3 if highest else -1e3)[0]


def lengths_when_always_wanting_the_other(controller, steps=60):
    """Lengths of the inner runs off and on of a controller that wants to switch at every step."""
    present, commands = controller.issued[-1, 0], []
    for _ in range(steps):
        present = wish(controller, present <= 0.0)
        commands.append(present)
    lengths, values = level_runs(commands)
    inner = slice(1, -1)
    return lengths[inner][values[inner] <= 0.0].tolist(), lengths[inner][values[inner] > 0.0].tolist()


# The law of dwell -----------------------------------------------------------------------------------------------------

duration = st.one_of(st.just(0.0), st.integers(1, 6).map(lambda k: round(0.1 * k, 10)), st.floats(0.0, 0.7))
LEVELS = [[0.0, 1.0], [-1.0, 0.0, 1.0], [0.5, 2.0], [-2.0, -1.0, 3.0, 4.0]]


@st.composite
def histories(draw):
    """Inputs with levels, dwell and elapsed times, dead times, and when to reboot."""
    inputs = draw(st.integers(1, 2))
    each = [{name: draw(duration) for name in ("min_on", "min_off", "elapsed", "delay")} for _ in range(inputs)]
    case = {name: [item[name] for item in each] for name in each[0]}
    case["levels"] = [draw(st.sampled_from(LEVELS)) for _ in range(inputs)]
    case["start"] = [draw(st.sampled_from(levels)) for levels in case["levels"]]
    case["reboots"] = draw(st.sets(st.integers(1, 59), max_size=3))
    case["seed"] = draw(st.integers(0, 2**16))
    return case


@given(histories())
def test_no_run_is_shorter_than_its_dwell(case):
    """Random states, some of them bad, and reboots that are told the past."""
    inputs, Ts, rng = len(case["levels"]), 0.1, np.random.default_rng(case["seed"])
    A, B = -np.eye(2) + 0.5 * rng.standard_normal((2, 2)), rng.standard_normal((2, inputs))
    plant = fsw.Plant(A, B, np.eye(2), input_delay=case["delay"])
    dwell = {"min_on": case["min_on"], "min_off": case["min_off"]}
    controller = quiet(fsw.Controller, plant, case["levels"], Ts, fsw.Endpoint(0.3, 1.0), **dwell)
    safe = [min(levels, key=abs) for levels in case["levels"]]
    commands, elapsed = [np.array(case["start"])] * 7, np.array(case["elapsed"])
    for k in range(60):
        if k == 0 or k in case["reboots"]:
            controller.reset(pending=commands, elapsed=elapsed)
        x = rng.standard_normal(2)
        if rng.random() < 0.1:
            x[0] = np.nan
        u = controller.step(x, rng.standard_normal(2))
        for j in np.flatnonzero(u != commands[-1]):
            off = commands[-1][j] == safe[j]
            assert elapsed[j] >= dwell["min_off" if off else "min_on"][j] - 1e-9 * Ts
            elapsed[j] = 0.0
        commands.append(u)
        elapsed = elapsed + Ts


@given(min_on=duration, min_off=duration)
def test_a_run_that_wants_to_end_ends_as_soon_as_it_may(min_on, min_off):
    off, on = lengths_when_always_wanting_the_other(restless(min_on=min_on, min_off=min_off))
    whole = [max(1, int(np.ceil(value / 0.1 - 1e-9))) for value in (min_off, min_on)]
    assert set(off) == {whole[0]}
    assert set(on) == {whole[1]}


@pytest.mark.parametrize(
    ("seconds", "Ts", "periods"),
    [(0.3, 0.1, 3), (1.1, 0.1, 11), (0.6, 0.2, 3), (0.30001, 0.1, 4), (0.29999, 0.1, 3), (0.05, 0.1, 1), (0, 0.1, 1)],
)
def test_durations_round_up_to_whole_periods(seconds, Ts, periods):
    """0.3 / 0.1 = 2.9999... and 1.1 / 0.1 = 11.0000...2 are 3 and 11."""
    off, on = lengths_when_always_wanting_the_other(restless(Ts=Ts, min_on=seconds))
    assert set(on) == {periods}
    assert set(off) == {1}


# What counts as on ----------------------------------------------------------------------------------------------------


def test_from_one_level_to_another_is_a_switch_also_when_both_are_on():
    """+1 to -1 keeps min_on; the run at +1 does not extend into -1."""
    controller = restless([-1.0, 0.0, 1.0], min_on=0.3, min_off=0.5)
    commands = [wish(controller, k % 2 == 0) for k in range(60)]
    lengths, values = level_runs(commands)
    assert set(values) == {-1.0, 1.0}
    assert (lengths[:-1] >= 3).all()


def test_an_input_is_off_at_its_declared_safe_level():
    off, on = lengths_when_always_wanting_the_other(restless(safe_level=1.0, min_on=0.2, min_off=0.5))
    assert (set(off), set(on)) == ({2}, {5})


def test_without_a_zero_the_level_nearest_zero_is_off():
    controller = restless([0.5, 2.0], min_on=0.2, min_off=0.5)
    wishes = [True, False, False, True, True, True, True, True]
    assert [wish(controller, highest) for highest in wishes] == [2.0, 2.0, 0.5, 0.5, 0.5, 0.5, 0.5, 2.0]


def test_each_input_has_its_own_clock():
    plant = fsw.Plant(np.zeros((2, 2)), np.eye(2), np.eye(2))
    controller = quiet(
        fsw.Controller, plant, [[0, 1], [0, 1]], 0.1, fsw.Endpoint(0.1, 1.0), min_on=[0.4, 0.0], min_off=[0.0, 0.2]
    )
    wishes = [(1, 1), (0, 0), (0, 1), (0, 1), (0, 1), (1, 0)]
    commands = [controller.step([0, 0], [(2 * a - 1) * 1e3, (2 * b - 1) * 1e3]).tolist() for a, b in wishes]
    assert commands == [[1, 1], [1, 0], [1, 0], [1, 1], [0, 1], [1, 0]]


# Time since the last switch -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("elapsed", "stay"), [(None, 0), (0.0, 5), (0.1, 4), (0.2, 3), (0.25, 3), (0.4, 1), (0.5, 0), (9.0, 0)]
)
def test_elapsed_is_the_age_of_the_present_run_at_the_next_step(elapsed, stay):
    controller = restless(min_on=0.5)
    controller.reset(pending=[1.0], elapsed=elapsed)
    assert [wish(controller, False) for _ in range(7)] == [1.0] * stay + [0.0] * (7 - stay)


def test_elapsed_defaults_to_long_ago():
    controller = restless(min_on=0.5, min_off=0.5)
    assert wish(controller, True) == 1.0
    controller.reset()
    assert wish(controller, True) == 1.0


@given(st.integers(0, 12), st.booleans())
def test_a_reboot_that_is_told_the_past_changes_nothing(reboot, wanting):
    """Commands under way and elapsed times are all there is."""
    controller = restless(min_on=0.4, min_off=0.3)
    wishes = np.random.default_rng(reboot).random(40) < (0.7 if wanting else 0.4)
    expected = [wish(controller, highest) for highest in wishes]
    again = restless(min_on=0.4, min_off=0.3)
    past = expected[:reboot]
    if past:
        lengths, values = level_runs(past)
        whole = len(lengths) == 1 and values[0] == 0.0  # off since long ago
        again.reset(pending=past[-1:], elapsed=None if whole else 0.1 * lengths[-1])
    assert [wish(again, highest) for highest in wishes[reboot:]] == expected[reboot:]


# Around it ------------------------------------------------------------------------------------------------------------


def test_coasting_keeps_dwell_and_the_safe_level_overrides_it():
    controller = restless(min_on=1.0, safe_level=0.0, bad_limit=4)
    assert wish(controller, True) == 1.0
    commands = []
    for _ in range(4):
        commands.append(controller.step([np.nan], -1e3)[0])
    assert commands == [1.0, 1.0, 1.0, 0.0]
    assert controller.status == Status.SAFE


def test_after_the_safe_level_its_own_dwell_runs():
    controller = restless(min_off=0.3, safe_level=0.0, bad_limit=1)
    controller.reset(pending=[1.0])
    assert controller.step([np.nan], 1e3) == [0.0]
    assert [wish(controller, True) for _ in range(4)] == [0.0, 0.0, 1.0, 1.0]


def test_a_dwell_longer_than_the_horizon_is_warned_about():
    with pytest.warns(UserWarning, match=r"min_on or min_off of 0\.03 s exceeds Td = 0\.02 s"):
        valve_controller(min_on=0.03)
    valve_controller(min_on=0.02, min_off=0.02)  # no warning, or this test would fail


def test_dwell_holds_in_the_closed_loop():
    for options, off, on in (({"min_on": 0.004}, 1, 4), ({"min_off": 0.0095}, 10, 1)):
        run = fsw.simulate(valve_controller(**options), RISE, 0.6)
        lengths, values = level_runs(run.u[:, 0])
        assert lengths[1:-1][values[1:-1] == 1.0].min() == on
        assert lengths[1:-1][values[1:-1] == 0.0].min() >= off
        assert abs(run.y[-1, 0] - 1000.0) < 16.5 * on


def test_a_forced_hold_is_part_of_the_prediction():
    """The cost of a candidate that must be kept is that of keeping it."""
    controller = fsw.Controller(MASS, [0.0, 1.0], 0.1, fsw.Endpoint(0.6, 1.0), min_on=0.4)
    free = fsw.Controller(MASS, [0.0, 1.0], 0.1, fsw.Endpoint(0.6, 1.0))
    kept, short = (c.decide([0.0, 0.0], [0.0, 0.0]).costs[1] for c in (controller, free))
    effect = 0.1 * (0.6 + 1.0 - 0.05)  # one period: its share of y plus y' / lam at the evaluation instant
    held = 0.4 * (0.6 + 1.0 - 0.2)
    assert (short, kept) == pytest.approx((0.5 * effect**2, 0.5 * held**2))
