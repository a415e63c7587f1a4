"""The horizon objective as a law: the tables of the exact search and what leads into them."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.actuator import Actuator, level_products
from foreswitch.control.design import HorizonDesign
from foreswitch.control.endpoint import degrees
from foreswitch.control.horizon_tables import horizon_model, horizon_tables, riccati_terminal
from foreswitch.control.objective import Horizon
from foreswitch.model import prediction
from foreswitch.model.plant import Plant

__all__ = ["HorizonLaw"]

TAILS = {"zero": 0, "rest": 1, "hold": 2}  # fsw_tail
#: A terminal cost needs a price on the input: at least this share of what the input does to the outputs.
LEAST_PRICE = 1e-6


class HorizonLaw:
    """What `Controller` needs to know of a `Horizon`; ``plant`` has its loads among the disturbances."""

    def __init__(self, plant: Plant, objective: Horizon, actuator: Actuator, Ts: float, core: ModuleType) -> None:
        q, m = plant.outputs, plant.inputs
        self.plant, self.objective, self.actuator, self.Ts = plant, objective, actuator, Ts
        if objective.lam is None:
            self.relative_degree = np.ones(q, dtype=np.int64)
            self.sliding = prediction.sliding(plant, np.ones(q), [1] * q)
        else:
            self.relative_degree = degrees(plant, objective.relative_degree)
            lam = check.per("lam", objective.lam, q, "output")
            self.sliding = prediction.sliding(plant, lam, self.relative_degree.tolist())
        self.weight = check.per("weight", objective.weight, q, "output")
        self.evaluations = objective.steps
        self.rest = prediction.rest(plant) if objective.tail == "rest" else None
        self.model = model = horizon_model(plant, Ts)
        self.steps, size = objective.steps + model.lead, model.F.shape[0]
        for argument, count, limit, what in (
            ("steps", self.steps, core.MAX_STEPS, "steps (those that the fastest input is ahead included)"),
            ("plant", size, core.HORIZON_STATES, "states and waiting moves"),
            ("levels", len(actuator.candidates), core.HORIZON_CANDIDATES, "candidates"),
        ):
            if count > limit:
                remedy = f"the core holds up to {limit}, use fewer"
                raise Mistake(argument, count, remedy, problem=f"has {count} {what}", subject="the horizon")
        first, last = objective.window or (1, objective.steps)
        root_weight = np.zeros((self.steps, q))
        root_weight[model.lead + first - 1 : model.lead + last] = np.sqrt(self.weight)
        S = np.hstack([self.sliding.state, np.zeros((q, size - plant.states))])
        move_weight = check.per("move_weight", objective.move_weight, m, "input")
        self.moves = objective.moves or objective.steps
        too_long = f"is {objective.steps}, too long for this unstable plant or these weights"
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            self.terminal = self._terminal(S, move_weight)
            try:
                self.search_tables = horizon_tables(
                    model.F, model.G, S, root_weight, self.moves, actuator.values(actuator.candidates),
                    actuator.candidates, move_weight, hold=objective.tail == "hold", switch_cost=actuator.switch_cost,
                    terminal=self.terminal,
                )  # fmt: skip
            except np.linalg.LinAlgError:
                raise Mistake("steps", objective.steps, "reduce them", problem=too_long) from None
        if not all(np.isfinite(a).all() for a in self.search_tables.arrays.values() if a is not None):
            raise Mistake("steps", objective.steps, "reduce them", problem=too_long)
        # the sequence is chosen with all of the reference in view: there is no one lag
        self.lag, self.dc_gain = np.full(q, np.nan), np.full((q, q), np.nan)

    @staticmethod
    def reach(objective: Horizon, Ts: float) -> tuple[float, str]:
        """How far the prediction goes beyond the dead time [s], and how the user calls it."""
        return objective.steps * Ts, "the horizon"

    def _terminal(self, S: Array, move_weight: Array) -> Array:
        """Root of the terminal cost, (rows, states of the horizon)."""
        given, model, n = self.objective.terminal, self.model, self.plant.states
        size = model.F.shape[0]
        if given is None:
            return np.zeros((0, size))
        if isinstance(given, str):
            least = LEAST_PRICE * np.einsum("oi,ij,o->j", S**2, model.G**2, self.weight)
            try:
                return riccati_terminal(model.F, model.G, S, self.weight, np.maximum(move_weight, least))
            except np.linalg.LinAlgError:
                problem = "is 'riccati', but the plant has a mode that no input moves or no output shows"
                raise Mistake("terminal", given, "leave it out, or give a matrix", problem=problem) from None
        P = check.array("terminal", given, (n, n))
        values, vectors = np.linalg.eigh((P + P.T) / 2.0)
        if not np.allclose(P, P.T) or values.min() < -1e-9 * max(values.max(), 1e-300):
            raise Mistake("terminal", P, "give a symmetric matrix without negative eigenvalues")
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return np.hstack([root, np.zeros((n, size - n))])

    def sampling(self, preview: bool | str | float) -> Array:
        """Offsets from t_k at which the reference is sampled, (steps,)."""
        if isinstance(preview, str):
            raise Mistake("preview", preview, "a Horizon takes False, True or seconds")
        if isinstance(preview, (bool, np.bool_)) and preview:
            result: Array = float(self.plant.input_delay.max()) + self.Ts * np.arange(1, self.evaluations + 1)
            return result
        ahead = 0.0 if isinstance(preview, (bool, np.bool_)) else check.number("preview", preview)
        return np.full(self.evaluations, ahead)

    def tables(self) -> dict[str, Any]:
        """The tables from state_row to total_row of `Design`: a horizon does without; holding times are the search's own."""
        none: dict[str, Any] = dict.fromkeys(
            ("state_row", "disturbance_row", "offset", "reference_row", "half_weight", "pending_table", "hold_row",
             "total_row")
        )  # fmt: skip
        return none | {"holds": [0] * self.plant.inputs}

    def horizon(self, real: str) -> HorizonDesign:
        """The tables of core/horizon.h."""
        plant, model, tables, sliding = self.plant, self.model, self.search_tables, self.sliding
        levels, candidates = self.actuator.levels, self.actuator.candidates
        # a dwell of which the search cannot see the end is as good as one just beyond it
        longest = self.steps + 1
        dwell = np.array(
            [[min(self.actuator.dwell[j][c], longest) for j, c in enumerate(command)] for command in candidates]
        )
        held = bool((dwell > 1).any())
        terminal_reference, terminal_disturbance, terminal_offset = self._aim()
        return HorizonDesign.made(
            real,
            plant_states=plant.states,
            pending_levels=sum(len(w) * v.size for w, v in zip(model.pending, levels, strict=True)),
            steps=self.steps,
            moves=self.moves,
            states=model.F.shape[0],
            inputs=plant.inputs,
            outputs=plant.outputs,
            candidates=len(candidates),
            disturbances=plant.disturbances,
            order=sliding.reference.shape[1],
            lead=model.lead,
            terminal=len(self.terminal),
            tail=TAILS[self.objective.tail],
            exclusive=int(tables.exclusive or held),
            dominance=int(tables.dominance),
            patience=tables.patience,
            node_budget=self.objective.node_budget or 2**32 - 1,
            start_row=model.state,
            start_disturbance=model.start_disturbance,
            start_offset=model.start,
            pending_table=level_products(model.pending, levels),
            drift=model.drift,
            drift_disturbance=model.disturbance,
            row_disturbance=sliding.disturbance,
            row_offset=sliding.offset,
            reference_row=sliding.reference,
            terminal_reference=terminal_reference,
            terminal_disturbance=terminal_disturbance,
            terminal_offset=terminal_offset,
            far=tables.far,
            level=candidates,
            dwell=dwell if held else None,
            **tables.arrays,
        )

    def _aim(self) -> tuple[Array, Array, Array]:
        """T z_rest as rows of the last reference, of w, and an offset."""
        rest = self.rest or prediction.rest(self.plant)
        aims = []
        for x, u in zip(rest.state, (rest.reference, rest.disturbance, rest.offset), strict=True):
            # a move that waits is one that holds the output at rest
            waiting = [np.repeat(u[j : j + 1], count, axis=0) for j, count in enumerate(self.model.waiting)]
            aims.append(self.terminal @ np.concatenate([x, *waiting]))
        return aims[0], aims[1], aims[2]

    def __str__(self) -> str:
        o = self.objective
        return f"Horizon({o.steps}, moves={self.moves}, tail={o.tail!r}), {len(self.actuator.candidates)} candidates"
