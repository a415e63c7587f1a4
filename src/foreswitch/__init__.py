"""Predictive control of actuators that can only switch and act after a dead time."""

from foreswitch import baselines
from foreswitch.controller import Controller, Decision, Status
from foreswitch.loop import Run, simulate
from foreswitch.objective import Endpoint
from foreswitch.plant import Plant
from foreswitch.reference import HalfSine, Ramp, Reference, Samples, Sine, Stack, Steps

__all__ = [
    "Controller",
    "Decision",
    "Endpoint",
    "HalfSine",
    "Plant",
    "Ramp",
    "Reference",
    "Run",
    "Samples",
    "Sine",
    "Stack",
    "Status",
    "Steps",
    "baselines",
    "simulate",
]
