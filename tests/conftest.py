"""Every run draws the same examples, and leaves the cores to the test processes."""

import os
import re

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads on 3 x 3 matrices only wait for each other

import pytest
from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None, database=None, max_examples=40)
settings.load_profile("repeatable")


def pytest_configure(config):
    """What Hypothesis imports to report a failure must not end the session."""
    config.addinivalue_line("filterwarnings", "ignore:mypy_extensions:DeprecationWarning")


@pytest.fixture
def valve_line(tmp_path, monkeypatch, capsys):
    """The command line beside a new project, valve/project.toml: arguments -> exit code, standard output, errors."""
    from foreswitch.cli import app

    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as caught:
            app.main(list(arguments))
        out, err = capsys.readouterr()
        return caught.value.code, out, err

    assert call("init", "valve")[0] == 0
    return call


def pytest_terminal_summary(terminalreporter):
    """One line with the targets that could not be tried here, as test_targets.py tells them."""
    reasons = [str(report.longrepr) for report in terminalreporter.stats.get("skipped", [])]
    absent = sorted({hit[1] for reason in reasons for hit in re.finditer(r"target not here: ([^'\")]+)", reason)})
    if absent:
        terminalreporter.write_line(f"not run on this machine: {'; '.join(absent)}")
