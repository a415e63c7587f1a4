"""A controller as an FMU for co-simulation: the core, a fixed shell, the design, and what describes them."""

from __future__ import annotations

import hashlib
import io
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import numpy as np

from foreswitch._binding import REALS
from foreswitch._helpers.files import write_whole
from foreswitch._helpers.mistake import Mistake
from foreswitch.control.controller import Controller
from foreswitch.control.design import Design
from foreswitch.export.firmware import CORE, HORIZON, SHELL, check_export, filled, headline
from foreswitch.export.fmu_description import UNKNOWN, constants, described, listed_variables
from foreswitch.export.header import exported, initialiser, limits_text, number, tables_text

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
        If the name is not a C identifier, the path cannot be written, or there is no compiler for this machine.

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
    ['modelDescription.xml', 'sources/LICENSE', 'sources/arithmetic.h']
    """
    check_export(controller, name)
    target = Path(path)
    if target.suffix != ".fmu" or target.is_dir():
        raise Mistake("path", str(path), "give a file that ends in .fmu")
    sources, variables = _sources(controller, name), listed_variables(controller)
    description = described(controller, name, variables, sorted(f for f in sources if f.endswith(".c")))
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
        problem = f"{path} cannot be written ({error.strerror})"
        raise Mistake("path", path, "give another", problem=problem) from None


def _guid(parts: Sequence[str]) -> str:
    """An identifier made of all that the FMU consists of, so that equal ones bear the same."""
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
        problem = f"is True, but FMI 2.0 has no name for {sys.platform} on {machine}"
        raise Mistake("binary", True, "give binary=False (--source-only)", problem=problem)
    return found


def _compiler() -> list[str]:
    """What CC names, else the first that is there."""
    named = os.environ.get("CC", "").strip()
    choices = [shlex.split(named)] if named else [[each] for each in COMPILERS]
    for command in choices:
        if shutil.which(command[0]):
            return command
    wanted = named or ", ".join(COMPILERS)
    problem = f"is True, but no C compiler is found ({wanted})"
    raise Mistake("binary", True, "install one, or give binary=False (--source-only)", problem=problem)


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
            problem = f"is True, but {shlex.join(compiler)} fails ({said})"
            remedy = "set CC to another compiler, or give binary=False (--source-only)"
            raise Mistake("binary", True, remedy, problem=problem)
        return (Path(folder) / f"library{suffix}").read_bytes()


# Sources --------------------------------------------------------------------------------------------------------------


def _sources(controller: Controller, name: str) -> dict[str, str]:
    """By name; core and shell are the library's own."""
    own, design = files("foreswitch.export"), exported(controller.design)
    core = [*CORE, *(HORIZON if design.horizon is not None else []), *SHELL, "LICENSE"]
    sources = {file: own.joinpath("c", file).read_bytes().decode("utf-8") for file in core}
    template, _, _ = own.joinpath("templates", "foreswitch_design.h").read_text("utf-8").partition("#ifdef FSW_STEPS")
    words = {"name": name, "title": headline(controller, name), "version": version("foreswitch")}
    words |= {"limits": limits_text(design, name), "tables": tables_text(design, name)}
    sources["foreswitch_design.h"] = filled(template, words) + "#endif\n"
    sources["foreswitch_fmu.h"] = _header(controller, design)
    return sources


def _header(controller: Controller, design: Design) -> str:
    real, plant = REALS[controller.real], controller.plant
    reference = controller.evaluations * plant.outputs * controller.order
    values = [np.float64(value) for _, value, _, _ in constants(controller)]
    levels = np.concatenate(controller.levels).astype(np.float64)
    memory, start = controller.memory, ""
    primed = memory.x is not None and memory.w is not None
    if memory.x is not None and memory.w is not None:
        start = (
            f"static const fsw_real fsw_fmu_x[] = {initialiser(memory.x.astype(real))};\n"
            f"static const fsw_real fsw_fmu_w[] = {initialiser(memory.w.astype(real))};\n"
        )
    return f"""/* What fmi.c asks for besides the design. Made by foreswitch {version("foreswitch")}; do not edit. */
#ifndef FORESWITCH_FMU_H
#define FORESWITCH_FMU_H

#define FSW_FMU_GUID "{UNKNOWN}"
#define FSW_FMU_TS {number(np.float64(controller.Ts))}
#define FSW_FMU_MEASURED {design.measured}
#define FSW_FMU_REFERENCE {reference}
#define FSW_FMU_CONSTANTS {len(values)}
#define FSW_FMU_PRIMED {int(primed)} /* a state is known at the start */

static const double fsw_fmu_constant[] = {initialiser(values)};
static const double fsw_fmu_level[] = {initialiser(levels)};
static const uint8_t fsw_fmu_line[] = {initialiser(memory.line.ravel())}; /* under way at the start */
static const uint32_t fsw_fmu_wait[] = {initialiser(memory.wait)};
{start}
#endif
"""
