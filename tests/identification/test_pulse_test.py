"""Pulse tests: the commands, the rehearsal against a slow truth, and the predicted errors against many rehearsals."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import foreswitch as fsw
from oracles.rig import integrated, switching

GAS = fsw.Plant.integrator_lag(16500.0, 0.006, 0.0053)
OVEN = fsw.Plant.fopdt(100.0, 100.0, 20.7)
SWING = fsw.Plant.from_tf([1.0], [1.0, 0.4, 1.0], input_delay=0.7)
#: Structure, plant, Ts, noise and wanted error of the dead time.
PLANTS = {
    "gas": ("integrator+lag", GAS, 1e-3, 2.0, 1e-4),
    "oven": ("lag", OVEN, 2.0, 0.5, 0.2),
    "swing": ("pair", SWING, 0.1, 0.05, 0.01),
    "tank": ("integrator", fsw.Plant([[0.0]], [[0.01]], input_delay=5.0), 1.0, 0.01, 0.2),
    "plate": ("lag+lag", fsw.Plant.from_tf([1.0], [3000.0, 130.0, 1.0], input_delay=20.0), 5.0, 0.01, 1.0),
    "cart": ("integrator+integrator", fsw.Plant.from_tf([1.0], [1.0, 0.0, 0.0], input_delay=0.5), 0.1, 0.01, 0.01),
    "no dead time": ("lag", fsw.Plant.fopdt(100.0, 100.0, 0.0), 2.0, 0.5, 0.2),
}


def propose(name, **wishes):
    _, plant, Ts, noise, delay_error = PLANTS[name]
    return fsw.propose_test(plant, Ts, **({"noise": noise, "delay_error": delay_error} | wishes))


# Commands -------------------------------------------------------------------------------------------------------------


@given(
    st.floats(1e-4, 1e2), st.integers(1, 9), st.floats(1.0, 20.0), st.integers(1, 12), st.floats(0.0, 9.0),
    st.sampled_from([(0.0, 1.0), (1.0, 0.0), (-2.0, 0.5)]),
)  # fmt: skip
def test_pulses_are_equal_and_begin_when_they_should(Ts, width, pause, number, lead, levels):
    spacing = width + pause
    test = fsw.PulseTest(Ts, width * Ts, spacing * Ts, number, lead * Ts, *levels)
    low, high = levels
    inside = np.r_[False, test.u == high, False]
    begin, end = (np.flatnonzero(np.diff(inside.astype(int)) == way) for way in (1, -1))
    assert set(test.u) == {low, high}
    assert (end - begin == width).all()
    late = test.t[begin] / Ts - (lead + spacing * np.arange(number))
    assert late.size == number
    assert (late > -1e-6).all()
    assert (late < 1.0).all()
    assert test.t[-1] == pytest.approx(test.duration, abs=1.01 * Ts)
    assert np.diff(test.t) == pytest.approx(Ts)


def test_the_commands_reach_the_logger(tmp_path):
    test = fsw.PulseTest(1e-3, 2e-3, 0.01, 3, lead=0.005, high=5.0)
    test.to_csv(tmp_path / "pulses.csv")
    t, u = np.loadtxt(tmp_path / "pulses.csv", delimiter=",", skiprows=1).T
    assert (tmp_path / "pulses.csv").read_text().splitlines()[0] == "t,u"
    assert t == pytest.approx(test.t)
    assert (u == test.u).all()


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"Ts": 0.0}, "Ts is 0"),
        ({"width": 0.5}, "width is 0.5 s and spacing 10 s; a pulse lasts at least Ts = 1 s"),
        ({"spacing": 2.5}, "ends at least Ts before the next"),
        ({"number": 0}, "number is 0; give 1 to"),
        ({"number": 2.5}, "number is 2.5"),
        ({"lead": -1.0}, "lead is -1"),
        ({"high": 0.0}, "low and high are both 0; give two levels"),
        ({"low": np.nan}, "low is nan"),
    ],
)
def test_impossible_pulses_say_so(wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        fsw.PulseTest(**({"Ts": 1.0, "width": 2.0, "spacing": 10.0, "number": 3} | wrong))


# Rehearsal ------------------------------------------------------------------------------------------------------------


def truth(test, plant, opening, closing, x0):
    """The outputs by the oracle: edges one by one, an ODE solver between them."""
    delay = float(plant.input_delay[0])
    edges = switching(test.u, 0.0, test.Ts, delay + opening, delay + closing)
    x = integrated(plant, np.array(x0, dtype=float), test.Ts, [edges], test.t.size - 1)
    return x @ plant.C.T + plant.y_offset


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_a_rehearsal_is_what_an_ode_solver_gives(seed):
    rng = np.random.default_rng(seed)
    Ts, n, q = float(rng.choice([1e-3, 0.5, 3.0])), int(rng.integers(1, 4)), int(rng.integers(1, 3))
    A = rng.standard_normal((n, n)) / n - 0.3 * np.eye(n)
    if rng.random() < 0.3:
        A[0] = 0.0
    delay = Ts * float(rng.choice([0.0, 2.0, rng.uniform(0.0, 4.0)]))
    plant = fsw.Plant(
        0.3 * A / Ts, rng.standard_normal(n) / Ts, rng.standard_normal((q, n)), input_delay=delay,
        u_offset=rng.standard_normal(), y_offset=rng.standard_normal(q),
    )  # fmt: skip
    low, high = rng.permutation([rng.uniform(-2.0, -0.1), rng.uniform(0.1, 2.0)])
    test = fsw.PulseTest(Ts, 2 * Ts, rng.uniform(5.0, 7.0) * Ts, 3, rng.uniform(0.0, 2.0) * Ts, low, high)
    opening, closing = rng.uniform(0.0, 1.9, 2) * Ts * (rng.random() < 0.7)
    x0 = rng.standard_normal(n)
    rig = fsw.Hardware(opening=opening, closing=closing)
    want = truth(test, plant, opening, closing, x0)
    got = test.rehearse(plant, hardware=rig, x0=x0)
    np.testing.assert_allclose(got.y, want, rtol=1e-8, atol=1e-8 * np.abs(want).max())
    assert (got.u[:, 0] == test.u).all()
    # a sensor with steps and an end
    step, top = 0.05 * np.ptp(want), np.quantile(want, 0.8, axis=0)
    read = test.rehearse(plant, hardware=fsw.Hardware(opening, closing, quantum=step, high=top), x0=x0).y
    rounded = np.minimum(step * np.floor(want / step + 0.5), top)
    near_a_step = np.abs(want / step + 0.5 - np.round(want / step + 0.5)) < 1e-5
    assert (np.isclose(read, rounded, rtol=1e-9, atol=1e-9 * step) | near_a_step).all()


@pytest.mark.parametrize("low", [0.0, 0.4])
def test_a_rehearsal_begins_at_rest(low):
    plant = OVEN.replace(u_offset=0.1, y_offset=20.0)
    test = fsw.PulseTest(2.0, 50.0, 200.0, 2, lead=100.0, low=low, high=1.0)
    y = test.rehearse(plant).y[:, 0]
    assert y[: 50 + 10] == pytest.approx(20.0 + 100.0 * (low - 0.1))
    assert np.ptp(y) > 10.0


def test_an_integrating_plant_begins_at_zero_and_drifts():
    plant = fsw.Plant([[0.0]], [[1.0]], u_offset=0.25, y_offset=3.0)
    test = fsw.PulseTest(1.0, 2.0, 10.0, 2, lead=10.0)
    y = test.rehearse(plant).y[:, 0]
    assert y[:11] == pytest.approx(3.0 - 0.25 * np.arange(11))
    assert y[-1] == pytest.approx(3.0 - 0.25 * 30 + 4.0)


def test_noise_is_white_of_its_size_and_comes_from_the_seed():
    plant = fsw.Plant(-0.01 * np.eye(2), [1.0, 2.0], np.eye(2))
    test = fsw.PulseTest(1.0, 20.0, 100.0, 40)
    quiet, noisy, again = (test.rehearse(plant, noise=n, seed=3).y for n in (0.0, [0.5, 2.0], [0.5, 2.0]))
    assert (noisy == again).all()
    assert (noisy != test.rehearse(plant, noise=[0.5, 2.0], seed=4).y).any()
    assert (noisy - quiet).std(axis=0) == pytest.approx([0.5, 2.0], rel=0.05)


@pytest.mark.parametrize(
    ("plant", "rig", "sentence"),
    [
        (fsw.Plant(-np.eye(1), np.ones((1, 2))), None, "plant has 2 inputs; rehearse each input"),
        (GAS, fsw.Hardware(opening=0.003), "a pulse or a pause is too short for an edge to arrive before the next"),
        (GAS, fsw.Hardware(missing=0.1), "hardware has missing; a rehearsal knows"),
        (GAS, fsw.Hardware(stuck=[fsw.Stuck(1.0, 0.0, 1.0)]), "hardware has stuck"),
        (GAS, fsw.Hardware(process_noise=[0.0, 1.0]), "hardware has process_noise"),
        (GAS, fsw.Hardware(quantum=[1.0, 1.0]), "quantum has shape"),
    ],
)
def test_a_rig_that_cannot_be_rehearsed_says_so(plant, rig, sentence):
    with pytest.raises(ValueError, match=sentence):
        fsw.PulseTest(1e-3, 2e-3, 0.06, 5).rehearse(plant, hardware=rig)


# Proposals ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("levels", [(0.0, 1.0), (1.0, 0.0), (0.3, 0.8)], ids=str)
@pytest.mark.parametrize("name", PLANTS)
def test_a_proposal_promises_what_was_wanted(name, levels):
    structure, plant, Ts, _, delay_error = PLANTS[name]
    test = propose(name, levels=levels)
    assert (test.low, test.high) == levels
    assert test.Ts == Ts
    assert 0.0 < test.predicted["delay"] <= delay_error
    fit = fsw.identify(test.rehearse(plant), structure, held_back=0.0)  # the names are those of a fit
    assert {n: e <= 0.05 * abs(v) for (n, (v, _)), e in zip(fit.parameters.items(), test.predicted.values(), strict=True)
            if n != "delay"} == {n: True for n in test.predicted if n != "delay"}  # fmt: skip


@pytest.mark.parametrize("name", ["gas", "oven", "swing"])
def test_the_errors_of_many_rehearsals_are_those_predicted(name):
    """A hundred records tell a standard deviation to 7 %."""
    structure, plant, _, noise, _ = PLANTS[name]
    test = propose(name)
    drift = structure.startswith("integrator")
    fits = [
        fsw.identify(test.rehearse(plant, noise=noise, seed=seed), structure, drift=drift, held_back=0.0).parameters
        for seed in range(100)
    ]
    for parameter, predicted in test.predicted.items():
        found = np.array([fit[parameter][0] for fit in fits])
        assert found.std(ddof=1) == pytest.approx(predicted, rel=0.25), parameter
    reported = np.median([fit["delay"][1] for fit in fits])
    assert reported == pytest.approx(test.predicted["delay"], rel=0.15)
    error = np.mean([fit["delay"][0] for fit in fits]) - plant.input_delay[0]
    assert abs(error) < 0.4 * test.predicted["delay"]


@pytest.mark.parametrize("name", ["gas", "oven", "swing", "tank"])
@pytest.mark.parametrize("share", [0.6, 1.0, 2.0])
def test_travel_and_longest_are_kept(name, share):
    plant, free = PLANTS[name][1], propose(name)
    swept = np.ptp(free.rehearse(plant).y)
    for wish in ({"travel": share * swept}, {"longest": share * free.duration}):
        if share < 1.0:
            try:
                test = propose(name, **wish)
            except ValueError:  # less than the shortest may be too little
                continue
        else:
            test = propose(name, **wish)
        assert test.predicted["delay"] <= PLANTS[name][-1]
        assert np.ptp(test.rehearse(plant).y) <= wish.get("travel", np.inf) * (1 + 1e-6)
        assert test.duration <= wish.get("longest", np.inf) * (1 + 1e-6)


def test_what_falls_between_the_pulses_takes_less_travel():
    """With a leak of 0.3 of the full flow the same pulses sweep less than without it."""
    leaking, wishes = GAS.replace(u_offset=0.3), {"noise": 2.0, "delay_error": 2e-4, "travel": 200.0}
    with pytest.raises(ValueError, match="best test within travel 200"):
        fsw.propose_test(GAS, 1e-3, **wishes)
    test = fsw.propose_test(leaking, 1e-3, **wishes)
    assert np.ptp(test.rehearse(leaking).y) <= 200.0 < np.ptp(test.rehearse(GAS).y)


@pytest.mark.parametrize("name", PLANTS)
def test_a_smaller_error_takes_a_longer_test(name):
    wanted = PLANTS[name][-1]
    durations = [propose(name, delay_error=wanted * share).duration for share in (1.0, 0.3, 0.1)]
    assert durations == sorted(durations)
    assert durations[-1] > durations[0]


def test_gain_and_lag_are_asked_for_as_well():
    loose, tight = propose("oven", relative_error=0.5), propose("oven", relative_error=0.005)
    assert loose.predicted["K"] > propose("oven").predicted["K"]
    assert tight.predicted["K"] <= 0.005 * 100.0 * 1.02
    assert tight.predicted["T"] <= 0.005 * 100.0 * 1.02
    assert tight.duration > loose.duration


@pytest.mark.parametrize(
    ("wishes", "sentence"),
    [
        (
            {"longest": 700.0, "delay_error": 0.02},
            r"the best test within travel unlimited and longest 700.0, \d+ pulses of",
        ),
        ({"longest": 100.0}, "not even 4 pulses fit into travel unlimited and longest 100.0"),
        ({"travel": 0.1}, "not even 4 pulses fit into travel 0.1"),
        ({"travel": -1.0}, "travel is -1"),
        ({"noise": 0.0}, "noise is 0"),
        ({"delay_error": 0.0}, "delay_error is 0"),
        ({"relative_error": 0.0}, "relative_error is 0"),
        ({"levels": (1.0,)}, "give the level between the pulses and the one in them"),
        ({"levels": (1.0, 1.0)}, "give two levels"),
        ({"Ts": 1e-4}, "give a longer Ts"),
    ],
)
def test_an_impossible_wish_gets_one_sentence(wishes, sentence):
    given = {"Ts": 2.0, "noise": 0.5, "delay_error": 0.2} | wishes
    with pytest.raises(ValueError, match=sentence) as error:
        fsw.propose_test(OVEN, **given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("plant", "sentence"),
    [
        (fsw.Plant(-np.eye(1), np.ones((1, 2))), "plant has 2 inputs and 1 outputs"),
        (fsw.Plant.from_tf([1.0, 1.0], [1.0, 3.0, 2.0]), "zeros or unstable poles"),
        (fsw.Plant([[1.0]], [[1.0]]), "zeros or unstable poles"),
    ],
)
def test_a_plant_that_is_no_chain_says_so(plant, sentence):
    with pytest.raises(ValueError, match=sentence):
        fsw.propose_test(plant, 0.1, noise=0.1, delay_error=0.1)


@pytest.mark.parametrize("name", PLANTS)
def test_a_test_of_ones_own_is_judged_alike(name):
    plant, noise = PLANTS[name][1], PLANTS[name][3]
    test = propose(name)
    assert test.errors(plant, noise) == test.predicted
    halved = test.errors(plant, 0.5 * noise)
    assert [halved[n] for n in halved] == pytest.approx([0.5 * test.predicted[n] for n in halved], rel=0.02)


def test_quiet_time_tells_gain_from_drift():
    """The gain of an integrating plant; its dead time hardly cares."""
    none, some = (fsw.PulseTest(1e-3, 1e-3, 0.035, 40, lead).errors(GAS, 1.0) for lead in (0.035, 0.35))
    assert some["k"] < 0.1 * none["k"]
    assert some["delay"] > 0.7 * none["delay"]


def test_a_proposal_shows_what_it_will_tell():
    text = repr(propose("oven"))
    assert "levels 0 and 1" in text
    for name in ("T", "K", "delay"):
        assert f"{name:<9}  to be known to" in text


# The hot gas ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_hot_gas_rig_gives_the_papers_model(seed):
    """Shields, Barth and Goldfarb (2006): k = 16500 kPa/s, c = 6 ms, Tu = 5 ms, from pulses of 1 ms."""
    rig = fsw.Plant.from_tf([18333.0 * 186.0**2], [1.0, 2.0 * 0.75 * 186.0, 186.0**2, 0.0], input_delay=0.00137)
    valve = fsw.Hardware(opening=0.00035, closing=0.00025, quantum=0.5)
    test = fsw.PulseTest(Ts=1e-3, width=1e-3, spacing=0.06, number=40, lead=0.05)
    record = test.rehearse(rig, noise=1.0, hardware=valve, x0=[101.3, 0.0, 0.0], seed=seed)
    second = fsw.identify(record, "integrator+lag")
    for name, paper in {"k": 16500.0, "c": 0.006, "delay": 0.005}.items():
        assert second.parameters[name][0] == pytest.approx(paper, rel=0.05), name
    chosen = fsw.identify(record)
    assert chosen.structure == "integrator+pair"
    assert chosen.candidates[0].structure == "integrator+pair"
