r"""From the energy of a snap to a leap: energy bound, ballistics.

If all of the released energy lifted the plate, it would rise by
:math:`\Delta\mathcal E/(\rho h L^2 g)`. That is a bound and no prediction: a snap in free space gives
the plate no net momentum, only what it pushes off from does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite, in_open_interval, nonnegative, positive
from ..errors import InvalidInput

__all__ = [
    "Flight",
    "energy_height",
    "flight_from_heights",
    "launch_speed_with_drag",
    "terminal_speed",
]

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.8  # m/s^2, as in Table 5.2


def energy_height(
    released_energy: ArrayLike,
    *,
    stretching_modulus: float,
    thickness: float,
    density: float,
    gravity: float = STANDARD_GRAVITY,
) -> Array:
    r"""Return the height to which the energy of a snap could lift the plate.

    .. math:: \hat z = \frac{C}{\rho g h}\, \Delta\bar{\mathcal E}, \qquad
              \Delta\bar{\mathcal E} = \frac{\Delta\mathcal E}{C L^2}

    (section 5.4 of the thesis). The plate is a square of side L, or L squared is its area.

    Parameters
    ----------
    released_energy : array_like
        :math:`\Delta\bar{\mathcal E}`, dimensionless, zero or more.
    stretching_modulus : float
        C: force per length.
    thickness, density, gravity : float
        h, mass per volume, and acceleration; positive, in units that fit C.

    Returns
    -------
    numpy.ndarray
        Heights: an upper bound.

    Raises
    ------
    InvalidInput
        If an energy is negative, or another number not positive.

    Notes
    -----
    By the scaling law :math:`\Delta\bar{\mathcal E} = (t/L)^4\, G(\varepsilon L^2/t^2)`. Sheets of one
    shape, h/L, and one strain release the same :math:`\Delta\bar{\mathcal E}`, and C/h does not depend
    on the size: the bound is the same for all. It is not for sheets of one thickness.

    Examples
    --------
    Table 5.2 of the thesis, its modulus read in Pa m:

    >>> from lissome.plates import energy_height
    >>> z = energy_height(2.0e-4, stretching_modulus=1053.0, thickness=90e-6, density=1200.0)
    >>> print(f"{z:.3f}")
    0.199
    """
    try:
        energy = np.asarray(released_energy, dtype=float)  # a `literature.Number` will do
    except (TypeError, ValueError):
        energy = np.asarray(np.nan)
    if not np.all((energy >= 0.0) & np.isfinite(energy)):
        raise InvalidInput(
            f"argument `released_energy` is {released_energy!r}; it must hold finite numbers of at "
            "least 0: a snap sets energy free"
        )
    c = positive("stretching_modulus", stretching_modulus)
    weight = (
        positive("density", density)
        * positive("gravity", gravity)
        * positive("thickness", thickness)
    )
    return np.asarray(energy * c / weight)


@dataclass(frozen=True)
class Flight:
    r"""A body thrown without resistance: the leap of a sheet as its center of mass sees it.

    Parameters
    ----------
    speed : float
        Launch speed, positive.
    tilt : float
        Angle of the launch from the vertical (radians), within a quarter turn; positive to +x.
    gravity : float
        Positive.

    Raises
    ------
    InvalidInput
        If a number is out of its range.

    Examples
    --------
    >>> import math
    >>> from lissome.plates import Flight
    >>> leap = Flight(speed=0.626, tilt=math.radians(7.0))
    >>> print(f"{1e3 * leap.height:.1f} mm high, {1e3 * leap.range:.1f} mm far")
    19.7 mm high, 9.7 mm far
    """

    speed: float
    tilt: float = 0.0
    gravity: float = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed", positive("speed", self.speed))
        quarter = 0.5 * math.pi
        object.__setattr__(
            self, "tilt", in_open_interval("tilt", self.tilt, -quarter, quarter, "radians")
        )
        object.__setattr__(self, "gravity", positive("gravity", self.gravity))

    @property
    def velocity(self) -> tuple[float, float]:
        """Horizontal and vertical velocity at the launch."""
        return self.speed * math.sin(self.tilt), self.speed * math.cos(self.tilt)

    @property
    def height(self) -> float:
        """Greatest height above the launch."""
        return self.velocity[1] ** 2 / (2.0 * self.gravity)

    @property
    def duration(self) -> float:
        """Time until the height of the launch is reached again."""
        return 2.0 * self.velocity[1] / self.gravity

    @property
    def range(self) -> float:
        """Horizontal distance covered until then; negative for a negative tilt."""
        return self.velocity[0] * self.duration

    def position(self, time: ArrayLike) -> tuple[Array, Array]:
        """Return horizontal and vertical position at `time` after the launch, of its shape."""
        t = np.asarray(time, dtype=float)
        return self.velocity[0] * t, self.velocity[1] * t - 0.5 * self.gravity * t**2

    def leg_difference(self, length: float) -> float:
        """Return by how much the legs of a rigid sheet differ that leaves along its normal.

        Parameters
        ----------
        length : float
            Distance between the longer and the shorter legs.

        Raises
        ------
        InvalidInput
            If the length is not positive.
        """
        return positive("length", length) * math.sin(self.tilt)


def flight_from_heights(
    height: float, distance: float, *, gravity: float = STANDARD_GRAVITY
) -> Flight:
    r"""Return the flight that rises to a measured height and lands a measured distance away.

    .. math:: v_z = \sqrt{2 g z}, \qquad v_x = \frac{g\,x}{2 v_z}, \qquad
              \tan\alpha = \frac{v_x}{v_z} = \frac{x}{4z}

    Parameters
    ----------
    height : float
        z > 0 of the center of mass above the launch.
    distance : float
        x: how far away the body comes back to the height of the launch.
    gravity : float
        Positive.

    Returns
    -------
    Flight

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    A leap 2 cm high that ends 1 cm away left the surface at 7 degrees from the vertical:

    >>> import math
    >>> from lissome.plates import flight_from_heights
    >>> leap = flight_from_heights(0.020, 0.010)
    >>> print(f"{leap.speed:.3f} m/s, {math.degrees(leap.tilt):.2f} degrees")
    0.631 m/s, 7.13 degrees
    """
    g = positive("gravity", gravity)
    rise = math.sqrt(2.0 * g * positive("height", height))
    across = g * finite("distance", distance) / (2.0 * rise)
    return Flight(math.hypot(rise, across), math.atan2(across, rise), g)


def terminal_speed(
    *,
    thickness: float,
    density: float,
    air_density: float = 1.2,
    drag_coefficient: float = 1.1,
    gravity: float = STANDARD_GRAVITY,
) -> float:
    r"""Return the speed at which the drag of the air on a falling sheet balances its weight.

    .. math:: v_t^2 = \frac{2 \rho h g}{\rho_a c_d}

    Parameters
    ----------
    thickness, density : float
        h and mass per volume of the sheet.
    air_density : float
        Of the air around it, in units that fit; the default is in kg/m^3.
    drag_coefficient : float
        :math:`c_d`; about 1.1 for a square plate that moves along its normal.
    gravity : float
        Positive.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.plates import terminal_speed
    >>> print(f"{terminal_speed(thickness=90e-6, density=1200.0):.2f} m/s")
    1.27 m/s
    """
    weight = (
        positive("density", density)
        * positive("thickness", thickness)
        * positive("gravity", gravity)
    )
    drag = (
        0.5 * positive("air_density", air_density) * positive("drag_coefficient", drag_coefficient)
    )
    return math.sqrt(weight / drag)


def launch_speed_with_drag(
    height: float, *, terminal: float, gravity: float = STANDARD_GRAVITY
) -> float:
    r"""Return the vertical launch speed that reaches a height against quadratic drag.

    .. math:: z = \frac{v_t^2}{2 g} \ln\left(1 + \frac{v^2}{v_t^2}\right)

    Parameters
    ----------
    height : float
        z, zero or more.
    terminal : float
        :math:`v_t`, see :func:`terminal_speed`.
    gravity : float
        Positive.

    Returns
    -------
    float
        v, which tends to :math:`\sqrt{2 g z}` in thin air.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.plates import launch_speed_with_drag
    >>> print(f"{launch_speed_with_drag(0.02, terminal=1.27):.3f}")
    0.666
    """
    z, v, g = (
        nonnegative("height", height),
        positive("terminal", terminal),
        positive("gravity", gravity),
    )
    try:
        return v * math.sqrt(math.expm1(2.0 * g * z / v**2))
    except OverflowError:
        raise InvalidInput(
            f"argument `height` is {z:g}; against the drag that makes `terminal` {v:g} it would need a "
            "launch speed that no float can hold; pass a smaller height, or a greater terminal speed"
        ) from None
