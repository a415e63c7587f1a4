"""Plants and controllers that several tests use, and a plant's exact response, written down independently."""

import warnings
from itertools import pairwise
from math import floor

import numpy as np
from scipy.linalg import expm

import foreswitch as fsw

# The hot-gas example of Shields, Barth and Goldfarb (2006): kPa, s.
VALVE = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
RISE = fsw.HalfSine(height=1000.0, duration=0.5)
SENSOR = fsw.Kalman([0.0, 1e4], 4.0, load=1e-6)  # 2 kPa of noise, a slope known to 100 kPa/s

OVEN = fsw.Plant.fopdt(K=100.0, T=100.0, L=20.0)
MASS = fsw.Plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], input_delay=0.3)
TWO_BY_TWO = fsw.Plant(
    [[-1.0, 0.4, 0.0], [-0.3, -0.7, 0.2], [0.1, 0.0, -0.5]],
    [[1.0, 0.2], [0.1, 0.8], [0.3, 0.5]],
    [[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]],
    input_delay=[0.37, 0.15],
)


def valve_controller(plant=VALVE, *, Td=0.020, lam=2500.0, tail="rest", **options):
    """The paper's controller, or one that differs from it."""
    return fsw.Controller(plant, [0.0, 1.0], 1e-3, fsw.Endpoint(Td, lam, tail=tail), **options)


def quiet(build, *arguments, **options):
    """Build something whose warning is not the point."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return build(*arguments, **options)


def level_runs(u):
    """Lengths of the maximal constant runs of a sequence, and their values."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(u)) + 1, [len(u)]])
    return np.diff(starts), np.asarray(u)[starts[:-1]]


def exact_state(plant, x, Ts, history, end, *, load=None, w=None):
    """x(end) from x(0): one matrix exponential per piece of constant input.

    ``history`` is a pair: commands issued every Ts before time 0, and from 0 on. load and w are one row per period,
    undelayed.
    """
    past, future = (np.asarray(part, dtype=float).reshape(-1, plant.inputs) for part in history)
    commands = np.vstack([past, future])
    instants = {0.0, end}
    for tau in plant.input_delay:
        instants.update(t for k in range(-len(past), len(future) + 1) if 0 < (t := k * Ts + tau) < end)
    instants.update(t for k in range(len(future) + 1) if 0 < (t := k * Ts) < end)
    n = plant.states
    for a, b in pairwise(sorted(instants)):
        middle = 0.5 * (a + b)
        rows = [min(floor((middle - tau) / Ts) + len(past), len(commands) - 1) for tau in plant.input_delay]
        period = floor(middle / Ts)
        u = np.array([commands[max(row, 0), j] for j, row in enumerate(rows)])
        push = plant.B @ (u - plant.u_offset + (0.0 if load is None else load[period]))
        if w is not None:
            push = push + plant.E @ w[period]
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n] = plant.A, push
        x = (expm(block * (b - a)) @ np.append(x, 1.0))[:n]
    return x
