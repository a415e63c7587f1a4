"""Counts of the tuning page that gate: replies, errors, processes and bytes."""

import asyncio
import json

import page_load
from foreswitch.page import jobs
from table import Row

#: Of a look of 1000 periods: six rows of 32-bit floats, and a header.
LOOK_BYTES = 6 * 4 * 1001 + 1500


def rows() -> list[Row]:
    with page_load.page() as address:
        asyncio.run(page_load.one(address))
        drags = asyncio.run(page_load.many(address))
    missing, errors = sum(each[3] for each in drags), sum(each[2] for each in drags)
    _, look = jobs.done({"kind": "look", "id": 1}, json.dumps({"project": page_load.PROJECT}).encode())
    return [
        Row("page, movements never drawn", str(missing), "", f"{page_load.CLIENTS} clients", "0", missing == 0),
        Row("page, replies with errors", str(errors), "", f"{page_load.CLIENTS} clients", "0", errors == 0),
        Row("page, bytes of a look of 1000 periods", str(len(look)), "", "", f"<= {LOOK_BYTES}", len(look) <= LOOK_BYTES),
    ]  # fmt: skip
