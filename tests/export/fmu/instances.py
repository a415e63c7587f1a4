"""Designs exported as FMUs, instances of them, and what these are told."""

import shutil
import subprocess
import zipfile

import numpy as np
import pytest

from core.compiling import COMPILERS
from systems import VALVE, valve_controller
from targets.scenarios import BAD, CONTROLLERS, Truth

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install 'foreswitch[fmu]'")
build_platform_binary = pytest.importorskip("fmpy.build").build_platform_binary
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu

NEEDS_COMPILER = pytest.mark.skipif(not COMPILERS, reason="needs a C compiler")

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


def spoken(*command, **options):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, **options)
    return done.returncode, done.stdout + done.stderr


def sources(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder / "sources"
