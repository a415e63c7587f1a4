"""What is controlled, and what is wanted of it?

In: matrices, transfer functions, functions, tables of points. Out: a `Plant`, a `Reference`, what real hardware adds, and
predictions of all this across the dead time.

Rooms, in the order of the data: `plant`, `nonlinear` (truths that Python steps), `reference`, `prediction` (the rows of
docs/theory), `hardware` (what actuators and sensors add).
"""
