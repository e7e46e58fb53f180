"""Rods as structures: states, supports, loads, and what the solvers of the core ask for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite, finite_array, integer_at_least, one_of, positive
from ..equilibrium import Equilibrium
from ..errors import FactorizationError, InvalidInput
from ..factorization import ChainKKT, ChainLayout
from ..structure import EPS, BaseStructure, Corrected, Evaluation
from . import _kernel
from ._corrector import fast_correction
from ._equilibrium import RodEquilibrium
from .loads import Distributed, Loads
from .measures import CODES, MEASURES, measure_all, pull_back_all, rotation_from_strain
from .quaternions import conjugate, exponential, logarithm, multiply, rotate, to_matrix
from .supports import Support, as_direction, as_frame, as_position

__all__ = ["Rod", "RodState"]

Array = NDArray[np.float64]
#: Distances are compared to this fraction of the length.
REACH = 1e-12
KEEP: Any = object()


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class RodState:
    """Configuration of a rod.

    Parameters
    ----------
    quaternions : array_like, shape (N, 4)
        Frames of the segments: unit quaternions, scalar first, that take e1, e2, e3 to the directors.
    origin : array_like, shape (3,)
        Position of node 0.
    stretches : array_like, shape (N,), optional
        Lengths of the segments over their rest lengths; ones by default.
    angles : array_like, shape (h,), optional
        Angles (radians) of the hinged supports, in the order of nodes; zeros by default.
    supports : array_like, shape (k, 4), optional
        Frames that were prescribed when the state was made, in the order of nodes. From them a rod
        tells by how much its clamps have turned.
    """

    quaternions: Array
    origin: Array = field(default_factory=lambda: np.zeros(3))
    stretches: Any = None
    angles: Any = None
    supports: Any = None

    def __post_init__(self) -> None:
        quaternions = finite_array("quaternions", self.quaternions, (None, 4))
        count = quaternions.shape[0]
        sizes = np.sqrt(np.sum(quaternions**2, axis=1))
        if np.any(np.abs(sizes - 1.0) > 1e-8):
            j = int(np.argmax(np.abs(sizes - 1.0)))
            raise InvalidInput(
                f"argument `quaternions`[{j}] has length {sizes[j]:.9g}; pass unit quaternions"
            )
        stretches = np.ones(count) if self.stretches is None else self.stretches
        stretches = finite_array("stretches", stretches, (count,))
        if np.any(stretches <= 0.0):
            raise InvalidInput(
                f"argument `stretches` holds {stretches.min():g}; each must be greater than 0"
            )
        angles = np.zeros(0) if self.angles is None else self.angles
        supports = np.zeros((0, 4)) if self.supports is None else self.supports
        values = {
            "quaternions": quaternions,
            "origin": finite_array("origin", self.origin, (3,)),
            "stretches": stretches,
            "angles": finite_array("angles", angles, (None,)),
            "supports": finite_array("supports", supports, (None, 4)),
        }
        for name, value in values.items():
            object.__setattr__(self, name, _frozen(value))


def _state(
    quaternions: Array, origin: Array, stretches: Array, angles: Array, supports: Array
) -> RodState:
    """Make a state of arrays that are known to be right, and are not used elsewhere."""
    state = object.__new__(RodState)
    for name, value in (
        ("quaternions", quaternions), ("origin", origin), ("stretches", stretches),
        ("angles", angles), ("supports", supports),
    ):  # fmt: skip
        value.flags.writeable = False
        object.__setattr__(state, name, value)
    return state


@dataclass(frozen=True, eq=False)
class _Layout:
    """Where everything is, derived once from a rod."""

    plan: _kernel.Plan
    nodes: NDArray[np.int64]  # of the hinges
    arclength: Array  # of the hinges
    law: Any
    fixed: Array  # frames of supports, (S, 4); hinged ones at the angle zero
    hinged: NDArray[np.int64]  # which of them turn
    turning_axes: Array  # their spatial axes
    anchors: tuple[tuple[int, float] | None, ...]  # by component: node and position
    row_nodes: NDArray[np.int64]  # node of each constraint; -1 for closure
    evaluate_into: Any  # of a compiled law
    net_force: Array | None  # sum of all dead forces, if it is not zero
    node_forces: Array  # (N + 1, 3)
    chain: ChainLayout
    width: int
    border: int
    metric: Array
    segment_of: dict[int, int]  # prescribed segments: index of the support


@dataclass(frozen=True, eq=False)
class Rod(BaseStructure):
    r"""A discrete elastic rod: rigid segments with frames, elastic hinges at the nodes.

    The energy is

    .. math:: E = \sum_i \ell_i W(\kappa_i/\ell_i - k^0_i) - \sum_i F_i\cdot x_i

    (4.31), (4.32), with the strain :math:`\kappa_i = 2\,\mathrm{vec}(\overline{d^{i-1}} d^i)` (4.16),
    the Voronoi length :math:`\ell_i` of node i, and natural strains :math:`k^0`. The unknowns are
    rotations of the segments; the nodes follow by summation, so that an inextensible rod needs no
    constraint but for its far supports. Rods are made by :func:`straight` and its kin.

    Parameters
    ----------
    law : Law
        Energy per unit length as a function of the strain densities.
    lengths : array_like, shape (N,)
        Rest lengths of the segments.
    natural : array_like, shape (N + 1, 3), optional
        Natural strain densities (1/length) at the nodes, about d1, d2 and d3; zero by default. Of a
        closed rod row 0 holds for the joint.
    closed : bool
        Whether the last node is the first.
    joint : float
        Closed rods: angle (radians) about d3 by which the first frame is turned before it is joined
        to the last.
    supports : tuple of Support
        See :meth:`clamped`, :meth:`pinned`, :meth:`hinged`.
    loads : Loads
        See :meth:`loaded`.
    stretching : float, optional
        Stretching stiffness EA: energy :math:`\tfrac12 EA\,\ell\,[(e^2 - 1)/2]^2` of a segment whose
        length is e times its rest length (4.17). None (default): inextensible.
    measure : str
        Measure of the rotation across a hinge.
    phase : int or None
        Number k of lobes whose place along a free uniform ring is pinned; see :meth:`with_phase`.
    initial : RodState, optional
        Where solvers start, and where supports are that are told to be "where it is"; by default
        the natural shape from the origin along e3.

    Raises
    ------
    InvalidInput
        If an argument has a wrong shape or value.
    """

    law: Any
    lengths: Array
    natural: Any = None
    closed: bool = False
    joint: float = 0.0
    supports: tuple[Support, ...] = ()
    loads: Loads = field(default_factory=Loads)
    stretching: float | None = None
    measure: str = "sine"
    phase: int | None = 2
    initial: Any = None

    def __post_init__(self) -> None:
        lengths = finite_array("lengths", self.lengths, (None,))
        if lengths.size < 2:
            raise InvalidInput(
                f"argument `lengths` has {lengths.size} entries; a rod has at least 2 segments"
            )
        if np.any(lengths <= 0.0):
            j = int(np.argmax(lengths <= 0.0))
            raise InvalidInput(
                f"argument `lengths`[{j}] is {lengths[j]:g}; each length must be greater than 0"
            )
        count = lengths.size
        natural = np.zeros((count + 1, 3)) if self.natural is None else self.natural
        natural = finite_array("natural", natural, (count + 1, 3))
        strains = tuple(getattr(self.law, "strains", ()))
        if strains != ("curvature_1", "curvature_2", "twist"):
            raise InvalidInput(
                f"argument `law` is {self.law!r}; a rod needs a law of the strains curvature_1, "
                "curvature_2 and twist, such as rods.Kirchhoff"
            )
        rows = getattr(self.law, "count", None)
        if rows is not None and rows != count + 1:
            raise InvalidInput(
                f"argument `law` holds values for {rows} nodes; the rod has {count + 1}"
            )
        object.__setattr__(self, "lengths", _frozen(lengths))
        object.__setattr__(self, "natural", _frozen(natural))
        object.__setattr__(self, "joint", finite("joint", self.joint))
        if self.joint and not self.closed:
            raise InvalidInput(f"argument `joint` is {self.joint:g}; only a closed rod has a joint")
        if self.stretching is not None:
            object.__setattr__(self, "stretching", positive("stretching", self.stretching))
        one_of("measure", self.measure, MEASURES)
        if self.phase is not None:
            object.__setattr__(self, "phase", integer_at_least("phase", self.phase, 2))
        initial = self._natural_shape() if self.initial is None else self.initial
        if not isinstance(initial, RodState):
            raise InvalidInput(
                f"argument `initial` is of type {type(initial).__name__}; pass a RodState"
            )
        if initial.quaternions.shape != (count, 4):
            raise InvalidInput(
                f"argument `initial` has {initial.quaternions.shape[0]} segments; the rod has {count}"
            )
        object.__setattr__(self, "initial", initial)

    def _natural_shape(self) -> RodState:
        nodes = np.arange(1, self.lengths.size)
        spans = 0.5 * (self.lengths[:-1] + self.lengths[1:])
        turns = _rotation_of(self.natural[nodes], spans, self.measure)
        frames = np.empty((self.lengths.size, 4))
        frames[0] = (1.0, 0.0, 0.0, 0.0)
        for j in range(1, self.lengths.size):
            frames[j] = multiply(frames[j - 1], turns[j - 1])
        frames /= np.sqrt(np.sum(frames**2, axis=1))[:, None]
        return RodState(frames)

    # ---- supports ------------------------------------------------------------------------------

    def _node(self, where: str | int) -> int:
        count = self.lengths.size
        if isinstance(where, str):
            one_of("where", where, ("start", "end"))
            if self.closed:
                raise InvalidInput(
                    f"argument `where` is {where!r}; a closed rod has no ends: pass the number of a "
                    "node"
                )
            return 0 if where == "start" else count
        if isinstance(where, bool) or not isinstance(where, (int, np.integer)):
            raise InvalidInput(
                f"argument `where` is {where!r}; pass 'start', 'end' or the number of a node"
            )
        last = count - 1 if self.closed else count
        if not 0 <= where <= last:
            raise InvalidInput(f"argument `where` is {where}; nodes are numbered 0 to {last}")
        return int(where)

    def _supported(self, support: Support) -> Rod:
        others = [s for s in self.supports if s.node != support.node]
        ordered = tuple(sorted([*others, support], key=lambda s: s.node))
        return replace(self, supports=ordered)

    def _position_at_rest(self, node: int) -> tuple[float, float, float]:
        x, y, z = self.positions(self.initial)[node]
        return (float(x), float(y), float(z))

    def _frame_at_rest(self, node: int) -> Array:
        """Return the frame of a node: that of the adjacent segments, turned by the natural strain."""
        frames, count = self.initial.quaternions, self.lengths.size
        if 0 < node < count or self.closed:
            left, right = frames[node - 1], frames[node % count]
            if node == 0:
                right = multiply(right, exponential([0.0, 0.0, self.joint]))
            share = self.lengths[node - 1] / (self.lengths[node - 1] + self.lengths[node % count])
            return multiply(left, exponential(share * logarithm(multiply(conjugate(left), right))))
        if node == 0:
            half = _rotation_of(self.natural[:1], 0.5 * self.lengths[:1], self.measure)[0]
            return multiply(frames[0], conjugate(half))
        half = _rotation_of(self.natural[-1:], 0.5 * self.lengths[-1:], self.measure)[0]
        return multiply(frames[-1], half)

    def clamped(
        self, where: str | int, position: Any = None, frame: Any = None, kind: str = "half"
    ) -> Rod:
        """Return this rod with position and frame of a node prescribed.

        Parameters
        ----------
        where : {"start", "end"} or int
            The node.
        position : sequence of three float or None, optional
            Components of the position, None where it is free; by default where it is at rest.
        frame : Rotation, array_like (3, 3) or (4,), optional
            Frame of the node: a scipy Rotation, the directors as rows, or a quaternion (scalar
            first); by default as it is at rest.
        kind : {"half", "two-node"}
            "half": the frame holds the adjacent segment through a hinge of half its length; second
            order. "two-node" (ends only): it is the frame of the adjacent segment; first order.

        Raises
        ------
        InvalidInput
            If the node does not exist or a frame is not orthonormal.
        """
        node = self._node(where)
        one_of("kind", kind, ("half", "two-node"))
        if kind == "two-node" and (self.closed or 0 < node < self.lengths.size):
            raise InvalidInput(
                "argument `kind` is 'two-node'; only the ends of a rod have such clamps"
            )
        place = self._position_at_rest(node) if position is None else as_position(position)
        if frame is not None:
            quaternion = as_frame(frame)
        elif kind == "half":
            quaternion = self._frame_at_rest(node)
        else:
            quaternion = self.initial.quaternions[0 if node == 0 else -1].copy()
        return self._supported(Support(node, "clamped", place, _frozen(quaternion), kind))

    def pinned(self, where: str | int, position: Any = None) -> Rod:
        """Return this rod with the position of a node prescribed, and its frame free.

        Parameters
        ----------
        where : {"start", "end"} or int
            The node.
        position : sequence of three float or None, optional
            Components of the position, None where it is free; by default where it is at rest.
        """
        node = self._node(where)
        place = self._position_at_rest(node) if position is None else as_position(position)
        return self._supported(Support(node, "pinned", place))

    def hinged(
        self,
        where: str | int,
        position: Any = None,
        frame: Any = None,
        *,
        axis: ArrayLike,
        moment: float = 0.0,
    ) -> Rod:
        """Return this rod with a frame at a node that turns about a fixed axis only.

        Parameters
        ----------
        where : {"start", "end"} or int
            The node.
        position, frame
            As for :meth:`clamped`; `frame` is the frame at the angle zero.
        axis : array_like, shape (3,)
            The axis, in space. It is divided by its length.
        moment : float
            Dead moment about the axis: its potential is minus the moment times the angle.
        """
        node = self._node(where)
        place = self._position_at_rest(node) if position is None else as_position(position)
        quaternion = self._frame_at_rest(node) if frame is None else as_frame(frame)
        direction = as_direction("axis", axis)
        return self._supported(
            Support(
                node, "hinged", place, _frozen(quaternion), "half", _frozen(direction),
                finite("moment", moment),
            )
        )  # fmt: skip

    def freed(self, where: str | int) -> Rod:
        """Return this rod without the support of a node."""
        node = self._node(where)
        return replace(self, supports=tuple(s for s in self.supports if s.node != node))

    # ---- loads ---------------------------------------------------------------------------------

    def loaded(
        self,
        start: ArrayLike | None = None,
        end: ArrayLike | None = None,
        nodes: Mapping[int, ArrayLike] | None = None,
        distributed: Distributed | None = None,
        arm: ArrayLike | None = None,
        couples: Mapping[str | int, tuple[ArrayLike, ArrayLike]] | None = None,
    ) -> Rod:
        """Return this rod under dead loads. What is named replaces what was there.

        Parameters
        ----------
        start, end : array_like, shape (3,), optional
            Forces on the ends.
        nodes : mapping of int to array_like (3,), optional
            Forces on nodes.
        distributed : array_like (3,) or (N + 1, 3), or callable, optional
            Force per unit rest length; a function is called with the arc lengths of all nodes.
        arm : array_like, shape (3,), optional
            Where the forces `start` and `end` of this call act: components along the directors of the
            end segment, measured from the node.
        couples : mapping of "start", "end" or int to (force, arm), optional
            For segments: a force that acts at the end of an arm fixed to the segment (components
            along the directors), and the opposite force at its foot.
        """
        count = self.lengths.size
        points, pairs = dict(self.loads.points), dict(self.loads.couples)
        lever = None if arm is None else _frozen(finite_array("arm", arm, (3,)))
        if lever is not None and start is None and end is None:
            raise InvalidInput("argument `arm` is given without `start` or `end`; name the force")
        for name, value, segment in (("start", start, 0), ("end", end, count - 1)):
            if value is None:
                continue
            force = _frozen(finite_array(name, value, (3,)))
            points[self._node(name)] = force
            pairs.pop(segment, None)
            if lever is not None:
                pairs[segment] = (force, lever)
        for key, value in (nodes or {}).items():
            points[self._node(key)] = _frozen(finite_array(f"nodes[{key}]", value, (3,)))
        for where, pair in (couples or {}).items():
            if isinstance(where, str):
                j = 0 if self._node(where) == 0 else count - 1
            elif 0 <= where < count:
                j = int(where)
            else:
                raise InvalidInput(
                    f"argument `couples` names segment {where}; they are numbered 0 to {count - 1}"
                )
            pairs[j] = (
                _frozen(finite_array(f"couples[{where!r}][0]", pair[0], (3,))),
                _frozen(finite_array(f"couples[{where!r}][1]", pair[1], (3,))),
            )
        density = self.loads.distributed
        if distributed is not None:
            if callable(distributed):
                density = distributed
            else:
                density = finite_array("distributed", distributed)
                if density.shape not in ((3,), (count + 1, 3)):
                    raise InvalidInput(
                        f"argument `distributed` has shape {density.shape}; it must be (3,) or "
                        f"({count + 1}, 3)"
                    )
                density = _frozen(density)
        return replace(self, loads=Loads(points, density, pairs))

    # ---- other changes -------------------------------------------------------------------------

    def with_law(self, law: Any) -> Rod:
        """Return this rod of another material."""
        return replace(self, law=law)

    def with_natural(
        self, *, curvature_1: Any = None, curvature_2: Any = None, twist: Any = None
    ) -> Rod:
        """Return this rod with other natural strains: numbers, or one number for each node."""
        natural = np.array(self.natural)
        for k, (name, value) in enumerate(
            (("curvature_1", curvature_1), ("curvature_2", curvature_2), ("twist", twist))
        ):
            if value is None:
                continue
            array = finite_array(name, value)
            if array.shape not in ((), (natural.shape[0],)):
                raise InvalidInput(
                    f"argument `{name}` has shape {array.shape}; pass a number, or one for each of "
                    f"the {natural.shape[0]} nodes"
                )
            natural[:, k] = array
        return replace(self, natural=natural)

    def with_overcurvature(self, overcurvature: float) -> Rod:
        r"""Return this ring with the natural curvature :math:`O\,2\pi/L` in its plane.

        Parameters
        ----------
        overcurvature : float
            O: natural curvature over the curvature of the circle of the same length.

        Raises
        ------
        InvalidInput
            If the rod is not closed, or its initial state is not plane and untwisted.
        """
        value = finite("overcurvature", overcurvature)
        if not self.closed:
            raise InvalidInput("only a closed rod has an overcurvature; pass natural curvatures")
        normal = self._plane_normal()
        body = rotate(conjugate(self.initial.quaternions), normal)
        if np.max(np.abs(body - body[0])) > 1e-6:
            raise InvalidInput(
                "the initial state is twisted: the normal of the plane of the ring is not along one "
                "material direction; pass natural curvatures with `with_natural`"
            )
        curvature = 2.0 * math.pi * value / self.length * body[0]
        curvature[np.abs(curvature) < 1e-14 * abs(value) * math.pi / self.length] = 0.0
        return replace(self, natural=np.tile(curvature, (self.lengths.size + 1, 1)))

    def _plane_normal(self) -> Array:
        """Return the unit normal of a plane closed rod, which it circles counterclockwise."""
        nodes = self.positions(self.initial)[:-1]
        nodes = nodes - nodes.mean(axis=0)
        area = np.sum(np.cross(nodes, np.roll(nodes, -1, axis=0)), axis=0)
        size = float(np.linalg.norm(area))
        normal = area / size if size > 0.0 else np.zeros(3)
        if not size > 0.0 or np.max(np.abs(nodes @ normal)) > 1e-6 * self.length:
            raise InvalidInput(
                "the initial state is not a plane ring; pass one with `with_initial`, or give natural "
                "curvatures with `with_natural`"
            )
        return normal

    def with_phase(self, lobes: int | None) -> Rod:
        r"""Return this ring with the place of its lobes pinned, or free (None).

        The lobes of a uniform ring that has buckled may travel along it at no cost, but for terms as
        small as rounding errors. One linear condition on the tangents,

        .. math:: \sum_j \ell_j \sin(2\pi k s_j/L)\; t_j\cdot n = 0,

        with n the normal of the initial ring at the first segment and s from its middle, stops
        them without a force: its multiplier vanishes by symmetry. Of each pair of modes with k lobes
        it leaves one, so that the loss of stability of a circle shows as one unstable direction
        where there are two. It acts on rings that are free and uniform, with k = 2 by default; choose
        the k of the branch that is followed.

        Parameters
        ----------
        lobes : int or None
            k, at least 2.
        """
        return replace(self, phase=lobes)

    def with_initial(self, state: RodState) -> Rod:
        """Return this rod with another starting state. Supports stay where they are."""
        return replace(self, initial=state)

    # ---- geometry ------------------------------------------------------------------------------

    @cached_property
    def length(self) -> float:
        """Rest length."""
        return float(np.sum(self.lengths))

    @cached_property
    def arclength(self) -> Array:
        """Arc lengths of the nodes at rest, shape (N + 1,)."""
        return _frozen(np.concatenate([[0.0], np.cumsum(self.lengths)]))

    def positions(self, state: RodState) -> Array:
        """Return the positions of the nodes, shape (N + 1, 3)."""
        out = np.empty((self.lengths.size + 1, 3))
        _kernel.positions(state.quaternions, state.stretches, self.lengths, out)
        return out + state.origin

    @property
    def held(self) -> bool:
        """Whether the first segment is held, to remove the rigid motions of a free closed rod."""
        return self.closed and not self.supports and self.loads.empty

    @cached_property
    def pinned_phase(self) -> int | None:
        """Number of lobes whose place is pinned; None where nothing is."""
        if self.phase is None or not self.held or getattr(self.law, "count", None) is not None:
            return None
        uniform = np.ptp(self.lengths) <= 1e-12 * self.lengths[0] and not np.any(
            np.ptp(self.natural, axis=0) > 1e-12 * np.max(np.abs(self.natural))
        )
        return self.phase if uniform and self.lengths.size > 2 * self.phase else None

    # ---- the derived layout --------------------------------------------------------------------

    @cached_property
    def layout(self) -> _Layout:
        """What the kernels need, derived once."""
        return _derive(self)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        assert self.layout.chain.unknowns is not None
        return int(self.layout.chain.unknowns.size)

    @property
    def constraints_count(self) -> int:
        """Number of prescribed components of positions beyond those that place the rod."""
        return int(self.layout.plan.rows.shape[0])

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints."""
        out = []
        for node, row in zip(self.layout.row_nodes, self.layout.plan.rows, strict=True):
            if row[0] == 3:
                out.append(f"phase of {self.pinned_phase} lobes")
                continue
            axis = "xyz"[int(row[0])]
            out.append(f"closure along {axis}" if node < 0 else f"{axis} of node {int(node)}")
        return tuple(out)

    # ---- the manifold --------------------------------------------------------------------------

    def _check(self, state: Any) -> RodState:
        if not isinstance(state, RodState):
            raise InvalidInput(
                f"argument `start` is of type {type(state).__name__}; pass a RodState, for example the "
                "state of an equilibrium"
            )
        if state.quaternions.shape[0] != self.lengths.size:
            raise InvalidInput(
                f"argument `start` has {state.quaternions.shape[0]} segments; this rod has "
                f"{self.lengths.size}"
            )
        return state

    def start(self) -> RodState:
        """Return the initial state, bent as smoothly as can be so that it meets its supports."""
        return reach_supports(self, self.adopt(self.initial))

    def adopt(self, state: RodState) -> RodState:
        """Return `state` with prescribed values imposed.

        Where prescribed frames have turned since the state was made, the turn is spread over the
        rod between them, linearly in arc length.
        """
        state = self._check(state)
        layout = self.layout
        quaternions = state.quaternions
        now = layout.fixed
        hinges = layout.hinged.size
        angles = state.angles if state.angles.size == hinges else np.zeros(hinges)
        moved = state.supports.shape == now.shape and not np.array_equal(state.supports, now)
        if moved and now.size:
            turns = logarithm(multiply(now, conjugate(state.supports)))
            if np.any(turns):
                nodes = [s.node for s in self.supports if s.frame is not None]
                places = self.arclength[nodes]
                middle = 0.5 * (self.arclength[:-1] + self.arclength[1:])
                period = self.length if self.closed else None
                spread = np.stack(
                    [np.interp(middle, places, turns[:, k], period=period) for k in range(3)],
                    axis=1,
                )
                quaternions = multiply(exponential(spread), quaternions)
                quaternions /= np.sqrt(np.sum(quaternions**2, axis=1))[:, None]
        if layout.segment_of:
            quaternions = np.array(quaternions)
            for segment, index in layout.segment_of.items():
                quaternions[segment] = layout.fixed[index]
        stretches = state.stretches
        if self.stretching is None or layout.segment_of:
            stretches = np.where(layout.plan.stretch_column < 0, 1.0, stretches)
        origin = np.array(state.origin)
        if any(a is not None for a in layout.anchors):
            places = np.empty((self.lengths.size + 1, 3))
            _kernel.positions(quaternions, stretches, self.lengths, places)
            for k, anchor in enumerate(layout.anchors):
                if anchor is not None:
                    origin[k] = anchor[1] - places[anchor[0], k]
        return _state(quaternions, origin, stretches, angles, now)

    def frames(self, state: RodState) -> Array:
        """Return the frames of segments and supports, shape (K, 4)."""
        layout = self.layout
        if not layout.fixed.shape[0]:
            return state.quaternions
        fixed = np.array(layout.fixed)
        if layout.hinged.size:
            turns = exponential(state.angles[:, None] * layout.turning_axes)
            fixed[layout.hinged] = multiply(turns, fixed[layout.hinged])
        return np.concatenate([state.quaternions, fixed])

    def retract(self, state: RodState, dx: Array) -> RodState:
        """Return the state after the body increments `dx`."""
        layout = self.layout
        frames = self.frames(state)
        new, stretches = np.empty_like(frames), np.empty_like(state.stretches)
        angles = np.array(state.angles)
        dx = np.ascontiguousarray(dx, dtype=float)
        _kernel.retract(
            frames, state.stretches, 1.0, dx, layout.plan, new, stretches, state.angles, angles
        )
        quaternions = new[: self.lengths.size] if frames is not state.quaternions else new
        return self._placed(quaternions, stretches, angles, state)

    def _placed(
        self, quaternions: Array, stretches: Array, angles: Array, old: RodState
    ) -> RodState:
        layout = self.layout
        origin = np.array(old.origin)
        if any(a is not None and a[0] for a in layout.anchors):
            places = np.empty((self.lengths.size + 1, 3))
            _kernel.positions(quaternions, stretches, self.lengths, places)
            for k, anchor in enumerate(layout.anchors):
                if anchor is not None:
                    origin[k] = anchor[1] - places[anchor[0], k]
        return _state(quaternions, origin, stretches, angles, old.supports)

    def difference(self, a: RodState, b: RodState) -> Array:
        """Return the body increments that lead from `a` to `b`."""
        plan = self.layout.plan
        dx = np.zeros(self.size)
        count = self.lengths.size
        columns = plan.column[:count]
        free = columns >= 0
        turns = logarithm(multiply(conjugate(a.quaternions[free]), b.quaternions[free]))
        dx[columns[free][:, None] + np.arange(3)] = turns
        stretch = plan.stretch_column >= 0
        dx[plan.stretch_column[stretch]] = (b.stretches - a.stretches)[stretch]
        if b.angles.size:
            dx[plan.first_angle : plan.first_angle + b.angles.size] = b.angles - a.angles
        return dx

    def max_step(self, state: RodState, dx: Array) -> float:
        """Return the fraction of `dx` at which no hinge turns past pi and no segment vanishes."""
        plan = self.layout.plan
        q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(self.frames(state), plan, q, kappa)
        dx = np.ascontiguousarray(dx, dtype=float)
        return float(_kernel.largest_step(state.stretches, q, dx, plan))

    def metric(self, state: RodState) -> Array:
        """Return rest lengths as masses: norms approximate integrals over the rod."""
        return self.layout.metric

    def typical(self, state: RodState) -> float:
        """Return one: a radian, a stretch of one."""
        return 1.0

    def noise(self, state: RodState) -> float:
        """Return the round-off of differences of unit quaternions."""
        return 8 * EPS

    def gauge(self, state: RodState) -> Array:
        """Return the motions that nothing opposes, shape (g, n).

        They are rigid rotations, and for rods whose section is isotropic (equal bending stiffnesses,
        no natural curvature) rotations combined with a spin of all sections about the tangents: a
        bent isotropic rod may turn its plane of bending about the axis of its clamp.
        """
        fixed = self.held or any(s.kind == "clamped" for s in self.supports)
        if fixed and not self.isotropic:
            return np.zeros((0, self.size))
        return _neutral_rotations(self, state)

    @cached_property
    def isotropic(self) -> bool:
        """Whether a spin of all sections about the tangents changes no strain energy."""
        layout = self.layout
        if np.any(layout.plan.natural[:, :2]):
            return False
        n = layout.nodes.size
        rng = np.random.default_rng(7)
        strains = rng.normal(size=(3, n, 3)) / np.max(layout.plan.span)
        strains *= np.array([1e-3, 1e-2, 1e-1])[:, None, None]
        for k in strains:
            plain = layout.law.evaluate(k, 0)[0]
            for angle in (0.7, 1.9):
                c, s = math.cos(angle), math.sin(angle)
                turned = np.stack(
                    [c * k[:, 0] - s * k[:, 1], s * k[:, 0] + c * k[:, 1], k[:, 2]], 1
                )
                energy = layout.law.evaluate(np.ascontiguousarray(turned), 0)[0]
                if not np.allclose(energy, plain, rtol=1e-12, atol=0.0):
                    return False
        return True

    # ---- energy --------------------------------------------------------------------------------

    def strain_densities(self, state: RodState) -> Array:
        """Return the strain densities of the hinges, shape (n, 3), natural strains included."""
        plan = self.layout.plan
        q, strain = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(self.frames(state), plan, q, strain)
        if self.measure != "sine":
            measure_all(CODES[self.measure], q, strain)
        return strain / plan.span[:, None]

    def evaluate(self, state: RodState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`."""
        layout = self.layout
        plan = layout.plan
        count, n, m = self.lengths.size, plan.left.size, plan.rows.shape[0]
        if state.quaternions.shape[0] != count:
            raise InvalidInput(
                f"the state has {state.quaternions.shape[0]} segments; this rod has {count}"
            )
        frames = self.frames(state)
        q, strain = np.empty((n, 4)), np.empty((n, 3))
        _kernel.hinge_rotations(frames, plan, q, strain)
        other = self.measure != "sine"
        if other:
            measure_all(CODES[self.measure], q, strain)
        excess = np.empty((n, 3))
        _kernel.excess_densities(plan, strain, excess)
        first, second = order >= 1, order >= 2
        values: Array
        stress: Array
        stiffness: Array
        if layout.evaluate_into is not None:
            values = np.empty(n)
            stress = np.empty((n if first else 0, 3))
            stiffness = np.empty((n if second else 0, 3, 3))
            layout.evaluate_into(excess, values, stress, stiffness, order)
        else:
            given = layout.law.evaluate(excess, order)
            values = np.ascontiguousarray(given[0])
            stress = np.ascontiguousarray(given[1]) if first else np.empty((0, 3))
            stiffness = np.ascontiguousarray(given[2]) if second else np.empty((0, 3, 3))
        if other and first:
            share = plan.span[:, None, None]
            stress = stress.copy()  # the law keeps what it returned
            stiffness = stiffness / share if second else stiffness
            pull_back_all(CODES[self.measure], q, stress, stiffness, order)
            stiffness = stiffness * share if second else stiffness
        total = plan.length + layout.border
        gradient = np.empty(total if first else 0)
        band = np.empty((plan.length if second else 0, layout.width + 1))
        border = np.empty((plan.length if second else 0, layout.border))
        corner = np.empty((layout.border, layout.border))
        constraints = np.empty(m)
        energy = _kernel.assemble(
            frames, state.stretches, state.angles, q, values, stress, stiffness, plan, multipliers,
            gradient, band, border, corner, constraints, order,
        )  # fmt: skip
        if layout.net_force is not None:
            energy -= float(layout.net_force @ self._fixed_position(state))
        if order == 0:
            return Evaluation(energy, constraints)
        gradient = gradient[: total - m]
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        kkt = ChainKKT(band, border.T, corner, layout=layout.chain)
        return Evaluation(energy, constraints, gradient, kkt)

    def correct(self, state: RodState, multipliers: Array, tolerance: float) -> Corrected | None:
        """Return a nearby stationary point, by Newton's method with a shift and a short line search.

        None if a few steps do not lead to one; :func:`lissome.equilibrate` then descends with care.
        """
        return fast_correction(self, state, multipliers, tolerance)

    def present(self, equilibrium: Equilibrium) -> RodEquilibrium:
        """Return the equilibrium with positions, forces and moments."""
        return equilibrium.as_type(RodEquilibrium)

    @property
    def couples(self) -> list[tuple[int, Array, Array]]:
        """Segments, forces and arms (along the directors) of the couples."""
        return [(int(row[0]), row[1:4], row[4:7]) for row in self.layout.plan.arms]

    def _fixed_position(self, state: RodState) -> Array:
        """Return the point from which the potential of the forces is reckoned."""
        return np.array(
            [
                state.origin[k] if anchor is None else anchor[1]
                for k, anchor in enumerate(self.layout.anchors)
            ]
        )


def reach_supports(rod: Rod, state: RodState) -> RodState:
    """Return a state near `state` that meets the constraints, if one is found.

    Where hinges are far from their natural angles (a ring that is not closed yet, a clamp that has
    turned) the angles are evened out first. Then come Newton steps of least elastic work; where the
    rod is so straight that turning its segments does not bring its ends nearer, it is bent before.
    """
    layout = rod.layout
    plan = layout.plan
    m = plan.rows.shape[0]
    zero, none = np.zeros(m), np.zeros(rod.size)
    angle, _, _ = _evened(rod, state)
    if np.max(np.abs(angle)) > 0.5:
        state = _even_out(rod, state)
    if m == 0:
        return state
    violation = rod.evaluate(state, zero, 0).constraints
    bent = False
    for _ in range(60):
        size = float(np.linalg.norm(violation))
        if size <= 1e-9 * rod.length:
            break
        kkt = _unstressed(rod, state)
        rows = kkt.jacobian_rows() / np.sqrt(layout.metric)
        # A turn by dx (root mean square) moves the ends by about |rows| dx: is it enough?
        grip = np.linalg.svd(rows / math.sqrt(rod.length), compute_uv=False)[-1]
        if grip < 0.1 and not bent:
            bent = True
            middle = 0.5 * (rod.arclength[:-1] + rod.arclength[1:]) / rod.length
            bend = np.zeros(rod.size)
            columns = plan.column[: rod.lengths.size]
            free = columns >= 0
            share = math.sqrt(min(1.0, size / rod.length))
            bend[columns[free] + _softer(rod)] = share * np.sin(2.0 * math.pi * middle[free])
            state = rod.retract(state, bend * rod.max_step(state, bend))
            violation = rod.evaluate(state, zero, 0).constraints
            continue
        try:
            factor = kkt.factorize(1.0 / rod.length**2, None, layout.metric, 1e-4 * rod.length**3)
            step = factor.solve(none, -violation)[0]
        except FactorizationError:
            break
        fraction = min(rod.max_step(state, step), 0.7 / max(float(np.max(np.abs(step))), 0.7))
        while fraction > 1e-4:
            trial = rod.retract(state, fraction * step)
            left = rod.evaluate(trial, zero, 0).constraints
            if np.linalg.norm(left) < (1.0 - 0.1 * fraction) * size:
                break
            fraction *= 0.5
        else:
            break
        state, violation = trial, left
    return state


def _evened(rod: Rod, state: RodState) -> tuple[Array, Array, float]:
    """Return excess angles of the hinges, and gradient and value of their squares over lengths."""
    layout = rod.layout
    plan = layout.plan
    n = plan.left.size
    frames = rod.frames(state)
    q, angle = np.empty((n, 4)), np.empty((n, 3))
    _kernel.hinge_rotations(frames, plan, q, angle)
    measure_all(CODES["angle"], q, angle)
    angle -= layout.plan.natural * plan.span[:, None]
    stress = angle / plan.span[:, None]
    value = 0.5 * float(np.sum(stress * angle))
    pull_back_all(CODES["angle"], q, stress, np.zeros((0, 3, 3)), 1)
    gradient = np.empty(plan.length + layout.border)
    m = plan.rows.shape[0]
    _kernel.assemble(
        frames, state.stretches, state.angles, q, np.zeros(n), stress, np.zeros((0, 3, 3)),
        _without_loads(plan), np.zeros(m), gradient, np.empty((0, layout.width + 1)),
        np.empty((0, layout.border)), np.empty((layout.border, layout.border)), np.empty(m), 1,
    )  # fmt: skip
    return angle, gradient[: rod.size], value


def _even_out(rod: Rod, state: RodState) -> RodState:
    """Return a state with hinges nearer to their natural angles, by Gauss and Newton's method.

    Constraints count as springs.
    """
    zero = np.zeros(rod.constraints_count)
    soft = 1e-3 * rod.length**3

    def merit(state: RodState) -> tuple[float, Array, Array]:
        violation = rod.evaluate(state, zero, 0).constraints
        _, gradient, value = _evened(rod, state)
        return value + 0.5 * float(violation @ violation) / soft, gradient, violation

    value, gradient, violation = merit(state)
    for _ in range(40):
        try:
            factor = _unstressed(rod, state).factorize(
                0.1 / rod.length**2, None, rod.layout.metric, soft
            )
            step = factor.solve(-gradient, -violation)[0]
        except FactorizationError:
            break
        fraction = min(rod.max_step(state, step), 0.7 / max(float(np.max(np.abs(step))), 0.7))
        while fraction > 1e-3:
            trial = rod.retract(state, fraction * step)
            new = merit(trial)
            if new[0] < value:
                break
            fraction *= 0.5
        else:
            break
        done = new[0] > 0.99 * value
        state, (value, gradient, violation) = trial, new
        if done:
            break
    return state


def _without_loads(plan: _kernel.Plan) -> _kernel.Plan:
    return plan._replace(
        dead=np.zeros_like(plan.dead), moments=np.zeros_like(plan.moments), arms=np.zeros((0, 7))
    )


def _softer(rod: Rod) -> int:
    """Return the director about which the rod bends more easily: 0 or 1."""
    layout = rod.layout
    stiffness = layout.law.evaluate(np.zeros((layout.nodes.size, 3)), 2)[2]
    return int(np.argmin(np.mean(stiffness[:, [0, 1], [0, 1]], axis=0)))


def _unstressed(rod: Rod, state: RodState) -> ChainKKT:
    """Return the KKT matrix of hinges without stress, of unit stiffness."""
    layout = rod.layout
    plan = layout.plan
    n = plan.left.size
    stiffness = np.ascontiguousarray(np.broadcast_to(np.eye(3), (n, 3, 3)))
    m = plan.rows.shape[0]
    frames = rod.frames(state)
    q, kappa = np.empty((n, 4)), np.empty((n, 3))
    _kernel.hinge_rotations(frames, plan, q, kappa)
    band = np.empty((plan.length, layout.width + 1))
    border = np.empty((plan.length, layout.border))
    corner = np.empty((layout.border, layout.border))
    _kernel.assemble(
        frames, state.stretches, state.angles, q, np.zeros(n), np.zeros((n, 3)), stiffness,
        _without_loads(plan), np.zeros(m), np.empty(plan.length + layout.border), band, border,
        corner, np.empty(m), 2,
    )  # fmt: skip
    return ChainKKT(band, border.T, corner, layout=layout.chain)


def _rotation_of(density: Array, spans: Array, measure: str) -> Array:
    """Return the rotations (quaternions) of hinges at given strain densities."""
    try:
        return rotation_from_strain(density * spans[:, None], measure)
    except InvalidInput as error:
        raise InvalidInput(
            f"argument `natural` cannot be reached at a hinge of length {float(spans.max()):.3g}: "
            f"{error}; use more segments"
        ) from error


def internal_forces(rod: Rod, multipliers: Array) -> Array:
    """Return the internal force on each segment, shape (N, 3): of what lies beyond on what is before."""
    layout = rod.layout
    forces = np.array(layout.plan.dead)
    plan = layout.plan
    for value, (k, first, last) in zip(multipliers, plan.rows, strict=True):
        if k < 3:
            forces[first:last, k] -= value
        else:
            forces -= value * plan.phase[:, None] * plan.normal
    return forces


def _neutral_rotations(rod: Rod, state: RodState) -> Array:
    """Return rotations (and spins of the sections) that change neither energy nor constraints.

    A motion is (omega, spin): it turns everything by omega in space, and every section by -spin about
    its d3. Segment j then turns by R_j^T omega - spin e3 in its own directors.
    """
    layout = rod.layout
    plan = layout.plan
    conditions: list[Array] = []

    def turns(rows: Array) -> None:
        for row in np.atleast_2d(rows):
            conditions.append(np.append(row, 0.0))

    spin = np.array([0.0, 0.0, 0.0, 1.0])
    if not rod.isotropic:
        conditions.append(spin)
    loads = np.unique(layout.plan.dead, axis=0)
    for force in loads[np.any(loads != 0.0, axis=1)]:
        turns(_cross_matrix(force / np.linalg.norm(force)))
    places = rod.positions(state)
    for node, (k, _, _) in zip(layout.row_nodes, plan.rows, strict=True):
        if node < 0:
            continue  # closure: a rotation leaves it
        anchor = layout.anchors[k]
        assert anchor is not None
        arm = places[node] - places[anchor[0]]
        size = float(np.linalg.norm(arm))
        if size <= REACH * rod.length:
            continue
        unit = np.eye(3)[k]
        row = np.cross(arm / size, unit)
        if np.linalg.norm(row) > 1e-9:
            turns(row)
        else:  # the component is at its extreme: every turn of the arm counts
            turns(_cross_matrix(unit))
    for j, force, arm in rod.couples:
        # Other turns than those about the force are neutral to first order at best.
        turns(_cross_matrix(force / np.linalg.norm(force)))
        turned = rotate(state.quaternions[j], arm)
        row = np.cross(turned, force)
        if np.linalg.norm(row) > 0.0:
            turns(row / np.linalg.norm(row))
        if np.any(arm[:2]):
            conditions.append(spin)
    frames = rod.frames(state)
    held = [0] if rod.held else []
    for f in [*held, *layout.segment_of, *range(rod.lengths.size, frames.shape[0])]:
        body = np.column_stack([to_matrix(frames[f]).T, [0.0, 0.0, -1.0]])
        if plan.turning[f]:
            axis = plan.axis[f]
            k = int(plan.column[f]) - plan.first_angle
            if not layout.plan.moments[k]:
                body = (np.eye(3) - np.outer(axis, axis)) @ body
        conditions.extend(body)
    basis = np.eye(4)
    if conditions:
        _, sizes, vectors = np.linalg.svd(np.array(conditions))
        basis = vectors[int(np.count_nonzero(sizes > 1e-7)) :]
    rows = np.zeros((basis.shape[0], rod.size))
    if not basis.size:
        return rows
    columns = plan.column[: rod.lengths.size]
    free = columns >= 0
    matrices = to_matrix(state.quaternions)
    for row, motion in zip(rows, basis, strict=True):
        body = np.einsum("jab,a->jb", matrices, motion[:3])
        body[:, 2] -= motion[3]
        row[columns[free][:, None] + np.arange(3)] = body[free]
        for i, k in enumerate(layout.hinged):
            f = rod.lengths.size + int(k)
            turn = to_matrix(frames[f]).T @ motion[:3]
            turn[2] -= motion[3]
            row[plan.first_angle + i] = float(plan.axis[f] @ turn)
    if not rod.isotropic:
        return rows
    # A straight rod that turns and spins back about its axis does not move at all.
    root = np.sqrt(layout.metric / rod.length)
    turn, sizes, _ = np.linalg.svd(rows * root, full_matrices=False)
    return turn.T[sizes > 1e-6] @ rows


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _derive(rod: Rod) -> _Layout:
    """Derive the layout of a rod, and refuse what has no equilibrium."""
    lengths, count = rod.lengths, rod.lengths.size
    by_node = {s.node: s for s in rod.supports}
    frames = [s for s in rod.supports if s.frame is not None]
    index = {s.node: count + i for i, s in enumerate(frames)}
    fixed = np.array([s.frame for s in frames]).reshape(-1, 4)
    hinged = np.array([i for i, s in enumerate(frames) if s.kind == "hinged"], dtype=np.int64)

    # hinges: (left, right, length, node, arc length)
    s_nodes = rod.arclength
    hinges: list[tuple[int, int, float, int]] = []
    simple = np.ones(count + 1, dtype=bool)
    segment_of: dict[int, int] = {}
    for node, support in by_node.items():
        if support.frame is not None:
            simple[node] = False
            if support.clamp == "two-node":
                segment_of[0 if node == 0 else count - 1] = index[node] - count
    simple[0] = simple[count] = False
    inner = np.flatnonzero(simple)
    table = [
        np.stack([inner - 1, inner], axis=1),
        0.5 * (lengths[inner - 1] + lengths[inner]),
        inner,
    ]
    for node, support in by_node.items():
        if support.frame is None or support.clamp == "two-node":
            continue
        f = index[node]
        before, after = node - 1, node
        if rod.closed:
            before = (node - 1) % count
        if before >= 0:
            hinges.append((before, f, 0.5 * lengths[before], node))
        if after < count:
            hinges.append((f, after, 0.5 * lengths[after], node))
    joint_supported = rod.closed and 0 in by_node and by_node[0].frame is not None
    if rod.closed and not joint_supported:
        hinges.append((count - 1, 0, 0.5 * (lengths[-1] + lengths[0]), 0))
    pairs = np.concatenate(
        [table[0], np.array([h[:2] for h in hinges], dtype=np.int64).reshape(-1, 2)]
    )
    span = np.concatenate([table[1], [h[2] for h in hinges]])
    nodes = np.concatenate([table[2], np.array([h[3] for h in hinges], dtype=np.int64)])
    order = np.lexsort((np.where(pairs[:, 0] < count, 0, 1), nodes))
    if rod.closed:  # the joint comes last
        order = np.concatenate([order[nodes[order] != 0], order[nodes[order] == 0]])
    pairs, span, nodes = pairs[order], span[order], nodes[order].astype(np.int64)
    twist = np.zeros((span.size, 2))
    twist[:, 0] = 1.0
    if rod.closed:
        half = 0.5 * rod.joint
        at_joint = pairs[:, 1] == 0
        twist[at_joint] = math.cos(half), math.sin(half)

    # unknowns
    prescribed = set(segment_of)
    if rod.held:
        prescribed.add(0)
    in_border = rod.closed and 0 not in prescribed
    extensible = rod.stretching is not None
    per = 4 if extensible else 3
    column = np.full(count + len(frames), -1, dtype=np.int64)
    stretch = np.full(count, -1, dtype=np.int64)
    chain = [j for j in range(count) if j not in prescribed and not (in_border and j == 0)]
    chain_array = np.array(chain, dtype=np.int64)
    column[chain_array] = per * np.arange(chain_array.size)
    length = per * chain_array.size
    if extensible:
        stretch[chain_array] = column[chain_array] + 3
    if length == 0:
        raise InvalidInput("the supports leave no segment free; use more segments")
    place = length
    if in_border:
        column[0] = place
        place += 3
        if extensible:
            stretch[0] = place
            place += 1
    elif rod.held and extensible:
        stretch[0] = place
        place += 1
    first_angle = place
    axis = np.zeros((column.size, 3))
    turning = np.zeros(column.size, dtype=np.int64)
    axes, moments = np.zeros((hinged.size, 3)), np.zeros(hinged.size)
    for i, k in enumerate(hinged):
        support = frames[k]
        assert support.axis is not None
        assert support.frame is not None
        f = count + int(k)
        column[f] = place
        place += 1
        turning[f] = 1
        axes[i], moments[i] = support.axis, support.moment
        axis[f] = rotate(conjugate(support.frame), support.axis)

    # positions
    rows: list[tuple[int, int, int]] = []
    targets: list[float] = []
    row_nodes: list[int] = []
    anchors: list[tuple[int, float] | None] = []
    if rod.closed:
        for k in range(3):
            rows.append((k, 0, count))
            targets.append(0.0)
            row_nodes.append(-1)
    for k in range(3):
        anchor: tuple[int, float] | None = None
        for support in rod.supports:
            value = support.position[k]
            if value is None:
                continue
            if anchor is None:
                anchor = (support.node, value)
            else:
                rows.append((k, anchor[0], support.node))
                targets.append(value - anchor[1])
                row_nodes.append(support.node)
        anchors.append(anchor)
    _check_reach(rod)
    weights, normal = np.zeros(count), np.zeros(3)
    if rod.pinned_phase is not None:
        rows.append((3, 0, count))
        targets.append(0.0)
        row_nodes.append(-1)
        middle = 0.5 * (s_nodes[:-1] + s_nodes[1:])
        weights = np.sin(2.0 * math.pi * rod.pinned_phase * (middle - middle[0]) / rod.length)
        normal = _phase_normal(rod)

    # loads
    forces = rod.loads.forces(lengths, rod.closed)
    dead = _dead_forces(rod, forces, anchors)
    arms = np.array(
        [[j, *f, *a] for j, (f, a) in rod.loads.couples.items() if np.any(f) and np.any(a)]
    ).reshape(-1, 7)
    m = len(rows)
    law = rod.law.at(nodes) if getattr(rod.law, "count", None) is not None else rod.law
    compiled = getattr(law, "kernel", None) is not None
    plan = _kernel.Plan(
        left=np.ascontiguousarray(pairs[:, 0]),
        right=np.ascontiguousarray(pairs[:, 1]),
        span=span,
        twist=twist,
        column=column,
        axis=axis,
        turning=turning,
        lengths=lengths,
        rows=np.array(rows, dtype=np.int64).reshape(-1, 3),
        phase=weights,
        normal=normal,
        stretch_column=stretch,
        arms=arms,
        natural=np.ascontiguousarray(rod.natural[nodes]),
        dead=dead,
        targets=np.array(targets),
        moments=moments,
        length=length,
        first_angle=first_angle,
        stiffness=-1.0 if rod.stretching is None else float(rod.stretching),
    )
    border = place - length + m
    metric = np.empty(place)
    columns = column[:count]
    free = columns >= 0
    metric[columns[free][:, None] + np.arange(3)] = lengths[free][:, None]
    metric[stretch[stretch >= 0]] = lengths[stretch >= 0]
    for i, k in enumerate(hinged):
        near = span[(pairs[:, 0] == count + k) | (pairs[:, 1] == count + k)]
        metric[first_angle + i] = float(np.sum(near))
    return _Layout(
        plan=plan,
        nodes=nodes,
        arclength=s_nodes[nodes],
        law=law,
        fixed=fixed,
        hinged=hinged,
        turning_axes=axes,
        anchors=tuple(anchors),
        row_nodes=np.array(row_nodes, dtype=np.int64),
        evaluate_into=law.evaluate_into if compiled else None,
        net_force=np.sum(forces, axis=0) if np.any(np.sum(forces, axis=0)) else None,
        node_forces=forces,
        chain=ChainLayout(length, np.arange(place), np.arange(place, place + m), border),
        width=2 * per - 1 if not extensible else 6,
        border=border,
        metric=_frozen(metric),
        segment_of=segment_of,
    )


def _phase_normal(rod: Rod) -> Array:
    """Return a direction across the first segment: off the plane of a plane ring, or along d1."""
    try:
        return rod._plane_normal()
    except InvalidInput:
        return rotate(rod.initial.quaternions[0], [1.0, 0.0, 0.0])


def _dead_forces(rod: Rod, forces: Array, anchors: list[tuple[int, float] | None]) -> Array:
    """Return for each segment the sum of the dead forces beyond it, or minus those before it."""
    count = rod.lengths.size
    total = np.sum(forces, axis=0)
    size = np.sum(np.abs(forces), axis=0)
    dead = np.empty((count, 3))
    for k in range(3):
        anchor = anchors[k]
        if anchor is None and abs(total[k]) > 1e-12 * size[k]:
            raise InvalidInput(
                f"the dead loads add up to a force of {total[k]:.6g} along {'xyz'[k]}, and nothing "
                "holds the rod in this direction; pin or clamp a node, or balance the loads"
            )
        node = 0 if anchor is None else anchor[0]
        before = np.cumsum(forces[:-1, k])
        beyond = np.cumsum(forces[:0:-1, k])[::-1]
        dead[:, k] = np.where(np.arange(count) >= node, beyond, -before)
    return dead


def _check_reach(rod: Rod) -> None:
    """Refuse supports farther from each other than an inextensible rod is long."""
    if rod.stretching is not None:
        return
    for i, a in enumerate(rod.supports):
        for b in rod.supports[:i]:
            square = 0.0
            full = True
            for u, v in zip(a.position, b.position, strict=True):
                if u is None or v is None:
                    full = False
                else:
                    square += (u - v) ** 2
            distance = math.sqrt(square)
            reach = float(rod.arclength[a.node] - rod.arclength[b.node])
            if rod.closed:
                reach = min(reach, rod.length - reach)
            if distance > reach * (1.0 + REACH):
                raise InvalidInput(
                    f"the supports of nodes {b.node} and {a.node} are {distance:.9g} apart, and the "
                    f"rod between them is {reach:.9g} long: it is inextensible; bring them nearer, or "
                    "give it a `stretching` stiffness"
                )
            if full and distance > reach * (1.0 - REACH):
                raise InvalidInput(
                    f"the supports of nodes {b.node} and {a.node} are {distance:.9g} apart, just as "
                    "long as the rod between them: it is inextensible, and its tension would be "
                    "undetermined; bring them nearer, leave a component of the position free, or "
                    "give it a `stretching` stiffness"
                )
