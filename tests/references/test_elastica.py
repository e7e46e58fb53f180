"""Closed forms of the elastica against collocation, limits and mechanics."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp

from lissome.errors import InvalidInput
from lissome.references import elastica


def _integrate(right, start):
    """Values at 33 stations of the initial value problem, to 12 digits."""
    stations = np.linspace(0, 1, 33)
    run = solve_ivp(right, (0, 1), start, "DOP853", t_eval=stations, rtol=1e-13, atol=1e-14)
    return stations, run.y


@pytest.mark.parametrize("span", [0.3, 0.8, 0.95, 0.999])
def test_buckled_strip_solves_its_boundary_value_problem(span):
    """Integration from one clamp, with the closed form's thrust, arrives at the other clamp."""
    strip = elastica.buckled_strip(span)

    def right(s, y):
        return [y[1], -strip.thrust * np.sin(y[0]), np.cos(y[0]), np.sin(y[0])]

    stations, y = _integrate(right, [0.0, strip.end_curvature, 0.0, 0.0])
    assert np.allclose(y[:, -1], [0.0, strip.end_curvature, span, 0.0], atol=1e-10)
    assert np.allclose(y[0], strip.angle(stations), atol=1e-10)
    assert np.allclose(y[1], strip.curvature(stations), atol=1e-9)
    assert np.allclose(y[2:].T, strip.points(stations), atol=1e-11)
    assert strip.points(0.5)[1] == pytest.approx(strip.height, rel=1e-12)
    assert strip.angle(0.25) == pytest.approx(strip.steepest_angle, rel=1e-7)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    energy = 0.25 * weights @ strip.curvature((nodes + 1) / 2) ** 2
    assert energy == pytest.approx(strip.energy, rel=1e-11)


def test_buckled_strip_agrees_with_collocation():
    """From a crude start, and with the thrust unknown."""
    strip = elastica.buckled_strip(0.95)

    def right(s, y, p):
        return np.array([y[1], -p[0] * np.sin(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a, b, p):
        return np.array([a[0], a[2], a[3], b[0], b[2] - 0.95])

    s = np.linspace(0, 1, 41)
    turn = 2 * np.pi * s
    start = [0.5 * np.sin(turn), np.pi * np.cos(turn), 0.95 * s, 0.08 * (1 - np.cos(turn))]
    run = solve_bvp(right, ends, s, np.array(start), p=[39.0], tol=1e-7)
    assert run.success
    assert run.p[0] == pytest.approx(strip.thrust, rel=1e-7)
    assert np.allclose(run.y[0], strip.angle(run.x), atol=1e-7)
    assert np.allclose(run.y[2:].T, strip.points(run.x), atol=1e-8)


def test_work_of_the_clamps_is_the_energy():
    """d(energy) = -thrust d(span)."""
    step = 1e-4
    low, high = elastica.buckled_strip(0.9 - step), elastica.buckled_strip(0.9 + step)
    middle = elastica.buckled_strip(0.9)
    assert (low.energy - high.energy) / (2 * step) == pytest.approx(middle.thrust, rel=1e-7)


def test_shallow_strip_reaches_the_euler_load():
    gap = np.array([1e-3, 1e-4, 1e-5, 1e-8, 1e-12])
    excess = np.array([elastica.buckled_strip(1 - g).thrust / (4 * np.pi**2) - 1 for g in gap])
    # K(k)^2 = (pi/2)^2 (1 + k^2/2 + ...), span = 1 - k^2 + ...
    assert np.allclose(excess[:3], gap[:3] / 2, rtol=2e-3)
    assert np.all(np.abs(excess[3:] - gap[3:] / 2) < 1e-14)


def test_eigenvalues_of_the_buckled_strip_tend_to_the_column():
    second = elastica.clamped_column_loads(2)[1]
    errors = []
    for gap in (0.02, 0.01):
        even, odd = elastica.lowest_eigenvalues(1 - gap)
        errors.append([even - (second - 4 * np.pi**2), odd - 12 * np.pi**2])
    errors = np.array(errors)
    assert np.all(np.abs(errors[1]) < 1.5)
    assert np.allclose(errors[0] / errors[1], 2.0, rtol=0.05)  # linear in the gap


def test_clamped_columns_by_their_own_determinant():
    for load in elastica.clamped_column_loads(5):
        q = np.sqrt(load)
        assert abs(2 - 2 * np.cos(q) - q * np.sin(q)) < 1e-10
    assert elastica.clamped_column_loads(3)[2] == pytest.approx(16 * np.pi**2)
    assert np.all(np.diff(elastica.clamped_column_loads(6)) > 0)


def _cantilever(force, rod):
    """Integration from the clamp, with the closed form's moment, ends without moment."""

    def right(s, y):
        return [y[1], force[0] * np.sin(y[0]) - force[1] * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

    _, y = _integrate(right, [0.0, rod.clamp_moment, 0.0, 0.0])
    assert np.allclose(y[:, -1], [rod.angle, 0.0, rod.x, rod.y], atol=2e-10 * (1 + rod.load))
    # energy: half the integral of the squared curvature, by Gauss quadrature
    nodes, weights = np.polynomial.legendre.leggauss(60)
    run = solve_ivp(
        right,
        (0, 1),
        [0.0, rod.clamp_moment, 0.0, 0.0],
        "DOP853",
        t_eval=(nodes + 1) / 2,
        rtol=1e-13,
        atol=1e-14,
    )
    assert 0.25 * weights @ run.y[1] ** 2 == pytest.approx(rod.energy, rel=1e-9)


@pytest.mark.parametrize("load", [0.1, 1.0, 5.0, 20.0])
def test_transverse_cantilever_solves_its_boundary_value_problem(load):
    rod = elastica.transverse_cantilever(load)
    _cantilever((0.0, load), rod)


@pytest.mark.parametrize("load", [2.5, 4.0, 10.0])
def test_compressed_cantilever_solves_its_boundary_value_problem(load):
    rod = elastica.compressed_cantilever(load)
    _cantilever((-load, 0.0), rod)


def test_small_transverse_load_is_the_linear_beam():
    rod = elastica.transverse_cantilever(1e-4)
    assert rod.y == pytest.approx(1e-4 / 3, rel=1e-7)
    assert rod.angle == pytest.approx(1e-4 / 2, rel=1e-7)


@pytest.mark.parametrize("span", [0.0, 1.0, 1.2, -0.1, np.nan])
def test_span_out_of_range(span):
    with pytest.raises(InvalidInput, match="span"):
        elastica.buckled_strip(span)


def test_column_below_its_load():
    with pytest.raises(InvalidInput, match="Euler load"):
        elastica.compressed_cantilever(2.4)
    with pytest.raises(InvalidInput, match="load"):
        elastica.transverse_cantilever(0.0)
    with pytest.raises(InvalidInput, match="count"):
        elastica.clamped_column_loads(0)
