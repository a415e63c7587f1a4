"""Identification against records whose truth is known: unbiased, honest about its errors, and frank in its warnings."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.identification.structures import STRUCTURES
from oracles.record import edges_of, response, study, summary, transfer

EVERY = (*STRUCTURES, "integrator+integrator")
OVEN = {"T": 20.0, "K": 3.0}


def record(
    structure="lag", truth=OVEN, delay=2.6, *, t=None, u=None, noise=0.02, seed=0, y_offset=20.0, more=0.0, **rest
):
    """A record of one plant; ``more`` is added to the output, an array or a number."""
    t = np.arange(400.0) if t is None else t
    u = (t % 80 >= 40).astype(float) if u is None else u
    edges, jumps = edges_of(t, u)
    edges[0] -= 1e4  # the first command has acted all along
    y = response(transfer(structure, truth), delay, t, edges, jumps) + y_offset + more
    return fsw.Record(t, u, y + noise * np.random.default_rng(seed).standard_normal(t.size), **rest)


def warned(fit, words):
    return any(words in sentence for sentence in fit.warnings)


# Bias, intervals, declared dead times (the whole: benchmarks/identification.py) -----------------------------------------


@pytest.mark.parametrize("structure", EVERY)
def test_parameters_are_unbiased_and_the_dead_time_lies_in_its_interval(structure):
    """Noise and its negative cancel to first order, so that few runs show a bias."""
    found = summary([result for seed in range(4) for result in study(structure, seed)])
    assert max(map(abs, found.bias.values())) < 0.2  # 24 runs; the benchmark's thousand are held to 0.1
    assert max(found.spread.values()) < 1.6
    assert found.coverage >= 0.8  # 24 runs, in pairs: the benchmark tests the coverage itself
    assert found.declared < 0.1
    assert found.clear >= 8


# Which structure --------------------------------------------------------------------------------------------------------


CHOICES = {
    "integrator": {"k": 2.0},
    "integrator+lag": {"c": 6.0, "k": 0.5},
    "lag": OVEN,
    "lag+lag": {"T1": 20.0, "T2": 7.0, "K": 3.0},
    "pair": {"omega": 0.3, "zeta": 0.2, "K": 2.0},
    "integrator+pair": {"omega": 0.4, "zeta": 0.3, "k": 0.3},
}


@pytest.mark.parametrize("structure", CHOICES)
def test_auto_finds_the_structure_in_most_clear_cases(structure):
    t, chosen = np.arange(300.0), []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        u = np.r_[np.zeros(10), np.repeat(rng.integers(0, 2, 29), 10)]
        chosen.append(fsw.identify(record(structure, CHOICES[structure], t=t, u=u, seed=seed)).structure)
    assert chosen.count(structure) >= 2, chosen


# Operating point, several inputs and outputs, coloured noise ------------------------------------------------------------


def test_the_offset_of_the_output_comes_with_its_error_and_reaches_the_plant():
    scores = []
    for seed in range(30):
        u = np.where(np.arange(400) % 80 >= 40, 0.0, 2.0)  # not zero at the start
        fit = fsw.identify(record(u=u, noise=0.3, seed=seed), "lag", drift=False)
        [(value, error)] = fit.estimate.offsets(0)
        assert fit.plant.y_offset == pytest.approx([value])
        scores.append((value - 20.0) / error)
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=0.6)
    assert abs(np.mean(scores)) < 0.6


def test_a_leak_of_an_integrator_is_an_offset_of_its_input():
    scores = []
    for seed in range(30):
        t = np.arange(300.0)
        leaking = record("integrator", {"k": 2.0}, t=t, noise=1.0, seed=seed, more=-0.6 * t)
        fit = fsw.identify(leaking, "integrator", drift=True)
        [(value, error)] = fit.estimate.offsets(0)
        assert fit.plant.u_offset == pytest.approx([-value / fit.parameters["k"][0]])
        scores.append((value + 0.6) / error)
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=0.6)
    assert fit.plant.u_offset == pytest.approx([0.3], rel=0.05)


def test_each_input_has_its_dead_time_and_outputs_share_it():
    t, rng = np.arange(500.0), np.random.default_rng(4)
    u = np.r_[np.zeros((10, 2)), np.repeat(rng.integers(0, 2, (49, 2)), 10, axis=0)]
    y = np.zeros((500, 2))
    for o, (T, gains) in enumerate([(12.0, (1.0, -0.4)), (30.0, (0.5, 2.0))]):
        for j, delay in enumerate((1.7, 6.3)):
            y[:, o] += response(transfer("lag", {"T": T, "K": gains[j]}), delay, t, *edges_of(t, u[:, j]))
    fit = fsw.identify(fsw.Record(t, u, y + 0.01 * rng.standard_normal(y.shape)), "lag", drift=False)
    for name, truth in {"delay_1": 1.7, "delay_2": 6.3, "T_1": 12.0, "T_2": 30.0, "K_12": -0.4, "K_22": 2.0}.items():
        value, error = fit.parameters[name]
        assert abs(value - truth) < 4.0 * error, name
        assert error < 0.03 * abs(truth)
    assert fit.plant.input_delay == pytest.approx([1.7, 6.3], abs=0.1)
    assert fit.dead_time_known == [True, True]


def test_coloured_noise_widens_the_intervals_as_it_must():
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        e, noise = 0.05 * rng.standard_normal(600), np.zeros(600)
        for k in range(1, 600):
            noise[k] = 0.7 * noise[k - 1] + e[k]
        fit = fsw.identify(record(t=np.arange(600.0), noise=0.0, more=noise), "lag", drift=False)
        for name, truth in {**OVEN, "delay": 2.6}.items():
            value, error = fit.parameters[name]
            inside.append(abs(value - truth) < 1.96 * error)
    assert 0.85 <= np.mean(inside) <= 0.99


def test_segments_have_their_own_start_and_skipped_stretches_none_of_the_blame():
    one, two = record(noise=0.01), record(noise=0.01, y_offset=20.0, more=5.0 * np.exp(-np.arange(400) / 20.0), seed=1)
    y = np.array(two.y)
    y[100:150] = 1e6
    broken = fsw.Record(two.t, two.u, y, skip=[(100, 149)])
    fit = fsw.identify(fsw.Record.join([one, broken]), "lag", drift=False)
    for name, truth in {**OVEN, "delay": 2.6}.items():
        value, error = fit.parameters[name]
        assert abs(value - truth) < 4.0 * error
    assert fit.warnings == []


def test_a_start_in_the_middle_of_a_motion_and_a_command_already_given_are_no_bias():
    t = np.arange(-200.0, 400.0)
    whole = record(t=t, u=(t % 80 >= 40).astype(float), noise=0.005)
    fit = fsw.identify(whole.between(-115.0, 400.0), "lag", drift=False)
    for name, truth in {**OVEN, "delay": 2.6}.items():
        value, error = fit.parameters[name]
        assert abs(value - truth) < 4.0 * error


# Warnings: a record that must raise each, and a similar one that must not ------------------------------------------------

LEVELS = np.tile(np.repeat([0.0, 1.0, 2.0, 1.0, 0.0, 2.0], 40), 3)
EFFECTIVE = np.where(LEVELS == 1.0, 1.3, LEVELS)
LONG = np.arange(LEVELS.size, dtype=float)


def levels(acts):
    y = response(transfer("lag", OVEN), 2.6, LONG, *edges_of(LONG, acts))
    return fsw.Record(LONG, LEVELS, y + 0.02 * np.random.default_rng(0).standard_normal(LONG.size))


def fading(share):
    """The gain drops by ``share`` half way."""
    t = np.arange(640.0)
    u = (t % 80 >= 40).astype(float)
    acts = np.where(t >= 320, (1.0 - share) * u, u)
    y = response(transfer("lag", OVEN), 2.6, t, *edges_of(t, acts))
    return fsw.Record(t, u, y + 0.02 * np.random.default_rng(0).standard_normal(t.size))


def two_runs(share=0.0, moved=0.0):
    one = record()
    other = record(truth={"T": 20.0, "K": 3.0 * (1.0 - share)}, y_offset=20.0 + moved, seed=1)
    return fsw.Record.join([one, other])


def rounded(step):
    whole = record(noise=0.02)
    return fsw.Record(whole.t, whole.u, np.round(whole.y / step) * step)


def wave(size):
    t = np.arange(400.0)
    return record(more=size * np.sin(t / 7.0))


def once(back):
    t = np.arange(400.0)
    return record(u=((t >= 50) & ~((t >= 200) & back)).astype(float))


STAIRS = np.repeat([3.0, 9.0, 4.0, 8.0, 5.0, 7.0, 6.0], 150)
STAIR_TIME = np.arange(STAIRS.size, dtype=float)


def stairs(power):
    acts = STAIRS**power / 9.0 ** (power - 1.0)
    y = response(transfer("lag", OVEN), 2.6, STAIR_TIME, *edges_of(STAIR_TIME, acts))
    return fsw.Record(STAIR_TIME, STAIRS, y + 0.05 * np.random.default_rng(0).standard_normal(STAIR_TIME.size))


THREE = {"T1": 20.0, "T2": 1.3, "T3": 1.0, "K": 3.0}
WARNINGS = {
    "is not told apart from zero": (record(delay=0.01, noise=0.05), record(delay=2.6, noise=0.05), "lag"),
    "is not told apart from one more lag": (
        record("lag+lag", {"T1": 20.0, "T2": 0.8, "K": 3.0}, delay=0.2, noise=0.2),
        record(noise=0.2, delay=6.0),
        "lag",
    ),
    "the pulses are too small for the noise": (record(noise=4.0), record(noise=0.4), "lag"),
    "differs by": (fading(0.2), fading(0.0), "lag"),
    "differs by ": (two_runs(share=0.2), two_runs(), "lag"),
    "are not white": (wave(0.2), wave(0.0), "lag"),
    "never returns": (once(False), once(True), "lag"),
    "is unstable": (
        record("lag", {"T": -300.0, "K": -3.0}, noise=0.01),
        record("lag", {"T": 300.0, "K": 3.0}, noise=0.01),
        "order 1",
    ),
    "is not proportional to its level": (levels(EFFECTIVE), levels(LEVELS), "lag"),
    "settles on a curve": (stairs(1.6), stairs(1.0), "lag"),
    "is read in steps of": (rounded(0.5), rounded(0.01), "lag"),
    "The offset of y differs by": (two_runs(moved=0.5), two_runs(), "lag"),
}


@pytest.mark.parametrize("words", WARNINGS)
def test_a_warning_is_given_where_it_must_be_and_only_there(words):
    guilty, innocent, structure = WARNINGS[words]
    found = fsw.identify(guilty, structure, drift=False)
    assert warned(found, words), found.warnings
    found = fsw.identify(innocent, structure, drift=False)
    assert not warned(found, words), found.warnings


def test_a_good_record_raises_no_warning():
    assert fsw.identify(record(), "lag").warnings == []
