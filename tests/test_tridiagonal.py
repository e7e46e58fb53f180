"""The compiled bordered factorization and Newton's method on it, against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh, null_space

from lissome import _tridiagonal as td
from lissome._compile import jit


def filled(diagonal, off, rows):
    n, m = diagonal.size, rows.shape[0]
    work = td.chain_work(n, m)
    work.band[td.DIAGONAL] = diagonal
    work.band[td.OFF_DIAGONAL, : n - 1] = off
    work.rows[:] = rows
    return work


def dense(diagonal, off, rows):
    n, m = diagonal.size, rows.shape[0]
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
    matrix[n:, :n] = rows
    matrix[:n, n:] = rows.T
    return matrix


def random_problem(seed, n, m):
    rng = np.random.default_rng(seed)
    diagonal = rng.normal(size=n) * np.exp(rng.normal(size=n))
    return diagonal, rng.normal(size=n - 1), rng.normal(size=(m, n)), rng


def solved(work, raised, right):
    """Solve with one step of refinement by the dense matrix at hand."""
    n, m = work.columns.shape[0], work.rows.shape[0]
    work.columns[:, m + 1] = right[:n]
    work.dense[m + 1, :m] = right[n:]
    td.solve(work, raised)
    return np.concatenate([work.columns[:, m + 1], work.dense[m + 1, :m]])


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
    work = filled(diagonal, off, rows)
    raised, positive, negative, zero, _ = td.factorize(work)
    if condition < 1e10:
        assert positive == np.sum(eigenvalues > 0)
        assert negative == np.sum(eigenvalues < 0)
        assert zero == 0
    right = rng.normal(size=n + m)
    x = solved(work, raised, right)
    x += solved(work, raised, right - matrix @ x)  # as a second Newton step does
    scale = np.abs(matrix).sum(axis=1).max() * np.abs(x).max()
    assert np.abs(matrix @ x - right).max() <= 1e-13 * (n + m) * scale


def test_singular_chain_held_by_its_border():
    # H = second difference with free ends is singular (constants); one row that sees constants
    # makes the bordered matrix regular with exactly one negative pivot.
    n = 50
    diagonal = np.full(n, 2.0)
    diagonal[[0, -1]] = 1.0
    off, rows = np.full(n - 1, -1.0), np.full((1, n), 1.0 / n)
    work = filled(diagonal, off, rows)
    raised, positive, negative, zero, _ = td.factorize(work)
    assert (positive, negative, zero) == (n, 1, 0)
    assert raised > 0
    right = np.random.default_rng(0).normal(size=n + 1)
    expected = np.linalg.solve(dense(diagonal, off, rows), right)
    error = np.abs(solved(work, raised, right) - expected).max()
    assert error <= 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("gap", [1e-2, 1e-5, 1e-9, 0.0, -1e-9, -1e-5, -1e-2])
def test_inertia_through_a_singular_chain(gap):
    """H passes through singularity while the constrained problem stays positive."""
    n = 40
    diagonal, off = np.full(n, 2.0), np.full(n - 1, -1.0)
    diagonal -= np.linalg.eigvalsh(dense(diagonal, off, np.empty((0, n))))[0] - gap
    rows = np.sin(np.pi * np.arange(1, n + 1) / (n + 1))[None, :]  # exactly the critical mode
    _, positive, negative, zero, _ = td.factorize(filled(diagonal, off, rows))
    assert (positive, negative, zero) == (n, 1, 0)


def test_dependent_rows_are_reported_as_singular():
    work = filled(np.full(10, 3.0), np.full(9, -1.0), np.ones((2, 10)))
    assert td.factorize(work)[-1] < 1e-14


def test_decoupled_null_row_is_counted():
    work = filled(np.array([2.0, 0.0, 3.0]), np.zeros(2), np.empty((0, 3)))
    assert td.factorize(work)[1:4] == (2, 0, 1)


def test_numbers_that_are_not_finite_do_no_harm():
    for bad in (np.nan, np.inf):
        work = filled(np.array([1.0, bad, 2.0]), np.array([bad, 1.0]), np.ones((1, 3)))
        td.factorize(work)  # whatever it says, it stays within its arrays and ends


@given(seed=st.integers(0, 2**32 - 1), m=st.integers(1, 7))
@settings(max_examples=200, deadline=None)
def test_small_factorization(seed, m):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(m, m)) * np.exp(2 * rng.normal(size=(m, m)))
    matrix = matrix + matrix.T
    matrix[np.arange(m), np.arange(m)] *= rng.integers(0, 2, m)  # zero diagonals: 2 x 2 pivots
    eigenvalues = np.linalg.eigvalsh(matrix)
    if np.abs(eigenvalues).min() <= 1e-9 * np.abs(eigenvalues).max():
        return
    work = np.zeros((m + 2, m))
    work[:m] = matrix
    integers = np.zeros((2, m), dtype=np.int64)
    positive, negative, zero, *_ = td._factorize_dense(work, integers, m)
    assert (positive, negative, zero) == (np.sum(eigenvalues > 0), np.sum(eigenvalues < 0), 0)
    values = rng.normal(size=m)
    work[m] = values
    td._solve_dense(work, integers, m, m, m + 1)
    x = work[m]
    scale = np.abs(matrix).sum(axis=1).max() * np.abs(x).max()
    assert np.abs(matrix @ x - values).max() <= 1e-13 * m * scale


@pytest.mark.parametrize("m", [0, 1, 3])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_smallest_eigenpair_matches_dense(m, seed):
    n = 25
    diagonal, off, rows, rng = random_problem(seed, n, m)
    masses = rng.uniform(0.5, 2.0, n)
    basis = null_space(rows) if m else np.eye(n)
    hessian = dense(diagonal, off, np.empty((0, n)))
    reduced = basis.T @ hessian @ basis, basis.T @ np.diag(masses) @ basis
    lowest = eigh(*reduced, eigvals_only=True)[0]
    gap = rng.uniform(0.01, 3.0)
    diagonal = diagonal + (gap - lowest) * masses  # now the smallest is the gap
    values, modes = eigh(basis.T @ dense(diagonal, off, np.empty((0, n))) @ basis, reduced[1])
    mode = np.zeros(n)
    found = td.smallest_eigenpair(masses, filled(diagonal, off, rows), mode)
    assert abs(found - gap) <= 1e-8 * max(1.0, np.abs(diagonal).max())
    assert abs(mode @ (masses * mode) - 1) < 1e-10
    if values[1] - values[0] > 0.1:
        assert abs(abs(mode @ (masses * (basis @ modes[:, 0]))) - 1) < 1e-4


def test_eigenvalue_of_an_unstable_point_is_refused():
    work = filled(np.array([1.0, -1.0, 2.0]), np.zeros(2), np.empty((0, 3)))
    assert np.isnan(td.smallest_eigenpair(np.ones(3), work, np.zeros(3)))


@jit
def double_well_chain(data, x, multipliers, work):
    """Energy sum (well (x_i^2 - 1)^2/4 + (x_{i+1} - x_i)^2/2 - b_i x_i), constraint sum x_i = c."""
    loads, total, well = data
    n = x.size
    energy = 0.0
    work.constraints[0] = -total
    for i in range(n):
        energy += 0.25 * well * (x[i] ** 2 - 1.0) ** 2 - loads[i] * x[i]
        work.band[td.GRADIENT, i] = well * (x[i] ** 3 - x[i]) - loads[i] + multipliers[0]
        work.band[td.DIAGONAL, i] = well * (3.0 * x[i] ** 2 - 1.0)
        work.constraints[0] += x[i]
        work.rows[0, i] = 1.0
    for i in range(n - 1):
        jump = x[i + 1] - x[i]
        energy += 0.5 * jump * jump
        work.band[td.GRADIENT, i] -= jump
        work.band[td.GRADIENT, i + 1] += jump
        work.band[td.DIAGONAL, i] += 1.0
        work.band[td.DIAGONAL, i + 1] += 1.0
        work.band[td.OFF_DIAGONAL, i] = -1.0
    return energy


correct, descend = td.make_solvers(double_well_chain)


def residual_of(x, multiplier, loads, well):
    stretch = np.diff(x)
    force = well * (x**3 - x) - loads + multiplier
    force[:-1] -= stretch
    force[1:] += stretch
    return np.abs(force).max()


def test_corrector_converges_to_a_minimum_near_by():
    n = 30
    loads = 0.1 * np.random.default_rng(5).normal(size=n)
    x, multipliers = np.ones(n), np.zeros(1)
    work = td.chain_work(n, 1)
    result = correct(x, multipliers, (loads, 28.0, 1.0), 1e-12, 12.0, 10.0, work)
    status, steps, _, residual, _, positive, negative, zero, _ = result
    assert status == td.CONVERGED
    assert steps <= 7
    assert residual <= 1e-12
    assert (positive, negative, zero) == (n, 1, 0)
    assert abs(x.sum() - 28.0) <= 1e-12
    assert residual_of(x, multipliers[0], loads, 1.0) <= 1e-11


def test_corrector_says_when_it_is_lost():
    work = td.chain_work(5, 1)
    loads = np.zeros(5)

    def status(x, tolerance, limit, longest, load=loads, total=0.0):
        return correct(x, np.zeros(1), (load, total, 1.0), tolerance, limit, longest, work)[0]

    assert status(np.full(5, np.nan), 1e-12, 5.0, 1.0) == td.LOST
    assert status(np.full(5, 1e3), 1e-12, 5.0, 1.0) == td.LOST
    assert status(np.full(5, 10.0), 1e-300, 2.0, 1e6, np.arange(5.0), 40.0) == td.SLOW


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_descent_ends_at_a_minimum(seed):
    """Deep wells have many saddles: the descent ends at none of them."""
    n = 12
    rng = np.random.default_rng(seed)
    loads = 0.3 * rng.normal(size=n)
    well = 3.0
    x, multipliers = 0.1 * rng.normal(size=n), np.zeros(1)
    work = td.chain_work(n, 1)
    data = (loads, 1.0, well)
    before = 0.25 * well * np.sum((x**2 - 1) ** 2) + 0.5 * np.sum(np.diff(x) ** 2) - loads @ x
    status, _, energy, residual = descend(x, multipliers, data, np.ones(n), 1e-11, 2000, 0.3, work)
    assert status == td.CONVERGED
    assert residual <= 1e-11
    assert energy < before
    assert residual_of(x, multipliers[0], loads, well) <= 1e-10
    hessian = np.diag(well * (3 * x**2 - 1) + 2.0) - np.eye(n, k=1) - np.eye(n, k=-1)
    hessian[0, 0] -= 1
    hessian[-1, -1] -= 1
    basis = null_space(np.ones((1, n)))
    assert np.linalg.eigvalsh(basis.T @ hessian @ basis)[0] > 0
