"""What supports exert: the derivative of the energy, in balance with the loads, as in closed forms."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome import ribbons, rods
from lissome.beams import ClampedStrip, ParallelLight, Ring
from lissome.errors import InvalidInput
from lissome.reactions import Reaction, Reactions
from lissome.references import clamped_strip, elastica


def slope(energy, h):
    """Derivative at 0, with an error of order h^4."""
    return (energy(-2 * h) - 8 * energy(-h) + 8 * energy(h) - energy(2 * h)) / (12 * h)


# ---- the mapping ---------------------------------------------------------------------------------


def test_forces_at_two_places_have_a_moment_about_any_third():
    rng = np.random.default_rng(3)
    ones = [Reaction(*rng.normal(size=(3, 3)), name) for name in ("a", (0.0, 1.0))]
    point = rng.normal(size=3)
    found = Reactions(ones, aliases={7: "a"})
    total = found.total(point)
    assert total.force == pytest.approx(ones[0].force + ones[1].force, rel=1e-14)
    moment = sum(one.moment + np.cross(one.position - point, one.force) for one in ones)
    assert total.moment == pytest.approx(moment, rel=1e-13)
    assert found.total().moment_about(point) == pytest.approx(moment, rel=1e-12)
    assert found[7] is found["a"] is ones[0]
    assert found[np.array([0, 1])] is ones[1]
    assert ("a" in found, "b" in found, len(found)) == (True, False, 2)
    assert found.get("a") is ones[0]
    assert (found.get("b"), found.get("b", 5), found.get(np.array(3))) == (None, 5, None)
    table = found.to_frame()
    assert list(table.support) == ["a", (0.0, 1.0)]
    assert list(table[["force_x", "force_y", "force_z"]].iloc[1]) == list(ones[1].force)


def test_bad_input_says_what_to_do():
    one = Reaction(np.ones(3), np.zeros(3), np.zeros(3), "left")
    with pytest.raises(InvalidInput, match="supported are: 'left'"):
        Reactions([one])["right"]
    with pytest.raises(InvalidInput, match="two of the support 'left'"):
        Reactions([one, one])
    with pytest.raises(InvalidInput, match="force"):
        Reaction(np.ones(2), np.zeros(3), np.zeros(3), "left")
    spring = ls.DenseStructure([2.0], lambda x: x[0] ** 2, lambda x: 2 * x, lambda x: [[2.0]])
    with pytest.raises(InvalidInput, match="DenseStructure does not tell"):
        ls.equilibrate(spring).reactions()


def test_a_structure_of_ones_own_tells_its_reactions():
    class Spring(ls.DenseStructure):
        def reactions(self, equilibrium):
            pull = (-2.0 * float(equilibrium.state.x[0] - 1.0), 0.0, 0.0)
            return Reactions([Reaction(pull, np.zeros(3), np.zeros(3), "wall")])

    def energy(x):
        return (x[0] - 1.0) ** 2 - 0.5 * x[0]

    spring = Spring([2.0], energy, lambda x: 2 * (x - 1.0) - 0.5, lambda x: [[2.0]])
    assert ls.equilibrate(spring).reactions("wall").force[0] == pytest.approx(-0.5, rel=1e-12)


# ---- strips and rings ----------------------------------------------------------------------------

STRIPS = {
    "level": ClampedStrip(span=0.9, segments=40),
    "tilted": ClampedStrip(span=0.7, segments=40, end_angles=(0.3, -0.2), rise=0.1,
                           natural_curvature=lambda s: 2 * np.sin(7 * s)),
    "segment": ClampedStrip(span=0.8, segments=40, clamp="segment", end_angles=(0.1, 0.4)),
    "one hinge": ClampedStrip(span=0.8, segments=40, ends=("hinged", "clamped"), rise=0.05),
    "two hinges": ClampedStrip(span=0.8, segments=40, ends=("hinged", "hinged")),
}  # fmt: skip


@pytest.mark.parametrize("name", STRIPS)
def test_supports_of_a_strip_balance_each_other(name):
    found = ls.equilibrate(STRIPS[name]).reactions()
    total = found.total((0.3, -0.2, 0.0))
    scale = np.linalg.norm(found["end"].force)
    assert scale > 1
    assert np.max(np.abs(total.force)) < 1e-12 * scale
    assert np.max(np.abs(total.moment)) < 1e-11 * scale
    for i, end in enumerate(("start", "end")):
        hinged = STRIPS[name].ends[i] == "hinged"
        assert (found[end].moment[2] == 0.0) == hinged


@pytest.mark.parametrize("name", STRIPS)
def test_work_of_moving_and_turning_the_ends_of_a_strip(name):
    from dataclasses import replace

    strip = STRIPS[name]
    here = ls.equilibrate(strip)
    end = here.reactions("end")

    def energy(**changes):
        return ls.equilibrate(replace(strip, **changes), start=here).energy

    assert slope(lambda d: energy(span=strip.span + d), 1e-3) == pytest.approx(
        end.force[0], rel=1e-5
    )
    scale = abs(end.force[0])
    across = slope(lambda d: energy(rise=strip.rise + d), 1e-3)
    assert across == pytest.approx(end.force[1], abs=1e-6 * scale)
    a, b = strip.end_angles
    for i, which in enumerate(("start", "end")):
        if strip.ends[i] == "clamped":
            turned = slope(
                lambda d, i=i: energy(end_angles=(a + d * (i == 0), b + d * (i == 1))), 1e-3
            )
            assert turned == pytest.approx(here.reactions(which).moment[2], abs=1e-5 * scale)


def test_clamps_of_a_buckled_strip_as_in_the_closed_form():
    exact = elastica.buckled_strip(0.9)
    errors = []
    for segments in (50, 100, 200):
        found = ls.equilibrate(ClampedStrip(span=0.9, segments=segments)).reactions()
        # It is bent upward at the start: the clamp turns the strip counterclockwise.
        errors.append(
            [
                found["start"].force[0] - exact.thrust,
                -found["start"].moment[2] - exact.end_curvature,
            ]
        )
    errors = np.abs(errors)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(2.0, abs=0.05)
    assert errors[-1] == pytest.approx(0.0, abs=5e-3)


def test_light_bends_and_does_not_push():
    """Whatever light has done, the two clamps balance each other in every row."""
    light = ParallelLight(4.0, angle=0.5)
    history = STRIPS["tilted"].under(light).run(until=0.4, step=0.02)
    for row in range(0, len(history), 5):
        total = history.reactions(row).total()
        scale = np.abs(history.forces[row]).max()
        assert np.max(np.abs([total.force, total.moment])) < 1e-9 * scale
    last = len(history) - 1
    strip = STRIPS["tilted"].with_curvature(history.curvature[last])
    again = ls.equilibrate(strip, history.state(last)).reactions("start")
    assert again.moment == pytest.approx(history.reactions(last)["start"].moment, rel=1e-7)


def test_a_ring_has_no_support():
    assert len(ls.equilibrate(Ring(segments=20)).reactions()) == 0


# ---- rods ----------------------------------------------------------------------------------------


def test_a_heavy_cantilever_rests_on_its_clamp():
    rod = rods.straight(1.0, 30, rods.Kirchhoff((1.0, 2.0), 1.5)).clamped("start")
    eq = ls.equilibrate(rod.loaded(distributed=(2.0, 0.0, 0.0), end=(0.0, 1.0, -0.5)))
    clamp = eq.reactions("start")
    assert clamp.force == pytest.approx([-2.0, -1.0, 0.5], rel=1e-12)
    middles = 0.5 * (eq.positions[1:] + eq.positions[:-1])
    loads = np.cross(middles, [2.0 / 30, 0, 0]).sum(axis=0)
    loads += np.cross(eq.positions[-1], [0.0, 1.0, -0.5])
    assert clamp.moment == pytest.approx(-loads, rel=1e-10)


def test_a_column_is_held_by_its_load_and_pushes_back_with_eulers():
    """Just buckled between a clamp and a clamp that slides: 4 pi^2 B/L^2."""
    rod = rods.straight(1.0, 200, rods.Kirchhoff((1.0, 3.0), 1.0)).clamped("start")
    eq = ls.equilibrate(rod.clamped("end", (0.0, 0.0, 1.0 - 1e-5)))
    found = eq.reactions()
    assert list(found) == ["start", "end"]
    assert found["start"].force[2] == pytest.approx(4 * math.pi**2, rel=2e-4)
    assert np.max(np.abs(found.total().force)) < 1e-9
    assert np.max(np.abs(found.total().moment)) < 1e-9


def test_supports_of_a_closed_rod_go_by_number():
    rod = rods.ring(1.0, 24, rods.Kirchhoff((1.0, 2.0), 1.0)).pinned(0)
    place = tuple(rod.positions(rod.initial)[12])
    rod = rod.clamped(12, tuple(place[k] - 0.03 * place[k] for k in range(3)))
    found = ls.equilibrate(rod).reactions()
    assert list(found) == [0, 12]
    total = found.total()
    assert np.linalg.norm(found[12].force) > 0.1
    assert np.max(np.abs([total.force, total.moment])) < 1e-9


def test_a_free_ring_has_no_support():
    ring = rods.ring(1.0, 24, rods.Kirchhoff((1.0, 2.0), 1.0))
    assert len(ls.equilibrate(ring).reactions()) == 0


# ---- ribbons -------------------------------------------------------------------------------------


def sheared(scheme):
    law = ribbons.Wunderlich(width=0.1, rigidity=10.0)
    strip = ribbons.straight(1.0, 40, law, scheme=scheme).clamped("start")

    def at(move, turn):
        place = np.array([0.1, 0.0, 0.75]) + move
        return strip.clamped("end", tuple(place), Rotation.from_rotvec(turn))

    return at


@pytest.mark.parametrize("scheme", ["staggered", "nodal", "cells", "moments"])
def test_clamps_of_a_ribbon_balance_and_work(scheme):
    at, zero = sheared(scheme), np.zeros(3)
    start = None
    if scheme == "moments":
        other = ls.equilibrate(sheared("staggered")(zero, zero))
        start = at(zero, zero).adapted(other)
    here = ls.equilibrate(at(zero, zero), start=start)
    found = here.reactions()
    total = found.total()
    assert np.max(np.abs([total.force, total.moment])) < 1e-10

    def energy(*motion):
        return ls.equilibrate(at(*motion), start=here).energy

    end = found["end"]
    for unit in np.eye(3):
        push = slope(lambda d, unit=unit: energy(d * unit, zero), 1e-4)
        turn = slope(lambda d, unit=unit: energy(zero, d * unit), 1e-4)
        assert push == pytest.approx(unit @ end.force, abs=1e-7)
        assert turn == pytest.approx(unit @ end.moment, abs=1e-7)


def test_clamps_of_a_ribbon_as_by_collocation():
    """The independent solution of the boundary value problem, singular at the inflections."""
    exact = clamped_strip.sheared_arch(1 / 12)
    # There the axis of the flat strip is x, and its width lies along y.
    known = np.concatenate(
        [np.roll(exact.solution.parameters[:3], -1), np.roll(exact.solution.parameters[3:6], -1)]
    )
    errors = []
    for segments in (30, 60, 120):
        law = ribbons.Wunderlich(width=1 / 12, rigidity=12.0)
        strip = ribbons.straight(1.0, segments, law, scheme="cells").clamped("start")
        end = ls.equilibrate(strip.clamped("end", (0.15, 0.0, 0.75))).reactions("end")
        found = np.concatenate([end.force, end.moment_about(np.zeros(3))])
        errors.append(np.linalg.norm(found - known) / np.linalg.norm(known))
    assert errors[-1] < 3e-3
    assert np.log2(errors[:-1]) - np.log2(errors[1:]) == pytest.approx(1.5, abs=0.5)
