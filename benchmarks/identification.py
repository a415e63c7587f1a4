"""Identification on synthetic records of every structure: bias, coverage, declared dead times; time by record length.

`python benchmarks/identification.py [RUNS [STRUCTURE ...]]`: RUNS per structure, default 1020, on all cores; leaves with
1 if a limit is missed. Bias is in standard deviations of one run, scatter in those of the Cramer-Rao bound. Noise is such
that the least certain parameter has a relative standard deviation of 0.5, 2 or 5 %.
"""

import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np

import foreswitch as fsw
from foreswitch.identification.structures import STRUCTURES
from oracles import record as oracle

EVERY = (*STRUCTURES, "integrator+integrator")
BIAS, COVERAGE, DECLARED = 0.1, (0.90, 0.98), 0.1
#: Largest scatter in standard deviations of the Cramer-Rao bound: a fit that ended in a wrong valley would show here.
SPREAD = 1.25
#: Largest ratio of the times at ten times the samples: linear, with caches in between.
LINEAR = 15.0


def plants(runs: int) -> list[int]:
    """Seeds; each plant is identified at every noise level, with the noise and its negative."""
    return list(range(1000, 1000 + max(1, runs // (2 * len(oracle.LEVELS)))))


def table(runs: int, structures: Sequence[str]) -> bool:
    """Print a row per structure and noise level; whether all limits hold."""
    print(f"{'structure':<22}{'noise':>6}{'runs':>6}  {'coverage':>8}{'clear':>6}{'declared':>9}{'scatter':>8}  bias")
    passed = True
    with ProcessPoolExecutor() as pool:
        for structure in structures:
            seeds = plants(runs)
            parts = list(pool.map(oracle.study, [structure] * len(seeds), seeds, chunksize=4))
            results = [result for part in parts for result in part]
            for level in oracle.LEVELS:
                print(row(structure, f"{100 * level:g} %", [r for r in results if r.level == level]), flush=True)
            whole = oracle.summary(results)
            held = (
                max(map(abs, whole.bias.values())) < BIAS
                and max(whole.spread.values()) < SPREAD
                and COVERAGE[0] <= whole.coverage <= COVERAGE[1]
                and whole.declared < DECLARED
            )
            print(row(structure, "all", results) + ("" if held else "  FAILED"), flush=True)
            passed &= held
    return passed


def row(structure: str, noise: str, results: list[oracle.Result]) -> str:
    found = oracle.summary(results)
    bias = "  ".join(f"{name} {value:+.3f}" for name, value in found.bias.items())
    share, scatter = f"{found.declared:.3f}" if found.clear else "-", max(found.spread.values())
    head = f"{structure:<22}{noise:>6}{found.runs:>6}  {found.coverage:>8.3f}{found.clear:>6}{share:>9}"
    return f"{head}{scatter:>8.2f}  {bias}"


def seconds(samples: int) -> float:
    """Seconds of the processor, for a record of pulses of the paper's kind of plant."""
    t, rng = 1e-3 * np.arange(samples), np.random.default_rng(1)
    u = np.repeat(rng.integers(0, 2, samples // 20 + 1), 20)[:samples].astype(float)
    delayed = np.r_[np.zeros(5), u[:-5]]
    slope = np.convolve(delayed, 0.001 / 0.006 * np.exp(-np.arange(100) / 6.0))[:samples]
    y = np.cumsum(slope) * 1e-3 + 1e-4 * rng.standard_normal(samples)
    record, start = fsw.Record(t, u, y), process_time()
    fsw.identify(record, "integrator+lag")
    return process_time() - start


def main() -> int:
    passed = table(int(sys.argv[1]) if len(sys.argv) > 1 else 1020, sys.argv[2:] or EVERY)
    short, long = seconds(100_000), seconds(1_000_000)
    print(f"integrator+lag of 1e5 samples {short:.1f} s, of 1e6 {long:.1f} s: ratio {long / short:.1f}")
    return 0 if passed and long / short < LINEAR else 1


if __name__ == "__main__":
    sys.exit(main())
