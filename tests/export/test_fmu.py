"""A controller as an FMU: valid, the same to the bit as in Python however it is stepped, safe against what masters do."""

import json
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

import foreswitch as fsw
from core.compiling import COMPILERS, STRICT
from places import CORE, DOCS, TESTS, VECTORS
from systems import RISE, VALVE, quiet, valve_controller
from targets.scenarios import BAD, CONTROLLERS, Truth
from vectors import make
from vectors.make import number

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install 'foreswitch[fmu]'")
from fmpy.build import build_platform_binary  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(not COMPILERS, reason="needs a C compiler")

STEPS = 10000

CASES = CONTROLLERS | {
    "paper": (lambda real: valve_controller(real=real), 500.0),
    "preview": (lambda real: valve_controller(VALVE.replace(E=[[-1.0], [0.0]], input_delay=0.0043), real=real,
                                              preview="lag", safe_level=0.0), 500.0),
}  # fmt: skip


class Fmu:
    """An instance, its variables by name."""

    def __init__(self, path, folder=None, start=0.0):
        self.description = fmpy.read_model_description(str(path))
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.folder = folder or fmpy.extract(str(path))
        self.own = folder is None
        self.slave = fmpy.fmi2.FMU2Slave(
            guid=self.description.guid, unzipDirectory=self.folder, instanceName="controller",
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )  # fmt: skip
        self.slave.instantiate()
        self.inputs = sum(v.causality == "input" for v in self.variables.values())
        self.time = start
        self.slave.setupExperiment(startTime=start)
        self.begin()

    def begin(self):
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def set(self, *parts):
        """All inputs, in the order of their value references, which is the core's."""
        values = np.concatenate([np.ravel(part) for part in parts]).tolist()
        assert len(values) == self.inputs
        self.slave.setReal(range(self.inputs), values)

    def advance(self, size):
        self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
        self.time += size

    def get(self, prefix):
        """Values of a name, or of all that begin with it."""
        found = [
            v for v in self.variables.values() if v.name == prefix or v.name.startswith((f"{prefix}.", f"{prefix}["))
        ]
        found.sort(key=lambda v: v.valueReference)
        call = {"Real": self.slave.getReal, "Integer": self.slave.getInteger, "Boolean": self.slave.getBoolean}
        return call[found[0].type]([v.valueReference for v in found]) if found else []

    def close(self):
        self.slave.freeInstance()
        if self.own:
            shutil.rmtree(self.folder)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Path of a design's FMU, written once."""
    folder, made = tmp_path_factory.mktemp("fmus"), {}

    def path(name, real="float64"):
        if (name, real) not in made:
            made[name, real] = folder / f"{len(made)}.fmu"
            fsw.export_fmu(quiet(CASES[name][0], real), made[name, real])
        return made[name, real]

    return path


@pytest.fixture
def opened():
    """Instances that are closed at the end."""
    found = []

    def build(*arguments, **options):
        found.append(Fmu(*arguments, **options))
        return found[-1]

    yield build
    for each in found:
        each.close()


def told(name, law, steps, seed=0):
    """What a controller is told in a closed loop with its plant, bad samples and all; it is stepped besides."""
    size, rng, truth = CASES[name][1], np.random.default_rng(seed), Truth(law)
    q, p = law.plant.outputs, law.plant.disturbances
    times, lasting = law.reference_times.reshape(law.evaluations, -1), 2
    for k in range(steps):
        phase = 2.0 * np.pi * (k + times / law.Ts) / (300.0 + 40.0 * np.arange(q))
        reference = np.zeros((law.evaluations, q, law.order))
        reference[:, :, 0] = 0.5 * size * (1.0 - np.cos(phase)) if q == 1 else -size * np.cos(phase)
        if law.order > 1:
            reference[:, :, 1] = 0.5 * size * np.sin(phase) * 2.0 * np.pi / (300.0 * law.Ts)
        if k % 500 > 490:
            reference *= 1e6
        w = 0.3 * np.sin(0.05 * k) * np.ones(p)
        x = truth.x.copy() if law.estimator is None else truth.output()
        x += 0.004 * size * rng.normal(size=x.size)
        kind, given = rng.integers(60), w.copy()
        if lasting > 0 or kind == 0:
            x[rng.integers(x.size)] = rng.choice(BAD)
            lasting = lasting - 1 if lasting > 0 else int(rng.choice([0, 0, 3, 14]))
        elif kind == 1:
            x *= 1.0 + 5.0 * rng.random()
        elif kind == 2 and p:
            given[rng.integers(p)] = rng.choice(BAD)
        decision = law.decide(x, reference, disturbance=given)
        u = law.step(x, reference, disturbance=given)
        yield x, reference, given, u, decision
        truth.advance(u, w)
        if np.abs(truth.x).max() > 1e3 * size:
            truth.x[:] = 0.0


# To the bit -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", CASES)
def test_ten_thousand_steps_are_those_of_python(exported, opened, name, real):
    law, fmu = quiet(CASES[name][0], real), opened(exported(name, real))
    searched = isinstance(law.objective, fsw.Horizon)
    commands, statuses = set(), set()
    for k, (x, reference, w, u, decision) in enumerate(told(name, law, STEPS)):
        fmu.set(x, reference, w)
        before = fmu.get("command") if k % 7 == 0 else u.tolist()
        fmu.advance(law.Ts)
        assert fmu.get("command") == before == u.tolist(), k
        assert fmu.get("status") == [law.status], k
        commands.add(tuple(u))
        statuses.add(law.status)
        if k % 5 == 0:
            assert fmu.get("cost") == [decision.cost], k
            assert [fmu.get("bad_samples")[0], fmu.get("bad_samples_total")[0]] == list(law.bad_samples), k
            if searched:
                assert fmu.get("nodes") + fmu.get("optimal") == [decision.nodes, decision.optimal], k
            state, load = law.estimate
            if not np.isnan(state).any():
                assert fmu.get("estimate.x") == state.tolist(), k
                assert fmu.get("estimate.load") == load.tolist(), k
    assert len(commands) >= min(3, len(decision.candidates))
    assert {fsw.Status.OK, fsw.Status.COASTING, fsw.Status.HELD} <= statuses
    assert (fsw.Status.SAFE in statuses) == (name != "paper")


@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_golden_steps(tmp_path, opened, path, real):
    """Commands under way and a running dwell at the start among them."""
    vector = json.loads(path.read_text())
    case = {"problem": vector["problem"], "bad_limit": vector["problem"].pop("bad_limit"), **vector["start"]}
    law = make.controller(case, real)
    fsw.export_fmu(law, tmp_path / "golden.fmu")
    fmu = opened(tmp_path / "golden.fmu")
    for k, step in enumerate(vector["steps"]):
        fmu.set(number(step["x"]), number(step["reference"]), number(step["w"]))
        fmu.advance(law.Ts)
        assert fmu.get("command") == step["u"], k
        assert fsw.Status(fmu.get("status")[0]).name == step["status"], k
        if step["costs"] is not None:
            costs = np.array(number(step["costs"]))
            tolerance = 1e-9 if real == "float64" else 1e-3
            assert fmu.get("cost")[0] == pytest.approx(
                costs.min(), rel=0, abs=costs[np.isfinite(costs)].max() * tolerance
            )


def test_it_goes_on_where_the_controller_stands(tmp_path, opened):
    """Commands under way, dwell and estimate."""
    name = "two inputs"
    law = quiet(CASES[name][0], "float64")
    steps = told(name, law, 400)
    for _ in range(200):
        next(steps)
    fsw.export_fmu(law, tmp_path / "half.fmu")
    fmu = opened(tmp_path / "half.fmu")
    for x, reference, w, u, _ in steps:
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()


def test_a_search_that_gives_up_says_so(tmp_path, opened):
    plant = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.0043)
    law = fsw.Controller(plant, [-1, 0, 1], 1e-3, fsw.Horizon(12, move_weight=0.1, node_budget=30), preview=True)
    fsw.export_fmu(law, tmp_path / "hasty.fmu")
    fmu, gaps = opened(tmp_path / "hasty.fmu"), []
    for x, reference, w, u, decision in told("horizon", law, 500):
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()
        shown = fmu.get("optimal") + fmu.get("nodes")
        assert shown == [decision.optimal, decision.nodes]
        if np.isfinite(decision.gap):
            gaps.append(decision.gap)
            assert fmu.get("gap") == [decision.gap]
    assert {gap > 0.0 for gap in gaps} == {True, False}


# Time -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, -3.0, 86400.0, 1e7])
@pytest.mark.parametrize("parts", [1, 3, 7, 10])
def test_fractions_of_a_period(exported, opened, parts, start):
    """Inputs are sampled at the instants alone, and the clock does not wander."""
    law, fmu = valve_controller(), opened(exported("paper"), start=start)
    for k, (x, reference, w, u, _) in enumerate(told("paper", law, 1500)):
        fmu.set(x, reference, w)
        for i in range(parts):
            fmu.slave.doStep(currentCommunicationPoint=fmu.time, communicationStepSize=law.Ts / parts)
            fmu.time = start + (k + (i + 1) / parts) * law.Ts
            assert fmu.get("command") == u.tolist(), (k, i)
            if i + 1 < parts:
                fmu.set(-x, -reference, -w)
                assert fmu.get("command") == u.tolist(), (k, i)


def test_steps_of_any_length(exported, opened):
    """As many decisions as instants, also where none ends on one."""
    fmu = opened(exported("paper"))
    fmu.set([np.nan, 0.0], [0.0, 0.0])
    rng, done = np.random.default_rng(0), 0
    for _ in range(3000):
        fmu.advance(1e-3 * rng.choice([0.01, 0.37, 1.0, 1.61, 5.2]))
        done = int(np.ceil(fmu.time / 1e-3 - 1e-3))
        assert abs(fmu.get("bad_samples_total")[0] - done) <= (abs(fmu.time / 1e-3 - round(fmu.time / 1e-3)) < 2e-3)
    assert done > 3000


def test_a_step_over_several_periods_decides_in_each(exported, opened):
    law, fmu = valve_controller(), opened(exported("paper"))
    for n in (1, 2, 5, 1, 40):
        x, reference = [100.0 * n, -50.0], [[[120.0 * n, 30.0]]]
        fmu.set(x, reference)
        fmu.advance(n * 1e-3)
        for _ in range(n):
            u = law.step(x, reference)
        assert fmu.get("command") == u.tolist()
    assert fmu.get("estimate.x") == law.estimate[0].tolist()


def test_what_the_outputs_show_when(exported, opened):
    """At an instant the decision on the inputs just set, which may still change; between instants the latest."""
    fmu, low, high = opened(exported("paper")), ([900.0, 0.0], [0.0, 0.0]), ([0.0, 0.0], [900.0, 0.0])
    assert fmu.get("command") == [0.0]
    for inputs, command in ((high, [1.0]), (low, [0.0]), (high, [1.0])):
        fmu.set(*inputs)
        assert fmu.get("estimate.x") == inputs[0]
        assert fmu.get("command") == command
    fmu.advance(1e-3)
    assert fmu.get("command") == [1.0]
    fmu.set(*low)
    assert fmu.get("command") == [0.0]
    fmu.advance(0.5e-3)
    fmu.set(*high)
    assert fmu.get("command") == [0.0]
    fmu.advance(0.5e-3)
    assert fmu.get("command") == [0.0]
    fmu.advance(1e-3)
    assert fmu.get("command") == [1.0]


def test_only_the_last_inputs_before_a_step_count(exported, opened):
    """However often others were tried, and whether their outcome was looked at or not."""
    law, fmu = quiet(CASES["endpoint"][0], "float64"), opened(exported("endpoint"))
    tried = np.random.default_rng(1)
    for x, reference, w, u, _ in told("endpoint", law, 1000):
        for _ in range(tried.integers(3)):
            fmu.set(tried.choice([np.nan, 0.0, 1e4], size=x.shape), tried.normal(scale=1e4, size=reference.shape), w)
            if tried.integers(2):
                fmu.get("command")
        fmu.set(x, reference, w)
        fmu.advance(law.Ts)
        assert fmu.get("command") == u.tolist()
        assert fmu.get("bad_samples_total") == [law.bad_samples[1]]


# Life -----------------------------------------------------------------------------------------------------------------


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


# Description ----------------------------------------------------------------------------------------------------------


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


# Sources --------------------------------------------------------------------------------------------------------------


def spoken(*command, **options):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, **options)
    return done.returncode, done.stdout + done.stderr


def sources(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder / "sources"


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


# Co-simulation --------------------------------------------------------------------------------------------------------


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


# What cannot be exported ----------------------------------------------------------------------------------------------


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
