"""Rods against LAPACK's band solve, general optimizers, collocation and a dynamic simulation."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from scipy import sparse
from scipy.integrate import simpson, solve_bvp
from scipy.linalg.lapack import dgbsv
from scipy.optimize import NonlinearConstraint, minimize
from scipy.spatial.transform import Rotation, Slerp

import lissome as ls
from lissome import rods
from lissome.references.circles import RingSection, mode_threshold
from lissome.rods.centerline_structure import CenterlineTwist

# A rod of circular section (radius 1/200 of its length, incompressible) that is curved at rest, clamped
# at its start, and pulled sideways at its end: its equilibrium is a curve in space.
LAW = rods.Kirchhoff(bending=(1.0, 1.0), twisting=2.0 / 3.0)
CURVATURE = 1.0
FORCE = np.array([2.0, -3.0, -1.0])
RADIUS = 0.005


def cantilever(segments, share=1.0, law=LAW):
    rod = rods.straight(length=1.0, segments=segments, law=law)
    rod = rod.with_natural(curvature_1=CURVATURE)
    return rod.clamped("start", frame=np.eye(3)).loaded(end=share * FORCE)


def between_clamps(segments):
    """The same rod with both ends clamped, which turns on three constraints."""
    rod = rods.straight(length=1.0, segments=segments, law=LAW).with_natural(curvature_1=CURVATURE)
    turned = Rotation.from_rotvec([0.0, 0.4, 0.0])
    return rod.clamped("start", frame=np.eye(3)).clamped("end", (0.2, 0.1, 0.8), turned)


# -- one iteration, one equilibrium -----------------------------------------------------------------

FLOOR = "LAPACK dgbsv, unknowns of the thesis"
OWN_FLOOR = "LAPACK dgbsv, the rod's own matrix"


def thesis_system(rod, equilibrium):
    """Return the KKT matrix of nodes, twist angles and tensions in LAPACK's storage."""
    twin = CenterlineTwist(rod)
    state = twin.from_rod(equilibrium.state)
    return in_general_storage(twin.evaluate(state, np.zeros(twin.constraints_count), 2).kkt)


def own_system(equilibrium):
    """Return the band of the rod's own matrix in LAPACK's storage, without its border."""
    return in_general_storage(equilibrium.evaluation.kkt)


def in_general_storage(kkt):
    """Return the band of a KKT matrix for LAPACK's general solver, its width and a right side."""
    band = kkt.band
    columns, width = band.shape[0], band.shape[1] - 1
    matrix = np.zeros((3 * width + 1, columns), order="F")
    matrix[2 * width] = band[:, 0]
    for k in range(1, width + 1):
        matrix[2 * width + k, : columns - k] = band[: columns - k, k]
        matrix[2 * width - k, k:] = band[: columns - k, k]
    return matrix, width, np.ones(columns)


def solve(matrix, width, rhs):
    _, _, step, info = dgbsv(width, width, matrix, rhs)
    assert info == 0
    return step


class Newton:
    """Newton iterations at a state, one like the other."""

    def __init__(self, rod):
        self.rod = rod
        found = ls.equilibrate(rod)
        self.state, self.multipliers = found.state, found.multipliers

    def step(self):
        rod, state = self.rod, self.state
        here = rod.evaluate(state, self.multipliers, 2)
        factor = here.kkt.factorize(0.0, rod.gauge(state), rod.metric(state))
        dx, dm = factor.solve(-here.gradient, -here.constraints)
        return rod.retract(state, dx), self.multipliers + dm

    def steps(self, count):
        for _ in range(count):
            self.step()


ONE = "a Newton iteration of a rod, N = 400"


def test_floor_of_an_iteration(benchmark, measure):
    rod = cantilever(400)
    matrix, width, rhs = thesis_system(rod, ls.equilibrate(rod))
    note = f"{rhs.size} unknowns and multipliers, {width} diagonals on either side"
    measure(FLOOR, group=ONE, note=note)
    benchmark.pedantic(solve, (matrix, width, rhs), rounds=200, warmup_rounds=3)


def test_own_floor_of_an_iteration(benchmark, measure):
    matrix, width, rhs = own_system(ls.equilibrate(cantilever(400)))
    note = f"{rhs.size} unknowns, {width} diagonals on either side: turns of the segments"
    measure(OWN_FLOOR, group=ONE, note=note)
    benchmark.pedantic(solve, (matrix, width, rhs), rounds=200, warmup_rounds=3)


@pytest.mark.parametrize(
    ("name", "make"), [("clamped and free", cantilever), ("clamped at both ends", between_clamps)]
)
def test_iteration(benchmark, measure, name, make):
    measure(f"an iteration, {name}", group=ONE, against=FLOOR, at_most=1.0,
            note="energy, gradient, matrix, factors with inertia, step, new frames")  # fmt: skip
    benchmark.pedantic(Newton(make(400)).step, rounds=200, warmup_rounds=3)


def test_iteration_against_its_own_matrix(benchmark, measure):
    measure("the same iteration, clamped and free", group=ONE, against=OWN_FLOOR,
            note="told, not judged: LAPACK neither makes the matrix nor tells its inertia")  # fmt: skip
    benchmark.pedantic(Newton(cantilever(400)).step, rounds=200, warmup_rounds=3)


WHOLE = "an equilibrium of a cantilever in space, N = 100"


def test_floor_of_an_equilibrium(benchmark, measure):
    rod = cantilever(100)
    measure(FLOOR, group=WHOLE)
    system = thesis_system(rod, ls.equilibrate(rod))
    benchmark.pedantic(solve, system, rounds=500, warmup_rounds=3)


def test_warm_equilibrium(benchmark, measure):
    rod, neighbor = cantilever(100), ls.equilibrate(cantilever(100, share=0.95))
    measure("warm: after 95 % of the load", group=WHOLE, against=FLOOR, at_most=12.0,
            note="`equilibrate`, balance and stability checked")  # fmt: skip
    found = benchmark.pedantic(ls.equilibrate, (rod, neighbor), rounds=200, warmup_rounds=3)
    assert found.stable
    assert found.residual < 1e-12


def test_cold_equilibrium(benchmark, measure):
    rod = cantilever(100)
    straight = rods.straight(length=1.0, segments=100, law=LAW).initial
    measure("cold: from a straight rod", group=WHOLE, against=FLOOR, at_most=60.0)
    found = benchmark.pedantic(ls.equilibrate, (rod, straight), rounds=100, warmup_rounds=3)
    assert found.stable
    assert found.residual < 1e-12


# -- general optimizers -------------------------------------------------------------------------------

STEP = "from 95 % to 100 % of the load, N = 100"
ENOUGH = 1e-6  # of the energy above that of the equilibrium, where an optimizer may stop


class Reached(Exception):
    """The energy is near enough."""


class Optimization:
    """The discrete rod in the unknowns of the thesis, as SciPy's optimizers want it.

    Energy, constraints and their derivatives are the compiled ones of the library.
    """

    def __init__(self):
        rod = cantilever(100)
        self.twin = CenterlineTwist(rod)
        self.start = self.twin.from_rod(ls.equilibrate(cantilever(100, share=0.95)).state)
        self.goal = ls.equilibrate(rod)
        self.zero = np.zeros(self.twin.constraints_count)
        self.x0 = np.zeros(self.twin.size)
        self.known = None

    def state(self, x):
        return self.twin.retract(self.start, x)

    def at(self, x, order=1, multipliers=None):
        key = (x.tobytes(), order, None if multipliers is None else multipliers.tobytes())
        if self.known is None or self.known[0] != key:
            multipliers = self.zero if multipliers is None else multipliers
            self.known = key, self.twin.evaluate(self.state(x), multipliers, order)
        return self.known[1]

    def energy(self, x):
        return self.at(x).energy

    def gradient(self, x):
        return self.at(x).gradient

    def constraints(self, x):
        return self.at(x).constraints

    def matrices(self, x, multipliers=None):
        """Return the Hessian of the Lagrangian and the Jacobian of the constraints."""
        kkt = self.at(x, 2, multipliers).kkt
        size, width = kkt.band.shape[0], kkt.band.shape[1] - 1
        diagonals = [kkt.band[: size - k, k] for k in range(width + 1)]
        lower = sparse.diags_array(diagonals, offsets=[-k for k in range(width + 1)])
        whole = (lower + sparse.tril(lower, -1).T).tocsr()
        unknowns, rows = kkt.layout.unknowns, kkt.layout.constraints
        return sparse.csr_matrix(whole[unknowns][:, unknowns]), sparse.csr_matrix(
            whole[rows][:, unknowns]
        )

    def hessian(self, x):
        return self.matrices(x)[0]

    def jacobian(self, x):
        return self.matrices(x)[1]

    def curvature(self, x, multipliers):
        return self.matrices(x, multipliers)[0] - self.matrices(x)[0]

    def watch(self, x, *_):
        here = self.at(np.asarray(x))
        if np.abs(here.constraints).max() < 1e-8 and here.energy < self.goal.energy + ENOUGH:
            self.best = np.array(x)
            raise Reached

    def reached(self):
        gap = np.abs(self.state(self.best).positions - self.goal.positions).max()
        assert gap < 1e-2
        return gap

    def slsqp(self):
        rule = {"type": "eq", "fun": self.constraints, "jac": lambda x: self.jacobian(x).toarray()}
        with pytest.raises(Reached):
            minimize(self.energy, self.x0, jac=self.gradient, method="SLSQP", constraints=rule,
                     callback=self.watch, options={"ftol": 1e-16, "maxiter": 1000})  # fmt: skip

    def trust_region(self):
        rule = NonlinearConstraint(self.constraints, 0, 0, jac=self.jacobian, hess=self.curvature)
        with pytest.raises(Reached):
            minimize(self.energy, self.x0, jac=self.gradient, hess=self.hessian,
                     method="trust-constr", constraints=[rule], callback=self.watch,
                     options={"gtol": 1e-12, "xtol": 1e-14, "maxiter": 1000})  # fmt: skip


SLSQP = "SciPy SLSQP, with gradients"
TRUST = "SciPy trust-constr, with gradient and Hessian"


@pytest.mark.parametrize("name", [SLSQP, TRUST])
def test_optimizers(benchmark, measure, name):
    problem = Optimization()
    note = (
        "nodes, twist angles and lengths of segments; stopped where the energy is reached to 1e-6"
    )
    measure(name, group=STEP, note=note)
    benchmark.pedantic(problem.slsqp if name == SLSQP else problem.trust_region, rounds=1)
    problem.reached()


@pytest.mark.parametrize(("name", "peer", "bound"), [("once more", SLSQP, None), ("", TRUST, 50)])
def test_against_optimizers(benchmark, measure, name, peer, bound):
    rod, neighbor = cantilever(100), ls.equilibrate(cantilever(100, share=0.95))
    what = f"lissome, {name}" if name else "lissome"
    measure(what, group=STEP, against=peer, at_least=bound, note="to rounding errors")
    benchmark.pedantic(ls.equilibrate, (rod, neighbor), rounds=100, warmup_rounds=3)


# -- collocation and dynamics -------------------------------------------------------------------------

REST = "from straight to rest, N = 100"
PEER = "PyElastica, damped to 1e-4 of rest"


def turned(q, v):
    """Return vectors (3, k) turned by unit quaternions (4, k)."""
    twice = 2.0 * np.cross(q[1:], v, axis=0)
    return v + q[0] * twice + np.cross(q[1:], twice, axis=0)


def continuum(tolerance):
    """Solve the continuous problem by collocation: frames as quaternions, and the moment."""
    stiffness = np.array([1.0, 1.0, 2.0 / 3.0])[:, None]
    natural = np.array([CURVATURE, 0.0, 0.0])[:, None]
    along, load = np.array([[0.0], [0.0], [1.0]]), FORCE[:, None]

    def slopes(s, y):
        q, moment = y[:4], y[4:]
        back = q * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
        k = turned(back, moment) / stiffness + natural
        turn = np.vstack([-np.sum(q[1:] * k, axis=0), q[0] * k + np.cross(q[1:], k, axis=0)])
        tangent = turned(q, np.broadcast_to(along, k.shape))
        return np.vstack([0.5 * turn, -np.cross(tangent, np.broadcast_to(load, k.shape), axis=0)])

    def ends(a, b):
        return np.concatenate([a[:4] - [1.0, 0.0, 0.0, 0.0], b[4:]])

    s = np.linspace(0.0, 1.0, 21)
    guess = np.zeros((7, s.size))
    guess[0] = 1.0
    found = solve_bvp(slopes, ends, s, guess, tol=tolerance, max_nodes=100_000)
    assert found.success
    return found


def exact_tip():
    s = np.linspace(0.0, 1.0, 4001)
    tangent = turned(continuum(1e-9).sol(s)[:4], np.tile([[0.0], [0.0], [1.0]], (1, s.size)))
    return simpson(tangent, x=s, axis=1)


class Dynamics:
    """The same rod in PyElastica, under the load from the first instant, damped.

    Mass 1 per length, so that the slowest frequency is of order 3.5; the damping is near the one that
    brings it to rest soonest, and the time step the longest (within a fifth) that is stable.
    """

    SEGMENTS, STEP, DAMPING = 100, 1.5e-5, 10.0

    def __init__(self):
        self.elastica = pytest.importorskip("elastica", reason="install the extra `bench`")

    def simulation(self):
        ea = self.elastica

        class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
            pass

        n, section = self.SEGMENTS, math.pi * RADIUS**2
        stiffness = 4.0 / (math.pi * RADIUS**4)
        natural = np.zeros((3, n - 1))
        natural[0] = CURVATURE
        rod = ea.CosseratRod.straight_rod(
            n, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), 1.0, RADIUS,
            1.0 / section, youngs_modulus=stiffness, shear_modulus=stiffness / 3.0,
            rest_kappa=natural,
        )  # fmt: skip
        whole = Simulator()
        whole.append(rod)
        whole.constrain(rod).using(
            ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        whole.add_forcing_to(rod).using(ea.EndpointForces, np.zeros(3), FORCE, ramp_up_time=1e-12)
        whole.dampen(rod).using(
            ea.AnalyticalLinearDamper, uniform_damping_constant=self.DAMPING, time_step=self.STEP
        )
        whole.finalize()
        return whole, rod

    def run(self, steps, every=0):
        whole, rod = self.simulation()
        stepper, now, shapes = self.elastica.PositionVerlet(), np.float64(0.0), []
        for number in range(1, steps + 1):
            now = stepper.step(whole, now, np.float64(self.STEP))
            if every and number % every == 0:
                shapes.append((number, rod.position_collection.copy()))
        return shapes if every else rod.position_collection.copy()

    def steps_to_rest(self):
        """Return the number of steps after which no node is farther from rest than 1e-4, and the rest."""
        shapes = self.run(round(4.5 / self.STEP), every=2000)
        rest = shapes[-1][1]
        late = max(n for n, shape in shapes if np.abs(shape - rest).max() > 1e-4)
        assert late < 0.8 * shapes[-1][0]  # it rests at the end
        return late + 2000, rest


def test_dynamics(benchmark, measure):
    dynamics = Dynamics()
    steps, rest = dynamics.steps_to_rest()
    error = np.linalg.norm(rest[:, -1] - exact_tip())
    measure(PEER, group=REST, note=f"{steps} time steps, their number known beforehand; error of the "
            f"tip at rest {error:.1e} of the length")  # fmt: skip
    benchmark.pedantic(dynamics.run, (steps,), rounds=1)
    ours = np.linalg.norm(ls.equilibrate(cantilever(100)).positions[-1] - exact_tip())
    assert ours < 0.1 * error


def test_collocation(benchmark, measure):
    measure("SciPy solve_bvp, the continuous rod, tolerance 1e-4", group=REST)
    found = benchmark.pedantic(continuum, (1e-4,), rounds=10, warmup_rounds=1)
    s = np.linspace(0.0, 1.0, 4001)
    tip = simpson(
        turned(found.sol(s)[:4], np.tile([[0.0], [0.0], [1.0]], (1, s.size))), x=s, axis=1
    )
    error = np.linalg.norm(tip - exact_tip())
    benchmark.extra_info["note"] = (
        f"{found.x.size} nodes, error of the tip {error:.1e}; stability unknown"
    )


@pytest.mark.parametrize(
    ("name", "peer", "bound"),
    [("", PEER, 500),
     ("once more", "SciPy solve_bvp, the continuous rod, tolerance 1e-4", None)],
)  # fmt: skip
def test_against_others(benchmark, measure, name, peer, bound):
    if peer == PEER:
        pytest.importorskip("elastica", reason="install the extra `bench`")
    measure(f"lissome, {name}" if name else "lissome", group=REST, against=peer, at_least=bound)
    rod = cantilever(100)
    straight = rods.straight(length=1.0, segments=100, law=LAW).initial
    found = benchmark.pedantic(ls.equilibrate, (rod, straight), rounds=100, warmup_rounds=3)
    error = np.linalg.norm(found.positions[-1] - exact_tip())
    benchmark.extra_info["note"] = f"error of the tip {error:.1e}; stable"


# -- long rods ----------------------------------------------------------------------------------------

LONG = "100 000 segments, one Newton iteration each"
MANY = "100 iterations at N = 1000"


def memory(segments):
    """Return the peak of the memory that an iteration takes, bytes."""
    newton = Newton(cantilever(segments, share=0.1))
    tracemalloc.start()
    newton.step()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_many_short_iterations(benchmark, measure):
    measure(MANY, group=LONG)
    newton = Newton(cantilever(1000, share=0.1))
    benchmark.pedantic(newton.steps, (100,), rounds=5, warmup_rounds=1)


def test_one_long_iteration(benchmark, measure):
    newton = Newton.__new__(Newton)
    newton.rod = cantilever(100_000, share=0.1)
    newton.state, newton.multipliers = newton.rod.start(), np.zeros(0)
    few, many = memory(1000), memory(10_000)
    assert many < 11 * few
    measure("1 iteration at N = 100 000", group=LONG, against=MANY, at_most=2.0,
            note=f"memory of an iteration {few / 1e3:.0f} bytes per segment at N = 1000, "
            f"{many / 1e4:.0f} at N = 10 000")  # fmt: skip
    benchmark.pedantic(newton.step, rounds=5, warmup_rounds=1)


def refined(equilibrium, rod):
    """Return the start of a finer rod: the frames between those of a coarser one."""
    frames = equilibrium.frames
    coarse = equilibrium.structure.lengths
    middle = np.cumsum(coarse) - 0.5 * coarse
    fine = np.cumsum(rod.lengths) - 0.5 * rod.lengths
    turn = Slerp(middle, frames)(np.clip(fine, middle[0], middle[-1]))
    return rods.RodState(turn.as_quat(scalar_first=True), equilibrium.state.origin)


def test_fine_rod_from_a_coarse_one(benchmark, measure):
    rod, coarse = cantilever(10_000), ls.equilibrate(cantilever(1000))
    start = refined(coarse, rod)
    measure("N = 10 000 from the frames of N = 1000, interpolated", group="a fine rod")
    found = benchmark.pedantic(ls.equilibrate, (rod, start), rounds=3, warmup_rounds=1)
    corrector = rod.correct(start, np.zeros(0), 1e-9)
    count = found.iterations + (0 if corrector is None else corrector.iterations)
    benchmark.extra_info["note"] = f"{count} iterations, residual {found.residual:.0e}, stable"
    assert found.stable
    assert count <= 10
    assert found.residual < 1e-13
    gap = np.abs(found.positions[::10] - coarse.positions).max()
    assert gap < 1e-5  # what 1000 segments miss


# -- branches and laws --------------------------------------------------------------------------------


def test_ring_branch(benchmark, measure):
    """The over-curved ring: circle, the branch that folds, and the circle run through three times."""
    section = RingSection.rectangle(5.0, 2.0, 0.41, torsion_constant=0.256)
    unit = section.out_of_plane
    law = rods.Kirchhoff((section.in_plane / unit, 1.0), section.torsion / unit)
    ring = rods.ring(2.0 * math.pi, 400, law)
    first, last = mode_threshold(section, 1, 2), mode_threshold(section, 3, 2)

    def branch():
        before = ls.follow(ring.with_overcurvature, 1.0, 1.3, on_fold="stop", max_step=0.06)
        loss = before.events[-1]
        folding = before.switch(loss, bounds=(1.0, last - 0.003), max_step=0.08)
        tripled = ls.follow(
            ring.with_overcurvature,
            last + 0.01,
            3.0,
            initial=folding.equilibria[-1].state,
            max_step=0.05,
        )
        return before, loss, folding, tripled

    measure("equilibria with eigenvalues, and the loss of stability", within=1.0,
            group="the branch of an over-curved ring, N = 400")  # fmt: skip
    before, loss, folding, tripled = benchmark.pedantic(branch, rounds=3, warmup_rounds=1)
    count = len(before) + len(folding) + len(tripled)
    benchmark.extra_info["note"] = (
        f"{count} equilibria: circle, folding ring, circle of three turns"
    )
    assert count >= 45
    assert abs(loss.parameter - first) < 1e-3


NUMPY = "an equilibrium after 95 % of the load, N = 400"


def by_hand(k):
    """Return energy, stress and stiffness of the rod's law: what a user would write."""
    moduli = np.array([1.0, 1.0, 2.0 / 3.0])
    stress = moduli * k
    return (
        0.5 * np.sum(stress * k, axis=1),
        stress,
        np.broadcast_to(np.diag(moduli), (len(k), 3, 3)),
    )


@pytest.mark.parametrize("kind", ["built in", "one numpy function"])
def test_laws(benchmark, measure, kind):
    law = LAW
    bound = {}
    if kind != "built in":
        law = rods.FunctionLaw(by_hand, strains=("curvature_1", "curvature_2", "twist"))
        bound = {"against": "law built in", "at_most": 3.0}
    measure(f"law {kind}", group=NUMPY, **bound)
    neighbor = ls.equilibrate(cantilever(400, 0.95, law))
    rod = cantilever(400, 1.0, law)
    found = benchmark.pedantic(ls.equilibrate, (rod, neighbor), rounds=100, warmup_rounds=3)
    assert found.stable


# -- the first call -----------------------------------------------------------------------------------

FIRST = """
import numpy as np, lissome as ls
from lissome import rods
law = rods.Kirchhoff(bending=(1.0, 1.0), twisting=0.7)
rod = rods.straight(length=1.0, segments=100, law=law).clamped("start").loaded(end=(2.0, -3.0, -1.0))
assert ls.equilibrate(rod).stable
"""


@pytest.mark.parametrize("cache", ["empty", "filled"])
def test_first_call(benchmark, measure, tmp_path, cache):
    environment = os.environ | {"LISSOME_CACHE": str(tmp_path)}

    def call():
        subprocess.run([sys.executable, "-c", FIRST], check=True, env=environment)

    if cache == "filled":
        call()
    measure(f"cache of compiled functions {cache}", within=20.0 if cache == "empty" else None,
            group="import and first equilibrium in a new process, N = 100")  # fmt: skip
    benchmark.pedantic(call, rounds=1 if cache == "empty" else 3)
