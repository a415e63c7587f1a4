"""C sources on a target: compiled, run, and counted there.

A program talks to port.h alone; what it reads and writes are bytes here. Nothing is installed: a target whose tools are
not all there says which it lacks.
"""

import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
#: As firmware is compiled; without the first, a Cortex-M4F fuses products and sums.
FLAGS = ["-ffp-contract=off", "-std=c99", "-ffunction-sections", "-fdata-sections"]
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"]
SECONDS = 300
VERSION = r"[0-9]+[.][0-9]+[.][0-9]+"


class TargetError(Exception):
    """What the compiler or the program said."""


@dataclass(frozen=True)
class Result:
    """What a program wrote, and of a counted function what each call took.

    calls: instructions, or on AVR cycles; stack: on AVR the deepest of each call, in bytes; functions: instructions of
    the whole program by function, on Arm.
    """

    output: bytes
    calls: list[int] = field(default_factory=list)
    stack: list[int] = field(default_factory=list)
    functions: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Image:
    """A program for a target."""

    target: "Target"
    path: Path

    def run(self, data: bytes = b"", count: str = "", caller: str = "one_step") -> Result:
        """What it makes of the data; count: a function whose calls are counted, called from the other one only."""
        return self.target.runner(self, data, count, caller)

    def tool(self, name: str, *arguments: str) -> str:
        """What the target's nm, size or objdump says of it."""
        return spoken([f"{self.target.tools}{name}", *arguments, str(self.path)])

    def symbols(self) -> dict[str, tuple[int, int]]:
        """Address and size by name."""
        lines = (line.split() for line in self.tool("nm", "-S").splitlines())
        return {words[3]: (int(words[0], 16), int(words[1], 16)) for words in lines if len(words) == 4}


@dataclass(frozen=True)
class Target:
    """How sources become a program, and how that runs."""

    name: str
    compiler: str
    flags: tuple[str, ...]
    port: str
    runner: Callable[[Image, bytes, str, str], Result]
    needs: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    tools: str = ""
    reals: tuple[str, ...] = ("float64", "float32")

    def missing(self) -> list[str]:
        """What the machine lacks for it."""
        return [need for need in (self.compiler, *self.needs) if not there(need)]

    def version(self) -> str:
        """The compiler's, as a count is valid for one alone."""
        text = spoken([self.compiler, "--version"]).splitlines()[0]
        return f"{self.compiler} {re.search(VERSION, text)[0]}"

    def build(self, path: Path, sources: Sequence[Path], *flags: str, level: str = "-O2") -> Image:
        """Compile and link, warnings being errors; object and .su files stay beside the program."""
        objects = []
        usage = [] if self.compiler == "clang" else ["-fstack-usage"]
        for source in (*sources, HERE / self.port):
            target = path.with_name(f"{path.name}-{source.stem}.o")
            given = [*self.flags, *FLAGS, *WARNINGS, *usage, level, f"-I{HERE}", *flags]
            spoken([self.compiler, *given, "-c", str(source), "-o", str(target)])
            objects.append(str(target))
        spoken([self.compiler, *self.flags, level, *objects, "-o", str(path), "-Wl,--gc-sections", *self.links])
        return Image(self, path)


def spoken(command: Sequence[str], **options: object) -> str:
    """Output of a command that must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, **options)
    if done.returncode:
        raise TargetError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


@cache
def there(need: str) -> bool:
    """Whether a program, or COMPILER:HEADER, or python:PACKAGE is installed."""
    kind, _, name = need.rpartition(":")
    if kind == "python":
        return find_spec(name) is not None
    if not kind:
        return shutil.which(name) is not None
    command = [kind, "-E", "-x", "c", "-"]
    return (
        there(kind)
        and subprocess.run(command, input=f"#include <{name}>".encode(), capture_output=True).returncode == 0
    )


def finished(command: Sequence[object], image: Image, data: bytes, where: Path) -> "subprocess.CompletedProcess[bytes]":
    """A run that ended with 0."""
    done = subprocess.run([*map(str, command)], input=data, capture_output=True, timeout=SECONDS, cwd=where)
    if done.returncode:
        text = done.stderr.decode(errors="replace")[-2000:]
        raise TargetError(f"{image.path.name} on {image.target.name} ended with {done.returncode}\n{text}")
    return done


# Runners --------------------------------------------------------------------------------------------------------------


def on_host(image: Image, data: bytes, count: str, caller: str) -> Result:
    return Result(finished([image.path], image, data, image.path.parent).stdout)


def tool_of(image: Image, name: str, source: str, *flags: str) -> Path:
    """A program of ours for the host, beside the image; compiled once."""
    path = image.path.parent / name
    if not path.exists():
        spoken(["gcc", "-O2", "-Wall", "-Wextra", "-Werror", "-o", str(path), str(HERE / source), *flags])
    return path


def in_qemu(machine: str) -> Callable[[Image, bytes, str, str], Result]:
    """Input and output are files, through semihosting."""

    def run(image: Image, data: bytes, count: str, caller: str) -> Result:
        where = image.path.parent / f"{image.path.name}-run"
        where.mkdir(exist_ok=True)
        (where / "input").write_bytes(data)
        command = ["qemu-system-arm", "-M", machine, "-display", "none", "-monitor", "none", "-serial", "none",
                   "-semihosting-config", "enable=on,target=native", "-kernel", image.path]  # fmt: skip
        symbols = {}
        if count:
            symbols = image.symbols()
            plugin = tool_of(image, "count.so", "arm/count.c", "-shared", "-fPIC")
            begin, size = next(value for name, value in symbols.items() if name.split(".")[0] == caller)
            begin &= ~1  # Thumb
            command += ["-plugin", f"{plugin},entry={symbols[count][0] & ~1},from={begin},to={begin + size},out=counts"]
        finished(command, image, b"", where)
        output = (where / "output").read_bytes()
        return Result(output, *counted((where / "counts").read_text(), symbols)) if count else Result(output)

    return run


def counted(text: str, symbols: dict[str, tuple[int, int]]) -> tuple[list[int], list[int], dict[str, int]]:
    """Counts of each call, and of each function."""
    lines = [[int(word) for word in line.split()] for line in text.splitlines()]
    hits = {line[0]: line[1] for line in lines if len(line) == 2}
    functions = {
        name: sum(hits.get(at, 0) for at in range(begin & ~1, (begin & ~1) + size, 2))
        for name, (begin, size) in symbols.items()
        if size and begin < 1 << 20
    }
    return [line[0] for line in lines if len(line) == 1], [], {name: n for name, n in functions.items() if n}


def in_simavr(machine: str) -> Callable[[Image, bytes, str, str], Result]:
    def run(image: Image, data: bytes, count: str, caller: str) -> Result:
        simulator = tool_of(image, "simulate", "avr/simulate.c", "-lsimavr", "-lelf")
        entry = [hex(image.symbols()[count][0])] if count else []
        done = finished([simulator, machine, image.path, *entry], image, data, image.path.parent)
        lines = [line.split() for line in done.stderr.decode().splitlines() if re.fullmatch(r"\d+ \d+", line)]
        return Result(done.stdout, [int(line[0]) for line in lines], [int(line[1]) for line in lines])

    return run


def in_wasmtime(image: Image, data: bytes, count: str, caller: str) -> Result:
    from wasmtime import Func, FuncType, Instance, Module, Store, ValType

    store, given, output = Store(), memoryview(data), bytearray()
    place = [0]

    def read(at: int, size: int) -> None:
        if place[0] + size > len(given):
            raise TargetError(f"{image.path.name} reads beyond its input")
        memory.write(store, given[place[0] : place[0] + size], at)
        place[0] += size

    def write(at: int, size: int) -> None:
        output.extend(memory.read(store, at, at + size))

    two = FuncType([ValType.i32(), ValType.i32()], [])
    module = Module.from_file(store.engine, str(image.path))
    doors = {"port_read": read, "port_write": write}
    instance = Instance(store, module, [Func(store, two, doors[one.name]) for one in module.imports])
    exports = instance.exports(store)
    memory = exports["memory"]
    if exports["run"](store) != 0:
        raise TargetError(f"{image.path.name} failed")
    return Result(bytes(output))


# Targets --------------------------------------------------------------------------------------------------------------


def arm(name: str, machine: str, script: str, *flags: str) -> Target:
    links = ("-nostartfiles", "--specs=nano.specs", "-lm", f"-L{HERE / 'arm'}", f"-T{HERE / 'arm' / script}")
    needs = ("arm-none-eabi-gcc:newlib.h", "qemu-system-arm", "gcc")
    return Target(name, "arm-none-eabi-gcc", ("-mthumb", *flags), "arm/port.c", in_qemu(machine), needs, links,
                  "arm-none-eabi-")  # fmt: skip


def avr(name: str) -> Target:
    """Its double has 32 bits."""
    needs = ("avr-gcc:avr/io.h", "gcc:simavr/sim_avr.h", "gcc:libelf.h")
    return Target(
        name, "avr-gcc", (f"-mmcu={name}",), "avr/port.c", in_simavr(name), needs, ("-lm",), "avr-", ("float32",)
    )


WASM = ("--target=wasm32", "-nostdlib", "-fno-builtin", f"-I{HERE / 'wasm/include'}")
TARGETS = {
    target.name: target
    for target in (
        Target("x86-64-gcc", "gcc", (), "host/port.c", on_host),
        Target("x86-64-clang", "clang", (), "host/port.c", on_host),
        arm("cortex-m4f", "mps2-an386", "mps2.ld", "-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        arm("cortex-m3", "mps2-an385", "mps2.ld", "-mcpu=cortex-m3"),
        arm("cortex-m0", "microbit", "microbit.ld", "-mcpu=cortex-m0"),
        avr("atmega328p"),
        avr("atmega1284p"),
        Target("wasm32", "clang", WASM, "wasm/port.c", in_wasmtime, ("wasm-ld", "python:wasmtime"),
               ("-Wl,--no-entry", "-Wl,--allow-undefined")),
    )
}  # fmt: skip
