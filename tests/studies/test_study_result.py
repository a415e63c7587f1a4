"""A study's tables, pictures and runs."""

import importlib

import numpy as np
import pandas as pd
import pytest

import foreswitch as fsw
from studies.studying import GRID, project

STUDY = importlib.import_module("foreswitch.studies.result")


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
