"""A study on disk: a manifest that says which one it is, and its finished chunks."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.json import json_text, plain_data
from foreswitch._helpers.mistake import Mistake
from foreswitch.studies.plan import Plan
from foreswitch.studies.workers import Piece

__all__ = ["Store"]

MANIFEST = "study.json"
#: In the order in which a difference is named.
WORDS = {
    "foreswitch": "version of foreswitch",
    "project": "project",
    "files": "reference files",
    "over": "over",
    "repeats": "repeats",
    "seed": "seed",
}


class Store:
    """Chunks of one study in a folder, each written whole or not at all.

    Parameters
    ----------
    folder : path
        Made with the first chunk.
    plan : Plan
        With its files inside.

    Raises
    ------
    ValueError
        If the folder holds another study.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        self.folder, self.chunks = folder, folder / "chunks"
        self.identity = plain_data({"foreswitch": version("foreswitch"), **plan.description})
        self.rows = 0  # per chunk
        try:
            found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
            theirs, self.rows = found["study"], int(found["rows_per_chunk"])
        except (FileNotFoundError, NotADirectoryError):
            if folder.exists() and not folder.is_dir():
                raise Mistake("out", folder, "give a folder", problem=f"is {folder}, a file") from None
            return
        except (KeyError, TypeError, ValueError):
            problem = "is not the manifest of a study"
            subject = str(folder / MANIFEST)
            raise Mistake("out", folder, "give another folder", problem=problem, subject=subject) from None
        for key, words in WORDS.items():
            if theirs.get(key) != self.identity[key]:
                detail = f": {theirs.get(key)}, not {self.identity[key]}" if words in ("repeats", "seed") else ""
                problem = f"holds another study (its {words} differ{'' if words[-1] == 's' else 's'}{detail})"
                remedy = "give another folder, or remove this one"
                raise Mistake("out", folder, remedy, problem=problem, subject=str(folder))

    def begin(self, rows: int) -> None:
        """Write the manifest, with the rows per chunk."""
        self.rows = rows
        digest = sha256(json_text(self.identity, sort_keys=True).encode()).hexdigest()
        try:
            self.chunks.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            problem, subject = f"cannot be written ({error.strerror})", str(self.folder)
            raise Mistake("out", self.folder, "give another folder", problem=problem, subject=subject) from None
        content: dict[str, Any] = {"hash": digest, "rows_per_chunk": rows, "study": self.identity}
        write_whole(self.folder / MANIFEST, json_text(content, indent=2))

    def save(self, piece: Piece, values: Array) -> None:
        """Keep a finished chunk."""
        buffer = io.BytesIO()
        np.save(buffer, values)
        write_whole(self._path(piece), buffer.getvalue())

    def load(self, piece: Piece, width: int) -> Array | None:
        """A finished chunk; None where there is none, or not a whole one."""
        try:
            values: Array = np.load(self._path(piece), allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return values if values.shape == (piece[1] - piece[0], width) else None

    def tidy(self, pieces: Sequence[Piece]) -> None:
        """Remove what a killed process left half-written."""
        known = {self._path(piece) for piece in pieces}
        for path in self.chunks.iterdir():
            if path not in known and path.name.startswith("."):
                path.unlink(missing_ok=True)

    def _path(self, piece: Piece) -> Path:
        return self.chunks / f"{piece[0]:012d}.npy"
