"""Every design-time mistake that a caller can make, with what must be said of it."""

import numpy as np
import pytest
from scipy import signal

import control
import foreswitch as fsw
from foreswitch._helpers.mistake import Mistake
from foreswitch.baselines import PIPWM, Relay, SmithPWM
from systems import OVEN, TWO_BY_TWO, VALVE, valve_controller

NAN, INF = float("nan"), float("inf")
CONTROLLER = valve_controller()
VENTED = valve_controller(VALVE.replace(E=[[-1.0], [0.0]]))
OBJECTIVE = fsw.Endpoint(0.02, 2500.0)
HORIZON = fsw.Controller(VALVE, [0, 1], 1e-3, fsw.Horizon(5))


def build(*, plant=VALVE, levels=(0, 1), Ts=1e-3, objective=OBJECTIVE, **options):
    return fsw.Controller(plant, levels, Ts, objective, **options)


def two(**options):
    return fsw.Controller(TWO_BY_TWO, [[0, 1], [0, 1, 2]], 0.1, fsw.Endpoint(1.0, 1.0), **options)


def plant(A=((0.0,),), B=((1.0,),), C=None, **options):
    return fsw.Plant(A, B, C, **options)


def run(reference=0.0, duration=0.01, controller=CONTROLLER, **options):
    return fsw.simulate(controller, reference, duration, **options)


def at(t, value):
    """A reference that returns something odd from a time on."""
    return lambda times: np.where(times > t, value, 0.0)


MISTAKES = {
    # plants
    "A not square": (lambda: plant([[0, 1]]), r"A has shape \(1, 2\)"),
    "A empty": (lambda: plant(np.zeros((0, 0))), r"A has shape \(0, 0\)"),
    "A text": (lambda: plant("ab"), "A is 'ab'"),
    "A NaN": (lambda: plant([[NAN]]), "A holds NaN"),
    "A missing": (lambda: plant(None), "A is None"),
    "B rows": (lambda: plant(B=[[1], [2]]), r"B has shape \(2, 1\)"),
    "C columns": (lambda: plant(C=[[1, 2]]), r"C has shape \(1, 2\)"),
    "E rows": (lambda: plant(E=[[1], [2]]), r"E has shape \(2, 1\)"),
    "dead time < 0": (lambda: plant(input_delay=-0.1), r"input_delay is -0\.1"),
    "dead time NaN": (lambda: plant(input_delay=NAN), "input_delay holds NaN"),
    "dead times, one too many": (lambda: plant(input_delay=[1, 2]), r"input_delay has shape \(2,\)"),
    "u_offset shape": (lambda: plant(u_offset=[1, 2]), r"u_offset has shape \(2,\)"),
    "y_offset infinite": (lambda: plant(y_offset=INF), "y_offset holds NaN or infinity"),
    "names, one too many": (lambda: plant(input_names=["a", "b"]), r"input_names is \['a', 'b'\]"),
    "names twice": (lambda: plant(B=[[1, 1]], input_names=["a", "a"]), r"input_names is \['a', 'a'\]"),
    "fopdt L < 0": (lambda: fsw.Plant.fopdt(1, 1, -1), "L is -1"),
    "fopdt T = 0": (lambda: fsw.Plant.fopdt(1, 0, 1), "T is 0"),
    "integrator_lag L NaN": (lambda: fsw.Plant.integrator_lag(1, 1, NAN), "L is nan"),
    "integrator_lag c < 0": (lambda: fsw.Plant.integrator_lag(1, -1, 0), "c is -1"),
    "tf feedthrough": (
        lambda: fsw.Plant.from_tf([1, 2], [3, 4]),
        "num has degree 1 and den 1, which is direct feedthrough",
    ),
    "tf zero": (lambda: fsw.Plant.from_tf([0, 0], [1, 1]), "num is zero"),
    "tf infinite": (lambda: fsw.Plant.from_tf([1], [0]), "den is zero"),
    "tf matrix": (lambda: fsw.Plant.from_tf([[1, 0], [0, 2]], [1, 2, 3]), r"num has shape \(2, 2\)"),
    "replace": (lambda: VALVE.replace(dead_time=1), "no argument 'dead_time'"),
    "ss feedthrough": (lambda: fsw.Plant.from_control(control.ss(-1, 1, 1, 2)), r"D = \[\[2\.0\]\]"),
    "tf matrix feedthrough": (
        lambda: fsw.Plant.from_control(control.tf([[[1], [1, 1]]], [[[1, 1], [1, 2]]])),
        "direct feedthrough",
    ),
    "tf matrix zero": (lambda: fsw.Plant.from_control(control.tf([[[0], [0]]], [[[1], [1]]])), "sys is zero"),
    "discrete ss": (lambda: fsw.Plant.from_control(control.ss(-1, 1, 1, 0, dt=0.1)), r"sys is discrete \(dt = 0\.1\)"),
    "discrete tf": (lambda: fsw.Plant.from_control(control.tf([1], [1, 1], dt=True)), r"sys is discrete \(dt = True\)"),
    "discrete scipy": (
        lambda: fsw.Plant.from_control(signal.dlti([1], [1, 0.5], dt=0.2)),
        r"sys is discrete \(dt = 0\.2\)",
    ),
    "discrete scipy zpk": (
        lambda: fsw.Plant.from_control(signal.dlti([], [0.5], 1.0)),
        r"sys is discrete \(dt = True\)",
    ),
    "no system": (lambda: fsw.Plant.from_control("1/s"), "sys is a str"),
    "dead times of a tf": (
        lambda: fsw.Plant.from_control(control.tf([1], [1, 1]), input_delay=[1, 2]),
        r"input_delay has shape \(2,\)",
    ),
    # objectives
    "Td <= 0": (lambda: fsw.Endpoint(0, 1), "Td is 0"),
    "Td text": (lambda: fsw.Endpoint("0.02", 1), r"Td is '0\.02'"),
    "Td NaN": (lambda: fsw.Endpoint(NAN, 1), "Td is nan"),
    "Td < Ts": (lambda: build(objective=fsw.Endpoint(5e-4, 1)), r"Td is 0\.0005; it must be at least .* Ts = 0\.001"),
    "lam = 0": (lambda: fsw.Endpoint(1, 0), "lam is 0"),
    "lam missing": (lambda: fsw.Endpoint(1, None), "lam is None"),
    "lam, one too many": (lambda: build(objective=fsw.Endpoint(0.02, [1, 2])), r"lam has shape \(2,\)"),
    "weight < 0": (lambda: fsw.Endpoint(1, 1, weight=-1), "weight is -1"),
    "weight all 0": (lambda: fsw.Endpoint(1, 1, weight=[0, 0]), r"weight is \[0, 0\]"),
    "tail": (lambda: fsw.Endpoint(1, 1, tail="rust"), "tail is 'rust'; did you mean 'rest'"),
    "relative degree 0": (lambda: build(objective=fsw.Endpoint(0.02, 1, relative_degree=0)), "relative_degree is 0"),
    "relative degree > n": (lambda: build(objective=fsw.Endpoint(0.02, 1, relative_degree=3)), "relative_degree is 3"),
    "relative degree 1.5": (
        lambda: build(objective=fsw.Endpoint(0.02, 1, relative_degree=1.5)),
        r"relative_degree is 1\.5",
    ),
    # long horizons
    "steps 0": (lambda: fsw.Horizon(0), "steps is 0; give a whole number from 1 to 64"),
    "steps many": (lambda: fsw.Horizon(65), "steps is 65; give a whole number from 1 to 64"),
    "steps broken": (lambda: fsw.Horizon(2.5), r"steps is 2\.5"),
    "steps NaN": (lambda: fsw.Horizon(NAN), "steps is nan"),
    "steps infinite": (lambda: fsw.Horizon(INF), "steps is inf"),
    "steps text": (lambda: fsw.Horizon("ten"), "steps is 'ten'"),
    "steps missing": (lambda: fsw.Horizon(None), "steps is None"),
    "moves 0": (lambda: fsw.Horizon(5, moves=0), "moves is 0; give a whole number from 1 to 5"),
    "moves beyond": (lambda: fsw.Horizon(5, moves=6), "moves is 6; give a whole number from 1 to 5"),
    "moves text": (lambda: fsw.Horizon(5, moves="all"), "moves is 'all'"),
    "window one": (lambda: fsw.Horizon(5, window=3), "window is 3; give the first and the last"),
    "window three": (lambda: fsw.Horizon(5, window=(1, 2, 3)), r"window is \(1, 2, 3\)"),
    "window early": (lambda: fsw.Horizon(5, window=(0, 3)), "window is 0; give a whole number from 1 to 5"),
    "window late": (lambda: fsw.Horizon(5, window=(1, 6)), "window is 6; give a whole number from 1 to 5"),
    "window backwards": (lambda: fsw.Horizon(5, window=(4, 2)), "window is 2; give a whole number from 4 to 5"),
    "window text": (lambda: fsw.Horizon(5, window="15"), "window is '15'"),
    "steps true": (lambda: fsw.Horizon(True), "steps is True"),
    "window broken": (lambda: fsw.Horizon(5, window=(1, 2.5)), r"window is 2\.5; give a whole number from 1 to 5"),
    "horizon weight beyond all numbers": (
        lambda: build(objective=fsw.Horizon(5, weight=1e308)),
        "steps is 5, too long for",
    ),
    "window ragged": (lambda: fsw.Horizon(5, window=[1, [2, 3]]), r"window is \[2, 3\]; give one number"),
    "horizon weight < 0": (lambda: fsw.Horizon(5, weight=-1), "weight is -1"),
    "horizon weight 0": (lambda: fsw.Horizon(5, weight=0), "weight is 0"),
    "horizon weight NaN": (lambda: fsw.Horizon(5, weight=NAN), "weight holds NaN"),
    "horizon lam 0": (lambda: fsw.Horizon(5, lam=0), "lam is 0; it must be greater than 0"),
    "horizon lam NaN": (lambda: fsw.Horizon(5, lam=NAN), "lam holds NaN"),
    "move_weight < 0": (lambda: fsw.Horizon(5, move_weight=-1), "move_weight is -1; it must be at least 0"),
    "move_weight text": (lambda: fsw.Horizon(5, move_weight="some"), "move_weight is 'some'"),
    "horizon tail": (lambda: fsw.Horizon(5, tail="held"), "tail is 'held'; did you mean 'hold'"),
    "terminal word": (lambda: fsw.Horizon(5, terminal="ricatti"), "terminal is 'ricatti'; give 'riccati' or a matrix"),
    "node_budget 0": (lambda: fsw.Horizon(5, node_budget=0), "node_budget is 0; give a whole number from 1"),
    "node_budget broken": (lambda: fsw.Horizon(5, node_budget=1e3 + 0.5), r"node_budget is 1000\.5"),
    "node_budget large": (lambda: fsw.Horizon(5, node_budget=2**32), "node_budget is 4294967296"),
    "move_weight, one too many": (
        lambda: build(objective=fsw.Horizon(5, move_weight=[1, 2])),
        r"move_weight has shape \(2,\); give one number or one per input",
    ),
    "horizon weight, one too many": (
        lambda: build(objective=fsw.Horizon(5, weight=[1, 2])),
        r"weight has shape \(2,\); give one number or one per output",
    ),
    "horizon lam, one too many": (
        lambda: build(objective=fsw.Horizon(5, lam=[1, 2])),
        r"lam has shape \(2,\); give one number or one per output",
    ),
    "horizon relative degree": (
        lambda: build(objective=fsw.Horizon(5, lam=1, relative_degree=3)),
        "relative_degree is 3",
    ),
    "terminal shape": (
        lambda: build(objective=fsw.Horizon(5, terminal=[[1.0]])),
        r"terminal has shape \(1, 1\); shape \(2, 2\) is needed",
    ),
    "terminal not symmetric": (
        lambda: build(objective=fsw.Horizon(5, terminal=[[1, 1], [0, 1]])),
        r"terminal is \[\[1\.0, 1\.0\], \[0\.0, 1\.0\]\]; give a symmetric matrix",
    ),
    "terminal negative": (
        lambda: build(objective=fsw.Horizon(5, terminal=[[1, 0], [0, -1]])),
        r"terminal is .*; give a symmetric matrix without negative eigenvalues",
    ),
    "terminal NaN": (lambda: build(objective=fsw.Horizon(5, terminal=[[NAN, 0], [0, 1]])), "terminal holds NaN"),
    "terminal without a law": (
        lambda: build(plant=plant([[0.5, 0], [0, 0.3]], [0, 1], [1, 1]), objective=fsw.Horizon(5, terminal="riccati")),
        "terminal is 'riccati', but the plant has a mode that no input moves or no output shows",
    ),
    "horizon too unstable": (
        lambda: fsw.Controller(plant([[900.0]]), [0, 1], 0.1, fsw.Horizon(64)),
        "steps is 64, too long for this unstable plant or these weights",
    ),
    "horizon with a lead too long": (
        lambda: fsw.Controller(plant([[0.0]], [[1, 1]], input_delay=[0.0, 0.5]), [[0, 1]] * 2, 0.1, fsw.Horizon(60)),
        r"the horizon has 65 steps \(those that the fastest input is ahead included\); the core holds up to 64",
    ),
    "horizon with too many waiting": (
        lambda: fsw.Controller(plant([[0.0]], [[1, 1]], input_delay=[0.0, 1.6]), [[0, 1]] * 2, 0.1, fsw.Horizon(5)),
        "the horizon has 17 states and waiting moves; the core holds up to 16",
    ),
    "horizon of too many candidates": (
        lambda: build(levels=np.arange(65), objective=fsw.Horizon(2)),
        "the horizon has 65 candidates; the core holds up to 64",
    ),
    "horizon preview word": (
        lambda: build(objective=fsw.Horizon(5), preview="lag"),
        "preview is 'lag'; a Horizon takes False, True or seconds",
    ),
    "horizon preview NaN": (lambda: build(objective=fsw.Horizon(5), preview=NAN), "preview is nan"),
    "horizon reference shape": (
        lambda: HORIZON.step([0, 0], np.zeros((4, 1, 1))),
        r"reference has shape \(4, 1, 1\); give \(5, 1, 1\)",
    ),
    "horizon reference derivatives": (
        lambda: HORIZON.step([0, 0], np.zeros((5, 1, 2))),
        r"reference has shape \(5, 1, 2\)",
    ),
    "horizon reference NaN": (lambda: HORIZON.step([0, 0], np.full((5, 1, 1), NAN)), "reference holds NaN"),
    "horizon x": (lambda: HORIZON.step([0], 0), r"x has shape \(1,\)"),
    "horizon pending": (lambda: HORIZON.reset(pending=[0, 1]), r"pending has shape \(2,\)"),
    # controllers
    "no plant": (lambda: build(plant=[[0]]), "plant is a list"),
    "no objective": (lambda: build(objective=0.02), r"objective is 0\.02"),
    "levels descending": (lambda: build(levels=[1, 0]), r"levels of input 1 are \[1\.0, 0\.0\]"),
    "levels twice": (lambda: build(levels=[0, 0, 1]), r"levels of input 1 are \[0\.0, 0\.0, 1\.0\]"),
    "one level": (lambda: build(levels=[1]), r"levels of input 1 have shape \(1,\)"),
    "no level": (lambda: build(levels=[]), r"levels of input 1 have shape \(0,\)"),
    "256 levels": (lambda: build(levels=np.arange(256)), r"levels of input 1 have shape \(256,\)"),
    "levels missing": (lambda: build(levels=None), "levels of input 1 is None"),
    "levels NaN": (lambda: build(levels=[0, NAN]), "levels of input 1 holds NaN"),
    "levels text": (lambda: build(levels="on"), "levels of input 1 is 'on'"),
    "levels ragged": (lambda: build(levels=[0, [1, 2]]), r"levels lists 2 input\(s\)"),
    "levels for too many": (lambda: build(levels=[[0, 1], [0, 1]]), r"levels lists 2 input\(s\); the plant has 1"),
    "too many combinations": (
        lambda: build(plant=plant(B=[[1, 2, 3]]), levels=[np.arange(41)] * 3),
        "levels form 68921 combinations",
    ),
    "Ts = 0": (lambda: build(Ts=0), "Ts is 0"),
    "Ts < 0": (lambda: build(Ts=-1e-3), r"Ts is -0\.001"),
    "Ts beyond all numbers": (lambda: build(Ts=10**400), "Ts is 1000.* give one number"),
    "u_offset beyond all numbers": (lambda: plant(u_offset=[10**400]), r"u_offset is \[1000.* give numbers"),
    "x beyond all numbers": (lambda: CONTROLLER.step([10**400, 0], 0), r"x is \[1000.* give 2 number"),
    "Ts NaN": (lambda: build(Ts=NAN), "Ts is nan"),
    "Ts array": (lambda: build(Ts=np.array([0.1])), r"Ts is \[0\.1\]"),
    "Ts text": (lambda: build(Ts="1 ms"), "Ts is '1 ms'"),
    "min_on < 0": (lambda: build(min_on=-1), "min_on is -1"),
    "min_on, one too many": (lambda: build(min_on=[0, 0]), r"min_on has shape \(2,\)"),
    "min_off NaN": (lambda: build(min_off=NAN), "min_off holds NaN"),
    "min_on beyond the core": (lambda: build(min_on=1e9), r"min_on is 1e\+09 s"),
    "min_off beyond the core": (lambda: build(min_off=1e9), r"min_off is 1e\+09 s"),
    "switch_cost < 0": (lambda: build(switch_cost=-1), "switch_cost is -1"),
    "forbidden number": (lambda: build(forbidden=1), "forbidden is 1"),
    "forbidden no level": (lambda: two(forbidden=[(0, 3)]), "forbidden holds 3; the levels of input 2"),
    "forbidden ragged": (lambda: two(forbidden=[(0, 1), (1,)]), r"forbidden is \[1\]"),
    "forbidden all": (lambda: build(forbidden=[1]), r"forbidden leaves 1 command\(s\)"),
    "forbidden safe level": (lambda: two(forbidden=[(0, 0)]), r"forbidden contains the safe level \[0\.0, 0\.0\]"),
    "preview word": (lambda: build(preview="leg"), "preview is 'leg'"),
    "preview NaN": (lambda: build(preview=NAN), "preview is nan"),
    "preview of no lag": (
        lambda: build(plant=fsw.Plant.from_tf([1, 0], [1, 3, 2]), preview="lag"),  # a speed: DC gain 0
        "preview is 'lag', but the loop has no lag",
    ),
    "safe_level no level": (lambda: build(safe_level=0.5), r"safe_level holds 0\.5"),
    "safe_level, one missing": (lambda: two(safe_level=[0]), r"safe_level is \[0\]"),
    "bad_limit 0": (lambda: build(bad_limit=0), "bad_limit is 0"),
    "bad_limit large": (lambda: build(bad_limit=65536), "bad_limit is 65536"),
    "bad_limit broken": (lambda: build(bad_limit=2.5), r"bad_limit is 2\.5"),
    "bad_limit text": (lambda: build(bad_limit="few"), "bad_limit is 'few'"),
    "real": (lambda: build(real="float16"), "real is 'float16'"),
    "no effect of any input": (
        lambda: build(plant=plant([[0, 1], [0, 0]], [1, 0], [0, 1])),
        r"no candidate effect \(h = 0\)",
    ),
    "no effect of one input": (
        lambda: fsw.Controller(plant(B=[[1, 0]]), [[0, 1], [0, 1]], 0.1, fsw.Endpoint(1, 1)),
        r"input 2 has no effect .* \(h = 0\)",
    ),
    "dead time too long": (lambda: build(plant=fsw.Plant.fopdt(1, 1, 70)), "70001 periods of dead time"),
    "dead time absurdly long": (
        lambda: build(plant=fsw.Plant.fopdt(1, 1, 1e12)),
        "1000000000000001 periods of dead time",
    ),
    "states too many": (lambda: build(plant=fsw.Plant.from_tf([1], np.ones(66))), "plant has 65 states"),
    "horizon overflows": (
        lambda: fsw.Controller(plant([[9.0]]), [0, 1], 0.1, fsw.Endpoint(100, 1)),
        "Td = 100 s is too long for this unstable plant",
    ),
    # starting
    "pending too short": (lambda: CONTROLLER.reset(pending=[0, 1]), r"pending has shape \(2,\)"),
    "pending no level": (lambda: CONTROLLER.reset(pending=[0, 0, 0, 0, 2]), "pending holds 2"),
    "pending too wide": (lambda: CONTROLLER.reset(pending=np.zeros((5, 2))), r"pending has shape \(5, 2\)"),
    "pending forbidden": (
        lambda: two(forbidden=[(1, 2)]).reset(pending=[(1, 2)] * 5),
        r"forbidden command \[1\.0, 2\.0\]",
    ),
    "elapsed < 0": (lambda: CONTROLLER.reset(elapsed=-1), "elapsed is -1"),
    "elapsed NaN": (lambda: CONTROLLER.reset(elapsed=NAN), "elapsed holds NaN"),
    "elapsed, one too many": (lambda: CONTROLLER.reset(elapsed=[1, 2]), r"elapsed has shape \(2,\)"),
    # stepping
    "reference NaN": (lambda: CONTROLLER.step([0, 0], NAN), "reference holds NaN"),
    "reference infinite": (lambda: CONTROLLER.step([0, 0], [0, -INF]), "reference holds NaN or infinity"),
    "reference NaN, canonical": (lambda: CONTROLLER.step(np.zeros(2), np.full((1, 1, 2), NAN)), "reference holds NaN"),
    "reference NaN to decide": (lambda: CONTROLLER.decide([0, 0], NAN), "reference holds NaN"),
    "reference NaN in single": (lambda: valve_controller(real="float32").step([0, 0], NAN), "reference holds NaN"),
    "reference too many derivatives": (lambda: CONTROLLER.step([0, 0], [0, 0, 0]), r"reference has shape \(3,\)"),
    "reference empty": (lambda: CONTROLLER.step([0, 0], []), r"reference has shape \(0,\)"),
    "reference of two evaluations": (
        lambda: CONTROLLER.step([0, 0], np.zeros((2, 1, 2))),
        r"reference has shape \(2, 1, 2\)",
    ),
    "reference text": (lambda: CONTROLLER.step([0, 0], "up"), "reference is 'up'"),
    "reference missing": (lambda: CONTROLLER.step([0, 0], None), "reference is None"),
    "x too long": (lambda: CONTROLLER.step([0, 0, 0], 0), r"x has shape \(3,\)"),
    "x number": (lambda: CONTROLLER.step(0, 0), r"x has shape \(\)"),
    "x column": (lambda: CONTROLLER.step([[0], [0]], 0), r"x has shape \(2, 1\)"),
    "x text": (lambda: CONTROLLER.step("ab", 0), "x is 'ab'"),
    "x missing": (lambda: CONTROLLER.step(None, 0), "x is None"),
    "disturbance unknown": (lambda: CONTROLLER.step([0, 0], 0, disturbance=[1.0]), r"disturbance has shape \(1,\)"),
    "disturbance too long": (lambda: VENTED.step([0, 0], 0, disturbance=[1, 2]), r"disturbance has shape \(2,\)"),
    # simulating
    "duration 0": (lambda: run(duration=0), "duration is 0"),
    "duration NaN": (lambda: run(duration=NAN), "duration is nan"),
    "x0 shape": (lambda: run(x0=[1]), r"x0 has shape \(1,\)"),
    "x0 text": (lambda: run(x0="rest"), "x0 is 'rest'; give numbers"),
    "x0 ragged": (lambda: run(x0=[[1], [1, 2]]), r"x0 is \[\[1\], \[1, 2\]\]; give numbers"),
    "x0 NaN": (lambda: run(x0=[NAN, 0]), "x0 holds NaN"),
    "noise < 0": (lambda: run(noise=-1), "noise is -1"),
    "noise shape": (lambda: run(noise=[1, 2, 3]), r"noise has shape \(3,\)"),
    "seed": (lambda: run(noise=1, seed=-3), "seed is -3"),
    "disturbance of none": (lambda: run(disturbance=1.0), "disturbance is given, but the plant has none"),
    "disturbance rows": (lambda: run(controller=VENTED, disturbance=np.zeros(7)), r"disturbance has shape \(7,\)"),
    "load shape": (lambda: run(load=[1, 2, 3]), r"load has shape \(3,\)"),
    "load NaN": (lambda: run(load=NAN), "load holds NaN"),
    "load returns NaN": (lambda: run(load=lambda t, x: NAN), r"load returned \[nan\] at t = 0 s"),
    "load returns two": (lambda: run(load=lambda t, x: [1, 2]), r"load returned \[1\.0, 2\.0\]"),
    "simulated reference NaN": (lambda: run(NAN), "reference holds NaN"),
    "simulated reference NaN later": (lambda: run(at(0.0049, NAN)), r"reference is not finite at t = 0\.005 s"),
    "simulated reference infinite ahead": (
        lambda: run(at(0.0299, INF), 0.02, valve_controller(preview=True)),
        r"reference is not finite at t = 0\.03 s",
    ),
    "simulated reference of three": (lambda: run([1, 2, 3]), r"reference has shape \(3,\)"),
    "simulated reference rows": (lambda: run(lambda t: np.zeros(3)), r"reference returned shape \(3, 1, 1\)"),
    "simulated reference of two outputs": (
        lambda: run(fsw.Stack(fsw.Ramp(1), fsw.Ramp(2))),
        r"reference returned shape \(11, 2, 1\)",
    ),
    "truth no plant": (lambda: run(plant=3), "plant is a int"),
    "truth of two inputs": (lambda: run(plant=TWO_BY_TWO), r"plant has 2 input\(s\), 2 output\(s\)"),
    "truth of one state": (lambda: run(plant=OVEN), "plant has 1 states and the controller's model 2"),
    "sensor shape": (lambda: run(sensor=[1, 2, 3]), r"sensor has shape \(1, 3\)"),
    # references
    "sine frequency": (lambda: fsw.Sine(1, 0), "frequency is 0"),
    "sine amplitude": (lambda: fsw.Sine(NAN, 1), "amplitude is nan"),
    "half sine": (lambda: fsw.HalfSine(1, 0), "duration is 0"),
    "ramp": (lambda: fsw.Ramp("steep"), "slope is 'steep'"),
    "ramp of text": (lambda: fsw.Ramp("3"), "slope is '3'"),
    "steps of two lengths": (lambda: fsw.Steps([0, 1], [1]), r"t has shape \(2,\) and y \(1,\)"),
    "samples at one time": (lambda: fsw.Samples([0, 0], [1, 2]), "t goes from 0 to 0 at sample 2"),
    "samples NaN": (lambda: fsw.Samples([0, 1], [1, NAN]), "y holds NaN"),
    "samples none": (lambda: fsw.Samples([], []), r"t has shape \(0,\)"),
    "samples kind": (lambda: fsw.Samples([0, 1], [1, 2], kind="spline"), "kind is 'spline'"),
    "stack empty": (lambda: fsw.Stack(), "Stack is empty"),
    "stack of a number": (lambda: fsw.Stack(3), "Stack holds 3"),
    # baselines
    "baseline of no plant": (lambda: Relay([[0]], [0, 1], 0.1), "plant is a list"),
    "baseline levels": (lambda: Relay(TWO_BY_TWO, [0, 1], 0.1), r"levels lists 1 input\(s\); the plant has 2"),
    "baseline hysteresis": (lambda: Relay(VALVE, [0, 1], 0.1, hysteresis=-1), "hysteresis is -1"),
    "baseline carrier": (lambda: PIPWM(VALVE, [0, 1], 0.1, kp=1, carrier=0.01), r"carrier is 0\.01"),
    "baseline kp": (lambda: PIPWM(VALVE, [0, 1], 0.1, kp=NAN, carrier=1), "kp is nan"),
    "baseline Ts": (lambda: PIPWM(VALVE, [0, 1], 0, kp=1, carrier=1), "Ts is 0"),
    "Smith of an unstable plant": (lambda: SmithPWM(plant([[1.0]]), [0, 1], 0.1, kp=1, carrier=1), "unstable pole 1"),
    "baseline x": (lambda: Relay(VALVE, [0, 1], 0.1).step([0, 0, 0], 0.0), r"x has shape \(3,\)"),
    "baseline reference": (lambda: Relay(VALVE, [0, 1], 0.1).step([0, 0], NAN), "reference holds NaN"),
    "baseline disturbance": (
        lambda: Relay(VALVE, [0, 1], 0.1).step([0, 0], 0, disturbance=[1]),
        r"disturbance has shape \(1,\)",
    ),
}


def caught(act):
    with pytest.raises(Mistake) as raised:
        act()
    return raised.value


UNKNOWN = {
    "Plant": lambda: plant(dead_time=1),
    "Plant.fopdt": lambda: fsw.Plant.fopdt(1, 1, 1, dead_time=1),
    "Plant.from_tf": lambda: fsw.Plant.from_tf([1], [1, 1], dead_time=1),
    "Endpoint": lambda: fsw.Endpoint(1, 1, dead_time=1),
    "Horizon": lambda: fsw.Horizon(1, dead_time=1),
    "Controller": lambda: build(dead_time=1),
    "reset": lambda: CONTROLLER.reset(dead_time=1),
    "step": lambda: CONTROLLER.step([0, 0], 0, dead_time=1),
    "simulate": lambda: run(dead_time=1),
    "Samples": lambda: fsw.Samples([0, 1], [0, 1], dead_time=1),
    "Relay": lambda: Relay(VALVE, [0, 1], 0.1, dead_time=1),
    "PIPWM": lambda: PIPWM(VALVE, [0, 1], 0.1, kp=1, carrier=1, dead_time=1),
}
