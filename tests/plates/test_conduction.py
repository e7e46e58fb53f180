"""Heat through the thickness: series solutions, conservation, layers, orders, units."""

from __future__ import annotations

import math

import numpy as np
import pint
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from lissome.errors import InvalidInput
from lissome.plates import (
    Conduction,
    Convection,
    FixedTemperature,
    HeatFlux,
    Insulated,
    Laminate,
    Layer,
)
from lissome.plates.conduction import _A, _ERROR

SHEET = Laminate([Layer(1.0, 1.0, 0.5)])
Z = np.linspace(-0.5, 0.5, 81)


def layers(*rows):
    """Layers from (thickness, conductivity, heat capacity)."""
    return Laminate([Layer(h, 1.0, 0.5, conductivity=k, heat_capacity=c) for h, k, c in rows])


def hot_plate(z, t, terms=400):
    """Unit jump at the bottom, insulated above: the series."""
    root = (np.arange(terms)[:, None] + 0.5) * np.pi
    return 1 - (2 / root * np.sin(root * (z + 0.5)) * np.exp(-(root**2) * t)).sum(axis=0)


def largest_error(problem, exact, times, rtol=1e-8):
    history = problem.run(until=max(times), rtol=rtol)
    return max(float(np.abs(history.at(t)(Z) - exact(Z, t)).max()) for t in times)


def test_hot_plate_against_the_series():
    times = (0.01, 0.03, 0.2, 1.0, 2.5)

    def error(elements):
        problem = Conduction(SHEET, FixedTemperature(1.0), Insulated(), 0.0, elements=elements)
        return largest_error(problem, hot_plate, times)

    errors = [error(n) for n in (20, 40, 80)]
    assert errors[-1] < 1e-5
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 2.8).all()  # quadratic elements: third order at a point


def test_three_equal_layers_conduct_as_one():
    one = Conduction(SHEET, FixedTemperature(1.0), Insulated(), 0.0, elements=60)
    three = Conduction(layers(*[(1 / 3, 1.0, 1.0)] * 3), one.bottom, one.top, 0.0)
    a, b = (p.run(until=1.0).at([0.02, 0.1, 1.0])(Z) for p in (one, three))
    assert a == pytest.approx(b, abs=2e-5)


@pytest.mark.parametrize("biot", [0.1, 1.0, 20.0])
def test_convection_against_the_series(biot):
    # k T' = -H (T - 1) at the bottom, insulated above: cos(l (1/2 - z)), l tan l = Bi
    root = np.array(
        [
            brentq(lambda l: l * math.sin(l) - biot * math.cos(l), n * np.pi, (n + 0.5) * np.pi)
            for n in range(200)
        ]
    )[:, None]
    weight = 4 * np.sin(root) / (2 * root + np.sin(2 * root))

    def exact(z, t):
        return 1 - (weight * np.cos(root * (0.5 - z)) * np.exp(-(root**2) * t)).sum(axis=0)

    problem = Conduction(SHEET, Convection(biot, 1.0), Insulated(), 0.0, elements=60)
    assert largest_error(problem, exact, (0.01, 0.1, 1.0)) < 1e-5
    assert problem.steady()(Z) == pytest.approx(np.ones(Z.size), rel=1e-9)


def test_flux_against_the_series():
    # flux 1 into the bottom: T = t + (1/2 - z)^2/2 - 1/6 - 2 sum (-1)^n cos / (n pi)^2 e^..
    n = np.arange(1, 200)[:, None]

    def exact(z, t):
        tail = (-1.0) ** n * np.cos(n * np.pi * (0.5 - z)) / (n * np.pi) ** 2
        return (
            t + (0.5 - z) ** 2 / 2 - 1 / 6
            - 2 * (tail * np.exp(-((n * np.pi) ** 2) * t)).sum(axis=0)
        )  # fmt: skip

    problem = Conduction(SHEET, HeatFlux(1.0), Insulated(), 0.0, elements=60)
    assert largest_error(problem, exact, (0.01, 0.1, 1.0)) < 5e-6
    assert problem.bounds == (-math.inf, math.inf)
    with pytest.raises(InvalidInput, match="no steady state"):
        problem.steady()


def test_contact_temperature_of_two_media():
    # Two half spaces at 0 and 1: the interface takes e1/(e1 + e2) at once, e = sqrt(k c), and the
    # profiles are error functions.
    k, c = (1.0, 4.0), (3.0, 0.5)
    sheet = layers((1.0, k[0], c[0]), (1.0, k[1], c[1]))
    problem = Conduction(
        sheet, Insulated(), Insulated(), lambda z: (z > 0).astype(float), elements=80
    )
    t = 2e-3
    profile = problem.run(until=t).at(t)
    effusivity = np.sqrt(np.array(k) * c)
    contact = effusivity[1] / effusivity.sum()
    assert profile([0.0])[0] == pytest.approx(contact, abs=1e-6)
    z = np.linspace(-0.4, 0.4, 41)
    depth = 2 * np.sqrt(np.where(z < 0, k[0] / c[0], k[1] / c[1]) * t)
    exact = np.where(
        z < 0, contact * (1 + erf(z / depth)), contact + (1 - contact) * erf(z / depth)
    )
    assert profile(z) == pytest.approx(exact, abs=2e-5)


def test_steady_state_is_a_chain_of_resistances():
    sheet = layers((0.5, 2.0, 1.0), (0.3, 0.1, 5.0), (0.2, 1.0, 1.0))
    problem = Conduction(sheet, FixedTemperature(10.0), Convection(0.5, 2.0), 7.0)
    resistances = np.array([0.5 / 2, 0.3 / 0.1, 0.2 / 1, 1 / 0.5])
    levels = 10 - 8 * np.concatenate([[0], np.cumsum(resistances)]) / resistances.sum()
    steady = problem.steady()
    assert steady(sheet.interfaces) == pytest.approx(levels[:-1], rel=1e-12)
    late = problem.run(until=30 * problem.time_scale)
    assert late.at(late.times[-1])(sheet.interfaces) == pytest.approx(levels[:-1], rel=1e-7)
    low, high = problem.bounds
    assert (low, high) == (2.0, 10.0)
    bottom, top = late.inflow(late.times[-1])
    assert bottom == pytest.approx(8 / resistances.sum(), rel=1e-6)
    assert top == pytest.approx(-bottom, rel=1e-6)


def test_heat_is_conserved():
    sheet = layers((0.4, 2.0, 3.0), (0.6, 0.3, 0.7))
    wave = lambda z: 1 + np.sin(7 * z)  # noqa: E731
    closed = Conduction(sheet, Insulated(), Insulated(), wave)
    history = closed.run(until=5.0)
    heat = history.heat(history.times)
    # exact content: integral of c (1 + sin 7 z) over the layers
    exact = sum(
        c * ((z1 - z0) - (math.cos(7 * z1) - math.cos(7 * z0)) / 7)
        for c, z0, z1 in ((3.0, -0.5, -0.1), (0.7, -0.1, 0.5))
    )
    assert heat == pytest.approx(np.full(heat.size, exact), rel=1e-9)
    mean = exact / (0.4 * 3.0 + 0.6 * 0.7)
    assert closed.steady()(Z) == pytest.approx(np.full(Z.size, mean), rel=1e-9)

    heated = Conduction(sheet, HeatFlux(2.0), HeatFlux(-0.5), wave).run(until=1.0)
    t = np.array([0.1, 0.37, 1.0])
    assert heated.heat(t) == pytest.approx(exact + 1.5 * t, rel=1e-9)

    plate = Conduction(sheet, FixedTemperature(3.0), Convection(0.4, 1.0), wave).run(until=1.0)
    x, w = np.polynomial.legendre.leggauss(60)
    t = 0.55 + 0.45 * x
    gained = 0.45 * w @ np.add(*plate.inflow(t))
    assert gained == pytest.approx(float(plate.heat(1.0) - plate.heat(0.1)), rel=1e-6)


def test_temperature_stays_between_its_bounds_and_rises_everywhere():
    history = Conduction(SHEET, FixedTemperature(160.0), Insulated(), 25.0).run(until=3.0)
    t = np.geomspace(1e-6, 3.0, 60)
    temperature = history.at(t)(Z)
    assert temperature.min() >= 25.0 and temperature.max() <= 160.0
    late = temperature[t > 1e-3]
    assert (np.diff(late, axis=0) > -1e-3).all()


def test_the_integrator_is_of_order_four_and_l_stable():
    a, b, c = _A, _A[4], _A.sum(axis=1)
    trees = [
        (np.ones(5), 1), (c, 1 / 2), (c**2, 1 / 3), (a @ c, 1 / 6), (c**3, 1 / 4), (c * (a @ c), 1 / 8),
        (a @ c**2, 1 / 12), (a @ a @ c, 1 / 24),
    ]  # fmt: skip
    for vector, value in trees:
        assert b @ vector == pytest.approx(value, abs=1e-14)
    for vector, value in trees[:4]:
        assert (b - _ERROR) @ vector == pytest.approx(value, abs=1e-14)

    def growth(z):
        return 1 + z * b @ np.linalg.solve(np.eye(5) - z * a, np.ones(5))

    assert abs(growth(-1e9)) < 1e-8
    on_axis = np.abs([growth(1j * y) for y in np.geomspace(1e-3, 1e4, 400)])
    assert on_axis.max() <= 1 + 1e-12
    # and in one step of any length a sheet becomes steady
    system = Conduction(SHEET, FixedTemperature(1.0), Insulated(), 0.0)._system
    new, _, _ = system.step(system.start(), 1e9)
    assert new == pytest.approx(np.ones(new.size), abs=1e-6)


def test_smaller_tolerances_give_smaller_errors():
    problem = Conduction(SHEET, FixedTemperature(1.0), Insulated(), 0.0)
    fine = problem.run(until=0.5, rtol=1e-12)
    t = np.geomspace(1e-3, 0.5, 50)
    errors = [
        np.abs(problem.run(until=0.5, rtol=tol).at(t)(Z) - fine.at(t)(Z)).max()
        for tol in (1e-3, 1e-5, 1e-7)
    ]
    assert errors[0] < 0.03
    assert errors[1] < errors[0] / 10 and errors[2] < errors[1] / 10


def test_scaled_and_physical_time_agree():
    h, d = 90e-6, 0.08e-6
    film = {"thickness": "30 um", "modulus": "10 MPa", "poisson_ratio": 0.5}
    capacity = "1.8 MJ/(m^3 K)"
    sheet = Laminate([Layer.of(**film, diffusivity="0.08 mm^2/s", heat_capacity=capacity)] * 3)
    physical = Conduction(sheet, FixedTemperature("160 degC"), Insulated(), "298.15 K")
    assert physical.time_scale == pytest.approx(h**2 / d, rel=1e-12)
    history = physical.run(until="200 ms")
    scaled = Conduction(layers(*[(1 / 3, 1.0, 1.0)] * 3), FixedTemperature(1.0), Insulated(), 0.0)
    unit = scaled.run(until=0.2 * d / h**2)
    assert history.scaled_times[-1] == pytest.approx(unit.times[-1], rel=1e-12)
    seconds = pint.get_application_registry().Quantity(50, "ms")
    a = history.at(seconds)(Z * h)
    b = unit.at(0.05 * d / h**2)(Z)
    assert a == pytest.approx(25 + 135 * b, abs=1e-4)
    with pytest.raises(InvalidInput, match=r"make them with Layer\.of"):
        scaled.run(until="1 s")
    with pytest.raises(InvalidInput, match="units of s"):
        physical.run(until="1 m")


def test_a_run_goes_on_from_a_profile():
    # lift-off: the sheet leaves the plate, and both faces are insulated from then on
    whole = Conduction(SHEET, FixedTemperature(1.0), Insulated(), 0.0)
    first = whole.run(until=0.2)
    again = Conduction(SHEET, FixedTemperature(1.0), Insulated(), first.at(0.2)).run(until=0.3)
    assert again.at(0.3)(Z) == pytest.approx(whole.run(until=0.5).at(0.5)(Z), abs=1e-5)
    free = Conduction(SHEET, Insulated(), Insulated(), first.at(0.2)).run(until=3.0)
    assert free.at(3.0)(Z) == pytest.approx(np.full(Z.size, float(first.heat(0.2))), abs=1e-6)


def test_nothing_happens_at_one_temperature():
    history = Conduction(SHEET, FixedTemperature(20.0), Convection(3.0, 20.0), 20.0).run(until=2.0)
    assert history.at([0.0, 1.0, 2.0])(Z) == pytest.approx(np.full((3, Z.size), 20.0), rel=1e-12)


def test_bad_input():
    hot, cold = FixedTemperature(1.0), Insulated()
    for arguments, message in (
        ((SHEET, 160.0, cold, 0.0), "`bottom`"),
        ((SHEET, hot, None, 0.0), "`top`"),
        ((SHEET.layers, hot, cold, 0.0), "`laminate`"),
        ((SHEET, hot, cold, math.nan), "`initial`"),
        ((SHEET, hot, cold, 0.0, 1), "`elements`"),
    ):
        with pytest.raises(InvalidInput, match=message):
            Conduction(*arguments)
    with pytest.raises(InvalidInput, match="at least 0"):
        Convection(-1.0, 20.0)
    with pytest.raises(InvalidInput, match="units of degC"):
        FixedTemperature("3 m")
    with pytest.raises(InvalidInput, match="`flux`"):
        HeatFlux(math.inf)
    with pytest.raises(InvalidInput, match="one temperature for each height"):
        Conduction(SHEET, hot, cold, lambda z: z * np.nan).run(until=1.0)
    problem = Conduction(SHEET, hot, cold, 0.0)
    for until in (0.0, -1.0, math.nan):
        with pytest.raises(InvalidInput, match="`until`"):
            problem.run(until=until)
    with pytest.raises(InvalidInput, match="`rtol`"):
        problem.run(until=1.0, rtol=0.0)
    history = problem.run(until=0.1)
    with pytest.raises(InvalidInput, match="run it for longer"):
        history.at(0.2)
    with pytest.raises(InvalidInput, match="outside the plate"):
        history.at(0.1)([0.6])
