"""The verb that proves a bound: certify."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foreswitch.cli.options import Duration, Json, ProjectFile, Reference, followed, title
from foreswitch.cli.output import print_json, print_table, write_json

if TYPE_CHECKING:
    from foreswitch.certificate.certificate import Certificate

__all__ = ["certify", "print_certificate"]


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
    duration: Duration = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for report and picture.")] = None,
    as_json: Json = False,
) -> int:
    """Prove how far the output can lie from its ideal response, or say why not (exit code 1)."""
    from foreswitch._helpers.files import whole_folder
    from foreswitch._helpers.units import without_units
    from foreswitch.project.project import Project

    setup = Project.read(project)
    changes: dict[str, Any] = {"delay_error": delay_error, "gain_error": gain_error}
    changes |= {} if load is None else {"load": load}
    changes |= {} if duration is None else {"duration": duration}
    if noise:
        changes["noise"] = noise[0] if len(noise) == 1 else noise
    reference_course = followed(setup, reference, changes)
    proof = setup.certify(reference_course, **changes)
    if out is not None:
        with whole_folder(out) as folder:
            proof.report(title(project)).write(folder)
            write_json(folder / "certificate.json", without_units(proof.summary()))
    if as_json:
        print_json(without_units(proof.summary()))
    else:
        print_certificate(str(project), proof)
        if out is not None:
            print(f"{out / 'report.html'} and picture beside it")
    return 0 if proof.holds else 1


def print_certificate(heading: str, proof: Certificate) -> None:
    """The verdict, then its tables."""
    from foreswitch.certificate.report import certificate_section

    section = certificate_section(proof, pictured=False)
    print(f"{heading}: {section.text[0]}")
    print(section.text[1] + "\n")
    for table in section.tables:
        print_table("", table)
