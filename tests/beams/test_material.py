"""Lambda from material values: the Beer profile, its limits, units."""

from __future__ import annotations

import math

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from lissome.beams import absorption_moment, illumination
from lissome.errors import InvalidInput
from lissome.references import photomechanical

TABLE = ("-5.4e-5 m^2/W", "100 W/m^2", "15 um", "0.56 um", "15 mm")


@pytest.mark.parametrize("ratio", [0.02, 0.1, 0.5, 3.0, 1e3])
def test_moment_is_the_integral(ratio):
    points = [0.5 - ratio, 0.5 - 5 * ratio]
    value, _ = quad(
        lambda z: math.exp(-(0.5 - z) / ratio) * z,
        -0.5,
        0.5,
        epsabs=1e-14,
        epsrel=1e-11,
        points=[p for p in points if -0.5 < p < 0.5] or None,
    )
    assert abs(absorption_moment(ratio) / value - 1) < 1e-9


@given(st.floats(1e-6, 1e8))
def test_moment_lies_between_its_limits(ratio):
    moment = absorption_moment(ratio)
    assert 0 < moment <= 0.5 * ratio * (1 + 1e-12)  # shallow
    assert moment <= 1 / (12 * ratio) * (1 + 1e-12)  # deep


def test_limits():
    assert abs(absorption_moment(1e-7) / 0.5e-7 - 1) < 1e-6
    assert abs(absorption_moment(1e7) * 12e7 - 1) < 1e-6


def test_table_of_the_thesis_against_the_independent_formula():
    film = illumination(*TABLE)
    independent = -12 * -5.4e-5 * 100 * 15e-3 / (15e-6) ** 3
    independent *= photomechanical.absorption_moment(15e-6, 0.56e-6)
    assert abs(film.value / independent - 1) < 1e-12
    assert film.response == 1.0
    assert film.intensity == film.value
    # The shallow limit is too large by 2 d / h, in the next order.
    assert abs(film.shallow / film.value - 1 / (1 - 2 * 0.56 / 15)) < 1e-10


def test_units_do_not_matter():
    registry = pint.get_application_registry()
    film = illumination(
        registry.Quantity(-0.54, "cm^2/W"),
        registry.Quantity(10.0, "mW/cm^2"),
        registry.Quantity(0.015, "mm"),
        "560 nm",
        "1.5 cm",
    )
    assert abs(film.value / illumination(*TABLE).value - 1) < 1e-12


def test_expansion_gives_the_other_sign():
    film = illumination("5.4e-5 m^2/W", *TABLE[1:])
    assert film.value == -illumination(*TABLE).value
    assert film.response == -1.0


@pytest.mark.parametrize(
    ("place", "value", "name"),
    [
        (0, -5.4e-5, "coupling"),
        (0, "-5.4e-5 m", "coupling"),
        (1, "-100 W/m^2", "intensity"),
        (1, "bright", "intensity"),
        (2, "0 um", "thickness"),
        (2, "nan um", "thickness"),
        (3, "-1 um", "depth"),
        (4, "15", "length"),
        (4, None, "length"),
    ],
)
def test_bad_values_are_refused(place, value, name):
    values = list(TABLE)
    values[place] = value
    with pytest.raises(InvalidInput, match=f"`{name}`"):
        illumination(*values)
