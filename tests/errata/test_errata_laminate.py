"""Errors of chapter 5 on laminates and scales, by computer algebra and by the printed numbers."""

import math

import numpy as np
import pint
import pytest
import sympy as sp

from lissome import literature
from lissome.errors import InvalidInput
from lissome.plates import Laminate, Layer, fit_sigmoid

z, z0, h = sp.symbols("z z_0 h", positive=True)
E1, E2, e1, e2 = sp.symbols("E_1 E_2 e_1 e_2", positive=True)  # of the lower and the upper half
strain, curvature = sp.symbols("epsilon kappa")


def moment(power, lower, upper):
    """Return M^p of a function that is constant in either half of the thickness."""
    below, above = (
        sp.integrate(z**power * f, limits)
        for f, limits in ((lower, (z, -h / 2, 0)), (upper, (z, 0, h / 2)))
    )
    return sp.expand(below + above)


M = [moment(p, E1, E2) for p in range(3)]  # of E
Me = [moment(p, E1 * e1, E2 * e2) for p in range(2)]  # of E times the spontaneous strain
NEUTRAL = M[1] / M[0]
B = M[2] - M[1] ** 2 / M[0]
CORRECT = (Me[1] - NEUTRAL * Me[0]) / B  # kappa_m with the sign of (5.4)


def resultant(weight, in_plane):
    """Return the integral of weight E (in_plane - spontaneous strain) through the thickness."""
    total = 0
    for modulus, own, limits in ((E1, e1, (z, -h / 2, 0)), (E2, e2, (z, 0, h / 2))):
        total += sp.integrate(sp.expand(weight * modulus * (in_plane - own)), limits)
    return sp.simplify(total)


def test_traction_needs_the_height_in_its_integrand():
    second_line = curvature * (M[1] - z0 * M[0]) + strain * M[0] - Me[0]
    corrected = resultant(1, curvature * (z - z0) + strain)
    assert sp.simplify(corrected - second_line) == 0
    assert sp.simplify(resultant(1, curvature + strain) - second_line) != 0  # as printed


def test_spontaneous_strain_is_a_mean():
    force = resultant(1, curvature * (z - NEUTRAL) + strain)
    assert sp.simplify(force - M[0] * (strain - Me[0] / M[0])) == 0
    assert sp.simplify(force - M[0] * (strain - Me[0])) != 0  # as printed below (5.5)
    # both films at one spontaneous strain have that strain, whatever their moduli
    assert sp.simplify((Me[0] / M[0]).subs(e2, e1) - e1) == 0


def test_spontaneous_curvature_is_divided_by_the_zeroth_moment():
    printed = (Me[1] - Me[0] * M[1] / M[1]) / B
    even = {e1: e2}
    assert sp.simplify(CORRECT.subs(even)) == 0  # one strain everywhere does not bend a sheet
    assert sp.simplify(printed.subs(even)) != 0
    # and as a number: Timoshenko's strip, through the library (curvature with the sign of w'')
    values = {E1: 17.0, E2: 3.2, e1: -0.01, e2: -0.09, h: 2.0}

    def film(e):
        return lambda t: np.full(np.shape(t), e)

    sheet = Laminate(
        [Layer(1.0, 17.0, 0.5, strain=film(-0.01)), Layer(1.0, 3.2, 0.5, strain=film(-0.09))]
    )
    found = float(sheet.spontaneous(0.0).curvature_along)
    assert float(CORRECT.subs(values)) == pytest.approx(-found, rel=1e-12)
    assert abs(float(printed.subs(values)) + found) > 0.1 * abs(found)


def test_moment_about_the_neutral_plane_decouples_without_an_assumption():
    inside = curvature * (z - NEUTRAL) + strain
    about_neutral = resultant(z - NEUTRAL, inside)
    assert sp.simplify(about_neutral - B * (curvature - CORRECT)) == 0
    # about z = 0, as printed, the traction enters
    force = resultant(1, inside)
    assert sp.simplify(resultant(z, inside) - about_neutral - NEUTRAL * force) == 0


def test_curvature_of_the_strain_is_minus_the_hessian():
    x = sp.Symbol("x")
    u, w = sp.Function("u")(x), sp.Function("w")(x)
    through = (u - z * w.diff(x)).diff(x)  # normals stay normal
    assert sp.simplify(through - (u.diff(x) - z * w.diff(x, 2))) == 0


def test_scaled_curvature_and_gradients():
    X, Y, size = sp.symbols("X Y L", positive=True)
    x, y = sp.symbols("x y")
    w = size * sp.Function("w")(x / size, y / size)
    bar = sp.Function("w")(X, Y)
    here = {X: x / size, Y: y / size}

    def at(expression):
        return expression.subs(here).doit()

    assert sp.simplify(w.diff(x) - at(bar.diff(X))) == 0  # grad w = bar grad bar w, not of bar u
    assert sp.simplify(w.diff(x, 2) - at(bar.diff(X, 2)) / size) == 0
    # L^2 B (kappa/L - kappa_m)^2 = B (kappa - L kappa_m)^2: the scaled spontaneous curvature
    k, km = sp.symbols("k k_m")
    assert sp.simplify(size**2 * (k / size - km) ** 2 - (k - size * km) ** 2) == 0


def test_uniform_plate_is_the_standard_one():
    one = {E2: E1, e1: 0, e2: 0}
    assert sp.simplify(M[0].subs(one) - h * E1) == 0
    assert sp.simplify(B.subs(one) - h**3 / 12 * E1) == 0
    assert CORRECT.subs({e1: 0, e2: 0}) == 0 and Me[0].subs({e1: 0, e2: 0}) == 0


def test_stretching_modulus_of_the_laminate():
    film = literature.value("c5-film-thickness").to("m")

    def stretching(direction):
        stiff, soft = (
            literature.value(f"ta1-{name}-modulus-{direction}").to("Pa")
            for name in ("stiff", "soft")
        )
        return film * (stiff + 2 * soft)

    printed = float(literature.value("t52-stretching-modulus"))
    assert stretching("perpendicular") == pytest.approx(702.0, rel=1e-9)
    assert stretching("parallel") == pytest.approx(1710.0, rel=1e-9)
    # the printed value is three halves of the former, to all its digits
    assert printed / stretching("perpendicular") == pytest.approx(1.5, rel=1e-9)


def test_crosslink_mass_needs_the_density():
    unit = pint.UnitRegistry()
    gas = unit.Quantity(8.314, "J/(mol K)")
    without = gas * unit.Quantity(373, "K") / unit.Quantity(11, "MPa")
    mass = unit.Quantity(1, "g/mol")
    assert not without.is_compatible_with(mass)
    density = literature.value("c5-density")
    assert (without * unit.Quantity(density.value, density.unit)).is_compatible_with(mass)


def test_slopes_are_per_cent_per_degree():
    slope = float(literature.value("ta1-soft-strain-rate"))
    ends = [float(literature.value(f"ta1-slope-temperature-{end}")) for end in ("min", "max")]
    assert slope * (ends[1] - ends[0]) > 1  # as a pure number per degree the film would vanish
    for width in (1.0, 10.0, 100.0, 1e4):
        with pytest.raises(InvalidInput, match="must be below 1"):
            fit_sigmoid(transition=170.0, rate=slope, between=tuple(ends), width=width)
    curve = fit_sigmoid(transition=170.0, rate=slope / 100, between=tuple(ends), width=12.0)
    assert 0 < curve.saturation < 0.5 and math.isfinite(curve(160.0))
