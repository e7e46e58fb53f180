"""Laws: closed forms, limits, derivatives, where they cease to be elliptic; laws of the user's own."""

import math
import pickle

import mpmath
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import lissome as ls
from lissome import literature
from lissome.errors import InvalidInput
from lissome.rods import ribbon_laws, shapes
from lissome.rods.law_checks import check_law
from lissome.rods.laws import Kirchhoff, Law
from lissome.rods.ribbon_laws import (
    CROSSOVERS,
    RefinedRibbon,
    SanoWada,
    audoly_neukirch_phi,
    crossover_length,
)
from lissome.rods.sections import Circle, Rectangle
from lissome.rods.user_laws import FunctionLaw, SymbolicLaw

K1, K2, K3 = STRAINS = sp.symbols("k1 k2 k3", real=True)

LAWS = {
    "kirchhoff": Kirchhoff((1.0, 4.0), 0.7),
    "sano-wada": SanoWada((1.0, 50.0), 1.5, 2.0),
    "refined": RefinedRibbon(8.0, 0.2, poisson_ratio=0.3),
}
SIZES = {"kirchhoff": 1.0, "sano-wada": 1.0, "refined": 0.03}


def strains(count, size=1.0, seed=1):
    return np.random.default_rng(seed).normal(size=(count, 3)) * size


# ---------------------------------------------------------------------------------------------
# Kirchhoff


def test_kirchhoff_is_quadratic():
    k = strains(5)
    energy, stress, stiffness = Kirchhoff((1.0, 4.0), 0.7).evaluate(k)
    np.testing.assert_allclose(energy, (k**2 @ [1.0, 4.0, 0.7]) / 2, rtol=1e-14)
    np.testing.assert_allclose(stress, k * [1.0, 4.0, 0.7], rtol=1e-14)
    np.testing.assert_array_equal(stiffness, np.tile(np.diag([1.0, 4.0, 0.7]), (5, 1, 1)))


def test_one_number_is_an_isotropic_rod():
    assert Kirchhoff(2.0, 1.0).bending == (2.0, 2.0)


def test_moduli_of_the_slinky():
    # (4.40), Y = 1
    w, t, nu = 5.0, 2.0, 0.41
    law = Kirchhoff.rectangle(w, t, poisson_ratio=nu, torsion_constant=0.256 * w * t**3)
    assert law.bending == pytest.approx((w * t**3 / 12, w**3 * t / 12))
    assert law.twisting == pytest.approx(0.256 * w * t**3 / (2 * (1 + nu)))
    exact = Kirchhoff.rectangle(w, t, poisson_ratio=nu)
    assert exact.twisting / law.twisting == pytest.approx(0.2494 / 0.256, abs=2e-4)
    scaled = Kirchhoff.rectangle(w, t, 3.0, poisson_ratio=nu)
    assert scaled.twisting == pytest.approx(3 * exact.twisting)


def test_wire_bends_and_twists_in_the_ratio_of_its_material():
    law = Kirchhoff.from_section(Circle(0.3), young_modulus=2.0, poisson_ratio=0.25)
    assert law.twisting / law.bending[0] == pytest.approx(1 / (1 + 0.25))


@given(
    st.lists(st.floats(0.1, 10.0), min_size=2, max_size=6),
    st.floats(0.1, 10.0),
    st.floats(0.1, 10.0),
)
@settings(max_examples=30, deadline=None)
def test_law_that_varies_is_a_law_for_each_node(first, second, twisting):
    law = Kirchhoff((np.array(first), second), twisting)
    assert law.count == len(first)
    k = strains(len(first))
    together = law.evaluate(k)
    for i, value in enumerate(first):
        alone = Kirchhoff((value, second), twisting).evaluate(k[i : i + 1])
        chosen = law.at([i]).evaluate(k[i : i + 1])
        for a, b, c in zip(together, alone, chosen, strict=True):
            np.testing.assert_array_equal(a[i], b[0])
            np.testing.assert_array_equal(b, c)
    rows = np.arange(len(first))[::-1]
    for a, b in zip(law.at(rows).evaluate(k[::-1]), together, strict=True):
        np.testing.assert_array_equal(a, b[::-1])
    np.testing.assert_array_equal(law.at(rows).bending[0], np.array(first)[::-1])


@pytest.mark.parametrize("name", LAWS)
def test_orders_and_copies(name):
    law, k = LAWS[name], strains(4, SIZES[name])
    assert isinstance(law, Law)
    energy, stress, stiffness = law.evaluate(k)
    zeroth, first = law.evaluate(k, 0), law.evaluate(k, 1)
    np.testing.assert_array_equal(energy, zeroth[0])
    assert zeroth[1:] == (None, None)
    np.testing.assert_array_equal(stress, first[1])
    assert first[2] is None
    np.testing.assert_array_equal(law.energy(k), energy)
    again = pickle.loads(pickle.dumps(law))
    np.testing.assert_array_equal(again.evaluate(k)[2], stiffness)
    assert law.at([3, 1]) is law  # uniform


# ---------------------------------------------------------------------------------------------
# Ribbons


def thesis_hinge_energy(kappa, length, a1, a2, a3, xi):
    """(4.41) as printed, width along d2, with integrated strains."""
    k1, k2, k3 = kappa
    return (a1 * k1**2 + a2 * (k2**2 + k3**4 / (length**2 / xi**2 + k2**2)) + a3 * k3**2) / (
        2 * length
    )


def test_sano_wada_is_the_printed_hinge_energy_with_the_section_turned():
    w, h, nu, young, length = 8.0, 0.2, 0.3, 2.0, 0.97
    law = SanoWada.from_geometry(w, h, young, poisson_ratio=nu)
    a1, a2, a3 = young * h * w**3 / 12, young * h**3 * w / 12, young * h**3 * w / (6 * (1 + nu))
    xi = math.sqrt((1 - nu**2) * w**4 / (60 * h**2))
    for kappa in strains(5, 0.02):
        ours = length * law.energy([[kappa[1], kappa[0], kappa[2]]] / np.array(length))[0]
        assert ours == pytest.approx(thesis_hinge_energy(kappa, length, a1, a2, a3, xi), rel=1e-13)


def test_three_published_crossover_lengths():
    w, h, nu = 8.0, 0.2, 0.3
    thesis, audoly, halved = (crossover_length(w, h, nu, form) for form in CROSSOVERS)
    assert audoly**2 == pytest.approx(w**4 / (60 * h**2))
    assert thesis**2 / audoly**2 == pytest.approx(1 - nu**2)
    assert audoly**2 / halved**2 == pytest.approx(2)
    law = SanoWada.from_geometry(w, h, poisson_ratio=nu, form="halved")
    assert law.crossover == pytest.approx(halved)
    given = SanoWada.from_geometry(w, h, poisson_ratio=nu, crossover=17.0)
    assert given.crossover == 17.0


def symbolic_sano_wada(b1, b2, c, xi):
    return (b1 * (K1**2 + K3**4 / (1 / xi**2 + K1**2)) + b2 * K2**2 + c * K3**2) / 2


@pytest.mark.parametrize("backend", ["compiled", "numpy"])
def test_sano_wada_has_the_derivatives_that_sympy_finds(backend):
    law = SanoWada((1.0, 50.0), 1.5, 2.0)
    symbolic = SymbolicLaw(symbolic_sano_wada(1, 50, 1.5, 2), STRAINS, backend=backend)
    assert symbolic.compiled == (backend == "compiled")
    k = np.vstack([strains(50), np.zeros(3), [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    for ours, theirs in zip(law.evaluate(k), symbolic.evaluate(k), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-13)


def precise_phi(v, order=0):
    """phi(v) and its derivatives with respect to z = v^2/4, with 60 digits."""
    with mpmath.workdps(120):

        def phi(z):
            s = z ** mpmath.mpf("0.25")
            ratio = (mpmath.cosh(s) - mpmath.cos(s)) / (mpmath.sinh(s) + mpmath.sin(s))
            return (mpmath.mpf(1) / 2 - ratio / s) / z

        z = mpmath.mpf(v) ** 2 / 4
        return phi(z) if order == 0 else mpmath.diff(phi, z, order, h=z * mpmath.mpf(10) ** -25)


def test_phi_and_its_derivatives_to_round_off():
    edge = 2 * ribbon_laws._SERIES**2  # where the series ends
    for v in (
        1e-6,
        1e-3,
        0.1,
        3.0,
        20.0,
        edge * (1 - 1e-9),
        edge * (1 + 1e-9),
        60.0,
        500.0,
        1e4,
        1e8,
    ):
        found = ribbon_laws.phi_terms(v * v / 4)
        for order in range(3):
            assert found[order] == pytest.approx(float(precise_phi(v, order)), rel=2e-13), (
                v,
                order,
            )
    assert ribbon_laws.phi_terms(0.0)[0] == pytest.approx(1 / 360, rel=1e-15)
    assert audoly_neukirch_phi(1e8) * 1e16 == pytest.approx(2.0, rel=1e-3)
    np.testing.assert_array_equal(audoly_neukirch_phi([-3.0]), audoly_neukirch_phi([3.0]))
    assert np.isfinite(ribbon_laws.phi_terms(1e60)).all()


def test_slope_of_phi_where_there_is_no_curvature():
    # phi = P(z)/D(z): 1/360 + z (4/10! - 1/(360 * 120))
    assert ribbon_laws.phi_terms(0.0)[1] == pytest.approx(4 / math.factorial(10) - 1 / 43200)


def test_phi_in_the_stored_table():
    table = literature.load("audoly-neukirch-phi")
    np.testing.assert_allclose(audoly_neukirch_phi(table["v"]), table["phi"], rtol=1e-12)


def cross_section_energy(k1, k3, w, h, young, nu, terms=24):
    """Least energy per length over the shapes of a cross-section, by Gauss quadrature and polynomials.

    Strip with deflection y(x) across its width: longitudinal strain e with e'' = k3^2 - k1 y''
    (Gauss), no net force or moment; bending energy of a plate.
    """
    x, weight = np.polynomial.legendre.leggauss(80)
    x, weight = x * w / 2, weight * w / 2
    d = young * h**3 / (12 * (1 - nu**2))
    basis = [np.polynomial.Legendre.basis(n, [-w / 2, w / 2]) for n in range(0, terms, 2)]
    # y'' = sum c_n basis_n; e = e0 + e1 . c with the mean taken off
    bend = np.array([b(x) for b in basis])
    stretch = np.array([b.integ(2, lbnd=0)(x) for b in basis])
    stretch = -k1 * (stretch - (stretch @ weight)[:, None] / w)
    fixed = k3**2 * (x**2 / 2 - w**2 / 24)
    # 1/2 int Y h e^2 + D (k1^2 + 2 nu k1 y'' + y''^2 + 2 (1 - nu) k3^2)
    matrix = young * h * (stretch * weight) @ stretch.T + d * (bend * weight) @ bend.T
    vector = young * h * (stretch * weight) @ fixed + d * nu * k1 * bend @ weight
    constant = young * h * fixed**2 @ weight + d * w * (k1**2 + 2 * (1 - nu) * k3**2)
    return (constant - vector @ np.linalg.solve(matrix, vector)) / 2


def test_refined_law_is_the_least_energy_over_cross_sections():
    w, h, young, nu = 8.0, 0.2, 2.0, 0.3
    law = RefinedRibbon(w, h, young, poisson_ratio=nu)
    star = h / (w**2 * math.sqrt(12 * (1 - nu**2)))
    for v in (0.0, 0.5, 5.0, 50.0, 300.0):
        for twist in (0.0, 1.0, 20.0):
            k1, k3 = v * star, twist * star
            exact = cross_section_energy(k1, k3, w, h, young, nu)
            assert law.energy([[k1, 0.0, k3]])[0] == pytest.approx(exact, rel=1e-9, abs=1e-25)


def test_refined_law_tends_to_sadowskys():
    w, h, nu = 8.0, 0.2, 0.4
    law = RefinedRibbon(w, h, poisson_ratio=nu)
    d = h**3 / (12 * (1 - nu**2))
    star = h / (w**2 * math.sqrt(12 * (1 - nu**2)))
    errors = []
    for v in (1e4, 1e6, 1e8):
        k1, k3 = v * star, 0.7 * v * star
        sadowsky = d * w * (k1**2 + k3**2) ** 2 / k1**2 / 2
        errors.append(law.energy([[k1, 0.0, k3]])[0] / sadowsky - 1)
    assert abs(errors[-1]) < 1e-3
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1]), 0.1, rtol=0.02)  # v^(-1/2)


def test_refined_law_and_sano_wada_agree_in_both_limits_without_poisson_effect():
    w, h = 8.0, 0.2
    refined = RefinedRibbon(w, h, poisson_ratio=0.0)
    simple = SanoWada.from_geometry(w, h, poisson_ratio=0.0)
    star = h / (w**2 * math.sqrt(12))
    for k1, tolerance in ((0.0, 1e-13), (1e9 * star, 1e-3)):
        k = [[k1, 0.0, max(3 * star, k1 / 2)]]
        assert simple.energy(k) == pytest.approx(refined.energy(k), rel=tolerance)
    middle = [[20 * star, 0.0, 20 * star]]
    assert abs(simple.energy(middle) / refined.energy(middle) - 1) > 1e-2


def test_thesis_form_of_sano_wada_in_terms_of_the_refined_law():
    # (1 - nu^2) times the quartic term of the refined law with nu k1^2 left out and the simpler phi
    w, h, nu = 8.0, 0.2, 0.35
    law = SanoWada.from_geometry(w, h, poisson_ratio=nu, form="thesis")
    star = h / (w**2 * math.sqrt(12 * (1 - nu**2)))
    for k1, _, k3 in strains(5, 10 * star):
        quartic = w**5 * h / 4 * k3**4 / (360 + (k1 / star) ** 2 / 2)
        plain = Kirchhoff(law.bending, law.twisting).energy([[k1, 0, k3]])
        assert law.energy([[k1, 0, k3]]) - plain == pytest.approx((1 - nu**2) * quartic, rel=1e-10)


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_by_the_public_check(name):
    check_law(LAWS[name], SIZES[name])
    check_law(LAWS[name], 0.01 * SIZES[name])


def test_refined_derivatives_by_the_complex_step():
    """phi by its series in complex arithmetic: an independent path through the whole law."""
    w, h, nu = 8.0, 0.2, 0.3
    law = RefinedRibbon(w, h, poisson_ratio=nu)

    def energy(k1, k2, k3):
        z = 3 * (1 - nu**2) * w**4 / h**2 * k1 * k1
        top = sum((2 * j + 2) * z**j / math.factorial(4 * j + 6) for j in range(16))
        bottom = sum(z**j / math.factorial(4 * j + 1) for j in range(16))
        quartic = w**5 * h / 2 * (nu * k1 * k1 + k3 * k3) ** 2 * top / bottom
        linear = w * h**3 / 12 * k1**2 + w**3 * h / 12 * k2**2 + w * h**3 / (6 * (1 + nu)) * k3**2
        return (linear + quartic) / 2

    for k in strains(10, 0.01):
        exact = [energy(*(k + 1e-30j * e)).imag / 1e-30 for e in np.eye(3)]
        np.testing.assert_allclose(law.evaluate([k])[1][0], exact, rtol=1e-11)


def test_where_sano_wada_ceases_to_be_elliptic():
    law = SanoWada((1.0, 50.0), 1.5, 0.5)
    curvature = np.array([0.0, 0.3, 1.0, 2.0, 3.0, 3.4])  # below sqrt(3)/xi = 3.46
    twist = law.largest_twist(curvature)
    assert twist[0] == pytest.approx(2.0, rel=1e-14)  # 1/xi
    for side, expected in ((1 - 1e-9, True), (1 + 1e-9, False)):
        k = np.stack([curvature, np.zeros(6), side * twist], axis=1)
        np.testing.assert_array_equal(law.is_elliptic(k), expected)
        np.testing.assert_array_equal(law.is_elliptic(-k), expected)
    beyond = np.array([[3.47, 0.0, t] for t in np.geomspace(0.1, 1e4, 50)])
    assert law.is_elliptic(beyond).all()
    np.testing.assert_array_equal(law.largest_twist([3.47, -10.0]), np.inf)
    # an independent look: a grid of eigenvalues of symbolic second derivatives
    hessian = sp.hessian(symbolic_sano_wada(1, 50, sp.Rational(3, 2), sp.Rational(1, 2)), (K1, K3))
    determinant = sp.lambdify((K1, K3), hessian.det())
    x, t = np.meshgrid(np.linspace(0, 5, 41), np.linspace(0.01, 12, 60))
    expected = determinant(x, t) > 0
    found = t < law.largest_twist(x)
    assert (found == expected).mean() > 0.999  # a node of the grid may lie on the curve


def test_straight_ribbon_loses_ellipticity_at_one_over_xi_whatever_its_stiffnesses():
    for b1, c, xi in ((1.0, 0.1, 3.0), (2.0, 50.0, 0.1)):
        law = SanoWada((b1, 10.0), c, xi)
        assert law.largest_twist(0.0) == pytest.approx(1 / xi)


def test_where_the_refined_law_ceases_to_be_elliptic():
    w, h, nu = 8.0, 0.2, 0.3
    law = RefinedRibbon(w, h, poisson_ratio=nu)
    # Straight: b1 + stretch (2 nu g f + rate g^2 f') = 0 with g = k3^2, f' from the series above
    b1, stretch, rate = w * h**3 / 12, w**5 * h / 2, 3 * (1 - nu**2) * w**4 / h**2
    slope = 4 / math.factorial(10) - 1 / 43200
    g = max(np.roots([stretch * rate * slope, 2 * stretch * nu / 360, b1]).real)
    assert law.largest_twist(0.0) == pytest.approx(math.sqrt(g), rel=1e-10)
    curvature = np.linspace(0.0, 0.01, 6)
    twist = law.largest_twist(curvature)
    finite = np.isfinite(twist)
    assert finite[0]
    for side, expected in ((1 - 1e-6, True), (1 + 1e-6, False)):
        k = np.stack([curvature, np.zeros(6), side * twist], axis=1)[finite]
        np.testing.assert_array_equal(law.is_elliptic(k), expected)


def test_tapered_ribbon():
    width = np.linspace(8.0, 4.0, 5)
    law = RefinedRibbon(width, 0.2, poisson_ratio=0.3)
    k = strains(5, 0.02)
    for i, w in enumerate(width):
        alone = RefinedRibbon(w, 0.2, poisson_ratio=0.3).evaluate(k[i : i + 1])
        for a, b in zip(law.evaluate(k), alone, strict=True):
            np.testing.assert_allclose(a[i], b[0], rtol=1e-14)
    with pytest.raises(InvalidInput, match="varies along the rod"):
        law.largest_twist(0.0)


# ---------------------------------------------------------------------------------------------
# Laws of the user's own


def quadratic(k, b=1.0):
    moduli = np.stack(np.broadcast_arrays(b, 2.0, 3.0), axis=-1) * np.ones_like(k)
    stiffness = np.zeros((*k.shape, 3))
    stiffness[:, [0, 1, 2], [0, 1, 2]] = moduli
    return (moduli * k**2).sum(axis=1) / 2, moduli * k, stiffness


def test_function_law_is_the_built_in_one():
    k = strains(6)
    ours, theirs = FunctionLaw(quadratic), Kirchhoff((1.0, 2.0), 3.0)
    assert isinstance(ours, Law)
    for a, b in zip(ours.evaluate(k), theirs.evaluate(k), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)
    varying = FunctionLaw(quadratic, parameters={"b": np.arange(1.0, 7.0)})
    assert varying.count == 6
    expected = Kirchhoff((np.arange(1.0, 7.0), 2.0), 3.0)
    np.testing.assert_allclose(varying.energy(k), expected.energy(k), rtol=1e-14)
    rows = [4, 0]
    np.testing.assert_allclose(
        varying.at(rows).evaluate(k[rows])[1], expected.evaluate(k)[1][rows], rtol=1e-14
    )
    again = pickle.loads(pickle.dumps(varying))
    np.testing.assert_array_equal(again.energy(k), varying.energy(k))


def wrong(what):
    """Return a law function with one mistake."""

    def function(k):
        energy, stress, stiffness = quadratic(k)
        if what == "stress":
            stress[:, 1] *= 1.0001
        elif what == "stiffness":
            stiffness[:, 2, 0] = stiffness[:, 0, 2] = 0.01
        elif what == "symmetry":
            stiffness[:, 2, 0] = 0.01
        elif what == "nan":
            stress[-1, 2] = np.nan
        elif what == "rows":
            energy = energy + 0 * energy.sum()
            stress = stress * (1 + 1e-3 * len(k))
        elif what == "shape":
            return energy[:, None], stress, stiffness
        elif what == "missing":
            return energy, stress
        elif what == "number":
            return 1.0, stress, stiffness
        elif what == "none":
            return energy, stress, None
        elif what == "text":
            return energy, "stress", stiffness
        elif what == "complex":
            return energy, stress + 1j, stiffness
        return energy, stress, stiffness

    return function


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("stress", r"stress component `curvature_2` \(number 1\)"),
        ("stiffness", r"stiffness component \[`twist`, `curvature_1`\]"),
        ("symmetry", r"not symmetric: its components \[`curvature_1`, `twist`\]"),
        ("nan", r"returned nan as its stress, component \[twist\] in row 7"),
        ("rows", "stress .* depends on the strains of other rows"),
        ("shape", r"energy W of shape \(8, 1\); it must be \(8,\)"),
        ("missing", "returned 2 values"),
        ("number", r"energy W of shape \(\)"),
        ("none", "None as its stiffness"),
        ("text", "stress that is not an array of real numbers"),
        ("complex", "stress that is not an array of real numbers"),
    ],
)
def test_mistakes_in_a_law_are_named(what, message):
    with pytest.raises(InvalidInput, match=message):
        FunctionLaw(wrong(what))


def test_small_component_beside_large_ones_is_still_checked():
    def function(k, error):
        moduli = np.array([1.0, 1e6, 1.0])
        stiffness = np.broadcast_to(np.diag(moduli), (len(k), 3, 3)).copy()
        stress = moduli * k
        stress[:, 0] *= 1 + error
        return (moduli * k**2).sum(axis=1) / 2, stress, stiffness

    FunctionLaw(function, parameters={"error": 0.0})
    with pytest.raises(InvalidInput, match=r"stress component `curvature_1`"):
        FunctionLaw(function, parameters={"error": 0.1})


def test_law_that_fails_later_names_row_and_strains():
    def function(k):
        energy, stress, stiffness = quadratic(k)
        return np.where(np.abs(k[:, 0]) > 5, np.nan, energy), stress, stiffness

    law = FunctionLaw(function)
    with pytest.raises(InvalidInput, match="row 2, where curvature_1 = 6"):
        law.evaluate([[0, 0, 0], [1, 0, 0], [6, 0, 0]])


def test_infinite_energy_is_the_border_of_the_domain():
    def function(k):
        energy, stress, stiffness = quadratic(k)
        return np.where(np.abs(k[:, 0]) > 5, np.inf, energy), stress, stiffness

    energy = FunctionLaw(function).energy([[1.0, 0, 0], [6.0, 0, 0]])
    assert energy.tolist() == [0.5, math.inf]


def test_solver_stays_inside_the_domain_of_a_law():
    """A curvature that a law forbids, by an infinite energy: W = k1^2/2 - log(1 - (k1/5)^2) + ..."""

    def locking(k):
        x = k[:, 0] / 5
        u = np.where(np.abs(x) < 1, 1 - x**2, 1.0)
        energy = np.where(np.abs(x) < 1, 12.5 * x**2 - np.log(u), np.inf)
        energy = energy + 0.85 * k[:, 1] ** 2 + 0.6 * k[:, 2] ** 2
        stress = np.stack([k[:, 0] + 0.4 * x / u, 1.7 * k[:, 1], 1.2 * k[:, 2]], axis=1)
        stiffness = np.zeros((len(k), 3, 3))
        stiffness[:, 0, 0] = 1 + 0.08 * (1 + x**2) / u**2
        stiffness[:, 1, 1], stiffness[:, 2, 2] = 1.7, 1.2
        return energy, stress, stiffness

    given = FunctionLaw(locking)
    symbolic = SymbolicLaw(
        K1**2 / 2 - sp.log(1 - (K1 / 5) ** 2) + 0.85 * K2**2 + 0.6 * K3**2, STRAINS
    )
    found = []
    for law in (given, symbolic):
        rod = shapes.straight(1.0, 40, law).clamped("start").loaded(end=(0.0, 0.1, -50.0))
        found.append(ls.equilibrate(rod))
        assert 4.0 < np.abs(found[-1].strains[:, 0]).max() < 5.0
        assert found[-1].stable
    assert found[0].energy == pytest.approx(found[1].energy, rel=1e-9)

    def forgetful(k):
        energy, stress, stiffness = locking(k)
        return np.where(np.isinf(energy), np.nan, energy), stress, stiffness

    rod = shapes.straight(1.0, 40, FunctionLaw(forgetful)).clamped("start")
    with pytest.raises(InvalidInput, match=r"nan as its energy W in row .* where curvature_1 ="):
        ls.equilibrate(rod.loaded(end=(0.0, 0.1, -200.0)))


def test_law_with_other_strains():
    def function(k):
        stiffness = np.broadcast_to(np.eye(2), (len(k), 2, 2))
        return (k**2).sum(axis=1) / 2, k, stiffness

    law = FunctionLaw(function, strains=("curvature", "stretch"))
    assert law.strains == ("curvature", "stretch")
    with pytest.raises(InvalidInput, match=r"must be \(n, 2\).*curvature, stretch"):
        law.evaluate(np.zeros((4, 3)))


def test_symbolic_law_with_parameters_along_the_rod():
    b, c = sp.symbols("b c")
    values = {b: np.array([1.0, 2.0, 3.0]), "c": 2.0}
    for backend in ("compiled", "numpy"):
        law = SymbolicLaw((b * K1**2 + K2**2 + c * K3**2) / 2, STRAINS, values, backend=backend)
        assert law.count == 3
        expected = Kirchhoff(([1.0, 2.0, 3.0], 1.0), 2.0)
        k = strains(3)
        for x, y in zip(law.evaluate(k), expected.evaluate(k), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-14, atol=1e-15)
        some = law.at([2, 0])
        np.testing.assert_allclose(some.energy(k[[2, 0]]), expected.energy(k)[[2, 0]])
        again = pickle.loads(pickle.dumps(law))
        np.testing.assert_array_equal(again.energy(k), law.energy(k))


def test_symbolic_law_in_pieces_and_with_special_functions():
    stiffening = sp.Piecewise((K1**2, K1 < 1), (K1**2 + (K1 - 1) ** 3, True))
    law = SymbolicLaw(stiffening + K2**2 + K3**2, STRAINS)
    assert law.compiled
    np.testing.assert_allclose(law.evaluate([[2.0, 0, 0]])[1], [[7.0, 0, 0]])
    bessel = SymbolicLaw(sp.besseli(0, K1) + sp.cosh(K2) + K3**2, STRAINS)
    assert not bessel.compiled
    stiffness = bessel.evaluate([[0.0, 0.0, 0.0]])[2]
    np.testing.assert_allclose(stiffness[0], np.diag([0.5, 1.0, 2.0]), atol=1e-15)


f = sp.Function("f")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Kirchhoff((1.0, -2.0), 1.0), r"`bending\[1\]` is -2"),
        (lambda: Kirchhoff((1.0, [1.0, 0.0]), 1.0), r"`bending\[1\]\[1\]` is 0"),
        (lambda: Kirchhoff((1.0, 1.0, 1.0), 1.0), r"pass \(B1, B2\)"),
        (lambda: Kirchhoff(1.0, [1.0, math.nan]), r"`twisting`\[1\] is nan"),
        (lambda: Kirchhoff(([1.0, 1.0], [1.0, 1.0, 1.0]), 1.0), "different numbers of values"),
        (lambda: Kirchhoff(1.0, 1.0).evaluate(np.zeros(3)), r"`k` has shape \(3,\)"),
        (lambda: Kirchhoff([1.0, 1.0], [1.0, 2.0]).evaluate(np.zeros((3, 3))), "has 3 rows"),
        (lambda: Kirchhoff([1.0, 1.0], [1.0, 2.0]).at([2]), "holds 2; the law has 2 rows"),
        (lambda: Kirchhoff.rectangle(1, 1, -1.0, poisson_ratio=0.3), "`young_modulus` is -1"),
        (lambda: Kirchhoff.rectangle(1, 1, poisson_ratio=0.6), "`poisson_ratio` is 0.6"),
        (lambda: Kirchhoff.from_section("disk", 1, 0.3), "`section` is of type str"),
        (
            lambda: Kirchhoff.from_section(Rectangle(1, 1), 1, 0.3, torsion_constant=0),
            "`torsion_constant` is 0",
        ),
        (lambda: SanoWada((1.0, 1.0), 1.0, -1.0), "`crossover` is -1"),
        (lambda: crossover_length(1.0, 1.0, 0.3, "thesys"), "did you mean 'thesis'"),
        (lambda: RefinedRibbon(-1.0, 1.0, poisson_ratio=0.3), "`width` is -1"),
        (lambda: RefinedRibbon(1.0, 1.0, poisson_ratio=-1.0), "`poisson_ratio` is -1"),
        (lambda: FunctionLaw(3), "`function` is 3"),
        (lambda: FunctionLaw(quadratic, strains="abc"), "pass a sequence of names"),
        (lambda: FunctionLaw(quadratic, parameters={"b": math.inf}), r"`parameters\[b\]` is inf"),
        (lambda: FunctionLaw(quadratic, parameters={"a b": 1.0}), "pass the names of arguments"),
        (lambda: FunctionLaw(quadratic, check_at=np.zeros((0, 3))), "`points` is empty"),
        (lambda: SymbolicLaw(K1**2, (K1, K2)), "pass 3 different symbols"),
        (lambda: SymbolicLaw(K1**2 * sp.Symbol("a"), STRAINS), r"no value for \[a\]"),
        (lambda: SymbolicLaw(K1**2, STRAINS, {"a": 1.0}), r"names \['a'\]"),
        (lambda: SymbolicLaw(sp.Abs(K1), STRAINS), "second derivatives must be ordinary"),
        (lambda: SymbolicLaw(f(K1), STRAINS), "second derivatives must be ordinary"),
        (lambda: SymbolicLaw(sp.zeta(K1**2 + 3), STRAINS), "second derivatives|neither numpy nor"),
        (
            lambda: SymbolicLaw(sp.besseli(0, K1), STRAINS, backend="compiled"),
            "cannot be compiled",
        ),
        (lambda: SymbolicLaw(sp.log(K1), STRAINS), "returned nan as its energy"),
        (lambda: SymbolicLaw("k1 +", STRAINS), "must be a SymPy expression"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()
