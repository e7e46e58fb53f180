r"""Compiled symmetric factorizations of a scalar chain with a border, and Newton's method on them.

The equilibrium equations of a chain of scalar unknowns under a few global constraints have the
matrix

.. math:: K = \begin{pmatrix} H & J^T \\ J & 0 \end{pmatrix},

with :math:`H` symmetric tridiagonal and :math:`J` dense with few rows.  :math:`H` is factorized as
:math:`L D L^T` with the 1 x 1 and 2 x 2 pivots of Bunch (1974), which needs no interchanges and is
backward stable; the border is eliminated by a Schur complement, whose inertia adds to that of
:math:`H` (Haynsworth).  With these pivots near-singularity of :math:`H` can only appear in the very
last pivot (off-diagonal entries that are not tiny assumed).  That case is ordinary: a buckled chain
is held stable by its constraints, and :math:`H` alone passes through singularity.  The last pivot
is then raised and the change undone exactly in the border, so that the Schur complement stays well
scaled.

All arrays of a problem live in one `ChainWork`: few large arrays compile several times faster than
many small ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lissome._compile import jit as _jit

# Zero divisors are excluded by the algorithms; the test in front of every division is not needed.
jit = _jit(error_model="numpy", no_cfunc_wrapper=True)

# Bunch's constant for tridiagonal matrices balances the growth of 1 x 1 and 2 x 2 pivots.
_BUNCH = (math.sqrt(5.0) - 1.0) / 2.0
# Bunch and Parlett's constant, complete pivoting of the small dense border.
_PARLETT = (1.0 + math.sqrt(17.0)) / 8.0
# A last pivot below this fraction of the largest entry is moved to the border.
_WEAK = 1e-3

# Rows of `ChainWork.band`.
GRADIENT, DIAGONAL, OFF_DIAGONAL, PIVOT, COUPLING, LOWER, SAVED = range(7)


class ChainWork(NamedTuple):
    """Arrays of a chain of n unknowns under m constraints.

    Attributes
    ----------
    band : ndarray (7, n)
        Gradient of the Lagrangian; diagonal and off-diagonal of H; its factors (inverse pivots,
        their 2 x 2 coupling or 0, multipliers); and a saved diagonal.
    rows : ndarray (m, n)
        J.
    constraints : ndarray (m,)
    columns : ndarray (n, m + 2)
        :math:`H^{-1} J^T`, one column for a raised last pivot, and in the last column the
        right-hand side, overwritten by the solution.
    dense : ndarray (m + 4, m + 1)
        The factors of the Schur complement of the border, and in the last three rows the
        right-hand side of the border (overwritten by the solution) and scratch.
    integers : ndarray (2, m + 1) of int64
        Interchanges and pivot sizes of the border.
    """

    band: np.ndarray
    rows: np.ndarray
    constraints: np.ndarray
    columns: np.ndarray
    dense: np.ndarray
    integers: np.ndarray


def chain_work(n: int, m: int) -> ChainWork:
    """Allocate a `ChainWork` for ``n`` unknowns and ``m`` constraints."""
    return ChainWork(
        np.zeros((7, n)),
        np.zeros((m, n)),
        np.zeros(m),
        np.zeros((n, m + 2)),
        np.zeros((m + 4, m + 1)),
        np.zeros((2, m + 1), dtype=np.int64),
    )


@jit
def _factorize_band(band, raise_weak):
    """Factorize the tridiagonal matrix; returns its inertia and what was added to the last pivot."""
    n = band.shape[1]
    scale = 0.0
    for k in range(n):
        scale = max(scale, abs(band[DIAGONAL, k]))
        if k < n - 1:
            scale = max(scale, abs(band[OFF_DIAGONAL, k]))
    positive = 0
    negative = 0
    zero = 0
    raised = 0.0
    a = band[DIAGONAL, 0]
    k = 0
    while k < n:
        b = band[OFF_DIAGONAL, k] if k < n - 1 else 0.0
        if k == n - 1 or scale * abs(a) >= _BUNCH * b * b:
            if k == n - 1 and raise_weak and abs(a) <= _WEAK * scale:
                raised = scale
                a += raised
            band[COUPLING, k] = 0.0
            band[PIVOT, k] = 0.0
            if a > 0.0:
                positive += 1
                band[PIVOT, k] = 1.0 / a
            elif a < 0.0:
                negative += 1
                band[PIVOT, k] = 1.0 / a
            else:  # then b is zero too: an isolated null row
                zero += 1
            band[LOWER, k] = b * band[PIVOT, k]
            if k < n - 1:
                a = band[DIAGONAL, k + 1] - band[LOWER, k] * b
            k += 1
        else:
            # |a| < alpha b^2 / scale and |c| <= scale: the determinant is negative.
            c = band[DIAGONAL, k + 1]
            inverse = 1.0 / (a * c - b * b)
            positive += 1
            negative += 1
            band[PIVOT, k] = c * inverse
            band[PIVOT, k + 1] = a * inverse
            band[COUPLING, k] = -b * inverse
            band[COUPLING, k + 1] = 0.0
            b2 = band[OFF_DIAGONAL, k + 1] if k + 2 < n else 0.0
            band[LOWER, k] = band[COUPLING, k] * b2
            band[LOWER, k + 1] = band[PIVOT, k + 1] * b2
            if k + 2 < n:
                a = band[DIAGONAL, k + 2] - b2 * band[LOWER, k + 1]
            k += 2
    return positive, negative, zero, raised


@jit
def _solve_band(band, columns, start, stop):
    """Overwrite the columns ``start`` to ``stop`` by the solutions with the band's factors."""
    n = columns.shape[0]
    k = 0
    while k < n:
        if band[COUPLING, k] == 0.0:
            lower = band[LOWER, k]
            pivot = band[PIVOT, k]
            for j in range(start, stop):
                u = columns[k, j]
                if k + 1 < n:
                    columns[k + 1, j] -= lower * u
                columns[k, j] = pivot * u
            k += 1
        else:
            for j in range(start, stop):
                u = columns[k, j]
                v = columns[k + 1, j]
                if k + 2 < n:
                    columns[k + 2, j] -= band[LOWER, k] * u + band[LOWER, k + 1] * v
                columns[k, j] = band[PIVOT, k] * u + band[COUPLING, k] * v
                columns[k + 1, j] = band[COUPLING, k] * u + band[PIVOT, k + 1] * v
            k += 2
    k = n - 2
    while k >= 0:
        # Row k belongs to a 2 x 2 pivot with k - 1: both see row k + 1.
        twin = k >= 1 and band[COUPLING, k - 1] != 0.0
        if band[COUPLING, k] == 0.0:
            for j in range(start, stop):
                u = columns[k + 1, j]
                columns[k, j] -= band[LOWER, k] * u
                if twin:
                    columns[k - 1, j] -= band[LOWER, k - 1] * u
        k -= 2 if twin else 1


@jit
def _factorize_dense(dense, integers, m):
    """Factorize the leading m x m block in place, with complete pivoting.

    Returns the inertia, and smallest and largest modulus of the eigenvalues of the pivots.
    """
    positive = 0
    negative = 0
    zero = 0
    smallest = np.inf
    largest = 0.0
    for i in range(m):
        integers[0, i] = i
    k = 0
    while k < m:
        best_diagonal = -1.0
        best_off = -1.0
        r = k
        p = k
        q = k
        for i in range(k, m):
            if abs(dense[i, i]) > best_diagonal:
                best_diagonal = abs(dense[i, i])
                r = i
            for j in range(k, i):
                if abs(dense[i, j]) > best_off:
                    best_off = abs(dense[i, j])
                    p = j
                    q = i
        size = 1 if best_diagonal >= _PARLETT * best_off else 2
        for turn in range(size):
            a = k + turn
            b = r
            if size == 2:
                b = p if turn == 0 else q
            if a != b:
                for j in range(m):
                    t = dense[a, j]
                    dense[a, j] = dense[b, j]
                    dense[b, j] = t
                for i in range(m):
                    t = dense[i, a]
                    dense[i, a] = dense[i, b]
                    dense[i, b] = t
                index = integers[0, a]
                integers[0, a] = integers[0, b]
                integers[0, b] = index
        integers[1, k] = size
        if size == 1:
            d = dense[k, k]
            smallest = min(smallest, abs(d))
            largest = max(largest, abs(d))
            if d > 0.0:
                positive += 1
            elif d < 0.0:
                negative += 1
            else:
                zero += 1
            if d != 0.0:
                for i in range(k + 1, m):
                    factor = dense[i, k] / d
                    for j in range(k + 1, i + 1):
                        dense[i, j] -= factor * dense[j, k]
                        dense[j, i] = dense[i, j]
                for i in range(k + 1, m):
                    dense[i, k] /= d
        else:
            integers[1, k + 1] = 0
            a2 = dense[k, k]
            b2 = dense[k + 1, k]
            c2 = dense[k + 1, k + 1]
            determinant = a2 * c2 - b2 * b2
            positive += 1
            negative += 1
            middle = 0.5 * (a2 + c2)
            radius = math.sqrt(0.25 * (a2 - c2) ** 2 + b2 * b2)
            big = max(abs(middle + radius), abs(middle - radius))
            smallest = min(smallest, abs(determinant) / big)
            largest = max(largest, big)
            for i in range(k + 2, m):
                u = (c2 * dense[i, k] - b2 * dense[i, k + 1]) / determinant
                v = (a2 * dense[i, k + 1] - b2 * dense[i, k]) / determinant
                for j in range(k + 2, i + 1):
                    dense[i, j] -= u * dense[j, k] + v * dense[j, k + 1]
                    dense[j, i] = dense[i, j]
            # The old entries of columns k, k + 1 were needed in all rows: store multipliers now.
            for i in range(k + 2, m):
                u = (c2 * dense[i, k] - b2 * dense[i, k + 1]) / determinant
                v = (a2 * dense[i, k + 1] - b2 * dense[i, k]) / determinant
                dense[i, k] = u
                dense[i, k + 1] = v
        k += size
    return positive, negative, zero, smallest, largest


@jit
def _solve_dense(dense, integers, m, values, work):
    """Solve with the factors; right-hand side and solution in row ``values``, scratch ``work``."""
    for i in range(m):
        dense[work, i] = dense[values, integers[0, i]]
    k = 0
    while k < m:
        size = integers[1, k]
        for i in range(k + size, m):
            dense[work, i] -= dense[i, k] * dense[work, k]
            if size == 2:
                dense[work, i] -= dense[i, k + 1] * dense[work, k + 1]
        k += size
    k = 0
    while k < m:
        if integers[1, k] == 1:
            d = dense[k, k]
            dense[work, k] = dense[work, k] / d if d != 0.0 else 0.0
            k += 1
        else:
            a = dense[k, k]
            b = dense[k + 1, k]
            c = dense[k + 1, k + 1]
            determinant = a * c - b * b
            u = dense[work, k]
            v = dense[work, k + 1]
            dense[work, k] = (c * u - b * v) / determinant
            dense[work, k + 1] = (a * v - b * u) / determinant
            k += 2
    k = m - 1
    while k >= 0:
        size = 2 if integers[1, k] == 0 else 1
        first = k - size + 1
        for i in range(k + 1, m):
            dense[work, first] -= dense[i, first] * dense[work, i]
            if size == 2:
                dense[work, k] -= dense[i, k] * dense[work, i]
        k -= size
    for i in range(m):
        dense[values, integers[0, i]] = dense[work, i]


@jit
def factorize(work):
    """Factorize the bordered matrix whose entries ``work`` holds.

    Returns
    -------
    raised : float
        What was added to the last diagonal entry (undone in the border); an argument of `solve`.
    positive, negative, zero : int
        Inertia of the bordered matrix.
    weakest : float
        Smallest pivot of the border over its largest: about the reciprocal of its condition.
    """
    band = work.band
    rows = work.rows
    columns = work.columns
    dense = work.dense
    n = band.shape[1]
    m = rows.shape[0]
    positive, negative, zero, raised = _factorize_band(band, m > 0)
    k = m + 1 if raised > 0.0 else m
    for i in range(n):
        for j in range(m):
            columns[i, j] = rows[j, i]
        # H = H~ - raised e e^T with e the last unit vector. The auxiliary unknown
        # t = raised e^T x makes this [[H~, -e], [-e^T, 1/raised]], whose inertia is that of H
        # and one positive pivot.
        columns[i, m] = 0.0
    columns[n - 1, m] = -1.0
    # Not the literal 0: numba compiles a function once more for each literal among its arguments.
    _solve_band(band, columns, k - k, k)
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            if i < m:
                for p in range(n):
                    total -= rows[i, p] * columns[p, j]
            else:
                total = columns[n - 1, j]
            if i == m and j == m:
                total += 1.0 / raised
            dense[i, j] = total
            dense[j, i] = total
    p2, n2, z2, smallest, largest = _factorize_dense(dense, work.integers, k)
    positive += p2
    negative += n2
    zero += z2
    if raised > 0.0:
        positive -= 1
    weakest = 1.0
    if k > 0:
        weakest = smallest / largest if largest > 0.0 else 0.0
    return raised, positive, negative, zero, weakest


@jit
def solve(work, raised):
    """Solve with the factors, in place.

    The right-hand sides are the last column of ``work.columns`` (n,) and the third last row of
    ``work.dense`` (its first m entries).
    """
    rows = work.rows
    columns = work.columns
    dense = work.dense
    n = columns.shape[0]
    m = rows.shape[0]
    k = m + 1 if raised > 0.0 else m
    c = m + 1
    border = m + 1
    values = m + 2
    _solve_band(work.band, columns, c, c + 1)
    for i in range(m):
        total = dense[border, i]
        for p in range(n):
            total -= rows[i, p] * columns[p, c]
        dense[values, i] = total
    if k > m:
        dense[values, m] = columns[n - 1, c]
    _solve_dense(dense, work.integers, k, values, m + 3)
    for i in range(m):
        dense[border, i] = dense[values, i]
    for p in range(n):
        total = columns[p, c]
        for i in range(k):
            total -= columns[p, i] * dense[values, i]
        columns[p, c] = total


@jit
def newton_step(work, raised, x, multipliers):
    """Solve with the residual and the factors held by ``work`` and add the step in place.

    Returns the largest modulus of the step of ``x``.
    """
    m = multipliers.size
    for i in range(x.size):
        work.columns[i, m + 1] = -work.band[GRADIENT, i]
    for j in range(m):
        work.dense[m + 1, j] = -work.constraints[j]
    solve(work, raised)
    largest = 0.0
    for i in range(x.size):
        largest = max(largest, abs(work.columns[i, m + 1]))
        x[i] += work.columns[i, m + 1]
    for j in range(m):
        multipliers[j] += work.dense[m + 1, j]
    return largest


CONVERGED = 0
SLOW = 1  # the iteration limit
LOST = 2  # a step beyond the longest one allowed, or a number that is not finite


@jit
def _residual(work):
    """Largest modulus in gradient and constraints; infinite if any is not a number."""
    largest = 0.0
    for i in range(work.band.shape[1]):
        value = abs(work.band[GRADIENT, i])
        if not value < np.inf:
            return np.inf
        largest = max(largest, value)
    for j in range(work.constraints.size):
        value = abs(work.constraints[j])
        if not value < np.inf:
            return np.inf
        largest = max(largest, value)
    return largest


@jit
def smallest_eigenpair(masses, work, mode):
    r"""Smallest constrained eigenvalue :math:`H u = \mu M u`, :math:`J u = 0`, at a stable point.

    Inverse iteration on the bordered matrix held by ``work``.  The factors in ``work`` are
    overwritten; ``mode`` (n,) receives the eigenvector, :math:`u^T M u = 1`.  The last shift lies
    below the eigenvalue with no eigenvalue in between, as counted by inertia, so the value is the
    smallest one.

    Parameters
    ----------
    masses : ndarray (n,)
        Diagonal of :math:`M`.
    work : ChainWork
        Holds the derivatives at the point.
    mode : ndarray (n,)

    Returns
    -------
    eigenvalue : float
        NaN if the point is not stable or the iteration did not converge.
    """
    band = work.band
    columns = work.columns
    n = masses.size
    m = work.constraints.size
    for i in range(n):
        band[SAVED, i] = band[DIAGONAL, i]
        # Any start with a part along every mode; deterministic.
        mode[i] = 1.0 + 0.5 * math.cos(1.7 * i) + 0.3 * math.sin(9.0 * (i + 1.0) / n)
    shift = 0.0
    value = np.inf
    low = 0.0
    result = np.nan
    for attempt in range(40):
        for i in range(n):
            band[DIAGONAL, i] = band[SAVED, i] - shift * masses[i]
        raised, _, negative, zero, _ = factorize(work)
        if negative != m or zero != 0:
            if attempt == 0:
                break  # not stable
            shift = 0.5 * (low + shift)  # an eigenvalue lies below: step back
            continue
        low = shift
        converged = False
        for _ in range(5):
            for i in range(n):
                columns[i, m + 1] = masses[i] * mode[i]
            for j in range(m):
                work.dense[m + 1, j] = 0.0
            solve(work, raised)
            norm = 0.0
            for i in range(n):
                norm += masses[i] * columns[i, m + 1] ** 2
            norm = 1.0 / math.sqrt(norm)
            for i in range(n):
                mode[i] = columns[i, m + 1] * norm
            new = 0.0  # Rayleigh quotient
            for i in range(n):
                new += band[SAVED, i] * mode[i] ** 2
                if i < n - 1:
                    new += 2.0 * band[OFF_DIAGONAL, i] * mode[i] * mode[i + 1]
            converged = abs(new - value) <= 1e-11 * abs(new) + 1e-13 * abs(band[SAVED, 0])
            value = new
        if converged and attempt > 0:
            result = value
            break
        shift = max(low, value - 0.02 * abs(value - low))
    for i in range(n):
        band[DIAGONAL, i] = band[SAVED, i]
    return result


def make_solvers(evaluate):
    """Return the compiled functions ``correct`` and ``descend`` for one kind of scalar chain.

    Parameters
    ----------
    evaluate : compiled function
        ``evaluate(data, x, multipliers, work)`` fills the first three rows of ``work.band`` with the
        derivatives of the Lagrangian, ``work.constraints`` and ``work.rows``, and returns the
        energy.

    Returns
    -------
    correct, descend : compiled functions
        See their docstrings.
    """

    @jit
    def correct(x, multipliers, data, tolerance, limit, longest, work):
        """Newton's method on the stationarity conditions of a scalar chain, from a nearby guess.

        Parameters
        ----------
        x, multipliers : ndarray (n,), (m,)
            Guess; overwritten by the solution.
        data : tuple
            Passed on.
        tolerance : float
            On the largest modulus in gradient and constraints; not below their rounding errors.
        limit : float
            Newton steps allowed (a float: numba compiles anew for each literal integer).
        longest : float
            Longest step (largest modulus) allowed; beyond it the guess was not near.
        work : ChainWork

        Returns
        -------
        status : int
            0 converged, 1 more steps needed, 2 lost.
        steps : int
        energy, residual : float
        raised : float
            Of the factors in ``work``, which belong to the returned point (if status < 2).
        positive, negative, zero : int
            Inertia of the KKT matrix at the returned point: a minimum has ``negative == m``.
        weakest : float
        """
        steps = 0
        while True:
            energy = evaluate(data, x, multipliers, work)
            residual = _residual(work)
            status = -1
            if residual < np.inf:
                raised, positive, negative, zero, weakest = factorize(work)
                if residual <= tolerance:
                    status = CONVERGED
                elif steps >= limit:
                    status = SLOW
                else:
                    length = newton_step(work, raised, x, multipliers)
                    steps += 1
                    if not length <= longest:
                        status = LOST
            else:
                raised, positive, negative, zero, weakest = 0.0, 0, 0, 0, 0.0
                status = LOST
            if status >= 0:
                return status, steps, energy, residual, raised, positive, negative, zero, weakest

    @jit
    def descend(x, multipliers, data, masses, tolerance, limit, longest, work):
        """Descend to a minimum of the energy under the constraints, from anywhere.

        Sequential quadratic steps with the least proximal term ``shift * masses`` that gives the
        right inertia (so that each step is a direction of descent of the l1 merit function), a line
        search, and `correct` near the end.  Arguments are those of `correct`, and ``masses`` (n,).

        Returns
        -------
        status : int
            0: a minimum (the inertia is right), 1: the limit of iterations, 2: lost.
        iterations : int
        energy, residual : float
        """
        n = x.size
        m = multipliers.size
        band = work.band
        old = np.empty((2, n + m))  # point, full step
        shift = 0.0
        penalty = 0.0
        energy = 0.0
        residual = np.inf
        scale = 0.0  # of eigenvalues: the trace of H over that of M, divided by n^2
        for iteration in range(limit):
            energy = evaluate(data, x, multipliers, work)
            residual = _residual(work)
            if not residual < np.inf:
                return LOST, iteration, energy, residual
            for i in range(n):
                old[0, i] = x[i]
                band[SAVED, i] = band[DIAGONAL, i]
            for j in range(m):
                old[0, n + j] = multipliers[j]
            if iteration == 0:
                trace = 0.0
                total = 0.0
                for i in range(n):
                    trace += abs(band[DIAGONAL, i])
                    total += masses[i]
                scale = trace / total / (n * n)
            # Shift until the curvature on the constraints exceeds a margin: near a fold the step
            # would else be long and its multipliers useless as a penalty.
            margin = 0.5 * scale
            shift = 0.25 * shift if shift > 0.5 * margin else 0.0
            closing = residual <= 1e-5  # try without any shift first
            raised = 0.0
            for turn in range(60):
                total_shift = 0.0 if closing else shift - margin
                for i in range(n):
                    band[DIAGONAL, i] = band[SAVED, i] + total_shift * masses[i]
                raised, _, negative, zero, _ = factorize(work)
                good = negative == m and zero == 0
                if closing and good:
                    status, _, energy, residual, _, _, negative, zero, _ = correct(
                        x, multipliers, data, tolerance, 12.0, longest, work
                    )
                    if status == CONVERGED and negative == m and zero == 0:
                        return CONVERGED, iteration, energy, residual
                    for i in range(n):
                        x[i] = old[0, i]
                    for j in range(m):
                        multipliers[j] = old[0, n + j]
                    energy = evaluate(data, x, multipliers, work)
                elif good:
                    break
                elif turn > 0 or not closing:
                    shift = max(2.0 * shift, margin)
                closing = False
            for i in range(n):
                band[DIAGONAL, i] = band[SAVED, i] + shift * masses[i]
            raised, _, _, _, _ = factorize(work)
            length = newton_step(work, raised, x, multipliers)
            if length <= 1e-9:  # at a saddle, or where a minimum just vanished
                return SLOW, iteration, energy, residual
            descent = 0.0
            violation = 0.0
            for i in range(n):
                slope = band[GRADIENT, i]  # of the energy alone
                for j in range(m):
                    slope -= old[0, n + j] * work.rows[j, i]
                descent += slope * (x[i] - old[0, i])
                old[1, i] = x[i] - old[0, i]
            for j in range(m):
                penalty = max(penalty, 1.5 * abs(multipliers[j]))
                violation += abs(work.constraints[j])
                old[1, n + j] = multipliers[j] - old[0, n + j]
            descent -= penalty * violation
            merit = energy + penalty * violation
            fraction = min(1.0, longest / length)
            for _ in range(30):
                for i in range(n):
                    x[i] = old[0, i] + fraction * old[1, i]
                new = evaluate(data, x, multipliers, work)
                for j in range(m):
                    new += penalty * abs(work.constraints[j])
                if new <= merit + 1e-4 * fraction * descent + 1e-14 * (1.0 + abs(merit)):
                    break
                fraction *= 0.5
            for j in range(m):
                multipliers[j] = old[0, n + j] + fraction * old[1, n + j]
        return SLOW, limit, energy, residual

    return correct, descend
