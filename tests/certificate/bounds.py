"""Plants that are certified, and what an adversary or a run makes of their bounds."""

import numpy as np

import foreswitch as fsw
from oracles.adversary import attack
from systems import TWO_BY_TWO

ROUND_OFF = 1.0 + 1e-9
TICK = 1e-3
DOUBLE = fsw.Plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], input_delay=0.005)
PENDULUM = fsw.Plant([[0.0, 1.0], [4.0, 0.0]], [[0.0], [50.0]], input_delay=0.005)
LAGS = fsw.Plant([[-1.0, 1.0], [0.0, -0.3]], [[0.0], [1.0]], [[1.0, 0.0]], input_delay=0.25)
ONE_TO_TWO = fsw.Plant(TWO_BY_TWO.A, [[1.0], [0.1], [0.3]], TWO_BY_TWO.C, input_delay=0.37)
FINE = np.arange(-8, 9) / 4


def withstands(controller, seed=0, rounds=3, **errors):
    """The certificate, and its bounds over the worst that was found; they must hold."""
    certificate = fsw.certify(controller, **errors)
    assert certificate.holds, certificate.reasons
    found = []
    for (low, high), bound in certificate.arguments:
        worst = attack(controller, low, high, seed=seed, rounds=rounds, **errors)
        assert (worst <= bound * ROUND_OFF).all()
        found.append(bound / worst)
    return certificate, np.array(found)


def strays(controller, reference, duration, *, x0=None, truth=None, disturbance=None, **errors):
    """How far a run strays from the ideal response, in bounds, at its worst."""
    certificate = fsw.certify(
        controller, reference=reference, duration=duration, x0=x0, disturbance=disturbance, **errors
    )
    assert certificate.holds, certificate.reasons
    run = fsw.simulate(controller, reference, duration, plant=truth, x0=x0, disturbance=disturbance)
    ideal = certificate.ideal(reference, duration, x0=x0, disturbance=disturbance)
    return float((np.abs(run.y - ideal).max(axis=0) / certificate.error_bound).max())
