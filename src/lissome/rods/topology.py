r"""Crossings, twist, writhe and linking of curves, as functions of plain arrays.

Rods do not feel contact: parts of a rod may pass through each other, and nothing in the energy knows.
:func:`self_crossings` finds where that happens; :func:`lissome.equilibrate` warns of it.

Twist, writhe and linking number are those of polygons with frames, and exact: for a closed rod
:math:`\mathrm{Tw} + \mathrm{Wr}` is a whole number if the frames close up.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from .._compile import jit
from .._validate import SMALLEST, finite_array, moderate, positive
from ..errors import InvalidInput, LissomeWarning

__all__ = ["Crossings", "linking_number", "self_crossings", "total_twist", "writhe"]

Array = NDArray[np.float64]

#: Default distance below which parts of a rod are said to cross, relative to its length.
CROSSING_DISTANCE = 1e-3


def as_nodes(name: str, value: ArrayLike) -> Array:
    points: Array = moderate(name, finite_array(name, value, (None, 3)))
    if points.shape[0] < 2:
        raise InvalidInput(f"argument `{name}` has {points.shape[0]} rows; pass at least 2 nodes")
    size = float(np.max(np.ptp(points, axis=0)))
    if 0.0 < size < SMALLEST:
        raise InvalidInput(
            f"argument `{name}` has the extent {size:g}; use units in which it is at least {SMALLEST:g}"
        )
    return points


def _closed_nodes(name: str, value: ArrayLike) -> Array:
    """Return nodes of a closed polygon with the first one repeated at the end."""
    points = as_nodes(name, value)
    size = float(np.max(np.ptp(points, axis=0)))
    if np.max(np.abs(points[-1] - points[0])) > 1e-9 * size:
        points = np.concatenate([points, points[:1]])
    else:
        points[-1] = points[0]
    if points.shape[0] < 4:
        raise InvalidInput(
            f"argument `{name}` has {points.shape[0] - 1} different nodes; a closed curve has at least 3"
        )
    return points


# ---------------------------------------------------------------------------------------------
# Self-crossing


@dataclass(frozen=True, eq=False)
class Crossings:
    """Pairs of segments of one rod that are too near each other, nearest first.

    Attributes
    ----------
    segments : ndarray of int, shape (m, 2)
        Numbers of the segments, the smaller one first.
    distances : ndarray, shape (m,)
        Least distances between the two.
    fractions : ndarray, shape (m, 2)
        Where on each segment, from 0 at its first node to 1.

    Examples
    --------
    Two strokes of a zigzag in space that pass each other at their middles, a tenth apart:

    >>> from lissome.rods.topology import self_crossings
    >>> nodes = [[-1, 0, 0], [1, 0, 0], [1, 3, 0], [0, 3, 0.1], [0, -3, 0.1]]
    >>> found = self_crossings(nodes, distance=0.2)
    >>> print(found.segments, found.distances, found.fractions)
    [[0 3]] [0.1] [[0.5 0.5]]
    """

    segments: NDArray[np.int64]
    distances: Array
    fractions: Array

    def __len__(self) -> int:
        return int(self.distances.size)

    def __bool__(self) -> bool:
        return self.distances.size > 0


@jit
def _clamp(x):
    return min(max(x, 0.0), 1.0)


@jit
def _pair_distance(x, i, y, j):
    """Return the least squared distance of two segments, and where it is reached.

    The squared distance is convex in both fractions. Where the least one over the plane is outside
    the square it is reached on an edge, so that five candidates contain it.
    """
    aa = 0.0
    ab = 0.0
    bb = 0.0
    ar = 0.0
    br = 0.0
    for c in range(3):
        a = x[i + 1, c] - x[i, c]
        b = y[j + 1, c] - y[j, c]
        r = x[i, c] - y[j, c]
        aa += a * a
        ab += a * b
        bb += b * b
        ar += a * r
        br += b * r
    best = math.inf
    bs = 0.0
    bt = 0.0
    det = aa * bb - ab * ab
    for case in range(5):
        if case == 0:
            if det <= 1e-14 * aa * bb:
                continue  # parallel: an end is as good as any
            s = (ab * br - bb * ar) / det
            t = (aa * br - ab * ar) / det
            if s < 0.0 or s > 1.0 or t < 0.0 or t > 1.0:
                continue
        elif case == 1:
            s = 0.0
            t = _clamp(br / bb)
        elif case == 2:
            s = 1.0
            t = _clamp((br + ab) / bb)
        elif case == 3:
            t = 0.0
            s = _clamp(-ar / aa)
        else:
            t = 1.0
            s = _clamp((ab - ar) / aa)
        square = 0.0
        for c in range(3):
            d = x[i, c] + s * (x[i + 1, c] - x[i, c]) - y[j, c] - t * (y[j + 1, c] - y[j, c])
            square += d * d
        if square < best:
            best = square
            bs = s
            bt = t
    return best, bs, bt


@jit
def _segment_distances(points, pairs, distances, fractions):
    for n in range(pairs.shape[0]):
        square, s, t = _pair_distance(points, pairs[n, 0], points, pairs[n, 1])
        distances[n] = math.sqrt(square)
        fractions[n, 0] = s
        fractions[n, 1] = t


def self_crossings(
    nodes: ArrayLike, distance: float | None = None, *, closed: bool = False
) -> Crossings:
    r"""Find where a rod comes nearer to itself than a distance, such as its thickness.

    Neighbors along the rod are always near; two places count only if the rod between them is longer
    than :math:`\pi/2` times the distance, which is as tight as a tube of that diameter can turn back.
    The work is proportional to the number of segments for rods that are not balls of wool.

    Parameters
    ----------
    nodes : array_like, shape (N + 1, 3)
        Positions of the nodes. Of a closed rod the first one may be repeated at the end.
    distance : float, optional
        Distance of center lines (length) that is too near; by default a thousandth of the length of
        the rod.
    closed : bool
        Whether the last node is joined with the first.

    Returns
    -------
    Crossings

    Raises
    ------
    InvalidInput
        If an argument is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.topology import self_crossings
    >>> u = np.linspace(0, 2 * np.pi, 81)
    >>> eight = np.stack([np.sin(2 * u), np.sin(u), 0.01 * np.cos(u)], axis=1)
    >>> found = self_crossings(eight, 0.05, closed=True)
    >>> print(bool(found), found.distances.min().round(4))
    True 0.02
    """
    points = _closed_nodes("nodes", nodes) if closed else as_nodes("nodes", nodes)
    edges = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
    total = float(edges.sum())
    reach = CROSSING_DISTANCE * total if distance is None else positive("distance", distance)
    ends = np.concatenate([[0.0], np.cumsum(edges)])
    tree = KDTree(0.5 * (points[:-1] + points[1:]))
    pairs = tree.query_pairs(reach + float(edges.max()), output_type="ndarray").astype(np.int64)
    pairs.sort(axis=1)
    between = ends[pairs[:, 1]] - ends[pairs[:, 0] + 1]
    if closed:
        between = np.minimum(between, total - (ends[pairs[:, 1] + 1] - ends[pairs[:, 0]]))
    apart = pairs[:, 1] - pairs[:, 0] > 1
    if closed:
        apart &= pairs[:, 1] - pairs[:, 0] < edges.size - 1
    pairs = np.ascontiguousarray(pairs[apart & (between > 0.5 * math.pi * reach)])
    distances, fractions = np.empty(pairs.shape[0]), np.empty((pairs.shape[0], 2))
    if pairs.size:
        _segment_distances(points, pairs, distances, fractions)
    near = np.flatnonzero(distances < reach)
    near = near[np.lexsort((pairs[near, 1], pairs[near, 0], distances[near]))]
    return Crossings(pairs[near], distances[near], fractions[near])


def advances(quaternions: NDArray[np.float64]) -> bool:
    r"""Return whether all tangents of a rod are near one direction: then it does not cross itself.

    If :math:`t\cdot u\ge 2/\pi` for all tangents t and some unit vector u, then places that are an arc
    length s apart are at least :math:`2s/\pi` apart in space, which is more than a distance d wherever
    :math:`s > \pi d/2`: :func:`self_crossings` would find nothing, for any d. For u this takes the mean
    tangent. (By the theorem of Schur such a u exists whenever the total curvature of the rod is below
    :math:`2\arccos(2/\pi) = 1.76`: the tangent half way.)

    Parameters
    ----------
    quaternions : ndarray, shape (N, 4)
        Frames of the segments.
    """
    s, x, y, z = quaternions.T
    tangents = np.empty((3, s.size))
    tangents[0] = 2.0 * (x * z + s * y)
    tangents[1] = 2.0 * (y * z - s * x)
    tangents[2] = 1.0 - 2.0 * (x * x + y * y)
    mean = tangents.sum(axis=1)
    size = math.sqrt(mean @ mean)
    return bool((mean @ tangents).min() >= 2.0 / math.pi * size > 0.0)


def warn_of_self_crossings(
    nodes: ArrayLike, distance: float | None = None, *, closed: bool = False, stacklevel: int = 2
) -> Crossings:
    """Find self-crossings, and warn if there are any: contact is not modeled.

    Parameters
    ----------
    nodes, distance, closed
        As of :func:`self_crossings`.
    stacklevel : int
        Of the warning, as of ``warnings.warn``.

    Returns
    -------
    Crossings

    Raises
    ------
    InvalidInput
        If an argument is wrong.

    Warns
    -----
    LissomeWarning
        If parts of the rod cross.

    Examples
    --------
    >>> import warnings
    >>> from lissome.rods.topology import warn_of_self_crossings
    >>> nodes = [[-1, 0, 0], [1, 0, 0], [1, 3, 0], [0, 3, 0.1], [0, -3, 0.1]]
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     found = warn_of_self_crossings(nodes, distance=0.2)
    >>> [warning.category.__name__ for warning in told]
    ['LissomeWarning']
    """
    found = self_crossings(nodes, distance, closed=closed)
    if found:
        i, j = (int(n) for n in found.segments[0])
        warnings.warn(
            f"the rod comes within {found.distances[0]:.3g} of itself at segments {i} and {j} "
            f"({len(found)} pairs of segments are too near); self-contact is not modeled, so that a "
            "real rod would touch itself here",
            LissomeWarning,
            stacklevel=stacklevel + 1,
        )
    return found


# ---------------------------------------------------------------------------------------------
# Topology


def total_twist(rotations: ArrayLike) -> float:
    r"""Return the total twist of a framed polygon, in turns.

    The rotation across each hinge is split into parallel transport of the tangent and a turn
    :math:`2\arctan(q_3/q_0)` about it; these turns are added.

    Parameters
    ----------
    rotations : array_like, shape (n, 4)
        Rotations across the hinges in the frame before each: unit quaternions, scalar first; of a
        closed rod with the one at the joint.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If the shape is wrong.

    Examples
    --------
    Four quarter turns about the tangent, and a bend that does not count:

    >>> import numpy as np
    >>> from lissome.rods.topology import total_twist
    >>> half = np.sqrt(0.5)
    >>> print(round(total_twist([[half, 0, 0, half]] * 4 + [[half, half, 0, 0]]), 12))
    1.0
    """
    q = finite_array("rotations", rotations, (None, 4))
    sign = np.where(q[:, 0] < 0.0, -1.0, 1.0)
    return float(np.sum(np.arctan2(sign * q[:, 3], sign * q[:, 0]))) / math.pi


@jit
def _triangle(a, b, c):
    """Return half the signed area of a spherical triangle of unit vectors."""
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    bc = b[0] * c[0] + b[1] * c[1] + b[2] * c[2]
    ca = c[0] * a[0] + c[1] * a[1] + c[2] * a[2]
    return math.atan2(volume, 1.0 + ab + bc + ca)


@jit
def _unit_difference(x, i, y, j):
    a, b, c = y[j, 0] - x[i, 0], y[j, 1] - x[i, 1], y[j, 2] - x[i, 2]
    size = math.sqrt(a * a + b * b + c * c)
    if size == 0.0:
        return 0.0, 0.0, 0.0
    return a / size, b / size, c / size


@jit
def _gauss(x, i, y, j):
    """Return the integral of Gauss over two segments, over 4 pi: a signed area on the unit sphere.

    All directions from points of one segment to points of the other fill a quadrangle.
    """
    a = _unit_difference(x, i, y, j)
    b = _unit_difference(x, i, y, j + 1)
    c = _unit_difference(x, i + 1, y, j + 1)
    d = _unit_difference(x, i + 1, y, j)
    return -(_triangle(a, b, c) + _triangle(a, c, d)) / (2.0 * math.pi)


@jit
def _writhe(x, closed):
    count = x.shape[0] - 1
    total = 0.0
    for i in range(count):
        row = 0.0
        for j in range(i + 2, count):
            if closed and i == 0 and j == count - 1:
                continue
            row += _gauss(x, i, x, j)
        total += row
    return 2.0 * total


@jit
def _linking(x, y):
    """Return the integral of Gauss over two closed polygons, and their least squared distance."""
    total = 0.0
    least = math.inf
    for i in range(x.shape[0] - 1):
        row = 0.0
        for j in range(y.shape[0] - 1):
            row += _gauss(x, i, y, j)
            least = min(least, _pair_distance(x, i, y, j)[0])
        total += row
    return total, least


def writhe(nodes: ArrayLike, *, closed: bool = False) -> float:
    r"""Return the writhe of a polygon: its mean number of signed crossings over all views.

    .. math:: \mathrm{Wr} = \frac{1}{4\pi}\int\!\!\int
              \frac{(x(s) - x(s'))\cdot(x'(s)\times x'(s'))}{|x(s) - x(s')|^3}\,ds\,ds'

    Each pair of segments contributes the signed area that the directions between their points cover on
    the unit sphere (Banchoff; Klenin and Langowski), so that the result is exact for polygons. The
    work is quadratic in the number of segments.

    Parameters
    ----------
    nodes : array_like, shape (N + 1, 3)
        Positions. Of a closed polygon the first may be repeated at the end.
    closed : bool
        Whether the last node is joined with the first. The writhe of an open curve is the same
        double integral; one whose ends meet is taken as closed.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If the shape is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.topology import writhe
    >>> u = np.linspace(0, 2 * np.pi, 200)
    >>> print(writhe(np.stack([np.cos(u), np.sin(u), 0 * u], axis=1), closed=True))
    0.0
    """
    if (
        not closed
    ):  # two segments that touch have no solid angle, but rounding errors would make one
        ends = as_nodes("nodes", nodes)
        gap = float(np.max(np.abs(ends[-1] - ends[0])))
        closed = ends.shape[0] > 3 and gap <= 1e-9 * float(np.max(np.ptp(ends, axis=0)))
    points = _closed_nodes("nodes", nodes) if closed else as_nodes("nodes", nodes)
    return float(_writhe(points, bool(closed))) + 0.0  # no negative zero


def linking_number(first: ArrayLike, second: ArrayLike) -> int:
    """Return how often two closed curves are linked: Gauss's linking number.

    Parameters
    ----------
    first, second : array_like, shape (N, 3) and (M, 3)
        Nodes of closed polygons; the first node of each may be repeated at its end.

    Returns
    -------
    int
        Positive if the curves cross as right-handed screws do.

    Raises
    ------
    InvalidInput
        If the curves touch, so that the number does not exist, or nodes are repeated.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.topology import linking_number
    >>> u = np.linspace(0, 2 * np.pi, 30)
    >>> flat = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)
    >>> upright = np.stack([1 + np.cos(u), 0 * u, np.sin(u)], axis=1)
    >>> abs(linking_number(flat, upright))
    1
    """
    x, y = _closed_nodes("first", first), _closed_nodes("second", second)
    for name, points in (("first", x), ("second", y)):
        if np.any(np.all(points[1:] == points[:-1], axis=1)):
            raise InvalidInput(f"argument `{name}` repeats a node; neighbors must differ")
    value, square = _linking(x, y)
    size = max(float(np.max(np.ptp(x, axis=0))), float(np.max(np.ptp(y, axis=0))))
    if square < (1e-12 * size) ** 2:
        raise InvalidInput(
            f"arguments `first` and `second` touch (they come within {math.sqrt(square):.3g}); move one "
            "of them"
        )
    return round(value)
