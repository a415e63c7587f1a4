"""The tuning page for everyone: by keyboard, by ear, in every colour scheme and width, on paper."""

import numpy as np
import pytest

from page import browser as browsers
from page.browser import DESK, PHONE, pulses, wide_and_narrow

TABS = ["Tune", "Compare", "Identify", "Export"]


@wide_and_narrow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation(visit, width, scheme, tmp_path):
    from axe_playwright_python.sync_playwright import Axe

    one = visit(width, color_scheme=scheme, bypass_csp=True)  # axe puts itself into the page
    page = one.go()
    page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
    found = {}
    for name in TABS:
        one.tab(name)
        if name == "Identify":
            page.locator("#identify input[type=file]").set_input_files(pulses(tmp_path))
            page.get_by_role("button", name="Identify", exact=True).click()
            page.get_by_role("button", name="Use this model").wait_for(timeout=60_000)
        result = Axe().run(page)
        found[name] = [
            (each["id"], [node["html"][:120] for node in each["nodes"]]) for each in result.response["violations"]
        ]
    assert found == {name: [] for name in TABS}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_lines_stand_out_from_the_paper(visit, scheme):
    """3 : 1, as WCAG 1.4.11 has it for graphics."""
    page = visit(color_scheme=scheme).go()
    colours = page.evaluate("import('/static/colours.js').then(each => each.colours())")

    def brightness(colour):
        channels = np.array([float(part) for part in colour[colour.index("(") + 1 : -1].split(",")[:3]]) / 255.0
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    paper = brightness(colours["paper"])
    lines = [
        name for name in colours if name in ("output", "reference", "command", "landing") or name.startswith("other")
    ]
    assert len(lines) == 8
    for name in lines:
        low, high = sorted([paper, brightness(colours[name])])
        assert (high + 0.05) / (low + 0.05) >= 3.0, name


def test_tabs_move_by_arrow_keys(visit):
    page = visit().go()
    page.get_by_role("tab", name="Tune").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.textContent") == "Compare"
    assert page.locator("#compare").is_visible()
    page.keyboard.press("End")
    assert page.locator("#export").is_visible()


def test_all_can_be_reached_by_the_tab_key_and_focus_is_seen(visit):
    page = visit().go()
    page.locator("body").press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    seen = []
    for _ in range(40):
        page.keyboard.press("Tab")
        outline = page.evaluate(
            """(() => {
                const at = document.activeElement;
                const framed = [at, at.closest(".file")].filter(each => each);
                return [at.id, framed.some(each => getComputedStyle(each).outlineStyle !== "none")];
            })()"""
        )
        seen.append(outline)
    names = [name for name, _ in seen]
    assert {"presets", "open", "theme", "cursor", "tab-tune", "knob-controller-Td", "knob-controller-Td-slider"} <= set(
        names
    )
    assert [name for name, shown in seen if not shown] == []


def test_the_settings_are_reached_at_once_and_the_link_stays_whole(visit):
    one = visit()
    page = one.go()
    before = one.project()
    page.locator("body").press("Tab")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "panel"
    assert page.locator("#notice").is_hidden()
    assert one.project() == before


def test_a_run_is_spoken_when_a_setting_is_done(visit):
    one = visit()
    page = one.go()
    one.set("controller.Td", 0.05)
    one.shows("#spoken", "rms error")
    assert page.locator("#spoken").get_attribute("aria-live") == "polite"


@wide_and_narrow
def test_colours_are_switched_and_remembered(visit, width):
    one = visit(width, color_scheme="light")
    page = one.go()
    light = one.picture()
    button = page.locator("#theme")
    button.click()
    button.click()
    assert button.get_attribute("aria-label") == "Colours: dark"
    page.wait_for_timeout(200)
    assert one.picture() != light
    page.reload()
    one.settled()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 30)"


@pytest.mark.parametrize("width", [320, PHONE, 768, DESK, 2560])
def test_nothing_is_wider_than_the_window(visit, width):
    one = visit(width)
    page = one.go()
    excess = {}
    for name in TABS:
        one.tab(name)
        excess[name] = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert excess == dict.fromkeys(TABS, 0)


def test_paper_shows_the_picture_light_and_no_buttons(visit):
    one = visit(color_scheme="dark")
    page = one.go()
    page.emulate_media(media="print", color_scheme="dark")
    page.wait_for_timeout(300)
    assert page.locator("#charts canvas").first.is_visible()
    assert page.locator("[role=tablist]").is_hidden()
    assert page.evaluate("import('/static/colours.js').then(each => each.colours().paper)") == "rgb(255, 255, 255)"


def test_readers_who_want_no_motion_get_none(visit):
    page = visit(reduced_motion="reduce").go()
    moving = page.evaluate(
        """[...document.querySelectorAll("*")]
           .filter(each => parseFloat(getComputedStyle(each).transitionDuration) > 0).length"""
    )
    assert moving == 0


@pytest.mark.parametrize(("required", "outcome"), [("", pytest.skip.Exception), ("1", pytest.fail.Exception)])
def test_a_machine_without_a_browser_is_told_what_was_not_run(monkeypatch, required, outcome):
    monkeypatch.setenv("FORESWITCH_REQUIRE_TARGETS", required)
    monkeypatch.setattr(browsers, "CHROMIUM", None)
    with pytest.raises(outcome, match="the tuning page lacks chromium"):
        browsers.require()
