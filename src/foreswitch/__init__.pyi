# Every public name and where it lives: read by type checkers, and by __init__.py when a name is first used.
from . import baselines as baselines
from .certificate.certificate import Certificate as Certificate, certify as certify
from .control.controller import Controller as Controller
from .control.decision import Decision as Decision, Status as Status
from .control.kalman import Kalman as Kalman
from .control.objective import Endpoint as Endpoint, Horizon as Horizon
from .export.firmware import export_c as export_c
from .export.fmu import export_fmu as export_fmu
from .identification.fit import Fit as Fit, FittedStructure as FittedStructure
from .identification.pulse_test import PulseTest as PulseTest, propose_test as propose_test
from .identification.record import Record as Record
from .identification.search import identify as identify
from .model.hardware import Hardware as Hardware, Stuck as Stuck
from .model.nonlinear import FmuPlant as FmuPlant, NonlinearPlant as NonlinearPlant
from .model.plant import Plant as Plant
from .model.reference import (
    HalfSine as HalfSine,
    Ramp as Ramp,
    Reference as Reference,
    Samples as Samples,
    Sine as Sine,
    Stack as Stack,
    Steps as Steps,
)
from .simulation.batch import Batch as Batch, simulate_batch as simulate_batch
from .simulation.loop import simulate as simulate
from .simulation.precision import Precision as Precision, compare_precision as compare_precision
from .simulation.run import Run as Run
from .studies.distributions import LogUniform as LogUniform, Normal as Normal, OneOf as OneOf, Uniform as Uniform
from .studies.result import Study as Study
from .studies.sweep import study as study
