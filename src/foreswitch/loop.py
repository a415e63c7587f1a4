"""The closed loop: a plant, stepped exactly in C, under a controller or a baseline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from foreswitch import _check, plot
from foreswitch._check import Array
from foreswitch._files import write_whole
from foreswitch.core import CORES, core_plant
from foreswitch.plant import Plant
from foreswitch.reference import sample

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Law", "Run", "simulate"]

#: A signal in the loop: constant, one row per period, or a function of time and plant state.
Signal = ArrayLike | Callable[[float, Array], ArrayLike]


class Law(Protocol):
    """What `simulate` needs of a controller or a baseline."""

    plant: Plant
    Ts: float
    levels: list[Array]
    _safe: list[int]
    _core: Any

    @property
    def real(self) -> str: ...
    @property
    def order(self) -> int: ...
    @property
    def reference_times(self) -> Array: ...
    def copy(self) -> Any: ...
    def _history(self) -> Array: ...


@dataclass(frozen=True)
class Run:
    """One closed-loop run; K periods of Ts seconds.

    Attributes
    ----------
    t : ndarray, shape (K+1,)
        Switching instants [s].
    x, y : ndarray, shape (K+1, n) and (K+1, q)
        The plant's state and output, without measurement noise.
    u : ndarray, shape (K, m)
        Commands; row k is issued at ``t[k]`` and acts a dead time later.
    r : ndarray, shape (K+1, q)
        Reference at ``t``.
    cost, nodes, status : ndarray, shape (K,)
        Predicted cost of the chosen command, candidates evaluated, `Status`.
    plant : Plant
        The simulated truth.
    safe_level : ndarray, shape (m,)
        The level at which each input counts as off.
    """

    t: Array
    x: Array
    y: Array
    u: Array
    r: Array
    cost: Array
    nodes: np.ndarray[Any, np.dtype[np.uint32]]
    status: np.ndarray[Any, np.dtype[np.uint8]]
    plant: Plant
    safe_level: Array

    @property
    def Ts(self) -> float:
        """Switching period [s]."""
        return float(self.t[1] - self.t[0])

    def metrics(self) -> dict[str, Any]:
        """Figures of merit over all switching instants.

        Returns
        -------
        dict
            ``rms_error``, ``max_error`` of y - r; ``lag`` [s], the shift of r that fits y best, negative
            where y leads, and ``rms_error_at_lag``; ``switches``, changes of level; ``on_time`` [s] away
            from the safe level. Floats for one output or input, else arrays.
        """
        error = self.y - self.r
        lags, rms_at_lag = zip(*(_lag(self.t, y, r) for y, r in zip(self.y.T, self.r.T, strict=True)), strict=True)

        def plain(values: ArrayLike) -> Any:
            array = np.asarray(values)
            return array.item() if array.size == 1 else array

        return {
            "rms_error": plain(np.sqrt(np.mean(error**2, axis=0))),
            "max_error": plain(np.abs(error).max(axis=0)),
            "lag": plain(lags),
            "rms_error_at_lag": plain(rms_at_lag),
            "switches": plain((np.diff(self.u, axis=0) != 0).sum(axis=0)),
            "on_time": plain((self.u != self.safe_level).sum(axis=0) * self.Ts),
        }

    def columns(self) -> dict[str, Array]:
        """Time, reference, output, command, cost and status by column name; the last row repeats the last command.

        Returns
        -------
        dict of str to ndarray, shape (K+1,)
        """

        def extended(values: np.ndarray[Any, Any]) -> Array:
            return np.concatenate([values, values[-1:]])

        table = {"t [s]": self.t}
        for i, name in enumerate(self.plant.output_names):
            table[f"reference {name}"], table[name] = self.r[:, i], self.y[:, i]
        for j, name in enumerate(self.plant.input_names):
            table[name] = extended(self.u[:, j])
        for i in range(self.x.shape[1]):
            table[f"x{i + 1}"] = self.x[:, i]
        return table | {"cost": extended(self.cost), "status": extended(self.status)}

    def to_frame(self) -> pd.DataFrame:
        """The same as a table; needs pandas.

        Returns
        -------
        pandas.DataFrame
        """
        import pandas as pd

        return pd.DataFrame(self.columns())

    def to_csv(self, path: str | Path) -> None:
        """Write `columns` as CSV, whole or not at all.

        Parameters
        ----------
        path : path
        """
        table = self.columns()
        lines = [",".join(f'"{name}"' if "," in name else name for name in table)]
        lines += [",".join(f"{value:.9g}" for value in row) for row in zip(*table.values(), strict=True)]
        write_whole(path, "\n".join(lines) + "\n")

    def plot(self, **options: Any) -> Figure:
        """Output with its reference behind, and the commands as stairs.

        Parameters
        ----------
        **options
            As in `foreswitch.plot.time_plot`: ``title``.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return plot.time_plot(
            self.t, self.y, self.r, self.u, self.plant.output_names, self.plant.input_names, **options
        )


def _lag(t: Array, y: Array, r: Array) -> tuple[float, float]:
    """The shift of r that fits y best, and the rms error left at it, over the times both are known."""

    def rms(lag: float) -> float:
        shifted = t - lag
        inside = (shifted >= t[0] - 1e-12) & (shifted <= t[-1] + 1e-12)
        return float(np.sqrt(np.mean((y[inside] - np.interp(shifted[inside], t, r)) ** 2)))

    none = rms(0.0)
    if np.ptp(r) == 0 or t.size < 8:
        return 0.0, none
    # from coarse to fine: whole periods near zero, then a grid over a quarter of the run
    Ts, reach = t[1] - t[0], 0.25 * (t[-1] - t[0])
    grid = np.union1d(np.arange(-60, 61) * Ts, np.linspace(-reach, reach, 101))
    grid = grid[np.abs(grid) <= reach]
    values = [rms(lag) for lag in grid]
    i = int(np.argmin(values))
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]
    fine = minimize_scalar(rms, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * Ts})
    best, value = (float(fine.x), float(fine.fun)) if fine.fun < values[i] else (float(grid[i]), values[i])
    return (best, value) if value < none else (0.0, none)


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
    for name, plant in (("plant", truth), ("the controller's model", model)):
        if count > 1 and (np.abs(derivatives(plant, count - 1) @ plant.B) > 0).any():
            raise ValueError(
                f"plant has {truth.states} states and the controller's model {model.states}, and a derivative of the "
                f"output of {name} jumps with the input; give sensor, the matrix from one state to the other"
            )
    if np.linalg.matrix_rank(observed) < model.states:
        raise ValueError(
            f"plant has {truth.states} states and the controller's model {model.states}, which its outputs do not "
            "determine; give sensor, the matrix from one to the other"
        )
    return np.ascontiguousarray(np.linalg.pinv(observed) @ derivatives(truth, count))


def _rows(name: str, value: Signal | None, steps: int, width: int) -> Array:
    """A signal as one row per period; zero where it is a callable that fills it later."""
    if value is None or callable(value) or width == 0:
        if value is not None and width == 0:
            raise ValueError(f"{name} is given, but the plant has none; give the plant a matrix E")
        return np.zeros((steps, width))
    given = _check.array(name, value)
    if given.ndim == 1 and width == 1 and given.size in (steps, steps + 1) and given.size > 1:
        given = given[:, None]
    if given.ndim == 2 and given.shape[0] in (steps, steps + 1) and given.shape[1] == width:
        return np.ascontiguousarray(given[:steps])
    if given.ndim > 1 or given.size not in (1, width):
        raise ValueError(
            f"{name} has shape {given.shape}; give {width} value(s), or ({steps}, {width}), one row per period"
        )
    return np.ascontiguousarray(np.broadcast_to(given, (steps, width)))


def simulate(
    controller: Law,
    reference: Callable[..., ArrayLike] | ArrayLike,
    duration: float,
    *,
    plant: Plant | None = None,
    x0: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    disturbance: Signal | None = None,
    load: Signal | None = None,
    seed: int | None = None,
    sensor: ArrayLike | None = None,
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
    plant : Plant, optional
        The truth, when it differs from the model in order, gain or dead time.
    x0 : array_like, shape (n,), optional
        Its initial state. Default: zero.
    noise : float or array_like, shape (n,), optional
        Standard deviation of what the controller measures: all states, or each.
    disturbance : array_like or callable, optional
        w, of which the controller is told: constant (p,), samples (K, p), or ``(t, x) -> w``.
    load : array_like or callable, optional
        Added to the plant's inputs, of which the controller is not told; same forms, width m.
    seed : int, optional
        Of the noise. Without one, each run differs.
    sensor : array_like, shape (n_model, n), optional
        What the controller measures of the truth's state, where its order differs. Default: the state of
        the model with the same outputs and derivatives.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If an argument does not fit, or the reference is not finite.
    """
    truth = controller.plant if plant is None else plant
    if not isinstance(truth, Plant):
        raise ValueError(f"plant is a {type(truth).__name__}; give a Plant")
    model, Ts = controller.plant, controller.Ts
    steps = _check.periods(_check.number("duration", duration, above=0.0), Ts)
    known = model.disturbances
    if (truth.inputs, truth.outputs) != (model.inputs, model.outputs) or known not in (0, truth.disturbances):
        raise ValueError(
            f"plant has {truth.inputs} input(s), {truth.outputs} output(s) and {truth.disturbances} disturbance(s); the "
            f"controller's model has {model.inputs}, {model.outputs} and {known}, and they must agree"
        )
    n, m, q = truth.states, truth.inputs, truth.outputs
    t = np.arange(steps + 1) * Ts
    wanted = sample(reference, t, q, 1)[:, :, 0]
    told = _sampled(controller, reference, t[:-1])
    if sensor is None:
        mapping = measured_state(model, truth)
    else:
        mapping = np.ascontiguousarray(_check.matrix("sensor", sensor, model.states, n))
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise ValueError(f"seed is {seed!r}; give a whole number >= 0") from None
    added = None
    if noise is not None:
        deviation = _check.per("noise", noise, model.states, "measured state", least=0.0)
        added = rng.standard_normal((steps, model.states)) * deviation

    law = controller.copy()
    body, longest = core_plant(truth, Ts, law.real)
    past = law._history()
    history = max(len(past), longest)
    u = np.zeros((history + steps, m))
    u[:history] = past[0]
    u[history - len(past) : history] = past

    x, y = np.zeros((steps + 1, n)), np.zeros((steps + 1, q))
    if x0 is not None:
        x[0] = _check.array("x0", np.atleast_1d(np.asarray(x0, dtype=np.float64)), (n,))
    y[0] = truth.C @ x[0] + truth.y_offset
    w = _rows("disturbance", disturbance, steps, truth.disturbances)
    extra = None if load is None else _rows("load", load, steps, m)
    cost, nodes, status = np.zeros(steps), np.zeros(steps, dtype=np.uint32), np.zeros(steps, dtype=np.uint8)
    arrays = (mapping, added, told, w, extra, x, y, u, cost, nodes, status)
    if callable(disturbance) or callable(load):
        for k in range(steps):
            if callable(disturbance):
                w[k] = _called("disturbance", disturbance, t[k], x[k], w[k].shape)
            if callable(load) and extra is not None:
                extra[k] = _called("load", load, t[k], x[k], (m,))
            CORES[law.real].run(law._core, body, steps, history, arrays, k, k + 1)
    else:
        CORES[law.real].run(law._core, body, steps, history, arrays, 0, steps)
    safe = np.array([values[i] for values, i in zip(law.levels, law._safe, strict=True)])
    return Run(t, x, y, u[history:], wanted, cost, nodes, status, truth, safe)


def _called(
    name: str, signal: Callable[[float, Array], ArrayLike], t: float, x: Array, shape: tuple[int, ...]
) -> Array:
    value = np.atleast_1d(np.asarray(signal(float(t), x.copy()), dtype=np.float64))
    if value.shape != shape or not np.isfinite(value).all():
        raise ValueError(f"{name} returned {value.tolist()} at t = {t:g} s; give {shape[0]} finite value(s)")
    return value


def _sampled(controller: Law, reference: Callable[..., ArrayLike] | ArrayLike, t: Array) -> Array:
    """The reference as the law is told it, one row per period."""
    q, order, offsets = controller.plant.outputs, controller.order, controller.reference_times
    if offsets.ndim == 1:
        return np.ascontiguousarray(sample(reference, t + offsets[0], q, order)).reshape(t.size, -1)
    each = [sample(reference, t + offsets[0, o], q, order)[:, o] for o in range(q)]
    return np.ascontiguousarray(np.stack(each, axis=1)).reshape(t.size, -1)
