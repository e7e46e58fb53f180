r"""Rolling of a closed elastica under light: closed forms and a spectral traveling wave.

The ring is traversed counterclockwise (tangent angle :math:`\theta` from 0 at the ground to
:math:`2\pi`), has unit length and the natural curvature :math:`2\pi`. Light falls at the angle
:math:`\theta_I` from the vertical; positive angles are light from the upper left. Its natural
curvature relaxes as

.. math:: \partial_T K_0 = -(K_0 - 2\pi) + \Lambda f(\theta - \theta_I - \delta),
   \qquad f(\varphi) = \max(0, \cos\varphi),

with :math:`\delta = 0` if the lower half is lit and :math:`\delta = \pi` if the upper half is.
Steady rolling is a traveling wave :math:`\theta(S, T) = \Theta(S - VT)`; :math:`V > 0` is rolling to
the right. Equations (3.16)-(3.29) of the thesis.

Two independent routes are given: the linear theory for a nearly circular ring, summed in closed
form, and the nonlinear problem by Chebyshev collocation on the three arcs between the terminators
(the ends of the lit half) and the contact. Neither uses the library's structures or solvers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from .._validate import finite, finite_array, integer_at_least, one_of
from ..errors import InvalidInput, NotConverged

__all__ = [
    "LinearRolling",
    "RollingWave",
    "breakdown_angle",
    "contact_sum",
    "light_coefficient",
    "linear_natural_curvature",
    "linear_speed",
    "rolling_wave",
    "selection",
]

Side = Literal["lower", "upper"]
_TWO_PI = 2.0 * np.pi


def light_coefficient(order: int, angle: float = 0.0) -> complex:
    r"""Fourier coefficient of the light on a circle.

    .. math:: \hat f_I(k) = \int_0^{2\pi} f(\omega - \theta_I)\, e^{-ik\omega}\, d\omega
       = e^{-ik\theta_I}\,\frac{2\cos(k\pi/2)}{1 - k^2}, \qquad
       \hat f_I(\pm 1) = \tfrac{\pi}{2}\, e^{\mp i\theta_I},

    the coefficient in (3.24)-(3.25) of the thesis. All odd orders but the first vanish.

    Parameters
    ----------
    order : int
        The integer k, of either sign.
    angle : float, optional
        Angle of the light from the vertical, in radians.

    Returns
    -------
    complex

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.rolling import light_coefficient
    >>> light_coefficient(0).real
    2.0
    """
    k = integer_at_least("order", order, -(10**9))
    theta = finite("angle", angle, unit="rad")
    if abs(k) == 1:
        size = np.pi / 2.0
    elif k % 2:
        size = 0.0
    else:
        size = 2.0 * (-1.0) ** (k // 2) / (1.0 - float(k) ** 2)
    return complex(size * np.exp(-1j * k * theta))


def _generating_derivatives(angle: float, speed: float) -> tuple[float, float, float]:
    r"""First three derivatives in the angle of the generating function of the linear theory.

    :math:`E(\theta) = \sum_{n\ge1} (-1)^n \cos 2n\theta\,/\,[(4n^2-1)^2 (1+4a^2n^2)]`, :math:`a=2\pi V`,
    by partial fractions in :math:`4n^2`, for :math:`|\theta| \le \pi/2`.
    """
    a = _TWO_PI * speed
    t = angle
    one = 1.0 + a * a
    c, s = np.cos(t), np.sin(t)
    b = abs(a)  # cosh(t/a) and sinh(t/a)/sinh(pi/2a) do not depend on the sign of a
    if b == 0.0:
        even = odd = 0.0
    else:
        # exp((t - pi/2)/b) and exp((-t - pi/2)/b): nothing overflows at slow rolling
        p, q = np.exp((t - np.pi / 2) / b), np.exp((-t - np.pi / 2) / b)
        d = -np.expm1(-np.pi / b)
        even, odd = (p + q) / d, (p - q) / d  # cosh(t/b)/sinh(pi/2b), sinh(t/b)/sinh(pi/2b)
    factor = np.pi / (8.0 * one * one)
    first = one * t * c - 2 * a * a * s + 2 * a * a * odd
    second = one * (c - t * s) - 2 * a * a * c + 2 * b * even
    third = one * (-2 * s - t * c) + 2 * a * a * s + 2 * odd
    return float(factor * first), float(factor * second), float(factor * third)


def _check_angle(angle: float) -> float:
    t = finite("angle", angle, unit="rad")
    if abs(t) > np.pi / 2:
        raise InvalidInput(
            f"argument `angle` is {t:g}; it must lie in [-pi/2, pi/2]: measure it from the "
            "vertical, and choose the lit half with `side`"
        )
    return t


def selection(angle: float, speed: float) -> float:
    r"""The function whose zero selects the speed of a slightly deformed ring, in closed form.

    .. math:: H(\theta_I, V) = \sum_{k\ge2}\frac{k}{k^2-1}\,
       \mathrm{Im}\frac{\hat f_I(k)}{1-2\pi i k V}
       = 2\,(a E'' - E'), \qquad a = 2\pi V,

    where :math:`E(\theta) = \sum_{n\ge1}(-1)^n\cos 2n\theta/[(4n^2-1)^2(1+4a^2n^2)]`; (3.29) of the
    thesis. It is proportional to the slope of the height of the center of mass against the
    material point that is put on the ground.

    Parameters
    ----------
    angle : float
        Angle of the light from the vertical, within :math:`[-\pi/2, \pi/2]`.
    speed : float
        Rolling speed in ring lengths per relaxation time.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.rolling import selection
    >>> float(round(selection(0.3, 0.04), 12))
    -0.045843185309
    """
    t, v = _check_angle(angle), finite("speed", speed)
    first, second, _ = _generating_derivatives(t, v)
    return 2.0 * (_TWO_PI * v * second - first)


def contact_sum(angle: float, speed: float) -> float:
    r"""Stiffness of the contact in the linear theory, per unit of light.

    .. math:: \frac{1}{\Lambda}\frac{d^2 \bar Y}{dS_c^2}
       = -2\sum_{k\ge2}\frac{k^2}{k^2-1}\,\mathrm{Re}\frac{\hat f_I(k)}{1-2\pi i k V}\,
       \frac{1}{2\pi} = \frac{1}{\pi}\,\partial_{\theta_I} H(\theta_I, V) .

    The height of the center of mass has a minimum at the contact, as gravity requires, where
    :math:`\Lambda` times this number is positive.

    Parameters
    ----------
    angle, speed : float
        As in :func:`selection`.

    Returns
    -------
    float
        Second derivative of the height in the material coordinate of the contact, over
        :math:`\Lambda`; lengths in units of the ring's length.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.rolling import contact_sum
    >>> contact_sum(0.0, 0.0) < 0  # stable for negative response only
    True
    """
    t, v = _check_angle(angle), finite("speed", speed)
    _, second, third = _generating_derivatives(t, v)
    return 2.0 * (_TWO_PI * v * third - second) / np.pi


def breakdown_angle() -> float:
    r"""Angle of the light at which the speed of steady rolling diverges.

    The root of :math:`\cos\theta + \theta\sin\theta = 4/\pi`, 46.1 degrees. As the speed grows, the
    ring sees the mean of the light and becomes a circle, so that the angle holds for every
    intensity and not only in the linear theory.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.references.rolling import breakdown_angle
    >>> float(round(np.degrees(breakdown_angle()), 6))
    46.108689
    """
    return float(brentq(lambda t: np.cos(t) + t * np.sin(t) - 4.0 / np.pi, 0.5, 1.0, xtol=1e-15))


@dataclass(frozen=True)
class LinearRolling:
    """Steady rolling of a slightly deformed ring.

    Attributes
    ----------
    speed : float
        Ring lengths per relaxation time; positive away from the light.
    stable_response : int
        Sign of the response for which gravity holds the contact (+1 or -1).

    Examples
    --------
    Beyond 46 degrees the ring rolls toward the light, and only with the other response:

    >>> from lissome.references.rolling import linear_speed
    >>> low, high = linear_speed(0.7), linear_speed(0.9)
    >>> low.speed > 0, low.stable_response, high.speed < 0, high.stable_response
    (True, -1, True, 1)
    """

    speed: float
    stable_response: int


def linear_speed(angle: float) -> LinearRolling:
    r"""Rolling speed of a slightly deformed ring: the zero of :func:`selection`.

    For small angles :math:`2\pi V = \theta_I + \theta_I^3 + \dots`; the speed has a pole at
    :func:`breakdown_angle` and the other sign beyond it, where the contact is held only for the
    other sign of the response.

    Parameters
    ----------
    angle : float
        Angle of the light from the vertical, in :math:`(-\pi/2, \pi/2)`.

    Returns
    -------
    LinearRolling

    Raises
    ------
    InvalidInput
        If the angle is out of range or is the breakdown angle to round-off.
    NotConverged
        If the iteration finds no solution.

    Examples
    --------
    >>> from lissome.references.rolling import linear_speed
    >>> linear_speed(0.2).speed  # doctest: +ELLIPSIS
    0.0332568303...
    """
    t = _check_angle(angle)
    size = abs(t)
    if size == 0.0:
        return LinearRolling(0.0, -1)
    if size == np.pi / 2:
        return LinearRolling(0.0, +1)
    critical = breakdown_angle()
    if abs(size - critical) < 1e-12:
        raise InvalidInput(
            f"argument `angle` is {t!r}; the speed is infinite there: stay 1e-12 rad away from it"
        )
    sign = 1.0 if size < critical else -1.0
    small = size if sign > 0 else np.pi / 2 - size

    def condition(speed: float) -> float:
        return selection(size, sign * speed)

    # |V| lies above its small-angle value, and below a bound that the pole sets
    low, high = 0.2 * small / _TWO_PI, 1.0
    while condition(low) * condition(high) > 0.0:
        high *= 4.0
        if high > 1e16:
            raise NotConverged(f"no speed found at the angle {t:g}; is it next to the pole?")
    root = brentq(condition, low, high, xtol=1e-17, rtol=1e-14, maxiter=500)
    speed = float(np.copysign(1.0, t) * sign * root)
    stable = 1 if contact_sum(size, sign * root) > 0 else -1
    return LinearRolling(speed, stable)


def linear_natural_curvature(
    position: npt.ArrayLike, angle: float, speed: float, *, side: Side = "lower"
) -> npt.NDArray[np.float64]:
    r"""Change of natural curvature of a rolling circle, :math:`(K_0 - 2\pi)/\Lambda`, in closed form.

    The periodic solution of :math:`-2\pi V K_1' + K_1 = f(\omega - \theta_I - \delta)`, (3.21) of the
    thesis with :math:`\Theta = \omega`.

    Parameters
    ----------
    position : array_like
        Material coordinate :math:`S - VT` from the contact, in ring lengths.
    angle : float
        Angle of the light from the vertical.
    speed : float
        Rolling speed, of either sign.
    side : {"lower", "upper"}, optional
        The lit half.

    Returns
    -------
    ndarray of the shape of `position`

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.rolling import linear_natural_curvature
    >>> linear_natural_curvature([0.0], 0.0, 0.0)
    array([1.])
    """
    s = finite_array("position", position)
    t, v = finite("angle", angle, unit="rad"), finite("speed", speed)
    one_of("side", side, ("lower", "upper"))
    phi = _TWO_PI * s - t - (np.pi if side == "upper" else 0.0)
    phi = np.mod(phi + np.pi / 2, _TWO_PI) - np.pi / 2  # in [-pi/2, 3 pi/2)
    lit = phi < np.pi / 2
    a = _TWO_PI * v
    if a == 0.0:
        return np.where(lit, np.cos(phi), 0.0)
    b = -a / (1.0 + a * a)
    wave = (np.cos(phi) - a * np.sin(phi)) / (1.0 + a * a)
    # C exp(phi/a) with C = -b/(2 sinh(pi/2a)) and D = C + b exp(-pi/2a), written without overflow
    d = -np.expm1(-np.pi / abs(a))
    if a > 0:
        tail = -b * np.exp((phi - np.pi / 2) / a) / d
        dark = -b * np.exp((phi - 3 * np.pi / 2) / a) / d
    else:
        tail = b * np.exp((phi + np.pi / 2) / a) / d
        dark = b * np.exp((phi - np.pi / 2) / a) / d
    return np.where(lit, wave + np.where(lit, tail, 0.0), np.where(lit, 0.0, dark))


@dataclass(frozen=True, eq=False)
class RollingWave:
    """A steadily rolling ring of the nonlinear model.

    Attributes
    ----------
    speed : float
        Ring lengths per relaxation time.
    contact_stiffness : float
        Second derivative of the height of the center of mass in the material coordinate of the
        contact; positive if gravity holds the contact.
    position : ndarray, shape (3 n,)
        Material coordinate from the contact at the nodes of the three arcs.
    angle, x, y, natural_curvature : ndarray, shape (3 n,)
        Tangent angle, coordinates relative to the contact, and natural curvature there.
    moment, force : float, ndarray of shape (2,)
        Moment at the contact (bending stiffness 1) and the internal force (components x, y).
    residual : float
        Largest residual of the collocated equations.

    Examples
    --------
    The ring closes after one full turn of its tangent:

    >>> import numpy as np
    >>> from lissome.references.rolling import rolling_wave
    >>> wave = rolling_wave(-0.5, 0.2, nodes=16)
    >>> gap = np.hypot(wave.x[-1] - wave.x[0], wave.y[-1] - wave.y[0])
    >>> print(f"{(wave.angle[-1] - wave.angle[0]) / (2 * np.pi):.9f} {gap:.9f}")
    1.000000000 0.000000000
    """

    speed: float
    contact_stiffness: float
    position: npt.NDArray[np.float64]
    angle: npt.NDArray[np.float64]
    x: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]
    natural_curvature: npt.NDArray[np.float64]
    moment: float
    force: npt.NDArray[np.float64]
    residual: float


def _chebyshev(n: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Nodes on [0, 1] in increasing order and the differentiation matrix."""
    k = np.arange(n)
    x = -np.cos(np.pi * k / (n - 1))
    weight = np.ones(n)
    weight[0] = weight[-1] = 2.0
    weight *= (-1.0) ** k
    difference = x[:, None] - x[None, :] + np.eye(n)
    matrix = np.outer(weight, 1.0 / weight) / difference
    matrix -= np.diag(matrix.sum(axis=1))
    return (x + 1.0) / 2.0, 2.0 * matrix


def rolling_wave(
    response: float,
    angle: float,
    *,
    side: Side = "upper",
    nodes: int = 40,
    start: RollingWave | None = None,
    tolerance: float = 1e-11,
) -> RollingWave:
    r"""Steady rolling of the nonlinear model, by Chebyshev collocation and Newton's method.

    Solves, on the arcs between the contact and the two terminators, whose places are unknown,

    .. math:: \Theta' = K_0 + M + F_x Y - F_y X,\quad X' = \cos\Theta,\quad Y' = \sin\Theta,\quad
       V K_0' = K_0 - 2\pi - \Lambda f,

    with closure, :math:`\int_0^1 X\,dS = 0` (center of mass above the contact) and periodic
    :math:`K_0`. No contact is refused: `contact_stiffness` tells whether gravity holds it.

    Parameters
    ----------
    response : float
        Dimensionless illumination :math:`\Lambda` with its sign: positive if light increases the
        curvature of a ring that is traversed counterclockwise.
    angle : float
        Angle of the light from the vertical, not 0, within :math:`(-\pi/2, \pi/2)`.
    side : {"upper", "lower"}, optional
        The lit half.
    nodes : int, optional
        Chebyshev nodes per arc.
    start : RollingWave, optional
        A neighboring solution with as many nodes; default the linear theory.
    tolerance : float, optional
        Largest Newton step relative to the unknowns at which the iteration ends.

    Returns
    -------
    RollingWave

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If Newton's method does not settle; continue from a neighboring solution.

    Examples
    --------
    >>> from lissome.references.rolling import linear_speed, rolling_wave
    >>> wave = rolling_wave(-0.01, 0.2)
    >>> abs(wave.speed / linear_speed(0.2).speed - 1) < 1e-3, wave.contact_stiffness > 0
    (True, True)
    """
    lam, t = finite("response", response), _check_angle(angle)
    one_of("side", side, ("lower", "upper"))
    n = integer_at_least("nodes", nodes, 8)
    if t == 0.0 or abs(t) == np.pi / 2:
        raise InvalidInput(
            f"argument `angle` is {t:g}; the ring does not roll there and the wave equation is "
            "singular: pass an angle between 0 and pi/2"
        )
    if lam == 0.0:
        raise InvalidInput("argument `response` is 0; without light the contact is not determined")
    xi, derivative = _chebyshev(n)
    delta = np.pi if side == "upper" else 0.0
    lit = (False, True, False) if side == "upper" else (True, False, True)
    terminators = (t + np.pi / 2, t + 3 * np.pi / 2)
    fields = 5 * n  # per arc: theta, x, y, integral of x, K0
    size = 3 * fields + 6  # and M, Fx, Fy, V, places of the terminators

    if start is not None:
        if start.position.shape != (3 * n,):
            raise InvalidInput(
                f"argument `start` has {start.position.size // 3} nodes per arc; pass nodes="
                f"{start.position.size // 3}"
            )
        unknown = np.zeros(size)
        integral = 0.0
        weights = np.linalg.inv(derivative[1:, 1:])
        for j in range(3):
            part = slice(j * n, (j + 1) * n)
            base = j * fields
            unknown[base : base + n] = start.angle[part]
            unknown[base + n : base + 2 * n] = start.x[part]
            unknown[base + 2 * n : base + 3 * n] = start.y[part]
            length = start.position[part][-1] - start.position[part][0]
            total = np.concatenate([[0.0], length * weights @ (start.x[part][1:])])
            unknown[base + 3 * n : base + 4 * n] = integral + total
            integral += total[-1]
            unknown[base + 4 * n : base + 5 * n] = start.natural_curvature[part]
        unknown[-6:] = [
            start.moment, *start.force, start.speed, start.position[n], start.position[2 * n]
        ]  # fmt: skip
    else:
        speed = linear_speed(t).speed
        ends = np.array([0.0, terminators[0], terminators[1], _TWO_PI]) / _TWO_PI
        unknown = np.zeros(size)
        for j in range(3):
            s = ends[j] + (ends[j + 1] - ends[j]) * xi
            base = j * fields
            unknown[base : base + n] = _TWO_PI * s
            unknown[base + n : base + 2 * n] = np.sin(_TWO_PI * s) / _TWO_PI
            unknown[base + 2 * n : base + 3 * n] = (1 - np.cos(_TWO_PI * s)) / _TWO_PI
            unknown[base + 3 * n : base + 4 * n] = (1 - np.cos(_TWO_PI * s)) / _TWO_PI**2
            unknown[base + 4 * n : base + 5 * n] = _TWO_PI + lam * linear_natural_curvature(
                s, t, speed, side=side
            )
        unknown[-6:] = [-lam / np.pi, 0.0, 0.0, speed, ends[1], ends[2]]

    history: list[float] = []
    for _ in range(60):
        value, matrix = _collocate(unknown, n, derivative, lam, t + delta, lit, terminators)
        step = np.linalg.solve(matrix, -value)
        # the speed must not change sign, and the terminators must stay in order
        scale = 1.0
        while abs(scale * step[-3]) > 0.5 * abs(unknown[-3]) or not (
            0.0 < unknown[-2] + scale * step[-2] < unknown[-1] + scale * step[-1] < 1.0
        ):
            scale *= 0.5
            if scale < 1e-6:
                break
        while scale > 1e-6:
            trial, _ = _collocate(
                unknown + scale * step, n, derivative, lam, t + delta, lit, terminators
            )
            if np.linalg.norm(trial) <= 2.0 * np.linalg.norm(value) + 1e-9:
                break
            scale *= 0.5
        unknown = unknown + scale * step
        change = float(np.max(np.abs(step[:-3])))
        change = max(change, abs(step[-3]) / abs(unknown[-3]) * min(1.0, abs(lam)))
        history.append(change)
        if scale == 1.0 and change < tolerance:
            break
        if scale == 1.0 and len(history) > 6 and change < 1e-8 and change > 0.3 * history[-2]:
            break  # the round-off floor of the collocation matrix
    else:
        raise NotConverged(
            f"no rolling wave found for response {lam:g} at angle {t:g} ({side} half lit): last "
            f"Newton step {history[-1]:.1e}; continue from a neighboring wave with `start`",
            history=history,
        )
    value, _ = _collocate(unknown, n, derivative, lam, t + delta, lit, terminators)
    arcs = unknown[:-6].reshape(3, 5, n)
    ends = np.array([0.0, unknown[-2], unknown[-1], 1.0])
    position = np.concatenate([ends[j] + (ends[j + 1] - ends[j]) * xi for j in range(3)])
    quadrature = _quadrature(n)
    height = float(sum((ends[j + 1] - ends[j]) * quadrature @ arcs[j, 2] for j in range(3)))
    moment, fx, fy, speed = (float(item) for item in unknown[-6:-2])
    curvature = float(arcs[0, 4, 0] + moment)
    return RollingWave(
        speed=speed,
        contact_stiffness=curvature * (1.0 - curvature * height),
        position=position,
        angle=arcs[:, 0].ravel(),
        x=arcs[:, 1].ravel(),
        y=arcs[:, 2].ravel(),
        natural_curvature=arcs[:, 4].ravel(),
        moment=moment,
        force=np.array([fx, fy]),
        residual=float(np.max(np.abs(value))),
    )


def _quadrature(n: int) -> npt.NDArray[np.float64]:
    """Clenshaw-Curtis weights on [0, 1] for n Chebyshev nodes."""
    k = np.arange(0, n, 2)
    moments = 1.0 / (1.0 - k.astype(float) ** 2)  # half of int_{-1}^{1} T_k
    x = np.cos(np.pi * np.arange(n) / (n - 1))
    values = np.cos(np.outer(np.arange(n), np.arccos(x)))
    full = np.zeros(n)
    full[::2] = moments
    return np.linalg.solve(values, full)


def _collocate(
    unknown: npt.NDArray[np.float64],
    n: int,
    derivative: npt.NDArray[np.float64],
    lam: float,
    light: float,
    lit: tuple[bool, bool, bool],
    terminators: tuple[float, float],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Residual and Jacobian of the collocated traveling wave."""
    size = unknown.size
    value, matrix = np.zeros(size), np.zeros((size, size))
    moment, fx, fy, speed, first, second = unknown[-6:]
    pm, px, py, pv, pa, pb = range(size - 6, size)
    lengths = (first, second - first, 1.0 - second)
    length_slopes = (((pa, 1.0),), ((pa, -1.0), (pb, 1.0)), ((pb, -1.0),))
    inner = np.arange(1, n)
    for j in range(3):
        base = 5 * n * j
        at = [slice(base + i * n, base + (i + 1) * n) for i in range(5)]
        index = [np.arange(base + i * n, base + (i + 1) * n) for i in range(5)]
        theta, x, y, z, k = (unknown[part] for part in at)
        length = lengths[j]
        c, s = np.cos(theta), np.sin(theta)
        f = np.cos(theta - light) if lit[j] else np.zeros(n)
        slope = -np.sin(theta - light) if lit[j] else np.zeros(n)
        right = (
            k + moment + fx * y - fy * x,
            c,
            s,
            x,
            k - _TWO_PI - lam * f,
        )
        for i in range(5):
            # rows of the first node hold the conditions; of K0 the last one, where its
            # boundary layer starts if the ring rolls forward
            keep = inner if i < 4 or speed < 0 else inner - 1
            rows = index[i][keep]
            factor = speed if i == 4 else 1.0
            moved = derivative @ unknown[at[i]]
            value[rows] = factor * moved[keep] - length * right[i][keep]
            matrix[np.ix_(rows, index[i])] += factor * derivative[keep]
            for column, sign in length_slopes[j]:
                matrix[rows, column] -= sign * right[i][keep]
            if i == 0:
                matrix[rows, index[4][keep]] -= length
                matrix[rows, index[2][keep]] -= length * fx
                matrix[rows, index[1][keep]] += length * fy
                matrix[rows, pm] -= length
                matrix[rows, px] -= length * y[keep]
                matrix[rows, py] += length * x[keep]
            elif i == 1:
                matrix[rows, index[0][keep]] += length * s[keep]
            elif i == 2:
                matrix[rows, index[0][keep]] -= length * c[keep]
            elif i == 3:
                matrix[rows, index[1][keep]] -= length
            else:
                matrix[rows, index[4][keep]] -= length
                matrix[rows, index[0][keep]] += length * lam * slope[keep]
                matrix[rows, pv] += moved[keep]
    # conditions: four at the contact, four after one turn, periodic K0, continuity, terminators
    spare = [5 * n * j + i * n for j in range(3) for i in range(4)]
    spare += [5 * n * j + (4 * n if speed < 0 else 5 * n - 1) for j in range(3)]
    spare += list(range(size - 6, size))
    conditions: list[tuple[list[tuple[int, float]], float]] = []
    last = 10 * n
    for i, turn in enumerate((_TWO_PI, 0.0, 0.0, 0.0)):
        conditions.append(([(i * n, 1.0)], 0.0))
        conditions.append(([(last + (i + 1) * n - 1, 1.0)], turn))
    conditions.append(([(4 * n, 1.0), (last + 5 * n - 1, -1.0)], 0.0))
    for j in range(2):
        base = 5 * n * j
        for i in range(5):
            end, begin = base + (i + 1) * n - 1, base + 5 * n + i * n
            conditions.append(([(begin, 1.0), (end, -1.0)], 0.0))
        conditions.append(([(base + n - 1, 1.0)], terminators[j]))
    for row, (terms, target) in zip(spare, conditions, strict=True):
        value[row] = sum(weight * unknown[column] for column, weight in terms) - target
        for column, weight in terms:
            matrix[row, column] += weight
    return value, matrix
