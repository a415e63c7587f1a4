"""Firmware: what was simulated is what the compilers make of the exported folder, bit by bit and without a warning."""

import json
import os
import re
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.export.firmware import firmware_figures
from foreswitch.export.header import exported as as_exported, initialiser, limits, number
from foreswitch.export.vectors import golden_steps
from places import CORE, ROOT
from systems import TWO_BY_TWO, VALVE

STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
CROSS = {
    "cortex-m4f": ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"],
    "cortex-m0": ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb"],
    "avr": ["avr-gcc", "-mmcu=atmega1284p"],
}
pytestmark = pytest.mark.skipif(not COMPILERS or not shutil.which("make"), reason="needs gcc or clang, and make")

ENDPOINT = fsw.Endpoint(Td=0.020, lam=2500.0)
KALMAN = fsw.Kalman([0.0, 1e4], 4.0, load=1e-4, gate=6.0, gate_limit=2)
COUPLED = TWO_BY_TWO.replace(
    E=[[0.3], [0.0], [1.0]], input_delay=[0.37, 0.15], u_offset=[0.2, 0.0], y_offset=[0.5, -0.3]
)
SUM_FORBIDDEN = [(1.0, 2.0), (0.0, -1.0)]


def coupled(objective, **options):
    return fsw.Controller(COUPLED, [[0, 1], [-1, 0, 2]], 0.1, objective, forbidden=SUM_FORBIDDEN, **options)


DESIGNS = {
    "paper": lambda: fsw.Controller(VALVE, [0, 1], 1e-3, ENDPOINT),
    "vented": lambda: fsw.Controller(
        VALVE.replace(E=[[-1.0], [0.0]], input_delay=0.0043), [0, 1], 1e-3, ENDPOINT, safe_level=0.0, bad_limit=4,
        preview="lag",
    ),
    "dwell": lambda: fsw.Controller(
        VALVE, [0, 0.5, 1], 1e-3, ENDPOINT, min_on=0.003, min_off=0.002, switch_cost=2.0, safe_level=1.0
    ),
    "two inputs": lambda: coupled(fsw.Endpoint(0.45, [3.0, 5.0], weight=[1.0, 4.0])),
    "Kalman": lambda: fsw.Controller(VALVE, [0, 1], 1e-3, ENDPOINT, estimator=KALMAN),
    "horizon": lambda: fsw.Controller(
        VALVE, [0, 1], 1e-3, fsw.Horizon(10, move_weight=0.1), preview=True, safe_level=0.0
    ),
    "two-input horizon": lambda: coupled(
        fsw.Horizon(5, moves=4, window=(2, 5), move_weight=[0.1, 0.02], tail="rest", terminal=np.eye(3)),
        min_on=[0.2, 0.15], min_off=[0.1, 0.3], switch_cost=[0.02, 0.01],
    ),
    "Kalman horizon": lambda: fsw.Controller(
        VALVE, [-1, 0, 1], 1e-3, fsw.Horizon(6, lam=800.0, tail="zero"), estimator=KALMAN
    ),
    "first-order horizon": lambda: fsw.Controller(fsw.Plant.fopdt(1.0, 1.0, 0.2), [0, 1], 0.1, fsw.Horizon(3, moves=1)),
    "no dead time": lambda: fsw.Controller(VALVE.replace(input_delay=0.0), [0, 1], 1e-3, ENDPOINT),
    "levels beside zero": lambda: fsw.Controller(VALVE, [1, 2], 1e-3, ENDPOINT),
}  # fmt: skip


def design(name, real="float64"):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return DESIGNS[name]().replace(real=real)


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Folder of a design in one of the arithmetics; made once."""
    made = {}

    def export(name, real="float32"):
        if (name, real) not in made:
            made[name, real] = tmp_path_factory.mktemp("firmware") / "out"
            fsw.export_c(design(name, real), made[name, real])
        return made[name, real]

    return export


def spoken(*command, **options):
    """Exit code and all that was said."""
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0", "MAKEFLAGS": ""}
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, env=environment, **options)
    return done.returncode, done.stdout + done.stderr


def sources(folder):
    return [path for path in (folder / "foreswitch.c", folder / "horizon.c") if path.exists()]


# What is in the folder ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper", "horizon"])
def test_the_folder_holds_the_core_byte_for_byte_and_one_generated_header(exported, name):
    folder = exported(name)
    core = {"foreswitch.h", "arithmetic.h", "foreswitch.c"} | (
        {"horizon.h", "horizon.c"} if name == "horizon" else set()
    )
    found = {path.name for path in folder.iterdir() if path.suffix in (".c", ".h")}
    assert found == core | {"foreswitch_design.h", "example.c", "selftest.c"}
    for file in core:
        assert (folder / file).read_bytes() == (CORE / file).read_bytes()
    assert (folder / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    others = {"LICENSE", "README.md", "Makefile", "CMakeLists.txt", "library.properties", "library.json", "examples"}
    assert {path.name for path in folder.iterdir()} == found | others


def test_logic_is_the_same_for_every_design(exported):
    """Only the header is generated; the rest differs in names and sizes."""
    for file in ("example.c", "selftest.c"):
        assert (exported("paper") / file).read_bytes() == (exported("horizon", "float64") / file).read_bytes()


@pytest.mark.parametrize("name", DESIGNS)
def test_an_export_is_the_same_byte_for_byte(name, exported, tmp_path):
    fsw.export_c(design(name, "float32"), tmp_path / "again")
    fsw.export_c(design(name, "float32"), tmp_path / "again")  # also over itself
    for path in exported(name).rglob("*"):
        if path.is_file() and "build" not in path.relative_to(exported(name)).parts:
            assert path.read_bytes() == (tmp_path / "again" / path.relative_to(exported(name))).read_bytes()


def test_an_export_leaves_the_controller_where_it_stood(tmp_path):
    controller = design("Kalman")
    controller.step([1.0], 3.0)
    before = controller.core.save()
    fsw.export_c(controller, tmp_path / "out")
    assert controller.core.save() == before
    fresh = tmp_path / "fresh"
    fsw.export_c(design("Kalman"), fresh)
    header = "foreswitch_design.h"
    assert (tmp_path / "out" / header).read_bytes() == (fresh / header).read_bytes(), "it is the design that counts"


def test_numbers_are_the_shortest_that_read_back():
    assert [number(np.float64(v)) for v in (0.1, 1.0, -0.0, 1e300, 5e-324, 1 / 3)] == [
        "0.1", "1.0", "-0.0", "1e+300", "5e-324", "0.3333333333333333"]  # fmt: skip
    assert [number(np.float32(v)) for v in (0.1, 16500.0, 1e-30)] == ["0.1f", "16500.0f", "1e-30f"]
    assert [number(v) for v in (7, 32768, 2**32 - 1)] == ["7", "32768u", "4294967295u"]
    rng = np.random.default_rng(0)
    for v in rng.standard_normal(200) * 10.0 ** rng.integers(-300, 300, 200):
        assert float(number(v)) == v
    for v in (rng.standard_normal(200) * 10.0 ** rng.integers(-37, 38, 200)).astype(np.float32):
        assert np.float32(number(v).rstrip("f")) == v
    assert initialiser(np.array([])) == "{0}"
    assert max(map(len, initialiser(rng.standard_normal(100)).splitlines())) <= 120


@pytest.mark.parametrize(
    ("name", "words"),
    [("2nd", "C identifier"), ("fsw", "begin with fsw"), ("a-b", "C identifier"), ("größe", "C identifier"),
     *((name, "themselves; give another, say '") for name in
       ("for", "class", "state", "level", "line", "input", "d", "x", "uint8_t", "NULL", "exit"))],
)  # fmt: skip
def test_a_name_that_is_none_is_refused_and_nothing_is_written(tmp_path, name, words):
    with pytest.raises(ValueError, match=words):
        fsw.export_c(design("paper"), tmp_path / "out", name=name)
    assert not (tmp_path / "out").exists()


def test_only_a_controller_has_firmware(tmp_path):
    with pytest.raises(ValueError, match="give a Controller"):
        fsw.export_c(fsw.baselines.Relay(VALVE, [0, 1], 1e-3), tmp_path / "out")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="give another folder"):
        fsw.export_c(design("paper"), tmp_path / "file")


@pytest.mark.parametrize("hurdle", ["library.json", "examples"])
def test_an_older_folder_stays_whole_where_a_file_has_no_place(tmp_path, hurdle):
    folder = tmp_path / "out"
    fsw.export_c(design("paper"), folder)
    older = (folder / "foreswitch_design.h").read_bytes()
    if hurdle == "examples":
        shutil.rmtree(folder / hurdle)
        (folder / hurdle).write_text("")
    else:
        (folder / hurdle).unlink()
        (folder / hurdle).mkdir()
    with pytest.raises(ValueError, match=f"{hurdle} is a (file|folder).*; give another folder"):
        fsw.export_c(design("Kalman"), folder)
    assert (folder / "foreswitch_design.h").read_bytes() == older


@pytest.mark.parametrize(
    "name", ['level ["Hg]', "a\\b", "**//", "/*x", "/*/", "*/ int x; /*", "\u202eabc", "x\ny", "??/"]
)
def test_any_name_of_an_output_goes_into_comments_and_json(tmp_path, name):
    fsw.export_c(fsw.Controller(VALVE.replace(output_names=[name]), [0, 1], 1e-3, ENDPOINT), tmp_path)
    assert json.loads((tmp_path / "library.json").read_text())["description"].startswith("controller: ")
    for compiler in COMPILERS:
        code, said = spoken(compiler, *STRICT, "-o", tmp_path / "t", tmp_path / "selftest.c", *sources(tmp_path))
        assert (code, said) == (0, "")


@pytest.mark.parametrize(
    ("Ts", "line"),
    [(1e-3, "due += 1000UL;"), (1 / 3000, "due += 333UL; // 0.1 % off: a timer can be closer"),
     (2.5e-6, "due += 3UL; // 20 % off: a timer can be closer"), (5000.0, "due += 5000000UL;")],
)  # fmt: skip
def test_the_sketch_keeps_the_period(tmp_path, Ts, line):
    plant = fsw.Plant.integrator_lag(k=1.0, c=Ts, L=3 * Ts)
    fsw.export_c(fsw.Controller(plant, [0, 1], Ts, fsw.Endpoint(3 * Ts, 1 / Ts)), tmp_path)
    sketch = (tmp_path / "examples" / "controller" / "controller.ino").read_text()
    assert f"  {line}\n" in sketch
    assert sketch.count("micros()") == (0 if Ts > 2000 else 2)
    assert f"{Ts:g} s */" in (tmp_path / "README.md").read_text()


@pytest.mark.parametrize(("real", "growth"), [("float32", 7.0), ("float32", 30.0), ("float64", 20.0)])
def test_what_runs_away_is_recorded_in_finite_numbers(tmp_path, real, growth):
    plant = fsw.Plant([[growth]], [[1.0]], input_delay=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        law = fsw.Controller(plant, [-1, 1], 0.1, fsw.Endpoint(0.1, 5.0), real=real)
    fsw.export_c(law, tmp_path)
    spoken(COMPILERS[0], *STRICT, "-o", tmp_path / "selftest", tmp_path / "selftest.c", *sources(tmp_path))
    assert re.fullmatch(r"\d+ passed, 0 failed\n", spoken(tmp_path / "selftest")[1])


@pytest.mark.parametrize(("real", "weight"), [("float32", 1e39), ("float64", 1e308)])
def test_a_design_that_overflows_is_refused(tmp_path, real, weight):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy tells of the overflow
        law = fsw.Controller(VALVE, [0, 1], 1e-3, fsw.Endpoint(0.02, 2500.0, weight=weight), real=real)
    with pytest.raises(ValueError, match=f"real is '{real}', in which .* overflows?; choose smaller weights"):
        fsw.export_c(law, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_golden_steps_know_every_status_and_many_commands():
    for name in DESIGNS:
        golden = golden_steps(design(name))
        statuses = {"OK", "COASTING", "HELD"} | ({"SAFE"} if name in ("vented", "dwell", "horizon") else set())
        assert {fsw.Status(code).name for code in golden.status} == statuses, name
        assert len(np.unique(golden.command, axis=0)) > 1, name
        assert 32 <= len(golden) <= 256
        used = golden.cost[golden.status == fsw.Status.OK]
        assert len(np.unique(used)) > len(golden) / 4, name
        assert np.isfinite(golden.cost).all()


# What compilers make of it --------------------------------------------------------------------------------------------


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


# Sizes and figures ----------------------------------------------------------------------------------------------------


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


# Command line ---------------------------------------------------------------------------------------------------------


def test_export_writes_firmware_that_passes_its_selftest(valve_line, tmp_path):
    arguments = ("export", "valve/project.toml", "c", "build/firmware", "--real", "float32", "--name", "valve")
    code, out, err = valve_line(*arguments)
    assert (code, err) == (0, "")
    assert "float32" in out
    assert "make -C build/firmware selftest" in out
    code, said = spoken("make", "-C", "build/firmware", "selftest")
    assert code == 0, said
    code, out, _ = valve_line(*arguments, "--json")
    assert code == 0
    assert json.loads(out)["name"] == "valve"
    assert "#define FSW_SINGLE" in Path("build/firmware/foreswitch_design.h").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("d", "out"), "known are"), (("c", "out", "--real", "half"), "real is 'half'"),
     (("c", "out", "--name", "int"), "name is"), (("c",), "DIR")],
)  # fmt: skip
def test_a_bad_export_is_one_sentence_and_nothing_is_written(valve_line, arguments, words):
    code, out, err = valve_line("export", "valve/project.toml", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert not Path("out").exists()
