"""Options and arguments that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from foreswitch.project.project import Project

__all__ = ["Duration", "Json", "MaybeOut", "Out", "ProjectFile", "Reference", "followed", "title"]

Out = Annotated[Path, typer.Option("--out", help="Folder to write to; made if missing.")]
MaybeOut = Annotated[Path | None, typer.Option("--out", help="Folder for report, pictures and trace.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for machines instead of a table.")]
ProjectFile = Annotated[Path, typer.Argument(metavar="PROJECT.toml", help="Project file; see 'foreswitch init'.")]
Reference = Annotated[
    Path | None, typer.Option("--reference", help="CSV with a header row: time, then one column per output.")
]
Duration = Annotated[
    float | None, typer.Option("--duration", help="Seconds; default the reference file's, else the project's.")
]


def followed(setup: Project, reference: Path | None, changes: dict[str, Any]) -> Any:
    """The reference from a file, which also says how long it is, or the project's."""
    if reference is None:
        return setup.reference
    from foreswitch.model.reference import Samples

    found, end = Samples.read_csv_columns(reference, setup.plant.outputs)
    changes.setdefault("duration", end)
    return found


def title(project: Path) -> str:
    """What a report on a project is headed."""
    return project.stem if project.stem != "project" else project.resolve().parent.name
