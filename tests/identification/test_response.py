"""Responses at the samples of a record: exact for any sampling, dead time and plant."""

import itertools
import os
import subprocess

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from core.compiling import COMPILERS, STRICT, compiled
from foreswitch._binding import _response
from foreswitch.identification.response import Grid
from foreswitch.identification.structures import Structure
from oracles import record as record_oracle
from places import CORE, TESTS


def held(t, u, delay, instant):
    """The command in effect at an instant, 0 before the first."""
    k = int(np.searchsorted(t + delay, instant, side="right")) - 1
    return u[k] if k >= 0 else 0.0


def piecewise(A, b, t, u, delay, x0=None):
    """States at ``t``, by matrix exponentials between all instants at which anything happens."""
    n = b.size
    events = np.unique(np.concatenate([t, t[t + delay < t[-1]] + delay]))
    x, states = np.r_[np.zeros(n) if x0 is None else x0, 1.0], {}
    for start, end in itertools.pairwise(events):
        states[start] = x[:n]
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n] = A, b * held(t, u, delay, 0.5 * (start + end))
        x = expm(block * (end - start)) @ x
    states[events[-1]] = x[:n]
    return np.array([states[instant] for instant in t])


def instants(kind, count, rng):
    """Sampling of one kind, about one second apart."""
    steps = {
        "even": np.full(count, 0.8),
        "random": rng.uniform(0.01, 3.0, count),
        "jitter": 1.0 + rng.uniform(-1e-3, 1e-3, count),
        "two intervals": rng.choice([0.7, 1.9], count),
        "clusters": rng.choice([1e-6, 1.0, 40.0], count),
    }[kind]
    return 5.0 + np.r_[0.0, np.cumsum(steps)]


PLANTS = {
    "lag": ([[-0.4]], [0.4]),
    "fast lags": ([[-300.0, 0.0], [90.0, -90.0]], [300.0, 0.0]),
    "stiff": ([[-1e5, 0.0], [0.2, -0.2]], [1e5, 0.0]),
    "integrators": ([[0.0, 0.0], [1.0, 0.0]], [1.0, 0.0]),
    "oscillation": ([[-0.02, -3.0], [3.0, 0.0]], [3.0, 0.0]),
    "fast oscillation": ([[-5.0, -70.0], [70.0, 0.0]], [70.0, 0.0]),
    "unstable": ([[0.05, 0.0], [1.0, -1.0]], [1.0, 0.0]),
    "three": ([[-1.0, 0.0, 0.0], [0.5, -0.5, 0.0], [0.0, 1.0, 0.0]], [1.0, 0.0, 0.0]),
    "six": (-np.diag(np.linspace(0.1, 2.0, 6)) + np.eye(6, k=-1) * 0.3, [1.0, 0, 0, 0, 0, 0]),
}


def draw(kind, plant, seed, count=40):
    rng = np.random.default_rng(seed)
    t = instants(kind, count, rng)
    u = np.r_[0.0, np.repeat(rng.normal(size=count), rng.integers(1, 6))[:count]]
    A, b = (np.array(part, dtype=float) for part in PLANTS[plant])
    return A, b, t, u


def assert_near(found, wanted, tolerance=1e-9):
    assert np.abs(found - wanted).max() <= tolerance * np.abs(wanted).max()


KINDS = st.sampled_from(["even", "random", "jitter", "two intervals", "clusters"])


@given(KINDS, st.sampled_from(list(PLANTS)), st.floats(0.0, 12.0), st.integers(0, 10**6))
def test_the_response_is_exact_at_any_dead_time_and_sampling(kind, plant, delay, seed):
    A, b, t, u = draw(kind, plant, seed)
    wanted = np.flatnonzero(np.random.default_rng(seed).random(t.size) < 0.7)
    assume(wanted.size > 0)
    grid = Grid(t, wanted)
    states = grid.states(A, b, u)
    assert_near(states, piecewise(A, b, t, u, 0.0))
    late, slope = grid.delayed(A, b, u, states, delay)
    expected = piecewise(A, b, t, u, delay)[wanted]
    assume(np.abs(expected).max() > 1e-3 * np.abs(states).max())
    assert_near(late, expected)
    edges = np.abs((t[wanted] - delay)[:, None] - t).min(axis=1) > 1e-9
    if edges.any():
        inputs = np.array([held(t, u, delay, instant) for instant in t[wanted]])
        moved = expected @ A.T + np.outer(inputs, b)
        size = np.abs(expected) @ np.abs(A).T + np.outer(np.abs(inputs), np.abs(b))  # near rest its parts cancel
        assert (np.abs(slope - moved)[edges] <= 1e-9 * size.max()).all()


@given(KINDS, st.sampled_from(list(PLANTS)), st.integers(0, 10**6))
def test_a_start_from_any_state_is_exact(kind, plant, seed):
    A, b, t, u = draw(kind, plant, seed)
    x0 = np.random.default_rng(seed).normal(size=b.size)
    assert_near(Grid(t, np.arange(t.size)).states(A, b, u, x0), piecewise(A, b, t, u, 0.0, x0))


@pytest.mark.parametrize("share", range(8))
def test_a_dead_time_of_whole_intervals_is_a_shift(share):
    """On an even grid, where rounding may fall to either side of a sample."""
    A, b, t, u = draw("even", "three", share)
    grid = Grid(t, np.arange(t.size))
    states = grid.states(A, b, u)
    late, _ = grid.delayed(A, b, u, states, share * 0.8)
    assert_near(late[share:], states[: t.size - share], 1e-12)
    assert (late[:share] == 0.0).all()


def test_rounding_of_printed_instants_keeps_a_record_even():
    t = 1e6 + 0.1 * np.arange(1000)
    assert Grid(t, np.arange(3)).regular
    assert not Grid(t + np.where(np.arange(1000) == 500, 1e-3, 0.0), np.arange(3)).regular


# The oracle of the records ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("structure", ["integrator+integrator", "integrator+lag+lag", "lag+pair", "order 3"])
def test_step_responses_by_partial_fractions_are_what_an_integrator_of_odes_finds(structure):
    rng = np.random.default_rng(3)
    truth, scale = record_oracle.random_truth(structure, rng)
    system = record_oracle.transfer(structure, truth)
    a = np.real(np.poly(np.r_[system.poles, np.zeros(system.integrators)]))[1:]
    n = a.size
    A = np.eye(n, k=1)
    A[:, 0] -= a  # observer form: the first state is the output
    b = np.r_[np.zeros(n - system.numerator.size), system.numerator]
    t = np.linspace(0.0, 8.0 * scale, 50)
    found = solve_ivp(
        lambda _, x: A @ x + b, (0.0, t[-1]), np.zeros(n), t_eval=t, method="DOP853", rtol=1e-11,
        atol=1e-12 * np.abs(system.step(t)).max() / scale ** np.arange(n),
    )  # fmt: skip
    assert_near(system.step(t), found.y[0], 1e-8)


@pytest.mark.parametrize(
    "structure", ["integrator", "integrator+lag+lag", "integrator+pair", "lag+lag+lag", "lag+pair"]
)
def test_structures_are_what_their_parameters_say(structure):
    rng = np.random.default_rng(5)
    truth, scale = record_oracle.random_truth(structure, rng)
    kind = Structure.parse(structure)
    theta = np.log([truth[name] for name in kind.names])
    t = np.linspace(0.0, 6.0 * scale, 60)
    A, b = kind.system(theta, scale)
    gain = truth[kind.gain]
    assert_near(gain * Grid(t, np.arange(60)).states(A, b, np.ones(60))[:, -1],
                record_oracle.transfer(structure, truth).step(t))  # fmt: skip


# C ----------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not COMPILERS, reason="needs a C compiler")
@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_core_is_clean_under_warnings_and_sanitizers(compiler, tmp_path):
    target = tmp_path / "response"
    plain = [
        *STRICT,
        "-g",
        "-O1",
        f"-I{CORE / 'host'}",
        "-o",
        target,
        TESTS / "core" / "test_response.c",
        CORE / "host" / "response.c",
        "-lm",
    ]
    if not compiled("-fsanitize=address,undefined", "-fno-sanitize-recover", *plain, compiler=compiler)[0]:
        done, errors = compiled(*plain, compiler=compiler)
        assert done, errors
    done = subprocess.run([target], capture_output=True, text=True, env=os.environ | {"ASAN_OPTIONS": "detect_leaks=1"})
    assert done.returncode == 0, done.stdout + done.stderr


def arrays(n=2, count=5):
    one, empty = np.zeros(count, dtype=np.uint32), np.empty(0)
    return [np.eye(n), np.ones(n), np.zeros((1, n, n)), np.zeros((1, n)), one, empty]


def test_the_binding_refuses_arrays_that_contradict_each_other():
    good = [*arrays(), np.zeros(5), np.zeros((6, 2))]
    _response.respond(*good)
    wrong = {0: np.eye(3), 2: np.zeros((2, 2, 2)), 4: np.ones(5, dtype=np.uint32), 5: np.zeros(3), 7: np.zeros((5, 2))}
    for place, value in wrong.items():
        with pytest.raises(ValueError, match="contradict"):
            _response.respond(*good[:place], value, *good[place + 1 :])
    with pytest.raises(ValueError, match="u holds items of type 'f'"):
        _response.respond(*good[:6], np.zeros(5, dtype=np.float32), good[7])
    with pytest.raises((ValueError, BufferError)):
        _response.respond(*good[:7], np.zeros((2, 6)).T)
    big = np.zeros(20)
    with pytest.raises(ValueError, match="contradict"):
        _response.discretise(np.eye(16), np.ones(16), big[:1], np.zeros((1, 16, 16)), np.zeros((1, 16)))
    carry = [*arrays(count=3), np.array([-1, 0, 4]), np.zeros(5), np.zeros((5, 2)), np.zeros((3, 2)), np.zeros((3, 2))]
    _response.carry(*carry)
    with pytest.raises(ValueError, match="contradict"):
        _response.carry(*carry[:6], np.array([-1, 0, 5]), *carry[7:])
