"""The controller: a design handed to the C core."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from foreswitch import _check, prediction
from foreswitch._check import Array
from foreswitch._text import nearest, tree
from foreswitch.core import CORES, REALS
from foreswitch.estimator import Kalman, load_entries, steady_filter
from foreswitch.horizon import HorizonModel, HorizonTables, horizon_model, horizon_tables, riccati_terminal
from foreswitch.objective import Endpoint, Horizon
from foreswitch.plant import Plant

__all__ = [
    "Controller",
    "Decision",
    "Status",
    "canonical_reference",
    "dwell_periods",
    "input_levels",
    "level_indices",
    "safe_indices",
]


class Status(IntEnum):
    """What a command is based on; `remedy` says what to do about it."""

    OK = 0
    COASTING = 1
    HELD = 2
    SAFE = 3

    @property
    def remedy(self) -> str:
        """What happened and what to do, in one sentence."""
        return REMEDIES[self]


REMEDIES = {
    Status.OK: "The command rests on the measurement.",
    Status.COASTING: "A measurement was not finite, or an outlier, and the model's prediction stood in for it. Check the "
    "sensor.",
    Status.HELD: "There was no usable measurement yet, the reference was not finite, or every cost overflowed, and the "
    "present command was kept. Give one measurement and a reference of a sensible size.",
    Status.SAFE: "The safe level was commanded after bad_limit bad samples in a row. Repair the sensor; control "
    "resumes with the first finite measurement.",
}


@dataclass(frozen=True)
class Decision:
    """What a controller would command now, and why.

    Attributes
    ----------
    u : ndarray, shape (m,)
        The command.
    cost : float
        Its predicted cost.
    candidates : ndarray, shape (p, m)
        Every allowed command.
    costs : ndarray, shape (p,)
        Their predicted costs, infinite where a running dwell forbids one.
    sequence : ndarray, shape (moves, m)
        The planned commands, the first of them ``u``.
    nodes : int
        Candidates evaluated.
    optimal : bool
        Whether ``u`` is proven to be the best.
    gap : float
        Cost that an unexplored command could still save.
    status : Status
    """

    u: Array
    cost: float
    candidates: Array
    costs: Array
    sequence: Array
    nodes: int
    optimal: bool
    gap: float
    status: Status


def input_levels(levels: Any, inputs: int) -> list[Array]:
    """Per input, its ascending levels."""
    nested = isinstance(levels, (list, tuple)) and any(np.ndim(item) > 0 for item in levels)
    given = list(levels) if nested or getattr(levels, "ndim", 1) > 1 else [levels]
    if len(given) != inputs:
        raise ValueError(f"levels lists {len(given)} input(s); the plant has {inputs}, give one list for each")
    result = []
    for j, item in enumerate(given):
        values = _check.array(f"levels of input {j + 1}", item)
        if values.ndim != 1 or not 2 <= values.size <= 255:
            raise ValueError(f"levels of input {j + 1} have shape {values.shape}; give 2 to 255 levels in a row")
        if (np.diff(values) <= 0).any():
            raise ValueError(f"levels of input {j + 1} are {values.tolist()}; they must ascend")
        result.append(values)
    return result


def level_indices(name: str, command: ArrayLike, levels: list[Array]) -> list[int]:
    """A command as level indices."""
    values = np.atleast_1d(_check.array(name, command))
    if values.shape != (len(levels),):
        raise ValueError(f"{name} is {np.asarray(command).tolist()}; give one level for each of {len(levels)} input(s)")
    result = []
    for j, value in enumerate(values):
        hit = np.flatnonzero(levels[j] == value)
        if hit.size == 0:
            raise ValueError(f"{name} holds {value:g}; the levels of input {j + 1} are {levels[j].tolist()}")
        result.append(int(hit[0]))
    return result


def safe_indices(safe_level: ArrayLike | None, levels: list[Array]) -> list[int]:
    """The declared safe levels, else per input the level nearest 0 (the lower of two)."""
    if safe_level is None:
        return [int(np.argmin(np.abs(values))) for values in levels]
    return level_indices("safe_level", safe_level, levels)


#: Periods that the core counts in 32 bits, and in 16.
LONGEST_DWELL, LONGEST_HOLD = 2**32 - 1, 2**16 - 1


def dwell_periods(
    levels: list[Array], safe: list[int], min_on: ArrayLike, min_off: ArrayLike, Ts: float
) -> tuple[list[list[int]], list[list[float]]]:
    """Shortest run at each level of each input, in periods and in seconds: off is the safe level, on any other."""
    on = _check.per("min_on", min_on, len(levels), "input", least=0.0)
    off = _check.per("min_off", min_off, len(levels), "input", least=0.0)
    longest = float(max(on.max(), off.max()))
    if longest / Ts > LONGEST_DWELL:
        raise ValueError(f"min_on or min_off is {longest:g} s; it must be at most 2^32 - 1 periods of Ts = {Ts:g} s")
    seconds = [[float(off[j] if i == safe[j] else on[j]) for i in range(v.size)] for j, v in enumerate(levels)]
    return [[max(1, _check.periods(s, Ts)) for s in row] for row in seconds], seconds


class Controller:
    """Chooses, at each switching period, the command whose predicted outcome is best.

    Parameters
    ----------
    plant : Plant
        The model to predict with.
    levels : array_like, or list of them
        One input: its levels, ascending. Several: one list each. All combinations are candidates.
    Ts : float
        Switching period [s].
    objective : Endpoint or Horizon
        What to minimise.
    min_on, min_off : float or array_like, shape (m,)
        Shortest time at a level [s]; an input is off at its safe level, on at any other.
    switch_cost : float or array_like, shape (m,)
        Added to the cost of a command for each input that it changes.
    forbidden : sequence of commands
        Combinations of levels that must never be commanded.
    estimator : Kalman, optional
        Estimates the state from the outputs, which are then measured in its place.
    preview : bool, "lag" or float
        When the reference is sampled, relative to t_k: now, at the evaluation instant (True), ahead by
        the loop's lag, or by that many seconds.
    safe_level : float or array_like, shape (m,), optional
        Commanded after ``bad_limit`` bad measurements in a row; not declared: never. Also the level in
        which an input counts as off, by default 0 where that is a level, else the level nearest 0.
    bad_limit : int
        Bad measurements in a row that force the declared safe level.
    real : {"float64", "float32"}
        Arithmetic of the core.

    Attributes
    ----------
    lag : float or ndarray, shape (q,)
        Steady ramp error per unit slope of the ideal loop, all derivatives supplied and the reference
        sampled at t_k [s]. NaN where the DC gain is 0.
    dc_gain : float or ndarray, shape (q, q)
        DC gain of the ideal loop yd -> y.
    relative_degree : ndarray, shape (q,)
        Derivatives of each output until an input appears.
    kalman : Filter or None
        The designed filter: ``gain``, ``poles``, ``innovation`` covariance.

    Raises
    ------
    ValueError
        If an argument is out of range, no candidate is left, or an input has no effect on the objective.

    Warns
    -----
    UserWarning
        If a dwell is longer than Td, so that the prediction ends before the next switch is allowed.

    Examples
    --------
    >>> valve = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    >>> controller = Controller(valve, [0, 1], 1e-3, Endpoint(Td=0.020, lam=2500.0))
    >>> controller.step([0.0, 0.0], 100.0)
    array([1.])
    >>> controller
    Controller
    ├─ objective  Endpoint(Td=0.02, lam=2500.0, tail='rest'), relative degree 2
    ├─ input u    levels 0, 1 every 0.001 s, 5 periods under way
    ├─ reference  value and 1 derivative(s), sampled at t_k + 0 s
    └─ loop       lag 0.01136 s, DC gain 1, float64
    """

    def __init__(
        self,
        plant: Plant,
        levels: Any,
        Ts: float,
        objective: Endpoint | Horizon,
        *,
        min_on: ArrayLike = 0.0,
        min_off: ArrayLike = 0.0,
        switch_cost: ArrayLike = 0.0,
        forbidden: Sequence[ArrayLike] = (),
        estimator: Kalman | None = None,
        preview: bool | Literal["lag"] | float = False,
        safe_level: ArrayLike | None = None,
        bad_limit: int = 10,
        real: Literal["float64", "float32"] = "float64",
    ) -> None:
        if not isinstance(plant, Plant):
            raise ValueError(f"plant is a {type(plant).__name__}; give a Plant, see Plant.from_control")
        if not isinstance(objective, (Endpoint, Horizon)):
            raise ValueError(f"objective is {objective!r}; give an Endpoint or a Horizon")
        if not (estimator is None or isinstance(estimator, Kalman)):
            raise ValueError(f"estimator is {estimator!r}; give a Kalman, or nothing where the state is measured")
        if real not in CORES:
            raise ValueError(f"real is {real!r}; {nearest(str(real), CORES)}")
        self._arguments = {
            "plant": plant, "levels": levels, "Ts": Ts, "objective": objective, "min_on": min_on, "min_off": min_off,
            "switch_cost": switch_cost, "forbidden": forbidden, "estimator": estimator, "preview": preview,
            "safe_level": safe_level, "bad_limit": bad_limit, "real": real,
        }  # fmt: skip
        self.plant, self.objective, self.estimator, self.real = plant, objective, estimator, real
        self.Ts = _check.number("Ts", Ts, above=0.0)
        self.levels = input_levels(levels, plant.inputs)
        if isinstance(objective, Endpoint) and objective.Td < self.Ts * (1.0 - 1e-9):
            raise ValueError(f"Td is {objective.Td:g}; it must be at least one switching period Ts = {self.Ts:g}")
        if not 1 <= _check.number("bad_limit", bad_limit) <= 65535 or bad_limit != int(bad_limit):
            raise ValueError(f"bad_limit is {bad_limit}; give 1 to 65535 samples")
        self._safe = safe_indices(safe_level, self.levels)
        self._dwell, self._dwell_seconds = dwell_periods(self.levels, self._safe, min_on, min_off, self.Ts)
        self._switch_cost = _check.per("switch_cost", switch_cost, plant.inputs, "input", least=0.0)
        self._candidates = self._allowed(forbidden)
        self._bad_limit = 0 if safe_level is None else int(bad_limit)
        self._warn_of_short_horizon()
        self._check_sizes()
        self._design()
        self._reference_offset = self._sampling(preview)
        self._parts = self._core_parts()
        self._core = self._new_core()
        self.reset()

    def _new_core(self) -> Any:
        return CORES[self.real].Predictive(*self._parts, partial(np.empty, (64, self.plant.inputs)))

    # ---- Design ----

    def _allowed(self, forbidden: Sequence[ArrayLike]) -> Array:
        """Level indices of the candidates, shape (p, m), in lexicographic order."""
        if isinstance(forbidden, str) or not isinstance(forbidden, (Sequence, np.ndarray)):
            raise ValueError(f"forbidden is {forbidden!r}; give a list of commands")
        no = {tuple(level_indices("forbidden", command, self.levels)) for command in forbidden}
        count = int(np.prod([values.size for values in self.levels], dtype=np.float64))
        if count > 65535:
            raise ValueError(f"levels form {count} combinations; at most 65535 fit one decision, use fewer levels")
        every = itertools.product(*(range(values.size) for values in self.levels))
        allowed = [combination for combination in every if combination not in no]
        if len(allowed) < 2:
            raise ValueError(f"forbidden leaves {len(allowed)} command(s); at least two are needed for a choice")
        if tuple(self._safe) in no:
            level = [float(v[i]) for v, i in zip(self.levels, self._safe, strict=True)]
            raise ValueError(f"forbidden contains the safe level {level}; declare an allowed safe_level")
        return np.array(allowed, dtype=np.uint8)

    @property
    def _reach(self) -> float:
        """How far the prediction goes beyond the dead time [s]."""
        objective = self.objective
        return float(objective.Td) if isinstance(objective, Endpoint) else objective.steps * self.Ts

    def _warn_of_short_horizon(self) -> None:
        longest = max(max(row) for row in self._dwell_seconds)
        if longest > self._reach * (1.0 + 1e-9):
            name = "Td" if isinstance(self.objective, Endpoint) else "the horizon"
            warnings.warn(
                f"min_on or min_off of {longest:g} s exceeds {name} = {self._reach:g} s: a switch is judged before "
                f"it may be taken back; consider a longer {'Td' if name == 'Td' else 'one'}",
                UserWarning,
                stacklevel=3,
            )

    def _check_sizes(self) -> None:
        """What the core can hold; before the design, which would take as long as it is large."""
        plant, core = self.plant, CORES[self.real]
        loads = 0 if self.estimator is None else load_entries(self.estimator, plant).shape[1]
        longest = float(plant.input_delay.max())
        depth = _check.periods(longest, self.Ts) + 1
        reach = min(max(map(max, self._dwell)), _check.periods(longest + self._reach, self.Ts))
        for size, limit, what in (
            (plant.states, core.MAX_STATES, "states"),
            (plant.inputs, core.MAX_INPUTS, "inputs"),
            (plant.outputs, core.MAX_OUTPUTS, "outputs"),
            (plant.disturbances + loads, core.MAX_DISTURBANCES, "disturbances and loads"),
            (depth * plant.inputs, min(core.MAX_LINE, LONGEST_HOLD), "periods of dead time (times inputs)"),
            (reach, LONGEST_HOLD, "periods of dwell within the horizon"),
        ):
            if size > limit:
                raise ValueError(f"plant has {size} {what}; the core holds up to {limit}, perhaps with a longer Ts")

    def _design(self) -> None:
        """Everything that can be computed before the first measurement."""
        objective, q, plant = self.objective, self.plant.outputs, self._with_loads()
        self._weight = _check.per("weight", objective.weight, q, "output")
        self._rest = prediction.rest(plant) if objective.tail == "rest" else None
        self._model = prediction.period_model(plant, self.Ts)
        self.kalman = None
        if self.estimator is not None:
            load_steps = self._model.disturbance[:, self.plant.disturbances :]
            self.kalman = steady_filter(self.estimator, self.plant, self._model.transition, load_steps)
        if isinstance(objective, Endpoint):
            self._design_endpoint(objective, plant)
        else:
            self._design_horizon(objective, plant)

    def _design_endpoint(self, objective: Endpoint, plant: Plant) -> None:
        """Rows of theory [4] and the loop's figures."""
        q = plant.outputs
        self.relative_degree = self._degrees()
        self._lam = _check.per("lam", objective.lam, q, "output")
        self._sliding = prediction.sliding(plant, self._lam, self.relative_degree.tolist())
        longest = [max(row) for row in self._dwell]
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            self._rows = prediction.endpoint_rows(plant, self._sliding, self.Ts, objective.Td, longest)
        for j, row in enumerate(self._rows.hold):
            scale = np.abs(self._sliding.state).sum(axis=1) * np.abs(plant.B[:, j]).max() * self.Ts
            if not np.isfinite(row).all():
                raise ValueError(f"Td = {objective.Td:g} s is too long for this unstable plant; shorten it")
            if not (np.abs(row[0]) > 1e-14 * scale).any():
                raise ValueError(
                    f"input {j + 1} has no effect on the sliding variable at the evaluation instant (h = 0); "
                    "change Td, lam or the outputs"
                )
        gain, lag = prediction.ideal_response(
            self._model, self._rows, self._sliding, self._rest, plant.C, self._weight, self.Ts
        )
        self.lag = float(lag[0]) if q == 1 else lag
        self.dc_gain = float(gain[0, 0]) if q == 1 else gain

    def _design_horizon(self, objective: Horizon, plant: Plant) -> None:
        """Tables of the exact search."""
        q, m = plant.outputs, plant.inputs
        if objective.lam is None:
            self.relative_degree = np.ones(q, dtype=np.int64)
            self._sliding = prediction.sliding(plant, np.ones(q), [1] * q)
        else:
            self.relative_degree = self._degrees()
            lam = _check.per("lam", objective.lam, q, "output")
            self._sliding = prediction.sliding(plant, lam, self.relative_degree.tolist())
        model = self._horizon_model = horizon_model(plant, self.Ts)
        core, steps = CORES[self.real], objective.steps + model.lead
        size = model.F.shape[0]
        for count, limit, what in (
            (steps, core.MAX_STEPS, "steps (those that the fastest input is ahead included)"),
            (size, core.HORIZON_STATES, "states and waiting moves"),
            (len(self._candidates), core.HORIZON_CANDIDATES, "candidates"),
        ):
            if count > limit:
                raise ValueError(f"the horizon has {count} {what}; the core holds up to {limit}, use fewer")
        first, last = objective.window or (1, objective.steps)
        root_weight = np.zeros((steps, q))
        root_weight[model.lead + first - 1 : model.lead + last] = np.sqrt(self._weight)
        S = np.hstack([self._sliding.state, np.zeros((q, size - plant.states))])
        move_weight = _check.per("move_weight", objective.move_weight, m, "input")
        terminal = self._terminal(objective, model, S, move_weight)
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            try:
                self._tables = horizon_tables(
                    model.F, model.G, S, root_weight, objective.moves or objective.steps,
                    self._values(self._candidates), self._candidates, move_weight, hold=objective.tail == "hold",
                    switch_cost=self._switch_cost, terminal=terminal,
                )  # fmt: skip
            except np.linalg.LinAlgError:
                raise ValueError(f"steps is {objective.steps}, too long for this unstable plant; shorten it") from None
        if not all(np.isfinite(a).all() for a in self._tables.arrays.values() if a is not None):
            raise ValueError(f"steps is {objective.steps}, too long for this unstable plant; shorten it")
        self._terminal_root = terminal
        # the sequence is chosen with the whole reference in view; what lag is left is the quantiser's
        self.lag = np.nan if q == 1 else np.full(q, np.nan)
        self.dc_gain = np.nan if q == 1 else np.full((q, q), np.nan)

    def _terminal(self, objective: Horizon, model: HorizonModel, S: Array, move_weight: Array) -> Array:
        """Root of the terminal cost, (rows, states of the horizon)."""
        size, n = model.F.shape[0], self.plant.states
        if objective.terminal is None:
            return np.zeros((0, size))
        if isinstance(objective.terminal, str):
            least = 1e-6 * np.einsum("oi,ij,o->j", S**2, model.G**2, self._weight)
            try:
                return riccati_terminal(model.F, model.G, S, self._weight, np.maximum(move_weight, least))
            except np.linalg.LinAlgError:
                raise ValueError(
                    "terminal is 'riccati', but the plant has a mode that no input moves or no output shows; "
                    "leave it out, or give a matrix"
                ) from None
        P = _check.array("terminal", objective.terminal, (n, n))
        values, vectors = np.linalg.eigh((P + P.T) / 2.0)
        if not np.allclose(P, P.T) or values.min() < -1e-9 * max(values.max(), 1e-300):
            raise ValueError(f"terminal is {P.tolist()}; give a symmetric matrix without negative eigenvalues")
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return np.hstack([root, np.zeros((n, size - n))])

    def _with_loads(self) -> Plant:
        """The plant with its loads behind its measured disturbances, which is all that prediction has to know of them."""
        if self.estimator is None:
            return self.plant
        return self.plant.replace(E=np.hstack([self.plant.E, load_entries(self.estimator, self.plant)]))

    def _degrees(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        given = self.objective.relative_degree
        if given is not None:
            values = _check.per("relative_degree", given, self.plant.outputs, "output", least=1.0)
            if (values > self.plant.states).any() or (values != np.round(values)).any():
                raise ValueError(f"relative_degree is {given!r}; give whole numbers from 1 to {self.plant.states}")
            return values.astype(np.int64)
        found = prediction.relative_degrees(self.plant)
        if 0 in found:
            raise ValueError(
                f"output {found.index(0) + 1} has no candidate effect (h = 0): no input reaches it; check B and C"
            )
        return np.array(found, dtype=np.int64)

    def _sampling(self, preview: bool | str | float) -> Array:
        """Offsets from t_k at which the reference is sampled, (1,), or (1, q) where outputs differ."""
        if isinstance(self.objective, Horizon):
            if isinstance(preview, str):
                raise ValueError(f"preview is {preview!r}; a Horizon takes False, True or seconds")
            if isinstance(preview, (bool, np.bool_)) and preview:
                steps = np.arange(1, self.objective.steps + 1)
                return np.asarray(float(self.plant.input_delay.max()) + steps * self.Ts)
            return np.full(self.objective.steps, 0.0 if isinstance(preview, (bool, np.bool_)) else preview, dtype=float)
        if isinstance(preview, str):
            if preview != "lag":
                raise ValueError(f"preview is {preview!r}; give False, True, 'lag' or seconds")
            lag = np.atleast_1d(self.lag)
            if not np.isfinite(lag).all():
                raise ValueError("preview is 'lag', but the loop has no lag (its DC gain is 0); give seconds")
            return lag[:1] if np.all(lag == lag[0]) else lag[None, :]
        if isinstance(preview, (bool, np.bool_)):
            horizon = float(self.plant.input_delay.max()) + self.objective.Td
            return np.array([horizon if preview else 0.0])
        return np.array([_check.number("preview", preview)])

    def _core_parts(self) -> tuple[tuple[int, ...], tuple[Any, ...], Any]:
        """Sizes, arrays and horizon of the core's design, in the order of the binding."""
        reals = partial(_reals, REALS[self.real])
        plant, model, rest, kalman = self.plant, self._model, self._rest, self.kalman
        n, m, q, p = plant.states, plant.inputs, plant.outputs, self._disturbances
        limit = 0 if self.estimator is None else int(self.estimator.gate_limit)
        horizon = isinstance(self.objective, Horizon)
        rows = None if horizon else self._rows
        exact = np.concatenate(self.levels)
        sizes = (n, m, q, p, self.order, max(model.delay) + 1, len(self._candidates), self._bad_limit, self._measured[0],
                 p - plant.disturbances, limit)  # fmt: skip
        if horizon and rest is None:
            rest_arrays: tuple[Any, ...] = (None,) * 3
        else:
            rest_arrays = tuple(map(reals, (rest.reference, rest.disturbance, rest.offset))) if rest else (None,) * 3
        arrays = (
            np.array([v.size for v in self.levels], dtype=np.uint8),
            np.array(model.delay, dtype=np.uint16),
            np.array([len(h) for h in rows.hold] if rows else [0] * m, dtype=np.uint16),
            exact,
            reals(exact),
            self._candidates.ravel(),
            np.array(self._safe, dtype=np.uint8),
            *(self._endpoint_arrays(rows) if rows else (None,) * 8),
            *rest_arrays,
            np.concatenate([np.array(row, dtype=np.uint32) for row in self._dwell]),
            reals(self._switch_cost),
            *map(reals, (model.transition, model.old, model.new, model.disturbance, model.drift)),
        )
        if kalman is None:
            arrays += (None,) * 6
        else:
            gate = None if kalman.gate is None else reals(kalman.gate)
            estimation = (kalman.gain, plant.C, plant.y_offset, kalman.start_row, kalman.start_offset)
            arrays += (*map(reals, estimation), gate)
        return sizes, arrays, self._horizon_parts() if horizon else None

    def _endpoint_arrays(self, rows: prediction.EndpointRows) -> tuple[Any, ...]:
        """From state_row to total_row."""
        reals = partial(_reals, REALS[self.real])
        return (
            *map(reals, (rows.state, rows.disturbance, rows.offset, self._sliding.reference, 0.5 * self._weight)),
            reals(_products(rows.pending, self.levels)),
            reals(np.concatenate([np.ravel(a) for a in rows.hold])),
            reals(rows.total),
        )

    def _horizon_parts(self) -> tuple[Any, ...]:
        """Scalars and arrays of the core's horizon."""
        objective, model, tables, sliding = self.objective, self._horizon_model, self._tables, self._sliding
        assert isinstance(objective, Horizon)
        reals = partial(_reals, REALS[self.real])
        root, q, p = self._terminal_root, self.plant.outputs, self._disturbances
        aim = self._rest_of_horizon() if len(root) else (np.zeros((0, q)), np.zeros((0, p)), np.zeros(0))
        # a dwell of which the search cannot see the end is as good as one just beyond it
        longest = objective.steps + model.lead + 1
        dwell = np.array([[min(self._dwell[j][c], longest) for j, c in enumerate(command)] for command in self._candidates])
        exclusive = tables.exclusive or bool((dwell > 1).any())
        tails = {"zero": 0, "rest": 1, "hold": 2}
        sizes = (objective.steps + model.lead, objective.moves or objective.steps, model.F.shape[0], self.order, model.lead,
                 len(root), tails[objective.tail], int(exclusive), int(tables.dominance), tables.patience,
                 objective.node_budget or 2**32 - 1)  # fmt: skip
        arrays = (
            *map(reals, (model.state, model.start_disturbance, model.start)),
            reals(_products(model.pending, self.levels)),
            *map(reals, (model.drift, model.disturbance, sliding.disturbance, sliding.offset, sliding.reference)),
            *map(reals, aim),
            *(None if tables.arrays[name] is None else reals(tables.arrays[name]) for name in TABLES),
            self._candidates.ravel(),
            dwell.astype(np.uint16).ravel() if (dwell > 1).any() else None,
        )
        return sizes, tables.far, arrays

    def _rest_of_horizon(self) -> tuple[Array, Array, Array]:
        """T z_rest as rows of the last reference, of w, and an offset."""
        rest = prediction.rest(self._with_loads())
        model, root = self._horizon_model, self._terminal_root
        inputs = (rest.reference, rest.disturbance, rest.offset)
        result = []
        for state, u in zip(rest.state, inputs, strict=True):
            # a move that waits is one that holds the output at rest
            waiting = [np.repeat(u[j : j + 1], delay, axis=0) for j, delay in enumerate(model.waiting)]
            result.append(root @ np.concatenate([state, *waiting]))
        return result[0], result[1], result[2]

    @property
    def _disturbances(self) -> int:
        """Measured disturbances and loads."""
        return int(self._model.disturbance.shape[1])

    @property
    def _measured(self) -> tuple[int, str]:
        """How many values are measured, and what they are."""
        plant = self.plant
        return (plant.states, "measured state") if self.estimator is None else (plant.outputs, "measured output")

    # ---- What the caller must supply ----

    @property
    def order(self) -> int:
        """Reference derivatives wanted, the value included."""
        return int(self._sliding.reference.shape[1])

    @property
    def evaluations(self) -> int:
        """Instants at which the reference is wanted."""
        return 1 if isinstance(self.objective, Endpoint) else self.objective.steps

    @property
    def reference_times(self) -> Array:
        """Their offsets from t_k [s], shape (evaluations,).

        With ``preview="lag"`` and outputs of different lags: shape (evaluations, q).
        """
        return self._reference_offset.copy()

    @property
    def pending_steps(self) -> int:
        """Commands under way, as many as the longest dead time has periods, rounded up."""
        return max(self._model.delay)

    # ---- Run time ----

    @property
    def status(self) -> Status:
        """What the latest command is based on."""
        code: int = self._core.status
        return STATUSES[code]

    @property
    def estimate(self) -> tuple[Array, Array]:
        """The state (n,) and the loads (l,) that the latest command is based on; NaN before anything was measured."""
        x, w = np.empty(self.plant.states), np.empty(self._disturbances)
        if not self._core.estimate(x, w):
            x[:], w[:] = np.nan, np.nan
        return x, w[self.plant.disturbances :]

    def reset(
        self,
        *,
        pending: ArrayLike | None = None,
        elapsed: ArrayLike | None = None,
        estimate: ArrayLike | None = None,
        load: ArrayLike | None = None,
        disturbance: ArrayLike | None = None,
    ) -> None:
        """Forget the measurements; start from known commands, and from a known state if there is one.

        Parameters
        ----------
        pending : array_like, shape (rows, m), optional
            Commands issued but not yet acted on, oldest first, the last one in force; at least
            `pending_steps` rows. One input: also shape (rows,). Default: the safe level.
        elapsed : float or array_like, shape (m,), optional
            Seconds since each input last switched. Default: long ago.
        estimate : array_like, shape (n,), optional
            State one period before the next step, as the property `estimate` tells it. Default: the first measurement,
            with an estimator the state at rest there.
        load, disturbance : array_like, shape (l,) and (p,), optional
            Loads and measured disturbance at that instant. Default: zero.

        Raises
        ------
        ValueError
            If a row is missing, is not an allowed command, a time is negative, or a shape does not fit.
        """
        m, depth = self.plant.inputs, self.pending_steps + 1
        known = self._known(estimate, load, disturbance)
        line = np.array([self._safe] * depth, dtype=np.uint8)
        if pending is not None:
            values = _check.array("pending", pending)
            if values.ndim < 2:
                values = values.reshape(-1, 1) if m == 1 else values.reshape(1, -1)
            if values.ndim != 2 or values.shape[1] != m or len(values) < self.pending_steps:
                raise ValueError(
                    f"pending has shape {np.shape(pending)}; give at least {self.pending_steps} row(s) of {m} level(s)"
                )
            given = [level_indices("pending", row, self.levels) for row in values[-depth:]]
            allowed = {tuple(c) for c in self._candidates.tolist()}
            for row in given:
                if tuple(row) not in allowed:
                    level = [float(v[i]) for v, i in zip(self.levels, row, strict=True)]
                    raise ValueError(f"pending holds the forbidden command {level}; start from an allowed one")
            if given:
                given = [given[0]] * (depth - len(given)) + given
                line = np.array(given, dtype=np.uint8)
        wait = np.zeros(m, dtype=np.uint32)
        if elapsed is not None:
            since = _check.per("elapsed", elapsed, m, "input", least=0.0)
            for j in range(m):
                wait[j] = _check.periods(self._dwell_seconds[j][line[-1, j]] - since[j], self.Ts)
        self._core.preload(line.ravel(), wait)
        if known is not None:
            self._core.start(*known)

    def _known(
        self, estimate: ArrayLike | None, load: ArrayLike | None, disturbance: ArrayLike | None
    ) -> tuple[Any, Any] | None:
        """A known state, and the disturbances with the loads behind them, as the core takes them."""
        p = self.plant.disturbances
        loads = self._disturbances - p
        if estimate is None:
            for name, value in (("load", load), ("disturbance", disturbance)):
                if value is not None:
                    raise ValueError(f"{name} is {value!r} without a state; give estimate too")
            return None
        x = _check.array("estimate", estimate, (self.plant.states,))
        w = [
            np.zeros(size) if value is None else _check.array(name, np.atleast_1d(np.asarray(value)), (size,))
            for name, value, size in (("disturbance", disturbance, p), ("load", load, loads))
        ]
        real = REALS[self.real]
        return x.astype(real), np.concatenate(w).astype(real)

    def step(self, x: ArrayLike, reference: ArrayLike, *, disturbance: ArrayLike | None = None) -> Array:
        """One switching period: choose and remember the command.

        Parameters
        ----------
        x : array_like, shape (n,); with an estimator (q,)
            Measured state, or measured outputs. NaN or infinity is no error: the model's prediction stands in, `status`
            says so.
        reference : array_like
            Canonical shape (evaluations, q, order). Short forms, over all evaluations: a scalar;
            1-D, (order,) for one output, else (q,); 2-D, (q, order). Missing derivatives are zero.
        disturbance : array_like, shape (p,), optional
            Measured w. Default: zero.

        Returns
        -------
        ndarray, shape (m,)
            The levels to command until the next step.

        Raises
        ------
        ValueError
            If a shape does not fit or the reference is not finite.
        """
        u: Array | None = self._core.step(x, reference, disturbance)
        if u is not None:
            return u
        converted: Array = self._core.step(*self._canonical(x, reference, disturbance))
        return converted

    def decide(self, x: ArrayLike, reference: ArrayLike, *, disturbance: ArrayLike | None = None) -> Decision:
        """Every candidate with its predicted cost; changes nothing.

        Parameters
        ----------
        x, reference, disturbance
            As in `step`.

        Returns
        -------
        Decision

        Raises
        ------
        ValueError
            As in `step`.
        """
        costs = np.empty(len(self._candidates))
        arguments = self._canonical(x, reference, disturbance)
        candidate, cost, nodes, status, gap = self._core.decide(*arguments, costs)
        chosen = np.frombuffer(self._core.line(), dtype=np.uint8)[-self.plant.inputs :]
        if status == Status.SAFE:
            chosen = np.array(self._safe, dtype=np.uint8)
        elif candidate < len(costs):
            chosen = self._candidates[candidate]
        u = self._values(chosen[None, :])
        evaluated = nodes > 0
        sequence = self._core.sequence() if evaluated else None
        plan = u if sequence is None else self._values(self._candidates[np.frombuffer(sequence, dtype=np.uint8)])
        return Decision(
            u[0], cost, self._values(self._candidates), costs, plan, nodes, evaluated and gap == 0.0,
            gap if evaluated else np.inf, Status(status),
        )  # fmt: skip

    def _values(self, indices: Any) -> Array:
        return np.column_stack([values[indices[:, j]] for j, values in enumerate(self.levels)])

    def _canonical(self, x: ArrayLike, reference: ArrayLike, disturbance: ArrayLike | None) -> tuple[Array, Array, Any]:
        """Arguments in the one form the core takes, or a ValueError."""
        p = self.plant.disturbances
        state = _check.vector("x", x, *self._measured)
        w = np.zeros(p) if disturbance is None else _check.vector("disturbance", disturbance, p, "measured disturbance")
        return state, canonical_reference(reference, self.plant.outputs, self.order, self.evaluations), w

    def copy(self) -> Controller:
        """A second controller of the same design, in the same state.

        Returns
        -------
        Controller
        """
        twin = object.__new__(Controller)
        twin.__dict__.update(self.__dict__)  # the design is shared: copy.copy would compute it anew
        twin._core = self._new_core()
        twin._core.restore(self._core.save())
        return twin

    def replace(self, **changes: Any) -> Controller:
        """A controller with some arguments changed, at its start.

        Parameters
        ----------
        **changes
            Any argument of `Controller`.

        Returns
        -------
        Controller

        Raises
        ------
        ValueError
            As `Controller`, or if it has no such argument.
        """
        unknown = sorted(changes.keys() - self._arguments.keys())
        if unknown:
            raise ValueError(f"Controller has no argument {unknown[0]!r}; {nearest(unknown[0], self._arguments)}")
        return Controller(**(self._arguments | changes))

    def _history(self) -> Array:
        """Commands issued, oldest first, shape (pending_steps + 1, m)."""
        line = np.frombuffer(self._core.line(), dtype=np.uint8)
        return self._values(line.reshape(-1, self.plant.inputs))

    def __reduce__(self) -> Any:
        return _rebuild, (self._arguments, self._core.save())

    def __repr__(self) -> str:
        o = self.objective
        degrees = ", ".join(map(str, self.relative_degree))
        if isinstance(o, Endpoint):
            lines = [f"objective  Endpoint(Td={o.Td}, lam={o.lam!r}, tail={o.tail!r}), relative degree {degrees}"]
        else:
            lines = [f"objective  Horizon({o.steps}, moves={o.moves or o.steps}, tail={o.tail!r}), degree {degrees}"]
        for name, levels, delay in zip(self.plant.input_names, self.levels, self._model.delay, strict=True):
            text = ", ".join(f"{v:g}" for v in levels)
            lines.append(f"input {name:<4} levels {text} every {self.Ts:g} s, {delay} periods under way")
        offsets = self._reference_offset.ravel()
        at = ", ".join(f"{v:.4g}" for v in (offsets if offsets.size <= 3 else offsets[[0, -1]]))
        at = at.replace(", ", " to ") if offsets.size > 3 else at
        lines.append(f"reference  value and {self.order - 1} derivative(s), sampled at t_k + {at} s")
        lag = ", ".join(f"{v:.4g}" for v in np.ravel(self.lag))
        gain = ", ".join(f"{v:.4g}" for v in np.diag(np.atleast_2d(self.dc_gain)))
        if self.kalman:
            slowest = abs(self.kalman.poles[0])
            lines.append(f"estimator  Kalman, {self.kalman.loads} load(s), slowest pole {slowest:.4g}")
        known = f"lag {lag} s, DC gain {gain}, " if isinstance(o, Endpoint) else ""
        lines.append(f"loop       {known}{self.real}")
        return tree("Controller", lines)


STATUSES = tuple(Status)
#: What core/horizon.h names so, in the order of the binding.
TABLES = (
    "F", "G", "S", "root_weight", "T", "move_weight", "lift", "lift_centre", "last_value", "hull", "value", "effect",
    "gain", "gain_previous", "pull", "place", "from_place", "metric", "from_metric", "switch_cost",
)  # fmt: skip


def _reals(real: type[np.floating[Any]], values: ArrayLike) -> np.ndarray[Any, Any]:
    return np.ascontiguousarray(values, dtype=real).ravel()


def _products(pending: Sequence[Array], levels: Sequence[Array]) -> Array:
    """Each pending command's effect, looked up by its level: per input (pending, levels, rows), one after the other."""
    each = [w[:, None, :] * v[None, :, None] for w, v in zip(pending, levels, strict=True)]
    result: Array = np.concatenate([np.ravel(item) for item in each])
    return result


def _rebuild(arguments: dict[str, Any], state: bytes) -> Controller:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        controller = Controller(**arguments)
    controller._core.restore(state)
    return controller


def canonical_reference(reference: ArrayLike, outputs: int, order: int, evaluations: int = 1) -> Array:
    """A reference as (evaluations, q, order), missing derivatives zero; short forms hold at all evaluations.

    Raises
    ------
    ValueError
        If the shape is none of the short forms, or a value is not finite.
    """
    given = _check.array("reference", reference)
    if given.ndim == 0:
        given = np.broadcast_to(given, (outputs,))[None, :, None]
    elif given.ndim == 1:
        given = given[None, None, :] if outputs == 1 else given[None, :, None]
    elif given.ndim == 2:
        given = given[None]
    short = np.ndim(reference) < 3
    fits = given.ndim == 3 and given.shape[:2] == (1 if short else evaluations, outputs)
    if not fits or not 1 <= given.shape[2] <= order:
        raise ValueError(
            f"reference has shape {np.shape(reference)}; give ({evaluations}, {outputs}, {order}), that is evaluations, "
            "outputs and derivatives, or a short form"
        )
    result = np.zeros((evaluations, outputs, order))
    result[..., : given.shape[2]] = given
    return result
