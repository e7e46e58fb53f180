"""States of plates, and checks that the schemes share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..structure import BaseStructure

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


class PlateUnknowns(BaseStructure):
    """Handling of the vector of unknowns, of which supports hold some at zero.

    A scheme defines `space`: the number `size` of unknowns, and the indices that are `free` and `fixed`.
    """

    space: Any

    def start(self) -> PlateState:
        """Return the flat plate."""
        return PlateState(np.zeros(self.space.size))

    def adopt(self, state: PlateState) -> PlateState:
        """Return `state` with what the supports hold set to zero."""
        x = self._vector(state).copy()
        x[self.space.fixed] = 0.0
        return PlateState(x)

    def retract(self, state: PlateState, dx: Array) -> PlateState:
        """Return the state reached by the increment `dx` of the free unknowns."""
        x = state.x.copy()
        x[self.space.free] += dx
        return PlateState(x)

    def difference(self, a: PlateState, b: PlateState) -> Array:
        """Return the increment of the free unknowns from `a` to `b`."""
        return (b.x - a.x)[self.space.free]

    def _vector(self, state: PlateState) -> Array:
        if state.x.shape != (self.space.size,):
            raise InvalidInput(
                f"the state has {state.x.size} unknowns; this plate has {self.space.size}: it "
                "belongs to another mesh, degree or scheme"
            )
        return state.x


def check_moduli(name: str, modulus: Array, poisson: Array) -> None:
    """Raise if a modulus is not positive somewhere, or Poisson's ratio impossible."""
    if not np.all(modulus > 0):
        raise InvalidInput(
            f"argument `{name}` is {float(np.min(modulus)):.4g} somewhere; a modulus is positive"
        )
    if not np.all((poisson > -1) & (poisson <= 0.5)):
        worst = poisson[~((poisson > -1) & (poisson <= 0.5))].ravel()[0]
        raise InvalidInput(f"argument `poisson` is {worst:.4g} somewhere; it must lie in (-1, 1/2]")
