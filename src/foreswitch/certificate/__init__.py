"""How far off can it ever be?

In: a controller, its reference, and what may be wrong. Out: a `Certificate`, that is a bound of the output's distance from
an ideal actuator's response, or the reason why nothing is proven.

Rooms, in the order of the proof: `peak_gain`, `model_errors`, `error_dynamics` (the loop in error coordinates),
`measurement_errors`, `covering_radius` and `quantiser` (what choosing among levels adds), `ideal_response` (what is kept
to), `margins`, `reasons` (in words), `certificate`; `plots` and `report` show it.
"""
