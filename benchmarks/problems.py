"""The long horizon's problems: hot gas with two and three levels, an inverter, transients; fixed instances of each."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from common import CORE, HERE, build
from emit import design_source
from foreswitch import Controller, Horizon, Plant

GAS_TS, INVERTER_TS = 1e-3, 50e-6
#: Pressures are counted in what one period of the open valve brings, 16500 kPa/s for 1 ms.
PULSE = 16.5
TOP = 1000.0 / PULSE
#: Kicks of the pressure in pulses: in each step, and every so many steps.
KICK, LARGE_KICK, RARE = 0.1, 1.2, 20


@dataclass(frozen=True)
class Problem:
    """A controller, what it is told in each step, and the same terms as one quadratic form for others to minimise.

    ``J = |error + rows u|^2 + sum |u[k] - u[k-1]|^2 move_weight`` over the stacked moves u; error (steps, ...) and
    the commands under way, pending (steps, delay, m), oldest first, belong to the instances.
    """

    name: str
    law: Controller
    x: np.ndarray
    reference: np.ndarray
    w: np.ndarray
    rows: np.ndarray
    error: np.ndarray
    pending: np.ndarray
    cold: bool = False

    @property
    def moves(self) -> int:
        return int(self.law.evaluations)

    @property
    def present(self) -> np.ndarray:
        """The command in force at each instance, (steps, m)."""
        return self.pending[:, -1]

    @property
    def values(self) -> np.ndarray:
        """Candidates, shape (p, m), in the core's order."""
        return np.array(list(itertools.product(*self.law.levels)))

    @property
    def move_weight(self) -> float:
        return float(np.ravel(self.law.objective.move_weight)[0])

    def cost(self, instance: int, moves: np.ndarray) -> float:
        """J of moves (N, m), from its definition."""
        changes = np.diff(np.vstack([self.present[instance], moves]), axis=0)
        residual = self.error[instance] + self.rows @ moves.ravel()
        return float(residual @ residual + self.move_weight * (changes**2).sum())


class Model:
    """x' = F x + G u + E w, its dead time in whole periods, and what it makes of a controller's run."""

    def __init__(self, plant: Plant, Ts: float) -> None:
        n, m = plant.B.shape
        blocks = np.zeros((n + m + plant.E.shape[1],) * 2)
        blocks[:n] = np.hstack([plant.A, plant.B, plant.E]) * Ts
        whole = expm(blocks)[:n]
        self.F, self.G, self.E, self.C = whole[:, :n], whole[:, n : n + m], whole[:, n + m :], plant.C
        self.delay = round(float(plant.input_delay.max()) / Ts)

    def rows(self, moves: int) -> np.ndarray:
        """Effect of each move on each output, (N q, N m)."""
        effects = [self.C @ np.linalg.matrix_power(self.F, i) @ self.G for i in range(moves)]
        zero = np.zeros_like(effects[0])
        return np.block([[effects[k - j] if j <= k else zero for j in range(moves)] for k in range(moves)])

    def error(self, x: np.ndarray, pending: Sequence[np.ndarray], reference: np.ndarray, w: np.ndarray) -> np.ndarray:
        """y - yd without moves at the evaluations."""
        drift, result = self.E @ w, []
        for u in pending:
            x = self.F @ x + self.G @ u + drift
        for target in reference:
            x = self.F @ x + drift
            result.append(self.C @ x - target[:, 0])
        return np.concatenate(result)


def problem(name: str, law: Controller, model: Model, told: list[tuple[Any, ...]], cold: bool = False) -> Problem:
    """From (x, reference, w, commands under way with the one in force) of each step."""
    x, reference, w, pending = (list(column) for column in zip(*told, strict=True))
    errors = [model.error(*one) for one in zip(x, pending, reference, w, strict=True)]
    given = [np.array(a) for a in (x, reference, w)]
    return Problem(name, law, *given, model.rows(law.evaluations), np.array(errors), np.array(pending), cold)


def hot_gas_law(moves: int, levels: Sequence[float], real: str = "float64") -> Controller:
    plant = Plant.integrator_lag(k=1.0 / GAS_TS, c=0.006, L=0.005)
    return Controller(plant, list(levels), GAS_TS, Horizon(moves, move_weight=0.1), preview=True, real=real)


def pressure(k: np.ndarray, rises: bool) -> np.ndarray:
    """The reference at t_k in pulses: a raised cosine of 2 Hz, or its rising half."""
    phase = np.clip(2.0 * GAS_TS * k, 0.0, 0.5 if rises else None)
    return 0.5 * TOP * (1.0 - np.cos(2.0 * np.pi * phase))


def levels_text(levels: Sequence[float]) -> str:
    return "{" + ",".join(f"{v:g}" for v in levels) + "}"


def hot_gas(moves: int, levels: Sequence[float]) -> Problem:
    """The closed loop on the reference, kicked."""
    law, two = hot_gas_law(moves, levels), len(levels) == 2
    model, rng = Model(law.plant, GAS_TS), np.random.default_rng(0)
    x, line, told = np.zeros(2), [np.zeros(1)] * model.delay, []
    for k in range(250 if two else 500):
        kick = KICK * rng.standard_normal() + (LARGE_KICK * rng.standard_normal() if k % RARE == RARE - 1 else 0.0)
        x = x + np.array([kick, 0.0])
        reference = pressure(k + model.delay + 1 + np.arange(moves), two)[:, None, None]
        told.append((x, reference, np.zeros(0), line[-model.delay :]))
        u = law.step(x, reference)
        line.append(u)
        x = model.F @ x + model.G @ line[-1 - model.delay]
    return problem(f"hot gas {levels_text(levels)} N={moves}", law, model, told)


def transients(moves: int, levels: Sequence[float], distances: Sequence[float] = (-20.0, 20.0)) -> Problem:
    """The pressure at rest so many pulses from the reference, and no plan."""
    law, two = hot_gas_law(moves, levels), len(levels) == 2
    model, told = Model(law.plant, GAS_TS), []
    for k in range(0, 250 if two else 500, 10):
        reference = pressure(k + 1 + np.arange(moves), two)[:, None, None]
        for distance in distances:
            x = np.array([pressure(np.array(k), two) + distance, 0.0])
            told.append((x, reference, np.zeros(0), [np.zeros(1)] * model.delay))
    return problem(f"transients {levels_text(levels)} N={moves}", law, model, told, cold=True)


def inverter(moves: int) -> Problem:
    """One period of 20 A at 50 Hz from 600 V against 250 V, which count as constant over the horizon."""
    R, L, V, unit = 0.1, 5e-3, 600.0, 4.0
    clarke = 2.0 / 3.0 * np.array([[1.0, -0.5, -0.5], [0.0, np.sqrt(0.75), -np.sqrt(0.75)]])
    plant = Plant(
        A=-R / L * np.eye(2), B=clarke * V / (L * unit), E=-np.eye(2) / (L * unit), C=np.eye(2), input_delay=INVERTER_TS
    )
    law = Controller(plant, [[0, 1]] * 3, INVERTER_TS, Horizon(moves, move_weight=0.1), preview=True)
    model = Model(plant, INVERTER_TS)

    def turning(length: float, k: Any) -> np.ndarray:
        angle = 2.0 * np.pi * 50.0 * INVERTER_TS * np.asarray(k, dtype=float)
        return length * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    x, line, told = turning(20.0 / unit, 0), [np.zeros(3)] * model.delay, []
    for k in range(400):
        reference = turning(20.0 / unit, k + model.delay + 1 + np.arange(moves))[:, :, None]
        emf = turning(250.0, k + 0.5)
        told.append((x, reference, emf, line[-model.delay :]))
        line.append(law.step(x, reference, disturbance=emf))
        x = model.F @ x + model.G @ line[-1 - model.delay] + model.E @ emf
    return problem(f"inverter N={moves}", law, model, told)


@dataclass(frozen=True)
class Replay:
    """What the core did, step by step."""

    seconds: np.ndarray
    nodes: np.ndarray
    cost: np.ndarray
    moves: list[np.ndarray]


class Core:
    """The core, compiled as in the wheel, with the designs of some problems."""

    def __init__(self, problems: Sequence[Problem], folder: Path) -> None:
        self.problems, self.folder = list(problems), folder
        sources = [design_source(one.law, f"d{i}_") for i, one in enumerate(self.problems)]
        table = ", ".join(f"&d{i}_design" for i in range(len(sources)))
        text = ['#include "foreswitch.h"', *sources, f"static const fsw_design *const designs[] = {{{table}}};"]
        (folder / "designs.h").write_text("\n".join(text))
        cores = [CORE / "foreswitch.c", CORE / "horizon.c"]
        options = ["-shared", "-DFSW_MAX_MOVES=64", f"-I{folder}", f"-I{CORE}"]
        self.library = ctypes.CDLL(str(build(folder / "replay.so", *options, HERE / "replay.c", *cores)))
        self.library.replay.restype = ctypes.c_long

    def replay(self, one: Problem, sweeps: int = 1, loops: int = 1) -> Replay:
        """All its steps, ``sweeps`` times; of each the shortest time."""
        steps = len(one.x)
        seconds, cost = np.full(steps, np.inf), np.zeros(steps)
        nodes, plan = np.zeros(steps, dtype=np.uint32), np.zeros((steps, one.moves), dtype=np.uint8)
        given = [np.ascontiguousarray(a) for a in (one.x, one.reference, one.w)]
        arrays = [ctypes.c_void_p(a.ctypes.data) for a in (*given, seconds, nodes, cost, plan)]
        sizes = (ctypes.c_int(self.problems.index(one)), ctypes.c_long(steps), ctypes.c_int(one.cold))
        for _ in range(sweeps):
            unproven = self.library.replay(*sizes, ctypes.c_long(loops), *arrays)
            assert unproven == 0, f"{one.name}: {unproven} steps are not proven optimal"
        return Replay(seconds, nodes, cost, [one.values[row] for row in plan])
