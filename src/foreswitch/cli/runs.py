"""Verbs that run a project's closed loop: simulate, compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from foreswitch.cli.options import Duration, Json, MaybeOut, ProjectFile, Reference, followed, title
from foreswitch.cli.output import print_json, print_table, slug, stages, write_json

__all__ = ["compare", "simulate"]


def simulate(
    project: ProjectFile,
    reference: Reference = None,
    duration: Duration = None,
    out: MaybeOut = None,
    as_json: Json = False,
) -> None:
    """Run a project's closed loop and report on it."""
    from foreswitch._helpers.files import whole_folder
    from foreswitch._helpers.units import without_units
    from foreswitch.control.objective import Horizon
    from foreswitch.project.project import Project
    from foreswitch.simulation.report import metric_table, search_table

    setup = Project.read(project)
    changes: dict[str, Any] = {} if duration is None else {"duration": duration}
    reference_course = followed(setup, reference, changes)
    run = setup.simulate(reference=reference_course, **changes)
    summary = without_units(run.summary())
    if out is not None:
        with whole_folder(out) as folder:
            run.report(title(project)).write(folder)
            run.to_csv(folder / "run.csv")
            write_json(folder / "metrics.json", summary)
    if as_json:
        print_json(summary)
        return
    print_table(str(project), metric_table({"this run": run}))
    if isinstance(setup.controller.objective, Horizon):
        print_table("Search", search_table({"this run": run}))
    if out is not None:
        print(f"{out / 'report.html'}, pictures and trace beside it")


def compare(
    project: ProjectFile,
    budget: Annotated[int, typer.Option("--budget", min=20, help="Closed-loop runs per tuned baseline, about.")] = 300,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for report, pictures and traces.")] = None,
    as_json: Json = False,
) -> None:
    """Laws and tuned baselines on a project: error against switching rate."""
    from foreswitch._helpers.files import whole_folder
    from foreswitch._helpers.units import without_units
    from foreswitch.project.project import Project
    from foreswitch.studies.comparison import compare

    setup = Project.read(project)
    with stages("compare") as told:
        result = compare(setup, budget=budget, progress=told)
    summary = {law: without_units(each) for law, each in result.summary().items()}
    if out is not None:
        with whole_folder(out) as folder:
            result.report(title(project)).write(folder)
            for name, run in result.runs.items():
                run.to_csv(folder / f"{slug(name)}.csv")
            write_json(folder / "metrics.json", summary)
    if as_json:
        print_json(summary)
        return
    print_table(str(project), result.table())
    print_table("Search", result.searches())
    for law, why in result.skipped.items():
        print(f"{law} is left out: {why}")
    if out is not None:
        print(f"{out / 'report.html'}, pictures and traces beside it")
