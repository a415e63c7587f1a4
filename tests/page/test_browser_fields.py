"""The tuning page's fields: units, help, and mistakes told beside them."""

import json

import pytest

from page.browser import wide_and_narrow


@wide_and_narrow
def test_slider_and_number_say_the_same(visit, width):
    one = visit(width)
    page = one.go()
    number, slider = page.locator("#knob-plant-c"), page.locator("#knob-plant-c-slider")
    slider.focus()
    before = float(number.input_value())
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    after = float(number.input_value())
    assert before < after < 1.1 * before
    assert slider.get_attribute("aria-valuetext") == f"{after:g} s"
    one.set("plant.c", 0.5)  # beyond the slider's range, which follows
    assert slider.get_attribute("aria-valuetext") == "0.5 s"
    assert 0 < int(slider.input_value()) < 1000
    assert one.project()["plant"]["c"] == 0.5


def test_units_stand_beside_their_fields(visit):
    page = visit().go()
    units = {
        name: page.locator(f"[data-path='{name}'] .unit").inner_text()
        for name in ("plant.k", "actuator.Ts", "reference.height")
    }
    assert units == {"plant.k": "kPa/s", "actuator.Ts": "s", "reference.height": "kPa"}


def test_a_field_in_focus_is_explained(visit):
    page = visit().go()
    page.locator("#knob-controller-Td").focus()
    assert "settling horizon" in page.locator("#help").inner_text()
    assert "settling horizon" in page.locator("#knob-controller-Td-help").inner_text() or page.locator(
        "#knob-controller-Td-help"
    ).evaluate("each => each.textContent.includes('settling horizon')")


@pytest.mark.parametrize("model", ["fopdt", "transfer_function", "state_space"])
def test_another_form_of_plant_brings_its_own_fields(visit, model):
    one = visit()
    page = one.go()
    page.locator("#knob-plant-model").select_option(model)
    shown = {"fopdt": "plant.T", "transfer_function": "plant.den.1", "state_space": "plant.A"}[model]
    page.wait_for_selector(f"[data-path='{shown}']")
    one.settled()
    assert page.locator("#trouble").is_hidden()
    assert one.project()["plant"]["model"] == model
    if model != "fopdt":  # the same plant in other words, and so the same run
        assert "122 switches" in page.locator("#summary").inner_text()


def test_every_kind_of_reference_can_be_chosen(visit):
    one = visit()
    page = one.go()
    for kind in ("constant", "sine", "ramp", "steps", "points", "half_sine"):
        before = page.locator("#summary").inner_text()
        page.locator("#knob-reference-kind").select_option(kind)
        one.until(f"document.querySelector('#summary').textContent !== {json.dumps(before)}")
        assert page.locator("#trouble").is_hidden(), kind
        assert one.project()["reference"]["kind"] == kind


def test_a_reference_taken_seconds_ahead_has_a_field_of_its_own(visit):
    one = visit()
    page = one.go()
    page.locator("#knob-controller-preview").select_option("seconds")
    one.set("controller.preview.seconds", 0.005)
    assert one.project()["controller"]["preview"] == 0.005
    one.settled()
    assert page.locator("#trouble").is_hidden()
    page.reload()
    one.settled()
    assert page.locator("#knob-controller-preview").input_value() == "seconds"
    assert page.locator("#knob-controller-preview-seconds").input_value() == "0.005"


def test_several_inputs_have_a_dead_time_each(visit):
    one = visit()
    one.go()
    one.preset("inverter")
    one.set("plant.input_delay.1", 6e-5)
    assert one.project()["plant"]["input_delay"] == [5e-5, 6e-5, 5e-5]


@wide_and_narrow
@pytest.mark.parametrize(
    ("path", "value", "word"), [("controller.Td", 0.0001, "Td"), ("actuator.Ts", -1, "Ts"), ("plant.c", 0, "c")]
)
def test_a_mistake_is_told_beside_its_field_and_the_picture_stays(visit, width, path, value, word):
    one = visit(width)
    page = one.go()
    before = page.locator("#summary").inner_text()
    field = page.locator(f"#knob-{path.replace('.', '-')}")
    right = field.input_value()
    one.set(path, value)
    complaint = page.locator(f"[data-path='{path}'] .complaint")
    complaint.wait_for(state="visible")
    assert word in complaint.inner_text()
    assert field.get_attribute("aria-invalid") == "true"
    assert complaint.get_attribute("id") in field.get_attribute("aria-describedby")
    assert page.locator("#summary").inner_text() == before
    assert "last settings that worked" in page.locator("#trouble").inner_text()
    one.set(path, right)
    complaint.wait_for(state="hidden")
    assert field.get_attribute("aria-invalid") is None


def test_an_empty_number_and_a_list_that_is_none_are_told_at_once(visit):
    one = visit()
    page = one.go()
    one.set("controller.lam", "")
    assert page.locator("[data-path='controller.lam'] .complaint").inner_text() == "Bandwidth is empty; give a number"
    one.set("actuator.levels", "0, one")
    assert "give numbers" in page.locator("[data-path='actuator.levels'] .complaint").inner_text()
    assert one.page.locator("#trouble").is_hidden()


def test_a_number_below_one_can_be_typed_into_an_entry_of_a_matrix(visit):
    one = visit()
    page = one.go()
    page.locator("#knob-plant-model").select_option("state_space")
    entry = page.locator("[data-path^='plant.B.'] input[type=number]").first
    entry.evaluate("each => (each.closest('details').open = true)")
    entry.fill("")
    entry.press_sequentially("0.5")
    assert entry.input_value() == "0.5"
    entry.blur()
    assert 0.5 in [value for row in one.project()["plant"]["B"] for value in (row if isinstance(row, list) else [row])]


def test_going_back_writes_the_field_in_focus_and_ends_its_complaint(visit):
    one = visit()
    page = one.go()
    one.project()
    one.set("controller.Td", 0.03)
    one.project()
    field = page.locator("#knob-controller-Td")
    field.focus()
    field.fill("")
    complaint = page.locator("[data-path='controller.Td'] .complaint")
    assert complaint.is_visible()
    page.go_back()
    one.until("document.querySelector('#knob-controller-Td').value === '0.02'")
    assert complaint.is_hidden()


def test_what_the_model_does_not_know_is_simulated_and_proven(visit):
    one = visit()
    page = one.go()
    before = page.locator("#proof").inner_text()
    one.set("options.gain_error", 0.1)
    one.set("options.delay_error", 0.0005)
    one.until(
        f"![{json.dumps(before)}, 'Looking for a proof …'].includes(document.querySelector('#proof').textContent)"
    )
    assert page.locator("#figures tbody td").last.inner_text() not in ("8.7 kPa", "…")
