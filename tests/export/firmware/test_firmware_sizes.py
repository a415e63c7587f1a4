"""Firmware is as large as is said, and no larger than its design needs."""

import shutil

import pytest

from export.firmware.designs import COMPILERS, CROSS, DESIGNS, NEEDS_COMPILER, STRICT, design, sources, spoken
from foreswitch.export.firmware import firmware_figures
from foreswitch.export.header import exported as as_exported, limits

pytestmark = NEEDS_COMPILER


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", DESIGNS)
def test_the_state_is_as_large_as_said(exported, tmp_path, name, real):
    """On this machine, and where nothing is aligned."""
    folder, figures = exported(name, real), firmware_figures(design(name, real))
    source = tmp_path / "size.c"
    machines = {COMPILERS[0]: ("state_bytes", [COMPILERS[0]])}
    machines |= {key: ("state_bytes", CROSS[key]) for key in ("cortex-m4f",) if shutil.which(CROSS[key][0])}
    if real == "float32" and shutil.which("avr-gcc"):
        machines["avr"] = ("state_bytes_avr", CROSS["avr"])
    for key, command in machines.values():
        source.write_text(
            f'#include "foreswitch_design.h"\nextern char fits[sizeof(fsw_state) == {figures[key]} ? 1 : -1];\n'
        )
        code, said = spoken(*command, "-std=c99", f"-I{folder}", "-c", source, "-o", "/dev/null")
        assert code == 0, (command[0], figures[key], said)
    readme = (folder / "README.md").read_text()
    assert f"| {figures['state_bytes']} bytes" in readme
    assert f"| {figures['table_bytes']} bytes" in readme
    counted = {line.split(" | ")[1] for line in readme.splitlines() if " | cortex-" in line or " | atmega" in line}
    every = {"cortex-m4f", "cortex-m3", "cortex-m0", "atmega328p"}
    assert counted == ({"cortex-m4f"} if (folder / "horizon.c").exists() else every)


def test_the_papers_controller_is_small():
    figures = firmware_figures(design("paper", "float32"))
    assert figures["state_bytes_avr"] <= 96
    assert figures["multiply_adds"] == 11


@pytest.mark.parametrize("key", ["FSW_FIXED", "FSW_DESIGN controller"])
def test_without_its_constants_the_core_takes_the_same_steps(exported, tmp_path, key):
    """One logic: the numbers compiled in, the sizes compiled in, or all of it read from the design."""
    for name in ("paper", "vented", "two inputs", "horizon"):
        folder = tmp_path / f"{name}{key}"
        shutil.copytree(exported(name), folder)
        header = folder / "foreswitch_design.h"
        text = header.read_text().replace("#define FSW_DESIGN controller\n", "")
        if key == "FSW_FIXED":
            text = text.replace("#define FSW_FIXED\n", "")
        header.write_text(text)
        data = folder / "data.c"
        data.write_text('#define FSW_DATA\n#include "foreswitch_design.h"\n')
        test = (folder / "selftest.c").read_text().replace("check(fsw_init(&other, &state) != FSW_VALID", "check(1")
        (folder / "selftest.c").write_text(
            test.replace("    const fsw_design other", "    (void)u;\n    const fsw_design other")
        )
        target = folder / "selftest"
        flags = [flag for flag in STRICT if flag != "-Werror"]
        code, said = spoken(
            COMPILERS[0], *flags, "-O2", "-o", target, folder / "selftest.c", data, *sources(folder), "-lm"
        )
        assert code == 0, said
        assert spoken(target)[1].endswith("passed, 0 failed\n"), name


def test_a_promise_that_is_broken_is_refused(exported, tmp_path):
    """A design whose sizes are not those of the core that is compiled for it."""
    broken = {
        ".order = 2": ".order = 1", ".candidates = 2": ".candidates = 1", ".rows = 6": ".rows = 5",
        ".states = 2": ".states = 1", "_offset[] = {0.0f}": "_offset[] = {1.0f}",
        "_model_new[] = {0.0f, 0.0f}": "_model_new[] = {0.0f, 1.0f}", "_switch_cost[] = {0.0f}": "_switch_cost[] = {1.0f}",
        "_holds[] = {1}": "_holds[] = {2}", ".disturbances = 0": ".disturbances = 1", ".loads = 0": ".loads = 1",
        ".rest_reference = 0": ".rest_reference = controller_offset", ".gain = 0": ".gain = controller_offset",
    }  # fmt: skip
    text = (exported("paper") / "foreswitch_design.h").read_text()
    folder = tmp_path / "copy"
    shutil.copytree(exported("paper"), folder)
    for old, new in broken.items():
        assert text.count(old) == 1, old
        (folder / "foreswitch_design.h").write_text(text.replace(old, new))
        target = folder / "example"
        assert spoken(COMPILERS[0], "-w", "-o", target, folder / "example.c", folder / "foreswitch.c")[0] == 0
        assert spoken(target)[0] == 1, new


def test_a_tail_that_is_always_zero_is_not_computed():
    for name, rests in (("paper", 0), ("vented", 1), ("levels beside zero", 1)):
        assert limits(as_exported(design(name).design))["FSW_REST"] == rests, name
