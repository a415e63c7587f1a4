"""A certificate as plain data, as a section of a report, and as a report of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from foreswitch._helpers.json import plain_data
from foreswitch._helpers.units import described, rate_unit, unit_of_names
from foreswitch.certificate.reasons import between, intervals, numbers
from foreswitch.presentation.report import Picture, Report, Section, Table, number

if TYPE_CHECKING:
    from foreswitch.certificate.certificate import Certificate

__all__ = ["certificate_report", "certificate_section", "certificate_summary"]


def certificate_summary(proof: Certificate, *, margins: bool) -> dict[str, Any]:
    """What is proven and, if wanted, how much is left; keys with units."""
    plant, e = proof.controller.plant, proof.errors
    given, out = unit_of_names(plant.input_names), unit_of_names(plant.output_names)
    measured = out if proof.controller.estimator is not None else ""
    units = {"delay_error": "s", "load": given, "noise": measured}

    def labelled(values: dict[str, Any]) -> dict[str, Any]:
        return {described(name, units.get(name)): value for name, value in values.items()}

    reach, bound = described("input_range", given), described("error_bound", out)
    found = {
        "holds": proof.holds,
        "reasons": proof.reasons,
        "outputs": plant.output_names,
        "inputs": plant.input_names,
        bound: proof.error_bound,
        described("resolution", out): proof.resolution,
        "poles": [[pole.real, pole.imag] for pole in proof.poles.tolist()],
        "lag [s]": np.ravel(proof.lag),
        "dc_gain": np.atleast_2d(proof.dc_gain),
        reach: proof.input_range,
        described("ideal_input", given): proof.ideal_input,
        "arguments": [{reach: each, bound: values} for each, values in proof.arguments],
        "errors": labelled({"noise": e.noise, "delay_error": e.delay, "gain_error": e.gain, "load": e.load}),
    }
    if margins:
        rates = {"value": out, "slope": rate_unit(out), "acceleration": rate_unit(out, 2)}
        found |= {
            "margins": labelled(proof.margins),
            "Td_intervals [s]": proof.Td_intervals,
            "lam_intervals [rad/s]": proof.lam_intervals,
            "fastest": proof.fastest,
            "steady": {described(name, rates[name]): value for name, value in proof.steady.items()},
            "rest": proof.rest,
        }
    plain: dict[str, Any] = plain_data(found)
    return plain


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
