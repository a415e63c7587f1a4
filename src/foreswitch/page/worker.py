"""A process that answers one job after another, from its standard input to its standard output.

A frame is two lengths (uint32, little-endian), a header in JSON and a body. The server ends a process whose job takes
too long; should the server be gone itself, the end of the input or the alarm clock does.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import struct
import sys
from typing import Any, BinaryIO

from foreswitch.page.jobs import done
from foreswitch.page.wire import frame

__all__ = ["MEMORY", "main"]

#: Address space of a process; NumPy and SciPy reserve about 1 GiB of it.
MEMORY = 4 << 30
#: Seconds after the server's own limit at which the alarm clock rings.
GRACE = 5


def _read(source: BinaryIO) -> tuple[dict[str, Any], bytes] | None:
    """The next job; None at the end."""
    lengths = source.read(8)
    if len(lengths) < 8:
        return None
    head, body = struct.unpack("<II", lengths)
    return json.loads(source.read(head)), source.read(body)


def _limit_memory() -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):  # elsewhere than on POSIX: without
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def main() -> None:
    """Answer until the input ends."""
    _limit_memory()
    source = sys.stdin.buffer
    sink = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a stray print must not come between two replies
    try:
        _serve(source, sink)
    except BrokenPipeError:
        os._exit(0)  # the server has gone


def _serve(source: BinaryIO, sink: BinaryIO) -> None:
    sink.write(frame({"ready": True}))
    sink.flush()
    while (job := _read(source)) is not None:
        head, body = job
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, head["limit"] + GRACE)
        reply = frame(*done(head, body))
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        sink.write(reply)
        sink.flush()


if __name__ == "__main__":
    main()
