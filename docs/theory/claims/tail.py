"""Taking later inputs as zero biases a plant that does not integrate."""

import foreswitch as fsw

KIND, PAPER, HERE = "corrected", "all inputs after the next period are zero", "they are what holds the reference"


def check() -> str:
    """An oven that shall hold 40 K."""
    oven, means = fsw.Plant.fopdt(K=100.0, T=100.0, L=20.0), []
    for tail in ("zero", "rest"):
        law = fsw.Controller(oven, [0, 1], 1.0, fsw.Endpoint(Td=50.0, lam=0.1, tail=tail))
        means.append(float(fsw.simulate(law, 40.0, 4000.0).y[2000:].mean()))
    assert means[0] > 60.0
    assert abs(means[1] - 40.0) < 0.05
    return f"an oven set to 40 K holds {means[0]:.1f} K with the paper's tail, {means[1]:.2f} K with ours"


if __name__ == "__main__":
    print(check())
