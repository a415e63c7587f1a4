"""What does a design do in closed loop?

In: a controller or a baseline, a truth that may differ from its model, a reference. Out: a `Run` with every trace, or
figures of merit of many runs.

Rooms, in the order of the data: `bodies` (plants, rigs and sensors as the C loop steps them), `run`, `loop`, `batch`,
`baselines` (what people use today), `precision` (single beside double), `replay` (one step again), `report`.
"""
