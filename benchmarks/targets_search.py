"""The dearest step, looked for: many short histories run on the target, the dearest of them changed at random.

What a step takes depends on its data: which way it branches, where the ring of commands wraps, how far apart the
exponents of soft floating-point operands are. A history is what leads to that step: commands under way, dwell, a known
state and a few samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from foreswitch import Controller
from targets.drive import Script
from targets.harness import Image

#: Of each generation; the best `KEPT` are kept, the others made from them.
HISTORIES, KEPT = 160, 40
SPECIAL = (0.0, -0.0, np.nan, np.inf, -np.inf, 1e38, -3e29, 1e-30, -1e-38, 1e-45)


@dataclass(frozen=True)
class History:
    line: np.ndarray
    wait: np.ndarray
    known: np.ndarray
    samples: np.ndarray  # [steps][measured, reference, w]


class Search:
    """Over the histories of one controller; spread: typical sizes of [measured, reference, w].

    usable: no sample is taken for bad.
    """

    def __init__(self, law: Controller, spread: np.ndarray, steps: int, *, usable: bool = False, seed: int = 1) -> None:
        self.law, self.spread, self.steps, self.usable = law, spread, steps, usable
        self.rng = np.random.default_rng(seed)
        script = Script(law)
        self.design, m = script.design, law.plant.inputs
        self.commands = law.actuator.candidates.reshape(-1, m)
        self.known = self.design.states + self.design.disturbances
        self.reference = law.evaluations * law.plant.outputs * law.order

    def values(self, shape: tuple[int, ...], scale: np.ndarray | float) -> np.ndarray:
        """Numbers of any sign and of magnitudes from far below to far above the scale."""
        exponents = self.rng.choice([0.0, 0.0, 4.0, 12.0], size=shape) * self.rng.normal(size=shape)
        return scale * self.rng.normal(size=shape) * 2.0**exponents

    def fresh(self) -> History:
        line = self.commands[self.rng.integers(len(self.commands), size=self.design.rows)]
        samples = self.values((self.steps, len(self.spread)), self.spread)
        return History(line, self.rng.integers(0, 3, line.shape[1]), self.values((self.known,), 1.0), samples)

    def changed(self, old: History) -> History:
        """One or a few entries otherwise."""
        rng, samples, line = self.rng, old.samples.copy(), old.line.copy()
        for _ in range(rng.integers(1, 4)):
            at = rng.integers(len(samples)), rng.integers(samples.shape[1])
            kind = rng.integers(8)
            if kind == 0:
                line[rng.integers(len(line))] = self.commands[rng.integers(len(self.commands))]
            elif kind == 1:
                samples[at] = rng.choice(SPECIAL)
            elif kind == 2:
                samples[at] *= 2.0 ** rng.integers(-12, 13)
            elif kind == 3:
                samples[at] = self.values((), self.spread[at[1]])
            elif kind == 4:
                samples[at] = -samples[at]
            elif kind == 5:
                samples[at] *= 1.0 + 0.05 * rng.normal()
            elif kind == 6:
                return History(line, rng.integers(0, 3, line.shape[1]), self.values((self.known,), 1.0), samples)
            else:
                samples = np.roll(samples, 1, axis=0)
        return replace(old, line=line, samples=samples)

    def told(self, histories: list[History]) -> Script:
        """All of them one after the other."""
        script, z = Script(self.law), self.design.measured
        for one in histories:
            script.restart(one.line, one.wait)
            script.start(one.known[: self.design.states], one.known[self.design.states :])
            for sample in one.samples:
                if self.usable:
                    sample = np.nan_to_num(sample, nan=1.0, posinf=1e29, neginf=-1e29).clip(-1e29, 1e29)
                given = np.nan_to_num(sample[z : z + self.reference], nan=1.0, posinf=1e29, neginf=-1e29)
                script.step(sample[:z], given, sample[z + self.reference :])
        return script

    def run(self, counted: Callable[[Script], list[int]], generations: int) -> tuple[int, History]:
        """The dearest step found, and the history that leads to it. ``counted`` tells what each step took."""
        pool = [self.fresh() for _ in range(HISTORIES)]
        ranked: list[tuple[int, History]] = []
        for _ in range(generations):
            counts = counted(self.told(pool))
            assert len(counts) == self.steps * len(pool)
            worst = np.array(counts).reshape(len(pool), -1).max(axis=1)
            ranked = sorted([*ranked, *zip(worst.tolist(), pool, strict=True)], key=lambda pair: -pair[0])[:KEPT]
            pool = [self.changed(ranked[i % KEPT][1]) for i in range(HISTORIES - KEPT // 2)]
            pool += [self.fresh() for _ in range(KEPT // 2)]
        return ranked[0]


def counting(image: Image) -> Callable[[Script], list[int]]:
    """What each step takes on the target; its answers are checked on the way."""

    def counted(script: Script) -> list[int]:
        result = image.run(script.data, count="fsw_step")
        assert not (told := script.differences(result.output)), f"{image.target.name}: {told}"
        return result.calls

    return counted
