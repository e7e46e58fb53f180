r"""A clamped strip under light, by Legendre modes and integration along the path of equilibria.

The strip has unit length, ends clamped level at the distance `span`, and the energy

.. math:: \mathcal E = \tfrac12\int_0^1 (\theta' - K_0)^2\,dS, \qquad
   \partial_T K_0 = -K_0 + \Lambda\, g(X)\, f(\theta - \theta_I), \quad f(\varphi)=\max(0,\cos\varphi),

(3.12)-(3.15), (3.30), (3.32) of the thesis with :math:`K_r = 0`. With
:math:`\theta' = \sum_{n\ge1} a_n p_n(S)` in orthonormal Legendre polynomials, both clamps hold
whatever the :math:`a_n`, and the energy is half the squared distance between the vectors :math:`a` of
shape and :math:`k` of natural curvature: *equilibrium is the point of the constraint surface nearest
to the natural curvature*. The mean of :math:`K_0` drops out.

The coupled problem is integrated in the arclength of the path :math:`(k, a, T)` with DOP853: it runs
smoothly through the fold at which the strip snaps, where time has a maximum and the lowest
eigenvalue of the constrained second variation passes through zero. After a snap the natural
curvature is frozen and the shape descends by a projected gradient flow. Integrals of the light are
split at the terminators (:math:`|\theta-\theta_I| = \pi/2`).

Neither the discretization, nor the time integration, nor the descent is that of the library's
beams: this is an independent check of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.integrate import DOP853
from scipy.optimize import brentq

from .._validate import finite, positive
from ..errors import InvalidInput, NotConverged, Unstable
from ._strip_modes import Array, _Basis, _buckled, _integrated, _legendre, _Strip, _strip

__all__ = [
    "Snap",
    "SteadyLimit",
    "StripHistory",
    "absorption_moment",
    "dimensionless_illumination",
    "snap_time",
    "steady_limit",
    "strip_history",
    "strip_period",
]


def absorption_moment(thickness: float, depth: float) -> float:
    r"""First moment of light that decays with depth, in closed form.

    .. math:: \int_{-h/2}^{h/2} e^{-(h/2-z)/d} z\,dz
       = d\left(\tfrac h2 - d\right) + d\left(\tfrac h2 + d\right) e^{-h/d} ,

    the integral in (3.14) of the thesis.

    Parameters
    ----------
    thickness, depth : float
        Thickness h and penetration depth d, in the same unit of length.

    Returns
    -------
    float
        In the square of that unit; of order :math:`h^3/(12 d)` where light passes unabsorbed.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.photomechanical import absorption_moment
    >>> round(absorption_moment(15.0, 0.56), 6)
    3.8864
    """
    h, d = positive("thickness", thickness), positive("depth", depth)
    r = h / d
    if r < 0.05:
        # the closed form cancels: d^2 (r^3/12 - r^4/24 + r^5/80 - r^6/360 + ...)
        return d * d * r**3 * (1 / 12 - r * (1 / 24 - r * (1 / 80 - r * (1 / 360 - r / 2016))))
    return d * (h / 2 - d) + d * (h / 2 + d) * float(np.exp(-r))


def dimensionless_illumination(
    strain_per_irradiance: float,
    irradiance: float,
    thickness: float,
    depth: float,
    length: float,
) -> float:
    r"""Dimensionless illumination of a film, (3.14) of the thesis.

    .. math:: \Lambda = -\frac{12\,\lambda\alpha_1\,I_0\,l}{h^3}
       \int_{-h/2}^{h/2} e^{-(h/2-z)/d} z\,dz .

    Parameters
    ----------
    strain_per_irradiance : float
        :math:`\lambda\alpha_1`, m^2/W; negative for contraction.
    irradiance : float
        :math:`I_0`, W/m^2.
    thickness, depth, length : float
        h, d and l, m.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.photomechanical import dimensionless_illumination
    >>> round(dimensionless_illumination(-5.4e-5, 100, 15e-6, 0.56e-6, 15e-3), 6)
    1.119283
    """
    strain = finite("strain_per_irradiance", strain_per_irradiance, unit="m^2/W")
    light = finite("irradiance", irradiance, unit="W/m^2")
    span = positive("length", length, unit="m")
    moment = absorption_moment(thickness, depth)
    return -12.0 * strain * light * span * moment / thickness**3


@dataclass(frozen=True, eq=False)
class Snap:
    """A loss of stability and the jump that follows it.

    Attributes
    ----------
    time : float
        When it happens.
    kind : {"fold", "bifurcation"}
        Whether time has a maximum along the path of equilibria there.
    before, after : ndarray, shape (modes,)
        Modes of the shape on either side of the jump.
    direction : int
        +1 if the strip jumps up, -1 if down (sign of the change of the mean height).

    Examples
    --------
    Oblique light takes the buckled-up strip over a fold; it jumps down.

    >>> from lissome.references.photomechanical import strip_history
    >>> (snap,) = strip_history(10.0, 0.8, 0.95, until=1.1, modes=12).snaps
    >>> snap.kind, snap.direction
    ('fold', -1)
    """

    time: float
    kind: str
    before: Array
    after: Array
    direction: int


@dataclass(frozen=True, eq=False)
class StripHistory:
    """History of a strip under light.

    Attributes
    ----------
    times : ndarray, shape (steps,)
        Accepted steps; a snap contributes two rows with one time.
    shapes, curvatures : ndarray, shape (steps, modes)
        Legendre modes of the curvature and of the natural curvature.
    multipliers : ndarray, shape (steps, 2)
        Multipliers of span and level: minus the thrust along the strip, and the shear force.
    eigenvalues : ndarray, shape (steps,)
        Lowest eigenvalue of the constrained second variation in the metric
        :math:`\\int u^2 dS` of angle variations.
    snaps : tuple of Snap
        In order of time.
    steady : bool
        Whether the run ended because nothing moved any more.

    Examples
    --------
    Before the light has acted, the strip pushes with the thrust of Euler's elastica:

    >>> from lissome.references.photomechanical import strip_history
    >>> from lissome.references.elastica import buckled_strip
    >>> history = strip_history(1.0, 0.0, 0.95, until=0.1, modes=12)
    >>> print(f"{history.multipliers[0, 0]:.5f} {buckled_strip(0.95).thrust:.5f}")
    40.49397 40.49397
    """

    times: Array
    shapes: Array
    curvatures: Array
    multipliers: Array
    eigenvalues: Array
    snaps: tuple[Snap, ...]
    steady: bool
    _basis: _Basis = field(repr=False)

    def angle(self, position: npt.ArrayLike) -> Array:
        """Return the tangent angle at arc lengths `position` in [0, 1], shape (steps, len(position))."""
        s = np.atleast_1d(np.asarray(position, dtype=float))
        return self.shapes @ _integrated(s, self.shapes.shape[1]).T

    def natural_curvature(self, position: npt.ArrayLike) -> Array:
        """Return the natural curvature without its mean at arc lengths `position` in [0, 1].

        Its shape is (steps, len(position)).
        """
        s = np.atleast_1d(np.asarray(position, dtype=float))
        return self.curvatures @ _legendre(s, self.shapes.shape[1]).T

    def descriptors(self) -> tuple[Array, Array]:
        r"""Return :math:`\gamma` and :math:`\beta`, (3.31) of the thesis, shape (steps,) each."""
        basis = self._basis
        sine = basis.weights * np.sin(2 * np.pi * basis.nodes)
        beta = self.curvatures @ (basis.values.T @ sine)
        # gamma = int (cos(2 pi S) - 1)/(2 pi) sin(theta) dS: by parts, as Y(0) = Y(1) = 0
        kernel = basis.weights * (np.cos(2 * np.pi * basis.nodes) - 1.0) / (2 * np.pi)
        gamma = np.sin(self.shapes @ basis.integrals.T) @ kernel
        return gamma, beta


def _run(
    strip: _Strip,
    k: Array,
    a: Array,
    until: float,
    rtol: float,
    stop: Callable[[list[Snap]], bool] | None,
    still: float,
    perturbation: float,
    jump: bool = True,
) -> StripHistory:
    m = strip.basis.modes
    a, multipliers = strip.equilibrium(a, k)
    scale = 0.5 * float(np.linalg.norm(a))  # shallow strips turn on a smaller scale
    atol = np.concatenate([np.full(2 * m, scale), np.ones(3)]) * 0.01 * rtol
    time, steady = 0.0, False
    rows: list[tuple[float, Array, Array, Array, float]] = []
    snaps: list[Snap] = []

    def record(t: float, y: Array) -> float:
        low = float(strip.eigen(y[m : 2 * m], y[2 * m : 2 * m + 2])[0][0])
        rows.append((t, y[m : 2 * m].copy(), y[:m].copy(), y[2 * m : 2 * m + 2].copy(), low))
        return low

    while time < until and not steady and not (stop is not None and stop(snaps)):
        y = np.concatenate([k, a, multipliers, [time]])
        reference = np.zeros(2 * m + 3)
        reference[-1] = 1.0

        def path(_: float, y: Array, reference: Array = reference) -> Array:
            k, a, multipliers = y[:m], y[m : 2 * m], y[2 * m : 2 * m + 2]
            rate = strip.rate(a, k)
            # null vector of [KKT, -rate], bordered by the last direction: regular at the fold too
            matrix = np.zeros((m + 3, m + 3))
            matrix[: m + 2, : m + 2] = strip.kkt(a, multipliers)
            matrix[:m, -1] = -rate
            matrix[-1, :m] = reference[m : 2 * m] / scale**2
            matrix[-1, -1] = reference[-1]
            moved = np.linalg.solve(matrix, np.append(np.zeros(m + 2), 1.0))
            moved /= np.sqrt(moved[-1] ** 2 + moved[:m] @ moved[:m] / scale**2)
            tangent = np.concatenate([moved[-1] * rate, moved])
            return tangent

        if record(time, y) <= 0.0:
            raise Unstable("the start is not a stable equilibrium", state=(a, k))
        tangent = path(0.0, y)
        reference[:] = tangent
        solver = DOP853(path, 0.0, y, np.inf, rtol=rtol, atol=atol, max_step=0.25)
        while True:
            old = solver.y.copy()
            message = solver.step()
            if solver.status == "failed":
                raise NotConverged(
                    f"integration along the path failed at T = {old[-1]:g}: {message}"
                )
            new = solver.y
            reference[:] = path(solver.t, new)
            low = float(strip.eigen(new[m : 2 * m], new[2 * m : 2 * m + 2])[0][0])
            if low <= 0.0:
                dense = solver.dense_output()

                def lowest(x: float, dense: object = dense) -> float:
                    z = dense(x)  # type: ignore[operator]
                    return float(strip.eigen(z[m : 2 * m], z[2 * m : 2 * m + 2])[0][0])

                place = brentq(lowest, solver.t_old, solver.t, xtol=1e-13)
                y = dense(place)
                if y[-1] >= until:
                    y = dense(brentq(lambda x, d=dense: d(x)[-1] - until, solver.t_old, place))
                    record(until, y)
                    time = until
                    break
                kind = "fold" if abs(path(place, y)[-1]) < 1e-3 else "bifurcation"
                record(y[-1], y)
                if not jump:  # only the time is wanted
                    critical = y[m : 2 * m].copy()
                    snaps.append(Snap(float(y[-1]), kind, critical, critical, 0))
                    time = until
                    break
                snap = _jump(strip, y, kind, perturbation)
                snaps.append(snap)
                k, time = y[:m].copy(), float(y[-1])
                a, multipliers = strip.equilibrium(snap.after, k)
                break
            if new[-1] >= until:
                last = solver.dense_output()

                def late(x: float, last: object = last) -> float:
                    return float(last(x)[-1] - until)  # type: ignore[operator]

                record(until, last(brentq(late, solver.t_old, solver.t, xtol=1e-13)))
                time = until
                break
            record(new[-1], new)
            if np.linalg.norm(strip.rate(new[m : 2 * m], new[:m])) < still * scale:
                steady = True
                time = float(new[-1])
                break
    times, shapes, curvatures, forces, lows = zip(*rows, strict=True)
    return StripHistory(
        times=np.array(times),
        shapes=np.array(shapes),
        curvatures=np.array(curvatures),
        multipliers=np.array(forces),
        eigenvalues=np.array(lows),
        snaps=tuple(snaps),
        steady=steady,
        _basis=strip.basis,
    )


def _jump(strip: _Strip, y: Array, kind: str, perturbation: float) -> Snap:
    """Leave the critical state along its mode, on the side that descends furthest."""
    m = strip.basis.modes
    k, a = y[:m], y[m : 2 * m]
    _, mode = strip.eigen(a, y[2 * m : 2 * m + 2])
    mode = mode * (np.linalg.norm(a) / np.linalg.norm(mode))
    best: Array | None = None
    lowest = np.inf
    # a symmetric loss of stability is so flat that a small push may take very long: push harder
    for push in (perturbation, 4 * perturbation, 16 * perturbation):
        starts = [strip._restore(a + sign * push * mode) for sign in (1.0, -1.0)]
        starts.sort(key=lambda start: float((start - k) @ (start - k)))
        # at a fold the energy falls on one side only; at a symmetric loss of stability on both
        for start in starts:
            try:
                found, _ = strip.descend(start, k, leaving=a)
            except (NotConverged, Unstable):
                continue  # this side leads back to the critical state
            energy = float((found - k) @ (found - k))
            if energy < lowest:
                best, lowest = found, energy
            if kind == "fold":
                break
        if best is not None:
            break
    if best is None:
        raise NotConverged(f"no state found to snap to at T = {y[-1]:g}", state=(a, k))
    direction = int(np.sign(strip.height(best) - strip.height(a)))
    return Snap(float(y[-1]), kind, a.copy(), best, direction)


def strip_history(
    response: float,
    angle: float,
    span: float,
    *,
    until: float,
    up: bool = True,
    spot: tuple[float, float] | None = None,
    modes: int = 40,
    rtol: float = 1e-9,
    still: float = 1e-9,
    perturbation: float = 1e-2,
) -> StripHistory:
    r"""History of a clamped strip that is lit from the time 0 on.

    Parameters
    ----------
    response : float
        Dimensionless illumination :math:`\Lambda`, of either sign.
    angle : float
        Angle of the light from the vertical, in radians.
    span : float
        Distance of the clamps, in (0, 1).
    until : float
        Last time, in relaxation times.
    up : bool, optional
        Whether the strip starts buckled up.
    spot : (float, float), optional
        Center and width :math:`(\mu, W)` of a Gaussian beam
        :math:`\exp(-(X-\mu)^2/2W^2)`; default even light.
    modes : int, optional
        Legendre modes.
    rtol : float, optional
        Relative tolerance of DOP853 along the path.
    still : float, optional
        The run ends early where the rate of natural curvature is smaller than this.
    perturbation : float, optional
        First push along the critical mode after a loss of stability, relative to the shape.

    Returns
    -------
    StripHistory

    Raises
    ------
    InvalidInput
        If an argument is out of range.
    NotConverged
        If the integration or a descent fails.

    Examples
    --------
    >>> from lissome.references.photomechanical import strip_history
    >>> history = strip_history(10.0, 0.8, 0.95, until=1.2, modes=16)
    >>> len(history.snaps)
    1
    """
    strip = _strip(response, angle, span, modes, spot)
    return _run(
        strip,
        np.zeros(strip.basis.modes),
        _buckled(strip, bool(up)),
        positive("until", until),
        positive("rtol", rtol),
        None,
        positive("still", still),
        positive("perturbation", perturbation),
    )


def strip_period(
    response: float,
    angle: float,
    span: float,
    *,
    modes: int = 40,
    rtol: float = 1e-9,
    tolerance: float = 1e-8,
    up: bool = True,
    limit: float = 200.0,
) -> tuple[float, float] | None:
    r"""Period of steady flapping and the part of it that the strip spends bent up.

    Parameters
    ----------
    response : float
        Dimensionless illumination :math:`\Lambda`, of either sign.
    angle : float
        Angle of the light from the vertical, in radians.
    span : float
        Distance of the clamps, in (0, 1).
    modes : int, optional
        Legendre modes.
    rtol : float, optional
        Relative tolerance of the integration along the path.
    tolerance : float, optional
        Two successive periods agree to this when the run ends.
    up : bool, optional
        Whether the strip starts buckled up.
    limit : float, optional
        Longest time simulated.

    Returns
    -------
    (period, up_time) or None
        None if the strip comes to rest instead.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If no period settles within `limit`.

    Examples
    --------
    Weak light only bends the strip, until it rests:

    >>> from lissome.references.photomechanical import strip_period
    >>> strip_period(1.0, 0.5, 0.95, modes=8) is None
    True
    """
    strip = _strip(response, angle, span, modes, None)
    small = positive("tolerance", tolerance)

    def settled(snaps: list[Snap]) -> bool:
        t = [snap.time for snap in snaps]
        return len(t) >= 5 and all(
            abs((t[-1 - i] - t[-3 - i]) - (t[-2 - i] - t[-4 - i])) < small * (t[-1] - t[-3])
            for i in (0, 1)
        )

    history = _run(
        strip,
        np.zeros(strip.basis.modes),
        _buckled(strip, bool(up)),
        positive("limit", limit),
        positive("rtol", rtol),
        settled,
        1e-9,
        1e-2,
    )
    snaps = list(history.snaps)
    if settled(snaps):
        t = [snap.time for snap in snaps]
        up_time = t[-1] - t[-2] if snaps[-1].direction < 0 else t[-2] - t[-3]
        return t[-1] - t[-3], up_time
    if history.steady:
        return None
    raise NotConverged(f"no settled period within T = {limit:g}", history=history)


def snap_time(
    response: float,
    center: float,
    width: float,
    span: float,
    *,
    modes: int = 40,
    rtol: float = 1e-9,
    limit: float = 200.0,
) -> float:
    r"""Time at which a strip that is buckled up snaps under a Gaussian beam from straight above.

    Parameters
    ----------
    response : float
        Peak illumination :math:`\Lambda_{\max}`.
    center, width : float
        :math:`\mu` and W of (3.32) of the thesis.
    span : float
        Distance of the clamps, in (0, 1).
    modes : int, optional
        Legendre modes.
    rtol : float, optional
        Relative tolerance of the integration along the path.
    limit : float, optional
        Longest time simulated.

    Returns
    -------
    float
        ``inf`` if the strip comes to rest, or lasts to `limit`, without a snap.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    Strong light leaves no time to relax: twice the light, half the time.

    >>> from lissome.references.photomechanical import snap_time
    >>> slow, fast = (snap_time(peak, 0.4, 0.1, 0.95, modes=8) for peak in (1000.0, 2000.0))
    >>> print(f"{slow / fast:.2f}")
    2.00
    """
    strip = _strip(response, 0.0, span, modes, (center, width))
    history = _run(
        strip,
        np.zeros(strip.basis.modes),
        _buckled(strip, True),
        positive("limit", limit),
        positive("rtol", rtol),
        None,
        1e-9,
        1e-2,
        jump=False,
    )
    return history.snaps[0].time if history.snaps else np.inf


@dataclass(frozen=True, eq=False)
class SteadyLimit:
    """End of the stable steady states of a lit strip, as the light grows.

    Attributes
    ----------
    response : float
        Illumination there.
    kind : {"snap", "fold", "oscillation"}
        "snap": the lowest mechanical eigenvalue vanishes, so that the strip would snap at fixed
        natural curvature; "fold": the steady state merges with another one while it is
        mechanically stable; "oscillation": a pair of rates of the slow motion crosses the
        imaginary axis.
    eigenvalue : float
        Lowest mechanical eigenvalue there.
    rates : ndarray of complex, shape (modes,)
        Rates of small slow motions, in order of falling real part, just before the limit.
    shape : ndarray, shape (modes,)
        Legendre modes of the curvature.

    Examples
    --------
    At the end of the steady states the lowest mechanical eigenvalue vanishes, while the slow motions
    about them still decay:

    >>> from lissome.references.photomechanical import steady_limit
    >>> end = steady_limit(0.8, 0.95, modes=10)
    >>> end.kind, abs(end.eigenvalue) < 1e-9, bool(end.rates.real.max() < 0)
    ('snap', True, True)
    """

    response: float
    kind: str
    eigenvalue: float
    rates: npt.NDArray[np.complex128]
    shape: Array


def steady_limit(
    angle: float,
    span: float,
    *,
    sign: int = 1,
    up: bool = True,
    spot: tuple[float, float] | None = None,
    modes: int = 32,
    step: float = 0.15,
    limit: float = 100.0,
) -> SteadyLimit | None:
    r"""Follow the steady states :math:`K_0 = \Lambda g f(\theta - \theta_I)` until they lose stability.

    Under even light the strip flaps where the steady states of both branches have ended. Small slow
    motions :math:`\propto e^{\sigma T}` about a steady state are those of
    :math:`\dot k = -k + \Lambda\,(\partial\,\text{light}/\partial a)(\partial a/\partial k)\,k`.

    Parameters
    ----------
    angle : float
        Angle of the light from the vertical, in radians.
    span : float
        Distance of the clamps, in (0, 1).
    sign : {1, -1}, optional
        Sign of the response.
    up : bool, optional
        Branch that starts buckled up, or down.
    spot : (float, float), optional
        Center and width of a Gaussian beam.
    modes : int, optional
        Legendre modes.
    step : float, optional
        Largest step of pseudo-arclength continuation.
    limit : float, optional
        Largest illumination.

    Returns
    -------
    SteadyLimit or None
        None if the branch reaches `limit` stable.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If a corrector fails.

    Examples
    --------
    >>> from lissome.references.photomechanical import steady_limit
    >>> end = steady_limit(0.8, 0.95, modes=20)
    >>> end.kind
    'snap'
    """
    if sign not in (1, -1):
        raise InvalidInput(f"argument `sign` is {sign!r}; pass 1 or -1")
    strip = _strip(1.0, angle, span, modes, spot)
    m = strip.basis.modes
    size = positive("step", step)
    top = positive("limit", limit)
    a = _buckled(strip, bool(up))
    _, multipliers = strip.equilibrium(a, np.zeros(m))

    def system(z: Array) -> tuple[Array, Array]:
        a, multipliers, light = z[:m], z[m : m + 2], sign * z[-1]
        value, gradient = strip.constraints(a)
        lit = strip.lit(a)
        residual = np.concatenate([a - light * lit + gradient @ multipliers, value])
        matrix = np.zeros((m + 2, m + 3))
        matrix[:, : m + 2] = strip.kkt(a, multipliers)
        matrix[:m, :m] -= light * strip.lit_slope(a)
        matrix[:m, -1] = -sign * lit
        return residual, matrix

    def slow_rates(z: Array) -> npt.NDArray[np.complex128]:
        inverse = np.linalg.inv(strip.kkt(z[:m], z[m : m + 2]))[:m, :m]
        rates = np.linalg.eigvals(sign * z[-1] * strip.lit_slope(z[:m]) @ inverse - np.eye(m))
        return np.asarray(rates[np.argsort(-rates.real)], dtype=complex)

    weight = np.ones(m + 3)
    weight[m : m + 2] = 1e-2  # multipliers are large numbers

    def tangent_at(z: Array, old: Array) -> Array:
        _, matrix = system(z)
        right = np.zeros(m + 3)
        right[-1] = 1.0
        tangent = np.linalg.solve(np.vstack([matrix, weight * old]), right)
        return np.asarray(tangent / np.sqrt(tangent @ (weight * tangent)))

    def corrected(z: Array, tangent: Array, length: float) -> Array:
        guess = z + length * tangent
        for _ in range(12):
            residual, matrix = system(guess)
            gap = (guess - z) @ (weight * tangent) - length
            bordered = np.vstack([matrix, weight * tangent])
            change = np.linalg.solve(bordered, -np.append(residual, gap))
            guess = guess + change
            if np.max(np.abs(change[:m])) < 1e-10:
                return np.asarray(guess)
        raise NotConverged("corrector failed on the branch of steady states", state=guess)

    def lowest(z: Array) -> float:
        return float(strip.eigen(z[:m], z[m : m + 2])[0][0])

    z = np.concatenate([a, multipliers, [0.0]])
    tangent = tangent_at(z, np.append(np.zeros(m + 2), 1.0))
    while z[-1] < top:
        length = size
        while True:
            try:
                new = corrected(z, tangent, length)
                break
            except NotConverged:
                length *= 0.5
                if length < 1e-5:
                    raise
        ahead = tangent_at(new, tangent)
        before, direction = z, tangent

        def along(x: float, before: Array = before, direction: Array = direction) -> Array:
            return corrected(before, direction, x)

        def snap_test(x: float, along: Callable[[float], Array] = along) -> float:
            return lowest(along(x))

        def fold_test(
            x: float, along: Callable[[float], Array] = along, old: Array = direction
        ) -> float:
            return float(tangent_at(along(x), old)[-1])

        def slow_test(x: float, along: Callable[[float], Array] = along) -> float:
            return -float(slow_rates(along(x))[0].real)

        found: list[tuple[float, str]] = []
        if lowest(new) <= 0.0:
            found.append((brentq(snap_test, 0.0, length, xtol=1e-11), "snap"))
        if ahead[-1] <= 0.0:
            found.append((brentq(fold_test, 0.0, length, xtol=1e-11), "fold"))
        # slow rates may cross the axis and change their kind within the last step: look closely
        reach = min(found)[0] if found else length
        places = reach * (1.0 - np.geomspace(1.0, 1e-6, 25)) if found else np.array([0.0, reach])
        last = places[0]
        for place in places[1:]:
            if slow_test(place) < 0.0:
                found.append((brentq(slow_test, last, place, xtol=1e-10), "oscillation"))
                break
            last = place
        if found:
            place, kind = min(found)
            end = along(place)
            rates = slow_rates(along(max(0.0, place * (1 - 1e-4))))
            return SteadyLimit(float(end[-1]), kind, lowest(end), rates, end[:m].copy())
        z, tangent = new, ahead
    return None
