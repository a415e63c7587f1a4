"""The tuning page in a real Chromium: a server and a browser of one's own, and pages that notice all that goes wrong."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

import foreswitch as fsw

#: Said by every test that skips for want of something; conftest.py gathers them.
ABSENT = "target not here"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
#: What is waited for at most [ms]: machines of four builds at once are slow.
PATIENCE = 20_000
DESK, PHONE = 1400, 400
wide_and_narrow = pytest.mark.parametrize("width", [DESK, PHONE])


def require():
    """A skip where the browser is lacking, or where it is required a failure."""
    tools = {
        "chromium": CHROMIUM,
        "playwright": find_spec("playwright"),
        "axe-playwright-python": find_spec("axe_playwright_python"),
    }
    lacking = [name for name, found in tools.items() if not found]
    if lacking:
        text = f"{ABSENT}: the tuning page lacks {', '.join(lacking)}"
        if os.environ.get("FORESWITCH_REQUIRE_TARGETS"):
            pytest.fail(text)
        pytest.skip(text)


def free_port():
    """One that nobody listens at now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def start(port):
    """A server process, once it listens."""
    command = [Path(sys.executable).parent / "foreswitch", "page", "--no-open", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    line = process.stdout.readline()
    assert re.search(rf"http://127\.0\.0\.1:{port}/", line), line
    return process


def stop(process):
    """Ends it as Ctrl-C does."""
    process.send_signal(signal.SIGINT)
    process.wait(timeout=20)
    process.stdout.close()


@contextmanager
def serving():
    """Address of a server, and the means to end and start it again."""
    port = free_port()
    running = [start(port)]

    def again():
        running[:] = [start(port)]

    try:
        yield f"http://127.0.0.1:{port}/", lambda: stop(running[0]), again
    finally:
        if running[0].poll() is None:
            stop(running[0])


@contextmanager
def browsing():
    """A browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """A page, with what it complained of and asked of others.

    Parameters
    ----------
    browser, address
        Of the test session.
    width : int
        Of the window.
    **context
        As Playwright's, such as ``color_scheme``.
    """

    def __init__(self, browser, address, width, **context):
        self.address, self.wrong, self.width = address, [], width
        size = {"width": width, "height": 860 if width < 600 else 900}
        self.context = browser.new_context(viewport=size, accept_downloads=True, **context)
        self.context.set_default_timeout(PATIENCE)
        self.context.route("**/*", self._only_here)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self._said(message))
        self.page.on("pageerror", lambda error: self.wrong.append(f"exception: {error}"))

    def _only_here(self, route):
        if route.request.url.startswith(self.address):
            route.continue_()
        else:
            self.wrong.append(f"asked {route.request.url}")
            route.abort()

    def _said(self, message):
        if message.type in ("error", "warning"):
            self.wrong.append(f"{message.type}: {message.text}")

    def go(self, hash_=""):
        """Opens the page and waits for its picture."""
        self.page.goto(self.address + hash_)
        self.settled()
        return self.page

    def settled(self):
        """Waits until run, proof and costs are there."""
        self.until("/^(Proven|Not proven)/.test(document.querySelector('#proof').textContent)")
        self.until("document.querySelector('#costs td') !== null")

    def until(self, condition):
        """Waits until an expression holds; Playwright's own way needs a policy that lets strings be run."""
        end = time.monotonic() + PATIENCE / 1e3
        while not self.page.evaluate(f"Boolean({condition})"):
            assert time.monotonic() < end, f"never: {condition}; {self.wrong}"
            assert not any(each.startswith("exception:") for each in self.wrong), self.wrong
            self.page.wait_for_timeout(30)

    def shows(self, selector, text):
        """Waits until an element holds a text."""
        self.until(f"document.querySelector({json.dumps(selector)})?.textContent.includes({json.dumps(text)})")

    def tab(self, name):
        """Opens a tab."""
        self.page.get_by_role("tab", name=name).click()

    def preset(self, name):
        """Takes an example."""
        before = self.page.locator("#summary").inner_text()
        self.page.locator("#presets").select_option(name)
        self.until(f"document.querySelector('#summary').textContent !== {json.dumps(before)}")

    def set(self, path, value):
        """Types into a field, as its reader does."""
        field = self.page.locator(f"#knob-{path.replace('.', '-')}")
        field.evaluate(
            "each => { for (let up = each; up; up = up.parentElement) if (up.tagName === 'DETAILS') up.open = true }"
        )
        field.fill(str(value))
        field.blur()

    def picture(self):
        """What the canvases show, as a number of its own for each picture."""
        return self.page.evaluate(
            "[...document.querySelectorAll('#charts canvas')].map(each => each.toDataURL()).join()"
        )

    def project(self):
        """The tables that the page has now, from its address."""
        self.page.wait_for_timeout(300)  # addresses are written with a pause
        return self.page.evaluate("import('/static/link.js').then(link => link.decode(location.hash.slice(1)))")[
            "project"
        ]

    def close(self):
        """Ends the visit; nothing may have gone wrong."""
        self.context.close()
        assert self.wrong == []


def pulses(folder, name="pulses.csv"):
    """A record of the hot gas."""
    valve = fsw.Plant.integrator_lag(16500.0, 0.006, 0.005, output_names="pressure [kPa]")
    record = fsw.PulseTest(Ts=1e-3, width=2e-3, spacing=0.06, number=10, lead=0.05).rehearse(valve, noise=1.0)
    record.to_csv(folder / name)
    return folder / name


def drop(page, files):
    """Drops files, name to text, onto the page."""
    page.evaluate(
        """files => {
            const carried = new DataTransfer();
            for (const [name, text] of Object.entries(files)) carried.items.add(new File([text], name));
            for (const kind of ["dragover", "drop"])
                document.body.dispatchEvent(new DragEvent(kind, { dataTransfer: carried, bubbles: true, cancelable: true }));
        }""",
        files,
    )
