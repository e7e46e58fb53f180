"""Eigenvalues of the constrained second variation: closed forms, dense projection, mesh limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import (
    Column,
    HangingChain,
    PressedPlate,
    Ring,
    Strip,
    Truss,
    balloons_sharing,
    pitchfork,
)

from lissome import DenseStructure, equilibrate, smallest_eigenvalue
from lissome.errors import InvalidInput
from lissome.factorization import ChainKKT, DenseKKT
from lissome.stability import admissible_motions, lowest_mode
from lissome.structure import BaseStructure, Evaluation, VectorState


def projected_eigenvalues(equilibrium):
    """All eigenvalues by a dense projection onto the admissible motions."""
    kkt, metric = equilibrium.evaluation.kkt, equilibrium.metric
    n = kkt.n
    hessian = np.array([kkt.apply(e, np.zeros(kkt.m))[0] for e in np.eye(n)])
    root = np.sqrt(metric)
    hessian = hessian / root / root[:, None]
    rows = np.vstack([kkt.jacobian_rows(), equilibrium.gauge]) / root
    if len(rows):
        basis = np.linalg.svd(rows)[2][len(rows) :]
        hessian = basis @ hessian @ basis.T
    return np.linalg.eigvalsh(0.5 * (hessian + hessian.T))


@pytest.mark.parametrize(
    ("structure", "require"),
    [
        (Column(1.0, 20), "stable"),
        (Column(30.0, 20), "any"),
        (Column(30.0, 20, kind="dense"), "stable"),
        (Strip(0.7, 30), "stable"),
        (Strip(0.7, 30, mode=2), "any"),
        (Strip(0.7, 30, mode=3, kind="dense"), "any"),
        (Ring(16, disturbance=0.2), "stable"),
        (HangingChain(0.6, 10), "stable"),
        (balloons_sharing(9.0, 3), "any"),
        (Truss(0.4, sway=True).under(0.01), "stable"),
    ],
)
def test_lowest_eigenvalues_equal_those_of_the_dense_projection(structure, require):
    found = equilibrate(structure, require=require)
    exact = projected_eigenvalues(found)
    assert found.index == np.sum(exact < 0)
    count = min(4, len(exact))
    spectrum = smallest_eigenvalue(found, count=count)
    np.testing.assert_allclose(
        spectrum.values, exact[:count], rtol=1e-8, atol=1e-11 * np.abs(exact).max()
    )
    assert found.smallest_eigenvalue() == pytest.approx(exact[0], rel=1e-8)
    # Modes: orthonormal in the metric, admissible, and eigenvectors.
    kkt, modes = found.evaluation.kkt, spectrum.modes
    gram = modes @ (found.metric * modes).T
    np.testing.assert_allclose(gram, np.eye(count), atol=1e-7)
    for v in modes:
        assert np.max(np.abs(kkt.apply(v, np.zeros(kkt.m))[1]), initial=0.0) < 1e-10
        assert np.max(np.abs(found.gauge @ v), initial=0.0) < 1e-10
        assert v[np.argmax(np.abs(v))] > 0
    assert 0 < spectrum.floor < 1e-6 * np.abs(exact).max()


def test_straight_column():
    """(2 - 2 cos a) / h^2 - P with a = (2 j - 1) pi h / 2: known also for the discrete column."""
    n, load = 50, 12.0
    a = np.pi / (2 * n) * (2 * np.arange(1, 5) - 1)
    exact = (2 - 2 * np.cos(a)) * n**2 - load
    found = equilibrate(Column(load, n), require="any")
    assert found.index == 1
    np.testing.assert_allclose(smallest_eigenvalue(found, count=4).values, exact, rtol=1e-9)


def test_ring_has_double_eigenvalues():
    """Mode k of the free ring costs (2 - 2 cos(2 pi k / N)) N^2, twice; k = 0, 1 are excluded."""
    n = 32
    exact = (2 - 2 * np.cos(2 * np.pi * np.array([2, 2, 3, 3, 4]) / n)) * n**2
    found = equilibrate(Ring(n, disturbance=0.3))
    np.testing.assert_allclose(smallest_eigenvalue(found, count=5).values, exact, rtol=1e-8)


def test_pressed_plate():
    """A sparse structure: flat below the critical load, an eigenvalue of its exact spectrum."""
    critical = PressedPlate(0.0).critical_load()
    for part in (0.9, 1.1, 2.0):
        flat = equilibrate(PressedPlate(part * critical), require="any")
        exact = flat.structure.flat_eigenvalues()
        assert flat.index == np.sum(exact < 0)
        found = smallest_eigenvalue(flat, count=5)
        np.testing.assert_allclose(found.values, exact[:5], rtol=1e-8)
    bulged = equilibrate(PressedPlate(1.1 * critical))
    assert bulged.stable
    assert np.max(np.abs(bulged.state.x)) > 0.1
    assert bulged.smallest_eigenvalue() > 0
    assert equilibrate(PressedPlate(0.9 * critical)).energy == 0.0


@pytest.mark.parametrize("spread", [1.0, 100.0])
@pytest.mark.parametrize("multiplicity", [2, 5, 9])
def test_no_copy_of_a_multiple_eigenvalue_is_missed(multiplicity, spread):
    """Nor where the metric differs from place to place."""
    values = np.concatenate([np.full(multiplicity, 2.0), np.arange(3.0, 12.0)])
    n = len(values)
    metric = np.geomspace(1.0, spread, n)[np.random.default_rng(1).permutation(n)]
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((n, n)))[0]
    half = np.sqrt(metric)[:, None] * turn
    hessian = half @ np.diag(values) @ half.T  # so that hessian u = value metric u
    hessian = 0.5 * (hessian + hessian.T)
    structure = DenseStructure(
        initial=np.zeros(n),
        energy=lambda x: 0.5 * x @ hessian @ x,
        gradient=lambda x: hessian @ x,
        hessian=lambda x: hessian,
        masses=metric,
    )
    spectrum = smallest_eigenvalue(equilibrate(structure), count=multiplicity + 1)
    np.testing.assert_allclose(spectrum.values, np.sort(values)[: multiplicity + 1])
    gram = spectrum.modes @ (metric * spectrum.modes).T
    np.testing.assert_allclose(gram, np.eye(multiplicity + 1), atol=1e-9)


@pytest.mark.parametrize("structure", [Strip(0.7, 30), HangingChain(0.6, 10)])
def test_the_floor_belongs_to_the_lowest_eigenvalue(structure):
    found = equilibrate(structure)
    one, several = (smallest_eigenvalue(found, count=count) for count in (1, 5))
    assert several.floor == pytest.approx(one.floor, rel=1e-6)


@pytest.mark.parametrize(
    "make",
    [lambda n: Column(4.0, n, tip_angle=1.0), lambda n: Strip(0.7, n)],
    ids=["column", "strip"],
)
def test_eigenvalues_do_not_depend_on_the_mesh(make):
    """Per unit length: second-order convergence to the eigenvalue of the continuum."""
    values = np.array(
        [equilibrate(make(n)).smallest_eigenvalue() for n in (40, 80, 160, 320, 5120)]
    )
    errors = np.abs(values[:-1] - values[-1])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(np.abs(orders - 2) < 0.1)


def test_the_metric_scales_the_eigenvalues():
    one = equilibrate(pitchfork(2.0))
    heavy = DenseStructure(
        initial=one.state.x,
        energy=one.structure.energy,
        gradient=one.structure.gradient,
        hessian=one.structure.hessian,
        masses=[4.0],
    )
    assert one.smallest_eigenvalue() == pytest.approx(4.0, rel=1e-10)
    found = equilibrate(heavy)
    assert found.smallest_eigenvalue() == pytest.approx(1.0, rel=1e-10)
    assert found.mode() == pytest.approx([0.5])


def test_of_a_state_that_is_no_equilibrium():
    structure = Strip(0.7, 30)
    found = equilibrate(structure)
    here = smallest_eigenvalue(structure, found.state, found.multipliers)
    assert here.values[0] == pytest.approx(found.smallest_eigenvalue(), rel=1e-9)
    elsewhere = smallest_eigenvalue(structure, structure.start(), found.multipliers)
    assert elsewhere.values[0] != pytest.approx(here.values[0], rel=1e-3)


class Quadratic(BaseStructure):
    def __init__(self, kkt, gauge):
        self.kkt, self.rows = kkt, gauge
        self.size, self.constraints_count = kkt.n, kkt.m

    size = constraints_count = 0

    def start(self):
        return VectorState(np.zeros(self.size))

    def gauge(self, state):
        return self.rows

    def evaluate(self, state, multipliers, order=2):
        return Evaluation(0.0, np.zeros(self.kkt.m), np.zeros(self.kkt.n), self.kkt)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 14),
    m=st.integers(0, 3),
    g=st.integers(0, 2),
    count=st.integers(1, 4),
    spread=st.sampled_from([0, 4]),
)
def test_random_matrices(seed, n, m, g, count, spread):
    """Indefinite Hessians with clusters, constraints and gauges, dense and banded."""
    if m + g + count > n:
        return
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    values = rng.integers(-2, 3, n) * 10.0 ** (spread * rng.random(n))
    hessian = turn @ np.diag(values) @ turn.T
    hessian = 0.5 * (hessian + hessian.T)
    jacobian, gauge = rng.standard_normal((m, n)), rng.standard_normal((g, n))
    rows = np.vstack([jacobian, gauge])
    basis = np.linalg.svd(rows)[2][m + g :] if m + g else np.eye(n)
    exact = np.linalg.eigvalsh(basis @ hessian @ basis.T)[:count]
    band = np.zeros((n, n))
    for k in range(n):
        band[: n - k, k] = np.diagonal(hessian, -k)
    for kkt in (DenseKKT(hessian, jacobian), ChainKKT(band, jacobian)):
        found = smallest_eigenvalue(
            Quadratic(kkt, gauge), VectorState(np.zeros(n)), np.zeros(m), count=count
        )
        np.testing.assert_allclose(
            found.values, exact, rtol=1e-5, atol=1e-6 * max(1.0, np.abs(exact).max())
        )


def test_forces_of_springs_as_unknowns():
    """Masses between walls, and the forces of the springs between them: 2 - 2 cos(j pi / (n + 1))."""
    n, stiffness = 12, 3.0
    rows = np.zeros((n + 1, n))
    rows[np.arange(n), np.arange(n)] = 1.0
    rows[np.arange(1, n + 1), np.arange(n)] = -1.0
    softness = np.full(n + 1, 1.0 / stiffness)
    exact = stiffness * (2.0 - 2.0 * np.cos(np.arange(1, n + 1) * np.pi / (n + 1)))
    loose = VectorState(np.zeros(n))
    for rigid in (0, 4):  # springs at one end that do not yield: masses at the wall
        softness[:rigid] = 0.0
        kkt = ChainKKT(np.zeros((n, 1)), rows, -np.diag(softness))
        structure = Quadratic(kkt, np.zeros((0, n)))
        left = n - rigid
        assert admissible_motions(kkt) == left
        exact = stiffness * (2.0 - 2.0 * np.cos(np.arange(1, left + 1) * np.pi / (left + 1)))
        found = smallest_eigenvalue(structure, loose, np.zeros(n + 1), count=left)
        np.testing.assert_allclose(found.values, exact, rtol=1e-9)
        shape = np.sin(np.arange(1, left + 1) * np.pi / (left + 1))
        assert found.modes[0, rigid:] == pytest.approx(shape / np.linalg.norm(shape), abs=1e-9)
        assert np.max(np.abs(found.modes[:, :rigid]), initial=0.0) < 1e-12
        value, mode = lowest_mode(kkt, kkt.factorize(), np.ones(n))
        assert value == pytest.approx(exact[0], rel=1e-5)
        assert np.abs(mode) == pytest.approx(np.abs(found.modes[0]), abs=1e-2)
        with pytest.raises(InvalidInput, match=f"there are {left} admissible motions"):
            smallest_eigenvalue(structure, loose, np.zeros(n + 1), count=left + 1)


def test_an_eigenvalue_far_below_the_stiffness_of_yielding_parts_is_resolved():
    """No part of a matrix that does not depend on the state makes the sign of an eigenvalue unsafe."""
    n, least = 12, 1e-8
    rows = np.diff(np.eye(n + 2), axis=0)[:, 1:-1]
    push = 2.0 - 2.0 * np.cos(np.pi / (n + 1)) - least  # (all but) what the springs can bear
    kkt = ChainKKT(np.full((n, 1), -push), rows, -np.eye(n + 1))
    found = equilibrate(Quadratic(kkt, np.zeros((0, n))))
    assert found.stable
    assert found.smallest_eigenvalue() == pytest.approx(least, rel=1e-6)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 14),
    soft=st.integers(1, 20),
    m=st.integers(0, 3),
    g=st.integers(0, 2),
)
def test_random_matrices_with_compliances(seed, n, soft, m, g):
    """Finite eigenvalues of the pencil of the KKT matrix and diag(M, 0), by elimination."""
    count = min(3, n - m - g)
    if count < 1:
        return
    rng = np.random.default_rng(seed)
    hessian = rng.standard_normal((n, n))
    hessian = hessian + hessian.T
    rows, gauge = rng.standard_normal((soft + m, n)), rng.standard_normal((g, n))
    factor = rng.standard_normal((soft, soft)) + 3.0 * np.eye(soft)
    corner = np.zeros((soft + m, soft + m))
    corner[:soft, :soft] = -factor @ factor.T
    metric = rng.uniform(0.5, 2.0, n)
    band = np.zeros((n, n))
    for k in range(n):
        band[: n - k, k] = np.diagonal(hessian, -k)
    kkt = ChainKKT(band, rows, corner)
    structure = Quadratic(kkt, gauge)
    structure.metric = lambda state: metric
    reduced = hessian + rows[:soft].T @ np.linalg.solve(factor @ factor.T, rows[:soft])
    root = np.sqrt(metric)
    forbidden = np.vstack([rows[soft:], gauge]) / root
    basis = np.linalg.svd(forbidden)[2][m + g :] if m + g else np.eye(n)
    exact = np.linalg.eigvalsh(basis @ (reduced / root / root[:, None]) @ basis.T)[:count]
    assert admissible_motions(kkt, g) == n - m - g
    found = smallest_eigenvalue(
        structure, VectorState(np.zeros(n)), np.zeros(soft + m), count=count
    )
    np.testing.assert_allclose(found.values, exact, rtol=1e-6, atol=1e-7 * np.abs(reduced).max())


def test_bad_arguments():
    found = equilibrate(Strip(0.7, 10))
    fixed = Quadratic(DenseKKT(np.eye(2), np.eye(2)), np.zeros((0, 2)))
    with pytest.raises(InvalidInput, match="leave no admissible motion"):
        smallest_eigenvalue(fixed, fixed.start(), np.zeros(2))
    with pytest.raises(InvalidInput, match="count"):
        smallest_eigenvalue(found, count=8)
    with pytest.raises(InvalidInput, match="count"):
        smallest_eigenvalue(found, count=0)
    with pytest.raises(InvalidInput, match="state"):
        smallest_eigenvalue(found.structure)
    with pytest.raises(InvalidInput, match="multipliers"):
        smallest_eigenvalue(found.structure, found.state)
    with pytest.raises(InvalidInput, match="those of the Equilibrium"):
        smallest_eigenvalue(found, found.structure.start())
    with pytest.raises(InvalidInput, match="those of the Equilibrium"):
        smallest_eigenvalue(found, multipliers=np.zeros(2))
