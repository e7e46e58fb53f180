r"""Compiled symmetric factorizations of a scalar chain with a border, and their inertia.

The equilibrium equations of a chain of scalar unknowns under a few global constraints read

.. math:: K = \begin{pmatrix} H & J^T \\ J & 0 \end{pmatrix},

with :math:`H` symmetric tridiagonal (``diagonal``, ``off_diagonal``) and :math:`J` dense
with few rows.  :math:`H` is factorized as :math:`L D L^T` with the 1 x 1 and 2 x 2 pivots of
Bunch (1974), which needs no interchanges and is backward stable; the border is eliminated by a
Schur complement, whose inertia adds to that of :math:`H` (Sylvester, Haynsworth).  With these
pivots near-singularity of :math:`H` can only appear in the very last pivot (off-diagonal
entries that are not tiny assumed).  That case is ordinary: a buckled chain is held stable by its
constraints, and :math:`H` alone passes through singularity.  The last pivot is then raised and the
change undone exactly in the border, so that the Schur complement stays well scaled.

Everything here is compiled; arrays are C-contiguous float64.
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


class BorderedFactor(NamedTuple):
    """Factors of a bordered symmetric tridiagonal matrix.

    Attributes
    ----------
    pivot, coupling, lower : ndarray (n,)
        Inverse pivots, their 2 x 2 coupling (0 for a 1 x 1 pivot) and the multipliers.
    columns : ndarray (n, m + 1)
        :math:`\\tilde H^{-1}` times the border columns (the last one is used if ``raised``).
    small : ndarray (m + 1, m + 1)
        Factors of the Schur complement of the border.
    order, kind : ndarray (m + 1,) of int64
        Interchanges and pivot sizes of the border.
    raised : float
        What was added to the last diagonal entry (0 if nothing).
    positive, negative, zero : int
        Inertia of the bordered matrix.
    weakest : float
        Smallest pivot of the border over its largest: about the reciprocal of the condition.
    """

    pivot: np.ndarray
    coupling: np.ndarray
    lower: np.ndarray
    columns: np.ndarray
    small: np.ndarray
    order: np.ndarray
    kind: np.ndarray
    raised: float
    positive: int
    negative: int
    zero: int
    weakest: float


@jit
def factorize_tridiagonal(diagonal, off_diagonal, raise_weak, pivot, coupling, lower):
    """Factorize a symmetric tridiagonal matrix in place of three work arrays.

    Parameters
    ----------
    diagonal, off_diagonal : ndarray (n,), (n - 1,)
    raise_weak : bool
        Raise a last pivot that is small beside the largest entry.
    pivot, coupling, lower : ndarray (n,)
        Overwritten by the factors.

    Returns
    -------
    positive, negative, zero : int
        Inertia of the matrix that was factorized (the raised one).
    raised : float
        The amount added to the last diagonal entry.
    """
    n = diagonal.size
    scale = 0.0
    for k in range(n):
        scale = max(scale, abs(diagonal[k]))
    for k in range(n - 1):
        scale = max(scale, abs(off_diagonal[k]))
    positive = 0
    negative = 0
    zero = 0
    raised = 0.0
    a = diagonal[0]
    k = 0
    while k < n:
        if k == n - 1:
            if raise_weak and abs(a) <= _WEAK * scale:
                raised = scale
                a += raised
            coupling[k] = 0.0
            lower[k] = 0.0
            if a > 0.0:
                positive += 1
                pivot[k] = 1.0 / a
            elif a < 0.0:
                negative += 1
                pivot[k] = 1.0 / a
            else:
                zero += 1
                pivot[k] = 0.0
            break
        b = off_diagonal[k]
        if scale * abs(a) >= _BUNCH * b * b:
            coupling[k] = 0.0
            if a > 0.0:
                positive += 1
                pivot[k] = 1.0 / a
            elif a < 0.0:
                negative += 1
                pivot[k] = 1.0 / a
            else:  # then b is zero too: an isolated null row
                zero += 1
                pivot[k] = 0.0
            lower[k] = b * pivot[k]
            a = diagonal[k + 1] - lower[k] * b
            k += 1
        else:
            # |a| < alpha b^2 / scale and |c| <= scale: the determinant is negative.
            c = diagonal[k + 1]
            inverse = 1.0 / (a * c - b * b)
            positive += 1
            negative += 1
            pivot[k] = c * inverse
            pivot[k + 1] = a * inverse
            coupling[k] = -b * inverse
            coupling[k + 1] = 0.0
            if k + 2 < n:
                b2 = off_diagonal[k + 1]
                lower[k] = coupling[k] * b2
                lower[k + 1] = pivot[k + 1] * b2
                a = diagonal[k + 2] - b2 * lower[k + 1]
            else:
                lower[k] = 0.0
                lower[k + 1] = 0.0
            k += 2
    return positive, negative, zero, raised


@jit
def solve_tridiagonal(pivot, coupling, lower, columns, r):
    """Overwrite the first ``r`` of ``columns`` (n, >= r) by the solution with the factors.

    The factors are those of `factorize_tridiagonal`.
    """
    n = columns.shape[0]
    k = 0
    while k < n:
        if coupling[k] == 0.0:
            if k + 1 < n:
                for j in range(r):
                    columns[k + 1, j] -= lower[k] * columns[k, j]
            for j in range(r):
                columns[k, j] *= pivot[k]
            k += 1
        else:
            if k + 2 < n:
                for j in range(r):
                    columns[k + 2, j] -= lower[k] * columns[k, j] + lower[k + 1] * columns[k + 1, j]
            for j in range(r):
                u = columns[k, j]
                v = columns[k + 1, j]
                columns[k, j] = pivot[k] * u + coupling[k] * v
                columns[k + 1, j] = coupling[k] * u + pivot[k + 1] * v
            k += 2
    k = n - 1
    while k >= 0:
        if k >= 1 and coupling[k - 1] != 0.0:
            if k + 1 < n:
                for j in range(r):
                    columns[k, j] -= lower[k] * columns[k + 1, j]
                    columns[k - 1, j] -= lower[k - 1] * columns[k + 1, j]
            k -= 2
        else:
            if k + 1 < n:
                for j in range(r):
                    columns[k, j] -= lower[k] * columns[k + 1, j]
            k -= 1


@jit
def factorize_small(matrix, order, kind, m):
    """Factorize a small dense symmetric matrix in place, with complete pivoting.

    Parameters
    ----------
    matrix : ndarray (>= m, >= m)
        The leading m x m block is overwritten: (block) pivots, multipliers below.
    order, kind : ndarray (>= m,) of int64
        Overwritten by the permutation and by the sizes of the pivots (1; or 2, 0).
    m : int

    Returns
    -------
    positive, negative, zero : int
    smallest, largest : float
        Smallest and largest modulus of the eigenvalues of the pivots.
    """
    positive = 0
    negative = 0
    zero = 0
    smallest = np.inf
    largest = 0.0
    for i in range(m):
        order[i] = i
    k = 0
    while k < m:
        best_diagonal = -1.0
        r = k
        best_off = -1.0
        p = k
        q = k
        for i in range(k, m):
            if abs(matrix[i, i]) > best_diagonal:
                best_diagonal = abs(matrix[i, i])
                r = i
            for j in range(k, i):
                if abs(matrix[i, j]) > best_off:
                    best_off = abs(matrix[i, j])
                    p = j
                    q = i
        if best_diagonal >= _PARLETT * best_off:
            _interchange(matrix, order, k, r, m)
            kind[k] = 1
            d = matrix[k, k]
            smallest = min(smallest, abs(d))
            largest = max(largest, abs(d))
            if d > 0.0:
                positive += 1
            elif d < 0.0:
                negative += 1
            else:
                zero += 1
                k += 1
                continue
            for i in range(k + 1, m):
                factor = matrix[i, k] / d
                for j in range(k + 1, i + 1):
                    matrix[i, j] -= factor * matrix[j, k]
                    matrix[j, i] = matrix[i, j]
            for i in range(k + 1, m):
                matrix[i, k] /= d
            k += 1
        else:
            _interchange(matrix, order, k, p, m)
            _interchange(matrix, order, k + 1, q, m)
            kind[k] = 2
            kind[k + 1] = 0
            a = matrix[k, k]
            b = matrix[k + 1, k]
            c = matrix[k + 1, k + 1]
            determinant = a * c - b * b
            positive += 1
            negative += 1
            middle = 0.5 * (a + c)
            radius = math.sqrt(0.25 * (a - c) ** 2 + b * b)
            big = max(abs(middle + radius), abs(middle - radius))
            smallest = min(smallest, abs(determinant) / big)
            largest = max(largest, big)
            for i in range(k + 2, m):
                u = (c * matrix[i, k] - b * matrix[i, k + 1]) / determinant
                v = (a * matrix[i, k + 1] - b * matrix[i, k]) / determinant
                for j in range(k + 2, i + 1):
                    matrix[i, j] -= u * matrix[j, k] + v * matrix[j, k + 1]
                    matrix[j, i] = matrix[i, j]
            # The old entries of columns k, k + 1 were needed in all rows: store multipliers now.
            for i in range(k + 2, m):
                u = (c * matrix[i, k] - b * matrix[i, k + 1]) / determinant
                v = (a * matrix[i, k + 1] - b * matrix[i, k]) / determinant
                matrix[i, k] = u
                matrix[i, k + 1] = v
            k += 2
    return positive, negative, zero, smallest, largest


@jit
def _interchange(matrix, order, a, b, m):
    if a == b:
        return
    for j in range(m):
        t = matrix[a, j]
        matrix[a, j] = matrix[b, j]
        matrix[b, j] = t
    for i in range(m):
        t = matrix[i, a]
        matrix[i, a] = matrix[i, b]
        matrix[i, b] = t
    t2 = order[a]
    order[a] = order[b]
    order[b] = t2


@jit
def solve_small(matrix, order, kind, values, work, m):
    """Overwrite the first ``m`` ``values`` by the solution (factors of `factorize_small`)."""
    for i in range(m):
        work[i] = values[order[i]]
    k = 0
    while k < m:
        size = kind[k]
        for i in range(k + size, m):
            work[i] -= matrix[i, k] * work[k]
            if size == 2:
                work[i] -= matrix[i, k + 1] * work[k + 1]
        k += size
    k = 0
    while k < m:
        if kind[k] == 1:
            d = matrix[k, k]
            work[k] = work[k] / d if d != 0.0 else 0.0
            k += 1
        else:
            a = matrix[k, k]
            b = matrix[k + 1, k]
            c = matrix[k + 1, k + 1]
            determinant = a * c - b * b
            u = work[k]
            v = work[k + 1]
            work[k] = (c * u - b * v) / determinant
            work[k + 1] = (a * v - b * u) / determinant
            k += 2
    k = m - 1
    while k >= 0:
        size = 1
        if kind[k] == 0:
            size = 2
        first = k - size + 1
        for i in range(k + 1, m):
            work[first] -= matrix[i, first] * work[i]
            if size == 2:
                work[k] -= matrix[i, k] * work[i]
        k -= size
    for i in range(m):
        values[order[i]] = work[i]


@jit
def factorize_into(
    diagonal, off_diagonal, rows, pivot, coupling, lower, columns, small, order, kind
):
    """Factorize :math:`[[H, J^T], [J, 0]]` into given arrays (see `BorderedFactor`).

    ``columns`` is (n, m + 1), ``small`` (m + 1, m + 1), ``order`` and ``kind`` (m + 1,); the last
    column is used when the last pivot of :math:`H` is moved to the border.

    Returns
    -------
    raised : float
    positive, negative, zero : int
    weakest : float
    """
    n = diagonal.size
    m = rows.shape[0]
    positive, negative, zero, raised = factorize_tridiagonal(
        diagonal, off_diagonal, m > 0, pivot, coupling, lower
    )
    k = m + 1 if raised > 0.0 else m
    for i in range(n):
        for j in range(m):
            columns[i, j] = rows[j, i]
    if raised > 0.0:
        # H = H~ - raised e e^T with e the last unit vector. The auxiliary unknown
        # t = raised e^T x makes this [[H~, -e], [-e^T, 1/raised]], whose inertia is that of H
        # and one positive pivot.
        for i in range(n - 1):
            columns[i, m] = 0.0
        columns[n - 1, m] = -1.0
    solve_tridiagonal(pivot, coupling, lower, columns, k)
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            if i < m:
                for p in range(n):
                    total -= rows[i, p] * columns[p, j]
            else:
                total = columns[n - 1, j]
            small[i, j] = total
            small[j, i] = total
    if raised > 0.0:
        small[m, m] += 1.0 / raised
    p2, n2, z2, smallest, largest = factorize_small(small, order, kind, k)
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
def solve_with(
    pivot, coupling, lower, columns, small, order, kind, raised, rows, right, border, values, work
):
    """Overwrite ``right`` (n, r) and ``border`` (m, r) by the solution of a factorized system.

    The factors are those of `factorize_into`; ``values`` and ``work`` (m + 1,) are scratch.
    """
    n, r = right.shape
    m = rows.shape[0]
    k = m + 1 if raised > 0.0 else m
    solve_tridiagonal(pivot, coupling, lower, right, r)
    for c in range(r):
        for i in range(m):
            total = border[i, c]
            for p in range(n):
                total -= rows[i, p] * right[p, c]
            values[i] = total
        if k > m:
            values[m] = right[n - 1, c]
        solve_small(small, order, kind, values, work, k)
        for i in range(m):
            border[i, c] = values[i]
        for p in range(n):
            for i in range(k):
                right[p, c] -= columns[p, i] * values[i]


@jit
def factorize_bordered(diagonal, off_diagonal, rows):
    """Factorize :math:`[[H, J^T], [J, 0]]` with ``rows`` :math:`= J` of shape (m, n), m >= 0.

    Returns a `BorderedFactor`.
    """
    n = diagonal.size
    m = rows.shape[0]
    pivot = np.empty(n)
    coupling = np.empty(n)
    lower = np.empty(n)
    columns = np.empty((n, m + 1))
    small = np.empty((m + 1, m + 1))
    order = np.empty(m + 1, dtype=np.int64)
    kind = np.empty(m + 1, dtype=np.int64)
    raised, positive, negative, zero, weakest = factorize_into(
        diagonal, off_diagonal, rows, pivot, coupling, lower, columns, small, order, kind
    )
    return BorderedFactor(
        pivot,
        coupling,
        lower,
        columns,
        small,
        order,
        kind,
        raised,
        positive,
        negative,
        zero,
        weakest,
    )


@jit
def solve_bordered(factor, rows, right, right_border):
    """Overwrite ``right`` (n, r) and ``right_border`` (m, r) by the solution."""
    m = rows.shape[0]
    solve_with(
        factor.pivot,
        factor.coupling,
        factor.lower,
        factor.columns,
        factor.small,
        factor.order,
        factor.kind,
        factor.raised,
        rows,
        right,
        right_border,
        np.empty(m + 1),
        np.empty(m + 1),
    )


@jit
def apply_bordered(diagonal, off_diagonal, rows, vector, border, out, out_border):
    """Write the bordered matrix times (``vector`` (n,), ``border`` (m,)) to the ``out`` arrays."""
    n = diagonal.size
    m = rows.shape[0]
    for i in range(n):
        total = diagonal[i] * vector[i]
        if i > 0:
            total += off_diagonal[i - 1] * vector[i - 1]
        if i < n - 1:
            total += off_diagonal[i] * vector[i + 1]
        for j in range(m):
            total += rows[j, i] * border[j]
        out[i] = total
    for j in range(m):
        total = 0.0
        for i in range(n):
            total += rows[j, i] * vector[i]
        out_border[j] = total


@jit
def refine_bordered(factor, diagonal, off_diagonal, rows, right, right_border, x, y):
    """Improve the solution ``x`` (n, r), ``y`` (m, r) of the right-hand sides by one refinement.

    Returns the largest correction over the largest entry of the solution, an estimate of the
    relative error before the correction.
    """
    n, r = right.shape
    m = rows.shape[0]
    dx = np.empty((n, r))
    dy = np.empty((m, r))
    out = np.empty(n)
    out_border = np.empty(m)
    for c in range(r):
        apply_bordered(
            diagonal,
            off_diagonal,
            rows,
            x[:, c].copy(),
            y[:, c].copy(),
            out,
            out_border,
        )
        for i in range(n):
            dx[i, c] = right[i, c] - out[i]
        for j in range(m):
            dy[j, c] = right_border[j, c] - out_border[j]
    solve_bordered(factor, rows, dx, dy)
    largest = 0.0
    change = 0.0
    for c in range(r):
        for i in range(n):
            largest = max(largest, abs(x[i, c]))
            change = max(change, abs(dx[i, c]))
            x[i, c] += dx[i, c]
        for j in range(m):
            y[j, c] += dy[j, c]
    return change / largest if largest > 0.0 else 0.0


class ChainWork(NamedTuple):
    """Preallocated arrays of the corrector; after a call they hold the last point's derivatives."""

    gradient: np.ndarray
    diagonal: np.ndarray
    off_diagonal: np.ndarray
    constraints: np.ndarray
    rows: np.ndarray
    pivot: np.ndarray
    coupling: np.ndarray
    lower: np.ndarray
    columns: np.ndarray
    small: np.ndarray
    order: np.ndarray
    kind: np.ndarray
    right: np.ndarray
    border: np.ndarray
    values: np.ndarray
    scratch: np.ndarray


@jit
def chain_work(n, m):
    """Allocate a `ChainWork` for ``n`` unknowns and ``m`` constraints."""
    return ChainWork(
        np.zeros(n),
        np.zeros(n),
        np.zeros(n - 1),
        np.zeros(m),
        np.zeros((m, n)),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, m + 1)),
        np.zeros((m + 1, m + 1)),
        np.zeros(m + 1, dtype=np.int64),
        np.zeros(m + 1, dtype=np.int64),
        np.zeros((n, 1)),
        np.zeros((m, 1)),
        np.zeros(m + 1),
        np.zeros(m + 1),
    )


@jit
def factorize_work(work):
    """Factorize the matrix held by a `ChainWork`; returns what `factorize_into` returns."""
    return factorize_into(
        work.diagonal,
        work.off_diagonal,
        work.rows,
        work.pivot,
        work.coupling,
        work.lower,
        work.columns,
        work.small,
        work.order,
        work.kind,
    )


@jit
def newton_step(work, raised, x, multipliers):
    """Solve with the residual and the factors held by ``work`` and add the step in place.

    Returns the largest modulus of the step of ``x``.
    """
    n = x.size
    m = multipliers.size
    for i in range(n):
        work.right[i, 0] = -work.gradient[i]
    for j in range(m):
        work.border[j, 0] = -work.constraints[j]
    solve_with(
        work.pivot,
        work.coupling,
        work.lower,
        work.columns,
        work.small,
        work.order,
        work.kind,
        raised,
        work.rows,
        work.right,
        work.border,
        work.values,
        work.scratch,
    )
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(work.right[i, 0]))
        x[i] += work.right[i, 0]
    for j in range(m):
        multipliers[j] += work.border[j, 0]
    return largest


CONVERGED = 0
SLOW = 1  # the iteration limit
LOST = 2  # a step beyond the longest one allowed, or a number that is not finite


@jit
def smallest_eigenpair(masses, work, mode):
    r"""Smallest constrained eigenvalue :math:`H u = \mu M u`, :math:`J u = 0`, at a stable point.

    Inverse iteration on the bordered matrix held by ``work``.  The factors in ``work`` are used and
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
    n = masses.size
    m = work.constraints.size
    diagonal = work.diagonal.copy()
    for i in range(n):
        # Any start with a part along every mode; deterministic.
        mode[i] = 1.0 + 0.5 * math.cos(1.7 * i) + 0.3 * math.sin(9.0 * (i + 1.0) / n)
    shift = 0.0
    value = np.inf
    low = 0.0
    result = np.nan
    for attempt in range(40):
        for i in range(n):
            work.diagonal[i] = diagonal[i] - shift * masses[i]
        raised, _, negative, zero, _ = factorize_work(work)
        if negative != m or zero != 0:
            if attempt == 0:
                break  # not stable
            shift = 0.5 * (low + shift)  # an eigenvalue lies below: step back
            continue
        low = shift
        converged = False
        sweeps = 6 if attempt == 0 else 4
        for _ in range(sweeps):
            for i in range(n):
                work.right[i, 0] = masses[i] * mode[i]
            for j in range(m):
                work.border[j, 0] = 0.0
            solve_with(
                work.pivot,
                work.coupling,
                work.lower,
                work.columns,
                work.small,
                work.order,
                work.kind,
                raised,
                work.rows,
                work.right,
                work.border,
                work.values,
                work.scratch,
            )
            norm = 0.0
            for i in range(n):
                norm += masses[i] * work.right[i, 0] ** 2
            norm = math.sqrt(norm)
            for i in range(n):
                mode[i] = work.right[i, 0] / norm
            new = 0.0  # Rayleigh quotient
            for i in range(n):
                new += diagonal[i] * mode[i] ** 2
                if i < n - 1:
                    new += 2.0 * work.off_diagonal[i] * mode[i] * mode[i + 1]
            converged = abs(new - value) <= 1e-11 * abs(new) + 1e-13 * abs(diagonal[0])
            value = new
        if converged and (attempt > 0):
            result = value
            break
        shift = max(low, value - 0.02 * abs(value - low))
    for i in range(n):
        work.diagonal[i] = diagonal[i]
    return result


def make_solvers(evaluate):
    """Return the compiled functions ``correct`` and ``descend`` for one kind of scalar chain.

    Parameters
    ----------
    evaluate : compiled function
        ``evaluate(data, x, multipliers, gradient, diagonal, off_diagonal, constraints, rows)``
        fills the derivatives of the Lagrangian (gradient and tridiagonal Hessian), the constraints
        and their gradients, and returns the energy.

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
        limit : int
            Newton steps allowed.
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
        energy = 0.0
        residual = np.inf
        raised = 0.0
        positive = 0
        negative = 0
        zero = 0
        weakest = 0.0
        while True:
            energy = evaluate(
                data,
                x,
                multipliers,
                work.gradient,
                work.diagonal,
                work.off_diagonal,
                work.constraints,
                work.rows,
            )
            residual = 0.0
            finite = True
            for i in range(x.size):
                value = abs(work.gradient[i])
                finite = finite and value < np.inf  # false for nan
                residual = max(residual, value)
            for j in range(multipliers.size):
                value = abs(work.constraints[j])
                finite = finite and value < np.inf
                residual = max(residual, value)
            if not finite:
                return LOST, steps, energy, np.inf, raised, positive, negative, zero, weakest
            raised, positive, negative, zero, weakest = factorize_work(work)
            if residual <= tolerance:
                return CONVERGED, steps, energy, residual, raised, positive, negative, zero, weakest
            if steps >= limit:
                return SLOW, steps, energy, residual, raised, positive, negative, zero, weakest
            length = newton_step(work, raised, x, multipliers)
            steps += 1
            if not length <= longest:
                return LOST, steps, energy, residual, raised, positive, negative, zero, weakest

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
        start = np.empty(n)
        start_multipliers = np.empty(m)
        gradient = np.empty(n)
        shift = 0.0
        penalty = 0.0
        energy = 0.0
        residual = np.inf
        scale = 0.0  # of eigenvalues: the trace of H over that of M, divided by n^2
        for iteration in range(limit):
            energy = evaluate(
                data,
                x,
                multipliers,
                work.gradient,
                work.diagonal,
                work.off_diagonal,
                work.constraints,
                work.rows,
            )
            residual = 0.0
            violation = 0.0
            for i in range(n):
                residual = max(residual, abs(work.gradient[i]))
            for j in range(m):
                residual = max(residual, abs(work.constraints[j]))
                violation += abs(work.constraints[j])
            if not residual < np.inf:
                return LOST, iteration, energy, residual
            if iteration == 0:
                trace = 0.0
                total = 0.0
                for i in range(n):
                    trace += abs(work.diagonal[i])
                    total += masses[i]
                scale = trace / total / (n * n)
            if residual <= 1e-5:
                raised, _, negative, zero, _ = factorize_work(work)
                if negative == m and zero == 0:
                    for i in range(n):
                        start[i] = x[i]
                    for j in range(m):
                        start_multipliers[j] = multipliers[j]
                    status, _, energy, residual, _, _, negative, zero, _ = correct(
                        x, multipliers, data, tolerance, 12, longest, work
                    )
                    if status == CONVERGED and negative == m and zero == 0:
                        return CONVERGED, iteration, energy, residual
                    for i in range(n):
                        x[i] = start[i]
                    for j in range(m):
                        multipliers[j] = start_multipliers[j]
                    energy = evaluate(
                        data,
                        x,
                        multipliers,
                        work.gradient,
                        work.diagonal,
                        work.off_diagonal,
                        work.constraints,
                        work.rows,
                    )
            # Shift until the curvature on the constraints exceeds a margin: near a fold the step
            # would else be long and its multipliers useless as a penalty.
            diagonal = work.diagonal.copy()
            margin = 0.5 * scale
            shift = 0.25 * shift if shift > 0.5 * margin else 0.0
            for _ in range(60):
                for i in range(n):
                    work.diagonal[i] = diagonal[i] + (shift - margin) * masses[i]
                _, _, negative, zero, _ = factorize_work(work)
                if negative == m and zero == 0:
                    break
                shift = max(2.0 * shift, margin)
            for i in range(n):
                work.diagonal[i] = diagonal[i] + shift * masses[i]
            raised, _, _, _, _ = factorize_work(work)
            for i in range(n):
                start[i] = x[i]
                gradient[i] = work.gradient[i]
                for j in range(m):
                    gradient[i] -= multipliers[j] * work.rows[j, i]
            for j in range(m):
                start_multipliers[j] = multipliers[j]
            length = newton_step(work, raised, x, multipliers)
            if length <= 1e-9:
                return (
                    SLOW,
                    iteration,
                    energy,
                    residual,
                )  # at a saddle, or where a minimum just vanished
            slope = 0.0
            for i in range(n):
                slope += gradient[i] * (x[i] - start[i])
            for j in range(m):
                penalty = max(penalty, 1.5 * abs(multipliers[j]))
            fraction = min(1.0, longest / length) if length > 0.0 else 1.0
            merit = energy + penalty * violation
            descent = slope - penalty * violation
            full = x.copy()
            full_multipliers = multipliers.copy()
            for _ in range(30):
                for i in range(n):
                    x[i] = start[i] + fraction * (full[i] - start[i])
                new = evaluate(
                    data,
                    x,
                    multipliers,
                    work.gradient,
                    work.diagonal,
                    work.off_diagonal,
                    work.constraints,
                    work.rows,
                )
                for j in range(m):
                    new += penalty * abs(work.constraints[j])
                if new <= merit + 1e-4 * fraction * descent + 1e-14 * (1.0 + abs(merit)):
                    break
                fraction *= 0.5
            for j in range(m):
                multipliers[j] = start_multipliers[j] + fraction * (
                    full_multipliers[j] - start_multipliers[j]
                )
        return SLOW, limit, energy, residual

    return correct, descend
