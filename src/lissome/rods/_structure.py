"""Rods as structures: states, supports, loads, and what the solvers of the core ask for."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._readonly import recalled
from .._telling import is_news, user_level
from .._validate import finite, finite_array, integer_at_least, moderate, one_of, positive
from ..equilibrium import Equilibrium
from ..errors import InvalidInput, LissomeWarning
from ..factorization import ChainKKT
from ..structure import EPS, BaseStructure, Corrected, Evaluation
from . import _kernel, topology
from ._cells import add_coupling, couple
from ._corrector import fast_correction
from ._equilibrium import RodEquilibrium
from ._layout import Layout, derive, plane_normal
from ._neutral import neutral_rotations
from ._starts import reach_supports
from .laws import ROD_STRAINS
from .loads import Distributed, Loads
from .measures import CODES, MEASURES, measure_all, pull_back_all, rotation_from_strain
from .quaternions import conjugate, exponential, logarithm, multiply, rotate
from .supports import Support, as_direction, as_frame, as_position

__all__ = ["Rod", "RodState"]

Array = NDArray[np.float64]
KEEP: Any = object()
#: A hinge that turns farther (radians) is too far from a piece of a smooth rod.
SHARP = 150.0 * math.pi / 180.0
#: Stretch of a segment that is lost: no equilibrium passes through it.
VANISHED = 1e-3


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
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

    Raises
    ------
    InvalidInput
        If a shape is wrong, a quaternion has not unit length, or a stretch is not positive.

    Examples
    --------
    Frames turn the third axis into the tangent: a quarter turn about the second one points along e1.

    >>> import numpy as np
    >>> from lissome import rods
    >>> half = np.sqrt(0.5)
    >>> corner = rods.RodState([[1.0, 0.0, 0.0, 0.0], [half, 0.0, half, 0.0]])
    >>> rod = rods.straight(length=2.0, segments=2, law=rods.Kirchhoff(1.0, 1.0))
    >>> print(rod.positions(corner).round(9) + 0.0)
    [[0. 0. 0.]
     [0. 0. 1.]
     [1. 0. 1.]]
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
    """Make a state of arrays that are known to be right, and that nobody changes."""
    for array in (quaternions, origin, stretches, angles, supports):
        array.flags.writeable = False
    state = object.__new__(RodState)
    vars(state).update(
        quaternions=quaternions,
        origin=origin,
        stretches=stretches,
        angles=angles,
        supports=supports,
    )
    return state


_NEXT, _AFTER = np.array([2, 3, 1]), np.array([3, 1, 2])  # of the components of a vector part


def _turns(a: Array, b: Array) -> Array:
    """Return the rotation vectors, shape (k, 3), from frames `a` to frames `b` of states."""
    s, v, t, w = a[:, :1], a[:, 1:], b[:, :1], b[:, 1:]
    scalar = np.einsum("ij,ij->i", a, b)[:, None]
    vector = s * w - t * v
    vector -= a.take(_NEXT, axis=1) * b.take(_AFTER, axis=1)
    vector += a.take(_AFTER, axis=1) * b.take(_NEXT, axis=1)
    size = np.sqrt(np.einsum("ij,ij->i", vector, vector))[:, None]
    angle = np.arctan2(size, np.abs(scalar))
    factor = np.divide(2.0 * angle, size, out=np.full_like(size, 2.0), where=size > 0.0)
    return np.asarray(np.copysign(factor, scalar) * vector)


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
        Energy per unit length as a function of the strain densities curvature_1, curvature_2, twist
        and, if it has four strains, of the stretch.
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
        length is e times its rest length (4.17). None (default): inextensible, unless the law has a
        fourth strain, the stretch :math:`(e^2 - 1)/2`: then it says how stiff the rod is.
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

    Examples
    --------
    A column that is clamped at its foot gives way sideways above Euler's load :math:`\pi^2/4`:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome import rods
    >>> column = rods.straight(length=1.0, segments=40, law=rods.Kirchhoff((1.0, 4.0), 1.0))
    >>> column = column.clamped("start")
    >>> for load in (0.99, 1.02):
    ...     pressed = column.loaded(end=(0.0, 0.0, -load * np.pi**2 / 4))
    ...     tip = ls.equilibrate(pressed).positions[-1]
    ...     print(np.hypot(tip[0], tip[1]) > 0.1, tip[2] < 0.999)
    False False
    True True
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
        lengths = moderate("lengths", finite_array("lengths", self.lengths, (None,)))
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
        natural = moderate("natural", finite_array("natural", natural, (count + 1, 3)))
        _check_law(self.law, count)
        object.__setattr__(self, "lengths", _frozen(lengths))
        object.__setattr__(self, "natural", _frozen(natural))
        object.__setattr__(self, "joint", finite("joint", self.joint))
        if self.joint and not self.closed:
            raise InvalidInput(f"argument `joint` is {self.joint:g}; only a closed rod has a joint")
        if self.stretching is not None:
            object.__setattr__(self, "stretching", positive("stretching", self.stretching))
            _check_stretching(self.law, self.stretching)
        one_of("measure", self.measure, MEASURES)
        if self.phase is not None:
            object.__setattr__(self, "phase", integer_at_least("phase", self.phase, 2))
        initial = self._natural_shape() if self.initial is None else self.initial
        check_state("initial", initial, count)
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

    def _with(self, **changes: Any) -> Rod:
        """Return this rod with fields, but not its lengths, changed to values that have been checked."""
        new = object.__new__(Rod)
        own = vars(self)
        vars(new).update(
            {name: own[name] for name in _FIELDS},
            _shared=self._shared,
            length=self.length,
            arclength=self.arclength,
            **changes,
        )
        return new

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs: all but what other rods share."""
        return {name: value for name, value in vars(self).items() if name != "_shared"}

    @cached_property
    def _shared(self) -> dict[str, Any]:
        """What was derived last for this rod or one made from it, with what it was derived from."""
        return {}

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
        return self._with(supports=ordered)

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
        self, where: str | int, position: Any = None, frame: Any = None, clamp: str = "node"
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
        clamp : {"node", "segment"}
            What has the frame. "node": the node, which holds the adjacent segments through hinges of
            half their lengths; second order. "segment" (ends only; that of the thesis): the adjacent
            segment itself, so that two nodes are fixed; first order.

        Raises
        ------
        InvalidInput
            If the node does not exist or a frame is not orthonormal.
        """
        node = self._node(where)
        one_of("clamp", clamp, ("node", "segment"))
        if clamp == "segment" and (self.closed or 0 < node < self.lengths.size):
            raise InvalidInput(
                "argument `clamp` is 'segment'; only the ends of a rod have such clamps"
            )
        place = self._position_at_rest(node) if position is None else as_position(position)
        if frame is not None:
            quaternion = as_frame(frame)
        elif clamp == "node":
            quaternion = self._frame_at_rest(node)
        else:
            quaternion = self.initial.quaternions[0 if node == 0 else -1].copy()
        return self._supported(Support(node, "clamped", place, _frozen(quaternion), clamp))

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

        Raises
        ------
        InvalidInput
            If there is no such node, or a value is not of the right kind.
        """
        node = self._node(where)
        place = self._position_at_rest(node) if position is None else as_position(position)
        quaternion = self._frame_at_rest(node) if frame is None else as_frame(frame)
        direction = as_direction("axis", axis)
        return self._supported(
            Support(
                node, "hinged", place, _frozen(quaternion), "node", _frozen(direction),
                finite("moment", moment),
            )
        )  # fmt: skip

    def freed(self, where: str | int) -> Rod:
        """Return this rod without the support of the node `where`."""
        node = self._node(where)
        return self._with(supports=tuple(s for s in self.supports if s.node != node))

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
            end segment, measured from the node. The frame of a segment is that in its middle, so that
            the couple of such a force is of first order in the mesh (that of :meth:`hinged` of second).
        couples : mapping of "start", "end" or int to (force, arm), optional
            For segments: a force that acts at the end of an arm fixed to the segment (components
            along the directors), and the opposite force at its foot.

        Raises
        ------
        InvalidInput
            If a force has a wrong shape, or a node or segment does not exist.
        """
        count = self.lengths.size
        points, pairs = dict(self.loads.points), dict(self.loads.couples)
        lever = None if arm is None else _frozen(finite_array("arm", arm, (3,)))
        if lever is not None and start is None and end is None:
            raise InvalidInput("argument `arm` is given without `start` or `end`; name the force")
        for name, value, segment in (("start", start, 0), ("end", end, count - 1)):
            if value is None:
                continue
            force = _frozen(moderate(name, finite_array(name, value, (3,))))
            points[self._node(name)] = force
            pairs.pop(segment, None)
            if lever is not None:
                pairs[segment] = (force, lever)
        for name, mapping in (("nodes", nodes), ("couples", couples)):
            if mapping is not None and not isinstance(mapping, Mapping):
                raise InvalidInput(
                    f"argument `{name}` is of type {type(mapping).__name__}; pass a mapping, such as "
                    "{3: ...}"
                )
        for key, value in (nodes or {}).items():
            name = f"nodes[{key}]"
            points[self._node(key)] = _frozen(moderate(name, finite_array(name, value, (3,))))
        for where, pair in (couples or {}).items():
            if isinstance(where, str):
                j = 0 if self._node(where) == 0 else count - 1
            elif (
                isinstance(where, (int, np.integer))
                and not isinstance(where, bool)
                and 0 <= where < count
            ):
                j = int(where)
            else:
                raise InvalidInput(
                    f"argument `couples` names segment {where!r}; they are numbered 0 to {count - 1}"
                )
            if not isinstance(pair, (tuple, list, np.ndarray)) or len(pair) != 2:
                raise InvalidInput(
                    f"argument `couples[{where!r}]` is {pair!r}; pass a force and an arm"
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
        return self._with(loads=Loads(points, density, pairs))

    # ---- other changes -------------------------------------------------------------------------

    def with_law(self, law: Any) -> Rod:
        """Return this rod of another material, `law`."""
        _check_law(law, self.lengths.size)
        if self.stretching is not None:
            _check_stretching(law, self.stretching)
        return self._with(law=law)

    def with_natural(
        self, *, curvature_1: Any = None, curvature_2: Any = None, twist: Any = None
    ) -> Rod:
        """Return this rod with other natural strains.

        Parameters
        ----------
        curvature_1, curvature_2, twist : float or array_like, shape (N + 1,), optional
            Natural strain densities (1/length) about d1, d2 and d3, uniform or at the nodes. Those that
            are left out stay as they are.

        Raises
        ------
        InvalidInput
            If an array does not hold one number for each node.
        """
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
        return self._with(natural=_frozen(natural))

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
        body = recalled(
            self._shared,
            "body normal",
            (self.initial,),
            lambda: rotate(conjugate(self.initial.quaternions), plane_normal(self)),
        )
        if np.max(np.abs(body - body[0])) > 1e-6:
            raise InvalidInput(
                "the initial state is twisted: the normal of the plane of the ring is not along one "
                "material direction; pass natural curvatures with `with_natural`"
            )
        curvature = 2.0 * math.pi * value / self.length * body[0]
        curvature[np.abs(curvature) < 1e-14 * abs(value) * math.pi / self.length] = 0.0
        natural = np.tile(curvature, (self.lengths.size + 1, 1))
        return self._with(natural=_frozen(natural))

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

        Raises
        ------
        InvalidInput
            If `lobes` is not positive, or the rod is not closed.
        """
        if lobes is not None:
            lobes = integer_at_least("lobes", lobes, 2)
        return self._with(phase=lobes)

    def with_initial(self, state: RodState) -> Rod:
        """Return this rod with another starting `state`. Supports stay where they are."""
        return self._with(initial=check_state("state", state, self.lengths.size))

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
        """Return the positions of the nodes in `state`, shape (N + 1, 3)."""
        out = np.empty((self.lengths.size + 1, 3))
        _kernel.positions(
            np.array(state.quaternions), np.array(state.stretches), np.array(self.lengths), out
        )
        return out + state.origin

    @property
    def held(self) -> bool:
        """Whether the first segment is held, to remove the rigid motions of a free closed rod."""
        return self.closed and not self.supports and self.loads.empty

    @property
    def _stretch_in_law(self) -> bool:
        """Whether the stretch is a strain of the law."""
        return len(self.law.strains) == 4

    @property
    def extensible(self) -> bool:
        """Whether segments change their length."""
        return self.stretching is not None or self._stretch_in_law

    @cached_property
    def pins_phase(self) -> bool:
        """Whether the place of the lobes of a closed rod is pinned; see :meth:`with_phase`."""
        if self.phase is None or not self.held or getattr(self.law, "count", None) is not None:
            return False
        natural = self.natural
        uniform = bool(np.ptp(self.lengths) <= 1e-12 * self.lengths[0]) and (
            bool(np.all(natural == natural[0]))
            or bool(np.all(np.ptp(natural, axis=0) <= 1e-12 * np.max(np.abs(natural))))
        )
        return uniform and self.lengths.size > 2 * self.phase

    # ---- the derived layout --------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """What the kernels need, derived once."""
        return derive(self)

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
                out.append(f"phase of {self.phase} lobes")
                continue
            axis = "xyz"[int(row[0])]
            out.append(f"closure along {axis}" if node < 0 else f"{axis} of node {int(node)}")
        return tuple(out)

    # ---- the manifold --------------------------------------------------------------------------

    def start(self) -> RodState:
        """Return the initial state, bent as smoothly as can be so that it meets its supports."""
        return reach_supports(self, self.adopt(self._turned_halfway()))

    def _turned_halfway(self) -> RodState:
        """Return the initial state; if a clamp is nearly half a turn from it, with frames at rest.

        The axis of half a turn is round-off: :meth:`adopt` then spreads the turn over the rod, where
        evening out the hinges could not tell which way to go.
        """
        given = [s for s in self.supports if s.frame is not None]
        if not given or self.initial.supports.size:
            return self.initial
        rest = np.array(
            [
                self._frame_at_rest(s.node)
                if s.clamp == "node"
                else self.initial.quaternions[0 if s.node == 0 else -1]
                for s in given
            ]
        )
        turns = logarithm(multiply(self.layout.fixed, conjugate(rest)))
        if np.max(np.sum(turns**2, axis=1)) < 3.0**2:
            return self.initial
        rest /= np.sqrt(np.sum(rest**2, axis=1))[:, None]
        return replace(self.initial, supports=rest)

    def adopt(self, state: RodState) -> RodState:
        """Return `state` with prescribed values imposed.

        Where prescribed frames have turned since the state was made, the turn is spread over the
        rod between them, linearly in arc length.
        """
        check_state("start", state, self.lengths.size)
        layout = self.layout
        quaternions = state.quaternions
        now = layout.fixed
        hinges = layout.hinged.size
        angles = state.angles if state.angles.size == hinges else np.zeros(hinges)
        moved = (
            state.supports is not now
            and state.supports.shape == now.shape
            and not np.array_equal(state.supports, now)
        )
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
        if not self.extensible:
            stretches = layout.skeleton.ones
        elif layout.segment_of:
            stretches = np.where(layout.plan.stretch_column < 0, 1.0, stretches)
        origin = self._origin(quaternions, stretches, state.origin)
        return _state(quaternions, origin, stretches, angles, now)

    def _origin(self, quaternions: Array, stretches: Array, old: Array) -> Array:
        """Return the position of node 0, from `old`, that puts anchored nodes where they belong."""
        if self.layout.origin is not None:
            return self.layout.origin
        origin = np.array(old)
        anchors = self.layout.anchors
        places = np.zeros((1, 3))
        if any(a is not None and a[0] for a in anchors):
            places = np.empty((self.lengths.size + 1, 3))
            _kernel.positions(
                np.array(quaternions), np.array(stretches), np.array(self.lengths), places
            )
        for k, anchor in enumerate(anchors):
            if anchor is not None:
                origin[k] = anchor[1] - places[anchor[0], k]
        return origin

    def _frames(self, state: RodState) -> Array:
        """Return the frames of segments and supports in `state`, shape (K, 4): quaternions, scalar first."""
        layout = self.layout
        if not layout.fixed.shape[0]:
            return np.array(state.quaternions)
        fixed = layout.fixed
        if layout.hinged.size:
            fixed = np.array(fixed)
            turns = exponential(state.angles[:, None] * layout.turning_axes)
            fixed[layout.hinged] = multiply(turns, fixed[layout.hinged])
        return np.concatenate([state.quaternions, fixed])

    def retract(self, state: RodState, dx: Array) -> RodState:
        """Return the state after the body increments `dx`."""
        plan = self.layout.plan
        frames = self._frames(state)
        new, stretches = np.empty_like(frames), np.empty_like(state.stretches)
        angles = np.array(state.angles)
        dx = np.array(dx, dtype=float)
        _kernel.retract(
            frames, np.array(state.stretches), np.array(state.angles), dx, plan.column, plan.turning,
            plan.axis, plan.stretch_column, plan.first_angle, new, stretches, angles,
        )  # fmt: skip
        quaternions = new[: self.lengths.size]
        origin = self._origin(quaternions, stretches, state.origin)
        return _state(quaternions, origin, stretches, angles, state.supports)

    def difference(self, a: RodState, b: RodState) -> Array:
        """Return the body increments that lead from `a` to `b`."""
        skeleton, plan = self.layout.skeleton, self.layout.plan
        dx = np.zeros(self.size)
        free = skeleton.moving
        before, after = a.quaternions, b.quaternions
        if free.size < self.lengths.size:
            before, after = before[free], after[free]
        dx[skeleton.turns] = _turns(before, after)
        if self.extensible:
            stretch = plan.stretch_column >= 0
            dx[plan.stretch_column[stretch]] = (b.stretches - a.stretches)[stretch]
        if b.angles.size:
            dx[plan.first_angle : plan.first_angle + b.angles.size] = b.angles - a.angles
        return dx

    def max_step(self, state: RodState, dx: Array) -> float:
        """Return the fraction of `dx` at which no hinge turns past pi and no segment vanishes."""
        plan = self.layout.plan
        q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(self._frames(state), plan.left, plan.right, plan.twist, q, kappa)
        dx = np.array(dx, dtype=float)
        return float(
            _kernel.largest_step(
                np.array(state.stretches), q, dx, plan.left, plan.right, plan.twist, plan.column,
                plan.turning, plan.axis, plan.stretch_column,
            )
        )  # fmt: skip

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
        return neutral_rotations(self, state)

    @cached_property
    def isotropic(self) -> bool:
        """Whether a spin of all sections about the tangents changes no strain energy."""
        sources = (self.law, self.natural, self.layout.skeleton)
        return recalled(self._shared, "isotropic", sources, self._is_isotropic)

    def _is_isotropic(self) -> bool:
        layout = self.layout
        if np.any(layout.plan.natural[:, :2]):
            return False
        n = layout.nodes.size
        rng = np.random.default_rng(7)
        strains = rng.normal(size=(3, n, len(layout.law.strains)))
        strains[:, :, :3] /= np.max(layout.plan.span)
        strains *= np.array([1e-3, 1e-2, 1e-1])[:, None, None]
        for k in strains:
            plain = layout.law.evaluate(k, 0)[0]
            for angle in (0.7, 1.9):
                c, s = math.cos(angle), math.sin(angle)
                turned = np.stack(
                    [c * k[:, 0] - s * k[:, 1], s * k[:, 0] + c * k[:, 1], k[:, 2]], 1
                )
                turned = np.column_stack([turned, k[:, 3:]])
                energy = layout.law.evaluate(turned, 0)[0]
                if not np.allclose(energy, plain, rtol=1e-12, atol=0.0):
                    return False
        return True

    # ---- energy --------------------------------------------------------------------------------

    def strains(self, state: RodState) -> Array:
        """Return the strain densities of the hinges in `state`, shape (n, 3), natural strains included."""
        plan = self.layout.plan
        q, strain = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(self._frames(state), plan.left, plan.right, plan.twist, q, strain)
        if self.measure != "sine":
            measure_all(CODES[self.measure], q, strain)
        return strain / plan.span[:, None]

    def evaluate(self, state: RodState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`.

        Raises
        ------
        InvalidInput
            If `state` has another number of segments.
        """
        layout = self.layout
        plan = layout.plan
        count, n, m = self.lengths.size, plan.left.size, plan.rows.shape[0]
        if state.quaternions.shape[0] != count:
            raise InvalidInput(
                f"the state has {state.quaternions.shape[0]} segments; this rod has {count}"
            )
        frames = self._frames(state)
        q, strain = np.empty((n, 4)), np.empty((n, 3))
        _kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, strain)
        other = self.measure != "sine"
        if other:
            measure_all(CODES[self.measure], q, strain)
        excess = strain / plan.span[:, None] - plan.natural
        first, second = order >= 1, order >= 2
        values: Array
        stress: Array
        stiffness: Array
        coupling = None
        if layout.cells is not None:
            coupling = couple(layout.cells, excess, plan.span, state.stretches, order)
            values, stress, stiffness = coupling.values, coupling.stress, coupling.stiffness
        elif layout.evaluate_into is not None:
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
            if coupling is not None and second:
                assert layout.cells is not None
                pull_back_all(
                    CODES[self.measure],
                    q[layout.cells.hinge],
                    coupling.mixed,
                    np.zeros((0, 3, 3)),
                    1,
                )
        total = plan.length + layout.border
        gradient = np.empty(total if first else 0)
        band = np.empty((plan.length if second else 0, layout.width + 1))
        border = np.empty((plan.length if second else 0, layout.border))
        corner = np.empty((layout.border, layout.border))
        constraints = np.empty(m)
        energy = _kernel.assemble(
            frames, np.array(state.stretches), np.array(state.angles), q, values, stress,
            stiffness, plan, np.array(multipliers), gradient, band, border, corner, constraints, order,
        )  # fmt: skip
        if coupling is not None:
            assert layout.cells is not None
            energy += coupling.energy
            if first:
                add_coupling(
                    plan, layout.cells, coupling, q, state.stretches, gradient, band, border, corner,
                    order,
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

        Parameters
        ----------
        state : RodState
            Where to start.
        multipliers : ndarray, shape (m,)
            A guess of the forces of constraint.
        tolerance : float
            Size of the next correction, relative to its typical size, at which to stop.

        Returns
        -------
        Corrected or None
            None if a few steps do not lead to one; :func:`lissome.equilibrate` then descends with care.
        """
        return fast_correction(self, state, multipliers, tolerance)

    def present(self, equilibrium: Equilibrium) -> RodEquilibrium:
        """Return `equilibrium` with positions, forces and moments, as a :class:`RodEquilibrium`.

        Warns
        -----
        LissomeWarning
            If a hinge turns by more than 150 degrees: the mesh is too coarse.
        """
        found = self.diagnose(equilibrium.state)
        if found and is_news("sharp hinge of a rod"):
            warnings.warn(found, LissomeWarning, stacklevel=user_level())
        return equilibrium.as_type(RodEquilibrium)

    def warn(self, equilibrium: Equilibrium, stacklevel: int = 2) -> None:
        """Warn if the rod crosses itself: self-contact is not modeled.

        :func:`lissome.equilibrate` asks for this; a branch does not, whose states can be asked one by
        one (:meth:`RodEquilibrium.self_crossings`). A call of the library warns once.

        Parameters
        ----------
        equilibrium : RodEquilibrium
            What was found.
        stacklevel : int
            Of the warning, as of ``warnings.warn``.

        Warns
        -----
        LissomeWarning
            If parts of the rod come nearer to each other than a thousandth of its length.
        """
        state = equilibrium.state
        if topology.advances(state.quaternions):
            return
        nodes = self.positions(state)
        if topology.self_crossings(nodes, closed=self.closed) and is_news("crossing of a rod"):
            warnings.warn(
                "the rod passes through itself, or comes within a thousandth of its length of itself; "
                "self-contact is not modeled: `self_crossings` of the equilibrium tells where",
                LissomeWarning,
                stacklevel=stacklevel,
            )

    def diagnose(self, state: RodState) -> str | None:
        """Return what is wrong with `state` and the remedy, else None.

        That is a hinge that turns by more than 150 degrees, or a segment that has all but vanished.
        """
        plan = self.layout.plan
        j = int(np.argmin(state.stretches))
        if state.stretches[j] < VANISHED:
            return (
                f"segment {j} is squeezed to nothing: of the strain (e^2 - 1)/2 a segment bears no "
                "compression beyond 0.19 of its stretching stiffness; make that stiffness larger, or let "
                "loads and supports squeeze the rod less"
            )
        q, kappa = np.empty((plan.left.size, 4)), np.empty((plan.left.size, 3))
        _kernel.hinge_rotations(self._frames(state), plan.left, plan.right, plan.twist, q, kappa)
        i = int(np.argmin(q[:, 0]))
        if q[i, 0] >= math.cos(0.5 * SHARP):
            return None
        return (
            f"the hinge at node {self.layout.nodes[i]} turns by nearly half a turn: use more segments, "
            "or loads and supports that bend the rod less"
        )

    @property
    def _couples(self) -> list[tuple[int, Array, Array]]:
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


_FIELDS = tuple(item.name for item in fields(Rod))


def _rotation_of(density: Array, spans: Array, measure: str) -> Array:
    """Return the rotations (quaternions) of hinges at given strain densities."""
    try:
        return rotation_from_strain(density * spans[:, None], measure)
    except InvalidInput as error:
        raise InvalidInput(
            f"argument `natural` cannot be reached at a hinge of length {float(spans.max()):.3g}: "
            f"{error}; use more segments"
        ) from error


def _check_law(law: Any, count: int) -> None:
    strains = tuple(getattr(law, "strains", ()))
    if strains not in (ROD_STRAINS, (*ROD_STRAINS, "stretch")):
        raise InvalidInput(
            f"argument `law` is {law!r}; a rod needs a law of the strains curvature_1, curvature_2 and "
            "twist, such as rods.Kirchhoff, or of these and stretch"
        )
    rows = getattr(law, "count", None)
    if rows is not None and rows != count + 1:
        raise InvalidInput(f"argument `law` holds values for {rows} nodes; the rod has {count + 1}")


def _check_stretching(law: Any, stretching: float) -> None:
    if len(law.strains) == 4:
        raise InvalidInput(
            f"argument `stretching` is {stretching:g}, but the stretch is a strain of the law, which "
            "says how stiff the rod is; leave `stretching` out"
        )


def check_state(name: str, state: Any, count: int, what: str = "rod") -> RodState:
    """Return `state`, argument `name`, if it is that of a `what` with `count` segments."""
    if not isinstance(state, RodState):
        raise InvalidInput(
            f"argument `{name}` is of type {type(state).__name__}; pass a {what.capitalize()}State, for "
            "example the state of an equilibrium"
        )
    if state.quaternions.shape[0] != count:
        raise InvalidInput(
            f"argument `{name}` has {state.quaternions.shape[0]} segments; the {what} has {count}"
        )
    return state
