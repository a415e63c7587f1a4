"""What else a certificate tells: margins, horizons, speeds, and what can be held."""

import warnings
from itertools import pairwise

import numpy as np
import pytest

import foreswitch as fsw
from systems import MASS, RISE, VALVE, valve_controller


def test_margins_are_where_the_bound_has_doubled():
    plain = fsw.certify(valve_controller())
    for name in ("delay_error", "gain_error", "load"):
        most = plain.margins[name][0]
        assert (fsw.certify(valve_controller(), **{name: most}).error_bound <= 2.01 * plain.error_bound).all()
        more = fsw.certify(valve_controller(), **{name: 1.05 * most})
        assert not more.holds or (more.error_bound > 2.0 * plain.error_bound).any()


def test_horizons_of_an_oscillator_are_not_one_interval(no_remedy):
    w = 2 * np.pi
    plant = fsw.Plant([[0.0, w], [-w, -0.02 * w]], [[0.0], [w]], [[1.0, 0.0]], input_delay=0.02)
    controller = fsw.Controller(plant, np.linspace(-4, 4, 33), 0.05, fsw.Endpoint(0.1, 20.0))
    intervals = fsw.certify(controller).Td_intervals
    assert len(intervals) > 1
    for (_, a), (b, _) in pairwise(intervals):
        between = controller.replace(objective=fsw.Endpoint(np.sqrt(a * b), 20.0))
        assert not fsw.certify(between).holds


def test_how_fast_and_what_can_be_held():
    certificate = fsw.certify(valve_controller(), reference=RISE, duration=0.7)
    assert certificate.holds
    assert certificate.fastest == pytest.approx(16500.0 / (1000.0 * np.pi / 2 / 0.5), rel=0.2)
    low, high = certificate.steady["slope"]
    assert (low, high) == pytest.approx((certificate.input_range[0][0] * 16500, certificate.input_range[1][0] * 16500))
    assert "switching may cease" in certificate.rest


def test_ideal_input_at_the_ends_of_the_levels_is_certified_for_hot_gas():
    assert any(low[0] <= 0.0 and high[0] >= 1.0 for (low, high), _ in fsw.certify(valve_controller()).arguments)


def test_arguments_out_of_range():
    for name, value in (("noise", -1.0), ("delay_error", [1.0, 2.0]), ("gain_error", 1.0), ("load", np.nan)):
        with pytest.raises(ValueError, match=name):
            fsw.certify(valve_controller(), **{name: value})
    with pytest.raises(ValueError, match="controller"):
        fsw.certify(VALVE)


def test_mass_is_certified():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        certificate = fsw.certify(fsw.Controller(MASS, [-1, 0, 1], 0.05, fsw.Endpoint(0.5, 2.0)))
    assert certificate.holds


def test_while_the_papers_rise_lasts_it_strays_by_5_74_kpa():
    law, rise = valve_controller(), fsw.HalfSine(1000.0, 0.5)
    run = fsw.simulate(law, rise, 0.5)
    strayed = np.abs(run.y - fsw.certify(law).ideal(rise, 0.5)).max()
    assert strayed == pytest.approx(5.74, rel=0.002)
