r"""Compiled passes of the centerline-twist representation: frames, energy, gradient, band of the Hessian.

No third-order tensor is formed. With the stress m at a hinge (the derivative of its energy with
respect to :math:`\kappa = 2\,\mathrm{vec}\,q`), the rotation :math:`q = s + v` across it, and the
infinitesimal rotations :math:`\hat a, \hat b` of the frames on its left and right, (4.27) and
(4.28) of the thesis give

.. math::

    m\cdot\delta\kappa &= M\cdot(\hat b - \hat a),\qquad M = d^a * (s\,m + v\times m), \\
    m\cdot\delta^2\kappa &= M\cdot(\delta\hat b - \delta\hat a) + M\cdot(\hat b\times\hat a)
        - \tfrac12 (m\cdot v)\,|\hat b - \hat a|^2 .

The second-order rotation vectors of a segment appear with the jump of M across it only: they are
contracted once for each segment. With the edge E, tangent t, reference tangent T, binormal
:math:`k = 2\,T\times t/(1 + T\cdot t)`, :math:`e = \delta E` and a jump N,

.. math::

    \hat d &= t\,\delta\varphi + \tfrac1{|E|}\left(t\times e - \tfrac12 t\,(k\cdot e)\right), \\
    |E|^2\, N\cdot\delta^2\hat d &= |E|\,\delta\varphi\, N_\perp\!\cdot e - 2\,(g\cdot e)(t\cdot e)
        + \frac{(N\cdot t)(k\cdot e)(T_\perp\!\cdot e)}{2\,(1 + T\cdot t)}
        - \tfrac12 (N_\perp\!\cdot e)(k\cdot e), \\
    g &= N\times t - \tfrac12 (N\cdot t)\,k ,

where :math:`\perp` takes the part normal to t.
"""

from __future__ import annotations

import math

import numpy as np

from .._compile import jit as _jit
from .quaternions import conj, cross, directors_of, dot, mul, transport_of, turn

jit = _jit(error_model="numpy", no_cfunc_wrapper=True)


@jit
def _row(array, i):
    return (array[i, 0], array[i, 1], array[i, 2])


@jit
def _quaternion(array, i):
    return (array[i, 0], array[i, 1], array[i, 2], array[i, 3])


@jit
def reconstruct(positions, twists, reference, tangents, edges, sizes, binormals, bent, frames):
    """Write what follows from nodes, twists and reference, segment by segment.

    Parameters
    ----------
    positions : ndarray (N + 1, 3)
    twists : ndarray (N,)
    reference : ndarray (N, 4)
        Unit quaternions D of the reference frames.
    tangents, edges, sizes, binormals, bent : ndarray (2, N, 3), (N, 3), (N,), (N, 3), (N,)
        Reference and current tangents; x_{j+1} - x_j and its length; k of (4.25); 1 + T.t.
    frames : ndarray (K, 4)
        The first N rows are written: d of (4.11).

    Returns
    -------
    float
        Smallest 1 + T.t; NaN if a segment has no length.
    """
    least = 2.0
    for j in range(twists.size):
        e = (
            positions[j + 1, 0] - positions[j, 0],
            positions[j + 1, 1] - positions[j, 1],
            positions[j + 1, 2] - positions[j, 2],
        )
        size = math.sqrt(dot(e, e))
        t = (e[0] / size, e[1] / size, e[2] / size)  # (4.9)
        rest = _quaternion(reference, j)
        a = directors_of(rest)[2]  # T, (4.8)
        between = (a[0] + t[0], a[1] + t[1], a[2] + t[2])
        near = 0.5 * dot(between, between)
        normal = cross(a, t)
        half = 0.5 * twists[j]
        sine = math.sin(half)
        turned = (math.cos(half), a[0] * sine, a[1] * sine, a[2] * sine)
        d = mul(mul(transport_of(a, t), turned), rest)  # (4.11)
        for i in range(4):
            frames[j, i] = d[i]
        for i in range(3):
            tangents[0, j, i] = a[i]
            tangents[1, j, i] = t[i]
            edges[j, i] = e[i]
            binormals[j, i] = 2.0 * normal[i] / near  # (4.25)
        sizes[j] = size
        bent[j] = near
        if not near >= least:  # lets NaN through
            least = near
    return least


@jit
def hinge_rotations(frames, left, right, q, kappa):
    """Write q of (4.14), scalar part not negative, and kappa of (4.16), hinge by hinge."""
    for i in range(left.size):
        r = mul(conj(_quaternion(frames, left[i])), _quaternion(frames, right[i]))
        sign = -1.0 if r[0] < 0.0 else 1.0
        for c in range(4):
            q[i, c] = sign * r[c]
        for c in range(3):
            kappa[i, c] = 2.0 * q[i, c + 1]


@jit
def _add(band, i, j, value):
    if i >= 0 and j >= 0:
        if i >= j:
            band[j, i - j] += value
        else:
            band[i, j - i] += value


@jit
def assemble(
    positions, tangents, edges, sizes, binormals, bent, frames, q, stress, stiffness, left, right,
    lengths, modulus, forces, arms, multipliers, node_column, twist_column, row_column, gradient,
    values, band, order,
):  # fmt: skip
    r"""Add up stretching and dead forces; gradient of the Lagrangian; band of the KKT matrix.

    Parameters
    ----------
    positions, tangents, edges, sizes, binormals, bent, frames
        As in `reconstruct`; the frames of supports are behind those of the N segments.
    q, stress, stiffness : ndarray (n, 4), (n, 3), (n, 3, 3)
        Of the hinges: rotation, and derivatives of the energy with respect to kappa.
    left, right : ndarray (n,) of int64
        Frames that a hinge joins. Segments that are joined are neighbors.
    lengths : ndarray (N,)
        Rest lengths.
    modulus : float
        Stretching stiffness, or -1: then every segment with a column has a constraint.
    forces : ndarray (N + 1, 3)
    arms : ndarray (c, 7)
        Couples: number of a segment, force (spatial), arm (along the directors).
    multipliers : ndarray (N,)
        One for each segment; 0 where there is no constraint.
    node_column, twist_column, row_column : ndarray (N + 1, 3), (N,), (N,) of int64
        Columns of the band, or -1 for what is prescribed or absent.
    gradient : ndarray (columns,)
        Overwritten (order 1 and 2).
    values : ndarray (N,)
        Stretching measures of (4.17). Overwritten.
    band : ndarray (columns, w + 1)
        Overwritten (order 2).

    Returns
    -------
    energy : float
        Of stretching and of dead forces.
    """
    n = lengths.size
    energy = 0.0
    for i in range(n + 1):
        for c in range(3):
            energy -= forces[i, c] * positions[i, c]
    for j in range(n):
        values[j] = 0.5 * (sizes[j] * sizes[j] / lengths[j] - lengths[j])  # (4.17)
        if modulus >= 0.0:
            energy += 0.5 * modulus / lengths[j] * values[j] * values[j]
    jump = np.zeros((n, 3))  # coefficients of the second-order rotation vectors
    curvature = np.zeros((n, 3, 3))  # quadratic forms of the first-order ones
    for i in range(arms.shape[0]):
        j = int(arms[i, 0])
        force = (arms[i, 1], arms[i, 2], arms[i, 3])
        arm = turn(_quaternion(frames, j), (arms[i, 4], arms[i, 5], arms[i, 6]))
        energy -= dot(force, arm)
        couple = cross(arm, force)
        for r in range(3):
            jump[j, r] -= couple[r]
            curvature[j, r, r] += dot(force, arm)
            for c in range(3):
                curvature[j, r, c] -= 0.5 * (force[r] * arm[c] + arm[r] * force[c])
    if order == 0:
        return energy

    forms = np.empty((n, 3, 4))  # d^ = form . (e, phi)
    if order >= 2:
        band[:] = 0.0
        for j in range(n):
            t, k, f = _row(tangents[1], j), _row(binormals, j), 1.0 / sizes[j]
            for i in range(3):
                forms[j, i, 3] = t[i]
                for c in range(3):
                    forms[j, i, c] = -0.5 * f * t[i] * k[c]
            forms[j, 0, 1] -= f * t[2]
            forms[j, 0, 2] += f * t[1]
            forms[j, 1, 0] += f * t[2]
            forms[j, 1, 2] -= f * t[0]
            forms[j, 2, 0] -= f * t[1]
            forms[j, 2, 1] += f * t[0]

    push = np.empty((3, 3))  # C of kappa: delta kappa = C (conj(d^a) * w)
    turned = np.empty((3, 3))  # the same with d^a: columns in space
    square = np.empty((3, 3))
    joint = np.empty((3, 3))
    half = np.empty((3, 4))
    for i in range(left.size):
        a = left[i]
        b = right[i]
        s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        m0, m1, m2 = stress[i, 0], stress[i, 1], stress[i, 2]
        body = (s * m0 + y * m2 - z * m1, s * m1 + z * m0 - x * m2, s * m2 + x * m1 - y * m0)
        d = directors_of(_quaternion(frames, a))
        moment = (
            body[0] * d[0][0] + body[1] * d[1][0] + body[2] * d[2][0],
            body[0] * d[0][1] + body[1] * d[1][1] + body[2] * d[2][1],
            body[0] * d[0][2] + body[1] * d[1][2] + body[2] * d[2][2],
        )
        for c in range(3):
            if b < n:
                jump[b, c] += moment[c]
            if a < n:
                jump[a, c] -= moment[c]
        if order == 1:
            continue
        push[0, 0] = s
        push[1, 1] = s
        push[2, 2] = s
        push[0, 1] = z
        push[1, 0] = -z
        push[0, 2] = -y
        push[2, 0] = y
        push[1, 2] = x
        push[2, 1] = -x
        for r in range(3):
            for c in range(3):
                turned[r, c] = push[r, 0] * d[0][c] + push[r, 1] * d[1][c] + push[r, 2] * d[2][c]
        for r in range(3):
            for c in range(3):
                joint[r, c] = (
                    stiffness[i, r, 0] * turned[0, c]
                    + stiffness[i, r, 1] * turned[1, c]
                    + stiffness[i, r, 2] * turned[2, c]
                )
        for r in range(3):
            for c in range(3):
                square[r, c] = (
                    turned[0, r] * joint[0, c]
                    + turned[1, r] * joint[1, c]
                    + turned[2, r] * joint[2, c]
                )
        spin = 0.5 * (m0 * x + m1 * y + m2 * z)
        for r in range(3):
            square[r, r] -= spin
        for r in range(3):
            for c in range(3):
                if a < n:
                    curvature[a, r, c] += square[r, c]
                if b < n:
                    curvature[b, r, c] += square[r, c]
        if a >= n or b >= n:
            continue
        # b^ . joint . a^, twice: -square - [M]x / 2
        for r in range(3):
            for c in range(3):
                joint[r, c] = -square[r, c]
        joint[0, 1] += 0.5 * moment[2]
        joint[0, 2] -= 0.5 * moment[1]
        joint[1, 0] -= 0.5 * moment[2]
        joint[1, 2] += 0.5 * moment[0]
        joint[2, 0] += 0.5 * moment[1]
        joint[2, 1] -= 0.5 * moment[0]
        for r in range(3):
            for c in range(4):
                half[r, c] = (
                    joint[r, 0] * forms[a, 0, c]
                    + joint[r, 1] * forms[a, 1, c]
                    + joint[r, 2] * forms[a, 2, c]
                )
        for r in range(4):
            for c in range(4):
                value = (
                    forms[b, 0, r] * half[0, c]
                    + forms[b, 1, r] * half[1, c]
                    + forms[b, 2, r] * half[2, c]
                )
                # rows: edge and twist of b = a + 1; columns: edge and twist of a
                if r < 3 and c < 3:
                    _add(band, node_column[b + 1, r], node_column[b, c], value)
                    _add(band, node_column[b + 1, r], node_column[a, c], -value)
                    _add(band, node_column[b, r], node_column[a, c], value)
                    _add(band, node_column[b, r], node_column[b, c], -value)
                    if r == c:  # the transposed block: off the diagonal it lands in the same entry
                        _add(band, node_column[b, r], node_column[b, c], -value)
                elif r < 3:
                    _add(band, node_column[b + 1, r], twist_column[a], value)
                    _add(band, node_column[b, r], twist_column[a], -value)
                elif c < 3:
                    _add(band, twist_column[b], node_column[b, c], value)
                    _add(band, twist_column[b], node_column[a, c], -value)
                else:
                    _add(band, twist_column[b], twist_column[a], value)

    gradient[:] = 0.0
    for i in range(n + 1):
        for c in range(3):
            if node_column[i, c] >= 0:
                gradient[node_column[i, c]] -= forces[i, c]
    block = np.empty((4, 4))
    for j in range(n):
        t, k, f = _row(tangents[1], j), _row(binormals, j), 1.0 / sizes[j]
        e = _row(edges, j)
        load = _row(jump, j)
        along = dot(load, t)
        bend = cross(load, t)
        g = (
            bend[0] - 0.5 * along * k[0],
            bend[1] - 0.5 * along * k[1],
            bend[2] - 0.5 * along * k[2],
        )
        tension = multipliers[j]
        if modulus >= 0.0:
            tension = modulus / lengths[j] * values[j]
        if twist_column[j] >= 0:
            gradient[twist_column[j]] += along
        for c in range(3):
            value = f * g[c] + tension * e[c] / lengths[j]
            if node_column[j + 1, c] >= 0:
                gradient[node_column[j + 1, c]] += value
            if node_column[j, c] >= 0:
                gradient[node_column[j, c]] -= value
        if order == 1:
            continue
        for r in range(3):
            for c in range(4):
                half[r, c] = (
                    curvature[j, r, 0] * forms[j, 0, c]
                    + curvature[j, r, 1] * forms[j, 1, c]
                    + curvature[j, r, 2] * forms[j, 2, c]
                )
        for r in range(4):
            for c in range(4):
                block[r, c] = (
                    forms[j, 0, r] * half[0, c]
                    + forms[j, 1, r] * half[1, c]
                    + forms[j, 2, r] * half[2, c]
                )
        rest = _row(tangents[0], j)
        part = dot(rest, t)
        weight = 0.25 * along / bent[j]
        for r in range(3):
            across_r = load[r] - along * t[r]
            rest_r = rest[r] - part * t[r]
            block[r, 3] += 0.5 * f * across_r
            block[3, r] += 0.5 * f * across_r
            for c in range(3):
                across_c = load[c] - along * t[c]
                rest_c = rest[c] - part * t[c]
                block[r, c] += (
                    f
                    * f
                    * (
                        weight * (k[r] * rest_c + rest_r * k[c])
                        - (g[r] * t[c] + t[r] * g[c])
                        - 0.25 * (across_r * k[c] + k[r] * across_c)
                    )
                )
            block[r, r] += tension / lengths[j]
            if modulus >= 0.0:
                for c in range(3):
                    block[r, c] += modulus * e[r] * e[c] / lengths[j] ** 3
        for r in range(4):
            for c in range(4):
                value = block[r, c]
                if r < 3 and c < 3:
                    if c <= r:
                        _add(band, node_column[j, r], node_column[j, c], value)
                        _add(band, node_column[j + 1, r], node_column[j + 1, c], value)
                    _add(band, node_column[j + 1, r], node_column[j, c], -value)
                elif r == 3 and c < 3:
                    _add(band, twist_column[j], node_column[j, c], -value)
                    _add(band, twist_column[j], node_column[j + 1, c], value)
                elif r == 3:
                    _add(band, twist_column[j], twist_column[j], value)
        if row_column[j] >= 0:
            for c in range(3):
                value = e[c] / lengths[j]
                _add(band, row_column[j], node_column[j, c], -value)
                _add(band, row_column[j], node_column[j + 1, c], value)
    return energy


@jit
def largest_step(
    edges, sizes, tangents, binormals, frames, q, left, right, node_column, twist_column, dx
):
    """Return the largest fraction of `dx` that turns no edge by more than 50 degrees.

    Nor may the rotation across a hinge reach pi, to first order in the increment.
    """
    n = sizes.size
    fraction = 1.0
    turns = np.zeros((frames.shape[0], 3))
    for j in range(n):
        e0 = dx[node_column[j + 1, 0]] if node_column[j + 1, 0] >= 0 else 0.0
        e1 = dx[node_column[j + 1, 1]] if node_column[j + 1, 1] >= 0 else 0.0
        e2 = dx[node_column[j + 1, 2]] if node_column[j + 1, 2] >= 0 else 0.0
        e0 -= dx[node_column[j, 0]] if node_column[j, 0] >= 0 else 0.0
        e1 -= dx[node_column[j, 1]] if node_column[j, 1] >= 0 else 0.0
        e2 -= dx[node_column[j, 2]] if node_column[j, 2] >= 0 else 0.0
        e = (e0, e1, e2)
        change = math.sqrt(dot(e, e))
        if change * fraction > 0.75 * sizes[j]:  # arcsin 0.75 = 49 degrees
            fraction = 0.75 * sizes[j] / change
        t, k = _row(tangents[1], j), _row(binormals, j)
        normal = cross(t, e)
        spin = -0.5 * dot(k, e) / sizes[j]
        spin += dx[twist_column[j]] if twist_column[j] >= 0 else 0.0
        for c in range(3):
            turns[j, c] = normal[c] / sizes[j] + spin * t[c]
    for i in range(left.size):
        a, b = _row(turns, left[i]), _row(turns, right[i])
        w = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
        speed = math.sqrt(dot(w, w))
        sine = math.sqrt(q[i, 1] * q[i, 1] + q[i, 2] * q[i, 2] + q[i, 3] * q[i, 3])
        room = 0.9 * (math.pi - 2.0 * math.atan2(sine, q[i, 0]))
        if speed * fraction > room:
            fraction = room / speed
    return max(fraction, 1e-6)
