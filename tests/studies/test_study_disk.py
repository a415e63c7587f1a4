"""A study on disk: what is there is read, what is damaged done again, what is of another study refused."""

import json
import pickle
import shutil

import numpy as np
import pandas as pd
import pytest

import foreswitch as fsw
from foreswitch.project import Project
from foreswitch.studies.plan import planned
from foreswitch.studies.workers import run_rows
from studies.studying import GRID, OVER, project, same


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
