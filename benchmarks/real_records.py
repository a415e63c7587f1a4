"""Open-loop prediction of measured records, beside a plain first-order fit and an ARX fit.

    python benchmarks/real_records.py FOLDER [--write]

FOLDER holds the records, which are not part of this repository; docs/guide/identification.md says where they are from. Each
model is fitted to the first part of a record and then simulated over all of it, from the record's first sample and its
commands alone; no measurement after the cut is used. ``--write`` keeps the figures in real_records.json beside it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from foreswitch import Record, identify

TARGET = Path(__file__).parent / "real_records.json"
#: The cut between fitted and predicted stretch is the change of an input nearest to this share of the record.
SHARE = 0.7
#: Longest dead time that every method may try, in shares of the fitted stretch.
LONGEST = 0.1
#: ARX orders.
ORDERS = range(1, 5)


class Case(NamedTuple):
    """One output of a file; columns from 0. The commands are raised to a power: a lamp's heat goes with the square."""

    name: str
    file: str
    inputs: tuple[int, ...]
    output: int
    unit: str
    header: int = 0
    power: int = 1


CASES = (
    Case("heater step", "tclab/data_step_test.csv", (1,), 2, "K"),
    Case("two heaters, first", "tclab/energy_balance_mimo_data.txt", (1, 2), 3, "K", 1),
    Case("two heaters, second", "tclab/energy_balance_mimo_data.txt", (1, 2), 4, "K", 1),
    Case("lamp and plate", "daisy_heating/heating_system.dat", (1,), 2, "K"),
    Case("lamp, drive squared", "daisy_heating/heating_system.dat", (1,), 2, "K", power=2),
)


class Data(NamedTuple):
    """Arrays of one case and the first sample that is not fitted."""

    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    cut: int


def read(folder: Path, case: Case) -> Data:
    path = folder / case.file
    rows = np.loadtxt(path, delimiter="," if path.suffix != ".dat" else None, skiprows=case.header)
    t, u, y = rows[:, 0], rows[:, case.inputs] ** case.power, rows[:, case.output]
    edges = np.flatnonzero(np.diff(u, axis=0).any(axis=1)) + 1
    cut = int(edges[np.argmin(np.abs(t[edges] - t[0] - SHARE * (t[-1] - t[0])))])
    return Data(t, u, y, cut)


# ---- Ours ----


def ours(data: Data) -> tuple[np.ndarray, str]:
    """The structure that `identify` chooses by itself."""
    record = Record(data.t, data.u, data.y)
    fitted = record.between(data.t[0], data.t[data.cut])
    fit = identify(fitted, longest_delay=LONGEST * float(np.ptp(fitted.t)))
    drift = any(candidate.chosen and candidate.drift for candidate in fit.candidates)
    return fit.simulate(record)[:, 0], str(fit.structure) + ", drift" * drift


# ---- First order and dead time, as in textbooks ----


def first_order(t: np.ndarray, u: np.ndarray, start: float, K: float, T: float, L: float) -> np.ndarray:
    """Solution of ``T x' = -x + K u(t - L)`` from ``x = start``, exact for held commands; before the record, the first."""
    edges = np.flatnonzero(np.diff(u)) + 1
    after = np.maximum(t[:, None] - t[edges] - L, 0.0)
    forced = K * (1.0 - np.exp(-after / T)) @ np.diff(u)[edges - 1]
    free = np.exp(-(t - t[0]) / T)
    return forced + K * u[0] * (1.0 - free) + start * free


def fopdt(data: Data) -> tuple[np.ndarray, str]:
    """Gain, time constant and dead time of each input and an offset, least squares, from the first measurement on."""
    t, m, n = data.t, data.u.shape[1], data.cut
    span = t[n - 1] - t[0]

    def output(p: np.ndarray) -> np.ndarray:
        y = np.full(t.size, p[-1])
        for j in range(m):
            K, T, L = p[3 * j : 3 * j + 3]
            start = data.y[0] - p[-1] if j == 0 else K * data.u[0, j]  # one starts as measured, the others at rest
            y += first_order(t, data.u[:, j], start, K, np.exp(T), L)
        return y

    low = [*[-np.inf, np.log(1e-3 * span), 0.0] * m, -np.inf]
    high = [*[np.inf, np.log(span), LONGEST * span] * m, np.inf]
    swing = np.ptp(data.y[:n]) / np.ptp(data.u[:n], axis=0)
    best = None
    for share, delay in product((0.05, 0.2, 0.5), (0.01, 0.05)):
        each = np.column_stack([swing, np.full(m, np.log(share * span)), np.full(m, delay * span)])
        start = np.r_[each.ravel(), data.y[0]]
        found = least_squares(lambda p: (output(p) - data.y)[:n], start, bounds=(low, high), x_scale="jac")
        best = found if best is None or found.cost < best.cost else best
    numbers = best.x[:-1].reshape(m, 3)
    return output(best.x), "; ".join(f"K {K:.3g}, T {np.exp(T):.3g} s, L {L:.3g} s" for K, T, L in numbers)


# ---- ARX ----


def arx(data: Data) -> tuple[np.ndarray, str]:
    """``y[k] = sum a y[k-i] + sum b u[k-d-i] + c``, orders and dead time by AIC, run free from the first samples."""
    y, n, m = data.y, data.cut, data.u.shape[1]
    Ts = float(np.median(np.diff(data.t)))
    longest = int(LONGEST * n)
    first = longest + max(ORDERS)  # the same equations for all, or their criteria could not be compared
    # several inputs share their orders, and each has its dead time: found one after the other
    best, delays = (np.inf, None), [0] * m

    def regressors(na: int, nb: int, d: list[int]) -> np.ndarray:
        columns = [y[first - i : n - i] for i in range(1, na + 1)]
        columns += [data.u[first - d[j] - i : n - d[j] - i, j] for j in range(m) for i in range(1, nb + 1)]
        return np.column_stack([*columns, np.ones(n - first)])

    def criterion(na: int, nb: int, d: list[int]) -> float:
        X = regressors(na, nb, d)
        left = y[first:n] - X @ np.linalg.lstsq(X, y[first:n], rcond=None)[0]
        return float((n - first) * np.log(left @ left / (n - first)) + 2.0 * (X.shape[1] + m))

    for na, nb in product(ORDERS, ORDERS):
        delays = [0] * m
        for j in [*range(m)] * (1 if m == 1 else 2):
            delays[j] = min(range(longest), key=lambda d: criterion(na, nb, [*delays[:j], d, *delays[j + 1 :]]))
        value = criterion(na, nb, delays)
        if value < best[0]:
            best = value, (na, nb, list(delays))
    na, nb, delays = best[1]
    coefficients = np.linalg.lstsq(regressors(na, nb, delays), y[first:n], rcond=None)[0]
    past = np.vstack([np.repeat(data.u[:1], first, axis=0), data.u])  # commands before the record: the first
    free = np.r_[np.full(na, y[0]), np.empty(y.size)]
    free[na] = y[0]
    for k in range(1, y.size):
        row = [free[na + k - i] for i in range(1, na + 1)]
        row += [past[first + k - d - i, j] for j, d in enumerate(delays) for i in range(1, nb + 1)]
        free[na + k] = np.dot(coefficients[:-1], row) + coefficients[-1]
    lags = ", ".join(f"{d * Ts:.3g} s" for d in delays)
    return free[na:], f"{na} poles, {nb} numerator terms, dead time {lags}"


METHODS: dict[str, Callable[[Data], tuple[np.ndarray, str]]] = {"identify": ours, "FOPDT": fopdt, "ARX": arx}


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def curve(data: Data) -> str:
    """What `identify` says of the whole record if it is not linear."""
    warnings = identify(Record(data.t, data.u, data.y)).warnings
    return next((sentence for sentence in warnings if "settles on a curve" in sentence), "")


def row(folder: Path, case: Case) -> dict[str, object]:
    """All methods on one case."""
    data = read(folder, case)
    result: dict[str, object] = {
        "name": case.name, "file": case.file, "unit": case.unit, "samples": data.t.size,
        "fitted_until": round(float(data.t[data.cut])), "until": round(float(data.t[-1])),
        "swing": round(float(np.ptp(data.y[data.cut :])), 2),
    }  # fmt: skip
    if data.u.shape[1] == 1:
        result["curve"] = curve(data)
    for name, method in METHODS.items():
        y, model = method(data)
        fitted, rest = rms((y - data.y)[: data.cut]), rms((y - data.y)[data.cut :])
        result[name] = {"model": model, "fitted": round(fitted, 2), "predicted": round(rest, 2)}
        print(f"{case.name:<22}{name:<10}{fitted:8.2f}{rest:10.2f} {case.unit}  {model}", flush=True)
    return result


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("give the folder of the records: python benchmarks/real_records.py FOLDER [--write]")
    print(f"{'record':<22}{'model':<10}{'fitted':>8}{'predicted':>10}")
    rows = [row(Path(sys.argv[1]), case) for case in CASES]
    if "--write" in sys.argv[2:]:
        TARGET.write_text(json.dumps(rows, indent=1) + "\n")
