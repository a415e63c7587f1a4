"""Every design-time mistake is a ValueError of one sentence, with the argument, its value and the remedy as fields."""

import copy
import inspect
import pickle

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch import baselines
from foreswitch._helpers.mistake import LONGEST_VALUE, Mistake, inside, shown, within
from mistakes import MISTAKES, UNKNOWN, build, caught


def parameters(thing):
    """Names that a caller may give to what is public."""
    found = set(inspect.signature(thing).parameters) if callable(thing) else set()
    methods = (
        inspect.getmembers(thing, lambda m: inspect.isfunction(m) or inspect.ismethod(m))
        if inspect.isclass(thing)
        else ()
    )
    return found.union(*(parameters(method) for name, method in methods if not name.startswith("_")))


ARGUMENTS = set().union(*(parameters(getattr(fsw, name)) for name in fsw.__all__ if inspect.isclass(getattr(fsw, name))
                          or inspect.isfunction(getattr(fsw, name))),
                        *(parameters(getattr(baselines, name)) for name in baselines.__all__))  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_naming_argument_and_value(mistake):
    act, says = MISTAKES[mistake]
    with pytest.raises(ValueError, match=says) as raised:
        act()
    found = raised.value
    assert type(found) is Mistake
    assert found.argument in ARGUMENTS or "has no argument" in found.problem
    assert found.key is None, "no project file was read"
    message = str(found)
    assert message == f"{found.subject} {found.problem}; {found.remedy}"
    assert found.subject
    assert found.problem
    assert found.remedy
    assert "\n" not in message
    assert len(message) < 240
    assert not message.endswith(".")


def test_a_design_that_the_core_refuses_comes_with_what_to_do():
    with pytest.raises(ValueError, match=r"the design contradicts itself, or .*; give real = 'float64'"):
        build(levels=[1, 1 + 1e-9], real="float32")
    build(levels=[1, 1 + 1e-9], real="float64")


# Fields ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("twin", [lambda m: pickle.loads(pickle.dumps(m)), copy.copy, copy.deepcopy])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_reaches_another_process_whole(mistake, twin):
    """Workers send it; what cannot be sent of its value goes as text."""
    found = caught(MISTAKES[mistake][0])
    found.key, found.places = "simulation.plant", ("project.toml", "point 3")
    made = twin(found)
    assert type(made) is Mistake
    assert str(made) == str(found)
    assert {**vars(made), "value": None} == {**vars(found), "value": None}
    assert shown(made.value) == shown(found.value) or made.value == shown(found.value)


def test_a_value_that_cannot_be_sent_goes_as_text():
    made = pickle.loads(pickle.dumps(Mistake("reference", lambda t: t, "give numbers")))
    assert "<lambda>" in made.value
    assert made.argument == "reference"
    assert str(made).endswith("; give numbers")


class Odd:
    def __repr__(self):
        raise RuntimeError("no words")


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.0, "0.0"), (5, "5"), (np.float64(0.1), "0.1"), (np.bool_(True), "True"), (np.array([[1.0, 2.0]]), "[[1.0, 2.0]]"),
     (1.0 / 3.0, "0.3333333333333333"), ("a\nb", "'a\\nb'"), (10**5000, "a value of type int that cannot be written out"),
     (Odd(), "a value of type Odd that cannot be written out"), (np.zeros((500, 3)), "an array of shape (500, 3)")],
    ids=range(10),
)  # fmt: skip
def test_a_value_is_shown_in_one_short_line(value, words):
    assert shown(value) == words


@pytest.mark.parametrize(
    "value", [list(range(10**4)), "x" * 10**6, {"a": "b" * 1000}, np.arange(80.0) / 3.0], ids=range(4)
)
def test_a_long_value_is_shortened_to_its_ends(value):
    text = shown(value)
    assert len(text) <= LONGEST_VALUE + 5
    assert " ... " in text
    assert repr(value)[:5] == text[:5] or text[0] == "["
    assert "give less" in str(Mistake("x", value, "give less"))


def test_the_innermost_table_names_the_key_and_places_stand_outermost_first():
    def act():
        with (
            inside("project.toml"), within("simulation", {"low": "simulation.low"}),
            inside("point 2"), within("simulation.hardware", {"low": "simulation.hardware.low"}),
        ):  # fmt: skip
            fsw.Hardware(low=2.0, high=1.0)

    found = caught(act)
    assert (found.argument, found.key) == ("low", "simulation.hardware.low")
    assert str(found) == "project.toml: point 2: low is 2.0 and high 1.0; low must be smaller"


def test_numbers_that_no_library_computes_with_are_a_mistake_of_their_file():
    def act():
        with inside("project.toml"):
            np.linalg.inv(np.zeros((2, 2)))

    found = caught(act)
    assert found.places == ("project.toml",)
    assert "too extreme to compute with (Singular matrix); choose others" in str(found)
    assert isinstance(found.__cause__, np.linalg.LinAlgError)


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_keyword_is_refused_by_name(name):
    with pytest.raises(TypeError, match="dead_time"):
        UNKNOWN[name]()


# CSV ------------------------------------------------------------------------------------------------------------------

FILES = {
    "missing column": (b"t,y\n0,1\n1,2\n", {"value": "pressure"}, "no column 'pressure'; known are t, y"),
    "near miss": (b"t,pressure\n0,1\n1,2\n", {"value": "presure"}, "did you mean 'pressure'"),
    "missing second column": (b"t\n0\n1\n", {}, "no column 2"),
    "another separator": (b"t|y\n0|1\n", {}, "no column 2"),
    "text": (b"t,y\n0,1\n\n1,two\n", {}, "line 4, column 'y' holds 'two'"),
    "hole": (b"t,y\n0,1\n1\n", {}, "line 3, column 'y' holds ''"),
    "NaN": (b"t,y\n0,1\n1,nan\n", {}, "line 3, column 'y' holds 'nan'"),
    "unsorted": (b"t,y\n0,1\n2,1\n1,1\n", {}, "t goes from 2 to 1 at sample 3"),
    "empty": (b"", {}, r"has 0 row\(s\)"),
    "header alone": (b"t,y\n", {}, r"has 1 row\(s\)"),
    "no header": (b"0,1\n1,2\n", {"value": "y"}, "starts with numbers"),
    "not text": (b"\xff\xfe\x00", {}, "cannot be read"),
    "kind": (b"t,y\n0,1\n1,2\n", {"kind": "spline"}, "kind is 'spline'"),
    "no file": (None, {}, "cannot be read"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_bad_file_is_one_sentence_naming_it_and_the_place(name, tmp_path):
    content, options, says = FILES[name]
    path = tmp_path / "profile.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=says) as caught:
        fsw.Samples.read_csv(path, **options)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
