"""The sources of an FMU: sanitizers and compilers have nothing to say of them."""

import re
import shutil
from pathlib import Path

import pytest

import foreswitch as fsw
from core.compiling import COMPILERS, STRICT
from export.fmu.instances import CASES, NEEDS_COMPILER, build_platform_binary, fmpy, sources, spoken, told, validate_fmu
from places import CORE, TESTS
from systems import quiet

pytestmark = NEEDS_COMPILER


@pytest.mark.parametrize("name", CASES)
def test_the_shell_under_the_sanitizers(exported, tmp_path, name):
    """Its life, every refusal, saved and damaged states, two at once, odd steps and inputs: tests/fmu/driver.c."""
    for real, compiler in (("float64", COMPILERS[0]), ("float32", COMPILERS[-1])):
        folder = sources(exported(name, real), tmp_path / real)
        files = [TESTS / "fmu" / "driver.c", *sorted(folder.glob("*.c"))]
        command = [compiler, *STRICT, "-g", f"-I{folder}", "-o", tmp_path / "driver", *files, "-lm"]
        code, said = spoken(*command, "-fsanitize=address,undefined", "-fno-sanitize-recover")
        if code:  # without them where they do not link
            code, said = spoken(*command)
        assert (code, said) == (0, "")
        code, said = spoken(tmp_path / "driver")
        assert code == 0, said
        assert re.search(r"^[1-9]\d{4,} passed, 0 failed$", said, re.MULTILINE), said


def test_compilers_have_nothing_to_say(exported, tmp_path):
    for name in CASES:
        for real in ("float64", "float32"):
            folder = sources(exported(name, real), tmp_path / f"{name}{real}")
            for compiler in COMPILERS:
                command = [compiler, *STRICT, "-Wshadow", "-Wsign-conversion", "-O2", "-c", folder / "fmi.c"]
                assert spoken(*command, "-o", tmp_path / "fmi.o") == (0, "")


def test_the_standards_own_headers_agree(exported, tmp_path):
    """Every type, value and function; and one that differs is noticed."""
    folder, headers = sources(exported("paper"), tmp_path), Path(fmpy.__file__).parent / "c-code"
    user = tmp_path / "user.c"
    user.write_text('#include "fmi2Functions.h"\n#include "fmi.c"\n')
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-isystem{headers}", f"-I{folder}", "-fsyntax-only"]
    assert spoken(COMPILERS[0], *flags, user) == (0, "")
    header = (folder / "fmi2.h").read_text()
    (folder / "fmi2.h").write_text(header.replace("fmi2Real size, fmi2Boolean", "float size, fmi2Boolean"))
    assert spoken(COMPILERS[0], *flags, user)[0] != 0
    values = tmp_path / "values.c"
    names = ["fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending", "fmi2ModelExchange",
             "fmi2CoSimulation", "fmi2DoStepStatus", "fmi2PendingStatus", "fmi2LastSuccessfulTime", "fmi2Terminated",
             "fmi2True", "fmi2False", "sizeof(fmi2CallbackFunctions)", "sizeof(fmi2ValueReference)", "sizeof(fmi2Real)",
             "sizeof(fmi2Boolean)", "sizeof(fmi2Integer)",
             "offsetof(fmi2CallbackFunctions, componentEnvironment)"]  # fmt: skip
    printed = "".join(f'printf("%d ", (int){name});' for name in names)
    said = set()
    (folder / "fmi2.h").write_text(header)
    for include in ("fmi2.h", "fmi2Functions.h"):
        values.write_text(
            f'#include <stdio.h>\n#include <stddef.h>\n#include "{include}"\nint main(void) {{ {printed} return 0; }}\n'
        )
        assert spoken(COMPILERS[0], f"-I{folder}", f"-I{headers}", values, "-o", tmp_path / "values") == (0, "")
        said.add(spoken(tmp_path / "values"))
    assert len(said) == 1


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm")
def test_the_library_shows_the_standards_names_alone(exported, tmp_path):
    sources(exported("horizon"), tmp_path)
    [library] = (tmp_path / "binaries").rglob("controller.*")
    code, said = spoken("nm", "-D", "--defined-only", library)
    assert code == 0
    names = {line.split()[2] for line in said.splitlines()}
    header = (CORE / "fmi" / "fmi2.h").read_text()
    assert names == set(re.findall(r"\b(fmi2\w+)\(", header[header.index("FMI2_Export const") :]))
    folder = Path(fmpy.__file__).parent / "c-code"
    standard = re.findall(r"FMI2_Export fmi2\w+TYPE\s+(fmi2\w+);", (folder / "fmi2Functions.h").read_text())
    exchange = {"fmi2EnterEventMode", "fmi2NewDiscreteStates", "fmi2EnterContinuousTimeMode", "fmi2CompletedIntegratorStep",
                "fmi2SetTime", "fmi2SetContinuousStates", "fmi2GetDerivatives", "fmi2GetEventIndicators",
                "fmi2GetContinuousStates", "fmi2GetNominalsOfContinuousStates"}  # fmt: skip
    assert names == set(standard) - exchange


def test_names_take_the_prefix_of_a_program_that_links_them(exported, tmp_path):
    folder = sources(exported("paper"), tmp_path)
    flags = [*STRICT, "-DFMI2_FUNCTION_PREFIX=controller_", "-c", folder / "fmi.c", "-o", tmp_path / "fmi.o"]
    assert spoken(COMPILERS[0], *flags) == (0, "")
    if shutil.which("nm"):
        said = spoken("nm", "--defined-only", tmp_path / "fmi.o")[1]
        names = {line.split()[2] for line in said.splitlines() if line.split()[1] == "T"}
        assert "controller_fmi2DoStep" in names
        assert all(name.startswith("controller_fmi2") for name in names)


@pytest.mark.skipif(not shutil.which("cmake"), reason="needs cmake")
@pytest.mark.parametrize("name", ["paper", "horizon"])
def test_an_fmu_of_sources_is_compiled_by_fmpy(tmp_path, opened, capfd, name):
    law = quiet(CASES[name][0], "float64")
    fsw.export_fmu(law, tmp_path / "sources.fmu", binary=False)
    assert validate_fmu(str(tmp_path / "sources.fmu")) == []
    assert fmpy.supported_platforms(str(tmp_path / "sources.fmu")) == ["c-code"]
    folder = tmp_path / "unpacked"
    sources(tmp_path / "sources.fmu", folder)
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, tmp_path / "build", all_warnings=True)
    assert "warning" not in "".join(capfd.readouterr())
    fmu = opened(tmp_path / "sources.fmu", folder=folder)
    for x, reference, w, u, _ in told(name, law, 500):
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()
