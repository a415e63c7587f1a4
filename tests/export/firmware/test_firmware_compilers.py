"""What compilers make of exported firmware: the same bits, without a warning."""

import json
import re
import shutil

import pytest

from export.firmware.designs import COMPILERS, CROSS, DESIGNS, NEEDS_COMPILER, STRICT, sources, spoken

pytestmark = NEEDS_COMPILER


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", DESIGNS)
def test_the_selftest_passes_under_sanitizers(exported, tmp_path, name, real, compiler):
    """No -ffp-contract needed on the host; as it comes otherwise."""
    folder = exported(name, real)
    flags = [*STRICT, "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    target = tmp_path / "selftest"
    code, said = spoken(compiler, *flags, "-o", target, folder / "selftest.c", *sources(folder), "-lm")
    assert (code, said) == (0, "")
    code, said = spoken(target)
    steps = int(re.search(r"FSW_ROWS = (\d+)", (folder / "foreswitch_design.h").read_text())[1])
    assert re.fullmatch(r"(\d+) passed, 0 failed\n", said), said
    assert (code, int(said.split()[0]) > 3 * steps) == (0, True)


@pytest.mark.parametrize("level", ["-O0", "-O2", "-O3", "-Os"])
@pytest.mark.parametrize("name", ["paper", "Kalman", "two-input horizon", "first-order horizon"])
def test_the_selftest_passes_at_every_optimisation(exported, tmp_path, name, level):
    for compiler in COMPILERS:
        for real in ("float64", "float32"):
            folder = exported(name, real)
            target = tmp_path / f"{compiler}{real}"
            code, said = spoken(compiler, *STRICT, level, "-o", target, folder / "selftest.c", *sources(folder), "-lm")
            assert (code, said) == (0, "")
            assert spoken(target)[1].endswith("passed, 0 failed\n")


def test_make_selftest_and_make_example(exported, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(exported("horizon"), folder)
    code, said = spoken("make", "-C", folder, "selftest", "CFLAGS=-O2 -Werror")
    assert code == 0
    assert re.search(r"^\d+ passed, 0 failed$", said, re.MULTILINE)
    assert spoken("make", "-C", folder, "example", "CFLAGS=-O2 -Werror")[0] == 0
    code, said = spoken("make", "-C", folder, "figures")
    assert code == 0
    assert "fsw_step" in said
    assert spoken("make", "-C", folder, "clean")[0] == 0
    assert not (folder / "build").exists()


TAMPERED = {
    "command": (r"\{(\d)\}, 0, ", lambda hit: f"{{{1 - int(hit[1])}}}, 0, ", "another command than simulated"),
    "cost": (r", 0, (\d+)\.", lambda hit: f", 0, 9{hit[1]}.", "another cost than simulated"),
    "status": (r"\}, 0, ", lambda hit: "}, 1, ", "another status than simulated"),
    "state": (r"(fsw_last_x\[FSW_MAX_STATES\] = \{)", lambda hit: f"{hit[1]}1.0f + ", "another state than simulated"),
    "table": (r"(state_row\[\] = \{)1\.0f", lambda hit: f"{hit[1]}1.001f", "another cost than simulated"),
}


@pytest.mark.parametrize("what", TAMPERED)
def test_a_changed_number_makes_the_selftest_fail(exported, tmp_path, what):
    """The test can fail."""
    pattern, change, words = TAMPERED[what]
    folder = tmp_path / "copy"
    shutil.copytree(exported("paper"), folder)
    header = folder / "foreswitch_design.h"
    text, steps = header.read_text(), header.read_text().index("fsw_rows[FSW_ROWS]")
    begin = 0 if what in ("table", "state") else steps
    changed = text[:begin] + re.sub(pattern, change, text[begin:], count=1)
    assert changed != text
    header.write_text(changed)
    code, said = spoken("make", "-C", folder, "selftest")
    assert code != 0
    assert words in said
    assert re.search(r"\d+ passed, [1-9]\d* failed", said)


def test_a_changed_core_makes_the_selftest_fail(exported, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(exported("paper"), folder)
    core = folder / "foreswitch.c"
    text = core.read_text()
    changed = text.replace("sum -= d->reference_row", "sum += d->reference_row")
    assert changed != text
    core.write_text(changed)
    assert spoken("make", "-C", folder, "selftest")[0] != 0


@pytest.mark.parametrize("machine", CROSS)
@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", DESIGNS)
def test_cross_compilers_have_nothing_to_say(exported, name, real, machine):
    compiler, *flags = CROSS[machine]
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not installed")
    folder = exported(name, real)
    for source in (*sources(folder), folder / "example.c", folder / "selftest.c"):
        for level in ("-O2", "-Os"):
            code, said = spoken(compiler, *flags, *STRICT, level, "-c", source, "-o", "/dev/null")
            if machine == "avr" and real == "float64":
                assert code != 0
                assert "export with float32" in said
            else:
                assert (code, said) == (0, "")


@pytest.mark.parametrize("standard", ["c++11", "c++17", "c++20", "gnu++17"])
@pytest.mark.parametrize("name", ["paper", "two-input horizon"])
def test_it_is_also_cpp(exported, tmp_path, name, standard):
    """All of it, though only the header need be: the tables are compiled with foreswitch.c."""
    folder = exported(name)
    user = tmp_path / "user.cpp"
    user.write_text(
        '#include "foreswitch_design.h"\n#include "foreswitch_design.h"\nstatic fsw_state state;\n'
        "int main() { return fsw_init(&controller, &state); }\n"
    )
    for compiler in [name for name in ("g++", "clang++") if shutil.which(name)]:
        flags = [f"-std={standard}", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", f"-I{folder}"]
        for source in (*sources(folder), folder / "example.c", folder / "selftest.c", user):
            code, said = spoken(compiler, "-x", "c++", *flags, "-c", source, "-o", "/dev/null")
            assert (code, said) == (0, ""), compiler
        objects = tmp_path / "core.o"
        assert spoken(COMPILERS[0], "-c", folder / "foreswitch.c", "-o", objects)[0] == 0
        if name == "paper":
            assert spoken(compiler, *flags, user, objects, "-o", tmp_path / "user")[0] == 0
            assert spoken(tmp_path / "user")[0] == 0


def test_a_sketch_compiles_as_arduino_would(exported, tmp_path):
    """Every file of the flat library, and the sketch as C++ after its declarations."""
    folder = exported("paper")
    (tmp_path / "Arduino.h").write_text(
        "#include <stdint.h>\nenum { HIGH = 1, LOW = 0 };\nunsigned long micros();\nvoid digitalWrite(int, int);\n"
    )
    for path in sorted(folder.glob("*.c")):
        code, said = spoken(COMPILERS[0], "-std=gnu11", "-DARDUINO=10819", "-Wall", "-Wextra", "-Werror", "-c", path, "-o",
                            tmp_path / f"{path.stem}.o")  # fmt: skip
        assert (code, said) == (0, ""), path.name
    [sketch] = (folder / "examples").rglob("*.ino")
    assert sketch.parent.name == sketch.stem == "controller"
    if shutil.which("g++"):
        flags = ["-std=gnu++11", "-Wall", "-Wextra", "-Werror", "-include", tmp_path / "Arduino.h", f"-I{folder}"]
        code, said = spoken("g++", "-x", "c++", *flags, "-c", sketch, "-o", "/dev/null")
        assert (code, said) == (0, "")
    properties = dict(line.split("=", 1) for line in (folder / "library.properties").read_text().splitlines())
    assert {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "architectures"} <= set(
        properties
    )
    assert json.loads((folder / "library.json").read_text())["build"]["srcFilter"] == ["+<foreswitch.c>"]


@pytest.mark.skipif(not shutil.which("cmake"), reason="needs cmake")
def test_cmake_builds_installs_and_is_found(exported, tmp_path):
    folder, build, place = exported("horizon"), tmp_path / "build", tmp_path / "place"
    code, said = spoken("cmake", "-S", folder, "-B", build, f"-DCMAKE_INSTALL_PREFIX={place}")
    assert code == 0, said
    assert spoken("cmake", "--build", build)[0] == 0
    assert spoken("ctest", "--test-dir", build)[0] == 0
    assert spoken("cmake", "--install", build)[0] == 0
    user = tmp_path / "user"
    user.mkdir()
    (user / "main.c").write_text(
        '#include "foreswitch_design.h"\nstatic fsw_state s;\nint main(void) { return fsw_init(&controller, &s); }\n'
    )
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(user C)\nfind_package(controller REQUIRED)\n"
        "add_executable(user main.c)\ntarget_link_libraries(user controller::controller)\n"
    )
    code, said = spoken("cmake", "-S", user, "-B", user / "build", f"-DCMAKE_PREFIX_PATH={place}")
    assert code == 0, said
    assert spoken("cmake", "--build", user / "build")[0] == 0
    assert spoken(user / "build" / "user")[0] == 0


def test_a_compiler_without_has_include_is_told(exported, tmp_path):
    """It would otherwise build for the host's limits, which the header refuses."""
    folder = tmp_path / "copy"
    shutil.copytree(exported("paper"), folder)
    header = folder / "foreswitch.h"
    header.write_text(header.read_text().replace("#ifdef __has_include", "#if 0"))
    arguments = [*STRICT, "-o", tmp_path / "selftest", folder / "selftest.c", folder / "foreswitch.c"]
    code, said = spoken(COMPILERS[0], *arguments)
    assert code != 0
    assert "compile with -DFSW_EXPORTED" in said
    assert spoken(COMPILERS[0], "-DFSW_EXPORTED", *arguments)[0] == 0
    assert spoken(tmp_path / "selftest")[1].endswith("passed, 0 failed\n")
