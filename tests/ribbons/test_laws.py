"""Energies of ribbons against integrals over the width, series and limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lissome import ribbons
from lissome.errors import InvalidInput
from lissome.ribbons.laws import cotangent_factor, density, fold_of


@pytest.mark.parametrize("v", [1e-12, 1e-3, 0.5, -1.2, 1.999, -1.999999])
def test_the_width_factor_is_the_logarithm(v):
    exact = np.log1p(2 * v / (2 - v)) / v
    # artanh loses digits to the rounding of 1 - v/2
    assert ribbons.width_factor(v) == pytest.approx(exact, rel=1e-14 + 4e-16 / (2 - abs(v)))


def test_the_width_factor_of_a_cylinder_is_one():
    assert ribbons.width_factor(0.0) == 1.0


def test_the_series_meets_the_closed_form():
    for a in (0.399999, 0.2):
        g, dg, ddg = cotangent_factor(a)
        sinh, cosh = math.sinh(a), math.cosh(a)
        assert g == pytest.approx(a * cosh / sinh, rel=1e-14)
        assert dg == pytest.approx(cosh / sinh - a / sinh**2, rel=1e-13)
        assert ddg == pytest.approx(2 * (a * cosh / sinh - 1) / sinh**2, rel=1e-12)


@pytest.mark.parametrize("a", [1e-9, 0.05, 0.39, 0.41, 1.0, 5.0, 40.0, 800.0])
def test_derivatives_of_the_factor(a):
    h = 1e-5 * max(a, 1e-2)
    g = [cotangent_factor(a + k * h) for k in (-2, -1, 0, 1, 2)]
    for k in (0, 1):
        slope = (g[0][k] - 8 * g[1][k] + 8 * g[3][k] - g[4][k]) / (12 * h)
        assert g[2][k + 1] == pytest.approx(slope, rel=1e-6, abs=1e-8)
        assert cotangent_factor(-a)[k] == (g[2][k] if k == 0 else -g[2][k])


@pytest.mark.parametrize("slope", [0.0, 3.0, -9.0])
@pytest.mark.parametrize("natural", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.5, -1.0, 0.7)])
def test_the_energy_is_the_integral_of_the_plate_energy_over_the_width(slope, natural):
    nu, width, rigidity, bend, eta = 0.3, 0.2, 1.7, 1.3, 0.6
    k0, t0, c0 = natural
    law = ribbons.Wunderlich(
        width=width, rigidity=rigidity, poisson_ratio=nu, natural_curvature=k0, natural_twist=t0,
        natural_cross_curvature=c0,
    )  # fmt: skip

    # Components along (d1, d3) of the curvature tensor, bent across the ruling.
    normal = np.array([-eta, 1.0]) / math.hypot(1.0, eta)
    rest = np.array([[c0, -t0], [-t0, k0]])

    def plate(t):
        stretch = 1.0 + t * slope
        tensor = bend * (1 + eta**2) / stretch * np.outer(normal, normal) - rest
        return (
            0.5 * rigidity * ((1 - nu) * np.sum(tensor**2) + nu * np.trace(tensor) ** 2) * stretch
        )

    exact = quad(plate, -width / 2, width / 2, epsabs=1e-13, epsrel=1e-12)[0]
    assert law.energy(bend, eta, slope) == pytest.approx(exact, rel=1e-10)


def test_bend_and_twist_on_the_center_line_are_those_of_the_tensor():
    """The tensor of the test above has the normal curvature kappa_1 and the twist eta kappa_1."""
    bend, eta = 1.3, 0.6
    normal = np.array([-eta, 1.0]) / math.hypot(1.0, eta)
    tensor = bend * (1 + eta**2) * np.outer(normal, normal)
    assert tensor[1, 1] == pytest.approx(bend)
    assert tensor[0, 1] == pytest.approx(-eta * bend)


def test_sadowsky_is_the_limit_of_vanishing_width():
    wide = ribbons.Wunderlich(width=1e-5, rigidity=1e5)
    narrow = ribbons.Sadowsky(width=1e-5, rigidity=1e5)
    assert wide.energy(1.2, 0.7, 3.0) == pytest.approx(float(narrow.energy(1.2, 0.7)), rel=1e-9)
    kappa = np.array([1.2, 0.84])
    assert narrow.energy(1.2, 0.7) == pytest.approx(0.5 * (kappa @ kappa) ** 2 / kappa[0] ** 2)


@pytest.mark.parametrize("law", [ribbons.Wunderlich, ribbons.Sadowsky])
def test_derivatives_of_the_density(law):
    parameters = law(
        width=0.3, rigidity=1.1, poisson_ratio=0.2, natural_curvature=0.4, natural_twist=0.3,
        natural_cross_curvature=-0.2,
    ).parameters  # fmt: skip
    x = np.array([1.1, -0.4, 1.3])

    def row(y):
        out = np.empty(9)
        density(parameters, *y, out)
        return out

    here, h = row(x), 1e-4
    second = {(0, 0): 4, (0, 1): 5, (0, 2): 6, (1, 1): 7, (1, 2): 8}
    for i in range(3):
        e = np.eye(3)[i] * h
        d = (row(x - 2 * e) - 8 * row(x - e) + 8 * row(x + e) - row(x + 2 * e)) / (12 * h)
        assert here[1 + i] == pytest.approx(d[0], abs=1e-10)
        for j in range(3):
            value = here[second[min(i, j), max(i, j)]] if i + j < 4 else 0.0
            assert value == pytest.approx(d[1 + j], abs=1e-10)


def test_the_rigidity_is_that_of_a_plate():
    law = ribbons.Wunderlich(width=0.1, thickness=0.002, young_modulus=3.0, poisson_ratio=0.25)
    assert law.rigidity == pytest.approx(3.0 * 0.002**3 / 12 / (1 - 0.0625))
    wider = law.with_width(0.2)
    assert (wider.width, wider.rigidity) == (0.2, law.rigidity)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"width": 0.0, "rigidity": 1.0}, "width"),
        ({"width": -1.0, "rigidity": 1.0}, "width"),
        ({"width": 0.1, "rigidity": 0.0}, "rigidity"),
        ({"width": 0.1}, "rigidity"),
        ({"width": 0.1, "thickness": -1, "young_modulus": 1, "poisson_ratio": 0.3}, "thickness"),
        ({"width": 0.1, "thickness": 0.2, "young_modulus": 1, "poisson_ratio": 0.3}, "thickness"),
        ({"width": 0.1, "thickness": 0.01, "young_modulus": 0, "poisson_ratio": 0.3}, "young_modulus"),
        ({"width": 0.1, "thickness": 0.01, "young_modulus": 1, "poisson_ratio": 0.6}, "poisson_ratio"),
        ({"width": 0.1, "thickness": 0.01, "young_modulus": 1, "poisson_ratio": -0.1}, "poisson_ratio"),
        ({"width": 0.1, "rigidity": 1.0, "thickness": 0.01}, "rigidity"),
        ({"width": 0.1, "rigidity": 1.0, "natural_twist": 1.0}, "poisson_ratio"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named(arguments, name):
    with pytest.raises(InvalidInput, match=name):
        ribbons.Wunderlich(**arguments)


@pytest.mark.parametrize("v", [2.0, -2.0, 5.0])
def test_rulings_that_cross_are_refused(v):
    with pytest.raises(InvalidInput, match="cross"):
        ribbons.width_factor([0.0, v])
    with pytest.raises(InvalidInput, match="cross"):
        ribbons.Wunderlich(width=0.5, rigidity=1.0).energy(1.0, 0.0, 2 * v)


def test_the_fold_variable_of_a_flux():
    """Inside the table, at its ends and beyond; sinh in terms that neither cancel nor overflow."""
    for a in np.geomspace(1e-5, 300.0, 500):
        if a < 1.0:
            terms = [
                2.0 ** (2 * k + 1) * a ** (2 * k - 1) / math.factorial(2 * k + 1)
                for k in range(1, 14)
            ]
            y = math.fsum(terms) / 4
        else:
            y = (0.5 * (math.exp(2 * a) - math.exp(-2 * a)) - 2 * a) / (4 * a * a)
        found, decay = fold_of(y)
        assert found == pytest.approx(a, rel=3e-13)
        assert decay == pytest.approx(math.exp(-2 * a), rel=6e-13 * max(a, 0.1))
    assert fold_of(0.0) == (0.0, 1.0)
