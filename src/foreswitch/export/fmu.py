"""A controller as an FMU for co-simulation: the core, a fixed shell, the design, and what describes them."""

from __future__ import annotations

import hashlib
import io
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from foreswitch._binding import REALS
from foreswitch._helpers.check import Array
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.units import name_and_unit
from foreswitch.control.controller import Controller, Status
from foreswitch.control.objective import Horizon
from foreswitch.export.firmware import CORE, HORIZON, SHELL, check_export, filled, headline
from foreswitch.export.header import Design, initialiser, number

__all__ = ["export_fmu"]

#: Folder and suffix of a binary, by operating system and processor, as FMI 2.0 names them.
PLATFORMS = {
    ("linux", "x86_64"): ("linux64", ".so"),
    ("darwin", "x86_64"): ("darwin64", ".dylib"),
    ("win32", "amd64"): ("win64", ".dll"),
}
#: No names but those of the standard, no fused products, nothing that differs from one build to the next.
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"]
COMPILERS = ["gcc", "clang", "cc"]
UNKNOWN = "{00000000-0000-0000-0000-000000000000}"
BASES = {
    Status.OK: "the measurement", Status.COASTING: "the model's prediction in place of a bad measurement",
    Status.HELD: "nothing usable, the command is kept", Status.SAFE: "the safe level after bad measurements in a row",
}  # fmt: skip
EPOCH = (1980, 1, 1, 0, 0, 0)


def export_fmu(controller: Controller, path: str | Path, *, name: str = "controller", binary: bool = True) -> None:
    """Write a controller as an FMU for co-simulation (FMI 2.0), with its sources.

    It starts where the controller stands: commands under way and dwell, and the state if one is known.

    Parameters
    ----------
    controller : Controller
        Its design is exported, in its arithmetic.
    path : str or Path
        The .fmu file; its folder is made if missing. Written whole or not at all.
    name : str
        Name of the model, a C identifier.
    binary : bool
        Compile it for this machine; False: sources only, for tools that compile them.

    Raises
    ------
    ValueError
        If the name is no C identifier, the path cannot be written, or there is no compiler for this machine.

    Examples
    --------
    >>> import tempfile, zipfile
    >>> from pathlib import Path
    >>> from foreswitch import Controller, Endpoint, Plant
    >>> valve = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005, output_names="pressure [kPa]")
    >>> law = Controller(valve, [0, 1], 1e-3, Endpoint(Td=0.020, lam=2500.0))
    >>> path = Path(tempfile.mkdtemp()) / "controller.fmu"
    >>> export_fmu(law, path, binary=False)
    >>> zipfile.ZipFile(path).namelist()[:3]
    ['modelDescription.xml', 'sources/LICENSE', 'sources/fmi.c']
    """
    check_export(controller, name)
    target = Path(path)
    if target.suffix != ".fmu" or target.is_dir():
        raise ValueError(f"path is {str(path)!r}; give a file that ends in .fmu")
    sources, variables = _sources(controller, name), _variables(controller)
    description = _description(controller, name, variables, sorted(f for f in sources if f.endswith(".c")))
    guid = _guid([description, *(f"{file}\n{text}" for file, text in sorted(sources.items()))])
    content = {"modelDescription.xml": description.replace(UNKNOWN, guid).encode()}
    content |= {f"sources/{file}": text.replace(UNKNOWN, guid).encode() for file, text in sources.items()}
    if binary:
        place, suffix = _platform()
        content[f"binaries/{place}/{name}{suffix}"] = _compiled(content, suffix)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, _packed(content))
    except OSError as error:
        raise ValueError(f"path {path} cannot be written ({error.strerror}); give another") from None


def _guid(parts: Sequence[str]) -> str:
    """Of what the FMU consists of, so that equal ones bear the same."""
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"


def _packed(content: dict[str, bytes]) -> bytes:
    """A zip file without dates, the description first, the rest in order."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(content, key=lambda file: ("/" in file, file)):
            entry = zipfile.ZipInfo(file, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, content[file])
    return buffer.getvalue()


# Binary ---------------------------------------------------------------------------------------------------------------


def _platform() -> tuple[str, str]:
    machine = platform.machine().lower()
    found = PLATFORMS.get((sys.platform, machine))
    if found is None:
        raise ValueError(
            f"binary is True, but FMI 2.0 has no name for {sys.platform} on {machine}; give binary=False (--source-only)"
        )
    return found


def _compiler() -> list[str]:
    """What CC names, else the first that is there."""
    named = os.environ.get("CC", "").strip()
    choices = [shlex.split(named)] if named else [[each] for each in COMPILERS]
    for command in choices:
        if shutil.which(command[0]):
            return command
    wanted = named or ", ".join(COMPILERS)
    raise ValueError(
        f"binary is True, but no C compiler is found ({wanted}); install one, or give binary=False (--source-only)"
    )


def _compiled(content: dict[str, bytes], suffix: str) -> bytes:
    compiler = _compiler()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in content.items():
            if file.startswith("sources/"):
                (Path(folder) / file.removeprefix("sources/")).write_bytes(text)
        sources = sorted(each.name for each in Path(folder).glob("*.c"))
        flags = FLAGS if suffix == ".dll" else [*FLAGS, "-fPIC"]
        command = [*compiler, *flags, "-o", f"library{suffix}", *sources]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        if done.returncode:
            said = (done.stderr.strip().splitlines() or ["it says nothing"])[0]
            raise ValueError(
                f"binary is True, but {shlex.join(compiler)} fails ({said}); set CC to another compiler, or give "
                "binary=False (--source-only)"
            )
        return (Path(folder) / f"library{suffix}").read_bytes()


# Variables ------------------------------------------------------------------------------------------------------------


@dataclass
class Variable:
    """One of the model's variables: causality as in FMI, or "constant", or nothing where it is not shown."""

    name: str
    causality: str
    description: str
    unit: str = ""
    kind: str = "Real"
    start: float | None = None
    bounds: tuple[float, float] | None = None
    reference: int = 0


def _variables(controller: Controller) -> list[Variable]:
    """In the order of core/fmi/fmi.c, so that a variable's place among those of its kind is its value reference."""
    searched = isinstance(controller.objective, Horizon)
    bases = "; ".join(f"{each.value}: {each.name}, {words}" for each, words in BASES.items())
    shown = "output" if searched else ""
    listed = [
        *_inputs(controller),
        *_results(controller, shown),
        *(Variable(name, "constant", what, unit, start=value) for name, value, unit, what in _constants(controller)),
        Variable("status", "output", bases, kind="Integer", bounds=(0, len(BASES) - 1)),
        Variable("bad_samples", "local", "Samples in a row that were not usable", kind="Integer"),
        Variable("bad_samples_total", "local", "Samples that were not usable", kind="Integer"),
        Variable("nodes", shown, "Partial sequences evaluated", kind="Integer"),
        Variable("optimal", shown, "Whether the command is proven best", kind="Boolean"),
    ]
    places = dict.fromkeys(("Real", "Integer", "Boolean"), 0)
    names: set[str] = set()
    for each in listed:
        each.reference = places[each.kind]
        places[each.kind] += 1
        while each.name in names:
            each.name += "_"
        names.add(each.name)
    return [each for each in listed if each.causality]


def _inputs(law: Controller) -> Iterator[Variable]:
    plant, outputs = law.plant, _named("y", law.plant.output_names)
    if law.estimator is None:
        for i in range(plant.states):
            yield Variable(f"measured.x[{i + 1}]", "input", f"Measured state {i + 1} of the model", start=0.0)
    else:
        for spelled, unit, given in outputs:
            yield Variable(f"measured.{spelled}", "input", f"Measured {given}", unit, start=0.0)
    for e, row in enumerate(_times(law)):
        at = f"[{e + 1}]" if law.evaluations > 1 else ""
        for (spelled, unit, given), ahead in zip(outputs, row, strict=True):
            when = f"{ahead:.6g} s after the decision" if ahead else "at the decision"
            for order in range(law.order):
                what = given if order == 0 else f"derivative {order} of {given}"
                name = f"reference.{spelled}{('', '_der')[order > 0]}{order if order > 1 else ''}{at}"
                yield Variable(name, "input", f"Wanted {what}, {when}", _rate(unit, order), start=0.0)
    for i in range(plant.disturbances):
        yield Variable(f"disturbance[{i + 1}]", "input", f"Measured disturbance {i + 1}", start=0.0)


def _results(law: Controller, gap: str) -> Iterator[Variable]:
    for (spelled, unit, given), levels in zip(_named("u", law.plant.input_names), law.levels, strict=True):
        listed = ", ".join(f"{v:g}" for v in levels)
        bounds = float(levels[0]), float(levels[-1])
        yield Variable(f"command.{spelled}", "output", f"Commanded {given}: {listed}", unit, bounds=bounds)
    yield Variable("cost", "output", "Predicted cost of the command; 0 where none was computed")
    yield Variable("gap", gap, "What a better sequence could save at most; 0: the command is proven best")
    for i in range(law.plant.states):
        yield Variable(f"estimate.x[{i + 1}]", "local", f"State {i + 1} that the command is based on")
    for i in range(law.estimate[1].size):
        yield Variable(f"estimate.load[{i + 1}]", "local", f"Load {i + 1} that the command is based on")


def _times(law: Controller) -> Array:
    """When each output's reference is wanted, after the decision [s]: (evaluations, q)."""
    return np.broadcast_to(law.reference_times.reshape(law.evaluations, -1), (law.evaluations, law.plant.outputs))


def _constants(controller: Controller) -> list[tuple[str, float, str, str]]:
    """Name, value, unit, description."""
    plant = controller.plant
    listed = [("Ts", controller.Ts, "s", "Switching period")]
    for (spelled, unit, given), delay, levels in zip(
        _named("u", plant.input_names), plant.input_delay, controller.levels, strict=True
    ):
        listed.append((f"dead_time.{spelled}", float(delay), "s", f"Dead time of {given}"))
        for i, level in enumerate(levels):
            listed.append((f"level.{spelled}[{i + 1}]", float(level), unit, f"Level {i + 1} of {given}"))
    for e, row in enumerate(_times(controller)):
        at = f"[{e + 1}]" if controller.evaluations > 1 else ""
        for (spelled, _, given), ahead in zip(_named("y", plant.output_names), row, strict=True):
            what = f"When the reference of {given} is wanted, after the decision"
            listed.append((f"reference_time.{spelled}{at}", float(ahead), "s", what))
    return listed


def _rate(unit: str, order: int) -> str:
    return unit if not unit or order == 0 else f"{unit}/s" if order == 1 else f"{unit}/s{order}"


def _named(prefix: str, names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Of each name an identifier, the unit in brackets, and itself without that: "pressure [kPa]"."""
    found: list[tuple[str, str, str]] = []
    for i, name in enumerate(names):
        words, unit = name_and_unit(name)
        spelled = re.sub(r"[^A-Za-z0-9_]+", "_", words).strip("_") or f"{prefix}{i + 1}"
        if spelled[0].isdigit():
            spelled = f"{prefix}_{spelled}"
        while spelled in [each[0] for each in found]:
            spelled += f"_{i + 1}"
        found.append((spelled, unit, " ".join(words.split()) or spelled))
    return found


# Description ----------------------------------------------------------------------------------------------------------


def _description(controller: Controller, name: str, variables: Sequence[Variable], sources: Sequence[str]) -> str:
    """modelDescription.xml; the instants of one reference stand together."""
    listed = sorted(variables, key=_family(variables))
    outputs = "".join(f'      <Unknown index="{i + 1}"/>\n' for i, v in enumerate(listed) if v.causality == "output")
    units = sorted({v.unit for v in listed if v.unit})
    files_listed = "".join(f"      <File name={quoteattr(file)}/>\n" for file in sources)
    title = f"{', '.join(controller.plant.output_names)} by {', '.join(controller.plant.input_names)}"
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{UNKNOWN}"
  description={_quoted(f"Predictive control of {title}, every {controller.Ts:g} s")}
  generationTool="foreswitch {version("foreswitch")}" variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
    canSerializeFMUstate="true">
    <SourceFiles>
{files_listed}    </SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
{"".join(f"    <Unit name={_quoted(unit)}>{_base(unit)}</Unit>" + chr(10) for unit in units)}  </UnitDefinitions>
  <LogCategories>
    <Category name="logStatusWarning" description="What a command is based on, when that changes; steps over periods"/>
    <Category name="logStatusError" description="Calls that cannot be answered"/>
  </LogCategories>
  <DefaultExperiment startTime="0.0" stepSize="{controller.Ts!r}"/>
  <ModelVariables>
{"".join(map(_element, listed))}  </ModelVariables>
  <ModelStructure>
    <Outputs>
{outputs}    </Outputs>
    <InitialUnknowns>
{outputs}    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _family(variables: Sequence[Variable]) -> Callable[[Variable], tuple[int, int]]:
    """A sort key: where the first of the same name without index stands, then the own place."""
    first: dict[str, int] = {}
    for i, each in enumerate(variables):
        first.setdefault(each.name.split("[")[0], i)
    places = {each.name: (first[each.name.split("[")[0]], i) for i, each in enumerate(variables)}
    return lambda each: places[each.name]


def _base(unit: str) -> str:
    return '<BaseUnit s="1"/>' if unit == "s" else ""


def _quoted(text: str) -> str:
    """An attribute, of what XML can hold."""
    return quoteattr("".join(c if c.isprintable() else " " for c in text))


def _element(each: Variable) -> str:
    causality = "local" if each.causality == "constant" else each.causality
    variability = {"input": "continuous", "constant": "constant"}.get(each.causality, "discrete")
    initial = {"input": "", "constant": ' initial="exact"'}.get(each.causality, ' initial="calculated"')
    bounds = "" if each.bounds is None else f' min="{each.bounds[0]!r}" max="{each.bounds[1]!r}"'
    unit = f" unit={_quoted(each.unit)}" if each.unit else ""
    start = "" if each.start is None else f' start="{each.start!r}"'
    return (
        f'    <ScalarVariable name={_quoted(each.name)} valueReference="{each.reference}" causality="{causality}" '
        f'variability="{variability}"{initial} description={_quoted(each.description)}>\n'
        f"      <{each.kind}{unit}{bounds}{start}/>\n    </ScalarVariable>\n"
    )


# Sources --------------------------------------------------------------------------------------------------------------


def _sources(controller: Controller, name: str) -> dict[str, str]:
    """By name; core and shell are the library's own."""
    own, design = files("foreswitch.export"), Design.of(controller)
    core = [*CORE, *(HORIZON if design.horizon_sizes is not None else []), *SHELL, "LICENSE"]
    sources = {file: own.joinpath("c", file).read_bytes().decode("utf-8") for file in core}
    template, _, _ = own.joinpath("templates", "foreswitch_design.h").read_text("utf-8").partition("#ifdef FSW_STEPS")
    words = {"name": name, "title": headline(controller, name), "version": version("foreswitch")}
    words |= {"limits": design.limits_text(name), "tables": design.tables_text(name)}
    sources["foreswitch_design.h"] = filled(template, words) + "#endif\n"
    sources["foreswitch_fmu.h"] = _header(controller, design)
    return sources


def _header(controller: Controller, design: Design) -> str:
    real, plant = REALS[controller.real], controller.plant
    reference = controller.evaluations * plant.outputs * controller.order
    constants = [np.float64(value) for _, value, _, _ in _constants(controller)]
    levels = np.concatenate(controller.levels).astype(np.float64)
    line, wait = (np.frombuffer(each, kind) for each, kind in
                  ((controller._core.line(), np.uint8), (controller._core.wait(), np.uint32)))  # fmt: skip
    x, w = np.empty(plant.states), np.empty(controller._disturbances)
    primed = controller._core.estimate(x, w)
    start = ""
    if primed:
        start = (
            f"static const fsw_real fsw_fmu_x[] = {initialiser(x.astype(real))};\n"
            f"static const fsw_real fsw_fmu_w[] = {initialiser(w.astype(real))};\n"
        )
    return f"""/* What fmi.c asks for besides the design. Made by foreswitch {version("foreswitch")}; do not edit. */
#ifndef FORESWITCH_FMU_H
#define FORESWITCH_FMU_H

#define FSW_FMU_GUID "{UNKNOWN}"
#define FSW_FMU_TS {number(np.float64(controller.Ts))}
#define FSW_FMU_MEASURED {design.sizes["measured"]}
#define FSW_FMU_REFERENCE {reference}
#define FSW_FMU_CONSTANTS {len(constants)}
#define FSW_FMU_PRIMED {int(primed)} /* a state is known at the start */

static const double fsw_fmu_constant[] = {initialiser(constants)};
static const double fsw_fmu_level[] = {initialiser(levels)};
static const uint8_t fsw_fmu_line[] = {initialiser(line)}; /* under way at the start */
static const uint32_t fsw_fmu_wait[] = {initialiser(wait)};
{start}
#endif
"""
