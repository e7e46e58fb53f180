"""Light: where it comes from, and how much of it reaches each point of the lit face.

Light carries no sign. Whether a lit face contracts or expands is the material's matter, and
belongs to the strip (``response``); which face is lit follows from the geometry.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite, nonnegative, one_of, positive
from ..errors import InvalidInput

__all__ = ["GaussianSpot", "Light", "ParallelLight", "UserLight"]

Array = NDArray[np.float64]
SIDES = ("upper", "lower")


@dataclass(frozen=True)
class ParallelLight:
    r"""A wide parallel beam of uniform intensity.

    A face with unit normal :math:`\mathbf n` receives the flux :math:`I_0
    \max(0, \mathbf n \cdot \mathbf e)` with :math:`\mathbf e` the direction of the source: faces
    turned away are in their own shadow, (3.11) of the thesis.

    Parameters
    ----------
    intensity : float
        :math:`I_0 \ge 0`, dimensionless. Times the response of the strip it is the
        parameter :math:`\Lambda` of (3.14).
    angle : float
        Angle of the direction of the source from the vertical (radians), positive to the left.
    side : {"upper", "lower"}
        Whether the source is above or below.

    Raises
    ------
    InvalidInput
        If the intensity is negative or a number is not finite.

    Examples
    --------
    >>> from lissome.beams import ParallelLight
    >>> print(ParallelLight(10.0, angle=0.0).flux(0.0, 0.0, [0.0, 2.0]))
    [10.  0.]
    """

    intensity: float
    angle: float = 0.0
    side: str = "upper"

    def __post_init__(self) -> None:
        object.__setattr__(self, "intensity", nonnegative("intensity", self.intensity))
        object.__setattr__(self, "angle", finite("angle", self.angle, unit="radians"))
        one_of("side", self.side, SIDES)

    @property
    def toward(self) -> tuple[float, float]:
        """Unit vector to the source."""
        vertical = 1.0 if self.side == "upper" else -1.0
        return -math.sin(self.angle), vertical * math.cos(self.angle)

    def flux(
        self, x: ArrayLike, y: ArrayLike, theta: ArrayLike, face: float | None = None
    ) -> Array:
        """Return the flux on a face, at positions `x`, `y` where the tangent has angle `theta`.

        Parameters
        ----------
        x, y, theta : array_like
            Position and angle of the tangent from the horizontal (radians).
        face : float, optional
            +1 for the face to the left of the tangent, -1 for the other one; by default the face
            that a flat strip turns to the source.

        Returns
        -------
        ndarray
            Of the broadcast shape of `x`, `y` and `theta`, in the unit of the intensity.
        """
        if face is None:
            face = 1.0 if self.side == "upper" else -1.0
        theta = np.asarray(theta, dtype=float)
        ex, ey = self.toward
        facing = face * (ey * np.cos(theta) - ex * np.sin(theta))
        return self.intensity * np.maximum(facing, 0.0) * self._profile(x, y)

    def _profile(self, x: ArrayLike, y: ArrayLike) -> ArrayLike:
        return 1.0

    def _lamp(self, gain: float, face: float) -> tuple[float, ...]:
        ex, ey = self.toward
        return (gain * self.intensity, ex, ey, face, 0.0, 0.0)


@dataclass(frozen=True)
class GaussianSpot(ParallelLight):
    r"""A parallel beam with a Gaussian profile, (3.32) of the thesis.

    The intensity at distance r from the axis of the beam is :math:`I_0 \exp(-r^2 / 2 W^2)`.

    Parameters
    ----------
    intensity : float
        :math:`I_0 \ge 0` on the axis, dimensionless.
    center : float
        Where the axis crosses the horizontal through the left clamp (in lengths of the strip).
    width : float
        W > 0, in lengths of the strip, measured across the beam.
    angle : float
        Angle of the direction of the source from the vertical (radians), positive to the left.
    side : {"upper", "lower"}
        Whether the source is above or below.

    Raises
    ------
    InvalidInput
        If the intensity is negative, the width is not positive, or a number is not finite.

    Examples
    --------
    >>> from lissome.beams import GaussianSpot
    >>> print(GaussianSpot(1.0, center=0.5, width=0.1).flux([0.5, 0.6], 0.0, 0.0).round(4))
    [1.     0.6065]
    """

    center: float = 0.5
    width: float = 0.1

    def __init__(
        self,
        intensity: float,
        center: float,
        width: float,
        angle: float = 0.0,
        side: str = "upper",
    ) -> None:
        object.__setattr__(self, "intensity", intensity)
        object.__setattr__(self, "angle", angle)
        object.__setattr__(self, "side", side)
        object.__setattr__(self, "center", finite("center", center))
        object.__setattr__(self, "width", positive("width", width))
        super().__post_init__()

    def _profile(self, x: ArrayLike, y: ArrayLike) -> ArrayLike:
        ex, ey = self.toward
        r = (np.asarray(x, dtype=float) - self.center) * ey - np.asarray(y, dtype=float) * ex
        return np.exp(-0.5 * (r / self.width) ** 2)

    def _lamp(self, gain: float, face: float) -> tuple[float, ...]:
        ex, ey = self.toward
        return (gain * self.intensity, ex, ey, face, self.center, self.width)


@dataclass(frozen=True)
class UserLight:
    """Light of any kind: a function gives the flux on the lit face.

    Parameters
    ----------
    function : callable
        ``function(x, y, theta, s, t)`` with arrays of shape (m,): position, angle of the tangent
        (radians, unwrapped), arc length, and the time t (a number). It returns the flux that the lit
        face receives, shape (m,), not negative: orientation and shadows are up to the function.
    side : {"upper", "lower"}
        Whether the upper or the lower face of a strip is lit. (Of a ring it is the outer one.)

    Raises
    ------
    InvalidInput
        If `function` cannot be called, or `side` is neither of the two.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.beams import UserLight
    >>> lamp = UserLight(lambda x, y, theta, s, t: 5 * np.maximum(np.cos(theta - 0.1 * t), 0))
    >>> lamp.side
    'upper'
    """

    function: Callable[[Array, Array, Array, Array, float], ArrayLike]
    side: str = "upper"

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InvalidInput(
                f"argument `function` is {self.function!r}; pass a function (x, y, theta, s, t) "
                "that returns the flux"
            )
        one_of("side", self.side, SIDES)

    def flux(self, x: Array, y: Array, theta: Array, s: Array, t: float) -> Array:
        """Return the checked flux, shape (m,).

        Parameters
        ----------
        x, y : ndarray, shape (m,)
            Positions (in units of the length).
        theta : ndarray, shape (m,)
            Angles of the tangent (radians).
        s : ndarray, shape (m,)
            Arc lengths, in (0, 1).
        t : float
            The time (relaxation times).

        Raises
        ------
        InvalidInput
            If the function returns another shape, a number that is not finite, or a negative one.
        """
        try:
            flux = np.asarray(self.function(x, y, theta, s, t), dtype=float)
        except (TypeError, ValueError) as error:
            raise InvalidInput(
                f"the light function failed, or returned no array of numbers: {error}; "
                f"it must take (x, y, theta, s, t) and return an array of shape {x.shape}"
            ) from error
        if flux.shape != x.shape:
            raise InvalidInput(
                f"the light function returned an array of shape {flux.shape}; "
                f"it must return one flux for each point, shape {x.shape}"
            )
        if not np.all(np.isfinite(flux)):
            place = int(np.argmin(np.isfinite(flux)))
            raise InvalidInput(
                f"the light function returned {flux[place]} at s = {s[place]:.6g}, t = {t:.6g}; "
                "the flux must be finite"
            )
        if np.any(flux < 0):
            place = int(np.argmin(flux))
            raise InvalidInput(
                f"the light function returned {flux[place]} at s = {s[place]:.6g}, t = {t:.6g}; "
                "the flux must not be negative (the sign of the effect is the strip's `response`)"
            )
        return flux


Light = ParallelLight | GaussianSpot | UserLight
