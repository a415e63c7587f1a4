"""The scripts that reproduce the paper's claims: each runs, holds, and prints its figure."""

import runpy

import pytest

from places import DOCS

CLAIMS = sorted((DOCS / "theory" / "claims").glob("*.py"))


@pytest.mark.parametrize("script", CLAIMS, ids=lambda script: script.stem)
def test_a_claim_is_reproduced(script, capsys):
    names = runpy.run_path(str(script), run_name="__main__")
    assert names["KIND"] in ("confirmed", "corrected", "completed")
    assert capsys.readouterr().out.strip() == names["check"]()


def test_each_kind_is_there():
    kinds = {runpy.run_path(str(script))["KIND"] for script in CLAIMS}
    assert kinds == {"confirmed", "corrected", "completed"}
