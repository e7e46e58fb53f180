r"""Compiled passes of the discrete rod: strains, energy, gradient and Hessian in body increments.

The unknowns of segment j are the components, in its own directors, of a rotation vector
:math:`\theta_j`: the frame goes to :math:`d^j \exp(\theta_j/2)`, and the nodes follow by summation.
At a hinge with :math:`q = \overline{d^{a}} d^{b} = s + v` (scalar and vector part) the increments a
and b of the two frames give :math:`\exp(-a/2)\, q \exp(b/2)`, so that :math:`\kappa = 2v` changes by

.. math::

    \delta\kappa &= s\,(b - a) + v\times(a + b), \\
    \tfrac12\delta^2\kappa &= -\tfrac14(|a|^2 + |b|^2)\,v
        - \tfrac12\left[s\,a\times b - (a\cdot v)\,b + (a\cdot b)\,v - (b\cdot v)\,a\right].

With :math:`X = sI + [v]_\times` the derivatives are :math:`\partial\kappa/\partial b = X` and
:math:`\partial\kappa/\partial a = -X^T`. Contracted with the stress m, the second variation has the
blocks :math:`-\tfrac12(m\cdot v)I` (aa and bb) and
:math:`\tfrac12(s[m]_\times + v m^T + m v^T - (m\cdot v)I)` (ab).

Frames are numbered: first the N segments, then the frames of supports. ``column`` says where the
unknowns of a frame are: in the band below ``length``, in the border from there on, -1 where the
frame is prescribed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .._compile import jit as _jit
from .quaternions import exp_of, mul, normalized

jit = _jit(error_model="numpy", no_cfunc_wrapper=True)
# Called by compiled code only: less to compile.
inner = _jit(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)


class Plan(NamedTuple):
    """What the compiled passes know of a rod.

    Attributes
    ----------
    left, right : ndarray (n,) of int64
        Frames that each hinge joins.
    span : ndarray (n,)
        Rest (Voronoi) length of each hinge.
    twist : ndarray (n, 2)
        Cosine and sine of half the angle about d3 by which the right frame of a hinge is turned
        before it is compared: that of the joint of a closed rod, (1, 0) elsewhere.
    column : ndarray (K,) of int64
        First unknown of each frame, or -1.
    axis : ndarray (K, 3)
        Of frames that turn about an axis by one unknown angle: that axis in the frame.
    turning : ndarray (K,) of int64
        1 for those frames.
    lengths : ndarray (N,)
        Rest lengths of the segments.
    rows : ndarray (m, 3) of int64
        Constraints: component (3: with weights), first and last (exclusive) segment of a sum.
    phase : ndarray (N,)
        Weights of the row of component 3, which pins the phase of the lobes of a ring.
    normals : ndarray (m, 3)
        The direction whose component each row sums.
    stretch_column : ndarray (N,) of int64
        Unknown of the stretch of each segment, or -1.
    arms : ndarray (c, 7)
        Couples: number of a segment, force (spatial), arm (body).
    natural : ndarray (n, 3)
        Natural strain densities of the hinges.
    dead : ndarray (N, 3)
        For each segment the dead forces beyond it, or minus those before it.
    targets : ndarray (m,)
        What the sums of the constraints must be.
    moments : ndarray (h,)
        Dead moments on the hinged supports.
    length : int
        Number of columns of the band.
    first_angle : int
        Position of the first unknown angle.
    stiffness : float
        Stretching stiffness, or -1 for an inextensible rod.
    """

    left: np.ndarray
    right: np.ndarray
    span: np.ndarray
    twist: np.ndarray
    column: np.ndarray
    axis: np.ndarray
    turning: np.ndarray
    lengths: np.ndarray
    rows: np.ndarray
    phase: np.ndarray
    normals: np.ndarray
    stretch_column: np.ndarray
    arms: np.ndarray
    natural: np.ndarray
    dead: np.ndarray
    targets: np.ndarray
    moments: np.ndarray
    length: int
    first_angle: int
    stiffness: float


@jit
def hinge_rotations(frames, left, right, twist, q, kappa):
    """Write the rotation across each hinge (n, 4), scalar part not negative, and kappa = 2 vec q."""
    for i in range(left.size):
        a = left[i]
        b = right[i]
        p = (frames[a, 0], -frames[a, 1], -frames[a, 2], -frames[a, 3])
        r = (frames[b, 0], frames[b, 1], frames[b, 2], frames[b, 3])
        s, x, y, z = mul(p, r)  # (4.14)
        if twist[i, 1] != 0.0:  # times the turn about d3
            c = twist[i, 0]
            d = twist[i, 1]
            s, x, y, z = s * c - z * d, x * c + y * d, y * c - x * d, z * c + s * d
        sign = -1.0 if s < 0.0 else 1.0
        q[i, 0] = sign * s
        q[i, 1] = sign * x
        q[i, 2] = sign * y
        q[i, 3] = sign * z
        kappa[i, 0] = 2.0 * sign * x  # (4.16)
        kappa[i, 1] = 2.0 * sign * y
        kappa[i, 2] = 2.0 * sign * z


@inner
def _add(band, border, corner, i, j, value):
    """Add to the entries (i, j) and (j, i) of the bordered band."""
    length = band.shape[0]
    low = min(i, j)
    high = max(i, j)
    if high < length:
        band[low, high - low] += value
    elif low < length:
        border[low, high - length] += value
    else:
        corner[low - length, high - length] += value
        if low != high:
            corner[high - length, low - length] += value


@inner
def _add_pair(band, border, corner, column, turning, axis, a, b, block):
    """Add the block of two frames (rows a, columns b), projected where a frame has one unknown."""
    ca = column[a]
    cb = column[b]
    if ca < 0 or cb < 0:
        return
    for r in range(1 if turning[a] else 3):
        for c in range(1 if turning[b] else 3):
            if a == b and c > r:
                continue
            value = 0.0
            for i in range(3):
                wi = axis[a, i] if turning[a] else (1.0 if i == r else 0.0)
                if wi == 0.0:
                    continue
                for j in range(3):
                    wj = axis[b, j] if turning[b] else (1.0 if j == c else 0.0)
                    value += wi * wj * block[i, j]
            _add(band, border, corner, ca + r, cb + c, value)


def assemble(
    frames, stretches, angles, q, values, stress, stiffness, plan, multipliers, gradient, band,
    border, corner, constraints, order,
):  # fmt: skip
    r"""Add up energy, constraints and their derivatives.

    Parameters
    ----------
    frames : ndarray (K, 4)
    stretches : ndarray (N,)
    angles : ndarray (h,)
    q : ndarray (n, 4)
        From `hinge_rotations`.
    values : ndarray (n,)
        Energy of the hinges per unit length.
    stress : ndarray (n, 3)
        Derivative of the energy of the hinges with respect to kappa (order >= 1).
    stiffness : ndarray (n, 3, 3)
        Second derivative times the length of the hinge (order 2).
    plan : Plan
    multipliers : ndarray (m,)
    gradient : ndarray (length + b,)
        Of the Lagrangian. Overwritten if order >= 1.
    band, border, corner : ndarray (length, w + 1), (length, b), (b, b)
        Of the KKT matrix. Overwritten if order is 2.
    constraints : ndarray (m,)
        Overwritten.
    order : int

    Returns
    -------
    energy : float
        Without the potential of all dead forces at the origin of the rod.
    """
    length = plan.length
    m = plan.rows.shape[0]
    if order >= 1:
        gradient[:] = 0.0
    if order >= 2:
        band[:] = 0.0
        border[:] = 0.0
        corner[:] = 0.0
    forces = with_multipliers(plan, multipliers) if m and order >= 1 else plan.dead
    energy = float(plan.span @ values) + _add_segments(
        frames, stretches, plan.lengths, plan.dead, forces, plan.rows, plan.phase, plan.normals,
        plan.column, plan.stretch_column, plan.stiffness, length, gradient, band, border, corner,
        constraints, order,
    )  # fmt: skip
    constraints -= plan.targets
    if plan.moments.size:
        energy -= float(plan.moments @ angles)
        if order >= 1:
            gradient[plan.first_angle : plan.first_angle + plan.moments.size] -= plan.moments
    if order >= 2 and max(plan.column[0], plan.stretch_column[0]) >= length:
        _add_first_of_ring(frames, stretches, plan, forces[0], corner)
    if plan.arms.shape[0]:
        energy += _add_couples(
            frames, plan.arms, plan.column, length, gradient, band, corner, order
        )
    if order >= 1:
        add_hinges = _add_hinges if _all_plain(plan) else _add_all_hinges
        add_hinges(
            q, stress, stiffness, plan.left, plan.right, plan.span, plan.twist, plan.column,
            plan.turning, plan.axis, gradient, band, border, corner, order, np.empty((7, 3, 3)),
        )  # fmt: skip
    return energy


def with_multipliers(plan, multipliers):
    """Return the forces in the segments: dead loads, and the multipliers of the constraints."""
    forces = plan.dead.copy()
    for value, (k, first, last), normal in zip(
        multipliers.tolist(), plan.rows.tolist(), plan.normals, strict=True
    ):
        if k < 3:
            forces[first:last, k] -= value
        else:
            forces[first:last] -= np.outer(value * plan.phase[first:last], normal)
    return forces


def _all_plain(plan):
    """Return whether no hinge is turned, none joins a frame with one unknown or one in the border."""
    joint = plan.twist.shape[0] - 1  # of a closed rod it comes last
    return (
        plan.first_angle == plan.length
        and plan.twist[joint, 1] == 0.0
        and plan.column[0] < plan.length
        and not plan.moments.size
    )


def _add_first_of_ring(frames, stretches, plan, force, corner):
    """Add the second variation of the load on segment 0, whose unknowns are in the border."""
    length, c, ce = plan.length, plan.column[0], plan.stretch_column[0]
    s, x, y, z = frames[0]
    rest, e = plan.lengths[0], stretches[0]
    p = np.empty(3)
    _body(s, x, y, z, force, p)
    p1, p2, p3 = p
    le = rest * e
    if c >= length:
        c -= length
        corner[c, c] += le * p3
        corner[c + 1, c + 1] += le * p3
        corner[c + 2, c] -= 0.5 * le * p1
        corner[c, c + 2] -= 0.5 * le * p1
        corner[c + 2, c + 1] -= 0.5 * le * p2
        corner[c + 1, c + 2] -= 0.5 * le * p2
    if ce >= length:
        ce -= length
        strain = 0.5 * (e * e - 1.0)
        corner[ce, ce] += rest * plan.stiffness * (e * e + strain)
        if c >= 0 and plan.column[0] >= length:
            corner[ce, c] += rest * p2
            corner[c, ce] += rest * p2
            corner[ce, c + 1] -= rest * p1
            corner[c + 1, ce] -= rest * p1


@jit
def _add_segments(
    frames, stretches, lengths, dead, forces, rows, phase, normals, column, stretch_column,
    stiffness, length, gradient, band, border, corner, sums, order,
):  # fmt: skip
    """Add what belongs to segments, loads and constraints; overwrite the sums of the constraints.

    ``forces`` are those in the segments, ``normals`` (m, 3) the directions of the constraints.
    """
    m = rows.shape[0]
    edge = border.shape[1] - m
    energy = 0.0
    lost = np.zeros(m)
    for r in range(m):
        sums[r] = 0.0
    for j in range(lengths.size):
        s, x, y, z = frames[j, 0], frames[j, 1], frames[j, 2], frames[j, 3]
        d1 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + s * z), 2.0 * (x * z - s * y))
        d2 = (2.0 * (x * y - s * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + s * x))
        d3 = (2.0 * (x * z + s * y), 2.0 * (y * z - s * x), 1.0 - 2.0 * (x * x + y * y))
        e = stretches[j]
        rest = lengths[j]
        le = rest * e
        energy -= le * (dead[j, 0] * d3[0] + dead[j, 1] * d3[1] + dead[j, 2] * d3[2])
        strain = 0.0
        if stiffness >= 0.0:
            strain = 0.5 * (e * e - 1.0)  # (4.17) over the rest length
            energy += 0.5 * stiffness * rest * strain * strain
        c = column[j]
        ce = stretch_column[j]
        for r in range(m):
            if j < rows[r, 1] or j >= rows[r, 2]:
                continue
            n0, n1, n2 = normals[r, 0], normals[r, 1], normals[r, 2]
            if rows[r, 0] == 3:
                n0 *= phase[j]
                n1 *= phase[j]
                n2 *= phase[j]
            # Kahan's sum: the ends of a long chain are known to the round-off of one addition
            along = n0 * d3[0] + n1 * d3[1] + n2 * d3[2]
            term = le * along - lost[r]
            total = sums[r] + term
            lost[r] = (total - sums[r]) - term
            sums[r] = total
            if order < 2:
                continue
            k = edge + r
            if c >= 0:
                u = -le * (n0 * d2[0] + n1 * d2[1] + n2 * d2[2])
                v = le * (n0 * d1[0] + n1 * d1[1] + n2 * d1[2])
                if c < length:
                    border[c, k] = u
                    border[c + 1, k] = v
                else:
                    corner[c - length, k] = u
                    corner[c - length + 1, k] = v
                    corner[k, c - length] = u
                    corner[k, c - length + 1] = v
            if ce >= length:
                corner[ce - length, k] = rest * along
                corner[k, ce - length] = rest * along
            elif ce >= 0:
                border[ce, k] = rest * along
        if order == 0:
            continue
        fx = forces[j, 0]
        fy = forces[j, 1]
        fz = forces[j, 2]
        p1 = fx * d1[0] + fy * d1[1] + fz * d1[2]
        p2 = fx * d2[0] + fy * d2[1] + fz * d2[2]
        p3 = fx * d3[0] + fy * d3[1] + fz * d3[2]
        if c >= 0:
            gradient[c] += le * p2
            gradient[c + 1] -= le * p1
        if ce >= 0:
            gradient[ce] += rest * (stiffness * strain * e - p3)
        if order >= 2 and 0 <= c < length:
            band[c, 0] += le * p3
            band[c + 1, 0] += le * p3
            band[c, 2] -= 0.5 * le * p1
            band[c + 1, 1] -= 0.5 * le * p2
            if ce >= 0:  # it stands after the three angles
                band[ce, 0] += rest * stiffness * (e * e + strain)
                band[c, 3] += rest * p2
                band[c + 1, 2] -= rest * p1
    return energy


@jit
def _add_couples(frames, arms, column, length, gradient, band, corner, order):
    """Add the couples of forces at arms; return their energy."""
    energy = 0.0
    p = np.zeros(3)
    for i in range(arms.shape[0]):
        j = int(arms[i, 0])
        _body(frames[j, 0], frames[j, 1], frames[j, 2], frames[j, 3], arms[i, 1:4], p)
        arm = arms[i, 4:7]
        pa = p[0] * arm[0] + p[1] * arm[1] + p[2] * arm[2]
        energy -= pa
        c = column[j]
        if order == 0 or c < 0:
            continue
        gradient[c] -= arm[1] * p[2] - arm[2] * p[1]
        gradient[c + 1] -= arm[2] * p[0] - arm[0] * p[2]
        gradient[c + 2] -= arm[0] * p[1] - arm[1] * p[0]
        if order < 2:
            continue
        for r in range(3):
            for k in range(r + 1):
                value = -0.5 * (p[r] * arm[k] + arm[r] * p[k])
                if r == k:
                    value += pa
                if c < length:
                    band[c + k, r - k] += value
                else:
                    corner[c - length + r, c - length + k] += value
                    if r != k:
                        corner[c - length + k, c - length + r] += value
    return energy


@jit
def _body(s, x, y, z, w, out):
    """Write the components of the spatial vector w in the frame."""
    out[0] = (
        (1.0 - 2.0 * (y * y + z * z)) * w[0]
        + 2.0 * (x * y + s * z) * w[1]
        + 2.0 * (x * z - s * y) * w[2]
    )
    out[1] = (
        2.0 * (x * y - s * z) * w[0]
        + (1.0 - 2.0 * (x * x + z * z)) * w[1]
        + 2.0 * (y * z + s * x) * w[2]
    )
    out[2] = (
        2.0 * (x * z + s * y) * w[0]
        + 2.0 * (y * z - s * x) * w[1]
        + (1.0 - 2.0 * (x * x + y * y)) * w[2]
    )


@inner
def _turn_vector(w, c, s):
    """Turn a vector about d3, by the angle whose half has cosine c and sine s."""
    cos = c * c - s * s
    sin = 2.0 * c * s
    u = cos * w[0] - sin * w[1]
    w[1] = sin * w[0] + cos * w[1]
    w[0] = u


def _hinges_with(special):
    """Return a pass over the hinges, with those that are not plain or without."""

    @jit
    def add_hinges(
        q, stress, stiffness, left, right, span, twist, column, turning, axis, gradient, band, border,
        corner, order, work,
    ):  # fmt: skip
        """Add gradient and Hessian of the energy of the hinges."""
        length = band.shape[0]
        aa = work[0]
        bb = work[1]
        ab = work[2]
        g = work[3]
        cross = work[4]
        cx = work[5]
        cxt = work[6]
        for i in range(left.size):
            a = left[i]
            b = right[i]
            ca = column[a]
            cb = column[b]
            s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            m0, m1, m2 = stress[i, 0], stress[i, 1], stress[i, 2]
            # b: X^T m = s m + m x v; a: -X m = -s m - v x m
            w0 = m1 * z - m2 * y
            w1 = m2 * x - m0 * z
            w2 = m0 * y - m1 * x
            g[0, 0] = w0 - s * m0
            g[0, 1] = w1 - s * m1
            g[0, 2] = w2 - s * m2
            g[1, 0] = w0 + s * m0
            g[1, 1] = w1 + s * m1
            g[1, 2] = w2 + s * m2
            if special:
                turned = twist[i, 1] != 0.0
                if turned:  # the right increment acts before the turn about d3
                    _turn_vector(g[1], twist[i, 0], twist[i, 1])
            for side in range(2):
                c = ca if side == 0 else cb
                if c < 0:
                    continue
                if special:
                    f = a if side == 0 else b
                    if turning[f]:
                        for k in range(3):
                            gradient[c] += axis[f, k] * g[side, k]
                        continue
                for k in range(3):
                    gradient[c + k] += g[side, k]
            if order < 2:
                continue
            share = 1.0 / span[i]
            cross[0, 0] = s
            cross[1, 1] = s
            cross[2, 2] = s
            cross[0, 1] = -z
            cross[0, 2] = y
            cross[1, 0] = z
            cross[1, 2] = -x
            cross[2, 0] = -y
            cross[2, 1] = x
            for r in range(3):
                for k in range(3):
                    cx[r, k] = share * (
                        stiffness[i, r, 0] * cross[0, k]
                        + stiffness[i, r, 1] * cross[1, k]
                        + stiffness[i, r, 2] * cross[2, k]
                    )
                    cxt[r, k] = share * (
                        stiffness[i, r, 0] * cross[k, 0]
                        + stiffness[i, r, 1] * cross[k, 1]
                        + stiffness[i, r, 2] * cross[k, 2]
                    )
            for r in range(3):
                for k in range(3):
                    bb[r, k] = (
                        cross[0, r] * cx[0, k] + cross[1, r] * cx[1, k] + cross[2, r] * cx[2, k]
                    )
                    aa[r, k] = (
                        cross[r, 0] * cxt[0, k] + cross[r, 1] * cxt[1, k] + cross[r, 2] * cxt[2, k]
                    )
                    ab[r, k] = -(
                        cross[r, 0] * cx[0, k] + cross[r, 1] * cx[1, k] + cross[r, 2] * cx[2, k]
                    )
            mv = 0.5 * (m0 * x + m1 * y + m2 * z)
            for r in range(3):
                aa[r, r] -= mv
                bb[r, r] -= mv
                ab[r, r] -= mv
            h = 0.5 * s
            ab[0, 0] += x * m0
            ab[1, 1] += y * m1
            ab[2, 2] += z * m2
            u = 0.5 * (x * m1 + y * m0)
            ab[0, 1] += u - h * m2
            ab[1, 0] += u + h * m2
            u = 0.5 * (x * m2 + z * m0)
            ab[0, 2] += u + h * m1
            ab[2, 0] += u - h * m1
            u = 0.5 * (y * m2 + z * m1)
            ab[1, 2] += u - h * m0
            ab[2, 1] += u + h * m0
            if special:
                if turned:
                    c2 = twist[i, 0]
                    s2 = twist[i, 1]
                    for r in range(3):
                        _turn_vector(ab[r], c2, s2)
                        _turn_vector(bb[r], c2, s2)
                    for k in range(3):
                        _turn_vector(bb[:, k], c2, s2)
                if not (0 <= ca < cb < length and turning[a] == 0 and turning[b] == 0):
                    for side in range(3):
                        f = b if side == 1 else a
                        h = a if side == 0 else b
                        _add_pair(band, border, corner, column, turning, axis, f, h, work[side])
                    continue
            # neighbors in the band; a prescribed frame has no column
            for r in range(3):
                for k in range(3):
                    if r >= k:
                        if ca >= 0:
                            band[ca + k, r - k] += aa[r, k]
                        if cb >= 0:
                            band[cb + k, r - k] += bb[r, k]
                    if 0 <= ca < cb:
                        band[ca + k, cb - ca + r - k] += ab[k, r]
                    elif ca > cb >= 0:
                        band[cb + k, ca - cb + r - k] += ab[r, k]

    return add_hinges


_add_hinges = _hinges_with(False)
_add_all_hinges = _hinges_with(True)


@jit
def retract(
    frames, stretches, angles, dx, column, turning, axis, stretch_column, first_angle, new_frames,
    new_stretches, new_angles,
):  # fmt: skip
    """Write the state after the increment `dx` (by position)."""
    count = stretches.size
    for f in range(frames.shape[0]):
        c = column[f]
        d = (frames[f, 0], frames[f, 1], frames[f, 2], frames[f, 3])
        if c >= 0:
            if turning[f]:
                turn = dx[c]
                theta = (turn * axis[f, 0], turn * axis[f, 1], turn * axis[f, 2])
                k = c - first_angle
                new_angles[k] = angles[k] + turn
            else:
                theta = (dx[c], dx[c + 1], dx[c + 2])
            d = normalized(mul(d, exp_of(theta)))
        new_frames[f, 0] = d[0]
        new_frames[f, 1] = d[1]
        new_frames[f, 2] = d[2]
        new_frames[f, 3] = d[3]
    for j in range(count):
        ce = stretch_column[j]
        new_stretches[j] = stretches[j] + (dx[ce] if ce >= 0 else 0.0)


@jit
def largest_step(stretches, q, dx, left, right, twist, column, turning, axis, stretch_column):
    """Return the largest fraction of `dx` at which no hinge reaches the angle pi.

    Along exp(-ta/2) q exp(tb/2) the angular velocity is constant in size: |b - R(q)^T a|.
    """
    fraction = 1.0
    w = np.zeros((2, 3))
    turned = np.zeros(3)
    for i in range(left.size):
        for side in range(2):
            f = left[i] if side == 0 else right[i]
            c = column[f]
            for k in range(3):
                if c < 0:
                    w[side, k] = 0.0
                elif turning[f]:
                    w[side, k] = dx[c] * axis[f, k]
                else:
                    w[side, k] = dx[c + k]
        if twist[i, 1] != 0.0:  # b in the frame that is compared
            _turn_vector(w[1], twist[i, 0], -twist[i, 1])
        s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        _body(s, x, y, z, w[0], turned)
        speed = math.sqrt(
            (w[1, 0] - turned[0]) ** 2 + (w[1, 1] - turned[1]) ** 2 + (w[1, 2] - turned[2]) ** 2
        )
        angle = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), s)
        room = 0.9 * (math.pi - angle)
        if speed * fraction > room:
            fraction = room / speed
    for j in range(stretches.size):
        ce = stretch_column[j]
        if ce >= 0 and dx[ce] < 0.0:
            fraction = min(fraction, -0.9 * stretches[j] / dx[ce])
    return max(fraction, 1e-6)


@jit
def positions(frames, stretches, lengths, out):
    """Write the nodes (N + 1, 3) relative to the first, by Kahan's sum."""
    lost = np.zeros(3)
    out[0] = 0.0
    step = np.zeros(3)
    for j in range(lengths.size):
        s, x, y, z = frames[j, 0], frames[j, 1], frames[j, 2], frames[j, 3]
        le = lengths[j] * stretches[j]
        step[0] = le * 2.0 * (x * z + s * y)
        step[1] = le * 2.0 * (y * z - s * x)
        step[2] = le * (1.0 - 2.0 * (x * x + y * y))
        for k in range(3):
            term = step[k] - lost[k]
            total = out[j, k] + term
            lost[k] = (total - out[j, k]) - term
            out[j + 1, k] = total
