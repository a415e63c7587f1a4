"""Numbers in the text and their marks: a wrong one is found and named by page and line; none is read out of code."""

import sys

import pytest

from places import DOCS

sys.path.insert(0, str(DOCS / "_tools"))
import marks


@pytest.fixture
def page(tmp_path):
    def written(text):
        path = tmp_path / "page.md"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def faults(path, **values):
    return marks.faults(marks.marks(path), values, values)


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("22.7", 22.65001), ("22.70", 22.7049), ("3", 2.5001), ("-4.0", -3.951), ("−4.0", -3.951), ("0.0002", 1.9e-4),
        ("20 000", 20000), ("1,048,576", 2**20), ("12", 12),
    ],
)  # fmt: skip
def test_a_number_holds_to_its_last_digit(page, written, value):
    text = f"# Title\n\nIt leaves {written}<!--=it--> kPa.\n"
    assert faults(page(text), it=value) == []
    unit = 10.0 ** -len(written.partition(".")[2])
    for wrong in (value + unit, value - unit):
        [fault] = faults(page(text), it=wrong)
        assert fault == f"page.md:3: {written} is written, {marks.shown(written, wrong)} is computed (it)"


def test_a_mark_that_says_nothing_is_found(page):
    assert faults(page("\nleaves <!--=it--> kPa"), it=1.0) == ["page.md:2: no number stands before the mark 'it'"]
    assert faults(page("1.0<!--=ti-->"), it=1.0) == [
        "page.md:1: 1.0 is marked 'ti', and nothing of that name is computed",
        "no page shows it: mark the number, or compute it no longer",
    ]
    assert faults(page("R12.5<!--=it-->"), it=12.5) == ["page.md:1: no number stands before the mark 'it'"]


def test_a_lost_mark_is_found(page):
    assert faults(page("It leaves 1.0 kPa"), it=1.0) == ["no page shows it: mark the number, or compute it no longer"]
    path = page("1.25<!--=it--> or\n\n1.25 kPa, `1.25`, $1.25$, 11.25 and 1.257\n\n```python\n1.25\n```\n")
    assert marks.bare(path) == ["page.md:3: 1.25 is marked elsewhere on this page; mark it here too"]


def test_only_prose_and_captions_are_read(page):
    text = """1<!--=a-->
```python
2<!--=b-->
```
```{figure} /x.svg
:alt: 3<!--=c-->

A caption, 4<!--=d-->
```
$$
5<!--=e-->
$$ (label)
`6<!--=f-->` and [7<!--=g-->](page.md#8<!--=h-->) 9<!--=i-->
"""
    found = marks.marks(page(text))
    assert [(mark.written, mark.name) for mark in found] == [("1", "a"), ("4", "d"), ("7", "g"), ("9", "i")]
    assert [mark.where for mark in found] == ["page.md:1", "page.md:8", "page.md:13", "page.md:13"]


def test_every_page_is_searched_for_marks():
    named = {str(page.relative_to(marks.ROOT)) for page in marks.pages()}
    assert {"README.md", "docs/index.md", "docs/guide/horizon.md", "examples/oven/README.md"} <= named
    assert not [name for name in named if "/_" in name]
