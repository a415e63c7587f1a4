"""What a controller minimises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import nearest

__all__ = ["Endpoint", "Horizon"]

TAILS = ("rest", "zero")
#: Periods that the core can look ahead.
LONGEST = 64


@dataclass(frozen=True)
class Endpoint:
    """Land closest at one instant: the law of Shields, Barth and Goldfarb (2006).

    The cost of a command is ``V = 1/2 sum_o weight_o s_o^2`` with the sliding variable
    ``s = (1 + (1/lam) d/dt)^(r-1) (y - yd)`` predicted to ``t_k + max input delay + Td``, plus the
    switch costs. With ``Td = Ts`` it is the one-step law of Sprock and Hsu (1997).

    Parameters
    ----------
    Td : float
        Settling horizon after the dead time [s], at least one switching period.
    lam : float or array_like, shape (q,)
        Bandwidth of the sliding variable [rad/s]. Without effect where r = 1.
    tail : {"rest", "zero"}
        Input assumed after the candidate: the one that holds the reference, or none (the paper to
        the letter, which biases every plant that does not integrate).
    weight : float or array_like, shape (q,)
        Weight of each output.
    relative_degree : int or array_like, shape (q,), optional
        r of each output, if the numerical rank is not to be trusted.

    Raises
    ------
    ValueError
        If a number is out of range or the tail unknown.
    """

    Td: float
    lam: ArrayLike
    tail: Literal["rest", "zero"] = "rest"
    weight: ArrayLike = 1.0
    relative_degree: ArrayLike | None = None

    def __post_init__(self) -> None:
        check.number("Td", self.Td, above=0.0)
        if (check.array("lam", self.lam) <= 0).any():
            raise Mistake("lam", self.lam, "it must be greater than 0")
        _check_weight(self.weight)
        if self.tail not in TAILS:
            raise Mistake("tail", self.tail, nearest(str(self.tail), TAILS))


@dataclass(frozen=True)
class Horizon:
    """Follow best over many periods, the whole command sequence found exactly.

    ``J = sum_i sum_o weight_o s_{o,i}^2 + sum_i sum_j move_weight_j (u_{j,i} - u_{j,i-1})^2 + switch costs + terminal``
    with s_i at ``t_k + max input delay + i Ts``: ``y - yd``, or the sliding variable where ``lam`` is given. One class
    for the laws of theory [7]: bang-bang generalised predictive control (Tsang and Clarke 1988) is
    ``Horizon(N, tail="hold")``, the one-step law ``Horizon(1)``.

    Parameters
    ----------
    steps : int
        Periods that the horizon reaches beyond the dead time.
    weight : float or array_like, shape (q,)
        Weight of each output.
    lam : float or array_like, shape (q,), optional
        Bandwidth of the sliding variable [rad/s]; default: ``s = y - yd``.
    move_weight : float or array_like, shape (m,)
        Weight of each input's moves.
    window : (int, int), optional
        First and last period evaluated; default ``(1, steps)``.
    moves : int, optional
        Periods in which the commands are free; default all. After them comes the tail.
    tail : {"hold", "rest", "zero"}
        The inputs after the moves: the last move, the ones that hold the last reference, or none.
    terminal : "riccati" or array_like, shape (n, n), optional
        Cost of ending away from rest, ``(x - x_rest)' P (x - x_rest)``: of the unconstrained law from there on, with
        ``move_weight`` (or a millionth of what the input does, if that is more) on the input's distance from rest, or a
        matrix of one's own. Default: none.
    node_budget : int, optional
        Partial sequences after which the best one so far is commanded; `Decision.gap` then bounds what is missing.
        Default: none.
    relative_degree : int or array_like, shape (q,), optional
        r of each output, with ``lam``, if the numerical rank is not to be trusted.

    Raises
    ------
    ValueError
        If a number is out of range or the tail unknown.
    """

    steps: int
    weight: ArrayLike = 1.0
    lam: ArrayLike | None = None
    move_weight: ArrayLike = 0.0
    window: tuple[int, int] | None = None
    moves: int | None = None
    tail: Literal["hold", "rest", "zero"] = "hold"
    terminal: ArrayLike | Literal["riccati"] | None = None
    node_budget: int | None = None
    relative_degree: ArrayLike | None = None

    def __post_init__(self) -> None:
        def keep(name: str, value: int | tuple[int, int]) -> None:
            object.__setattr__(self, name, value)  # 5.0 as 5: frozen

        keep("steps", _whole("steps", self.steps, 1, LONGEST))
        if self.moves is not None:
            keep("moves", _whole("moves", self.moves, 1, self.steps))
        if self.node_budget is not None:
            keep("node_budget", _whole("node_budget", self.node_budget, 1, 2**32 - 1))
        if self.window is not None:
            if (
                not isinstance(self.window, (Sequence, np.ndarray))
                or isinstance(self.window, str)
                or len(self.window) != 2
            ):
                raise Mistake("window", self.window, "give the first and the last period")
            first = _whole("window", self.window[0], 1, self.steps)
            keep("window", (first, _whole("window", self.window[1], first, self.steps)))
        if self.lam is not None and (check.array("lam", self.lam) <= 0).any():
            raise Mistake("lam", self.lam, "it must be greater than 0")
        _check_weight(self.weight)
        if (check.array("move_weight", self.move_weight) < 0).any():
            raise Mistake("move_weight", self.move_weight, "it must be at least 0")
        if self.tail not in (*TAILS, "hold"):
            raise Mistake("tail", self.tail, nearest(str(self.tail), (*TAILS, "hold")))
        if isinstance(self.terminal, str) and self.terminal != "riccati":
            raise Mistake("terminal", self.terminal, "give 'riccati' or a matrix")


def _check_weight(value: ArrayLike) -> None:
    weight = check.array("weight", value)
    if (weight < 0).any() or not weight.any():
        raise Mistake("weight", value, "give numbers >= 0, at least one of them > 0")


def _whole(name: str, value: float, least: int, most: int) -> int:
    if isinstance(value, (bool, np.bool_)) or not least <= check.number(name, value) <= most or value != int(value):
        raise Mistake(name, value, f"give a whole number from {least} to {most}")
    return int(value)
