"""`make bench`: one table, every ratio measured within one process.

Counts gate: one over its limit leaves with 1. Times are reported beside their limits and gate with `--strict` only:
where two hardware threads share a core, a neighbour's work halves the speed of a loop that uses the core's whole width
and leaves alone one that waits for its own results, so that even a ratio of two loops in turn depends on the neighbour.
"""

import os
import subprocess
import sys
import time
from importlib import import_module

TIMES = ("closed_loop", "python_step", "denormals", "batch", "horizon", "study", "page_load")
COUNTS = ("counts", "targets_counts", "certificates", "page_counts")
#: Those that take a share of their work, and all of it with `--full`.
SHORTENED = ("study", "certificates")
#: Seconds to wait before each try of a benchmark: the neighbour may have finished by then.
TRIES = (0.0, 2.0, 10.0)
MISSED = 3  # exit code of one benchmark; any other failure is a defect


def one(name: str, full: bool) -> int:
    """Print the rows of one benchmark."""
    from table import line

    passed = True
    for row in import_module(name).rows(*([full] if name in SHORTENED else [])):
        print(line(row), flush=True)
        passed &= row.passed
    return 0 if passed else MISSED


def attempt(name: str, full: bool) -> int:
    """A process for one benchmark, again while it misses a limit; its last rows are printed."""
    # numpy reads them when it is imported
    single = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}
    command = [sys.executable, __file__, name, *(["--full"] if full else [])]
    for wait in TRIES:
        time.sleep(wait)
        result = subprocess.run(command, env=os.environ | single, capture_output=True, text=True)
        if result.returncode != MISSED:
            break
    print(result.stdout + result.stderr, end="", flush=True)
    return result.returncode


def every(strict: bool, full: bool) -> int:
    """Print the table."""
    from table import HEAD

    print(HEAD, flush=True)
    codes = {name: attempt(name, full) for name in TIMES + COUNTS}
    late = [name for name in TIMES if codes[name] == MISSED]
    broken = [name for name, code in codes.items() if code and name not in late]
    if late:
        print(f"slower than wanted, now: {', '.join(late)}")
    print(f"gates failed: {', '.join(broken)}" if broken else "all counts hold")
    return 1 if broken or (strict and late) else 0


if __name__ == "__main__":
    names = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    full = "--full" in sys.argv
    sys.exit(one(names[0], full) if names else every("--strict" in sys.argv, full))
