"""Random parameters of a study: distributions, and numbers that depend on nothing but their place in it."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, inside, shown
from foreswitch._helpers.text import nearest

__all__ = ["Distribution", "LogUniform", "Normal", "OneOf", "Uniform", "parsed"]

Words = np.ndarray[Any, np.dtype[np.uint64]]

#: Of a number that all runs of a point share; no run has this index.
SHARED = 2**64 - 1
_GAMMA = 0x9E3779B97F4A7C15


def mixed(*parts: ArrayLike | int) -> Words:
    """A 64-bit word for whole numbers, broadcast together: one round of SplitMix64 (Steele, Lea and Flood 2014) each.

    Two calls that differ in one part only never give the same word, because each round is one to one.
    """
    h = np.zeros(1, dtype=np.uint64)
    for part in parts:
        word = np.atleast_1d(np.asarray(part, dtype=np.uint64))
        h = (h ^ word) + np.uint64(_GAMMA)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h = h ^ (h >> np.uint64(31))
    return h


def shares(seed: int, key: str, point: ArrayLike, repeat: ArrayLike) -> Array:
    """Numbers in (0, 1), on 53 bits, of one key; other keys beside it change nothing."""
    stream = int.from_bytes(blake2b(key.encode(), digest_size=8).digest(), "little")
    words = mixed(seed, point, repeat, stream) >> np.uint64(11)
    return (words.astype(np.float64) + 0.5) * 2.0**-53


@dataclass(frozen=True)
class Distribution:
    """A parameter drawn at random."""

    _: KW_ONLY
    per: str = "run"

    def _check_per(self) -> None:
        if self.per not in ("run", "point"):
            raise Mistake("per", self.per, "give 'run' or 'point'")

    def _at(self, share: Array) -> Any:
        """Values below which these shares of all draws lie."""
        raise NotImplementedError

    def __str__(self) -> str:
        given = [_text(getattr(self, each.name)) for each in fields(self) if each.name != "per"]
        return f"{type(self).__name__.lower()}({', '.join([*given, *(['per=point'] if self.per == 'point' else [])])})"


def _text(value: Any) -> str:
    return ", ".join(map(_text, value)) if isinstance(value, tuple) else f"{value:g}" if _number(value) else str(value)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@dataclass(frozen=True)
class Uniform(Distribution):
    """Any value between two ends, all alike.

    Parameters
    ----------
    low, high : float
    per : str
        ``"run"``: each run draws anew; ``"point"``: all runs of a grid point share one value.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        self._check_per()
        if check.number("high", self.high) <= check.number("low", self.low):
            problem = f"is {self.low:g} and high {self.high:g}"
            raise Mistake("high", self.high, "high must be greater", problem=problem, subject="low")

    def _at(self, share: Array) -> Array:
        return self.low + (self.high - self.low) * share


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Any positive value between two ends, all orders of magnitude alike.

    Parameters
    ----------
    low, high : float
        Above zero.
    per : str
        As in `Uniform`.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        self._check_per()
        if check.number("high", self.high) <= check.number("low", self.low, above=0.0):
            problem = f"is {self.low:g} and high {self.high:g}"
            raise Mistake("high", self.high, "high must be greater", problem=problem, subject="low")

    def _at(self, share: Array) -> Array:
        return np.asarray(self.low * (self.high / self.low) ** share)


@dataclass(frozen=True)
class Normal(Distribution):
    """A bell curve, cut off where its ends are given.

    Parameters
    ----------
    mean, deviation : float
    low, high : float
        Ends; nothing is drawn beyond.
    per : str
        As in `Uniform`.
    """

    mean: float
    deviation: float
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        self._check_per()
        check.number("mean", self.mean)
        check.number("deviation", self.deviation, above=0.0)
        if not self.low < self.high:
            problem = f"is {self.low:g} and high {self.high:g}"
            raise Mistake("high", self.high, "high must be greater", problem=problem, subject="low")

    def _at(self, share: Array) -> Array:
        first, last = (ndtr((end - self.mean) / self.deviation) for end in (self.low, self.high))
        drawn = self.mean + self.deviation * ndtri(first + (last - first) * share)
        return np.asarray(np.clip(drawn, self.low, self.high))


@dataclass(frozen=True)
class OneOf(Distribution):
    """One of a few values, all alike.

    Parameters
    ----------
    values : sequence
    per : str
        As in `Uniform`.
    """

    values: Sequence[Any]

    def __post_init__(self) -> None:
        self._check_per()
        if isinstance(self.values, str) or len(self.values) == 0:
            raise Mistake("values", self.values, "give a list of at least one")
        object.__setattr__(self, "values", tuple(self.values))

    def _index(self, share: Array) -> np.ndarray[Any, np.dtype[np.intp]]:
        return np.minimum((share * len(self.values)).astype(np.intp), len(self.values) - 1)

    def _at(self, share: Array) -> Any:
        return column(self.values)[self._index(share)]


def column(values: Sequence[Any]) -> np.ndarray[Any, Any]:
    """Values of a kind as an array: truths, whole numbers, numbers, else objects."""
    for kind in (bool, int, (int, float)):
        if all(isinstance(value, kind) and (kind is bool or not isinstance(value, bool)) for value in values):
            return np.array(values)
    objects = np.empty(len(values), dtype=object)
    objects[:] = values
    return objects


# Text -----------------------------------------------------------------------------------------------------------------

CALLS: dict[str, Any] = {
    "uniform": Uniform,
    "loguniform": LogUniform,
    "normal": Normal,
    "oneof": lambda *values, per="run": OneOf(values, per=per),
    "linspace": lambda low, high, count: np.linspace(low, high, count).tolist(),
    "geomspace": lambda low, high, count: np.geomspace(low, high, count).tolist(),
}


def parsed(text: str) -> Distribution | list[Any]:
    """What a text such as ``uniform(0, 4)``, ``linspace(0, 1, 5)`` or ``1, 2, 3`` means.

    Values are TOML; bare words are texts.

    Raises
    ------
    ValueError
        If it cannot be read.
    """
    head, bracket, rest = text.strip().partition("(")
    if not bracket or not rest.endswith(")") or not head.strip().isidentifier():
        return [_value(part) for part in _parts(text)]
    name = head.strip().lower()
    if name not in CALLS:
        raise Mistake("over", text, nearest(name, CALLS), problem=f"calls {name!r}", subject=shown(text))
    parts = _parts(rest[:-1])
    named = dict(part.split("=", 1) for part in parts if part.replace(" ", "").startswith("per="))
    plain = [_value(part) for part in parts if "=" not in part]
    options = {key.strip(): _value(each) for key, each in named.items()}
    try:
        with inside(shown(text)):
            made: Distribution | list[Any] = CALLS[name](*plain, **options)
    except TypeError:
        problem = f"has arguments that {name} does not take"
        raise Mistake("over", text, f"give {USAGE[name]}", problem=problem, subject=shown(text)) from None
    return made


USAGE = {
    "uniform": "uniform(low, high)",
    "loguniform": "loguniform(low, high)",
    "normal": "normal(mean, deviation) or normal(mean, deviation, low, high)",
    "oneof": "oneof(a, b, ...)",
    "linspace": "linspace(first, last, count)",
    "geomspace": "geomspace(first, last, count)",
}


def _parts(text: str) -> list[str]:
    """Split at commas outside brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "[{(":
            depth += 1
        elif c in ")}]":
            depth -= 1
        if c == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += c
    if not all(part.strip() for part in parts):
        remedy = "give values with commas between them"
        raise Mistake("over", text, remedy, problem="has an empty entry", subject=shown(text))
    return [part.strip() for part in parts]


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        if set(text) & set("[]{}\"'=#"):
            remedy = "give a number, a list in brackets or a word"
            raise Mistake("over", text, remedy, problem="is not a value", subject=shown(text)) from None
    try:
        return float(text)  # .5 and 1. are numbers to most people, if not to TOML
    except ValueError:
        return text
