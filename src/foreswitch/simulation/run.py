"""What a closed-loop run leaves: traces, figures of merit, pictures, files."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES
from foreswitch._helpers.check import Array
from foreswitch._helpers.csv import write_columns
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.json import json_text, plain_data
from foreswitch._helpers.text import tree
from foreswitch._helpers.units import described, unit_of_names
from foreswitch.model.nonlinear import SteppedPlant
from foreswitch.model.plant import Plant
from foreswitch.presentation import plots
from foreswitch.simulation import report

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from foreswitch.presentation.report import Report
    from foreswitch.simulation.loop import Law

__all__ = ["FIGURES", "Run", "figures", "plain"]

#: Figures of merit and their units; None: that of the outputs.
FIGURES = {
    "rms_error": None, "max_error": None, "lag": "s", "rms_error_at_lag": None, "switches": "", "on_time": "s",
}  # fmt: skip


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
    w : ndarray, shape (K, p)
        Measured disturbance.
    cost, nodes, status : ndarray, shape (K,)
        Predicted cost of the chosen command, candidates evaluated, `Status`.
    plant : Plant
        The simulated truth.
    safe_level : ndarray, shape (m,)
        The level at which each input counts as off.
    x_hat, load_hat : ndarray, shape (K, n_model) and (K, l), or None
        The estimator's state and loads, on which the command of that row is based; NaN before the first measurement.
    controller : Controller or a baseline, or None
        The law that chose the commands, as it was at the start.
    """

    t: Array
    x: Array
    y: Array
    u: Array
    r: Array
    w: Array
    cost: Array
    nodes: np.ndarray[Any, np.dtype[np.uint32]]
    status: np.ndarray[Any, np.dtype[np.uint8]]
    plant: Plant | SteppedPlant
    safe_level: Array
    x_hat: Array | None = None
    load_hat: Array | None = None
    controller: Law | None = None

    @property
    def Ts(self) -> float:
        """Switching period [s]."""
        return float(self.t[1] - self.t[0])

    def __repr__(self) -> str:
        rms, _, switches, _ = figures(self.y, self.r, self.u, self.safe_level)
        lines = [f"time      {self.u.shape[0]} periods of {self.Ts:g} s"]
        lines += [f"output    {name}, rms error {e:.3g}" for name, e in zip(self.plant.output_names, rms, strict=True)]
        lines += [
            f"input     {name}, {int(s)} switches" for name, s in zip(self.plant.input_names, switches, strict=True)
        ]
        bad = int((self.status != 0).sum())
        lines.append(f"status    {bad} periods not OK" if bad else "status    OK throughout")
        return tree("Run", lines)

    def metrics(self) -> dict[str, Any]:
        """Figures of merit over all switching instants.

        Returns
        -------
        dict
            ``rms_error``, ``max_error`` of y - r; ``lag`` [s], the shift of r that fits y best, negative
            where y leads, and ``rms_error_at_lag``; ``switches``, changes of level; ``on_time`` [s] away
            from the safe level. Floats for one output or input, else arrays.
        """
        rms, largest, switches, on = figures(self.y, self.r, self.u, self.safe_level)
        with np.errstate(over="ignore", invalid="ignore"):  # a loop that runs away has no figures
            lags, rms_at_lag = zip(*(_lag(self.t, y, r) for y, r in zip(self.y.T, self.r.T, strict=True)), strict=True)
        return {
            "rms_error": plain(rms),
            "max_error": plain(largest),
            "lag": plain(lags),
            "rms_error_at_lag": plain(rms_at_lag),
            "switches": plain(switches.astype(np.int64)),
            "on_time": plain(on * self.Ts),
        }

    def summary(self) -> dict[str, Any]:
        """The run as plain data: what it was, `metrics`, how often each status came up, how much was searched.

        Returns
        -------
        dict
            Numbers, lists, words and None, which stands for what is not finite; keys say their units, as in
            ``"lag [s]"``.
        """
        error = unit_of_names(self.plant.output_names)
        found: dict[str, Any] = {
            "Ts [s]": self.Ts,
            "periods": len(self.u),
            "outputs": self.plant.output_names,
            "inputs": self.plant.input_names,
        }
        for name, value in self.metrics().items():
            unit = FIGURES[name]
            found[described(name, error if unit is None else unit)] = value
        found["status"] = report.status_counts(self)
        if report.searches(self):
            found["search"] = report.search_figures(self)
        plain: dict[str, Any] = plain_data(found)
        return plain

    def columns(self) -> dict[str, Array]:
        """Time, reference, output, command, state, estimates, cost, status by name; the last row repeats the last command.

        Returns
        -------
        dict of str to ndarray, shape (K+1,)
        """

        def extended(values: np.ndarray[Any, Any]) -> Array:
            return np.concatenate([values, values[-1:]])

        table: dict[str, Array] = {}

        def add(name: str, values: Array) -> None:
            """Under its name, or with a number behind it where that is taken."""
            free, count = name, 1
            while free in table:
                count += 1
                free = f"{name} ({count})"
            table[free] = values

        add("t [s]", self.t)
        for i, name in enumerate(self.plant.output_names):
            add(f"reference {name}", self.r[:, i])
            add(name, self.y[:, i])
        for j, name in enumerate(self.plant.input_names):
            add(name, extended(self.u[:, j]))
        for i in range(self.x.shape[1]):
            add(f"x{i + 1}", self.x[:, i])
        for i in range(self.w.shape[1]):
            add(f"w{i + 1}", extended(self.w[:, i]))
        for name, estimates in (("x", self.x_hat), ("load", self.load_hat)):
            for i, column in enumerate([] if estimates is None else estimates.T):
                add(f"{name}{i + 1} estimated", extended(column))
        add("cost", extended(self.cost))
        add("status", extended(self.status))
        return table

    def to_frame(self) -> pd.DataFrame:
        """The same as a table; needs pandas.

        Returns
        -------
        pandas.DataFrame
        """
        import pandas as pd

        return pd.DataFrame(self.columns())

    def to_parquet(self, path: str | Path) -> None:
        """Write `columns` as Parquet, whole or not at all; needs pandas and pyarrow.

        Parameters
        ----------
        path : path
        """
        buffer = io.BytesIO()
        self.to_frame().to_parquet(buffer, index=False)
        write_whole(path, buffer.getvalue())

    def to_json(self, path: str | Path) -> None:
        """Write `metrics` as JSON, whole or not at all; null for what is not finite.

        Parameters
        ----------
        path : path
        """
        write_whole(path, json_text(self.metrics(), indent=2))

    def to_csv(self, path: str | Path) -> None:
        """Write `columns` as CSV, whole or not at all.

        Parameters
        ----------
        path : path
        """
        write_columns(path, self.columns())

    def plot(self, **options: Any) -> Figure:
        """Output with its reference behind, and the commands as stairs.

        Parameters
        ----------
        **options
            As in `foreswitch.presentation.plots.time_plot`: ``title``.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return plots.time_plot(
            self.t, self.y, self.r, self.u, self.plant.output_names, self.plant.input_names, **options
        )

    def report(self, name: str) -> Report:
        """Picture, figures of merit, statuses, the law and the plant, to be written as a page.

        Parameters
        ----------
        name : str
            Its heading.

        Returns
        -------
        Report
        """
        return report.run_report(name, self)


def plain(values: ArrayLike) -> Any:
    """A number where there is one, else the array."""
    array = np.asarray(values)
    return array.item() if array.size == 1 else array


def figures(y: Array, r: Array, u: Array, safe: Array) -> tuple[Array, Array, Array, Array]:
    """rms and largest error per output, switches and periods away from the safe level per input."""
    q, m = y.shape[1], u.shape[1]
    out = {"rms": np.empty(q), "largest": np.empty(q), "switches": np.empty(m), "on": np.empty(m)}
    given = {"y": y, "r": r, "u": u, "safe": safe}
    tables = {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in given.items()}
    CORES["float64"].metrics(len(y), q, m, tables | out)
    return out["rms"], out["largest"], out["switches"], out["on"]


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
    # which of them is best needs no masks: the instants that count lie in a row
    first = np.searchsorted(t, t[0] + grid - 1e-12)
    behind = np.searchsorted(t, t[-1] + grid + 1e-12, side="right")
    squares = []
    for lag, a, b in zip(grid.tolist(), first.tolist(), behind.tolist(), strict=True):
        error = y[a:b] - np.interp(t[a:b] - lag, t, r)
        squares.append(error @ error / (b - a))
    i = int(np.argmin(squares))
    least = rms(grid[i])
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]
    from scipy.optimize import minimize_scalar

    fine = minimize_scalar(rms, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * Ts})
    best, value = (float(fine.x), float(fine.fun)) if fine.fun < least else (float(grid[i]), least)
    return (best, value) if value < none else (0.0, none)
