"""Certificates against an adversary: random designs of every kind, and designs that must be refused.

`python benchmarks/certificates.py [--full]`: leaves with 1 if a bound is broken, is loose, or is given where none holds.
Prints per class of plant and shape: bounds, broken ones, and bound over the worst deviation that was found.
"""

import os
import sys
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np

import foreswitch as fsw
from certificate.designs import certified, draw
from foreswitch.certificate import margins, reasons
from oracles.adversary import attack
from oracles.certificate import Rival
from table import Row

DRAWN, FEW = 2500, 60
FIRST = 10_000
#: Median of bound over worst found, of all.
LOOSE = 3.0
ROUND_OFF = 1.0 + 1e-9
#: What a reason must say, by the condition that was made to fail.
WORDS = {
    "pole": "pole at |z|",
    "coarse levels": "quantiser overloads",
    "reference": "needs an ideal input",
    "delay error": "delay_error of",
    "gain error": "gain_error of",
    "noise": "noise of",
}


def judged(seed: int) -> tuple[str, list[tuple[float, float]], list[tuple[str, bool, bool]], float]:
    """Kind and shape; of each bound 1 / (1 + least slack) and median ratio; refusals: condition, right words, broken."""
    start = process_time()
    reasons._remedy = lambda *_: "try others"  # type: ignore[assignment] # slow, and not judged here
    margins.fastest = lambda *_: 0.0  # type: ignore[assignment]
    kind, controller, errors = draw(seed)
    bounds: list[tuple[float, float]] = []
    refusals: list[tuple[str, bool, bool]] = []
    if controller is None:
        return kind, bounds, refusals, process_time() - start
    name = f"{kind}, {controller.plant.inputs} to {controller.plant.outputs}"
    certificate, borne = certified(controller, errors)
    if certificate is None:
        refusals.append(refused_as_it_is(controller))
        return name, bounds, refusals, process_time() - start
    for (low, high), bound in certificate.arguments:
        worst = attack(controller, low, high, seed=seed, **borne)
        if worst is not None:
            ratio = bound / np.maximum(worst, 1e-300)
            bounds.append((float(ratio.min()), float(np.median(ratio))))
    if seed % 4 == 0:
        refusals += made_to_fail(controller, seed)
    return name, bounds, refusals, process_time() - start


def refused_as_it_is(controller: fsw.Controller) -> tuple[str, bool, bool]:
    """A design without a bound: why, and whether errors outgrow what would be its bound.

    With a pole outside the unit circle ten times the actuator's resolution counts as that, else the bound of an error of
    half a gap in each input.
    """
    certificate = fsw.certify(controller)
    rival = Rival(controller)
    why = "pole" if pole(rival) >= 1.0 or WORDS["pole"] in certificate.reasons[0] else "coarse levels"
    gaps = np.array([np.diff(v).max() for v in rival.levels])
    would_be = 10.0 * certificate.resolution
    if why == "coarse levels":
        would_be = 0.5 * (np.abs(rival.impulses(60)[0]).sum(axis=0) @ gaps).max(axis=0)
    hull = np.array([[v[0], v[-1]] for v in rival.levels]).T
    worst = attack(controller, *hull, rounds=1, lanes=16, periods=240)
    return why, WORDS[why] in certificate.reasons[0], worst is not None and bool((worst > would_be).any())


def pole(rival: Rival) -> float:
    """Size of the slowest pole of the loop with an unquantised input, commands under way and all."""
    size = rival.n + rival.line * rival.m
    matrix = np.zeros((size, size))
    K = -rival.choice @ np.hstack([rival.see, rival.pending])
    step = rival.known_step[0]
    matrix[: rival.n, : rival.n] = rival.phi
    matrix[: rival.n, rival.n :] = step[:, : -rival.m]
    matrix[: rival.n] += step[:, -rival.m :] @ K
    line = rival.line * rival.m
    matrix[rival.n : size - rival.m, rival.n + rival.m :] = np.eye(line - rival.m)
    matrix[size - rival.m :] = K
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def made_to_fail(controller: fsw.Controller, seed: int) -> Iterator[tuple[str, bool, bool]]:
    """Conditions of a design with a bound, broken one by one."""
    rng = np.random.default_rng(seed)
    plain = fsw.certify(controller)
    if not plain.holds:
        return
    (low, high), bound = plain.arguments[-1]
    plant, Ts = controller.plant, controller.Ts
    span = np.array([np.ptp(v) for v in controller.levels])
    far = fsw.certify(controller, reference=1e4 * plain.resolution + plant.y_offset, duration=50 * Ts)
    if not far.holds:
        beyond = attack(controller, low - span, high + span, rounds=1, lanes=16)
        yield "reference", WORDS["reference"] in far.reasons[0], beyond is not None and bool((beyond > bound).any())
    rows = plant.C if controller.kalman else np.eye(plant.states)
    pulse = np.abs(rows @ plant.B * Ts).max(axis=1)
    label, errors = [
        ("delay error", {"delay_error": Ts * rng.choice([2.0, 6.0])}),
        ("gain error", {"gain_error": 0.9}),
        ("noise", {"noise": 50.0 * pulse}),
    ][rng.integers(3)]
    certificate = fsw.certify(controller, **errors)
    if not certificate.holds:
        worst = attack(controller, low, high, rounds=1, lanes=32, seed=seed, **errors)
        words = WORDS[label] in certificate.reasons[0] or "gate" in certificate.reasons[0]
        yield label, words, worst is not None and bool((worst > bound).any())


def survey(full: bool) -> tuple[list[str], list[Row]]:
    """The table, and the rows of `make bench`."""
    seeds = range(FIRST, FIRST + (DRAWN if full else FEW))
    classes, reasons, spent = defaultdict(list), defaultdict(list), 0.0
    with ProcessPoolExecutor(None if full else 1) as pool:
        for name, bounds, refusals, seconds in pool.map(judged, seeds, chunksize=8):
            classes[name] += bounds
            spent += seconds
            for why, *rest in refusals:
                reasons[why].append(rest)
    lines = [f"{'class':<32}{'bounds':>8}{'broken':>8}{'median':>8}{'worst':>10}"]
    every = [each for found in classes.values() for each in found]
    for name, found in [*sorted(classes.items()), ("all", every)]:
        if found:
            middle, most = np.median([m for _, m in found]), max(m for _, m in found)
            lines.append(f"{name:<32}{len(found):>8}{broken(found):>8}{middle:>8.2f}{most:>10.3g}")
    lines.append(f"{'refused for':<32}{'designs':>8}{'wrong':>8}{'would have broken':>20}")
    for why, each in sorted(reasons.items()):
        wrong = sum(not said for said, _ in each)
        lines.append(f"{why:<32}{len(each):>8}{wrong:>8}{sum(broke for _, broke in each):>20}")
    lines.append(f"{spent:.0f} s of the processor")
    middle, wrong = (
        float(np.median([m for _, m in every])),
        sum(not said for each in reasons.values() for said, _ in each),
    )
    refused = sum(map(len, reasons.values()))
    rows = [
        Row("certificates: bounds, broken", f"{len(every)}", f"{broken(every)}", "", "0", broken(every) == 0),
        Row("bound over the worst found", f"{middle:.2f}", "", "median", f"<= {LOOSE:g}", middle <= LOOSE),
        Row("refused, for a wrong reason", f"{refused}", f"{wrong}", "", "0", wrong == 0),
    ]
    return lines, rows


def broken(found: list[tuple[float, float]]) -> int:
    return sum(least * ROUND_OFF < 1.0 for least, _ in found)


def rows(full: bool = False) -> Iterator[Row]:
    yield from survey(full)[1]


if __name__ == "__main__":
    lines, found = survey("--full" in sys.argv)
    print("\n".join(lines))
    sys.exit(not all(row.passed for row in found))
