"""The closed loop: a plant, stepped exactly in C, under a controller or a baseline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch.model.hardware import Hardware
from foreswitch.model.nonlinear import SteppedPlant
from foreswitch.model.plant import Plant
from foreswitch.model.reference import sample
from foreswitch.simulation.bodies import core_plant, core_rig, core_sensor
from foreswitch.simulation.run import Run

__all__ = ["Law", "Loop", "sampled", "simulate"]

#: A signal in the loop: constant, one row per period, or a function of time and plant state.
Signal = ArrayLike | Callable[[float, Array], ArrayLike]


class Law(Protocol):
    """What `simulate` needs of a controller or a baseline."""

    plant: Plant
    Ts: float
    estimator: Any
    core: Any

    @property
    def real(self) -> str: ...
    @property
    def levels(self) -> list[Array]: ...
    @property
    def order(self) -> int: ...
    @property
    def reference_times(self) -> Array: ...
    def copy(self) -> Any: ...
    @property
    def issued(self) -> Array: ...
    @property
    def safe_levels(self) -> Array: ...


def measured_state(model: Plant, truth: Plant) -> Array | None:
    """The matrix that turns the truth's state into the state the controller is given.

    Of one order they mean the same, None. Else the model's state is taken whose outputs and their
    derivatives agree with the truth's: for a model in y, y', ... just those.
    """
    if model.states == truth.states:
        return None

    def derivatives(plant: Plant, count: int) -> Array:
        rows = [plant.C]
        for _ in range(count - 1):
            rows.append(rows[-1] @ plant.A)
        return np.vstack(rows)

    count = -(-model.states // model.outputs)
    observed = derivatives(model, count)
    sizes = f"has {truth.states} states and the controller's model {model.states}"
    for name, plant in (("plant", truth), ("the controller's model", model)):
        if count > 1 and (np.abs(derivatives(plant, count - 1) @ plant.B) > 0).any():
            problem = f"{sizes}, and a derivative of the output of {name} jumps with the input"
            raise Mistake("plant", truth, "give sensor, the matrix from one state to the other", problem=problem)
    if np.linalg.matrix_rank(observed) < model.states:
        problem = f"{sizes}, which its outputs do not determine"
        raise Mistake("plant", truth, "give sensor, the matrix from one to the other", problem=problem)
    return np.ascontiguousarray(np.linalg.pinv(observed) @ derivatives(truth, count))


def _rows(name: str, value: Signal | None, steps: int, width: int) -> Array:
    """A signal as one row per period; zero where it is a callable that fills it later."""
    if value is None or callable(value) or width == 0:
        if value is not None and width == 0:
            problem = "is given, but the plant has none"
            raise Mistake(name, value, "give the plant a matrix E", problem=problem)
        return np.zeros((steps, width))
    given = check.array(name, value)
    if given.ndim == 1 and width == 1 and given.size in (steps, steps + 1) and given.size > 1:
        given = given[:, None]
    if given.ndim == 2 and given.shape[0] in (steps, steps + 1) and given.shape[1] == width:
        return np.ascontiguousarray(given[:steps])
    if given.ndim > 1 or given.size not in (1, width):
        remedy = f"give {width} value(s), or ({steps}, {width}), one row per period"
        raise Mistake(name, value, remedy, problem=f"has shape {given.shape}")
    return np.ascontiguousarray(np.broadcast_to(given, (steps, width)))


def simulate(
    controller: Law,
    reference: Callable[..., ArrayLike] | ArrayLike,
    duration: float,
    *,
    plant: Plant | SteppedPlant | None = None,
    x0: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    disturbance: Signal | None = None,
    load: Signal | None = None,
    seed: int | None = None,
    sensor: ArrayLike | None = None,
    hardware: Hardware | None = None,
) -> Run:
    """Run a controller against a plant; the controller itself is left as it was.

    Parameters
    ----------
    controller : Controller or a baseline
        Starts from its present memory: see `Controller.reset` for commands under way and running dwell.
    reference : callable or array_like
        See `foreswitch.reference`; a number is a constant.
    duration : float
        s, rounded up to whole switching periods.
    plant : Plant, NonlinearPlant or FmuPlant, optional
        The truth, when it differs from the model in order, gain, dead time or kind.
    x0 : array_like, shape (n,), optional
        Its initial state. Default: zero.
    noise : float or array_like, shape (n,), optional
        Standard deviation of what the controller measures: all states, or each; with an estimator the outputs, (q,).
    disturbance : array_like or callable, optional
        w, of which the controller is told: constant (p,), samples (K, p), or ``(t, x) -> w``.
    load : array_like or callable, optional
        Added to the plant's inputs, of which the controller is not told; same forms, width m.
    seed : int, optional
        Of all that is random. Without one, each run differs.
    sensor : array_like, shape (n_model, n), optional
        What the controller measures of the truth's state, where its order differs. Default: the state of
        the model with the same outputs and derivatives. With an estimator it measures the truth's outputs.
    hardware : Hardware, optional
        What real actuators and sensors add.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If an argument does not fit, or the reference is not finite.
    """
    loop = Loop(
        controller, reference, duration, plant=plant, noise=noise, disturbance=disturbance, load=load, sensor=sensor,
        hardware=hardware,
    )  # fmt: skip
    return loop.run(x0, seed)


class Loop:
    """One closed loop, checked and laid out once, to be run any number of times; arguments as in `simulate`."""

    def __init__(
        self,
        controller: Law,
        reference: Callable[..., ArrayLike] | ArrayLike,
        duration: float,
        *,
        plant: Plant | SteppedPlant | None = None,
        noise: ArrayLike | None = None,
        disturbance: Signal | None = None,
        load: Signal | None = None,
        sensor: ArrayLike | None = None,
        hardware: Hardware | None = None,
    ) -> None:
        truth = controller.plant if plant is None else plant
        if not isinstance(truth, (Plant, SteppedPlant)):
            problem = f"is a {type(truth).__name__}"
            raise Mistake("plant", truth, "give a Plant, a NonlinearPlant or an FmuPlant", problem=problem)
        model, Ts = controller.plant, controller.Ts
        known = model.disturbances
        if (truth.inputs, truth.outputs) != (model.inputs, model.outputs) or known not in (0, truth.disturbances):
            problem = f"has {truth.inputs} input(s), {truth.outputs} output(s) and {truth.disturbances} disturbance(s)"
            remedy = f"the controller's model has {model.inputs}, {model.outputs} and {known}, and they must agree"
            raise Mistake("plant", truth, remedy, problem=problem)
        hardware = hardware or Hardware()
        if isinstance(truth, SteppedPlant) and (hardware.drift is not None or np.any(hardware.process_noise)):
            problem = "has drift or process_noise, which only a linear plant can have"
            raise Mistake("hardware", hardware, "put it into f", problem=problem)
        self.controller, self.truth = controller, truth
        self.steps = check.periods(check.number("duration", duration, above=0.0), Ts)
        self.t = np.arange(self.steps + 1) * Ts
        self.wanted = np.ascontiguousarray(sample(reference, self.t, truth.outputs, 1)[:, :, 0])
        self.told = sampled(controller, reference, self.t[:-1])
        self.disturbance, self.load = disturbance, load
        self.w = _rows("disturbance", disturbance, self.steps, truth.disturbances)
        self.extra = None if load is None else _rows("load", load, self.steps, truth.inputs)
        self.matrix = self._matrix(sensor)
        seen, measured, what = truth.states, model.states, "measured state"
        if controller.estimator is not None:
            seen, measured, what = truth.outputs, truth.outputs, "measured output"
        deviation = None if noise is None else check.per("noise", noise, measured, what, least=0.0)
        self.sensor = core_sensor(controller.real, seen, measured, self.matrix, deviation, hardware, Ts)
        self.hardware = hardware
        self._rig: tuple[Any, ...] | None = None
        if hardware.acts or isinstance(truth, SteppedPlant):
            self._rig, longest = core_rig(truth, Ts, self.steps, hardware)
        else:
            self._plant, longest = core_plant(truth, Ts, controller.real)
        past = controller.issued
        self.past = np.vstack([np.repeat(past[:1], max(0, longest - len(past)), axis=0), past])
        self.safe = controller.safe_levels

    def _matrix(self, sensor: ArrayLike | None) -> Array | None:
        model, truth = self.controller.plant, self.truth
        if self.controller.estimator is not None:
            if sensor is not None:
                problem = "is given, but the controller measures the plant's outputs"
                raise Mistake("sensor", sensor, "put it into C", problem=problem)
            return None
        if sensor is not None:
            return np.ascontiguousarray(check.matrix("sensor", sensor, model.states, truth.states))
        if isinstance(truth, Plant):
            return measured_state(model, truth)
        if truth.states != model.states:
            problem = f"has {truth.states} states and the controller's model {model.states}"
            raise Mistake("plant", truth, "give sensor, the matrix from one to the other", problem=problem)
        return None

    def body(self) -> Any:
        """The plant as C steps it; a rig is made anew each time, because it remembers what its actuators do."""
        return self._plant if self._rig is None else CORES[self.controller.real].Rig(*self._rig)

    @property
    def called(self) -> bool:
        """Whether Python is needed within a run."""
        return callable(self.disturbance) or callable(self.load) or isinstance(self.truth, SteppedPlant)

    def start(self, x0: ArrayLike | None) -> Array:
        """An initial state, shape (n,)."""
        given = None
        if x0 is not None:
            given = check.array("x0", x0, (self.truth.states,), ndmin=1)
        if isinstance(self.truth, SteppedPlant):
            return self.truth.start(given)
        return np.zeros(self.truth.states) if given is None else given

    def run(self, x0: ArrayLike | None = None, seed: int | None = None) -> Run:
        """One run from the controller's present memory, which is left as it was."""
        steps, n, m, q = self.steps, self.truth.states, self.truth.inputs, self.truth.outputs
        law, seed = self.controller.copy(), checked_seed(seed)
        history = len(self.past)
        u = np.vstack([self.past, np.zeros((steps, m))])
        x, y = np.zeros((steps + 1, n)), np.zeros((steps + 1, q))
        x[0] = self.start(x0)
        w, extra = self.w, self.extra
        if callable(self.disturbance):
            w = w.copy()
        if callable(self.load) and extra is not None:
            extra = extra.copy()
        cost, nodes, status = np.zeros(steps), np.zeros(steps, dtype=np.uint32), np.zeros(steps, dtype=np.uint8)
        model, hat = law.plant.states, None
        if law.estimator is not None:
            hat = np.empty((steps, model + law.kalman.loads))
        tables = {"reference": self.told, "w": w, "load": extra, "x": x, "y": y, "u": u, "cost": cost, "nodes": nodes,
                  "status": status, "estimate": hat}  # fmt: skip
        body, go = self.body(), CORES[law.real].run
        if callable(self.disturbance) or callable(self.load):
            for k in range(steps):
                if callable(self.disturbance):
                    w[k] = _called("disturbance", self.disturbance, self.t[k], x[k], w[k].shape)
                if callable(self.load) and extra is not None:
                    extra[k] = _called("load", self.load, self.t[k], x[k], (m,))
                go(law.core, body, self.sensor, seed, steps, history, tables, k, k + 1)
        else:
            go(law.core, body, self.sensor, seed, steps, history, tables, 0, steps)
        estimates: tuple[Array | None, Array | None] = (None, None) if hat is None else (hat[:, :model], hat[:, model:])
        return Run(
            self.t, x, y, u[history:], self.wanted, w, cost, nodes, status, self.truth, self.safe, *estimates,
            self.controller.copy(),
        )  # fmt: skip


def checked_seed(seed: int | None, name: str = "seed") -> int:
    """A seed for the core; a new one each time for None."""
    if seed is None:
        return int(np.random.SeedSequence().generate_state(1, np.uint64)[0])
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise Mistake(name, seed, "give a whole number from 0 to 2^64 - 1")
    return int(seed)


def _called(
    name: str, signal: Callable[[float, Array], ArrayLike], t: float, x: Array, shape: tuple[int, ...]
) -> Array:
    value = np.atleast_1d(np.asarray(signal(float(t), x.copy()), dtype=np.float64))
    if value.shape != shape or not np.isfinite(value).all():
        problem = f"returned {shown(value)} at t = {t:g} s"
        raise Mistake(name, value, f"give {shape[0]} finite value(s)", problem=problem)
    return value


def sampled(controller: Law, reference: Callable[..., ArrayLike] | ArrayLike, t: Array) -> Array:
    """The reference as the law is told it, one row per period."""
    q, order, offsets = controller.plant.outputs, controller.order, controller.reference_times
    if offsets.ndim == 1:
        instants = (t[:, None] + offsets).ravel()
        return np.ascontiguousarray(sample(reference, instants, q, order)).reshape(t.size, -1)
    each = [sample(reference, t + offsets[0, o], q, order)[:, o] for o in range(q)]
    return np.ascontiguousarray(np.stack(each, axis=1)).reshape(t.size, -1)
