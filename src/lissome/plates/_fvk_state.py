"""States of plates, their shapes at points, and checks that the schemes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from .._validate import finite_array, integer_at_least, positive
from ..equilibrium import Equilibrium
from ..errors import InvalidInput
from ..factorization import Factorization, SparseKKT
from ..reactions import Reactions
from ..structure import BaseStructure
from ._fvk_reactions import plate_reactions
from ._fvk_space import sparse_pattern
from ._fvk_tables import Lagrange, lagrange

Array = NDArray[np.float64]
Index = NDArray[np.int64]
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class PlateState:
    """The unknowns of a plate: a vector that the plate's methods take apart.

    Parameters
    ----------
    x : array_like, shape (size,)
        Copied, and made read-only.

    Raises
    ------
    InvalidInput
        If an array has a wrong shape, or a number that is not finite.

    Examples
    --------
    >>> from lissome.plates import meshes
    >>> from lissome.plates import Plate
    >>> plate = Plate(mesh=meshes.rectangle(divisions=1), bending=1.0, poisson_ratio=0.3)
    >>> plate.start().x.shape == (plate.space.size,)
    True
    """

    x: Array

    def __post_init__(self) -> None:
        x = np.array(self.x, dtype=float)
        if x.ndim != 1:
            raise InvalidInput(f"argument `x` has shape {x.shape}; it must be a vector")
        x.flags.writeable = False
        object.__setattr__(self, "x", x)


@dataclass(frozen=True, eq=False)
class PlateEquilibrium(Equilibrium):
    """An equilibrium of a plate, with its shape.

    Examples
    --------
    A sheet whose curvature wants to be 0.01 along x: a cylinder, which costs no energy.

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.plates import meshes
    >>> from lissome.plates import Plate
    >>> plate = Plate(
    ...     mesh=meshes.rectangle(divisions=2), bending=1e-4, poisson_ratio=0.3,
    ...     curvature=[[0.01, 0.0], [0.0, 0.0]],
    ... )
    >>> found = ls.equilibrate(plate, plate.interpolate(lambda x, y: 0.005 * x * x))
    >>> print(f"{np.ptp(found.deflection):.5f} {found.bending_energy / 1e-8:.3f}")
    0.00125 0.000

    What the edges of a plate bear: half of the pressure each.

    >>> plate = Plate(
    ...     mesh=meshes.rectangle(divisions=2), bending=1e-2, poisson_ratio=0.0, pressure=1e-3,
    ...     edges={"left": "clamped", "right": "sliding clamp"},
    ... )
    >>> table = ls.equilibrate(plate).reactions().to_frame().set_index("support")
    >>> print(table.force_z.round(7).to_dict())
    {'left': -0.0005, 'right': -0.0005}
    """

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


class PlateUnknowns(BaseStructure):
    """What plates of every scheme can do with their vector of unknowns.

    A scheme defines `mesh`, and `space`: the number `size` of unknowns, the indices that are `free`, a
    mask of those that are `fixed` and their `values`, whether values are `prescribed`, the map
    `geometry` and the size `extent` of the mesh.
    """

    mesh: Any
    support_scale: float
    space: Any
    _shared: dict[str, Any]
    #: Whether the residual of an edge is the work of a density of forces and moments.
    _edges_tell = False

    # -- supports ---------------------------------------------------------------------------------

    def start(self) -> PlateState:
        """Return the flat plate, or, where supports are moved, its linear response."""
        return self.adopt(PlateState(np.zeros(self.space.size)))

    def adopt(self, state: PlateState) -> PlateState:
        """Return `state` with what the supports hold at their values.

        Where values are prescribed, the change of the supports is spread over the plate as a linear,
        flat plate would spread it.
        """
        space = self.space
        x = self._vector(state).copy()
        wanted = self._held[space.fixed]
        change = wanted - x[space.fixed]
        x[space.fixed] = wanted
        if space.prescribed and np.any(change):
            factors, coupling, rows = self._spread
            x[space.free] += factors.solve(-(coupling @ change), -(rows @ change))[0]
        return PlateState(x)

    @property
    def _held(self) -> Array:
        """Values of the unknowns that supports hold, shape (size,)."""
        return self.support_scale * self.space.values

    @property
    def _spread(self) -> tuple[Factorization, Any, Any]:
        """Linear response of the flat plate: factors, forces and constraints of held unknowns."""
        if "spread" not in self._shared:
            from ._fvk_kernel import membrane

            space = self.space
            blocks, quadratic, rows = self._linear()
            local = blocks[0]
            indptr, indices, places = sparse_pattern(local, space.size)
            data = np.zeros(len(indices))
            none = np.zeros(space.size)
            membrane(2, local, places, *blocks[1:], none, np.zeros(space.size), data)
            stiff = sparse.csc_matrix((data, indices, indptr), shape=(space.size,) * 2) + quadratic
            stiff = stiff.tocsr()[space.free]
            flat = PlateState(none)
            jacobian = rows[:, space.free]
            factors = SparseKKT(stiff[:, space.free], jacobian).factorize(
                0.0, self.gauge(flat), self.metric(flat)
            )
            self._shared["spread"] = factors, stiff[:, space.fixed], rows[:, space.fixed]
        return self._shared["spread"]

    def _linear(self) -> tuple[tuple[Any, ...], Any, Any]:
        """Return arguments of the membrane without strain, the quadratic form, the constraints."""
        raise NotImplementedError

    def _support_slope(self) -> float:
        """Return a slope that suits what the supports prescribe."""
        space = self.space
        if not space.prescribed:
            return 0.0
        u, w, slopes = self._parts(self._held)
        fixed_u, fixed_w, _ = self._parts(space.fixed)
        sizes = [0.0]
        for held, fixed in ((u[0], fixed_u[0]), (u[1], fixed_u[1])):
            if np.any(fixed):
                sizes.append(float(np.sqrt(np.ptp(held[fixed]) / space.extent)))
        if np.any(fixed_w):
            sizes.append(float(np.ptp(w[fixed_w])) / space.extent)
        if np.any(slopes):
            sizes.append(float(np.max(np.abs(slopes))) / self._slope_unit)
        return max(sizes)

    @property
    def _slope_unit(self) -> float:
        """What the unknown of a slope is for a slope of 1."""
        return 1.0

    def _parts(self, x: Any) -> tuple[Any, Any, Any]:
        """Return displacement (2, nodes), deflection, slopes of a vector of unknowns."""
        raise NotImplementedError

    def _changed(self, changes: dict[str, Any]) -> set[str]:
        """Return the names of what changes; refuse unknown ones."""
        known = {f.name for f in fields(self) if f.init and not f.name.startswith("_")}  # type: ignore[arg-type]
        unknown = set(changes) - known
        if unknown:
            raise InvalidInput(f"unknown arguments {sorted(unknown)}; known are {sorted(known)}")
        return set(changes)

    def retract(self, state: PlateState, dx: Array) -> PlateState:
        """Return the state reached by the increment `dx` of the free unknowns."""
        x = state.x.copy()
        x[self.space.free] += dx
        return PlateState(x)

    def difference(self, a: PlateState, b: PlateState) -> Array:
        """Return the increment of the free unknowns from `a` to `b`."""
        return (b.x - a.x)[self.space.free]

    def _vector(self, state: PlateState) -> Array:
        if not isinstance(state, PlateState):
            raise InvalidInput(
                f"the state is of type {type(state).__name__}; it must be a PlateState, such as "
                "`plate.start()` or `plate.interpolate(...)`"
            )
        if state.x.shape != (self.space.size,):
            raise InvalidInput(
                f"the state has {state.x.size} unknowns; this plate has {self.space.size}: it "
                "belongs to another mesh, degree or scheme"
            )
        return state.x

    def present(self, equilibrium: Equilibrium) -> PlateEquilibrium:
        """Return the plate's own view of an equilibrium."""
        return equilibrium.as_type(PlateEquilibrium)

    def reactions(self, equilibrium: Equilibrium) -> Reactions:
        """Return what the supports exert in `equilibrium`.

        They go by the parts of the boundary and the positions of points, as they were named in `edges`
        and `points` (by "all" if `edges` is one kind for the whole boundary). What several supports hold
        in common, such as a corner, is divided evenly among them. Forces are in the plane (x, y) and
        across it (z), moments about the middle of an edge or the point, with bending moments along
        clamped edges; a support on a curved or bent edge has the resultant of what acts along it. How
        that of an edge of a `Plate` is distributed tells
        :meth:`Reaction.along() <lissome.reactions.Reaction.along>`.
        """
        return plate_reactions(self, equilibrium.state, equilibrium.multipliers)

    def _residual(self, state: PlateState, multipliers: Array) -> Array:
        """Return the derivative of the Lagrangian by all unknowns, held ones included, shape (size,)."""
        raise NotImplementedError

    def _rigid_motions(self, point: Array, state: PlateState) -> Array:
        """Return displacements along x, y, z and turns about them around `point`, shape (6, size)."""
        raise NotImplementedError

    # -- shapes -----------------------------------------------------------------------------------

    @property
    def _bases(self) -> tuple[tuple[Lagrange, Index], tuple[Lagrange, Index]]:
        """Bases and nodes of the triangles, for displacement and deflection."""
        raise NotImplementedError

    def deflection(self, state: PlateState) -> Array:
        """Return w at the vertices of the mesh, shape (vertices,)."""
        return self._parts(self._vector(state))[1][: self.mesh.nvertices].copy()

    def displacement(self, state: PlateState) -> Array:
        """Return u at the vertices of the mesh, shape (vertices, 2)."""
        return np.ascontiguousarray(self._parts(self._vector(state))[0][:, : self.mesh.nvertices].T)

    def mirrored(self, state: PlateState) -> PlateState:
        """Return the state with the deflection turned over, -w."""
        x = self._vector(state).copy()
        _, w, slopes = self._parts(x)
        w *= -1.0
        slopes *= -1.0
        return PlateState(x)

    def deflection_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return w at points (..., 2)."""
        triangle, reference, shape = self._locate(points)
        basis, local = self._bases[1]
        w = self._parts(self._vector(state))[1]
        values = basis.values(reference)
        return np.sum(values * w[local[triangle]], axis=1).reshape(shape)

    def displacement_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return u at points (..., 2)."""
        triangle, reference, shape = self._locate(points)
        basis, local = self._bases[0]
        values, u = basis.values(reference), self._parts(self._vector(state))[0]
        parts = [np.sum(values * u[i][local[triangle]], axis=1) for i in range(2)]
        return np.stack(parts, axis=-1).reshape(*shape, 2)

    def moments(self, state: PlateState) -> Array:
        """Return the moments at the corners of each triangle, shape (T, 3, 2, 2).

        Components M_xx, M_xy = M_yx, M_yy of B A (kappa - kappa_m); energy per area times length.
        """
        return _tensors(self._moments(state), CORNERS)

    def moments_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return the moments at points (..., 2), shape (..., 2, 2): those of the triangle there."""
        return self._at(points, self._moments(state))

    def membrane_forces(self, state: PlateState) -> Array:
        r"""Return the forces per length in the plane, at the corners of each triangle, (T, 3, 2, 2).

        They are :math:`C\,\mathsf{A}\,(\epsilon - \epsilon_m)`, fitted on each triangle by polynomials
        of one degree less than the displacement.
        """
        return _tensors(self._membrane_forces(state), CORNERS)

    def membrane_forces_at(self, points: ArrayLike, state: PlateState) -> Array:
        """Return the forces per length in the plane at points (..., 2), shape (..., 2, 2)."""
        return self._at(points, self._membrane_forces(state))

    def _moments(self, state: PlateState) -> Array:
        """Return coefficients of the moments, shape (T, polynomials, 3): xx, xy, yy."""
        raise NotImplementedError

    def _membrane_data(self) -> dict[str, Any]:
        """Return `local`, `gradients`, `tilts`, `weights`, moduli, `points` of the membrane energy."""
        raise NotImplementedError

    def _membrane_forces(self, state: PlateState) -> Array:
        """Return coefficients of the membrane forces, shape (T, polynomials, 3): xx, xy, yy."""
        m, x = self._membrane_data(), self._vector(state)
        n, k = m["gradients"].shape[2], m["tilts"].shape[2]
        local = m["local"]
        ux, uy = x[local[:, :n]], x[local[:, n : 2 * n]]
        gx = np.einsum("tqnx,tn->tqx", m["gradients"], ux)
        gy = np.einsum("tqnx,tn->tqx", m["gradients"], uy)
        g = np.einsum("tqnx,tn->tqx", m["tilts"], x[local[:, 2 * n : 2 * n + k]])
        natural = m["natural"]
        xx = gx[..., 0] + 0.5 * g[..., 0] ** 2 - natural[..., 0]
        yy = gy[..., 1] + 0.5 * g[..., 1] ** 2 - natural[..., 1]
        xy = 0.5 * (gx[..., 1] + gy[..., 0] + g[..., 0] * g[..., 1]) - natural[..., 2]
        nu = m["poisson_ratio"]
        a = m["stretching"] / (1 - nu**2)
        values = np.stack([a * (xx + nu * yy), a * (1 - nu) * xy, a * (yy + nu * xx)], axis=-1)
        return fitted(values, m["weights"], lagrange(self._bases[0][0].degree - 1), m["points"])

    def _at(self, points: ArrayLike, coefficients: Array) -> Array:
        triangle, reference, shape = self._locate(points)
        count = coefficients.shape[1]
        basis = lagrange(next(d for d in range(4) if lagrange(d).count == count))
        values = np.einsum("sk,skc->sc", basis.values(reference), coefficients[triangle])
        return values[:, [[0, 1], [1, 2]]].reshape(*shape, 2, 2)

    def _locate(self, points: ArrayLike) -> tuple[Any, Any, tuple[int, ...]]:
        array = finite_array("points", points)
        if array.shape[-1:] != (2,):
            raise InvalidInput(
                f"argument `points` has shape {array.shape}; it must hold pairs (..., 2)"
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
        k = integer_at_least("subdivisions", subdivisions, 1)
        rows = [(i, j) for j in range(k + 1) for i in range(k + 1 - j)]
        number = {pair: index for index, pair in enumerate(rows)}
        reference = np.array(rows, dtype=float) / k
        faces = [
            (number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in rows if i + j < k
        ] + [
            (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
            for i, j in rows if i + j < k - 1
        ]  # fmt: skip
        u, w, _ = self._parts(self._vector(state))
        (plane, outer), (across, inner) = self._bases
        place = self.space.geometry.positions(reference)
        parts = [np.einsum("qn,tn->tq", plane.values(reference), u[i][outer]) for i in range(2)]
        lifted = np.einsum("qn,tn->tq", across.values(reference), w[inner])
        points = np.stack([place[..., 0] + parts[0], place[..., 1] + parts[1], lifted], axis=-1)
        shift = len(reference) * np.arange(len(points))[:, None, None]
        return points.reshape(-1, 3), (np.array(faces)[None] + shift).reshape(-1, 3)

    def _sampled(
        self, positions: tuple[Array, Array], deflection: Callable[..., ArrayLike] | None,
        displacement: Callable[..., ArrayLike] | None,
    ) -> Array:  # fmt: skip
        """Return a vector of unknowns with u and w from functions, slopes zero."""
        out = np.zeros(self.space.size)
        u, w, _ = self._parts(out)
        if displacement is not None:
            u[:] = _values("displacement", displacement, positions[0], (2,)).T
        if deflection is not None:
            w[:] = _values("deflection", deflection, positions[1], ())
        return out


def _values(
    name: str, function: Callable[..., ArrayLike], x: Array, tail: tuple[int, ...]
) -> Array:
    """Return values (nodes, *tail) of a function of the positions x, shape (nodes, 2)."""
    if not callable(function):
        raise InvalidInput(
            f"argument `{name}` is {function!r}; pass a function of arrays x, y to interpolate"
        )
    value = np.asarray(function(*x.T), dtype=float)
    try:
        value = np.broadcast_to(value, (len(x), *tail))
    except ValueError:
        raise InvalidInput(
            f"the function `{name}` returned an array of shape {value.shape} for x, y of shape "
            f"({len(x)},); it must be {(len(x), *tail)}"
        ) from None
    if not np.all(np.isfinite(value)):
        px, py = x[np.argwhere(~np.isfinite(value))[0][0]]
        raise InvalidInput(
            f"the function `{name}` is not finite at the node ({px:.6g}, {py:.6g}); a start has a value "
            "at every node"
        )
    return value


def fitted(values: Array, weights: Array, basis: Lagrange, points: Array) -> Array:
    """Return coefficients (T, polynomials, 3) that fit values (T, Q, 3) at points of triangles."""
    at = basis.values(points)
    gram = np.einsum("tq,qi,qj->tij", weights, at, at)
    tests = np.einsum("tq,qi,tqc->tic", weights, at, values)
    return np.linalg.solve(gram, tests)


def _tensors(coefficients: Array, points: Array) -> Array:
    """Return values (T, points, 2, 2) of a field given by coefficients (T, polynomials, 3)."""
    count = coefficients.shape[1]
    basis = lagrange(next(d for d in range(4) if lagrange(d).count == count))
    values = np.einsum("qk,tkc->tqc", basis.values(points), coefficients)
    return values[..., [[0, 1], [1, 2]]]


def check_moduli(name: str, modulus: Array, poisson_ratio: Array) -> None:
    """Raise if a modulus is not positive somewhere, or Poisson's ratio impossible."""
    if not np.all(modulus > 0):
        raise InvalidInput(
            f"argument `{name}` is {float(np.min(modulus)):.4g} somewhere; a modulus is positive"
        )
    positive(name, float(np.min(modulus)))  # and not absurdly small
    if not np.all((poisson_ratio > -1) & (poisson_ratio <= 0.5)):
        worst = poisson_ratio[~((poisson_ratio > -1) & (poisson_ratio <= 0.5))].ravel()[0]
        raise InvalidInput(
            f"argument `poisson_ratio` is {worst:.4g} somewhere; it must lie in (-1, 1/2]"
        )
