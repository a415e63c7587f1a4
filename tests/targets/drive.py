"""What drive.c is told, and what it must answer: the same operations on the core inside Python, bit by bit."""

import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import foreswitch as fsw
from foreswitch import Controller
from foreswitch._binding import CORES, REALS
from targets.harness import HERE, Image, Target

END, STEP, DECIDE_AND_STEP, PRELOAD, START, INIT, TRACK, MISSED, SAFE = range(9)


def saved_state(law: Controller) -> Callable[[bytes], bytes]:
    """From what the binding saves to the values that add_state of drive.c sums up."""
    core, design = CORES[law.real], law.design
    n, m, p, rows = design.states, design.inputs, design.disturbances, design.rows
    moves = design.horizon.moves if design.horizon else 0
    real = np.dtype(REALS[law.real])
    layout = np.dtype(
        [("x", real, core.MAX_STATES), ("w", real, core.MAX_DISTURBANCES), ("wait", "<u4", core.MAX_INPUTS),
         ("bad_total", "<u4"), ("head", "<u2"), ("bad", "<u2"), ("primed", "u1"), ("outliers", "u1"), ("planned", "u1"),
         ("plan", "u1", core.MAX_MOVES)]
    )  # fmt: skip
    used = {"x": n, "w": p, "wait": m, "plan": moves}
    names = [name for name in layout.names if name != "planned" or moves]

    def values(saved: bytes) -> bytes:
        assert len(saved) == 1 + layout.itemsize + rows * m, "fsw_state has changed; change layout, and add_state"
        fields = np.frombuffer(saved, layout, 1, 1)[0]
        parts = [np.atleast_1d(fields[name])[: used.get(name)].tobytes() for name in names]
        return b"".join(parts) + saved[1 + layout.itemsize :]

    return values


class Script:
    """Operations on a controller, as a stream for drive.c and the answers expected of it.

    Every operation is carried out at once by the core inside Python, so that a loop can be closed over it.
    """

    def __init__(self, law: Controller) -> None:
        self.law = law.copy()
        self.core, self.real = self.law.core, REALS[law.real]
        self.design = law.design
        self.stream, self.sum = bytearray(), 0
        self.answers: list[bytes] = []
        self.u: list[np.ndarray] = []
        self.status: list[int] = []
        self.costs: list[np.ndarray | None] = []
        self.state = saved_state(law)
        self.restart(np.array([law.actuator.safe] * self.design.rows), np.zeros(law.plant.inputs))

    # ---- Operations ----

    def restart(self, line: np.ndarray, wait: np.ndarray) -> None:
        """Begin anew, from known commands, oldest first, and periods that each input must still keep its level."""
        line, wait = line.astype(np.uint8).ravel(), wait.astype(np.uint32)
        safe = np.array([self.law.actuator.safe] * self.design.rows, dtype=np.uint8).ravel()
        self.stream += bytes([INIT])
        self.core.preload(safe, np.zeros_like(wait))
        self.answer(bytes([0]))
        self.stream += bytes([PRELOAD]) + line.tobytes() + wait.astype("<u4").tobytes()
        self.core.preload(line, wait, True)
        self.answer(bytes([0]))

    def start(self, x: Sequence[float], w: Sequence[float]) -> None:
        """From a known state."""
        given = [np.array(values, dtype=self.real) for values in (x, w)]
        self.stream += bytes([START]) + b"".join(values.tobytes() for values in given)
        self.core.start(*given)
        self.answer(bytes([0]))

    def step(
        self, x: Sequence[float], reference: np.ndarray, w: Sequence[float] = (), look: bool = False
    ) -> np.ndarray:
        """One period; look: the costs of all candidates beforehand. Returns the command."""
        given = [np.array(values, dtype=float) for values in (x, reference, w)]
        with np.errstate(over="ignore"):
            told = b"".join(values.astype(self.real).tobytes() for values in given)
        self.stream += bytes([DECIDE_AND_STEP if look else STEP]) + told
        costs = np.empty(self.design.candidates)
        shape = (-1, self.law.plant.outputs, self.law.order)
        passed = given[0], given[1].reshape(shape), given[2]
        candidate, cost, nodes, status, gap = self.core.decide(*passed, costs)
        looked = [*costs, cost, gap] if look else []
        u = self.core.step(*passed)
        self.u.append(u)
        self.status.append(self.core.status)
        self.costs.append(costs if look else None)
        head = np.array(looked, dtype=self.real).tobytes() + struct.pack("<BHI", status, candidate, nodes)
        self.answer(head + np.array([cost, gap, *u], dtype=self.real).tobytes())
        return u

    def track(self, command: np.ndarray, x: Sequence[float] | None, w: Sequence[float] = ()) -> None:
        """A period in which somebody else chose: level indices; x None: nothing was measured."""
        indices = np.array(command, dtype=np.uint8)
        self.core.track(*self.measured(TRACK, x, w), indices)
        self.stream += indices.tobytes()
        self.answer(bytes([0]))

    def missed(self, periods: int) -> None:
        """Periods without a call."""
        self.stream += bytes([MISSED]) + struct.pack("<H", periods)
        self.core.missed(periods)
        self.answer(bytes([0]))

    def safe(self, x: Sequence[float] | None, w: Sequence[float] = ()) -> None:
        """A period at the safe levels."""
        self.core.safe(*self.measured(SAFE, x, w))
        levels = [values[i] for values, i in zip(self.law.levels, self.law.actuator.safe, strict=True)]
        self.answer(np.array(levels, dtype=self.real).tobytes() + bytes([0]))

    def measured(self, operation: int, x: Sequence[float] | None, w: Sequence[float]) -> tuple[Any, Any]:
        """The sample of a period without a choice, told and as the core takes it."""
        self.stream += bytes([operation, x is not None])
        if x is None:
            return None, None
        given = np.array(x, dtype=float), np.array(w, dtype=float)
        with np.errstate(over="ignore"):
            self.stream += b"".join(values.astype(self.real).tobytes() for values in given)
        return given

    def answer(self, values: bytes) -> None:
        """What the operation gives, and the checksum of the state after it."""
        self.sum = zlib.crc32(self.state(self.core.save()), self.sum)
        self.answers.append(values + struct.pack("<I", self.sum))

    # ---- Outcome ----

    def differences(self, output: bytes) -> str:
        """The first operation answered otherwise; empty if there is none."""
        at = 0
        for k, expected in enumerate(self.answers):
            found = output[at : at + len(expected)]
            if found != expected:
                return f"operation {k} of {len(self.answers)}: {found.hex()}, not {expected.hex()}"
            at += len(expected)
        return "" if at == len(output) else f"{len(output) - at} bytes too many"

    @property
    def data(self) -> bytes:
        return bytes(self.stream) + bytes([END])


def exported(folder: Path, law: Controller) -> Path:
    """The controller as firmware."""
    fsw.export_c(law, folder)
    return folder


def core_sources(folder: Path) -> list[Path]:
    """C sources of an exported folder."""
    return [path for path in (folder / "foreswitch.c", folder / "horizon.c") if path.exists()]


def program(folder: Path, law: Controller, target: Target, *flags: str, level: str = "-O2") -> Image:
    """drive.c round the exported controller."""
    source, design = exported(folder / "exported", law), law.design
    values = law.evaluations * design.outputs * design.order
    given = [f"-I{source}", f"-DDRIVE_REFERENCE={values}", f"-DDRIVE_CANDIDATES={design.candidates}"]
    return target.build(folder / target.name, [HERE / "drive.c", *core_sources(source)], *given, *flags, level=level)
