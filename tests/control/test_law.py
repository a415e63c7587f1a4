"""The endpoint law against oracles/law.py: every command and every candidate's cost of 600 plants, 8 steps each."""

import numpy as np
import pytest

from cases.law import KINDS, PAIRS, aim, make_controller, random_case, random_point
from oracles.law import Law

CHUNKS, PER_CHUNK, STEPS = 25, 24, 8


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


def agreed(law, controller, x, w, reference, where):
    """One step in which library and oracle agree: command, possible candidates, error of the costs, if it is a near tie."""
    costs = law.costs(x, w, reference)
    given = {"disturbance": w} if len(w) else {}
    d = controller.decide(x, reference[None], **given)
    assert np.array_equal(d.candidates, law.candidates), where
    assert np.array_equal(np.isinf(d.costs), np.isinf(costs)), where
    possible = np.isfinite(costs)
    error = np.abs(d.costs[possible] - costs[possible]).max() / costs[possible].max()
    assert error < 1e-7, f"{where}: costs {d.costs}, oracle {costs}"

    u = controller.step(x, reference[None], **given)
    assert np.array_equal(u, d.u), where
    best = law.candidates[law.choice(costs)]
    taken = costs[np.flatnonzero((law.candidates == u).all(axis=1))[0]]
    assert d.cost == pytest.approx(taken, rel=1e-6, abs=1e-7 * costs[possible].max()), where
    near_tie = not np.array_equal(u, best)
    if near_tie:
        assert taken <= min(costs) * (1 + 1e-9), f"{where}: command {u}, oracle {best}, costs {costs}"
    return u, possible, error, near_tie


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
            u, possible, error, near_tie = agreed(law, controller, x, w, reference, f"plant {index}, step {step}")
            worst = max(worst, error)
            seen["near ties"] += near_tie
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
