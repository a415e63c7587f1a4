"""Exported controllers on the processors they are for: the same commands and the same state as in Python, bit by bit."""

import json
import os
import re
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from places import DOCS, ROOT, VECTORS
from targets.drive import Script, core_sources, exported, program
from targets.harness import HERE as TARGET_FILES, TARGETS, Target, spoken, there
from targets.scenarios import CONTROLLERS, long_run
from targets.stack import deepest
from vectors import make

#: Said by every test that skips for want of a target; conftest.py gathers them.
ABSENT = "target not here"
#: Those with the memory for everything; 2 KB of the ATmega328P are for the paper's controller and its like.
LARGE = [name for name in TARGETS if name != "atmega328p"]


def require(name, lacking):
    """A skip where tools are lacking, or where they are required a failure."""
    if not lacking:
        return
    text = f"{ABSENT}: {name} lacks {', '.join(lacking)}"
    if os.environ.get("FORESWITCH_REQUIRE_TARGETS"):
        pytest.fail(text)
    pytest.skip(text)


@pytest.fixture
def target(request) -> Target:
    """The one asked for by name."""
    one = TARGETS[request.param]
    require(one.name, one.missing())
    return one


def on(*pairs):
    """Parameters (target, real), those that the target has."""
    cases = [(name, real) for name in pairs for real in TARGETS[name].reals]
    return pytest.mark.parametrize(("target", "real"), cases, indirect=["target"])


def agree(script, image):
    """The program answers as the core inside Python."""
    result = image.run(script.data)
    assert not (difference := script.differences(result.output)), difference


@pytest.mark.parametrize(("required", "code"), [("", 0), ("1", 1)])
def test_a_machine_without_the_tools_is_told_what_was_not_run(required, code, tmp_path):
    """The last line names it; where targets are required, the run fails instead."""
    command = [sys.executable, "-m", "pytest", __file__, "-k", "not_fused or on_a_fault", "-p", "no:xdist", "-p",
               "no:cacheprovider"]  # fmt: skip
    environment = os.environ | {"PATH": str(tmp_path), "FORESWITCH_REQUIRE_TARGETS": required}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.returncode == code, done.stdout
    line = "cortex-m4f lacks arm-none-eabi-gcc, arm-none-eabi-gcc:newlib.h, qemu-system-arm, gcc"
    assert line in done.stdout
    assert (f"not run on this machine: {line}; proof lacks frama-c\n" in done.stdout) == (not required)


# Closed loops ---------------------------------------------------------------------------------------------------------

long_runs = cache(long_run)


@pytest.mark.parametrize("name", CONTROLLERS)
@on(*LARGE)
def test_commands_and_states_are_pythons_bit_by_bit(target, real, name, tmp_path):
    """10000 periods, 2000 on AVR: estimator, dwell, gate, every kind of bad sample, commands by hand, restarts."""
    script = long_runs(name, real, 2000 if "avr" in target.compiler else 10000)
    assert set(script.status) == {0, 1, 2, 3}
    assert len({tuple(u) for u in script.u}) >= 3
    agree(script, program(tmp_path, script.law, target))


@on("atmega328p")
def test_the_small_controller_does_so_with_2_kilobytes_of_memory(target, real, tmp_path):
    script = long_runs("endpoint", real, 2000)
    agree(script, program(tmp_path, script.law, target))


@on("cortex-m4f")
def test_products_are_not_fused_even_by_a_compiler_that_may(target, real, tmp_path):
    """This processor could in single precision; nobody compiles an export with our flags for sure."""
    script = long_runs("endpoint", real, 2000)
    agree(script, program(tmp_path, script.law, target, "-ffp-contract=fast"))


@pytest.mark.parametrize("bit", [0, 7])
@on("cortex-m4f")
def test_one_bit_of_one_sample_is_noticed(target, real, bit, tmp_path):
    """The first value measured in the last period that uses its sample, with the lowest bits of its fraction changed."""
    script = Script(long_runs("endpoint", real, 2000).law)
    for pressure in (10.0, 11.0, 12.0):
        script.step([pressure], np.full((1, 1, script.law.order), 20.0))
    data = bytearray(script.data)
    size = np.dtype(real).itemsize
    data[-1 - size * (1 + script.law.order)] ^= 1 << bit
    image = program(tmp_path, script.law, target)
    assert not script.differences(image.run(script.data).output)
    assert script.differences(image.run(bytes(data)).output).startswith(f"operation {len(script.answers) - 1} of")


# Golden vectors -------------------------------------------------------------------------------------------------------


def number(value):
    """A number of a golden file, in which NaN and infinity are words."""
    return [number(item) for item in value] if isinstance(value, list) else float(value)


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
@on(*LARGE)
def test_golden_steps(target, real, path, tmp_path):
    """Commands and statuses of the transcription, costs near its own, all answers those of Python; compiled for size."""
    vector = json.loads(path.read_text())
    case = {"problem": dict(vector["problem"]), **vector["start"]}
    case["bad_limit"] = case["problem"].pop("bad_limit")
    script = Script(make.controller(case, real))
    m = script.law.plant.inputs
    script.restart(np.array(vector["line"]).reshape(-1, m), np.array(vector["wait"]))
    for k, step in enumerate(vector["steps"]):
        u = script.step(number(step["x"]), np.array(step["reference"]), number(step["w"]), look=True)
        assert u.tolist() == step["u"], k
        assert script.status[-1] == ["OK", "COASTING", "HELD", "SAFE"].index(step["status"]), k
        if step["costs"] is not None:
            costs = np.array(number(step["costs"]))
            largest = costs[np.isfinite(costs)].max()
            assert script.costs[-1] == pytest.approx(costs, rel=0, abs=largest * (1e-9 if real == "float64" else 1e-3))
    agree(script, program(tmp_path, script.law, target, level="-Os"))


# What comes with an export --------------------------------------------------------------------------------------------

EXPORTED = {"paper": lambda real: make.controller(CASE, real)} | {
    name: maker for name, (maker, _) in CONTROLLERS.items()
}
CASE = {"problem": make.PAPER, "bad_limit": 0, "pending": None, "elapsed": None}


@pytest.mark.parametrize("name", EXPORTED)
@on(*LARGE)
def test_the_self_test_passes_and_the_example_runs(target, real, name, tmp_path):
    folder = exported(tmp_path / "exported", EXPORTED[name](real))
    image = target.build(tmp_path / "selftest", [folder / "selftest.c", *core_sources(folder)], f"-I{folder}")
    text = image.run().output.decode()
    passed, failed = map(int, re.fullmatch(r"(\d+) passed, (\d+) failed\n", text).groups())
    assert passed > 200
    assert failed == 0
    target.build(tmp_path / "example", [folder / "example.c", *core_sources(folder)], f"-I{folder}").run()


# Stack ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CONTROLLERS)
@on("atmega1284p")
def test_no_step_takes_more_stack_than_the_frames_of_its_calls(target, real, name, tmp_path):
    """Nor much less, or the sum would count calls that are never made. The paths of bad samples are among the steps."""
    script = long_runs(name, real, 2000)
    image = program(tmp_path, script.law, target)
    result = image.run(script.data, count="fsw_step")
    bound, chain = deepest(image, "fsw_step")
    assert len(result.calls) == len(script.u)
    assert max(result.stack) <= bound, chain
    assert max(result.stack) >= 0.9 * bound, chain


# Proof and rules ------------------------------------------------------------------------------------------------------

#: A fault in the source, and what it leads to.
SEEDED = {
    "the ring's end": ("s->head + 1u == ROWS(d) ? 0", "s->head == ROWS(d) ? 0"),
    "an index one too large": ("*command++ >= d->level_count[j]", "*command++ > d->level_count[j]"),
}


def proven(folder):
    """Alarms of frama-c's Eva in the exported core, and assertions left open."""
    require("proof", [tool for tool in ("frama-c",) if not there(tool)])
    sources = [str(TARGET_FILES / "proof.c"), str(folder / "foreswitch.c")]
    command = ["frama-c", f"-cpp-extra-args=-I{folder}", "-machdep", "gcc_x86_64", "-warn-special-float", "none", "-eva",
               "-eva-precision", "6", "-main", "main", *sources]  # fmt: skip
    text = spoken(command)
    alarms = int(re.search(r"(\d+) alarms? generated", text)[1])
    valid, unknown, invalid = map(
        int, re.search(r"Assertions +(\d+) valid +(\d+) unknown +(\d+) invalid", text).groups()
    )
    assert valid + unknown + invalid == 3
    return alarms, unknown + invalid


@pytest.mark.parametrize("name", ["paper", "endpoint"])
def test_no_call_can_go_wrong_whatever_it_is_told(name, tmp_path):
    """Any bits for numbers, any state that earlier calls may have left: no invalid access, no index out of range."""
    assert proven(exported(tmp_path / "exported", EXPORTED[name]("float32"))) == (0, 0)


@pytest.mark.parametrize("fault", SEEDED)
def test_the_proof_fails_on_a_fault(fault, tmp_path):
    folder = exported(tmp_path / "exported", EXPORTED["paper"]("float32"))
    right, wrong = SEEDED[fault]
    text = (folder / "foreswitch.c").read_text()
    assert text.count(right) == 1, "the line has changed: seed another fault"
    (folder / "foreswitch.c").write_text(text.replace(right, wrong))
    assert sum(proven(folder)) > 0


def test_every_deviation_from_misra_is_listed_and_justified(tmp_path):
    """What cppcheck finds in two exports, and the table of docs/reference/misra.md; nothing there that is no longer so."""
    require("MISRA rules", [tool for tool in ("cppcheck",) if not there(tool)])
    found = set()
    for name in ("paper", "horizon of two inputs"):
        folder = exported(tmp_path / name.replace(" ", "_"), EXPORTED[name]("float32"))
        command = ["cppcheck", "--addon=misra", "--std=c99", "--enable=style", "-q", "--template={id}"]
        done = subprocess.run([*command, *map(str, core_sources(folder))], capture_output=True, text=True, check=True)
        found |= set(re.findall(r"^misra-c2012-([\d.]+)$", done.stderr, re.MULTILINE))
    listed = re.findall(r"^\| (\d+\.\d+) \|", (DOCS / "reference/misra.md").read_text(), re.MULTILINE)
    assert found
    assert found == set(listed)
