"""A project file drafted from an identification: the fitted plant and filter, and first settings to tune from."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np

from foreswitch._helpers.toml import toml_text
from foreswitch.identification.fit import Fit
from foreswitch.project.project import Project

__all__ = ["draft_project"]

#: Settling horizon in time constants of what has to settle, and bandwidth of the sliding variable in 1 / Ts: those of
#: the hot-gas example.
SETTLING, BANDWIDTH = 3.0, 2.5
#: Share of an input's range that its unknown load may gather in one period.
LOAD = 1e-3
#: Length of the first run, in dead times and horizons.
RUN = 20.0


def draft_project(fit: Fit, source: str) -> str:
    """The text of a project file for a fit.

    Parameters
    ----------
    fit : Fit
    source : str
        Where the record came from, for the heading.

    Returns
    -------
    str
        Checked: `Project` accepts it.

    Raises
    ------
    ValueError
        If no controller can be made of the fit; the sentence says why.
    """
    record, plant = fit.record, fit.plant
    Ts = float(f"{record.Ts:.9g}")  # time stamps carry rounding
    levels = [record.levels(j) for j in range(plant.inputs)]
    Td = Ts * np.ceil(SETTLING * _settling(fit) / Ts - 1e-9)
    tables: dict[str, Any] = {
        "plant": _plant(fit),
        "actuator": {"levels": levels[0] if plant.inputs == 1 else levels, "Ts": Ts},
        "estimator": {
            "process_noise": fit.process_noise(Ts),
            "measurement_noise": fit.measurement_noise,
            # more loads than outputs cannot be told apart
            **({"load": [(LOAD * np.ptp(each)) ** 2 for each in levels]} if plant.inputs <= plant.outputs else {}),
        },
        "controller": {"Td": Td, "lam": BANDWIDTH / Ts},
        "reference": [{"kind": "constant", "value": np.median(record.y[record.used, o])} for o in range(plant.outputs)],
        "simulation": {
            "duration": Ts * np.round(RUN * (plant.input_delay.max() + Td) / Ts),
            "noise": np.sqrt(fit.measurement_noise),
            "seed": 1,
        },
    }
    if plant.outputs == 1:
        [tables["reference"]] = tables["reference"]
    text = toml_text(_rounded(tables), heading=_heading(fit, source))
    Project(tomllib.loads(text))
    return text


def _heading(fit: Fit, source: str) -> list[str]:
    """Where it comes from and what was found, for the top of the file."""
    return [
        f"foreswitch project, drafted from {source}",
        f"{', '.join(np.atleast_1d(fit.structure))}; explains "
        + ", ".join(f"{percent:.1f}" for percent in np.ravel(fit.fit_percent))
        + " % of the output's motion",
        *(f"  {name} = {value:.5g} +- {error:.2g}" for name, (value, error) in fit.parameters.items()),
        *(f"Mind: {sentence}" for sentence in fit.warnings),
        "Plant and estimator are what the record says; Ts is its sampling interval. The rest is a first guess to edit.",
    ]


def _plant(fit: Fit) -> dict[str, Any]:
    """[plant] in the simplest form there is for it."""
    plant, values = fit.plant, {name: value for name, (value, _) in fit.parameters.items()}
    common = {
        "input_delay": plant.input_delay if plant.inputs > 1 else plant.input_delay[0],
        "u_offset": plant.u_offset,
        "y_offset": plant.y_offset,
        "input_names": list(plant.input_names),
        "output_names": list(plant.output_names),
    }
    if fit.structure == "integrator+lag" and plant.inputs == 1:
        return {"model": "integrator_lag", "k": values["k"], "c": values["c"], **common}
    if fit.structure == "lag" and plant.inputs == 1:
        return {"model": "fopdt", "K": values["K"], "T": values["T"], **common}
    return {"model": "state_space", "A": plant.A, "B": plant.B, "C": plant.C, **common}


def _settling(fit: Fit) -> float:
    """Time constant that the horizon should cover [s]: the slowest that decays, but for what the output itself is."""
    rates = -np.real(fit.plant.poles)
    times = np.sort(1.0 / rates[rates > 1e-6 * np.abs(rates).max(initial=1e-300)])[::-1]
    integrates = any(structure.integrators for structure in fit.estimate.problem.structures)
    inner = times if integrates else times[fit.plant.outputs :]
    return float(max(fit.record.Ts, *inner[:1])) if inner.size else fit.record.Ts


def _rounded(value: Any) -> Any:
    """As a file holds it: arrays as lists, twelve digits of each number."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if np.ndim(value) > 0 or isinstance(value, list):
        return [_rounded(item) for item in value]
    return value if isinstance(value, (str, int)) else float(f"{float(value) + 0.0:.12g}")
