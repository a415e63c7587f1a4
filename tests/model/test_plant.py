"""Plants mean what they say: states, frequency responses, names, and other libraries' systems."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import signal

import control
import foreswitch as fsw
from systems import TWO_BY_TWO

S = 1j * np.logspace(-2, 2, 30)  # rad/s


def response(plant, s=S):
    """G(s) from u to y with its dead times, shape (frequencies, q, m)."""
    n = plant.states
    return np.array(
        [plant.C @ np.linalg.solve(z * np.eye(n) - plant.A, plant.B) * np.exp(-z * plant.input_delay) for z in s]
    )


coefficient = st.floats(0.1, 10.0)


@given(st.lists(coefficient, min_size=2, max_size=6), coefficient)
def test_without_zeros_the_states_are_y_and_its_derivatives(den, gain):
    plant = fsw.Plant.from_tf([gain], den)
    row = plant.C[0]
    for i in range(plant.states):
        assert row == pytest.approx(np.eye(plant.states)[i], abs=0)
        row = row @ plant.A
    derivatives = plant.A[:-1], plant.B[:-1]  # x_i' = x_(i+1), untouched by u
    assert np.array_equal(np.hstack(derivatives), np.eye(plant.states)[1:] @ np.eye(plant.states, plant.states + 1))


@given(st.lists(coefficient, min_size=1, max_size=4), st.lists(coefficient, min_size=5, max_size=6), st.floats(0, 1))
def test_from_tf_has_the_frequency_response_of_its_polynomials(num, den, delay):
    plant = fsw.Plant.from_tf(num, den, input_delay=delay)
    expected = np.polyval(num, S) / np.polyval(den, S) * np.exp(-S * delay)
    assert response(plant)[:, 0, 0] == pytest.approx(expected, rel=1e-8)


def test_leading_zero_coefficients_do_not_raise_the_order():
    assert fsw.Plant.from_tf([0.0, 0.0, 2.0], [0.0, 1.0, 3.0]).states == 1


def test_named_structures_have_their_formulas_responses():
    first = 3.0 * np.exp(-0.2 * S) / (5.0 * S + 1.0)
    second = 3.0 * np.exp(-0.2 * S) / (S * (5.0 * S + 1.0))
    assert response(fsw.Plant.fopdt(K=3.0, T=5.0, L=0.2))[:, 0, 0] == pytest.approx(first, rel=1e-12)
    assert response(fsw.Plant.integrator_lag(k=3.0, c=5.0, L=0.2))[:, 0, 0] == pytest.approx(second, rel=1e-12)
    lag = fsw.Plant.integrator_lag(k=3.0, c=5.0, L=0.2)
    assert np.array_equal(lag.C, [[1.0, 0.0]])
    assert np.array_equal(lag.A[0], [0.0, 1.0])  # states y, y'


# Other libraries ------------------------------------------------------------------------------------------------------


def test_control_state_space_makes_the_round_trip():
    plant = TWO_BY_TWO.replace(input_names=["fuel [V]", "air [V]"], output_names=["T [K]", "p [Pa]"])
    back = fsw.Plant.from_control(plant.to_control(), input_delay=plant.input_delay)
    for name in ("A", "B", "C", "input_delay"):
        assert np.array_equal(getattr(back, name), getattr(plant, name))
    assert (back.input_names, back.output_names) == (plant.input_names, plant.output_names)


def test_names_that_control_made_up_are_not_taken_over():
    plant = fsw.Plant.from_control(control.rss(2, 2, 2, strictly_proper=True))
    assert (plant.input_names, plant.output_names) == (("u1", "u2"), ("y1", "y2"))


NUM = [[[1.0], [2.0, 1.0], [0.0]], [[0.5], [3.0], [1.0, 0.2, 4.0]]]
DEN = [[[1.0, 1.0], [1.0, 2.0, 3.0], [1.0]], [[4.0, 0.0], [1.0, 1.0], [1.0, 2.0, 3.0, 4.0]]]
SISO = ([2.0, 1.0], [1.0, 3.0, 5.0])
SYSTEMS = {
    "control tf": control.tf(*SISO),
    "control tf 2x3": control.tf(NUM, DEN),
    "control ss": control.tf2ss(*SISO),
    "scipy tf": signal.TransferFunction(*SISO),
    "scipy zpk": signal.ZerosPolesGain([-0.5], [-1.0, -2.0], 2.0),
    "scipy ss": signal.StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.5, 1.0]], [[0.0], [0.0]]),
    "scipy lti": signal.lti(*SISO),
    "scipy tf 2x1": signal.TransferFunction([[2.0, 1.0], [0.0, 4.0]], [1.0, 3.0, 5.0]),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_from_control_keeps_the_frequency_response(name):
    system = SYSTEMS[name]
    if name.startswith("control"):
        expected = np.array([np.atleast_2d(system(s)) for s in S])
    elif name == "scipy tf 2x1":
        expected = np.array([[np.polyval(row, S)] for row in system.num]).transpose(2, 0, 1)
        expected = expected / np.polyval(system.den, S)[:, None, None]
    elif name == "scipy ss":
        expected = np.array([system.C @ np.linalg.solve(s * np.eye(2) - system.A, system.B) for s in S])
    else:
        expected = signal.freqresp(system, S.imag)[1][:, None, None]
    plant = fsw.Plant.from_control(system, input_delay=0.3)
    assert response(plant) == pytest.approx(expected * np.exp(-0.3 * S)[:, None, None], rel=1e-9, abs=1e-12)


def test_from_tf_and_from_control_agree_on_the_states():
    given = fsw.Plant.from_control(control.tf([3.0], [2.0, 1.0, 4.0]), input_delay=0.1)
    direct = fsw.Plant.from_tf([3.0], [2.0, 1.0, 4.0], input_delay=0.1)
    assert np.array_equal(given.A, direct.A)
    assert np.array_equal(given.B, direct.B)


# The object -----------------------------------------------------------------------------------------------------------


def test_vectors_fill_in_for_matrices_of_one_column_or_row():
    plant = fsw.Plant([[0, 1], [0, 0]], [0, 1], [1, 0], E=[1, 0])
    assert (plant.B.shape, plant.C.shape, plant.E.shape) == ((2, 1), (1, 2), (2, 1))
    assert (plant.states, plant.inputs, plant.outputs, plant.disturbances) == (2, 1, 1, 1)


def test_replace_changes_only_what_is_named():
    other = TWO_BY_TWO.replace(input_delay=0.1, y_offset=[3.0, 4.0])
    assert np.array_equal(other.input_delay, [0.1, 0.1])
    assert np.array_equal(other.y_offset, [3.0, 4.0])
    assert np.array_equal(other.A, TWO_BY_TWO.A)
    assert np.array_equal(TWO_BY_TWO.input_delay, [0.37, 0.15])


def test_poles_come_slowest_first():
    assert fsw.Plant.from_tf([1.0], np.poly([-5.0, -0.1, -1.0])).poles == pytest.approx([-0.1, -1.0, -5.0])


def test_a_plant_keeps_its_own_numbers():
    A = np.array([[-1.0]])
    plant = fsw.Plant(A, [[1.0]])
    A[0, 0] = 7.0
    assert plant.A[0, 0] == -1.0
    for own in (plant.A, plant.B, plant.C, plant.E, plant.input_delay, plant.u_offset, plant.y_offset):
        with pytest.raises(ValueError, match="read-only"):
            own[...] = 7.0


def test_repr_shows_the_operating_point_and_the_disturbance():
    plant = fsw.Plant([[-1.0]], [[1.0]], E=[[1.0]], u_offset=0.4, y_offset=20.0, input_names="heat [kW]")
    assert repr(plant).splitlines() == [
        "Plant",
        "├─ states        1, poles -1",
        "├─ input heat [kW] dead time 0 s, about 0.4",
        "├─ disturbances  1, measured",
        "└─ output y, about 20",
    ]
