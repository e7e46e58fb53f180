r"""Director fields: the direction of the mesogens in the plane of the plate.

Point coordinates come first, x and y of any shape; tensors are returned with their two indices in
front, shape (2, 2, ...), which is how scikit-fem wants them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite, finite_array
from ..errors import InvalidInput

__all__ = [
    "Defect",
    "DirectedTensor",
    "Director",
    "UniformDirector",
    "UserDirector",
    "require_inside",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Director:
    """Base class of director fields; a subclass gives the angle of the director from the x axis.

    Examples
    --------
    A field of your own that points away from the origin, and the strain that goes with it:

    >>> import numpy as np
    >>> from lissome.plates import Director
    >>> class Radial(Director):
    ...     def angle(self, x, y):
    ...         return np.arctan2(y, x)
    >>> strain = Radial().tensor(3.0, 4.0, along=-0.1, across=0.05)
    >>> print(strain @ [3.0, 4.0] / -0.1, np.trace(strain).round(9))
    [3. 4.] -0.05
    """

    def angle(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the angle of the director at points `x`, `y`, of their shape.

        In radians; half a turn means nothing.
        """
        raise NotImplementedError

    def tensor(self, x: ArrayLike, y: ArrayLike, along: ArrayLike, across: ArrayLike) -> Array:
        r"""Return the tensor :math:`a\,n\otimes n + b\,(1 - n\otimes n)` at points.

        Parameters
        ----------
        x, y : array_like
            Coordinates, of one shape.
        along, across : array_like
            a and b: numbers, or arrays that broadcast with the points.

        Returns
        -------
        numpy.ndarray, shape (2, 2, ...)
        """
        px, py = _points(x, y)
        double = 2.0 * self.angle(px, py)
        a, b = np.asarray(along, dtype=float), np.asarray(across, dtype=float)
        mean, half = 0.5 * (a + b), 0.5 * (a - b)
        visible = self._order(px, py)
        c, s = half * visible * np.cos(double), half * visible * np.sin(double)
        return np.array([[mean + c, s], [s, mean - c]])

    def field(self, along: float, across: float) -> DirectedTensor:
        """Return the tensor as a function of x and y, which is what :class:`.Plate` takes.

        Parameters
        ----------
        along, across : float
            Its components along and across the director.

        Returns
        -------
        DirectedTensor
            Callable; it can be pickled.

        Raises
        ------
        InvalidInput
            If a component is not finite.
        """
        return DirectedTensor(self, finite("along", along), finite("across", across))

    def _order(self, x: Array, y: Array) -> Array:
        return np.ones(x.shape)


@dataclass(frozen=True)
class DirectedTensor:
    """A tensor field with constant components along and across a director.

    Attributes
    ----------
    director : Director
        The field of directions.
    along, across : float
        The components.

    Examples
    --------
    >>> from lissome.plates import UniformDirector
    >>> tensor = UniformDirector(0.0).field(along=-0.1, across=0.05)
    >>> print(tensor([0.0, 1.0], [0.0, 1.0]).shape)
    (2, 2, 2)
    """

    director: Director
    along: float
    across: float

    def __call__(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the tensor at points, shape (2, 2, ...)."""
        return self.director.tensor(x, y, self.along, self.across)


@dataclass(frozen=True)
class UniformDirector(Director):
    """One direction everywhere.

    Parameters
    ----------
    direction : float
        Angle from the x axis (radians).

    Raises
    ------
    InvalidInput
        If the angle is not finite.

    Examples
    --------
    >>> from lissome.plates import UniformDirector
    >>> print(UniformDirector(0.0).tensor(0.3, 0.2, along=-0.1, across=0.05) + 0.0)
    [[-0.1   0.  ]
     [ 0.    0.05]]
    """

    direction: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", finite("direction", self.direction))

    def angle(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the angle of the director at points (radians)."""
        return np.full(_points(x, y)[0].shape, self.direction)


@dataclass(frozen=True)
class Defect(Director):
    r"""A point defect: the director turns `charge` times on a way around it.

    .. math:: \angle n = q\,\varphi + \varphi_0, \qquad \varphi = \operatorname{atan2}(y - y_c, x - x_c)

    Parameters
    ----------
    charge : float
        q: a multiple of 1/2, not zero.
    center : (float, float)
        Where the defect sits.
    phase : float
        :math:`\varphi_0` (radians). For charge +1: a quarter turn (the default) gives circles
        around the center, as in the thesis, 0 gives rays, anything between spirals.

    Raises
    ------
    InvalidInput
        If the charge is no multiple of 1/2 or zero, or a number is not finite.

    Notes
    -----
    At the center itself the direction is undefined; the tensor there is its mean over a small
    circle, (a + b)/2 times the identity.

    Examples
    --------
    Hoops contract where the director runs in circles, and radii expand:

    >>> from lissome.plates import Defect
    >>> print(Defect().tensor(1.0, 0.0, along=-0.1, across=0.05).round(12) + 0.0)
    [[ 0.05  0.  ]
     [ 0.   -0.1 ]]
    >>> Defect(charge=0.3)
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `charge` is 0.3; it must be a multiple of 1/2 other than 0: a director that turns otherwise does not close
    """  # noqa: E501

    charge: float = 1.0
    center: tuple[float, float] = (0.0, 0.0)
    phase: float = 0.5 * math.pi

    def __post_init__(self) -> None:
        charge = finite("charge", self.charge)
        if charge == 0.0 or (2.0 * charge) % 1.0 != 0.0:
            raise InvalidInput(
                f"argument `charge` is {charge!r}; it must be a multiple of 1/2 other than 0: a "
                "director that turns otherwise does not close"
            )
        center = finite_array("center", self.center, (2,))
        object.__setattr__(self, "charge", charge)
        object.__setattr__(self, "center", (float(center[0]), float(center[1])))
        object.__setattr__(self, "phase", finite("phase", self.phase))

    def angle(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the angle of the director at points (radians)."""
        px, py = _points(x, y)
        turn = np.arctan2(py - self.center[1], px - self.center[0])
        return np.asarray(self.charge * turn + self.phase)

    def _order(self, x: Array, y: Array) -> Array:
        return ((x != self.center[0]) | (y != self.center[1])).astype(float)


@dataclass(frozen=True)
class UserDirector(Director):
    """A director field of your own.

    Parameters
    ----------
    function : callable
        Takes x and y, arrays of one shape, and returns the angle of the director in radians.

    Raises
    ------
    InvalidInput
        If it is not callable; on use, if it returns another shape or numbers that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.plates import UserDirector
    >>> waves = UserDirector(lambda x, y: 0.3 * np.sin(x))
    >>> print(float(waves.angle(0.0, 1.0)))
    0.0
    """

    function: Callable[[Array, Array], ArrayLike]

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InvalidInput(
                f"argument `function` is {self.function!r}; pass a function of x and y that returns "
                "the angle of the director"
            )

    def angle(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return the angle of the director at points (radians).

        Raises
        ------
        InvalidInput
            If the function returns another shape, or a number that is not finite.
        """
        px, py = _points(x, y)
        angle = np.asarray(self.function(px, py), dtype=float)
        if angle.shape != px.shape or not np.isfinite(angle).all():
            raise InvalidInput(
                f"argument `function` returns an array of shape {angle.shape} for points of shape "
                f"{px.shape}, or angles that are not finite; return one finite angle for each point"
            )
        return angle


def require_inside(defect: Defect, mesh: Any) -> None:
    """Refuse a defect that lies outside a plate.

    Parameters
    ----------
    defect : Defect
        A point defect.
    mesh : skfem.MeshTri or skfem.MeshQuad
        The plate.

    Raises
    ------
    InvalidInput
        If no element of the mesh holds the center.

    Examples
    --------
    >>> import skfem
    >>> from lissome.plates import Defect, require_inside
    >>> require_inside(Defect(center=(0.5, 0.5)), skfem.MeshTri().refined(2))
    """
    if not isinstance(defect, Defect):
        raise InvalidInput(f"argument `defect` is {defect!r}; only a Defect has a center")
    # Every triangle, and both halves of every convex quadrilateral, by barycentric signs.
    corners = np.asarray(mesh.t)[[0, 1, 2] if len(mesh.t) < 4 else [0, 1, 2, 0, 2, 3]]
    point = np.array(defect.center)
    inside = False
    scale = float(np.ptp(np.asarray(mesh.p), axis=1).max())
    for triple in (corners[i : i + 3] for i in range(0, len(corners), 3)):
        a, b, c = (np.asarray(mesh.p)[:, row] for row in triple)
        signs = np.stack(
            [_cross(q - p, point[:, None] - p) for p, q in ((a, b), (b, c), (c, a))]
        ) * np.sign(_cross(b - a, c - a))
        inside |= bool((signs >= -1e-12 * scale**2).all(axis=0).any())
    if not inside:
        raise InvalidInput(
            f"argument `defect` has its center at {defect.center}, outside the plate (x from "
            f"{mesh.p[0].min():g} to {mesh.p[0].max():g}, y from {mesh.p[1].min():g} to "
            f"{mesh.p[1].max():g}, without its holes); move the center onto the plate"
        )


def _cross(a: Array, b: Array) -> Array:
    return a[0] * b[1] - a[1] * b[0]


def _points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    px, py = finite_array("x", x), finite_array("y", y)
    if px.shape != py.shape:
        raise InvalidInput(
            f"argument `y` has shape {py.shape}; it must have the shape of `x`, {px.shape}"
        )
    return px, py
