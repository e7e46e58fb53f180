r"""The uniform helix under an axial wrench, in closed form.

A helix of curvature :math:`\kappa` and twist :math:`\tau` turns about its axis at the rate
:math:`\omega = \sqrt{\kappa^2 + \tau^2}` per length. Its second director is the binormal: the
section bends about it, with the stiffness B, and nowhere else. With the moments
:math:`m_2 = B(\kappa - \kappa_0)` and :math:`m_3 = C(\tau - \tau_0)`, constant along the rod,
:math:`M' + t\times N = 0` leaves a force N along the axis, and the ends carry

.. math:: F = \frac{\omega}{\kappa}\,(m_3\,\kappa - m_2\,\tau), \qquad
   T = \frac{m_2\,\kappa + m_3\,\tau}{\omega} ,

the force and the torque of an axial wrench: the same as :math:`\partial_\kappa` and
:math:`\partial_\tau` of the energy per length minus :math:`F\tau/\omega + T\omega` vanishing, where
:math:`\tau/\omega` is the height and :math:`\omega` the rotation per length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._validate import finite, finite_array, positive
from ..errors import NotConverged

__all__ = ["UniformHelix", "loaded_helix", "uniform_helix"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class UniformHelix:
    r"""A helix in equilibrium under a force and a torque along its axis, the third one.

    Attributes
    ----------
    curvature, twist : float
        :math:`\kappa > 0` and :math:`\tau`.
    force, torque : float
        F, positive in tension, and T, positive if it winds up a right-handed helix.
    radius : float
        :math:`\kappa/\omega^2`.
    rise : float
        Height per length, :math:`\tau/\omega`.
    rotation : float
        Angle about the axis per length, :math:`\omega`.
    energy : float
        Energy per length.

    Examples
    --------
    Curvature 3 and twist 4 make a helix of radius 3/25 that rises by 4/5 of its length:

    >>> import numpy as np
    >>> from lissome.references.helix import uniform_helix
    >>> helix = uniform_helix(3.0, 4.0)
    >>> point = helix.points(1.0)
    >>> print(np.hypot(point[0], point[1]).round(9), point[2].round(9), helix.energy)
    0.12 0.8 12.5
    """

    curvature: float
    twist: float
    force: float
    torque: float
    radius: float
    rise: float
    rotation: float
    energy: float

    def points(self, position: npt.ArrayLike) -> Array:
        """Coordinates at arc lengths `position`, shape (..., 3); the axis is the third one.

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        angle = self.rotation * s
        return np.stack(
            [self.radius * np.cos(angle), self.radius * np.sin(angle), self.rise * s], axis=-1
        )

    def frames(self, position: npt.ArrayLike) -> Array:
        """Directors (normal, binormal, tangent) as columns at arc lengths `position`, shape (..., 3, 3).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position)
        angle = self.rotation * s
        sine, cosine, flat = np.sin(angle), np.cos(angle), self.curvature / self.rotation
        zero, one = 0.0 * angle, 1.0 + 0.0 * angle
        normal = np.stack([-cosine, -sine, zero], axis=-1)
        tangent = np.stack([-flat * sine, flat * cosine, self.rise * one], axis=-1)
        return np.stack([normal, np.cross(tangent, normal), tangent], axis=-1)


def uniform_helix(
    curvature: float,
    twist: float,
    *,
    bending: float = 1.0,
    torsion: float = 1.0,
    natural_curvature: float = 0.0,
    natural_twist: float = 0.0,
) -> UniformHelix:
    r"""Return the helix with given strains, and the wrench that holds it.

    Parameters
    ----------
    curvature, twist : float
        :math:`\kappa > 0`, about the second director, and :math:`\tau`.
    bending, torsion : float, optional
        Stiffnesses B (about the second director) and C.
    natural_curvature, natural_twist : float, optional
        :math:`\kappa_0` (about the second director) and :math:`\tau_0`.

    Returns
    -------
    UniformHelix

    Raises
    ------
    InvalidInput
        If an argument is out of its range.

    Examples
    --------
    >>> from lissome.references.helix import uniform_helix
    >>> helix = uniform_helix(3.0, 4.0, natural_curvature=3.0, natural_twist=3.0)
    >>> helix.rise, helix.force, helix.torque
    (0.8, 5.0, 0.8)
    """
    k, t = positive("curvature", curvature), finite("twist", twist)
    b, c = positive("bending", bending), positive("torsion", torsion)
    m2 = b * (k - finite("natural_curvature", natural_curvature))
    m3 = c * (t - finite("natural_twist", natural_twist))
    omega = float(np.hypot(k, t))
    return UniformHelix(
        curvature=k,
        twist=t,
        force=omega * (m3 - m2 * t / k),
        torque=(m2 * k + m3 * t) / omega,
        radius=k / omega**2,
        rise=t / omega,
        rotation=omega,
        energy=0.5 * (m2 * m2 / b + m3 * m3 / c),
    )


def loaded_helix(
    force: float,
    torque: float,
    *,
    natural_curvature: float,
    natural_twist: float,
    bending: float = 1.0,
    torsion: float = 1.0,
) -> UniformHelix:
    r"""Return the helical spring under an axial force and torque, reached from its rest shape.

    The load grows in steps; at each, :math:`\kappa` and :math:`\tau` make the energy per length
    minus :math:`F\tau/\omega + T\omega` stationary (Newton's method). The ends may move along the
    axis and turn about it; they do not tilt.

    Parameters
    ----------
    force, torque : float
        F and T.
    natural_curvature : float
        :math:`\kappa_0 > 0`.
    natural_twist : float
        :math:`\tau_0`.
    bending, torsion : float, optional
        B and C.

    Returns
    -------
    UniformHelix

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If the branch of uniform helices ends before the full load.

    Examples
    --------
    >>> from lissome.references.helix import loaded_helix
    >>> spring = loaded_helix(5.0, 0.8, natural_curvature=3.0, natural_twist=3.0)
    >>> round(spring.curvature, 12), round(spring.twist, 12)
    (3.0, 4.0)
    """
    f, q = finite("force", force), finite("torque", torque)
    rest = np.array(
        [positive("natural_curvature", natural_curvature), finite("natural_twist", natural_twist)]
    )
    stiffness = np.array([positive("bending", bending), positive("torsion", torsion)])
    strain, done, step = rest.copy(), 0.0, 1.0
    while done < 1.0:
        share = min(1.0, done + step)
        found = _stationary(strain, share * f, share * q, rest, stiffness)
        if found is None:
            step *= 0.5
            if step < 1e-6:
                raise NotConverged(
                    f"the helix cannot be followed beyond {done:.6f} of force {f:g}, torque {q:g}",
                    state=strain,
                )
            continue
        strain, done, step = found, share, 2.0 * step
    return uniform_helix(
        float(strain[0]),
        float(strain[1]),
        bending=bending,
        torsion=torsion,
        natural_curvature=natural_curvature,
        natural_twist=natural_twist,
    )


def _stationary(
    strain: Array, force: float, torque: float, rest: Array, stiffness: Array
) -> Array | None:
    """Newton's method from a nearby state; None if it wanders off or meets a singular Hessian."""
    x = strain.copy()
    for _ in range(25):
        k, t = x
        w = np.hypot(k, t)
        # h = t/w and w, with their derivatives
        h1 = np.array([-k * t, k * k]) / w**3
        w1 = np.array([k, t]) / w
        h2 = np.array([[t * (2 * k * k - t * t), k * (2 * t * t - k * k)], [0.0, -3 * k * k * t]])
        h2[1, 0] = h2[0, 1]
        h2 /= w**5
        w2 = np.array([[t * t, -k * t], [-k * t, k * k]]) / w**3
        gradient = stiffness * (x - rest) - force * h1 - torque * w1
        hessian = np.diag(stiffness) - force * h2 - torque * w2
        if np.linalg.eigvalsh(hessian)[0] <= 0.0:
            return None
        change = np.linalg.solve(hessian, -gradient)
        size = float(np.linalg.norm(change) / w)
        if size > 0.2:
            return None
        x = x + change
        if x[0] <= 0.0:
            return None
        if size < 1e-14:
            return x
    return None
