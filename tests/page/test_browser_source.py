"""The tuning page's own modules: small, with nothing shared that changes, from nowhere else."""

import re
from pathlib import Path

import pytest

import foreswitch as fsw

STATIC = Path(fsw.__file__).parent / "page" / "static"
modules = pytest.mark.parametrize("module", sorted(path.name for path in STATIC.glob("*.js")))
#: What a module's functions could change between them; the formatter begins these in the first column.
SHARED = re.compile(
    r"^(export )?((let|var)\b|const \w+ = (\[\]|\{\}|new (Array|Map|Object|Set|Weak\w+)\b))", re.MULTILINE
)


@modules
def test_modules_are_small_and_say_what_they_are_about(module):
    lines = (STATIC / module).read_text().splitlines()
    assert lines[0].startswith("// ")
    assert len(lines) <= 250
    assert [line for line in lines if len(line) > 120] == []  # the formatter leaves comments and texts as they are


@modules
def test_modules_share_nothing_that_changes(module):
    """What changes is in the store, or within a function that makes what needs it."""
    assert [found.group() for found in SHARED.finditer((STATIC / module).read_text())] == []


@pytest.mark.parametrize(
    "line", ["let run = null;", "export let run;", "var a = 1;", "const held = new Map();", "const all = [];"]
)
def test_what_modules_must_not_share_is_found(line):
    assert SHARED.search(f"// About it.\n\n{line}\n")
    assert not SHARED.search(f"function made() {{\n  {line}\n}}\n")


def test_each_part_of_the_store_has_one_owner(visit):
    """Taken twice, unknown, or another's: each is refused; what was read before stays."""
    assert visit().go().evaluate(
        """async () => {
            const { store } = await import("/static/store.js");
            const { now, own } = store({});
            const change = own("refused", "proof");
            const before = now();
            change({ refused: "key" });
            const tries = [() => own("proof"), () => own("none"), () => change({ notices: {} })];
            const said = tries.map((attempt) => { try { attempt(); return ""; } catch (error) { return error.message; } });
            return [before.refused, Object.isFrozen(now()), now().refused, ...said];
        }"""
    ) == [
        "",
        True,
        "key",
        "“proof” has an owner already",
        "the store has no part “none”",
        "“notices” is changed by its owner alone",
    ]


def test_the_page_names_nothing_outside_itself():
    for path in STATIC.iterdir():
        if path.suffix in (".html", ".css", ".js"):
            assert "http://" not in path.read_text().replace("http://www.w3.org/", ""), path
            assert "https://" not in path.read_text(), path
    markup = (STATIC / "index.html").read_text()
    assert "style=" not in markup
    assert "onclick" not in markup


def test_the_vendored_library_has_its_licence_and_version():
    text = (STATIC / "uplot" / "uPlot.iife.min.js").read_text()
    version = text.split("(v", 1)[1].split(")", 1)[0]
    assert f"uPlot {version}" in (STATIC / "uplot" / "SOURCE").read_text()
    assert "Leon Sorokin" in (STATIC / "uplot" / "LICENSE").read_text()
