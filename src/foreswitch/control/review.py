"""The design review: what the core cannot hold, and what a user should know of a design before it runs."""

from __future__ import annotations

import warnings
from typing import Any

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.text import nearest
from foreswitch.control.actuator import LONGEST_HOLD, Actuator
from foreswitch.control.kalman import Kalman
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.plant import Plant

__all__ = ["check_kinds", "check_sizes", "warn_of_short_prediction"]


def check_kinds(plant: Any, objective: Any, estimator: Any, real: Any) -> None:
    """Whether each is of a kind that a controller is made of."""
    if not isinstance(plant, Plant):
        raise ValueError(f"plant is a {type(plant).__name__}; give a Plant, see Plant.from_control")
    if not isinstance(objective, (Endpoint, Horizon)):
        raise ValueError(f"objective is {objective!r}; give an Endpoint or a Horizon")
    if not (estimator is None or isinstance(estimator, Kalman)):
        raise ValueError(f"estimator is {estimator!r}; give a Kalman, or nothing where the state is measured")
    if real not in CORES:
        raise ValueError(f"real is {real!r}; {nearest(str(real), CORES)}")


def warn_of_short_prediction(actuator: Actuator, reach: float, name: str, stacklevel: int) -> None:
    """Where a dwell outlasts the prediction: ``reach`` seconds, which the user calls ``name``."""
    longest = max(max(row) for row in actuator.dwell_seconds)
    if longest > reach * (1.0 + 1e-9):
        warnings.warn(
            f"min_on or min_off of {longest:g} s exceeds {name} = {reach:g} s: a switch is judged before it may be "
            f"taken back; consider a longer {name.removeprefix('the ')}",
            UserWarning,
            stacklevel=stacklevel + 1,
        )


def check_sizes(plant: Plant, loads: int, actuator: Actuator, Ts: float, reach: float, real: str) -> None:
    """What the core can hold; before the design, which would take as long as it is large.

    Raises
    ------
    ValueError
        If something is larger.
    """
    core = CORES[real]
    longest = float(plant.input_delay.max())
    depth = check.periods(longest, Ts) + 1
    holds = min(max(map(max, actuator.dwell)), check.periods(longest + reach, Ts))
    for size, limit, what in (
        (plant.states, core.MAX_STATES, "states"),
        (plant.inputs, core.MAX_INPUTS, "inputs"),
        (plant.outputs, core.MAX_OUTPUTS, "outputs"),
        (plant.disturbances + loads, core.MAX_DISTURBANCES, "disturbances and loads"),
        (depth * plant.inputs, min(core.MAX_LINE, LONGEST_HOLD), "periods of dead time (times inputs)"),
        (holds, LONGEST_HOLD, "periods of dwell within the horizon"),
    ):
        if size > limit:
            raise ValueError(f"plant has {size} {what}; the core holds up to {limit}, perhaps with a longer Ts")
