"""Where the unknowns and multipliers of a ribbon are, and how its hinges depend on its rulings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..factorization import ChainLayout
from ..rods._kernel import Plan
from ..rods._layout import Layout as RodLayout
from ._kernel import Rulings

if TYPE_CHECKING:
    from ._structure import Ribbon

__all__ = ["Layout", "derive"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Skeleton:
    """What depends on mesh, supports and scheme, but not on values."""

    source: Any  # the rod's skeleton
    key: tuple[Any, ...]
    where: Integers
    mean: Array
    slope: Array
    rulings: int  # number of rulings, prescribed ones included
    free: Integers  # indices of the rulings that are unknown
    fixed: Integers  # indices of prescribed ones
    values: Array  # their values
    column: Integers  # of the rulings
    local: Integers
    frame_column: Integers
    chain: ChainLayout
    length: int
    first_angle: int
    border: int
    width: int
    metric: Array
    rod_size: int


@dataclass(frozen=True, eq=False)
class Layout:
    """The skeleton, and the rod's plan with the places of this chain."""

    skeleton: Skeleton
    rod: RodLayout
    plan: Plan
    rulings: Rulings
    parameters: Array
    ribbon_width: float

    # what the results of rods ask for
    @property
    def nodes(self) -> Integers:
        """Nodes of the hinges."""
        return self.rod.nodes

    @property
    def arclength(self) -> Array:
        """Arc lengths of the hinges."""
        return self.rod.arclength

    @property
    def node_forces(self) -> Array:
        """Dead forces on the nodes."""
        return self.rod.node_forces


@dataclass(frozen=True, eq=False)
class _Stencils:
    where: Integers
    mean: Array
    slope: Array
    count: int
    fixed: dict[int, float]  # prescribed rulings
    far: frozenset[int]  # unknown rulings whose hinges are at both ends of the chain
    metric: Array  # lengths that the rulings stand for


def _staggered(ribbon: Ribbon) -> _Stencils:
    """Rulings on the frames: their mean and difference quotient at a hinge."""
    layout = ribbon.rod.layout
    plan = layout.plan
    n, frames = plan.left.size, plan.column.size
    where = np.full((n, 3), -1, dtype=np.int64)
    mean, slope = np.zeros((n, 3)), np.zeros((n, 3))
    where[:, 0], where[:, 1] = plan.left, plan.right
    mean[:, :2] = 0.5
    slope[:, 0], slope[:, 1] = -1.0 / plan.span, 1.0 / plan.span
    count, fixed, far = frames, {}, set()
    for node, value in ribbon.prescribed:
        fixed[_frame_of(ribbon, node)] = value
    if ribbon.rod.closed:
        if ribbon.joint == "free":
            where[-1, 1] = count
            count += 1
        else:
            mean[-1, 1] *= ribbon.sign
            slope[-1, 1] *= ribbon.sign
            if ribbon.pins_phase:
                fixed[0] = 0.0
            else:
                far.add(0)
    metric = np.zeros(count)
    for k in range(2):
        np.add.at(metric, where[:, k], 0.5 * plan.span)
    return _Stencils(where, mean, slope, count, fixed, frozenset(far), metric)


def _frame_of(ribbon: Ribbon, node: int) -> int:
    """Return the frame that the support of a node prescribes."""
    count = ribbon.rod.lengths.size
    index = 0
    for support in ribbon.rod.supports:
        if support.frame is None:
            continue
        if support.node == node:
            if support.clamp == "two-node":
                return 0 if node == 0 else count - 1
            return count + index
        index += 1
    raise AssertionError(f"node {node} has no frame")


def _nodal(ribbon: Ribbon) -> _Stencils:
    """Rulings at the hinges, with central differences; without slopes if the law does not need them."""
    rod = ribbon.rod
    layout = rod.layout
    plan = layout.plan
    n, fold = plan.left.size, ribbon.law.has_fold
    index = np.arange(n)
    if fold:
        for i in range(1, n):  # the two halves of a clamped node share a ruling
            if layout.nodes[i] == layout.nodes[i - 1]:
                index[i] = index[i - 1]
    s = np.array(layout.arclength)
    matched = rod.closed and ribbon.joint == "matched"
    if rod.closed:
        s[-1] = rod.length
    last = int(index[-1])
    terms: list[list[tuple[int, float, float]]] = []
    far: set[int] = set()
    aliased = matched and ribbon.pins_phase

    def ruling(i: int) -> tuple[int, float]:
        """Return index and sign of a ruling; of those beyond the joint by the rule of the joint."""
        sign = 1.0
        if i > last:
            i, sign = 0, ribbon.sign
        elif i < 0:
            i, sign = last, ribbon.sign
        if i == last and aliased:  # the inflection is in the middle of the first segment
            return 0, -ribbon.sign * sign
        return int(i), sign

    for i in range(n):
        h = int(index[i])
        own, sign = ruling(h)
        entry: dict[int, list[float]] = {own: [sign, 0.0]}
        if fold:
            before, after = i - 1, i + 1
            if before >= 0 and index[before] == h:
                before = -1  # second half of a clamped node: look ahead only
                one_sided = True
            else:
                one_sided = False
            if after < n and index[after] == h:
                after = n
                one_sided = True
            low = before >= 0 or (matched and not one_sided)
            high = after < n or (matched and not one_sided)
            if not low and not high:
                raise InvalidInput("the ribbon has a single hinge; use more segments")
            if low and high:
                distance = 0.0
                pairs = []
                for side, j in ((-1, before), (1, after)):
                    if j < 0:
                        gap = s[0] - 0.0
                        pairs.append((side, *ruling(-1)))
                    elif j >= n:
                        gap = s[0]
                        pairs.append((side, *ruling(last + 1)))
                    else:
                        gap = abs(s[j] - s[i])
                        pairs.append((side, *ruling(int(index[j]))))
                    distance += gap
                for side, k, sign_k in pairs:
                    entry.setdefault(k, [0.0, 0.0])[1] += side * sign_k / distance
            else:
                j = before if low else after
                gap = s[j] - s[i]
                k, sign_k = ruling(int(index[j]))
                entry.setdefault(k, [0.0, 0.0])[1] += sign_k / gap
                entry[own][1] -= sign / gap
        terms.append([(k, m, d) for k, (m, d) in entry.items()])
    where = np.full((n, 3), -1, dtype=np.int64)
    mean, slope = np.zeros((n, 3)), np.zeros((n, 3))
    for i, row in enumerate(terms):
        for k, (f, m, d) in enumerate(row):
            where[i, k], mean[i, k], slope[i, k] = f, m, d
    fixed: dict[int, float] = {}
    for node, value in ribbon.prescribed:
        for at in np.flatnonzero(layout.nodes == node):
            fixed[int(index[at])] = value
    if matched:
        if aliased:
            far.add(0)
        elif fold:
            far.update({0, last})
    metric = np.zeros(n)
    np.add.at(metric, where[:, 0], plan.span)
    return _Stencils(where, mean, slope, n, fixed, frozenset(far), metric)


def _make_skeleton(ribbon: Ribbon, key: tuple[Any, ...]) -> Skeleton:
    rod = ribbon.rod
    layout = rod.layout
    plan = layout.plan
    fold = ribbon.law.has_fold
    staggered = ribbon.scheme == "staggered" and fold
    stencils = _staggered(ribbon) if staggered else _nodal(ribbon)
    n = plan.left.size
    used = np.zeros(stencils.count, dtype=bool)
    used[stencils.where[stencils.where >= 0]] = True
    column = np.full(stencils.count, -1, dtype=np.int64)
    frame_column = np.full(plan.column.size, -1, dtype=np.int64)
    local = np.full((n, 4), -1, dtype=np.int64)
    open_rulings = used.copy()
    open_rulings[list(stencils.fixed)] = False
    waiting = open_rulings.copy()
    waiting[list(stencils.far)] = False
    frame_waiting = (plan.column >= 0) & (plan.column < plan.length)
    place = 0
    size = 4 if fold else 3

    for i in range(n):
        sides = (int(plan.left[i]), int(plan.right[i]))
        for turn in range(2):
            f = sides[turn]
            if frame_waiting[f]:
                frame_column[f] = place
                frame_waiting[f] = False
                place += 3
            if staggered:
                r = int(stencils.where[i, turn])
                if waiting[r]:
                    column[r] = place
                    waiting[r] = False
                    place += 1
            if turn == 0:
                if not staggered:
                    r = int(stencils.where[i, 0])
                    if waiting[r]:
                        column[r] = place
                        waiting[r] = False
                        place += 1
                local[i, : 3 if not fold else 4] = place + np.arange(size)
                if not fold:
                    local[i] = (-1, place, place + 1, -1)
                    place += 2
                else:
                    place += 4
    length = place
    # border: what the rod has there, far rulings, then the rod's constraints
    rod_unknowns = layout.chain.unknowns
    assert rod_unknowns is not None
    in_border = plan.column >= plan.length
    frame_column[in_border] = plan.column[in_border] - plan.length + length
    place = length + int(rod_unknowns.size) - plan.length
    first_angle = plan.first_angle - plan.length + length
    for r in sorted(stencils.far):
        if open_rulings[r]:
            column[r] = place
            place += 1
    border_unknowns = place - length
    m = plan.rows.shape[0]

    # order of the unknowns: the rod's, the rulings, the folds
    rod_positions = np.empty(rod_unknowns.size, dtype=np.int64)
    free_frames = np.flatnonzero(plan.column >= 0)
    for frame in free_frames:
        steps = np.arange(1 if plan.turning[frame] else 3)
        rod_positions[plan.column[frame] + steps] = frame_column[frame] + steps
    free = np.flatnonzero(column >= 0)
    folds = local[:, 0] if fold else np.zeros(0, dtype=np.int64)
    unknowns = np.concatenate([rod_positions, column[free], folds])
    inner = local[:, 1:] if fold else local[:, 1:3]
    constraints = np.concatenate([length + border_unknowns + np.arange(m), inner.reshape(-1)])

    left, right = frame_column[plan.left][:, None], frame_column[plan.right][:, None]
    rulings = np.where(stencils.where >= 0, column[stencils.where], -1)
    ends = (left + 2 * (left >= 0), right + 2 * (right >= 0))
    every = np.concatenate([rulings, left, right, *ends, local], axis=1)
    inside = (every >= 0) & (every < length)
    high = np.where(inside, every, -1).max(axis=1)
    low = np.where(inside, every, length).min(axis=1)
    width = int(max(np.max(high - low), 2))
    metric = np.concatenate(
        [layout.metric, stencils.metric[free], plan.span if fold else np.zeros(0)]
    )
    metric.flags.writeable = False
    fixed = np.array(sorted(stencils.fixed), dtype=np.int64)
    return Skeleton(
        source=layout.skeleton,
        key=key,
        where=stencils.where,
        mean=stencils.mean,
        slope=stencils.slope,
        rulings=stencils.count,
        free=free,
        fixed=fixed,
        values=np.array([stencils.fixed[int(f)] for f in fixed]),
        column=column,
        local=local,
        frame_column=frame_column,
        chain=ChainLayout(length, unknowns, constraints, border_unknowns + m),
        length=length,
        first_angle=first_angle,
        border=border_unknowns + m,
        width=width,
        metric=metric,
        rod_size=int(rod_unknowns.size),
    )


def derive(ribbon: Ribbon) -> Layout:
    """Return the layout of a ribbon; that of a ribbon with the same chain is used again."""
    rod_layout = ribbon.rod.layout
    key = (ribbon.scheme, ribbon.law.has_fold, ribbon.joint, ribbon.pins_phase, ribbon.prescribed,
           ribbon.sign)  # fmt: skip
    skeleton: Skeleton | None = ribbon.shared.get("skeleton")
    if skeleton is None or skeleton.source is not rod_layout.skeleton or skeleton.key != key:
        skeleton = _make_skeleton(ribbon, key)
        ribbon.shared["skeleton"] = skeleton
    plan = rod_layout.plan._replace(
        column=skeleton.frame_column, length=skeleton.length, first_angle=skeleton.first_angle
    )
    rulings = Rulings(
        skeleton.where, skeleton.mean, skeleton.slope, skeleton.column, skeleton.local
    )
    return Layout(
        skeleton, rod_layout, plan, rulings, ribbon.law.parameters, float(ribbon.law.width)
    )
