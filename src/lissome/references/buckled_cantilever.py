r"""Buckling of a planar cantilever under dead loads along its axis: closed form and collocation.

Unit length and unit bending stiffness: an end load is in units of :math:`B/L^2`, a distributed one of
:math:`B/L^3`; both are positive in compression. The tangent angle obeys

.. math:: \theta'' + \sin\theta\,\{f_p \text{ or } f_d\,(1 - s)\} = 0, \qquad
   \theta(0) = 0, \quad \theta'(1) = 0,

(4.37) of the thesis. The end load has a closed form
(:func:`~lissome.references.elastica.compressed_cantilever`). The distributed load is solved by
Chebyshev collocation of :math:`\theta` and Newton's method. With the distance
:math:`\sigma = f_d^{1/3}(1 - s)` from the free end its equation is
:math:`\theta_{\sigma\sigma} + \sigma\sin\theta = 0`: the tip angle alone selects the solution, and the
load is the cube of the place where the angle first vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev
from scipy.optimize import brentq
from scipy.special import jv

from .._validate import finite_array, in_open_interval, integer_at_least
from ..errors import NotConverged
from .elastica import compressed_cantilever

__all__ = [
    "HeavyCantilever",
    "distributed_load_tips",
    "distributed_loads",
    "end_load_tips",
    "end_loads",
    "heavy_cantilever",
]

Array = npt.NDArray[np.float64]
_STRONGEST = 500.0  # beyond it the tip angle is pi to 1e-6 and no longer selects the solution


def end_loads(count: int = 1) -> Array:
    r"""Critical end loads of the straight cantilever, :math:`((2j - 1)\pi/2)^2`.

    Parameters
    ----------
    count : int, optional
        How many.

    Returns
    -------
    ndarray, shape (count,)
        In units of :math:`B/L^2`; the first is (4.39) of the thesis.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.buckled_cantilever import end_loads
    >>> end_loads(2)
    array([ 2.4674011, 22.2066099])
    """
    n = integer_at_least("count", count, 1)
    return np.asarray(((2.0 * np.arange(1, n + 1) - 1.0) * np.pi / 2.0) ** 2)


def distributed_loads(count: int = 1) -> Array:
    r"""Critical distributed loads of the straight cantilever.

    With :math:`\sigma` the distance from the free end, :math:`\theta_{\sigma\sigma} + \sigma\theta = 0` and
    :math:`\theta_\sigma(0) = 0` leave :math:`\sqrt\sigma\,J_{-1/3}(\tfrac23\sigma^{3/2})`. It vanishes at
    the clamp for

    .. math:: f_d = \tfrac94\, j_n^2, \qquad J_{-1/3}(j_n) = 0 .

    Parameters
    ----------
    count : int, optional
        How many.

    Returns
    -------
    ndarray, shape (count,)
        In units of :math:`B/L^3`; the first is (4.39) of the thesis.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.buckled_cantilever import distributed_loads
    >>> distributed_loads(2)
    array([ 7.83734744, 55.97702968])
    """
    n = integer_at_least("count", count, 1)
    zeros = []
    for j in range(1, n + 1):
        guess = (j - 0.25 - 1.0 / 6.0) * np.pi  # McMahon: (j - 1/4 + order/2) pi
        zeros.append(brentq(lambda t: jv(-1.0 / 3.0, t), guess - 0.5, guess + 0.5, xtol=1e-14))
    return np.asarray(2.25 * np.square(zeros))


@dataclass(frozen=True, eq=False)
class HeavyCantilever:
    r"""A cantilever that has buckled under a dead load spread evenly over its length.

    Attributes
    ----------
    load : float
        :math:`f_d`.
    x, y : float
        Coordinates of the tip; :math:`y > 0`.
    tip_angle : float
        Tangent angle at the tip.
    clamp_moment : float
        Curvature at the clamp.
    bending_energy : float
        :math:`\int \theta'^2/2\,ds`.
    potential : float
        Bending energy plus :math:`f_d\int x\,ds`.
    coefficients : ndarray, shape (degree + 1,)
        Chebyshev coefficients of the tangent angle on [0, 1].

    Examples
    --------
    The free end is free of moment, and the clamp bears the moment of the weight:

    >>> import numpy as np
    >>> from lissome.references.buckled_cantilever import heavy_cantilever
    >>> column = heavy_cantilever(12.0)
    >>> node, weight = np.polynomial.legendre.leggauss(20)
    >>> lever = 0.5 * weight @ column.points(0.5 * (node + 1))[:, 1]
    >>> print(f"{abs(column.curvature(1.0)):.9f} {column.clamp_moment / (12 * lever):.9f}")
    0.000000000 1.000000000
    """

    load: float
    x: float
    y: float
    tip_angle: float
    clamp_moment: float
    bending_energy: float
    potential: float
    coefficients: Array = field(repr=False)

    def angle(self, position: npt.ArrayLike) -> Array:
        """Tangent angle (rad) at arc lengths `position` in [0, 1], of their shape.

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        return np.asarray(chebyshev.chebval(2.0 * s - 1.0, self.coefficients))

    def curvature(self, position: npt.ArrayLike) -> Array:
        """Curvature (1/L) at arc lengths `position` in [0, 1], of their shape.

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        return np.asarray(
            chebyshev.chebval(2.0 * s - 1.0, 2.0 * chebyshev.chebder(self.coefficients))
        )

    def points(self, position: npt.ArrayLike) -> Array:
        """Coordinates at arc lengths `position` in [0, 1], shape (..., 2).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        nodes = 2.0 * _points(2 * self.coefficients.size) - 1.0
        theta = chebyshev.chebval(nodes, self.coefficients)
        found = []
        for values in (np.cos(theta), np.sin(theta)):
            integral = chebyshev.chebint(_series(values), lbnd=-1, scl=0.5)
            found.append(chebyshev.chebval(2.0 * s - 1.0, integral))
        return np.stack(found, axis=-1)


def heavy_cantilever(load: float) -> HeavyCantilever:
    r"""Return the first buckled shape under a distributed dead load.

    Parameters
    ----------
    load : float
        :math:`f_d` above the critical load 7.837..., at most 500.

    Returns
    -------
    HeavyCantilever
        The branch with :math:`y > 0`.

    Raises
    ------
    InvalidInput
        If the load lies outside the interval.
    NotConverged
        If Newton's method fails.

    Notes
    -----
    The branch is climbed by its tip angle, with the load as an unknown (no fold and no bifurcation
    then stands in the way); the last steps fix the load. The degree is doubled until the last
    coefficients are below :math:`10^{-13}`.

    Examples
    --------
    >>> from lissome.references.buckled_cantilever import heavy_cantilever
    >>> column = heavy_cantilever(12.0)
    >>> round(column.x, 8), round(column.y, 8)
    (0.16213528, 0.84952693)
    """
    target = in_open_interval(
        "load",
        load,
        float(distributed_loads()[0]),
        _STRONGEST * (1.0 + 1e-15),
        "below it the straight rod is the only equilibrium, beyond it the tip points straight down",
    )
    degree = 32
    tip, theta = _climb(target, degree)
    while True:
        theta = _newton(theta, target, tip, fixed_load=True)[0]
        coefficients = _series(theta)
        size = float(np.max(np.abs(coefficients)))
        if np.max(np.abs(coefficients[-4:])) < 1e-13 * size:
            return _column(target, coefficients)
        degree *= 2
        if degree > 512:
            raise NotConverged(f"load {target:g}: 512 Chebyshev modes do not resolve the clamp")
        s = _points(degree)
        theta = np.asarray(chebyshev.chebval(2.0 * s - 1.0, coefficients))


def _column(load: float, coefficients: Array) -> HeavyCantilever:
    t, weights = np.polynomial.legendre.leggauss(2 * coefficients.size)
    theta = chebyshev.chebval(t, coefficients)
    slope = chebyshev.chebval(t, 2.0 * chebyshev.chebder(coefficients))
    s, weights = 0.5 * (t + 1.0), 0.5 * weights
    bending = float(weights @ slope**2) / 2.0
    return HeavyCantilever(
        load=load,
        x=float(weights @ np.cos(theta)),
        y=float(weights @ np.sin(theta)),
        tip_angle=float(chebyshev.chebval(1.0, coefficients)),
        clamp_moment=float(chebyshev.chebval(-1.0, 2.0 * chebyshev.chebder(coefficients))),
        bending_energy=bending,
        # the integral of x is the integral of (1 - s) cos(theta)
        potential=bending + load * float(weights @ ((1.0 - s) * np.cos(theta))),
        coefficients=coefficients,
    )


def _points(degree: int) -> Array:
    """Chebyshev points on [0, 1], increasing."""
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)))


def _differentiation(degree: int) -> Array:
    """Matrix of d/ds on the points above; negative sums on the diagonal keep constants exact."""
    weight = (-1.0) ** np.arange(degree + 1)
    weight[[0, -1]] *= 0.5
    # differences through a product of sines: no cancellation between close points
    angle = np.pi * np.arange(degree + 1) / degree
    gap = np.sin(0.5 * (angle[:, None] + angle)) * np.sin(0.5 * (angle[:, None] - angle))
    np.fill_diagonal(gap, 1.0)
    matrix = weight[None, :] / weight[:, None] / gap
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return np.asarray(matrix)


def _series(values: Array) -> Array:
    """Chebyshev coefficients of the interpolant through values at the points above."""
    degree = values.size - 1
    order = np.arange(degree + 1)
    table = np.cos(np.pi * np.outer(order, degree - order) / degree)
    scaled = values.copy()
    scaled[[0, -1]] *= 0.5
    coefficients = 2.0 / degree * (table @ scaled)
    coefficients[[0, -1]] *= 0.5
    return np.asarray(coefficients)


def _climb(target: float, degree: int) -> tuple[float, Array]:
    """Tip angle and nodal angles of a solution whose load exceeds the target, or is close to it."""
    s = _points(degree)
    load, tip = float(distributed_loads()[0]), 0.0
    theta = s * 0.0
    before: tuple[float, float, Array] = (load, tip, theta)
    tip = 0.2
    theta = tip * np.sin(0.5 * np.pi * s)
    for _ in range(400):
        theta, load = _newton(theta, load, tip, fixed_load=False)
        if load >= target:
            break
        before = (load, tip, theta)
        # the tip angle tends to pi like exp(-load^(1/2)): approach it geometrically
        step = min(0.2, 0.25 * (np.pi - tip))
        theta = theta * (tip + step) / tip
        tip += step
    else:
        raise NotConverged(f"no solution found at load {target:g}: the branch ended at {load:g}")
    if before[1] == 0.0:
        # near the onset the amplitude grows like the square root of the excess
        part = float(np.sqrt((target - before[0]) / (load - before[0])))
        return part * tip, part * theta
    part = (target - before[0]) / (load - before[0])
    return before[1] + part * (tip - before[1]), before[2] + part * (theta - before[2])


def _newton(theta: Array, load: float, tip: float, *, fixed_load: bool) -> tuple[Array, float]:
    """Solve by Newton's method, either for a given load or for a given tip angle."""
    degree = theta.size - 1
    s = _points(degree)
    d = _differentiation(degree)
    second = d @ d
    size = degree + 1 + (not fixed_load)
    theta = theta.copy()
    history = []
    for _ in range(40):
        residual = np.zeros(size)
        matrix = np.zeros((size, size))
        lever = 1.0 - s
        residual[: degree + 1] = second @ theta + load * lever * np.sin(theta)
        matrix[: degree + 1, : degree + 1] = second + np.diag(load * lever * np.cos(theta))
        residual[0], matrix[0] = theta[0], 0.0
        matrix[0, 0] = 1.0
        residual[degree] = d[-1] @ theta
        matrix[degree] = 0.0
        matrix[degree, : degree + 1] = d[-1]
        if not fixed_load:
            matrix[1:degree, -1] = (lever * np.sin(theta))[1:-1]
            residual[-1] = theta[-1] - tip
            matrix[-1, degree] = 1.0
        change = np.linalg.solve(matrix, -residual)
        theta += change[: degree + 1]
        if not fixed_load:
            load += float(change[-1])
        history.append(float(np.max(np.abs(change[: degree + 1]))))
        # quadratic convergence until rounding stops it
        if history[-1] < 1e-9 and len(history) > 1 and history[-1] > 0.1 * history[-2]:
            break
        if history[-1] < 1e-14:
            break
    else:
        raise NotConverged(
            f"collocation of the heavy column did not converge at load {load:g}", history=history
        )
    if theta[-1] < 0.0:
        theta = -theta
    return theta, load


def end_load_tips(loads: npt.ArrayLike) -> Array:
    """Tips of the stable equilibria under dead end loads (Fig. 4.4a of the thesis).

    Parameters
    ----------
    loads : array_like
        In units of B/L^2, positive in compression.

    Returns
    -------
    ndarray, shape (..., 2)
        The straight rod, (1, 0), up to the critical load; the branch with positive deflection above.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.buckled_cantilever import end_load_tips
    >>> end_load_tips([2.0, 4.0]).round(6)
    array([[1.      , 0.      ],
           [0.27418 , 0.802407]])
    """
    force = finite_array("loads", loads)
    tips = np.zeros((*force.shape, 2))
    tips[..., 0] = 1.0
    critical = end_loads()[0]
    for index in np.argwhere(force > critical):
        rod = compressed_cantilever(float(force[tuple(index)]))
        tips[tuple(index)] = rod.x, rod.y
    return tips


def distributed_load_tips(loads: npt.ArrayLike) -> Array:
    """Tips of the stable equilibria under distributed dead loads (Fig. 4.4b of the thesis).

    Parameters
    ----------
    loads : array_like
        In units of B/L^3, positive in compression.

    Returns
    -------
    ndarray, shape (..., 2)
        The straight rod, (1, 0), up to the critical load; the branch with positive deflection above.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.buckled_cantilever import distributed_load_tips
    >>> distributed_load_tips([5.0, 12.0]).round(6)
    array([[1.      , 0.      ],
           [0.162135, 0.849527]])
    """
    force = finite_array("loads", loads)
    tips = np.zeros((*force.shape, 2))
    tips[..., 0] = 1.0
    critical = float(distributed_loads()[0])
    for index in np.argwhere(force > critical):
        column = heavy_cantilever(float(force[tuple(index)]))
        tips[tuple(index)] = column.x, column.y
    return tips
