r"""Compiled passes of the discrete ribbon: what its energy and constraints add to a rod's.

Each hinge has the strain :math:`\kappa` of the rod (integrated over its span l), a ruling parameter
:math:`\bar\eta` and a slope :math:`\eta'`, both combinations of up to three unknowns, and a fold variable
a, which belongs to that slope. Its part of the Lagrangian is

.. math::

    l\,W(\kappa_1/l, \bar\eta, g) + \lambda_2\kappa_2 + \lambda_3(\kappa_3 - \bar\eta\kappa_1)
    + \mu\,(\tfrac12 w\eta' - \tanh a),\qquad g = \sigma\,a\coth a + \bar\sigma\,\bar a\coth\bar a,

with the shares :math:`\sigma, \bar\sigma` of its own fold variable and of that of the hinge before.
Its derivatives by :math:`\kappa` are the stress and the stiffness from which the rod's kernel makes
forces on the frames; the mixed ones become columns here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .._compile import jit as _jit
from ..rods._kernel import _add, _turn_vector
from .laws import complementary, cotangent_factor, density

jit = _jit(error_model="numpy", no_cfunc_wrapper=True)
# Called by compiled code only: less to compile.
inner = _jit(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)


class Rulings(NamedTuple):
    """How hinges depend on the unknowns of the rulings.

    Attributes
    ----------
    where : ndarray (n, 3) of int64
        Rulings that hinge i depends on; -1 where there are fewer than three.
    mean, slope : ndarray (n, 3)
        Weights with which they make the ruling parameter of the hinge and its derivative.
    column : ndarray (r,) of int64
        Position of each ruling; -1 where it is prescribed.
    local : ndarray (n, 4) of int64
        Positions of the fold variable and of the three multipliers (of kappa_2, of kappa_3, of the
        fold) of each hinge; -1 where the law has no fold.
    before : ndarray (n,) of int64
        The other fold variable that the energy of hinge i depends on; -1 if there is none.
    share : ndarray (n, 2)
        Parts of hinge i that have its own fold variable, and the other one.
    """

    where: np.ndarray
    mean: np.ndarray
    slope: np.ndarray
    column: np.ndarray
    local: np.ndarray
    before: np.ndarray
    share: np.ndarray


@jit
def hinge_rulings(rulings, plan, eta, slope):
    """Write the ruling parameter and its slope at each hinge."""
    for i in range(plan.where.shape[0]):
        h = 0.0
        s = 0.0
        for k in range(3):
            f = plan.where[i, k]
            if f >= 0:
                h += plan.mean[i, k] * rulings[f]
                s += plan.slope[i, k] * rulings[f]
        eta[i] = h
        slope[i] = s


@jit
def evaluate_hinges(
    kappa, span, eta, slope, folds, before, share, parameters, width, multipliers, values, rows, stress,
    stiffness, first, second, order,
):  # fmt: skip
    """Write energy, constraints (n, 3) and, by order, derivatives of the hinges.

    `first` (n, 4): derivatives of the energy by the ruling, the fold and the other fold, and of the
    constraint of the fold by the fold. `second` (n, 10): mixed ones (strain and ruling; strain and
    either fold), by ruling twice, ruling and either fold, either fold twice, and, of the constraint, the
    derivative of the hyperbolic tangent and the second derivative.
    """
    w = np.empty(9)
    with_fold = parameters[1] > 0.0
    for i in range(span.size):
        l = span[i]
        g = 1.0
        g0, dg0, ddg0 = 0.0, 0.0, 0.0
        g1, dg1, ddg1 = 0.0, 0.0, 0.0
        if with_fold:
            g0, dg0, ddg0 = cotangent_factor(folds[i])
            g = share[i, 0] * g0
            if before[i] >= 0:
                g1, dg1, ddg1 = cotangent_factor(folds[before[i]])
                g += share[i, 1] * g1
        density(parameters, kappa[i, 0] / l, eta[i], g, w)
        values[i] = w[0]
        t = math.tanh(folds[i])
        d = 1.0 - t * t
        rows[i, 0] = kappa[i, 1]  # (4.35)
        rows[i, 1] = kappa[i, 2] - eta[i] * kappa[i, 0]  # (4.35)
        rows[i, 2] = 0.5 * width * slope[i] - t if with_fold else 0.0
        if order >= 1:
            stress[i, 0] = w[1] - multipliers[i, 1] * eta[i]
            stress[i, 1] = multipliers[i, 0]
            stress[i, 2] = multipliers[i, 1]
            first[i, 0] = l * w[2] - multipliers[i, 1] * kappa[i, 0]
            first[i, 1] = l * w[3] * share[i, 0] * dg0
            first[i, 2] = l * w[3] * share[i, 1] * dg1
            first[i, 3] = -multipliers[i, 2] * d
        if order >= 2:
            stiffness[i, 0, 0] = w[4]
            second[i, 0] = w[5] - multipliers[i, 1]
            second[i, 1] = w[6] * share[i, 0] * dg0
            second[i, 2] = w[6] * share[i, 1] * dg1
            second[i, 3] = l * w[7]
            second[i, 4] = l * w[8] * share[i, 0] * dg0
            second[i, 5] = l * w[8] * share[i, 1] * dg1
            second[i, 6] = l * w[3] * share[i, 0] * ddg0
            second[i, 7] = l * w[3] * share[i, 1] * ddg1
            second[i, 8] = d
            second[i, 9] = 2.0 * multipliers[i, 2] * t * d


@jit
def add_rulings(
    q,
    kappa,
    eta,
    plan,
    rulings,
    width,
    multipliers,
    first,
    second,
    gradient,
    band,
    border,
    corner,
    order,
):
    """Add what the rulings, folds and multipliers of the hinges add to gradient and matrix."""
    half = 0.5 * width
    # three rulings, the fold and the other fold, three multipliers
    column = np.empty(8, dtype=np.int64)
    coupling = np.zeros((7, 3))
    block = np.zeros((8, 8))
    g = np.zeros(3)
    for i in range(plan.left.size):
        for k in range(3):
            f = rulings.where[i, k]
            column[k] = rulings.column[f] if f >= 0 else -1
        column[3] = rulings.local[i, 0]
        column[4] = rulings.local[rulings.before[i], 0] if rulings.before[i] >= 0 else -1
        for k in range(1, 4):
            column[4 + k] = rulings.local[i, k]
        for k in range(3):
            if column[k] >= 0:
                gradient[column[k]] += rulings.mean[i, k] * first[i, 0]
                gradient[column[k]] += rulings.slope[i, k] * half * multipliers[i, 2]
        if column[3] >= 0:
            gradient[column[3]] += first[i, 1] + first[i, 3]
        if column[4] >= 0:
            gradient[column[4]] += first[i, 2]
        if order < 2:
            continue
        # among rulings, fold and multipliers
        block[:] = 0.0
        for k in range(3):
            m = rulings.mean[i, k]
            for j in range(k + 1):
                block[k, j] = m * rulings.mean[i, j] * second[i, 3]
            block[3, k] = m * second[i, 4]
            block[4, k] = m * second[i, 5]
            block[6, k] = -m * kappa[i, 0]
            block[7, k] = rulings.slope[i, k] * half
        block[3, 3] = second[i, 6] + second[i, 9]
        block[4, 4] = second[i, 7]
        block[7, 3] = -second[i, 8]
        for r in range(8):
            for k in range(r + 1):
                if block[r, k] != 0.0 and column[r] >= 0 and column[k] >= 0:
                    _add(band, border, corner, column[r], column[k], block[r, k])
        # with the frames
        coupling[:] = 0.0
        for k in range(3):
            coupling[k, 0] = rulings.mean[i, k] * second[i, 0]
        coupling[3, 0] = second[i, 1]
        coupling[4, 0] = second[i, 2]
        coupling[5, 1] = 1.0
        coupling[6, 0] = -eta[i]
        coupling[6, 2] = 1.0
        s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        for r in range(7):
            c0, c1, c2 = coupling[r, 0], coupling[r, 1], coupling[r, 2]
            if column[r] < 0 or (c0 == 0.0 and c1 == 0.0 and c2 == 0.0):
                continue
            w0 = c1 * z - c2 * y
            w1 = c2 * x - c0 * z
            w2 = c0 * y - c1 * x
            for side in range(2):
                f = plan.left[i] if side == 0 else plan.right[i]
                c = plan.column[f]
                if c < 0:
                    continue
                sign = -s if side == 0 else s
                g[0] = w0 + sign * c0
                g[1] = w1 + sign * c1
                g[2] = w2 + sign * c2
                if side == 1 and plan.twist[i, 1] != 0.0:
                    _turn_vector(g, plan.twist[i, 0], plan.twist[i, 1])
                if plan.turning[f]:
                    value = plan.axis[f, 0] * g[0] + plan.axis[f, 1] * g[1] + plan.axis[f, 2] * g[2]
                    _add(band, border, corner, column[r], c, value)
                else:
                    for k in range(3):
                        _add(band, border, corner, column[r], c + k, g[k])


@jit
def add_moments(q, plan, local, band, border):
    """Add what moments that are unknowns have to do with frames: each turns about its own director.

    Moments are in the band. (Calls for each entry would cost more than all the rest.)
    """
    length = band.shape[0]
    g = np.empty(3)
    for i in range(plan.left.size):
        s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        for r in range(3):
            # vector part of the rotation times the director
            if r == 0:
                w0, w1, w2 = 0.0, -z, y
            elif r == 1:
                w0, w1, w2 = z, 0.0, -x
            else:
                w0, w1, w2 = -y, x, 0.0
            for side in range(2):
                f = plan.left[i] if side == 0 else plan.right[i]
                c = plan.column[f]
                if c < 0:
                    continue
                g[0], g[1], g[2] = w0, w1, w2
                g[r] = -s if side == 0 else s
                if side == 1 and plan.twist[i, 1] != 0.0:
                    _turn_vector(g, plan.twist[i, 0], plan.twist[i, 1])
                count = 3
                if plan.turning[f]:
                    count = 1
                    g[0] = plan.axis[f, 0] * g[0] + plan.axis[f, 1] * g[1] + plan.axis[f, 2] * g[2]
                row = local[i, r]
                for k in range(count):
                    if c + k >= length:
                        border[row, c + k - length] += g[k]
                    else:
                        band[min(row, c + k), abs(row - c - k)] += g[k]


@inner
def _put(band, a, b, value):
    """Add an entry of the lower triangle, unless one of its places is that of a prescribed value."""
    if a >= 0 and b >= 0:
        band[min(a, b), abs(a - b)] += value


@jit
def add_cells(
    ahead, base, shape, column, local, fluxes, rulings, moments, multipliers, stiffness, width, points,
    weights, rows, slopes, gradient, band, order,
):  # fmt: skip
    """Add what the cells between hinges add; return their energy.

    Moments in cell i are those of the four hinges from ``base[i]``, weighted by ``shape[i]`` (parts,
    points, 4). Rulings are linear between the ends of the parts of a cell, and the flux is one in each
    part. The ribbon is open, so that all places are in the band.
    """
    energy = 0.0
    parts = shape.shape[1]
    out = np.empty(11)
    # Lower triangles of sums over the points. Of a cell: work of the moments m1 and m3 on each other.
    k1, k3 = np.zeros(4), np.zeros(4)
    s11, s31, s33 = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 4))
    # Of a part: of the rulings at its ends, and of its flux, with the moments.
    b1, b3, a1, a3, f1, f3 = (
        np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    )  # fmt: skip
    for i in range(ahead.size - 1):
        length = ahead[i] / parts
        first = base[i]
        k1[:], k3[:] = 0.0, 0.0
        s11[:], s31[:], s33[:] = 0.0, 0.0, 0.0
        for part in range(parts):
            r0 = i * parts + part
            before, after = rulings[r0], rulings[r0 + 1]
            flux = multipliers[r0] / length
            half = 0.5 * width / length
            slope = half * (after - before)
            d0, d1 = 0.0, 0.0
            bb, ba, aa, fb, fa, ff = 0.0, 0.0, 0.0, -half, half, 0.0
            if order >= 2:
                b1[:], b3[:], a1[:], a3[:], f1[:], f3[:] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(points.size):
                x1 = points[k]
                x0 = 1.0 - x1
                h = x0 * before + x1 * after
                m1, m3 = 0.0, 0.0
                for j in range(4):
                    m1 += shape[i, part, k, j] * moments[first + j, 0]
                    m3 += shape[i, part, k, j] * moments[first + j, 2]
                complementary(stiffness, m1 + h * m3, h, flux, out)
                w = weights[k]
                lw = length * w
                energy += lw * out[1]
                slope -= w * out[4]
                u = lw * out[2]
                for j in range(4):
                    k1[j] += shape[i, part, k, j] * u
                    k3[j] += shape[i, part, k, j] * u * h
                if order >= 1:
                    u = lw * (out[3] + out[2] * m3)
                    d0 += x0 * u
                    d1 += x1 * u
                if order >= 2:
                    pp, ph, pm = lw * out[5], lw * out[6], w * out[7]
                    h1 = pp * m3 + ph
                    h3 = h * h1 + lw * out[2]
                    hh = (h1 + ph) * m3 + lw * out[8]
                    u = pm * m3 + w * out[9]
                    bb -= x0 * x0 * hh
                    ba -= x0 * x1 * hh
                    aa -= x1 * x1 * hh
                    fb -= x0 * u
                    fa -= x1 * u
                    ff -= w * out[10]
                    for j in range(4):
                        y = shape[i, part, k, j]
                        b1[j] -= y * x0 * h1
                        a1[j] -= y * x1 * h1
                        b3[j] -= y * x0 * h3
                        a3[j] -= y * x1 * h3
                        f1[j] -= y * pm
                        f3[j] -= y * pm * h
                        for n in range(j + 1):
                            z = y * shape[i, part, k, n] * pp
                            s11[j, n] -= z
                            s31[j, n] -= z * h
                            s33[j, n] -= z * h * h
            slopes[r0] = slope
            at0, at1, at = column[r0], column[r0 + 1], fluxes[r0]
            if order >= 1:
                if at0 >= 0:
                    gradient[at0] -= d0 + half * multipliers[r0]
                if at1 >= 0:
                    gradient[at1] -= d1 - half * multipliers[r0]
            if order >= 2:
                _put(band, at0, at0, bb)
                _put(band, at0, at1, ba)
                _put(band, at1, at1, aa)
                _put(band, at, at0, fb)
                _put(band, at, at1, fa)
                _put(band, at, at, ff / length)
                for j in range(4):
                    one, three = local[first + j, 0], local[first + j, 2]
                    _put(band, one, at0, b1[j])
                    _put(band, one, at1, a1[j])
                    _put(band, one, at, f1[j])
                    _put(band, three, at0, b3[j])
                    _put(band, three, at1, a3[j])
                    _put(band, three, at, f3[j])
        for j in range(4):
            rows[first + j, 0] -= k1[j]
            rows[first + j, 2] -= k3[j]
            if order >= 2:
                for n in range(j + 1):
                    _put(band, local[first + j, 0], local[first + n, 0], s11[j, n])
                    _put(band, local[first + j, 2], local[first + n, 2], s33[j, n])
                    _put(band, local[first + j, 2], local[first + n, 0], s31[j, n])
                    if n < j:
                        _put(band, local[first + n, 2], local[first + j, 0], s31[j, n])
    return energy
