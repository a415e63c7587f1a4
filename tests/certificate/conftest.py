"""A certificate without the search for a remedy."""

import pytest


@pytest.fixture
def no_remedy(monkeypatch):
    """Without the search for settings that would hold, which is slow."""
    monkeypatch.setattr("foreswitch.certificate.reasons._remedy", lambda *_: "")
