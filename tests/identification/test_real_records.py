"""The opponents of identify on measured records: each finds a plant that it can express."""

import sys

import numpy as np
import pytest

from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture(scope="module")
def real_records():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        import real_records
    finally:
        sys.path.remove(str(BENCHMARKS))
    return real_records


@pytest.mark.parametrize("inputs", [1, 2])
@pytest.mark.parametrize(("method", "most"), [("FOPDT", 0.02), ("ARX", 0.1)])
def test_the_opponents_predict_a_plant_of_their_own(real_records, method, most, inputs):
    """First order with equal lags, dead times of whole samples, little noise: both structures hold it."""
    rng = np.random.default_rng(0)
    t = np.arange(800.0)
    u = (rng.random((40, inputs)) < 0.5).astype(float).repeat(20, axis=0)
    u[:20] = 0.0  # at rest, which is what a plain fit starts from
    y = 5.0 + sum(real_records.first_order(t, u[:, j], 0.0, 2.0 - 3.0 * j, 30.0, 4.0 + 8.0 * j) for j in range(inputs))
    data = real_records.Data(t, u, y + 0.01 * rng.standard_normal(t.size), 560)
    predicted, _ = real_records.METHODS[method](data)
    assert real_records.rms((predicted - y)[560:]) < most


def test_the_first_order_response_is_exact(real_records):
    t = np.linspace(0.0, 10.0, 41)
    u = np.where(t >= 2.0, 1.0, 0.5)
    y = real_records.first_order(t, u, 3.0, 2.0, 1.5, 0.7)
    before = np.where(t < 2.7, 1.0 + 2.0 * np.exp(-t / 1.5), 0.0)
    at_edge = 1.0 + 2.0 * np.exp(-2.7 / 1.5)
    after = np.where(t >= 2.7, 2.0 + (at_edge - 2.0) * np.exp(-(t - 2.7) / 1.5), 0.0)
    assert y == pytest.approx(before + after, abs=1e-12)
