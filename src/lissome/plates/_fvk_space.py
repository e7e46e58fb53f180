r"""Discretization of a plate by triangles: degrees of freedom, geometry, discrete curvatures.

Deflection w and displacement u are continuous, piecewise polynomial of degree p. Each edge has p more
unknowns: the slope :math:`a = N \cdot \nabla w` across it, a polynomial of degree p - 1 of the
parameter t of the edge, where N is the derivative of the edge by t, turned by a right angle (so that
a is a polynomial also on a curved edge when the plate is tilted). On each triangle T the curvature is
the polynomial tensor of degree p - 1 that fits the distribution :math:`\nabla\nabla w`,

.. math:: \int_T M : \kappa_h = \int_T M : \nabla\nabla w
    - \int_{\partial T} M_{nn} (\partial_n w - \alpha) \quad \text{for all M},

with the slope :math:`\alpha` of the edge. With the moments as unknowns, this is the hybridized method
of Hellan, Herrmann and Johnson: the moments are found triangle by triangle, what remains is a minimum
principle for (w, a), and the slopes make the normal moments continuous.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse

from ..errors import InvalidInput
from ._fvk_supports import (
    HeldValues,
    Hold,
    edge_frames,
    edge_load,
    edge_senses,
    facet_sides,
    read_edges,
    read_points,
)
from ._fvk_tables import (
    Lagrange,
    edge_points,
    lagrange,
    legendre,
    segment_rule,
    triangle_rule,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Points:
    """Geometry at quadrature points of all triangles: T triangles, Q points."""

    x: Array  # (T, Q, 2)
    weights: Array  # (T, Q)
    inverse: Array  # (T, Q, 2, 2): d(reference)/d(physical)


def check_mesh(mesh: Any) -> None:
    """Raise if a mesh is not one of connected, proper triangles."""
    if not isinstance(mesh, (skfem.MeshTri1, skfem.MeshTri2)):
        raise InvalidInput(
            f"argument `mesh` is of type {type(mesh).__name__}; it must be a scikit-fem mesh of "
            "triangles, MeshTri or (with curved edges) MeshTri2"
        )
    if not np.all(np.isfinite(mesh.doflocs)):
        raise InvalidInput("argument `mesh` has vertices that are not finite numbers")
    used = np.unique(mesh.t)
    if len(used) != mesh.nvertices:
        raise InvalidInput(
            f"argument `mesh` has {mesh.nvertices - len(used)} vertices that belong to no triangle; "
            "remove them (scikit-fem: `mesh.remove_unused_nodes()`)"
        )
    touching = np.bincount(mesh.t2f.ravel(), minlength=mesh.facets.shape[1])
    if np.any(touching > 2):
        raise InvalidInput(
            f"argument `mesh` has {np.count_nonzero(touching > 2)} edges shared by more than two "
            "triangles; triangles overlap or are given twice"
        )
    # Triangles that meet at a vertex alone hang together by a hinge: they do not touch either.
    inner = np.flatnonzero(touching == 2)
    links = sparse.coo_matrix(
        (np.ones(len(inner)), tuple(mesh.f2t[:, inner])), shape=(mesh.t.shape[1],) * 2
    )
    parts, _ = sparse.csgraph.connected_components(links, directed=False)
    if parts > 1:
        raise InvalidInput(
            f"argument `mesh` has {parts} parts that do not touch along an edge; solve each as a plate "
            "of its own, or give them common vertices and edges"
        )
    corners = mesh.p[:, mesh.t]  # (2, 3, T)
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = ahead[0] * back[1] - ahead[1] * back[0]
    angles = np.arctan2(np.abs(cross), np.sum(ahead * back, axis=0))
    around = np.bincount(mesh.t.ravel(), weights=angles.ravel(), minlength=mesh.nvertices)
    # Seen from an inner edge, its two triangles lie on different sides.
    ends = mesh.p[:, mesh.facets[:, inner]]
    along = ends[:, 1] - ends[:, 0]
    sides = []
    for triangle in mesh.f2t[:, inner]:
        middle = corners[:, :, triangle].mean(axis=1) - ends[:, 0]
        sides.append(along[0] * middle[1] - along[1] * middle[0])
    folded = sides[0] * sides[1] > 0
    if np.any(folded) or np.any(around > 2 * np.pi * (1 + 1e-9)):
        x, y = (
            ends[:, :, np.argmax(folded)].mean(axis=1)
            if np.any(folded)
            else mesh.p[:, int(np.argmax(around))]
        )
        raise InvalidInput(
            f"argument `mesh` has triangles that overlap, next to ({x:.4g}, {y:.4g}); a plate is flat "
            "and covers each place once"
        )


class Geometry:
    """The map from the reference triangle to the triangles of a mesh: affine or quadratic."""

    def __init__(self, mesh: Any) -> None:
        check_mesh(mesh)
        self.mesh = mesh
        self.basis: Lagrange = lagrange(2 if isinstance(mesh, skfem.MeshTri2) else 1)
        nodes = mesh.dofs.element_dofs if self.basis.degree == 2 else mesh.t
        self.corners: Array = np.ascontiguousarray(mesh.doflocs[:, nodes].transpose(2, 1, 0))
        centre = self.basis.gradients(np.array([[1 / 3, 1 / 3]]))
        jacobian = np.einsum("tnx,qnr->tqxr", self.corners, centre)[:, 0]
        self.sign: Array = np.sign(np.linalg.det(jacobian))
        points = np.vstack([edge_points(e, np.linspace(0, 1, 5), False) for e in range(3)])
        jacobian = np.einsum("tnx,qnr->tqxr", self.corners, self.basis.gradients(points))
        area = np.linalg.det(jacobian) * self.sign[:, None]
        size = np.max(np.linalg.norm(jacobian, axis=(2, 3)), axis=1) ** 2
        bad = np.flatnonzero(np.min(area, axis=1) <= 1e-8 * size)
        if len(bad):
            x, y = self.corners[bad[0], :3].mean(axis=0)
            raise InvalidInput(
                f"argument `mesh` has {len(bad)} degenerate triangles, the first at ({x:.4g}, "
                f"{y:.4g}): its area vanishes, or its curved edges cross"
            )

    def positions(self, points: Array) -> Array:
        """Return positions, shape (T, Q, 2), of reference points (Q, 2)."""
        return np.einsum("tnx,qn->tqx", self.corners, self.basis.values(points))

    def jacobians(self, points: Array) -> Array:
        """Return d(physical)/d(reference), shape (T, Q, 2, 2)."""
        return np.einsum("tnx,qnr->tqxr", self.corners, self.basis.gradients(points))

    def at(self, points: Array, weights: Array) -> Points:
        """Return the geometry at quadrature points."""
        jacobian = self.jacobians(points)
        area = np.asarray(np.abs(np.linalg.det(jacobian)), dtype=float)
        inverse = np.asarray(np.linalg.inv(jacobian), dtype=float)
        return Points(self.positions(points), area * weights, inverse)


def number_nodes(mesh: Any, degree: int) -> tuple[int, Index]:
    """Return the number of nodes of a continuous field, and those of each triangle (T, n)."""
    p, backward = degree, edge_senses(mesh)
    facets, vertices, triangles = mesh.facets.shape[1], int(mesh.nvertices), mesh.t.shape[1]
    inside = (p - 1) * (p - 2) // 2
    columns = [mesh.t.T]
    for edge in range(3):
        steps = np.broadcast_to(np.arange(p - 1), (triangles, p - 1))
        steps = np.where(backward[:, edge, None], p - 2 - steps, steps)
        columns.append(vertices + (p - 1) * mesh.t2f[edge][:, None] + steps)
    first = vertices + (p - 1) * facets
    columns.append(first + np.arange(inside * triangles).reshape(triangles, inside))
    nodes = np.ascontiguousarray(np.hstack(columns), dtype=np.int64)
    return first + inside * triangles, nodes


def nodes_on(mesh: Any, degree: int, facets: Index) -> Index:
    """Return the nodes of a continuous field on given edges."""
    middle = int(mesh.nvertices) + (degree - 1) * facets[:, None] + np.arange(degree - 1)
    return np.unique(np.concatenate([mesh.facets[:, facets].ravel(), middle.ravel()]))


class PlateSpace:
    """Degrees of freedom of a plate on a mesh; everything that does not depend on the material.

    The vector of all unknowns is (u_x at the nodes, u_y, w, slopes of the edges).

    Parameters
    ----------
    mesh : skfem.MeshTri or skfem.MeshTri2
    degree : int
        Degree p of deflection and displacement, 2 or 3.
    edges, points : mapping
        What is held, see :class:`lissome.plates.Plate`.

    Attributes
    ----------
    fixed : ndarray of bool, shape (size,)
        Which unknowns are held.
    values : ndarray, shape (size,)
        The values at which they are held; 0 elsewhere.
    prescribed : bool
        Whether values were given, be they zero.
    holders : list of (Hold, ndarray of int)
        What holds which unknowns.
    """

    def __init__(self, mesh: Any, degree: int, edges: Any, points: Any = None) -> None:
        if isinstance(degree, (bool, np.ndarray)) or degree not in (2, 3):
            raise InvalidInput(f"argument `degree` is {degree!r}; it must be 2 or 3")
        self.mesh = mesh
        self.degree = p = int(degree)
        self.geometry = Geometry(mesh)
        self.basis = lagrange(p)
        self.backward = edge_senses(mesh)
        self.nodes, self.scalar = number_nodes(mesh, p)
        self.size: int = 3 * self.nodes + p * mesh.facets.shape[1]
        slopes = 3 * self.nodes + p * mesh.t2f.T[:, :, None] + np.arange(p)
        self.slopes: Index = slopes.reshape(len(slopes), 3 * p)
        self.local: Index = np.hstack(
            [self.scalar, self.scalar + self.nodes, self.scalar + 2 * self.nodes, self.slopes]
        )
        self._hold(edges, points)

    def _hold(self, edges: Any, points: Any) -> None:
        """Set what the supports hold."""
        p, n = self.degree, self.nodes
        held = HeldValues(self.size)
        on_edges, prescribed = read_edges(self.mesh, edges)
        at_points, too = read_points(self.mesh, points)
        first = {"displacement_x": 0, "displacement_y": n, "deflection": 2 * n}
        self.holders: list[tuple[Hold, Index]] = []
        for hold in on_edges:
            if hold.what in first:
                nodes = nodes_on(self.mesh, p, hold.place)
                place = self.positions[nodes]
                unknowns = first[hold.what] + nodes
                held.put(unknowns, hold.value(place), hold, place)
            else:
                unknowns = (3 * n + p * hold.place[:, None] + np.arange(p)).ravel()
                held.put(unknowns, self._held_slopes(hold).ravel(), hold)
            self.holders.append((hold, unknowns))
        for hold in at_points:
            place = self.positions[hold.place]
            held.put(first[hold.what] + hold.place, hold.value(place), hold, place)
            self.holders.append((hold, first[hold.what] + hold.place))
        self.fixed, self.values = held.result()
        self.prescribed: bool = prescribed or too
        self.free: Index = np.flatnonzero(~self.fixed)
        if not len(self.free):
            raise InvalidInput("argument `edges` holds everything; the plate has no unknown left")

    def with_supports(self, edges: Any, points: Any) -> PlateSpace:
        """Return the same space with other supports; what does not depend on them is shared."""
        other = copy.copy(self)
        other._hold(edges, points)
        if not np.array_equal(other.fixed, self.fixed):
            other.__dict__.pop("pattern", None)
        return other

    def _held_slopes(self, hold: Hold) -> Array:
        """Return the slopes that fit a prescribed normal derivative or gradient, shape (facets, p)."""
        p, facets = self.degree, hold.place
        t, weights = segment_rule(p + 3)
        test = legendre(p, t) * weights[:, None] * (2 * np.arange(p) + 1)
        out = np.empty((len(facets), p))
        for i, (triangle, edge) in enumerate(zip(*facet_sides(self.mesh, facets), strict=True)):
            backward = bool(self.backward[triangle, edge])
            _, place, tangent = edge_frames(self.geometry, triangle, int(edge), t, backward)
            value = hold.value(place)
            if hold.what == "gradient":
                slope = value[:, 0] * tangent[:, 1] - value[:, 1] * tangent[:, 0]
            else:
                slope = value * np.linalg.norm(tangent, axis=1) * self.outward[triangle, edge]
            out[i] = slope @ test
        return out

    def edge_load(self, traction: Any) -> Array:
        """Return the work of loads per length on parts of the boundary, shape (size,)."""
        out = np.zeros(self.size)
        load = edge_load(self.mesh, self.geometry, self.basis, self.scalar, self.nodes, traction)
        out[: 2 * self.nodes] = load.ravel()
        return out

    @cached_property
    def positions(self) -> Array:
        """Positions of the nodes, shape (nodes, 2)."""
        out = np.empty((self.nodes, 2))
        out[self.scalar] = self.geometry.positions(self.basis.nodes)
        return out

    @cached_property
    def extent(self) -> float:
        """Largest side of the box around the mesh."""
        return float(np.max(np.ptp(self.positions, axis=0)))

    @cached_property
    def area(self) -> float:
        """Area of the mesh."""
        points, weights = triangle_rule(2)
        return float(np.sum(self.geometry.at(points, weights).weights))

    def gradients(self, points: Array, geometry: Points) -> Array:
        """Return physical gradients of the basis, shape (T, Q, nodes of a triangle, 2)."""
        return np.einsum("qnr,tqrx->tqnx", self.basis.gradients(points), geometry.inverse)

    def normals(self, t: Array) -> Array:
        """Return the turned derivatives N of all edges of all triangles, shape (T, 3, len(t), 2).

        In the sense of the edge, not of the triangle.
        """
        out = np.empty((len(self.scalar), 3, len(t), 2))
        for edge in range(3):
            for backward in (False, True):
                chosen = self.backward[:, edge] == backward
                points = edge_points(edge, t, backward)
                ends = edge_points(edge, np.array([0.0, 1.0]), backward)
                jacobian = np.einsum(
                    "tnx,qnr->tqxr", self.geometry.corners[chosen],
                    self.geometry.basis.gradients(points),
                )  # fmt: skip
                tangent = jacobian @ (ends[1] - ends[0])
                out[chosen, edge, :, 0] = tangent[..., 1]
                out[chosen, edge, :, 1] = -tangent[..., 0]
        return out

    @cached_property
    def outward(self) -> Array:
        """+1 where N of an edge points out of the triangle, else -1; shape (T, 3)."""
        # Edges 0-1 and 1-2 run counterclockwise around the reference triangle, 0-2 does not; a
        # turn by -90 degrees of a counterclockwise tangent points outward.
        sense = np.where(self.backward, -1.0, 1.0) * np.array([1.0, 1.0, -1.0])
        return sense * self.geometry.sign[:, None]

    def _second_derivatives(self, points: Array, geometry: Points) -> Array:
        """Return physical second derivatives xx, xy, yy of the basis, shape (T, Q, n, 3)."""
        second = self.basis.hessians(points)  # (Q, n, 3)
        bent = np.einsum("tnx,qnr->tqxr", self.geometry.corners,
                         self.geometry.basis.hessians(points))  # fmt: skip
        first = self.gradients(points, geometry)
        total = second[None] - np.einsum("tqnx,tqxr->tqnr", first, bent)
        full = np.stack([total[..., [0, 1]], total[..., [1, 2]]], axis=-2)
        inverse = geometry.inverse
        physical = np.einsum("tqri,tqnrs,tqsj->tqnij", inverse, full, inverse, optimize=True)
        return np.stack([physical[..., 0, 0], physical[..., 0, 1], physical[..., 1, 1]], axis=-1)

    @cached_property
    def curvature_rule(self) -> tuple[Array, Array]:
        """Quadrature of the moments: exact for their squares on straight triangles."""
        return triangle_rule(2 * self.degree)

    @cached_property
    def moment_basis(self) -> Array:
        """Scalar basis of the moments at `curvature_rule`, shape (Q, polynomials)."""
        return lagrange(self.degree - 1).values(self.curvature_rule[0])

    @cached_property
    def curvature_points(self) -> Points:
        """Geometry at `curvature_rule`."""
        return self.geometry.at(*self.curvature_rule)

    @cached_property
    def curvature_matrix(self) -> Array:
        r"""Integrals of M against the distribution :math:`\nabla\nabla w`, triangle by triangle.

        Shape (T, 3 k, n + 3 p): rows are (xx, xy, yy) of the k polynomials of the moments, where the
        component xy is counted twice in M : kappa; columns are nodes and slopes.
        """
        p, n = self.degree, self.basis.count
        scalar = lagrange(p - 1)
        k = scalar.count
        triangles = len(self.scalar)
        points, _ = self.curvature_rule
        geometry = self.curvature_points
        out = np.zeros((triangles, k, 3, n + 3 * p))
        second = self._second_derivatives(points, geometry) * np.array([1.0, 2.0, 1.0])
        out[..., :n] = np.einsum(
            "tq,qk,tqnc->tkcn", geometry.weights, self.moment_basis, second, optimize=True
        )
        # On curved edges the integrand is rational: two points more.
        t, weights = segment_rule(p + 1 + 2 * (self.geometry.basis.degree - 1))
        normal = self.normals(t)
        along = legendre(p, t)
        length2 = np.sum(normal**2, axis=-1)
        both = np.stack(
            [normal[..., 0] ** 2, 2 * normal[..., 0] * normal[..., 1], normal[..., 1] ** 2], -1
        )
        both *= (self.outward[:, :, None] * weights / length2)[..., None]
        for edge in range(3):
            for backward in (False, True):
                chosen = np.flatnonzero(self.backward[:, edge] == backward)
                reference = edge_points(edge, t, backward)
                jacobian = np.einsum(
                    "tnx,qnr->tqxr", self.geometry.corners[chosen],
                    self.geometry.basis.gradients(reference),
                )  # fmt: skip
                gradient = np.einsum(
                    "qnr,tqrx->tqnx", self.basis.gradients(reference), np.linalg.inv(jacobian)
                )
                slope = np.einsum("tqnx,tqx->tqn", gradient, normal[chosen, edge])
                moment = scalar.values(reference)
                factor = both[chosen, edge]
                out[chosen, :, :, :n] -= np.einsum("qk,tqc,tqn->tkcn", moment, factor, slope)
                columns = slice(n + edge * p, n + (edge + 1) * p)
                out[chosen, :, :, columns] += np.einsum("qk,tqc,qj->tkcj", moment, factor, along)
        return out.reshape(triangles, 3 * k, n + 3 * p)

    @cached_property
    def mass(self) -> Array:
        """Diagonal metric of all unknowns, shape (size,): areas, and for slopes length squared."""
        points, weights = triangle_rule(2 * self.degree)
        geometry = self.geometry.at(points, weights)
        nodal = np.zeros(self.nodes)
        squares = np.einsum("tq,qn->tn", geometry.weights, self.basis.values(points) ** 2)
        np.add.at(nodal, self.scalar, squares)
        ends = self.mesh.p[:, self.mesh.facets]
        length2 = np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=0)
        return np.concatenate([np.tile(nodal, 3), np.repeat(length2 / 12, self.degree)])

    @cached_property
    def tilt(self) -> tuple[Array, Array]:
        """Slopes of the plate w = x and of w = y, two vectors of shape (p facets,)."""
        t, weights = segment_rule(self.degree + 1)
        normal = self.normals(t)
        # Legendre coefficients on [0, 1]: (2 j + 1) times the integral.
        test = legendre(self.degree, t) * weights[:, None] * (2 * np.arange(self.degree) + 1)
        out = np.zeros((2, self.size - 3 * self.nodes))
        for axis in range(2):
            out[axis][self.slopes - 3 * self.nodes] = np.einsum(
                "teq,qj->tej", normal[..., axis], test
            ).reshape(len(self.slopes), -1)
        return out[0], out[1]

    def slopes_of(self, deflection: Array) -> Array:
        """Return the slopes that fit nodal deflections: means over both sides of each edge."""
        p = self.degree
        t, weights = segment_rule(p + 1)
        normal = self.normals(t)
        test = legendre(p, t) * weights[:, None] * (2 * np.arange(p) + 1)
        total = np.zeros(self.size - 3 * self.nodes)
        count = np.zeros_like(total)
        values = deflection[self.scalar]
        for edge in range(3):
            for backward in (False, True):
                chosen = np.flatnonzero(self.backward[:, edge] == backward)
                reference = edge_points(edge, t, backward)
                jacobian = np.einsum(
                    "tnx,qnr->tqxr", self.geometry.corners[chosen],
                    self.geometry.basis.gradients(reference),
                )  # fmt: skip
                gradient = np.einsum(
                    "tn,qnr,tqrx->tqx", values[chosen], self.basis.gradients(reference),
                    np.linalg.inv(jacobian), optimize=True,
                )  # fmt: skip
                slope = np.einsum("tqx,tqx,qj->tj", gradient, normal[chosen, edge], test)
                where = self.slopes[chosen, edge * p : (edge + 1) * p] - 3 * self.nodes
                np.add.at(total, where, slope)
                np.add.at(count, where, 1.0)
        return total / count

    @cached_property
    def pattern(self) -> tuple[Any, Any, Any]:
        """Pattern of the Hessian of the free unknowns: indptr, indices, place of local entries.

        The place of entry (i, j) of triangle t in the data, shape (T, n, n), is -1 where an unknown
        is held.
        """
        place = np.full(self.size, -1, dtype=np.int64)
        n = len(self.free)
        place[self.free] = np.arange(n)
        return sparse_pattern(place[self.local], n)


def sparse_pattern(local: Index, n: int) -> tuple[Any, Any, Any]:
    """Return indptr, indices and the places of local entries of a symmetric sparse matrix."""
    rows = np.broadcast_to(local[:, :, None], (*local.shape, local.shape[1]))
    columns = rows.transpose(0, 2, 1)
    inside = (rows >= 0) & (columns >= 0)
    key = columns[inside] * n + rows[inside]
    # A matrix of ones sorts the entries faster than `unique` does.
    ones = sparse.coo_matrix(
        (np.ones(len(key), dtype=np.int8), (rows[inside], columns[inside])), shape=(n, n)
    ).tocsc()
    ones.sort_indices()
    indptr, indices = ones.indptr.astype(np.int64), ones.indices.astype(np.int64)
    keys = np.repeat(np.arange(n), np.diff(indptr)) * n + indices
    where = np.full(rows.shape, -1, dtype=np.int64)
    where[inside] = np.searchsorted(keys, key)
    return indptr, indices, where


def scatter(rows: Index, columns: Index, local: Array, shape: tuple[int, int]) -> Any:
    """Assemble local matrices (T, a, b) into a sparse matrix."""
    a = np.broadcast_to(rows[:, :, None], local.shape)
    b = np.broadcast_to(columns[:, None, :], local.shape)
    return sparse.coo_matrix((local.ravel(), (a.ravel(), b.ravel())), shape=shape).tocsr()
