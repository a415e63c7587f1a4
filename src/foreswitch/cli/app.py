"""Command line. Exit code 0: done; 1: ran, but failed; 2: bad usage or bad input, one line on stderr."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from foreswitch._helpers.files import whole_folder, write_whole
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest
from foreswitch.certificate.certificate import Certificate
from foreswitch.certificate.report import certificate_report, certificate_section
from foreswitch.control.objective import Horizon
from foreswitch.demo.hot_gas import hot_gas_file, run_demo
from foreswitch.export.firmware import export_c, firmware_figures
from foreswitch.export.fmu import export_fmu
from foreswitch.identification.fit import Fit
from foreswitch.identification.record import Record
from foreswitch.identification.report import candidate_table, fit_report, parameter_table
from foreswitch.identification.search import identify as run_identify
from foreswitch.model.reference import Samples
from foreswitch.project.project import Project
from foreswitch.simulation.report import metric_table, run_report, search_figures, search_table
from foreswitch.simulation.run import listed
from foreswitch.studies.comparison import compare as run_compare, switching_rate, total_rms
from foreswitch.studies.draft import draft_project
from foreswitch.studies.result import Study, csv_rows
from foreswitch.studies.sweep import study as run_study
from foreswitch.studies.workers import WorkersLost

__all__ = ["main"]

app = typer.Typer(
    name="foreswitch",
    help="Predictive control of actuators that can only switch and act after a dead time.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Out = Annotated[Path, typer.Option("--out", help="Folder to write to; made if missing.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for machines instead of a table.")]
ProjectFile = Annotated[Path, typer.Argument(metavar="PROJECT.toml", help="Project file; see 'foreswitch init'.")]

Reference = Annotated[
    Path | None, typer.Option("--reference", help="CSV with a header row: time, then one column per output.")
]


def _version(wanted: bool) -> None:
    if wanted:
        print(version("foreswitch"))
        raise typer.Exit


@app.callback()
def options(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """What holds for every verb."""


@app.command(epilog="Example: foreswitch demo --out demo")
def demo(out: Out = Path("foreswitch-demo"), as_json: Json = False) -> None:
    """Pulse test, model, controller, trajectory and certificate on the hot-gas example, beside what people use today."""
    console = Console(stderr=True)
    begun = time.perf_counter()
    with whole_folder(out) as folder, console.status("hot gas") as status:
        result = run_demo(lambda what: status.update(what))
        result.report.write(folder)
        result.fit.record.to_csv(folder / "pulses.csv")
        runs = result.tracking | {name: best.run for name, best in result.tuned.items()}
        runs |= {f"rig, {name}": run for name, run in result.rig.items()}
        runs |= {f"{frequency:g} Hz with vent": run for frequency, run in result.cyclic.items()}
        for name, run in runs.items():
            run.to_csv(folder / f"{_slug(name)}.csv")
        summary = {name: listed(run.metrics()) for name, run in runs.items()}
        write_whole(folder / "metrics.json", _json(summary))
        write_whole(folder / "fit.json", _json(_fit_summary(result.fit)))
        write_whole(folder / "certificate.json", _json(result.proof.summary()))
    if as_json:
        print(_json(summary), end="")
        return
    _print_table(f"Pulse test, {result.fit.structure}", parameter_table(result.fit))
    _print_table("The rig, identified and tracked", metric_table(result.rig, "kPa"))
    _print_table("Hot gas, half-period sinusoid", metric_table(result.tracking, "kPa"))
    _print_table("Tuned baselines, same task", metric_table({n: b.run for n, b in result.tuned.items()}, "kPa"))
    _print_certificate("Certificate", result.proof)
    _print_table("Cyclic, with a proportional vent", metric_table(
        {f"{frequency:g} Hz": run for frequency, run in result.cyclic.items()}, "kPa"))  # fmt: skip
    print(f"{out / 'report.html'} and pictures, traces beside it ({time.perf_counter() - begun:.1f} s)")


@app.command(epilog="Example: foreswitch init my_valve")
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for project.toml; made if missing.")],
) -> None:
    """Write a commented project file to start from."""
    target = folder / "project.toml"
    if target.exists():
        remedy = "give another folder, or remove it first"
        raise Mistake("DIR", folder, remedy, problem="exists", subject=str(target))
    with whole_folder(folder) as work:
        write_whole(work / "project.toml", hot_gas_file().read_bytes())
    print(f"{target}: edit it, then 'foreswitch simulate {target}'")


@app.command(epilog="Example: foreswitch identify pulses.csv --time t --input u --output p --out tank")
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
    columns = {"input": inputs or ["2"], "output": outputs or ["3"], "time": time_column, "segment": segment}
    data = Record.read_csv(record, skip=[_stretch(text) for text in skip or ()], **_columns(columns))
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("reading", total=1.0)
        fit = run_identify(
            data, structure, drift=drift, longest_delay=longest_delay,
            progress=lambda share, what: bar.update(task, completed=share, description=what),
        )  # fmt: skip
    summary = _fit_summary(fit)
    project = draft_project(fit, record.name)
    with whole_folder(out) as folder:
        fit_report(record.name, fit).write(folder)
        write_whole(folder / "project.toml", project)
        write_whole(folder / "fit.json", _json(summary))
    if as_json:
        print(_json(summary), end="")
        return
    _print_table("Structures compared", candidate_table(fit))
    _print_table(", ".join(summary["structure"]), parameter_table(fit))
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
        raise Mistake("--skip", text, "give FROM:TO in seconds, such as 10:12.5") from None
    return start, end


def _fit_summary(fit: Fit) -> dict[str, Any]:
    return {
        "structure": np.atleast_1d(fit.structure).tolist(),
        "parameters": {name: {"value": v, "standard_error": e} for name, (v, e) in fit.parameters.items()},
        "fit_percent": np.ravel(fit.fit_percent).tolist(),
        "u_offset": fit.plant.u_offset.tolist(),
        "y_offset": fit.plant.y_offset.tolist(),
        "measurement_noise": fit.measurement_noise.tolist(),
        "candidates": [
            asdict(each) | {"held_back": each.held_back if np.isfinite(each.held_back) else None}
            for each in fit.candidates
        ],
        "warnings": fit.warnings,
    }


@app.command(epilog="Example: foreswitch simulate project.toml --reference reference.csv --out run")
def simulate(
    project: ProjectFile,
    reference: Reference = None,
    duration: Annotated[
        float | None, typer.Option("--duration", help="Seconds; default the reference file's, else the project's.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for report, pictures and trace.")] = None,
    as_json: Json = False,
) -> None:
    """Run a project's closed loop and report on it."""
    setup = Project.read(project)
    changes: dict[str, Any] = {} if duration is None else {"duration": duration}
    followed = _followed(setup, reference, changes)
    run = setup.simulate(reference=followed, **changes)
    summary = listed(run.metrics())
    searched = isinstance(setup.controller.objective, Horizon)
    if searched:
        summary["search"] = search_figures(run, setup.controller)
    if out is not None:
        with whole_folder(out) as folder:
            run_report(_title(project), run, setup.controller).write(folder)
            run.to_csv(folder / "run.csv")
            write_whole(folder / "metrics.json", _json(summary))
    if as_json:
        print(_json(summary), end="")
        return
    _print_table(str(project), metric_table({"this run": run}))
    if searched:
        _print_table("Search", search_table({"this run": (run, setup.controller)}))
    if out is not None:
        print(f"{out / 'report.html'}, pictures and trace beside it")


@app.command(epilog="Example: foreswitch certify project.toml --delay-error 0.0005 --gain-error 0.05 --out proof")
def certify(
    project: ProjectFile,
    noise: Annotated[
        list[float] | None,
        typer.Option("--noise", help="Largest error of the measured values, one for all or one each; default 4 sigma."),
    ] = None,
    delay_error: Annotated[float, typer.Option("--delay-error", help="Largest error of the dead times [s].")] = 0.0,
    gain_error: Annotated[float, typer.Option("--gain-error", help="Largest error of the gains, as a share.")] = 0.0,
    load: Annotated[
        float | None, typer.Option("--load", help="Largest unmeasured load; default the project's.")
    ] = None,
    reference: Reference = None,
    duration: Annotated[
        float | None, typer.Option("--duration", help="Seconds; default the reference file's, else the project's.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for report and picture.")] = None,
    as_json: Json = False,
) -> int:
    """Prove how far the output can lie from its ideal response, or say why not (exit code 1)."""
    setup = Project.read(project)
    changes: dict[str, Any] = {"delay_error": delay_error, "gain_error": gain_error}
    changes |= {} if load is None else {"load": load}
    changes |= {} if duration is None else {"duration": duration}
    if noise:
        changes["noise"] = noise[0] if len(noise) == 1 else noise
    followed = _followed(setup, reference, changes)
    proof = setup.certify(followed, **changes)
    if out is not None:
        with whole_folder(out) as folder:
            certificate_report(_title(project), proof).write(folder)
            write_whole(folder / "certificate.json", _json(proof.summary()))
    if as_json:
        print(_json(proof.summary()), end="")
    else:
        _print_certificate(str(project), proof)
        if out is not None:
            print(f"{out / 'report.html'} and picture beside it")
    return 0 if proof.holds else 1


def _print_certificate(title: str, proof: Certificate) -> None:
    section = certificate_section(proof, pictured=False)
    print(f"{title}: {section.text[0]}")
    print(section.text[1] + "\n")
    for table in section.tables:
        _print_table("", table)


@app.command(epilog="Example: foreswitch compare project.toml --out compared")
def compare(
    project: ProjectFile,
    budget: Annotated[int, typer.Option("--budget", min=20, help="Closed-loop runs per tuned baseline, about.")] = 300,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for report, pictures and traces.")] = None,
    as_json: Json = False,
) -> None:
    """Laws and tuned baselines on a project: error against switching rate."""
    setup = Project.read(project)
    with Console(stderr=True).status("compare") as status:
        result = run_compare(setup, budget=budget, progress=lambda what: status.update(what))
    summary = {name: listed(run.metrics()) for name, run in result.runs.items()}
    for law, curve in result.curves.items():
        summary[law]["curve"] = [
            {"parameter": value, "rms_error": total_rms(run), "switching_rate": switching_rate(run)}
            for value, run in curve
        ]
    for law, controller in result.laws.items():
        summary[law]["search"] = search_figures(result.runs[law], controller)
    if out is not None:
        with whole_folder(out) as folder:
            result.report(_title(project)).write(folder)
            for name, run in result.runs.items():
                run.to_csv(folder / f"{_slug(name)}.csv")
            write_whole(folder / "metrics.json", _json(summary))
    if as_json:
        print(_json(summary), end="")
        return
    _print_table(str(project), result.table())
    _print_table(
        "Search", search_table({law: (result.runs[law], controller) for law, controller in result.laws.items()})
    )
    for law, why in result.skipped.items():
        print(f"{law} is left out: {why}")
    if out is not None:
        print(f"{out / 'report.html'}, pictures and traces beside it")


@app.command(
    epilog="Example: foreswitch export project.toml c build/firmware --real float32, "
    "or foreswitch export project.toml fmu build/controller.fmu"
)
def export(
    project: ProjectFile,
    kind: Annotated[
        str, typer.Argument(metavar="c|fmu", help="What to write: firmware in C99, or an FMU for co-simulation.")
    ],
    path: Annotated[
        Path, typer.Argument(metavar="DIR|FILE.fmu", help="Folder of the firmware, or the FMU; made if missing.")
    ],
    real: Annotated[
        str | None, typer.Option("--real", help='"float64" or "float32"; default what the project says.')
    ] = None,
    name: Annotated[str, typer.Option("--name", help="What the design is called in C, or the model.")] = "controller",
    source_only: Annotated[
        bool, typer.Option("--source-only", help="An FMU without a binary for this machine.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a project's controller for other machines and tools, to the bit what was simulated."""
    if kind not in ("c", "fmu"):
        raise Mistake("kind", kind, nearest(kind, ("c", "fmu")))
    if kind == "c" and source_only:
        remedy = "leave it out, firmware is sources anyway"
        raise Mistake("--source-only", True, remedy, problem="is for an FMU")
    controller = Project.read(project).controller
    if real is not None and real != controller.real:
        controller = controller.replace(real=real)
    if kind == "c":
        export_c(controller, path, name=name)
    else:
        export_fmu(controller, path, name=name, binary=not source_only)
    figures = firmware_figures(controller)
    if as_json:
        print(_json({"name": name, "real": controller.real} | figures), end="")
        return
    sizes = f"{controller.real}, {figures['state_bytes']} bytes of state, {figures['table_bytes']} of constants"
    if kind == "c":
        print(f"{path}: {sizes}")
        print(f"'make -C {path} selftest' replays what was simulated; {path / 'README.md'} says how to call it")
    else:
        print(f"{path}: FMI 2.0 for co-simulation, {'sources only' if source_only else 'binary and sources'}, {sizes}")
        print(f"Step it every {controller.Ts:g} s, before the plant")


@app.command(
    epilog='Example: foreswitch study project.toml --over "controller.Td=0.01,0.02" --over "gain_error=uniform(-0.1,0.1)" '
    "--repeats 100 --out study"
)
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
    console = Console(stderr=True)
    try:
        with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task("checking", total=1.0)
            result = run_study(
                project, _over(over or []), repeats=repeats, seed=seed, scheduler=scheduler, out=out,
                progress=lambda share, what: bar.update(task, completed=share, description=what),
            )  # fmt: skip
    except WorkersLost as error:
        _complain(str(error))
        raise typer.Exit(1) from None
    summary = _study_summary(result)
    if out is not None:
        with whole_folder(out) as folder:
            result.report(_title(project)).write(folder)
            write_whole(folder / "summary.csv", csv_rows(result.summary()))
            write_whole(folder / "metrics.json", _json(summary))
    if as_json:
        print(_json(summary), end="")
        return
    content = result.table(LINES, brief=True)
    _print_table(str(project), content)
    if content.caption:
        print(content.caption)
    if out is not None:
        print(f"{out / 'report.html'}, pictures and tables beside it")


@app.command(epilog="Example: foreswitch page project.toml")
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
        problem = f"needs {error.name}, which is not installed"
        raise Mistake("page", error.name, "pip install 'foreswitch[page]'", problem=problem) from None
    tables = None if project is None else presets.read(project)
    server.run(tables, host=host, port=port, remote=remote, opened=not no_open)


#: Grid points that a terminal shows.
LINES = 30


def _over(given: list[str]) -> dict[str, str]:
    """Keys and what they take."""
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


def _study_summary(result: Study) -> dict[str, Any]:
    """Grid points with their parameters and quantiles."""
    columns = {name: values.tolist() for name, values in result.summary().items()}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    finite = [{k: v if not isinstance(v, float) or np.isfinite(v) else None for k, v in row.items()} for row in rows]
    return {"runs": len(result), "repeats": result.plan.repeats, "seed": result.plan.seed, "points": finite}


def _followed(setup: Project, reference: Path | None, changes: dict[str, Any]) -> Any:
    """The reference from a file, which also says how long it is, or the project's."""
    if reference is None:
        return setup.reference
    followed, end = Samples.read_csv_columns(reference, setup.plant.outputs)
    changes.setdefault("duration", end)
    return followed


def _title(project: Path) -> str:
    return project.stem if project.stem != "project" else project.resolve().parent.name


def _slug(name: str) -> str:
    words = "".join(c if c.isalnum() or c == "." else " " for c in name.lower()).split()
    return "_".join(words).replace(".", "p")


def _json(value: Any) -> str:
    return json.dumps(value, indent=2) + "\n"


def _print_table(title: str, content: Any) -> None:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for i, head in enumerate(content.heads):
        table.add_column(escape(head), no_wrap=i == 0, justify="left" if i == 0 else "right")
    for row in content.rows:
        table.add_row(*map(escape, row))
    console = Console()
    console.print(table)
    console.print()


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the ``foreswitch`` command; exits the process.

    Parameters
    ----------
    arguments : list of str, optional
        Default: the process's own.
    """
    given = sys.argv[1:] if arguments is None else arguments
    try:
        code = app(args=given or ["--help"], standalone_mode=False)
    except ValueError as error:
        sys.exit(_complain(str(error)))
    except OSError as error:
        sys.exit(_complain(f"{error.filename} cannot be used ({error.strerror}); give another path"))
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        # typer's own usage errors carry their exit code; anything else is a defect and shows its traceback
        if not hasattr(error, "format_message"):
            raise
        sys.exit(_complain(error.format_message()))
    sys.exit(code if isinstance(code, int) else 0)


def _complain(sentence: str) -> int:
    print("foreswitch: " + " ".join(sentence.split()), file=sys.stderr)
    return 2
