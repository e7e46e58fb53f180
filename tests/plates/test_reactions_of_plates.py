"""What supports of plates exert: balance, the derivative of the energy, closed forms; both schemes."""

import math

import numpy as np
import pytest

import lissome as ls
from lissome.plates import MixedPlate, Plate, meshes

SCHEMES = [(Plate, {"degree": 2}), (Plate, {"degree": 3}),
           (MixedPlate, {"orders": (2, 1)}), (MixedPlate, {"orders": (2, 2)})]  # fmt: skip
EXACT = SCHEMES[:2]


def uneven():
    """Return a mesh of [-1, 1] x [-1/2, 1/2] without symmetry."""
    return meshes.rectangle(2.0, 1.0, 2, center=(0.2, 0.1))


def slope(energy, h):
    """Derivative at 0, with an error of order h^4."""
    return (energy(-2 * h) - 8 * energy(-h) + 8 * energy(h) - energy(2 * h)) / (12 * h)


# ---- balance -------------------------------------------------------------------------------------

SUPPORTS = {
    "all edges": {"edges": "hinged"},
    "two edges that meet": {"edges": {"left": "clamped", "bottom": "simply supported"}},
    "an edge and points": {
        "edges": {"right": "sliding clamp"},
        "points": {(-1.0, 0.5): ("deflection", "displacement"), (0.2, 0.1): "displacement_y"},
    },
    "one part twice": {"edges": {"all": "simply supported", lambda x, y: x < -0.99: "clamped"}},
}


@pytest.mark.parametrize("name", SUPPORTS)
@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_supports_bear_the_loads(scheme, more, name):
    width, height = 2.0, 1.0
    plate = scheme(
        mesh=uneven(), bending=1e-3,
        poisson_ratio=0.3, pressure=lambda x, y: 1e-4 * (1 + x), body_force=(2e-4, -1e-4),
        traction={"top": (3e-4, 1e-4)}, **more, **SUPPORTS[name],
    )  # fmt: skip
    eq = ls.equilibrate(plate)
    total = eq.reactions().total()
    area = width * height
    load = [area * 2e-4 + width * 3e-4, -area * 1e-4 + width * 1e-4, 1e-4 * area]
    assert total.force == pytest.approx(-np.array(load), rel=1e-9)
    # About the axis across the plate.
    turn = -width * 3e-4 * 0.5 * height
    assert total.moment[2] == pytest.approx(-turn, rel=1e-9)


@pytest.mark.parametrize("name", ["all edges", "two edges that meet", "one part twice"])
@pytest.mark.parametrize(("scheme", "more"), EXACT)
def test_moments_of_the_supports_balance_the_pressure(scheme, more, name):
    q = 1e-4 if name == "two edges that meet" else 1e-2  # the latter hardly hold the plate
    plate = scheme(
        mesh=uneven(), bending=1e-4 if q > 1e-3 else 1e-3, poisson_ratio=0.3,
        pressure=lambda x, y: q * (1 + x + 2 * y), **more, **SUPPORTS[name],
    )  # fmt: skip
    eq = ls.equilibrate(plate)
    assert np.max(np.abs(eq.deflection)) > 0.03
    # Integrals of q y and of -q x over the rectangle.
    load = q * np.array([2 * 2.0 / 12, -(2.0**3) / 12, 0.0])
    assert eq.reactions().total().moment == pytest.approx(-load, abs=1e-9 * q)


@pytest.mark.parametrize("orders", [(2, 1), (2, 2)])
def test_what_moments_of_the_mixed_scheme_miss(orders):
    """It is the work of membrane forces on the misfit of the slopes, and vanishes with the mesh."""
    missing = []
    for q, divisions in ((1e-8, 2), (1e-2, 2), (1e-2, 4), (1e-2, 8)):
        plate = MixedPlate(
            mesh=meshes.rectangle(2.0, 1.0, divisions, center=(0.2, 0.1)), bending=1e-3,
            poisson_ratio=0.3, pressure=lambda x, y, q=q: q * (1 + x + 2 * y), edges="hinged",
            orders=orders,
        )  # fmt: skip
        eq = ls.equilibrate(plate)
        load = q * np.array([2 * 2.0 / 12, -(2.0**3) / 12, 0.0])
        found = (eq.reactions().total().moment + load) / q
        # Slopes and gradients of the deflection at the points of quadrature, and membrane forces.
        m, x = plate._membrane_data(), plate._vector(eq.state)
        n, k = m["gradients"].shape[2], m["tilts"].shape[2]
        u = [x[m["local"][:, i * n : (i + 1) * n]] for i in range(2)]
        du = np.stack([np.einsum("tqnx,tn->tqx", m["gradients"], part) for part in u], axis=-2)
        xi = np.einsum("tqnx,tn->tqx", m["tilts"], x[m["local"][:, 2 * n : 2 * n + k]])
        w = plate._parts(x)[1][plate.space.inner_local]
        slope = np.einsum("tqnx,tn->tqx", plate._material["inner_gradients"], w)
        strain = 0.5 * (du + du.swapaxes(-1, -2) + xi[..., :, None] * xi[..., None, :])
        trace = np.trace(strain, axis1=-2, axis2=-1)[..., None, None]
        force = (0.7 * strain + 0.3 * trace * np.eye(2)) / (1 - 0.3**2)
        work = np.einsum("tq,tqij,tqj->i", m["weights"], force, xi - slope) / q
        assert found == pytest.approx([work[1], -work[0], 0.0], abs=1e-9)
        missing.append(float(np.hypot(*work)))
    assert missing[0] < 1e-9  # a plate that stays flat has no membrane forces
    assert math.log2(missing[1] / missing[3]) / 2 > 2


def test_what_two_edges_share_is_counted_once():
    options = {"mesh": meshes.rectangle(divisions=3), "bending": 1e-2, "poisson_ratio": 0.3,
               "pressure": 1.0}  # fmt: skip
    whole = Plate(edges="simply supported", **options)
    sides = dict.fromkeys(("left", "right", "bottom", "top"), "simply supported")
    parts = ls.equilibrate(Plate(edges=sides, **options)).reactions()
    assert list(parts) == list(sides)
    for part in parts.values():  # the square is symmetric
        assert part.force == pytest.approx([0.0, 0.0, -0.25], abs=1e-9)
    total = ls.equilibrate(whole).reactions("all")
    assert total.force == pytest.approx(parts.total().force, abs=1e-10)
    assert total.position[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert parts["left"].position == pytest.approx([-0.5, 0.0, 0.0], abs=1e-12)


def test_a_free_plate_has_no_support():
    plate = Plate(mesh=meshes.rectangle(divisions=2), bending=1e-2, poisson_ratio=0.3)
    assert len(ls.equilibrate(plate).reactions()) == 0


# ---- work ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_work_of_an_edge_that_is_pushed_and_turned(scheme, more):
    """dE = F dx + M dphi in a state that is bent far: the edge is 0.4 high, the plate 0.1 thick."""
    mesh = uneven()

    def at(push=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
        return scheme(
            mesh=mesh, bending=1e-3, poisson_ratio=0.3,
            pressure=2e-3, **more,
            edges={
                "left": "clamped",
                "right": {
                    "displacement": lambda x, y: np.stack(
                        [-0.02 + push[0] - turn[2] * y, 0.01 + push[1] + 0 * y]
                    ),
                    "deflection": lambda x, y: 0.4 + push[2] + turn[0] * y,
                    "slope": lambda x, y: 0.1 - turn[1] + 0 * x,
                },
            },
        )  # fmt: skip

    here = ls.equilibrate(at())
    edge = here.reactions("right")
    scale = np.max(np.abs([edge.force, edge.moment]))
    assert edge.position == pytest.approx([1.0, 0.0, 0.4], abs=1e-12)
    for k, unit in enumerate(np.eye(3)):
        for motion, exact in (("push", edge.force[k]), ("turn", edge.moment[k])):
            work = slope(
                lambda d, m=motion, u=unit: ls.equilibrate(at(**{m: d * u}), here).energy, 2e-3
            )
            assert work == pytest.approx(exact, abs=1e-5 * scale), (motion, k)


@pytest.mark.parametrize(("scheme", "more"), [SCHEMES[1], SCHEMES[2]])
def test_work_of_an_indenter(scheme, more):
    def at(depth):
        return scheme(
            mesh=meshes.disc(divisions=2), bending=1e-3, poisson_ratio=0.3, edges="hinged",
            points={(0.0, 0.0): {"deflection": depth}}, **more,
        )  # fmt: skip

    here = ls.equilibrate(at(-0.2))
    found = here.reactions()
    push = slope(lambda d: ls.equilibrate(at(-0.2 + d), here).energy, 2e-3)
    assert found[(0.0, 0.0)].force == pytest.approx([0.0, 0.0, push], rel=1e-7, abs=1e-12)
    assert push < 0.0  # downward
    assert found["all"].force == pytest.approx([0.0, 0.0, -push], rel=1e-7, abs=1e-9)


# ---- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
@pytest.mark.parametrize(
    ("right", "force", "moment"),
    [("clamped", 1 / 2, 1 / 12), ("simply supported", 5 / 8, 1 / 8), ("free", 1.0, 1 / 2)],
)
def test_a_plate_that_bends_to_a_cylinder_is_a_beam(scheme, more, right, force, moment):
    """Built in on the left: q L/2 and q L^2/12, 5 q L/8 and q L^2/8, q L and q L^2/2."""
    q, length, width = 1e-7, 2.0, 0.5
    edges = {"left": "clamped"} | ({} if right == "free" else {"right": right})
    plate = scheme(
        mesh=meshes.rectangle(length, width, 4), bending=1e-2, poisson_ratio=0.0, pressure=q,
        edges=edges, **more,
    )  # fmt: skip
    left = ls.equilibrate(plate).reactions("left")
    close = 1e-6 if more.get("degree") == 3 else 2e-2
    assert left.force[2] == pytest.approx(-force * q * length * width, rel=close)
    # The support holds the edge against the load, which turns the plate about +y.
    assert left.moment[1] == pytest.approx(moment * q * length**2 * width, rel=3 * close)


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
@pytest.mark.parametrize("edges", ["clamped", "simply supported"])
def test_the_edge_of_a_disc_bears_its_load(scheme, more, edges):
    plate = scheme(
        mesh=meshes.disc(divisions=3), bending=1e-2, poisson_ratio=0.3, pressure=1e-3, edges=edges,
        **more,
    )  # fmt: skip
    edge = ls.equilibrate(plate).reactions("all")
    radius = 0.5 * plate.space.extent
    assert edge.force == pytest.approx([0, 0, -math.pi * radius**2 * 1e-3], rel=2e-4, abs=1e-10)
    assert np.max(np.abs(edge.moment)) < 1e-9


@pytest.mark.parametrize(("scheme", "more"), SCHEMES)
def test_a_sheet_between_rollers_pulls_with_its_stiffness(scheme, more):
    """C e on each unit of width, without the factor 1/(1 - nu^2): it contracts across."""
    plate = scheme(
        mesh=meshes.rectangle(2.0, 0.5, 2), bending=1e-2, poisson_ratio=0.3, stretching=3.0, **more,
        edges={"left": {"displacement_x": 0.0, "deflection": 0.0}, "right": {"displacement_x": 0.02}},
        points={(0.0, 0.0): {"displacement_y": 0.0}},
    )  # fmt: skip
    found = ls.equilibrate(plate).reactions()
    assert found["right"].force[0] == pytest.approx(3.0 * 0.01 * 0.5, rel=1e-9)
    assert found["left"].force[0] == pytest.approx(-3.0 * 0.01 * 0.5, rel=1e-9)
    assert np.max(np.abs(found[0, 0].force)) < 1e-12


def test_corners_of_a_supported_square_are_held_down():
    """Kirchhoff's forces in the corners, 2 D (1 - nu) w_xy by Navier's series: 0.065 q a^2 each."""
    corners = {(x, y): "deflection" for x in (-0.5, 0.5) for y in (-0.5, 0.5)}
    sides = dict.fromkeys(("left", "right", "bottom", "top"), "simply supported")
    forces = []
    for divisions in (2, 4, 8):
        plate = Plate(
            mesh=meshes.rectangle(divisions=divisions), bending=1.0, poisson_ratio=0.3, pressure=1e-3,
            edges=sides, points=corners,
        )  # fmt: skip
        found = ls.equilibrate(plate).reactions()
        # The deflection there is held by two edges and a point: a third each.
        forces.append(3 * found[0.5, 0.5].force[2] / 1e-3)
    m = np.arange(1, 400, 2.0)
    exact = 2 * 0.7 * 16 / math.pi**4 * np.sum((m[:, None] ** 2 + m**2) ** -2.0)
    errors = np.array(forces) - exact
    # A corner has its share of the load of the edges, too, which vanishes with the mesh.
    assert errors[0] > errors[1] > errors[2] > 0
    assert errors[2] < 0.01 * exact
