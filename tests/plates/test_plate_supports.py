"""Supports of plates that are moved: stretched, bent, tilted and followed; both schemes."""

import numpy as np
import pytest
import skfem

import lissome as ls
from lissome.errors import InvalidInput
from lissome.plates import MixedPlate, Plate, PlateState, meshes

SCHEMES = [(Plate, {"degree": 2}), (Plate, {"degree": 3}),
           (MixedPlate, {"orders": (2, 1)}), (MixedPlate, {"orders": (2, 2)})]  # fmt: skip
SHORT = [SCHEMES[0], SCHEMES[2]]
GRADIENT = np.array([[0.02, -0.01], [0.03, -0.04]])


def uneven(width=2.0, height=1.0):
    return meshes.rectangle(width, height, 2, center=(0.2, 0.1))


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_a_linear_displacement_of_the_edges_strains_evenly(scheme, more):
    """A patch test: any uniform gradient, small or large, on uneven triangles."""
    mesh = uneven()
    plate = scheme(
        mesh=mesh, bending=1e-2, poisson_ratio=0.3, stretching=2.0, **more,
        edges={"displacement": lambda x, y: np.einsum("ij,j...->i...", GRADIENT, np.stack([x, y]))},
        points={(0.2, 0.1): "deflection"},
    )  # fmt: skip
    found = ls.equilibrate(plate, require="any")
    assert found.displacement == pytest.approx(mesh.p.T @ GRADIENT.T, abs=1e-13)
    assert np.max(np.abs(found.deflection)) < 1e-13
    e = 0.5 * (GRADIENT + GRADIENT.T)
    force = 2.0 / (1 - 0.3**2) * (0.7 * e + 0.3 * np.trace(e) * np.eye(2))
    everywhere = plate.membrane_forces(found.state)
    assert everywhere == pytest.approx(np.broadcast_to(force, everywhere.shape), abs=1e-12)
    assert found.energy == pytest.approx(0.5 * np.sum(force * e) * 2.0, rel=1e-12)


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_a_roller_lets_the_sheet_contract_across(scheme, more):
    """Pulled by 1 % between rollers: strains 0.01 and -nu 0.01, energy C e^2/2 without (1 - nu^2)."""
    plate = scheme(
        mesh=uneven(), bending=1e-2, poisson_ratio=0.3, stretching=2.0, **more,
        edges={"left": {"displacement_x": 0.0, "deflection": 0.0}, "right": {"displacement_x": 0.02}},
        points={(0.2, 0.1): {"displacement_y": 0.001}},
    )  # fmt: skip
    found = ls.equilibrate(plate)
    assert found.energy == pytest.approx(0.5 * 2.0 * 0.01**2 * 2.0, rel=1e-10)
    x, y = plate.mesh.p
    expected = np.stack([0.01 * (x + 1), 0.001 - 0.003 * (y - 0.1)], axis=1)
    assert found.displacement == pytest.approx(expected, abs=1e-12)
    at = plate.membrane_forces_at([[0.3, 0.3], [-0.9, 0.0]], found.state)
    assert at == pytest.approx(np.broadcast_to(np.diag([0.02, 0.0]), (2, 2, 2)), abs=1e-12)


def tilted(b):
    """A finite rigid tilt: w = b x, u = -b (b x)/2."""
    return {
        "deflection": lambda x, y: b[0] * x + b[1] * y,
        "gradient": b,
        "displacement": lambda x, y: -0.5 * np.multiply.outer(b, b[0] * x + b[1] * y),
    }


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_tilted_clamps_cost_nothing(scheme, more):
    """All edges move as a rigid, finite tilt says: no energy, no moment, no force inside."""
    b = np.array([0.3, -0.2])
    mesh = uneven()
    plate = scheme(
        mesh=mesh, bending=1e-2, poisson_ratio=0.3, edges={"all": tilted(b)}, **more
    )  # fmt: skip
    found = ls.equilibrate(plate)
    assert abs(found.energy) < 1e-11 * 1e-2 * (b @ b)  # rounding of the sum of terms B/h^2 w^2
    assert found.deflection == pytest.approx(b @ mesh.p, abs=1e-10)
    assert np.max(np.abs(plate.moments(found.state))) < 1e-10
    assert np.max(np.abs(plate.membrane_forces(found.state))) < 1e-9


@pytest.mark.parametrize("degree", [2, 3])
def test_tilted_clamps_cost_nothing_on_curved_edges(degree):
    """The slope of a curved edge varies along it; given as a gradient it is exact."""
    b = np.array([0.3, -0.2])
    mesh = meshes.disc(0.5, 2)
    plate = Plate(
        mesh=mesh, bending=1e-2, poisson_ratio=0.3, edges={"all": tilted(b)}, degree=degree
    )  # fmt: skip
    assert abs(ls.equilibrate(plate).energy) < 1e-11 * 1e-2 * (b @ b)


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_a_lifted_edge_of_a_simply_supported_square(scheme, more):
    """One edge is lifted as a sine: Levy's solution; M_n = 0 is w_nn + nu w_tt = 0."""
    nu, k = 0.3, np.pi

    def basis(y):  # cosh, sinh, y cosh, y sinh and their second derivatives
        c, s = np.cosh(k * y), np.sinh(k * y)
        value = np.array([c, s, y * c, y * s])
        second = k * k * value + 2 * k * np.array([0 * c, 0 * c, s, c])
        return value, second

    def normal(y):
        value, second = basis(y)
        return second - nu * k * k * value

    matrix = np.array([basis(0.0)[0], basis(1.0)[0], normal(0.0), normal(1.0)])
    a = np.linalg.solve(matrix, [0.0, 1e-5, 0.0, 0.0])
    errors = []
    for refinement in (1, 2, 3) if more in ({"degree": 2}, {"orders": (2, 1)}) else (0, 1, 2):
        mesh = skfem.MeshTri.init_sqsymmetric().refined(refinement)
        plate = scheme(
            mesh=mesh, bending=1.0, poisson_ratio=nu, **more,
            edges={lambda x, y: y < 1: {"deflection": 0.0},
                   lambda x, y: y > 1 - 1e-9: {"deflection": lambda x, y: 1e-5 * np.sin(k * x)}},
            points={(0.0, 0.0): "displacement", (1.0, 0.0): "displacement_y"},
        )  # fmt: skip
        # Corners belong to both edges and sin(pi) is not quite zero.
        w = plate.deflection_at([[0.5, 0.5], [0.25, 0.75]], ls.equilibrate(plate).state)
        exact = np.array([a @ basis(0.5)[0], a @ basis(0.75)[0] * np.sin(k / 4)])
        errors.append(np.max(np.abs(w / exact - 1)))
    # The error of the mixed scheme of equal orders changes its sign on the way; that of lower order
    # is large on the first mesh.
    halvings = 1 if more == {"orders": (2, 1)} else 2
    order = np.log2(errors[-1 - halvings] / errors[-1]) / halvings
    assert order > (1.9 if scheme is MixedPlate else 3.5)
    assert errors[-1] < (1e-4 if scheme is Plate else 3e-2)


@pytest.mark.parametrize(("scheme", "more"), SHORT)
def test_turned_clamps_bend_a_strip_into_a_circle(scheme, more):
    """nu = 0: the slope of one end is prescribed, and w and u follow a parabola exactly."""
    turn = 1e-6
    plate = scheme(
        mesh=uneven(), bending=1.0, poisson_ratio=0.0, **more,
        edges={"left": {"deflection": 0.0, "slope": 0.0, "displacement": (0.0, 0.0)},
               "right": {"deflection": turn * 2.0 / 2, "slope": turn}},
    )  # fmt: skip
    found = ls.equilibrate(plate)
    # Curvature turn/2 all along: energy B (turn/2)^2/2 times the area, moment B turn/2.
    rel = 1e-9 if scheme is Plate else 2e-2
    assert found.bending_energy == pytest.approx(0.5 * (turn / 2) ** 2 * 2.0, rel=rel)
    at = plate.moments_at([[0.3, 0.1], [-0.5, 0.2]], found.state)
    assert at[:, 0, 0] == pytest.approx(turn / 2, rel=10 * rel)
    bent = plate.curvature_at([[0.3, 0.1]], found.state)
    assert bent[0, 0, 0] == pytest.approx(turn / 2, rel=10 * rel)


@pytest.mark.parametrize(("scheme", "more"), SHORT)
def test_derivatives_with_moved_supports_are_those_of_the_lagrangian(scheme, more):
    plate = scheme(
        mesh=uneven(), bending=1e-3, poisson_ratio=0.3, **more,
        edges={"left": {"deflection": 0.1, "slope": 0.2, "displacement": (0.1, 0.0)},
               "right": {"deflection": lambda x, y: 0.1 * y}},
        points={(0.2, 0.1): {"deflection": 0.3}},
    )  # fmt: skip
    rng = np.random.default_rng(4)
    state = plate.adopt(PlateState(0.1 * rng.standard_normal(plate.space.size)))
    m = rng.standard_normal(plate.constraints_count)
    dx, h = rng.standard_normal(plate.size), 1e-4

    def lagrangian(step):
        value = plate.evaluate(plate.retract(state, step * dx), m, 0)
        return value.energy + m @ value.constraints

    slope = 8 * (lagrangian(h) - lagrangian(-h)) - (lagrangian(2 * h) - lagrangian(-2 * h))
    here = plate.evaluate(state, m, 1)
    assert slope / (12 * h) == pytest.approx(here.gradient @ dx, rel=1e-8)


@pytest.mark.parametrize(("scheme", "more"), SHORT)
def test_adopting_a_scale_does_not_depend_on_the_way(scheme, more):
    """Supports that move and come back leave the state as it was."""
    plate = scheme(
        mesh=uneven(), bending=1e-3, poisson_ratio=0.3, **more,
        edges={"left": "clamped", "right": {"deflection": 0.1, "displacement": (-0.05, 0.0)}},
    )  # fmt: skip
    state = plate.start()
    away = plate.with_(support_scale=-3.0).adopt(plate.with_(support_scale=2.0).adopt(state))
    assert plate.adopt(away).x == pytest.approx(state.x, abs=1e-12)
    fresh = plate.with_(support_scale=2.0).start()
    assert fresh.x == pytest.approx(2.0 * state.x, abs=1e-12)


def pushed(scheme, more, mesh, **changes):
    """A strip, clamped at one end, that the other end pushes; nu = 0."""
    return scheme(
        mesh=mesh, bending=1e-4, poisson_ratio=0.0, **more,
        edges={"left": "clamped",
               "right": {"deflection": 0.0, "slope": 0.0, "displacement": (-1.0, 0.0)}},
        **changes,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("scheme", "more", "rel"),
    [(Plate, {"degree": 3}, 1e-3), (MixedPlate, {"orders": (2, 2)}, 0.1)],
)
def test_a_pushed_strip_buckles_at_the_load_of_a_column(scheme, more, rel):
    """Euler's 4 pi^2 B/L^2: the parameter of the branch is the approach of the clamps.

    The mixed scheme is too stiff on so coarse a mesh.
    """
    mesh = meshes.rectangle(1.0, 0.2, 3, grading=1.0)
    plate = pushed(scheme, more, mesh)
    exact = 4 * np.pi**2 * 1e-4
    branch = ls.follow(
        lambda s: plate.with_(support_scale=s), 0.0, 1.2 * exact, step=0.1 * exact,
        eigenvalues=False, event_tolerance=1e-5,
    )  # fmt: skip
    (event,) = branch.events
    assert event.kind == "bifurcation"
    assert event.parameter == pytest.approx(exact, rel=rel)
    # Work of the clamps: the energy of the straight strip is C s^2/2 times the width.
    row = branch.table.iloc[1]
    assert row.energy == pytest.approx(0.5 * 0.2 * row.parameter**2, rel=1e-9)


def test_conflicting_and_impossible_supports_are_refused():
    def plate(edges, points=None, scheme=Plate, **more):
        return scheme(
            mesh=uneven(), bending=1.0, poisson_ratio=0.3, edges=edges, points=points, **more
        )

    clash = {"left": {"deflection": 0.0}, "bottom": {"deflection": 0.1}}
    for edges, points, words in (
        (clash, None, "must agree"),
        ({"left": {"deflection": np.nan}}, None, "deflection"),
        ({"left": {"deflection": None}}, None, "no value"),
        ({"left": {"torque": 1.0}}, None, "torque"),
        ({"left": {"displacement": 0.1}}, None, "displacement"),
        ({"left": {"slope": lambda x, y: np.nan * x}}, None, "slope"),
        ({"left": 3}, None, "3"),
        ("free", {(0.21, 0.1): "deflection"}, "no vertex"),
        ("free", {(0.2, 0.1): "slope"}, "needs an edge"),
        ("free", {(0.2, 0.1, 0.0): "deflection"}, "points"),
        ("free", [(0.2, 0.1)], "mapping"),
    ):
        with pytest.raises(InvalidInput, match=words):
            plate(edges, points)
    with pytest.raises(InvalidInput, match="slope"):
        plate({"left": {"slope": 0.1}}, scheme=MixedPlate)
    for scheme in (Plate, MixedPlate):
        with pytest.raises(InvalidInput, match="support_scale"):
            plate("clamped", scheme=scheme, support_scale=np.inf)


def test_new_values_keep_what_does_not_depend_on_them():
    plate = Plate(
        mesh=uneven(), bending=1.0, poisson_ratio=0.3, edges={"left": {"deflection": 0.1}}
    )
    ls.equilibrate(plate)
    moved = plate.with_(edges={"left": {"deflection": 0.2}})
    assert moved.space.pattern is plate.space.pattern
    assert moved.space.values.max() == 0.2
    more = plate.with_(edges={"left": "clamped"})
    fresh = Plate(mesh=uneven(), bending=1.0, poisson_ratio=0.3, edges={"left": "clamped"})
    assert more.size == fresh.size < plate.size
    state = fresh.interpolate(lambda x, y: (x + 1) ** 2 * (1 + y))
    for order in (0, 1):
        here, there = (p.evaluate(p.adopt(state), np.zeros(0), order) for p in (more, fresh))
        assert here.energy == there.energy


class Pushing:
    """Clamps that approach each other in time; what :func:`lissome.evolve` moves is their scale."""

    def __init__(self, plate):
        self.plate = plate

    def structure(self, memory):
        return self.plate.with_(support_scale=memory)

    def advance(self, memory, time, step, before, after):
        return memory + step


def test_supports_move_in_time():
    """A strip is bent by a turning clamp, nu = 0: the bending energy is B (turn)^2/2 over the length."""
    plate = Plate(
        mesh=uneven(), bending=1.0, poisson_ratio=0.0,
        edges={"left": {"deflection": 0.0, "slope": 0.0, "displacement": (0.0, 0.0)},
               "right": {"deflection": 1e-6, "slope": 1e-6}},
    )  # fmt: skip
    pushing = Pushing(plate)
    start = ls.equilibrate(pushing.structure(0.5))
    run = ls.evolve(pushing, 0.5, start, until=1.0, step=0.1)
    assert run.memory == pytest.approx(1.5)
    assert run.equilibrium.bending_energy == pytest.approx(0.5 * (1.5e-6 / 2) ** 2 * 2, rel=1e-8)


def test_a_plate_that_is_bent_far_is_solved_to_rounding_errors():
    """Held on two edges that meet it hardly resists: deflections of ten times the thickness.

    Rounding errors move its free corner by more than the tolerance, and the solve knows it.
    """
    plate = Plate(
        mesh=uneven(), bending=1e-4, poisson_ratio=0.3, pressure=lambda x, y: 1e-4 * (1 + x),
        edges={"left": "clamped", "bottom": "simply supported"}, degree=3,
    )  # fmt: skip
    eq = ls.equilibrate(plate)
    assert eq.stable
    assert eq.iterations < 60
    assert eq.residual < 1e-12
    assert np.max(np.abs(eq.deflection)) > 0.35
    assert eq.reactions().total().force == pytest.approx([0.0, 0.0, -2e-4], abs=1e-13)
