"""The life of an FMU: states saved and restored, resets, instances beside each other, bad inputs."""

import numpy as np
import pytest

import foreswitch as fsw
from export.fmu.instances import CASES, NEEDS_COMPILER, told
from systems import quiet, valve_controller

pytestmark = NEEDS_COMPILER


@pytest.mark.parametrize("name", ["endpoint", "horizon of two inputs"])
def test_state_is_saved_and_restored_in_mid_run(exported, opened, name):
    law, path = quiet(CASES[name][0], "float64"), exported(name)
    fmu, other = opened(path), opened(path)
    recorded = list(told(name, law, 300))

    def go(instance, steps):
        shown = []
        for x, reference, w, *_ in steps:
            instance.set(x, reference, w)
            instance.advance(law.Ts)
            shown.append([*instance.get("command"), *instance.get("cost"), *instance.get("estimate")])
        return shown

    go(fmu, recorded[:150])
    state, time = fmu.slave.getFMUstate(), fmu.time
    x, reference, w, *_ = recorded[0]
    fmu.set(x, reference, w)
    expected = go(fmu, recorded[150:])
    assert [row[: law.plant.inputs] for row in expected] == [u.tolist() for *_, u, _ in recorded[150:]]
    data = fmu.slave.serializeFMUstate(state)
    for instance, given in ((fmu, state), (other, other.slave.deSerializeFMUstate(data))):
        instance.slave.setFMUstate(given)
        instance.time = time
        assert go(instance, recorded[150:]) == expected
        instance.slave.freeFMUstate(given)
    assert fmu.slave.serializeFMUstate(fmu.slave.getFMUstate()) != data


def test_reset_begins_anew(exported, opened):
    law, fmu = valve_controller(), opened(exported("paper"))
    recorded = list(told("paper", law, 100))
    for _ in range(2):
        for x, reference, w, u, _ in recorded:
            fmu.set(x, reference, w)
            fmu.advance(law.Ts)
            assert fmu.get("command") == u.tolist()
        fmu.slave.terminate()
        fmu.slave.reset()
        fmu.time = 0.0
        fmu.slave.setupExperiment(startTime=0.0)
        assert fmu.slave.getReal(range(fmu.inputs)) == [0.0] * fmu.inputs
        fmu.begin()


def test_instances_do_not_know_of_each_other(exported, opened):
    """Outputs of one FMU and of another, step by step."""
    laws = [quiet(CASES[name][0], "float64") for name in ("horizon", "horizon", "paper")]
    fmus = [opened(exported("horizon")), opened(exported("horizon")), opened(exported("paper"))]
    runs = [
        told(name, law, 500, seed)
        for seed, (name, law) in enumerate(zip(("horizon", "horizon", "paper"), laws, strict=True))
    ]
    for rows in zip(*runs, strict=True):
        for law, fmu, (x, reference, w, u, _) in zip(laws, fmus, rows, strict=True):
            fmu.set(x, reference, w)
            fmu.advance(law.Ts)
            assert fmu.get("command") == u.tolist()


def test_a_bad_reference_holds_the_command(exported, opened):
    fmu = opened(exported("paper"))
    fmu.set([0.0, 0.0], [900.0, 0.0])
    fmu.advance(1e-3)
    for bad in (np.nan, np.inf, 1e300):
        fmu.set([900.0, 0.0], [0.0, bad])
        fmu.advance(1e-3)
        assert fmu.get("command") == [1.0]
        assert fmu.get("status") == [fsw.Status.HELD]
    fmu.set([900.0, 0.0], [0.0, 0.0])
    fmu.advance(1e-3)
    assert fmu.get("command") + fmu.get("status") == [0.0, fsw.Status.OK]


def test_inputs_start_at_values_set_before_initialization(exported, opened):
    fmu = opened(exported("paper"))
    fmu.slave.reset()
    fmu.set([0.0, 0.0], [900.0, 0.0])
    fmu.slave.setupExperiment(startTime=5.0)
    fmu.time = 5.0
    fmu.begin()
    assert fmu.get("command") == [1.0]
    fmu.advance(1e-3)
    assert fmu.get("command") == [1.0]
    with pytest.raises(Exception, match="fmi2SetReal"):
        fmu.slave.setReal([fmu.variables["Ts"].valueReference], [1.0])
    with pytest.raises(Exception, match="fmi2DoStep"):
        fmu.slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e-3)
