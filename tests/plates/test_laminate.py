"""Laminates: completing squares, sign conventions, limits, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lissome.errors import InvalidInput, NotConverged
from lissome.plates import (
    Laminate,
    Layer,
    NoStrain,
    SigmoidCurve,
    TabulatedCurve,
)


class Constant:
    """A spontaneous strain that does not depend on temperature."""

    def __init__(self, strain):
        self.strain = strain

    def __call__(self, temperature):
        return np.full(np.shape(temperature), self.strain)


def stack(*rows, nu=0.4, tensor="incompressible"):
    """Layers from (thickness, modulus, strain along)."""
    return Laminate(
        [
            Layer(h, e, nu if np.isscalar(nu) else nu[i], strain=Constant(a), tensor=tensor)
            for i, (h, e, a) in enumerate(rows)
        ]
    )


@pytest.mark.parametrize("ratio", [0.2, 1.0, 3.7])
@pytest.mark.parametrize("moduli", [(1.0, 1.0), (1.0, 8.0), (5.0, 0.6)])
def test_bimetal_strip_of_timoshenko(ratio, moduli):
    # Timoshenko 1925: a strip of two metals, m = thickness ratio, n = ratio of moduli.
    low, high = ratio, 1.0
    strains = (-0.013, 0.004)
    sheet = stack((low, moduli[0], strains[0]), (high, moduli[1], strains[1]), tensor="isotropic")
    m, n, h = low / high, moduli[0] / moduli[1], low + high
    curvature = (
        6 * (strains[0] - strains[1]) * (1 + m) ** 2
        / (h * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))))
    )  # fmt: skip
    found = sheet.spontaneous(20.0)
    assert found.curvature_along == pytest.approx(curvature, rel=1e-12)
    assert found.curvature_across == pytest.approx(curvature, rel=1e-12)
    assert curvature < 0  # the bottom is the shorter one: the sheet is a dome


def test_the_curvature_bends_the_sheet_as_a_hand_would():
    # Ends of a strip whose bottom contracts hang down: w'' < 0. Integrate w'' = kappa.
    kappa = float(stack((0.5, 1.0, -0.1), (0.5, 1.0, 0.0)).spontaneous(0.0).curvature_along)
    x = np.linspace(-1, 1, 5)
    w = 0.5 * kappa * x**2
    assert w[0] < w[2] > w[-1]
    # ... and the strain at height z of a sheet of Hessian kappa is -z kappa: short at the bottom.
    assert 0.5 * kappa < 0


def test_equal_layers_are_one_layer():
    one = stack((0.9, 2.0, -0.05))
    three = stack(*[(0.3, 2.0, -0.05)] * 3)
    for name in ("stretching_modulus", "bending_modulus", "neutral_plane", "thickness"):
        assert getattr(three, name) == pytest.approx(getattr(one, name), rel=1e-14, abs=1e-16)
    gradient = lambda z: 20.0 + 50.0 * z  # noqa: E731
    a, b = (
        Laminate([Layer(0.9 / n, 2.0, 0.3, strain=SigmoidCurve(0.3, 30.0, 9.0))] * n).spontaneous(
            gradient
        )
        for n in (1, 3)
    )
    for name in ("strain_along", "strain_across", "curvature_along", "residual_energy"):
        assert getattr(a, name) == pytest.approx(float(getattr(b, name)), rel=1e-10)


layers = st.lists(
    st.tuples(st.floats(0.05, 2.0), st.floats(0.1, 20.0), st.floats(-0.3, 0.3)),
    min_size=1,
    max_size=5,
)


@given(layers, st.floats(-0.9, 0.5))
@settings(max_examples=50, deadline=None)
def test_turning_a_stack_over_turns_its_curvature(rows, nu):
    sheet = stack(*rows, nu=nu)
    other = sheet.flipped()
    a, b = sheet.spontaneous(0.0), other.spontaneous(0.0)
    assert other.bending_modulus == pytest.approx(sheet.bending_modulus, rel=1e-10)
    assert other.neutral_plane == pytest.approx(-sheet.neutral_plane, abs=1e-12)
    assert b.strain_along == pytest.approx(float(a.strain_along), abs=1e-12)
    assert b.curvature_along == pytest.approx(-float(a.curvature_along), abs=1e-10)
    assert b.residual_energy == pytest.approx(float(a.residual_energy), rel=1e-9, abs=1e-12)


def density(sheet, strain, curvature, plane, temperature=0.0, n=4000):
    """Energy per area by the midpoint rule through the thickness, component by component."""
    total = 0.0
    for i, layer in enumerate(sheet.layers):
        z0, z1 = sheet.interfaces[i], sheet.interfaces[i + 1]
        z = z0 + (np.arange(n) + 0.5) * (z1 - z0) / n
        nu, e = layer.poisson_ratio, layer.modulus_at((z - z0) / (z1 - z0))
        a, b = layer.spontaneous_strain(np.full(n, temperature))
        hat = np.zeros((2, 2, n))
        hat[0, 0], hat[1, 1] = a, b
        xi = strain[..., None] - (z - plane) * curvature[..., None] - hat
        w = nu * np.trace(xi) ** 2 + (1 - nu) * np.einsum("ijn,ijn->n", xi, xi)
        total += (e * w / (2 * (1 - nu**2))).sum() * (z1 - z0) / n
    return total


def form(nu, xi):
    """W of (5.2)."""
    return (nu * np.trace(xi) ** 2 + (1 - nu) * (xi * xi).sum()) / (2 * (1 - nu**2))


@given(layers, st.floats(-0.9, 0.5), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_energy_is_a_sum_of_squares_for_any_strain_and_curvature(rows, nu, seed):
    # Decoupling is exact: the strain need not be near the spontaneous one.
    sheet = stack(*rows, nu=nu, tensor=0.3)
    found = sheet.spontaneous(0.0)
    rng = np.random.default_rng(seed)
    strain, curvature = (0.5 * (m + m.T) for m in rng.normal(size=(2, 2, 2)))
    eps_m = np.diag([found.strain_along, found.strain_across])
    kappa_m = np.diag([found.curvature_along, found.curvature_across])
    squares = (
        sheet.stretching_modulus * form(nu, strain - eps_m)
        + sheet.bending_modulus * form(nu, curvature - kappa_m)
        + found.residual_energy
    )
    direct = density(sheet, strain, curvature, found.plane)
    assert found.plane == pytest.approx(sheet.neutral_plane, abs=1e-14)
    assert squares == pytest.approx(direct, rel=1e-6)


def test_layers_of_several_poisson_ratios_relax_where_the_energy_is_least():
    sheet = stack((0.4, 2.0, -0.1), (0.3, 1.0, 0.05), (0.5, 7.0, -0.02), nu=(0.5, 0.1, -0.3))
    found = sheet.spontaneous(0.0)
    assert found.plane == 0.0
    point = np.array(
        [
            found.strain_along,
            found.strain_across,
            found.curvature_along,
            found.curvature_across,
        ]
    )

    def energy(p):
        return density(sheet, np.diag(p[:2]), np.diag(p[2:]), 0.0)

    least = energy(point)
    assert least == pytest.approx(float(found.residual_energy), rel=1e-6)
    for i in range(4):
        step = np.eye(4)[i] * 1e-3
        slope = (energy(point + step) - energy(point - step)) / 2e-3
        bend = (energy(point + step) + energy(point - step) - 2 * least) / 1e-6
        assert abs(slope) < 1e-6 * bend  # the midpoint rule is good to 1e-7
    with pytest.raises(InvalidInput, match="Poisson ratios"):
        sheet.bending_modulus  # noqa: B018


def test_stiffness_matrices_are_those_of_lamination_theory():
    sheet = stack((0.4, 2.0, 0), (0.3, 1.0, 0), nu=(0.5, 0.1))
    for power, matrix in enumerate(sheet.stiffness_matrices()):
        expected = np.zeros((3, 3))
        for i, layer in enumerate(sheet.layers):
            e, nu = layer.modulus, layer.poisson_ratio
            reduced = e / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
            z0, z1 = sheet.interfaces[i : i + 2]
            expected += reduced * (z1 ** (power + 1) - z0 ** (power + 1)) / (power + 1)
        assert matrix == pytest.approx(expected, rel=1e-13)
    uniform = stack((0.4, 2.0, 0), (0.3, 1.0, 0), nu=0.3)
    a, b, d = uniform.stiffness_matrices()
    reduced = d - b @ np.linalg.solve(a, b)
    assert reduced[0, 0] == pytest.approx(uniform.bending_modulus / (1 - 0.3**2), rel=1e-12)


def test_uniform_plate():
    sheet = stack((0.2, 5.0, 0.0), nu=0.3)
    assert sheet.stretching_modulus == pytest.approx(5.0 * 0.2, rel=1e-15)
    assert sheet.bending_modulus == pytest.approx(5.0 * 0.2**3 / 12, rel=1e-14)
    assert sheet.bending_length == pytest.approx(0.2 / math.sqrt(12), rel=1e-14)
    assert sheet.neutral_plane == 0.0
    found = sheet.spontaneous(77.0)
    assert found.strain_along == found.curvature_along == found.residual_energy == 0.0


def test_a_graded_modulus_against_closed_forms():
    # E = exp(a s), s from the bottom to the top of a plate of thickness h
    a, h = 1.7, 0.3
    sheet = Laminate([Layer(h, lambda s: np.exp(a * s), 0.2)])
    z = lambda s: h * (s - 0.5)  # noqa: E731
    s = np.polynomial.legendre.leggauss(40)
    nodes, weights = 0.5 * (s[0] + 1), 0.5 * h * s[1]
    for p in range(3):
        assert sheet.moment(p) == pytest.approx(
            (weights * z(nodes) ** p * np.exp(a * nodes)).sum(), rel=1e-13, abs=1e-17
        )
    assert sheet.moment(0) == pytest.approx(h * (math.exp(a) - 1) / a, rel=1e-14)
    m = [sheet.moment(p) for p in range(3)]
    assert sheet.bending_modulus == pytest.approx(m[2] - m[1] ** 2 / m[0], rel=1e-10)
    over = sheet.flipped()
    assert over.neutral_plane == pytest.approx(-sheet.neutral_plane, rel=1e-12)
    fine = Laminate([Layer(h / 400, math.exp(a * (i + 0.5) / 400), 0.2) for i in range(400)])
    assert fine.bending_modulus == pytest.approx(sheet.bending_modulus, rel=1e-5)


def test_a_strain_linear_in_height_is_relaxed_completely():
    slope = TabulatedCurve([-1.0, 0.0, 1.0], [-0.1, 0.0, 0.1])
    rows = [(0.3, 2.0), (0.5, 0.7), (0.2, 9.0)]
    sheet = Laminate([Layer(h, e, 0.3, strain=slope, tensor=-0.5) for h, e in rows])
    found = sheet.spontaneous(lambda z: z)
    assert found.curvature_along == pytest.approx(-0.1, rel=1e-10)
    assert found.curvature_across == pytest.approx(-0.05, rel=1e-10)
    assert found.strain_along == pytest.approx(0.1 * sheet.neutral_plane, rel=1e-10)
    assert found.residual_energy < 1e-12 * sheet.stretching_modulus * 0.1**2


def test_residual_energy_of_a_bilayer_of_one_material():
    # strains 0 and e on equal halves: the best line through the step leaves e^2/16 on average
    e, nu = 0.1, 0.3
    sheet = stack((0.5, 1.0, 0.0), (0.5, 1.0, e), nu=nu, tensor="isotropic")
    found = sheet.spontaneous(0.0)
    assert found.curvature_along == pytest.approx(-1.5 * e, rel=1e-12)  # the top is longer
    assert found.residual_energy == pytest.approx(e**2 / 16 / (1 - nu), rel=1e-11)


def test_leading_axes_of_a_profile_stay():
    sheet = Laminate([Layer(1.0, 1.0, 0.3, strain=SigmoidCurve(0.2, 50.0, 10.0))])
    levels = np.array([30.0, 60.0, 90.0])
    many = sheet.spontaneous(lambda z: levels[:, None] + 20.0 * z)
    assert many.curvature_along.shape == (3,)
    for i, level in enumerate(levels):
        one = sheet.spontaneous(lambda z, level=level: level + 20.0 * z)
        assert many.curvature_along[i] == pytest.approx(float(one.curvature_along), rel=1e-10)


def test_quantities_become_si():
    layer = Layer.of(
        thickness="30 um", modulus="3.2 MPa", poisson_ratio=0.5, diffusivity="0.1 mm^2/s"
    )
    assert (layer.thickness, layer.modulus) == pytest.approx((30e-6, 3.2e6), rel=1e-14)
    assert layer.diffusivity == pytest.approx(1e-7, rel=1e-14)
    sheet = Laminate([layer] * 3, thickness=90e-6)
    assert sheet.stretching_modulus == pytest.approx(288.0, rel=1e-12)  # Pa m
    with pytest.raises(
        InvalidInput, match="`thickness` is 30 MPa; pass a quantity with units of m"
    ):
        Layer.of(thickness="30 MPa", modulus="1 MPa", poisson_ratio=0.5, diffusivity="1 mm^2/s")
    with pytest.raises(InvalidInput, match="without units"):
        Layer.of(thickness=30, modulus="1 MPa", poisson_ratio=0.5, diffusivity="1 mm^2/s")
    with pytest.raises(InvalidInput, match="mixes layers"):
        Laminate([layer, Layer(1.0, 1.0, 0.5)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"thickness": 0.0}, "`thickness`"),
        ({"thickness": -1e-6}, "`thickness`"),
        ({"modulus": 0.0}, "`modulus`"),
        ({"modulus": float("nan")}, "`modulus`"),
        ({"poisson_ratio": 0.51}, r"\(-1, 1/2\]"),
        ({"poisson_ratio": -1.0}, r"\(-1, 1/2\]"),
        ({"strain": 0.1}, "function of temperature"),
        ({"tensor": "incompressable"}, "did you mean 'incompressible'"),
        ({"conductivity": 0.0}, "`conductivity`"),
        ({"heat_capacity": -1.0}, "`heat_capacity`"),
    ],
)
def test_bad_layers(arguments, message):
    with pytest.raises(InvalidInput, match=message):
        Layer(**({"thickness": 1.0, "modulus": 1.0, "poisson_ratio": 0.3} | arguments))


def test_bad_stacks():
    layer = Layer(1.0, 1.0, 0.3)
    for layers in ([], layer, [layer, "soft"], None):
        with pytest.raises(InvalidInput, match="sequence of one or more Layer"):
            Laminate(layers)
    with pytest.raises(InvalidInput, match=r"add up to 2.0"):
        Laminate([layer, layer], thickness=2.1)
    with pytest.raises(InvalidInput, match="within 1 of the middle"):
        Laminate([layer, layer]).modulus_at(1.5)
    with pytest.raises(InvalidInput, match="at least 0"):
        Laminate([layer]).moment(-1)


def test_bad_profiles():
    sheet = Laminate([Layer(1.0, 1.0, 0.3, strain=SigmoidCurve(0.2, 50.0, 10.0))])
    with pytest.raises(InvalidInput, match="`temperature`"):
        sheet.spontaneous(float("nan"))
    with pytest.raises(InvalidInput, match="for each height"):
        sheet.spontaneous(lambda z: np.full(z.shape, np.nan))
    with pytest.raises(InvalidInput, match="for each height"):
        sheet.spontaneous(lambda z: z[:3])
    with pytest.raises(InvalidInput, match="one positive modulus"):
        Laminate([Layer(1.0, lambda s: s - 0.5, 0.3)]).moment(0)
    with pytest.raises(InvalidInput, match="one finite strain"):
        Laminate([Layer(1.0, 1.0, 0.3, strain=lambda t: t * np.nan)]).spontaneous(20.0)
    with pytest.raises(NotConverged, match="layer boundary"):
        sheet.spontaneous(lambda z: np.where(z < 0.1234, 20.0, 80.0))


def test_passive_layers_do_nothing():
    assert (NoStrain()([1.0, 2.0]) == 0.0).all()
    assert Layer(1.0, 1.0, 0.3) == Layer(1.0, 1.0, 0.3)
