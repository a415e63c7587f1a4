"""What a process does with a job: a reply in any case, and one sentence where something does not fit."""

from __future__ import annotations

import json
import sys
import traceback
from typing import Any

from foreswitch.page import answers
from foreswitch.page.complaint import Complaint, short
from foreswitch.page.wire import pack

__all__ = ["done", "sentence"]

#: Answered on the WebSocket.
ANSWERS = {"look": answers.look}


def done(head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    """Header and body of the reply; never raises."""
    kind = head["kind"]
    mark = {"id": head["id"], "kind": kind}
    try:
        fields, arrays = ANSWERS[kind](json.loads(body))
        return {"status": 200}, pack(mark | fields, arrays)
    except Exception as error:
        complaint = sentence(error)
        return {"status": 422} | complaint, pack(mark | {"error": complaint})


def sentence(error: Exception) -> dict[str, Any]:
    """One sentence and the field it is about; a defect of ours leaves its traceback on the terminal."""
    if isinstance(error, Complaint):
        return {"message": short(str(error)), "field": error.field}
    if isinstance(error, RecursionError):
        return {"message": "the project is nested too deeply; give tables as in a project file", "field": None}
    if isinstance(error, MemoryError):
        return {
            "message": "this takes more memory than the page gives; make the run or the plant smaller",
            "field": None,
        }
    if isinstance(error, (ValueError, OverflowError)):
        return {"message": short(str(error)), "field": None}
    traceback.print_exception(error, file=sys.stderr)
    return {"message": f"the page has a defect here ({type(error).__name__}); the terminal says more", "field": None}
