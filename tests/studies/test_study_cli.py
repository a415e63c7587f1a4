"""The verb study of the command line."""

import json

import pandas as pd
import pytest

import foreswitch as fsw
from foreswitch.cli import app
from foreswitch.studies.workers import WorkersLost
from studies.studying import SWEEP


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
