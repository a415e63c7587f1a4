"""How does a design get to other machines?

In: a controller. Out: a folder of C99 with the very core, or an FMU.

Rooms, in the order of the data: `header` (a design's tables as C), `vectors` (steps to replay on the target), `firmware`
(the folder, from ``templates``), `fmu`.
"""
