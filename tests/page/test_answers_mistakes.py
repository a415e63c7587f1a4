"""For each mistake the page is told one sentence, with its field."""

import math
import random

import numpy as np
import pytest

from foreswitch._helpers.mistake import Mistake
from foreswitch.page import jobs
from foreswitch.page.limits import LIMITS
from page.projects import CHAMBER, EXAMPLES, FILTER, GONE, HORIZON, HOT, INVERTER, OVEN, ask, changed


def complaint(project, kind="look", **more):
    fields, arrays = ask(kind, project, **more)
    assert not arrays
    return fields["error"]["field"], fields["error"]["message"]


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
