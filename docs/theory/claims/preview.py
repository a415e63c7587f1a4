"""A reference sampled at the evaluation instant makes the output lead."""

import foreswitch as fsw

KIND, PAPER, HERE = "corrected", "a known reference is sampled at the evaluation instant", "one lag ahead"


def check() -> str:
    """Rms error of the paper's rise, three ways."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    rise, errors = fsw.HalfSine(height=1000.0, duration=0.5), []
    for preview in (False, True, "lag"):
        law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=0.020, lam=2500.0), preview=preview)
        errors.append(fsw.simulate(law, rise, 0.6).metrics()["rms_error"])
    assert errors[2] < 0.2 * min(errors[:2])
    return f"rms {errors[0]:.1f} kPa without preview, {errors[1]:.1f} at the evaluation instant, {errors[2]:.1f} at the lag"


if __name__ == "__main__":
    print(check())
