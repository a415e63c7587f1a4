"""Exact counts: instructions per step, nodes of a horizon, bytes. A change that is meant to move them edits counts.json."""

import json
import platform
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from common import CORE, HERE, PLANT, build, compiler, controller
from emit import design_sizes, design_source, numbers, structure
from problems import Core, Problem, hot_gas, inverter, transients
from table import Row

STEPS = 1000  # as in count.c


def design_header(real: str) -> str:
    """The paper's design and plant as C."""
    law = controller(real)
    sizes, model = design_sizes(law), law.model
    body = {
        "transition": model.transition, "input_old": model.old, "input_new": model.new, "input_load": model.load,
        "disturbance": model.disturbance, "drift": model.drift, "delay": np.array(model.delay, dtype=np.uint32),
        "output": PLANT.C, "output_zero": PLANT.y_offset,
    }  # fmt: skip
    plant = {key: sizes[key] for key in ("states", "inputs", "outputs", "disturbances")}
    limits = [f"#define {key.upper()} {size}" for key, size in sizes.items()]
    return "\n".join([*limits, design_source(law), structure("fsw_plant", "plant", plant, body)])


def instructions(program: Path, function: str) -> float:
    """Per call of the step or period of the loop, with all it calls."""
    options = ["--tool=callgrind", "--callgrind-out-file=/dev/null", f"--toggle-collect={function}"]
    result = subprocess.run(["valgrind", *options, program], capture_output=True, text=True, check=True)
    return int(re.search(r"Collected : (\d+)", result.stderr)[1]) / STEPS


def instruction_rows(folder: Path, wanted: dict[str, Any], gated: bool) -> Iterator[Row]:
    """Gated where machine and compiler are those of the expected counts; elsewhere they only serve as a scale."""
    most = 1.0 + wanted["slack"]
    for real, options in (("float64", []), ("float32", ["-DFSW_SINGLE"])):
        (folder / "design.h").write_text(design_header(real))
        sources = [HERE / "count.c", *sorted([*CORE.glob("*.c"), *CORE.glob("host/*.c")])]
        program = build(folder / "count", *options, f"-I{folder}", f"-I{CORE}", f"-I{CORE / 'host'}", *sources)
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


def steps_header(one: Problem) -> str:
    """What a horizon's steps are told."""
    data = {"x": one.x, "reference": one.reference}
    sizes = f"enum {{ STEPS = {len(one.x)}, WIDTH = {one.reference[0].size} }};"
    return "\n".join([sizes, *(f"static const fsw_real {key}[] = {numbers(values)};" for key, values in data.items())])


def horizon_instructions(folder: Path, one: Problem) -> list[int]:
    """Counts of each step: the counter writes a file when one is over."""
    (folder / "design.h").write_text(design_source(one.law))
    (folder / "steps.h").write_text(steps_header(one))
    sources = [HERE / "count_horizon.c", CORE / "foreswitch.c", CORE / "horizon.c"]
    program = build(folder / "count", f"-DFSW_MAX_MOVES={one.moves}", f"-I{folder}", f"-I{CORE}", *sources)
    options = ["--toggle-collect=fsw_step", "--dump-after=fsw_step", f"--callgrind-out-file={folder / 'step'}"]
    subprocess.run(["valgrind", "--tool=callgrind", *options, program], capture_output=True, check=True)
    files = list(folder.glob("step.*"))
    counts = [int(re.search(r"^summary: (\d+)", file.read_text(), re.MULTILINE)[1]) for file in files]
    for file in files:
        file.unlink()
    assert len(counts) == len(one.x)
    return counts


def horizon_rows(folder: Path, wanted: dict[str, Any], gated: bool) -> Iterator[Row]:
    most = 1.0 + wanted["slack"]
    for name, expected in wanted["horizon"].items():
        one = hot_gas(int(name.rpartition("=")[2]), [0.0, 1.0])
        counts = horizon_instructions(folder, one)
        found = sum(counts) / len(counts), max(counts)
        share = max(a / b for a, b in zip(found, expected, strict=True))
        yield Row(
            f"instructions per step (most), {name}", f"{found[0]:.0f}", f"{expected[0]}",
            f"({found[1]}) {share:.3f} of the expected", f"<= {most:g}" if gated else "", not gated or share <= most,
        )  # fmt: skip


def node_rows(folder: Path, wanted: dict[str, Any]) -> Iterator[Row]:
    """Partial sequences per step, the largest number and all steps together; the tables' rounding breaks ties."""
    most = 1.0 + wanted["slack"]
    distances = [side * pulses for pulses in (3.0, 5.0, 8.0, 12.0, 20.0, 40.0, 60.0) for side in (-1.0, 1.0)]
    two, three = (0.0, 1.0), (-1.0, 0.0, 1.0)
    problems = [hot_gas(moves, levels) for levels in (two, three) for moves in (10, 20, 30)]
    problems += [inverter(10), *(transients(moves, levels, distances) for levels in (two, three) for moves in (20, 30))]
    core = Core(problems, folder)
    for one in problems:
        nodes, expected = core.replay(one).nodes, wanted["nodes"][one.name]
        share = max(float(nodes.max()) / expected[0], float(nodes.sum()) / expected[1])
        text = f"{np.median(nodes):.0f} in the median, {nodes.sum()} in all"
        yield Row(f"nodes, {one.name}", f"{nodes.max()}", f"{expected[0]}", text, f"<= {most:g}", share <= most)


def state_bytes(folder: Path, **more: int) -> int:
    """sizeof(fsw_state), every limit at the paper's size, in single precision."""
    limits = {"MAX_STATES": 2, "MAX_INPUTS": 1, "MAX_OUTPUTS": 1, "MAX_DISTURBANCES": 1, "MAX_LINE": 6}
    source = folder / "size.c"
    source.write_text(
        "#include <stdio.h>\n"
        '#include "foreswitch.h"\n'
        'int main(void) { return printf("%u", (unsigned)sizeof(fsw_state)) < 0; }\n'
    )
    defines = {f"FSW_{name}": value for name, value in (limits | more).items()}
    program = build(folder / "size", "-DFSW_SINGLE", f"-I{CORE}", source, defines=defines)
    return int(subprocess.run([program], capture_output=True, text=True, check=True).stdout)


def rows() -> Iterator[Row]:
    wanted = json.loads((HERE / "counts.json").read_text())
    speaks = subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=True).stdout
    gated = platform.machine() == wanted["machine"] and wanted["compiler"] in speaks
    with TemporaryDirectory() as name:
        folder = Path(name)
        if shutil.which("valgrind"):
            yield from instruction_rows(folder, wanted, gated)
            yield from horizon_rows(folder, wanted, gated)
        else:
            yield Row("instructions per period", "skipped", result="valgrind is not installed")
        yield from node_rows(folder, wanted)
        size = state_bytes(folder)
        yield Row("bytes of state, paper's controller, float32", f"{size}", gate="<= 96", passed=size <= 96)
        # no node is remembered where none is compared
        size = state_bytes(folder, MAX_MOVES=20, MAX_STEPS=20, HORIZON_STATES=2, HORIZON_CANDIDATES=2, RECORDS=0)
        yield Row("bytes of state, hot gas {0,1} N=20, float32", f"{size}", gate="<= 2048", passed=size <= 2048)
