"""Studies: every row is the single run, in whatever chunks it is computed and of whatever draws."""

import itertools
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import foreswitch as fsw
from foreswitch.project import Project
from foreswitch.studies.distributions import mixed, parsed
from foreswitch.studies.plan import planned
from foreswitch.studies.workers import run_rows
from studies.studying import CONTENT, GRID, OVER, project
from systems import TWO_BY_TWO

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
