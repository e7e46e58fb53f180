"""Lagrange bases on the reference triangle and Legendre bases on its edges.

The reference triangle has the vertices (0, 0), (1, 0), (0, 1); its edges join the vertices 0-1, 1-2
and 0-2, in this order, which is that of scikit-fem.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

Array = NDArray[np.float64]

#: Local vertices of the edges.
EDGES = ((0, 1), (1, 2), (0, 2))
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def triangle_rule(degree: int) -> tuple[Array, Array]:
    """Return points, shape (Q, 2), and weights of a rule exact for polynomials of this degree."""
    points, weights = get_quadrature(RefTri, degree)
    return np.ascontiguousarray(points.T), np.array(weights)


def segment_rule(count: int) -> tuple[Array, Array]:
    """Return points on [0, 1] and weights of Gauss' rule."""
    x, w = leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * w


def edge_points(edge: int, t: Array, backward: bool) -> Array:
    """Return reference points, shape (len(t), 2), on an edge run through in either sense."""
    first, last = EDGES[edge]
    if backward:
        first, last = last, first
    return CORNERS[first] + t[:, None] * (CORNERS[last] - CORNERS[first])


def legendre(count: int, t: Array) -> Array:
    """Return the first Legendre polynomials on [0, 1], shape (len(t), count)."""
    return np.asarray(legvander(2.0 * t - 1.0, count - 1))


def segment_basis(degree: int, t: Array) -> Array:
    """Return derivatives by t, shape (len(t), degree + 1), of the nodal basis at i/degree."""
    nodes = np.arange(degree + 1) / degree
    vandermonde = np.vander(nodes, increasing=True)
    powers = np.arange(1, degree + 1)
    slopes = np.zeros((len(t), degree + 1))
    slopes[:, 1:] = powers * t[:, None] ** (powers - 1)
    return np.asarray(slopes @ np.linalg.inv(vandermonde), dtype=float)


@dataclass(frozen=True)
class Lagrange:
    """The nodal basis of a degree: vertices, then edges (first to last vertex), then the inside."""

    degree: int
    nodes: Array
    powers: NDArray[np.int64]
    coefficients: Array  # (monomial, basis function)

    @property
    def count(self) -> int:
        """Number of basis functions."""
        return len(self.nodes)

    def _monomials(self, points: Array, dx: int, dy: int) -> Array:
        columns = []
        for a, b in self.powers:
            if a < dx or b < dy:
                columns.append(np.zeros(len(points)))
                continue
            factor = np.prod(np.arange(a - dx + 1, a + 1)) * np.prod(np.arange(b - dy + 1, b + 1))
            columns.append(factor * points[:, 0] ** (a - dx) * points[:, 1] ** (b - dy))
        return np.array(columns).T

    def values(self, points: Array) -> Array:
        """Return the basis at points, shape (Q, count)."""
        return self._monomials(points, 0, 0) @ self.coefficients

    def gradients(self, points: Array) -> Array:
        """Return reference gradients, shape (Q, count, 2)."""
        parts = [self._monomials(points, *d) @ self.coefficients for d in ((1, 0), (0, 1))]
        return np.stack(parts, axis=-1)

    def hessians(self, points: Array) -> Array:
        """Return second reference derivatives xx, xy, yy, shape (Q, count, 3)."""
        parts = [self._monomials(points, *d) @ self.coefficients for d in ((2, 0), (1, 1), (0, 2))]
        return np.stack(parts, axis=-1)


@lru_cache
def lagrange(degree: int) -> Lagrange:
    """Return the nodal basis of a degree, with equally spaced nodes."""
    powers = np.array([(a, s - a) for s in range(degree + 1) for a in range(s, -1, -1)])
    if degree == 0:
        nodes = [CORNERS.mean(axis=0)]
    else:
        nodes = list(CORNERS)
        inner = np.arange(1, degree) / degree
        for edge in range(3):
            nodes += list(edge_points(edge, inner, False))
        nodes += [np.array([i, j]) / degree for j in range(1, degree) for i in range(1, degree - j)]
    points = np.array(nodes)
    basis = Lagrange(degree, points, powers, np.eye(len(points)))
    vandermonde = basis._monomials(points, 0, 0)
    coefficients = np.asarray(np.linalg.inv(vandermonde), dtype=float)
    return Lagrange(degree, points, powers, coefficients)
