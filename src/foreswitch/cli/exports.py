"""The verb that writes a controller for other machines: export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foreswitch.cli.options import Json, ProjectFile
from foreswitch.cli.output import print_json

__all__ = ["export"]


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
    from foreswitch._helpers.mistake import Mistake
    from foreswitch._helpers.text import nearest
    from foreswitch.export.firmware import export_c, firmware_figures
    from foreswitch.export.fmu import export_fmu
    from foreswitch.project.project import Project

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
        print_json({"name": name, "real": controller.real} | figures)
        return
    sizes = f"{controller.real}, {figures['state_bytes']} bytes of state, {figures['table_bytes']} of constants"
    if kind == "c":
        print(f"{path}: {sizes}")
        print(f"'make -C {path} selftest' replays what was simulated; {path / 'README.md'} says how to call it")
    else:
        print(f"{path}: FMI 2.0 for co-simulation, {'sources only' if source_only else 'binary and sources'}, {sizes}")
        print(f"Step it every {controller.Ts:g} s, before the plant")
