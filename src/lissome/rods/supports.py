"""Supports of rods: what is prescribed at a node."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .._validate import finite, finite_array
from ..errors import InvalidInput
from .quaternions import from_directors

__all__ = ["Support"]

Array = NDArray[np.float64]

#: How far the length of a unit vector or quaternion may be from one.
UNIT = 1e-8


@dataclass(frozen=True, eq=False)
class Support:
    """What is prescribed at a node of a rod.

    Made by :meth:`Rod.clamped`, :meth:`Rod.pinned` and :meth:`Rod.hinged`.

    Attributes
    ----------
    node : int
        Number of the node.
    kind : {"clamped", "pinned", "hinged"}
        Whether position and frame are prescribed, the position only, or the frame but for its angle
        about an axis.
    position : tuple of three float or None
        Prescribed components of the position; None where it is free.
    frame : ndarray (4,) or None
        Prescribed frame, a unit quaternion, scalar first; that at the angle zero if hinged.
    clamp : {"node", "segment"}
        What has the frame: the node, which holds the rod through hinges of half a segment's length
        (second order), or the adjacent segment itself (first order; the clamp of the thesis).
    axis : ndarray (3,) or None
        Spatial unit vector that a hinged frame turns about.
    moment : float
        Dead moment about the axis.

    Examples
    --------
    A rod whose far end may slide along the third axis:

    >>> from lissome import rods
    >>> rod = rods.straight(length=1.0, segments=10, law=rods.Kirchhoff(1.0, 1.0))
    >>> rod = rod.clamped("start").pinned("end", position=(0.0, 0.0, None))
    >>> [(support.node, support.kind, support.position) for support in rod.supports]
    [(0, 'clamped', (0.0, 0.0, 0.0)), (10, 'pinned', (0.0, 0.0, None))]
    """

    node: int
    kind: str
    position: tuple[float | None, float | None, float | None]
    frame: Array | None = None
    clamp: str = "node"
    axis: Array | None = None
    moment: float = 0.0


def as_position(value: Any) -> tuple[float | None, float | None, float | None]:
    """Return a prescribed position, with None for free components."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (tuple, list)) or len(value) != 3:
        raise InvalidInput(
            f"argument `position` is {value!r}; pass three components, None for those that are free"
        )
    x, y, z = (None if v is None else finite(f"position[{i}]", v) for i, v in enumerate(value))
    return (x, y, z)


def as_frame(value: Any) -> Array:
    """Return a frame as a unit quaternion, scalar first.

    A frame is a scipy Rotation (that takes e1, e2, e3 to the directors), the three directors as rows
    of a matrix, or a quaternion with the scalar first.
    """
    if isinstance(value, Rotation):
        if not value.single:
            raise InvalidInput("argument `frame` holds several rotations; pass one")
        return np.asarray(value.as_quat(canonical=True, scalar_first=True))
    shape = np.shape(value)
    if shape == (4,):
        q = finite_array("frame", value, (4,))
        size = float(np.linalg.norm(q))
        if abs(size - 1.0) > UNIT:
            raise InvalidInput(
                f"argument `frame` is a quaternion of length {size:.9g}; pass one of length 1"
            )
        return q / size
    if shape != (3, 3):
        raise InvalidInput(
            f"argument `frame` has shape {shape}; pass a scipy Rotation, the directors as the rows of "
            "a (3, 3) matrix, or a quaternion (4,), scalar first"
        )
    if type(value) is np.ndarray and value.dtype == float:
        return _from_rows(value.tobytes())
    return _from_rows(finite_array("frame", value, (3, 3)).tobytes())


@lru_cache(maxsize=64)
def _from_rows(entries: bytes) -> Array:
    """Return the quaternion of a matrix of directors: a clamp that moves often keeps its frame."""
    q = from_directors(finite_array("frame", np.frombuffer(entries).reshape(3, 3)))
    q.flags.writeable = False
    return q


def as_direction(name: str, value: Any) -> Array:
    """Return a vector divided by its length."""
    vector = finite_array(name, value, (3,))
    size = math.sqrt(float(vector @ vector))
    if not size > 0.0:
        raise InvalidInput(f"argument `{name}` is zero; pass a direction")
    return vector / size
