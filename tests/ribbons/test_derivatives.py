"""Gradient, Hessian and constraints of ribbons against differences of the energy."""

from __future__ import annotations

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons

WUNDERLICH = ribbons.Wunderlich(
    width=0.1, rigidity=1.3, poisson_ratio=0.3, natural_curvature=1.0, natural_twist=0.5,
    natural_cross_curvature=-0.7,
)  # fmt: skip
SADOWSKY = ribbons.Sadowsky(width=0.1, rigidity=1.0)


def _open(law, scheme):
    flat = ribbons.straight(1.0, 12, law, scheme=scheme).clamped("start")
    return flat.clamped("end", (0.1, 0, 0.7)).loaded(nodes={5: (1, 2, 3)})


STRUCTURES = {
    "clamped": _open,
    "inner clamp": lambda law, scheme: _open(law, scheme).clamped(6, (0.02, 0, 0.4)),
    "free end": lambda law, scheme: _open(law, scheme).freed("end"),
    "segment": lambda law, scheme: _open(law, scheme).clamped("start", clamp="segment"),
    "hinged": lambda law, scheme: _open(law, scheme).hinged(
        "end", (0.1, 0, 0.7), axis=(1, 2, 0.3), moment=0.2
    ),
    "uneven": lambda law, scheme: ribbons.straight(
        law=law, lengths=np.linspace(0.1, 0.2, 9), scheme=scheme
    ).clamped("start"),
    **{
        f"band {n} {joint}": lambda law, scheme, n=n, joint=joint: ribbons.band(
            1.0, 12, law, n, scheme=scheme, joint=joint
        )
        for n in (0, 1, 2, -3)
        for joint in ("matched", "free")
    },
    "loaded band": lambda law, scheme: ribbons.band(1.0, 12, law, 1, scheme=scheme).loaded(
        nodes={3: (1, 0, 0), 6: (-1, 0, 0)}
    ),
}


def _differences(f, h):
    """First and second derivative at 0, fourth order."""
    a, b, c, d, e = (f(k * h) for k in (-2, -1, 0, 1, 2))
    return (a - 8 * b + 8 * d - e) / (12 * h), (-a + 16 * b - 30 * c + 16 * d - e) / (12 * h * h)


@pytest.mark.parametrize("law", [WUNDERLICH, SADOWSKY], ids=["wunderlich", "sadowsky"])
@pytest.mark.parametrize("scheme", ["staggered", "cells", "nodal"])
@pytest.mark.parametrize("name", STRUCTURES)
def test_derivatives_of_random_states(name, scheme, law):
    ribbon = STRUCTURES[name](law, scheme)
    rng = np.random.default_rng(len(name))
    state = ribbon.retract(ribbon.start(), 0.1 * rng.normal(size=ribbon.size))
    multipliers = rng.normal(size=ribbon.constraints_count)
    dx = rng.normal(size=ribbon.size)
    here = ribbon.evaluate(state, multipliers, 2)

    def lagrangian(t):
        there = ribbon.evaluate(ribbon.retract(state, t * dx), multipliers, 0)
        return there.energy + multipliers @ there.constraints

    def constraints(t):
        return ribbon.evaluate(ribbon.retract(state, t * dx), multipliers, 0).constraints

    bent, moved = here.kkt.apply(dx, np.zeros_like(multipliers))
    slope, curvature = _differences(lagrangian, 1e-3)
    scale = np.abs(here.gradient) @ np.abs(dx)
    assert here.gradient @ dx == pytest.approx(slope, abs=1e-8 * scale)
    assert dx @ bent == pytest.approx(curvature, rel=1e-6, abs=1e-5 * scale)
    assert moved == pytest.approx(_differences(constraints, 1e-3)[0], abs=1e-8)


@pytest.mark.parametrize("name", ["clamped", "free end", "segment", "hinged", "uneven", "jaws"])
def test_derivatives_where_moments_are_unknowns(name):
    """Constraints depend on the multipliers: those of the Lagrangian in both, and its symmetry."""
    law = ribbons.Wunderlich(width=0.1, rigidity=1.3)
    if name == "jaws":
        ribbon = _open(law, "moments").clamped("start", ruling=0.1)
    else:
        ribbon = STRUCTURES[name](law, "moments")
    rng = np.random.default_rng(len(name))
    state = ribbon.retract(ribbon.start(), 0.1 * rng.normal(size=ribbon.size))
    multipliers = rng.normal(size=ribbon.constraints_count)
    dx, dm = rng.normal(size=ribbon.size), rng.normal(size=multipliers.size)
    here = ribbon.evaluate(state, multipliers, 2)

    def at(t):
        return ribbon.retract(state, t * dx), multipliers + t * dm

    def lagrangian(t):
        there = ribbon.evaluate(*at(t), 0)
        return there.energy + at(t)[1] @ there.constraints

    def constraints(t):
        return ribbon.evaluate(*at(t), 0).constraints

    bent, moved = here.kkt.apply(dx, dm)
    slope, curvature = _differences(lagrangian, 2e-5)
    scale = np.abs(here.gradient) @ np.abs(dx)
    assert here.gradient @ dx + here.constraints @ dm == pytest.approx(slope, abs=1e-8 * scale)
    assert dx @ bent + dm @ moved == pytest.approx(curvature, rel=1e-4)
    assert moved == pytest.approx(_differences(constraints, 2e-5)[0], rel=1e-5, abs=1e-5)


def test_the_difference_of_states_is_the_increment():
    ribbon = _open(WUNDERLICH, "staggered")
    dx = 0.1 * np.random.default_rng(3).normal(size=ribbon.size)
    start = ribbon.start()
    assert ribbon.difference(start, ribbon.retract(start, dx)) == pytest.approx(dx, abs=1e-14)


def test_states_are_saved_and_loaded(tmp_path):
    ribbon = _open(WUNDERLICH, "staggered")
    dx = 0.1 * np.random.default_rng(3).normal(size=ribbon.size)
    state = ribbon.retract(ribbon.start(), dx)
    ls.structure.save_state(tmp_path / "state.npz", state)
    again = ls.structure.load_state(tmp_path / "state.npz", ribbons.RibbonState)
    assert np.array_equal(ribbon.difference(state, again), np.zeros(ribbon.size))


def _dense(kkt):
    """The whole matrix, from its products with unit vectors, with rows of similar size."""
    n, m = kkt.n, kkt.m
    matrix = np.empty((n + m, n + m))
    for j in range(n + m):
        unit = np.zeros(n + m)
        unit[j] = 1.0
        matrix[j] = np.concatenate(kkt.apply(unit[:n], unit[n:]))
    scale = 1.0 / np.sqrt(np.max(np.abs(matrix), axis=0))
    return scale, scale[:, None] * matrix * scale


@pytest.mark.parametrize("scheme", ["staggered", "nodal"])
@pytest.mark.parametrize("segments", [40, 100])
def test_factors_of_closed_bands_have_the_inertia_of_the_eigenvalues(scheme, segments):
    """At equilibria, away from them, and shifted until nothing or nearly everything is stable."""
    law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    band = ribbons.band(1.0, segments, law, scheme=scheme)
    found = ls.equilibrate(band)
    rng = np.random.default_rng(segments)
    seen = set()
    for wobble, width in ((0.0, 0.1), (0.0, 0.2), (0.02, 0.1)):
        ribbon = band.with_width(width)
        state = ribbon.retract(found.state, wobble * rng.normal(size=ribbon.size))
        kkt = ribbon.evaluate(state, found.multipliers, 2).kkt
        scale, matrix = _dense(kkt)
        mass = np.concatenate([ribbon.metric(state), np.zeros(kkt.m)]) * scale**2
        for shift in (0.0, 1.0, 300.0, -20.0, -3000.0):
            values = np.linalg.eigvalsh(matrix + np.diag(shift * mass))
            assert np.min(np.abs(values)) > 1e-11
            factor = kkt.factorize(shift, metric=ribbon.metric(state))
            assert factor.inertia == (np.sum(values > 0), np.sum(values < 0), 0)
            seen.add(factor.index)
            rhs = rng.normal(size=kkt.n), rng.normal(size=kkt.m)
            dx, dm = factor.solve(*rhs)
            left = matrix @ (np.concatenate([dx, dm]) / scale) - scale * np.concatenate(rhs)
            left += shift * mass * np.concatenate([dx, dm]) / scale
            assert np.max(np.abs(left)) < 1e-9 * np.max(np.abs(np.concatenate([dx, dm]) / scale))
    assert min(seen) == 0
    assert max(seen) > 5


def test_columns_that_wait_for_a_pivot_do_not_pile_up():
    """The factors have places for a few of them only, however long the chain: the cost is linear."""
    law = ribbons.Wunderlich(width=0.1, rigidity=1.0)
    found = ls.equilibrate(ribbons.band(1.0, 100, law))
    for segments in (200, 800, 3200):
        band = ribbons.band(1.0, segments, law)
        found = ls.equilibrate(band, start=band.adapted(found))
        for width in (0.1, 0.15):  # in equilibrium, and at the beginning of a change of width
            kkt = band.with_width(width).evaluate(found.state, found.multipliers, 2).kkt
            border = kkt.factorize()._factors.border
            assert border.shape[1] <= band.layout.skeleton.border + 8
