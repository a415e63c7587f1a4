"""A certificate as a section of a report, and as a report of its own."""

from __future__ import annotations

import numpy as np

from foreswitch.certificate.certificate import Certificate
from foreswitch.certificate.reasons import between, intervals, numbers
from foreswitch.presentation.report import Picture, Report, Section, Table, number

__all__ = ["certificate_report", "certificate_section"]


def certificate_section(proof: Certificate, *, pictured: bool = True) -> Section:
    """What is proven, and what is left until it is not."""
    names = proof.controller.plant.output_names
    bounds = [[f"ideal input {between(low, high)}", *map(number, bound)] for (low, high), bound in proof.arguments]
    bounds.append(["half a pulse, the actuator's own resolution", *map(number, proof.resolution)])
    tables = [Table(["", *(f"bound, {name}" for name in names)], bounds)]
    pictures = []
    if proof.holds:
        words = {
            "delay_error": "dead time wrong by [s]",
            "gain_error": "gain wrong by a share of",
            "load": "unmeasured load",
        }
        left = [[words.get(name, "measurement wrong by"), numbers(values, 3)] for name, values in proof.margins.items()]
        caption = "Each by itself, until a bound is twice as large or nothing is proven."
        tables.append(Table(["what may go wrong", "at most"], left, caption))
        held = [["Td [s]", intervals(proof.Td_intervals)], ["lam [rad/s]", intervals(proof.lam_intervals)]]
        limits = [
            [f"{name} of the output", f"{number(low)} to {number(high)}"] for name, (low, high) in proof.steady.items()
        ]
        if np.isfinite(proof.fastest):
            limits.append(["this reference, run through faster", f"up to {number(proof.fastest)} times"])
        tables.append(Table(["what may be asked for", "range"], [*held, *limits]))
        if pictured and proof.course is not None:
            pictures = [Picture("certificate", proof.plot(), "Output inside its certified band; deviation from the ideal "
                                "response; the ideal input with its range.")]  # fmt: skip
    verdict = "Proven." if proof.holds else "Not proven."
    return Section("Certificate", [f"{verdict} {'. '.join(proof.reasons)}.", proof.rest], tables, pictures)


def certificate_report(name: str, proof: Certificate) -> Report:
    """A certificate by itself."""
    lead = "How far the output can lie from its ideal response, at any time."
    sections = [certificate_section(proof), Section("Controller", code=repr(proof.controller))]
    return Report(name, lead, sections)
