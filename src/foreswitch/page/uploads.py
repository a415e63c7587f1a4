"""Files that a client sends, kept for a moment under a name of ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from foreswitch._helpers.mistake import Mistake

__all__ = ["under_its_name"]


@contextmanager
def under_its_name(name: str) -> Iterator[None]:
    """A mistake in the file of the block is told of the file that the client knows, not of its path here.

    Parameters
    ----------
    name : str
    """
    try:
        yield
    except Mistake as mistake:
        mistake.places = (name,)
        raise
