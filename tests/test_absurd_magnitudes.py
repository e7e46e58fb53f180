"""Numbers that no problem has: refused by name, or computed with; never an arithmetic error."""

import dataclasses
import math
import warnings

import numpy as np
import pytest

import lissome as ls
from lissome import beams, plates, ribbons, rods
from lissome.errors import InvalidInput
from lissome.plates import meshes

ABSURD = [1e300, 1e155, 1e60, 1e-60, 1e-155, 5e-324]
STRAINS = np.array([[0.1, 0.2, 0.3]])


def law(made):
    return made.evaluate(STRAINS, 2)


def shown(made):
    """Return all numbers that an object tells by properties."""
    return [getattr(made, name) for name in dir(made) if not name.startswith("_")]


def film(made):
    there = made.spontaneous(160.0)
    return made.bending_modulus, made.bending_length, there.strain_along, there.curvature_along


def layered(**numbers):
    known = {"modulus": 1.0, "poisson_ratio": 0.3, "thickness": 1.0}
    active = plates.Layer(1.0, 2.0, 0.3, strain=plates.film_curve("soft", width=12.0))
    return plates.Laminate([plates.Layer(**(known | numbers)), active])


# Constructor, arguments of a sound problem, and what is done with what it makes.
CASES = {
    "Kirchhoff": (rods.Kirchhoff, {"bending": 1.0, "twisting": 1.0}, law),
    "Kirchhoff.rectangle": (
        rods.Kirchhoff.rectangle,
        {"width": 0.1, "thickness": 0.01, "young_modulus": 1.0, "poisson_ratio": 0.3}, law),
    "Circle": (rods.Circle, {"diameter": 0.1}, shown),
    "Ellipse": (rods.Ellipse, {"width": 0.1, "thickness": 0.2}, shown),
    "Rectangle": (rods.Rectangle, {"width": 0.1, "thickness": 0.2}, shown),
    "SanoWada": (rods.SanoWada, {"bending": 1.0, "twisting": 1.0, "crossover": 1.0}, law),
    "SanoWada.from_geometry": (
        rods.SanoWada.from_geometry,
        {"width": 0.1, "thickness": 0.01, "young_modulus": 1.0, "poisson_ratio": 0.3}, law),
    "RelaxedRibbon": (
        rods.RelaxedRibbon,
        {"bending": 1.0, "twisting": 1.0, "crossover": 1.0, "smoothing": 0.1}, law),
    "RefinedRibbon": (
        rods.RefinedRibbon, {"thickness": 0.01, "young_modulus": 1.0, "poisson_ratio": 0.3, "width": 0.1},
        None),
    "straight": (
        lambda **k: rods.straight(segments=10, law=rods.Kirchhoff(1.0, 1.0), **k).clamped("start"),
        {"length": 1.0, "stretching": 10.0}, lambda rod: ls.equilibrate(rod).energy),
    "ring": (
        lambda **k: rods.ring(segments=10, law=rods.Kirchhoff(1.0, 1.0), **k), {"length": 1.0},
        lambda rod: rod.positions(rod.start())),
    "Wunderlich": (
        ribbons.Wunderlich,
        {"width": 0.1, "thickness": 0.01, "young_modulus": 1.0, "poisson_ratio": 0.3}, shown),
    "circle": (
        lambda **k: ribbons.circle(segments=20, law=ribbons.Wunderlich(width=0.01, rigidity=1.0), **k),
        {"length": 1.0}, None),
    "ClampedStrip": (
        beams.ClampedStrip, {"natural_curvature": 0.1, "response": 1.0, "span": 0.9}, None),
    "disc": (meshes.disc, {"radius": 1.0}, lambda mesh: mesh.doflocs),
    "rectangle": (meshes.rectangle, {"width": 1.0, "height": 1.0}, lambda mesh: mesh.p),
    "Plate": (
        lambda **k: plates.Plate(mesh=meshes.rectangle(divisions=1), edges="clamped", **k),
        {"bending": 1.0, "poisson_ratio": 0.3, "stretching": 1.0, "pressure": 1e-3},
        lambda plate: plate.start().x),
    "Layer": (layered, {"thickness": 1.0, "modulus": 1.0}, film),
    "PlateScales": (
        plates.PlateScales, {"stretching_modulus": 1.0, "bending_modulus": 1.0, "length": 1.0}, shown),
    "PlateScales.uniform": (
        plates.PlateScales.uniform, {"thickness": 0.1, "length": 1.0, "young_modulus": 1.0}, shown),
    "Flight": (plates.Flight, {"speed": 1.0, "gravity": 9.8}, shown),
    "launch_speed_with_drag": (
        plates.launch_speed_with_drag, {"height": 1.0, "terminal": 1.0, "gravity": 9.8}, None),
    "terminal_speed": (
        plates.terminal_speed,
        {"thickness": 1.0, "density": 1.0, "air_density": 1.2, "drag_coefficient": 1.1}, None),
    "energy_height": (
        plates.energy_height,
        {"released_energy": 1.0, "stretching_modulus": 1.0, "thickness": 0.1, "density": 1.0}, None),
}  # fmt: skip


def numbers(value):
    """Return all floats in nested results."""
    if isinstance(value, (float, np.floating)):
        return [float(value)]
    if isinstance(value, np.ndarray):
        return value.ravel().tolist() if value.dtype.kind == "f" else []
    if isinstance(value, (tuple, list)):
        return [number for item in value for number in numbers(item)]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [n for f in dataclasses.fields(value) for n in numbers(getattr(value, f.name, None))]
    return []


@pytest.mark.parametrize("size", ABSURD)
@pytest.mark.parametrize(
    ("name", "argument"), [(name, argument) for name, case in CASES.items() for argument in case[1]]
)
def test_absurd_numbers_are_refused_or_computed_with(name, argument, size):
    make, sound, use = CASES[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            made = make(**(sound | {argument: size}))
            found = numbers([made, use(made) if use else None])
        except InvalidInput as error:
            message, found = str(error), []
        else:
            message = ""
    assert "argument" in message if message else all(map(math.isfinite, found))


LAWS = [
    rods.Kirchhoff(bending=(1.0, 2.0), twisting=1.0),
    rods.SanoWada.from_geometry(0.1, 0.01, poisson_ratio=0.3),
    rods.RefinedRibbon(0.1, 0.01, poisson_ratio=0.3),
    rods.RelaxedRibbon.sadowsky(0.1, 0.01, poisson_ratio=0.3, smoothing=0.1),
]


@pytest.mark.parametrize("size", [*ABSURD, 1e20, -1e59, -1e155])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_absurd_strains_are_refused_or_computed_with(law, size):
    for row in np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1e-9]]):
        if abs(size) > 1e60:
            with pytest.raises(InvalidInput, match=r"argument `k` holds .*; use units"):
                law.evaluate(size * row[None], 2)
        else:
            assert all(map(math.isfinite, numbers(law.evaluate(size * row[None], 2))))


@pytest.mark.parametrize("law", [ribbons.Wunderlich, ribbons.Sadowsky])
def test_absurd_bending_and_rulings_are_refused(law):
    made = law(width=0.1, rigidity=1.0)
    for strains, said in (
        ((1e155, 0.0), "argument `bending` holds"),
        ((0.1, 1e155), "argument `ruling` holds"),
        ((1e50, 1e60), "arguments `bending` and `ruling` are 1e\\+50 and 1e\\+60"),
    ):
        with pytest.raises(InvalidInput, match=said):
            made.energy(*strains)
    assert made.energy(1e60, 0.0) == pytest.approx(0.05e120)


def test_what_is_refused_is_named_with_its_remedy():
    for call, said in (
        (
            lambda: rods.Circle(1e300),
            "argument `diameter` is 1e\\+300; use units in which it is at most",
        ),
        (
            lambda: rods.Circle(1e-300),
            "argument `diameter` is 1e-300; use units in which it is at least",
        ),
        (
            lambda: rods.straight(lengths=[0.1, 1e300], law=rods.Kirchhoff(1.0, 1.0)),
            "argument `lengths` holds 1e\\+300; use units",
        ),
        (lambda: rods.writhe(1e300 * np.eye(3)), "argument `nodes` holds 1e\\+300; use units"),
        (
            lambda: rods.writhe(1e-300 * np.eye(3)),
            "argument `nodes` has the extent 1e-300; use units",
        ),
        (lambda: plates.PlateScales(1e-59, 1e59, 1e-59), "make units that no float can hold"),
        (
            lambda: rods.RelaxedRibbon(1.0, 1.0, 1.0, smoothing=1e60),
            "argument `smoothing` is 1e\\+60",
        ),
    ):
        with pytest.raises(InvalidInput, match=said):
            call()


def test_strips_between_clamps_that_nearly_touch():
    """The guess of the shape exists at any span, down to none."""
    for span in (1e-3, 1e-4, 1e-9):
        start = beams.ClampedStrip(span=span).start()
        assert np.isfinite(start.angles).all()
