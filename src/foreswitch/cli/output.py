"""What verbs print: tables, JSON, complaints, and on a terminal how far they are."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from foreswitch.presentation.report import Table

__all__ = ["complain", "print_json", "print_table", "progress", "slug", "stages", "write_json"]


def complain(sentence: str) -> int:
    """One line on stderr, and the exit code that goes with it."""
    print("foreswitch: " + " ".join(sentence.split()), file=sys.stderr)
    return 2


def print_json(summary: Mapping[str, Any]) -> None:
    """For machines."""
    print(_json(summary), end="")


def write_json(path: Path, summary: Mapping[str, Any]) -> None:
    """The same as a file."""
    from foreswitch._helpers.files import write_whole

    write_whole(path, _json(summary))


def _json(summary: Mapping[str, Any]) -> str:
    from foreswitch._helpers.json import json_text

    return json_text(summary, indent=2)


def print_table(title: str, content: Table) -> None:
    """Rows under their heads, as wide as the terminal allows."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as Grid

    table = Grid(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for i, head in enumerate(content.heads):
        table.add_column(escape(head), no_wrap=i == 0, justify="left" if i == 0 else "right")
    for row in content.rows:
        table.add_row(*map(escape, row))
    console = Console()
    console.print(table)
    console.print()


@contextmanager
def progress(first: str) -> Iterator[Callable[[float, str], None]]:
    """A bar on stderr where that is a terminal; to be told the share that is done, and what is being done."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(first, total=1.0)
        yield lambda share, what: bar.update(task, completed=share, description=what)


@contextmanager
def stages(first: str) -> Iterator[Callable[[str], None]]:
    """The same for work whose length is not known: to be told what is being done."""
    from rich.console import Console

    with Console(stderr=True).status(first) as status:
        yield lambda what: status.update(what)


def slug(name: str) -> str:
    """A name of a law or run as a file's."""
    words = "".join(c if c.isalnum() or c == "." else " " for c in name.lower()).split()
    return "_".join(words).replace(".", "p")
