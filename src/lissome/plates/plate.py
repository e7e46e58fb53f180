"""Foeppl-von Karman plates with spontaneous strain and curvature, on any mesh of triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from .._validate import finite
from ..errors import InvalidInput
from ..factorization import SparseKKT
from ..structure import Evaluation
from ._fvk_fields import Field, scalar_field, tensor_field, vector_field
from ._fvk_space import PlateSpace, scatter
from ._fvk_state import PlateEquilibrium, PlateState, PlateUnknowns, check_moduli
from ._fvk_tables import triangle_rule

__all__ = ["Plate", "PlateEquilibrium", "PlateState"]

Array = NDArray[np.float64]


class _Bending:
    """The bending form of a material on a space: constant in the unknowns."""

    def __init__(self, space: PlateSpace, bending: Field, poisson_ratio: Field) -> None:
        points = space.curvature_points
        stiffness, nu = bending(points.x), poisson_ratio(points.x)
        check_moduli("bending", stiffness, nu)
        self.stiffness, self.poisson_ratio = stiffness, nu
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
        _, indices, place = space.pattern
        part = place[:, 2 * n :, 2 * n :]
        inside = part >= 0
        self.data = np.bincount(part[inside], weights=local[inside], minlength=len(indices))
        unknowns = space.local[:, 2 * n :]
        self.matrix = scatter(unknowns, unknowns, local, (space.size, space.size))

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
        nu, xx, yy, xy = self.poisson_ratio, natural[..., 0], natural[..., 1], natural[..., 2]
        density = xx * xx + yy * yy + 2 * nu * xx * yy + 2 * (1 - nu) * xy * xy
        own = 0.5 * float(np.sum(points.weights * self.stiffness / (1 - nu**2) * density))
        return force, own, tests


@dataclass(frozen=True, eq=False, kw_only=True)
class Plate(PlateUnknowns):
    r"""A Foeppl-von Karman plate; a :class:`~lissome.structure.Structure` without constraints.

    The energy of a plate with deflection w and in-plane displacement u is

    .. math:: E = \int_\Omega C\, W(\epsilon - \epsilon_m) + B\, W(\kappa - \kappa_m) - q w, \qquad
        W(\xi) = \frac{\nu\, (\mathrm{tr}\, \xi)^2 + (1 - \nu)\, \xi : \xi}{2 (1 - \nu^2)},

    with the strain :math:`\epsilon = \mathrm{sym} \nabla u + \frac12 \nabla w \otimes \nabla w` and the
    curvature :math:`\kappa = \nabla\nabla w`: a plate with positive :math:`\kappa_m` wants to be a bowl,
    open towards positive w. These are (5.1) and (5.2). A plate of thickness h and Young's modulus Y has
    C = Y h and B = Y h^3/12; the factor 1/(1 - nu^2) is in W.

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
    poisson_ratio : float or callable
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
        ``"clamped"`` (w = 0, no slope, u = 0), ``"sliding clamp"`` (w = 0, no slope), a tuple out of
        ``"deflection"``, ``"slope"``, ``"gradient"`` (whose normal part is the slope),
        ``"displacement"``, ``"displacement_x"``, ``"displacement_y"``, or a mapping from these to
        values, numbers or functions of x, y, for the whole boundary; or a mapping from parts of the
        boundary to these. A part is the name of a boundary of the mesh, ``"all"``, or a
        function of the midpoints of edges, f(x, y) -> bool.
    degree : int
        Polynomial degree of w and u, 2 or 3.
    points : mapping, optional
        What vertices of the mesh hold: from positions (x, y) to ``"deflection"``, ``"displacement"``,
        ``"displacement_x"``, ``"displacement_y"``, a tuple of these, or a mapping from these to values.
    support_scale : float
        Factor of all values at which edges and points are held: a parameter for
        :func:`lissome.follow`.

    Raises
    ------
    InvalidInput
        If the mesh is not one of connected, proper triangles, a modulus is not positive, a field has a
        wrong shape or is not finite, or a load moves a plate that is not held.

    Examples
    --------
    A clamped square under a load that bends it little: 0.00126 q a^4/D, with D = B/(1 - nu^2).

    >>> import skfem, lissome as ls
    >>> from lissome.plates import Plate
    >>> mesh = skfem.MeshTri().refined(3)
    >>> plate = Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3, edges="clamped", pressure=1e-3)
    >>> bent = ls.equilibrate(plate)
    >>> print(f"{bent.deflection.max() / 1e-3 / (1 - 0.3**2):.4f}")
    0.0013
    """

    mesh: Any = field(repr=False)
    bending: float | Callable[..., Any]
    poisson_ratio: float | Callable[..., Any]
    stretching: float | Callable[..., Any] = 1.0
    strain: Any = None
    curvature: Any = None
    pressure: float | Callable[..., Any] = 0.0
    edges: Any = "free"
    degree: int = 2
    body_force: Any = None
    traction: Any = None
    points: Any = None
    support_scale: float = 1.0
    _shared: dict[str, Any] = field(default_factory=dict, repr=False)
    _strain: Array = field(init=False, repr=False)
    _force: Array = field(init=False, repr=False)
    _load: Array = field(init=False, repr=False)
    _tests: Array = field(init=False, repr=False)
    _own: float = field(init=False, repr=False)
    _slope: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        finite("support_scale", self.support_scale)
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
        slopes.append(self._support_slope())
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

    _edges_tell = True

    @cached_property
    def space(self) -> PlateSpace:
        """The degrees of freedom; shared by plates that differ in material and load only."""
        if "space" not in self._shared:
            self._shared["space"] = PlateSpace(self.mesh, self.degree, self.edges, self.points)
        return self._shared["space"]

    @property
    def _bending(self) -> _Bending:
        if "bending" not in self._shared:
            self._shared["bending"] = _Bending(
                self.space, scalar_field("bending", self.bending),
                scalar_field("poisson_ratio", self.poisson_ratio),
            )  # fmt: skip
        return self._shared["bending"]

    @property
    def _membrane(self) -> dict[str, Array]:
        if "membrane" not in self._shared:
            space = self.space
            points, weights = triangle_rule(self._membrane_degree)
            geometry = space.geometry.at(points, weights)
            stretching = scalar_field("stretching", self.stretching)(geometry.x)
            poisson_ratio = scalar_field("poisson_ratio", self.poisson_ratio)(geometry.x)
            check_moduli("stretching", stretching, poisson_ratio)
            bending = scalar_field("bending", self.bending)(geometry.x)
            self._shared["membrane"] = {
                "x": geometry.x,
                "weights": np.ascontiguousarray(geometry.weights),
                "gradients": np.ascontiguousarray(space.gradients(points, geometry)),
                "stretching": np.ascontiguousarray(stretching),
                "poisson_ratio": np.ascontiguousarray(poisson_ratio),
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
        names = self._changed(changes)
        shared = dict(self._shared)
        spoiled = {
            "mesh": ("space", "bending", "membrane", "spread"),
            "degree": ("space", "bending", "membrane", "spread"),
            "poisson_ratio": ("bending", "membrane", "spread"),
            "bending": ("bending", "membrane", "spread"),
            "stretching": ("membrane", "spread"),
        }
        for name in names:
            for part in spoiled.get(name, ()):
                shared.pop(part, None)
        if names & {"edges", "points"} and "space" in shared:
            old = shared["space"]
            new = old.with_supports(
                changes.get("edges", self.edges), changes.get("points", self.points)
            )
            shared["space"] = new
            if not np.array_equal(new.fixed, old.fixed):
                shared.pop("bending", None)
                shared.pop("spread", None)
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
            m["poisson_ratio"], self._strain, x, force, data,
        )  # fmt: skip
        moment = bending.matrix @ x
        energy = stretching + 0.5 * float(x @ moment) - float(self._force @ x) + self._own
        none = np.zeros(0)
        if order == 0:
            return Evaluation(energy, none)
        gradient = (force + moment - self._force)[space.free]
        if order == 1:
            return Evaluation(energy, none, gradient)
        n = len(space.free)
        hessian = sparse.csc_matrix((data, indices, indptr), shape=(n, n))
        return Evaluation(energy, none, gradient, SparseKKT(hessian))

    def _residual(self, state: PlateState, multipliers: Array) -> Array:
        from ._fvk_kernel import membrane

        space, m, x = self.space, self._membrane, self._vector(state)
        force = np.zeros(space.size)
        membrane(
            1, space.local, space.pattern[2], m["gradients"], m["gradients"], m["weights"],
            m["stretching"], m["poisson_ratio"], self._strain, x, force, np.empty(0),
        )  # fmt: skip
        return np.asarray(force + self._bending.matrix @ x - self._force)

    def _rigid_motions(self, point: Array, state: PlateState) -> Array:
        space, n = self.space, self.space.nodes
        x, y = (space.positions - point[:2]).T
        w = self._vector(state)[2 * n : 3 * n] - point[2]
        rows = np.zeros((6, space.size))
        rows[0, :n] = rows[1, n : 2 * n] = rows[2, 2 * n : 3 * n] = 1.0
        # About x and y as the energy knows turns: w + b y goes with u_y - b w.
        rows[3, n : 2 * n], rows[3, 2 * n : 3 * n], rows[3, 3 * n :] = -w, y, space.tilt[1]
        rows[4, :n], rows[4, 2 * n : 3 * n], rows[4, 3 * n :] = w, -x, -space.tilt[0]
        rows[5, :n], rows[5, n : 2 * n] = -y, x
        return rows

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

    def force_of(self, curvature: Any) -> Array:
        """Return the force on the free unknowns that a spontaneous curvature adds, shape (size,).

        It is the same in every state, and proportional to `curvature` (array_like (2, 2) or callable).
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
        out = self._sampled((space.positions, space.positions), deflection, displacement)
        out[3 * space.nodes :] = space.slopes_of(out[2 * space.nodes : 3 * space.nodes])
        return PlateState(out)

    # -- what the schemes share -------------------------------------------------------------------

    def _parts(self, x: Any) -> tuple[Any, Any, Any]:
        n = self.space.nodes
        return x[: 2 * n].reshape(2, n), x[2 * n : 3 * n], x[3 * n :]

    @property
    def _slope_unit(self) -> float:
        ends = self.mesh.p[:, self.mesh.facets]
        return float(np.mean(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)))

    @property
    def _bases(self) -> Any:
        both = (self.space.basis, self.space.scalar)
        return both, both

    def _linear(self) -> Any:
        space, m = self.space, self._membrane
        blocks = (
            space.local, m["gradients"], m["gradients"], m["weights"], m["stretching"], m["poisson_ratio"],
            np.zeros_like(self._strain),
        )  # fmt: skip
        return blocks, self._bending.matrix, sparse.csr_matrix((0, space.size))

    def _membrane_data(self) -> dict[str, Any]:
        m = self._membrane
        points, _ = triangle_rule(self._membrane_degree)
        return {
            "local": self.space.local, "gradients": m["gradients"], "tilts": m["gradients"],
            "weights": m["weights"], "stretching": m["stretching"], "poisson_ratio": m["poisson_ratio"],
            "natural": self._strain, "points": points,
        }  # fmt: skip

    def _moments(self, state: PlateState) -> Array:
        space, n = self.space, self.space.basis.count
        v = self._vector(state)[space.local[:, 2 * n :]]
        coefficients = np.einsum("tmv,tv->tm", self._bending.response, v)
        coefficients -= np.einsum("tmk,tk->tm", self._bending.inverse, self._tests)
        return coefficients.reshape(len(v), -1, 3)

    def curvature_at(self, points: ArrayLike, state: PlateState) -> Array:
        r"""Return the discrete curvature :math:`\nabla\nabla w` at points, shape (..., 2, 2).

        It is that of the triangle in which a point lies: moments over stiffness, plus the spontaneous
        curvature as the moments see it (projected on polynomials).

        Parameters
        ----------
        points : array_like, shape (..., 2)
            Coordinates x, y.
        state : PlateState
            Whose curvature.
        """
        space, n = self.space, self.space.basis.count
        v = self._vector(state)[space.local[:, 2 * n :]]
        tests = np.einsum("tmv,tv->tm", space.curvature_matrix, v)
        basis = space.moment_basis
        gram = np.einsum("tq,qi,qj->tij", space.curvature_points.weights, basis, basis)
        tests = tests.reshape(len(v), -1, 3) / np.array([1.0, 2.0, 1.0])
        return self._at(points, np.linalg.solve(gram, tests))

    def energies(self, state: PlateState) -> tuple[float, float, float]:
        """Return stretching energy, bending energy, and the potential of the load, of `state`."""
        from ._fvk_kernel import membrane

        space, m, x = self.space, self._membrane, self._vector(state)
        stretching = membrane(
            0, space.local, space.pattern[2], m["gradients"], m["gradients"], m["weights"], m["stretching"],
            m["poisson_ratio"], self._strain, x, np.zeros(0), np.empty(0),
        )  # fmt: skip
        load = -float(self._load @ x)
        bend = 0.5 * float(x @ (self._bending.matrix @ x)) + self._own
        bend -= float((self._force - self._load) @ x)
        return float(stretching), bend, load
