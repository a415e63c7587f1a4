"""What an estimator makes of samples that are no measurements."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import chi2

import foreswitch as fsw
from systems import SENSOR, TWO_BY_TWO, valve_controller

BAD = [nan, inf, -inf, 1e300, -1e300]


@pytest.mark.parametrize("real", ["float64", "float32"])
@given(st.sampled_from(BAD), st.integers(1, 8), st.integers(1, 30))
@settings(max_examples=30)
def test_without_samples_the_filter_runs_open_loop(real, bad, length, before):
    law = valve_controller(estimator=SENSOR, real=real)
    assert np.isnan(law.estimate[0]).all()
    law.step(bad, 100.0)
    assert law.status is fsw.Status.HELD
    assert np.isnan(law.estimate[0]).all()
    for k in range(before):
        law.step(5.0 * k, 100.0)
    for _ in range(length):
        x, load = law.estimate
        issued = law.issued
        law.step(bad, 100.0)
        assert law.status is fsw.Status.COASTING
        Phi, Gamma = np.asarray(law.model.transition), law.model.old.T + law.model.new.T
        expected = Phi @ x + Gamma @ issued[0] + law.model.disturbance @ load
        assert law.estimate[0] == pytest.approx(expected, rel=1e-9 if real == "float64" else 1e-4, abs=1e-3)
        assert law.estimate[1] == pytest.approx(load)
    law.step(float(expected[0]), 100.0)
    assert law.status is fsw.Status.OK


def test_one_bad_output_among_two_spoils_the_sample():
    law = fsw.Controller(TWO_BY_TWO, [[0, 1]] * 2, 0.05, fsw.Endpoint(0.5, 3.0), estimator=fsw.Kalman(1e-4, 1e-4))
    law.step([0.1, 0.2], [0.0, 0.0])
    before = law.copy()
    law.step([0.3, nan], [0.0, 0.0])
    before.step([nan, nan], [0.0, 0.0])
    assert law.status is fsw.Status.COASTING
    assert np.array_equal(law.estimate[0], before.estimate[0])


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_the_smallest_numbers_become_zero(real):
    law = valve_controller(estimator=SENSOR, real=real)
    tiny = 1e-310 if real == "float64" else 1e-40
    law.step(tiny, 0.0)
    assert law.status is fsw.Status.OK
    for _ in range(20):
        law.step(tiny, 0.0)
    x, load = law.estimate
    assert not x.any()
    assert not load.any()


def test_a_spike_is_not_used_and_a_jump_is():
    law = valve_controller(estimator=fsw.Kalman([0.0, 1e4], 4.0, gate=6.0, gate_limit=3))
    edge = 6.0 * float(np.sqrt(law.kalman.innovation[0, 0]))
    for _ in range(5):
        law.step(0.0, 0.0)
    for offset, status in ((0.999, "OK"), (1.001, "COASTING"), (-1.001, "COASTING")):
        other = law.copy()
        other.step(offset * edge, 0.0)
        assert other.status.name == status, offset
    statuses = []
    for _ in range(60):
        law.step(800.0, 0.0)
        statuses.append(law.status.name)
    assert statuses[:10] == ["COASTING"] * 3 + ["OK"] * 7
    assert statuses[30:] == ["OK"] * 30, "in between the estimate overshoots and leaves the gate once more"
    assert law.estimate[0][0] == pytest.approx(800.0, abs=1.0)
    law.step(0.0, 0.0)
    assert law.status is fsw.Status.COASTING, "back inside, the gate counts anew"


def test_without_a_gate_every_number_is_used():
    law = valve_controller(estimator=fsw.Kalman([0.0, 1e4], 4.0, gate=0.0))
    for y in (0.0, 1e6, 1e-6, 1e12):
        law.step(y, 0.0)
        assert law.status is fsw.Status.OK


def test_the_gate_is_as_wide_in_probability_for_several_outputs():
    estimator = fsw.Kalman(1e-4, [1e-4, 4e-4], gate=3.0)
    kalman = fsw.Controller(TWO_BY_TWO, [[0, 1]] * 2, 0.05, fsw.Endpoint(0.5, 3.0), estimator=estimator).kalman
    rng = np.random.default_rng(0)
    e = rng.multivariate_normal([0.0, 0.0], kalman.innovation, 200_000)
    beyond = np.einsum("ki,ij,kj->k", e, kalman.gate, e) > 1.0
    assert beyond.mean() == pytest.approx(chi2.sf(9.0, 1), rel=0.1)


@pytest.mark.parametrize("real", ["float64", "float32"])
@given(st.lists(st.floats(width=64) | st.sampled_from(BAD), min_size=1, max_size=40))
def test_no_samples_break_it(real, samples):
    """Whatever is measured: an allowed command, finite estimates, and a sound filter afterwards."""
    law = valve_controller(estimator=SENSOR, real=real)
    for y in samples:
        assert law.step(y, 100.0)[0] in (0.0, 1.0)
        assert np.isfinite(law.estimate[0]).all() or np.isnan(law.estimate[0]).all()
    if max((abs(y) for y in samples if np.isfinite(y)), default=0.0) < 1e6:
        for _ in range(1500):
            law.step(50.0, 0.0)
        assert law.estimate[0][0] == pytest.approx(50.0, abs=0.5)


def test_an_estimate_beyond_all_numbers_starts_anew():
    unstable = fsw.Plant([[30.0]], [[1.0]])
    law = fsw.Controller(unstable, [-1, 1], 0.1, fsw.Endpoint(0.1, 1.0), estimator=fsw.Kalman(0.01, 0.01))
    law.step(1.0, 0.0)
    statuses = []
    for _ in range(300):
        law.step(nan, 0.0)
        statuses.append(law.status)
    assert statuses[0] is fsw.Status.COASTING
    assert statuses[-1] is fsw.Status.HELD
    law.step(2.0, 0.0)
    assert law.estimate[0][0] == pytest.approx(2.0)


def test_bad_samples_in_a_row_lead_to_the_safe_level():
    law = valve_controller(estimator=SENSOR, safe_level=0.0, bad_limit=4)
    law.step(0.0, 500.0)
    seen = []
    for _ in range(6):
        law.step(nan, 500.0)
        seen.append(law.status.name)
    assert seen == ["COASTING"] * 3 + ["SAFE"] * 3
    law.step(law.estimate[0][0], 500.0)
    assert law.status is fsw.Status.OK
