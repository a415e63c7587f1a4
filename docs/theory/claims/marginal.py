"""The paper's own plant, which integrates, has a certificate."""

import numpy as np

import foreswitch as fsw

KIND, PAPER, HERE = "completed", "marginal plants, its own among them, are left open", "proven, at rest and in motion"


def check() -> str:
    """Bound and what is seen on the paper's rise, and on a double integrator under a sinusoid."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0))
    rise = fsw.HalfSine(height=1000.0, duration=0.5)
    proof = fsw.certify(law, reference=rise, duration=0.6)
    seen = float(np.abs(fsw.simulate(law, rise, 0.6).y - proof.ideal(rise, 0.6)).max())
    assert proof.holds
    assert seen <= proof.error_bound[0]
    return f"at most {proof.error_bound[0]:.2f} kPa from the ideal response; seen {seen:.2f}; half a pulse is 8.25"


if __name__ == "__main__":
    print(check())
