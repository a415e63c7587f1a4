"""The binding takes tables by name, and says which one does not fit."""

from functools import partial

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch._binding import CORES
from foreswitch.control.design import Design, HorizonDesign
from systems import valve_controller

CORE = CORES["float64"]
BLOCK = partial(np.empty, (64, 1))


def designs():
    for objective in (fsw.Endpoint(Td=0.02, lam=2500.0), fsw.Horizon(4, terminal="riccati", move_weight=1.0)):
        estimator = fsw.Kalman(1.0, 1.0, load=1e-6)
        valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
        yield fsw.Controller(valve, [0, 1], 1e-3, objective, estimator=estimator, min_on=0.002).design


def bound(design, **changes):
    horizon = design.horizon
    return CORE.Predictive(vars(design) | changes, None if horizon is None else vars(horizon), BLOCK)


@pytest.mark.parametrize("design", list(designs()), ids=["endpoint", "horizon"])
def test_every_table_is_looked_up_by_name(design):
    """Whatever order they stand in; one that is missing, or of another size or type, is named."""
    bound(design)
    backwards = dict(reversed(list(vars(design).items())))
    CORE.Predictive(backwards, design.horizon and vars(design.horizon), BLOCK)
    for part, given in ((design, vars(design)), (design.horizon, design.horizon and vars(design.horizon))):
        for each in part.tables() if part else ():
            wrong = {key: value for key, value in given.items() if key != each.name}
            values = given[each.name]
            changed = [wrong] if values is None else [wrong, wrong | {each.name: np.append(values, values[:1])}]
            changed += [] if values is None else [wrong | {each.name: values.astype(np.complex128)}]
            for tables in changed:
                if values is not None and not values.size and tables is not wrong:
                    continue  # nothing appended to nothing is nothing
                pair = (tables, None if design.horizon is None else vars(design.horizon))
                pair = pair if part is design else (vars(design), tables)
                with pytest.raises(ValueError, match=rf"^{each.name} "):
                    CORE.Predictive(*pair, BLOCK)


@pytest.mark.parametrize("value", [-1, 65536, 2.5, None])
def test_a_size_out_of_range_is_named(value):
    with pytest.raises(ValueError, match=r"states is .*; give a whole number from 0 to 65535"):
        bound(valve_controller().design, states=value)


def test_a_table_that_does_not_fit_its_declared_shape_is_never_a_design():
    """The declaration is held where the design is made, before C."""
    design = valve_controller().design
    with pytest.raises(AssertionError, match=r"state_row has 3 items, not 2 \(outputs, states\)"):
        Design(**vars(design) | {"state_row": np.zeros(3)})


def test_shapes_and_units_are_declared_for_every_table():
    for kind in (Design, HorizonDesign):
        for each in kind.tables():
            assert each.metadata["unit"], each.name
            assert each.metadata["shape"], each.name
        assert {each.metadata["kind"] for each in kind.tables()} <= {
            "fsw_real", "double", "uint8_t", "uint16_t", "uint32_t",
        }  # fmt: skip


def test_figures_of_a_run_without_rows_are_refused():
    none = np.zeros((0, 1))
    tables = {"y": none, "r": none, "u": none, "safe": np.zeros(1)}
    tables |= {name: np.zeros(1) for name in ("rms", "largest", "switches", "on")}
    with pytest.raises(ValueError, match="a run has no rows; give at least one instant"):
        CORE.metrics(0, 1, 1, tables)
