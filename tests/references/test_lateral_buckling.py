"""Lateral-torsional buckling: closed forms against Galerkin, collocation and Koiter's expansion."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev, legendre
from scipy.linalg import eigh
from scipy.optimize import fsolve

from lissome import literature
from lissome.errors import InvalidInput
from lissome.references import lateral_buckling


def _galerkin(order):
    """Lowest eigenvalues of y'' + lambda x^4 y = 0 from polynomials that vanish at 1."""
    x, w = legendre.leggauss(2 * order + 6)
    x, w = (x + 1) / 2, w / 2
    # (1 - x) times Legendre polynomials; y'(0) = 0 is natural
    basis, slope = [], []
    for n in range(order):
        p = legendre.Legendre.basis(n, domain=[0, 1])
        basis.append((1 - x) * p(x))
        slope.append((1 - x) * p.deriv()(x) - p(x))
    basis, slope = np.array(basis), np.array(slope)
    # the stiffness is well conditioned, the mass with its weight is not
    inverse = eigh((basis * w * x**4) @ basis.T, (slope * w) @ slope.T, eigvals_only=True)
    return 1 / inverse[::-1]


def test_eigenvalues_by_galerkin():
    exact = lateral_buckling.eigenvalues(4)
    assert np.allclose(_galerkin(26)[:4], exact, rtol=1e-10)
    assert exact[0] == pytest.approx(41.3048, abs=5e-5)
    # from above, and ever closer
    errors = [_galerkin(n)[0] - exact[0] for n in (4, 6, 8)]
    assert errors[0] > errors[1] > errors[2] > 0


def test_published_loads_are_recomputed():
    for nu in (0.0, 0.3, 0.5):
        linear = float(literature.value("an-load-extensible")) / np.sqrt(1 + nu)
        sadowsky = float(literature.value("an-load-sadowsky")) / (1 - nu**2)
        assert lateral_buckling.linear_load(nu) == pytest.approx(linear, abs=6e-4)
        assert lateral_buckling.sadowsky_load(nu) == pytest.approx(sadowsky, abs=6e-4 / (1 - nu**2))
        assert (1 + nu) * lateral_buckling.linear_load(nu) ** 2 / 8 == pytest.approx(
            lateral_buckling.eigenvalues()[0], rel=1e-14
        )


def test_mode_solves_its_equation():
    """By finite differences of the twist angle."""
    s, h = np.linspace(0.05, 0.9, 30), 1e-4
    y = [lateral_buckling.mode(s + d) for d in (-h, 0, h)]
    bend = (y[0] - 2 * y[1] + y[2]) / h**2
    assert np.allclose(bend, -lateral_buckling.eigenvalues()[0] * (1 - s) ** 4 * y[1], atol=1e-5)
    assert lateral_buckling.mode(1 - 1e-9) == pytest.approx(1, abs=1e-9)
    assert abs(lateral_buckling.mode(1e-12)) < 1e-10


def test_sadowsky_load_by_chebyshev_collocation():
    """y as a polynomial in the cube of the distance from the free end; the load is an unknown."""
    order = 40
    nodes = (1 - np.cos(np.pi * np.arange(order + 1) / order)) / 2
    values = chebyshev.chebvander(2 * nodes - 1, order)
    slopes = np.array(
        [2 * chebyshev.Chebyshev.basis(n).deriv()(2 * nodes - 1) for n in range(order + 1)]
    ).T
    derivative = slopes @ np.linalg.inv(values)
    y, load = -nodes, 20.0
    for _ in range(30):
        # 3 v (1 + y^2) dy/dv + 2 y (1 - y^2) + load v/4 = 0; y = 0 at v = 0 is implied
        rate = derivative @ y
        residual = 3 * nodes * (1 + y**2) * rate + 2 * y * (1 - y**2) + load * nodes / 4
        jacobian = (
            np.diag(3 * nodes * 2 * y * rate + 2 - 6 * y**2)
            + (3 * nodes * (1 + y**2))[:, None] * derivative
        )
        whole = np.block(
            [[jacobian, (nodes / 4)[:, None]], [np.eye(order + 1)[-1:], np.zeros((1, 1))]]
        )
        step = np.linalg.solve(whole, -np.append(residual, y[-1] + 1))
        y, load = y + step[:-1], load + step[-1]
    assert np.abs(step).max() < 1e-10
    assert load == pytest.approx(lateral_buckling.sadowsky_load(0.0), rel=1e-9)
    assert y[0] == pytest.approx(0, abs=1e-12)


def test_phi_agrees_with_its_published_form():
    table = literature.load("audoly-neukirch-phi")
    assert np.allclose(lateral_buckling.phi(table["v"]), table["phi"], rtol=1e-12)
    assert np.allclose(lateral_buckling.phi(-table["v"]), table["phi"], rtol=1e-12)
    both = lateral_buckling.phi(
        [lateral_buckling._FAR * (1 - 1e-12), lateral_buckling._FAR * (1 + 1e-12)]
    )
    assert both[0] == pytest.approx(both[1], rel=1e-11)
    v, h = np.array([0.0, 0.3, 5.0, 80.0, 900.0]), 1e-30
    value, slope, curve = lateral_buckling._phi_and_slopes(v)
    shifted = lateral_buckling._phi_and_slopes(v + 1j * h)
    assert np.allclose(slope, shifted[0].imag / h, rtol=1e-12, atol=1e-30)
    assert np.allclose(curve, shifted[1].imag / h, rtol=1e-10)
    assert value[0] == pytest.approx(1 / 360)


@pytest.fixture(scope="module")
def curve():
    return lateral_buckling.postbuckling([0.01, 0.1, 1.0, 10.0, 90.0, 810.0], 0.4)


def test_refined_law_buckles_at_the_linear_load(curve):
    """And rises as Koiter's expansion says, with the published coefficient."""
    first = lateral_buckling.linear_load(0.4)
    rise = curve.load / first - 1
    assert rise[0] < 1e-5
    coefficient = lateral_buckling.koiter_width_coefficient(0.4)
    ratio = rise[:2] / (coefficient * curve.deflection[:2] ** 2 / 2)
    assert np.allclose(ratio, 1, atol=1e-3)
    assert np.all(np.diff(curve.load) > 0)
    for nu in (0.0, 0.2, 0.5):
        published = sum(float(literature.value(f"an-alpha-{k}")) * nu**k for k in range(3)) / (
            1 - nu**2
        )
        assert lateral_buckling.koiter_width_coefficient(nu) == pytest.approx(published, rel=5e-4)


def test_refined_law_tends_to_sadowsky(curve):
    """Its gap to Sadowsky's load closes like the root of the amplitude."""
    last = lateral_buckling.sadowsky_load(0.4)
    gap = last - curve.load
    assert np.all(gap > 0)
    assert gap[-2] / gap[-1] == pytest.approx(3, rel=0.1)
    assert gap[-1] < 0.02 * last


def test_postbuckling_by_galerkin(curve):
    """Stationary points of the energy over polynomials of the twist angle, at a given amplitude."""
    order, nu = 16, 0.4
    x, w = legendre.leggauss(60)
    x, w = (x + 1) / 2, w / 2  # distance from the free end
    basis, slope = [], []
    for n in range(order):
        p = legendre.Legendre.basis(n, domain=[0, 1])
        basis.append((1 - x) * p(x))
        slope.append((1 - x) * p.deriv()(x) - p(x))
    basis, slope = np.array(basis), np.array(slope)
    tip = np.array([legendre.Legendre.basis(n, domain=[0, 1])(0.0) for n in range(order)])
    amplitude = 0.7

    def state(coefficients, load):
        """Gradient by the coefficients; the weak curvature balances point by point."""
        angle, twist = coefficients @ basis, coefficients @ slope
        arm = load * x**2 / 2
        v = -arm * angle
        for _ in range(60):
            value, first, second = lateral_buckling._phi_and_slopes(v)
            square = nu * v**2 + twist**2
            f = 1 / (4 * (1 - nu**2))
            m2 = v + f * (4 * nu * v * square * value + square**2 * first)
            w22 = 1 + f * (
                4 * nu * square * value
                + 8 * nu**2 * v**2 * value
                + 8 * nu * v * square * first
                + square**2 * second
            )
            v = v - (m2 + arm * angle) / w22
        m3 = 2 * twist / (1 + nu) + f * 4 * twist * square * value
        return slope @ (w * m3) + basis @ (w * arm * v)

    start = np.linalg.lstsq(basis.T, amplitude * lateral_buckling.mode(1 - x), rcond=None)[0]

    def residual(z):
        return np.append(state(z[:-1], z[-1]), tip @ z[:-1] - amplitude)

    load = fsolve(residual, np.append(start, 16.0), xtol=1e-12)[-1]
    found = lateral_buckling.postbuckling([amplitude], nu).load[0]
    assert load == pytest.approx(found, rel=1e-7)


def test_overhang_of_the_published_ribbons():
    """Between the lengths of the linear and of Sadowsky's law, ordered by width."""
    lengths = [
        lateral_buckling.overhang(0.1, 0.0925, width, 62.3, 0.4) for width in (1.88, 5.10, 20.05)
    ]
    low = 62.3 * lateral_buckling.linear_load(0.4) ** (1 / 3)
    high = 62.3 * lateral_buckling.sadowsky_load(0.4) ** (1 / 3)
    assert low < lengths[0] < lengths[1] < lengths[2] < high
    assert lengths[0] - low < 0.01 * low


def test_bad_input_is_named():
    with pytest.raises(InvalidInput, match="poisson_ratio"):
        lateral_buckling.linear_load(0.6)
    with pytest.raises(InvalidInput, match="amplitude"):
        lateral_buckling.postbuckling([1.0, 0.5], 0.3)
    with pytest.raises(InvalidInput, match="count"):
        lateral_buckling.eigenvalues(0)
    with pytest.raises(InvalidInput, match="width"):
        lateral_buckling.curvature_scale(0.1, -1.0, 0.3)
