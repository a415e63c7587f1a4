"""What an FMU shows of a controller: its variables, and modelDescription.xml that lists them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.units import name_and_unit
from foreswitch.control.controller import Controller
from foreswitch.control.decision import Status
from foreswitch.control.objective import Horizon

__all__ = ["UNKNOWN", "Variable", "constants", "described", "listed_variables"]

#: Stands for the identifier, which is of what the FMU consists of.
UNKNOWN = "{00000000-0000-0000-0000-000000000000}"
BASES = {
    Status.OK: "the measurement", Status.COASTING: "the model's prediction in place of a bad measurement",
    Status.HELD: "nothing usable, the command is kept", Status.SAFE: "the safe level after bad measurements in a row",
}  # fmt: skip


# Variables ------------------------------------------------------------------------------------------------------------


@dataclass
class Variable:
    """One of the model's variables: causality as in FMI, or "constant", or nothing where it is not shown."""

    name: str
    causality: str
    description: str
    unit: str = ""
    kind: str = "Real"
    start: float | None = None
    bounds: tuple[float, float] | None = None
    reference: int = 0


def listed_variables(controller: Controller) -> list[Variable]:
    """In the order of core/fmi/fmi.c, so that a variable's place among those of its kind is its value reference."""
    searched = isinstance(controller.objective, Horizon)
    bases = "; ".join(f"{each.value}: {each.name}, {words}" for each, words in BASES.items())
    shown = "output" if searched else ""
    listed = [
        *_inputs(controller),
        *_results(controller, shown),
        *(Variable(name, "constant", what, unit, start=value) for name, value, unit, what in constants(controller)),
        Variable("status", "output", bases, kind="Integer", bounds=(0, len(BASES) - 1)),
        Variable("bad_samples", "local", "Samples in a row that were not usable", kind="Integer"),
        Variable("bad_samples_total", "local", "Samples that were not usable", kind="Integer"),
        Variable("nodes", shown, "Partial sequences evaluated", kind="Integer"),
        Variable("optimal", shown, "Whether the command is proven best", kind="Boolean"),
    ]
    places = dict.fromkeys(("Real", "Integer", "Boolean"), 0)
    names: set[str] = set()
    for each in listed:
        each.reference = places[each.kind]
        places[each.kind] += 1
        while each.name in names:
            each.name += "_"
        names.add(each.name)
    return [each for each in listed if each.causality]


def _inputs(law: Controller) -> Iterator[Variable]:
    plant, outputs = law.plant, _named("y", law.plant.output_names)
    if law.estimator is None:
        for i in range(plant.states):
            yield Variable(f"measured.x[{i + 1}]", "input", f"Measured state {i + 1} of the model", start=0.0)
    else:
        for spelled, unit, given in outputs:
            yield Variable(f"measured.{spelled}", "input", f"Measured {given}", unit, start=0.0)
    for e, row in enumerate(_times(law)):
        at = f"[{e + 1}]" if law.evaluations > 1 else ""
        for (spelled, unit, given), ahead in zip(outputs, row, strict=True):
            when = f"{ahead:.6g} s after the decision" if ahead else "at the decision"
            for order in range(law.order):
                what = given if order == 0 else f"derivative {order} of {given}"
                name = f"reference.{spelled}{('', '_der')[order > 0]}{order if order > 1 else ''}{at}"
                yield Variable(name, "input", f"Wanted {what}, {when}", _rate(unit, order), start=0.0)
    for i in range(plant.disturbances):
        yield Variable(f"disturbance[{i + 1}]", "input", f"Measured disturbance {i + 1}", start=0.0)


def _results(law: Controller, gap: str) -> Iterator[Variable]:
    for (spelled, unit, given), levels in zip(_named("u", law.plant.input_names), law.levels, strict=True):
        listed = ", ".join(f"{v:g}" for v in levels)
        bounds = float(levels[0]), float(levels[-1])
        yield Variable(f"command.{spelled}", "output", f"Commanded {given}: {listed}", unit, bounds=bounds)
    yield Variable("cost", "output", "Predicted cost of the command; 0 where none was computed")
    yield Variable("gap", gap, "What a better sequence could save at most; 0: the command is proven best")
    for i in range(law.plant.states):
        yield Variable(f"estimate.x[{i + 1}]", "local", f"State {i + 1} that the command is based on")
    for i in range(law.estimate[1].size):
        yield Variable(f"estimate.load[{i + 1}]", "local", f"Load {i + 1} that the command is based on")


def _times(law: Controller) -> Array:
    """When each output's reference is wanted, after the decision [s]: (evaluations, q)."""
    return np.broadcast_to(law.reference_times.reshape(law.evaluations, -1), (law.evaluations, law.plant.outputs))


def constants(controller: Controller) -> list[tuple[str, float, str, str]]:
    """Name, value, unit, description."""
    plant = controller.plant
    listed = [("Ts", controller.Ts, "s", "Switching period")]
    for (spelled, unit, given), delay, levels in zip(
        _named("u", plant.input_names), plant.input_delay, controller.levels, strict=True
    ):
        listed.append((f"dead_time.{spelled}", float(delay), "s", f"Dead time of {given}"))
        for i, level in enumerate(levels):
            listed.append((f"level.{spelled}[{i + 1}]", float(level), unit, f"Level {i + 1} of {given}"))
    for e, row in enumerate(_times(controller)):
        at = f"[{e + 1}]" if controller.evaluations > 1 else ""
        for (spelled, _, given), ahead in zip(_named("y", plant.output_names), row, strict=True):
            what = f"When the reference of {given} is wanted, after the decision"
            listed.append((f"reference_time.{spelled}{at}", float(ahead), "s", what))
    return listed


def _rate(unit: str, order: int) -> str:
    return unit if not unit or order == 0 else f"{unit}/s" if order == 1 else f"{unit}/s{order}"


def _named(prefix: str, names: Sequence[str]) -> list[tuple[str, str, str]]:
    """For each name an identifier, the unit in brackets, and the name without it: "pressure [kPa]"."""
    found: list[tuple[str, str, str]] = []
    for i, name in enumerate(names):
        words, unit = name_and_unit(name)
        spelled = re.sub(r"[^A-Za-z0-9_]+", "_", words).strip("_") or f"{prefix}{i + 1}"
        if spelled[0].isdigit():
            spelled = f"{prefix}_{spelled}"
        while spelled in [each[0] for each in found]:
            spelled += f"_{i + 1}"
        found.append((spelled, unit, " ".join(words.split()) or spelled))
    return found


# Description ----------------------------------------------------------------------------------------------------------


def described(controller: Controller, name: str, variables: Sequence[Variable], sources: Sequence[str]) -> str:
    """modelDescription.xml; the instants of one reference stand together."""
    listed = sorted(variables, key=_family(variables))
    title = f"{', '.join(controller.plant.output_names)} by {', '.join(controller.plant.input_names)}"
    root = _element(
        "fmiModelDescription", fmiVersion="2.0", modelName=name, guid=UNKNOWN,
        description=f"Predictive control of {title}, every {controller.Ts:g} s",
        generationTool=f"foreswitch {version('foreswitch')}", variableNamingConvention="structured",
    )  # fmt: skip
    kind = _element(
        "CoSimulation", root, modelIdentifier=name, canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true", canSerializeFMUstate="true",
    )  # fmt: skip
    files = _element("SourceFiles", kind)
    for file in sources:
        _element("File", files, name=file)
    units = _element("UnitDefinitions", root)
    for unit in sorted({each.unit for each in listed if each.unit}):
        definition = _element("Unit", units, name=unit)
        if unit == "s":
            _element("BaseUnit", definition, s="1")
    log = _element("LogCategories", root)
    said = "What a command is based on, when that changes; steps over periods"
    _element("Category", log, name="logStatusWarning", description=said)
    _element("Category", log, name="logStatusError", description="Calls that cannot be answered")
    _element("DefaultExperiment", root, startTime="0.0", stepSize=repr(controller.Ts))
    shown = _element("ModelVariables", root)
    for each in listed:
        _variable(shown, each)
    structure = _element("ModelStructure", root)
    for part in ("Outputs", "InitialUnknowns"):
        unknowns = _element(part, structure)
        for i, each in enumerate(listed, start=1):
            if each.causality == "output":
                _element("Unknown", unknowns, index=str(i))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _element(tag: str, parent: Element | None = None, /, **attributes: str) -> Element:
    """With attributes of what XML can hold."""
    clean = {key: "".join(c if c.isprintable() else " " for c in text) for key, text in attributes.items()}
    return Element(tag, clean) if parent is None else SubElement(parent, tag, clean)


def _family(variables: Sequence[Variable]) -> Callable[[Variable], tuple[int, int]]:
    """A sort key: where the first of the same name without index stands, then the own place."""
    first: dict[str, int] = {}
    for i, each in enumerate(variables):
        first.setdefault(each.name.split("[")[0], i)
    places = {each.name: (first[each.name.split("[")[0]], i) for i, each in enumerate(variables)}
    return lambda each: places[each.name]


def _variable(parent: Element, each: Variable) -> None:
    causality = "local" if each.causality == "constant" else each.causality
    variability = {"input": "continuous", "constant": "constant"}.get(each.causality, "discrete")
    initial = {"input": {}, "constant": {"initial": "exact"}}.get(each.causality, {"initial": "calculated"})
    scalar = _element(
        "ScalarVariable", parent, name=each.name, valueReference=str(each.reference), causality=causality,
        variability=variability, **initial, description=each.description,
    )  # fmt: skip
    kind = {"unit": each.unit} if each.unit else {}
    if each.bounds is not None:
        kind |= {"min": repr(each.bounds[0]), "max": repr(each.bounds[1])}
    if each.start is not None:
        kind["start"] = repr(each.start)
    _element(each.kind, scalar, **kind)
