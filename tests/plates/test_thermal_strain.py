"""Curves of strain against temperature, and the tensors built on them."""

from __future__ import annotations

import numpy as np
import pytest

from lissome.errors import InvalidInput
from lissome.plates import SigmoidCurve, TabulatedCurve, fit_sigmoid, transverse_strain
from lissome.plates.thermal_strain import TENSORS


@pytest.mark.parametrize("shape", ["logistic", "gaussian"])
def test_sigmoid_has_its_inflection_slope_and_limits(shape):
    curve = SigmoidCurve(0.3, transition=170.0, width=8.0, reference=25.0, shape=shape)
    d = 0.5
    t = np.array([170.0 - d, 170.0, 170.0 + d])
    low, mid, high = curve(t)
    assert (high - low) / (2 * d) == pytest.approx(-0.3 / (4 * 8.0), rel=1e-3)  # A/(4 w)
    assert low + high - 2 * mid == pytest.approx(0.0, abs=1e-15)  # odd about the inflection
    assert curve(25.0) == 0.0
    assert curve(1e4) - curve(-1e4) == pytest.approx(-0.3, rel=1e-14)


@pytest.mark.parametrize("shape", ["logistic", "gaussian"])
@pytest.mark.parametrize("width", [5.0, 12.0, 30.0])
def test_fit_meets_the_given_slope_and_inflection(width, shape):
    curve = fit_sigmoid(
        transition=170.0, rate=0.0054, between=(155.0, 165.0), width=width, shape=shape
    )
    assert float(curve(155.0) - curve(165.0)) / 10 == pytest.approx(0.0054, rel=1e-12)
    t = np.linspace(100, 240, 2801)
    steepest = t[1:-1][np.argmin(curve(t)[2:] - curve(t)[:-2])]
    assert steepest == pytest.approx(170.0, abs=0.06)


def test_a_slope_far_below_a_sharp_transition_is_no_film():
    with pytest.raises(InvalidInput, match="greater width or a nearer transition"):
        fit_sigmoid(transition=300.0, rate=0.005, between=(155.0, 165.0), width=10.0)
    with pytest.raises(InvalidInput, match="lower temperature first"):
        fit_sigmoid(transition=170.0, rate=0.005, between=(165.0, 155.0), width=10.0)
    with pytest.raises(InvalidInput, match="greater width"):
        fit_sigmoid(transition=1e6, rate=0.005, between=(155.0, 165.0), width=1.0)


def test_table_passes_through_its_points_without_overshoot():
    t = np.array([25.0, 90.0, 140.0, 165.0, 180.0, 225.0])
    e = np.array([0.0, -0.01, -0.03, -0.15, -0.30, -0.32])
    curve = TabulatedCurve(t, e)
    assert curve(t) == pytest.approx(e, abs=1e-15)
    fine = curve(np.linspace(25, 225, 2001))
    assert (np.diff(fine) <= 1e-15).all()
    assert curve(np.full((2, 3), 90.0)).shape == (2, 3)


def test_beyond_the_table_only_on_request():
    t, e = [20.0, 100.0, 160.0], [0.0, -0.02, -0.1]
    for bad in (19.0, 161.0, [100.0, 161.0], float("nan")):
        with pytest.raises(InvalidInput, match="measured from 20 to 160 only"):
            TabulatedCurve(t, e)(bad)
    hold = TabulatedCurve(t, e, outside="hold")
    assert hold([0.0, 300.0]) == pytest.approx([0.0, -0.1], abs=1e-15)
    extend = TabulatedCurve(t, e, outside="extend")
    inner = (extend(160.0) - extend(160.0 - 1e-5)) / 1e-5
    assert (extend(170.0) - extend(160.0)) / 10 == pytest.approx(float(inner), rel=1e-4)
    assert np.diff(extend([170.0, 180.0, 190.0]), 2) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([20.0], [0.0]), "at least two"),
        (([20.0, 20.0], [0.0, 1.0]), "strictly increasing"),
        (([30.0, 20.0], [0.0, 1.0]), "strictly increasing"),
        (([20.0, 30.0], [0.0]), "shape"),
        (([20.0, 30.0], [0.0, -10.0]), "not per cent"),
        (([20.0, float("nan")], [0.0, 1.0]), "finite"),
        (([20.0, 30.0], [0.0, 0.1], "guess"), "one of 'refuse', 'hold', 'extend'"),
    ],
)
def test_bad_tables(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        TabulatedCurve(*arguments)


def test_bad_sigmoids():
    for arguments in ({"width": 0.0}, {"saturation": 1.0}, {"transition": float("inf")}):
        with pytest.raises(InvalidInput, match=next(iter(arguments))):
            SigmoidCurve(**({"saturation": 0.2, "transition": 100.0, "width": 5.0} | arguments))
    with pytest.raises(InvalidInput, match="did you mean 'logistic'"):
        SigmoidCurve(0.2, 100.0, 5.0, shape="logistik")


def test_an_incompressible_film_keeps_its_volume():
    a = np.linspace(-0.5, 0.5, 11)
    exact = transverse_strain(a, "incompressible-finite")
    assert (1 + a) * (1 + exact) ** 2 == pytest.approx(np.ones(11), rel=1e-14)
    for small in (1e-2, 1e-3):
        error = transverse_strain(small, "incompressible-finite") - transverse_strain(small)
        assert error == pytest.approx(3 / 8 * small**2, rel=2 * small)  # second order


def test_tensors_by_name_and_by_ratio():
    a = np.array([-0.2, 0.1])
    expected = {"uniaxial": 0 * a, "isotropic": a, "area-preserving": -a, "incompressible": -a / 2}
    for name, b in expected.items():
        assert transverse_strain(a, name) == pytest.approx(b, abs=1e-16)
    assert set(expected) | {"incompressible-finite"} == set(TENSORS)
    assert transverse_strain(a, 0.37) == pytest.approx(-0.37 * a, rel=1e-15)
    assert transverse_strain(1e-12, "incompressible-finite") == pytest.approx(-5e-13, rel=1e-10)
    for bad in (-1.0, [0.1, float("nan")]):
        with pytest.raises(InvalidInput, match="above -1"):
            transverse_strain(bad)
    with pytest.raises(InvalidInput, match="one of"):
        transverse_strain(0.1, "spherical")
    with pytest.raises(InvalidInput, match="`tensor`"):
        transverse_strain(0.1, float("nan"))
