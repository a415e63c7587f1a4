"""Projects as the page holds them: the examples, and one from a file, all without files of their own."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from foreswitch.project import Project
from foreswitch.reference import Samples

__all__ = ["PRESETS", "embedded", "presets", "read", "references"]

#: Name, title, what it is about.
PRESETS = (
    ("hot_gas", "Hot gas", "A tank filled through an on/off valve that answers 5 ms late: predict past the dead time."),
    ("chamber", "Pressure chamber", "One valve fills, one vents, each with its own dead time; never both open."),
    ("attitude", "Spacecraft attitude", "On/off thrusters turn one axis; a price on switching spares propellant."),
    ("oven", "Oven", "A heater behind a relay, 40 s of dead time, and a relay that must rest between switchings."),
    ("inverter", "Inverter", "Three legs, eight states, a sinusoidal current: distortion against switchings."),
)


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
    return embedded(tomllib.loads(path.read_text(encoding="utf-8")), path.parent)


def embedded(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same tables with points in place of samples; changes its argument."""
    for _, table in references(tables):
        if table.get("kind") == "samples":
            samples = Samples.read_csv(
                folder / table.pop("file"), time=table.pop("time", None), value=table.pop("value", None)
            )
            table |= {"kind": "points", "times": samples.t.tolist(), "values": samples.y.tolist()}
    return tables


def references(tables: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """All tables with the keys of [reference], and where they stand."""
    simulation = tables.get("simulation")
    courses = simulation.get("disturbance") if isinstance(simulation, dict) else None
    for place, found in (("reference", tables.get("reference")), ("simulation.disturbance", courses)):
        for i, table in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(table, dict):
                yield f"{place}.{i}" if isinstance(found, list) else place, table
