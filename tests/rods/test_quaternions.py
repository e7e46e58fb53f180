"""Quaternions: algebra, rotations, exponential and logarithm, parallel transport."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from lissome.errors import InvalidInput
from lissome.rods import quaternions as qn

random = np.random.default_rng(4)


def unit(array):
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


Q = unit(random.standard_normal((40, 4)))
P = unit(random.standard_normal((40, 4)))
V = random.standard_normal((40, 3))
A = unit(random.standard_normal((40, 3)))
B = unit(random.standard_normal((40, 3)))


def left(q):
    """The matrix of the product with q from the left, from the multiplication table."""
    s, x, y, z = q
    return np.array([[s, -x, -y, -z], [x, s, -z, y], [y, z, s, -x], [z, -y, x, s]])


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_product_follows_the_multiplication_table():
    one, i, j, k = np.eye(4)
    for first, second, result in ((i, j, k), (j, k, i), (k, i, j), (j, i, -k), (i, i, -one)):
        np.testing.assert_array_equal(qn.multiply(first, second), result)
    for p, q in zip(P, Q, strict=True):
        np.testing.assert_allclose(qn.multiply(p, q), left(p) @ q, atol=1e-15)


def test_conjugate_is_the_inverse_and_reverses_products():
    np.testing.assert_allclose(qn.multiply(Q, qn.conjugate(Q)), np.eye(4)[[0] * 40], atol=1e-15)
    np.testing.assert_allclose(
        qn.conjugate(qn.multiply(P, Q)),
        qn.multiply(qn.conjugate(Q), qn.conjugate(P)),
        atol=1e-15,
    )


def test_rotations_agree_with_scipy_and_compose():
    there = Rotation.from_quat(np.roll(Q, -1, axis=1))
    np.testing.assert_allclose(qn.rotate(Q, V), there.apply(V), atol=1e-14)
    np.testing.assert_allclose(qn.to_matrix(Q), there.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(
        qn.rotate(qn.multiply(P, Q), V), qn.rotate(P, qn.rotate(Q, V)), atol=1e-14
    )


def test_matrices_and_directors_round_trip():
    canonical = Q * np.sign(Q[:, :1])
    np.testing.assert_allclose(qn.from_matrix(qn.to_matrix(Q)), canonical, atol=1e-14)
    np.testing.assert_allclose(qn.from_directors(qn.to_directors(Q)), canonical, atol=1e-14)
    for index in range(3):  # (4.10)
        np.testing.assert_allclose(
            qn.to_directors(Q)[:, index], qn.rotate(Q, np.eye(3)[index]), atol=1e-14
        )
    half_turns = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0.6, 0, 0.8]])
    back = qn.from_matrix(qn.to_matrix(half_turns))
    np.testing.assert_allclose(qn.to_matrix(back), qn.to_matrix(half_turns), atol=1e-15)


@settings(max_examples=100, deadline=None)
@given(arrays(float, 3, elements=st.floats(-1.8, 1.8)))
def test_exponential_is_that_of_the_matrix_and_the_logarithm_inverts_it(v):
    np.testing.assert_allclose(qn.to_matrix(qn.exponential(v)), expm(skew(v)), atol=4e-15)
    if np.linalg.norm(v) < 3.1:
        np.testing.assert_allclose(qn.logarithm(qn.exponential(v)), v, atol=1e-14)
        np.testing.assert_allclose(qn.logarithm(-qn.exponential(v)), v, atol=1e-14)


def test_tiny_rotations_lose_no_digit():
    for size in (1e-4, 1e-8, 1e-160, 1e-300, 0.0):
        v = size * np.array([0.6, 0.0, -0.8])
        np.testing.assert_allclose(qn.exponential(v)[1:], v / 2, rtol=2e-9)
        np.testing.assert_allclose(qn.logarithm(qn.exponential(v)), v, rtol=1e-15)


def test_rotation_about_an_axis():
    angle = random.uniform(-7, 7, 40)
    np.testing.assert_allclose(
        qn.rotation_about(A, angle), qn.exponential(A * angle[:, None]), atol=1e-14
    )  # (4.5)
    np.testing.assert_allclose(qn.rotate(qn.rotation_about(A, angle), A), A, atol=1e-14)


def test_parallel_transport_as_printed():
    p = qn.parallel_transport(A, B)
    c = np.sqrt((1 + np.sum(A * B, axis=1)) / 2)[:, None]
    np.testing.assert_allclose(
        p, np.hstack([c, np.cross(A, B) / (2 * c)]), rtol=1e-12, atol=1e-15
    )  # (4.6)
    np.testing.assert_allclose(np.linalg.norm(p, axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(qn.rotate(p, A), B, atol=1e-14)  # (4.7)
    np.testing.assert_allclose(qn.parallel_transport(B, A), qn.conjugate(p), atol=1e-14)


def test_parallel_transport_is_the_shortest_rotation():
    p = qn.parallel_transport(A, B)
    angle = np.linalg.norm(qn.logarithm(p), axis=1)
    np.testing.assert_allclose(angle, np.arccos(np.sum(A * B, axis=1)), atol=1e-7)
    for twist in (-0.5, 0.5):
        other = qn.multiply(p, qn.rotation_about(A, twist))
        np.testing.assert_allclose(qn.rotate(other, A), B, atol=1e-14)
        assert np.all(np.linalg.norm(qn.logarithm(other), axis=1) > angle)


def test_parallel_transport_is_accurate_close_to_the_opposite_direction():
    n = np.array([0.0, 1.0, 0.0])
    for gap in (1e-2, 1e-4, 1e-5):
        a = np.array([0.0, 0.0, 1.0])
        b = np.array([np.sin(gap), 0.0, -np.cos(gap)])
        expected = np.concatenate([[np.sin(gap / 2)], n * np.cos(gap / 2)])
        np.testing.assert_allclose(qn.parallel_transport(a, b), expected, atol=1e-10)


@pytest.mark.parametrize("gap", [0.0, 1e-9, 9e-7])
def test_opposite_tangents_are_refused(gap):
    a = np.array([0.0, 0.0, 1.0])
    b = np.array([np.sin(gap), 0.0, -np.cos(gap)])
    with pytest.raises(InvalidInput, match="opposite to `a`"):
        qn.parallel_transport(a, b)
    with pytest.raises(InvalidInput, match=r"`b`\[1\] is opposite to `a`\[1\]"):
        qn.parallel_transport(a, np.stack([a, b]))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qn.multiply([1, 0, 0], Q[0]), r"`p` has shape \(3,\)"),
        (lambda: qn.multiply(Q[:2], Q[:3]), "do not fit"),
        (lambda: qn.rotate([2, 0, 0, 0], V), "`q` has length 2"),
        (lambda: qn.rotate(Q, V[0, :2]), r"`w` has shape \(2,\)"),
        (lambda: qn.logarithm([[1, 0, 0, 0], [1, 1, 0, 0]]), r"`q`\[1\] has length 1.41"),
        (lambda: qn.rotation_about([1, 1, 0], 1.0), "`axis` has length"),
        (lambda: qn.parallel_transport([0, 0, 2], [0, 0, 1]), "`a` has length 2"),
        (lambda: qn.exponential([np.nan, 0, 0]), "must be finite"),
        (lambda: qn.from_matrix(np.diag([1, 1, 1.1])), "not orthonormal"),
        (lambda: qn.from_matrix([np.eye(3), -np.eye(3)]), r"`matrix`\[1\] is left-handed"),
        (lambda: qn.from_directors(np.eye(4)), r"shape \(4, 4\)"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()


def test_compiled_pieces_agree_with_the_functions_on_arrays():
    same = {"rtol": 0, "atol": 4e-16}
    wide = {"rtol": 0, "atol": 4e-15}
    for p, q, v, a, b in zip(P, Q, V, A, B, strict=True):
        tp, tq, tv, ta, tb = (tuple(x) for x in (p, q, v, a, b))
        np.testing.assert_allclose(qn.mul(tp, tq), qn.multiply(p, q), **same)
        np.testing.assert_allclose(qn.conj(tq), qn.conjugate(q), **same)
        np.testing.assert_allclose(qn.cross(ta, tb), np.cross(a, b), **same)
        np.testing.assert_allclose(qn.dot(ta, tb), a @ b, **same)
        np.testing.assert_allclose(qn.turn(tq, tv), qn.rotate(q, v), **wide)
        np.testing.assert_allclose(qn.exp_of(tv), qn.exponential(v), **same)
        np.testing.assert_allclose(qn.transport_of(ta, tb), qn.parallel_transport(a, b), **wide)
        np.testing.assert_allclose(qn.directors_of(tq), qn.to_directors(q), **same)
        np.testing.assert_allclose(qn.normalized(tuple(3 * q)), q, **same)
    assert qn.exp_of((0.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0)
    assert np.all(np.isnan(qn.transport_of((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))))
