"""Records and projects dropped on the tuning page, and the files that it saves."""

import io
import tomllib
import zipfile
from pathlib import Path

import pytest

from page.browser import drop, pulses, wide_and_narrow
from places import EXAMPLES as PROJECTS

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
