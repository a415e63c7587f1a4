"""Many runs at once: each is the single run, bit for bit, whatever the threads; memory does not grow."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

import foreswitch as fsw
from foreswitch.baselines import Relay, SmithPWM
from systems import OVEN, RISE, TWO_BY_TWO, VALVE, quiet, valve_controller

EVERYTHING = fsw.Hardware(
    opening=0.0033, closing=0.0012, stuck=[fsw.Stuck(1.0, 0.02, 0.03)], quantum=[2.0, 10.0], low=-1e4, high=1e4,
    process_noise=[3.0, 30.0], missing=0.1, late=0.0025, outages=[(0.01, 0.014)],
)  # fmt: skip

THIRD = fsw.Plant.from_tf([16500.0], [5e-6, 3e-3, 1.0, 0.0], input_delay=0.0083)


def coupled():
    """Two inputs and two outputs, a disturbance, commands under way."""
    plant = TWO_BY_TWO.replace(E=[[0.3], [0.0], [1.0]])
    controller = quiet(fsw.Controller, plant, [[0.0, 1.0], [-0.5, 0.0, 2.0]], 0.1, fsw.Endpoint(0.4, 1.0))
    controller.reset(pending=[[1.0, -0.5], [0.0, 2.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]])
    return controller


def one_by_one(law, reference, duration, seeds, *, x0=None, plant=None, **simulation):
    """The figures that a batch must give, from single runs and sums in the order of time."""
    rows = []
    for i, seed in enumerate(seeds):
        run = fsw.simulate(
            law, reference, duration, seed=int(seed), x0=x0[i] if np.ndim(x0) == 2 else x0,
            plant=plant[i] if isinstance(plant, list) else plant, **simulation,
        )  # fmt: skip
        error = run.y - run.r
        rms = np.sqrt(np.cumsum(error**2, axis=0)[-1] / len(error))
        on = np.count_nonzero(run.u != run.safe_level, axis=0) * law.Ts
        rows.append((rms, np.abs(error).max(axis=0), np.count_nonzero(np.diff(run.u, axis=0), axis=0), on))
    return [np.array(column) for column in zip(*rows, strict=True)]


def same(batch, columns):
    """Bit for bit."""
    for name, column in zip(("rms_error", "max_error", "switches", "on_time"), columns, strict=True):
        given = getattr(batch, name)
        assert given.shape == column.shape, name
        assert np.array_equal(given, column), name


# Each run is the single run -------------------------------------------------------------------------------------------


def test_ten_thousand_runs_are_ten_thousand_single_runs():
    rng = np.random.default_rng(1)
    x0 = rng.uniform(0.0, 20.0, (10_000, 2))
    arguments = (valve_controller(), RISE, 0.06)
    options = {"x0": x0, "noise": [5.0, 50.0], "load": 0.02}
    batch = fsw.simulate_batch(*arguments, seeds=10_000, threads=2, **options)
    assert np.array_equal(batch.seeds, np.arange(10_000))
    same(batch, one_by_one(*arguments, range(10_000), **options))
    assert len(np.unique(batch.rms_error)) > 9_900
    assert 2 < len(np.unique(batch.switches)) < 30


CASES = {
    "noise": (valve_controller, RISE, 0.05, {"noise": 20.0}),
    "nothing random": (valve_controller, RISE, 0.05, {}),
    "hardware": (valve_controller, RISE, 0.05, {"noise": [5.0, 50.0], "hardware": EVERYTHING}),
    "drift": (valve_controller, RISE, 0.05, {
        "hardware": fsw.Hardware(drift=VALVE.replace(B=1.5 * VALVE.B), process_noise=5.0)}),
    "single precision": (lambda: valve_controller(real="float32"), RISE, 0.05, {"noise": 20.0}),
    "dwell": (lambda: valve_controller(min_on=0.004, min_off=0.003), RISE, 0.05, {"noise": 20.0}),
    "safe level": (lambda: valve_controller(safe_level=0.0, bad_limit=3), RISE, 0.1, {
        "hardware": fsw.Hardware(missing=0.5)}),
    "another order": (valve_controller, RISE, 0.05, {
        "plant": THIRD, "noise": 20.0}),
    "coupled": (coupled, 0.5, 4.0, {"noise": 0.1, "disturbance": 0.2, "load": [0.1, -0.1], "x0": [0.1, 0.2, 0.3]}),
    "samples of w": (coupled, 0.5, 4.0, {"noise": 0.1, "disturbance": np.sin(np.arange(40.0))[:, None]}),
    "coupled hardware": (coupled, 0.5, 4.0, {
        "noise": 0.1, "hardware": fsw.Hardware(opening=[0.03, 0.17], closing=0.21, late=0.35, process_noise=0.05)}),
    "w of the state": (coupled, 0.5, 4.0, {"noise": 0.1, "disturbance": lambda t, x: [0.2 * x[0] * np.cos(t)]}),
    "load of the state": (coupled, 0.5, 4.0, {"noise": 0.1, "load": lambda t, x: 0.1 * x[:2]}),
    "w of the state, hardware": (valve_controller, RISE, 0.05, {
        "plant": VALVE.replace(E=[[-1.0], [0.0]]), "disturbance": lambda t, x: [3.0 * x[0]], "hardware": EVERYTHING}),
    "relay": (lambda: Relay(VALVE, [0, 1], 1e-3, lead=0.01, hysteresis=5.0), RISE, 0.05, {"noise": 20.0}),
    "Smith": (lambda: SmithPWM(OVEN, [0, 1], 1.0, kp=0.02, ki=1e-4, carrier=10.0, min_on=2.0), 40.0, 150.0, {
        "noise": 0.5, "hardware": fsw.Hardware(opening=3.0, closing=1.0)}),
    "not linear": (valve_controller, RISE, 0.02, {
        "plant": fsw.NonlinearPlant(lambda t, x, u, w: [x[1], (16500.0 * u[0] - x[1]) / 0.006 - abs(x[0]) * x[1]],
                                    lambda x: x[:1], states=2, input_delay=0.0047), "noise": 20.0}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_batch_is_its_single_runs(name):
    build, reference, duration, options = CASES[name]
    runs = 20 if name == "not linear" else 150  # more than two chunks of the batch
    seeds = np.random.default_rng(3).integers(0, 2**64, runs, dtype=np.uint64)
    law = build()
    batch = fsw.simulate_batch(law, reference, duration, seeds=seeds.tolist(), **options)
    assert batch.seeds.tolist() == seeds.tolist()
    same(batch, one_by_one(law, reference, duration, seeds, **options))
    random = name not in ("nothing random",)
    assert (len(np.unique(batch.rms_error[:, 0])) > 1) == random
    again = fsw.simulate_batch(law, reference, duration, seeds=seeds.tolist(), **options)  # the law is as it was
    assert np.array_equal(again.rms_error, batch.rms_error)


@pytest.mark.parametrize("what", [None, EVERYTHING])
def test_each_run_has_its_plant_and_its_start(what):
    rng = np.random.default_rng(5)
    plants = [
        VALVE.replace(B=gain * VALVE.B, input_delay=delay)
        for gain, delay in zip(rng.uniform(0.8, 1.2, 70), rng.uniform(0.0, 0.02, 70), strict=True)
    ]
    plants = [*plants[:50], *[plants[50]] * 80, *plants[50:]]  # one of them for more than a chunk, in a row
    x0 = rng.uniform(0.0, 100.0, (150, 2))
    law = valve_controller()
    options = {"plant": plants, "x0": x0, "noise": 10.0, "hardware": what}
    batch = fsw.simulate_batch(law, RISE, 0.04, seeds=150, **options)
    same(batch, one_by_one(law, RISE, 0.04, range(150), **options))


def test_figures_are_those_of_the_run():
    law = coupled()
    batch = fsw.simulate_batch(law, 0.5, 4.0, seeds=[8], noise=0.1, disturbance=0.2)
    figures = fsw.simulate(law, 0.5, 4.0, seed=8, noise=0.1, disturbance=0.2).metrics()
    for name in ("rms_error", "max_error", "switches", "on_time"):
        assert np.array_equal(getattr(batch, name)[0], figures[name])


# Threads and memory ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["noise", "hardware", "coupled hardware", "single precision", "Smith"])
def test_threads_change_nothing(name):
    build, reference, duration, options = CASES[name]
    law = build()
    one, *others = (
        fsw.simulate_batch(law, reference, duration, seeds=500, threads=threads, **options)
        for threads in (1, 2, 3, 7, None)
    )
    for other in others:
        same(other, [one.rms_error, one.max_error, one.switches, one.on_time])


PEAK = """
import resource, sys, tracemalloc
import foreswitch as fsw
law = fsw.Controller(fsw.Plant.integrator_lag(16500.0, 0.006, 0.005), [0, 1], 1e-3, fsw.Endpoint(0.02, 2500.0))
what = fsw.Hardware(opening=0.0033, late=0.002)
def peaks(runs):
    tracemalloc.start()
    fsw.simulate_batch(law, 500.0, 0.5, seeds=runs, noise=20.0, threads=2, hardware=what)
    python = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return python, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
peaks(500)
few, many = peaks(1000), peaks(20000)
print(many[0] - few[0], many[1] - few[1])
"""


def test_memory_does_not_grow_with_the_number_of_runs():
    """A run of 500 periods kept whole would take 30 kB, 19 000 of them 570 MB; a row of the result takes 56 bytes."""
    done = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    python, resident = map(int, done.stdout.split())
    assert python < 19_000 * 300
    assert resident < 19_000 * 600


# Arguments and results ------------------------------------------------------------------------------------------------


def test_seeds_may_be_counted_or_listed():
    law = valve_controller()
    counted = fsw.simulate_batch(law, RISE, 0.02, seeds=5, noise=20.0)
    for seeds in (np.int64(5), range(5), [0, 1, 2, 3, 4], np.arange(5), np.arange(5, dtype=np.uint8)):
        assert np.array_equal(fsw.simulate_batch(law, RISE, 0.02, seeds=seeds, noise=20.0).rms_error, counted.rms_error)
    back = fsw.simulate_batch(law, RISE, 0.02, seeds=[4, 4, 2**64 - 1], noise=20.0)
    assert back.rms_error[0] == back.rms_error[1] == counted.rms_error[4]
    assert back.rms_error[2] not in counted.rms_error


def test_no_runs_are_no_rows():
    batch = fsw.simulate_batch(valve_controller(), RISE, 0.02, seeds=0)
    assert [getattr(batch, name).shape for name in ("seeds", "rms_error", "on_time")] == [(0,), (0, 1), (0, 1)]
    assert len(fsw.simulate_batch(valve_controller(), RISE, 0.02, seeds=[], plant=[]).seeds) == 0


def test_a_frame_has_a_row_for_each_run():
    one = fsw.simulate_batch(valve_controller(), RISE, 0.02, seeds=7, noise=20.0).to_frame()
    assert list(one) == ["seed", "rms_error", "max_error", "switches", "on_time"]
    batch = fsw.simulate_batch(coupled(), 0.5, 1.0, seeds=7, noise=0.1)
    two = batch.to_frame()
    assert list(two) == ["seed", *(f"{name}_{i}" for name in list(one)[1:] for i in (1, 2))]
    assert isinstance(two, pd.DataFrame)
    assert np.array_equal(two["switches_2"], batch.switches[:, 1])
    assert two["seed"].tolist() == list(range(7))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seeds": -1}, "seeds is -1"),
        ({"seeds": True}, "seeds is True"),
        ({"seeds": 3.0}, "seeds is 3.0"),
        ({"seeds": [1, -1]}, "seeds is -1"),
        ({"seeds": [0.5]}, "seeds is 0.5"),
        ({"seeds": 3, "plant": [VALVE, VALVE]}, "plant lists 2 plants for 3 seeds"),
        ({"seeds": 2, "plant": [VALVE, THIRD]}, "plant 2 has 3 state"),
        ({"seeds": 3, "x0": [[1.0, 2.0]] * 2}, "x0 has shape"),
        ({"seeds": 3, "x0": [1.0]}, "x0 has shape"),
        ({"seeds": 3, "x0": [np.nan, 1.0]}, "x0 holds NaN"),
        ({"seeds": 3, "threads": 0}, "threads is 0"),
        ({"seeds": 3, "threads": -1}, "threads is -1"),
        ({"seeds": 3, "noise": -1.0}, "noise is"),
        ({"seeds": 3, "disturbance": 1.0}, "disturbance is given"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        fsw.simulate_batch(valve_controller(), RISE, 0.02, **arguments)


def test_an_unknown_argument_is_refused():
    with pytest.raises(TypeError, match="nois"):
        fsw.simulate_batch(valve_controller(), RISE, 0.02, seeds=2, nois=1.0)


def test_an_exception_in_a_callback_ends_the_batch():
    def vent(t, x):
        raise ArithmeticError("no vent")

    law = valve_controller(VALVE.replace(E=[[-1.0], [0.0]]))
    with pytest.raises(ArithmeticError, match="no vent"):
        fsw.simulate_batch(law, RISE, 0.02, seeds=2, disturbance=vent)
