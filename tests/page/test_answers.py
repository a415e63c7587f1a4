"""What the page is told is what the library computes, and of whatever it is asked."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings, strategies as st

from foreswitch._helpers.json import plain_data
from foreswitch.model.reference import sample
from foreswitch.page import presets
from foreswitch.page.limits import LIMITS
from foreswitch.page.wire import pack, unpack
from foreswitch.project.project import Project
from foreswitch.project.tables import TABLES
from foreswitch.simulation.loop import sampled
from oracles import rig as rig_oracle
from page.projects import CHAMBER, EXAMPLES, FILTER, HORIZON, HOT, INVERTER, OVEN, REAL_SENSOR, ask, changed

# What is drawn --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_look_shows_the_run_that_the_library_makes(name):
    fields, arrays = ask("look", EXAMPLES[name])
    run = Project(EXAMPLES[name]).with_seed(0).simulate()
    for key, values in {"t": run.t, "y": run.y.T, "r": run.r.T, "u": run.u.T, "cost": run.cost}.items():
        np.testing.assert_array_equal(arrays[key], values.astype(np.float32), err_msg=key)
    assert fields["metrics"] == plain_data(run.metrics())
    assert fields["id"] == 7


def test_points_are_the_samples_of_the_file(tmp_path):
    source = Project.read(presets.files("foreswitch").joinpath("examples/oven/project.toml"))
    t = np.linspace(-10.0, 4000.0, 501)
    assert OVEN["reference"]["kind"] == "points"
    np.testing.assert_array_equal(sample(Project(OVEN).reference, t, 1, 2), sample(source.reference, t, 1, 2))


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_options_are_errors_of_the_truth(name):
    """As a study has them: B (1 + gain_error), input_delay + delay_error."""
    project = Project(EXAMPLES[name]).with_seed(0)
    delay = 0.7 * project.controller.Ts
    _, arrays = ask("look", EXAMPLES[name], options={"delay_error": delay, "gain_error": -0.1})
    truth = project.plant.replace(B=project.plant.B * 0.9, input_delay=project.plant.input_delay + delay)
    run = project.simulate(plant=truth)
    np.testing.assert_array_equal(arrays["u"], run.u.T)
    np.testing.assert_allclose(arrays["y"], run.y.T, rtol=1e-5, atol=1e-5 * np.abs(run.y).max())


def test_a_search_is_bounded_and_the_page_says_so():
    project = changed(INVERTER, ("controller", {"objective": "horizon", "steps": 64, "preview": True}))
    fields, _ = ask("look", project)
    assert any("the search was cut" in sentence for sentence in fields["warnings"])
    small = changed(project, ("controller.node_budget", 50))
    assert ask("look", small)[0]["warnings"] == []


def test_noise_without_a_seed_stands_still():
    project = changed(HOT, ("simulation.noise", [2.0, 50.0]))
    np.testing.assert_array_equal(ask("look", project)[1]["y"], ask("look", project)[1]["y"])
    other = changed(project, ("simulation.seed", 1))
    assert (ask("look", project)[1]["y"] != ask("look", other)[1]["y"]).any()


def test_a_design_kept_is_the_design_asked_for():
    """Requests that differ in one table only, in turn: none is answered with another's design."""
    variants = [HOT, changed(HOT, ("controller.Td", 0.03)), changed(HOT, ("simulation.duration", 0.3)),
                changed(HOT, ("reference.height", 500.0)), changed(HOT, ("actuator.min_on", 0.003))]  # fmt: skip
    for project in variants * 2:
        run = Project(project).simulate()
        np.testing.assert_array_equal(ask("look", project)[1]["u"], run.u.T)


# What the controller thought ------------------------------------------------------------------------------------------

THOUGHT = {
    "hot gas": HOT,
    "dwell": changed(HOT, ("actuator.min_on", 0.004), ("actuator.min_off", 0.003), ("simulation.noise", [2.0, 50.0])),
    "truth": changed(HOT, ("simulation.plant", changed(HOT["plant"], ("k", 15000.0), ("input_delay", 0.0063)))),
    "single": changed(HOT, ("controller.real", "float32"), ("simulation.noise", [2.0, 50.0])),
    "filter": changed(FILTER, ("estimator.load", 1e-6), ("simulation.load", -0.02)),
    "filter, poor sensor": changed(FILTER, ("simulation.hardware", REAL_SENSOR)),
    "horizon": changed(HORIZON, ("actuator.min_on", 0.003), ("simulation.noise", [2.0, 50.0])),
    "horizon, filter": changed(FILTER, ("controller", HORIZON["controller"])),
    "valve": changed(HOT, ("simulation.disturbance", {"gain": 60.0, "high": 12000.0})),
    "chamber": CHAMBER,
    "inverter": changed(INVERTER, ("simulation.duration", 0.02)),
    "oven": changed(OVEN, ("simulation.duration", 600.0)),
}


class Heard:
    """What the controller was given, from the run's traces and random numbers written out anew."""

    def __init__(self, project, run):
        table = project.file.simulation
        self.project, self.run = project, run
        self.seen = run.x if project.file.estimator is None else run.y
        width = self.seen.shape[1]
        hardware = table.hardware.model_dump() if table.hardware else {}
        noise = np.broadcast_to(0.0 if table.noise is None else table.noise, width)
        self.sensor = {
            "deviation": noise,
            "quantum": hardware.get("quantum", 0.0),
            "missing": hardware.get("missing", 0.0),
        }
        self.outages = hardware.get("outages", [])

    def at(self, k):
        Ts, width = self.run.Ts, self.seen.shape[1]
        if any(round(a / Ts) <= k < round(b / Ts) for a, b in self.outages):
            return np.full(width, np.nan)
        if rig_oracle.uniform(self.project.seed, rig_oracle.LOST, k) < self.sensor["missing"]:
            return np.full(width, np.nan)
        noise = [rig_oracle.normal(self.project.seed, rig_oracle.SENSOR, k * width + i) for i in range(width)]
        values = self.seen[k] + self.sensor["deviation"] * np.array(noise)
        quantum = self.sensor["quantum"]
        return quantum * np.round(values / quantum) if quantum else values


@pytest.mark.parametrize("name", THOUGHT)
def test_costs_are_those_of_a_replay_step_by_step(name):
    tables = THOUGHT[name]
    project = Project(tables).with_seed(0)
    run = project.simulate()
    law, heard = project.controller.copy(), Heard(project, run)
    wanted = set(np.linspace(0, len(run.u) - 1, 23).astype(int)) | {1, 2, 3}
    for k in range(len(run.u)):
        told = sampled(law, project.reference, run.t[k : k + 1])[0].reshape(
            law.evaluations, law.plant.outputs, law.order
        )
        disturbance = run.w[k] if law.plant.disturbances else None
        if k in wanted:
            fields, arrays = ask("costs", tables, step=int(k))
            decision = law.decide(heard.at(k), told, disturbance=disturbance)
            np.testing.assert_array_equal(arrays["costs"], decision.costs.astype(np.float32))
            np.testing.assert_array_equal(arrays["plan"], decision.sequence)
            assert fields["status"] == decision.status.name
            if fields["chosen"] is not None:
                np.testing.assert_array_equal(arrays["candidates"][fields["chosen"]], run.u[k])
            assert run.cost[k] == pytest.approx(decision.cost, rel=1e-12)
        np.testing.assert_array_equal(law.step(heard.at(k), told, disturbance=disturbance), run.u[k])


@pytest.mark.parametrize("name", ["inverter", "oven"])
def test_the_landing_is_what_the_costs_are_of(name):
    """Relative degree 1: the cost is half the squared distance of the landing from the reference, and the switchings'."""
    tables, project = THOUGHT[name], Project(THOUGHT[name])
    run, price = project.simulate(), project.file.actuator.switch_cost
    for k in range(1, len(run.u), 37):
        fields, arrays = ask("costs", tables, step=k)
        switches = (arrays["candidates"] != run.u[k - 1]).sum(axis=1)
        miss = arrays["landing"].astype(np.float64) - fields["reference"]
        expected = 0.5 * (miss**2).sum(axis=1) + price * switches
        locked = ~np.isfinite(arrays["costs"])
        assert (locked == np.isnan(arrays["landing"]).any(axis=1)).all()
        np.testing.assert_allclose(arrays["costs"][~locked], expected[~locked], rtol=2e-4, atol=1e-5)


# Certificate and baselines --------------------------------------------------------------------------------------------


def test_a_certificate_bears_the_options_either_way():
    fields, arrays = ask("certify", HOT, options={"delay_error": -2e-4, "gain_error": 0.05}, margins=True)
    proof = Project(HOT).certify(delay_error=2e-4, gain_error=0.05)
    assert fields["holds"] is proof.holds is True
    assert fields["error_bound"] == proof.error_bound.tolist()
    assert fields["reasons"] == proof.reasons
    assert fields["margins"] == plain_data(proof.margins)
    run = Project(HOT).simulate()
    ideal = proof.ideal(Project(HOT).reference, 0.6)
    np.testing.assert_array_equal(arrays["ideal"], ideal.T.astype(np.float32))
    assert (arrays["low"] <= run.y.T).all()
    assert (arrays["high"] >= run.y.T).all()


def test_a_certificate_says_what_of_the_run_it_does_not_cover():
    assert ask("certify", HOT, options={"delay_error": 2e-4, "gain_error": 0.1})[0]["covers"] is None
    slow = changed(HOT, ("simulation.hardware", {"opening": 0.002, "closing": 0.002}))
    other = changed(slow, ("simulation.plant", HOT["plant"]))
    assert "[simulation.hardware], which the bound does not cover" in ask("certify", slow)[0]["covers"]
    assert "[simulation.plant] and [simulation.hardware], which" in ask("certify", other)[0]["covers"]


def test_what_is_not_proven_has_reasons_and_no_band():
    fields, arrays = ask("certify", EXAMPLES["attitude"])
    assert fields["holds"] is False
    assert fields["reasons"]
    assert "low" not in arrays


@pytest.mark.parametrize("which", ["relay", "pi_pwm", "smith_pwm"])
def test_a_baseline_is_the_one_that_the_library_tunes(which):
    from foreswitch.simulation.baselines import BASELINES

    fields, arrays = ask("baseline", HOT, which=which, budget=40)
    tuned = Project(HOT).with_seed(0).tune(BASELINES[which].law, budget=40)
    assert fields["parameters"] == tuned.parameters
    np.testing.assert_array_equal(arrays["u"], tuned.run.u.T)


# The form of a reply --------------------------------------------------------------------------------------------------

NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
ARRAYS = st.lists(st.lists(NUMBERS, min_size=3, max_size=3), max_size=4).map(lambda rows: np.reshape(rows, (-1, 3)))
NAMES = st.text(max_size=5).filter(lambda name: name != "arrays")


@given(
    st.dictionaries(NAMES, st.recursive(NUMBERS | st.text() | st.none(), st.lists)), st.dictionaries(st.text(), ARRAYS)
)
def test_a_reply_is_read_as_it_was_written(header, arrays):
    message = pack(header, arrays)
    found, read = unpack(message)
    length = int.from_bytes(message[:4], "little")
    assert (length + 4) % 4 == 0
    json.loads(message[4 : 4 + length], parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert {key: value for key, value in found.items() if key != "arrays"} == plain_data(header)
    assert read.keys() == arrays.keys()
    for name, values in arrays.items():
        with np.errstate(over="ignore"):
            np.testing.assert_array_equal(read[name], values.astype(np.float32))


# Anything else --------------------------------------------------------------------------------------------------------

EXTREME = [10**30, -(10**30), 10**400, 1e308, -1e308, 5e-324, 1e-9, 1e9]
WORDS = ["lag", "rest", "hold", "horizon", "riccati", "\ud800", "[x]", "points"]
LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 3), st.floats(), st.text(max_size=3), st.sampled_from(EXTREME + WORDS)
)
JUNK = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["kind", "k", "A"]), inner),
    max_leaves=12,
)
PLACES = sorted({f"{table}.{key}" for table in ("plant", "actuator", "controller", "estimator", "reference", "simulation",
                 "simulation.plant", "simulation.hardware", "simulation.disturbance") for key in TABLES[table].model_fields}
                | {"plant", "reference", "simulation", "simulation.hardware"})  # fmt: skip
SHORT = [changed(project, ("simulation.duration", 0.05)) for project in (HOT, HORIZON, FILTER, CHAMBER, INVERTER)]


@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much])
@given(st.sampled_from(SHORT), st.lists(st.tuples(st.sampled_from(PLACES), JUNK), min_size=1, max_size=3),
       st.sampled_from(["look", "costs", "certify"]))  # fmt: skip
def test_anything_in_any_place_is_drawn_or_told(capfd, project, changes, kind):
    """Never a defect of ours, never a sentence without a remedy, and JSON that a browser reads."""
    for change in changes:
        try:
            project = changed(project, change)
        except (TypeError, AttributeError, ValueError, IndexError):
            assume(False)  # no table there any more
    fields, arrays = ask(kind, project, step=3, options={"delay_error": 1e-4})
    if "error" in fields:
        error = fields["error"]
        assert "defect" not in error["message"], capfd.readouterr()
        assert ";" in error["message"], error
        assert len(error["message"]) <= LIMITS["sentence"] + 5
        assert not arrays
    assert capfd.readouterr() == ("", "")
