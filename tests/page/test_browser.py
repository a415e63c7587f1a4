"""The tuning page as its reader meets it, in Chromium, on a desk and on a phone."""

import io
import json
import re
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import foreswitch as fsw
from page import browser as browsers
from places import EXAMPLES as PROJECTS

HERE = Path(__file__).parent
STATIC = Path(fsw.__file__).parent / "page" / "static"
DESK, PHONE = 1400, 400
TABS = ["Tune", "Compare", "Identify", "Export"]
EXAMPLES = ["hot_gas", "chamber", "attitude", "oven", "inverter"]
#: From an event to the painted picture of 1000 steps [ms]: what is promised is 50 on a machine at rest.
GATE = 150.0


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


wide_and_narrow = pytest.mark.parametrize("width", [DESK, PHONE])


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


# Picture --------------------------------------------------------------------------------------------------------------


@wide_and_narrow
def test_the_first_paint_comes_within_a_second(visit, width):
    """The best of three: others may be at work on this machine."""
    painted = [
        visit(width).go().evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
        for _ in range(3)
    ]
    print(f"first paint: {painted} ms")
    assert min(painted) <= 1000.0


@wide_and_narrow
@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_is_drawn_and_told(visit, width, example):
    one = visit(width)
    page = one.go()
    if example != "hot_gas":
        one.preset(example)
    assert page.locator("#trouble").is_hidden()
    charts = page.locator("#charts canvas").count()
    assert charts == len(one.project()["plant"].get("C", [0])) + 1
    assert "rms error" in page.locator("#summary").inner_text()
    painted = page.evaluate(
        """[...document.querySelectorAll("#charts canvas")].map(each => {
            const { data } = each.getContext("2d").getImageData(0, 0, each.width, each.height);
            return new Set(new Uint32Array(data.buffer)).size;
        })"""
    )
    assert min(painted) > 5  # axes, grid, lines and their edges


def test_the_picture_follows_while_a_slider_is_dragged(visit, record_property):
    one = visit()
    page = one.go()
    one.set("simulation.duration", 1.0)  # 1000 steps
    one.settled()
    page.evaluate("performance.clearMeasures('slider to picture')")
    slider = page.locator("#knob-plant-k-slider")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 40, y)
    page.mouse.down()
    seen = set()
    for i in range(30):
        page.mouse.move(box["x"] + 40 + i, y)
        page.wait_for_timeout(60)
        if i % 10 == 9:
            seen.add(one.picture())
    assert len(seen) == 3  # before the button is let go
    page.mouse.up()
    page.wait_for_timeout(500)
    times = page.evaluate("performance.getEntriesByName('slider to picture').map(each => each.duration)")
    record_property("slider to picture, median [ms]", float(np.median(times)))
    print(f"slider to picture: {len(times)} of 30, median {np.median(times):.0f} ms, worst {max(times):.0f} ms")
    assert len(times) >= 15
    assert np.median(times) <= GATE


@wide_and_narrow
def test_the_picture_stays_in_sight_beside_the_last_knob(visit, width):
    one = visit(width)
    page = one.go()
    page.locator("#knob-reference-offset").scroll_into_view_if_needed()
    page.wait_for_timeout(200)
    box = page.locator("#charts").bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] <= page.viewport_size["height"]


@wide_and_narrow
def test_the_cursor_moves_by_keys_and_by_a_click_and_tells_what_was_thought(visit, width):
    one = visit(width)
    page = one.go()
    cursor = page.locator("#cursor")
    assert cursor.input_value() == "200"
    cursor.focus()
    page.keyboard.press("ArrowRight")
    one.shows("#costs caption", "0.201 s")
    assert cursor.get_attribute("aria-valuetext").startswith("0.201 s: pressure [kPa]")
    box = page.locator("#charts .u-over").first.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 10)
    one.until("Math.abs(document.querySelector('#cursor').value - 300) < 4")
    step = int(cursor.input_value())
    one.shows("#costs caption", f"{step / 1000:g} s")
    costs = page.locator("#costs tbody td:nth-of-type(2)").all_inner_texts()
    chosen = page.locator("#costs tbody tr:has-text('chosen') td:nth-of-type(2)").inner_text()
    assert float(chosen) == min(float(each) for each in costs)


def test_a_stretch_of_time_is_looked_at_closer_and_the_whole_again(visit):
    one = visit()
    page = one.go()
    whole = one.picture()
    assert page.locator("#whole").is_disabled()
    page.get_by_role("button", name="Look closer").click()
    page.wait_for_timeout(100)
    assert one.picture() != whole
    page.locator("#whole").click()
    page.wait_for_timeout(100)
    assert page.locator("#whole").is_disabled()


@wide_and_narrow
def test_the_band_is_called_old_until_the_new_proof_is_there(visit, width):
    one = visit(width)
    page = one.go()
    legend = page.locator("#legend")
    assert "proven band" in legend.inner_text()
    assert "before" not in legend.inner_text()
    page.evaluate(
        """(() => {
            const legend = document.querySelector("#legend");
            window.legends = [];
            new MutationObserver(() => window.legends.push(legend.textContent)).observe(legend, { childList: true });
        })()"""
    )
    one.set("controller.Td", 0.03)
    one.until("window.legends.some(each => each.includes('settings before'))")
    one.until("!document.querySelector('#legend').textContent.includes('before')")
    one.settled()
    assert "8." in page.locator("#proof").inner_text()


def test_a_proof_that_comes_before_its_run_waits_for_it(visit):
    one = visit()
    page = one.page
    page.add_init_script(
        """{
            const send = WebSocket.prototype.send; // each run is asked for later than its proof
            WebSocket.prototype.send = function (text) {
                if (window.late && JSON.parse(text).kind === "look") setTimeout(() => send.call(this, text), 2500);
                else send.call(this, text);
            };
        }"""
    )
    one.go()
    before = page.locator("#summary").inner_text()
    page.evaluate("window.late = true")
    one.set("controller.Td", 0.03)
    page.wait_for_timeout(2000)
    assert page.locator("#summary").inner_text() == before
    assert page.locator("#proof").inner_text() == "Looking for a proof …"
    assert "settings before" in page.locator("#legend").inner_text()
    one.until(f"document.querySelector('#summary').textContent !== {json.dumps(before)}")
    one.settled()


def test_what_was_thought_at_the_cursor_is_of_the_run_shown(visit):
    one = visit()
    page = one.go()
    one.set("controller.Td", 0.0001)
    page.locator("#trouble").wait_for(state="visible")
    page.locator("#cursor").focus()
    page.keyboard.press("ArrowRight")
    one.shows("#costs caption", "0.201 s")


def test_a_proof_of_the_model_alone_is_not_called_one_of_the_run(visit):
    one = visit()
    page = one.go()
    one.set("simulation.hardware.opening", 0.002)
    one.shows("#proof", "Proven for the model alone")
    one.shows("#legend", "of the model alone")
    assert "(model only)" in page.locator("#figures tbody td").last.inner_text()


def test_where_nothing_is_proven_a_sentence_says_why(visit):
    one = visit()
    page = one.go()
    page.locator("#knob-controller-objective").select_option("horizon")
    one.until("document.querySelector('#proof').textContent.startsWith('Not proven: ')")
    assert len(page.locator("#proof").inner_text()) > 30
    assert "proven band" not in page.locator("#legend").inner_text()


# Fields ---------------------------------------------------------------------------------------------------------------


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


# Beside others --------------------------------------------------------------------------------------------------------


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


# Record ---------------------------------------------------------------------------------------------------------------


@wide_and_narrow
def test_a_record_becomes_a_model_that_is_used(visit, width, tmp_path):
    one = visit(width)
    page = one.go()
    drop(page, {"pulses.csv": pulses(tmp_path).read_text()})
    page.get_by_role("button", name="Identify", exact=True).wait_for()
    assert page.get_by_role("tab", name="Identify").get_attribute("aria-selected") == "true"
    page.locator("#record-picture canvas").first.wait_for()
    assert page.locator("#record-picture canvas").count() == 2  # seen before anything is made of it
    page.locator("#structure").select_option("integrator+lag")
    page.get_by_role("button", name="Identify", exact=True).click()
    page.get_by_role("button", name="Use this model").wait_for(timeout=60_000)
    rows = dict(
        zip(
            page.locator("#found tbody th").all_inner_texts(),
            page.locator("#found tbody td:nth-of-type(1)").all_inner_texts(),
            strict=False,
        )
    )
    assert abs(float(rows["delay [s]"]) - 0.005) < 0.001
    assert page.locator("#record-picture canvas").count() == 3  # measured and fit, command, averaged pulse
    page.reload()
    one.tab("Identify")
    page.get_by_role("button", name="Use this model").click()
    one.settled()
    assert (
        abs(one.project()["plant"]["input_delay"] - 0.005) < 0.001
        or abs(one.project()["plant"]["input_delay"][0] - 0.005) < 0.001
    )
    assert page.locator("#trouble").is_hidden()


def test_a_record_that_is_none_gets_a_sentence(visit):
    one = visit()
    page = one.go()
    drop(page, {"holiday.csv": "no numbers\nat all\n"})
    page.locator("#record-complaint").wait_for(state="visible")
    assert len(page.locator("#record-complaint").inner_text()) > 20
    one.tab("Tune")
    assert page.locator("#charts canvas").count() == 2
    one.wrong[:] = [each for each in one.wrong if "422" not in each]  # browsers log each refusal


# Files ----------------------------------------------------------------------------------------------------------------


def saved(page, name):
    """Bytes of a file that the page hands over."""
    with page.expect_download(timeout=90_000) as download:
        page.get_by_role("button", name=f"Save {name}").click()
    assert download.value.suggested_filename == name
    return Path(download.value.path()).read_bytes()


@wide_and_narrow
def test_files_of_the_settings_are_saved(visit, width, tmp_path):
    one = visit(width)
    page = one.go()
    one.set("controller.Td", 0.025)
    one.tab("Export")
    project = tomllib.loads(saved(page, "project.toml").decode())
    assert project == one.project()
    assert b"<html" in saved(page, "report.html")
    names = zipfile.ZipFile(io.BytesIO(saved(page, "firmware.zip"))).namelist()
    assert any(name.endswith("foreswitch.c") for name in names)
    assert "modelDescription.xml" in zipfile.ZipFile(io.BytesIO(saved(page, "controller.fmu"))).namelist()


def test_a_saved_project_is_loaded_again_with_the_records_it_names(visit):
    one = visit()
    page = one.go()
    text = (PROJECTS / "oven" / "project.toml").read_text()
    programme = (PROJECTS / "oven" / "programme.csv").read_text()
    drop(page, {"programme.csv": programme, "project.toml": text})
    one.shows("#summary", "Oven")
    assert one.project()["reference"]["kind"] == "points"
    page.locator("#open").set_input_files(
        {
            "name": "project.toml",
            "mimeType": "text/plain",
            "buffer": (PROJECTS / "attitude" / "project.toml").read_bytes(),
        }
    )
    one.shows("#summary", "Attitude")


HOT_GAS = (PROJECTS / "hot_gas" / "project.toml").read_text()


@pytest.mark.parametrize(
    ("text", "word"), [("[plant\n", "TOML"), ("", "[plant]"), (HOT_GAS.replace("[actuator]", "[motor]"), "[actuator]")]
)
def test_a_file_that_is_no_project_gets_a_sentence_and_changes_nothing(visit, text, word):
    one = visit()
    page = one.go()
    before = page.locator("#summary").inner_text()
    drop(page, {"project.toml": text})
    page.locator("#notice").wait_for(state="visible")
    assert word in page.locator("#notice").inner_text()
    assert page.locator("#summary").inner_text() == before
    one.wrong[:] = [each for each in one.wrong if "422" not in each]


def test_a_project_too_large_for_the_server_is_told_and_the_connection_stays(visit):
    one = visit()
    page = one.go()
    before = page.locator("#summary").inner_text()
    one.set("simulation.x0", "[" + ", ".join(["0.123456789012345"] * 70_000) + "]")
    page.locator("#trouble").wait_for(state="visible")
    assert "1024 KiB" in page.locator("#trouble").inner_text()
    page.wait_for_timeout(1000)
    assert page.locator("#notice").is_hidden()
    assert page.locator("#summary").inner_text() == before
    one.set("simulation.x0", "")
    page.locator("#trouble").wait_for(state="hidden")


def test_a_mistake_in_a_project_is_told_beside_its_field(visit):
    one = visit()
    page = one.go()
    before = page.locator("#summary").inner_text()
    drop(page, {"project.toml": HOT_GAS.replace('"integrator_lag"', '"cow"', 1)})
    complaint = page.locator("[data-path='plant.model'] .complaint")
    complaint.wait_for(state="visible")
    assert "cow" in complaint.inner_text()
    assert page.locator("#summary").inner_text() == before


# Address --------------------------------------------------------------------------------------------------------------


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


@pytest.fixture(scope="module")
def bench(chromium, server):
    """One page for laws of its modules."""
    one = browsers.Visit(chromium, server[0], DESK)
    yield one.go()
    one.close()


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


# For everyone ---------------------------------------------------------------------------------------------------------


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


# Source ---------------------------------------------------------------------------------------------------------------


modules = pytest.mark.parametrize("module", sorted(path.name for path in STATIC.glob("*.js")))
#: What a module's functions could change between them; the formatter begins these in the first column.
SHARED = re.compile(
    r"^(export )?((let|var)\b|const \w+ = (\[\]|\{\}|new (Array|Map|Object|Set|Weak\w+)\b))", re.MULTILINE
)


@modules
def test_modules_are_small_and_say_what_they_are_about(module):
    lines = (STATIC / module).read_text().splitlines()
    assert lines[0].startswith("// ")
    assert len(lines) <= 250
    assert [line for line in lines if len(line) > 120] == []  # the formatter leaves comments and texts as they are


@modules
def test_modules_share_nothing_that_changes(module):
    """What changes is in the store, or within a function that makes what needs it."""
    assert [found.group() for found in SHARED.finditer((STATIC / module).read_text())] == []


@pytest.mark.parametrize(
    "line", ["let run = null;", "export let run;", "var a = 1;", "const held = new Map();", "const all = [];"]
)
def test_what_modules_must_not_share_is_found(line):
    assert SHARED.search(f"// About it.\n\n{line}\n")
    assert not SHARED.search(f"function made() {{\n  {line}\n}}\n")


def test_each_part_of_the_store_has_one_owner(visit):
    """Taken twice, unknown, or another's: each is refused; what was read before stays."""
    assert visit().go().evaluate(
        """async () => {
            const { store } = await import("/static/store.js");
            const { now, own } = store({});
            const change = own("refused", "proof");
            const before = now();
            change({ refused: "key" });
            const tries = [() => own("proof"), () => own("none"), () => change({ notices: {} })];
            const said = tries.map((attempt) => { try { attempt(); return ""; } catch (error) { return error.message; } });
            return [before.refused, Object.isFrozen(now()), now().refused, ...said];
        }"""
    ) == [
        "",
        True,
        "key",
        "“proof” has an owner already",
        "the store has no part “none”",
        "“notices” is changed by its owner alone",
    ]


def test_the_page_names_nothing_outside_itself():
    for path in STATIC.iterdir():
        if path.suffix in (".html", ".css", ".js"):
            assert "http://" not in path.read_text().replace("http://www.w3.org/", ""), path
            assert "https://" not in path.read_text(), path
    markup = (STATIC / "index.html").read_text()
    assert "style=" not in markup
    assert "onclick" not in markup


def test_the_vendored_library_has_its_licence_and_version():
    text = (STATIC / "uplot" / "uPlot.iife.min.js").read_text()
    version = text.split("(v", 1)[1].split(")", 1)[0]
    assert f"uPlot {version}" in (STATIC / "uplot" / "SOURCE").read_text()
    assert "Leon Sorokin" in (STATIC / "uplot" / "LICENSE").read_text()
