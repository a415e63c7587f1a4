"""What cannot be exported as an FMU is refused in one sentence."""

import json
from pathlib import Path

import pytest

import foreswitch as fsw
from core.compiling import COMPILERS
from export.fmu.instances import NEEDS_COMPILER, fmpy, validate_fmu
from systems import VALVE, valve_controller

pytestmark = NEEDS_COMPILER


def test_mistakes_are_one_sentence_and_leave_nothing(tmp_path, monkeypatch):
    law = valve_controller()
    for arguments, options, words in [
        ((VALVE, tmp_path / "a.fmu"), {}, "controller is a Plant"),
        ((law, tmp_path / "a.fmu"), {"name": "2"}, "name is '2'"),
        ((law, tmp_path / "a.zip"), {}, "ends in .fmu"),
        ((law, tmp_path), {}, "ends in .fmu"),
    ]:
        with pytest.raises(ValueError, match=words):
            fsw.export_fmu(*arguments, **options)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(
        ValueError, match=r"no C compiler is found \(no-such-compiler\); install one, or give binary=False"
    ):
        fsw.export_fmu(law, tmp_path / "a.fmu")
    monkeypatch.setenv("CC", f"{COMPILERS[0]} -no-such-option")
    with pytest.raises(ValueError, match=r"no-such-option fails \(.*no-such-option.*\); set CC"):
        fsw.export_fmu(law, tmp_path / "a.fmu")
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"no C compiler is found \(gcc, clang, cc\)"):
        fsw.export_fmu(law, tmp_path / "a.fmu")
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(ValueError, match=r"no name for .* on riscv64; give binary=False"):
        fsw.export_fmu(law, tmp_path / "a.fmu")
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="cannot be written"):
        fsw.export_fmu(law, tmp_path / "file" / "a.fmu", binary=False)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    fsw.export_fmu(law, tmp_path / "new" / "a.fmu", binary=False)
    assert validate_fmu(str(tmp_path / "new" / "a.fmu")) == []


def test_the_command_line_exports_an_fmu(valve_line):
    code, out, err = valve_line("export", "valve/project.toml", "fmu", "build/controller.fmu", "--real", "float32")
    assert (code, err) == (0, "")
    assert out.startswith("build/controller.fmu: FMI 2.0 for co-simulation, binary and sources, float32")
    assert fmpy.supported_platforms("build/controller.fmu") == ["c-code", fmpy.platform]
    code, out, _ = valve_line(
        "export", "valve/project.toml", "fmu", "build/s.fmu", "--source-only", "--name", "valve", "--json"
    )
    assert code == 0
    assert json.loads(out)["name"] == "valve"
    assert fmpy.read_model_description("build/s.fmu").modelName == "valve"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("fmi", "a.fmu"), "did you mean 'fmu'"),
        (("fmu", "a.txt"), "ends in .fmu"),
        (("c", "a", "--source-only"), "leave it out"),
    ],
)
def test_a_bad_export_is_one_sentence_and_nothing_is_written(valve_line, arguments, words):
    code, out, err = valve_line("export", "valve/project.toml", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert not Path("a").exists()
    assert not Path(arguments[1]).exists()


def test_messages_reach_the_masters_logger(exported, tmp_path):
    """With the value that is wrong, by the logger of the instance."""
    said = []
    kind = fmpy.fmi2.fmi2CallbackLoggerTYPE
    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = kind(lambda *given: said.append((given[1], given[2], given[3], given[4])))
    callbacks.allocateMemory = fmpy.fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmpy.fmi2.defaultCallbacks.freeMemory
    description = fmpy.read_model_description(str(exported("paper")))
    slave = fmpy.fmi2.FMU2Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(str(exported("paper")), str(tmp_path)), instanceName="valve",
        modelIdentifier="controller",
    )  # fmt: skip
    slave.instantiate(callbacks=callbacks, loggingOn=True)
    slave.setupExperiment()
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.setReal([0], [float("nan")])
    slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e-3)
    assert said[-1][:3] == (b"valve", 1, b"logStatusWarning")
    assert b"connect all inputs" in said[-1][3]
    with pytest.raises(Exception, match="fmi2GetReal"):
        slave.getReal([99])
    assert said[-1][:3] == (b"valve", 3, b"logStatusError")
    slave.freeInstance()
