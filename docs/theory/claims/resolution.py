"""Half a sinusoid is tracked within the resolution of one pulse."""

import numpy as np

import foreswitch as fsw

KIND, PAPER, HERE = (
    "confirmed",
    "tracking is accurate within the resolution of one pulse",
    "yes, around the lagging response",
)


def check() -> str:
    """Largest error against the reference one lag earlier."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0))
    rise = fsw.HalfSine(height=1000.0, duration=0.5)
    run = fsw.simulate(law, rise, 0.6)
    error = float(np.abs(run.y[:, 0] - rise(run.t - law.lag, 1)[:, 0, 0]).max())
    assert error < 0.5 * 16.5
    return f"at most {error:.1f} kPa off; a pulse is 16.5 kPa"


if __name__ == "__main__":
    print(check())
