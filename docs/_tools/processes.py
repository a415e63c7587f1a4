"""Python scripts run beside each other, each with a folder of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

Running = dict[str, tuple[Path, subprocess.Popen[str]]]


def started(commands: dict[str, tuple[Path, list[str]]]) -> Running:
    """Python scripts, each with a folder of its own that is made for it, all at once."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "error", "COLUMNS": "100"}
    running = {}
    for name, (out, command) in commands.items():
        out.mkdir(parents=True)
        process = subprocess.Popen([sys.executable, *command], env=environment, stdout=subprocess.PIPE, text=True)
        running[name] = out, process
    return running


def ended(running: Running) -> dict[str, str]:
    """What each of them printed."""
    printed = {}
    for name, (_, process) in running.items():
        printed[name], _ = process.communicate()
        if process.returncode:
            raise RuntimeError(f"{name} failed with exit code {process.returncode}")
    return printed
