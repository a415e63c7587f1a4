"""Numbers in the text, marked where they stand: ``22.7<!--=preview_now--> kPa`` is held against the value of that name.

The comment shows neither on the site nor on a forge. A page holds the only copy of a number, and its last digit says how
exact it means to be.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
MARK = re.compile(r"<!--=(\w*)-->")
#: 3.58, -4, 20 000 or 1,048,576.
NUMBER = re.compile(r"(?<![\w.])[-−]?(?:\d{1,3}(?:[ ,]\d{3})+|\d+)(?:\.\d+)?")


class Mark(NamedTuple):
    """A marked number: page and line, the number as written (none before the mark: ""), and its name."""

    where: str
    written: str
    name: str


def pages() -> list[Path]:
    """Every text of the repository that may quote what is computed."""
    kinds = ("README.md", "docs/*.md", "docs/[a-z]*/*.md", "examples/*/README.md")
    return sorted(path for kind in kinds for path in ROOT.glob(kind))


def prose(text: str) -> str:
    """A page with its code, formulas and addresses blanked, character by character; captions of figures stay."""
    lines, fence, caption = text.split("\n"), "", False
    for i, line in enumerate(lines):
        if fence:
            if line.partition(" ")[0] == fence:  # a formula's label stands behind its end
                fence = ""
            elif caption and not line.startswith(":"):
                continue
        elif opening := re.match(r"(```+|\$\$)(.*)", line):
            fence, caption = opening[1], opening[2].startswith("{figure}")
        else:
            continue
        lines[i] = " " * len(line)
    hidden = re.compile(r"`[^`\n]+`|\$[^$\n]+\$|\]\([^)\n]*\)")
    return hidden.sub(lambda match: " " * len(match[0]), "\n".join(lines))


def located(page: Path, text: str, at: int) -> str:
    return f"{page.relative_to(ROOT) if page.is_relative_to(ROOT) else page.name}:{text.count(chr(10), 0, at) + 1}"


def marks(page: Path) -> list[Mark]:
    """Every mark of a page in order."""
    text = prose(page.read_text(encoding="utf-8"))
    numbers = {match.end(): match[0] for match in NUMBER.finditer(text)}
    return [Mark(located(page, text, m.start()), numbers.get(m.start(), ""), m[1]) for m in MARK.finditer(text)]


def bare(page: Path) -> list[str]:
    """A number with decimals that is marked at one place of a page and stands unmarked at another."""
    text = prose(page.read_text(encoding="utf-8"))
    marked = {mark.written for mark in marks(page) if "." in mark.written}
    return [
        f"{located(page, text, match.start())}: {match[0]} is marked elsewhere on this page; mark it here too"
        for match in NUMBER.finditer(text)
        if match[0] in marked and not MARK.match(text, match.end())
    ]


def shown(written: str, value: float) -> str:
    """A value in as many decimals as the number written."""
    return f"{value:.{len(written.partition('.')[2])}f}"


def faults(found: Iterable[Mark], values: Mapping[str, float], wanted: Iterable[str]) -> list[str]:
    """One sentence for each mark that is not what is computed, and for each name wanted that no page shows."""
    found, sentences = list(found), []
    for where, written, name in found:
        if not written:
            sentences.append(f"{where}: no number stands before the mark {name!r}")
        elif name not in values:
            sentences.append(f"{where}: {written} is marked {name!r}, and nothing of that name is computed")
        elif (computed := shown(written, values[name])) != re.sub("[ ,]", "", written).replace("−", "-"):
            sentences.append(f"{where}: {written} is written, {computed} is computed ({name})")
    lost = sorted({*wanted} - {mark.name for mark in found})
    return sentences + [f"no page shows {name}: mark the number, or compute it no longer" for name in lost]
