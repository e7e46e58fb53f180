"""The mixed augmented-Lagrangian scheme: what its robust form gives, and how the literal one fails."""

import numpy as np
import pytest
import skfem

import lissome as ls
from lissome.errors import InvalidInput
from lissome.plates import MixedPlate, Plate, PlateState, meshes, projected_bending
from lissome.references.disc import AxisymmetricDisc

DOME = AxisymmetricDisc(bending=1e-4, poisson_ratio=0.5, radius=0.5, strain=(0.01, -0.02))


def hoops(x, y):
    """Radial strain 0.01, azimuthal -0.02."""
    out = np.array([[x * x, x * y], [x * y, y * y]]) / (x * x + y * y)
    return 0.03 * out - 0.02 * np.eye(2).reshape(2, 2, *np.ones(np.ndim(x), int))


def dome(divisions, **changes):
    arguments = {"bending": 1e-4, "poisson_ratio": 0.5, "strain": hoops}
    plate = MixedPlate(mesh=meshes.disc(0.5, divisions), **{**arguments, **changes})
    return plate, plate.interpolate(lambda x, y: 0.1 * (1 - 2 * np.hypot(x, y)))


@pytest.mark.parametrize("form", ["robust", "literal"])
@pytest.mark.parametrize("orders", [(2, 1), (2, 2)])
def test_derivatives_are_those_of_the_lagrangian(form, orders):
    plate = MixedPlate(
        mesh=meshes.rectangle(1.3, 0.9, 2, center=(0.1, 0.05)), form=form, orders=orders,
        bending=lambda x, y: 1e-3 * (1.5 + np.sin(3 * x)), poisson_ratio=lambda x, y: 0.3 + 0.1 * y,
        stretching=lambda x, y: 1 + 0.2 * x, strain=lambda x, y: np.array([[x, y], [y, 0.1 + x * y]]),
        curvature=[[0.3, 0.1], [0.1, -0.2]], pressure=lambda x, y: 1e-3 * x,
        edges={lambda x, y: x < -0.6: "clamped", lambda x, y: y > 0.4: ("deflection",)},
    )  # fmt: skip
    rng = np.random.default_rng(3)
    state = plate.adopt(PlateState(0.1 * rng.standard_normal(plate.start().x.size)))
    multipliers = rng.standard_normal(plate.constraints_count)
    dx = rng.standard_normal(plate.size)
    h = 1e-4

    def at(step, order=1):
        return plate.evaluate(plate.retract(state, step * dx), multipliers, order)

    def lagrangian(step):
        value = at(step, 0)
        return value.energy + multipliers @ value.constraints

    here = at(0.0, 2)
    slope = 8 * (lagrangian(h) - lagrangian(-h)) - (lagrangian(2 * h) - lagrangian(-2 * h))
    assert slope / (12 * h) == pytest.approx(here.gradient @ dx, rel=1e-8)
    bend = 8 * (at(h).gradient - at(-h).gradient) - (at(2 * h).gradient - at(-2 * h).gradient)
    exact, moved = here.kkt.apply(dx, np.zeros(plate.constraints_count))
    assert np.max(np.abs(bend / (12 * h) - exact)) < 1e-9 * np.max(np.abs(exact))
    assert (at(1.0).constraints - here.constraints) == pytest.approx(moved, abs=1e-12)


@pytest.mark.parametrize(
    ("form", "mesh", "exact"),
    [("robust", meshes.rectangle(divisions=2), 4), ("literal", meshes.rectangle(divisions=2), 6),
     ("literal", meshes.disc(0.5, 3), 4)],
)  # fmt: skip
def test_rigid_motions(form, mesh, exact):
    plate = MixedPlate(mesh=mesh, bending=1e-4, poisson_ratio=0.5, strain=hoops, form=form)
    state = plate.interpolate(lambda x, y: 0.1 * (1 - 2 * np.hypot(x, y)))
    state = PlateState(state.x + 0.01 * np.random.default_rng(2).standard_normal(state.x.size))
    gauge = plate.gauge(state)
    here = plate.evaluate(state, np.zeros(plate.constraints_count), 2)
    assert len(gauge) == exact
    assert np.max(np.abs(gauge @ here.gradient)) < 1e-12 * np.linalg.norm(here.gradient)
    # The two tilts are held by their mean instead.
    nodes = plate.mesh.nvertices
    assert plate.constraints_count == 2 * nodes + 6 - exact


@pytest.mark.parametrize(("orders", "least"), [((2, 1), 1.7), ((2, 2), 2.3)])
def test_robust_dome_converges_to_collocation(orders, least):
    exact = DOME.solve(height=0.1)
    errors = []
    for divisions in (3, 6):
        plate, start = dome(divisions, orders=orders)
        found = ls.equilibrate(plate, start)
        assert found.iterations <= 8
        assert found.inertia == (plate.size, plate.constraints_count + 4, 0)
        errors.append(abs(found.energy / exact.energy - 1))
    assert np.log2(errors[0] / errors[1]) > least


@pytest.mark.parametrize("penalty", [1.0, 10.0])
def test_literal_form_has_spurious_equilibria(penalty):
    """Newton's method goes from the robust dome to a state with negative pivots that no dome has."""
    plate, start = dome(4, penalty=penalty)
    robust = ls.equilibrate(plate, start)
    assert robust.index == 0
    literal = dome(4, penalty=penalty, form="literal")[0]
    found = ls.equilibrate(literal, robust.state, require="any")
    assert found.energy == pytest.approx(robust.energy, rel=0.05)  # looks like the dome
    assert found.index > 0
    # What a descent finds instead has too little energy: deflections relax stresses for nothing.
    lower = ls.equilibrate(literal, found.state)
    assert lower.energy < 0.97 * DOME.solve(height=0.1).energy < robust.energy


def test_a_deflection_that_projected_slopes_do_not_see():
    """On a mesh of one diagonal the clamped plate has a checkerboard that costs no bending."""
    mesh = skfem.MeshTri().refined(3)
    plate = MixedPlate(mesh=mesh, bending=1.0, poisson_ratio=0.3, edges="clamped")
    values, modes = projected_bending(plate, 2)
    assert abs(values[0]) < 1e-9
    assert values[1] > 1.0
    mode = modes[0] / np.max(np.abs(modes[0]))
    assert np.max(np.abs(plate._projected(mode))) < 1e-10
    # The exact plate has no softer deflection than in buckling: 52.34 D/L^2.
    assert values[1] < 0.5 * 52.34 / (1 - 0.3**2)


def test_free_plates_have_no_such_deflection_but_too_many_soft_ones():
    counts = []
    for orders in ((2, 1), (2, 2)):
        mesh = skfem.MeshTri.init_sqsymmetric().refined(2)
        plate = MixedPlate(mesh=mesh, bending=1.0, poisson_ratio=0.3, orders=orders)
        values, _ = projected_bending(plate, 80)
        assert np.max(np.abs(values[:2])) < 1e-9  # two tilts
        assert values[2] == pytest.approx(8.02, abs=0.03)
        counts.append(int(np.count_nonzero(values < 200)))
    assert counts[0] > 1.3 * counts[1]


def test_a_large_penalty_locks():
    errors = []
    exact = DOME.solve(height=0.1).energy
    for penalty in (10.0, 1000.0):
        plate, start = dome(4, penalty=penalty)
        errors.append(ls.equilibrate(plate, start).energy / exact - 1)
    assert errors[1] > 4 * errors[0] > 0


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("penalty", 0.0, "penalty"),
        ("penalty", 1e-3, "not held"),
        ("penalty", 1e5, "lock"),
        ("form", "printed", "form"),
        ("orders", (1, 1), "orders"),
        ("orders", 2, "orders"),
        ("bending", -1.0, "bending"),
        ("pressure", 1.0, "moves the plate"),
        ("edges", ("slope",), "slope"),
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
        MixedPlate(**arguments)


def test_literal_form_takes_any_positive_penalty():
    assert dome(2, form="literal", penalty=1e6)[0].penalty == 1e6


def loaded(scheme, mesh, **changes):
    """A square under loads in and across its plane, nothing uniform, in a state with large slopes."""
    return scheme(
        mesh=mesh, bending=lambda x, y: 1e-3 * (1.5 + x), poisson_ratio=0.3,
        stretching=lambda x, y: 1 + 0.5 * y, strain=[[0.02, 0.01], [0.01, -0.03]],
        curvature=[[0.1, 0.05], [0.05, -0.2]], pressure=lambda x, y: 2e-3 * (1 + x),
        body_force=lambda x, y: 0.02 * np.stack([1 + 0 * x, x]),
        traction={"top": (0.003, 0.01), "right": lambda x, y: 0.01 * np.stack([y, 0 * y])},
        edges={"left": "clamped", "bottom": "simply supported"}, **changes,
    )  # fmt: skip


def test_both_schemes_agree_under_refinement():
    """Deflections, displacements, moments, membrane forces and energies, with loads in the plane."""
    at = np.random.default_rng(7).uniform(-0.48, 0.48, (40, 2))

    def facts(scheme, divisions, **more):
        plate = loaded(scheme, meshes.rectangle(divisions=divisions, grading=1.0), **more)
        found = ls.equilibrate(plate)
        assert sum(plate.energies(found.state)) == pytest.approx(found.energy, rel=1e-11)
        return {
            "deflection": plate.deflection_at(at, found.state),
            "displacement": plate.displacement_at(at, found.state),
            "forces": plate.membrane_forces_at(at, found.state),
            "moments": plate.moments_at(at, found.state),
            "curvature": plate.curvature_at(at, found.state),
            "energies": np.array([found.stretching_energy, found.bending_energy, found.energy]),
        }

    exact = facts(Plate, 5, degree=3)
    gaps = []
    for divisions in (2, 6):
        mixed = facts(MixedPlate, divisions, orders=(2, 2))
        gaps.append([
            np.linalg.norm(mixed[name] - exact[name]) / np.linalg.norm(exact[name]) for name in exact
        ])  # fmt: skip
    coarse, fine = np.array(gaps)
    # Curvatures are one order behind the deflection, and singular at the corners of the supports.
    assert np.all(fine[[0, 1, 5]] < 5e-3)
    assert np.all(fine[2:5] < 0.1)
    assert np.all(np.log(coarse / fine) / np.log(3) > 0.75)
    assert np.all(np.log(coarse / fine)[[0, 1, 2, 5]] / np.log(3) > 1.75)


@pytest.mark.parametrize("orders", [(2, 1), (2, 2)])
def test_even_tension_stretches_evenly(orders):
    """The patch test of loads on free edges: T/C along, -nu T/C across; a tilt is about the pull."""
    mesh = meshes.rectangle(2.0, 1.0, 2, center=(0.3, 0.1))
    plate = MixedPlate(
        mesh=mesh, bending=1e-2, poisson_ratio=0.3, stretching=2.0, orders=orders,
        traction={"left": (-1e-3, 0.0), "right": (1e-3, 0.0)},
    )  # fmt: skip
    found = ls.equilibrate(plate)
    forces = plate.membrane_forces(found.state)
    assert forces == pytest.approx(np.broadcast_to(np.diag([1e-3, 0.0]), forces.shape), abs=1e-12)
    u = found.displacement
    gap, place = u - u[0], (mesh.p - mesh.p[:, :1]).T
    slope = np.linalg.lstsq(place, gap, rcond=None)[0]
    assert 0.5 * (slope + slope.T) == pytest.approx(np.diag([5e-4, -1.5e-4]), abs=1e-12)


def test_shapes_and_forces_have_the_same_names():
    """What the public methods of one scheme are called, those of the other are."""
    public = [
        {name for name in dir(scheme) if not name.startswith("_")} for scheme in (Plate, MixedPlate)
    ]
    own = {"degree", "penalty", "form", "orders", "slope_scale"}
    assert public[0] - own == public[1] - own


def test_mirrored_and_surface_of_the_mixed_scheme():
    plate, start = dome(2)
    found = ls.equilibrate(plate, start)
    turned = plate.evaluate(plate.mirrored(found.state), np.zeros(plate.constraints_count), 0)
    assert turned.energy == pytest.approx(found.energy, rel=1e-12)
    points, triangles = plate.surface(found.state, 3)
    assert triangles.shape == (9 * plate.mesh.t.shape[1], 3)
    height = plate.deflection_at([0.0, 0.0], found.state)
    at = np.argmin(np.hypot(*(points[:, :2] - found.displacement[0]).T))
    assert points[at, 2] == pytest.approx(height, abs=1e-12)


def test_the_force_of_a_curvature_is_the_change_of_the_gradient():
    plate, start = dome(2)
    natural = [[0.1, 0.02], [0.02, -0.3]]
    none = np.zeros(plate.constraints_count)
    bent = plate.with_(curvature=natural)
    change = bent.evaluate(start, none, 1).gradient - plate.evaluate(start, none, 1).gradient
    assert plate.force_of(natural) == pytest.approx(-change, abs=1e-15)
