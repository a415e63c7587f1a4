"""`make bench`: one table, every ratio measured within one run; leaves with 1 if a gate fails."""

import os
import sys

for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

# numpy reads them when it is imported
import batch  # noqa: E402
import closed_loop  # noqa: E402
import counts  # noqa: E402
import denormals  # noqa: E402
import python_step  # noqa: E402
import table  # noqa: E402


def main() -> int:
    print(table.HEAD)
    failed = 0
    for benchmark in (closed_loop, python_step, denormals, batch, counts):
        for row in benchmark.rows():
            print(table.line(row), flush=True)
            failed += not row.passed
    print(f"{failed} gate(s) failed" if failed else "all gates hold")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
