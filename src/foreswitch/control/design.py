"""A controller's design by name: the sizes and tables of core/foreswitch.h and core/horizon.h, with shapes and units.

Here alone a table has its name, type, shape and unit, in the order of the C structures. The binding looks its slots up by
these names; the exported header, the FMU and the golden vectors read the same object.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields
from typing import Any, Self

import numpy as np

from foreswitch._binding import REALS

__all__ = ["Design", "HorizonDesign", "Tables"]

Table = np.ndarray[Any, Any]
#: NumPy's type of each C type; fsw_real is that of the design.
TYPES: dict[str, Any] = {"uint8_t": np.uint8, "uint16_t": np.uint16, "uint32_t": np.uint32, "double": np.float64}


def _scalar(kind: str = "uint16_t", *, shared: bool = False) -> Any:
    """A number; ``shared``: the horizon has it from the design around it."""
    return field(metadata={"kind": kind, "shape": None, "shared": shared})


def _table(kind: str, *shape: str, unit: str = "-", host: bool = False) -> Any:
    """An array, flat, row by row; dimensions are sizes by name, or sums of some. ``host``: not of the C structure."""
    return field(metadata={"kind": kind, "shape": shape, "unit": unit, "host": host})


@dataclass(frozen=True, eq=False, kw_only=True)
class Tables:
    """Numbers and flat arrays by name, each of the type and size that it declares; what does not apply is None."""

    real: str

    @classmethod
    def made(cls, real: str, **values: Any) -> Self:
        """From numbers and arrays of any shape."""
        numbers = {each.name: values.pop(each.name) for each in cls.scalars()}
        made = {each.name: _typed(each, real, values.pop(each.name)) for each in cls.tables()}
        return cls(real=real, **numbers, **made, **values)

    def __post_init__(self) -> None:
        for each in self.tables():
            values = getattr(self, each.name)
            if values is not None and values.size != self._count(each):
                shape = ", ".join(each.metadata["shape"])
                raise AssertionError(f"{each.name} has {values.size} items, not {self._count(each)} ({shape})")

    def _count(self, each: Field[Any]) -> int:
        count = 1
        for dimension in each.metadata["shape"]:
            count *= sum(int(part) if part.isdigit() else getattr(self, part) for part in dimension.split(" + "))
        return count

    @classmethod
    def scalars(cls) -> list[Field[Any]]:
        """The numbers, in the order of the C structure."""
        return [each for each in fields(cls) if "kind" in each.metadata and each.metadata["shape"] is None]

    @classmethod
    def tables(cls) -> list[Field[Any]]:
        """The arrays, in the order of the C structure."""
        return [each for each in fields(cls) if each.metadata.get("shape") is not None]

    @property
    def table_bytes(self) -> int:
        """Size of all arrays of the C structure."""
        own = (getattr(self, each.name) for each in self.tables() if not each.metadata["host"])
        return sum(int(values.nbytes) for values in own if values is not None)


def _typed(each: Field[Any], real: str, values: Any) -> Table | None:
    if values is None:
        return None
    kind = REALS[real] if each.metadata["kind"] == "fsw_real" else TYPES[each.metadata["kind"]]
    with np.errstate(over="ignore"):  # what overflows in single precision is infinite: an export refuses it
        return np.ascontiguousarray(values, dtype=kind).ravel()


@dataclass(frozen=True, eq=False, kw_only=True)
class HorizonDesign(Tables):
    """fsw_horizon: what the exact search reads, see core/horizon.h. In units of cost J, state x, input u, output y."""

    steps: int = _scalar()
    moves: int = _scalar()
    states: int = _scalar()
    inputs: int = _scalar(shared=True)
    outputs: int = _scalar(shared=True)
    candidates: int = _scalar(shared=True)
    disturbances: int = _scalar(shared=True)
    order: int = _scalar()
    lead: int = _scalar()
    terminal: int = _scalar()
    tail: int = _scalar("uint8_t")
    exclusive: int = _scalar("uint8_t")
    dominance: int = _scalar("uint8_t")
    patience: int = _scalar("uint32_t")
    node_budget: int = _scalar("uint32_t")
    start_row: Table | None = _table("fsw_real", "states", "plant_states")
    start_disturbance: Table | None = _table("fsw_real", "states", "disturbances", unit="x/w")
    start_offset: Table | None = _table("fsw_real", "states", unit="x")
    pending_table: Table | None = _table("fsw_real", "pending_levels", "states", unit="x")
    drift: Table | None = _table("fsw_real", "states", unit="x")
    drift_disturbance: Table | None = _table("fsw_real", "states", "disturbances", unit="x/w")
    row_disturbance: Table | None = _table("fsw_real", "outputs", "disturbances", unit="y/w")
    row_offset: Table | None = _table("fsw_real", "outputs", unit="y")
    reference_row: Table | None = _table("fsw_real", "outputs", "order", unit="s^i")
    terminal_reference: Table | None = _table("fsw_real", "terminal", "outputs", unit="sqrt(J)/y")
    terminal_disturbance: Table | None = _table("fsw_real", "terminal", "disturbances", unit="sqrt(J)/w")
    terminal_offset: Table | None = _table("fsw_real", "terminal", unit="sqrt(J)")
    far: float = _scalar("fsw_real")
    F: Table | None = _table("fsw_real", "states", "states")
    G: Table | None = _table("fsw_real", "states", "inputs", unit="x/u")
    S: Table | None = _table("fsw_real", "outputs", "states", unit="y/x")
    root_weight: Table | None = _table("fsw_real", "steps", "outputs", unit="sqrt(J)/y")
    T: Table | None = _table("fsw_real", "terminal", "states", unit="sqrt(J)/x")
    move_weight: Table | None = _table("fsw_real", "inputs", unit="J/u^2")
    lift: Table | None = _table("fsw_real", "moves", "inputs", unit="J/u^2")
    lift_centre: Table | None = _table("fsw_real", "moves", "inputs", unit="J/u")
    last_value: Table | None = _table("fsw_real", "states + inputs", "states + inputs", unit="J/x^2")
    hull: Table | None = _table("fsw_real", "inputs", "2", unit="u")
    value: Table | None = _table("fsw_real", "candidates", "inputs", unit="u")
    effect: Table | None = _table("fsw_real", "candidates", "states", unit="x")
    gain: Table | None = _table("fsw_real", "moves", "inputs", "states", unit="sqrt(J)/x")
    gain_previous: Table | None = _table("fsw_real", "moves", "inputs", "inputs", unit="sqrt(J)/u")
    pull: Table | None = _table("fsw_real", "moves", "inputs", "inputs", unit="u/sqrt(J)")
    place: Table | None = _table("fsw_real", "moves", "candidates", "inputs", unit="sqrt(J)")
    from_place: Table | None = _table("fsw_real", "moves", "candidates", "inputs", unit="sqrt(J)")
    metric: Table | None = _table("fsw_real", "moves", "states + inputs", "states", unit="sqrt(J)/x")
    from_metric: Table | None = _table("fsw_real", "moves", "candidates", "states + inputs", unit="sqrt(J)")
    switch_cost: Table | None = _table("fsw_real", "candidates", "candidates", unit="J")
    level: Table | None = _table("uint8_t", "candidates", "inputs", unit="index")
    dwell: Table | None = _table("uint16_t", "candidates", "inputs", unit="periods")
    #: Of the design around it, for the shapes above.
    plant_states: int
    pending_levels: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(Tables):
    """fsw_design: everything a controller is, see core/foreswitch.h. In units of cost J, state x, input u, output y.

    Attributes
    ----------
    real : {"float64", "float32"}
        The C type fsw_real.
    horizon : HorizonDesign or None
        In place of the tables from ``state_row`` to ``total_row``.
    """

    states: int = _scalar()
    inputs: int = _scalar()
    outputs: int = _scalar()
    disturbances: int = _scalar()
    order: int = _scalar()
    rows: int = _scalar()
    candidates: int = _scalar()
    bad_limit: int = _scalar()
    measured: int = _scalar()
    loads: int = _scalar()
    gate_limit: int = _scalar()
    level_count: Table = _table("uint8_t", "inputs")
    exact_levels: Table = _table("double", "level_total", unit="u", host=True)
    levels: Table = _table("fsw_real", "level_total", unit="u")
    candidate: Table = _table("uint8_t", "candidates", "inputs", unit="index")
    safe: Table = _table("uint8_t", "inputs", unit="index")
    state_row: Table | None = _table("fsw_real", "outputs", "states", unit="y/x")
    disturbance_row: Table | None = _table("fsw_real", "outputs", "disturbances", unit="y/w")
    offset: Table | None = _table("fsw_real", "outputs", unit="y")
    reference_row: Table | None = _table("fsw_real", "outputs", "order", unit="s^i")
    half_weight: Table | None = _table("fsw_real", "outputs", unit="J/y^2")
    pending: Table = _table("uint16_t", "inputs", unit="periods")
    pending_table: Table | None = _table("fsw_real", "pending_levels", "outputs", unit="y")
    holds: Table = _table("uint16_t", "inputs")
    hold_row: Table | None = _table("fsw_real", "hold_total", "outputs", unit="y/u")
    total_row: Table | None = _table("fsw_real", "outputs", "inputs", unit="y/u")
    rest_reference: Table | None = _table("fsw_real", "inputs", "outputs", unit="u/y")
    rest_disturbance: Table | None = _table("fsw_real", "inputs", "disturbances", unit="u/w")
    rest_offset: Table | None = _table("fsw_real", "inputs", unit="u")
    dwell: Table = _table("uint32_t", "level_total", unit="periods")
    switch_cost: Table = _table("fsw_real", "inputs", unit="J")
    model_x: Table = _table("fsw_real", "states", "states")
    model_old: Table = _table("fsw_real", "inputs", "states", unit="x/u")
    model_new: Table = _table("fsw_real", "inputs", "states", unit="x/u")
    model_w: Table = _table("fsw_real", "states", "disturbances", unit="x/w")
    model_c: Table = _table("fsw_real", "states", unit="x")
    gain: Table | None = _table("fsw_real", "states + loads", "measured", unit="x/y")
    output_row: Table | None = _table("fsw_real", "measured", "states", unit="y/x")
    output_offset: Table | None = _table("fsw_real", "measured", unit="y")
    start_row: Table | None = _table("fsw_real", "states", "measured", unit="x/y")
    start_offset: Table | None = _table("fsw_real", "states", unit="x")
    gate: Table | None = _table("fsw_real", "measured", "measured", unit="1/y^2")
    horizon: HorizonDesign | None = None

    @property
    def level_total(self) -> int:
        """Levels of all inputs."""
        return int(self.level_count.sum())

    @property
    def pending_levels(self) -> int:
        """Commands under way times the levels that each may have, of all inputs."""
        return int(self.pending.astype(np.int64) @ self.level_count)

    @property
    def hold_total(self) -> int:
        """Holding times of all inputs."""
        return int(self.holds.sum())
