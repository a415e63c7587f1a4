"""Bytes between processes: replies, a header in JSON and arrays of 32-bit floats; and jobs in their frames."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.json import json_text
from foreswitch._helpers.mistake import Mistake, shortened
from foreswitch.page.limits import LIMITS

__all__ = ["frame", "pack", "told", "unpack"]


def pack(header: dict[str, Any], arrays: dict[str, Array] | None = None) -> bytes:
    """Length of the header, header, arrays; all little-endian, the arrays at a multiple of four bytes."""
    places, parts, offset = {}, [], 0
    for name, values in (arrays or {}).items():
        with np.errstate(over="ignore"):  # beyond single precision: infinite, and off the picture anyway
            single = np.ascontiguousarray(values, dtype="<f4")
        places[name] = [offset, list(np.shape(values))]
        parts.append(single.tobytes())
        offset += single.size
    text = json_text(header | ({"arrays": places} if places else {})).encode()
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *parts])


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """The other way round."""
    (length,) = struct.unpack_from("<I", message)
    header: dict[str, Any] = json.loads(message[4 : 4 + length])
    floats = np.frombuffer(message, dtype="<f4", offset=4 + length)
    arrays = {
        name: floats[offset : offset + math.prod(shape)].reshape(shape)
        for name, (offset, shape) in header.get("arrays", {}).items()
    }
    return header, arrays


def frame(head: dict[str, Any], body: bytes = b"") -> bytes:
    """Header and body under their lengths, as a worker reads and writes them."""
    text = json_text(head).encode()
    return b"".join([struct.pack("<II", len(text), len(body)), text, body])


def told(mistake: Mistake) -> dict[str, Any]:
    """What a client reads of a mistake: one sentence, and the field it belongs to.

    Parameters
    ----------
    mistake : Mistake

    Returns
    -------
    dict
    """
    return {"message": shortened(str(mistake), LIMITS["sentence"]), "field": mistake.key}
