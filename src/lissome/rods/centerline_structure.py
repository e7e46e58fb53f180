"""A rod in the centerline-twist representation, as a structure that the solvers take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..equilibrium import Equilibrium
from ..errors import InvalidInput
from ..factorization import ChainKKT, ChainLayout
from ..reactions import Reactions
from ..structure import EPS, BaseStructure, Evaluation
from . import _centerline_kernel as _kernel
from ._equilibrium import RodEquilibrium
from ._structure import Rod, RodState
from .centerline import RESET, CenterlineState, reconstructed
from .measures import CODES, measure_all, pull_back_all
from .quaternions import rotate, to_directors

__all__ = ["CenterlineTwist"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_NO_STIFFNESS = np.zeros((0, 3, 3))


@dataclass(frozen=True, eq=False)
class _Places:
    """Where unknowns and multipliers are: columns of the band, and entries of vectors of unknowns."""

    node_column: Index  # (N + 1, 3)
    twist_column: Index  # (N,)
    row_column: Index  # (N,)
    node_unknown: Index
    twist_unknown: Index
    row_number: Index  # (N,): number of the constraint of a segment, or -1
    chain: ChainLayout
    fixed_nodes: NDArray[np.bool_]  # (N + 1, 3)
    fixed_values: Array
    prescribed: dict[int, Array]  # frames of prescribed segments


@dataclass(frozen=True)
class _InRod(RodEquilibrium):
    """An equilibrium in the unknowns of the rod, whose forces come from the nodes."""

    given: Array

    @property
    def forces(self) -> Array:
        return self.given


@dataclass(frozen=True, eq=False)
class CenterlineTwist(BaseStructure):
    r"""The discrete rod of the thesis in its own unknowns: nodes and twist angles.

    Energy, loads and supports are those of `rod`, and so are the equilibria. The unknowns are the
    nodes :math:`x_i` and twist angles :math:`\varphi^j`; an inextensible rod has the constraint

    .. math:: \varepsilon^j = \tfrac12\left(\frac{|x_{j+1} - x_j|^2}{\ell_j} - \ell_j\right) = 0

    for each segment (4.33), whose multiplier is the tension. Unknowns and multipliers are interleaved
    along the rod, 5 for each segment, so that the KKT matrix is a band of half width 12.

    References are those of the states (:class:`~lissome.rods.centerline.CenterlineState`);
    :meth:`retract` renews the reference of a segment that has turned away from it by 120 degrees.

    Eigenvalues spread like the fourth power of the number of segments, so that shifts of the Hessian
    start far below its entries (`smallest_shift`).

    Parameters
    ----------
    rod : Rod
        An open rod. Its ends and nodes may be free, pinned or clamped; a clamped segment prescribes
        all three components of its position.

    Raises
    ------
    InvalidInput
        If the rod is closed or has a support that turns about an axis: use the rod itself.

    Examples
    --------
    >>> import lissome as ls
    >>> from lissome import rods
    >>> from lissome.rods.centerline_structure import CenterlineTwist
    >>> rod = rods.Rod(rods.Kirchhoff((1.0, 1.0), 0.8), [0.05] * 20)
    >>> rod = rod.clamped("start").loaded(end=(1.0, 0.0, 0.0))
    >>> first, second = ls.equilibrate(rod), ls.equilibrate(CenterlineTwist(rod))
    >>> abs(first.energy - second.energy) < 1e-12
    True
    """

    rod: Rod
    smallest_shift: ClassVar[float] = 1e-13

    def __post_init__(self) -> None:
        rod = self.rod
        if not isinstance(rod, Rod):
            raise InvalidInput(f"argument `rod` is of type {type(rod).__name__}; pass a Rod")
        if rod.closed:
            raise InvalidInput(
                "argument `rod` is closed; the centerline-twist representation here is for open rods"
            )
        for support in rod.supports:
            if support.kind == "hinged":
                raise InvalidInput(
                    f"argument `rod` has a hinged support at node {support.node}; the "
                    "centerline-twist representation here knows free, pinned and clamped nodes"
                )
            if support.clamp == "segment" and None in support.position:
                raise InvalidInput(
                    f"argument `rod` has a clamped segment at node {support.node} with a free component "
                    "of its position; prescribe all three, or clamp the node (clamp='node')"
                )
        _ = self._places

    # ---- layout --------------------------------------------------------------------------------

    @cached_property
    def _places(self) -> _Places:
        """Where everything is.

        Raises
        ------
        InvalidInput
            If the supports leave nothing free.
        """
        rod = self.rod
        n = rod.lengths.size
        layout = rod.layout
        fixed = np.zeros((n + 1, 3), dtype=bool)
        values = np.zeros((n + 1, 3))
        prescribed = {j: layout.fixed[i] for j, i in layout.segment_of.items()}
        for support in rod.supports:
            for k, value in enumerate(support.position):
                if value is not None:
                    fixed[support.node, k] = True
                    values[support.node, k] = value
        for j, frame in prescribed.items():
            near, far, sign = (0, 1, 1.0) if j == 0 else (n, n - 1, -1.0)
            fixed[far] = True
            values[far] = values[near] + sign * rod.lengths[j] * to_directors(frame)[2]
        twist_free = np.ones(n, dtype=bool)
        twist_free[list(prescribed)] = False
        rows = twist_free & (rod.stretching is None)
        # one line for each segment: node (3), multiplier, twist; then the last node
        free = np.zeros((n + 1, 5), dtype=bool)
        free[:, :3] = ~fixed
        free[:n, 3] = rows
        free[:n, 4] = twist_free
        column = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        unknown = free.copy()
        unknown[:, 3] = False
        number = np.where(unknown, np.cumsum(unknown).reshape(free.shape) - 1, -1)
        if not np.any(unknown):
            raise InvalidInput("the supports leave nothing free; use more segments")
        chain = ChainLayout(int(np.count_nonzero(free)), column[unknown], column[:, 3][free[:, 3]])
        return _Places(
            node_column=np.ascontiguousarray(column[:, :3]),
            twist_column=np.ascontiguousarray(column[:n, 4]),
            row_column=np.ascontiguousarray(column[:n, 3]),
            node_unknown=np.ascontiguousarray(number[:, :3]),
            twist_unknown=np.ascontiguousarray(number[:n, 4]),
            row_number=np.where(rows, np.cumsum(rows) - 1, -1),
            chain=chain,
            fixed_nodes=fixed,
            fixed_values=values,
            prescribed=prescribed,
        )

    @property
    def size(self) -> int:
        """Number of unknowns."""
        assert self._places.chain.unknowns is not None
        return int(self._places.chain.unknowns.size)

    @property
    def constraints_count(self) -> int:
        """Number of segments that keep their length."""
        assert self._places.chain.constraints is not None
        return int(self._places.chain.constraints.size)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints."""
        rows = np.flatnonzero(self._places.row_number >= 0)
        return tuple(f"length of segment {j}" for j in rows)

    # ---- states --------------------------------------------------------------------------------

    def start(self) -> CenterlineState:
        """Return the initial state of the rod, with supports imposed."""
        return self.from_rod(self.rod.start())

    def from_rod(self, state: RodState) -> CenterlineState:
        """Return the state of nodes and twists of `state`, one of the rod; its frames are the reference."""
        nodes = self.rod.positions(state)
        return self._imposed(CenterlineState.from_frames(nodes, state.quaternions))

    def to_rod(self, state: CenterlineState) -> RodState:
        """Return the state of the rod with the same frames as `state`.

        Its nodes follow by summation: they are the same as far as the segments of an inextensible rod
        have kept their lengths.
        """
        stretches = None
        if self.rod.stretching is not None:
            stretches = np.linalg.norm(np.diff(state.positions, axis=0), axis=1) / self.rod.lengths
        supports = [s.frame for s in self.rod.supports if s.frame is not None]
        return RodState(
            state.quaternions, state.positions[0], stretches, None, np.reshape(supports, (-1, 4))
        )

    def _imposed(self, state: CenterlineState) -> CenterlineState:
        """Return `state` with the prescribed nodes and segments of this structure."""
        places = self._places
        if state.segments != self.rod.lengths.size:
            raise InvalidInput(
                f"argument `start` has {state.segments} segments; this rod has "
                f"{self.rod.lengths.size}"
            )
        nodes = np.where(places.fixed_nodes, places.fixed_values, state.positions)
        if not places.prescribed and np.array_equal(nodes, state.positions):
            return state
        twists, reference = np.array(state.twists), np.array(state.reference)
        for j, frame in places.prescribed.items():
            twists[j], reference[j] = 0.0, frame
        return CenterlineState(nodes, twists, reference)

    def adopt(self, state: Any) -> CenterlineState:
        """Return a state, of this structure or of the rod, with supports imposed.

        Nodes that are not prescribed stay where they are: the solver restores the lengths of segments
        next to a support that has moved. A state of the rod is first adopted by the rod, which also turns
        the rod between clamps that have turned.

        Raises
        ------
        InvalidInput
            If `state` is of another kind, or of another number of segments.
        """
        if isinstance(state, RodState):
            return self.from_rod(self.rod.adopt(state))
        if not isinstance(state, CenterlineState):
            raise InvalidInput(
                f"argument `start` is of type {type(state).__name__}; pass a CenterlineState or a "
                "RodState"
            )
        return self._imposed(state)

    def retract(self, state: CenterlineState, dx: Array) -> CenterlineState:
        """Return the state after an increment; references that are too far off are renewed.

        Raises
        ------
        InvalidInput
            If the increment turns a segment opposite to its reference; see :meth:`max_step`.
        """
        places = self._places
        padded = np.append(dx, 0.0)  # entry -1: what does not move
        return reconstructed(
            state.positions + padded[places.node_unknown],
            state.twists + padded[places.twist_unknown],
            state.reference,
            RESET,
        )

    def difference(self, a: CenterlineState, b: CenterlineState) -> Array:
        """Return the increment that leads from `a` to `b`, in the chart of the reference of `a`.

        Raises
        ------
        InvalidInput
            If a segment of `b` points opposite to the reference of `a`.
        """
        places = self._places
        twists = b.twists - a.twists
        if not np.array_equal(a.reference, b.reference):
            twists = b.referred_to(a.reference).twists - a.twists
            twists = twists - 2.0 * np.pi * np.round(twists / (2.0 * np.pi))
        dx = np.empty(self.size)
        nodes, angles = places.node_unknown >= 0, places.twist_unknown >= 0
        dx[places.node_unknown[nodes]] = (b.positions - a.positions)[nodes]
        dx[places.twist_unknown[angles]] = twists[angles]
        return dx

    def max_step(self, state: CenterlineState, dx: Array) -> float:
        """Return the fraction of `dx` that turns no segment by more than 50 degrees.

        Nor may a hinge reach the angle pi, to first order.
        """
        plan, made = self.rod.layout.plan, state._made
        frames = self._frames(state)
        q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(frames, plan.left, plan.right, q, kappa)
        return float(
            _kernel.largest_step(
                made.edges, made.sizes, made.tangents, made.binormals, frames, q, plan.left,
                plan.right, self._places.node_unknown, self._places.twist_unknown,
                np.ascontiguousarray(dx, dtype=float),
            )
        )  # fmt: skip

    def metric(self, state: CenterlineState) -> Array:
        """Return masses: rest lengths of the nodes, and of segments times the square of the length.

        Norms approximate integrals over the rod; a turn by one radian counts like a displacement by the
        length of the rod.
        """
        lengths = self.rod.lengths
        nodes = np.zeros(lengths.size + 1)
        nodes[:-1] += 0.5 * lengths
        nodes[1:] += 0.5 * lengths
        return self._gathered(nodes[:, None] * np.ones(3), lengths * self.rod.length**2)

    def typical(self, state: CenterlineState) -> Array:
        """Return the rest length of the rod for nodes, one radian for twists."""
        n = self.rod.lengths.size
        return self._gathered(np.full((n + 1, 3), self.rod.length), np.ones(n))

    def noise(self, state: CenterlineState) -> float:
        """Return the round-off of terms of the gradient."""
        return 16 * EPS

    def gauge(self, state: CenterlineState) -> Array:
        """Return the rigid motions that nothing opposes, shape (g, n)."""
        rod, n = self.rod, self.rod.lengths.size
        generators: list[tuple[Array, Array]] = []
        anchors = rod.layout.anchors
        for k, anchor in enumerate(anchors):
            if anchor is None:
                generators.append((np.ones((n + 1, 1)) * np.eye(3)[k], np.zeros(n)))
        if not any(s.kind == "clamped" for s in rod.supports):
            rod_state = self.to_rod(state)
            column = int(rod.layout.plan.column[0])
            half = 0.5 * state._made.binormals
            for row in rod.gauge(rod_state):
                omega = rotate(rod_state.quaternions[0], row[column : column + 3])
                nodes = np.cross(omega, state.positions)
                for k, anchor in enumerate(anchors):
                    if anchor is not None:
                        nodes[:, k] -= nodes[anchor[0], k]
                change = np.cross(omega, state.tangents)
                twists = state.tangents @ omega + np.sum(half * change, axis=1)
                generators.append((nodes, twists))
        return np.array([self._gathered(*pair) for pair in generators]).reshape(-1, self.size)

    def _gathered(self, nodes: Array, twists: Array) -> Array:
        places = self._places
        out = np.empty(self.size)
        out[places.node_unknown[places.node_unknown >= 0]] = nodes[places.node_unknown >= 0]
        out[places.twist_unknown[places.twist_unknown >= 0]] = twists[places.twist_unknown >= 0]
        return out

    # ---- energy --------------------------------------------------------------------------------

    def _frames(self, state: CenterlineState) -> Array:
        return np.concatenate([state._made.frames, self.rod.layout.fixed])

    def evaluate(self, state: CenterlineState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`."""
        places = self._places
        energy, values, gradient, band = self._assembled(
            state, multipliers, order,
            (places.node_column, places.twist_column, places.row_column, places.chain.length),
        )  # fmt: skip
        constraints = values[places.row_number >= 0]
        if order == 0:
            return Evaluation(energy, constraints)
        gradient = gradient[places.chain.unknowns]
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        return Evaluation(energy, constraints, gradient, ChainKKT(band, layout=places.chain))

    def _assembled(
        self, state: CenterlineState, multipliers: Array, order: int, columns: tuple[Any, ...]
    ) -> tuple[float, Array, Array, Array]:
        """Return energy, measures of stretch, and gradient and band in given columns."""
        rod, made = self.rod, state._made
        layout, plan = rod.layout, rod.layout.plan
        n, hinges = rod.lengths.size, plan.left.size
        frames = self._frames(state)
        q, kappa = np.empty((hinges, 4)), np.empty((hinges, 3))
        _kernel.hinge_rotations(frames, plan.left, plan.right, q, kappa)
        if rod.measure != "sine":
            measure_all(CODES[rod.measure], q, kappa)
        density, stress, stiffness = layout.law.evaluate(
            kappa / plan.span[:, None] - plan.natural, order
        )
        energy = float(plan.span @ density)
        stress = np.zeros((hinges, 3)) if stress is None else np.ascontiguousarray(stress)
        stiffness = _NO_STIFFNESS if stiffness is None else stiffness / plan.span[:, None, None]
        if rod.measure != "sine":
            pull_back_all(CODES[rod.measure], q, stress, stiffness, order)
        nodes, twists, rows, count = columns
        gradient = np.empty(count)
        band = np.empty((count if order >= 2 else 0, 13))
        values = np.empty(n)
        tensions = np.append(multipliers, 0.0)[self._places.row_number]
        energy += _kernel.assemble(
            state.positions, made.tangents, made.edges, made.sizes, made.binormals, made.bent, frames,
            q, stress, stiffness, plan.left, plan.right, rod.lengths, plan.stiffness,
            layout.node_forces, plan.arms, tensions, nodes, twists, rows, gradient, values, band, order,
        )  # fmt: skip
        return energy, values, gradient, band

    # ---- supports ------------------------------------------------------------------------------

    def reactions(self, equilibrium: Equilibrium) -> Reactions:
        """Return what the supports exert in `equilibrium`, by the names that they have in the rod."""
        forces = self._internal_forces(equilibrium.state, equilibrium.multipliers)
        state = self.to_rod(equilibrium.state)
        return (
            replace(equilibrium, structure=self.rod, state=state)
            .as_type(_InRod, given=forces)
            .reactions()
        )

    def _internal_forces(self, state: CenterlineState, multipliers: Array) -> Array:
        """Return the force of what is beyond each segment on what is before, shape (N, 3)."""
        n = self.rod.lengths.size
        nodes = np.arange(3 * (n + 1), dtype=np.int64).reshape(n + 1, 3)
        absent = np.full(n, -1, dtype=np.int64)
        held = self._assembled(state, multipliers, 1, (nodes, absent, absent, 3 * (n + 1)))[2]
        held = held.reshape(n + 1, 3)
        for j in self._places.prescribed:  # the clamp of a segment acts on its end of the rod
            near, far = (0, 1) if j == 0 else (n, n - 1)
            held[near] += held[far]
            held[far] = 0.0
        return np.asarray(-np.cumsum(held + self.rod.layout.node_forces, axis=0)[:-1])
