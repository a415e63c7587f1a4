"""Firmware: a controller as a folder of C, with the steps that were simulated to test it by."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from foreswitch._binding import REALS
from foreswitch._helpers.files import whole_folder
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.controller import Controller
from foreswitch.control.design import Design
from foreswitch.export.header import exported, initialiser, limits, limits_text, number, tables_text
from foreswitch.export.vectors import Golden, golden_steps

__all__ = ["export_c", "firmware_figures"]

CORE = ["foreswitch.h", "arithmetic.h", "foreswitch.c"]
HORIZON = ["horizon.h", "horizon.c"]
TEMPLATES = ["foreswitch_design.h", "example.c", "selftest.c", "Makefile", "CMakeLists.txt", "library.properties",
             "library.json", "README.md"]  # fmt: skip
#: Names that C and C++ have taken, and functions that compilers know without a header.
TAKEN = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while main state
bool catch class delete explicit export false friend mutable namespace new operator private protected public template this
throw true try typename using virtual and or not xor asm setup loop abort abs acos asin atan calloc ceil cos cosh erf exit
exp fabs floor fmod free gamma index isnan j0 j1 jn labs log malloc memcmp memset pow printf putchar puts realloc remainder
rint round signal sin sinh sqrt strlen tan tanh time trunc y0 y1 yn EOF NULL"""
#: Of an FMU, besides the core.
SHELL = ["fmi2.h", "fmi.c"]


def export_c(controller: Controller, folder: str | Path, *, name: str = "controller") -> None:
    """Write a controller as firmware: core, design, self-test, example, builds.

    Parameters
    ----------
    controller : Controller
        Its design is exported, in its arithmetic; ``controller.replace(real="float32")`` gives the other.
    folder : str or Path
        Made if missing. Files of the same name are replaced, others left alone; written whole or not at all.
    name : str
        What the design is called in C.

    Raises
    ------
    ValueError
        If the name is not a C identifier, or the folder cannot be made.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from foreswitch import Controller, Endpoint, Plant
    >>> valve = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    >>> law = Controller(valve, [0, 1], 1e-3, Endpoint(Td=0.020, lam=2500.0), real="float32")
    >>> folder = Path(tempfile.mkdtemp()) / "firmware"
    >>> export_c(law, folder)
    >>> sorted(path.name for path in folder.iterdir() if path.suffix in (".c", ".h"))
    ['arithmetic.h', 'example.c', 'foreswitch.c', 'foreswitch.h', 'foreswitch_design.h', 'selftest.c']
    """
    check_export(controller, name)
    design = exported(controller.design)
    golden = golden_steps(controller)
    words = _words(controller, design, golden, name)
    own = files("foreswitch.export")
    core = CORE + (HORIZON if design.horizon is not None else [])
    with whole_folder(folder) as work:
        for file in core:
            (work / file).write_bytes(own.joinpath("c", file).read_bytes())
        (work / "LICENSE").write_bytes(own.joinpath("c", "LICENSE").read_bytes())
        for file in TEMPLATES:
            _write(work / file, own.joinpath("templates", file).read_text(encoding="utf-8"), words)
        sketch = work / "examples" / name / f"{name}.ino"
        sketch.parent.mkdir(parents=True)
        _write(sketch, own.joinpath("templates", "sketch.ino").read_text(encoding="utf-8"), words)


def check_export(controller: Controller, name: str) -> None:
    """Whether there is something to export, under a name that C allows."""
    if not isinstance(controller, Controller):
        problem = f"is a {type(controller).__name__}"
        raise Mistake("controller", controller, "give a Controller, baselines have no firmware", problem=problem)
    if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name, flags=re.ASCII) or name.startswith("fsw"):
        raise Mistake("name", name, "give a C identifier that does not begin with fsw")
    if name in TAKEN.split() or name in _identifiers():
        problem = f"is {name!r}, which the C sources use themselves"
        raise Mistake("name", name, f"give another, say {name + '_control'!r}", problem=problem)


@cache
def _identifiers() -> frozenset[str]:
    """Identifiers of all C that is shipped: where a local had the design's name, the local would be meant."""
    own = files("foreswitch.export")
    found: set[str] = set()
    sources = [own.joinpath("c", file) for file in [*CORE, *HORIZON, *SHELL]]
    for source in [*sources, *(own.joinpath("templates", file) for file in TEMPLATES if file.endswith((".c", ".h")))]:
        text = re.sub(r"/\*.*?\*/|\"[^\"\n]*\"", " ", source.read_text(encoding="utf-8"), flags=re.DOTALL)
        found.update(re.findall(r"[A-Za-z_]\w*", re.sub(r"@\w+@", " ", text)))
    return frozenset(found)


def filled(template: str, words: dict[str, str]) -> str:
    """A template with its @words@."""
    return re.sub(r"@(\w+)@", lambda hit: words[hit[1]], template)


def _write(path: Path, template: str, words: dict[str, str]) -> None:
    path.write_text(filled(template, words), encoding="utf-8", newline="\n")


# Figures --------------------------------------------------------------------------------------------------------------


def firmware_figures(controller: Controller) -> dict[str, Any]:
    """Figures of a design that follow from it exactly.

    Parameters
    ----------
    controller : Controller

    Returns
    -------
    dict
        ``state_bytes`` where numbers are aligned (32 and 64 bits) and ``state_bytes_avr`` where they are not,
        ``table_bytes`` of constants without the structures that point to them, and ``multiply_adds`` of a step with a
        usable measurement; of a horizon, those before the search.
    """
    design = exported(controller.design)
    return {
        "state_bytes": state_bytes(design),
        "state_bytes_avr": state_bytes(design, packed=True),
        "table_bytes": design.table_bytes + (design.horizon.table_bytes if design.horizon else 0),
        "multiply_adds": _multiply_adds(design),
    }


def _multiply_adds(design: Design) -> int:
    """As docs/reference/c_api.md counts them."""
    n, m, q, p = design.states, design.inputs, design.outputs, design.disturbances
    loads, z, h = design.loads, design.measured, design.horizon
    under_way = int(design.pending.sum())
    rests = design.rest_reference is not None
    work = m * (q + p) if rests else 0
    if design.gain is not None:
        work += n * (n + 2 * m + p) + z * (n + z * (design.gate is not None)) + (n + loads) * z
    if h is None:
        return work + q * (n + p + design.order + under_way + design.candidates * m + (m if rests else 0))
    N, K, size = h.steps, h.moves, h.states
    work += size * (n + p + under_way) + N * (size * size + q * (size + design.order)) + (N - K) * size * (size + q)
    return work + K * (size * (q + m + size) + m * (m + size))


def state_bytes(design: Design, packed: bool = False) -> int:
    """sizeof(fsw_state), its members as in core/foreswitch.h; `packed`: nothing is aligned, as on an AVR."""
    return _state(design, packed).itemsize


def _state(design: Design, packed: bool) -> np.dtype[Any]:
    """fsw_state as NumPy lays it out; a union is as large as its largest member, at the strictest alignment."""
    most, h, real = limits(design), design.horizon, np.dtype(REALS[design.real])
    n, m, q, p = (most[f"FSW_MAX_{key}"] for key in ("STATES", "INPUTS", "OUTPUTS", "DISTURBANCES"))

    def struct(*members: tuple[str, Any, Any]) -> np.dtype[Any]:
        return np.dtype(list(members), align=not packed)

    head = [("x", real, n), ("w", real, p), ("wait", "u4", m), ("bad_total", "u4", 1), ("head", "u2", 1),
            ("bad", "u2", 1), ("primed", "u1", 1), ("outliers", "u1", 1)]  # fmt: skip
    line = ("line", "u1", most["FSW_MAX_LINE"])
    if h is None:
        return struct(*head, line)
    N, K, size, C = h.steps, h.moves, h.states, h.candidates
    records, span = most.get("FSW_RECORDS", 16), size + m
    record = struct(("bound", real, 1), ("at", real, span), ("wait", "u2", m), ("from", "u1", 1))
    visited = [("visits", "u1", K), ("record", record, K * records)] if records else []
    tree = struct(("x", real, K * size), ("bound", real, K * C), ("child", "u1", K * C), ("next", "u1", K),
                  ("count", "u1", K), ("path", "u1", K), ("wait", "u2", K * m), *visited)  # fmt: skip
    hull = struct(("row", real, K * m * (span + m)), ("slope", real, K * m), ("pinned", "i1", K * m))
    align = 1 if packed else max(tree.alignment, hull.alignment)
    whole = -(-max(tree.itemsize, hull.itemsize) // align)
    union = struct(("u", real if align > 1 else "u1", whole * align // (real.itemsize if align > 1 else 1)))
    scratch = struct(("target", real, K * m), ("penalty", real, K * C), ("error", real, N * q), ("last", real, span),
                     ("end", real, size), ("aim", real, size), ("priced", "u1", 1), ("union", union, 1),
                     ("best", "u1", K))  # fmt: skip
    return struct(*head, ("planned", "u1", 1), ("plan", "u1", K), line, ("scratch", scratch, 1))


# Words for the templates ----------------------------------------------------------------------------------------------


def _words(controller: Controller, design: Design, golden: Golden, name: str) -> dict[str, str]:
    plant = controller.plant
    core = CORE + (HORIZON if design.horizon is not None else [])
    sources = [file for file in core if file.endswith(".c")]
    figures = firmware_figures(controller)
    outputs = ", ".join(plant.output_names)
    horizon = design.horizon is not None
    work = f"{figures['multiply_adds']} multiply-adds"
    if horizon:
        work += ", then the search: a few dozen for each node"
    return {
        "name": name,
        "title": headline(controller, name),
        "title_json": json.dumps(f"{headline(controller, name)}."),
        "version": version("foreswitch"),
        "limits": limits_text(design, name),
        "tables": tables_text(design, name),
        "rows": str(len(golden)),
        "measured": str(design.measured),
        "reference": str(golden.reference.shape[1]),
        "disturbances": str(max(plant.disturbances, 1)),
        "inputs": str(design.inputs),
        "steps": ",\n".join(_row(golden, k) for k in range(len(golden))),
        "last_x": initialiser(golden.state),
        "last_w": initialiser(golden.disturbances),
        "period": f"{controller.Ts:g} s",
        **_ticks(controller.Ts),
        "sources": " ".join(sources),
        "sources_listed": " and ".join(f"`{file}`" for file in sources),
        "core_files": "`, `".join(core),
        "more_headers": " horizon.h" if horizon else "",
        "source_filter": ", ".join(f'"+<{file}>"' for file in sources),
        "what_is_measured": "the state" if controller.estimator is None else outputs,
        "what_is_wanted": outputs,
        "what_is_commanded": ", ".join(plant.input_names),
        "shapes": _shapes(controller, design),
        "state": f"{figures['state_bytes']} bytes"
        + (f", {figures['state_bytes_avr']} on an AVR" if controller.real == "float32" else "; an AVR needs float32"),
        "table_bytes": str(figures["table_bytes"]),
        "work": work,
        "reference_work": "11 multiply-adds" if not horizon else "two levels and 5 or 10 moves",
        "counted": _counted(horizon),
        "recorded_nodes": f"at most {golden.nodes.max()} {'nodes' if horizon else 'candidates'} evaluated",
    }


def _ticks(Ts: float) -> dict[str, str]:
    """A period by an Arduino's clock; its microseconds last for an hour."""
    clock, unit = ("micros", 1e-6) if Ts < 2000.0 else ("millis", 1e-3)
    count = max(round(Ts / unit), 1)
    off = abs(count * unit / Ts - 1.0)
    note = f" // {100.0 * off:.2g} % off: a timer can be closer" if off > 1e-6 else ""
    return {"clock": clock, "ticks": str(count), "rounded": note}


def _counted(horizon: bool) -> str:
    """What was counted on the designs of a kind, as a table."""
    found = json.loads(files("foreswitch.export").joinpath("templates", "counted.json").read_text(encoding="utf-8"))[
        "counts"
    ]
    lines = ["| | processor | step | step with a bad sample | stack | flash |", "|---|---|---|---|---|---|"]
    for problem, processors in found.items():
        if problem.startswith("hot gas" if horizon else "paper"):
            for name, counts in processors.items():
                usable, worst = counts.get("usable", counts["worst"]), counts["worst"] if "usable" in counts else ""
                cells = [problem, name, usable, worst, counts.get("stack", ""), counts.get("flash", "")]
                lines.append(f"| {' | '.join(str(cell) for cell in cells)} |")
    return "\n".join(lines)


def headline(controller: Controller, name: str) -> str:
    """What is controlled by what, for a comment in C."""
    outputs, inputs = (", ".join(names) for names in (controller.plant.output_names, controller.plant.input_names))
    return f"{name}: {_one_line(outputs)} by {_one_line(inputs)}, every {controller.Ts:g} s"


def _one_line(text: str) -> str:
    """For a comment in C, which neither ends in it nor begins anew."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(re.sub(r"(?<=\*)/|(?<=/)\*", " ", text).split())


def _row(golden: Golden, k: int) -> str:
    """One row of fsw_rows; numbers of nothing are a zero."""
    values = [initialiser(a[k], 8) for a in (golden.measured, golden.reference, golden.disturbance, golden.command)]
    return f"    {{{', '.join(values)}, {number(golden.status[k])}, {number(golden.cost[k])}}}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + "s" * (number != 1)


def _shapes(controller: Controller, design: Design) -> str:
    """What goes in and what comes out, in words."""
    plant = controller.plant
    what = ", ".join(plant.output_names) if controller.estimator else f"the {plant.states} states of the model"
    times = [f"{1e3 * t:.4g}" for t in dict.fromkeys(controller.reference_times.ravel().tolist())]
    when = (
        "now"
        if times == ["0"]
        else ", ".join(times if len(times) < 5 else [*times[:2], "...", times[-1]]) + " ms ahead"
    )
    each = _count(design.order - 1, "derivative")
    lines = [
        f"- `x[{design.measured}]`: {what}, measured now.",
        f"- `reference`, [instant][output][derivative]: {_count(controller.evaluations, 'instant')} ({when}), "
        f"{_count(plant.outputs, 'output')}, the value{f' and {each}' if design.order > 1 else ''} of each.",
        f"- `w[{plant.disturbances}]`: measured disturbances." if plant.disturbances else "- `w`: unused, may be null.",
    ]
    for input_name, levels in zip(plant.input_names, controller.levels, strict=True):
        lines.append(f"- `u`, {input_name}: one of {', '.join(f'{v:g}' for v in levels)}.")
    return "\n".join(lines)
