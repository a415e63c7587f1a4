"""Bad measurements: the prediction stands in for them, then the safe level."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch import Status
from systems import RISE, VALVE, valve_controller

BAD = [[np.nan, 0.0], [0.0, np.inf], [-np.inf, np.nan], [1e300, 0.0]]


@pytest.mark.parametrize("plant", [VALVE, VALVE.replace(input_delay=0.0), VALVE.replace(input_delay=0.0053)])
@pytest.mark.parametrize("bad", BAD)
def test_the_prediction_stands_in_for_bad_measurements(plant, bad):
    """The model being exact, coasting through bad samples changes no command."""
    controller = valve_controller(plant)
    run = fsw.simulate(controller, RISE, 0.3)
    told = RISE(run.t, controller.order)
    for k in range(300):
        good = k < 80 or k % 7 == 0
        u = controller.step(run.x[k] if good else bad, told[k])
        assert controller.status == (Status.OK if good else Status.COASTING)
        assert u == run.u[k]


def test_the_last_good_disturbance_stands_in_for_a_bad_one():
    plant = VALVE.replace(E=[[-1.0], [0.0]])
    seeing, blind = valve_controller(plant), valve_controller(plant)
    for k in range(40):
        expected = seeing.step([20.0, 30.0], 60.0, disturbance=[700.0])
        u = blind.step([20.0, 30.0], 60.0, disturbance=[700.0 if k == 0 else np.nan])
        assert blind.status == (Status.COASTING if k else Status.OK)
        assert u == expected


def test_before_any_good_measurement_the_command_is_held():
    controller = valve_controller()
    controller.reset(pending=[0, 0, 0, 0, 1])
    for _ in range(30):
        assert controller.step([np.nan, 0.0], 0.0) == [1.0]
        assert controller.status == Status.HELD
    controller.step([0.0, 0.0], 0.0)
    assert controller.status == Status.OK
    controller.step([np.nan, 0.0], 0.0)
    assert controller.status == Status.COASTING
    controller.reset()
    controller.step([np.nan, 0.0], 0.0)
    assert controller.status == Status.HELD


@pytest.mark.parametrize("safe", [0.0, 1.0])
def test_after_bad_limit_samples_comes_the_safe_level(safe):
    controller = valve_controller(safe_level=safe, bad_limit=4)
    expected = [(Status.OK, 10.0)] + [(Status.COASTING, np.nan)] * 3 + [(Status.SAFE, np.nan)] * 3
    for status, value in [*expected, (Status.OK, 10.0), (Status.COASTING, np.nan)]:
        u = controller.step([value, 0.0], 1000.0 * (1.0 - safe))  # the wish: the other level
        assert controller.status == status
        assert u == [safe if status == Status.SAFE else 1.0 - safe]


def test_without_a_declared_safe_level_a_controller_coasts_on():
    controller = valve_controller(bad_limit=4)
    controller.step([0.0, 0.0], 1e6)
    for _ in range(50):
        assert controller.step([np.nan, 0.0], 1e6) == [1.0]
        assert controller.status == Status.COASTING


def test_a_bad_first_measurement_counts_towards_the_limit():
    controller = valve_controller(safe_level=0.0, bad_limit=3)
    statuses = []
    for _ in range(4):
        controller.step([np.nan, np.nan], 1000.0)
        statuses.append(controller.status)
    assert statuses == [Status.HELD, Status.HELD, Status.SAFE, Status.SAFE]


@pytest.mark.parametrize("real", ["float64", "float32"])
def test_a_finite_reference_beyond_the_arithmetic_holds_the_command(real):
    controller = valve_controller(real=real)
    assert controller.step([0.0, 0.0], 1000.0) == [1.0]
    assert controller.decide([0.0, 0.0], 1e300).status == Status.HELD
    assert controller.step([0.0, 0.0], 1e300) == [1.0]
    assert controller.status == Status.HELD


def test_every_status_has_a_remedy():
    for status in Status:
        assert status.remedy.endswith(".")
        assert "\n" not in status.remedy
