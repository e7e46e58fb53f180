"""A rod in nodes and twist angles: the same discrete equilibria as the rod in frames."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import lapack
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome.errors import InvalidInput
from lissome.rods import Kirchhoff, Rod
from lissome.rods import quaternions as qn
from lissome.rods.centerline import RESET, CenterlineState
from lissome.rods.centerline_structure import CenterlineTwist

LAW = Kirchhoff((1.0, 3.0), 0.8)
LENGTHS = np.random.default_rng(1).uniform(0.02, 0.05, 24)
SPAN = LENGTHS.sum()
BARE = Rod(LAW, LENGTHS)
CURVED = BARE.with_natural(curvature_1=2.0, twist=1.0)
TURNED = Rotation.from_rotvec([0.3, 1.0, 0.5])
FAR = (0.2, 0.1, 0.6 * SPAN)

RODS = {
    "cantilever": BARE.clamped("start").loaded(end=(1.0, 0.5, -5.0)),
    "clamped segment": BARE.clamped("start", clamp="segment").loaded(end=(1.0, 0.5, -5.0)),
    "both ends clamped": CURVED.clamped("start").clamped("end", position=FAR, frame=TURNED),
    "two clamped segments": CURVED.clamped("start", clamp="segment").clamped(
        "end", position=FAR, frame=TURNED, clamp="segment"
    ),
    "pinned end": CURVED.clamped("start").pinned("end", FAR).loaded(distributed=(0.0, 2.0, 0.0)),
    "pinned at both ends": CURVED.pinned("start")
    .pinned("end", FAR)
    .loaded(distributed=(0.0, 2.0, 0.0)),
    "sliding end": BARE.clamped("start")
    .clamped("end", position=(0.0, 0.0, None))
    .loaded(end=(0.0, 0.0, -30.0), nodes={12: (0.1, 0.0, 0.0)}),
    "couple": CURVED.clamped("start").loaded(end=(1.0, 0.0, 0.0), arm=(0.1, 0.3, 0.0)),
    "extensible": dataclasses.replace(CURVED, stretching=40.0)
    .clamped("start")
    .loaded(end=(1.0, 0.5, -5.0)),
    "inner clamp": CURVED.clamped(12).loaded(start=(0.0, 2.0, 0.0), end=(1.0, 0.0, 0.0)),
    "free": CURVED,
    "angle": dataclasses.replace(CURVED, measure="angle")
    .clamped("start")
    .clamped("end", position=FAR, frame=TURNED),
    "averaged": dataclasses.replace(CURVED, measure="averaged")
    .clamped("start")
    .clamped("end", position=FAR, frame=TURNED),
}


def shaken(twin, state, seed, size=0.1):
    """A state near the given one; lengths are not kept."""
    random = np.random.default_rng(seed)
    dx = size * random.standard_normal(twin.size) * np.minimum(twin.typical(state), 0.02 / size)
    return twin.retract(state, dx * twin.max_step(state, dx))


@pytest.mark.parametrize("name", RODS)
def test_equilibria_are_those_of_the_rod_in_frames(name):
    rod = RODS[name]
    twin = CenterlineTwist(rod)
    found = ls.equilibrate(rod)
    start = shaken(twin, twin.from_rod(found.state), 3)
    other = ls.equilibrate(twin, start=start, multipliers=np.zeros(twin.constraints_count))
    assert other.iterations > 1 and other.stable
    assert other.energy == pytest.approx(found.energy, rel=1e-12, abs=1e-12)
    assert other.residual < 1e-13
    inner, outer = found.structure.layout.plan.span, other.structure.to_rod(other.state)
    np.testing.assert_allclose(
        rod.strains(outer) * inner[:, None],
        rod.strains(found.state) * inner[:, None],
        atol=1e-9,
    )
    if name != "free":  # a free rod may be anywhere
        np.testing.assert_allclose(other.state.positions, rod.positions(found.state), atol=1e-9)


def test_fine_meshes_agree_from_a_near_start():
    rod = Rod(LAW, np.full(1000, 1e-3)).clamped("start")
    before = ls.equilibrate(rod.loaded(end=(1.0, 0.5, -5.0)))
    rod = rod.loaded(end=(1.1, 0.5, -5.0))
    found = ls.equilibrate(CenterlineTwist(rod), start=before.state)
    same = ls.equilibrate(rod, start=before.state)
    assert found.iterations > 0 and found.stable
    assert found.energy == pytest.approx(same.energy, rel=1e-12)
    np.testing.assert_allclose(found.state.positions, rod.positions(same.state), atol=1e-10)


def test_tensions_are_the_forces_along_the_segments():
    force = np.array([1.0, 0.5, -5.0])
    twin = CenterlineTwist(RODS["cantilever"])
    found = ls.equilibrate(twin)
    # the multiplier of |E|^2/(2 l) is the tension where |E| = l; shear is carried by the moments
    np.testing.assert_allclose(found.multipliers, found.state.tangents @ force, rtol=1e-9)


@pytest.mark.parametrize("name", ["cantilever", "sliding end"])
def test_unstable_directions_are_counted_alike(name):
    rod = RODS[name]
    rod = rod.loaded(end=(0.0, 0.0, {"cantilever": -40.0, "sliding end": -150.0}[name]))
    straight = ls.equilibrate(rod, require="any", start=BARE.start())
    twin = CenterlineTwist(rod)
    other = ls.equilibrate(twin, require="any", start=twin.from_rod(straight.state))
    np.testing.assert_allclose(other.state.positions, rod.positions(straight.state), atol=1e-9)
    assert other.index == straight.index > 0


@settings(max_examples=12)
@given(st.sampled_from(sorted(RODS)), st.integers(0, 2**32 - 1))
@example("free", 840622)  # a segment has shrunk to a fifteenth of its length
def test_gradient_and_hessian_belong_to_the_energy(name, seed):
    twin = CenterlineTwist(RODS[name])
    random = np.random.default_rng(seed)
    state = twin.start()
    for k in range(4):  # away from the reference, and from equal lengths
        state = shaken(twin, state, seed + k, 0.5)
    multipliers = random.standard_normal(twin.constraints_count)
    here = twin.evaluate(state, multipliers, 2)
    direction = random.standard_normal(twin.size) * np.minimum(twin.typical(state), 0.05)

    def lagrangian(t):
        there = twin.evaluate(twin.retract(state, t * direction), multipliers, 1)
        return there.energy + multipliers @ there.constraints, there.gradient, there.constraints

    def slopes(h):
        plus, minus = lagrangian(h), lagrangian(-h)
        return [(p - m) / (2 * h) for p, m in zip(plus, minus, strict=True)]

    h = 7e-5  # where a segment has shrunk, the errors of the quotients are large; they go with h^4
    fine, coarse = slopes(h / 2), slopes(h)
    bent, moved = here.kkt.apply(direction, np.zeros(multipliers.size))
    for exact, f, c in zip((here.gradient @ direction, bent, moved), fine, coarse, strict=True):
        extrapolated = (4 * f - c) / 3
        np.testing.assert_allclose(
            exact, extrapolated, atol=1e-8 * (np.max(np.abs(extrapolated), initial=0) + 1)
        )


@pytest.mark.parametrize("name", ["pinned at both ends", "free"])
def test_neutral_motions_are_neutral(name):
    twin = CenterlineTwist(RODS[name])
    found = ls.equilibrate(twin)
    rows = twin.gauge(found.state)
    assert rows.shape[0] == {"pinned at both ends": 0, "free": 6}[name]
    here = found.evaluation
    sizes = here.kkt.magnitude(twin.typical(found.state), found.multipliers)[0]
    for row in rows:
        bent, moved = here.kkt.apply(row, np.zeros(here.kkt.m))
        assert np.max(np.abs(bent) / sizes) < 1e-12
        np.testing.assert_allclose(moved, 0, atol=1e-12)


def test_a_pinned_rod_without_loads_may_turn_about_its_chord():
    twin = CenterlineTwist(CURVED.pinned("start").pinned("end", (0.0, 0.0, 0.6 * SPAN)))
    found = ls.equilibrate(twin)
    assert twin.gauge(found.state).shape[0] == 1
    assert found.stable


def test_retraction_and_difference_are_inverse():
    twin = CenterlineTwist(RODS["both ends clamped"])
    state = twin.start()
    random = np.random.default_rng(7)
    dx = random.standard_normal(twin.size) * 0.01
    np.testing.assert_allclose(twin.difference(state, twin.retract(state, dx)), dx, atol=1e-14)
    there = shaken(twin, shaken(twin, state, 1, 0.5).reset(), 2, 0.5)  # another reference
    back = twin.retract(state, twin.difference(state, there))
    np.testing.assert_allclose(back.positions, there.positions, atol=1e-15)
    np.testing.assert_allclose(
        np.abs(np.sum(back.quaternions * there.quaternions, axis=1)), 1, atol=1e-13
    )


def test_references_are_renewed_before_they_are_lost():
    twin = CenterlineTwist(CURVED)
    state = twin.start()
    first = state.reference
    multipliers = np.zeros(twin.constraints_count)
    axis, center = np.array([0.0, 1.0, 0.0]), state.positions.mean(axis=0)
    energy = twin.evaluate(state, multipliers, 0).energy
    angle = 2 * np.pi / 13
    for _ in range(13):  # turn the rod by a whole turn: it would pass the opposite direction
        turned = qn.rotate(qn.rotation_about(axis, angle), state.positions - center) + center
        frames = qn.multiply(qn.rotation_about(axis, angle), state.quaternions)
        target = CenterlineState.from_frames(turned, frames)
        dx = twin.difference(state, target)
        state = twin.retract(state, dx)
        close = 1 + np.sum(state.tangents * state.reference_tangents, axis=1)
        assert np.all(close >= RESET)
        assert twin.evaluate(state, multipliers, 0).energy == pytest.approx(energy, abs=1e-10)
    assert not np.array_equal(state.reference, first)
    np.testing.assert_allclose(state.positions, twin.start().positions, atol=1e-12)


def test_cold_starts_far_from_the_reference_converge():
    rod = RODS["both ends clamped"]
    twin = CenterlineTwist(rod)
    random = np.random.default_rng(0)
    for _ in range(6):
        turns = np.cumsum(random.uniform(-0.6, 0.6, (LENGTHS.size, 3)), axis=0)
        frames = qn.exponential(turns)
        start = rod.adopt(dataclasses.replace(rod.initial, quaternions=frames))
        found = ls.equilibrate(twin, start=start)
        assert found.stable
        same = ls.equilibrate(rod, start=twin.to_rod(found.state))
        np.testing.assert_allclose(rod.positions(same.state), found.state.positions, atol=1e-9)


def test_supports_move():
    twin = CenterlineTwist(RODS["two clamped segments"])
    found = ls.equilibrate(twin)
    moved = CenterlineTwist(
        twin.rod.clamped(
            "end", position=(0.21, 0.1, 0.6 * SPAN), frame=TURNED * TURNED**0.02, clamp="segment"
        )
    )
    state = moved.adopt(found.state)
    np.testing.assert_array_equal(state.positions[-1], [0.21, 0.1, 0.6 * SPAN])
    np.testing.assert_allclose(
        state.directors[-1], (TURNED * TURNED**0.02).as_matrix().T, atol=1e-13
    )
    again = ls.equilibrate(moved, start=found.state, multipliers=found.multipliers)
    check = ls.equilibrate(moved.rod, start=moved.to_rod(again.state))
    np.testing.assert_allclose(moved.rod.positions(check.state), again.state.positions, atol=1e-9)


@pytest.mark.parametrize("name", ["both ends clamped", "extensible"])
def test_the_band_is_as_wide_as_the_text_says(name):
    """Half width 12 with tensions among the unknowns, 10 without: LAPACK solves the same system."""
    twin = CenterlineTwist(RODS[name])
    state = shaken(twin, twin.start(), 5)
    multipliers = np.linspace(-1, 2, twin.constraints_count)
    here = twin.evaluate(state, multipliers, 2)
    band, chain = here.kkt.band, here.kkt.layout
    width = 10 if name == "extensible" else 12
    assert not np.any(band[: -width - 1, width + 1 :])
    assert np.any(band[: -width - 1, width])
    matrix = np.zeros((3 * width + 1, band.shape[0]), order="F")
    matrix[2 * width] = band[:, 0]
    for k in range(1, width + 1):
        matrix[2 * width + k, :-k] = matrix[2 * width - k, k:] = band[:-k, k]
    rhs = np.empty(band.shape[0])
    rhs[chain.unknowns], rhs[chain.constraints] = -here.gradient, -here.constraints
    _, _, step, info = lapack.dgbsv(width, width, matrix, rhs)
    assert info == 0
    dx, dm = here.kkt.factorize().solve(-here.gradient, -here.constraints)
    np.testing.assert_allclose(step[chain.unknowns], dx, atol=1e-8 * np.max(np.abs(dx)))
    np.testing.assert_allclose(
        step[chain.constraints], dm, atol=1e-8 * np.max(np.abs(dm), initial=1)
    )
    # nothing of the matrix lies outside the band
    dense = np.array([np.concatenate(here.kkt.apply(e, np.zeros(here.kkt.m)))
                      for e in np.eye(twin.size)])  # fmt: skip
    far = np.abs(chain.unknowns[:, None] - np.concatenate([chain.unknowns, chain.constraints]))
    assert not np.any(dense[far > width])


@pytest.mark.parametrize(
    ("rod", "message"),
    [
        (dataclasses.replace(BARE, closed=True), "closed"),
        (BARE.hinged("start", axis=(0, 1, 0)), "hinged support at node 0"),
        (BARE.clamped("start", position=(0, 0, None), clamp="segment"), "free component"),
        (3, "pass a Rod"),
    ],
)
def test_other_rods_are_refused(rod, message):
    with pytest.raises(InvalidInput, match=message):
        CenterlineTwist(rod)


def test_wrong_starts_are_refused():
    twin = CenterlineTwist(RODS["cantilever"])
    with pytest.raises(InvalidInput, match="pass a CenterlineState or a RodState"):
        ls.equilibrate(twin, start=np.zeros(3))
    short = CenterlineState([[0, 0, 0], [0, 0, 1]], [0], [[1, 0, 0, 0]])
    with pytest.raises(InvalidInput, match="1 segments"):
        ls.equilibrate(twin, start=short)


@pytest.mark.parametrize("segments", [200, 400])
def test_cold_starts_on_fine_meshes_converge(segments):
    rod = Rod(LAW, np.full(segments, 1.0 / segments)).clamped("start").loaded(end=(1.0, 0.5, -5.0))
    found, same = ls.equilibrate(CenterlineTwist(rod)), ls.equilibrate(rod)
    assert found.stable and found.iterations < 30
    assert np.abs(found.state.positions - same.positions).max() < 1e-8


@pytest.mark.parametrize("name", RODS)
def test_supports_exert_the_same_in_both_representations(name):
    """Forces from nodes and tensions against forces from the rows of the frames."""
    rod = RODS[name]
    first = ls.equilibrate(rod)
    second = ls.equilibrate(CenterlineTwist(rod), first.state)
    known, found = first.reactions(), second.reactions()
    assert list(found) == list(known)
    scale = 1.0 + max((np.max(np.abs([r.force, r.moment])) for r in known.values()), default=0.0)
    for where, reaction in known.items():
        assert found[where].force == pytest.approx(reaction.force, abs=1e-8 * scale)
        assert found[where].moment == pytest.approx(reaction.moment, abs=1e-8 * scale)
        assert found[where].position == pytest.approx(reaction.position, abs=1e-10)
