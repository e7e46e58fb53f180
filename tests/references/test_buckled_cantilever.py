"""Buckled cantilevers: collocation against shooting, closed forms, and mechanics."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lissome.errors import InvalidInput
from lissome.references import buckled_cantilever, elastica


def _fall(tip_angle):
    """Integrate theta'' + sigma sin(theta) = 0 from the free end until theta vanishes.

    Returns load, x, y of the tip and moment at the clamp: the equation has no parameter, so that
    the distance travelled is the cube root of the load.
    """

    def right(s, y):
        return [y[1], -s * np.sin(y[0]), np.cos(y[0]), np.sin(y[0])]

    def level(s, y):
        return y[0]

    level.terminal, level.direction = True, -1
    run = solve_ivp(
        right, (0, 50), [tip_angle, 0, 0, 0], "DOP853", rtol=2.5e-14, atol=1e-15, events=level
    )
    length, end = run.t_events[0][0], run.y_events[0][0]
    return length**3, end[2] / length, end[3] / length, -end[1] * length


@pytest.mark.parametrize("load", [7.84, 8.0, 9.0, 12.0, 20.0, 40.0])
def test_heavy_cantilever_by_shooting_from_the_free_end(load):
    column = buckled_cantilever.heavy_cantilever(load)
    found = _fall(column.tip_angle)
    assert found[0] == pytest.approx(load, rel=1e-10)
    assert np.allclose(found[1:3], [column.x, column.y], atol=1e-10)
    assert found[3] == pytest.approx(column.clamp_moment, rel=1e-10)


@pytest.mark.parametrize("load", [7.84, 15.0, 100.0, 400.0])
def test_heavy_cantilever_in_balance(load):
    """The moment at the clamp is the load times the lever of the center of mass."""
    column = buckled_cantilever.heavy_cantilever(load)
    t, w = np.polynomial.legendre.leggauss(200)
    s, w = 0.5 * (t + 1), 0.5 * w
    points = column.points(s)
    assert load * w @ points[:, 1] == pytest.approx(column.clamp_moment, rel=1e-9)
    assert np.allclose(column.points(1.0), [column.x, column.y], atol=1e-12)
    assert column.angle(0.0) == pytest.approx(0.0, abs=1e-12)
    assert column.curvature(1.0) == pytest.approx(0.0, abs=1e-8 * column.clamp_moment)
    assert column.potential - column.bending_energy == pytest.approx(
        load * w @ points[:, 0], rel=1e-9, abs=1e-9
    )
    assert 0.5 * w @ column.curvature(s) ** 2 == pytest.approx(column.bending_energy, rel=1e-11)


def test_potential_changes_with_the_load_by_the_conjugate_displacement():
    """d(potential)/d(load) is the integral of x, and the buckled shape lies below the straight."""
    load, step = 12.0, 1e-3
    low, middle, high = (
        buckled_cantilever.heavy_cantilever(q) for q in (load - step, load, load + step)
    )
    slope = (high.potential - low.potential) / (2 * step)
    lever = (middle.potential - middle.bending_energy) / load
    assert slope == pytest.approx(lever, rel=1e-6)
    assert middle.potential < load / 2  # the straight rod's


def test_onset_of_the_heavy_column():
    """The energy to fourth order gives (tip angle)^2 = 6 (load/critical - 1) I2/I4 at the onset.

    I_n is the integral of (1 - s) phi^n for the buckling mode phi, an Airy-type Bessel function.
    """
    critical = buckled_cantilever.distributed_loads()[0]
    t, w = np.polynomial.legendre.leggauss(80)
    sigma = 0.5 * (1 - t)
    # J_{-1/3} sqrt(sigma) as the even power series in sigma^{3/2}, scaled to 1 at the free end
    mode, term = np.ones_like(sigma), np.ones_like(sigma)
    for k in range(1, 40):
        term = -term * critical * sigma**3 / ((3 * k) * (3 * k - 1))
        mode = mode + term
    second, fourth = (0.5 * w @ (sigma * mode**n) for n in (2, 4))
    excess = np.array([1e-3, 1e-5])
    angles = np.array(
        [buckled_cantilever.heavy_cantilever(critical * (1 + e)).tip_angle for e in excess]
    )
    error = angles**2 / excess - 6 * second / fourth
    assert abs(error[1]) < 2e-4
    assert error[0] / error[1] == pytest.approx(100, rel=0.1)  # linear in the excess


def test_critical_loads_by_spectra():
    """Generalized eigenvalues in polynomials that respect the clamp, against the closed forms."""
    t, w = np.polynomial.legendre.leggauss(60)
    s, w = 0.5 * (t + 1), 0.5 * w
    power = np.polynomial.chebyshev.chebvander(t, 30)
    base = s[:, None] * power
    slope = power + s[:, None] * np.stack(
        [
            2 * np.polynomial.chebyshev.chebval(t, np.polynomial.chebyshev.chebder(np.eye(31)[n]))
            for n in range(31)
        ],
        axis=1,
    )
    stiffness = slope.T @ (w[:, None] * slope)
    for lever, loads in (
        (np.ones_like(s), buckled_cantilever.end_loads(3)),
        (1 - s, buckled_cantilever.distributed_loads(3)),
    ):
        mass = base.T @ ((w * lever)[:, None] * base)
        root = np.linalg.cholesky(stiffness)
        inverse = np.linalg.solve(root, np.linalg.solve(root, mass).T)
        found = 1 / np.sort(np.linalg.eigvalsh(inverse))[::-1][:3]
        assert np.allclose(found, loads, rtol=1e-10)


@pytest.mark.parametrize("load", [2.468, 2.5, 4.0, 8.0, 20.0])
def test_end_load_tips_by_integration(load):
    """The closed form's tip, reached from the free end: theta'' = -P sin(theta) has no free length."""
    rod = elastica.compressed_cantilever(load)

    def right(s, y):
        return [y[1], -load * np.sin(y[0]), np.cos(y[0]), np.sin(y[0])]

    run = solve_ivp(right, (0, 1), [rod.angle, 0, 0, 0], "DOP853", rtol=2.5e-14, atol=1e-15)
    assert run.y[0, -1] == pytest.approx(0.0, abs=1e-9)
    x, y = buckled_cantilever.end_load_tips(load)
    assert np.allclose(run.y[2:, -1], [x, y], atol=1e-9)


def test_tips_are_straight_below_and_continuous_at_the_critical_load():
    for tips, loads in (
        (buckled_cantilever.end_load_tips, buckled_cantilever.end_loads()),
        (buckled_cantilever.distributed_load_tips, buckled_cantilever.distributed_loads()),
    ):
        critical = loads[0]
        below, above = tips([0.5 * critical, critical * (1 + 1e-8)])
        assert np.array_equal(below, [1.0, 0.0])
        assert np.allclose(above, [1.0, 0.0], atol=3e-4)
        assert above[1] > 0
        many = tips(critical * np.array([[1.1, 1.5], [2.0, 4.0]]))
        assert many.shape == (2, 2, 2)
        assert np.all(np.diff(many[..., 0].ravel()) < 0)


def test_bad_loads():
    for load in (7.8, 600.0, np.nan):
        with pytest.raises(InvalidInput, match="load"):
            buckled_cantilever.heavy_cantilever(load)
    with pytest.raises(InvalidInput, match="count"):
        buckled_cantilever.end_loads(0)
    with pytest.raises(InvalidInput, match="count"):
        buckled_cantilever.distributed_loads(1.5)
    with pytest.raises(InvalidInput, match="loads"):
        buckled_cantilever.end_load_tips([np.inf])
