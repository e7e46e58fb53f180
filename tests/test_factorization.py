"""The KKT factorizations against dense eigenvalues and dense solves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from lissome import _chain, _multifrontal
from lissome.errors import FactorizationError, InvalidInput
from lissome.factorization import (
    ChainKKT,
    ChainLayout,
    DenseKKT,
    SparseKKT,
    TridiagonalKKT,
)

EPS = np.finfo(float).eps


def dense_of(kkt):
    """Return the whole matrix [[H, J^T], [J, 0]], by applying it to unit vectors."""
    n, m = kkt.n, kkt.m
    columns = [np.concatenate(kkt.apply(e[:n], e[n:])) for e in np.eye(n + m)]
    return np.array(columns).T


def inertia_of(matrix):
    values = np.linalg.eigvalsh(matrix)
    return int(np.sum(values > 0)), int(np.sum(values < 0)), 0


def well_posed(matrix):
    """Whether the sign of each eigenvalue is beyond doubt."""
    values = np.abs(np.linalg.eigvalsh(matrix))
    return values.min() > 1e-9 * values.max()


def random_chain(seed, length, width, border, zeros, sparsity):
    rng = np.random.default_rng(seed)
    band = rng.standard_normal((length, width + 1))
    band[rng.random(length) < zeros, 0] = 0.0
    band[rng.random(band.shape) < sparsity] = 0.0
    for j in range(length):
        band[j, length - j :] = 0.0
    rows = rng.standard_normal((border, length))
    return band, rows


def check_against_dense(kkt, factor, full):
    """Inertia, and the solutions of two right-hand sides to a small backward error."""
    rng = np.random.default_rng(5)
    n = kkt.n
    assert factor.inertia == inertia_of(full)
    rhs = rng.standard_normal((n + kkt.m, 2))
    dx, dm = factor.solve(rhs[:n], rhs[n:])
    z = np.vstack([dx, dm])
    residual = np.abs(full @ z - rhs)
    size = np.abs(full) @ np.abs(z) + np.abs(rhs)
    assert np.all(residual.max(axis=0) <= 1e3 * EPS * size.max(axis=0))
    one, two = factor.solve(rhs[:n, 0], rhs[n:, 0])
    np.testing.assert_allclose(one, dx[:, 0], rtol=1e-6, atol=1e-9 * np.abs(dx).max())
    assert two.shape == (kkt.m,)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    length=st.integers(1, 60),
    width=st.one_of(st.integers(0, 6), st.integers(14, 50)),
    border=st.integers(0, 6),
    zeros=st.sampled_from([0.0, 0.3, 0.7, 1.0]),
    sparsity=st.sampled_from([0.0, 0.4, 0.9]),
)
def test_chain_has_the_inertia_and_the_solutions_of_the_dense_matrix(
    seed, length, width, border, zeros, sparsity
):
    band, rows = random_chain(seed, length, width, border, zeros, sparsity)
    kkt = ChainKKT(band, rows)
    full = dense_of(kkt)
    lower = np.zeros((length + border, length + border))
    for k in range(min(width + 1, length)):
        lower[np.arange(k, length), np.arange(length - k)] = band[: length - k, k]
    lower[length:, :length] = rows
    np.testing.assert_array_equal(full, np.tril(lower) + np.tril(lower, -1).T)
    terms = np.concatenate(kkt.magnitude(np.ones(length), np.ones(border)))
    np.testing.assert_allclose(terms, np.abs(full).sum(axis=1), rtol=1e-14)
    if well_posed(full):
        check_against_dense(kkt, kkt.factorize(), full)


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    blocks=st.integers(1, 8),
    size=st.integers(1, 5),
    reach=st.integers(0, 2),
    multipliers=st.integers(0, 2),
    border=st.integers(0, 3),
)
def test_interleaved_multipliers(seed, blocks, size, reach, multipliers, border):
    """Blocks that end in multipliers with zero diagonals, and unknowns and rows in the border."""
    rng = np.random.default_rng(seed)
    multipliers = min(multipliers, size - 1)
    diagonal = rng.standard_normal((blocks, size, size))
    diagonal += diagonal.transpose(0, 2, 1)
    lower = rng.standard_normal((blocks, reach, size, size))
    local = np.zeros(size, dtype=bool)
    local[size - multipliers :] = multipliers > 0
    both = np.outer(local, local)
    diagonal[:, both] = 0.0
    lower[:, :, both] = 0.0
    rows = rng.standard_normal((border, blocks * size))
    corner = np.diag(rng.standard_normal(border))  # border positions are unknowns here
    position = np.concatenate([np.tile(local, blocks), np.zeros(border, dtype=bool)])
    layout = ChainLayout(blocks * size, np.flatnonzero(~position), np.flatnonzero(position), border)
    kkt = ChainKKT.from_blocks(diagonal, lower, rows, corner, layout=layout)
    full = dense_of(kkt)
    n = kkt.n
    assert np.all(full[n:, n:] == 0.0)
    np.testing.assert_array_equal(full, full.T)
    if well_posed(full):
        check_against_dense(kkt, kkt.factorize(), full)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 25), m=st.integers(0, 6))
def test_dense_has_the_inertia_of_the_eigenvalues(seed, n, m):
    rng = np.random.default_rng(seed)
    hessian = rng.standard_normal((n, n))
    jacobian = rng.standard_normal((min(m, n), n))
    kkt = DenseKKT(hessian + hessian.T, jacobian)
    full = dense_of(kkt)
    if well_posed(full):
        check_against_dense(kkt, kkt.factorize(), full)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 60),
    m=st.integers(0, 6),
    zeros=st.sampled_from([0.0, 1.0]),
)
def test_tridiagonal(seed, n, m, zeros):
    band, rows = random_chain(seed, n, 1, min(m, n), zeros, 0.0)
    kkt = TridiagonalKKT(band[:, 0], band[:-1, 1] if n > 1 else np.zeros(0), rows)
    full = dense_of(kkt)
    if well_posed(full):
        check_against_dense(kkt, kkt.factorize(), full)


def both_kinds(hessian, jacobian=None):
    """The same matrix as a dense one and as a full band."""
    n = len(hessian)
    band = np.zeros((n, n))
    for k in range(n):
        band[: n - k, k] = np.diagonal(hessian, -k)
    return DenseKKT(hessian, jacobian), ChainKKT(band, jacobian)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), shift=st.floats(-3, 3), g=st.integers(0, 3))
def test_shift_gauge_and_relaxation_mean_the_same_for_every_kind(seed, shift, g):
    rng = np.random.default_rng(seed)
    n, m = 9, 2
    hessian = rng.standard_normal((n, n))
    hessian += hessian.T
    jacobian = rng.standard_normal((m, n))
    gauge = rng.standard_normal((g, n))
    metric = rng.uniform(0.5, 2.0, n)
    rhs = rng.standard_normal(n + m)
    solutions = []
    for kkt in both_kinds(hessian, jacobian):
        factor = kkt.factorize(shift, gauge, metric, relaxation=0.25)
        solutions.append((factor.inertia, *factor.solve(rhs[:n], rhs[n:])))
    full = np.zeros((n + m + g, n + m + g))
    full[:n, :n] = hessian + shift * np.diag(metric)
    full[n : n + m, :n] = jacobian
    full[n + m :, :n] = gauge
    full = np.tril(full) + np.tril(full, -1).T
    full[range(n, n + m), range(n, n + m)] = -0.25
    if not well_posed(full):
        return
    exact = np.linalg.solve(full, np.concatenate([rhs, np.zeros(g)]))
    for inertia, dx, dm in solutions:
        assert inertia == inertia_of(full)
        np.testing.assert_allclose(dx, exact[:n], rtol=1e-6, atol=1e-6 * np.abs(exact).max())
        np.testing.assert_allclose(dm, exact[n : n + m], atol=1e-6 * np.abs(exact).max())


def test_singular_leading_blocks_of_a_regular_chain():
    """Leading principal minors vanish one after the other; the whole is regular."""
    diagonal = np.zeros((6, 2, 2))
    lower = np.zeros((6, 1, 2, 2))
    diagonal[0] = [[1.0, 1.0], [1.0, 1.0]]
    diagonal[3] = [[0.0, 0.0], [0.0, 0.0]]
    lower[:, 0] = [[2.0, 1.0], [0.0, 3.0]]
    kkt = ChainKKT.from_blocks(diagonal, lower)
    full = dense_of(kkt)
    assert abs(np.linalg.det(full[:2, :2])) < 1e-15
    assert abs(np.linalg.det(full)) > 1.0
    check_against_dense(kkt, kkt.factorize(), full)


@pytest.mark.parametrize("small", [1e-6, 1e-10, 1e-14, 1e-20, 0.0])
def test_nearly_singular_leading_minors_do_not_spoil_the_solution(small):
    """A pivot of any smallness at the head of the chain is delayed, not divided by."""
    n = 30
    band = np.zeros((n, 3))
    band[:, 0], band[:, 1], band[:, 2] = 3.0, 1.0, 0.5
    band[::4, 0] = small
    band[1::4, 0] = 1.0 / 3.0 + small  # the next minor is nearly singular as well
    kkt = ChainKKT(band)
    check_against_dense(kkt, kkt.factorize(), dense_of(kkt))


def test_all_diagonals_zero_need_more_places_for_delayed_columns():
    """Thirty multipliers come before the unknowns that they act on."""
    m = 30
    jacobian = np.tril(np.ones((m, m)))
    band = np.zeros((2 * m, 2 * m))
    for column in range(m):
        band[column, m - column : 2 * m - column] = jacobian[:, column]
    layout = ChainLayout(2 * m, np.arange(m, 2 * m), np.arange(m))
    kkt = ChainKKT(band, layout=layout)
    factor = kkt.factorize()
    assert factor.inertia == (m, m, 0)
    assert factor.is_minimum
    check_against_dense(kkt, factor, dense_of(kkt))


def test_unequal_units_do_not_hide_signs():
    """A stiffness of 1e12 beside one of 1e-6, and multipliers in other units."""
    hessian = np.diag([1e12, 1e-6, -1e-6, 1.0])
    hessian[3, 0] = hessian[0, 3] = 1e5
    jacobian = np.array([[0.0, 1e-9, 1e-9, 0.0]])
    for kkt in both_kinds(hessian, jacobian):
        # On x_1 + x_2 = 0 the two small stiffnesses cancel: singular. A shift resolves the sign.
        assert kkt.factorize().inertia[2] == 1
        assert kkt.factorize(1e-9).inertia == (4, 1, 0)
        assert kkt.factorize(-1e-9).inertia == (3, 2, 0)


@pytest.mark.parametrize("n", [1, 2, 7, 200])
def test_singular_matrices_are_counted_and_refused(n):
    """A free chain of springs moves as a whole at no cost."""
    diagonal = np.full(n, 2.0)
    diagonal[[0, -1]] = 1.0 if n > 1 else 0.0
    kkt = TridiagonalKKT(diagonal, np.full(n - 1, -1.0))
    factor = kkt.factorize()
    assert factor.inertia == (n - 1, 0, 1)
    assert not factor.is_minimum
    with pytest.raises(FactorizationError, match="singular"):
        factor.solve(np.ones(n))
    pinned = kkt.factorize(gauge=np.ones((1, n)))
    assert pinned.inertia == (n, 1, 0)
    assert pinned.is_minimum


def test_one_unknown_and_one_constraint():
    for kkt in (DenseKKT([[-2.0]], [[3.0]]), ChainKKT(np.array([[-2.0]]), np.array([[3.0]]))):
        factor = kkt.factorize()
        assert factor.inertia == (1, 1, 0)
        dx, dm = factor.solve([1.0], [6.0])
        np.testing.assert_allclose([dx[0], dm[0]], [2.0, 5.0 / 3.0])


def test_apply_and_magnitude_agree_between_kinds():
    rng = np.random.default_rng(2)
    hessian = rng.standard_normal((6, 6))
    hessian += hessian.T
    jacobian = rng.standard_normal((2, 6))
    dense, chain = both_kinds(hessian, jacobian)
    x, y = rng.standard_normal(6), rng.standard_normal(2)
    for name in ("apply", "magnitude"):
        for a, b in zip(getattr(dense, name)(x, y), getattr(chain, name)(x, y), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(chain.jacobian_rows(), jacobian)


def test_ill_conditioned_solves_are_refined_to_rounding():
    """A clamped beam of 2000 cells: condition 1e13, residual still at round-off."""
    n = 2000
    band = np.zeros((n, 3))
    band[:, 0], band[:, 1], band[:, 2] = 6.0, -4.0, 1.0
    kkt = ChainKKT(band)
    factor = kkt.factorize()
    assert factor.inertia == (n, 0, 0)
    x = np.sin(np.arange(n))
    force, _ = kkt.apply(x, np.zeros(0))
    found, _ = factor.solve(force)
    again, _ = kkt.apply(found, np.zeros(0))
    size, _ = kkt.magnitude(found, np.zeros(0))
    assert np.max(np.abs(again - force) / size) < 4 * EPS


def test_entries_that_are_not_finite_are_refused():
    band = np.ones((4, 2))
    band[2, 0] = np.nan
    with pytest.raises(FactorizationError, match="NaN"):
        ChainKKT(band).factorize()
    with pytest.raises(FactorizationError, match="NaN"):
        DenseKKT([[np.inf]]).factorize()
    border = np.ones((1, 4))
    border[0, 1] = np.inf
    with pytest.raises(FactorizationError, match="NaN"):
        ChainKKT(np.ones((4, 1)), border).factorize()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), exponent=st.integers(-12, 12))
def test_badly_scaled_chains_are_right_or_refused(seed, exponent):
    """Rows scaled by up to 10**12: inertia is invariant; a result is right, or an error."""
    band, rows = random_chain(seed, 15, 3, 2, 0.3, 0.0)
    full = dense_of(ChainKKT(band, rows))
    if not well_posed(full):
        return
    rng = np.random.default_rng(seed)
    t = 10.0 ** (exponent * rng.random(17) / 2)
    for j in range(15):
        for k in range(min(4, 15 - j)):
            band[j, k] *= t[j] * t[j + k]
    rows = rows * t[15:, None] * t[:15]
    assert ChainKKT(band, rows).factorize().inertia == inertia_of(full)


def test_wrong_shapes_are_named():
    with pytest.raises(InvalidInput, match="hessian"):
        DenseKKT(np.ones((2, 3)))
    with pytest.raises(InvalidInput, match="not symmetric"):
        DenseKKT([[1.0, 2.0], [0.0, 1.0]])
    with pytest.raises(InvalidInput, match="jacobian"):
        DenseKKT(np.eye(2), np.ones((1, 3)))
    with pytest.raises(InvalidInput, match="band"):
        ChainKKT(np.ones(3))
    with pytest.raises(InvalidInput, match="border"):
        ChainKKT(np.ones((3, 1)), np.ones((1, 2)))
    with pytest.raises(InvalidInput, match="corner"):
        ChainKKT(np.ones((3, 1)), np.ones((1, 3)), np.ones((2, 2)))
    with pytest.raises(InvalidInput, match="once"):
        ChainLayout(3, [0, 1, 1])
    with pytest.raises(InvalidInput, match="layout"):
        ChainKKT(np.ones((3, 1)), layout=ChainLayout(4))
    with pytest.raises(InvalidInput, match="off_diagonal"):
        TridiagonalKKT(np.ones(3), np.ones(3))
    with pytest.raises(InvalidInput, match="half_bandwidth"):
        ChainKKT.from_blocks(np.ones((2, 2, 2)), np.ones((2, 1, 2, 2)), half_bandwidth=1)
    with pytest.raises(InvalidInput, match="gauge"):
        DenseKKT(np.eye(2)).factorize(gauge=np.ones((1, 3)))
    with pytest.raises(InvalidInput, match="metric"):
        DenseKKT(np.eye(2)).factorize(1.0, metric=np.zeros(2))
    factor = DenseKKT(np.eye(2)).factorize()
    with pytest.raises(InvalidInput, match="rhs_x"):
        factor.solve(np.ones(3))
    with pytest.raises(InvalidInput, match="rhs_c"):
        factor.solve(np.ones(2), np.ones(1))


# ---- sparse ---------------------------------------------------------------------------------------


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 60),
    m=st.integers(0, 12),
    g=st.integers(0, 2),
    density=st.sampled_from([0.02, 0.1, 0.3]),
    loose=st.booleans(),
    leaf=st.sampled_from([2, 6, 96]),
)
def test_sparse_equals_dense(seed, n, m, g, density, loose, leaf):
    """Random patterns, also without diagonals and in several parts; small fronts delay often."""
    rng = np.random.default_rng(seed)
    m = min(m, n - 1)
    hessian = sparse.random_array((n, n), density=density, rng=rng, data_sampler=rng.normal)
    hessian = hessian + hessian.T
    if not loose:
        hessian = hessian + sparse.diags_array(rng.normal(size=n))
    jacobian = sparse.random_array((m, n), density=0.2, rng=rng, data_sampler=rng.normal)
    gauge, metric = rng.normal(size=(g, n)), rng.uniform(0.5, 2.0, n)
    dense = DenseKKT(hessian.toarray(), jacobian.toarray())
    full = dense.matrix(0.0, gauge, metric, 0.0)
    if m + g >= n or not well_posed(full):
        return
    before = _multifrontal.LEAF
    _multifrontal.LEAF = leaf
    _multifrontal._PLANS.clear()
    try:
        factor = SparseKKT(hessian, jacobian).factorize(0.0, gauge, metric)
    finally:
        _multifrontal.LEAF = before
        _multifrontal._PLANS.clear()
    assert factor.inertia == inertia_of(full)
    rhs = rng.normal(size=(n + m, 2))
    found = np.vstack(factor.solve(rhs[:n], rhs[n:]))
    exact = np.linalg.solve(full, np.vstack([rhs, np.zeros((g, 2))]))[: n + m]
    condition = np.linalg.cond(full)
    np.testing.assert_allclose(found, exact, atol=1e3 * EPS * condition * np.abs(exact).max())


def laplacian(n):
    """The five-point Laplacian of the square, zero at the sides, spacing 1."""
    line = sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n))
    eye = sparse.eye_array(n)
    return (sparse.kron(line, eye) + sparse.kron(eye, line)).tocsc()


@pytest.mark.parametrize("n", [5, 40])
def test_inertia_of_a_shifted_laplacian(n):
    """Eigenvalues are known: 4 - 2 cos a - 2 cos b."""
    angle = np.pi * np.arange(1, n + 1) / (n + 1)
    values = np.add.outer(2 - 2 * np.cos(angle), 2 - 2 * np.cos(angle)).ravel()
    kkt = SparseKKT(laplacian(n))
    for shift in (-0.013, -0.61, -3.33, -7.9):
        below = int(np.sum(values < -shift))
        factor = kkt.factorize(shift)
        assert factor.inertia == (n * n - below, below, 0)
    # At an eigenvalue the matrix is singular; the middle one, 4, has multiplicity n.
    at = kkt.factorize(-4.0)
    assert at.inertia == ((n * n - n) // 2, (n * n - n) // 2, n)
    force = np.sin(np.arange(n * n))
    dx, _ = kkt.factorize(-0.61).solve(force)
    np.testing.assert_allclose(laplacian(n) @ dx - 0.61 * dx, force, atol=1e-10)


def test_sparse_saddle_point_whose_multipliers_have_no_stiffness():
    """w with a stiff rotation: unknowns (w, r), constraint r = difference of w, no energy in r."""
    n = 30
    w = laplacian(n) @ laplacian(n)
    slope = sparse.diags_array([1.0, -1.0], offsets=[0, 1], shape=(n * n, n * n))
    hessian = sparse.block_diag([w, sparse.csr_array((n * n, n * n))])
    jacobian = sparse.hstack([slope, -sparse.eye_array(n * n)])
    factor = SparseKKT(hessian, jacobian).factorize()
    assert factor.inertia == (2 * n * n, n * n, 0)
    assert factor.is_minimum
    force = np.zeros(2 * n * n)
    force[: n * n] = 1.0
    dx, dm = factor.solve(force)
    np.testing.assert_allclose(w @ dx[: n * n], 1.0, atol=1e-8)
    np.testing.assert_allclose(dx[n * n :], slope @ dx[: n * n], atol=1e-9 * np.abs(dx).max())
    assert np.max(np.abs(dm)) < 1e-7


def test_free_plate_needs_its_gauge():
    """A free sheet of springs: constants are neutral; the dense gauge row removes them."""
    n = 25
    edge = sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(n - 1, n))
    line = edge.T @ edge
    eye = sparse.eye_array(n)
    kkt = SparseKKT(sparse.kron(line, eye) + sparse.kron(eye, line))
    assert kkt.factorize().inertia == (n * n - 1, 0, 1)
    factor = kkt.factorize(gauge=np.ones((1, n * n)))
    assert factor.inertia == (n * n, 1, 0)
    assert factor.is_minimum


def test_a_mean_that_is_held_does_not_tie_the_fronts_together():
    """A constraint on every tenth unknown; without it, a cut takes a line of the square or two."""
    n = 40
    row = np.zeros(n * n)
    row[::10] = 1.0
    factor = SparseKKT(laplacian(n), sparse.csr_array(row[None])).factorize()
    assert factor.inertia == (n * n, 1, 0)
    fronts = factor._factors.plan.fronts
    assert max(f.last - f.first + len(f.border) for f in fronts) < max(
        3 * n, 2 * _multifrontal.LEAF
    )
    force = np.sin(np.arange(n * n))
    dx, dm = factor.solve(force)
    np.testing.assert_allclose(laplacian(n) @ dx + dm * row, force, atol=1e-11)
    assert abs(row @ dx) < 1e-11


def test_the_analysis_of_a_pattern_is_remembered():
    _multifrontal._PLANS.clear()
    kkt = SparseKKT(laplacian(12))
    for shift in (0.0, 1.0, -2.5):
        kkt.factorize(shift)
    SparseKKT(3.0 * laplacian(12)).factorize()
    assert len(_multifrontal._PLANS) == 1


def test_sparse_input_is_checked():
    with pytest.raises(InvalidInput, match="square"):
        SparseKKT(sparse.csr_array((2, 3)))
    with pytest.raises(InvalidInput, match="not symmetric"):
        SparseKKT(sparse.csr_array(np.array([[1.0, 2.0], [0.0, 1.0]])))
    with pytest.raises(InvalidInput, match="jacobian"):
        SparseKKT(sparse.eye_array(3), sparse.eye_array(2))
    with pytest.raises(FactorizationError, match="NaN"):
        SparseKKT(sparse.diags_array([1.0, np.nan])).factorize()


@pytest.mark.parametrize("size", range(1, 13))
def test_rotations_find_the_eigenvalues_of_small_matrices(size):
    rng = np.random.default_rng(size)
    full = rng.standard_normal((size, size))
    vector = rng.standard_normal((size, 1))
    hollow = full + full.T
    np.fill_diagonal(hollow, 0.0)
    for matrix in (full + full.T, 1e-150 * vector @ vector.T, hollow, np.zeros((size, size))):
        values, vectors = np.empty(size), np.empty((size, size))
        _chain._eigen_of_small(matrix.copy(), values, vectors)
        scale = 1e-14 * size * np.max(np.abs(matrix))
        assert np.abs(vectors.T @ vectors - np.eye(size)).max() < 1e-13
        assert np.abs(matrix @ vectors - vectors * values).max() <= scale
