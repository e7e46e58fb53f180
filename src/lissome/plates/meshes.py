"""Meshes of triangles for plates: rectangles and discs, graded to a defect; files; slits.

Any other mesh of scikit-fem will do (``skfem.MeshTri``, or ``skfem.MeshTri2`` with curved edges).
"""

from __future__ import annotations

import contextlib
import io
import os
from typing import Any

import numpy as np
import skfem
from numpy.typing import ArrayLike, NDArray

from .._validate import finite_array, in_open_interval, integer_at_least, positive
from ..errors import DataError, InvalidInput

__all__ = ["disc", "from_file", "rectangle", "with_slit"]

Array = NDArray[np.float64]


def _fan(starts: Any, count: int, grading: float) -> tuple[Array, Array, Any]:
    """Return sector, ring and fraction along the ring of the vertices, and triangles.

    The sectors of a fan are divided into `count` squared triangles each.
    """
    sectors = starts
    vertices: list[tuple[int, int, int]] = [(0, 0, 0)]
    number = {(0, 0): 0}
    for ring in range(1, count + 1):
        for along in range(sectors * ring):
            number[ring, along] = len(vertices)
            vertices.append((ring, along // ring, along % ring))
    triangles = []
    for sector in range(sectors):
        for ring in range(1, count + 1):

            def at(i: int, j: int, sector: int = sector) -> int:
                return number[i, (sector * i + j) % (sectors * i) if i else 0]

            for j in range(ring):
                triangles.append((at(ring - 1, j), at(ring, j), at(ring, j + 1)))
                if j < ring - 1:
                    triangles.append((at(ring - 1, j), at(ring, j + 1), at(ring - 1, j + 1)))
    array = np.array(vertices, dtype=float)
    radius = (array[:, 0] / count) ** grading
    fraction = array[:, 2] / np.maximum(array[:, 0], 1.0)
    return radius, array[:, 1] + fraction, np.array(triangles).T


def rectangle(
    width: float = 1.0,
    height: float | None = None,
    divisions: int = 8,
    *,
    center: ArrayLike = (0.0, 0.0),
    grading: float = 1.5,
) -> Any:
    """Return a rectangle around the origin, a fan of triangles graded to a point.

    The point is a vertex. The mesh is symmetric where the point allows it: to both axes and, for a
    square, to the diagonals.

    Parameters
    ----------
    width, height : float
        Sides; a square by default.
    divisions : int
        Parts of each of the eight sectors: 8 divisions^2 triangles.
    center : array_like, shape (2,)
        The point, for instance a defect; inside of the rectangle.
    grading : float
        Rings of triangles are at distances in proportion to (i/divisions)**grading; 1 for equal
        steps.

    Returns
    -------
    skfem.MeshTri
        With the boundaries "left", "right", "bottom", "top".

    Raises
    ------
    InvalidInput
        If an argument is out of its range, or the point is outside.

    Examples
    --------
    >>> from lissome.plates.meshes import rectangle
    >>> mesh = rectangle(2.0, 1.0, 4, center=(0.3, 0.1))
    >>> mesh.t.shape, sorted(mesh.boundaries)
    ((3, 128), ['bottom', 'left', 'right', 'top'])
    """
    width = positive("width", width)
    height = width if height is None else positive("height", height)
    n = integer_at_least("divisions", divisions, 1)
    grading = positive("grading", grading)
    c = finite_array("center", center, shape=(2,))
    in_open_interval("center[0]", c[0], -width / 2, width / 2, "the point lies in the rectangle")
    in_open_interval("center[1]", c[1], -height / 2, height / 2, "the point lies in the rectangle")
    a, b = width / 2, height / 2
    corners = np.array(
        [[a, c[1]], [a, b], [c[0], b], [-a, b], [-a, c[1]], [-a, -b], [c[0], -b], [a, -b]]
    )
    radius, along, triangles = _fan(8, n, grading)
    sector = along.astype(int) % 8
    part = (along - np.floor(along))[:, None]
    rim = (1 - part) * corners[sector] + part * corners[(sector + 1) % 8]
    points = c + radius[:, None] * (rim - c)
    mesh = skfem.MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles))
    small = 1e-9 * max(a, b)
    return mesh.with_boundaries(
        {
            "left": lambda x: np.abs(x[0] + a) < small,
            "right": lambda x: np.abs(x[0] - a) < small,
            "bottom": lambda x: np.abs(x[1] + b) < small,
            "top": lambda x: np.abs(x[1] - b) < small,
        }
    )


def disc(
    radius: float = 1.0,
    divisions: int = 8,
    *,
    center: ArrayLike = (0.0, 0.0),
    grading: float = 1.5,
    sectors: int = 6,
) -> Any:
    """Return a disc around the origin with a curved edge, graded to a point.

    Parameters
    ----------
    radius : float
        Of the disc.
    divisions : int
        Parts of each sector: sectors divisions^2 triangles.
    center : array_like, shape (2,)
        The point to which the mesh is graded, inside of the disc; a vertex.
    grading : float
        Rings of triangles are at distances in proportion to (i/divisions)**grading.
    sectors : int
        Triangles around the point, at least 4.

    Returns
    -------
    skfem.MeshTri2
        The edges of the rim are parabolas.

    Raises
    ------
    InvalidInput
        If an argument is out of its range, or the point is outside.

    Examples
    --------
    >>> from lissome.plates.meshes import disc
    >>> disc(2.0, 4).t.shape
    (3, 96)
    """
    radius = positive("radius", radius)
    n = integer_at_least("divisions", divisions, 1)
    grading = positive("grading", grading)
    sectors = integer_at_least("sectors", sectors, 4)
    c = finite_array("center", center, shape=(2,))
    if not np.hypot(*c) < radius:
        raise InvalidInput(
            f"argument `center` is ({c[0]:.4g}, {c[1]:.4g}); it must lie inside of the disc of "
            f"radius {radius:.4g}"
        )
    ring, along, triangles = _fan(sectors, n, grading)
    angle = 2 * np.pi * along / sectors
    rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = c + ring[:, None] * (rim - c)
    straight = skfem.MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(triangles))
    curved = skfem.MeshTri2.from_mesh(straight)
    nodes = curved.doflocs.copy()
    for facet in straight.boundary_facets():
        middle = points[straight.facets[:, facet]].mean(axis=0)
        nodes[:, straight.nvertices + facet] = radius * middle / np.hypot(*middle)
    return skfem.MeshTri2(nodes, curved.t)


def from_file(path: str | os.PathLike[str]) -> Any:
    """Read a mesh of triangles from any file that meshio reads.

    Parameters
    ----------
    path : path
        The file; a third coordinate must vanish. Triangles with three nodes make a MeshTri, those
        with six a MeshTri2. Named sets of lines (and Gmsh's physical curves) on the boundary become
        named boundaries, for the supports of a plate.

    Returns
    -------
    skfem.MeshTri or skfem.MeshTri2

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    DataError
        If the file cannot be read, or holds no triangles or triangles that are not in the plane; if
        its format needs a package that is missing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import meshio
    >>> from lissome.plates.meshes import from_file
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "square.vtk"
    ...     meshio.write_points_cells(file, corners, [("triangle", [[0, 1, 2], [1, 3, 2]])])
    ...     mesh = from_file(file)
    >>> mesh.t.shape, mesh.boundary_facets().size
    ((3, 2), 4)
    """
    import meshio

    if not os.path.exists(path):
        raise FileNotFoundError(f"there is no file {path}")
    said = io.StringIO()  # meshio prints, and ends the process, instead of raising
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            stored = meshio.read(path)
    except ImportError as error:
        raise DataError(
            f"to read {path}, meshio needs the package {error.name}: install it, or convert the file"
        ) from error
    except (Exception, SystemExit) as error:  # each reader of meshio has failures of its own
        why = " ".join(said.getvalue().split()) if isinstance(error, SystemExit) else str(error)
        why = why or type(error).__name__
        raise DataError(
            f"the file {path} is not a mesh that meshio can read ({why}); write it anew, for example "
            "as .msh or .vtk"
        ) from error
    kinds = {block.type for block in stored.cells}
    wanted = "triangle6" if "triangle6" in kinds else "triangle"
    if wanted not in kinds:
        raise DataError(f"the mesh {path} holds {sorted(kinds)}; a plate is made of triangles")
    if "triangle6" in kinds and "triangle" in kinds:
        raise DataError(f"the mesh {path} mixes triangles with three and with six nodes")
    points = np.asarray(stored.points, dtype=float)
    if points.shape[1] > 2 and np.ptp(points[:, 2]) > 1e-9 * np.max(np.ptp(points, axis=0)):
        raise DataError(f"the mesh {path} does not lie in the plane of x and y")
    cells = np.vstack([block.data for block in stored.cells if block.type == wanted])
    used, new = np.unique(cells[:, :3], return_inverse=True)
    corners = new.reshape(-1, 3)
    straight = skfem.MeshTri(
        np.ascontiguousarray(points[used, :2].T), np.ascontiguousarray(corners.T)
    )
    number = {tuple(sorted(pair)): i for i, pair in enumerate(straight.facets.T.tolist())}
    vertex = {int(node): i for i, node in enumerate(used)}
    rim = set(straight.boundary_facets().tolist())
    boundaries = {}
    for name, lines in _named_lines(stored).items():
        pairs = [tuple(sorted((vertex.get(a, -1), vertex.get(b, -1)))) for a, b in lines.tolist()]
        facets = sorted(rim & {number[pair] for pair in pairs if pair in number})
        if facets:
            boundaries[name] = np.array(facets)
    if wanted == "triangle":
        return straight.with_boundaries(boundaries) if boundaries else straight
    curved = skfem.MeshTri2.from_mesh(straight)
    nodes = curved.doflocs.copy()
    # Nodes 3, 4, 5 lie between the corners 0-1, 1-2, 2-0.
    for corner, cell in zip(corners.tolist(), cells, strict=True):
        for node, (a, b) in zip(cell[3:], ((0, 1), (1, 2), (2, 0)), strict=True):
            facet = number[tuple(sorted((corner[a], corner[b])))]
            nodes[:, straight.nvertices + facet] = points[node, :2]
    mesh = skfem.MeshTri2(nodes, curved.t)
    return mesh.with_boundaries(boundaries) if boundaries else mesh


def _named_lines(stored: Any) -> dict[str, Any]:
    """Return the ends of the lines of each named set of a meshio mesh, shape (lines, 2)."""
    found: dict[str, list[Any]] = {}
    tags = stored.cell_data.get("gmsh:physical")
    named = {
        int(tag): name for name, (tag, dimension) in stored.field_data.items() if dimension == 1
    }
    for i, block in enumerate(stored.cells):
        if block.type not in ("line", "line3"):
            continue
        for name, members in stored.cell_sets.items():
            if not name.startswith("gmsh:") and members[i] is not None and len(members[i]):
                found.setdefault(name, []).append(block.data[np.asarray(members[i], dtype=int), :2])
        if tags is not None:
            for tag, name in named.items():
                found.setdefault(name, []).append(block.data[np.asarray(tags[i]) == tag, :2])
    return {name: np.vstack(parts) for name, parts in found.items()}


def with_slit(mesh: Any, start: ArrayLike, end: ArrayLike) -> Any:
    """Return a mesh that is cut along a straight row of its edges.

    Parameters
    ----------
    mesh : skfem.MeshTri
        With straight edges.
    start, end : array_like, shape (2,)
        Ends of the cut. Both are vertices, and edges of the mesh join them in a straight line. An end
        inside of the mesh is a tip, one at the boundary opens.

    Returns
    -------
    skfem.MeshTri
        With the named boundaries that it had, and both faces of the cut as "slit".

    Raises
    ------
    InvalidInput
        If no edges of the mesh join the ends along the line.

    Examples
    --------
    >>> from lissome.plates.meshes import rectangle, with_slit
    >>> whole = rectangle(1.0, divisions=4, grading=1.0)
    >>> int(with_slit(whole, (0.0, 0.0), (0.5, 0.0)).nvertices - whole.nvertices)
    4
    """
    if isinstance(mesh, skfem.MeshTri2) or not isinstance(mesh, skfem.MeshTri1):
        raise InvalidInput(
            f"argument `mesh` is of type {type(mesh).__name__}; a slit needs a MeshTri with straight "
            "edges"
        )
    a = finite_array("start", start, shape=(2,))
    b = finite_array("end", end, shape=(2,))
    length = float(np.hypot(*(b - a)))
    if length == 0:
        raise InvalidInput("arguments `start` and `end` are the same point; a slit has a length")
    direction = (b - a) / length
    normal = np.array([-direction[1], direction[0]])
    points = mesh.p.T
    along, across = (points - a) @ direction, (points - a) @ normal
    small = 1e-9 * max(length, float(np.max(np.ptp(points, axis=0))))
    on = (np.abs(across) < small) & (along > -small) & (along < length + small)
    edges = np.flatnonzero(on[mesh.facets].all(axis=0))
    boundary = set(mesh.boundary_facets().tolist())
    edges = np.array([e for e in edges if e not in boundary], dtype=np.int64)
    covered = float(np.sum(np.abs(along[mesh.facets[0, edges]] - along[mesh.facets[1, edges]])))
    if abs(covered - length) > 1e-6 * length:
        raise InvalidInput(
            f"arguments `start` and `end`: edges of the mesh cover {covered:.6g} of the length "
            f"{length:.6g} of the slit; it must run along edges, from a vertex to a vertex"
        )
    rim = set(mesh.facets[:, mesh.boundary_facets()].ravel().tolist())
    split = [
        v for v in np.unique(mesh.facets[:, edges]).tolist()
        if v in rim or (small < along[v] < length - small)
    ]  # fmt: skip
    copy = {v: mesh.nvertices + i for i, v in enumerate(split)}
    cells = mesh.t.T.copy()
    middle = points[cells].mean(axis=1)
    below = (middle - a) @ normal < 0
    cut = {tuple(pair) for pair in mesh.facets[:, edges].T.tolist()}
    for v, new in copy.items():
        around = np.flatnonzero((cells == v).any(axis=1)).tolist()
        # The triangles around a vertex, joined across edges that are not cut, below the slit.
        seeds = [
            int(t)
            for t in around
            if below[t] and any(v in pair and set(pair) <= set(mesh.t[:, t]) for pair in cut)
        ]  # fmt: skip
        todo, seen = list(seeds), set(seeds)
        while todo:
            t = todo.pop()
            for other in around:
                if other in seen:
                    continue
                common = set(mesh.t[:, t].tolist()) & set(mesh.t[:, other].tolist())
                if len(common) == 2 and tuple(sorted(common)) not in cut:
                    seen.add(int(other))
                    todo.append(int(other))
        for t in seen:
            cells[t][cells[t] == v] = new
    grown = np.vstack([points, points[split]])
    opened = skfem.MeshTri(np.ascontiguousarray(grown.T), np.ascontiguousarray(cells.T))

    number = {tuple(pair): i for i, pair in enumerate(opened.facets.T.tolist())}

    def renumbered(facets: Any, sides: tuple[int, ...]) -> Any:
        """Return the facets that were these, by the new numbers of the vertices of their triangles."""
        found = set()
        for facet in facets.tolist():
            for triangle in mesh.f2t[list(sides), facet].tolist():
                ends = np.isin(mesh.t[:, triangle], mesh.facets[:, facet])
                found.add(number[tuple(sorted(cells[triangle][ends].tolist()))])
        return np.array(sorted(found))

    named = {name: np.asarray(old, dtype=np.int64) for name, old in (mesh.boundaries or {}).items()}
    kept = {name: renumbered(old, (0,)) for name, old in named.items() if len(old)}
    return opened.with_boundaries({**kept, "slit": renumbered(edges, (0, 1))})
