"""Which settling horizons are good is not a matter of longer or shorter."""

import foreswitch as fsw

KIND, PAPER, HERE = (
    "completed",
    "which Td suits a marginal or unstable plant is left open",
    "the intervals are computed",
)


def check() -> str:
    """An undamped oscillator, period 6.3 s."""
    spring = fsw.Plant.from_tf([1.0], [1.0, 0.0, 1.0], input_delay=0.3)
    proof = fsw.certify(fsw.Controller(spring, [-1, 0, 1], 0.1, fsw.Endpoint(Td=1.0, lam=2.0)))
    good = [(a, b) for a, b in proof.Td_intervals if a < 10.0]
    assert len(good) > 1
    return "an oscillator: Td " + ", ".join(f"{a:.2f} to {b:.2f} s" for a, b in good)


if __name__ == "__main__":
    print(check())
