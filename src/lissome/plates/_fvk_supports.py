"""What the edges and points of a plate hold, and the loads on edges."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._validate import finite_array
from ..errors import InvalidInput
from ._fvk_fields import Field, scalar_field, vector_field
from ._fvk_tables import EDGES, Lagrange, edge_points, segment_rule

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: What an edge can hold. "gradient" gives the slope by a vector, of which the normal part counts.
HOLDS = ("deflection", "slope", "gradient", "displacement", "displacement_x", "displacement_y")
#: Kinds of edges, and what each holds at zero.
EDGE_KINDS: dict[str, tuple[str, ...]] = {
    "free": (),
    "simply supported": ("deflection",),
    "hinged": ("deflection", "displacement"),
    "clamped": ("deflection", "slope", "displacement"),
    "sliding clamp": ("deflection", "slope"),
}
#: Quantities that have a direction.
_VECTORS = ("gradient", "displacement")


@dataclass(frozen=True)
class Hold:
    """One quantity that is held on some edges, or at a vertex.

    `what` is "deflection", "slope", "gradient", "displacement_x" or "displacement_y"; `value` gives
    numbers at positions (..., 2), vectors for a gradient. `part` is how the support was named: the
    part of the boundary as it was given, or the position (x, y) of a point.
    """

    what: str
    place: Index  # facets, or the vertex of a point
    value: Field
    label: str  # for messages
    part: Hashable


def edge_senses(mesh: Any) -> Any:
    """Return where an edge runs against the sense of its triangle, shape (T, 3).

    Edges run from the vertex of smaller to that of larger number, whatever the triangle says.
    """
    ends = np.array([mesh.t[[a, b]] for a, b in EDGES])  # (3, 2, T)
    return (ends[:, 0] > ends[:, 1]).T


def boundary_part(mesh: Any, part: Any, name: str) -> Index:
    """Return the facets of a part of the boundary: a name, "all", or a function of the midpoints."""
    boundary = np.asarray(mesh.boundary_facets(), dtype=np.int64)
    if isinstance(part, str) and part == "all":
        facets = boundary
    elif callable(part):
        middle = mesh.p[:, mesh.facets[:, boundary]].mean(axis=1)
        inside = np.broadcast_to(np.asarray(part(middle[0], middle[1])), boundary.shape)
        facets = boundary[inside.astype(bool)]
    else:
        known = mesh.boundaries or {}
        if part not in known:
            raise InvalidInput(
                f"argument `{name}` names the boundary {part!r}; the mesh knows "
                f"{sorted(known)}, and 'all'"
            )
        facets = np.intersect1d(np.asarray(known[part], dtype=np.int64), boundary)
    if not len(facets):
        raise InvalidInput(f"argument `{name}`: the part {part!r} has no edge of the boundary")
    return facets


def _fields(name: str, kind: Any) -> tuple[dict[str, Field], bool]:
    """Return fields of scalar quantities (vectors for gradients), and whether values are given."""
    values: dict[str, Any]
    if isinstance(kind, str):
        if kind not in EDGE_KINDS:
            raise InvalidInput(
                f"argument `{name}` has the kind {kind!r}; known are {sorted(EDGE_KINDS)}, a tuple "
                f"out of {HOLDS}, or a mapping from these to values"
            )
        values = dict.fromkeys(EDGE_KINDS[kind])
    elif hasattr(kind, "items"):
        values = dict(kind)
    else:
        try:
            values = dict.fromkeys(kind)
        except TypeError:
            raise InvalidInput(
                f"argument `{name}` holds {kind!r}; pass a kind of edge, a tuple out of {HOLDS}, or a "
                "mapping from these to values"
            ) from None
    if any(what not in HOLDS for what in values):
        raise InvalidInput(
            f"argument `{name}` holds {tuple(values)!r}; an edge can hold some of {HOLDS}"
        )
    given = hasattr(kind, "items")
    fields: dict[str, Field] = {}
    for what, value in values.items():
        label = f"{name}[{what}]"
        if value is None and given:
            raise InvalidInput(
                f"argument `{name}` gives {what!r} no value (None); leave it out, or hold it at a number"
            )
        number: Any = value
        if value is None:
            number = (0.0, 0.0) if what in _VECTORS else 0.0
        field = (vector_field if what in _VECTORS else scalar_field)(label, number)
        if what == "displacement":
            for i, part in enumerate(("displacement_x", "displacement_y")):
                fields[part] = _component(field, i)
        else:
            fields[what] = field
    return fields, given


def _component(field: Field, index: int) -> Field:
    return lambda x: field(x)[..., index]


def read_edges(mesh: Any, edges: Any) -> tuple[list[Hold], bool]:
    """Return what edges hold, and whether values are prescribed.

    Parameters
    ----------
    mesh : skfem.Mesh
    edges : str, tuple or mapping
        A kind for the whole boundary, or a mapping from parts of the boundary to kinds. A part is
        the name of a boundary of the mesh, "all", or a function of the midpoints, f(x, y) -> bool. A
        kind is a name of `EDGE_KINDS`, a collection out of `HOLDS`, or a mapping from `HOLDS` to values.
    """
    whole = isinstance(edges, str) or not hasattr(edges, "items")
    if not whole and edges and all(isinstance(key, str) and key in HOLDS for key in edges):
        whole = not any(key in (mesh.boundaries or {}) for key in edges)
    out: list[Hold] = []
    prescribed = False
    for part, kind in ({"all": edges} if whole else edges).items():
        fields, given = _fields("edges", kind)
        facets = boundary_part(mesh, part, "edges")
        label = f"edges[{part!r}]"
        out += [Hold(what, facets, field, label, part) for what, field in fields.items()]
        prescribed |= given
    return out, prescribed


def read_points(mesh: Any, points: Any) -> tuple[list[Hold], bool]:
    """Return what vertices hold, and whether values are prescribed."""
    if points is None:
        return [], False
    if not hasattr(points, "items"):
        raise InvalidInput(
            f"argument `points` is {points!r}; pass a mapping from positions to what is held, such as "
            '{(0.0, 0.0): {"deflection": 0.1}}'
        )
    out: list[Hold] = []
    prescribed = False
    small = 1e-9 * float(np.max(np.ptp(mesh.p[:, : mesh.nvertices], axis=1)))
    for place, kind in points.items():
        at = finite_array("points", place, shape=(2,))
        away = np.hypot(*(mesh.p[:, : mesh.nvertices] - at[:, None]))
        vertex = int(np.argmin(away))
        if away[vertex] > small:
            x, y = mesh.p[:, vertex]
            raise InvalidInput(
                f"argument `points`: no vertex of the mesh is at ({at[0]:.6g}, {at[1]:.6g}); the next "
                f"is ({x:.6g}, {y:.6g}): hold this one, or put a vertex there"
            )
        if isinstance(kind, str):
            kind = (kind,)
        fields, given = _fields("points", kind)
        if {"slope", "gradient"} & set(fields):
            raise InvalidInput(
                f"argument `points` holds a slope at ({at[0]:.6g}, {at[1]:.6g}); a point of a plate can "
                "hold a deflection or a displacement, and a slope needs an edge"
            )
        where = np.array([vertex], dtype=np.int64)
        label = f"points[({at[0]:.6g}, {at[1]:.6g})]"
        part = (float(at[0]), float(at[1]))
        out += [Hold(what, where, field, label, part) for what, field in fields.items()]
        prescribed |= given
    return out, prescribed


class HeldValues:
    """The values at which unknowns are held; refuses two values for one unknown."""

    def __init__(self, size: int) -> None:
        self.values = np.full(size, np.nan)

    def put(self, where: Index, values: Array, hold: Hold, positions: Array | None = None) -> None:
        """Hold the unknowns `where`; `positions` tell where they are, for the message."""
        before = self.values[where]
        size = max(
            float(np.nanmax(np.abs(self.values), initial=0.0)), float(np.max(np.abs(values)))
        )
        clash = np.abs(before - values) > 1e-9 * size  # False for nan
        if np.any(clash):
            i = int(np.argmax(clash))
            place = "" if positions is None else " at ({:.6g}, {:.6g})".format(*positions[i])
            raise InvalidInput(
                f"argument `{hold.label}` holds the {hold.what.replace('_', ' along ')}{place} at "
                f"{values[i]:.6g}, and another support at {before[i]:.6g}; supports that meet must agree"
            )
        self.values[where] = values

    def result(self) -> tuple[Any, Array]:
        """Return which unknowns are held, and the values (0 elsewhere)."""
        held = ~np.isnan(self.values)
        return held, np.where(held, self.values, 0.0)


def facet_sides(mesh: Any, facets: Index) -> tuple[Index, Index]:
    """Return the triangle of boundary facets, and the number of the facet in it."""
    triangles = np.asarray(mesh.f2t[0, facets], dtype=np.int64)
    return triangles, np.argmax(mesh.t2f[:, triangles] == facets, axis=0)


def edge_frames(geometry: Any, triangle: int, edge: int, t: Array, backward: bool) -> Any:
    """Return reference points, positions and derivatives by t of an edge, in the sense of the edge."""
    reference = edge_points(edge, t, backward)
    ends = edge_points(edge, np.array([0.0, 1.0]), backward)
    corners = geometry.corners[triangle]
    place = geometry.basis.values(reference) @ corners
    jacobian = np.einsum("nx,qnr->qxr", corners, geometry.basis.gradients(reference))
    return reference, place, jacobian @ (ends[1] - ends[0])


def edge_load(
    mesh: Any, geometry: Any, basis: Lagrange, local: Index, count: int, traction: Any
) -> Array:
    """Return the work of loads per length on parts of the boundary, shape (2, count)."""
    if not hasattr(traction, "items"):
        raise InvalidInput(
            f"argument `traction` is {traction!r}; pass a mapping from parts of the boundary to "
            'vectors, such as {"right": (1.0, 0.0)}'
        )
    out = np.zeros((2, count))
    t, weights = segment_rule(basis.degree + 2)
    for part, value in traction.items():
        facets = boundary_part(mesh, part, "traction")
        field = vector_field("traction", value)
        for triangle, edge in zip(*facet_sides(mesh, facets), strict=True):
            reference, place, tangent = edge_frames(geometry, triangle, int(edge), t, False)
            pull = field(place) * (weights * np.linalg.norm(tangent, axis=1))[:, None]
            out[:, local[triangle]] += pull.T @ basis.values(reference)
    return out
