"""The dead time shifts the response and changes no command."""

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import foreswitch as fsw
from systems import RISE, VALVE, valve_controller

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
