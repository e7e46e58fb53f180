"""What is passed for something else is named, with what to pass: never an error from deep inside."""

import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import lissome as ls
from lissome import beams, plates, rods
from lissome.errors import InvalidInput
from lissome.plates import meshes

LAW = rods.Kirchhoff(bending=(1.0, 2.0), twisting=1.0)
COLUMN = rods.straight(1.0, 8, LAW).clamped("start")
RESTING = ls.equilibrate(COLUMN)
WELL = {
    "initial": [1.0],
    "energy": lambda x: float(x @ x),
    "gradient": lambda x: 2 * x,
    "hessian": lambda x: 2 * np.eye(1),
}


def family(load):
    return COLUMN.loaded(end=(0, 0, -load))


STRANGE = [0, float("nan"), "abc", [], [1.0, 2.0], np.zeros((2, 2, 2)), True, 1j, {}, object()]


def is_stranger(name, value):
    """Tell whether a value is none that the argument `name` takes."""
    allowed = {
        "outputs": isinstance(value, dict),
        "multipliers": isinstance(value, list) and not value,  # there are no constraints
        "initial": type(value) is int or (isinstance(value, list) and bool(value)),
        "state": type(value) is object,  # states are of any type that the structure knows
        "parameter": value == [1.0, 2.0] if isinstance(value, list) else type(value) is int,
    }
    return not allowed.get(name, False)


CALLS = {
    "equilibrate": (ls.equilibrate, {"structure": COLUMN, "multipliers": None, "tolerance": None}),
    "follow": (ls.follow, {"family": family, "start": 0.0, "stop": 0.1, "outputs": None}),
    "smallest_eigenvalue": (
        ls.smallest_eigenvalue,
        {"structure": COLUMN, "state": RESTING.state, "multipliers": (), "count": 1},
    ),
    "sensitivity": (
        ls.sensitivity,
        {
            "family": family,
            "parameter": 0.0,
            "equilibrium": RESTING,
            "outputs": None,
            "mode": "direct",
        },
    ),
    "DenseStructure": (ls.DenseStructure, {**WELL, "masses": None, "size_of_unknowns": 1.0}),
    "ring": (rods.ring, {"length": 1.0, "segments": 8, "law": LAW, "about": 1}),
}
SWAPPED = {"equilibrate": ["structure", "multipliers", "tolerance"], "follow": ["family", "outputs"],
           "smallest_eigenvalue": ["structure", "state", "multipliers", "count"],
           "sensitivity": ["family", "parameter", "equilibrium", "outputs", "mode"],
           "DenseStructure": ["initial", "energy", "gradient", "hessian", "masses", "size_of_unknowns"],
           "ring": ["about"]}  # fmt: skip


@pytest.mark.parametrize(("call", "name"), [(c, n) for c, names in SWAPPED.items() for n in names])
def test_a_wrong_thing_is_named(call, name):
    function, arguments = CALLS[call]
    function(**arguments)
    for value in filter(lambda v: is_stranger(name, v), STRANGE):
        with pytest.raises(InvalidInput, match=f"(argument|function) `{name}"):
            function(**{**arguments, name: value})


def test_what_is_near_to_a_structure_gets_the_nearest_remedy():
    with pytest.raises(InvalidInput, match="pass the structure that it returns"):
        ls.equilibrate(family)
    with pytest.raises(InvalidInput, match="pass its `structure`"):
        ls.equilibrate(RESTING)
    with pytest.raises(InvalidInput, match=r"argument `family\(start\)`"):
        ls.follow(lambda load: load, 0.0, 1.0)
    with pytest.raises(InvalidInput, match="pass a state"):
        ls.smallest_eigenvalue(COLUMN, RESTING)
    with pytest.raises(InvalidInput, match=r"name.*function"):
        ls.follow(family, 0.0, 1.0, outputs={"load": 3.0})


def test_a_start_is_a_state_of_the_same_kind():
    well, strip = ls.DenseStructure(**WELL), beams.ClampedStrip(span=0.9, segments=8)
    for structure in (well, strip, COLUMN):
        for value in ([1.0], (1.0,), np.ones(1), 1.0, "state", {"x": 1.0}):
            with pytest.raises(InvalidInput, match=r"argument `(start|state)`"):
                ls.equilibrate(structure, start=value)
    with pytest.raises(InvalidInput, match="argument `start` is of type VectorState"):
        ls.equilibrate(strip, start=well.start())


def test_an_end_that_is_thrown_behind_its_clamp_asks_for_smaller_steps():
    rod = rods.straight(1.0, 20, LAW).clamped("start")
    with pytest.raises(ls.NotConverged, match="start nearer, or go there in small steps"):
        ls.equilibrate(rod.clamped("end", position=(0.0, 0.0, -0.9)))


@pytest.mark.parametrize("name", ["bending", "stretching", "pressure", "strain", "curvature"])
@pytest.mark.parametrize("function", [lambda x: x, lambda x, y: "abc"], ids=["one", "text"])
def test_a_field_on_a_plate_that_fails_is_named(name, function):
    fields = {"mesh": meshes.rectangle(divisions=1), "bending": 1e-4, "poisson_ratio": 0.3}
    with pytest.raises(InvalidInput, match=f"the function `{name}` failed, or returned no array"):
        ls.equilibrate(plates.Plate(**{**fields, "edges": "clamped", name: function}))


@pytest.mark.parametrize("name", ["soft_width", "stiff_width", "stiff_transition"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), "12 K", [12.0]])
def test_a_laminate_of_films_names_its_own_arguments(name, value):
    with pytest.raises(InvalidInput, match=f"argument `{name}`"):
        plates.film_laminate(**{"soft_width": 12.0, "stiff_width": 25.0, name: value})


@pytest.mark.parametrize("value", [-1.0, float("nan"), "abc", 1j, {}])
def test_energies_are_numbers(value):
    with pytest.raises(InvalidInput, match="argument `released_energy`"):
        plates.energy_height(value, stretching_modulus=1e3, thickness=9e-5, density=1e3)


def dataclasses_with_arrays():
    """Yield the public classes of values that hold arrays."""
    for info in pkgutil.walk_packages(ls.__path__, "lissome."):
        module = importlib.import_module(info.name)
        for name in getattr(module, "__all__", ()):
            kind = getattr(module, name)
            if dataclasses.is_dataclass(kind) and inspect.isclass(kind):
                types = [str(field.type) for field in dataclasses.fields(kind) if field.compare]
                held = [text for text in types if "Callable" not in text]
                if any("Array" in text or "Equilibrium" in text for text in held):
                    yield kind


def test_what_holds_arrays_is_compared_by_identity_and_can_be_a_key():
    """Comparing the arrays in a tuple of fields would raise, in `==`, in `in` and in `index`."""
    kinds = set(dataclasses_with_arrays())
    assert {type(RESTING), type(RESTING.state), ls.Event, ls.History} <= kinds
    assert [kind for kind in kinds if kind.__eq__ is not object.__eq__] == []
    again = ls.equilibrate(COLUMN)
    assert again != RESTING and again.state != RESTING.state
    assert {RESTING: "a"}[RESTING] == "a"
    assert [RESTING, again].index(again) == 1
