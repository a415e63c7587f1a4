"""A self-contained HTML report, with its figures beside it as PNG and SVG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from foreswitch import plot
from foreswitch._files import write_whole
from foreswitch.baselines import Tuned
from foreswitch.certificate import Certificate
from foreswitch.controller import Status
from foreswitch.fit import Candidate, Fit
from foreswitch.objective import Horizon
from foreswitch.run import Run
from foreswitch.verdict import between, intervals, numbers

__all__ = [
    "Picture",
    "Report",
    "Section",
    "Table",
    "certificate_report",
    "certificate_section",
    "fit_report",
    "fit_sections",
    "run_report",
    "tuning_table",
]


@dataclass(frozen=True)
class Picture:
    """A figure under the file name it is saved as, with what it shows."""

    name: str
    figure: Figure
    caption: str


@dataclass(frozen=True)
class Table:
    """Rows under headings; the first column names the row."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, then tables and pictures."""

    heading: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    code: str = ""


@dataclass(frozen=True)
class Report:
    """A title, what it is about, and sections."""

    title: str
    lead: str
    sections: Sequence[Section] = field(default_factory=tuple)

    def write(self, folder: Path) -> None:
        """Write ``report.html`` and each picture as PNG and SVG into an existing folder."""
        drawings: dict[str, Markup] = {}
        for section in self.sections:
            for picture in section.pictures:
                image = _saved(picture.figure, "png")
                drawing = _saved(picture.figure, "svg")
                write_whole(folder / f"{picture.name}.png", image)
                write_whole(folder / f"{picture.name}.svg", drawing)
                # inside HTML the drawing goes without its XML prologue
                text = drawing.decode()
                drawings[picture.name] = Markup(text[text.index("<svg") :])
        write_whole(folder / "report.html", self._html(drawings))

    def _html(self, drawings: dict[str, Markup]) -> str:
        text = files("foreswitch").joinpath("templates/report.html").read_text(encoding="utf-8")
        template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        return template.from_string(text).render(report=self, drawings=drawings)


def _saved(figure: Figure, kind: str) -> bytes:
    """The same bytes each time: no date, no random identifiers."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "foreswitch"}):
        figure.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return buffer.getvalue()


def number(value: float, digits: int = 3) -> str:
    """A figure for a table."""
    return f"{value:#.{digits}g}".rstrip(".") if abs(value) < 1e4 else f"{value:.0f}"


def metric_table(runs: dict[str, Run], unit: str = "") -> Table:
    """Figures of merit, one run a row; several outputs or inputs are listed in their order."""
    in_unit = f" [{unit}]" if unit else ""
    metrics = {name: {k: np.atleast_1d(v) for k, v in run.metrics().items()} for name, run in runs.items()}
    factor, second = (1e3, "ms") if max(np.abs(m["lag"]).max() for m in metrics.values()) < 1.0 else (1.0, "s")
    heads = [
        "",
        f"rms error{in_unit}",
        f"largest error{in_unit}",
        f"lag [{second}]",
        f"rms at that lag{in_unit}",
        "switches",
    ]
    rows = []
    for name, m in metrics.items():
        cells = [
            [number(value) for value in m["rms_error"]],
            [number(value) for value in m["max_error"]],
            [f"{round(factor * value, 2) + 0.0:.2f}" for value in m["lag"]],
            [number(value) for value in m["rms_error_at_lag"]],
            [str(value) for value in m["switches"]],
        ]
        rows.append([name, *(", ".join(cell) for cell in cells)])
    return Table(heads, rows)


def tuning_table(tuned: dict[str, Tuned], caption: str) -> Table:
    """What a search found for each baseline, and how many runs it took."""
    rows = [
        [name, ", ".join(f"{key} {number(value)}" for key, value in best.parameters.items()), str(best.evaluations)]
        for name, best in tuned.items()
    ]
    return Table(["", "best parameters found", "runs"], rows, caption)


def status_table(run: Run) -> Table:
    """How often each status came up, and what to do about it."""
    counts = [(status, int((run.status == status).sum())) for status in Status]
    rows = [[status.name, str(count), status.remedy] for status, count in counts if count]
    return Table(["status", "periods", "meaning"], rows)


def search_figures(run: Run, controller: Any) -> dict[str, float]:
    """Median and largest number of nodes per step, and the share of steps proven optimal [%]."""
    nodes = run.nodes[run.nodes > 0]  # none where there was no measurement yet
    if not nodes.size:
        return {"nodes_median": 0.0, "nodes_max": 0.0, "optimal_percent": 0.0}
    budget = getattr(controller.objective, "node_budget", None)
    proven = 1.0 if budget is None else float(np.mean(nodes < budget))
    return {
        "nodes_median": float(np.median(nodes)), "nodes_max": float(nodes.max()), "optimal_percent": 100.0 * proven,
    }  # fmt: skip


def search_table(runs: dict[str, tuple[Run, Any]]) -> Table:
    """How much each predictive law had to search."""
    rows = []
    for name, (run, controller) in runs.items():
        found, objective = search_figures(run, controller), controller.objective
        moves = (objective.moves or objective.steps) if isinstance(objective, Horizon) else 1
        candidates = len(controller._actuator.candidates)
        rows.append([
            name, f"{candidates}^{moves}" if moves > 1 else str(candidates),
            f"{found['nodes_median']:.0f}", f"{found['nodes_max']:.0f}", f"{found['optimal_percent']:.4g}",
        ])  # fmt: skip
    return Table(["", "sequences", "nodes, median", "nodes, largest", "steps proven optimal [%]"], rows)


def run_report(name: str, run: Run, controller: Any) -> Report:
    """One run: picture, figures, statuses and the controller's own summary."""
    searched = isinstance(controller.objective, Horizon)
    sections = [
        Section(
            "Run",
            pictures=[Picture("run", run.plot(), "Output over its reference; commands as they are issued.")],
            tables=[metric_table({"this run": run})],
        ),
        *([Section("Search", tables=[search_table({"this run": (run, controller)})])] if searched else []),
        Section("Status", tables=[status_table(run)]),
        Section("Controller", code=repr(controller)),
        Section("Plant", code=repr(run.plant)),
    ]
    lead = f"Closed loop over {plot.duration_text(float(run.t[-1]))}, {run.u.shape[0]} decisions."
    return Report(name, lead, sections)


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


def parameter_table(fit: Fit) -> Table:
    """What was identified, with standard errors."""
    rows = [[name, number(value, 4), f"{error:.2g}"] for name, (value, error) in fit.parameters.items()]
    return Table(["", "value", "standard error"], rows)


def candidate_table(fit: Fit) -> Table:
    """The structures compared, better ones first; of each the better of drift and none."""
    rows: list[Candidate] = []
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
