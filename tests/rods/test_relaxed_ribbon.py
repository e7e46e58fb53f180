"""The convex envelope of ribbon laws: limits, derivatives, convexity."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from lissome import rods
from lissome.errors import InvalidInput
from lissome.rods import RelaxedRibbon, SanoWada

CROSSOVER = 0.4


def strains(count=400):
    return np.random.default_rng(7).normal(size=(count, 3)) * [5.0, 1.0, 6.0]


def envelope(k, soft):
    x, y, z = k.T
    base = soft + x * x
    inside = x * x + z**4 / np.where(base > 0, base, 1.0)
    return 0.5 * (np.where(z * z < base, inside, 2 * z * z - soft) + 40.0 * y * y + 1.3 * z * z)


def test_energy_is_the_minimum_over_the_mean_square():
    law, soft = RelaxedRibbon((1.0, 40.0), 1.3, CROSSOVER, smoothing=0.1), CROSSOVER**-2
    for x, y, z in strains(30):

        def bracket(log_excess, x=x, z=z):
            t = x * x + math.exp(log_excess)
            return t + z**4 / (soft + t) - 0.01 * (1 + math.log((t - x * x) / 0.01))

        least = minimize_scalar(bracket, bracket=(-8.0, 4.0), tol=1e-12).fun
        energy = law.energy([[x, y, z]])[0]
        assert energy == pytest.approx(0.5 * (least + 40 * y * y + 1.3 * z * z), rel=1e-12)


@pytest.mark.parametrize("crossover", [CROSSOVER, math.inf])
def test_envelope_without_smoothing(crossover):
    """The error falls at least like smoothing squared times its logarithm."""
    k = strains()
    errors = []
    for smoothing in (1e-2, 1e-3, 1e-4):
        law = RelaxedRibbon((1.0, 40.0), 1.3, crossover, smoothing=smoothing)
        errors.append(abs(law.energy(k) - envelope(k, crossover**-2)).max())
        assert errors[-1] < 10 * smoothing**2 * math.log(100 / smoothing)
    assert errors[2] < errors[1] < errors[0]


@pytest.mark.parametrize("crossover", [CROSSOVER, math.inf])
@pytest.mark.parametrize("smoothing", [1e-3, 0.1])
def test_convex_everywhere(crossover, smoothing):
    law = RelaxedRibbon((1.0, 40.0), 1.3, crossover, smoothing=smoothing)
    k = np.vstack([strains(), [[0.0, 0.0, 8.0], [1e-9, 0.0, 8.0], [0.0, 0.0, 0.0]]])
    assert law.is_elliptic(k).all()
    a, b = k[:200], k[200:400]
    middle = law.energy(0.5 * (a + b))
    assert np.all(middle <= 0.5 * (law.energy(a) + law.energy(b)) + 1e-12)


@pytest.mark.parametrize("crossover", [CROSSOVER, math.inf])
def test_derivatives(crossover):
    law, k, step = RelaxedRibbon((1.0, 40.0), 1.3, crossover, smoothing=0.3), strains(), 1e-6
    _, stress, stiffness = law.evaluate(k)
    for a in range(3):
        move = step * np.eye(3)[a]
        up, down = law.evaluate(k + move), law.evaluate(k - move)
        assert np.allclose((up[0] - down[0]) / (2 * step), stress[:, a], atol=1e-6)
        assert np.allclose((up[1] - down[1]) / (2 * step), stiffness[:, :, a], atol=2e-5)


@pytest.mark.parametrize("smoothing", [1e-6, 1e-9, 1e-13, 1e-17, 1e-40])
def test_a_sharp_envelope_is_exact_to_rounding(smoothing):
    """At equal bending and twist D - x^2 = delta x / sqrt(2) + ..., so that the moment is delta sqrt(2)."""
    law = RelaxedRibbon((1.0, 40.0), 1.3, math.inf, smoothing=smoothing)
    for size in (1.0, -3.0):
        _, stress, _ = law.evaluate([[size, 0.0, size]], 1)
        moment = math.sqrt(2.0) * smoothing * np.sign(size)
        assert stress[0, 0] == pytest.approx(moment, rel=2 * smoothing + 1e-14, abs=0.0)


def test_units_of_length_do_not_matter():
    """Powers of two change no digit."""
    unit = 2.0**90
    small = RelaxedRibbon((1.0, 40.0), 1.3, CROSSOVER, smoothing=0.1).evaluate(strains())
    large = RelaxedRibbon((1.0, 40.0), 1.3, CROSSOVER / unit, smoothing=0.1 * unit)
    values = large.evaluate(strains() * unit)
    for power, one, other in zip((2, 1, 0), small, values, strict=True):
        assert other == pytest.approx(one * unit**power, rel=1e-14, abs=0.0)


def test_is_sano_wada_where_that_is_convex():
    k = strains() * [1.0, 1.0, 0.2]
    k = k[k[:, 2] ** 2 < 0.5 * (CROSSOVER**-2 + k[:, 0] ** 2)]
    plain = SanoWada((1.0, 40.0), 1.3, CROSSOVER).evaluate(k)
    relaxed = RelaxedRibbon((1.0, 40.0), 1.3, CROSSOVER, smoothing=1e-5).evaluate(k)
    for one, other in zip(plain, relaxed, strict=True):
        assert np.allclose(one, other, rtol=1e-8, atol=1e-8)


def test_sadowsky_at_equal_bending_and_twist():
    """(k1^2 + k3^2)^2 / k1^2 meets 4 k3^2 where they are equal; the bending moment vanishes there."""
    law = RelaxedRibbon.sadowsky(0.1, 0.01, 12e7, poisson_ratio=0.5, smoothing=1e-7)
    rigidity = 12e7 * 0.01**3 / 12 / 0.75 * 0.1
    energy, stress, _ = law.evaluate(np.array([[2.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.5, 0.0, 1.0]]))
    assert energy == pytest.approx(0.5 * rigidity * np.array([6.25, 4.0, 4.0]), rel=1e-6)
    assert stress[1, 0] == pytest.approx(0.0, abs=1e-6 * rigidity)
    assert stress[2, 2] == pytest.approx(4.0 * rigidity, rel=1e-6)


def test_geometry_and_input():
    relaxed = RelaxedRibbon.from_geometry(8.0, 0.2, 3.0, poisson_ratio=0.3, smoothing=1e-4)
    plain = SanoWada.from_geometry(8.0, 0.2, 3.0, poisson_ratio=0.3)
    assert relaxed.bending == plain.bending
    assert (relaxed.twisting, relaxed.crossover) == (plain.twisting, plain.crossover)
    with pytest.raises(InvalidInput, match="smoothing"):
        RelaxedRibbon((1.0, 40.0), 1.3, 0.4, smoothing=0.0)
    with pytest.raises(InvalidInput, match="crossover"):
        RelaxedRibbon((1.0, 40.0), 1.3, -math.inf, smoothing=0.1)
    with pytest.raises(InvalidInput, match="poisson_ratio"):
        RelaxedRibbon.sadowsky(0.1, 0.01, poisson_ratio=0.6, smoothing=0.1)
    rods.check_law(relaxed)
