"""Many runs of one closed loop: in C, without the interpreter lock, on all cores, nothing kept but figures of merit."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import CORES
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.model.nonlinear import SteppedPlant
from foreswitch.model.plant import Plant
from foreswitch.simulation.loop import Law, Loop, checked_seed
from foreswitch.simulation.run import figures

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Batch", "simulate_batch"]

#: Runs per call into C: enough to hide its cost, few enough to share out evenly.
CHUNK = 64


@dataclass(frozen=True)
class Batch:
    """Figures of merit of R runs.

    Attributes
    ----------
    seeds : ndarray, shape (R,)
        The run's seed: ``simulate(..., seed=seeds[i])`` gives run i again.
    rms_error, max_error : ndarray, shape (R, q)
        Of y - r, as in `Run.metrics`.
    switches, on_time : ndarray, shape (R, m)
        Changes of level; seconds away from the safe level.
    """

    seeds: np.ndarray[Any, np.dtype[np.uint64]]
    rms_error: Array
    max_error: Array
    switches: Array
    on_time: Array

    def to_frame(self) -> pd.DataFrame:
        """One row per run; needs pandas.

        Returns
        -------
        pandas.DataFrame
        """
        import pandas as pd

        columns: dict[str, Any] = {"seed": self.seeds}
        for name in ("rms_error", "max_error", "switches", "on_time"):
            values = getattr(self, name)
            for i in range(values.shape[1]):
                columns[name if values.shape[1] == 1 else f"{name}_{i + 1}"] = values[:, i]
        return pd.DataFrame(columns)


def simulate_batch(
    controller: Law,
    reference: Callable[..., ArrayLike] | ArrayLike,
    duration: float,
    *,
    seeds: Sequence[int] | int,
    x0: ArrayLike | None = None,
    plant: Plant | SteppedPlant | Sequence[Plant] | None = None,
    threads: int | None = None,
    **simulation: Any,
) -> Batch:
    """Run i is ``simulate(controller, reference, duration, seed=seeds[i], x0=x0[i], plant=plant[i], ...)``, bit for bit.

    Memory does not grow with the number of runs. Loops that call back into Python (a callable disturbance or load, a
    plant that is not linear) run one after the other.

    Parameters
    ----------
    controller, reference, duration, **simulation
        As in `simulate`.
    seeds : sequence of int, or int
        One per run; a number stands for 0, 1, ... up to it.
    x0 : array_like, shape (n,) or (R, n), optional
        Initial state, one for all or one each.
    plant : Plant, or sequence of them, optional
        The truth, one for all or one each.
    threads : int, optional
        Default: as many as there are cores.

    Returns
    -------
    Batch

    Raises
    ------
    ValueError
        As `simulate`, or if the lengths do not agree.
    """
    seed = _seeds(seeds)
    runs = seed.size
    workers = os.cpu_count() or 1 if threads is None else threads
    if workers < 1:
        raise Mistake("threads", threads, "give at least 1")
    plants = list(plant) if isinstance(plant, Sequence) else [plant] * runs
    if len(plants) != runs:
        problem = f"lists {len(plants)} plants for {runs} seeds"
        raise Mistake("plant", plant, "give one, or one per seed", problem=problem)
    first = Loop(controller, reference, duration, plant=plants[0] if plants else None, **simulation)
    n, m, q = first.truth.states, first.truth.inputs, first.truth.outputs
    for i, item in enumerate(plants):
        if item is not None and item.states != n:
            problem = f"{i + 1} has {item.states} state(s) and the first one {n}"
            raise Mistake("plant", item, "they must agree", problem=problem)
    start = np.zeros((runs, n)) if x0 is None else check.array("x0", x0)
    if start.shape not in ((n,), (runs, n)):
        raise Mistake("x0", x0, f"give ({n},) or ({runs}, {n})", problem=f"has shape {start.shape}")
    start = np.ascontiguousarray(np.broadcast_to(start, (runs, n)))
    out = {"rms": np.empty((runs, q)), "largest": np.empty((runs, q)), "switches": np.empty((runs, m)),
           "on": np.empty((runs, m))}  # fmt: skip

    def fill(loop: Loop, rows: slice) -> None:
        if loop.called:
            for i in range(*rows.indices(runs)):
                run = loop.run(None if x0 is None else start[i], int(seed[i]))
                for column, value in zip(out.values(), figures(run.y, run.r, run.u, run.safe_level), strict=True):
                    column[i] = value
            return
        law, body = loop.controller.copy(), loop.body()
        tables = {"reference": loop.told, "w": loop.w, "load": loop.extra, "past": loop.past, "wanted": loop.wanted,
                  "safe": loop.safe, "seeds": seed[rows], "x0": start[rows]}  # fmt: skip
        tables |= {name: column[rows] for name, column in out.items()}
        CORES[law.real].batch(law.core, body, loop.sensor, loop.steps, len(loop.past), tables)

    position = 0
    with ThreadPoolExecutor(workers) as pool:
        jobs = []
        for each, group in groupby(plants, key=id):
            count = len(list(group))
            truth = plants[position]
            loop = first if each == id(plants[0]) else Loop(controller, reference, duration, plant=truth, **simulation)
            for at in range(position, position + count, CHUNK):
                rows = slice(at, min(at + CHUNK, position + count))
                if loop.called:
                    fill(loop, rows)
                else:
                    jobs.append(pool.submit(fill, loop, rows))
            position += count
        for job in jobs:
            job.result()
    return Batch(seed, out["rms"], out["largest"], out["switches"], out["on"] * controller.Ts)


def _seeds(given: Sequence[int] | int) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """One seed per run."""
    if isinstance(given, (int, np.integer)) and not isinstance(given, bool) and given >= 0:
        return np.arange(given, dtype=np.uint64)
    if not isinstance(given, (Sequence, np.ndarray)):
        raise Mistake("seeds", given, "give how many runs, or a list with the seed of each")
    return np.array([checked_seed(each, "seeds") for each in given], dtype=np.uint64)
