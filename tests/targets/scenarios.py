"""Controllers and what they are put through on a target: long closed loops with every kind of bad sample, restarts too."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import expm

import foreswitch as fsw
from targets.drive import Script

TINY = {"float64": (5e-324, 1e-300), "float32": (1e-45, 1e-35)}  # denormal, and taken for zero
BAD = (np.nan, np.inf, -np.inf, 1e38, -1e300)
FOREVER = 2**32 - 1


def gas(objective: fsw.Endpoint | fsw.Horizon, real: str) -> fsw.Controller:
    """The hot-gas valve from its pressure, with a leak: three levels, dwell, a gate, a safe level."""
    plant = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.0043)
    filter = fsw.Kalman([0.0, 1e4], 4.0, load=1e-4, gate=6.0, gate_limit=3)
    return fsw.Controller(
        plant, [-1, 0, 1], 1e-3, objective, min_on=0.003, min_off=0.002, switch_cost=4e3, estimator=filter,
        safe_level=0, bad_limit=9, real=real,
    )  # fmt: skip


def coupled(objective: fsw.Endpoint | fsw.Horizon, real: str) -> fsw.Controller:
    """Two inputs with unequal dead times, a forbidden command, a measured disturbance beside an unknown load."""
    plant = fsw.Plant(
        [[-1.0, 0.4, 0.0], [-0.3, -0.7, 0.2], [0.1, 0.0, -0.5]], [[1.0, 0.2], [0.1, 0.8], [0.3, 0.5]],
        [[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]], E=[[0.3], [0.0], [1.0]], input_delay=[0.37, 0.15], u_offset=[0.2, 0.0],
        y_offset=[0.5, -0.3],
    )  # fmt: skip
    filter = fsw.Kalman([1e-3, 1e-3, 4e-3], [1e-3, 4e-3], load=[0.0, 1e-3], gate=6.0)
    return fsw.Controller(
        plant, [[0, 1], [-1, 0, 2]], 0.1, objective, min_on=[0.3, 0.0], min_off=[0.0, 0.2], switch_cost=0.01,
        forbidden=[(1, 2)], estimator=filter, safe_level=[0, 0], bad_limit=5, real=real,
    )  # fmt: skip


#: By name: the controller in an arithmetic, and a typical size of its first output.
CONTROLLERS: dict[str, tuple[Callable[[str], fsw.Controller], float]] = {
    "endpoint": (lambda real: gas(fsw.Endpoint(Td=0.020, lam=2500.0), real), 500.0),
    "horizon": (lambda real: gas(fsw.Horizon(5, move_weight=0.1), real), 500.0),
    "two inputs": (lambda real: coupled(fsw.Endpoint(Td=0.45, lam=[3.0, 5.0]), real), 1.0),
    "horizon of two inputs": (
        lambda real: coupled(fsw.Horizon(4, moves=3, window=(2, 4), move_weight=[0.1, 0.02]), real), 1.0,
    ),
}  # fmt: skip


class Truth:
    """The plant itself, dead times rounded up to periods, with a leak and noise."""

    def __init__(self, law: fsw.Controller) -> None:
        plant = law.plant
        n, m = plant.B.shape
        blocks = np.zeros((n + m + plant.E.shape[1],) * 2)
        blocks[:n] = np.hstack([plant.A, plant.B, plant.E]) * law.Ts
        whole = expm(blocks)[:n]
        self.F, self.G, self.E = whole[:, :n], whole[:, n : n + m], whole[:, n + m :]
        self.plant, self.x = plant, np.zeros(n)
        self.delay = [int(np.ceil(d / law.Ts - 1e-9)) for d in plant.input_delay]
        self.line = [np.zeros(m)] * (max(self.delay) + 1)

    def output(self) -> np.ndarray:
        return self.plant.C @ self.x + self.plant.y_offset

    def advance(self, u: np.ndarray, w: np.ndarray) -> None:
        self.line = [*self.line[1:], np.asarray(u, float)]
        felt = np.array([self.line[-1 - d][j] for j, d in enumerate(self.delay)])
        self.x = self.F @ self.x + self.G @ (felt - self.plant.u_offset - 0.05) + self.E @ w


def long_run(name: str, real: str, steps: int, seed: int = 0) -> Script:
    """So many steps of a closed loop: single and lasting bad samples, outliers, tiny values, far references, commands by
    hand, missed periods, the safe level, restarts in the middle of a dwell, and a dwell counter that begins near 2^32."""
    make, size = CONTROLLERS[name]
    law, rng = make(real), np.random.default_rng(seed)
    script, truth = Script(law), Truth(law)
    q, p = law.plant.outputs, law.plant.disturbances
    times = np.atleast_1d(law.reference_times)
    lasting = 3  # nothing usable to begin with
    for k in range(steps):
        if k % 1000 == 700:  # power comes back: commands are under way, a dwell is running
            rows, m = script.design.rows, law.plant.inputs
            commands = law.actuator.candidates.reshape(-1, m)
            line = commands[rng.integers(len(commands), size=rows)]
            wait = rng.integers(0, 4, size=m) if k % 2000 == 700 else np.full(m, FOREVER) - rng.integers(0, 3, size=m)
            script.restart(line, wait.astype(np.uint32))
        elif k % 1000 == 730:  # a dwell that never ends would leave nothing to decide
            script.restart(np.tile(law.actuator.safe, (script.design.rows, 1)), np.zeros(law.plant.inputs, np.uint32))
            script.start(rng.normal(size=law.plant.states), rng.normal(size=script.design.disturbances))
        phase = 2.0 * np.pi * (k + times / law.Ts)[:, None] / (300.0 + 40.0 * np.arange(q))
        reference = np.zeros((len(times), q, law.order))
        reference[:, :, 0] = 0.5 * size * (1.0 - np.cos(phase))
        if law.order > 1:
            reference[:, :, 1] = 0.5 * size * np.sin(phase) * 2.0 * np.pi / (300.0 * law.Ts)
        if k % 500 > 470:
            reference[:, :, 0] *= rng.choice([0.0, -3.0, 1e6])
        w = 0.3 * np.sin(0.05 * k) * np.ones(p)
        y = truth.output() + 0.004 * size * rng.normal(size=q)
        told = w.copy()
        kind = rng.integers(60)
        if lasting > 0 or kind == 0:
            y[rng.integers(q)] = rng.choice(BAD)
            lasting = lasting - 1 if lasting > 0 else int(rng.choice([0, 0, 0, 3, 14]))
        elif kind == 1:
            y *= 1.0 + 5.0 * rng.random()
        elif kind == 2:
            y[:] = rng.choice(TINY[real]) * rng.choice([-1.0, 1.0])
        elif kind == 3 and p:
            told[rng.integers(p)] = rng.choice(BAD)
        elif kind == 4:
            y[:] = -0.0
        if k % 400 in range(300, 306):  # by hand, now and then without a measurement
            commands = law.actuator.candidates.reshape(-1, law.plant.inputs)
            command = commands[rng.integers(len(commands))]
            script.track(command, None if k % 5 == 0 else y, told)
            u = np.array([levels[i] for levels, i in zip(law.levels, command, strict=True)])
        elif k % 400 == 350:
            script.safe(y, told)
            u = np.array([levels[i] for levels, i in zip(law.levels, law.actuator.safe, strict=True)])
        else:
            u = script.step(y, reference, told, look=k % 25 == 0)
        truth.advance(u, w)
        if k % 400 == 370:
            script.missed(3)
            for _ in range(3):
                truth.advance(u, w)
        if np.abs(truth.x).max() > 1e3 * size:
            truth.x[:] = 0.0
    return script
