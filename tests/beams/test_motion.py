"""Strips under light: orders, symmetries, snaps and limit cycles against an independent method."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lissome as ls
from lissome import beams
from lissome.beams import ClampedStrip, GaussianSpot, ParallelLight, UserLight
from lissome.beams._motion import period_of
from lissome.errors import InvalidInput, NotConverged
from lissome.references import photomechanical

OBLIQUE = ParallelLight(10.0, angle=math.pi / 4)


def snap_times(strip, light, until, **options):
    history = strip.under(light).run(until=until, record_every=None, **options)
    return np.array([snap.time for snap in history.snaps])


# -- time stepping ----------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["exponential-1", "exponential-2"])
def test_exponential_schemes_are_exact_for_constant_flux(scheme):
    # (A flux of 3 sin^2 loads the strip without making it lose its stability.)
    strip = ClampedStrip(span=0.9, segments=40, natural_curvature=lambda s: np.sin(9 * s))
    light = UserLight(lambda x, y, theta, s, t: 3 * np.sin(2 * s) ** 2)
    history = strip.under(light).run(until=1.5, step=0.5, scheme=scheme)
    s = strip.spring_arclength
    exact = np.sin(9 * s) + 3 * np.sin(2 * s) ** 2 * -math.expm1(-1.5)
    np.testing.assert_allclose(history.curvature[-1], exact, rtol=0, atol=1e-13)


def test_second_order_scheme_is_exact_for_linear_flux():
    strip = ClampedStrip(span=0.9, segments=40)
    light = UserLight(lambda x, y, theta, s, t: t * s)
    history = strip.under(light).run(until=1.0, step=0.25)
    exact = strip.spring_arclength * (1.0 - 1.0 + math.exp(-1.0))  # t - 1 + exp(-t)
    np.testing.assert_allclose(history.curvature[-1], exact, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("scheme", "order"), [("exponential-2", 2), ("exponential-1", 1), ("explicit-euler", 1)]
)
def test_order_in_time_before_a_snap(scheme, order):
    strip = ClampedStrip(span=0.95, segments=40)
    shapes = [
        strip.under(OBLIQUE).run(until=0.6, step=0.6 / n, scheme=scheme, record_every=None)
        for n in (16, 32, 64, 128)
    ]
    changes = [np.abs(a.angles[-1] - b.angles[-1]).max() for a, b in itertools.pairwise(shapes)]
    np.testing.assert_allclose(np.log2(np.divide(changes[:-1], changes[1:])), order, atol=0.15)


def test_order_of_the_snap_times():
    strip = ClampedStrip(span=0.95, segments=40)
    times = [snap_times(strip, OBLIQUE, 2.6, step=0.02 / 2**k)[:2] for k in range(5)]
    changes = np.abs(np.diff(times, axis=0))
    assert np.all(changes[2:] < 2e-6)
    orders = np.log2(changes[1:-1] / changes[2:])
    np.testing.assert_allclose(orders, 2, atol=0.4)


def test_report_times_are_hit_exactly_and_do_not_disturb():
    strip = ClampedStrip(span=0.95, segments=40)
    wanted = [0.25, 1 / 3, 1.7, 2.0]
    history = strip.under(OBLIQUE).run(until=2.5, record_every=None, report_at=wanted)
    for time in wanted:
        assert time in history.times
    plain = snap_times(strip, OBLIQUE, 2.5)
    np.testing.assert_allclose([s.time for s in history.snaps], plain, rtol=0, atol=2e-6)
    assert history.times[-1] == 2.5
    assert np.all(np.diff(history.times) >= 0)


def test_going_on_from_a_history():
    strip = ClampedStrip(span=0.95, segments=40)
    whole = strip.under(OBLIQUE).run(until=2.0, record_every=None)
    first = strip.under(OBLIQUE).run(until=0.8, record_every=None)
    second = strip.under(OBLIQUE).run(until=2.0, record_every=None, initial=first)
    np.testing.assert_allclose(second.angles[-1], whole.angles[-1], rtol=0, atol=1e-5)
    assert second.times[0] == 0.8


def test_every_row_is_a_stable_balanced_shape():
    strip = ClampedStrip(span=0.95, segments=40)
    history = strip.under(OBLIQUE).run(until=4.0, step=0.02, record_every=3)
    assert np.all(history.smallest_eigenvalue > 0)
    for row in (0, len(history) // 2, len(history) - 1):
        frozen = strip.with_curvature(history.curvature[row])
        value = frozen.evaluate(history.state(row), history.forces[row], 2)
        assert np.abs(value.gradient).max() < 1e-11
        assert np.abs(value.constraints).max() < 1e-11
        assert value.kkt.factorize().inertia == (strip.size, 2, 0)
        assert abs(value.energy - history.energy[row]) < 1e-10


# -- snaps and cycles -------------------------------------------------------------------------


def test_snap_times_and_period_against_the_spectral_reference():
    """Five digits: two meshes extrapolated, against Legendre modes and DOP853."""
    reference = photomechanical.strip_history(10.0, math.pi / 4, 0.95, until=4.2)
    exact = np.array([snap.time for snap in reference.snaps])
    coarse, fine = (
        snap_times(ClampedStrip(span=0.95, segments=n), OBLIQUE, 4.2, step=0.0025)
        for n in (150, 300)
    )
    extrapolated = fine + (fine - coarse) / 3
    assert exact.size == 3
    np.testing.assert_allclose(extrapolated, exact, rtol=3e-6)
    period, _ = photomechanical.strip_period(10.0, math.pi / 4, 0.95)
    found = [
        beams.flapping(ClampedStrip(span=0.95, segments=n), OBLIQUE, step=0.0025).period
        for n in (150, 300)
    ]
    assert abs((found[1] + (found[1] - found[0]) / 3) / period - 1) < 5e-6


def test_snap_under_a_spot_against_the_spectral_reference():
    exact = photomechanical.snap_time(10.0, 0.45, 0.1, 0.95)
    coarse, fine = (
        beams.first_snap(
            ClampedStrip(span=0.95, segments=n), GaussianSpot(10.0, 0.45, 0.1), step=0.0025
        ).time
        for n in (150, 300)
    )
    assert abs((fine + (fine - coarse) / 3) / exact - 1) < 5e-6


@pytest.mark.parametrize("compiled", [True, False])
def test_the_general_evolution_finds_the_same_snaps(compiled):
    """`lissome.evolve` locates snaps and descends by itself; its time steps are fixed."""
    strip = ClampedStrip(span=0.95, segments=30)
    lit = beams.LitStrip(strip, OBLIQUE)
    start = ls.equilibrate(strip)
    errors = []
    for step in (0.02, 0.005):
        history = ls.evolve(lit, strip.rest_curvature, start, 2.6, step, compiled=compiled)
        exact = snap_times(strip, OBLIQUE, 2.6, step=0.001)
        times = np.array([event.time for event in history.events])
        assert times.size == exact.size == 2
        errors.append(np.abs(times - exact).max())
    assert errors[-1] < 1e-5
    assert errors[0] / errors[1] > 5  # order 3/2 at least
    run = strip.under(OBLIQUE).run(until=2.6, step=0.001, record_every=None)
    np.testing.assert_allclose(history.equilibrium.angles, run.angles[-1], rtol=0, atol=1e-3)
    np.testing.assert_allclose(
        [e.energy_released for e in history.events],
        [s.energy_released for s in run.snaps],
        rtol=1e-3,
    )


def test_same_cycle_from_either_side():
    strip = ClampedStrip(span=0.95, segments=40)
    up = beams.flapping(strip, OBLIQUE)
    down = beams.flapping(ClampedStrip(span=0.95, segments=40, bump="down"), OBLIQUE)
    assert up.flaps
    assert down.flaps
    assert up.snaps_per_cycle == down.snaps_per_cycle == 2
    assert abs(up.period - down.period) <= 1e-5 * up.period


def test_snaps_are_folds():
    """Before a snap the eigenvalue vanishes like the square root of time; energy is released."""
    strip = ClampedStrip(span=0.95, segments=60)
    run = strip.under(OBLIQUE)
    snap = run.run(until=1.5, stop_after=1, record_every=None).snaps[0]
    before = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    history = run.run(until=snap.time, record_every=None, report_at=snap.time - before)
    rows = [int(np.argmin(np.abs(history.times - t))) for t in snap.time - before]
    slopes = np.diff(np.log(history.smallest_eigenvalue[rows])) / np.diff(np.log(before))
    np.testing.assert_allclose(slopes[1:], 0.5, atol=0.02)
    assert snap.kind == "snap"
    assert snap.energy_released > 0.1
    after = strip.with_curvature(snap.curvature)
    stable = run.run(until=snap.time + 0.01, record_every=1).smallest_eigenvalue
    assert stable[-1] > 1
    assert after.positions(snap.after)[:, 1].mean() * after.positions(snap.before)[:, 1].mean() < 0


def test_symmetric_strip_loses_stability_linearly():
    """A centered spot keeps the symmetry until it breaks: the eigenvalue crosses zero linearly.

    (The light amplifies asymmetry at a rate proportional to the reciprocal of the eigenvalue, hence by
    a power of the time left: rounding errors show in the very last moment.)
    """
    strip = ClampedStrip(span=0.95, segments=60)
    run = strip.under(GaussianSpot(10.0, 0.475, 0.2))
    snap = run.run(until=3.0, stop_after=1, record_every=None).snaps[0]
    before = np.array([1e-1, 1e-2, 1e-3])
    report = run.run(until=snap.time - 5e-4, record_every=None, report_at=snap.time - before)
    rows = [int(np.argmin(np.abs(report.times - t))) for t in snap.time - before]
    assert np.abs(report.angles[rows] + report.angles[rows][:, ::-1]).max() < 1e-7  # odd
    slopes = np.diff(np.log(report.smallest_eigenvalue[rows])) / np.diff(np.log(before))
    np.testing.assert_allclose(slopes, 1.0, atol=0.05)
    # The mode breaks the symmetry: it is even in the angle.
    assert np.abs(snap.mode - snap.mode[::-1]).max() < 1e-2 * np.abs(snap.mode).max()


def test_no_false_snaps_at_rest():
    """Vertical light leaves the strip at rest: nothing is lost, even at tiny rates of change."""
    strip = ClampedStrip(span=0.95, segments=100)
    history = strip.under(ParallelLight(10.0)).run(until=40.0, record_every=None)
    assert history.snaps == ()
    assert history.stationary
    assert history.find_period() is None
    with pytest.raises(NotConverged, match="no period"):
        _ = history.period


def test_rest_is_a_fixed_point_of_the_light():
    strip = ClampedStrip(span=0.95, segments=50)
    history = strip.under(ParallelLight(5.0, angle=0.1)).run(until=40.0, record_every=None)
    np.testing.assert_allclose(history.curvature[-1], history.flux_target(-1), rtol=0, atol=1e-9)


# -- symmetries -------------------------------------------------------------------------------


def test_left_and_right():
    """Reflection in the vertical: S -> 1 - S, theta -> -theta, angle -> -angle."""
    strip = ClampedStrip(span=0.95, segments=40)
    one = strip.under(OBLIQUE).run(until=3.0, record_every=None)
    other = strip.under(ParallelLight(10.0, angle=-math.pi / 4)).run(until=3.0, record_every=None)
    np.testing.assert_allclose(other.angles[-1], -one.angles[-1][::-1], rtol=0, atol=1e-8)


def test_light_from_below():
    """Reflection in the horizontal: theta -> -theta, K -> -K, light from the other side."""
    one = ClampedStrip(span=0.95, segments=40).under(OBLIQUE)
    other = ClampedStrip(span=0.95, segments=40, bump="down").under(
        ParallelLight(10.0, angle=math.pi / 4, side="lower")
    )
    a, b = (motion.run(until=3.0, record_every=None) for motion in (one, other))
    np.testing.assert_allclose(b.angles[-1], -a.angles[-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(b.curvature[-1], -a.curvature[-1], rtol=0, atol=1e-8)


def test_sign_of_the_response():
    """Rotation by half a turn: S -> 1 - S, K -> -K. An expanding face moves the other way."""
    one = ClampedStrip(span=0.95, segments=40).under(OBLIQUE)
    other = ClampedStrip(span=0.95, segments=40, response=-1.0, bump="down").under(OBLIQUE)
    a, b = (motion.run(until=3.0, record_every=None) for motion in (one, other))
    np.testing.assert_allclose(b.angles[-1], a.angles[-1][::-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(b.curvature[-1], -a.curvature[-1][::-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose([s.time for s in b.snaps], [s.time for s in a.snaps], atol=1e-8)


def test_only_response_times_intensity_matters():
    a = ClampedStrip(span=0.95, segments=40, response=2.0).under(ParallelLight(5.0, 0.8))
    b = ClampedStrip(span=0.95, segments=40, response=0.5).under(ParallelLight(20.0, 0.8))
    np.testing.assert_allclose(
        a.run(until=2.0).angles[-1], b.run(until=2.0).angles[-1], rtol=0, atol=1e-10
    )


# -- light ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "light",
    [
        ParallelLight(8.0, angle=0.9),
        ParallelLight(8.0, angle=0.9, side="lower"),
        GaussianSpot(9.0, center=0.4, width=0.2, angle=0.3),
    ],
)
def test_compiled_light_is_the_light_of_the_class(light):
    # The kernel averages the flux over a spring, a function sees its middle: they agree to O(h^2).
    differences = []
    for segments in (25, 200):
        strip = ClampedStrip(span=0.9, segments=segments)
        face = strip.face(light.side)
        user = UserLight(
            lambda x, y, theta, s, t, face=face: light.flux(x, y, theta, face), side=light.side
        )
        one, other = (
            strip.under(lamp).run(until=0.5, step=0.02, record_every=None) for lamp in (light, user)
        )
        differences.append(np.abs(one.angles[-1] - other.angles[-1]).max())
    assert differences[0] < 5e-3
    # (not monotone: the function sees the terminator jump from spring to spring)
    assert math.log2(differences[0] / differences[1]) / 3 > 1.4


def test_faces_turned_away_are_dark():
    flux = ParallelLight(2.0, angle=0.5).flux(0.0, 0.0, [0.5, 0.5 + np.pi / 2, 0.5 + 2.0])
    np.testing.assert_allclose(flux, [2.0, 0.0, 0.0], atol=1e-15)
    # (3.11): cos(theta - theta_I) where positive
    theta = np.linspace(-4, 4, 33)
    exact = np.maximum(np.cos(theta - 0.5), 0.0)
    np.testing.assert_allclose(ParallelLight(1.0, 0.5).flux(0, 0, theta), exact, atol=1e-15)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ParallelLight(-1.0), "intensity"),
        (lambda: ParallelLight(math.nan), "intensity"),
        (lambda: ParallelLight(1.0, angle=math.inf), "angle"),
        (lambda: ParallelLight(1.0, side="left"), "side"),
        (lambda: GaussianSpot(1.0, 0.5, 0.0), "width"),
        (lambda: GaussianSpot(1.0, math.nan, 0.1), "center"),
        (lambda: UserLight(3.0), "function"),
        (lambda: UserLight(abs, side="top"), "side"),
    ],
)
def test_bad_light_is_refused(make, name):
    with pytest.raises(InvalidInput, match=f"`{name}`"):
        make()


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, y, theta, s, t: x[:-1], "shape"),
        (lambda x, y, theta, s, t: 1.0, "shape"),
        (lambda x, y, theta, s, t: x * np.nan, "finite"),
        (lambda x, y, theta, s, t: np.where(t > 0.1, np.inf, 1.0) * np.ones_like(x), "finite"),
        (lambda x, y, theta, s, t: -np.ones_like(x), "negative"),
        (lambda x, y: x, "must take"),
        (lambda x, y, theta, s, t: "bright", "must take"),
    ],
)
def test_bad_user_light_is_refused(function, message):
    strip = ClampedStrip(span=0.9, segments=20)
    with pytest.raises(InvalidInput, match=message):
        strip.under(UserLight(function)).run(until=1.0, step=0.05)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"until": -1.0}, "until"),
        ({"until": math.nan}, "until"),
        ({"until": 1.0, "step": 0.0}, "step"),
        ({"until": 1.0, "scheme": "euler"}, "scheme"),
        ({"until": 1.0, "record_every": 0}, "record_every"),
        ({"until": 1.0, "report_at": [0.5, 0.2]}, "report_at"),
        ({"until": 1.0, "report_at": [2.0]}, "report_at"),
        ({"until": 1.0, "report_at": [[0.1]]}, "report_at"),
        ({"until": 1.0, "stop_after": 0}, "stop_after"),
        ({"until": 1.0, "initial": np.zeros(21)}, "initial"),
    ],
)
def test_bad_run_is_refused(options, name):
    strip = ClampedStrip(span=0.9, segments=20)
    with pytest.raises(InvalidInput, match=f"`{name}`"):
        strip.under(OBLIQUE).run(**options)


def test_bad_surveys_are_refused():
    strip = ClampedStrip(span=0.9, segments=20)
    with pytest.raises(InvalidInput, match="`light`"):
        beams.flapping(strip, 10.0)
    with pytest.raises(InvalidInput, match="`strip`"):
        beams.first_snap(beams.Ring(20), OBLIQUE)
    with pytest.raises(InvalidInput, match="`tolerance`"):
        beams.flapping(strip, OBLIQUE, tolerance=-1.0)


def test_an_impossible_bump_is_said_to_be_so():
    """A strip that is made as a deep trough has no stable shape that is buckled up."""
    strip = ClampedStrip(span=0.99, segments=40, natural_curvature=lambda s: -60 * np.cos(6.28 * s))
    motions = [
        ClampedStrip(
            span=0.99, segments=40, natural_curvature=strip.natural_curvature, bump=bump
        ).under(OBLIQUE)
        for bump in ("up", "down")
    ]
    refused = []
    for motion in motions:
        try:
            motion.run(until=0.01)
        except NotConverged as error:
            refused.append(str(error))
    assert len(refused) == 1
    assert "`bump`" in refused[0]


# -- survey -----------------------------------------------------------------------------------


def test_flapping_agrees_with_the_history():
    strip = ClampedStrip(span=0.95, segments=60)
    history = strip.under(OBLIQUE).run(until=20.0, step=0.01, record_every=None)
    found = beams.flapping(strip, OBLIQUE, step=0.01)
    period = history.find_period()
    assert abs(found.period - period.value) <= found.uncertainty + period.uncertainty + 1e-6
    assert abs(found.frequency * found.period - 1) < 1e-14
    assert not beams.flapping(strip, ParallelLight(10.0, angle=0.2)).flaps


def test_undecided_is_said():
    strip = ClampedStrip(span=0.95, segments=40)
    short = beams.flapping(strip, OBLIQUE, until=0.5)
    assert short.flaps is None
    assert math.isnan(short.period)
    assert beams.first_snap(strip, OBLIQUE, until=0.5).snaps is None


def test_no_snap_without_enough_light():
    found = beams.first_snap(ClampedStrip(span=0.95, segments=40), GaussianSpot(0.5, 0.475, 0.2))
    assert found.snaps is False
    assert found.time == math.inf
    assert found.smallest_eigenvalue > 1


def test_crest_moves_away_from_the_light():
    strip = ClampedStrip(span=0.95, segments=80)
    history = strip.under(OBLIQUE).run(until=8.0, step=0.01)
    first, second = history.snaps[2].row + 1, history.snaps[3].row
    crest = history.crest[first : second + 1]
    assert np.all(np.diff(crest) > -1e-6)  # light from the upper left
    assert crest[-1] - crest[0] > 0.05


def test_tables():
    strip = ClampedStrip(span=0.95, segments=40)
    history = strip.under(OBLIQUE).run(until=2.0, step=0.02)
    table = history.table
    assert len(table) == len(history)
    assert table["kind"].iloc[0] == "start"
    row = history.snaps[0].row
    assert table["kind"].iloc[row] == "before snap"
    assert table["kind"].iloc[row + 1] == "after snap"
    np.testing.assert_array_equal(history.angles[row + 1], history.snaps[0].after.angles)
    s = strip.arclength
    exact = np.trapezoid(np.sin(2 * np.pi * s) * history.y[5], s)
    assert abs(table["deflection_descriptor"].iloc[5] - exact) < 1e-15


@given(
    intensity=st.floats(0, 30),
    angle=st.floats(-1.6, 1.6),
    span=st.floats(0.5, 0.99),
)
@settings(max_examples=15, deadline=None)
def test_any_light_is_followed(intensity, angle, span):
    """Whatever happens, shapes stay closed, finite and stable."""
    strip = ClampedStrip(span=span, segments=24)
    history = strip.under(ParallelLight(intensity, angle)).run(until=3.0, step=0.02)
    assert np.all(np.isfinite(history.angles))
    np.testing.assert_allclose(history.x[:, -1], span, rtol=0, atol=1e-10)
    np.testing.assert_allclose(history.y[:, -1], 0, rtol=0, atol=1e-10)
    assert history.times[-1] == 3.0


@pytest.mark.parametrize("step", [0.04, 0.01])
def test_rest_beside_a_fold_is_reached_with_long_steps(step):
    """There a soft shape under light restores itself faster than a step of 0.04 could follow."""
    strip, light = ClampedStrip(0.95, 100), ParallelLight(15.0, angle=math.radians(88.2324))
    found = beams.flapping(strip, light, step=step)
    assert found.flaps is False
    assert found.snaps_seen == 1
    assert 0 < found.smallest_eigenvalue < 0.2
    history = strip.under(light).run(40.0, step=step, record_every=None)
    assert history.rate < 1e-6
    np.testing.assert_allclose(history.curvature[-1], history.flux_target(-1), atol=1e-5)


def test_flapping_of_nearly_straight_strips():
    """The shape scales with the root of the slack, and so does the light's difference along it.

    What is left of the height is of first order in it when the strip first snaps, and of second order
    in a whole cycle, which goes both ways.
    """
    slack = np.array([5e-4, 1e-4, 1e-5])
    strips = [ClampedStrip(1 - e, 100) for e in slack]
    light = ParallelLight(10.0, angle=math.pi / 4)
    found = [beams.flapping(strip, light, tolerance=1e-7, step=0.005) for strip in strips]
    assert all(f.flaps and f.snaps_per_cycle == 2 for f in found)
    slopes = np.diff([f.frequency for f in found]) / np.diff(slack)
    assert slopes[0] == pytest.approx(slopes[1], rel=0.05)
    first = [beams.first_snap(strip, light) for strip in strips]
    slopes = np.diff([f.time for f in first]) / np.diff(np.sqrt(slack))
    assert slopes[0] == pytest.approx(slopes[1], rel=0.05)
    released = [f.energy_released for f in first] / slack
    np.testing.assert_allclose(released, released[-1], rtol=0.05)


def jumps(curvatures, times):
    """Return snaps with given natural curvatures (one number each) and times."""
    zero = np.zeros(2)
    return [
        beams.ElasticaSnap(float(t), 1e-9, "snap", zero, zero, np.array([1.0, k]), zero, 0.0, 1.0)
        for t, k in zip(times, curvatures, strict=True)
    ]


@pytest.mark.parametrize("ratio", [-0.97, -0.8, 0.5])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_the_least_period_is_reported(ratio, tolerance):
    """Two snaps a cycle; each cycle deviates from the limit by `ratio` times the one before."""
    n = np.arange(1000)
    cycles = n // 2
    deviation = 0.3 * np.sign(ratio) ** cycles * np.abs(ratio) ** cycles
    curvatures = np.where(n % 2 == 0, 0.2, 0.7) + deviation
    times = 0.4 * n + 0.01 * (n % 2) + 0.05 * deviation
    seen = jumps(curvatures, times)
    found = [period_of(seen[:k], tolerance) for k in range(1, len(seen) + 1)]
    told = [f for f in found if f is not None]
    assert told
    assert {f.snaps_per_cycle for f in told} == {2}
    np.testing.assert_allclose([f.value for f in told], 0.8, atol=tolerance)


def test_a_doubled_period_is_told_from_slow_convergence():
    """Cycles of 4 snaps whose halves differ by little, and go on to differ."""
    n = np.arange(120)
    curvatures = np.choose(n % 4, [0.2, 0.7, 0.2 + 2e-5, 0.7 - 3e-5]) + 1e-3 * 0.7**n
    found = period_of(jumps(curvatures, 0.4 * n), 1e-6)
    assert found is not None
    assert found.snaps_per_cycle == 4
    assert found.value == pytest.approx(1.6)
