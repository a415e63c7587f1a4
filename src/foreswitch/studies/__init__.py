"""What of many runs?

In: a project and what is varied. Out: a `Study`, a table of figures of merit; a comparison of laws; a draft of a project
from a fit.

Rooms, in the order of the data: `distributions` (what is drawn), `plan` (which runs), `workers` (where they run), `store`
(what an interruption leaves), `plots`, `pictures`, `report` (how it looks), `result` (the table), `sweep`; `comparison`,
`draft`.
"""
