"""What people use today: a relay with hysteresis, and PI with pulse-width modulation, alone or behind a Smith predictor.

They run in the same closed loop as a `Controller`, under the same switching period and dwell, on the same measured
state (their derivative action takes y' from it).
"""

from __future__ import annotations

import copy
from abc import ABC
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import tree
from foreswitch.control.actuator import dwell_periods, input_levels, level_indices, safe_indices
from foreswitch.control.decision import canonical_reference
from foreswitch.model.nonlinear import SteppedPlant
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import relative_degrees
from foreswitch.simulation.bodies import core_plant
from foreswitch.simulation.loop import simulate
from foreswitch.simulation.run import Run

__all__ = ["BASELINES", "PIPWM", "Baseline", "Known", "Relay", "SmithPWM", "Tuned", "tune"]


#: Of all kinds, besides the carrier.
SETTINGS = ("hysteresis", "deadband", "lead", "kp", "ki", "kd", "kf", "bias")


class Baseline(ABC):
    """Shared by all baselines: plant, levels, switching period and dwell.

    Parameters
    ----------
    plant : Plant
        The Smith predictor uses all of it, the others its outputs. With several inputs or outputs, input j acts on its
        own combination of the errors: row j, of length 1, of the pseudo-inverse of ``C A^(r-1) B``.
    levels : array_like, or list of them
        As in `Controller`.
    Ts : float
        Switching period [s].
    min_on, min_off : float or array_like, shape (m,)
        Shortest time at a level [s], as in `Controller`.
    forbidden : sequence of commands
        As in `Controller`; instead of one of these the present command is kept.
    safe_level : float or array_like, shape (m,), optional
        As in `Controller`; the level before the first step.
    preview : float
        Seconds ahead at which the reference is sampled.

    Raises
    ------
    ValueError
        If an argument is out of range.
    """

    KIND: ClassVar[int]
    real = "float64"
    estimator = None  # the whole state is measured
    order = 2

    def __init__(
        self,
        plant: Plant,
        levels: Any,
        Ts: float,
        *,
        min_on: ArrayLike = 0.0,
        min_off: ArrayLike = 0.0,
        forbidden: Sequence[ArrayLike] = (),
        safe_level: ArrayLike | None = None,
        preview: float = 0.0,
    ) -> None:
        if not isinstance(plant, Plant):
            raise Mistake("plant", plant, "give a Plant", problem=f"is a {type(plant).__name__}")
        self.plant, self.levels = plant, input_levels(levels, plant.inputs)
        self.Ts = check.number("Ts", Ts, above=0.0)
        self.safe = safe_indices(safe_level, self.levels)
        self.dwell, _ = dwell_periods(self.levels, self.safe, min_on, min_off, self.Ts)
        self._forbidden = [level_indices("forbidden", command, self.levels) for command in forbidden]
        self._preview = check.number("preview", preview)

    @property
    def reference_times(self) -> Array:
        """Offset from t_k at which the reference is sampled [s], shape (1,)."""
        return np.array([self._preview])

    def _start(self, **settings: float) -> None:
        """Hand the law's own settings to C, by the names of core/host/baselines.h; those not given are zero."""
        plant = self.plant
        degrees = relative_degrees(plant)
        powers = [plant.C]
        for _ in range(plant.states):
            powers.append(powers[-1] @ plant.A)
        # of relative degree 1, y' jumps with u and is no state
        rate = np.array([powers[1][o] * (degrees[o] != 1) for o in range(plant.outputs)])
        reach = np.array([powers[max(r - 1, 0)][o] @ plant.B for o, r in enumerate(degrees)])
        mix = np.linalg.pinv(reach)
        mix /= np.maximum(np.linalg.norm(mix, axis=1, keepdims=True), 1e-300)
        body, _ = core_plant(plant, self.Ts, self.real)
        self._tables = dict.fromkeys(SETTINGS, 0.0) | {"carrier": 1} | settings | {
            "kind": self.KIND, "order": self.order, "period": self.Ts,
            "rate": np.ascontiguousarray(rate), "mix": np.ascontiguousarray(mix),
            "forbidden": np.array(self._forbidden, dtype=np.uint8).reshape(-1, plant.inputs),
            "level_count": np.array([values.size for values in self.levels], dtype=np.uint8),
            "safe": np.array(self.safe, dtype=np.uint8), "levels": np.concatenate(self.levels),
            "dwell": np.concatenate(self.dwell).astype(np.uint32),
        }  # fmt: skip
        self._body = body
        self.core = self._new_core()

    def _new_core(self) -> Any:
        return CORES[self.real].Baseline(self._body, self._tables)

    def step(self, x: ArrayLike, reference: ArrayLike, *, disturbance: ArrayLike | None = None) -> Array:
        """One switching period, as `Controller.step`.

        Parameters
        ----------
        x : array_like, shape (n,)
            Measured state.
        reference : array_like
            Value and, if known, its derivative.
        disturbance : array_like, shape (p,), optional
            Measured w; the Smith predictor's model uses it.

        Returns
        -------
        ndarray, shape (m,)
        """
        u = np.empty(self.plant.inputs)
        n, p = self.plant.states, self.plant.disturbances
        state = check.vector("x", x, n, "measured state")
        w = np.zeros(p) if disturbance is None else check.vector("disturbance", disturbance, p, "measured disturbance")
        self.core.step(state, canonical_reference(reference, self.plant.outputs, self.order), w, u)
        return u

    def reset(self) -> None:
        """Forget the past: safe level, no integral."""
        self.core.reset()

    def copy(self) -> Baseline:
        """The same design at its start.

        Returns
        -------
        Baseline
        """
        twin = copy.copy(self)
        twin.core = self._new_core()
        return twin

    def __repr__(self) -> str:
        own = {name: value for name, value in vars(self).items() if isinstance(value, float) and name[0] != "_"}
        return tree(type(self).__name__, [f"{name:<11}{value:.6g}" for name, value in own.items()])

    @property
    def safe_levels(self) -> Array:
        """The level in which each input counts as off, shape (m,)."""
        return np.array([values[i] for values, i in zip(self.levels, self.safe, strict=True)])

    @property
    def issued(self) -> Array:
        """What was commanded before the first step, shape (1, m)."""
        return self.safe_levels[None, :]


class Relay(Baseline):
    """Highest level below the reference, lowest above it, with hysteresis.

    Acts on ``e + lead e'``, ``e = yd - y``: a switching line where ``lead`` > 0, as double integrators need.

    Parameters
    ----------
    plant, levels, Ts, **shared
        See `Baseline`.
    hysteresis : float
        Switches on above +hysteresis, off below -hysteresis [unit of y].
    deadband : float
        Where > 0 and the safe level lies between others: safe level within +-deadband [unit of y].
    lead : float
        Seconds.
    """

    KIND = 0

    def __init__(
        self,
        plant: Plant,
        levels: Any,
        Ts: float,
        *,
        hysteresis: float = 0.0,
        deadband: float = 0.0,
        lead: float = 0.0,
        **shared: Any,
    ) -> None:
        super().__init__(plant, levels, Ts, **shared)
        self.hysteresis = check.number("hysteresis", hysteresis, least=0.0)
        self.deadband = check.number("deadband", deadband, least=0.0)
        self.lead = check.number("lead", lead, least=0.0)
        self._start(hysteresis=self.hysteresis, deadband=self.deadband, lead=self.lead)


class PIPWM(Baseline):
    """PI control, its output turned into pulses between the two nearest levels.

    ``u = bias + kp e + ki int e + kd e' + kf yd'``, once per carrier period, with clamping against windup.

    Parameters
    ----------
    plant, levels, Ts, **shared
        See `Baseline`.
    kp, ki, kd : float
        Gains [u / unit of y, the same per s, the same times s]. ``kd`` acts where y' is a state.
    kf : float
        Gain from yd' [u s / unit of y].
    bias : float
        Input at zero error.
    carrier : float
        Pulse period [s], rounded to whole switching periods; its resolution is one of them.
    """

    KIND = 1

    def __init__(
        self,
        plant: Plant,
        levels: Any,
        Ts: float,
        *,
        kp: float,
        ki: float = 0.0,
        kd: float = 0.0,
        kf: float = 0.0,
        bias: float = 0.0,
        carrier: float,
        **shared: Any,
    ) -> None:
        super().__init__(plant, levels, Ts, **shared)
        self.kp, self.ki, self.kd = check.number("kp", kp), check.number("ki", ki), check.number("kd", kd)
        self.kf, self.bias = check.number("kf", kf), check.number("bias", bias)
        self.carrier = check.number("carrier", carrier, least=Ts * (1 - 1e-9))
        periods = max(1, round(self.carrier / self.Ts))
        self._start(kp=self.kp, ki=self.ki, kd=self.kd, kf=self.kf, bias=self.bias, carrier=periods)


class SmithPWM(PIPWM):
    """`PIPWM` on a Smith predictor: the error is taken ahead of the dead time by a model in parallel.

    Classical, and for stable or integrating plants only: both models run open loop.

    Parameters
    ----------
    plant, levels, Ts, **options
        See `PIPWM`.

    Raises
    ------
    ValueError
        If the plant is unstable.
    """

    KIND = 2

    def __init__(self, plant: Plant, levels: Any, Ts: float, **options: Any) -> None:
        fastest = max(plant.poles, key=lambda pole: float(pole.real))
        if fastest.real > 1e-9:
            pole = fastest if fastest.imag else fastest.real
            problem = f"has the unstable pole {pole:.3g}"
            raise Mistake("plant", plant, "a Smith predictor needs a plant without one", problem=problem)
        super().__init__(plant, levels, Ts, **options)


@dataclass(frozen=True)
class Known:
    """A kind of baseline: its class, what tables and reports call it, and the parameter that trades error for switching."""

    law: type[Baseline]
    label: str
    title: str
    knob: str


#: Every kind, under the name that a program asks for.
BASELINES = {
    "relay": Known(Relay, "relay", "relay with hysteresis", "hysteresis"),
    "pi_pwm": Known(PIPWM, "PI + PWM", "PI + PWM", "carrier"),
    "smith_pwm": Known(SmithPWM, "Smith + PWM", "Smith predictor + PWM", "carrier"),
}


@dataclass(frozen=True)
class Tuned:
    """A baseline with the best parameters found, and how they were found.

    Attributes
    ----------
    law : Baseline
        At its start.
    parameters : dict of str to float
    run : Run
        The task under it.
    rms_error : float
        Of that run.
    evaluations : int
        Closed-loop runs spent.
    """

    law: Baseline
    parameters: dict[str, float]
    run: Run
    rms_error: float
    evaluations: int


def tune(
    kind: type[Baseline],
    plant: Plant,
    levels: Any,
    Ts: float,
    reference: Callable[..., ArrayLike] | ArrayLike,
    duration: float,
    *,
    budget: int = 400,
    search_seed: int = 0,
    preview: float = 0.0,
    shared: dict[str, Any] | None = None,
    truth: Plant | SteppedPlant | None = None,
    **simulation: Any,
) -> Tuned:
    """The baseline with the smallest rms error on one closed-loop task.

    Differential evolution over all its parameters on logarithmic scales, in a box that spans three decades or more
    around the plant's own units: errors of the reference's range, times of the dead time. Every kind gets the same
    budget of closed-loop runs.

    Parameters
    ----------
    kind : type
        `Relay`, `PIPWM` or `SmithPWM`.
    plant, levels, Ts
        As in `Baseline`.
    reference, duration
        The task, as in `foreswitch.simulate`.
    budget : int
        Closed-loop runs, about.
    search_seed : int
        Of the search.
    preview : float
        How far ahead the reference is known [s]; where > 0, how much of it is used is searched for as well.
    shared : dict, optional
        Arguments of `Baseline`.
    truth : Plant, optional
        What it is simulated against, where that differs from the plant it is built for.
    **simulation
        Further arguments of `foreswitch.simulate`.

    Returns
    -------
    Tuned
    """
    shared, simulation = shared or {}, simulation | {"plant": truth}
    needed: dict[str, Any] = {"kp": 1.0, "carrier": Ts} if issubclass(kind, PIPWM) else {}
    trial = kind(plant, levels, Ts, **needed, **shared)
    start = simulate(trial, reference, duration, **simulation)
    error = float(max(np.ptp(start.r, axis=0).max(), np.abs(start.r - plant.y_offset).max(), 1e-9))
    reach = max(float(np.ptp(values)) for values in trial.levels)
    time = float(plant.input_delay.max()) + 2.0 * Ts
    gain = reach / error
    if issubclass(kind, PIPWM):
        box = {
            "kp": (1e-2 * gain, 1e3 * gain),
            "ki": (1e-5 * gain / time, 1e2 * gain / time),
            "kd": (1e-3 * gain * time, 1e3 * gain * time),
            "kf": (1e-2 * gain * time, 1e3 * gain * time),
            "carrier": (2.0 * Ts, 60.0 * Ts),
        }
    else:
        box = {"hysteresis": (1e-5 * error, 0.3 * error), "lead": (1e-2 * time, 1e3 * time)}
        if any(0 < i < values.size - 1 for i, values in zip(trial.safe, trial.levels, strict=True)):
            box["deadband"] = (1e-5 * error, 0.3 * error)
    bounds = {name: (float(np.log(low)), float(np.log(high))) for name, (low, high) in box.items()}
    if preview > 0:
        bounds["preview"] = (0.0, preview)  # the one parameter that may be zero, on a linear scale
    guess = [float(np.log(np.clip(getattr(trial, name), *box[name]))) if name in box else 0.0 for name in bounds]
    best: tuple[float, dict[str, Any], Run] | None = None
    count = 0

    def cost(found: Array) -> float:
        nonlocal best, count
        count += 1
        parameters: dict[str, Any] = {
            name: float(np.exp(value) if name in box else value) for name, value in zip(bounds, found, strict=True)
        }
        run = simulate(kind(plant, levels, Ts, **parameters, **shared), reference, duration, **simulation)
        rms = float(np.sqrt(np.mean((run.y - run.r) ** 2)))
        if best is None or rms < best[0]:
            best = rms, parameters, run
        return rms

    generations = 12
    members = max(5, budget // (generations + 1))
    rng = np.random.default_rng(search_seed)
    low, high = np.array(list(bounds.values())).T
    initial = low + (high - low) * rng.random((members, len(bounds)))
    cost(np.array(guess))  # the parameters it has by default: never worse than these
    from scipy.optimize import differential_evolution

    differential_evolution(
        cost, list(zip(low, high, strict=True)), init=initial, maxiter=generations, polish=False, rng=rng,
        tol=0.0, atol=-1.0,  # never early: a plateau, which relays have, is no reason to stop
    )  # fmt: skip
    assert best is not None
    return Tuned(kind(plant, levels, Ts, **best[1], **shared), best[1], best[2], best[0], count)
