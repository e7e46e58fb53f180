"""Rest shapes: their nodes, frames, natural strains; what is refused."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lissome.errors import InvalidInput
from lissome.rods import shapes
from lissome.rods.laws import Kirchhoff
from lissome.rods.measures import MEASURES
from lissome.rods.quaternions import to_directors

LAW = Kirchhoff((1.0, 2.0), 0.8)
UNEVEN = np.random.default_rng(4).uniform(0.5, 1.5, 23)


def energy(rod):
    return rod.evaluate(rod.initial, np.zeros(rod.constraints_count), 0).energy


def directors(rod):
    return to_directors(rod.initial.quaternions)


def nodes(rod):
    return rod.positions(rod.initial)


def check_state(rod):
    """Frames are adapted, nodes are apart by the rest lengths, hinges turn by less than pi."""
    x = nodes(rod)
    np.testing.assert_allclose(np.linalg.norm(np.diff(x, axis=0), axis=1), rod.lengths, rtol=1e-12)
    np.testing.assert_allclose(
        np.diff(x, axis=0) / rod.lengths[:, None], directors(rod)[:, 2], atol=1e-12
    )
    if rod.closed:
        np.testing.assert_allclose(x[-1], x[0], atol=1e-13 * rod.length)


def test_straight_rod():
    rod = shapes.straight(2.0, 10, LAW)
    check_state(rod)
    np.testing.assert_allclose(nodes(rod), np.outer(np.linspace(0, 1, 11), [0, 0, 2]), atol=1e-15)
    np.testing.assert_allclose(directors(rod), np.tile(np.eye(3), (10, 1, 1)), atol=1e-15)
    assert energy(rod) == 0.0
    turned = shapes.straight(
        lengths=UNEVEN, law=LAW, tangent=(1, 2, 2), director=(0, 1, -1), origin=(1, 1, 1)
    )
    check_state(turned)
    np.testing.assert_allclose(nodes(turned)[0], 1.0)
    np.testing.assert_allclose(nodes(turned)[-1], 1 + np.array([1, 2, 2]) / 3 * UNEVEN.sum())
    np.testing.assert_allclose(directors(turned)[5][0], np.array([0, 1, -1]) / math.sqrt(2))
    down = shapes.straight(1.0, 2, LAW, tangent=(0, 0, -1))
    np.testing.assert_allclose(directors(down)[0], np.diag([1, -1, -1]), atol=1e-15)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("about", [1, 2])
@pytest.mark.parametrize("mesh", ["even", "uneven"])
def test_arc_and_helix_are_at_rest(measure, about, mesh):
    size = {"length": 10.0, "segments": 40} if mesh == "even" else {"lengths": UNEVEN / 2}
    options = {"about": about, "measure": measure, "law": LAW, **size}
    for rod in (
        shapes.arc(angle=2.0, **options),
        shapes.helix(curvature=0.7, torsion=-0.4, **options),
    ):
        check_state(rod)
        assert energy(rod) == pytest.approx(0.0, abs=1e-24)
        clamped = rod.clamped("start").clamped("end")  # half hinges are at rest, too
        state = clamped.adopt(clamped.initial)
        strains = clamped.strains(state)
        expected = clamped.natural[clamped.layout.nodes]
        np.testing.assert_allclose(strains, expected, atol=1e-13)


def test_helix_is_uniform_on_the_mesh():
    k, t, n = 0.7, 0.4, 60
    rod = shapes.helix(12.0, n, LAW, curvature=k, torsion=t)
    np.testing.assert_allclose(rod.natural[1:-1], np.tile(rod.natural[1], (n - 1, 1)), rtol=1e-14)
    # Nodes lie on a helix: one screw motion takes each node and frame to the next.
    x, d = nodes(rod), directors(rod)
    step = np.einsum("jia,jib->jab", d[1:], d[:-1])  # rotations that take each frame to the next
    np.testing.assert_allclose(step, np.tile(step[0], (n - 1, 1, 1)), atol=1e-13)
    axis = Rotation.from_matrix(step[0]).as_rotvec()
    axis /= np.linalg.norm(axis)
    radial = x - np.outer(x @ axis, axis)
    center = np.linalg.lstsq(
        np.column_stack([2 * radial, np.ones(n + 1)]), (radial**2).sum(axis=1), rcond=None
    )[0][:3]
    radius = np.linalg.norm(radial - center, axis=1)
    assert np.ptp(radius) < 1e-12
    assert np.ptp(np.diff(x @ axis)) < 1e-13
    assert np.ptp(d[:, 2] @ axis) < 1e-13


def test_nodes_of_a_helix_converge_at_second_order():
    k, t, length = 0.7, 0.4, 8.0
    w = math.hypot(k, t)
    s = length
    # Frenet frame at the start: tangent e3, binormal e1 (about d1), normal n = b x t = -e2
    tangent, binormal, normal = np.eye(3)[2], np.eye(3)[0], -np.eye(3)[1]
    axis = (t * tangent + k * binormal) / w
    end = (
        k / w**2 * (1 - math.cos(w * s)) * normal
        + k / w**2 * math.sin(w * s) * np.cross(axis, -normal)
        + t / w * s * axis
    )
    errors = []
    for n in (25, 50, 100):
        rod = shapes.helix(length, n, LAW, curvature=k, torsion=t)
        errors.append(np.linalg.norm(nodes(rod)[-1] - end))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.05)


def test_arc_bends_to_the_side_that_its_strain_says():
    for about, side in ((1, [0, -1, 0]), (2, [1, 0, 0])):
        rod = shapes.arc(1.0, 50, LAW, angle=0.5, about=about)
        assert nodes(rod)[-1] @ side > 0.2
        assert rod.natural[25, about - 1] == pytest.approx(0.5, rel=1e-4)


def test_arc_that_is_naturally_straight():
    errors = []
    for n in (20, 40):
        rod = shapes.arc(2.0, n, LAW, angle=1.0, stress_free=False)
        assert not rod.natural.any()
        held = rod.clamped("start", frame=np.eye(3)).clamped("end", frame=end_frame(1.0))
        exact = 0.5 * 1.0 * 0.5**2 * 2.0
        errors.append(abs(energy(held) - exact))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def end_frame(angle):
    return Rotation.from_rotvec([angle, 0, 0])


@pytest.mark.parametrize("about", [1, 2])
@pytest.mark.parametrize("mesh", ["even", "uneven"])
def test_ring_is_a_closed_polygon_at_rest(about, mesh):
    size = {"length": 6.0, "segments": 40} if mesh == "even" else {"lengths": UNEVEN}
    for measure in MEASURES:
        rod = shapes.ring(law=LAW, about=about, measure=measure, **size)
        check_state(rod)
        assert energy(rod) == pytest.approx(0.0, abs=1e-24)
        x = nodes(rod)[:-1]
        center = np.linalg.lstsq(
            np.column_stack([2 * x[:, :2], np.ones(len(x))]), (x**2).sum(axis=1), rcond=None
        )[0][:2]
        assert np.ptp(np.linalg.norm(x[:, :2] - center, axis=1)) < 1e-12  # on a circle
        assert np.abs(x[:, 2]).max() < 1e-13
        assert center[1] > 0  # counterclockwise, first segment along +x
        np.testing.assert_allclose(
            directors(rod)[:, about - 1], np.tile([0, 0, 1], (len(x), 1)), atol=1e-12
        )
        np.testing.assert_allclose(x[1], [rod.lengths[0], 0, 0], atol=1e-13)


def test_ring_of_any_orientation():
    rod = shapes.ring(5.0, 30, LAW, normal=(1, 1, 0), tangent=(1, -1, 1), origin=(1, 2, 3))
    check_state(rod)
    x = nodes(rod)
    np.testing.assert_allclose(x[0], [1, 2, 3])
    np.testing.assert_allclose((x - x[0]) @ [1, 1, 0], 0.0, atol=1e-13)


def test_ring_with_natural_curvature():
    rod = shapes.ring(5.0, 30, LAW, natural_curvature=0.0)
    assert not rod.natural.any()
    exact = 0.5 * (2 * math.pi / 5.0) ** 2 * 5.0
    assert energy(rod) == pytest.approx(exact, rel=4e-3)  # sin(x)/x for 30 segments
    over = shapes.ring(5.0, 30, LAW).with_overcurvature(1.5)
    np.testing.assert_allclose(over.natural[:, 0], 1.5 * 2 * math.pi / 5.0, rtol=1e-14)


@pytest.mark.parametrize("turns", [0.5, 1.0, 3.0, -2.25])
def test_twist_of_a_ring_is_even(turns):
    n = 60
    rod = shapes.ring(5.0, n, Kirchhoff(1.0, 0.8), turns=turns, measure="averaged")
    check_state(rod)
    strains = rod.strains(rod.initial)
    assert strains.shape == (n, 3)  # the joint is a hinge like the others
    np.testing.assert_allclose(strains[:, 2], 2 * math.pi * turns / 5.0, rtol=1e-12)
    assert rod.joint == pytest.approx(2 * math.pi * turns)


def test_along_gives_back_a_helix():
    there = shapes.helix(10.0, 50, LAW, curvature=1.0, torsion=0.5)
    rod = shapes.along(nodes(there), LAW, directors=directors(there))
    check_state(rod)
    np.testing.assert_allclose(rod.natural[1:-1], there.natural[1:-1], atol=1e-12)
    np.testing.assert_allclose(nodes(rod), nodes(there), atol=1e-13)
    again = shapes.along(nodes(there), LAW, directors=directors(there)[:, 0])
    np.testing.assert_allclose(again.natural, rod.natural, atol=1e-12)
    assert energy(rod) == pytest.approx(0.0, abs=1e-24)


def random_nodes(count, seed=0):
    random = np.random.default_rng(seed)
    steps = random.normal(size=(count, 3)) * 0.3 + [0, 0, 1]
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


@pytest.mark.parametrize("measure", MEASURES)
def test_along_any_nodes_is_at_rest_without_twist(measure):
    x = random_nodes(30)
    rod = shapes.along(x, LAW, measure=measure)
    check_state(rod)
    np.testing.assert_allclose(nodes(rod), x, atol=1e-12)
    assert energy(rod) == pytest.approx(0.0, abs=1e-24)
    np.testing.assert_allclose(rod.natural[:, 2], 0.0, atol=1e-12)  # parallel transport
    free = shapes.along(x, LAW, measure=measure, stress_free=False)
    assert not free.natural.any()
    assert energy(free) > 0


def test_carried_frames_do_not_drift():
    s = np.linspace(0, 200 * math.pi, 20001)
    coil = np.stack([np.cos(s), np.sin(s), 0.05 * s], axis=1)
    rod = shapes.along(coil, LAW)
    tangents = np.diff(coil, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    np.testing.assert_allclose(directors(rod)[:, 2], tangents, atol=1e-14)


@pytest.mark.parametrize("turns", [0.0, 1.0])
def test_closed_curve_without_directors_closes(turns):
    u = np.linspace(0, 2 * math.pi, 90, endpoint=False)
    trefoil = np.stack(
        [np.sin(u) + 2 * np.sin(2 * u), np.cos(u) - 2 * np.cos(2 * u), -np.sin(3 * u)], axis=1
    )
    rod = shapes.along(trefoil, LAW, closed=True, turns=turns, measure="averaged")
    check_state(rod)
    np.testing.assert_allclose(nodes(rod)[:-1], trefoil, atol=1e-12)
    assert energy(rod) == pytest.approx(0.0, abs=1e-24)
    twist = rod.strains(rod.initial)[:, 2]
    assert np.ptp(twist) < 1e-10  # what is missing is spread evenly
    # Calugareanu: the total is turns - writhe up to a whole turn (see test_topology)
    from lissome.rods.topology import writhe

    total = twist[0] * rod.length / (2 * math.pi)
    offset = total - turns + writhe(nodes(rod), closed=True)
    assert offset == pytest.approx(round(offset), abs=1e-10)


@pytest.mark.parametrize("turns", [0.0, 0.5])
def test_closed_curve_with_given_directors(turns):
    there = shapes.ring(5.0, 40, LAW, about=2, turns=turns)
    rod = shapes.along(
        nodes(there)[:-1], LAW, directors=directors(there)[:, 0], closed=True, turns=turns
    )
    check_state(rod)
    np.testing.assert_allclose(rod.natural[:, :2], expected_bending(there), atol=1e-12)
    assert energy(rod) == pytest.approx(0.0, abs=1e-24)
    np.testing.assert_allclose(rod.strains(rod.initial), there.strains(there.initial), atol=1e-12)


def expected_bending(ring):
    strains = ring.strains(ring.initial)  # the joint comes last, natural strains have it first
    return np.vstack([strains[-1:], strains])[:, :2]


def test_slinky_bends_about_its_thickness():
    w, t, length = 5e-3, 2e-3, 0.314
    law = Kirchhoff.rectangle(w, t, poisson_ratio=0.41)
    slinky = shapes.ring(length, 60, law, about=2).with_overcurvature(1.0)
    np.testing.assert_allclose(slinky.natural, np.tile([0, 2 * math.pi / length, 0], (61, 1)))


u = np.linspace(0, 1, 6)
LINE = np.stack([0 * u, 0 * u, u], axis=1)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
SIDE = np.tile([1.0, 0, 0], (5, 1))


def frames_with(change):
    frames = np.tile(np.eye(3), (5, 1, 1))
    change(frames)
    return frames


def double_first(frames):
    frames[2, 0] *= 2


def swap(frames):
    frames[3, [0, 1]] = frames[3, [1, 0]]


def tilt(frames):
    frames[1] = Rotation.from_rotvec([0.1, 0, 0]).as_matrix().T


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: shapes.straight(1.0, 1, LAW), "`segments` is 1"),
        (lambda: shapes.straight(-1.0, 5, LAW), "`length` is -1"),
        (lambda: shapes.straight(1.0, None, LAW), "needs `length` and `segments`"),
        (lambda: shapes.straight(1.0, 5), "`law` is None"),
        (lambda: shapes.straight(1.0, 5, "steel"), "`law` is 'steel'"),
        (lambda: shapes.straight(1.0, 5, LAW, lengths=[1, 1]), "it replaces both"),
        (lambda: shapes.straight(law=LAW, lengths=[1.0, 0.0]), "`lengths` holds 0"),
        (lambda: shapes.straight(1.0, 5, LAW, tangent=(0, 0, 0)), "`tangent` is the zero vector"),
        (lambda: shapes.straight(1.0, 5, LAW, director=(1, 0, 1)), "an angle of 45 degrees"),
        (lambda: shapes.straight(1.0, 5, LAW, measure="cosine"), "`measure` is 'cosine'"),
        (lambda: shapes.straight(1.0, 5, LAW, stretching=-1.0), "`stretching` is -1"),
        (lambda: shapes.arc(1.0, 5, LAW, angle=1.0, about=3), "`about` is 3"),
        (lambda: shapes.arc(1.0, 5, LAW, angle=20.0), "use more segments"),
        (lambda: shapes.helix(1.0, 5, LAW, curvature=1.0, torsion=math.nan), "`torsion` is nan"),
        (lambda: shapes.ring(1.0, 2, LAW), "`segments` is 2; a ring has at least 3"),
        (lambda: shapes.ring(1.0, 9, LAW, tangent=(1, 0, 1)), "must lie in the plane"),
        (lambda: shapes.ring(law=LAW, lengths=[1, 1, 1, 2.9]), "nearly as long as all others"),
        (lambda: shapes.along([[0, 0, 0], [0, 0, 1]], LAW), "has 2 rows"),
        (lambda: shapes.along(LINE[:, :2], LAW), r"has shape \(6, 2\)"),
        (lambda: shapes.along(LINE[[0, 1, 1, 2]], LAW), "same position .* at 1 and 2"),
        (
            lambda: shapes.along(SQUARE[[0, 1, 2, 3, 0]], LAW, closed=True),
            "do not repeat the first",
        ),
        (lambda: shapes.along(LINE[[0, 2, 1]], LAW), "folds back on itself at node 1"),
        (
            lambda: shapes.along([[0, 0, 0], [0, 0, 2], [0, 0, 1.0]], LAW, closed=True),
            "folds back on itself",
        ),
        (lambda: shapes.along(LINE, LAW, turns=1.0), "only a closed rod"),
        (lambda: shapes.along(LINE, LAW, directors=[0, 0, 1]), "an angle of 0 degrees"),
        (lambda: shapes.along(LINE, LAW, directors=SIDE[:4]), r"it must be \(3,\), \(5, 3\)"),
        (lambda: shapes.along(LINE, LAW, directors=2 * SIDE), r"`directors`\[0\] has length 2"),
        (
            lambda: shapes.along(LINE, LAW, directors=SIDE[:, [1, 2, 0]]),
            r"`directors`\[0\] .* not normal",
        ),
        (lambda: shapes.along(LINE, LAW, directors=frames_with(double_first)), "not orthonormal"),
        (lambda: shapes.along(LINE, LAW, directors=frames_with(swap)), "left-handed"),
        (
            lambda: shapes.along(LINE, LAW, directors=frames_with(tilt)),
            r"`directors`\[1, 2\] .* d3 must be the unit tangent",
        ),
        (
            lambda: shapes.along(LINE, LAW, directors=SIDE * [[1], [1], [-1], [-1], [-1]]),
            "both sides of node 2 are half a turn apart",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()
