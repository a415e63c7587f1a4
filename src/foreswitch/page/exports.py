"""Files to take away, as the command line writes them for the same project."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from foreswitch._helpers.mistake import within
from foreswitch._helpers.toml import toml_text
from foreswitch.export.firmware import check_export, export_c
from foreswitch.export.fmu import export_fmu
from foreswitch.page.setups import SEED, Setup, setup
from foreswitch.project.tables import TABLES

__all__ = ["FILES", "export", "toml"]

#: Dates of an archive, so that it has the same bytes each time.
EPOCH = (1980, 1, 1, 0, 0, 0)


def export(request: dict[str, Any], kind: str) -> bytes:
    """One file.

    Parameters
    ----------
    request : dict
        ``project``, ``options``, and ``name``: what the design is called, in C and in the report's heading.
    kind : str
        One of `FILES`.

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        If the project or its name does not fit.
    """
    name = request.get("name", "controller")
    made = setup(request, capped=False)
    with within(None, {"name": "name"}):
        check_export(made.project.controller, name if isinstance(name, str) and len(name) <= 60 else "")
    with tempfile.TemporaryDirectory() as folder:
        return FILES[kind][0](made, name, Path(folder))


def _project(made: Setup, name: str, _: Path) -> bytes:
    return f"# foreswitch project {name}, from the tuning page; units are SI.\n{toml(_seeded(made.tables))}".encode()


def _seeded(tables: dict[str, Any]) -> dict[str, Any]:
    """With the seed of the page's picture, where there is chance and none is named."""
    simulation = tables["simulation"]
    chance = simulation.get("noise") is not None or simulation.get("hardware") is not None
    return tables | {"simulation": simulation | {"seed": SEED}} if chance and simulation.get("seed") is None else tables


def _report(made: Setup, name: str, folder: Path) -> bytes:
    made.project.simulate().report(name).write(folder)
    return (folder / "report.html").read_bytes()


def _firmware(made: Setup, name: str, folder: Path) -> bytes:
    export_c(made.project.controller, folder / name, name=name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), EPOCH)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o100644 << 16
            archive.writestr(entry, path.read_bytes())
    return buffer.getvalue()


def _fmu(made: Setup, name: str, folder: Path) -> bytes:
    export_fmu(made.project.controller, folder / f"{name}.fmu", name=name)
    return (folder / f"{name}.fmu").read_bytes()


#: What is offered: how it is made, media type, and the end of its name.
FILES: dict[str, tuple[Callable[[Setup, str, Path], bytes], str, str]] = {
    "project.toml": (_project, "application/toml", ".toml"),
    "report.html": (_report, "text/html; charset=utf-8", ".html"),
    "firmware.zip": (_firmware, "application/zip", ".zip"),
    "controller.fmu": (_fmu, "application/octet-stream", ".fmu"),
}

# TOML -----------------------------------------------------------------------------------------------------------------


def toml(tables: dict[str, Any]) -> str:
    """Tables as the text of a project file, with what each key means behind it.

    Parameters
    ----------
    tables : dict
        Of a valid project.

    Returns
    -------
    str
    """
    ordered = {name: tables[name] for name in TABLES if name in tables}
    return toml_text(ordered, meaning=_meaning)


def _meaning(table: str, key: str) -> str | None:
    known = TABLES.get(table)
    return known.model_fields[key].description if known and key in known.model_fields else None
