"""The project that the tests of studies run, its grid, and what befalls a study."""

import importlib
import os
import signal
import time

import numpy as np

import foreswitch as fsw
from foreswitch.project import Project

SWEEP = importlib.import_module("foreswitch.studies.sweep")
CONTENT = {
    "plant": {"model": "integrator_lag", "k": 16500.0, "c": 0.006, "input_delay": 0.005},
    "actuator": {"levels": [0, 1], "Ts": 0.001},
    "controller": {"Td": 0.02, "lam": 2500.0, "preview": "lag"},
    "reference": {"kind": "ramp", "slope": 4000.0},
    "simulation": {"duration": 0.06, "noise": [2.0, 50.0]},
}
GRID = {"controller.Td": [0.01, 0.02, 0.03], "gain_error": [-0.1, 0.1]}


def project(**tables):
    """The hot-gas project over 60 periods, with keys of its tables replaced."""
    return Project({name: table | tables.get(name, {}) for name, table in CONTENT.items()})


def same(one, other):
    """Row for row, bit for bit."""
    a, b = one.columns(), other.columns()
    assert list(a) == list(b)
    for name in a:
        assert np.array_equal(a[name], b[name]), name


OVER = GRID | {"simulation.noise": fsw.Uniform(0.0, 4.0), "delay_error": fsw.Normal(0.0, 1e-3)}


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)


class Killer:
    """Ends one of some processes at the first sign of progress."""

    def __init__(self, victims):
        self.victims, self.killed = victims, None

    def __call__(self, share, what):
        if self.killed is None and what == "running" and share > 0.0:
            self.killed = self.victims()[0].pid
            os.kill(self.killed, signal.SIGKILL)
