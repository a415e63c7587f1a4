"""Firmware that is exported once."""

import pytest

import foreswitch as fsw
from export.firmware.designs import design


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Folder of a design in one of the arithmetics; made once."""
    made = {}

    def export(name, real="float32"):
        if (name, real) not in made:
            made[name, real] = tmp_path_factory.mktemp("firmware") / "out"
            fsw.export_c(design(name, real), made[name, real])
        return made[name, real]

    return export
