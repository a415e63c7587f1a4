"""Records whose truth is known, and the best that any unbiased identification could do with them.

Responses are sums of shifted step responses, written down by partial fractions: no states, no recursion, no matrix
exponential, so nothing is shared with the code under test. Poles must differ from each other.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.optimize import least_squares

import foreswitch as fsw

KINDS = ("pulses", "prbs", "steps", "levels")


@dataclass(frozen=True)
class Transfer:
    """numerator(s) / s^integrators / prod (s - pole)."""

    integrators: int
    poles: np.ndarray
    numerator: np.ndarray

    def step(self, t):
        """Response to a unit step at t = 0."""
        i = self.integrators
        on = np.maximum(t, 0.0)
        rest = np.real(np.poly(self.poles)) if self.poles.size else np.ones(1)
        series, remainder = [], np.r_[np.zeros(max(0, i + 1 - self.numerator.size)), self.numerator][::-1].astype(float)
        remainder = np.r_[remainder, np.zeros(rest.size)]
        for k in range(i + 1):  # Taylor coefficients of numerator / rest at 0
            series.append(remainder[k] / rest[-1])
            width = min(rest.size, remainder.size - k)
            remainder[k : k + width] -= series[-1] * rest[::-1][:width]
        y = sum(c * on ** (i - k) / factorial(i - k) for k, c in enumerate(series))
        for p in self.poles:
            others = np.prod([p - q for q in self.poles if q != p])
            y = y + np.real(np.polyval(self.numerator, p) / (p ** (i + 1) * others) * np.exp(p * on))
        return np.where(t > 0.0, y, 0.0)

    def free(self, t):
        """What an initial state can add, shape (t.size, n)."""
        columns = [t**k for k in range(self.integrators)]
        for p in self.poles:
            mode = np.exp(p * t)
            columns += [mode.real] if p.imag == 0.0 else [mode.imag if p.imag < 0.0 else mode.real]
        return np.column_stack(columns) if columns else np.empty((t.size, 0))


def transfer(structure, p):
    """From parameters by the names that a fit reports."""
    if structure.startswith("order"):
        n = int(structure.split()[1])
        a, b = [p[f"a{i + 1}"] for i in range(n)], [p[f"b{i + 1}"] for i in range(n)]
        return Transfer(0, np.roots([1.0, *a]).astype(complex), np.array(b))
    terms = structure.split("+")
    i, poles, gain = terms.count("integrator"), [], p.get("k", p.get("K"))
    for name, value in p.items():
        if name[0] in "cT":
            poles.append(-1.0 / value + 0j)
            gain = gain / value
        if name.startswith("omega"):
            zeta = p["zeta" + name[5:]]
            poles += [value * (-zeta + sign * np.sqrt(complex(zeta**2 - 1.0))) for sign in (1, -1)]
            gain = gain * value**2
    return Transfer(i, np.array(poles, dtype=complex), np.array([gain]))


def response(system, delay, t, edges, jumps):
    """Sum of step responses: the input jumps by ``jumps`` at the instants ``edges``."""
    return np.asarray(jumps) @ system.step(t - np.asarray(edges)[:, None] - delay)


def edges_of(t, u):
    """Instants and sizes of the jumps of a held input, its first value included."""
    at = np.flatnonzero(np.diff(u)) + 1
    return np.r_[t[0], t[at]], np.r_[u[0], np.diff(u)[at - 1]]


# ---- Random plants and experiments ----


@dataclass(frozen=True)
class Case:
    """A plant and a record of it without noise."""

    structure: str
    drift: bool
    truth: dict
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray


def random_truth(structure, rng):
    """Parameters in the order of ``Fit.parameters``; the slowest motion takes about ``scale`` seconds."""
    scale = float(10.0 ** rng.uniform(-2, 2))
    gain = float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-1, 1))
    truth = {}
    if structure.startswith("order"):
        n = int(structure.split()[1])
        poles = []
        if n % 2 or rng.random() < 0.4:
            poles += [-1.0]
        if len(poles) == 1 and n == 2:
            poles += [-rng.uniform(2.0, 5.0)]
        if len(poles) < n:
            w, z = rng.uniform(1.0, 3.0), rng.uniform(0.2, 0.8)
            poles += [w * complex(-z, np.sqrt(1 - z * z)), w * complex(-z, -np.sqrt(1 - z * z))]
        a = np.real(np.poly(poles))[1:] / scale ** np.arange(1, n + 1)
        b = gain * rng.choice([-1, 1], n) * rng.uniform(0.5, 1.5, n) / scale ** np.arange(1, n + 1)
        truth |= {f"a{i + 1}": float(v) for i, v in enumerate(a)} | {f"b{i + 1}": float(v) for i, v in enumerate(b)}
    else:
        terms = structure.split("+")
        i, lags, pairs = (terms.count(kind) for kind in ("integrator", "lag", "pair"))
        times = scale / np.cumprod([1.0, *rng.uniform(1.8, 4.0, max(0, lags - 1))])[:lags]
        letter = "c" if i else "T"
        truth |= {letter + (str(k + 1) if lags > 1 else ""): float(v) for k, v in enumerate(times)}
        if pairs:
            truth |= {"omega": float(rng.uniform(1.0, 3.0) / scale), "zeta": float(rng.uniform(0.1, 0.7))}
        truth["k" if i else "K"] = gain / (scale**i if i else 1.0)
    truth["delay"] = float(scale * rng.uniform(0.15, 1.2))
    return truth, scale


def random_input(t, scale, kind, rng):
    """Commands that change at samples, at rest in the first few."""
    if kind == "steps":
        count, values = int(rng.integers(3, 6)), None
        edges = t[0] + (t[-1] - t[0]) * (np.arange(count) + rng.uniform(0.1, 0.8, count)) / count
        values = np.cumsum(rng.choice([-1.0, 1.0], count) * rng.uniform(0.5, 1.0, count))
    elif kind == "pulses":
        edges, at = [], t[0] + scale * rng.uniform(0.3, 1.0)
        while at < t[-1]:
            edges += [at, at + scale * rng.uniform(0.4, 2.0)]
            at = edges[-1] + scale * rng.uniform(1.0, 4.0)
        values = np.arange(len(edges)) % 2 == 0
    else:
        edges = np.arange(t[0] + 0.3 * scale, t[-1], scale * rng.uniform(0.4, 1.2))
        values = rng.integers(0, 2 if kind == "prbs" else 4, len(edges))
    return np.r_[0.0, np.asarray(values, dtype=float)][np.searchsorted(edges, t, side="right")]


def random_case(structure, rng):
    """A random plant, recorded for some twenty times its slowest motion; a third of the records drift."""
    while True:
        truth, scale = random_truth(structure, rng)
        Ts = scale / rng.uniform(6.0, 15.0)
        t = Ts * np.arange(int(rng.integers(160, 260)))
        if rng.random() < 0.3:
            t = np.sort(t + Ts * rng.uniform(-0.3, 0.3, t.size))
        kind = KINDS[rng.integers(len(KINDS))]
        u = random_input(t, scale, kind, rng)
        if np.unique(u).size > 1 and np.count_nonzero(np.diff(u)) >= 3:
            break
    system, drift = transfer(structure, truth), bool(rng.random() < 0.33)
    y = response(system, truth["delay"], t, *edges_of(t, u))
    size = np.ptp(y)
    y = y + size * rng.normal(size=system.poles.size + system.integrators) @ (0.2 * system.free(t - t[0]).T)
    y = y + size * rng.normal()
    if drift:
        y = y + size * 0.3 * rng.normal() * ((t - t[0]) / np.ptp(t)) ** max(1, system.integrators)
    return Case(structure, drift, truth, t, u, y)


# ---- What can be known ----


def model(case, names, values):
    """Response at these parameters, and the columns of what initial state, offset and drift can add."""
    p = dict(zip(names, values, strict=True))
    structure = "+".join(
        "lag" if name[0] in "cT" else "pair" if name.startswith("omega") else "integrator"
        for name in [*["integrator"] * case.structure.split("+").count("integrator"), *names]
        if name == "integrator" or name[0] in "cT" or name.startswith("omega")
    )
    system = transfer(case.structure if case.structure.startswith("order") else structure, p)
    t = (case.t - case.t[0]) / np.ptp(case.t)
    columns = [system.free(case.t - case.t[0])] + ([] if system.integrators else [np.ones((t.size, 1))])
    if case.drift:
        columns.append(t[:, None] ** max(1, system.integrators))
    nuisance = np.hstack(columns)
    size = np.abs(nuisance).max(axis=0)
    return response(system, p["delay"], case.t, *edges_of(case.t, case.u)), nuisance / np.where(size > 0, size, 1.0)


def bound(case):
    """Cramer-Rao bound: standard deviations of the parameters for noise of standard deviation one."""
    names, values = list(case.truth), np.array(list(case.truth.values()))
    forced, nuisance = model(case, names, values)
    coefficients = np.linalg.lstsq(nuisance, case.y - forced, rcond=None)[0]
    Q = np.linalg.qr(nuisance)[0]
    G = np.empty((case.t.size, values.size))
    for k in range(values.size):
        h = np.zeros(values.size)
        h[k] = 1e-5 * abs(values[k])
        up, down = (f + n @ coefficients for f, n in (model(case, names, values + h), model(case, names, values - h)))
        G[:, k] = (up - down) / (2.0 * h[k])
    G -= Q @ (Q.T @ G)
    size = np.linalg.norm(G, axis=0)
    return np.sqrt(np.diag(np.linalg.inv(G.T @ G / np.outer(size, size)))) / size


def gap(case):
    """Distance of the record without noise from all that one more lag in place of the dead time could make of it."""
    if case.structure.startswith("order"):
        return np.inf
    p = dict(case.truth)
    delay, gain = p.pop("delay"), p.popitem()
    letter = "c" if gain[0] == "k" else "T"
    names = [letter + "0", *p, gain[0], "delay"]

    def residual(logs):
        forced, nuisance = model(case, names, [*np.exp(logs), 1.0, 0.0])
        Q = np.linalg.qr(np.column_stack([nuisance, forced]))[0]
        return case.y - Q @ (Q.T @ case.y)

    start = np.log([0.5 * delay, *p.values()])
    return float(np.sqrt(2.0 * least_squares(residual, start, max_nfev=40, x_scale="jac", ftol=1e-3).cost))


# ---- Runs ----

#: Noise is chosen so that the bound of the least certain parameter is this share of it. Bias is of second order: in
#: standard deviations it grows in proportion to this, to about 0.15 at a tenth.
LEVELS = (0.005, 0.02, 0.05)
#: A dead time is clear if it is this many standard deviations from 0, and the record as many from one more lag.
CLEAR = 5.0


@dataclass(frozen=True)
class Result:
    """One identification beside its truth."""

    level: float
    clear: bool
    declared: bool
    covered: bool
    z: np.ndarray  # errors of the parameters in standard deviations of the bound
    names: tuple


def study(structure, seed, levels=LEVELS):
    """A random plant identified at each noise level, with the noise and with its negative, whose mean shows the bias."""
    rng = np.random.default_rng(seed)
    case = random_case(structure, rng)
    truth = np.array(list(case.truth.values()))
    sigma, distance = bound(case), gap(case)
    results = []
    for level in levels:
        noise = level / (sigma / np.abs(truth)).max()
        errors = rng.standard_normal(case.t.size)
        for sign in (1.0, -1.0):
            fit = fsw.identify(fsw.Record(case.t, case.u, case.y + sign * noise * errors), structure, drift=case.drift)
            assert list(fit.parameters) == list(case.truth)
            values, spread = np.array(list(fit.parameters.values())).T
            results.append(
                Result(
                    level,
                    bool(truth[-1] > CLEAR * sigma[-1] * noise and distance > CLEAR * noise),
                    not fit.dead_time_known[0],
                    bool(abs(values[-1] - truth[-1]) < 1.96 * spread[-1]),
                    (values - truth) / (sigma * noise),
                    tuple(case.truth),
                )
            )
    return results


@dataclass(frozen=True)
class Summary:
    """Summary of many runs with one structure."""

    runs: int
    bias: dict  # of each parameter, in standard deviations of one run
    spread: dict  # of each parameter, in the bound's standard deviations
    coverage: float  # of the dead time's 95 % interval, where it is not declared unknown
    clear: int
    declared: float  # share of the clear dead times declared unknown


def summary(results):
    z, names = np.array([r.z for r in results]), results[0].names
    told, clear = [r for r in results if not r.declared], [r for r in results if r.clear]
    return Summary(
        len(results),
        dict(zip(names, z.mean(axis=0) / z.std(axis=0), strict=True)),
        dict(zip(names, z.std(axis=0), strict=True)),
        float(np.mean([r.covered for r in told])),
        len(clear),
        float(np.mean([r.declared for r in clear])),
    )
