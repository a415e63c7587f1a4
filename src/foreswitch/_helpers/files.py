"""Files and folders written whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from foreswitch._helpers.mistake import Mistake

__all__ = ["whole_file", "whole_folder", "write_whole"]


def _mode(base: int) -> int:
    """Permissions a plainly created file would have."""
    umask = os.umask(0)
    os.umask(umask)
    return base & ~umask


@contextmanager
def whole_file(path: str | Path) -> Iterator[BinaryIO]:
    """A temporary neighbour to write to, renamed into place when the block ends well, and gone when it does not."""
    target = Path(path)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.chmod(name, _mode(0o666))
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write to a temporary neighbour, then rename it into place."""
    with whole_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A temporary folder whose files move to ``path`` when the block ends well, and vanish when it does not.

    Files of the same name are replaced, others are left alone.

    Raises
    ------
    ValueError
        If the folder cannot be made, or a file cannot take its place there.
    """
    target = Path(path).resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not target.is_dir():
            raise FileExistsError(17, "it is a file")
        work = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        problem = f"cannot be written ({error.strerror})"
        raise Mistake("path", path, "give another folder", problem=problem, subject=str(path)) from None
    try:
        yield work
        if not target.exists():
            os.chmod(work, _mode(0o777))
            os.replace(work, target)
        else:
            files = {path: target / path.relative_to(work) for path in sorted(work.rglob("*")) if path.is_file()}
            _judge(files.values(), target)
            for file, place in files.items():
                place.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, place)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _judge(places: Iterable[Path], target: Path) -> None:
    """Whether each file can take its place, before the first does."""
    for place in places:
        hurdle = next((up for up in place.parents if up.exists() and not up.is_dir()), None)
        if place.is_dir() or hurdle is not None:
            kind = "folder" if hurdle is None else "file"
            problem = f"cannot be written ({hurdle or place} is a {kind})"
            raise Mistake("path", target, "give another folder", problem=problem, subject=str(target))
