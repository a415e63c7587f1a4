"""The verb that makes a plant of a record: identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from foreswitch.cli.options import Json, Out
from foreswitch.cli.output import print_json, print_table, progress, write_json

__all__ = ["identify"]


def identify(
    record: Annotated[Path, typer.Argument(metavar="RECORD.csv", help="Record of a test, one row per sample.")],
    time_column: Annotated[
        str, typer.Option("--time", help="Column of the instants [s]: name, or number from 1.")
    ] = "1",
    inputs: Annotated[
        list[str] | None, typer.Option("--input", help="Column of the command; several times if there are several.")
    ] = None,
    outputs: Annotated[
        list[str] | None, typer.Option("--output", help="Column of the measurement; several times if several.")
    ] = None,
    segment: Annotated[
        str | None, typer.Option("--segment", help="Column whose change begins a separate experiment.")
    ] = None,
    skip: Annotated[list[str] | None, typer.Option("--skip", help="Stretch to leave out, FROM:TO in seconds.")] = None,
    structure: Annotated[
        str, typer.Option("--structure", help='"auto", a chain such as "integrator+lag", "lag+pair", or "order 3".')
    ] = "auto",
    drift: Annotated[
        bool | None, typer.Option("--drift/--no-drift", help="Whether the output drifts; default found out.")
    ] = None,
    longest_delay: Annotated[
        float | None, typer.Option("--longest-delay", help="Largest dead time looked for [s].")
    ] = None,
    out: Out = Path("identified"),
    as_json: Json = False,
) -> None:
    """Find a plant with its dead time from a record, and draft a project file."""
    from foreswitch._helpers.files import whole_folder, write_whole
    from foreswitch._helpers.units import without_units
    from foreswitch.identification.record import Record
    from foreswitch.identification.report import candidate_table, parameter_table
    from foreswitch.identification.search import identify
    from foreswitch.studies.draft import draft_project

    columns = {"input": inputs or ["2"], "output": outputs or ["3"], "time": time_column, "segment": segment}
    data = Record.read_csv(record, skip=[_stretch(text) for text in skip or ()], **_columns(columns))
    with progress("reading") as told:
        fit = identify(data, structure, drift=drift, longest_delay=longest_delay, progress=told)
    summary = without_units(fit.summary())
    project = draft_project(fit, record.name)
    with whole_folder(out) as folder:
        fit.report(record.name).write(folder)
        write_whole(folder / "project.toml", project)
        write_json(folder / "fit.json", summary)
    if as_json:
        print_json(summary)
        return
    print_table("Structures compared", candidate_table(fit))
    print_table(", ".join(summary["structure"]), parameter_table(fit))
    for sentence in fit.warnings:
        print(f"Warning: {sentence}")
    print(f"{out / 'project.toml'}: edit it, then 'foreswitch simulate {out / 'project.toml'}'")
    print(f"{out / 'report.html'} and pictures beside it")


def _columns(wanted: dict[str, Any]) -> dict[str, Any]:
    """Column names; whole numbers are positions."""

    def one(name: Any) -> Any:
        return [one(each) for each in name] if isinstance(name, list) else int(name) if str(name).isdigit() else name

    return {key: one(value) for key, value in wanted.items()}


def _stretch(text: str) -> tuple[float, float]:
    try:
        start, end = (float(part) for part in text.split(":"))
    except ValueError:
        from foreswitch._helpers.mistake import Mistake

        raise Mistake("--skip", text, "give FROM:TO in seconds, such as 10:12.5") from None
    return start, end
