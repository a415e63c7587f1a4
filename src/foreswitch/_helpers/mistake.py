"""A mistake of the user's as data: the argument it is in, its value, and the remedy.

Whatever a caller gets wrong is raised as a `Mistake` where it is seen. It is a ``ValueError`` whose text is one sentence,
"Ts is 0; it must be greater than 0", built from its fields: ``argument`` "Ts", ``value`` 0, ``remedy`` "it must be greater
than 0", and, where the argument was read from a project file, ``key`` "actuator.Ts". Programs read the fields; the text is
for people. Each layer that a mistake passes may add what only it knows, with `within` and `inside`.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

__all__ = ["Mistake", "beyond", "inside", "shortened", "shown", "within"]

#: Characters of a value in a sentence; of a longer one its two ends.
LONGEST_VALUE = 80
#: Characters of what another library says.
LONGEST_REASON = 200


class Mistake(ValueError):
    """One argument that does not fit, in one sentence.

    Parameters
    ----------
    argument : str
        Its name, as the caller knows it; empty where it cannot be told.
    value : object
        What it holds.
    remedy : str
        What to do.
    problem : str, optional
        What is wrong, in the words that follow the subject. Default: "is" and the value.
    subject : str, optional
        What the sentence begins with where that is not the argument's name; empty where it is the last of ``places``.
    key : str, optional
        Where the argument stands in a project file or a request, as in "actuator.Ts" or "reference.1.frequency".

    Attributes
    ----------
    places : tuple of str
        What the sentence is preceded by, outermost first: files, points of a study.
    """

    def __init__(
        self,
        argument: str,
        value: Any,
        remedy: str,
        *,
        problem: str | None = None,
        subject: str | None = None,
        key: str | None = None,
    ) -> None:
        super().__init__(argument, value, remedy)
        self.argument, self.value, self.remedy = argument, value, remedy
        self.problem = f"is {shown(value)}" if problem is None else problem
        self.subject = argument if subject is None else subject
        self.key = key
        self.places: tuple[str, ...] = ()

    def __str__(self) -> str:
        clause = f"{self.subject} {self.problem}" if self.subject else self.problem
        before = ": ".join(self.places) + (": " if self.subject else " ") if self.places else ""
        return f"{before}{clause}; {self.remedy}"

    def __reduce__(self) -> tuple[Any, ...]:
        fields = dict(self.__dict__)
        try:
            pickle.dumps(self.value)
        except Exception:  # whatever a stranger's object raises: the mistake reaches the other process without it
            fields["value"] = shown(self.value)
        return type(self), (self.argument, fields["value"], self.remedy), fields


@contextmanager
def within(place: str | None, keys: Mapping[str, str]) -> Iterator[None]:
    """Arguments of the block are read from keys: a mistake in one bears its key.

    Parameters
    ----------
    place : str, optional
        Key of a mistake in any other argument: the table.
    keys : mapping of str to str
        Argument -> key.
    """
    try:
        yield
    except Mistake as mistake:
        if mistake.key is None:  # else a table within this one has named it
            mistake.key = keys.get(mistake.argument, place)
        raise


@contextmanager
def inside(place: object) -> Iterator[None]:
    """A mistake of the block is told with the place it is in, "record.csv: t holds ...".

    Parameters
    ----------
    place : object
        A path, or some words.
    """
    try:
        yield
    except Mistake as mistake:
        mistake.places = (str(place), *mistake.places)
        raise
    except ValueError as error:
        found = beyond(error)
        found.places = (str(place),)
        raise found from error


def beyond(error: Exception) -> Mistake:
    """What NumPy and SciPy raise: of numbers that nothing can be computed with, whose argument they do not know.

    Parameters
    ----------
    error : Exception

    Returns
    -------
    Mistake
    """
    problem = f"are too extreme to compute with ({shortened(str(error), LONGEST_REASON)})"
    return Mistake("", None, "choose others", problem=problem, subject="the numbers")


def shown(value: object) -> str:
    """A value in a sentence, as it would be typed: an array as a list, what is long shortened.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
    """
    if isinstance(value, np.ndarray) and value.size > LONGEST_VALUE:
        return f"an array of shape {value.shape}"
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    try:
        text = repr(value)
    except Exception:  # integers of thousands of digits, and a stranger's __repr__
        text = f"a value of type {type(value).__name__} that cannot be written out"
    return shortened(text, LONGEST_VALUE)


def shortened(text: str, most: int) -> str:
    """In one line; of a long text its two ends, so that a remedy at the end stays.

    Parameters
    ----------
    text : str
    most : int
        Characters.

    Returns
    -------
    str
    """
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"
