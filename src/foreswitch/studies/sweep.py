"""A study, run: a project's closed loop over grids of parameters and random ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from foreswitch.project.project import Project
from foreswitch.studies.plan import planned
from foreswitch.studies.result import Study
from foreswitch.studies.store import Store
from foreswitch.studies.workers import Piece, checked_scheduler, chunk_rows, run_pieces

__all__ = ["study"]


def study(
    project: str | Path | Project,
    over: Mapping[str, Any] | None = None,
    *,
    repeats: int = 1,
    seed: int = 0,
    scheduler: str | None = None,
    out: str | Path | None = None,
    progress: Callable[[float, str], None] = lambda share, what: None,
) -> Study:
    """A project's closed loop over grids of parameters and random ones.

    Lists span a grid; every point of it is run ``repeats`` times, each time with another seed and other drawn values.
    Seeds and draws depend on ``seed``, point and repeat alone, so that the table is the same, row for row, wherever and in
    whatever chunks it is computed.

    Parameters
    ----------
    project : path or Project
    over : dict, optional
        By dotted key of the project file, ``"controller.Td"`` or ``"simulation.noise"``: a list of values, or a
        distribution (`Uniform`, `LogUniform`, `Normal`, `OneOf`), or either as text, ``"0.01, 0.02"``,
        ``"linspace(0, 1, 5)"``, ``"uniform(0, 4)"``. ``hardware.`` is short for ``simulation.hardware.``; entries of lists
        go by number, ``"simulation.noise.0"``. Two keys more are of the truth against the model: ``delay_error`` [s] and
        ``gain_error``, truth = model with B (1 + gain_error) and input_delay + delay_error.
    repeats : int
        Runs per grid point.
    seed : int
    scheduler : str, optional
        None: this process, on all cores; ``"processes"``: a process for each core; ``"tcp://host:port"``: a Dask cluster.
    out : path, optional
        Folder that keeps what is finished; the same call again continues there. When all is done the table is there as
        ``runs.parquet``, or ``runs.csv`` without pyarrow.
    progress : callable, optional
        Told the share that is done, and what is being done.

    Returns
    -------
    Study

    Raises
    ------
    ValueError
        If a key is unknown, a point's project is not valid (before anything runs), a draw is not, the folder holds
        another study, or the scheduler does not answer.
    WorkersLost
        If workers die again and again; what is finished is in ``out``.
    """
    base = project if isinstance(project, Project) else Project.read(project)
    plan = planned(base, over or {}, repeats, seed)
    scheduler = checked_scheduler(scheduler)
    progress(0.0, "checking")
    first = plan.check(base.folder)
    sealed = plan.carried(base.folder)
    store = Store(Path(out), sealed) if out is not None else None
    width = 2 * (first.plant.outputs + first.plant.inputs)
    figures = np.empty((plan.rows, width))
    done = 0
    pieces: list[Piece] = []

    def split(workers: int) -> list[Piece]:
        """Chunks that are still missing."""
        nonlocal done
        rows = store.rows if store and store.rows else chunk_rows(sealed, workers)
        if store and not store.rows:
            store.begin(rows)
        pieces[:] = [(start, min(start + rows, plan.rows)) for start in range(0, plan.rows, rows)]
        missing = []
        for piece in pieces:
            kept = store.load(piece, width) if store else None
            if kept is None:
                missing.append(piece)
            else:
                figures[slice(*piece)] = kept
                done += piece[1] - piece[0]
        progress(done / plan.rows, "running")
        return missing

    # a finished study asks nobody
    where = None if store and store.rows and not split(1) else scheduler
    done = 0
    for piece, values in run_pieces(sealed, where, split):
        figures[slice(*piece)] = values
        if store:
            store.save(piece, values)
        done += piece[1] - piece[0]
        progress(done / plan.rows, "running")
    result = Study(plan, first, figures)
    if store:
        store.tidy(pieces)
        if find_spec("pyarrow"):
            result.to_parquet(store.folder / "runs.parquet")
        else:
            result.to_csv(store.folder / "runs.csv")
    return result
