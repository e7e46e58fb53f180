"""The ribbon between clamps: closed limits, work of the clamps, a bifurcation, a jump of the law."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import lissome as ls
from lissome import rods
from lissome.errors import InvalidInput, NotConverged
from lissome.references.clamped_ribbon import Ribbon, arch, beyond, helicoid_load, moved, pitchfork

KIRCHHOFF = Ribbon.of(1 / 12, 0.01, 0.5, stretches=False)
STRETCHY = Ribbon.of(1 / 12, 0.01, 0.5)


def test_arch_is_the_elastica():
    """With m the parameter: 1 - c = 2 E/K - 1, load 16 K^2, height sqrt(m)/K."""
    shortening = 0.25
    modulus = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 2 + shortening, 1e-6, 0.9)
    state = arch(STRETCHY, shortening)
    assert -state.force[0] == pytest.approx(16 * ellipk(modulus) ** 2, rel=1e-9)
    assert -state.middle[2] == pytest.approx(np.sqrt(modulus) / ellipk(modulus), rel=1e-9)
    assert state.middle[0] == pytest.approx(0.5 * (1 - shortening), abs=1e-12)


def test_force_is_the_slope_of_the_energy():
    """Shear and shortening: the clamp's force, against differences of the energy."""
    state, step = moved(arch(STRETCHY, 0.25), "shear", 0.15), 1e-4
    up, down = (moved(state, "shear", 0.15 + s) for s in (step, -step))
    assert (up.energy - down.energy) / (2 * step) == pytest.approx(state.force[1], rel=1e-6)
    up, down = (moved(state, "shortening", 0.25 + s) for s in (step, -step))
    assert (up.energy - down.energy) / (2 * step) == pytest.approx(-state.force[0], rel=1e-6)


def test_half_a_turn_about_the_vertical_maps_the_arch_onto_itself():
    state = moved(arch(STRETCHY, 0.25), "shear", 0.2)
    s = np.linspace(0.05, 0.45, 5)
    for sign, component in ((1, 0), (1, 2)):
        left, right = state.strains(s)[:, component], state.strains(1 - s)[:, component]
        assert np.allclose(left, sign * right, atol=1e-7)
    assert state.middle[:2] == pytest.approx([0.375, 0.1], abs=1e-9)


@pytest.mark.parametrize("ribbon", [KIRCHHOFF, STRETCHY])
def test_pitchfork(ribbon):
    """Converges with the mesh; the mode breaks the symmetry; the crossing branch leaves at a right angle."""
    found = [pitchfork(arch(ribbon, 0.25, elements=e), "shear", 0.4, step=0.1) for e in (16, 24)]
    places = [critical.clamps.shear for critical, _ in found]
    assert places[0] == pytest.approx(places[1], abs=3e-6)
    critical, mode = found[1]
    assert abs(mode[12, 2]) < 1e-6 * abs(mode).max()  # the middle does not rise
    assert abs(mode[12, :2]).max() > 1e-3 * abs(mode).max()
    shifts = [beyond(critical, mode, "shear", a).clamps.shear - places[1] for a in (0.1, 0.2)]
    assert shifts[1] / shifts[0] == pytest.approx(4.0, rel=0.05)


def test_twist_as_a_control():
    """The couple of the turned clamp about x is the slope of the energy."""
    state, step = moved(arch(STRETCHY, 0.05), "twist", 0.6), 1e-3
    up, down = (moved(state, "twist", 0.6 + s).energy for s in (step, -step))
    end = state.solution.nodes[-1]
    _, couple = STRETCHY.moments(end[8], end[9])  # the tangent at the clamp is along x
    assert (up - down) / (2 * step) == pytest.approx(couple, rel=1e-5)


def test_a_law_that_loses_its_ellipticity_ends_the_branch():
    """A wide ribbon's curvature steepens without bound before any bifurcation."""
    start, places = arch(Ribbon.of(1 / 6, 0.01, 0.5), 0.25), []
    for elements in (24, 36):
        start = arch(Ribbon.of(1 / 6, 0.01, 0.5), 0.25, elements=elements)
        with pytest.raises(NotConverged, match="ellipticity") as caught:
            moved(start, "shear", 0.27)
        last = caught.value.state
        assert last.margin < 0.5 * start.margin
        s = np.linspace(0, 1, 2001)
        slopes = [abs(np.gradient(e.strains(s)[:, 0], s)).max() for e in (start, last)]
        assert slopes[1] > 5 * slopes[0]
        places.append(last.clamps.shear)
    assert places[0] == pytest.approx(places[1], abs=1e-3)


@pytest.mark.parametrize(("width", "twist"), [(1 / 20, 0.5), (1 / 6, 3.0)])
def test_helicoid_load_is_that_of_the_discrete_rod(width, twist):
    """A strip that is let go: the first bifurcation, extrapolated in the mesh."""
    easy = 0.01**3 * width / 12
    law = rods.SanoWada.from_geometry(width, 0.01, 1 / easy, poisson_ratio=0.5)
    _, moments, stiffness = law.evaluate(np.array([[0.0, 0.0, twist]]))
    moduli = stiffness[0, 0, 0], stiffness[0, 1, 1], moments[0, 2]
    exact = helicoid_load(*moduli, twist)
    frame = [[0, np.cos(twist), np.sin(twist)], [0, -np.sin(twist), np.cos(twist)], [1, 0, 0]]
    loads = []
    for segments in (40, 80):
        rod = rods.straight(1.0, segments, law, tangent=(1, 0, 0), director=(0, 1, 0))
        held = rod.clamped("start", (0, 0, 0)).clamped("end", (None, 0, 0), frame)
        found = ls.follow(
            lambda load, held=held: held.loaded(end=(load, 0, 0)),
            20.0,
            -60.0,
            on_fold="stop",
            eigenvalues=False,
        )
        loads.append(found.events[0].parameter)
    assert (4 * loads[1] - loads[0]) / 3 == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("twist", [0.5, 3.0])
def test_helicoid_of_equal_stiffnesses(twist):
    """A round rod sees no frame: its load depends on the couple, which brings it down, not on twist."""
    spun = helicoid_load(1.0, 1.0, 4.0, twist)
    assert spun == pytest.approx(helicoid_load(1.0, 1.0, 4.0, 0.0), rel=1e-5)
    assert spun > helicoid_load(1.0, 1.0, 0.0, 0.0) == pytest.approx(-4 * np.pi**2, rel=1e-5)


def test_input():
    with pytest.raises(InvalidInput, match="shortening"):
        arch(KIRCHHOFF, 1.2)
    with pytest.raises(InvalidInput, match="control"):
        moved(arch(KIRCHHOFF, 0.2, elements=8), "shove", 0.1)
    with pytest.raises(InvalidInput, match="poisson_ratio"):
        Ribbon.of(0.1, 0.01, 0.7)
    with pytest.raises(InvalidInput, match="crossover"):
        Ribbon(1.0, 1.0, -1.0)
    with pytest.raises(NotConverged, match="no singular state"):
        pitchfork(arch(KIRCHHOFF, 0.25, elements=12), "shear", 0.1, step=0.05)
