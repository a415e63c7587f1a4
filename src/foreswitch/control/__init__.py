"""Which command is best now?

In: a plant, its levels, a switching period, an objective. Out: a `Controller`, that is a design in the core's own tables
with the small state of a run.

Rooms, in the order of the data: `objective` (what is minimised), `actuator` (what may be commanded), `kalman` (what is
estimated), `endpoint` or `horizon` with `horizon_tables` (the objective as tables), `ideal_loop` (lag and gain),
`controller`.
"""
