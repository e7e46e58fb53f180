"""Rods that are made from one another share what was derived: never what belongs to another one."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons
from lissome.rods import Kirchhoff, RodState, shapes

LAW = Kirchhoff((1.0, 2.0), 0.7)
QUARTER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
BENT = RodState(np.tile([1.0, 0.0, 0.0, 0.0], (8, 1)), origin=[0.0, 0.1, 0.0])

CHANGES = {
    "moved clamp": lambda rod, x: rod.clamped("end", (0.1 * x, 0.0, 0.9), np.eye(3)),
    "turned clamp": lambda rod, x: rod.clamped("end", (0.1, 0.0, 0.9), QUARTER if x > 0.5 else None),
    "clamped segment": lambda rod, x: rod.clamped("end", (0.0, 0.1 * x, 0.8), None, "segment"),
    "hinge": lambda rod, x: rod.hinged("end", (0.1, 0, None), np.eye(3), axis=(x, 1, 0)),
    "driven hinge": lambda rod, x: rod.hinged("end", (0.1, 0, None), np.eye(3), axis=(1, 0, 0), moment=x),
    "pin": lambda rod, x: rod.pinned("end", (None, 0.1 * x, 0.8)),
    "pin in the middle": lambda rod, x: rod.pinned(4, (0.1 * x, 0.0, None)),
    "start slides": lambda rod, x: rod.pinned(4, (0.0, x / 9, None)).clamped("start", (0.0, None, 0.0)),
    "middle freed": lambda rod, x: rod.clamped("start", (0.0, x / 9, 0.0)).freed(4),
    "force": lambda rod, x: rod.loaded(end=(x, 0.0, 0.0)),
    "couple": lambda rod, x: rod.loaded(end=(x, 1.0, 0.0), arm=(0.1, 0.0, x)),
    "weight": lambda rod, x: rod.loaded(distributed=(0.0, 0.0, -x)),
    "law": lambda rod, x: rod.with_law(Kirchhoff((1.0 + x, 2.0), 0.7)),
    "natural": lambda rod, x: rod.with_natural(curvature_1=x),
    "initial": lambda rod, x: rod.with_initial(BENT if x > 0.5 else rod.initial),
}  # fmt: skip


def parts(rod):
    """Yield all that is derived from a rod, by name."""
    layout = rod.layout
    yield from layout.plan._asdict().items()
    for name in ("fixed", "turning_axes", "anchors", "origin", "node_forces", "net_force", "nodes"):
        yield name, getattr(layout, name)
    yield from (("length", rod.length), ("arclength", rod.arclength), ("metric", layout.metric))
    state = rod.retract(rod.adopt(BENT), 0.1 * np.cos(np.arange(rod.size)))
    multipliers = np.sin(np.arange(1.0, rod.constraints_count + 1))
    here = rod.evaluate(state, multipliers)
    yield from (("energy", here.energy), ("gradient", here.gradient), ("gauge", rod.gauge(state)))
    yield "difference", rod.difference(rod.adopt(BENT), state)


@pytest.mark.parametrize("seed", range(8))
def test_a_rod_does_not_depend_on_those_that_it_was_made_from(seed):
    """One made anew of the same parts, which shares nothing, has the same layout and energy."""
    rng = np.random.default_rng(seed)
    rod = shapes.straight(1.0, 8, LAW).clamped("start")
    for name in rng.choice(list(CHANGES), 25):
        rod = CHANGES[name](rod, rng.uniform())
        for (what, own), (_, fresh) in zip(parts(rod), parts(replace(rod)), strict=True):
            assert np.array_equal(own, fresh), (name, what)


def test_those_that_it_was_made_from_do_not_change():
    strip = shapes.straight(1.0, 8, LAW).clamped("start")
    before = [(name, copy.deepcopy(part)) for name, part in parts(strip)]
    for change in CHANGES.values():
        list(parts(change(strip, 0.7)))
    for (name, old), (_, now) in zip(before, parts(strip), strict=True):
        assert np.array_equal(old, now), name


class Unsaved(Kirchhoff):
    """A law that cannot be pickled."""

    def __reduce__(self):
        raise TypeError("a law that cannot be pickled")


def test_a_pickled_rod_takes_nothing_of_another_along():
    strip = shapes.straight(1.0, 8, LAW).clamped("start")
    other = strip.with_law(Unsaved((1.0, 2.0), 0.7))
    assert other.size == strip.size  # both are derived
    with pytest.raises(TypeError, match="cannot be pickled"):
        pickle.dumps(other)
    for made in (pickle.loads(pickle.dumps(strip)), copy.deepcopy(strip), copy.copy(strip)):
        for (name, own), (_, same) in zip(parts(strip), parts(made), strict=True):
            assert np.array_equal(own, same), name
        moved = made.clamped("end", (0.1, 0.0, 0.9))
        assert moved.constraints_count == 3


def test_a_pickled_ribbon_has_the_same_equilibrium():
    law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    strip = ribbons.straight(1.0, 12, law).clamped("start").clamped("end", (0.0, 0.0, 0.9))
    found = ls.equilibrate(strip)
    again = ls.equilibrate(pickle.loads(pickle.dumps(strip)))
    assert again.energy == found.energy
    assert np.array_equal(again.state.rulings, found.state.rulings)
