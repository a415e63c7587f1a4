"""Unstable plants have a certificate too."""

import numpy as np

import foreswitch as fsw

KIND, PAPER, HERE = (
    "completed",
    "unstable plants are left open",
    "proven, with the range of references that can be followed",
)


def check() -> str:
    """x'' = 4 x + 50 u under a sinusoid."""
    needle = fsw.Plant.from_tf([50.0], [1.0, 0.0, -4.0], input_delay=0.005)
    law = fsw.Controller(needle, [-1, 0, 1], 1e-3, fsw.Endpoint(Td=0.1, lam=20.0))
    swing = fsw.Sine(0.5, 0.5, offset=0.5, phase=-0.5 * np.pi)
    proof = fsw.certify(law, reference=swing, duration=4.0)
    seen = float(np.abs(fsw.simulate(law, swing, 4.0).y - proof.ideal(swing, 4.0)).max())
    assert proof.holds
    assert seen <= proof.error_bound[0]
    return f"poles at 2 and -2 1/s: at most {proof.error_bound[0]:.2e} from the ideal response; seen {seen:.2e}"


if __name__ == "__main__":
    print(check())
