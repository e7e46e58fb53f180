"""States of plates, and checks that the schemes share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlateState:
    """The unknowns of a plate: a vector that the plate's methods take apart.

    Parameters
    ----------
    x : array_like, shape (size,)
        Copied, and made read-only.
    """

    x: Array

    def __post_init__(self) -> None:
        x = np.array(self.x, dtype=float)
        if x.ndim != 1:
            raise InvalidInput(f"argument `x` has shape {x.shape}; it must be a vector")
        x.flags.writeable = False
        object.__setattr__(self, "x", x)


def check_moduli(name: str, modulus: Array, poisson: Array) -> None:
    """Raise if a modulus is not positive somewhere, or Poisson's ratio impossible."""
    if not np.all(modulus > 0):
        raise InvalidInput(
            f"argument `{name}` is {float(np.min(modulus)):.4g} somewhere; a modulus is positive"
        )
    if not np.all((poisson > -1) & (poisson <= 0.5)):
        worst = poisson[~((poisson > -1) & (poisson <= 0.5))].ravel()[0]
        raise InvalidInput(f"argument `poisson` is {worst:.4g} somewhere; it must lie in (-1, 1/2]")
