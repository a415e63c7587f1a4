"""How far a point of a region can lie from the nearest of some points: the quantiser's error with several inputs.

The squared distance to one point is convex, so over the part of a convex region that is nearest to that point it is
largest in a corner. All corners of all parts are intersections of bisectors of two points and faces of the region.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from foreswitch._check import Array

__all__ = ["LARGEST", "Covering"]

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
    """

    def __init__(self, points: Array) -> None:
        size = max(float(np.ptp(points, axis=0).max()), 1e-300)
        _, first = np.unique(np.round(points / size, 12), axis=0, return_index=True)
        self.points, self._dimension = points[np.sort(first)], points.shape[1]
        pairs = self._neighbours()
        a, b = self.points[pairs[:, 0]], self.points[pairs[:, 1]]
        self._normals, self._offsets = b - a, 0.5 * (np.square(b) - np.square(a)).sum(axis=1)
        own = np.array(list(combinations(range(len(pairs)), self._dimension)), dtype=np.int64)
        self._fixed = _meet(self._normals[own], self._offsets[own]) if own.size else np.zeros((0, self._dimension))

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

    def farthest(self, faces: Array, low: Array, high: Array) -> float:
        """Largest such distance over ``low <= faces x <= high``.

        Parameters
        ----------
        faces : ndarray, shape (r, r)
            Invertible.
        low, high : ndarray, shape (r,)

        Returns
        -------
        float
        """
        r, places = self._dimension, [self._fixed]
        for own in range(r):  # bisectors that meet in the corner, beside faces
            subsets = list(combinations(range(len(self._normals)), own))
            chosen = np.array(subsets, dtype=np.int64).reshape(len(subsets), own)
            for sides in combinations(range(r), r - own):
                for bits in range(2 ** (r - own)):
                    level = [(high if bits >> i & 1 else low)[side] for i, side in enumerate(sides)]
                    repeat = len(chosen)
                    normals = np.concatenate(
                        [self._normals[chosen], np.broadcast_to(faces[list(sides)], (repeat, r - own, r))], axis=1
                    )
                    offsets = np.concatenate([self._offsets[chosen], np.broadcast_to(level, (repeat, r - own))], axis=1)
                    places.append(_meet(normals, offsets))
        every = np.concatenate(places)
        at, slack = every @ faces.T, 1e-9 * (1.0 + np.maximum(np.abs(low), np.abs(high)))
        inside = ((at >= low - slack) & (at <= high + slack)).all(axis=1)
        return float(self.nearest(every[inside]).max())


def _meet(normals: Array, offsets: Array) -> Array:
    """Where r planes meet, (k, r), of (k, r, r) normals; parallel ones are left out."""
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    unit = normals / length
    crossing = np.abs(np.linalg.det(unit)) > PARALLEL
    result: Array = np.linalg.solve(unit[crossing], (offsets / length[:, :, 0])[crossing][:, :, None])[:, :, 0]
    return result


def _circumsphere(corners: Array) -> tuple[Array, float]:
    a = corners[1:] - corners[0]
    centre = corners[0] + np.linalg.lstsq(2.0 * a, np.square(a).sum(axis=1), rcond=None)[0]
    return centre, float(np.linalg.norm(corners[0] - centre))
