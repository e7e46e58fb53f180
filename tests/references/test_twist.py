"""Twisted rings and rods: closed forms against Galerkin methods on the second variation."""

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

from lissome.errors import InvalidInput
from lissome.references import twist


def _ring_spectrum(bending, torsion, turns, total, count=8, modes=8):
    """Lowest eigenvalues of the unreduced form of the twisted circle, closure as constraints."""
    n = 64
    s = 2 * np.pi * np.arange(n) / n
    k, tau = float(turns), total / (2 * np.pi)
    normal = np.stack([-np.cos(k * s), -np.sin(k * s), 0 * s], axis=1)
    tangent = np.stack([-np.sin(k * s), np.cos(k * s), 0 * s], axis=1)
    frames = np.stack([normal, np.cross(tangent, normal), tangent], axis=2)
    m = np.array([0.0, bending * k, torsion * tau])
    force = torsion * tau * k * np.array([0.0, 1.0, 0.0])
    # equilibrium of the circle itself: M' + t x N = 0
    assert np.allclose(np.cross([0, k, 0], m) + np.cross([0, 0, 1.0], force), 0.0)
    order = np.arange(1, modes + 1)
    values = np.hstack([np.ones((n, 1)), np.cos(np.outer(s, order)), np.sin(np.outer(s, order))])
    slopes = np.hstack(
        [np.zeros((n, 1)), -order * np.sin(np.outer(s, order)), order * np.cos(np.outer(s, order))]
    )
    size = values.shape[1]
    rotation = np.einsum("pb,ij->pijb", values, np.eye(3)).reshape(n, 3, 3 * size)
    spin = np.cross([0, k, 0], np.eye(3)).T
    change = np.einsum("pb,ij->pijb", slopes, np.eye(3)).reshape(n, 3, 3 * size)
    change = change + np.einsum("ij,pja->pia", spin, rotation)
    cross = np.array([[0, -m[2], m[1]], [m[2], 0, -m[0]], [-m[1], m[0], 0]])
    e3 = np.array([0, 0, 1.0])
    form = np.einsum("pia,i,pib->ab", change, [bending, bending, torsion], change)
    # -M.(theta x theta') = theta.(M x theta')
    form += np.einsum("pia,ij,pjb->ab", rotation, cross, change)
    block = -np.outer(force, e3) + (force @ e3) * np.eye(3)
    form += np.einsum("pia,ij,pjb->ab", rotation, block, rotation)
    form = 0.5 * (form + form.T)
    mass = np.einsum("pia,pib->ab", rotation, rotation)
    closure = np.einsum("pij,jk,pka->ia", frames, np.cross(np.eye(3), e3).T, rotation)
    basis = null_space(closure)
    return eigh(
        basis.T @ form @ basis,
        basis.T @ mass @ basis,
        eigvals_only=True,
        subset_by_index=(0, count),
    )


@pytest.mark.parametrize(("bending", "torsion"), [(1.0, 1.0), (1.0, 0.7), (2.0, 3.0)])
def test_ring_loses_stability_at_the_threshold(bending, torsion):
    total = twist.ring_twist(bending, torsion)
    below = _ring_spectrum(bending, torsion, 1, 0.999 * total)
    at = _ring_spectrum(bending, torsion, 1, total)
    above = _ring_spectrum(bending, torsion, 1, 1.001 * total)
    # three rigid rotations and the spin of the isotropic section about its center line
    assert np.all(np.abs(below[:4]) < 1e-10)
    assert below[4] > 1e-5
    assert np.sum(np.abs(at) < 1e-9) == 6
    assert above[0] < -1e-5
    assert np.sum(above < -1e-8) == 2


def test_higher_modes_and_covered_rings():
    for turns, mode in ((1, 3), (1, 4), (2, 3), (3, 5)):
        total = twist.ring_twist(1.0, 0.8, mode=mode, turns=turns)
        values = _ring_spectrum(1.0, 0.8, turns, total, count=20)
        usual = np.sum(np.abs(_ring_spectrum(1.0, 0.8, turns, 1.01 * total, count=20)) < 1e-9)
        assert np.sum(np.abs(values) < 1e-9) == usual + 2
    assert _ring_spectrum(1.0, 0.8, 2, 0.0)[0] < -0.1  # a double ring is unstable without twist


def _clamped_rod(torque, terms=30):
    """Least thrust of the clamped rod: Hermitian Galerkin form in [s(1 - s)]^2 times polynomials."""
    x, w = np.polynomial.legendre.leggauss(80)
    s, w = 0.5 * (x + 1), 0.5 * w
    g, g1 = (s - s**2) ** 2, 2 * (s - s**2) * (1 - 2 * s)
    g2 = 2 * (1 - 2 * s) ** 2 - 4 * (s - s**2)
    first, second = [], []
    for n in range(terms):
        series = np.polynomial.Chebyshev.basis(n, domain=[0, 1])
        p, p1, p2 = series(s), series.deriv()(s), series.deriv(2)(s)
        first.append(g1 * p + g * p1)
        second.append(g2 * p + 2 * g1 * p1 + g * p2)
    first, second = np.array(first), np.array(second)
    skew = (first * w) @ second.T
    stiffness = (second * w) @ second.T - 0.5j * torque * (skew - skew.T)
    return eigh(stiffness, (first * w) @ first.T, eigvals_only=True)[0]


@pytest.mark.parametrize("torque", [0.0, 0.01, 1.0, -3.0, 6.0, 8.9868, 10.0, 14.0, 30.0])
def test_clamped_rod_by_galerkin(torque):
    assert twist.rod_thrust(torque, "clamped") == pytest.approx(_clamped_rod(torque), abs=1e-6)


def test_limits_of_the_straight_rod():
    torque = twist.rod_torque(0.0, "clamped")
    assert np.tan(torque / 2) == pytest.approx(torque / 2, rel=1e-9)
    assert twist.rod_thrust(0.0) == pytest.approx(np.pi**2)
    assert twist.rod_torque(0.0) == pytest.approx(2 * np.pi)
    for ends in ("hinged", "clamped"):
        for thrust in (-400.0, -20.0, 0.0, 5.0):
            assert twist.rod_thrust(twist.rod_torque(thrust, ends), ends) == pytest.approx(
                thrust, abs=1e-8
            )
    # a long rod in tension: M^2 = 4 B |P|, whatever the ends
    for ends in ("hinged", "clamped"):
        assert twist.rod_torque(-500.0, ends) / np.sqrt(2000.0) == pytest.approx(1.0, rel=0.02)


def test_hinged_rod_satisfies_its_equations():
    """B w'' - i M w' + P w = 0 with w = 0 at both ends: the moment about the line of the ends."""
    s = np.linspace(0, 1, 2001)
    torque = 3.0
    thrust = twist.rod_thrust(torque)
    w = np.exp(0.5j * torque * s) * np.sin(np.pi * s)
    first = np.gradient(w, s, edge_order=2)
    second = np.gradient(first, s, edge_order=2)
    residual = second - 1j * torque * first + thrust * w
    assert np.max(np.abs(residual[5:-5])) < 1e-4
    assert abs(w[0]) + abs(w[-1]) < 1e-12


def test_bad_input():
    with pytest.raises(InvalidInput, match="mode"):
        twist.ring_twist(1.0, 1.0, mode=2, turns=2)
    with pytest.raises(InvalidInput, match="ends"):
        twist.rod_thrust(1.0, "free")
    with pytest.raises(InvalidInput, match="thrust"):
        twist.rod_torque(40.0, "clamped")
    with pytest.raises(InvalidInput, match="torque"):
        twist.rod_thrust(60.0, "clamped")
