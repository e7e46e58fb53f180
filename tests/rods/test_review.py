"""Facts about rods that are easily got wrong: what is neutral, half a turn, work done by supports."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome import rods
from lissome.errors import InvalidInput
from lissome.rods.quaternions import exponential, multiply

LAW = rods.Kirchhoff(bending=(1.0, 2.0), twisting=1.5)
ISOTROPIC = rods.Kirchhoff(1.0, 0.8)


def test_a_turn_that_leaves_a_support_at_second_order_is_not_neutral():
    """A buckled column whose tip is held aside in x turns about its axis, out of the plane.

    The turn meets the constraint to first order: as a neutral motion it would hide the instability.
    A section that is isotropic but for 1e-9 has no neutral motion, and the same stiffness.
    """
    found = []
    for law in (ISOTROPIC, rods.Kirchhoff((1.0, 1.0 + 1e-9), 0.8)):
        column = rods.straight(1.0, 40, law).clamped("start").loaded(end=[0, 0, -3.0])
        held = column.pinned("end", (0.1, None, None))
        plane = ls.equilibrate(held, require="any")
        assert abs(plane.positions[-1, 1]) < 1e-9
        found.append((plane.index, plane.smallest_eigenvalue()))
        stable = ls.equilibrate(held)
        assert stable.energy < plane.energy - 0.05
        assert abs(stable.positions[-1, 1]) > 0.5
    assert found[0][0] == found[1][0] == 1
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-6)
    assert found[0][1] < -0.1


@pytest.mark.parametrize("seed", range(4))
def test_a_couple_leaves_the_turn_about_its_force_neutral(seed):
    """The arm of the couple ends up along the force: only turns about the two are free."""
    random = np.random.default_rng(seed)
    force, arm = random.normal(size=(2, 3))
    rod = rods.straight(1.0, 6, LAW).with_natural(curvature_1=1.0, twist=random.normal())
    eq = ls.equilibrate(rod.pinned("start").loaded(couples={3: (force, arm)}))
    turned = eq.directors[3].T @ arm
    assert np.allclose(np.cross(turned, force), 0.0, atol=1e-12)
    assert turned @ force > 0
    assert eq.gauge.shape[0] == 1
    assert eq.smallest_eigenvalue() > 0.1


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0], [0.6, 0.8, 0]])
@pytest.mark.parametrize("angle", [np.pi, -3.14159, 3.1])
def test_clamp_turned_by_half_a_turn_at_once(axis, angle):
    frame = Rotation.from_rotvec(angle * np.array(axis))
    rod = rods.straight(1.0, 40, LAW).clamped("start").clamped("end", (0.0, 0.1, 0.8), frame)
    eq = ls.equilibrate(rod)
    assert eq.stable
    # the last frame is within half a hinge of the clamp
    gap = (eq.frames[-1].inv() * frame).magnitude()
    assert gap < 2 * np.linalg.norm(eq.strains[-1]) * eq.hinge_lengths[-1]


def test_nearly_straight_rod_twisted_by_half_a_turn():
    """Its energy is that of twist alone, C pi^2/2, but for the little slack."""
    frame = Rotation.from_rotvec([0, 0, np.pi])
    rod = rods.straight(1.0, 50, LAW).clamped("start").clamped("end", (0, 0, None), frame)
    assert ls.equilibrate(rod).energy == pytest.approx(1.5 * np.pi**2 / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("measure", "strain"), [("sine", 41.0), ("angle", 63.0), ("averaged", 63.0)]
)
def test_natural_strain_beyond_half_a_turn_is_refused(measure, strain):
    """A hinge would rest at half a turn, where its measure jumps, and pass for balanced."""
    rod = rods.straight(1.0, 20, LAW, measure=measure).clamped("start").with_natural(twist=strain)
    with pytest.raises(InvalidInput, match="more segments"):
        ls.equilibrate(rod)
    below = rods.straight(1.0, 40, LAW, measure=measure).with_natural(twist=strain)
    assert ls.equilibrate(below).energy < 1e-20


def test_bad_loads_name_their_argument():
    rod = rods.straight(1.0, 10, LAW)
    with pytest.raises(InvalidInput, match="`nodes`"):
        rod.loaded(nodes=[1.0, 2.0, 3.0])
    with pytest.raises(InvalidInput, match=r"segment 1\.5"):
        rod.loaded(couples={1.5: ([1, 0, 0], [0, 1, 0])})
    with pytest.raises(InvalidInput, match=r"couples\[1\]"):
        rod.loaded(couples={1: 3.0})


def pulled(kind, closed):
    """Return a function from displacement and turn of a support to a rod."""
    lengths = np.array([0.8, 1.2, 1.0, 0.9, 1.1, 1.3, 0.7, 1.0]) / 8
    if closed:
        rod = rods.ring(lengths=lengths, law=LAW, turns=0.3, natural_curvature=2.0).clamped(0)
        node, base = 4, rod.clamped(4).supports[-1]
        place, frame = np.array(base.position), base.frame
    else:
        rod = rods.straight(lengths=lengths, law=LAW).with_natural(curvature_1=1.0, twist=2.0)
        rod = rod.clamped("start", (0, 0, 0), [1, 0, 0, 0]).loaded(
            distributed=lambda s: np.stack([s, 1 - s, s**2], 1)
        )
        node = 4 if kind == "interior" else 8
        place, frame = (
            np.array([0.05, 0.1, 0.4 if kind == "interior" else 0.8]),
            np.array([1.0, 0, 0, 0]),
        )
    clamp = "segment" if kind == "segment" else "node"

    def at(shift, turn):
        new = multiply(exponential(np.asarray(turn, dtype=float)), frame)
        return rod.clamped(node, tuple(place + shift), new / np.linalg.norm(new), clamp=clamp)

    return node, at


@pytest.mark.parametrize(
    ("kind", "closed"), [("node", False), ("segment", False), ("interior", False), ("node", True)]
)
def test_work_of_a_moving_clamp_is_the_reaction(kind, closed):
    """dE = force . dx + moment . dphi, whatever holds the rod elsewhere."""
    node, at = pulled(kind, closed)
    zero = np.zeros(3)
    eq = ls.equilibrate(at(zero, zero))
    reaction = eq.reactions(node)
    h = 1e-4
    for unit in np.eye(3):
        work = [
            (
                ls.equilibrate(at(*(h * unit * m for m in motion)), eq).energy
                - ls.equilibrate(at(*(-h * unit * m for m in motion)), eq).energy
            )
            / (2 * h)
            for motion in ((1.0, 0.0), (0.0, 1.0))
        ]
        scale = 1 + np.abs(eq.forces).max()
        assert work[0] == pytest.approx(reaction.force @ unit, abs=1e-5 * scale)
        assert work[1] == pytest.approx(reaction.moment @ unit, abs=1e-5 * scale)
