r"""Ribbons of given shapes: flat, bent into a circle, and closed bands with any number of half turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._telling import one_call
from .._validate import finite
from ..errors import InvalidInput
from ..rods import Kirchhoff, Rod, ring
from ..rods import straight as straight_rod
from ..rods.quaternions import exponential, multiply
from ._structure import Ribbon

__all__ = ["WIDEST_BAND", "band", "circle", "straight"]

Array = NDArray[np.float64]

#: No strip wider than this times its length closes with one half turn: flat triangles fold up there.
WIDEST_BAND = 1.0 / math.sqrt(3.0)


def _carrier() -> Kirchhoff:
    """Return the law of the rod that carries mesh, supports and loads: it bends about d1."""
    return Kirchhoff(bending=(1.0, 100.0), twisting=1.0)


def straight(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    lengths: ArrayLike | None = None,
    tangent: ArrayLike = (0.0, 0.0, 1.0),
    director: ArrayLike | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    scheme: str = "staggered",
) -> Ribbon:
    """Return a flat straight ribbon. Its width is along d1, its normal along d2.

    Parameters
    ----------
    length : float
        Length of the center line.
    segments : int
        Number of segments, at least 2.
    law : Wunderlich or Sadowsky
    lengths : array_like, shape (N,), optional
        Lengths of the segments of a non-uniform mesh, in place of `length` and `segments`.
    tangent, director, origin
        Directions of the center line and of d1, and the position of node 0.
    scheme : {"staggered", "cells", "moments", "nodal"}
        Where rulings live; see :class:`Ribbon`.

    Returns
    -------
    Ribbon

    Raises
    ------
    InvalidInput
        If an argument is wrong.

    Examples
    --------
    >>> from lissome import ribbons
    >>> strip = ribbons.straight(1.0, 20, ribbons.Wunderlich(width=0.1, rigidity=1.0))
    >>> strip = strip.clamped("start").clamped("end", position=(0, 0, 0.8))
    """
    rod = straight_rod(
        length,
        segments,
        _carrier(),
        lengths=lengths,
        tangent=tangent,
        director=director,
        origin=origin,
    )
    return Ribbon(law, rod, scheme)


def circle(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    *,
    turn: float = 0.0,
    lengths: ArrayLike | None = None,
    scheme: str = "staggered",
) -> Ribbon:
    """Return an open ribbon bent into a circle, with both ends clamped where they meet.

    Parameters
    ----------
    length, segments, law, lengths, scheme
        As of :func:`straight`.
    turn : float
        Angle (radians) about the tangent by which the end is turned.

    Returns
    -------
    Ribbon

    Raises
    ------
    InvalidInput
        If an argument is wrong.

    Examples
    --------
    >>> from lissome import ribbons
    >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    >>> ribbon = ribbons.circle(1.0, 20, law)
    >>> import lissome as ls
    >>> print(f"{ls.equilibrate(ribbon).strains[5, 0]:.2f}")  # 2 pi, but for the mesh
    6.26
    """
    closed = ring(length, segments, _carrier(), lengths=lengths)
    rod = Rod(_carrier(), closed.lengths, initial=closed.initial)
    first = np.array(closed.initial.quaternions[0])
    angle = math.asin(
        min(1.0, 0.5 * closed.natural[0, 0] * 0.5 * (rod.lengths[0] + rod.lengths[-1]))
    )
    start = multiply(first, exponential([-angle, 0.0, 0.0]))
    end = multiply(start, exponential([0.0, 0.0, finite("turn", turn)]))
    rod = rod.clamped("start", (0.0, 0.0, 0.0), start / np.linalg.norm(start))
    rod = rod.clamped("end", (0.0, 0.0, 0.0), end / np.linalg.norm(end))
    return Ribbon(law, rod, scheme)


@one_call
def band(
    length: float | None = None,
    segments: int | None = None,
    law: Any = None,
    half_turns: int = 1,
    *,
    lengths: ArrayLike | None = None,
    scheme: str = "staggered",
    joint: str = "matched",
) -> Ribbon:
    """Return a closed band: a cylinder (no half turn), a Möbius band (one), or a band twisted more.

    Parameters
    ----------
    length, segments, law, lengths, scheme
        As of :func:`straight`; at least 8 segments.
    half_turns : int
        Number of half turns; its sign is the handedness.
    joint : {"matched", "free"}
        See :class:`Ribbon`.

    Returns
    -------
    Ribbon

    Raises
    ------
    InvalidInput
        If an argument is wrong, or the strip is too wide to close with one half turn.

    Examples
    --------
    Right- and left-handed bands are mirror images:

    >>> import lissome as ls
    >>> from lissome import ribbons
    >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    >>> right, left = (ls.equilibrate(ribbons.band(1.0, 40, law, half)) for half in (1, -1))
    >>> print(f"{right.energy / left.energy:.6f} {right.link:.1f} {left.link:.1f}")
    1.000000 0.5 -0.5
    """
    if isinstance(half_turns, bool) or not isinstance(half_turns, (int, np.integer)):
        raise InvalidInput(
            f"argument `half_turns` is {half_turns!r}; pass a whole number: other bands do not close"
        )
    closed = ring(length, segments, _carrier(), lengths=lengths, turns=0.5 * half_turns)
    if closed.lengths.size < 8:
        raise InvalidInput(f"argument `segments` is {closed.lengths.size}; a band has at least 8")
    rod = Rod(
        _carrier(), closed.lengths, closed=True, joint=math.pi * half_turns, phase=None,
        initial=closed.initial,
    )  # fmt: skip
    return Ribbon(law, rod, scheme, int(half_turns), joint)
