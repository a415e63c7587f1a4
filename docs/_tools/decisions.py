"""Which law when: where each is enough, with the figures that show it."""

from __future__ import annotations

import re
from pathlib import Path

from foreswitch.presentation.report import number

ROOT = Path(__file__).resolve().parents[2]

#: Rows of the tables in the examples' texts (a test holds those against the scripts): example, label, column.
PRINTED = {
    "thermostat_swing": ("oven", "thermostat", 1), "thermostat_rate": ("oven", "thermostat", 2),
    "oven_swing": ("oven", "rest tail, Td = 60 s", 1), "oven_rate": ("oven", "rest tail, Td = 60 s", 2),
    "weak_law": ("oven", "rest tail, weak heater", 3), "weak_pi": ("oven", "PI + PWM, weak heater", 3),
    "relay_gas": ("attitude", "relay, 40 ms", 3), "law_gas_40": ("attitude", "price 1, 40 ms", 3),
    "relay_gas_150": ("attitude", "relay", 3), "law_gas_150": ("attitude", "price 1", 3),
    "raw_law": ("attitude", "price 1, 40 ms, raw sensors", 3),
    "raw_relay": ("attitude", "relay, 40 ms, raw sensors", 3), "comparators": ("inverter", "comparators, 2.5 A", 0),
    "carrier": ("inverter", "carrier PWM", 0), "inverter_4": ("inverter", "predictive, price 4", 0),
    "clocked_relay": ("inverter", "relay, 0 A", 0),
}  # fmt: skip


def printed() -> dict[str, str]:
    """Numbers that the examples' texts show."""
    values = {}
    for key, (example, label, column) in PRINTED.items():
        text = (ROOT / "examples" / example / "README.md").read_text(encoding="utf-8")
        row = re.search(rf"^{re.escape(label)}  +(.+)$", text, flags=re.MULTILINE)
        if row is None:
            raise ValueError(f"examples/{example}/README.md has no row {label!r}")
        values[key] = row[1].split()[column]
    return values


def hold(number: dict[str, float]) -> None:
    """What the rows say, lest the figures say something else one day."""
    assert number["hot_gas_pi_rms"] < number["hot_gas_law_rms"] > number["hot_gas_smith_rms"]
    assert number["hot_gas_ahead_rms"] < min(number[f"hot_gas_{law}_rms"] for law in ("pi", "smith", "relay"))
    assert number["oven_law_rms"] < min(number["oven_smith_rms"], number["oven_pi_rms"])
    assert max(number["attitude_relay_rms"], number["attitude_smith_rms"]) > number["attitude_law_rms"]
    assert 2.0 * number["attitude_law_on"] < min(number["attitude_relay_on"], number["attitude_smith_on"])
    assert number["chamber_law_rms"] < number["chamber_smith_rms"] < number["chamber_pi_rms"]
    assert number["chamber_law_on"] < number["chamber_smith_on"] < number["chamber_relay_on"]
    assert number["inverter_law_rms"] < 0.7 * min(number[f"inverter_{law}_rms"] for law in ("pi", "smith", "relay"))
    assert number["relay_gas"] < number["law_gas_40"]
    assert number["relay_gas_150"] > 5.0 * number["law_gas_150"]
    assert number["carrier"] < number["inverter_4"] < number["comparators"] < 1.2 * number["inverter_4"]
    assert number["raw_relay"] < 0.1 * number["raw_law"]
    assert abs(number["weak_pi"] - 105.0) < abs(number["weak_law"] - 105.0)


RELAY, PI, LAW = "a **relay** is enough", "**PI + PWM** is enough", "**prediction** pays"
HEADS = ["", "where", "shown by"]
ROWS = [
    (RELAY, "a swing of the error is allowed, and switchings are what costs",
     "oven: the thermostat swings by {thermostat_swing} °C and switches {thermostat_rate} times an hour; the "
     "predictive law {oven_swing} °C and {oven_rate} times"),
    (RELAY, "the dead time is short against the swing that is allowed",
     "attitude, 40 ms: {relay_gas} g/h of propellant against {law_gas_40} g/h"),
    (RELAY, "comparators switch at once, without clock and dead time",
     "inverter: {comparators} % distortion against {inverter_4} % at about as many switchings; on the clock, one "
     "period late, {clocked_relay} %"),
    (RELAY, "the state is noisy and nothing filters it; the relay's dead band does",
     "attitude, raw sensors: {raw_relay} g/h against {raw_law} g/h"),
    (PI, "the reference is not known ahead, the task is, and PI can be tuned on it",
     "hot gas: {hot_gas_pi_rms} kPa, behind a Smith predictor {hot_gas_smith_rms} kPa, against {hot_gas_law_rms} "
     "kPa without preview"),
    (PI, "the gain is uncertain and the mean must be right: it integrates, the predictive law does not",
     "oven, heater 10 % weak: {weak_pi} °C in the mean against {weak_law} °C, wanted 105"),
    (PI, "steady state is all that counts",
     "inverter: carrier PWM {carrier} % distortion against {inverter_4} % at as many switchings"),
    ("a **Smith predictor** + PWM is nearly enough", "one loop, preview, a good model, dwell shorter than the carrier",
     "oven: {oven_smith_rms} against {oven_law_rms} °C; chamber: {chamber_smith_rms} against {chamber_law_rms} kPa, "
     "valves open for {chamber_smith_on} against {chamber_law_on} % of the time"),
    (LAW, "the reference is known ahead",
     "hot gas: {hot_gas_ahead_rms} kPa, nothing tuned; [Baselines](baselines.md) has the others with the same preview"),
    (LAW, "each switching or each second of opening costs, and the dead time is long",
     "attitude, 150 ms: {law_gas_150} g/h against the relay's {relay_gas_150}; on for {attitude_law_on} % of the time, "
     "relay {attitude_relay_on} %, Smith predictor {attitude_smith_on} %, at an error that is no larger"),
    (LAW, "opposed actuators must not work against each other",
     "chamber: on for {chamber_law_on} % of the time, PI + PWM {chamber_pi_on} %, relays {chamber_relay_on} %; rms "
     "error {chamber_law_rms}, {chamber_pi_rms} and {chamber_relay_rms} kPa"),
    (LAW, "several inputs act on several outputs at once",
     "inverter: {inverter_law_rms} A against {inverter_relay_rms} A (relays), {inverter_pi_rms} A (PI + PWM) and "
     "{inverter_smith_rms} A (Smith predictor)"),
]  # fmt: skip


def decision_rows(values: dict[str, float]) -> list[list[str]]:
    """Where each law is enough, with the figures that show it: those of the comparisons, and what the examples print."""
    texts = {key: number(value) for key, value in values.items()} | printed()
    hold({key: float(text) for key, text in texts.items()})
    return [[which, when, shown.format_map(texts)] for which, when, shown in ROWS]
