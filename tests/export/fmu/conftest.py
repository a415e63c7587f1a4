"""FMUs that are written once, and instances that are closed at the end."""

import pytest

import foreswitch as fsw
from systems import quiet


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Path of a design's FMU, written once."""
    from export.fmu.instances import CASES  # not above: where fmpy is lacking, tests are skipped

    folder, made = tmp_path_factory.mktemp("fmus"), {}

    def path(name, real="float64"):
        if (name, real) not in made:
            made[name, real] = folder / f"{len(made)}.fmu"
            fsw.export_fmu(quiet(CASES[name][0], real), made[name, real])
        return made[name, real]

    return path


@pytest.fixture
def opened():
    """Instances that are closed at the end."""
    from export.fmu.instances import Fmu

    found = []

    def build(*arguments, **options):
        found.append(Fmu(*arguments, **options))
        return found[-1]

    yield build
    for each in found:
        each.close()
