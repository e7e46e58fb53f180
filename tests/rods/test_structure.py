"""Equilibria of rods against closed forms, symmetry, and balance."""

import dataclasses

import numpy as np
import pytest

import lissome as ls
from lissome import rods
from lissome.errors import NotConverged
from lissome.references import elastica
from lissome.rods import Kirchhoff, Rod, RodState
from lissome.rods.quaternions import exponential, from_directors, multiply, rotate

LAW = Kirchhoff(bending=(1.0, 2.0), twisting=1.5)


def straight(segments, law=LAW, **options):
    return Rod(law, np.full(segments, 1.0 / segments), **options)


def ring(segments, law, turns=0.0, **options):
    """Return a circle in the plane z = 0, with d1 along z; `turns` of twist along it."""
    angle = 2 * np.pi * (np.arange(segments) + 0.5) / segments
    tangent = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    d1 = np.tile([0.0, 0.0, 1.0], (segments, 1))
    frames = from_directors(np.stack([d1, np.cross(tangent, d1), tangent], axis=1))
    spin = np.zeros((segments, 3))
    spin[:, 2] = 2 * np.pi * turns * np.arange(segments) / segments
    return Rod(
        law, np.full(segments, 1.0 / segments), closed=True, joint=2 * np.pi * turns,
        initial=RodState(multiply(frames, exponential(spin))), **options,
    )  # fmt: skip


# ---- cantilevers and columns -------------------------------------------------------------------


@pytest.mark.parametrize(("clamp", "order"), [("node", 2), ("segment", 1)])
def test_order_of_convergence_of_the_clamps(clamp, order):
    """The tip of a lightly loaded cantilever sinks by F/(3 B)."""
    errors = []
    for segments in (20, 40, 80):
        rod = straight(segments).clamped("start", clamp=clamp).loaded(end=[0, -1e-4, 0])
        errors.append(ls.equilibrate(rod).positions[-1, 1] / -1e-4 - 1 / 3)
    rates = np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
    assert np.all(np.abs(rates - order) < 0.05)


def test_bending_about_each_director_and_twisting_have_their_stiffness():
    force = 1e-6
    rod = straight(200).clamped("start")
    sideways = ls.equilibrate(rod.loaded(end=[force, 0, 0])).positions[-1, 0]
    assert sideways == pytest.approx(force / (3 * 2.0), rel=1e-4)  # about d2
    upward = ls.equilibrate(rod.loaded(end=[0, force, 0])).positions[-1, 1]
    assert upward == pytest.approx(force / (3 * 1.0), rel=1e-4)  # about d1
    # A couple about the tangent: forces along +-y at arms along x
    eq = ls.equilibrate(rod.loaded(couples={"end": ([0, force, 0], [1.0, 0, 0])}))
    end = eq.directors[-1, 0, 1]
    assert end == pytest.approx(force / 1.5 * (1 - 0.5 / 200), rel=1e-9)  # no half hinge at the tip


@pytest.mark.parametrize("segments", [50, 100])
def test_euler_load_by_the_sign_of_the_inertia(segments):
    """A column clamped below buckles at pi^2/4 times the lesser stiffness."""
    critical = np.pi**2 / 4
    error = 2.0 / segments**2  # of second order
    for load, index in ((critical - error, 0), (critical + error, 1)):
        rod = straight(segments).clamped("start").loaded(end=[0, 0, -load])
        assert ls.equilibrate(rod, require="any").index == index


def test_buckled_column_is_found_from_the_straight_one():
    rod = straight(40).clamped("start").loaded(end=[0, 0, -3.0])
    eq = ls.equilibrate(rod)
    assert eq.stable
    assert eq.positions[-1, 2] < 0.9
    assert abs(eq.positions[-1, 0]) < 1e-9  # it bends about d1, which is softer


def test_buckled_isotropic_column_has_a_neutral_plane_of_bending():
    rod = straight(40, Kirchhoff(1.0, 0.7)).clamped("start").loaded(end=[0, 0, -3.0])
    eq = ls.equilibrate(rod)
    assert eq.stable
    assert eq.gauge.shape[0] == 1
    bent, _ = eq.evaluation.kkt.apply(eq.gauge[0], np.zeros(0))
    assert np.max(np.abs(bent)) < 1e-9 * np.max(np.abs(eq.evaluation.kkt.band))
    mate = straight(40).clamped("start").loaded(end=[0, 0, -3.0])
    assert eq.energy == pytest.approx(ls.equilibrate(mate).energy, rel=1e-10)


@pytest.mark.parametrize("segments", [20, 100])
@pytest.mark.parametrize("clamp", ["node", "segment"])
@pytest.mark.parametrize("load", [-5.0, -1.0, 1.0])
def test_a_straight_isotropic_start_does_not_hide_the_neutral_plane(segments, clamp, load):
    """Straight, the rod does not move when it turns about its axis; buckled it does."""
    law = Kirchhoff(1.0, 0.7)
    rod = Rod(law, np.full(segments, 1.0 / segments)).clamped("start", clamp=clamp)
    rod = rod.clamped("end", position=(0, 0, 0.9), clamp=clamp)
    eq = ls.equilibrate(rod.loaded(distributed=(0, 0, load)))
    assert eq.stable
    assert eq.gauge.shape[0] == 1
    # What is left of the load when the force of the clamp is taken off is even about the middle.
    mirror = ls.equilibrate(rod.loaded(distributed=(0, 0, -load)))
    assert eq.energy - mirror.energy == pytest.approx(-0.9 * load, rel=1e-6)


# ---- uniform states ----------------------------------------------------------------------------


def test_natural_helix_is_free_of_stress_and_regular():
    """Hinges of uniform natural strain: nodes on a helix of the pitch that the screw has."""
    natural = np.tile([2.0, 0.0, 3.0], (61, 1))
    rod = Rod(LAW, np.full(60, 0.05), natural)
    eq = ls.equilibrate(rod)
    assert eq.energy < 1e-25
    steps = np.diff(eq.positions, axis=0)
    axis = np.cross(np.diff(steps, axis=0)[0], np.diff(steps, axis=0)[1])
    axis /= np.linalg.norm(axis)
    rise = steps @ axis
    assert np.allclose(rise, rise[0], atol=1e-12)


def test_arc_under_an_end_moment():
    """Each hinge turns by asin(M l / B); the half hinges at the ends by asin(M l / (2 B))."""
    segments, moment = 30, 1.7
    rod = (
        straight(segments)
        .clamped("start")
        .hinged("end", position=(None, None, None), axis=[1, 0, 0], moment=moment)
    )
    eq = ls.equilibrate(rod)
    l = 1.0 / segments
    turns = 2 * np.arcsin(0.5 * eq.strains[:, 0] * eq.hinge_lengths)
    assert np.allclose(turns[1:-1], np.arcsin(moment * l), rtol=1e-10)
    assert np.allclose(turns[[0, -1]], np.arcsin(moment * l / 2), rtol=1e-10)
    assert eq.state.angles[0] == pytest.approx(np.sum(turns), rel=1e-12)
    assert np.allclose(eq.moment_vectors, [moment, 0, 0], atol=1e-10)
    assert np.allclose(eq.reactions("start").moment, [-moment, 0, 0], atol=1e-10)


def test_a_naturally_curved_ring_is_a_circle_without_stress():
    segments = 50
    rod = ring(segments, LAW)
    at_rest = rod.with_natural(curvature_1=2 * segments * np.sin(np.pi / segments))
    eq = ls.equilibrate(at_rest)
    assert eq.energy < 1e-25
    radius = np.linalg.norm(eq.positions - eq.positions[:-1].mean(axis=0), axis=1)
    assert np.allclose(radius, 0.5 / segments / np.sin(np.pi / segments), atol=1e-13)


# ---- against the elastica ----------------------------------------------------------------------


def extrapolated(values):
    """Richardson's extrapolation on meshes N, 2 N, 4 N: errors in l^2 and (by the clamps) l^3."""
    coarse, middle, fine = np.asarray(values)
    return (8 * (4 * fine - middle) / 3 - (4 * middle - coarse) / 3) / 7


def test_cantilever_under_a_transverse_load_tends_to_the_elastica():
    exact = elastica.transverse_cantilever(6.0)
    tips, energies = [], []
    for segments in (40, 80, 160):
        eq = ls.equilibrate(straight(segments).clamped("start").loaded(end=[0, 6.0, 0]))
        tips.append(eq.positions[-1, [2, 1]])
        energies.append(eq.bending_energy)
    errors = np.array(tips) - [exact.x, exact.y]
    assert np.allclose(errors[:-1] / errors[1:], 4.0, rtol=0.03)
    assert np.allclose(extrapolated(tips), [exact.x, exact.y], atol=1e-7)
    assert extrapolated(energies) == pytest.approx(exact.energy, rel=1e-6)


def test_buckled_cantilever_tends_to_the_elastica():
    exact = elastica.compressed_cantilever(4.0)
    tips = []
    for segments in (40, 80, 160):
        eq = ls.equilibrate(straight(segments).clamped("start").loaded(end=[0, 0, -4.0]))
        tips.append([eq.positions[-1, 2], abs(eq.positions[-1, 1])])
    assert np.allclose(extrapolated(tips), [exact.x, exact.y], atol=1e-6)


def test_strip_between_clamps_tends_to_the_elastica():
    """Two clamped ends: the thrust is the multiplier of the distance, and the reaction."""
    exact = elastica.buckled_strip(0.9)
    thrusts, heights, energies = [], [], []
    for segments in (40, 80, 160):
        rod = straight(segments).clamped("start").clamped("end", position=(0, 0, 0.9))
        eq = ls.equilibrate(rod)
        thrusts.append(eq.reactions("start").force[2])
        heights.append(np.max(np.abs(eq.positions[:, 1])))
        energies.append(eq.bending_energy)
        assert np.allclose(eq.forces[:, 2], -thrusts[-1])
    assert extrapolated(thrusts) == pytest.approx(exact.thrust, rel=1e-6)
    assert extrapolated(heights) == pytest.approx(exact.height, rel=1e-6)
    assert extrapolated(energies) == pytest.approx(exact.energy, rel=1e-6)


def test_the_measures_have_one_limit_and_differ_at_second_order():
    tips = {}
    for measure in ("sine", "angle", "averaged"):
        tips[measure] = [
            ls.equilibrate(
                straight(n, measure=measure).clamped("start").loaded(end=[1.0, 5.0, -2.0])
            ).positions[-1]
            for n in (40, 80)
        ]
    for measure in ("angle", "averaged"):
        gap = [np.linalg.norm(a - b) for a, b in zip(tips["sine"], tips[measure], strict=True)]
        assert gap[0] > 1e-6
        assert gap[0] / gap[1] == pytest.approx(4.0, rel=0.05)


# ---- rings -------------------------------------------------------------------------------------


def test_twisted_isotropic_ring_loses_stability_at_michells_twist():
    """2 pi Tw = 2 pi sqrt(3) B/C (Michell 1889, Zajac 1962): one of a pair of modes is left."""
    law = Kirchhoff(1.0, 0.8)
    critical = np.sqrt(3.0) / 0.8
    for turns, index in ((critical - 0.02, 0), (critical + 0.02, 1)):
        eq = ls.equilibrate(ring(80, law, turns), require="any")
        assert eq.twist == pytest.approx(turns, abs=1e-12)
        assert eq.index == index
        # the twisting moment turns along the circle: a shear force C 2 pi Tw times its curvature
        force = 0.8 * (2 * np.pi * turns) * (2 * np.pi)
        assert np.linalg.norm(eq.forces[0]) == pytest.approx(force, rel=0.02)
        assert np.max(np.abs(eq.forces[:, :2])) < 1e-10 * force


def test_overcurved_ring_folds_to_the_triple_circle():
    """At the overcurvature 3 the folded ring is free of energy: three turns of the natural circle."""
    law = Kirchhoff((1.0, 4.0), 1.0)
    energies = []
    for segments in (60, 120):
        eq = ls.equilibrate(ring(segments, law).with_overcurvature(3.0))
        assert eq.stable
        energies.append(eq.energy)
        assert np.max(np.abs(eq.forces)) < 1e-6  # no force on this branch, by symmetry
    assert energies[1] < energies[0] / 10 < 1e-3


def test_ring_stays_closed_and_keeps_its_turns_of_twist():
    rod = ring(60, Kirchhoff((1.0, 1.5), 1.0), turns=1.3).with_natural(curvature_1=3.0)
    eq = ls.equilibrate(rod)
    assert eq.stable
    assert np.max(np.abs(eq.positions[-1] - eq.positions[0])) < 1e-13


def test_phase_that_is_pinned_exerts_no_force():
    """The multiplier of the phase condition is zero by symmetry; the lobes travel at no cost."""
    law = Kirchhoff((1.0, 1.0), 0.8)
    rod = ring(60, law).with_overcurvature(2.0)
    eq = ls.equilibrate(rod)
    assert eq.energy < ls.equilibrate(rod, require="any").energy  # that is the circle
    assert eq.structure.constraint_names[-1] == "phase of 2 lobes"
    assert abs(eq.multipliers[-1]) < 1e-8 * np.max(np.abs(eq.moments))
    free = eq.structure.with_phase(None)
    soft = ls.smallest_eigenvalue(free, eq.state, eq.multipliers[:3], count=2).values
    assert abs(soft[0]) < 1e-6 * soft[1]


# ---- balance -----------------------------------------------------------------------------------


def uneven():
    rng = np.random.default_rng(1)
    n = 24
    lengths = (0.5 + rng.random(n)) / n
    s = np.linspace(0, 1, n + 1)
    natural = np.stack([2 * np.sin(3 * s), 1 + s, 3 * np.cos(2 * s)], axis=1)
    turned = exponential([0.3, 0.2, 0.1])
    rod = Rod(LAW, lengths, natural)
    soft = Rod(LAW, lengths, natural, stretching=1e4)
    closed = Rod(LAW, lengths, natural, closed=True, joint=0.7)
    soft_closed = Rod(LAW, lengths, natural, closed=True, joint=0.7, stretching=1e4)
    along = {"measure": "averaged"}
    return {
        "cantilever": rod.clamped("start").loaded(
            end=[1, 2, 3], distributed=lambda s: np.stack([s, s**2, 1 - s], axis=1)
        ),
        "segment at end": rod.clamped("end", clamp="segment").loaded(start=[1, 2, 3]),
        "segment at start": rod.clamped("start", clamp="segment").loaded(
            end=[1, 2, 3], couples={"start": ([0, 1, 0], [0.1, 0, 0])}
        ),
        "clamped": rod.clamped("start").clamped("end", (0.1, 0.2, 0.3), turned),
        "averaged": Rod(LAW, lengths, natural, **along).clamped("start").pinned("end", (0.1, 0, 0)),
        "extensible": soft.clamped("start")
        .pinned("end", (0.1, 0.1, 1))
        .loaded(nodes={3: [1, 0, 2]}),
        "hinged": rod.hinged("start", axis=[1, 2, 0.5], moment=0.3).clamped(
            "end", (0.1, None, 0.3)
        ),
        "interior": rod.clamped("start")
        .hinged(9, (0.1, 0.1, 0.2), axis=[0, 1, 1])
        .clamped(16, (0, 0, 0.3), turned)
        .pinned("end", (0.1, None, 0.3)),
        "couples": rod.pinned("start").loaded(
            end=[1, 0, 2], arm=[0.1, 0.2, 0], couples={2: ([0, 1, 1], [0, 0.3, 0.1])}
        ),
        "pendulum": rod.pinned("start").loaded(end=[0, 0, -2]),
        "between pins": rod.pinned("start").pinned("end", (0.5, 0, 0)),
        "ring": closed,
        "extensible ring": soft_closed,
        "clamped ring": closed.clamped(0).clamped(9, (0, 0, 0.2), turned),
        "loaded ring": soft_closed.pinned(2).loaded(nodes={15: [0, 1, 0], 2: [0, 0, 3]}),
    }


@pytest.mark.parametrize("name", uneven())
def test_reactions_balance_the_loads(name):
    rod = uneven()[name]
    eq = ls.equilibrate(rod)
    assert eq.stable
    places, loads = eq.positions, rod.layout.node_forces
    force = loads.sum(axis=0)
    moment = np.cross(places, loads).sum(axis=0)
    scale = 1.0 + np.max(np.abs(eq.moment_vectors)) + np.max(np.abs(eq.forces))
    for support in rod.supports:
        reaction = eq.reactions(support.node)
        force = force + reaction.force
        moment = moment + np.cross(places[support.node], reaction.force) + reaction.moment
        if support.axis is not None:
            moment = moment + support.moment * support.axis
    for j, (f, arm) in rod.loads.couples.items():
        moment = moment + np.cross(rotate(eq.state.quaternions[j], arm), f)
    assert np.max(np.abs(force)) < 1e-12 * scale
    assert np.max(np.abs(moment)) < 1e-12 * scale
    for support in rod.supports:  # supports hold what they prescribe
        for k, value in enumerate(support.position):
            assert value is None or places[support.node, k] == pytest.approx(value, abs=1e-11)
    potential = -np.sum(loads * places) - sum(
        f @ rotate(eq.state.quaternions[j], arm) for j, (f, arm) in rod.loads.couples.items()
    )  # fmt: skip
    potential -= sum(
        s.moment * eq.state.angles[i]
        for i, s in enumerate(s for s in rod.supports if s.kind == "hinged")
    )
    assert eq.load_energy == pytest.approx(potential, rel=1e-12, abs=1e-12)
    total = eq.bending_energy + eq.stretching_energy + potential
    assert eq.energy == pytest.approx(total, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", ["pendulum", "between pins"])
def test_neutral_rotations_are_found(name):
    rod = uneven()[name]
    eq = ls.equilibrate(rod)
    assert eq.gauge.shape[0] == 1
    bent, moved = eq.evaluation.kkt.apply(eq.gauge[0], np.zeros(rod.constraints_count))
    assert np.max(np.abs(bent)) < 1e-9 * np.max(np.abs(eq.evaluation.kkt.band))
    assert np.max(np.abs(moved), initial=0.0) < 1e-12


@pytest.mark.parametrize(
    ("place", "kind", "stretching"),
    [
        ((0.0, 0.0, 0.36), "clamped", 4e5),
        ((0.0, 0.0, 0.5), "pinned", 1e4),
        ((0.1, -0.04, 0.46), "pinned", 1e6),
        ((-0.3, -0.1, 0.25), "clamped", 6e3),
    ],
)
def test_extensible_rods_between_near_supports_bend(place, kind, stretching):
    """Not squeezed at the start. The energy is that without stretch less n^2 / 2S, to first order in 1/S."""
    rod = rods.straight(1.0, 20, rods.Kirchhoff((1.0, 3.0), 1.0)).clamped("start")
    rod = getattr(rod, kind)("end", place)
    stiff = ls.equilibrate(rod)
    energies = []
    for factor in (1.0, 2.0):
        soft = dataclasses.replace(rod, stretching=factor * stretching)
        found = ls.equilibrate(soft)
        assert np.abs(found.state.stretches - 1.0).max() < 0.02
        energies.append(found.energy)
    tension = np.einsum("ij,ij->i", stiff.forces, np.diff(stiff.positions, axis=0)) / rod.lengths
    release = float(np.sum(tension**2 * rod.lengths)) / (2.0 * stretching)
    limit = 2.0 * energies[1] - energies[0]
    assert limit == pytest.approx(stiff.energy, rel=1e-4)
    assert limit - energies[0] == pytest.approx(release, rel=0.02)


def test_a_segment_that_is_squeezed_to_nothing_is_named():
    """A column of the stiffness 40 that would bear 4 pi^2 is crushed before it buckles."""
    rod = rods.straight(1.0, 20, rods.Kirchhoff(1.0, 1.0), stretching=40.0).clamped("start")
    with pytest.raises(NotConverged, match=r"squeezed to nothing.*stiffness larger"):
        ls.equilibrate(rod.clamped("end", (0.0, 0.0, 0.5)))


@pytest.mark.parametrize("stretching", [None, 1e3])
@pytest.mark.parametrize("bending", [1.0, (1.0, 3.0)])
def test_a_load_on_a_pin_changes_its_reaction_and_nothing_else(bending, stretching):
    """A bent rod turns about the line through its pins, with or without forces on these."""
    law = rods.Kirchhoff(bending, 1.0)
    rod = rods.straight(1.0, 12, law, stretching=stretching)
    rod = rod.pinned("start", (0.0, 0.0, 0.0)).pinned("end", (0.1, 0.0, 0.7))
    plain = ls.equilibrate(rod)
    force = np.array([1.0, -2.0, 3.0])
    loaded = ls.equilibrate(rod.loaded(end=force, start=[0.0, 4.0, 1.0]), plain)
    assert loaded.stable
    assert len(loaded.gauge) == len(plain.gauge) == (2 if bending == 1.0 else 1)
    assert loaded.positions == pytest.approx(plain.positions, abs=1e-8)
    assert loaded.smallest_eigenvalue() == pytest.approx(plain.smallest_eigenvalue(), rel=1e-6)
    change = loaded.reactions("end").force - plain.reactions("end").force
    assert change == pytest.approx(-force, abs=1e-7)


@pytest.mark.parametrize("support", ["pinned", "free"])
def test_a_couple_turns_about_its_force_at_no_cost(support):
    """The arm comes to lie along the force; all motions but the rotation about it are stiff."""
    force = np.array([1.0, 2.0, 2.0])
    rod = straight(20).loaded(couples={19: (force, [0.2, 0.1, 0.05])})
    rod = rod.pinned("start") if support == "pinned" else rod
    eq = ls.equilibrate(rod)
    arm = rotate(eq.state.quaternions[19], [0.2, 0.1, 0.05])
    assert np.linalg.norm(np.cross(arm, force)) < 1e-10
    assert eq.stable
    assert eq.gauge.shape[0] == 1
    turn = rotate(eq.state.quaternions, eq.gauge[0].reshape(-1, 3))
    assert np.allclose(turn, turn[0], atol=1e-12)
    assert np.linalg.norm(np.cross(turn[0], force)) < 1e-9 * np.linalg.norm(turn[0])
    least = ls.smallest_eigenvalue(rod, eq.state, eq.multipliers).values[0]
    assert least > 0.1


def test_energy_tells_the_reaction():
    """The derivative of the energy with respect to a support's position is the reaction there."""
    rod = uneven()["clamped"]

    def at(x):
        return ls.equilibrate(rod.pinned("start").clamped("start", (x, 0, 0)))

    h = 1e-4
    slope = (at(h).energy - at(-h).energy) / (2 * h)
    assert slope == pytest.approx(at(0.0).reactions("start").force[0], rel=1e-6)


def test_turned_clamps_carry_the_state_along():
    """Both clamps turn by the same angle in one step: the rod turns with them, rigidly."""
    rod = straight(40).clamped("start").clamped("end", (0, 0.2, 0.8))
    eq = ls.equilibrate(rod)
    turn = exponential([0.0, 2.5, 0.0])
    moved = straight(40).clamped("start", (0, 0, 0), turn)
    moved = moved.clamped("end", tuple(rotate(turn, [0, 0.2, 0.8])), turn)
    adopted = moved.adopt(eq.state)
    assert np.allclose(moved.positions(adopted), rotate(turn, eq.positions), atol=1e-12)
    assert moved.evaluate(adopted, np.zeros(3), 0).energy == pytest.approx(eq.energy, rel=1e-12)


HALF_TURNS = {
    "about the axis": ((0, 0, 0.8), [0, 0, 1]),
    "about the softer director": ((0, 0.3, 0.3), [1, 0, 0]),
    "about the stiffer director": ((0, 0.3, 0.3), [0, 1, 0]),
    "about a line askew": ((0.1, 0.3, 0.3), [2, 1, 2]),
}


@pytest.mark.parametrize("clamp", ["node", "segment"])
@pytest.mark.parametrize("name", HALF_TURNS)
def test_a_clamp_turns_by_half_a_turn_in_one_step(name, clamp):
    """From the straight rod to the equilibrium that small turns of the clamp lead to."""
    place, axis = HALF_TURNS[name]
    axis = np.array(axis) / np.linalg.norm(axis)
    rod = straight(40).clamped("start", clamp=clamp)

    def turned(angle):
        frame = exponential(angle * axis)
        return ls.equilibrate(rod.clamped("end", place, frame, clamp=clamp))

    there = turned(np.pi)
    assert there.stable
    eq = turned(2.6)
    for angle in (2.8, 3.0, np.pi):
        frame = exponential(angle * axis)
        eq = ls.equilibrate(rod.clamped("end", place, frame, clamp=clamp), eq)
    assert there.energy == pytest.approx(eq.energy, rel=1e-10)
    assert np.allclose(there.positions, eq.positions, atol=1e-8)
    short = np.pi - 3.14159  # the energy is smooth there: its slope is the moment of the clamp
    assert turned(3.14159).energy == pytest.approx(
        there.energy - short * (there.reactions("end").moment @ axis), abs=1e2 * short**2
    )


def test_state_survives_saving(tmp_path):
    from lissome.structure import load_state

    eq = ls.equilibrate(uneven()["hinged"])
    eq.save(tmp_path / "rod.npz")
    state = load_state(tmp_path / "rod.npz", RodState)
    again = ls.equilibrate(eq.structure, state, eq.multipliers)
    assert again.iterations <= 1
    assert np.allclose(again.positions, eq.positions, atol=1e-13)


def test_branch_of_a_strip_under_compression():
    """`follow` works on rods: the thrust at its end is that of the elastica, at second order."""
    thrusts = []
    for segments in (25, 50):
        rod = straight(segments).clamped("start")
        branch = ls.follow(
            lambda span, rod=rod: rod.clamped("end", (0, 0, span)),
            0.95, 0.85, outputs={"thrust": lambda eq: -eq.forces[0, 2]},
        )  # fmt: skip
        assert set(branch.table["index"]) == {0}
        thrusts.append(branch.table["thrust"].iloc[-1])
    exact = elastica.buckled_strip(0.85).thrust
    assert (4 * thrusts[1] - thrusts[0]) / 3 == pytest.approx(exact, rel=1e-4)


def test_difference_of_states_undoes_retraction():
    rod = straight(20).clamped("start")
    rng = np.random.default_rng(0)
    state = rod.retract(rod.start(), 0.5 * rng.standard_normal(rod.size))
    for size in (0.0, 1e-12, 1e-3, 1.5):  # turns of less than pi
        step = size * rng.uniform(-1.0, 1.0, rod.size)
        found = rod.difference(state, rod.retract(state, step))
        assert found == pytest.approx(step, abs=2e-15 + 1e-14 * size)
    turned = RodState(-state.quaternions, state.origin)  # the same frames
    assert np.max(np.abs(rod.difference(state, turned))) < 2e-15
