"""Errors of the thesis that its own numbers, units and formulas show."""

import numpy as np
import pint
import pytest
from scipy.integrate import quad

from lissome import literature


def meters(id):
    return literature.value(id).to("m")


def illumination(**changes):
    """Lambda = alpha l I_0 with alpha below (3.9), by quadrature, from Table 3.1."""
    given = {
        "response": literature.value("t31-response").to("m^2/W"),
        "intensity": literature.value("t31-intensity").to("W/m^2"),
        "thickness": meters("t31-thickness"),
        "depth": meters("t31-depth"),
        "length": meters("t31-length"),
    } | changes
    h, d = given["thickness"], given["depth"]
    # in units of h, depth below the lit surface: z = h (1/2 - u)
    integral = (
        h**2
        * quad(lambda u: np.exp(-u * h / d) * (0.5 - u), 0, 1, epsabs=0, epsrel=1e-10, limit=200)[0]
    )
    strength = given["response"] * given["intensity"] * given["length"]
    return -12 * strength / h**3 * integral


def test_lambda_of_table_3_1():
    printed = float(literature.value("korner-lambda"))
    assert illumination() == pytest.approx(1.1193, abs=5e-5)
    # closed form of the integral, with q = d/h
    h, d = meters("t31-thickness"), meters("t31-depth")
    q = d / h
    strength = -5.4e-5 * 100 * 15e-3
    closed = -12 * strength / h * (q / 2 * (1 + np.exp(-1 / q)) - q**2 * (1 - np.exp(-1 / q)))
    assert illumination() == pytest.approx(closed, rel=1e-10)
    for change in (
        {"thickness": 9.07e-6},
        {"length": 38.9e-3},
        {"intensity": 259.0},
        {"response": -1.40e-4},
        {"depth": 1.75e-6},
    ):
        assert illumination(**change) == pytest.approx(printed, rel=2e-3), change
    assert illumination(depth=meters("c3-penetration-depth")) == pytest.approx(2.59, abs=5e-3)


def test_lambda_needs_response_and_length():
    unit = pint.UnitRegistry()
    rate, light, length = 1 / unit.s, unit.W / unit.m**2, unit.m
    efficiency = 1 / light  # alpha_1 I is a fraction of molecules: (3.8)
    integral = length**2
    printed = rate * efficiency * light / (rate * length**3) * integral
    assert printed.units.is_compatible_with("1/m")
    assert not printed.units.dimensionless
    assert (printed * length).units.dimensionless  # the strain per molecule, lambda, is a number


def test_lengths_of_the_films():
    for appendix, text in (
        ("c3-beam-thickness-a1", "c3-beam-thickness"),
        ("c3-film-thickness-a1", "c3-film-thickness"),
        ("c3-penetration-depth-a1", "c3-penetration-depth"),
    ):
        assert literature.value(appendix).printed.endswith(" m")
        assert literature.value(text).printed.endswith(" um")
        assert meters(appendix) == meters(text)


def test_film_and_beam_contradict():
    film, beam = meters("c3-film-thickness"), meters("c3-beam-thickness")
    depth = meters("c3-penetration-depth")
    assert film != beam
    assert illumination(thickness=film, depth=depth) > 9 * illumination(thickness=beam, depth=depth)


def test_unit_of_the_stretching_modulus():
    unit = pint.UnitRegistry()

    def quantity(id):
        number = literature.value(id)
        return unit.Quantity(number.value, number.unit)

    weight = quantity("t52-density") * quantity("t52-gravity") * quantity("t52-thickness")
    height = quantity("t52-stretching-modulus") * quantity("t52-released-energy") / weight
    assert height.to("cm").magnitude == pytest.approx(
        float(literature.value("t52-height")), rel=0.01
    )
    assert literature.value("t52-stretching-modulus").printed.endswith("mPa")
    wrong = unit.Quantity(1053, "mPa") * quantity("t52-released-energy") / weight
    assert wrong.units.is_compatible_with("dimensionless")


def test_thickness_of_the_laminate():
    assert literature.value("c5-laminate-thickness-figure").printed == "90 mm"
    assert meters("t52-thickness") == pytest.approx(3 * meters("c5-film-thickness"), rel=1e-12)


def test_crosslink_temperature_contradicts():
    note, text = (literature.value(f"{x}-crosslink-temperature") for x in ("ta1", "c5"))
    assert (note.value, text.value) == (100.0, 150.0)
    assert note.place != text.place


def test_central_difference():
    h = np.array([1e-2, 5e-3])
    corrected = (np.exp(1 + h) - np.exp(1 - h)) / (2 * h)
    errors = np.abs(corrected - np.e)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=1e-3)
    assert (np.exp(1 + h) - np.exp(1 + h) == 0).all()  # as printed
