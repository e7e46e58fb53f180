r"""Cross-sections: second moments and torsion constants.

The width lies along the director d1, the thickness along d2. ``second_moments`` is (I1, I2): times
Young's modulus they are the stiffnesses of bending about d1 and about d2. The torsion constant J,
times the shear modulus, is the twisting stiffness (Saint-Venant).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from .._validate import positive

__all__ = ["Circle", "Ellipse", "Rectangle", "Section"]

# 31/32 zeta(5): the sum of 1/n^5 over odd n.
_ODD_ZETA_5 = 1.0045237627951383
# Beyond this, tanh is one to the last digit.
_LARGEST_EXPONENT = 40.0


@runtime_checkable
class Section(Protocol):
    r"""What :meth:`~lissome.rods.Kirchhoff.from_section` asks of a cross-section.

    Examples
    --------
    Any object with these properties is a section, such as a tube. Round sections bend and twist in the
    ratio :math:`1 + \nu`:

    >>> import numpy as np
    >>> from lissome.rods import Kirchhoff
    >>> class Tube:
    ...     area = np.pi * (1.0**2 - 0.9**2)
    ...     second_moments = (np.pi / 4 * (1.0**4 - 0.9**4),) * 2
    ...     torsion_constant = np.pi / 2 * (1.0**4 - 0.9**4)
    >>> law = Kirchhoff.from_section(Tube(), young_modulus=1.0, poisson_ratio=0.3)
    >>> print(f"{law.bending[0] / law.twisting:.6f}")
    1.300000
    """

    @property
    def area(self) -> float:
        """Area (length squared)."""
        ...

    @property
    def second_moments(self) -> tuple[float, float]:
        """Second moments of area (I1, I2) about d1 and d2 (length to the fourth)."""
        ...

    @property
    def torsion_constant(self) -> float:
        """Saint-Venant's torsion constant J (length to the fourth)."""
        ...


@dataclass(frozen=True)
class Rectangle:
    r"""A rectangle.

    .. math::
        I_1 = \frac{w t^3}{12},\qquad I_2 = \frac{w^3 t}{12},\qquad
        J = a b^3 \Big[\frac13 - \frac{64}{\pi^5} \frac ba \sum_{n\ \text{odd}}
            \frac{\tanh(n \pi a / 2 b)}{n^5}\Big]

    with :math:`a \ge b` the longer and the shorter side. Since tanh differs from one by an
    exponentially small amount, the sum is :math:`\tfrac{31}{32}\zeta(5)` less a correction of which a
    dozen terms give all digits.

    Parameters
    ----------
    width : float
        Side w along d1 (length).
    thickness : float
        Side t along d2 (length).

    Raises
    ------
    InvalidInput
        If a side is not positive.

    Examples
    --------
    >>> from lissome.rods.sections import Rectangle
    >>> slinky = Rectangle(5.0, 2.0)
    >>> print(f"{slinky.torsion_constant / (5 * 2**3):.4f}")
    0.2494
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", positive("width", self.width))
        object.__setattr__(self, "thickness", positive("thickness", self.thickness))

    @property
    def area(self) -> float:
        """Area (length squared)."""
        return self.width * self.thickness

    @property
    def second_moments(self) -> tuple[float, float]:
        """Second moments of area (I1, I2) about d1 and d2."""
        w, t = self.width, self.thickness
        return w * t**3 / 12.0, w**3 * t / 12.0

    @property
    def torsion_constant(self) -> float:
        """Torsion constant J, to all digits."""
        a, b = max(self.width, self.thickness), min(self.width, self.thickness)
        total, n = _ODD_ZETA_5, 1
        while n * math.pi * a / b < _LARGEST_EXPONENT:
            # tanh(x) = 1 - 2 / (exp(2 x) + 1)
            total -= 2.0 / (math.exp(n * math.pi * a / b) + 1.0) / n**5
            n += 2
        return a * b**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * (b / a) * total)


@dataclass(frozen=True)
class Ellipse:
    r"""An ellipse with the full axes w along d1 and t along d2.

    .. math::
        I_1 = \frac{\pi w t^3}{64},\qquad I_2 = \frac{\pi w^3 t}{64},\qquad
        J = \frac{\pi w^3 t^3}{16 (w^2 + t^2)}

    Parameters
    ----------
    width, thickness : float
        Full axes (length).

    Raises
    ------
    InvalidInput
        If an axis is not positive.

    Examples
    --------
    >>> from lissome.rods.sections import Ellipse
    >>> print(f"{Ellipse(2.0, 1.0).torsion_constant:.6f}")
    0.314159
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", positive("width", self.width))
        object.__setattr__(self, "thickness", positive("thickness", self.thickness))

    @property
    def area(self) -> float:
        """Area (length squared)."""
        return 0.25 * math.pi * self.width * self.thickness

    @property
    def second_moments(self) -> tuple[float, float]:
        """Second moments of area (I1, I2) about d1 and d2."""
        w, t = self.width, self.thickness
        return math.pi * w * t**3 / 64.0, math.pi * w**3 * t / 64.0

    @property
    def torsion_constant(self) -> float:
        """Torsion constant J."""
        w, t = self.width, self.thickness
        return math.pi * (w * t) ** 3 / (16.0 * (w * w + t * t))


@dataclass(frozen=True)
class Circle:
    r"""A disk: :math:`I_1 = I_2 = \pi d^4/64`, :math:`J = \pi d^4/32`.

    Parameters
    ----------
    diameter : float
        Diameter d (length).

    Raises
    ------
    InvalidInput
        If the diameter is not positive.

    Examples
    --------
    >>> from lissome.rods.sections import Circle
    >>> wire = Circle(2.0)
    >>> wire.torsion_constant == sum(wire.second_moments)
    True
    """

    diameter: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "diameter", positive("diameter", self.diameter))

    @property
    def area(self) -> float:
        """Area (length squared)."""
        return 0.25 * math.pi * self.diameter**2

    @property
    def second_moments(self) -> tuple[float, float]:
        """Second moments of area (I1, I2), equal."""
        moment = math.pi * self.diameter**4 / 64.0
        return moment, moment

    @property
    def torsion_constant(self) -> float:
        """Torsion constant J."""
        return math.pi * self.diameter**4 / 32.0
