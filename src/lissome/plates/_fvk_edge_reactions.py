r"""How what the edge of a plate bears is distributed along it.

What the discrete plate determines is the work of an edge on displacements of it: numbers
:math:`r(v)` for the traces v of its unknowns. Kirchhoff's plate has

.. math:: r(v) = \int f\, v\, ds + \sum_c F_c\, v(c), \qquad r(\alpha) = \int M_{nn}\, \alpha\, ds,

with forces f per length, forces :math:`F_c` in corners, and the moment :math:`M_{nn}` that goes with the
slope :math:`\alpha`. The slopes of an edge of a triangle are all polynomials of degree p - 1, and their
work is one polynomial moment of this degree. The work on bubbles of one edge of a triangle has a larger
error than that on displacements that are linear between vertices, so that f is sought among the
continuous functions that are linear between vertices, and tested by them. Where the edge ends or
has a corner, the force there takes the test of the vertex; for it, f goes straight on over the last two
edges of triangles.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from ..errors import InvalidInput
from ..reactions import EdgeReaction
from ._fvk_supports import facet_sides
from ._fvk_tables import CORNERS, EDGES, legendre

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: What is sampled on each edge of a triangle, its ends and its middle, and the weights (Simpson's).
SAMPLES = np.array([0.0, 0.5, 1.0])
WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
#: Functions that are linear on an edge, 1 at its start or its end, at the samples.
HATS = np.stack([1.0 - SAMPLES, SAMPLES], axis=-1)


@dataclass(frozen=True, eq=False)
class EdgeWork:
    """The m edges of triangles that a support holds, counterclockwise, and its work on them."""

    ends: Index  # (m, 2): vertices
    positions: Array  # (m, 3 samples, 3)
    tangents: Array  # (m, 3 samples, 2): derivatives by t in [0, 1]
    inner: Array  # (m, 2, 3): work of the nodes inside on displacements that are 1 at an end, 0 at the other
    outer: Array  # (m, 2, 3): work of the vertices, as far as it is this support's
    moments: Array  # (m, 3 samples): M_nn
    holders: Index  # (m, 3, 4): how many supports hold x, y, z, slope: on the edge, and at its ends
    support: Hashable

    def along(self, corner_angle: float) -> EdgeReaction:
        """Return how the reaction is distributed."""
        return _distributed(self, corner_angle)


def edge_work(
    plate: Any, state: Any, residual: Array, owners: Array, counts: Index, holds: list[Any]
) -> EdgeWork:
    """Return the work of a support on its edges.

    Parameters
    ----------
    plate : Plate
    state : PlateState
    residual : ndarray, shape (size,)
        Derivative of the energy by all unknowns, divided among the supports that hold them.
    owners : ndarray, shape (size,)
        How many supports hold an unknown.
    counts : ndarray of int, shape (4, edges)
        How many supports hold the displacements along x, y, z and the slope of an edge.
    holds : list of Hold
        Of one support, which is a part of the boundary.
    """
    space, mesh, facets = plate.space, plate.mesh, holds[0].place
    p, n, m = space.degree, space.nodes, len(holds[0].place)
    triangles, edges = facet_sides(mesh, facets)
    geometry = space.geometry
    ends = np.empty((m, 2), dtype=np.int64)
    positions, tangents = np.empty((m, 3, 3)), np.empty((m, 3, 2))
    for edge in range(3):
        for sign in (1.0, -1.0):
            # Edges 0-1 and 1-2 run counterclockwise around the reference triangle, 0-2 does not.
            start, end = EDGES[edge] if (sign > 0) == (edge < 2) else EDGES[edge][::-1]
            which = np.flatnonzero((edges == edge) & (geometry.sign[triangles] == sign))
            reference = CORNERS[start] + SAMPLES[:, None] * (CORNERS[end] - CORNERS[start])
            corners = geometry.corners[triangles[which]]
            ends[which] = mesh.t[[start, end]][:, triangles[which]].T
            positions[which, :, :2] = np.einsum(
                "qn,mnx->mqx", geometry.basis.values(reference), corners
            )
            jacobian = np.einsum("mnx,qnr->mqxr", corners, geometry.basis.gradients(reference))
            tangents[which] = jacobian @ (CORNERS[end] - CORNERS[start])
    # Nodes and slopes are numbered from the vertex of smaller to that of larger number.
    backward = ends[:, 0] > ends[:, 1]
    inside = mesh.nvertices + (p - 1) * facets[:, None] + np.arange(p - 1)
    inside = np.where(backward[:, None], inside[:, ::-1], inside)
    nodes = np.column_stack([ends[:, 0], inside, ends[:, 1]])
    w = plate._parts(plate._vector(state))[1]
    steps = np.arange(p + 1) / p
    trace = np.linalg.solve(np.vander(steps), np.eye(p + 1))
    positions[..., 2] = w[nodes] @ (np.vander(SAMPLES, p + 1) @ trace).T
    first = {"displacement_x": 0, "displacement_y": 1, "deflection": 2}
    held = {hold.what for hold in holds}
    inner, outer = np.zeros((m, 2, 3)), np.zeros((m, 2, 3))
    holders = np.zeros((m, 3, 4), dtype=np.int64)
    hats = np.stack([1.0 - steps, steps])[:, 1:-1]
    for what in held & set(first):
        axis = first[what]
        inner[..., axis] = residual[axis * n + inside] @ hats.T
        outer[..., axis] = residual[axis * n + ends]
        holders[:, 0, axis] = counts[axis, facets]
        holders[:, 1:, axis] = owners[axis * n + ends]
    moments = np.zeros((m, 3))
    if held - set(first):
        # The slope a(t) of the edge is the normal derivative times its length, and turns with its sense:
        # the coefficients of M_nn are (2 j + 1) times the work on Legendre's polynomials.
        sense = np.where(backward, -1.0, 1.0)[:, None]
        work = residual[3 * n + p * facets[:, None] + np.arange(p)] * (2 * np.arange(p) + 1)
        work[:, 1::2] *= sense
        moments = sense * (work @ legendre(p, SAMPLES).T)
        holders[:, :, 3] = counts[3, facets][:, None]
    return EdgeWork(ends, positions, tangents, inner, outer, moments, holders, holds[0].part)


def _chain(edges: EdgeWork, corner_angle: float) -> tuple[list[list[int]], list[bool], Index]:
    """Return smooth pieces of edges in their order, which of them are closed, and vertices between."""
    start, end = edges.ends.T
    after = {}
    for v in np.unique(edges.ends).tolist():
        leaving, coming = np.flatnonzero(start == v), np.flatnonzero(end == v)
        if len(leaving) == len(coming) == 1:
            after[int(coming[0])] = int(leaving[0])
    smooth = set()
    for i, j in after.items():
        (ax, ay), (bx, by) = edges.tangents[i, -1], edges.tangents[j, 0]
        turn = abs(np.arctan2(ax * by - ay * bx, ax * bx + ay * by))
        shared = np.vstack([edges.holders[i, [0, 2]], edges.holders[j, :2]])
        if turn <= corner_angle and np.all(shared == shared[0]):
            smooth.add(i)
    opens = set(range(len(start))) - set(after.values())
    breaks = {after[i] for i in after if i not in smooth}
    left = set(range(len(start)))
    pieces, closed = [], []
    while left:
        places = edges.positions[:, 0]
        at: int | None = min(
            left & opens or left & breaks or left, key=lambda k: (-places[k, 0], places[k, 1])
        )
        piece: list[int] = []
        while at is not None and at in left:
            left.remove(at)
            piece.append(at)
            if at not in smooth:
                pieces.append(piece)
                closed.append(False)
                piece = []
            at = after.get(at)
        if piece:  # back at its start
            pieces.append(piece)
            closed.append(True)
    split = [edges.ends[piece[k], k] for piece, ring in zip(pieces, closed, strict=True)
             if not ring for k in (0, -1)]  # fmt: skip
    return pieces, closed, np.unique(np.array(split, dtype=np.int64))


def _distributed(edges: EdgeWork, corner_angle: float) -> EdgeReaction:
    pieces, closed, split = _chain(edges, corner_angle)
    speed = np.linalg.norm(edges.tangents, axis=-1)
    weights = WEIGHTS * speed
    force = np.empty((len(speed), 3, 3))
    # The work that remains at a vertex: its own, that of the edges around, less that of the density.
    remains = dict.fromkeys(split.tolist(), np.zeros(3))
    for vertices, work in zip(edges.ends.tolist(), edges.outer, strict=True):
        for vertex, own in zip(vertices, work, strict=True):
            if vertex in remains:
                remains[vertex] = own
    for piece, ring in zip(pieces, closed, strict=True):
        m = len(piece)
        if m == 1:
            x, y = edges.positions[piece[0], 1, :2]
            raise InvalidInput(
                f"the support {edges.support!r} has a piece that is one edge of a triangle long, around "
                f"({x:.4g}, {y:.4g}): what is a force along it and what are forces at its ends cannot be "
                "told apart; refine the mesh"
            )
        size = m if ring else m + 1
        number = np.column_stack([np.arange(m), np.arange(1, m + 1) % size])
        local = np.einsum("mq,qi,qj->mij", weights[piece], HATS, HATS)
        rows, columns = np.repeat(number, 2, axis=1), np.tile(number, 2)
        mass = sparse.coo_matrix(
            (local.ravel(), (rows.ravel(), columns.ravel())), (size, size)
        ).tolil()
        work = np.zeros((size, 3))
        np.add.at(work, number, edges.inner[piece])
        work[number[:, 0]] += edges.outer[piece, 0]
        if not ring:
            work[0] = work[-1] = 0.0
            h = np.sum(weights[piece], axis=1)
            mass[0], mass[-1] = 0.0, 0.0
            if m == 2:
                mass[0, 0], mass[0, 1], mass[-1, -2], mass[-1, -1] = 1.0, -1.0, 1.0, -1.0
            else:
                for row, (a, b), three in ((0, h[:2], [0, 1, 2]), (-1, h[-2:], [-3, -2, -1])):
                    for column, value in zip(three, (1 / a, -1 / a - 1 / b, 1 / b), strict=True):
                        mass[row, column] = value * a
        nodal = splu(mass.tocsc()).solve(work)
        force[piece] = np.einsum("qi,mic->mqc", HATS, nodal[number])
        if not ring:
            for i, k in ((piece[0], 0), (piece[-1], 1)):
                density = np.einsum("q,q,qc->c", weights[i], HATS[:, k], force[i])
                vertex = int(edges.ends[i, k])
                remains[vertex] = remains[vertex] + edges.inner[i, k] - density
    order = [i for piece in pieces for i in piece]
    # A quarter of the way: the derivative by t is linear.
    quarter = np.linalg.norm(edges.tangents[:, :2].mean(axis=1), axis=-1)
    half = (speed[:, 0] + 4 * quarter + speed[:, 1]) / 12
    length = np.sum(weights, axis=1)
    reached = np.concatenate([[0.0], np.cumsum(length[order])])
    arclength = np.column_stack([reached[:-1], reached[:-1] + half[order], reached[1:]])
    moment = np.zeros_like(force)
    moment[..., :2] = -edges.moments[..., None] * edges.tangents / speed[..., None]
    places = {
        int(v): x
        for pair, x in zip(edges.ends, edges.positions[:, [0, -1]], strict=True)
        for v, x in zip(pair, x, strict=True)
    }
    return EdgeReaction(
        arclength=arclength.ravel(),
        weights=weights[order].ravel(),
        positions=edges.positions[order].reshape(-1, 3),
        force=force[order].reshape(-1, 3),
        moment=moment[order].reshape(-1, 3),
        bending_moment=edges.moments[order].ravel(),
        piece=np.repeat(np.arange(len(pieces)), [3 * len(piece) for piece in pieces]),
        point_positions=np.array([places[v] for v in split.tolist()]).reshape(-1, 3),
        point_forces=np.array([remains[v] for v in split.tolist()]).reshape(-1, 3),
        support=edges.support,
    )
