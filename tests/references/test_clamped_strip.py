"""The inextensible strip between clamps: work of the clamps, symmetry, a bifurcation, other meshes."""

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons
from lissome.errors import InvalidInput
from lissome.references.clamped_ribbon import _orientation, beyond, moved, pitchfork
from lissome.references.clamped_strip import sheared_arch

WIDTH = 1 / 6


@pytest.fixture(scope="module")
def strip():
    return sheared_arch(WIDTH, shear=0.3)


def test_converges_with_the_order(strip):
    coarse, fine = (sheared_arch(WIDTH, shear=0.3, stages=n) for n in (3, 5))
    energies = [abs(state.energy / fine.energy - 1) for state in (coarse, strip)]
    forces = [np.max(np.abs(state.force - fine.force)) for state in (coarse, strip)]
    assert energies[1] < 0.1 * energies[0] < 1e-6
    assert forces[1] < 0.5 * forces[0] < 1e-4 * np.max(np.abs(fine.force))
    # To move an inflection costs next to nothing: its place has fewer digits than the energy.
    assert strip.inflections == pytest.approx(fine.inflections, abs=1e-5)


def test_force_is_the_slope_of_the_energy(strip):
    step = 1e-3
    for control, value, component, sign in (("shear", 0.3, 1, 1), ("shortening", 0.25, 0, -1)):
        up, down = (moved(strip, control, value + s).energy for s in (step, -step))
        assert (up - down) / (2 * step) == pytest.approx(sign * strip.force[component], rel=1e-4)


def test_the_ruling_turns_as_fast_as_the_width_allows_where_the_bending_changes_sign(strip):
    one = strip.inflections[0]
    s = one + np.array([-1e-4, 1e-4])
    bending, _, twist = strip.strains(s).T
    assert bending[0] > 0 > bending[1]
    assert twist == pytest.approx(strip.ruling(s) * bending, rel=1e-12)
    slope = np.diff(strip.ruling(s))[0] / 2e-4
    assert WIDTH * abs(slope) == pytest.approx(2.0, abs=1e-4)


def test_half_a_turn_about_the_vertical_maps_the_arch_onto_itself(strip):
    s = np.linspace(0.03, 0.47, 7)
    assert strip.strains(s) == pytest.approx(strip.strains(1 - s), abs=1e-6)
    assert strip.middle[:2] == pytest.approx([0.375, 0.15], abs=1e-9)


@pytest.mark.parametrize("scheme", ["cells", "moments"])
def test_discrete_strip_converges_to_it(strip, scheme):
    """Second order, with rulings at hinges and folds or moments in cells."""
    law = ribbons.Wunderlich(width=WIDTH, rigidity=1 / WIDTH)
    errors = []
    for segments in (60, 120):
        flat = ribbons.straight(
            1.0, segments, law, tangent=(1, 0, 0), director=(0, 1, 0), scheme=scheme
        ).clamped("start", (0, 0, 0))

        def family(p, flat=flat):
            return flat.clamped("end", (0.75, p, 0.0))

        found = ls.follow(family, 0.0, 0.3, eigenvalues=False, on_fold="stop")
        assert not found.events  # inflections pass hinges without any
        errors.append(found.equilibria[-1].energy - strip.energy)
    assert 0 < errors[1] < 0.35 * errors[0] < 2e-3 * strip.energy


@pytest.mark.parametrize(
    ("part", "place", "within"),
    [(6, 0.33181, (0.02, 0.002, 5e-4)), (12, 0.36588, (0.05, None, 2e-3))],
)
def test_pitchfork_of_discrete_strips_with_moments(part, place, within):
    """On equal segments, wherever the inflections lie in them; that of collocation is tested below."""
    law = ribbons.Wunderlich(width=1 / part, rigidity=part)
    for segments, error in zip((44, 88, 176), within, strict=True):
        if error is None:
            continue
        flat = ribbons.straight(
            1.0, segments, law, tangent=(1, 0, 0), director=(0, 1, 0), scheme="moments"
        ).clamped("start", (0, 0, 0))
        found = ls.follow(
            lambda p, flat=flat: flat.clamped("end", (0.75, p, 0.0)), 0.0, 0.45,
            eigenvalues=False, on_fold="stop",
        )  # fmt: skip
        assert found.events[0].kind == "bifurcation"
        assert found.events[0].parameter == pytest.approx(place, rel=error)


def test_pitchfork():
    """The same place by collocation of another order; the branch crosses at a right angle."""
    state = sheared_arch(WIDTH, shear=0.325)
    critical, mode = pitchfork(state, "shear", 0.338, step=0.013)
    place = critical.clamps.shear
    fine = sheared_arch(WIDTH, shear=place - 1e-5, stages=5)
    signs = [_orientation(moved(fine, "shear", place + d), "shear") for d in (-1e-5, 1e-5)]
    assert signs[0] == -signs[1]
    states = [beyond(critical, mode, "shear", a) for a in (-0.04, 0.04, 0.08)]
    # both inflections go the same way, the other way for the mirror image
    moves = [state.inflections.mean() - 0.5 for state in states]
    assert moves[0] == pytest.approx(-moves[1], rel=1e-3)
    assert moves[2] == pytest.approx(2 * moves[1], rel=1e-2)
    rises = [state.clamps.shear - place for state in states]
    assert 0 < rises[0] == pytest.approx(rises[1], rel=1e-2)
    assert rises[2] == pytest.approx(4 * rises[1], rel=0.05)


def test_input():
    with pytest.raises(InvalidInput, match="width"):
        sheared_arch(0.7)
    with pytest.raises(InvalidInput, match="shear"):
        sheared_arch(0.1, shear=0.0)
    with pytest.raises(InvalidInput, match="shortening"):
        sheared_arch(0.1, 1.2)
    with pytest.raises(InvalidInput, match="elements"):
        sheared_arch(0.1, elements=2)
