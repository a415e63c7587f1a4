"""The controller: a design handed to the C core."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest, tree
from foreswitch.control.actuator import Actuator
from foreswitch.control.assembly import assembled
from foreswitch.control.endpoint import EndpointLaw
from foreswitch.control.horizon import HorizonLaw
from foreswitch.control.kalman import Filter, Kalman, load_entries, steady_filter
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.control.review import check_kinds, check_sizes, warn_of_short_prediction
from foreswitch.control.stepping import Stepping
from foreswitch.model import prediction
from foreswitch.model.plant import Plant

__all__ = ["Controller"]


class Controller(Stepping):
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
        check_kinds(plant, objective, estimator, real)
        self._arguments = {
            "plant": plant, "levels": levels, "Ts": Ts, "objective": objective, "min_on": min_on, "min_off": min_off,
            "switch_cost": switch_cost, "forbidden": forbidden, "estimator": estimator, "preview": preview,
            "safe_level": safe_level, "bad_limit": bad_limit, "real": real,
        }  # fmt: skip
        self.plant, self.objective, self.estimator, self.real = plant, objective, estimator, real
        self.Ts = check.number("Ts", Ts, above=0.0)
        if not 1 <= check.number("bad_limit", bad_limit) <= 65535 or bad_limit != int(bad_limit):
            raise Mistake("bad_limit", bad_limit, "give 1 to 65535 samples")
        self.actuator = Actuator.build(
            levels, plant.inputs, self.Ts, min_on=min_on, min_off=min_off, switch_cost=switch_cost, forbidden=forbidden,
            safe_level=safe_level,
        )  # fmt: skip
        kind = EndpointLaw if isinstance(objective, Endpoint) else HorizonLaw
        reach, name = kind.reach(objective, self.Ts)  # type: ignore[arg-type]
        loads = np.empty((plant.states, 0)) if estimator is None else load_entries(estimator, plant)
        warn_of_short_prediction(self.actuator, reach, name, stacklevel=2)
        check_sizes(plant, loads.shape[1], self.actuator, self.Ts, reach, real)
        self.predicted = plant if estimator is None else plant.replace(E=np.hstack([plant.E, loads]))
        self.model = prediction.period_model(self.predicted, self.Ts)
        self.law: EndpointLaw | HorizonLaw
        if isinstance(objective, Endpoint):
            self.law = EndpointLaw(self.predicted, objective, self.actuator, self.Ts)
        else:
            self.law = HorizonLaw(self.predicted, objective, self.actuator, self.Ts, CORES[real])
        self.kalman: Filter | None = None
        if estimator is not None:
            load_steps = self.model.disturbance[:, plant.disturbances :]
            self.kalman = steady_filter(estimator, plant, self.model.transition, load_steps)
        self._reference_offset = self.law.sampling(preview)
        self.design = assembled(
            real, plant, self.model, self.actuator, self.law, self.kalman,
            bad_limit=0 if safe_level is None else int(bad_limit),
            gate_limit=0 if estimator is None else int(estimator.gate_limit),
        )  # fmt: skip
        self.core = self._new_core()
        self.reset()

    def _new_core(self) -> Any:
        horizon = self.design.horizon
        block = partial(np.empty, (64, self.plant.inputs))
        return CORES[self.real].Predictive(vars(self.design), horizon and vars(horizon), block)

    @property
    def lag(self) -> float | Array:
        """Steady ramp error per unit slope of the ideal loop [s]; a number for one output, else shape (q,)."""
        lag: Array = self.law.lag
        return float(lag[0]) if self.plant.outputs == 1 else lag

    @property
    def dc_gain(self) -> float | Array:
        """DC gain of the ideal loop yd -> y; a number for one output, else shape (q, q)."""
        gain: Array = self.law.dc_gain
        return float(gain[0, 0]) if self.plant.outputs == 1 else gain

    @property
    def relative_degree(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Derivatives of each output until an input appears, shape (q,)."""
        return self.law.relative_degree

    # ---- Design ----

    @property
    def reference_times(self) -> Array:
        """Their offsets from t_k [s], shape (evaluations,).

        With ``preview="lag"`` and outputs of different lags: shape (evaluations, q).
        """
        return self._reference_offset.copy()

    def copy(self) -> Controller:
        """A second controller of the same design, in the same state.

        Returns
        -------
        Controller
        """
        twin = object.__new__(Controller)
        twin.__dict__.update(self.__dict__)  # the design is shared: copy.copy would compute it anew
        twin.core = self._new_core()
        twin.core.restore(self.core.save())
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
            name = unknown[0]
            problem = f"has no argument {name!r}"
            raise Mistake(name, changes[name], nearest(name, self._arguments), problem=problem, subject="Controller")
        return Controller(**(self._arguments | changes))

    def __reduce__(self) -> Any:
        return _rebuild, (self._arguments, self.core.save())

    def __repr__(self) -> str:
        lines = [f"objective  {self.law}"]
        for name, levels, delay in zip(self.plant.input_names, self.levels, self.model.delay, strict=True):
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


def _rebuild(arguments: dict[str, Any], state: bytes) -> Controller:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        controller = Controller(**arguments)
    controller.core.restore(state)
    return controller
