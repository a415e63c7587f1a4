"""What single precision changes: nothing on the hot gas, near-ties elsewhere."""

import numpy as np
import pytest

import foreswitch as fsw
from foreswitch.project import Project
from places import EXAMPLES
from systems import MASS, RISE, VALVE, quiet, valve_controller

NAMES = sorted(folder.parent.name for folder in EXAMPLES.glob("*/project.toml"))
#: A tie: what the other choice costs more, as a share of what the choice is about.
NEAR_TIE = 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_single_precision_differs_in_near_ties_only(name, record_property):
    project = Project.read(EXAMPLES / name / "project.toml").with_seed(0)
    settings = project.simulation_settings()
    duration = settings.pop("duration")
    found = fsw.compare_precision(project.controller, project.reference, duration, **settings)
    for key in ("commands_differing", "first", "decisions", "decisions_differing", "gaps"):
        record_property(f"{name} {key}", str(getattr(found, key)))
    assert found.decisions == len(found.double.u)
    assert found.gaps.shape == found.decisions_differing.shape
    assert (found.gaps < NEAR_TIE).all()
    assert len(found.gaps) < 1e-3 * found.decisions
    if settings.get("noise") is None:  # else the loops decide on other data than the replay
        assert found.first == (found.decisions_differing[0] if len(found.gaps) else None)
    rms = [np.linalg.norm(run.y - run.r) for run in (found.single, found.double)]
    assert rms[0] == pytest.approx(rms[1], rel=0.05)


@pytest.mark.parametrize("preview", [False, True, "lag"])
def test_on_the_hot_gas_it_changes_nothing(preview, record_property):
    """The paper's trajectory, with its own tail."""
    controller = valve_controller(tail="zero", preview=preview)
    found = fsw.compare_precision(controller, RISE, 0.6)
    record_property(f"hot gas, preview {preview}", f"{found.commands_differing} of {found.decisions}")
    assert (found.commands_differing, found.first, len(found.gaps)) == (0, None, 0)
    assert np.array_equal(found.single.u, found.double.u)
    assert np.array_equal(found.double.u, fsw.simulate(controller, RISE, 0.6).u)
    assert np.count_nonzero(np.diff(found.double.u[:, 0])) > 50


def attitude(real="float64"):
    """Three levels, a price and noise: ties come up by themselves, but for a few thousand decisions only here."""
    return fsw.Controller(MASS, [-1, 0, 1], 0.01, fsw.Endpoint(0.2, 0.5), switch_cost=1e-4, min_on=0.03, real=real)


@pytest.fixture(scope="module")
def differing():
    """A run in which decisions do differ: large values that a float holds badly, beside small ones that decide."""
    controller = fsw.Controller(VALVE, [0.0, 1.0], 1e-3, fsw.Endpoint(0.02, 2500.0))
    reference = fsw.HalfSine(1000.0, 0.5, offset=3e7)
    return fsw.compare_precision(controller, reference, 2.0, x0=[3e7, 0.0])


def test_where_values_are_large_it_tells_how_much_was_at_stake(differing):
    assert 0 < len(differing.gaps) < differing.decisions
    assert (differing.gaps >= 0.0).all()
    assert differing.gaps.max() < 0.2
    assert differing.first is not None
    assert differing.commands_differing == (differing.single.u != differing.double.u).any(axis=1).sum()
    assert differing.first == np.flatnonzero((differing.single.u != differing.double.u).any(axis=1))[0]
    # up to there both loops are one, and so is the replay
    assert differing.first == differing.decisions_differing[0]


def test_gaps_are_those_of_the_costs(differing):
    """Worked out again from the decisions themselves, for a law that remembers the same commands."""
    law = fsw.Controller(VALVE, [0.0, 1.0], 1e-3, fsw.Endpoint(0.02, 2500.0))
    reference = fsw.HalfSine(1000.0, 0.5, offset=3e7)(differing.double.t, 2)
    at = dict(zip(differing.decisions_differing.tolist(), differing.gaps, strict=True))
    spreads, extra = [], []
    for k, x in enumerate(differing.double.x[:-1]):
        decision = law.decide(x, reference[k])
        assert np.array_equal(decision.u, differing.double.u[k])
        spreads.append(decision.costs.max() - decision.costs.min())
        extra += [spreads[-1]] if k in at else []  # there are two commands, one better than the other
        law.step(x, reference[k])
    assert list(at.values()) == pytest.approx(np.array(extra) / np.median(spreads), rel=1e-9)


def test_its_repr_says_what_was_found(differing):
    alike = fsw.compare_precision(valve_controller(), RISE, 0.1)
    assert repr(alike).splitlines() == [
        "Precision",
        "├─ commands   0 of 100 differ in closed loop",
        "└─ decisions  0 of 100 differ on the same data",
    ]
    text = repr(differing)
    assert f"first      period {differing.first}" in text
    assert f"decisions  {len(differing.gaps)} of 2000 differ on the same data" in text
    assert f"gap        at most {differing.gaps.max():.2g}" in text


def test_it_depends_on_the_seed_and_on_nothing_else():
    runs = [fsw.compare_precision(attitude(), 1.0, 5.0, noise=[0.05, 0.05], seed=seed) for seed in (1, 1, 2)]
    assert np.array_equal(runs[0].double.x, runs[1].double.x)
    assert np.array_equal(runs[0].single.x, runs[1].single.x)
    assert not np.array_equal(runs[0].double.x, runs[2].double.x)
    other = fsw.compare_precision(attitude("float32"), 1.0, 5.0, noise=[0.05, 0.05], seed=1)
    assert np.array_equal(other.double.x, runs[0].double.x)
    assert np.array_equal(other.single.x, runs[0].single.x)


def test_another_truth_with_a_disturbance_that_only_it_knows():
    truth = VALVE.replace(B=1.2 * VALVE.B, E=[[-1.0], [0.0]], input_delay=0.006)
    found = quiet(fsw.compare_precision, valve_controller(), 500.0, 0.3, plant=truth, disturbance=300.0)
    assert found.decisions == 300
    assert found.double.plant is truth
    assert (found.gaps < NEAR_TIE).all()


def test_a_bad_argument_is_named():
    with pytest.raises(ValueError, match="duration"):
        fsw.compare_precision(valve_controller(), RISE, -1.0)


# The same controller otherwise ----------------------------------------------------------------------------------------


def test_replace_changes_what_is_named_and_starts_afresh():
    plant = VALVE.replace(E=[[-1.0], [0.0]])
    options = {"min_on": 0.003, "min_off": 0.002, "switch_cost": 2.0, "safe_level": 0.0, "preview": "lag"}
    law = fsw.Controller(plant, [0.0, 1.0], 1e-3, fsw.Endpoint(0.02, 2500.0, tail="zero"), **options)
    for k in range(5):
        law.step([0.0, 0.0], 100.0 * k)
    same, fresh = law.replace(), fsw.Controller(plant, [0.0, 1.0], 1e-3, law.objective, **options)
    single = law.replace(real="float32")
    assert (law.real, same.real, single.real) == ("float64", "float64", "float32")
    assert repr(same) == repr(fresh)
    runs = [fsw.simulate(each, RISE, 0.6, noise=3.0, seed=1) for each in (same, fresh, single, law)]
    assert np.array_equal(runs[0].u, runs[1].u)
    assert np.array_equal(runs[0].u, runs[2].u)
    assert not np.array_equal(runs[0].u, runs[3].u), "the law itself still has its pulse under way"
    longer = law.replace(objective=fsw.Endpoint(0.03, 2500.0), min_on=0.004)
    assert np.array_equal(
        fsw.simulate(longer, RISE, 0.6).u,
        fsw.simulate(
            fsw.Controller(plant, [0.0, 1.0], 1e-3, fsw.Endpoint(0.03, 2500.0), **options | {"min_on": 0.004}),
            RISE,
            0.6,
        ).u,
    )


def test_replace_knows_its_arguments():
    with pytest.raises(ValueError, match="Controller has no argument 'rael'; did you mean 'real'"):
        valve_controller().replace(rael="float32")
    with pytest.raises(ValueError, match="real is 'float16'"):
        valve_controller().replace(real="float16")
