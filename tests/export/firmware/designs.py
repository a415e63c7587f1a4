"""Designs exported as firmware, and the compilers that make something of them."""

import os
import shutil
import subprocess
import warnings

import numpy as np
import pytest

import foreswitch as fsw
from systems import TWO_BY_TWO, VALVE

STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
CROSS = {
    "cortex-m4f": ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"],
    "cortex-m0": ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb"],
    "avr": ["avr-gcc", "-mmcu=atmega1284p"],
}
NEEDS_COMPILER = pytest.mark.skipif(not COMPILERS or not shutil.which("make"), reason="needs gcc or clang, and make")

ENDPOINT = fsw.Endpoint(Td=0.020, lam=2500.0)
KALMAN = fsw.Kalman([0.0, 1e4], 4.0, load=1e-4, gate=6.0, gate_limit=2)
COUPLED = TWO_BY_TWO.replace(
    E=[[0.3], [0.0], [1.0]], input_delay=[0.37, 0.15], u_offset=[0.2, 0.0], y_offset=[0.5, -0.3]
)
SUM_FORBIDDEN = [(1.0, 2.0), (0.0, -1.0)]


def coupled(objective, **options):
    return fsw.Controller(COUPLED, [[0, 1], [-1, 0, 2]], 0.1, objective, forbidden=SUM_FORBIDDEN, **options)


DESIGNS = {
    "paper": lambda: fsw.Controller(VALVE, [0, 1], 1e-3, ENDPOINT),
    "vented": lambda: fsw.Controller(
        VALVE.replace(E=[[-1.0], [0.0]], input_delay=0.0043), [0, 1], 1e-3, ENDPOINT, safe_level=0.0, bad_limit=4,
        preview="lag",
    ),
    "dwell": lambda: fsw.Controller(
        VALVE, [0, 0.5, 1], 1e-3, ENDPOINT, min_on=0.003, min_off=0.002, switch_cost=2.0, safe_level=1.0
    ),
    "two inputs": lambda: coupled(fsw.Endpoint(0.45, [3.0, 5.0], weight=[1.0, 4.0])),
    "Kalman": lambda: fsw.Controller(VALVE, [0, 1], 1e-3, ENDPOINT, estimator=KALMAN),
    "horizon": lambda: fsw.Controller(
        VALVE, [0, 1], 1e-3, fsw.Horizon(10, move_weight=0.1), preview=True, safe_level=0.0
    ),
    "two-input horizon": lambda: coupled(
        fsw.Horizon(5, moves=4, window=(2, 5), move_weight=[0.1, 0.02], tail="rest", terminal=np.eye(3)),
        min_on=[0.2, 0.15], min_off=[0.1, 0.3], switch_cost=[0.02, 0.01],
    ),
    "Kalman horizon": lambda: fsw.Controller(
        VALVE, [-1, 0, 1], 1e-3, fsw.Horizon(6, lam=800.0, tail="zero"), estimator=KALMAN
    ),
    "first-order horizon": lambda: fsw.Controller(fsw.Plant.fopdt(1.0, 1.0, 0.2), [0, 1], 0.1, fsw.Horizon(3, moves=1)),
    "no dead time": lambda: fsw.Controller(VALVE.replace(input_delay=0.0), [0, 1], 1e-3, ENDPOINT),
    "levels beside zero": lambda: fsw.Controller(VALVE, [1, 2], 1e-3, ENDPOINT),
}  # fmt: skip


def design(name, real="float64"):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return DESIGNS[name]().replace(real=real)


def spoken(*command, **options):
    """Exit code and all that was said."""
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0", "MAKEFLAGS": ""}
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, env=environment, **options)
    return done.returncode, done.stdout + done.stderr


def sources(folder):
    return [path for path in (folder / "foreswitch.c", folder / "horizon.c") if path.exists()]
