"""The C core: golden vectors in both arithmetics, its edges, and what firmware asks of it."""

import json
import os
import shutil
import subprocess
import tomllib
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from core import fuzz
from core.compiling import COMPILERS, STRICT, compiled
from places import CORE, ROOT, TESTS, VECTORS
from vectors import make
from vectors.make import number

HERE = Path(__file__).parent
REALS = {"float64": [], "float32": ["-DFSW_SINGLE"]}
SOURCES = [CORE / "foreswitch.c", CORE / "horizon.c"]
HEADERS = [CORE / "foreswitch.h", CORE / "arithmetic.h", CORE / "horizon.h"]
MOVES = "-DFSW_MAX_MOVES=20"
BUILDS = {
    "float64": ["-O1", MOVES],
    "float32": ["-O1", "-DFSW_SINGLE", MOVES],
    "float32, for size": ["-Os", "-DFSW_SINGLE", MOVES, "-DFSW_RECORDS=0"],
    "without a horizon": ["-O1"],
}


pytestmark = pytest.mark.skipif(not COMPILERS, reason="needs a C compiler")


@pytest.fixture(scope="session", params=BUILDS)
def program(request, tmp_path_factory):
    """tests/core/test_core.c, with the address and undefined-behaviour sanitizers where they link."""
    target = tmp_path_factory.mktemp("core") / request.param
    sources = [HERE / "test_core.c", *SOURCES]
    plain = [*STRICT, "-g", *BUILDS[request.param], f"-I{CORE}", "-o", target, *sources, "-lm"]
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover"]
    if not compiled(*sanitizers, *plain)[0]:
        done, errors = compiled(*plain)
        assert done, errors
    return target


# Golden vectors -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_core_takes_the_golden_steps_and_survives_its_edges(program, path):
    """The edges (NaN, denormals, restarts, counters, refused designs) are tried on the paper's controller."""
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    done = subprocess.run([program, path], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    passed, failed = (int(word) for word in done.stdout.split() if word.isdigit())
    assert failed == 0
    if path.stem.startswith("horizon") and program.name == "without a horizon":
        assert passed == 2
    else:
        assert passed > (300 if path.stem in ("paper", "horizon") else 100)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_python_takes_the_same_steps(path, real):
    """Problem in, commands out: design and core together."""
    vector = json.loads(path.read_text())
    case = {"problem": vector["problem"], "bad_limit": vector["problem"].pop("bad_limit"), **vector["start"]}
    controller = make.controller(case, real)
    assert len(vector["steps"]) >= 3
    for k, step in enumerate(vector["steps"]):
        reference = np.array(step["reference"])
        arguments = number(step["x"]), reference if "horizon" in vector else reference[None]
        given = {"disturbance": number(step["w"])} if step["w"] else {}
        decision = controller.decide(*arguments, **given)
        assert controller.step(*arguments, **given).tolist() == step["u"] == decision.u.tolist(), k
        assert controller.status.name == step["status"] == decision.status.name, k
        if step.get("estimate") is not None:
            tolerance = 1e-9 if real == "float64" else 1e-3
            expected = np.array(step["estimate"])
            assert np.concatenate(controller.estimate) == pytest.approx(expected, rel=tolerance, abs=tolerance), k
        if step["costs"] is not None:
            costs = np.array(number(step["costs"]))
            largest = costs[np.isfinite(costs)].max()
            assert decision.costs == pytest.approx(costs, rel=0, abs=largest * (1e-9 if real == "float64" else 1e-3)), k


def test_the_golden_files_are_what_make_writes():
    """To round-off: the last digits of a matrix exponential are the machine's."""
    fresh = {name: json.loads(make.text(content)) for name, content in make.vectors().items()}
    assert sorted(fresh) == [path.stem for path in VECTORS]
    for path in VECTORS:
        stored = json.loads(path.read_text())
        if "horizon" in stored:
            assert_same(squared_metric(fresh[path.stem]), squared_metric(stored), f"{path.stem}: metric, squared")
        assert_same(fresh[path.stem], stored, path.stem)


def squared_metric(vector):
    """The metric M of core/horizon.h, taken out, as the quadratic form |M (x, u)|^2 in states and candidates.

    It is a root by eigenvectors: their signs, and rows of eigenvalues that only rounding keeps from zero, are the
    machine's own.
    """
    sizes, design = vector["horizon"], vector["design"]
    K, n, C = sizes["moves"], sizes["states"], design["candidates"]
    rows = n + design["inputs"]
    metric = np.reshape(sizes.pop("metric"), (K, rows, n))
    from_metric = np.reshape(sizes.pop("from_metric"), (K, C, rows))
    whole = np.concatenate([metric, from_metric.transpose(0, 2, 1)], axis=2)
    return np.einsum("kri,krj->kij", whole, whole).ravel().tolist()


def assert_same(fresh, stored, where):
    """Equal structure and words, numbers equal to round-off."""
    if isinstance(stored, dict):
        assert list(fresh) == list(stored), where
        for key in stored:
            assert_same(fresh[key], stored[key], f"{where}: {key}")
    elif isinstance(stored, list) and stored and all(type(item) is float for item in stored):
        largest = max(map(abs, stored))
        assert fresh == pytest.approx(stored, rel=1e-9, abs=1e-12 * largest), where
    elif isinstance(stored, list):
        assert len(fresh) == len(stored), where
        for i, (a, b) in enumerate(zip(fresh, stored, strict=True)):
            assert_same(a, b, f"{where}[{i}]")
    elif isinstance(stored, float):
        assert fresh == pytest.approx(stored, rel=1e-9), where
    else:
        assert fresh == stored, where


def test_the_golden_files_hold_what_they_are_for():
    """Every status, every level, dwell that forbids, and no close decision."""
    vectors = {path.stem: json.loads(path.read_text()) for path in VECTORS}
    statuses = {step["status"] for vector in vectors.values() for step in vector["steps"]}
    assert statuses == {"OK", "COASTING", "HELD", "SAFE"}
    for name, vector in vectors.items():
        commands = {tuple(step["u"]) for step in vector["steps"]}
        assert len(commands) > 1, name
    dwell = vectors["dwell"]["steps"]
    assert any("inf" in step["costs"] for step in dwell)
    assert {step["u"][0] for step in dwell} == {-1.0, 0.0, 1.0}
    assert len(vectors["two_inputs"]["design"]["candidate"]) == 2 * 4
    assert {vector["horizon"]["tail"] for vector in vectors.values() if "horizon" in vector} == {0, 1, 2}
    two = vectors["horizon_two_inputs"]
    assert two["horizon"]["lead"] > 0 < two["horizon"]["terminal"]
    assert two["horizon"]["moves"] < two["horizon"]["steps"]
    assert len({tuple(step["u"]) for step in two["steps"]}) >= 3
    for vector in vectors.values():
        margin = make.MARGIN_OF_HORIZON if "horizon" in vector else make.MARGIN
        for step in vector["steps"]:
            finite = sorted(c for c in number(step["costs"] or [0.0]) if isfinite(c))
            assert len(finite) == 1 or finite[1] > (1 + margin) * finite[0]


CALLS = {"fsw_init", "fsw_preload", "fsw_dwell_left", "fsw_start", "fsw_issued", "fsw_decide", "fsw_step", "fsw_track",
         "fsw_missed", "fsw_safe"}  # fmt: skip

# Any bytes ------------------------------------------------------------------------------------------------------------


def replayed(folder, real, core=CORE):
    """Exit code and words of a replay of what the fuzzer once found worth keeping."""
    target = folder / "fuzz"
    given = [*fuzz.arguments(real, core), "-DREPLAY", "-o", target]
    if not compiled(*fuzz.SANITIZERS, *given)[0]:
        pytest.skip("needs the address and undefined-behaviour sanitizers")
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    with fuzz.CORPUS.open() as corpus:
        done = subprocess.run([target], stdin=corpus, capture_output=True, text=True, env=environment)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("real", REALS)
def test_any_bytes_are_refused_or_run_clean(tmp_path, real):
    """The corpus of tests/core/fuzz.py; that script looks for more."""
    code, said = replayed(tmp_path, real)
    assert code == 0, said
    assert said == f"{len(fuzz.CORPUS.read_text().split())} replayed\n"


HOLES = {
    "a dead time beyond the line": "d->pending[j] >= d->rows || ",
    "a level that is none": "if (*command++ >= d->level_count[j]) return 0;",
    "levels out of order": " || (i > 0 && !(level[i - 1] < level[i]))",
    "a dwell of no period": "dwell[i] == 0 || ",
    "no holding time": "d->holds[j] == 0 || ",
    "more loads than disturbances": " || d->loads > d->disturbances",
    "a line too long": " || (uint32_t)d->rows * d->inputs > FSW_MAX_LINE",
    "more moves than steps": "h->moves > h->steps ||",
    "a reference that is not there": "h->lead >= h->steps || ",
    "a terminal cost too large": " || h->terminal > h->states",
    "other commands in the horizon": "h->level[i] != d->candidate[i] || ",
}


@pytest.mark.parametrize("hole", HOLES)
def test_the_bytes_find_a_check_that_is_left_out(tmp_path, hole):
    for path in (*SOURCES, *HEADERS):
        shutil.copy(path, tmp_path)
    source = tmp_path / "foreswitch.c"
    assert HOLES[hole] in source.read_text()
    source.write_text(source.read_text().replace(HOLES[hole], "command++;" if hole == "a level that is none" else ""))
    assert replayed(tmp_path, "float64", tmp_path)[0] != 0


# Firmware -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """The core compiled freestanding, per source, compiler, arithmetic and optimisation; no warning is let through."""
    folder = tmp_path_factory.mktemp("objects")
    made = {}
    for compiler in COMPILERS:
        for real, define in REALS.items():
            for level, moves in (("-O0", [MOVES]), ("-O2", [MOVES]), ("-Os", [MOVES, "-DFSW_RECORDS=0"]), ("-O2", [])):
                for source in SOURCES:
                    name = f"{source.stem}_{Path(compiler).name}_{real}{level}{'' if moves else '_endpoint'}"
                    target = folder / f"{name}.o"
                    arguments = [*STRICT, "-ffreestanding", level, *define, *moves, "-c", source, "-o", target]
                    done, errors = compiled(*arguments, compiler=compiler)
                    assert done, errors
                    made[name] = target
    return made


def symbols(path):
    """Type and name of every symbol."""
    lines = subprocess.run(["nm", "-P", path], capture_output=True, text=True, check=True).stdout.splitlines()
    return [(line.split()[1], line.split()[0].lstrip("_")) for line in lines]


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm")
def test_the_core_calls_nothing_and_owns_no_writable_data(objects):
    """What a freestanding compiler itself may call is all it may need: no heap, no stdio, no mathematics library."""
    assert objects
    for name, path in objects.items():
        found = symbols(path)
        undefined = {symbol for kind, symbol in found if kind in "Uvw"}
        ours = {symbol for symbol in undefined if symbol.startswith("fsw_horizon_")}
        assert undefined - ours <= {"memcpy", "memset", "memmove", "memcmp"}, name
        assert not ours or (name.startswith("foreswitch") and not name.endswith("endpoint")), name
        assert not [symbol for kind, symbol in found if kind in "bBdDcCsS"], name
        public = {symbol for kind, symbol in found if kind == "T"}
        if name.startswith("foreswitch"):
            assert public >= CALLS, name
        elif name.endswith("endpoint"):
            assert not public, name
        else:
            assert public == {"fsw_horizon_prepare", "fsw_horizon_search", "fsw_horizon_cost"}, name
        assert all(symbol.startswith("fsw_") for symbol in public), name


def test_the_sources_use_neither_heap_nor_stdio():
    texts = [path.read_text() for path in (*SOURCES, *HEADERS)]
    headers = {line.split()[1] for text in texts for line in text.splitlines() if line.startswith("#include")}
    assert headers == {'"foreswitch.h"', '"arithmetic.h"', '"horizon.h"', '"foreswitch_design.h"', "<stdint.h>"}


@pytest.mark.parametrize("path", sorted(CORE.rglob("*.[ch]")), ids=lambda path: path.name)
def test_each_source_begins_with_version_and_licence(path):
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    first = path.read_text().splitlines()[0]
    assert first == f"/* foreswitch {package['version']}, SPDX-License-Identifier: {package['license']} */"


def test_the_header_says_the_package_s_version(tmp_path):
    """As the preprocessor sees it, so that a program may ask."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    major, minor = version.split(".")[:2]
    for wanted, fits in ((minor, True), (int(minor) + 1, False)):
        source = tmp_path / "ask.c"
        source.write_text(
            '#include "foreswitch.h"\n'
            f"#if FSW_VERSION_MAJOR != {major} || FSW_VERSION_MINOR != {wanted}\n#error another\n#endif\n"
        )
        assert compiled(*STRICT, f"-I{CORE}", "-fsyntax-only", source)[0] == fits


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_the_header_is_also_cpp(tmp_path):
    source = tmp_path / "use.cpp"
    source.write_text(
        '#include "foreswitch.h"\n#include "foreswitch.h"\nint main() { return sizeof(fsw_state) == 0; }\n'
    )
    flags = ["-std=c++11", "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{CORE}", "-fsyntax-only"]
    for moves in ([], [MOVES]):
        done, errors = compiled(*flags, *moves, source, compiler=shutil.which("g++"))
        assert done, errors


PAPER_LIMITS = {"STATES": 2, "INPUTS": 1, "OUTPUTS": 1, "DISTURBANCES": 1, "LINE": 6}


@pytest.mark.parametrize(("most", "fits"), [(96, True), (16, False)])
def test_the_state_of_the_papers_controller_fits_96_bytes(tmp_path, most, fits):
    """As the compiler sees it, so that a cross compiler could be asked too; 16 bytes show that it looks."""
    source = tmp_path / "size.c"
    source.write_text(f'#include "foreswitch.h"\nextern char fits[sizeof(fsw_state) <= {most} ? 1 : -1];\n')
    limits = [f"-DFSW_MAX_{name}={value}" for name, value in PAPER_LIMITS.items()]
    done, _ = compiled(*STRICT, "-DFSW_SINGLE", *limits, f"-I{CORE}", "-fsyntax-only", source)
    assert done == fits


HORIZON_LIMITS = PAPER_LIMITS | {"STEPS": 20, "MOVES": 20}


@pytest.mark.parametrize(("records", "most", "fits"), [(0, 2048, True), (2, 2048, True), (2, 512, False)])
def test_the_state_of_twenty_periods_of_the_hot_gas_fits_2_kilobytes(tmp_path, records, most, fits):
    """In single precision, two levels; 512 bytes show that it looks."""
    source = tmp_path / "size.c"
    source.write_text(f'#include "foreswitch.h"\nextern char fits[sizeof(fsw_state) <= {most} ? 1 : -1];\n')
    limits = [f"-DFSW_MAX_{name}={value}" for name, value in HORIZON_LIMITS.items()]
    limits += ["-DFSW_HORIZON_STATES=2", "-DFSW_HORIZON_CANDIDATES=2", f"-DFSW_RECORDS={records}"]
    done, _ = compiled(*STRICT, "-DFSW_SINGLE", *limits, f"-I{CORE}", "-fsyntax-only", source)
    assert done == fits


def test_more_than_a_byte_counts_is_refused_by_the_compiler():
    for limit in ("-DFSW_HORIZON_CANDIDATES=256", "-DFSW_RECORDS=128"):
        done, errors = compiled(*STRICT, MOVES, limit, "-fsyntax-only", CORE / "horizon.c")
        assert not done
        assert "they are counted in bytes" in errors


SAID = "DISTURBANCES=0 LOADS=0 CANDIDATES=2 ESTIMATOR=0 SWITCH_COST=0 OFFSET=0 SPLIT=0 HELD_ONCE=1"
FIXED = ["-DFSW_FIXED", *(f"-DFSW_{word}" for word in SAID.split())]
PAPER_FIXED, HORIZON_FIXED = [*FIXED, "-DFSW_ORDER=2", "-DFSW_REST=1"], [*FIXED, "-DFSW_ORDER=1", "-DFSW_REST=0"]
CUT = {
    "paper": ([], PAPER_LIMITS),
    "paper, fixed": (PAPER_FIXED, PAPER_LIMITS),
    "horizon": (HORIZON_FIXED, PAPER_LIMITS | {"STEPS": 10, "MOVES": 10}),
    "horizon, for size": ([*HORIZON_FIXED, "-Os", "-DFSW_RECORDS=0"], PAPER_LIMITS | {"STEPS": 10, "MOVES": 10}),
}


@pytest.mark.parametrize("name", CUT)
def test_a_core_cut_to_size_takes_the_same_steps(name, tmp_path):
    """The limits of the design, as an exported one would set them."""
    flags, limits = CUT[name]
    limits = [f"-DFSW_MAX_{key}={value}" for key, value in limits.items()]
    if name.startswith("horizon"):
        limits += ["-DFSW_HORIZON_STATES=2", "-DFSW_HORIZON_CANDIDATES=2"]
    target = tmp_path / "cut"
    sources = [HERE / "test_core.c", *SOURCES]
    done, errors = compiled(*STRICT, "-O2", "-DFSW_SINGLE", *flags, *limits, f"-I{CORE}", "-o", target, *sources, "-lm")
    assert done, errors
    ran = subprocess.run([target, TESTS / "vectors" / f"{name.split(',')[0]}.json"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout
