"""The mixed scheme with a field of slopes, a multiplier and a penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse

from .._validate import finite, one_of, positive
from ..errors import InvalidInput
from ..factorization import SparseKKT
from ..structure import Evaluation
from ._fvk_fields import scalar_field, tensor_field, vector_field
from ._fvk_mixed_space import MixedSpace
from ._fvk_space import scatter, sparse_pattern
from ._fvk_state import PlateState, PlateUnknowns, check_moduli, fitted
from ._fvk_supports import edge_load
from ._fvk_tables import lagrange, triangle_rule

__all__ = ["MixedPlate", "projected_bending"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Penalties, in units of the bending modulus over the squared extent, at which the robust form works.
WORKING_PENALTY = (1e-1, 1e3)


@dataclass(frozen=True, eq=False, kw_only=True)
class MixedPlate(PlateUnknowns):
    r"""A Foeppl-von Karman plate by the thesis's augmented Lagrangian (section 5.4).

    Continuous fields w and :math:`\xi` with the constraint :math:`\xi = \nabla w`, whose multiplier
    :math:`\lambda` is continuous too:

    .. math:: L = \int_\Omega C\,W(\epsilon - \epsilon_m) + B\,W(\nabla\xi - \kappa_m)
        + \lambda \cdot (\xi - \nabla w) + \frac{\mu}{2} |\xi - \nabla w|^2 - q w .

    The multiplier space can express the constraint only as :math:`\xi = P \nabla w`, with the L2 projection
    P. Deflections that P does not see cost no bending: they are held by the penalty alone. If the strain
    holds :math:`\nabla w` they relax stresses for nothing (the literal form); with :math:`\xi` in its place
    w enters linearly, and they stay at rest (the robust form).

    Parameters
    ----------
    mesh, bending, poisson_ratio, stretching, strain, curvature, pressure, edges
        As for :class:`~lissome.plates.Plate`. A slope is held only together with the deflection;
        both components of :math:`\xi` are then held, at the normal slope and at the derivative of the
        deflection along the edge.
    body_force, traction, points, support_scale
        As for :class:`~lissome.plates.Plate`.
    penalty : float
        :math:`\mu L^2/B`, with the extent L of the mesh and the largest B. The robust form works from
        0.1 to 1000: below, the projected slopes leave deflections unheld, and above, the elements lock.
    form : {"robust", "literal"}
        ``"robust"``: the strain holds :math:`\xi`. ``"literal"``: it holds :math:`\nabla w`, as printed;
        for study, with any penalty: it has spurious equilibria.
    orders : (int, int)
        Degree of u, and of w, xi and lambda: (2, 1) as printed, or (2, 2).

    Raises
    ------
    InvalidInput
        As :class:`~lissome.plates.Plate`, and for a penalty outside of the working range.

    Notes
    -----
    A tilt of a free plate changes the energy of the robust form by the error of the discretization
    (and that of the literal one on curved triangles, if w is of degree 1); the mean of the slopes is
    therefore held at zero by two more constraints where tilts are allowed.

    For the same reason the moments of the supports about axes in the plane balance those of the loads to
    the error of the discretization: what is missing is the work of the membrane forces N on the misfit of
    the slopes, the vector :math:`\int N (\xi - \nabla w)`, turned by a right angle. It vanishes
    in a plate without membrane forces and with the mesh (order three, where measured). Forces, and moments
    about the normal, balance to rounding errors, as all do of a :class:`~lissome.plates.Plate`.

    Examples
    --------
    A clamped disc of radius R under a small pressure q: in the middle :math:`qR^4/64D`, to the error of
    the mesh.

    >>> import lissome as ls
    >>> from lissome.plates import MixedPlate, meshes
    >>> disc = MixedPlate(mesh=meshes.disc(divisions=6), bending=1e-2, poisson_ratio=0.3,
    ...                   edges="clamped", pressure=1e-9, orders=(2, 2))
    >>> middle = ls.equilibrate(disc).deflection.max()
    >>> print(abs(middle * 64 * 1e-2 / (1 - 0.3**2) / 1e-9 - 1) < 0.01)
    True
    """

    mesh: Any = field(repr=False)
    bending: float | Callable[..., Any]
    poisson_ratio: float | Callable[..., Any]
    stretching: float | Callable[..., Any] = 1.0
    strain: Any = None
    curvature: Any = None
    pressure: float | Callable[..., Any] = 0.0
    edges: Any = "free"
    penalty: float = 10.0
    form: str = "robust"
    orders: tuple[int, int] = (2, 1)
    body_force: Any = None
    traction: Any = None
    points: Any = None
    support_scale: float = 1.0
    _shared: dict[str, Any] = field(default_factory=dict, repr=False)
    _strain: Array = field(init=False, repr=False)
    _force: Array = field(init=False, repr=False)
    _load: Array = field(init=False, repr=False)
    _own: float = field(init=False, repr=False)
    _slope: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        one_of("form", self.form, ("robust", "literal"))
        positive("penalty", self.penalty)
        finite("support_scale", self.support_scale)
        low, high = WORKING_PENALTY
        if self.form == "robust" and not low <= self.penalty <= high:
            why = (
                "deflections that the projected slopes do not see are not held"
                if self.penalty < low
                else "the elements lock, and Newton's method fails"
            )
            raise InvalidInput(
                f"argument `penalty` is {self.penalty:.4g}; the robust form works in [{low}, {high}]: "
                f"at this value {why}"
            )
        space, m = self.space, self._material
        natural = tensor_field("curvature", self.curvature)(m["x"])
        strain = tensor_field("strain", self.strain)(m["x"])
        pressure = scalar_field("pressure", self.pressure)(m["x"])
        force, own = self._of_curvature(natural)
        n = space.outer_nodes
        weights = m["weights"]
        work = np.einsum("tq,tq,qi->ti", weights, pressure, m["inner_values"])
        load = np.zeros(space.size)
        np.add.at(load, 2 * n + space.inner_local, work)
        if self.body_force is not None:
            pull = vector_field("body_force", self.body_force)(m["x"])
            for i in range(2):
                work = np.einsum("tq,tq,qn->tn", weights, pull[..., i], m["outer_values"])
                np.add.at(load, i * n + space.outer_local, work)
        if self.traction is not None:
            load[: 2 * n] += edge_load(
                self.mesh, space.geometry, space.outer, space.outer_local, n, self.traction
            ).ravel()
        object.__setattr__(self, "_load", load)
        object.__setattr__(self, "_strain", strain)
        object.__setattr__(self, "_force", force + load)
        object.__setattr__(self, "_own", own)
        slopes = [float(np.sqrt(np.max(m["bending"] / m["stretching"]))) / space.extent]
        slopes.append(float(np.sqrt(np.max(np.abs(strain)))))
        slopes.append(float(np.max(np.abs(natural))) * space.extent)
        slopes.append(self._support_slope())
        object.__setattr__(self, "_slope", max(slopes))
        exact, tilts = self._neutral
        rows = [self._motion(row, np.zeros(space.size)) for row in (*exact, *tilts)]
        if any(abs(row @ load) > 1e-9 * np.sum(np.abs(load)) for row in rows):
            raise InvalidInput(
                "argument `pressure`, `body_force` or `traction` moves the plate as a whole: its "
                "`edges` do not hold it, and the load does not balance; hold an edge, or balance the load"
            )

    def _of_curvature(self, natural: Array) -> tuple[Array, float]:
        """Return the force of a spontaneous curvature, and its own energy."""
        space, m = self.space, self._material
        nu = m["poisson_ratio"]
        xx, yy, xy = natural[..., 0], natural[..., 1], natural[..., 2]
        scale = m["weights"] * m["bending"] / (1 - nu**2)
        own = 0.5 * scale * (xx**2 + yy**2 + 2 * nu * xx * yy + 2 * (1 - nu) * xy**2)
        moments = np.stack(
            [scale * (xx + nu * yy), scale * (1 - nu) * xy, scale * (yy + nu * xx)], axis=-1
        )
        n, k = space.outer_nodes, space.inner_nodes
        force = np.zeros(space.size)
        for row, parts in ((0, (0, 1)), (1, (1, 2))):
            pull = np.einsum("tqix,tqx->ti", m["inner_gradients"], moments[..., parts])
            np.add.at(force, 2 * n + (1 + row) * k + space.inner_local, pull)
        return force, float(np.sum(own))

    @cached_property
    def space(self) -> MixedSpace:
        """Unknowns and integration points on the mesh."""
        if "space" not in self._shared:
            self._shared["space"] = MixedSpace(self.mesh, self.orders, self.edges, self.points)
        return self._shared["space"]

    @property
    def _material(self) -> dict[str, Any]:
        """Everything that does not depend on spontaneous strain and curvature, nor on the load."""
        if "material" in self._shared:
            return self._shared["material"]
        space = self.space
        points, weights = triangle_rule(4)
        geometry = space.geometry.at(points, weights)
        stretching = scalar_field("stretching", self.stretching)(geometry.x)
        bending = scalar_field("bending", self.bending)(geometry.x)
        poisson_ratio = scalar_field("poisson_ratio", self.poisson_ratio)(geometry.x)
        check_moduli("stretching", stretching, poisson_ratio)
        check_moduli("bending", bending, poisson_ratio)
        values = space.inner.values(points)
        inverse = geometry.inverse
        outer = np.einsum("qnr,tqrx->tqnx", space.outer.gradients(points), inverse)
        inner = np.einsum("qnr,tqrx->tqnx", space.inner.gradients(points), inverse)
        triangles, n1 = len(outer), values.shape[1]
        n, k = space.outer_nodes, space.inner_nodes
        outer_local, inner_local = space.outer_local, space.inner_local
        displacement = [outer_local, outer_local + n]
        w, slopes = inner_local + 2 * n, np.hstack([inner_local + 2 * n + i * k for i in (1, 2)])
        if self.form == "robust":
            tilts = np.zeros((triangles, len(points), 2 * n1, 2))
            tilts[..., :n1, 0] = tilts[..., n1:, 1] = values
            local = np.hstack([*displacement, slopes, w])
        else:
            tilts = inner
            local = np.hstack([*displacement, w, slopes])
        # Bending: W of the full gradient of xi, as printed; entries (xi_a, d_b) with (xi_c, d_d).
        d = geometry.weights * bending / (1 - poisson_ratio**2)
        tensor = np.zeros((2, 2, 2, 2, *d.shape))
        for a in range(2):
            for b in range(2):
                tensor[a, b, a, b] += d * (1 - poisson_ratio)
                tensor[a, a, b, b] += d * poisson_ratio
        local_bending = np.einsum(
            "tqib,abcdtq,tqjd->taicj", inner, tensor, inner, optimize=True
        ).reshape(triangles, 2 * n1, 2 * n1)
        mu = self.penalty * float(np.max(bending)) / space.extent**2
        mass = np.einsum("tq,qi,qj->tij", geometry.weights, values, values)
        cross = np.einsum("tq,qi,tqjx->txij", geometry.weights, values, inner)  # xi_i, d_x w_j
        stiff = np.einsum("tq,tqix,tqjx->tij", geometry.weights, inner, inner, optimize=True)
        block = np.zeros((triangles, 3 * n1, 3 * n1))  # w, xi_x, xi_y
        block[:, n1:, n1:] = local_bending
        block[:, :n1, :n1] = mu * stiff
        for a in range(2):
            part = slice((1 + a) * n1, (2 + a) * n1)
            block[:, part, part] += mu * mass
            block[:, part, :n1] -= mu * cross[:, a]
            block[:, :n1, part] -= mu * cross[:, a].transpose(0, 2, 1)
        where = np.hstack([w, slopes])
        quadratic = scatter(where, where, block, (space.size, space.size))
        rows = [
            scatter(inner_local, slopes[:, a * n1 : (a + 1) * n1], mass, (k, space.size))
            - scatter(inner_local, w, cross[:, a], (k, space.size))
            for a in range(2)
        ]
        constraints = sparse.vstack(rows).tocsr()[space.loose]
        place = np.full(space.size, -1, dtype=np.int64)
        place[space.free] = np.arange(len(space.free))
        indptr, indices, places = sparse_pattern(place[local], len(space.free))
        # The quadratic part on the pattern of the whole.
        free = quadratic[space.free][:, space.free].tocoo()
        keys = np.repeat(np.arange(len(space.free)), np.diff(indptr)) * len(space.free) + indices
        data = np.zeros(len(indices))
        np.add.at(data, np.searchsorted(keys, free.col * len(space.free) + free.row), free.data)
        nodal = np.zeros(n)
        squares = np.einsum("tq,qi->ti", geometry.weights, space.outer.values(points) ** 2)
        np.add.at(nodal, outer_local, squares)
        other = np.zeros(k)
        np.add.at(other, inner_local, np.einsum("tq,qi->ti", geometry.weights, values**2))
        small = float(np.sum(geometry.weights)) / triangles
        self._shared["material"] = {
            "x": geometry.x, "weights": np.ascontiguousarray(geometry.weights),
            "gradients": np.ascontiguousarray(outer), "tilts": np.ascontiguousarray(tilts),
            "inner_gradients": inner, "inner_values": values,
            "outer_values": space.outer.values(points), "points": points,
            "stretching": stretching, "bending": bending, "poisson_ratio": poisson_ratio, "local": local,
            "pattern": (indptr, indices, places), "data": data, "quadratic": quadratic,
            "constraints": constraints,
            "mass": np.concatenate([nodal, nodal, other, small * other, small * other]),
            "stiff": scatter(inner_local, inner_local, stiff, (k, k)),
            "bend": scatter(
                slopes - 2 * n - k, slopes - 2 * n - k, local_bending, (2 * k, 2 * k)),
        }  # fmt: skip
        return self._shared["material"]

    def with_(self, **changes: Any) -> MixedPlate:
        """Return a plate with other arguments; what they do not touch is not computed again.

        Parameters
        ----------
        **changes
            Arguments of the class.
        """
        names = self._changed(changes)
        loads = {"strain", "curvature", "pressure", "body_force", "traction", "support_scale"}
        supports = {"edges", "points"}
        shared = dict(self._shared) if names <= loads | supports else {}
        if names & supports and "space" in shared:
            old = shared["space"]
            new = old.with_supports(
                changes.get("edges", self.edges), changes.get("points", self.points)
            )
            if not np.array_equal(new.fixed, old.fixed):
                shared = {}
            shared["space"] = new
        return replace(self, _shared=shared, **changes)

    # -- rigid motions ----------------------------------------------------------------------------

    def _motion(self, weights: Array, x: Array) -> Array:
        """Return a combination of u_x, u_y, rotation, w, tilt by x, tilt by y, at a state."""
        space = self.space
        n, k, scale = space.outer_nodes, space.inner_nodes, space.extent
        center = space.positions.mean(axis=0)
        place, inner = (space.positions - center) / scale, (space.inner_positions - center) / scale
        out = np.zeros(space.size)
        out[:n] = weights[0] - weights[2] * place[:, 1]
        out[n : 2 * n] = weights[1] + weights[2] * place[:, 0]
        out[2 * n : 2 * n + k] = weights[3] + inner @ weights[4:]
        out[2 * n + k : 2 * n + 2 * k] = weights[4] / scale
        out[2 * n + 2 * k :] = weights[5] / scale
        if np.any(weights[4:]) and np.any(x):
            w = np.zeros(n)
            local = space.inner.values(space.outer.nodes) @ x[2 * n + space.inner_local].T
            w[space.outer_local] = local.T
            w -= w.mean()
            out[:n] -= weights[4] * w / scale
            out[n : 2 * n] -= weights[5] * w / scale
        return out

    @cached_property
    def _neutral(self) -> tuple[Array, Array]:
        """Return combinations of rigid motions that are exact, and those with a tilt."""
        space = self.space
        rows = np.array([self._motion(unit, np.zeros(space.size)) for unit in np.eye(6)])
        held = rows[:, space.fixed]
        allowed = np.eye(6)
        if self.body_force is not None or self.traction is not None:
            # Loads of fixed direction do work when the plate tilts, except about their own direction.
            pull = self._load[: 2 * space.outer_nodes].reshape(2, -1)
            u, values, _ = np.linalg.svd(pull, full_matrices=False)
            loose = u[:, values <= 1e-12 * max(float(values[0]), 1e-300)]
            allowed = np.vstack([allowed[:4], loose.T @ allowed[4:]])
            held = allowed @ held
        if held.size:
            u, values, _ = np.linalg.svd(held, full_matrices=True)
            rank = int(np.count_nonzero(values > 1e-9 * np.sqrt(held.shape[1])))
            allowed = u[:, rank:].T @ allowed
        # Turn the combinations so that as few as possible have a tilt.
        u, values, _ = np.linalg.svd(allowed[:, 4:], full_matrices=True)
        rank = int(np.count_nonzero(values > 1e-9))
        turned = u.T @ allowed
        # A tilt is exact if w can follow it, and the strain holds the gradient of w.
        if self.form == "literal" and space.geometry.basis.degree <= space.orders[1]:
            return turned, np.zeros((0, 6))
        return turned[rank:], turned[:rank]

    # -- the structure ------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Number of free unknowns u, w and xi."""
        return len(self.space.free)

    @property
    def constraints_count(self) -> int:
        """Number of multipliers."""
        return self._jacobian.shape[0]

    @cached_property
    def _jacobian(self) -> Any:
        space, m = self.space, self._material
        jacobian = m["constraints"][:, space.free]
        _, tilts = self._neutral
        if len(tilts):
            n = space.outer_nodes
            means = []
            for row in tilts:
                slopes = np.zeros(space.size)
                motion = self._motion(row, np.zeros(space.size))
                slopes[2 * n + space.inner_nodes :] = motion[2 * n + space.inner_nodes :]
                # Mean over the area: the mass matrix times a constant field.
                means.append(slopes * m["mass"])
            rows = sparse.csr_matrix(np.array(means)[:, space.free])
            jacobian = sparse.vstack([jacobian, rows]).tocsr()
        return jacobian

    def evaluate(self, state: PlateState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy (with the penalty), constraints, gradient and KKT matrix."""
        from ._fvk_kernel import membrane

        space, m = self.space, self._material
        x = self._vector(state)
        indptr, indices, places = m["pattern"]
        force = np.zeros(space.size)
        data = m["data"].copy() if order == 2 else np.empty(0)
        energy = membrane(
            order, m["local"], places, m["gradients"], m["tilts"], m["weights"], m["stretching"],
            m["poisson_ratio"], self._strain, x, force, data,
        )  # fmt: skip
        moment = m["quadratic"] @ x
        energy += 0.5 * float(x @ moment) - float(self._force @ x) + self._own
        jacobian = self._jacobian
        constraints = jacobian @ x[space.free]
        constraints[: len(space.loose)] = m["constraints"] @ x  # held unknowns count too
        if order == 0:
            return Evaluation(energy, constraints)
        gradient = (force + moment - self._force)[space.free] + jacobian.T @ multipliers
        if order == 1:
            return Evaluation(energy, constraints, gradient)
        n = len(space.free)
        hessian = sparse.csc_matrix((data, indices, indptr), shape=(n, n))
        return Evaluation(energy, constraints, gradient, SparseKKT(hessian, jacobian))

    def _residual(self, state: PlateState, multipliers: Array) -> Array:
        from ._fvk_kernel import membrane

        space, m, x = self.space, self._material, self._vector(state)
        force = np.zeros(space.size)
        membrane(
            1, m["local"], m["pattern"][2], m["gradients"], m["tilts"], m["weights"],
            m["stretching"], m["poisson_ratio"], self._strain, x, force, np.empty(0),
        )  # fmt: skip
        rows = m["constraints"]
        return np.asarray(
            force + m["quadratic"] @ x - self._force + rows.T @ multipliers[: rows.shape[0]]
        )

    def _rigid_motions(self, point: Array, state: PlateState) -> Array:
        space, n, k = self.space, self.space.outer_nodes, self.space.inner_nodes
        vector = self._vector(state)
        outer = np.empty(n)
        local = vector[2 * n + space.inner_local] @ space.inner.values(space.outer.nodes).T
        outer[space.outer_local] = local - point[2]
        x, y = (space.positions - point[:2]).T
        across, up = (space.inner_positions - point[:2]).T
        rows = np.zeros((6, space.size))
        rows[0, :n] = rows[1, n : 2 * n] = rows[2, 2 * n : 2 * n + k] = 1.0
        rows[3, n : 2 * n], rows[3, 2 * n : 2 * n + k], rows[3, 2 * n + 2 * k :] = -outer, up, 1.0
        rows[4, :n], rows[4, 2 * n : 2 * n + k] = outer, -across
        rows[4, 2 * n + k : 2 * n + 2 * k] = -1.0
        rows[5, :n], rows[5, n : 2 * n] = -y, x
        return rows

    def metric(self, state: PlateState) -> Array:
        """Return areas of the nodes; for slopes, times the mean area of a triangle."""
        return self._material["mass"][self.space.free]

    def typical(self, state: PlateState) -> Array:
        """Return sizes that fit the thickness, the spontaneous strain and the curvature."""
        space, s = self.space, self._slope
        n, k = space.outer_nodes, space.inner_nodes
        sizes = np.concatenate(
            [np.full(2 * n, s**2 * space.extent), np.full(k, s * space.extent), np.full(2 * k, s)]
        )
        return sizes[space.free]

    def gauge(self, state: PlateState) -> Array:
        """Return the rigid motions that change nothing, exactly."""
        exact, _ = self._neutral
        x = self._vector(state)
        rows = np.array([self._motion(row, x) for row in exact]).reshape(-1, len(x))
        return rows[:, self.space.free]

    # -- what a state means -------------------------------------------------------------------------

    def interpolate(
        self,
        deflection: Callable[[Array, Array], ArrayLike] | None = None,
        displacement: Callable[[Array, Array], ArrayLike] | None = None,
    ) -> PlateState:
        """Return the state that interpolates functions of x, y; slopes are projected.

        Parameters
        ----------
        deflection : callable, optional
            w(x, y); zero by default.
        displacement : callable, optional
            Displacement in the plane, shape (2, ...); zero by default.
        """
        space = self.space
        n, k = space.outer_nodes, space.inner_nodes
        out = self._sampled((space.positions, space.inner_positions), deflection, displacement)
        out[2 * n + k :] = self._projected(out[2 * n : 2 * n + k])
        return PlateState(out)

    def _projected(self, w: Array) -> Array:
        """Return the slopes that satisfy the constraint for nodal deflections."""
        space = self.space
        n, k = space.outer_nodes, space.inner_nodes
        constraints = self._material["constraints"]
        loose = 2 * n + k + space.loose
        out = np.zeros(2 * k)
        right = -(constraints[:, 2 * n : 2 * n + k] @ w)
        out[space.loose] = sparse.linalg.spsolve(constraints[:, loose].tocsc(), right)
        return out

    def force_of(self, curvature: Any) -> Array:
        """Return the force on the free unknowns that a spontaneous curvature adds, shape (size,).

        It is the same in every state, and proportional to `curvature` (array_like (2, 2) or callable).
        """
        natural = tensor_field("curvature", curvature)(self._material["x"])
        return self._of_curvature(natural)[0][self.space.free]

    def energies(self, state: PlateState) -> tuple[float, float, float]:
        """Return stretching and bending energy (with the penalty), and potential of loads, of `state`."""
        from ._fvk_kernel import membrane

        m, x = self._material, self._vector(state)
        stretching = membrane(
            0, m["local"], m["pattern"][2], m["gradients"], m["tilts"], m["weights"],
            m["stretching"], m["poisson_ratio"], self._strain, x, np.zeros(0), np.empty(0),
        )  # fmt: skip
        bend = 0.5 * float(x @ (m["quadratic"] @ x)) + self._own
        bend -= float((self._force - self._load) @ x)
        return float(stretching), bend, -float(self._load @ x)

    def curvature_at(self, points: ArrayLike, state: PlateState) -> Array:
        r"""Return the curvature, the symmetric part of :math:`\nabla\xi`, at `points`, shape (..., 2, 2).

        Parameters
        ----------
        points : array_like, shape (..., 2)
            Coordinates x, y.
        state : PlateState
            Whose curvature.
        """
        triangle, reference, shape = self._locate(points)
        space = self.space
        jacobian = np.einsum(
            "snx,snr->sxr", space.geometry.corners[triangle],
            space.geometry.basis.gradients(reference),
        )  # fmt: skip
        gradient = np.einsum(
            "snr,srx->snx", space.inner.gradients(reference), np.linalg.inv(jacobian)
        )
        slopes = self._parts(self._vector(state))[2].reshape(2, -1)
        bent = np.einsum("snx,asn->sax", gradient, slopes[:, space.inner_local[triangle]])
        return (0.5 * (bent + bent.transpose(0, 2, 1))).reshape(*shape, 2, 2)

    # -- what the schemes share -------------------------------------------------------------------

    def _parts(self, x: Any) -> tuple[Any, Any, Any]:
        n, k = self.space.outer_nodes, self.space.inner_nodes
        return x[: 2 * n].reshape(2, n), x[2 * n : 2 * n + k], x[2 * n + k :]

    @property
    def _bases(self) -> Any:
        space = self.space
        return (space.outer, space.outer_local), (space.inner, space.inner_local)

    def _linear(self) -> Any:
        m = self._material
        blocks = (
            m["local"], m["gradients"], m["tilts"], m["weights"], m["stretching"], m["poisson_ratio"],
            np.zeros_like(self._strain),
        )  # fmt: skip
        rows = m["constraints"]
        further = self._jacobian.shape[0] - rows.shape[0]
        if further:  # means of the slopes: where they are held, no slope is
            means = sparse.lil_matrix((further, self.space.size))
            means[:, self.space.free] = self._jacobian[rows.shape[0] :]
            rows = sparse.vstack([rows, means]).tocsr()
        return blocks, m["quadratic"], rows

    def _membrane_data(self) -> dict[str, Any]:
        m = self._material
        names = ("local", "gradients", "tilts", "weights", "stretching", "poisson_ratio", "points")
        return {name: m[name] for name in names} | {"natural": self._strain}

    def _moments(self, state: PlateState) -> Array:
        space, m = self.space, self._material
        slopes = self._parts(self._vector(state))[2].reshape(2, -1)[:, space.inner_local]
        bent = np.einsum("tqix,ati->tqax", m["inner_gradients"], slopes)
        natural = tensor_field("curvature", self.curvature)(m["x"])
        xx, yy = bent[..., 0, 0] - natural[..., 0], bent[..., 1, 1] - natural[..., 1]
        xy = 0.5 * (bent[..., 0, 1] + bent[..., 1, 0]) - natural[..., 2]
        nu = m["poisson_ratio"]
        b = m["bending"] / (1 - nu**2)
        values = np.stack([b * (xx + nu * yy), b * (1 - nu) * xy, b * (yy + nu * xx)], axis=-1)
        return fitted(values, m["weights"], lagrange(space.orders[1]), m["points"])


def projected_bending(plate: MixedPlate, count: int = 8) -> tuple[Array, Array]:
    r"""Return the softest deflections on the kernel of the constraint: the inf-sup test.

    On the kernel, :math:`\xi = P\nabla w`, the eigenvalues are those of

    .. math:: \int B\,W''(\nabla P \nabla w) = \sigma \frac{B}{L^2} \int |\nabla w|^2 .

    A stable scheme has as many zeros as there are rigid motions of the deflection and then eigenvalues
    that stay away from zero as the mesh is refined. Each further zero is a deflection that costs no
    bending: only the penalty holds it.

    Parameters
    ----------
    plate : MixedPlate
        Its mesh, orders, edges and bending count; the penalty does not.
    count : int
        How many eigenvalues.

    Returns
    -------
    values : ndarray, shape (count,)
        Dimensionless, ascending; one constant deflection, which has no gradient, is left out where
        the edges allow it.
    modes : ndarray, shape (count, nodes of w)
        Deflections at all nodes.

    Raises
    ------
    InvalidInput
        If `count` is not positive, or greater than the number of deflections.

    Examples
    --------
    On a coarse square of the order that is printed, clamped, one deflection costs nothing:

    >>> from lissome.plates import MixedPlate, meshes, projected_bending
    >>> plate = MixedPlate(mesh=meshes.rectangle(divisions=2), bending=1e-4, poisson_ratio=0.3,
    ...                    edges="clamped")
    >>> values, modes = projected_bending(plate, count=3)
    >>> print((values > 1e-9).tolist(), modes.shape)
    [False, True, True] (3, 25)
    """
    space, m = plate.space, plate._material
    n, k = space.outer_nodes, space.inner_nodes
    if k > 3000:
        raise InvalidInput(
            f"argument `plate` has {k} nodes of w; the test is dense: take a mesh with up to 3000"
        )
    held = space.fixed[2 * n : 2 * n + k]
    free = np.flatnonzero(~held)
    constraints = m["constraints"]
    loose = 2 * n + k + space.loose
    slopes = np.zeros((2 * k, len(free)))
    right = -constraints[:, 2 * n + free].toarray()
    slopes[space.loose] = sparse.linalg.splu(constraints[:, loose].tocsc()).solve(right)
    bending = slopes.T @ (m["bend"] @ slopes)
    gradient = m["stiff"][free][:, free].toarray()
    basis = np.eye(len(free))
    if len(free) == k:  # without the constant
        basis = linalg.null_space(np.ones((1, k)))
    a, b = basis.T @ bending @ basis, basis.T @ gradient @ basis
    count = min(count, len(a))
    values, vectors = linalg.eigh(0.5 * (a + a.T), 0.5 * (b + b.T), subset_by_index=[0, count - 1])
    modes = np.zeros((count, k))
    modes[:, free] = (basis @ vectors).T
    return values * space.extent**2 / float(np.max(m["bending"])), modes
