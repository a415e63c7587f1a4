"""Random designs of every kind of plant, for the certificate's adversary."""

import numpy as np

import foreswitch as fsw
from systems import quiet

KINDS = ("stable", "integrator", "double integrator", "oscillator", "unstable")
#: Inputs and outputs, and how often.
SHAPES = {(1, 1): 0.5, (2, 2): 0.18, (2, 1): 0.1, (1, 2): 0.15, (3, 3): 0.02, (3, 2): 0.05}


def modes(rng, kind, order):
    """A in units of 1 / Ts, in a basis of its own."""
    rate = np.exp(rng.uniform(np.log(0.02), np.log(0.6), order))
    A = np.diag(-rate)
    if kind == "integrator":
        A[0, 0] = 0.0
    elif kind == "double integrator" and order > 1:
        A[:2, :2] = [[0.0, 1.0], [0.0, 0.0]]
    elif kind == "oscillator" and order > 1:
        w, damping = np.exp(rng.uniform(np.log(0.03), np.log(1.5))), rng.choice([0.0, 0.01, 0.1, 0.3])
        A[:2, :2] = [[-damping * w, w], [-w, -damping * w]]
    elif kind == "unstable":
        A[0, 0] = 0.5 * rate[0]
        if order > 2 and rng.uniform() < 0.3:
            A[1, 1] = 0.3 * rate[1]
    if rng.uniform() < 0.3:  # fast between the instants
        A[-1, -1] = min(A[-1, -1], -rng.uniform(1.0, 4.0)) if order > 2 else A[-1, -1]
    return A


def draw_plant(rng, kind, order, m, q, Ts):
    """A plant of a kind in a basis of its own, with offsets and dead times."""
    A = modes(rng, kind, order) / Ts
    turn = np.eye(order) + 0.5 * rng.normal(size=(order, order)) if rng.uniform() < 0.7 else np.eye(order)
    if abs(np.linalg.det(turn)) < 0.1:
        turn = np.eye(order)
    back = np.linalg.inv(turn)
    B, C = rng.normal(size=(order, m)) * np.exp(rng.normal(size=m)), rng.normal(size=(q, order))
    if m > 1 and order >= max(m, q) and rng.uniform() < 0.7:  # outputs that the inputs command one by one, or nearly
        C = np.linalg.lstsq(B.T, (np.eye(q, m) + 0.2 * rng.normal(size=(q, m))).T, rcond=None)[0].T
    A, B, C = turn @ A @ back, turn @ B / Ts, C @ back
    if m == q == 1 and rng.uniform() < 0.5:  # no zeros
        row = np.linalg.lstsq(
            np.column_stack([np.linalg.matrix_power(A * Ts, i) @ B[:, 0] * Ts for i in range(order)]).T,
            np.eye(order)[-1],
            rcond=None,
        )[0]
        C = row[None] / max(np.abs(row).max(), 1e-9)
    tau = Ts * rng.choice([0.0, 0.4, 1.0, 2.3, 3.0, 5.7, 0.3]) * np.ones(m)
    if m > 1 and rng.uniform() < 0.6:
        tau = Ts * rng.choice([0.0, 0.25, 1.0, 1.6, 2.0, 3.3], m)
    u_offset = rng.choice([0.0, 0.3], m)
    return fsw.Plant(A, B, C, input_delay=tau, u_offset=u_offset, y_offset=rng.choice([0.0, 5.0], q))


def draw_levels(rng, m, q):
    """Levels of each input, even or not, and the commands that are forbidden."""
    levels = []
    for _ in range(m):
        count = int(rng.choice([2, 2, 3, 3, 5, 9] if m == 1 else [2, 3, 3, 4] if m == 2 else [2, 2, 2]))
        values = np.arange(count) - (0.5 * (count - 1) if m > q else rng.choice([0.0, 0.5 * (count - 1)]))
        levels.append(values if m > q or rng.uniform() < 0.6 else np.cumsum(rng.uniform(0.3, 1.5, count)) - 0.4 * count)
    forbidden = []
    if rng.uniform() < 0.15 and np.prod([len(v) for v in levels]) > 3:
        forbidden = [[float(rng.choice(v)) for v in levels]]
    return levels, forbidden


def draw_errors(rng, B, rows, Ts):
    """Errors to be borne: noise of the rows that are measured, of what a pulse of an input moves them; and others."""
    errors = {}
    if rng.uniform() < 0.4:
        pulse = np.abs(rows @ B * Ts).max(axis=1)
        errors["noise"] = rng.uniform(0.0, 0.5) * pulse * rng.integers(0, 2, len(rows))
    if rng.uniform() < 0.3:
        errors["delay_error"] = Ts * rng.choice([0.05, 0.2, 0.5, 1.0, 1.7]) * rng.integers(0, 2, B.shape[1])
    if rng.uniform() < 0.3:
        errors["gain_error"] = rng.choice([0.01, 0.05, 0.2]) * np.ones(B.shape[1])
    if rng.uniform() < 0.15:
        errors["load"] = rng.choice([0.01, 0.1]) * np.ones(B.shape[1])
    return errors


def draw(seed):
    """A controller, or None where there is none, with its kind and the errors to be borne."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    m, q = list(SHAPES)[rng.choice(len(SHAPES), p=list(SHAPES.values()))]
    order = int(rng.integers(max(2 if kind in ("double integrator", "oscillator") else 1, min(m, q)), 5))
    Ts = float(np.exp(rng.uniform(np.log(1e-3), np.log(2.0))))
    plant = draw_plant(rng, kind, order, m, q, Ts)
    levels, forbidden = draw_levels(rng, m, q)
    Td = Ts * rng.choice([1.0, 1.5, 2.0, 4.0, 8.0, 15.0])
    lam = np.exp(rng.uniform(np.log(0.1), np.log(20.0), q)) / Ts
    objective = fsw.Endpoint(
        Td,
        lam,
        tail=str(rng.choice(["rest", "rest", "zero"])),
        weight=np.exp(rng.normal(size=q)) if q > 1 else 1.0,
    )
    estimator = None
    if rng.uniform() < 0.25:
        loads = 1e-3 * (rng.uniform(size=m) < 0.5) if rng.uniform() < 0.6 else None
        estimator = fsw.Kalman(
            10.0 ** rng.uniform(-4, 0), 10.0 ** rng.uniform(-3, 0), load=loads, gate=rng.choice([0, 6.0])
        )
    price = 0.0
    options = {"forbidden": forbidden, "estimator": estimator}
    try:
        controller = quiet(fsw.Controller, plant, levels, Ts, objective, **options)
        if rng.uniform() < 0.15:
            h = np.array([row[0] for row in controller.law.rows.hold]).T
            price = float(rng.uniform(0.0, 0.2) * np.square(h).max())
            controller = quiet(fsw.Controller, plant, levels, Ts, objective, switch_cost=price, **options)
    except ValueError:
        return kind, None, {}
    return kind, controller, draw_errors(rng, plant.B, plant.C if estimator else np.eye(order), Ts)


def certified(controller, errors):
    """A certificate with these errors, or with smaller ones, or None; and those errors."""
    for share in (1.0, 0.25, 0.05, 0.0):
        some = {name: share * value for name, value in errors.items()} if share else {}
        if (certificate := fsw.certify(controller, **some)).holds:
            return certificate, some
        if "pole" in certificate.reasons[0]:
            break
    return None, {}
