"""Equilibria of ribbons: strains, rulings, forces, and the developed surface."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._readonly import readonly, readonly_property
from .._validate import finite, integer_at_least, one_of
from ..errors import InvalidInput, NotConverged
from ..rods import RodEquilibrium
from ..rods._tables import node_values
from . import _kernel
from .surface import DevelopedSurface

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ROUGH", "RibbonEquilibrium"]

Array = NDArray[np.float64]

#: Jumps of the bending from hinge to hinge, over its largest value, that no smooth state has.
ROUGH = 0.15


@dataclass(frozen=True, eq=False)
class RibbonEquilibrium(RodEquilibrium):
    """An equilibrium of a ribbon. It has all that an equilibrium of a rod has, and its rulings.

    Attributes
    ----------
    strains : ndarray, shape (n, 3)
        Bending kappa_1, kappa_2 (zero) and twist kappa_3 of the hinges (1/length). The last hinge of a
        closed band is its joint, seen from the end of the band.
    ruling, ruling_slope : ndarray, shape (n,)
        Ruling parameter of the hinges and its derivative (1/length).

    Notes
    -----
    The moments of the hinges along the second and third director hold up the constraints.

    Examples
    --------
    A Möbius band has half a turn, part of it as twist and part as writhe:

    >>> import lissome as ls
    >>> from lissome import ribbons
    >>> band = ribbons.band(1.0, 40, ribbons.Wunderlich(width=0.1, rigidity=1.0))
    >>> state = ls.equilibrate(band)
    >>> print(f"{abs(state.twist + state.writhe):.6f}", state.stable)
    0.500000 True
    """

    structure: Any
    state: Any

    @cached_property
    def _at_hinges(self) -> tuple[Array, Array]:
        return self.structure.rulings(self.state)

    @property
    def ruling(self) -> Array:
        """Ruling parameters of the hinges: tangents of the angles between rulings and d1, shape (n,)."""
        return readonly(self._at_hinges[0])

    @property
    def ruling_slope(self) -> Array:
        """Derivatives of the ruling parameter (1/length) at the hinges, shape (n,)."""
        return readonly(self._at_hinges[1])

    @cached_property
    def _law_values(self) -> tuple[Array, Array]:
        ribbon = self.structure
        n = ribbon.layout.nodes.size
        spans = np.array(ribbon.layout.plan.span)
        values, rows, stress = np.empty(n), np.empty((n, 3)), np.empty((n, 3))
        folds = np.array(self.state.folds) if ribbon.law.has_fold else np.zeros(n)
        skeleton = ribbon.layout.skeleton
        if ribbon.has_moments:
            m = ribbon.layout.plan.rows.shape[0]
            stress = np.array(self.multipliers[m : m + 3 * n].reshape(n, 3))
            # The energy is of second degree in the curvature: half of what the moments do.
            return 0.5 * np.sum(stress * self.strains, axis=1), stress
        _kernel.evaluate_hinges(
            np.array(self.strains * spans[:, None]), spans, np.array(self.ruling),
            np.array(self.ruling_slope), folds, skeleton.before, skeleton.share,
            ribbon.layout.parameters, ribbon.layout.ribbon_width,
            ribbon._hinge_multipliers(self.multipliers), values, rows, stress, np.zeros((0, 3, 3)),
            np.empty((n, 4)), np.empty((0, 10)), 1,
        )  # fmt: skip
        return values, stress

    @property
    def energy_per_length(self) -> Array:
        """Bending energy of the hinges per length of the center line, shape (n,)."""
        return readonly(self._law_values[0])

    @readonly_property
    def forces(self) -> Array:
        """Internal force on each segment, shape (N, 3)."""
        from ..rods._layout import internal_forces

        rod = self.structure.rod
        return internal_forces(rod, self.multipliers[: rod.constraints_count])

    @property
    def bending_energy(self) -> float:
        """Energy of bending, of all hinges."""
        return float(self.structure.layout.plan.span @ self._law_values[0])

    @property
    def stretching_energy(self) -> float:
        """0: a ribbon is inextensible."""
        return 0.0

    # ---- is it smooth? ---------------------------------------------------------------------------

    @property
    def bending_jumps(self) -> Array:
        """How much the bending alternates or jumps between hinges, over its largest value.

        The size of its third differences over 8, shape (n - 3,), or (n,) for a closed ribbon, of which
        they go on across the joint. Of the third order in the mesh where the bending is smooth.
        """
        bending = np.array(self.strains[:, 0])
        largest = float(np.max(np.abs(bending)))
        if self.structure.closed:
            bending = np.concatenate([bending, self.structure._joint_sign * bending[:3]])
        if not largest or bending.size < 4:
            return np.zeros(max(bending.size - 3, 0))
        return np.abs(np.diff(bending, 3)) / (8.0 * largest)

    def check_smooth(self) -> None:
        """Refuse a state whose bending jumps between neighboring hinges, or at the joint.

        Raises
        ------
        NotConverged
            If `bending_jumps` exceeds 0.15 somewhere; carries the state.
        """
        jumps = self.bending_jumps
        if not jumps.size or float(jumps.max()) <= ROUGH:
            return
        ribbon = self.structure
        n = self.strains.shape[0]
        segments = ribbon.law.width / float(np.min(ribbon.lengths))
        worst = (int(np.argmax(jumps)) + 1) % n
        alternating = int(np.count_nonzero(jumps > ROUGH)) > 12
        what = (
            "alternates from hinge to hinge"
            if alternating
            else "jumps at the joint"
            if ribbon.closed and min(worst, n - 1 - worst) <= 2
            else f"jumps near s = {self.hinge_arclength[worst]:.4g}"
        )
        remedy = (
            "use scheme='staggered'"
            if ribbon.scheme == "nodal" and alternating
            else "let the rulings be continuous there (joint='matched')"
            if ribbon.closed and ribbon.joint == "free"
            else f"use more segments (there are {segments:.2g} to the width, which should be 4 at least), or "
            "segments that are short where it bends (`graded_lengths`)"
        )
        raise NotConverged(
            f"the state is spurious: its bending {what} by {float(jumps.max()):.2g} of its largest value "
            f"(a smooth one stays below {ROUGH}), whatever the energy; {remedy}, or approach in smaller "
            "steps from a state that is smooth",
            state=self.state,
        )

    def graded_lengths(self, segments: int, share: float = 0.5) -> Array:
        """Return lengths of segments that are short where this state bends much.

        The density of segments is ``1 - share`` times that of a uniform mesh plus ``share`` times one
        proportional to the bending. For the Möbius band, whose bends become creases as its width nears
        the limit. Go on with ``finer = ribbons.band(lengths=..., law=...)`` and
        ``equilibrate(finer, start=finer.adapted(equilibrium))``.

        Parameters
        ----------
        segments : int
            Their number, at least 8.
        share : float
            Share of the segments that follow the bending, in [0, 1).

        Returns
        -------
        ndarray, shape (segments,)
            In a band with an odd number of half turns they are symmetric about the middle of the first
            segment, as the bending is.

        Raises
        ------
        InvalidInput
            If an argument is out of its range, or the ribbon is not bent.

        Examples
        --------
        >>> import lissome as ls
        >>> from lissome import ribbons
        >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
        >>> coarse = ls.equilibrate(ribbons.circle(1.0, 40, law, turn=2.0))
        >>> lengths = coarse.graded_lengths(60)
        >>> print(lengths.size, f"{lengths.sum():.6f}")
        60 1.000000
        """
        segments = integer_at_least("segments", segments, 8)
        share = finite("share", share)
        if not 0.0 <= share < 1.0:
            raise InvalidInput(f"argument `share` is {share:g}; it must be in [0, 1)")
        ribbon = self.structure
        length = ribbon.length
        bending = np.abs(self.strains[:, 0])
        s = np.array(self.hinge_arclength)
        grid = np.linspace(0.0, length, 40 * max(segments, s.size) + 1)
        mirrored = ribbon.closed and ribbon.half_turns % 2
        if ribbon.closed:
            s[-1] = length
            if (
                mirrored
            ):  # counted from the middle of the first segment, where the axis of symmetry is
                s -= 0.5 * ribbon.lengths[0]
            profile = np.interp(grid, s, bending, period=length)
            if mirrored:
                profile = 0.5 * (profile + profile[::-1])
        else:
            profile = np.interp(grid, s, bending)
        steps = np.diff(grid)
        wanted = np.concatenate([[0.0], np.cumsum(0.5 * (profile[1:] + profile[:-1]) * steps)])
        if not wanted[-1] > 0.0:
            raise InvalidInput(
                "this ribbon is not bent: nothing tells where segments should be short; use a uniform mesh"
            )
        density = (1.0 - share) * grid / length + share * wanted / wanted[-1]
        if mirrored:
            first = np.interp(0.5 / segments, density, grid)
            ends = np.interp((np.arange(segments) + 0.5) / segments, density, grid)
            lengths = np.concatenate([[2.0 * first], np.diff(ends)])
            lengths[1:] = 0.5 * (lengths[1:] + lengths[:0:-1])
        else:
            lengths = np.diff(np.interp(np.arange(segments + 1) / segments, density, grid))
        return np.asarray(lengths * (length / lengths.sum()))

    # ---- shape, tables and files -------------------------------------------------------------------

    def _at_nodes(self, values: Array) -> Array:
        ribbon = self.structure
        count = ribbon.lengths.size + 1
        table = node_values(values, self.hinge_nodes, self.hinge_lengths, count)
        if ribbon.closed:  # the hinge of the joint is seen from the end
            table[-1] = table[0]
            flip = (
                np.array([ribbon._joint_sign, ribbon._joint_sign, 1.0])
                if table.ndim == 2
                else ribbon._joint_sign
            )
            table[0] = table[0] * flip
        return table

    @readonly_property
    def ruling_at_nodes(self) -> Array:
        """Ruling parameters of the nodes, shape (N + 1,); at a free end that of the next node."""
        table = self._at_nodes(self.ruling)
        known = np.flatnonzero(np.isfinite(table))
        return np.asarray(np.interp(np.arange(table.size), known, table[known]))

    def surface(self, across: int = 9) -> DevelopedSurface:
        """Return the developed surface.

        Parameters
        ----------
        across : int
            Number of points on each ruling, at least 2.

        Returns
        -------
        DevelopedSurface

        Raises
        ------
        InvalidInput
            If there are fewer than 2 points across.

        Examples
        --------
        >>> import lissome as ls
        >>> from lissome import ribbons
        >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
        >>> surface = ls.equilibrate(ribbons.circle(1.0, 20, law)).surface(across=3)
        >>> surface.vertices.shape
        (21, 3, 3)
        >>> surface.isometry_error() < 1e-12
        True
        """
        across = integer_at_least("across", across, 2)
        ribbon = self.structure
        law = ribbon.law
        eta = self.ruling_at_nodes
        count = ribbon.lengths.size
        face = np.minimum(np.arange(count + 1), count - 1)
        directors = self.directors[face]
        along = directors[:, 0] + eta[:, None] * directors[:, 2]
        t = np.linspace(-0.5 * law.width, 0.5 * law.width, across)
        vertices = self.positions[:, None, :] + t[None, :, None] * along[:, None, :]
        flat = np.stack(
            [self.arclength[:, None] + t * eta[:, None], np.broadcast_to(t, (count + 1, across))],
            axis=2,
        )
        strain = np.nan_to_num(self._at_nodes(self.strains))
        slope = np.nan_to_num(self._at_nodes(self.ruling_slope))
        if ribbon.closed and ribbon.joint == "matched":
            slope[0] = slope[-1] * ribbon._joint_sign
        stretch = 1.0 + t * slope[:, None]
        if not law.has_fold:  # of no width: the curvature of the center line
            stretch = np.ones_like(stretch)
        curvature = (strain[:, 0] * (1.0 + eta**2))[:, None] / stretch
        p = law.parameters
        natural = (p[2] + eta * (p[3] + eta * p[4])) / (1.0 + eta**2)
        density = 0.5 * law.rigidity * (curvature**2 - 2.0 * curvature * natural[:, None] + p[5])
        return DevelopedSurface(vertices, flat, eta, density, curvature, ribbon.closed)

    def to_frame(self, of: str = "nodes") -> pd.DataFrame:
        """Return a table of the nodes, of the hinges or of the segments.

        Parameters
        ----------
        of : {"nodes", "hinges", "segments"}
            As for a rod; nodes and hinges also have the columns ruling, ruling_slope and
            energy_per_length.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        InvalidInput
            If `of` is none of these.
        """
        one_of("of", of, ("nodes", "hinges", "segments"))
        table = super().to_frame(of)
        if of == "segments":
            return table
        values = {"ruling": self.ruling, "ruling_slope": self.ruling_slope}
        for name, value in values.items():
            table[name] = self._at_nodes(value) if of == "nodes" else value
        energy = self.energy_per_length
        if of == "nodes":
            count = self.structure.lengths.size + 1
            energy = node_values(energy, self.hinge_nodes, self.hinge_lengths, count)
            if self.structure.closed:
                energy[-1] = energy[0]
        table["energy_per_length"] = energy
        return table

    def to_vtk(self, path: str | os.PathLike[str], across: int = 9) -> Path:
        """Write the developed surface for ParaView; see :meth:`DevelopedSurface.to_vtk`."""
        return self.surface(across).to_vtk(path)
