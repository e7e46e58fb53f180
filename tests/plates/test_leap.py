"""Scales of the plate, energy bound, ballistics."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lissome import literature
from lissome.errors import InvalidInput
from lissome.plates import (
    Flight,
    PlateScales,
    energy_height,
    flight_from_heights,
    launch_speed_with_drag,
    terminal_speed,
)


def density(u, v, w, strain, curvature, c, b, nu, x, y):
    """Foeppl-von Karman energy per area of displacement fields."""
    p = sp.Matrix([[w.diff(x)], [w.diff(y)]])
    e = sp.Matrix([[u.diff(x), (u.diff(y) + v.diff(x)) / 2], [0, v.diff(y)]])
    e[1, 0] = e[0, 1]
    e = e + p * p.T / 2 - strain
    k = sp.hessian(w, (x, y)) - curvature

    def form(m):
        return (nu * m.trace() ** 2 + (1 - nu) * (m.T * m).trace()) / (2 * (1 - nu**2))

    return c * form(e) + b * form(k)


def test_the_scaling_law_by_computer_algebra():
    x, y, nu = sp.symbols("x y nu")
    c, t, size = sp.symbols("C t L", positive=True)
    X, Y = x / size, y / size
    # polynomials with free coefficients stand for arbitrary fields: their derivatives at a point
    # up to the second order, which is all that the energy holds, are free
    at = sp.symbols("X Y")

    def jet(name):
        return sum(
            sp.Symbol(f"{name}{i}{j}") * at[0] ** i * at[1] ** j
            for i in range(3)
            for j in range(3 - i)
        )

    u, v, w = (jet(name) for name in "uvw")
    strain = sp.Matrix(2, 2, sp.symbols("e11 e12 e12 e22"))
    bent = sp.Matrix(2, 2, sp.symbols("k11 k12 k12 k22"))
    scaled = density(u, v, w, strain, bent, 1, 1, nu, *at)
    place = {at[0]: X, at[1]: Y}
    physical = density(
        t**2 / size * u.subs(place),
        t**2 / size * v.subs(place),
        t * w.subs(place),
        (t / size) ** 2 * strain,
        t / size**2 * bent,
        c,
        c * t**2,
        nu,
        x,
        y,
    )
    difference = physical * size**2 - c * t**4 / size**2 * scaled.subs(place)  # area is L^2
    assert sp.simplify(sp.expand(difference)) == 0


@given(st.floats(1e-3, 1e3), st.floats(1e-6, 1e2), st.floats(1e-3, 1e2))
def test_units_fit_together(c, b, length):
    s = PlateScales(c, b, length)
    assert s.strain == pytest.approx(s.displacement / s.length, rel=1e-12)
    assert s.strain == pytest.approx((s.deflection / s.length) ** 2, rel=1e-12)
    assert s.curvature == pytest.approx(s.deflection / s.length**2, rel=1e-12)
    assert s.energy == pytest.approx(c * s.strain**2 * length**2, rel=1e-11)
    assert s.energy == pytest.approx(b * s.curvature**2 * length**2, rel=1e-11)
    assert s.energy == pytest.approx(s.pressure * s.deflection * length**2, rel=1e-11)


def test_uniform_plate_has_the_bending_length_of_its_thickness():
    s = PlateScales.uniform(0.3, 2.0, young_modulus=7.0)
    assert s.bending_length == pytest.approx(0.3 / math.sqrt(12), rel=1e-14)
    assert s.stretching_modulus == pytest.approx(2.1, rel=1e-14)


def test_the_energy_bound_and_the_size_of_the_sheet():
    # energy by the scaling law with any G; here G(x) = x^1.7
    def bound(thickness, length, strain):
        s = PlateScales.uniform(thickness, length, young_modulus=1e7)
        released = (s.bending_length / length) ** 4 * (strain / s.strain) ** 1.7
        return float(
            energy_height(
                released,
                stretching_modulus=s.stretching_modulus,
                thickness=thickness,
                density=1.2e3,
            )
        )

    same_shape = [bound(0.01 * l, l, 0.1) for l in (1e-3, 7e-3, 0.1)]
    assert same_shape == pytest.approx([same_shape[0]] * 3, rel=1e-12)
    same_thickness = [bound(90e-6, l, 0.1) for l in (1e-3, 1e-2)]
    assert same_thickness[1] / same_thickness[0] == pytest.approx(10 ** (-4 + 2 * 1.7), rel=1e-9)


def test_table_5_2_gives_its_height():
    height = energy_height(
        literature.value("t52-released-energy"),
        stretching_modulus=float(literature.value("t52-stretching-modulus")),
        thickness=literature.value("t52-thickness").to("m"),
        density=literature.value("t52-density").to("kg/m^3"),
        gravity=float(literature.value("t52-gravity")),
    )
    assert height == pytest.approx(literature.value("t52-height").to("m"), rel=0.02)


@given(st.floats(1e-3, 10), st.floats(-5, 5))
def test_flight_meets_what_was_measured(height, distance):
    leap = flight_from_heights(height, distance)
    assert leap.height == pytest.approx(height, rel=1e-9)
    assert leap.range == pytest.approx(distance, rel=1e-9, abs=1e-12)
    x, z = leap.position([0.0, leap.duration / 2, leap.duration])
    assert z == pytest.approx([0, height, 0], abs=1e-9 * height)
    assert x == pytest.approx([0, distance / 2, distance], rel=1e-9, abs=1e-12)
    assert math.tan(leap.tilt) == pytest.approx(distance / (4 * height), rel=1e-9, abs=1e-12)
    assert leap.leg_difference(1.0) == pytest.approx(math.sin(leap.tilt), rel=1e-12)


@pytest.mark.parametrize("height", [1e-3, 0.02, 0.2])
def test_drag_against_an_integration_of_motion(height):
    terminal = terminal_speed(thickness=90e-6, density=1200.0)
    speed = launch_speed_with_drag(height, terminal=terminal)
    g = 9.8

    def motion(t, y):
        return [y[1], -g - g * (y[1] / terminal) ** 2]

    def top(t, y):
        return y[1]

    top.terminal = True
    path = solve_ivp(motion, (0, 10), [0.0, speed], events=top, rtol=1e-10, atol=1e-12)
    assert path.y[0, -1] == pytest.approx(height, rel=1e-7)
    thin_air = launch_speed_with_drag(height, terminal=1e6)
    assert thin_air == pytest.approx(math.sqrt(2 * g * height), rel=1e-9)
    assert speed > thin_air


def test_bad_input():
    for name in ("stretching_modulus", "bending_modulus", "length"):
        given_ = {"stretching_modulus": 1.0, "bending_modulus": 1.0, "length": 1.0} | {name: 0.0}
        with pytest.raises(InvalidInput, match=name):
            PlateScales(**given_)
    given_ = {"stretching_modulus": 1.0, "thickness": 1.0, "density": 1.0}
    for bad in (-1e-4, np.nan, [1.0, np.inf]):
        with pytest.raises(InvalidInput, match="released_energy"):
            energy_height(bad, **given_)
    for name in given_:
        with pytest.raises(InvalidInput, match=name):
            energy_height(1.0, **(given_ | {name: -1.0}))
    for arguments in ({"speed": 0.0}, {"tilt": 1.6}, {"gravity": -9.8}):
        with pytest.raises(InvalidInput, match=next(iter(arguments))):
            Flight(**({"speed": 1.0} | arguments))
    with pytest.raises(InvalidInput, match="height"):
        flight_from_heights(0.0, 1.0)
    with pytest.raises(InvalidInput, match="terminal"):
        launch_speed_with_drag(1.0, terminal=0.0)
    with pytest.raises(InvalidInput, match="drag_coefficient"):
        terminal_speed(thickness=1.0, density=1.0, drag_coefficient=0.0)
