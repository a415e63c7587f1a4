"""A request's project, ready to run: sizes bounded, the truth as the options say, designs kept for the next request."""

from __future__ import annotations

import json
import math
import warnings
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake, within
from foreswitch.control.objective import Horizon
from foreswitch.model.plant import Plant
from foreswitch.page.limits import LIMITS
from foreswitch.project.project import Project
from foreswitch.project.tables import Valve

__all__ = ["SEED", "Setup", "setup"]

#: Designs kept; the largest, a horizon's tables, take a few MB.
KEPT = 8
#: What is simulated where the file names no seed: pictures stand still while a slider moves.
SEED = 0
#: What an option scales by 1 + gain_error, by model.
GAINS = {"integrator_lag": "k", "fopdt": "K", "transfer_function": "num", "state_space": "B"}

#: Argument -> key of the options.
OPTIONS = {"delay_error": "options.delay_error", "gain_error": "options.gain_error"}

_designs: OrderedDict[str, tuple[Project, list[str]]] = OrderedDict()


@dataclass(frozen=True)
class Setup:
    """What is to be run.

    Attributes
    ----------
    tables : dict
        Of the project file, the truth of the options put in.
    project : Project
        Built from them.
    model : Project
        The same without the options.
    delay_error, gain_error : float
        The options.
    warnings : list of str
        What the design warned of.
    budget : int or None
        Partial sequences per step, where the page allows fewer than the project.
    """

    tables: dict[str, Any]
    project: Project
    model: Project
    delay_error: float
    gain_error: float
    warnings: list[str]
    budget: int | None


def setup(request: dict[str, Any], *, capped: bool = True) -> Setup:
    """The project of a request.

    Parameters
    ----------
    request : dict
        ``project`` and ``options``.
    capped : bool
        Whether the search of a horizon is bounded, so that a run takes no longer than a glance.

    Returns
    -------
    Setup

    Raises
    ------
    ValueError
        If something does not fit, or is too large.
    """
    tables = request.get("project")
    if not isinstance(tables, dict):
        remedy = "give the tables of a project file"
        raise Mistake("project", tables, remedy, problem="has no project", subject="the request")
    delay, gain = _options(request.get("options"))
    _bound_matrices(tables)
    project, told = _design(tables)
    _bound_run(project)
    project, budget = _searching(project, tables) if capped else (project, None)
    model = project.with_simulation(tables["simulation"]).with_seed(SEED)
    if delay == 0.0 and gain == 0.0:
        return Setup(tables, model, model, delay, gain, told, budget)
    truth = _erring(model.truth, tables["simulation"].get("plant") or tables["plant"], delay, gain)
    simulation = tables["simulation"] | {"plant": truth}
    erring = project.with_simulation(simulation).with_seed(SEED)
    return Setup(tables | {"simulation": simulation}, erring, model, delay, gain, told, budget)


def _design(tables: dict[str, Any]) -> tuple[Project, list[str]]:
    """The project, built or as it was built for one that differs in [simulation] only."""
    # by its own text, in which NaN and None differ: each is a mistake of its own
    key = json.dumps({name: table for name, table in tables.items() if name != "simulation"}, sort_keys=True)
    if key not in _designs:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            project = Project(tables, None)
        _designs[key] = project, [str(item.message) for item in caught if item.category is UserWarning]
    _designs.move_to_end(key)
    while len(_designs) > KEPT:
        _designs.popitem(last=False)
    project, told = _designs[key]
    simulation = tables.get("simulation")
    if not isinstance(simulation, dict):
        return Project(tables, None), told  # it says what is missing
    return project.with_simulation(simulation), told


def _options(given: Any) -> tuple[float, float]:
    """delay_error [s] and gain_error [share]."""
    if given is None:
        return 0.0, 0.0
    if not isinstance(given, dict):
        raise Mistake("options", given, "give delay_error and gain_error", problem="are not an object")
    with within(None, OPTIONS):
        delay = check.number("delay_error", given.get("delay_error", 0.0))
        return delay, check.number("gain_error", given.get("gain_error", 0.0), above=-1.0)


def _erring(plant: Plant, table: dict[str, Any], delay: float, gain: float) -> dict[str, Any]:
    """[simulation.plant] of a plant with these errors, in the form that its own table has."""
    with within(None, {"delay": OPTIONS["delay_error"]}):
        late = plant.with_errors(delay, gain).input_delay.tolist()

    def scaled(value: Any) -> Any:
        return [scaled(item) for item in value] if isinstance(value, list) else float(value) * (1.0 + gain)

    key = GAINS[table["model"]]
    several = isinstance(table.get("input_delay"), list)
    return table | {key: scaled(table[key]), "input_delay": late if several else late[0]}


# Bounds ---------------------------------------------------------------------------------------------------------------


def _bound_matrices(tables: dict[str, Any]) -> None:
    """Before anything is computed with them."""

    def table(*path: str) -> Any:
        found: Any = tables
        for part in path:
            found = found.get(part) if isinstance(found, dict) else None
        return found

    most = LIMITS["states"]
    for path in (("plant",), ("simulation", "plant"), ("simulation", "hardware", "drift")):
        found = table(*path)
        for key in ("A", "B", "C", "E", "num", "den") if isinstance(found, dict) else ():
            value = found.get(key)
            longest = (
                max([len(value), *(len(row) for row in value if isinstance(row, list))])
                if isinstance(value, list)
                else 0
            )
            if longest > most + 1:
                place = ".".join((*path, key))
                problem, remedy = f"has {longest} rows or columns", f"the page takes plants of up to {most} states"
                raise Mistake(key, value, remedy, problem=problem, subject=place, key=place)
    hardware = table("simulation", "hardware")
    for key in ("outages", "stuck") if isinstance(hardware, dict) else ():
        value = hardware.get(key)
        if isinstance(value, list) and len(value) > LIMITS["faults"]:
            place = f"simulation.hardware.{key}"
            problem, remedy = f"lists {len(value)} faults", f"the page takes up to {LIMITS['faults']}"
            raise Mistake(key, value, remedy, problem=problem, subject=place, key=place)


def _bound_run(project: Project) -> None:
    """Before it is run: every loop of the simulation has an end that does not depend on the numbers' size."""
    law, table, most = project.controller, project.file.simulation, LIMITS["steps"]
    steps = _periods("duration", table.duration, law.Ts, most, "simulation.duration", "shorten it, or lengthen Ts")
    if check.periods(table.duration, law.Ts) < 1:
        problem = f"is {table.duration:g} s, less than a period"
        raise Mistake("duration", table.duration, "lengthen it", problem=problem, key="simulation.duration")
    truth = project.truth
    if isinstance(truth, Plant):
        delay, place = float(truth.input_delay.max()), "simulation.plant" if table.plant else "plant"
        _periods("input_delay", delay, law.Ts, most, f"{place}.input_delay", "shorten it, or lengthen Ts")
    if (hardware := project.hardware) is not None:
        for key, limit in (("opening", most), ("closing", most), ("late", LIMITS["late"])):
            longest = float(check.array(key, getattr(hardware, key)).max(initial=0.0))
            _periods(key, longest, law.Ts, limit, f"simulation.hardware.{key}", "shorten it")
    told = steps * law.evaluations * law.plant.outputs * law.order
    if told > LIMITS["told"]:
        problem = f"is {law.evaluations}, and over {steps} periods that takes {told} values of the reference"
        remedy = "shorten the run or the horizon"
        raise Mistake("steps", law.evaluations, remedy, problem=problem, key="controller.steps")
    tried = steps * len(law.actuator.candidates)
    if tried > LIMITS["tried"]:
        problem = f"form {len(law.actuator.candidates)} commands, too many to try in {steps} periods"
        remedy = "shorten the run, or use fewer levels"
        raise Mistake("levels", law.levels, remedy, problem=problem, key="actuator.levels")
    if isinstance(table.disturbance, Valve) and steps > LIMITS["valve_steps"]:
        problem = f"is {table.duration:g} s, {steps} periods"
        remedy = f"with a valve as disturbance the page runs up to {LIMITS['valve_steps']}, shorten it"
        raise Mistake("duration", table.duration, remedy, problem=problem, key="simulation.duration")


def _periods(name: str, seconds: float, Ts: float, most: int, key: str, remedy: str) -> int:
    """A time in periods, if it is not too long."""
    if seconds > 0.0 and not seconds / Ts <= most:
        problem = f"is {seconds:g} s, {seconds / Ts:.3g} periods of Ts"
        raise Mistake(name, seconds, f"the page takes up to {most}, {remedy}", problem=problem, key=key)
    return math.ceil(seconds / Ts)


def _searching(project: Project, tables: dict[str, Any]) -> tuple[Project, int | None]:
    """With a bound of each search, where it has none as low."""
    objective = project.controller.objective
    if not isinstance(objective, Horizon):
        return project, None
    budget = max(
        LIMITS["least_nodes"],
        LIMITS["nodes"] // max(1, check.periods(project.file.simulation.duration, project.controller.Ts)),
    )
    if objective.node_budget is not None and objective.node_budget <= budget:
        return project, None
    bounded = tables | {"controller": tables["controller"] | {"node_budget": budget}}
    return _design(bounded)[0], budget
