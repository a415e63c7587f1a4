"""The demo's rise inside its band."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import foreswitch as fsw
from figures.paper import Values, hot_gas_controller, save


def certificate(folder: Path) -> Values:
    """The demo's rise inside its band."""
    law, rise = hot_gas_controller(preview=False), fsw.HalfSine(1000.0, 0.5)
    proof = fsw.certify(law, reference=rise, duration=0.6)
    run = fsw.simulate(law, rise, 0.6)
    save(proof.plot(run), folder / "certificate.svg")
    (inner, tight), (_, loose) = fsw.certify(law).arguments
    return {
        "proof_bound": proof.error_bound[0], "proof_resolution": proof.resolution[0],
        "proof_seen": np.abs(run.y - proof.ideal(rise, 0.6)).max(), "proof_inner": tight[0],
        "proof_outer": loose[0], "proof_low": inner[0][0], "proof_high": inner[1][0],
    }  # fmt: skip
