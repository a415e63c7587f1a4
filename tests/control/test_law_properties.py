"""What the endpoint law keeps whatever the numbers: under a change of state, of units and of order."""

from math import inf

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cases.law import make_controller, random_case, random_point
from oracles.law import Law


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
