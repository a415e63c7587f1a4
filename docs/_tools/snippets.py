"""What a page shows is run: its blocks in order, in one namespace and one folder. Needs foreswitch only.

- ``python``: run; with ``>>>``, as a doctest.
- ``console``: ``$ foreswitch ...`` goes through the command line, other programs are called; the lines below a command are
  its output (where there are any), ``<!-- exit N -->`` above the block is its exit code.
- ``toml`` that starts with ``# some/path.toml``, ``c`` with ``/* some/path.c */``: written there.
- ``toml`` under ``<!-- change some/path.toml -->``: these keys get these values in that file.
- ``text`` under ``<!-- printed -->``: what the last python block printed.
- ``<!-- needs: program, compiler:header.h -->`` above a block: run where these are installed.
- ``<!-- not run: reason -->`` above a block: skipped.
"""

from __future__ import annotations

import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from foreswitch._helpers.mistake import Mistake
from foreswitch.cli import app

LANGUAGES = {"python", "console", "toml", "c", "text", "csv"}
MARK = re.compile(r"<!-- (not run: .+|exit \d+|needs: .+|change \S+|printed) -->")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
#: Longest time for a program [s].
SECONDS = 120


class Checker(doctest.OutputChecker):
    """A mistake may be shown as what it is caught as: its class is a ValueError of the library's own."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        """Whether they agree."""
        name = f"{Mistake.__module__}.{Mistake.__qualname__}: "
        if got.startswith(name):
            got = "ValueError: " + got.removeprefix(name)
        return super().check_output(want, got, optionflags)


CHECKER = Checker()


class Block(NamedTuple):
    """A fenced block: where, in which language, and the mark above it."""

    where: str
    language: str
    text: str
    mark: str

    def marked(self, word: str) -> str | None:
        """What follows the word in the mark."""
        return self.mark.removeprefix(word).strip() if self.mark.startswith(word) else None


def blocks(page: Path) -> list[Block]:
    """Fenced blocks of a page in order; MyST directives are not blocks."""
    found, mark, fence, start, language = [], "", "", 0, ""
    lines = page.read_text(encoding="utf-8").splitlines()
    for i, line in enumerate(lines):
        if fence:
            if line.strip() == fence:
                if not language.startswith("{"):
                    where = f"{page.name}:{start + 2}"
                    assert language in LANGUAGES, f"{where}: give the block a language out of {sorted(LANGUAGES)}"
                    found.append(Block(where, language, "\n".join(lines[start + 1 : i]) + "\n", mark))
                fence, mark = "", ""
        elif opening := re.match(r"(```+)\s*(.*)", line):
            fence, start, language = opening[1], i, opening[2]
        elif line.strip():
            hit = MARK.fullmatch(line.strip())
            mark = hit[1] if hit else ""
    assert not fence, f"{page.name}: the block at line {start + 1} is not closed"
    return found


def difference(block: Block, source: str, want: str, got: str) -> str:
    return f"{block.where}: {source}{CHECKER.output_difference(doctest.Example(source, want), got, FLAGS)}"


def run_python(block: Block, names: dict[str, Any]) -> str:
    """What it prints."""
    page, _, line = block.where.partition(":")
    printed = io.StringIO()
    if ">>>" not in block.text:
        with redirect_stdout(printed):
            exec(compile("\n" * (int(line) - 1) + block.text, page, "exec"), names)
        return printed.getvalue()
    test = doctest.DocTestParser().get_doctest(block.text, names, block.where, page, int(line) - 1)
    test.globs = names  # the parser copies them; later blocks need what this one defines
    runner = doctest.DocTestRunner(CHECKER, verbose=False, optionflags=FLAGS)
    assert runner.run(test, out=printed.write, clear_globs=False).failed == 0, printed.getvalue()
    return ""


def called(words: list[str]) -> tuple[int, str]:
    """Exit code and output of a command."""
    if words[0] != "foreswitch":
        done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=SECONDS)
        return done.returncode, done.stdout
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            app.main(words[1:])
    except SystemExit as end:
        return int(end.code or 0), out.getvalue() + err.getvalue()
    raise AssertionError("cli.main ends with SystemExit")


def run_console(block: Block) -> None:
    code = int(block.marked("exit") or 0)
    commands = re.split(r"^\$ ", block.text, flags=re.MULTILINE)
    assert commands[0] == "", f"{block.where}: a console block starts with '$ '"
    for command in commands[1:]:
        line, _, want = command.replace("\\\n", " ").partition("\n")
        found, got = called(shlex.split(line))
        assert found == code, f"{block.where}: '{line}' left with {found}\n{got}"
        if want.strip():
            assert CHECKER.check_output(want, got, FLAGS), difference(block, line, want, got)


def changed(text: str, changes: str) -> str:
    """A TOML file with the keys of some tables set anew; what is not there is added."""
    lines, at = text.rstrip("\n").split("\n"), 0
    for change in changes.rstrip("\n").split("\n"):
        key = change.partition("=")[0].strip()
        if change.startswith("["):
            heads = [i for i, line in enumerate(lines) if line.split("#")[0].strip() == change.split("#")[0].strip()]
            if not heads:
                lines += ["", change]
            at = (heads or [len(lines) - 1])[0]
        elif key and not key.startswith("#"):
            end = next((i for i in range(at + 1, len(lines)) if lines[i].startswith("[")), len(lines))
            same = [i for i in range(at + 1, end) if lines[i].partition("=")[0].strip() == key]
            if same:
                lines[same[0]] = change
            else:
                lines.insert(1 + max(i for i in range(at, end) if lines[i].strip()), change)
    return "\n".join(lines) + "\n"


@cache
def there(need: str) -> bool:
    """Whether a program, or COMPILER:HEADER, is installed."""
    program, _, header = need.partition(":")
    if shutil.which(program) is None:
        return False
    found = [program, "-E", "-x", "c", "-"]
    return (
        not header or not subprocess.run(found, input=f"#include <{header}>".encode(), capture_output=True).returncode
    )


def run(page: Path) -> list[str]:
    """Run a page in the working folder; what was lacking, and so was not run."""
    names: dict[str, Any] = {"__name__": "__main__"}
    printed, lacking = "", []
    for block in blocks(page):
        missing = [need for need in re.split(r",\s*", block.marked("needs:") or "") if need and not there(need)]
        lacking += missing
        if missing or block.marked("not run:"):
            continue
        target = re.match(r"(?:# (\S+\.toml)|/\* (\S+\.c) \*/)\n", block.text)
        if block.language == "python":
            printed = run_python(block, names)
        elif block.language == "console":
            run_console(block)
        elif block.language == "text" and block.mark == "printed":
            assert CHECKER.check_output(block.text, printed, FLAGS), difference(block, "printed", block.text, printed)
        elif block.language in ("toml", "c") and (name := block.marked("change")):
            Path(name).write_text(changed(Path(name).read_text(encoding="utf-8"), block.text), encoding="utf-8")
        elif block.language in ("toml", "c") and target:
            path = Path(target[1] or target[2])
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
    return sorted(set(lacking))


if __name__ == "__main__":
    page = Path(sys.argv[1]).resolve()
    os.chdir(sys.argv[2])
    for need in run(page):
        print(f"{page.name}: not run for want of {need}", file=sys.stderr)
