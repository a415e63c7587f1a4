"""The oracle of the endpoint law, a plain transcription of theory.md, against scipy.integrate.solve_ivp."""

from math import factorial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases.law import random_case, random_point
from oracles.law import Law


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
