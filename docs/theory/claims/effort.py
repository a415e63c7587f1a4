"""A decision costs the same whatever the settling horizon."""

import foreswitch as fsw

KIND, PAPER, HERE = "confirmed", "the computation does not grow with Td", "the same rows, the same candidates"


def check() -> str:
    """What a decision looks at, for three horizons."""
    valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    sizes = set()
    for Td in (0.001, 0.020, 2.0):
        law = fsw.Controller(valve, [0, 1], 1e-3, fsw.Endpoint(Td=Td, lam=2500.0))
        sizes.add((law.decide([0.0, 0.0], 100.0).nodes, law.pending_steps, law.order))
    assert len(sizes) == 1
    nodes, pending, _ = sizes.pop()
    return f"{nodes} candidates and {pending} commands under way with Td = 1 ms, 20 ms and 2 s"


if __name__ == "__main__":
    print(check())
