r"""The planar elastica in closed form.

Unit length and unit bending stiffness: forces are in units of :math:`EI/l^2`, moments of
:math:`EI/l`, energies of :math:`EI/l`. The tangent angle obeys :math:`\theta'' + P\sin\theta = 0` in a
thrust P along the first axis; its solutions are Jacobi elliptic functions of modulus k, the sine of
half the largest angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipj, ellipk, ellipkm1, elliprd, elliprf

from .._validate import finite_array, in_open_interval, positive
from ..errors import InvalidInput, NotConverged

__all__ = [
    "BuckledStrip",
    "Cantilever",
    "buckled_strip",
    "clamped_column_loads",
    "compressed_cantilever",
    "lowest_eigenvalues",
    "transverse_cantilever",
]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BuckledStrip:
    r"""A strip between two level clamps, buckled in its first mode.

    Attributes
    ----------
    span : float
        Distance of the clamps.
    modulus : float
        Elliptic modulus k; the steepest angle is :math:`2\arcsin k`.
    thrust : float
        Force by which each clamp pushes, :math:`P = 16 K(k)^2`.
    height : float
        Height of the crest, :math:`k/K(k)`.
    energy : float
        Bending energy, :math:`P\,(\text{span} - 1 + 2k^2)`.
    end_curvature : float
        Curvature at the first clamp, :math:`2k\sqrt P`.

    Examples
    --------
    Pushing the clamps together by a little does the work of the thrust:

    >>> from lissome.references.elastica import buckled_strip
    >>> near, far = buckled_strip(0.949), buckled_strip(0.951)
    >>> work = (near.energy - far.energy) / 0.002
    >>> print(f"{work:.3f} {buckled_strip(0.95).thrust:.3f}")
    40.494 40.494
    """

    span: float
    modulus: float
    thrust: float
    height: float
    energy: float
    end_curvature: float

    @property
    def steepest_angle(self) -> float:
        """Largest tangent angle, at a quarter of the length."""
        return float(2.0 * np.arcsin(self.modulus))

    def angle(self, position: npt.ArrayLike) -> Array:
        r"""Tangent angle :math:`2\arcsin[k\,\mathrm{sn}(\sqrt P s)]` (rad), of the shape of `position`.

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        sn, _, _, _ = ellipj(np.sqrt(self.thrust) * s, self.modulus**2)
        return np.asarray(2.0 * np.arcsin(self.modulus * sn))

    def curvature(self, position: npt.ArrayLike) -> Array:
        r"""Curvature :math:`2k\sqrt P\,\mathrm{cn}(\sqrt P s)`, of the shape of the arc lengths `position`.

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        _, cn, _, _ = ellipj(np.sqrt(self.thrust) * s, self.modulus**2)
        return np.asarray(self.end_curvature * cn)

    def points(self, position: npt.ArrayLike) -> Array:
        """Coordinates at arc lengths `position` from the first clamp, shape (..., 2).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        root = np.sqrt(self.thrust)
        m = self.modulus**2
        _, cn, _, am = ellipj(root * s, m)
        x = 2.0 * _second_kind(am, m) / root - s
        y = 2.0 * self.modulus * (1.0 - cn) / root
        return np.stack([x, y], axis=-1)


def buckled_strip(span: float) -> BuckledStrip:
    r"""Return the first buckled shape between level clamps at the distance `span`.

    .. math:: \text{span} = \frac{2E(k)}{K(k)} - 1

    Parameters
    ----------
    span : float
        Distance of the clamps, in (0, 1).

    Returns
    -------
    BuckledStrip

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.elastica import buckled_strip
    >>> strip = buckled_strip(0.95)
    >>> round(strip.thrust, 6), round(strip.height, 6)
    (40.493971, 0.140111)
    """
    target = in_open_interval("span", span, 0.0, 1.0, "clamps nearer than the strip is long")

    def excess(m: float) -> float:
        # 1 - (2 E/K - 1) = 2 (K - E)/K without cancellation for small m
        return _deficit(m) - (1.0 - target)

    m = float(brentq(excess, 1e-300, 0.9, xtol=1e-300, rtol=1e-15))
    k = float(np.sqrt(m))
    quarter = float(ellipk(m))
    thrust = 16.0 * quarter**2
    return BuckledStrip(
        span=target,
        modulus=k,
        thrust=thrust,
        height=k / quarter,
        energy=thrust * (2.0 * m - (1.0 - target)),
        end_curvature=2.0 * k * float(np.sqrt(thrust)),
    )


def _second_kind(phi: npt.ArrayLike, m: float) -> Array:
    """Incomplete elliptic integral E(phi, m) by Carlson's forms.

    scipy.special.ellipeinc is wrong by 0.19 at single arguments, such as
    (0.987625521707399, 0.049683525287560794), in version 1.17.
    """
    angle = np.asarray(phi, dtype=float)
    turns = np.round(angle / np.pi)
    sine = np.sin(angle - turns * np.pi)
    square = sine * sine
    first = elliprf(1.0 - square, 1.0 - m * square, 1.0)
    third = elliprd(1.0 - square, 1.0 - m * square, 1.0)
    return np.asarray(sine * (first - m / 3.0 * square * third) + 2.0 * turns * ellipe(m))


def _deficit(m: float) -> float:
    """2 (K - E)/K, accurate for small parameter m."""
    if m < 1e-3:
        # K - E = (pi/4) m (1 + 3 m/8 + 15 m^2/64 + 175 m^3/1024 + ...)
        top = np.pi / 4 * m * (1 + m * (3 / 8 + m * (15 / 64 + m * (175 / 1024))))
    else:
        top = ellipk(m) - ellipe(m)
    return float(2.0 * top / ellipk(m))


def lowest_eigenvalues(span: float, *, rtol: float = 1e-11) -> tuple[float, float]:
    r"""Lowest eigenvalues of the second variation of the buckled strip, by shooting.

    The stationary values of :math:`\int (u'^2 - P\cos\theta\,u^2)\,dS` over variations of the angle
    with :math:`\int u^2\,dS = 1`, :math:`u(0) = u(1) = 0` and
    :math:`\int u\sin\theta\,dS = \int u\cos\theta\,dS = 0`: one for u even about the middle (the crest
    moves sideways; the lower of the two) and one for odd u (the crest stays in the middle).

    Parameters
    ----------
    span : float
        Distance of the clamps, in (0, 1).
    rtol : float, optional
        Relative tolerance of the integration of the (Lame) equation.

    Returns
    -------
    (even, odd) : tuple of float
        As the span tends to 1: :math:`q^2 - 4\pi^2 = 41.2845` with :math:`\tan(q/2) = q/2`, and
        :math:`12\pi^2`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the iteration finds no solution.

    Examples
    --------
    >>> from lissome.references.elastica import lowest_eigenvalues
    >>> even, odd = lowest_eigenvalues(0.95)
    >>> round(even, 5)
    42.57018
    """
    strip = buckled_strip(span)
    root, m, k, thrust = np.sqrt(strip.thrust), strip.modulus**2, strip.modulus, strip.thrust
    tolerance = positive("rtol", rtol)

    def determinant(value: float, even: bool) -> float:
        def right(s: float, y: Array) -> list[float]:
            sn, _, dn, _ = ellipj(root * (s + 0.5), m)
            cosine, sine = 1.0 - 2.0 * m * sn * sn, 2.0 * k * sn * dn
            row = cosine if even else sine
            stiffness = -(thrust * cosine + value)
            return [y[1], stiffness * y[0], row * y[0], y[4], stiffness * y[3] - row, row * y[3]]

        first = [1.0, 0.0] if even else [0.0, 1.0]
        run = solve_ivp(
            right, (0.0, 0.5), [*first, 0.0, 0.0, 0.0, 0.0], "DOP853", rtol=tolerance, atol=1e-14
        )
        free, _, free_row, driven, _, driven_row = run.y[:, -1]
        return float(free * driven_row - driven * free_row)

    found = []
    for even in (True, False):
        low, step = -0.5 * thrust, 0.1 * thrust
        before = determinant(low, even)
        for _ in range(100):
            after = determinant(low + step, even)
            if before * after < 0.0:
                break
            low, before = low + step, after
        else:
            raise NotConverged(f"no eigenvalue found below {low:g} at span {span:g}")
        place = brentq(determinant, low, low + step, args=(even,), xtol=1e-12, rtol=1e-14)
        found.append(float(place))
    return found[0], found[1]


def clamped_column_loads(count: int = 2) -> Array:
    r"""Buckling loads of a column between two clamps.

    The roots of :math:`\sin(q/2)\,[\sin(q/2) - (q/2)\cos(q/2)] = 0`, :math:`P = q^2`: in turn
    :math:`4\pi^2`, 80.7629, :math:`16\pi^2`, ...

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
    >>> from lissome.references.elastica import clamped_column_loads
    >>> clamped_column_loads(2)
    array([39.4784176 , 80.76291423])
    """
    if not isinstance(count, int) or count < 1:
        raise InvalidInput(f"argument `count` is {count!r}; pass a positive integer")
    loads: list[float] = []
    for n in range(1, count + 1):
        loads.append((2.0 * np.pi * n) ** 2)
        half = brentq(
            lambda t: np.sin(t) - t * np.cos(t), n * np.pi + 1e-9, (n + 0.5) * np.pi, xtol=1e-15
        )
        loads.append(4.0 * half * half)
    return np.sort(loads)[:count]


@dataclass(frozen=True)
class Cantilever:
    """Tip of a rod that is clamped along the first axis and free at the other end.

    Attributes
    ----------
    load : float
        Tip load.
    x, y : float
        Coordinates of the tip, from the clamp.
    angle : float
        Tangent angle at the tip.
    clamp_moment : float
        Curvature at the clamp.
    energy : float
        Bending energy.

    Examples
    --------
    The moment at the clamp is the load times its lever arm; a small load F deflects by F/3:

    >>> from lissome.references.elastica import transverse_cantilever
    >>> tip = transverse_cantilever(3.0)
    >>> print(f"{tip.clamp_moment / (tip.load * tip.x):.6f}")
    1.000000
    >>> print(f"{transverse_cantilever(1e-3).y / 1e-3:.6f}")
    0.333333
    """

    load: float
    x: float
    y: float
    angle: float
    clamp_moment: float
    energy: float


def transverse_cantilever(load: float) -> Cantilever:
    r"""Return the tip of a cantilever under a dead tip load across its clamped direction.

    With :math:`k^2 = (1 + \sin\theta_1)/2`, :math:`\sin\varphi_0 = 1/(k\sqrt2)` and the tip angle
    :math:`\theta_1`,

    .. math:: \sqrt F = K(k) - F(\varphi_0, k),\quad x = \sqrt{2\sin\theta_1/F},\quad
       y = 1 - \frac{2}{\sqrt F}\,[E(k) - E(\varphi_0, k)] .

    Parameters
    ----------
    load : float
        F, positive, along the second axis.

    Returns
    -------
    Cantilever

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.elastica import transverse_cantilever
    >>> tip = transverse_cantilever(5.0)
    >>> round(tip.x, 6), round(tip.y, 6)
    (0.612372, 0.713792)
    """
    f = positive("load", load)
    root = np.sqrt(f)

    def length(gap: float) -> float:
        # gap = pi/2 - tip angle; k^2 = cos^2(gap/2)
        m = np.cos(gap / 2) ** 2
        sine = min(1.0, 1.0 / np.sqrt(2.0 * m))
        first = sine * elliprf(1.0 - sine * sine, 1.0 - m * sine * sine, 1.0)
        return float(ellipk(m) - first) - root

    gap = float(brentq(length, 1e-8, np.pi / 2 - 1e-14, xtol=1e-16, rtol=1e-14))
    m = np.cos(gap / 2) ** 2
    phi = np.arcsin(1.0 / np.sqrt(2.0 * m))
    x = float(np.sqrt(2.0 * np.cos(gap) / f))
    y = float(1.0 - 2.0 / root * (ellipe(m) - _second_kind(phi, m)))
    # theta'^2/2 = F (sin(tip) - sin(theta)); integrated over the length
    return Cantilever(f, x, y, np.pi / 2 - gap, f * x, f * (float(np.cos(gap)) - y))


def compressed_cantilever(load: float) -> Cantilever:
    r"""Return the tip of a cantilever that has buckled under a dead load along its clamped direction.

    .. math:: \sqrt P = K(k),\quad x = 2E(k)/K(k) - 1,\quad y = 2k/\sqrt P,\quad
       \theta_1 = 2\arcsin k

    Parameters
    ----------
    load : float
        P, greater than the Euler load :math:`\pi^2/4`, against the first axis.

    Returns
    -------
    Cantilever
        The branch with y > 0.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.elastica import compressed_cantilever
    >>> tip = compressed_cantilever(4.0)
    >>> round(tip.x, 6), round(tip.y, 6)
    (0.27418, 0.802407)
    """
    p = positive("load", load)
    euler = np.pi**2 / 4.0
    if p <= euler:
        raise InvalidInput(
            f"argument `load` is {p:g}; it must exceed the Euler load pi^2/4 = {euler:.6f}: below "
            "it the straight rod is the only equilibrium"
        )
    root = np.sqrt(p)
    # complementary parameter on a log scale: k tends to 1 at high loads
    exponent = brentq(lambda t: _quarter(t) - root, np.log(1e-300), 0.0, xtol=1e-15, rtol=1e-15)
    complement = float(np.exp(exponent))
    m = 1.0 - complement
    k = np.sqrt(m)
    x = float(2.0 * ellipe(m) / root - 1.0)
    y = float(2.0 * k / root)
    angle = float(np.pi - 2.0 * np.arcsin(np.sqrt(complement)))
    return Cantilever(p, x, y, angle, p * y, p * (x - (1.0 - 2.0 * m)))


def _quarter(log_complement: float) -> float:
    return float(ellipkm1(np.exp(log_complement)))
