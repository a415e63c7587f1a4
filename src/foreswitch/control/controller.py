"""The controller: a design handed to the C core."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES, REALS
from foreswitch._binding.arrays import reals
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.text import nearest, tree
from foreswitch.control.actuator import LONGEST_HOLD, Actuator, level_indices
from foreswitch.control.endpoint import EndpointDesign
from foreswitch.control.horizon import HorizonDesign
from foreswitch.control.kalman import Filter, Kalman, load_entries, steady_filter
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model import prediction
from foreswitch.model.plant import Plant

__all__ = ["Controller", "Decision", "Status", "canonical_reference"]


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
        The planned commands, the first of them ``u``; that one alone where nothing was planned.
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
        self.Ts = check.number("Ts", Ts, above=0.0)
        if not 1 <= check.number("bad_limit", bad_limit) <= 65535 or bad_limit != int(bad_limit):
            raise ValueError(f"bad_limit is {bad_limit}; give 1 to 65535 samples")
        self._bad_limit = 0 if safe_level is None else int(bad_limit)
        self._actuator = Actuator.build(
            levels, plant.inputs, self.Ts, min_on=min_on, min_off=min_off, switch_cost=switch_cost, forbidden=forbidden,
            safe_level=safe_level,
        )  # fmt: skip
        self.levels, self._safe = self._actuator.levels, self._actuator.safe
        kind: Any = EndpointDesign if isinstance(objective, Endpoint) else HorizonDesign
        self._warn_of_short_prediction(*kind.reach(objective, self.Ts))
        self._check_sizes(kind.reach(objective, self.Ts)[0])
        self._model = prediction.period_model(self._with_loads(), self.Ts)
        self._law: EndpointDesign | HorizonDesign
        if isinstance(objective, Endpoint):
            self._law = EndpointDesign(self._with_loads(), objective, self._actuator, self.Ts)
        else:
            self._law = HorizonDesign(self._with_loads(), objective, self._actuator, self.Ts, CORES[real])
        single = plant.outputs == 1
        self.lag: float | Array = float(self._law.lag[0]) if single else self._law.lag
        self.dc_gain: float | Array = float(self._law.dc_gain[0, 0]) if single else self._law.dc_gain
        self.relative_degree = self._law.relative_degree
        self.kalman: Filter | None = None
        if estimator is not None:
            load_steps = self._model.disturbance[:, plant.disturbances :]
            self.kalman = steady_filter(estimator, plant, self._model.transition, load_steps)
        self._reference_offset = self._law.sampling(preview)
        self._parts = self._core_parts()
        self._core = self._new_core()
        self.reset()

    def _new_core(self) -> Any:
        return CORES[self.real].Predictive(*self._parts, partial(np.empty, (64, self.plant.inputs)))

    # ---- Design ----

    def _warn_of_short_prediction(self, reach: float, name: str) -> None:
        longest = max(max(row) for row in self._actuator.dwell_seconds)
        if longest > reach * (1.0 + 1e-9):
            warnings.warn(
                f"min_on or min_off of {longest:g} s exceeds {name} = {reach:g} s: a switch is judged before it may be "
                f"taken back; consider a longer {name.removeprefix('the ')}",
                UserWarning,
                stacklevel=3,
            )

    def _check_sizes(self, reach: float) -> None:
        """What the core can hold; before the design, which would take as long as it is large."""
        plant, core = self.plant, CORES[self.real]
        loads = 0 if self.estimator is None else load_entries(self.estimator, plant).shape[1]
        longest = float(plant.input_delay.max())
        depth = check.periods(longest, self.Ts) + 1
        holds = min(max(map(max, self._actuator.dwell)), check.periods(longest + reach, self.Ts))
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

    def _with_loads(self) -> Plant:
        """The plant with its loads behind its measured disturbances, which is all that prediction has to know of them."""
        if self.estimator is None:
            return self.plant
        return self.plant.replace(E=np.hstack([self.plant.E, load_entries(self.estimator, self.plant)]))

    def _core_parts(self) -> tuple[tuple[int, ...], tuple[Any, ...], Any]:
        """Sizes, arrays and horizon of the core's design, in the order of the binding."""
        real = REALS[self.real]
        each = partial(reals, real)
        plant, model, law, kalman, actuator = self.plant, self._model, self._law, self.kalman, self._actuator
        p, rest = self._disturbances, law.rest
        limit = 0 if self.estimator is None else int(self.estimator.gate_limit)
        sizes = (plant.states, plant.inputs, plant.outputs, p, self.order, max(model.delay) + 1, len(actuator.candidates),
                 self._bad_limit, self._measured[0], p - plant.disturbances, limit)  # fmt: skip
        exact = np.concatenate(actuator.levels)
        arrays: tuple[Any, ...] = (
            np.array([v.size for v in actuator.levels], dtype=np.uint8),
            np.array(model.delay, dtype=np.uint16),
            np.array(law.holds, dtype=np.uint16),
            exact,
            each(exact),
            actuator.candidates.ravel(),
            np.array(actuator.safe, dtype=np.uint8),
            *law.endpoint_arrays(real),
            *(map(each, (rest.reference, rest.disturbance, rest.offset)) if rest else (None,) * 3),
            np.concatenate([np.array(row, dtype=np.uint32) for row in actuator.dwell]),
            each(actuator.switch_cost),
            *map(each, (model.transition, model.old, model.new, model.disturbance, model.drift)),
        )
        if kalman is None:
            arrays += (None,) * 6
        else:
            gate = None if kalman.gate is None else each(kalman.gate)
            estimation = (kalman.gain, plant.C, plant.y_offset, kalman.start_row, kalman.start_offset)
            arrays += (*map(each, estimation), gate)
        return sizes, arrays, law.horizon_parts(real)

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
        return int(self._law.sliding.reference.shape[1])

    @property
    def evaluations(self) -> int:
        """Instants at which the reference is wanted."""
        return self._law.evaluations

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
    def bad_samples(self) -> tuple[int, int]:
        """Samples that were not usable: in a row up to now, and in total since the latest `reset`."""
        in_a_row, total = self._core.bad()
        return in_a_row, total

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
            values = check.array("pending", pending)
            if values.ndim < 2:
                values = values.reshape(-1, 1) if m == 1 else values.reshape(1, -1)
            if values.ndim != 2 or values.shape[1] != m or len(values) < self.pending_steps:
                raise ValueError(
                    f"pending has shape {np.shape(pending)}; give at least {self.pending_steps} row(s) of {m} level(s)"
                )
            given = [level_indices("pending", row, self.levels) for row in values[-depth:]]
            allowed = {tuple(c) for c in self._actuator.candidates.tolist()}
            for row in given:
                if tuple(row) not in allowed:
                    level = [float(v[i]) for v, i in zip(self.levels, row, strict=True)]
                    raise ValueError(f"pending holds the forbidden command {level}; start from an allowed one")
            if given:
                given = [given[0]] * (depth - len(given)) + given
                line = np.array(given, dtype=np.uint8)
        wait = np.zeros(m, dtype=np.uint32)
        if elapsed is not None:
            since = check.per("elapsed", elapsed, m, "input", least=0.0)
            for j in range(m):
                wait[j] = check.periods(self._actuator.dwell_seconds[j][line[-1, j]] - since[j], self.Ts)
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
        x = check.array("estimate", estimate, (self.plant.states,))
        w = [
            np.zeros(size) if value is None else check.array(name, np.atleast_1d(np.asarray(value)), (size,))
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
        costs = np.empty(len(self._actuator.candidates))
        arguments = self._canonical(x, reference, disturbance)
        candidate, cost, nodes, status, gap = self._core.decide(*arguments, costs)
        chosen = np.frombuffer(self._core.line(), dtype=np.uint8)[-self.plant.inputs :]
        if status == Status.SAFE:
            chosen = np.array(self._safe, dtype=np.uint8)
        elif candidate < len(costs):
            chosen = self._actuator.candidates[candidate]
        u = self._actuator.values(chosen[None, :])
        decided = candidate < len(costs)
        sequence = self._core.sequence() if decided else None
        plan = (
            u
            if sequence is None
            else self._actuator.values(self._actuator.candidates[np.frombuffer(sequence, dtype=np.uint8)])
        )
        return Decision(
            u[0], cost, self._actuator.values(self._actuator.candidates), costs, plan, nodes, decided and gap == 0.0,
            gap if decided else np.inf, Status(status),
        )  # fmt: skip

    def track(self, command: ArrayLike, x: ArrayLike | None = None, *, disturbance: ArrayLike | None = None) -> None:
        """One switching period in which somebody else chose, say an operator.

        The commands under way, dwell and the estimate stay true, so that the next `step` takes over without a bump.

        Parameters
        ----------
        command : array_like, shape (m,)
            The levels really issued in this period, allowed or not.
        x, disturbance : array_like, optional
            As in `step`; without x nothing was measured.

        Raises
        ------
        ValueError
            If the command is no level, or a shape does not fit.
        """
        indices = np.array(level_indices("command", command, self.levels), dtype=np.uint8)
        self._core.track(*self._measurement(x, disturbance), indices)

    def missed(self, periods: int = 1) -> None:
        """So many steps did not take place, and the command in force went on. Call before the next `step`.

        Parameters
        ----------
        periods : int
            At most 65535; after a longer silence, `reset`.

        Raises
        ------
        ValueError
            If the number is out of range.
        """
        if not 0 <= check.number("periods", periods) <= 65535 or periods != int(periods):
            raise ValueError(f"periods is {periods}; give 0 to 65535, or reset after a longer silence")
        self._core.missed(int(periods))

    def safe(self, x: ArrayLike | None = None, *, disturbance: ArrayLike | None = None) -> Array:
        """One switching period at the safe levels, whatever the dwell: in place of `step` for as long as a fault lasts.

        Parameters
        ----------
        x, disturbance : array_like, optional
            As in `track`.

        Returns
        -------
        ndarray, shape (m,)
            The safe levels.

        Raises
        ------
        ValueError
            If a shape does not fit.
        """
        self._core.safe(*self._measurement(x, disturbance))
        u: Array = self._history()[-1]
        return u

    def _measurement(self, x: ArrayLike | None, disturbance: ArrayLike | None) -> tuple[Any, Any]:
        """What was measured, as the core takes it; nothing where x is None."""
        if x is None:
            return None, None
        return check.vector("x", x, *self._measured), self._w(disturbance)

    def _w(self, disturbance: ArrayLike | None) -> Array:
        p = self.plant.disturbances
        if disturbance is None:
            return np.zeros(p)
        return check.vector("disturbance", disturbance, p, "measured disturbance")

    def _canonical(self, x: ArrayLike, reference: ArrayLike, disturbance: ArrayLike | None) -> tuple[Array, Array, Any]:
        """Arguments in the one form the core takes, or a ValueError."""
        state, w = check.vector("x", x, *self._measured), self._w(disturbance)
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
        return self._actuator.values(line.reshape(-1, self.plant.inputs))

    def __reduce__(self) -> Any:
        return _rebuild, (self._arguments, self._core.save())

    def __repr__(self) -> str:
        lines = [f"objective  {self._law}"]
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
        known = f"lag {lag} s, DC gain {gain}, " if isinstance(self.objective, Endpoint) else ""
        lines.append(f"loop       {known}{self.real}")
        return tree("Controller", lines)


STATUSES = tuple(Status)


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
    given = check.array("reference", reference)
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
