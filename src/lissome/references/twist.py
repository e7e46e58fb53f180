r"""Loss of stability by twist: the twisted ring and the twisted, compressed straight rod.

Both rods are naturally straight, inextensible and of isotropic section (bending stiffness B in any
direction, torsional stiffness C); :math:`\theta` is an infinitesimal rotation of the cross-sections,
M the internal moment and N the internal force. Twice the second variation of energy plus closure is

.. math:: \int \left[\theta'\cdot D\,\theta' - M\cdot(\theta\times\theta')
   - (N\cdot\theta)(\theta\cdot t) + (N\cdot t)\,|\theta|^2\right] ds,
   \qquad \oint \theta\times t\; ds = 0 .

**Ring** (Michell's instability). A k-fold circle of length :math:`2\pi` with the twist
:math:`\tau` carries :math:`M = kB\,b + C\tau\,t` and :math:`N = kC\tau\,b`, b its binormal. With
:math:`\theta = a\cos ns\; n + f\sin ns\; b + e\sin ns\; t` the form is, per half length,

.. math:: B(n^2 - k^2)\,a^2 + Bn^2 f^2 - 2nC\tau\,af + C(ne - ka)^2 ,

which is indefinite beyond :math:`C\tau = B\sqrt{n^2 - k^2}`. For n < k it always is: only the
single circle is stable, up to the total twist :math:`2\pi\sqrt3\,B/C` (n = 2).

**Straight rod** (Greenhill's condition). With :math:`w = y + iz` the small deflection,
:math:`B w'''' - iM w''' + P w'' = 0` in the torque M and the thrust P; the solutions
:math:`e^{iqs}` have :math:`q = a \pm \sqrt{a^2 + P/B}`, :math:`a = M/2B`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from .._validate import finite, integer_at_least, one_of, positive
from ..errors import InvalidInput, NotConverged

__all__ = ["ring_twist", "rod_thrust", "rod_torque"]

_ENDS = ("hinged", "clamped")


def ring_twist(bending: float, torsion: float, *, mode: int = 2, turns: int = 1) -> float:
    r"""Total twist at which a mode of a twisted circle becomes neutral.

    .. math:: \Phi_n = 2\pi\,\frac BC\,\sqrt{n^2 - k^2}

    Parameters
    ----------
    bending, torsion : float
        Stiffnesses B and C.
    mode : int, optional
        n, number of waves around the ring, above `turns`.
    turns : int, optional
        k, how often the circle is covered.

    Returns
    -------
    float
        Twist of the section over the whole length, in radians.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.twist import ring_twist
    >>> round(ring_twist(1.0, 1.0) / (2.0 * np.pi), 6)
    1.732051
    """
    ratio = positive("bending", bending) / positive("torsion", torsion)
    k = integer_at_least("turns", turns, 1)
    n = integer_at_least("mode", mode, k + 1)
    return float(2.0 * np.pi * ratio * np.sqrt(n * n - k * k))


def rod_thrust(torque: float, ends: str = "hinged") -> float:
    r"""Least thrust that buckles a straight rod under a torque.

    Unit length and bending stiffness: torques in :math:`B/L`, thrusts in :math:`B/L^2`.

    Hinged, with the end couples fixed along the line of the ends, :math:`w = e^{iMs/2}\sin\pi s` and

    .. math:: P = \pi^2 - \tfrac14 M^2 .

    Clamped, the two wave numbers :math:`q_{1,2} = \tfrac12(M \pm \sqrt{M^2 + 4P})` obey

    .. math:: q_2 \sin\tfrac{q_2}2\left(q_1\cos\tfrac{q_1}2 - 2\sin\tfrac{q_1}2\right) =
       q_1 \sin\tfrac{q_1}2\left(q_2\cos\tfrac{q_2}2 - 2\sin\tfrac{q_2}2\right) .

    Parameters
    ----------
    torque : float
        M, of either sign, up to 50.
    ends : {'hinged', 'clamped'}, optional

    Returns
    -------
    float
        P; negative if the rod must be pulled to stay straight.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Notes
    -----
    Couples that stay along a line are not conservative when the ends may turn: the hinged case is
    the static criterion. The clamped case is conservative.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.twist import rod_thrust
    >>> round(rod_thrust(0.0, "clamped") / np.pi**2, 9)
    4.0
    """
    m = abs(finite("torque", torque))
    if one_of("ends", ends, _ENDS) == "hinged":
        return float(np.pi**2 - 0.25 * m * m)
    if m > 50.0:
        raise InvalidInput(f"argument `torque` is {m:g}; the clamped rod is solved up to 50")
    # b = 0 at the lower end; the first sign change above it is the first buckling mode
    return _first_root(lambda b2: _determinant(0.5 * m, b2), 1e-9, 0.05 * np.pi**2) - 0.25 * m * m


def rod_torque(thrust: float, ends: str = "hinged") -> float:
    r"""Least torque that buckles a straight rod under a thrust; the inverse of :func:`rod_thrust`.

    Unit length and bending stiffness.

    Parameters
    ----------
    thrust : float
        P, below the load that buckles without torque (:math:`\pi^2` hinged, :math:`4\pi^2`
        clamped); negative in tension, down to -500.
    ends : {'hinged', 'clamped'}, optional

    Returns
    -------
    float
        M > 0. Without thrust :math:`2\pi`, or 8.9868 for clamped ends, where
        :math:`\tan(M/2) = M/2`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.twist import rod_torque
    >>> round(rod_torque(0.0), 6), round(rod_torque(0.0, "clamped"), 6)
    (6.283185, 8.986819)
    """
    p = finite("thrust", thrust)
    clamped = one_of("ends", ends, _ENDS) == "clamped"
    limit = np.pi**2 * (4.0 if clamped else 1.0)
    if not -500.0 <= p < limit:
        raise InvalidInput(
            f"argument `thrust` is {p:g}; it must lie in [-500, {limit:.6f}): at the upper end the "
            "rod buckles without torque"
        )
    if not clamped:
        return float(2.0 * np.sqrt(limit - p))
    high = 2.0 * np.sqrt(limit - p) + 10.0
    return float(brentq(lambda m: rod_thrust(min(m, 50.0), "clamped") - p, 0.0, min(high, 50.0)))


def _determinant(a: float, square: float) -> float:
    """Determinant of the clamped rod over its trivial factors, for q = a +- sqrt(square)."""
    b = np.sqrt(square)
    first, second = a + b, a - b
    value = first * _moment(first) * _sine(second) - second * _moment(second) * _sine(first)
    return float(value / b)


def _sine(q: float) -> float:
    """sin(q/2)/q."""
    return 0.5 * float(np.sinc(0.5 * q / np.pi))


def _moment(q: float) -> float:
    """(q cos(q/2) - 2 sin(q/2))/q^3."""
    if abs(q) < 0.05:
        return -1.0 / 12.0 + q * q / 480.0 - q**4 / 53760.0
    return float((q * np.cos(0.5 * q) - 2.0 * np.sin(0.5 * q)) / q**3)


def _first_root(function: Callable[[float], float], low: float, step: float) -> float:
    before = function(low)
    for _ in range(4000):
        after = function(low + step)
        if before * after <= 0.0:
            return float(brentq(function, low, low + step, xtol=1e-13, rtol=1e-14))
        low, before = low + step, after
    raise NotConverged(f"no buckling load found up to {low:g}")
