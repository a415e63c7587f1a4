"""Exact counts on the processors that firmware is for: instructions or cycles of a step, its stack, flash and memory.

``python benchmarks/targets_counts.py --update`` writes what it finds to src/foreswitch/export/templates/counted.json,
which the README of every export shows, so that a change which moves them shows in review. With a project file it counts that
project's controller. Counts belong to a compiler: with another one nothing can be compared, which fails where
FORESWITCH_REQUIRE_TARGETS is set, and is said elsewhere.
"""

import itertools
import json
import os
import struct
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from common import HERE, controller

sys.path.insert(0, str(HERE.parent / "tests"))

from foreswitch import Controller
from foreswitch.control.horizon_tables import _lift
from foreswitch.project import Project
from peers import linear, quadratic
from problems import GAS_TS, Core, Model, hot_gas, pressure, transients
from table import Row
from targets.drive import Script, core_sources, exported, program
from targets.harness import TARGETS, Image, Target
from targets.stack import deepest
from targets_search import Search, counting

JSON = HERE.parent / "src" / "foreswitch" / "export" / "templates" / "counted.json"
PROCESSORS = ("cortex-m4f", "cortex-m3", "cortex-m0", "atmega328p")
PAPER, MOVES = "paper", (5, 10)
#: Typical sizes of the paper's measurement and reference, with which a search begins; its depth.
SPREAD, STEPS, GENERATIONS = np.array([500.0, 2000.0, 500.0, 2000.0]), 4, 25
DISTANCES = [side * pulses for pulses in (3.0, 5.0, 8.0, 12.0, 20.0, 40.0, 60.0) for side in (-1.0, 1.0)]
#: What must hold whatever the compiler: (problem, processor, count) and its limit.
BOUNDS = {
    (PAPER, "atmega328p", "usable"): 3200,
    (PAPER, "atmega328p", "worst"): 4400,  # a bad sample: the model coasts first
    (PAPER, "atmega328p", "state"): 96,
    (PAPER, "cortex-m4f", "usable"): 200,
    (PAPER, "cortex-m4f", "flash"): 2048,
    ("hot gas N=10", "cortex-m4f", "worst"): 40000,
    ("hot gas N=10, from far away", "cortex-m4f", "worst"): 40000,
}
#: Another machine's linear algebra may round the tables differently, and the data-dependent counts follow.
SLACK = {"mean": 0.02, "worst": 0.02}
VERSION = "0.11.0"  # of DAQP, as in constraints.txt


# What one program takes -----------------------------------------------------------------------------------------------


def sizes(image: Image) -> tuple[int, int]:
    """Flash and memory."""
    text, data, bss = (int(word) for word in image.tool("size").splitlines()[1].split()[:3])
    return text + data, data + bss


def footprint(folder: Path, law: Controller, target: Target) -> dict[str, int]:
    """Flash and memory that the controller takes: core, tables, library routines, and the state."""
    source = exported(folder / "exported", law)
    found = []
    for more in ([], ["-DWITHOUT"]):
        image = target.build(
            folder / f"flash{len(more)}", [HERE / "targets_flash.c", *core_sources(source)], f"-I{source}", *more
        )
        found.append(sizes(image))
    (flash, memory), (empty_flash, empty_memory) = found
    return {"flash": flash - empty_flash, "memory": memory - empty_memory}


def static(folder: Path, image: Image, law: Controller) -> dict[str, int]:
    """What does not depend on data."""
    size, stack = image.symbols()["state"][1], deepest(image, "fsw_step")[0]
    return {"state": size, "stack": stack} | footprint(folder, law, image.target)


def dearest(folder: Path, target: Target, law: Controller, spread: np.ndarray) -> dict[str, float]:
    """Steps with usable samples, and with any: looked for, not drawn."""
    image = program(folder, law, target)
    found: dict[str, float] = {}
    for name, usable in (("usable", True), ("worst", False)):
        found[name], _ = Search(law, spread, STEPS, usable=usable).run(counting(image), GENERATIONS)
    return found | static(folder, image, law)


def gas_script(moves: int) -> Script:
    """The closed loop with its kicks; steps from far away without a plan; loops from far away, a kick now and then."""
    one, far = hot_gas(moves, [0.0, 1.0]), transients(moves, [0.0, 1.0], DISTANCES)
    model, rng = Model(one.law.plant, GAS_TS), np.random.default_rng(0)
    script = Script(one.law.replace(real="float32"))
    off = np.zeros((script.design.rows, 1))
    for x, reference in zip(one.x, one.reference, strict=True):
        script.step(x, reference)
    for x, reference in zip(far.x, far.reference, strict=True):
        script.restart(off, np.zeros(1))
        script.step(x, reference)
    for k, distance in itertools.product(range(0, 250, 25), DISTANCES):
        script.restart(off, np.zeros(1))
        x, line = np.array([pressure(np.array(k), True) + distance, 0.0]), [np.zeros(1)] * model.delay
        for i in range(60):
            ahead = pressure(k + i + model.delay + 1 + np.arange(moves), True)[:, None, None]
            line.append(script.step(x, ahead))
            x = model.F @ x + model.G @ line[-1 - model.delay] + [0.5 * rng.normal() * (i % 10 == 9), 0.0]
    return script


def gas(folder: Path, target: Target, moves: int) -> tuple[dict[str, float], dict[str, float]]:
    """The kicked loop, whose steps DAQP is given too, and all that begins far away."""
    script = gas_script(moves)
    image = program(folder, script.law, target)
    calls = counting(image)(script)
    loop = len(hot_gas(moves, [0.0, 1.0]).x)
    near, far = ({"mean": sum(some) / len(some), "worst": max(some)} for some in (calls[:loop], calls[loop:]))
    return near | static(folder, image, script.law), far


# The opponent ---------------------------------------------------------------------------------------------------------


def daqp_sources(folder: Path) -> list[Path]:
    """DAQP's C, from its source distribution; empty if that cannot be had."""
    command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", "daqp",
               f"daqp=={VERSION}", "-d", str(folder)]  # fmt: skip
    subprocess.run(command, capture_output=True)
    for archive in folder.glob("daqp-*.tar.gz"):
        with tarfile.open(archive) as file:
            file.extractall(folder, filter="data")
    return sorted(folder.glob("daqp-*/csrc/src/*.c"))


def daqp(folder: Path, target: Target, sources: list[Path], moves: int, encoding: str) -> dict[str, float]:
    """The same steps, of which it is told the linear term; set-up is not counted. Never a lower cost than ours."""
    one = hot_gas(moves, [0.0, 1.0])
    H = quadratic(one)
    shift = _lift(H, np.ones(moves, dtype=bool)) if encoding == "lifted" else np.zeros(moves)
    entries = ", ".join(f"{value:.9g}f" for value in (2.0 * (H - np.diag(shift))).ravel())
    folder.mkdir()
    (folder / "problem.h").write_text(f"enum {{ N = {moves} }};\nstatic c_float H[] = {{{entries}}};\n")
    include = sources[0].parent.parent / "include"
    given = [f"-I{folder}", f"-I{include}", "-DDAQP_SINGLE_PRECISION", "-DPORT_HEAP=32768", "-w"]
    image = target.build(folder / "daqp", [HERE / "targets_daqp.c", *sources], *given)
    terms = [(2.0 * linear(one, i) + shift).astype(np.float32).tobytes() for i in range(len(one.x))]
    result = image.run(struct.pack("<I", len(terms)) + terms[0] + b"".join(terms), count="solve", caller="main")
    (heap,) = struct.unpack_from("<I", result.output)
    answers = np.frombuffer(result.output, [("flag", "<i4"), ("nodes", "<i4"), ("u", "<f4", moves)], offset=4)
    assert (answers["flag"] == 1).all(), "DAQP leaves a step unsolved"
    flash = sizes(image)[0] - sizes(target.build(folder / "empty", [HERE / "targets_daqp.c"], *given, "-DWITHOUT"))[0]
    costs = [one.cost(i, np.round(u).reshape(-1, 1)) for i, u in enumerate(answers["u"].astype(float))]
    best = Core([one], folder).replay(one).cost
    assert (np.array(costs) >= best * (1.0 - 1e-9)).all(), "DAQP finds a lower cost"
    return {"mean": sum(result.calls) / len(result.calls), "worst": max(result.calls), "flash": flash, "memory": heap}


# Counts beside those expected -----------------------------------------------------------------------------------------


def measured(folder: Path) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Problem, processor, counts; of the processors whose tools are here."""
    for name in PROCESSORS:
        target = TARGETS[name]
        if target.missing():
            continue
        (here := folder / name).mkdir()
        yield PAPER, name, dearest(here, target, controller("float32"), SPREAD)
        for moves in MOVES if name == "cortex-m4f" else ():
            (here := folder / f"{name}-{moves}").mkdir()
            near, far = gas(here, target, moves)
            yield f"hot gas N={moves}", name, near
            yield f"hot gas N={moves}, from far away", name, far
    if not TARGETS["cortex-m4f"].missing() and (sources := daqp_sources(folder)):
        for moves in MOVES:
            found = [daqp(folder / f"daqp-{moves}-{encoding}", TARGETS["cortex-m4f"], sources, moves, encoding)
                     for encoding in ("plain", "lifted")]  # fmt: skip
            yield f"DAQP, hot gas N={moves}", "cortex-m4f", min(found, key=lambda one: one["mean"])


def alike(key: str, found: float, expected: float) -> bool:
    return abs(found - expected) <= SLACK.get(key, 0.0) * expected


def rows() -> Iterator[Row]:
    wanted = json.loads(JSON.read_text())
    required = bool(os.environ.get("FORESWITCH_REQUIRE_TARGETS"))
    for name in PROCESSORS:
        if lacking := TARGETS[name].missing():
            yield Row(f"counts on {name}", "skipped", result=f"needs {', '.join(lacking)}", passed=not required)
    with TemporaryDirectory() as folder:
        seen = set()
        for problem, name, counts in measured(Path(folder)):
            seen.add(problem)
            version, expected = TARGETS[name].version(), wanted["counts"].get(problem, {}).get(name, {})
            comparable = version == wanted["compilers"].get(name)
            if not comparable:
                text = f"{version}, not {wanted['compilers'].get(name)}: --update"
                yield Row(f"{problem} on {name}", "unknown", result=text, passed=not required)
            for key, found in counts.items():
                limit = BOUNDS.get((problem, name, key))
                before = expected.get(key)
                same = not comparable or (before is not None and alike(key, found, before))
                yield Row(
                    f"{problem} on {name}, {key}", f"{found:.0f}", "" if before is None else f"{before:.0f}",
                    "as expected" if same else "run targets_counts.py --update", f"<= {limit}" if limit else "",
                    same and (limit is None or found <= limit),
                )  # fmt: skip
        if not any(problem.startswith("DAQP") for problem in seen):
            yield Row("DAQP on cortex-m4f", "skipped", result="its sources are not to be had here")


def update() -> None:
    with TemporaryDirectory() as folder:
        counts: dict[str, Any] = {}
        for problem, name, found in measured(Path(folder)):
            counts.setdefault(problem, {})[name] = {key: round(value) for key, value in found.items()}
            print(problem, name, found, flush=True)
    compilers = {name: TARGETS[name].version() for name in PROCESSORS}
    limits = {"; ".join(key): limit for key, limit in BOUNDS.items()}
    JSON.write_text(json.dumps({"compilers": compilers, "limits": limits, "counts": counts}, indent=1) + "\n")


def count(path: str) -> None:
    """One project's controller on every processor whose tools are here, its samples as large as in its own run."""
    project = Project.read(path)
    law = project.build_controller(real="float32")
    run, design = project.simulate(law), law.design
    reference = np.tile(np.abs(run.r).max(axis=0), (law.evaluations * law.order, 1)).T.ravel()
    measured = np.abs(run.x if law.estimator is None else run.y).max(axis=0)
    spread = np.concatenate([measured, reference, np.ones(design.disturbances - design.loads)])
    for name in PROCESSORS:
        target = TARGETS[name]
        if lacking := target.missing():
            print(f"{name}: needs {', '.join(lacking)}")
            continue
        with TemporaryDirectory() as folder:
            found = dearest(Path(folder), target, law, spread)
        print(f"{name}: " + ", ".join(f"{key} {value:.0f}" for key, value in found.items()), flush=True)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--update"]:
            update()
        case [path] if path.endswith(".toml"):
            count(path)
        case _:
            sys.exit("usage: targets_counts.py --update | PROJECT.toml")
