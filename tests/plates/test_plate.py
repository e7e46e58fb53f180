"""The Foeppl-von Karman plate against closed forms, collocation, symmetries and its own derivatives."""

import numpy as np
import pytest
import skfem
import sympy as sp
from scipy.optimize import brentq
from skfem.helpers import ddot, eye, grad, sym_grad, trace

import lissome as ls
from lissome.errors import InvalidInput
from lissome.factorization import SparseKKT
from lissome.plates import (
    Defect,
    Laminate,
    Layer,
    MixedPlate,
    Plate,
    PlateState,
    SigmoidCurve,
    meshes,
)
from lissome.references.disc import AxisymmetricDisc, buckling_strain, fold

NONE = np.zeros(0)


def hoops(radial, azimuthal):
    """A tensor field with constant radial and azimuthal parts around the origin."""

    def field(x, y):
        out = np.array([[x * x, x * y], [x * y, y * y]]) / (x * x + y * y)
        one = np.eye(2).reshape(2, 2, *np.ones(np.ndim(x), int))
        return radial * out + azimuthal * (one - out)

    return field


def cone(height):
    return lambda x, y: height * (1 - 2 * np.hypot(x, y))


def dome(divisions=4, degree=2, **changes):
    arguments = {
        "bending": 1e-4,
        "poisson_ratio": 0.5,
        "strain": hoops(0.01, -0.02),
        "degree": degree,
    }
    return Plate(mesh=meshes.disc(0.5, divisions), **{**arguments, **changes})


DOME = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5, radius=0.5, strain=(0.01, -0.02))


def general(degree, mesh=None):
    """A plate with nothing uniform, partly held, in a state far from balance."""
    plate = Plate(
        mesh=meshes.rectangle(1.3, 0.9, 2, center=(0.1, 0.05)) if mesh is None else mesh,
        bending=lambda x, y: 1e-3 * (1.5 + np.sin(3 * x)), poisson_ratio=lambda x, y: 0.3 + 0.1 * y,
        stretching=lambda x, y: 1 + 0.2 * x, strain=lambda x, y: np.array([[x, y], [y, 0.1 + x * y]]),
        curvature=[[0.3, 0.1], [0.1, -0.2]], pressure=lambda x, y: 1e-3 * x,
        edges={lambda x, y: x < -0.6: "clamped", lambda x, y: y > 0.4: ("deflection",)},
        degree=degree,
    )  # fmt: skip
    x = 0.1 * np.random.default_rng(3).standard_normal(plate.space.size)
    return plate, plate.adopt(PlateState(x))


@pytest.mark.parametrize("degree", [2, 3])
def test_derivatives_are_those_of_the_energy(degree):
    plate, state = general(degree)
    rng = np.random.default_rng(5)
    dx = rng.standard_normal(plate.size)
    h = 1e-4

    def at(step, order=1):
        return plate.evaluate(plate.retract(state, step * dx), NONE, order)

    here = at(0.0, 2)
    # The energy is a polynomial of degree 4: a five-point formula is exact.
    slope = (8 * (at(h).energy - at(-h).energy) - (at(2 * h).energy - at(-2 * h).energy)) / (12 * h)
    assert slope == pytest.approx(here.gradient @ dx, rel=1e-8)
    bend = 8 * (at(h).gradient - at(-h).gradient) - (at(2 * h).gradient - at(-2 * h).gradient)
    exact = here.kkt.apply(dx, NONE)[0]
    assert np.max(np.abs(bend / (12 * h) - exact)) < 1e-9 * np.max(np.abs(exact))


@pytest.mark.parametrize("mesh", [meshes.rectangle(1.0, 0.8, 2), meshes.disc(0.5, 2)])
@pytest.mark.parametrize("degree", [2, 3])
def test_rigid_motions_change_nothing(mesh, degree):
    plate = Plate(
        mesh=mesh, bending=1e-3, poisson_ratio=0.3, strain=[[0.1, 0.02], [0.02, 0.0]],
        curvature=[[0.5, 0.0], [0.0, -0.3]], degree=degree,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    state = PlateState(0.05 * rng.standard_normal(plate.space.size))
    here = plate.evaluate(state, NONE, 1)
    gauge = plate.gauge(state)
    assert len(gauge) == 6
    assert np.max(np.abs(gauge @ here.gradient)) < 1e-12 * np.linalg.norm(here.gradient)
    # A finite tilt: w + b x, u - b w - b b x/2.
    n, (x, y) = plate.space.nodes, plate.space.positions.T
    b = np.array([0.3, -0.2])
    moved = state.x.copy()
    tilt = b[0] * x + b[1] * y
    w = state.x[2 * n : 3 * n]
    moved[:n] -= b[0] * (w + tilt / 2)
    moved[n : 2 * n] -= b[1] * (w + tilt / 2)
    moved[2 * n : 3 * n] += tilt
    moved[3 * n :] += b[0] * plate.space.tilt[0] + b[1] * plate.space.tilt[1]
    assert plate.evaluate(PlateState(moved), NONE, 0).energy == pytest.approx(
        here.energy, rel=1e-12
    )


@pytest.mark.parametrize(
    ("edges", "expected"),
    [("free", 6), ("simply supported", 3), ("hinged", 0), ("clamped", 0), ("sliding clamp", 3),
     ({lambda x, y: y < -0.49: "simply supported"}, 4)],
)  # fmt: skip
def test_gauge_is_what_the_supports_allow(edges, expected):
    plate = Plate(mesh=meshes.rectangle(divisions=2), bending=1e-3, poisson_ratio=0.3, edges=edges)
    assert len(plate.gauge(plate.start())) == expected
    # Nothing else is soft: the flat plate has the inertia of a minimum.
    assert ls.equilibrate(plate).inertia == (plate.size, expected, 0)


@pytest.mark.parametrize(("degree", "least"), [(2, 3.5), (3, 4.0)])
@pytest.mark.parametrize(
    ("edges", "series"), [("clamped", 1.26531908e-3), ("simply supported", None)]
)
def test_linear_squares(edges, series, degree, least):
    """Center deflections: Navier's series, and the clamped plate's accurate value."""
    if series is None:
        odd = np.arange(1, 400, 2)
        m, n = np.meshgrid(odd, odd)
        series = np.sum(
            16
            / np.pi**6
            * np.sin(m * np.pi / 2)
            * np.sin(n * np.pi / 2)
            / (m * n * (m**2 + n**2) ** 2)
        )
    errors = []
    for refinement in (1, 2, 3) if degree == 2 else (0, 1, 2):
        plate = Plate(
            mesh=skfem.MeshTri.init_sqsymmetric().refined(refinement), bending=1.0, poisson_ratio=0.3,
            edges=edges, pressure=1e-4, degree=degree,
        )  # fmt: skip
        w = plate.deflection_at([0.5, 0.5], ls.equilibrate(plate).state)
        errors.append(abs(w / 1e-4 / (1 - 0.3**2) / series - 1))
    assert errors[-1] < 2e-4
    assert np.log2(errors[0] / errors[-1]) / 2 > least


@pytest.mark.parametrize("degree", [2, 3])
def test_manufactured_solution(degree):
    """A clamped square whose strains, moments and load are computed from a given shape."""
    x, y = sp.symbols("x y")
    nu, bending = sp.Rational(3, 10), sp.Rational(1, 100)
    w = sp.Rational(1, 5) * ((1 - x**2) * (1 - y**2)) ** 2 * (1 + x / 3)
    u = sp.Matrix([(1 - x**2) * (1 - y**2) * y, (1 - x**2) * (1 - y**2) * (x - y)]) / 20
    airy = (x**2 + 2 * y**2 + x**3 * y + x**2 * y**2) / 40
    slope = sp.Matrix([w.diff(x), w.diff(y)])
    gradient = u.jacobian([x, y])
    strain = (gradient + gradient.T) / 2 + slope * slope.T / 2
    stress = sp.Matrix([[airy.diff(y, 2), -airy.diff(x, y)], [-airy.diff(x, y), airy.diff(x, 2)]])
    elastic = (1 + nu) * stress - nu * stress.trace() * sp.eye(2)
    natural = sp.Matrix([[x * y, x], [x, y**2]]) / 10
    bent = sp.hessian(w, (x, y)) - natural
    moment = bending / (1 - nu**2) * ((1 - nu) * bent + nu * bent.trace() * sp.eye(2))
    twice = sum(moment[i, j].diff((x, y)[i], (x, y)[j]) for i in range(2) for j in range(2))
    pull = sum(stress[i, j] * w.diff((x, y)[i], (x, y)[j]) for i in range(2) for j in range(2))
    exact = sp.lambdify((x, y), w)

    def tensor(matrix):
        parts = sp.lambdify((x, y), list(matrix))
        return lambda a, b: np.array(
            [np.broadcast_to(part, np.shape(a)) for part in parts(a, b)]
        ).reshape(2, 2, *np.shape(a))

    errors = []
    for refinement in (1, 2, 3) if degree == 2 else (0, 1, 2):
        # Scale the unit square's mesh to (-1, 1)^2.
        mesh = skfem.MeshTri.init_sqsymmetric().refined(refinement)
        mesh = skfem.MeshTri(2 * mesh.p - 1, mesh.t)
        plate = Plate(
            mesh=mesh, bending=float(bending), poisson_ratio=float(nu), strain=tensor(strain - elastic),
            curvature=tensor(natural), pressure=sp.lambdify((x, y), twice - pull), edges="clamped",
            degree=degree,
        )  # fmt: skip
        start = plate.interpolate(exact)
        found = ls.equilibrate(plate, start)
        nodes = plate.space.positions
        w_nodes = found.state.x[2 * plate.space.nodes : 3 * plate.space.nodes]
        errors.append(float(np.sqrt(np.mean((w_nodes - exact(*nodes.T)) ** 2))))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] > degree + 0.7  # degree + 1 in the limit
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("degree", [2, 3])
def test_dome_converges_to_collocation(degree):
    exact = DOME.solve(height=0.1)
    errors = []
    for divisions in (3, 6):
        plate = dome(divisions, degree)
        found = ls.equilibrate(plate, plate.interpolate(cone(0.1)))
        assert found.iterations <= 8
        height = np.diff(plate.deflection_at([[0.5, 0.0], [0.0, 0.0]], found.state))[0]
        assert height == pytest.approx(exact.height, rel=1e-3)
        errors.append(abs(found.energy / exact.energy - 1))
    assert errors[1] < (1e-4 if degree == 2 else 7e-5)


def test_dome_energy_is_exact_to_one_in_a_million_on_a_fine_graded_mesh():
    plate = Plate(
        mesh=meshes.disc(0.5, 8, grading=2.2), bending=1e-4, poisson_ratio=0.5, strain=hoops(0.01, -0.02),
        degree=3,
    )  # fmt: skip
    found = ls.equilibrate(plate, plate.interpolate(cone(0.1)))
    assert found.energy == pytest.approx(DOME.solve(height=0.1).energy, rel=5e-6)


@pytest.mark.parametrize(
    ("edge", "order"),
    [("clamped", 3.5), ("simply supported", 3.5), ("hinged", 2.5), ("sliding clamp", 2.5)],
)
def test_loaded_disc_with_large_deflection(edge, order):
    """Nearly of fourth order on curved triangles, also where the rim is simply supported."""
    exact = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.3, edge=edge, pressure=2e-3).solve(
        height=0.1
    )
    errors = []
    for divisions in (6, 12):
        mesh = meshes.disc(1.0, divisions, grading=1.0)
        plate = Plate(mesh=mesh, bending=1e-4, poisson_ratio=0.3, edges=edge, pressure=2e-3)
        found = ls.equilibrate(plate)
        errors.append((found.deflection[0] / exact.height - 1, found.energy / exact.energy - 1))
        assert sum(plate.energies(found.state)) == pytest.approx(found.energy, rel=1e-12)
    coarse, fine = np.abs(np.array(errors))
    assert np.all(fine < 2e-4)
    assert np.all(np.log2(coarse / fine) > order)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_flat_defect_disc_buckles_where_collocation_says(nu):
    plate = Plate(mesh=meshes.disc(1.0, 5), bending=4e-4, poisson_ratio=nu)

    def lowest(strain):
        loaded = plate.with_(strain=hoops(strain, 0.0))
        flat = ls.equilibrate(loaded, require="any")
        assert np.max(np.abs(flat.deflection)) < 1e-12
        return ls.smallest_eigenvalue(flat).values[0]

    # The eigenvalue is smooth: two secants find its zero.
    exact = buckling_strain(0.02, nu)
    low, high = 0.9 * exact, 1.1 * exact
    for _ in range(2):
        below, above = lowest(low), lowest(high)
        assert below > 0 > above
        found = low + (high - low) * below / (below - above)
        low, high = 0.99 * found, 1.01 * found
    assert found == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("degree", [2, 3])
def test_clamped_square_buckles_under_its_own_expansion(degree):
    """52.3447 D/L^2 (to 1e-5 by high-order Ritz methods); the stress is uniform."""
    nu, bending = 0.3, 1e-4
    mesh = skfem.MeshTri().refined(3)  # one diagonal: the mixed scheme has a spurious state here
    plate = Plate(mesh=mesh, bending=bending, poisson_ratio=nu, edges="clamped", degree=degree)
    exact = 52.3447 * bending / (1 - nu**2) * (1 - nu)  # N = -C strain/(1 - nu)
    for factor, index in ((0.99, 0), (1.02 if degree == 2 else 1.001, 1)):
        flat = ls.equilibrate(plate.with_(strain=factor * exact * np.eye(2)), require="any")
        assert flat.index == index


def test_bilayer_disc_loses_its_roundness_where_collocation_says():
    nu = 0.3
    disc = AxisymmetricDisc(bending=1e-4, poisson_ratio=nu)
    unit = np.sqrt(12e-4)
    plate = Plate(mesh=meshes.disc(1.0, 5, grading=1.0), bending=1e-4, poisson_ratio=nu)

    def softest(k):
        shape = AxisymmetricDisc(bending=1e-4, poisson_ratio=nu, curvature=(k, k))
        return shape.solve(height=-0.02).softest(2)

    exact = brentq(softest, 3 * unit, 8 * unit, xtol=1e-8)
    branch = ls.follow(
        lambda k: plate.with_(curvature=k * np.eye(2)), 0.5 * exact, 1.3 * exact, on_fold="stop",
        initial=ls.equilibrate(
            plate.with_(curvature=0.5 * exact * np.eye(2)),
            plate.interpolate(lambda x, y: 0.1 * (x * x + y * y)),
        ), eigenvalues=False, event_tolerance=1e-5,
    )  # fmt: skip
    (event,) = branch.events
    # Two modes at once: the axis of the cylinder is arbitrary.
    assert event.kind == "bifurcation"
    assert event.parameter == pytest.approx(exact, rel=3e-3)
    assert disc.solve().energy == 0.0


def test_dome_folds_where_collocation_says():
    exact, _ = fold(DOME.solve(height=0.1), (-1.0, 2.0), step=0.1, most=1.0)
    plate = dome(6)
    start = ls.equilibrate(plate, plate.interpolate(cone(0.1)))
    branch = ls.follow(
        lambda p: plate.with_(curvature=hoops(-p, 2 * p)), 0.0, 1.0, on_fold="stop", initial=start,
        eigenvalues=False, event_tolerance=1e-5,
    )  # fmt: skip
    assert branch.events[-1].kind == "fold"
    assert branch.events[-1].parameter == pytest.approx(exact, rel=1e-3)


def test_orientation_of_the_mesh_does_not_matter():
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    straight = meshes.rectangle(1.0, 0.7, 3, center=(0.1, 0.0))
    energies = []
    rng = np.random.default_rng(8)
    for kind in ("plain", "turned", "shuffled"):
        p, t = straight.p, straight.t
        rotation = np.eye(2)
        if kind == "turned":
            rotation = turn
        elif kind == "shuffled":
            number = rng.permutation(p.shape[1])
            new = np.empty_like(p)
            new[:, number] = p
            p, t = new, number[t][:, rng.permutation(t.shape[1])]
        mesh = skfem.MeshTri(np.ascontiguousarray(rotation @ p), np.ascontiguousarray(t))

        def strain(x, y, rotation=rotation):
            a, b = rotation.T @ np.array([x.ravel(), y.ravel()])
            plain = hoops(0.02, -0.02)(a - 0.1, b)
            turned = np.einsum("ik,kln,jl->ijn", rotation, plain, rotation)
            return turned.reshape(2, 2, *x.shape)

        def hill(x, y, rotation=rotation):
            a, b = rotation.T @ np.array([x.ravel(), y.ravel()])
            return (0.1 * np.cos(2 * (a - 0.1)) * np.cos(2 * b)).reshape(x.shape)

        plate = Plate(mesh=mesh, bending=1e-4, poisson_ratio=0.4, strain=strain)
        energies.append(ls.equilibrate(plate, plate.interpolate(hill)).energy)
    assert energies[1:] == pytest.approx(energies[:1] * 2, rel=1e-8)


def test_mirrored_problem_gives_mirrored_results():
    up = dome(3, curvature=hoops(0.1, -0.3))
    down = up.with_(curvature=hoops(-0.1, 0.3))
    state = ls.equilibrate(up, up.interpolate(cone(0.1)))
    mirrored = ls.equilibrate(down, down.interpolate(cone(-0.1)))
    assert mirrored.energy == pytest.approx(state.energy, rel=1e-10)
    # The same shape, up to a rigid motion: energies of the turned state agree exactly.
    turned = down.evaluate(down.mirrored(state.state), NONE, 1)
    assert turned.energy == pytest.approx(state.energy, rel=1e-13)
    assert np.max(np.abs(turned.gradient)) < 1e-10


def test_scaling_law_holds_to_rounding():
    """Energies are (t/L)^4 C L^2 times a function of strain (L/t)^2 and curvature L^2/t."""
    energies = []
    for t in (0.01, 0.02):
        plate = dome(3, bending=t * t, strain=hoops(100 * t * t, 0.0), curvature=hoops(0.0, -3 * t))
        found = ls.equilibrate(plate, plate.interpolate(cone(10 * t)))
        energies.append(found.energy / t**4)
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)


def test_curvature_of_a_bowl_is_what_it_wants_to_be():
    plate = Plate(
        mesh=meshes.rectangle(divisions=2),
        bending=1.0,
        poisson_ratio=0.2,
        curvature=1e-6 * np.eye(2),
    )
    found = ls.equilibrate(plate)
    # Open towards positive w: the rim is above the center.
    rim, center = plate.deflection_at([[0.5, 0.0], [0.0, 0.0]], found.state)
    assert rim - center == pytest.approx(0.5e-6 * 0.25, rel=1e-5)
    bent = plate.curvature_at([[0.1, 0.2], [-0.2, 0.1]], found.state)
    assert bent == pytest.approx(np.broadcast_to(1e-6 * np.eye(2), (2, 2, 2)), abs=1e-11)
    assert np.max(np.abs(plate.moments(found.state))) < 1e-9 * 1e-6


def test_with_changes_only_what_is_asked():
    plate = dome(2)
    other = plate.with_(bending=2e-4)
    fresh = dome(2, bending=2e-4)
    assert other.space is plate.space
    state = plate.interpolate(cone(0.1))
    assert other.evaluate(state, NONE, 0).energy == fresh.evaluate(state, NONE, 0).energy
    with pytest.raises(InvalidInput, match="thickness"):
        plate.with_(thickness=1.0)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("bending", 0.0, "bending"),
        ("bending", lambda x, y: x, "bending"),
        ("stretching", -1.0, "stretching"),
        ("poisson_ratio", 0.51, "poisson_ratio"),
        ("poisson_ratio", -1.0, "poisson_ratio"),
        ("strain", [1.0, 2.0], "strain"),
        ("strain", [[0.0, 1.0], [0.0, 0.0]], "symmetric"),
        ("strain", lambda x, y: np.full((2, 2, *x.shape), np.nan), "not finite"),
        ("strain", lambda x, y: np.zeros((3, 3, *x.shape)), "shape"),
        ("curvature", lambda x, y: np.full((2, 2, *x.shape), np.inf), "not finite"),
        ("pressure", 1.0, "moves the plate"),
        ("edges", "glued", "glued"),
        ("edges", {"rim": "clamped"}, "rim"),
        ("edges", ("torque",), "torque"),
        ("edges", {lambda x, y: x > 9: "clamped"}, "no edge"),
        ("degree", 1, "degree"),
        ("mesh", skfem.MeshQuad(), "MeshQuad"),
    ],
)
def test_bad_input_is_refused(name, value, words):
    arguments = {
        "mesh": meshes.rectangle(divisions=1),
        "bending": 1e-3,
        "poisson_ratio": 0.3,
        name: value,
    }
    with pytest.raises(InvalidInput, match=words):
        Plate(**arguments)


def test_bad_meshes_are_refused():
    p = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]])
    flat = skfem.MeshTri(np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]]), np.array([[0], [1], [2]]))
    parts = skfem.MeshTri(np.hstack([p[:, :3], p[:, :3] + 5]), np.array([[0, 3], [1, 4], [2, 5]]))
    nan = skfem.MeshTri(np.where(p == 1.0, np.nan, p), np.array([[0, 1], [1, 2], [2, 3]]))
    # Two triangles that only a vertex joins; two on the same side of their edge; a fan of 480 degrees.
    star = np.array([[0.0, 1.0, 0.0, -1.0, 0.0], [0.0, 0.0, 1.0, 0.0, -1.0]])
    hinge = skfem.MeshTri(star, np.array([[0, 0], [1, 3], [2, 4]]))
    fold = skfem.MeshTri(p, np.array([[0, 0], [1, 1], [2, 3]]))
    angle = np.deg2rad(60.0) * np.arange(9)
    fan = np.hstack([np.zeros((2, 1)), [np.cos(angle), np.sin(angle)]])
    spiral = skfem.MeshTri(fan, np.array([np.zeros(8, int), np.arange(1, 9), np.arange(2, 10)]))
    unused = skfem.MeshTri(star, np.array([[0], [1], [4]]))
    for mesh, words in (
        (flat, "degenerate"), (parts, "2 parts"), (nan, "not finite"), (hinge, "along an edge"),
        (fold, "overlap"), (spiral, "overlap"), (unused, "belong to no triangle"),
    ):  # fmt: skip
        for scheme in (Plate, MixedPlate):
            with pytest.raises(InvalidInput, match=words):
                scheme(mesh=mesh, bending=1e-3, poisson_ratio=0.3)


def test_states_of_other_meshes_are_refused():
    with pytest.raises(InvalidInput, match="another mesh"):
        ls.equilibrate(dome(2), dome(3).start())
    with pytest.raises(InvalidInput, match="ndarray; it must be a PlateState"):
        ls.equilibrate(dome(2), np.zeros(dome(2).space.size))
    with pytest.raises(InvalidInput, match="not in the mesh"):
        dome(2).deflection_at([[2.0, 0.0]], dome(2).start())
    with pytest.raises(InvalidInput, match="`points`"):
        dome(2).displacement_at([[np.nan, 0.0]], dome(2).start())
    with pytest.raises(InvalidInput, match="subdivisions"):
        dome(2).surface(dome(2).start(), 0)


@pytest.mark.parametrize(
    ("functions", "words"),
    [
        ((lambda x, y: 1 / np.hypot(x, y), None), "`deflection` is not finite at the node"),
        ((lambda x, y: np.zeros(3), None), r"`deflection` returned an array of shape \(3,\)"),
        ((None, lambda x, y: np.zeros((len(x), 3))), "`displacement` returned"),
        ((0.1, None), "pass a function"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_starts_that_are_no_shapes_are_refused(functions, words):
    for scheme in (Plate, MixedPlate):
        plate = scheme(mesh=meshes.disc(0.5, 1), bending=1e-3, poisson_ratio=0.3)
        with pytest.raises(InvalidInput, match=words):
            plate.interpolate(*functions)


def test_membrane_blocks_are_those_of_generic_forms():
    """The compiled assembly against scikit-fem's forms of the same second variation."""
    nu = 0.4
    mesh = meshes.rectangle(1.0, 0.8, 3, center=(0.1, 0.0))
    plate = Plate(
        mesh=mesh, bending=1e-20, poisson_ratio=nu, strain=[[0.01, 0.005], [0.005, -0.02]]
    )
    state = plate.interpolate(
        lambda x, y: 0.1 * np.cos(2 * x) * np.cos(y),
        lambda x, y: 0.02 * np.stack([x * y, x - y * y], axis=-1),
    )

    def hooke(e):
        return ((1 - nu) * e + nu * eye(trace(e), 2)) / (1 - nu**2)

    def both(a, b):
        product = np.einsum("i...,j...->ij...", a, b)
        return (product + np.swapaxes(product, 0, 1)) / 2

    @skfem.BilinearForm
    def plane(u, v, p):
        return ddot(hooke(sym_grad(u)), sym_grad(v))

    @skfem.BilinearForm
    def mixed(w, v, p):
        return ddot(hooke(both(p["g"], grad(w))), sym_grad(v))

    @skfem.BilinearForm
    def across(w, v, p):
        bent = ddot(hooke(both(p["g"], grad(w))), both(p["g"], grad(v)))
        return bent + ddot(p["stress"], both(grad(w), grad(v)))

    scalar = skfem.Basis(mesh, skfem.ElementTriP2(), intorder=2)
    vector = scalar.with_element(skfem.ElementVector(skfem.ElementTriP2()))
    place, nodes = plate.space.positions, plate.space.nodes
    at = [np.argmin(np.hypot(*(place - x).T)) for x in scalar.doflocs.T]
    g = scalar.interpolate(state.x[2 * nodes + np.array(at)]).grad
    grads = np.array([scalar.interpolate(state.x[i * nodes + np.array(at)]).grad for i in (0, 1)])
    natural = np.array([[0.01, 0.005], [0.005, -0.02]])[:, :, None, None]
    stress = hooke((grads + np.swapaxes(grads, 0, 1)) / 2 + both(g, g) / 2 - natural)
    # Unknowns of the vector basis: components alternate at each node.
    near = np.array([np.argmin(np.hypot(*(place - x).T)) for x in vector.doflocs.T])
    plane_map = near + nodes * (np.arange(vector.N) % 2)
    w_map = 2 * nodes + np.array(at)
    hessian = plate.evaluate(state, NONE, 2).kkt.hessian.tocsr()
    for rows, columns, form in (
        (plane_map, plane_map, plane.assemble(vector)),
        (plane_map, w_map, mixed.assemble(scalar, vector, g=g)),
        (w_map, w_map, across.assemble(scalar, g=g, stress=stress)),
    ):
        ours = hessian[rows][:, columns]
        assert abs(ours - form).max() < 1e-11 * abs(form).max()  # bending is 1e-20


def test_two_equal_layers_are_one_layer():
    curve = SigmoidCurve(saturation=0.05, transition=170.0, width=10.0)
    one = Laminate([Layer(0.03, 2.0, 0.4, strain=curve)])
    two = Laminate([Layer(0.01, 2.0, 0.4, strain=curve), Layer(0.02, 2.0, 0.4, strain=curve)])
    energies = []
    for sheet in (one, two):
        fields = sheet.spontaneous(165.0).fields(Defect())
        plate = Plate(mesh=meshes.disc(0.5, 3), **sheet.moduli(), **fields)
        energies.append(ls.equilibrate(plate, plate.interpolate(cone(0.1))).energy)
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)
    assert energies[0] > 0


@pytest.mark.parametrize("degree", [2, 3])
def test_even_tension_stretches_evenly(degree):
    """A patch test: strains T/C along and -nu T/C across, on free and uneven triangles."""
    mesh = meshes.rectangle(2.0, 1.0, 3, center=(0.3, 0.1))
    pull = 1e-3
    plate = Plate(
        mesh=mesh, bending=1e-2, poisson_ratio=0.3, stretching=2.0, degree=degree,
        traction={"left": (-pull, 0.0), "right": lambda x, y: np.array([pull + 0 * x, 0 * y])},
    )  # fmt: skip
    u = ls.equilibrate(plate).displacement
    gaps = u - u[0], (mesh.p - mesh.p[:, :1]).T
    slope = np.linalg.lstsq(gaps[1], gaps[0], rcond=None)[0]
    sym = 0.5 * (slope + slope.T)
    assert sym == pytest.approx(np.diag([pull / 2, -0.3 * pull / 2]), abs=1e-12)
    assert gaps[0] == pytest.approx(gaps[1] @ slope, abs=1e-12)


def test_a_hanging_sheet_stretches_as_a_rod():
    mesh = meshes.rectangle(divisions=2)
    plate = Plate(
        mesh=mesh, bending=1e-2, poisson_ratio=0.0, stretching=2.0, body_force=(0.0, -1e-3),
        edges={"top": ("displacement", "deflection", "slope")},
    )  # fmt: skip
    found = ls.equilibrate(plate)
    below = 0.5 - mesh.p[1]
    assert found.displacement[:, 1] == pytest.approx(-1e-3 / 2 * (below - below**2 / 2), abs=1e-10)
    assert found.displacement[:, 0] == pytest.approx(0.0, abs=1e-10)


def test_tension_stiffens_a_strip_against_a_load():
    """Supported on two sides, nu = 0: the deflection of a tie rod."""
    b, q, tension = 1e-3, 1e-7, 0.05
    plate = Plate(
        mesh=meshes.rectangle(divisions=5, grading=1.0), bending=b, poisson_ratio=0.0, degree=3, pressure=q,
        edges={"left": ("displacement", "deflection"), "right": ("deflection",)},
        traction={"right": (tension, 0.0)},
    )  # fmt: skip
    k = np.sqrt(tension / b)
    exact = q / tension * (1 / 8 - (1 - 1 / np.cosh(k / 2)) / k**2)
    found = ls.equilibrate(plate)
    assert plate.deflection_at((0.0, 0.0), found.state) == pytest.approx(exact, rel=1e-4)


def test_bad_plane_loads_are_refused():
    mesh = meshes.rectangle(divisions=2)
    for loads in ({"body_force": (1.0, 0.0)}, {"traction": {"right": (1.0, 0.0)}}):
        with pytest.raises(InvalidInput, match="does not balance"):
            Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3, **loads)
    with pytest.raises(InvalidInput, match="a mapping"):
        Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3, traction=(1.0, 0.0))
    with pytest.raises(InvalidInput, match="`traction`"):
        Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3, traction={"right": (np.nan, 0.0)})
    with pytest.raises(InvalidInput, match="`body_force`"):
        Plate(mesh=mesh, bending=1.0, poisson_ratio=0.3, body_force=1.0)


@pytest.mark.parametrize(("divisions", "tolerance"), [(3, 1e-2), (4, 1e-3)])
def test_a_dome_costs_at_most_eight_factorizations(monkeypatch, divisions, tolerance):
    """All that are made: of the tangent on every iterate, and one for a guess of the multipliers."""
    calls = []
    factorize = SparseKKT.factorize

    def counted(self, *args, **kwargs):
        calls.append(self.n)
        return factorize(self, *args, **kwargs)

    monkeypatch.setattr(SparseKKT, "factorize", counted)
    plate = dome(divisions)
    found = ls.equilibrate(plate, plate.interpolate(cone(0.1)))
    assert set(calls) == {plate.size}
    assert len(calls) <= 8
    assert found.energy == pytest.approx(DOME.solve(height=0.1).energy, rel=tolerance)
