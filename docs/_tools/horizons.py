"""The family of laws on the paper's plant: figures for the page on the long horizon."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import DELAY, LAM, RISE, TD, TS, Values, hot_gas
from foreswitch.model.prediction import period_model
from foreswitch.presentation.report import number
from foreswitch.project import Project
from foreswitch.simulation.report import search_figures
from foreswitch.simulation.run import Run

ROOT = Path(__file__).resolve().parents[2]
PERIODS = 600
#: Prices of a move, squares of kPa: one that only keeps the relaxed law from dead beat, one that halves the switches.
LITTLE, MUCH = 10.0, 300.0
HEADS = ["law", "here", "rms error [kPa]", "lag [ms]", "switches", "sequences", "nodes, median", "nodes, largest"]


class Response:
    """How the paper's plant answers to a sequence, by hand; its dead time is a whole number of periods."""

    def __init__(self, steps: int, moves: int) -> None:
        self.plant, self.steps, self.moves = hot_gas(), steps, moves
        model = period_model(self.plant, TS)
        self.phi, self.gamma, self.delay = model.transition, model.old[0], model.delay[0]
        impulse = [float(self.plant.C[0] @ np.linalg.matrix_power(self.phi, i) @ self.gamma) for i in range(steps)]
        self.H = np.zeros((steps, moves))  # the last move is held
        for i in range(steps):
            for j in range(i + 1):
                self.H[i, min(j, moves - 1)] += impulse[i - j]

    def missing(self, k: int, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Reference less free response at the instants evaluated, from the state at t_k and the commands before it."""
        for i in range(k - self.delay, k):
            x = self.phi @ x + self.gamma * (u[i] if i >= 0 else 0.0)
        free = []
        for _ in range(self.steps):
            x = self.phi @ x
            free.append(float(self.plant.C[0] @ x))
        ahead = DELAY + TS * np.arange(1, self.steps + 1)
        wanted: np.ndarray = RISE(k * TS + ahead, 1)[:, 0, 0] - np.array(free)
        return wanted


def cheapest(response: Response, k: int, run: Run) -> float:
    """The least cost of all sequences, each of them tried."""
    missing, N = response.missing(k, run.x[k], run.u[:, 0]), response.moves
    least, block = np.inf, min(N, 16)
    low = (np.arange(2**block)[:, None] >> np.arange(block)) & 1
    for high in range(2 ** (N - block)):
        rest = (high >> np.arange(N - block)) & 1
        miss = low @ response.H[:, :block].T + (response.H[:, block:] @ rest - missing)
        least = min(least, float((miss**2).sum(axis=1).min()))
    return least


def rounded(steps: int, move_weight: float) -> Run:
    """Generalised predictive control: the unconstrained optimum of the same cost, its first move rounded to a level."""
    response = Response(steps, steps)
    difference = np.sqrt(move_weight) * (np.eye(steps) - np.eye(steps, k=-1))
    solve = np.linalg.pinv(np.vstack([response.H, difference]))[0]
    x, u, before = np.zeros((PERIODS + 1, 2)), np.zeros(PERIODS), np.zeros(steps)
    for k in range(PERIODS):
        before[0] = np.sqrt(move_weight) * u[k - 1] if k else 0.0
        u[k] = float(solve @ np.concatenate([response.missing(k, x[k], u), before]) > 0.5)
        acting = u[k - response.delay] if k >= response.delay else 0.0
        x[k + 1] = response.phi @ x[k] + response.gamma * acting
    t, none = np.arange(PERIODS + 1) * TS, np.zeros(PERIODS)
    return Run(
        t, x, x @ response.plant.C.T, u[:, None], RISE(t, 1)[:, :, 0], np.zeros((PERIODS, 0)), none,
        none.astype(np.uint32), none.astype(np.uint8), response.plant, np.zeros(1),
    )  # fmt: skip


def searched(objective: fsw.Endpoint | fsw.Horizon, preview: object = True) -> tuple[Run, fsw.Controller]:
    law = fsw.Controller(hot_gas(), [0, 1], TS, objective, preview=preview)
    return fsw.simulate(law, RISE, PERIODS * TS), law


def exact(steps: int, **settings: object) -> tuple[Run, fsw.Controller]:
    return searched(fsw.Horizon(steps, **settings))


class Family:
    """Rows of the table, and figures for the text."""

    def __init__(self) -> None:
        self.rows: list[list[str]] = []
        self.values: Values = {"periods": PERIODS}

    def add(self, key: str, name: str, here: str, run: Run, law: fsw.Controller | None, sequences: str) -> None:
        """A law's row; of what it has a name for in the text, the figures."""
        m = run.metrics()
        found = search_figures(run) if law else {}
        nodes = [found[name] for name in ("nodes_median", "nodes_max") if found]
        self.rows.append([
            name, here, number(m["rms_error"]), f"{round(1e3 * m['lag'], 2) + 0.0:.2f}", str(m["switches"]), sequences,
            *(f"{count:.0f}" for count in nodes), *[""] * (2 - len(nodes)),
        ])  # fmt: skip
        self.values[f"family_{key}"] = m["rms_error"]
        self.values[f"family_{key}_switches"] = m["switches"]
        if nodes:
            self.values[f"family_{key}_nodes"] = nodes[1]


def literature(family: Family) -> None:
    """What others have published; the paper's law is a member of the family, and the search finds the optimum."""
    paper = searched(fsw.Endpoint(TD, LAM, tail="zero"), "lag")
    steps = round(TD / TS)
    same = searched(fsw.Horizon(steps, lam=LAM, window=(steps, steps), moves=1, tail="zero"), paper[1].lag)
    assert np.array_equal(paper[0].u, same[0].u), "the paper's law is no longer a member of the family"
    family.add("paper", "Shields, Barth and Goldfarb 2006", '`Endpoint(0.020, 2500.0, tail="zero")`', *paper, "2")
    family.add("one", "Sprock and Hsu 1997", "`Horizon(1, lam=2500.0)`", *exact(1, lam=LAM), "2")
    plain = exact(1)
    family.add("plain", "the same without slope", "`Horizon(1)`", *plain, "2")
    for N, instants in ((10, range(0, PERIODS, 5)), (20, (100, 250, 400))):
        run, law = exact(N)
        response = Response(N, N)
        for k in instants:
            least = cheapest(response, k, run)
            assert abs(run.cost[k] - least) <= 1e-9 * max(least, 1.0), f"N = {N}, period {k}: not the optimum"
        family.add(f"exact_{N}", "Tsang and Clarke 1988, bang-bang GPC", f"`Horizon({N})`", run, law, str(2**N))
    family.add("exact_much", "the same, moves weighed", f"`Horizon(20, move_weight={MUCH:g})`",
               *exact(20, move_weight=MUCH), str(2**20))  # fmt: skip
    dead = rounded(20, 0.0)
    assert np.array_equal(dead.u, plain[0].u), "rounded dead beat is no longer the one-step law"
    family.add("dead", "Clarke, Mohtadi and Tuffs 1987, GPC, rounded", "", dead, None, "")
    for key, weight in (("little", LITTLE), ("much", MUCH)):
        family.add(key, f"the same, move weight {weight:g}", "", rounded(20, weight), None, "")


def variations(family: Family) -> None:
    """Shorter horizons, terminal costs, few moves."""
    closed = exact(5)
    family.add("exact_5", "five periods", "`Horizon(5)`", *closed, str(2**5))
    free = exact(5, terminal="riccati")[0]
    assert np.array_equal(free.u, closed[0].u), "a terminal cost now matters where moves are free"
    for N in (2, 5):
        here = f"Horizon({N}, move_weight={MUCH:g}"
        family.add(f"short_{N}", "few periods, moves weighed", f"`{here})`", *exact(N, move_weight=MUCH), str(2**N))
        family.add(f"riccati_{N}", "the same with terminal cost", f'`{here}, terminal="riccati")`',
                   *exact(N, move_weight=MUCH, terminal="riccati"), str(2**N))  # fmt: skip
    family.add("held", "few moves, then held", "`Horizon(20, moves=2)`", *exact(20, moves=2), "4")


def limits() -> Values:
    """What is lost without preview, without a budget of nodes, and with one period on a plant that coasts."""
    values: Values = {}
    for key, N in (("one", 1), ("20", 20)):
        m = searched(fsw.Horizon(N), False)[0].metrics()
        values |= {f"blind_{key}": m["rms_error"], f"blind_{key}_lag": 1e3 * m["lag"]}
    hurried = exact(20, move_weight=MUCH, node_budget=100)
    values["budget_rms"] = hurried[0].metrics()["rms_error"]
    values["budget_proven"] = search_figures(hurried[0])["optimal_percent"]
    values["least_rms"] = exact(20, move_weight=MUCH, node_budget=1)[0].metrics()["rms_error"]
    attitude = Project.read(ROOT / "examples" / "attitude" / "project.toml").with_seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a dwell beyond one period
        lost = attitude.simulate(attitude.build_controller(objective=fsw.Horizon(1), preview=True))
    return values | {"lost": lost.metrics()["rms_error"]}


#: What the text says of the family.
QUOTED = (
    "family_paper", "family_one", "family_exact_10", "family_exact_20", "periods", "family_exact_20_nodes",
    "family_much", "family_much_switches", "family_exact_much", "family_exact_much_switches", "family_little",
    "family_held", "family_short_2", "family_short_2_switches", "family_riccati_2", "family_riccati_2_switches",
    "blind_one_lag", "blind_20_lag", "blind_one", "blind_20", "family_plain", "lost", "budget_proven", "budget_rms",
    "least_rms",
)  # fmt: skip


def family() -> tuple[list[list[str]], Values]:
    """The rows of the table, and figures for the text; what the text says of them holds or this raises."""
    found = Family()
    literature(found)
    variations(found)
    v = {key: float(number(value)) for key, value in found.values.items()}
    assert v["family_exact_20"] <= v["family_exact_10"] < v["family_exact_5"] < v["family_one"] < v["family_plain"]
    assert v["family_exact_much"] < v["family_much"]
    assert v["family_exact_much_switches"] < v["family_much_switches"]
    return found.rows, {key: float(value) for key, value in (found.values | limits()).items()}
