"""The closed loop in C, every array recorded, beside the same loop written by hand for this one plant."""

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from common import HERE, REFERENCE, STEPS, TS, build, controller, core_loop
from foreswitch import Controller, Run
from table import Row, compare


def constants(law: Controller) -> dict[str, float]:
    """The design's numbers by their names in peer.c."""
    rows, model = law.law.rows, law.model
    values = {"F": rows.state[0, 1], "R": law.law.sliding.reference[0, 1], "H": rows.hold[0][0, 0]}
    values |= {"A": model.transition[0, 1], "C": model.transition[1, 1], "B1": model.old[0, 0], "B2": model.old[0, 1]}
    return values | {f"W{age}": effect for age, effect in enumerate(rows.pending[0][:, 0], start=1)}


def by_hand(library: Path, run: Run) -> tuple[Callable[[], None], dict[str, np.ndarray]]:
    """The loop of peer.c, and the arrays it fills."""
    hot_gas = ctypes.CDLL(str(library)).hot_gas
    given = np.ascontiguousarray(REFERENCE(run.t[:-1], 2))
    u = np.zeros((5 + STEPS, 1))
    arrays = {"x": np.zeros_like(run.x), "y": np.zeros_like(run.y), "u": u[5:]}
    arrays |= {"cost": np.zeros_like(run.cost), "status": np.ones_like(run.status)}

    def loop() -> None:
        hot_gas(ctypes.c_long(STEPS), *(ctypes.c_void_p(array.ctypes.data) for array in (given, *arrays.values())))

    return loop, arrays


def rows() -> Iterator[Row]:
    law = controller()
    run, ours = core_loop(law, REFERENCE, STEPS * TS)
    with TemporaryDirectory() as folder:
        for name, options, most in (
            ("closed loop in C, by hand in C", [], 3.0),
            ("  by hand, each command guessed by the processor", ["-DGUESS"], 0.0),
        ):
            target = Path(folder) / f"peer{len(options)}.so"
            library = build(target, "-shared", *options, HERE / "peer.c", defines=constants(law))
            other, arrays = by_hand(library, run)
            other()
            for field, array in arrays.items():
                assert np.array_equal(getattr(run, field), array), f"{name}: {field} differs"
            yield compare(name, ours, other, STEPS, most=most)
