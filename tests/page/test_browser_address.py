"""The tuning page's address: it holds all settings, for a reload and for others."""

import json

import pytest
from hypothesis import given, settings, strategies as st

from page import browser as browsers
from page.browser import DESK, wide_and_narrow


@wide_and_narrow
def test_the_address_keeps_everything_over_a_reload_and_for_others(visit, width):
    one = visit(width)
    page = one.go()
    one.set("controller.Td", 0.03)
    one.set("options.gain_error", 0.05)
    one.project()
    summary = page.locator("#summary").inner_text()
    page.reload()
    one.settled()
    assert page.locator("#summary").inner_text() == summary
    assert page.locator("#knob-controller-Td").input_value() == "0.03"
    other = visit(width)
    assert other.go("#" + page.url.split("#")[1]).locator("#summary").inner_text() == summary


@pytest.mark.parametrize("broken", ["#nonsense", "#AAAA", "#%%%", "#eyJ2IjoyfQ"])
def test_a_damaged_link_is_told_and_an_example_shown(visit, broken):
    page = visit().go(broken)
    assert "link is damaged" in page.locator("#notice").inner_text()


@pytest.mark.parametrize(
    "odd",
    [
        {"view": {"pins": 5}},
        {"view": {"pins": [None]}},
        {"view": {"pins": [{"name": "a", "project": {}}]}},
        {"view": {"step": -1}},
        {"options": 3},
    ],
)
def test_a_link_with_an_odd_view_is_told(visit, odd):
    one = visit()
    page = one.go()
    link = page.evaluate(
        "odd => fetch('/start.json').then(each => each.json()).then(start => import('/static/link.js')"
        ".then(link => link.encode({ v: 1, project: start.project, ...odd })))",
        odd,
    )
    assert "link is damaged" in visit().go(f"#{link}").locator("#notice").inner_text()


def test_settings_too_long_for_an_address_are_told(visit):
    one = visit()
    page = one.page
    page.add_init_script("window.btoa = () => 'A'.repeat(2_000_000)")
    one.go()
    one.set("controller.Td", 0.03)
    one.shows("#notice", "too long for an address")


def test_the_back_button_undoes_a_drag_as_one(visit):
    one = visit()
    page = one.go()
    one.set("controller.Td", 0.03)
    one.project()
    slider = page.locator("#knob-controller-lam-slider")
    slider.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    assert one.project()["controller"]["lam"] > 2500
    page.go_back()
    one.until("document.querySelector('#knob-controller-lam').value === '2500'")
    assert page.locator("#knob-controller-Td").input_value() == "0.03"
    page.go_back()
    one.until("document.querySelector('#knob-controller-Td').value === '0.02'")
    page.go_forward()
    one.until("document.querySelector('#knob-controller-Td').value === '0.03'")


def test_nothing_is_lost_when_the_server_starts_again(visit, server):
    _, end, again = server
    one = visit()
    page = one.go()
    end()
    page.locator("#notice").wait_for(state="visible")
    assert "Nothing is lost" in page.locator("#notice").inner_text()
    one.set("controller.Td", 0.04)  # meanwhile
    again()
    page.locator("#notice").wait_for(state="hidden")
    one.settled()
    one.until("!document.querySelector('#summary').textContent.includes('23.1 kPa')")
    one.wrong[:] = [each for each in one.wrong if "ERR_CONNECTION_REFUSED" not in each]  # browsers log each attempt


PLAIN = st.one_of(st.none(), st.booleans(), st.floats(allow_nan=False, allow_infinity=False), st.text())
TABLE = st.dictionaries(
    st.text(), st.one_of(PLAIN, st.lists(st.one_of(PLAIN, st.lists(PLAIN, max_size=3)), max_size=4))
)


@settings(max_examples=40)
@given(project=st.dictionaries(st.text(), TABLE, max_size=5))
def test_any_state_survives_its_link(bench, project):
    assert bench.evaluate(
        """async text => {
            const link = await import("/static/link.js");
            const state = JSON.parse(text);
            return JSON.stringify(await link.decode(await link.encode(state))) === JSON.stringify(state);
        }""",
        json.dumps({"v": 1, "project": project}),
    )


@settings(max_examples=40)
@given(value=st.floats(1e-9, 1e9), share=st.floats(0.0, 1.0), sign=st.sampled_from([-1.0, 1.0]))
def test_sliders_have_a_place_for_every_value_and_back(bench, value, share, sign):
    """To the three digits that a slider sets."""
    found = bench.evaluate(
        """async ([value, share]) => {
            const { decades, even, fromZero, roundUp } = await import("/static/scale.js");
            return [decades(value), fromZero(roundUp(Math.abs(value))), even(-Math.abs(value), Math.abs(value))].map(
                scale => [scale.share(value), scale.share(scale.value(share))]);
        }""",
        [sign * value, share],
    )
    (decades, decades_back), (_, zero_back), (even, even_back) = found
    assert decades + 1e-9 >= 0.33
    assert decades <= 0.67
    assert abs(decades_back - share) <= 0.002
    assert abs(zero_back**2 - share**2) <= 0.006 * max(share**2, 1e-6)
    assert 0 <= even <= 1
    assert abs(even_back - share) <= 0.003


@pytest.fixture(scope="module")
def bench(chromium, server):
    """One page for laws of its modules."""
    one = browsers.Visit(chromium, server[0], DESK)
    yield one.go()
    one.close()
