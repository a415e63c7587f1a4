"""What the pages take from the code: tables, help texts, pictures. Needs foreswitch only, no Sphinx."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np
from pydantic_core import PydanticUndefined
from typer.testing import CliRunner

import comparisons
import figures
import horizons
from foreswitch import Hardware, Status, compare_precision
from foreswitch.cli import app
from foreswitch.demo.hot_gas import Demo, hot_gas_file, run_demo
from foreswitch.export.firmware import firmware_figures
from foreswitch.identification.structures import STRUCTURES, Structure
from foreswitch.presentation import report
from foreswitch.project.project import Project
from foreswitch.project.tables import TABLES as EVERY, Choice, PlantTable

ROOT = Path(__file__).resolve().parent.parent

#: Each form of table once: the plants of [simulation] have the keys of [plant].
TABLES = {name: table for name, table in EVERY.items() if name == "plant" or table is not PlantTable}
WORDS = {float: "number", int: "whole number", str: "text", bool: "true, false"}
WORDS |= dict.fromkeys(TABLES.values(), "table")


# Markdown ------------------------------------------------------------------------------------------------------------


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A pipe table."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"

    return "\n".join([line(heads), line(["---"] * len(heads)), *map(line, rows)]) + "\n"


# Project file --------------------------------------------------------------------------------------------------------


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


# Command line --------------------------------------------------------------------------------------------------------


def verbs() -> list[str]:
    """Every verb of the command line."""
    return [command.callback.__name__ for command in app.app.registered_commands if command.callback]


def help_text(verb: str) -> str:
    """What ``foreswitch VERB --help`` prints."""
    result = CliRunner().invoke(app.app, [verb, "--help"], prog_name="foreswitch")
    assert result.exit_code == 0, result.output
    return result.output


# Statuses ------------------------------------------------------------------------------------------------------------


def status_rows() -> Iterator[list[str]]:
    """Each run-time status with its number and its remedy."""
    for status in Status:
        yield [f"`{status.name}`", str(int(status)), status.remedy]


# Hardware ------------------------------------------------------------------------------------------------------------


def hardware_rows() -> Iterator[list[str]]:
    """Each entry of `Hardware` as its docstring has it: name, shape, meaning."""
    parameters = inspect.getdoc(Hardware).split("----------\n")[1]  # type: ignore[union-attr]
    for name, kind, meaning in re.findall(r"^(\S[^:\n]*) : (.+)\n((?:    .+\n?)+)", parameters, flags=re.MULTILINE):
        yield [f"`{name.replace(', ', '`, `')}`", kind, " ".join(meaning.split())]


# Identification ------------------------------------------------------------------------------------------------------

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
    rows: list[dict[str, Any]] = json.loads((ROOT / "docs" / "real_records.json").read_text())
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


def record_values() -> dict[str, str]:
    """Figures of that table for the text."""
    rows = {row["name"]: row for row in record_table()}
    lamp = rows["lamp and plate"]
    best = {name: min(row[method]["predicted"] for method in ("FOPDT", "ARX")) for name, row in rows.items()}
    near = [name for name, row in rows.items() if row["identify"]["predicted"] <= 1.25 * best[name]]
    bottom, top = re.search(r"curve: ([\d.]+) per unit .* and ([\d.]+) at", lamp["curve"]).groups()  # type: ignore[union-attr]
    return {
        "records_near": str(len(near)), "records_all": str(len(rows)), "lamp_bottom": bottom, "lamp_top": top,
        "lamp_plain": f"{lamp['FOPDT']['predicted']:.2f}",
        "lamp_square": f"{rows['lamp, drive squared']['FOPDT']['predicted']:.2f}",
    }  # fmt: skip


# Targets --------------------------------------------------------------------------------------------------------------


def target_rows() -> Iterator[list[str]]:
    """What benchmarks/targets_counts.py counted, a limit behind a slash."""
    found = json.loads((ROOT / "src" / "foreswitch" / "firmware" / "counted.json").read_text())
    limits = {tuple(key.split("; ")): limit for key, limit in found["limits"].items()}
    for problem, processors in found["counts"].items():
        for name, counts in processors.items():
            cells = []
            for key in ("mean", "usable", "worst", "stack", "state", "memory", "flash"):
                limit = limits.get((problem, name, key))
                cells.append(f"{counts[key]}" + (f" / {limit}" if limit else "") if key in counts else "")
            yield [problem, name, cells[0] or cells[1], *cells[2:]]


# The paper's claims --------------------------------------------------------------------------------------------------


def claim_rows() -> Iterator[list[str]]:
    """Kind, what the paper says, what is found here, the figure, the script."""
    kinds = ("confirmed", "corrected", "completed")
    scripts = sorted((ROOT / "docs" / "claims").glob("*.py"))
    claims = [(runpy.run_path(str(script)), script.name) for script in scripts]
    for claim, name in sorted(claims, key=lambda each: kinds.index(each[0]["KIND"])):
        yield [claim["KIND"], claim["PAPER"], claim["HERE"], claim["check"](), f"`docs/claims/{name}`"]


# Single precision ----------------------------------------------------------------------------------------------------


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
        rms = [report.number(comparisons.total_rms(run)) for run in (found.double, found.single)]
        yield [
            name.replace("_", " ") + (", preview" if changes else ""), str(found.decisions), str(len(found.gaps)),
            f"{found.gaps.max():.2g}" if len(found.gaps) else "", str(found.commands_differing), *rms,
        ]  # fmt: skip


# Demo ----------------------------------------------------------------------------------------------------------------


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


def core_values() -> dict[str, str]:
    """What a step of the demo's controller costs, by the sum that core/foreswitch.h gives."""
    law = Project.read(hot_gas_file()).controller
    n, m, q, p = law.plant.states, law.plant.inputs, law.plant.outputs, law.plant.disturbances
    candidates = len(law.decide(np.zeros(n), 0.0).candidates)
    pending = sum(math.ceil(tau / law.Ts - 1e-9) for tau in law.plant.input_delay)
    loads = 1
    single = firmware_figures(law.replace(real="float32"))
    return {
        "state_bytes": str(single["state_bytes"]),
        "multiply_adds": str(q * (n + p + law.order + pending + candidates * m) + m * q),
        "estimator_adds": str(n * (n + 2 * m + p + loads) + q * (2 * n + loads + q) + q * loads),
    }


def demo_values(demo: Demo) -> dict[str, str]:
    """Figures of the demo for the text."""

    def rms(runs: dict[str, Any], name: str) -> str:
        return report.number(runs[name].metrics()["rms_error"])

    tuned = {name: best.run for name, best in demo.tuned.items()}
    values = {}
    for name, short in (("predictive", "causal"), ("predictive, preview", "ahead"), ("dead time ignored", "ignored")):
        values[f"demo_{short}"] = rms(demo.tracking, name)
    for name, short in (("PI + PWM", "pi"), ("Smith predictor + PWM", "smith"), ("relay with hysteresis", "relay")):
        values[f"demo_{short}"] = rms(tuned, name)
    values["demo_relay_other"] = rms(demo.untuned, "relay with hysteresis")
    values["demo_causal_other"] = rms(demo.untuned, "predictive")
    return values | {"demo_lag": report.number(demo.tracking["predictive"].metrics()["lag"] * 1e3)}


# Laws compared -------------------------------------------------------------------------------------------------------


def comparison_page(tables: dict[str, dict[str, list[list[str]]]]) -> str:
    """Each example's comparison: picture and table."""
    parts = []
    for example in examples():
        name, table = example.name, tables[example.name]
        title = name.replace("_", " ").capitalize()
        caption = f"{title}: rms error against switching rate; large markers: as in the table."
        parts += [
            f"### {title}",
            f"```{{figure}} /_generated/compare/{name}.svg\n:alt: {caption}\n\n{caption}\n```",
            markdown_table(table["heads"], table["rows"]),
        ]
    return "\n\n".join(parts) + "\n"


BUYS_HEADS = [
    "law", "rms error at R", "at R/2", "at R/4", "time on at R [%]", "nodes, largest", "steps proven optimal, least [%]"
]  # fmt: skip


def buys_page(found: dict[str, dict[str, Any]]) -> str:
    """Each example's trade of error for switching over the horizon: picture and table."""
    parts = []
    for example in examples():
        name, content = example.name, found[example.name]
        title = name.replace("_", " ").capitalize()
        caption = (
            f"{title}: every run a dot; lines join the runs that no other run of the law beats in both. "
            f"R is {content['rate']:g} switches per second."
        )
        parts += [
            f"### {title}",
            f"```{{figure}} /_generated/compare/{name}_horizon.svg\n:alt: {caption}\n\n{caption}\n```",
            markdown_table(BUYS_HEADS, content["rows"]),
        ]
    return "\n\n".join(parts) + "\n"


def enough_rows(found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Each example: the shortest horizon that is nearly as good as the best."""
    return [
        [example.name.replace("_", " "), *(f"N = {N}" if N else "" for N in found[example.name]["enough"])]
        for example in examples()
    ]


# Gallery -------------------------------------------------------------------------------------------------------------


def examples() -> list[Path]:
    """Folders of examples with a script and a text; the paper's plant first."""
    found = [script.parent for script in (ROOT / "examples").glob("*/run.py") if (script.parent / "README.md").exists()]
    return sorted(found, key=lambda folder: (folder.name != "hot_gas", folder.name))


Values = dict[str, str]
Running = dict[str, tuple[Path, subprocess.Popen[str]]]


def started(commands: dict[str, tuple[Path, list[str]]]) -> Running:
    """Python scripts, each with a folder of its own that is made for it, all at once."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "error", "COLUMNS": "100"}
    running = {}
    for name, (out, command) in commands.items():
        out.mkdir(parents=True)
        process = subprocess.Popen([sys.executable, *command], env=environment, stdout=subprocess.PIPE, text=True)
        running[name] = out, process
    return running


def ended(running: Running) -> dict[str, str]:
    """What each of them printed."""
    printed = {}
    for name, (_, process) in running.items():
        printed[name], _ = process.communicate()
        if process.returncode:
            raise RuntimeError(f"{name} failed with exit code {process.returncode}")
    return printed


def run_examples(folder: Path) -> None:
    """Run every example into a folder of its own; what it prints goes beside its pictures."""
    folders = {example: folder / example.name for example in examples()}
    scripts = {str(each / "run.py"): (out, [str(each / "run.py"), str(out)]) for each, out in folders.items()}
    for printed, out in zip(ended(started(scripts)).values(), folders.values(), strict=True):
        (out / "printed.txt").write_text(printed)


def example_text(example: Path, out: Path) -> str:
    """An example's README as part of a page: headings one level down, pictures and files from where they are now."""

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        name = Path(target).name
        if picture:
            drawn = out / name
            vector = drawn.with_suffix(".svg")
            found = vector if vector.exists() else drawn
            if not found.exists():
                raise ValueError(f"{example.name}/README.md shows {target}, which run.py does not draw")
            return f"![{words}](/_generated/gallery/{example.name}/{found.name})"
        if target.startswith("../../docs/"):
            return f"[{words}]({target.removeprefix('../../docs/')})"
        if not target.startswith(("http", "#")) and (example / target).is_file():
            return f"{{download}}`{words.strip('`')} <../examples/{example.name}/{target}>`"
        return match[0]

    pieces = re.split(
        r"^(```.*?^```$)", (example / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    for i in range(0, len(pieces), 2):  # fenced blocks, at odd places, stay as they are
        deeper = re.sub(r"^#", "##", pieces[i], flags=re.MULTILINE)
        pieces[i] = re.sub(r"(!?)\[([^\]]*)\]\(([^)]+)\)", link, deeper)
    return "".join(pieces)


def gallery_page(folder: Path) -> str:
    """Each example: its text, what its script printed and drew, its files."""
    parts = []
    for example in examples():
        name, out = example.name, folder / example.name
        text = example_text(example, out)
        parts.append(text)
        drawn = sorted(out.glob("*.svg"), key=lambda path: (path.stem != "picture", path.stem))
        shown = [f"/_generated/gallery/{name}/{path.name}" for path in drawn]
        parts += [f"![{path.stem}]({where})" for path, where in zip(drawn, shown, strict=True) if where not in text]
        printed = (out / "printed.txt").read_text()
        if printed.strip() not in text:
            parts += [f"`examples/{name}/run.py` prints:", f"```text\n{printed}```"]
        files = sorted(path.name for path in example.iterdir() if path.suffix in (".toml", ".py", ".csv"))
        parts.append("Files: " + ", ".join(f"{{download}}`{each} <../examples/{name}/{each}>`" for each in files) + ".")
    return "\n\n".join(parts) + "\n"


# Pages that draw their own pictures ----------------------------------------------------------------------------------


def changed_pages(folder: Path, code: str) -> dict[Path, str]:
    """Those that draw and were not drawn yet as they are now, and what to note of them then."""
    notes = {page: fingerprint([page], code) for page in drawing_pages()}
    return {page: note for page, note in notes.items() if noted(folder, page) != note}


def place(folder: Path, page: Path) -> Path:
    """Where a page's pictures are."""
    return folder / page.relative_to(ROOT / "docs").with_suffix("")


def noted(folder: Path, page: Path) -> str:
    note = place(folder, page).with_suffix(".key")
    return note.read_text() if note.exists() else ""


def start_pages(folder: Path, pages: Iterable[Path]) -> Running:
    """The snippets of pages, each in a folder of its own."""
    for page in pages:
        shutil.rmtree(place(folder, page), ignore_errors=True)
    script = str(ROOT / "docs" / "snippets.py")
    return started({str(each): (out := place(folder, each), [script, str(each), str(out)]) for each in pages})


def drawing_pages() -> list[Path]:
    """Those that show what their snippets draw."""
    return [ROOT / "docs" / "tutorial.md", *sorted((ROOT / "docs" / "howto").glob("*.md"))]


# Numbers in the text --------------------------------------------------------------------------------------------------

#: Sentences of the pages, their numbers left open.
CLAIMS = {
    "theory.md": [
        "a model that says 5 ms leaves {round_down} kPa rms, one that says 6 ms {round_up} kPa, and the true one "
        "{round_exact} kPa",
        "is held at {zero_5} K with $T_d = 5$ s, at {zero_20} K with 20 s, at {zero_50} K with 50 s, and is stuck full "
        "on with 100 s ({zero_100} K)",
        "the oven's mean is within {rest_off} K of the set point",
        "the ripple is the {rest_ripple} K",
        "With the paper's numbers that is {lag_ms} ms, and {lag_measured_ms} ms is measured",
        "$T_u + T_d$, which would be {paper_lag_ms} ms",
        "the rms error is {preview_now} kPa without preview, {preview_lag} kPa with the lag, and {preview_instant} kPa "
        "at the evaluation instant",
        "{paper_lag_ms} ms for its plant | {lag_ms} ms, by",
    ],
    "baselines.md": [
        "It leaves {demo_pi} kPa, the Smith predictor {demo_smith} kPa; the predictive law leaves {demo_causal} kPa, "
        "nearly all of it the lag of {demo_lag} ms",
        "with {demo_ahead} kPa and nothing tuned",
        "the same law leaves {demo_ignored} kPa",
        "leaves {demo_relay} kPa however it is tuned",
        "with {demo_relay_other} against {demo_causal_other} kPa for the predictive law without preview",
        "PI + PWM leaves {pi_ahead} kPa and the Smith predictor {smith_ahead} kPa",
        "they leave {pi_ahead_other} and {smith_ahead_other} kPa and the predictive law {ahead_other} kPa",
        "it leaves {short_noisy} kPa, the paper's 20 ms leave {long_noisy} kPa; with a valve 1 ms later than the model "
        "says, {short_late} against {long_late} kPa",
    ],
    "estimation.md": [
        "to {estimated_outputs} kPa from the pressure alone, to {estimated_load} kPa with a load, against "
        "{estimated_full} kPa from a state",
        "Here they last {slowest_periods} periods (the load) and {other_periods} periods (the state)",
        "the offset is {leak_state_low} to {leak_state_high} kPa",
        "takes part of the leak for noise: {leak_outputs} kPa. With the load these runs leave at most {leak_load} kPa",
    ],
    "identification.md": [
        "these pulses tell it to {pulse_delay_error} ms",
        "One pulse is worth {pulse_worth} kPa",
        "is the best or within a quarter of it in {records_near} of {records_all} rows",
        'the plate "settles on a curve", {lamp_bottom} K per volt at the bottom and {lamp_top} K at the top',
        "the plain fit predicts to {lamp_square} instead of {lamp_plain} K",
    ],
    "experiment.md": [
        "settle for four takes {settled_cost} times as long",
        "the gain is known to {quiet_little} % without it, to {quiet_quarter} % with a quarter",
    ],
    "hardware.md": [
        "the rms error is {travel} kPa instead of {sound} kPa",
        "longer by the mean of both travel times, 0.75 ms, the law leaves {travel_told} kPa",
        "part of the dead time: told 1.5 ms more, the law above leaves {late_told} instead of {late} kPa",
    ],
    "certificate.md": [
        "For the paper's task they are {proof_bound} and {proof_resolution} kPa; the simulated distance is at most "
        "{proof_seen} kPa.",
        "For the paper's valve: {proof_inner} kPa while the ideal duty stays from {proof_low} to {proof_high}; with "
        "{proof_outer} kPa from 0 to 1",
    ],
    "batch.md": [
        "Noise alone leaves {batch_low} to {batch_high} kPa in nine runs of ten. With the spread of gains it is "
        "{spread_low} to {spread_high} kPa",
    ],
    "study.md": [
        "With the true gain the error is {study_true} kPa. A dead time 2 ms longer than the model's makes it {study_late} "
        "kPa, 2 ms shorter {study_early} kPa",
        "one in twenty is above {study_band_late} kPa and {study_band_early} kPa there",
    ],
    "compare.md": ["Budget here: {budget} runs for each baseline"],
    "horizon.md": [
        "the paper's law leaves {family_paper} kPa, the one-step law {family_one} kPa, ten periods {family_exact_10} kPa "
        "and twenty {family_exact_20} kPa",
        "the largest of {periods} steps took {family_exact_20_nodes} nodes where there are 1,048,576 sequences",
        "leaves {family_much} kPa at {family_much_switches} switches, the exact optimum {family_exact_much} kPa at "
        "{family_exact_much_switches}",
        "a weight of 10 on each move brings it to {family_little} kPa",
        "`Horizon(20, moves=2)` leaves {family_held} kPa",
        "leave {family_short_2} kPa at {family_short_2_switches} switches, and {family_riccati_2} kPa at "
        "{family_riccati_2_switches} with it",
        "trails by {blind_one_lag} ms with one period and by {blind_20_lag} ms with twenty: {blind_one} and {blind_20} "
        "kPa instead of {family_plain} and {family_exact_20} kPa",
        "the attitude example is off by {lost} degrees in the rms",
        "a budget of 100 nodes proves {budget_proven} % of the steps and leaves {budget_rms} kPa where the full search "
        "leaves {family_exact_much} kPa; even a budget of one node leaves {least_rms} kPa",
    ],
    "../README.md": ["({state_bytes} bytes for this controller in single precision)"],
    "c_api.md": [
        "demo's controller in single precision then needs {state_bytes} bytes",
        "{multiply_adds} for the demo's controller",
        "{estimator_adds} more for the demo's controller with one load",
    ],
}


#: The same for numbers that only the comparisons give, which take longer than a test should.
COMPARED = {
    "compare.md": ["firing for {attitude_step_on} % of the time instead of {attitude_law_on} %"],
    "horizon.md": [
        "At R all five leave {inverter_1_full} A. At half of it ten periods leave {inverter_10_half} A and one "
        "{inverter_1_half} A, at a quarter {inverter_10_quarter} A and {inverter_1_quarter} A",
        "at most {nodes} nodes; the last column",
        "is run at {prices} prices of a switch, from none upward, and at its own",
        "only {inverter_proven} % of the steps of twenty periods ended by themselves",
        "At R it leaves {oven_1_full} °C, twenty periods {oven_20_full} °C; at half of R {oven_1_half} °C and "
        "{oven_20_half} °C. Without a price it leaves {oven_step_rms} °C",
        "The endpoint law and twenty periods both leave {hot_gas_20_full} kPa at R, one step {hot_gas_1_full} kPa. At half "
        "of R twenty periods leave {hot_gas_20_half} kPa, the endpoint law {hot_gas_endpoint_half} kPa, one step "
        "{hot_gas_1_half} kPa. At a quarter it is five periods and the endpoint law, {hot_gas_5_quarter} kPa and "
        "{hot_gas_endpoint_quarter} kPa; twenty leave {hot_gas_20_quarter} kPa",
        "At R five periods leave {chamber_5_full} kPa, the endpoint law {chamber_endpoint_full} kPa and one step "
        "{chamber_1_full} kPa; at half of R ten periods leave {chamber_10_half} kPa, the endpoint law "
        "{chamber_endpoint_half} kPa, one step {chamber_1_half} kPa",
        "At R twenty periods leave {attitude_20_full} deg and fire for {attitude_20_share} % of the time, the endpoint law "
        "leaves {attitude_endpoint_full} deg at {attitude_endpoint_share} %, one step {attitude_1_full} deg at "
        "{attitude_1_share} %",
    ],
}


def false_claims(values: dict[str, str], claims: dict[str, list[str]] = CLAIMS) -> list[str]:
    """Sentences that a page ought to hold with the numbers just computed, and does not."""
    false = []
    for page, sentences in claims.items():
        text = " ".join((ROOT / "docs" / page).read_text(encoding="utf-8").split())
        false += [f"{page}: {claim}" for claim in (each.format_map(values) for each in sentences) if claim not in text]
    return false


# All -----------------------------------------------------------------------------------------------------------------


def computed(folder: Path) -> Values:
    """Write everything that the pages take from the code into the empty folder; the numbers for the text."""
    (folder / "gallery").mkdir()
    compared = comparisons.start(folder / "compare")
    (folder / "keys.md").write_text(markdown_table(["key", "value", "default", "meaning"], key_rows()))
    (folder / "choices.md").write_text(markdown_table(["choice", "needs", "may have"], choice_rows()))
    heads = ["", "the paper", "here", "figure", "script"]
    (folder / "claims.md").write_text(markdown_table(heads, claim_rows()))
    (folder / "status.md").write_text(markdown_table(["status", "value", "what it says"], status_rows()))
    (folder / "hardware_entries.md").write_text(markdown_table(["entry", "shape", "what it does"], hardware_rows()))
    heads = ["fault", "status, periods of 600", "rms error [kPa]", "what to do"]
    (folder / "faults.md").write_text(markdown_table(heads, figures.fault_rows()))
    heads = ["structure", "transfer function, without dead time", "parameters", "for example"]
    (folder / "structures.md").write_text(markdown_table(heads, structure_rows()))
    heads = ["record", "fitted [s]", "range of the rest", "chosen", "`identify` [K]", "plain [K]", "ARX [K]"]
    (folder / "real_records.md").write_text(markdown_table(heads, record_rows()))
    heads = ["controller", "processor", "typical step", "dearest step", "stack", "state", "memory", "flash"]
    (folder / "targets.md").write_text(markdown_table(heads, target_rows()))
    heads = ["measured", "gain -20 %", "gain as modelled", "gain +20 %"]
    (folder / "leak.md").write_text(markdown_table(heads, figures.leak_rows()))
    heads = ["example", "decisions", "differ", "largest gap", "commands differ in closed loop", "rms error, float64",
             "rms error, float32"]  # fmt: skip
    (folder / "precision.md").write_text(markdown_table(heads, precision_rows()))
    for verb in verbs():
        (folder / f"help_{verb}.txt").write_text(help_text(verb))
    run_examples(folder / "gallery")
    (folder / "gallery.md").write_text(gallery_page(folder / "gallery"))
    demo = run_demo()
    (folder / "demo").mkdir()
    demo.report.write(folder / "demo")
    for section in demo.report.sections:
        (folder / f"demo_{section.pictures[0].name}.md").write_text(section_page(section))
    values = figures.draw(folder) | demo_values(demo) | core_values()
    values |= {"budget": str(comparisons.BUDGET), "prices": str(len(comparisons.PRICES))}
    rows, of_family = horizons.family()
    (folder / "family.md").write_text(markdown_table(horizons.HEADS, rows))
    tables, bought, found = comparisons.collect(compared, folder / "compare")
    values |= of_family | found | comparisons.printed()
    (folder / "buys.md").write_text(buys_page(bought))
    heads = ["example", "at R", "at R/2", "at R/4"]
    (folder / "enough.md").write_text(markdown_table(heads, enough_rows(bought)))
    heads = ["", "where", "shown by"]
    (folder / "decision_table.md").write_text(markdown_table(heads, comparisons.decision_rows(values)))
    (folder / "comparisons.md").write_text(comparison_page(tables))
    return values | {"nodes": f"{comparisons.NODE_BUDGET:,}".replace(",", " ")}


def build(folder: Path) -> None:
    """Everything that the pages take from the code, into the folder; what is there of the same code is kept."""
    code = fingerprint(sources())
    record = folder / "values.json"
    kept = json.loads(record.read_text()) if record.exists() else {}
    if kept.get("code") != code:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    pages = changed_pages(folder, code)
    running = start_pages(folder, pages)
    if kept.get("code") != code:
        kept = {"code": code, "values": computed(folder)}
        record.write_text(json.dumps(kept))
    ended(running)
    for page, note in pages.items():
        place(folder, page).with_suffix(".key").write_text(note)
    values = kept["values"] | record_values()
    if false := false_claims(values) + false_claims(values, COMPARED):
        raise ValueError("the text no longer says what is computed; it should read: " + "; ".join(false))


def sources() -> list[Path]:
    """All files that what is computed depends on; the pages are looked at one by one."""
    patterns = ("src/**/*", "core/**/*", "examples/**/*", "docs/*.py", "docs/claims/*.py", "docs/*.json",
                "benchmarks/*.json", "constraints.txt")  # fmt: skip
    found = (path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file())
    return sorted(
        path for path in found if not {"__pycache__", "page"} & {*path.parts}
    )  # the tuning page computes nothing


def fingerprint(files: Iterable[Path], start: str = "") -> str:
    """Of names and contents."""
    found = hashlib.sha256(start.encode())
    for file in files:
        found.update(f"{file.relative_to(ROOT)}\n".encode() + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()
