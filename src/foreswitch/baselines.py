"""What people use today, under its public name; it lives in `foreswitch.simulation.baselines`."""

from foreswitch.simulation.baselines import PIPWM, Baseline, Relay, SmithPWM, Tuned, tune

__all__ = ["PIPWM", "Baseline", "Relay", "SmithPWM", "Tuned", "tune"]
