"""The compiled bordered factorization against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lissome import _tridiagonal as td
from lissome._compile import jit


def dense(diagonal, off, rows):
    n, m = diagonal.size, rows.shape[0]
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
    matrix[n:, :n] = rows
    matrix[:n, n:] = rows.T
    return matrix


def random_problem(seed, n, m, *, definite=False, spread=1.0):
    rng = np.random.default_rng(seed)
    diagonal = rng.normal(size=n) * np.exp(spread * rng.normal(size=n))
    off = rng.normal(size=n - 1)
    if definite:
        diagonal = 4.0 + rng.random(n)
    return diagonal, off, rng.normal(size=(m, n)), rng


def solve(diagonal, off, rows, right, right_border):
    factor = td.factorize_bordered(diagonal, off, rows)
    x, y = right.copy(), right_border.copy()
    td.solve_bordered(factor, rows, x, y)
    td.refine_bordered(factor, diagonal, off, rows, right, right_border, x, y)
    return factor, x, y


@pytest.mark.parametrize("m", [0, 1, 2, 3, 6])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 60])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_inertia_and_solution_match_dense(n, m, seed):
    if m > n:
        return  # the bordered matrix is then singular by construction
    diagonal, off, rows, rng = random_problem(seed, n, m)
    matrix = dense(diagonal, off, rows)
    eigenvalues = np.linalg.eigvalsh(matrix)
    condition = np.abs(eigenvalues).max() / np.abs(eigenvalues).min()
    right, right_border = rng.normal(size=(n, 2)), rng.normal(size=(m, 2))
    factor, x, y = solve(diagonal, off, rows, right, right_border)
    if condition < 1e10:
        assert factor.positive == np.sum(eigenvalues > 0)
        assert factor.negative == np.sum(eigenvalues < 0)
        assert factor.zero == 0
    residual = matrix @ np.vstack([x, y]) - np.vstack([right, right_border])
    scale = np.abs(matrix).sum(axis=1).max() * np.abs(np.vstack([x, y])).max()
    assert np.abs(residual).max() <= 1e-13 * (n + m) * scale  # normwise backward error


def test_singular_chain_held_by_its_border():
    # H = second difference with free ends is singular (constants); one row that sees constants
    # makes the bordered matrix regular with exactly one negative pivot.
    n = 50
    diagonal = np.full(n, 2.0)
    diagonal[[0, -1]] = 1.0
    off = np.full(n - 1, -1.0)
    rows = np.full((1, n), 1.0 / n)
    rng = np.random.default_rng(0)
    right, right_border = rng.normal(size=(n, 1)), rng.normal(size=(1, 1))
    factor, x, y = solve(diagonal, off, rows, right, right_border)
    assert (factor.positive, factor.negative, factor.zero) == (n, 1, 0)
    assert factor.raised > 0
    expected = np.linalg.solve(dense(diagonal, off, rows), np.vstack([right, right_border]))
    np.testing.assert_allclose(
        np.vstack([x, y]), expected, rtol=0, atol=1e-11 * np.abs(expected).max()
    )


@pytest.mark.parametrize("gap", [1e-2, 1e-5, 1e-9, 0.0, -1e-9, -1e-5, -1e-2])
def test_inertia_through_a_singular_chain(gap):
    """H passes through singularity while the constrained problem stays positive."""
    n = 40
    diagonal = np.full(n, 2.0)
    off = np.full(n - 1, -1.0)
    lowest = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))[0]
    diagonal -= lowest - gap
    rows = np.sin(np.pi * np.arange(1, n + 1) / (n + 1))[None, :]  # exactly the critical mode
    factor = td.factorize_bordered(diagonal, off, rows)
    assert (factor.positive, factor.negative, factor.zero) == (n, 1, 0)


def test_dependent_rows_are_reported_as_singular():
    diagonal, off = np.full(10, 3.0), np.full(9, -1.0)
    rows = np.ones((2, 10))
    factor = td.factorize_bordered(diagonal, off, rows)
    assert factor.weakest < 1e-14


def test_decoupled_null_row_is_counted():
    diagonal = np.array([2.0, 0.0, 3.0])
    factor = td.factorize_bordered(diagonal, np.zeros(2), np.empty((0, 3)))
    assert (factor.positive, factor.negative, factor.zero) == (2, 0, 1)


@given(seed=st.integers(0, 2**32 - 1), m=st.integers(1, 7))
@settings(max_examples=200, deadline=None)
def test_small_factorization(seed, m):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(m, m)) * np.exp(2 * rng.normal(size=(m, m)))
    matrix = matrix + matrix.T
    matrix[np.arange(m), np.arange(m)] *= rng.integers(0, 2, m)  # zero diagonals force 2 x 2 pivots
    eigenvalues = np.linalg.eigvalsh(matrix)
    if np.abs(eigenvalues).min() <= 1e-9 * np.abs(eigenvalues).max():
        return
    work, order, kind = matrix.copy(), np.empty(m, np.int64), np.empty(m, np.int64)
    positive, negative, zero, *_ = td.factorize_small(work, order, kind, m)
    assert (positive, negative, zero) == (np.sum(eigenvalues > 0), np.sum(eigenvalues < 0), 0)
    values = rng.normal(size=m)
    x = values.copy()
    td.solve_small(work, order, kind, x, np.empty(m), m)
    scale = np.abs(matrix).sum(axis=1).max() * np.abs(x).max()
    assert np.abs(matrix @ x - values).max() <= 1e-13 * m * scale


@jit
def quartic_chain(data, x, multipliers, gradient, diagonal, off, constraints, rows):
    """Energy sum (x_i^4/4 + (x_{i+1} - x_i)^2/2 - b_i x_i), constraint sum x_i = c."""
    loads, total = data
    n = x.size
    energy = 0.0
    constraints[0] = -total
    for i in range(n):
        energy += 0.25 * x[i] ** 4 - loads[i] * x[i]
        gradient[i] = x[i] ** 3 - loads[i] + multipliers[0]
        diagonal[i] = 3.0 * x[i] ** 2
        constraints[0] += x[i]
        rows[0, i] = 1.0
    for i in range(n - 1):
        jump = x[i + 1] - x[i]
        energy += 0.5 * jump * jump
        gradient[i] -= jump
        gradient[i + 1] += jump
        diagonal[i] += 1.0
        diagonal[i + 1] += 1.0
        off[i] = -1.0
    return energy


correct, descend = td.make_solvers(quartic_chain)


def test_corrector_converges_quadratically_to_a_minimum():
    n = 30
    rng = np.random.default_rng(5)
    loads = rng.normal(size=n)
    x, multipliers = np.ones(n), np.zeros(1)
    work = td.chain_work(n, 1)
    result = correct(x, multipliers, (loads, 3.0), 1e-12, 30, 10.0, work)
    status, steps, _, residual, _, positive, negative, zero, _ = result
    assert status == td.CONVERGED
    assert steps <= 12
    assert residual <= 1e-12
    assert (positive, negative, zero) == (n, 1, 0)
    assert abs(x.sum() - 3.0) <= 1e-12
    # Independent check of stationarity.
    stretch = np.diff(x)
    force = x**3 - loads + multipliers[0]
    force[:-1] -= stretch
    force[1:] += stretch
    assert np.abs(force).max() <= 1e-11


def test_corrector_says_when_it_is_lost():
    work = td.chain_work(5, 1)
    loads = np.zeros(5)
    x = np.full(5, np.nan)
    assert correct(x, np.zeros(1), (loads, 0.0), 1e-12, 5, 1.0, work)[0] == td.LOST
    x = np.full(5, 1e3)
    assert correct(x, np.zeros(1), (loads, 0.0), 1e-12, 5, 1.0, work)[0] == td.LOST
    loads = np.arange(5.0)
    x = np.full(5, 10.0)
    assert correct(x, np.zeros(1), (loads, 40.0), 1e-300, 2, 1e6, work)[0] == td.SLOW
