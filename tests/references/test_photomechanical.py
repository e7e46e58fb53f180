"""Clamped strip under light: closed forms, exact symmetries, invariants, two resolutions."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_bvp, solve_ivp

from lissome.errors import InvalidInput
from lissome.references import elastica, photomechanical

QUARTER = np.pi / 4


# -- Beer's law ------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("h", "d"), [(15, 0.56), (15, 1.5), (50, 1.5), (1, 1), (1, 15), (1, 25), (1, 1e4)]
)
def test_absorption_moment_by_quadrature(h, d):
    # z e^{z/d} over a symmetric interval is z sinh(z/d): no cancellation
    direct = quad(lambda z: 2 * z * np.sinh(z / d) * np.exp(-h / (2 * d)), 0, h / 2, epsabs=0)[0]
    assert photomechanical.absorption_moment(h, d) == pytest.approx(direct, rel=1e-9)


def test_illumination_scales_with_light_and_length():
    base = photomechanical.dimensionless_illumination(-5.4e-5, 100, 15e-6, 0.56e-6, 15e-3)
    assert base > 0  # contraction on the lit face
    double = photomechanical.dimensionless_illumination(-5.4e-5, 200, 15e-6, 0.56e-6, 30e-3)
    assert double == pytest.approx(4 * base, rel=1e-14)
    scaled = photomechanical.dimensionless_illumination(-5.4e-5, 100, 30e-6, 1.12e-6, 30e-3)
    assert scaled == pytest.approx(base, rel=1e-13)  # geometry enters by ratios only


# -- mechanics -------------------------------------------------------------------------------------
@pytest.mark.parametrize("span", [0.5, 0.95])
def test_unlit_strip_is_the_elastica(span):
    modes = 60
    strip = photomechanical._strip(1.0, 0.0, span, modes, None)
    a = photomechanical._buckled(strip, True)
    a, multipliers = strip.equilibrium(a, np.zeros(modes))
    exact = elastica.buckled_strip(span)
    s = np.linspace(0, 1, 21)
    assert np.allclose(photomechanical._integrated(s, modes) @ a, exact.angle(s), atol=1e-11)
    assert np.allclose(photomechanical._legendre(s, modes) @ a, exact.curvature(s), atol=1e-8)
    assert 0.5 * a @ a == pytest.approx(exact.energy, rel=1e-12)
    assert abs(multipliers[0]) == pytest.approx(exact.thrust, rel=1e-11)
    assert strip.height(a) > 0
    # eigenvalues by shooting, in the same metric
    assert strip.eigen(a, multipliers)[0][:2] == pytest.approx(
        sorted(elastica.lowest_eigenvalues(span)), rel=1e-9
    )


def test_mean_of_the_natural_curvature_drops_out():
    """The modes leave out the constant, and a uniform curvature only shifts the energy."""
    strip = photomechanical._strip(5.0, 0.0, 0.99, 20, None)
    flat = np.zeros(20)
    assert np.allclose(strip.lit(flat), 0.0, atol=1e-12)


def test_lit_strip_agrees_with_collocation():
    """Equilibrium under the natural curvature of a moment after the start."""
    response, span = 10.0, 0.95
    history = photomechanical.strip_history(response, QUARTER, span, until=0.5, modes=32)
    k = history.curvatures[-1]

    def right(s, y, p):
        slope = (
            photomechanical._legendre(np.atleast_1d(s), 32) @ k + p[0] - p[1] * y[1] + p[2] * y[2]
        )
        return np.array([slope, np.cos(y[0]), np.sin(y[0])])

    def ends(a, b, p):
        return np.array([a[0], a[1], a[2], b[0], b[1] - span, b[2]])

    s = np.linspace(0, 1, 161)
    theta = history.angle(s)[-1]
    step = s[1] - s[0]
    x = np.concatenate([[0], np.cumsum((np.cos(theta[1:]) + np.cos(theta[:-1])) * step / 2)])
    y = np.concatenate([[0], np.cumsum((np.sin(theta[1:]) + np.sin(theta[:-1])) * step / 2)])
    run = solve_bvp(
        right, ends, s, np.stack([theta, x, y]), p=[0.0, 0.0, -history.multipliers[-1][0]], tol=1e-7
    )
    assert run.success
    fine = run.x
    assert np.allclose(run.y[0], history.angle(fine)[-1], atol=2e-7)


def test_descriptors_by_direct_integration():
    history = photomechanical.strip_history(10.0, QUARTER, 0.95, until=0.5, modes=32)
    gamma, beta = history.descriptors()
    s = np.linspace(0, 1, 4001)
    theta = history.angle(s)[-1]
    step = s[1]
    height = np.concatenate([[0], np.cumsum((np.sin(theta[1:]) + np.sin(theta[:-1])) * step / 2)])
    sine = np.sin(2 * np.pi * s)
    assert gamma[-1] == pytest.approx(step * (sine @ height), abs=1e-7)
    assert beta[-1] == pytest.approx(step * (sine @ history.natural_curvature(s)[-1]), abs=1e-5)


def test_early_history_is_the_light_of_the_start():
    """For short times the natural curvature is T Lambda f of the unlit shape."""
    time = 1e-4
    history = photomechanical.strip_history(10.0, QUARTER, 0.95, until=time, modes=32)
    strip = photomechanical._strip(10.0, QUARTER, 0.95, 32, None)
    a = photomechanical._buckled(strip, True)
    assert np.allclose(history.curvatures[-1], time * 10.0 * strip.lit(a), atol=50 * time**2)


def test_integration_along_the_path_is_integration_in_time():
    """The natural curvature as an ordinary differential equation with an inner Newton solve."""
    strip = photomechanical._strip(10.0, QUARTER, 0.95, 24, None)
    shape = [photomechanical._buckled(strip, True)]

    def right(_, k):
        shape[0], _ = strip.equilibrium(shape[0], k)
        return strip.rate(shape[0], k)

    run = solve_ivp(right, (0, 1.0), np.zeros(24), "RK45", rtol=1e-7, atol=1e-9)
    history = photomechanical.strip_history(10.0, QUARTER, 0.95, until=1.0, modes=24)
    assert np.allclose(run.y[:, -1], history.curvatures[-1], atol=1e-5)
    assert np.allclose(shape[0], history.shapes[-1], atol=1e-4)


# -- the cycle -------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def cycle():
    return photomechanical.strip_history(10.0, QUARTER, 0.95, until=4.2, modes=32)


def test_every_row_is_an_equilibrium_and_obeys_the_clamps(cycle):
    strip = photomechanical._strip(10.0, QUARTER, 0.95, 32, None)
    for a, k, multipliers in zip(cycle.shapes, cycle.curvatures, cycle.multipliers, strict=True):
        value, gradient = strip.constraints(a)
        assert np.max(np.abs(value)) < 1e-8
        assert np.max(np.abs(a - k + gradient @ multipliers)) < 1e-6


def test_two_resolutions_agree(cycle):
    """Modes and tolerance: the snap times of the standard case to eight digits."""
    other = photomechanical.strip_history(10.0, QUARTER, 0.95, until=2.6, modes=44, rtol=1e-10)
    times = [snap.time for snap in other.snaps]
    assert [snap.time for snap in cycle.snaps][: len(times)] == pytest.approx(times, rel=1e-8)
    assert len(times) == 2


def test_strip_alternates_and_snaps_at_folds(cycle):
    assert [snap.direction for snap in cycle.snaps] == [-1, 1, -1]
    assert {snap.kind for snap in cycle.snaps} == {"fold"}
    for snap in cycle.snaps:
        rows = np.flatnonzero(cycle.times == snap.time)
        assert abs(cycle.eigenvalues[rows[0]]) < 1e-6  # lost
        assert cycle.eigenvalues[rows[1]] > 10.0  # and regained
        assert np.array_equal(cycle.curvatures[rows[0]], cycle.curvatures[rows[1]])  # frozen


def test_eigenvalue_vanishes_as_a_square_root(cycle):
    """lambda^2 is linear in the time left, at a fold."""
    time = cycle.snaps[0].time
    left = np.array([4e-4, 1e-4, 2.5e-5])
    values = [
        photomechanical.strip_history(10.0, QUARTER, 0.95, until=time - gap, modes=32).eigenvalues[
            -1
        ]
        for gap in left
    ]
    slopes = np.diff(np.log(values)) / np.diff(np.log(left))
    assert slopes[1] == pytest.approx(0.5, abs=0.01)
    assert abs(slopes[1] - 0.5) < abs(slopes[0] - 0.5)


@pytest.mark.parametrize("up", [True, False])
def test_reversing_the_response_turns_the_strip_by_half_a_turn(up):
    """(Lambda, S) -> (-Lambda, 1 - S): theta(1 - S), -K0(1 - S), at the same angle of the light."""
    forward = photomechanical.strip_history(10.0, QUARTER, 0.95, until=2.6, up=up, modes=24)
    back = photomechanical.strip_history(-10.0, QUARTER, 0.95, until=2.6, up=not up, modes=24)
    assert [s.time for s in back.snaps] == pytest.approx([s.time for s in forward.snaps], rel=1e-7)
    assert [s.direction for s in back.snaps] == [-s.direction for s in forward.snaps]
    s = np.linspace(0, 1, 9)
    assert np.allclose(back.angle(s)[-1], forward.angle(1 - s)[-1], atol=1e-6)
    assert np.allclose(
        back.natural_curvature(s)[-1], -forward.natural_curvature(1 - s)[-1], atol=1e-6
    )
    assert np.allclose(
        [d[-1] for d in back.descriptors()], [d[-1] for d in forward.descriptors()], atol=1e-7
    )


def test_mirrored_light_mirrors_the_strip():
    right = photomechanical.strip_history(10.0, QUARTER, 0.95, until=1.2, modes=24)
    left = photomechanical.strip_history(10.0, -QUARTER, 0.95, until=1.2, modes=24)
    assert left.snaps[0].time == pytest.approx(right.snaps[0].time, rel=1e-8)
    s = np.linspace(0, 1, 9)
    assert np.allclose(left.angle(s)[-1], -right.angle(1 - s)[-1], atol=1e-7)


def test_shallow_strips_share_their_history():
    """As the span tends to 1 the angle scales out, and Lambda sin(theta_I) alone matters."""
    times = []
    for gap in (1e-3, 1e-5):
        rows = [
            photomechanical.strip_history(8.0 / np.sin(angle), angle, 1 - gap, until=1.6, modes=24)
            .snaps[0]
            .time
            for angle in (0.5, 1.0)
        ]
        times.append(rows)
    times = np.array(times)
    spread = np.abs(times[:, 0] - times[:, 1])
    assert spread[1] < 0.12 * spread[0]  # vanishes like the amplitude, sqrt(gap)
    assert spread[1] < 5e-3


def test_settled_period_does_not_depend_on_the_start():
    up = photomechanical.strip_period(10.0, QUARTER, 0.95, modes=20, rtol=1e-7, tolerance=1e-6)
    down = photomechanical.strip_period(
        10.0, QUARTER, 0.95, modes=20, rtol=1e-7, tolerance=1e-6, up=False
    )
    assert up == pytest.approx(down, rel=1e-5)
    assert up[1] > up[0] / 2  # the halves of the cycle differ


def test_rest_outside_the_window():
    assert photomechanical.strip_period(3.0, QUARTER, 0.95, modes=24) is None


# -- steady states ---------------------------------------------------------------------------------
@pytest.mark.parametrize("spot", [None, (0.45, 0.1)])
def test_slope_of_the_light_by_differences(spot):
    strip = photomechanical._strip(3.0, 1.25, 0.95, 20, spot)
    a = photomechanical._buckled(strip, True)
    slope = strip.lit_slope(a)
    direction = np.random.default_rng(1).normal(size=20) / np.arange(1, 21) ** 2
    step = 1e-5
    difference = (strip.lit(a + step * direction) - strip.lit(a - step * direction)) / (2 * step)
    assert np.allclose(slope @ direction, difference, atol=2e-7)


def test_rest_ends_where_the_steady_state_does():
    """Slow light: just below the limit the strip rests at the steady state, above it cannot."""
    limit = photomechanical.steady_limit(QUARTER, 0.95, modes=24)
    assert limit.kind == "snap"
    assert abs(limit.eigenvalue) < 1e-6
    assert limit.rates[0].real < 0
    below = photomechanical.strip_history(5.5, QUARTER, 0.95, until=60.0, modes=24)
    assert below.steady
    assert not below.snaps
    strip = photomechanical._strip(5.5, QUARTER, 0.95, 24, None)
    a = below.shapes[-1]
    assert np.allclose(below.curvatures[-1], 5.5 * strip.lit(a), atol=1e-8)


def test_limits_of_both_signs_mirror_each_other():
    up = photomechanical.steady_limit(1.2, 0.95, modes=24)
    turned = photomechanical.steady_limit(1.2, 0.95, modes=24, sign=-1, up=False)
    assert turned.response == pytest.approx(up.response, rel=1e-7)


# -- Gaussian spot ---------------------------------------------------------------------------------
def test_offset_snaps_are_mirrored():
    left = photomechanical.snap_time(30.0, 0.475 - 0.03, 0.1, 0.95, modes=24)
    right = photomechanical.snap_time(30.0, 0.475 + 0.03, 0.1, 0.95, modes=24)
    assert left == pytest.approx(right, rel=1e-7)


def test_bright_spot_snaps_in_inverse_proportion():
    """Lambda T tends to a constant, with a correction of first order in the time."""
    products = np.array(
        [r * photomechanical.snap_time(r, 0.45, 0.1, 0.95, modes=24) for r in (200.0, 400.0, 800.0)]
    )
    steps = np.diff(products)
    assert steps[0] / steps[1] == pytest.approx(2.0, rel=0.05)


def test_dim_spot_does_not_snap():
    assert photomechanical.snap_time(3.0, 0.45, 0.1, 0.95, modes=24) == np.inf


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("span", lambda: photomechanical.strip_period(1.0, 0.5, 1.2)),
        ("response", lambda: photomechanical.strip_period(np.nan, 0.5, 0.9)),
        ("modes", lambda: photomechanical.strip_period(1.0, 0.5, 0.9, modes=3)),
        ("until", lambda: photomechanical.strip_history(1.0, 0.5, 0.9, until=0.0)),
        ("width", lambda: photomechanical.snap_time(1.0, 0.5, 0.0, 0.9)),
        ("spot", lambda: photomechanical.strip_history(1.0, 0.5, 0.9, until=1.0, spot=(0.1,))),
        ("sign", lambda: photomechanical.steady_limit(0.5, 0.9, sign=0)),
        ("depth", lambda: photomechanical.absorption_moment(1.0, 0.0)),
    ],
)
def test_bad_input_names_the_argument(name, call):
    with pytest.raises(InvalidInput, match=name):
        call()
