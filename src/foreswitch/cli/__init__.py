"""The command ``foreswitch``: each verb reads files, asks one wing, prints or writes what it answers.

Rooms: `options` (what verbs share), `output` (what they print); the verbs, `starts` (demo, init, page), `records`
(identify), `runs` (simulate, compare), `proofs` (certify), `exports` (export), `sweeps` (study); `app` (all of them, and
the exit code).
"""

from foreswitch.cli.app import main

__all__ = ["main"]
