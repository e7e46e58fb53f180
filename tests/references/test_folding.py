"""The folded ring: collocation against closed form, integration, shooting and a free force."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root

from lissome.errors import InvalidInput, NotConverged
from lissome.references import circles, folding
from lissome.references.circles import RingSection

SLINKY = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
OTHERS = [
    RingSection(5.0, 1.0, 2.0),
    RingSection(4.0, 1.5, 0.5),
    RingSection(20.0, 1.0, 10.0),
]


def _middle(section, part):
    low, high = circles.mode_threshold(section, 1, 2), circles.mode_threshold(section, 3, 2)
    return low + part * (high - low)


@pytest.mark.parametrize("o", [1.41, 1.8, 2.0, 2.3, 2.55])
def test_equal_stiffnesses_fold_along_a_hypotrochoid(o):
    section = RingSection(5.0, 2.0, 2.0)
    fold = folding.folded_ring(section, o)
    s = np.linspace(0, 1, 101)
    points = folding.even_fold(section, o, s)
    # both start at a crest, on the same side of the center
    assert np.allclose(fold.points(s), points, atol=1e-13)
    sigma = (o - 2) / (1 - 2 / 5)
    assert fold.crest_distance == pytest.approx((1 - 2 * sigma) / (3 * np.pi), abs=1e-13)
    assert fold.moment == pytest.approx(2 * np.pi * 2.0, rel=1e-13)
    speed = np.linalg.norm(np.diff(folding.even_fold(section, o, np.linspace(0, 1, 4001)), axis=0))
    assert speed**2 == pytest.approx(1 / 4000, rel=1e-5)


def _matrix(q):
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _spin(q, k):
    w, x, y, z = q
    return 0.5 * np.array(
        [
            -x * k[0] - y * k[1] - z * k[2],
            w * k[0] + y * k[2] - z * k[1],
            w * k[1] + z * k[0] - x * k[2],
            w * k[2] + x * k[1] - y * k[0],
        ]
    )


def _rod(section, o, force):
    """Right-hand side of Kirchhoff's equations for length 1: position, quaternion, moment."""
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    rest = np.array([0.0, 2 * np.pi * o, 0.0])

    def right(s, y):
        q, m = y[3:7], y[7:10]
        k = rest + m / stiffness
        r = _matrix(q)
        return np.concatenate(
            [r[:, 2], _spin(q, k), np.cross(m, k) + np.cross(r.T @ force, [0.0, 0.0, 1.0])]
        )

    return right


@pytest.mark.parametrize("section", [SLINKY, *OTHERS])
@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.95])
def test_integrated_without_force_the_rod_closes(section, part):
    """Kirchhoff's equations from the crest's moment: ends meet with the same frame, smoothly."""
    o = _middle(section, part)
    fold = folding.folded_ring(section, o)
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    moment = stiffness * (fold.strains(0.0) - [0, 2 * np.pi * o, 0])
    assert np.linalg.norm(moment) == pytest.approx(fold.moment, rel=1e-11)
    start = np.concatenate([np.zeros(3), [1.0, 0, 0, 0], moment])
    s = np.linspace(0, 1, 17)
    run = solve_ivp(
        _rod(section, o, np.zeros(3)), (0, 1), start, "DOP853", t_eval=s, rtol=1e-13, atol=1e-14
    )
    end = run.y[:, -1]
    assert np.allclose(end[:3], 0.0, atol=2e-11)
    assert np.allclose(end[3:7], [-1, 0, 0, 0], atol=1e-10)  # the odd class of framings
    assert np.allclose(end[7:], moment, atol=1e-8)
    turned = run.y[:3].T @ fold.frames(0.0).T
    assert np.allclose(turned, fold.points(s) - fold.points(0.0), atol=1e-11)
    assert fold.closure_error < 1e-12


@pytest.mark.parametrize("section", [SLINKY, *OTHERS])
def test_overcurvature_by_shooting(section):
    """A quarter wave of the moment on its sphere, integrated; unknown are its size and O."""
    o = _middle(section, 0.4)
    fold = folding.folded_ring(section, o)
    stiffness = np.array([section.out_of_plane, section.in_plane, section.torsion])
    moment = stiffness * (fold.strains(0.0) / (2 * np.pi) - [0, o, 0])
    latitude = np.arctan2(moment[1], moment[0])

    def miss(unknown):
        size, natural = unknown

        def right(s, y):
            k = y[:3] / stiffness + [0, natural, 0]
            square = y[0] ** 2 + y[2] ** 2
            return [
                *np.cross(y[:3], k),
                size * (y[0] ** 2 / stiffness[0] + y[2] ** 2 / stiffness[2]) / square,
            ]

        start = [size * np.cos(latitude), size * np.sin(latitude), 0, 0]
        end = solve_ivp(right, (0, np.pi / 4), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return [end[0], end[3] - np.pi / 4]

    found = root(miss, [0.9 * np.linalg.norm(moment), o + 0.05], tol=1e-12)
    assert found.success
    assert found.x == pytest.approx([np.linalg.norm(moment), o], rel=1e-9)


@pytest.mark.parametrize("part", [0.2, 0.7])
def test_force_left_free_comes_out_as_zero(part):
    """Half a ring between mirror planes, collocated with an unknown force across them."""
    o = _middle(SLINKY, part)
    fold = folding.folded_ring(SLINKY, o)
    stiffness = np.array([SLINKY.out_of_plane, SLINKY.in_plane, SLINKY.torsion])
    start = np.array([1.0, 0, 0, 0])
    rest = np.array([0.0, 2 * np.pi * o, 0.0])[:, None]

    def right(s, y, p):
        q, m = y[3:7], y[7:10]
        k = rest + m / stiffness[:, None]
        r = _matrix(q)
        push = np.cross(p[0] * r[2], [0.0, 0.0, 1.0], axis=0, axisb=0)
        return np.concatenate([r[:, 2], _spin(q, k), np.cross(m, k, axis=0) + push])

    def ends(a, b, p):
        # the tangent of the crest is the third axis; d3 = -e3 at the far crest
        tangent = _matrix(b[3:7])[:, 2]
        return np.concatenate([a[:3], a[3:7] - start, a[9:10], [b[2], tangent[0], tangent[1]]])

    s = np.linspace(0, 0.5, 41)
    guess = np.zeros((10, s.size))
    guess[7:] = (stiffness * (fold.strains(s) - [0, 2 * np.pi * o, 0])).T
    run = solve_ivp(
        _rod(SLINKY, o, np.zeros(3)),
        (0, 0.5),
        [0, 0, 0, 1, 0, 0, 0, *guess[7:, 0]],
        "DOP853",
        t_eval=s,
        rtol=1e-10,
    )
    guess[:7] = run.y[:7]
    bump = np.sin(2 * np.pi * s)
    guess[7:] += np.outer([1.0, -1.5, 0.7], bump)
    found = solve_bvp(right, ends, s, guess, p=[10.0], tol=1e-8, max_nodes=20000)
    assert found.success
    assert abs(found.p[0]) < 1e-5
    ends_of_half = fold.points(0.5) - fold.points(0.0)
    assert np.linalg.norm(found.y[:3, -1]) == pytest.approx(np.linalg.norm(ends_of_half), abs=1e-8)
    assert np.linalg.norm(found.y[:3, -1]) == pytest.approx(fold.distance, abs=1e-8)


@pytest.mark.parametrize("part", [0.003, 0.25, 0.5, 0.75, 0.997])
def test_the_slinky_is_stable_all_along_its_branch(part):
    values = folding.folded_ring(SLINKY, _middle(SLINKY, part)).spectrum()
    assert np.all(np.abs(values[:4]) < 1e-9)  # three rotations and the shift along the rod
    assert values[4] > 0.01


def test_branch_leaves_and_meets_the_circles_at_the_exact_thresholds():
    """Height squared is proportional to the distance from the threshold, at both ends."""
    for turns, side in ((1, 1.0), (3, -1.0)):
        place = circles.mode_threshold(SLINKY, turns, 2)
        steps = np.array([1e-3, 1e-5])
        rings = [folding.folded_ring(SLINKY, place + side * step) for step in steps]
        ratio = np.array([fold.height for fold in rings]) ** 2 / steps
        assert ratio[0] == pytest.approx(ratio[1], rel=5e-3)
        distance = np.array([fold.distance for fold in rings])
        error = np.abs(distance - 1 / (turns * np.pi))
        assert error[0] / error[1] == pytest.approx(100, rel=0.02)


def test_energy_changes_with_the_natural_curvature_by_the_moment():
    """dE/dO = -2 pi times the mean moment about the second director."""
    o, step = 1.9, 1e-4
    low, middle, high = (folding.folded_ring(SLINKY, x) for x in (o - step, o, o + step))
    s = np.arange(256) / 256
    moment = SLINKY.in_plane * (middle.strains(s)[:, 1] - 2 * np.pi * o)
    slope = (high.energy - low.energy) / (2 * step)
    assert slope == pytest.approx(-2 * np.pi * moment.mean(), rel=1e-8)
    assert middle.energy < 0.5 * SLINKY.in_plane * (2 * np.pi) ** 2 * min(
        (o - 1) ** 2, (o - 3) ** 2
    )


def test_symmetry_and_least_distance():
    fold = folding.folded_ring(SLINKY, 1.7)
    s = np.arange(400) / 400
    x = fold.points(s)
    assert np.allclose(np.roll(x, -200, axis=0), x * [-1, -1, 1], atol=1e-13)
    mirrored = fold.points(-s)
    assert np.allclose(mirrored, x * [1, -1, 1], atol=1e-13)
    gap = np.linalg.norm(np.roll(x, -200, axis=0) - x, axis=1)
    assert gap.min() == pytest.approx(fold.distance, abs=1e-13)
    frames = fold.frames(s)
    assert np.allclose(frames.transpose(0, 2, 1) @ frames, np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(frames), 1.0)
    # directors differentiate to the strains
    d = 1e-5
    slope = (fold.frames(s + d) - fold.frames(s - d)) / (2 * d)
    spin = frames.transpose(0, 2, 1) @ slope
    found = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    assert np.allclose(found, fold.strains(s), atol=1e-6)
    assert np.max(np.abs(found[:, 2])) == pytest.approx(fold.largest_twist, rel=1e-3)


def test_distance_over_the_whole_range():
    o = np.array([0.9, 1.0, 1.1669, 1.1670, 2.0, 2.8332, 2.8333, 3.1])
    d = folding.opposite_distance(SLINKY, o)
    assert np.allclose(d[:3], 1 / np.pi)
    assert np.allclose(d[6:], 1 / (3 * np.pi))
    assert d[3] == pytest.approx(d[2], rel=1e-3)
    assert d[5] == pytest.approx(d[6], rel=1e-3)
    crossing = folding.crossing_overcurvature(SLINKY)
    assert folding.opposite_distance(SLINKY, crossing) < 1e-10
    before, after = folding.opposite_distance(SLINKY, [crossing - 0.01, crossing + 0.01])
    assert before == pytest.approx(after, rel=0.05)


def test_bad_input():
    for o in (1.1, 2.9, np.nan):
        with pytest.raises(InvalidInput, match="overcurvature"):
            folding.folded_ring(SLINKY, o)
    with pytest.raises(InvalidInput, match="single"):
        folding.opposite_distance(SLINKY, [1.0, 3.2])
    with pytest.raises(InvalidInput, match="section"):
        folding.opposite_distance(RingSection(1.0, 2.0, 2.0), 1.0)
    with pytest.raises(InvalidInput, match="section"):
        folding.even_fold(SLINKY, 2.0, 0.0)
    with pytest.raises(InvalidInput, match="overcurvature"):
        folding.even_fold(RingSection(2.0, 1.0, 1.0), 2.9, 0.0)


def test_a_tolerance_below_rounding_is_refused():
    with pytest.raises(NotConverged, match="256 coefficients") as caught:
        folding.folded_ring(SLINKY, 1.5, tolerance=1e-25)
    assert caught.value.state.shape == (3, 256)
