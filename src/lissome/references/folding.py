r"""The over-curved ring between the single and the triple circle, in the continuum.

Section, overcurvature and frame are those of :mod:`lissome.references.circles`; formulas are for length
:math:`2\pi`.

The branch from the single to the triple circle keeps two mirror planes and
the rotary reflection between them, and no internal force. The moment is then a constant vector, its
components in the frame obey :math:`m' = m\times\kappa`, and the frame precesses about it. The
ring closes if m has the period L/2 and the precession in half the length is :math:`\pi` (up to whole
turns); the tangent's mean vanishes by symmetry. For :math:`B_{out} = C` this is solved by elementary
functions (:func:`even_fold`), otherwise by Fourier collocation (:func:`folded_ring`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar

from .._validate import finite, finite_array, positive
from ..errors import InvalidInput, NotConverged
from .circles import RingSection, mode_threshold, second_variation_spectrum, stable_range

__all__ = [
    "FoldedRing",
    "crossing_overcurvature",
    "even_fold",
    "folded_ring",
    "opposite_distance",
]

Array = npt.NDArray[np.float64]
_TWO_PI = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class FoldedRing:
    r"""A ring on the branch from the single to the triple circle; its length is 1.

    Position and frame are given about the center, with the third axis along the constant moment.
    Arc length 0 is a crest, where a mirror plane cuts the ring.

    Attributes
    ----------
    section : RingSection
    overcurvature : float
        O.
    distance : float
        Least distance of two opposite points, over the length L.
    crest_distance : float
        Signed distance of the opposite crests, over L: the single circle has :math:`1/\pi`, it
        changes sign where the crests pass through each other, the triple circle has
        :math:`-1/(3\pi)`. Its size is `distance`.
    height : float
        Extent along the moment, over L.
    energy : float
        In units of (unit of stiffness)/L.
    moment : float
        Size of the internal moment, in units of (unit of stiffness)/L.
    largest_twist : float
        Largest :math:`|\kappa_3|`, times L.
    closure_error : float
        Distance between the ends of the rod, over L; the collocation does not impose it.
    coefficients : ndarray, shape (3, K)
        Moment :math:`m_1 = \sum a_j\cos(2js')`, j odd, :math:`m_2 = \sum b_j\cos(2js')`, j even,
        :math:`m_3 = \sum c_j\sin(2js')`, j odd, with :math:`s' = 2\pi s` and for length
        :math:`2\pi`.

    Examples
    --------
    For equal stiffnesses the shape is known in closed form (:func:`even_fold`); nothing but the rigid
    motions and the shift along the rod is neutral.

    >>> import numpy as np
    >>> from lissome.references.folding import even_fold, folded_ring
    >>> from lissome.references.circles import RingSection
    >>> section = RingSection(2.0, 1.0, 1.0)
    >>> ring = folded_ring(section, 2.1)
    >>> s = [0.0, 0.1, 0.2]
    >>> print(np.allclose(ring.points(s)[:, 2] ** 2, even_fold(section, 2.1, s)[:, 2] ** 2))
    True
    >>> print(ring.spectrum(count=5).round(9) + 0.0)
    [0.   0.   0.   0.   0.96]
    """

    section: RingSection
    overcurvature: float
    distance: float
    crest_distance: float
    height: float
    energy: float
    moment: float
    largest_twist: float
    closure_error: float
    coefficients: Array = field(repr=False)

    def strains(self, position: npt.ArrayLike) -> Array:
        """Strains times L at arc lengths `position` (unit length), shape (..., 3).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = _TWO_PI * finite_array("position", position)
        m = _moments(self.coefficients, s)
        return _TWO_PI * _strains(self.section, self.overcurvature, m)

    def frames(self, position: npt.ArrayLike) -> Array:
        """Directors as columns at arc lengths `position`, shape (..., 3, 3).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = _TWO_PI * finite_array("position", position)
        return _directors(self.section, self.coefficients, s)

    def points(self, position: npt.ArrayLike) -> Array:
        """Coordinates over L at arc lengths `position`, shape (..., 3).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        samples = 8 * self.coefficients.shape[1]
        grid = _TWO_PI * np.arange(samples) / samples
        tangent = _directors(self.section, self.coefficients, grid)[:, :, 2]
        hat = np.fft.rfft(tangent, axis=0) / samples
        order = np.arange(1, samples // 2)
        hat = hat[1 : samples // 2] / (1j * order)[:, None]
        wave = np.exp(1j * _TWO_PI * np.multiply.outer(s, order))
        return np.asarray(2.0 * np.real(wave @ hat) / _TWO_PI)

    def spectrum(self, *, count: int = 8) -> Array:
        """Lowest eigenvalues of the second variation, shape (`count`,); four of them are neutral motions."""
        modes = 4 * self.coefficients.shape[1]
        s = np.arange(4 * modes) / (4.0 * modes)
        return second_variation_spectrum(
            self.section,
            self.overcurvature,
            self.frames(s),
            self.strains(s) / _TWO_PI,
            modes=modes,
            count=count,
        )


def folded_ring(
    section: RingSection, overcurvature: float, *, tolerance: float = 1e-13
) -> FoldedRing:
    r"""Return the folded ring at an overcurvature between the two circles, by Fourier collocation.

    Parameters
    ----------
    section : RingSection
    overcurvature : float
        O strictly between the onset :math:`O_b` (single circle, mode 2) and the end :math:`O_d`
        (triple circle, mode 2).
    tolerance : float, optional
        The series is long enough when its last coefficients are smaller, relative to the largest,
        and the joint closes to ten times as much.

    Returns
    -------
    FoldedRing

    Raises
    ------
    InvalidInput
        If the overcurvature lies outside the branch.
    NotConverged
        If Newton's method fails, or 256 coefficients do not resolve the shape.

    Notes
    -----
    The collocation assumes symmetry and zero force. That an equilibrium without force exists is then
    a result: the rod closes (`closure_error`), although no equation asks for it.

    Examples
    --------
    >>> from lissome.references.folding import folded_ring
    >>> from lissome.references.circles import RingSection
    >>> slinky = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    >>> round(folded_ring(slinky, 1.5).distance, 6)
    0.23202
    """
    o = finite("overcurvature", overcurvature)
    low, high = mode_threshold(section, 1, 2), mode_threshold(section, 3, 2)
    first, last = min(low, high), max(low, high)
    if not first < o < last:
        raise InvalidInput(
            f"argument `overcurvature` is {o:g}; the folded ring exists between {first:.6f} and "
            f"{last:.6f}: pass a number in between"
        )
    limit = positive("tolerance", tolerance)
    m = _fold(section, o, 8, None)
    while True:
        last = float(np.max(np.abs(m[:, -2:])) / np.max(np.abs(m)))
        ring = _folded(section, o, m)
        # the precession may need more terms than the moment: the gap at the joint shows it
        if last <= limit and ring.closure_error <= 10.0 * limit:
            return ring
        if m.shape[1] >= 256:
            raise NotConverged(
                f"256 coefficients do not resolve the folded ring at overcurvature {o:g} (last "
                f"{last:.1e}, gap {ring.closure_error:.1e}); pass a larger tolerance",
                state=m,
            )
        m = _fold(section, o, 2 * m.shape[1], m)


def _tables(terms: int) -> tuple[Any, ...]:
    """Values and slopes of the three bases at the midpoints of a quarter period (0, pi/4)."""
    s = (np.arange(terms) + 0.5) * np.pi / (4.0 * terms)
    odd, even = 2.0 * (2.0 * np.arange(terms) + 1.0), 4.0 * np.arange(terms)
    c_odd, s_odd = np.cos(np.outer(s, odd)), np.sin(np.outer(s, odd))
    c_even, s_even = np.cos(np.outer(s, even)), np.sin(np.outer(s, even))
    return c_odd, -odd * s_odd, c_even, -even * s_even, s_odd, odd * c_odd


def _fold(section: RingSection, o: float, terms: int, start: Array | None) -> Array:
    """Coefficients of the moment at overcurvature `o`."""
    if start is not None:
        m = np.zeros((3, terms))
        m[:, : start.shape[1]] = start
        return _newton(section, o, None, m)[0]
    # from equal stiffnesses, where it is elementary, to those asked for, at a fixed latitude
    low, high = mode_threshold(section, 1, 2), mode_threshold(section, 3, 2)
    latitude = float(np.arcsin(np.clip((2.0 * o - low - high) / (high - low), -1.0, 1.0)))
    p, c = section.out_of_plane, section.torsion
    mean = float(np.sqrt(p * c))
    m = np.zeros((3, terms))
    m[0, 0] = m[2, 0] = mean * np.cos(latitude)
    m[1, 0] = mean * np.sin(latitude)
    guess = 2.0 + np.sin(latitude) * (1.0 - mean / section.in_plane)
    steps = 1 + int(np.ceil(2.0 * abs(np.log(p / c))))
    for step in range(steps + 1):
        part = step / steps
        stage = RingSection(section.in_plane, mean * (p / mean) ** part, mean * (c / mean) ** part)
        m, guess = _newton(stage, guess, latitude, m)
    # along the branch to the overcurvature asked for
    target, tries = o, 0
    while abs(guess - o) > 0.0:
        try:
            m, guess = _newton(section, target, None, m)[0], target
            target = o
        except NotConverged:
            target, tries = 0.5 * (guess + target), tries + 1
            if tries > 30:
                raise
    return m


def _newton(
    section: RingSection, o: float, latitude: float | None, m: Array
) -> tuple[Array, float]:
    """Newton's method at a given latitude of the crest's moment, or at a given overcurvature."""
    terms = m.shape[1]
    v1, d1, v2, d2, v3, d3 = _tables(terms)
    p, b, c = section.out_of_plane, section.in_plane, section.torsion
    free = latitude is not None
    size = 3 * terms + free
    # sine projection of the second equation: one row fewer, since |m| is conserved
    s = (np.arange(terms) + 0.5) * np.pi / (4.0 * terms)
    sines = np.sin(np.outer(4.0 * np.arange(1, terms), s)) / terms
    m = m.copy()
    zero = np.zeros_like(v1)
    history = []
    for _ in range(30):
        m1, m2, m3 = v1 @ m[0], v2 @ m[1], v3 @ m[2]
        k1, k2, k3 = m1 / p, o + m2 / b, m3 / c
        # m' = m x kappa
        r1 = d1 @ m[0] - (m2 * k3 - m3 * k2)
        r2 = d2 @ m[1] - (m3 * k1 - m1 * k3)
        r3 = d3 @ m[2] - (m1 * k2 - m2 * k1)
        j1 = np.hstack([d1, -(k3 - m3 / b)[:, None] * v2, -(m2 / c - k2)[:, None] * v3])
        j2 = np.hstack([-(m3 / p - k3)[:, None] * v1, d2, -(k1 - m1 / c)[:, None] * v3])
        j3 = np.hstack([-(k2 - m2 / p)[:, None] * v1, -(m1 / b - k1)[:, None] * v2, d3])
        square = m1 * m1 + m3 * m3
        total = np.sqrt(square + m2 * m2)
        weight = m1 * m1 / p + m3 * m3 / c
        rate = total * weight / square  # precession about the moment
        g1 = rate * (m1 / total**2 + 2.0 * m1 / p / weight - 2.0 * m1 / square)
        g2 = rate * m2 / total**2
        g3 = rate * (m3 / total**2 + 2.0 * m3 / c / weight - 2.0 * m3 / square)
        matrix = np.zeros((size, size))
        residual = np.zeros(size)
        residual[:terms], matrix[:terms, : 3 * terms] = r1, j1
        rows = slice(terms, 2 * terms - 1)
        residual[rows], matrix[rows, : 3 * terms] = sines @ r2, sines @ j2
        rows = slice(2 * terms - 1, 3 * terms - 1)
        residual[rows], matrix[rows, : 3 * terms] = r3, j3
        residual[3 * terms - 1] = rate.mean() - 1.0
        matrix[3 * terms - 1, : 3 * terms] = np.concatenate([g1 @ v1, g2 @ v2, g3 @ v3]) / terms
        if latitude is not None:
            matrix[:terms, -1], matrix[2 * terms - 1 : 3 * terms - 1, -1] = m3, -m1
            residual[-1] = m[1].sum() * np.cos(latitude) - m[0].sum() * np.sin(latitude)
            matrix[-1, : 3 * terms] = np.concatenate(
                [np.full(terms, -np.sin(latitude)), np.full(terms, np.cos(latitude)), zero[0]]
            )
        change = np.linalg.solve(matrix, -residual)
        step = change[: 3 * terms].reshape(3, terms)
        scale = float(np.max(np.abs(m)))
        history.append(float(np.max(np.abs(step))) / scale)
        if not np.isfinite(history[-1]) or history[-1] > 10.0:
            break
        damping = 0.5 / max(0.5, history[-1])
        m = m + damping * step
        if free:
            o += damping * float(change[-1])
        small = history[-1] < 1e-9 and len(history) > 1 and history[-1] > 0.1 * history[-2]
        if small or history[-1] < 1e-15:
            return m, o
    raise NotConverged(
        f"collocation of the folded ring did not converge at overcurvature {o:g}", history=history
    )


def _moments(coefficients: Array, s: Array) -> Array:
    terms = coefficients.shape[1]
    odd, even = 2.0 * (2.0 * np.arange(terms) + 1.0), 4.0 * np.arange(terms)
    wave = np.multiply.outer(s, odd)
    return np.stack(
        [
            np.cos(wave) @ coefficients[0],
            np.cos(np.multiply.outer(s, even)) @ coefficients[1],
            np.sin(wave) @ coefficients[2],
        ],
        axis=-1,
    )


def _strains(section: RingSection, o: float, m: Array) -> Array:
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    return np.asarray(m / stiffness + np.array([0.0, o, 0.0]))


def _precession(section: RingSection, coefficients: Array, s: Array) -> Array:
    """Angle of d2 about the moment; its rate is a cosine series in multiples of 4 s."""
    samples = 4 * coefficients.shape[1]
    grid = 0.5 * np.pi * np.arange(samples) / samples
    m = _moments(coefficients, grid)
    square = m[:, 0] ** 2 + m[:, 2] ** 2
    rate = np.sqrt(square + m[:, 1] ** 2)
    rate *= (m[:, 0] ** 2 / section.out_of_plane + m[:, 2] ** 2 / section.torsion) / square
    series = np.fft.rfft(rate).real / samples
    order = 4.0 * np.arange(1, samples // 2)
    wave = np.sin(np.multiply.outer(s, order))
    return np.asarray(series[0] * s + wave @ (2.0 * series[1 : samples // 2] / order))


def _directors(section: RingSection, coefficients: Array, s: Array) -> Array:
    m = _moments(coefficients, s)
    z = m / np.linalg.norm(m, axis=-1, keepdims=True)
    angle = _precession(section, coefficients, s)
    level = np.hypot(z[..., 0], z[..., 2])
    away = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    second = level[..., None] * away + z[..., 1, None] * up
    rising = level[..., None] * up - z[..., 1, None] * away
    side = np.cross(second, rising)
    a, b = (z[..., 0] / level)[..., None], (z[..., 2] / level)[..., None]
    return np.stack([a * rising + b * side, second, b * rising - a * side], axis=-1)


def _folded(section: RingSection, o: float, m: Array) -> FoldedRing:
    samples = 16 * m.shape[1]
    s = _TWO_PI * np.arange(samples) / samples
    moments = _moments(m, s)
    strains = _strains(section, o, moments)
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    # a ring of length 1 instead of 2 pi: energies, moments and strains grow by 2 pi
    density = 0.5 * np.sum(moments**2 / stiffness, axis=1)
    tangent = _directors(section, m, s)[:, :, 2]
    ring = FoldedRing(
        section=section,
        overcurvature=o,
        distance=0.0,
        crest_distance=0.0,
        height=0.0,
        energy=float(density.mean()) * _TWO_PI**2,
        moment=float(np.linalg.norm(moments[0])) * _TWO_PI,
        largest_twist=float(np.max(np.abs(strains[:, 2]))) * _TWO_PI,
        closure_error=float(np.linalg.norm(tangent.mean(axis=0))),
        coefficients=m,
    )
    found = s / _TWO_PI
    points = ring.points(found)

    def apart(place: float) -> float:
        pair = ring.points(np.array([place, place + 0.5]))
        return float(np.linalg.norm(pair[1] - pair[0]))

    gap = np.linalg.norm(np.roll(points, samples // 2, axis=0) - points, axis=1)
    near = found[int(np.argmin(gap))]
    best = minimize_scalar(
        apart, bounds=(near - 2.0 / samples, near + 2.0 / samples), method="bounded",
        options={"xatol": 1e-9},
    )  # fmt: skip
    # the crest lies on the first axis: d2 starts in the plane of that axis and the moment
    signed = -2.0 * float(ring.points(0.0)[0])
    return FoldedRing(
        **{
            **{name: getattr(ring, name) for name in ring.__dataclass_fields__},
            "distance": min(float(best.fun), abs(signed)),
            "crest_distance": signed,
            "height": float(np.ptp(points[:, 2])),
        }
    )


def even_fold(section: RingSection, overcurvature: float, position: npt.ArrayLike) -> Array:
    r"""Folded ring for equal stiffnesses in twist and in bending out of the plane, in closed form.

    For :math:`B_{out} = C` the moment circles in the frame evenly on a latitude :math:`\arcsin\sigma`
    and the frame precesses evenly: the plan of the ring is a hypotrochoid. For length :math:`2\pi`

    .. math:: x + iy = \tfrac{1 + \sigma}{6}\,e^{3is} - \tfrac{1 - \sigma}{2}\,e^{-is}, \quad
       z = -\tfrac12\sqrt{1 - \sigma^2}\,\cos 2s, \qquad
       \sigma = \frac{O - 2}{1 - B_{out}/B_{in}} ,

    from the single circle (:math:`\sigma = -1`) to the triple one (:math:`\sigma = 1`). Opposite crests
    are :math:`L(1 - 2\sigma)/(3\pi)` apart: they meet at :math:`\sigma = \tfrac12`.

    Parameters
    ----------
    section : RingSection
        With ``out_of_plane == torsion``, different from ``in_plane``.
    overcurvature : float
        O, such that sigma lies in [-1, 1].
    position : array_like
        Arc lengths, for length 1.

    Returns
    -------
    ndarray, shape (..., 3)
        Coordinates over L.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.folding import even_fold
    >>> from lissome.references.circles import RingSection
    >>> even_fold(RingSection(2.0, 1.0, 1.0), 2.25, [0.0, 0.5])[:, :2].round(12) + 0.0
    array([[0., 0.],
           [0., 0.]])
    """
    p, c, b = section.out_of_plane, section.torsion, section.in_plane
    if p != c or p == b:
        raise InvalidInput(
            f"argument `section` has out_of_plane {p:g}, torsion {c:g} and in_plane {b:g}; the closed "
            "form needs the first two equal and the third different: use folded_ring"
        )
    sigma = (finite("overcurvature", overcurvature) - 2.0) / (1.0 - p / b)
    if abs(sigma) > 1.0:
        raise InvalidInput(
            f"argument `overcurvature` is {overcurvature:g}; it must lie between {1.0 + p / b:g} and "
            f"{3.0 - p / b:g}, where the ring is folded"
        )
    s = _TWO_PI * finite_array("position", position)
    plan = (1.0 + sigma) / 6.0 * np.exp(3j * s) - (1.0 - sigma) / 2.0 * np.exp(-1j * s)
    rise = -0.5 * np.sqrt(1.0 - sigma * sigma) * np.cos(2.0 * s)
    return np.stack([plan.real, plan.imag, rise], axis=-1) / _TWO_PI


def opposite_distance(section: RingSection, overcurvature: npt.ArrayLike) -> Array:
    r"""Least distance D of opposite points of the stable ring (Fig. 4.5b of the thesis).

    :math:`L/\pi` for the single circle, the folded ring between the two circles, :math:`L/(3\pi)`
    for the triple circle.

    Parameters
    ----------
    section : RingSection
    overcurvature : array_like
        From the lower end of stability of the single circle to the upper end of the triple one.

    Returns
    -------
    ndarray
        D/L, of the shape of `overcurvature`.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.folding import opposite_distance
    >>> from lissome.references.circles import RingSection
    >>> slinky = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    >>> opposite_distance(slinky, [1.0, 2.0, 3.0]).round(6)
    array([0.31831 , 0.103667, 0.106103])
    """
    values = finite_array("overcurvature", overcurvature)
    (lowest, onset), (end, highest) = stable_range(section, 1), stable_range(section, 3)
    if onset >= end:
        raise InvalidInput(
            "argument `section` is as stiff out of the plane as in it, or stiffer: the single circle "
            f"is stable up to {onset:g} and the triple one from {end:g}, and no stable ring is folded"
        )
    outside = (values < lowest) | (values > highest)
    if np.any(outside):
        raise InvalidInput(
            f"argument `overcurvature` holds {values[outside].flat[0]:g}; the circles are stable "
            f"from {lowest:g} (single) to {highest:g} (triple)"
        )
    result = np.where(values <= onset, 1.0 / np.pi, 1.0 / (3.0 * np.pi))
    for index in np.argwhere((values > onset) & (values < end)):
        place = tuple(index)
        result[place] = folded_ring(section, float(values[place])).distance
    return result


def crossing_overcurvature(section: RingSection) -> float:
    """Overcurvature at which the opposite crests of the folded ring meet, so that D = 0.

    Nothing keeps them apart in the model: beyond it they have passed through each other.

    Parameters
    ----------
    section : RingSection

    Returns
    -------
    float

    Examples
    --------
    >>> from lissome.references.folding import crossing_overcurvature
    >>> from lissome.references.circles import RingSection
    >>> round(crossing_overcurvature(RingSection(2.0, 1.0, 1.0)), 9)
    2.25
    """
    low, high = mode_threshold(section, 1, 2), mode_threshold(section, 3, 2)
    inset = 0.01 * (high - low)
    return float(
        brentq(
            lambda o: folded_ring(section, o).crest_distance, low + inset, high - inset, xtol=1e-12
        )
    )
