"""Bifurcation diagrams of a sheared strip between clamps, by following branches.

The strip of Panda and Jawed (2026): 45 nodes, pushed together by a quarter of its length and shifted
sideways. Their dynamic relaxation of one diagram takes 25 to 56 s on the machine of these
benchmarks; it is not run here (it needs another simulator), and the ratio is against its fastest.
"""

from __future__ import annotations

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons, rods

THICKNESS, NU, STOP = 0.01, 0.5, 0.5
FRAME = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
RELAXATION = (25.0, 56.0)  # seconds, of the published code


def law_of(name, width):
    young = 12.0 / (width * THICKNESS**3)
    make = {
        "Kirchhoff": lambda: rods.Kirchhoff.rectangle(
            width, THICKNESS, young, poisson_ratio=NU, torsion_constant=width * THICKNESS**3 / 3
        ),
        "Sano and Wada": lambda: rods.SanoWada.from_geometry(
            width, THICKNESS, young, poisson_ratio=NU
        ),
        "Audoly and Neukirch": lambda: rods.RefinedRibbon(
            width, THICKNESS, young, poisson_ratio=NU
        ),
        "Sadowsky, relaxed": lambda: rods.RelaxedRibbon.sadowsky(
            width, THICKNESS, young, poisson_ratio=NU, smoothing=0.1
        ),
    }
    return make[name]()


def sheared(name, width):
    strip = rods.straight(
        1.0, 44, law_of(name, width), tangent=(1, 0, 0), director=(0, 1, 0)
    ).clamped("start", (0, 0, 0))
    return lambda shear: strip.clamped("end", (0.75, shear, 0.0), FRAME)


def diagram(family):
    """Follow the arch, the branch that crosses it, and the flat state where that ends."""
    outputs = {"height": lambda e: e.positions[22, 2]}
    parts = [ls.follow(family, 0.0, STOP, on_fold="stop", eigenvalues=False, outputs=outputs)]
    if parts[0].events:
        options = {"stop": STOP, "bounds": (0.0, STOP), "on_fold": "stop"}
        parts.append(parts[0].switch(parts[0].events[0], **options))
        if parts[1].events[-1].kind == "fold":
            far = ls.equilibrate(family(STOP), parts[1].equilibria[-1].state)
            parts.append(
                ls.follow(
                    family, STOP, 0.0, initial=far, on_fold="stop", eigenvalues=False,
                    outputs=outputs,
                )
            )  # fmt: skip
    return parts


@pytest.mark.parametrize("part", [40, 20, 12, 6])
@pytest.mark.parametrize(
    "name", ["Kirchhoff", "Sano and Wada", "Audoly and Neukirch", "Sadowsky, relaxed"]
)
def test_diagram(benchmark, measure, name, part):
    family = sheared(name, 1.0 / part)
    found = diagram(family)  # compiled now
    states = sum(len(branch) for branch in found)
    note = f"{states} equilibria; dynamic relaxation: {RELAXATION[0]:g} to {RELAXATION[1]:g} s"
    measure(f"{name}, w/L = 1/{part}", group="a sheared strip between clamps, 45 nodes: one diagram",
            within=0.5, note=note)  # fmt: skip
    parts = benchmark.pedantic(diagram, (family,), rounds=5, warmup_rounds=1)
    assert np.all([branch.finished for branch in parts])
    best = benchmark.stats.stats.min
    benchmark.extra_info["note"] = f"{note}, {RELAXATION[0] / best:.0f} times as long"


def dense(low, high, ratio):
    """Lengths of 44 segments: denser where inflections pass, `low` to `high`, and in its mirror image."""
    s = np.linspace(0.0, 1.0, 20001)
    x = np.minimum(s, 1.0 - s)
    inside = 0.25 * (1.0 + np.tanh((x - low) / 0.03)) * (1.0 + np.tanh((high - x) / 0.03))
    density = 1.0 + (ratio - 1.0) * inside
    t = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return np.diff(np.interp(np.linspace(0.0, 1.0, 45), t / t[-1], s))


@pytest.mark.parametrize(
    ("part", "mesh", "place"),
    [
        (40, (0.08, 0.25, 8.0), None),
        (20, (0.1, 0.25, 5.0), 0.44056),
        (12, (0.15, 0.26, 3.0), 0.36588),
        (6, (0.2, 0.28, 2.0), 0.33181),
    ],
)
def test_strip_that_cannot_stretch(benchmark, measure, part, mesh, place):
    """The arch to its pitchfork, and what it snaps to, to the end of the shear; the rest is its mirror.

    `place`: the pitchfork by collocation; None if there is none.
    """
    law = ribbons.Wunderlich(width=1.0 / part, rigidity=part / (1.0 - NU**2))
    strip = ribbons.straight(
        law=law, lengths=dense(*mesh), tangent=(1, 0, 0), director=(0, 1, 0), scheme="moments"
    ).clamped("start", (0, 0, 0))

    def follow():
        return ls.follow(
            lambda shear: strip.clamped("end", (0.75, shear, 0.0), FRAME), 0.0, STOP,
            on_fold="snap", eigenvalues=False, event_tolerance=1e-4, overshoot=1e-2,
        )  # fmt: skip

    found = follow()  # compiled now
    note = f"{len(found)} equilibria"
    measure(f"Wunderlich, w/L = 1/{part}",
            group="a sheared strip between clamps, 45 nodes: one diagram", within=0.5, note=note)  # fmt: skip
    found = benchmark.pedantic(follow, rounds=5, warmup_rounds=1)
    assert found.finished
    assert found.equilibria[-1].stable
    lost = [event.parameter for event in found.events if event.kind == "bifurcation"]
    assert lost == ([] if place is None else [pytest.approx(place, rel=0.02)])
