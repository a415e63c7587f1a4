"""Model structures: names, order, and that every way to write a plant down means the same plant."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from foreswitch.identification.structures import STRUCTURES, Structure

EVERY = [*STRUCTURES, "integrator+integrator", "lag+lag+pair", "pair+pair", "order 1", "order 4", "order 5"]


@pytest.mark.parametrize("name", EVERY)
def test_a_structure_is_what_it_is_called(name):
    structure = Structure.parse(name)
    assert str(structure) == name
    assert Structure.parse(str(structure)) == structure
    low, high = structure.bounds(0.1, 100.0, 1.0)
    assert low.size == high.size == len(structure.names)
    assert (low < high).all()
    assert all(start.size == low.size for start in structure.starts(1.0, 1.0))


@given(st.sampled_from(EVERY), st.integers(0, 10**6), st.floats(0.01, 100.0))
def test_states_and_polynomials_are_the_same_transfer_function(name, seed, scale):
    structure, rng = Structure.parse(name), np.random.default_rng(seed)
    theta = rng.normal(size=len(structure.names)) * 0.7
    gains = rng.normal(size=structure.states if structure.order else 1)
    A, b = structure.system(theta, scale)
    C = gains if structure.order else gains[0] * np.eye(structure.states)[-1]
    den = structure.denominator(theta, scale)
    s = 1j * np.abs(den[-1] or den[1] or 1.0) ** (1.0 / structure.states) * 1.7 + 0.3 / scale
    wanted = C @ np.linalg.solve(s * np.eye(structure.states) - A, b)
    found = np.polyval(structure.numerator(theta, gains, scale), s) / np.polyval(den, s)
    assert abs(found - wanted) <= 1e-9 * (
        np.abs(C) @ np.abs(np.linalg.inv(s * np.eye(structure.states) - A)) @ np.abs(b)
    )


@given(st.integers(0, 10**6))
def test_ordering_changes_no_plant(seed):
    structure, theta = Structure.parse("lag+lag+pair"), np.random.default_rng(seed).normal(size=4)
    ordered = structure.ordered(theta)
    assert ordered[0] >= ordered[1]
    assert structure.denominator(ordered, 1.0) == pytest.approx(structure.denominator(theta, 1.0), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("integrator+lagg", "has the term 'lagg'; did you mean 'lag'"),
        ("", "has the term ''"),
        ("order 7", "too large; at most two integrators and 6 states"),
        ("integrator+integrator+integrator", "too large"),
        ("order x", "has the term 'order x'"),
    ],
)
def test_an_unknown_structure_is_refused(text, says):
    with pytest.raises(ValueError, match=says):
        Structure.parse(text)
