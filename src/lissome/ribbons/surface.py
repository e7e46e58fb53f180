"""The developed surface of a ribbon: plane faces between rulings, as a triangulated strip."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._validate import one_of
from ..rods._tables import FORMATS

__all__ = ["DevelopedSurface"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DevelopedSurface:
    r"""A developable strip: the faces between neighboring rulings are plane.

    The point of the flat strip at :math:`(s + t\eta, t)` goes to :math:`x(s) + t(d_1 + \eta d_3)`. The
    strip ends at its first and last ruling, not at a cut across it. The last ruling of a closed band is
    the first one again.

    Attributes
    ----------
    vertices : ndarray, shape (n, a, 3)
        Points on n rulings (one for each node), a on each, from one edge to the other.
    flat : ndarray, shape (n, a, 2)
        The same points on the flat strip: along it and across.
    ruling : ndarray, shape (n,)
        Ruling parameters.
    energy_density : ndarray, shape (n, a)
        Bending energy per area.
    curvature : ndarray, shape (n, a)
        Curvature across the rulings (1/length).
    closed : bool
        Whether the last ruling is the first.

    Examples
    --------
    An arch between clamps, developed: nothing is stretched, and no ruling meets another one.

    >>> import lissome as ls
    >>> from lissome import ribbons
    >>> law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    >>> strip = ribbons.straight(1.0, 20, law).clamped("start").clamped("end", position=(0, 0, 0.9))
    >>> surface = ls.equilibrate(strip).surface()
    >>> print(surface.isometry_error() < 1e-12, surface.rulings_cross().size)
    True 0
    """

    vertices: Array
    flat: Array
    ruling: Array
    energy_density: Array
    curvature: Array
    closed: bool

    @property
    def triangles(self) -> NDArray[np.int64]:
        """Triangles, shape (m, 3): rows of `vertices` flattened to (n * a, 3)."""
        n, a = self.vertices.shape[:2]
        corner = (np.arange(n - 1)[:, None] * a + np.arange(a - 1)).reshape(-1)
        one = np.stack([corner, corner + 1, corner + a], axis=1)
        two = np.stack([corner + 1, corner + a + 1, corner + a], axis=1)
        return np.stack([one, two], axis=1).reshape(-1, 3)

    @property
    def rulings(self) -> Array:
        """End points of the rulings, shape (n, 2, 3)."""
        return self.vertices[:, [0, -1]]

    @property
    def edges(self) -> Array:
        """The two edges of the strip, shape (2, n, 3)."""
        return np.stack([self.vertices[:, 0], self.vertices[:, -1]])

    def isometry_error(self) -> float:
        """Return the largest relative difference of a length in space from that on the flat strip.

        All sides of the triangles count: along the strip, along rulings and diagonally.
        """
        worst = 0.0
        corners = self.triangles
        space = self.vertices.reshape(-1, 3)
        plane = self.flat.reshape(-1, 2)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            bent = np.linalg.norm(space[corners[:, i]] - space[corners[:, j]], axis=1)
            flat = np.linalg.norm(plane[corners[:, i]] - plane[corners[:, j]], axis=1)
            scale = np.maximum(flat, 1e-3 * flat.max())
            worst = max(worst, float(np.max(np.abs(bent - flat) / scale)))
        return worst

    def rulings_cross(self) -> NDArray[np.int64]:
        """Return the segments whose two rulings meet inside the strip, shape (k,); none is right."""
        along = self.flat[1:, :, 0] - self.flat[:-1, :, 0]
        return np.flatnonzero(np.any(along <= 0.0, axis=1))

    def face_planarity(self) -> float:
        """Return the largest distance of a corner of a face from the plane of the other three.

        Relative to the width of the strip.
        """
        a, b = self.vertices[:-1, 0], self.vertices[:-1, -1]
        c, d = self.vertices[1:, 0], self.vertices[1:, -1]
        normal = np.cross(b - a, 0.5 * (c + d) - 0.5 * (a + b))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        width = float(np.max(np.linalg.norm(b - a, axis=1)))
        heights = [np.abs(np.sum(normal * (p - a), axis=1)) for p in (c, d)]
        return float(np.max(heights)) / width

    def to_vtk(self, path: str | os.PathLike[str]) -> Path:
        """Write the triangles for ParaView, with energy density, curvature and flat coordinates.

        Parameters
        ----------
        path : path
            File whose name ends in ``.vtu`` or ``.vtk``.

        Returns
        -------
        pathlib.Path

        Raises
        ------
        InvalidInput
            If the name of the file says another format.
        """
        import meshio

        file = Path(path)
        one_of("path", file.suffix.lower(), FORMATS)
        flat = self.flat.reshape(-1, 2)
        mesh = meshio.Mesh(
            np.ascontiguousarray(self.vertices.reshape(-1, 3)),
            [("triangle", self.triangles)],
            point_data={
                "energy_density": self.energy_density.reshape(-1),
                "curvature": self.curvature.reshape(-1),
                "along": np.ascontiguousarray(flat[:, 0]),
                "across": np.ascontiguousarray(flat[:, 1]),
            },
        )
        mesh.write(file)
        return file
