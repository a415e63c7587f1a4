"""The endpoint objective as a law: rows of theory [4], and the figures of the ideal loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.actuator import Actuator, level_products
from foreswitch.control.ideal_loop import ideal_response
from foreswitch.control.objective import Endpoint
from foreswitch.model import prediction
from foreswitch.model.plant import Plant

__all__ = ["EndpointLaw", "degrees"]


def degrees(plant: Plant, given: Any) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Relative degree of each output: the user's, else found numerically.

    Raises
    ------
    ValueError
        If one is out of range, or no input reaches an output.
    """
    if given is not None:
        values = check.per("relative_degree", given, plant.outputs, "output", least=1.0)
        if (values > plant.states).any() or (values != np.round(values)).any():
            raise Mistake("relative_degree", given, f"give whole numbers from 1 to {plant.states}")
        return values.astype(np.int64)
    found = prediction.relative_degrees(plant)
    if 0 in found:
        subject, problem = f"output {found.index(0) + 1}", "has no candidate effect (h = 0): no input reaches it"
        raise Mistake("plant", plant, "check B and C", problem=problem, subject=subject)
    return np.array(found, dtype=np.int64)


class EndpointLaw:
    """What `Controller` needs to know of an `Endpoint`; ``plant`` has its loads among the disturbances."""

    evaluations = 1

    def __init__(self, plant: Plant, objective: Endpoint, actuator: Actuator, Ts: float) -> None:
        if objective.Td < Ts * (1.0 - 1e-9):
            raise Mistake("Td", objective.Td, f"it must be at least one switching period Ts = {Ts:g}")
        q = plant.outputs
        self.plant, self.objective, self.actuator = plant, objective, actuator
        self.relative_degree = degrees(plant, objective.relative_degree)
        lam = check.per("lam", objective.lam, q, "output")
        self.weight = check.per("weight", objective.weight, q, "output")
        self.sliding = prediction.sliding(plant, lam, self.relative_degree.tolist())
        longest = [max(row) for row in actuator.dwell]
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            self.rows = prediction.endpoint_rows(plant, self.sliding, Ts, objective.Td, longest)
        self.rest = prediction.rest(plant) if objective.tail == "rest" else None
        for j, row in enumerate(self.rows.hold):
            scale = np.abs(self.sliding.state).sum(axis=1) * np.abs(plant.B[:, j]).max() * Ts
            if not np.isfinite(row).all():
                problem = f"= {objective.Td:g} s is too long for this unstable plant"
                raise Mistake("Td", objective.Td, "shorten it", problem=problem)
            if not (np.abs(row[0]) > 1e-14 * scale).any():
                problem = "has no effect on the sliding variable at the evaluation instant (h = 0)"
                raise Mistake(
                    "Td", objective.Td, "change Td, lam or the outputs", problem=problem, subject=f"input {j + 1}"
                )
        model = prediction.period_model(plant, Ts)
        self.dc_gain, self.lag = ideal_response(model, self.rows, self.sliding, self.rest, plant.C, self.weight, Ts)

    @staticmethod
    def reach(objective: Endpoint, Ts: float) -> tuple[float, str]:
        """How far the prediction goes beyond the dead time [s], and how the user calls it."""
        return float(objective.Td), "Td"

    def sampling(self, preview: bool | str | float) -> Array:
        """Offsets from t_k at which the reference is sampled, (1,), or (1, q) where outputs differ."""
        if isinstance(preview, str):
            if preview != "lag":
                raise Mistake("preview", preview, "give False, True, 'lag' or seconds")
            if not np.isfinite(self.lag).all():
                problem = "is 'lag', but the loop has no lag (its DC gain is 0)"
                raise Mistake("preview", preview, "give seconds", problem=problem)
            return self.lag[:1] if np.all(self.lag == self.lag[0]) else self.lag[None, :]
        if isinstance(preview, (bool, np.bool_)):
            return np.array([float(self.plant.input_delay.max()) + self.objective.Td if preview else 0.0])
        return np.array([check.number("preview", preview)])

    def tables(self) -> dict[str, Any]:
        """The tables from state_row to total_row of `Design`, with the holding times that give their sizes."""
        rows = self.rows
        return {
            "holds": [len(row) for row in rows.hold],
            "state_row": rows.state,
            "disturbance_row": rows.disturbance,
            "offset": rows.offset,
            "reference_row": self.sliding.reference,
            "half_weight": 0.5 * self.weight,
            "pending_table": level_products(rows.pending, self.actuator.levels),
            "hold_row": np.concatenate([np.ravel(row) for row in rows.hold]),
            "total_row": rows.total,
        }

    def horizon(self, real: str) -> None:
        """None: there is none."""

    def __str__(self) -> str:
        o = self.objective
        found = ", ".join(map(str, self.relative_degree))
        return f"Endpoint(Td={o.Td}, lam={o.lam!r}, tail={o.tail!r}), relative degree {found}"
