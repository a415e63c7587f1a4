"""A dropped record: its columns guessed, its plant found, its mistakes told."""

import json

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch._helpers.json import plain_data
from foreswitch.page import jobs
from foreswitch.page.wire import unpack
from foreswitch.project import Project

RIG = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005, input_names="valve [-]", output_names="pressure [kPa]")
PULSES = fsw.PulseTest(Ts=1e-3, width=1e-3, spacing=0.06, number=12, lead=0.05)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "pulses.csv"
    PULSES.rehearse(RIG, noise=0.5).to_csv(path)
    return path


def columns(content):
    head, body = jobs.done({"kind": "columns"}, content)
    return head["status"], json.loads(body)


def identified(content, **query):
    head, body = jobs.done({"kind": "identify", "query": query}, content)
    return unpack(body) if head["status"] == 200 else (json.loads(body)["error"], None)


def test_columns_are_guessed(record):
    status, found = columns(record.read_bytes())
    assert status == 200
    assert found["columns"] == ["t", "valve [-]", "pressure [kPa]"]
    assert found["guess"] == {"time": "t", "input": "valve [-]", "output": "pressure [kPa]"}
    assert found["rows"] == record.read_text().count("\n") - 1


def test_columns_are_guessed_whatever_their_order():
    t, rng = np.arange(100) * 0.1, np.random.default_rng(1)
    table = np.column_stack([rng.normal(size=100), t % 2 < 1, np.full(100, 3.0), t])
    rows = "\n".join(";".join(f"{v:g}" for v in row) for row in table)
    status, found = columns(f"\ufeffy;on;spare;time\n{rows}".encode())
    assert (status, found["guess"]) == (200, {"time": "time", "input": "on", "output": "y"})


@pytest.mark.parametrize(
    "content",
    [b"", b"\n\n", b"t,u\n0,1", b"\xff\xfe\x00", b"a,b,c\n1,2,x\n", b"<html>", b"t," * 100 + b"\n" + b"1," * 100, b"1,2,3"],
    ids=["empty", "blank", "two", "binary", "word", "page", "wide", "no rows"],
)  # fmt: skip
def test_what_is_no_record_is_told(content):
    status, found = columns(content)
    assert status == (422 if content != b"1,2,3" else 200)
    if status == 422:
        assert "/tmp" not in found["error"]["message"]
        assert "\n" not in found["error"]["message"]
        error, arrays = identified(content)
        assert arrays is None
        assert "/tmp" not in error["message"]


def test_a_record_gives_the_plant_of_the_library(record):
    header, arrays = identified(record.read_bytes(), time=["t"], input=["2"], output=["pressure [kPa]"])
    fit = fsw.identify(fsw.Record.read_csv(record))
    assert header["fit"]["parameters"] == plain_data(
        {
            n: {"value": v, "standard_error": e, "unit": u}
            for (n, (v, e)), u in zip(fit.parameters.items(), ("s", "kPa/s", "s"), strict=True)
        }
    )
    assert header["fit"]["warnings"] == fit.warnings
    assert header["fit"]["structure"] == ["integrator+lag"]
    assert header["plant"]["input_delay"] == pytest.approx(fit.plant.input_delay[0], rel=1e-9)
    np.testing.assert_array_equal(arrays["y"], fit.record.y.T.astype(np.float32))
    np.testing.assert_array_equal(arrays["model"], fit.simulate(fit.record).T.astype(np.float32))
    assert arrays["t"].shape == (len(fit.record),)
    # the averaged pulse: as the model answers one, from its beginning
    assert header["pulse"]["count"] >= 10
    assert np.abs(arrays["pulse_mean"] - arrays["pulse_model"]).max() < 1.0
    assert arrays["pulse_mean"][0, -1] == pytest.approx(16.5, abs=1.0)
    assert Project(header["project"], None).plant.input_delay[0] == pytest.approx(fit.plant.input_delay[0], rel=1e-9)


def test_every_parameter_has_its_unit(record):
    fields, _ = identified(record.read_bytes(), structure=["integrator+lag"])
    assert {name: each["unit"] for name, each in fields["fit"]["parameters"].items()} == {
        "c": "s", "k": "kPa/s", "delay": "s"
    }  # fmt: skip
    fields, _ = identified(record.read_bytes().replace(b"valve [-]", b"duty [%]"), structure=["lag"])
    assert {name: each["unit"] for name, each in fields["fit"]["parameters"].items()} == {
        "T": "s", "K": "kPa/%", "delay": "s"
    }  # fmt: skip


def test_a_record_by_the_clock_is_drawn_from_its_beginning(record):
    """Single precision would hold all its instants for one."""
    head, *rows = record.read_text().splitlines()
    late = [f"{float(t) + 1.7e9:.4f},{more}" for t, _, more in (row.partition(",") for row in rows)]
    fields, arrays = identified("\n".join([head, *late]).encode(), structure=["integrator+lag"])
    assert arrays["t"][0] == 0.0
    assert (np.diff(arrays["t"]) > 0).all()
    assert fields["segments"] == [0.0]


def test_a_structure_may_be_wanted(record):
    assert identified(record.read_bytes(), structure=["integrator"])[0]["fit"]["structure"] == ["integrator"]
    assert "structure" in identified(record.read_bytes(), structure=["spring"])[0]["message"]


@pytest.mark.parametrize(
    ("query", "words", "field"),
    [
        ({"input": ["valve"]}, "valve", "input"),
        ({"output": ["valve"]}, "valve", "output"),
        ({"segment": ["valve"]}, "valve", "segment"),
        ({"time": ["99"]}, "column 99", "time"),
        ({"time": ["9" * 400]}, "no column", "time"),
        ({"structure": ["spring"]}, "'spring'", "structure"),
        ({"colour": ["red"]}, "'colour'", "colour"),
        ({"time": ["2"]}, "t holds", "time"),
    ],
)
def test_columns_that_are_not_there_are_told(record, query, words, field):
    error, arrays = identified(record.read_bytes(), **query)
    assert arrays is None
    assert words in error["message"]
    assert error["field"] == field
    assert len(error["message"]) < 410
