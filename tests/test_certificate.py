"""Certificates against an adversary: what is proven must hold, whatever he does."""

import numpy as np
import pytest

import foreswitch as fsw
from certificate_designs import certified, draw
from certificate_oracle import attack
from systems import VALVE, valve_controller

ROUND_OFF = 1.0 + 1e-9


def withstands(controller, seed=0, **errors):
    """Bound over the worst that was found, of each argument; the bound must hold."""
    certificate = fsw.certify(controller, **errors)
    assert certificate.holds, certificate.reasons
    found = []
    for (low, high), bound in certificate.arguments:
        worst = attack(controller, low, high, seed=seed, **errors)
        assert (worst <= bound * ROUND_OFF).all()
        found.append(bound / worst)
    return certificate, np.array(found)


@pytest.mark.parametrize(
    "errors",
    [{}, {"noise": [1.0, 50.0]}, {"delay_error": 3e-4}, {"gain_error": 0.05}, {"load": 0.02},
     {"noise": [1.0, 50.0], "delay_error": 3e-4, "gain_error": 0.05, "load": 0.01}],
    ids=lambda errors: ", ".join(errors) or "no error",
)  # fmt: skip
def test_hot_gas_withstands(errors):
    _, found = withstands(valve_controller(), **errors)
    assert found.max() < 2.0


def test_hot_gas_has_the_range_of_a_modulator_without_overload():
    certificate = fsw.certify(valve_controller())
    (low, high), _ = certificate.arguments[0]
    assert (low[0], high[0]) == pytest.approx((0.006, 0.994), abs=5e-4)


def test_a_forbidden_level_widens_the_gap_of_a_single_input():
    controller = fsw.Controller(VALVE, [0.0, 0.5, 1.0], 1e-3, fsw.Endpoint(0.020, 2500.0), forbidden=[[0.5]])
    certificate, _ = withstands(controller)
    assert certificate.error_bound == pytest.approx(fsw.certify(valve_controller()).error_bound)


@pytest.mark.parametrize("seed", range(60))
def test_random_designs_withstand(seed, monkeypatch):
    monkeypatch.setattr("foreswitch.verdict._remedy", lambda *_: "")  # slow, and not the point
    _, controller, errors = draw(seed)
    if controller is None:
        return
    certificate, errors = certified(controller, errors)
    if certificate is None:
        return
    for (low, high), bound in certificate.arguments:
        worst = attack(controller, low, high, seed=seed, rounds=2, **errors)
        assert worst is None or (worst <= bound * ROUND_OFF).all()
