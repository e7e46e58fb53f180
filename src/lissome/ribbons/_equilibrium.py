"""Equilibria of ribbons."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..rods import RodEquilibrium
from . import _kernel

if TYPE_CHECKING:
    pass

__all__ = ["RibbonEquilibrium"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RibbonEquilibrium(RodEquilibrium):
    """An equilibrium of a ribbon."""

    structure: Any
    state: Any

    @cached_property
    def _at_hinges(self) -> tuple[Array, Array]:
        return self.structure.rulings(self.state)

    @property
    def ruling(self) -> Array:
        """Ruling parameters of the hinges: tangents of the angles between rulings and d1, shape (n,)."""
        return self._at_hinges[0]

    @property
    def ruling_slope(self) -> Array:
        """Derivatives of the ruling parameter (1/length) at the hinges, shape (n,)."""
        return self._at_hinges[1]

    @cached_property
    def _law_values(self) -> tuple[Array, Array]:
        ribbon = self.structure
        n = ribbon.layout.nodes.size
        spans = np.array(ribbon.layout.plan.span)
        values, rows, stress = np.empty(n), np.empty((n, 3)), np.empty((n, 3))
        folds = np.array(self.state.folds) if ribbon.law.has_fold else np.zeros(n)
        _kernel.evaluate_hinges(
            np.array(self.strains * spans[:, None]), spans, np.array(self.ruling),
            np.array(self.ruling_slope), folds, ribbon.layout.parameters, ribbon.layout.ribbon_width,
            ribbon.hinge_multipliers(self.multipliers), values, rows, stress, np.zeros((0, 3, 3)),
            np.empty((n, 2)), np.empty((0, 6)), 1,
        )  # fmt: skip
        return values, stress

    @cached_property
    def forces(self) -> Array:
        """Internal force on each segment, shape (N, 3)."""
        from ..rods._layout import internal_forces

        rod = self.structure.rod
        return internal_forces(rod, self.multipliers[: rod.constraints_count])

    @property
    def stretching_energy(self) -> float:
        """0: a ribbon is inextensible."""
        return 0.0
