"""Equilibria of rods, with forces, moments, reactions and energies."""

from __future__ import annotations

import os
import warnings
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .._readonly import readonly, readonly_property
from .._validate import one_of
from ..equilibrium import Equilibrium
from ..errors import InvalidInput, LissomeWarning
from ..reactions import Reaction, Reactions
from . import _kernel, _tables, topology
from ._cells import Coupling, couple
from .measures import CODES, pull_back_all
from .quaternions import rotate, to_directors
from .topology import Crossings

if TYPE_CHECKING:
    import pandas as pd

    from ._structure import Rod, RodState

__all__ = ["RodEquilibrium"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RodEquilibrium(Equilibrium):
    """An equilibrium of a rod.

    Self-contact is not modeled: parts of the rod may have passed through each other. :func:`equilibrate`
    warns of a rod that crosses itself, and :meth:`self_crossings` tells where.

    Attributes
    ----------
    positions : ndarray, shape (N + 1, 3)
        Nodes. Those of a closed rod end with the first node again.
    frames : scipy.spatial.transform.Rotation
        Of the N segments: they take e1, e2, e3 to the directors.
    directors : ndarray, shape (N, 3, 3)
        ``directors[j, I]`` is director I of segment j; the last one is the tangent.
    strains : ndarray, shape (n, 3)
        Strain densities (1/length) of the hinges about d1, d2, d3, natural strains included.
    moments : ndarray, shape (n, 3)
        Components along the directors of what the law gives for the hinges: its stress.
    moment_vectors : ndarray, shape (n, 3)
        Moments (in space) that the part beyond each hinge exerts on the part before it, in balance
        with the forces exactly. They differ from `moments` by the turn of half a hinge.
    forces : ndarray, shape (N, 3)
        Internal forces: what is beyond a segment exerts them on what is before.

    Examples
    --------
    The force in a rod is constant between its loads, and a small one deflects a cantilever by a third
    of itself:

    >>> import lissome as ls
    >>> from lissome import rods
    >>> beam = rods.straight(length=1.0, segments=50, law=rods.Kirchhoff(1.0, 1.0)).clamped("start")
    >>> state = ls.equilibrate(beam.loaded(end=(1e-3, 0.0, 0.0)))
    >>> print(state.forces.shape, abs(state.forces - [1e-3, 0.0, 0.0]).max() < 1e-12)
    (50, 3) True
    >>> print(f"{state.positions[-1, 0] / 1e-3:.3f}")
    0.333
    """

    structure: Rod
    state: RodState

    @readonly_property
    def positions(self) -> Array:
        """Positions of the nodes, shape (N + 1, 3)."""
        return self.structure.positions(self.state)

    @cached_property
    def frames(self) -> Rotation:
        """Frames of the segments."""
        return Rotation.from_quat(self.state.quaternions[:, [1, 2, 3, 0]])

    @readonly_property
    def directors(self) -> Array:
        """Directors of the segments, shape (N, 3, 3): segment, director, component."""
        return to_directors(self.state.quaternions)

    @property
    def arclength(self) -> Array:
        """Rest arc lengths of the nodes, shape (N + 1,)."""
        return self.structure.arclength

    @property
    def hinge_arclength(self) -> Array:
        """Rest arc lengths of the hinges, shape (n,)."""
        return readonly(self.structure.layout.arclength)

    @property
    def hinge_nodes(self) -> NDArray[np.int64]:
        """Nodes of the hinges, shape (n,); a clamped node inside a rod has two hinges."""
        return readonly(self.structure.layout.nodes)

    @property
    def hinge_lengths(self) -> Array:
        """Rest lengths of the hinges, shape (n,)."""
        return readonly(self.structure.layout.plan.span)

    @readonly_property
    def strains(self) -> Array:
        """Strain densities of the hinges, shape (n, 3)."""
        return self.structure.strains(self.state)

    @cached_property
    def _coupling(self) -> Coupling | None:
        layout = self.structure.layout
        if layout.cells is None:
            return None
        excess = self.strains - layout.plan.natural
        return couple(layout.cells, excess, layout.plan.span, self.state.stretches, 1)

    @cached_property
    def _law_values(self) -> tuple[Array, Array]:
        layout = self.structure.layout
        if self._coupling is not None:
            return self._coupling.values, self._coupling.stress
        energy, stress, _ = layout.law.evaluate(self.strains - layout.plan.natural, 1)
        return np.asarray(energy), np.array(stress)

    @property
    def moments(self) -> Array:
        """Stress of the law at the hinges, components along the directors, shape (n, 3)."""
        return readonly(self._law_values[1])

    @readonly_property
    def moment_vectors(self) -> Array:
        """Moment of what is beyond each hinge on what is before, in space, shape (n, 3)."""
        rod = self.structure
        plan = rod.layout.plan
        frames = rod._frames(self.state)
        q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, kappa)
        stress = np.array(self.moments)
        if rod.measure != "sine":
            pull_back_all(CODES[rod.measure], q, stress, np.zeros((0, 3, 3)), 1)
        body = q[:, :1] * stress + np.cross(q[:, 1:], stress)
        return rotate(frames[plan.left], body)

    @readonly_property
    def forces(self) -> Array:
        """Internal force on each segment, shape (N, 3)."""
        from ._layout import internal_forces

        return internal_forces(self.structure, self.multipliers)

    @property
    def bending_energy(self) -> float:
        """Energy of the hinges: of bending and twisting, and of stretching if that is in the law."""
        ends = 0.0 if self._coupling is None else self._coupling.energy
        return float(self.structure.layout.plan.span @ self._law_values[0]) + ends

    @property
    def stretching_energy(self) -> float:
        """Energy of stretching; 0 of an inextensible rod, and where the law has it."""
        rod = self.structure
        if rod.stretching is None:
            return 0.0
        strain = 0.5 * (self.state.stretches**2 - 1.0)
        return 0.5 * rod.stretching * float(rod.lengths @ strain**2)

    @property
    def load_energy(self) -> float:
        """Potential of the dead loads."""
        return self.energy - self.bending_energy - self.stretching_energy

    @property
    def twist(self) -> float:
        """Total twist, in turns: what is left of the hinges' rotations after parallel transport."""
        return _total_twist(self.structure, self.state)

    @cached_property
    def _reactions(self) -> Reactions:
        """What the supports exert, by "start", "end" and the numbers of other nodes.

        The dead moment of a hinged support is a load, and not in it.
        """
        rod = self.structure
        count = rod.lengths.size
        ends: dict[Hashable, Hashable] = {} if rod.closed else {0: "start", count: "end"}
        found = []
        for support in rod.supports:
            node = support.node
            before = self.forces[node - 1] if node > 0 or rod.closed else np.zeros(3)
            beyond = self.forces[node] if node < count else np.zeros(3)
            force = before - beyond - rod.layout.node_forces[node]
            force = force * [v is not None for v in support.position]
            moment = np.zeros(3) if support.frame is None else self._support_moment(support)
            found.append(Reaction(force, moment, self.positions[node], ends.get(node, node)))
        return Reactions(found, aliases=ends)

    # ---- shape, tables and files ---------------------------------------------------------------

    @cached_property
    def writhe(self) -> float:
        """Writhe of the polygon of nodes; quadratic work. Twist and writhe of a ring add up."""
        return topology.writhe(self.positions, closed=self.structure.closed)

    @property
    def link(self) -> float:
        """Twist plus writhe of a closed rod, in turns: no motion changes it without a crossing.

        It is the number of turns at the joint up to a whole number. If the frames close up, it is how
        often an edge of the rod winds about its center line.

        Raises
        ------
        InvalidInput
            If the rod is open.
        """
        if not self.structure.closed:
            raise InvalidInput("only a closed rod has a linking number; see `twist` and `writhe`")
        return self.twist + self.writhe

    @cached_property
    def passages(self) -> int:
        """How often, on balance, a closed rod has passed through itself since its initial state.

        Each passage changes the linking number by two; positive if it became less.
        """
        rod = self.structure
        nodes = rod.positions(rod.initial)
        before = _total_twist(rod, rod.initial) + topology.writhe(nodes, closed=True)
        return round((before - self.link) / 2.0)

    def self_crossings(self, distance: float | None = None, *, warn: bool = True) -> Crossings:
        """Find where the rod comes too near to itself: contact is not modeled.

        Parameters
        ----------
        distance : float, optional
            Distance of center lines (length), such as the thickness; by default a thousandth of the
            length.
        warn : bool
            Whether to warn if there are crossings, or if a closed rod has passed through itself since
            its initial state (`passages`).

        Warns
        -----
        LissomeWarning
            If there are or were crossings.
        """
        nodes, closed = self.positions, self.structure.closed
        if not warn:
            return topology.self_crossings(nodes, distance, closed=closed)
        found = topology.warn_of_self_crossings(nodes, distance, closed=closed, stacklevel=3)
        if closed and not found and self.passages:
            warnings.warn(
                "the rod has passed through itself since its initial state (its linking number has "
                f"changed by {-2 * self.passages}); self-contact is not modeled",
                LissomeWarning,
                stacklevel=3,
            )
        return found

    def _at_nodes(self, values: Array) -> Array:
        count = self.structure.lengths.size + 1
        table = _tables.node_values(values, self.hinge_nodes, self.hinge_lengths, count)
        if self.structure.closed:
            table[-1] = table[0]
        return table

    def to_frame(self, of: str = "nodes") -> pd.DataFrame:
        """Return a table of the nodes, of the hinges or of the segments.

        Parameters
        ----------
        of : {"nodes", "hinges", "segments"}
            "nodes": arc length s, position, strains and moments (not a number where a node has no
            hinge). "hinges": node, s, strains and moments; a clamped node inside a rod has two.
            "segments": s of the middle, directors, internal force and stretch.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        InvalidInput
            If `of` is none of these.

        Warns
        -----
        LissomeWarning
            As of :meth:`self_crossings`.

        Examples
        --------
        >>> import lissome as ls
        >>> from lissome import rods
        >>> rod = rods.straight(1.0, 4, rods.Kirchhoff(1.0, 0.8)).clamped("start")
        >>> ls.equilibrate(rod.loaded(end=[0.1, 0, 0])).to_frame().shape
        (5, 10)
        """
        one_of("of", of, ("nodes", "hinges", "segments"))
        self.self_crossings()
        if of == "nodes":
            return _tables.node_table(
                self.arclength,
                self.positions,
                strains=self._at_nodes(self.strains),
                moments=self._at_nodes(self.moments),
            )
        if of == "hinges":
            return _tables.hinge_table(
                self.hinge_nodes, self.hinge_arclength, strains=self.strains, moments=self.moments
            )
        return _tables.segment_table(
            0.5 * (self.arclength[:-1] + self.arclength[1:]),
            self.directors,
            forces=self.forces,
            stretches=self.state.stretches,
        )

    def to_vtk(self, path: str | os.PathLike[str]) -> Path:
        """Write the rod for ParaView.

        Nodes carry arc length s, strain and moment (not a number where a node has no hinge);
        segments carry the directors d1, d2, d3, the internal force and the stretch.

        Parameters
        ----------
        path : path
            File whose name ends in ``.vtu`` or ``.vtk``.

        Returns
        -------
        pathlib.Path

        Warns
        -----
        LissomeWarning
            As of :meth:`self_crossings`.
        """
        closed = self.structure.closed
        self.self_crossings()
        return _tables.write_vtk(
            path,
            self.positions,
            self.directors,
            closed=closed,
            point_data={
                "s": self.arclength,
                "strain": self._at_nodes(self.strains),
                "moment": self._at_nodes(self.moments),
            },
            cell_data={"force": self.forces, "stretch": self.state.stretches},
        )

    def _support_moment(self, support: Any) -> Array:
        rod = self.structure
        plan, count = rod.layout.plan, rod.lengths.size
        here = np.flatnonzero(rod.layout.nodes == support.node)
        moment = np.zeros(3)
        if support.clamp == "node":
            for i in here:  # a clamp before its segment feels what is beyond, and the reverse
                left = plan.left[i] < count
                moment += self.moment_vectors[i] if left else -self.moment_vectors[i]
            if support.axis is not None:
                moment -= support.moment * support.axis
            return moment
        start = support.node == 0
        j = 0 if start else count - 1
        step = self.positions[j + 1] - self.positions[j]
        sign = -1.0 if start else 1.0
        beside = (plan.right if not start else plan.left) == j
        moment += sign * self.moment_vectors[beside].sum(axis=0)
        moment += sign * np.cross(step, self.forces[j]) * (1.0 if start else -1.0)
        for k, force, arm in rod._couples:
            if k == j:
                moment -= np.cross(rotate(self.state.quaternions[j], arm), force)
        return moment


def _total_twist(rod: Rod, state: RodState) -> float:
    """Return the total twist, in turns."""
    plan = rod.layout.plan
    q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
    _kernel.hinge_rotations(rod._frames(state), plan.left, plan.right, plan.twist, q, kappa)
    return topology.total_twist(q)
