"""Plants that are not linear: a Python function, or an FMU, in the same closed loop."""

from __future__ import annotations

import contextlib
import shutil
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake, shown

__all__ = ["FmuPlant", "NonlinearPlant", "SteppedPlant"]


class SteppedPlant(ABC):
    """A simulated truth that is stepped from one switching instant to the next.

    Parameters
    ----------
    states, inputs, outputs, disturbances : int
        Sizes n, m, q, p.
    input_delay : float or array_like, shape (m,)
        Dead time [s].
    input_names, output_names : sequence of str, optional
        As in `Plant`.
    """

    def __init__(
        self,
        states: int,
        inputs: int,
        outputs: int,
        disturbances: int,
        input_delay: ArrayLike,
        input_names: Sequence[str] | str | None,
        output_names: Sequence[str] | str | None,
    ) -> None:
        sizes = {"states": states, "inputs": inputs, "outputs": outputs, "disturbances": disturbances}
        for name, value in sizes.items():
            least = 0 if name == "disturbances" else 1
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise Mistake(name, value, f"give a whole number, {least} or more")
        self.states, self.inputs, self.outputs, self.disturbances = map(int, sizes.values())
        self.input_delay = check.per("input_delay", input_delay, inputs, "input", least=0.0)
        self.input_names = check.names("input_names", input_names, inputs, "u")
        self.output_names = check.names("output_names", output_names, outputs, "y")

    @abstractmethod
    def start(self, x0: Array | None) -> Array:
        """Begin a run.

        Parameters
        ----------
        x0 : ndarray, shape (n,), or None
            The initial state; None: the plant's own.

        Returns
        -------
        ndarray, shape (n,)
            The initial state.
        """

    @abstractmethod
    def advance(self, t: float, x: Array, u: Array, w: Array, duration: float) -> Array:
        """From t on under constant inputs.

        Parameters
        ----------
        t : float
            Present time [s].
        x : ndarray, shape (n,)
            Present state.
        u, w : ndarray, shape (m,) and (p,)
            Inputs that have arrived, and disturbances.
        duration : float
            How long [s].

        Returns
        -------
        ndarray, shape (n,)
            The state then.
        """

    @abstractmethod
    def output(self, x: Array) -> Array:
        """What is seen of a state.

        Parameters
        ----------
        x : ndarray, shape (n,)
            The present state.

        Returns
        -------
        ndarray, shape (q,)
        """


class NonlinearPlant(SteppedPlant):
    """``x' = f(t, x, u, w)``, ``y = h(x)``, integrated between the instants at which an input changes.

    Parameters
    ----------
    f : callable
        ``(t, x, u, w) -> x'`` with shapes (n,), (m,), (p,) -> (n,).
    h : callable
        ``x -> y``, shape (q,).
    states, inputs, outputs, disturbances : int
        Sizes n, m, q, p.
    input_delay : float or array_like, shape (m,)
        Dead time [s]; f gets the inputs that have arrived.
    input_names, output_names : sequence of str, optional
        As in `Plant`.
    rtol, atol : float
        Tolerances of the integration (SciPy's DOP853).

    Raises
    ------
    ValueError
        If a size does not fit.

    Examples
    --------
    >>> tank = NonlinearPlant(lambda t, x, u, w: [0.5 * u[0] - 0.1 * abs(x[0]) ** 0.5], lambda x: x)
    >>> tank.states, tank.inputs
    (1, 1)
    """

    def __init__(
        self,
        f: Callable[[float, Array, Array, Array], ArrayLike],
        h: Callable[[Array], ArrayLike],
        *,
        states: int = 1,
        inputs: int = 1,
        outputs: int = 1,
        disturbances: int = 0,
        input_delay: ArrayLike = 0.0,
        input_names: Sequence[str] | str | None = None,
        output_names: Sequence[str] | str | None = None,
        rtol: float = 1e-9,
        atol: float = 1e-12,
    ) -> None:
        super().__init__(states, inputs, outputs, disturbances, input_delay, input_names, output_names)
        self.f, self.h, self.rtol, self.atol = f, h, rtol, atol

    def start(self, x0: Array | None) -> Array:
        """Begin a run at x0, or at zero.

        Parameters
        ----------
        x0 : ndarray, shape (n,), or None

        Returns
        -------
        ndarray, shape (n,)
        """
        return np.zeros(self.states) if x0 is None else x0

    def advance(self, t: float, x: Array, u: Array, w: Array, duration: float) -> Array:
        """Integrate under constant inputs.

        Parameters
        ----------
        t : float
            Present time [s].
        x : ndarray, shape (n,)
            Present state.
        u, w : ndarray, shape (m,) and (p,)
            What f is given.
        duration : float
            How long [s].

        Returns
        -------
        ndarray, shape (n,)
            The state then.

        Raises
        ------
        ValueError
            If f returns another shape, is not finite at x, or cannot be integrated.
        """

        def slope(time: float, state: Array) -> Array:
            return _returned("f", self.f(time, state, u, w), self.states, time)

        _finite("f", slope(t, x), t)  # later on the solver shortens its step where it meets what is not
        from scipy.integrate import solve_ivp

        result = solve_ivp(slope, (t, t + duration), x, method="DOP853", rtol=self.rtol, atol=self.atol)
        if not result.success:
            problem = f"could not be integrated at t = {t:g} s ({result.message})"
            raise Mistake("f", x, "check it there", problem=problem)
        state: Array = result.y[:, -1]
        return state

    def output(self, x: Array) -> Array:
        """``h(x)``.

        Parameters
        ----------
        x : ndarray, shape (n,)

        Returns
        -------
        ndarray, shape (q,)

        Raises
        ------
        ValueError
            If h returns something of another shape or not finite.
        """
        return _finite("h", _returned("h", self.h(x), self.outputs))


def _returned(name: str, value: ArrayLike, size: int, t: float | None = None) -> Array:
    """What a function of the caller's returned, of the right shape."""
    result = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if result.shape != (size,):
        raise Mistake(name, result, f"give {size} value(s)", problem=f"returned {shown(result)}{_when(t)}")
    return result


def _finite(name: str, value: Array, t: float | None = None) -> Array:
    if not np.isfinite(value).all():
        raise Mistake(name, value, "give finite values", problem=f"returned {shown(value)}{_when(t)}")
    return value


def _when(t: float | None) -> str:
    return "" if t is None else f" at t = {t:g} s"


class FmuPlant(SteppedPlant):
    """An FMU for co-simulation (FMI 2.0), run by fmpy.

    Parameters
    ----------
    path : path
        The .fmu file.
    inputs : sequence of str
        Variables that take u, in order.
    outputs : sequence of str
        Variables that are y.
    states : sequence of str
        Variables that are x, which the controller measures; in the controller's order.
    disturbances : sequence of str
        Variables that take w.
    input_delay : float or array_like, shape (m,)
        Dead time [s] outside the FMU.
    start_values : dict, optional
        Parameters and initial values by name, set before initialisation.

    Raises
    ------
    ValueError
        If the file is no such FMU or a variable is missing.
    ImportError
        If fmpy is not installed.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        inputs: Sequence[str],
        outputs: Sequence[str],
        states: Sequence[str],
        disturbances: Sequence[str] = (),
        input_delay: ArrayLike = 0.0,
        start_values: dict[str, float] | None = None,
    ) -> None:
        import fmpy

        super().__init__(
            len(states), len(inputs), len(outputs), len(disturbances), input_delay, list(inputs), list(outputs)
        )
        try:
            self._description = fmpy.read_model_description(str(path))
            platforms = fmpy.supported_platforms(str(path))
        except Exception as error:
            problem = f"{path} is not an FMU ({error})"
            raise Mistake("path", path, "give one for co-simulation", problem=problem) from None
        if self._description.coSimulation is None or self._description.fmiVersion != "2.0":
            problem = f"{path} offers no co-simulation by FMI 2.0"
            raise Mistake("path", path, "export it so", problem=problem)
        if fmpy.platform not in platforms:
            problem = f"{path} runs on {', '.join(platforms) or 'no platform'}"
            raise Mistake("path", path, f"export it for {fmpy.platform}", problem=problem)
        known = {v.name: v.valueReference for v in self._description.modelVariables if v.type == "Real"}
        self._start_values = dict(start_values or {})
        asked = {"inputs": inputs, "outputs": outputs, "states": states, "disturbances": disturbances}
        for argument, names in (*asked.items(), ("start_values", self._start_values)):
            for name in names:
                if name not in known:
                    problem, remedy = f"has no real variable {name!r}", f"it has {', '.join(sorted(known))}"
                    raise Mistake(argument, name, remedy, problem=problem, subject=str(path))
        self._path, self._known = str(path), known
        self._names = {"u": list(inputs), "y": list(outputs), "x": list(states), "w": list(disturbances)}
        self._slave: Any = None
        self._end: Callable[[], Any] | None = None

    def _references(self, kind: str) -> list[int]:
        return [self._known[name] for name in self._names[kind]]

    def start(self, x0: Array | None) -> Array:
        """A fresh instance.

        Parameters
        ----------
        x0 : ndarray, shape (n,), or None
            Values of the state variables, set before initialisation; None: the FMU's own.

        Returns
        -------
        ndarray, shape (n,)
        """
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        self.close()
        folder = fmpy.extract(self._path)
        try:
            slave = FMU2Slave(
                guid=self._description.guid,
                unzipDirectory=folder,
                modelIdentifier=self._description.coSimulation.modelIdentifier,
                instanceName="plant",
            )
            slave.instantiate()
        except Exception:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._slave, self._end = slave, weakref.finalize(self, _end, slave, folder)
        slave.setupExperiment(startTime=0.0)
        values = dict(self._start_values)
        if x0 is not None:
            values |= dict(zip(self._names["x"], x0.tolist(), strict=True))
        if values:
            slave.setReal([self._known[name] for name in values], list(values.values()))
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        return np.array(slave.getReal(self._references("x")))

    def advance(self, t: float, x: Array, u: Array, w: Array, duration: float) -> Array:
        """One communication step.

        Parameters
        ----------
        t : float
            Present time [s].
        x : ndarray, shape (n,)
            Not used: the state is the FMU's own.
        u, w : ndarray, shape (m,) and (p,)
            Values of the inputs and disturbances.
        duration : float
            Length of the step [s].

        Returns
        -------
        ndarray, shape (n,)
            The state then.
        """
        self._slave.setReal(self._references("u"), u.tolist())
        if w.size:
            self._slave.setReal(self._references("w"), w.tolist())
        self._slave.doStep(currentCommunicationPoint=t, communicationStepSize=duration)
        return np.array(self._slave.getReal(self._references("x")))

    def output(self, x: Array) -> Array:
        """The FMU's present output.

        Parameters
        ----------
        x : ndarray, shape (n,)
            Not used: it is the FMU's present state.

        Returns
        -------
        ndarray, shape (q,)
        """
        return np.array(self._slave.getReal(self._references("y")))

    def close(self) -> None:
        """End the instance and remove what was unpacked; happens by itself when the plant is no longer used."""
        if self._end is not None:
            self._end()
        self._slave = self._end = None


def _end(slave: Any, folder: str) -> None:
    """One that failed may refuse to terminate; what it holds is freed all the same."""
    with contextlib.suppress(Exception):
        slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
