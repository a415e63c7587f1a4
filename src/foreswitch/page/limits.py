"""What the page takes on: bounds of every request, so that none holds up another."""

from __future__ import annotations

from typing import Any

__all__ = ["LIMITS", "LONGEST_JOB"]

#: Told to the page in start.json; sizes in bytes, times in seconds.
LIMITS: dict[str, Any] = {
    "message": 1 << 20,  # a project with 20 000 points of a reference in both columns
    "record": 8 << 20,  # a CSV file: about 300 000 rows
    "steps": 100_000,  # periods of one run
    "told": 10_000_000,  # numbers that a run tells the controller of its reference
    "states": 32,
    "nodes": 4_000_000,  # partial sequences of all of a run's searches
    "sentence": 400,  # characters
}

#: Seconds until a job is ended with its process.
LONGEST_JOB = {"look": 4.0, "costs": 4.0, "certify": 40.0, "baseline": 60.0, "identify": 60.0, "export": 90.0}
