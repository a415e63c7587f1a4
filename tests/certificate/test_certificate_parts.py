"""What a certificate is made of: the error's loop, peak gains, covering radius, ideal response."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy.linalg import expm

import foreswitch as fsw
from certificate.bounds import LAGS, ROUND_OFF
from certificate.designs import draw
from foreswitch.certificate.covering_radius import Covering
from foreswitch.certificate.error_dynamics import ErrorLoop
from foreswitch.certificate.ideal_response import Course, ideal_run
from foreswitch.certificate.peak_gain import Recursion, Unsettled
from oracles.certificate import Rival, over
from systems import RISE, valve_controller

# Matrices -------------------------------------------------------------------------------------------------------------


@st.composite
def loops(draw_):
    seed = draw_(st.integers(0, 10**6))
    _, controller, _ = draw(seed)
    assume(controller is not None)
    return controller


@settings(deadline=None, max_examples=60)
@given(loops())
def test_the_loop_without_pending_commands_is_the_augmented_one(controller):
    loop, rival = ErrorLoop(controller), Rival(controller)
    size = rival.n + rival.line * rival.m
    K = -rival.choice @ np.hstack([rival.see, rival.pending])
    step, matrix = rival.known_step[0], np.zeros((size, size))
    matrix[: rival.n, : rival.n], matrix[: rival.n, rival.n :] = rival.phi, step[:, : -rival.m]
    matrix[: rival.n] += step[:, -rival.m :] @ K
    matrix[rival.n : size - rival.m, rival.n + rival.m :] = np.eye(size - rival.n - rival.m)
    matrix[size - rival.m :] = K
    # xi of (x, pending), and the law on it
    tau = rival.tau
    xi = np.hstack([exact_flow(rival, tau.max()), pending_to(rival, tau.max())])
    scale = np.abs(K).max()
    assert loop.gain @ xi == pytest.approx(K, abs=1e-7 * scale)
    # characteristic polynomials agree but for poles at 0, which are as many as commands are under way: compare traces
    a, b = matrix, loop.M
    for _ in range(3):
        size = max(1.0, np.abs(np.linalg.eigvals(a)).max())
        assert np.trace(a) == pytest.approx(np.trace(b), abs=1e-6 * size)
        a, b = a @ matrix, b @ loop.M


def exact_flow(rival, t):
    return expm(rival.A * t)


def pending_to(rival, at):
    """What the commands under way will have done by an instant after all of them, (n, line m)."""
    late = at + rival.line * rival.Ts
    back = exact_flow(rival, at - late)
    columns = np.zeros((rival.n, rival.line, rival.m))
    for i in range(rival.line):
        for j in range(rival.m):
            start = (i - rival.line) * rival.Ts + rival.tau[j]
            columns[:, i, j] = back @ over(rival.A, rival.B[:, j], start, start + rival.Ts, late)
    return columns.reshape(rival.n, -1)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 4))
def test_peak_gains_are_brute_sums(seed, n):
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(n, n))
    M *= rng.uniform(0.1, 0.97) / np.abs(np.linalg.eigvals(M)).max()
    rows, columns = rng.normal(size=(2, n)), rng.normal(size=(n, 3))
    terms, power = [], np.eye(n)
    for _ in range(3000):
        terms.append(rows @ power @ columns)
        power = power @ M
    recursion = Recursion(M)
    one, two = np.abs(terms).sum(axis=0), np.linalg.norm(terms, axis=2).sum(axis=0)
    assert (recursion.sums(rows, columns) >= one * (1 - 1e-12)).all()
    assert recursion.sums(rows, columns) == pytest.approx(one, rel=1e-6)
    assert (recursion.sums(rows, columns, norm=2) >= two * (1 - 1e-12)).all()
    assert recursion.sums(rows, columns, norm=2) == pytest.approx(two, rel=1e-6)


def test_peak_gains_of_what_hardly_decays_are_refused():
    with pytest.raises(Unsettled):
        Recursion(np.array([[1.0 - 1e-7]]))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 3))
def test_covering_radius_against_a_fine_grid(seed, r):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(int(rng.integers(2, 9)), r))
    faces = np.eye(r) + 0.3 * rng.normal(size=(r, r))
    assume(abs(np.linalg.det(faces)) > 0.2)
    low = rng.uniform(-2.0, -0.2, r)
    high = rng.uniform(0.2, 2.0, r)
    count = {1: 4001, 2: 101, 3: 31}[r]
    axes = np.meshgrid(*(np.linspace(a, b, count) for a, b in zip(low, high, strict=True)))
    places = np.stack([a.ravel() for a in axes], axis=1) @ np.linalg.inv(faces).T
    brute = np.sqrt(np.square(places[:, None] - points).sum(axis=2).min(axis=1)).max()
    step = np.linalg.norm(np.linalg.inv(faces), 2) * np.linalg.norm((high - low) / (count - 1)) / 2
    found = Covering(points, faces).farthest(low, high)
    assert brute <= found * ROUND_OFF
    assert found <= brute + step


def test_covering_radius_of_a_lattice_is_that_of_its_cell():
    points = np.array([[a, b] for a in range(4) for b in range(4)], dtype=float)
    assert Covering(points, np.eye(2)).farthest(np.zeros(2), 3.0 * np.ones(2)) == pytest.approx(np.sqrt(0.5), rel=1e-12)


# The ideal response ---------------------------------------------------------------------------------------------------


def test_the_ideal_response_is_the_limit_of_fine_levels():
    fine = fsw.Controller(LAGS, np.linspace(-5.0, 5.0, 255), 0.1, fsw.Endpoint(0.5, 3.0))
    reference = fsw.Sine(amplitude=0.3, frequency=0.1)
    certificate = fsw.certify(fine, reference=reference, duration=30.0, x0=[0.0, 0.0])
    run = fsw.simulate(fine, reference, 30.0)
    assert certificate.ideal(reference, 30.0) == pytest.approx(run.y, abs=certificate.error_bound[0])
    assert certificate.error_bound[0] < 2e-3


def test_the_ideal_response_by_another_integration():
    """In deviation from it the real loop is the adversary's: his y plus the ideal one is what is simulated."""
    controller = valve_controller()
    certificate = fsw.certify(controller, reference=RISE, duration=0.6)
    run = fsw.simulate(controller, RISE, 0.6)
    y, u = ideal_run(ErrorLoop(controller), Course(controller, RISE, 0.6))
    rival = Rival(controller)
    off, _ = rival.run(u[:, None, :, None])
    commands = rival.U[0, rival.line :, 0]
    assert np.array_equal(commands, run.u[:, 0])
    assert y[1:, 0] + off[:, 0, -1, 0, 0] == pytest.approx(run.y[1:, 0], abs=1e-6)
    assert np.array_equal(certificate.ideal(RISE, 0.6), y)
