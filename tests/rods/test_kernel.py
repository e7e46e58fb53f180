"""The compiled passes against SymPy, and against differences of the energy."""

import numpy as np
import pytest
import sympy as sp

from lissome.rods import FunctionLaw, Kirchhoff, Rod, RodState
from lissome.rods import _kernel as kernel
from lissome.rods.quaternions import exponential, multiply

SEGMENTS = 7


def product(p, q):
    s, v = p[0], sp.Matrix(p[1:])
    t, w = q[0], sp.Matrix(q[1:])
    return [s * t - v.dot(w), *(s * w + t * v + v.cross(w))]


def exponential_to_second_order(v):
    square = sum(c**2 for c in v)
    return [1 - square / 8, *(c / 2 for c in v)]


def test_first_and_second_variation_of_the_strain_by_sympy():
    """Expand 2 vec(exp(-a/2) q exp(b/2)) and compare with the blocks of the module."""
    s, h = sp.symbols("s h")
    v, a, b, m = (sp.Matrix(sp.symbols(f"{name}:3")) for name in "vabm")
    q = product(
        product(exponential_to_second_order([-h * c for c in a]), [s, *v]),
        exponential_to_second_order([h * c for c in b]),
    )
    kappa = 2 * sp.Matrix(q[1:])
    first = kappa.diff(h).subs(h, 0)
    x = s * sp.eye(3) + v.hat()
    assert sp.simplify(first - (x * b - x.T * a)) == sp.zeros(3, 1)
    second = m.dot(kappa.diff(h, 2).subs(h, 0))
    same = -m.dot(v) / 2 * sp.eye(3)
    mixed = (s * m.hat() + v * m.T + m * v.T - m.dot(v) * sp.eye(3)) / 2
    blocks = (a.T * same * a + b.T * same * b + 2 * a.T * mixed * b)[0]
    assert sp.expand(second - blocks) == 0


def coupled_energy(k):
    """Energy density of bending, twist and stretch, all coupled, and not quadratic."""
    a = np.array(
        [
            [1.0, 0.1, 0.2, 0.7],
            [0.1, 2.0, -0.1, -0.4],
            [0.2, -0.1, 1.5, 2.0],
            [0.7, -0.4, 2.0, 30.0],
        ]
    )
    stress = k @ a
    energy = 0.5 * np.sum(stress * k, axis=1) + 0.3 * k[:, 3] ** 2 * k[:, 2] ** 2
    stress[:, 2] += 0.6 * k[:, 3] ** 2 * k[:, 2]
    stress[:, 3] += 0.6 * k[:, 3] * k[:, 2] ** 2
    stiffness = np.tile(a, (len(k), 1, 1))
    stiffness[:, 2, 2] += 0.6 * k[:, 3] ** 2
    stiffness[:, 3, 3] += 0.6 * k[:, 2] ** 2
    stiffness[:, 2, 3] += 1.2 * k[:, 3] * k[:, 2]
    stiffness[:, 3, 2] = stiffness[:, 2, 3]
    return energy, stress, stiffness


FOUR = ("curvature_1", "curvature_2", "twist", "stretch")


def rods():
    rng = np.random.default_rng(1)
    lengths = 0.1 + 0.3 * rng.random(SEGMENTS)
    natural = rng.normal(size=(SEGMENTS + 1, 3))
    law = Kirchhoff((1.0, 2.0), 1.5)
    turned = exponential([0.3, 0.2, 0.1])
    open_rod = Rod(law, lengths, natural)
    soft = Rod(law, lengths, natural, stretching=30.0)
    ring = Rod(law, lengths, natural, closed=True, joint=0.7)
    coupled = FunctionLaw(coupled_energy, strains=FOUR)
    cord = Rod(coupled, lengths, natural)
    cord_ring = Rod(coupled, lengths, natural, closed=True, joint=0.7)
    soft_ring = Rod(law, lengths, natural, closed=True, joint=0.7, stretching=20.0)
    return {
        "free": open_rod,
        "cantilever": open_rod.clamped("start").loaded(
            end=[1, 2, 3], distributed=lambda s: np.stack([s, s**2, 1 - s], axis=1)
        ),
        "segment": open_rod.clamped("end", clamp="segment").loaded(start=[1, 2, 3]),
        "clamped": open_rod.clamped("start").clamped("end", (0.1, 0.2, 0.3), turned),
        "angle": Rod(law, lengths, natural, measure="angle")
        .clamped("start")
        .pinned("end", (0.1, 0, 0)),
        "averaged": Rod(law, lengths, natural, measure="averaged").clamped("start"),
        "extensible": soft.clamped("start")
        .pinned("end", (0.1, 0.1, 1))
        .loaded(nodes={3: [1, 0, 2]}),
        "hinged": open_rod.hinged("start", axis=[1, 2, 0.5], moment=0.3).clamped(
            "end", (0.1, None, 0.3)
        ),
        "interior": open_rod.clamped("start")
        .hinged(3, (0.1, 0.1, 0.2), axis=[0, 1, 1])
        .clamped(5, (0, 0, 0.1), turned)
        .pinned("end", (0.1, None, 0.3)),
        "couples": open_rod.pinned("start").loaded(
            end=[1, 0, 2], arm=[0.1, 0.2, 0], couples={2: ([0, 1, 1], [0, 0.3, 0.1])}
        ),
        "cord": cord,
        "pulled cord": cord.clamped("start").loaded(end=[1, 2, 3]),
        "hinged cord": cord.hinged("start", axis=[1, 2, 0.5])
        .clamped(4, (0.1, 0, 0.5), turned)
        .clamped("end", clamp="segment"),
        "cord of angles": Rod(coupled, lengths, natural, measure="angle").clamped("start"),
        "cord ring": cord_ring,
        "loaded cord ring": cord_ring.pinned(2).loaded(nodes={5: [0, 1, 0], 2: [0, 0, 3]}),
        "ring": ring,
        "loaded ring": soft_ring.pinned(2).loaded(nodes={5: [0, 1, 0], 2: [0, 0, 3]}),
        "extensible ring": soft_ring,
        "clamped ring": ring.clamped(0).clamped(3, (0, 0, 0.3), turned),
    }


def somewhere(rod, seed=0):
    rng = np.random.default_rng(seed)
    stretches = None if not rod.extensible else 1 + 0.1 * rng.random(SEGMENTS)
    frames = exponential(0.7 * rng.normal(size=(SEGMENTS, 3)))
    state = rod.adopt(RodState(frames, rng.normal(size=3), stretches))
    return rod.retract(state, 0.1 * rng.normal(size=rod.size)), rng


@pytest.mark.parametrize("name", rods())
def test_gradient_and_hessian_are_derivatives_of_the_lagrangian(name):
    rod = rods()[name]
    state, rng = somewhere(rod)
    mult = rng.normal(size=rod.constraints_count)
    here = rod.evaluate(state, mult, 2)

    def at(dx, order):
        return rod.evaluate(rod.retract(state, dx), mult, order)

    def lagrangian(dx):
        e = at(dx, 0)
        return e.energy + mult @ e.constraints

    def stencil(f, h):  # fourth order
        return (f(-2 * h) - 8 * f(-h) + 8 * f(h) - f(2 * h)) / (12 * h)

    for _ in range(4):
        u = rng.normal(size=rod.size)
        u /= np.linalg.norm(u)
        slope = stencil(lambda h, u=u: lagrangian(h * u), 1e-3)
        assert slope == pytest.approx(here.gradient @ u, abs=3e-10 * np.linalg.norm(here.gradient))
        moved = stencil(lambda h, u=u: at(h * u, 0).constraints, 1e-3)
        bent, changed = here.kkt.apply(u, np.zeros_like(mult))
        assert np.allclose(moved, changed, atol=1e-9)
        h = 2e-3
        values = [lagrangian(k * h * u) for k in (-2, -1, 0, 1, 2)]
        second = np.dot([-1, 16, -30, 16, -1], values) / (12 * h * h)
        scale = float(np.abs(u) @ here.kkt.magnitude(u, np.zeros_like(mult))[0])
        assert second == pytest.approx(u @ bent, abs=1e-8 * scale)


@pytest.mark.parametrize("name", rods())
def test_difference_is_the_inverse_of_retract(name):
    rod = rods()[name]
    state, rng = somewhere(rod)
    dx = 0.3 * rng.normal(size=rod.size)
    assert np.allclose(rod.difference(state, rod.retract(state, dx)), dx, atol=1e-13)


@pytest.mark.parametrize("name", ["free", "angle", "averaged", "ring"])
def test_rigid_motions_change_nothing(name):
    """Energy, gradient and Hessian in body increments do not see a rotation of all frames."""
    rod = (
        rods()[name].freed("start").freed("end") if name in ("angle", "averaged") else rods()[name]
    )
    state, rng = somewhere(rod)
    turn = exponential(rng.normal(size=3))
    turned = RodState(multiply(turn, state.quaternions), state.origin + 1.0)
    zero = np.zeros(rod.constraints_count)
    a, b = rod.evaluate(state, zero, 2), rod.evaluate(turned, zero, 2)
    assert b.energy == pytest.approx(a.energy, rel=1e-13)
    scale = np.max(np.abs(a.kkt.band))
    assert np.max(np.abs(a.gradient - b.gradient)) < 1e-13 * scale
    assert np.max(np.abs(a.kkt.band - b.kkt.band)) < 1e-13 * scale


def test_seen_from_the_other_end_the_rod_is_the_same():
    """Reversal: kappa -> (-kappa_1, kappa_2, kappa_3) with the frames turned by pi about d1."""
    rng = np.random.default_rng(3)
    lengths, natural = 0.1 + rng.random(SEGMENTS), rng.normal(size=(SEGMENTS + 1, 3))
    law = Kirchhoff((1.0, 2.0), 1.5)
    force = np.array([1.0, 2.0, 3.0])
    rod = Rod(law, lengths, natural).loaded(end=force, start=-force)
    back = Rod(law, lengths[::-1], (natural * [-1, 1, 1])[::-1]).loaded(start=force, end=-force)
    frames = exponential(rng.normal(size=(SEGMENTS, 3)))
    flip = np.array([0.0, 1.0, 0.0, 0.0])  # by pi about d1, which stays
    one, two = RodState(frames), RodState(multiply(frames[::-1], flip))
    a, b = (r.evaluate(s, np.zeros(0), 1) for r, s in ((rod, one), (back, two)))
    strains, mirrored = rod.strains(one), back.strains(two)[::-1]
    assert np.allclose(strains * [-1, 1, 1], mirrored, atol=1e-13)
    assert a.energy == pytest.approx(b.energy, rel=1e-12)


def test_no_hinge_turns_past_pi_in_a_step():
    rod = rods()["free"]
    state = somewhere(rod)[0]
    rng = np.random.default_rng(5)
    for size in (1.0, 10.0, 100.0):
        dx = size * rng.normal(size=rod.size)
        fraction = rod.max_step(state, dx)
        assert 0 < fraction <= 1
        angles = []
        for t in np.linspace(0, fraction, 200):
            q, kappa = np.empty((SEGMENTS - 1, 4)), np.empty((SEGMENTS - 1, 3))
            frames = rod._frames(rod.retract(state, t * dx))
            plan = rod.layout.plan
            kernel.hinge_rotations(frames, plan.left, plan.right, plan.twist, q, kappa)
            angles.append(2 * np.arccos(np.clip(q[:, 0], -1, 1)))
        steps = np.abs(np.diff(angles, axis=0))
        assert np.max(angles) < np.pi * (1 - 1e-3) or fraction == 1
        assert np.max(steps) < 0.2  # continuous: the angle never jumps at pi
