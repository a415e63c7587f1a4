"""Actuators, sensors and random numbers of a rig, written out slowly and plainly: the tests' own truth.

Nothing comes from the library, and times are seconds throughout: no ticks, no segments, no periods cut in advance.
"""

from itertools import pairwise
from math import cos, floor, log1p, pi, sqrt

import numpy as np
from scipy.integrate import solve_ivp

# Random numbers -------------------------------------------------------------------------------------------------------

SENSOR, PROCESS, LOST, LATE = 1, 2, 3, 4  # what a number is for
GOLDEN, WORD = 0x9E3779B97F4A7C15, 2**64


def mixed(z):
    """The output function of SplitMix64, on a whole number."""
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % WORD
    return z ^ (z >> 31)


def uniform(seed, stream, index):
    """53 bits of the generator that seed and stream choose, at a place of its sequence."""
    origin = mixed((mixed((seed + GOLDEN) % WORD) + stream * GOLDEN) % WORD)
    return (mixed((origin + (index + 1) * GOLDEN) % WORD) >> 11) / 2**53


def normal(seed, stream, index):
    """Box and Muller."""
    radius, turn = uniform(seed, stream, 2 * index), uniform(seed, stream, 2 * index + 1)
    return sqrt(-2.0 * log1p(-radius)) * cos(2.0 * pi * turn)


# Actuators ------------------------------------------------------------------------------------------------------------


def switching(commands, first, Ts, rising, falling):
    """When one input changes and to what: [(instant, level)], from before all time on.

    ``commands`` are issued every Ts from the time ``first`` on. An edge arrives ``rising`` or ``falling`` seconds later;
    one that would arrive no later than the one before it swallows that one.
    """
    edges = [(-np.inf, commands[0])]
    for k, (before, now) in enumerate(pairwise(commands), start=1):
        if now == before:
            continue
        instant = first + k * Ts + (rising if now > before else falling)
        while edges[-1][0] >= instant - 1e-9 * Ts:
            edges.pop()
        edges.append((instant, now))
    return edges


def level_at(edges, t):
    """The level in force at t."""
    return [level for instant, level in edges if instant <= t][-1]


def integrated(plant, x, Ts, edges, steps, *, load=None, w=None, stuck=()):
    """x at 0, Ts, ..., by an ODE solver from one change of anything to the next.

    edges: as `switching` gives them, per input. load and w: one row per period. stuck: (input, level, start, end).
    """
    instants = {k * Ts for k in range(steps + 1)} | {t for each in edges for t, _ in each if 0.0 < t < steps * Ts}
    instants |= {t for _, _, *window in stuck for t in window if t < steps * Ts}
    rows, x = [x], np.array(x, dtype=float)
    for a, b in pairwise(sorted(instants)):
        if b - a > 1e-12 * Ts:
            middle = 0.5 * (a + b)
            u = np.array([level_at(each, middle) for each in edges])
            for j, level, start, end in stuck:
                if start < middle < end:
                    u[j] = level
            push = plant.B @ (u - plant.u_offset + (0.0 if load is None else load[floor(middle / Ts)]))
            if w is not None:
                push = push + plant.E @ w[floor(middle / Ts)]
            solved = solve_ivp(lambda t, z, c=push: plant.A @ z + c, (a, b), x, "DOP853", rtol=1e-12, atol=1e-13)
            x = solved.y[:, -1]
        if b == len(rows) * Ts:
            rows.append(x)
    return np.array(rows)


# Sensors --------------------------------------------------------------------------------------------------------------


def newest(steps, seed, Ts, *, missing=0.0, late=0.0, outages=()):
    """Which sample the law is given at each t_k: the newest of those that came in during the last period, or None."""
    given = [None] * steps
    for sample in range(steps):
        t = sample * Ts
        gone = any(start - 1e-9 * Ts <= t < end - 1e-9 * Ts for start, end in outages)
        if not gone and uniform(seed, LOST, sample) >= missing:
            under_way = late * uniform(seed, LATE, sample)
            k = sample
            while (k - sample) * Ts < under_way:
                k += 1
            if k < steps:
                given[k] = sample  # one taken later is newer
    return given


def reading(x, sample, seed, *, deviation=None, quantum=None, low=None, high=None):
    """What the sensor makes of the state x (n,) at a sample."""
    value = np.array(x, dtype=float)
    n = len(value)
    for i in range(n):
        if deviation is not None:
            value[i] += deviation[i] * normal(seed, SENSOR, sample * n + i)
        if quantum is not None and quantum[i] > 0:
            value[i] = quantum[i] * floor(value[i] / quantum[i] + 0.5)
        if low is not None:
            value[i] = min(max(value[i], low[i]), high[i])
    return value


def statuses(given, bad_limit=None):
    """The controller's status by name for each period, from whether it was given a sample."""
    names, bad, primed = [], 0, False
    for good in given:
        bad, primed = (0, True) if good else (bad + 1, primed)
        if good:
            names.append("OK")
        elif bad_limit is not None and bad >= bad_limit:
            names.append("SAFE")
        else:
            names.append("COASTING" if primed else "HELD")
    return names
