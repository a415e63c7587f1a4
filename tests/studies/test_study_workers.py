"""Studies on other processes and on a cluster: whatever dies, the rows are the same."""

import json
import os
import signal
import subprocess
import sys
import threading
from multiprocessing import active_children

import pytest

import foreswitch as fsw
from foreswitch.studies.workers import WorkersLost
from studies.studying import CONTENT, GRID, Killer, project, same, wait_for

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
