"""The centerline-twist representation against the transcription of the thesis, and its invariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rods import transcription as plain

from lissome.errors import InvalidInput
from lissome.rods import quaternions as qn
from lissome.rods.centerline import CenterlineState, strain_energy
from lissome.rods.laws import Kirchhoff

SEEDS = st.integers(0, 2**32 - 1)
MODULI = np.array([1.0, 2.5, 0.7])
LAW = Kirchhoff((1.0, 2.5), 0.7)


def unit(array):
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


class Case:
    """A rod far from its reference, with hinges of any angle below 2.6 radians."""

    def __init__(self, seed, segments=5, bend=2.6, away=2.2):
        random = np.random.default_rng(seed)
        n = self.segments = segments
        self.random = random
        self.lengths = random.uniform(0.5, 1.5, n)
        frames = [unit(random.standard_normal(4))]
        for _ in range(n - 1):
            turn = unit(random.standard_normal(3)) * random.uniform(0, bend)
            frames.append(qn.multiply(frames[-1], qn.exponential(turn)))
        self.frames = np.array(frames)
        edges = qn.to_directors(self.frames)[:, 2] * random.uniform(0.5, 1.5, n)[:, None]
        self.nodes = random.standard_normal(3) + np.vstack([np.zeros(3), np.cumsum(edges, axis=0)])
        self.current = CenterlineState.from_frames(self.nodes, self.frames)
        self.state = self.current.referred_to(self.other_reference(away))
        self.natural = random.standard_normal((n + 1, 3))

    def other_reference(self, away=2.2):
        """Frames whose tangents are up to `away` off, and that are twisted by any angle."""
        axis = unit(np.cross(self.random.standard_normal((self.segments, 3)), self.tangents))
        turn = axis * self.random.uniform(0, away, (self.segments, 1))
        twist = self.random.uniform(-3, 3, self.segments)
        spun = qn.multiply(qn.rotation_about(self.tangents, twist), self.frames)
        return qn.multiply(qn.exponential(turn), spun)

    @property
    def tangents(self):
        return qn.to_directors(self.frames)[:, 2]

    def plain(self, state=None):
        """X, T, D for the transcription, with signs of D that make the q of all hinges positive."""
        state = self.state if state is None else state
        D, T = np.array(state.reference), np.array(state.reference_tangents)
        d = plain.frames(state.vector, T, D)
        for j in range(1, len(D)):
            if plain.rotation_gradient(d[j - 1], d[j])[0] < 0:
                D[j], d[j] = -D[j], -d[j]
        return state.vector, T, D

    def arguments(self):
        return (*self.plain(), self.lengths, MODULI, self.natural[1:-1])

    def energy(self, state=None, order=2):
        state = self.state if state is None else state
        return strain_energy(state, LAW, self.lengths, self.natural, order=order)


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def complex_steps(function, X):
    """Exact derivatives of a function that is analytic: last axis of the result."""
    columns = [np.imag(function(X + 1e-60j * e)) / 1e-60 for e in np.eye(X.size)]
    return np.stack(columns, axis=-1)


# ---- against the transcription --------------------------------------------------------------------


@settings(max_examples=60)
@given(SEEDS)
def test_frames_and_strains_are_those_of_the_thesis(seed):
    case = Case(seed)
    X, T, D = case.plain()
    d = plain.frames(X, T, D)
    sign = np.sign(np.sum(d * case.state.quaternions, axis=1))[:, None]
    np.testing.assert_allclose(case.state.quaternions, sign * d, atol=1e-13)
    np.testing.assert_allclose(case.state.strains, plain.strains(X, T, D), atol=1e-13)
    np.testing.assert_allclose(
        case.state.stretching(case.lengths),
        [
            plain.stretching(*pair, l)
            for *pair, l in zip(case.nodes[:-1], case.nodes[1:], case.lengths, strict=True)
        ],
        atol=1e-14,
    )
    for I in range(3):  # (4.10)
        np.testing.assert_allclose(
            case.state.directors[:, I], [plain.act(q, np.eye(3)[I]) for q in d], atol=1e-13
        )
    np.testing.assert_allclose(case.state.directors[:, 2], case.state.tangents, atol=1e-13)  # (4.9)


@settings(max_examples=40)
@given(SEEDS)
def test_energy_gradient_and_hessian_are_those_of_the_thesis(seed):
    case = Case(seed)
    energy, arguments = case.energy(), case.arguments()
    assert energy.value == pytest.approx(plain.kirchhoff_energy(*arguments), rel=1e-13)
    assert relative(energy.gradient, plain.kirchhoff_gradient(*arguments)) < 1e-13
    assert relative(energy.hessian(), plain.kirchhoff_hessian(*arguments)) < 1e-13


@settings(max_examples=12)
@given(SEEDS)
def test_complex_steps_confirm_gradient_and_hessian(seed):
    case = Case(seed)
    X, *rest = case.arguments()
    energy = case.energy()
    by_steps = complex_steps(lambda x: plain.kirchhoff_energy(x, *rest), X)
    assert relative(energy.gradient, by_steps) < 1e-12
    by_steps = complex_steps(lambda x: plain.kirchhoff_gradient(x, *rest), X)
    assert relative(energy.hessian(), by_steps) < 1e-12


def test_lower_orders_give_the_same_values():
    case = Case(3)
    full, first, value = (case.energy(order=order) for order in (2, 1, 0))
    assert full.value == first.value == value.value
    np.testing.assert_array_equal(full.gradient, first.gradient)
    assert first.band is None and value.gradient is None
    with pytest.raises(InvalidInput, match="order=2"):
        first.hessian()


def test_a_law_may_vary_along_the_rod():
    case = Case(8, segments=6)
    stiffness = np.linspace(1, 4, 7)
    whole = strain_energy(
        case.state, Kirchhoff((stiffness, 2 * stiffness), stiffness), case.lengths, case.natural
    )
    expected = 0.0
    for i in range(1, 6):  # hinge by hinge, each with its own uniform law
        one = CenterlineState(
            case.state.positions[i - 1 : i + 2],
            case.state.twists[i - 1 : i + 1],
            case.state.reference[i - 1 : i + 1],
        )
        law = Kirchhoff((stiffness[i], 2 * stiffness[i]), stiffness[i])
        expected += strain_energy(
            one, law, case.lengths[i - 1 : i + 1], case.natural[i], order=0
        ).value
    assert whole.value == pytest.approx(expected, rel=1e-14)


class Quartic:
    """A law that is neither quadratic nor diagonal, as a user may write it."""

    strains = ("curvature_1", "curvature_2", "twist")
    count = None

    def density(self, k):  # analytic, also for complex strains
        return (k**2) @ MODULI / 2 + (k @ k) ** 2 / 4 + k[0] ** 2 * k[2]

    def evaluate(self, k, order=2):
        square = np.sum(k**2, axis=1)
        energy = (k**2) @ MODULI / 2 + square**2 / 4 + k[:, 0] ** 2 * k[:, 2]
        stress = MODULI * k + square[:, None] * k
        stress[:, 0] += 2 * k[:, 0] * k[:, 2]
        stress[:, 2] += k[:, 0] ** 2
        stiffness = np.diag(MODULI) + square[:, None, None] * np.eye(3)
        stiffness = stiffness + 2 * k[:, :, None] * k[:, None, :]
        stiffness[:, 0, 0] += 2 * k[:, 2]
        stiffness[:, 0, 2] += 2 * k[:, 0]
        stiffness[:, 2, 0] += 2 * k[:, 0]
        return energy, stress, stiffness


@settings(max_examples=8)
@given(SEEDS)
def test_any_law_will_do(seed):
    case, law = Case(seed), Quartic()
    X, T, D = case.plain()
    spans = (case.lengths[1:] + case.lengths[:-1]) / 2
    inner = case.natural[1:-1]

    def energy(x):
        densities = plain.strains(x, T, D) / spans[:, None] - inner
        return sum(l * law.density(k) for l, k in zip(spans, densities, strict=True))

    ours = strain_energy(case.state, law, case.lengths, case.natural)
    assert ours.value == pytest.approx(energy(X), rel=1e-12)
    assert relative(ours.gradient, complex_steps(energy, X)) < 1e-12

    # the second derivative from the printed variations of the strains, hinge by hinge
    hessian = np.zeros((X.size, X.size))
    for i, (span, natural) in enumerate(zip(spans, inner, strict=True)):
        rows, pair = slice(4 * i, 4 * i + 11), slice(i, i + 2)
        _, kappa, first, second = plain.hinge_variations(X[rows], T[pair], D[pair])
        _, stress, stiffness = law.evaluate((kappa / span - natural)[None])
        hessian[rows, rows] += first.T @ stiffness[0] @ first / span
        hessian[rows, rows] += np.einsum("i,imn->mn", stress[0], second)
    assert relative(ours.hessian(), hessian) < 1e-12


# ---- invariances ----------------------------------------------------------------------------------


@settings(max_examples=40)
@given(SEEDS)
def test_the_reference_is_a_matter_of_coordinates(seed):
    case = Case(seed)
    first, second = case.state, case.state.referred_to(case.other_reference())
    np.testing.assert_allclose(second.strains, first.strains, atol=1e-12)
    one, two = case.energy(first), case.energy(second)
    assert two.value == pytest.approx(one.value, rel=1e-12)
    n = case.segments
    twist = np.arange(n) * 4 + 3
    scale = np.max(np.abs(one.gradient))
    np.testing.assert_allclose(two.gradient[twist], one.gradient[twist], atol=1e-12 * scale)
    # The derivative by the nodes changes as coordinates do: at fixed angles the frame turns about t by
    # -k.e/(2 |E|) for a change e of the edge E.
    edges = np.diff(first.positions, axis=0)
    tangents = first.tangents
    binormal = [
        2 * np.cross(s.reference_tangents, tangents)
        / (1 + np.sum(s.reference_tangents * tangents, axis=1))[:, None]
        for s in (first, second)
    ]  # fmt: skip
    spin = (binormal[1] - binormal[0]) / (2 * np.linalg.norm(edges, axis=1))[:, None]
    expected = one.gradient.copy()
    for j in range(n):
        change = one.gradient[twist[j]] * spin[j]
        expected[4 * j : 4 * j + 3] += change
        expected[4 * j + 4 : 4 * j + 7] -= change
    np.testing.assert_allclose(two.gradient, expected, atol=1e-11 * scale)
    # and it does change: only where no twisting moment jumps, at equilibrium, it does not
    assert np.max(np.abs(two.gradient - one.gradient)) > 1e-3 * scale


@settings(max_examples=40)
@given(SEEDS)
def test_rigid_motions_change_nothing(seed):
    case = Case(seed)
    q, shift = unit(case.random.standard_normal(4)), case.random.standard_normal(3)
    moved = CenterlineState(
        qn.rotate(q, case.nodes) + shift, case.state.twists, qn.multiply(q, case.state.reference)
    )
    np.testing.assert_allclose(moved.strains, case.state.strains, atol=1e-12)
    one, two = case.energy(), case.energy(moved)
    assert two.value == pytest.approx(one.value, rel=1e-12)
    gradient = one.gradient.copy()
    for j in range(case.segments + 1):
        gradient[4 * j : 4 * j + 3] = qn.rotate(q, gradient[4 * j : 4 * j + 3])
    assert relative(two.gradient, gradient) < 1e-12
    # the frames may also be turned alone, with a reference that stays
    turned = qn.multiply(q, case.frames)
    other = CenterlineState.from_frames(qn.rotate(q, case.nodes), turned)
    np.testing.assert_allclose(other.strains, case.state.strains, atol=1e-12)


@settings(max_examples=40)
@given(SEEDS)
def test_rigid_motions_are_neutral_to_first_and_second_order(seed):
    case = Case(seed)
    energy = case.energy()
    n, scale = case.segments, np.max(np.abs(energy.hessian()))
    shift = np.zeros((3, 4 * n + 3))
    for i in range(3):
        shift[i, i::4] = 1.0
    np.testing.assert_allclose(energy.hessian() @ shift.T, 0, atol=1e-12 * scale * n)
    # rotation about an axis w: nodes move by w x x, twist angles by what the tangent takes
    w = unit(case.random.standard_normal(3))
    at = case.state
    normal = 2 * np.cross(at.reference_tangents, at.tangents)
    binormal = normal / (1 + np.sum(at.reference_tangents * at.tangents, axis=1))[:, None]
    motion = np.zeros(4 * n + 3)
    velocity = np.cross(w, at.positions)
    for i in range(n + 1):
        motion[4 * i : 4 * i + 3] = velocity[i]
    change = np.cross(w, at.tangents)
    motion[3::4] = at.tangents @ w + 0.5 * np.sum(binormal * change, axis=1)
    assert abs(energy.gradient @ motion) < 1e-12 * np.max(np.abs(energy.gradient)) * n


@settings(max_examples=40)
@given(SEEDS)
def test_reversal_keeps_the_sign_of_twist(seed):
    case = Case(seed)
    for keep, rule in (([0, 1, 0, 0], [-1, 1, 1]), ([0, 0, 1, 0], [1, -1, 1])):
        # the other way along the rod: half a turn of each frame about the director that is kept
        frames = qn.multiply(case.frames, keep)[::-1]
        reversed_rod = CenterlineState.from_frames(case.nodes[::-1], frames)
        np.testing.assert_allclose(
            reversed_rod.strains, case.state.strains[::-1] * rule, atol=1e-12
        )


def test_signs_of_quaternions_do_not_matter():
    case = Case(5)
    flipped = case.state.reference * np.array([1, -1, 1, -1, -1])[:, None]
    other = CenterlineState(case.nodes, case.state.twists, flipped)
    assert case.energy(other).value == case.energy().value
    # without the rule, one flipped sign changes the energy of a rod with natural strains
    X, T, D, *rest = case.arguments()
    D[2] = -D[2]
    assert abs(plain.kirchhoff_energy(X, T, D, *rest) / case.energy().value - 1) > 1e-2


# ---- the state ------------------------------------------------------------------------------------


def test_states_are_vectors_with_a_reference():
    case = Case(9)
    again = CenterlineState.from_vector(case.state.vector, case.state.reference)
    np.testing.assert_array_equal(again.positions, case.state.positions)
    np.testing.assert_array_equal(again.twists, case.state.twists)
    reset = case.state.reset()
    np.testing.assert_allclose(reset.quaternions, case.state.quaternions, atol=1e-14)
    np.testing.assert_array_equal(reset.twists, 0)
    back = reset.referred_to(case.state.reference)
    np.testing.assert_allclose(back.twists, case.state.twists, atol=1e-12)
    for array in (again.positions, again.twists, again.reference, again.tangents, again.strains):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_only_the_tangents_must_not_be_opposite():
    # a twist of half a turn is a rotation by pi, and harmless
    nodes = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 2]])
    straight = np.array([[1.0, 0, 0, 0]] * 2)
    state = CenterlineState(nodes, [np.pi, np.pi], straight)
    np.testing.assert_allclose(state.strains, 0, atol=1e-15)
    energy = strain_energy(state, LAW, [1, 1])
    np.testing.assert_allclose(energy.gradient, 0, atol=1e-15)
    assert np.all(np.isfinite(energy.band))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: CenterlineState([[0, 0, 0], [0, 0, -1]], [0], [[1, 0, 0, 0]]),
            "segment 0 points opp",
        ),
        (lambda: CenterlineState([[0, 0, 0], [0, 0, 0]], [0], [[1, 0, 0, 0]]), "nodes 0 and 1"),
        (lambda: CenterlineState([[0, 0, 0], [0, 0, 1]], [0, 1], [[1, 0, 0, 0]]), "`twists` has"),
        (lambda: CenterlineState([[0, 0, 0], [0, 0, 1]], [0], [[2, 0, 0, 0]]), "`reference`"),
        (lambda: CenterlineState([[0, 0, 0]], [], np.zeros((0, 4))), "at least two nodes"),
        (lambda: CenterlineState([[0, 0, np.nan], [0, 0, 1]], [0], [[1, 0, 0, 0]]), "finite"),
        (
            lambda: CenterlineState.from_frames([[0, 0, 0], [1, 0, 0]], [[1, 0, 0, 0]]),
            "off the tangent",
        ),
        (lambda: CenterlineState.from_vector(np.zeros(8), [[1, 0, 0, 0]]), "4 N"),
        (lambda: Case(0).state.stretching([1, 1, 0, 1, 1]), r"`lengths`\[2\] is 0"),
        (lambda: strain_energy(Case(0).state, LAW, np.ones(5), np.ones((5, 3))), "`natural`"),
        (lambda: strain_energy(Case(0).state, LAW, np.ones(5), order=3), "`order` is 3"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()
