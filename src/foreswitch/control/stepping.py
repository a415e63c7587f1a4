"""What a controller does in each switching period: the run time, on the core that holds its design."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._binding import REALS
from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.actuator import Actuator, level_indices
from foreswitch.control.decision import Decision, Memory, Status, canonical_reference
from foreswitch.control.design import Design
from foreswitch.control.start import commands_under_way, known_state, running_dwell
from foreswitch.model.plant import Plant

__all__ = ["Stepping"]

STATUSES = tuple(Status)


class Stepping:
    """The run time of a `Controller`, which is designed there.

    Attributes
    ----------
    plant, Ts, actuator, design
        As in `Controller`.
    core : object
        The C core with the design, and the one thing that changes: its state.
    """

    plant: Plant
    Ts: float
    real: str
    actuator: Actuator
    design: Design
    core: Any

    @property
    def levels(self) -> list[Array]:
        """Levels of each input, ascending."""
        return self.actuator.levels

    @property
    def safe_levels(self) -> Array:
        """The level in which each input counts as off, shape (m,)."""
        return self.actuator.safe_levels

    @property
    def measured(self) -> tuple[int, str]:
        """How many values are measured, and what they are."""
        return self.design.measured, "measured state" if self.design.gain is None else "measured output"

    @property
    def order(self) -> int:
        """Reference derivatives wanted, the value included."""
        return self.design.order

    @property
    def evaluations(self) -> int:
        """Instants at which the reference is wanted."""
        horizon = self.design.horizon
        return 1 if horizon is None else horizon.steps - horizon.lead

    @property
    def pending_steps(self) -> int:
        """Commands under way, as many as the longest dead time has periods, rounded up."""
        return self.design.rows - 1

    @property
    def issued(self) -> Array:
        """Commands issued, oldest first, the last one in force, shape (pending_steps + 1, m)."""
        return self.actuator.values(self._line())

    @property
    def memory(self) -> Memory:
        """What is carried from one period to the next."""
        x, w = np.empty(self.plant.states), np.empty(self.design.disturbances)
        known = self.core.estimate(x, w)
        wait = np.frombuffer(self.core.wait(), dtype=np.uint32)
        return Memory(self._line(), wait, x if known else None, w if known else None)

    def _line(self) -> np.ndarray[Any, np.dtype[np.uint8]]:
        """Level indices of the commands issued, oldest first."""
        return np.frombuffer(self.core.line(), dtype=np.uint8).reshape(-1, self.plant.inputs)

    @property
    def status(self) -> Status:
        """What the latest command is based on."""
        code: int = self.core.status
        return STATUSES[code]

    @property
    def bad_samples(self) -> tuple[int, int]:
        """Samples that were not usable: in a row up to now, and in total since the latest `reset`."""
        in_a_row, total = self.core.bad()
        return in_a_row, total

    @property
    def estimate(self) -> tuple[Array, Array]:
        """The state (n,) and the loads (l,) that the latest command is based on; NaN before anything was measured."""
        memory, p = self.memory, self.plant.disturbances
        if memory.x is None or memory.w is None:
            return np.full(self.plant.states, np.nan), np.full(self.design.loads, np.nan)
        return memory.x, memory.w[p:]

    def reset(
        self,
        *,
        pending: ArrayLike | None = None,
        elapsed: ArrayLike | None = None,
        estimate: ArrayLike | None = None,
        load: ArrayLike | None = None,
        disturbance: ArrayLike | None = None,
    ) -> None:
        """Forget the measurements; start from known commands, and from a known state if there is one.

        Parameters
        ----------
        pending : array_like, shape (rows, m), optional
            Commands issued but not yet acted on, oldest first, the last one in force; at least
            `pending_steps` rows. One input: also shape (rows,). Default: the safe level.
        elapsed : float or array_like, shape (m,), optional
            Seconds since each input last switched. Default: long ago.
        estimate : array_like, shape (n,), optional
            State one period before the next step, as the property `estimate` tells it. Default: the first measurement,
            with an estimator the state at rest there.
        load, disturbance : array_like, shape (l,) and (p,), optional
            Loads and measured disturbance at that instant. Default: zero.

        Raises
        ------
        ValueError
            If a row is missing, is not an allowed command, a time is negative, or a shape does not fit.
        """
        known = known_state(self.plant, self.design.loads, estimate, load, disturbance)
        line = commands_under_way(self.actuator, self.pending_steps, pending)
        self.core.preload(line.ravel(), running_dwell(self.actuator, self.Ts, line[-1], elapsed))
        if known is not None:
            real = REALS[self.real]
            self.core.start(known[0].astype(real), known[1].astype(real))

    def step(self, x: ArrayLike, reference: ArrayLike, *, disturbance: ArrayLike | None = None) -> Array:
        """One switching period: choose and remember the command.

        Parameters
        ----------
        x : array_like, shape (n,); with an estimator (q,)
            Measured state, or measured outputs. NaN or infinity is no error: the model's prediction stands in, `status`
            says so.
        reference : array_like
            Canonical shape (evaluations, q, order). Short forms, over all evaluations: a scalar;
            1-D, (order,) for one output, else (q,); 2-D, (q, order). Missing derivatives are zero.
        disturbance : array_like, shape (p,), optional
            Measured w. Default: zero.

        Returns
        -------
        ndarray, shape (m,)
            The levels to command until the next step.

        Raises
        ------
        ValueError
            If a shape does not fit or the reference is not finite.
        """
        u: Array | None = self.core.step(x, reference, disturbance)
        if u is not None:
            return u
        converted: Array = self.core.step(*self._canonical(x, reference, disturbance))
        return converted

    def decide(self, x: ArrayLike, reference: ArrayLike, *, disturbance: ArrayLike | None = None) -> Decision:
        """Every candidate with its predicted cost; changes nothing.

        Parameters
        ----------
        x, reference, disturbance
            As in `step`.

        Returns
        -------
        Decision

        Raises
        ------
        ValueError
            As in `step`.
        """
        costs = np.empty(len(self.actuator.candidates))
        arguments = self._canonical(x, reference, disturbance)
        candidate, cost, nodes, status, gap = self.core.decide(*arguments, costs)
        chosen = np.frombuffer(self.core.line(), dtype=np.uint8)[-self.plant.inputs :]
        if status == Status.SAFE:
            chosen = np.array(self.actuator.safe, dtype=np.uint8)
        elif candidate < len(costs):
            chosen = self.actuator.candidates[candidate]
        u = self.actuator.values(chosen[None, :])
        decided = candidate < len(costs)
        sequence = self.core.sequence() if decided else None
        plan = (
            u
            if sequence is None
            else self.actuator.values(self.actuator.candidates[np.frombuffer(sequence, dtype=np.uint8)])
        )
        return Decision(
            u[0], cost, self.actuator.values(self.actuator.candidates), costs, plan, nodes, decided and gap == 0.0,
            gap if decided else np.inf, Status(status),
        )  # fmt: skip

    def track(self, command: ArrayLike, x: ArrayLike | None = None, *, disturbance: ArrayLike | None = None) -> None:
        """One switching period in which somebody else chose, say an operator.

        The commands under way, dwell and the estimate stay true, so that the next `step` takes over without a bump.

        Parameters
        ----------
        command : array_like, shape (m,)
            The levels really issued in this period, allowed or not.
        x, disturbance : array_like, optional
            As in `step`; without x nothing was measured.

        Raises
        ------
        ValueError
            If the command is not a level, or a shape does not fit.
        """
        indices = np.array(level_indices("command", command, self.levels), dtype=np.uint8)
        self.core.track(*self._measurement(x, disturbance), indices)

    def missed(self, periods: int = 1) -> None:
        """So many steps did not take place, and the command in force went on. Call before the next `step`.

        Parameters
        ----------
        periods : int
            At most 65535; after a longer silence, `reset`.

        Raises
        ------
        ValueError
            If the number is out of range.
        """
        if not 0 <= check.number("periods", periods) <= 65535 or periods != int(periods):
            raise Mistake("periods", periods, "give 0 to 65535, or reset after a longer silence")
        self.core.missed(int(periods))

    def safe(self, x: ArrayLike | None = None, *, disturbance: ArrayLike | None = None) -> Array:
        """One switching period at the safe levels, whatever the dwell: in place of `step` for as long as a fault lasts.

        Parameters
        ----------
        x, disturbance : array_like, optional
            As in `track`.

        Returns
        -------
        ndarray, shape (m,)
            The safe levels.

        Raises
        ------
        ValueError
            If a shape does not fit.
        """
        self.core.safe(*self._measurement(x, disturbance))
        u: Array = self.issued[-1]
        return u

    def _measurement(self, x: ArrayLike | None, disturbance: ArrayLike | None) -> tuple[Any, Any]:
        """What was measured, as the core takes it; nothing where x is None."""
        if x is None:
            return None, None
        return check.vector("x", x, *self.measured), self._w(disturbance)

    def _w(self, disturbance: ArrayLike | None) -> Array:
        p = self.plant.disturbances
        if disturbance is None:
            return np.zeros(p)
        return check.vector("disturbance", disturbance, p, "measured disturbance")

    def _canonical(self, x: ArrayLike, reference: ArrayLike, disturbance: ArrayLike | None) -> tuple[Array, Array, Any]:
        """Arguments in the one form the core takes, or a ValueError."""
        state, w = check.vector("x", x, *self.measured), self._w(disturbance)
        return state, canonical_reference(reference, self.plant.outputs, self.order, self.evaluations), w

    def take_over(self, other: Stepping) -> None:
        """Remember the commands and the running dwell of another controller; what was measured stays.

        Parameters
        ----------
        other : Controller
            With the same levels, switching period and dead times.
        """
        memory = other.memory
        self.core.preload(memory.line.ravel(), memory.wait, True)
