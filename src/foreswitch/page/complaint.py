"""A mistake, in one sentence, with the field of the page that it concerns."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from foreswitch.page.limits import LIMITS
from foreswitch.project.project import Project
from foreswitch.project.tables import File, HardwareTable, ReferenceTable, SimulationTable, Valve

__all__ = ["Complaint", "field_of", "short"]


class Complaint(ValueError):
    """One sentence; ``field`` is a key of the project, as in "actuator.Ts", or None."""

    def __init__(self, message: str, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field


def short(text: str) -> str:
    """In one line; of a long value only the beginning, so that the remedy behind it stays."""
    text = " ".join(text.split())
    most = LIMITS["sentence"]
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


#: How a complaint about the form of the tables names a key.
FORMS = (
    re.compile(r"^\[(?P<table>[\w.]+)\] has no key '(?P<key>[^']*)'"),
    re.compile(r"^\[(?P<table>[\w.]+)\] has (?:an unknown )?key '(?P<key>[^']*)'"),
    re.compile(r"^the file has an unknown (?:table|key) '(?P<key>[^']*)'"),
    re.compile(r"^table \[(?P<key>\w+)\] is missing"),
    re.compile(r"^\[(?P<table>[\w.]+)\] (?P<key>\w+) is "),
    re.compile(r"^\[(?P<key>[\w.]+)\] "),
    re.compile(r"^(?P<key>\w+(?:\.\w+)*) is "),
)
#: Sentences whose first words are no key of a table; of several fields, the one to turn first.
WORDS = (
    (r"^plant has \d+ periods of dead time", "plant.input_delay"),
    (r"^plant has \d+ periods of dwell", "actuator.min_on"),
    (r"^plant has \d+ disturbances and loads", "plant.E"),
    (r"^plant has [\d]+ states and the controller's model", "simulation.plant"),
    (r"^plant has \d+ input\(s\)", "simulation.plant"),
    (r"^plant does not show its mode", "plant.C"),
    (r"^plant ", "plant"),
    (r"^the horizon has \d+ candidates", "actuator.levels"),
    (r"^the horizon has \d+ states", "plant"),
    (r"^the horizon has ", "controller.steps"),
    (r"^output \d+ has no candidate effect", "plant"),
    (r"^input \d+ has no effect", "controller.Td"),
    (r"^reference ", "reference"),
    (r"^drift has ", "simulation.hardware.drift"),
    (r"^hardware ", "simulation.hardware"),
    (r"^stuck ", "simulation.hardware.stuck"),
)
#: What arguments are called that stand for a key of another name.
ALIASES = {"t": "times", "y": "values", "kind": "between"}


def field_of(tables: dict[str, Any], sentence: str) -> str | None:
    """The key that a sentence of `Project`, or of its run, is about; None if it cannot be told.

    Parameters
    ----------
    tables : dict
        The project.
    sentence : str

    Returns
    -------
    str or None
        A table where no key of it is to blame.
    """
    try:
        file = File.model_validate(tables)
    except ValueError:
        return _numbered(tables, _by_form(sentence))
    for place, build, known in _stages(tables, file):
        try:
            build()
        except ValueError as error:
            return _within(place, known, str(error))
    keys = dict.fromkeys(SimulationTable.model_fields, "simulation")
    return _within("simulation", dict.fromkeys(HardwareTable.model_fields, "simulation.hardware") | keys, sentence)


def _by_form(sentence: str) -> str | None:
    for form in FORMS:
        if found := form.match(sentence):
            parts = found.groupdict()
            return ".".join(filter(None, (parts.get("table"), parts["key"])))
    return None


def _numbered(tables: dict[str, Any], field: str | None) -> str | None:
    """With the number of the table, where several stand in a list."""
    for place in ("reference", "simulation.disturbance"):
        found: Any = tables
        for part in place.split("."):
            found = found.get(part) if isinstance(found, dict) else None
        if field is None or not isinstance(found, list) or not f"{field}.".startswith(f"{place}."):
            continue
        for i, table in enumerate(found):
            try:
                ReferenceTable.model_validate(table)
            except ValueError:
                return f"{place}.{i}{field.removeprefix(place)}"
    return field


def _stages(tables: dict[str, Any], file: File) -> Iterator[tuple[str, Callable[[], Any], Any]]:
    """How `Project` goes through the tables: where, what is built, and the keys that may be to blame."""
    plant_keys = type(file.plant).model_fields
    yield "plant", file.plant.build, plant_keys
    law = ("controller", "actuator", "estimator")
    owners = {key: table for table in reversed(law) if (own := getattr(file, table)) for key in type(own).model_fields}
    owners |= {key: "plant" for key in plant_keys if key in ("C", "E") or key not in owners}

    def controller() -> Any:
        # everything of a project but its references and its run
        plain: Any = {"kind": "constant", "value": 0.0}
        outputs = file.plant.build().outputs
        content = {key: value for key, value in tables.items() if key not in ("reference", "simulation")}
        return Project(content | {"reference": [plain] * outputs, "simulation": {"duration": 1.0}}, None)

    yield "controller", controller, owners
    simulation = file.simulation
    courses = simulation.disturbance if isinstance(simulation.disturbance, list) else []
    for place, found in (("reference", file.reference), ("simulation.disturbance", courses)):
        for i, table in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(table, ReferenceTable):
                where = f"{place}.{i}" if isinstance(found, list) else place
                yield where, partial(table.build, None, place), ReferenceTable.model_fields
    yield "reference", lambda: _count(file), {}
    if simulation.plant:
        yield "simulation.plant", partial(simulation.plant.build, "simulation.plant"), plant_keys
    if simulation.hardware:
        yield "simulation.hardware", simulation.hardware.build, type(simulation.hardware).model_fields
    if isinstance(simulation.disturbance, Valve):
        yield "simulation.disturbance", lambda: None, Valve.model_fields


def _count(file: File) -> None:
    found = len(file.reference) if isinstance(file.reference, list) else 1
    if found != file.plant.build().outputs:
        raise ValueError("reference")


def _within(place: str, known: Any, sentence: str) -> str | None:
    """The first word that is a key, among the keys that may be to blame."""
    for pattern, about in WORDS:
        if re.match(pattern, sentence):
            return about
    field = _by_form(sentence) if sentence.startswith("[") else None
    if field:  # tables build themselves without knowing their number
        head, _, last = field.rpartition(".")
        return f"{place}.{last}" if place.startswith(head or place) and place[-1:].isdigit() else field
    for word in re.findall(r"\w+", sentence):
        key = word if word in known else ALIASES.get(word, "")
        if key in known:
            owner = known[key] if isinstance(known[key], str) else place
            return f"{owner}.{key}"
    return place or None
