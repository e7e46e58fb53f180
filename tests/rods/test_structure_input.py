"""What a rod refuses, and how it says so."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome import rods
from lissome.errors import InvalidInput, LissomeError, LissomeWarning, NotConverged
from lissome.rods import Kirchhoff, Rod, RodState

LAW = Kirchhoff(bending=(1.0, 2.0), twisting=1.5)
LENGTHS = np.full(10, 0.1)
ROD = Rod(LAW, LENGTHS)
RING = rods.ring(1.0, 12, LAW)
SKEW = np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]])
LEFT = np.diag([1.0, 1.0, -1.0])


class NaNLaw:
    strains = ("curvature_1", "curvature_2", "twist")
    count = None
    kernel = None

    def evaluate(self, k, order=2):
        n = len(k)
        return np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)


MADE_WRONG = {
    "one segment": (lambda: Rod(LAW, [1.0]), "lengths.*at least 2"),
    "negative length": (lambda: Rod(LAW, [0.1, -0.1, 0.1]), r"`lengths`\[1\] is -0.1"),
    "zero length": (lambda: Rod(LAW, [0.1, 0.0]), "greater than 0"),
    "length not a number": (lambda: Rod(LAW, [0.1, np.nan]), "finite"),
    "shape of lengths": (lambda: Rod(LAW, np.ones((3, 2))), "shape"),
    "shape of natural": (lambda: Rod(LAW, LENGTHS, np.zeros((10, 3))), "natural.*shape"),
    "natural beyond reach": (lambda: Rod(LAW, LENGTHS, np.full((11, 3), 15.0)), "more segments"),
    "law": (lambda: Rod(1.0, LENGTHS), "`law`"),
    "law of other mesh": (
        lambda: Rod(Kirchhoff((np.ones(5), np.ones(5)), np.ones(5)), LENGTHS),
        "5 nodes; the rod has 11",
    ),
    "law replaced": (lambda: ROD.with_law("steel"), "`law`"),
    "measure": (lambda: Rod(LAW, LENGTHS, measure="cosine"), "measure"),
    "stretching": (lambda: Rod(LAW, LENGTHS, stretching=-1.0), "stretching"),
    "joint of an open rod": (lambda: Rod(LAW, LENGTHS, joint=1.0), "closed"),
    "phase": (lambda: RING.with_phase(1), "at least 2"),
    "skew frame": (lambda: ROD.clamped("start", frame=SKEW), "orthonormal|right angles|perp|unit"),
    "left-handed frame": (lambda: ROD.clamped("start", frame=LEFT), "left-handed"),
    "long quaternion": (lambda: ROD.clamped("start", frame=[1, 1, 0, 0]), "length 1.41"),
    "shape of frame": (lambda: ROD.clamped("start", frame=[1, 0, 0]), "shape"),
    "several frames": (lambda: ROD.clamped("start", frame=Rotation.random(2)), "several"),
    "NaN frame": (lambda: ROD.clamped("start", frame=np.full((3, 3), np.nan)), "finite"),
    "position": (lambda: ROD.pinned("end", (0, 0)), "three components"),
    "NaN position": (lambda: ROD.pinned("end", (0, np.nan, 0)), r"position\[1\]"),
    "end of a ring": (lambda: RING.clamped("end"), "no ends"),
    "node": (lambda: ROD.pinned(11), "numbered 0 to 10"),
    "name of an end": (lambda: ROD.pinned("strat"), "did you mean 'start'"),
    "clamp": (lambda: ROD.clamped("start", clamp="full"), "clamp"),
    "segment inside": (lambda: ROD.clamped(4, clamp="segment"), "segment"),
    "no axis": (lambda: ROD.hinged("end", axis=(0, 0, 0)), "axis"),
    "moment": (lambda: ROD.hinged("end", axis=(0, 0, 1), moment=np.inf), "moment"),
    "force": (lambda: ROD.loaded(end=[1, 2]), "end.*shape"),
    "distributed": (lambda: ROD.loaded(distributed=np.ones((4, 3))), "distributed"),
    "arm alone": (lambda: ROD.loaded(arm=[1, 0, 0]), "arm"),
    "couple": (lambda: ROD.loaded(couples={10: ([1, 0, 0], [0, 1, 0])}), "numbered 0 to 9"),
    "couple in the middle": (
        lambda: ROD.loaded(couples={1.5: ([1, 0, 0], [0, 1, 0])}),
        "couples.*segment 1.5",
    ),
    "couple by truth": (
        lambda: ROD.loaded(couples={True: ([1, 0, 0], [0, 1, 0])}),
        "couples.*segment True",
    ),
    "couple without arm": (lambda: ROD.loaded(couples={1: 3.0}), "a force and an arm"),
    "couples in a list": (lambda: ROD.loaded(couples=[1, 2]), "couples.*list.*mapping"),
    "nodes in a list": (lambda: ROD.loaded(nodes=[1, 2, 3]), "nodes.*list.*mapping"),
    "natural curvature": (lambda: ROD.with_natural(curvature_1=np.ones(4)), "curvature_1"),
    "overcurvature": (lambda: ROD.with_overcurvature(2.0), "closed"),
    "quaternions": (lambda: RodState(np.ones((3, 4))), "unit"),
    "stretches": (lambda: RodState([[1, 0, 0, 0]] * 2, stretches=[1, -1]), "stretches"),
    "state of other mesh": (lambda: ROD.with_initial(RodState([[1, 0, 0, 0]] * 3)), "3 segments"),
}


@pytest.mark.parametrize("name", MADE_WRONG)
def test_rods_are_refused_when_they_are_made(name):
    make, message = MADE_WRONG[name]
    with pytest.raises(InvalidInput, match=message):
        make()


SOLVED_WRONG = {
    "out of reach": (ROD.clamped("start").clamped("end", (0, 0, 1.01)), "inextensible; bring"),
    "taut": (ROD.clamped("start").clamped("end"), "just as long"),
    "out of reach along one axis": (
        ROD.clamped("start").pinned("end", (None, 1.5, None)),
        "1.5 apart",
    ),
    "across a ring": (RING.pinned(0, (0, 0, 0)).pinned(6, (0.6, 0, 0)), "0.5 long"),
    "natural twist of more than half a turn": (
        ROD.clamped("start").with_natural(twist=21.0),
        "node 1 .*2.1;.*'sine'.*below 2: use more segments",
    ),
    "natural curvature of more than half a turn, with a start": (
        Rod(LAW, LENGTHS, np.full((11, 3), 15.0), initial=ROD.initial).clamped("start"),
        "more segments",
    ),
    "natural angle of more than half a turn": (
        Rod(LAW, LENGTHS, measure="angle").clamped("start").with_natural(curvature_2=32.0),
        "3.2;.*'angle'.*more segments",
    ),
    "nothing holds it": (ROD.loaded(end=[0, 1.0, 0]), "nothing holds the rod"),
    "held along z only": (
        ROD.pinned("start", (None, None, 0)).loaded(end=[1.0, 0, 0]),
        "along x",
    ),
    "NaN of a law": (Rod(NaNLaw(), LENGTHS).clamped("start"), "not finite"),
    "shape of a distributed load": (
        ROD.clamped("start").loaded(distributed=lambda s: np.ones(7)),
        "distributed",
    ),
    "no segment left": (
        Rod(LAW, [0.1, 0.1]).clamped("start", clamp="segment").clamped(
            "end", (0.05, 0, 0.15), clamp="segment"
        ),
        "free",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLVED_WRONG)
def test_rods_without_equilibrium_are_refused_when_they_are_solved(name):
    rod, message = SOLVED_WRONG[name]
    with pytest.raises(InvalidInput, match=message):
        ls.equilibrate(rod)


@pytest.mark.parametrize(
    ("measure", "strain"),
    [("sine", {"twist": 19.0}), ("angle", {"curvature_1": 25.0}), ("averaged", {"twist": 25.0})],
)
def test_natural_strains_short_of_half_a_turn_are_attained(measure, strain):
    rod = Rod(LAW, LENGTHS, measure=measure).clamped("start").with_natural(**strain)
    eq = ls.equilibrate(rod)
    assert eq.stable
    assert eq.energy < 1e-18
    assert np.max(eq.strains) == pytest.approx(max(strain.values()), rel=1e-10)


def test_averaged_curvature_has_no_bound():
    """It is 2 tan(angle/2) over the length, so that hinges of half a turn are infinitely far."""
    rod = Rod(LAW, LENGTHS, measure="averaged").clamped("start").with_natural(curvature_1=50.0)
    assert ls.equilibrate(rod).energy < 1e-18


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1)])
def test_a_moment_that_no_hinge_withstands_asks_for_more_segments(axis):
    """The moment of a hinge, B/l sin(angle), is at most B/l: 1/0.1 and 1.5/0.1."""
    rod = ROD.clamped("start")
    with pytest.raises(
        NotConverged, match=r"hinge at node .* nearly half a turn: use more segments"
    ):
        ls.equilibrate(rod.hinged("end", (None, None, None), axis=axis, moment=16.0))


def test_a_hinge_of_half_a_turn_is_warned_of():
    """Under a thrust far beyond B/l^2 the column folds back on itself at its first hinge.

    That is a minimum of the energy of the discrete rod: the verdict stands.
    """
    rod = ROD.clamped("start").loaded(end=[0, 0, -600.0])
    with pytest.warns(LissomeWarning, match="hinge at node 0 turns by nearly half a turn"):
        eq = ls.equilibrate(rod)
    assert eq.positions[-1] == pytest.approx([0, 0, -1.0], abs=1e-6)
    assert ls.smallest_eigenvalue(rod, eq.state, eq.multipliers).values[0] > 0


def test_balanced_loads_need_no_support():
    eq = ls.equilibrate(ROD.loaded(start=[0, 0, -1.0], end=[0, 0, 1.0]))
    assert eq.stable
    assert np.allclose(eq.forces, [0, 0, 1.0])


def test_an_extensible_rod_may_be_stretched():
    """A straight rod in tension: (4.17) gives F = EA (e^2 - 1)/2 e."""
    rod = Rod(LAW, LENGTHS, stretching=50.0).clamped("start").clamped("end", (0, 0, 1.1))
    eq = ls.equilibrate(rod)
    assert np.allclose(eq.state.stretches, 1.1)
    assert eq.reactions("end").force[2] == pytest.approx(50.0 * (1.1**2 - 1) / 2 * 1.1, rel=1e-12)
    assert eq.stretching_energy == pytest.approx(eq.energy, rel=1e-12)


def test_states_of_another_rod_are_refused():
    eq = ls.equilibrate(ROD.clamped("start").loaded(end=[1, 0, 0]))
    with pytest.raises(InvalidInput, match="10 segments; the rod has 5"):
        ls.equilibrate(Rod(LAW, np.full(5, 0.2)).clamped("start"), eq.state)
    with pytest.raises(InvalidInput, match="pass a RodState"):
        ls.equilibrate(ROD.clamped("start"), eq.positions)


def test_a_node_without_support_has_no_reaction():
    eq = ls.equilibrate(ROD.clamped("start").loaded(end=[1, 0, 0]))
    with pytest.raises(InvalidInput, match="no support"):
        eq.reactions("end")


def test_arguments_are_not_kept_by_reference():
    lengths = LENGTHS.copy()
    force = np.array([1.0, 0, 0])
    rod = Rod(LAW, lengths).clamped("start").loaded(end=force)
    before = ls.equilibrate(rod).positions
    lengths[:], force[:] = 5.0, 7.0
    assert np.array_equal(ls.equilibrate(rod).positions, before)
    with pytest.raises(ValueError, match="read-only"):
        rod.lengths[0] = 1.0


@pytest.mark.parametrize("force", [1e150, 1e300])
def test_absurd_loads_end_in_an_error_of_the_library(force):
    rod = rods.straight(1.0, 20, rods.Kirchhoff((1.0, 1.3), 0.8)).clamped("start")
    with pytest.raises(LissomeError):
        ls.equilibrate(rod.loaded(end=[force, 0.0, 0.0]))


def test_clamps_of_segments_out_of_reach():
    """Their nodes are within reach of each other; those at the far ends of their segments are not."""
    rod = rods.straight(1.0, 10, LAW).clamped("start", clamp="segment")
    away = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    rod = rod.clamped("end", (0.0, 0.3, 0.85), away, clamp="segment")
    with pytest.raises(
        InvalidInput, match=r"clamps of segments hold nodes 1 and 9 at a distance of 0\.9"
    ):
        ls.equilibrate(rod)
