"""What the page asks, answered: a request in, fields and arrays out. Nothing here knows of a server."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, within
from foreswitch._helpers.text import nearest
from foreswitch._helpers.units import without_units
from foreswitch.certificate.certificate import Certificate
from foreswitch.certificate.ideal_response import ideal_run
from foreswitch.page.setups import OPTIONS, Setup, setup
from foreswitch.project.tables import SimulationTable
from foreswitch.simulation.baselines import BASELINES
from foreswitch.simulation.loop import Loop
from foreswitch.simulation.replay import moment
from foreswitch.simulation.run import FIGURES, Run

__all__ = ["baseline", "certify", "costs", "look"]

Answer = tuple[dict[str, Any], dict[str, Array]]


def look(request: dict[str, Any]) -> Answer:
    """The closed loop, run."""
    begun = time.perf_counter()
    made = setup(request)
    run = made.project.simulate()
    fields, arrays = picture(run)
    law = made.project.controller
    fields |= {"levels": law.levels, "lag": law.lag, "warnings": made.warnings + _cut(made, run)}
    arrays |= {"cost": run.cost, "status": run.status.astype(np.float32)}
    fields["elapsed_ms"] = 1e3 * (time.perf_counter() - begun)
    return fields, arrays


def picture(run: Run) -> Answer:
    """What a run draws."""
    summary = without_units(run.summary())
    fields = {name: summary[name] for name in ("outputs", "inputs", "Ts")}
    fields["metrics"] = {name: summary[name] for name in FIGURES}
    return fields, {"t": run.t, "y": run.y.T, "r": run.r.T, "u": run.u.T}


def _cut(made: Setup, run: Run) -> list[str]:
    """Whether the page's own bound of the search was met."""
    met = 0 if made.budget is None else int((run.nodes >= made.budget).sum())
    return [f"the search was cut at {made.budget} sequences in {met} of {len(run.u)} steps, to answer at once; a controller "
            "that is exported searches on"] if met else []  # fmt: skip


def costs(request: dict[str, Any]) -> Answer:
    """What the controller thought at one step of the run that `look` shows."""
    made = setup(request)
    project = made.project
    settings = project.simulation_settings()
    duration, x0, seed = (settings.pop(key, None) for key in ("duration", "x0", "seed"))
    with within(None, project.simulation_keys):
        loop = Loop(project.controller, project.reference, duration, **settings)
    k = request.get("step", 0)
    if isinstance(k, bool) or not isinstance(k, int) or not 0 <= k < loop.steps:
        raise Mistake("step", k, f"give a whole number from 0 to {loop.steps - 1}", key="step")
    with within(None, project.simulation_keys):
        then = moment(loop, x0, seed, k)
    decision, law = then.decision, then.controller
    chosen = np.flatnonzero((decision.candidates == decision.u).all(axis=1))
    fields = {
        "step": k,
        "t": float(loop.t[k]),
        "chosen": int(chosen[0]) if chosen.size else None,
        "landing_time": then.landing_time,
        "reference": then.reference[-1, :, 0],
        "status": decision.status.name,
        "remedy": decision.status.remedy,
        "optimal": decision.optimal,
        "nodes": decision.nodes,
        "inputs": list(law.plant.input_names),
        "outputs": list(law.plant.output_names),
        "warnings": made.warnings,
    }
    arrays = {"candidates": decision.candidates, "costs": decision.costs, "plan": decision.sequence, "x": then.x}
    landing = then.landing()
    return fields, arrays if landing is None else arrays | {"landing": landing}


def certify(request: dict[str, Any]) -> Answer:
    """What is proven, with the errors of the options, either way."""
    made = setup(request)
    project = made.model
    with within(None, OPTIONS):
        proof = project.certify(delay_error=abs(made.delay_error), gain_error=abs(made.gain_error))
    fields = without_units(proof.summary(margins=request.get("margins") is True))
    fields |= {"covers": _beside(project.file.simulation), "warnings": made.warnings}
    return fields, _band(proof)


def _beside(simulation: SimulationTable) -> str | None:
    """What the run has that the certificate, which is about the model, knows nothing of; None where that is nothing."""
    tables = [f"[simulation.{name}]" for name in ("plant", "hardware") if getattr(simulation, name) is not None]
    return f"the run is of {' and '.join(tables)}, which the bound does not cover" if tables else None


def _band(proof: Certificate) -> dict[str, Array]:
    """The ideal response and how far the output can lie from it; nothing where there is none."""
    if not proof.poles.size or not proof.loop.settles or proof.course is None:
        return {}
    ideal = ideal_run(proof.loop, proof.course)[0].T
    arrays = {"t": proof.course.t, "ideal": ideal}
    if proof.holds:
        arrays |= {"low": ideal - proof.error_bound[:, None], "high": ideal + proof.error_bound[:, None]}
    return arrays


def baseline(request: dict[str, Any]) -> Answer:
    """What people use today, tuned on the same task."""
    which, budget = request.get("which"), request.get("budget", 300)
    if not isinstance(which, str) or which not in BASELINES:
        raise Mistake("which", which, nearest(str(which), BASELINES), key="which")
    if isinstance(budget, bool) or not isinstance(budget, int) or not 20 <= budget <= 2000:
        raise Mistake("budget", budget, "give 20 to 2000 runs", key="budget")
    made = setup(request)
    tuned = made.project.tune(BASELINES[which].law, budget=budget)
    fields, arrays = picture(tuned.run)
    fields |= {
        "which": which,
        "parameters": tuned.parameters,
        "evaluations": tuned.evaluations,
        "warnings": made.warnings,
    }
    return fields, arrays
