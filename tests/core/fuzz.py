"""Arbitrary bytes as designs, under sanitizers: ``python tests/core/fuzz.py --seconds 30`` in CI, longer by hand.

Needs clang with libFuzzer. Starts from fuzz_corpus.txt, one input per line in hexadecimal digits; a finding is printed in
that form, to be added there once it is repaired, so that the tests replay it with any compiler.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
CORE = HERE.parent.parent / "core"
CORPUS = HERE / "fuzz_corpus.txt"
#: Small, so that their ends are often met.
LIMITS = {
    "MAX_STATES": 5, "MAX_INPUTS": 3, "MAX_OUTPUTS": 3, "MAX_DISTURBANCES": 3, "MAX_LINE": 16, "MAX_MOVES": 6,
    "MAX_STEPS": 8, "HORIZON_STATES": 7, "HORIZON_CANDIDATES": 6, "RECORDS": 3,
}  # fmt: skip
REALS = {"float64": [], "float32": ["-DFSW_SINGLE"]}
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def arguments(real: str, core: Path = CORE) -> list[str]:
    """What every compiler is told: defines, then sources."""
    limits = [f"-DFSW_{key}={value}" for key, value in LIMITS.items()]
    sources = [HERE / "fuzz.c", core / "foreswitch.c", core / "horizon.c"]
    return ["-std=c99", "-g", "-O1", "-ffp-contract=off", *REALS[real], *limits, f"-I{core}", *map(str, sources), "-lm"]


def fuzz(real: str, seconds: float, folder: Path) -> bool:
    """Whether nothing was found."""
    program, seeds = folder / real, folder / f"{real}-seeds"
    subprocess.run(["clang", "-fsanitize=fuzzer", *SANITIZERS, *arguments(real), "-o", program], check=True)
    seeds.mkdir()
    for i, line in enumerate(CORPUS.read_text().split()):
        (seeds / f"{i}").write_bytes(bytes.fromhex(line))
    options = [f"-max_total_time={seconds:.0f}", "-max_len=2048", "-timeout=20", f"-artifact_prefix={folder}/found-"]
    done = subprocess.run([program, *options, seeds], stderr=subprocess.PIPE, text=True)
    said = done.stderr.splitlines()
    print(f"{real}: {said[-1] if said else 'nothing said'}")
    if done.returncode:
        print("\n".join(said[-40:]))
        for path in folder.glob("found-*"):
            print(f"found: {path.read_bytes().hex()}")
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=30.0, help="for both arithmetics together")
    seconds = parser.parse_args().seconds
    if not shutil.which("clang"):
        print("fuzz.py needs clang with libFuzzer (Debian: clang, libclang-rt-14-dev)", file=sys.stderr)
        return 2
    with TemporaryDirectory() as name:
        clean = [fuzz(real, seconds / len(REALS), Path(name)) for real in REALS]
    return 0 if all(clean) else 1


if __name__ == "__main__":
    sys.exit(main())
