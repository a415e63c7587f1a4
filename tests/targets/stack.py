"""The most stack a function can take: frames as the compiler tells them, summed over the calls in the program's code."""

import re
from collections.abc import Iterator

from targets.harness import Image

#: Bytes that a call itself leaves on the stack; avr-gcc counts them among its frames.
RETURN_ADDRESS = {"avr-gcc": 2, "arm-none-eabi-gcc": 0}
CALL = re.compile(
    r"\t(?:bl|blx|b|b[a-z]{2}|b\.[nw]|b[a-z]{2}\.[nw]|call|rcall|jmp|rjmp|br[a-z]{2}|cbn?z)\b.*<([^>+]+)>"
)
INDIRECT = re.compile(r"\t(?:blx\s+r|icall|eicall|ijmp|eijmp|bx\s+r)")


def frames(image: Image) -> dict[str, int]:
    """Stack of the functions that were compiled here, bytes; a frame of unknown size is an error."""
    found: dict[str, int] = {}
    for file in image.path.parent.glob(f"{image.path.name}-*.su"):
        for line in file.read_text().splitlines():
            place, size, kind = line.split("\t")
            assert "static" in kind, f"{place} takes stack without a bound"
            name = re.sub(r"\.\d+", "", place.rpartition(":")[2])  # which copy of a function it is, it seldom tells
            found[name] = max(found.get(name, 0), int(size))
    return found


def functions(image: Image) -> Iterator[tuple[str, str]]:
    """Name and code of each function of the program."""
    for part in re.split(r"\n(?=[0-9a-f]+ <)", image.tool("objdump", "-d", "--no-show-raw-insn")):
        if match := re.match(r"[0-9a-f]+ <([^>]+)>:\n", part):
            yield match[1], part[match.end() :]


def pushed(code: str) -> int:
    """Bytes that a library's function, written in assembler or compiled elsewhere, keeps on the stack at most."""
    size = len(re.findall(r"\tpush\s+r\d+", code))  # AVR
    for names in re.findall(r"\t(?:push|stmdb\s+sp!,)\s*\{([^}]+)\}", code):
        size += 4 * sum(int(b or a) - int(a) + 1 for a, b in re.findall(r"r(\d+)(?:-r(\d+))?", names))
        size += 4 * len(re.findall(r"\b(?:lr|ip|fp|sl|pc)\b", names))
    return size + sum(int(number) for number in re.findall(r"\tsub(?:\.w)?\s+sp,(?:\s*sp,)?\s*#(\d+)", code))


def deepest(image: Image, name: str) -> tuple[int, list[str]]:
    """Bytes with its return address, and the chain of calls that takes them; recursion or a call through a pointer fails."""
    known, code = frames(image), dict(functions(image))
    address = RETURN_ADDRESS[image.target.compiler]
    done: dict[str, tuple[int, list[str]]] = {}

    def visit(name: str, path: tuple[str, ...]) -> tuple[int, list[str]]:
        assert name not in path, f"recursion: {' -> '.join((*path, name))}"
        if name not in done:
            text = code[name]
            assert path == () or not INDIRECT.search(text.replace("bx\tlr", "")), f"{name} calls through a pointer"
            plain = re.sub(r"\.\d+", "", name)
            assert plain in known or "." not in plain, f"{name} is in no .su file"
            own = known.get(plain, pushed(text) + address)
            called = {other for other in CALL.findall(text) if other != name and other in code}
            below = max((visit(other, (*path, name)) for other in called), default=(0, []))
            done[name] = own + below[0], [name, *below[1]]
        return done[name]

    return visit(name, ())
