r"""Over- and under-curved rings: the exact stability of k-fold circles.

An inextensible, unshearable rod of length L closes to a ring. In its frame (:math:`d_1` towards
the center, :math:`d_2` along the axis of the flat circle, :math:`d_3` tangent) its energy is

.. math:: \tfrac12\int \left[B_{out}\,\kappa_1^2 + B_{in}\,(\kappa_2 - \kappa_0)^2
   + C\,\kappa_3^2\right] ds, \qquad O = \frac{\kappa_0 L}{2\pi} .

Formulas below are for :math:`L = 2\pi`, where the k-fold circle has the curvature k.

**Circles.** All of them are equilibria without internal force: a force would be constant, and
:math:`M' + t \times N = 0` with a constant moment :math:`M = B_{in}(k - O)\,d_2` leaves it parallel
to a turning tangent. An infinitesimal rotation :math:`\omega` (material components) changes the strains by
:math:`u = \omega' + \kappa\times\omega` and, to second order, by :math:`-\tfrac12\,\omega\times u`. Twice
the second variation is

.. math:: \int \left[u\cdot D u - m\cdot(\omega\times u)\right] ds, \qquad
   \oint \omega\times t\; ds = 0 ,

where closure needs no multiplier at second order because the force vanishes. With
:math:`\mu = B_{in}(O - k)`, in-plane rotations :math:`\omega_2` decouple and cost
:math:`B_{in}\int\omega_2'^2 \ge 0`: no circle buckles in its plane. Out of it,
:math:`\omega_1 = a\cos ns`, :math:`\omega_3 = b\sin ns` gives

.. math:: \begin{pmatrix} n^2B_{out} + k^2C + k\mu & -n\,[k(B_{out} + C) + \mu] \\
   \cdot & k^2B_{out} + n^2C + k\mu \end{pmatrix}, \qquad
   \det = (n^2 - k^2)\left[B_{out}C\,(n^2 - k^2) - k\mu\,(B_{out} + C) - \mu^2\right] .

n = k are rigid rotations. A mode n becomes neutral at

.. math:: \mu_n = -\tfrac k2(B_{out} + C)
   + \sqrt{\tfrac{k^2}{4}(B_{out} + C)^2 + B_{out}C\,(n^2 - k^2)} ,

and the k-fold circle is stable between the modes :math:`k - 1` and :math:`k + 1`:
:math:`k + \mu_{k-1}/B_{in} < O < k + \mu_{k+1}/B_{in}`. For k = 1 the lower mode is n = 0, in which
closure forbids a: there :math:`\mu_0 = -B_{out}`, so that :math:`O > 1 - B_{out}/B_{in}`.

**On a mesh.** The discrete rod of N equal segments with the strain :math:`2\,\mathrm{vec}\,q` of the
hinge rotations q has the same matrix, with :math:`\tan(\pi n/N)` and :math:`\tan(\pi k/N)` in place
of n and k, and :math:`\mu` for :math:`B_{in}\,(\pi O/[N\sin(\pi k/N)] - 1)\tan(\pi k/N)`: its
thresholds are known exactly as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh, null_space

from .._validate import finite, finite_array, integer_at_least, one_of, positive
from ..errors import InvalidInput

__all__ = [
    "RingSection",
    "circle_spectrum",
    "mode_threshold",
    "rectangle_torsion_constant",
    "second_variation_spectrum",
    "stable_range",
    "turned_circle",
]

Array = npt.NDArray[np.float64]
_TWO_PI = 2.0 * np.pi


def rectangle_torsion_constant(aspect: float) -> float:
    r"""Torsion constant of a rectangle over (long side) times (short side) cubed.

    .. math:: \frac{J}{a b^3} = \frac13\left(1 - \frac{192}{\pi^5}\frac ba
       \sum_{n\ \mathrm{odd}} \frac{\tanh(n\pi a/2b)}{n^5}\right)

    Parameters
    ----------
    aspect : float
        a/b, at least 1.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import rectangle_torsion_constant
    >>> round(rectangle_torsion_constant(2.5), 6), round(rectangle_torsion_constant(1.0), 6)
    (0.249365, 0.140577)
    """
    ratio = positive("aspect", aspect)
    if ratio < 1.0:
        raise InvalidInput(f"argument `aspect` is {ratio:g}; pass the long side over the short one")
    n = np.arange(1, 2001, 2, dtype=float)
    total = np.sum((np.tanh(0.5 * n * np.pi * ratio) / n**5)[::-1])
    return float((1.0 - 192.0 / (np.pi**5 * ratio) * total) / 3.0)


@dataclass(frozen=True)
class RingSection:
    """Stiffnesses of the rod, in any common unit.

    Attributes
    ----------
    in_plane : float
        Bending within the plane of the flat circle.
    out_of_plane : float
        Bending out of it.
    torsion : float
        Twisting.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import RingSection
    >>> section = RingSection.rectangle(5.0, 2.0, 0.41)
    >>> round(section.in_plane / section.out_of_plane, 6)
    6.25
    """

    in_plane: float
    out_of_plane: float
    torsion: float

    def __post_init__(self) -> None:
        for name in ("in_plane", "out_of_plane", "torsion"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))

    @classmethod
    def rectangle(
        cls,
        width: float,
        thickness: float,
        poisson_ratio: float,
        *,
        radial: Literal["width", "thickness"] = "width",
        torsion_constant: float | None = None,
    ) -> RingSection:
        r"""Return the section of a rectangular bar with unit Young's modulus.

        Parameters
        ----------
        width, thickness : float
            Long and short side.
        poisson_ratio : float
            In (-1, 0.5].
        radial : {'width', 'thickness'}, optional
            The side that points to the center of the ring.
        torsion_constant : float, optional
            J over width times thickness cubed, in the torsional stiffness
            :math:`J/[2(1+\nu)]`; by default the exact value for the rectangle.

        Returns
        -------
        RingSection

        Raises
        ------
        InvalidInput
            If an argument is out of its range.
        """
        w, t = positive("width", width), positive("thickness", thickness)
        if t > w:
            raise InvalidInput(
                f"argument `thickness` is {t:g}; it must not exceed the width {w:g}: choose with "
                "`radial` which side points to the center"
            )
        nu = finite("poisson_ratio", poisson_ratio)
        if not -1.0 < nu <= 0.5:
            raise InvalidInput(f"argument `poisson_ratio` is {nu:g}; it must lie in (-1, 0.5]")
        if torsion_constant is None:
            beta = rectangle_torsion_constant(w / t)
        else:
            beta = positive("torsion_constant", torsion_constant)
        stiff, soft = w**3 * t / 12.0, w * t**3 / 12.0
        if one_of("radial", radial, ("width", "thickness")) == "thickness":
            stiff, soft = soft, stiff
        return cls(stiff, soft, beta * w * t**3 / (2.0 * (1.0 + nu)))


# -- circles ---------------------------------------------------------------------------------------


def mode_threshold(
    section: RingSection, turns: int, mode: int, *, segments: int | None = None
) -> float:
    r"""Overcurvature at which a mode of the k-fold circle is neutral, :math:`k + \mu_n/B_{in}`.

    On a mesh of N segments it is

    .. math:: \frac{N\sin(\pi k/N)}{\pi}\left(1 + \frac{M}{B_{in}}\right), \qquad
       M^2 + M(B_{out} + C) = B_{out}C\left[\frac{\tan^2(\pi n/N)}{\tan^2(\pi k/N)} - 1\right] .

    Parameters
    ----------
    section : RingSection
    turns : int
        k.
    mode : int
        n, number of waves in the length of the ring; not k, which is a rigid rotation.
    segments : int, optional
        N, more than twice as many as turns and as waves; by default the continuum.

    Returns
    -------
    float
        Modes n > k are unstable above it, modes n < k below it.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import RingSection, mode_threshold
    >>> slinky = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    >>> round(mode_threshold(slinky, 1, 2), 6), round(mode_threshold(slinky, 1, 2, segments=100), 6)
    (1.16692, 1.167058)
    """
    k = integer_at_least("turns", turns, 1)
    n = integer_at_least("mode", mode, 0)
    if n == k:
        raise InvalidInput(
            f"argument `mode` is {n}: with as many waves as turns it is a rigid rotation"
        )
    p, c = section.out_of_plane, section.torsion
    if segments is None:
        size, ratio = float(k), n / k
    else:
        count = integer_at_least("segments", segments, 3)
        if count <= 2 * max(k, n):
            raise InvalidInput(
                f"argument `segments` is {count}; {k} turns and {n} waves need more than "
                f"{2 * max(k, n)}"
            )
        step = np.pi / count
        size, ratio = float(np.sin(k * step) / step), float(np.tan(n * step) / np.tan(k * step))
    if n == 0:
        return size * (1.0 - p / section.in_plane)
    half = 0.5 * (p + c)
    excess = p * c * (ratio * ratio - 1.0)
    # excess / (half + sqrt(...)): the root without cancellation
    stress = excess / (half + np.sqrt(half * half + excess))
    return float(size * (1.0 + stress / section.in_plane))


def stable_range(section: RingSection, turns: int) -> tuple[float, float]:
    """Overcurvatures between which the k-fold circle is stable.

    Parameters
    ----------
    section : RingSection
    turns : int
        k.

    Returns
    -------
    (low, high) : tuple of float
        It loses stability below by the mode k - 1, above by the mode k + 1.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import RingSection, stable_range
    >>> slinky = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    >>> tuple(round(value, 6) for value in stable_range(slinky, 3))
    (2.833233, 3.166881)
    """
    k = integer_at_least("turns", turns, 1)
    return mode_threshold(section, k, k - 1), mode_threshold(section, k, k + 1)


def turned_circle(section: RingSection, overcurvature: float) -> float:
    r"""Angle by which the section of the single circle has turned about the tangent.

    Below :math:`1 - B_{out}/B_{in}` the flat circle keeps its shape, but its section turns evenly by
    an angle with

    .. math:: \cos\varphi = \frac{B_{in}\,O}{B_{in} - B_{out}} ,

    until, at minus that bound, it is everted.

    Parameters
    ----------
    section : RingSection
    overcurvature : float
        O.

    Returns
    -------
    float
        The angle in [0, pi], in radians; for :math:`B_{out} \ge B_{in}` it jumps from 0 to pi (at the
        overcurvature where the energies are equal, O = 0).

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import RingSection, turned_circle
    >>> soft = RingSection(4.0, 1.0, 1.0)
    >>> round(turned_circle(soft, 0.375), 6)
    1.047198
    """
    o = finite("overcurvature", overcurvature)
    gap = section.in_plane - section.out_of_plane
    if gap <= 0.0:
        return 0.0 if o >= 0.0 else float(np.pi)
    return float(np.arccos(np.clip(section.in_plane * o / gap, -1.0, 1.0)))


def circle_spectrum(
    section: RingSection, turns: int, overcurvature: float, *, modes: int = 12, count: int = 6
) -> Array:
    r"""Lowest eigenvalues of the second variation of a k-fold circle, by a Galerkin method.

    Nothing is assumed about the modes: all three rotations are expanded in Fourier series, and
    closure is imposed as three linear constraints. See :func:`second_variation_spectrum`.

    Parameters
    ----------
    section : RingSection
    turns : int
    overcurvature : float
    modes : int, optional
        Highest harmonic.
    count : int, optional
        How many eigenvalues.

    Returns
    -------
    ndarray, shape (count,)
        For :math:`L = 2\pi`. Three vanish: the rigid rotations.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.circles import RingSection, circle_spectrum
    >>> slinky = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    >>> bool(circle_spectrum(slinky, 3, 2.9).min() > -1e-9)
    True
    """
    k = integer_at_least("turns", turns, 1)
    o = finite("overcurvature", overcurvature)
    highest = integer_at_least("modes", modes, k + 2)
    points = 4 * highest
    s = _TWO_PI * np.arange(points) / points
    strains = np.tile([0.0, float(k), 0.0], (points, 1))
    frames = np.zeros((points, 3, 3))
    frames[:, 0, 0], frames[:, 1, 0] = -np.cos(k * s), -np.sin(k * s)
    frames[:, 0, 2], frames[:, 1, 2] = -np.sin(k * s), np.cos(k * s)
    frames[:, 2, 1] = 1.0
    return second_variation_spectrum(section, o, frames, strains, modes=highest, count=count)


def second_variation_spectrum(
    section: RingSection,
    overcurvature: float,
    frames: npt.ArrayLike,
    strains: npt.ArrayLike,
    *,
    modes: int,
    count: int = 8,
) -> Array:
    r"""Lowest eigenvalues of the second variation of a closed ring without internal force.

    Stationary values of :math:`\int [u\cdot Du - m\cdot(\omega\times u)]\,ds` with
    :math:`\int|\omega|^2 ds = 1` and :math:`\oint\omega\times t\,ds = 0`, for :math:`L = 2\pi`.

    Parameters
    ----------
    section : RingSection
        Stiffnesses of the rod.
    overcurvature : float
        Natural curvature over that of the flat circle.
    frames : array_like, shape (n, 3, 3)
        Directors as columns, at n evenly spaced points of the ring.
    strains : array_like, shape (n, 3)
        Strains there.
    modes : int
        Highest harmonic, below n/2.
    count : int, optional
        How many eigenvalues.

    Returns
    -------
    ndarray, shape (count,)
        Rigid rotations and, where the ring is not a circle, the shift of the shape along the rod
        give zeros.

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    Only rigid rotations of a stable circle are neutral; at the threshold of the mode with two waves
    that mode is, in its two phases, as well:

    >>> import numpy as np
    >>> from lissome.references.circles import RingSection, mode_threshold, second_variation_spectrum
    >>> section = RingSection(2.0, 1.0, 1.0)
    >>> a = 2 * np.pi * np.arange(32) / 32
    >>> tangent = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    >>> inward = np.stack([-np.sin(a), np.cos(a), 0 * a], axis=-1)
    >>> frames = np.stack([inward, np.cross(tangent, inward), tangent], axis=-1)
    >>> strains = np.tile([0.0, 1.0, 0.0], (32, 1))
    >>> for overcurvature in (1.1, mode_threshold(section, 1, 2)):
    ...     spectrum = second_variation_spectrum(section, overcurvature, frames, strains, modes=6)
    ...     print(np.count_nonzero(abs(spectrum) < 1e-9), bool(spectrum.min() > -1e-9))
    3 True
    5 True
    """
    kappa = finite_array("strains", strains, (None, 3))
    points = kappa.shape[0]
    turned = finite_array("frames", frames, (points, 3, 3))
    highest = integer_at_least("modes", modes, 1)
    if 2 * highest >= points:
        raise InvalidInput(f"argument `modes` is {highest}; {points} points need it below half")
    s = _TWO_PI * np.arange(points) / points
    n = np.arange(1, highest + 1)
    values = np.concatenate(
        [np.full((points, 1), np.sqrt(0.5)), np.cos(np.outer(s, n)), np.sin(np.outer(s, n))], axis=1
    ) / np.sqrt(np.pi)
    slopes = np.concatenate(
        [np.zeros((points, 1)), -n * np.sin(np.outer(s, n)), n * np.cos(np.outer(s, n))], axis=1
    ) / np.sqrt(np.pi)
    size = values.shape[1]
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    moment = stiffness * (kappa - [0.0, finite("overcurvature", overcurvature), 0.0])
    unit = np.eye(3)
    # rotation and strain of every basis function: (points, 3, 3 * size)
    rotation = np.einsum("pb,ij->pijb", values, unit).reshape(points, 3, 3 * size)
    cross = np.cross(kappa[:, None, :], unit[None, :, :]).transpose(0, 2, 1)
    strain = np.einsum("pb,ij->pijb", slopes, unit) + np.einsum("pij,pb->pijb", cross, values)
    strain = strain.reshape(points, 3, 3 * size)
    # m . (omega x u) = omega . (u x m) = -omega . (m x u)
    spin = np.cross(moment[:, None, :], unit[None, :, :]).transpose(0, 2, 1)
    form = np.einsum("pia,i,pib->ab", strain, stiffness, strain, optimize=True)
    form += np.einsum("pia,pij,pjb->ab", rotation, spin, strain, optimize=True)
    form *= _TWO_PI / points
    tangent = np.cross(unit, [0.0, 0.0, 1.0]).T  # omega -> omega x t
    closure = np.einsum("pij,jk,pka->ia", turned, tangent, rotation, optimize=True)
    basis = null_space(closure * (_TWO_PI / points))
    reduced = basis.T @ (0.5 * (form + form.T)) @ basis
    return np.asarray(eigh(reduced, eigvals_only=True, subset_by_index=(0, count - 1)))
