"""What a controller answers, and what it is told in return."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake

__all__ = ["Decision", "Memory", "Status", "canonical_reference"]


class Status(IntEnum):
    """What a command is based on; `remedy` says what to do about it."""

    OK = 0
    COASTING = 1
    HELD = 2
    SAFE = 3

    @property
    def remedy(self) -> str:
        """What happened and what to do, in one sentence."""
        return REMEDIES[self]


REMEDIES = {
    Status.OK: "The command rests on the measurement.",
    Status.COASTING: "A measurement was not finite, or an outlier, and the model's prediction stood in for it. Check the "
    "sensor.",
    Status.HELD: "There was no usable measurement yet, the reference was not finite, or every cost overflowed, and the "
    "present command was kept. Give one measurement and a reference of a sensible size.",
    Status.SAFE: "The safe level was commanded after bad_limit bad samples in a row. Repair the sensor; control "
    "resumes with the first finite measurement.",
}


@dataclass(frozen=True)
class Decision:
    """What a controller would command now, and why.

    Attributes
    ----------
    u : ndarray, shape (m,)
        The command.
    cost : float
        Its predicted cost.
    candidates : ndarray, shape (p, m)
        Every allowed command.
    costs : ndarray, shape (p,)
        Their predicted costs, infinite where a running dwell forbids one.
    sequence : ndarray, shape (moves, m)
        The planned commands, the first of them ``u``; that one alone where nothing was planned.
    nodes : int
        Candidates evaluated.
    optimal : bool
        Whether ``u`` is proven to be the best.
    gap : float
        Cost that an unexplored command could still save.
    status : Status
    """

    u: Array
    cost: float
    candidates: Array
    costs: Array
    sequence: Array
    nodes: int
    optimal: bool
    gap: float
    status: Status


@dataclass(frozen=True)
class Memory:
    """What a controller carries from one switching period to the next.

    Attributes
    ----------
    line : ndarray of uint8, shape (pending_steps + 1, m)
        Level indices of the commands issued, oldest first, the last one in force.
    wait : ndarray of uint32, shape (m,)
        Periods that each input must still keep its level.
    x : ndarray, shape (n,), or None
        The state that the latest command is based on; None before anything was measured.
    w : ndarray, shape (p + l,), or None
        The measured disturbances then, and the loads behind them.
    """

    line: np.ndarray[tuple[int, int], np.dtype[np.uint8]]
    wait: np.ndarray[tuple[int], np.dtype[np.uint32]]
    x: Array | None
    w: Array | None


def canonical_reference(reference: ArrayLike, outputs: int, order: int, evaluations: int = 1) -> Array:
    """A reference as (evaluations, q, order), missing derivatives zero; short forms hold at all evaluations.

    Raises
    ------
    ValueError
        If the shape is none of the short forms, or a value is not finite.
    """
    given = check.array("reference", reference)
    if given.ndim == 0:
        given = np.broadcast_to(given, (outputs,))[None, :, None]
    elif given.ndim == 1:
        given = given[None, None, :] if outputs == 1 else given[None, :, None]
    elif given.ndim == 2:
        given = given[None]
    short = np.ndim(reference) < 3
    fits = given.ndim == 3 and given.shape[:2] == (1 if short else evaluations, outputs)
    if not fits or not 1 <= given.shape[2] <= order:
        form = f"({evaluations}, {outputs}, {order}), that is evaluations, outputs and derivatives"
        problem = f"has shape {np.shape(reference)}"
        raise Mistake("reference", reference, f"give {form}, or a short form", problem=problem)
    result = np.zeros((evaluations, outputs, order))
    result[..., : given.shape[2]] = given
    return result
