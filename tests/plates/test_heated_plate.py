"""Plate and heat together: limits, mirrored problems, a dome that snaps and one that does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lissome as ls
from lissome.errors import DataError, InvalidInput
from lissome.plates import (
    Conduction,
    Defect,
    FixedTemperature,
    HeatedPlate,
    Insulated,
    Laminate,
    Layer,
    Plate,
    SigmoidCurve,
    TabulatedCurve,
    UniformDirector,
    film_laminate,
    meshes,
    spontaneous_history,
)

MESH = meshes.rectangle(divisions=3)
CENTER = int(np.argmin(np.hypot(*MESH.p)))
CORNERS = np.flatnonzero(np.abs(np.abs(MESH.p).min(axis=0) - 0.5) < 1e-9)


def rise(equilibrium):
    """Height of the center over the corners."""
    w = equilibrium.deflection
    return float(w[CENTER] - w[CORNERS].mean())


def heated(laminate, *, length=1.0, bottom=True, until=2.0, hot=160.0, cold=25.0, director=None):
    faces = [FixedTemperature(hot), Insulated()]
    if not bottom:
        faces.reverse()
    problem = Conduction(laminate, *faces, cold)
    heat = problem.run(until=until * problem.time_scale)
    return HeatedPlate(MESH, laminate, director or Defect(), heat, length=length)


def test_a_small_even_curvature_is_a_paraboloid():
    # isotropic strains of 1e-7: linear theory, in which kappa_m fits together: w = kappa r^2/2
    curve = TabulatedCurve([0.0, 1.0], [0.0, -1e-7])
    sheet = Laminate([Layer(0.02, 1.0, 0.3, strain=curve, tensor="isotropic")])
    sample = heated(sheet, hot=1.0, cold=0.0)
    for time in (0.02, 0.1):
        equilibrium = ls.equilibrate(sample.structure(time))
        kappa = float(sample.spontaneous(time).curvature_along)
        assert kappa < 0
        assert rise(equilibrium) == pytest.approx(-kappa * 0.5**2, rel=1e-6)  # corners: r^2 = 1/2
        own = 0.5 * kappa**2 * sample.plate.bending / (1 - 0.3)
        assert abs(equilibrium.energy) < 1e-6 * own


def test_units_of_length_do_not_matter():
    films = {"soft_width": 12.0, "stiff_width": 25.0}
    small = heated(film_laminate(**films), length=2e-3)
    layers = film_laminate(**films).layers
    scaled = Laminate(
        [Layer(l.thickness / 2e-3, l.modulus, l.poisson_ratio, l.strain, l.tensor) for l in layers]
    )
    unit = heated(scaled, length=1.0)
    a, b = (ls.equilibrate(sample.structure(0.1)) for sample in (small, unit))
    assert a.energy == pytest.approx(b.energy, rel=1e-6)
    assert a.deflection == pytest.approx(b.deflection, abs=1e-6)
    # moduli as they are, on a mesh in meters: the same deflection, energies in joules
    metric = film_laminate(**films)
    plate = Plate(mesh=MESH.scaled(2e-3), **metric.moduli())
    now = small.spontaneous(0.1)
    c = ls.equilibrate(plate.with_(**now.fields(Defect())))
    assert c.deflection / 2e-3 == pytest.approx(a.deflection, abs=1e-5)
    assert c.energy == pytest.approx(a.energy * metric.stretching_modulus * 2e-3**2, rel=1e-5)


def test_turned_over_and_heated_from_above_is_the_mirror_image():
    sheet = film_laminate(soft_width=12.0, stiff_width=25.0)
    below = heated(sheet, length=1e-3).run(until=0.6, step=0.1)
    above = heated(sheet.flipped(), length=1e-3, bottom=False).run(until=0.6, step=0.1)
    assert len(below) == len(above)
    for a, b in zip(below.equilibria, above.equilibria, strict=True):
        assert b.energy == pytest.approx(a.energy, rel=1e-6)
        assert b.deflection == pytest.approx(-a.deflection, abs=1e-6)


def test_the_sheet_snaps_with_its_stiff_film_down_and_not_turned_over():
    films = {"soft_width": 12.0, "stiff_width": 25.0}
    down = heated(film_laminate(**films), length=2e-3)
    history = down.run(until=1.2, step=0.05, report_at=[0.2, 1.2])
    (snap,) = history.events
    zero = spontaneous_history(down.laminate, down.temperature).curvature_zeros()[0]
    zero /= down.temperature.problem.time_scale
    assert rise(history.equilibria[0]) > 0  # first a dome
    assert snap.time > zero  # locked in while the spontaneous curvature has changed its sign
    assert rise(snap.before) > 0 > rise(snap.after)
    assert snap.energy_released > 0
    assert snap.before.energy - snap.after.energy == pytest.approx(snap.energy_released, rel=0.05)
    assert rise(history.equilibrium) < 0
    up = heated(film_laminate(("soft", "soft", "stiff"), **films), length=2e-3)
    turned = up.run(until=1.2, step=0.1)
    assert not turned.events
    assert min(rise(e) for e in turned.equilibria) > 0


@pytest.fixture(scope="module")
def thin():
    """A square of 7 mm with its stiff film up: the dome deepens and loses its symmetry."""
    sheet = film_laminate(("soft", "soft", "stiff"), soft_width=12.0, stiff_width=25.0)
    return heated(sheet, length=7e-3, until=0.5)


def symmetries(w):
    """The motions of the square that leave a deflection as it is."""
    place = MESH.p.T
    found = set()
    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for mirror in (1, -1):
            turn = np.array([[a, -b], [b, a]]) @ np.diag([1, mirror])
            image = np.argmin(np.linalg.norm(place[:, None] - (place @ turn)[None], axis=2), axis=1)
            if np.max(np.abs(w[image] - w)) < 1e-4 * np.ptp(w):
                found.add((a, b, mirror))
    return found


def test_a_thin_square_loses_its_symmetry_gently_and_goes_on(thin):
    history = thin.run(until=0.45, step=0.05)
    (event,) = history.events
    assert event.kind == "loss of symmetry"
    before, after = (symmetries(e.deflection) for e in (event.before, event.after))
    assert after < before
    assert event.after.stable
    assert all(e.stable for e in history.equilibria)
    # A bifurcation: nothing jumps, and the symmetric state of that time is a saddle above.
    assert rise(event.after) == pytest.approx(rise(event.before), rel=0.05)
    plate = thin.structure(0.45)
    symmetric = ls.equilibrate(plate, event.before.state, require="any")
    assert symmetric.index == 1
    assert history.equilibrium.energy < symmetric.energy
    # The eigenvalue that vanishes is linear in time: its sign changes where the event is.
    for time, index in ((event.time - 0.006, 0), (event.time + 0.006, 1)):
        state = ls.equilibrate(thin.structure(time), event.before.state, require="any")
        assert state.index == index


def test_a_wave_of_the_rim_turns_and_settles_along_the_diagonals():
    """The second loss of stability of a thin sheet, stiff film up: its softest mode turns the wave."""
    sheet = film_laminate(("soft", "soft", "stiff"), soft_width=12.0, stiff_width=25.0)
    sample = replace(heated(sheet, length=7e-3, until=1.0), degree=3)
    turn = np.arange(16) * np.pi / 8
    rim = 0.49 * np.column_stack([np.cos(turn), np.sin(turn)])

    def wave(equilibrium):
        """Amplitude and direction (degrees) of the two-fold part of the rim."""
        w = equilibrium.structure.deflection_at(rim, equilibrium.state)
        part = np.fft.fft(w)[2] / 16
        return abs(part), (-np.degrees(np.angle(part)) / 2) % 90

    history = sample.run(until=0.78, step=0.1, start=0.6)
    (turning,) = history.events
    assert turning.kind == "snap"
    first, before, after = map(wave, (history.equilibria[0], turning.before, turning.after))
    angles = [min(angle, 90 - angle) for _, angle in (first, before)]
    assert angles[0] < angles[1] and 20 < angles[1] < 44  # on its way from the sides
    assert after[1] == pytest.approx(45.0, abs=0.5)
    assert after[0] == pytest.approx(before[0], rel=0.05)  # it turns, and does not grow
    assert 0 < turning.energy_released < 1e-4 * turning.before.energy
    assert all(e.stable for e in history.equilibria)
    assert rise(history.equilibrium) > 0


def test_an_interrupted_run_goes_on_from_its_checkpoint(thin, tmp_path):
    path = tmp_path / "run.npz"
    whole = thin.run(until=0.3, step=0.05, start=0.1)

    def give_up(time, memory, equilibrium):
        if time > 0.19:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        thin.run(until=0.3, step=0.05, start=0.1, checkpoint=path, stop_when=give_up)
    calls = []
    resumed = thin.run(
        until=0.3, step=0.05, start=0.1, checkpoint=path,
        stop_when=lambda time, memory, equilibrium: calls.append(time),
    )  # fmt: skip
    assert min(calls) > 0.2  # nothing is done twice
    assert resumed.times == pytest.approx(whole.times)
    for a, b in zip(resumed.equilibria, whole.equilibria, strict=True):
        assert a.energy == pytest.approx(b.energy, rel=1e-8)
    assert len(thin.run(until=0.3, step=0.05, start=0.1, checkpoint=path)) == len(whole)
    with pytest.raises(InvalidInput, match="begins at"):
        thin.run(until=0.3, step=0.05, start=0.15, checkpoint=path)
    with pytest.raises(InvalidInput, match="outputs"):
        thin.run(until=0.3, step=0.05, start=0.1, checkpoint=path, outputs={"t": lambda *a: 0.0})
    path.write_bytes(b"not an archive")
    with pytest.raises(DataError):
        thin.run(until=0.3, step=0.05, start=0.1, checkpoint=path)


def test_the_time_is_a_parameter_that_a_branch_can_follow():
    sample = heated(film_laminate(soft_width=12.0, stiff_width=25.0), length=1e-3)
    branch = ls.follow(sample.structure, start=0.1, stop=0.5)
    direct = ls.equilibrate(sample.structure(0.5))
    assert branch.equilibria[-1].energy == pytest.approx(direct.energy, rel=1e-6)


def test_bad_input():
    sheet = Laminate([Layer(0.02, 1.0, 0.5, strain=SigmoidCurve(0.05, 100.0, 10.0))])
    good = heated(sheet, until=0.5)
    heat = good.temperature
    with pytest.raises(InvalidInput, match="outside the plate"):
        HeatedPlate(MESH, sheet, Defect(center=(0.6, 0.0)), heat)
    with pytest.raises(InvalidInput, match="pass a Director"):
        HeatedPlate(MESH, sheet, 0.0, heat)
    with pytest.raises(InvalidInput, match="pass a TemperatureHistory"):
        HeatedPlate(MESH, sheet, UniformDirector(), 160.0)
    with pytest.raises(InvalidInput, match="other thicknesses"):
        HeatedPlate(MESH, Laminate([Layer(0.03, 1.0, 0.5)]), Defect(), heat)
    with pytest.raises(InvalidInput, match="`length`"):
        HeatedPlate(MESH, sheet, Defect(), heat, length=0.0)
    with pytest.raises(InvalidInput, match="within the history"):
        good.run(until=0.6, step=0.1)
    with pytest.raises(InvalidInput, match="`max_steps`"):
        good.run(until=0.4, step=0.1, max_steps=0)
    with pytest.raises(InvalidInput, match="`step`"):
        good.run(until=0.4, step=0.0)
    with pytest.raises(InvalidInput, match="run it for longer"):
        good.structure(0.7)
    many = spontaneous_history(sheet, heat).values
    with pytest.raises(InvalidInput, match="those of one time"):
        many.fields(Defect())
