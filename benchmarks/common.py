"""The paper's hot-gas plant and controller, the C loop that `simulate` runs, and the C compiler."""

import os
import subprocess
import sysconfig
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from foreswitch import Controller, Endpoint, HalfSine, Plant, Run, simulate
from foreswitch._binding import CORES

HERE = Path(__file__).parent
CORE = HERE.parent / "core"

TS = 1e-3
PLANT = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
#: This plant cannot fall, so neither may the reference; where it is steepest the valve is on for 0.48 of the time.
REFERENCE = HalfSine(1e5, 20.0)
STEPS = 20_000


def controller(real: str = "float64") -> Controller:
    return Controller(PLANT, [0, 1], TS, Endpoint(Td=0.020, lam=2500.0), real=real)


def core_loop(law: Controller, *arguments: Any, **options: Any) -> tuple[Run, Callable[..., None]]:
    """A run by `simulate`, and its call into C: to be repeated as it was, or on from period `first` to `last`."""
    module = CORES[law.real]
    run, calls = module.run, []

    def spy(*call: Any) -> None:
        calls.append((call[0].save(), call))
        run(*call)

    module.run = spy
    try:
        result = simulate(law, *arguments, **options)
    finally:
        module.run = run
    [(state, call)] = calls

    def again(*periods: int) -> None:
        if periods:
            run(*call[:-2], *periods)
        else:
            call[0].restore(state)
            run(*call)

    return result, again


def compiler() -> str:
    return (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]


def build(target: Path, *arguments: object, defines: Mapping[str, float] | None = None) -> Path:
    """Compile as the wheel is; constants from Python go in as macros."""
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-fPIC"]
    macros = [f"-D{name}={value:.17g}" for name, value in (defines or {}).items()]
    command = [compiler(), *flags, *macros, "-o", target, *arguments, "-lm"]
    subprocess.run([str(word) for word in command], check=True)
    return target
