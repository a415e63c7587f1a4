"""What every result can say of itself: plain data with units, a report, a picture."""

import json
import math
import re

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch._helpers.json import json_text, plain_data
from foreswitch._helpers.toml import toml_text
from foreswitch._helpers.units import described, name_and_unit, unit_of_names, without_units
from foreswitch.demo.hot_gas import hot_gas_file
from foreswitch.identification.pulse_test import PulseTest
from foreswitch.project.project import Project
from foreswitch.simulation.baselines import BASELINES
from foreswitch.studies.comparison import compare

HOT = Project.read(hot_gas_file())
VALVE = fsw.Plant.integrator_lag(16500.0, 0.006, 0.005, input_names=["valve [-]"], output_names=["pressure [kPa]"])
LAW = fsw.Controller(VALVE, [0, 1], 1e-3, fsw.Endpoint(Td=0.02, lam=2500.0))
RISE = fsw.HalfSine(400.0, 0.2)


def run():
    return fsw.simulate(LAW, RISE, 0.2)


def overflowing():
    """A loop whose numbers leave what a float can hold."""
    return fsw.simulate(LAW, RISE, 0.05, x0=[1e308, 1e308])


def searched():
    return fsw.simulate(LAW.replace(objective=fsw.Horizon(4)), RISE, 0.05)


def baseline():
    known = BASELINES["relay"]
    return fsw.simulate(known.law(VALVE, [0, 1], 1e-3, hysteresis=3.0), RISE, 0.05)


def fit():
    pulses = PulseTest(Ts=0.001, width=0.004, spacing=0.060, number=6, lead=0.050)
    return fsw.identify(pulses.rehearse(VALVE, noise=0.5, seed=1), "integrator+lag")


def study():
    over = {"controller.Td": [0.01, 0.02], "delay_error": fsw.Uniform(-1e-3, 1e-3), "simulation.duration": [0.05]}
    return fsw.study(HOT, over, repeats=3)


def running_away():
    over = {"simulation.x0": [[1e308, 1e308], [0.0, 0.0]], "simulation.duration": [0.02]}
    return fsw.study(HOT, over)


def comparison():
    return compare(HOT.with_simulation({"duration": 0.05}), budget=20)


MAKERS = {
    "run": run,
    "run of a horizon": searched,
    "run of a baseline": baseline,
    "run that overflows": overflowing,
    "fit": fit,
    "certificate": lambda: fsw.certify(LAW, reference=RISE, noise=[1.0, 10.0]),
    "certificate without a reference": lambda: fsw.certify(LAW),
    "certificate that does not hold": lambda: fsw.certify(LAW, delay_error=1.0),
    "certificate of an unstable loop": lambda: fsw.certify(LAW.replace(objective=fsw.Endpoint(Td=1e-3, lam=1.0))),
    "study": study,
    "study that overflows": running_away,
    "comparison": comparison,
}
_made = {}


@pytest.fixture(params=MAKERS)
def result(request):
    if request.param not in _made:
        _made[request.param] = MAKERS[request.param]()
    return _made[request.param]


def leaves(value):
    if isinstance(value, dict):
        assert all(type(key) is str for key in value)
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from leaves(item)
    else:
        yield value


def test_a_summary_is_plain_data(result):
    summary = result.summary()
    assert {type(leaf) for leaf in leaves(summary)} <= {str, int, float, bool, type(None)}
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert json.loads(json_text(without_units(summary), indent=2)) == without_units(summary)


def test_a_report_is_written_whatever_the_result(result, tmp_path):
    result.report("valve").write(tmp_path)
    html = (tmp_path / "report.html").read_text()
    assert "<h1>valve" in html
    assert " object at 0x" not in html
    assert html.count("<svg") == len(list(tmp_path.glob("*.png")))


def test_a_picture_is_drawn_where_there_is_one(result, tmp_path):
    if isinstance(result, fsw.Certificate) and (not result.holds or result.course is None):
        with pytest.raises(ValueError, match="there is no band to draw"):
            result.plot()
        return
    with np.errstate(over="ignore", invalid="ignore"):
        result.plot().savefig(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5000


# Units ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("made", "keys"),
    [
        ("run", {"Ts [s]", "rms_error [kPa]", "lag [s]", "switches", "on_time [s]"}),
        ("fit", {"y_offset [kPa]", "measurement_noise [kPa, squared]", "u_offset", "fit_percent"}),
        ("certificate", {"error_bound [kPa]", "lag [s]", "Td_intervals [s]", "lam_intervals [rad/s]", "input_range"}),
    ],
)
def test_keys_say_their_units(made, keys):
    assert keys <= set(MAKERS[made]().summary())


def test_keys_deeper_down_say_their_units_too():
    proof = fsw.certify(LAW, reference=RISE).summary()
    assert {"delay_error [s]", "gain_error"} <= set(proof["margins"])
    assert {"value [kPa]", "slope [kPa/s]"} & set(proof["steady"])
    [first, *_] = study().summary()["points"]
    assert {"controller.Td [s]", "rms_error_q50 [kPa]", "switches_q50", "on_time_q95 [s]"} <= set(first)
    assert fit().summary()["parameters"]["k"]["unit"] == "kPa/s"
    assert {"rms_error [kPa]", "switching_rate [1/s]"} <= set(comparison().summary()["relay"]["curve"][0])


def test_a_run_says_what_it_computed_and_none_for_what_it_could_not():
    made = run()
    summary, metrics = without_units(made.summary()), made.metrics()
    assert {name: summary[name] for name in metrics} == plain_data(metrics)
    assert summary["units"] == {
        "Ts": "s", "rms_error": "kPa", "max_error": "kPa", "lag": "s", "rms_error_at_lag": "kPa", "on_time": "s"
    }  # fmt: skip
    assert sum(summary["status"].values()) == summary["periods"] == 200
    assert not math.isfinite(overflowing().metrics()["rms_error"])
    assert overflowing().summary()["rms_error [kPa]"] is None


def test_a_run_carries_its_law_as_it_was():
    law = LAW.copy()
    made = fsw.simulate(law, RISE, 0.05)
    law.step(np.zeros(2), 100.0)
    again = fsw.simulate(made.controller, RISE, 0.05)
    assert np.array_equal(again.u, made.u)


def test_several_outputs_have_a_unit_each():
    assert unit_of_names(["p [kPa]", "T [K]", "share"]) == "kPa, K, 1"
    assert unit_of_names(["p [kPa]", "q [kPa]"]) == "kPa"
    assert unit_of_names(["valve [-]", "u"]) == ""


def test_a_name_with_its_unit_is_read_as_it_is_written():
    for unit in ("kPa", "unit of y / s", "x, squared"):
        assert name_and_unit(described("length of the run", unit)) == ("length of the run", unit)
    assert described("dead time", "s", ", one each") == "dead time [s], one each"
    assert described("share") == "share"


# Errors of a model ----------------------------------------------------------------------------------------------------


def test_errors_make_a_plant_that_answers_later_and_more_strongly():
    two = fsw.Plant([[-1.0]], [[1.0, 2.0]], input_delay=[0.1, 0.2], E=[[3.0]], y_offset=5.0)
    truth = two.with_errors([0.0, -0.2], 0.5)
    assert truth.input_delay.tolist() == [0.1, 0.0]
    assert truth.B.tolist() == [[1.5, 3.0]]
    assert (truth.E.tolist(), truth.y_offset.tolist(), truth.A.tolist()) == ([[3.0]], [5.0], [[-1.0]])
    assert two.with_errors(gain=[0.0, -1.0]).B.tolist() == [[1.0, 0.0]]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"delay": -0.006}, r"delay is -0.006, which leaves less than no dead time \(-0.001 s\); give at least -0.005"),
        ({"delay": [0.0, 1.0]}, r"delay has shape \(2,\)"),
        ({"gain": math.nan}, "gain holds NaN"),
        ({"gain": "much"}, "gain is 'much'"),
    ],
)
def test_errors_that_no_plant_has_are_told(arguments, words):
    with pytest.raises(ValueError, match=words):
        VALVE.with_errors(**arguments)


# Writers --------------------------------------------------------------------------------------------------------------


def test_json_is_valid_whatever_it_holds():
    odd = {
        "nan": math.nan, "numbers": np.array([1.0, np.inf]), "whole": np.int64(3), "flag": np.bool_(True), 5: (1, 2),
        "single": np.float32(0.5), "text": "\ud800 µ", "flags": np.array([True, False]), "none": None,
    }  # fmt: skip
    text = json_text(odd, indent=2)
    assert json.loads(text) == {
        "nan": None, "numbers": [1.0, None], "whole": 3, "flag": True, "5": [1, 2], "single": 0.5, "text": "\ud800 µ",
        "flags": [True, False], "none": None,
    }  # fmt: skip
    assert text.isascii()
    assert text.endswith("}\n")
    assert re.search("NaN|Infinity", text) is None


def test_toml_has_comments_above_and_behind():
    text = toml_text(
        {
            "a": {"x": 1.5, "deep": {"y": [[1, 2.5], []]}, "long": "w" * 80, "gone": None},
            "b": [{"z": True}, {"z": False}],
        },
        heading=["from a record"],
        meaning=lambda table, key: f"{table}'s {key}",
    )
    assert text.startswith("# from a record\n\n[a]\nx = 1.5 ")
    assert "# a's x\n" in text
    assert "# a.deep's y\n" in text
    assert "a's long" not in text
    assert text.count("[[b]]") == 2
