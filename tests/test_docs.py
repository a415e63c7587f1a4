"""The pages: every snippet runs and shows what it really prints; every key and every public name is described."""

import os
import re
import sys
from pathlib import Path

import pytest

import foreswitch as fsw

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
HOWTOS = sorted((DOCS / "howto").glob("*.md"))
PAGES = sorted([*DOCS.glob("*.md"), *HOWTOS, ROOT / "README.md"])

sys.path.insert(0, str(DOCS))  # for the modules that the pages are built with; none needs Sphinx
import snippets  # noqa: E402


@pytest.fixture(scope="module")
def generate():
    import generate

    return generate


def page_text(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


# What the pages show ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT).with_suffix("")))
def test_every_snippet_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if lacking := snippets.run(page):
        pytest.skip(f"target not here: {page.name} lacks {', '.join(lacking)}; all else was run")


# What the pages cover --------------------------------------------------------------------------------------------------


def test_every_key_is_described(generate):
    rows = {key: (value, meaning) for key, value, _, meaning in generate.key_rows()}
    for table, model in generate.TABLES.items():
        for key in model.model_fields:
            value, meaning = rows[f"`{table}.{key}`"]
            assert value, f"[{table}] {key} has no type in words"
            assert meaning, f"[{table}] {key} has no description"
    assert "_generated/keys.md" in page_text("project_file.md")
    assert "_generated/choices.md" in page_text("project_file.md")


def test_no_table_of_the_file_is_left_out(generate):
    from foreswitch.project import File, Table

    tables = set(generate.TABLES.values())
    assert set(File.model_fields) == {name for name in generate.TABLES if "." not in name}

    def concrete(model: type) -> set[type]:
        return {model} | {each for sub in model.__subclasses__() for each in concrete(sub)}

    assert concrete(Table) - {Table, generate.Choice, File} == tables


def test_types_in_words(generate):
    assert generate.words(list[float | list[float]]) == "list of numbers or lists of numbers"
    assert generate.words(bool | generate.Literal["lag"] | float | None) == 'true, false or `"lag"` or number'


def test_every_choice_names_keys_that_exist(generate):
    for model in generate.TABLES.values():
        if issubclass(model, generate.Choice):
            for needed, optional in model.USES.values():
                assert {*needed, *optional, *model.ALWAYS} <= set(model.model_fields)


def test_every_verb_has_its_help(generate):
    text = page_text("cli.md")
    for verb in generate.verbs():
        assert f"_generated/help_{verb}.txt" in text
        assert "Example: foreswitch" in generate.help_text(verb)


def test_every_public_name_is_in_the_reference():
    from foreswitch import baselines, project

    text = page_text("reference.md")
    documented = set(re.findall(r"^\.\. auto\w+:: ([\w.]+)$", text, flags=re.MULTILINE))
    wanted = {f"foreswitch.{name}" for name in fsw.__all__ if name != "baselines"}
    wanted |= {f"foreswitch.baselines.{name}" for name in baselines.__all__}
    wanted |= {f"foreswitch.project.{name}" for name in project.__all__}
    assert wanted <= documented, f"missing: {sorted(wanted - documented)}"


def test_the_numbers_in_the_text_are_those_computed(generate, tmp_path):
    values = generate.figures.draw(tmp_path) | generate.demo_values(generate.run_demo()) | generate.core_values()
    values |= generate.record_values()
    values |= generate.horizons.family()[1]
    values["budget"] = str(generate.comparisons.BUDGET)
    assert generate.false_claims(values) == []


def test_every_file_that_a_page_names_exists():
    for page in PAGES:
        for path in re.findall(r"`((?:tests|core|examples|docs|src)/[\w./]+)`", page.read_text(encoding="utf-8")):
            assert (ROOT / path).exists(), f"{page.name} names {path}"


def test_every_page_is_in_the_table_of_contents_once():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", page_text("index.md"), flags=re.DOTALL)
    listed = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES if page.is_relative_to(DOCS)}
    assert sorted(listed) == sorted(pages - {"index"})


def test_the_table_of_measured_records_is_that_of_its_benchmark(generate):
    rows = list(generate.record_rows())
    assert "_generated/real_records.md" in page_text("identification.md")
    assert len(rows) == len(generate.record_table()) >= 4
    for row, found in zip(rows, generate.record_table(), strict=True):
        errors = [found[method]["predicted"] for method in ("identify", "FOPDT", "ARX")]
        assert row[0] == found["name"]
        assert [float(cell.strip("*")) for cell in row[-3:]] == errors
        assert {float(cell.strip("*")) for cell in row[-3:] if cell.startswith("**")} == {min(errors)}


def test_every_structure_compared_is_in_the_table(generate):
    from foreswitch.structure import STRUCTURES, Structure

    for text, row in zip(STRUCTURES, generate.structure_rows(), strict=True):
        assert row[0] == f"`{text}`"
        assert row[1].startswith("$")
        assert row[1].endswith("$")
        names = set(re.findall(r"`(\w+)`", row[2]))
        assert set(Structure.parse(text).names) < names


def test_every_warning_is_explained():
    """The quoted words of the page's table are those that the code says, one row for each check at least."""
    source = (ROOT / "src/foreswitch/diagnosis.py").read_text(encoding="utf-8")
    table = page_text("identification.md").split("| it says |")[1].split("\n\n")[0].splitlines()[2:]
    checks = re.search(r"checks = \((.*?)\)", source, re.DOTALL)[1].count(",")
    assert len(table) >= checks
    for row in table:
        for words in re.findall(r"`([^`]+)`", row.split("|")[1]):
            assert words in source, words
