"""A mistake, in one sentence, with the field of the page that it concerns."""

from __future__ import annotations

from foreswitch.page.limits import LIMITS

__all__ = ["Complaint", "short"]


class Complaint(ValueError):
    """One sentence; ``field`` is a key of the project, as in "actuator.Ts", or None."""

    def __init__(self, message: str, field: str | None = None) -> None:
        super().__init__(message)
        self.field = field


def short(text: str) -> str:
    """In one line; of a long value only the beginning, so that the remedy behind it stays."""
    text = " ".join(text.split())
    most = LIMITS["sentence"]
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"
