"""Project files: one TOML file holds plant, actuator, controller, reference and simulation."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.text import nearest
from foreswitch.certificate.certificate import Certificate, certify
from foreswitch.control.controller import Controller
from foreswitch.control.kalman import Kalman
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.hardware import Hardware, Stuck
from foreswitch.model.plant import Plant
from foreswitch.model.reference import HalfSine, Ramp, Reference, Samples, Sine, Stack, Steps, sample
from foreswitch.simulation.baselines import Baseline, Tuned, tune
from foreswitch.simulation.loop import Law, measured_state, simulate
from foreswitch.simulation.run import Run

__all__ = ["Project"]

#: Of a noise given by its standard deviation, a certificate bears so many: one sample in 16 000 lies beyond.
SIGMAS = 4.0

Vector = list[float]
Matrix = list[list[float]]
Key = Field  # one line per key: default, then what it means


class Table(BaseModel):
    """A TOML table; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def given(self, *names: str) -> dict[str, Any]:
        """The keys that were set, as arguments."""
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


class Choice(Table):
    """A table one of whose keys decides which others are needed."""

    BY: ClassVar[str]
    #: Choice -> keys it needs, keys it may have besides.
    USES: ClassVar[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]]
    ALWAYS: ClassVar[tuple[str, ...]] = ()

    def arguments(self, table: str) -> dict[str, Any]:
        """The keys that go with the choice."""
        choice = getattr(self, self.BY)
        needed, optional = self.USES[choice]
        missing = [name for name in needed if getattr(self, name) is None]
        surplus = self.model_fields_set - {self.BY, *needed, *optional, *self.ALWAYS}
        if missing and (self.BY in self.model_fields_set or not surplus):
            raise ValueError(f"[{table}] has no key {missing[0]!r}, which {self.BY} = {choice!r} needs; add it")
        if surplus:
            key = min(surplus)
            others = [other for other, (must, may) in self.USES.items() if key in (*must, *may)]
            remedy = f"remove it, or give {self.BY} = {others[0]!r}" if len(others) == 1 else "remove it"
            raise ValueError(f"[{table}] has key {key!r}, which {self.BY} = {choice!r} does not use; {remedy}")
        return self.given(*needed, *optional)


class PlantTable(Choice):
    """[plant], [simulation.plant]"""

    BY = "model"
    USES = {
        "integrator_lag": (("k", "c"), ()),
        "fopdt": (("K", "T"), ()),
        "transfer_function": (("num", "den"), ()),
        "state_space": (("A", "B"), ()),
    }
    ALWAYS = ("C", "E", "input_delay", "u_offset", "y_offset", "input_names", "output_names")

    model: Literal["integrator_lag", "fopdt", "transfer_function", "state_space"] = Key(
        description="form of the plant; decides which of the next keys are needed"
    )
    k: float | None = Key(None, description="integrator_lag: slope of y at full input [unit of y / s]")
    c: float | None = Key(None, description="integrator_lag: lag [s]")
    K: float | None = Key(None, description="fopdt: gain [unit of y]")
    T: float | None = Key(None, description="fopdt: time constant [s]")
    num: Vector | None = Key(None, description="transfer_function: numerator, descending powers of s")
    den: Vector | None = Key(None, description="transfer_function: denominator, descending powers of s")
    A: Matrix | None = Key(None, description="state_space: state matrix [1/s]")
    B: Matrix | None = Key(None, description="state_space: input matrix")
    C: Matrix | None = Key(None, description="output matrix; default the first state")
    E: Matrix | None = Key(None, description="entry of the measured disturbance; default none")
    input_delay: float | Vector = Key(0.0, description="dead time [s], one for all inputs or one each")
    u_offset: float | Vector | None = Key(None, description="operating point of the input(s)")
    y_offset: float | Vector | None = Key(None, description="operating point of the output(s)")
    input_names: list[str] | None = Key(None, description='names, with their unit: "valve [-]"')
    output_names: list[str] | None = Key(None, description='names, with their unit: "pressure [kPa]"')

    def build(self, table: str = "plant") -> Plant:
        """The plant."""
        arguments = self.arguments(table)
        build: dict[str, Callable[..., Plant]] = {
            "integrator_lag": lambda k, c: Plant.integrator_lag(k, c, 0.0),
            "fopdt": lambda K, T: Plant.fopdt(K, T, 0.0),
            "transfer_function": Plant.from_tf,
            "state_space": lambda A, B: Plant(A, B, self.C),  # C says how many outputs there are
        }
        return build[self.model](**arguments).replace(**self.given(*self.ALWAYS))


class ActuatorTable(Table):
    """[actuator]"""

    levels: Vector | Matrix = Key(description="what each input can do, ascending; a list of lists for several inputs")
    Ts: float = Key(description="switching period [s]")
    min_on: float | Vector = Key(0.0, description="shortest time at a level other than the safe one [s]")
    min_off: float | Vector = Key(0.0, description="shortest time at the safe level [s]")
    switch_cost: float | Vector = Key(0.0, description="added to the cost of a command for each input it changes")
    forbidden: list[float | Vector] = Key([], description="combinations of levels that must never be commanded")
    safe_level: float | Vector | None = Key(None, description="commanded after bad_limit bad samples; default never")


class ControllerTable(Choice):
    """[controller]"""

    BY = "objective"
    USES = {
        "endpoint": (("Td", "lam"), ("tail", "weight", "relative_degree")),
        "horizon": (
            ("steps",),
            ("weight", "lam", "move_weight", "window", "moves", "tail", "terminal", "node_budget", "relative_degree"),
        ),
    }
    ALWAYS = ("preview", "bad_limit", "real")

    objective: Literal["endpoint", "horizon"] = Key(
        "endpoint",
        description="land at one instant, or follow over many periods; decides which of the next keys are used",
    )
    Td: float | None = Key(None, description="endpoint: settling horizon after the dead time [s], at least Ts")
    steps: int | None = Key(None, description="horizon: periods looked at beyond the dead time, 1 to 64")
    lam: float | Vector | None = Key(
        None,
        description="bandwidth of the sliding variable [rad/s], one for all outputs or one each; horizon: default none, "
        "the error itself is weighed",
    )
    move_weight: float | Vector | None = Key(
        None, description="horizon: price of an input's move, times its square; default 0"
    )
    window: list[int] | None = Key(
        None, description="horizon: first and last period evaluated; default all, [1, steps]"
    )
    moves: int | None = Key(None, description="horizon: periods in which the commands are free; default all")
    tail: Literal["rest", "zero", "hold"] | None = Key(
        None,
        description='input after the candidate or the moves; endpoint: default "rest", and no "hold"; horizon: default '
        '"hold", the last move',
    )
    terminal: Literal["riccati"] | Matrix | None = Key(
        None, description="horizon: cost of ending away from rest, or its matrix [x, squared]; default none"
    )
    node_budget: int | None = Key(
        None, description="horizon: partial sequences after which the best so far is taken; default no limit"
    )
    weight: float | Vector = Key(1.0, description="weight of each output")
    relative_degree: int | list[int] | None = Key(None, description="of each output; default found numerically")
    preview: bool | Literal["lag"] | float = Key(
        False,
        description='reference sampled: false now, true at the instants evaluated, "lag" (endpoint), or seconds ahead',
    )
    bad_limit: int = Key(10, description="bad measurements in a row that force the safe level")
    real: Literal["float64", "float32"] = Key("float64", description="arithmetic of the core")

    def build(self) -> Endpoint | Horizon:
        """The objective."""
        arguments = self.arguments("controller")
        return Endpoint(**arguments) if self.objective == "endpoint" else Horizon(**arguments)


class EstimatorTable(Table):
    """[estimator]"""

    process_noise: float | Vector | Matrix = Key(
        description="variance that each state gathers in one period, or the covariance matrix [unit of x, squared]"
    )
    measurement_noise: float | Vector | Matrix = Key(
        description="variance of each measured output, or the covariance matrix [unit of y, squared]"
    )
    load: float | Vector | None = Key(
        None, description="variance that an unknown constant input gathers in one period, 0 for none; default none"
    )
    gate: float = Key(6.0, description="innovations beyond so many standard deviations are outliers; 0: none are")
    gate_limit: int = Key(3, description="outliers in a row that are not used")


class ReferenceTable(Choice):
    """[reference], or [[reference]] for each output"""

    BY = "kind"
    USES = {
        "constant": (("value",), ()),
        "half_sine": (("height", "duration"), ("start", "offset")),
        "sine": (("amplitude", "frequency"), ("phase", "offset")),
        "ramp": (("slope",), ("start", "offset")),
        "steps": (("times", "values"), ()),
        "samples": (("file",), ("time", "value", "between")),
        "points": (("times", "values"), ("between",)),
    }

    kind: Literal["constant", "half_sine", "sine", "ramp", "steps", "samples", "points"] = Key(
        description="decides which of the next keys are used"
    )
    value: float | str | None = Key(None, description="constant: value; samples: name of the value column")
    height: float | None = Key(None, description="half_sine: rise from trough to crest [unit of y]")
    duration: float | None = Key(None, description="half_sine: length of the half period [s]")
    amplitude: float | None = Key(None, description="sine: amplitude [unit of y]")
    frequency: float | None = Key(None, description="sine: frequency [Hz]")
    phase: float | None = Key(None, description="sine: phase [rad]")
    slope: float | None = Key(None, description="ramp: slope [unit of y / s]")
    start: float | None = Key(None, description="half_sine, ramp: when it begins [s]")
    offset: float | None = Key(None, description="half_sine, sine, ramp: added to all values [unit of y]")
    times: Vector | None = Key(None, description="steps: when each value begins [s]; points: the instants [s]")
    values: Vector | None = Key(None, description="steps, points: the values [unit of y]")
    file: str | None = Key(None, description="samples: CSV file with a header row, relative to the project file")
    time: str | None = Key(None, description="samples: name of the time column; default the first")
    between: Literal["pchip", "linear", "hold"] | None = Key(
        None, description="samples, points: the curve between them"
    )

    def build(self, folder: Path | None, table: str = "reference") -> Reference:
        """The reference of one output, or the course of one disturbance."""
        arguments = self.arguments(table)
        if self.kind in ("samples", "points"):
            kind = arguments.pop("between", "pchip")
            if self.kind == "points":
                return Samples(self.times or [], self.values or [], kind=kind)
            if folder is None:
                raise ValueError(f"[{table}] file is {self.file!r}, and there are no files here; give its points")
            path = folder / arguments.pop("file")
            return Samples.read_csv(path, kind=kind, **arguments)
        if self.kind == "constant":
            if not isinstance(self.value, float):
                raise ValueError(f"[{table}] value is {self.value!r}; give a number")
            return Steps([0.0], [self.value])
        build: dict[str, Callable[..., Reference]] = {"half_sine": HalfSine, "sine": Sine, "ramp": Ramp, "steps": Steps}
        return build[self.kind](**arguments)


class Valve(Table):
    """A measured disturbance that opens on demand."""

    gain: float = Key(description="w per unit of y - yd (first output)")
    low: float = Key(0.0, description="smallest w")
    high: float = Key(description="largest w")
    deadband: float = Key(0.0, description="y - yd up to which it stays shut")
    feedforward: float = Key(0.0, description="share of the reference's fall -yd' that is added")

    def law(self, reference: Callable[..., ArrayLike], truth: Plant) -> Callable[[float, Array], Array]:
        """``(t, x) -> w`` for `foreswitch.simulate`."""

        def flow(t: float, x: Array) -> Array:
            value, slope = sample(reference, np.array([t]), truth.outputs, 2)[0, 0]
            excess = float(truth.C[0] @ x + truth.y_offset[0]) - value
            beyond = np.sign(excess) * max(abs(excess) - self.deadband, 0.0)
            return np.array([min(max(self.gain * beyond - self.feedforward * slope, self.low), self.high)])

        return flow


class StuckTable(Table):
    """[[simulation.hardware.stuck]]"""

    level: float = Key(description="where the actuator stays")
    start: float = Key(0.0, description="from when [s]")
    end: float | None = Key(None, description="until when [s]; default the end of the run")
    input: int = Key(0, description="which input, from 0")


class HardwareTable(Table):
    """[simulation.hardware]"""

    opening: float | Vector = Key(0.0, description="travel time of a rising edge, after the dead time [s]")
    closing: float | Vector = Key(0.0, description="travel time of a falling edge [s]")
    quantum: float | Vector = Key(0.0, description="step of the sensor; 0 for none")
    low: float | Vector | None = Key(None, description="lower end of the sensor's range")
    high: float | Vector | None = Key(None, description="upper end of the sensor's range")
    process_noise: float | Vector = Key(0.0, description="deviation gathered by each state in 1 s [x / sqrt(s)]")
    missing: float = Key(0.0, description="share of samples that are lost")
    late: float = Key(0.0, description="longest time a sample is under way [s]")
    outages: list[Vector] = Key([], description="times without any sample, as [start, end] [s]")
    stuck: list[StuckTable] = Key([], description="actuators that stay at one level for a while")
    drift: PlantTable | None = Key(None, description="the truth at the end of the run; keys as in [plant]")

    def build(self) -> Hardware:
        """The hardware."""
        settings = self.given("opening", "closing", "quantum", "low", "high", "process_noise", "missing", "late")
        stuck = [Stuck(**fault.given("level", "start", "end", "input")) for fault in self.stuck]
        drift = self.drift.build("simulation.hardware.drift") if self.drift else None
        outages: Any = [tuple(window) for window in self.outages]  # Hardware judges them
        return Hardware(**settings, stuck=stuck, drift=drift, outages=outages)


class SimulationTable(Table):
    """[simulation]"""

    duration: float = Key(description="length of the run [s]")
    x0: Vector | None = Key(None, description="initial state; default zero")
    noise: float | Vector | None = Key(
        None, description="standard deviation of the measured states, with an [estimator] of the outputs"
    )
    seed: int | None = Key(None, description="of the noise; without one, each run differs")
    disturbance: float | Vector | Valve | list[ReferenceTable] | None = Key(
        None,
        description="measured w: constant; or a table: a valve that opens with gain * (y - yd); or a list of tables, one "
        "for each, with the keys of [reference]",
    )
    load: float | Vector | None = Key(None, description="unmeasured, added to the input(s)")
    plant: PlantTable | None = Key(None, description="the truth, where it differs from the model; keys as in [plant]")
    hardware: HardwareTable | None = Key(None, description="what real actuators and sensors add; a table")


class File(Table):
    """A whole project file."""

    plant: PlantTable
    actuator: ActuatorTable
    controller: ControllerTable
    estimator: EstimatorTable | None = None
    reference: ReferenceTable | list[ReferenceTable]
    simulation: SimulationTable


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
        self.file, self.folder = _validated(content), Path(folder or ".")
        self._readable = None if folder is None else self.folder
        self.plant = self.file.plant.build()
        self.controller = self.build_controller()
        tables = self.file.reference if isinstance(self.file.reference, list) else [self.file.reference]
        parts = [table.build(self._readable) for table in tables]
        if len(parts) != self.plant.outputs:
            raise ValueError(f"[reference] stands {len(parts)} time(s); the plant has {self.plant.outputs} output(s)")
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
        twin.file = _validated(self.file.model_dump(exclude_unset=True) | {"simulation": table})
        twin._simulated()
        return twin

    def _disturbances(self, folder: Path | None) -> Stack | None:
        """The disturbances that run a course of their own."""
        tables, wanted = self.file.simulation.disturbance, self.truth.disturbances
        courses = [
            table.build(folder, "simulation.disturbance")
            for table in (tables if isinstance(tables, list) else [])
            if isinstance(table, ReferenceTable)
        ]
        if courses and len(courses) != wanted:
            raise ValueError(
                f"[simulation.disturbance] stands {len(courses)} time(s); the plant has {wanted} disturbance(s)"
            )
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
            reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
            raise ValueError(f"{path} cannot be read ({reason}); give a project file, see 'foreswitch init'") from None
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{path} is not valid TOML ({error}); correct that line") from None
        try:
            return cls(content, Path(path).parent)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

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
        settings = actuator.model_dump() | controller.given(*controller.ALWAYS) | {"plant": self.plant}
        settings["estimator"] = Kalman(**estimator.model_dump()) if estimator else None
        known = settings.keys() | ControllerTable.model_fields.keys()
        unknown = sorted(changes.keys() - known)
        if unknown:
            raise ValueError(f"{unknown[0]!r} is no setting of a controller; {nearest(unknown[0], known)}")
        objective = changes.get("objective")
        of_objective = {name: value for name, value in changes.items() if name not in settings and name != "objective"}
        if objective is None:
            objective = controller.model_copy(update=of_objective).build()
        elif not isinstance(objective, (Endpoint, Horizon)):
            raise ValueError(f"objective is {objective!r}; give an Endpoint or a Horizon")
        elif of_objective:
            raise ValueError(f"{min(of_objective)!r} is given beside an objective; put it into that")
        own = {name: value for name, value in changes.items() if name in settings}
        return Controller(**(settings | own | {"objective": objective}))

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
        return kind(self.plant, self.file.actuator.levels, self.controller.Ts, **parameters, **self._shared())

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
        settings = self._settings(self.reference, self.controller.Ts, {})
        duration, truth = settings.pop("duration"), settings.pop("plant")
        return tune(
            kind, self.plant, self.file.actuator.levels, self.controller.Ts, self.reference, duration, budget=budget,
            search_seed=seed, preview=float(np.max(self.controller.reference_times)), shared=self._shared(), truth=truth,
            **settings,
        )  # fmt: skip

    def _shared(self) -> dict[str, Any]:
        """What every law of this project has to respect."""
        if self.file.estimator:
            raise ValueError(
                "[estimator] is there, but baselines measure the whole state; remove it to compare with them"
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
        settings = self._settings(reference, law.Ts, changes)
        return simulate(law, reference, settings.pop("duration"), **settings)

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
            raise ValueError(
                "[simulation.disturbance] is a valve that follows the output, around which nothing is proven; give its "
                "flow over time, or remove it"
            )
        if "disturbance" not in changes and self.plant.disturbances:
            course = self._settings(reference, self.controller.Ts, {"duration": settings["duration"]})
            settings["disturbance"] = course["disturbance"]
        return certify(self.controller, **settings)

    def _settings(self, reference: Callable[..., ArrayLike], Ts: float, changes: dict[str, Any]) -> dict[str, Any]:
        """Arguments of `foreswitch.simulate`."""
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


def _validated(content: dict[str, Any]) -> File:
    """The tables, or one complaint."""
    try:
        return File.model_validate(content)
    except ValidationError as error:
        raise ValueError(_sentence(error, content)) from None


def _sentence(error: ValidationError, content: dict[str, Any]) -> str:
    """One complaint in one sentence, its place in the words of the file."""
    # a union reports every branch that failed; an unknown or missing key says most, then what lies deepest
    ranks = {"extra_forbidden": 0, "missing": 1}
    detail = min(error.errors(include_url=False), key=lambda item: (ranks.get(item["type"], 2), -len(item["loc"])))
    path: list[str] = []
    found: list[tuple[Any, type[Table]]] = []  # for each part: what it holds, and the table it is a key of
    value: Any = content
    table: type[Table] = File
    for part in detail["loc"]:
        if isinstance(value, dict) and part in value:
            value = value[part]
            path.append(str(part))
            found.append((value, table))
            table = SUBTABLES.get(str(part), table)
        elif isinstance(part, int) and isinstance(value, list):
            value = value[part]
            table = ReferenceTable if table is Valve else table  # a list of disturbances: each has a course
    key = str(detail["loc"][-1])
    if detail["type"] == "missing":
        return f"[{'.'.join(path)}] has no key {key!r}; add it" if path else f"table [{key}] is missing; add it"
    place = f"[{'.'.join(path[:-1])}]" if path[:-1] else "the file"
    if detail["type"] == "extra_forbidden":
        return f"{place} has an unknown {'key' if path[:-1] else 'table'} {key!r}; {nearest(key, table.model_fields)}"
    while path[-1] not in found[len(path) - 1][1].model_fields:
        path.pop()
    value, table = found[len(path) - 1]
    description = table.model_fields[path[-1]].description
    if detail["type"] == "literal_error":
        meaning = f"give {detail['ctx']['expected']}"
    else:
        meaning = f"it holds: {description}" if description else "give a table"
    return f"{'.'.join(path)} is {value!r}; {meaning}"


#: Every table under its name, in the order of a project file.
TABLES: dict[str, type[Table]] = {
    "plant": PlantTable,
    "actuator": ActuatorTable,
    "estimator": EstimatorTable,
    "controller": ControllerTable,
    "reference": ReferenceTable,
    "simulation": SimulationTable,
    "simulation.plant": PlantTable,
    "simulation.disturbance": Valve,
    "simulation.hardware": HardwareTable,
    "simulation.hardware.stuck": StuckTable,
    "simulation.hardware.drift": PlantTable,
}
SUBTABLES = {name.rpartition(".")[2]: table for name, table in TABLES.items()}
