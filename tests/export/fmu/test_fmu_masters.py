"""An FMU under masters: beside the FMU of a plant, and in FMPy's own."""

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import foreswitch as fsw
from core.compiling import COMPILERS
from export.fmu.instances import NEEDS_COMPILER, fmpy, spoken
from places import DOCS, TESTS
from systems import RISE, VALVE, valve_controller

pytestmark = NEEDS_COMPILER


@pytest.fixture
def plant(tmp_path):
    """The hot gas behind no dead time, as an FMU: tests/fmu/valve.c."""
    headers = Path(fmpy.__file__).parent / "c-code"
    command = [COMPILERS[0], "-std=c99", "-shared", "-fPIC", "-O2", f"-isystem{headers}", "-o", tmp_path / "valve.so",
               TESTS / "fmu" / "valve.c", "-lm"]  # fmt: skip
    assert spoken(*command)[0] == 0
    with zipfile.ZipFile(tmp_path / "plant.fmu", "w") as archive:
        archive.write(TESTS / "fmu" / "modelDescription.xml", "modelDescription.xml")
        archive.write(tmp_path / "valve.so", f"binaries/{fmpy.platform}/valve.so")
    return tmp_path / "plant.fmu"


@pytest.mark.skipif(fmpy.platform != "linux64", reason="the plant is built for Linux")
def test_controller_and_plant_are_two_fmus(plant, tmp_path, monkeypatch):
    """The master of docs/guide/fmu.md, run as it stands there, gives the run of `simulate`."""
    law = valve_controller(VALVE.replace(input_names=["valve"], output_names=["pressure [kPa]"]))
    fsw.export_fmu(law, tmp_path / "controller.fmu")
    page = (DOCS / "guide/fmu.md").read_text()
    master = next(each for each in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if '"plant.fmu"' in each)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(master, "docs/guide/fmu.md", "exec"), names)
    commands = np.array(names["commands"])
    reference = fsw.Sine(500.0, 2.0, offset=500.0)
    run = fsw.simulate(valve_controller(), reference, len(commands) * 1e-3)
    assert len(commands) >= 500
    assert len(np.unique(commands)) == 2
    assert np.array_equal(run.u[:, 0], commands)
    assert names["pressure"] == pytest.approx(run.x[-1, 0], rel=1e-8)


def test_fmpy_simulates_it(exported):
    """Its own master, on a recorded measurement: a command is recorded at the end of its period."""
    law = valve_controller()
    run = fsw.simulate(valve_controller(), RISE, 0.3)
    reference = RISE(run.t)[:, 0, :2]
    kinds = [(name, float) for name in ("time", "measured.x[1]", "measured.x[2]", "reference.y", "reference.y_der")]
    signals = np.zeros(len(run.u), dtype=kinds)
    for (name, _), column in zip(kinds, (run.t, run.x[:, 0], run.x[:, 1], *reference.T), strict=True):
        signals[name] = column[:-1]
    result = fmpy.simulate_fmu(
        str(exported("paper")), stop_time=0.299, output_interval=law.Ts, input=signals, output=["command.u", "status"]
    )
    assert np.array_equal(result["command.u"][1:], run.u[:299, 0])
    assert result["command.u"][0] == run.u[0, 0]
    assert len(np.unique(run.u)) == 2
