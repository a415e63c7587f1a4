"""What the page takes on: bounds of every request, so that none holds up another."""

from __future__ import annotations

from typing import Any

__all__ = ["LIMITS", "LONGEST_JOB"]

#: Told to the page in start.json.
LIMITS: dict[str, Any] = {
    "message": 1 << 20,  # bytes of a request with its project
    "points": 20_000,  # of a reference: with all digits, three quarters of such a request
    "record": 8 << 20,  # bytes of a CSV file: some 300 000 rows
    "clients": 64,  # pages at once
    "steps": 100_000,  # periods of one run
    "valve_steps": 20_000,  # where Python is called in each period, for a disturbance that follows the output
    "told": 10_000_000,  # numbers that a run tells the controller of its reference: 80 MB
    "tried": 100_000_000,  # commands tried in one run: about a second
    "nodes": 4_000_000,  # partial sequences searched in one run, about half a second; and at least so many per step:
    "least_nodes": 200,
    "states": 64,  # as the core holds them
    "late": 1000,  # periods that a sample may be late, all of which each period looks through
    "faults": 100,  # outages, and as many stuck actuators
    "sentence": 400,  # characters
}

#: Seconds until a job is ended with its process.
LONGEST_JOB = {
    "look": 4.0, "costs": 4.0, "certify": 40.0, "baseline": 60.0,
    "project": 10.0, "columns": 20.0, "identify": 120.0, "export": 90.0,
}  # fmt: skip
