"""Bounds of the quantiser's error, and the range of the ideal input within which they hold.

The error is at most half a gap between levels as long as the unquantised input stays within half a gap of the levels'
hull, and that input itself moves with earlier errors. An `Argument` is an induction over the periods: while the error has
stayed within its radius, the unquantised input stays where the error is within the radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig

from foreswitch._helpers.check import Array
from foreswitch.certificate.covering_radius import LARGEST, Covering
from foreswitch.certificate.error_dynamics import ErrorLoop
from foreswitch.certificate.measurement_errors import choice_error
from foreswitch.certificate.model_errors import Errors
from foreswitch.certificate.peak_gain import Recursion, Unsettled

__all__ = ["Argument", "Quantiser"]

#: Lowest and highest of several numbers.
Range = tuple[Array, Array]

#: Poles of the plant up to here count as 1, and modes closer than this as one.
UNIT, APART = 1.0 + 1e-9, 1e-6
#: An ideal input counts as within a range that it leaves by less than this share of the levels' span.
EDGE = 1e-9
#: Rounds in which the radius may grow until the induction closes, and by how much beyond what it needs.
ROUNDS, GROWTH = 40, 1.01
#: The radius is sought from what the levels' hull asks for, by so much, on.
LEAST = 8.0
#: Halvings in the search for the largest range.
HALVINGS = 14
#: A bound that is so many times as large as the tightest is worth a wider range.
WIDER = 1.5
#: An ideal input that leaves the range for a while may enlarge the radius by this share.
GRACE = 0.5


@dataclass(frozen=True)
class Argument:
    """A bound of the quantiser's error.

    Attributes
    ----------
    low, high : ndarray, shape (m,)
        Range of the ideal input; none where low exceeds high.
    radius : float
        Largest length of the quantiser's error in p = metric u.
    one_sided : bool
        Whether it leans on a mode of the plant, which the ends of the levels need.
    excursion : float
        Share of the radius that lets the ideal input leave the range for a while, as it wants to.
    """

    low: Array
    high: Array
    radius: float
    one_sided: bool = False
    excursion: float = 0.0

    def covers(self, wanted: Array, span: Array) -> bool:
        """Whether an ideal input (K, m) stays in the range, but for its excursion."""
        return self.excursion > 0.0 or bool(
            (wanted >= self.low - EDGE * span).all() and (wanted <= self.high + EDGE * span).all()
        )


class Quantiser:
    """The levels of a loop, as seen from the unquantised input.

    Parameters
    ----------
    loop : ErrorLoop
    """

    def __init__(self, loop: ErrorLoop) -> None:
        self.loop = loop
        self.price = float(loop.controller.actuator.switch_cost.sum())
        self.span = 2.0 * loop.windows.half_span
        self._covering: Covering | None = None

    def arguments(self, errors: Errors, wanted: Array | None = None) -> list[Argument]:
        """Bounds that hold, the tightest first, at all or with an eye to an ideal input (K, m).

        With several inputs the radius grows with the range, so there is one argument: for the wanted range, else for the
        widest that is centred in the levels' hull.
        """
        if not self.loop.windows.tells_apart(errors):
            return []
        found = self._modulator(errors, wanted) if self.loop.plant.inputs == 1 else self._covered(errors, wanted)
        with np.errstate(over="ignore", invalid="ignore"):  # absurd errors: no argument then, NaN compares as false
            some = [a for a in found if (a.low <= a.high + EDGE * self.span).all() and np.isfinite(a.radius)]
        best: list[Argument] = []
        for each in sorted(some, key=lambda a: a.radius):
            if each.excursion or not any(a.covers(np.vstack([each.low, each.high]), self.span) for a in best):
                best.append(each)
        return best

    def prove(self, errors: Errors, wanted: Array | None = None) -> Argument | None:
        """The tightest argument for an ideal input, or at all."""
        return next((a for a in self.arguments(errors, wanted) if wanted is None or a.covers(wanted, self.span)), None)

    # ---- One input: a delta-sigma modulator ----

    def _modulator(self, errors: Errors, wanted: Array | None) -> Iterator[Argument]:
        """The loop's own gain, then gains on a single mode of the plant, of which the loop's differs by a bounded input.

        A gain on the mode with pole p that brings it to 0 at once leaves ``|p| <= 1`` times the latest error: then even
        an ideal input at the end of the levels overloads nothing.
        """
        loop, values = self.loop, np.unique(self.loop.commands[:, 0])  # but forbidden ones
        scale = float(np.abs(loop.metric[0, 0]))
        half = 0.5 * float(np.diff(values).max())
        surplus = float(loop.windows.surplus(errors)[0])
        price = 2.0 * self.price / scale**2
        wrong = float(choice_error(loop, errors)[0]) / scale + float(loop.windows.misjudged(loop.gain, errors)[0])
        direct = float(np.hypot(half, np.sqrt(price))) + wrong + surplus
        # what the lowest and the highest level may really be
        offset = loop.plant.u_offset[0]
        lowest = float(values[0] + errors.gain[0] * abs(values[0] - offset))
        highest = float(values[-1] - errors.gain[0] * abs(values[-1] - offset))
        # without a price on switching, overload is told by what really acts, which noise does not change
        room, blur = (direct, 0.0) if price == 0 else (half, wrong)
        own = float(loop.recursion.sums(loop.gain, loop.gamma)[0, 0])
        drift = float(loop.model_reach(loop.gain, errors)[0])
        margin = direct * own + drift + blur - room
        yield Argument(np.array([lowest + margin]), np.array([highest - margin]), scale * direct)
        if price > 0:
            return
        late = float(loop.windows.weights(0, errors)[0])
        for row, pole in self._modes():
            shadow = -pole / float(row @ loop.gamma[:, 0]) * row[None, :]
            try:
                recursion = Recursion(loop.phi + loop.gamma @ shadow)
            except Unsettled:
                continue
            rest = loop.gain - shadow
            spread = float(recursion.sums(rest, loop.gamma)[0, 0])
            if spread >= 1.0:
                continue
            matched, unmatched = 0.0, 0.0
            for error in loop.windows.delay_errors(0, errors):
                column = loop.shifted(0, error)
                share = float(row @ column) / float(row @ loop.gamma[:, 0])
                other = (column - share * loop.gamma[:, 0])[:, None]
                matched = max(matched, late * abs(share))
                unmatched = max(unmatched, late * float(recursion.sums(rest, other)[0, 0]))
            if errors.load[0] > 0:
                load, pieces = loop.windows.loaded(0, errors), loop.windows.slices(0, loop.Ts).T
                shares = row @ pieces / float(row @ loop.gamma[:, 0])
                matched += load * float(np.abs(shares).sum())
                unmatched += load * float(recursion.sums(rest, pieces - loop.gamma * shares).sum())
            radius = (direct + matched + unmatched) / (1.0 - spread)
            margin = radius * (pole - 1.0) + matched
            margin = margin if abs(margin) > EDGE * float(self.span[0]) else 0.0  # of a pole at 1: round-off
            low, high, excursion = lowest + margin, highest - margin, 0.0
            if wanted is not None and (wanted.min() < low or wanted.max() > high):
                beyond = max(
                    _excursion(wanted[:, 0] - (lowest + matched), radius, pole),
                    _excursion((highest - matched) - wanted[:, 0], radius, pole),
                )
                if beyond <= GRACE * radius:
                    radius += beyond / (1.0 - spread)
                    excursion = max(beyond / radius, np.finfo(float).tiny)
            worst = radius * (1.0 + spread) + matched + unmatched
            yield Argument(np.array([low]), np.array([high]), scale * worst, True, excursion)

    def _modes(self) -> Iterator[tuple[Array, float]]:
        """Left eigenvectors of simple real poles in (0, 1] that the input moves, slowest first."""
        loop = self.loop
        poles, left = eig(loop.phi, left=True, right=False)
        for i in np.argsort(-np.abs(poles), kind="stable"):
            others = np.delete(poles, i)
            if poles[i].imag == 0 and 0 < poles[i].real <= UNIT and (np.abs(others - poles[i]) > APART).all():
                row = left[:, i].real
                if abs(row @ loop.gamma[:, 0]) > 1e-12 * np.linalg.norm(row) * np.linalg.norm(loop.gamma):
                    yield row, min(float(poles[i].real), 1.0)

    # ---- Several inputs: the covering radius ----

    def _covered(self, errors: Errors, wanted: Array | None) -> Iterator[Argument]:
        loop = self.loop
        if loop.rank > LARGEST:
            return
        # the region is a box in u where every direction of u is quantised, else a box in p
        faces = loop.inverse if loop.rank == loop.plant.inputs else np.eye(loop.rank)
        if self._covering is None:
            self._covering = Covering(loop.commands @ loop.metric.T, faces)
        rows = faces @ loop.metric @ loop.gain
        noise = choice_error(loop, errors) + loop.windows.misjudged(loop.metric @ loop.gain, errors)
        region = Region(
            self._covering,
            loop.recursion.sums(rows, loop.gamma @ loop.inverse, norm=2),
            loop.model_reach(rows, errors) + np.abs(faces) @ noise,
            self.price,
            float(np.linalg.norm(noise + np.abs(loop.metric) @ loop.windows.surplus(errors))),
        )
        image = faces @ loop.metric
        levels = loop.controller.levels
        ends = np.array([v[0] for v in levels]), np.array([v[-1] for v in levels])
        usual = region.needs(*_image(image, *ends), 0.0, fixed=True)
        if wanted is not None:
            box = wanted.min(axis=0), wanted.max(axis=0)
            radius = region.closes(*_image(image, *box), usual / LEAST)
            if radius is not None:
                yield Argument(*box, radius)
            return
        centre, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])

        def box_of(share: float) -> Range:
            return centre - share * half, centre + share * half

        radius = region.closes(*_image(image, *box_of(0.0)), usual / LEAST)
        if radius is None:
            return
        # as wide as the tightest radius allows, or the one that the levels' hull asks for, and half as much again
        tight = max(radius, usual)
        for tried in {radius, tight, WIDER * tight}:
            least, most = (0.0, 1.0) if region.needs(*_image(image, *box_of(0.0)), tried) <= tried else (0.0, 0.0)
            for _ in range(HALVINGS if most else 0):
                share = 0.5 * (least + most)
                fits = region.needs(*_image(image, *box_of(share)), tried) <= tried
                least, most = (share, most) if fits else (least, share)
            if least > 0.0 or tried == radius:
                yield Argument(*box_of(least), tried)


@dataclass(frozen=True)
class Region:
    """How the region of the unquantised choice grows with the quantiser's error, and the error with the region."""

    covering: Covering
    own: Array  # of the region's half widths, per unit of the radius
    drift: Array  # of them besides
    price: float
    extra: float  # of the radius, besides

    def needs(self, low: Array, high: Array, radius: float, *, fixed: bool = False) -> float:
        """The radius that an ideal input in a box asks for, given one; ``fixed``: over the box itself."""
        reach = 0.0 * self.own if fixed else self.own * radius + self.drift
        distance = self.covering.farthest(low - reach, high + reach)
        return float(np.hypot(distance, np.sqrt(2.0 * self.price))) + self.extra

    def closes(self, low: Array, high: Array, least: float) -> float | None:
        """A radius that asks for no more than itself, or None; sought from the least on: a box at a level asks for none."""
        radius = least
        for _ in range(ROUNDS):
            needed = self.needs(low, high, radius)
            if needed <= radius:
                return radius
            radius = needed * GROWTH
        return None


def _excursion(room: Array, radius: float, pole: float) -> float:
    """How far the error may leave its radius because the ideal input leaves the levels' hull for a while.

    ``room`` (K,) is what the ideal input has left at one end. While the error e along the mode is driven by overload,
    ``e[k+1] = pole (e[k] - room[k])``, else it is at most ``pole radius``; overloaded, the quantiser's is ``e - room``.
    """
    error, most = pole * radius, 0.0
    for left in room.tolist():
        most = max(most, error - left - radius)
        error = max(pole * radius, pole * (error - left))
    return most


def _image(matrix: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The smallest box around the image of a box."""
    centre, half = matrix @ (0.5 * (low + high)), np.abs(matrix) @ (0.5 * (high - low))
    return centre - half, centre + half
