"""Plants that Python or an FMU steps: where they are linear they are the linear plant, where they are not they track."""

import gc
import os
import subprocess
import sysconfig
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.baselines import Relay
from places import TESTS
from systems import RISE, TWO_BY_TWO, VALVE, quiet, valve_controller

FMU = TESTS / "fmu"


def as_function(plant):
    """A linear plant as f and h."""
    return fsw.NonlinearPlant(
        lambda t, x, u, w: plant.A @ x + plant.B @ (u - plant.u_offset) + plant.E @ w,
        lambda x: plant.C @ x + plant.y_offset,
        states=plant.states, inputs=plant.inputs, outputs=plant.outputs, disturbances=plant.disturbances,
        input_delay=plant.input_delay, input_names=plant.input_names, output_names=plant.output_names,
    )  # fmt: skip


def coupled():
    plant = TWO_BY_TWO.replace(E=[[0.3], [0.0], [1.0]], input_delay=[0.37, 0.1], u_offset=[0.05, -0.1], y_offset=0.02)
    controller = quiet(fsw.Controller, plant, [[0.0, 1.0], [-0.5, 0.0, 2.0]], 0.1, fsw.Endpoint(0.4, 1.0))
    controller.reset(pending=[[1.0, -0.5], [0.0, 2.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]])
    return controller


SAMPLES = np.sin(np.arange(60.0))[:, None]
LINEAR = {
    "plain": (valve_controller, RISE, 0.1, {}),
    "noise": (valve_controller, RISE, 0.1, {"noise": [5.0, 50.0]}),
    "travel": (valve_controller, RISE, 0.1, {"hardware": fsw.Hardware(opening=0.0033, closing=0.00121)}),
    "faults": (valve_controller, RISE, 0.1, {"hardware": fsw.Hardware(
        opening=0.002, stuck=[fsw.Stuck(1.0, 0.03, 0.04)], missing=0.1, late=0.002, quantum=1.0)}),
    "coupled": (coupled, 0.5, 6.0, {"x0": [0.1, -0.2, 0.3], "noise": 0.02}),
    "all that acts": (coupled, 0.5, 6.0, {
        "disturbance": SAMPLES, "load": np.hstack([0.1 * SAMPLES, -0.2 * SAMPLES]),
        "hardware": fsw.Hardware(opening=[0.03, 0.17], closing=[0.21, 0.0], stuck=[fsw.Stuck(0.4, 2.0, 3.0, 1)])}),
    "of the state": (coupled, 0.5, 6.0, {"disturbance": lambda t, x: 0.3 * x[:1], "load": lambda t, x: 0.1 * x[1:]}),
    "another order": (valve_controller, RISE, 0.1, {
        "plant": fsw.Plant.from_tf([16500.0], [5e-6, 3e-3, 1.0, 0.0], input_delay=0.0083),
        "sensor": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}),
    "single precision": (lambda: valve_controller(real="float32"), RISE, 0.1, {}),
    "relay": (lambda: Relay(VALVE, [0, 1], 1e-3, lead=0.01, hysteresis=5.0), RISE, 0.1, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_function_is_the_linear_plant(name):
    """To 1e-8, commands and all."""
    build, reference, duration, options = LINEAR[name]
    law = build()
    truth = options.get("plant", law.plant)
    expected = fsw.simulate(law, reference, duration, seed=2, **options)
    run = fsw.simulate(law, reference, duration, seed=2, **options | {"plant": as_function(truth)})
    assert len(np.unique(expected.u, axis=0)) > 1
    assert np.array_equal(run.u, expected.u)
    assert np.array_equal(run.status, expected.status)
    for given, wanted in ((run.x, expected.x), (run.y, expected.y)):
        assert given == pytest.approx(wanted, rel=0, abs=1e-8 * np.abs(wanted).max())


def test_a_function_is_told_the_time():
    """x' = cos(t) beside an input that changes within the period, so that it is cut."""
    truth = fsw.NonlinearPlant(lambda t, x, u, w: [np.cos(t) + 0.0 * u[0]], lambda x: x, input_delay=0.3)
    law = Relay(fsw.Plant([[0.0]], [[1.0]]), [0.0, 1.0], 0.5)
    run = fsw.simulate(law, 0.2, 6.0, plant=truth)
    assert len(np.unique(run.u)) == 2
    assert run.x[:, 0] == pytest.approx(np.sin(run.t), abs=1e-9)


# Plants that are not linear -------------------------------------------------------------------------------------------

AREA, OUTLET = 0.5, 0.1  # m2, m2.5/s


def tank(**options):
    """A level h under a pump and a square-root outlet, A h' = u - outlet sqrt(h)."""
    return fsw.NonlinearPlant(
        lambda t, x, u, w: [(u[0] - OUTLET * np.sqrt(max(x[0], 0.0))) / AREA], lambda x: x[0], **options
    )


def test_a_tank_runs_empty_as_torricelli_says():
    law = Relay(fsw.Plant([[0.0]], [[1.0]]), [0.0, 0.2], 0.5)
    run = fsw.simulate(law, -1.0, 9.0, plant=tank(), x0=[1.0])
    assert run.x[:, 0] == pytest.approx((1.0 - OUTLET * run.t / (2.0 * AREA)) ** 2, rel=1e-8)


def test_a_tank_is_held_at_its_level_by_a_law_made_for_its_slope_there():
    """Linear at 1 m: A h' = u - 0.1 - 0.05 (h - 1)."""
    model = fsw.Plant([[-0.05 / AREA]], [[1.0 / AREA]], input_delay=1.7, u_offset=0.1, y_offset=1.0)
    controller = fsw.Controller(model, [0.0, 0.2], 0.5, fsw.Endpoint(2.0, 1.0))
    truth = tank(input_delay=1.7)
    wanted = fsw.Steps([0.0, 150.0], [1.0, 1.5])
    # the law measures the deviation from its operating point
    shifted = fsw.NonlinearPlant(
        lambda t, x, u, w: truth.f(t, x + 1.0, u, w), lambda x: x[0] + 1.0, input_delay=1.7, output_names="h [m]"
    )
    run = fsw.simulate(controller, wanted, 300.0, plant=shifted, x0=[0.0], hardware=fsw.Hardware(opening=0.2))
    error = run.y[:, 0] - run.r[:, 0]
    assert np.abs(error[(run.t > 30.0) & (run.t < 150.0)]).max() < 0.25
    assert np.abs(error[run.t > 250.0]).max() < 0.3
    assert set(np.unique(run.u)) == {0.0, 0.2}
    assert list(run.columns())[:3] == ["t [s]", "reference h [m]", "h [m]"]


def test_a_chamber_behind_a_valve_whose_flow_chokes():
    """Pressure in a chamber fed from 8 bar, vented to 1 bar; beyond the critical ratio the flow does not grow."""
    critical = 0.528

    def flow(up, down):
        ratio = down / up
        share = 1.0 if ratio < critical else np.sqrt(max(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2, 0.0))
        return up * share

    def f(t, x, u, w):
        p = x[0]
        return [u[0] * 3.0 * flow(8.0, max(p, 1.0)) if u[0] > 0 else u[0] * 3.0 * flow(max(p, 1.0 + 1e-9), 1.0)]

    chamber = fsw.NonlinearPlant(f, lambda x: x, input_delay=0.0043, output_names="p [bar]")
    model = fsw.Plant([[0.0]], [[18.0]], input_delay=0.0043)
    controller = fsw.Controller(model, [-1.0, 0.0, 1.0], 1e-3, fsw.Endpoint(0.004, 200.0), switch_cost=1e-4)
    wanted = fsw.Sine(1.0, 1.0, offset=4.0)
    run = fsw.simulate(controller, wanted, 1.0, plant=chamber, x0=[4.0], noise=0.01, seed=1)
    figures = run.metrics()
    assert figures["rms_error_at_lag"] < 0.15  # bar; one pulse moves 0.024
    assert figures["switches"] > 20
    assert {-1.0, 0.0, 1.0} == set(np.unique(run.u))


# What a function may do wrong -----------------------------------------------------------------------------------------


class Broken(Exception):
    pass


@pytest.mark.parametrize("where", ["f", "h", "first h"])
def test_an_exception_reaches_the_caller_as_it_is(where):
    calls = []

    def f(t, x, u, w):
        if where == "f" and t > 0.01:
            raise Broken("valve stem", t)
        return [x[1], -x[1]]

    def h(x):
        calls.append(1)
        if where == "first h" or (where == "h" and len(calls) > 10):
            raise Broken("valve stem", 0.0)
        return x[0]

    with pytest.raises(Broken, match="valve stem") as caught:
        fsw.simulate(valve_controller(), RISE, 0.05, plant=fsw.NonlinearPlant(f, h, states=2))
    assert caught.value.args[0] == "valve stem"
    assert caught.traceback[-1].name == ("f" if where == "f" else "h")
    assert fsw.simulate(valve_controller(), RISE, 0.05).x[-1, 0] > 0.0  # the core is none the worse


def test_a_keyboard_interrupt_ends_the_run():
    def f(t, x, u, w):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fsw.simulate(valve_controller(), RISE, 0.05, plant=fsw.NonlinearPlant(f, lambda x: x[0], states=2))


@pytest.mark.parametrize(
    ("f", "h", "message"),
    [
        (lambda t, x, u, w: [0.0], lambda x: x[0], r"f returned \[0.0\] at t = 0 s; give 2"),
        (lambda t, x, u, w: [0.0, 0.0, 0.0], lambda x: x[0], "f returned"),
        (lambda t, x, u, w: [np.nan, 0.0], lambda x: x[0], r"f returned \[nan, 0.0\] at t = 0 s; give finite"),
        (lambda t, x, u, w: [1.0, 0.0], lambda x: np.nan if x[0] > 0.01 else x[0], "h returned"),
        (lambda t, x, u, w: [1.0, 0.0], lambda x: x, "h returned .*; give 1"),
        (lambda t, x, u, w: [0.0, 1e8 * (1.0 + x[1] ** 2)], lambda x: x[0], "f could not be integrated at t = "),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_a_function_may_not_return(f, h, message):
    with pytest.raises(ValueError, match=message):
        fsw.simulate(valve_controller(), RISE, 0.05, plant=fsw.NonlinearPlant(f, h, states=2))


def test_a_solver_that_tries_too_far_comes_back():
    """A slope that is not a number beyond the edge of its domain, which the state never leaves."""
    truth = fsw.NonlinearPlant(lambda t, x, u, w: [-200.0 * x[0] if x[0] >= 0.0 else np.nan], lambda x: x)
    law = Relay(fsw.Plant([[0.0]], [[1.0]]), [0.0, 1.0], 1.0)
    with np.errstate(all="ignore"):
        run = fsw.simulate(law, -1.0, 1.0, plant=truth, x0=[1.0])
    assert run.x[-1, 0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ({"states": 0}, "states is 0"),
        ({"inputs": 1.5}, "inputs is 1.5"),
        ({"outputs": True}, "outputs is True"),
        ({"disturbances": -1}, "disturbances is -1"),
        ({"input_delay": -1.0}, "input_delay"),
        ({"input_delay": [0.1, 0.2]}, "input_delay"),
        ({"output_names": ["a", "b"]}, "output_names"),
    ],
)
def test_sizes_that_cannot_be(sizes, message):
    with pytest.raises(ValueError, match=message):
        fsw.NonlinearPlant(lambda t, x, u, w: x, lambda x: x, **sizes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": fsw.NonlinearPlant(lambda t, x, u, w: x, lambda x: x, inputs=2)}, "and they must agree"),
        ({"plant": fsw.NonlinearPlant(lambda t, x, u, w: x, lambda x: x[0], states=3)}, "give sensor"),
        ({"plant": fsw.NonlinearPlant(lambda t, x, u, w: x, lambda x: x[0], states=200), "sensor": np.eye(2, 200)},
         "out of range"),
        ({"plant": as_function(VALVE), "hardware": fsw.Hardware(process_noise=1.0)}, "put it into f"),
        ({"plant": as_function(VALVE), "hardware": fsw.Hardware(drift=VALVE)}, "put it into f"),
        ({"plant": "valve"}, "give a Plant"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_controller(options, message):
    with pytest.raises(ValueError, match=message):
        fsw.simulate(valve_controller(), RISE, 0.05, **options)


# FMU ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fmpy():
    return pytest.importorskip("fmpy", reason="needs fmpy: pip install 'foreswitch[fmu]'")


def packed(target, description, library, platform="linux64"):
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        suffix = {"win64": "dll", "darwin64": "dylib"}.get(platform, "so")
        archive.write(library, f"binaries/{platform}/valve.{suffix}")
    return target


@pytest.fixture(scope="module")
def library(fmpy, tmp_path_factory):
    target = tmp_path_factory.mktemp("fmu") / "valve.so"
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    headers = Path(fmpy.__file__).parent / "c-code"
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-O1", "-I", headers, "-o", target, FMU / "valve.c", "-lm"], check=True
    )
    return target


@pytest.fixture(scope="module")
def description():
    return (FMU / "modelDescription.xml").read_text()


@pytest.fixture(scope="module")
def valve(fmpy, library, description, tmp_path_factory):
    folder = tmp_path_factory.mktemp("packed")
    return packed(folder / "valve.fmu", description, library, fmpy.platform)


NAMES = {"inputs": ["u"], "outputs": ["p"], "states": ["p", "v"]}


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"x0": [20.0, 300.0], "noise": [5.0, 50.0]},
        {"disturbance": 900.0 + 500.0 * np.sin(np.arange(250.0))},
        {"load": 0.02, "disturbance": lambda t, x: 5.0 * x[0]},
        {"hardware": fsw.Hardware(opening=0.0033, closing=0.0012, stuck=[fsw.Stuck(1.0, 0.20, 0.21)], missing=0.1)},
    ],
)
def test_an_fmu_of_a_linear_plant_is_the_linear_plant(valve, options):
    vented = VALVE.replace(E=[[-1.0], [0.0]])
    law = valve_controller(vented)
    truth = fsw.FmuPlant(valve, **NAMES, disturbances=["vent"], input_delay=0.005)
    expected = fsw.simulate(law, RISE, 0.25, seed=3, **options)
    for _ in range(2):  # each run starts anew
        run = fsw.simulate(law, RISE, 0.25, seed=3, plant=truth, **options)
        assert len(np.unique(run.u)) == 2
        assert np.array_equal(run.u, expected.u)
        assert run.x == pytest.approx(expected.x, rel=0, abs=1e-9 * np.abs(expected.x).max())
        assert np.array_equal(run.y[:, 0], run.x[:, 0])
    assert list(run.columns())[1:4] == ["reference p", "p", "u"]


def test_parameters_of_an_fmu_are_set_before_it_starts(valve):
    truth = fsw.FmuPlant(valve, **NAMES, input_delay=0.005, start_values={"k": 12000.0, "c": 0.008, "p": 50.0})
    run = fsw.simulate(valve_controller(), RISE, 0.1, plant=truth)
    model = fsw.Plant.integrator_lag(k=12000.0, c=0.008, L=0.005)
    expected = fsw.simulate(valve_controller(), RISE, 0.1, plant=model, x0=[50.0, 0.0])
    assert np.array_equal(run.u, expected.u)
    assert run.x == pytest.approx(expected.x, rel=1e-9, abs=1e-9)
    elsewhere = fsw.simulate(valve_controller(), RISE, 0.1, plant=truth, x0=[80.0, 1.0])
    assert elsewhere.x[0].tolist() == [80.0, 1.0]


def test_a_batch_of_an_fmu_is_its_single_runs(valve):
    truth = fsw.FmuPlant(valve, **NAMES, input_delay=0.005)
    batch = fsw.simulate_batch(valve_controller(), RISE, 0.03, seeds=5, noise=20.0, plant=truth)
    for seed in range(5):
        run = fsw.simulate(valve_controller(), RISE, 0.03, seed=seed, noise=20.0, plant=truth)
        assert batch.max_error[seed] == np.abs(run.y - run.r).max()


def test_an_error_of_the_fmu_reaches_the_caller(valve):
    truth = fsw.FmuPlant(valve, **NAMES, input_delay=0.005, start_values={"burst": 10.0})
    with pytest.raises(Exception, match="fmi2DoStep"):
        fsw.simulate(valve_controller(), RISE, 0.2, plant=truth)
    truth.close()
    truth.close()


def test_what_was_unpacked_is_removed(valve, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    truth = fsw.FmuPlant(valve, **NAMES, input_delay=0.005)
    for _ in range(3):
        run = fsw.simulate(valve_controller(), RISE, 0.02, plant=truth)
        assert len(list(tmp_path.iterdir())) == 1
    truth.close()
    assert not list(tmp_path.iterdir())
    fsw.simulate(valve_controller(), RISE, 0.02, plant=truth)
    del truth, run
    gc.collect()
    assert not list(tmp_path.iterdir())


def test_an_instance_lives_from_one_run_to_the_next(fmpy, valve, monkeypatch):
    calls = []
    for name in ("instantiate", "exitInitializationMode", "terminate", "freeInstance"):
        method = getattr(fmpy.fmi2.FMU2Slave, name)

        def spy(self, *arguments, name=name, method=method, **options):
            calls.append(name)
            return method(self, *arguments, **options)

        monkeypatch.setattr(fmpy.fmi2.FMU2Slave, name, spy)
    life = ["instantiate", "exitInitializationMode", "terminate", "freeInstance"]
    truth = fsw.FmuPlant(valve, **NAMES)
    fsw.simulate(valve_controller(), RISE, 0.01, plant=truth)
    assert calls == life[:2]
    fsw.simulate(valve_controller(), RISE, 0.01, plant=truth)
    assert calls == life + life[:2]
    truth.close()
    assert calls == 2 * life


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"inputs": ["pump"]}, "has no real variable 'pump'; it has burst, c, k, p, u, v, vent"),
        ({"outputs": ["q"]}, "no real variable 'q'"),
        ({"states": ["p", "w"]}, "no real variable 'w'"),
        ({"disturbances": ["leak"]}, "no real variable 'leak'"),
        ({"start_values": {"K": 1.0}}, "no real variable 'K'"),
        ({"start_values": {"serial": 2.0}}, "no real variable 'serial'"),
        ({"inputs": []}, "inputs is 0"),
        ({"input_delay": -1.0}, "input_delay"),
    ],
)
def test_a_variable_that_is_not_there(valve, names, message):
    with pytest.raises(ValueError, match=message):
        fsw.FmuPlant(valve, **NAMES | names)


def test_files_that_are_no_such_fmu(fmpy, tmp_path, library, description):
    other = "win64" if fmpy.platform == "linux64" else "linux64"
    (tmp_path / "text.fmu").write_text("not a zip file")
    packed(tmp_path / "empty.fmu", "<nothing/>", library)
    packed(tmp_path / "one.fmu", description.replace('fmiVersion="2.0"', 'fmiVersion="1.0"'), library)
    packed(tmp_path / "later.fmu", description.replace('fmiVersion="2.0"', 'fmiVersion="4.0"'), library)
    exchange = '<ModelExchange modelIdentifier="valve"/>'
    start, end = description.index("<CoSimulation"), description.index("<ModelVariables")
    packed(tmp_path / "exchange.fmu", description[:start] + exchange + description[end:], library)
    three = (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="3.0" modelName="valve" instantiationToken="x">'
        '<CoSimulation modelIdentifier="valve"/><ModelVariables><Float64 name="time" valueReference="0" '
        'causality="independent" variability="continuous"/></ModelVariables><ModelStructure/></fmiModelDescription>'
    )
    packed(tmp_path / "three.fmu", three, library)
    packed(tmp_path / "elsewhere.fmu", description, library, other)
    for name, message in (
        ("missing", "is not an FMU"),
        ("text", "is not an FMU"),
        ("empty", "is not an FMU"),
        ("one", "is not an FMU|by FMI 2.0"),
        ("later", "is not an FMU|by FMI 2.0"),
        ("exchange", "offers no co-simulation by FMI 2.0"),
        ("three", "offers no co-simulation by FMI 2.0"),
        ("elsewhere", f"runs on {other}; export it for {fmpy.platform}"),
    ):
        with pytest.raises(ValueError, match=message):
            fsw.FmuPlant(tmp_path / f"{name}.fmu", **NAMES)


def test_an_fmu_that_will_not_start_leaves_nothing_behind(fmpy, tmp_path, library, description, monkeypatch):
    stranger = description.replace('guid="foreswitch-test-valve"', 'guid="another"')
    path = packed(tmp_path / "stranger.fmu", stranger, library, fmpy.platform)
    (tmp_path / "unpacked").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "unpacked"))
    with pytest.raises(Exception, match="instantiate"):
        fsw.simulate(valve_controller(), RISE, 0.02, plant=fsw.FmuPlant(path, **NAMES))
    assert not list((tmp_path / "unpacked").iterdir())
