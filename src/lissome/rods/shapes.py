r"""Rods of given rest shapes: straight, arc, helix, ring, and through given nodes.

Each function returns a :class:`~lissome.rods.Rod` at rest: rest lengths, natural strains for which the
shape is free of stress (unless told otherwise), and the shape itself as the initial state.

The frames of an arc or a helix are those of the smooth curve in the middle of each segment, so that
all hinges of a uniform mesh have exactly the same strain: such a rod is uniform on the mesh too, and its
nodes lie on a slightly different arc or helix (to second order in the length of a segment).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from .._compile import jit
from .._validate import finite, finite_array, integer_at_least, moderate, one_of, positive
from ..errors import InvalidInput
from .measures import MEASURES, strain_from_rotation
from .quaternions import (
    ANTIPARALLEL,
    conjugate,
    exponential,
    from_directors,
    mul,
    multiply,
    parallel_transport,
    rotate,
    turn,
)

__all__ = ["along", "arc", "helix", "ring", "straight"]

Array = NDArray[np.float64]
# How far directors that are given may be from right angles.
_RIGHT_ANGLE = 1e-8


# ---------------------------------------------------------------------------------------------
# Pieces


def _rest_lengths(length: Any, segments: Any, lengths: Any) -> Array:
    if lengths is not None:
        if length is not None or segments is not None:
            raise InvalidInput(
                "argument `lengths` is given together with `length` or `segments`; it replaces both"
            )
        array = moderate("lengths", finite_array("lengths", lengths, (None,)))
        if array.size < 2 or np.any(array <= 0.0):
            shown = f"has {array.size} entries" if array.size < 2 else f"holds {array.min():g}"
            raise InvalidInput(
                f"argument `lengths` {shown}; pass the rest lengths of at least 2 segments, each "
                "greater than 0"
            )
        return array
    if length is None or segments is None:
        raise InvalidInput(
            "a rod needs `length` and `segments`, or `lengths` with one rest length for each segment"
        )
    count = integer_at_least("segments", segments, 2)
    return np.full(count, positive("length", length) / count)


def _direction(name: str, value: ArrayLike) -> Array:
    vector: Array = finite_array(name, value, (3,))
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        raise InvalidInput(f"argument `{name}` is the zero vector; pass a direction")
    return vector / size


def _frame(tangent: ArrayLike, director: ArrayLike | None) -> Array:
    """Return the quaternion of the frame with d3 along `tangent` and d1 along `director`."""
    d3 = _direction("tangent", tangent)
    if director is None:
        if d3[2] < -1.0 + 1e-9:  # opposite to e3: no shortest turn; half a turn about e1 it is
            d1 = np.array([1.0, 0.0, 0.0])
            d1 -= (d1 @ d3) * d3
            d1 /= np.linalg.norm(d1)
        else:
            d1 = rotate(parallel_transport([0.0, 0.0, 1.0], d3), [1.0, 0.0, 0.0])
    else:
        d1 = _direction("director", director)
        if abs(d1 @ d3) > _RIGHT_ANGLE:
            raise InvalidInput(
                f"argument `director` makes an angle of {math.degrees(math.acos(d1 @ d3)):.6g} degrees "
                "with the tangent; it must be normal to it"
            )
        d1 = d1 - (d1 @ d3) * d3
        d1 /= np.linalg.norm(d1)
    return from_directors(np.stack([d1, np.cross(d3, d1), d3]))


def _bending_axis(about: Any) -> int:
    if isinstance(about, (bool, np.ndarray)) or about not in (1, 2):
        raise InvalidInput(
            f"argument `about` is {about!r}; pass 1 or 2, the number of the director that the rod bends "
            "about"
        )
    return int(about) - 1


def _spans(lengths: Array, closed: bool) -> Array:
    """Return lengths of the hinges at all nodes (of half hinges at open ends), shape (N + 1,)."""
    spans = np.empty(lengths.size + 1)
    spans[1:-1] = 0.5 * (lengths[:-1] + lengths[1:])
    spans[0], spans[-1] = 0.5 * lengths[0], 0.5 * lengths[-1]
    if closed:
        spans[0] = spans[-1] = spans[0] + spans[-1]
    return spans


def _rod(
    law: Any,
    lengths: Array,
    natural: Array,
    frames: Array,
    origin: ArrayLike,
    *,
    stretching: float | None,
    measure: str,
    closed: bool = False,
    joint: float = 0.0,
) -> Any:
    from ._structure import Rod, RodState

    if law is None:
        raise InvalidInput("argument `law` is None; pass a law such as rods.Kirchhoff")
    frames = frames / np.linalg.norm(frames, axis=1)[:, None]
    state = RodState(frames, finite_array("origin", origin, (3,)))
    return Rod(
        law,
        lengths,
        natural=natural,
        closed=closed,
        joint=joint,
        stretching=stretching,
        measure=measure,
        initial=state,
    )


def _screw(
    lengths: Array,
    law: Any,
    strain: Array,
    tangent: ArrayLike,
    director: ArrayLike | None,
    origin: ArrayLike,
    stress_free: bool,
    stretching: float | None,
    measure: str,
) -> Any:
    """Return a rod whose smooth strains are uniform: a straight line, an arc or a helix."""
    one_of("measure", measure, MEASURES)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    middle = ends[:-1] + 0.5 * lengths
    frames = multiply(_frame(tangent, director), exponential(middle[:, None] * strain))
    natural = np.zeros((lengths.size + 1, 3))
    if stress_free and np.any(strain):
        spans = _spans(lengths, closed=False)
        turns = spans[:, None] * strain
        size = np.linalg.norm(strain)
        if np.max(spans) * size >= math.pi:
            raise InvalidInput(
                f"the rod turns by {np.max(spans) * size:.4g} radians from one segment to the next; "
                "use more segments, so that this is below pi"
            )
        natural = strain_from_rotation(exponential(turns), measure) / spans[:, None]
    return _rod(law, lengths, natural, frames, origin, stretching=stretching, measure=measure)


# ---------------------------------------------------------------------------------------------
# Shapes


def straight(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    lengths: ArrayLike | None = None,
    tangent: ArrayLike = (0.0, 0.0, 1.0),
    director: ArrayLike | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    stretching: float | None = None,
    measure: str = "sine",
) -> Any:
    """Return a straight rod without twist.

    Parameters
    ----------
    length : float
        Rest length.
    segments : int
        Number of segments, at least 2.
    law : Law
        Energy per unit length as a function of the strain densities.
    lengths : array_like, shape (N,), optional
        Rest lengths of the segments of a non-uniform mesh, in place of `length` and `segments`.
    tangent : array_like, shape (3,)
        Direction of the rod, d3.
    director : array_like, shape (3,), optional
        Direction of d1, normal to the tangent. By default e1, turned with e3 to the tangent on the
        shortest way.
    origin : array_like, shape (3,)
        Position of node 0.
    stretching : float, optional
        Stretching stiffness; None is an inextensible rod.
    measure : {"sine", "angle", "averaged"}
        Strain measure of the hinges.

    Returns
    -------
    Rod

    Raises
    ------
    InvalidInput
        If an argument is wrong.

    Examples
    --------
    >>> from lissome import rods
    >>> rod = rods.straight(2.0, 4, rods.Kirchhoff(1.0, 0.8))
    >>> print(rod.positions(rod.initial)[-1])
    [0. 0. 2.]
    """
    rest = _rest_lengths(length, segments, lengths)
    zero = np.zeros(3)
    return _screw(rest, law, zero, tangent, director, origin, True, stretching, measure)


def arc(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    angle: float,
    about: int = 1,
    stress_free: bool = True,
    lengths: ArrayLike | None = None,
    tangent: ArrayLike = (0.0, 0.0, 1.0),
    director: ArrayLike | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    stretching: float | None = None,
    measure: str = "sine",
) -> Any:
    """Return a rod in the shape of a circular arc.

    Parameters
    ----------
    length, segments, law, lengths, origin, stretching, measure
        As of :func:`straight`.
    angle : float
        Angle (radians) by which the tangent turns over the length, about d1 or d2: the curvature is
        `angle` over the length.
    about : {1, 2}
        The director that the rod bends about.
    stress_free : bool
        Whether the arc is the rest shape; else the rod is naturally straight, and held in this shape
        it is under stress.
    tangent, director : array_like, shape (3,)
        d3 and d1 at the start.

    Returns
    -------
    Rod

    Raises
    ------
    InvalidInput
        If an argument has a wrong shape or value.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome import rods
    >>> half = rods.arc(np.pi, 100, rods.Kirchhoff(1.0, 0.8), angle=np.pi)
    >>> print(half.positions(half.initial)[-1].round(3) + 0.0)
    [ 0. -2.  0.]
    """
    rest = _rest_lengths(length, segments, lengths)
    strain = np.zeros(3)
    strain[_bending_axis(about)] = finite("angle", angle, unit="radians") / rest.sum()
    return _screw(rest, law, strain, tangent, director, origin, stress_free, stretching, measure)


def helix(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    curvature: float,
    torsion: float,
    about: int = 1,
    stress_free: bool = True,
    lengths: ArrayLike | None = None,
    tangent: ArrayLike = (0.0, 0.0, 1.0),
    director: ArrayLike | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    stretching: float | None = None,
    measure: str = "sine",
) -> Any:
    """Return a rod in the shape of a helix, whose directors turn with its normal.

    Parameters
    ----------
    length, segments, law, lengths, origin, stretching, measure
        As of :func:`straight`.
    curvature, torsion : float
        Of the center line (1/length). The torsion is also the twist; positive is right-handed.
    about : {1, 2}
        The director along the binormal, that the rod bends about.
    stress_free : bool
        Whether the helix is the rest shape; else the rod is naturally straight.
    tangent, director : array_like, shape (3,)
        d3 and d1 at the start.

    Returns
    -------
    Rod

    Raises
    ------
    InvalidInput
        If an argument has a wrong shape or value.

    Examples
    --------
    >>> from lissome import rods
    >>> spring = rods.helix(10.0, 200, rods.Kirchhoff(1.0, 0.8), curvature=2.0, torsion=0.5)
    >>> print(spring.natural[100].round(2))
    [2.  0.  0.5]
    """
    rest = _rest_lengths(length, segments, lengths)
    strain = np.zeros(3)
    strain[_bending_axis(about)] = finite("curvature", curvature)
    strain[2] = finite("torsion", torsion)
    return _screw(rest, law, strain, tangent, director, origin, stress_free, stretching, measure)


def ring(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    natural_curvature: float | None = None,
    turns: float = 0.0,
    about: int = 1,
    lengths: ArrayLike | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    tangent: ArrayLike = (1.0, 0.0, 0.0),
    origin: ArrayLike = (0.0, 0.0, 0.0),
    stretching: float | None = None,
    measure: str = "sine",
) -> Any:
    r"""Return a closed rod in the shape of a circle: of a polygon inscribed in one.

    Parameters
    ----------
    length, segments, law, lengths, stretching, measure
        As of :func:`straight`; at least 3 segments.
    natural_curvature : float, optional
        Natural curvature (1/length) about the director `about`. By default the circle is at rest,
        but for its twist. See also :meth:`~lissome.rods.Rod.with_overcurvature`.
    turns : float
        Turns of twist about d3 between the two ends that are joined, spread evenly; 0.5 is the
        Möbius band. Natural twist is zero, natural curvature by default that of the circle, about the
        material director `about`, which turns with the twist; the twisted ring of Michell
        is straight at rest: ``natural_curvature=0``.
    about : {1, 2}
        The director that the rod bends about. At the start it is the normal of the plane.
    normal : array_like, shape (3,)
        Normal of the plane of the ring, which runs counterclockwise about it.
    tangent : array_like, shape (3,)
        Direction of the first segment.
    origin : array_like, shape (3,)
        Position of node 0.

    Returns
    -------
    Rod

    Raises
    ------
    InvalidInput
        If an argument is wrong, the tangent is not normal to the normal, or one segment is longer than
        the others together.

    Examples
    --------
    >>> from lissome import rods
    >>> circle = rods.ring(6.0, 60, rods.Kirchhoff(1.0, 0.8))
    >>> print(circle.natural[0].round(3))
    [1.047 0.    0.   ]
    """
    rest = _rest_lengths(length, segments, lengths)
    one_of("measure", measure, MEASURES)
    axis = _bending_axis(about)
    count = rest.size
    if count < 3:
        raise InvalidInput(f"argument `segments` is {count}; a ring has at least 3")
    up, along_first = _direction("normal", normal), _direction("tangent", tangent)
    if abs(up @ along_first) > _RIGHT_ANGLE:
        raise InvalidInput(
            f"argument `tangent` is {tangent!r}; it must lie in the plane of the ring, whose normal is "
            f"{normal!r}"
        )
    # d1 is the normal, or d2 is and d1 = d2 x d3.
    first = _frame(along_first, up if axis == 0 else np.cross(up, along_first))
    central = _central_angles(rest)
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (central[:-1] + central[1:]))])
    bend = np.zeros((count, 3))
    bend[:, axis] = heading
    middle = np.cumsum(rest) - 0.5 * rest
    spin = np.zeros((count, 3))
    total = 2.0 * math.pi * finite("turns", turns)
    spin[:, 2] = total * (middle - middle[0]) / rest.sum()
    frames = multiply(multiply(first, exponential(bend)), exponential(spin))
    natural = np.zeros((count + 1, 3))
    if natural_curvature is None:
        turn_at = np.zeros((count + 1, 3))
        turn_at[:-1, axis] = 0.5 * (np.roll(central, 1) + central)
        turn_at[-1] = turn_at[0]
        strain = strain_from_rotation(exponential(turn_at), measure)
        natural = strain / _spans(rest, closed=True)[:, None]
    else:
        natural[:, axis] = finite("natural_curvature", natural_curvature)
    return _rod(
        law,
        rest,
        natural,
        frames,
        origin,
        stretching=stretching,
        measure=measure,
        closed=True,
        joint=total,
    )


def _central_angles(lengths: Array) -> Array:
    """Return the angles at which the sides of a polygon are seen from the center of its circle."""
    longest = float(lengths.max())
    if np.ptp(lengths) <= 1e-14 * longest:
        return np.full(lengths.size, 2.0 * math.pi / lengths.size)

    def angles(ratio: float) -> Array:  # of the longest side to the diameter
        return 2.0 * np.arcsin(np.minimum(lengths / longest * ratio, 1.0))

    if angles(1.0).sum() <= 2.0 * math.pi:
        # The center lies outside: the longest side is seen at more than half a turn. Such polygons
        # are no rings.
        raise InvalidInput(
            "argument `lengths` has one segment that is nearly as long as all others together; use "
            "more even lengths"
        )
    ratio = brentq(
        lambda r: angles(r).sum() - 2.0 * math.pi, 1.0 / lengths.size / 4.0, 1.0, xtol=1e-16
    )
    result = angles(float(ratio))
    return result * (2.0 * math.pi / result.sum())


@jit
def _carry(first, tangents, frames):
    """Carry a frame from segment to segment by parallel transport."""
    frames[0] = first
    for j in range(1, tangents.shape[0]):
        x, y, z = tangents[j - 1] + tangents[j]
        size = math.sqrt(x * x + y * y + z * z)
        c = np.cross(tangents[j - 1], tangents[j])
        old = (frames[j - 1, 0], frames[j - 1, 1], frames[j - 1, 2], frames[j - 1, 3])
        new = mul((0.5 * size, c[0] / size, c[1] / size, c[2] / size), old)
        # d3 is the tangent to the last digit: no drift over many segments
        t = turn(new, (0.0, 0.0, 1.0))
        d = np.array([t[0], t[1], t[2]])
        s = d + tangents[j]
        e = np.cross(d, tangents[j])
        half = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        new = mul((0.5 * half, e[0] / half, e[1] / half, e[2] / half), new)
        norm = math.sqrt(new[0] ** 2 + new[1] ** 2 + new[2] ** 2 + new[3] ** 2)
        for a in range(4):
            frames[j, a] = new[a] / norm


def along(
    nodes: ArrayLike,
    law: Any = None,
    *,
    directors: ArrayLike | None = None,
    closed: bool = False,
    turns: float = 0.0,
    stress_free: bool = True,
    stretching: float | None = None,
    measure: str = "sine",
) -> Any:
    """Return a rod through given nodes.

    Parameters
    ----------
    nodes : array_like, shape (N + 1, 3)
        Positions; of a closed rod shape (N, 3), without repeating the first node.
    law : Law
        Energy per unit length as a function of the strain densities.
    directors : array_like, optional
        Shape (3,): d1 of the first segment, from which frames are carried on without twist; its part
        along the segment must vanish. Shape (N, 3): d1 of each segment. Shape (N, 3, 3): all
        directors, ``directors[j, I]`` is director I of segment j. By default e1, or where that is
        nearly along the first segment e2, made normal to it and carried on. What is carried around a
        closed rod comes back turned about the tangent; the difference is spread over the rod.
    closed : bool
        Whether a last segment joins the last node with the first.
    turns : float
        Turns of twist about d3 across the joint of a closed rod, beyond the frames that are given (or
        spread over the rod, if they are carried).
    stress_free : bool
        Whether the shape is at rest; else the rod is naturally straight.
    stretching, measure
        As of :func:`straight`.

    Returns
    -------
    Rod
        Its rest lengths are the distances between nodes. At the ends of an open rod natural strains
        are those of the next hinge.

    Raises
    ------
    InvalidInput
        If nodes are repeated, two segments fold back on each other, frames are not orthonormal or not
        along the segments, or neighboring frames are half a turn apart.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome import rods
    >>> s = np.linspace(0, 1, 21)
    >>> wave = np.stack([0 * s, 0.1 * np.sin(2 * np.pi * s), s], axis=1)
    >>> rod = rods.along(wave, rods.Kirchhoff(1.0, 0.8))
    >>> bool(np.allclose(rod.positions(rod.initial), wave))
    True
    """
    points = moderate("nodes", finite_array("nodes", nodes, (None, 3)))
    one_of("measure", measure, MEASURES)
    if not isinstance(closed, (bool, np.bool_)):
        raise InvalidInput(f"argument `closed` is {closed!r}; pass True or False")
    total = 2.0 * math.pi * finite("turns", turns)
    if total and not closed:
        raise InvalidInput(f"argument `turns` is {turns}; only a closed rod has a joint to twist")
    least = 3
    if points.shape[0] < least:
        raise InvalidInput(
            f"argument `nodes` has {points.shape[0]} rows; a rod has at least {least} nodes"
        )
    if closed:
        points = np.concatenate([points, points[:1]])
    edges = np.diff(points, axis=0)
    rest = np.sqrt(np.sum(edges**2, axis=1))
    extent = float(np.max(np.ptp(points, axis=0)))
    if np.any(rest <= 1e-13 * extent):
        j = int(np.argmin(rest))
        after = (j + 1) % (points.shape[0] - 1) if closed else j + 1
        hint = " (do not repeat the first node of a closed rod)" if closed and after == 0 else ""
        raise InvalidInput(
            f"argument `nodes` has the same position {points[j]} at {j} and {after}; nodes must not "
            f"repeat{hint}"
        )
    tangents = edges / rest[:, None]
    _refuse_folds(tangents, closed)
    frames, joint = _frames_along(tangents, rest, directors, closed, total)
    count = rest.size
    spans = _spans(rest, closed)
    hinges = multiply(conjugate(frames[:-1]), frames[1:])
    if closed:
        last = multiply(frames[0], exponential([0.0, 0.0, joint]))
        hinges = np.concatenate([multiply(conjugate(frames[-1]), last)[None], hinges])
    if np.any(np.abs(hinges[:, 0]) < 1e-6):
        i = int(np.argmin(np.abs(hinges[:, 0]))) + (0 if closed else 1)
        raise InvalidInput(
            f"the frames on both sides of node {i} are half a turn apart; pass directors that turn less "
            "from one segment to the next, or use more nodes"
        )
    natural = np.zeros((count + 1, 3))
    if stress_free:
        hinges /= np.linalg.norm(hinges, axis=1)[:, None]
        strain = strain_from_rotation(hinges, measure)
        if closed:
            natural[:-1] = strain / spans[:-1, None]
            natural[-1] = natural[0]
        else:
            natural[1:-1] = strain / spans[1:-1, None]
            natural[0], natural[-1] = natural[1], natural[-2]
    return _rod(
        law,
        rest,
        natural,
        frames,
        points[0],
        stretching=stretching,
        measure=measure,
        closed=bool(closed),
        joint=joint,
    )


def _refuse_folds(tangents: Array, closed: bool) -> None:
    following = np.roll(tangents, -1, axis=0) if closed else tangents[1:]
    opening = np.linalg.norm(tangents[: following.shape[0]] + following, axis=1)
    if np.any(opening < ANTIPARALLEL):
        i = (int(np.argmin(opening)) + 1) % tangents.shape[0]
        raise InvalidInput(
            f"argument `nodes` folds back on itself at node {i}: the segments that meet there have "
            "opposite directions; move a node, or add one between"
        )


def _frames_along(
    tangents: Array, rest: Array, directors: ArrayLike | None, closed: bool, total: float
) -> tuple[Array, float]:
    """Return frames of segments with given tangents, and the angle across the joint."""
    count = tangents.shape[0]
    given = None if directors is None else finite_array("directors", directors)
    if given is None or given.shape == (3,):
        if given is None:
            given = np.eye(3)[0 if abs(tangents[0, 0]) < 0.9 else 1]
            given = given - (given @ tangents[0]) * tangents[0]
        first = _frame(tangents[0], given)
        frames = np.empty((count, 4))
        _carry(first, tangents, frames)
        if closed:
            frames = _closed_up(frames, tangents, rest, total)
        return frames, total if closed else 0.0
    if given.shape == (count, 3):
        sizes = np.linalg.norm(given, axis=1)
        if np.any(np.abs(sizes - 1.0) > _RIGHT_ANGLE):
            j = int(np.argmax(np.abs(sizes - 1.0)))
            raise InvalidInput(
                f"argument `directors`[{j}] has length {sizes[j]:.9g}; pass unit vectors"
            )
        given = np.stack([given, np.cross(tangents, given), tangents], axis=1)
        name = "d1"
    elif given.shape == (count, 3, 3):
        off = np.max(np.abs(given[:, 2] - tangents), axis=1)
        if np.any(off > _RIGHT_ANGLE):
            j = int(np.argmax(off))
            raise InvalidInput(
                f"argument `directors`[{j}, 2] is {given[j, 2]}, the segment has the direction "
                f"{tangents[j]}; d3 must be the unit tangent"
            )
        name = "directors"
    else:
        raise InvalidInput(
            f"argument `directors` has shape {given.shape}; it must be (3,), ({count}, 3) or "
            f"({count}, 3, 3) for {count} segments"
        )
    slant = np.abs(np.einsum("ja,ja->j", given[:, 0], tangents))
    if name == "d1" and np.any(slant > _RIGHT_ANGLE):
        j = int(np.argmax(slant))
        raise InvalidInput(
            f"argument `directors`[{j}] is {given[j, 0]}, which is not normal to the segment from node "
            f"{j} (their scalar product is {slant[j]:.3g}); d1 must be normal to the tangent"
        )
    return from_directors(given), total


def _closed_up(frames: Array, tangents: Array, rest: Array, total: float) -> Array:
    """Spread over the rod what is missing when carried frames come back to the first segment."""
    carried = multiply(parallel_transport(tangents[-1], tangents[0]), frames[-1])
    back = multiply(conjugate(frames[0]), carried)  # a turn about d3
    missing = -2.0 * math.atan2(back[3], back[0])
    missing -= 2.0 * math.pi * round(missing / (2.0 * math.pi))
    middle = np.cumsum(rest) - 0.5 * rest
    spin = np.zeros((rest.size, 3))
    spin[:, 2] = (missing + total) * (middle - middle[0]) / rest.sum()
    return multiply(frames, exponential(spin))
