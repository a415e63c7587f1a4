"""What a process does with a job: a reply in any case, and one sentence where something does not fit."""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections.abc import Callable
from typing import Any

from foreswitch._helpers.json import json_text
from foreswitch._helpers.mistake import Mistake, beyond
from foreswitch.page import answers, exports, presets, records
from foreswitch.page.wire import pack, told

__all__ = ["done", "sentence"]

#: Answered on the WebSocket.
ANSWERS: dict[str, Callable[[dict[str, Any]], answers.Answer]] = {
    "look": answers.look,
    "costs": answers.costs,
    "certify": answers.certify,
    "baseline": answers.baseline,
}


def done(head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    """Header and body of the reply; never raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of extreme numbers; those of the design are caught where it is made
        return _done(head, body)


def _done(head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    kind = head["kind"]
    mark = {"id": head.get("id"), "kind": kind}
    try:
        if kind == "columns":
            return _json(records.columns(body))
        if kind == "identify":
            return {"status": 200, "type": "application/octet-stream"}, pack(*records.identify(body, head["query"]))
        request = json.loads(body)
        if not isinstance(request, dict):
            raise Mistake("request", request, "give project and options", problem="is not an object")
        if kind in ANSWERS:
            fields, arrays = ANSWERS[kind](request)
            return {"status": 200}, pack(mark | fields, arrays)
        if kind == "project":
            return _json({"project": presets.dropped(request)})
        _, media, suffix = exports.FILES[head["file"]]
        content = exports.export(request, head["file"])
        return {"status": 200, "type": media, "name": request.get("name", "controller") + suffix}, content
    except Exception as error:
        complaint = sentence(error)
        if kind in ANSWERS:
            return {"status": 422}, pack(mark | {"error": complaint})
        return {"status": 422, "type": "application/json"}, json_text({"error": complaint}).encode()


def _json(value: Any) -> tuple[dict[str, Any], bytes]:
    return {"status": 200, "type": "application/json"}, json_text(value).encode()


def sentence(error: Exception) -> dict[str, Any]:
    """One sentence and the field it is about; a defect of ours leaves its traceback on the terminal."""
    if isinstance(error, json.JSONDecodeError):
        error = Mistake("request", None, "send JSON", problem=f"cannot be read ({error})")
    elif isinstance(error, RecursionError):
        remedy = "give tables as in a project file"
        error = Mistake("project", None, remedy, problem="is nested too deeply")
    elif isinstance(error, MemoryError):
        remedy = "make the run or the plant smaller"
        error = Mistake("project", None, remedy, problem="takes more memory than the page gives")
    elif isinstance(error, (ValueError, ArithmeticError)) and not isinstance(error, Mistake):
        error = beyond(error)
    if isinstance(error, Mistake):
        return told(error)
    traceback.print_exception(error, file=sys.stderr)
    return {"message": f"the page has a defect here ({type(error).__name__}); the terminal says more", "field": None}
