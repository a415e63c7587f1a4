"""The paper's plant and settings, which the pictures share."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

import foreswitch as fsw

SLOPE, LAG, DELAY, TS, TD, LAM = 16500.0, 0.006, 0.005, 1e-3, 0.020, 2500.0

RISE = fsw.HalfSine(height=1000.0, duration=0.5)

#: Numbers for the text, by the name that marks them there.
Values = dict[str, float]


def hot_gas(delay: float = DELAY) -> fsw.Plant:
    return fsw.Plant.integrator_lag(SLOPE, LAG, delay, input_names="valve", output_names="pressure [kPa]")


def hot_gas_controller(delay: float = DELAY, Td: float = TD, **settings: object) -> fsw.Controller:
    return fsw.Controller(hot_gas(delay), [0, 1], TS, fsw.Endpoint(Td=Td, lam=LAM), **settings)


def save(figure: Figure, path: Path) -> None:
    figure.savefig(path, metadata={"Date": None})
