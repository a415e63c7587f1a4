"""Servers and browsers that several files of tests share."""

import pytest

from page import browser as browsers
from page.browser import DESK
from page.serving import served


@pytest.fixture(scope="session")
def chromium():
    browsers.require()
    with browsers.browsing() as browser:
        yield browser


@pytest.fixture(scope="session")
def server(chromium):
    with browsers.serving() as (address, end, again):
        yield address, end, again


@pytest.fixture
def visit(chromium, server):
    """Opens pages; what went wrong on them fails the test."""
    visits = []

    def one(width=DESK, **context):
        visits.append(browsers.Visit(chromium, server[0], width, **context))
        return visits[-1]

    yield one
    for each in visits:
        each.close()


@pytest.fixture(scope="module")
def page():
    with served() as found:
        yield found
