"""The library's endpoint law against oracle.py, a plain transcription of theory.md, on random plants.

First the oracle itself is held against scipy.integrate.solve_ivp; then every command and every candidate's cost of
600 plants, 8 steps each; then properties the law must have whatever the numbers (change of state, units, order).
"""

import warnings
from functools import cache
from math import ceil, factorial, inf

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

import foreswitch as fsw
from oracles.law import Law

CHUNKS, PER_CHUNK, STEPS = 25, 24, 8
PAIRS = [(n, r) for n in range(1, 7) for r in range(1, n + 1)]  # order of the plant, largest relative degree
KINDS = ["stable", "marginal", "unstable"]


# Random plants --------------------------------------------------------------------------------------------------------


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


@cache
def random_case(index):
    """Everything about one plant: law (full arguments), short (what the library is given instead), start, w scale."""
    rng = np.random.default_rng([128, 2006, index])
    tail = ["rest", "zero"][index % 2]
    n, r_max = PAIRS[index // 2 % 21]
    kind = KINDS[index // 42 % 3]
    m, q = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    r = [r_max]
    if q == 2:  # sum (r_o - 1) < n leaves room for B; another r for the second output where there is one
        room = min(r_max, n - (r_max - 1))
        r = [int(v) for v in rng.permutation([r_max, rng.integers(1, room + 1)])]
        if tail == "rest" and n - sum(r) + 2 < 2:
            m = 1  # two inputs would be parallel and [4a] singular; that has a test of its own
    A, B, C = random_system(rng, kind, n, m, r, tail == "rest")
    Ts, Td, delay = random_times(rng, m)
    levels = random_levels(rng, m)
    horizon = max(delay) + Td
    A, B = A / horizon, B / horizon
    n_w = int(rng.integers(0, 3))
    E = rng.standard_normal((n, n_w)) * np.abs(B).max()

    short = {}
    # With many derivatives and a large lam one period would move s by less than round-off can show.
    lam, short["lam"] = per_input(rng, 10 ** rng.uniform(0, 3 / max(r_max, 2), q) / horizon)
    weight, short["weight"] = per_input(rng, 10 ** rng.uniform(-1, 1, q) / np.linalg.norm(C, axis=1) ** 2)
    u_offset, y_offset = np.zeros(m), np.zeros(q)
    if rng.random() < 0.6:
        u_offset, short["u_offset"] = per_input(rng, rng.uniform(-0.7, 0.7, m))
        y_offset, short["y_offset"] = per_input(rng, rng.uniform(-20, 20, q))
    min_on, min_off = [0.0] * m, [0.0] * m
    if rng.random() < 0.5:
        min_on, short["min_on"] = per_input(rng, random_durations(rng, Ts, m))
        min_off, short["min_off"] = per_input(rng, random_durations(rng, Ts, m))
    nearest = [min(vs, key=abs) for vs in levels]
    if rng.random() < 0.3 or any(sorted(map(abs, vs))[0] == sorted(map(abs, vs))[1] for vs in levels):
        safe = short["safe_level"] = [float(rng.choice(vs)) for vs in levels]
    else:
        safe = nearest
    true_r = r
    if rng.random() < 0.2:  # given by the user, perhaps lower than the true one: s then has fewer derivatives
        if rng.random() < 0.5:
            r = [int(rng.integers(1, v + 1)) for v in r]
        short["relative_degree"] = r if len(set(r)) > 1 else r[0]

    grid = np.array(np.meshgrid(*levels, indexing="ij")).reshape(m, -1).T
    forbidden = []
    if m > 1 and rng.random() < 0.4:
        others = [tuple(float(v) for v in c) for c in grid if tuple(c) != tuple(safe)]
        forbidden = [others[i] for i in rng.permutation(len(others))[: rng.integers(1, min(4, len(others)))]]
    law = {
        "A": A,
        "B": B,
        "C": C,
        "E": E,
        "delay": delay,
        "u_offset": np.array(u_offset),
        "y_offset": np.array(y_offset),
        "levels": levels,
        "Ts": Ts,
        "Td": Td,
        "lam": lam,
        "weight": weight,
        "r": r,
        "tail": tail,
        "min_on": min_on,
        "min_off": min_off,
        "switch_cost": [0.0] * m,
        "forbidden": forbidden,
        "safe": safe,
    }

    # What the inputs can do to V in one step is the scale for the price of a switch.
    if rng.random() < 0.5:
        s = np.array([Law(**law).endpoint(c, np.zeros(n), np.zeros(n_w), np.zeros((q, max(r)))) for c in grid])
        span = np.sum(weight * np.ptp(s, axis=0) ** 2)
        law["switch_cost"], short["switch_cost"] = per_input(rng, span * rng.uniform(0, 0.3, m))

    pending = elapsed = None
    rows = max(ceil(d / Ts - 1e-9) for d in delay)
    if rng.random() < 0.8:
        rows = max(rows, 1) + (int(rng.integers(1, 4)) if rng.random() < 0.2 else 0)
        commands = Law(**law).candidates
        pending = commands[rng.integers(len(commands), size=rows)]
        if rng.random() < 0.5:
            pending[-1] = safe
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


# The oracle against numerical integration -----------------------------------------------------------------------------


@pytest.mark.parametrize("index", range(0, 600, 23))
def test_oracle_against_solve_ivp(index):
    """State and sliding variable at the evaluation instant, by an ODE solver and by differentiating y there."""
    case = random_case(index)
    rng = np.random.default_rng([1, index])
    law = Law(**case["law"])
    law.reset(case["pending"], case["elapsed"])
    for _ in range(5):
        law.issue(law.candidates[rng.integers(len(law.candidates))])
    x, w, reference = random_point(rng, law)
    tail = law.tail_input(w, reference[:, 0])
    candidate = law.candidates[rng.integers(len(law.candidates))]
    held = law.held(candidate)

    # Issued commands on an absolute time line: command i of the list acts from starts[i] + tau_j on.
    commands = [*law.history, candidate]
    starts = law.Ts * (np.arange(len(commands)) - len(commands) + 1)

    def u(t, j):
        at_input = t - law.delay[j]
        if at_input >= held[j] * law.Ts:
            return tail[j]
        return commands[max(np.searchsorted(starts, at_input, side="right") - 1, 0)][j]

    def slope(t, state):
        return law.A @ state + law.B @ ([u(t, j) for j in range(law.m)] - law.u_offset) + law.E @ w

    # The step limit keeps the solver from jumping over a pulse.
    end = solve_ivp(slope, (0, law.horizon), x, rtol=1e-7, atol=1e-9 * np.abs(x).max(), max_step=law.Ts / 10).y[:, -1]
    exact = law.state_after(law.horizon, x, w, candidate, held, tail)
    assert exact == pytest.approx(end, rel=1e-4, abs=1e-4 * np.abs(exact).max())

    # With u frozen from the evaluation instant on, y is analytic in time there, so Cauchy's formula on a circle round
    # that instant gives its derivatives (without the noise of differences); y^(i), i < r, does not jump there.
    frozen = np.array([u(law.horizon, j) for j in range(law.m)]) - law.u_offset
    radius, angles = law.horizon / 4, 2 * np.pi * np.arange(64) / 64

    def follow(state, slope_of_path, grid):
        def along(p, z):
            return slope_of_path(p) * (law.A @ z + law.B @ frozen + law.E @ w)

        return solve_ivp(along, (grid[0], grid[-1]), state, "DOP853", t_eval=grid, rtol=1e-12, atol=1e-13).y

    edge = follow(exact.astype(complex), lambda p: radius, [0.0, 1.0])[:, -1]
    circle = follow(edge, lambda p: 1j * radius * np.exp(1j * p), angles)
    for o in range(law.q):
        taylor = np.fft.fft(law.C[o] @ circle + law.y_offset[o]).real / len(angles)
        error = [taylor[i] * factorial(i) / radius**i - reference[o, i] for i in range(law.r[o])]
        # (1 + D/lam)^(r-1) as a polynomial in D, by repeated multiplication
        operator = np.polynomial.Polynomial([1.0])
        for _ in range(law.r[o] - 1):
            operator *= np.polynomial.Polynomial([1.0, 1 / law.lam[o]])
        terms = operator.coef * error
        assert law.sliding(exact, w, reference)[o] == pytest.approx(terms.sum(), abs=1e-6 * np.abs(terms).max())


def test_oracle_rest_tail_keeps_y():
    """[4a] means what it says: at x_rest under u_rest the output stays at yd."""
    A, B, C = np.array([[0.0, 1], [-2, -3]]), np.array([[0.0], [5]]), np.array([[1.0, 0]])
    law = Law(
        A,
        B,
        C,
        [[0.1], [0.4]],
        [0.3],
        [0.2],
        [7.0],
        [[-9.0, 9.0]],
        0.1,
        0.2,
        [3.0],
        [1.0],
        [2],
        "rest",
        [0],
        [0],
        [0],
        [],
        [9.0],
    )
    w, yd = np.array([1.5]), np.array([8.0])
    u = law.rest_unclipped(w, yd)
    x = np.array([1.0, -0.15])  # y = 1 + 7, x1' = x2 + 0.15 = 0
    assert A @ x + B @ (u - 0.2) + law.E @ w == pytest.approx(0, abs=1e-12)


# The library against the oracle ---------------------------------------------------------------------------------------


def test_cases_cover_what_is_claimed():
    """The 600 plants hold every kind, order, relative degree, delay pattern and option, each often enough."""
    cases = [random_case(i) for i in range(CHUNKS * PER_CHUNK)]
    laws = [Law(**c["law"]) for c in cases]
    total = len(cases)
    assert total >= 500
    for case, law in zip(cases, laws, strict=True):  # the eigenvalues and relative degrees are as prescribed
        real = np.linalg.eigvals(law.A).real.max() * law.horizon
        is_kind = {"stable": real < -0.05, "marginal": abs(real) < 1e-4, "unstable": 0.05 < real < np.log(50)}
        assert is_kind[case["kind"]]
        for o, r in enumerate(case["true_r"]):
            markov = [
                np.linalg.norm(law.C[o] @ np.linalg.matrix_power(law.A * law.horizon, i) @ law.B) for i in range(r)
            ]
            assert max(markov[:-1], default=0) < 1e-9 * markov[-1]

    def count(what):
        return sum(bool(what(case, law)) for case, law in zip(cases, laws, strict=True))

    true = [(law.n, r) for case, law in zip(cases, laws, strict=True) for r in case["true_r"]]
    for pair in PAIRS:
        assert true.count(pair) >= 10
    assert count(lambda c, k: max(k.r) >= 2) >= total / 2
    for kind in KINDS:
        for tail in ("zero", "rest"):
            assert count(lambda c, k, kind=kind, tail=tail: c["kind"] == kind and k.tail == tail) >= total / 8
    for m in (1, 2, 3):
        for q in (1, 2):
            assert count(lambda c, k, m=m, q=q: (k.m, k.q) == (m, q)) >= total / 20
    many = total / 20
    assert count(lambda c, k: len(set(k.r)) > 1) >= many
    assert count(lambda c, k: k.m > 1 and len(set(k.delay)) == 1) >= many
    assert count(lambda c, k: len(set(k.delay)) > 1) >= many
    assert count(lambda c, k: any(abs(d / k.Ts - round(d / k.Ts)) > 1e-3 for d in k.delay)) >= many
    assert count(lambda c, k: max(k.delay) > 0 and all(abs(d / k.Ts - round(d / k.Ts)) < 1e-9 for d in k.delay)) >= many
    assert count(lambda c, k: any(round(d / k.Ts) < d / k.Ts < round(d / k.Ts) + 1e-9 for d in k.delay)) >= 3
    assert count(lambda c, k: abs(k.Td / k.Ts - round(k.Td / k.Ts)) > 1e-3) >= many
    assert count(lambda c, k: k.E.shape[1] > 0) >= many
    assert count(lambda c, k: k.tail == "zero" and any(k.u_offset)) >= many
    assert count(lambda c, k: k.tail == "rest" and any(k.u_offset)) >= many
    assert count(lambda c, k: len({len(vs) for vs in k.levels}) > 1) >= many
    assert count(lambda c, k: any(0 not in vs for vs in k.levels)) >= many
    assert count(lambda c, k: k.tail == "zero" and any(0 not in vs for vs in k.levels)) >= many
    assert count(lambda c, k: len(k.candidates) < np.prod([len(vs) for vs in k.levels])) >= many
    assert count(lambda c, k: any(k.switch_cost)) >= many
    assert count(lambda c, k: max(k.min_on + k.min_off) > k.Td) >= many
    assert count(lambda c, k: c["elapsed"] and max(k.min_on + k.min_off) > k.Ts) >= many
    assert count(lambda c, k: k.q == 2 and len(set(k.lam)) > 1 and len(set(k.weight)) > 1) >= many


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_law_equals_the_oracle(chunk, record_property):
    """Commands and the costs of all candidates, over receding steps; half of the plants in closed loop."""
    worst = 0.0
    seen = dict.fromkeys(["plants", "steps", "near ties", "switched", "blocked", "rest", "rest inside"], 0)
    for index in range(chunk * PER_CHUNK, (chunk + 1) * PER_CHUNK):
        case = random_case(index)
        law, rng = Law(**case["law"]), np.random.default_rng([131, index])
        controller = make_controller(case["law"], case["short"])
        assert list(controller.relative_degree) == law.r
        assert controller.order == max(law.r)
        law.reset(case["pending"], case["elapsed"])
        start = {"pending": case["pending"], "elapsed": case["short"].get("elapsed")}
        controller.reset(**{name: value for name, value in start.items() if value is not None})
        closed_loop = index // 2 % 2
        x, w, reference = random_point(rng, law)
        near = 5 * np.linalg.norm(x)
        for step in range(STEPS):
            costs = law.costs(x, w, reference)
            given = {"disturbance": w} if len(w) else {}
            d = controller.decide(x, reference[None], **given)
            where = f"plant {index}, step {step}"
            assert np.array_equal(d.candidates, law.candidates), where
            assert np.array_equal(np.isinf(d.costs), np.isinf(costs)), where
            possible = np.isfinite(costs)
            error = np.abs(d.costs[possible] - costs[possible]).max() / costs[possible].max()
            assert error < 1e-7, f"{where}: costs {d.costs}, oracle {costs}"
            worst = max(worst, error)

            u = controller.step(x, reference[None], **given)
            assert np.array_equal(u, d.u), where
            best = law.candidates[law.choice(costs)]
            taken = costs[np.flatnonzero((law.candidates == u).all(axis=1))[0]]
            assert d.cost == pytest.approx(taken, rel=1e-6, abs=1e-7 * costs[possible].max()), where
            if not np.array_equal(u, best):
                assert taken <= min(costs) * (1 + 1e-9), f"{where}: command {u}, oracle {best}, costs {costs}"
                seen["near ties"] += 1

            seen["steps"] += 1
            seen["switched"] += tuple(u) != law.history[-1]
            seen["blocked"] += not all(possible)
            if law.tail == "rest":
                free = law.rest_unclipped(w, reference[:, 0])
                seen["rest"] += 1
                seen["rest inside"] += np.allclose(free, law.tail_input(w, reference[:, 0]))
            if closed_loop:  # the plant runs for one period on what was issued
                x = law.state_after(law.Ts, x, w, u, [1] * law.m, u)
            law.issue(u)
            if closed_loop and np.linalg.norm(x) < near:
                w = w + rng.uniform(-0.05, 0.05, len(w))
                aim(rng, law, x, w, reference)
            else:  # also where a saturated unstable plant has run away and only round-off would be compared
                x, w, reference = random_point(rng, law)
        seen["plants"] += 1
    seen = {name: int(value) for name, value in seen.items()}  # plain numbers: pytest-xdist sends them home
    record_property("counts", seen)
    record_property("worst cost error", float(worst))
    print(f"chunk {chunk}: {seen}, worst relative cost error {worst:.1e}")
    assert seen["plants"] == PER_CHUNK
    assert seen["steps"] == PER_CHUNK * STEPS
    assert CHUNKS * PER_CHUNK >= 500
    assert seen["near ties"] <= 0.01 * seen["steps"]
    # A run in which nothing moves, or in which [4a] always ends at a limit, would show little.
    assert seen["switched"] > 0.2 * seen["steps"]
    assert seen["blocked"] > 0.02 * seen["steps"]
    assert seen["rest inside"] > 0.1 * seen["rest"]


def decide_and_step(law, x, reference, w=(), pending=None, elapsed=None, short=None):
    """Costs and command of the library, and the costs of the oracle, at one point."""
    controller, oracle = make_controller(law, short), Law(**law)
    if pending is not None or elapsed is not None:
        controller.reset(pending=pending, elapsed=elapsed)
    oracle.reset(pending, elapsed)
    given = {"disturbance": np.asarray(w, float)} if len(w) else {}
    d = controller.decide(x, reference, **given)
    return d, controller.step(x, reference, **given), oracle.costs(x, np.asarray(w, float), np.asarray(reference)[0])


def simple_law(**changes):
    """An integrator with numbers that are exact in binary, zero tail: ties are ties."""
    law = {
        "A": np.zeros((1, 1)),
        "B": np.ones((1, 1)),
        "C": np.ones((1, 1)),
        "E": np.zeros((1, 0)),
        "delay": [0.0],
        "u_offset": np.zeros(1),
        "y_offset": np.zeros(1),
        "levels": [[-1.0, 0.0, 1.0]],
        "Ts": 0.5,
        "Td": 0.5,
        "lam": [1.0],
        "weight": [1.0],
        "r": [1],
        "tail": "zero",
        "min_on": [0.0],
        "min_off": [0.0],
        "switch_cost": [0.0],
        "forbidden": [],
        "safe": [0.0],
    }
    return {**law, **changes}


@pytest.mark.parametrize(
    ("levels", "present", "target", "command"),
    [
        ([-1.0, 0.0, 1.0], 0.0, 0.25, 0.0),  # 0 and 1 tie: the present one
        ([-1.0, 0.0, 1.0], 1.0, 0.25, 1.0),
        ([-1.0, 0.0, 1.0], -1.0, 0.25, 0.0),  # the present one has no part in the tie: the lower index
        ([-1.0, 1.0], 1.0, 0.0, 1.0),
        ([-1.0, 1.0], -1.0, 0.0, -1.0),
        ([-1.0, 1.0, 3.0], 3.0, 0.0, -1.0),
    ],
)
def test_ties(levels, present, target, command):
    """Exact ties go to the present command, then to the lower index."""
    law = simple_law(levels=[levels], safe=[levels[0]])
    d, u, costs = decide_and_step(law, [0.0], [[[target]]], pending=[[present]])
    assert np.array_equal(d.costs, costs)
    assert list(u) == [command]


def test_ties_of_two_inputs():
    """Two equal inputs: of (0, 1) and (1, 0) the present one, else the lower index."""
    law = simple_law(
        B=np.ones((1, 2)),
        delay=[0.0, 0.0],
        u_offset=np.zeros(2),
        levels=[[0.0, 1.0], [0.0, 1.0]],
        min_on=[0.0] * 2,
        min_off=[0.0] * 2,
        switch_cost=[0.0] * 2,
        safe=[0.0] * 2,
    )
    for present, command in [([1, 0], [1, 0]), ([0, 1], [0, 1]), ([0, 0], [0, 1]), ([1, 1], [0, 1])]:
        _, u, _ = decide_and_step(law, [0.0], [[[0.5]]], pending=[present])
        assert list(u) == command


@pytest.mark.parametrize("target", [0.0, 0.7])
def test_rest_tail_where_4a_is_singular(target):
    """A zero at the origin (y is a speed that cannot be held): the least-squares solution of smallest norm."""
    law = simple_law(
        A=np.array([[0.0, 1.0], [-2.0, -1.0]]),
        B=np.array([[0.0], [1.0]]),
        C=np.array([[0.0, 1.0]]),
        E=np.array([[0.0], [0.5]]),
        delay=[0.3],
        Td=1.25,
        tail="rest",
    )
    d, _, costs = decide_and_step(law, [0.1, 0.2], [[[target]]], w=[0.4], pending=[[1.0]])
    assert d.costs == pytest.approx(costs, rel=1e-9)


def test_rest_tail_with_fewer_inputs_than_outputs():
    """Position and speed of a mass cannot both be kept: least squares on the matrix as it stands."""
    law = simple_law(
        A=np.array([[0.0, 1.0], [0.0, -0.5]]),
        B=np.array([[0.0], [1.0]]),
        C=np.eye(2),
        E=np.zeros((2, 0)),
        y_offset=np.array([1.0, 0.0]),
        lam=[2.0, 1.0],
        weight=[1.0, 3.0],
        r=[2, 1],
        delay=[0.7],
        Td=1.25,
        tail="rest",
    )
    d, _, costs = decide_and_step(law, [0.1, 0.2], [[[1.3, 0.2], [0.9, 0.0]]], pending=[[1.0], [-1.0]])
    assert d.costs == pytest.approx(costs, rel=1e-9)


@pytest.mark.parametrize("Td", [0.5, 1.2, 2.0, 4.0])
@pytest.mark.parametrize("elapsed", [0.0, 0.5, 0.9, 10.0])
def test_dwell_over_a_whole_run(Td, elapsed):
    """min_on 1.5 s, min_off 1 s, Ts 0.5 s: which candidates are allowed and what they are predicted to cost."""
    law = simple_law(A=np.array([[-0.3]]), min_on=[1.5], min_off=[1.0], Td=Td, delay=[0.6])
    oracle, controller = Law(**law), make_controller(law)
    oracle.reset([[0.0], [1.0]], [elapsed])
    controller.reset(pending=[[0.0], [1.0]], elapsed=elapsed)
    rng = np.random.default_rng(7)
    for _ in range(30):
        x, reference = rng.standard_normal(1), rng.standard_normal((1, 1, 1))
        costs = oracle.costs(x, np.zeros(0), reference[0])
        d = controller.decide(x, reference)
        assert d.costs == pytest.approx(costs, rel=1e-9, abs=1e-12)
        u = controller.step(x, reference)
        assert tuple(u) == tuple(oracle.candidates[oracle.choice(costs)])
        oracle.issue(u)


# Properties -----------------------------------------------------------------------------------------------------------


def property_case(seed, square=False):
    """A random case with full arguments and a point; square: [4a] is regular, so that it survives any change of units.

    Without that the least-squares rest input depends on the units of the state, as theory.md has it.
    """
    case = random_case(10_000 + seed)
    law = {**case["law"], "r": case["true_r"]}  # the library finds them itself, whatever the coordinates
    if square and len(law["C"]) != law["B"].shape[1]:
        law["tail"] = "zero"
    oracle = Law(**law)
    oracle.reset(case["pending"], case["elapsed"])
    rng = np.random.default_rng([3, seed])
    return law, (case["pending"], case["elapsed"]), random_point(rng, oracle), rng


def costs_of(law, start, x, w, reference):
    """Costs of all candidates by the library."""
    controller = make_controller(law)
    controller.reset(**{k: v for k, v in zip(("pending", "elapsed"), start, strict=True) if v is not None})
    return controller.decide(x, reference[None], **({"disturbance": w} if len(w) else {})).costs


def assert_same(costs, others, factor=1.0):
    """Equal up to round-off against the largest cost."""
    assert np.array_equal(np.isinf(costs), np.isinf(others))
    possible = np.isfinite(costs)
    assert others[possible] == pytest.approx(factor * costs[possible], abs=1e-7 * factor * costs[possible].max())


seeds = st.integers(0, 3000)
quick = settings(max_examples=25, deadline=None, derandomize=True)


@quick
@given(seeds)
def test_costs_do_not_depend_on_the_state_coordinates(seed):
    """z = T x changes no cost."""
    law, start, (x, w, reference), rng = property_case(seed, square=True)
    n = len(x)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] * 10 ** rng.uniform(-0.5, 0.5, n)
    inverse = np.linalg.inv(T)
    other = {**law, "A": T @ law["A"] @ inverse, "B": T @ law["B"], "C": law["C"] @ inverse, "E": T @ law["E"]}
    assert_same(costs_of(law, start, x, w, reference), costs_of(other, start, T @ x, w, reference))


@quick
@given(seeds, st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_costs_scale_with_the_units(seed, output, level, time):
    """Output in other units: V scales with the square. Input and time in other units: V stays."""
    law, start, (x, w, reference), _ = property_case(seed, square=True)
    a, b, c = 10.0**output, 10.0**level, 2.0 ** round(8 * time)  # times by powers of 2: whole periods stay whole
    other = {
        **law,
        "C": a * law["C"],
        "y_offset": a * law["y_offset"],
        "switch_cost": [a**2 * v for v in law["switch_cost"]],
        "A": law["A"] / c,
        "B": law["B"] / (b * c),
        "E": law["E"] / c,
        "lam": [v / c for v in law["lam"]],
        "u_offset": b * law["u_offset"],
        "levels": [[b * v for v in vs] for vs in law["levels"]],
        "safe": [b * v for v in law["safe"]],
        "forbidden": [tuple(b * v for v in f) for f in law["forbidden"]],
        **{name: c * law[name] for name in ("Ts", "Td")},
        **{name: [c * v for v in law[name]] for name in ("delay", "min_on", "min_off")},
    }
    pending, elapsed = start
    other_start = (None if pending is None else b * pending, None if elapsed is None else [c * v for v in elapsed])
    other_reference = a * reference / c ** np.arange(reference.shape[1])
    assert_same(costs_of(law, start, x, w, reference), costs_of(other, other_start, x, w, other_reference), a**2)


@quick
@given(seeds, st.floats(-2, 2))
def test_rest_tail_does_not_know_where_zero_is(seed, shift):
    """Levels, operating point and history moved together: no cost changes (with the zero tail they would)."""
    law, (pending, elapsed), (x, w, reference), _ = property_case(seed)
    law = {**law, "tail": "rest"}
    if len(law["C"]) > 1:  # keep to what random_system has made regular
        law["tail"] = property_case(seed)[0]["tail"]
        shift = shift if law["tail"] == "rest" else 0.0
    other = {
        **law,
        "levels": [[v + shift for v in vs] for vs in law["levels"]],
        "u_offset": law["u_offset"] + shift,
        "safe": [v + shift for v in law["safe"]],
        "forbidden": [tuple(v + shift for v in f) for f in law["forbidden"]],
    }
    # Without a history the default is the safe level, which moves too.
    other_start = None if pending is None else pending + shift, elapsed
    assert_same(costs_of(law, (pending, elapsed), x, w, reference), costs_of(other, other_start, x, w, reference))


@quick
@given(seeds)
def test_costs_do_not_depend_on_the_order_of_inputs_and_outputs(seed):
    """Inputs and outputs renumbered: the same cost for the same command."""
    law, (pending, elapsed), (x, w, reference), _ = property_case(seed)
    m, q = law["B"].shape[1], len(law["C"])
    inputs, outputs = list(range(m))[::-1], list(range(q))[::-1]
    other = {
        **law,
        "B": law["B"][:, inputs],
        "C": law["C"][outputs],
        "forbidden": [tuple(f[j] for j in inputs) for f in law["forbidden"]],
        **{
            name: [law[name][j] for j in inputs]
            for name in ("delay", "u_offset", "levels", "min_on", "min_off", "switch_cost", "safe")
        },
        **{name: [law[name][o] for o in outputs] for name in ("y_offset", "lam", "weight", "r")},
    }
    other_start = (
        None if pending is None else pending[:, inputs],
        None if elapsed is None else [elapsed[j] for j in inputs],
    )
    costs = dict(
        zip(map(tuple, Law(**law).candidates), costs_of(law, (pending, elapsed), x, w, reference), strict=True)
    )
    others = costs_of(other, other_start, x, w, reference[outputs])
    assert_same(np.array([costs[tuple(c[inputs])] for c in Law(**other).candidates]), others)


@quick
@given(seeds, st.lists(st.integers(0, 10**6), min_size=1, max_size=6))
def test_decide_changes_nothing(seed, points):
    """A decision asked for in between leaves commands and dwell as they were; every step is checked."""
    law, (pending, elapsed), _, _ = property_case(seed)
    start = {k: v for k, v in (("pending", pending), ("elapsed", elapsed)) if v is not None}
    asked, plain, oracle = make_controller(law), make_controller(law), Law(**law)
    asked.reset(**start)
    plain.reset(**start)
    oracle.reset(pending, elapsed)
    for point in points:
        x, w, reference = random_point(np.random.default_rng([5, point]), oracle)
        given = {"disturbance": w} if len(w) else {}
        first = asked.decide(x, reference[None], **given)
        asked.decide(-x, -reference[None], **given)
        again = asked.decide(x, reference[None], **given)
        assert np.array_equal(first.costs, again.costs)
        u = asked.step(x, reference[None], **given)
        assert np.array_equal(u, first.u)
        assert np.array_equal(u, plain.step(x, reference[None], **given))
        assert oracle.cost(u, x, w, reference) < inf
        oracle.issue(u)


@quick
@given(seeds, st.floats(-5, 5))
def test_free_motion_shifts_the_reference(seed, share):
    """Zero tail: a change of state that moves s by d costs what a reference lower by d costs (s is affine in both)."""
    law, (pending, _), (x, w, reference), rng = property_case(seed)
    law = {**law, "tail": "zero"}
    oracle = Law(**law)
    dx = share * rng.standard_normal(len(x)) * np.abs(x).max()
    candidate = oracle.candidates[0]
    moved = reference.copy()
    moved[:, 0] -= oracle.endpoint(candidate, x + dx, w, reference) - oracle.endpoint(candidate, x, w, reference)
    costs = costs_of(law, (pending, None), x + dx, w, reference)
    assert_same(costs, costs_of(law, (pending, None), x, w, moved))
