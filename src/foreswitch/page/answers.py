"""What the page asks, answered: a request in, fields and arrays out. Nothing here knows of a server."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np

from foreswitch._check import Array
from foreswitch.page.complaint import Complaint
from foreswitch.project import Project
from foreswitch.run import Run

__all__ = ["look"]

Answer = tuple[dict[str, Any], dict[str, Array]]


def look(request: dict[str, Any]) -> Answer:
    """The closed loop, run."""
    begun = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        project = setup(request)
        run = project.simulate()
    fields, arrays = picture(run)
    fields["lag"] = project.controller.lag
    fields["warnings"] = [str(item.message) for item in caught if item.category is UserWarning]
    fields["elapsed_ms"] = 1e3 * (time.perf_counter() - begun)
    return fields, arrays


def setup(request: dict[str, Any]) -> Project:
    """The project of a request, its truth as the options say."""
    tables = request.get("project")
    if not isinstance(tables, dict):
        raise Complaint("the request has no project; give the tables of a project file")
    return Project(tables, folder=None).with_seed(0)


def picture(run: Run) -> Answer:
    """What a run draws."""
    plant: Any = run.plant
    fields = {
        "outputs": list(plant.output_names),
        "inputs": list(plant.input_names),
        "Ts": run.Ts,
        "metrics": run.metrics(),
    }
    arrays = {"t": run.t, "y": run.y.T, "r": run.r.T, "u": run.u.T, "cost": run.cost, "status": run.status}
    return fields, {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in arrays.items()}
