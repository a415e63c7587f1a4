"""A self-contained HTML report, with its figures beside it as PNG and SVG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from foreswitch._helpers.files import write_whole

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

__all__ = [
    "Picture",
    "Report",
    "Section",
    "Table",
    "number",
]


@dataclass(frozen=True)
class Picture:
    """A figure under the file name it is saved as, with what it shows."""

    name: str
    figure: Figure
    caption: str


@dataclass(frozen=True)
class Table:
    """Rows under headings; the first column names the row."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, then tables and pictures."""

    heading: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    code: str = ""


@dataclass(frozen=True)
class Report:
    """A title, what it is about, and sections."""

    title: str
    lead: str
    sections: Sequence[Section] = field(default_factory=tuple)

    def write(self, folder: Path) -> None:
        """Write ``report.html`` and each picture as PNG and SVG into an existing folder."""
        from markupsafe import Markup

        drawings: dict[str, Markup] = {}
        for section in self.sections:
            for picture in section.pictures:
                image = _saved(picture.figure, "png")
                drawing = _saved(picture.figure, "svg")
                write_whole(folder / f"{picture.name}.png", image)
                write_whole(folder / f"{picture.name}.svg", drawing)
                # inside HTML the drawing goes without its XML prologue
                text = drawing.decode()
                drawings[picture.name] = Markup(text[text.index("<svg") :])
        write_whole(folder / "report.html", self._html(drawings))

    def _html(self, drawings: dict[str, Markup]) -> str:
        from jinja2 import Environment, StrictUndefined

        text = files("foreswitch.presentation").joinpath("report.html").read_text(encoding="utf-8")
        template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        return template.from_string(text).render(report=self, drawings=drawings)


def _saved(figure: Figure, kind: str) -> bytes:
    """The same bytes each time: no date, no random identifiers."""
    import matplotlib as mpl
    import numpy as np

    buffer = io.BytesIO()
    # where a loop ran away, ticks lie beyond what a number can hold
    with mpl.rc_context({"svg.hashsalt": "foreswitch"}), np.errstate(over="ignore", invalid="ignore"):
        figure.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return buffer.getvalue()


def number(value: float, digits: int = 3) -> str:
    """A figure for a table."""
    return f"{value:#.{digits}g}".rstrip(".") if abs(value) < 1e4 else f"{value:.0f}"
