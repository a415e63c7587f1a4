"""What an FMU says of itself: names, units, starts and its identity."""

import zipfile

import numpy as np
import pytest

import foreswitch as fsw
from export.fmu.instances import CASES, NEEDS_COMPILER, fmpy, validate_fmu
from places import CORE
from systems import quiet, valve_controller

pytestmark = NEEDS_COMPILER


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", CASES)
def test_fmpy_finds_no_fault(exported, name, real):
    assert validate_fmu(str(exported(name, real))) == []


def test_starts_and_constants_in_the_file_are_those_in_the_library(exported, opened):
    for name in CASES:
        law, fmu = quiet(CASES[name][0], "float64"), opened(exported(name))
        fmu.slave.reset()
        listed = [v for v in fmu.variables.values() if v.start is not None]
        assert [float(v.start) for v in listed] == fmu.slave.getReal([v.valueReference for v in listed])
        assert fmu.get("Ts") == [law.Ts]
        assert fmu.get("dead_time") == law.plant.input_delay.tolist()
        assert fmu.get("level") == np.concatenate(law.levels).tolist()
        times = np.broadcast_to(law.reference_times.reshape(law.evaluations, -1), (law.evaluations, law.plant.outputs))
        assert fmu.get("reference_time") == times.ravel().tolist()
        assert fmu.description.defaultExperiment.stepSize == repr(law.Ts)


def test_names_and_units_are_those_of_the_plant(tmp_path):
    plant = fsw.Plant(
        [[-1.0, 1.0], [0.0, -2.0]], [[0.0, 0.0], [0.2, 1.0]], np.eye(2), E=[[1.0], [0.0]], input_delay=0.2,
        input_names=["fuel valve [l/h]", "fuel valve"], output_names=["Wärme <innen> [°C]", "2nd \"flow\"\n*/ [kg & s]"],
    )  # fmt: skip
    law = fsw.Controller(
        plant, [[0, 1], [0, 1]], 0.1, fsw.Horizon(3, lam=1.0), estimator=fsw.Kalman(1e-3, 1e-3), preview=True
    )
    fsw.export_fmu(law, tmp_path / "named.fmu", name="named")
    assert validate_fmu(str(tmp_path / "named.fmu")) == []
    found = {v.name: v for v in fmpy.read_model_description(str(tmp_path / "named.fmu")).modelVariables}
    names = [name for name, v in found.items() if v.causality in ("input", "output")]
    wanted = [
        f"reference.{name}{der}[{e}]"
        for name in ("W_rme_innen", "y_2nd_flow")
        for der in ("", "_der")
        for e in (1, 2, 3)
    ]
    assert names == [
        "measured.W_rme_innen", "measured.y_2nd_flow", *wanted, "disturbance[1]", "command.fuel_valve",
        "command.fuel_valve_2", "cost", "gap", "status", "nodes", "optimal",
    ]  # fmt: skip
    units = [
        found[name].unit for name in ("measured.W_rme_innen", "reference.y_2nd_flow_der[2]", "command.fuel_valve", "Ts")
    ]
    assert units == ["°C", "kg & s/s", "l/h", "s"]
    assert found["command.fuel_valve_2"].unit is None
    assert (
        found["reference.W_rme_innen_der[3]"].description
        == "Wanted derivative 1 of Wärme <innen>, 0.5 s after the decision"
    )
    assert [found[name].valueReference for name in wanted] == [2, 6, 10, 3, 7, 11, 4, 8, 12, 5, 9, 13]


def test_the_file_is_the_same_each_time(exported, tmp_path):
    law = quiet(CASES["horizon"][0], "float64")
    fsw.export_fmu(law, tmp_path / "again.fmu")
    assert (tmp_path / "again.fmu").read_bytes() == exported("horizon").read_bytes()
    with zipfile.ZipFile(tmp_path / "again.fmu") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.namelist()[0] == "modelDescription.xml"
        core = ("foreswitch.c", "foreswitch.h", "arithmetic.h", "horizon.c", "horizon.h", "fmi/fmi.c", "fmi/fmi2.h")
        for path in (CORE / file for file in core):
            assert archive.read(f"sources/{path.name}") == path.read_bytes()
        binary = next(name for name in archive.namelist() if name.startswith("binaries/"))
        assert str(tmp_path).encode() not in archive.read(binary)
    identity = {fmpy.read_model_description(str(exported(name))).guid for name in CASES}
    assert len(identity) == len(CASES)
    other = valve_controller(lam=2500.0 * (1 + 1e-15))
    fsw.export_fmu(other, tmp_path / "other.fmu", binary=False)
    assert fmpy.read_model_description(str(tmp_path / "other.fmu")).guid not in identity
