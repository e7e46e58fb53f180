"""Where hinges, unknowns and constraints of a rod are, and the values that its supports give them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._readonly import recalled
from ..errors import InvalidInput
from ..factorization import ChainLayout
from . import _kernel
from ._cells import Cells, make_cells
from .quaternions import conjugate, rotate

if TYPE_CHECKING:
    from ._structure import Rod
    from .supports import Support

__all__ = ["REACH", "Layout", "derive", "internal_forces", "plane_normal"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Distances are compared to this fraction of the length.
REACH = 1e-12


@dataclass(frozen=True, eq=False)
class Skeleton:
    """What depends on the mesh and on the kinds of supports, but not on their values."""

    lengths: Array  # these three tell for which rods it holds
    initial: Any
    key: tuple[Any, ...]
    left: Integers
    right: Integers
    span: Array
    twist: Array
    nodes: Integers  # of the hinges
    arclength: Array  # of the hinges
    column: Integers
    stretch: Integers
    turning: Integers
    hinged: Integers  # which of the frames of supports turn
    rows: Integers
    row_nodes: Integers  # node of each constraint; -1 for closure and phase
    prescribed: tuple[tuple[int, int, int], ...]  # those of supports: which, component and node
    anchors: tuple[int | None, ...]  # by component: node
    starts_held: bool  # whether each anchor is node 0
    phase: Array
    normals: Array
    chain: ChainLayout
    length: int
    first_angle: int
    width: int
    border: int
    metric: Array
    segment_of: dict[int, int]  # prescribed segments: index of the support
    ones: Array  # stretches of segments that keep their lengths
    moving: Integers  # segments that are free to turn
    turns: Integers  # their unknowns, three for each


@dataclass(frozen=True, eq=False)
class Layout:
    """The skeleton with the values of a rod."""

    skeleton: Skeleton
    plan: _kernel.Plan
    law: Any
    evaluate_into: Any  # of a compiled law
    cells: Cells | None  # of a law in which the stretch takes part
    fixed: Array  # frames of supports, (S, 4); hinged ones at the angle zero
    turning_axes: Array  # spatial axes of the hinged ones
    anchors: tuple[tuple[int, float] | None, ...]  # by component: node and position
    origin: Array | None  # position of node 0, if it is prescribed
    node_forces: Array  # (N + 1, 3)
    net_force: Array | None  # sum of all dead forces, if it is not zero

    @property
    def nodes(self) -> Integers:
        """Nodes of the hinges."""
        return self.skeleton.nodes

    @property
    def arclength(self) -> Array:
        """Arc lengths of the hinges."""
        return self.skeleton.arclength

    @property
    def hinged(self) -> Integers:
        """Which of the frames of supports turn."""
        return self.skeleton.hinged

    @property
    def row_nodes(self) -> Integers:
        """Node of each constraint; -1 for closure and phase."""
        return self.skeleton.row_nodes

    @property
    def chain(self) -> ChainLayout:
        """Places of unknowns and constraints."""
        return self.skeleton.chain

    @property
    def width(self) -> int:
        """Half bandwidth."""
        return self.skeleton.width

    @property
    def border(self) -> int:
        """Number of border rows."""
        return self.skeleton.border

    @property
    def metric(self) -> Array:
        """Masses of the unknowns."""
        return self.skeleton.metric

    @property
    def segment_of(self) -> dict[int, int]:
        """Prescribed segments, and which of the frames of supports each has."""
        return self.skeleton.segment_of


def key_of(rod: Rod) -> tuple[Any, ...]:
    """Return what a skeleton depends on."""
    supports = [
        (s.node, s.kind, s.clamp, s.frame is None, [v is None for v in s.position])
        for s in rod.supports
    ]
    phase = rod.phase if rod.held and rod.pins_phase else None
    return rod.closed, rod.joint, rod.extensible, rod._stretch_in_law, supports, rod.held, phase


def make_skeleton(rod: Rod, key: tuple[Any, ...]) -> Skeleton:
    """Number hinges, unknowns and constraints."""
    lengths, count = rod.lengths, rod.lengths.size
    frames = [s for s in rod.supports if s.frame is not None]
    index = {s.node: count + i for i, s in enumerate(frames)}
    hinged = np.array([i for i, s in enumerate(frames) if s.kind == "hinged"], dtype=np.int64)
    segment_of = {
        (0 if s.node == 0 else count - 1): i for i, s in enumerate(frames) if s.clamp == "segment"
    }

    # hinges: those between segments, those at frames of supports, that at the joint
    simple = np.ones(count + 1, dtype=bool)
    simple[[0, count, *index]] = False
    inner = np.flatnonzero(simple)
    extra: list[tuple[int, int, float, int]] = []
    for support in frames:
        node = support.node
        if support.clamp == "segment":
            continue
        f = index[node]
        before = (node - 1) % count if rod.closed else node - 1
        if before >= 0:
            extra.append((before, f, 0.5 * lengths[before], node))
        if node < count:
            extra.append((f, node, 0.5 * lengths[node], node))
    if rod.closed and 0 not in index:
        extra.append((count - 1, 0, 0.5 * (lengths[-1] + lengths[0]), 0))
    more = np.array([e[:2] for e in extra], dtype=np.int64).reshape(-1, 2)
    pairs = np.concatenate([np.stack([inner - 1, inner], axis=1), more])
    span = np.concatenate([0.5 * (lengths[inner - 1] + lengths[inner]), [e[2] for e in extra]])
    nodes = np.concatenate([inner, np.array([e[3] for e in extra], dtype=np.int64)])
    order = np.lexsort((np.where(pairs[:, 0] < count, 0, 1), nodes))
    if rod.closed:  # the joint comes last
        order = np.concatenate([order[nodes[order] != 0], order[nodes[order] == 0]])
    pairs, span, nodes = pairs[order], span[order], nodes[order].astype(np.int64)
    twist = np.zeros((span.size, 2))
    twist[:, 0] = 1.0
    if rod.closed:
        twist[pairs[:, 1] == 0] = math.cos(0.5 * rod.joint), math.sin(0.5 * rod.joint)

    # unknowns: segments in the band; the first segment of a ring, stretches of a held one and the
    # angles of hinged supports in the border
    extensible = rod.extensible
    per = 4 if extensible else 3
    in_border = rod.closed and not rod.held
    column = np.full(count + len(frames), -1, dtype=np.int64)
    stretch = np.full(count, -1, dtype=np.int64)
    free = np.ones(count, dtype=bool)
    free[list(segment_of)] = False
    if rod.closed:
        free[0] = False
    chain = np.flatnonzero(free)
    column[chain] = per * np.arange(chain.size)
    length = per * chain.size
    if length == 0:
        raise InvalidInput("the supports leave no segment free; use more segments")
    if extensible:
        stretch[chain] = column[chain] + 3
    place = length
    if in_border:
        column[0] = place
        place += 3
    if rod.closed and extensible:
        stretch[0] = place
        place += 1
    first_angle = place
    turning = np.zeros(column.size, dtype=np.int64)
    for k in hinged:
        column[count + int(k)] = place
        turning[count + int(k)] = 1
        place += 1

    # constraints
    rows: list[tuple[int, int, int]] = []
    row_nodes: list[int] = []
    anchors: list[int | None] = []
    if rod.closed:
        rows += [(k, 0, count) for k in range(3)]
        row_nodes += [-1, -1, -1]
    for k in range(3):
        held = [s.node for s in rod.supports if s.position[k] is not None]
        anchors.append(held[0] if held else None)
        rows += [(k, held[0], node) for node in held[1:]]
        row_nodes += held[1:]
    phase, normal = np.zeros(count), np.zeros(3)
    if rod.pins_phase and rod.phase is not None:
        rows.append((3, 0, count))
        row_nodes.append(-1)
        middle = 0.5 * (rod.arclength[:-1] + rod.arclength[1:])
        phase = np.sin(2.0 * math.pi * rod.phase * (middle - middle[0]) / rod.length)
        try:
            normal = np.array(plane_normal(rod))
        except InvalidInput:  # any direction across the first segment will do
            normal = rotate(rod.initial.quaternions[0], [1.0, 0.0, 0.0])
    m = len(rows)

    metric = np.empty(place)
    moving = np.flatnonzero(column[:count] >= 0)
    turns = column[moving][:, None] + np.arange(3)
    metric[turns] = lengths[moving][:, None]
    metric[stretch[stretch >= 0]] = lengths[stretch >= 0]
    for i, k in enumerate(hinged):
        near = (pairs[:, 0] == count + k) | (pairs[:, 1] == count + k)
        metric[first_angle + i] = float(np.sum(span[near]))
    ones = np.ones(count)
    for array in (metric, ones):
        array.flags.writeable = False
    border = place - length + m
    numbers = np.array(rows, dtype=np.int64).reshape(-1, 3)
    return Skeleton(
        lengths=lengths,
        initial=rod.initial,
        key=key,
        left=np.ascontiguousarray(pairs[:, 0]),
        right=np.ascontiguousarray(pairs[:, 1]),
        span=span,
        twist=twist,
        nodes=nodes,
        arclength=rod.arclength[nodes],
        column=column,
        stretch=stretch,
        turning=turning,
        hinged=hinged,
        rows=numbers,
        row_nodes=np.array(row_nodes, dtype=np.int64),
        prescribed=tuple(
            (r, row[0], node)
            for r, (row, node) in enumerate(zip(rows, row_nodes, strict=True))
            if node >= 0
        ),
        anchors=tuple(anchors),
        starts_held=all(node == 0 for node in anchors),
        phase=phase,
        normals=np.vstack([np.eye(3), normal])[numbers[:, 0]],
        chain=ChainLayout(length, np.arange(place), np.arange(place, place + m), border),
        length=length,
        first_angle=first_angle,
        width=7 if rod._stretch_in_law else 6 if extensible else 5,
        border=border,
        metric=metric,
        segment_of=segment_of,
        ones=ones,
        moving=moving,
        turns=turns,
    )


def derive(rod: Rod) -> Layout:
    """Give the skeleton of a rod its values, and refuse what has no equilibrium.

    Of rods that are made from one another, as those of a branch are, most differ in little: what the
    change does not touch is used again.
    """
    known = rod._shared
    skeleton = _skeleton_of(rod)
    check_reach(rod)
    common = (skeleton, rod.natural, rod.measure, rod.stretching)
    plan = recalled(known, "plan", common, lambda: _plan_without_values(rod, skeleton))
    given = [s for s in rod.supports if s.frame is not None]
    held = (skeleton, *[part for s in given for part in (s.frame, s.axis, s.moment)])
    frames = recalled(known, "frames", held, lambda: _frames_of(given, skeleton))
    loads = recalled(known, "loads", (skeleton, rod.loads), lambda: _loads_of(rod, skeleton))
    material = recalled(known, "material", (skeleton, rod.law), lambda: _material_of(rod, skeleton))

    places: dict[int, Any] = {s.node: s.position for s in rod.supports}
    at = [None if node is None else places[node][k] for k, node in enumerate(skeleton.anchors)]
    targets = np.zeros(skeleton.rows.shape[0])
    for r, k, node in skeleton.prescribed:
        targets[r] = places[node][k] - at[k]
    return Layout(
        skeleton=skeleton,
        plan=plan._replace(
            axis=frames.axis,
            arms=loads.arms,
            dead=loads.dead,
            targets=targets,
            moments=frames.moments,
        ),
        law=material.law,
        evaluate_into=material.evaluate_into,
        cells=material.cells,
        fixed=frames.fixed,
        turning_axes=frames.turning_axes,
        anchors=tuple(
            [
                None if node is None or value is None else (node, value)
                for node, value in zip(skeleton.anchors, at, strict=True)
            ]
        ),
        origin=np.array(at) if skeleton.starts_held else None,
        node_forces=loads.nodes,
        net_force=loads.net,
    )


def _skeleton_of(rod: Rod) -> Skeleton:
    key = key_of(rod)
    known: Skeleton | None = rod._shared.get("skeleton")
    if (
        known is not None
        and known.lengths is rod.lengths
        and known.initial is rod.initial
        and known.key == key
    ):
        return known
    skeleton = make_skeleton(rod, key)
    rod._shared["skeleton"] = skeleton
    return skeleton


def _plan_without_values(rod: Rod, skeleton: Skeleton) -> _kernel.Plan:
    """Return a plan to which supports and loads have yet to give their values."""
    _check_natural(rod, skeleton)
    none = np.zeros((0, 0))
    return _kernel.Plan(
        left=skeleton.left,
        right=skeleton.right,
        span=skeleton.span,
        twist=skeleton.twist,
        column=skeleton.column,
        axis=none,
        turning=skeleton.turning,
        lengths=np.array(rod.lengths),
        rows=skeleton.rows,
        phase=skeleton.phase,
        normals=skeleton.normals,
        stretch_column=skeleton.stretch,
        arms=none,
        natural=rod.natural[skeleton.nodes],
        dead=none,
        targets=none,
        moments=none,
        length=skeleton.length,
        first_angle=skeleton.first_angle,
        stiffness=(0.0 if rod._stretch_in_law else -1.0)
        if rod.stretching is None
        else float(rod.stretching),
    )


class _Frames(NamedTuple):
    """What supports with frames prescribe."""

    fixed: Array
    turning_axes: Array
    axis: Array  # of all frames, along their directors
    moments: Array


def _frames_of(given: list[Support], skeleton: Skeleton) -> _Frames:
    h, count = skeleton.hinged.size, skeleton.lengths.size
    axis = np.zeros((skeleton.column.size, 3))
    axes, moments = np.zeros((h, 3)), np.zeros(h)
    for i, k in enumerate(skeleton.hinged):
        support = given[k]
        assert support.axis is not None
        assert support.frame is not None
        axes[i], moments[i] = support.axis, support.moment
        axis[count + k] = rotate(conjugate(support.frame), support.axis)
    return _Frames(np.array([s.frame for s in given]).reshape(-1, 4), axes, axis, moments)


class _Material(NamedTuple):
    """The law at the hinges."""

    law: Any
    evaluate_into: Any
    cells: Cells | None


def _material_of(rod: Rod, skeleton: Skeleton) -> _Material:
    varies = getattr(rod.law, "count", None) is not None
    law = rod.law.at(skeleton.nodes) if varies else rod.law
    compiled = getattr(law, "kernel", None) is not None and not rod._stretch_in_law
    cells = None
    if rod._stretch_in_law:
        held = {s.node for s in rod.supports if s.frame is not None}
        held |= {0, rod.lengths.size} if rod.closed else set()
        cells = make_cells(
            rod.law, rod.lengths, skeleton.left, skeleton.right, skeleton.nodes, held
        )
    return _Material(law, law.evaluate_into if compiled else None, cells)


def plane_normal(rod: Rod) -> Array:
    """Return the unit normal of a plane closed rod, which it circles counterclockwise."""
    sources = (rod.initial, rod.lengths)
    return recalled(rod._shared, "normal", sources, lambda: _plane_normal(rod))


def _plane_normal(rod: Rod) -> Array:
    nodes = rod.positions(rod.initial)[:-1]
    x, y, z = (nodes - nodes.mean(axis=0)).T
    u, v, w = np.roll(x, -1), np.roll(y, -1), np.roll(z, -1)
    area = np.array([np.sum(y * w - z * v), np.sum(z * u - x * w), np.sum(x * v - y * u)])
    size = float(np.linalg.norm(area))
    normal = area / size if size > 0.0 else np.zeros(3)
    if not size > 0.0 or np.max(np.abs(normal @ np.stack([x, y, z]))) > 1e-6 * rod.length:
        raise InvalidInput(
            "the initial state is not a plane ring; pass one with `with_initial`, or give natural "
            "curvatures with `with_natural`"
        )
    normal.flags.writeable = False
    return normal


#: What a hinge can bend or twist by, short of half a turn, in the measures.
LIMITS = {"sine": 2.0, "angle": math.pi, "averaged": math.pi}  # averaged: the twist alone


def _check_natural(rod: Rod, skeleton: Skeleton) -> None:
    """Refuse natural strains beyond those of half a turn, which no hinge attains."""
    natural = (
        rod.natural[skeleton.nodes, 2:]
        if rod.measure == "averaged"
        else rod.natural[skeleton.nodes]
    )
    wanted = np.linalg.norm(natural, axis=1) * skeleton.span
    i = int(np.argmax(wanted))
    if wanted[i] >= LIMITS[rod.measure]:
        raise InvalidInput(
            f"argument `natural` at node {skeleton.nodes[i]} asks a hinge of length "
            f"{skeleton.span[i]:.3g} for a strain of {wanted[i]:.4g}; the measure {rod.measure!r} "
            f"stays below {LIMITS[rod.measure]:.4g}: use more segments"
        )


class _DeadLoads(NamedTuple):
    """Dead forces and couples."""

    nodes: Array  # forces on the nodes
    dead: Array  # in the segments
    net: Array | None  # their sum, if it is not zero
    arms: Array  # segment, force and arm of each couple


def _loads_of(rod: Rod, skeleton: Skeleton) -> _DeadLoads:
    forces = rod.loads.forces(rod.lengths, rod.closed)
    dead = _dead_forces(forces, skeleton.anchors)
    total = np.sum(forces, axis=0)
    couples = rod.loads.couples.items()
    arms = np.array([[j, *f, *a] for j, (f, a) in couples if np.any(f) and np.any(a)])
    return _DeadLoads(forces, dead, total if np.any(total) else None, arms.reshape(-1, 7))


def _dead_forces(forces: Array, anchors: tuple[int | None, ...]) -> Array:
    """Return for each segment the sum of the dead forces beyond it, or minus those before it."""
    count = forces.shape[0] - 1
    total = np.sum(forces, axis=0)
    size = np.sum(np.abs(forces), axis=0)
    dead = np.zeros((count, 3))
    for k in range(3):
        if not size[k]:
            continue
        if anchors[k] is None and abs(total[k]) > 1e-12 * size[k]:
            raise InvalidInput(
                f"the dead loads add up to a force of {total[k]:.6g} along {'xyz'[k]}, and nothing "
                "holds the rod in this direction; pin or clamp a node, or balance the loads"
            )
        before = np.cumsum(forces[:-1, k])
        beyond = np.cumsum(forces[:0:-1, k])[::-1]
        dead[:, k] = np.where(np.arange(count) >= (anchors[k] or 0), beyond, -before)
    return dead


def check_reach(rod: Rod) -> None:
    """Refuse supports farther from each other than an inextensible rod is long."""
    if rod.extensible:
        return
    _check_reach_of_segments(rod)
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


def _check_reach_of_segments(rod: Rod) -> None:
    """Refuse clamps of segments whose far nodes are farther apart than the rod between them is long."""
    if not any(s.clamp == "segment" for s in rod.supports):
        return
    places = []
    for support in rod.supports:
        if None in support.position:
            continue
        node, place = support.node, np.array(support.position)
        if support.clamp == "segment" and support.frame is not None:
            start = node == 0
            rest = rod.lengths[0 if start else -1] * (1.0 if start else -1.0)
            place = place + rotate(support.frame, [0.0, 0.0, rest])
            node += 1 if start else -1
        places.append((node, place, support))
    for i, (m, p, a) in enumerate(places):
        for n, q, b in places[:i]:
            if a.clamp != "segment" and b.clamp != "segment":
                continue
            distance = float(np.linalg.norm(p - q))
            reach = float(rod.arclength[m] - rod.arclength[n])
            if distance > reach * (1.0 - REACH) and reach > 0.0:
                raise InvalidInput(
                    f"the clamps of segments hold nodes {n} and {m} at a distance of {distance:.9g}, and "
                    f"the rod between them is {reach:.9g} long: it is inextensible; bring the supports "
                    "nearer, turn their frames, or give the rod a `stretching` stiffness"
                )


def internal_forces(rod: Rod, multipliers: Array) -> Array:
    """Return the internal force on each segment, shape (N, 3): of what lies beyond on what is before."""
    return _kernel.with_multipliers(rod.layout.plan, np.asarray(multipliers, dtype=float))
