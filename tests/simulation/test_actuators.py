"""Actuators and the quantised sensor: the instants of switching, against an ODE solver."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import foreswitch as fsw
from foreswitch.baselines import Relay
from oracles.rig import integrated, reading, switching
from systems import TWO_BY_TWO, quiet


def random_plant(rng, Ts):
    """Up to four states and two inputs, no faster than the period, its dead times unequal and fractional."""
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    A = rng.standard_normal((n, n)) / n
    A = (A - 0.3 * np.eye(n)) * rng.uniform(0.05, 0.5) / Ts
    E = rng.standard_normal((n, 1)) if rng.random() < 0.4 else None
    delay = rng.uniform(0.0, 4.0, m) * Ts
    if rng.random() < 0.2:
        delay = np.round(delay / Ts) * Ts
    return fsw.Plant(
        A, rng.standard_normal((n, m)) / Ts, rng.standard_normal((1, n)), E=E, input_delay=delay,
        u_offset=0.3 * rng.standard_normal(m), y_offset=rng.standard_normal(1),
    )  # fmt: skip


def random_travel(rng, m, Ts):
    """Opening and closing times, some equal, some apart by whole periods so that edges meet."""
    opening, closing = rng.uniform(0.0, 3.0, m) * Ts, rng.uniform(0.0, 3.0, m) * Ts
    kind = rng.random()
    if kind < 0.1:
        closing = opening.copy()
    elif kind < 0.3:
        closing = opening + Ts * rng.integers(1, 3, m)
    return opening, closing


def random_case(seed):
    """A run on a random rig, and all that a transcription of it needs."""
    rng = np.random.default_rng([20060, seed])
    Ts, steps = float(rng.choice([0.1, 1e-3, 2.5])), int(rng.integers(10, 16))
    plant = random_plant(rng, Ts)
    n, m = plant.states, plant.inputs
    levels = [np.sort(rng.choice(np.arange(-4, 5) / 2.0, rng.integers(2, 4), replace=False)) for _ in range(m)]
    controller = fsw.Controller(plant, [list(v) for v in levels], Ts, fsw.Endpoint(2.0 * Ts, 1.0 / Ts))
    rows = controller.pending_steps + int(rng.integers(1, 4))
    past = np.column_stack([rng.choice(v, rows) for v in levels])
    controller.reset(pending=past)
    past = past[-controller.pending_steps - 1 :]  # older ones are forgotten

    opening, closing = random_travel(rng, m, Ts)
    stuck = ()
    if rng.random() < 0.2:
        start = int(rng.integers(0, steps - 3))
        stuck = ((int(rng.integers(m)), float(rng.uniform(-1, 1)), start * Ts, (start + 3) * Ts),)
    size = 3.0
    sensor = {"quantum": rng.choice([0.0, 0.02, 0.5], n) * size} if rng.random() < 0.7 else {}
    if rng.random() < 0.5:
        sensor |= {"low": -size * rng.uniform(0.2, 1.0, n), "high": size * rng.uniform(0.2, 1.0, n)}
    noise = rng.uniform(0.0, 0.1, n) * size if rng.random() < 0.5 else None
    load = 0.2 * rng.standard_normal((steps, m)) if rng.random() < 0.3 else None
    w = rng.standard_normal((steps, 1)) if plant.disturbances else None
    r = 6.0 * rng.standard_normal(steps + 1)
    run = fsw.simulate(
        controller, lambda t: np.interp(t, np.arange(steps + 1) * Ts, r), steps * Ts, x0=rng.standard_normal(n),
        load=load, disturbance=w, noise=noise, seed=seed,
        hardware=fsw.Hardware(
            opening=opening, closing=closing, **sensor,
            stuck=[fsw.Stuck(level, start, end, j) for j, level, start, end in stuck],
        ),
    )  # fmt: skip
    return controller, run, past, (opening, closing), {"load": load, "w": w, "stuck": stuck}, noise, sensor, r


@pytest.mark.parametrize("block", range(20))
def test_a_thousand_random_rigs_move_as_an_ode_solver_says_and_are_measured_by_rounding_and_range(block):
    """To 1e-8; the law, replayed on measurements written down anew, gives the same commands."""
    changes = swallowed = clipped = 0
    for seed in range(50 * block, 50 * block + 50):
        controller, run, past, (opening, closing), acting, noise, sensor, r = random_case(seed)
        plant, Ts, steps = controller.plant, controller.Ts, len(run.u)
        commands = np.vstack([past, run.u])
        edges = [
            switching(commands[:, j], -len(past) * Ts, Ts, delay + opening[j], delay + closing[j])
            for j, delay in enumerate(plant.input_delay)
        ]
        asked = np.count_nonzero(np.diff(commands, axis=0))
        changes, swallowed = changes + asked, swallowed + asked - sum(len(each) - 1 for each in edges)
        expected = integrated(plant, run.x[0], Ts, edges, steps, **acting)
        scale = 1.0 + np.abs(expected).max()
        assert run.x == pytest.approx(expected, rel=0, abs=1e-8 * scale), seed
        assert run.y == pytest.approx(expected @ plant.C.T + plant.y_offset, rel=0, abs=1e-7 * scale), seed

        for k in range(steps):
            measured = reading(run.x[k], k, seed, deviation=noise, **sensor)
            clipped += "low" in sensor and np.count_nonzero((measured == sensor["low"]) | (measured == sensor["high"]))
            w = None if acting["w"] is None else acting["w"][k]
            assert np.array_equal(controller.step(measured, r[k], disturbance=w), run.u[k]), (seed, k)
    assert changes > 200
    assert swallowed > 20
    assert clipped > 50


@pytest.mark.parametrize(
    ("told", "opening", "closing", "time_on"),
    [
        ([0, 1, 1, 0, 0, 0], 0.5, 0.3, 1.8),
        ([0, 1, 1, 0, 0, 0], 0.0, 1.5, 3.5),
        ([0, 1, 1, 0, 0, 0], 2.2, 0.1, 0.0),  # closed before it has opened
        ([0, 1, 1, 0, 0, 0], 2.0, 0.0, 0.0),  # both at once
        ([0, 1, 0, 1, 0, 0], 0.0, 1.5, 4.5),  # the pause is never seen
        ([0, 1, 0, 1, 1, 1], 1.0, 0.0, 2.0),  # nor is the pulse
        ([1, 1, 0, 0, 0, 0], 0.0, 0.25, 2.25),
    ],
)
def test_time_on_by_hand(told, opening, closing, time_on):
    """An integrator counts the seconds at level 1; a relay far from its reference does as it is told."""
    law = Relay(fsw.Plant([[0.0]], [[1.0]]), [0.0, 1.0], 1.0)
    reference = np.array([*told, 0])
    run = fsw.simulate(
        law, lambda t: 200.0 * reference[np.rint(t).astype(int)] - 100.0, 6.0,
        hardware=fsw.Hardware(opening=opening, closing=closing),
    )  # fmt: skip
    assert run.u[:, 0].tolist() == told
    assert run.x[-1] == pytest.approx([time_on])


def test_travel_times_of_zero_are_none():
    """A rig without travel is the plant itself."""
    controller = quiet(fsw.Controller, TWO_BY_TWO, [[0.0, 1.0], [-0.5, 0.0, 2.0]], 0.1, fsw.Endpoint(0.4, 1.0))
    plain = fsw.simulate(controller, 0.5, 6.0)
    rig = fsw.simulate(controller, 0.5, 6.0, hardware=fsw.Hardware(stuck=[fsw.Stuck(9.0, start=100.0)]))
    assert np.array_equal(plain.u, rig.u)
    assert rig.x == pytest.approx(plain.x, rel=1e-12, abs=1e-12)


@given(
    st.floats(-40.0, 40.0),
    st.sampled_from([0.0, 0.1, 0.25, 1.0, 3.0]),
    st.sampled_from([(-np.inf, np.inf), (-10.0, 10.0), (0.25, 0.5)]),
    st.sampled_from([0.0, 0.1]),
    st.booleans(),
)
def test_a_reading_is_rounded_then_limited_to_the_last_bit(x, quantum, limits, deviation, midway):
    """A relay on a plant at rest tells whether what it is given lies above or below."""
    if midway and quantum > 0:
        x = quantum * (np.floor(x / quantum) + 0.5)
    low, high = limits
    law = Relay(fsw.Plant([[0.0]], [[1.0]]), [0.0, 1.0], 1.0)
    what = fsw.Hardware(quantum=quantum, low=low, high=high)
    options = {"x0": [x], "noise": deviation, "hardware": what, "seed": 4}
    expected = reading([x], 0, 4, deviation=[deviation], quantum=[quantum], low=[low], high=[high])[0]
    for toward, command in ((-np.inf, 0.0), (np.inf, 1.0)):
        run = fsw.simulate(law, np.nextafter(expected, toward), 1.0, **options)
        assert run.u[0] == command
