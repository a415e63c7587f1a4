"""What the pages take from the code: tables, help texts, pictures, numbers. Needs foreswitch only, no Sphinx."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import comparisons
import decisions
import figures
import horizons
import marks
import tables
import trade
from drawn import changed_pages, fingerprint, place, start_pages
from figures.estimation import leak_rows
from figures.hardware import fault_rows
from foreswitch.demo.hot_gas import Demo, hot_gas_file, run_demo
from foreswitch.export.firmware import firmware_figures
from foreswitch.project import Project
from gallery import gallery_page, run_examples
from processes import ended
from tables import markdown_table

ROOT = Path(__file__).resolve().parents[2]

Values = dict[str, float]

#: File, headings and rows of every table that needs nothing else computed.
TABLES: dict[str, tuple[list[str], Callable[[], Any]]] = {
    "keys": (["key", "value", "default", "meaning"], tables.key_rows),
    "choices": (["choice", "needs", "may have"], tables.choice_rows),
    "claims": (["", "the paper", "here", "figure", "script"], tables.claim_rows),
    "status": (["status", "value", "what it says"], tables.status_rows),
    "hardware_entries": (["entry", "shape", "what it does"], tables.hardware_rows),
    "faults": (["fault", "status, periods of 600", "rms error [kPa]", "what to do"], fault_rows),
    "structures": (["structure", "transfer function, without dead time", "parameters", "for example"],
                   tables.structure_rows),
    "real_records": (["record", "fitted [s]", "range of the rest", "chosen", "`identify` [K]", "plain [K]", "ARX [K]"],
                     tables.record_rows),
    "targets": (["controller", "processor", "typical step", "dearest step", "stack", "state", "memory", "flash"],
                tables.target_rows),
    "leak": (["measured", "gain -20 %", "gain as modelled", "gain +20 %"], leak_rows),
    "precision": (["example", "decisions", "differ", "largest gap", "commands differ in closed loop",
                   "rms error, float64", "rms error, float32"], tables.precision_rows),
}  # fmt: skip


# Numbers for the text -------------------------------------------------------------------------------------------------


def core_values() -> Values:
    """What a step of the demo's controller costs, by the sum that core/foreswitch.h gives."""
    law = Project.read(hot_gas_file()).controller
    n, m, q, p = law.plant.states, law.plant.inputs, law.plant.outputs, law.plant.disturbances
    candidates = len(law.decide(np.zeros(n), 0.0).candidates)
    pending = sum(math.ceil(tau / law.Ts - 1e-9) for tau in law.plant.input_delay)
    loads = 1
    single = firmware_figures(law.replace(real="float32"))
    return {
        "state_bytes": single["state_bytes"],
        "multiply_adds": q * (n + p + law.order + pending + candidates * m) + m * q,
        "estimator_adds": n * (n + 2 * m + p + loads) + q * (2 * n + loads + q) + q * loads,
    }


def demo_values(demo: Demo) -> Values:
    """Figures of the demo."""
    tuned = {name: best.run for name, best in demo.tuned.items()}
    runs = {
        "causal": demo.tracking["predictive"], "ahead": demo.tracking["predictive, preview"],
        "ignored": demo.tracking["dead time ignored"], "pi": tuned["PI + PWM"], "smith": tuned["Smith predictor + PWM"],
        "relay": tuned["relay with hysteresis"], "relay_other": demo.untuned["relay with hysteresis"],
        "causal_other": demo.untuned["predictive"],
    }  # fmt: skip
    values = {f"demo_{name}": run.metrics()["rms_error"] for name, run in runs.items()}
    return values | {"demo_lag": 1e3 * runs["causal"].metrics()["lag"]}


def soon(folder: Path, demo: Demo) -> tuple[Values, set[str]]:
    """Every number but those of the comparisons, which take longer than a test should; the names that the text must show.

    Pictures go into the folder, and the table of the family of laws.
    """
    own = figures.draw(folder) | demo_values(demo) | core_values() | tables.record_values()
    rows, of_family = horizons.family()
    (folder / "family.md").write_text(markdown_table(horizons.HEADS, rows))
    return own | of_family, {*own, *horizons.QUOTED}


# All ------------------------------------------------------------------------------------------------------------------


def computed(folder: Path) -> tuple[Values, list[str]]:
    """Write everything that the pages take from the code into the empty folder; the numbers, and those to be shown."""
    (folder / "gallery").mkdir()
    compared = comparisons.start(folder / "compare")
    for name, (heads, rows) in TABLES.items():
        (folder / f"{name}.md").write_text(markdown_table(heads, rows()))
    for verb in tables.verbs():
        (folder / f"help_{verb}.txt").write_text(tables.help_text(verb))
    run_examples(folder / "gallery")
    (folder / "gallery.md").write_text(gallery_page(folder / "gallery"))
    demo = run_demo()
    (folder / "demo").mkdir()
    demo.report.write(folder / "demo")
    for section in demo.report.sections:
        (folder / f"demo_{section.pictures[0].name}.md").write_text(tables.section_page(section))
    values, wanted = soon(folder, demo)
    found = comparisons.collect(compared, folder / "compare")
    late = comparisons.values(found)
    (folder / "buys.md").write_text(trade.buys_page(found))
    (folder / "enough.md").write_text(markdown_table(trade.ENOUGH_HEADS, trade.enough_rows(found)))
    (folder / "decision_table.md").write_text(markdown_table(decisions.HEADS, decisions.decision_rows(late)))
    (folder / "comparisons.md").write_text(comparisons.comparison_page(found))
    return values | late, sorted(wanted.union(comparisons.QUOTED))


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
        values, wanted = computed(folder)
        kept = {"code": code, "values": values, "wanted": wanted}
        record.write_text(json.dumps(kept))
    ended(running)
    for page, note in pages.items():
        place(folder, page).with_suffix(".key").write_text(note)
    faults = marks.faults(marked(), kept["values"], kept["wanted"])
    if faults := faults + [fault for page in marks.pages() for fault in marks.bare(page)]:
        raise ValueError("the text no longer says what is computed:\n" + "\n".join(faults))


def marked() -> list[marks.Mark]:
    """Every mark in the text."""
    return [mark for page in marks.pages() for mark in marks.marks(page)]


def sources() -> list[Path]:
    """All files that what is computed depends on; the pages are looked at one by one."""
    patterns = ("src/**/*", "core/**/*", "examples/**/*", "docs/_tools/**/*.py", "docs/theory/claims/*.py",
                "benchmarks/*.json", "constraints.txt")  # fmt: skip
    found = (path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file())
    return sorted(
        path for path in found if not {"__pycache__", "page"} & {*path.parts}
    )  # the tuning page computes nothing
