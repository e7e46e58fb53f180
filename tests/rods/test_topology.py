"""Self-crossings, twist, writhe and linking."""

import itertools
import math
import warnings

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome.errors import InvalidInput, LissomeWarning
from lissome.rods import shapes, topology
from lissome.rods.laws import Kirchhoff
from lissome.rods.quaternions import conjugate, exponential, multiply, to_directors
from lissome.rods.topology import (
    advances,
    linking_number,
    self_crossings,
    total_twist,
    warn_of_self_crossings,
    writhe,
)


def torus_knot(p, q, count=240, small=0.4):
    u = np.linspace(0, 2 * np.pi, count, endpoint=False)
    r = 1 + small * np.cos(q * u)
    return np.stack([r * np.cos(p * u), r * np.sin(p * u), small * np.sin(q * u)], axis=1)


def circle(count=60):
    u = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)


# ---------------------------------------------------------------------------------------------
# Crossings


def segment_distance(a, b, c, d):
    """By a bounded minimization from the corners: another method than the library's."""

    def square(st):
        r = a + st[0] * (b - a) - c - st[1] * (d - c)
        return r @ r

    found = [
        minimize(square, start, bounds=[(0, 1), (0, 1)], method="L-BFGS-B", tol=1e-15).fun
        for start in itertools.product((0.0, 0.5, 1.0), repeat=2)
    ]
    return math.sqrt(min(found))


def test_distances_of_segments():
    random = np.random.default_rng(2)
    cases = [random.normal(size=(4, 3)) for _ in range(15)]
    cases.append(np.array([[0, 0, 0], [1, 0, 0], [0.2, 1, 0], [2.0, 1, 0]]))  # parallel
    cases.append(np.array([[0, 0, 0], [1, 0, 0], [3.0, 0, 0], [2.0, 0, 0]]))  # on one line
    cases.append(np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0.1], [0.5, 1, 0.1]]))  # a cross
    distances, fractions = np.empty(1), np.empty((1, 2))
    for a, b, c, d in cases:
        points = np.stack([a, b, c, d])
        topology._segment_distances(points, np.array([[0, 2]]), distances, fractions)
        assert distances[0] == pytest.approx(segment_distance(a, b, c, d), abs=1e-6)
        s, t = fractions[0]
        assert np.linalg.norm(a + s * (b - a) - c - t * (d - c)) == pytest.approx(distances[0])


def all_pairs(points, distance, closed):
    """The definition, without a tree."""
    x = np.vstack([points, points[:1]]) if closed else points
    edges = np.linalg.norm(np.diff(x, axis=0), axis=1)
    ends = np.concatenate([[0], np.cumsum(edges)])
    n = edges.size
    pairs = np.array(list(itertools.combinations(range(n), 2)))
    d, f = np.empty(len(pairs)), np.empty((len(pairs), 2))
    topology._segment_distances(x, pairs, d, f)
    found = set()
    for (i, j), gap in zip(pairs, d, strict=True):
        between = ends[j] - ends[i + 1]
        if closed:
            between = min(between, ends[-1] - ends[j + 1] + ends[i])
        neighbors = j == i + 1 or (closed and i == 0 and j == n - 1)
        if gap < distance and between > math.pi / 2 * distance and not neighbors:
            found.add((int(i), int(j)))
    return found


@pytest.mark.parametrize("closed", [False, True])
def test_tree_finds_all_pairs(closed):
    random = np.random.default_rng(7)
    walk = np.cumsum(random.normal(size=(150, 3)) * [0.1, 0.1, 0.02], axis=0)
    for distance in (0.01, 0.05, 0.2):
        found = self_crossings(walk, distance, closed=closed)
        expected = all_pairs(walk, distance, closed)
        assert {(int(i), int(j)) for i, j in found.segments} == expected
        assert np.all(np.diff(found.distances) >= 0)
        assert len(found) == len(expected) and bool(found) == bool(expected)
    assert expected  # the last distance is large


def test_figure_of_eight_crosses_once():
    u = np.linspace(0, 2 * np.pi, 101, endpoint=False)
    eight = np.stack([np.sin(2 * u), np.sin(u), 0.01 * np.cos(u)], axis=1)
    found = self_crossings(eight, 0.03, closed=True)
    assert found.distances[0] == pytest.approx(0.02, abs=1e-4)
    assert not self_crossings(eight, 0.019, closed=True)


def test_tube_of_a_ring_does_not_cross_itself():
    assert not self_crossings(circle(200), 0.9, closed=True)
    assert not self_crossings(circle(200), closed=True)
    twice = np.vstack([circle(200), circle(200) * [1, 1, 0] + [0, 0, 1e-6]])
    assert len(self_crossings(twice, closed=True)) >= 200


def test_warning_says_where():
    u = (np.arange(100) + 0.5) * 2 * np.pi / 100
    eight = np.stack([np.sin(2 * u), np.sin(u), 0.0 * u], axis=1)
    with pytest.warns(LissomeWarning, match="segments 49 and 99 .* self-contact is not modeled"):
        found = warn_of_self_crossings(eight, 0.01, closed=True)
    assert found.distances[0] == pytest.approx(0.0, abs=1e-12)


# ---------------------------------------------------------------------------------------------
# Topology


def klenin_langowski(x, closed=True):
    """Method 1a of Klenin and Langowski (2000): arcsines of normals."""
    x = np.vstack([x, x[:1]]) if closed else x
    total = 0.0
    for i, j in itertools.combinations(range(len(x) - 1), 2):
        r1, r2, r3, r4 = x[i], x[i + 1], x[j], x[j + 1]
        sides = [(r3 - r1, r4 - r1), (r4 - r1, r4 - r2), (r4 - r2, r3 - r2), (r3 - r2, r3 - r1)]
        normals = [np.cross(a, b) for a, b in sides]
        sizes = [np.linalg.norm(n) for n in normals]
        if min(sizes) < 1e-12:
            continue
        n = [a / b for a, b in zip(normals, sizes, strict=True)]
        angle = sum(math.asin(np.clip(n[a] @ n[(a + 1) % 4], -1, 1)) for a in range(4))
        total += angle * np.sign(np.cross(r4 - r3, r2 - r1) @ (r3 - r1))
    return total / (2 * math.pi)


def test_writhe_by_another_formula():
    random = np.random.default_rng(3)
    for closed in (True, False):
        x = random.normal(size=(12, 3))
        assert writhe(x, closed=closed) == pytest.approx(klenin_langowski(x, closed), abs=1e-10)
    knot = torus_knot(2, 3, 40)
    assert writhe(knot, closed=True) == pytest.approx(klenin_langowski(knot), abs=1e-10)


def test_writhe_is_the_mean_number_of_signed_crossings():
    x = np.random.default_rng(11).normal(size=(8, 3))
    closed = np.vstack([x, x[:1]])
    total, views = 0, 4000
    for rotation in Rotation.random(views, rng=np.random.default_rng(0)):
        total += signed_crossings(rotation.apply(closed))
    # three standard errors of the mean: the number in a view is at most a few
    assert writhe(x, closed=True) == pytest.approx(total / views, abs=0.1)


def signed_crossings(x):
    total = 0
    for i, j in itertools.combinations(range(len(x) - 1), 2):
        if j == i + 1 or (i == 0 and j == len(x) - 2):
            continue
        a, b, r = x[i + 1] - x[i], x[j + 1] - x[j], x[j] - x[i]
        det = a[0] * b[1] - a[1] * b[0]
        s = (r[0] * b[1] - r[1] * b[0]) / det
        t = (r[0] * a[1] - r[1] * a[0]) / det
        if 0 < s < 1 and 0 < t < 1:
            above = x[i][2] + s * a[2] - x[j][2] - t * b[2]
            total += int(np.sign(det) * np.sign(above))
    return total


def test_writhe_symmetries():
    x = torus_knot(2, 3)
    value = writhe(x, closed=True)
    turned = Rotation.random(rng=np.random.default_rng(1)).apply(x) * 3.0 + 7.0
    assert writhe(turned, closed=True) == pytest.approx(value, abs=1e-12)
    assert writhe(x[::-1], closed=True) == pytest.approx(value, abs=1e-12)
    assert writhe(np.roll(x, 17, axis=0), closed=True) == pytest.approx(value, abs=1e-12)
    assert writhe(x * [1, 1, -1], closed=True) == pytest.approx(-value, abs=1e-12)
    assert writhe(np.vstack([x, x[:1]]), closed=True) == pytest.approx(value, abs=1e-15)


def test_linking_numbers():
    u = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    core = circle()
    for turns in (-3, -1, 0, 2, 5):
        r = 1 + 0.3 * np.cos(turns * u)
        winding = np.stack([r * np.cos(u), r * np.sin(u), 0.3 * np.sin(turns * u)], axis=1)
        assert abs(linking_number(core, winding)) == abs(turns)
        assert linking_number(winding, core) == linking_number(core, winding)
        assert linking_number(winding * [1, 1, -1], core) == -linking_number(winding, core)
        assert linking_number(winding[::-1], core) == -linking_number(winding, core)
    # a right-handed winding is positive
    u = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    right = np.stack([0.1 * np.cos(u), 0.1 * np.sin(u), u], axis=1)[:-1]
    line = np.stack([0 * u, 0 * u, np.linspace(-1, 8, 200)], axis=1)
    back = np.array([[-50.0, 0, 8], [-50.0, 0, -1]])
    back_helix = np.array([[50.0, 0, 2 * np.pi], [50.0, 0, 0]])
    assert linking_number(np.vstack([line, back]), np.vstack([right, back_helix])) == 1
    with pytest.raises(InvalidInput, match="touch"):
        middle = 0.5 * (core[0] + core[1])
        linking_number(core, middle + np.array([[0, 0, -1], [0, 0, 1], [9, 0, 0]]))


@pytest.mark.parametrize("turns", [0.0, 1.0, -2.0])
@pytest.mark.parametrize("knot", [(1, 0), (2, 3), (3, 2)])
def test_twist_and_writhe_add_up_to_the_linking_of_the_edges(turns, knot):
    """Calugareanu, White, Fuller: for polygons too."""
    rod = shapes.along(torus_knot(*knot), Kirchhoff(1.0, 1.0), closed=True, turns=turns)
    frames = rod.initial.quaternions
    joint = multiply(frames[:1], exponential([[0.0, 0.0, rod.joint]]))
    q = multiply(conjugate(frames), np.vstack([frames[1:], joint]))
    x = rod.positions(rod.initial)
    link = total_twist(q) + writhe(x, closed=True)
    assert link == pytest.approx(round(link), abs=1e-9)
    assert total_twist(-q) == total_twist(q)
    edge = offset(x, rod, 0.05)
    assert linking_number(x, edge) == round(link)


def offset(x, rod, width):
    """The curve beside the rod: farther from it than chords of the curve are from the curve."""
    from lissome.rods.quaternions import to_directors

    d1 = to_directors(rod.initial.quaternions)[:, 0]
    return 0.5 * (x[:-1] + x[1:]) + width * d1


def test_twist_of_a_straight_rod():
    angles = np.random.default_rng(0).uniform(-3, 3, 20)
    q = exponential(np.outer(angles, [0, 0, 1]))
    assert total_twist(q) == pytest.approx(angles.sum() / (2 * math.pi))


def test_twisted_ring_unwinds_by_passing_through_itself():
    """Below Michell's sqrt(3) B/C turns a ring stays flat; beyond, it sheds two turns at a time."""
    law = Kirchhoff((1.0, 1.0), 1.0)
    flat = ls.equilibrate(shapes.ring(1.0, 40, law, natural_curvature=0.0, turns=1.5))
    assert flat.twist == pytest.approx(1.5, abs=1e-9)
    assert flat.writhe == pytest.approx(0.0, abs=1e-9)
    assert flat.passages == 0 and not flat.self_crossings()
    rod = shapes.ring(1.0, 40, law, natural_curvature=0.0, turns=2.0)
    unwound = ls.equilibrate(rod)
    assert unwound.link == pytest.approx(2.0 - 2 * unwound.passages, abs=1e-8)
    assert unwound.passages == 1  # Dirac's belt
    assert unwound.energy == pytest.approx(2 * math.pi**2, rel=1e-2)  # flat, without twist
    with pytest.warns(LissomeWarning, match="passed through itself .* changed by -2"):
        unwound.self_crossings()
    with pytest.raises(InvalidInput, match="only a closed rod"):
        _ = ls.equilibrate(shapes.straight(1.0, 4, law).clamped("start")).link


def test_equilibrium_that_crosses_itself_warns(tmp_path):
    """A clamped arc of more than a turn, naturally so: its parts lie on each other."""
    law = Kirchhoff((1.0, 1.0), 1.0)
    rod = shapes.arc(1.0, 60, law, angle=2.2 * 2 * math.pi).clamped("start").clamped("end")
    with pytest.warns(LissomeWarning, match="passes through itself") as told:
        eq = ls.equilibrate(rod)
    assert told[0].filename == __file__  # it points at the caller
    with pytest.warns(LissomeWarning, match="self-contact is not modeled"):
        assert eq.self_crossings()
    with pytest.warns(LissomeWarning, match="self-contact is not modeled"):
        eq.to_vtk(tmp_path / "coil.vtu")
    assert eq.self_crossings(warn=False)


@pytest.mark.parametrize("angle", [0.5, 4.0, 6.0])
def test_equilibrium_that_does_not_cross_itself_is_silent(angle):
    law = Kirchhoff((1.0, 1.0), 1.0)
    rod = shapes.arc(1.0, 60, law, angle=angle).clamped("start")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ls.equilibrate(rod)


def test_rods_that_advance_along_a_direction_do_not_cross_themselves():
    """Random curves: none that is let pass unseen comes near itself, at any distance asked for."""
    rng = np.random.default_rng(4)
    passed = 0
    for _ in range(300):
        count = int(rng.integers(2, 80))
        turns = exponential(rng.normal(size=(count, 3)) * rng.uniform(0, 3) / count**0.5)
        frames = np.empty((count, 4))
        frames[0] = exponential(rng.normal(size=3))
        for j in range(1, count):
            frames[j] = multiply(frames[j - 1], turns[j])
        edges = rng.uniform(0.1, 1.0, count)[:, None] * to_directors(frames)[:, 2]
        nodes = np.concatenate([np.zeros((1, 3)), np.cumsum(edges, axis=0)])
        if advances(frames):
            passed += 1
            assert not any(self_crossings(nodes, d) for d in (1e-3, 0.1, 0.5, 2.0))
    assert 30 < passed < 270
    u = np.linspace(0, 2 * np.pi, 40)  # a circle does not
    assert not advances(exponential(np.stack([u, 0 * u, 0 * u], axis=1)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: self_crossings(circle(), -1.0), "`distance` is -1"),
        (lambda: self_crossings([[0, 0, 0]]), "has 1 rows"),
        (lambda: writhe(np.zeros((4, 2))), r"`nodes` has shape \(4, 2\)"),
        (lambda: writhe([[0, 0, 0], [0, 0, 1]], closed=True), "at least 3"),
        (lambda: total_twist(np.zeros((4, 3))), "`rotations` has shape"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()
