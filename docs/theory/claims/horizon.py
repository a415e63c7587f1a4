"""Twenty samples of lookahead are not prohibitive."""

import foreswitch as fsw

KIND, PAPER, HERE = (
    "corrected",
    "20 samples of lookahead, 2^20 or 3^20 sequences, are prohibitive",
    "exact, in few steps",
)


def check() -> str:
    """Partial sequences tried, over the paper's rise."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Horizon(20), preview=True)
    run = fsw.simulate(law, fsw.HalfSine(height=1000.0, duration=0.5), 0.6)
    assert run.nodes.max() < 5000
    return f"of 2^20 = 1048576 sequences at most {run.nodes.max()} partial ones are looked at"


if __name__ == "__main__":
    print(check())
