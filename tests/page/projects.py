"""Projects as the page sends them, the examples and variants of theirs, and what is answered."""

import copy
import json

from foreswitch.page import jobs, presets
from foreswitch.page.wire import unpack

EXAMPLES = {preset["name"]: preset["project"] for preset in presets.presets()}
GONE = object()


def changed(project, *changes):
    """A copy with keys set by their dotted paths; GONE removes one."""
    result = copy.deepcopy(project)
    for path, value in changes:
        *parents, key = path.split(".")
        found = result
        for part in parents:
            found = found[int(part)] if part.isdigit() else found.setdefault(part, {})
        if value is GONE:
            del found[int(key) if key.isdigit() else key]
        else:
            found[int(key) if key.isdigit() else key] = copy.deepcopy(value)
    return result


HOT, CHAMBER, INVERTER, OVEN = (EXAMPLES[name] for name in ("hot_gas", "chamber", "inverter", "oven"))
HORIZON = changed(HOT, ("controller", {"objective": "horizon", "steps": 8}))
FILTER = changed(HOT, ("estimator", {"process_noise": 1.0, "measurement_noise": 1.0}), ("simulation.noise", 1.0))
REAL_SENSOR = {"quantum": 0.5, "missing": 0.1, "outages": [[0.2, 0.22]]}


def ask(kind, project, **more):
    """Fields and arrays of a reply, computed in this process."""
    _, body = jobs.done({"kind": kind, "id": 7}, json.dumps({"project": project, **more}).encode())
    return unpack(body)
