"""Open ribbons: closed forms, balance, convergence, and random loading sequences."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lissome as ls
from lissome import ribbons
from lissome.errors import InvalidInput, LissomeError
from lissome.ribbons._layout import POINTS, _smooth
from lissome.rods import RodState
from lissome.rods.quaternions import multiply

SCHEMES = ("staggered", "cells", "nodal")
LAW = ribbons.Wunderlich(width=0.1, rigidity=10.0)


def _sheared(scheme="staggered", segments=60):
    strip = ribbons.straight(1.0, segments, LAW, scheme=scheme).clamped("start")
    return strip.clamped("end", (0.1, 0.0, 0.75))


@pytest.fixture(scope="module", params=SCHEMES)
def sheared(request):
    return ls.equilibrate(_sheared(request.param))


# ---- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_naturally_curved_strip_rolls_into_a_cylinder(scheme):
    law = ribbons.Wunderlich(width=0.1, rigidity=2.0, poisson_ratio=0.3, natural_curvature=2.5)
    eq = ls.equilibrate(ribbons.straight(1.0, 20, law, scheme=scheme).clamped("start"))
    assert eq.energy == pytest.approx(0.0, abs=1e-12)
    assert eq.strains[:, 0] == pytest.approx(2.5, abs=1e-9)
    assert eq.ruling == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_naturally_twisted_strip_curls_with_rulings_at_45_degrees(scheme):
    """Minimum over the bending and the ruling of the energy of a uniform strip: eta = 1 or -1."""
    nu, twist = 0.3, 1.5
    law = ribbons.Wunderlich(width=0.1, rigidity=2.0, poisson_ratio=nu, natural_twist=twist)
    strip = ribbons.straight(1.0, 20, law, scheme=scheme).clamped("start")
    # Both signs are alike: a natural curvature chooses, and is taken away at the end.
    eq = None
    for bend, share in ((1.0, 0.0), (1.0, 0.3), (1.0, 0.6), (1.0, 1.0), (0.0, 1.0)):
        law = ribbons.Wunderlich(
            width=0.1, rigidity=2.0, poisson_ratio=nu, natural_twist=share * twist,
            natural_curvature=bend,
        )  # fmt: skip
        eq = ls.equilibrate(strip.with_law(law), start=eq)
    assert eq.stable
    assert np.abs(eq.ruling) == pytest.approx(1.0, abs=1e-7)
    assert np.abs(eq.strains[:, 0]) == pytest.approx((1 - nu) * twist / 2, abs=1e-7)
    assert eq.strains[:, 2] == pytest.approx((1 - nu) * twist / 2, abs=1e-7)
    assert eq.energy_per_length == pytest.approx(0.5 * 0.2 * (1 - nu**2) * twist**2)


def _on_a_cone(segments, apex=0.4, tangent=0.8, start=-0.5, length=1.0):
    """A strip on a cone whose apex is at the distance `apex` from the center line, beside s = 0.5.

    Rulings go through the apex: eta is linear. The curvature is 1/(r tan alpha) at the distance r.
    """
    lengths = np.full(segments, length / segments)
    s = start + np.cumsum(lengths)[:-1]
    eta = -s / apex
    bend = 1.0 / (apex * tangent * (1 + eta**2) ** 1.5)
    frames = np.empty((segments, 4))
    frames[0] = (1.0, 0.0, 0.0, 0.0)
    for j in range(1, segments):
        half = 0.5 * bend[j - 1] * lengths[j] * np.array([1.0, 0.0, eta[j - 1]])
        turn = np.concatenate([[math.sqrt(1 - half @ half)], half])
        frames[j] = multiply(frames[j - 1], turn)
    return RodState(frames / np.linalg.norm(frames, axis=1)[:, None]), eta


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_strip_on_a_cone_has_the_energy_of_the_cone(scheme):
    """Constant eta': g is constant, and the energy is D w g / (2 p tan^2) times the angle seen."""
    apex, tangent, width = 0.4, 0.8, 0.3
    law = ribbons.Wunderlich(width=width, rigidity=1.0)
    errors = []
    for segments in (50, 100, 200):
        state, eta = _on_a_cone(segments)
        strip = ribbons.straight(1.0, segments, law, scheme=scheme)
        middle = (np.arange(segments) + 0.5) / segments - 0.5
        rulings = -middle / apex if scheme == "staggered" else eta
        folds = np.full(segments - 1, math.atanh(-0.5 * width / apex))
        if scheme == "cells":  # no cell follows the last hinge
            folds[-1] = 0.0
        full = ribbons.RibbonState(state.quaternions, state.origin, rulings=rulings, folds=folds)
        there = strip.evaluate(full, np.zeros(strip.constraints_count), 0)
        assert np.max(np.abs(there.constraints)) < 1e-12
        # The hinges cover the strip but for half a segment at each end.
        end = 0.5 - 0.5 / segments
        angle = 2 * math.atan(end / apex)
        exact = 0.5 * width * ribbons.width_factor(width / apex) / (apex * tangent**2) * angle
        errors.append(there.energy - exact)
    orders = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
    assert orders == pytest.approx(2.0, abs=0.1)


def test_rulings_of_a_cone_meet_at_its_apex():
    apex, segments = 0.4, 400
    state, eta = _on_a_cone(segments)
    strip = ribbons.straight(1.0, segments, ribbons.Wunderlich(width=0.3, rigidity=1.0))
    nodes = strip.positions(state)[1:-1]
    directors = strip.rod.with_initial(state)
    frames = ls.rods.quaternions.to_directors(directors.initial.quaternions)[1:]
    tips = nodes + apex * (frames[:, 0] + eta[:, None] * frames[:, 2])
    assert np.max(np.ptp(tips, axis=0)) < 1e-4


# ---- balance -------------------------------------------------------------------------------------


def test_forces_and_moments_balance(sheared):
    eq = sheared
    steps = np.diff(eq.positions, axis=0)
    between = np.diff(eq.moment_vectors, axis=0) + np.cross(steps, eq.forces)
    assert np.max(np.abs(between)) < 1e-8 * np.max(np.abs(eq.moment_vectors))


def test_the_reaction_is_the_derivative_of_the_energy(sheared):
    ribbon, h = sheared.structure, 1e-4

    def energy(d):
        moved = ribbon.clamped("end", (0.1 + d, 0.0, 0.75))
        return ls.equilibrate(moved, start=sheared).energy

    slope = (energy(-2 * h) - 8 * energy(-h) + 8 * energy(h) - energy(2 * h)) / (12 * h)
    assert sheared.reactions("end").force[0] == pytest.approx(slope, rel=1e-6)


def test_the_strip_is_developable(sheared):
    assert np.max(np.abs(sheared.strains[:, 1])) < 1e-10
    assert sheared.strains[:, 2] == pytest.approx(sheared.ruling * sheared.strains[:, 0], abs=1e-10)
    surface = sheared.surface(across=5)
    assert surface.isometry_error() < 1e-10
    assert surface.face_planarity() < 1e-10
    assert np.all(np.abs(sheared.ruling_slope) * LAW.width < 2.0)


def test_rulings_of_the_staggered_scheme_never_cross():
    assert ls.equilibrate(_sheared()).surface().rulings_cross().size == 0


def test_the_mirror_image_has_the_same_energy(sheared):
    ribbon = sheared.structure.clamped("end", (-0.1, 0.0, 0.75))
    mirrored = ls.equilibrate(ribbon)
    assert mirrored.energy == pytest.approx(sheared.energy, rel=1e-9)


def test_a_wider_jaw_that_is_straight_costs_energy():
    free = ls.equilibrate(_sheared())
    ribbon = _sheared().clamped("start", ruling=0.0).clamped("end", (0.1, 0, 0.75), ruling=0.0)
    held = ls.equilibrate(ribbon, start=ribbon.adapted(free))
    assert held.energy > free.energy
    values = held.state.rulings[[-2, -1]]
    assert np.array_equal(values, [0.0, 0.0])


def test_the_surface_and_tables_have_the_documented_shapes(sheared, tmp_path):
    import meshio

    surface = sheared.surface(across=4)
    assert surface.vertices.shape == (61, 4, 3)
    assert surface.triangles.shape == (60 * 3 * 2, 3)
    assert surface.rulings.shape == (61, 2, 3)
    assert surface.edges.shape == (2, 61, 3)
    table = sheared.to_frame()
    assert {"kappa_1", "ruling", "ruling_slope", "energy_per_length"} <= {
        *table.columns, "kappa_1"
    }  # fmt: skip
    assert len(table) == 61
    mesh = meshio.read(sheared.to_vtk(tmp_path / "strip.vtu", across=4))
    assert mesh.cells_dict["triangle"].shape == surface.triangles.shape
    assert np.allclose(mesh.point_data["energy_density"], surface.energy_density.reshape(-1))


def test_the_energy_density_adds_up_to_the_energy():
    """Integrated over the faces, with the ruling in the middle of each hinge's span."""
    eq = ls.equilibrate(ribbons.circle(1.0, 200, LAW, turn=1.5))
    surface = eq.surface(across=41)
    corners = surface.triangles
    flat = surface.flat.reshape(-1, 2)
    a, b, c = (flat[corners[:, k]] for k in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    total = area @ surface.energy_density.reshape(-1)[corners].mean(axis=1)
    assert total == pytest.approx(eq.energy, rel=2e-3)


# ---- limits and convergence ----------------------------------------------------------------------


def test_narrow_strips_tend_to_sadowsky_with_the_square_of_the_width():
    ribbon = ribbons.circle(1.0, 60, ribbons.Sadowsky(width=1.0, rigidity=1.0), turn=1.5)
    limit = ls.equilibrate(ribbon).energy
    nodal = ribbons.circle(
        1.0, 60, ribbons.Wunderlich(width=0.2, rigidity=5.0), turn=1.5, scheme="nodal"
    )
    excess = []
    for width in (0.2, 0.1, 0.05):
        law = ribbons.Wunderlich(width=width, rigidity=1.0 / width)
        excess.append(ls.equilibrate(nodal.with_law(law)).energy - limit)
    assert np.log2(np.array(excess[:-1]) / excess[1:]) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_energy_and_strains_converge_with_the_square_of_the_mesh(scheme):
    energies, bends, twists = [], [], []
    for segments in (40, 80, 160, 320):
        eq = ls.equilibrate(ribbons.circle(1.0, segments, LAW, turn=2.0, scheme=scheme))
        energies.append(eq.energy)
        at = int(np.argmin(np.abs(eq.hinge_arclength - 0.25)))
        assert eq.hinge_arclength[at] == pytest.approx(0.25)
        bends.append(eq.strains[at, 0])
        twists.append(eq.strains[at, 2])
    for values in (energies, bends, twists):
        change = np.diff(values)
        assert np.log2(np.abs(change[:-1] / change[1:]))[-1] == pytest.approx(2.0, abs=0.15)


def test_both_schemes_converge_to_the_same():
    limits = []
    for scheme in SCHEMES:
        a, b = (
            ls.equilibrate(ribbons.circle(1.0, n, LAW, turn=2.0, scheme=scheme)).energy
            for n in (160, 320)
        )
        limits.append(b + (b - a) / 3)
    assert limits[0] == pytest.approx(limits[1], rel=1e-6)


def test_the_energy_scales_with_rigidity_and_length():
    one = ls.equilibrate(ribbons.circle(1.0, 40, LAW, turn=2.0)).energy
    law = ribbons.Wunderlich(width=0.3, rigidity=20.0)
    assert ls.equilibrate(ribbons.circle(3.0, 40, law, turn=2.0)).energy == pytest.approx(2 * one)


# ---- following and random sequences --------------------------------------------------------------


def test_following_the_end_displacement():
    ribbon = _sheared(segments=30).clamped("end", (0.0, 0.0, 0.75))
    branch = ls.follow(lambda d: ribbon.clamped("end", (d, 0.0, 0.75)), 0.0, 0.1)
    direct = ls.equilibrate(_sheared(segments=30))
    assert branch.finished
    assert branch.equilibria[-1].energy == pytest.approx(direct.energy, rel=1e-9)


def test_following_the_twist():
    branch = ls.follow(lambda turn: ribbons.circle(1.0, 30, LAW, turn=turn), 0.0, 2.0)
    direct = ls.equilibrate(ribbons.circle(1.0, 30, LAW, turn=2.0))
    assert branch.equilibria[-1].energy == pytest.approx(direct.energy, rel=1e-9)


def test_random_sequences_of_twist_and_width_end_in_the_same_state():
    """60 ways to the same clamps and width, with turns of up to 1.6 radians at once.

    (Half a turn at once may wind up the other way.)
    """
    rng = np.random.default_rng(2026)
    target, width = 2.5, 0.15
    energies = []
    for _ in range(60):
        eq, turn = None, 0.0
        for _ in range(int(rng.integers(2, 6))):
            law = ribbons.Wunderlich(width=rng.uniform(0.02, 0.3), rigidity=1.0)
            turn = float(np.clip(turn + rng.uniform(-0.8, 1.6), 0.0, math.pi))
            eq = ls.equilibrate(ribbons.circle(1.0, 40, law, turn=turn), start=eq)
        law = ribbons.Wunderlich(width=width, rigidity=1.0)
        if abs(target - turn) > 1.6:
            eq = ls.equilibrate(ribbons.circle(1.0, 40, law, turn=target / 2), start=eq)
        energies.append(ls.equilibrate(ribbons.circle(1.0, 40, law, turn=target), start=eq).energy)
    assert np.ptp(energies) < 1e-9 * energies[0], energies


# ---- wrong input ---------------------------------------------------------------------------------


def test_a_flat_ribbon_has_no_rulings_and_says_so():
    flat = ribbons.straight(1.0, 20, LAW).clamped("start")
    for load in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):  # none that would bend it
        with pytest.raises(LissomeError, match=r"rulings are undetermined where it does not bend"):
            ls.equilibrate(flat.loaded(end=load))
    assert "rulings are undetermined" in flat.diagnose(flat.start())


def test_a_strip_that_is_flat_in_an_interval_says_where():
    """kappa_1 vanishes identically between two bent parts: the rulings there are nobody's."""
    strip = ribbons.straight(1.0, 40, LAW).clamped("start")
    turn = np.where((np.arange(39) >= 12) & (np.arange(39) < 24), 0.0, 0.05)
    frames = [np.array(strip.initial.quaternions[0])]
    for angle in turn:
        half = np.array([math.cos(0.5 * angle), math.sin(0.5 * angle), 0.0, 0.0])
        frames.append(multiply(frames[-1], half))
    start = RodState(np.array(frames))
    told = strip.diagnose(strip.adopt(start))
    assert "flat near s = 0.325" in told
    assert "give it a natural curvature" in told
    # Held at one end only, nothing bends it; a natural curvature does.
    with pytest.raises(LissomeError, match="rulings are undetermined"):
        ls.equilibrate(strip, start=start)
    law = ribbons.Wunderlich(width=0.1, rigidity=10.0, poisson_ratio=0.3, natural_curvature=0.5)
    curved = ls.equilibrate(strip.with_law(law), start=start)
    assert curved.energy == pytest.approx(0.0, abs=1e-12)


def test_slopes_beyond_the_barrier_are_refused_and_never_reached():
    """Rulings given by hand whose slope exceeds 2/w are no state; solvers come back below."""
    found = ls.equilibrate(_sheared())
    steep = np.array(found.state.rulings)
    steep[20:25] += 0.4 * np.arange(5)  # w eta' = 2.4
    state = ribbons.RibbonState(
        found.state.quaternions, found.state.origin, rulings=steep, folds=found.state.folds
    )
    with pytest.raises(InvalidInput, match="cross"):
        LAW.energy(1.0, 0.0, 2.0 / LAW.width)
    again = ls.equilibrate(found.structure, start=state)
    assert again.energy == pytest.approx(found.energy, rel=1e-9)
    assert np.all(np.abs(again.ruling_slope) * LAW.width < 2.0)


def test_other_structures_and_states_are_refused():
    strip = _sheared(segments=20)
    with pytest.raises(InvalidInput, match="law"):
        ribbons.straight(1.0, 20, ls.rods.Kirchhoff(1.0, 1.0))
    with pytest.raises(InvalidInput, match="scheme"):
        ribbons.straight(1.0, 20, LAW, scheme="central")
    with pytest.raises(InvalidInput, match="segments"):
        ls.equilibrate(strip, start=_sheared(segments=30).start())
    other = _sheared("nodal", 20)
    with pytest.raises(InvalidInput, match="adapted"):
        ls.equilibrate(strip, start=ls.equilibrate(other))
    with pytest.raises(InvalidInput, match="source"):
        strip.adapted(other.start())
    with pytest.raises(InvalidInput, match="inextensible"):
        ls.equilibrate(strip.clamped("end", (0.0, 0.0, 1.2)))
    with pytest.raises(InvalidInput, match="ruling"):
        strip.with_law(ribbons.Sadowsky(width=0.1, rigidity=1.0)).clamped("start", ruling=0.0)
    with pytest.raises(InvalidInput, match="clamped"):
        strip.freed("end").turned(0.3)


def test_turning_an_end_is_the_same_as_a_turned_circle():
    ribbon = ribbons.circle(1.0, 40, LAW)
    eq = ls.equilibrate(ribbon)
    turned = ls.equilibrate(ribbon.turned(0.4), start=eq)
    direct = ls.equilibrate(ribbons.circle(1.0, 40, LAW, turn=0.4))
    assert turned.energy == pytest.approx(direct.energy, rel=1e-10)


@pytest.mark.parametrize("law", [ribbons.Sadowsky, ribbons.Wunderlich])
def test_rulings_at_an_inflection_of_the_sadowsky_law_are_undetermined(law):
    """Segments turned about d1, most in the middle: the hinge there does not bend."""
    strip = ribbons.straight(1.0, 20, law(width=0.1, rigidity=1.0))
    turns = np.zeros(strip.size)
    middles = (np.arange(20) + 0.5) / 20
    turns[strip.rod.layout.plan.column[:20]] = 0.5 * np.sin(np.pi * middles)
    said = strip.diagnose(strip.retract(strip.start(), turns))
    if law is ribbons.Wunderlich:
        assert said is None
    else:
        assert "passes zero at a hinge, near s = 0.5, " in said
        assert "use the Wunderlich law" in said


def test_a_single_hinge_is_refused():
    for scheme, said in (("cells", "has no other beside it"), ("nodal", "has a single hinge")):
        strip = ribbons.straight(1.0, 2, LAW, scheme=scheme).pinned("start", (0, 0, 0))
        with pytest.raises(InvalidInput, match=f"{said}.*; use more segments"):
            ls.equilibrate(strip.pinned("end", (0.1, 0, 0.7)))


# ---- moments as unknowns -------------------------------------------------------------------------


def _arch(scheme, segments=60):
    return ribbons.straight(1.0, segments, LAW, scheme=scheme).clamped("start")


@pytest.fixture(scope="module")
def has_moments():
    flat = _arch("moments")
    found = ls.follow(lambda d: flat.clamped("end", (d, 0.0, 0.75)), 0.0, 0.1, eigenvalues=False)
    return found.equilibria[-1]


def test_moments_are_in_balance_and_do_the_work(has_moments):
    eq = has_moments
    assert eq.stable
    arms = eq.positions[eq.hinge_nodes]
    about = eq.moment_vectors + np.cross(arms, eq.forces[0])
    assert about == pytest.approx(
        np.broadcast_to(about[0], about.shape), abs=1e-8 * np.abs(about).max()
    )
    spans = eq.structure.layout.plan.span
    assert spans @ eq.energy_per_length == pytest.approx(eq.energy, rel=1e-10)


def test_force_is_the_slope_of_the_energy_with_moments(has_moments):
    step = 1e-4
    flat = _arch("moments")
    up, down = (
        ls.equilibrate(flat.clamped("end", (0.1 + s, 0.0, 0.75)), has_moments).energy
        for s in (step, -step)
    )
    assert has_moments.forces[-1][0] == pytest.approx((up - down) / (2 * step), rel=1e-5)


def test_strips_with_moments_have_the_limit_of_the_others(has_moments):
    """Second order, from the other side."""
    flat = _arch("moments", 120)
    start = flat.clamped("end", (0.1, 0.0, 0.75)).adapted(has_moments)
    assert start.rulings.size == 4 * 120 + 1
    fine = ls.follow(lambda d: flat.clamped("end", (d, 0.0, 0.75)), 0.0, 0.1, eigenvalues=False)
    energies = [has_moments.energy, fine.equilibria[-1].energy]
    limit = energies[1] + (energies[1] - energies[0]) / 3
    others = [ls.equilibrate(_sheared("cells", n)).energy for n in (60, 120)]
    assert limit == pytest.approx(others[1] + (others[1] - others[0]) / 3, rel=3e-4)


@pytest.mark.parametrize("what", ["closed", "curved", "inner clamp"])
def test_what_moments_do_not_know(what):
    with pytest.raises(InvalidInput, match="use 'cells'"):
        if what == "closed":
            ribbons.band(1.0, 40, LAW, scheme="moments")
        elif what == "curved":
            law = ribbons.Wunderlich(
                width=0.1, rigidity=1.0, poisson_ratio=0.3, natural_curvature=1.0
            )
            ribbons.straight(1.0, 40, law, scheme="moments")
        else:
            _arch("moments").clamped(20, (0, 0, 0.3))


def test_the_matrix_with_moments_is_as_narrow_for_a_long_strip_as_for_a_short_one():
    """And what makes it takes no more than its own size: squares of this length would fill all memory."""
    widths = [_arch("moments", segments).layout.skeleton.width for segments in (40, 20_000)]
    assert widths[0] == widths[1] < 70


def test_moments_between_hinges_are_smooth_and_exact_for_quadratics():
    lengths = np.random.default_rng(3).uniform(0.5, 1.5, 9)
    base, weights = _smooth(lengths, 4)
    s = np.append(0.0, np.cumsum(lengths))
    inside = (np.arange(4)[:, None] + POINTS) / 4
    for power in range(3):
        here = np.array([s[b : b + 4] ** power for b in base])
        found = np.einsum("ipkj,ij->ipk", weights, here)
        assert found == pytest.approx(
            (s[:-1, None, None] + lengths[:, None, None] * inside) ** power
        )
    # the cubics of neighboring cells have the same value and slope at the hinge between them
    values = np.random.default_rng(4).normal(size=s.size)
    cubics = [
        np.polynomial.Polynomial.fit(
            s[i] + lengths[i] * inside.ravel(), weights[i].reshape(-1, 4) @ values[b : b + 4], 3
        )
        for i, b in enumerate(base)
    ]
    for i in range(1, s.size - 1):
        for one, other in ((cubics[i - 1], cubics[i]), (cubics[i - 1].deriv(), cubics[i].deriv())):
            assert one(s[i]) == pytest.approx(other(s[i]), rel=1e-9, abs=1e-9)
    with pytest.raises(InvalidInput, match=r"has 3 hinges; .* use more segments"):
        ls.equilibrate(_arch("moments", 2).clamped("end", (0.0, 0.0, 0.75)))


@pytest.mark.parametrize("shear", [0.02, 0.1])
def test_moments_need_no_near_start(has_moments, shear):
    flat = _arch("moments")
    cold = ls.equilibrate(flat.clamped("end", (shear, 0.0, 0.75)))
    near = ls.follow(lambda d: flat.clamped("end", (d, 0.0, 0.75)), 0.0, shear, eigenvalues=False)
    assert cold.stable
    assert cold.energy == pytest.approx(near.equilibria[-1].energy, rel=1e-10)


def dense(low, high, ratio):
    """Lengths of 44 segments, denser between `low` and `high` and in the mirror image of that."""
    s = np.linspace(0.0, 1.0, 20001)
    x = np.minimum(s, 1.0 - s)
    inside = np.prod([1 + np.tanh((x - low) / 0.03), 1 + np.tanh((high - x) / 0.03)], axis=0) / 4
    t = np.concatenate([[0.0], np.cumsum(2 + (ratio - 1) * (inside[1:] + inside[:-1]))])
    return np.diff(np.interp(np.linspace(0.0, 1.0, 45), t / t[-1], s))


@pytest.mark.parametrize(
    ("part", "mesh", "exact"),
    [(6, (0.2, 0.28, 2.0), 0.33181), (12, (0.15, 0.26, 3.0), 0.36588), (20, (0.1, 0.25, 5.0), 0.44056)],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::lissome.errors.LissomeWarning")  # of bending that jumps
def test_pitchfork_of_sheared_strips_with_45_nodes(part, mesh, exact):
    """`exact`: by collocation (lissome.references.clamped_strip), in which inflections are unknowns."""
    law = ribbons.Wunderlich(width=1.0 / part, rigidity=1.0)
    strip = ribbons.straight(law=law, lengths=dense(*mesh), scheme="moments").clamped("start")
    family = lambda shear: strip.clamped("end", (shear, 0.0, 0.75))  # noqa: E731
    found = ls.follow(family, 0.0, 0.5, on_fold="snap", overshoot=0.01, eigenvalues=False)
    first = found.events[0]
    assert first.kind == "bifurcation"
    assert first.parameter == pytest.approx(exact, rel=0.02 if part == 20 else 0.005)
    # It goes on past the ripple of the mesh, without its symmetry, in states that are stable.
    assert found.finished
    assert found.equilibria[-1].stable
    released = [event.energy_released for event in found.events if event.kind == "snap"]
    assert min(released) > 0.0
    middle = found.equilibria[-1].strains[:, 0]
    assert np.abs(middle - middle[::-1]).max() > 0.1 * np.abs(middle).max()


@pytest.mark.parametrize(("part", "mesh"), [(12, (0.15, 0.26, 3.0)), (10, (0.17, 0.26, 2.5))])
@pytest.mark.parametrize("overshoot", [1e-3, 1e-2])
@pytest.mark.filterwarnings("ignore::lissome.errors.LissomeWarning")  # of bending that jumps
def test_snap_releases_what_the_lost_state_has_more(part, mesh, overshoot):
    """Beyond the pitchfork the forces of the clamps have grown: the lost state is followed there."""
    law = ribbons.Wunderlich(width=1.0 / part, rigidity=1.0)
    strip = ribbons.straight(law=law, lengths=dense(*mesh), scheme="moments").clamped("start")
    family = lambda shear: strip.clamped("end", (shear, 0.0, 0.75))  # noqa: E731
    options = {"eigenvalues": False, "event_tolerance": 1e-4}
    found = ls.follow(family, 0.0, 0.4, on_fold="snap", overshoot=overshoot, **options)
    snap = found.events[1]
    frozen = float(found.table.parameter[snap.after_row])
    assert (snap.kind, snap.after.stable) == ("snap", True)
    lost = ls.follow(family, 0.0, 0.4, report_at=[frozen], **options)
    above = lost.equilibria[list(lost.table.parameter).index(frozen)]
    assert above.index == 1
    assert snap.energy_released == pytest.approx(above.energy - snap.after.energy, rel=0.05)
