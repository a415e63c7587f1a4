"""Command line. Exit code 0: done; 1: ran, but failed; 2: bad usage or bad input, one line on stderr.

A verb loads the wings that it uses when it runs, so that help comes at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from foreswitch.cli import exports, proofs, records, runs, starts, sweeps
from foreswitch.cli.output import complain

__all__ = ["app", "main"]

app = typer.Typer(
    name="foreswitch",
    help="Predictive control of actuators that can only switch and act after a dead time.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

#: Verbs in the order of the help, each with an example.
VERBS: dict[Callable[..., Any], str] = {
    starts.demo: "foreswitch demo --out demo",
    starts.init: "foreswitch init my_valve",
    records.identify: "foreswitch identify pulses.csv --time t --input u --output p --out tank",
    runs.simulate: "foreswitch simulate project.toml --reference reference.csv --out run",
    proofs.certify: "foreswitch certify project.toml --delay-error 0.0005 --gain-error 0.05 --out proof",
    runs.compare: "foreswitch compare project.toml --out compared",
    exports.export: "foreswitch export project.toml c build/firmware --real float32, "
    "or foreswitch export project.toml fmu build/controller.fmu",
    sweeps.study: 'foreswitch study project.toml --over "controller.Td=0.01,0.02" --over "gain_error=uniform(-0.1,0.1)" '
    "--repeats 100 --out study",
    starts.page: "foreswitch page project.toml",
}
for verb, example in VERBS.items():
    app.command(epilog=f"Example: {example}")(verb)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(version("foreswitch"))
        raise typer.Exit


@app.callback()
def options(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """What holds for every verb."""


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the ``foreswitch`` command; exits the process.

    Parameters
    ----------
    arguments : list of str, optional
        Default: the process's own.
    """
    given = sys.argv[1:] if arguments is None else arguments
    try:
        code = app(args=given or ["--help"], standalone_mode=False)
    except ValueError as error:
        sys.exit(complain(str(error)))
    except OSError as error:
        sys.exit(complain(f"{error.filename} cannot be used ({error.strerror}); give another path"))
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        # typer's own usage errors carry their exit code; anything else is a defect and shows its traceback
        if not hasattr(error, "format_message"):
            raise
        sys.exit(complain(error.format_message()))
    sys.exit(code if isinstance(code, int) else 0)
