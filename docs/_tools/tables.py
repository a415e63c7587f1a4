"""Tables of the pages, read off what the code declares and what benchmarks have counted."""

from __future__ import annotations

import inspect
import json
import re
import runpy
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined
from typer.testing import CliRunner

from foreswitch import Hardware, Status, compare_precision
from foreswitch.cli import app
from foreswitch.identification.structures import STRUCTURES, Structure
from foreswitch.presentation import report
from foreswitch.project.project import Project
from foreswitch.project.tables import TABLES as EVERY, Choice, PlantTable
from foreswitch.studies.comparison import total_rms
from gallery import examples

ROOT = Path(__file__).resolve().parents[2]

#: Each form of table once: the plants of [simulation] have the keys of [plant].
TABLES = {name: table for name, table in EVERY.items() if name == "plant" or table is not PlantTable}
WORDS = {float: "number", int: "whole number", str: "text", bool: "true, false"}
WORDS |= dict.fromkeys(TABLES.values(), "table")


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A pipe table."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"

    return "\n".join([line(heads), line(["---"] * len(heads)), *map(line, rows)]) + "\n"


def words(annotation: Any, plural: str = "") -> str:
    """A type in the words of a TOML file."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ", ".join(f'`"{value}"`' for value in inner)
    if origin in (Union, UnionType):
        return " or ".join(words(item, plural) for item in inner if item is not NoneType)
    if origin is list:
        return f"list{plural} of {words(inner[0], 's')}"
    return WORDS[annotation] + plural


def key_rows() -> Iterator[list[str]]:
    """One row for each key: key with its table, value, default, meaning."""
    for table, model in TABLES.items():
        for key, field in model.model_fields.items():
            if field.default is PydanticUndefined:
                default = "needed"
            elif field.default is None:
                default = ""
            else:
                default = f"`{json.dumps(field.default)}`"
            yield [f"`{table}.{key}`", words(field.annotation), default, field.description or ""]


def choice_rows() -> Iterator[list[str]]:
    """One row for each choice of a table: the keys it needs, and those it may have."""
    for table, model in TABLES.items():
        if issubclass(model, Choice):
            for choice, (needed, optional) in model.USES.items():
                keys = [", ".join(f"`{key}`" for key in group) for group in (needed, optional)]
                yield [f'`[{table}]` `{model.BY} = "{choice}"`', *keys]


def verbs() -> list[str]:
    """Every verb of the command line."""
    return [command.callback.__name__ for command in app.app.registered_commands if command.callback]


def help_text(verb: str) -> str:
    """What ``foreswitch VERB --help`` prints."""
    result = CliRunner().invoke(app.app, [verb, "--help"], prog_name="foreswitch")
    assert result.exit_code == 0, result.output
    return result.output


def status_rows() -> Iterator[list[str]]:
    """Each run-time status with its number and its remedy."""
    for status in Status:
        yield [f"`{status.name}`", str(int(status)), status.remedy]


def hardware_rows() -> Iterator[list[str]]:
    """Each entry of `Hardware` as its docstring has it: name, shape, meaning."""
    parameters = inspect.getdoc(Hardware).split("----------\n")[1]  # type: ignore[union-attr]
    for name, kind, meaning in re.findall(r"^(\S[^:\n]*) : (.+)\n((?:    .+\n?)+)", parameters, flags=re.MULTILINE):
        yield [f"`{name.replace(', ', '`, `')}`", kind, " ".join(meaning.split())]


EXAMPLES_OF_STRUCTURES = {
    "integrator": "level of a tank",
    "integrator+lag": "valve into a tank: the paper's model",
    "integrator+pair": "the same with the flow's second order: what fits the paper's record better",
    "lag": "oven, room",
    "lag+lag": "oven with its sensor",
    "pair": "anything that swings",
    "order 2": "several inputs at different speeds",
}


def structure_rows() -> Iterator[list[str]]:
    """Each structure that "auto" compares: its transfer function without the dead time, its parameters."""
    for text in STRUCTURES:
        structure = Structure.parse(text)
        n, i = structure.states, structure.integrators
        if structure.order:
            below = "+".join([f"s^{n}", *(f"a_{k} s^{n - k}" for k in range(1, n)), f"a_{n}"])
            above = "+".join([*(f"b_{k} s^{n - k}" for k in range(1, n)), f"b_{n}"])
            gains = [f"b{k}" for k in range(1, n + 1)]
        else:
            power = {0: "", 1: "s", 2: "s^2"}[i]
            lags = [name[0] + (f"_{name[1:]}" if name[1:] else "") for name in structure.names if name[0] in "cT"]
            pairs = ["(s^2/\\omega^2 + 2\\zeta s/\\omega + 1)"] * structure.pairs
            factors = [*(f"({lag} s + 1)" for lag in lags), *pairs]
            below = power + ("".join(factors) if power or len(factors) > 1 else factors[0].strip("()"))
            above, gains = structure.gain, [structure.gain]
        below = below.replace("s^1", "s")
        formula = f"$\\frac{{{above.replace('s^1', 's')}}}{{{below}}}$"
        names = ", ".join(f"`{name}`" for name in [*structure.names, *gains])
        yield [f"`{text}`", formula, names, EXAMPLES_OF_STRUCTURES.get(text, "")]


def record_table() -> list[dict[str, Any]]:
    """What benchmarks/real_records.py found on measured records."""
    rows: list[dict[str, Any]] = json.loads((ROOT / "benchmarks" / "real_records.json").read_text())
    return rows


def record_rows() -> Iterator[list[str]]:
    """Errors on the stretch that no fit has seen, the best in bold."""
    for row in record_table():
        errors = [row[method]["predicted"] for method in ("identify", "FOPDT", "ARX")]
        cells = [f"**{error:.2f}**" if error == min(errors) else f"{error:.2f}" for error in errors]
        yield [
            row["name"], f"{row['fitted_until']} of {row['until']}", f"{row['swing']:.1f} {row['unit']}",
            row["identify"]["model"], *cells,
        ]  # fmt: skip


def record_values() -> dict[str, float]:
    """Figures of that table for the text."""
    rows = {row["name"]: row for row in record_table()}
    lamp = rows["lamp and plate"]
    best = {name: min(row[method]["predicted"] for method in ("FOPDT", "ARX")) for name, row in rows.items()}
    near = [name for name, row in rows.items() if row["identify"]["predicted"] <= 1.25 * best[name]]
    bottom, top = re.search(r"curve: ([\d.]+) per unit .* and ([\d.]+) at", lamp["curve"]).groups()  # type: ignore[union-attr]
    return {
        "records_near": len(near), "records_all": len(rows), "lamp_bottom": float(bottom), "lamp_top": float(top),
        "lamp_plain": lamp["FOPDT"]["predicted"],
        "lamp_square": rows["lamp, drive squared"]["FOPDT"]["predicted"],
    }  # fmt: skip


def target_rows() -> Iterator[list[str]]:
    """What benchmarks/targets_counts.py counted, a limit behind a slash."""
    found = json.loads((ROOT / "src" / "foreswitch" / "export" / "templates" / "counted.json").read_text())
    limits = {tuple(key.split("; ")): limit for key, limit in found["limits"].items()}
    for problem, processors in found["counts"].items():
        for name, counts in processors.items():
            cells = []
            for key in ("mean", "usable", "worst", "stack", "state", "memory", "flash"):
                limit = limits.get((problem, name, key))
                cells.append(f"{counts[key]}" + (f" / {limit}" if limit else "") if key in counts else "")
            yield [problem, name, cells[0] or cells[1], *cells[2:]]


CLAIMS = ROOT / "docs" / "theory" / "claims"


def claim_rows() -> Iterator[list[str]]:
    """Kind, what the paper says, what is found here, the figure, the script."""
    kinds = ("confirmed", "corrected", "completed")
    scripts = sorted(CLAIMS.glob("*.py"))
    claims = [(runpy.run_path(str(script)), script.name) for script in scripts]
    for claim, name in sorted(claims, key=lambda each: kinds.index(each[0]["KIND"])):
        yield [claim["KIND"], claim["PAPER"], claim["HERE"], claim["check"](), f"`docs/theory/claims/{name}`"]


def precision_rows() -> Iterator[list[str]]:
    """Every example, and the paper's task with preview, under both cores."""
    tasks = [(example.name, {}) for example in examples()]
    for name, changes in [tasks[0], ("hot_gas", {"preview": "lag"}), *tasks[1:]]:
        project = Project.read(ROOT / "examples" / name / "project.toml").with_seed(0)
        law = project.build_controller(**changes)
        settings = project.simulation_settings()
        found = compare_precision(law, project.reference, settings.pop("duration"), **settings)
        if name == "hot_gas":
            assert not found.commands_differing, "the paper's task is no longer the same in single precision"
        rms = [report.number(total_rms(run)) for run in (found.double, found.single)]
        yield [
            name.replace("_", " ") + (", preview" if changes else ""), str(found.decisions), str(len(found.gaps)),
            f"{found.gaps.max():.2g}" if len(found.gaps) else "", str(found.commands_differing), *rms,
        ]  # fmt: skip


def section_page(section: report.Section) -> str:
    """A section of the report without its heading."""
    parts = list(section.text)
    for table in section.tables:
        parts += [markdown_table(table.heads, table.rows)] + ([f"*{table.caption}*"] if table.caption else [])
    for picture in section.pictures:
        parts.append(
            f"```{{figure}} /_generated/demo/{picture.name}.svg\n:alt: {picture.caption}\n\n{picture.caption}\n```"
        )
    return "\n\n".join(parts) + "\n"
