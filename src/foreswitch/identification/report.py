"""An identification as tables, as sections of a report, and as a report of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foreswitch.presentation.report import Picture, Report, Section, Table, number

if TYPE_CHECKING:
    from foreswitch.identification.fit import Fit, FittedStructure

__all__ = ["candidate_table", "fit_report", "fit_sections", "parameter_table"]


def parameter_table(fit: Fit) -> Table:
    """What was identified, with standard errors."""
    rows = [[name, number(value, 4), f"{error:.2g}"] for name, (value, error) in fit.parameters.items()]
    return Table(["", "value", "standard error"], rows)


def candidate_table(fit: Fit) -> Table:
    """The structures compared, better ones first; of each the better of drift and none."""
    rows: list[FittedStructure] = []
    seen: set[tuple[str, str]] = set()
    for each in sorted(fit.candidates, key=lambda c: (c.output, not c.chosen, c.criterion)):
        if (each.output, each.structure) in seen:
            continue
        seen.add((each.output, each.structure))
        rows.append(each)
    rows.sort(key=lambda each: (each.output, each.criterion))
    several = len({each.output for each in rows}) > 1
    least = {output: min(e.criterion for e in rows if e.output == output) for output in {e.output for e in rows}}
    heads = ["", "criterion", "held-back error", "fit [%]"]
    cells = [
        [
            (f"{e.output}: " if several else "") + e.structure + ", drift" * e.drift + " (chosen)" * e.chosen,
            f"{e.criterion - least[e.output]:.1f}",
            number(e.held_back) if np.isfinite(e.held_back) else "",
            f"{e.fit_percent:.1f}",
        ]
        for e in rows
    ]
    return Table(
        heads, cells, "Bayesian information criterion, from the smallest; error on the end of the record, not fitted."
    )


def fit_sections(fit: Fit) -> list[Section]:
    """Record, pulses, parameters, comparison and residuals of an identification."""
    pulses = fit.plot_pulses()
    average = [] if pulses is None else [
        Picture("pulses", pulses, "Average response to equal pulses, with its scatter, and the model's.")
    ]  # fmt: skip
    structure = ", ".join(np.atleast_1d(fit.structure))
    return [
        Section("Warnings", list(fit.warnings) or ["None."]),
        Section(f"Model: {structure}", tables=[parameter_table(fit)], pictures=average, code=repr(fit.plant)),
        Section("Record", pictures=[Picture("record", fit.plot(), "The record, and the fit simulated over it.")]),
        Section("Structures compared", tables=[candidate_table(fit)]),
        Section("What the fit leaves", pictures=[
            Picture("residuals", fit.plot_residuals(), "Residuals over time and their autocorrelation.")
        ]),
    ]  # fmt: skip


def fit_report(name: str, fit: Fit) -> Report:
    """An identification: what was found, how sure it is, and what the data could not tell."""
    lead = f"{len(fit.record)} samples, one every {fit.record.Ts:g} s, {len(fit.record.segments)} segment(s)."
    return Report(name, lead, fit_sections(fit))
