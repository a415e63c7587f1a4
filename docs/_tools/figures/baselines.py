"""The baselines with what the predictive law has."""

from __future__ import annotations

from pathlib import Path

import foreswitch as fsw
from figures.paper import DELAY, RISE, TD, TS, Values, hot_gas, hot_gas_controller


def rivals(folder: Path) -> Values:
    """Baselines tuned again with the preview the predictive law has; a short horizon under noise and a late valve."""
    plant, ahead = hot_gas(), hot_gas_controller().lag
    other = fsw.HalfSine(500.0, 0.12, start=0.05)
    values = {}
    for name, kind in (("pi", fsw.baselines.PIPWM), ("smith", fsw.baselines.SmithPWM)):
        best = fsw.baselines.tune(kind, plant, [0, 1], TS, RISE, 0.6, budget=300, shared={"preview": ahead})
        values[f"{name}_ahead"] = best.rms_error
        values[f"{name}_ahead_other"] = fsw.simulate(best.law, other, 0.25).metrics()["rms_error"]
    law = hot_gas_controller(preview="lag")
    values["ahead_other"] = fsw.simulate(law, other, 0.25).metrics()["rms_error"]
    for Td, name in ((TS, "short"), (TD, "long")):
        law = hot_gas_controller(Td=Td, preview="lag")
        noisy = fsw.simulate(law, RISE, 0.6, noise=[2.0, 50.0], seed=1)
        late = fsw.simulate(law, RISE, 0.6, plant=hot_gas(DELAY + 1e-3))
        values[f"{name}_noisy"] = noisy.metrics()["rms_error"]
        values[f"{name}_late"] = late.metrics()["rms_error"]
    return values
