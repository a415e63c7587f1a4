"""The loop of an `Endpoint` law around its ideal response, which has the same law and an unquantised input.

Every command counts from when it is issued, as if it had acted in full: ``xi_k`` is the state at ``t_k + max tau`` if no
further command came. So unequal dead times need no augmented state:

    xi[k+1] = Phi xi[k] + sum_j Gamma_j u_j[k],   Gamma_j = e^(A (max tau - tau_j)) int_0^Ts e^(A v) dv B_j
    s = S e^(A Td) xi + h (u - tail) + ...,        h = S e^(A (Td - Ts)) Gamma

The unquantised input that minimises the cost is ``u = gain xi + ...``; the true one differs from it by the quantiser's
error. Of the deviation from the ideal response remains

    xi[k+1] = (Phi + Gamma gain) xi[k] + Gamma (quantiser's error) + what a wrong gain or dead time adds.

Only directions of u that show in the cost, ``p = metric u``, are quantised; the others are a bounded input.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.linalg import expm

from foreswitch._helpers.check import Array
from foreswitch.certificate.model_errors import Errors, Windows
from foreswitch.certificate.peak_gain import Recursion, Unsettled
from foreswitch.control.endpoint import EndpointLaw
from foreswitch.control.objective import Endpoint
from foreswitch.model.prediction import transition

if TYPE_CHECKING:
    from foreswitch.control.controller import Controller

__all__ = ["ErrorLoop"]

#: Singular values of h below this share of the largest do not count.
RANK = 1e-9
#: |A| times the time between two instants at which the output is looked at stays below this.
RESOLUTION = 0.25


class ErrorLoop:
    """Matrices of the deviation from the ideal response.

    Parameters
    ----------
    controller : Controller
        With an `Endpoint`.

    Attributes
    ----------
    phi, gamma, M : ndarray, shape (n, n), (n, m), (n, n)
        Of the recursions above: open, input, closed.
    gain : ndarray, shape (m, n)
        Unquantised law on xi.
    choice : ndarray, shape (m, q)
        Unquantised law on s: ``u = -choice s_free``.
    metric, inverse, hidden : ndarray, shape (rank, m), (m, rank), (m, m)
        ``p = metric u``, ``u = inverse p + hidden u``; the cost is half the squared distance in p.
    commands : ndarray, shape (p, m)
        Every command that may be chosen.
    """

    def __init__(self, controller: Controller) -> None:
        plant, Ts = controller.plant, controller.Ts
        law, Td = cast(EndpointLaw, controller.law), cast(Endpoint, controller.objective).Td
        self.controller, self.plant, self.law, self.Ts = controller, plant, law, Ts
        self.windows = Windows(plant, controller.levels, Ts)
        A, ahead = plant.A, self.windows.longest - plant.input_delay
        self.phi, gamma = transition(A, plant.B, Ts)
        self.gamma = np.column_stack([expm(A * t) @ column for t, column in zip(ahead, gamma.T, strict=True)])
        weigh = np.sqrt(law.weight)[:, None]
        S = weigh * law.sliding.state
        h = S @ expm(A * (Td - Ts)) @ self.gamma
        U, size, V = np.linalg.svd(h, full_matrices=False)
        self.rank = int((size > RANK * size[0]).sum())
        U, size, V = U[:, : self.rank], size[: self.rank], V[: self.rank]
        self.metric, self.inverse, self.hidden = size[:, None] * V, V.T / size, np.eye(plant.inputs) - V.T @ V
        self.choice = self.inverse @ U.T * weigh.T
        self.gain = -self.inverse @ (U.T @ (S @ expm(A * Td)))
        self.M = self.phi + self.gamma @ self.gain
        self.commands = controller.actuator.values(controller.actuator.candidates)

    @cached_property
    def poles(self) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Poles of the ideal loop, slowest first."""
        poles = np.linalg.eigvals(self.M).astype(np.complex128)
        return poles[np.argsort(-np.abs(poles), kind="stable")]

    @cached_property
    def recursion(self) -> Recursion:
        """The ideal loop's; raises `Unsettled` if it is not stable."""
        return Recursion(self.M)

    @property
    def settles(self) -> bool:
        """Whether errors decay, and soon enough to be summed."""
        try:
            return self.recursion.steps > 0
        except Unsettled:
            return False

    def shifted(self, j: int, error: float) -> Array:
        """What a dead time that is wrong by so much adds to column j of gamma, (n,)."""
        result: Array = expm(-self.plant.A * error) @ self.gamma[:, j] - self.gamma[:, j]
        return result

    def model_reach(self, rows: Array, errors: Errors) -> Array:
        """Bound of ``rows xi``, (r,), by what wrong dead times and gains in hidden directions add to the recursion."""
        total = self._hidden(self.recursion.sums(rows, self.gamma @ self._hidden_inputs(errors)))
        for j in range(self.plant.inputs):
            if errors.delay[j] > 0:
                columns = np.column_stack([self.shifted(j, e) for e in self.windows.delay_errors(j, errors)])
                late = self.windows.weights(j, errors)[0]
                total = total + late * self.recursion.sums(rows, columns).max(axis=1)
            if errors.load[j] > 0:
                pieces = self.windows.slices(j, self.Ts).T
                total = total + self.windows.loaded(j, errors) * self.recursion.sums(rows, pieces).sum(axis=1)
        return total

    def _hidden_inputs(self, errors: Errors) -> Array:
        """Columns whose largest size bounds the hidden part of any command: of each one, and of the gains' errors."""
        each = (self.hidden @ self.commands.T).reshape(self.plant.inputs, -1)
        return np.hstack([each, self.hidden * self.windows.surplus(errors)])

    def _hidden(self, sizes: Array) -> Array:
        """The worst command's size and all gains' together, from columns as above."""
        count = len(self.commands)
        result: Array = sizes[..., :count].max(axis=-1) + sizes[..., count:].sum(axis=-1)
        return result

    # ---- From the recursion to the output, at all times ----

    def output_reach(self, radius: float, errors: Errors) -> Array:
        """Bound of the output's deviation at any time, (q,), where the quantiser's error in p is at most ``radius`` long."""
        worst = np.zeros(self.plant.outputs)
        for instants in self._cells(errors):
            each = [self._output(s, errors) for s in instants]
            reach = np.max([self._reach(view, radius, errors) for view in each], axis=0)
            # between two instants a view differs from its chord by an eighth of the second difference
            bends = [a.minus_twice(b, c) for a, b, c in zip(each[:-2], each[1:-1], each[2:], strict=True)]
            bend = np.max([self._reach(view, radius, errors) for view in bends], axis=0)
            worst = np.maximum(worst, reach + bend / 8.0)
        return worst

    def _cells(self, errors: Errors) -> list[Array]:
        """Instants after t_k + max tau within one period, divided where a command begins to act."""
        Ts, windows = self.Ts, self.windows
        edges = {0.0, Ts}
        for j, tau in enumerate(windows.tau):
            for error in self.windows.delay_errors(j, errors):
                edge = float((tau + error - windows.longest) % Ts)
                edges |= {edge} if 1e-9 * Ts < edge < (1.0 - 1e-9) * Ts else set()
        at = sorted(edges)
        size = float(np.abs(np.linalg.eigvals(self.plant.A)).max())
        return [np.linspace(a, b, 1 + max(2, int(np.ceil(size * (b - a) / RESOLUTION)))) for a, b in pairwise(at)]

    def _output(self, after: float, errors: Errors) -> View:
        """The output ``after`` seconds behind t_k + max tau."""
        windows, plant, Ts = self.windows, self.plant, self.Ts
        at = windows.longest + after
        count = 1 + int(np.ceil((at - float(windows.tau.min())) / Ts - 1e-9))  # commands from k on that may act by then
        direct = np.zeros((count, plant.outputs, plant.inputs))
        for i in range(count):
            for j in range(plant.inputs):
                direct[i, :, j] = plant.C @ windows.part(j, i, 0.0, -np.inf, at, at)
        through = np.zeros((count + 1, plant.outputs, plant.states))  # of a change of xi[k + i]
        for i in range(count - 1, -1, -1):
            through[i] = direct[i] @ self.gain + through[i + 1] @ self.M
        late: list[Late] = []
        for j in range(plant.inputs):
            for error in self.windows.delay_errors(j, errors) if errors.delay[j] > 0 else ():
                first, last = -int(np.ceil(max(error, 0.0) / Ts)) - 1, count + int(np.ceil(max(-error, 0.0) / Ts))
                column, own = self.shifted(j, error), np.zeros((last - first, plant.outputs))
                for i in range(first, last):
                    # xi counts an earlier command in full, the rows above count a later one without its error
                    counted = (error, np.inf) if i < 0 else (0.0, at)
                    done = windows.part(j, i, error, -np.inf, at, at)
                    own[i - first] = plant.C @ (done - windows.part(j, i, counted[0], -np.inf, counted[1], at))
                    if 0 <= i < count:
                        own[i - first] += through[i + 1] @ column
                late.append(Late(j, first, column, own))
        loads = []
        for j in range(plant.inputs):
            if errors.load[j] > 0:
                pieces = windows.slices(j, Ts)
                own = through[1:] @ pieces.T  # (count, q, slices)
                own[0] += self._slices_until(j, after, len(pieces))
                loads.append(Load(j, pieces, own))
        view = plant.C @ expm(plant.A * after) + through[0]
        return View(view, direct + through[1:] @ self.gamma, late, loads)

    def _slices_until(self, j: int, after: float, count: int) -> Array:
        """What a load in each slice of a period shows in the output so many seconds into it, (q, count)."""
        edges = np.minimum(np.linspace(0.0, self.Ts, count + 1), after)
        each = [self.plant.C @ self.windows.effect(j, a, b, after) for a, b in pairwise(edges)]
        return np.array(each).T

    def _reach(self, view: View, radius: float, errors: Errors) -> Array:
        """Bound of what is seen, (q,)."""
        quantised = self.recursion.sums(view.state, self.gamma @ self.inverse, norm=2)
        quantised = quantised + np.sqrt(np.square(view.commands @ self.inverse).sum(axis=2)).sum(axis=0)
        columns = self._hidden_inputs(errors)
        hidden = self.recursion.sums(view.state, self.gamma @ columns) + np.abs(view.commands @ columns).sum(axis=0)
        total: Array = radius * quantised + self._hidden(hidden)
        wrong = np.zeros((self.plant.inputs, self.plant.outputs))
        for late in view.late:
            past, column = -late.first, late.column[:, None]  # of the commands before k, the latest comes last
            terms = self.recursion.terms(view.state, column, past)[:, :, 0][::-1]
            both = late.own.copy()
            both[:past] += terms
            size = self.recursion.sums(view.state, column)[:, 0] - np.abs(terms).sum(axis=0) + np.abs(both).sum(axis=0)
            wrong[late.input] = np.maximum(wrong[late.input], self.windows.weights(late.input, errors)[0] * size)
        total += wrong.sum(axis=0)
        for load in view.loads:
            size = self.recursion.sums(view.state, load.pieces.T).sum(axis=1) + np.abs(load.own).sum(axis=(0, 2))
            total += self.windows.loaded(load.input, errors) * size
        return total


@dataclass(frozen=True)
class Late:
    """What one wrong dead time adds."""

    input: int
    first: int  # command that `own` begins with, relative to k; negative
    column: Array  # (n,), to gamma
    own: Array  # (commands, q), effect of each command on the output, not through xi_k


@dataclass(frozen=True)
class Load:
    """What an unmeasured load on one input adds."""

    input: int
    pieces: Array  # (slices, n), to xi over one period
    own: Array  # (count, q, slices), effect on the output of what acts after xi_k


@dataclass(frozen=True)
class View:
    """How the output at one instant depends on xi_k, on commands from k on, and on commands that act late."""

    state: Array  # (q, n)
    commands: Array  # (count, q, m), their effect on later commands included
    late: list[Late]
    loads: list[Load]

    def minus_twice(self, middle: View, right: View) -> View:
        """``self - 2 middle + right``."""
        count = max(len(v.commands) for v in (self, middle, right))

        def padded(rows: Array) -> Array:
            return np.concatenate([rows, np.zeros((count - len(rows), *rows.shape[1:]))])

        def bend(a: Array, b: Array, c: Array) -> Array:
            result: Array = padded(a) - 2.0 * padded(b) + padded(c)
            return result

        late = []
        for a, b, c in zip(self.late, middle.late, right.late, strict=True):
            size = min(len(a.own), len(b.own), len(c.own))
            late.append(replace(a, own=a.own[:size] - 2.0 * b.own[:size] + c.own[:size]))
        state = self.state - 2.0 * middle.state + right.state
        loads = [
            replace(a, own=bend(a.own, b.own, c.own))
            for a, b, c in zip(self.loads, middle.loads, right.loads, strict=True)
        ]
        return View(state, bend(self.commands, middle.commands, right.commands), late, loads)
