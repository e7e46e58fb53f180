"""Unknowns of the mixed scheme for plates, and what the supports hold."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ._fvk_space import Geometry, nodes_on, number_nodes
from ._fvk_supports import (
    HeldValues,
    Hold,
    edge_frames,
    edge_senses,
    facet_sides,
    read_edges,
    read_points,
)
from ._fvk_tables import lagrange, segment_basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class MixedSpace:
    """Unknowns of the mixed scheme: (u_x, u_y, w, xi_x, xi_y), and as many multipliers as xi."""

    def __init__(self, mesh: Any, orders: Any, edges: Any, points: Any = None) -> None:
        try:
            first, second = (int(order) for order in orders)
        except (TypeError, ValueError):
            first = second = 0
        if (first, second) not in ((2, 1), (2, 2)):
            raise InvalidInput(
                f"argument `orders` is {orders!r}; it must be (2, 1), degree 2 for u and 1 for the "
                "others, or (2, 2)"
            )
        self.mesh, self.orders = mesh, (first, second)
        self.geometry = Geometry(mesh)
        self.backward = edge_senses(mesh)
        self.outer, self.inner = lagrange(first), lagrange(second)
        self.outer_nodes, self.outer_local = number_nodes(mesh, first)
        self.inner_nodes, self.inner_local = number_nodes(mesh, second)
        n, k = self.outer_nodes, self.inner_nodes
        self.size = 2 * n + 3 * k
        positions = np.empty((n, 2))
        positions[self.outer_local] = self.geometry.positions(self.outer.nodes)
        self.positions = positions
        inner = np.empty((k, 2))
        inner[self.inner_local] = self.geometry.positions(self.inner.nodes)
        self.inner_positions = inner
        self.extent = float(np.max(np.ptp(positions, axis=0)))
        self._hold(edges, points)

    def _hold(self, edges: Any, points: Any) -> None:
        """Set what the supports hold."""
        n, k = self.outer_nodes, self.inner_nodes
        first, second = self.orders
        held = HeldValues(self.size)
        on_edges, prescribed = read_edges(self.mesh, edges)
        at_points, too = read_points(self.mesh, points)
        planes = {"displacement_x": 0, "displacement_y": n}
        slopes = []
        self.holders: list[tuple[Hold, Index]] = []
        for hold in on_edges:
            if hold.what in planes:
                nodes = nodes_on(self.mesh, first, hold.place)
                place = self.positions[nodes]
                held.put(planes[hold.what] + nodes, hold.value(place), hold, place)
                self.holders.append((hold, planes[hold.what] + nodes))
            elif hold.what == "deflection":
                nodes = nodes_on(self.mesh, second, hold.place)
                place = self.inner_positions[nodes]
                held.put(2 * n + nodes, hold.value(place), hold, place)
                self.holders.append((hold, 2 * n + nodes))
            else:
                slopes.append(hold)
                nodes = nodes_on(self.mesh, second, hold.place) + 2 * n
                self.holders.append((hold, np.concatenate([nodes + k, nodes + 2 * k])))
        for hold in at_points:
            place = self.positions[hold.place]
            where = planes.get(hold.what, 2 * n) + hold.place
            held.put(where, hold.value(place), hold, place)
            self.holders.append((hold, where))
        if slopes:
            nodes, xi = self._held_slopes(slopes, held.values[2 * n : 2 * n + k])
            for axis in range(2):
                held.put(2 * n + (1 + axis) * k + nodes, xi[:, axis], slopes[0])
        self.fixed, self.values = held.result()
        self.prescribed: bool = prescribed or too
        self.free: Index = np.flatnonzero(~self.fixed)
        # Where xi is held it needs no multiplier.
        self.loose: Index = np.flatnonzero(~self.fixed[2 * n + k :])

    def _held_slopes(self, holds: list[Hold], deflection: Array) -> tuple[Index, Array]:
        """Return the nodes of edges that hold slopes, and xi there: normal and tangential parts.

        The tangential part is that of the deflection. Where edges meet, and where the deflection has a
        kink, xi fits all of them best.
        """
        k, order = self.inner_nodes, self.orders[1]
        t = np.arange(order + 1) / order
        along = segment_basis(order, t)
        matrix, right = np.zeros((k, 2, 2)), np.zeros((k, 2))
        for hold in holds:
            for facet, triangle, edge in zip(
                hold.place, *facet_sides(self.mesh, hold.place), strict=True
            ):
                backward = bool(self.backward[triangle, edge])
                _, place, tangent = edge_frames(self.geometry, triangle, int(edge), t, backward)
                nodes = np.empty(order + 1, dtype=np.int64)
                nodes[[0, -1]] = self.mesh.facets[:, facet]
                nodes[1:-1] = self.mesh.nvertices + (order - 1) * facet + np.arange(order - 1)
                if np.any(np.isnan(deflection[nodes])):
                    raise InvalidInput(
                        f"argument `{hold.label}` holds a slope but not the deflection; the mixed "
                        "scheme holds both or none"
                    )
                length = np.linalg.norm(tangent, axis=1)
                normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
                normal *= (self._outward(triangle, int(edge), backward) / length)[:, None]
                value = hold.value(place)
                if hold.what == "gradient":
                    value = np.sum(value * normal, axis=1)
                run = along @ deflection[nodes] / length
                unit = tangent / length[:, None]
                for row, number in ((normal, value), (unit, run)):
                    matrix[nodes] += row[:, :, None] * row[:, None, :]
                    right[nodes] += row * number[:, None]
        found = np.flatnonzero(matrix[:, 0, 0] + matrix[:, 1, 1] > 0)
        xi = np.linalg.solve(matrix[found], right[found][..., None])[..., 0]
        return np.asarray(found, dtype=np.int64), np.asarray(xi, dtype=float)

    def _outward(self, triangle: int, edge: int, backward: bool) -> Array:
        """+1 where the tangent of an edge, turned by -90 degrees, points outward, else -1."""
        sense = (-1.0 if backward else 1.0) * (1.0, 1.0, -1.0)[edge]
        return np.full(self.orders[1] + 1, sense * self.geometry.sign[triangle])

    def with_supports(self, edges: Any, points: Any) -> MixedSpace:
        """Return the same space with other supports."""
        other = copy.copy(self)
        other._hold(edges, points)
        return other
