"""What a study runs: parameters by dotted key, grid points and draws, the seed and the project of each run."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake, inside, shown
from foreswitch._helpers.units import INDEPENDENT, described
from foreswitch.project.project import Project
from foreswitch.project.tables import File, Table, unit_of
from foreswitch.simulation.loop import Loop, checked_seed
from foreswitch.studies.distributions import SHARED, Distribution, OneOf, Words, column, mixed, parsed, shares

__all__ = ["Plan", "Setup", "full", "key_unit", "label", "plain_key", "planned", "unit"]


class Meaning(NamedTuple):
    """What a key is about, its unit in the sentence; and the unit by itself, None where there is none."""

    sentence: str
    unit: str | None


#: Of the truth against the model, see `Plant.with_errors`.
ERRORS = {
    "delay_error": Meaning(described("the truth's dead time minus the model's", "s"), "s"),
    "gain_error": Meaning("the truth's input gain over the model's, minus one", None),
}
#: The key under which tables name files.
NAMED = "file"
#: Runs whose draws are looked at together, so that memory stays flat.
BLOCK = 65_536

Values = dict[str, Any]


def _keys(table: type[Table], prefix: str = "") -> Iterator[tuple[str, Meaning]]:
    """Every key below a table with what it means; entries of a list of tables count as one."""
    for name, field in table.model_fields.items():
        yield prefix + name, Meaning(field.description or "", unit_of(field))
        for below in _tables(field.annotation):
            yield from _keys(below, f"{prefix}{name}.")


def _tables(annotation: Any) -> Iterator[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        yield annotation
    for inner in get_args(annotation):
        yield from _tables(inner)


#: Dotted keys of a project file with their meanings, and the errors.
KEYS = {key: meaning for key, meaning in _keys(File) if "." in key and key != "simulation.seed"} | ERRORS


def full(key: str) -> str:
    """A key as in the file: ``hardware.`` is short for ``simulation.hardware.``."""
    return f"simulation.{key}" if key.startswith("hardware.") else key


def unit(key: str) -> str:
    """`key_unit` in brackets, with a blank before it."""
    found = key_unit(key)
    return f" [{found}]" if found else ""


def key_unit(key: str) -> str:
    """A key's unit; empty where it has none or depends on the plant's."""
    known = KEYS.get(plain_key(full(key)))
    return known.unit if known and known.unit in INDEPENDENT else ""


def plain_key(key: str) -> str:
    """Without the positions in lists."""
    return ".".join(part for part in key.split(".") if not part.isdigit())


def label(value: Any) -> str:
    """A value in a table or a sentence."""
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)


# Content --------------------------------------------------------------------------------------------------------------


def changed(content: Values, changes: Mapping[str, Any]) -> Values:
    """A file's tables with some keys set; a truth that is not there starts as the model."""
    result = copy.deepcopy(content)
    # the model before the truth, which may start as its copy
    for key in sorted(
        (key for key in changes if key not in ERRORS), key=lambda key: full(key).startswith("simulation")
    ):
        *path, last = full(key).split(".")
        node: Any = result
        for i, part in enumerate(path):
            if path[: i + 1] == ["simulation", "plant"] and part not in node:
                node[part] = copy.deepcopy(result["plant"])
            node = _entry(key, node, part, make=True)
        if isinstance(node, list):
            _entry(key, node, last)
            node[int(last)] = changes[key]
        elif isinstance(node, dict) and not last.isdigit():
            node[last] = changes[key]
        else:
            raise Mistake("over", changes[key], REMEDY, problem=NOWHERE, subject=repr(key), key=key)
    return result


NOWHERE, REMEDY = "leads nowhere in this project: entries of lists go by their number from 0", "correct the key"


def _entry(key: str, node: Any, part: str, make: bool = False) -> Any:
    if isinstance(node, dict) and not part.isdigit() and (make or part in node):
        return node.setdefault(part, {})
    if isinstance(node, list) and part.isdigit() and int(part) < len(node):
        return node[int(part)]
    raise Mistake("over", key, REMEDY, problem=NOWHERE, subject=repr(key), key=key)


def _files(content: Any) -> Iterator[Values]:
    """Tables that name a file."""
    if isinstance(content, dict) and isinstance(content.get(NAMED), str):
        yield content
    inside = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    for each in inside:
        yield from _files(each)


# Plan -----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """One run but for its seed: what `foreswitch.simulate` takes."""

    project: Project
    settings: Values

    @property
    def loop(self) -> Loop:
        """Checked and laid out."""
        keep = {name: value for name, value in self.settings.items() if name != "x0"}
        return Loop(self.project.controller, self.project.reference, **keep)


@dataclass(frozen=True)
class Plan:
    """A project, what is varied, how often and from which seed.

    Attributes
    ----------
    content : dict
        The project's tables.
    axes : dict of str to tuple
        Values by key; all combinations are points, the last key varying fastest.
    draws : dict of str to Distribution
        Drawn by key.
    repeats, seed : int
    files : dict of str to bytes
        Content of the files that the project names, once they travel with it.
    """

    content: Values
    axes: dict[str, tuple[Any, ...]]
    draws: dict[str, Distribution]
    repeats: int
    seed: int
    files: dict[str, bytes]

    @property
    def shape(self) -> tuple[int, ...]:
        """Values per axis."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def points(self) -> int:
        """Combinations of the axes' values."""
        return math.prod(self.shape)

    @property
    def rows(self) -> int:
        """Runs in all, the repeats of a point after each other."""
        return self.points * self.repeats

    def seeds(self, point: ArrayLike, repeat: ArrayLike) -> Words:
        """The seeds of runs."""
        return mixed(self.seed, point, repeat)

    def axis(self, key: str, point: ArrayLike) -> Any:
        """An axis' values at points."""
        index = np.unravel_index(np.asarray(point), self.shape)[list(self.axes).index(key)]
        return column(self.axes[key])[index]

    def drawn(self, key: str, point: ArrayLike, repeat: ArrayLike) -> Any:
        """A drawn parameter's values in runs."""
        draw = self.draws[key]
        return draw._at(shares(self.seed, full(key), point, SHARED if draw.per == "point" else repeat))

    def column(self, key: str, point: ArrayLike, repeat: ArrayLike = 0) -> np.ndarray[Any, Any]:
        """A parameter's values in runs, for a table: numbers as they are, lists and mixtures as text."""
        found = self.axis(key, point) if key in self.axes else self.drawn(key, point, repeat)
        values = np.asarray(found)
        values = np.broadcast_to(values, (np.size(point), *values.shape[1:]))
        return np.array([label(value) for value in values]) if values.dtype.kind in "OU" or values.ndim > 1 else values

    def varying(self) -> set[str]:
        """Keys that differ between the runs of a point."""
        return {key for key, draw in self.draws.items() if draw.per == "run"}

    def values(self, point: int, repeat: int) -> Values:
        """What is set in one run."""
        position = np.unravel_index(point, self.shape) if self.axes else ()
        found = {key: self.axes[key][int(i)] for key, i in zip(self.axes, position, strict=True)}
        for key in self.draws:
            drawn = self.drawn(key, point, repeat)[0]
            found[key] = drawn.item() if isinstance(drawn, np.generic) else drawn
        return found

    def named(self, point: int, repeat: int | None = None) -> str:
        """A point, or a run, in a sentence."""
        values = self.values(point, repeat or 0)
        shown = [key for key in values if repeat is not None or key in self.axes or self.draws[key].per == "point"]
        where = ", ".join(f"{key} = {label(values[key])}" for key in shown)
        number = f"point {point + 1} of {self.points}" + (f", run {repeat + 1}" if repeat is not None else "")
        return f"{number} ({where})" if where else number

    def setup(self, point: int, repeat: int, folder: Path, like: Project | None = None) -> Setup:
        """One run's project and settings.

        Parameters
        ----------
        point, repeat : int
        folder : path
            What the project's paths are relative to.
        like : Project, optional
            Of a run that differs from this one in [simulation] only.

        Raises
        ------
        ValueError
            If they do not fit, naming the run.
        """
        with inside(self.named(point, repeat if self.varying() else None)):
            values = self.values(point, repeat)
            content = changed(self.content, values)
            project = like.with_simulation(content["simulation"]) if like else Project(content, folder)
            settings = project.simulation_settings(**_truth(project, values))
            return Setup(project, {name: value for name, value in settings.items() if name != "seed"})

    def check(self, folder: Path, progress: Callable[[int], None] = lambda _: None) -> Project:
        """Build the loop of every point, of all its draws those with a smallest or largest value; the first project."""
        first: Setup | None = None
        for point in range(self.points):
            like = None
            for repeat in self._extremes(point):
                setup = self.setup(point, repeat, folder, like)
                like = setup.project if self.varying() and all(map(simulated, self.varying())) else None
                with inside(self.named(point, repeat if self.varying() else None)):
                    loop = setup.loop
                    loop.start(setup.settings.get("x0"))
                first = first or setup
            progress(point + 1)
        assert first is not None
        return first.project

    def _extremes(self, point: int) -> list[int]:
        """Runs of a point in which a drawn number is smallest or largest."""
        found = {0}
        for key in self.varying():
            draw = self.draws[key]
            ends: dict[int, tuple[float, int]] = {}  # by what it stands for: a share and its run
            for start in range(0, self.repeats, BLOCK):
                share = shares(self.seed, full(key), point, np.arange(start, min(start + BLOCK, self.repeats)))
                if isinstance(draw, OneOf):
                    for kind, at in zip(*np.unique(draw._index(share), return_index=True), strict=True):
                        ends.setdefault(int(kind), (0.0, start + int(at)))
                    continue
                for sign in (-1, 1):  # every other distribution rises with the share
                    at = int((sign * share).argmax())
                    ends[sign] = max(ends.get(sign, (-np.inf, 0)), (sign * float(share[at]), start + at))
            found |= {run for _, run in ends.values()}
        return sorted(found)

    def carried(self, folder: Path) -> Plan:
        """The same with the files that it names inside, under names that depend on their content only."""
        files: dict[str, bytes] = {}

        def taken(name: str) -> str:
            data = (folder / name).read_bytes()
            short = f"{sha256(data).hexdigest()[:16]}.csv"
            files[short] = data
            return short

        content = copy.deepcopy(self.content)
        for table in _files(content):
            table[NAMED] = taken(table[NAMED])
        axes = {key: tuple(map(taken, v)) if key.endswith(f".{NAMED}") else v for key, v in self.axes.items()}
        draws: dict[str, Distribution] = dict(self.draws)
        for key, draw in self.draws.items():
            if key.endswith(f".{NAMED}"):
                draws[key] = replace(draw, values=tuple(map(taken, draw.values)))  # type: ignore[attr-defined,call-arg]
        return replace(self, content=content, axes=axes, draws=draws, files=files)

    @cached_property
    def description(self) -> Values:
        """What determines the results, but for the version of this package."""
        return {
            "project": self.content,
            "over": [[key, list(values)] for key, values in self.axes.items()]
            + [[key, repr(draw)] for key, draw in self.draws.items()],
            "repeats": self.repeats,
            "seed": self.seed,
            "files": sorted(self.files),
        }


def simulated(key: str) -> bool:
    """Whether a key leaves model, controller and reference alone."""
    return key in ERRORS or full(key).startswith("simulation.")


def _distinct(values: Sequence[Any]) -> list[Any]:
    found: list[Any] = []
    for value in values:
        if value not in found:
            found.append(value)
    return found


def _truth(project: Project, values: Values) -> Values:
    """The model with its errors, if any are given."""
    if not set(values) & set(ERRORS):
        return {}
    if project.file.simulation.plant is not None:
        key = next(key for key in ERRORS if key in values)
        problem = "is the truth's from the model, but [simulation.plant] gives a truth of its own"
        raise Mistake(key, values[key], "remove one of them", problem=problem)
    m = project.plant.inputs
    gain, delay = (check.per(key, values.get(key, 0.0), m, "input") for key in ("gain_error", "delay_error"))
    try:
        return {"plant": project.plant.with_errors(delay, gain)}
    except Mistake as mistake:
        mistake.argument = mistake.subject = "delay_error"
        raise


# From what is asked ---------------------------------------------------------------------------------------------------


def planned(project: Project, over: Mapping[str, Any], repeats: int, seed: int) -> Plan:
    """A plan for a project, its keys and numbers checked.

    Raises
    ------
    ValueError
        If a key is unknown or stands twice, or a value cannot be understood.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    draws: dict[str, Distribution] = {}
    if isinstance(repeats, bool) or not isinstance(repeats, (int, np.integer)) or repeats < 1:
        raise Mistake("repeats", repeats, "give a whole number of at least 1")
    if seed is None:
        raise Mistake("seed", seed, "give a whole number, the same for the same study")
    if not isinstance(over, Mapping):
        raise Mistake("over", over, "give a dict from keys to lists or distributions")
    for key, given in over.items():
        _known(key, over)
        with inside(key):
            meant = parsed(given) if isinstance(given, str) else given
        if isinstance(meant, Distribution):
            draws[key] = meant
        elif np.iterable(meant) and not isinstance(meant, (str, bytes, Mapping)):
            values = tuple(_bare(each) for each in meant)
            if not values:
                raise Mistake("over", given, "give at least one", problem="has no values", subject=key, key=key)
            if len(_distinct(values)) < len(values):
                problem = f"lists {label(_twice(values))} twice"
                raise Mistake("over", given, "give each value once", problem=problem, subject=key, key=key)
            axes[key] = values
        else:
            remedy = "give a list of values, or a distribution such as Uniform(0, 1)"
            raise Mistake("over", given, remedy, subject=key, key=key)
    content = project.file.model_dump(exclude_unset=True)
    return Plan(content, axes, draws, int(repeats), checked_seed(seed), {})


def _known(key: str, over: Mapping[str, Any]) -> None:
    if not isinstance(key, str) or plain_key(full(key)) not in KEYS:
        if plain_key(full(str(key))) == "simulation.seed":
            problem = "cannot be varied, every run has a seed of its own"
            raise Mistake("over", key, "give seed and repeats", problem=problem, subject="simulation.seed")
        problem = f"has the unknown key {shown(key)}"
        raise Mistake("over", key, f"did you mean {_closest(str(key))!r}?", problem=problem)
    for other in over:
        if other != key and f"{full(key)}.".startswith(f"{full(str(other))}."):
            problem = f"has both {other!r} and {key!r}, which set the same value"
            raise Mistake("over", key, "remove one", problem=problem)


def _closest(key: str) -> str:
    """The nearest known key: by its letters, else one that ends alike, else the least far."""
    last = key.split(".")[-1]
    alike = [known for known in KEYS if known.split(".")[-1] == last]
    return (get_close_matches(key, KEYS, 1) or alike or get_close_matches(key, KEYS, 1, 0.0))[0]


def _bare(value: Any) -> Any:
    """Without NumPy's types."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (tuple, list)):
        return [_bare(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def _twice(values: Sequence[Any]) -> Any:
    return next(value for i, value in enumerate(values) if value in values[:i])
