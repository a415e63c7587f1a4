"""Which plant made this record?

In: a `Record` of any switching test. Out: a `Fit`, that is a plant with standard errors, and what the data cannot tell.

Rooms, in the order of the data: `record`, `structures` (what may be fitted), `response` (of a structure to the record),
`fitting` (its parameters), `statistics` (how sure they are), `diagnosis` (what contradicts them), `fit`, `search` (over the
structures); `pulse_test` designs the experiment beforehand; `plots` and `report` show it all.
"""
