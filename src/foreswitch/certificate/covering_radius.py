"""How far a point of a region can lie from the nearest of some points: the quantiser's error with several inputs.

The squared distance to one point is convex, so over the part of a convex region that is nearest to that point it is
largest in a corner. All corners of all parts are intersections of bisectors of two points and faces of the region.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.spatial import Delaunay, QhullError

from foreswitch._helpers.check import Array

__all__ = ["LARGEST", "Covering"]

Flags = np.ndarray[Any, np.dtype[np.bool_]]

#: Dimensions up to which corners are enumerated.
LARGEST = 3
#: Planes closer to parallel than this do not meet.
PARALLEL = 1e-9


class Covering:
    """Points, and how well they cover a region.

    Parameters
    ----------
    points : ndarray, shape (p, r)
        r up to `LARGEST`.
    faces : ndarray, shape (r, r)
        Invertible; regions are ``low <= faces x <= high``.
    """

    def __init__(self, points: Array, faces: Array) -> None:
        size = max(float(np.ptp(points, axis=0).max()), 1e-300)
        _, first = np.unique(np.round(points / size, 12), axis=0, return_index=True)
        self.points, self.faces, r = points[np.sort(first)], faces, points.shape[1]
        self._dimension = r
        pairs = self._neighbours()
        a, b = self.points[pairs[:, 0]], self.points[pairs[:, 1]]
        normals, offsets = b - a, 0.5 * (np.square(b) - np.square(a)).sum(axis=1)
        #: Corners of bisectors alone, with their distances; then of some bisectors with some faces, per such choice.
        self._corners: Array = np.zeros((0, r))
        self._distances: Array = np.zeros(0)
        self._mixed: list[tuple[Array, Array, tuple[int, ...]]] = []
        for own in range(r + 1):
            subsets = list(combinations(range(len(pairs)), own))
            chosen = np.array(subsets, dtype=np.int64).reshape(len(subsets), own)
            for sides in combinations(range(r), r - own):
                beside = np.broadcast_to(faces[list(sides)], (len(chosen), r - own, r))
                inverse, meet = _solvers(np.concatenate([normals[chosen], beside], axis=1))
                if own < r:
                    self._mixed.append((inverse, offsets[chosen][meet], sides))
                elif len(chosen):
                    self._corners = (inverse @ offsets[chosen][meet][:, :, None])[:, :, 0]
                    self._distances = self.nearest(self._corners)

    def _neighbours(self) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        """Pairs whose bisector may bound a part, (k, 2): of a triangulation, or all."""
        count = len(self.points)
        everyone = np.array(list(combinations(range(count), 2)), dtype=np.int64).reshape(-1, 2)
        if count <= 12 or self._dimension == 1:
            return everyone
        try:
            corners = Delaunay(self.points, qhull_options="Qbb Qc Qz").simplices
        except QhullError:
            return everyone
        # cospherical points, the rule on a lattice, have no unique triangulation: take the circumspheres' whole sets
        pairs = set()
        for simplex in corners:
            centre, radius = _circumsphere(self.points[simplex])
            on = np.flatnonzero(np.linalg.norm(self.points - centre, axis=1) <= radius * (1.0 + 1e-7))
            pairs |= set(combinations(on.tolist(), 2))
        return np.array(sorted(pairs), dtype=np.int64)

    def nearest(self, places: Array) -> Array:
        """Distance of each place (k, r) to the nearest point, (k,)."""
        best = np.full(len(places), np.inf)
        for point in self.points:
            best = np.minimum(best, np.square(places - point).sum(axis=1))
        result: Array = np.sqrt(best)
        return result

    def farthest(self, low: Array, high: Array) -> float:
        """Largest such distance over ``low <= faces x <= high``, (r,) each."""
        slack = 1e-9 * (1.0 + np.maximum(np.abs(low), np.abs(high)))

        def inside(places: Array) -> Flags:
            at = places @ self.faces.T
            between: Flags = np.logical_and.reduce((at >= low - slack) & (at <= high + slack), axis=1)
            return between

        best = float(self._distances[inside(self._corners)].max(initial=0.0))
        for inverse, offsets, sides in self._mixed:
            for ends in product(*((low[side], high[side]) for side in sides)):
                right = np.concatenate([offsets, np.broadcast_to(ends, (len(offsets), len(sides)))], axis=1)
                places = (inverse @ right[:, :, None])[:, :, 0]
                best = max(best, float(self.nearest(places[inside(places)]).max(initial=0.0)))
        return best


def _solvers(normals: Array) -> tuple[Array, Flags]:
    """Inverses of those (k, r, r) normals whose planes meet in a point, and which those are."""
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    meet: Any = np.abs(np.linalg.det(normals / length)) > PARALLEL
    return np.linalg.inv(normals[meet]), meet


def _circumsphere(corners: Array) -> tuple[Array, float]:
    a = corners[1:] - corners[0]
    centre = corners[0] + np.linalg.lstsq(2.0 * a, np.square(a).sum(axis=1), rcond=None)[0]
    return centre, float(np.linalg.norm(corners[0] - centre))
