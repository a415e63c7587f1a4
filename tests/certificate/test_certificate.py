"""Certificates against an adversary: what is proven must hold, whatever he does."""

import numpy as np
import pytest

import foreswitch as fsw
from certificate.bounds import DOUBLE, FINE, LAGS, ONE_TO_TWO, PENDULUM, ROUND_OFF, TICK, strays, withstands
from certificate.designs import certified, draw
from oracles.adversary import attack
from systems import OVEN, RISE, TWO_BY_TWO, VALVE, exact_state, valve_controller

# Three cases with known figures. The worst observed are of a few references; the adversary comes closer. --------------


@pytest.mark.parametrize(
    ("controller", "bound", "observed"),
    [
        (valve_controller(), 7.95, 5.74),
        (fsw.Controller(DOUBLE, [-1, 0, 1], TICK, fsw.Endpoint(0.1, 20.0)), 7.5e-5, 3.7e-5),
        (fsw.Controller(PENDULUM, [-1, 0, 1], TICK, fsw.Endpoint(0.1, 20.0)), 3.6e-3, 2.6e-3),
    ],
    ids=["hot gas", "double integrator", "unstable"],
)
def test_bounds_of_the_theory_chapter(controller, bound, observed):
    certificate, _ = withstands(controller)
    (low, high), found = certificate.arguments[0]
    assert found[0] == pytest.approx(bound, rel=0.05)
    worst = attack(controller, low, high, rounds=6)[0]
    assert observed < worst <= found[0]
    assert worst > 0.9 * bound


def test_hot_gas_has_the_range_of_a_modulator_without_overload():
    (low, high), _ = fsw.certify(valve_controller()).arguments[0]
    assert (low[0], high[0]) == pytest.approx((0.006, 0.994), abs=5e-4)


@pytest.mark.parametrize(
    "errors",
    [{"noise": [1.0, 50.0]}, {"delay_error": 3e-4}, {"gain_error": 0.05}, {"load": 0.02},
     {"noise": [1.0, 50.0], "delay_error": 3e-4, "gain_error": 0.05, "load": 0.01}],
    ids=", ".join,
)  # fmt: skip
def test_hot_gas_withstands_errors(errors):
    _, found = withstands(valve_controller(), **errors)
    assert found.max() < 2.0


@pytest.mark.parametrize("seed", range(10_000, 10_060))
def test_random_designs_withstand(seed, no_remedy):
    _, controller, errors = draw(seed)
    if controller is None:
        return
    certificate, errors = certified(controller, errors)
    if certificate is None:
        return
    for (low, high), bound in certificate.arguments:
        worst = attack(controller, low, high, seed=seed, rounds=2, **errors)
        assert worst is None or (worst <= bound * ROUND_OFF).all()


# What the adversary once broke ----------------------------------------------------------------------------------------


def test_a_forbidden_level_widens_the_gap_of_a_single_input():
    controller = fsw.Controller(VALVE, [0.0, 0.5, 1.0], TICK, fsw.Endpoint(0.020, 2500.0), forbidden=[[0.5]])
    certificate, _ = withstands(controller)
    assert certificate.error_bound == pytest.approx(fsw.certify(valve_controller()).error_bound)


def ringing(period):
    """A slow lag beside a fast ring that the law hardly looks at."""
    w = 2 * np.pi / period
    A = [[-0.1, 0.0, 0.0], [0.0, -0.01 * w, w], [0.0, -w, -0.01 * w]]
    plant = fsw.Plant(A, [[1.0], [0.0], [10.0]], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], input_delay=1.11)
    objective = fsw.Endpoint(2.0, 1.0, weight=[1.0, 1e-9], relative_degree=1)
    return fsw.Controller(plant, np.arange(-3, 4) / 2, 1.11, objective)


def test_a_dead_time_wrong_by_half_a_turn_is_worse_than_by_a_whole_one():
    withstands(ringing(0.8), delay_error=0.39)
    refused = fsw.certify(ringing(0.2), delay_error=0.4)
    assert "delay_error of 0.4 s" in refused.reasons[0]


@pytest.mark.parametrize("load", [None, 1e-3])
def test_an_estimator_that_begins_elsewhere_than_the_plant_is_refused(load):
    estimator = fsw.Kalman(1e-3, 1e-2, load=load, gate=0)
    controller = fsw.Controller(LAGS, FINE, 0.1, fsw.Endpoint(0.5, 3.0), estimator=estimator)
    moving = [0.0, 1.0]
    refused = fsw.certify(controller, reference=0.5, duration=20.0, x0=moving)
    assert not refused.holds
    assert "reset(estimate=)" in refused.reasons[0]
    run = fsw.simulate(controller, 0.5, 20.0, x0=moving)
    off = np.abs(run.y - refused.ideal(0.5, 20.0, x0=moving)).max()
    assert off > 10.0 * fsw.certify(controller).error_bound[0]

    commands = [-1.0, 0.25, 1.0, 2.0]
    before = np.array([0.0, 0.5])
    controller.reset(estimate=before, pending=commands)
    now = exact_state(LAGS, before, 0.1, (commands[:-1], commands[-1:]), 0.1)
    assert strays(controller, 0.5, 20.0, x0=now) < 1.0
    assert not fsw.certify(controller, reference=0.5, duration=20.0, x0=before).holds


def test_a_load_counts_with_the_gain_that_the_input_may_have():
    controller = fsw.Controller(LAGS, FINE, 0.1, fsw.Endpoint(0.5, 3.0))
    withstands(controller, load=1.0, gain_error=0.3)


def test_a_load_may_change_while_a_command_acts():
    """At a ring's own pace, which commands, held for a turn, hardly excite."""
    A = [[-0.2, 0.0, 0.0], [0.0, -0.02, 6.5], [0.0, -6.5, -0.02]]
    plant = fsw.Plant(A, [[0.5], [0.0], [3.0]], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], input_delay=0.3)
    objective = fsw.Endpoint(2.0, 1.0, relative_degree=1, weight=[1.0, 1e-6])
    withstands(fsw.Controller(plant, FINE, 1.0, objective), load=1.0)


# Edges ----------------------------------------------------------------------------------------------------------------


def designs():
    """Corners of the argument, by name."""
    return {
        "uneven levels": fsw.Controller(LAGS, [-2.0, -1.7, -1.0, 0.5, 0.7, 2.0], 0.1, fsw.Endpoint(0.3, 3.0)),
        "price on switching": fsw.Controller(LAGS, FINE, 0.1, fsw.Endpoint(0.3, 3.0), switch_cost=1e-5),
        "no dead time": fsw.Controller(LAGS.replace(input_delay=0.0), FINE, 0.1, fsw.Endpoint(0.3, 3.0)),
        "dead time below Ts": fsw.Controller(LAGS.replace(input_delay=0.03), FINE, 0.1, fsw.Endpoint(0.3, 3.0)),
        "fast between instants": fsw.Controller(
            fsw.Plant([[-60.0, 20.0], [0.0, -0.3]], [[40.0], [1.0]], [[1.0, 0.0]], input_delay=0.07), FINE, 0.1,
            fsw.Endpoint(0.3, 3.0),
        ),
        "offsets": fsw.Controller(
            LAGS.replace(u_offset=0.6, y_offset=20.0), FINE, 0.1, fsw.Endpoint(0.3, 3.0)
        ),
        "zero tail": fsw.Controller(OVEN, [0.0, 1.0], 1.0, fsw.Endpoint(20.0, 1.0, tail="zero")),
        "relative degree given": fsw.Controller(LAGS, FINE, 0.1, fsw.Endpoint(0.4, 3.0, relative_degree=1)),
        "hidden direction": fsw.Controller(
            fsw.Plant(TWO_BY_TWO.A, TWO_BY_TWO.B, [[1.0, 0.0, 0.2]], input_delay=[0.37, 0.15]), [FINE, FINE], 0.1,
            fsw.Endpoint(0.3, 3.0),
        ),
        "more outputs than inputs": fsw.Controller(
            ONE_TO_TWO, FINE, 0.1, fsw.Endpoint(0.3, 3.0)
        ),
        "two by two": fsw.Controller(TWO_BY_TWO, [3 * FINE, 3 * FINE[::2]], 0.1, fsw.Endpoint(0.2, 3.0)),
        "an output without weight": fsw.Controller(
            ONE_TO_TWO, FINE, 0.1,
            fsw.Endpoint(0.3, 3.0, weight=[1.0, 0.0]),
        ),
        "estimator": fsw.Controller(
            LAGS, FINE, 0.1, fsw.Endpoint(0.5, 3.0), estimator=fsw.Kalman(1e-3, 1e-2, gate=0)
        ),
        "estimator of a load": fsw.Controller(
            LAGS, FINE, 0.1, fsw.Endpoint(0.5, 3.0), estimator=fsw.Kalman(1e-3, 1e-2, load=1e-4, gate=0)
        ),
    }  # fmt: skip


@pytest.mark.parametrize("share", [0.0, 1.0], ids=["exact", "wrong"])
@pytest.mark.parametrize("name", designs())
def test_edges_withstand(name, share, no_remedy):
    controller = designs()[name]
    errors = {"delay_error": 0.05 * controller.Ts, "gain_error": 0.02, "noise": 1e-3, "load": 0.01} if share else {}
    withstands(controller, rounds=2, **errors)


def test_a_dead_time_cannot_be_wrong_by_more_than_itself():
    controller = fsw.Controller(LAGS.replace(input_delay=0.02), FINE, 0.1, fsw.Endpoint(0.5, 3.0))
    withstands(controller, delay_error=0.05)


# End to end -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "reference",
    [RISE, fsw.HalfSine(100.0, 0.4), fsw.HalfSine(2500.0, 0.5), fsw.Ramp(5000.0), fsw.Steps([0.1, 0.4], [10.0, 60.0])],
    ids=repr,
)
@pytest.mark.parametrize("late", [-3e-4, 0.0, 3e-4])
def test_hot_gas_stays_within_its_bound(reference, late):
    certificate = fsw.certify(valve_controller(), reference=reference, duration=0.7, delay_error=abs(late))
    if not certificate.holds:
        assert "needs an ideal input" in certificate.reasons[0]
        return
    truth = VALVE.replace(input_delay=0.005 + late)
    assert strays(valve_controller(), reference, 0.7, truth=truth, delay_error=abs(late)) <= ROUND_OFF


@pytest.mark.parametrize("seed", range(5000, 5120))
def test_random_designs_stay_within_their_bounds(seed, no_remedy, monkeypatch):
    monkeypatch.setattr("foreswitch.certificate.margins.fastest", lambda *_: 0.0)
    _, controller, _ = draw(seed)
    if controller is None or controller.plant.inputs > 1:
        return
    rng = np.random.default_rng(seed)
    plain = fsw.certify(controller)
    if not plain.holds:
        return
    size = plain.resolution * np.exp(rng.uniform(-2, 4))
    for kind in ("square", "sine"):
        period = controller.Ts * np.exp(rng.uniform(np.log(5), np.log(300)))

        def reference(t, kind=kind, period=period, order=controller.order):
            wave = np.sin(2 * np.pi * np.asarray(t) / period)
            value = np.zeros((np.size(t), controller.plant.outputs, order))
            value[:, :, 0] = np.outer(np.sign(wave) if kind == "square" else wave, size) + controller.plant.y_offset
            return value

        certificate = fsw.certify(controller, reference=reference, duration=300 * controller.Ts)
        if certificate.holds:
            assert strays(controller, reference, 300 * controller.Ts) <= ROUND_OFF
