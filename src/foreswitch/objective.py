"""What a controller minimises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from numpy.typing import ArrayLike

from foreswitch import _check
from foreswitch._text import nearest

__all__ = ["Endpoint"]

TAILS = ("rest", "zero")


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
        _check.number("Td", self.Td, above=0.0)
        if (_check.array("lam", self.lam) <= 0).any():
            raise ValueError(f"lam is {self.lam!r}; it must be greater than 0")
        weight = _check.array("weight", self.weight)
        if (weight < 0).any() or not weight.any():
            raise ValueError(f"weight is {self.weight!r}; give numbers >= 0, at least one of them > 0")
        if self.tail not in TAILS:
            raise ValueError(f"tail is {self.tail!r}; {nearest(str(self.tail), TAILS)}")
