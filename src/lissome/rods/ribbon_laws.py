r"""Laws of thin ribbons whose mid-surface stretches a little: Sano and Wada; Audoly and Neukirch.

The width w lies along d1, the thickness h along d2, so that :math:`k_1` is the easy bending. (4.41) of
the thesis turns the section by a quarter: its :math:`\kappa_2`, with the stiffness :math:`A_2`, is
:math:`k_1` here, and its :math:`\kappa_1`, with :math:`A_1`, is :math:`k_2`.

Twist makes the edges longer than the middle of a ribbon. A narrow ribbon stretches; a wide one bends
across its width until it is developable. The crossover is at curvatures about
:math:`1/\xi \sim h/w^2`.

These are laws for :class:`~lissome.rods.Rod`: any curvature and twist of its center line are possible,
and have an energy. A ribbon that cannot stretch at all bends about rulings, which are unknowns of their
own: that is another structure, :class:`lissome.ribbons.Ribbon`, with the laws of :mod:`lissome.ribbons.laws`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from .._compile import jit
from .._validate import finite_array, one_of, positive
from ..errors import InvalidInput
from .laws import CompiledLaw, common_count, poisson, table, varying

__all__ = [
    "CROSSOVERS",
    "RefinedRibbon",
    "RelaxedRibbon",
    "SanoWada",
    "audoly_neukirch_phi",
    "crossover_length",
]

Array = NDArray[np.float64]

CROSSOVERS: tuple[str, ...] = ("thesis", "audoly-neukirch", "halved")
"""Names of the three published forms of the crossover length: see :func:`~lissome.rods.crossover_length`."""


def crossover_length(
    width: float, thickness: float, poisson_ratio: float, form: str = "thesis"
) -> float:
    r"""Return the length :math:`\xi` of Sano and Wada's law, in one of its published forms.

    ==================== ==================================== ===================================
    form                 :math:`\xi^2`                        where
    ==================== ==================================== ===================================
    ``thesis``           :math:`(1-\nu^2) w^4 / 60 h^2`       the thesis, below (4.41)
    ``audoly-neukirch``  :math:`w^4 / 60 h^2`                 as Audoly and Neukirch quote the law
    ``halved``           :math:`w^4 / 120 h^2`                a public code
    ==================== ==================================== ===================================

    The second one has the exact energy of a straight ribbon under small twist; the first one is
    smaller there by :math:`1-\nu^2`, and has the exact crossover of the refined law.

    Parameters
    ----------
    width, thickness : float
        Sides w and h of the section (length).
    poisson_ratio : float
        In (-1, 0.5]. Only the first form depends on it.
    form : {"thesis", "audoly-neukirch", "halved"}
        Which one.

    Returns
    -------
    float
        A length.

    Raises
    ------
    InvalidInput
        If a length is not positive, the ratio is out of range, or the form is unknown.

    Examples
    --------
    >>> from lissome.rods.ribbon_laws import crossover_length
    >>> print(f"{crossover_length(8.0, 0.2, 0.3):.2f}")
    39.41
    """
    w, h = positive("width", width), positive("thickness", thickness)
    nu = poisson("poisson_ratio", poisson_ratio)
    factor = {
        "thesis": (1.0 - nu * nu) / 60.0,
        "audoly-neukirch": 1.0 / 60.0,
        "halved": 1.0 / 120.0,
    }[one_of("form", form, CROSSOVERS)]
    return math.sqrt(factor) * w * w / h


# ---------------------------------------------------------------------------------------------
# Sano and Wada


@jit
def _sano_wada(parameters, k, energy, stress, stiffness, order):
    step = 0 if parameters.shape[0] == 1 else 1
    for i in range(k.shape[0]):
        row = i * step
        b1, b2, c, soft = (
            parameters[row, 0],
            parameters[row, 1],
            parameters[row, 2],
            parameters[row, 3],  # 1 / xi^2
        )
        x, y, z = k[i, 0], k[i, 1], k[i, 2]
        d = 1.0 / (soft + x * x)
        z2 = z * z
        g = z2 * d
        energy[i] = 0.5 * (b1 * (x * x + z2 * g) + b2 * y * y + c * z2)  # (4.41)
        if order >= 1:
            stress[i, 0] = b1 * x * (1.0 - g * g)
            stress[i, 1] = b2 * y
            stress[i, 2] = z * (2.0 * b1 * g + c)
        if order >= 2:
            for a in range(3):
                stiffness[i, a, 1] = 0.0
                stiffness[i, 1, a] = 0.0
            stiffness[i, 0, 0] = b1 * (1.0 - g * g * (1.0 - 4.0 * x * x * d))
            stiffness[i, 1, 1] = b2
            stiffness[i, 2, 2] = 6.0 * b1 * g + c
            cross = -4.0 * b1 * x * z * d * g
            stiffness[i, 0, 2] = cross
            stiffness[i, 2, 0] = cross


@dataclass(frozen=True, eq=False)
class SanoWada(CompiledLaw):
    r"""The law of Sano and Wada for ribbons of moderate width, (4.41) of the thesis.

    .. math::
        W = \tfrac12 B_1 \Big(k_1^2 + \frac{k_3^4}{1/\xi^2 + k_1^2}\Big)
            + \tfrac12 B_2 k_2^2 + \tfrac12 C k_3^2

    Parameters
    ----------
    bending : (B1, B2)
        Bending stiffnesses about the width and about the thickness (force times length squared); each
        a number, or an array with one number for each node.
    twisting : float or array_like
        Twisting stiffness C without stretching.
    crossover : float or array_like
        The length :math:`\xi`.

    Raises
    ------
    InvalidInput
        If a number is not positive, or arrays have different lengths.

    See Also
    --------
    SanoWada.from_geometry : from sides, Young's modulus and Poisson's ratio.

    Examples
    --------
    >>> from lissome.rods.ribbon_laws import SanoWada
    >>> energy, moments, stiffness = SanoWada((1.0, 50.0), 1.5, 2.0).evaluate([[0.5, 0.0, 1.0]])
    >>> print(energy)
    [1.875]
    """

    bending: Any
    twisting: Any
    crossover: Any
    kernel: ClassVar[Any] = staticmethod(_sano_wada)

    def __post_init__(self) -> None:
        first, second = self.stiffness_pair(self.bending)
        twisting = varying("twisting", self.twisting, positive)
        crossover = varying("crossover", self.crossover, positive)
        common_count(
            **{"bending[0]": first, "bending[1]": second},
            twisting=twisting,
            crossover=crossover,
        )
        object.__setattr__(self, "bending", (first, second))
        object.__setattr__(self, "twisting", twisting)
        object.__setattr__(self, "crossover", crossover)
        softness = 1.0 / np.square(crossover)
        object.__setattr__(self, "parameters", table(first, second, twisting, softness))

    @classmethod
    def from_geometry(
        cls,
        width: float,
        thickness: float,
        young_modulus: float = 1.0,
        *,
        poisson_ratio: float,
        form: str = "thesis",
        crossover: float | None = None,
    ) -> Self:
        r"""Return the law of a ribbon from its geometry.

        .. math::
            B_1 = \frac{Y h^3 w}{12},\qquad B_2 = \frac{Y h w^3}{12},\qquad
            C = \frac{Y h^3 w}{6(1+\nu)}

        Parameters
        ----------
        width, thickness : float
            Sides w along d1 and h along d2 (length).
        young_modulus : float
            Y (force per area).
        poisson_ratio : float
            In (-1, 0.5].
        form : {"thesis", "audoly-neukirch", "halved"}
            Which published form of the crossover length: see :func:`crossover_length`.
        crossover : float, optional
            The crossover length itself, in place of `form`.

        Raises
        ------
        InvalidInput
            If an argument is not in its range.
        """
        length = crossover_length(width, thickness, poisson_ratio, form)
        if crossover is not None:
            length = positive("crossover", crossover)
        y, w, h = positive("young_modulus", young_modulus), float(width), float(thickness)
        easy = y * h**3 * w / 12.0
        return cls((easy, y * h * w**3 / 12.0), 2.0 * easy / (1.0 + poisson_ratio), length)

    def largest_twist(self, curvature: ArrayLike) -> Array:
        r"""Return the twist up to which the law is elliptic, at given easy curvatures.

        With :math:`u = \xi k_1` and :math:`X = \xi^2 k_3^2/(1+u^2)` the determinant of the stiffness
        vanishes where, c being C/B1,

        .. math:: (2u^2-6) X^3 + c(3u^2-1) X^2 + 6(1+u^2) X + c(1+u^2) = 0 .

        The signs of its coefficients change once if :math:`u^2 < 3` and never otherwise. So ellipticity
        is lost beyond one twist where :math:`|k_1| < \sqrt3/\xi`, and nowhere else. A straight ribbon
        loses it at the twist :math:`1/\xi`, whatever its stiffnesses.

        Parameters
        ----------
        curvature : array_like
            Easy curvatures :math:`k_1` (1/length).

        Returns
        -------
        ndarray
            Twists (1/length) of the same shape; infinite where the law is elliptic at any twist.

        Raises
        ------
        InvalidInput
            If the law varies along the rod: take one row, ``law.at([i])``.

        Examples
        --------
        >>> from lissome.rods.ribbon_laws import SanoWada
        >>> print(SanoWada((1.0, 50.0), 1.5, 0.5).largest_twist([0.0, 3.5]))
        [ 2. inf]
        """
        k1: Array = finite_array("curvature", curvature)
        b1, _, c, soft = self._one_row()
        ratio = c / b1
        u2 = k1**2 / soft
        twist = np.full(k1.shape, np.inf)
        for place in np.ndindex(k1.shape):
            square = float(u2[place])
            p = 1.0 + square
            leading = 2.0 * square - 6.0
            if leading >= 0.0:
                continue
            middle = ratio * (3.0 * square - 1.0)
            x = _positive_root(leading, middle, 6.0 * p, ratio * p)
            twist[place] = math.sqrt(soft * p * x)
        return twist


def _positive_root(a: float, b: float, c: float, d: float) -> float:
    """Return the only positive root of a x^3 + b x^2 + c x + d with a < 0 < d."""
    high = 1.0 + max(abs(b), abs(c), abs(d)) / abs(a)  # Cauchy's bound
    return float(
        brentq(lambda x: ((a * x + b) * x + c) * x + d, 0.0, high, xtol=1e-300, rtol=1e-15)
    )


# ---------------------------------------------------------------------------------------------
# The convex envelope of Sano and Wada's law, and of Sadowsky's


@jit
def relaxed_square(x, z, soft, smooth):
    """Return D = 1/xi^2 + t at the minimum over t, and t - x^2.

    With p = max(x^2 + 1/xi^2, z^2) and a = |x^2 + 1/xi^2 - z^2|, the distance u = D - p is the only
    positive root of u (u + a) (D + z^2) = smooth D^2. The cubic is convex beyond it: Newton's method
    from above falls to it monotonically. Nothing cancels, however small `smooth` is.
    """
    square = z * z
    gap = soft + (x - z) * (x + z)
    floor = square + gap if gap > 0.0 else square
    scale = max(floor, smooth)
    p, c, s, a = floor / scale, square / scale, smooth / scale, abs(gap) / scale
    d = p + 2.0 * (s + math.sqrt(s * p))  # beyond the root, so that D^2 / (D + z^2) is larger there
    most = s * d * d / (d + c)
    u = 2.0 * most / (a + math.sqrt(a * a + 4.0 * most))
    for _ in range(200):
        d = p + u
        value = u * (u + a) * (d + c) - s * d * d
        slope = (2.0 * u + a) * (d + c) + u * (u + a) - 2.0 * s * d
        after = u - value / slope
        if not 0.0 < after < u:
            break
        u = after
    excess = u if gap > 0.0 else u + a
    return scale * (p + u), scale * excess


@jit
def _relaxed(parameters, k, energy, stress, stiffness, order):
    step = 0 if parameters.shape[0] == 1 else 1
    for i in range(k.shape[0]):
        row = i * step
        b1, b2, c, soft, smooth = (
            parameters[row, 0],
            parameters[row, 1],
            parameters[row, 2],
            parameters[row, 3],  # 1 / xi^2
            parameters[row, 4],  # delta^2
        )
        x, y, z = k[i, 0], k[i, 1], k[i, 2]
        d, excess = relaxed_square(x, z, soft, smooth)
        z2 = z * z
        q = smooth / excess  # 1 - z^4 / D^2
        barrier = smooth * (math.log(q) - 1.0)
        energy[i] = 0.5 * (b1 * (x * x + excess + z2 * z2 / d + barrier) + b2 * y * y + c * z2)
        if order >= 1:
            stress[i, 0] = b1 * x * q
            stress[i, 1] = b2 * y
            stress[i, 2] = z * (2.0 * b1 * z2 / d + c)
        if order >= 2:
            for a in range(3):
                stiffness[i, a, 1] = 0.0
                stiffness[i, 1, a] = 0.0
            r = z2 / d
            weight = 1.0 / (1.0 + 2.0 * smooth * r * r / (d * q * q))  # dD / dx^2
            by_x = 2.0 * x * weight
            by_z = 4.0 * smooth * z * r / (d * q * q) * weight
            stiffness[i, 0, 0] = b1 * (q + 2.0 * x * r * r / d * by_x)
            stiffness[i, 1, 1] = b2
            stiffness[i, 2, 2] = b1 * (6.0 * r - 2.0 * z * r / d * by_z) + c
            cross = b1 * x * (-4.0 * z * r + 2.0 * r * r * by_z) / d
            stiffness[i, 0, 2] = cross
            stiffness[i, 2, 0] = cross


@dataclass(frozen=True, eq=False)
class RelaxedRibbon(CompiledLaw):
    r"""The convex envelope of Sano and Wada's law, slightly smoothed; and of Sadowsky's.

    Where a ribbon is twisted more than it is bent, :math:`k_3^2 > 1/\xi^2 + k_1^2`, the law of
    :class:`SanoWada` is not convex: bending more here and less there, at the same mean, takes less
    energy. With the mean square :math:`t \ge k_1^2` of the curvature as a variable of its own,

    .. math::
        W = \tfrac12 B_1 \min_{t > k_1^2} \Big[t + \frac{k_3^4}{1/\xi^2 + t}
            - \delta^2 \Big(1 + \log\frac{t - k_1^2}{\delta^2}\Big)\Big]
            + \tfrac12 B_2 k_2^2 + \tfrac12 C k_3^2 .

    The bracket is jointly convex in :math:`t, k_1, k_3`, so W is smooth and strictly convex: elliptic at
    every strain. As the smoothing :math:`\delta` goes to zero it becomes the convex envelope, which is
    the law itself up to the twist above and :math:`\tfrac12 B_1(2k_3^2 - 1/\xi^2) + \tfrac12 C k_3^2`
    beyond. For Sadowsky's law (:meth:`sadowsky`: :math:`\xi=\infty`) the envelope is
    :math:`\tfrac12 Dw (k_1^2+k_3^2)^2/k_1^2` where :math:`|k_1| > |k_3|`, and
    :math:`\tfrac12 Dw\,4k_3^2` elsewhere.

    Parameters
    ----------
    bending : (B1, B2)
        Bending stiffnesses about the width and about the thickness (force times length squared).
    twisting : float or array_like
        Twisting stiffness C without stretching.
    crossover : float or array_like
        The length :math:`\xi`; ``math.inf`` for a ribbon that does not stretch.
    smoothing : float or array_like
        The curvature :math:`\delta` (1/length), small beside those of interest.

    Raises
    ------
    InvalidInput
        If a number is not positive, or arrays have different lengths.

    See Also
    --------
    RelaxedRibbon.from_geometry, RelaxedRibbon.sadowsky

    Examples
    --------
    >>> from lissome.rods.ribbon_laws import RelaxedRibbon
    >>> law = RelaxedRibbon.sadowsky(0.1, 0.01, poisson_ratio=0.0, smoothing=1e-6)
    >>> bent, twisted = law.energy([[1.0, 0.0, 0.5], [0.5, 0.0, 1.0]]) / (0.5 * 0.1 * 0.01**3 / 12)
    >>> print(bent.round(6), twisted.round(6))
    1.5625 4.0
    """

    bending: Any
    twisting: Any
    crossover: Any
    smoothing: Any = field(kw_only=True)
    kernel: ClassVar[Any] = staticmethod(_relaxed)

    def __post_init__(self) -> None:
        first, second = self.stiffness_pair(self.bending)
        twisting = varying("twisting", self.twisting, positive)
        crossover: float | Array = math.inf
        if not (np.ndim(self.crossover) == 0 and self.crossover == math.inf):
            crossover = varying("crossover", self.crossover, positive)
        smoothing = varying("smoothing", self.smoothing, positive)
        if np.max(smoothing) > 1e30:  # its square swallows all strains
            raise InvalidInput(
                f"argument `smoothing` is {np.max(smoothing):g}; it is a curvature below those of "
                "interest: use units in which it is at most 1e30"
            )
        common_count(
            **{"bending[0]": first, "bending[1]": second},
            twisting=twisting,
            crossover=crossover,
            smoothing=smoothing,
        )
        object.__setattr__(self, "bending", (first, second))
        object.__setattr__(self, "twisting", twisting)
        object.__setattr__(self, "crossover", crossover)
        object.__setattr__(self, "smoothing", smoothing)
        softness = 1.0 / np.square(crossover)
        columns = table(first, second, twisting, softness, np.square(smoothing))
        object.__setattr__(self, "parameters", columns)

    @classmethod
    def from_geometry(
        cls,
        width: float,
        thickness: float,
        young_modulus: float = 1.0,
        *,
        poisson_ratio: float,
        smoothing: float,
        form: str = "thesis",
    ) -> Self:
        """Return the envelope of Sano and Wada's law of a ribbon from its geometry.

        Parameters
        ----------
        width, thickness, young_modulus, poisson_ratio, form
            As for :meth:`SanoWada.from_geometry`.
        smoothing : float
            The curvature delta (1/length).

        Raises
        ------
        InvalidInput
            If an argument is not in its range.
        """
        law = SanoWada.from_geometry(
            width, thickness, young_modulus, poisson_ratio=poisson_ratio, form=form
        )
        return cls(law.bending, law.twisting, law.crossover, smoothing=smoothing)

    @classmethod
    def sadowsky(
        cls,
        width: float,
        thickness: float,
        young_modulus: float = 1.0,
        *,
        poisson_ratio: float,
        smoothing: float,
    ) -> Self:
        r"""Return the envelope of Sadowsky's law: :math:`B_1 = Dw`, :math:`C = 2Dw`, :math:`\xi = \infty`.

        Parameters
        ----------
        width, thickness, young_modulus, poisson_ratio
            As for :meth:`SanoWada.from_geometry`; :math:`D = Y h^3/12(1-\nu^2)`.
        smoothing : float
            The curvature delta (1/length).

        Raises
        ------
        InvalidInput
            If an argument is not in its range.
        """
        w, h = positive("width", width), positive("thickness", thickness)
        y, nu = positive("young_modulus", young_modulus), poisson("poisson_ratio", poisson_ratio)
        easy = y * h**3 * w / (12.0 * (1.0 - nu * nu))
        return cls((easy, y * h * w**3 / 12.0), 2.0 * easy, math.inf, smoothing=smoothing)


# ---------------------------------------------------------------------------------------------
# Audoly and Neukirch

# Below this argument of the hyperbolic functions phi comes from its power series.
_SERIES = 4.0
_TERMS = 14
_NUMERATOR = np.array([(2.0 * j + 2.0) / math.factorial(4 * j + 6) for j in range(_TERMS)])
_DENOMINATOR = np.array([1.0 / math.factorial(4 * j + 1) for j in range(_TERMS)])
# Beyond this, exp(-s) is lost beside one.
_LARGEST = 40.0


@jit
def phi_terms(z):
    r"""Return phi and its first two derivatives with respect to z = v^2 / 4.

    With :math:`s = z^{1/4}` phi is :math:`[1/2 - R/s]/s^4`, where R is (cosh s - cos s)/(sinh s + sin s).
    As a quotient of power series in z both numerator and denominator have positive terms only.
    """
    s = math.sqrt(math.sqrt(z))
    if s < _SERIES:
        n = 0.0
        n1 = 0.0
        n2 = 0.0
        d = 0.0
        d1 = 0.0
        d2 = 0.0
        for j in range(_TERMS - 1, -1, -1):
            n2 = n2 * z + 2.0 * n1
            n1 = n1 * z + n
            n = n * z + _NUMERATOR[j]
            d2 = d2 * z + 2.0 * d1
            d1 = d1 * z + d
            d = d * z + _DENOMINATOR[j]
        f = n / d
        f1 = (n1 - f * d1) / d
        f2 = (n2 - 2.0 * f1 * d1 - f * d2) / d
        return f, f1, f2
    r = 1.0
    r1 = 0.0
    r2 = 0.0
    if s < _LARGEST:
        e = math.exp(-s)
        e2 = e * e
        cos = math.cos(s)
        sin = math.sin(s)
        d = 1.0 - e2 + 2.0 * e * sin
        r = (1.0 + e2 - 2.0 * e * cos) / d
        r1 = 4.0 * e * (1.0 - e2) * sin / (d * d)
        r2 = 4.0 * e * ((1.0 + e2) * sin + (1.0 - e2) * cos) / (d * d)
        r2 -= 8.0 * e * (1.0 - e2) * sin * (1.0 + e2 + 2.0 * e * cos) / (d * d * d)
    # s^4 phi, and s^5, s^6 times its derivatives with respect to s
    f = 0.5 - r / s
    fs = -2.0 + 5.0 * r / s - r1
    fss = 10.0 - 30.0 * r / s + 10.0 * r1 - r2 * s
    return f / z, 0.25 * fs / (z * z), (fss - 3.0 * fs) / (16.0 * z * z * z)


@jit
def _phi_values(z, out):
    for i in range(z.size):
        out[i] = phi_terms(z[i])[0]


def audoly_neukirch_phi(v: ArrayLike) -> Array:
    r"""Return the function :math:`\varphi` of Audoly and Neukirch's refined ribbon law.

    .. math::
        \varphi(v) = \frac{4}{v^2}\Big[\frac12 - \frac{\cosh s - \cos s}{s(\sinh s + \sin s)}\Big],
        \qquad s = \sqrt{|v|/2}

    It falls from 1/360 at v = 0 (stretching) to :math:`2/v^2` (developable). Here it is accurate to
    round-off for every v.

    Parameters
    ----------
    v : array_like
        Easy curvature over :math:`k^* = h/(w^2\sqrt{12(1-\nu^2)})`.

    Returns
    -------
    ndarray
        Of the shape of `v`.

    Raises
    ------
    InvalidInput
        If an argument is not finite.

    Examples
    --------
    >>> from lissome.rods.ribbon_laws import audoly_neukirch_phi
    >>> print(1 / audoly_neukirch_phi(0.0))
    360.0
    """
    array: Array = finite_array("v", v)
    flat = np.ascontiguousarray(0.25 * array.ravel() ** 2)
    out = np.empty(flat.size)
    _phi_values(flat, out)
    return out.reshape(array.shape)


@jit
def _refined(parameters, k, energy, stress, stiffness, order):
    step = 0 if parameters.shape[0] == 1 else 1
    for i in range(k.shape[0]):
        row = i * step
        b1, b2, c, stretch, nu, rate = (
            parameters[row, 0],
            parameters[row, 1],
            parameters[row, 2],
            parameters[row, 3],
            parameters[row, 4],
            parameters[row, 5],
        )
        x, y, t = k[i, 0], k[i, 1], k[i, 2]
        # E = stretch/2 * g^2 f(z), g = nu x^2 + t^2, z = rate x^2
        f, f1, f2 = phi_terms(rate * x * x)
        g = nu * x * x + t * t
        energy[i] = 0.5 * (b1 * x * x + b2 * y * y + c * t * t + stretch * g * g * f)
        if order >= 1:
            slope = 2.0 * nu * g * f + rate * g * g * f1  # of g^2 f, with respect to x^2
            stress[i, 0] = x * (b1 + stretch * slope)
            stress[i, 1] = b2 * y
            stress[i, 2] = t * (c + 2.0 * stretch * g * f)
        if order >= 2:
            bend = 2.0 * nu * nu * f + 4.0 * nu * rate * g * f1 + rate * rate * g * g * f2
            mixed = 2.0 * nu * f + 2.0 * rate * g * f1
            for a in range(3):
                stiffness[i, a, 1] = 0.0
                stiffness[i, 1, a] = 0.0
            stiffness[i, 0, 0] = b1 + stretch * (slope + 2.0 * x * x * bend)
            stiffness[i, 1, 1] = b2
            stiffness[i, 2, 2] = c + 2.0 * stretch * f * (g + 2.0 * t * t)
            cross = 2.0 * stretch * x * t * mixed
            stiffness[i, 0, 2] = cross
            stiffness[i, 2, 0] = cross


@dataclass(frozen=True, eq=False)
class RefinedRibbon(CompiledLaw):
    r"""The refined law of Audoly and Neukirch for thin ribbons, from shell theory.

    .. math::
        W = \tfrac12 \frac{Y w h^3}{12} k_1^2 + \tfrac12 \frac{Y w^3 h}{12} k_2^2
          + \tfrac12 \frac{Y w h^3}{6(1+\nu)} k_3^2
          + \tfrac12 \frac{Y w^5 h}{2} (\nu k_1^2 + k_3^2)^2\, \varphi(k_1/k^*),
        \qquad k^* = \frac{h}{w^2\sqrt{12(1-\nu^2)}}

    with :func:`~lissome.rods.ribbon_laws.audoly_neukirch_phi`. At large :math:`k_1/k^*` it is Sadowsky's
    energy
    :math:`\tfrac12 D w (k_1^2+k_3^2)^2/k_1^2`, :math:`D = Y h^3/12(1-\nu^2)`. Without the term
    :math:`\nu k_1^2`, and with :math:`1/(360 + v^2/2)` in place of :math:`\varphi(v)`, which has the
    same limits, it is Sano and Wada's law with :math:`\xi^2 = (1-\nu^2) w^4/60h^2` and a quartic term
    that is larger by :math:`1/(1-\nu^2)`.

    Parameters
    ----------
    width, thickness : float or array_like
        Sides w along d1 and h along d2 (length); arrays with one number for each node make a tapered
        ribbon.
    young_modulus : float
        Y (force per area).
    poisson_ratio : float
        In (-1, 0.5].
    stiff_bending : float or array_like, optional
        Stiffness of bending in the plane of the ribbon, in place of :math:`Y w^3 h/12`.

    Raises
    ------
    InvalidInput
        If an argument is not in its range.

    Examples
    --------
    >>> from lissome.rods.ribbon_laws import RefinedRibbon
    >>> law = RefinedRibbon(width=8.0, thickness=0.2, poisson_ratio=0.3)
    >>> print(law.is_elliptic([[0.0, 0.0, 0.01], [0.0, 0.0, 0.05]]))
    [ True False]
    """

    width: Any
    thickness: Any
    young_modulus: float = 1.0
    stiff_bending: Any = None
    poisson_ratio: float = field(kw_only=True)
    kernel: ClassVar[Any] = staticmethod(_refined)

    def __post_init__(self) -> None:
        w = varying("width", self.width, positive)
        h = varying("thickness", self.thickness, positive)
        y = positive("young_modulus", self.young_modulus)
        nu = poisson("poisson_ratio", self.poisson_ratio)
        stiff = y * w**3 * h / 12.0
        if self.stiff_bending is not None:
            stiff = varying("stiff_bending", self.stiff_bending, positive)
            object.__setattr__(self, "stiff_bending", stiff)
        common_count(width=w, thickness=h, stiff_bending=stiff)
        object.__setattr__(self, "width", w)
        object.__setattr__(self, "thickness", h)
        object.__setattr__(self, "young_modulus", y)
        object.__setattr__(self, "poisson_ratio", nu)
        with np.errstate(over="ignore"):  # refused by the table
            w, h = np.asarray(w), np.asarray(h)
            rate = 3.0 * (1.0 - nu * nu) * w**4 / h**2  # v^2 / 4 = rate k1^2
            columns = (
                y * w * h**3 / 12.0,
                stiff,
                y * w * h**3 / (6.0 * (1.0 + nu)),
                y * w**5 * h / 2.0,
                nu,
                rate,
            )
        object.__setattr__(self, "parameters", table(*columns))

    def largest_twist(self, curvature: ArrayLike) -> Array:
        """Return the twist at which the law first ceases to be elliptic, at given easy curvatures.

        Found on a grid of twists (in units of k*) and refined by bisection: ellipticity is lost only
        where the curvature is of the order of k* or less.

        Parameters
        ----------
        curvature : array_like
            Easy curvatures (1/length).

        Returns
        -------
        ndarray
            Twists (1/length) of the same shape; infinite where none up to 1000 k* loses ellipticity.

        Raises
        ------
        InvalidInput
            If the law varies along the rod: take one row, ``law.at([i])``.

        Examples
        --------
        >>> from lissome.rods.ribbon_laws import RefinedRibbon
        >>> law = RefinedRibbon(width=8.0, thickness=0.2, poisson_ratio=0.3)
        >>> print(law.largest_twist([0.0, 0.5]).round(4))
        [0.0258    inf]
        """
        k1: Array = finite_array("curvature", curvature)
        star = 0.5 / math.sqrt(self._one_row()[5])
        grid = star * np.geomspace(1e-2, 1e3, 1001)
        twist = np.full(k1.shape, np.inf)

        def least(x: float, t: ArrayLike) -> Array:
            strains = np.zeros((np.size(t), 3))
            strains[:, 0], strains[:, 2] = x, t
            stiffness = self.evaluate(strains)[2]
            assert stiffness is not None
            pair = stiffness[:, ::2, ::2]
            return np.asarray(pair[:, 0, 0] * pair[:, 1, 1] - pair[:, 0, 1] ** 2)

        for place in np.ndindex(k1.shape):
            x = float(k1[place])
            lost = np.flatnonzero(least(x, grid) <= 0.0)
            if lost.size and lost[0] == 0:
                twist[place] = 0.0
            elif lost.size:
                low, high = grid[lost[0] - 1], grid[lost[0]]
                twist[place] = brentq(lambda t, x=x: least(x, t)[0], low, high, rtol=1e-13)
        return twist
