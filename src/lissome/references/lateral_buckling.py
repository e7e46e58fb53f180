r"""Lateral-torsional buckling of a cantilever that is clamped level, width upright, under its weight.

Under a load at its end instead, it turns over at :func:`end_load`.

Unit length, arc length s from the clamp, bending stiffness :math:`B = Yat^3/12` about the weak axis,
infinite about the strong one; the load is :math:`\gamma = q l^3/B` with the weight q per unit length
(in terms of the elasto-gravity length :math:`L_g = (B/q)^{1/3}`, :math:`\gamma = (l/L_g)^3`). For small
rotations, with the twist angle :math:`\theta`, the weak curvature :math:`\kappa_2` and the twist
:math:`\kappa_3 = \theta'`, the weight gives the strong moment :math:`M = \tfrac12\gamma(1-s)^2`, and
no moment about the vertical:

.. math:: m_2 = -M\theta,\qquad m_3' = M\kappa_2,\qquad \theta(0) = 0,\quad m_3(1) = 0 .

Laws of Audoly and Neukirch (2021), of a ribbon of Poisson's ratio nu:

linear (also their refined law at small strains)
    :math:`m_2 = \kappa_2,\ m_3 = 2\kappa_3/(1+\nu)`, which gives
    :math:`\theta'' + \lambda(1-s)^4\theta = 0` with :math:`\lambda = (1+\nu)\gamma^2/8`;
Sadowsky
    :math:`W = (\kappa_2^2+\kappa_3^2)^2/2(1-\nu^2)\kappa_2^2`, of which only the ratio
    :math:`y = \kappa_3/\kappa_2` matters:
    :math:`(1-s)(1+y^2)y' - 2y(1-y^2) = \tfrac14(1-\nu^2)\gamma(1-s)^3`, :math:`y(0) = -1`, y(1) = 0;
refined
    with the curvature scale :math:`k_* = t/a^2\sqrt{12(1-\nu^2)}` and :math:`v = \kappa_2/k_*`,

    .. math:: \frac{W}{k_*^2} = \frac{v^2}{2} + \frac{(\kappa_3/k_*)^2}{1+\nu}
       + \frac{[\nu v^2 + (\kappa_3/k_*)^2]^2\varphi(v)}{4(1-\nu^2)} .

It buckles at the linear load, whatever its width, because the last term is of fourth order. But the
load then rises with the rotation over :math:`k_* l` towards that of Sadowsky.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.special import gamma, jv

from .._validate import finite, finite_array, integer_at_least, positive
from ..errors import InvalidInput, NotConverged
from ._collocation import Family, Point

__all__ = [
    "Postbuckling",
    "curvature_scale",
    "eigenvalues",
    "end_load",
    "koiter_width_coefficient",
    "linear_load",
    "mode",
    "overhang",
    "phi",
    "postbuckling",
    "sadowsky_load",
]

Array = npt.NDArray[np.float64]


def eigenvalues(count: int = 1) -> Array:
    r"""Lowest eigenvalues of :math:`y'' + \lambda x^4 y = 0`, :math:`y'(0) = 0`, :math:`y(1) = 0`.

    :math:`y = \sqrt x\,J_{-1/6}(\tfrac13\sqrt\lambda\,x^3)`, so that :math:`\lambda = 9j^2` with the
    zeros j of :math:`J_{-1/6}`.

    Parameters
    ----------
    count : int
        How many.

    Returns
    -------
    ndarray, shape (count,)

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import eigenvalues
    >>> round(float(eigenvalues()[0]), 6)
    41.304808
    """
    integer_at_least("count", count, 1)
    # Zeros lie near (n - 1/3) pi, less than a fifth of a turn away.
    middle = (np.arange(1, count + 1) - 1.0 / 3.0) * np.pi
    zeros = [brentq(lambda z: jv(-1 / 6, z), m - 0.6, m + 0.6, xtol=1e-14) for m in middle]
    return 9.0 * np.array(zeros) ** 2


def mode(position: npt.ArrayLike) -> Array:
    """Twist angle of the first mode at arc lengths from the clamp, 1 at the free end.

    Parameters
    ----------
    position : array_like
        Arc lengths from the clamp over the length, in [0, 1].

    Returns
    -------
    ndarray
        Of the shape of `position`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import mode
    >>> mode([0.0, 1.0])
    array([0., 1.])
    """
    s = finite_array("position", position)
    x = 1.0 - s
    z = np.sqrt(eigenvalues()[0]) / 3.0 * np.abs(x) ** 3
    # sqrt(x) J_{-1/6}(z) = (z/2)^{-1/6} sqrt(x)/Gamma(5/6) (1 - ...): 1 at x = 0 after scaling
    scale = gamma(5.0 / 6.0) * (np.sqrt(eigenvalues()[0]) / 6.0) ** (1.0 / 6.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = scale * np.sqrt(np.abs(x)) * jv(-1.0 / 6.0, z)
    value = np.where(z < 1e-12, 1.0, value)
    return np.asarray(np.where(s == 0.0, 0.0, value))


def end_load(bending: float, torsion: float) -> float:
    r"""End load at which a deep cantilever turns over sideways (Prandtl and Michell, 1899).

    The beam is much stiffer in the plane of the load than out of it (B) and in torsion (C); its twist
    obeys :math:`\varphi'' + (P^2/BC)\,\sigma^2\varphi = 0` with the distance :math:`\sigma` from the free
    end, hence

    .. math:: P = 2\,j\,\sqrt{BC}, \qquad J_{-1/4}(j) = 0, \qquad 2j = 4.0126 .

    Parameters
    ----------
    bending, torsion : float
        B and C, for unit length.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import end_load
    >>> round(end_load(1.0, 1.0), 6)
    4.012599
    """
    product = positive("bending", bending) * positive("torsion", torsion)
    return float(2.0 * brentq(lambda t: jv(-0.25, t), 1.5, 2.5, xtol=1e-15) * np.sqrt(product))


def linear_load(poisson_ratio: float) -> float:
    r"""Critical :math:`\gamma` of the linear and of the refined law, :math:`\sqrt{8\lambda/(1+\nu)}`.

    Parameters
    ----------
    poisson_ratio : float
        In (-1, 0.5].

    Returns
    -------
    float

    Examples
    --------
    >>> from lissome.references.lateral_buckling import linear_load
    >>> round(linear_load(0.0), 4)
    18.1780
    """
    nu = _poisson(poisson_ratio)
    return float(np.sqrt(8.0 * eigenvalues()[0] / (1.0 + nu)))


def sadowsky_load(poisson_ratio: float) -> float:
    r"""Critical :math:`\gamma` of Sadowsky's law, by shooting from the free end.

    Parameters
    ----------
    poisson_ratio : float
        In (-1, 0.5].

    Returns
    -------
    float

    Examples
    --------
    >>> from lissome.references.lateral_buckling import sadowsky_load
    >>> round(sadowsky_load(0.0), 3)
    21.491
    """
    nu = _poisson(poisson_ratio)

    def miss(load: float) -> float:
        # u = 1 - s; the regular solution starts as -load u^3/20
        def right(u: float, y: Array) -> list[float]:
            return [-(2 * y[0] * (1 - y[0] ** 2) + load * u**3 / 4) / (u * (1 + y[0] ** 2))]

        start = 1e-3
        run = solve_ivp(
            right, (start, 1.0), [-load * start**3 / 20], "DOP853", rtol=1e-13, atol=1e-22
        )
        return float(run.y[0, -1]) + 1.0

    return float(brentq(miss, 15.0, 22.5, xtol=1e-12)) / (1.0 - nu**2)


def curvature_scale(thickness: float, width: float, poisson_ratio: float) -> float:
    r""":math:`k_* = t/a^2\sqrt{12(1-\nu^2)}`, in the inverse unit of thickness and width.

    Parameters
    ----------
    thickness, width : float
        t and a, in one unit.
    poisson_ratio : float
        In (-1, 0.5].

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import curvature_scale
    >>> round(curvature_scale(0.0925, 5.10, 0.4), 6)
    0.00112
    """
    t, a, nu = positive("thickness", thickness), positive("width", width), _poisson(poisson_ratio)
    return float(t / (a**2 * np.sqrt(12.0 * (1.0 - nu**2))))


def phi(v: npt.ArrayLike) -> Array:
    r"""The function :math:`\varphi` of Audoly and Neukirch, with 1/360 at 0 and :math:`2/v^2` far out.

    With :math:`x = v^2/4`,
    :math:`\varphi = \sum_{k\ge1} \frac{2k\,x^{k-1}}{(4k+2)!} \Big/ \sum_{k\ge0} \frac{x^k}{(4k+1)!}`:
    all terms are positive, nothing cancels.

    Parameters
    ----------
    v : array_like
        Longitudinal over cross curvature scale, dimensionless, of either sign.

    Returns
    -------
    ndarray
        Of the shape of `v`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import phi
    >>> float(phi(0.0)) * 360
    1.0
    """
    argument = finite_array("v", v)
    large = np.abs(argument) > _FAR
    near, _, _ = _phi_and_slopes(np.where(large, 0.0, argument))
    s = np.sqrt(np.where(large, np.abs(argument), 1.0) / 2.0)
    # cosh/(sinh + sin) and the like tend to 1; beyond s = 35 their exponentials are nothing
    far = 4.0 / (4.0 * s**4) * (0.5 - 1.0 / s)
    return np.asarray(np.where(large, far, near))


_FAR = 2500.0
_ORDERS = 41  # factorials up to 170! fit into a float


@dataclass(frozen=True, eq=False)
class Postbuckling:
    """Buckled states of the refined law for small rotations.

    Attributes
    ----------
    poisson_ratio : float
        Poisson's ratio.
    amplitude : ndarray, shape (k,)
        Twist angle of the free end over l k*.
    load : ndarray, shape (k,)
        gamma.
    deflection : ndarray, shape (k,)
        Lateral deflection of the free end over l^2 k*.

    Examples
    --------
    A ribbon that hardly turns bears the critical load of the linear law:

    >>> from lissome.references.lateral_buckling import linear_load, postbuckling
    >>> curve = postbuckling([1e-3], 0.4, elements=8)
    >>> print(f"{curve.load[0] / linear_load(0.4):.6f}")
    1.000000
    """

    poisson_ratio: float
    amplitude: Array
    load: Array
    deflection: Array


def postbuckling(
    amplitude: npt.ArrayLike, poisson_ratio: float, *, elements: int = 24, stages: int = 5
) -> Postbuckling:
    r"""Return the load at which the free end of a ribbon of the refined law turns by `amplitude`.

    Rotations are small, strains over :math:`k_*` are not: one curve for all widths, from
    :func:`linear_load` to :func:`sadowsky_load`. By collocation of :math:`\theta, \kappa_2,
    \kappa_3`.

    Parameters
    ----------
    amplitude : array-like
        Twist angles of the free end over l k*, positive and ascending.
    poisson_ratio : float
        In (-1, 0.5].
    elements, stages : int
        Collocation elements and points in each.

    Returns
    -------
    Postbuckling

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the continuation in the amplitude fails.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import linear_load, postbuckling, sadowsky_load
    >>> curve = postbuckling([0.1, 10.0], 0.4)
    >>> bool(linear_load(0.4) < curve.load[0] < curve.load[1] < sadowsky_load(0.4))
    True
    """
    nu = _poisson(poisson_ratio)
    wanted = np.atleast_1d(finite_array("amplitude", amplitude))
    if wanted.ndim != 1 or wanted[0] <= 0.0 or np.any(np.diff(wanted) <= 0.0):
        raise InvalidInput("argument `amplitude` must be positive and ascending, of shape (k,)")

    def moments(v: npt.NDArray, t: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray]:
        value, slope, _ = _phi_and_slopes(v)
        square = nu * v * v + t * t
        factor = 1.0 / (4.0 * (1.0 - nu**2))
        return (
            v + factor * (4.0 * nu * v * square * value + square**2 * slope),
            2.0 * t / (1.0 + nu) + factor * 4.0 * t * square * value,
        )

    def moduli(v: npt.NDArray, t: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
        value, slope, curve = _phi_and_slopes(v)
        square = nu * v * v + t * t
        factor = 1.0 / (4.0 * (1.0 - nu**2))
        return (
            1.0
            + factor
            * (
                4.0 * nu * square * value
                + 8.0 * nu**2 * v * v * value
                + 8.0 * nu * v * square * slope
                + square**2 * curve
            ),
            factor * (8.0 * nu * v * t * value + 4.0 * t * square * slope),
            2.0 / (1.0 + nu) + factor * (4.0 * square * value + 8.0 * t * t * value),
        )

    def right(y: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        # the arc length u from the free end, twist angle, strains, deflection moment
        u, angle, v, t = y[:4]
        bend, mixed, twist = moduli(v, t)
        # with respect to u = 1 - s: m2 = -p u^2 angle/2, d(angle)/du = -t, d(m3)/du = -p u^2 v/2
        rate2 = -p[0] * u * angle + p[0] * u * u * t / 2.0
        rate3 = -p[0] * u * u * v / 2.0
        determinant = bend * twist - mixed * mixed
        return np.array(
            [
                np.ones_like(u),
                -t,
                (twist * rate2 - mixed * rate3) / determinant,
                (bend * rate3 - mixed * rate2) / determinant,
                u * v,
            ]
        )

    def ends(y0: npt.NDArray, y1: npt.NDArray, p: npt.NDArray) -> npt.NDArray:
        return np.array([y0[0], y0[1] - p[1], y0[2], y0[3], y0[4], y1[1]])

    # fine at the clamp, where strains may set in like a cube root
    fraction = np.linspace(0.0, 1.0, integer_at_least("elements", elements, 4) + 1)
    mesh = 1.0 - 0.02 * np.sinh((1.0 - fraction) * np.arcsinh(50.0))
    mesh[0], mesh[-1] = 0.0, 1.0
    family = Family(right, ends, mesh, integer_at_least("stages", stages, 2))
    small, load = min(1e-3, float(wanted[0])), linear_load(nu)
    angle = small * mode(1.0 - mesh)
    v = -load * mesh**2 * angle / 2.0
    bend = np.concatenate([[0.0], np.cumsum(np.diff(mesh) * (mesh * v)[1:])])
    guess = np.stack([mesh, angle, v, -np.gradient(angle, mesh), bend], axis=1)
    point = family.fixed(family.start(guess, np.array([load, small])), small)
    loads, deflections = [], []
    for value in wanted:
        point = _raised(family, point, float(value))
        loads.append(float(point.parameters[0]))
        deflections.append(float(point.nodes[-1, 4]))
    return Postbuckling(nu, wanted, np.array(loads), np.array(deflections))


def overhang(
    rotation: float, thickness: float, width: float, gravity_length: float, poisson_ratio: float
) -> float:
    r"""Length at which the free end of a ribbon of the refined law has turned by `rotation`.

    Small rotations: it tends to :math:`L_g\,\gamma_c^{1/3}` with the linear load as the rotation tends
    to zero, and to the same with Sadowsky's load if the rotation exceeds :math:`k_*l` by far.

    Parameters
    ----------
    rotation : float
        Twist angle of the free end, rad.
    thickness, width, gravity_length : float
        t, a and :math:`L_g = (B/q)^{1/3}`, all in one unit.
    poisson_ratio : float
        In (-1, 0.5].

    Returns
    -------
    float
        The length, in the same unit.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If length and load do not settle.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import overhang
    >>> round(overhang(1e-4, 0.0925, 1.88, 62.3, 0.4), 2)
    154.88
    """
    angle, unit = positive("rotation", rotation), positive("gravity_length", gravity_length)
    scale = curvature_scale(thickness, width, poisson_ratio)
    length = unit * linear_load(poisson_ratio) ** (1.0 / 3.0)
    history = [length]
    for _ in range(30):
        # the load grows with the cube root of the amplitude at most: a contraction
        load = postbuckling([angle / (length * scale)], poisson_ratio).load[0]
        length = unit * float(load) ** (1.0 / 3.0)
        history.append(length)
        if abs(history[-1] - history[-2]) < 1e-8 * length:
            return length
    raise NotConverged(f"the overhang does not settle: {history}", history=history)


def koiter_width_coefficient(poisson_ratio: float) -> float:
    r"""Rise of the load by the width of the ribbon, per half of the squared deflection.

    :math:`\gamma/\gamma_c = 1 + \tfrac12\alpha\,(z/l^2k_*)^2 + O(z^4)` with the lateral deflection z of the
    free end, for small rotations; by Koiter's expansion, that is by quadrature of the linear mode in
    the quartic term of the refined energy:

    .. math:: \alpha = \frac{\int(\nu\kappa_2^2+\kappa_3^2)^2\,ds}
       {360(1-\nu^2)\,z^2\int M^2\theta^2\,ds} .

    The numbers of Audoly and Neukirch for their alpha follow with this factor of one half.

    Parameters
    ----------
    poisson_ratio : float
        In (-1, 0.5].

    Returns
    -------
    float
        :math:`\alpha`.

    Examples
    --------
    >>> from lissome.references.lateral_buckling import koiter_width_coefficient
    >>> round(koiter_width_coefficient(0.0), 6)
    0.009906
    """
    nu = _poisson(poisson_ratio)
    load = linear_load(nu)
    root = float(eigenvalues()[0])

    def angle(u: float) -> float:
        return float(mode(1.0 - u))

    def slope(u: float) -> float:
        # y'(u) of u^(1/2) J_{-1/6}(c u^3), from (z^p J_{-p})' = -z^p J_{1-p} with p = 1/6
        c = np.sqrt(root) / 3.0
        scale = gamma(5.0 / 6.0) * (c / 2.0) ** (1.0 / 6.0)
        return float(-scale * 3.0 * c * u**2.5 * jv(5.0 / 6.0, c * u**3))

    def integral(f: Callable[[float], float]) -> float:
        return float(quad(f, 0.0, 1.0, epsabs=1e-13, epsrel=1e-12, limit=200)[0])

    def bend(u: float) -> float:
        return -load * u * u * angle(u) / 2.0

    quartic = integral(lambda u: (nu * bend(u) ** 2 + slope(u) ** 2) ** 2)
    tip = integral(lambda u: u * bend(u))
    return quartic / (360.0 * (1.0 - nu**2) * tip**2 * integral(lambda u: bend(u) ** 2))


def _raised(family: Family, point: Point, target: float) -> Point:
    """Continuation in the amplitude, in steps of at most a fifth."""
    factor = 1.2
    while point.parameters[-1] < target:
        value = min(float(point.parameters[-1]) * factor, target)
        try:
            ratio = value / float(point.parameters[-1])
            nodes, slopes = point.nodes.copy(), point.slopes.copy()
            nodes[:, 1:] *= ratio
            slopes[..., 1:] *= ratio
            constants = np.array([point.parameters[0], value])
            point = family.fixed(Point(family.mesh, nodes, slopes, constants), value)
            factor = min(1.2, factor**1.5)
        except NotConverged:
            factor = np.sqrt(factor)
            if factor < 1.0005:
                raise
    return point


def _phi_and_slopes(v: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Phi and its first and second derivatives, also for complex v."""
    x = v * v / 4.0
    # numerator n and denominator d as polynomials in x with their derivatives, by Horner
    n, n1, n2 = (np.zeros_like(x) for _ in range(3))
    d, d1, d2 = (np.zeros_like(x) for _ in range(3))
    for top, bottom in zip(_TOP[::-1], _BOTTOM[::-1], strict=True):
        n2, n1, n = n2 * x + 2.0 * n1, n1 * x + n, n * x + top
        d2, d1, d = d2 * x + 2.0 * d1, d1 * x + d, d * x + bottom
    value = n / d
    first = (n1 - value * d1) / d
    second = (n2 - 2.0 * first * d1 - value * d2) / d
    # by v: x' = v/2, x'' = 1/2
    return value, first * v / 2.0, second * v * v / 4.0 + first / 2.0


def _series() -> tuple[Array, Array]:
    top = [2.0 * (k + 1) / factorial(4 * k + 6) for k in range(_ORDERS)]
    bottom = [1.0 / factorial(4 * k + 1) for k in range(_ORDERS)]
    return np.array(top), np.array(bottom)


_TOP, _BOTTOM = _series()


def _poisson(value: float) -> float:
    nu = finite("poisson_ratio", value)
    if not -1.0 < nu <= 0.5:
        raise InvalidInput(f"argument `poisson_ratio` is {nu:g}; it must lie in (-1, 0.5]")
    return nu
