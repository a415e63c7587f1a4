"""The closed loop: an exact plant, honest noise, and figures of merit that can be checked by hand."""

import json
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import foreswitch as fsw
from foreswitch.baselines import Relay
from oracles.rig import reading
from systems import MASS, OVEN, RISE, TWO_BY_TWO, VALVE, exact_state, valve_controller

WAVE = fsw.Stack(fsw.Sine(0.8, 0.11, offset=0.6), fsw.Sine(0.5, 0.07, offset=0.4, phase=1.0))


def two_by_two(**changes):
    """A controller of two inputs and two outputs, and the truth that differs from its model."""
    controller = fsw.Controller(
        TWO_BY_TWO.replace(E=[[0.3], [0.0], [1.0]]), [[0.0, 1.0], [-0.5, 0.0, 2.0]], 0.1, fsw.Endpoint(0.4, 1.0)
    )
    truth = TWO_BY_TWO.replace(
        A=1.1 * TWO_BY_TWO.A, E=[[0.2], [0.1], [1.0]], input_delay=[0.23, 0.481], u_offset=[0.05, -0.1], y_offset=0.02
    )
    return controller, truth.replace(**changes)


# The plant is stepped exactly -----------------------------------------------------------------------------------------


def test_states_are_those_of_the_pieces_of_constant_input():
    """Unequal fractional dead times, commands under way, operating point, load and disturbance."""
    controller, truth = two_by_two()
    history = [[1.0, -0.5], [0.0, 2.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]]
    controller.reset(pending=history)
    rng = np.random.default_rng(1)
    load, w = 0.3 * rng.standard_normal((60, 2)), rng.standard_normal((60, 1))
    run = fsw.simulate(
        controller, WAVE, 6.0, plant=truth, x0=[0.1, -0.2, 0.3], load=load, disturbance=w, noise=0.05, seed=2
    )
    assert len(np.unique(run.u, axis=0)) > 3
    before = [history[0]] * 3 + history  # the loop keeps five rows; older ones do not matter
    for k in (1, 2, 7, 33, 60):
        expected = exact_state(truth, run.x[0], 0.1, (before, run.u), 0.1 * k, load=load, w=w)
        assert run.x[k] == pytest.approx(expected, rel=1e-10, abs=1e-12)
    assert run.y == pytest.approx(run.x @ truth.C.T + truth.y_offset)


def test_states_are_those_of_an_ode_solver():
    controller, truth = two_by_two()
    run = fsw.simulate(controller, WAVE, 3.0, plant=truth, disturbance=0.4)

    def command(t, j):
        k = int(np.floor((t - truth.input_delay[j]) / 0.1 + 1e-12))
        return run.u[k, j] if k >= 0 else 0.0

    def slope(t, x):
        u = np.array([command(t, j) for j in range(2)])
        return truth.A @ x + truth.B @ (u - truth.u_offset) + truth.E[:, 0] * 0.4

    edges = {round(0.1 * k + tau, 12) for k in range(31) for tau in (0.0, *truth.input_delay)}
    edges = sorted(t for t in edges if 0.0 <= t <= 3.0)
    x = np.zeros(3)
    for a, b in pairwise(edges):
        middle = 0.5 * (a + b)
        x = solve_ivp(lambda t, x, m=middle: slope(m, x), (a, b), x, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        k = round(b / 0.1)
        if abs(b - 0.1 * k) < 1e-9:
            assert run.x[k] == pytest.approx(x, abs=1e-8)


@given(st.floats(0.0, 0.05), st.floats(0.0, 1.0))
def test_any_dead_time_of_the_truth(dead_time, start):
    truth = VALVE.replace(input_delay=dead_time)
    run = fsw.simulate(valve_controller(), RISE, 0.12, plant=truth, x0=[start, 0.0])
    expected = exact_state(truth, run.x[0], 1e-3, ([[0.0]], run.u), 0.12)
    assert run.x[-1] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_truth_of_longer_dead_time_goes_on_with_the_oldest_command_known():
    controller, truth = valve_controller(), VALVE.replace(input_delay=0.02)
    controller.reset(pending=[1, 1, 0, 0, 0, 0])
    run = fsw.simulate(controller, 0.0, 0.02, plant=truth)
    expected = exact_state(truth, np.zeros(2), 1e-3, ([1] * 16 + [0] * 4, run.u), 0.02)
    assert run.x[-1] == pytest.approx(expected, rel=1e-10)


def test_a_decayed_state_is_zero_and_not_denormal():
    stable = fsw.Plant([[-100.0]], [[1.0]])
    run = fsw.simulate(Relay(stable, [0.0, 1.0], 1.0), -1.0, 20.0, x0=[1.0])
    assert run.x[4, 0] == pytest.approx(np.exp(-400.0), rel=1e-9)
    assert not run.x[5:].any()  # exp(-500) = 7e-218 is a double, but not for long


# What acts on it ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["load", "disturbance"])
def test_a_signal_may_be_constant_sampled_or_computed(name):
    controller, truth = two_by_two()
    width = {"load": 2, "disturbance": 1}[name]
    value = np.array([0.2, -0.1])[:width]
    forms = [value, np.tile(value, (20, 1)), np.tile(value, (21, 1)), lambda t, x: value]
    runs = [fsw.simulate(controller, WAVE, 2.0, plant=truth, **{name: form}) for form in forms]
    nothing = fsw.simulate(controller, WAVE, 2.0, plant=truth)
    for run in runs:
        assert np.array_equal(run.x, runs[0].x)
        assert not np.array_equal(run.x, nothing.x)


def test_a_number_is_a_signal_and_a_vector_is_one_of_samples():
    w = np.linspace(0.0, 900.0, 50)
    vented = valve_controller(VALVE.replace(E=[[-1.0], [0.0]]))
    sampled = fsw.simulate(vented, RISE, 0.05, disturbance=w)
    computed = fsw.simulate(vented, RISE, 0.05, disturbance=lambda t, x: w[round(t / 1e-3)])
    assert np.array_equal(sampled.x, computed.x)
    one, one_of_one = (fsw.simulate(vented, RISE, 0.05, disturbance=value) for value in (300.0, [300.0]))
    assert np.array_equal(one.x, one_of_one.x)


def test_a_law_of_the_state_sees_the_state_of_its_own_instant():
    """A vent that opens with the pressure."""
    leak = 5.0
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    seen = []

    def vent(t, x):
        seen.append((t, x.copy()))
        flow = leak * x[0]
        x[:] = np.nan  # its own copy
        return flow

    run = fsw.simulate(valve_controller(vented), RISE, 0.2, disturbance=vent)
    assert [t for t, _ in seen] == pytest.approx(run.t[:-1])
    assert np.array_equal([x for _, x in seen], run.x[:-1])
    expected = exact_state(vented, np.zeros(2), 1e-3, ([[0.0]], run.u), 0.2, w=leak * run.x[:-1, :1])
    assert run.x[-1] == pytest.approx(expected, rel=1e-10)


def test_the_controller_is_not_told_of_the_load():
    """Its bias on the integrating valve is that of an input it does not know."""
    run = fsw.simulate(valve_controller(), 1000.0, 2.0, x0=[1000.0, 0.0], load=-0.1)
    controller = valve_controller()
    for k in range(200):
        assert controller.step(run.x[k], 1000.0) == run.u[k]
    assert run.y[1000:].mean() < 992.0


def test_a_disturbance_the_model_lacks_acts_on_the_truth_alone():
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    unaware = fsw.simulate(valve_controller(), 1000.0, 1.0, plant=vented, x0=[1000.0, 0.0], disturbance=1650.0)
    aware = fsw.simulate(valve_controller(vented), 1000.0, 1.0, x0=[1000.0, 0.0], disturbance=1650.0)
    assert unaware.y[500:].mean() < 990.0
    assert aware.y[500:].mean() == pytest.approx(1000.0, abs=2.0)


# What is measured -----------------------------------------------------------------------------------------------------


def test_the_controller_measures_state_plus_seeded_noise():
    deviation = np.array([3.0, 40.0])
    run = fsw.simulate(valve_controller(), RISE, 0.2, noise=deviation, seed=7)
    controller, other = valve_controller(), valve_controller()
    differing = 0
    for k in range(200):
        reference = RISE(run.t[k])[..., :2]
        assert controller.step(reading(run.x[k], k, 7, deviation=deviation), reference) == run.u[k]
        differing += other.step(reading(run.x[k], k, 8, deviation=deviation), reference) != run.u[k]
    assert differing > 5  # noise of another seed would be noticed


def test_the_same_seed_gives_the_same_run():
    runs = [fsw.simulate(valve_controller(), RISE, 0.2, noise=5.0, seed=seed) for seed in (3, 3, 4, None, None)]
    assert np.array_equal(runs[0].x, runs[1].x)
    assert not np.array_equal(runs[0].x, runs[2].x)
    assert not np.array_equal(runs[3].x, runs[4].x)


def third_order_valve():
    """The valve with a complex pair in place of its lag: the same gain and about the same delay."""
    omega, damping = 450.0, 0.6
    den = np.polymul([1.0, 0.0], [1.0 / omega**2, 2.0 * damping / omega, 1.0])
    return fsw.Plant.from_tf([16500.0], den, input_delay=0.0083)


def test_a_truth_of_higher_order_is_measured_in_y_and_its_derivatives():
    truth, controller = third_order_valve(), valve_controller()
    run = fsw.simulate(controller, RISE, 0.6, plant=truth)
    assert run.x.shape == (601, 3)
    for k in range(600):
        assert controller.step(run.x[k, :2], RISE(run.t[k])[..., :2]) == run.u[k]
    assert run.metrics()["rms_error_at_lag"] < 16.5  # kPa, one pulse


def test_a_given_sensor_replaces_the_guess():
    truth = third_order_valve()
    sensor = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1e-4]])
    run = fsw.simulate(valve_controller(), RISE, 0.3, plant=truth, sensor=sensor)
    controller = valve_controller()
    for k in range(300):
        assert controller.step(sensor @ run.x[k], RISE(run.t[k])[..., :2]) == run.u[k]


# Figures of merit -----------------------------------------------------------------------------------------------------


def made_up_run(y, r, u, *, Ts=0.5, safe=0.0):
    """A run of one input and one output from its columns."""
    y, r, u = (np.array(column, dtype=float).reshape(-1, 1) for column in (y, r, u))
    nothing, w = np.zeros(len(u)), np.zeros((len(u), 0))
    return fsw.Run(Ts * np.arange(len(y)), y, y, u, r, w, nothing, nothing, nothing, OVEN, np.array([safe]))


def test_metrics_by_hand():
    figures = made_up_run([0, 1, 3, 2], [1, 1, 1, 2], [0, 1, 1]).metrics()
    assert figures["rms_error"] == pytest.approx(np.sqrt(5.0 / 4.0))
    assert figures["max_error"] == 2.0
    assert figures["switches"] == 1
    assert figures["on_time"] == 1.0
    off_at_one = made_up_run([0, 1, 3, 2], [1, 1, 1, 2], [0, 1, 1], safe=1.0).metrics()
    assert off_at_one["on_time"] == 0.5


@pytest.mark.parametrize("lag", [-0.37, 0.0, 0.013, 0.5, 1.204])
def test_lag_is_the_shift_of_the_reference_that_fits_best(lag):
    reference = fsw.Sine(2.0, 0.13, phase=0.3)
    t = np.arange(0.0, 20.0, 0.05)
    r, y = reference(t)[:, 0, 0], reference(t - lag)[:, 0, 0] + 0.1 * np.sin(40.0 * t)
    figures = made_up_run(y, r, np.zeros(len(t) - 1), Ts=0.05).metrics()
    assert figures["lag"] == pytest.approx(lag, abs=2e-3)
    assert figures["rms_error_at_lag"] == pytest.approx(0.1 / np.sqrt(2.0), rel=0.02)


def test_a_constant_reference_has_no_lag():
    figures = made_up_run(np.arange(20.0), np.full(20, 3.0), np.zeros(19)).metrics()
    assert figures["lag"] == 0.0
    assert figures["rms_error_at_lag"] == figures["rms_error"]


def test_metrics_of_several_outputs_and_inputs_are_arrays():
    controller, truth = two_by_two()
    run = fsw.simulate(controller, WAVE, 10.0, plant=truth)
    figures = run.metrics()
    assert {name: np.shape(value) for name, value in figures.items()} == dict.fromkeys(figures, (2,))
    assert figures["switches"].tolist() == [np.count_nonzero(np.diff(u)) for u in run.u.T]
    assert figures["rms_error"] == pytest.approx(np.sqrt(((run.y - run.r) ** 2).mean(axis=0)))


# A run ----------------------------------------------------------------------------------------------------------------


def test_the_arrays_of_a_run():
    controller, truth = two_by_two()
    run = fsw.simulate(controller, WAVE, 1.0, plant=truth)
    shapes = {"t": (11,), "x": (11, 3), "y": (11, 2), "u": (10, 2), "r": (11, 2)}
    shapes |= {"cost": (10,), "nodes": (10,), "status": (10,)}
    assert {name: getattr(run, name).shape for name in shapes} == shapes
    assert run.Ts == pytest.approx(0.1)
    assert run.t == pytest.approx(0.1 * np.arange(11))
    assert np.array_equal(run.r, WAVE(run.t, 1)[:, :, 0])
    assert (run.nodes == 6).all()
    assert not run.status.any()
    probe = controller.copy()
    costs = [probe.decide(x, r).cost for x, r in zip(run.x[:1], run.r[:1], strict=True)]
    assert run.cost[:1] == pytest.approx(costs)


@pytest.mark.parametrize(("duration", "steps"), [(1.0, 10), (0.95, 10), (0.3, 3), (1.1, 11), (0.01, 1)])
def test_the_duration_is_rounded_up_to_whole_periods(duration, steps):
    controller = fsw.Controller(MASS, [-1, 0, 1], 0.1, fsw.Endpoint(0.5, 3.0))
    assert len(fsw.simulate(controller, 1.0, duration).u) == steps


def test_csv_and_frame_hold_the_run(tmp_path):
    controller, truth = two_by_two(output_names=["p, inlet [kPa]", "T [K]"], input_names=["fuel", "air"])
    run = fsw.simulate(controller, WAVE, 2.0, plant=truth)
    run.to_csv(tmp_path / "run.csv")
    read, frame = pd.read_csv(tmp_path / "run.csv"), run.to_frame()
    assert list(read) == list(frame)
    assert read.to_numpy() == pytest.approx(frame.to_numpy(), rel=1e-8)
    assert np.array_equal(frame["p, inlet [kPa]"], run.y[:, 0])
    assert np.array_equal(frame["reference T [K]"], run.r[:, 1])
    assert np.array_equal(frame["air"], np.append(run.u[:, 1], run.u[-1, 1]))
    assert np.array_equal(frame[["x1", "x2", "x3"]], run.x)
    assert [file.name for file in tmp_path.iterdir()] == ["run.csv"]


def test_every_column_has_a_name_of_its_own(tmp_path):
    """Even where the plant's names repeat each other, or hold what a CSV file has other uses for."""
    controller, truth = two_by_two(output_names=["cost", 'a "p", b'], input_names=["x1", "x1 (2)"])
    run = fsw.simulate(controller, WAVE, 0.5, plant=truth, disturbance=lambda t, x: [t])
    columns = run.columns()
    assert list(columns) == [
        "t [s]", "reference cost", "cost", 'reference a "p", b', 'a "p", b', "x1", "x1 (2)", "x1 (3)", "x2", "x3", "w1",
        "cost (2)", "status",
    ]  # fmt: skip
    assert np.array_equal(columns["x1"][:-1], run.u[:, 0])
    assert np.array_equal(columns["x1 (3)"], run.x[:, 0])
    assert columns["w1"] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.4])
    run.to_csv(tmp_path / "run.csv")
    assert list(pd.read_csv(tmp_path / "run.csv")) == list(columns)


def test_a_run_remembers_the_measured_disturbance():
    controller, truth = two_by_two()
    w = np.linspace(-1.0, 1.0, 20)
    assert np.array_equal(fsw.simulate(controller, WAVE, 2.0, plant=truth, disturbance=w).w, w[:, None])
    computed = fsw.simulate(controller, WAVE, 2.0, plant=truth, disturbance=lambda t, x: [x[0]])
    assert np.array_equal(computed.w, computed.x[:-1, :1])
    assert not fsw.simulate(controller, WAVE, 2.0, plant=truth).w.any()
    assert fsw.simulate(valve_controller(), RISE, 0.1).w.shape == (100, 0)


def test_parquet_holds_the_run_to_the_last_bit(tmp_path):
    controller, truth = two_by_two(output_names=["p, inlet [kPa]", "T [K]"], input_names=["fuel", "air"])
    run = fsw.simulate(controller, WAVE, 2.0, plant=truth, disturbance=0.3, noise=0.05, seed=1)
    run.to_parquet(tmp_path / "run.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "run.parquet"), run.to_frame(), check_exact=True)
    assert [file.name for file in tmp_path.iterdir()] == ["run.parquet"]


def test_json_holds_the_figures(tmp_path):
    controller, truth = two_by_two()
    for run in (fsw.simulate(controller, WAVE, 2.0, plant=truth), fsw.simulate(valve_controller(), RISE, 0.1)):
        run.to_json(tmp_path / "run.json")
        read = json.loads((tmp_path / "run.json").read_text())
        metrics = run.metrics()
        assert set(read) == set(metrics)
        for name, value in metrics.items():
            assert np.array_equal(read[name], value), name
    assert [file.name for file in tmp_path.iterdir()] == ["run.json"]


@pytest.mark.parametrize("kind", ["csv", "parquet", "json"])
def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch, kind):
    run = made_up_run([0, 1], [0, 1], [0])
    target = tmp_path / f"run.{kind}"
    target.write_text("as it was")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="No space left"):
        getattr(run, f"to_{kind}")(target)
    assert [file.name for file in tmp_path.iterdir()] == [target.name]
    assert target.read_text() == "as it was"


def test_the_repr_of_a_run_is_a_short_tree():
    run = fsw.simulate(valve_controller(), RISE, 0.6)
    assert repr(run).splitlines() == [
        "Run",
        "├─ time      600 periods of 0.001 s",
        "├─ output    y, rms error 23.1",
        "├─ input     u, 122 switches",
        "└─ status    OK throughout",
    ]
    lost = fsw.simulate(valve_controller(), RISE, 0.6, hardware=fsw.Hardware(outages=[(0.1, 0.107)]))
    assert repr(lost).splitlines()[-1] == "└─ status    7 periods not OK"


def test_a_csv_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    run = made_up_run([0, 1], [0, 1], [0])
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="directory"):
        run.to_csv(tmp_path / "taken")
    assert [file.name for file in tmp_path.iterdir()] == ["taken"]


def test_the_plot_shows_outputs_references_and_commands():
    controller, truth = two_by_two(output_names=["p [kPa]", "T [K]"], input_names=["fuel", "air"])
    run = fsw.simulate(controller, WAVE, 2.0, plant=truth)
    figure = run.plot(title="two by two")
    assert isinstance(figure, Figure)
    assert figure.get_suptitle() == "two by two"
    assert [axes.get_ylabel() for axes in figure.axes] == ["p [kPa]", "T [K]", "fuel", "air"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    behind, front = figure.axes[0].lines
    assert np.array_equal(front.get_ydata(), run.y[:, 0])
    assert np.array_equal(behind.get_ydata(), run.r[:, 0])
    assert behind.get_zorder() < front.get_zorder()
    stairs = figure.axes[3].patches[0].get_data()
    assert np.array_equal(stairs.values, run.u[:, 1])
    assert np.array_equal(stairs.edges, run.t)
