"""Certificates: how far the output of an `Endpoint` law can lie from its ideal response, whatever the reference.

For stable, marginal and unstable plants alike; the paper proves boundedness for stable ones. What is not proven is refused
with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from foreswitch._helpers import check
from foreswitch._helpers.check import Array
from foreswitch._helpers.mistake import Mistake
from foreswitch._helpers.text import tree
from foreswitch.certificate import margins, plots, reasons, report
from foreswitch.certificate.error_dynamics import ErrorLoop
from foreswitch.certificate.ideal_response import Course, ideal_run
from foreswitch.certificate.model_errors import Errors
from foreswitch.certificate.peak_gain import Unsettled
from foreswitch.certificate.quantiser import Quantiser
from foreswitch.control.controller import Controller

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from foreswitch.presentation.report import Report
    from foreswitch.simulation.run import Run

__all__ = ["Certificate", "certify"]

#: Lowest and highest input, (m,) each.
Range = tuple[Array, Array]


def certify(
    controller: Controller,
    *,
    reference: Callable[..., ArrayLike] | ArrayLike | None = None,
    duration: float | None = None,
    x0: ArrayLike | None = None,
    disturbance: ArrayLike | None = None,
    noise: ArrayLike = 0.0,
    delay_error: ArrayLike = 0.0,
    gain_error: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
) -> Certificate:
    """Prove a bound of the tracking error around the ideal response, or say why there is none.

    Parameters
    ----------
    controller : Controller
        With an `Endpoint`; the response begins with its commands under way.
    reference : callable or array_like, optional
        Checked: does the ideal input stay within its range? Default: any, the range is told.
    duration : float, optional
        How long the reference is followed [s]. Default: to its end, with 2000 periods to settle.
    x0 : array_like, shape (n,), optional
        State from which it is followed. Default: zero.
    disturbance : array_like, shape (p,) or (K, p), optional
        Measured disturbance meanwhile. Default: zero.
    noise : float or array_like
        Largest error of each measured value: states, or outputs where there is an estimator.
    delay_error : float or array_like, shape (m,)
        Largest error of the dead times [s], either way.
    gain_error : float or array_like, shape (m,)
        Largest error of the inputs' gains, as a share, either way.
    load : float or array_like, shape (m,)
        Largest unmeasured part of each input [unit of u], such as a leak, constant or not.

    Returns
    -------
    Certificate

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from foreswitch import Controller, Endpoint, Plant
    >>> valve = Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
    >>> certify(Controller(valve, [0, 1], 1e-3, Endpoint(Td=0.020, lam=2500.0)))
    Certificate, holds
    ├─ bound   y within 8.04 of the ideal response; the actuator's own resolution is 8.25
    ├─ range   ideal input from 0.005771 to 0.9942, bound 8.04
    ├─ range   ideal input from 0 to 1, bound 8.67
    ├─ loop    slowest pole 0.8407, lag 0.01136 s, DC gain 1
    └─ errors  none
    """
    if not isinstance(controller, Controller):
        problem = f"is a {type(controller).__name__}"
        raise Mistake("controller", controller, "give a Controller", problem=problem)
    measured, what = controller.measured
    inputs = controller.plant.inputs
    errors = Errors(
        check.per("noise", noise, measured, what, least=0.0),
        check.per("delay_error", delay_error, inputs, "input", least=0.0),
        check.per("gain_error", gain_error, inputs, "input", least=0.0),
        check.per("load", load, inputs, "input", least=0.0),
    )
    if (errors.gain >= 1.0).any():
        raise Mistake("gain_error", gain_error, "it must be less than 1, or the input may do nothing")
    course = None if reference is None else Course(controller, reference, duration, x0, disturbance)
    return Certificate(controller, errors, course)


class Certificate:
    """What is proven of a controller: `certify` makes it.

    Parameters
    ----------
    controller : Controller
    errors : Errors
        What is borne: ``noise``, ``delay`` [s], ``gain`` and ``load``.
    course : Course or None
        The reference that is followed.

    Attributes
    ----------
    holds : bool
        Whether the bound is proven.
    reasons : list of str
        What it rests on, or which condition failed and what to change.
    error_bound : ndarray, shape (q,)
        Largest distance of each output from its ideal response at any time; infinite where nothing is proven.
    poles : ndarray, complex
        Of the ideal loop from period to period, slowest first.
    lag, dc_gain : float or ndarray
        Of the ideal response, as `Controller` has them.
    resolution : ndarray, shape (q,)
        What the actuator itself allows: half of what its smallest pulse, one period over the widest gap, moves the output.
    input_range : tuple of ndarray, shape (m,) each
        Lowest and highest ideal input for which the bound holds.
    arguments : list of (input_range, error_bound)
        Every range with a bound of its own, the tightest bound first.
    ideal_input : tuple of ndarray, shape (m,) each, or None
        Lowest and highest ideal input for the reference that was given.
    """

    def __init__(self, controller: Controller, errors: Errors, course: Course | None) -> None:
        plant = controller.plant
        self.controller, self.errors, self.course = controller, errors, course
        self.lag, self.dc_gain = controller.lag, controller.dc_gain
        self.error_bound: Array = np.full(plant.outputs, np.inf)
        self.resolution = reasons.resolution(controller)
        self.poles = np.zeros(0, dtype=np.complex128)
        self.input_range: Range = (np.full(plant.inputs, np.nan), np.full(plant.inputs, np.nan))
        self.ideal_input: Range | None = None
        self._wanted: Array | None = None
        self.arguments: list[tuple[Range, Array]] = []
        self.holds, self.reasons = False, [reasons.unproven(controller)]
        if self.reasons[0]:
            return
        self.loop = ErrorLoop(controller)
        self._quantiser = Quantiser(self.loop)
        self.poles = self.loop.poles
        try:
            self._judge(self.loop, self._quantiser)
        except Unsettled:
            self.reasons = [reasons.unstable(self.loop, self.errors)]

    def _judge(self, loop: ErrorLoop, quantiser: Quantiser) -> None:
        if not loop.settles:
            raise Unsettled
        if refusal := reasons.gated(loop, self.errors) or reasons.misled(loop, self.course):
            self.reasons = [refusal]
            return
        wanted = None
        if self.course is not None:
            self._wanted = wanted = self.course.inputs(loop)
            self.ideal_input = wanted.min(axis=0), wanted.max(axis=0)
        found = quantiser.arguments(self.errors, wanted) or quantiser.arguments(self.errors)
        self.arguments = [((a.low, a.high), loop.output_reach(a.radius, self.errors)) for a in found]
        fits = [i for i, a in enumerate(found) if wanted is None or a.covers(wanted, quantiser.span)]
        if fits:
            self.holds = True
            self.input_range, self.error_bound = self.arguments[fits[0]]
            self.reasons = reasons.grounds(loop, found[fits[0]], wanted)
        elif found and self.course is not None and wanted is not None:
            self.input_range = self.arguments[-1][0]
            self.reasons = [reasons.beyond(quantiser, self.errors, self.course, wanted, found[-1])]
        else:
            self.reasons = [reasons.overloaded(quantiser, self.errors)]

    # ---- The response that the bound is about ----

    def ideal(
        self,
        reference: Callable[..., ArrayLike] | ArrayLike,
        duration: float,
        *,
        x0: ArrayLike | None = None,
        disturbance: ArrayLike | None = None,
    ) -> Array:
        """The unquantised response; ``error_bound`` bounds its distance from y at every time.

        Parameters
        ----------
        reference : callable or array_like
        duration : float
            s, rounded up to whole periods.
        x0 : array_like, shape (n,), optional
            Initial state. Default: zero.
        disturbance : array_like, shape (p,) or (K, p), optional
            Measured disturbance. Default: zero.

        Returns
        -------
        ndarray, shape (K+1, q)

        Raises
        ------
        ValueError
            If there is no stable ideal loop, or an argument does not fit.
        """
        if not self.poles.size or not self.loop.settles:
            remedy = f"change what this reason names: {self.reasons[0]}"
            raise Mistake("controller", self.controller, remedy, problem="has no ideal response")
        return ideal_run(self.loop, Course(self.controller, reference, duration, x0, disturbance))[0]

    # ---- How much is left ----

    @cached_property
    def margins(self) -> dict[str, Array]:
        """Largest ``delay_error``, ``gain_error``, ``load`` (m,) and ``noise`` with which a bound is at most twice as large.

        Each by itself, the others as they are. Infinite: no limit was found. Empty where nothing is proven.
        """
        return margins.of_errors(self._quantiser, self.errors, self._wanted) if self.holds else {}

    @cached_property
    def Td_intervals(self) -> list[tuple[float, float]]:
        """Settling horizons for which this design is certified [s]; they need not be one interval."""
        return margins.intervals(self.controller, "Td", self.errors, self._wanted) if self.poles.size else []

    @cached_property
    def lam_intervals(self) -> list[tuple[float, float]]:
        """The same of lam [rad/s]; of several, the largest, the others in proportion."""
        return margins.intervals(self.controller, "lam", self.errors, self._wanted) if self.poles.size else []

    @cached_property
    def fastest(self) -> float:
        """How many times as fast the given reference may be run through; infinite: no limit. NaN: none was given."""
        if self.course is None or not self.arguments:
            return float("nan")
        return margins.fastest(self._quantiser, self.errors, self.course)

    @cached_property
    def steady(self) -> dict[str, tuple[float, float]]:
        """With one input and output: the ``value`` that can be held, the ``slope`` or the ``acceleration`` kept up for good.

        Lowest and highest, the bound holding; a slope beside a value is for the middle of the values.
        """
        return margins.steady(self.controller.plant, self.input_range)

    @property
    def rest(self) -> str:
        """What happens where the reference stands still."""
        return reasons.at_rest(self.controller, self.course, self.error_bound)

    # ---- What a person sees ----

    def plot(self, run: Run | None = None) -> Figure:
        """The ideal response with its band, a run inside it, and the ideal input with its range.

        Parameters
        ----------
        run : Run, optional
            From the same start. Default: simulated, where a reference was given.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ValueError
            If nothing is proven, or there is no reference.
        """
        if not self.holds or self.course is None:
            remedy = "certify a design that holds, with a reference"
            raise Mistake("reference", None, remedy, problem="is no band to draw", subject="there")
        y, u = ideal_run(self.loop, self.course)
        return plots.band(self.course, y, u, self.error_bound, self.input_range, run)

    def summary(self, *, margins: bool = True) -> dict[str, Any]:
        """Everything as plain data.

        Parameters
        ----------
        margins : bool
            Whether what is left is told as well; finding it takes longest.

        Returns
        -------
        dict
            Numbers, lists, words and None, which stands for what is not finite; keys say their units, as in
            ``"error_bound [kPa]"``.
        """
        return report.certificate_summary(self, margins=margins)

    def report(self, name: str) -> Report:
        """What is proven, how much is left, the picture and the controller, to be written as a page.

        Parameters
        ----------
        name : str
            Its heading.

        Returns
        -------
        Report
        """
        return report.certificate_report(name, self)

    def __repr__(self) -> str:
        if not self.holds:
            return tree("Certificate, does not hold", [f"because  {reason}" for reason in self.reasons])
        names = self.controller.plant.output_names
        lines = [
            f"bound   {name} within {bound:.3g} of the ideal response; the actuator's own resolution is {own:.3g}"
            for name, bound, own in zip(names, self.error_bound, self.resolution, strict=True)
        ]
        for (low, high), bound in self.arguments:
            lines.append(f"range   ideal input {reasons.between(low, high)}, bound {reasons.numbers(bound, 3)}")
        lag, gain = reasons.numbers(np.ravel(self.lag)), reasons.numbers(np.diag(np.atleast_2d(self.dc_gain)))
        lines.append(f"loop    slowest pole {abs(self.poles[0]):.4g}, lag {lag} s, DC gain {gain}")
        e = self.errors
        parts = {"noise": e.noise, "delay": e.delay, "gain": e.gain, "load": e.load}
        some = [
            f"{name} {reasons.numbers(values)}{' s' * (name == 'delay')}"
            for name, values in parts.items()
            if values.any()
        ]
        lines.append(f"errors  {', '.join(some) or 'none'}")
        return tree("Certificate, holds", lines)
