r"""Foeppl-von Karman plates with spontaneous strain and curvature, on any mesh of triangles.

The energy of a plate with deflection w and in-plane displacement u is

.. math:: E = \int_\Omega C\, W(\epsilon - \epsilon_m) + B\, W(\kappa - \kappa_m) - q w, \qquad
    W(\xi) = \frac{\nu\, (\mathrm{tr}\, \xi)^2 + (1 - \nu)\, \xi : \xi}{2 (1 - \nu^2)},

with the strain :math:`\epsilon = \mathrm{sym} \nabla u + \frac12 \nabla w \otimes \nabla w` and the
curvature :math:`\kappa = \nabla\nabla w`: a plate with positive :math:`\kappa_m` wants to be a bowl,
open towards positive w. These are (5.1) and (5.2). A plate of thickness h and Young's modulus Y has
C = Y h and B = Y h^3/12; the factor 1/(1 - nu^2) is in W.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from .._validate import finite
from ..equilibrium import Equilibrium
from ..errors import InvalidInput
from ..factorization import SparseKKT
from ..structure import Evaluation
from ._fvk_fields import Field, scalar_field, tensor_field, vector_field
from ._fvk_mixed import MixedPlate, projected_bending
from ._fvk_space import EDGE_KINDS, PlateSpace
from ._fvk_state import PlateState, PlateUnknowns, check_moduli
from ._fvk_tables import lagrange, triangle_rule

__all__ = [
    "EDGE_KINDS",
    "MixedPlate",
    "Plate",
    "PlateEquilibrium",
    "PlateState",
    "projected_bending",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlateEquilibrium(Equilibrium):
    """An equilibrium of a plate, with its shape."""

    @property
    def deflection(self) -> Array:
        """Deflection w at the vertices of the mesh, shape (vertices,)."""
        return self.structure.deflection(self.state)

    @property
    def displacement(self) -> Array:
        """In-plane displacement at the vertices, shape (vertices, 2)."""
        return self.structure.displacement(self.state)

    @property
    def stretching_energy(self) -> float:
        """The part of the energy that is stored by stretching."""
        return self.structure.energies(self.state)[0]

    @property
    def bending_energy(self) -> float:
        """The part of the energy that is stored by bending."""
        return self.structure.energies(self.state)[1]


class _Bending:
    """The bending form of a material on a space: constant in the unknowns."""

    def __init__(self, space: PlateSpace, bending: Field, poisson: Field) -> None:
        points = space.curvature_points
        stiffness, nu = bending(points.x), poisson(points.x)
        check_moduli("bending", stiffness, nu)
        self.stiffness, self.poisson = stiffness, nu
        basis = space.moment_basis
        k = basis.shape[1]
        # Compliance: kappa = ((1 + nu) M - nu tr(M) I)/B, with M = B A kappa; weights of M : M.
        soft = points.weights / stiffness
        same = np.einsum("tq,qi,qj->tij", soft, basis, basis, optimize=True)
        cross = np.einsum("tq,qi,qj->tij", -nu * soft, basis, basis, optimize=True)
        shear = np.einsum("tq,qi,qj->tij", 2 * (1 + nu) * soft, basis, basis, optimize=True)
        compliance = np.zeros((len(same), k, 3, k, 3))
        compliance[:, :, 0, :, 0] = compliance[:, :, 2, :, 2] = same
        compliance[:, :, 0, :, 2] = compliance[:, :, 2, :, 0] = cross
        compliance[:, :, 1, :, 1] = shear
        square = compliance.reshape(-1, 3 * k, 3 * k)
        # Moments that fit the unknowns of a triangle: M = S^-1 (G v - k).
        self.inverse = np.linalg.inv(square)
        self.response = self.inverse @ space.curvature_matrix
        local = space.curvature_matrix.transpose(0, 2, 1) @ self.response
        local = 0.5 * (local + local.transpose(0, 2, 1))
        n = space.basis.count
        indptr, indices, place = space.pattern
        part = place[:, 2 * n :, 2 * n :]
        inside = part >= 0
        self.data = np.bincount(part[inside], weights=local[inside], minlength=len(indices))
        free = len(space.free)
        self.matrix = sparse.csc_matrix((self.data, indices, indptr), shape=(free, free))

    def load(self, space: PlateSpace, natural: Array) -> tuple[Array, float, Array]:
        """Return the force of a spontaneous curvature, its own energy, and its moments' tests."""
        points = space.curvature_points
        test = np.einsum("tq,qk,tqc->tkc", points.weights, space.moment_basis,
                         natural[..., [0, 2, 1]] * np.array([1.0, 2.0, 1.0]), optimize=True)  # fmt: skip
        tests = test.reshape(len(test), -1)
        local = np.einsum("tmv,tm->tv", self.response, tests)
        n = space.basis.count
        force = np.zeros(space.size)
        np.add.at(force, space.local[:, 2 * n :], local)
        nu, xx, yy, xy = self.poisson, natural[..., 0], natural[..., 1], natural[..., 2]
        density = xx * xx + yy * yy + 2 * nu * xx * yy + 2 * (1 - nu) * xy * xy
        own = 0.5 * float(np.sum(points.weights * self.stiffness / (1 - nu**2) * density))
        return force, own, tests


@dataclass(frozen=True, eq=False, kw_only=True)
class Plate(PlateUnknowns):
    r"""A Foeppl-von Karman plate; a :class:`~lissome.structure.Structure` without constraints.

    Moments are discontinuous and found triangle by triangle (the hybridized method of Hellan,
    Herrmann and Johnson), so that solutions are minima of a discrete energy and the inertia of its
    Hessian tells their stability. Rigid motions of the plate change nothing, exactly; those that the
    supports allow are its gauge.

    Parameters
    ----------
    mesh : skfem.MeshTri or skfem.MeshTri2
        Connected triangles; those of a MeshTri2 may be curved.
    bending : float or callable
        Bending modulus B; energy. A number, or a function of arrays x, y.
    poisson : float or callable
        Poisson's ratio, in (-1, 1/2].
    stretching : float or callable
        Stretching modulus C; energy per area.
    strain : array_like (2, 2) or callable, optional
        Spontaneous strain: a tensor, or a function of arrays x, y, shape (...), that returns an array
        of shape (2, 2, ...). Zero by default.
    curvature : array_like (2, 2) or callable, optional
        Spontaneous curvature, likewise; 1/length.
    pressure : float or callable, optional
        Load per area along w.
    body_force : array_like (2,) or callable, optional
        Load per area in the plane; a function of arrays x, y returns an array (2, ...).
    traction : mapping, optional
        Load per length in the plane, on parts of the boundary as in `edges`: a vector or a function
        as `body_force`. These loads keep their direction; where tilts are free they are no neutral
        motions any more.
    edges : str or mapping
        ``"free"`` (default), ``"simply supported"`` (w = 0), ``"hinged"`` (w = 0, u = 0),
        ``"clamped"`` (w = 0, no slope, u = 0), ``"sliding clamp"`` (w = 0, no slope), or a tuple out
        of ``"deflection"``, ``"slope"``, ``"displacement"``, for the whole boundary; or a mapping from
        parts of the boundary to these. A part is the name of a boundary of the mesh, ``"all"``, or a
        function of the midpoints of edges, f(x, y) -> bool.
    degree : int
        Polynomial degree of w and u, 2 or 3.

    Raises
    ------
    InvalidInput
        If the mesh is not one of connected, proper triangles, a modulus is not positive, a field has a
        wrong shape or is not finite, or a load moves a plate that is not held.

    Examples
    --------
    A clamped square under a load that bends it little: 0.00126 q a^4/D, with D = B/(1 - nu^2).

    >>> import skfem, lissome as ls
    >>> from lissome.plates.fvk import Plate
    >>> mesh = skfem.MeshTri().refined(3)
    >>> plate = Plate(mesh=mesh, bending=1.0, poisson=0.3, edges="clamped", pressure=1e-3)
    >>> bent = ls.equilibrate(plate)
    >>> print(f"{bent.deflection.max() / 1e-3 / (1 - 0.3**2):.4f}")
    0.0013
    """

    mesh: Any = field(repr=False)
    bending: float | Callable[..., Any]
    poisson: float | Callable[..., Any]
    stretching: float | Callable[..., Any] = 1.0
    strain: Any = None
    curvature: Any = None
    pressure: float | Callable[..., Any] = 0.0
    edges: Any = "free"
    degree: int = 2
    body_force: Any = None
    traction: Any = None
    _shared: dict[str, Any] = field(default_factory=dict, repr=False)
    _strain: Array = field(init=False, repr=False)
    _force: Array = field(init=False, repr=False)
    _load: Array = field(init=False, repr=False)
    _tests: Array = field(init=False, repr=False)
    _own: float = field(init=False, repr=False)
    _slope: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        space, bending, membrane = self.space, self._bending, self._membrane
        natural = tensor_field("curvature", self.curvature)(space.curvature_points.x)
        force, own, tests = bending.load(space, natural)
        load = np.zeros(space.size)
        points, weights = triangle_rule(2 * self.degree)
        geometry = space.geometry.at(points, weights)
        pressure = scalar_field("pressure", self.pressure)(geometry.x)
        work = np.einsum("tq,tq,qn->tn", geometry.weights, pressure, space.basis.values(points))
        np.add.at(load, space.scalar + 2 * space.nodes, work)
        if self.body_force is not None:
            force_at = vector_field("body_force", self.body_force)(geometry.x)
            for i in range(2):
                work = np.einsum(
                    "tq,tq,qn->tn", geometry.weights, force_at[..., i], space.basis.values(points)
                )
                np.add.at(load, space.scalar + i * space.nodes, work)
        if self.traction is not None:
            load += space.edge_load(self.traction)
        object.__setattr__(self, "_force", force + load)
        object.__setattr__(self, "_load", load)
        object.__setattr__(self, "_own", own)
        object.__setattr__(self, "_tests", tests)
        strain = tensor_field("strain", self.strain)(membrane["x"])
        object.__setattr__(self, "_strain", strain)
        slopes = [np.sqrt(np.max(membrane["thickness2"])) / space.extent]
        slopes.append(float(np.sqrt(np.max(np.abs(strain)))))
        slopes.append(float(np.max(np.abs(natural))) * space.extent)
        object.__setattr__(self, "_slope", float(max(slopes)))
        pushed = self._generators(np.zeros(space.size))
        if len(pushed) and np.any(load):
            moved = np.abs(pushed @ load) > 1e-9 * float(np.sum(np.abs(load)))
            if np.any(moved):
                raise InvalidInput(
                    "argument `pressure`, `body_force` or `traction` moves the plate as a whole: its "
                    "`edges` do not hold it, and the load does not balance; hold an edge, or balance "
                    "the load"
                )

    # -- parts ----------------------------------------------------------------------------------

    @cached_property
    def space(self) -> PlateSpace:
        """The degrees of freedom; shared by plates that differ in material and load only."""
        if "space" not in self._shared:
            self._shared["space"] = PlateSpace(self.mesh, self.degree, self.edges)
        return self._shared["space"]

    @property
    def _bending(self) -> _Bending:
        if "bending" not in self._shared:
            self._shared["bending"] = _Bending(
                self.space, scalar_field("bending", self.bending),
                scalar_field("poisson", self.poisson),
            )  # fmt: skip
        return self._shared["bending"]

    @property
    def _membrane(self) -> dict[str, Array]:
        if "membrane" not in self._shared:
            space = self.space
            points, weights = triangle_rule(self._membrane_degree)
            geometry = space.geometry.at(points, weights)
            stretching = scalar_field("stretching", self.stretching)(geometry.x)
            poisson = scalar_field("poisson", self.poisson)(geometry.x)
            check_moduli("stretching", stretching, poisson)
            bending = scalar_field("bending", self.bending)(geometry.x)
            self._shared["membrane"] = {
                "x": geometry.x,
                "weights": np.ascontiguousarray(geometry.weights),
                "gradients": np.ascontiguousarray(space.gradients(points, geometry)),
                "stretching": np.ascontiguousarray(stretching),
                "poisson": np.ascontiguousarray(poisson),
                "thickness2": bending / stretching,
            }
        return self._shared["membrane"]

    @property
    def _membrane_degree(self) -> int:
        return 2 * (self.degree - 1)

    def with_(self, **changes: Any) -> Plate:
        """Return a plate with other arguments; what they do not touch is not computed again.

        Parameters
        ----------
        **changes
            Any of the arguments of :class:`Plate`.

        Raises
        ------
        InvalidInput
            If a name is unknown.
        """
        known = {item.name for item in fields(self) if item.init and not item.name.startswith("_")}
        unknown = set(changes) - known
        if unknown:
            raise InvalidInput(f"unknown arguments {sorted(unknown)}; known are {sorted(known)}")
        shared = dict(self._shared)
        spoiled = {
            "mesh": ("space", "bending", "membrane"),
            "edges": ("space", "bending", "membrane"),
            "degree": ("space", "bending", "membrane"),
            "poisson": ("bending", "membrane"),
            "bending": ("bending", "membrane"),
            "stretching": ("membrane",),
        }
        for name in changes:
            for part in spoiled.get(name, ()):
                shared.pop(part, None)
        return replace(self, _shared=shared, **changes)

    # -- the structure ----------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Number of free unknowns."""
        return len(self.space.free)

    def evaluate(self, state: PlateState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, gradient and Hessian with respect to the free unknowns."""
        from ._fvk_kernel import membrane

        space, bending, m = self.space, self._bending, self._membrane
        x = self._vector(state)
        indptr, indices, place = space.pattern
        force = np.zeros(space.size)
        data = bending.data.copy() if order == 2 else np.empty(0)
        stretching = membrane(
            order, space.local, place, m["gradients"], m["gradients"], m["weights"], m["stretching"],
            m["poisson"], self._strain, x, force, data,
        )  # fmt: skip
        free = x[space.free]
        moment = bending.matrix @ free
        applied = self._force[space.free]
        energy = stretching + 0.5 * float(free @ moment) - float(applied @ free) + self._own
        none = np.zeros(0)
        if order == 0:
            return Evaluation(energy, none)
        gradient = force[space.free] + moment - applied
        if order == 1:
            return Evaluation(energy, none, gradient)
        n = len(space.free)
        hessian = sparse.csc_matrix((data, indices, indptr), shape=(n, n))
        return Evaluation(energy, none, gradient, SparseKKT(hessian))

    def metric(self, state: PlateState) -> Array:
        """Return areas of the nodes, and squared lengths of the edges for their slopes."""
        return self.space.mass[self.space.free]

    def typical(self, state: PlateState) -> Array:
        """Return sizes that fit the thickness, the spontaneous strain and the curvature."""
        space, s = self.space, self._slope
        ends = self.mesh.p[:, self.mesh.facets]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)
        sizes = np.concatenate(
            [
                np.full(2 * space.nodes, s**2 * space.extent),
                np.full(space.nodes, s * space.extent),
                np.repeat(s * length, self.degree),
            ]
        )
        return sizes[space.free]

    @property
    def slope_scale(self) -> float:
        """Slope that suits thickness, spontaneous strain and curvature."""
        return self._slope

    def gauge(self, state: PlateState) -> Array:
        """Return the rigid motions that the supports allow, as motions of the free unknowns."""
        return self._generators(self._vector(state))[:, self.space.free]

    def _generators(self, x: Array) -> Array:
        space = self.space
        n, size = space.nodes, space.size
        place = space.positions - space.positions.mean(axis=0)
        w = x[2 * n : 3 * n]
        w = w - w.mean()
        rows = np.zeros((6, size))
        scale = space.extent
        rows[0, :n] = rows[1, n : 2 * n] = rows[2, 2 * n : 3 * n] = 1.0
        rows[3, :n], rows[3, n : 2 * n] = -place[:, 1] / scale, place[:, 0] / scale
        for axis in range(2):  # w + b x and u - b w leave the strain as it is
            rows[4 + axis, 2 * n : 3 * n] = place[:, axis] / scale
            rows[4 + axis, axis * n : (axis + 1) * n] = -w / scale
            rows[4 + axis, 3 * n :] = space.tilt[axis] / scale
        if self.body_force is not None or self.traction is not None:
            # Loads of fixed direction do work when the plate tilts, except about their own direction.
            pull = self._load[: 2 * n].reshape(2, n)
            u, values, _ = np.linalg.svd(pull, full_matrices=False)
            loose = u[:, values <= 1e-12 * max(float(values[0]), 1e-300)]
            rows = np.vstack([rows[:4], loose.T @ rows[4:]])
        held = rows[:, space.fixed]
        if not held.size:
            return rows
        u, values, _ = np.linalg.svd(held, full_matrices=True)
        rank = int(np.count_nonzero(values > 1e-9 * np.sqrt(held.shape[1])))
        return u[:, rank:].T @ rows

    def present(self, equilibrium: Equilibrium) -> PlateEquilibrium:
        """Return the plate's own view of an equilibrium."""
        return equilibrium.as_type(PlateEquilibrium)

    def force_of(self, curvature: Any) -> Array:
        """Return the force on the free unknowns that a spontaneous curvature adds, shape (size,).

        It is the same in every state, and proportional to the curvature (array_like (2, 2) or callable).
        """
        space = self.space
        natural = tensor_field("curvature", curvature)(space.curvature_points.x)
        return self._bending.load(space, natural)[0][space.free]

    # -- what a state means -----------------------------------------------------------------------

    def interpolate(
        self,
        deflection: Callable[[Array, Array], ArrayLike] | None = None,
        displacement: Callable[[Array, Array], ArrayLike] | None = None,
    ) -> PlateState:
        """Return the state that interpolates given functions of x, y at the nodes.

        Parameters
        ----------
        deflection : callable, optional
            w; zero by default.
        displacement : callable, optional
            u, an array of shape (..., 2); zero by default.
        """
        space = self.space
        n, x, y = space.nodes, *space.positions.T
        out = np.zeros(space.size)
        if displacement is not None:
            u = np.broadcast_to(np.asarray(displacement(x, y), dtype=float), (n, 2))
            out[:n], out[n : 2 * n] = u[:, 0], u[:, 1]
        if deflection is not None:
            w = np.broadcast_to(np.asarray(deflection(x, y), dtype=float), (n,))
            out[2 * n : 3 * n] = w
            out[3 * n :] = space.slopes_of(out[2 * n : 3 * n])
        if not np.all(np.isfinite(out)):
            raise InvalidInput("the functions to interpolate are not finite at every node")
        return PlateState(out)

    def deflection(self, state: PlateState) -> Array:
        """Return w at the vertices of the mesh, shape (vertices,)."""
        n = self.space.nodes
        return self._vector(state)[2 * n : 2 * n + self.mesh.nvertices].copy()

    def displacement(self, state: PlateState) -> Array:
        """Return u at the vertices of the mesh, shape (vertices, 2)."""
        n, x = self.space.nodes, self._vector(state)
        return np.stack([x[: self.mesh.nvertices], x[n : n + self.mesh.nvertices]], axis=1)

    def mirrored(self, state: PlateState) -> PlateState:
        """Return the state with the deflection turned over, -w."""
        x = self._vector(state).copy()
        x[2 * self.space.nodes :] *= -1.0
        return PlateState(x)

    def moments(self, state: PlateState) -> Array:
        """Return the moments at the corners of each triangle, shape (T, 3, 2, 2)."""
        return self._moments(state, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))

    def _moments(self, state: PlateState, points: Array) -> Array:
        space, n = self.space, self.space.basis.count
        v = self._vector(state)[space.local[:, 2 * n :]]
        coefficients = np.einsum("tmv,tv->tm", self._bending.response, v)
        coefficients -= np.einsum("tmk,tk->tm", self._bending.inverse, self._tests)
        basis = lagrange(self.degree - 1).values(points)
        c = coefficients.reshape(len(v), -1, 3)
        values = np.einsum("qk,tkc->tqc", basis, c)
        return values[..., [[0, 1], [1, 2]]]

    def curvature_at(self, points: ArrayLike, state: PlateState) -> Array:
        r"""Return the discrete curvature :math:`\nabla\nabla w` at points, shape (..., 2, 2).

        It is that of the triangle in which a point lies: moments over stiffness, plus the spontaneous
        curvature as the moments see it (projected on polynomials).
        """
        triangle, reference, shape = self._locate(points)
        space, n = self.space, self.space.basis.count
        v = self._vector(state)[space.local[:, 2 * n :]]
        tests = np.einsum("tmv,tv->tm", space.curvature_matrix, v)
        basis = space.moment_basis
        gram = np.einsum("tq,qi,qj->tij", space.curvature_points.weights, basis, basis)
        tests = tests.reshape(len(v), -1, 3) / np.array([1.0, 2.0, 1.0])
        coefficients = np.linalg.solve(gram, tests)
        at = lagrange(self.degree - 1).values(reference)
        values = np.einsum("sk,skc->sc", at, coefficients[triangle])
        return values[:, [[0, 1], [1, 2]]].reshape(*shape, 2, 2)

    def deflection_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return w at points (..., 2)."""
        triangle, reference, shape = self._locate(points)
        nodes = self.space.scalar[triangle] + 2 * self.space.nodes
        values = self.space.basis.values(reference)
        return np.sum(values * self._vector(state)[nodes], axis=1).reshape(shape)

    def displacement_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return u at points (..., 2)."""
        triangle, reference, shape = self._locate(points)
        nodes = self.space.scalar[triangle]
        values, x = self.space.basis.values(reference), self._vector(state)
        parts = [np.sum(values * x[nodes + i * self.space.nodes], axis=1) for i in range(2)]
        return np.stack(parts, axis=-1).reshape(*shape, 2)

    def _locate(self, points: ArrayLike) -> tuple[Any, Any, tuple[int, ...]]:
        array = np.asarray(points, dtype=float)
        if array.shape[-1:] != (2,) or not np.all(np.isfinite(array)):
            raise InvalidInput(
                f"argument `points` has shape {array.shape}; it must hold finite pairs (..., 2)"
            )
        flat = array.reshape(-1, 2)
        corners = self.space.geometry.corners
        origin = corners[:, 0]
        triangle = np.empty(len(flat), dtype=np.int64)
        reference = np.empty_like(flat)
        straight = np.linalg.inv(
            np.stack([corners[:, 1] - origin, corners[:, 2] - origin], axis=-1)
        )
        for i, point in enumerate(flat):
            local = np.einsum("trx,tx->tr", straight, point - origin)
            outside = np.max(np.column_stack([-local, local.sum(axis=1) - 1.0]), axis=1)
            best, found = int(np.argmin(outside)), False
            for t in np.argsort(outside)[:8]:
                r = local[t].copy()
                for _ in range(20):  # curved triangles
                    at = self.space.geometry.basis
                    missing = point - at.values(r[None])[0] @ corners[t]
                    r += np.linalg.solve(corners[t].T @ at.gradients(r[None])[0], missing)
                    if np.max(np.abs(missing)) < 1e-14 * self.space.extent:
                        break
                if min(r[0], r[1], 1 - r.sum()) > -1e-9:
                    best, local[t], found = int(t), r, True
                    break
            if not found:
                raise InvalidInput(
                    f"argument `points`: ({point[0]:.6g}, {point[1]:.6g}) is not in the mesh"
                )
            triangle[i], reference[i] = best, local[best]
        return triangle, reference, array.shape[:-1]

    def energies(self, state: PlateState) -> tuple[float, float, float]:
        """Return stretching energy, bending energy, and the potential of the load."""
        from ._fvk_kernel import membrane

        space, m, x = self.space, self._membrane, self._vector(state)
        stretching = membrane(
            0, space.local, space.pattern[2], m["gradients"], m["gradients"], m["weights"], m["stretching"],
            m["poisson"], self._strain, x, np.zeros(0), np.empty(0),
        )  # fmt: skip
        load = -float(self._load @ x)
        free = x[space.free]
        bend = 0.5 * float(free @ (self._bending.matrix @ free)) + self._own
        bend -= float((self._force - self._load) @ x)
        return float(stretching), bend, load

    def surface(self, state: PlateState, subdivisions: int = 1) -> tuple[Array, Any]:
        """Return the deformed surface, for plots.

        Parameters
        ----------
        state : PlateState
        subdivisions : int
            Parts into which each edge of the mesh is divided.

        Returns
        -------
        points : ndarray, shape (P, 3)
        triangles : ndarray of int, shape (F, 3)
            Points are not shared between triangles of the mesh.
        """
        k = int(finite("subdivisions", subdivisions))
        if k < 1:
            raise InvalidInput(f"argument `subdivisions` is {subdivisions}; it must be at least 1")
        rows = [(i, j) for j in range(k + 1) for i in range(k + 1 - j)]
        number = {pair: index for index, pair in enumerate(rows)}
        reference = np.array(rows, dtype=float) / k
        faces = [
            (number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in rows if i + j < k
        ] + [
            (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
            for i, j in rows if i + j < k - 1
        ]  # fmt: skip
        space, x = self.space, self._vector(state)
        values = space.basis.values(reference)
        parts = [
            np.einsum("qn,tn->tq", values, x[space.scalar + i * space.nodes]) for i in range(3)
        ]
        place = space.geometry.positions(reference)
        points = np.stack([place[..., 0] + parts[0], place[..., 1] + parts[1], parts[2]], axis=-1)
        shift = len(reference) * np.arange(len(points))[:, None, None]
        return points.reshape(-1, 3), (np.array(faces)[None] + shift).reshape(-1, 3)
