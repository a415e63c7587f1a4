"""The walks of docs/internals: each module is there, and each step is an import, or a word that both files hold."""

import ast
import re

import pytest

from places import DOCS, ROOT

SOURCE = ROOT / "src" / "foreswitch"
PAGE = DOCS / "internals" / "walks.md"
#: Wings that a certificate may know, and those that everybody does.
CERTIFICATE, COMMON = {"certificate", "control", "model", "simulation", "presentation"}, {"_helpers"}


def walks():
    """Heading -> rows (path, what joins it to the row above)."""
    found, heading = {}, ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            heading = line.removeprefix("## ")
        elif row := re.fullmatch(r"\| `([\w./]+)` \| .+ \| .+ \| (.*?) ?\|", line):
            found.setdefault(heading, []).append((row[1], row[2].strip("`")))
    return found


WALKS = walks()


def located(path):
    [file] = [base / path for base in (ROOT, SOURCE) if (base / path).is_file()]
    return file


def dotted(file):
    return ".".join(file.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__")


def imports(file):
    """Dotted names of the modules, or files, that one file imports."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".js":
        return {str((file.parent / name).resolve()) for name in re.findall(r'\bfrom "(\./\w+\.js)";', text)}
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            found |= {node.module, *(f"{node.module}.{each.name}" for each in node.names)}
        elif isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
    return found


def joined(above, below, by):
    """Whether the second file is joined to the first as the page says; a word may be the second one's name."""
    if by == "import":
        names = [str(file) if file.suffix == ".js" else dotted(file) for file in (above, below)]
        return names[1] in imports(above) or names[0] in imports(below)
    texts = [file.read_text(encoding="utf-8") for file in (above, below)]
    name = dotted(below) if below.suffix == ".py" else below.name
    return by in texts[0] and (by in texts[1] or by == name)


def test_there_are_the_walks():
    """And no row of a table is passed over."""
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert len(WALKS) == 4
    assert sum(map(len, WALKS.values())) == len(rows)


@pytest.mark.parametrize("name", WALKS)
def test_each_step_of_a_walk_is_there(name):
    (first, nothing), *rest = WALKS[name]
    assert nothing == ""
    above = located(first)
    for path, by in rest:
        below = located(path)
        assert joined(above, below, by), f"{name}: {path} is not joined to the module above it by {by}"
        above = below


def test_every_module_named_is_there():
    """Those between the tables too."""
    named = re.findall(r"`([\w./]+/[\w.]+\.(?:py|c|js))`", PAGE.read_text(encoding="utf-8"))
    assert len({located(path) for path in named}) > 30


def test_a_wrong_step_is_found():
    design, header, page = map(located, ("control/design.py", "export/header.py", "page/static/main.js"))
    assert joined(design, header, "import")
    assert not joined(located("control/kalman.py"), header, "import")
    assert not joined(page, located("page/static/scale.js"), "import")
    assert not joined(design, header, "no such word")
    with pytest.raises(ValueError, match="unpack"):
        located("control/no_such_module.py")


def test_a_design_passes_through_few_modules():
    assert len(WALKS["A design to a header"]) <= 4


def test_a_certificate_reaches_no_further():
    found = set()
    for file in (SOURCE / "certificate").glob("*.py"):
        found |= {name.split(".")[1] for name in imports(file) if name.startswith("foreswitch.")}
    assert found - COMMON == CERTIFICATE
    text = PAGE.read_text(encoding="utf-8").split("## How far a certificate reaches")[1]
    assert set(re.findall(r"`(\w+)`", text)) == CERTIFICATE - {"certificate"}
