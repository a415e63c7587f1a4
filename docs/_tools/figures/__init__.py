"""Pictures of the pages, and the numbers that go with them, computed while the site is built: a module for each page."""

from __future__ import annotations

from pathlib import Path

from figures.baselines import rivals
from figures.certificate import certificate
from figures.estimation import estimation
from figures.hardware import rig
from figures.identification import experiment, pulses
from figures.paper import Values
from figures.runs import batch, study
from figures.theory import decision, fractional, lag, preview, tails, wear

PARTS = (
    decision, fractional, tails, lag, preview, wear, rivals, rig, batch, study, certificate, estimation, pulses, experiment,
)  # fmt: skip


def draw(folder: Path) -> Values:
    """All pictures into the folder; the numbers for the text."""
    return {name: float(value) for part in PARTS for name, value in part(folder).items()}
