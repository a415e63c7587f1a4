"""Formulas as inline SVG, set by matplotlib: pages need no script, no network and no mathematical fonts."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.math import get_node_equation_number

FONT = FontProperties(math_fontfamily="cm")
SIZE = 100.0  # units per em
LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}


def svg(tex: str, scale: float) -> str:
    """One line of a formula, its baseline on that of the text around it."""
    tex = " ".join(tex.split())  # mathtext takes one line
    try:
        path = TextPath((0.0, 0.0), f"${tex}$", size=SIZE, prop=FONT)
    except ValueError as error:
        raise ExtensionError(f"formula {tex!r}: {error}") from error
    pieces = []
    for points, code in path.iter_segments(curves=True, simplify=False):
        if code == Path.CLOSEPOLY:
            pieces.append("Z")
        else:
            # the page's y axis points down
            numbers = " ".join(f"{value * sign:.1f}" for value, sign in zip(points, (1.0, -1.0) * 3, strict=False))
            pieces.append(LETTERS[code] + numbers)
    box = path.get_extents()
    left, width, top, height = box.x0 - 2.0, box.width + 4.0, -box.y1 - 2.0, box.height + 4.0
    em = scale / SIZE
    style = f"width:{width * em:.3f}em;height:{height * em:.3f}em;vertical-align:{-(top + height) * em:.3f}em"
    return (
        f'<svg role="img" aria-label="{escape(tex)}" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}" '
        f'style="{style}" fill="currentColor"><path d="{"".join(pieces)}"/></svg>'
    )


def _inline(self: Any, node: nodes.math) -> None:
    self.body.append(f'<span class="math">{svg(node.astext(), 1.05)}</span>')
    raise nodes.SkipNode


def _block(self: Any, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    lines = "".join(f"<div>{svg(line, 1.15)}</div>" for line in node.astext().split(r"\\"))
    self.body.append(f'<div class="lines">{lines}</div>')
    if node["number"]:
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, object]:
    app.add_html_math_renderer("mathtext", (_inline, None), (_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
