"""Clamped linear plates: Ritz against the tables, other elements and the library's plates against Ritz."""

import numpy as np
import pytest
import skfem

import lissome as ls
from lissome.errors import InvalidInput
from lissome.plates import MixedPlate, Plate
from lissome.references.linear_plate import clamped_square, finite_elements

EXACT = clamped_square()


def square(refinement):
    return skfem.MeshTri.init_sqsymmetric().refined(refinement)


def test_ritz_converges_to_the_tabulated_deflection():
    """0.00126532 q a^4/D, as tables of plates have it."""
    assert EXACT.center == pytest.approx(1.26532e-3, abs=5e-9)
    coarse = clamped_square(16)
    assert coarse.compliance < EXACT.compliance  # a minimum principle
    assert coarse.compliance == pytest.approx(EXACT.compliance, rel=1e-8)


@pytest.mark.parametrize(("element", "order"), [("Morley", 1.85), ("interior penalty", 1.75)])
def test_other_elements_are_of_second_order(element, order):
    errors = [
        abs(finite_elements(square(r), element).compliance / EXACT.compliance - 1) for r in (3, 4)
    ]
    assert order < np.log2(errors[0] / errors[1]) < 2.2
    # For a clamped plate Poisson's ratio changes the error only.
    other = finite_elements(square(3), element, poisson_ratio=0.0).compliance
    assert abs(other / EXACT.compliance - 1) < 2 * errors[0]


def compliance(scheme, refinement, **more):
    plate = scheme(
        mesh=square(refinement), bending=1 - 0.3**2, poisson_ratio=0.3, edges="clamped", pressure=1e-4, **more
    )  # fmt: skip
    return -2 * ls.equilibrate(plate).energy / 1e-8


@pytest.mark.parametrize(
    ("scheme", "more", "meshes", "least"),
    [
        (Plate, {"degree": 2}, (1, 3), 3.7),
        (Plate, {"degree": 3}, (0, 2), 5.0),
        (MixedPlate, {"orders": (2, 1)}, (2, 4), 1.9),
        (MixedPlate, {"orders": (2, 2)}, (1, 3), 1.9),
    ],
)
def test_orders_of_the_compliance(scheme, more, meshes, least):
    errors = [abs(compliance(scheme, r, **more) / EXACT.compliance - 1) for r in meshes]
    assert np.log2(errors[0] / errors[1]) / 2 > least


def test_bad_arguments_are_refused():
    for call, words in (
        (lambda: clamped_square(-1), "degree"),
        (lambda: finite_elements(square(0), "Argyris"), "Argyris"),
        (lambda: finite_elements(square(0), "Morley", poisson_ratio=1.0), "poisson_ratio"),
        (lambda: finite_elements(square(0), "interior penalty", penalty=0.0), "penalty"),
    ):
        with pytest.raises(InvalidInput, match=words):
            call()
