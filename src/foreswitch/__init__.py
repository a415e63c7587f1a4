"""Predictive control of actuators that can only switch and act after a dead time."""

from foreswitch import baselines
from foreswitch.batch import Batch, simulate_batch
from foreswitch.certificate import Certificate, certify
from foreswitch.controller import Controller, Decision, Status
from foreswitch.estimator import Kalman
from foreswitch.experiment import PulseTest, propose_test
from foreswitch.export import export_c
from foreswitch.fit import Candidate, Fit
from foreswitch.fmu import export_fmu
from foreswitch.hardware import Hardware, Stuck
from foreswitch.identify import identify
from foreswitch.loop import simulate
from foreswitch.nonlinear import FmuPlant, NonlinearPlant
from foreswitch.objective import Endpoint, Horizon
from foreswitch.plant import Plant
from foreswitch.precision import Precision, compare_precision
from foreswitch.record import Record
from foreswitch.reference import HalfSine, Ramp, Reference, Samples, Sine, Stack, Steps
from foreswitch.run import Run
from foreswitch.study import Study, study
from foreswitch.study_draw import LogUniform, Normal, OneOf, Uniform

__all__ = [
    "Batch",
    "Candidate",
    "Certificate",
    "Controller",
    "Decision",
    "Endpoint",
    "Fit",
    "FmuPlant",
    "HalfSine",
    "Hardware",
    "Horizon",
    "Kalman",
    "LogUniform",
    "NonlinearPlant",
    "Normal",
    "OneOf",
    "Plant",
    "Precision",
    "PulseTest",
    "Ramp",
    "Record",
    "Reference",
    "Run",
    "Samples",
    "Sine",
    "Stack",
    "Status",
    "Steps",
    "Stuck",
    "Study",
    "Uniform",
    "baselines",
    "certify",
    "compare_precision",
    "export_c",
    "export_fmu",
    "identify",
    "propose_test",
    "simulate",
    "simulate_batch",
    "study",
]
