"""Random rods, laws, measures and supports against an evaluation of their own, in plain numpy.

The second opinion below knows nothing of the library's kernels: it adds up (4.32) of the thesis from
frames with quaternions of complex numbers, so that gradients come by the complex step.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

import lissome as ls
from lissome import rods
from lissome.errors import NotConverged, StabilityNotResolvable, Unstable
from lissome.rods import FunctionLaw, Kirchhoff, RefinedRibbon, RodState, SanoWada

FEW = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)

# A solver may fail to find an equilibrium if it says so; refusing the rod would be another matter.
HONEST_FAILURES = (NotConverged, Unstable, StabilityNotResolvable)


# ---------------------------------------------------------------------------------------------
# The second opinion


def product(p, q):
    s = p[..., :1] * q[..., :1] - np.sum(p[..., 1:] * q[..., 1:], axis=-1, keepdims=True)
    v = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([s, v], axis=-1)


def conjugated(q):
    return q * np.array([1, -1, -1, -1])


def exponential(v):
    """exp(v/2), also for complex vectors (no absolute values)."""
    square = np.sum(v * v, axis=-1, keepdims=True) + 0j
    small = np.abs(square) < 1e-8
    angle = np.sqrt(np.where(small, 1.0, square))
    cos = np.where(small, 1 - square / 8 + square**2 / 384, np.cos(angle / 2))
    sinc = np.where(small, 0.5 - square / 48 + square**2 / 3840, np.sin(angle / 2) / angle)
    return np.concatenate([cos, sinc * v], axis=-1)


def measured(q, measure):
    """Integrated strains by their definitions, for rotations below half a turn."""
    q = q * np.where(q[..., :1].real < 0, -1, 1)
    kappa = 2 * q[..., 1:]
    if measure == "sine":
        return kappa
    if measure == "angle":
        square = np.sum(q[..., 1:] * q[..., 1:], axis=-1, keepdims=True) + 0j
        small = np.abs(square) < 1e-10
        y = np.sqrt(np.where(small, 0.25, square))
        return kappa * np.where(small, 1 + square / 6, np.arcsin(y) / y)
    s, x, y, z = np.moveaxis(q, -1, 0)
    twist = 2 * np.arctan(z / s)
    return np.stack([s * x, s * y, 0 * s], axis=-1) * 2 / (s * s + z * z)[..., None] + np.stack(
        [0 * twist, 0 * twist, twist], axis=-1
    )


@dataclass(frozen=True)
class Opinion:
    """Potential energy of an open rod in increments of its frames, and where its end is."""

    density: object  # energy per length of strain densities (n, 3), complex
    lengths: np.ndarray
    natural: np.ndarray
    measure: str
    start: np.ndarray | None  # frame (quaternion) of the clamp, or None
    end: np.ndarray | None
    held: bool  # whether the position of the end is prescribed
    force: np.ndarray  # on the end
    weight: np.ndarray  # per length, on all nodes
    joint: float | None = None  # of a closed rod: its hinge N joins the last segment with the first

    def energy(self, frames, increments):
        """Energies for increments of shape (..., N, 3)."""
        d = product(frames, exponential(increments))
        n, batch = d.shape[-2], d.shape[:-2]
        left, right = [d[..., :-1, :]], [d[..., 1:, :]]
        spans, nodes = [(self.lengths[1:] + self.lengths[:-1]) / 2], [np.arange(1, n)]
        if self.start is not None:
            left.append(np.broadcast_to(self.start, (*batch, 1, 4)))
            right.append(d[..., :1, :])
            spans, nodes = [*spans, self.lengths[:1] / 2], [*nodes, [0]]
        if self.end is not None:
            left.append(d[..., -1:, :])
            right.append(np.broadcast_to(self.end, (*batch, 1, 4)))
            spans, nodes = [*spans, self.lengths[-1:] / 2], [*nodes, [n]]
        if self.joint is not None:
            turn = exponential(np.array([[0.0, 0.0, self.joint]])).real
            left.append(d[..., -1:, :])
            right.append(product(d[..., :1, :], turn))
            spans.append((self.lengths[:1] + self.lengths[-1:]) / 2)
            nodes.append([0])
        q = product(conjugated(np.concatenate(left, axis=-2)), np.concatenate(right, axis=-2))
        span, node = np.concatenate(spans), np.concatenate(nodes).astype(int)
        k = measured(q, self.measure) / span[:, None] - self.natural[node]
        x = self.positions(d)
        ends = np.zeros(n + 1)
        ends[:-1] += self.lengths / 2
        ends[1:] += self.lengths / 2
        loads = x[..., -1, :] @ self.force + np.sum(
            x * (ends[:, None] * self.weight), axis=(-1, -2)
        )
        return self.density(k.reshape(-1, 3)).reshape(k.shape[:-1]) @ span - loads

    def positions(self, d):
        s, v = d[..., :1], d[..., 1:]
        e3 = np.broadcast_to(np.array([0.0, 0.0, 1.0]), v.shape)
        twice = 2 * np.cross(v, e3)
        tangents = e3 + s * twice + np.cross(v, twice)
        steps = np.cumsum(tangents * self.lengths[:, None], axis=-2)
        return np.concatenate([np.zeros_like(steps[..., :1, :]), steps], axis=-2)

    def last(self, frames, increments):
        return self.positions(product(frames, exponential(increments)))[..., -1, :]

    def slopes(self, frames, at):
        """Gradients of the energy and Jacobians of the end position, by the complex step.

        At increments of shape (..., N, 3); shapes (..., 3 N) and (..., 3, 3 N).
        """
        n = frames.shape[0]
        steps = 1e-30j * np.eye(3 * n).reshape(3 * n, n, 3)
        x = at[..., None, :, :] + steps
        jacobian = self.last(frames, x).imag / 1e-30
        return self.energy(frames, x).imag / 1e-30, np.swapaxes(jacobian, -1, -2)

    def curvature(self, frames, multipliers):
        """Hessian of the Lagrangian at the frames, by differences of complex steps."""
        n = frames.shape[0]
        h = 1e-4
        steps = h * np.eye(3 * n).reshape(3 * n, n, 3)
        gradient, jacobian = self.slopes(frames, np.stack([steps, -steps]))
        lagrange = gradient + np.einsum("c,...cn->...n", multipliers, jacobian)
        hessian = (lagrange[0] - lagrange[1]) / (2 * h)
        return (hessian + hessian.T) / 2


# ---------------------------------------------------------------------------------------------
# Random rods


def hardening(k, c):
    """A law of a user: stiffer in bending the more it bends."""
    b = k * [1.0, 1.0, 0.0]
    square = np.sum(b * b, axis=1)
    energy = square / 2 + square**2 / 40 + c * k[:, 2] ** 2 / 2
    stress = b * (1 + square / 10)[:, None] + k * [0, 0, c]
    stiffness = (1 + square / 10)[:, None, None] * np.diag([1.0, 1, 0]) + np.diag([0, 0, c])
    return energy, stress, stiffness + b[:, :, None] * b[:, None, :] / 5


def refined_density(w, h, nu):
    """Of Audoly and Neukirch, with the formula of phi as printed."""

    def density(k):
        star = h / (w**2 * math.sqrt(12 * (1 - nu**2)))
        v2 = (k[:, 0] / star) ** 2 + 1e-30  # any small number: phi is even and smooth
        small = np.abs(v2) < 1e-2
        s = (np.where(small, 1.0, v2) / 4) ** 0.25
        exact = (0.5 - (np.cosh(s) - np.cos(s)) / (s * (np.sinh(s) + np.sin(s)))) / s**4
        z = v2 / 4
        series = (1 / 360 + 4 * z / 3628800) / (1 + z / 120 + z**2 / 362880)
        phi = np.where(small, series, exact)
        quartic = w**5 * h / 2 * (nu * k[:, 0] ** 2 + k[:, 2] ** 2) ** 2 * phi
        linear = np.sum(k**2 * [w * h**3 / 12, w**3 * h / 12, w * h**3 / (6 * (1 + nu))], axis=1)
        return (linear + quartic) / 2

    return density


@st.composite
def laws(draw):
    """A law, its energy written again, and its largest moment at strains of one."""
    numbers = st.floats(0.3, 3.0)
    kind = draw(st.sampled_from(["kirchhoff", "sano-wada", "function", "refined"]))
    if kind == "function":
        c = draw(numbers)

        def density(k):
            square = k[:, 0] ** 2 + k[:, 1] ** 2
            return square / 2 + square**2 / 40 + c * k[:, 2] ** 2 / 2

        return FunctionLaw(hardening, parameters={"c": c}), density, 3.0
    if kind == "refined":
        w, h, nu = 0.3, 0.03, draw(st.floats(0.0, 0.4))
        # in units in which the easy bending stiffness is one
        young = 12 / (w * h**3)
        plain = refined_density(w, h, nu)
        law = RefinedRibbon(w, h, young, poisson_ratio=nu)
        return law, lambda k: young * plain(k), 100.0
    b1, b2, c = draw(numbers), draw(numbers), draw(numbers)
    if kind == "kirchhoff":
        return Kirchhoff((b1, b2), c), lambda k: np.sum(k**2 * [b1, b2, c], axis=1) / 2, 3.0
    xi = draw(st.floats(0.05, 0.5))

    def density(k):
        x, y, z = k.T
        return (b1 * (x**2 + z**4 / (1 / xi**2 + x**2)) + b2 * y**2 + c * z**2) / 2

    return SanoWada((b1, b2), c, xi), density, 10.0


VECTOR = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


@st.composite
def cases(draw, supports=("free", "start", "both", "pinned")):
    """A rod, its second opinion, and a crooked state."""
    law, density, stiffness = draw(laws())
    measure = draw(st.sampled_from(["sine", "angle", "averaged"]))
    n = draw(st.integers(4, 9))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    lengths = random.uniform(0.5, 1.5, n)
    lengths /= lengths.sum()
    natural = random.normal(size=(n + 1, 3)) * draw(st.floats(0.0, 2.0))
    support = draw(st.sampled_from(supports))
    force = draw(VECTOR) * (8.0 if support != "free" else 0.0)
    weight = draw(VECTOR) * (8.0 if support != "free" else 0.0)
    frames = exponential(np.cumsum(random.normal(size=(n, 3)) * 0.3, axis=0)).real
    start = Rotation.from_rotvec(random.normal(size=3) * 0.2) if support != "free" else None
    end = Rotation.from_rotvec(random.normal(size=3) * 0.7) if support == "both" else None
    rod = rods.Rod(law, lengths, natural, measure=measure, initial=RodState(frames))
    if start is not None:
        rod = rod.clamped("start", position=[0.0, 0.0, 0.0], frame=start)
        rod = rod.loaded(end=force, distributed=weight)
    target = np.array([*random.uniform(-0.3, 0.3, 2), random.uniform(0.4, 0.8)])
    if support == "both":
        rod = rod.clamped("end", position=target, frame=end)
    elif support == "pinned":
        rod = rod.pinned("end", position=target)

    def quaternion(rotation):
        return None if rotation is None else rotation.as_quat(scalar_first=True)

    held = support in ("both", "pinned")
    opinion = Opinion(
        density, lengths, natural, measure, quaternion(start), quaternion(end), held, force, weight
    )
    return rod, opinion, stiffness, target


# ---------------------------------------------------------------------------------------------
# Properties


@given(cases())
@FEW
def test_energy_gradient_and_hessian(case):
    rod, opinion, stiffness, _ = case
    frames = rod.initial.quaternions
    n = frames.shape[0]
    multipliers = np.random.default_rng(1).normal(size=rod.constraints_count)
    lagrange = np.zeros(3) if multipliers.size == 0 else multipliers
    found = rod.evaluate(rod.start(), multipliers, 2)
    zero = np.zeros((n, 3))
    frames = rod.start().quaternions
    energy = opinion.energy(frames, zero).real
    assert found.energy == pytest.approx(energy, rel=1e-10, abs=1e-10 * stiffness)
    gradient, jacobian = opinion.slopes(frames, zero)
    # Unknowns are the increments of segments in their order; constraints the end, up to order and sign
    ours = found.gradient
    assert ours.shape == (3 * n,)
    kkt = found.kkt
    size = np.abs(gradient).max() + 1.0
    if multipliers.size:
        rows = np.array([kkt.apply(np.zeros(3 * n), e)[0] for e in np.eye(3)])
        # the same constraints: each row of ours is a row of theirs, or its negative
        signs = np.sign(np.einsum("ij,ij->i", rows, jacobian))
        np.testing.assert_allclose(rows, signs[:, None] * jacobian, atol=1e-10)
        lagrange = signs * multipliers
    np.testing.assert_allclose(ours, gradient + lagrange @ jacobian, atol=1e-8 * size)
    hessian = opinion.curvature(frames, lagrange)
    applied = np.array([kkt.apply(e, np.zeros(multipliers.size))[0] for e in np.eye(3 * n)])
    np.testing.assert_allclose(applied, applied.T, atol=1e-10 * np.abs(applied).max())
    np.testing.assert_allclose(applied, hessian, atol=3e-6 * np.abs(hessian).max())


@given(cases(supports=("free",)), VECTOR)
@FEW
def test_rigid_motions_change_nothing(case, vector):
    rod, *_ = case
    turn = exponential(3 * vector).real
    moved = RodState(product(turn[None], rod.initial.quaternions), origin=5 * vector)
    here = rod.evaluate(rod.initial, np.zeros(0), 1)
    there = rod.evaluate(moved, np.zeros(0), 1)
    scale = 1.0 + abs(here.energy)
    assert there.energy == pytest.approx(here.energy, abs=1e-11 * scale)
    # unknowns are components along the directors, which move along
    np.testing.assert_allclose(there.gradient, here.gradient, atol=1e-10 * scale)


@given(cases(supports=("free",)))
@FEW
def test_reversal_changes_nothing(case):
    """From the other end: frames turned by half a turn about d1, and strains (-k1, k2, k3)."""
    rod, *_ = case
    half = np.array([0.0, 1.0, 0.0, 0.0])
    state = RodState(product(rod.initial.quaternions[::-1], half[None]))
    natural = rod.natural[::-1] * [-1, 1, 1]
    other = rods.Rod(rod.law, rod.lengths[::-1], natural, measure=rod.measure, initial=state)
    here, there = (r.evaluate(r.initial, np.zeros(0), 1) for r in (rod, other))
    scale = 1.0 + abs(here.energy)
    assert there.energy == pytest.approx(here.energy, abs=1e-11 * scale)
    # body components: the half turn keeps the first and reverses the others
    mirrored = here.gradient.reshape(-1, 3)[::-1] * [1, -1, -1]
    np.testing.assert_allclose(there.gradient.reshape(-1, 3), mirrored, atol=1e-10 * scale)
    x, y = rod.positions(rod.initial), other.positions(state)
    np.testing.assert_allclose(y[::-1] - y[-1], x - x[0], atol=1e-14)


def verdict(opinion, eq, target):
    """Return the unbalanced force and the least eigenvalue, by the second opinion."""
    frames = eq.state.quaternions
    n = frames.shape[0]
    gradient, jacobian = opinion.slopes(frames, np.zeros((n, 3)))
    multipliers = np.zeros(3)
    tangent = np.eye(3 * n)
    if opinion.held:
        np.testing.assert_allclose(opinion.last(frames, np.zeros((n, 3))).real, target, atol=1e-9)
        multipliers = np.linalg.lstsq(jacobian.T, -gradient, rcond=None)[0]
        gradient = gradient + multipliers @ jacobian
        tangent = null_space(jacobian)
    hessian = opinion.curvature(frames, multipliers)
    values = np.linalg.eigvalsh(tangent.T @ hessian @ tangent)
    return np.abs(gradient).max(), values[0], np.abs(values).max()


@given(cases(supports=("start", "both", "pinned")))
@FEW
def test_equilibrate_returns_only_what_is_balanced_and_stable(case):
    rod, opinion, stiffness, target = case
    try:
        eq = ls.equilibrate(rod)
    except HONEST_FAILURES:
        return
    unbalanced, least, largest = verdict(opinion, eq, target)
    moment = np.abs(eq.moments).max() + stiffness
    assert unbalanced < 1e-7 * moment
    assert eq.stable
    assert least > -1e-6 * largest
    energy = opinion.energy(eq.state.quaternions, np.zeros((rod.lengths.size, 3))).real
    assert eq.energy == pytest.approx(energy, abs=1e-9 * moment)
    x = opinion.positions(eq.state.quaternions)
    np.testing.assert_allclose(eq.positions, x, atol=1e-12)


@given(cases(supports=("start", "both", "pinned")))
@FEW
def test_what_is_asked_for_in_any_state_says_whether_it_is_stable(case):
    rod, opinion, stiffness, target = case
    try:
        eq = ls.equilibrate(rod, require="any")
    except HONEST_FAILURES:
        return
    unbalanced, least, largest = verdict(opinion, eq, target)
    assert unbalanced < 1e-7 * (np.abs(eq.moments).max() + stiffness)
    if abs(least) > 1e-5 * largest:  # beyond the error of the differences
        assert eq.stable == (least > 0)


@st.composite
def rings(draw):
    """A closed rod that nothing holds, its second opinion, and a state that need not close."""
    law, density, stiffness = draw(laws())
    n = draw(st.integers(5, 9))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    lengths = random.uniform(0.8, 1.2, n)
    lengths /= lengths.sum()
    measure = draw(st.sampled_from(["sine", "angle", "averaged"]))
    turns = draw(st.sampled_from([0.0, 0.5, 1.0]))
    circle = rods.ring(law=law, lengths=lengths, measure=measure, turns=turns)
    natural = random.normal(size=(n + 1, 3)) * draw(st.floats(0.0, 3.0))
    natural[-1] = natural[0]
    shaken = random.normal(size=(n, 3)) * draw(st.floats(0.0, 0.2))
    shaken[0] = 0.0  # the first segment is held
    frames = product(circle.initial.quaternions, exponential(shaken).real)
    rod = rods.Rod(
        law, lengths, natural, closed=True, joint=circle.joint, measure=measure, phase=None,
        initial=RodState(frames),
    )  # fmt: skip
    zero = np.zeros(3)
    opinion = Opinion(
        density, lengths, natural, measure, None, None, True, zero, zero, joint=circle.joint
    )
    return rod, opinion, stiffness


@given(rings())
@FEW
def test_ring_gradient_and_hessian(case):
    rod, opinion, stiffness = case
    frames = rod.initial.quaternions
    n = frames.shape[0]
    multipliers = np.random.default_rng(2).normal(size=3)
    assert rod.size == 3 * (n - 1) and rod.constraints_count == 3
    found = rod.evaluate(rod.initial, multipliers, 2)
    zero = np.zeros((n, 3))
    assert found.energy == pytest.approx(
        opinion.energy(frames, zero).real, rel=1e-10, abs=1e-10 * stiffness
    )
    gradient, jacobian = (part[..., 3:] for part in opinion.slopes(frames, zero))
    rows = np.array([found.kkt.apply(np.zeros(3 * n - 3), e)[0] for e in np.eye(3)])
    signs = np.sign(np.einsum("ij,ij->i", rows, jacobian))
    np.testing.assert_allclose(rows, signs[:, None] * jacobian, atol=1e-10)
    np.testing.assert_allclose(
        signs * found.constraints, opinion.last(frames, zero).real, atol=1e-12
    )
    lagrange = signs * multipliers
    scale = np.abs(gradient).max() + 1.0
    np.testing.assert_allclose(found.gradient, gradient + lagrange @ jacobian, atol=1e-8 * scale)
    hessian = opinion.curvature(frames, lagrange)[3:, 3:]
    applied = np.array([found.kkt.apply(e, np.zeros(3))[0] for e in np.eye(3 * n - 3)])
    np.testing.assert_allclose(applied, hessian, atol=3e-6 * np.abs(hessian).max())


@given(rings())
@FEW
def test_ring_in_equilibrium_is_balanced_and_stable(case):
    rod, opinion, stiffness = case
    try:
        eq = ls.equilibrate(rod)
    except HONEST_FAILURES:
        return
    frames = eq.state.quaternions
    zero = np.zeros(frames.shape)[:, :3]
    np.testing.assert_allclose(opinion.last(frames, zero).real, 0.0, atol=1e-9)
    gradient, jacobian = opinion.slopes(frames, zero)
    multipliers = np.linalg.lstsq(jacobian.T, -gradient, rcond=None)[0]
    # also of the first segment, which is held only to remove rigid motions
    unbalanced = gradient + multipliers @ jacobian
    assert np.abs(unbalanced).max() < 1e-7 * (np.abs(eq.moments).max() + stiffness)
    tangent = null_space(jacobian)
    values = np.linalg.eigvalsh(tangent.T @ opinion.curvature(frames, multipliers) @ tangent)
    assert values[0] > -1e-6 * values[-1]
    assert np.sum(np.abs(values) < 1e-6 * values[-1]) >= 3  # rigid rotations
    # the number of turns at the joint is kept, but for passages of the ring through itself
    assert eq.link - rod.joint / (2 * math.pi) == pytest.approx(
        round(eq.link - rod.joint / (2 * math.pi)), abs=1e-8
    )


@given(cases(supports=("start", "free")), st.floats(1.0, 100.0))
@FEW
def test_stretching(case, stiffness):
    """Energy and derivatives of an extensible rod, along random curves of states."""
    rigid, opinion, _, _ = case
    n = rigid.lengths.size
    random = np.random.default_rng(n)
    rod = rods.Rod(
        rigid.law, rigid.lengths, rigid.natural, supports=rigid.supports, loads=rigid.loads,
        measure=rigid.measure, stretching=stiffness, initial=rigid.initial,
    )  # fmt: skip
    start = rod.start()
    stretches = random.uniform(0.7, 1.4, n)
    state = replace(start, stretches=stretches)
    found = rod.evaluate(state, np.zeros(0), 2)
    # (4.17): the strain is (e^2 - 1)/2; dead loads do work on the longer rod
    bent = opinion.energy(state.quaternions, np.zeros((n, 3))).real
    x, y = opinion.positions(state.quaternions), rod.positions(state)
    ends = np.zeros(n + 1)
    ends[:-1] += rod.lengths / 2
    ends[1:] += rod.lengths / 2
    work = (y - x)[-1] @ opinion.force + np.sum((y - x) * ends[:, None] * opinion.weight)
    stretched = stiffness / 2 * rod.lengths @ ((stretches**2 - 1) / 2) ** 2
    assert found.energy == pytest.approx(bent + stretched - work, rel=1e-9, abs=1e-9 * stiffness)
    for _ in range(3):
        dx = random.normal(size=rod.size)
        dx /= np.linalg.norm(dx)
        second, _ = found.kkt.apply(dx, np.zeros(0))

        def energy(t, dx=dx):
            return rod.evaluate(rod.retract(state, t * dx), np.zeros(0), 0).energy

        slope, bend = differences(energy, 1e-2)
        scale = abs(found.energy) + np.abs(found.gradient).max()
        assert found.gradient @ dx == pytest.approx(slope, abs=1e-7 * scale)
        assert dx @ second == pytest.approx(bend, abs=1e-5 * (scale + np.abs(second).max()))


def differences(f, h):
    """First and second derivative at zero, by central differences with two steps of Richardson's."""
    first, second = [], []
    for k in (h, h / 2, h / 4):
        first.append((f(k) - f(-k)) / (2 * k))
        second.append((f(k) - 2 * f(0.0) + f(-k)) / k**2)
    for table in (first, second):
        for p in (4, 16):
            table[:] = [(p * b - a) / (p - 1) for a, b in zip(table[:-1], table[1:], strict=True)]
    return first[0], second[0]


def test_random_rods_mostly_have_equilibria():
    """The properties above would hold of a solver that always gives up."""
    found = []

    @given(cases(supports=("start", "both", "pinned")))
    @settings(FEW, max_examples=30)
    def solve(case):
        try:
            found.append(bool(ls.equilibrate(case[0]).stable))
        except HONEST_FAILURES:
            found.append(False)

    solve()
    assert np.mean(found) >= 0.9
