"""Text pieces shared by several modules."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

__all__ = ["nearest", "tree"]


def tree(head: str, lines: Sequence[str]) -> str:
    """A head with its branches."""
    branches = [f"├─ {line}" for line in lines[:-1]] + [f"└─ {lines[-1]}"]
    return "\n".join([head, *branches])


def nearest(word: str, known: Iterable[str]) -> str:
    """A remedy for an unknown word: the nearest known one, or all of them."""
    choices = sorted(known)
    close = get_close_matches(word, choices, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known are {', '.join(choices)}"
