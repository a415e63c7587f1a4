"""Pages that show what their own snippets draw; each is drawn again where it or the code changed."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable
from pathlib import Path

from processes import Running, started

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def fingerprint(files: Iterable[Path], start: str = "") -> str:
    """A fingerprint of names and contents."""
    found = hashlib.sha256(start.encode())
    for file in files:
        found.update(f"{file.relative_to(ROOT)}\n".encode() + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()


def drawing_pages() -> list[Path]:
    """Those that show what their snippets draw."""
    return [DOCS / "tutorial" / "tutorial.md", *sorted((DOCS / "howto").glob("*.md"))]


def place(folder: Path, page: Path) -> Path:
    """Where a page's pictures are."""
    return folder / page.relative_to(DOCS).with_suffix("")


def noted(folder: Path, page: Path) -> str:
    note = place(folder, page).with_suffix(".key")
    return note.read_text() if note.exists() else ""


def changed_pages(folder: Path, code: str) -> dict[Path, str]:
    """Those that draw and were not drawn yet as they are now, and what to note of them then."""
    notes = {page: fingerprint([page], code) for page in drawing_pages()}
    return {page: note for page, note in notes.items() if noted(folder, page) != note}


def start_pages(folder: Path, pages: Iterable[Path]) -> Running:
    """The snippets of pages, each in a folder of its own."""
    for page in pages:
        shutil.rmtree(place(folder, page), ignore_errors=True)
    script = str(DOCS / "_tools" / "snippets.py")
    return started({str(each): (out := place(folder, each), [script, str(each), str(out)]) for each in pages})
