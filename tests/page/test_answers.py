"""What the page is told: the same as the library computes, and for each mistake one sentence with its field."""

import json
import math
import random

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings, strategies as st

from foreswitch._helpers.json import plain_data
from foreswitch._helpers.mistake import Mistake
from foreswitch.model.reference import sample
from foreswitch.page import jobs, presets
from foreswitch.page.limits import LIMITS
from foreswitch.page.wire import pack, unpack
from foreswitch.project.project import Project
from foreswitch.project.tables import TABLES
from foreswitch.simulation.loop import sampled
from oracles import rig as rig_oracle
from page.projects import CHAMBER, EXAMPLES, FILTER, GONE, HORIZON, HOT, INVERTER, OVEN, REAL_SENSOR, changed


def ask(kind, project, **more):
    _, body = jobs.done({"kind": kind, "id": 7}, json.dumps({"project": project, **more}).encode())
    return unpack(body)


def complaint(project, kind="look", **more):
    fields, arrays = ask(kind, project, **more)
    assert not arrays
    return fields["error"]["field"], fields["error"]["message"]


# Mistakes -------------------------------------------------------------------------------------------------------------

BROKEN = [
    (HOT, "plant", GONE, "plant"),
    (HOT, "plant.model", "integrator", "plant.model"),
    (HOT, "plant.k", GONE, "plant.k"),
    (HOT, "plant.k", "fast", "plant.k"),
    (HOT, "plant.k", 0.0, "plant"),
    (HOT, "plant.c", 0.0, "plant.c"),
    (HOT, "plant.T", 3.0, "plant.T"),
    (HOT, "plant.colour", 3.0, "plant.colour"),
    (HOT, "plant.input_delay", -1.0, "plant.input_delay"),
    (HOT, "plant.input_delay", [0.1, 0.2], "plant.input_delay"),
    (HOT, "plant.input_delay", 1e9, "plant.input_delay"),
    (HOT, "plant.E", [[1.0], [2.0], [3.0]], "plant.E"),
    (HOT, "plant.E", [[1.0], [2.0, 3.0]], "plant.E"),
    (HOT, "plant.C", [[1.0]], "plant.C"),
    (HOT, "plant.u_offset", [1.0, 2.0], "plant.u_offset"),
    (HOT, "plant.input_names", ["a", "b"], "plant.input_names"),
    (HOT, "plant.output_names", [1], "plant.output_names"),
    (OVEN, "plant.T", -5.0, "plant.T"),
    (OVEN, "plant.K", math.nan, "plant.K"),
    (EXAMPLES["attitude"], "plant.den", [0.0], "plant.den"),
    (EXAMPLES["attitude"], "plant.num", [1.0, 2.0, 3.0, 4.0], "plant.num"),
    (EXAMPLES["attitude"], "plant.den", [1.0] * 500, "plant.den"),
    (INVERTER, "plant.A", [[1.0, 2.0]], "plant.A"),
    (INVERTER, "plant.A", [[0.0] * 200] * 200, "plant.A"),
    (INVERTER, "plant.B", [[1.0], [2.0], [3.0]], "plant.B"),
    (HOT, "actuator.levels", [0], "actuator.levels"),
    (HOT, "actuator.levels", [1, 0], "actuator.levels"),
    (HOT, "actuator.levels", [[0, 1], [0, 1]], "actuator.levels"),
    (INVERTER, "actuator.levels", [list(range(60))] * 3, "actuator.levels"),
    (HOT, "actuator.Ts", 0.0, "actuator.Ts"),
    (HOT, "actuator.Ts", -1.0, "actuator.Ts"),
    (HOT, "actuator.Ts", GONE, "actuator.Ts"),
    (HOT, "actuator.Ts", "1 ms", "actuator.Ts"),
    (HOT, "actuator.Ts", 1e-9, "plant.input_delay"),
    (HOT, "actuator.min_on", -1.0, "actuator.min_on"),
    (HOT, "actuator.min_off", [0.1, 0.1], "actuator.min_off"),
    (HOT, "actuator.switch_cost", -1.0, "actuator.switch_cost"),
    (CHAMBER, "actuator.forbidden", [[1, 2]], "actuator.forbidden"),
    (CHAMBER, "actuator.forbidden", [[0, 0]], "actuator.forbidden"),
    (CHAMBER, "actuator.safe_level", [0, 3], "actuator.safe_level"),
    (HOT, "controller.Td", 0.0, "controller.Td"),
    (HOT, "controller.Td", 1e-4, "controller.Td"),
    (HOT, "controller.Td", GONE, "controller.Td"),
    (HOT, "controller.lam", -1.0, "controller.lam"),
    (HOT, "controller.lam", [1.0, 2.0], "controller.lam"),
    (HOT, "controller.tail", "hold", "controller.tail"),
    (HOT, "controller.weight", -1.0, "controller.weight"),
    (HOT, "controller.preview", "far", "controller.preview"),
    (HOT, "controller.relative_degree", 7, "controller.relative_degree"),
    (HOT, "controller.bad_limit", 0, "controller.bad_limit"),
    (HOT, "controller.real", "float16", "controller.real"),
    (HOT, "controller.steps", 8, "controller.steps"),
    (HORIZON, "controller.steps", 0, "controller.steps"),
    (HORIZON, "controller.steps", 65, "controller.steps"),
    (HORIZON, "controller.steps", GONE, "controller.steps"),
    (HORIZON, "controller.Td", 0.02, "controller.Td"),
    (HORIZON, "controller.moves", 9, "controller.moves"),
    (HORIZON, "controller.window", [3, 2], "controller.window"),
    (HORIZON, "controller.move_weight", -1.0, "controller.move_weight"),
    (HORIZON, "controller.terminal", "lqr", "controller.terminal"),
    (HORIZON, "controller.node_budget", 0, "controller.node_budget"),
    (HORIZON, "controller.preview", "lag", "controller.preview"),
    (FILTER, "estimator.process_noise", -1.0, "estimator.process_noise"),
    (FILTER, "estimator.measurement_noise", 0.0, "estimator.measurement_noise"),
    (FILTER, "estimator.gate", -1.0, "estimator.gate"),
    (FILTER, "estimator.gate_limit", 0, "estimator.gate_limit"),
    (FILTER, "estimator.load", -1.0, "estimator.load"),
    (FILTER, "estimator.measurement_noise", GONE, "estimator.measurement_noise"),
    (HOT, "reference", GONE, "reference"),
    (HOT, "reference.kind", "square", "reference.kind"),
    (HOT, "reference.height", GONE, "reference.height"),
    (HOT, "reference.height", "high", "reference.height"),
    (HOT, "reference.duration", 0.0, "reference.duration"),
    (HOT, "reference.frequency", 1.0, "reference.frequency"),
    (HOT, "reference", {"kind": "constant", "value": "three"}, "reference.value"),
    (HOT, "reference", {"kind": "points", "times": [0.0, 1.0], "values": [1.0]}, "reference.times"),
    (HOT, "reference", {"kind": "points", "times": [1.0, 0.0], "values": [1.0, 2.0]}, "reference.times"),
    (HOT, "reference", {"kind": "points", "times": [], "values": []}, "reference.times"),
    (HOT, "reference", {"kind": "points", "times": [0.0], "values": [1.0], "between": "spline"}, "reference.between"),
    (HOT, "reference", {"kind": "samples", "file": "../../etc/passwd"}, "reference.file"),
    (HOT, "reference", {"kind": "samples", "file": "/etc/passwd"}, "reference.file"),
    (HOT, "reference", [HOT["reference"]] * 2, "reference"),
    (INVERTER, "reference.1.frequency", 0.0, "reference.1.frequency"),
    (INVERTER, "reference.1.frequency", "high", "reference.1.frequency"),
    (INVERTER, "reference.1.amplitude", GONE, "reference.1.amplitude"),
    (INVERTER, "reference.0.colour", 1, "reference.0.colour"),
    (HOT, "simulation", GONE, "simulation"),
    (HOT, "simulation.duration", GONE, "simulation.duration"),
    (HOT, "simulation.duration", 0.0, "simulation.duration"),
    (HOT, "simulation.duration", 5e-324, "simulation.duration"),
    (HOT, "simulation.duration", 1e9, "simulation.duration"),
    (HOT, "simulation.duration", math.inf, "simulation.duration"),
    (HOT, "simulation.x0", [1.0], "simulation.x0"),
    (HOT, "simulation.noise", -1.0, "simulation.noise"),
    (HOT, "simulation.noise", [1.0, 2.0, 3.0], "simulation.noise"),
    (HOT, "simulation.seed", -1, "simulation.seed"),
    (HOT, "simulation.seed", 0.5, "simulation.seed"),
    (HOT, "simulation.load", [1.0, 2.0], "simulation.load"),
    (HOT, "simulation.colour", 1, "simulation.colour"),
    (HOT, "simulation.disturbance", [1.0, 2.0], "simulation.disturbance"),
    (HOT, "simulation.disturbance", {"gain": 1.0}, "simulation.disturbance.high"),
    (HOT, "simulation.disturbance", {"gain": "big", "high": 1.0}, "simulation.disturbance.gain"),
    (INVERTER, "simulation.disturbance.1.frequency", -1.0, "simulation.disturbance.1.frequency"),
    (INVERTER, "simulation.disturbance.1", GONE, "simulation.disturbance"),
    (INVERTER, "simulation.disturbance.0", {"kind": "samples", "file": "x.csv"}, "simulation.disturbance.0.file"),
    (HOT, "simulation.plant", changed(HOT["plant"], ("c", -1.0)), "simulation.plant.c"),
    (HOT, "simulation.plant", changed(HOT["plant"], ("c", GONE)), "simulation.plant.c"),
    (HOT, "simulation.plant", changed(HOT["plant"], ("colour", 1)), "simulation.plant.colour"),
    (HOT, "simulation.plant", changed(HOT["plant"], ("input_delay", 1e6)), "simulation.plant.input_delay"),
    (HOT, "simulation.plant", INVERTER["plant"], "simulation.plant"),
    (HOT, "simulation.hardware.opening", -1.0, "simulation.hardware.opening"),
    (HOT, "simulation.hardware.opening", 1e6, "simulation.hardware.opening"),
    (HOT, "simulation.hardware.late", 1e6, "simulation.hardware.late"),
    (HOT, "simulation.hardware.missing", 2.0, "simulation.hardware.missing"),
    (HOT, "simulation.hardware.outages", [[2.0, 1.0]], "simulation.hardware.outages"),
    (HOT, "simulation.hardware.outages", [[0.0, 1.0]] * 1000, "simulation.hardware.outages"),
    (HOT, "simulation.hardware.stuck", [{"level": 1.0, "input": 4}], "simulation.hardware.stuck"),
    (HOT, "simulation.hardware.colour", 1, "simulation.hardware.colour"),
    (HOT, "simulation.hardware.quantum", [1.0, 2.0, 3.0], "simulation.hardware.quantum"),
]  # fmt: skip


def test_the_whole_examples_are_no_mistakes():
    """Else the mistakes above would prove nothing."""
    for project in (*EXAMPLES.values(), HORIZON, FILTER):
        fields, arrays = ask("look", project)
        assert "error" not in fields, fields
        assert len(arrays["t"]) > 500


@pytest.mark.parametrize(
    ("project", "path", "value", "field"), BROKEN, ids=[f"{p}-{i}" for i, (_, p, _, _) in enumerate(BROKEN)]
)
def test_each_mistake_is_told_in_one_sentence_beside_its_field(project, path, value, field):
    found, sentence = complaint(changed(project, (path, value)))
    assert found == field, sentence
    assert "\n" not in sentence
    assert ";" in sentence, "no remedy"
    assert len(sentence) <= LIMITS["sentence"] + 5


CHANCE = random.Random(14)


def jumble(mistake):
    """Some other sentence, with words in it that are keys of other tables."""
    some = ["Ts", "plant", "[reference] has no key 'k'", "levels", "simulation.x0", "the", "is", "holds", "stuck", "t"]
    return " ".join(CHANCE.choices(some, k=8)) + "; " + " ".join(CHANCE.choices(some, k=3))


@pytest.mark.parametrize(
    ("project", "path", "value", "field"), BROKEN, ids=[f"{p}-{i}" for i, (_, p, _, _) in enumerate(BROKEN)]
)
def test_a_mistake_is_beside_its_field_whatever_its_words(monkeypatch, project, path, value, field):
    """The field is data: no sentence is read."""
    monkeypatch.setattr(Mistake, "__str__", jumble)
    made = Mistake.__init__

    def reworded(self, argument, value, remedy, **words):
        given = {name: word and jumble(self) for name, word in words.items() if name != "key"}
        made(self, argument, value, jumble(self), **words | given)

    monkeypatch.setattr(Mistake, "__init__", reworded)
    found, sentence = complaint(changed(project, (path, value)))
    assert found == field
    assert ";" in sentence


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("Singular matrix"), OverflowError("Result too large"),
                                   ValueError("array must not contain infs or NaNs"), FloatingPointError("x" * 5000)],
                         ids=lambda error: type(error).__name__)  # fmt: skip
def test_what_another_library_finds_is_told_without_a_field(monkeypatch, error):
    def look(request):
        raise error

    monkeypatch.setitem(jobs.ANSWERS, "look", look)
    field, sentence = complaint(HOT)
    assert field is None
    assert sentence.startswith(f"the numbers are too extreme to compute with ({str(error)[:20]}")
    assert sentence.endswith("); choose others")
    assert len(sentence) <= LIMITS["sentence"] + 5


def test_options_and_requests_are_checked_too():
    assert complaint(HOT, options={"delay_error": -0.01})[0] == "options.delay_error"
    assert complaint(HOT, options={"delay_error": "late"})[0] == "options.delay_error"
    assert complaint(HOT, options={"gain_error": -1.0})[0] == "options.gain_error"
    assert complaint(HOT, options={"gain_error": math.nan})[0] == "options.gain_error"
    assert complaint(HOT, "certify", options={"gain_error": 1.5})[0] == "options.gain_error"
    assert complaint(HOT, options=[1])[0] is None
    assert complaint(HOT, "costs", step=600) == ("step", "step is 600; give a whole number from 0 to 599")
    assert complaint(HOT, "costs", step="first")[0] == "step"
    assert complaint(HOT, "baseline", which="pid")[0] == "which"
    assert complaint(HOT, "baseline", which="relay", budget=10**9)[0] == "budget"
    assert complaint("hot gas")[0] is None
    assert complaint(None)[0] is None


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
