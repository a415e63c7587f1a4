"""Project files: what they say is what runs, and each mistake is one sentence."""

import copy
import re
import tomllib
from dataclasses import fields

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch._helpers.mistake import Mistake
from foreswitch.project.project import Project
from foreswitch.project.tables import (
    CONTROLLER_KEYS,
    SIMULATION_KEYS,
    TABLES,
    ControllerTable,
    EstimatorTable,
    HardwareTable,
)
from places import EXAMPLES

HOT_GAS = EXAMPLES / "hot_gas/project.toml"


@pytest.fixture
def content() -> dict:
    return tomllib.loads(HOT_GAS.read_text(encoding="utf-8"))


def changed(content: dict, path: str, value: object) -> dict:
    """A copy with the key at ``table.key`` set, or removed where the value is None."""
    result = copy.deepcopy(content)
    *tables, key = path.split(".")
    table = result
    for name in tables:
        table = table.setdefault(name, {})
    if value is None:
        del table[key]
    else:
        table[key] = value
    return result


def test_the_file_builds_what_the_constructors_build(content):
    project = Project(content)
    plant = fsw.Plant.integrator_lag(16500.0, 0.006, 0.005, E=[[-1.0], [0.0]])
    controller = fsw.Controller(plant, [0, 1], 1e-3, fsw.Endpoint(0.020, 2500.0))
    expected = fsw.simulate(controller, fsw.HalfSine(1000.0, 0.5), 0.6)
    np.testing.assert_array_equal(project.simulate().u, expected.u)
    assert project.plant.output_names == ("pressure [kPa]",)


def test_every_optional_key_in_the_commented_file_is_accepted():
    """Uncommenting a hint must never be an error; keys that belong to a choice come in their block of lines."""
    text = HOT_GAS.read_text(encoding="utf-8")
    for line in text.splitlines():
        stripped = line.lstrip("# ").split("#")[0].strip()
        if not line.startswith("# ") or "=" not in stripped or not stripped.split("=")[0].strip().isidentifier():
            continue
        key = stripped.split("=")[0].strip()
        # another kind of reference or objective; several inputs
        if key in ("kind", "file", "time", "value", "forbidden", "objective", "steps"):
            continue
        Project(tomllib.loads(text.replace(line, stripped)))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("plant.kk", 3, "[plant] has an unknown key 'kk'; did you mean 'k'?"),
        ("controler", {}, "unknown table 'controler'; did you mean 'controller'?"),
        ("controller.Td", None, "[controller] has no key 'Td'"),
        ("controller.Td", "x", "controller.Td is 'x'; it holds: endpoint: settling horizon"),
        ("controller.Td", 1e-4, "Td is 0.0001; it must be at least one switching period"),
        ("controller.preview", "lagg", "controller.preview is 'lagg'"),
        ("actuator.levels", "a", "actuator.levels is 'a'"),
        ("actuator.levels", [1, 0], "they must ascend"),
        ("actuator.levels", [1], "give 2 to 255 levels"),
        ("actuator.Ts", 0.0, "Ts is 0.0; it must be greater than 0"),
        ("plant", None, "table [plant] is missing"),
        ("plant.model", "fobdt", "plant.model is 'fobdt'; give 'integrator_lag'"),
        ("plant.k", float("nan"), "plant.k is nan"),
        ("plant.input_delay", -1.0, "input_delay is -1.0; it must be at least 0"),
        ("plant.A", [[1.0]], "[plant] has key 'A', which model = 'integrator_lag' does not use"),
        ("reference.kind", "sinus", "reference.kind is 'sinus'; give 'constant'"),
        ("reference.frequency", 2.0, "which kind = 'half_sine' does not use; remove it"),
        ("reference.height", None, "[reference] has no key 'height', which kind = 'half_sine' needs"),
        ("reference", [{"kind": "constant", "value": 1.0}] * 2, "[reference] stands 2 time(s)"),
        ("reference", {"kind": "constant", "value": "a"}, "value is 'a'; give a number"),
        ("reference", {"kind": "samples", "file": "none.csv"}, "none.csv cannot be read"),
        ("simulation.disturbance", {"gian": 1.0, "high": 3.0}, "unknown key 'gian'; did you mean 'gain'?"),
        ("simulation.disturbance", "a", "simulation.disturbance is 'a'; it holds: measured w"),
        ("simulation.disturbance", [{"kind": "sine", "frequenzy": 3.0}], "did you mean 'frequency'?"),
        ("simulation.disturbance", [{"kind": "sin"}], "simulation.disturbance.0.kind is 'sin'; give 'constant'"),
        ("simulation.disturbance", [{"kind": "sine"}], "[simulation.disturbance.0] has no key 'amplitude'"),
        ("simulation.disturbance", [{"kind": "constant", "value": "a"}], "[simulation.disturbance.0] value is 'a'"),
        ("simulation.disturbance", [{"kind": "constant", "value": 1.0}] * 2, "[simulation.disturbance] stands 2 time"),
        ("reference", [{"kind": "ramp", "slope": 1.0}, {"kind": "ramp", "slope": "b"}], "reference.1.slope is 'b'"),
        ("simulation.plant", {"model": "fopdt", "K": 1.0}, "[simulation.plant] has no key 'T'"),
        ("simulation.hardware", 3, "simulation.hardware is 3; it holds: what real actuators and sensors add"),
        (
            "simulation.hardware",
            {"openning": 1},
            "[simulation.hardware] has an unknown key 'openning'; did you mean 'op",
        ),
        ("simulation.hardware", {"missing": "a"}, "simulation.hardware.missing is 'a'; it holds: share of samples"),
        ("simulation.hardware", {"missing": 1.5}, "missing is 1.5; it must lie between 0 and 1"),
        ("simulation.hardware", {"opening": -1.0}, "opening is -1.0; it must be at least 0"),
        ("simulation.hardware", {"low": 5.0, "high": 1.0}, "low is 5.0 and high 1.0; low must be smaller"),
        ("simulation.hardware", {"outages": [[2.0, 1.0]]}, "outages holds (2.0, 1.0); give (start, end) pairs"),
        ("simulation.hardware", {"outages": [1.0, 2.0]}, "simulation.hardware.outages is [1.0, 2.0]; it holds: times"),
        ("simulation.hardware", {"stuck": 1.0}, "simulation.hardware.stuck is 1.0; it holds: actuators that stay"),
        ("simulation.hardware", {"stuck": [{"start": 1.0}]}, "[simulation.hardware.stuck.0] has no key 'level'"),
        ("simulation.hardware", {"stuck": [{"inptu": 1}]}, "unknown key 'inptu'; did you mean 'input'?"),
        (
            "simulation.hardware",
            {"stuck": [{"level": "x"}]},
            "stuck.0.level is 'x'; it holds: where the actuator stays",
        ),
        ("simulation.hardware", {"stuck": [{"level": 1.0, "input": -1}]}, "input is -1; give 0 for the first"),
        ("simulation.hardware", {"stuck": [{"level": 1.0, "start": 2.0, "end": 1.0}]}, "end is 1.0; it must be later"),
        ("simulation.hardware", {"drift": {"model": "fopdt", "K": 1.0}}, "[simulation.hardware.drift] has no key 'T'"),
        ("simulation.hardware", {"drift": {"kk": 1.0}}, "[simulation.hardware.drift] has an unknown key 'kk'; did you"),
    ],
)
def test_a_mistake_is_one_sentence_that_names_it(content, path, value, words):
    with pytest.raises(ValueError, match=r".") as caught:
        Project(changed(content, path, value))
    sentence = str(caught.value)
    assert words in sentence
    assert "\n" not in sentence
    assert caught.value.key.startswith(path if isinstance(value, dict) else path.rpartition(".")[0])
    assert caught.value.remedy


def key_of(act):
    with pytest.raises(Mistake) as caught:
        act()
    return caught.value.key


def test_what_the_file_says_bears_its_key_and_what_the_caller_says_does_not(content):
    """Mistakes of the design, the run, the certificate and the laws of today."""
    short = Project(changed(content, "simulation.x0", [1.0]))
    assert key_of(short.simulate) == "simulation.x0"
    assert key_of(lambda: short.simulate(x0=[1.0])) is None
    assert key_of(short.certify) == "simulation.x0"
    assert key_of(lambda: short.certify(noise=-1.0, x0=None)) is None
    assert key_of(lambda: short.tune(fsw.baselines.Relay, budget=2)) == "simulation.x0"
    noisy = Project(changed(content, "simulation.hardware", {"quantum": [1.0, 2.0, 3.0]}))
    assert key_of(noisy.simulate) == "simulation.hardware.quantum"
    assert key_of(lambda: noisy.simulate(hardware=fsw.Hardware(quantum=[1.0, 2.0, 3.0]))) is None
    fine = Project(content)
    assert key_of(lambda: fine.build_controller(Ts=0.0)) is None
    assert key_of(lambda: fine.build_controller(Td=1e-9)) is None
    assert key_of(lambda: fine.build_controller(objective=fsw.Endpoint(1e-9, 1.0))) is None
    assert key_of(lambda: fine.build_controller(plant=fsw.Plant.fopdt(1.0, 1.0, 1e4))) is None
    assert key_of(lambda: fine.build_controller(Ts=1.0)) == "controller.Td"  # it is the file's that does not fit
    assert key_of(lambda: fine.build_baseline(fsw.baselines.Relay, hysteresis=-1.0)) is None
    assert key_of(lambda: Project(changed(content, "actuator.min_on", 1e9))) == "actuator.min_on"


def test_every_argument_of_a_table_has_one_key():
    """No argument of one call may stand for two keys of the tables that it takes them from."""
    of_a_controller = [TABLES[name].keys_at(name) for name in ("plant", "actuator", "controller", "estimator")]
    assert sum(map(len, of_a_controller)) + 4 == len(CONTROLLER_KEYS)  # and the tables themselves
    of_a_run = [TABLES[name].keys_at(name) for name in ("simulation", "simulation.hardware")]
    assert sum(map(len, of_a_run)) + 1 == len(SIMULATION_KEYS)
    for key in {*CONTROLLER_KEYS.values(), *SIMULATION_KEYS.values()}:
        table, _, name = key.rpartition(".")
        assert key in TABLES or name in TABLES[table].model_fields


def test_the_truth_may_differ_from_the_model(content):
    truth = {"model": "integrator_lag", "k": 20000.0, "c": 0.006, "input_delay": 0.005, "E": [[-1.0], [0.0]]}
    project = Project(changed(content, "simulation.plant", truth))
    same = Project(content)
    assert project.simulate().y[-1, 0] != same.simulate().y[-1, 0]
    assert project.controller.plant.B[1, 0] == same.controller.plant.B[1, 0]


def test_a_plant_with_several_inputs_and_outputs(content):
    A, B, C, E = [[-1.0, 0.0], [1.0, -2.0]], [[1.0, 0.0], [0.0, 3.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [-1.0]]
    delay, offset = [0.01, 0.025], [1.0, -2.0]
    plant = {"model": "state_space", "A": A, "B": B, "C": C, "E": E, "input_delay": delay, "y_offset": offset}
    project = changed(content, "plant", plant)
    project = changed(project, "actuator", {"levels": [[0, 1], [-1, 0, 1]], "Ts": 0.01, "forbidden": [[1, 1]]})
    project = changed(project, "controller", {"Td": 0.02, "lam": 1.0})
    project = Project(changed(project, "reference", [{"kind": "constant", "value": v} for v in (1.5, -1.0)]))
    expected = fsw.Plant(A, B, C, E=E, input_delay=delay, y_offset=offset)
    law = fsw.Controller(expected, [[0, 1], [-1, 0, 1]], 0.01, fsw.Endpoint(0.02, 1.0), forbidden=[[1, 1]])
    np.testing.assert_array_equal(project.simulate().y, fsw.simulate(law, [1.5, -1.0], 0.6).y)


def test_a_vent_opens_with_the_excess_pressure(content):
    valve = {"gain": 100.0, "high": 500.0, "deadband": 2.0}
    project = Project(changed(content, "simulation.disturbance", valve))
    flow = project.file.simulation.disturbance.law(lambda t: np.zeros(t.size), project.plant)
    assert flow(0.0, np.array([1.0, 0.0])) == 0.0
    assert flow(0.0, np.array([5.0, 0.0])) == pytest.approx(300.0)
    assert flow(0.0, np.array([50.0, 0.0])) == 500.0
    assert project.simulate().y[-1, 0] < Project(content).simulate().y[-1, 0]


def test_a_disturbance_may_run_a_course_of_its_own(content):
    course = [{"kind": "sine", "amplitude": 500.0, "frequency": 7.0, "offset": 600.0}]
    project = Project(changed(content, "simulation.disturbance", course))
    sine = fsw.Sine(500.0, 7.0, offset=600.0)
    expected = fsw.simulate(
        project.controller, project.reference, 0.6, disturbance=lambda t, x: sine(np.array([t]), 1)[0, :, 0]
    )
    np.testing.assert_array_equal(project.simulate().y, expected.y)
    # another switching period, another duration, and w as it is given
    law = project.build_controller(Ts=0.002)
    assert project.simulate(law, duration=0.3).y.shape == (151, 1)
    np.testing.assert_array_equal(project.simulate(disturbance=0.0).y, Project(content).simulate().y)


def test_settings_can_be_changed_by_name(content):
    project = Project(content)
    assert project.build_controller(preview="lag").reference_times[0] == pytest.approx(0.01136, abs=1e-5)
    with pytest.raises(ValueError, match="did you mean 'tail'"):
        project.build_controller(tial="zero")


def test_a_reference_file_is_found_beside_the_project(content, tmp_path):
    (tmp_path / "r.csv").write_text("t,p\n0,0\n0.5,100\n")
    project = Project(
        changed(content, "reference", {"kind": "samples", "file": "r.csv", "between": "linear"}), tmp_path
    )
    np.testing.assert_allclose(project.reference([0.25], 2)[0, 0], [50.0, 200.0])


# [simulation.hardware] ------------------------------------------------------------------------------------------------

DRIFTED = {"model": "integrator_lag", "k": 9000.0, "c": 0.006, "input_delay": 0.005, "E": [[-1.0], [0.0]]}

# Every key, and what the constructor makes of the same.
HARDWARE = {
    "opening": (0.0023, fsw.Hardware(opening=0.0023)),
    "closing": (0.0031, fsw.Hardware(closing=0.0031)),
    "quantum": ([7.0, 0.0], fsw.Hardware(quantum=[7.0, 0.0])),
    "low": ([300.0, -1e6], fsw.Hardware(low=[300.0, -1e6])),
    "high": (700.0, fsw.Hardware(high=700.0)),
    "process_noise": ([20.0, 0.0], fsw.Hardware(process_noise=[20.0, 0.0])),
    "missing": (0.4, fsw.Hardware(missing=0.4)),
    "late": (0.004, fsw.Hardware(late=0.004)),
    "outages": ([[0.1, 0.15], [0.3, 0.34]], fsw.Hardware(outages=[(0.1, 0.15), (0.3, 0.34)])),
    "stuck": (
        [{"level": 0.5, "start": 0.2, "end": 0.3}, {"level": 1.0, "start": 0.5}],
        fsw.Hardware(stuck=[fsw.Stuck(0.5, 0.2, 0.3), fsw.Stuck(1.0, 0.5)]),
    ),
    "drift": (DRIFTED, fsw.Hardware(drift=fsw.Plant.integrator_lag(9000.0, 0.006, 0.005, E=[[-1.0], [0.0]]))),
}


def test_every_key_of_the_hardware_has_its_case():
    assert set(HARDWARE) == set(HardwareTable.model_fields)


@pytest.mark.parametrize("key", HARDWARE)
def test_a_key_of_the_hardware_does_what_the_constructor_does(content, key):
    """Under a load that the model does not know: else it would bridge lost samples without a trace."""
    value, hardware = HARDWARE[key]
    content = changed(changed(content, "simulation.seed", 3), "simulation.load", 0.05)
    plain = Project(content)
    run = Project(changed(content, "simulation.hardware", {key: value})).simulate()
    expected = fsw.simulate(plain.controller, plain.reference, 0.6, load=0.05, seed=3, hardware=hardware)
    np.testing.assert_array_equal(run.x, expected.x)
    assert not np.array_equal(run.x, plain.simulate().x)


def test_a_fault_of_an_input_that_is_not_there_is_named_when_it_runs(content):
    project = Project(changed(content, "simulation.hardware", {"stuck": [{"level": 1.0, "input": 1}]}))
    with pytest.raises(ValueError, match="stuck names input 1; give 0 to 0"):
        project.simulate()


# Horizons -------------------------------------------------------------------------------------------------------------

HORIZON = {
    "steps": 12, "lam": 2500.0, "move_weight": 5.0, "window": [2, 9], "moves": 7, "tail": "rest", "terminal": "riccati",
    "node_budget": 300, "weight": 2.0, "relative_degree": 2,
}  # fmt: skip


def of_horizon(content, **keys):
    return changed(content, "controller", {"objective": "horizon", "preview": True} | keys)


def test_every_key_of_a_horizon_reaches_it(content):
    needed, optional = ControllerTable.USES["horizon"]
    assert {*needed, *optional} == set(HORIZON) == {field.name for field in fields(fsw.Horizon)}
    project = Project(of_horizon(content, **HORIZON))
    expected = fsw.Horizon(**HORIZON)
    assert project.controller.objective == expected
    law = fsw.Controller(project.plant, [0, 1], 1e-3, expected, preview=True)
    np.testing.assert_array_equal(project.simulate().u, fsw.simulate(law, project.reference, 0.6).u)
    assert Project(of_horizon(content, steps=3)).controller.objective == fsw.Horizon(3)
    matrix = [[2.0, 0.0], [0.0, 1e-6]]
    assert Project(of_horizon(content, steps=3, terminal=matrix)).controller.objective.terminal == matrix
    assert project.build_controller(steps=4, window=None, moves=None).evaluations == 4


def test_an_endpoint_is_what_a_file_without_objective_means(content):
    given = Project(changed(content, "controller.objective", "endpoint"))
    assert given.controller.objective == Project(content).controller.objective == fsw.Endpoint(0.020, 2500.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "[controller] has no key 'steps', which objective = 'horizon' needs; add it"),
        (
            {"steps": 5, "Td": 0.02},
            "[controller] has key 'Td', which objective = 'horizon' does not use; remove it, or ",
        ),
        ({"steps": 0}, "steps is 0; give a whole number from 1 to 64"),
        ({"steps": 65}, "steps is 65; give a whole number from 1 to 64"),
        ({"steps": 5.5}, "controller.steps is 5.5; it holds: horizon: periods"),
        ({"steps": 5, "window": [3, 2]}, "window is 2; give a whole number from 3 to 5"),
        ({"steps": 5, "window": 3}, "controller.window is 3; it holds: horizon: first and last"),
        ({"steps": 5, "moves": 6}, "moves is 6; give a whole number from 1 to 5"),
        ({"steps": 5, "move_weight": -1.0}, "move_weight is -1.0; it must be at least 0"),
        ({"steps": 5, "tail": "held"}, "controller.tail is 'held'; give 'rest', 'zero' or 'hold'"),
        ({"steps": 5, "terminal": "ricatti"}, "controller.terminal is 'ricatti'; give"),
        ({"steps": 5, "node_budget": 0}, "node_budget is 0; give a whole number"),
        ({"steps": 5, "nodebudget": 3}, "[controller] has an unknown key 'nodebudget'; did you mean 'node_budget'?"),
        ({"steps": 5, "preview": "lag"}, "preview is 'lag'; a Horizon takes False, True or seconds"),
        ({"objective": "horizn", "steps": 5}, "controller.objective is 'horizn'; give 'endpoint' or 'horizon'"),
        ({"objective": "endpoint", "Td": 0.02, "lam": 1.0, "tail": "hold"}, "tail is 'hold'; known are rest, zero"),
        (
            {"objective": "endpoint", "Td": 0.02, "lam": 1.0, "steps": 5},
            "[controller] has key 'steps', which objective = 'endpoint' does not use; remove it, or give objective = "
            "'horizon'",
        ),
    ],
)
def test_a_mistake_in_a_horizon_is_one_sentence(content, keys, words):
    with pytest.raises(ValueError, match=r".") as caught:
        Project(of_horizon(content, **keys))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_steps_without_objective_say_what_is_missing(content):
    table = {"steps": 20, "preview": True}
    with pytest.raises(ValueError, match="'steps', which objective = 'endpoint' does not use; remove it, or give obj"):
        Project(changed(content, "controller", table))


def test_an_objective_may_be_given_in_place_of_the_files(content):
    project = Project(content)
    law = project.build_controller(objective=fsw.Horizon(3), preview=True, min_on=0.002)
    assert (law.evaluations, law.objective) == (3, fsw.Horizon(3))
    with pytest.raises(ValueError, match="objective is 'horizon'; give an Endpoint or a Horizon"):
        project.build_controller(objective="horizon")
    with pytest.raises(ValueError, match="'lam' is given beside an objective; put it into that"):
        project.build_controller(objective=fsw.Horizon(3), lam=3.0)


def test_a_horizon_estimates_its_state_from_outputs(content):
    content = changed(of_horizon(content, steps=8), "estimator", ESTIMATOR)
    run = Project(changed(changed(content, "simulation.seed", 1), "simulation.noise", 2.0)).simulate()
    assert run.x_hat is not None
    assert run.metrics()["rms_error"] < 6.0


# [estimator] ----------------------------------------------------------------------------------------------------------

ESTIMATOR = {"process_noise": [0.0, 1e4], "measurement_noise": 4.0, "load": 1e-6, "gate": 4.0, "gate_limit": 2}


def test_every_key_of_the_estimator_reaches_it(content):
    assert set(ESTIMATOR) == set(EstimatorTable.model_fields)
    content = changed(changed(content, "simulation.seed", 3), "simulation.noise", 2.0)
    project = Project(changed(content, "estimator", ESTIMATOR))
    assert project.controller.estimator == fsw.Kalman(**ESTIMATOR)
    law = project.controller.replace(estimator=fsw.Kalman(**ESTIMATOR))
    run, expected = project.simulate(), fsw.simulate(law, project.reference, 0.6, noise=2.0, seed=3)
    np.testing.assert_array_equal(run.x_hat, expected.x_hat)
    needed = {name: ESTIMATOR[name] for name in ("process_noise", "measurement_noise")}
    assert Project(changed(content, "estimator", needed)).controller.estimator == fsw.Kalman(**needed)
    assert project.build_controller(estimator=None).kalman is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (ESTIMATOR | {"gat": 3.0}, "[estimator] has an unknown key 'gat'; did you mean 'gate'?"),
        ({"process_noise": 1.0}, "[estimator] has no key 'measurement_noise'; add it"),
        (ESTIMATOR | {"load": "small"}, "estimator.load is 'small'; it holds: variance"),
        (ESTIMATOR | {"load": -1.0}, "load is -1.0; variances must be at least 0"),
    ],
)
def test_a_mistake_in_the_estimator_is_one_sentence(content, table, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        Project(changed(content, "estimator", table))


def test_baselines_do_not_estimate(content):
    project = Project(changed(content, "estimator", ESTIMATOR))
    with pytest.raises(ValueError, match="baselines measure the whole state"):
        project.build_baseline(fsw.baselines.Relay)
    with pytest.raises(ValueError, match="baselines measure the whole state"):
        project.tune(fsw.baselines.Relay, budget=2)


def test_a_certificate_of_a_project_is_that_of_its_parts(content):
    content = changed(content, "simulation", content["simulation"] | {"noise": [0.5, 10.0], "load": 1e-3})
    project = Project(content)
    proof = project.certify(delay_error=1e-4)
    same = fsw.certify(
        project.controller, reference=project.reference, duration=content["simulation"]["duration"], delay_error=1e-4,
        noise=[2.0, 40.0], load=1e-3,
    )  # fmt: skip
    assert proof.holds == same.holds
    assert proof.reasons == same.reasons
    np.testing.assert_array_equal(proof.error_bound, same.error_bound)
