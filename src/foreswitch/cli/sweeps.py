"""The verb that runs a project many times: study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foreswitch.cli.options import Json, ProjectFile, title
from foreswitch.cli.output import complain, print_json, print_table, progress, write_json

__all__ = ["study"]

#: Grid points that a terminal shows.
LINES = 30


def study(
    project: ProjectFile,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            metavar="KEY=VALUES",
            help="Key of the project file, or delay_error [s], gain_error, and what it takes: 0.01,0.02 or "
            "linspace(0,1,5) or geomspace(1,100,5) for a grid; uniform(0,4), loguniform(0.1,10), normal(1,0.1), "
            "oneof(a,b) drawn for each run. Several times for several keys.",
        ),
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", help="Runs per grid point.")] = 1,
    seed: Annotated[int, typer.Option("--seed", help="Of all that is random.")] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", help='"processes", or the address of a Dask scheduler, tcp://host:port.'),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for table, report and pictures; the same call again continues.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Sweep parameters of a project, or draw them at random: many closed-loop runs, one table."""
    from foreswitch._helpers.files import whole_folder, write_whole
    from foreswitch._helpers.units import without_units
    from foreswitch.studies.result import csv_rows
    from foreswitch.studies.sweep import study
    from foreswitch.studies.workers import WorkersLost

    try:
        with progress("checking") as told:
            result = study(
                project, _over(over or []), repeats=repeats, seed=seed, scheduler=scheduler, out=out, progress=told
            )
    except WorkersLost as error:
        complain(str(error))
        raise typer.Exit(1) from None
    summary = without_units(result.summary())
    if out is not None:
        with whole_folder(out) as folder:
            result.report(title(project)).write(folder)
            write_whole(folder / "summary.csv", csv_rows(result.quantiles()))
            write_json(folder / "metrics.json", summary)
    if as_json:
        print_json(summary)
        return
    content = result.table(LINES, brief=True)
    print_table(str(project), content)
    if content.caption:
        print(content.caption)
    if out is not None:
        print(f"{out / 'report.html'}, pictures and tables beside it")


def _over(given: list[str]) -> dict[str, str]:
    """Keys and what they take."""
    from foreswitch._helpers.mistake import Mistake

    found: dict[str, str] = {}
    for text in given:
        key, equals, values = text.partition("=")
        if not equals or not values.strip():
            raise Mistake("--over", text, "give KEY=VALUES, such as controller.Td=0.01,0.02")
        if key.strip() in found:
            problem = f"stands twice for {key.strip()}"
            raise Mistake("--over", text, "give all its values at once", problem=problem)
        found[key.strip()] = values
    return found
