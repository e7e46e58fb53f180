"""Arrays of results are shared by all who ask for them: nobody can write into them."""

import numpy as np
import pytest

import lissome as ls
from lissome import beams, plates, ribbons, rods
from lissome.plates import meshes


def rod():
    law = rods.Kirchhoff(bending=(1.0, 2.0), twisting=1.0)
    return rods.straight(1.0, 12, law).clamped("start").loaded(end=(0.0, 1.0, 0.0))


def ribbon():
    law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    return ribbons.straight(1.0, 20, law).clamped("start").loaded(end=(0.0, -0.3, 0.0))


def plate():
    return plates.Plate(
        mesh=meshes.rectangle(divisions=2), bending=1e-4, poisson_ratio=0.3, pressure=1e-6,
        edges="clamped",
    )  # fmt: skip


def strip():
    return beams.ClampedStrip(span=0.95, segments=20)


def arrays(equilibrium):
    """Yield the public arrays of numbers of a result, by name."""
    kind = type(equilibrium)
    for name in dir(kind):
        attribute = getattr(kind, name)
        if not name.startswith("_") and (hasattr(attribute, "__get__") and not callable(attribute)):
            try:
                value = getattr(equilibrium, name)
            except ls.InvalidInput:
                continue  # not every rod has a linking number
            if isinstance(value, np.ndarray) and value.size:
                yield name, value


@pytest.mark.parametrize("make", [rod, ribbon, plate, strip], ids=lambda make: make.__name__)
def test_what_is_written_into_a_result_is_refused_or_lost(make):
    equilibrium = ls.equilibrate(make())
    found = dict(arrays(equilibrium))
    before = {name: value.copy() for name, value in found.items()}
    assert len(found) > 2
    for name, value in found.items():
        if name in ("metric", "gauge"):  # the solvers' own
            continue
        if value.flags.writeable:
            value[...] = 123
        assert np.array_equal(getattr(equilibrium, name), before[name]), name
    again = ls.equilibrate(equilibrium.structure)
    assert again.energy == pytest.approx(equilibrium.energy, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "force"), [(rod, [0.0, 1.0, 0.0]), (ribbon, [0.0, -0.3, 0.0])], ids=["rod", "ribbon"]
)
def test_energies_add_up(make, force):
    structure = make()
    bent = ls.equilibrate(structure)
    assert bent.bending_energy > 0
    assert bent.stretching_energy == 0
    assert bent.load_energy == pytest.approx(-np.dot(force, bent.positions[-1]), rel=1e-12)
    assert bent.energy == pytest.approx(bent.bending_energy + bent.load_energy, rel=1e-12)
