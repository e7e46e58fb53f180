"""Inversion of domes: against collocation, symmetries and the scaling law."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import lissome as ls
from lissome.errors import InvalidInput, NotConverged, StabilityNotResolvable
from lissome.plates import Defect, Plate, meshes, snap
from lissome.plates.snap import critical_curvature, dome, inversion, sheet
from lissome.references.disc import AxisymmetricDisc, fold

DOME = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5, radius=0.5, strain=(0.01, -0.02))


def hoops(radial, azimuthal):
    def field(x, y):
        out = np.array([[x * x, x * y], [x * y, y * y]]) / (x * x + y * y)
        one = np.eye(2).reshape(2, 2, *np.ones(np.ndim(x), int))
        return radial * out + azimuthal * (one - out)

    return field


def disc(thickness=0.01, **changes):
    scale = (thickness / 0.01) ** 2
    arguments = {
        "bending": thickness**2, "poisson_ratio": 0.5, "strain": hoops(0.01 * scale, -0.02 * scale),
        "degree": 3,
    }  # fmt: skip
    return Plate(mesh=meshes.disc(0.5, 2), **{**arguments, **changes})


@pytest.fixture(scope="module")
def snapped():
    return inversion(disc(), hoops(-1.0, 2.0), 1.0)


def test_critical_curvature_and_energy_agree_with_collocation(snapped):
    p, at = fold(DOME.solve(height=0.1), (-1.0, 2.0), step=0.1, most=1.0)
    below = replace(DOME, curvature=(-p, 2 * p)).solve(height=-0.1)
    assert snapped.inverts
    assert snapped.kind == "fold"
    assert snapped.parameter == pytest.approx(p, rel=1e-3)
    assert snapped.uncertainty < 1e-4
    assert snapped.energy_released == pytest.approx(at.energy - below.energy, rel=2e-3)
    assert snapped.after.stable
    assert below.softest(2) > 0


def test_mirrored_dome_inverts_at_the_opposite_curvature(snapped):
    plate = disc()
    down = inversion(plate, hoops(-1.0, 2.0), -1.0, initial=dome(plate, up=False))
    assert down.parameter == pytest.approx(-snapped.parameter, rel=1e-6)
    assert down.energy_released == pytest.approx(snapped.energy_released, rel=1e-3)


def test_all_thicknesses_are_one(snapped):
    """Curvatures scale with t, strains with t^2, energies with t^4 (t^2 = B/C)."""
    thick = inversion(disc(0.03), hoops(-3.0, 6.0), 1.0)
    assert thick.parameter == pytest.approx(snapped.parameter, rel=1e-6)
    assert thick.energy_released / 81 == pytest.approx(snapped.energy_released, rel=1e-6)


def test_fast_path_finds_the_fold_of_collocation_and_of_the_branch(snapped):
    """The disc of DOME: strain difference 0.03 and t = 0.01, diameter 1."""
    found = critical_curvature(
        300.0, shape="disc", divisions=2, thickness=0.01 * np.sqrt(12), curvature_tensor="incompressible"
    )  # fmt: skip
    # the tensor of `hoops(-1, 2)` is (along, across) = (2, -1) p: along = 2 p/t
    assert found["inverts"] and found["kind"] == "fold"
    assert found["curvature"] == pytest.approx(2 * snapped.parameter / 0.01, rel=2e-4)
    assert found["energy"] == pytest.approx(snapped.energy_released / 1e-8, rel=2e-3)
    assert found["uncertainty"] < 2e-4 * found["curvature"]
    assert found["height_before"] > 0 > found["height_after"]


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.1, 0.1)])
def test_fast_path_agrees_with_the_branch_on_squares(offset):
    t = 0.01 / np.sqrt(12)
    found = critical_curvature(200.0, offset=offset, divisions=2)
    plate = sheet(200.0, offset=offset, divisions=2)
    unit = Defect(center=offset).field(t, -0.5 * t)
    slow = inversion(plate, unit, 60.0, initial=dome(plate, center=offset), tolerance=1e-5)
    assert found["inverts"] and slow.inverts
    assert found["curvature"] == pytest.approx(slow.parameter, rel=5e-4)
    assert found["energy"] == pytest.approx(slow.energy_released / t**4, rel=5e-3)


def test_master_curves_hold_for_every_thickness():
    thin, thick = (critical_curvature(250.0, divisions=2, thickness=h) for h in (0.003, 0.03))
    # The bracket of a fold is relative to the curvature; heights before it vary as its root.
    reach = thin["uncertainty"] + thick["uncertainty"]
    assert reach < 1e-4 * thin["curvature"]
    assert thick["curvature"] == pytest.approx(thin["curvature"], abs=reach)
    assert thick["energy"] == pytest.approx(thin["energy"], rel=1e-4)
    assert thick["height_after"] == pytest.approx(thin["height_after"], rel=1e-4)


def test_sheets_mirrored_and_turned_have_one_critical_curvature():
    kinds = [(0.15, 0.0), (-0.15, 0.0), (0.0, 0.15)]
    values = [critical_curvature(250.0, divisions=2, offset=c)["curvature"] for c in kinds]
    assert values == pytest.approx([values[0]] * 3, rel=2e-5)


def test_sheets_without_a_dome_or_a_defect_are_refused():
    with pytest.raises(InvalidInput, match="flat"):
        critical_curvature(20.0, divisions=2)
    with pytest.raises(InvalidInput, match="`offset`"):
        sheet(200.0, offset=(0.5, 0.0))
    with pytest.raises(InvalidInput, match="isotropic"):
        sheet(200.0, tensor="isotropic")
    with pytest.raises(InvalidInput, match="`shape`"):
        sheet(200.0, shape="triangle")


def square(**changes):
    return disc(**changes).with_(mesh=meshes.rectangle(divisions=2))


def test_a_dome_that_is_deepened_loses_its_symmetry_and_does_not_invert():
    plate = square()
    found = inversion(plate, hoops(-1.0, 2.0), -1.74)
    assert not found.inverts
    assert np.isnan(found.parameter)
    (loss,) = found.losses
    assert loss.kind == "bifurcation"
    assert loss.index_after - loss.index_before == 1
    # The critical mode changes its sign under a quarter of a turn, or half of one: not the dome's.
    n = plate.space.nodes
    mode = np.zeros(plate.space.size)
    mode[plate.space.free] = loss.mode
    w = mode[2 * n : 3 * n]
    place = plate.space.positions
    turned = np.argmin(
        np.linalg.norm(place[:, None] - (place @ np.array([[0, -1], [1, 0]]))[None], axis=2), axis=1
    )
    assert w[turned] == pytest.approx(-w, abs=1e-5 * np.max(np.abs(w)))
    # What follows is stable, not inverted, and lies lower than the symmetric dome would.
    end = found.branches[-1].equilibria[-1]
    assert end.stable
    assert end.deflection[0] - end.deflection.min() > 0


def test_disc_loses_its_roundness_where_collocation_says():
    plate = disc().with_(mesh=meshes.disc(0.5, 3))
    start = dome(plate)
    branch = ls.follow(
        lambda p: plate.with_(curvature=hoops(p, -2 * p)), 0.0, 2.2, on_fold="stop", initial=start,
        eigenvalues=False, event_tolerance=1e-4,
    )  # fmt: skip
    (loss,) = branch.events

    def softest(p):
        return replace(DOME, curvature=(p, -2 * p)).solve(height=0.13).softest(2)

    assert loss.parameter == pytest.approx(brentq(softest, 1.0, 2.2, xtol=1e-5), rel=2e-3)
    # Waves of either phase go soft together.
    assert loss.index_after - loss.index_before == 2


def test_waves_that_turn_freely_are_named(monkeypatch):
    """A round dome that is deepened gives way to two waves; a square's waves are held by its sides."""

    def lost(*arguments):
        raise NotConverged("no minimum")

    monkeypatch.setattr(snap, "descend", lost)
    start = dome(disc())
    with pytest.raises(StabilityNotResolvable, match="2 waves around its rim"):
        inversion(disc(), hoops(-1.0, 2.0), -2.2, initial=start)
    with pytest.raises(NotConverged, match="no minimum"):  # a fold: roundness is kept
        inversion(disc(), hoops(-1.0, 2.0), 1.0, initial=start)
    with pytest.raises(NotConverged, match="no minimum"):
        inversion(square(), hoops(-1.0, 2.0), -1.74)


def test_released_energy_is_work_done_by_curvature():
    """dE/dp along the dome is the derivative at a fixed shape."""
    plate, direction = disc(), hoops(-1.0, 2.0)
    start = dome(plate)
    h = 1e-4

    def bent(p):
        return plate.with_(
            curvature=lambda x, y: p * direction(x, y)
        )  # fmt: skip

    total = (dome(bent(h)).energy - dome(bent(-h)).energy) / (2 * h)
    fixed = [bent(s * h).evaluate(start.state, np.zeros(0), 0).energy for s in (1, -1)]
    assert total == pytest.approx((fixed[0] - fixed[1]) / (2 * h), rel=1e-5)


def test_flat_plates_are_refused():
    with pytest.raises(InvalidInput, match="flat"):
        inversion(disc(strain=hoops(1e-4, 0.0)), hoops(-1.0, 2.0), 1.0)
    with pytest.raises(InvalidInput, match="stop"):
        inversion(disc(), hoops(-1.0, 2.0), 0.0)


def test_too_many_losses_are_an_error():
    with pytest.raises(NotConverged, match="most_losses"):
        inversion(square(), hoops(-1.0, 2.0), -1.74, most_losses=1)
