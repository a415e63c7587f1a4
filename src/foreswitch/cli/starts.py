"""Verbs to begin with: demo, init, page."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from foreswitch.cli.options import Json, Out
from foreswitch.cli.output import print_json, print_table, slug, stages, write_json
from foreswitch.cli.proofs import print_certificate

__all__ = ["demo", "init", "page"]


def demo(out: Out = Path("foreswitch-demo"), as_json: Json = False) -> None:
    """Pulse test, model, controller, trajectory and certificate on the hot-gas example, beside what people use today."""
    from foreswitch._helpers.files import whole_folder
    from foreswitch._helpers.units import without_units
    from foreswitch.demo.hot_gas import run_demo
    from foreswitch.identification.report import parameter_table
    from foreswitch.simulation.report import metric_table

    begun = time.perf_counter()
    with whole_folder(out) as folder, stages("hot gas") as told:
        result = run_demo(told)
        result.report.write(folder)
        result.fit.record.to_csv(folder / "pulses.csv")
        runs = result.tracking | {name: best.run for name, best in result.tuned.items()}
        runs |= {f"rig, {name}": run for name, run in result.rig.items()}
        runs |= {f"{frequency:g} Hz with vent": run for frequency, run in result.cyclic.items()}
        for name, run in runs.items():
            run.to_csv(folder / f"{slug(name)}.csv")
        summary = {name: without_units(run.summary()) for name, run in runs.items()}
        write_json(folder / "metrics.json", summary)
        write_json(folder / "fit.json", without_units(result.fit.summary()))
        write_json(folder / "certificate.json", without_units(result.proof.summary()))
    if as_json:
        print_json(summary)
        return
    print_table(f"Pulse test, {result.fit.structure}", parameter_table(result.fit))
    print_table("The rig, identified and tracked", metric_table(result.rig, "kPa"))
    print_table("Hot gas, half-period sinusoid", metric_table(result.tracking, "kPa"))
    print_table("Tuned baselines, same task", metric_table({n: b.run for n, b in result.tuned.items()}, "kPa"))
    print_certificate("Certificate", result.proof)
    print_table("Cyclic, with a proportional vent", metric_table(
        {f"{frequency:g} Hz": run for frequency, run in result.cyclic.items()}, "kPa"))  # fmt: skip
    print(f"{out / 'report.html'} and pictures, traces beside it ({time.perf_counter() - begun:.1f} s)")


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for project.toml; made if missing.")],
) -> None:
    """Write a commented project file to start from."""
    from foreswitch._helpers.files import whole_folder, write_whole
    from foreswitch._helpers.mistake import Mistake
    from foreswitch.demo.hot_gas import hot_gas_file

    target = folder / "project.toml"
    if target.exists():
        remedy = "give another folder, or remove it first"
        raise Mistake("DIR", folder, remedy, problem="exists", subject=str(target))
    with whole_folder(folder) as work:
        write_whole(work / "project.toml", hot_gas_file().read_bytes())
    print(f"{target}: edit it, then 'foreswitch simulate {target}'")


def page(
    project: Annotated[
        Path | None, typer.Argument(metavar="[PROJECT.toml]", help="Project to begin with; default an example.")
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Where to listen; 0: any free port.")] = 8732,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen at; default this machine alone.")
    ] = "127.0.0.1",
    remote: Annotated[
        bool, typer.Option("--remote", help="Let other machines in at --host; they need the link with its token.")
    ] = False,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
) -> None:
    """Tune a project in the browser, on this machine and offline; Ctrl-C ends it."""
    try:
        from foreswitch.page import presets, server
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "websockets"):
            raise
        from foreswitch._helpers.mistake import Mistake

        problem = f"needs {error.name}, which is not installed"
        raise Mistake("page", error.name, "pip install 'foreswitch[page]'", problem=problem) from None
    tables = None if project is None else presets.read(project)
    server.run(tables, host=host, port=port, remote=remote, opened=not no_open)
