"""Rings, helices and twisted rods: discrete rods against closed forms, most of them exact on the mesh."""

import numpy as np
import pytest

import lissome as ls
from lissome import rods
from lissome.errors import InvalidInput
from lissome.references import folding, helix, twist
from lissome.references.circles import RingSection, mode_threshold
from lissome.rods.quaternions import conjugate, exponential, multiply

SECTIONS = [
    RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256),
    RingSection(1.0, 1.0, 0.7),
    RingSection(3.0, 0.8, 1.9),
]


def circle(section, segments, turns=1):
    """Return a free ring of unit length that starts as a circle of several turns."""
    law = rods.Kirchhoff((section.out_of_plane, section.in_plane), section.torsion)
    ring = rods.ring(1.0, segments, law, about=2)
    more = 2 * np.pi * (turns - 1) / segments * np.arange(segments)[:, None] * [0.0, 1.0, 0.0]
    return ring.with_initial(rods.RodState(multiply(ring.initial.quaternions, exponential(more))))


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize(("turns", "mode"), [(1, 2), (2, 1), (2, 3), (3, 2), (3, 4)])
def test_circles_lose_stability_at_the_threshold_of_their_mesh(section, turns, mode):
    """Bifurcations are located by inertia alone; the thresholds on the mesh are exact."""
    exact = mode_threshold(section, turns, mode, segments=30)
    inside = exact - 0.02 * np.sign(mode - turns)
    ring = circle(section, 30, turns).with_phase(max(mode, 2))
    for over, stable in ((inside, True), (2 * exact - inside, False)):
        eq = ls.equilibrate(ring.with_overcurvature(over), require="any")
        assert eq.stable is stable
    branch = ls.follow(ring.with_overcurvature, inside, 2 * exact - inside, eigenvalues=False)
    (event,) = branch.events
    assert event.kind == "bifurcation"
    assert event.parameter == pytest.approx(exact, abs=event.uncertainty + 1e-9)


def test_thresholds_on_the_mesh_tend_to_the_continuum_with_second_order():
    for turns, mode in ((1, 2), (1, 0), (3, 2), (3, 4)):
        limit = mode_threshold(SECTIONS[0], turns, mode)
        near = [mode_threshold(SECTIONS[0], turns, mode, segments=n) - limit for n in (400, 800)]
        assert near[0] / near[1] == pytest.approx(4.0, rel=1e-3)


def test_ring_folds_from_one_turn_to_three_without_force():
    section, misses = SECTIONS[0], []
    for count in (80, 160):
        flat = ls.follow(circle(section, count).with_overcurvature, 1.0, 1.2, eigenvalues=False)
        fold = flat.switch(flat.events[0], stop=3.1, report_at=[1.5, 2.0, 2.7], on_fold="stop")
        meets = mode_threshold(section, 3, 2, segments=count)
        assert fold.events[-1].parameter == pytest.approx(meets, abs=1e-6)
        reported = [i for i, kind in enumerate(fold.table["kind"]) if kind == "reported"]
        assert fold.table["stable"].iloc[reported].all()
        for i in reported:
            eq = fold.equilibria[i]
            exact = folding.folded_ring(section, fold.table["parameter"].iloc[i])
            misses.append(eq.energy - exact.energy)
            assert np.abs(eq.forces).max() < 1e-8 * exact.moment
            assert np.ptp(eq.moment_vectors, axis=0).max() < 1e-8 * exact.moment
    assert np.array(misses[:3]) / misses[3:] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("turns", [1, 2, 3, 4])
def test_frames_of_a_ring_remember_the_parity_of_its_turns(turns):
    """The product of the hinge rotations, each with positive scalar part, is (-1)^k."""
    eq = ls.equilibrate(circle(SECTIONS[0], 60, turns).with_overcurvature(turns))
    frames = eq.state.quaternions
    hinges = multiply(conjugate(frames), np.roll(frames, -1, axis=0))
    total = np.array([1.0, 0.0, 0.0, 0.0])
    for q in hinges:
        total = multiply(total, q * np.sign(q[0]))
    assert total == pytest.approx([(-1.0) ** turns, 0.0, 0.0, 0.0], abs=1e-10)


def test_sections_of_an_undercurved_ring_turn_evenly():
    """cos(phi) = B_in O/(B_in - B_out) on the mesh, with the curvature of the polygon."""
    section, count, wanted = SECTIONS[0], 60, [-0.6, -0.1, 0.4, 0.8]
    flat = ls.follow(circle(section, count).with_overcurvature, 1.0, 0.7, eigenvalues=False)
    begins = mode_threshold(section, 1, 0, segments=count)
    assert flat.events[0].parameter == pytest.approx(begins, abs=1e-6)
    turned = flat.switch(
        flat.events[0], stop=-1.0, bounds=(-1.0, 1.0), on_fold="stop", report_at=wanted
    )
    assert turned.events[-1].parameter == pytest.approx(-begins, abs=1e-6)
    curvature = 2 * count * np.sin(np.pi / count)
    seen = 0
    for row, eq in zip(turned.table.itertuples(), turned.equilibria, strict=True):
        if row.kind != "reported":
            continue
        seen += 1
        assert row.stable
        cosine = section.in_plane * row.parameter * 2 * np.pi / curvature
        cosine /= section.in_plane - section.out_of_plane
        sine = np.sqrt(1 - cosine**2)
        assert eq.strains[:, 1] == pytest.approx(curvature * cosine, abs=1e-8)
        assert np.abs(eq.strains[:, 0]) == pytest.approx(curvature * sine, abs=1e-8)
        assert np.abs(eq.strains[:, 2]).max() < 1e-8
    assert seen == len(wanted)


def test_helix_under_an_axial_wrench_is_uniform_on_the_mesh():
    """All hinges have one strain, to round-off; force and torque are of second order."""
    exact = helix.uniform_helix(
        3.0, 4.0, bending=1.3, torsion=0.9, natural_curvature=2.0, natural_twist=3.0
    )
    misses = []
    for n in (50, 100):
        rod = rods.helix(
            2.0, n, rods.Kirchhoff(1.3, 0.9), curvature=3.0, torsion=4.0, stress_free=False
        ).with_natural(curvature_1=2.0, twist=3.0)
        eq = ls.equilibrate(rod.clamped("start", clamp="segment").clamped("end", clamp="segment"))
        assert np.ptp(eq.strains, axis=0).max() < 1e-10
        axis = eq.strains[0] @ (eq.directors[0] + eq.directors[1])
        axis /= np.linalg.norm(axis)
        assert np.cross(eq.forces, axis) == pytest.approx(0.0, abs=1e-9)
        misses.append(
            [eq.forces[0] @ axis - exact.force, eq.moment_vectors[0] @ axis - exact.torque]
        )
    assert np.array(misses[0]) / misses[1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("torque", [0.0, 5.0, 9.5])
def test_twisted_rod_between_clamps_buckles_at_greenhills_thrust(torque):
    """Second order to the root of the clamped rod's condition; in tension beyond 8.987."""
    wire, exact = rods.Kirchhoff(1.0, 0.8), twist.rod_thrust(torque, "clamped")
    turn, misses = np.array([0.0, 0.0, torque / 0.8]), []
    for n in (40, 80):
        middle = (np.arange(n)[:, None] + 0.5) / n
        rod = rods.straight(1.0, n, wire).clamped("start")
        rod = rod.with_initial(rods.RodState(exponential(middle * turn)))
        rod = rod.clamped("end", position=(0, 0, None), frame=exponential(turn))
        branch = ls.follow(
            lambda p, rod=rod: rod.loaded(end=(0, 0, -p)), exact - 4, exact + 3, eigenvalues=False
        )
        (event,) = branch.events
        assert (event.index_before, event.index_after) == (0, 2)  # any plane will do
        misses.append(event.parameter - exact)
    assert misses[0] / misses[1] == pytest.approx(4.0, rel=0.1)
    assert abs(4 * misses[1] - misses[0]) / 3 < 2e-3


def test_a_mesh_too_coarse_for_its_waves_is_refused():
    with pytest.raises(InvalidInput, match="`segments` is 8; 3 turns and 4 waves need more than 8"):
        mode_threshold(SECTIONS[0], 3, 4, segments=8)
