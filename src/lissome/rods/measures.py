r"""Strain measures of a hinge as functions of the rotation between its two frames.

Let :math:`q = q_0 + \kappa/2` be the unit quaternion of that rotation in the material frame, with
:math:`q_0 \ge 0` (the rotation is below a half turn). Three measures have the same continuum limit:

``"sine"``
    :math:`\kappa = 2 \sin(\theta/2)\, n`, (4.16) of the thesis, for the rotation by
    :math:`\theta` about the axis :math:`n`.
``"angle"``
    :math:`\omega = \theta\, n = \psi(|\kappa|)\, \kappa`, (4.19): the rotation vector.
``"averaged"``
    That of the original discrete elastic rods (Bergou et al. 2008): the curvature binormal
    :math:`2\, t \times t'/(1 + t\cdot t')` of the two tangents, resolved in the mean of the two frames'
    directors, and the angle of twist that is left after parallel transport. All of it is algebra of
    q: splitting q into a twist about d3 and a swing gives

    .. math::

        \bar\kappa_1 = \frac{2 q_0 q_1}{q_0^2 + q_3^2},\qquad
        \bar\kappa_2 = \frac{2 q_0 q_2}{q_0^2 + q_3^2},\qquad
        \bar\kappa_3 = 2 \arctan\frac{q_3}{q_0}.

All three keep the symmetries of the rod: seen from its other end a hinge has
:math:`(-\kappa_1, \kappa_2, \kappa_3)`. They differ by terms of third order in the rotation.

Of a hinge with a quadratic energy only ``"angle"`` keeps its stiffness: with ``"sine"`` the energy
:math:`\propto \sin^2(\theta/2)` softens, and is concave beyond a quarter turn, so that a coarse mesh
can fold at single hinges; with ``"averaged"`` bending stiffens without bound towards a half turn. Where
that matters the mesh is too coarse.

For compiled kernels
--------------------
A measure is an integer code (``CODES[name]``). A hinge is described by q, a row of an array (n, 4),
scalar first, normalized, with :math:`q_0 \ge 0`. The kernels work with kappa; the chain rule goes
through two compiled functions that take all hinges at once:

``measure_all(code, q, omega)``
    writes the measure, shape (n, 3).
``pull_back_all(code, q, stress, stiffness, order)``
    replaces stress :math:`m = \partial E/\partial\omega`, shape (n, 3), and (if ``order >= 2``) stiffness
    :math:`K = \partial^2 E/\partial\omega\,\partial\omega`, shape (n, 3, 3), by derivatives of the same
    energy with respect to kappa: :math:`J^T m` and :math:`J^T K J + \sum_I m_I
    \partial^2\omega_I/\partial\kappa\,\partial\kappa`. For integrated strains: K is the stiffness of
    the law divided by the length of the hinge.

For one hinge: ``measure_one(code, q0, k1, k2, k3) -> (w1, w2, w3)``, ``jacobian_one(code, q0, k1, k2,
k3, J)`` and ``hessian_one(code, q0, k1, k2, k3, m, H)``, with J[I, a] the derivative of measure I with
respect to kappa a, and H the Hessian contracted with m.
Both derivatives exist for :math:`q_0 > 0`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._compile import jit as _jit
from .._validate import finite_array, one_of
from ..errors import InvalidInput

__all__ = ["MEASURES", "angle_over_strain", "rotation_from_strain", "strain_from_rotation"]

Array = NDArray[np.float64]

SINE, ANGLE, AVERAGED = 0, 1, 2
MEASURES: tuple[str, ...] = ("sine", "angle", "averaged")
CODES: dict[str, int] = {name: code for code, name in enumerate(MEASURES)}

jit = _jit(error_model="numpy", no_cfunc_wrapper=True)

# Below this sin^2(theta/2), psi and its derivatives come from the power series of arcsin.
_SERIES = 0.0625
# (2 n)! / (4^n n!^2 (2 n + 1)): of arcsin(y) / y in powers of y^2. Seventeen terms reach 1e-21.
_TERMS = 17
_ARCSIN = np.array(
    [math.comb(2 * n, n) / 4.0**n / (2 * n + 1) for n in range(_TERMS)], dtype=np.float64
)


@jit
def psi_terms(q0, y2):
    """Return psi and its first two derivatives with respect to |kappa|^2.

    With y = sin(theta/2) it is arcsin(y) / y, and y^2 = |kappa|^2 / 4; q0 is cos(theta/2).
    """
    if y2 < _SERIES:
        f = 0.0
        f1 = 0.0
        f2 = 0.0
        for n in range(_TERMS - 1, -1, -1):  # Horner, with both derivatives
            f2 = f2 * y2 + 2.0 * f1
            f1 = f1 * y2 + f
            f = f * y2 + _ARCSIN[n]
    else:
        y = math.sqrt(y2)
        f = math.atan2(y, q0) / y
        f1 = (1.0 / q0 - f) / (2.0 * y2)
        f2 = (0.5 / (q0 * q0 * q0) - 3.0 * f1) / (2.0 * y2)
    return f, 0.25 * f1, 0.0625 * f2


@jit
def measure_one(code, q0, k1, k2, k3):
    """Return the three strains of one hinge."""
    if code == ANGLE:
        f = psi_terms(q0, 0.25 * (k1 * k1 + k2 * k2 + k3 * k3))[0]
        return f * k1, f * k2, f * k3  # (4.19)
    if code == AVERAGED:
        f = q0 / (q0 * q0 + 0.25 * k3 * k3)
        return f * k1, f * k2, 2.0 * math.atan2(0.5 * k3, q0)
    return k1, k2, k3  # (4.16)


@jit
def jacobian_one(code, q0, k1, k2, k3, J):
    """Write the derivatives J[I, a] of strain I with respect to kappa a."""
    k = (k1, k2, k3)
    if code == ANGLE:
        f, f1, _ = psi_terms(q0, 0.25 * (k1 * k1 + k2 * k2 + k3 * k3))
        for i in range(3):
            for a in range(3):
                J[i, a] = 2.0 * f1 * k[i] * k[a]
            J[i, i] += f
    elif code == AVERAGED:
        d = 1.0 / (q0 * q0 + 0.25 * k3 * k3)
        for a in range(3):
            # f = q0 d(k1, k2), where 1/d = 1 - (k1^2 + k2^2) / 4 on the unit sphere
            slope = -0.25 * k[a] / q0 * d
            if a < 2:
                slope += 0.5 * q0 * k[a] * d * d
            J[0, a] = k1 * slope
            J[1, a] = k2 * slope
        J[0, 0] += q0 * d
        J[1, 1] += q0 * d
        J[2, 0] = 0.25 * k3 * k1 / q0 * d
        J[2, 1] = 0.25 * k3 * k2 / q0 * d
        J[2, 2] = 1.0 / q0
    else:
        for i in range(3):
            for a in range(3):
                J[i, a] = 0.0
            J[i, i] = 1.0


@jit
def hessian_one(code, q0, k1, k2, k3, m, H):
    """Write the second derivatives of m . strain with respect to kappa; m is held constant."""
    k = (k1, k2, k3)
    if code == ANGLE:
        _, f1, f2 = psi_terms(q0, 0.25 * (k1 * k1 + k2 * k2 + k3 * k3))
        mk = m[0] * k1 + m[1] * k2 + m[2] * k3
        for a in range(3):
            for b in range(3):
                H[a, b] = 2.0 * f1 * (m[a] * k[b] + k[a] * m[b]) + 4.0 * f2 * mk * k[a] * k[b]
            H[a, a] += 2.0 * f1 * mk
    elif code == AVERAGED:
        d = 1.0 / (q0 * q0 + 0.25 * k3 * k3)
        inverse = 1.0 / q0
        third = inverse * inverse * inverse
        mk = m[0] * k1 + m[1] * k2
        for a in range(3):
            qa = -0.25 * k[a] * inverse
            da = 0.5 * k[a] * d * d if a < 2 else 0.0
            fa = qa * d + q0 * da
            for b in range(3):
                qb = -0.25 * k[b] * inverse
                db = 0.5 * k[b] * d * d if b < 2 else 0.0
                fb = qb * d + q0 * db
                qab = -0.0625 * k[a] * k[b] * third
                dab = 0.0
                if a < 2 and b < 2:
                    dab = 0.5 * k[a] * k[b] * d * d * d
                if a == b:
                    qab -= 0.25 * inverse
                    if a < 2:
                        dab += 0.5 * d * d
                fab = qab * d + qa * db + qb * da + q0 * dab
                total = mk * fab
                if a < 2:
                    total += m[a] * fb
                if b < 2:
                    total += m[b] * fa
                # of the angle of twist
                if a == 2 or b == 2:
                    total += m[2] * 0.25 * k[a + b - 2] * third
                else:
                    twist = k[a] * k[b] * (0.25 * third * d + 0.5 * inverse * d * d)
                    if a == b:
                        twist += inverse * d
                    total += m[2] * 0.25 * k3 * twist
                H[a, b] = total
    else:
        for a in range(3):
            for b in range(3):
                H[a, b] = 0.0


@jit
def measure_all(code, q, omega):
    """Write the strains of all hinges."""
    for i in range(q.shape[0]):
        omega[i, 0], omega[i, 1], omega[i, 2] = measure_one(
            code, q[i, 0], 2.0 * q[i, 1], 2.0 * q[i, 2], 2.0 * q[i, 3]
        )


@jit
def pull_back_all(code, q, stress, stiffness, order):
    """Replace derivatives with respect to the measure by derivatives with respect to kappa."""
    if code == SINE:
        return
    J = np.empty((3, 3))
    H = np.zeros((3, 3))
    m = np.empty(3)
    KJ = np.empty((3, 3))
    for i in range(q.shape[0]):
        q0, k1, k2, k3 = q[i, 0], 2.0 * q[i, 1], 2.0 * q[i, 2], 2.0 * q[i, 3]
        jacobian_one(code, q0, k1, k2, k3, J)
        for a in range(3):
            m[a] = stress[i, a]
        for a in range(3):
            stress[i, a] = J[0, a] * m[0] + J[1, a] * m[1] + J[2, a] * m[2]
        if order < 2:
            continue
        hessian_one(code, q0, k1, k2, k3, m, H)
        for a in range(3):
            for b in range(3):
                KJ[a, b] = (
                    stiffness[i, a, 0] * J[0, b]
                    + stiffness[i, a, 1] * J[1, b]
                    + stiffness[i, a, 2] * J[2, b]
                )
        for a in range(3):
            for b in range(3):
                stiffness[i, a, b] = (
                    H[a, b] + J[0, a] * KJ[0, b] + J[1, a] * KJ[1, b] + J[2, a] * KJ[2, b]
                )


# ---------------------------------------------------------------------------------------------
# The same for people


def angle_over_strain(t: ArrayLike) -> Array:
    r"""Return rotation angles over lengths of strains, :math:`\psi(t) = \arcsin(t/2)/(t/2)` (4.18).

    Parameters
    ----------
    t : array_like
        Lengths of the vector kappa, in [0, 2].

    Returns
    -------
    ndarray
        Of the shape of `t`: values between 1 and pi/2, accurate to round-off down to t = 0.

    Raises
    ------
    InvalidInput
        If a number is outside [0, 2].

    Examples
    --------
    >>> from lissome.rods.measures import angle_over_strain
    >>> print(angle_over_strain([0.0, 2.0]))
    [1.         1.57079633]
    """
    t = finite_array("t", t)
    if np.any((t < 0.0) | (t > 2.0)):
        bad = t[(t < 0.0) | (t > 2.0)].flat[0]
        raise InvalidInput(f"argument `t` holds {bad}; the length of kappa lies in [0, 2]")
    y = 0.5 * t
    safe = np.where(y < 1e-5, 1.0, y)
    # y^4 is beyond the last digit where the two terms are used
    return np.where(y < 1e-5, 1.0 + y * y / 6.0, np.arcsin(safe) / safe)


def _rotations(name: str, q: ArrayLike) -> Array:
    array: Array = finite_array(name, q, (None, 4))
    norm = np.linalg.norm(array, axis=1)
    if np.any(np.abs(norm - 1.0) > 1e-8):
        i = int(np.argmax(np.abs(norm - 1.0)))
        raise InvalidInput(
            f"argument `{name}`[{i}] has the length {norm[i]:.10g}; rotations are unit quaternions"
        )
    return np.ascontiguousarray(array * (np.where(array[:, 0] < 0.0, -1.0, 1.0) / norm)[:, None])


def strain_from_rotation(q: ArrayLike, measure: str = "sine") -> Array:
    """Return the strains of hinges, integrated over their lengths.

    Parameters
    ----------
    q : array_like, shape (n, 4)
        Unit quaternions, scalar first, of the rotation from the first to the second frame, in the
        first frame; either sign.
    measure : {"sine", "angle", "averaged"}
        Which measure: see the module's description.

    Returns
    -------
    ndarray, shape (n, 3)
        Bending about d1 and d2, and twist (dimensionless).

    Raises
    ------
    InvalidInput
        If a quaternion has not unit length, or the measure is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.measures import strain_from_rotation
    >>> quarter = [[np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0]]
    >>> for measure in ("sine", "angle", "averaged"):
    ...     print(measure, strain_from_rotation(quarter, measure)[0, 0].round(4))
    sine 1.4142
    angle 1.5708
    averaged 2.0
    """
    code = CODES[one_of("measure", measure, MEASURES)]
    rotations = _rotations("q", q)
    omega = np.empty((rotations.shape[0], 3))
    measure_all(code, rotations, omega)
    return omega


def rotation_from_strain(strain: ArrayLike, measure: str = "sine") -> Array:
    """Return the rotations of hinges with given strains: the inverse of :func:`strain_from_rotation`.

    Parameters
    ----------
    strain : array_like, shape (n, 3)
        Strains, integrated over the lengths of the hinges.
    measure : {"sine", "angle", "averaged"}
        Which measure they are.

    Returns
    -------
    ndarray, shape (n, 4)
        Unit quaternions with a positive scalar part.

    Raises
    ------
    InvalidInput
        If the strain belongs to a rotation of half a turn or more.

    Examples
    --------
    The default measure is twice the vector part of the quaternion: a unit twist is a turn by 60 degrees.

    >>> import numpy as np
    >>> from lissome.rods.measures import rotation_from_strain, strain_from_rotation
    >>> quaternion = rotation_from_strain([[0.0, 0.0, 1.0]])
    >>> print(np.degrees(2 * np.arccos(quaternion[0, 0])).round(9), strain_from_rotation(quaternion))
    60.0 [[0. 0. 1.]]
    """
    code = CODES[one_of("measure", measure, MEASURES)]
    w: Array = finite_array("strain", strain, (None, 3))
    size = np.linalg.norm(w, axis=1)
    limit = {SINE: 2.0, ANGLE: math.pi, AVERAGED: math.inf}[code]
    refused = size >= limit if code != AVERAGED else np.abs(w[:, 2]) >= math.pi
    if np.any(refused):
        i = int(np.argmax(refused))
        raise InvalidInput(
            f"argument `strain`[{i}] is {w[i]}: frames that are half a turn or more apart; "
            "use more segments"
        )
    q = np.empty((w.shape[0], 4))
    if code == SINE:
        q[:, 1:] = 0.5 * w
        q[:, 0] = np.sqrt((1.0 - 0.5 * size) * (1.0 + 0.5 * size))
    elif code == ANGLE:
        q[:, 0] = np.cos(0.5 * size)
        q[:, 1:] = 0.5 * w * np.sinc(size / (2.0 * math.pi))[:, None]
    else:
        # With q0 + i q3 = n exp(i w3/2): w_a = 2 cos(w3/2) q_a / n; then n follows from |q| = 1.
        ratio = 0.5 * w[:, :2] / np.cos(0.5 * w[:, 2])[:, None]
        n = 1.0 / np.sqrt(1.0 + np.sum(ratio**2, axis=1))
        q[:, 0] = n * np.cos(0.5 * w[:, 2])
        q[:, 1:3] = ratio * n[:, None]
        q[:, 3] = n * np.sin(0.5 * w[:, 2])
    return q
