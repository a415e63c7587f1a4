"""What a study refuses before anything runs."""

import pytest

import foreswitch as fsw
from foreswitch.project import Project
from foreswitch.studies.plan import KEYS
from studies.studying import CONTENT, SWEEP, project


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"controler.Td": [1.0]}, "unknown key 'controler.Td'; did you mean 'controller.Td'"),
        ({"Td": [1.0]}, "unknown key 'Td'; did you mean 'controller.Td'"),
        ({"delay_eror": [1.0]}, "did you mean 'delay_error'"),
        ({"plant": [1.0]}, "unknown key 'plant'"),
        ({"simulation.seed": [1]}, "simulation.seed cannot be varied"),
        ({"controller.Td": 0.02}, "controller.Td is 0.02; give a list of values, or a distribution"),
        ({"controller.Td": []}, "controller.Td has no values"),
        ({"controller.Td": [0.01, 0.01]}, "lists 0.01 twice"),
        ({"controller.Td": "0.01,,0.02"}, "has an empty entry"),
        ({"controller.Td": "[0.01"}, "is not a value"),
        ({"controller.Td": "unifrom(0, 1)"}, "calls 'unifrom'; did you mean 'uniform'"),
        ({"controller.Td": "uniform(1)"}, r"give uniform\(low, high\)"),
        ({"controller.Td": "uniform(2, 1)"}, "low is 2 and high 1"),
        ({"controller.Td": "uniform(1, 2, per=step)"}, "per is 'step'; give 'run' or 'point'"),
        ({"controller.Td": "uniform(a, b)"}, "high is 'b'"),
        ({"hardware.late": [0.0], "simulation.hardware.late": [0.1]}, "which set the same value"),
        ({"simulation.noise": [1.0], "simulation.noise.0": [2.0]}, "which set the same value"),
        ({"controller.Td": [0.02, 1e-9]}, r"point 2 of 2 \(controller.Td = 1e-09\): Td is 1e-09"),
        ({"controller.Td": [0.02, "long"]}, r"point 2 of 2 \(controller.Td = long\): controller.Td is 'long'"),
        ({"simulation.noise": [[1.0, 2.0, 3.0]]}, r"point 1 of 1 \(simulation.noise = \[1.0, 2.0, 3.0\]\): noise"),
        ({"simulation.x0": [[1.0, 2.0, 3.0]]}, r"point 1 of 1 .* x0"),
        ({"simulation.noise": "uniform(-1, 1)"}, r"point 1 of 1, run \d+ \(simulation.noise = -0.\d+\): noise is"),
        ({"simulation.noise.7": [1.0]}, "'simulation.noise.7' leads nowhere"),
        ({"reference.0.slope": [1.0]}, "'reference.0.slope' leads nowhere"),
        ({"plant.k.x": [1.0]}, "unknown key 'plant.k.x'"),
        ({"delay_error": [-0.006]}, "give at least -0.005"),
        ({"delay_error": [0.0], "simulation.plant.k": [1.0]}, "remove one of them"),
        ({"reference.kind": ["samples"], "reference.file": ["no.csv"]}, "point 1 of 1 .*no.csv"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(over, message, tmp_path, monkeypatch):
    monkeypatch.setattr(SWEEP, "run_pieces", lambda *_: pytest.fail("it ran"))
    base = project()
    if "reference.file" in over:
        base = Project(CONTENT | {"reference": {"kind": "constant", "value": 1.0}})
        over = {"reference": [0]} and over
    with pytest.raises(ValueError, match=message):
        fsw.study(base, over, repeats=40, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"repeats": 0}, "repeats is 0"),
        ({"repeats": True}, "repeats is True"),
        ({"repeats": 2.0}, "repeats is 2.0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": None}, "seed is None"),
        ({"scheduler": "threads"}, "scheduler is 'threads'; give None"),
        ({"over": [1]}, r"over is \[1\]"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        fsw.study(project(), **options)


def test_every_key_of_a_project_file_can_be_varied():
    """But the seed; the names are those that the documentation of the project file lists."""
    assert {"actuator.levels", "controller.lam", "simulation.hardware.stuck.level", "simulation.plant.B"} < set(KEYS)
    assert "simulation.seed" not in KEYS
    assert all(meaning.sentence for meaning in KEYS.values())
