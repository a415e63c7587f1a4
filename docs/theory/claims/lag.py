"""The output does not trail by Tu + Td."""

import foreswitch as fsw

KIND, PAPER, HERE = "corrected", "the output trails by Tu + Td", "only where nothing decays; computed for every design"


def check() -> str:
    """The paper's plant and a double integrator on a ramp, computed and measured."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0))
    measured = fsw.simulate(law, fsw.Ramp(6000.0), 0.5).metrics()["lag"]
    mass = fsw.Plant.from_tf([1.0], [1.0, 0.0, 0.0], input_delay=0.005)
    coasting = fsw.Controller(mass, [-1, 0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0))
    assert abs(measured - law.lag) < 3e-4
    assert abs(coasting.lag - 0.025) < 1e-9
    return f"{1e3 * law.lag:.2f} ms computed, {1e3 * measured:.1f} ms measured; double integrator {1e3 * coasting.lag:g} ms"


if __name__ == "__main__":
    print(check())
