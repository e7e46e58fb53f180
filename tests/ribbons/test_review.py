"""Wrong results that a ribbon must not return as good ones."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons
from lissome.errors import InvalidInput, LissomeWarning, NotConverged

LAW = ribbons.Wunderlich(width=0.1, rigidity=1.0, poisson_ratio=0.3)


@pytest.fixture(scope="module")
def right():
    return ls.equilibrate(ribbons.band(1.0, 40, LAW, 1))


@pytest.mark.parametrize("name", ["natural_curvature", "natural_cross_curvature"])
@pytest.mark.parametrize("scheme", ["staggered", "nodal"])
def test_a_curved_moebius_band_does_not_care_about_the_name_of_its_sides(name, scheme):
    """Turning the strip about its tangent by half a turn changes the sign of its curvature at rest.

    With the inflection held at the joint, one of the two is a saddle of higher energy.
    """
    energies = []
    for value in (-3.0, 3.0):
        band = ribbons.band(1.0, 40, replace(LAW, **{name: value}), 1, scheme=scheme)
        assert not band.pins_phase
        energies.append(ls.equilibrate(band).energy)
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_a_twisted_moebius_band_keeps_its_free_phase():
    """Half a turn about the tangent does not change a natural twist: every place is like the others."""
    assert ribbons.band(1.0, 40, replace(LAW, natural_twist=2.0), 1).pins_phase


@pytest.mark.parametrize("half_turns", [-1, -5, 3])
def test_a_band_of_the_other_handedness_is_refused_as_a_start(right, half_turns):
    """A hinge and its opposite quaternion have the same strains."""
    other = ribbons.band(1.0, 40, LAW, half_turns)
    with pytest.raises(InvalidInput, match="handedness"):
        ls.equilibrate(other, start=right)
    with pytest.raises(InvalidInput, match="handedness"):
        other.adapted(right)


def test_a_doubly_covered_circle_is_no_cylinder():
    with warnings.catch_warnings():  # its covers touch: whether they pass is a matter of rounding
        warnings.simplefilter("ignore", LissomeWarning)
        double = ls.equilibrate(ribbons.band(1.0, 40, LAW, 2))
    with pytest.raises(InvalidInput, match="handedness"):
        ls.equilibrate(ribbons.band(1.0, 40, LAW, 0), start=double)


def test_starts_of_the_same_band_are_accepted(right):
    """Whatever the signs of its quaternions, its mesh or its scheme."""
    state = right.state
    signs = np.where(np.arange(40) % 3 == 0, -1.0, 1.0)[:, None]
    again = ls.equilibrate(
        right.structure, start=replace(state, quaternions=signs * state.quaternions)
    )
    assert again.energy == pytest.approx(right.energy, rel=1e-12)
    nodal = ribbons.band(1.0, 50, LAW, 1, scheme="nodal")
    assert ls.equilibrate(nodal, start=nodal.adapted(right)).link == pytest.approx(0.5)


def test_twist_and_writhe_of_a_turned_circle_add_up_to_the_turn():
    """Its ends meet; rounding errors where they touch are no crossing.

    The frame of the clamp halves the hinge where the ends meet: a difference of second order.
    """
    assert ls.equilibrate(ribbons.circle(1.0, 40, LAW)).writhe == pytest.approx(0.0, abs=1e-12)
    worst = []
    for segments in (40, 80):
        found, off = None, []
        for turn in np.linspace(0.0, 1.2 * math.pi, 7):
            ribbon = ribbons.circle(1.0, segments, LAW, turn=float(turn))
            found = ls.equilibrate(ribbon, start=found)
            off.append(abs(found.twist + found.writhe - turn / (2 * math.pi)))
        worst.append(max(off))
    assert worst[0] < 4e-3
    assert worst[1] < 0.35 * worst[0]


def test_sadowsky_keeps_no_ruling_of_a_clamp():
    strip = ribbons.straight(1.0, 20, LAW).clamped("start", ruling=0.0)
    thin = ribbons.Sadowsky(width=0.1, rigidity=1.0)
    with pytest.raises(InvalidInput, match=r"`ruling`.*Sadowsky"):
        strip.with_law(thin)
    assert strip.clamped("start").with_law(thin).clamped_rulings == ()


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"clamped_rulings": ((7, 0.1),)}, "clamped_rulings"),
        ({"clamped_rulings": ((0, math.nan),)}, "clamped_rulings"),
        ({"phase": "no"}, "phase"),
    ],
)
def test_wrong_parts_of_a_ribbon_are_named(changes, name):
    rod = ribbons.straight(1.0, 20, LAW).clamped("start").rod
    with pytest.raises(InvalidInput, match=f"`{name}`"):
        ribbons.Ribbon(LAW, rod, **changes)


def _twisted(natural_twist):
    return ribbons.Wunderlich(
        width=0.1, rigidity=1.0, poisson_ratio=0.3, natural_twist=natural_twist
    )


def test_a_band_that_is_held_by_its_pin_is_refused():
    """It had the energy 89.099, and was called stable; without the pin it has less."""
    band = ribbons.band(1.0, 100, _twisted(40.0), 0)
    with pytest.raises(NotConverged, match="held by the condition that pins") as caught:
        ls.equilibrate(band)
    lower = ls.equilibrate(replace(band, phase=False), start=caught.value.state, require="any")
    assert lower.energy < 89.0
    for gentle in (1.0, 20.0):  # the circle has straight rulings everywhere
        assert ls.equilibrate(ribbons.band(1.0, 60, _twisted(gentle), 0)).index == 0


def test_a_band_of_half_a_turn_that_passed_through_itself_is_told():
    with pytest.warns(LissomeWarning, match=r"its link is 2\.5 instead of 0\.5"):
        ls.equilibrate(ribbons.band(1.0, 60, _twisted(40.0), 1))


def test_open_strips_of_the_narrow_limit_whose_bending_alternates_are_told():
    law = ribbons.Sadowsky(width=0.1, rigidity=1.0)
    strip = ribbons.straight(1.0, 20, law).clamped("start").clamped("end", (0, 0, 0.9))

    def turn():
        state = ls.equilibrate(strip)
        for k in range(1, 11):
            state = ls.equilibrate(strip.turned(0.3 * k), start=state)

    with pytest.warns(LissomeWarning, match="bending jumps"):
        turn()
