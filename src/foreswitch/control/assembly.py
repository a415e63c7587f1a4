"""All parts of a controller put together as the design that the core reads."""

from __future__ import annotations

import numpy as np

from foreswitch.control.actuator import Actuator
from foreswitch.control.design import Design
from foreswitch.control.endpoint import EndpointLaw
from foreswitch.control.horizon import HorizonLaw
from foreswitch.control.kalman import Filter
from foreswitch.model.plant import Plant
from foreswitch.model.prediction import PeriodModel

__all__ = ["assembled"]


def assembled(
    real: str,
    plant: Plant,
    model: PeriodModel,
    actuator: Actuator,
    law: EndpointLaw | HorizonLaw,
    kalman: Filter | None,
    *,
    bad_limit: int,
    gate_limit: int,
) -> Design:
    """The design of core/foreswitch.h.

    Parameters
    ----------
    real : {"float64", "float32"}
    plant : Plant
        Without the loads.
    model : PeriodModel
        Over one switching period, the loads behind the measured disturbances.
    actuator, law, kalman
        Commands, objective and filter, designed.
    bad_limit, gate_limit : int
        As in core/foreswitch.h; 0 for never.
    """
    disturbances, rest, exact = model.disturbance.shape[1], law.rest, np.concatenate(actuator.levels)
    return Design.made(
        real,
        states=plant.states,
        inputs=plant.inputs,
        outputs=plant.outputs,
        disturbances=disturbances,
        order=law.sliding.reference.shape[1],
        rows=max(model.delay) + 1,
        candidates=len(actuator.candidates),
        bad_limit=bad_limit,
        measured=plant.states if kalman is None else plant.outputs,
        loads=disturbances - plant.disturbances,
        gate_limit=gate_limit,
        level_count=[values.size for values in actuator.levels],
        exact_levels=exact,
        levels=exact,
        candidate=actuator.candidates,
        safe=actuator.safe,
        pending=model.delay,
        rest_reference=rest and rest.reference,
        rest_disturbance=rest and rest.disturbance,
        rest_offset=rest and rest.offset,
        dwell=np.concatenate(actuator.dwell),
        switch_cost=actuator.switch_cost,
        model_x=model.transition,
        model_old=model.old,
        model_new=model.new,
        model_w=model.disturbance,
        model_c=model.drift,
        gain=kalman and kalman.gain,
        output_row=kalman and plant.C,
        output_offset=kalman and plant.y_offset,
        start_row=kalman and kalman.start_row,
        start_offset=kalman and kalman.start_offset,
        gate=kalman and kalman.gate,
        horizon=law.horizon(real),
        **law.tables(),
    )
