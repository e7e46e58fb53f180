"""Strips whose moments are unknowns: eigenvalues, and what is found from afar."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome import ribbons
from lissome.errors import InvalidInput, NotConverged
from lissome.stability import admissible_motions

LAW = ribbons.Wunderlich(width=0.2, rigidity=1.0)
FRAME = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
ANGLE = 2.0


def bent(scheme, segments):
    """A strip on an arc, whose end is shifted aside and turned about the axis of the other end."""
    strip = ribbons.straight(
        1.0, segments, LAW, scheme=scheme, tangent=(1, 0, 0), director=(0, 1, 0)
    ).clamped("start", (0, 0, 0))

    def family(part):
        turn = Rotation.from_rotvec([0.1 * part, 0, 0]) * Rotation.from_rotvec([0, -ANGLE, 0])
        place = (np.sin(ANGLE) / ANGLE, 0.03 * part, (1 - np.cos(ANGLE)) / ANGLE)
        return strip.clamped("end", place, turn.apply(FRAME))

    return family


def eliminated(kkt, metric):
    """Eigenvalues of the second variation without moments, by dense matrices."""
    n, m = kkt.n, kkt.m
    whole = np.array([np.concatenate(kkt.apply(e[:n], e[n:])) for e in np.eye(n + m)])
    h, j, c = whole[:n, :n], whole[n:, :n], -whole[n:, n:]
    soft, axes = np.linalg.eigh(c)
    assert soft.min() > -1e-9 * max(soft.max(), 1.0)
    real = soft <= 1e-11 * max(soft.max(), 1.0)
    forces = axes[:, ~real].T @ j
    root = np.sqrt(metric)
    h = (h + forces.T @ (forces / soft[~real, None])) / root / root[:, None]
    basis = np.linalg.svd((axes[:, real].T @ j) / root)[2][np.count_nonzero(real) :]
    return np.linalg.eigvalsh(basis @ h @ basis.T)


@pytest.fixture(scope="module")
def paths():
    return {
        (scheme, n): ls.follow(bent(scheme, n), 0.0, 1.0)
        for scheme in ("moments", "cells")
        for n in (20, 40)
    }


def test_eigenvalues_are_those_without_moments(paths):
    path = paths["moments", 20]
    last = path.equilibria[-1]
    exact = eliminated(last.evaluation.kkt, last.metric)
    assert admissible_motions(last.evaluation.kkt) == exact.size
    spectrum = ls.smallest_eigenvalue(last, count=4)
    np.testing.assert_allclose(spectrum.values, exact[:4], rtol=1e-7)
    assert 0.0 < spectrum.floor < 1e-9 * exact[0]
    assert last.smallest_eigenvalue() == pytest.approx(exact[0], rel=1e-7)
    assert last.mode() == pytest.approx(spectrum.modes[0], abs=1e-7)
    for row in (0, len(path) // 2, -1):  # what is noted on the way
        here = path.equilibria[row]
        value = eliminated(here.evaluation.kkt, here.metric)[0]
        assert path.table["smallest_eigenvalue"].iloc[row] == pytest.approx(value, rel=2e-6)
    with pytest.raises(InvalidInput, match=f"there are {exact.size} admissible motions"):
        ls.smallest_eigenvalue(last, count=exact.size + 1)


def test_eigenvalues_have_the_limit_of_those_of_cells(paths):
    """Second order, where the mass of fold variables, which are no unknowns here, is taken away."""
    limits = {}
    for scheme in ("moments", "cells"):
        values = []
        for n in (20, 40):
            here = paths[scheme, n].equilibria[-1]
            mass = np.array(here.metric)
            if here.state.folds.size:
                mass[-here.state.folds.size :] *= 1e-9
            values.append(eliminated(here.evaluation.kkt, mass)[:2])
        limits[scheme] = values[1] + (values[1] - values[0]) / 3
    np.testing.assert_allclose(limits["moments"], limits["cells"], rtol=8e-4)


def test_a_strip_that_finds_no_state_says_what_to_do():
    """And leaves the state where it began, not where the search broke off."""
    strip = ribbons.straight(
        1.0, 30, ribbons.Wunderlich(width=1 / 12, rigidity=12.0), scheme="moments"
    ).clamped("start")
    far = strip.clamped("end", (0.99, 0.0, 0.0))
    with pytest.raises(
        NotConverged, match=r"start nearer, or go there in small steps \(`follow`\)"
    ) as e:
        ls.equilibrate(far)
    assert e.value.state.quaternions == pytest.approx(far.start().quaternions, abs=1e-12)


@pytest.mark.filterwarnings("ignore::lissome.errors.LissomeWarning")  # of bending that jumps
def test_a_saddle_is_left_for_a_stable_state():
    """Beside the pitchfork of a sheared strip: the symmetric state is a saddle of higher energy."""
    flat = ribbons.straight(
        1.0, 44, ribbons.Wunderlich(width=1 / 12, rigidity=12.0), scheme="moments"
    ).clamped("start")
    family = lambda shear: flat.clamped("end", (shear, 0.0, 0.75))  # noqa: E731
    path = ls.follow(family, 0.0, 0.42)
    assert [event.kind for event in path.events] == ["bifurcation"]
    assert np.array_equal(path.table["smallest_eigenvalue"] > 0, path.table["index"] == 0)
    saddle = path.equilibria[-1]
    assert saddle.index == 1
    values = ls.smallest_eigenvalue(saddle, count=2).values
    assert values[0] < 0 < values[1]
    with pytest.raises(InvalidInput, match="admissible motions"):
        ls.smallest_eigenvalue(saddle, count=saddle.structure.size)
    stable = ls.equilibrate(saddle.structure, saddle)
    assert stable.stable
    assert stable.energy < saddle.energy


@pytest.mark.parametrize("mode", ["direct", "adjoint"])
@pytest.mark.parametrize("inflections", [False, True])
def test_the_sensitivity_of_the_energy_is_the_force_on_the_clamp(mode, inflections):
    """The energy depends on the moments, and not smoothly on the scale of the largest of them."""
    if inflections:
        flat = ribbons.straight(
            1.0, 20, ribbons.Wunderlich(width=0.1, rigidity=1.0), scheme="moments"
        ).clamped("start")
        family = lambda shear: flat.clamped("end", (shear, 0.0, 0.75))  # noqa: E731
        found, at = ls.follow(family, 0.0, 0.1, eigenvalues=False).equilibria[-1], 0.1
        force = found.forces[-1][0]
    else:
        family, at, step = bent("moments", 8), 0.5, 1e-3
        found = ls.follow(family, 0.0, at, eigenvalues=False).equilibria[-1]
        near = [ls.equilibrate(family(at + k * step), found).energy for k in (-2, -1, 1, 2)]
        force = (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * step)

    def energy(state, multipliers, place):
        here = family(place)
        return here.evaluate(here.adopt(state), multipliers, 0).energy

    told = ls.sensitivity(family, at, found, {"energy": energy}, mode).outputs["energy"]
    assert told == pytest.approx(force, rel=1e-5)
