r"""Axisymmetric Foeppl-von Karman discs by collocation, and their stability to waves in angle.

A disc of radius R with deflection w(r), slope :math:`\varphi = w'` and radial displacement u(r). With

.. math:: \epsilon_r = u' + \tfrac12 \varphi^2,\quad \epsilon_\theta = u/r,\quad
    \kappa_r = \varphi',\quad \kappa_\theta = \varphi/r,

and stress and moment linear in the strain and curvature beyond the spontaneous ones, the balance is

.. math:: (r N_r)' = N_\theta, \qquad (r M_r)' - M_\theta = r N_r \varphi + \int_0^r q s\, ds .

At the core of a defect u and the slope behave like r log r. The unknowns are therefore u/r and
:math:`\varphi/r` as functions of x = log(r/R): polynomials of high degree on pieces of x. Nothing is
shared with the finite elements of :mod:`lissome.plates`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from .._validate import finite, finite_array, in_open_interval, integer_at_least, one_of, positive
from ..errors import InvalidInput, NotConverged

__all__ = ["AxisymmetricDisc", "AxisymmetricState", "buckling_strain", "fold"]

Array = NDArray[np.float64]

#: What an edge holds: (slope, radial displacement). Deflection is measured from the edge.
EDGES = {
    "free": (False, False),
    "simply supported": (False, False),
    "hinged": (False, True),
    "clamped": (True, True),
    "sliding clamp": (True, False),
}
_DEPTH = 14.0  # log of the radius over that of the core, which is taken as linear
_PIECES = 14
_DEGREE = 12


@lru_cache
def _grid(pieces: int, degree: int) -> tuple[Array, Array, Array]:
    """Return Lobatto points x (pieces, degree + 1), derivative matrix by x, and weights."""
    angle = np.pi * np.arange(degree + 1) / degree
    y = -np.cos(angle)
    c = np.where((np.arange(degree + 1) == 0) | (np.arange(degree + 1) == degree), 2.0, 1.0)
    c = c * (-1.0) ** np.arange(degree + 1)
    gap = y[:, None] - y[None, :] + np.eye(degree + 1)
    d = np.outer(c, 1 / c) / gap
    d -= np.diag(d.sum(axis=1))
    # Clenshaw-Curtis: integrals of the Chebyshev polynomials.
    k = np.arange(degree + 1)
    vander = np.cos(np.outer(np.pi - angle, k))
    moments = np.where(k % 2 == 0, 2.0 / (1.0 - np.where(k % 2 == 0, k, 0) ** 2.0), 0.0)
    weights = np.linalg.solve(vander.T, moments)
    # Short pieces near the rim, where the boundary layer is.
    ends = -_DEPTH * (1 - np.linspace(0, 1, pieces + 1)) ** 1.5
    half = 0.5 * np.diff(ends)
    x = 0.5 * (ends[1:] + ends[:-1])[:, None] + half[:, None] * y
    x[-1, -1] = 0.0
    return x, d[None] / half[:, None, None], half[:, None] * weights


@dataclass(frozen=True, eq=False)
class AxisymmetricDisc:
    r"""An axisymmetric Foeppl-von Karman disc.

    Parameters
    ----------
    bending : float
        Bending modulus B (Y h^3/12: the factor 1/(1 - nu^2) is extra).
    poisson_ratio : float
    radius, stretching : float
        Radius R, and stretching modulus C (Y h).
    strain, curvature : array_like, shape (2,)
        Spontaneous strain and curvature, radial and azimuthal; uniform.
    pressure : float
        Uniform load along w.
    edge : str
        "free", "simply supported", "hinged", "clamped" or "sliding clamp".

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    A load that is small: q R^4/(64 D) at the center of a clamped disc.

    >>> from lissome.references.disc import AxisymmetricDisc
    >>> disc = AxisymmetricDisc(bending=1e-2, poisson_ratio=0.3, edge="clamped", pressure=1e-9)
    >>> flexural = 1e-2 / (1 - 0.3**2)
    >>> round(disc.solve().height * 64 * flexural / 1e-9, 6)
    1.0
    """

    bending: float
    poisson_ratio: float
    radius: float = 1.0
    stretching: float = 1.0
    strain: ArrayLike = (0.0, 0.0)
    curvature: ArrayLike = (0.0, 0.0)
    pressure: float = 0.0
    edge: str = "free"

    def __post_init__(self) -> None:
        positive("bending", self.bending)
        positive("stretching", self.stretching)
        positive("radius", self.radius)
        if self.poisson_ratio != 0.5:
            in_open_interval("poisson_ratio", self.poisson_ratio, -1.0, 0.5)
        finite("pressure", self.pressure)
        one_of("edge", self.edge, EDGES)
        for name in ("strain", "curvature"):
            value = finite_array(name, getattr(self, name), shape=(2,))
            object.__setattr__(self, name, value)
        if self.edge == "free" and self.pressure:
            raise InvalidInput(
                f"argument `pressure` is {self.pressure}; a disc with a free edge is moved by it"
            )

    def residual(self, z: Array, jacobian: bool = True) -> tuple[Array, Array | None]:
        """Return the collocation equations of u/r and slope/r, and their derivatives.

        Parameters
        ----------
        z : ndarray, shape (size,)
            The unknowns, as :class:`AxisymmetricState` holds them.
        jacobian : bool
            Whether the derivatives are wanted; None in their place if not.
        """
        x, d, _ = _grid(_PIECES, _DEGREE)
        pieces, k = x.shape
        n = pieces * (k - 1) + 1
        index = np.arange(pieces)[:, None] * (k - 1) + np.arange(k)
        r2 = (self.radius * np.exp(x)) ** 2
        p, s = z[:n][index], z[n:][index]
        nu = self.poisson_ratio
        c, b = self.stretching / (1 - nu**2), self.bending / (1 - nu**2)
        strain, curvature = np.asarray(self.strain), np.asarray(self.curvature)
        px = np.einsum("eij,ej->ei", d, p)
        sx = np.einsum("eij,ej->ei", d, s)
        er, et = p + px + 0.5 * r2 * s * s - strain[0], p - strain[1]
        kr, kt = s + sx - curvature[0], s - curvature[1]
        nr, nt = c * (er + nu * et), c * (et + nu * er)
        mr, mt = b * (kr + nu * kt), b * (kt + nu * kr)
        plane = nr + np.einsum("eij,ej->ei", d, nr) - nt
        bend = mr + np.einsum("eij,ej->ei", d, mr) - mt - r2 * nr * s - 0.5 * self.pressure * r2
        # Near the core u/r and slope/r are linear in x.
        core = 0.5 * (1 - nu)
        out = np.zeros(2 * n)
        inner = index[:, 1:-1]
        out[inner], out[n + inner] = plane[:, 1:-1] / c, bend[:, 1:-1] / b
        joint = index[1:, 0]
        out[joint], out[n + joint] = px[:-1, -1] - px[1:, 0], sx[:-1, -1] - sx[1:, 0]
        out[0] = px[0, 0] - core * (strain[0] - strain[1])
        out[n] = sx[0, 0] - core * (curvature[0] - curvature[1])
        holds_slope, holds_u = EDGES[self.edge]
        last = n - 1
        out[last] = p[-1, -1] if holds_u else nr[-1, -1] / c
        out[n + last] = s[-1, -1] if holds_slope else mr[-1, -1] / b
        if not jacobian:
            return out, None
        eye = np.eye(k)[None]
        er_p, er_s = eye + d, (r2 * s)[:, :, None] * eye
        nr_p, nr_s = er_p + nu * eye, er_s
        nt_p, nt_s = eye + nu * er_p, nu * er_s
        mr_s, mt_s = eye + d + nu * eye, eye + nu * (eye + d)
        plane_p, plane_s = nr_p + d @ nr_p - nt_p, nr_s + d @ nr_s - nt_s
        weight = (c / b) * r2
        bend_p = -(weight * s)[:, :, None] * nr_p
        bend_s = mr_s + d @ mr_s - mt_s - (weight * s)[:, :, None] * nr_s
        bend_s = bend_s - (weight * nr / c)[:, :, None] * eye
        full = np.zeros((2 * n, 2 * n))
        for e in range(pieces):
            rows, columns = inner[e][:, None], index[e][None]
            full[rows, columns] = plane_p[e, 1:-1]
            full[rows, n + columns] = plane_s[e, 1:-1]
            full[n + rows, columns] = bend_p[e, 1:-1]
            full[n + rows, n + columns] = bend_s[e, 1:-1]
        for e in range(pieces - 1):
            for shift in (0, n):
                row = shift + joint[e]
                full[row, shift + index[e]] += d[e, -1]
                full[row, shift + index[e + 1]] -= d[e + 1, 0]
        full[0, index[0]], full[n, n + index[0]] = d[0, 0], d[0, 0]
        if holds_u:
            full[last, last] = 1.0
        else:
            full[last, index[-1]], full[last, n + index[-1]] = nr_p[-1, -1], nr_s[-1, -1]
        if holds_slope:
            full[n + last, n + last] = 1.0
        else:
            full[n + last, n + index[-1]] = mr_s[-1, -1]
        return out, full

    @property
    def size(self) -> int:
        """Number of unknowns of the collocation."""
        return 2 * (_PIECES * _DEGREE + 1)

    def _paraboloid(self, height: float) -> Array:
        """Return unknowns of the paraboloid of a height, with the displacement that balances."""
        n = self.size // 2
        z = np.concatenate([np.zeros(n), np.full(n, -2 * height / self.radius**2)])
        f, jacobian = self.residual(z)
        assert jacobian is not None
        z[:n] = np.linalg.solve(jacobian[:n, :n], -f[:n])  # linear in the displacement
        return z

    def solve(
        self, start: AxisymmetricState | None = None, *, height: float | None = None
    ) -> AxisymmetricState:
        """Solve by Newton's method.

        Parameters
        ----------
        start : AxisymmetricState, optional
            Where to start; flat by default.
        height : float, optional
            Start from a paraboloid whose center is this high above the edge.

        Returns
        -------
        AxisymmetricState

        Raises
        ------
        InvalidInput
            If an argument is out of its range.
        NotConverged
            If Newton's method does not converge.
        """
        if start is not None and height is not None:
            raise InvalidInput("arguments `start` and `height` are both given; give one")
        if start is not None:
            z = start.unknowns.copy()
        else:
            z = self._paraboloid(0.0 if height is None else finite("height", height))
        for _ in range(200):
            f, jacobian = self.residual(z)
            assert jacobian is not None
            dz = np.linalg.solve(jacobian, -f)
            size = float(np.max(np.abs(dz)))
            if size <= 1e-11 * (float(np.max(np.abs(z + dz))) + 1e-30):
                return AxisymmetricState(self, z + dz)
            factors = linalg.lu_factor(jacobian)
            step = 1.0
            while step > 1e-6:  # natural monotonicity
                trial = linalg.lu_solve(factors, self.residual(z + step * dz, False)[0])
                if np.max(np.abs(trial)) <= (1 - 0.25 * step) * size or size < 1e-9:
                    break
                step *= 0.5
            else:
                break
            z = z + step * dz
        raise NotConverged("the disc has no axisymmetric state near the start; start nearer")


@dataclass(frozen=True, eq=False)
class AxisymmetricState:
    """A state of a disc.

    Attributes
    ----------
    disc : AxisymmetricDisc
        The disc.
    unknowns : ndarray, shape (size,)
        u/r, then slope/r, at the collocation points.

    Examples
    --------
    Under a small load a clamped disc takes the shape :math:`(1 - r^2)^2`:

    >>> from lissome.references.disc import AxisymmetricDisc
    >>> disc = AxisymmetricDisc(bending=1e-2, poisson_ratio=0.3, edge="clamped", pressure=1e-9)
    >>> state = disc.solve()
    >>> print((state.deflection([0.0, 0.5, 1.0]) / state.height).round(6) + 0.0)
    [1.     0.5625 0.    ]
    """

    disc: AxisymmetricDisc
    unknowns: Array = field(repr=False)

    @cached_property
    def _parts(self) -> dict[str, Array]:
        x, d, weights = _grid(_PIECES, _DEGREE)
        pieces, k = x.shape
        n = pieces * (k - 1) + 1
        index = np.arange(pieces)[:, None] * (k - 1) + np.arange(k)
        p, s = self.unknowns[:n][index], self.unknowns[n:][index]
        r = self.disc.radius * np.exp(x)
        px, sx = np.einsum("eij,ej->ei", d, p), np.einsum("eij,ej->ei", d, s)
        # w from the rim: the antiderivative of slope times dr/dx.
        w = np.zeros_like(r)
        level = 0.0
        for e in range(pieces - 1, -1, -1):
            system = d[e].copy()
            system[-1] = 0.0
            system[-1, -1] = 1.0
            right = r[e] ** 2 * s[e]
            right[-1] = level
            w[e] = np.linalg.solve(system, right)
            level = w[e, 0]
        return {"r": r, "p": p, "s": s, "px": px, "sx": sx, "w": w, "weights": weights}

    @property
    def height(self) -> float:
        """Deflection of the center above the edge."""
        parts = self._parts
        return float(parts["w"][0, 0] - 0.5 * parts["r"][0, 0] ** 2 * parts["s"][0, 0])

    def _fields(self) -> tuple[Array, Array, Array, Array]:
        """Return elastic strain and curvature, radial and azimuthal."""
        a, disc = self._parts, self.disc
        strain, curvature = np.asarray(disc.strain), np.asarray(disc.curvature)
        er = a["p"] + a["px"] + 0.5 * (a["r"] * a["s"]) ** 2 - strain[0]
        return er, a["p"] - strain[1], a["s"] + a["sx"] - curvature[0], a["s"] - curvature[1]

    @cached_property
    def energy(self) -> float:
        """Energy, with the potential of the load."""
        a, disc = self._parts, self.disc
        nu = disc.poisson_ratio
        er, et, kr, kt = self._fields()
        density = disc.stretching * (er**2 + et**2 + 2 * nu * er * et)
        density += disc.bending * (kr**2 + kt**2 + 2 * nu * kr * kt)
        density /= 2 * (1 - nu**2)
        density -= disc.pressure * a["w"]
        area = 2 * np.pi * a["weights"] * a["r"] ** 2
        core = np.pi * a["r"][0, 0] ** 2 * density[0, 0]
        return float(np.sum(area * density) + core)

    @cached_property
    def stresses(self) -> tuple[Array, Array]:
        """Radial and azimuthal stress resultants at the collocation points, shape (pieces, points) each."""
        er, et, _, _ = self._fields()
        nu = self.disc.poisson_ratio
        c = self.disc.stretching / (1 - nu**2)
        return c * (er + nu * et), c * (et + nu * er)

    def _interpolate(self, values: Array, radius: ArrayLike) -> Array:
        r = finite_array("radius", radius)
        grid, parts = _grid(_PIECES, _DEGREE)[0], self._parts
        if np.any(r < 0) or np.any(r > self.disc.radius * (1 + 1e-12)):
            raise InvalidInput(
                f"argument `radius` must lie in [0, {self.disc.radius}], the disc's own"
            )
        x = np.log(np.clip(r / self.disc.radius, parts["r"][0, 0] / self.disc.radius, 1.0))
        out = np.empty(r.shape)
        for where in np.ndindex(r.shape):
            e = min(int(np.searchsorted(grid[:, -1], x[where])), _PIECES - 1)
            nodes = grid[e]
            gap = x[where] - nodes
            if np.any(gap == 0):
                out[where] = values[e, int(np.argmin(np.abs(gap)))]
                continue
            c = (-1.0) ** np.arange(len(nodes))
            c[[0, -1]] *= 0.5
            out[where] = np.sum(c / gap * values[e]) / np.sum(c / gap)
        return out

    def deflection(self, radius: ArrayLike) -> Array:
        """Return w, measured from the edge, at distances `radius` from the center, of their shape."""
        return self._interpolate(self._parts["w"], radius)

    def slope(self, radius: ArrayLike) -> Array:
        """Return w' at distances `radius` from the center, of their shape."""
        return self._interpolate(self._parts["r"] * self._parts["s"], radius)

    def displacement(self, radius: ArrayLike) -> Array:
        """Return u at distances `radius` from the center, of their shape."""
        return self._interpolate(self._parts["r"] * self._parts["p"], radius)

    def softest(self, waves: int, terms: int = 16) -> float:
        r"""Return the lowest eigenvalue of the second variation for waves :math:`\cos n\theta`.

        Ritz' method with polynomials of r, for u cos, v sin and w cos of n theta; rates are relative
        to the second variation of :math:`|u|^2 + |w|^2` per area. The radius is 1 in the polynomials.

        Parameters
        ----------
        waves : int
            n, at least 2.
        terms : int
            Polynomials for each of u, v, w.

        Returns
        -------
        float
            Negative when the disc is unstable to these waves. Energy over length^4.

        Raises
        ------
        InvalidInput
            If an argument is out of its range.
        """
        waves = integer_at_least("waves", waves, 2)
        terms = integer_at_least("terms", terms, 2)
        a, disc = self._parts, self.disc
        r = a["r"].ravel()
        weights = (a["weights"] * a["r"] ** 2).ravel() * np.pi  # cos^2 and sin^2 give pi
        y = r / disc.radius
        base = np.polynomial.legendre.legvander(2 * y - 1, terms - 1)
        rise = np.stack(
            [np.polynomial.Legendre.basis(j).deriv(1)(2 * y - 1) for j in range(terms)], axis=1
        ) * (2 / disc.radius)
        bend = (
            np.stack(
                [np.polynomial.Legendre.basis(j).deriv(2)(2 * y - 1) for j in range(terms)], axis=1
            )
            * (2 / disc.radius) ** 2
        )
        holds_slope, holds_u = EDGES[disc.edge]
        holds_w = disc.edge != "free"
        g = (1 - y) ** int(holds_u)
        u = (y * g)[:, None] * base
        gu = g if not holds_u else 1 - 2 * y
        ur = (gu / disc.radius)[:, None] * base + (y * g)[:, None] * rise
        power = 2 if holds_slope else int(holds_w)
        shape = (
            np.polynomial.Polynomial([0, 0, 1.0]) * np.polynomial.Polynomial([1.0, -1.0]) ** power
        )
        f, f1, f2 = (shape.deriv(i)(y) / disc.radius**i if i else shape(y) for i in range(3))
        w = f[:, None] * base
        wr = f1[:, None] * base + f[:, None] * rise
        wrr = f2[:, None] * base + 2 * f1[:, None] * rise + f[:, None] * bend
        zero, n = np.zeros_like(u), waves
        over = 1 / r[:, None]
        phi = (a["r"] * a["s"]).ravel()[:, None]
        # Strains and curvatures of (u cos, v sin, w cos).
        err = np.hstack([ur, zero, phi * wr])
        ett = np.hstack([u * over, n * u * over, zero])
        ert = 0.5 * np.hstack([-n * u * over, ur - u * over, -n * phi * w * over])
        krr = np.hstack([zero, zero, wrr])
        ktt = np.hstack([zero, zero, wr * over - n**2 * w * over**2])
        krt = np.hstack([zero, zero, -n * (wr * over - w * over**2)])
        gr, gt = np.hstack([zero, zero, wr]), np.hstack([zero, zero, -n * w * over])
        nu = disc.poisson_ratio

        def form(stiffness: float, rr: Array, tt: Array, rt: Array) -> Array:
            k = stiffness / (1 - nu**2)
            both = rr.T @ (weights[:, None] * tt)
            return k * (
                rr.T @ (weights[:, None] * rr) + tt.T @ (weights[:, None] * tt)
                + nu * (both + both.T) + 2 * (1 - nu) * rt.T @ (weights[:, None] * rt)
            )  # fmt: skip

        nr, nt = (part.ravel() for part in self.stresses)
        matrix = form(disc.stretching, err, ett, ert) + form(disc.bending, krr, ktt, krt)
        matrix += gr.T @ ((weights * nr)[:, None] * gr) + gt.T @ ((weights * nt)[:, None] * gt)
        mass = np.zeros_like(matrix)
        for i, part in enumerate((u, u, w)):
            block = slice(i * terms, (i + 1) * terms)
            mass[block, block] = part.T @ (weights[:, None] * part)
        return float(linalg.eigh(matrix, mass, eigvals_only=True, subset_by_index=[0, 0])[0])


def fold(
    state: AxisymmetricState, curvature: ArrayLike, *, step: float = 0.05, most: float = 1e3
) -> tuple[float, AxisymmetricState]:
    r"""Follow a state as its spontaneous curvature grows, to the first fold.

    The spontaneous curvature is that of the state plus p times a direction; p grows from 0.

    Parameters
    ----------
    state : AxisymmetricState
        Where p = 0; not flat, since its size is that of the first steps.
    curvature : array_like, shape (2,)
        The direction, radial and azimuthal.
    step : float
        First step in p.
    most : float
        p at which to give up.

    Returns
    -------
    p : float
        At the fold.
    AxisymmetricState
        There.

    Raises
    ------
    InvalidInput
        If the state is flat and unstrained, or the direction is not finite.
    NotConverged
        If there is no fold up to `most`.

    Examples
    --------
    A dome of a strain with a defect: spontaneous curvature against it lowers the dome, until it folds.

    >>> from lissome.references.disc import AxisymmetricDisc, fold
    >>> disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5, radius=0.5, strain=(0.01, -0.02))
    >>> dome = disc.solve(height=0.1)
    >>> p, last = fold(dome, (-1.0, 2.0), step=0.2, most=2.0)
    >>> print(p > 0, 0 < last.height < dome.height)
    True True
    """
    base, origin = state.disc, np.asarray(state.disc.curvature)
    direction = finite_array("curvature", curvature, shape=(2,))
    if not np.any(state.unknowns):
        raise InvalidInput(
            "argument `state` is flat and unstrained, without a size that steps could be compared "
            "with; solve for a dome first (`disc.solve(height=...)`)"
        )

    def at(p: float) -> AxisymmetricDisc:
        return replace(base, curvature=origin + p * direction)

    # The equations are linear in p.
    slope = at(1.0).residual(state.unknowns, False)[0] - at(0.0).residual(state.unknowns, False)[0]
    size = state.disc.size

    def tangent(z: Array, p: float, before: Array | None) -> Array:
        _, jacobian = at(p).residual(z)
        full = np.zeros((size + 1, size + 1))
        full[:size, :size], full[:size, size] = jacobian, slope
        full[size] = scale if before is None else before * scale
        if before is None:
            full[size] = 0.0
            full[size, size] = 1.0
        right = np.zeros(size + 1)
        right[size] = 1.0
        t = np.linalg.solve(full, right)
        return t / np.sqrt(np.sum(scale * t * t))

    # Mean square of the unknowns, weighed so that the core does not dominate; p counts alike.
    grid = _grid(_PIECES, _DEGREE)[0]
    radius = np.exp(np.concatenate([grid[0, :1], grid[:, 1:].ravel()]))
    scale = np.concatenate([radius, radius * base.radius**2, [1.0]])
    scale[:-1] /= np.sum(radius) * max(float(np.max(np.abs(state.unknowns))), 1e-12) ** 2
    scale[-1] = 1.0 / step**2

    def correct(z: Array, p: float, t: Array) -> tuple[Array, float] | None:
        for _ in range(12):
            f, jacobian = at(p).residual(z)
            full = np.zeros((size + 1, size + 1))
            full[:size, :size], full[:size, size], full[size] = jacobian, slope, scale * t
            d = np.linalg.solve(full, np.append(-f, 0.0))
            z, p = z + d[:size], p + d[size]
            if np.sqrt(np.sum(scale * d * d)) < 1e-11:
                return z, p
        return None

    z, p, t = state.unknowns, 0.0, tangent(state.unknowns, 0.0, None)
    length = 0.1
    for _ in range(2000):
        found = correct(z + length * t[:size], p + length * t[size], t)
        if found is None:
            length *= 0.5
            if length < 1e-8:
                break
            continue
        new = tangent(*found, t)
        moved = np.append(found[0] - z, found[1] - p) - length * t
        # A long correction, or a turned tangent, tells of another branch.
        if np.sum(scale * new * t) < 0.95 or np.sum(scale * moved**2) > (0.2 * length) ** 2:
            length *= 0.5
            continue
        if new[size] <= 0:
            low, high, f_low, f_high = 0.0, length, t[size], new[size]
            for _ in range(80):  # regula falsi (Illinois) for the place where p turns
                middle = low + (high - low) * f_low / (f_low - f_high)
                found = correct(z + middle * t[:size], p + middle * t[size], t)
                if found is None:
                    raise NotConverged("the fold could not be resolved; take a smaller `step`")
                value = tangent(*found, t)[size]
                if abs(value) < 1e-9 * abs(t[size]) or high - low < 1e-13:
                    break
                if value > 0:
                    low, f_low, f_high = middle, value, f_high * 0.5
                else:
                    high, f_high, f_low = middle, value, f_low * 0.5
            return float(found[1]), AxisymmetricState(at(found[1]), found[0])
        z, p, t = *found, new
        if p > most:
            break
        length = min(1.5 * length, 0.5)
    raise NotConverged(f"no fold up to p = {p:.4g}; raise `most`, or take a smaller `step`")


def buckling_strain(thickness: float, poisson_ratio: float) -> float:
    r"""Return the strain difference at which a free flat disc with a +1 defect domes.

    Parameters
    ----------
    thickness : float
        :math:`\sqrt{B/C}/R`.
    poisson_ratio : float

    Returns
    -------
    float
        Critical :math:`\epsilon_r - \epsilon_\theta`: the linear buckling of the flat state, whose
        stress is in closed form, into an axisymmetric shape.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.disc import buckling_strain
    >>> round(buckling_strain(0.02, 0.5) / buckling_strain(0.01, 0.5), 9)
    4.0
    """
    thickness = positive("thickness", thickness)
    disc = AxisymmetricDisc(bending=thickness**2, poisson_ratio=poisson_ratio, strain=(1.0, 0.0))
    n = disc.size // 2
    # Linear in the strain: the flat state of a unit difference, and its tangent.
    flat = disc.solve()
    _, loaded = disc.residual(flat.unknowns)
    _, unloaded = replace(disc, strain=(0.0, 0.0)).residual(np.zeros(2 * n))
    assert loaded is not None and unloaded is not None
    stiff, stress = unloaded[n:, n:], loaded[n:, n:] - unloaded[n:, n:]
    # stiff s + strain stress s = 0: eigenvalues of -stiff^-1 stress are 1/strain.
    values: Any = np.linalg.eigvals(-np.linalg.solve(stiff, stress))
    real = values.real[np.abs(values.imag) < 1e-6 * np.abs(values)]
    return float(1.0 / np.max(real))
