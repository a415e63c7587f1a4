"""A C compiler for the tests that need one, and how the core is compiled in them."""

import os
import shutil
import subprocess
import sysconfig
from pathlib import Path

STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off"]


def compilers():
    """Those that are there, the one Python was built with or CC names first."""
    named = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    found = {shutil.which(name) for name in (named, "gcc", "clang")} - {None}
    return sorted(found, key=lambda path: (Path(path).name != Path(named).name, path))


COMPILERS = compilers()


def compiled(*arguments, compiler=None):
    """Whether the compiler takes it, and what it says."""
    done = subprocess.run([compiler or COMPILERS[0], *map(str, arguments)], capture_output=True, text=True)
    return done.returncode == 0, done.stderr
