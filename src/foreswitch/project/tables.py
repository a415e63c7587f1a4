"""The tables of a project file: each key with its type, default and meaning, and what a table builds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown, within
from foreswitch._helpers.units import described
from foreswitch.control.objective import Endpoint, Horizon
from foreswitch.model.hardware import Hardware, Stuck
from foreswitch.model.plant import Plant
from foreswitch.model.reference import HalfSine, Ramp, Reference, Samples, Sine, Steps, sample

__all__ = [
    "CONTROLLER_KEYS",
    "SIMULATION_KEYS",
    "SUBTABLES",
    "TABLES",
    "ActuatorTable",
    "Choice",
    "ControllerTable",
    "EstimatorTable",
    "File",
    "HardwareTable",
    "PlantTable",
    "ReferenceTable",
    "SimulationTable",
    "Table",
    "Valve",
    "unit_of",
]

Vector = list[float]
Matrix = list[list[float]]


def Key(default: Any = ..., *, means: str, unit: str | None = None, note: str = "") -> Any:
    """A key of a table, in one line: its default, what it means, in which unit, and what there is to say besides."""
    return Field(default, description=described(means, unit, note), json_schema_extra={"unit": unit})


def unit_of(field: FieldInfo) -> str | None:
    """The unit that a key was declared with."""
    extra = field.json_schema_extra
    unit = extra.get("unit") if isinstance(extra, dict) else None
    return unit if isinstance(unit, str) else None


class Table(BaseModel):
    """A TOML table; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    #: Argument -> the key it is read from, where the two bear different names.
    ARGUMENTS: ClassVar[dict[str, str]] = {}

    @classmethod
    def keys_at(cls, place: str) -> dict[str, str]:
        """Argument -> key in the file, "actuator.Ts", of what this table gives when it stands at ``place``."""
        named = {name: name for name in cls.model_fields} | cls.ARGUMENTS
        return {argument: f"{place}.{key}" for argument, key in named.items()}

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
            problem = f"has no key {missing[0]!r}, which {self.BY} = {choice!r} needs"
            raise Mistake(missing[0], None, "add it", problem=problem, subject=f"[{table}]")
        if surplus:
            key = min(surplus)
            others = [other for other, (must, may) in self.USES.items() if key in (*must, *may)]
            remedy = f"remove it, or give {self.BY} = {others[0]!r}" if len(others) == 1 else "remove it"
            problem = f"has key {key!r}, which {self.BY} = {choice!r} does not use"
            raise Mistake(key, getattr(self, key), remedy, problem=problem, subject=f"[{table}]")
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
        means="form of the plant; decides which of the next keys are needed"
    )
    k: float | None = Key(None, means="integrator_lag: slope of y at full input", unit="unit of y / s")
    c: float | None = Key(None, means="integrator_lag: lag", unit="s")
    K: float | None = Key(None, means="fopdt: gain", unit="unit of y")
    T: float | None = Key(None, means="fopdt: time constant", unit="s")
    num: Vector | None = Key(None, means="transfer_function: numerator, descending powers of s")
    den: Vector | None = Key(None, means="transfer_function: denominator, descending powers of s")
    A: Matrix | None = Key(None, means="state_space: state matrix", unit="1/s")
    B: Matrix | None = Key(None, means="state_space: input matrix")
    C: Matrix | None = Key(None, means="output matrix; default the first state")
    E: Matrix | None = Key(None, means="entry of the measured disturbance; default none")
    input_delay: float | Vector = Key(0.0, means="dead time", unit="s", note=", one for all inputs or one each")
    u_offset: float | Vector | None = Key(None, means="operating point of the input(s)")
    y_offset: float | Vector | None = Key(None, means="operating point of the output(s)")
    input_names: list[str] | None = Key(None, means='names, with their unit: "valve [-]"')
    output_names: list[str] | None = Key(None, means='names, with their unit: "pressure [kPa]"')

    def build(self, table: str = "plant") -> Plant:
        """The plant."""
        build: dict[str, Callable[..., Plant]] = {
            "integrator_lag": lambda k, c: Plant.integrator_lag(k, c, 0.0),
            "fopdt": lambda K, T: Plant.fopdt(K, T, 0.0),
            "transfer_function": Plant.from_tf,
            "state_space": lambda A, B: Plant(A, B, self.C),  # C says how many outputs there are
        }
        with within(table, self.keys_at(table)):
            return build[self.model](**self.arguments(table)).replace(**self.given(*self.ALWAYS))


class ActuatorTable(Table):
    """[actuator]"""

    levels: Vector | Matrix = Key(means="what each input can do, ascending; a list of lists for several inputs")
    Ts: float = Key(means="switching period", unit="s")
    min_on: float | Vector = Key(0.0, means="shortest time at a level other than the safe one", unit="s")
    min_off: float | Vector = Key(0.0, means="shortest time at the safe level", unit="s")
    switch_cost: float | Vector = Key(0.0, means="added to the cost of a command for each input it changes")
    forbidden: list[float | Vector] = Key([], means="combinations of levels that must never be commanded")
    safe_level: float | Vector | None = Key(None, means="commanded after bad_limit bad samples; default never")


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
        means="land at one instant, or follow over many periods; decides which of the next keys are used",
    )
    Td: float | None = Key(None, means="endpoint: settling horizon after the dead time", unit="s", note=", at least Ts")
    steps: int | None = Key(None, means="horizon: periods looked at beyond the dead time, 1 to 64")
    lam: float | Vector | None = Key(
        None,
        means="bandwidth of the sliding variable",
        unit="rad/s",
        note=", one for all outputs or one each; horizon: default none, the error itself is weighed",
    )
    move_weight: float | Vector | None = Key(
        None, means="horizon: price of an input's move, times its square; default 0"
    )
    window: list[int] | None = Key(None, means="horizon: first and last period evaluated; default all, [1, steps]")
    moves: int | None = Key(None, means="horizon: periods in which the commands are free; default all")
    tail: Literal["rest", "zero", "hold"] | None = Key(
        None,
        means='input after the candidate or the moves; endpoint: default "rest", and no "hold"; horizon: default '
        '"hold", the last move',
    )
    terminal: Literal["riccati"] | Matrix | None = Key(
        None, means="horizon: cost of ending away from rest, or its matrix [x, squared]; default none"
    )
    node_budget: int | None = Key(
        None, means="horizon: partial sequences after which the best so far is taken; default no limit"
    )
    weight: float | Vector = Key(1.0, means="weight of each output")
    relative_degree: int | list[int] | None = Key(None, means="of each output; default found numerically")
    preview: bool | Literal["lag"] | float = Key(
        False,
        means='reference sampled: false now, true at the instants evaluated, "lag" (endpoint), or seconds ahead',
    )
    bad_limit: int = Key(10, means="bad measurements in a row that force the safe level")
    real: Literal["float64", "float32"] = Key("float64", means="arithmetic of the core")

    def build(self) -> Endpoint | Horizon:
        """The objective."""
        arguments = self.arguments("controller")
        return Endpoint(**arguments) if self.objective == "endpoint" else Horizon(**arguments)


class EstimatorTable(Table):
    """[estimator]"""

    process_noise: float | Vector | Matrix = Key(
        means="variance that each state gathers in one period, or the covariance matrix", unit="unit of x, squared"
    )
    measurement_noise: float | Vector | Matrix = Key(
        means="variance of each measured output, or the covariance matrix", unit="unit of y, squared"
    )
    load: float | Vector | None = Key(
        None, means="variance that an unknown constant input gathers in one period, 0 for none; default none"
    )
    gate: float = Key(6.0, means="innovations beyond so many standard deviations are outliers; 0: none are")
    gate_limit: int = Key(3, means="outliers in a row that are not used")


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
    ARGUMENTS = {"t": "times", "y": "values", "path": "file"}

    kind: Literal["constant", "half_sine", "sine", "ramp", "steps", "samples", "points"] = Key(
        means="decides which of the next keys are used"
    )
    value: float | str | None = Key(None, means="constant: value; samples: name of the value column")
    height: float | None = Key(None, means="half_sine: rise from trough to crest", unit="unit of y")
    duration: float | None = Key(None, means="half_sine: length of the half period", unit="s")
    amplitude: float | None = Key(None, means="sine: amplitude", unit="unit of y")
    frequency: float | None = Key(None, means="sine: frequency", unit="Hz")
    phase: float | None = Key(None, means="sine: phase", unit="rad")
    slope: float | None = Key(None, means="ramp: slope", unit="unit of y / s")
    start: float | None = Key(None, means="half_sine, ramp: when it begins", unit="s")
    offset: float | None = Key(None, means="half_sine, sine, ramp: added to all values", unit="unit of y")
    times: Vector | None = Key(None, means="steps: when each value begins", unit="s", note="; points: the instants [s]")
    values: Vector | None = Key(None, means="steps, points: the values", unit="unit of y")
    file: str | None = Key(None, means="samples: CSV file with a header row, relative to the project file")
    time: str | None = Key(None, means="samples: name of the time column; default the first")
    between: Literal["pchip", "linear", "hold"] | None = Key(None, means="samples, points: the curve between them")

    def build(self, folder: Path | None, table: str = "reference") -> Reference:
        """The reference of one output, or the course of one disturbance."""
        with within(table, self.keys_at(table)):
            return self._built(folder, table)

    def _built(self, folder: Path | None, table: str) -> Reference:
        arguments = self.arguments(table)
        if self.kind in ("samples", "points"):
            kind = arguments.pop("between", "pchip")
            if self.kind == "points":
                return Samples(self.times or [], self.values or [], kind=kind)
            if folder is None:
                problem = f"is {shown(self.file)}, and there are no files here"
                raise Mistake("file", self.file, "give its points", problem=problem, subject=f"[{table}] file")
            path = folder / arguments.pop("file")
            return Samples.read_csv(path, kind=kind, **arguments)
        if self.kind == "constant":
            if not isinstance(self.value, float):
                raise Mistake("value", self.value, "give a number", subject=f"[{table}] value")
            return Steps([0.0], [self.value])
        build: dict[str, Callable[..., Reference]] = {"half_sine": HalfSine, "sine": Sine, "ramp": Ramp, "steps": Steps}
        return build[self.kind](**arguments)


class Valve(Table):
    """A measured disturbance that opens on demand."""

    gain: float = Key(means="w per unit of y - yd (first output)")
    low: float = Key(0.0, means="smallest w")
    high: float = Key(means="largest w")
    deadband: float = Key(0.0, means="y - yd up to which it stays shut")
    feedforward: float = Key(0.0, means="share of the reference's fall -yd' that is added")

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

    level: float = Key(means="where the actuator stays")
    start: float = Key(0.0, means="from when", unit="s")
    end: float | None = Key(None, means="until when", unit="s", note="; default the end of the run")
    input: int = Key(0, means="which input, from 0")


class HardwareTable(Table):
    """[simulation.hardware]"""

    opening: float | Vector = Key(0.0, means="travel time of a rising edge, after the dead time", unit="s")
    closing: float | Vector = Key(0.0, means="travel time of a falling edge", unit="s")
    quantum: float | Vector = Key(0.0, means="step of the sensor; 0 for none")
    low: float | Vector | None = Key(None, means="lower end of the sensor's range")
    high: float | Vector | None = Key(None, means="upper end of the sensor's range")
    process_noise: float | Vector = Key(0.0, means="deviation gathered by each state in 1 s", unit="x / sqrt(s)")
    missing: float = Key(0.0, means="share of samples that are lost")
    late: float = Key(0.0, means="longest time a sample is under way", unit="s")
    outages: list[Vector] = Key([], means="times without any sample, as [start, end]", unit="s")
    stuck: list[StuckTable] = Key([], means="actuators that stay at one level for a while")
    drift: PlantTable | None = Key(None, means="the truth at the end of the run; keys as in [plant]")

    def build(self, table: str = "simulation.hardware") -> Hardware:
        """The hardware."""
        drift = self.drift.build(f"{table}.drift") if self.drift else None
        stuck = []
        for i, fault in enumerate(self.stuck):
            with within(f"{table}.stuck.{i}", fault.keys_at(f"{table}.stuck.{i}")):
                stuck.append(Stuck(**fault.given("level", "start", "end", "input")))
        settings = self.given("opening", "closing", "quantum", "low", "high", "process_noise", "missing", "late")
        outages: Any = [tuple(window) for window in self.outages]  # Hardware judges them
        with within(table, self.keys_at(table)):
            return Hardware(**settings, stuck=stuck, drift=drift, outages=outages)


class SimulationTable(Table):
    """[simulation]"""

    duration: float = Key(means="length of the run", unit="s")
    x0: Vector | None = Key(None, means="initial state; default zero")
    noise: float | Vector | None = Key(
        None, means="standard deviation of the measured states, with an [estimator] of the outputs"
    )
    seed: int | None = Key(None, means="of the noise; without one, each run differs")
    disturbance: float | Vector | Valve | list[ReferenceTable] | None = Key(
        None,
        means="measured w: constant; or a table: a valve that opens with gain * (y - yd); or a list of tables, one "
        "for each, with the keys of [reference]",
    )
    load: float | Vector | None = Key(None, means="unmeasured, added to the input(s)")
    plant: PlantTable | None = Key(None, means="the truth, where it differs from the model; keys as in [plant]")
    hardware: HardwareTable | None = Key(None, means="what real actuators and sensors add; a table")


class File(Table):
    """A whole project file."""

    plant: PlantTable
    actuator: ActuatorTable
    controller: ControllerTable
    estimator: EstimatorTable | None = None
    reference: ReferenceTable | list[ReferenceTable]
    simulation: SimulationTable


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

#: Argument of `Controller`, of its objective or its estimator -> key in the file.
CONTROLLER_KEYS = {
    name: key
    for table in ("plant", "actuator", "controller", "estimator")
    for name, key in {table: table, **TABLES[table].keys_at(table)}.items()
}
#: Argument of `simulate` or of its hardware -> key in the file.
SIMULATION_KEYS = {
    **HardwareTable.keys_at("simulation.hardware"), **SimulationTable.keys_at("simulation"), "reference": "reference",
}  # fmt: skip
