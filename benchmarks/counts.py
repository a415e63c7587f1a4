"""Exact counts: instructions per step and bytes of state. A change that is meant to move them edits counts.json."""

import json
import platform
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from common import CORE, HERE, PLANT, build, compiler, controller
from table import Row

STEPS = 1000  # as in count.c

C_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "d": "double", "f": "float"}
SIZES = "states inputs outputs disturbances order rows candidates bad_limit measured loads gate_limit"
#: In the order of the binding.
ARRAYS = """level_count pending holds exact_levels levels candidate safe state_row disturbance_row offset reference_row
half_weight pending_table hold_row total_row rest_reference rest_disturbance rest_offset dwell switch_cost model_x
model_old model_new model_w model_c gain output_row output_offset start_row start_offset gate"""


def structure(kind: str, name: str, sizes: Mapping[str, int], arrays: Mapping[str, Any], absent: str = "") -> str:
    """A constant C structure and the arrays it points to."""
    lines, members = [], [f".{key} = {size}" for key, size in sizes.items()]
    for key, values in arrays.items():
        numbers = ", ".join(f"{v:.17g}" if values.dtype.kind == "f" else str(v) for v in values.ravel()) or "0"
        lines.append(f"static const {C_TYPES[values.dtype.char]} {key}[] = {{{numbers}}};")
        members += [f".{key} = {key}"] if key != absent else []
    return "\n".join([*lines, f"static const {kind} {name} = {{{', '.join(members)}}};\n"])


def design_header(real: str) -> str:
    """The paper's design and plant as C."""
    law = controller(real)
    numbers, values = law._parts
    sizes = dict(zip(SIZES.split(), numbers, strict=True))
    arrays = {key: array for key, array in zip(ARRAYS.split(), values, strict=True) if array is not None}
    model = law._model
    body = {
        "transition": model.transition, "input_old": model.old, "input_new": model.new, "input_load": model.load,
        "disturbance": model.disturbance, "drift": model.drift, "delay": np.array(model.delay, dtype=np.uint32),
        "output": PLANT.C, "output_zero": PLANT.y_offset,
    }  # fmt: skip
    plant = {key: sizes[key] for key in ("states", "inputs", "outputs", "disturbances")}
    limits = [f"#define {key.upper()} {size}" for key, size in sizes.items()]
    design = structure("fsw_design", "design", sizes, arrays, absent="exact_levels")
    return "\n".join([*limits, design, structure("fsw_plant", "plant", plant, body)])


def instructions(program: Path, function: str) -> float:
    """Per call of the step or period of the loop, with all it calls."""
    options = ["--tool=callgrind", "--callgrind-out-file=/dev/null", f"--toggle-collect={function}"]
    result = subprocess.run(["valgrind", *options, program], capture_output=True, text=True, check=True)
    return int(re.search(r"Collected : (\d+)", result.stderr)[1]) / STEPS


def instruction_rows(folder: Path) -> Iterator[Row]:
    """Gated where machine and compiler are those of the expected counts; elsewhere they only serve as a scale."""
    wanted = json.loads((HERE / "counts.json").read_text())
    speaks = subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=True).stdout
    gated = platform.machine() == wanted["machine"] and wanted["compiler"] in speaks
    most = 1.0 + wanted["slack"]
    for real, options in (("float64", []), ("float32", ["-DFSW_SINGLE"])):
        (folder / "design.h").write_text(design_header(real))
        sources = [HERE / "count.c", *sorted(CORE.glob("*.c"))]
        program = build(folder / "count", *options, f"-I{folder}", f"-I{CORE}", *sources)
        for function, what in (("fsw_run", "closed loop"), ("fsw_step", "step alone")):
            count, expected = instructions(program, function), wanted["instructions"][real][function]
            share, gate = count / expected, f"<= {most:g}" if gated else ""
            yield Row(
                f"instructions per period, {what}, {real}",
                f"{count:.0f}",
                f"{expected}",
                f"{share:.3f} of the expected",
                gate,
                not gated or share <= most,
            )


def state_bytes(folder: Path) -> int:
    """sizeof(fsw_state), every limit at the paper's size, in single precision."""
    limits = {"STATES": 2, "INPUTS": 1, "OUTPUTS": 1, "DISTURBANCES": 1, "LINE": 6}
    source = folder / "size.c"
    source.write_text(
        "#include <stdio.h>\n"
        '#include "foreswitch.h"\n'
        'int main(void) { return printf("%u", (unsigned)sizeof(fsw_state)) < 0; }\n'
    )
    defines = {f"FSW_MAX_{name}": value for name, value in limits.items()}
    program = build(folder / "size", "-DFSW_SINGLE", f"-I{CORE}", source, defines=defines)
    return int(subprocess.run([program], capture_output=True, text=True, check=True).stdout)


def rows() -> Iterator[Row]:
    with TemporaryDirectory() as folder:
        if shutil.which("valgrind"):
            yield from instruction_rows(Path(folder))
        else:
            yield Row("instructions per period", "skipped", result="valgrind is not installed")
        size = state_bytes(Path(folder))
        yield Row("bytes of state, paper's controller, float32", f"{size}", gate="<= 96", passed=size <= 96)
