r"""Energies of inextensible ribbons: Wunderlich's, and Sadowsky's for vanishing width.

A developable strip is bent about its rulings only. With the bending :math:`\kappa_1` of the center
line, the tangent :math:`\eta` of the angle between a ruling and d1, and the coordinate t along rulings
(measured across the strip), the curvature is :math:`k = \kappa_1(1+\eta^2)/(1+t\eta')` and the area
element :math:`(1+t\eta')\,ds\,dt`. The integral over the width w of the energy of a plate,
:math:`\tfrac12 D k^2`, is

.. math:: W = \tfrac12 D w\,\kappa_1^2 (1+\eta^2)^2\, g(w\eta'),
   \qquad g(v) = \frac1v \ln\frac{1+v/2}{1-v/2},

per unit length of the center line (4.36). It is finite for :math:`|v| < 2` only: there a ruling meets its
neighbor on an edge. With :math:`v = 2\tanh a` the factor is :math:`g = a\coth a`, smooth for all a; the
*fold variable* a is an unknown of the ribbons here, so that no step can pass the barrier.

Ribbons that stretch a little are rods with laws of their own: :mod:`lissome.rods.ribbon_laws`.

A plate that is curved at rest, by the tensor with components :math:`k_0` along the strip, :math:`\tau_0`
(twist) and :math:`c_0` across it, adds terms that integrate exactly: with Poisson's ratio :math:`\nu`

.. math::

    -D w \kappa_1\left[(1-\nu)(k_0 + 2\eta\tau_0 + \eta^2 c_0) + \nu(1+\eta^2)(k_0 + c_0)\right]
    + \tfrac12 D w\left[(1-\nu)(k_0^2 + 2\tau_0^2 + c_0^2) + \nu(k_0+c_0)^2\right].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._compile import jit
from .._validate import finite, finite_array, moderate, positive
from ..errors import InvalidInput

__all__ = ["RibbonLaw", "Sadowsky", "Wunderlich", "width_factor"]

Array = NDArray[np.float64]

#: Coefficients of a coth a = 1 + a^2/3 - a^4/45 + ...: 2 (-1)^(k+1) zeta(2k) / pi^(2k).
SERIES = tuple(
    2.0 * (-1.0) ** (k + 1) * sum(j ** (-2.0 * k) for j in range(400, 0, -1)) / math.pi ** (2 * k)
    if k > 3
    else (1 / 3, -1 / 45, 2 / 945)[k - 1]
    for k in range(1, 11)
)
#: Those of its first derivative over a, and of its second one.
_SLOPES = tuple(2.0 * k * c for k, c in enumerate(SERIES, 1))
_BENDS = tuple((2.0 * k - 1.0) * c for k, c in enumerate(_SLOPES, 1))
#: Below this the series is used.
SMALL = 0.4


@jit(error_model="numpy", no_cpython_wrapper=True)
def _cotangent(a, decay):
    """Return a coth(a) and its first and second derivative for a >= 0, where ``decay`` is exp(-2a)."""
    if a < SMALL:
        x = a * a
        y = x * x
        g0, g1, d0, d1, e0, e1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(8, -1, -2):  # even and odd terms do not wait for each other
            g0 = g0 * y + SERIES[k]
            g1 = g1 * y + SERIES[k + 1]
            d0 = d0 * y + _SLOPES[k]
            d1 = d1 * y + _SLOPES[k + 1]
            e0 = e0 * y + _BENDS[k]
            e1 = e1 * y + _BENDS[k + 1]
        return 1.0 + x * (g0 + x * g1), a * (d0 + x * d1), e0 + x * e1
    part = 1.0 / (1.0 - decay)
    g = a * (1.0 + decay) * part
    csch2 = 4.0 * decay * part * part
    return g, (1.0 + decay) * part - a * csch2, 2.0 * (g - 1.0) * csch2


@jit(error_model="numpy")
def cotangent_factor(a):
    """Return a coth(a) and its first and second derivative."""
    b = abs(a)
    g, d, e = _cotangent(b, math.exp(-2.0 * b))
    return g, (d if a > 0.0 else -d), e


@jit(error_model="numpy", no_cpython_wrapper=True)
def _ratio_of_fold(a, decay, y):
    """Return (sinh 2a - 2a)/(4 a^2) over y, and its logarithmic derivative, where ``decay`` is exp(-2a)."""
    if a < 0.3:
        x = a * a
        h = 1.0 + x * (
            0.2 + x * (2.0 / 105.0 + x * (1.0 / 945.0 + x * (2.0 / 51975.0 + x * 2.0 / 2027025.0)))
        )
        slope = 0.2 + x * (
            4.0 / 105.0 + x * (3.0 / 945.0 + x * (8.0 / 51975.0 + x * 10.0 / 2027025.0))
        )
        return a * h / (3.0 * y), 1.0 + 2.0 * x * slope / h
    rest = 1.0 - decay * decay - 4.0 * a * decay
    slope = 2.0 * a * (1.0 - decay) * (1.0 - decay) / rest - 2.0
    return rest / (8.0 * a * a * decay * y), slope


def _tabulated() -> tuple[Array, Array]:
    """Return the fold variable, and its derivative, at equal steps of the logarithm of that ratio."""
    folds, slopes = np.empty(_COUNT), np.empty(_COUNT)
    a = 3e-3
    for i in range(_COUNT):
        y, step, slope = math.exp(_FIRST + _STEP * i), 1.0, 1.0
        while abs(step) > 1e-9:  # the next one is of the order of its square
            ratio, slope = _ratio_of_fold.py_func(a, math.exp(-2.0 * a), y)
            step = math.log(ratio) / slope
            a *= math.exp(-step)
        folds[i], slopes[i] = a, a / slope
    return folds, slopes


#: The table of `fold_of` begins at the logarithm of 1e-3, and ends at that of about 1e13.
_FIRST, _STEP, _COUNT = math.log(1e-3), 0.0625, 600
_FOLDS, _FOLD_SLOPES = _tabulated()


@jit(error_model="numpy")
def fold_of(y):
    """Return the fold variable a >= 0 with (sinh 2a - 2a)/(4 a^2) = y >= 0, and exp(-2a).

    A cubic between tabulated values is off by less than 1e-6; Newton's method for the logarithm of both
    sides over that of a does the rest. Beyond the table it goes down from the right, as it is convex.
    """
    if y < 1e-3:
        x = 9.0 * y * y
        a = 3.0 * y * (1.0 - x * (0.2 - x * 53.0 / 525.0))
        return a, math.exp(-2.0 * a)
    place = (math.log(y) - _FIRST) / _STEP
    k = int(place)
    if k < _COUNT - 1:
        x = place - k
        z = 1.0 - x
        a = z * z * (_FOLDS[k] * (1.0 + 2.0 * x) + _STEP * _FOLD_SLOPES[k] * x)
        a += x * x * (_FOLDS[k + 1] * (1.0 + 2.0 * z) - _STEP * _FOLD_SLOPES[k + 1] * z)
        decay = math.exp(-2.0 * a)
        ratio, slope = _ratio_of_fold(a, decay, y)
        off = ratio - 1.0
        step = off * (1.0 - 0.5 * off) / slope  # of logarithms
        change = a * step * (1.0 - 0.5 * step)
        return a - change, decay * (1.0 + 2.0 * change)
    target = math.log(y)
    a = 2.0 + 0.75 * target
    for _ in range(50):
        rest = 1.0 - 4.0 * a * math.exp(-2.0 * a)  # 2a is more than 30
        step = (2.0 * a + math.log(rest / (8.0 * a * a)) - target) / (2.0 * a / rest - 2.0)
        a *= 1.0 - step if abs(step) < 1e-3 else math.exp(-step)
        if abs(step) < 1e-7:  # the next one is of the order of its square
            break
    return a, math.exp(-2.0 * a)


@jit(error_model="numpy")
def complementary(b, stress, eta, flux, out):
    """Write the complementary energy per length, the Legendre transform of that of `density`.

    By the moment P that works on the bending, and the flux m that works on half of the width times the
    slope: the largest value over k and a of ``P k + m tanh(a) - D w k^2 (1 + h^2)^2 a coth(a) / 2``.
    With ``S = P^2 / (D w (1 + h^2)^2)`` that is where ``(sinh 2a - 2a) / (4 a^2) = m / S``. Unlike bending
    and fold it is smooth where P passes zero: a is infinite there, its tanh and the energy are not.

    `out`: value, energy, first derivatives by P, h and m, then those by PP, Ph, Pm, hh, hm, mm.
    """
    part = 1.0 / (1.0 + eta * eta)
    rho = 4.0 * eta * part
    drho = 4.0 * (1.0 - eta * eta) * part * part
    c = part * part / b
    size = max(abs(stress), 1e-150)
    s = stress * stress * c
    a, decay = 0.0, 1.0
    if flux != 0.0:
        a, decay = fold_of(abs(flux) / (size * size * c))
    g, d, e = _cotangent(a, decay)
    part = 1.0 / (1.0 + decay)
    t = (1.0 - decay) * part
    sech2 = 4.0 * decay * part * part
    part = 1.0 / g
    stiff = 1.0 / (e - 2.0 * d * d * part + 2.0 * t * d)
    sign = 1.0 if flux >= 0.0 else -1.0
    ds = 0.5 * part
    dss_s = 0.5 * d * d * part * part * stiff  # times s: finite where s vanishes
    dsm_s = -sign * d * sech2 * stiff  # times s
    out[0] = s * ds + abs(flux) * t
    out[1] = s * ds
    out[2] = stress * c * part
    out[3] = -rho * s * ds
    out[4] = sign * t
    out[5] = 2.0 * c * (ds + 2.0 * dss_s)
    # derivatives of S: P: 2 P c; h: -rho s; Ph: -2 rho P c; hh: s (rho^2 - drho)
    out[6] = -2.0 * rho * stress * c * (ds + dss_s)
    out[7] = 2.0 * dsm_s * (1.0 if stress >= 0.0 else -1.0) / size
    out[8] = s * (rho * rho - drho) * ds + rho * rho * s * dss_s
    out[9] = -rho * dsm_s
    out[10] = 2.0 * g * g * sech2 * sech2 * stiff / max(s, size * size * c)


@jit(error_model="numpy")
def density(parameters, k, eta, g, out):
    """Write the energy per length and its derivatives by bending, ruling, and width factor g.

    `out`: W, W_k, W_h, W_g, W_kk, W_kh, W_kg, W_hh, W_hg. `parameters`: D w, whether there is a fold
    variable, three coefficients of the natural curvatures, and the constant.
    """
    b = parameters[0]
    r = 1.0 + eta * eta
    p = r * r
    dp = 4.0 * eta * r
    ddp = 4.0 * r + 8.0 * eta * eta
    q = parameters[2] + eta * (parameters[3] + eta * parameters[4])
    dq = parameters[3] + 2.0 * eta * parameters[4]
    ddq = 2.0 * parameters[4]
    k2 = k * k
    out[0] = b * (0.5 * k2 * p * g - k * q + 0.5 * parameters[5])
    out[1] = b * (k * p * g - q)
    out[2] = b * (0.5 * k2 * dp * g - k * dq)
    out[3] = b * 0.5 * k2 * p
    out[4] = b * p * g
    out[5] = b * (k * dp * g - dq)
    out[6] = b * k * p
    out[7] = b * (0.5 * k2 * ddp * g - k * ddq)
    out[8] = b * 0.5 * k2 * dp


@jit(error_model="numpy")
def _factors(v, out):
    for i in range(v.size):
        g, _, _ = cotangent_factor(math.atanh(0.5 * v[i]))
        out[i] = g


def width_factor(v: ArrayLike) -> Array:
    r"""Return Wunderlich's factor :math:`g(v) = \frac1v \ln\frac{1+v/2}{1-v/2}`.

    Parameters
    ----------
    v : array_like
        Width times the derivative of the ruling parameter; between -2 and 2.

    Returns
    -------
    ndarray
        Of the shape of `v`: at least 1; 1 at zero, infinite at the ends.

    Raises
    ------
    InvalidInput
        If a value is not between -2 and 2: rulings would cross inside the strip.

    Examples
    --------
    >>> from lissome.ribbons import width_factor
    >>> print(width_factor([0.0, 1.0]).round(6))
    [1.       1.098612]
    """
    values = finite_array("v", v)
    if np.any(np.abs(values) >= 2.0):
        worst = float(values.ravel()[int(np.argmax(np.abs(values)))])
        raise InvalidInput(
            f"argument `v` holds {worst:g}; it must lie in (-2, 2): beyond, rulings cross inside the "
            "strip"
        )
    flat = np.array(values, dtype=float).reshape(-1)
    out = np.empty_like(flat)
    _factors(flat, out)
    return out.reshape(values.shape)


@dataclass(frozen=True)
class RibbonLaw:
    """What the laws of inextensible ribbons share; see :class:`Wunderlich`.

    Attributes
    ----------
    width, thickness, young_modulus, poisson_ratio, rigidity
        See :class:`Wunderlich`.
    natural_curvature, natural_twist, natural_cross_curvature : float
        See :class:`Wunderlich`.

    Raises
    ------
    InvalidInput
        If an argument is missing or out of range.

    Examples
    --------
    A strip that is bent about its width, without twist, is a plate on a cylinder under either law:
    :math:`W = \\tfrac12 D w \\kappa_1^2`.

    >>> from lissome import ribbons
    >>> for law in (ribbons.Wunderlich, ribbons.Sadowsky):
    ...     strip = law(width=0.1, rigidity=1.0)
    ...     print(isinstance(strip, ribbons.RibbonLaw), strip.energy(2.0, 0.0).round(9))
    True 0.2
    True 0.2
    """

    width: float
    thickness: float | None = None
    young_modulus: float | None = None
    poisson_ratio: float | None = None
    rigidity: float | None = None
    natural_curvature: float = 0.0
    natural_twist: float = 0.0
    natural_cross_curvature: float = 0.0

    #: Whether the energy depends on the derivative of the ruling parameter.
    has_fold: ClassVar[bool] = True

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("width", positive("width", self.width))
        nu = self.poisson_ratio
        if nu is not None:
            nu = finite("poisson_ratio", nu)
            if not 0.0 <= nu <= 0.5:
                raise InvalidInput(f"argument `poisson_ratio` is {nu:g}; it must lie in [0, 1/2]")
            put("poisson_ratio", nu)
        for name in ("natural_curvature", "natural_twist", "natural_cross_curvature"):
            put(name, finite(name, getattr(self, name)))
        plate = (self.thickness, self.young_modulus)
        if self.rigidity is not None:
            if any(value is not None for value in plate):
                raise InvalidInput(
                    "argument `rigidity` is given together with `thickness` or `young_modulus`; it "
                    "replaces them"
                )
            put("rigidity", positive("rigidity", self.rigidity))
        else:
            if any(value is None for value in (*plate, nu)):
                raise InvalidInput(
                    "a ribbon needs `rigidity`, or `thickness`, `young_modulus` and `poisson_ratio`"
                )
            h = positive("thickness", self.thickness)
            young = positive("young_modulus", self.young_modulus)
            assert nu is not None
            put("thickness", h)
            put("young_modulus", young)
            put("rigidity", young * h**3 / (12.0 * (1.0 - nu * nu)))  # below (4.36)
            if h >= self.width:
                raise InvalidInput(
                    f"argument `thickness` is {h:g}, not less than the width {self.width:g}; a ribbon "
                    "is thin"
                )
        if self.naturally_curved and nu is None:
            raise InvalidInput(
                "a ribbon that is curved at rest needs `poisson_ratio`: it weighs the curvatures"
            )

    @property
    def naturally_curved(self) -> bool:
        """Whether the ribbon is not flat at rest."""
        return bool(self.natural_curvature or self.natural_twist or self.natural_cross_curvature)

    @property
    def parameters(self) -> Array:
        """What the compiled energy needs."""
        k0, t0, c0 = self.natural_curvature, self.natural_twist, self.natural_cross_curvature
        nu = self.poisson_ratio or 0.0
        assert self.rigidity is not None
        trace = nu * (k0 + c0)
        return np.array(
            [
                self.rigidity * self.width,
                1.0 if self.has_fold else 0.0,
                (1.0 - nu) * k0 + trace,
                2.0 * (1.0 - nu) * t0,
                (1.0 - nu) * c0 + trace,
                (1.0 - nu) * (k0 * k0 + 2.0 * t0 * t0 + c0 * c0) + trace * (k0 + c0),
            ]
        )

    def with_width(self, width: float) -> Self:
        """Return the law of a strip of another `width` (length), of the same plate."""
        if self.thickness is not None:
            return replace(self, width=width, rigidity=None)
        return replace(self, width=width)

    def energy(self, bending: ArrayLike, ruling: ArrayLike, slope: ArrayLike = 0.0) -> Array:
        r"""Return the energy per unit length.

        Parameters
        ----------
        bending, ruling, slope : array_like
            :math:`\kappa_1` (1/length), :math:`\eta` and :math:`\eta'` (1/length); broadcast.

        Returns
        -------
        ndarray
            Energy over length, of the broadcast shape.

        Raises
        ------
        InvalidInput
            If the width times the slope is not between -2 and 2 (Wunderlich), or the energy is too
            large for a float.
        """
        k, h, s = np.broadcast_arrays(
            moderate("bending", finite_array("bending", bending)),
            moderate("ruling", finite_array("ruling", ruling)),
            moderate("slope", finite_array("slope", slope)),
        )
        factor = width_factor(self.width * s) if self.has_fold else np.ones(k.shape)
        out = np.empty(k.size)
        row, parameters = np.empty(9), self.parameters
        for i, values in enumerate(zip(k.flat, h.flat, factor.flat, strict=True)):
            density(parameters, float(values[0]), float(values[1]), float(values[2]), row)
            out[i] = row[0]
            if not math.isfinite(row[0]):
                raise InvalidInput(
                    f"arguments `bending` and `ruling` are {values[0]:.3g} and {values[1]:.3g}; their "
                    "energy is too large for a float: use units in which they are smaller"
                )
        return out.reshape(k.shape)


@dataclass(frozen=True)
class Wunderlich(RibbonLaw):
    r"""Energy of an inextensible strip of finite width.

    .. math:: W = \tfrac12 D w\,\kappa_1^2 (1+\eta^2)^2\, \frac1v\ln\frac{1+v/2}{1-v/2},
       \qquad v = w\eta'

    (4.36), with :math:`D = Yh^3/12(1-\nu^2)`; natural curvatures add the terms that the module's
    documentation derives.

    Parameters
    ----------
    width : float
        Full width w of the strip (length).
    thickness, young_modulus, poisson_ratio : float, optional
        Of the plate: h (length), Y (force/length^2), and nu in [0, 1/2].
    rigidity : float, optional
        D (force times length), in place of thickness and modulus.
    natural_curvature, natural_twist, natural_cross_curvature : float
        Curvature tensor at rest (1/length): along the strip (about d1), twist, and across. They need
        `poisson_ratio`.

    Raises
    ------
    InvalidInput
        If an argument is missing or out of range.

    Examples
    --------
    >>> from lissome import ribbons
    >>> law = ribbons.Wunderlich(width=0.1, thickness=0.001, young_modulus=1e9, poisson_ratio=0.5)
    >>> round(law.rigidity, 6)
    0.111111
    >>> print(law.energy(2.0, 0.0).round(6))
    0.022222
    """

    has_fold: ClassVar[bool] = True


@dataclass(frozen=True)
class Sadowsky(RibbonLaw):
    r"""Energy of an inextensible strip in the limit of vanishing width.

    .. math:: W = \tfrac12 D w\,\kappa_1^2 (1+\eta^2)^2 = \tfrac12 D w\,(\kappa_1^2+\kappa_3^2)^2/\kappa_1^2

    It does not depend on the derivative of the ruling parameter, which is therefore a variable of each
    hinge. Where :math:`|\kappa_3| > |\kappa_1|` a bending that alternates in sign has less energy than an
    even one, and minima in the limit of a fine mesh do alternate. Every state with
    :math:`\kappa_1\neq0` is convex by itself, so that the solver finds such states stable, even or
    alternating; `bending_jumps` and a finer mesh tell how much the result depends on the mesh.

    Parameters
    ----------
    width, thickness, young_modulus, poisson_ratio, rigidity
        As for :class:`Wunderlich`.
    natural_curvature, natural_twist, natural_cross_curvature
        As for :class:`Wunderlich`.

    Raises
    ------
    InvalidInput
        If an argument is missing or out of range.

    Examples
    --------
    A twist as large as the bending, :math:`\eta = 1`, makes the energy fourfold:

    >>> from lissome import ribbons
    >>> strip = ribbons.Sadowsky(width=0.1, rigidity=1.0)
    >>> print(strip.energy(2.0, 1.0) / strip.energy(2.0, 0.0))
    4.0
    """

    has_fold: ClassVar[bool] = False
