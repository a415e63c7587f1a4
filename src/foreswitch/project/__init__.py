"""What does this file ask for?

In: one TOML file. Out: a `Project`, that is plant, controller, reference and simulation ready to run, or the first mistake
with its key.

Rooms, in the order of the data: `tables` (declared keys), `mistakes` (their misfits, in the words of the file), `project`.
"""

from foreswitch.project.project import Project

__all__ = ["Project"]
