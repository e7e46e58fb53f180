"""A clamped strip in Legendre modes: equilibria, stability, light. Nothing here advances in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh, null_space
from scipy.optimize import brentq

from .._validate import finite, in_open_interval, integer_at_least, positive
from ..errors import InvalidInput, NotConverged, Unstable

Array = npt.NDArray[np.float64]
Spot = Callable[[Array], Array]


def _legendre(s: Array, modes: int) -> Array:
    """Orthonormal Legendre polynomials of degree 1..modes on [0, 1], shape (len(s), modes)."""
    x = 2.0 * s - 1.0
    table = np.empty((modes + 1, s.size))
    table[0] = 1.0
    if modes:
        table[1] = x
    for n in range(1, modes):
        table[n + 1] = ((2 * n + 1) * x * table[n] - n * table[n - 1]) / (n + 1)
    return (table[1:] * np.sqrt(2.0 * np.arange(1, modes + 1) + 1.0)[:, None]).T


def _integrated(s: Array, modes: int) -> Array:
    """Integrals from 0 of the orthonormal polynomials, shape (len(s), modes)."""
    x = 2.0 * s - 1.0
    table = np.empty((modes + 2, s.size))
    table[0] = 1.0
    table[1] = x
    for n in range(1, modes + 1):
        table[n + 1] = ((2 * n + 1) * x * table[n] - n * table[n - 1]) / (n + 1)
    order = np.arange(1, modes + 1)
    scale = 0.5 / np.sqrt(2.0 * order + 1.0)
    return ((table[2:] - table[:-2]) * scale[:, None]).T


class _Basis:
    """Tables of the modes at Gauss points; holds nothing that changes."""

    def __init__(self, modes: int) -> None:
        self.modes = modes
        x, w = np.polynomial.legendre.leggauss(2 * modes + 8)
        self.nodes, self.weights = (x + 1.0) / 2.0, w / 2.0
        self.values = _legendre(self.nodes, modes)
        self.integrals = _integrated(self.nodes, modes)
        self.mass = (self.integrals.T * self.weights) @ self.integrals
        x, w = np.polynomial.legendre.leggauss(modes + 16)
        self.arc_nodes, self.arc_weights = (x + 1.0) / 2.0, w / 2.0


class _Strip:
    """The coupled problem in modes."""

    def __init__(
        self, response: float, angle: float, span: float, basis: _Basis, spot: Spot | None
    ) -> None:
        self.response, self.angle, self.span = response, angle, span
        self.basis, self.spot = basis, spot

    # -- mechanics ---------------------------------------------------------------------------
    def constraints(self, a: Array) -> tuple[Array, Array]:
        """Values of the two constraints and their gradients, shapes (2,) and (modes, 2)."""
        b = self.basis
        theta = b.integrals @ a
        c, s = b.weights * np.cos(theta), b.weights * np.sin(theta)
        value = np.array([c.sum() - self.span, s.sum()])
        return value, np.stack([-b.integrals.T @ s, b.integrals.T @ c], axis=1)

    def hessian(self, a: Array, multipliers: Array) -> Array:
        b = self.basis
        theta = b.integrals @ a
        weight = b.weights * (multipliers[0] * np.cos(theta) + multipliers[1] * np.sin(theta))
        return np.eye(b.modes) - (b.integrals.T * weight) @ b.integrals

    def kkt(self, a: Array, multipliers: Array) -> Array:
        m = self.basis.modes
        matrix = np.zeros((m + 2, m + 2))
        matrix[:m, :m] = self.hessian(a, multipliers)
        _, gradient = self.constraints(a)
        matrix[:m, m:] = gradient
        matrix[m:, :m] = gradient.T
        return matrix

    def eigen(self, a: Array, multipliers: Array) -> tuple[Array, Array]:
        """Constrained eigenvalues in the metric of the angle, and the lowest mode (modes of u')."""
        _, gradient = self.constraints(a)
        free = null_space(gradient.T)
        values, vectors = eigh(
            free.T @ self.hessian(a, multipliers) @ free, free.T @ self.basis.mass @ free
        )
        return values, free @ vectors[:, 0]

    def equilibrium(self, a: Array, k: Array) -> tuple[Array, Array]:
        """Newton's method from a near equilibrium; the result need not be stable."""
        m = self.basis.modes
        _, gradient = self.constraints(a)
        multipliers: Array = np.asarray(np.linalg.lstsq(gradient, k - a, rcond=None)[0])
        last = np.inf
        for _ in range(60):
            value, gradient = self.constraints(a)
            residual = np.concatenate([a - k + gradient @ multipliers, value])
            size = float(np.max(np.abs(residual)))
            if size < 1e-13 * (1.0 + float(np.max(np.abs(k)))) or (size < 1e-10 and size >= last):
                return a, multipliers
            last = size
            step = np.linalg.solve(self.kkt(a, multipliers), -residual)
            a, multipliers = a + step[:m], multipliers + step[m:]
        raise NotConverged(f"equilibrium not found: residual {size:.1e}", state=(a, k))

    def descend(self, a: Array, k: Array, leaving: Array | None = None) -> tuple[Array, Array]:
        """Projected gradient flow of the squared distance to k, ended by Newton's method.

        Returns a stable state. With `leaving`, a critical state next to `a`, the flow is given up
        as soon as it turns back to it.
        """
        step = 0.25
        a = self._restore(a)
        scale = float(np.linalg.norm(a))  # about 2 at span 0.95; shallow strips move less
        away = np.inf if leaving is None else float(np.linalg.norm(a - leaving))
        energy = 0.5 * float((a - k) @ (a - k))
        for sweep in range(1500):
            _, gradient = self.constraints(a)
            force = k - a
            force = force - gradient @ np.linalg.lstsq(gradient, force, rcond=None)[0]
            slope = float(force @ force)
            if slope < 1e-6 * scale**2 and sweep % 5 == 0:
                try:
                    found, multipliers = self.equilibrium(a, k)
                except NotConverged:
                    found = np.full_like(a, np.inf)
                if np.linalg.norm(found - a) < 0.03 * scale:
                    low = self.eigen(found, multipliers)[0][0]
                    far = leaving is None or np.linalg.norm(found - leaving) > 5 * away
                    if low > 1e-3 and far:
                        return found, multipliers
            if leaving is not None and np.linalg.norm(a - leaving) < 0.7 * away:
                raise Unstable("the flow returns to the critical state", state=(a, k))
            while True:
                trial = self._restore(a + step * force)
                new = 0.5 * float((trial - k) @ (trial - k))
                if new <= energy - 0.25 * step * slope + 1e-15 * (energy + scale**2):
                    break
                step *= 0.5
                if step < 1e-12:
                    raise NotConverged("gradient flow stalled", state=(a, k))
            a, energy = trial, new
            if sweep % 8 == 7:
                step = min(0.5, 2.0 * step)
        raise NotConverged("gradient flow did not settle in 1500 steps", state=(a, k))

    def _restore(self, a: Array) -> Array:
        for _ in range(50):
            value, gradient = self.constraints(a)
            if np.max(np.abs(value)) < 1e-14:
                return a
            a = a - gradient @ np.linalg.solve(gradient.T @ gradient, value)
        if np.max(np.abs(value)) < 1e-11:
            return a
        raise NotConverged("constraints could not be restored", state=a)

    def height(self, a: Array) -> float:
        """Mean height, int (1 - S) sin(theta) dS."""
        b = self.basis
        return float((b.weights * (1.0 - b.nodes)) @ np.sin(b.integrals @ a))

    # -- light -------------------------------------------------------------------------------
    def _terminators(self, a: Array, lit: Array) -> list[float]:
        """Where cos(theta - angle) changes sign, by cubic interpolation between Gauss points."""
        b = self.basis
        theta, slope = b.integrals @ a, b.values @ a
        roots = []
        for i in np.flatnonzero(lit[:-1] * lit[1:] < 0):
            h = b.nodes[i + 1] - b.nodes[i]
            # theta passes (n + 1/2) pi + angle between the points
            level = (
                np.round((0.5 * (theta[i] + theta[i + 1]) - self.angle) / np.pi - 0.5) + 0.5
            ) * np.pi + self.angle
            p, q = theta[i] - level, theta[i + 1] - level
            u, v = h * slope[i], h * slope[i + 1]

            def cubic(t: float, p: float = p, q: float = q, u: float = u, v: float = v) -> float:
                return float(
                    p * (1 + 2 * t) * (1 - t) ** 2
                    + q * t * t * (3 - 2 * t)
                    + u * t * (1 - t) ** 2
                    - v * t * t * (1 - t)
                )

            if p * q < 0:
                roots.append(b.nodes[i] + h * float(brentq(cubic, 0.0, 1.0, xtol=1e-12)))
        return roots

    def lit(self, a: Array) -> Array:
        """Projections of the light on the modes, shape (modes,)."""
        b = self.basis
        theta = b.integrals @ a
        cosine = np.cos(theta - self.angle)
        if np.all(cosine > 0):
            if self.spot is not None:
                cosine = cosine * self.spot(self._abscissa(a, b.nodes))
            return b.values.T @ (b.weights * cosine)
        ends = [0.0, *self._terminators(a, cosine), 1.0]
        lengths = np.diff(ends)
        s = (np.array(ends[:-1])[:, None] + lengths[:, None] * b.arc_nodes).ravel()
        w = (lengths[:, None] * b.arc_weights).ravel()
        light = np.maximum(0.0, np.cos(_integrated(s, b.modes) @ a - self.angle))
        if self.spot is not None:
            light = light * self.spot(self._abscissa(a, s))
        return _legendre(s, b.modes).T @ (w * light)

    def lit_slope(self, a: Array) -> Array:
        """Derivative of :meth:`lit` in the modes, shape (modes, modes)."""
        b = self.basis
        theta = b.integrals @ a
        cosine = np.cos(theta - self.angle)
        ends = [0.0, *([] if np.all(cosine > 0) else self._terminators(a, cosine)), 1.0]
        lengths = np.diff(ends)
        s = (np.array(ends[:-1])[:, None] + lengths[:, None] * b.arc_nodes).ravel()
        w = (lengths[:, None] * b.arc_weights).ravel()
        integrals = _integrated(s, b.modes)
        phase = integrals @ a - self.angle
        bright = np.cos(phase) > 0
        change = np.where(bright, -np.sin(phase), 0.0)[:, None] * integrals
        if self.spot is not None:
            x, h = self._abscissa(a, s), 1e-6
            light = np.where(bright, np.cos(phase), 0.0)
            slope = (self.spot(x + h) - self.spot(x - h)) / (2 * h)
            # dX(s) = -int_0^s sin(theta) du through Legendre series
            sine = (b.weights * np.sin(theta))[:, None] * b.integrals
            moved = -np.outer(s, sine.sum(axis=0)) - integrals @ (b.values.T @ sine)
            change = self.spot(x)[:, None] * change + (slope * light)[:, None] * moved
        return (_legendre(s, b.modes).T * w) @ change

    def _abscissa(self, a: Array, s: Array) -> Array:
        """X(s), through the Legendre series of cos(theta)."""
        b = self.basis
        cosine = b.weights * np.cos(b.integrals @ a)
        series = b.values.T @ cosine
        return cosine.sum() * s + _integrated(s, b.modes) @ series

    def rate(self, a: Array, k: Array) -> Array:
        return self.response * self.lit(a) - k


def _buckled(strip: _Strip, up: bool) -> Array:
    """The unlit strip, by descent from a sine of roughly the right height."""
    b = strip.basis
    slope = 4 * np.pi * np.sqrt(1.0 - strip.span) * np.cos(2 * np.pi * b.nodes)
    a = b.values.T @ (b.weights * slope)
    a, _ = strip.descend(a if up else -a, np.zeros(b.modes))
    return a


def _strip(
    response: float, angle: float, span: float, modes: int, spot: tuple[float, float] | None
) -> _Strip:
    lam, t = finite("response", response), finite("angle", angle, unit="rad")
    length = in_open_interval("span", span, 0.0, 1.0, "clamps nearer than the strip is long")
    beam: Spot | None = None
    if spot is not None:
        if len(spot) != 2:
            raise InvalidInput(f"argument `spot` is {spot!r}; pass (center, width)")
        center, width = finite("spot center", spot[0]), positive("spot width", spot[1])

        def beam(x: Array) -> Array:
            return np.exp(-((x - center) ** 2) / (2.0 * width**2))

    return _Strip(lam, t, length, _Basis(integer_at_least("modes", modes, 6)), beam)
