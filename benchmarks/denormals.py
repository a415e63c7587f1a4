"""A state that has decayed to nothing must not slow the loop, nor one that rests anywhere on the way there."""

from collections.abc import Callable, Iterator

from common import TS, core_loop
from foreswitch import Controller, Endpoint, Plant
from table import Row, compare, race

TENTH = 100_000
#: At each of these a state, a product or a square leaves the normal range of one of the arithmetics.
SIZES = (1e-16, 1e-18, 1e-20, 1e-22, 1e-29, 1e-37, 1e-42, 1e-139, 1e-150, 1e-155, 1e-162, 1e-199, 1e-300, 1e-310)


def left_to_itself(real: str, periods: float, x0: float, steps: int) -> Callable[..., None]:
    """The C loop of a lag of so many periods that nothing drives."""
    plant = Plant([[-1.0 / (periods * TS)]], [[1.0]], [[1.0]], input_delay=[0.005])
    law = Controller(plant, [0, 1], TS, Endpoint(Td=0.020, lam=2500.0), real=real)
    run, loop = core_loop(law, 0.0, steps * TS, x0=[x0])
    assert not run.u.any()
    return loop


def rows() -> Iterator[Row]:
    for real in ("float64", "float32"):
        loop = left_to_itself(real, 100.0, 1.0, 10 * TENTH)
        last, first = lambda loop=loop: loop(9 * TENTH, 10 * TENTH), lambda loop=loop: loop(0, TENTH)
        yield compare(f"1e6 decaying steps, {real}: the last tenth, the first", last, first, TENTH, most=1.5, repeats=9)

        steps = TENTH // 5
        usual = left_to_itself(real, 1e9, 1.0, steps)
        resting = {x0: left_to_itself(real, 1e9, x0, steps) for x0 in SIZES}
        slowest = max(SIZES, key=lambda x0: race(resting[x0], usual, steps, steps, 9).ratio)
        name = f"resting, {real}: at {slowest:g}, the slowest of {len(SIZES)} sizes, at 1"
        yield compare(name, resting[slowest], usual, steps, most=1.5)
