"""Studies: every row is the single run, wherever, in whatever chunks and after whatever accidents it is computed."""

import importlib
import itertools
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings, strategies as st

import foreswitch as fsw
from foreswitch.cli import app
from foreswitch.project import Project
from foreswitch.studies.distributions import mixed, parsed
from foreswitch.studies.plan import KEYS, planned
from foreswitch.studies.workers import WorkersLost, run_rows
from systems import TWO_BY_TWO

STUDY = importlib.import_module("foreswitch.studies.result")
SWEEP = importlib.import_module("foreswitch.studies.sweep")
CONTENT = {
    "plant": {"model": "integrator_lag", "k": 16500.0, "c": 0.006, "input_delay": 0.005},
    "actuator": {"levels": [0, 1], "Ts": 0.001},
    "controller": {"Td": 0.02, "lam": 2500.0, "preview": "lag"},
    "reference": {"kind": "ramp", "slope": 4000.0},
    "simulation": {"duration": 0.06, "noise": [2.0, 50.0]},
}
GRID = {"controller.Td": [0.01, 0.02, 0.03], "gain_error": [-0.1, 0.1]}


def project(**tables):
    """The hot-gas project over 60 periods, with keys of its tables replaced."""
    return Project({name: table | tables.get(name, {}) for name, table in CONTENT.items()})


def same(one, other):
    """Row for row, bit for bit."""
    a, b = one.columns(), other.columns()
    assert list(a) == list(b)
    for name in a:
        assert np.array_equal(a[name], b[name]), name


@pytest.fixture
def chunks(monkeypatch):
    """Chunks of so many rows."""
    return lambda rows: monkeypatch.setattr(SWEEP, "chunk_rows", lambda plan, workers: rows)


# Each row is the single run -------------------------------------------------------------------------------------------


def words(*parts):
    """SplitMix64's finaliser over whole numbers, in Python's own arithmetic."""
    h, top = 0, 2**64 - 1
    for part in parts:
        h = ((h ^ part) + 0x9E3779B97F4A7C15) & top
        h = ((h ^ (h >> 30)) * 0xBF58476D1CE4E5B9) & top
        h = ((h ^ (h >> 27)) * 0x94D049BB133111EB) & top
        h ^= h >> 31
    return h


@given(*[st.integers(0, 2**64 - 1)] * 3)
@example(0, 0, 0)
def test_a_seed_depends_on_study_point_and_repeat_alone(seed, point, repeat):
    plan = planned(project(), GRID, 5, seed)
    assert plan.seeds(np.uint64(point), np.uint64(repeat)).tolist() == [words(seed, point, repeat)]
    assert mixed(seed, point, repeat).tolist() == [words(seed, point, repeat)]


def test_no_two_runs_share_a_seed():
    point, repeat = np.divmod(np.arange(400_000), 1000)
    assert len(np.unique(planned(project(), {}, 1000, 1).seeds(point, repeat))) == 400_000


def test_rows_are_runs_set_up_by_hand():
    table = fsw.study(project(), GRID, repeats=4, seed=7)
    assert len(table) == 24
    assert table.figures.shape == (24, 4)
    row = 0
    for Td in GRID["controller.Td"]:
        for gain in GRID["gain_error"]:
            for repeat in range(4):
                plant = fsw.Plant.integrator_lag(16500.0, 0.006, 0.005)
                law = fsw.Controller(plant, [0, 1], 1e-3, fsw.Endpoint(Td, 2500.0), preview="lag")
                run = fsw.simulate(
                    law, fsw.Ramp(4000.0), 0.06, noise=[2.0, 50.0], seed=words(7, row // 4, repeat),
                    plant=plant.replace(B=plant.B * (1.0 + gain)),
                )  # fmt: skip
                found = run.metrics()
                assert table.figures[row].tolist() == [found[name] for name in table.metrics]
                columns = {name: values[0] for name, values in table.columns(row, row + 1).items()}
                assert columns["controller.Td"] == Td
                assert columns["gain_error"] == gain
                assert (columns["point"], columns["repeat"]) == (row // 4, repeat)
                assert columns["seed"] == words(7, row // 4, repeat)
                row += 1


OVEN = {
    "plant": {"model": "fopdt", "K": 100.0, "T": 100.0, "input_delay": 20.0},
    "actuator": {"levels": [0, 1], "Ts": 1.0},
    "controller": {"Td": 20.0, "lam": 0.1},
    "estimator": {"process_noise": 0.01, "measurement_noise": 0.04},
    "reference": {"kind": "constant", "value": 40.0},
    "simulation": {"duration": 60.0, "noise": 0.2},
}
VENT = {"gain": 60.0, "high": 12000.0}
CASES = {
    "nothing": (CONTENT, {}),
    "true gain": (CONTENT, {"gain_error": fsw.Uniform(-0.2, 0.2), "delay_error": fsw.Normal(0.0, 1e-3, -0.004)}),
    "true plant": (CONTENT, {"simulation.plant.k": fsw.LogUniform(1e4, 2e4), "simulation.plant.input_delay": [0.0, 0.01]}),
    "start": (CONTENT | {"simulation": CONTENT["simulation"] | {"x0": [0.0, 0.0]}}, {
        "simulation.x0.0": fsw.Uniform(0.0, 10.0), "gain_error": [0.1]}),
    "whole start": (CONTENT, {"simulation.x0": fsw.OneOf([[0.0, 0.0], [5.0, 0.0]])}),
    "start and truth": (CONTENT | {"simulation": CONTENT["simulation"] | {"x0": [0.0, 0.0]}}, {
        "simulation.x0.1": fsw.Uniform(0.0, 10.0), "gain_error": fsw.Uniform(-0.1, 0.1)}),
    "noise": (CONTENT, {"simulation.noise": fsw.Uniform(0.0, 20.0)}),
    "one state's noise": (CONTENT, {"simulation.noise.1": fsw.Uniform(0.0, 90.0)}),
    "per point": (CONTENT, {"simulation.noise": fsw.Uniform(0.0, 20.0, per="point"), "controller.Td": [0.01, 0.02]}),
    "law": (CONTENT, {"controller.Td": fsw.Uniform(0.01, 0.03), "gain_error": fsw.Uniform(-0.1, 0.1)}),
    "words": (CONTENT, {"controller.preview": fsw.OneOf([True, False, "lag"]), "controller.tail": ["rest", "zero"]}),
    "hardware": (CONTENT, {"hardware.opening": fsw.Uniform(0.0, 3e-3), "hardware.missing": [0.0, 0.2]}),
    "levels": (CONTENT, {"actuator.levels": [[0, 1], [0, 0.5, 1]], "actuator.Ts": [0.001, 0.002]}),
    "estimator": (OVEN, {"delay_error": fsw.Uniform(-3.0, 3.0), "estimator.process_noise": [0.01, 0.1]}),
    "vent": (CONTENT | {
        "plant": CONTENT["plant"] | {"E": [[-1.0], [0.0]]},
        "simulation": CONTENT["simulation"] | {"disturbance": VENT}}, {"gain_error": fsw.Uniform(-0.2, 0.2)}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_row_is_its_run_whatever_varies(name):
    """Some go to C all at once, some with a plant each, some one by one."""
    content, over = CASES[name]
    # fewer runs than it takes for all draws of one point to be laid out at once, and one point more than one chunk
    table = fsw.study(Project(content), over, repeats=5, seed=3)
    for row in range(len(table)):
        run = table.run(row)
        values = table.columns(row, row + 1)
        for metric in table.metrics:
            assert run.metrics()[metric] == values[metric][0], (row, metric)
    if table.plan.draws and not name.startswith(("per", "words")):
        assert len(np.unique(table.figures[:5, 0])) > 1


def test_more_plants_than_are_laid_out_at_once():
    table = fsw.study(project(), {"gain_error": "uniform(-0.2, 0.2)"}, repeats=300, seed=3)
    for row in (0, 127, 128, 299):
        assert table.run(row).metrics()["rms_error"] == table.figures[row, 0]


def test_errors_are_the_truths_from_the_model():
    run = fsw.study(project(), {"gain_error": [0.25], "delay_error": [0.0021]}).run(0)
    assert run.plant.B[1, 0] == 1.25 * 16500.0 / 0.006
    assert run.plant.input_delay[0] == 0.005 + 0.0021
    several = Project(
        CONTENT
        | {
            "plant": {"model": "state_space", "A": TWO_BY_TWO.A.tolist(), "B": TWO_BY_TWO.B.tolist(),
                      "C": TWO_BY_TWO.C.tolist(), "input_delay": [0.1, 0.2]},
            "actuator": {"levels": [[0, 1], [0, 1]], "Ts": 0.1},
            "controller": {"Td": 0.4, "lam": 1.0},
            "reference": [{"kind": "constant", "value": 0.5}] * 2,
            "simulation": {"duration": 2.0},
        }
    )  # fmt: skip
    table = fsw.study(several, {"gain_error": [[0.1, -0.1]], "delay_error": [0.05]})
    truth = table.run(0).plant
    np.testing.assert_allclose(truth.B, TWO_BY_TWO.B * [1.1, 0.9])
    np.testing.assert_allclose(truth.input_delay, [0.15, 0.25])
    assert table.metrics == (
        "rms_error_1", "rms_error_2", "max_error_1", "max_error_2", "switches_1", "switches_2", "on_time_1", "on_time_2"
    )  # fmt: skip
    assert table.columns()["gain_error"].tolist() == ["[0.1, -0.1]"]


def test_a_truth_that_is_not_in_the_file_starts_as_the_model():
    table = fsw.study(project(), {"simulation.plant.c": [0.009], "plant.k": [12000.0]})
    run = table.run(0)
    assert run.plant.B[1, 0] == pytest.approx(12000.0 / 0.009)


# Chunks and draws -----------------------------------------------------------------------------------------------------

OVER = GRID | {"simulation.noise": fsw.Uniform(0.0, 4.0), "delay_error": fsw.Normal(0.0, 1e-3)}


@settings(max_examples=15)
@given(st.lists(st.integers(1, 41), max_size=6, unique=True), st.integers(0, 2**64 - 1))
def test_any_chunking_gives_the_same_rows(cuts, seed):
    plan = planned(project(simulation={"duration": 0.01}), OVER, 7, seed)
    whole = run_rows(plan, Path(), (0, plan.rows))
    edges = [0, *sorted(cuts), plan.rows]
    parts = [run_rows(plan, Path(), piece, 1) for piece in itertools.pairwise(edges)]
    assert np.array_equal(np.vstack(parts), whole)
    assert len(np.unique(whole[:, 0])) == plan.rows


@given(st.integers(0, 2**64 - 1))
def test_a_draw_depends_on_its_key_alone(seed):
    one = planned(project(), GRID | {"simulation.noise": fsw.Uniform(0.0, 4.0)}, 7, seed)
    more = planned(project(), GRID | {"gain_error": fsw.Uniform(0.0, 4.0), "simulation.noise": "uniform(0,4)"}, 9, seed)
    point, repeat = [0, 3, 3], [6, 0, 6]
    assert np.array_equal(one.drawn("simulation.noise", point, repeat), more.drawn("simulation.noise", point, repeat))
    assert not np.isin(more.drawn("gain_error", point, repeat), one.drawn("simulation.noise", point, repeat)).any()
    hardware = planned(project(), {"hardware.late": "uniform(0,1)"}, 9, seed).drawn("hardware.late", 0, 1)
    whole = planned(project(), {"simulation.hardware.late": "uniform(0,1)"}, 9, seed)
    assert whole.drawn("simulation.hardware.late", 0, 1) == hardware


def test_draws_have_their_distribution():
    def drawn(distribution):
        plan = planned(project(), {"simulation.noise": distribution}, 20_000, 5)
        return plan.drawn("simulation.noise", 0, np.arange(20_000))

    from scipy import stats

    for given_, expected in (
        (fsw.Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (fsw.LogUniform(0.01, 10.0), stats.loguniform(0.01, 10.0)),
        (fsw.Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
        (fsw.Normal(2.0, 0.5, 1.9, 3.0), stats.truncnorm(-0.2, 2.0, 2.0, 0.5)),
    ):
        assert stats.kstest(drawn(given_), expected.cdf).pvalue > 0.01, given_
    values, counts = np.unique(drawn(fsw.OneOf([1, 2, 4])), return_counts=True)
    assert values.tolist() == [1, 2, 4]
    assert np.abs(counts / 20_000 - 1 / 3).max() < 0.02


def test_one_draw_per_point_is_shared_by_its_repeats():
    over = GRID | {"simulation.noise": fsw.Uniform(0.0, 4.0, per="point")}
    noise = fsw.study(project(), over, repeats=3).columns()["simulation.noise"].reshape(6, 3)
    assert (noise == noise[:, :1]).all()
    assert len(np.unique(noise)) == 6


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("1, 2.5,-3e-2", [1, 2.5, -0.03]),
        ("false, true, lag", [False, True, "lag"]),
        ("[0, 1], [0, 0.5, 1]", [[0, 1], [0, 0.5, 1]]),
        ("'a, b', c", ["a, b", "c"]),
        (".5, 1.", [0.5, 1.0]),
        ("linspace(0, 1, 3)", [0.0, 0.5, 1.0]),
        ("geomspace(1, 100, 3)", [1.0, 10.0, 100.0]),
        ("uniform(0,4)", fsw.Uniform(0, 4)),
        ("Uniform(0, 4, per=point)", fsw.Uniform(0, 4, per="point")),
        ("loguniform(1e-3, 1)", fsw.LogUniform(1e-3, 1)),
        ("normal(1, 0.1)", fsw.Normal(1, 0.1)),
        ("normal(1, 0.1, 0, 2)", fsw.Normal(1, 0.1, 0, 2)),
        ("oneof(a, 1)", fsw.OneOf(["a", 1])),
    ],
)
def test_values_and_distributions_as_text(text, meaning):
    assert parsed(text) == meaning


# Mistakes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"controler.Td": [1.0]}, "unknown key 'controler.Td'; did you mean 'controller.Td'"),
        ({"Td": [1.0]}, "unknown key 'Td'; did you mean 'controller.Td'"),
        ({"delay_eror": [1.0]}, "did you mean 'delay_error'"),
        ({"plant": [1.0]}, "unknown key 'plant'"),
        ({"simulation.seed": [1]}, "simulation.seed cannot be varied"),
        ({"controller.Td": 0.02}, "controller.Td is 0.02; give a list of values, or a distribution"),
        ({"controller.Td": []}, "controller.Td has no values"),
        ({"controller.Td": [0.01, 0.01]}, "lists 0.01 twice"),
        ({"controller.Td": "0.01,,0.02"}, "has an empty entry"),
        ({"controller.Td": "[0.01"}, "is not a value"),
        ({"controller.Td": "unifrom(0, 1)"}, "calls 'unifrom'; did you mean 'uniform'"),
        ({"controller.Td": "uniform(1)"}, r"give uniform\(low, high\)"),
        ({"controller.Td": "uniform(2, 1)"}, "low is 2 and high 1"),
        ({"controller.Td": "uniform(1, 2, per=step)"}, "per is 'step'; give 'run' or 'point'"),
        ({"controller.Td": "uniform(a, b)"}, "high is 'b'"),
        ({"hardware.late": [0.0], "simulation.hardware.late": [0.1]}, "which set the same value"),
        ({"simulation.noise": [1.0], "simulation.noise.0": [2.0]}, "which set the same value"),
        ({"controller.Td": [0.02, 1e-9]}, r"point 2 of 2 \(controller.Td = 1e-09\): Td is 1e-09"),
        ({"controller.Td": [0.02, "long"]}, r"point 2 of 2 \(controller.Td = long\): controller.Td is 'long'"),
        ({"simulation.noise": [[1.0, 2.0, 3.0]]}, r"point 1 of 1 \(simulation.noise = \[1.0, 2.0, 3.0\]\): noise"),
        ({"simulation.x0": [[1.0, 2.0, 3.0]]}, r"point 1 of 1 .* x0"),
        ({"simulation.noise": "uniform(-1, 1)"}, r"point 1 of 1, run \d+ \(simulation.noise = -0.\d+\): noise is"),
        ({"simulation.noise.7": [1.0]}, "'simulation.noise.7' leads nowhere"),
        ({"reference.0.slope": [1.0]}, "'reference.0.slope' leads nowhere"),
        ({"plant.k.x": [1.0]}, "unknown key 'plant.k.x'"),
        ({"delay_error": [-0.006]}, "give at least -0.005"),
        ({"delay_error": [0.0], "simulation.plant.k": [1.0]}, "remove one of them"),
        ({"reference.kind": ["samples"], "reference.file": ["no.csv"]}, "point 1 of 1 .*no.csv"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(over, message, tmp_path, monkeypatch):
    monkeypatch.setattr(SWEEP, "run_pieces", lambda *_: pytest.fail("it ran"))
    base = project()
    if "reference.file" in over:
        base = Project(CONTENT | {"reference": {"kind": "constant", "value": 1.0}})
        over = {"reference": [0]} and over
    with pytest.raises(ValueError, match=message):
        fsw.study(base, over, repeats=40, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"repeats": 0}, "repeats is 0"),
        ({"repeats": True}, "repeats is True"),
        ({"repeats": 2.0}, "repeats is 2.0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": None}, "seed is None"),
        ({"scheduler": "threads"}, "scheduler is 'threads'; give None"),
        ({"over": [1]}, r"over is \[1\]"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        fsw.study(project(), **options)


def test_every_key_of_a_project_file_can_be_varied():
    """But the seed; the names are those that the documentation of the project file lists."""
    assert {"actuator.levels", "controller.lam", "simulation.hardware.stuck.level", "simulation.plant.B"} < set(KEYS)
    assert "simulation.seed" not in KEYS
    assert all(meaning.sentence for meaning in KEYS.values())


# Tables and pictures --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def table():
    return fsw.study(project(), GRID | {"simulation.noise": "uniform(0, 4)"}, repeats=20, seed=1)


def test_tables_agree(table, tmp_path):
    frame = table.to_frame()
    assert list(frame) == [
        "point", "repeat", "controller.Td", "gain_error", "simulation.noise", "seed", "rms_error", "max_error", "switches",
        "on_time",
    ]  # fmt: skip
    table.to_csv(tmp_path / "runs.csv")
    table.to_parquet(tmp_path / "runs.parquet")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "runs.csv", dtype={"seed": np.uint64}), frame)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "runs.parquet"), frame)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs.csv", "runs.parquet"]


def test_tables_are_written_in_blocks(table, tmp_path, monkeypatch):
    table.to_csv(tmp_path / "whole.csv")
    monkeypatch.setattr(STUDY, "BLOCK", 7)
    table.to_csv(tmp_path / "blocks.csv")
    table.to_parquet(tmp_path / "blocks.parquet")
    assert (tmp_path / "whole.csv").read_bytes() == (tmp_path / "blocks.csv").read_bytes()
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "blocks.parquet"), table.to_frame())


def test_the_summary_is_that_of_pandas(table):
    summary = pd.DataFrame(table.quantiles((0.05, 0.5, 0.975)))
    grouped = table.to_frame().groupby(["controller.Td", "gain_error"])
    for metric in table.metrics:
        for name, share in (("q05", 0.05), ("q50", 0.5), ("q97.5", 0.975)):
            np.testing.assert_allclose(summary[f"{metric}_{name}"], grouped[metric].quantile(share), rtol=1e-12)
    assert len(summary) == 6
    with pytest.raises(ValueError, match="quantiles is"):
        table.quantiles([2.0])


def drawn_lines(figure):
    [axes] = [axes for axes in figure.axes if axes.get_xlabel()]
    return axes


def test_pictures_show_what_was_computed(table):
    summary = table.quantiles()
    heat = table.plot("switches")
    [mesh] = heat.axes[0].collections
    assert np.array_equal(np.asarray(mesh.get_array()), summary["switches_q50"].reshape(3, 2))
    assert heat.axes[0].get_ylabel() == "controller.Td [s]"
    line = drawn_lines(table.plot("max_error", at={"gain_error": 0.1}))
    assert line.get_lines()[0].get_ydata().tolist() == summary["max_error_q50"].reshape(3, 2)[:, 1].tolist()
    assert line.get_xlabel() == "controller.Td [s]"
    spread = drawn_lines(table.plot(at={"gain_error": 0.1, "controller.Td": 0.02}))
    assert sum(patch.get_height() for patch in spread.patches) == 20


def test_pictures_of_other_shapes():
    three = fsw.study(project(simulation={"duration": 0.01}), GRID | {"controller.tail": ["rest", "zero"]})
    figure = three.plot()
    assert sum(bool(axes.collections) for axes in figure.axes) >= 2
    four = fsw.study(project(simulation={"duration": 0.01}), {**three.plan.axes, "simulation.noise": [0.0, 2.0]})
    with pytest.raises(ValueError, match="4 axes are free"):
        four.plot()
    four.plot(at={"simulation.noise": 2.0})
    words = fsw.study(project(simulation={"duration": 0.01}), {"controller.tail": ["rest", "zero"]}, repeats=3)
    assert [tick.get_text() for tick in drawn_lines(words.plot()).get_xticklabels()] == ["rest", "zero"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("rms",), "metric is 'rms'; known are max_error"),
        ((None, {"gain_error": 3.0}), "at has gain_error = 3; its values are -0.1, 0.1"),
        ((None, {"gain": 3.0}), "at has 'gain', which is not an axis; known are controller.Td, gain_error"),
    ],
)
def test_pictures_of_what_is_not_there_are_refused(table, arguments, message):
    metric, at = (*arguments, None)[:2]
    with pytest.raises(ValueError, match=message):
        table.plot(metric, at=at)


def test_a_run_that_is_not_there_is_refused(table):
    with pytest.raises(ValueError, match=r"row is 120; give one from 0 to 119"):
        table.run(120)


def test_a_study_shows_itself(table):
    assert repr(table).splitlines() == [
        "Study",
        "├─ controller.Td     0.01, 0.02, 0.03",
        "├─ gain_error        -0.1, 0.1",
        "├─ simulation.noise  uniform(0, 4), one per run",
        "└─ runs              6 point(s), 20 repeat(s), seed 1",
    ]


# On disk --------------------------------------------------------------------------------------------------------------


def test_a_finished_study_is_read_not_run(tmp_path, monkeypatch):
    first = fsw.study(project(), OVER, repeats=4, out=tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"chunks", "study.json", "runs.parquet"}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out/runs.parquet"), first.to_frame())
    monkeypatch.setattr("foreswitch.studies.workers.run_rows", lambda *_: pytest.fail("it ran"))
    same(fsw.study(project(), OVER, repeats=4, out=tmp_path / "out", scheduler="tcp://127.0.0.1:1"), first)


def test_missing_and_damaged_chunks_are_done_again(tmp_path, chunks):
    chunks(3)
    first = fsw.study(project(), OVER, repeats=2, out=tmp_path)
    files = sorted((tmp_path / "chunks").iterdir())
    assert len(files) == 4
    files[1].unlink()
    files[2].write_bytes(files[2].read_bytes()[:-5])
    (tmp_path / "chunks/.000000000003.npy.abc").write_bytes(b"half")
    times = [files[i].stat().st_mtime_ns for i in (0, 3)]
    chunks(5)  # another machine would choose other chunks
    same(fsw.study(project(), OVER, repeats=2, out=tmp_path), first)
    assert sorted((tmp_path / "chunks").iterdir()) == files
    assert [files[i].stat().st_mtime_ns for i in (0, 3)] == times


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"repeats": 3}, "its repeats differ: 2, not 3"),
        ({"seed": 1}, "its seed differs: 0, not 1"),
        ({"over": GRID | {"gain_error": [0.1, -0.1]}}, "its over differs"),
        ({"over": dict(reversed(GRID.items()))}, "its over differs"),
        ({"project": project(plant={"k": 1e4})}, "its project differs"),
    ],
)
def test_the_folder_of_another_study_is_refused(tmp_path, change, message):
    arguments = {"project": project(), "over": GRID, "repeats": 2}
    fsw.study(**arguments, out=tmp_path)
    with pytest.raises(ValueError, match=f"holds another study \\({message}\\); give another folder"):
        fsw.study(**(arguments | change), out=tmp_path)


def test_another_version_is_another_study(tmp_path):
    fsw.study(project(), out=tmp_path)
    manifest = json.loads((tmp_path / "study.json").read_text())
    manifest["study"]["foreswitch"] = "0.0.1"
    (tmp_path / "study.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match="its version of foreswitch differs"):
        fsw.study(project(), out=tmp_path)
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(ValueError, match="is not the manifest of a study"):
        fsw.study(project(), out=tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="a file; give a folder"):
        fsw.study(project(), out=tmp_path / "file")


@pytest.fixture
def programme(tmp_path):
    """A project whose reference is a file beside it."""
    (tmp_path / "p.csv").write_text("t,p\n0,0\n0.03,90\n0.06,100\n")
    (tmp_path / "q.csv").write_text("t,p\n0,0\n0.03,10\n0.06,90\n")
    content = CONTENT | {"reference": {"kind": "samples", "file": "p.csv"}}
    return Project(content, tmp_path)


def test_files_travel(programme, tmp_path):
    over = {"reference.file": ["p.csv", "q.csv"], "reference.between": fsw.OneOf(["pchip", "hold"])}
    plan = planned(programme, over, 6, 1)
    carried = pickle.loads(pickle.dumps(plan.carried(tmp_path)))
    here = run_rows(plan, tmp_path, (0, 12))
    for name in ("p.csv", "q.csv"):
        (tmp_path / name).unlink()
    from foreswitch.studies.workers import unpacked

    with unpacked(carried) as folder:
        assert np.array_equal(run_rows(carried, folder, (0, 12)), here)


def test_a_changed_file_is_another_study(programme, tmp_path):
    fsw.study(programme, out=tmp_path / "out")
    shutil.copy(tmp_path / "q.csv", tmp_path / "p.csv")
    with pytest.raises(ValueError, match="holds another study"):
        fsw.study(Project(programme.file.model_dump(exclude_unset=True), tmp_path), out=tmp_path / "out")


# Accidents ------------------------------------------------------------------------------------------------------------

SLOW = """
import importlib, json, sys, time
import foreswitch as fsw
from foreswitch import cli
from foreswitch.project import Project
module = importlib.import_module("foreswitch.studies.sweep")
module.chunk_rows = lambda plan, workers: 7
content, over, out = json.loads(sys.argv[1])
fsw.study(Project(content), over, repeats=30, seed=5, out=out, progress=lambda share, what: time.sleep(0.1))
"""


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)


def test_a_killed_study_goes_on_where_it_was(tmp_path):
    over, out = GRID | {"simulation.noise": "uniform(0, 4)"}, tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", SLOW, json.dumps([CONTENT, over, str(out)])])
    try:
        wait_for(lambda: len(list(out.glob("chunks/[0-9]*.npy"))) >= 4)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    kept = {path: path.stat().st_mtime_ns for path in out.glob("chunks/[0-9]*.npy")}
    assert not (out / "runs.parquet").exists()
    assert 4 <= len(kept) < 26
    seen = []
    table = fsw.study(project(), over, repeats=30, seed=5, out=out, progress=lambda share, what: seen.append(share))
    same(table, fsw.study(project(), over, repeats=30, seed=5))
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert seen == sorted(seen)
    assert seen[1] >= 4 * 7 / 180
    assert seen[-1] == 1.0


class Killer:
    """Ends one of some processes at the first sign of progress."""

    def __init__(self, victims):
        self.victims, self.killed = victims, None

    def __call__(self, share, what):
        if self.killed is None and what == "running" and share > 0.0:
            self.killed = self.victims()[0].pid
            os.kill(self.killed, signal.SIGKILL)


def test_killed_processes_change_nothing(chunks):
    chunks(20)
    over = GRID | {"simulation.noise": "uniform(0, 4)"}
    killer = Killer(active_children)
    table = fsw.study(project(), over, repeats=50, seed=5, scheduler="processes", progress=killer)
    assert killer.killed is not None
    assert active_children() == []
    same(table, fsw.study(project(), over, repeats=50, seed=5))


def test_processes_that_always_die_end_the_study_in_words(tmp_path, chunks):
    chunks(20)
    stop = threading.Event()

    def reap():
        while not stop.wait(0.05):
            for child in active_children():
                os.kill(child.pid, signal.SIGKILL)

    thread = threading.Thread(target=reap)
    thread.start()
    try:
        with pytest.raises(
            WorkersLost, match=r"died 3 times in a row, last with runs 1 to 20; .* same out to continue"
        ):
            fsw.study(project(), GRID, repeats=50, scheduler="processes", out=tmp_path / "out")
    finally:
        stop.set()
        thread.join()
    same(fsw.study(project(), GRID, repeats=50, out=tmp_path / "out"), fsw.study(project(), GRID, repeats=50))


# Dask -----------------------------------------------------------------------------------------------------------------


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and two workers, each a program of its own, on ports that the system gives them."""
    environment = os.environ | {"DASK_CONFIG": str(tmp_path)}
    (tmp_path / "elsewhere").mkdir()

    def start(verb, *options):
        command = [sys.executable, "-m", "dask", verb, *options, "--no-dashboard"]
        with open(tmp_path / f"{verb}.log", "a") as log:
            return subprocess.Popen(command, env=environment, cwd=tmp_path / "elsewhere", stdout=log, stderr=log)

    file = tmp_path / "scheduler.json"
    programs = [start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))]
    try:
        wait_for(file.exists)
        wait_for(lambda: file.read_text().rstrip().endswith("}"))
        address = json.loads(file.read_text())["address"]
        for _ in range(2):
            programs.append(
                start("worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--memory-limit", "0",
                      "--local-directory", str(tmp_path / "elsewhere"))
            )  # fmt: skip
        yield address, programs
    finally:
        for program in programs:
            program.kill()
            program.wait()


def test_a_cluster_that_loses_a_worker_changes_nothing(cluster, programme, tmp_path, chunks):
    """Workers see no file of the project; one dies once the first chunk is done."""
    address, programs = cluster
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    over = {"controller.Td": [0.01, 0.02, 0.03], "simulation.noise": "uniform(0, 4)"}
    serial = fsw.study(programme, over, repeats=100, seed=5)
    chunks(10)
    killer = Killer(lambda: programs[1:2])

    def watch(share, what):
        for file in tmp_path.glob("*.csv") if what == "running" else ():
            file.unlink()
        killer(share, what)

    out = tmp_path / "out"
    same(fsw.study(programme, over, repeats=100, seed=5, scheduler=address, out=out, progress=watch), serial)
    assert killer.killed == programs[1].pid
    programs[1].wait(5)
    assert programs[2].poll() is None
    assert len(list(out.glob("chunks/*.npy"))) == 30


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr("foreswitch.studies.workers.PATIENCE", 0.5)
    with pytest.raises(
        ValueError, match=r"scheduler 'tcp://127.0.0.1:9' does not answer .*; start one with 'dask scheduler'"
    ):
        fsw.study(project(), scheduler="tcp://127.0.0.1:9")


def test_without_dask_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"needs dask.distributed; install foreswitch\[dask\]"):
        fsw.study(project(), scheduler="tcp://127.0.0.1:9")


# Command line ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Run ``foreswitch study`` beside a project: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        app.main(["init", "."])
    capsys.readouterr()

    def run(*arguments):
        with pytest.raises(SystemExit) as caught:
            app.main(["study", "project.toml", *arguments])
        return caught.value.code, *capsys.readouterr()

    return run


VARIED = ("--over", "controller.Td=0.01,0.02", "--over", "gain_error=normal(0, 0.1)", "--repeats", "3", "--seed", "4")


def test_the_verb_writes_tables_and_a_report(call, tmp_path):
    code, out, err = call(*VARIED, "--out", "study", "--json")
    assert (code, err) == (0, "")
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "study/metrics.json").read_text())
    over = {"controller.Td": [0.01, 0.02], "gain_error": fsw.Normal(0.0, 0.1)}
    table = fsw.study("project.toml", over, repeats=3, seed=4)
    assert [point["rms_error_q50"] for point in summary["points"]] == table.quantiles()["rms_error_q50"].tolist()
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "study/runs.parquet"), table.to_frame())
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "study/summary.csv"), pd.DataFrame(table.quantiles()))
    pictures = {"rms_error", "max_error", "switches", "on_time", "drawn"}
    assert {path.stem for path in (tmp_path / "study").glob("*.png")} == pictures
    report = (tmp_path / "study/report.html").read_text()
    assert report.count("<svg") == len(pictures)
    assert "controller.Td" in report
    assert call(*VARIED, "--out", "study", "--json")[:2] == (0, out)


def test_the_verb_prints_a_table(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    code, out, err = call(*VARIED)
    assert (code, err) == (0, "")
    heads = out.splitlines()[1]
    assert heads.split() == ["Td", "[s]", "rms", "error", "5", "%", "95", "%", "largest", "switches", "on-time", "[s]"]
    assert "Medians of 3 runs." in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--over", "controller.Td"), "--over is 'controller.Td'; give KEY=VALUES"),
        (("--over", "controller.Td="), "--over is 'controller.Td='; give KEY=VALUES"),
        (("--over", "gain_error=1", "--over", "gain_error=2"), "--over stands twice for gain_error"),
        (("--over", "controller.td=1"), "did you mean 'controller.Td'"),
        (("--repeats", "0"), "repeats is 0"),
        (("--seed", "-1"), "seed is -1"),
        (("--scheduler", "threads"), "scheduler is 'threads'"),
        (("--out", "project.toml"), "out is project.toml, a file"),
    ],
)
def test_bad_usage_is_one_line_and_leaves_nothing(call, tmp_path, arguments, words):
    code, out, err = call(*arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["project.toml"]


def test_lost_workers_are_one_line_and_exit_code_1(call, monkeypatch):
    def lose(*_, **__):
        raise WorkersLost("worker processes died")

    monkeypatch.setattr(SWEEP, "study", lose)
    assert call() == (1, "", "foreswitch: worker processes died\n")


# Chunk sizes ----------------------------------------------------------------------------------------------------------


def test_chunks_are_few_and_not_longer_than_the_study():
    from foreswitch.studies.workers import LONG, chunk_rows

    plan = planned(project(), {}, 10**6, 0)
    rows = chunk_rows(plan, 1)
    begun = time.perf_counter()
    run_rows(plan, Path(), (0, rows))
    assert time.perf_counter() - begun < 10.0 * LONG
    assert 100 <= rows <= 10**6
    assert chunk_rows(planned(project(), {}, 3, 0), 8) == 3
