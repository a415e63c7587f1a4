"""What real actuators and sensors add: faults, late samples, and noise that can be traced to its seed."""

from itertools import pairwise
from math import ceil

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import kstest

import foreswitch as fsw
from foreswitch.baselines import Relay
from oracles.rig import LATE, LOST, PROCESS, SENSOR, newest, normal, reading, statuses, uniform
from systems import OVEN, TWO_BY_TWO, VALVE, exact_state, quiet

# Faults ---------------------------------------------------------------------------------------------------------------

START, END = 200.0, 300.0  # s


def oven(**options):
    return quiet(fsw.Controller, OVEN, [0.0, 1.0], 2.0, fsw.Endpoint(10.0, 0.2), **options)


def coupled(**options):
    plant = TWO_BY_TWO.replace(A=TWO_BY_TWO.A / 20.0, B=TWO_BY_TWO.B / 20.0, input_delay=[7.4, 3.0])
    return quiet(fsw.Controller, plant, [[0.0, 1.0], [-0.5, 0.0, 2.0]], 2.0, fsw.Endpoint(10.0, 0.2), **options)


FAULTS = {
    "stuck on": fsw.Hardware(stuck=[fsw.Stuck(1.0, START, END)]),
    "stuck off": fsw.Hardware(stuck=[fsw.Stuck(0.0, START, END)]),
    "stuck between": fsw.Hardware(stuck=[fsw.Stuck(0.37, START, END)]),
    "stuck for good": fsw.Hardware(stuck=[fsw.Stuck(0.0, START)]),
    "missing": fsw.Hardware(missing=0.3),
    "all missing": fsw.Hardware(missing=1.0),
    "late": fsw.Hardware(late=5.0),
    "late and missing": fsw.Hardware(late=11.0, missing=0.2),
    "outages": fsw.Hardware(outages=[(START, END), (0.0, 7.0)]),
    "outage for good": fsw.Hardware(outages=[(START, np.inf)]),
    "quantum": fsw.Hardware(quantum=0.5),
    "saturation": fsw.Hardware(low=0.1, high=0.3),
    "process noise": fsw.Hardware(process_noise=0.05),
    "slow": fsw.Hardware(opening=7.3, closing=1.9),
    "everything": fsw.Hardware(
        opening=3.0, closing=1.0, stuck=[fsw.Stuck(1.0, START, END)], quantum=0.01, low=-2.0, high=90.0,
        process_noise=0.01, missing=0.1, late=3.0, outages=[(400.0, 430.0)],
    ),
}  # fmt: skip


def drifted(plant):
    return plant.replace(A=1.3 * plant.A, B=0.8 * plant.B)


def hardware_of(name, plant):
    return fsw.Hardware(drift=drifted(plant)) if name == "drift" else FAULTS[name]


@pytest.mark.parametrize("build", [oven, coupled])
@pytest.mark.parametrize("name", [*FAULTS, "drift"])
@pytest.mark.parametrize("safe", [False, True])
def test_under_any_fault_commands_are_levels_and_the_status_tells_why(build, name, safe):
    declared = [0.0] * (2 if build is coupled else 1)
    controller = build(**({"safe_level": declared, "bad_limit": 6} if safe else {}))
    what = hardware_of(name, controller.plant)
    run = fsw.simulate(controller, 0.5, 800.0, hardware=what, noise=0.01, seed=11)
    assert np.isfinite(run.x).all()
    for j, levels in enumerate(controller.levels):
        assert set(run.u[:, j]) <= set(levels)
    lost = {"missing": what.missing, "late": what.late, "outages": what.outages}
    samples = newest(len(run.u), 11, 2.0, **lost)
    expected = statuses([k is not None for k in samples], 6 if safe else None)
    assert [fsw.Status(s).name for s in run.status] == expected
    assert (run.u[np.array(expected) == "SAFE"] == 0.0).all()
    harmless = not (what.missing or what.late or what.outages)
    assert (set(expected) == {"OK"}) == harmless


def test_the_faults_above_reach_every_status():
    seen = {}
    for name in ("missing", "all missing", "late and missing", "outages", "outage for good"):
        run = fsw.simulate(oven(safe_level=0.0, bad_limit=6), 50.0, 800.0, hardware=FAULTS[name], seed=11)
        seen[name] = {fsw.Status(s).name for s in run.status}
    assert seen["missing"] == {"HELD", "OK", "COASTING"}
    assert seen["all missing"] == {"HELD", "SAFE"}
    assert seen["outages"] == {"HELD", "OK", "COASTING", "SAFE"}
    assert seen["outage for good"] == {"OK", "COASTING", "SAFE"}
    never = fsw.simulate(oven(), 50.0, 800.0, hardware=FAULTS["outage for good"])
    assert never.status[-1] == fsw.Status.COASTING


@pytest.mark.parametrize(
    ("name", "extra"),
    [("stuck on", 0.0), ("stuck off", 0.0), ("outages", 0.0), ("missing", 0.0), ("quantum", 0.5), ("late", 2.5)],
)
def test_after_a_fault_the_oven_comes_back(name, extra):
    """Its error long after is that of an oven that never failed, and what it moves within one quantum or late sample."""
    runs = [fsw.simulate(oven(), 50.0, 1200.0, hardware=what, seed=5) for what in (None, FAULTS[name])]
    healthy, failed = (np.abs(run.y[run.t > END + 500.0] - 50.0).max() for run in runs)
    assert healthy < 0.6
    assert failed < 0.6 + extra
    if name.startswith("stuck"):
        during = (runs[1].t > START) & (runs[1].t < END + 20.0)
        assert np.abs(runs[1].y[during] - 50.0).max() > 10.0


def test_a_stuck_actuator_is_at_its_level_for_its_time_only():
    what = fsw.Hardware(stuck=[fsw.Stuck(0.37, 21.0, 80.0)])  # from 22 s: whole periods
    run = fsw.simulate(oven(), 50.0, 100.0, hardware=what)
    commands = [[0.0]] * 20 + run.u.tolist()
    late = OVEN.replace(input_delay=0.0)
    arriving = np.array(commands)[10:60]  # ten periods under way
    arriving[11:40] = 0.37
    assert run.x[-1] == pytest.approx(exact_state(late, run.x[0], 2.0, ([[0.0]], arriving), 100.0), rel=1e-9)


def test_a_drifting_plant_moves_in_a_hundred_steps_from_one_to_the_other():
    controller = oven()
    end = OVEN.replace(A=2.0 * OVEN.A, B=0.5 * OVEN.B, C=3.0 * OVEN.C, y_offset=7.0, u_offset=0.2)
    run = fsw.simulate(controller, 50.0, 400.0, x0=[30.0], hardware=fsw.Hardware(drift=end))  # 200 periods
    delayed = np.vstack([np.zeros((10, 1)), run.u])
    x = run.x[0]
    for k in range(200):
        share = (k // 2 + 0.5) / 100.0
        piece = OVEN.replace(
            A=(1.0 + share) * OVEN.A, B=(1.0 - 0.5 * share) * OVEN.B, u_offset=0.2 * share, input_delay=0.0
        )
        x = exact_state(piece, x, 2.0, ([[0.0]], delayed[k : k + 1]), 2.0)
        assert run.x[k + 1] == pytest.approx(x, rel=1e-9)
        if k < 199:
            share = ((k + 1) // 2 + 0.5) / 100.0
            assert run.y[k + 1] == pytest.approx((1.0 + 2.0 * share) * x * OVEN.C[0] + 7.0 * share, rel=1e-9)
    still = fsw.simulate(controller, 50.0, 400.0, x0=[30.0], hardware=fsw.Hardware(drift=OVEN))
    assert still.x == pytest.approx(fsw.simulate(controller, 50.0, 400.0, x0=[30.0]).x, rel=1e-9)


# Samples that are late ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("late", "missing"), [(0.5, 0.0), (2.0, 0.0), (3.7, 0.0), (9.3, 0.3), (20.0, 0.0)])
@pytest.mark.parametrize("seed", [0, 1, 2**63 + 5])
def test_the_law_is_given_the_newest_sample_that_came_in(late, missing, seed):
    """Replayed on the samples that the generator, written down anew, says came in."""
    controller = oven()
    run = fsw.simulate(
        controller, 50.0, 400.0, x0=[20.0], noise=0.3, seed=seed, hardware=fsw.Hardware(late=late, missing=missing)
    )
    samples = newest(len(run.u), seed, 2.0, late=late, missing=missing)
    ages = {k - sample for k, sample in enumerate(samples) if sample is not None}
    assert max(ages) <= ceil(late / 2.0)
    assert min(ages) >= 1
    assert len(ages) == ceil(late / 2.0) or late > 9.0
    for k, sample in enumerate(samples):
        measured = [np.nan] if sample is None else reading(run.x[sample], sample, seed, deviation=[0.3])
        assert controller.step(measured, 50.0) == run.u[k]
        assert controller.status == run.status[k]


# Random numbers -------------------------------------------------------------------------------------------------------

#: So fast that every sample is new: the state is the process noise itself.
FORGETFUL = fsw.Plant(-2000.0 * np.eye(4), np.ones((4, 1)))


def white(seed, steps):
    """Process noise of four states over some periods of 1 s, in the order in which it is drawn."""
    law = Relay(FORGETFUL, [0.0, 1.0], 1.0)
    run = fsw.simulate(law, -100.0, steps, seed=seed, hardware=fsw.Hardware(process_noise=1.0))
    assert not run.u.any()
    return run.x[1:].ravel()


@given(st.integers(0, 2**64 - 1))
def test_normal_numbers_are_those_written_down_to_the_last_bit_but_one(seed):
    drawn = white(seed, 25)
    np.testing.assert_array_max_ulp(drawn, np.array([normal(seed, PROCESS, i) for i in range(100)]), maxulp=1)


@given(st.integers(0, 2**64 - 1), st.integers(0, 30))
def test_uniform_numbers_are_those_written_down_bit_for_bit(seed, sample):
    """A sample is lost if its number is below the share: one bit more and it is."""
    number = uniform(seed, LOST, sample)
    law = oven()
    for share, lost in ((number, False), (np.nextafter(number, 1.0), True)):
        run = fsw.simulate(law, 50.0, 2.0 * (sample + 1), seed=seed, hardware=fsw.Hardware(missing=share))
        assert (run.status[sample] != fsw.Status.OK) == lost


def test_normal_numbers_are_normal():
    drawn = np.concatenate([white(seed, 25_000) for seed in (0, 1, 2**64 - 1)])
    assert drawn.size == 300_000
    assert abs(drawn.mean()) < 4.0 / np.sqrt(drawn.size)
    assert drawn.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * drawn.size))
    assert (drawn**4).mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(96.0 / drawn.size))
    assert kstest(drawn, "norm").pvalue > 0.01
    assert np.abs(drawn).max() > 4.2


def test_uniform_numbers_are_uniform():
    """The oracle's, which are the core's bit for bit."""
    for stream in (SENSOR, PROCESS, LOST, LATE):
        drawn = np.array([uniform(3, stream, i) for i in range(20_000)])
        assert drawn.min() >= 0.0
        assert drawn.max() < 1.0
        assert drawn.mean() == pytest.approx(0.5, abs=4.0 / np.sqrt(12.0 * drawn.size))
        assert drawn.var() == pytest.approx(1.0 / 12.0, abs=4.0 / np.sqrt(180.0 * drawn.size))
        assert kstest(drawn, "uniform").pvalue > 0.01


def test_neighbours_have_nothing_in_common():
    """Neighbouring seeds, the seeds' mirror images, neighbouring numbers, shifted sequences."""
    steps = 10_000
    series = [white(seed, steps) for seed in (0, 1, 2, 3, 2**32, 2**63, 2**64 - 1)]
    limit = 4.5 / np.sqrt(4 * steps)
    for i, one in enumerate(series):
        for lag in (1, 2, 3, 4, 8, 1000):
            assert abs(np.corrcoef(one[lag:], one[:-lag])[0, 1]) < limit
        for other in series[:i]:
            assert not set(one) & set(other)
            for lag in (0, 1, 2, 4, 5):
                assert abs(np.corrcoef(one[lag:], other[: other.size - lag])[0, 1]) < limit


def test_streams_have_nothing_in_common():
    series = [np.array([uniform(8, stream, i) for i in range(10_000)]) for stream in (SENSOR, PROCESS, LOST, LATE)]
    for one, other in pairwise([*series, series[0]]):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.0 / np.sqrt(10_000)


def test_process_noise_gathers_with_the_square_root_of_time():
    integrator = fsw.Plant([[0.0]], [[1.0]])
    ends = []
    for seed in range(400):
        law = Relay(integrator, [0.0, 1.0], 0.01)
        ends.append(fsw.simulate(law, -1e3, 4.0, seed=seed, hardware=fsw.Hardware(process_noise=0.5)).x[-1, 0])
    assert np.std(ends) == pytest.approx(0.5 * np.sqrt(4.0), rel=0.15)


@pytest.mark.parametrize(
    "random", [{"noise": 0.5}, *({"hardware": FAULTS[name]} for name in ("missing", "late", "process noise"))]
)
def test_a_seed_is_a_run_and_two_seeds_are_two(random):
    runs = [fsw.simulate(oven(), 50.0, 600.0, seed=seed, **random) for seed in (3, 3, 4, None, None)]
    same, twin, other, free, freer = ((run.u.tobytes(), run.status.tobytes(), run.x.tobytes()) for run in runs)
    assert same == twin
    assert same != other
    assert free != freer


# Mistakes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"opening": -1.0}, "opening is -1.0; it must be at least 0"),
        ({"closing": [0.0, -1.0]}, "closing is"),
        ({"quantum": -1.0}, "quantum is"),
        ({"process_noise": np.nan}, "process_noise holds NaN"),
        ({"low": 2.0, "high": 1.0}, "low must be smaller"),
        ({"low": np.nan}, "low must be smaller"),
        ({"low": [0.0, 1.0], "high": [1.0, 2.0, 3.0]}, "low has shape"),
        ({"missing": 1.1}, "missing is 1.1"),
        ({"missing": np.nan}, "missing is nan"),
        ({"late": -1.0}, "late is -1"),
        ({"late": np.inf}, "late is inf"),
        ({"outages": [(2.0, 1.0)]}, "start before end"),
        ({"outages": [3.0]}, "start, end"),
        ({"outages": (1.0, 2.0)}, "start, end"),
        ({"outages": [(np.nan, 1.0)]}, "start before end"),
        ({"stuck": [1.0]}, "give Stuck"),
        ({"stuck": fsw.Stuck(1.0)}, "give Stuck"),
        ({"drift": 3.0}, "drift is"),
    ],
)
def test_what_cannot_be_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        fsw.Hardware(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"level": np.nan}, "level is nan"),
        ({"level": 1.0, "start": -1.0}, "start is -1"),
        ({"level": 1.0, "start": 2.0, "end": 2.0}, "end is 2"),
        ({"level": 1.0, "end": np.nan}, "end is nan"),
        ({"level": 1.0, "input": -1}, "input is -1"),
        ({"level": 1.0, "input": 0.5}, "input is 0.5"),
    ],
)
def test_a_stuck_actuator_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        fsw.Stuck(**arguments)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (fsw.Hardware(opening=[1.0, 2.0]), "opening has shape"),
        (fsw.Hardware(quantum=[1.0, 2.0]), "quantum has shape"),
        (fsw.Hardware(process_noise=[1.0, 2.0]), "process_noise has shape"),
        (fsw.Hardware(low=[1.0, 2.0]), "low has shape"),
        (fsw.Hardware(high=[1.0, 2.0]), "high has shape"),
        (fsw.Hardware(stuck=[fsw.Stuck(0.0, input=1)]), "stuck names input 1; give 0 to 0"),
        (fsw.Hardware(drift=VALVE), "drift has"),
        (fsw.Hardware(drift=OVEN.replace(input_delay=3.0)), "a dead time cannot drift"),
        (fsw.Hardware(drift=OVEN.replace(E=[[1.0]])), "drift has E of shape"),
    ],
)
def test_what_does_not_fit_the_plant_is_refused(what, message):
    with pytest.raises(ValueError, match=message):
        fsw.simulate(oven(), 50.0, 10.0, hardware=what)


def test_times_beyond_all_counting_are_for_ever():
    for end in (1e30, np.inf):
        what = fsw.Hardware(stuck=[fsw.Stuck(0.0, 10.0, end)], outages=[(1e30, 2e30), (600.0, end)])
        run = fsw.simulate(oven(), 50.0, 800.0, x0=[50.0], hardware=what)
        assert run.y[-1, 0] < 1.0
        assert (run.status[300:] == fsw.Status.COASTING).all()
        assert not run.status[:300].any()
