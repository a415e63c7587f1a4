"""Projects as the page holds them: the examples, and one from a file, all without files of their own."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Iterator
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from foreswitch._helpers.json import json_text
from foreswitch._helpers.mistake import Mistake, inside, shown, within
from foreswitch.model.reference import Samples
from foreswitch.page.limits import LIMITS
from foreswitch.page.uploads import under_its_name
from foreswitch.project.project import Project

__all__ = ["PRESETS", "dropped", "embedded", "presets", "read", "references"]

#: Name, title, what it is about.
PRESETS = (
    ("hot_gas", "Hot gas", "A tank filled through an on/off valve that answers 5 ms late: predict past the dead time."),
    ("chamber", "Pressure chamber", "One valve fills, one vents, each with its own dead time; never both open."),
    ("attitude", "Spacecraft attitude", "On/off thrusters turn one axis; a price on switching spares propellant."),
    ("oven", "Oven", "A heater behind a relay, 40 s of dead time, and a relay that must rest between switchings."),
    ("inverter", "Inverter", "Three legs, eight states, a sinusoidal current: distortion against switchings."),
)


#: Bytes of a request that are not its project.
BESIDE = 4096


def presets() -> list[dict[str, Any]]:
    """All examples."""
    found = []
    for name, title, about in PRESETS:
        with as_file(files("foreswitch").joinpath("examples", name, "project.toml")) as path:
            found.append({"name": name, "title": title, "about": about, "project": read(path)})
    return found


def read(path: Path) -> dict[str, Any]:
    """The tables of a project file, its CSV files put in.

    Raises
    ------
    ValueError
        As `Project.read`.
    """
    Project.read(path)  # complains in the words of the command line
    return _judged(embedded(tomllib.loads(path.read_text(encoding="utf-8")), path.parent))


def dropped(request: dict[str, Any]) -> dict[str, Any]:
    """The tables of a project file that was dropped on the page, with the CSV files that it names.

    Parameters
    ----------
    request : dict
        ``toml``, the text, and ``files``: text by name. Folders in names, the project's or the files', are not looked at.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        If something is missing or does not fit.
    """
    text, given = request.get("toml"), request.get("files") or {}
    if not isinstance(text, str) or not isinstance(given, dict) or not all(isinstance(v, str) for v in given.values()):
        problem = "holds no text of a project"
        raise Mistake("toml", text, "give toml, and files by their names", problem=problem, subject="the request")
    try:
        tables = tomllib.loads(text)
    except ValueError as error:  # a number of thousands of digits is not a TOMLDecodeError
        problem = f"is not valid TOML ({error})"
        raise Mistake("toml", text, "correct that line", problem=problem, subject="the file") from None
    content = {_last(name): file for name, file in given.items()}
    with tempfile.TemporaryDirectory() as folder:
        for place, table in references(tables):
            if table.get("kind") == "samples" and isinstance(table.get("file"), str):
                name = _last(table["file"])
                if name not in content:
                    problem, remedy = f"names the file {shown(name)}", "drop that file together with it"
                    raise Mistake("files", name, remedy, problem=problem, subject="the project", key=f"{place}.file")
                path = Path(folder) / "samples.csv"
                path.write_text(content[name], encoding="utf-8")
                with within(f"{place}.file", {}), under_its_name(name):
                    _embed(table, path)
    return _judged(tables)


def _judged(tables: dict[str, Any]) -> dict[str, Any]:
    """Whether a request can hold it."""
    try:
        size = len(json_text(tables))
    except TypeError:
        problem = "holds a date or a time, which no key of it takes"
        raise Mistake("project", None, "give numbers and texts", problem=problem, subject="the project") from None
    if size > LIMITS["message"] - BESIDE:
        remedy = f"the page takes up to {LIMITS['message'] - BESIDE}, thin its points out"
        raise Mistake("project", size, remedy, problem=f"takes {size} bytes", subject="the project")
    return tables


def _last(name: str) -> str:
    """A file's name without its folders, in whichever way they are written."""
    return name.replace("\\", "/").rsplit("/", 1)[-1]


def embedded(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same tables with points in place of samples; changes its argument.

    Raises
    ------
    ValueError
        If a file has more points than a request has room for.
    """
    for _, table in references(tables):
        if table.get("kind") == "samples":
            _embed(table, folder / table["file"])
    return tables


def _embed(table: dict[str, Any], path: Path) -> None:
    """Points in place of the file."""
    samples = Samples.read_csv(path, time=table.get("time"), value=table.get("value"))
    if samples.t.size > LIMITS["points"]:
        with inside(path):
            remedy = f"the page takes references of up to {LIMITS['points']} points, thin it out"
            raise Mistake("path", path, remedy, problem=f"has {samples.t.size} rows", subject="")
    for key in ("file", "time", "value"):
        table.pop(key, None)
    table |= {"kind": "points", "times": samples.t.tolist(), "values": samples.y.tolist()}


def references(tables: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """All tables with the keys of [reference], and where they stand."""
    simulation = tables.get("simulation")
    courses = simulation.get("disturbance") if isinstance(simulation, dict) else None
    for place, found in (("reference", tables.get("reference")), ("simulation.disturbance", courses)):
        for i, table in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(table, dict):
                yield f"{place}.{i}" if isinstance(found, list) else place, table
