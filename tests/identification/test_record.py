"""Records: what they hold, how they are cut, and one sentence for each that cannot be used."""

import re

import numpy as np
import pytest

import foreswitch as fsw

T = np.arange(20.0)
U = (T % 6 >= 3).astype(float)
Y = np.cumsum(U) + 0.1 * T


def test_segments_are_cut_where_labels_change():
    record = fsw.Record(np.r_[T, T], np.r_[U, U], np.r_[Y, Y], segments=["a"] * 20 + ["b"] * 20)
    assert record.segments == [slice(0, 20), slice(20, 40)]
    assert len(record) == 40
    assert record.Ts == 1.0


def test_a_skipped_stretch_keeps_its_commands_and_loses_its_measurements():
    y = Y.copy()
    y[5:8] = np.nan
    record = fsw.Record(T, U, y, skip=[(5.0, 7.0)])
    assert len(record) == 17
    assert record.segments == [slice(0, 20)]
    assert record.edges(0).tolist() == [3, 6, 9, 12, 15, 18]


def test_a_missing_command_in_a_skipped_stretch_cuts_the_record():
    u, y = U.copy(), Y.copy()
    u[6] = y[6] = np.nan
    record = fsw.Record(T, u, y, skip=[(6.0, 6.0)])
    assert record.segments == [slice(0, 6), slice(7, 20)]
    assert record.levels(0).tolist() == [0.0, 1.0]


def test_joined_records_are_segments_and_parts_are_records():
    record = fsw.Record(T, U, Y)
    joined = fsw.Record.join([record, record.between(4.0, 16.0)])
    assert [s.stop - s.start for s in joined.segments] == [20, 12]
    assert np.array_equal(joined.y[20:], record.y[4:16])
    assert joined.edges(0).size == 6 + 4
    assert "2 segment(s)" in repr(joined)


@pytest.mark.parametrize("mark", [",", ";", "\t", " ", "  "])
@pytest.mark.parametrize("head", [True, False])
def test_files_are_read_whatever_separates_their_columns(mark, head, tmp_path):
    lines = [mark.join(["time", "valve", "pressure"])] if head else []
    lines += [mark.join(f"{v:g}" for v in row) for row in zip(T, U, Y, strict=True)]
    path = tmp_path / "record.csv"
    path.write_text("\n".join(lines) + "\n")
    record = fsw.Record.read_csv(path)
    assert np.array_equal(record.t, T)
    assert np.array_equal(record.u[:, 0], U)
    assert record.y[:, 0] == pytest.approx(Y)
    assert record.output_names == (("pressure",) if head else ("column 3",))
    if head:
        assert np.array_equal(fsw.Record.read_csv(path, time="time", input="valve", output=3).y, record.y)


def test_several_columns_segments_and_gaps_are_read(tmp_path):
    path = tmp_path / "record.csv"
    rows = [
        f"{t:g},{u:g},{1 - u:g},{'' if 5 <= t <= 6 else y:},{-y:g},{t >= 10:d}" for t, u, y in zip(T, U, Y, strict=True)
    ]
    path.write_text("t,a,b,p,q,run\n" + "\n".join(rows))
    record = fsw.Record.read_csv(path, input=["a", "b"], output=["p", 5], segment="run", skip=[(5, 6)])
    assert record.input_names == ("a", "b")
    assert record.output_names == ("p", "q")
    assert [s.start for s in record.segments] == [0, 10]
    assert np.isnan(record.y[5, 0])


# Mistakes -------------------------------------------------------------------------------------------------------------


def changed(values, at, value):
    result = np.array(values)
    result[at] = value
    return result


BAD = {
    "three samples": (lambda: fsw.Record(T[:3], [0, 1, 0], Y[:3]), "the record has 3 samples; at least 8"),
    "none": (lambda: fsw.Record([], [], []), r"t has shape \(0,\)"),
    "time twice": (
        lambda: fsw.Record(changed(T, 4, 3.0), U, Y),
        r"t holds 3 s twice \(sample 5\); instants must ascend",
    ),
    "time backwards": (lambda: fsw.Record(changed(T, 4, 2.5), U, Y), r"t holds 2\.5 s after 3 s \(sample 5\)"),
    "time missing": (lambda: fsw.Record(changed(T, 4, np.nan), U, Y), "t holds NaN"),
    "input constant": (lambda: fsw.Record(T, U * 0 + 3, Y, input_names="valve"), "input valve is 3 throughout; give"),
    "output constant": (lambda: fsw.Record(T, U, Y * 0 + 7), "output y is 7 throughout; give"),
    "gap": (
        lambda: fsw.Record(T, U, changed(Y, [4, 6], np.nan)),
        r"y \(y\) is nan at t = 4 s, one of 2 gaps; name the",
    ),
    "gap in u": (lambda: fsw.Record(T, changed(U, 4, np.inf), Y), r"u \(u\) is inf at t = 4 s, one of 1 gaps"),
    "all skipped": (
        lambda: fsw.Record(T, U, Y, skip=[(0, 15)]),
        "the record has 4 samples outside the skipped stretches; at least 8",
    ),
    "rows": (lambda: fsw.Record(T, U[:5], Y), r"u has shape \(5,\); give one row for each of 20"),
    "text": (lambda: fsw.Record(T, U, ["a"] * 20), "y cannot be read as numbers; give"),
    "labels": (lambda: fsw.Record(T, U, Y, segments=[1, 2]), r"segments has shape \(2,\); give one label"),
    "skip is a number": (lambda: fsw.Record(T, U, Y, skip=[3]), r"skip holds 3; give pairs"),
    "skip turned round": (lambda: fsw.Record(T, U, Y, skip=[(5, 3)]), r"skip holds \(5, 3\); it must end after"),
    "names": (lambda: fsw.Record(T, U, Y, input_names=["a", "b"]), r"input_names is \['a', 'b'\]; 1 name"),
    "part too short": (lambda: fsw.Record(T, U, Y).between(0, 4), "the record has 4 samples; at least 8"),
    "nothing joined": (lambda: fsw.Record.join([]), r"records holds 0 record\(s\); give some"),
    "different joined": (
        lambda: fsw.Record.join([fsw.Record(T, U, Y), fsw.Record(T, np.c_[U, 1 - U], Y)]),
        "give some with the same inputs",
    ),
}


def assert_one_sentence(message):
    assert "\n" not in message
    assert len(message) < 260
    assert re.search(r"[;,:] ", message)


@pytest.mark.parametrize("name", BAD)
def test_a_record_that_cannot_be_used_is_told_in_one_sentence(name):
    act, says = BAD[name]
    with pytest.raises(ValueError, match=says) as caught:
        act()
    assert_one_sentence(str(caught.value))


ROWS = "".join(f"{t:g},{u:g},{y:g}\n" for t, u, y in zip(T, U, Y, strict=True))
FILES = {
    "empty": ("", {}, r"has 0 row\(s\); give a header row"),
    "header alone": ("t,u,y\n", {}, r"has 1 row\(s\); give a header row"),
    "input constant": ("t,u,y\n" + "".join(f"{t},5,{t}\n" for t in range(20)), {}, "input u is 5 throughout"),
    "output constant": ("t,u,y\n" + "".join(f"{t},{t % 2},5\n" for t in range(20)), {}, "output y is 5 throughout"),
    "three samples": ("t,u,y\n0,0,0\n1,1,1\n2,0,2\n", {}, "has 3 samples; at least 8"),
    "time twice": ("t,u,y\n" + ROWS + "19,0,1\n", {}, r"t holds 19 s twice \(sample 21\)"),
    "time backwards": ("t,u,y\n" + ROWS + "2,0,1\n", {}, r"t holds 2 s after 19 s \(sample 21\)"),
    "gap": ("t,u,y\n" + ROWS + "20,0,nan\n", {}, r"y \(y\) is nan at t = 20 s, one of 1 gaps"),
    "empty cell": ("t,u,y\n" + ROWS + "20,0,\n", {}, r"y \(y\) is nan at t = 20 s"),
    "text": ("t,u,y\n" + ROWS + "20,off,3\n", {}, "line 22, column 'u' holds 'off'; give a finite number"),
    "text without header": (ROWS + "20,off,3\n", {}, "line 21, column 'column 2' holds 'off'"),
    "missing column": ("t,u,y\n" + ROWS, {"output": "temperature"}, "no column 'temperature'; known are t, u, y"),
    "near miss": ("t,u,pressure\n" + ROWS, {"output": "presure"}, "did you mean 'pressure'"),
    "missing place": ("t,u\n" + ROWS, {}, "no column 3"),
    "name without header": (ROWS, {"output": "y"}, "starts with numbers; give a header row"),
    "ragged": ("t,u,y\n" + ROWS + "20,0\n", {}, r"y \(y\) is nan at t = 20 s"),
    "no text": (b"\xff\xfe\x00\x01", {}, "cannot be read .*; give a CSV file in UTF-8"),
    "no file": (None, {}, "cannot be read .*; give a CSV file"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_cannot_be_used_is_told_in_one_sentence_with_its_name(name, tmp_path):
    content, options, says = FILES[name]
    path = tmp_path / "record.csv"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=says) as caught:
        fsw.Record.read_csv(path, **options)
    assert str(path) in str(caught.value)
    assert_one_sentence(str(caught.value).replace(str(path), "record.csv"))


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(ValueError, match="cannot be read"):
        fsw.Record.read_csv(tmp_path)
