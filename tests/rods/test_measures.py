"""Strain measures: definitions, derivatives, symmetries, limits."""

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lissome.errors import InvalidInput
from lissome.rods import measures
from lissome.rods.measures import (
    CODES,
    MEASURES,
    angle_over_strain,
    rotation_from_strain,
    strain_from_rotation,
)

VECTORS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)


def random_rotations(count, largest=2.5, seed=0):
    random = np.random.default_rng(seed)
    axes = random.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    half = 0.5 * random.uniform(0.0, largest, count)[:, None]
    return np.hstack([np.cos(half), np.sin(half) * axes])


def matrix(q):
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def by_definition(q, measure):
    """The measures from frames, with scipy's rotations."""
    first = Rotation.random(rng=np.random.default_rng(5)).as_matrix()
    second = first @ matrix(q)  # columns are the directors
    relative = Rotation.from_matrix(second @ first.T)
    spatial = relative.as_rotvec()
    if measure == "angle":  # (4.20), (4.21): the same components in both frames
        np.testing.assert_allclose(first.T @ spatial, second.T @ spatial, atol=1e-14)
        return first.T @ spatial
    if measure == "sine":
        angle = np.linalg.norm(spatial)
        return first.T @ spatial / angle * 2 * math.sin(angle / 2)
    t, u = first[:, 2], second[:, 2]
    binormal = 2 * np.cross(t, u) / (1 + t @ u)
    axis = np.cross(t, u)
    axis *= math.atan2(np.linalg.norm(axis), t @ u) / np.linalg.norm(axis)
    carried = Rotation.from_rotvec(axis).as_matrix() @ first
    twist = math.atan2(np.cross(carried[:, 0], second[:, 0]) @ u, carried[:, 0] @ second[:, 0])
    mean = (first + second) / 2
    return np.array([binormal @ mean[:, 0], binormal @ mean[:, 1], twist])


@pytest.mark.parametrize("measure", MEASURES)
def test_measures_are_what_they_are_defined_to_be(measure):
    for q in random_rotations(20):
        np.testing.assert_allclose(
            strain_from_rotation([q], measure)[0], by_definition(q, measure), atol=1e-13
        )


def test_averaged_measure_is_algebra_of_the_quaternion():
    # with symbols: curvature binormal in averaged directors
    q0, q1, q2, q3 = q = sp.symbols("q0:4", real=True)
    rotation = sp.algebras.Quaternion(*q).to_rotation_matrix()
    sphere = q0**2 - (1 - q1**2 - q2**2 - q3**2)
    frame = rotation * (q0**2 + q1**2 + q2**2 + q3**2)  # a polynomial; of unit length on the sphere
    t, u = sp.Matrix([0, 0, 1]), sp.simplify(frame[:, 2])
    binormal = 2 * t.cross(u) / (1 + t.dot(u))
    for a, component in ((0, q1), (1, q2)):
        mean = (sp.eye(3)[:, a] + sp.simplify(frame[:, a])) / 2
        claim = 2 * q0 * component / (q0**2 + q3**2)
        numerator = sp.numer(sp.together(binormal.dot(mean) - claim))
        remainder = sp.rem(sp.Poly(numerator, q0), sp.Poly(sphere, q0))
        assert sp.simplify(remainder.as_expr()) == 0


def test_measures_differ_at_third_order():
    axis = np.array([0.3, -0.5, 0.4])
    errors = {m: [] for m in MEASURES[1:]}
    for h in (0.1, 0.05, 0.025):
        kappa = h * axis
        q = np.array([[math.sqrt(1 - kappa @ kappa / 4), *kappa / 2]])
        for measure, found in errors.items():
            found.append(np.linalg.norm(strain_from_rotation(q, measure)[0] - kappa))
    for found in errors.values():
        orders = np.log2(np.array(found[:-1]) / found[1:])
        np.testing.assert_allclose(orders, 3.0, atol=0.02)


def complex_strain(kappa, code):
    """The definitions again, in operations that complex numbers pass through."""
    q0 = np.sqrt(1 - (kappa * kappa).sum() / 4)
    if code == measures.SINE:
        return kappa
    if code == measures.ANGLE:
        y = np.sqrt((kappa * kappa).sum()) / 2
        return kappa * np.arcsin(y) / y
    n2 = q0 * q0 + kappa[2] ** 2 / 4
    return np.array([q0 * kappa[0] / n2, q0 * kappa[1] / n2, 2 * np.arctan(kappa[2] / 2 / q0)])


@pytest.mark.parametrize("measure", MEASURES)
def test_jacobian_is_the_complex_step(measure):
    code = CODES[measure]
    J = np.empty((3, 3))
    for q in random_rotations(30):
        kappa = 2 * q[1:]
        measures.jacobian_one(code, q[0], *kappa, J)
        exact = np.array(
            [complex_strain(kappa + 1e-30j * e, code).imag / 1e-30 for e in np.eye(3)]
        ).T
        np.testing.assert_allclose(J, exact, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("measure", MEASURES)
def test_hessian_is_the_derivative_of_the_jacobian(measure):
    """By the complex step on the stress-weighted Jacobian; the Jacobian's own test is above."""
    code = CODES[measure]
    H = np.empty((3, 3))
    random = np.random.default_rng(3)
    for q in random_rotations(30):
        kappa, m = 2 * q[1:], random.normal(size=3)
        measures.hessian_one(code, q[0], *kappa, m, H)
        exact = second_derivatives(lambda x, m=m: m @ complex_strain(x, code), kappa)
        size = max(1.0, np.abs(exact).max())
        np.testing.assert_allclose(H, H.T, atol=1e-13 * size)
        np.testing.assert_allclose(H, exact, atol=2e-9 * size)


def second_derivatives(f, x):
    """Central differences of complex-step derivatives, with one Richardson step."""

    def gradient(x):
        return np.array([f(x + 1e-30j * e).imag / 1e-30 for e in np.eye(3)])

    def quotient(h):
        return np.array([(gradient(x + h * e) - gradient(x - h * e)) / (2 * h) for e in np.eye(3)])

    h = 1e-3 * (1 - np.linalg.norm(x) / 2)
    return (4 * quotient(h / 2) - quotient(h)) / 3


@pytest.mark.parametrize("measure", MEASURES)
def test_derivatives_exist_where_there_is_no_strain(measure):
    code = CODES[measure]
    J, H = np.empty((3, 3)), np.empty((3, 3))
    measures.jacobian_one(code, 1.0, 0.0, 0.0, 0.0, J)
    measures.hessian_one(code, 1.0, 0.0, 0.0, 0.0, np.array([1.0, 2.0, 3.0]), H)
    np.testing.assert_array_equal(J, np.eye(3))
    np.testing.assert_array_equal(H, np.zeros((3, 3)))


@pytest.mark.parametrize("measure", MEASURES)
def test_pull_back_is_the_chain_rule_of_an_energy(measure):
    """Of a quartic energy: its derivatives with respect to kappa by the complex step."""
    code = CODES[measure]
    A = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 1.5]])

    def energy(w):
        return w @ A @ w / 2 + (w @ A @ w) ** 2 / 8

    q = random_rotations(10, seed=8)
    omega = strain_from_rotation(q, measure)
    force = omega @ A
    square = np.einsum("ni,ni->n", omega, force)
    stress = force * (1 + square[:, None] / 2)
    stiffness = A * (1 + square[:, None, None] / 2) + force[:, :, None] * force[:, None, :]
    measures.pull_back_all(code, q, stress, stiffness, 2)
    for i, row in enumerate(q):
        kappa = 2 * row[1:]

        def total(x):
            return energy(complex_strain(x, code))

        exact = [total(kappa + 1e-30j * e).imag / 1e-30 for e in np.eye(3)]
        np.testing.assert_allclose(stress[i], exact, rtol=1e-11, atol=1e-12)
        hessian = second_derivatives(total, kappa)
        np.testing.assert_allclose(stiffness[i], hessian, atol=2e-9 * np.abs(hessian).max())


def test_stiffness_of_a_hinge_that_turns_far():
    """Second derivative, with respect to the angle, of half the squared strain: the bending stiffness."""
    angle = np.linspace(0.1, 3.0, 30)
    h = 1e-3

    def energy(theta, measure):
        q = np.stack([np.cos(theta / 2), np.sin(theta / 2), 0 * theta, 0 * theta], axis=1)
        return (strain_from_rotation(q, measure) ** 2).sum(axis=1) / 2

    def stiffness(measure):
        sides = energy(angle + h, measure) + energy(angle - h, measure)
        return (sides - 2 * energy(angle, measure)) / h**2

    np.testing.assert_allclose(stiffness("sine"), np.cos(angle), atol=1e-5)  # negative beyond pi/2
    np.testing.assert_allclose(stiffness("angle"), 1.0, atol=1e-5)
    assert np.all(np.diff(stiffness("averaged")) > 0)


def test_fold_of_a_developable_ribbon():
    """Two flat faces joined along a fold: (4.35) of the thesis, and the twist that it loses."""
    gamma, theta = 0.4, 1.1
    first = Rotation.random(rng=np.random.default_rng(2))
    line = np.array(
        [math.cos(gamma), 0.0, math.sin(gamma)]
    )  # of the fold, in the plane of d1 and d3
    second = Rotation.from_rotvec(theta * first.apply(line)) * first
    np.testing.assert_allclose(first.apply(line), second.apply(line), atol=1e-15)  # common to both
    q = (first.inv() * second).as_quat(scalar_first=True)
    angle = strain_from_rotation([q], "angle")[0]
    np.testing.assert_allclose(
        angle, [theta * math.cos(gamma), 0.0, theta * math.sin(gamma)], atol=1e-14
    )
    for measure in ("sine", "angle"):
        strain = strain_from_rotation([q], measure)[0]
        assert strain[2] / strain[0] == pytest.approx(math.tan(gamma), rel=1e-13)
        assert strain[1] == pytest.approx(0.0, abs=1e-15)
    # not so with frames that are averaged: their twist is no multiple of their bending
    averaged = strain_from_rotation([q], "averaged")[0]
    assert abs(averaged[2] / averaged[0] - math.tan(gamma)) > 0.01


@given(VECTORS.filter(lambda v: np.linalg.norm(v) < 0.99))
@settings(max_examples=50, deadline=None)
def test_seen_from_the_other_end(v):
    # A half turn about d1 of both frames, which changes places: d1 stays, d2 and d3 turn over.
    q = np.array([[math.sqrt(1 - v @ v), *v]])
    other = np.array([[q[0, 0], -v[0], v[1], v[2]]])
    flip = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(matrix(other[0]), flip @ matrix(q[0]).T @ flip, atol=1e-14)
    for measure in MEASURES:
        here, there = strain_from_rotation(q, measure)[0], strain_from_rotation(other, measure)[0]
        np.testing.assert_allclose(there, here * [-1, 1, 1], atol=1e-14)


@given(VECTORS.filter(lambda v: np.linalg.norm(v) < 0.99))
@settings(max_examples=50, deadline=None)
def test_rotation_from_strain_is_the_inverse(v):
    q = np.array([[math.sqrt(1 - v @ v), *v]])
    for measure in MEASURES:
        strain = strain_from_rotation(q, measure)
        np.testing.assert_allclose(rotation_from_strain(strain, measure), q, atol=1e-13)
        np.testing.assert_allclose(strain_from_rotation(-q, measure), strain, atol=0)


def test_psi_is_accurate_everywhere():
    t = np.concatenate([[0.0], np.geomspace(1e-300, 1e-3, 200), np.linspace(1e-3, 2.0, 400)])
    exact = [
        1.0 if x == 0 else float(sp.N(sp.asin(sp.Rational(x) / 2) * 2 / x, 30)) for x in t[::7]
    ]
    np.testing.assert_allclose(angle_over_strain(t[::7]), exact, rtol=4e-16)
    assert angle_over_strain(2.0) == pytest.approx(math.pi / 2, rel=1e-15)
    values = angle_over_strain(t)
    assert np.all((values >= 1.0) & (values <= math.pi / 2))


def test_both_branches_of_the_kernels_psi_meet():
    for y in (1e-8, 0.1, math.sqrt(measures._SERIES) * (1 - 1e-12), 0.2501, 0.5, 0.99):
        Y = sp.Float(y, 120)
        w = sp.Symbol("w")
        f = sp.asin(sp.sqrt(w)) / sp.sqrt(w)
        found = measures.psi_terms(math.sqrt(1 - y * y), y * y)
        for order, value in enumerate(found):
            exact = sp.diff(f, w, order).subs(w, Y**2) / 4**order
            assert value == pytest.approx(float(exact), rel=3e-13), (y, order)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: angle_over_strain(2.1), "argument `t` holds 2.1"),
        (lambda: angle_over_strain([-0.1]), "argument `t` holds -0.1"),
        (lambda: strain_from_rotation([[1.0, 0.1, 0.0, 0.0]]), "unit quaternions"),
        (lambda: strain_from_rotation([[1.0, 0.0, 0.0, 0.0]], "sin"), "did you mean 'sine'"),
        (lambda: rotation_from_strain([[2.0, 0.0, 0.0]]), "more segments"),
        (lambda: rotation_from_strain([[0.0, 3.2, 0.0]], "angle"), "half a turn"),
        (lambda: rotation_from_strain([[0.0, 0.0, 3.2]], "averaged"), "half a turn"),
        (lambda: rotation_from_strain([[0.0, 0.0]]), "argument `strain` has shape"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InvalidInput, match=message.replace("(", r"\(")):
        call()
