r"""The dimensionless illumination from material and optical values with units.

Light of intensity I decays in the film by Beer's law, isomerizes a fraction alpha_1 I of the
chromophores, and strains the material by lambda per fraction. The first moment of that strain over
the thickness is a natural curvature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scipy.special import ive

from .._units import magnitude
from .._validate import positive
from ..errors import InvalidInput

__all__ = ["Illumination", "absorption_moment", "illumination"]


@dataclass(frozen=True)
class Illumination:
    r"""Dimensionless illumination of a film.

    Attributes
    ----------
    value : float
        :math:`\Lambda`, with the full Beer profile. Positive: the lit face contracts.
    shallow : float
        Its limit for a penetration depth much less than the thickness,
        :math:`-6 \lambda\alpha_1 I_0 l d / h^2`.
    depth_ratio : float
        Penetration depth over thickness.

    Examples
    --------
    A hundredth of the thickness is not thin: the full profile has 2 % less effect than the limit.

    >>> from lissome.beams import illumination
    >>> film = illumination("-5.4e-5 m^2/W", "100 W/m^2", "15 um", "0.15 um", "15 mm")
    >>> print(f"{film.depth_ratio:.2f} {film.value / film.shallow:.6f}")
    0.01 0.980000
    """

    value: float
    shallow: float
    depth_ratio: float

    @property
    def intensity(self) -> float:
        """:math:`|\\Lambda|`, for :class:`~lissome.beams.ParallelLight`."""
        return abs(self.value)

    @property
    def response(self) -> float:
        """Sign of :math:`\\Lambda`, for :class:`~lissome.beams.ClampedStrip`."""
        return math.copysign(1.0, self.value)


def absorption_moment(ratio: float) -> float:
    r"""First moment of the Beer profile over the thickness, in units of the thickness squared.

    .. math:: \int_{-1/2}^{1/2} e^{-(1/2 - \zeta)/\delta}\, \zeta \, d\zeta
              = \delta(\tfrac12 - \delta) + \delta(\tfrac12 + \delta)\, e^{-1/\delta}
              = \tfrac12 e^{-v} i_1(v), \qquad v = \frac{1}{2\delta},

    with the modified spherical Bessel function :math:`i_1`; the last form has no cancellation.

    Parameters
    ----------
    ratio : float
        Penetration depth over thickness, :math:`\delta > 0`.

    Raises
    ------
    InvalidInput
        If `ratio` is not positive.

    Examples
    --------
    >>> from lissome.beams import absorption_moment
    >>> print(f"{absorption_moment(1e-6):.6e}, {absorption_moment(1e6):.6e}")
    4.999990e-07, 8.333329e-08
    """
    v = 0.5 / positive("ratio", ratio)
    return 0.5 * math.sqrt(0.5 * math.pi / v) * float(ive(1.5, v))


_EXAMPLES = {"m**2/W": "-5.4e-5 m^2/W", "W/m**2": "100 W/m^2", "m": "15 um"}


def _magnitude(name: str, value: Any, unit: str) -> float:
    return magnitude(name, value, unit, _EXAMPLES[unit])


def illumination(
    coupling: Any, intensity: Any, thickness: Any, depth: Any, length: Any
) -> Illumination:
    r"""Return the dimensionless illumination of a film.

    .. math:: \Lambda = -\frac{12\, \lambda \alpha_1 I_0\, l}{h^3}
              \int_{-h/2}^{h/2} e^{-(h/2 - z)/d}\, z \, dz

    This is (3.14) of the thesis, whose last member lacks :math:`\lambda` and l.

    Parameters
    ----------
    coupling : pint.Quantity or str
        :math:`\lambda\alpha_1`: strain at the surface per intensity (area per power). Negative: the
        lit material contracts.
    intensity : pint.Quantity or str
        :math:`I_0 \ge 0`: power per area.
    thickness, depth, length : pint.Quantity or str
        Of the film, of penetration of the light, and of the strip; positive.

    Returns
    -------
    Illumination

    Raises
    ------
    InvalidInput
        If a value has no units, wrong ones, or is out of its range.

    Examples
    --------
    The values of Table 3.1:

    >>> from lissome.beams import illumination
    >>> film = illumination("-5.4e-5 m^2/W", "100 W/m^2", "15 um", "0.56 um", "15 mm")
    >>> print(f"{film.value:.5f}")
    1.11928
    """
    strain = _magnitude("coupling", coupling, "m**2/W")
    power = _magnitude("intensity", intensity, "W/m**2")
    h = _magnitude("thickness", thickness, "m")
    d = _magnitude("depth", depth, "m")
    l = _magnitude("length", length, "m")
    if power < 0:
        raise InvalidInput(
            f"argument `intensity` is {intensity!s}; it must not be negative (the sign of the effect "
            "is that of `coupling`)"
        )
    for name, value, number in (
        ("thickness", thickness, h),
        ("depth", depth, d),
        ("length", length, l),
    ):
        if number <= 0:
            raise InvalidInput(f"argument `{name}` is {value!s}; it must be positive")
    scale = -12.0 * strain * power * l / h
    ratio = d / h
    return Illumination(scale * absorption_moment(ratio), scale * 0.5 * ratio, ratio)
