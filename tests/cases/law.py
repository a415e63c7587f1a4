"""Random plants and designs of the endpoint law, for the library and for its oracle."""

import warnings
from functools import cache
from math import ceil

import numpy as np

import foreswitch as fsw
from oracles.law import Law

PAIRS = [(n, r) for n in range(1, 7) for r in range(1, n + 1)]  # order of the plant, largest relative degree
KINDS = ["stable", "marginal", "unstable"]


def real_modes(rng, n, kind):
    """Block diagonal A with one mode of the kind and distinct stable ones beside it; time unit: the horizon."""

    def block(sigma, omega):
        return np.array([[sigma, omega], [-omega, sigma]])

    pair = n >= 2 and rng.random() < 0.5
    if kind == "stable":
        blocks = []
    elif kind == "unstable":  # growth over the horizon stays below e^3.5 = 33
        blocks = [block(rng.uniform(0.1, 3.0), rng.uniform(0.5, 8))] if pair else [[[rng.uniform(0.2, 3.5)]]]
    elif pair:
        blocks = [block(0.0, rng.uniform(0.5, 6))]
    else:  # a chain of integrators: separate ones would not be observable through one output
        k = rng.integers(1, min(n, 3) + 1)
        blocks = [np.diag(rng.uniform(1, 3, k - 1), 1)]
    while (size := sum(len(b) for b in blocks)) < n:
        two = n - size >= 2 and rng.random() < 0.5
        blocks.append(block(-rng.uniform(0.1, 3), rng.uniform(0.5, 8)) if two else [[-rng.uniform(0.2, 6)]])
    A = np.zeros((n, n))
    start = 0
    for b in blocks:
        stop = start + len(b)
        A[start:stop, start:stop] = b
        start = stop
    return A


def random_system(rng, kind, n, m, r, need_rest):
    """A, B, C with these relative degrees: B is drawn from the null space of C_o A^i, i < r_o - 1."""
    norm = np.linalg.norm
    while True:
        T = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-0.4, 0.4, n)
        A = T @ real_modes(rng, n, kind) @ np.linalg.inv(T)
        C = rng.standard_normal((len(r), n)) * 10 ** rng.uniform(-1, 1, (len(r), 1))
        forbidden = [C[o] @ np.linalg.matrix_power(A, i) for o in range(len(r)) for i in range(r[o] - 1)]
        if forbidden:
            rows = np.array([row / norm(row) for row in forbidden])
            _, values, directions = np.linalg.svd(rows)
            if values[-1] < 1e-2:
                continue
            free = directions[len(rows) :].T
        else:
            free = np.eye(n)
        B = free @ rng.standard_normal((free.shape[1], m)) * 10 ** rng.uniform(-0.3, 0.3, m)
        # A relative degree must be plain to see in floating point, and [4a] must not hang on a rank decision.
        last = [C[o] @ np.linalg.matrix_power(A, r[o] - 1) for o in range(len(r))]
        if any(norm(c @ B) < 0.03 * norm(c) * norm(B) for c in last):
            continue
        if any(norm(c @ B) < 1e-4 * norm(C[o]) * norm(A) ** (r[o] - 1) * norm(B) for o, c in enumerate(last)):
            continue
        values = np.linalg.svd(np.block([[A, B], [C, np.zeros((len(r), m))]]))[1]
        if not need_rest or values[-1] > 1e-3 * values[0]:
            return A, B, C


def random_levels(rng, m):
    """Different numbers of levels per input, with and without a zero, evenly and unevenly spaced."""
    counts = rng.permutation([2, 3, 4])[:m] if rng.random() < 0.7 else rng.integers(2, 4, m)
    levels = []
    for count in counts:
        choice = rng.integers(4)
        if choice == 0:
            values = np.arange(count) - (count == 3)  # [0, 1], [-1, 0, 1], [0, 1, 2, 3]
        elif choice == 1:
            values = 2 * np.arange(count) - (count - 1)  # [-1, 1], [-2, 0, 2], [-3, -1, 1, 3]
        else:
            values = np.round(np.cumsum(rng.uniform(0.4, 1.5, count)) + rng.uniform(-3, 1), 3)
            if choice == 2:
                values = np.round(values - rng.choice(values), 3)  # one of them is zero
        levels.append(sorted(float(v) for v in values))
    return levels


def random_times(rng, m):
    """Ts, Td, delays: none, whole, fractional; equal, unequal. Decimal numbers, so that 0.3 / 0.1 = 2.999... occurs."""
    Ts = float(rng.choice([0.05, 0.1, 0.2, 0.25, 0.3, 0.7, 1.0, 1.7]))
    Td = round(Ts * rng.choice([1, rng.integers(2, 9), rng.uniform(1, 2), rng.uniform(1, 8)]), 10)
    whole, equal = rng.random() < 0.3, rng.random() < 0.3
    periods = rng.integers(0, 5, m) if whole else rng.uniform(0, 4.5, m)
    if equal:
        periods[:] = periods[0]
    elif rng.random() < 0.2:
        periods[rng.integers(m)] = 0
    return Ts, max(Td, Ts), [round(p * Ts, 10) for p in periods]


def random_durations(rng, Ts, m):
    """Dwell times: none, whole periods (in decimals), anything."""
    return [round(Ts * k, 10) for k in np.where(rng.random(m) < 0.5, rng.integers(0, 5, m), rng.uniform(0, 4, m))]


def per_input(rng, values):
    """A short form where it says the same: a scalar for equal entries (half of the time they are made equal)."""
    values = [float(v) for v in values]
    if rng.random() < 0.5:
        return [values[0]] * len(values), values[0]
    return values, list(values)


def random_shape(rng, index):
    """Kind and order of the plant, its inputs, a relative degree for each output, and the tail."""
    tail = ["rest", "zero"][index % 2]
    n, r_max = PAIRS[index // 2 % 21]
    m, q = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    r = [r_max]
    if q == 2:  # sum (r_o - 1) < n leaves room for B; another r for the second output where there is one
        room = min(r_max, n - (r_max - 1))
        r = [int(v) for v in rng.permutation([r_max, rng.integers(1, room + 1)])]
        if tail == "rest" and n - sum(r) + 2 < 2:
            m = 1  # two inputs would be parallel and [4a] singular; that has a test of its own
    return KINDS[index // 42 % 3], n, m, r, tail


def random_safe_level(rng, levels):
    """The safe level of each input, and whether it must be given: it is not the one nearest to 0, or two are."""
    if rng.random() < 0.3 or any(sorted(map(abs, vs))[0] == sorted(map(abs, vs))[1] for vs in levels):
        return [float(rng.choice(vs)) for vs in levels], True
    return [min(vs, key=abs) for vs in levels], False


def random_forbidden(rng, grid, safe):
    """Commands that are not to be given, some of them or none."""
    if grid.shape[1] == 1 or rng.random() >= 0.4:
        return []
    others = [tuple(float(v) for v in c) for c in grid if tuple(c) != tuple(safe)]
    return [others[i] for i in rng.permutation(len(others))[: rng.integers(1, min(4, len(others)))]]


def random_pending(rng, law):
    """Commands under way at the start, as many as the dead times need or some more; or None."""
    rows = max(ceil(d / law["Ts"] - 1e-9) for d in law["delay"])
    if rng.random() >= 0.8:
        return None
    rows = max(rows, 1) + (int(rng.integers(1, 4)) if rng.random() < 0.2 else 0)
    commands = Law(**law).candidates
    pending = commands[rng.integers(len(commands), size=rows)]
    if rng.random() < 0.5:
        pending[-1] = law["safe"]
    return pending


@cache
def random_case(index):
    """Everything about one plant: law (full arguments), short (what the library is given instead), start, w scale."""
    rng = np.random.default_rng([128, 2006, index])
    kind, n, m, r, tail = random_shape(rng, index)
    q = len(r)
    A, B, C = random_system(rng, kind, n, m, r, tail == "rest")
    Ts, Td, delay = random_times(rng, m)
    levels = random_levels(rng, m)
    horizon = max(delay) + Td
    A, B = A / horizon, B / horizon
    n_w = int(rng.integers(0, 3))
    E = rng.standard_normal((n, n_w)) * np.abs(B).max()

    short = {}
    # With many derivatives and a large lam one period would move s by less than round-off can show.
    lam, short["lam"] = per_input(rng, 10 ** rng.uniform(0, 3 / max(*r, 2), q) / horizon)
    weight, short["weight"] = per_input(rng, 10 ** rng.uniform(-1, 1, q) / np.linalg.norm(C, axis=1) ** 2)
    u_offset, y_offset = np.zeros(m), np.zeros(q)
    if rng.random() < 0.6:
        u_offset, short["u_offset"] = per_input(rng, rng.uniform(-0.7, 0.7, m))
        y_offset, short["y_offset"] = per_input(rng, rng.uniform(-20, 20, q))
    min_on, min_off = [0.0] * m, [0.0] * m
    if rng.random() < 0.5:
        min_on, short["min_on"] = per_input(rng, random_durations(rng, Ts, m))
        min_off, short["min_off"] = per_input(rng, random_durations(rng, Ts, m))
    safe, must_be_given = random_safe_level(rng, levels)
    if must_be_given:
        short["safe_level"] = safe
    true_r = r
    if rng.random() < 0.2:  # given by the user, perhaps lower than the true one: s then has fewer derivatives
        if rng.random() < 0.5:
            r = [int(rng.integers(1, v + 1)) for v in r]
        short["relative_degree"] = r if len(set(r)) > 1 else r[0]

    grid = np.array(np.meshgrid(*levels, indexing="ij")).reshape(m, -1).T
    law = {
        "A": A, "B": B, "C": C, "E": E, "delay": delay, "u_offset": np.array(u_offset), "y_offset": np.array(y_offset),
        "levels": levels, "Ts": Ts, "Td": Td, "lam": lam, "weight": weight, "r": r, "tail": tail, "min_on": min_on,
        "min_off": min_off, "switch_cost": [0.0] * m, "forbidden": random_forbidden(rng, grid, safe), "safe": safe,
    }  # fmt: skip
    # What the inputs can do to V in one step is the scale for the price of a switch.
    if rng.random() < 0.5:
        s = np.array([Law(**law).endpoint(c, np.zeros(n), np.zeros(n_w), np.zeros((q, max(r)))) for c in grid])
        span = np.sum(weight * np.ptp(s, axis=0) ** 2)
        law["switch_cost"], short["switch_cost"] = per_input(rng, span * rng.uniform(0, 0.3, m))

    pending, elapsed = random_pending(rng, law), None
    if rng.random() < 0.7:
        elapsed, short["elapsed"] = per_input(rng, random_durations(rng, Ts, m))
    return {"kind": kind, "true_r": true_r, "law": law, "short": short, "pending": pending, "elapsed": elapsed}


def make_controller(law, short=None):
    """The library's controller for the oracle's arguments, in short forms where given."""
    k = {**law, "relative_degree": None, "safe_level": law["safe"]}
    if short is not None:
        k = {**k, "safe_level": None, **short}
    with warnings.catch_warnings():
        # Td < min_on and references that cannot be held deserve a warning; here they are the point.
        warnings.simplefilter("ignore")
        plant = fsw.Plant(
            k["A"],
            k["B"],
            k["C"],
            E=k["E"] if k["E"].shape[1] else None,
            input_delay=k["delay"],
            u_offset=k["u_offset"],
            y_offset=k["y_offset"],
        )
        objective = fsw.Endpoint(
            k["Td"], k["lam"], tail=k["tail"], weight=k["weight"], relative_degree=k["relative_degree"]
        )
        levels = k["levels"] if len(k["levels"]) > 1 else k["levels"][0]
        return fsw.Controller(
            plant,
            levels,
            k["Ts"],
            objective,
            min_on=k["min_on"],
            min_off=k["min_off"],
            switch_cost=k["switch_cost"],
            forbidden=k["forbidden"],
            safe_level=k["safe_level"],
        )


def random_point(rng, law):
    """A state, disturbance and reference near which the candidates differ: not every step far from the target."""
    lowest, highest = (np.array([f(vs) for vs in law.levels]) for f in (min, max))
    w = rng.uniform(-0.4, 0.4, law.E.shape[1])
    v = rng.uniform(lowest, highest) - law.u_offset
    x_rest = np.linalg.lstsq(law.A, -law.B @ v - law.E @ w, rcond=None)[0]
    reach = law.constant_input(law.horizon)[1] @ (rng.standard_normal(law.m) * (highest - lowest))
    x = x_rest + rng.choice([0.1, 1, 3]) * (reach + np.linalg.norm(reach) * rng.standard_normal(law.n) / law.n)
    reference = rng.standard_normal((law.q, max(law.r))) * np.linalg.norm(law.C @ reach) / np.sqrt(law.q)
    reference *= np.array(law.lam)[:, None] ** np.arange(max(law.r)) * rng.choice([0, 0.3])
    reference[:, 0] += law.y_offset + law.C @ x_rest
    if rng.random() < 0.7:
        aim(rng, law, x, w, reference)
    return x, w, reference


def aim(rng, law, x, w, reference):
    """Shift a reference so that its target lies among what the candidates reach."""
    for _ in range(4):
        mix = rng.dirichlet(np.ones(len(law.candidates)) / 2)
        s = mix @ [law.endpoint(c, x, w, reference) for c in law.candidates]
        for o in range(law.q):
            if law.r[o] > 1:  # through yd', which leaves u_rest alone
                reference[o, 1] += s[o] * law.lam[o] / (law.r[o] - 1)
            else:  # u_rest follows yd: not exact, hence several rounds
                reference[o, 0] += s[o]
