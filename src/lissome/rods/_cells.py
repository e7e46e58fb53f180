r"""Laws in which the stretch of the rod takes part, coupled with bending and twist.

Curvatures and twist are known at the hinges, the stretch :math:`\varepsilon=(e^2-1)/2` (4.17) in the
segments. The rod is cut into cells of half a segment, each of which has the densities of the hinge at
its one end and the stretch of its segment:

.. math:: E = \sum_i\sum_{j\ni i} \tfrac{l_j}{2}\,W(\kappa_i/\ell_i - k^0_i,\ \varepsilon_j) .

Along a segment this is the trapezoidal rule in the curvatures and the midpoint rule in the stretch:
second order. (With the mean of the stretches at a hinge, a stretch of alternating sign would cost
nothing.) The last half segment before an end without a frame has no hinge. No moment acts on it, so
that its curvatures are those that make W least at its stretch:
:math:`W^*(\varepsilon) = \min_k W(k,\varepsilon)`. Without coupling that is the energy of stretching
alone, and the scheme is that of a law of three strains with a stretching stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _kernel
from .quaternions import rotate

__all__ = ["Cells", "Coupling", "add_coupling", "couple", "make_cells"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Newton iterations for the strains of a cell on which no moment acts.
LIMIT = 30


@dataclass(frozen=True, eq=False)
class Cells:
    """The half segments of a rod."""

    hinge: Integers  # hinge, segment and length of each
    segment: Integers
    weight: Array
    law: Any  # at the nodes of these hinges
    free_segment: Integers  # the same of those at ends without a frame
    free_weight: Array
    free_law: Any


@dataclass(frozen=True, eq=False)
class Coupling:
    """What the energy of the cells means for hinges (as if of three strains) and stretches."""

    energy: float  # of the cells without a hinge
    values: Array  # (n,) energy of the hinges per unit length
    stress: Array  # (n, 3) derivative with respect to kappa
    stiffness: Array  # (n, 3, 3) second derivative times the length of the hinge
    tension: Array  # (N,) derivative with respect to the strain of stretching of each segment
    modulus: Array  # (N,) and its second derivative
    mixed: Array  # (M, 3) mixed derivative with respect to kappa, of each cell


def make_cells(
    law: Any, lengths: Array, left: Integers, right: Integers, nodes: Integers, held: Any
) -> Cells:
    """Cut the segments in halves; `held` are ends whose half segment has no energy of its own."""
    count = lengths.size
    hinge, segment = [], []
    for side in (left, right):
        here = np.flatnonzero(side < count)
        hinge.append(here)
        segment.append(side[here])
    hinges, segments = np.concatenate(hinge), np.concatenate(segment)
    free = [(j, node) for j, node in ((0, 0), (count - 1, count)) if node not in held]
    places = np.array([node for _, node in free], dtype=np.int64)
    ends = np.array([j for j, _ in free], dtype=np.int64)
    varies = getattr(law, "count", None) is not None
    return Cells(
        hinge=hinges,
        segment=segments,
        weight=0.5 * lengths[segments],
        law=law.at(nodes[hinges]) if varies else law,
        free_segment=ends,
        free_weight=0.5 * lengths[ends],
        free_law=law.at(places) if varies and places.size else law,
    )


def couple(cells: Cells, excess: Array, span: Array, stretches: Array, order: int) -> Coupling:
    """Evaluate the law in all cells and add up."""
    n, count = span.size, stretches.size
    strain = 0.5 * (stretches**2 - 1.0)  # (4.17) over the rest length
    k = np.column_stack([excess[cells.hinge], strain[cells.segment]])
    given = cells.law.evaluate(k, order)
    weight = cells.weight
    share = weight / span[cells.hinge]
    values = np.asarray(np.bincount(cells.hinge, share * given[0], n), dtype=float)
    first, second = order >= 1, order >= 2
    stress, stiffness = np.zeros((n if first else 0, 3)), np.zeros((n if second else 0, 3, 3))
    tension, modulus = np.zeros(count), np.zeros(count)
    mixed = np.zeros((0, 3))
    if first:
        np.add.at(stress, cells.hinge, share[:, None] * given[1][:, :3])
        np.add.at(tension, cells.segment, weight * given[1][:, 3])
    if second:
        np.add.at(stiffness, cells.hinge, share[:, None, None] * given[2][:, :3, :3])
        np.add.at(modulus, cells.segment, weight * given[2][:, 3, 3])
        mixed = np.ascontiguousarray(share[:, None] * given[2][:, 3, :3])
    energy = 0.0
    if cells.free_segment.size:
        least = relaxed(cells.free_law, strain[cells.free_segment])
        energy = float(cells.free_weight @ least[0])
        np.add.at(tension, cells.free_segment, cells.free_weight * least[1])
        np.add.at(modulus, cells.free_segment, cells.free_weight * least[2])
    return Coupling(energy, values, stress, stiffness, tension, modulus, mixed)


def relaxed(law: Any, strain: Array) -> tuple[Array, Array, Array]:
    """Return the energy at given stretches when no moment acts, and its two derivatives.

    Not a number where Newton's method finds no strains without moment.
    """
    k = np.zeros((strain.size, 4))
    k[:, 3] = strain
    previous = np.inf
    for _ in range(LIMIT):
        energy, stress, stiffness = law.evaluate(k, 2)
        try:
            step = np.linalg.solve(stiffness[:, :3, :3], stress[:, :3, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
        size = float(np.max(np.abs(step)))
        # Rounding errors are left once steps cease to shrink.
        if size == 0.0 or (size >= 0.5 * previous and size <= 1e-8 * (1.0 + np.max(np.abs(k)))):
            cross = stiffness[:, :3, 3]
            back = np.linalg.solve(stiffness[:, :3, :3], cross[:, :, None])[:, :, 0]
            return energy, stress[:, 3], stiffness[:, 3, 3] - np.sum(cross * back, axis=1)
        k[:, :3] -= step
        previous = size
    missing = np.full(strain.size, np.nan)
    return missing, missing, missing


def add_coupling(
    plan: _kernel.Plan,
    cells: Cells,
    coupling: Coupling,
    q: Array,
    stretches: Array,
    gradient: Array,
    band: Array,
    border: Array,
    corner: Array,
    order: int,
) -> None:
    """Add what the stretches contribute to gradient and Hessian."""
    free = np.flatnonzero(plan.stretch_column >= 0)
    places, e = plan.stretch_column[free], stretches[free]
    gradient[places] += e * coupling.tension[free]
    if order < 2:
        return
    _scatter(
        band, border, corner, places, places,
        coupling.tension[free] + e * e * coupling.modulus[free],
    )  # fmt: skip
    here = np.flatnonzero(plan.stretch_column[cells.segment] >= 0)
    hinge, segment = cells.hinge[here], cells.segment[here]
    rows = plan.stretch_column[segment]
    # Derivatives of kappa as for the gradient: X^T m on the right, -X m on the left.
    m = coupling.mixed[here] * stretches[segment][:, None]
    s, v = q[hinge, :1], q[hinge, 1:]
    turn = np.cross(m, v)
    after = turn + s * m
    twisted = plan.twist[hinge, 1] != 0.0
    if np.any(twisted):  # the right increment acts before the turn about d3
        c, d = plan.twist[hinge[twisted]].T
        spin = np.column_stack([c, 0.0 * c, 0.0 * c, d])
        after[twisted] = rotate(spin, after[twisted])
    for frames, parts in ((plan.left[hinge], turn - s * m), (plan.right[hinge], after)):
        column = plan.column[frames]
        for turning in (0, 1):
            chosen = np.flatnonzero((column >= 0) & (plan.turning[frames] == turning))
            if turning:
                along = np.sum(plan.axis[frames[chosen]] * parts[chosen], axis=1)
                _scatter(band, border, corner, rows[chosen], column[chosen], along)
                continue
            for r in range(3):
                _scatter(band, border, corner, rows[chosen], column[chosen] + r, parts[chosen, r])


def _scatter(
    band: Array, border: Array, corner: Array, rows: Integers, columns: Integers, values: Array
) -> None:
    """Add to symmetric entries of the bordered band."""
    length = band.shape[0]
    low, high = np.minimum(rows, columns), np.maximum(rows, columns)
    inside, edge = high < length, (low < length) & (high >= length)
    np.add.at(band, (low[inside], high[inside] - low[inside]), values[inside])
    np.add.at(border, (low[edge], high[edge] - length), values[edge])
    rest = low >= length
    a, b = low[rest] - length, high[rest] - length
    np.add.at(corner, (a, b), values[rest])
    twice = a != b
    np.add.at(corner, (b[twice], a[twice]), values[rest][twice])
