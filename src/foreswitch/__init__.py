"""Predictive control of actuators that can only switch and act after a dead time.

The public names and where they live stand in ``__init__.pyi``. A wing is loaded when the first of its names is used.
"""

import warnings
from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_RENAMED = {"Candidate": "FittedStructure"}


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        warnings.warn(
            f"foreswitch.{name} is now called {_RENAMED[name]}; use that name", DeprecationWarning, stacklevel=2
        )
        name = _RENAMED[name]
    return _load(name)
