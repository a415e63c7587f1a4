"""The command line: what it writes, exit codes, one line on stderr, nothing half-written."""

import json
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from foreswitch.cli import app

HOT_GAS_KEYS = {"rms_error", "max_error", "lag", "rms_error_at_lag", "switches", "on_time"}


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command line in an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            app.main(list(arguments))
        out, err = capsys.readouterr()
        return caught.value.code, out, err

    return call


@pytest.fixture
def project(run):
    assert run("init", "valve")[0] == 0
    return "valve/project.toml"


def test_demo_writes_report_pictures_and_traces(run, tmp_path):
    code, out, err = run("demo", "--out", "demo", "--json")
    assert (code, err) == (0, "")
    metrics = json.loads(out)
    assert metrics == json.loads((tmp_path / "demo/metrics.json").read_text())
    assert metrics["predictive"]["rms_error_at_lag"] < 3.0 < metrics["dead time ignored"]["rms_error_at_lag"]
    assert metrics["predictive, preview"]["rms_error"] == pytest.approx(3.0, abs=0.05)
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    pictures = {"pulse_record", "pulse_average", "rig", "tracking", "dead_time", "decision", "cyclic", "comparison"}
    pictures |= {"certificate"}
    assert {f"{picture}.{kind}" for picture in pictures for kind in ("png", "svg")} <= names
    assert sum(name.endswith(".csv") for name in names) == len(metrics) + 1 == 14
    report = (tmp_path / "demo/report.html").read_text()
    assert report.count("<svg") == len(pictures)
    # self-contained: nothing is loaded from anywhere
    assert not re.search(r"""(src|href)=["'](?!#)""", report)
    assert "url(http" not in report
    assert "@import" not in report


def test_the_demo_identifies_the_rig_and_tracks_it_from_its_pressure(run, tmp_path):
    assert run("demo", "--out", "demo")[0] == 0
    fit = json.loads((tmp_path / "demo/fit.json").read_text())
    for name, paper in (("k", 16500.0), ("c", 0.006), ("delay", 0.005)):
        assert fit["parameters"][name]["value"] == pytest.approx(paper, rel=0.05)
    metrics = json.loads((tmp_path / "demo/metrics.json").read_text())
    tracked = metrics["rig, identified, pressure only"]["rms_error"]
    assert tracked < 1.25 * metrics["predictive, preview"]["rms_error"]
    # the record it wrote is one that the verb identify takes
    code, out, _ = run("identify", "demo/pulses.csv", "--structure", "integrator+lag", "--json")
    assert code == 0
    assert json.loads(out)["parameters"]["c"]["value"] == pytest.approx(fit["parameters"]["c"]["value"], rel=1e-4)


# identify -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def pulses(tmp_path):
    """A record of a self-regulating plant, with a stretch in which the sensor was off."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.1)
    u = ((t % 20.0 > 3.0) & (t % 20.0 < 9.0)).astype(float)
    y, level = np.empty(t.size), 0.0
    for i in range(t.size):
        level += 0.1 / 2.0 * (5.0 * u[max(i - 8, 0)] - level)
        y[i] = 20.0 + level + 0.02 * rng.standard_normal()
    rows = [f"{a:.1f};{b:g};{'' if 30.0 <= a <= 32.0 else f'{c:.5f}'}" for a, b, c in zip(t, u, y, strict=True)]
    path = tmp_path / "pulses.csv"
    path.write_text("time [s];heater;T [degC]\n" + "\n".join(rows) + "\n")
    return path


def test_identify_writes_a_project_that_runs(run, pulses, tmp_path):
    arguments = ("identify", "pulses.csv", "--time", "time [s]", "--input", "heater", "--output", "T [degC]")
    code, out, err = run(*arguments, "--skip", "29.9:32.1", "--out", "oven")
    assert (code, err) == (0, "")
    assert "lag (chosen)" in out
    assert {path.name for path in (tmp_path / "oven").iterdir()} >= {"project.toml", "report.html", "fit.json"}
    fit = json.loads((tmp_path / "oven/fit.json").read_text())
    assert fit["structure"] == ["lag"]
    assert fit["parameters"]["K"]["value"] == pytest.approx(5.0, rel=0.02)
    assert fit["y_offset"][0] == pytest.approx(20.0, abs=0.05)
    text = (tmp_path / "oven/project.toml").read_text()
    assert 'input_names = ["heater"]' in text
    assert "[estimator]" in text
    assert run("simulate", "oven/project.toml")[0] == 0


BAD_RECORDS = {
    "empty": ("", "give a header row"),
    "header only": ("t,u,y\n", "give a header row"),
    "three samples": ("t,u,y\n0,0,0\n1,1,0\n2,1,1\n", "3 samples; at least 8"),
    "constant input": ("t,u,y\n" + "".join(f"{i},1,{i % 3}\n" for i in range(40)), "input u is 1 throughout"),
    "constant output": ("t,u,y\n" + "".join(f"{i},{i % 2},5\n" for i in range(40)), "output y is 5 throughout"),
    "instants twice": ("t,u,y\n" + "".join(f"{i // 2},{i % 2},{i}\n" for i in range(40)), "0 s twice"),
    "backwards": ("t,u,y\n" + "".join(f"{40 - i},{i % 2},{i}\n" for i in range(40)), "must ascend"),
    "gap": ("t,u,y\n" + "".join(f"{i},{i % 2},{'nan' if i == 7 else i}\n" for i in range(40)), "at t = 7 s"),
    "text": ("t,u,y\n" + "".join(f"{i},{i % 2},{'off' if i == 7 else i}\n" for i in range(40)), "holds 'off'"),
    "no such column": ("t,u\n" + "".join(f"{i},{i % 2}\n" for i in range(40)), "no column 3"),
}


@pytest.mark.parametrize("name", BAD_RECORDS)
def test_a_bad_record_is_one_sentence_and_nothing_is_written(run, tmp_path, name):
    text, words = BAD_RECORDS[name]
    (tmp_path / "pulses.csv").write_text(text)
    code, out, err = run("identify", "pulses.csv", "--out", "tank")
    assert (code, out) == (2, "")
    assert err.startswith("foreswitch: pulses.csv")
    assert words in err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"pulses.csv"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--structure", "integrator+lagg"), "has the term 'lagg'; did you mean 'lag'"),
        (("--skip", "3"), "--skip is '3'; give FROM:TO"),
        (("--skip", "5:3"), "must end after it starts"),
        (("--longest-delay", "-1"), "longest_delay is -1"),
    ],
)
def test_bad_wishes_for_a_fit_are_one_sentence(run, pulses, tmp_path, arguments, words):
    code, out, err = run("identify", "pulses.csv", "--skip", "29.9:32.1", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"pulses.csv"}


# simulate -------------------------------------------------------------------------------------------------------------


def test_certify_proves_the_demos_rise_and_says_what_it_bears(run, project, tmp_path):
    code, out, err = run("certify", project, "--out", "proof", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found == json.loads((tmp_path / "proof/certificate.json").read_text())
    assert found["holds"]
    assert found["error_bound"][0] == pytest.approx(8.70, abs=0.01)
    assert found["ideal_input"][1][0] == pytest.approx(0.19, abs=0.01)
    assert 0.0003 < found["margins"]["delay_error"][0] < 0.001
    assert {path.name for path in (tmp_path / "proof").iterdir()} == {
        "certificate.json", "certificate.png", "certificate.svg", "report.html",
    }  # fmt: skip
    assert (tmp_path / "proof/report.html").read_text().count("<svg") == 1


def test_certify_takes_errors_and_bears_them_in_the_bound(run, project):
    def bound(*options):
        return json.loads(run("certify", project, "--json", *options)[1])["error_bound"][0]

    exact = bound()
    for options in (["--delay-error", "0.0003"], ["--gain-error", "0.05"], ["--noise", "1.0"], ["--load", "0.001"]):
        assert bound(*options) > exact
    assert bound("--noise", "1.0", "--noise", "0.0") < bound("--noise", "1.0", "--noise", "30.0")


def test_what_is_not_proven_is_exit_code_1_with_the_reason(run, project, tmp_path):
    path = tmp_path / project
    path.write_text(path.read_text().replace("duration = 0.5 ", "duration = 0.05 "))
    code, out, err = run("certify", project)
    assert (code, err) == (1, "")
    assert "Not proven. The reference needs an ideal input" in out
    assert re.search(r"run through it at most 0\.\d+ times as fast", out)
    code, out, _ = run("certify", project, "--json")
    assert code == 1
    assert json.loads(out)["error_bound"] == [None]


def test_nothing_is_proven_around_a_valve_that_follows_the_output(run, project, tmp_path):
    path = tmp_path / project
    path.write_text(path.read_text().replace("# disturbance = {", "disturbance = {"))
    code, _, err = run("certify", project)
    assert code == 2
    assert "[simulation.disturbance] is a valve that follows the output" in err


def test_simulate_follows_the_users_own_reference(run, project, tmp_path):
    (tmp_path / "ref.csv").write_text("t,p\n0,0\n0.3,200\n")
    code, out, _ = run("simulate", project, "--reference", "ref.csv", "--out", "out", "--json")
    assert code == 0
    assert set(json.loads(out)) >= HOT_GAS_KEYS
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "metrics.json", "report.html", "run.csv", "run.png", "run.svg"
    }  # fmt: skip
    trace = (tmp_path / "out/run.csv").read_text().splitlines()
    assert trace[0].startswith("t [s],reference pressure [kPa],pressure [kPa],valve")
    assert len(trace) == 1 + 301, "the run is as long as the reference file"
    last = [float(cell) for cell in trace[-1].split(",")]
    assert last[1] == pytest.approx(200.0)
    assert abs(last[2] - 200.0) < 20.0


def test_json_is_valid_where_a_loop_runs_away(run, project, tmp_path):
    path = tmp_path / project
    path.write_text(re.sub(r"(?m)^\[simulation\]$", "[simulation]\nx0 = [1e308, 1e308]", path.read_text()))
    code, out, err = run("simulate", project, "--duration", "0.05", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert found["rms_error"] is None
    assert found["units"]["lag"] == "s"


def test_output_is_the_same_bytes_each_time(run, project, tmp_path):
    for folder in ("a", "b"):
        assert run("simulate", project, "--out", folder)[0] == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_init_refuses_to_overwrite(run, project, tmp_path):
    before = (tmp_path / project).read_bytes()
    code, _, err = run("init", "valve")
    assert code == 2
    assert "exists" in err
    assert (tmp_path / project).read_bytes() == before


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "give a header row"),
        ("t,p\n", "give a header row"),
        ("t\n0\n1\n", "no column 2"),
        ("t,p\n0,0\n1,abc\n", "column 'p' holds 'abc'"),
        ("t,p\n0,0\n1,nan\n", "column 'p' holds 'nan'"),
        ("t,p\n0,0\n1\n", "column 'p' holds ''"),
        ("t,p\n0,0\n2,1\n1,5\n", "times must ascend"),
        ("t,p\n0,0\n0,1\n", "times must ascend"),
        ("t,p\n-1,0\n", "t"),
    ],
)
def test_a_bad_reference_file_is_one_line_and_leaves_nothing(run, project, tmp_path, text, words):
    (tmp_path / "ref.csv").write_text(text)
    code, out, err = run("simulate", project, "--reference", "ref.csv", "--out", "out")
    assert (code, out) == (2, "")
    assert err.startswith("foreswitch: ")
    assert words in err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"valve", "ref.csv"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nope",), "No such command"),
        (("simulate",), "Missing argument"),
        (("simulate", "valve/project.toml", "--bogus"), "No such option"),
        (("simulate", "none.toml"), "none.toml cannot be read"),
        (("simulate", "broken.toml"), "not valid TOML"),
        (("simulate", "valve/project.toml", "--duration", "-1"), "duration is -1"),
        (("simulate", "valve/project.toml", "--out", "broken.toml"), "cannot be written"),
    ],
)
def test_bad_usage_is_exit_code_2_and_one_line(run, project, tmp_path, arguments, words):
    (tmp_path / "broken.toml").write_text("[plant\n")
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"valve", "broken.toml"}


@pytest.mark.parametrize("verb", ["demo", "init", "identify", "simulate", "compare", "study"])
def test_every_verb_has_help_with_an_example(run, verb):
    code, out, _ = run(verb, "--help")
    assert code == 0
    assert f"Example: foreswitch {verb}" in out


def test_nothing_is_left_when_writing_fails_midway(run, project, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device", "run.csv")

    monkeypatch.setattr("foreswitch._helpers.csv.write_whole", fail)
    code, _, err = run("simulate", project, "--out", "out")
    assert code == 2
    assert "No space left" in err
    assert {path.name for path in tmp_path.iterdir()} == {"valve"}


# A light door ---------------------------------------------------------------------------------------------------------


def seconds(*command):
    """The quickest of a few processes: what the machine does besides only adds."""
    best = float("inf")
    for _ in range(5):
        begun = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        best = min(best, time.perf_counter() - begun)
    return best


def test_help_costs_little_more_than_numpy():
    helped = seconds(sys.executable, "-c", "from foreswitch.cli import main; main(['--help'])")
    assert helped < 4.0 * seconds(sys.executable, "-c", "import numpy")


def test_the_command_loads_no_wing_before_a_verb_runs():
    script = "import sys; from foreswitch.cli import main; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout.split()
    heavy = {"numpy", "scipy", "matplotlib", "pydantic", "jinja2", "starlette", "rich", "pandas", "tomlkit"}
    assert "foreswitch.cli.sweeps" in loaded
    assert {name.split(".")[0] for name in loaded} & heavy == set()


def test_without_arguments_it_shows_help(run, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["foreswitch"])
    with pytest.raises(SystemExit) as caught:
        app.main()
    assert caught.value.code == 0
