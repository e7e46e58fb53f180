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

#: Parts of a cell, with the scheme "moments": rulings turn within the distance of a width.
PARTS = 4
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(5)
#: Points in a part, as fractions of it, and their weights.
POINTS, WEIGHTS = 0.5 * (1.0 + POINTS), 0.5 * WEIGHTS


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
    before: Integers
    share: Array
    ahead: Array  # lengths of the cells that hinges have behind them
    parts: int  # of a cell, with the scheme "moments"
    base: Integers  # first of the four hinges between whose moments those of a cell lie
    shape: Array  # their weights, by cell, part and point
    fluxes: Integers  # positions of their fluxes
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
    before: Integers  # hinges whose fold variable a hinge needs too; -1 if none
    share: Array  # parts of the hinge with its own fold variable, and with that one
    ahead: Array  # lengths of the cells behind the hinges; 0 where there is none


def _staggered(ribbon: Ribbon) -> _Stencils:
    """Rulings on the frames: interpolated at the node of a hinge, and their difference quotient."""
    layout = ribbon.rod.layout
    plan = layout.plan
    n, frames = plan.left.size, plan.column.size
    where = np.full((n, 3), -1, dtype=np.int64)
    mean, slope = np.zeros((n, 3)), np.zeros((n, 3))
    where[:, 0], where[:, 1] = plan.left, plan.right
    mean[:, :2] = 0.5
    # Between segments of unequal lengths. So rulings at nodes turn as much from node to node as the
    # slopes of the hinges say, and do not cross.
    lengths = ribbon.rod.lengths
    inner = (plan.left < lengths.size) & (plan.right < lengths.size)
    before, after = lengths[plan.left[inner]], lengths[plan.right[inner]]
    mean[inner, 0], mean[inner, 1] = after / (before + after), before / (before + after)
    slope[:, 0], slope[:, 1] = -1.0 / plan.span, 1.0 / plan.span
    count, fixed, far = frames, {}, set()
    for node, value in ribbon.clamped_rulings:
        fixed[_frame_of(ribbon, node)] = value
    if ribbon.rod.closed:
        if ribbon.joint == "free":
            where[-1, 1] = count
            count += 1
        else:
            mean[-1, 1] *= ribbon._joint_sign
            slope[-1, 1] *= ribbon._joint_sign
            if ribbon.pins_phase:
                fixed[0] = 0.0
            else:
                far.add(0)
    metric = np.zeros(count)
    for k in range(2):
        np.add.at(metric, where[:, k], 0.5 * plan.span)
    return _Stencils(
        where, mean, slope, count, fixed, frozenset(far), metric, *_alone(n), np.zeros(n)
    )


def _alone(n: int) -> tuple[Integers, Array]:
    """Return that each hinge has one fold variable, its own."""
    return np.full(n, -1, dtype=np.int64), np.tile([1.0, 0.0], (n, 1))


def _frame_of(ribbon: Ribbon, node: int) -> int:
    """Return the frame that the support of a node prescribes."""
    count = ribbon.rod.lengths.size
    index = 0
    for support in ribbon.rod.supports:
        if support.frame is None:
            continue
        if support.node == node:
            if support.clamp == "segment":
                return 0 if node == 0 else count - 1
            return count + index
        index += 1
    raise AssertionError(f"node {node} has no frame")


def parts_of(ribbon: Ribbon) -> int:
    """Return into how many parts the rulings divide the cells between hinges."""
    return PARTS if ribbon.scheme == "moments" and ribbon.law.has_fold else 1


def _smooth(lengths: Array, parts: int) -> tuple[Integers, Array]:
    """Return from which four hinges the moments in each cell are interpolated, and the weights.

    The cubic of Hermite between neighbors, whose slope at a hinge is that of the parabola through it and
    both its neighbors (at an end, of the last parabola): continuous, with continuous slopes, and exact
    for a quadratic. A kink at the hinges would be felt by an inflection that passes them.

    Parameters
    ----------
    lengths : ndarray, shape (n - 1,)
        Distances of the n hinges, at least four.
    parts : int
        Of a cell.

    Returns
    -------
    base : ndarray, shape (n - 1,)
    weights : ndarray, shape (n - 1, parts, points, 4)

    Raises
    ------
    InvalidInput
        If there are fewer hinges.
    """
    n = lengths.size + 1
    if n < 4:
        raise InvalidInput(
            f"the ribbon has {n} hinges; the scheme 'moments' needs four: use more segments"
        )
    cells = np.arange(n - 1)
    base = np.clip(cells - 1, 0, n - 4)
    before, after = lengths[:-1], lengths[1:]
    parabolas = np.stack(  # second derivatives, by three values each
        [
            2.0 / (before * (before + after)),
            -2.0 / (before * after),
            2.0 / (after * (before + after)),
        ],
        axis=1,
    )
    x = ((np.arange(parts)[:, None] + POINTS) / parts)[..., None]
    bend = 0.5 * lengths[:, None, None, None] ** 2 * x * (1.0 - x)
    weights = np.zeros((n - 1, parts, POINTS.size, 4))
    for hinges, share in ((cells, 1.0 - x), (cells + 1, x)):
        own, second = np.zeros((n - 1, 4)), np.zeros((n - 1, 4))
        own[cells, hinges - base] = 1.0
        middle = np.clip(hinges, 1, n - 2)
        for k in range(3):
            second[cells, middle - 1 + k - base] = parabolas[middle - 1, k]
        weights += share * (own[:, None, None] - bend * second[:, None, None])
    return base, weights


def _nodal(ribbon: Ribbon) -> _Stencils:
    """Rulings at the hinges, without slopes if the law does not need them.

    With the scheme "cells" slope and fold variable of hinge i are those between it and the next one;
    otherwise the slopes are central differences.
    """
    rod = ribbon.rod
    layout = rod.layout
    plan = layout.plan
    n, fold = plan.left.size, ribbon.law.has_fold
    cells = fold and ribbon.scheme in ("cells", "moments")
    index = np.arange(n)
    fine = parts_of(ribbon)
    if fold:
        for i in range(1, n):  # the two halves of a clamped node share a ruling
            if layout.nodes[i] == layout.nodes[i - 1]:
                index[i] = index[i - 1]
    s = np.array(layout.arclength)
    matched = rod.closed and ribbon.joint == "matched"
    if rod.closed:
        s[-1] = rod.length
    last = int(index[-1])
    before_of, share = _alone(n)
    ahead = np.zeros(n)  # lengths of the cells behind the hinges; 0 where there is none
    terms: list[list[tuple[int, float, float]]] = []
    far: set[int] = set()
    aliased = matched and ribbon.pins_phase

    def ruling(i: int) -> tuple[int, float]:
        """Return index and sign of a ruling; of those beyond the joint by the rule of the joint."""
        sign = 1.0
        if i > last:
            i, sign = 0, ribbon._joint_sign
        elif i < 0:
            i, sign = last, ribbon._joint_sign
        if i == last and aliased:  # the inflection is in the middle of the first segment
            return 0, -ribbon._joint_sign * sign
        return int(i), sign

    for i in range(n):
        h = int(index[i])
        own, sign = ruling(h)
        entry: dict[int, list[float]] = {own: [sign, 0.0]}
        if cells:
            last_one = i == n - 1
            if last_one and matched:
                ahead[i] = s[0]
            elif not last_one and index[i + 1] != h:
                ahead[i] = s[i + 1] - s[i]
            if ahead[i] > 0.0:
                k, sign_k = ruling(last + 1 if last_one else int(index[i + 1]))
                entry[own][1] -= sign / ahead[i]
                entry.setdefault(k, [0.0, 0.0])[1] += sign_k / ahead[i]
        elif fold:
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
    if cells:
        behind = np.roll(ahead, 1)
        if np.any(ahead + behind == 0.0):
            node = int(layout.nodes[np.argmin(ahead + behind)])
            raise InvalidInput(
                f"the hinge at node {node} has no other beside it, between which rulings could turn; use "
                "more segments"
            )
        before_of = np.where(behind > 0.0, np.roll(np.arange(n), 1), -1)
        share = np.stack([ahead, behind], axis=1) / (ahead + behind)[:, None]
    where = np.full((n, 3), -1, dtype=np.int64)
    mean, slope = np.zeros((n, 3)), np.zeros((n, 3))
    for i, row in enumerate(terms):
        for k, (f, m, d) in enumerate(row):
            where[i, k], mean[i, k], slope[i, k] = f, m, d
    count = n
    if fine > 1:
        where = np.where(where >= 0, where * fine, -1)
        count = (n - 1) * fine + 1
    fixed: dict[int, float] = {}
    for node, value in ribbon.clamped_rulings:
        for at in np.flatnonzero(layout.nodes == node):
            fixed[int(index[at]) * fine] = value
    if matched:
        if aliased:
            far.add(0)
        elif fold:
            far.update({0, last})
    metric = np.zeros(count)
    np.add.at(metric, where[:, 0], plan.span)
    if fine > 1:
        metric = np.zeros(count)
        pieces = np.repeat(ahead[:-1], fine) / fine
        metric[:-1] += 0.5 * pieces
        metric[1:] += 0.5 * pieces
    return _Stencils(
        where, mean, slope, count, fixed, frozenset(far), metric, before_of, share, ahead
    )


def _make_skeleton(ribbon: Ribbon, key: tuple[Any, ...]) -> Skeleton:
    rod = ribbon.rod
    layout = rod.layout
    plan = layout.plan
    fold = ribbon.law.has_fold
    staggered = ribbon.scheme == "staggered" and fold
    moments = ribbon.scheme == "moments" and fold
    cells = (ribbon.scheme == "cells" or moments) and fold
    stencils = _staggered(ribbon) if staggered else _nodal(ribbon)
    n = plan.left.size
    used = np.zeros(stencils.count, dtype=bool)
    used[stencils.where[stencils.where >= 0]] = True
    parts = parts_of(ribbon)
    fluxes = np.full((n - 1) * parts, -1, dtype=np.int64)
    base, shape = np.zeros(0, dtype=np.int64), np.zeros((0, 0, 0, 4))
    if moments:
        used[:] = True
        base, shape = _smooth(stencils.ahead[:-1], parts)
    column = np.full(stencils.count, -1, dtype=np.int64)
    frame_column = np.full(plan.column.size, -1, dtype=np.int64)
    local = np.full((n, 4), -1, dtype=np.int64)
    open_rulings = used.copy()
    open_rulings[list(stencils.fixed)] = False
    waiting = open_rulings.copy()
    waiting[list(stencils.far)] = False
    frame_waiting = (plan.column >= 0) & (plan.column < plan.length)
    place = 0

    for i in range(n):
        sides = (int(plan.left[i]), int(plan.right[i]))
        if moments:
            # What is inside a cell goes before all that it depends on: its elimination then leaves nothing
            # behind in the wide gaps between hinges.
            first, last = parts * np.searchsorted(base, (i, i + 1))
            for k in range(first, last):
                fluxes[k] = place
                place += 1
                if (k + 1) % parts:  # the last one is at the hinge
                    column[k + 1] = place
                    place += 1
            if frame_waiting[sides[0]]:
                frame_column[sides[0]] = place
                place += 3
            r = int(stencils.where[i, 0])
            if waiting[r]:
                column[r] = place
                place += 1
            local[i, :3] = place + np.arange(3)
            place += 3
            frame_waiting[sides[0]] = waiting[r] = False
            if frame_waiting[sides[1]] and (i == n - 1 or sides[1] != plan.left[i + 1]):
                frame_column[sides[1]] = place
                frame_waiting[sides[1]] = False
                place += 3
            continue
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
                if cells and i:  # the cell behind is between the frames that it couples
                    local[i - 1, [0, 3]] = place, place + 1
                    place += 2
                if not staggered:
                    r = int(stencils.where[i, 0])
                    if waiting[r]:
                        column[r] = place
                        waiting[r] = False
                        place += 1
                if cells or not fold:
                    local[i, 1:3] = place, place + 1
                    place += 2
                else:
                    local[i] = place + np.arange(4)
                    place += 4
    if cells:
        # the cell of a joint is at both ends of the chain
        split = bool(np.any(stencils.before == n - 1))
        if not moments:
            local[n - 1, 3] = place
            place += 1
        if not split and not moments:
            local[n - 1, 0] = place
            place += 1
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
    if cells and split and not moments:
        local[n - 1, 0] = place
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
    folds = local[:, 0] if fold and not moments else np.zeros(0, dtype=np.int64)
    unknowns = np.concatenate([rod_positions, column[free], folds])
    inner = np.append(local[:, :3], fluxes) if moments else local[:, 1:] if fold else local[:, 1:3]
    constraints = np.concatenate([length + border_unknowns + np.arange(m), inner.reshape(-1)])

    left, right = frame_column[plan.left][:, None], frame_column[plan.right][:, None]
    rulings = np.where(stencils.where >= 0, column[stencils.where], -1)
    used_here = np.where(stencils.mean != 0.0, rulings, -1)
    other = np.where(stencils.before >= 0, local[stencils.before, 0], -1)[:, None]
    ends = (left + 2 * (left >= 0), right + 2 * (right >= 0))
    width = 2
    groups = [
        [used_here, left, right, *ends, local[:, :3], other],
        [rulings, local[:, ::3]],
    ]
    if moments:
        groups[0].pop()
        four = local[base[:, None] + np.arange(4)][..., [0, 2]].reshape(n - 1, 8)
        inside_cells = fluxes.reshape(n - 1, parts), column[:-1].reshape(n - 1, parts)
        groups[1] = [four, *inside_cells, column[parts::parts, None]]
    for together in groups:
        every = np.concatenate(together, axis=1)
        inside = (every >= 0) & (every < length)
        high = np.where(inside, every, -1).max(axis=1)
        low = np.where(inside, every, length).min(axis=1)
        width = max(width, int(np.max(high - low)))
    metric = np.concatenate(
        [layout.metric, stencils.metric[free], plan.span if folds.size else np.zeros(0)]
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
        before=stencils.before,
        share=stencils.share,
        ahead=stencils.ahead,
        parts=parts,
        base=base,
        shape=shape,
        fluxes=fluxes,
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
    key = (ribbon.scheme, ribbon.law.has_fold, ribbon.joint, ribbon.pins_phase, ribbon.clamped_rulings,
           ribbon._joint_sign)  # fmt: skip
    skeleton: Skeleton | None = ribbon._shared.get("skeleton")
    if skeleton is None or skeleton.source is not rod_layout.skeleton or skeleton.key != key:
        skeleton = _make_skeleton(ribbon, key)
        ribbon._shared["skeleton"] = skeleton
    plan = rod_layout.plan._replace(
        column=skeleton.frame_column, length=skeleton.length, first_angle=skeleton.first_angle
    )
    rulings = Rulings(
        skeleton.where, skeleton.mean, skeleton.slope, skeleton.column, skeleton.local,
        skeleton.before, skeleton.share,
    )  # fmt: skip
    return Layout(
        skeleton, rod_layout, plan, rulings, ribbon.law.parameters, float(ribbon.law.width)
    )
