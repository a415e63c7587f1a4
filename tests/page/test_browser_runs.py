"""The tuning page's runs beside each other, and simple laws beside them."""

from page.browser import wide_and_narrow


@wide_and_narrow
def test_runs_are_pinned_drawn_beside_used_and_removed(visit, width):
    one = visit(width)
    page = one.go()
    one.tab("Compare")
    page.locator("#pin-name").fill("as it was")
    page.keyboard.press("Enter")
    one.tab("Tune")
    one.set("controller.Td", 0.04)
    row = page.locator("#figures tr:has-text('as it was')")
    row.wait_for()
    one.until("[...document.querySelectorAll('#figures tr')].some(each => /as it was.*8.7 kPa/.test(each.textContent))")
    assert "as it was" in page.locator("#legend").inner_text()
    one.tab("Compare")
    page.get_by_role("button", name="Set everything as in as it was").click()
    assert one.project()["controller"]["Td"] == 0.02
    page.get_by_role("button", name="Remove as it was").click()
    row.wait_for(state="detached")
    assert "as it was" not in page.locator("#legend").inner_text()


def test_the_focus_stays_among_the_runs_when_one_is_removed(visit):
    one = visit()
    page = one.go()
    one.tab("Compare")
    for name in ("a", "b"):
        page.locator("#pin-name").fill(name)
        page.keyboard.press("Enter")
    for name, after in (("a", "Remove b"), ("b", None)):
        page.get_by_role("button", name=f"Remove {name}").focus()
        page.keyboard.press("Enter")
        page.get_by_role("button", name=f"Remove {name}").wait_for(state="detached")
        assert page.evaluate("document.activeElement.getAttribute('aria-label')") == after
    assert page.evaluate("document.activeElement.id") == "pin-name"


def test_simple_laws_of_settings_before_are_marked(visit):
    one = visit()
    page = one.go()
    one.tab("Compare")
    page.locator("#baseline-relay").check()
    one.shows("#baseline-relay-about", "hysteresis")
    one.tab("Tune")
    one.set("plant.k", 15000)
    one.shows("#legend", "being tuned")
    one.until("!document.querySelector('#legend').textContent.includes('being tuned')")


@wide_and_narrow
def test_simple_laws_are_one_click_away(visit, width):
    one = visit(width)
    page = one.go()
    one.tab("Compare")
    for which, name in (
        ("relay", "relay with hysteresis"),
        ("pi_pwm", "PI with pulse"),
        ("smith_pwm", "Smith predictor"),
    ):
        page.locator(f"#baseline-{which}").check()
        page.locator(f"#figures tr:has-text('{name}')").wait_for(timeout=60_000)
    assert page.locator("#figures tbody tr").count() == 4
    assert "kPa, lead" in page.locator("#baseline-relay-about").inner_text()
    page.locator("#baseline-relay").uncheck()
    page.locator("#figures tr:has-text('relay')").wait_for(state="detached")
