"""Projects, tables and chunk sizes for the tests of studies."""

import pytest

import foreswitch as fsw
from foreswitch.project import Project
from studies.studying import CONTENT, GRID, SWEEP, project


@pytest.fixture
def chunks(monkeypatch):
    """Chunks of so many rows."""
    return lambda rows: monkeypatch.setattr(SWEEP, "chunk_rows", lambda plan, workers: rows)


@pytest.fixture(scope="module")
def table():
    return fsw.study(project(), GRID | {"simulation.noise": "uniform(0, 4)"}, repeats=20, seed=1)


@pytest.fixture
def programme(tmp_path):
    """A project whose reference is a file beside it."""
    (tmp_path / "p.csv").write_text("t,p\n0,0\n0.03,90\n0.06,100\n")
    (tmp_path / "q.csv").write_text("t,p\n0,0\n0.03,10\n0.06,90\n")
    content = CONTENT | {"reference": {"kind": "samples", "file": "p.csv"}}
    return Project(content, tmp_path)
