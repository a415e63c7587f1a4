"""The pages: every snippet runs and shows what it really prints; every key and every public name is described.

Blocks of one page run in order, in one namespace and one empty folder:

- ``python``: run; with ``>>>``, as a doctest.
- ``console``: each ``$ foreswitch ...`` goes through the command line, the lines below it are its output (where there are
  any), and ``<!-- exit N -->`` above the block is its exit code.
- ``toml`` that starts with ``# some/path.toml``: written there.
- ``<!-- not run: reason -->`` above a block: skipped.
"""

import doctest
import re
import shlex
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import foreswitch as fsw
from foreswitch import cli

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*(ROOT / "docs").glob("*.md"), ROOT / "README.md"])
MARK = re.compile(r"<!-- (not run: .+|exit \d+) -->")
LANGUAGES = {"python", "console", "toml", "c", "text", "csv"}
CHECKER = doctest.OutputChecker()
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


class Block(NamedTuple):
    line: int
    language: str
    text: str
    mark: str


def blocks(page: Path) -> list[Block]:
    """Fenced blocks with the mark above them; MyST directives are not blocks."""
    found, mark, fence, start, language = [], "", "", 0, ""
    lines = page.read_text(encoding="utf-8").splitlines()
    for i, line in enumerate(lines):
        if fence:
            if line.strip() == fence:
                if not language.startswith("{"):
                    found.append(Block(start + 1, language, "\n".join(lines[start + 1 : i]) + "\n", mark))
                fence, mark = "", ""
        elif opening := re.match(r"(```+)\s*(.*)", line):
            fence, start, language = opening[1], i, opening[2]
        elif line.strip():
            hit = MARK.fullmatch(line.strip())
            mark = hit[1] if hit else ""
    assert not fence, f"{page.name}: the block at line {start + 1} is not closed"
    return found


def show_difference(where: str, source: str, want: str, got: str) -> str:
    example = doctest.Example(source, want)
    return f"{where}: {source}{CHECKER.output_difference(example, got, FLAGS)}"


def run_python(where: str, block: Block, names: dict[str, object]) -> None:
    if ">>>" not in block.text:
        exec(compile("\n" * block.line + block.text, where.split(":")[0], "exec"), names)
        return
    test = doctest.DocTestParser().get_doctest(block.text, names, where, where, block.line)
    test.globs = names  # the parser copies them; later blocks need what this one defines
    report: list[str] = []
    outcome = doctest.DocTestRunner(CHECKER, verbose=False, optionflags=FLAGS).run(
        test, out=report.append, clear_globs=False
    )
    assert outcome.failed == 0, "".join(report)


def run_console(where: str, block: Block, capsys: pytest.CaptureFixture[str]) -> None:
    code = int(block.mark.split()[1]) if block.mark else 0
    commands = re.split(r"^\$ ", block.text, flags=re.MULTILINE)
    assert commands[0] == "", f"{where}: a console block starts with '$ '"
    for command in commands[1:]:
        line, _, want = command.partition("\n")
        words = shlex.split(line)
        assert words[0] == "foreswitch", f"{where}: '{line}' cannot run here; mark the block <!-- not run: reason -->"
        with pytest.raises(SystemExit) as exit_:
            cli.main(words[1:])
        got = "".join(capsys.readouterr())
        assert exit_.value.code == code, f"{where}: '{line}' left with {exit_.value.code}\n{got}"
        if want.strip():
            assert CHECKER.check_output(want, got, FLAGS), show_difference(where, line, want, got)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_snippet_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    names = {"__name__": "__main__"}
    for block in blocks(page):
        where = f"{page.name}:{block.line}"
        language = block.language
        assert language in LANGUAGES, f"{where}: give the block a language out of {sorted(LANGUAGES)}"
        if block.mark.startswith("not run"):
            continue
        if language == "python":
            run_python(where, block, names)
            capsys.readouterr()
        elif language == "console":
            run_console(where, block, capsys)
        elif language == "toml" and (target := re.match(r"# (\S+\.toml)\n", block.text)):
            Path(target[1]).parent.mkdir(parents=True, exist_ok=True)
            Path(target[1]).write_text(block.text, encoding="utf-8")


# What the pages cover --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def generate():
    """docs/generate.py, which needs no Sphinx."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import generate
    finally:
        sys.path.remove(str(ROOT / "docs"))
    return generate


def page_text(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


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


def test_every_page_is_in_the_table_of_contents():
    tree = re.search(r"```\{toctree\}\n(.*?)```", page_text("index.md"), flags=re.DOTALL)
    listed = {line for line in tree[1].splitlines() if line and not line.startswith(":")}
    assert listed == {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"}


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
