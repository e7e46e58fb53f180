"""The bent and twisted ribbon: mechanics, symmetry, and methods other than collocation."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lissome.errors import InvalidInput, NotConverged
from lissome.references import ribbon_twist
from lissome.references._collocation import Family, gauss
from lissome.references._frames import directors
from lissome.references.ribbon_twist import Ribbon

NARROW = Ribbon(8.0, poisson_ratio=0.4)
WIDE = Ribbon(15.0, poisson_ratio=0.4)


@pytest.fixture(scope="module")
def narrow():
    """The narrow ribbon through its first fold and some way beyond."""
    return ribbon_twist.trace(NARROW, count=84)


@pytest.fixture(scope="module")
def wide():
    """The wide ribbon, past half a turn of its clamps."""
    return ribbon_twist.trace(WIDE, until=3.2, step=0.2, elements=16)


@pytest.mark.parametrize("form", ["thesis", "audoly-neukirch", "panda-jawed"])
def test_law_derives_from_its_energy(form):
    """Moments are derivatives of the energy, moduli of the moments, by complex steps."""
    ribbon = Ribbon(10.0, poisson_ratio=0.3, form=form)
    random = np.random.default_rng(4)
    k2, k3 = random.normal(size=(2, 20)) * 3
    step = 1e-30j
    m2, m3 = ribbon.moments(k2, k3)
    assert np.allclose(m2, ribbon.energy_density(0, k2 + step, k3).imag / 1e-30, rtol=1e-13)
    assert np.allclose(m3, ribbon.energy_density(0, k2, k3 + step).imag / 1e-30, rtol=1e-13)
    bend, mixed, twist = ribbon.tangent_moduli(k2, k3)
    by2 = ribbon.moments(k2 + step, k3)
    by3 = ribbon.moments(k2, k3 + step)
    assert np.allclose(bend, by2[0].imag / 1e-30, rtol=1e-12)
    assert np.allclose(mixed, by2[1].imag / 1e-30, rtol=1e-12)
    assert np.allclose(mixed, by3[0].imag / 1e-30, rtol=1e-12)
    assert np.allclose(twist, by3[1].imag / 1e-30, rtol=1e-12)
    assert np.all(twist > 0)


def test_law_has_its_limits():
    """Linear for small strains; Sadowsky's energy, (k2^2 + k3^2)^2/k2^2 at nu = 0, if xi is large."""
    ribbon = Ribbon(500.0, poisson_ratio=0.0)
    k2, k3 = 1.3, 0.8
    assert 2 * ribbon.energy_density(0, k2, k3) == pytest.approx(
        (k2**2 + k3**2) ** 2 / k2**2, rel=1e-4
    )
    assert NARROW.moments(1e-6, 1e-6)[1] == pytest.approx(NARROW.twisting * 1e-6, rel=1e-9)
    # in pure twist the Hessian is singular at k3 = 1/xi
    edge = 1 / NARROW.extensibility
    assert NARROW.ellipticity(0.0, 0.999 * edge) > 0 > NARROW.ellipticity(0.0, 1.001 * edge)


@pytest.mark.parametrize("reading", ["mirror", "rotation"])
def test_integration_from_the_clamp_arrives_at_the_middle(reading):
    """Directors instead of a quaternion, strains from moments, moments from statics."""
    twist = 1.2
    state = ribbon_twist.equilibrium(NARROW, twist, reading=reading)
    start = state.clamp_strains
    force = state.force
    first = np.array([NARROW.hard_bending * start[0], *NARROW.moments(start[1], start[2])])
    c, s = np.cos(twist), np.sin(twist)
    frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    clamp = first @ frame
    origin = np.array([-1.0, 0.0, 0.0])
    guess = [start[1:]]

    def right(s, y):
        x, d = y[:3], y[3:].reshape(3, 3)
        m = d @ (clamp - np.cross(x - origin, force))
        found = guess[0]
        for _ in range(6):
            bend, mixed, twist = NARROW.tangent_moduli(*found)
            slope = np.array([[bend, mixed], [mixed, twist]])
            found = found - np.linalg.solve(slope, np.array(NARROW.moments(*found)) - m[1:])
        assert np.allclose(NARROW.moments(*found), m[1:], rtol=1e-10, atol=1e-10)
        guess[0] = found
        k = np.array([m[0] / NARROW.hard_bending, *found]) @ d
        return np.concatenate([d[2], np.cross(k, d).ravel()])

    run = solve_ivp(
        right, (0, np.pi / 2), [*origin, *frame.ravel()], "DOP853", rtol=1e-11, atol=1e-12
    )
    x, d = run.y[:3, -1], run.y[3:, -1].reshape(3, 3)
    moment = clamp - np.cross(x - origin, force)
    assert np.allclose(x, state.midpoint, atol=1e-8)
    if reading == "mirror":
        assert np.allclose(d[2], [1, 0, 0], atol=1e-8)
        assert abs(moment[0]) < 1e-7
        assert force[1] == 0
        assert np.arctan2(d[1, 2], d[1, 1]) == pytest.approx(state.tilt, abs=1e-8)
    else:
        assert np.allclose(np.abs(d[0]), [0, 0, 1], atol=1e-8)
        assert abs(moment[2]) < 1e-7
        assert np.allclose(x[:2], 0, atol=1e-9)


@pytest.mark.parametrize("reading", ["mirror", "rotation"])
def test_clamps_do_the_work(reading):
    """d(energy)/d(twist) is minus twice the moment about z at the first clamp."""
    h = 1e-3
    low, here, high = (
        ribbon_twist.equilibrium(NARROW, 0.9 + d, reading=reading, elements=10)
        for d in (-h, 0.0, h)
    )
    k = here.clamp_strains
    moment = NARROW.moments(k[1], k[2])[1]  # the clamp's d3 is along z
    assert (high.energy - low.energy) / (2 * h) == pytest.approx(-2 * moment, rel=1e-5)


def test_first_integral_along_the_ribbon(narrow):
    """m . k - W + n . t is constant: the law does not depend on the arc length."""
    for state in narrow.states[::20]:
        s = np.linspace(0, np.pi / 2, 40)
        y, k = state.solution.at(s), state.strains(s)
        q = y[:, 3:7].T
        tangent = 2 * (q[1] * q[3] + q[0] * q[2])  # its component along the force
        m2, m3 = NARROW.moments(k[:, 1], k[:, 2])
        value = (
            y[:, 7] * k[:, 0]
            + m2 * k[:, 1]
            + m3 * k[:, 2]
            - NARROW.energy_density(*k.T)
            + state.force[0] * tangent
        )
        assert np.ptp(value) < 1e-3 * max(1, abs(value).max())
        nodes = state.solution.nodes
        assert np.allclose((nodes[:, 3:7] ** 2).sum(axis=1), 1, atol=1e-12)


def test_half_circle_is_stable_and_unloaded(narrow):
    first = narrow.states[0]
    assert first.energy == pytest.approx(np.pi / 2, rel=1e-12)
    assert np.allclose(first.midpoint, [0, 0, 1], atol=1e-12)
    assert np.allclose(first.force, 0, atol=1e-10)
    symmetric, antisymmetric = ribbon_twist.stability(first)
    assert 0 < symmetric < antisymmetric
    other = ribbon_twist.trace(NARROW, reading="rotation", count=2).states[0]
    # the same shape: what breaks one symmetry may keep the other, the lowest of all is the same
    assert min(ribbon_twist.stability(other)) == pytest.approx(symmetric, rel=1e-6)


def test_eigenvalue_vanishes_where_the_branch_folds(narrow):
    """The second variation knows nothing of continuation."""
    (fold,) = narrow.folds
    symmetric, antisymmetric = ribbon_twist.stability(fold.state)
    assert abs(symmetric) < 1e-4
    assert antisymmetric > 5
    before, after = narrow.states[fold.index - 3], narrow.states[fold.index + 4]
    assert ribbon_twist.stability(before)[0] > 0.05
    assert ribbon_twist.stability(after)[0] < -0.05
    assert fold.twist > narrow.twist.max() - 1e-9
    for state in narrow.states[: fold.index : 10]:
        assert min(ribbon_twist.stability(state)) > 0


def test_critical_twist_is_converged(narrow):
    """Other meshes and orders move the fold by less than 1e-6 rad."""
    for options in ({"elements": 12, "stages": 8}, {"elements": 32, "stages": 4, "layer": 0.01}):
        fold = ribbon_twist.trace(NARROW, stop_at_fold=True, **options).folds[0]
        assert fold.twist == pytest.approx(narrow.folds[0].twist, abs=1e-6)
    assert narrow.folds[0].twist == pytest.approx(2.01189, abs=1e-5)


def test_snap_changes_the_deflection_out_of_the_plane(narrow):
    """Beyond the fold: the image of the branch by reflection, (phi, y) -> (pi - phi, -y)."""
    fold = narrow.folds[0].state
    landed = ribbon_twist.equilibrium(NARROW, np.pi - fold.twist)
    assert min(ribbon_twist.stability(landed)) > 1
    out, up = fold.midpoint[1:] - landed.midpoint[1:] * [-1, 1]
    assert out > 0.15
    assert abs(up) < 0.1 * out


def test_image_by_reflection_is_an_equilibrium():
    """A ribbon turned over at both clamps, phi -> pi - phi and y -> -y, by integration."""
    state = ribbon_twist.equilibrium(NARROW, 0.7)
    k = state.clamp_strains
    family = ribbon_twist._family(NARROW, "mirror", 24, 5, 0.03)
    y = state.solution.nodes
    image = y.copy()
    image[:, 1] *= -1
    # reflect the directors in y = 0 and turn them by half a turn about the tangent
    frames = np.array(directors(y[:, 3:7].T)).transpose(2, 0, 1)
    reflected = frames * [1, -1, 1]
    reflected[:, 0] *= -1
    assert np.allclose(np.linalg.det(reflected), 1)
    # strains of the image, from its frame's rotation: k1 -> k1, k2 -> -k2, k3 -> -k3
    image[:, 8:] *= -1
    q = np.array([_quaternion(f) for f in reflected])
    q *= np.sign((q * np.roll(q, 1, axis=0)).sum(axis=1, keepdims=True))[0]
    for i in range(1, len(q)):
        q[i] *= np.sign(q[i] @ q[i - 1])
    q *= np.sign(q[0, 0])
    image[:, 3:7] = q
    guess = family.start(image, np.array([state.force[0], 0.0, np.pi - state.twist]))
    found = family.fixed(guess, np.pi - state.twist)
    assert np.allclose(found.nodes[-1, :3], state.midpoint * [1, -1, 1], atol=1e-8)
    assert np.allclose(
        np.abs(found.nodes[0, 7:]), np.abs([NARROW.hard_bending, 1, 1] * k), atol=1e-6
    )


def _quaternion(frame):
    """Components first, directors in rows."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(frame.T).as_quat(), 1)


def test_wide_ribbon_does_not_snap(wide):
    """Stable up to half a turn; the folds beyond, at nu = 0.4, are images of each other."""
    assert wide.end == "range"
    assert wide.twist[0] == 0
    for state in wide.states[::15]:
        if state.twist < 3.13:
            assert min(ribbon_twist.stability(state)) > 0
    first, second = (fold.state for fold in wide.folds)
    assert first.twist > np.pi > second.twist
    assert first.twist + second.twist == pytest.approx(2 * np.pi, abs=1e-7)
    assert np.allclose(first.midpoint, second.midpoint * [1, -1, 1], atol=1e-4)


def test_branches_end_where_the_density_loses_convexity():
    ribbon = Ribbon(9.0, poisson_ratio=0.4)
    branch = ribbon_twist.trace(ribbon, elements=12, step=0.2)
    assert branch.end == "ellipticity"
    assert 0 < branch.margin[-1] < 0.3 * branch.margin[0]
    assert not branch.folds
    with pytest.raises(NotConverged, match="ellipticity"):
        ribbon_twist.equilibrium(ribbon, 2.2, elements=8)


def test_bad_input_is_named():
    with pytest.raises(InvalidInput, match="poisson_ratio"):
        Ribbon(8.0, poisson_ratio=0.7)
    with pytest.raises(InvalidInput, match="form"):
        Ribbon(8.0, form="other")
    with pytest.raises(InvalidInput, match="width"):
        Ribbon(-1.0)
    with pytest.raises(InvalidInput, match="reading"):
        ribbon_twist.trace(NARROW, reading="both")
    with pytest.raises(InvalidInput, match="layer"):
        ribbon_twist.trace(NARROW, layer=1.5)
    with pytest.raises(NotConverged, match="fold"):
        ribbon_twist.equilibrium(NARROW, 2.5, elements=12)


@pytest.mark.parametrize("stages", [2, 3])
def test_collocation_superconverges(stages):
    """Order 2 k at the nodes, on a pendulum through a fold of its period."""

    def right(y, p):
        return np.array([y[1], -p[0] * np.sin(y[0])])

    def ends(a, b, p):
        return np.array([a[0], b[0]])

    values = []
    for count in (8, 16, 64):
        family = Family(right, ends, np.linspace(0, 1, count + 1), stages)
        s = family.mesh
        start = np.stack([np.sin(np.pi * s), np.pi * np.cos(np.pi * s)], axis=1)
        # amplitude fixed by the rate at the left end: the load is the unknown
        guess = family.start(start, np.array([11.0]))
        row = np.zeros(guess.nodes.size + 1)
        row[1] = 1.0
        values.append(family._newton(guess, row, 4.0, 1e-12, 20).parameters[0])
    ratio = abs(values[0] - values[2]) / abs(values[1] - values[2])
    assert np.log2(ratio) == pytest.approx(2 * stages, abs=0.5)
    a, b, c = gauss(stages)
    assert b.sum() == pytest.approx(1)
    assert np.allclose(a.sum(axis=1), c)


def test_moment_along_the_force_vanishes_everywhere(wide):
    """So m2 = 0 at the clamp at a right angle, where the clamp's d2 is along x."""
    state = wide.states[np.abs(wide.twist - 1.2).argmin()]
    y = state.solution.nodes
    m2, m3 = WIDE.moments(y[:, 8], y[:, 9])
    frames = np.array(directors(y[:, 3:7].T))
    moment = np.einsum("in,ijn->jn", np.array([y[:, 7], m2, m3]), frames)
    assert np.allclose(moment[0], 0, atol=1e-6)
    k = ribbon_twist.equilibrium(WIDE, np.pi / 2).clamp_strains
    assert k[1] == pytest.approx(np.sqrt(k[2] ** 2 - WIDE.extensibility**-2), rel=1e-8)
    k = ribbon_twist.equilibrium(NARROW, np.pi / 2).clamp_strains
    assert abs(k[1]) < 1e-8
    assert abs(k[2]) < 1 / NARROW.extensibility


def test_convex_envelope_of_the_density():
    """The lower convex hull of sampled values, in the plane of k2 and k3."""
    from scipy.spatial import ConvexHull

    ribbon = Ribbon(10.0, poisson_ratio=0.4)
    c = ribbon.extensibility**-2
    k2, k3 = np.meshgrid(np.linspace(-6, 6, 61), np.linspace(-5, 5, 51), indexing="ij")
    density = ribbon.energy_density(0, k2, k3)
    flat = k3**2 > c + k2**2
    envelope = np.where(flat, 0.5 * ((2 + ribbon.twisting) * k3**2 - c), density)
    hull = ConvexHull(np.stack([k2.ravel(), k3.ravel(), density.ravel()], axis=1))
    lower = hull.equations[hull.equations[:, 2] < 0]
    planes = -(lower[:, :2] @ np.stack([k2.ravel(), k3.ravel()]) + lower[:, 3:]) / lower[:, 2:3]
    sampled = planes.max(axis=0).reshape(k2.shape)
    assert np.all(envelope <= density + 1e-12)
    assert np.abs(sampled - envelope).max() < 0.02 * np.ptp(envelope[flat])
    # never below the envelope by more than rounding, where the hull is exact: at its vertices
    assert np.all(sampled.ravel()[hull.vertices] >= envelope.ravel()[hull.vertices] - 1e-9)


def test_strains_that_jump():
    """Weierstrass and Erdmann's conditions, less energy than smooth strains, and virtual work."""
    ribbon = Ribbon(10.0, poisson_ratio=0.4)
    branch = ribbon_twist.trace_jump(ribbon, until=1.75)
    assert branch.twist[0] == pytest.approx(np.pi / 2, abs=1e-9)
    for state in branch.states[1::3]:
        element = int(np.flatnonzero(state.solution.mesh == state.jump)[0])
        left = state.solution.at(state.jump - 1e-9)[[8, 9]]
        right = state.solution.nodes[element, [8, 9]]
        assert left[0] == pytest.approx(-right[0], rel=1e-5)
        assert right[0] > 0.5
        assert left[1] == pytest.approx(right[1], rel=1e-6)
        assert np.allclose(ribbon.moments(*left), ribbon.moments(*right), atol=1e-4)
        assert abs(ribbon.moments(*right)[0]) < 1e-9
        assert state.convexity > -1e-9
    for state in branch.states[1], branch.states[-2]:
        smooth = ribbon_twist.equilibrium(ribbon, state.twist)
        assert smooth.convexity < 0
        assert state.energy < smooth.energy
    first, second = branch.states[-3], branch.states[-2]

    def moment(state):
        k = state.clamp_strains
        return -2 * ribbon.moments(k[1], k[2])[1]

    work = (second.twist - first.twist) * (moment(first) + moment(second)) / 2
    assert second.energy - first.energy == pytest.approx(work, rel=1e-4)
    with pytest.raises(InvalidInput, match="jump"):
        ribbon_twist.stability(second)
    with pytest.raises(InvalidInput, match="extensibility"):
        ribbon_twist.trace_jump(NARROW)


def test_fold_is_reached_on_a_detour(narrow):
    """The smooth branch ends before it, in the form without (1 - nu^2)."""
    ribbon = Ribbon(8.0, poisson_ratio=0.3, form="audoly-neukirch")
    fold = ribbon_twist.critical_twist(ribbon, elements=16)
    assert fold.convexity > 0.1
    symmetric, antisymmetric = ribbon_twist.stability(fold)
    assert abs(symmetric) < 1e-3
    assert antisymmetric > 1
    direct = ribbon_twist.critical_twist(NARROW, elements=12, stages=6)
    assert direct.twist == pytest.approx(narrow.folds[0].twist, abs=1e-6)


def test_threshold_depends_on_the_extensibility_length():
    """Forms differ by a factor of the width; the printed 1.24 lies between two of them."""
    nu = 0.4
    thesis = ribbon_twist.threshold_width(
        Ribbon(8.0, poisson_ratio=nu), tolerance=0.05, elements=10, stages=4
    )
    factor = (2 * (1 - nu**2)) ** 0.25
    assert thesis[0] < 1.194 < thesis[1] < 1.24 < factor * thesis[0]
    unit = math.sqrt(math.pi * 108.0 * 0.2)
    for scaled, survives in zip(thesis, (False, True), strict=True):
        other = Ribbon(factor * scaled * unit, poisson_ratio=nu, form="panda-jawed")
        found = ribbon_twist.trace(
            other, until=2.4, step=0.12, elements=10, stages=4, stop_at_fold=True
        )
        assert (found.end == "range") == survives
