"""What the page lets one take away: byte for byte what the command line writes."""

import io
import json
import tomllib
import zipfile

import pytest
from hypothesis import given, strategies as st

from foreswitch.cli import app
from foreswitch.page import exports, jobs
from foreswitch.page.presets import dropped
from foreswitch.page.schema import schema, uses
from foreswitch.project.project import Project
from foreswitch.project.tables import TABLES
from page.projects import CHAMBER, EXAMPLES, FILTER, HORIZON, HOT, INVERTER, REAL_SENSOR, changed


def take(file, project, **more):
    head, content = jobs.done({"kind": "export", "file": file}, json.dumps({"project": project, **more}).encode())
    return head, content


def foreswitch(*arguments):
    with pytest.raises(SystemExit) as caught:
        app.main([str(each) for each in arguments])
    assert caught.value.code == 0


def nested(table):
    """Values of every kind that a table may hold."""
    return changed(
        INVERTER, ("simulation.hardware", {"stuck": [{"level": 1.0}, {"level": 0, "input": 1}], "drift": INVERTER["plant"]}),
        ("simulation.plant", INVERTER["plant"]), ("estimator", {"process_noise": 1.0, "measurement_noise": [1e-2, 1e-2]}),
    )  # fmt: skip


ALL = {
    **EXAMPLES,
    "horizon": HORIZON,
    "filter": FILTER,
    "hardware": changed(FILTER, ("simulation.hardware", REAL_SENSOR)),
    "valve": changed(HOT, ("simulation.disturbance", {"gain": 60.0, "high": 12000.0})),
    "nested": nested(None),
}


@pytest.mark.parametrize("name", ALL)
def test_a_project_file_holds_the_project(name):
    _, content = take("project.toml", ALL[name], name="mine")
    drawn = {"noise", "hardware"} & ALL[name]["simulation"].keys()  # with the seed that the page's picture has
    seeded = changed(ALL[name], ("simulation.seed", ALL[name]["simulation"].get("seed", 0))) if drawn else ALL[name]
    assert tomllib.loads(content.decode()) == seeded
    assert content == take("project.toml", ALL[name], name="mine")[1]


def test_a_project_file_says_what_its_keys_mean():
    text = take("project.toml", HOT)[1].decode()
    assert "switching period [s]" in text
    assert max(map(len, text.splitlines())) < 250


@pytest.mark.parametrize("options", [{}, {"delay_error": 4e-4, "gain_error": 0.07}], ids=["as it is", "with errors"])
@pytest.mark.parametrize("name", ["hot_gas", "chamber", "valve", "horizon"])
def test_files_are_those_of_the_command_line(name, options, tmp_path):
    """For the project file that is exported beside them, the truth of the options included."""
    (tmp_path / "mine.toml").write_bytes(take("project.toml", ALL[name], options=options, name="mine")[1])
    foreswitch("simulate", tmp_path / "mine.toml", "--out", tmp_path / "run")
    head, report = take("report.html", ALL[name], options=options, name="mine")
    assert report == (tmp_path / "run/report.html").read_bytes()
    assert (head["name"], head["type"]) == ("mine.html", "text/html; charset=utf-8")

    foreswitch("export", tmp_path / "mine.toml", "c", tmp_path / "firmware", "--name", "mine")
    written = {path.relative_to(tmp_path / "firmware").as_posix(): path.read_bytes()
               for path in (tmp_path / "firmware").rglob("*") if path.is_file()}  # fmt: skip
    archive = zipfile.ZipFile(io.BytesIO(take("firmware.zip", ALL[name], options=options, name="mine")[1]))
    assert {entry.removeprefix("mine/"): archive.read(entry) for entry in archive.namelist()} == written


def test_an_fmu_is_that_of_the_command_line(tmp_path):
    (tmp_path / "mine.toml").write_bytes(take("project.toml", HOT)[1])
    foreswitch("export", tmp_path / "mine.toml", "fmu", tmp_path / "controller.fmu")
    head, content = take("controller.fmu", HOT)
    assert content == (tmp_path / "controller.fmu").read_bytes()
    assert head["name"] == "controller.fmu"


@pytest.mark.parametrize("name", ["", "2fast", "a b", "while", "../evil", 'a"b', "x" * 100, 3, None])
def test_a_name_is_an_identifier(name):
    head, content = take("project.toml", HOT, name=name)
    assert head["status"] == 422
    assert json.loads(content)["error"]["field"] == "name"


def test_a_broken_project_is_told_not_exported():
    for file in exports.FILES:
        head, content = take(file, changed(HOT, ("actuator.Ts", -1.0)))
        assert (head["status"], json.loads(content)["error"]["field"]) == (422, "actuator.Ts")


# TOML -----------------------------------------------------------------------------------------------------------------

KEYS = sorted(set(TABLES["plant"].model_fields))
NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63 - 1) | st.booleans()
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
VALUES = st.recursive(NUMBERS | TEXT, lambda inner: st.lists(inner, max_size=3), max_leaves=8)


@given(
    st.dictionaries(st.sampled_from(KEYS), VALUES),
    st.lists(st.dictionaries(st.sampled_from(["kind", "file"]), TEXT), min_size=1),
)
def test_any_table_is_read_back_as_it_was(plant, references):
    tables = {"plant": plant, "reference": references, "simulation": {"duration": 1, "hardware": {"drift": plant}}}
    assert tomllib.loads(exports.toml(tables)) == tables


# Dropped projects -----------------------------------------------------------------------------------------------------

SAMPLES = '[reference]\nkind = "samples"\nfile = "{file}"\nvalue = "p"\n'


def rest_of(project):
    return exports.toml({key: table for key, table in project.items() if key != "reference"})


@pytest.mark.parametrize(
    "file", ["ref.csv", "../../ref.csv", "/etc/ref.csv", "C:\\\\data\\\\ref.csv", "a/b/../ref.csv"]
)
def test_a_dropped_project_takes_its_files_by_name_wherever_they_lay(file):
    text = rest_of(HOT) + SAMPLES.format(file=file)
    tables = dropped({"toml": text, "files": {"some/where/ref.csv": "t,q,p\n0,9,1\n1,9,3\n"}})
    assert tables["reference"] == {"kind": "points", "times": [0.0, 1.0], "values": [1.0, 3.0]}
    assert Project(tables, None).simulate().r[0, 0] == 1.0


@pytest.mark.parametrize(
    ("text", "files", "field", "words"),
    [
        (SAMPLES.format(file="/etc/passwd"), {}, "reference.file", "'passwd'"),
        (SAMPLES.format(file="../x.csv"), {"y.csv": "t,p\n0,1\n"}, "reference.file", "'x.csv'"),
        (SAMPLES.format(file="x.csv"), {"x.csv": "t,q\n0,1\n"}, "reference.file", "x.csv has no column 'p'"),
        (SAMPLES.format(file="x.csv"), {"x.csv": "t,p\n0,one\n"}, "reference.file", "line 2"),
        (
            SAMPLES.format(file="x.csv"),
            {"x.csv": "t,p\n" + "".join(f"{i},1\n" for i in range(20001))},
            "reference.file",
            "thin",
        ),
        (SAMPLES.format(file=""), {"": ""}, "reference.file", "row"),
        ("[reference\n", {}, None, "TOML"),
    ],
)
def test_a_project_dropped_without_its_files_is_told(text, files, field, words):
    body = json.dumps({"toml": rest_of(HOT) + text, "files": files}).encode()
    head, content = jobs.done({"kind": "project"}, body)
    error = json.loads(content)["error"]
    assert (head["status"], error["field"]) == (422, field)
    assert words in error["message"]
    assert "/tmp" not in error["message"]


def test_a_dropped_project_that_is_broken_still_comes_through():
    """The page shows it, with the complaint beside the field."""
    tables = dropped({"toml": exports.toml(changed(CHAMBER, ("actuator.Ts", -1.0))), "files": {}})
    assert tables["actuator"]["Ts"] == -1.0


# What the fields mean -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[plant]\nk = 2026-11-22", "holds a date"),
        (f"[plant]\nk = [{'0.1234567890123, ' * 70000}]", "thin its points out"),
    ],
    ids=["date", "long"],
)
def test_what_no_request_can_hold_is_told_when_it_is_dropped(text, words):
    _, body = jobs.done({"kind": "project"}, json.dumps({"toml": text}).encode())
    assert words in json.loads(body)["error"]["message"]


def test_every_key_of_a_project_is_explained():
    found = schema()
    for name, table in TABLES.items():
        for key, field in table.model_fields.items():
            told = found[f"{name}.{key}"]
            assert told["description"] == (field.description or "")
            assert told["required"] == field.is_required()
    assert found["actuator.Ts"] == {
        "description": "switching period [s]", "unit": "s", "type": "number", "types": ["number"], "default": None,
        "required": True,
    }  # fmt: skip
    assert found["controller.tail"]["choices"] == ["rest", "zero", "hold"]
    assert found["actuator.min_on"]["types"] == ["number", "list"]
    assert set(uses()) >= {"plant", "controller", "reference"}
    json.dumps([found, uses()], allow_nan=False)
