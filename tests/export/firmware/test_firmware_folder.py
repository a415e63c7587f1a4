"""What is in an exported folder, and how it is written from Python and from the command line."""

import json
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import foreswitch as fsw
from export.firmware.designs import COMPILERS, DESIGNS, ENDPOINT, NEEDS_COMPILER, STRICT, design, sources, spoken
from foreswitch.export.header import initialiser, number
from foreswitch.export.vectors import golden_steps
from places import CORE, ROOT
from systems import VALVE

pytestmark = NEEDS_COMPILER

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
