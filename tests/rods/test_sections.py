"""Cross-sections: closed forms, limits, and an independent solution of Saint-Venant's problem."""

import math

import numpy as np
import pytest
from scipy.sparse import diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve
from scipy.special import zeta

from lissome.errors import InvalidInput
from lissome.rods import sections
from lissome.rods.sections import Circle, Ellipse, Rectangle


def prandtl(width, thickness, cells):
    """Torsion constant by finite differences of Prandtl's problem: -lap f = 2, J = 2 int f."""

    def second(length, n):
        main = diags_array([-2.0, 1.0, 1.0], offsets=[0, 1, -1], shape=(n - 1, n - 1))
        return main / (length / n) ** 2

    a, b = second(width, cells[0]), second(thickness, cells[1])
    laplacian = kron(a, eye_array(cells[1] - 1)) + kron(eye_array(cells[0] - 1), b)
    f = spsolve(laplacian.tocsc(), np.full(laplacian.shape[0], -2.0))
    return 2.0 * f.sum() * width * thickness / math.prod(cells)


@pytest.mark.parametrize(("width", "thickness"), [(1.0, 1.0), (5.0, 2.0), (1.0, 3.0)])
def test_torsion_constant_of_a_rectangle_solves_saint_venants_problem(width, thickness):
    cells = [20, 40, 80]
    values = [prandtl(width, thickness, (n, n)) for n in cells]
    first = [
        (4 * b - a) / 3 for a, b in zip(values[:-1], values[1:], strict=True)
    ]  # errors of order h^2
    section = Rectangle(width, thickness)
    estimate = abs(first[1] - first[0])
    assert estimate < 1e-4 * section.torsion_constant
    assert section.torsion_constant == pytest.approx(first[1], abs=estimate)


@pytest.mark.parametrize(("width", "thickness"), [(1.0, 1.0), (5.0, 2.0), (2.0, 5.0), (40.0, 1.0)])
def test_fast_series_is_the_series(width, thickness):
    a, b = max(width, thickness), min(width, thickness)
    n = np.arange(1, 4001, 2)[::-1]
    total = np.sum(np.tanh(n * np.pi * a / (2 * b)) / n**5.0)
    exact = a * b**3 * (1 / 3 - 64 / np.pi**5 * b / a * total)
    assert Rectangle(width, thickness).torsion_constant == pytest.approx(exact, rel=1e-12)


def test_constant_of_the_series():
    assert pytest.approx(31 / 32 * zeta(5), rel=2e-16) == sections._ODD_ZETA_5


def test_torsion_constants_in_the_tables():
    assert Rectangle(1.0, 1.0).torsion_constant == pytest.approx(0.1406, abs=5e-5)
    assert Rectangle(5e-3, 2e-3).torsion_constant / (5e-3 * 2e-3**3) == pytest.approx(
        0.2494, abs=5e-5
    )


def test_thin_rectangle_tends_to_a_third():
    # J = w t^3 (1/3 - 0.21 t / w + exponentially small)
    slope = 64 / np.pi**5 * 31 / 32 * zeta(5)
    for ratio in (10.0, 1e3, 1e6):
        j = Rectangle(ratio, 1.0).torsion_constant / ratio
        assert j == pytest.approx(1 / 3 - slope / ratio, rel=1e-12)


def test_turning_a_section_swaps_its_moments():
    for kind in (Rectangle, Ellipse):
        a, b = kind(3.0, 0.5), kind(0.5, 3.0)
        assert a.second_moments == pytest.approx(b.second_moments[::-1])
        assert a.torsion_constant == pytest.approx(b.torsion_constant)
        assert a.area == pytest.approx(b.area)


def test_bending_about_the_width_is_easy():
    for kind in (Rectangle, Ellipse):
        easy, stiff = kind(5.0, 2.0).second_moments
        assert stiff / easy == pytest.approx((5 / 2) ** 2)


def test_second_moments_by_quadrature():
    x = (np.arange(2000) + 0.5) / 2000 * 2 - 1
    chord = 2 * np.sqrt(1 - x**2)  # of the unit disk
    w, t = 3.0, 0.5
    # the section's points are (w x / 2, t y / 2): about d1 goes y^2, about d2 x^2
    about_2 = np.sum(x**2 * chord) * 1e-3 * (w / 2) ** 3 * (t / 2)
    about_1 = np.sum(x**2 * chord) * 1e-3 * (t / 2) ** 3 * (w / 2)
    assert Ellipse(w, t).second_moments == pytest.approx((about_1, about_2), rel=1e-4)


def test_circle_is_an_ellipse():
    circle, ellipse = Circle(1.7), Ellipse(1.7, 1.7)
    assert circle.second_moments == pytest.approx(ellipse.second_moments)
    assert circle.torsion_constant == pytest.approx(ellipse.torsion_constant)
    assert circle.area == pytest.approx(ellipse.area)
    # a solid disk has the polar moment as its torsion constant; no other section reaches it
    assert circle.torsion_constant == pytest.approx(sum(circle.second_moments))
    for section in (Ellipse(2.0, 1.0), Rectangle(2.0, 1.0), Rectangle(1.0, 1.0)):
        assert section.torsion_constant < sum(section.second_moments)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Rectangle(-1.0, 1.0), "width"),
        (lambda: Rectangle(1.0, 0.0), "thickness"),
        (lambda: Ellipse(1.0, float("nan")), "thickness"),
        (lambda: Ellipse("1", 1.0), "width"),
        (lambda: Circle(-2.0), "diameter"),
    ],
)
def test_bad_sizes_are_named(make, name):
    with pytest.raises(InvalidInput, match=f"argument `{name}`"):
        make()
