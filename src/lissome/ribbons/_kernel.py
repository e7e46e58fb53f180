r"""Compiled passes of the discrete ribbon: what its energy and constraints add to a rod's.

Each hinge has the strain :math:`\kappa` of the rod (integrated over its span l), a ruling parameter
:math:`\bar\eta` and its slope :math:`\eta'`, both combinations of up to three unknowns, and a fold variable
a. Its part of the Lagrangian is

.. math::

    l\,W(\kappa_1/l, \bar\eta, a) + \lambda_2\kappa_2 + \lambda_3(\kappa_3 - \bar\eta\kappa_1)
    + \mu\,(\tfrac12 w\eta' - \tanh a).

Its derivatives by :math:`\kappa` are the stress and the stiffness from which the rod's kernel makes
forces on the frames; the mixed ones become columns here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .._compile import jit as _jit
from ..rods._kernel import _add, _turn_vector
from .laws import density

jit = _jit(error_model="numpy", no_cfunc_wrapper=True)


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
    """

    where: np.ndarray
    mean: np.ndarray
    slope: np.ndarray
    column: np.ndarray
    local: np.ndarray


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
    kappa, span, eta, slope, folds, parameters, width, multipliers, values, rows, stress, stiffness, first,
    second, order,
):  # fmt: skip
    """Write energy, constraints (n, 3) and, by order, derivatives of the hinges.

    `first` (n, 2): derivatives by the ruling and by the fold. `second` (n, 6): mixed ones (strain and
    ruling; strain and fold), then by ruling twice, ruling and fold, fold twice, and the derivative of
    the hyperbolic tangent.
    """
    w = np.empty(10)
    with_fold = parameters[1] > 0.0
    for i in range(span.size):
        l = span[i]
        density(parameters, kappa[i, 0] / l, eta[i], folds[i], w)
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
            first[i, 1] = l * w[3] - multipliers[i, 2] * d
        if order >= 2:
            stiffness[i, 0, 0] = w[4]
            second[i, 0] = w[5] - multipliers[i, 1]
            second[i, 1] = w[6]
            second[i, 2] = l * w[7]
            second[i, 3] = l * w[8]
            second[i, 4] = l * w[9] + 2.0 * multipliers[i, 2] * t * d
            second[i, 5] = d


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
    column = np.empty(7, dtype=np.int64)
    coupling = np.zeros((7, 3))
    block = np.zeros((7, 7))
    g = np.zeros(3)
    for i in range(plan.left.size):
        for k in range(3):
            f = rulings.where[i, k]
            column[k] = rulings.column[f] if f >= 0 else -1
        for k in range(4):
            column[3 + k] = rulings.local[i, k]
        for k in range(3):
            if column[k] >= 0:
                gradient[column[k]] += rulings.mean[i, k] * first[i, 0]
                gradient[column[k]] += rulings.slope[i, k] * half * multipliers[i, 2]
        if column[3] >= 0:
            gradient[column[3]] += first[i, 1]
        if order < 2:
            continue
        # among rulings, fold and multipliers
        block[:] = 0.0
        for k in range(3):
            m = rulings.mean[i, k]
            for j in range(k + 1):
                block[k, j] = m * rulings.mean[i, j] * second[i, 2]
            block[3, k] = m * second[i, 3]
            block[5, k] = -m * kappa[i, 0]
            block[6, k] = rulings.slope[i, k] * half
        block[3, 3] = second[i, 4]
        block[6, 3] = -second[i, 5]
        for r in range(7):
            for k in range(r + 1):
                if block[r, k] != 0.0 and column[r] >= 0 and column[k] >= 0:
                    _add(band, border, corner, column[r], column[k], block[r, k])
        # with the frames
        coupling[:] = 0.0
        for k in range(3):
            coupling[k, 0] = rulings.mean[i, k] * second[i, 0]
        coupling[3, 0] = second[i, 1]
        coupling[4, 1] = 1.0
        coupling[5, 0] = -eta[i]
        coupling[5, 2] = 1.0
        s, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        for r in range(6):
            if column[r] < 0:
                continue
            c0, c1, c2 = coupling[r, 0], coupling[r, 1], coupling[r, 2]
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
