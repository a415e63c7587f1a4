"""Project files: one TOML file holds plant, actuator, controller, reference and simulation."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.mistake import Mistake, inside, within
from foreswitch._helpers.text import nearest
from foreswitch.certificate.certificate import Certificate, certify
from foreswitch.control.controller import Controller
from foreswitch.control.kalman import Kalman
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.reference import Reference, Stack, sample
from foreswitch.project.mistakes import validated
from foreswitch.project.tables import CONTROLLER_KEYS, SIMULATION_KEYS, ControllerTable, ReferenceTable, Valve
from foreswitch.simulation.baselines import Baseline, Tuned, tune
from foreswitch.simulation.loop import Law, measured_state, simulate
from foreswitch.simulation.run import Run

__all__ = ["Project"]

#: Of a noise given by its standard deviation, a certificate bears so many: one sample in 16 000 lies beyond.
SIGMAS = 4.0


class Project:
    """Everything a project file says, ready to run.

    Parameters
    ----------
    content : dict
        The file's tables.
    folder : path or None
        What its paths are relative to; None: it may not name any.

    Raises
    ------
    ValueError
        If a key is unknown, missing or of the wrong type, or a value does not fit.
    """

    def __init__(self, content: dict[str, Any], folder: str | Path | None = ".") -> None:
        self.file, self.folder = validated(content), Path(folder or ".")
        self._readable = None if folder is None else self.folder
        self.plant = self.file.plant.build()
        self.controller = self.build_controller()
        tables = self.file.reference
        if isinstance(tables, list):
            parts = [table.build(self._readable, f"reference.{i}") for i, table in enumerate(tables)]
        else:
            parts = [tables.build(self._readable)]
        if len(parts) != self.plant.outputs:
            problem, remedy = f"stands {len(parts)} time(s)", f"the plant has {self.plant.outputs} output(s)"
            raise Mistake("reference", parts, remedy, problem=problem, subject="[reference]", key="reference")
        self.reference: Reference = parts[0] if len(parts) == 1 else Stack(*parts)
        self._simulated()

    def _simulated(self) -> None:
        """What [simulation] says."""
        table = self.file.simulation
        self.truth = table.plant.build("simulation.plant") if table.plant else self.plant
        self.hardware = table.hardware.build() if table.hardware else None
        self.seed = table.seed
        self._courses = self._disturbances(self._readable)

    def with_simulation(self, table: dict[str, Any]) -> Project:
        """The same project with another [simulation]; controller and reference are not built anew.

        Parameters
        ----------
        table : dict
            The whole table.

        Returns
        -------
        Project
        """
        twin = copy.copy(self)
        twin.file = validated(self.file.model_dump(exclude_unset=True) | {"simulation": table})
        twin._simulated()
        return twin

    def _disturbances(self, folder: Path | None) -> Stack | None:
        """The disturbances that run a course of their own."""
        place, tables, wanted = "simulation.disturbance", self.file.simulation.disturbance, self.truth.disturbances
        courses = [
            table.build(folder, f"{place}.{i}")
            for i, table in enumerate(tables if isinstance(tables, list) else [])
            if isinstance(table, ReferenceTable)
        ]
        if courses and len(courses) != wanted:
            problem, remedy = f"stands {len(courses)} time(s)", f"the plant has {wanted} disturbance(s)"
            raise Mistake("disturbance", courses, remedy, problem=problem, subject=f"[{place}]", key=place)
        return Stack(*courses) if courses else None

    @classmethod
    def read(cls, path: str | Path) -> Project:
        """From a TOML file.

        Parameters
        ----------
        path : path

        Returns
        -------
        Project

        Raises
        ------
        ValueError
            As `Project`, or if the file cannot be read.
        """
        try:
            content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            problem = f"cannot be read ({error.strerror if isinstance(error, OSError) else 'it is not UTF-8'})"
            remedy = "give a project file, see 'foreswitch init'"
            raise Mistake("path", path, remedy, problem=problem, subject=str(path)) from None
        except tomllib.TOMLDecodeError as error:
            problem = f"is not valid TOML ({error})"
            raise Mistake("path", path, "correct that line", problem=problem, subject=str(path)) from None
        with inside(path):
            return cls(content, Path(path).parent)

    def build_controller(self, **changes: Any) -> Controller:
        """The controller, with some settings changed.

        Parameters
        ----------
        **changes
            ``plant``, ``estimator``, ``objective`` (an `Endpoint` or `Horizon`), any key of [actuator] or [controller].

        Returns
        -------
        Controller
        """
        actuator, controller, estimator = self.file.actuator, self.file.controller, self.file.estimator
        settings = actuator.model_dump() | controller.given(*controller.ALWAYS)
        settings |= {"plant": self.plant, "estimator": None}
        known = settings.keys() | ControllerTable.model_fields.keys()
        unknown = sorted(changes.keys() - known)
        if unknown:
            name, problem = unknown[0], "is not a setting of a controller"
            raise Mistake(name, changes[name], nearest(name, known), problem=problem, subject=repr(name))
        objective = changes.get("objective")
        of_objective = {name: value for name, value in changes.items() if name not in settings and name != "objective"}
        if objective is not None and not isinstance(objective, (Endpoint, Horizon)):
            raise Mistake("objective", objective, "give an Endpoint or a Horizon")
        if objective is not None and of_objective:
            name, problem = min(of_objective), "is given beside an objective"
            raise Mistake(name, changes[name], "put it into that", problem=problem, subject=repr(name))
        own = {name: value for name, value in changes.items() if name in settings}
        instead = changes.keys() | (controller.model_fields_set - set(controller.ALWAYS) if objective else set())
        with within(None, _of_the_file(CONTROLLER_KEYS, instead)):
            settings["estimator"] = Kalman(**estimator.model_dump()) if estimator else None
            settings["objective"] = objective or controller.model_copy(update=of_objective).build()
            return Controller(**(settings | own))

    def build_baseline(self, kind: type[Baseline], **parameters: Any) -> Baseline:
        """A baseline for this project's actuator.

        Parameters
        ----------
        kind : type
            `Relay`, `PIPWM` or `SmithPWM`.
        **parameters
            Its own.

        Returns
        -------
        Baseline
        """
        shared = self._shared()
        with within(None, _of_the_file(CONTROLLER_KEYS, parameters)):
            return kind(self.plant, self.file.actuator.levels, self.controller.Ts, **parameters, **shared)

    def tune(self, kind: type[Baseline], *, budget: int = 300, seed: int = 0) -> Tuned:
        """The best baseline of a kind on this project's task, see `foreswitch.baselines.tune`.

        Parameters
        ----------
        kind : type
            As in `build_baseline`.
        budget, seed : int
            Of the search.

        Returns
        -------
        Tuned
        """
        settings = self.simulation_settings()
        duration, truth, shared = settings.pop("duration"), settings.pop("plant"), self._shared()
        with within(None, CONTROLLER_KEYS | self.simulation_keys):
            return tune(
                kind, self.plant, self.file.actuator.levels, self.controller.Ts, self.reference, duration, budget=budget,
                search_seed=seed, preview=float(np.max(self.controller.reference_times)), shared=shared, truth=truth,
                **settings,
            )  # fmt: skip

    def _shared(self) -> dict[str, Any]:
        """What every law of this project has to respect."""
        if self.file.estimator:
            problem, remedy = "is there, but baselines measure the whole state", "remove it to compare with them"
            raise Mistake(
                "estimator", self.file.estimator, remedy, problem=problem, subject="[estimator]", key="estimator"
            )
        return self.file.actuator.given("min_on", "min_off", "safe_level", "forbidden")

    def with_seed(self, seed: int) -> Project:
        """The same project; where the file names no seed, with this one.

        Parameters
        ----------
        seed : int

        Returns
        -------
        Project
        """
        twin = copy.copy(self)
        twin.seed = seed if self.seed is None else self.seed
        return twin

    def simulate(
        self, controller: Law | None = None, reference: Callable[..., ArrayLike] | None = None, **changes: Any
    ) -> Run:
        """One closed-loop run.

        Parameters
        ----------
        controller : Controller or a baseline, optional
            Default: the project's.
        reference : callable, optional
            Default: the project's.
        **changes
            Arguments of `foreswitch.simulate` that replace those of [simulation].

        Returns
        -------
        Run
        """
        law, reference = controller or self.controller, reference or self.reference
        with within(None, _of_the_file(self.simulation_keys, changes)):
            settings = self.simulation_settings(reference, law.Ts, **changes)
            return simulate(law, reference, settings.pop("duration"), **settings)

    @property
    def simulation_keys(self) -> dict[str, str]:
        """Argument of `foreswitch.simulate`, or of its hardware, and the key that it is read from."""
        return SIMULATION_KEYS | {"plant": "simulation.plant" if self.file.simulation.plant else "plant"}

    def certify(self, reference: Callable[..., ArrayLike] | None = None, **changes: Any) -> Certificate:
        """What is proven of the project's controller on its reference, from its initial state.

        Parameters
        ----------
        reference : callable, optional
            Default: the project's.
        **changes
            Arguments of `foreswitch.certify` that replace those of the project. Its noise, a standard deviation, is borne
            up to `SIGMAS` times.

        Returns
        -------
        Certificate

        Raises
        ------
        ValueError
            As `foreswitch.certify`, or if a disturbance follows the output.
        """
        table, reference = self.file.simulation, reference or self.reference
        settings: dict[str, Any] = {"reference": reference, "duration": table.duration, "x0": table.x0}
        if table.x0 is not None and (sensor := measured_state(self.plant, self.truth)) is not None:
            settings["x0"] = sensor @ np.array(table.x0)
        settings |= changes
        if "noise" not in changes and table.noise is not None:
            settings["noise"] = SIGMAS * np.asarray(table.noise)
        if "load" not in changes and table.load is not None:
            settings["load"] = np.abs(table.load)
        if isinstance(table.disturbance, Valve):
            problem = "is a valve that follows the output, around which nothing is proven"
            remedy, key = "give its flow over time, or remove it", "simulation.disturbance"
            raise Mistake("disturbance", table.disturbance, remedy, problem=problem, subject=f"[{key}]", key=key)
        with within(None, _of_the_file(self.simulation_keys, changes)):
            if "disturbance" not in changes and self.plant.disturbances:
                course = self.simulation_settings(reference, duration=settings["duration"])
                settings["disturbance"] = course["disturbance"]
            return certify(self.controller, **settings)

    def simulation_settings(
        self, reference: Callable[..., ArrayLike] | None = None, Ts: float | None = None, **changes: Any
    ) -> dict[str, Any]:
        """Arguments of `foreswitch.simulate` as [simulation] gives them.

        Parameters
        ----------
        reference : callable, optional
            Default: the project's; a valve of [simulation.disturbance] follows it.
        Ts : float, optional
            Switching period [s] at which disturbances are sampled. Default: the controller's.
        **changes
            Arguments that replace those of [simulation].

        Returns
        -------
        dict
        """
        reference, Ts = reference or self.reference, Ts or self.controller.Ts
        table = self.file.simulation
        settings: dict[str, Any] = table.given("duration", "x0", "noise", "load")
        settings |= {"plant": self.truth, "hardware": self.hardware, "seed": self.seed} | changes
        w: Any = table.disturbance
        if isinstance(w, Valve):
            w = w.law(reference, settings["plant"])
        elif self._courses:
            t = np.arange(check.periods(check.number("duration", settings["duration"], above=0.0), Ts)) * Ts
            w = sample(self._courses, t, self._courses.outputs, 1)[:, :, 0]
        settings.setdefault("disturbance", w)
        return settings


def _of_the_file(keys: Mapping[str, str], changes: Collection[str]) -> dict[str, str]:
    """Without what the caller gives instead: an argument, or with a plant or a hardware all that belongs to it."""
    given = tuple(f"{keys[name]}." for name in changes if name in keys)
    return {argument: key for argument, key in keys.items() if not f"{key}.".startswith(given)}
