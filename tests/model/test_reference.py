"""References: values, derivatives, what holds at their ends, and the shapes they come in."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.model.reference import sample

RNG = np.random.default_rng(5)
KNOTS = np.cumsum(RNG.uniform(0.2, 0.6, 12))
VALUES = RNG.standard_normal(12)
REFERENCES = {
    "sine": fsw.Sine(amplitude=3.0, frequency=0.7, offset=1.0, phase=0.4),
    "half sine": fsw.HalfSine(height=-2.0, duration=3.0, start=1.0, offset=5.0),
    "ramp": fsw.Ramp(slope=2.0, start=1.0, offset=-1.0),
    "steps": fsw.Steps([1.0, 2.0, 3.0], [4.0, -1.0, 2.0]),
    "pchip": fsw.Samples(KNOTS, VALUES),
    "linear": fsw.Samples(KNOTS, VALUES, kind="linear"),
    "hold": fsw.Samples(KNOTS, VALUES, kind="hold"),
}
KINKS = {"half sine": [1.0, 4.0], "ramp": [1.0], "steps": [1.0, 2.0, 3.0]}
KINKS |= dict.fromkeys(("pchip", "linear", "hold"), KNOTS)


@pytest.mark.parametrize("name", REFERENCES)
def test_derivatives_are_those_of_the_values(name):
    """Each against central differences of the one below, away from the kinks."""
    reference, step = REFERENCES[name], 1e-5
    t = np.linspace(-1.0, 8.0, 400)
    t = t[np.all(np.abs(t[:, None] - KINKS.get(name, [99.0])) > 2 * step, axis=1)]
    values = reference(t, order=4)
    slopes = (reference(t + step, order=4) - reference(t - step, order=4)) / (2 * step)
    assert values.shape == (t.size, 1, 4)
    assert values[:, :, 1:] == pytest.approx(slopes[:, :, :-1], abs=1e-6 * max(1.0, np.abs(values).max()))


def test_sine_values():
    t = np.linspace(0.0, 3.0, 50)
    expected = 1.0 + 3.0 * np.sin(2 * np.pi * 0.7 * t + 0.4)
    assert REFERENCES["sine"](t)[:, 0, 0] == pytest.approx(expected)


def test_half_sine_is_held_before_and_after_and_joins_smoothly():
    reference = fsw.HalfSine(height=1000.0, duration=0.5, start=0.1, offset=20.0)
    t = np.array([-1.0, 0.1, 0.35, 0.6, 9.0])
    value, slope = reference(t, order=2)[:, 0].T
    assert value == pytest.approx([20.0, 20.0, 520.0, 1020.0, 1020.0])
    assert slope == pytest.approx([0.0, 0.0, 1000.0 * np.pi, 0.0, 0.0], abs=1e-9)
    inside = np.linspace(0.0, 0.5, 40)
    assert reference(0.1 + inside)[:, 0, 0] == pytest.approx(20.0 + 500.0 * (1.0 - np.cos(2 * np.pi * inside)))


def test_steps_take_each_value_from_its_time_on():
    t = np.array([-5.0, 0.999, 1.0, 1.999, 2.0, 3.0, 3.5, 4.0, 99.0])
    assert REFERENCES["steps"](t)[:, 0, 0].tolist() == [4.0, 4.0, 4.0, 4.0, -1.0, 2.0, 2.0, 2.0, 2.0]


@pytest.mark.parametrize("kind", ["pchip", "linear", "hold"])
def test_samples_pass_through_their_points_and_are_held_outside(kind):
    reference = REFERENCES[kind]
    assert reference(KNOTS)[:, 0, 0] == pytest.approx(VALUES)
    outside = reference([KNOTS[0] - 3.0, KNOTS[-1], KNOTS[-1] + 3.0])[:, 0]
    assert outside[:, 0] == pytest.approx([VALUES[0], VALUES[-1], VALUES[-1]])
    assert not outside[:, 1:].any()


def test_samples_between_their_points():
    middle = 0.5 * (KNOTS[1:] + KNOTS[:-1])
    linear, hold = (REFERENCES[kind](middle)[:, 0, 0] for kind in ("linear", "hold"))
    assert linear == pytest.approx(0.5 * (VALUES[1:] + VALUES[:-1]))
    assert hold == pytest.approx(VALUES[:-1])


def test_the_smooth_curve_never_overshoots_its_samples():
    for i in range(len(KNOTS) - 1):
        between = REFERENCES["pchip"](np.linspace(KNOTS[i], KNOTS[i + 1], 30))[:, 0, 0]
        low, high = sorted(VALUES[i : i + 2])
        assert low - 1e-12 <= between.min() <= between.max() <= high + 1e-12


@pytest.mark.parametrize("kind", ["pchip", "linear", "hold"])
def test_one_sample_is_a_constant(kind):
    assert fsw.Samples([2.0], [7.0], kind=kind)([0.0, 2.0, 3.0], order=2)[:, 0].tolist() == [[7.0, 0.0]] * 3


def test_samples_read_from_csv(tmp_path):
    path = tmp_path / "profile.csv"
    path.write_text("\ufefftime [s], pressure, note\n0, 1.5, 7\n\n1e-1, 2.5, 8\n")
    by_position = fsw.Samples.read_csv(path)
    by_name = fsw.Samples.read_csv(path, time="time [s]", value="note", kind="hold")
    assert (by_position.t.tolist(), by_position.y.tolist()) == ([0.0, 0.1], [1.5, 2.5])
    assert by_name.y.tolist() == [7.0, 8.0]


def test_stack_sets_outputs_side_by_side():
    ramp, sine = REFERENCES["ramp"], REFERENCES["sine"]
    t = np.linspace(0.0, 2.0, 7)
    stack = fsw.Stack(ramp, fsw.Stack(sine, lambda t: 3.0 * t))
    values = stack(t, order=3)
    assert (stack.outputs, values.shape) == (3, (7, 3, 3))
    assert np.array_equal(values[:, :1], ramp(t, 3))
    assert np.array_equal(values[:, 1:2], sine(t, 3))
    assert np.array_equal(values[:, 2], np.column_stack([3.0 * t, 0 * t, 0 * t]))


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (2.0, [[2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]),
        ([2.0, 5.0], [[2.0, 0.0, 0.0], [5.0, 0.0, 0.0]]),
        (lambda t: np.column_stack([t, 2 * t]), [[3.0, 0.0, 0.0], [6.0, 0.0, 0.0]]),
        (lambda t: np.tile([[1.0, 2.0], [3.0, 4.0]], (t.size, 1, 1)), [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]),
        (lambda t: np.tile(np.arange(5.0), (t.size, 2, 1)), [[0.0, 1.0, 2.0], [0.0, 1.0, 2.0]]),
    ],
    ids=["number", "one number per output", "values", "value and slope", "more than wanted"],
)
def test_sample_brings_every_form_to_one_shape(reference, expected):
    values = sample(reference, np.array([3.0, 3.0]), 2, 3)
    assert values.shape == (2, 2, 3)
    assert values[0].tolist() == values[1].tolist() == expected


def test_a_callable_of_one_output_may_return_a_vector():
    assert sample(np.cos, np.zeros(4), 1, 2).tolist() == [[[1.0, 0.0]]] * 4
