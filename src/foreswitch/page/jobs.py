"""What a process does with a job: a reply in any case, and one sentence where something does not fit."""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import foreswitch
from foreswitch._helpers.json import json_text
from foreswitch.page import answers, exports, presets, records
from foreswitch.page.complaint import Complaint, field_of, short
from foreswitch.page.wire import pack

__all__ = ["done", "sentence"]

#: Answered on the WebSocket.
ANSWERS: dict[str, Callable[[dict[str, Any]], answers.Answer]] = {
    "look": answers.look,
    "costs": answers.costs,
    "certify": answers.certify,
    "baseline": answers.baseline,
}
PACKAGE = str(Path(foreswitch.__file__).parent)


def done(head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    """Header and body of the reply; never raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of extreme numbers; those of the design are caught where it is made
        return _done(head, body)


def _done(head: dict[str, Any], body: bytes) -> tuple[dict[str, Any], bytes]:
    kind, request = head["kind"], None
    mark = {"id": head.get("id"), "kind": kind}
    try:
        if kind == "columns":
            return _json(records.columns(body))
        if kind == "identify":
            return {"status": 200, "type": "application/octet-stream"}, pack(*records.identify(body, head["query"]))
        request = json.loads(body)
        if not isinstance(request, dict):
            raise Complaint("the request is no object; give project and options")
        if kind in ANSWERS:
            fields, arrays = ANSWERS[kind](request)
            return {"status": 200}, pack(mark | fields, arrays)
        if kind == "project":
            return _json({"project": presets.dropped(request)})
        _, media, suffix = exports.FILES[head["file"]]
        content = exports.export(request, head["file"])
        return {"status": 200, "type": media, "name": request.get("name", "controller") + suffix}, content
    except Exception as error:
        complaint = sentence(error, request)
        if kind in ANSWERS:
            return {"status": 422}, pack(mark | {"error": complaint})
        return {"status": 422, "type": "application/json"}, json_text({"error": complaint}).encode()


def _json(value: Any) -> tuple[dict[str, Any], bytes]:
    return {"status": 200, "type": "application/json"}, json_text(value).encode()


def sentence(error: Exception, request: Any = None) -> dict[str, Any]:
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
    if isinstance(error, json.JSONDecodeError):
        return {"message": f"the request cannot be read ({error}); send JSON", "field": None}
    if isinstance(error, (ValueError, ArithmeticError)):
        text, field = str(error), None
        if not _ours(error) or ";" not in text:  # NumPy's or SciPy's, about numbers that nothing can be computed with
            text = f"the numbers are too extreme to compute with ({short(text)}); choose others"
        tables = request.get("project") if isinstance(request, dict) else None
        if isinstance(tables, dict):
            try:
                field = field_of(tables, str(error))
            except Exception:
                field = None
        return {"message": short(text), "field": field}
    traceback.print_exception(error, file=sys.stderr)
    return {"message": f"the page has a defect here ({type(error).__name__}); the terminal says more", "field": None}


def _ours(error: Exception) -> bool:
    """Whether the sentence was written here."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    return frame is not None and frame.tb_frame.f_code.co_filename.startswith(PACKAGE)
