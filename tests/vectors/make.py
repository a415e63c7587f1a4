"""Golden vectors: problems, the design the library makes of them, and what the plain transcription expects of each step.

``python tests/vectors/make.py`` writes one JSON file per case. The arrays under "design" are the C core's own and come
from the library; statuses, costs and commands come from oracle.py and from `Watch` below, which fold nothing. The
margin between the two best candidates is wide, so that single precision decides alike. Numbers that JSON lacks are the
strings "nan", "inf" and "-inf".
"""

import json
import sys
import warnings
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import foreswitch as fsw  # noqa: E402
from oracles import horizon as horizon_oracle  # noqa: E402
from oracles.kalman import Estimator, riccati_gain, usable  # noqa: E402
from oracles.law import Law  # noqa: E402

PAPER = {
    "A": [[0.0, 1.0], [0.0, -1.0 / 0.006]], "B": [[0.0], [16500.0 / 0.006]], "C": [[1.0, 0.0]],
    "delay": [0.005], "levels": [[0.0, 1.0]], "Ts": 0.001, "Td": 0.020, "lam": [2500.0], "r": [2],
}  # fmt: skip
TWO_INPUTS = {
    "A": [[-1.0, 0.4, 0.0], [-0.3, -0.7, 0.2], [0.1, 0.0, -0.5]], "B": [[1.0, 0.2], [0.1, 0.8], [0.3, 0.5]],
    "C": [[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]], "E": [[0.3], [0.0], [1.0]], "delay": [0.37, 0.15],
    "u_offset": [0.2, 0.0], "y_offset": [0.5, -0.3], "levels": [[0.0, 1.0], [-1.0, 0.0, 2.0]], "Ts": 0.1, "Td": 0.45,
    "lam": [3.0, 5.0], "weight": [1.0, 4.0], "r": [1, 1], "forbidden": [(1.0, 2.0), (0.0, -1.0)],
}  # fmt: skip
MASS = {
    "A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]], "delay": [0.3],
    "levels": [[-1.0, 0.0, 1.0]], "Ts": 0.1, "Td": 0.8, "lam": [2.0], "r": [2],
    "min_on": [0.3], "min_off": [0.2], "switch_cost": [0.02],
}  # fmt: skip
VENTED = PAPER | {"E": [[-1.0], [0.0]], "delay": [0.0043], "safe": [0.0]}
OVEN = {
    "A": [[-0.01]], "B": [[1.0]], "C": [[1.0]], "delay": [20.0], "levels": [[0.0, 0.5, 1.0]], "Ts": 1.0, "Td": 20.0,
    "lam": [1.0], "r": [1], "tail": "zero",
}  # fmt: skip

CASES = {
    "paper": {
        "about": "The paper's controller on a rising reference.",
        "problem": PAPER,
        "x": [470.0, 2000.0],
        "reference": lambda t: [[500.0 + 500.0 * np.sin(2 * np.pi * t), 1000.0 * np.pi * np.cos(2 * np.pi * t)]],
    },
    "two_inputs": {
        "about": "Two inputs with unequal fractional dead times, forbidden combinations, a disturbance, an operating point.",
        "problem": TWO_INPUTS,
        "pending": [(0.0, 0.0), (1.0, -1.0), (1.0, 0.0), (0.0, 2.0)],
        "reference": lambda t: [[0.8 + 0.5 * np.sin(3.0 * t)], [0.4 * np.cos(2.0 * t)]],
        "w": lambda t: [0.3 * np.sin(5.0 * t)],
    },
    "dwell": {
        "about": "Dwell running at the start, a cost per switch, three levels.",
        "problem": MASS,
        "pending": [(0.0,), (1.0,), (1.0,)],
        "elapsed": [0.1],
        "reference": lambda t: [[0.4 * np.sin(2.0 * t), 0.8 * np.cos(2.0 * t)]],
    },
    "faults": {
        "about": "Bad measurements: held before the first good one, coasted through, the safe level after four in a row.",
        "problem": VENTED,
        "bad_limit": 4,
        "pending": [(1.0,)] * 5,
        "reference": lambda t: [[70.0 + 7000.0 * t, 7000.0]],
        "w": lambda t: [300.0 + 5000.0 * t],
        "bad": {0: [nan, 0.0], 1: [inf, nan], 5: [1e300, 0.0], 6: [0.0, -inf], 10: [nan, nan], 11: [nan, 0.0],
                12: [nan, 0.0], 13: [nan, 0.0], 14: [nan, 0.0], 18: [0.0, nan]},
        "bad_w": {7: [nan], 18: [inf]},
    },
    "zero_tail": {
        "about": "The paper's tail to the letter, first order, three levels.",
        "problem": OVEN,
        "x": [47.8],
        "reference": lambda t: [[40.0]],
    },
}  # fmt: skip
CASES |= {
    "outputs": {
        "about": "From the pressure alone, with a leak: a start in motion, spikes, samples missing, a jump that stays.",
        "problem": PAPER | {
            "estimator": {"process_noise": [0.0, 1e4], "measurement_noise": [4.0], "load": [1e-4], "gate": 6.0,
                          "gate_limit": 2},
        },
        "bad_limit": 6,
        "x": [470.0, 2000.0],
        "noise": lambda k: [2.0 * np.cos(7.0 * k) + (300.0 if k in (6, 7) else 90.0 if k >= 12 else 0.0)],
        "load": [-0.1],
        "reference": lambda t: [[500.0 + 500.0 * np.sin(2 * np.pi * t), 1000.0 * np.pi * np.cos(2 * np.pi * t)]],
        "bad": {0: [nan], 4: [inf], 10: [-1e300]},
    },
    "two_outputs": {
        "about": "Two outputs, one load, a measured disturbance that is missing now and then, no gate.",
        "problem": TWO_INPUTS | {
            "estimator": {"process_noise": [1e-3, 1e-3, 4e-3], "measurement_noise": [1e-3, 4e-3], "load": [0.0, 1e-3],
                          "gate": 0.0, "gate_limit": 3},
        },
        "pending": [(0.0, 0.0), (1.0, -1.0), (1.0, 0.0), (0.0, 2.0)],
        "noise": lambda k: [0.03 * np.cos(7.0 * k), 0.05 * np.sin(9.0 * k)],
        "load": [0.0, 0.3],
        "reference": lambda t: [[0.8 + 0.5 * np.sin(3.0 * t)], [0.4 * np.cos(2.0 * t)]],
        "w": lambda t: [0.3 * np.sin(5.0 * t)],
        "bad": {7: [0.5, nan], 15: [inf, inf]},
        "bad_w": {3: [nan], 15: [nan], 16: [-inf]},
    },
}  # fmt: skip
GAS = {name: PAPER[name] for name in ("A", "B", "C", "delay", "levels", "Ts")}
COUPLED = {name: value for name, value in TWO_INPUTS.items() if name not in ("Td", "lam", "r")}
CASES |= {
    "horizon": {
        "about": "Ten periods of the hot gas, as the last move holds.",
        "problem": GAS | {"horizon": {"steps": 10, "move_weight": 0.5, "tail": "hold"}},
        "x": [470.0, 2000.0],
        "reference": lambda t: [[500.0 + 500.0 * np.sin(2 * np.pi * t)]],
    },
    "horizon_two_inputs": {
        "about": "A window, moves before its end, unequal dead times, dwell, a switch cost, a terminal cost, a disturbance.",
        "problem": COUPLED | {
            "min_on": [0.2, 0.15], "min_off": [0.1, 0.3], "switch_cost": [0.02, 0.01],
            "horizon": {"steps": 5, "moves": 4, "window": [2, 5], "move_weight": [0.1, 0.02], "tail": "rest",
                        "terminal": [[1.0, 0.2, 0.0], [0.2, 0.5, 0.0], [0.0, 0.0, 0.3]]},
        },
        "pending": [(0.0, 0.0), (1.0, -1.0), (1.0, 0.0), (0.0, 2.0)],
        "elapsed": [0.05, 0.05],
        "reference": lambda t: [[0.8 + 0.5 * np.sin(3.0 * t)], [0.4 * np.cos(2.0 * t)]],
        "w": lambda t: [0.3 * np.sin(5.0 * t)],
    },
    "horizon_faults": {
        "about": "From the pressure alone, with a leak: sliding weights, the paper's tail, three levels, samples missing.",
        "problem": GAS | {
            "levels": [[-1.0, 0.0, 1.0]], "r": [2], "lam": [800.0],
            "horizon": {"steps": 6, "lam": [800.0], "tail": "zero"},
            "estimator": {"process_noise": [0.0, 1e4], "measurement_noise": [4.0], "load": [1e-4], "gate": 6.0,
                          "gate_limit": 2},
        },
        "bad_limit": 4,
        "x": [470.0, 2000.0],
        "noise": lambda k: [2.0 * np.cos(7.0 * k) + (300.0 if k in (6, 7) else 0.0)],
        "load": [-0.1],
        "reference": lambda t: [[500.0 + 500.0 * np.sin(2 * np.pi * t), 1000.0 * np.pi * np.cos(2 * np.pi * t)]],
        "bad": {0: [nan], 4: [inf], 11: [nan], 12: [nan], 13: [nan], 14: [nan]},
    },
}  # fmt: skip
STEPS = 24
#: How much better the best candidate has to be than the next: more than single precision could blur.
MARGIN, MARGIN_OF_HORIZON = 0.02, 0.003


def number(value):
    """A number of a golden file, in which NaN and infinity are words."""
    return [number(item) for item in value] if isinstance(value, list) else float(value)


class Watch:
    """What is used in place of a measurement, and which status that is; theory.md section 8."""

    loads = 0

    def __init__(self, law, bad_limit):
        self.law, self.limit, self.bad, self.expected, self.known = law, bad_limit, 0, None, False
        self.x, self.w = np.zeros(law.n), np.zeros(law.E.shape[1])

    def observe(self, x, w):
        """Status and the x and w to predict with."""
        status = "OK"
        if all(map(usable, w)):
            self.w = np.array(w, float)
        else:
            status = "COASTING"
        if all(map(usable, x)):
            self.x, self.known = np.array(x, float), True
        elif self.expected is None:
            status = "HELD"
        else:
            status, self.x = "COASTING", self.expected
        self.bad = 0 if status == "OK" else self.bad + 1
        return "SAFE" if self.limit and self.bad >= self.limit else status

    @property
    def disturbance(self):
        return self.w

    def advance(self, u):
        """The state expected at the next instant, once anything has been measured."""
        if self.known:
            self.expected = self.law.state_after(self.law.Ts, self.x, self.w, u, [1] * self.law.m, u)


def complete(problem):
    """All arguments of the transcription."""
    m, q, n = len(problem["delay"]), len(problem["C"]), len(problem["A"])
    default = {
        "E": np.zeros((n, 0)), "u_offset": [0.0] * m, "y_offset": [0.0] * q, "weight": [1.0] * q, "tail": "rest",
        "min_on": [0.0] * m, "min_off": [0.0] * m, "switch_cost": [0.0] * m, "forbidden": [],
        "safe": [min(levels, key=abs) for levels in problem["levels"]],
    }  # fmt: skip
    if "horizon" in problem:  # what the endpoint law would have besides
        default |= {"Td": problem["Ts"], "lam": [1.0] * q, "r": [1] * q}
    return default | problem


class HorizonLaw(Law):
    """The same bookkeeping, the costs by enumeration: of each candidate, with the best that may follow it."""

    def __init__(self, *, horizon, **problem):
        super().__init__(**problem)
        steps, m = horizon["steps"], self.m
        matrix = horizon.get("terminal")
        self.problem = horizon_oracle.Problem(
            self.A, self.B, self.C, self.E, self.delay, self.u_offset, self.y_offset, self.levels, self.Ts, steps,
            horizon.get("moves", steps), horizon.get("window", (1, steps)), np.array(self.weight),
            np.broadcast_to(horizon.get("move_weight", 0.0), (m,)), np.array(self.switch_cost), horizon["tail"],
            horizon.get("lam"), self.r, None if matrix is None else np.array(matrix), [], self.min_on, self.min_off,
            problem["forbidden"],
        )  # fmt: skip

    def costs(self, x, w, reference):
        return horizon_oracle.best(self.problem, self.history, x, w, reference, self.remaining)[1]


def controller(case, real="float64"):
    """The library's controller of a case, as it starts."""
    p = complete(case["problem"])
    plant = fsw.Plant(
        p["A"], p["B"], p["C"], E=p["E"], input_delay=p["delay"], u_offset=p["u_offset"], y_offset=p["y_offset"]
    )
    objective = fsw.Endpoint(p["Td"], p["lam"], tail=p["tail"], weight=p["weight"])
    if "horizon" in p:
        objective = fsw.Horizon(**p["horizon"], weight=p["weight"], relative_degree=p["r"])
    options = {name: p[name] for name in ("min_on", "min_off", "switch_cost", "forbidden")}
    if case["bad_limit"]:
        options |= {"safe_level": p["safe"], "bad_limit": case["bad_limit"]}
    if "estimator" in p:
        options["estimator"] = fsw.Kalman(**p["estimator"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = fsw.Controller(plant, p["levels"], p["Ts"], objective, real=real, **options)
    result.reset(pending=case["pending"], elapsed=case["elapsed"])
    return result


#: Tables that the sizes of others follow from; they come first.
FIRST = ("level_count", "pending", "holds")


def design(made):
    """The core's sizes and tables by name."""
    return named(made.design, FIRST)


def horizon_design(made):
    """The same of its horizon, without what it has from the design around it."""
    return named(made.design.horizon)


def named(part, first=()):
    """Numbers, then tables as lists."""
    sizes = {each.name: getattr(part, each.name) for each in part.scalars() if not each.metadata["shared"]}
    tables = {each.name: getattr(part, each.name) for each in part.tables() if not each.metadata["host"]}
    tables = {name: tables[name] for name in first} | tables
    return sizes | {name: None if values is None else values.tolist() for name, values in tables.items()}


def decided(costs, margin):
    """Whether the best candidate is better by enough."""
    ordered = sorted(cost for cost in costs if isfinite(cost))
    return len(ordered) == 1 or ordered[1] - ordered[0] > margin * ordered[1]


def started(case):
    """The transcription of a case, as it starts, and what it knows of the state."""
    problem = complete(case["problem"])
    estimator = problem.pop("estimator", None)
    if estimator:
        loaded = np.array(problem["B"])[:, np.array(estimator["load"]) > 0]
        problem["E"] = np.hstack([problem["E"], loaded])
    law = HorizonLaw(**problem) if "horizon" in problem else Law(**problem)
    law.reset(case["pending"], case["elapsed"])
    if not estimator:
        return law, Watch(law, case["bad_limit"])
    n, loads = law.n, loaded.shape[1]
    Phi, _, Gamma_w = law.constant_input(law.Ts)
    A = np.block([[Phi, Gamma_w[:, Gamma_w.shape[1] - loads :]], [np.zeros((loads, n)), np.eye(loads)]])
    variances = [*estimator["process_noise"], *(v for v in estimator["load"] if v)]
    gain, innovation = riccati_gain(
        A, np.hstack([law.C, np.zeros((law.q, loads))]), np.diag(variances), np.diag(estimator["measurement_noise"])
    )
    assert law.q == 1 or not estimator["gate"], "with several outputs the gate is wider"
    limits = estimator["gate"] ** 2, estimator["gate_limit"], case["bad_limit"]
    return law, Estimator(law, loads, gain, innovation, *limits)


def line(law, rows):
    """Level indices of the last commands issued, oldest first."""
    history = ([law.history[0]] * rows + law.history)[-rows:]
    return [levels.index(value) for command in history for levels, value in zip(law.levels, command, strict=True)]


def steps(case, law, watch):
    """Inputs and expectations, the plant being the model but for the loads."""
    estimates = "estimator" in case["problem"]
    loads = np.array(case.get("load", []))[np.array(case["problem"]["estimator"]["load"]) > 0] if estimates else []
    x = np.array(case.get("x", [0.0] * law.n))
    horizon = case["problem"].get("horizon")
    ahead = max(law.delay) + law.Ts * np.arange(1, horizon["steps"] + 1) if horizon else None
    margin = MARGIN_OF_HORIZON if horizon else MARGIN
    for k in range(STEPS):
        t = k * law.Ts
        w = np.array(case["w"](t) if "w" in case else [], float)
        reference = np.array([case["reference"](t + a) for a in ahead] if horizon else case["reference"](t), float)
        measured = law.C @ x + law.y_offset + case["noise"](k) if estimates else x
        shown, shown_w = case.get("bad", {}).get(k, measured.tolist()), case.get("bad_w", {}).get(k, w.tolist())
        status = watch.observe(shown, shown_w)
        costs = None
        if status == "HELD":
            u = np.array(law.history[-1])
        elif status == "SAFE":
            u = np.array(law.safe)
        else:
            while not decided(costs := law.costs(watch.x, watch.disturbance, reference), margin):
                value = reference[..., 0, 0]  # of the first output, at all evaluations
                value += 0.01 * max(1.0, abs(value.flat[0]))
            u = law.candidates[law.choice(costs)]
        yield {
            "x": shown, "reference": reference.tolist(), "w": shown_w,
            "status": status, "costs": None if costs is None else costs.tolist(), "u": u.tolist(),
        } | ({"estimate": None if watch.x is None else [*watch.x, *watch.d]} if estimates else {})  # fmt: skip
        watch.advance(u)
        x = law.state_after(law.Ts, x, np.concatenate([w, loads]), u, [1] * law.m, u)
        law.issue(u)


def vectors():
    """Content of every file by name."""
    result = {}
    for name, case in CASES.items():
        case = {"bad_limit": 0, "pending": None, "elapsed": None} | case
        made = controller(case)
        problem, (law, watch) = complete(case["problem"]), started(case)
        result[name] = {
            "about": case["about"],
            "problem": problem | {"E": np.asarray(problem["E"]).tolist(), "bad_limit": case["bad_limit"]},
            "start": {"pending": case["pending"], "elapsed": case["elapsed"]},
            "design": design(made),
            **({"horizon": horizon_design(made)} if "horizon" in problem else {}),
            "line": line(law, made.pending_steps + 1),
            "wait": list(law.remaining),
            "steps": list(steps(case, law, watch)),
        }
    return result


def spelled(value):
    """JSON has no NaN and no infinity."""
    if isinstance(value, dict):
        return {key: spelled(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [spelled(item) for item in value]
    return str(value) if isinstance(value, float) and not isfinite(value) else value


def text(content):
    """One line per entry and per step."""
    lines = []
    for key, value in spelled(content).items():
        if key in ("design", "horizon", "problem"):
            inner = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items())
            lines.append(f"{json.dumps(key)}: {{\n{inner}\n }}")
        elif key == "steps":
            inner = ",\n".join("  " + json.dumps(step) for step in value)
            lines.append(f'"steps": [\n{inner}\n ]')
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n " + ",\n ".join(lines) + "\n}\n"


if __name__ == "__main__":
    for name, content in vectors().items():
        (HERE / f"{name}.json").write_text(text(content))
