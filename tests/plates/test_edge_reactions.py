"""Forces and moments per length along the edges of plates, and the forces in corners."""

import math
import pickle

import numpy as np
import pytest

import lissome as ls
from lissome.errors import InvalidInput
from lissome.plates import MixedPlate, Plate, meshes

NU = 0.3


def bent(mesh, **more):
    """Return a plate of D = 1 under a load that bends it so little that it stays linear."""
    options = {"bending": 1 - NU**2, "poisson_ratio": NU, "pressure": 1e-6, "degree": 3} | more
    return ls.equilibrate(Plate(mesh=mesh, **options))


def middle(edge, values, side=1):
    """Return the value of samples next to the middle (1/2, 0) of the right side of a square."""
    away = np.hypot(edge.positions[:, 0] - 0.5 * side, edge.positions[:, 1])
    return values[np.argmin(away)]


# ---- the simply supported square: Levy's series ----------------------------------------------------


def levy_force(x):
    """-V/(q a) at the distance x a from a corner: effective shear of the square, Levy's series.

    On half of the functions cosh(k y) and k y sinh(k y) the deflection 4/(pi m)^5 sin(k x), with
    k = m pi, is supported at y = 1/2; V = w_yyy + (2 - nu) w_xxy there.
    """
    m = np.arange(1, 20001, 2.0)[:, None]
    k = m * math.pi
    th = np.tanh(k / 2)
    # A cosh(k/2), B cosh(k/2) of 1 + A cosh(k y) + B k y sinh(k y).
    a, b = -(2 + k / 2 * th) / 2, 0.5
    first, third = a * th + b * (th + k / 2), a * th + b * (3 * th + k / 2)
    size = 4 / (math.pi**5 * m**5) * k**3
    return np.sum(np.sin(k * x) * size * (third - (2 - NU) * first), axis=0)


def test_series_of_the_square():
    """The series holds up the load: the integral over the edges, less the corners, is q a^2."""
    m = np.arange(1, 400, 2.0)
    corner = 2 * (1 - NU) * 16 / math.pi**4 * np.sum((m[:, None] ** 2 + m**2) ** -2.0)
    x = (np.arange(200) + 0.5) / 200
    assert 4 * np.mean(levy_force(x)) - 4 * corner == pytest.approx(1.0, abs=1e-4)
    assert levy_force(np.array([0.5]))[0] == pytest.approx(0.420, abs=1e-3)  # known to three digits


@pytest.mark.parametrize("degree", [2, 3])
def test_simply_supported_square(degree):
    m = np.arange(1, 400, 2.0)
    exact_corner = 2 * (1 - NU) * 16 / math.pi**4 * np.sum((m[:, None] ** 2 + m**2) ** -2.0)
    errors = []
    for divisions in (2, 4, 8):
        mesh = meshes.rectangle(divisions=divisions, grading=1.0)
        found = bent(mesh, edges="simply supported", degree=degree).reactions("all").along()
        exact = -levy_force(found.positions[:, 1] + 0.5) * 1e-6
        right = np.abs(found.positions[:, 0] - 0.5) < 1e-9
        off = (found.force[:, 2] - exact)[right]
        corners = found.point_forces[:, 2] / 1e-6
        assert len(corners) == 4 and np.ptp(corners) < 1e-5
        assert np.max(np.abs(found.moment)) == 0.0
        assert np.max(np.abs(found.force[:, :2])) == 0.0
        errors.append(
            [
                np.sqrt(
                    (found.weights[right] @ off**2) / (found.weights[right] @ exact[right] ** 2)
                ),
                abs(corners[0] / exact_corner - 1),
            ]
        )
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    # The force per length falls to zero in the corners with a logarithm in its slope.
    assert np.all(rates[:, 0] > 1.3)
    assert np.all(rates[:, 1] > 1.7)
    assert errors[-1][0] < 0.05 and errors[-1][1] < 0.03


# ---- the clamped square: biharmonic functions --------------------------------------------------------


class ClampedSquare:
    """q |z|^4/64 and the biharmonic functions Re z^4k, |z|^2 Re z^4k that clamp a square of side 1.

    Fitted to w = 0 and w_x = 0 on the edge x = 1/2.
    """

    def __init__(self, count=24):
        self.count = count
        y = 0.5 * np.cos(np.linspace(0, math.pi, 8 * count))
        known, terms = self.parts(y)
        matrix = np.vstack([4 * terms[0, 0], terms[1, 0]])
        right = -np.concatenate([4 * known[0, 0], known[1, 0]])
        size = np.linalg.norm(matrix, axis=0)
        self.factors = np.linalg.lstsq(matrix / size, right, rcond=1e-15)[0] / size

    def parts(self, y):
        """Return derivatives (by x, by y) of the known part and of the terms at x = 1/2."""
        x, z, s = 0.5, 0.5 + 1j * y, math.sqrt(2)
        g = x * x + y * y
        known = {(0, 0): g * g / 64, (1, 0): x * g / 16, (2, 0): (g + 2 * x * x) / 16,
                 (0, 2): (g + 2 * y * y) / 16, (3, 0): 3 * x / 8 + 0 * y, (1, 2): x / 8 + 0 * y}  # fmt: skip
        columns = {d: [] for d in known}
        for n in range(0, 4 * self.count, 4):
            h = {
                (a, b): (1j**b * math.perm(n, a + b) * s**n * z ** max(n - a - b, 0)).real
                for a in range(4) for b in range(4 - a)
            }  # fmt: skip
            times = {
                (0, 0): g * h[0, 0],
                (1, 0): g * h[1, 0] + 2 * x * h[0, 0],
                (2, 0): g * h[2, 0] + 4 * x * h[1, 0] + 2 * h[0, 0],
                (0, 2): g * h[0, 2] + 4 * y * h[0, 1] + 2 * h[0, 0],
                (3, 0): g * h[3, 0] + 6 * x * h[2, 0] + 6 * h[1, 0],
                (1, 2): g * h[1, 2] + 2 * x * h[0, 2] + 4 * y * h[1, 1] + 2 * h[1, 0],
            }
            for d, column in columns.items():
                column += [h[d], times[d]]
        return known, {d: np.array(column).T for d, column in columns.items()}

    def at(self, y):
        """Return M_nn/(q a^2) and the force per length over q a."""
        known, terms = self.parts(y)
        w = {d: known[d] + terms[d] @ self.factors for d in known}
        return w[2, 0] + NU * w[0, 2], -(w[3, 0] + (2 - NU) * w[1, 2])


@pytest.mark.parametrize("degree", [2, 3])
def test_clamped_square(degree):
    exact = ClampedSquare()
    assert exact.at(np.zeros(1))[0][0] == pytest.approx(0.0513, abs=5e-5)
    assert exact.at(np.zeros(1))[0][0] == pytest.approx(
        ClampedSquare(32).at(np.zeros(1))[0][0], rel=1e-5
    )
    errors = []
    for divisions in (2, 4, 8):
        found = bent(
            meshes.rectangle(divisions=divisions), edges={"right": "clamped", "left": "clamped",
            "bottom": "clamped", "top": "clamped"}, degree=degree,
        ).reactions("right").along()  # fmt: skip
        moment, force = exact.at(found.positions[:, 1])
        off = found.bending_moment / 1e-6 - moment
        at_middle = [
            middle(found, found.bending_moment / 1e-6 - moment),
            middle(found, found.force[:, 2] / 1e-6 - force),
        ]
        # The plate is on the left: the edge runs along +y, and is held against turning about -y.
        assert found.moment[:, 1] == pytest.approx(-found.bending_moment, abs=1e-15)
        assert np.all(np.diff(found.arclength) >= 0)
        assert found.positions[:, 1] == pytest.approx(found.arclength - 0.5, abs=1e-14)
        errors.append([np.sqrt(found.weights @ off**2), *np.abs(at_middle)])
        ends = np.abs(found.point_forces[:, 2]) / 1e-6
        assert len(ends) == 2 and np.max(ends) < 0.02  # none in Kirchhoff's theory
    errors = np.array(errors)
    # In the corners the moment goes with distance**1.74: first order at least along the whole edge.
    assert np.all(np.log2(errors[0] / errors[-1]) / 2 > [1.2, 1.0, 1.7])
    assert errors[-1][0] < 0.01 * 0.0513 and errors[-1][1] < 0.01 * 0.0513
    assert errors[-1][2] < 0.005


# ---- discs: exact -------------------------------------------------------------------------------------


@pytest.mark.parametrize("edges", ["clamped", "simply supported"])
def test_disc(edges):
    """f = -q R/2 on both rims, and M_nn = q R^2/8 where it is clamped."""
    errors = []
    for divisions in (2, 4, 8):
        rim = bent(meshes.disc(2.0, divisions=divisions), edges=edges).reactions("all").along()
        assert len(rim.point_forces) == 0 and not np.any(rim.piece)
        assert rim.arclength[-1] == pytest.approx(4 * math.pi, rel=1e-3)
        moment = 0.5 if edges == "clamped" else 0.0
        errors.append([np.max(np.abs(rim.force[:, 2] / 1e-6 + 1.0)),
                       np.max(np.abs(rim.bending_moment / 1e-6 - moment))])  # fmt: skip
        # The vector of the moment is along the tangent, with the plate on the left of it.
        x, y, _ = rim.positions.T
        tangent = np.stack([-y, x], axis=1) / np.hypot(x, y)[:, None]
        along = np.sum(rim.moment[:, :2] * tangent, axis=1)
        assert along == pytest.approx(-rim.bending_moment, abs=1e-3 * 1e-6)
    errors = np.array(errors)
    assert np.all(np.log2(errors[:-1, 0] / errors[1:, 0]) > 1.5)
    assert errors[-1, 0] < 1e-4
    if edges == "clamped":
        assert np.all(np.log2(errors[:-1, 1] / errors[1:, 1]) > 2.5)
    else:
        assert np.all(errors[:, 1] == 0.0)


# ---- resultants ---------------------------------------------------------------------------------------

SUPPORTS = {
    "one": {"edges": "hinged"},
    "two that meet": {"edges": {"left": "clamped", "bottom": "simply supported"}},
    "a point on an edge": {
        "edges": {"right": "sliding clamp"},
        "points": {(1.0, 0.1): "deflection", (-1.0, 0.5): ("deflection", "displacement")},
    },
    "one over another": {"edges": {"all": "simply supported", lambda x, y: x < -0.99: "clamped"}},
    "half of a side": {"edges": {lambda x, y: (y < -0.49) & (x < 0.2): "clamped"}},
}


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("name", SUPPORTS)
def test_all_that_acts_along_an_edge_makes_its_reaction(name, degree):
    plate = Plate(
        mesh=meshes.rectangle(2.0, 1.0, 3, center=(0.2, 0.1)), bending=1e-3, poisson_ratio=NU,
        pressure=lambda x, y: 1e-4 * (1 + x), body_force=(2e-4, -1e-4), degree=degree, **SUPPORTS[name],
    )  # fmt: skip
    for part, reaction in ls.equilibrate(plate).reactions().items():
        if isinstance(part, tuple):
            with pytest.raises(InvalidInput, match="only edges of a `Plate`"):
                reaction.along()
            continue
        edge = reaction.along()
        force = edge.weights @ edge.force + edge.point_forces.sum(axis=0)
        moment = edge.weights @ (np.cross(edge.positions, edge.force) + edge.moment)
        moment += np.cross(edge.point_positions, edge.point_forces).sum(axis=0)
        assert force == pytest.approx(reaction.force, abs=1e-12)
        assert moment == pytest.approx(reaction.moment_about((0, 0, 0)), abs=1e-12)


def test_a_sheet_that_is_pulled():
    """A uniform strain e of a sheet that cannot contract: C e/(1 - nu^2) per length, no forces at ends."""
    plate = Plate(
        mesh=meshes.rectangle(2.0, 1.0, 3), bending=1.0, poisson_ratio=NU, stretching=3.0,
        edges={"all": {"displacement_y": 0.0, "deflection": 0.0}, "left": {"displacement_x": 0.0},
               "right": {"displacement_x": 0.02}},
    )  # fmt: skip
    found = ls.equilibrate(plate).reactions()
    for name, sign in (("left", -1), ("right", 1)):
        edge = found[name].along()
        assert edge.force[:, 0] == pytest.approx(sign * 3.0 * 0.01 / (1 - NU**2), rel=1e-9)
        assert np.max(np.abs(edge.point_forces)) < 1e-12
    # The edges along the pull bear nu times as much.
    rim = found["all"].along()
    top = np.abs(rim.positions[:, 1] - 0.5) < 1e-12
    assert rim.force[top & (np.abs(rim.positions[:, 0]) < 0.99), 1] == pytest.approx(
        NU * 3.0 * 0.01 / (1 - NU**2), rel=1e-9
    )


# ---- what it is, and what it refuses ------------------------------------------------------------------


def test_corners_by_their_angle():
    mesh = meshes.rectangle(divisions=4)
    reaction = bent(mesh, edges="clamped").reactions("all")
    edge = reaction.along()
    assert sorted(set(edge.piece)) == [0, 1, 2, 3]
    assert edge.positions[0, :2] == pytest.approx([0.5, -0.5])  # rightmost, then lowest
    assert edge.arclength[-1] == pytest.approx(4.0)
    round_ = reaction.along(corner_angle=2.0)
    assert not np.any(round_.piece) and len(round_.point_forces) == 0
    frame = edge.to_frame()
    assert len(frame) == len(edge.arclength) == 3 * len(mesh.boundary_facets())
    assert frame.weight.sum() == pytest.approx(4.0)
    again = pickle.loads(pickle.dumps(reaction))
    assert np.array_equal(again.along().force, edge.force)


def test_a_mesh_that_is_numbered_otherwise():
    """Senses of edges and triangles are those of numbers; what is found is not."""
    mesh = meshes.rectangle(divisions=4, center=(0.1, 0.05))
    order = np.random.default_rng(0).permutation(mesh.nvertices)
    place = np.empty_like(mesh.p)
    place[:, order] = mesh.p
    other = type(mesh)(place, np.ascontiguousarray(order[mesh.t][[1, 0, 2]]))
    one, two = (bent(m, edges="clamped").reactions("all").along() for m in (mesh, other))
    assert two.positions == pytest.approx(one.positions, abs=1e-12)
    for name in ("force", "moment", "point_positions", "bending_moment"):
        a, b = getattr(one, name), getattr(two, name)
        if name == "point_positions":
            a, b = np.sort(a, axis=0), np.sort(b, axis=0)
        assert b == pytest.approx(a, abs=1e-6 * np.max(np.abs(a))), name


def test_what_cannot_be_told():
    side = bent(meshes.rectangle(divisions=1), edges={lambda x, y: (x > 0.4) & (y > 0): "clamped"})
    with pytest.raises(InvalidInput, match="refine the mesh"):
        next(iter(side.reactions().values())).along()
    mixed = ls.equilibrate(
        MixedPlate(mesh=meshes.rectangle(divisions=2), bending=1.0, poisson_ratio=NU,
                   pressure=1e-6, edges="clamped")
    )  # fmt: skip
    with pytest.raises(InvalidInput, match="only edges of a `Plate`"):
        mixed.reactions("all").along()
    with pytest.raises(InvalidInput, match="corner_angle"):
        bent(meshes.rectangle(divisions=2), edges="clamped").reactions("all").along(0.0)
