"""The long horizon's problems for general solvers, each in the best encoding found for it; all solvers are optional."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from time import perf_counter

import numpy as np

from foreswitch.control.horizon_tables import _lift
from problems import Problem

SOLVERS = {"DAQP": "daqp", "SCIP": "pyscipopt", "HiGHS": "highspy"}


def installed(solver: str) -> bool:
    return find_spec(SOLVERS[solver]) is not None


@dataclass(frozen=True)
class Solved:
    """For each instance the shortest time, the moves found and whether they are proven best."""

    seconds: np.ndarray
    moves: list[np.ndarray]
    proven: bool


def quadratic(one: Problem) -> np.ndarray:
    """H of J = u'Hu + 2 f'u + const."""
    size = one.rows.shape[1]
    difference = np.eye(size) - np.eye(size, k=-one.values.shape[1])
    return one.rows.T @ one.rows + one.move_weight * difference.T @ difference


def linear(one: Problem, instance: int) -> np.ndarray:
    """f of the same."""
    f = one.rows.T @ one.error[instance]
    f[: one.values.shape[1]] -= one.move_weight * one.present[instance]
    return f


#: For two levels and for three.
ENCODINGS = {2: ("plain", "lifted"), 3: ("sum", "difference")}


def daqp(one: Problem, encoding: str, instances: Sequence[int], sweeps: int) -> Solved:
    """Dual active sets below branch and bound over binaries; its own solve time, without its set-up.

    Two levels: ``plain``, or ``lifted``, which is told that u^2 = u as the core is. Three: u = a + b - 1 with a >= b
    (``sum``) or u = a - b with a + b <= 1 (``difference``), so that hardly a value has two encodings, and a little
    convexity that costs nothing at binaries.
    """
    import daqp as solver

    H, n = quadratic(one), one.rows.shape[1]
    if encoding in ("plain", "lifted"):
        T, base, A = np.eye(n), np.zeros(n), np.zeros((0, n))
        shift = _lift(H, np.ones(n, dtype=bool)) if encoding == "lifted" else np.zeros(n)
    else:
        sign = 1.0 if encoding == "sum" else -1.0
        T, base, A = np.kron(np.eye(n), [1.0, sign]), np.full(n, min(-sign, 0.0)), np.kron(np.eye(n), [1.0, -sign])
        shift = np.full(2 * n, -1e-4)
    quadratic_part, offset = 2.0 * (T.T @ H @ T - np.diag(shift)), H @ base
    sense = np.repeat(np.array([16, 0], dtype=np.int32), [T.shape[1], len(A)])
    lower, upper = np.zeros(len(sense)), np.ones(len(sense))
    seconds, moves = np.full(len(instances), np.inf), {}
    for _ in range(sweeps):
        for at, i in enumerate(instances):
            f = 2.0 * T.T @ (linear(one, i) + offset) + shift
            b, _, flag, info = solver.solve(quadratic_part, f, A, upper, lower, sense)
            assert flag == 1, f"DAQP leaves {flag}"
            seconds[at] = min(seconds[at], info["solve_time"])
            moves[at] = (T @ np.round(b) + base).reshape(one.moves, -1)
    return Solved(seconds, list(moves.values()), True)


def scip(one: Problem, instances: Sequence[int], limit: float) -> Solved:
    """Integers, residuals and changes as variables, the sum of their squares below the objective; ``limit`` in seconds."""
    from pyscipopt import Model, quicksum

    m, seconds, moves, proven = one.values.shape[1], [], [], True
    for i in instances:
        model = Model()
        model.hideOutput()
        u = [model.addVar(vtype="I", lb=one.values.min(), ub=one.values.max()) for _ in range(one.rows.shape[1])]
        e, d = ([model.addVar(lb=None) for _ in range(count)] for count in (len(one.rows), len(u)))
        for v, error, row in zip(e, one.error[i], one.rows, strict=True):
            effects = quicksum(float(a) * move for a, move in zip(row, u, strict=True) if a)
            model.addCons(v == float(error) + effects)
        for j, v in enumerate(d):
            model.addCons(v == u[j] - (u[j - m] if j >= m else float(one.present[i][j])))
        t = model.addVar(lb=0)
        model.addCons(quicksum(v * v for v in e) + one.move_weight * quicksum(v * v for v in d) <= t)
        model.setObjective(t)
        model.setParam("limits/time", limit)
        start = perf_counter()
        model.optimize()
        seconds.append(perf_counter() - start)
        moves.append(np.round([model.getVal(v) for v in u]).reshape(one.moves, -1))
        proven &= model.getStatus() == "optimal"
    return Solved(np.array(seconds), moves, proven)


def highs(one: Problem, instances: Sequence[int], sweeps: int) -> np.ndarray:
    """Seconds for one relaxation to the levels' hull: HiGHS takes no quadratic objective over integers, which is checked."""
    import highspy

    H, size = quadratic(one), one.rows.shape[1]
    hessian = highspy.HighsHessian()
    hessian.dim_, hessian.format_ = size, highspy.HessianFormat.kTriangular
    column, row = np.triu_indices(size)
    hessian.start_ = np.searchsorted(column, np.arange(size + 1)).astype(np.int32)
    hessian.index_, hessian.value_ = row.astype(np.int32), 2.0 * H[row, column]

    def solver(i: int) -> highspy.Highs:
        result = highspy.Highs()
        result.setOptionValue("output_flag", False)
        result.setOptionValue("threads", 1)
        for f in linear(one, i):
            result.addVar(one.values.min(), one.values.max())
            result.changeColCost(result.getNumCol() - 1, 2.0 * f)
        result.passHessian(hessian)
        return result

    integer = solver(instances[0])
    for j in range(size):
        integer.changeColIntegrality(j, highspy.HighsVarType.kInteger)
    assert integer.run() == highspy.HighsStatus.kError, "HiGHS now takes quadratic objectives over integers: compare"
    seconds = np.full(len(instances), np.inf)
    for _ in range(sweeps):
        for at, i in enumerate(instances):
            relaxed = solver(i)
            start = perf_counter()
            relaxed.run()
            seconds[at] = min(seconds[at], perf_counter() - start)
    return seconds
