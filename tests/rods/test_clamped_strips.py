"""A strip between clamps that is pushed together and sheared: its pitchfork, and where that leads."""

import numpy as np
import pytest

import lissome as ls
from lissome import rods
from lissome.references import clamped_ribbon as continuum

FRAME = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
THICKNESS, NU = 0.01, 0.5


def sheared(law, segments):
    strip = rods.straight(1.0, segments, law, tangent=(1, 0, 0), director=(0, 1, 0))
    strip = strip.clamped("start", (0, 0, 0), FRAME)
    return lambda shear: strip.clamped("end", (0.75, shear, 0.0), FRAME)


def law_of(width, stretches):
    young = 12.0 / (width * THICKNESS**3)
    if stretches:
        return rods.SanoWada.from_geometry(width, THICKNESS, young, poisson_ratio=NU)
    return rods.Kirchhoff.rectangle(
        width, THICKNESS, young, poisson_ratio=NU, torsion_constant=width * THICKNESS**3 / 3
    )


@pytest.mark.parametrize(("width", "stretches"), [(1 / 20, True), (1 / 6, False)])
def test_pitchfork_is_that_of_the_continuous_strip(width, stretches):
    places = []
    for segments in (44, 88):
        family = sheared(law_of(width, stretches), segments)
        found = ls.follow(family, 0.0, 0.5, on_fold="stop", eigenvalues=False)
        assert found.events[0].kind == "bifurcation"
        places.append(found.events[0].parameter)
    limit = (4 * places[1] - places[0]) / 3
    ribbon = continuum.Ribbon.of(width, THICKNESS, NU, stretches=stretches)
    near = continuum.moved(continuum.arch(ribbon, 0.25, elements=16), "shear", limit - 0.02)
    critical, _ = continuum.pitchfork(near, "shear", limit + 0.02, step=0.04)
    assert limit == pytest.approx(critical.clamps.shear, abs=3e-5)


def test_crossing_branch_leads_to_the_flat_state():
    """Both pitchforks lie on one loop; the flat state loses its stability where it is joined."""
    family = sheared(law_of(1 / 12, True), 44)
    outputs = {"height": lambda e: e.positions[22, 2]}
    options = {"eigenvalues": False, "on_fold": "stop"}
    arch = ls.follow(family, 0.0, 0.5, outputs=outputs, **options)
    crossing = arch.switch(arch.events[0], stop=0.5, bounds=(0.0, 0.5), on_fold="stop")
    assert crossing.table.stable.all()  # supercritical
    assert abs(crossing.table.height.iloc[-1]) < 1e-3
    far = ls.equilibrate(family(0.5), crossing.equilibria[-1].state)
    back = ls.follow(family, 0.5, 0.0, initial=far, outputs=outputs, **options)
    assert back.events[0].kind == "bifurcation"
    assert abs(back.table.height).max() < 1e-8
    assert back.events[0].parameter == pytest.approx(crossing.events[0].parameter, abs=1e-6)


@pytest.mark.parametrize("stretches", [True, False])
def test_snaps_where_nothing_jumps_release_the_square_of_the_overshoot(stretches):
    """Both ends of the crossing branch are soft: what is released comes from going beyond."""
    family = sheared(law_of(1 / 12, stretches), 30)
    released, ends = [], []
    for overshoot in (1e-3, 1e-2):
        found = ls.follow(family, 0.0, 0.45, on_fold="snap", overshoot=overshoot, eigenvalues=False)
        snaps = [event for event in found.events if event.kind == "snap"]
        assert (found.finished, len(snaps)) == (True, 2)
        released.append([event.energy_released for event in snaps])
        ends.append(found.equilibria[-1])
    assert released[1][0] == pytest.approx(100 * released[0][0], rel=0.02)
    assert 0 <= released[0][1] < 1e-3 * released[0][0]  # onto the flat state at its own pitchfork
    assert ends[1].stable
    assert ends[1].energy == pytest.approx(ends[0].energy, rel=1e-10)


def test_ribbon_without_twist_knows_no_width():
    """Unsheared, the arch bends only: the same for every law with the same easy bending."""
    shapes = [ls.equilibrate(sheared(law_of(w, s), 44)(0.0)).positions
              for w, s in ((0.05, True), (0.2, True), (0.1, False))]  # fmt: skip
    assert np.allclose(shapes[0], shapes[1], atol=1e-10)
    assert np.allclose(shapes[0], shapes[2], atol=1e-10)


def test_small_snaps_are_found_with_long_and_short_steps():
    """Next to a clamp one hinge flips; the branch bends sharply behind steps that were straight."""
    unit = np.sqrt(np.pi * 108.0 * 0.2)
    width, thickness = 1.12 * unit / 108.0, 0.2 / 108.0
    law = rods.SanoWada.from_geometry(
        width, thickness, 12 / (width * thickness**3), poisson_ratio=0.3
    )
    arch = rods.arc(law=law, lengths=np.full(50, np.pi / 50), angle=np.pi, director=(0, 1, 0),
                    origin=(-1, 0, 0), stress_free=False)  # fmt: skip

    def clamp(angle, tangent):
        across, along = np.array([-np.sin(angle), np.cos(angle), 0.0]), np.array([0, 0, tangent])
        return np.array([across, np.cross(along, across), along])

    def turned(angle):
        strip = arch.clamped("start", (-1, 0, 0), clamp(angle, 1.0))
        return strip.clamped("end", (1, 0, 0), clamp(-angle, -1.0))

    snaps = []
    for step in (0.5, 0.1):
        found = ls.follow(turned, 0.0, 1.9, on_fold="snap", eigenvalues=False, max_step=step)
        snaps.append([event.parameter for event in found.events if event.kind == "snap"])
    assert len(snaps[0]) == 2
    assert snaps[0] == pytest.approx(snaps[1], abs=1e-6)
