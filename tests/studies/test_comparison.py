"""Laws side by side on one project: all of them, on the same task, the same each time."""

import json
import re
import tomllib
import warnings
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest

from foreswitch.baselines import PIPWM, Relay
from foreswitch.cli import app
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.project import Project
from foreswitch.studies.comparison import (
    COLOURS,
    HORIZON_COSTS,
    HORIZONS,
    KINDS,
    SPREAD,
    SWITCH_COSTS,
    compare,
    horizon_settings,
    on_share,
    price_curve,
    switching_rate,
    total_rms,
)
from places import EXAMPLES

HOT_GAS = (EXAMPLES / "hot_gas/project.toml").read_text(encoding="utf-8")
LAWS = ("predictive", "predictive, preview")
PREDICTIVE = (*LAWS, *HORIZONS.values())
UNSTABLE = """
[plant]
model = "state_space"
A = [[1.0]]
B = [[10.0]]

[actuator]
levels = [0, 1]
Ts = 0.01

[controller]
Td = 0.02
lam = 5.0

[reference]
kind = "constant"
value = 1.0

[simulation]
duration = 1.0
"""


def hot_gas(**simulation):
    content = tomllib.loads(HOT_GAS)
    content["simulation"] |= {"duration": 0.25} | simulation
    return Project(content)


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def result(told):
    return compare(hot_gas(), budget=40, progress=told.append)


def test_all_laws_are_there(result, told):
    assert tuple(result.runs) == tuple(result.curves) == (*PREDICTIVE, *KINDS)
    assert tuple(result.tuned) == tuple(KINDS)
    assert not result.skipped
    assert told == [*PREDICTIVE, *(f"tuning: {law}" for law in KINDS)]
    first = result.runs["predictive"]
    for run in result.runs.values():
        assert np.array_equal(run.r, first.r)
        assert run.plant is first.plant
    assert np.array_equal(first.u, hot_gas().simulate().u)


def test_every_curve_passes_through_the_law_as_configured_or_tuned(result):
    for law in PREDICTIVE:
        parameters = [value for value, _ in result.curves[law]]
        assert len(parameters) == 1 + len(SWITCH_COSTS if law in LAWS else HORIZON_COSTS)
        assert parameters[0] == 0.0
        assert parameters[1:] == sorted(parameters[1:])
        assert np.array_equal(result.curves[law][0][1].u, result.runs[law].u)
    for law, (_, knob) in KINDS.items():
        best = result.tuned[law]
        parameters = [value for value, _ in result.curves[law]]
        assert parameters == pytest.approx([factor * best.parameters[knob] for factor in SPREAD])
        assert np.array_equal(result.curves[law][SPREAD.index(1.0)][1].u, result.runs[law].u)
        assert best.rms_error == pytest.approx(total_rms(result.runs[law]))


def test_a_dearer_switch_means_no_more_switches(result):
    """But for a pulse or two: an error that is left alone may take more of them later."""
    for law in PREDICTIVE:
        counts = [run.metrics()["switches"] for _, run in result.curves[law][1:]]
        assert all(after <= before + 4 for before, after in pairwise(counts))
        assert counts[-1] < counts[0] / 4
        errors = [total_rms(run) for _, run in result.curves[law][1:]]
        assert errors[-1] > 2.0 * errors[0]


def test_a_longer_carrier_or_a_wider_hysteresis_switches_less(result):
    for law in KINDS:
        rates = [switching_rate(run) for _, run in result.curves[law]]
        assert rates == sorted(rates, reverse=True)


def test_the_figures_by_hand(result):
    run = result.runs["predictive"]
    u = run.u[:, 0]
    assert switching_rate(run) == pytest.approx(np.count_nonzero(np.diff(u)) / 0.25)
    assert on_share(run) == pytest.approx(100.0 * u.mean())
    assert total_rms(run) == pytest.approx(np.sqrt(np.mean((run.y - run.r) ** 2)))


def test_the_same_seed_gives_the_same_figures():
    noisy = hot_gas(noise=[5.0, 200.0])
    runs = [compare(noisy, budget=20, seed=seed) for seed in (3, 3, 4)]
    for law, run in runs[0].runs.items():
        assert np.array_equal(run.y, runs[1].runs[law].y), law
        assert not np.array_equal(run.y, runs[2].runs[law].y), law
    assert {law: best.parameters for law, best in runs[0].tuned.items()} == {
        law: best.parameters for law, best in runs[1].tuned.items()
    }


def test_a_smith_predictor_is_left_out_of_an_unstable_plant_and_the_report_says_why():
    found = compare(Project(tomllib.loads(UNSTABLE)), budget=20)
    assert set(found.runs) == {*PREDICTIVE, "relay", "PI + PWM"}
    assert set(found.skipped) == {"Smith + PWM"}
    assert "unstable pole 1" in found.skipped["Smith + PWM"]
    assert "Smith + PWM is left out: plant has the unstable pole" in str(found.report("x").sections[0].text)


def test_with_preview_configured_the_law_without_it_is_beside():
    content = tomllib.loads(HOT_GAS)
    content["simulation"]["duration"] = 0.1
    content["controller"]["preview"] = "lag"
    found = compare(Project(content), budget=20)
    assert "predictive, no preview" in found.runs
    assert "predictive, preview" not in found.runs
    lag = Project(content).controller.lag
    for best in found.tuned.values():
        assert 0.0 <= best.parameters["preview"] <= lag


def test_several_inputs_and_outputs():
    """The inverter: no preview of equal length for all outputs is needed, no level rests between others."""
    path = EXAMPLES / "inverter/project.toml"
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    content["simulation"]["duration"] = 0.02
    found = compare(Project(content, path.parent), budget=20)
    assert not found.skipped
    for law, run in found.runs.items():
        assert run.u.shape == (400, 3), law
        assert np.isfinite(total_rms(run))
    assert total_rms(found.runs["predictive"]) < total_rms(found.runs["relay"])
    row = found.table().rows[0]
    assert row[1].count(",") == 1
    assert row[6] == f"{on_share(found.runs['predictive']):#.3g}"


def test_report_and_table(result, tmp_path):
    table = result.table()
    assert len(table.rows) == len(result.runs)
    assert all(len(row) == len(table.heads) for row in table.rows)
    assert table.heads[-2:] == ["switches / s", "time on [%]"]
    result.report("valve").write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "report.html", "compare.png", "compare.svg", "traces.png", "traces.svg"
    }  # fmt: skip
    html = (tmp_path / "report.html").read_text()
    assert html.count("<svg") == 2
    for law in result.runs:
        assert law in html
    for best in result.tuned.values():
        assert str(best.evaluations) in html
    assert not re.search(r"""(src|href)=["'](?!#)""", html)


def test_the_figure_shows_every_curve_and_marks_the_law_itself(result):
    axes = result.plot().axes[0]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(result.runs)
    for i, (law, curve) in enumerate(result.curves.items()):
        line, mark = axes.lines[2 * i : 2 * i + 2]
        assert sorted(line.get_xdata()) == sorted(switching_rate(run) for _, run in curve)
        assert mark.get_xdata() == [switching_rate(result.runs[law])]
        assert mark.get_ydata() == [total_rms(result.runs[law])]
    assert axes.get_xscale() == axes.get_yscale() == "log"
    traces = result.traces()
    assert [axes.get_title("left") for axes in traces.axes] == list(result.runs)


# Horizons -------------------------------------------------------------------------------------------------------------


def previewed(**controller):
    content = tomllib.loads(HOT_GAS)
    content["controller"] |= {"preview": "lag"} | controller
    return Project(content)


def test_a_horizon_of_one_period_is_the_one_step_law():
    """At the same price, twice the endpoint's because that halves its squares; dwell and all."""
    for changes in ({}, {"switch_cost": 3.0}, {"min_on": 0.003, "min_off": 0.002}, {"relative_degree": 2}):
        project = previewed()
        project.file = project.file.model_copy(
            update={"actuator": project.file.actuator.model_copy(update=changes)} if "relative_degree" not in changes
            else {"controller": project.file.controller.model_copy(update=changes)}
        )  # fmt: skip
        with pytest.warns(UserWarning, match="exceeds") if "min_on" in changes else nullcontext():
            endpoint = project.build_controller(Td=project.controller.Ts)
            step = project.build_controller(**horizon_settings(project, 1))
        assert np.array_equal(project.simulate(step).u, project.simulate(endpoint).u), changes


def test_horizons_share_sliding_variable_preview_and_price_with_the_project():
    project = previewed(weight=3.0)
    settings = horizon_settings(project, 5)
    law = project.build_controller(**settings | {"switch_cost": 7.0})
    assert law.objective == Horizon(5, weight=3.0, lam=2500.0, node_budget=law.objective.node_budget)
    assert law.reference_times == pytest.approx(0.005 + 1e-3 * np.arange(1, 6))
    assert horizon_settings(hot_gas(), 5)["preview"] is False
    curve = price_curve(project, project.build_controller(**settings), [0.0, 1.0])
    assert np.array_equal(curve[0][1].u, curve[1][1].u)
    # a pulse of one period, seen at the five instants: the plant's own answer to it, by simulation
    pulse = project.simulate(reference=lambda t: np.zeros(t.size), load=np.eye(1, 20).T, duration=0.02)
    s = pulse.x[1:6, 0] + pulse.x[1:6, 1] / 2500.0
    assert curve[2][0] == pytest.approx(3.0 * np.sum(s**2))


@pytest.mark.parametrize("keys", [{}, {"lam": 2500.0, "tail": "rest", "window": [2, 6], "node_budget": 50}])
def test_a_horizon_project_is_compared(keys):
    content = tomllib.loads(HOT_GAS)
    content["simulation"]["duration"] = 0.1
    content["controller"] = {"objective": "horizon", "steps": 6, "preview": True} | keys
    project = Project(content)
    found = compare(project, budget=20)
    assert not found.skipped
    assert tuple(found.runs) == ("predictive", "predictive, no preview", *HORIZONS.values(), *KINDS)
    assert np.array_equal(found.runs["predictive"].u, project.simulate().u)
    assert found.laws["horizon, N = 5"].objective.lam == keys.get("lam")
    counts = [run.metrics()["switches"] for _, run in found.curves["predictive"]]
    assert counts[-1] < counts[0]
    html = " ".join(str(table.rows) for section in found.report("x").sections for table in section.tables)
    assert "2^6" in html


def test_a_horizon_that_the_core_cannot_hold_is_left_out_and_the_rest_goes_on():
    """Dead times 50 periods apart leave 14 of 64 steps, and too many waiting moves."""
    content = tomllib.loads(HOT_GAS)
    del content["reference"]
    content["plant"] = {"model": "state_space", "A": [[-1.0]], "B": [[1.0, -1.0]], "input_delay": [0.0, 0.05]}
    content["actuator"] = {"levels": [[0, 1], [0, 1]], "Ts": 1e-3}
    content["controller"] = {"Td": 0.01, "lam": 1.0}
    content["reference"] = {"kind": "constant", "value": 0.1}
    content["simulation"] = {"duration": 0.1}
    found = compare(Project(content), budget=20)
    assert {"horizon, N = 5", "horizon, N = 20"} <= set(found.skipped)
    assert set(found.runs) >= {"predictive", *KINDS}
    assert "horizon, N = 20" in str(found.report("x").sections[0].text)


def best_error(name, steps, prices, rate):
    """The least error of a horizon at no more than a switching rate."""
    path = EXAMPLES / f"{name}/project.toml"
    project = Project.read(path).with_seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        law = project.build_controller(**horizon_settings(project, steps))
    return min(total_rms(run) for _, run in price_curve(project, law, prices) if switching_rate(run) <= rate)


def test_where_one_step_is_enough():
    assert best_error("oven", 1, [3.0, 6.0], 0.065) < 1.05 * best_error("oven", 20, [0.0, 1.0], 0.065)
    assert best_error("inverter", 1, [0.0], 30000.0) < 1.01 * best_error("inverter", 10, [0.0], 30000.0)


def test_where_a_horizon_pays():
    assert best_error("attitude", 20, [0.1], 2.2) < 0.3 * best_error("attitude", 1, [100.0, 200.0], 2.2)
    assert best_error("chamber", 10, [0.3], 100.0) < 0.6 * best_error("chamber", 1, [20.0, 40.0, 80.0], 100.0)


def test_every_law_has_a_colour_of_its_own():
    names = {*LAWS, "predictive, no preview", *HORIZONS.values(), *KINDS}
    assert set(COLOURS) == names
    assert len(set(COLOURS.values())) == len(names) - 1  # a law with and one without preview never meet
    assert isinstance(previewed().controller.objective, Endpoint)


# From the command line ------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command line in a folder that holds project.toml: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "project.toml").write_text(re.sub(r"(?m)^duration = 0\.6", "duration = 0.1", HOT_GAS))

    def call(*arguments):
        with pytest.raises(SystemExit) as caught:
            app.main(list(arguments))
        out, err = capsys.readouterr()
        return caught.value.code, out, err

    return call


def test_the_verb_writes_report_pictures_traces_and_figures(run, tmp_path):
    code, out, err = run("compare", "project.toml", "--budget", "20", "--out", "out", "--json")
    assert (code, err) == (0, "")
    metrics = json.loads(out)
    assert metrics == json.loads((tmp_path / "out/metrics.json").read_text())
    assert set(metrics) == {*PREDICTIVE, *KINDS}
    for law in metrics.values():
        assert {"rms_error", "switches", "on_time", "curve"} <= set(law)
        assert all(set(point) == {"parameter", "rms_error", "switching_rate"} for point in law["curve"])
    for name in PREDICTIVE:
        assert set(metrics[name]["search"]) == {"nodes_median", "nodes_max", "optimal_percent"}
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"report.html", "compare.png", "compare.svg", "traces.png", "traces.svg"} <= names
    assert sum(name.endswith(".csv") for name in names) == len(metrics)
    assert tmp_path.name in (tmp_path / "out/report.html").read_text()


def test_without_json_it_prints_the_table(run, tmp_path):
    (tmp_path / "unstable.toml").write_text(UNSTABLE)
    code, out, _ = run("compare", "unstable.toml", "--budget", "20")
    assert code == 0
    assert "one step, N = 1" in out
    assert re.search(r"horizon, N = 20 +2\^20 +\d+ +\d+ +100\n", out)
    assert "Smith + PWM is left out: plant has the unstable pole 1" in out
    assert {path.name for path in tmp_path.iterdir()} == {"project.toml", "unstable.toml"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("compare",), "Missing argument"),
        (("compare", "none.toml"), "none.toml cannot be read"),
        (("compare", "broken.toml"), "[plant] has no key 'model'"),
        (("compare", "project.toml", "--budget", "3"), "'--budget': Input should be greater than or equal to 20"),
        (("compare", "project.toml", "--budget", "many"), "'--budget': Input should be a valid integer"),
        (("compare", "project.toml", "--budget", "20", "--out", "broken.toml"), "cannot be written"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(run, tmp_path, arguments, words):
    (tmp_path / "broken.toml").write_text(HOT_GAS.replace('model = "integrator_lag"', ""))
    code, out, err = run(*arguments, *([] if "--out" in arguments else ["--out", "out"]))
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"project.toml", "broken.toml"}


def test_nothing_is_left_when_writing_fails_midway(run, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device", "run.csv")

    monkeypatch.setattr("foreswitch._helpers.csv.write_whole", fail)
    code, _, err = run("compare", "project.toml", "--budget", "20", "--out", "out")
    assert code == 2
    assert "No space left" in err
    assert {path.name for path in tmp_path.iterdir()} == {"project.toml"}


# The project behind it ------------------------------------------------------------------------------------------------


def test_a_project_builds_and_tunes_baselines_for_its_own_actuator():
    content = tomllib.loads(HOT_GAS)
    content["actuator"] |= {"min_on": 0.004, "min_off": 0.003, "safe_level": 1.0}
    content["simulation"]["plant"] = content["plant"] | {"k": 12000.0}
    project = Project(content)
    law = project.build_baseline(Relay, hysteresis=3.0)
    assert (law.hysteresis, law.Ts, law.safe) == (3.0, 1e-3, [1])
    assert [list(dwell) for dwell in law.dwell] == [[4, 3]]
    assert law.plant is project.plant
    best = project.tune(PIPWM, budget=20, seed=5)
    assert best.run.plant is project.truth
    assert np.array_equal(best.run.u, project.simulate(best.law).u)
    assert best.parameters == project.tune(PIPWM, budget=20, seed=5).parameters
    assert best.parameters != project.tune(PIPWM, budget=20, seed=6).parameters


def test_a_seed_is_taken_where_the_file_names_none():
    free, fixed = hot_gas(noise=5.0), hot_gas(noise=5.0, seed=1)
    assert free.with_seed(1).seed == 1
    assert fixed.with_seed(2).seed == 1
    assert free.seed is None, "the project itself is left as it was"
    assert np.array_equal(free.with_seed(1).simulate().x, fixed.with_seed(2).simulate().x)
    assert not np.array_equal(free.with_seed(2).simulate().x, fixed.simulate().x)
