"""Closed bands: the cylinder, the Möbius band, its limits, and states that are spurious."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons
from lissome.errors import InvalidInput, LissomeWarning, NotConverged

#: Half widths of Starostin and van der Heijden (length 2 pi), as full widths of a band of length 1.
WIDTHS = [k / math.pi for k in (0.1, 0.2, 0.5, 0.8, 1.0, 1.5)]


def _band(width, segments=150, half_turns=1, **options):
    law = ribbons.Wunderlich(width=width, rigidity=1.0 / width)
    return ribbons.band(1.0, segments, law, half_turns, **options)


@pytest.fixture(scope="module")
def moebius():
    """The six bands, each from the one before."""
    found = [ls.equilibrate(_band(WIDTHS[0]))]
    for width in WIDTHS[1:]:
        found.append(ls.equilibrate(_band(width), start=found[-1]))
    return found


# ---- cylinders -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["staggered", "nodal"])
@pytest.mark.parametrize("width", [0.05, 0.5, 2.0])
def test_a_cylinder_has_the_energy_of_its_polygon(width, scheme):
    segments = 24
    eq = ls.equilibrate(_band(width, segments, 0, scheme=scheme))
    bend = 2 * segments * math.sin(math.pi / segments)  # (4.16) over the length of a segment
    assert eq.stable
    assert eq.energy == pytest.approx(0.5 * bend**2, rel=1e-12)
    assert eq.ruling == pytest.approx(0.0, abs=1e-12)
    assert eq.surface().energy_density == pytest.approx(0.5 / width * bend**2, rel=1e-9)


# ---- the Moebius band ----------------------------------------------------------------------------


def test_twist_and_writhe_make_half_a_turn(moebius):
    for eq in moebius:
        assert eq.twist + eq.writhe == pytest.approx(0.5, abs=1e-9)
        assert eq.passages == 0


def test_the_bands_are_minima_with_no_net_force_on_the_phase(moebius):
    """The ruling that is held exerts nothing: the state balances without it as well."""
    for eq in moebius:
        assert eq.stable
        free = replace(eq.structure, phase=False)
        there = free.evaluate(free.adopt(eq.state), eq.multipliers, 2)
        scale = np.max(np.abs(eq.moments))
        assert np.max(np.abs(there.gradient)) < 1e-7 * scale
        assert free.size == eq.structure.size + 1


def test_the_bands_have_the_symmetry_of_a_flip(moebius):
    for eq in moebius:
        bend, twist = eq.strains[:, 0], eq.strains[:, 2]
        scale = np.max(np.abs(bend))
        # Hinges 1 and 0 are on both sides of the inflection, 2 and -1 come next, and so on.
        assert bend[1:-1] == pytest.approx(bend[1:-1][::-1], abs=1e-6 * scale)
        assert twist[1:-1] == pytest.approx(twist[1:-1][::-1], abs=1e-6 * scale)
        assert bend[0] == pytest.approx(bend[-1], abs=1e-6 * scale)


def test_the_surface_is_isometric_and_closes_up(moebius):
    for eq in moebius:
        surface = eq.surface(across=7)
        assert surface.isometry_error() < 1e-9
        assert surface.rulings_cross().size == 0
        assert surface.vertices[0] == pytest.approx(surface.vertices[-1][::-1], abs=1e-9)
        assert np.max(np.abs(eq.ruling_slope)) * eq.structure.law.width < 2.0


def test_wider_bands_have_more_energy_per_width(moebius):
    assert np.all(np.diff([eq.energy for eq in moebius]) > 0)


def test_handedness_changes_the_sign_of_the_twist(moebius):
    other = ls.equilibrate(_band(WIDTHS[2], half_turns=-1))
    assert other.energy == pytest.approx(moebius[2].energy, rel=1e-9)
    assert other.twist == pytest.approx(-moebius[2].twist, rel=1e-7)


def test_a_cold_start_finds_the_same_state(moebius):
    for k in (2, 5):
        cold = ls.equilibrate(_band(WIDTHS[k]))
        assert cold.energy == pytest.approx(moebius[k].energy, rel=1e-9)


@pytest.mark.parametrize("scheme", ["staggered", "nodal"])
def test_energy_and_strains_converge_with_the_square_of_the_mesh(scheme):
    width, energies, bends, twists = 0.5 / math.pi, [], [], []
    for segments in (75, 151, 303):  # odd: a hinge lies opposite to the inflection
        eq = ls.equilibrate(_band(width, segments, scheme=scheme))
        energies.append(eq.energy)
        bends.append(eq.strains[(segments - 1) // 2, 0])
        twists.append(eq.strains[(segments - 1) // 2, 2])
    for values in (energies, bends, twists):
        change = np.abs(np.diff(values))
        assert math.log2(change[0] / change[1]) == pytest.approx(2.0, abs=0.1)


def test_both_schemes_converge_to_the_same():
    limits = []
    for scheme in ("staggered", "nodal"):
        a, b = (ls.equilibrate(_band(0.2, n, scheme=scheme)).energy for n in (160, 320))
        limits.append(b + (b - a) / 3)
    assert limits[0] == pytest.approx(limits[1], rel=2e-5)


def test_narrow_bands_tend_to_sadowsky():
    limit = ls.equilibrate(ribbons.band(1.0, 300, ribbons.Sadowsky(width=1.0, rigidity=1.0)))
    # Where the bending changes sign, rulings are at 45 degrees in the limit.
    assert np.max(np.abs(limit.ruling)) == pytest.approx(1.0, abs=5e-3)
    excess = [ls.equilibrate(_band(w, 300)).energy - limit.energy for w in (0.04, 0.02)]
    assert excess[1] > 0
    assert excess[0] / excess[1] == pytest.approx(2.0, abs=0.3)


def test_following_the_width(moebius):
    branch = ls.follow(_band(WIDTHS[1]).with_width, WIDTHS[1], WIDTHS[2], initial=moebius[1])
    law = branch.equilibria[-1].structure.law
    assert branch.equilibria[-1].energy / law.rigidity / law.width == pytest.approx(
        moebius[2].energy, rel=1e-8
    )
    assert not branch.events


def test_random_widths_lead_to_the_same_state():
    """60 bands go through random widths, each up to 1.6 times the last, to 94 % of the limit.

    Each ends in the same state; a change that is too large for the solver is refused with a remedy, and
    the sequence goes on from where it was. Few are.
    """
    rng = np.random.default_rng(7)
    band = ribbons.band(1.0, 100, _law(0.5))
    goal = ls.equilibrate(band)
    starts = [goal]
    for half_width in (0.3, 0.2, 0.1):
        starts.append(ls.equilibrate(band.with_law(_law(half_width)), start=starts[-1]))
    refused = []
    for _ in range(60):
        eq = starts[int(rng.integers(len(starts)))]
        now = eq.structure.law.width * math.pi
        for _ in range(int(rng.integers(1, 5))):
            wanted = min(rng.uniform(0.6, 1.6) * now, 1.7)
            try:
                eq = ls.equilibrate(band.with_law(_law(wanted)), start=eq)
                now = wanted
            except ls.errors.LissomeError as error:
                refused.append(str(error))
        back = ls.equilibrate(band.with_law(_law(max(0.5, 0.6 * now))), start=eq)
        back = ls.equilibrate(band.with_law(_law(0.5)), start=back)
        assert back.energy == pytest.approx(goal.energy, rel=1e-9)
        assert back.link == pytest.approx(0.5)
    assert len(refused) <= 6
    for message in refused:
        assert re.search("smaller steps|more segments|start nearer|move the parameter", message)


def test_a_fine_mesh_starts_from_the_coarse_one():
    eq = ls.equilibrate(_band(0.2, 1000))
    coarse = ls.equilibrate(_band(0.2, 500))
    fine = ls.equilibrate(eq.structure, start=eq.structure.adapted(coarse))
    assert fine.energy == pytest.approx(eq.energy, rel=1e-10)


def test_tables_change_sign_across_the_joint(moebius):
    table = moebius[2].to_frame()
    assert len(table) == 151
    bend = next(c for c in table.columns if c in ("kappa_1", "curvature_1"))
    assert table[bend].iloc[0] == pytest.approx(-table[bend].iloc[-1])
    assert table["ruling"].iloc[0] == pytest.approx(-table["ruling"].iloc[-1])
    assert {"energy_per_length", "ruling_slope"} <= set(table.columns)
    assert len(moebius[2].to_frame("hinges")) == 150
    assert len(moebius[2].to_frame("segments")) == 150


def test_a_force_across_the_band_lowers_its_energy(moebius):
    """A loaded band has no held segment and no pinned phase."""
    start = ls.equilibrate(_band(0.2, 60))
    pulled = start.structure.loaded(nodes={20: (0, 1, 5.0), 45: (1, 0, -5.0), 5: (-1, -1, 0)})
    eq = ls.equilibrate(pulled, start=pulled.adapted(start))
    assert eq.energy < start.energy
    assert eq.twist + eq.writhe == pytest.approx(0.5, abs=1e-9)


# ---- what is spurious ----------------------------------------------------------------------------


def test_without_a_rule_at_the_joint_a_lower_energy_is_spurious(moebius):
    ribbon = _band(WIDTHS[1], joint="free")
    eq = ls.equilibrate(ribbon, start=ribbon.adapted(moebius[1]))
    assert eq.energy < moebius[1].energy
    smooth, rough = np.max(moebius[1].bending_jumps), np.max(eq.bending_jumps)
    assert rough > 10 * smooth
    with pytest.raises(NotConverged, match="jumps at the joint"):
        eq.check_smooth()


def test_alternating_states_of_the_nodal_scheme_are_refused(moebius):
    ribbon = _band(WIDTHS[5], scheme="nodal")
    with pytest.raises(NotConverged, match="alternates") as caught:
        ls.equilibrate(ribbon, start=ribbon.adapted(moebius[5]))
    assert caught.value.state is not None


def test_a_mesh_that_is_coarser_than_the_width_is_refused():
    with pytest.raises(NotConverged, match="segments"):
        ls.equilibrate(_band(0.03, 30))


def test_bands_that_pass_through_themselves_are_warned_of():
    with pytest.warns(LissomeWarning, match="passed through itself"):
        eq = ls.equilibrate(_band(0.1, 120, 3))
    assert eq.link == pytest.approx(-0.5, abs=1e-6) or eq.link == pytest.approx(0.5, abs=1e-6)


# ---- wrong input ---------------------------------------------------------------------------------


def test_a_band_that_is_too_wide_is_refused():
    limit = ribbons.WIDEST_BAND
    with pytest.raises(InvalidInput, match=r"sqrt\(3\)"):
        _band(limit)
    with pytest.raises(InvalidInput, match=r"sqrt\(3\)"):
        _band(0.2).with_width(0.6)
    with pytest.raises(InvalidInput, match=r"sqrt\(3\)"):
        _band(0.2).with_law(ribbons.Wunderlich(width=1.0, rigidity=1.0))
    assert _band(0.99 * limit).law.width < limit


@pytest.mark.parametrize("turns", [0.5, "one", True, None])
def test_wrong_numbers_of_half_turns_are_refused(turns):
    with pytest.raises(InvalidInput, match="half_turns"):
        _band(0.1, half_turns=turns)


def test_other_wrong_bands_are_refused():
    with pytest.raises(InvalidInput, match="segments"):
        _band(0.1, 5)
    with pytest.raises(InvalidInput, match="joint"):
        _band(0.1, joint="glued")
    with pytest.raises(InvalidInput, match="closed"):
        ribbons.Ribbon(ribbons.Wunderlich(width=0.1, rigidity=1.0), _rod(), half_turns=1)
    with pytest.raises(InvalidInput, match="stretch"):
        ribbons.Ribbon(ribbons.Wunderlich(width=0.1, rigidity=1.0), _rod(stretching=1.0))
    with pytest.raises(InvalidInput, match="measure"):
        ribbons.Ribbon(ribbons.Wunderlich(width=0.1, rigidity=1.0), _rod(measure="angle"))


def _rod(**options):
    return ls.rods.straight(1.0, 10, ls.rods.Kirchhoff(1.0, 1.0), **options)


# ---- an independent solution ---------------------------------------------------------------------


def _reference(half_width):
    """Energy, twist and mid-span strains of the boundary-value problem of the continuous band."""
    path = Path(__file__).parents[2] / "data" / "moebius-energies.csv"
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if float(row["half_width"]) == half_width]
    return {name: float(value) for name, value in rows[0].items()}


@pytest.mark.parametrize("half_width", [0.2, 0.5, 0.8, 1.0, 1.5])
def test_the_discrete_band_converges_to_the_solution_by_collocation(half_width):
    exact = _reference(half_width)
    found = []
    for segments in (151, 301):
        eq = ls.equilibrate(_band(half_width / math.pi, segments))
        middle = eq.strains[(segments - 1) // 2]
        found.append([eq.energy, eq.twist, middle[0], middle[2]])
    coarse, fine = np.array(found)
    ratio = (301 / 151) ** 2
    limit = fine + (fine - coarse) / (ratio - 1)
    wanted = [exact[k] for k in ("energy", "twist", "middle_bending", "middle_twisting")]
    assert limit == pytest.approx(wanted, rel=2e-4)
    assert limit[0] == pytest.approx(exact["energy"], rel=2e-5)
    assert abs(fine[0] - exact["energy"]) < 0.4 * abs(coarse[0] - exact["energy"])


@pytest.fixture(scope="module")
def steep(moebius):
    """The band of pi w/L = 1.7, on a uniform mesh."""
    found = moebius[5]
    for half_width in (1.55, 1.6, 1.65, 1.68, 1.7):
        found = ls.equilibrate(found.structure.with_law(_law(half_width)), start=found)
    return found


def _law(half_width):
    width = half_width / math.pi
    return ribbons.Wunderlich(width=width, rigidity=1.0 / width)


def _graded(start, half_width, segments):
    band = ribbons.band(lengths=start.graded_lengths(segments), law=_law(half_width))
    return ls.equilibrate(band, start=band.adapted(start))


def test_graded_meshes_reach_97_percent_of_the_limit_and_converge(steep):
    """To pi w/L = 1.75 and beyond, with errors that fall with the square of the mesh."""
    exact = _reference(1.75)
    states = []
    for segments in (120, 240):
        found = _graded(steep, 1.7, segments)
        for half_width in np.linspace(1.705, 1.75, 10):
            found = ls.equilibrate(found.structure.with_law(_law(half_width)), start=found)
        states.append(_graded(found, 1.75, segments))
    off = np.array([eq.energy / exact["energy"] - 1 for eq in states])
    assert off[0] / off[1] == pytest.approx(4.0, abs=0.3)
    assert abs(off[1]) < 2.5e-3
    assert off[1] - (off[0] - off[1]) / 3 == pytest.approx(0.0, abs=5e-5)
    assert states[1].twist == pytest.approx(exact["twist"], abs=3e-4)
    assert states[1].twist + states[1].writhe == pytest.approx(0.5, abs=1e-9)
    assert states[1].surface().rulings_cross().size == 0
    wider = states[1]
    for half_width in (1.755, 1.76):
        wider = ls.equilibrate(wider.structure.with_law(_law(half_width)), start=wider)
    assert wider.stable
    assert wider.structure.law.width > 0.97 * ribbons.WIDEST_BAND


def test_a_graded_mesh_is_ten_times_as_good_as_a_uniform_one(steep):
    exact = _reference(1.7)["energy"]
    graded = _graded(steep, 1.7, 150).energy - exact
    assert abs(graded) < 0.35 * abs(steep.energy - exact)


def test_the_pin_exerts_nothing_on_a_mesh_that_is_symmetric_about_it(steep):
    eq = _graded(steep, 1.6, 101)
    assert eq.structure.pins_phase
    free = replace(eq.structure, phase=False)
    there = free.evaluate(free.adopt(eq.state), eq.multipliers, 2)
    assert np.max(np.abs(there.gradient)) < 1e-7 * np.max(np.abs(eq.moments))
    uneven = np.array(eq.structure.lengths)
    uneven[3] *= 1.01
    assert not ribbons.band(lengths=uneven, law=_law(1.0)).pins_phase


def test_a_state_goes_to_another_mesh_with_its_inflection(moebius):
    """Meshes differ in where the inflection lies, the middle of the first segment."""
    source = moebius[3]
    for segments in (75, 149, 400):
        band = ribbons.band(1.0, segments, source.structure.law)
        state = band.adapted(source)
        rows = band.evaluate(band.adopt(state), np.zeros(band.constraints_count), 0).constraints
        assert np.max(np.abs(rows)) < 0.02
        again = ls.equilibrate(band, start=state)
        assert again.iterations <= 12


def test_graded_lengths_follow_the_bending(moebius):
    for segments in (40, 41):
        lengths = moebius[4].graded_lengths(segments, share=0.6)
        assert lengths.sum() == pytest.approx(1.0)
        assert lengths[1:] == pytest.approx(lengths[:0:-1], rel=1e-12)
        first, sharpest = lengths[0], lengths[1:].min()  # at the inflection; where it bends most
        assert sharpest < 0.8 / segments
        assert first > 1.7 / segments
    assert np.ptp(moebius[4].graded_lengths(40, share=0.0)) < 1e-12
    twice = ls.equilibrate(_band(0.1, 24, 0)).graded_lengths(30)
    assert twice == pytest.approx(1 / 30)  # a cylinder bends alike everywhere


@pytest.mark.parametrize(
    ("arguments", "name"), [((5,), "segments"), ((40, 1.0), "share"), ((40, -0.1), "share")]
)
def test_wrong_gradings_are_named(moebius, arguments, name):
    with pytest.raises(InvalidInput, match=f"`{name}`"):
        moebius[0].graded_lengths(*arguments)


def test_the_narrow_limit_is_that_of_the_continuous_band():
    law = ribbons.Sadowsky(width=1.0, rigidity=1.0)
    coarse, fine = (ls.equilibrate(ribbons.band(1.0, n, law)).energy for n in (150, 300))
    assert fine + (fine - coarse) / 3 == pytest.approx(_reference(0.0)["energy"], rel=1e-5)
