"""One decision from Python, beside the same law by hand in NumPy; a simulation, beside what libraries offer."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.signal import dlsim

import control
from common import REFERENCE, TS, controller
from foreswitch import Controller, simulate
from table import Row, compare

#: Few enough that all their arrays stay in the cache.
STEPS = 400
SIMULATED, LIBRARY_STEPS = 2_000, 100


class NumpyLaw:
    """The paper's law in as few calls as seem possible: all that is known in one vector, one product, one argmin."""

    def __init__(self, law: Controller) -> None:
        rows, sliding = law.law.rows, law.law.sliding
        self.row = np.concatenate([rows.state[0], -sliding.reference[0], rows.pending[0][:, 0]])
        self.known = np.zeros(9)
        self.x, self.reference = self.known[:2], self.known[2:4]
        self.newer, self.older = self.known[4:-1], self.known[5:]
        self.levels = law.levels[0]
        self.effects = rows.hold[0][0, 0] * self.levels

    def step(self, x: np.ndarray, reference: np.ndarray) -> np.float64:
        self.x[:] = x
        self.reference[:] = reference
        s = self.row.dot(self.known) + self.effects
        u = self.levels[(s * s).argmin()]
        self.older[:] = self.newer
        self.known[4] = u
        return u


def decisions(x: list[np.ndarray], reference: list[np.ndarray], u: np.ndarray) -> Iterator[Row]:
    ours = controller()
    other = NumpyLaw(ours)
    for name, step in (("Controller.step", ours.step), ("NumpyLaw", other.step)):
        given = [float(np.ravel(step(a, b))[0]) for a, b in zip(x, reference, strict=True)]
        assert np.array_equal(given, u), f"{name} commands differently"

    def all_of(step: Callable[[Any, Any], Any]) -> Callable[[], None]:
        def loop() -> None:
            for a, b in zip(x, reference, strict=True):
                step(a, b)

        return loop

    yield compare(
        "Controller.step, by hand in NumPy", all_of(ours.step), all_of(other.step), STEPS, faster=6.0, repeats=60
    )


def simulations(reference: list[np.ndarray], u: np.ndarray) -> Iterator[Row]:
    law = controller()
    model = law.model
    A, B, C, D = model.transition, model.old.T, law.plant.C, np.zeros((1, 1))
    system = control.ss(A, B, C, D, TS)

    def with_dlsim(x: np.ndarray, level: float) -> np.ndarray:
        return dlsim((A, B, C, D, TS), [[level], [level]], x0=x)[2][1]

    def with_forced_response(x: np.ndarray, level: float) -> np.ndarray:
        return control.forced_response(system, [0.0, TS], [level, level], x).states[:, 1]

    def with_dynamics(x: np.ndarray, level: float) -> np.ndarray:
        return system.dynamics(0.0, x, [level])

    def stepping(advance: Callable[[np.ndarray, float], np.ndarray]) -> Callable[[], np.ndarray]:
        def loop() -> np.ndarray:
            hand, x, issued = NumpyLaw(law), np.zeros(2), np.zeros(5 + LIBRARY_STEPS)
            for k, wanted in enumerate(reference[:LIBRARY_STEPS]):
                issued[5 + k] = hand.step(x, wanted)
                x = advance(x, issued[k])
            return issued[5:]

        return loop

    for name, advance in (
        ("simulate, NumPy and scipy's dlsim", with_dlsim),
        ("simulate, NumPy and python-control's forced_response", with_forced_response),
        ("simulate, NumPy and python-control's dynamics", with_dynamics),
    ):
        other = stepping(advance)
        assert np.array_equal(other(), u[:LIBRARY_STEPS]), f"{name}: other commands"
        yield compare(
            name,
            lambda: simulate(law, REFERENCE, SIMULATED * TS),
            other,
            SIMULATED,
            other_steps=LIBRARY_STEPS,
            repeats=7,
        )


def rows() -> Iterator[Row]:
    run = simulate(controller(), REFERENCE, STEPS * TS)
    reference = list(REFERENCE(run.t[:-1], 2)[:, 0])
    yield from decisions(list(run.x[:-1]), reference, run.u[:, 0])
    yield from simulations(reference, run.u[:, 0])
