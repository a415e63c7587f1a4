"""The command ``foreswitch``: each verb reads files, asks one wing, prints or writes what it answers."""

from foreswitch.cli.app import main

__all__ = ["main"]
