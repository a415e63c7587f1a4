"""Bytes between processes: replies, a header in JSON and arrays of 32-bit floats; and jobs in their frames."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shortened
from foreswitch.page.limits import LIMITS

__all__ = ["clean", "frame", "pack", "told", "unpack"]


def pack(header: dict[str, Any], arrays: dict[str, Array] | None = None) -> bytes:
    """Length of the header, header, arrays; all little-endian, the arrays at a multiple of four bytes."""
    places, parts, offset = {}, [], 0
    for name, values in (arrays or {}).items():
        with np.errstate(over="ignore"):  # beyond single precision: infinite, and off the picture anyway
            single = np.ascontiguousarray(values, dtype="<f4")
        places[name] = [offset, list(np.shape(values))]
        parts.append(single.tobytes())
        offset += single.size
    text = json.dumps(clean(header | ({"arrays": places} if places else {})), allow_nan=False).encode()
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


def clean(value: Any) -> Any:
    """As JSON can hold it: arrays as lists, what is not finite as null."""
    if isinstance(value, dict):
        return {str(key): clean(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(item) for item in value]
    if isinstance(value, np.ndarray):
        return clean(value.tolist())
    if isinstance(value, np.generic):
        return clean(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def frame(head: dict[str, Any], body: bytes = b"") -> bytes:
    """Header and body under their lengths, as a worker reads and writes them."""
    text = json.dumps(head).encode()
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
