"""Leaving the dead time out of the prediction spoils the response."""

import foreswitch as fsw

KIND, PAPER, HERE = "confirmed", "without the dead time in the prediction the response is visibly poor", "it overshoots"


def check() -> str:
    """The paper's Fig. 5 and Fig. 6."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0))
    rise = fsw.HalfSine(height=1000.0, duration=0.5)
    known = fsw.simulate(law, rise, 0.6).y.max() - 1000.0
    ignored = fsw.simulate(law.replace(plant=valve.replace(input_delay=0.0)), rise, 0.6, plant=valve).y.max() - 1000.0
    assert known < 8.25 < 50.0 < ignored
    return f"overshoot {ignored:.0f} kPa instead of {known:.1f} kPa"


if __name__ == "__main__":
    print(check())
