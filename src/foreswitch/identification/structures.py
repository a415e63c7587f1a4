"""Model structures that identification chooses from: chains of integrators, lags and complex pairs, or any order n."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown
from foreswitch._helpers.text import nearest

__all__ = ["STRUCTURES", "Structure"]

#: What "auto" compares; theory [17] is the second.
STRUCTURES = (
    "integrator",
    "integrator+lag",
    "integrator+lag+lag",
    "integrator+pair",
    "lag",
    "lag+lag",
    "lag+lag+lag",
    "pair",
    "lag+pair",
    "order 2",
    "order 3",
)

MOST_STATES = 6
#: A pair stays a pair: overdamped it would be two lags, and the structures would overlap.
DAMPING = (1e-3, 1.0)
#: Largest growth rate of a free order, in units of the time scale: e^30 over a record.
UNSTABLE = 3.0


@dataclass(frozen=True)
class Structure:
    """What is known beforehand of a transfer function; the rest are its parameters.

    A chain has one gain per input and no zeros: ``k / s^i / prod (c s + 1) / prod (s^2/w^2 + 2 zeta s/w + 1)``.
    A free structure of order n has n poles of any kind and, per input, a numerator of degree n - 1. Internally the
    nonlinear parameters are free numbers ``theta``: logarithms for a chain, which keeps them positive, and for a
    free order the coefficients of second-order sections in units of the time scale.

    Attributes
    ----------
    integrators, lags, pairs : int
    order : int
        Of a free structure; 0 for a chain.
    """

    integrators: int = 0
    lags: int = 0
    pairs: int = 0
    order: int = 0

    @classmethod
    def parse(cls, text: str) -> Structure:
        """From ``"integrator+lag"``, ``"lag+pair"``, ``"order 3"`` and the like.

        Raises
        ------
        ValueError
            If a term is unknown or there are more than six states or two integrators.
        """
        free = re.fullmatch(r"order\s*([1-9])", str(text).strip())
        terms = [] if free else [term.strip() for term in str(text).split("+")]
        for term in terms:
            if term not in ("integrator", "lag", "pair"):
                problem = f"{shown(text)} has the term {shown(term)}"
                raise Mistake("structure", text, nearest(term, [*STRUCTURES, "auto"]), problem=problem)
        integrators, lags, pairs = (terms.count(kind) for kind in ("integrator", "lag", "pair"))
        result = cls(integrators, lags, pairs, int(free[1]) if free else 0)
        if result.states > MOST_STATES or result.integrators > 2:
            remedy = f"at most two integrators and {MOST_STATES} states"
            raise Mistake("structure", text, remedy, problem=f"{shown(text)} is too large")
        return result

    def __str__(self) -> str:
        if self.order:
            return f"order {self.order}"
        return "+".join(["integrator"] * self.integrators + ["lag"] * self.lags + ["pair"] * self.pairs)

    @cached_property
    def states(self) -> int:
        """Poles n."""
        return self.order or self.integrators + self.lags + 2 * self.pairs

    @cached_property
    def gain(self) -> str:
        """Name of the gain: slope per unit of input with an integrator, else final value."""
        return "k" if self.integrators else "K"

    @cached_property
    def names(self) -> list[str]:
        """Names of the nonlinear parameters: lags descending [s], then omega [rad/s] and damping of each pair."""
        if self.order:
            return [f"a{i}" for i in range(1, self.order + 1)]
        lag = "c" if self.integrators else "T"
        numbers = ["" if self.lags == 1 else str(i + 1) for i in range(self.lags)]
        pairs = ["" if self.pairs == 1 else str(i + 1) for i in range(self.pairs)]
        return [lag + i for i in numbers] + [name + i for i in pairs for name in ("omega", "zeta")]

    def bounds(self, shortest: float, longest: float, scale: float) -> tuple[Array, Array]:
        """Smallest and largest theta, given the shortest and longest time constant to consider [s]."""
        if self.order:
            fast = scale / shortest
            high = np.array([2.0 * fast, fast * fast] * (self.order // 2) + [fast] * (self.order % 2))
            return -np.minimum(high, UNSTABLE), high
        least = [shortest] * self.lags + [1.0 / longest, DAMPING[0]] * self.pairs
        most = [longest] * self.lags + [1.0 / shortest, DAMPING[1]] * self.pairs
        return np.log(least), np.log(most)

    def starts(self, time: float, scale: float) -> list[Array]:
        """A few theta whose slowest motion takes about ``time``; ``scale``: the time unit of a free order."""
        if self.order:
            rates = scale / time * 3.0 ** np.arange(self.order)
            result = [_sections(rates), _sections(np.r_[0.0, rates[1:]]), _sections(rates, damping=0.3)]
            if self.order % 2 and self.order > 1:  # the single pole slower than the pairs
                result.append(_sections(np.roll(rates, -1), damping=0.3))
            return result
        lags = [np.log(time) - i * np.log(3.0) for i in range(self.lags)]
        dampings = (0.2, 0.7) if self.pairs else (1.0,)
        pairs = [-np.log(time) + i * np.log(3.0) for i in range(self.pairs)]
        return [np.array(lags + [v for rate in pairs for v in (rate, np.log(z))]) for z in dampings]

    def system(self, theta: Array, scale: float) -> tuple[Array, Array]:
        """``A`` (n, n) and ``b`` (n,) for unit gain. A chain's output is its last state; of a free order all count."""
        n = self.states
        A, b = np.zeros((n, n)), np.zeros(n)
        at = 0
        for block in self._blocks(theta, scale):
            if isinstance(block, tuple):  # y'' + a1 y' + a0 y = r^2 v in the states y'/r, y
                a1, a0 = block
                r = 1.0 / scale if self.order else float(np.sqrt(a0))
                A[at, at : at + 2], A[at + 1, at] = (-a1, -a0 / r), r
                size = 2
            else:
                r = 1.0 / scale if self.order else block or 1.0
                A[at, at] = -block
                size = 1
            if at:
                A[at, at - 1] = r
            else:
                b[0] = r
            at += size
        return A, b

    def _blocks(self, theta: Array, scale: float) -> list[float | tuple[float, float]]:
        """Rates of first-order and (a1, a0) of second-order sections, fast ones first, integrators last."""
        if self.order:
            pairs = [(float(theta[i] / scale), float(theta[i + 1] / scale**2)) for i in range(0, self.order - 1, 2)]
            return [*pairs, *([float(theta[-1] / scale)] if self.order % 2 else [])]
        oscillating = np.exp(theta[self.lags :]).reshape(-1, 2)
        rates = sorted(np.exp(-theta[: self.lags]), reverse=True)
        return [*((2.0 * z * w, w * w) for w, z in oscillating), *rates, *[0.0] * self.integrators]

    def ordered(self, theta: Array) -> Array:
        """The same system with the lags descending and the pairs' frequencies ascending."""
        if self.order:
            return theta
        pairs = theta[self.lags :].reshape(-1, 2)
        return np.concatenate([-np.sort(-theta[: self.lags]), pairs[np.argsort(pairs[:, 0])].ravel()])

    def denominator(self, theta: Array, scale: float) -> Array:
        """Monic, descending powers, shape (n + 1,)."""
        result = np.ones(1)
        for block in self._blocks(theta, scale):
            result = np.convolve(result, [1.0, *np.atleast_1d(block)])
        return result

    def numerator(self, theta: Array, gains: Array, scale: float) -> Array:
        """Numerator of one input, whose gains are one number or, for a free order, one per state; descending, shape (n,)."""
        n, blocks = self.states, self._blocks(theta, scale)
        result = np.zeros(n)
        if not self.order:
            result[-1] = gains[0] * np.prod([np.atleast_1d(b)[-1] for b in blocks if b != 0.0])
            return result
        # state k of the chain is the product of what lies before it, over the denominator
        done, at = 1.0, 0
        for i, block in enumerate(blocks):
            size, rest = np.size(block), np.ones(1)
            for later in blocks[i + 1 :]:
                rest = np.convolve(rest, [1.0, *np.atleast_1d(later)])
            done /= scale
            if size == 2:
                derivative = np.convolve(rest, [done, 0.0])
                result[n - derivative.size :] += gains[at] * derivative
                done /= scale
            result[n - rest.size :] += gains[at + size - 1] * done * rest
            at += size
        return result

    def nonlinear(self, theta: Array, scale: float) -> Array:
        """What `names` names."""
        return self.denominator(theta, scale)[1:] if self.order else np.exp(theta)


def _sections(rates: Array, damping: float | None = None) -> Array:
    """Theta of a free order with poles at minus these rates, or two by two with this damping."""
    theta = np.array(rates, dtype=np.float64)
    for i in range(0, theta.size - 1, 2):
        a, b = rates[i : i + 2]
        theta[i : i + 2] = (a + b, a * b) if damping is None else (2.0 * damping * b, b * b)
    return theta
