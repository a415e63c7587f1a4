"""The pages: every snippet runs and shows what it really prints; every key and every public name is described."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from matplotlib.image import imread

import foreswitch as fsw
from places import DOCS, ROOT
from test_house import PUBLIC

KINDS = ("tutorial", "howto", "guide", "reference", "theory", "internals")
HOWTOS = sorted((DOCS / "howto").glob("*.md"))
TUTORIAL = DOCS / "tutorial" / "tutorial.md"
PAGES = sorted(
    [*DOCS.glob("*.md"), *(page for kind in KINDS for page in (DOCS / kind).glob("*.md")), ROOT / "README.md"]
)

sys.path.insert(0, str(DOCS / "_tools"))  # for the modules that the pages are built with; none needs Sphinx
import marks  # noqa: E402
import snippets  # noqa: E402


@pytest.fixture(scope="module")
def generate():
    import generate

    return generate


@pytest.fixture(scope="module")
def tables():
    import tables

    return tables


def page_text(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


# What the pages show ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT).with_suffix("")))
def test_every_snippet_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    lacking = snippets.run(page)
    for shown in re.findall(r"/_generated/((?:howto|tutorial)/\S+\.svg)", page.read_text(encoding="utf-8")):
        own = str(page.relative_to(DOCS).with_suffix(""))
        assert shown.startswith(f"{own}/"), f"{page.name} shows {shown}, which another page draws"
        assert Path(shown.removeprefix(f"{own}/")).read_text().startswith("<?xml")
    if lacking:
        pytest.skip(f"target not here: {page.name} lacks {', '.join(lacking)}; all else was run")


def block(language, text, mark=""):
    return f"{mark}\n```{language}\n{text}\n```\n"


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        (block("python", "assert 1 + 1 == 2"), block("python", "assert 1 + 1 == 3")),
        (block("python", ">>> 1 + 1\n2"), block("python", ">>> 1 + 1\n3")),
        (
            block("python", "print(2)") + block("text", "2", "<!-- printed -->"),
            block("python", "print(2)") + block("text", "3", "<!-- printed -->"),
        ),
        (block("console", "$ foreswitch init a\na/project.toml: ..."), block("console", "$ foreswitch init a\nb: ...")),
        (block("console", "$ foreswitch init a"), block("console", "$ foreswitch init")),
        (block("console", "$ false", "<!-- exit 1 -->"), block("console", "$ false")),
        (block("console", "$ sh -c 'echo 2'\n2", "<!-- needs: cc -->"), block("console", "$ sh -c 'echo 2'\n3")),
        (block("python", "assert False", "<!-- not run: why -->"), block("python", "assert False", "<!-- no mark -->")),
        (block("python", "2"), block("pyton", "2")),
    ],
)
def test_a_wrong_snippet_is_found(right, wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text(right)
    assert snippets.run(page) == []
    page.write_text(wrong)
    shutil.rmtree("a", ignore_errors=True)
    with pytest.raises(AssertionError):
        snippets.run(page)


def test_what_a_machine_lacks_is_said_and_not_run(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(block("console", "$ false", "<!-- needs: cc, no-such-compiler, cc:no/such/header.h -->"))
    assert snippets.run(page) == ["cc:no/such/header.h", "no-such-compiler"]


def test_a_project_file_is_changed_key_by_key():
    text = "# one\n[a]\nx = 1  # old\ny = 2\n\n[a.b]\nx = 3\n"
    assert snippets.changed(text, "[a]\nx = 5\nz = 6\n\n[a.b]\nw = 7\n[c]\nx = 8\n") == (
        "# one\n[a]\nx = 5\ny = 2\nz = 6\n\n[a.b]\nx = 3\nw = 7\n\n[c]\nx = 8\n"
    )


@pytest.mark.parametrize("page", [*HOWTOS, TUTORIAL], ids=lambda page: page.stem)
def test_the_text_quotes_only_numbers_that_its_code_holds_or_prints(page):
    """Numbers of two digits or more."""
    text = page.read_text(encoding="utf-8")
    code = " ".join(each.text for each in snippets.blocks(page))
    words = marks.prose(text)
    number = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.]*\d)")
    values = {float(found) for found in number.findall(code)}
    values |= {value * factor for value in values for factor in (100, 1000)}  # per cent and thousandths
    quoted = {found for found in number.findall(words) if len(found) > 1}
    assert not {found for found in quoted if not np.isclose(float(found), sorted(values)).any()}


@pytest.mark.parametrize("page", HOWTOS, ids=lambda page: page.stem)
def test_a_how_to_has_its_parts(page):
    """The short answer first, something that runs, a picture of its own, and what to look out for."""
    text = page.read_text(encoding="utf-8")
    assert re.match(r"# [^\n]+\n\n\*\*", text)
    assert "```python\n" in text
    assert f"```{{figure}} /_generated/howto/{page.stem}/" in text
    assert "\n## What to look out for\n" in text


def test_the_rule_for_settings_is_that_of_drafted_projects():
    from foreswitch.studies import draft

    text = page_text("howto/settings.md")
    assert draft.SETTLING == 3.0
    assert "three times the slowest lag" in text
    assert f"{draft.BANDWIDTH:g} / `Ts`" in text


# Links ----------------------------------------------------------------------------------------------------------------

TEXTS = [*PAGES, *sorted((ROOT / "examples").glob("*/README.md")), ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]


def prose(page: Path) -> str:
    """A page without its code."""
    return re.sub(r"^```.*?^```$|`[^`\n]+`", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """What a heading is called in a link."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    heads = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    """Inside: file and heading exist. Outside: an address of the right form, as tests have no network."""
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith("/_generated/"):
            continue  # drawn while the site is built, which fails without it
        if re.match(r"\w+:", target):
            assert re.fullmatch(r"https://[a-z0-9-]+(\.[a-z0-9-]+)+(/[\w.~%+-]*)*(#[\w-]+)?", target), target
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{target} is not there"
        assert not anchor or anchor in anchors(file), f"{target}: no such heading"


# What the pages cover --------------------------------------------------------------------------------------------------


def test_every_key_is_described(tables):
    rows = {key: (value, meaning) for key, value, _, meaning in tables.key_rows()}
    for table, model in tables.TABLES.items():
        for key in model.model_fields:
            value, meaning = rows[f"`{table}.{key}`"]
            assert value, f"[{table}] {key} has no type in words"
            assert meaning, f"[{table}] {key} has no description"
    assert "_generated/keys.md" in page_text("reference/project_file.md")
    assert "_generated/choices.md" in page_text("reference/project_file.md")


def test_no_table_of_the_file_is_left_out(tables):
    from foreswitch.project.tables import File, Table

    listed = set(tables.TABLES.values())
    assert set(File.model_fields) == {name for name in tables.TABLES if "." not in name}

    def concrete(model: type) -> set[type]:
        return {model} | {each for sub in model.__subclasses__() for each in concrete(sub)}

    assert concrete(Table) - {Table, tables.Choice, File} == listed


def test_types_in_words(tables):
    assert tables.words(list[float | list[float]]) == "list of numbers or lists of numbers"
    assert tables.words(bool | Literal["lag"] | float | None) == 'true, false or `"lag"` or number'


def test_every_choice_names_keys_that_exist(tables):
    for model in tables.TABLES.values():
        if issubclass(model, tables.Choice):
            for needed, optional in model.USES.values():
                assert {*needed, *optional, *model.ALWAYS} <= set(model.model_fields)


def test_every_verb_has_its_help(tables):
    text = page_text("reference/cli.md")
    for verb in tables.verbs():
        assert f"_generated/help_{verb}.txt" in text
        assert "Example: foreswitch" in tables.help_text(verb)


#: Methods and properties of the public classes.
MEMBERS = {
    name: members
    for name in sorted(PUBLIC)
    if (members := {each.removeprefix(f"{name}.") for each in PUBLIC if each.startswith(f"{name}.")})
}


def test_every_public_name_is_in_the_reference():
    from foreswitch import baselines
    from foreswitch.project import project

    text = page_text("reference/python_api.md")
    documented = set(re.findall(r"^\.\. auto\w+:: ([\w.]+)$", text, flags=re.MULTILINE))
    wanted = {f"foreswitch.{name}" for name in fsw.__all__ if name != "baselines"}
    wanted |= {f"foreswitch.baselines.{name}" for name in baselines.__all__}
    wanted |= {f"foreswitch.project.{name}" for name in project.__all__}
    assert wanted <= documented, f"missing: {sorted(wanted - documented)}"


@pytest.mark.parametrize("name", MEMBERS, ids=lambda name: name.split(".")[-1])
def test_every_public_method_is_in_the_reference(name):
    """Under its class, by a bare ":members:" or by name; inherited ones by ":inherited-members:" or under a public base."""
    entry = re.search(
        rf"^\.\. autoclass:: {re.escape(name)}\n((?:   .*\n|\n(?=   ))*)",
        page_text("reference/python_api.md"),
        re.MULTILINE,
    )[1]
    listed = re.search(r"^   :members:(.*)$", entry, re.MULTILINE)
    bases = [base for base in PUBLIC.values() if base in PUBLIC[name].__mro__[1:]]
    wanted = MEMBERS[name] - {each for base in bases for each in vars(base)}
    if listed and not listed[1].strip():
        assert "   :inherited-members:" in entry or wanted <= set(vars(PUBLIC[name]))
    else:
        named = set(re.findall(r"\w+", listed[1])) if listed else set()
        assert wanted <= named, f"{name}: {sorted(wanted - named)}"


@pytest.fixture(scope="module")
def demo(generate):
    return generate.run_demo()


def test_the_numbers_in_the_text_are_those_computed(generate, demo, tmp_path):
    """Those of the comparisons take longer; `make docs` holds them, and here their names are looked for."""
    values, wanted = generate.soon(tmp_path, demo)
    found, late = generate.marked(), {*generate.comparisons.QUOTED}
    assert marks.faults([mark for mark in found if mark.name not in late], values, wanted) == []
    assert late <= {mark.name for mark in found}


@pytest.mark.parametrize("page", marks.pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_a_number_marked_once_is_marked_all_over_its_page(page):
    assert marks.bare(page) == []


def test_the_picture_in_the_readme_is_that_of_the_demo(demo, tmp_path):
    """A README shows what is in the repository; `docs/tracking.png` is a copy."""
    demo.report.write(tmp_path)
    kept, drawn = (imread(path)[..., :3] for path in (DOCS / "tracking.png", tmp_path / "tracking.png"))
    assert kept.shape == drawn.shape
    assert np.abs(kept - drawn).mean() < 1e-3


def test_the_calls_shown_are_c(tmp_path):
    """The README's statements, and the page of the API; what is the reader's own is not declared there."""
    [call] = [each.text for each in snippets.blocks(ROOT / "README.md") if each.language == "c"]
    [whole] = [each.text for each in snippets.blocks(DOCS / "reference/c_api.md") if each.language == "c"]
    yours = "void set_valve(double level);\nvoid raise_alarm(int status);\nint start(void);\n"
    (tmp_path / "whole.c").write_text(yours + whole)
    (tmp_path / "call.c").write_text(
        '#include "foreswitch.h"\nextern const fsw_design design;\nstatic fsw_state state;\n'
        "void call(const fsw_real *x, const fsw_real *reference, const fsw_real *w, fsw_real *u);\n"
        "void call(const fsw_real *x, const fsw_real *reference, const fsw_real *w, fsw_real *u)\n{\n" + call + "}\n"
    )
    command = [
        "cc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{ROOT / 'core'}",
        "-fsyntax-only",
        "call.c",
        "whole.c",
    ]
    subprocess.run(command, cwd=tmp_path, check=True)


def test_pages_are_drawn_again_where_they_or_the_code_changed(tmp_path):
    import drawn

    pages = drawn.changed_pages(tmp_path, "code")
    assert set(pages) == {TUTORIAL, *HOWTOS}
    for page, note in pages.items():
        key = drawn.place(tmp_path, page).with_suffix(".key")
        key.parent.mkdir(exist_ok=True)
        key.write_text(note)
    assert drawn.changed_pages(tmp_path, "code") == {}
    assert set(drawn.changed_pages(tmp_path, "other code")) == set(pages)
    key.write_text("of another text")
    assert set(drawn.changed_pages(tmp_path, "code")) == {page}


def test_what_is_computed_depends_on_all_that_computes_it(generate):
    named = {str(path.relative_to(ROOT)) for path in generate.sources()}
    assert {"src/foreswitch/simulation/loop.py", "core/foreswitch.c", "examples/oven/project.toml"} <= named
    assert {"docs/_tools/trade.py", "docs/_tools/figures/theory.py", "docs/theory/claims/lag.py"} <= named
    assert {"benchmarks/real_records.json", "src/foreswitch/export/templates/counted.json"} <= named
    assert not [name for name in named if "_generated" in name or (name.endswith((".md", ".pyc")) and "docs/" in name)]


def test_every_make_that_a_page_tells_is_a_target():
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    told = {
        name for page in TEXTS for name in re.findall(r"(?:^    |`|\$ )make ([a-z]\w*)", page.read_text(), re.MULTILINE)
    }
    of_exports = {"selftest", "figures", "example"}
    assert {"demo", "test", "docs"} <= told
    assert told - of_exports <= targets


def test_every_file_that_a_page_names_exists():
    for page in [*PAGES, ROOT / "CONTRIBUTING.md"]:
        for path in re.findall(
            r"`((?:tests|core|examples|docs|src|benchmarks)/[\w./]+)`", page.read_text(encoding="utf-8")
        ):
            built = path.startswith("docs/_build/")  # by make docs
            assert built or (ROOT / path).exists(), f"{page.name} names {path}"


def test_the_layers_are_declared_once():
    """CONTRIBUTING points at the declaration and at what each wing says of itself."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert {"`.importlinter`", "`__init__.py`"} <= set(re.findall(r"`[^`]+`", text))
    assert (ROOT / ".importlinter").is_file()
    assert "lint-imports" in re.search(r"^lint:(.*?)\n\n", (ROOT / "Makefile").read_text(), re.DOTALL | re.MULTILINE)[1]
    layers = re.findall(r"^    ([\w |]+)$", (ROOT / ".importlinter").read_text().split("layers =")[1], re.MULTILINE)
    wings = {wing for layer in layers for wing in layer.split(" | ")}
    assert len(wings) > 10
    chain = re.compile(rf"({'|'.join(wings)})`? *[<>→] *`?({'|'.join(wings)})")
    assert not [page for page in TEXTS if chain.search(page.read_text(encoding="utf-8"))]


def test_the_reference_says_what_became_of_old_names():
    import foreswitch

    for old, new in foreswitch._RENAMED.items():
        assert re.search(rf"\| `foreswitch\.{old}` \| now `foreswitch\.{new}`", page_text("reference/python_api.md"))


def test_the_tools_are_short():
    """As the package is: a file one idea, a function one view."""
    for path in (DOCS / "_tools").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert text.count("\n") <= 450, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < 60, f"{path.name}: {node.name}"


def test_every_page_is_in_the_table_of_contents_once():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", page_text("index.md"), flags=re.DOTALL)
    listed = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES if page.is_relative_to(DOCS)}
    assert sorted(listed) == sorted(pages - {"index"})


def test_the_table_of_measured_records_is_that_of_its_benchmark(tables):
    rows = list(tables.record_rows())
    assert "_generated/real_records.md" in page_text("guide/identification.md")
    assert len(rows) == len(tables.record_table()) >= 4
    for row, found in zip(rows, tables.record_table(), strict=True):
        errors = [found[method]["predicted"] for method in ("identify", "FOPDT", "ARX")]
        assert row[0] == found["name"]
        assert [float(cell.strip("*")) for cell in row[-3:]] == errors
        assert {float(cell.strip("*")) for cell in row[-3:] if cell.startswith("**")} == {min(errors)}


def test_every_structure_compared_is_in_the_table(tables):
    from foreswitch.identification.structures import STRUCTURES, Structure

    for text, row in zip(STRUCTURES, tables.structure_rows(), strict=True):
        assert row[0] == f"`{text}`"
        assert row[1].startswith("$")
        assert row[1].endswith("$")
        names = set(re.findall(r"`(\w+)`", row[2]))
        assert set(Structure.parse(text).names) < names


def test_every_warning_is_explained():
    """The quoted words of the page's table are those that the code says, one row for each check at least."""
    source = (ROOT / "src/foreswitch/identification/diagnosis.py").read_text(encoding="utf-8")
    table = page_text("guide/identification.md").split("| it says |")[1].split("\n\n")[0].splitlines()[2:]
    checks = re.search(r"checks = \((.*?)\)", source, re.DOTALL)[1].count(",")
    assert len(table) >= checks
    for row in table:
        for words in re.findall(r"`([^`]+)`", row.split("|")[1]):
            assert words in source, words
