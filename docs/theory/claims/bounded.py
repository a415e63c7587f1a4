"""A stable plant stays bounded, whatever is asked of it."""

import numpy as np

import foreswitch as fsw

KIND, PAPER, HERE = "confirmed", "stable plants stay bounded", "yes, but how far from the reference it does not say"


def check() -> str:
    """An oven asked for anything between -300 and 300 K."""
    oven = fsw.Plant.fopdt(K=100.0, T=100.0, L=20.0)
    law = fsw.Controller(oven, [0, 1], 1.0, fsw.Endpoint(Td=20.0, lam=0.1))
    wishes = np.random.default_rng(1).uniform(-300.0, 300.0, 200)
    run = fsw.simulate(law, fsw.Steps(50.0 * np.arange(200), wishes), 1e4)
    assert run.y.min() >= 0.0
    assert run.y.max() <= 100.0
    return f"200 set points from -300 to 300 K: the oven stays between {run.y.min():.0f} and {run.y.max():.0f} K"


if __name__ == "__main__":
    print(check())
