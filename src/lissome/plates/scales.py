"""Units in which Foeppl-von Karman plates of every thickness are one plate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._validate import positive
from ..errors import InvalidInput

__all__ = ["PlateScales"]


@dataclass(frozen=True)
class PlateScales:
    r"""The units in which Foeppl-von Karman plates of every thickness are one plate.

    Let :math:`t = \sqrt{B/C}`, the bending length (thickness over the root of 12 for a uniform
    plate), and L the size of the plate. With :math:`w = t\,\bar w`, :math:`u = (t^2/L)\,\bar u`,
    in-plane strains in units of :math:`(t/L)^2` and curvatures in units of :math:`t/L^2` the energy of a
    Foeppl-von Karman plate is :math:`C\,t^4/L^2` times a functional without parameters other than
    Poisson's ratio. Plates of all thicknesses share one critical curvature and one released energy as
    functions of strain.

    Parameters
    ----------
    stretching_modulus : float
        C: force per length.
    bending_modulus : float
        B: force times length.
    length : float
        L: size of the plate.

    Raises
    ------
    InvalidInput
        If a number is not positive, or they make units that no float can hold.

    Examples
    --------
    >>> from lissome.plates import PlateScales
    >>> thin = PlateScales(stretching_modulus=1.0, bending_modulus=1e-4 / 12, length=1.0)
    >>> print(f"{thin.strain:.3e} {thin.curvature:.4f} {thin.energy:.3e}")
    8.333e-06 0.0029 6.944e-11
    """

    stretching_modulus: float
    bending_modulus: float
    length: float

    def __post_init__(self) -> None:
        for name in ("stretching_modulus", "bending_modulus", "length"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        try:
            held = all(0.0 < unit < math.inf for unit in (self.strain, self.energy, self.pressure))
        except (OverflowError, ZeroDivisionError):
            held = False
        if not held:
            raise InvalidInput(
                f"arguments `stretching_modulus` {self.stretching_modulus:g}, `bending_modulus` "
                f"{self.bending_modulus:g} and `length` {self.length:g} make units that no float can "
                "hold; measure them in units nearer to their size"
            )

    @classmethod
    def uniform(cls, thickness: float, length: float, *, young_modulus: float = 1.0) -> PlateScales:
        """Return the scales of a uniform plate.

        Parameters
        ----------
        thickness, length, young_modulus : float
            Positive.

        Raises
        ------
        InvalidInput
            If an argument is not positive.
        """
        h, e = positive("thickness", thickness), positive("young_modulus", young_modulus)
        return cls(e * h, e * h**3 / 12.0, length)

    @property
    def bending_length(self) -> float:
        r""":math:`t = \sqrt{B/C}`."""
        return math.sqrt(self.bending_modulus / self.stretching_modulus)

    @property
    def deflection(self) -> float:
        """Unit of the deflection: t."""
        return self.bending_length

    @property
    def displacement(self) -> float:
        """Unit of the in-plane displacement: t^2/L."""
        return self.bending_length**2 / self.length

    @property
    def strain(self) -> float:
        """Unit of the in-plane strain: (t/L)^2."""
        return (self.bending_length / self.length) ** 2

    @property
    def curvature(self) -> float:
        """Unit of the curvature: t/L^2."""
        return self.bending_length / self.length**2

    @property
    def energy(self) -> float:
        """Unit of the energy: C t^4/L^2."""
        return self.stretching_modulus * self.bending_length**4 / self.length**2

    @property
    def pressure(self) -> float:
        """Unit of the load per area: C t^3/L^4."""
        return self.stretching_modulus * self.bending_length**3 / self.length**4
